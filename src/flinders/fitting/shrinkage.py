"""Readings that were corrected before: a fit of them is shrunk towards leaving them as they are.

Firmware, a driver or an earlier calibration may have taken offset and soft iron off. A sensor that is then turned about
little more than one axis gives a fit that is far worse than the readings themselves. Departures d of a fit, its offset
and the deviator of its shape over the mean semi-axis, have a covariance P, and are normal with P + Q where Q is

    corrected     offset 0.5, 1 or 2 %, shape 2, 5 or 10 % (gains are often left as they were), all nine alike
    uncorrected   offset 30 %, shape 10 %: less than most sensors have, which speaks against the former

Where the marginal likelihood of d makes the first 99.9 % probable [1]_, the fit becomes its posterior mean, the average
of Q (P + Q)⁻¹ d over the nine, and claims the posterior covariance [2]_. Readings from all directions have a P so small
that nothing is shrunk. ``python -m benchmarks.windows`` measures what it does to parts of recordings.

.. [1] R. E. Kass, A. E. Raftery, "Bayes factors", J. Am. Stat. Assoc. 90 (1995) 773–795.
.. [2] C. N. Morris, "Parametric empirical Bayes inference", J. Am. Stat. Assoc. 78 (1983) 47–55.

>>> from flinders.estimators.base import Estimate
>>> poorly_known = np.diag([4.0, 0.04, 0.04, *[0.25] * 6])
>>> fitted = Estimate(Ellipsoid(np.array([3.0, 0.1, 0.0]), 50.0 * np.eye(3)), poorly_known, 0.3, "likelihood")
>>> nearer = shrunk(fitted)
>>> nearer.ellipsoid.centre.round(1), bool(np.sqrt(nearer.covariance[0, 0]) < 0.6)
(array([0.2, 0.1, 0. ]), True)
>>> shrunk(replace(fitted, ellipsoid=Ellipsoid(np.array([40.0, 9.0, 0.0]), 50.0 * np.eye(3)))) is None
True
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators import Estimate

OFFSETS: Final = (0.005, 0.01, 0.02)
SHAPES: Final = (0.02, 0.05, 0.1)
"""Of the field: what a correction leaves, 1 σ."""
UNCORRECTED: Final = (0.3, 0.1)
"""Offset and shape of a sensor that was never corrected, 1 σ: small ones, so that little speaks for a correction."""
PRIORS: Final = np.stack([np.diag(np.square([b] * 3 + [s] * 5)) for b, s in [*product(OFFSETS, SHAPES), UNCORRECTED]])
"""(10, 8, 8) covariances of departures: nine of corrections, and that of none."""
PROBABLE: Final = 0.999
FARTHEST: Final = 6.0
"""Standard deviations of an offset beyond which no other departure can make a correction probable."""
UNKNOWN: Final = 100.0
"""Root of the summed variances, over the field, from which on a correction cannot be told, and rounding decides."""

DEVIATOR: Final = np.zeros((6, 5))
"""Entries 11, 22, 33, 12, 13, 23 of an orthonormal basis of symmetric matrices without trace."""
DEVIATOR[:3, :2] = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]).T / np.sqrt([2.0, 6.0])
DEVIATOR[3:, 2:] = np.eye(3) / np.sqrt(2.0)
PARAMETERS: Final = np.zeros((9, 8))
"""Offset and shape of departures, both over the mean semi-axis."""
PARAMETERS[:3, :3], PARAMETERS[3:, 3:] = np.eye(3), DEVIATOR
DEPARTURES: Final = PARAMETERS.T * np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Departures of parameters: an off-diagonal entry stands twice in the matrix."""
SIZE: Final = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0


def shrunk(estimate: Estimate) -> Estimate | None:
    """Shrink an estimate towards the readings as they are; None where these were hardly corrected before."""
    if not _is_near(estimate):
        return None
    parameters, covariance = estimate.ellipsoid.parameters, estimate.covariance
    places, means, spreads = posteriors(parameters[np.newaxis], covariance[np.newaxis])
    if not len(places):
        return None
    ellipsoid = Ellipsoid.of_parameters(means[0])
    return replace(estimate, ellipsoid=ellipsoid, covariance=spreads[0], textbook=None)


