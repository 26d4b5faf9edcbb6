"""Limits by which firmware can tell a disturbed reading, of what a fit knows of its own scatter.

A reading x of the field's direction q has the error S⁻¹(δb + δS q + n) of the corrected direction: of the parameters,
by their covariance C, and of noise n with the standard deviation σ on each axis,

    M(q) = G C Gᵀ + σ² S⁻¹S⁻ᵀ

The length is off by F √(qᵀ M q), the direction by at most the root of the largest eigenvalue of M. The limits are
those of the worst direction, so that a clean reading is beyond them no more often than is said.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.ellipsoid import gathered
from flinders.geometry.sphere import fibonacci
from flinders.targets._gates import SIGMAS, TILT_DEG, Gates

DIRECTIONS: Final = 400

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.aiding import Aiding
    from flinders.fitting.result import Fit


def gates_of(fit: Fit) -> Gates | None:
    """The limits of a fit; None where its noise or uncertainty is not known, or nothing would be beyond them.

    Dip has a limit where the fit saw how the sensor is turned against an accelerometer or attitude, and the dip there.

    >>> from flinders import fit, simulate
    >>> gates = gates_of(fit(simulate.tumble(seed=1).samples))
    >>> round(gates.strength_limit, 1), gates.has_dip
    (2.4, False)
    """
    if not math.isfinite(fit.noise) or not fit.covariance.any():
        return None
    errors = _errors(fit)
    directions = fibonacci(DIRECTIONS)
    along = np.einsum("ni,nij,nj->n", directions, errors, directions)
    strength = SIGMAS * fit.calibration.field_strength * float(np.sqrt(along.max()))
    if not strength < fit.calibration.field_strength:
        return None
    aiding = fit.aiding
    if fit.calibration.rotation != "estimated" or aiding is None or aiding.dip_deg is None:
        return Gates(strength)
    across = float(np.linalg.eigvalsh(errors)[:, -1].max()) + _mounting(aiding)
    limit = SIGMAS * math.hypot(math.degrees(math.sqrt(across)), aiding.dip_sigma_deg or 0.0, TILT_DEG)
    return Gates(strength, aiding.dip_deg, limit)


def _errors(fit: Fit) -> Floats:
    """(N, 3, 3) M of directions all over."""
    ellipsoid = fit.calibration.ellipsoid
    inverse, directions = np.linalg.inv(ellipsoid.shape), fibonacci(DIRECTIONS)
    rows = np.stack([gathered(np.tile(row, (DIRECTIONS, 1)).T, directions.T) for row in inverse], axis=1)
    carried: Floats = rows @ np.asarray(fit.covariance) @ np.swapaxes(rows, 1, 2)
    return carried + fit.noise**2 * inverse @ inverse.T


def _mounting(aiding: Aiding) -> float:
    """rad²: variance of the rotation against the body, about its least certain axis."""
    covariance = aiding.rotation_covariance
    return 0.0 if covariance is None else float(np.linalg.eigvalsh(covariance)[-1])
