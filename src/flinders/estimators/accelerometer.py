"""What the length of gravity says of an accelerometer: its bias, its gains, and how square its axes are.

At rest (1 + Γ)(gβ − f) is as long as gravity however the body is held, so that with a unit vector w along it

    1 − |(1 + Γ)(β − f/g)|,    J = (w, w_i w_j)

are residuals and Jacobian of the nine errors, as those of a magnetometer are in its field. Noise of f along gravity
stands in them, and that across it in the vertical of `flinders.likelihood.dip`: they say different things, and what is
found here is what a joint fit knows of the accelerometer before. A body that is accelerated has residuals that last:
so many in a row count as one.

When to use it: always; a body that stays level learns from it only what its prior says.

Source: minimum of squares with Huber's weights and a normal prior; the model as in I. Frosio, F. Pedersini, N. A.
Borghese, IEEE Trans. Instrum. Meas. 58 (2009), eq. 4.

>>> from flinders import simulate
>>> felt = simulate.tumble(seed=1, motion="hand", n=1500).samples.acceleration
>>> prior = known_before(1.02 * felt + [0.2, 0.0, 0.0], AccelerometerPrior.of())
>>> sigma = np.sqrt(np.diag(np.linalg.inv(prior.precision)))
>>> bool(abs(prior.mean[0] - 0.2 / 9.80665) < 4.0 * sigma[0] < 0.003)
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.covariance import Residuals, time_of
from flinders.estimators.joint_covariance import MOST
from flinders.geometry.ellipsoid import symmetric
from flinders.geometry.rotation import across, lengths
from flinders.likelihood.dip import AccelerometerPrior, by_symmetric
from flinders.likelihood.robust import huber, robust_sigma

if TYPE_CHECKING:
    from flinders.arrays import Floats

STEPS: Final = 5
"""Of Gauss and Newton, with weights that follow; the errors are small, and two would do."""

FINEST_LENGTH: Final = 1e-4
"""Of gravity: no length is known better."""


def known_before(acceleration: Floats, prior: AccelerometerPrior) -> AccelerometerPrior:
    """What lengths add to a prior.

    `acceleration`: (N, 3), specific force in body axes, any unit; NaN where there is none.
    """
    force = acceleration[np.isfinite(acceleration).all(axis=1) & acceleration.any(axis=1)]
    if not len(force):
        return prior
    scale = float(np.median(lengths(force)))
    force = force / scale
    errors = prior.mean
    for _ in range(STEPS):
        corrected = (errors[:3] - force) @ (np.eye(3) + symmetric(errors[3:]))
        residuals = 1.0 - lengths(corrected)
        sigma = max(robust_sigma(residuals), FINEST_LENGTH)
        weights = huber(residuals / sigma) / (sigma**2 * _in_a_row(residuals))
        along = corrected / np.maximum(1.0 - residuals, 1e-300)[:, np.newaxis]
        jacobian = _gradients(along, along)
        root, reliability = _reliable(jacobian, along, weights, sigma)
        precision = prior.precision + (root * reliability**2) @ root.T
        seen = root @ (reliability * np.linalg.solve(root, jacobian.T @ (weights * residuals)))
        errors = errors + np.linalg.solve(precision, prior.precision @ (prior.mean - errors) + seen)
    return AccelerometerPrior(errors, precision, scale)


def scatter_at_rest(acceleration: Floats) -> float:
    """Scatter of |g| that no errors of an accelerometer explain, as a share: a body that is moved, and noise."""
    errors = known_before(acceleration, AccelerometerPrior.of()).mean
    force = acceleration[np.isfinite(acceleration).all(axis=1)]
    corrected = lengths((errors[:3] - force / np.median(lengths(force))) @ (np.eye(3) + symmetric(errors[3:])))
    return robust_sigma(corrected - np.median(corrected))


def _gradients(first: Floats, second: Floats) -> Floats:
    """(N, 9) wβ + wΓw′ as linear functions of (β, Γ), of (N, 3) w and w′: of unit length, without noise along them."""
    return np.concatenate([first, by_symmetric(first, second)], axis=1)


def _reliable(jacobian: Floats, along: Floats, weights: Floats, sigma: float) -> tuple[Floats, Floats]:
    """(9, 9) root of the information, and (9,) of each of its columns the share that noise across gravity did not make.

    Noise in the Jacobian shrinks what is found to that share: of a body that stays level, to nothing (errors in
    variables, W. A. Fuller, *Measurement Error Models*, 1987, §1.1). Less than a tenth is none.
    """
    spurious = np.zeros((9, 9))
    for aside in np.moveaxis(across(along), 2, 0):
        moved = sigma * _gradients(aside, 2.0 * along)
        spurious += (moved.T * weights) @ moved
    lower = np.linalg.cholesky((jacobian.T * weights) @ jacobian + np.eye(9))  # 1: far less than any prior
    half = np.linalg.solve(lower, spurious)
    shares, turned = np.linalg.eigh(np.linalg.solve(lower, half.T))
    return lower @ turned, np.where(shares < MOST, np.clip(1.0 - shares, 0.0, 1.0), 0.0)


def _in_a_row(residuals: Floats) -> float:
    """How many residuals, one after the other, say as much as one."""
    middle = residuals - residuals.mean()
    alone = Residuals(middle, np.zeros((len(middle), 1)), [np.arange(len(middle))])
    return max(1.0, time_of(alone.autocovariance()))
