"""Bias, gains and misalignment of an accelerometer from the length of gravity.

The accelerometer reads f, with bias β in units of gravity g and the symmetric matrix Γ of gain errors and misalignment.
At rest (1 + Γ)(gβ − f) has the length of gravity at any attitude. With a unit vector w along it

    1 − |(1 + Γ)(β − f/g)|,    J = (w, w_i w_j)

are residuals and Jacobian of the nine errors, as for a magnetometer in its field. These residuals contain the noise of
f along gravity; the vertical of `flinders.likelihood.dip` contains the noise across gravity. Both are therefore
independent, and the result of this fit is the prior of the accelerometer in a joint fit. Residuals of an accelerated
body are correlated, and are weighted by their correlation length.

When to use it: always. For a body that stays level the result is the prior.

Source: least squares with Huber's weights and a normal prior; the model as in I. Frosio, F. Pedersini, N. A. Borghese,
IEEE Trans. Instrum. Meas. 58 (2009), eq. 4.

>>> from flinders import simulate
>>> acceleration = simulate.tumble(seed=1, motion="hand", n=1500).samples.acceleration
>>> prior = update_prior(1.02 * acceleration + [0.2, 0.0, 0.0], AccelerometerPrior.of())
>>> sigma = np.sqrt(np.diag(np.linalg.inv(prior.precision)))
>>> bool(abs(prior.mean[0] - 0.2 / 9.80665) < 4.0 * sigma[0] < 0.003)
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.covariance import Residuals, correlation_length
from flinders.estimators.joint_covariance import MAX_SPURIOUS_SHARE
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.rotation import lengths, perpendicular_vectors
from flinders.likelihood.dip import AccelerometerPrior, symmetric_derivatives
from flinders.likelihood.robust import huber_weights, robust_sigma

if TYPE_CHECKING:
    from flinders.arrays import Floats

NEWTON_STEPS: Final = 5
"""Number of Gauss–Newton steps; two are usually enough, as the errors are small."""

MIN_LENGTH_SIGMA: Final = 1e-4
"""Smallest standard deviation of the length of gravity, relative to gravity."""


def update_prior(acceleration: Floats, prior: AccelerometerPrior) -> AccelerometerPrior:
    """Update the prior of an accelerometer's errors by the lengths of its readings.

    `acceleration` is the (N, 3) specific force in body axes, in any unit; NaN for missing readings.
    """
    force = acceleration[np.isfinite(acceleration).all(axis=1) & acceleration.any(axis=1)]
    if not len(force):
        return prior
    scale = float(np.median(lengths(force)))
    force = force / scale
    errors = prior.mean
    for _ in range(NEWTON_STEPS):
        corrected = (errors[:3] - force) @ (np.eye(3) + symmetric_matrix(errors[3:]))
        residuals = 1.0 - lengths(corrected)
        sigma = max(robust_sigma(residuals), MIN_LENGTH_SIGMA)
        weights = huber_weights(residuals / sigma) / (sigma**2 * _correlation_length(residuals))
        along = corrected / np.maximum(1.0 - residuals, 1e-300)[:, np.newaxis]
        jacobian = _gradients(along, along)
        root, reliability = _reliability(jacobian, along, weights, sigma)
        precision = prior.precision + (root * reliability**2) @ root.T
        seen = root @ (reliability * np.linalg.solve(root, jacobian.T @ (weights * residuals)))
        errors = errors + np.linalg.solve(precision, prior.precision @ (prior.mean - errors) + seen)
    return AccelerometerPrior(errors, precision, scale)


def rest_scatter(acceleration: Floats) -> float:
    """Relative scatter of |f| by motion and noise, without the part that errors of the accelerometer explain."""
    errors = update_prior(acceleration, AccelerometerPrior.of()).mean
    force = acceleration[np.isfinite(acceleration).all(axis=1)]
    corrected = lengths((errors[:3] - force / np.median(lengths(force))) @ (np.eye(3) + symmetric_matrix(errors[3:])))
    return robust_sigma(corrected - np.median(corrected))


def _gradients(first: Floats, second: Floats) -> Floats:
    """(N, 9) derivatives of wβ + wΓw′ by (β, Γ), for (N, 3) unit vectors w and w′."""
    return np.concatenate([first, symmetric_derivatives(first, second)], axis=1)


def _reliability(jacobian: Floats, along: Floats, weights: Floats, sigma: float) -> tuple[Floats, Floats]:
    """(9, 9) root of the information, and (9,) reliability of its columns, 0 to 1.

    The reliability is the share of the information that is not due to noise across gravity in the Jacobian. That noise
    shrinks an estimate to this share of its value, for a level body to zero (errors in variables, W. A. Fuller,
    *Measurement Error Models*, 1987, §1.1). A reliability below a tenth is set to zero.
    """
    spurious = np.zeros((9, 9))
    for aside in np.moveaxis(perpendicular_vectors(along), 2, 0):
        moved = sigma * _gradients(aside, 2.0 * along)
        spurious += (moved.T * weights) @ moved
    lower = np.linalg.cholesky((jacobian.T * weights) @ jacobian + np.eye(9))  # 1 is much less than any prior
    half = np.linalg.solve(lower, spurious)
    shares, turned = np.linalg.eigh(np.linalg.solve(lower, half.T))
    return lower @ turned, np.where(shares < MAX_SPURIOUS_SHARE, np.clip(1.0 - shares, 0.0, 1.0), 0.0)


def _correlation_length(residuals: Floats) -> float:
    """Correlation length of consecutive residuals: number of residuals that are equivalent to one independent one."""
    middle = residuals - residuals.mean()
    alone = Residuals(middle, np.zeros((len(middle), 1)), [np.arange(len(middle))])
    return max(1.0, correlation_length(alone.autocovariance()))
