"""Whether what was logged of a driver is fit to be followed: noise of its meter, and a course that only goes one way.

**Noise.** Least squares takes the driver as known. White noise e of its meter makes P too small, by the share
var e / var c, and no residual is larger for it. It shows in fast changes: with h = c − (mean of 15 about it), a
reading whose sensitivity to the driver is q = n·P leaves

    ρ = −Σ r q h / Σ (q h)²

which is the share of fast changes that readings do not follow: 0 for an exact meter, 1 where all of it is noise.

**One way.** What only rises, or is switched on once, goes with time as well: an offset that drifts, or a sensor that
moved, would look the same. `one_way` is the share of its variance that a monotone function of time explains.

Source: errors in variables as in Fuller, "Measurement Error Models" (1987), §1.1; isotonic regression by pooling
adjacent violators, Barlow et al. (1972).

>>> rng = np.random.default_rng(1)
>>> drawn = np.repeat(rng.uniform(0.0, 20.0, 30), 40)
>>> readings = 0.5 * drawn + rng.normal(scale=0.2, size=1200)
>>> for noise in (0.0, 3.0):
...     logged = drawn + rng.normal(scale=noise, size=1200)
...     slope, level = np.polyfit(logged, readings, 1)
...     too_small = attenuation(logged, readings - slope * logged - level, np.full(1200, slope))
...     print(f"{slope:.2f} {too_small:.1%}")
0.50 0.0%
0.39 19.1%
>>> one_way(np.linspace(0.0, 1.0, 100) ** 2), round(one_way(np.sin(np.linspace(0.0, 20.0, 1000))), 1)
(1.0, 0.2)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

WINDOW: Final = 15
"""Readings whose mean is taken off: what is left is fast. Real changes in it are followed, and do not count."""

SIGNIFICANT: Final = 4.0
"""Standard deviations beyond which fast changes are missing."""

STRETCHES: Final = 100
"""Means of which a course is made up."""


def attenuation(values: Floats, residuals: Floats, sensitivity: Floats) -> float:
    """By which share an offset per unit is too small, as the meter is noisy; 0 where nothing of it shows.

    Parameters
    ----------
    values : (N,) float
        Of the driver, in the order of recording.
    residuals : (N,) float
        What the fit leaves, in the unit of the readings.
    sensitivity : (N,) float
        By how much each of them moves with one unit of the driver.
    """
    half = WINDOW // 2
    fast = np.zeros(len(values))
    fast[half:-half] = values[half:-half] - np.convolve(values, np.full(WINDOW, 1.0 / WINDOW), mode="valid")
    moved = sensitivity * fast
    square = float(moved @ moved)
    variance = float(np.var(values))
    if square <= 0.0 or variance <= 0.0:
        return 0.0
    missing = -float(residuals @ moved) / square
    if missing * np.sqrt(square) < SIGNIFICANT * float(np.std(residuals)):
        return 0.0
    noise = min(missing, 1.0) * float(np.mean(fast[half:-half] ** 2)) * WINDOW / (WINDOW - 1.0)
    return min(noise / variance, 1.0)


def one_way(values: Floats) -> float:
    """Share of the variance of (N,) values, in the order of recording, that a monotone function of time explains."""
    course = np.array([part.mean() for part in np.array_split(values, min(STRETCHES, len(values)))])
    total = float(np.var(values))
    if total <= 0.0:
        return 0.0
    return float(max(np.var(_rising(course)), np.var(_rising(-course)))) / total


def _rising(course: Floats) -> Floats:
    """The nearest course that never falls, in least squares: neighbours that do are pooled."""
    pools: list[tuple[float, int]] = []
    for value in course.tolist():
        mean, count = value, 1
        while pools and pools[-1][0] >= mean:
            before, size = pools.pop()
            mean, count = (before * size + mean * count) / (size + count), size + count
        pools.append((mean, count))
    return np.repeat([mean for mean, _ in pools], [count for _, count in pools])
