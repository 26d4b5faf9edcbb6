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

from flinders.geometry.ellipsoid import Ellipsoid, symmetric

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators import Estimate

OFFSETS: Final = (0.005, 0.01, 0.02)
SHAPES: Final = (0.02, 0.05, 0.1)
"""Of the field: what a correction leaves, 1 σ."""
UNCORRECTED: Final = (0.3, 0.1)
"""Offset and shape of a sensor that was never corrected, 1 σ: small ones, so that little speaks for a correction."""
PROBABLE: Final = 0.999
FARTHEST: Final = 6.0
"""Standard deviations of an offset beyond which no other departure can make a correction probable."""

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


def may_be_corrected(centres: Floats, variances: Floats, sizes: Floats) -> NDArray[np.bool_]:
    """(…,) whether offsets (…, 3) with their variances are so small, of a size (…,), that a look at the rest is due."""
    limits = FARTHEST * np.sqrt(variances + np.square(OFFSETS[-1] * np.asarray(sizes)[..., np.newaxis]))
    small: NDArray[np.bool_] = (np.abs(centres) < limits).all(axis=-1)
    return small


def shrunk(estimate: Estimate) -> Estimate | None:
    """Shrink an estimate towards the readings as they are; None where these were hardly corrected before."""
    size = float(estimate.ellipsoid.shape.trace()) / 3.0
    if not _is_near(estimate, size):
        return None
    parameters = estimate.ellipsoid.parameters
    departures = DEPARTURES @ parameters / size
    covariance = DEPARTURES @ estimate.covariance @ DEPARTURES.T / size**2
    priors = [_prior(offset, shape) for offset, shape in product(OFFSETS, SHAPES)]
    *likelihoods, uncorrected = _log_densities(departures, covariance + np.array([*priors, _prior(*UNCORRECTED)]))
    odds = np.exp(np.array(likelihoods) - uncorrected)
    if not odds.mean() > PROBABLE / (1.0 - PROBABLE):
        return None
    mean, spread = _posterior(departures, covariance, priors, odds / odds.sum())
    centre_and_shape = size * (3.0 * SIZE + PARAMETERS @ mean)
    widths = size**2 * PARAMETERS @ spread @ PARAMETERS.T
    widths += np.outer(centre_and_shape, centre_and_shape) * (SIZE @ estimate.covariance @ SIZE) / size**2
    ellipsoid = Ellipsoid(centre_and_shape[:3], symmetric(centre_and_shape[3:]))
    return replace(estimate, ellipsoid=ellipsoid, covariance=widths, textbook=None)


def _is_near(estimate: Estimate, size: float) -> bool:
    """Whether `may_be_corrected` lets one estimate of a size pass, in plain numbers: most end here."""
    least, variances = (OFFSETS[-1] * size) ** 2, estimate.covariance.diagonal()[:3].tolist()
    centre = estimate.ellipsoid.centre.tolist()
    return all(abs(b) < FARTHEST * math.sqrt(v + least) for b, v in zip(centre, variances, strict=True))


def _prior(offset: float, shape: float) -> Floats:
    """(8, 8) covariance of departures."""
    return np.diag(np.square([offset] * 3 + [shape] * 5))


def _log_densities(departures: Floats, covariances: Floats) -> Floats:
    """(K,) logarithms of normal densities with (K, 8, 8) covariances, but for a constant."""
    factors = np.linalg.cholesky(covariances)
    standard = np.linalg.solve(factors, departures[:, np.newaxis])[..., 0]
    roots = np.diagonal(factors, axis1=1, axis2=2)
    densities: Floats = -0.5 * np.sum(standard**2, axis=1) - np.sum(np.log(roots), axis=1)
    return densities


def _posterior(departures: Floats, covariance: Floats, priors: list[Floats], weights: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of departures, averaged over priors of such weights."""
    gains = np.array([prior @ np.linalg.inv(covariance + prior) for prior in priors])
    means = gains @ departures
    mean = weights @ means
    off = means - mean
    spread = np.einsum("k,kij->ij", weights, gains @ covariance) + np.einsum("k,ki,kj->ij", weights, off, off)
    return mean, 0.5 * (spread + spread.T)