def posteriors(parameters: Floats, covariances: Floats) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Shrink those of U estimates whose readings were corrected before.

    Parameters
    ----------
    parameters : (U, 9) float
        Of (b, S), as `flinders.geometry.ellipsoid.Ellipsoid.parameters`.
    covariances : (U, 9, 9) float
        In the square of their unit.

    Returns
    -------
    (K,) int, (K, 9) float, (K, 9, 9) float
        Which they are, and the posterior mean and covariance of each.
    """
    sizes = parameters[:, 3:6].sum(axis=1) / 3.0
    places = np.flatnonzero(_are_near(parameters, covariances, sizes))
    sizes, covariances = sizes[places, np.newaxis, np.newaxis], covariances[places]
    departures = DEPARTURES @ parameters[places, :, np.newaxis] / sizes
    spreads = _semidefinite(DEPARTURES @ covariances @ DEPARTURES.T / sizes**2)
    odds = _odds(departures, spreads)
    chosen = odds.mean(axis=1) > PROBABLE / (1.0 - PROBABLE)
    sizes, covariances = sizes[chosen], covariances[chosen]
    weights = odds[chosen] / odds[chosen].sum(axis=1, keepdims=True)
    means, spreads = _posterior(departures[chosen], spreads[chosen], weights)
    shrunken = sizes * (3.0 * SIZE[:, np.newaxis] + PARAMETERS @ means)
    widths = sizes**2 * (PARAMETERS @ spreads @ PARAMETERS.T)
    of_sizes = SIZE[np.newaxis] @ covariances @ SIZE[:, np.newaxis]
    widths += shrunken * shrunken.swapaxes(1, 2) * of_sizes / sizes**2
    return places[chosen], shrunken[:, :, 0], widths


def _semidefinite(spreads: Floats) -> Floats:
    """(U, 8, 8) covariances without the negative variances that rounding leaves where another one is huge."""
    values, axes = np.linalg.eigh(spreads)
    clipped: Floats = (axes * np.maximum(values, 0.0)[:, np.newaxis]) @ axes.swapaxes(1, 2)
    return clipped


def _are_near(parameters: Floats, covariances: Floats, sizes: Floats) -> NDArray[np.bool_]:
    """(U,) whether estimates are so certain, and offsets so small, that a look at the other departures is due."""
    variances = np.diagonal(covariances, axis1=1, axis2=2)[:, :3]
    limits = FARTHEST * np.sqrt(variances + np.square(OFFSETS[-1] * sizes)[:, np.newaxis])
    is_known = covariances.trace(axis1=1, axis2=2) < (UNKNOWN * sizes) ** 2
    near: NDArray[np.bool_] = (np.abs(parameters[:, :3]) < limits).all(axis=1) & is_known
    return near


def _is_near(estimate: Estimate) -> bool:
    """The same of one estimate, in plain numbers: most end here."""
    size = sum(estimate.ellipsoid.shape.diagonal().tolist()) / 3.0
    variances, least = estimate.covariance.diagonal().tolist(), (OFFSETS[-1] * size) ** 2
    offsets = zip(estimate.ellipsoid.centre.tolist(), variances, strict=False)
    is_known = sum(variances) < (UNKNOWN * size) ** 2
    return is_known and all(abs(b) < FARTHEST * math.sqrt(v + least) for b, v in offsets)


def _odds(departures: Floats, spreads: Floats) -> Floats:
    """(U, 9) how many times as likely each prior of a correction makes (U, 8, 1) departures as none does."""
    factors = np.linalg.cholesky(spreads[:, np.newaxis] + PRIORS)
    standard = np.linalg.solve(factors, departures[:, np.newaxis])[..., 0]
    roots = np.diagonal(factors, axis1=2, axis2=3)
    densities = -0.5 * np.sum(standard**2, axis=2) - np.sum(np.log(roots), axis=2)
    odds: Floats = np.exp(densities[:, :-1] - densities[:, -1:])
    return odds


def _posterior(departures: Floats, spreads: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """(U, 8, 1) means and (U, 8, 8) covariances of departures, averaged over priors of (U, 9) weights."""
    priors = PRIORS[:-1]
    gains = priors @ np.linalg.inv(spreads[:, np.newaxis] + priors)
    each = (gains @ departures[:, np.newaxis])[..., 0]  # (U, 9, 8)
    means = weights[:, np.newaxis] @ each
    off = each - means
    within = np.sum(weights[:, :, np.newaxis, np.newaxis] * (gains @ spreads[:, np.newaxis]), axis=1)
    posterior = within + off.swapaxes(1, 2) @ (weights[:, :, np.newaxis] * off)
    return means.swapaxes(1, 2), 0.5 * (posterior + posterior.swapaxes(1, 2))
