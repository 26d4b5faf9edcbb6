"""The course of a disturbance at any lag, smoothed so that the noise of its meter is the same at each.

A value between two readings of a meter, a share f of the way from one to the next, has (1 − f)² + f² of its variance:
half of it in the middle. Readings that follow the meter's column would lie nearer to such values whatever the lag is,
and a lag of half a reading would be found where there is none. So columns are smoothed by a Gaussian kernel of two
readings before they are shifted, which leaves 0.13 of the variance at any share of a reading:

    c(t) = Σ G(i(t) − j) c_j,        i(t) the place of t among the times of readings

That is for finding a lag. Offsets per unit are told by the columns themselves, which keep their fast changes.

>>> noise = np.random.default_rng(1).normal(size=20_000)
>>> time = np.arange(20_000) / 50.0
>>> plain = [np.interp(time - share / 50.0, time, noise) for share in (0.0, 0.25, 0.5)]
>>> [round(float(np.var(values)), 1) for values in plain]
[1.0, 0.6, 0.5]
>>> course = Track.of(time, noise)
>>> [round(float(np.var(course.at(time - share / 50.0))), 3) for share in (0.0, 0.25, 0.5)]
[0.132, 0.132, 0.132]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.disturbance import lagged

if TYPE_CHECKING:
    from flinders.arrays import Floats

WIDTH: Final = 2.0
"""Standard deviation of the kernel, in readings."""

REACH: Final = 4.0
"""Standard deviations at which it ends."""

PLACES: Final = 8
"""To each reading: between these the course is straight, which takes less than a thousandth off the variance."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A smoothed column.

    Attributes
    ----------
    time : (M,) float, s
    values : (M,) float
    """

    time: Floats
    values: Floats

    @classmethod
    def of(cls, time: Floats, values: Floats) -> Self:
        """Smooth (N,) values at (N,) ascending times; gaps among them are bridged, and the ends hold beyond."""
        readings = np.arange(len(values), dtype=float)
        places = np.arange((len(values) - 1) * PLACES + 1) / PLACES
        reach = int(REACH * WIDTH * PLACES)
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (WIDTH * PLACES)) ** 2)
        between = np.pad(np.interp(places, readings, lagged(values, time, 0.0)), reach, mode="edge")
        smooth = np.convolve(between, kernel / kernel.sum(), mode="valid")
        return cls(np.interp(places, readings, time), smooth)

    def at(self, time: Floats) -> Floats:
        """(N,) values at (N,) times."""
        interpolated: Floats = np.interp(time, self.time, self.values)
        return interpolated
