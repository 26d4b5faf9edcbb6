"""Error of the vertical that an accelerometer shows at rest, from the covariance of its calibration.

With (1 + Γ)(f/g − β) along the true vertical u, errors δβ and δΓ of the calibration change the corrected vertical by

    δu = (1 − u uᵀ) (δΓ w − (1 + Γ) δβ),    w = (1 + Γ)⁻¹ u

to first order. A tilt about the horizontal field changes the heading of a level vehicle by tan I times the tilt.

>>> known = np.diag([1e-3**2] * 3 + [0.0] * 6)              # each offset to 1 mg: 0.057°
>>> error = tilt_error(np.zeros(9), known)
>>> round(error.rms, 3), round(error.worst, 3), round(error.bound_95, 2)
(0.081, 0.081, 0.16)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.inertial import TiltError
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.rotation import perpendicular_vectors
from flinders.geometry.sphere import fibonacci
from flinders.likelihood.dip import symmetric_derivatives

if TYPE_CHECKING:
    from flinders.arrays import Floats

ATTITUDES: Final = 200
"""Count of attitudes, with directions of gravity spread evenly over the sphere."""
DRAWS: Final = 4000
"""Count of random errors from which the bound is computed, for an accuracy of 1 %."""
PROBABILITY: Final = 0.95


def tilt_error(errors: Floats, covariance: Floats) -> TiltError:
    """Tilt error of the vertical, from a covariance.

    Parameters
    ----------
    errors : (9,) float
        β relative to gravity, and the upper triangle of Γ, as in `flinders.likelihood.dip.AccelerometerPrior`.
    covariance : (9, 9) float
        Covariance of `errors`.
    """
    moved = tilt_gradients(errors, fibonacci(ATTITUDES))
    variances = np.einsum("nki,ij,nkj->n", moved, covariance, moved)
    draws = _root(covariance) @ np.random.default_rng(0).standard_normal((9, DRAWS))
    largest = np.sqrt(np.max(np.sum((moved @ draws) ** 2, axis=1), axis=0))
    worst, rms = float(np.sqrt(variances.max())), float(np.sqrt(variances.mean()))
    return TiltError(*np.rad2deg([rms, worst, np.quantile(largest, PROBABILITY)]).tolist())


def tilt_gradients(errors: Floats, attitudes: Floats) -> Floats:
    """(N, 2, 9) derivatives of the tilt in rad, two components across the vertical, by the nine errors.

    `attitudes` are (N, 3) directions of the vertical.
    """
    whole = np.eye(3) + symmetric_matrix(errors[3:])
    aside = np.swapaxes(perpendicular_vectors(attitudes), 1, 2)
    felt = np.linalg.solve(whole, attitudes.T).T
    of_matrix = symmetric_derivatives(aside, np.repeat(felt[:, np.newaxis], 2, axis=1))
    return np.concatenate([-aside @ whole, of_matrix], axis=2)


def _root(covariance: Floats) -> Floats:
    """(9, 9) square root of a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
