"""What a recording says about itself before any fit: repeats, stuck axes, rails and jumps in time.

None of it is a verdict; `flinders.fitting.verdict` turns these counts into findings. They add up in the order of
recording, like everything a `Summary` holds; recordings of their own are put `beside` each other.

>>> from flinders.core.samples import Samples
>>> DataQuality.of(Samples.of([[1, 2, 3], [1, 2, 3], [4, 2, 3]])).repeats
1
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples, Skipped


RAIL_SHARE, RAIL_COUNT, RAIL_WIDTH = 0.01, 8, 0.25
"""Readings at the very end of an axis that make a rail: so many of all, so many, so far apart along the other axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Lows:
    """The smallest value of each axis, and the readings that have exactly that value.

    At a rail (a saturated axis) many readings share it while the other axes range widely; at the
    end of a sphere few do, close together.

    Attributes
    ----------
    values : (3,) float
    counts : (3,) float
        Readings that have that value.
    least, most : (3, 3) float
        Row i: smallest and largest reading, axis by axis, among those.
    """

    values: Floats = field(default_factory=lambda: np.full(3, np.inf))
    counts: Floats = field(default_factory=lambda: np.zeros(3))
    least: Floats = field(default_factory=lambda: np.full((3, 3), np.inf))
    most: Floats = field(default_factory=lambda: np.full((3, 3), -np.inf))

    @classmethod
    def of(cls, readings: Floats) -> Self:
        """Look at (N, 3) readings, N > 0."""
        return cls.along(np.ascontiguousarray(readings.T))

    @classmethod
    def along(cls, axes: Floats) -> Self:
        """Look at readings axis by axis, (3, N), N > 0."""
        values = axes.min(axis=1)
        axis, rows = np.divmod(np.flatnonzero(axes == values[:, np.newaxis]), axes.shape[1])
        counts = np.bincount(axis, minlength=3)
        begins, there = np.cumsum(counts) - counts, axes[:, rows]
        return cls(
            values,
            counts.astype(float),
            np.minimum.reduceat(there, begins, axis=1).T,
            np.maximum.reduceat(there, begins, axis=1).T,
        )

    def __add__(self, other: Lows) -> Self:
        values = np.minimum(self.values, other.values)
        mine, theirs = (self.values == values), (other.values == values)
        mine_too, theirs_too = mine[:, np.newaxis], theirs[:, np.newaxis]
        return type(self)(
            values,
            self.counts * mine + other.counts * theirs,
            np.minimum(np.where(mine_too, self.least, np.inf), np.where(theirs_too, other.least, np.inf)),
            np.maximum(np.where(mine_too, self.most, -np.inf), np.where(theirs_too, other.most, -np.inf)),
        )

    @property
    def ranges(self) -> Floats:
        """(3, 3) how far each axis ranges among the readings at the end of axis i."""
        with np.errstate(over="ignore"):
            return self.most - self.least


@dataclass(frozen=True, slots=True)
class TimeStamps:
    """Time stamps of a recording, or of several.

    Attributes
    ----------
    start, end : float, s
        First and last; NaN without time.
    seconds : float, s
        From the first to the last of each recording, added up.
    steps : int
        From one reading with a time to the next.
    longest_step : float, s
        Largest step forward.
    backward_steps : int
        Steps that go back.
    """

    start: float = np.nan
    end: float = np.nan
    seconds: float = 0.0
    steps: int = 0
    longest_step: float = 0.0
    backward_steps: int = 0

    @classmethod
    def of(cls, time: Floats | None) -> Self:
        """Look at (N,) times; readings without one are passed over."""
        time = None if time is None else time[~np.isnan(time)]
        if time is None or not len(time):
            return cls()
        steps = np.diff(time)
        return cls(
            start=float(time[0]),
            end=float(time[-1]),
            seconds=float(time[-1] - time[0]),
            steps=len(steps),
            longest_step=float(steps.max(initial=0.0)),
            backward_steps=int(np.count_nonzero(steps < 0.0)),
        )

    def __add__(self, other: TimeStamps) -> TimeStamps:
        """`other` goes on where this ends: from there to its start is a step like any other."""
        both = self.merged(other)
        step = other.start - self.end
        if np.isnan(step):
            return both
        return replace(
            both,
            seconds=both.seconds + step,
            steps=both.steps + 1,
            longest_step=max(both.longest_step, step),
            backward_steps=both.backward_steps + (step < 0.0),
        )

    def merged(self, other: TimeStamps) -> TimeStamps:
        """Both, where `other` is a recording of its own: from one to the other is no step."""
        return TimeStamps(
            start=other.start if np.isnan(self.start) else self.start,
            end=self.end if np.isnan(other.end) else other.end,
            seconds=self.seconds + other.seconds,
            steps=self.steps + other.steps,
            longest_step=max(self.longest_step, other.longest_step),
            backward_steps=self.backward_steps + other.backward_steps,
        )

    @property
    def usual_step(self) -> float:
        """Mean step, in s; 0 without time."""
        return self.seconds / max(self.steps, 1)


