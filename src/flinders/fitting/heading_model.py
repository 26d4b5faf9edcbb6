"""Covariance of a fit in the axes of corrected readings, for exported code that states the error of each heading.

>>> from flinders import fit, simulate
>>> model = heading_model_of(fit(simulate.tumble(seed=1).samples))
>>> round(model.noise, 2), model.factor.shape, model.plane
(0.5, (9, 9), None)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.fitting.measurement_noise import noise_of
from flinders.geometry.ellipsoid import parameter_derivatives, symmetric_matrix, upper_entries
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import level_fields
from flinders.targets._heading_model import HeadingModel

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

DECIMALS: Final = 8
"""Count of decimals of exported numbers, which are at most about 1 and in single precision."""


def heading_model_of(fit: Fit) -> HeadingModel | None:
    """Numbers from which exported code computes the heading error at any attitude; None if `noise_of` is None."""
    if noise_of(fit) is None:
        return None
    claim, calibration = fit.claim, fit.calibration
    strength, turn, dip_deg = calibration.field_strength, calibration.rotation_matrix, claim.known_dip_deg
    matrix = calibration.matrix @ turn.T
    across, directions = level_fields(dip_deg, down_direction(claim.plane))
    mean = parameter_derivatives(matrix.T @ across / strength, strength * directions).mean(axis=0).round(DECIMALS)
    return HeadingModel(
        matrix=(matrix + matrix.T) / 2.0,
        factor=_factor(claim.claimed_covariance, turn, strength),
        mean=mean,
        noise=fit.evidence.noise,
        alignment_deg=claim.alignment_error_deg or 0.0,
        level_field=(strength * math.cos(math.radians(dip_deg)), strength * math.sin(math.radians(dip_deg))),
        plane=claim.plane,
    )


def _factor(covariance: Floats, turn: Floats, strength: float) -> Floats:
    """(9, 9) upper triangular U, such that UᵀU is the covariance of R b and of R S Rᵀ / F.

    U is computed by eigenvectors and QR, because a covariance may be singular. Entries are rounded to `DECIMALS`
    relative to the standard deviation of their column.
    """
    turned = np.zeros((9, 9))
    turned[:3, :3] = turn
    turned[3:, 3:] = (
        np.stack([upper_entries(turn @ symmetric_matrix(row) @ turn.T) for row in np.eye(6)], axis=1) / strength
    )
    variances, vectors = np.linalg.eigh(covariance)
    root = np.sqrt(variances.clip(min=0.0))[:, np.newaxis] * vectors.T
    factor: Floats = np.linalg.qr(root @ turned.T).R
    factor *= np.where(np.diag(factor) < 0.0, -1.0, 1.0)[:, np.newaxis]
    sigma = np.maximum(np.linalg.norm(factor, axis=0), np.finfo(float).tiny)
    rounded: Floats = sigma * (factor / sigma).round(DECIMALS)
    return rounded
