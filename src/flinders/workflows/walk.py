"""Random walk of a sensor's offset, from estimates of the offset over time.

The rate of the walk is estimated together with a factor on the claimed variances of the estimates, by a Kalman filter
for each pair of rate and factor. Its innovations have Student's distribution, so that a single step does not look like
a walk.

>>> rng = np.random.default_rng(1)
>>> hours = np.arange(0.0, 400.0, 4.0)
>>> truth = np.cumsum(rng.normal(0.0, 0.2 * 2.0, (100, 3)), axis=0)                           # 0.2 µT in an hour
>>> walk = walk_of(3600.0 * hours, truth + rng.normal(0.0, 0.1, (100, 3)), np.full((100, 3), 0.1))
>>> walk.low < 0.2 < walk.high < 1.5 * walk.low
True
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.offset_walk import HOUR_S, Walk

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

    Flags = NDArray[np.bool_]

MIN_STEPS: Final = 8
"""Smallest number of steps between estimates for a random walk."""
DEGREES_OF_FREEDOM: Final = 4.0
"""Degrees of freedom of Student's distribution of the innovations."""
STUDENT_SCALE: Final = 0.8310
"""Scale at which Student's distribution is nearest to the standard normal distribution."""
VARIANCE_FACTORS: Final = np.geomspace(1.0 / 16.0, 4.0, 7)
"""Grid of factors on the claimed variances of the estimates, from which the best is chosen."""


def walk_of(time_s: Floats, offset: Floats, sigma: Floats, moved: Flags | None = None) -> Walk | None:
    """Random walk of an offset; None if there are fewer than `MIN_STEPS` steps.

    Estimates that follow the offset slowly change less between neighbouring times than the offset does. If every other
    estimate gives a larger rate, that rate is used.

    Parameters
    ----------
    time_s : (n,) s
        Ascending.
    offset, sigma : (n, 3)
        Estimates, and their claimed 1 σ. An axis that hardly changes is left out.
    moved : (n,) bool, optional
        Whether the offset moved since the previous estimate; such a step is not part of the walk.
    """
    moves = np.zeros(len(time_s), int) if moved is None else np.cumsum(moved)
    walk: Walk | None = None
    for every in (1, 2, 4, 8, 16):
        rows = np.arange(len(time_s))[::-every][::-1]  # includes the newest
        is_cut = np.diff(moves[rows], prepend=0) > 0
        longer = _walk_of(time_s[rows], offset[rows], sigma[rows], is_cut) if len(rows) > MIN_STEPS else None
        if longer is None or (walk is not None and longer.rate < walk.high):
            break
        walk = longer
    return walk


def _walk_of(time_s: Floats, offset: Floats, sigma: Floats, moved: Flags) -> Walk | None:
    """Random walk by these estimates as they are; None if no axis changes."""
    steps = np.diff(offset, axis=0)[~moved[1:]]
    if len(steps) < MIN_STEPS or not (axes := np.mean(steps != 0.0, axis=0) > 0.5).any():
        return None
    hours, at = time_s / HOUR_S, offset[:, axes]
    variance = np.maximum(sigma[:, axes] ** 2, np.finfo(float).tiny)
    squares = np.mean(steps[:, axes] ** 2, axis=1) / np.diff(hours)[~moved[1:]]
    guess = math.sqrt(float(np.median(squares)))
    rates = np.geomspace(0.01 * guess, 10.0 * guess, 41)
    low, _, high = _quantiles(rates, _log_likelihood(hours, at, variance, rates, moved))
    rates = np.geomspace(low / 1.5, high * 1.5, 31)
    low, middle, high = _quantiles(rates, _log_likelihood(hours, at, variance, rates, moved))
    return Walk(middle / STUDENT_SCALE, low / STUDENT_SCALE, high / STUDENT_SCALE)


def _log_likelihood(hours: Floats, offset: Floats, variance: Floats, rates: Floats, moved: Flags) -> Floats:
    """(rates, factors) logarithms of the likelihood."""
    walk, share = (rates**2)[:, np.newaxis, np.newaxis], VARIANCE_FACTORS[:, np.newaxis]
    shape = len(rates), len(VARIANCE_FACTORS), offset.shape[1]
    at, unknown = np.broadcast_to(offset[0], shape), np.broadcast_to(share * variance[0], shape)
    total = np.zeros(shape)
    for step, hour in enumerate(np.diff(hours).tolist(), 1):
        noise = share * variance[step]
        if moved[step]:
            at, unknown = np.broadcast_to(offset[step], shape), np.broadcast_to(noise, shape)
            continue
        unknown = unknown + walk * hour
        spread, off = unknown + noise, offset[step] - at
        total -= (DEGREES_OF_FREEDOM + 1.0) / 2.0 * np.log1p(off**2 / (DEGREES_OF_FREEDOM * spread)) + np.log(
            spread
        ) / 2.0
        at, unknown = at + unknown / spread * off, unknown * noise / spread
    likelihood: Floats = total.sum(axis=2)
    return likelihood


def _quantiles(rates: Floats, log_likelihood: Floats) -> tuple[float, float, float]:
    """Low end of the 95 % interval, median, and high end of the rate, with all factors equally probable a priori."""
    density = np.exp(log_likelihood - log_likelihood.max()).sum(axis=1)
    below = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    low, middle, high = np.exp(np.interp([0.025, 0.5, 0.975], below / below[-1], np.log(rates))).tolist()
    return low, middle, high