@dataclass(frozen=True, slots=True)
class Rail:
    """An end of an axis at which the sensor was at its limit.

    Attributes
    ----------
    axis : int
    end : str
        ``lowest`` or ``highest``.
    value : float
    share : float
        Of the readings, how many have exactly that value.
    """

    axis: int
    end: str
    value: float
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class DataQuality:
    """Counts over a recording.

    Attributes
    ----------
    rows : int
        Usable readings.
    repeats : int
        Readings equal to the one before in all three axes.
    first, last : (3,) float
        The first and the last reading; NaN where there is none.
    lows : Lows
        The low end of each axis.
    highs : Lows
        The high end: the low end of the readings with their sign changed.
    clock : TimeStamps
        What the time stamps say.
    skipped : tuple of Skipped
        Rows left out while reading.
    """

    rows: int = 0
    repeats: int = 0
    first: Floats = field(default_factory=lambda: np.full(3, np.nan))
    last: Floats = field(default_factory=lambda: np.full(3, np.nan))
    lows: Lows = field(default_factory=Lows)
    highs: Lows = field(default_factory=Lows)
    clock: TimeStamps = TimeStamps()
    skipped: tuple[Skipped, ...] = ()

    @classmethod
    def of(cls, samples: Samples) -> Self:
        """Look at one recording, or one block of it."""
        readings = samples.field
        if not len(readings):
            return cls(skipped=samples.skipped)
        axes = np.ascontiguousarray(readings.T)
        return cls(
            rows=len(readings),
            repeats=_repeats(axes),
            first=readings[0].copy(),
            last=readings[-1].copy(),
            lows=Lows.along(axes),
            highs=Lows.along(-axes),
            clock=TimeStamps.of(samples.time),
            skipped=samples.skipped,
        )

    def __add__(self, other: DataQuality) -> Self:
        """`other` goes on where this ends."""
        both = self.merged(other)
        repeats = both.repeats + int(np.array_equal(self.last, other.first))
        return replace(both, repeats=repeats, clock=self.clock + other.clock)

    def merged(self, other: DataQuality) -> Self:
        """Both, where `other` is a recording of its own: its first reading repeats none and follows none."""
        return type(self)(
            rows=self.rows + other.rows,
            repeats=self.repeats + other.repeats,
            first=self.first if self.rows else other.first,
            last=other.last if other.rows else self.last,
            lows=self.lows + other.lows,
            highs=self.highs + other.highs,
            clock=self.clock.merged(other.clock),
            skipped=_merged(self.skipped, other.skipped),
        )

    @property
    def extent(self) -> Floats:
        """(3,) range of each axis."""
        with np.errstate(over="ignore"):  # of numbers that no sensor reads
            return -self.highs.values - self.lows.values

    @property
    def rails(self) -> tuple[Rail, ...]:
        """Where the sensor was at its limit: many readings share the end of an axis, far apart along the others."""
        rails = []
        for end, sign, ends in (("lowest", 1.0, self.lows), ("highest", -1.0, self.highs)):
            for axis in range(3):
                share = float(ends.counts[axis]) / max(self.rows, 1)
                if ends.counts[axis] >= RAIL_COUNT and share > RAIL_SHARE and self._is_wide(ends, axis):
                    rails.append(Rail(axis, end, sign * float(ends.values[axis]), share))
        return tuple(rails)

    def _is_wide(self, ends: Lows, axis: int) -> bool:
        """Whether readings at the end of an axis that does change lie far apart along the other two, as at a rail."""
        others, extent = [other for other in range(3) if other != axis], self.extent
        return bool(extent[axis] > 0.0 and np.all(ends.ranges[axis, others] > RAIL_WIDTH * extent[others]))


def _repeats(axes: Floats) -> int:
    """How many readings, (3, N), equal the one before."""
    same = np.flatnonzero(axes[0, 1:] == axes[0, :-1])
    return int(np.count_nonzero((axes[1:, same + 1] == axes[1:, same]).all(axis=0))) if len(same) else 0


def _merged(some: tuple[Skipped, ...], more: tuple[Skipped, ...]) -> tuple[Skipped, ...]:
    """Add up what was skipped for the same reason."""
    by_reason = {skipped.reason: skipped for skipped in some}
    for skipped in more:
        known = by_reason.get(skipped.reason)
        by_reason[skipped.reason] = known + skipped if known else skipped
    return tuple(by_reason.values())
