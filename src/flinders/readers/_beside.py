"""What other sensors measured, at the times of a magnetometer's readings.

>>> climb = Beside.of([0.0, 1.0, 2.0], [[0, 0], [10, 1], [20, 4]])
>>> climb.at(np.array([0.5, 1.5, 9.0]))
array([[ 5. ,  0.5],
       [15. ,  2.5],
       [ nan,  nan]])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import floats

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.samples import Samples

LONGEST: Final = 2.5
"""Seconds between two measurements over which nothing is interpolated."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """Measurements with times of their own.

    Attributes
    ----------
    time : (M,) float, s
        Ascending.
    values : (M, k) float
    """

    time: Floats
    values: Floats

    @classmethod
    def of(cls, time: ArrayLike, values: ArrayLike) -> Self | None:
        """Put measurements in the order of their times, without those that are not finite; None where none is left.

        Parameters
        ----------
        time : (M,) array-like, s
        values : (M, k) array-like
        """
        when, measured = floats(time), floats(values)
        usable = np.isfinite(when) & np.isfinite(measured).all(axis=1)
        order = np.argsort(when[usable], kind="stable")
        return cls(when[usable][order], measured[usable][order]) if usable.any() else None

    def at(self, time: Floats) -> Floats:
        """(N, k) at these (N,) times, between neighbours by a straight line; NaN before, after and in long gaps."""
        found = np.column_stack([np.interp(time, self.time, column, np.nan, np.nan) for column in self.values.T])
        after = np.clip(np.searchsorted(self.time, time, side="right"), 1, max(len(self.time) - 1, 1))
        if len(self.time) > 1:
            gap = self.time[after] - self.time[after - 1]
            met = (time == self.time[after]) | (time == self.time[after - 1])
            found[(gap > LONGEST) & ~met] = np.nan
        return found


def along(beside: Beside | None, time: Floats, turn: Floats | None = None) -> Floats | None:
    """The same of something that may not be there, turned by a (3, 3) rotation where there is one."""
    if beside is None:
        return None
    found = beside.at(time)
    return found if turn is None else found @ turn.T


def numbered(samples: Samples, before: int) -> Samples:
    """A block of a recording, whose rows that were left out are numbered by the whole: so many rows come before it."""
    skipped = (replace(one, lines=tuple(line + before for line in one.lines)) for one in samples.skipped)
    return replace(samples, skipped=tuple(skipped)) if samples.skipped and before else samples
