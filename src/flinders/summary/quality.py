"""Quality of a recording before any fit: repeated readings, stuck axes, saturated axes and jumps in time.

`flinders.fitting.verdict` makes findings from these counts. Counts of consecutive blocks add in order; counts of
separate recordings are merged with `DataQuality.merge`.

>>> from flinders.core.samples import Samples
>>> DataQuality.of(Samples.of([[1, 2, 3], [1, 2, 3], [4, 2, 3]])).repeats
1
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.samples import merge_skipped

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples, Skipped


RAIL_SHARE, RAIL_COUNT, RAIL_WIDTH = 0.01, 8, 0.25
"""Limits of a rail, which is an end of an axis where the sensor saturates.

They are the smallest fraction of the readings at the end, their smallest number, and the smallest ratio of their range
along the other axes to the range of all readings."""

MIN_RAIL_CONTRAST: Final = 3
"""Smallest ratio at a rail of the number of readings with the end value to the number with the next value.

If an axis merely has coarse steps, both numbers are similar. Of 1,400 unsaturated turns by hand in steps of 0.15 to 8
µT two are called saturated (`tests/fitting/test_verdict.py`)."""

SAMPLE_SIZE: Final = 4096
"""Largest number of different readings that are all counted. Of more, only a sample is counted."""


@dataclass(frozen=True, slots=True, eq=False)
class Lows:
    """Smallest value of each axis, and statistics of the readings that have exactly this value.

    At a rail (a saturated axis) many readings have the smallest value while the other axes vary widely. Where an axis
    only touches the sphere, few readings have the smallest value, and these are close together.
    """

    values: Floats = field(default_factory=lambda: np.full(3, np.inf))  #: (3,): smallest value of each axis
    counts: Floats = field(default_factory=lambda: np.zeros(3))  #: (3,): number of readings with the smallest value
    #: (3,): second smallest value of each axis
    next_values: Floats = field(default_factory=lambda: np.full(3, np.inf))
    #: (3,): number of readings with the second smallest value
    next_counts: Floats = field(default_factory=lambda: np.zeros(3))
    #: (3, 3): row i has the smallest value of each axis among the readings with the smallest value of axis i
    least: Floats = field(default_factory=lambda: np.full((3, 3), np.inf))
    #: (3, 3): row i has the largest value of each axis among the readings with the smallest value of axis i
    most: Floats = field(default_factory=lambda: np.full((3, 3), -np.inf))

    @classmethod
    def of(cls, readings: Floats) -> Self:
        """Statistics of (N, 3) readings, N > 0."""
        return cls.of_axes(np.ascontiguousarray(readings.T))

    @classmethod
    def of_axes(cls, axes: Floats) -> Self:
        """Statistics of (3, N) readings, contiguous by axis, N > 0."""
        values = axes.min(axis=1)
        is_lowest = axes == values[:, np.newaxis]
        axis, rows = np.divmod(np.flatnonzero(is_lowest), axes.shape[1])
        counts = np.bincount(axis, minlength=3)
        begins, there = np.cumsum(counts) - counts, axes[:, rows]
        next_values = axes.min(axis=1, where=~is_lowest, initial=np.inf)
        return cls(
            values,
            counts.astype(float),
            next_values,
            np.array([np.count_nonzero(each == value) for each, value in zip(axes, next_values, strict=True)], float),
            np.minimum.reduceat(there, begins, axis=1).T,
            np.maximum.reduceat(there, begins, axis=1).T,
        )

    def __add__(self, other: Lows) -> Self:
        values, next_values, next_counts = self._lowest_two(other)
        mine, theirs = (self.values == values), (other.values == values)
        mine_too, theirs_too = mine[:, np.newaxis], theirs[:, np.newaxis]
        return type(self)(
            values,
            self.counts * mine + other.counts * theirs,
            next_values,
            next_counts,
            np.minimum(np.where(mine_too, self.least, np.inf), np.where(theirs_too, other.least, np.inf)),
            np.maximum(np.where(mine_too, self.most, -np.inf), np.where(theirs_too, other.most, -np.inf)),
        )

    def _lowest_two(self, other: Lows) -> tuple[Floats, Floats, Floats]:
        """(3,) smallest values of both, (3,) second smallest values, and (3,) numbers of readings with the latter."""
        values = np.stack([self.values, self.next_values, other.values, other.next_values])
        counts = np.stack([self.counts, self.next_counts, other.counts, other.next_counts])
        lowest = values.min(axis=0)
        following = np.where(values > lowest, values, np.inf).min(axis=0)
        return lowest, following, np.where(values == following, counts, 0.0).sum(axis=0)

    @property
    def ranges(self) -> Floats:
        """(3, 3): row i has the range of each axis among the readings with the smallest value of axis i."""
        with np.errstate(over="ignore"):
            return self.most - self.least


@dataclass(frozen=True, slots=True, eq=False)
class DistinctReadings:
    """Different readings of a recording, or a sample of them: the readings whose hash begins with `level` zero bits.

    The level is the lowest at which at most `SAMPLE_SIZE` readings remain. The samples of the parts of a recording
    therefore merge to the sample of the whole, in any order.

    Examples
    --------
    >>> readings = np.arange(60_000.0).reshape(-1, 3)
    >>> twice = DistinctReadings.of(readings) + DistinctReadings.of(readings)
    >>> len(twice.hashes), twice.multiplicity
    (2513, 2.0)
    """

    #: (K,) uint64: hashes of 63 bits, ascending
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    #: (K,): number of readings with each hash
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    level: int = 0  #: number of leading zero bits that all hashes have

    @classmethod
    def of(cls, readings: Floats) -> DistinctReadings:
        """Sample (N, 3) readings."""
        hashes = _hashes(readings)
        level = max(len(hashes) // SAMPLE_SIZE, 2).bit_length() - 1
        while True:  # begins at a level that keeps about twice the sample, so that few hashes are sorted
            level -= 1
            some, counts = np.unique(hashes[_has_leading_zeros(hashes, level)], return_counts=True)
            if len(some) > SAMPLE_SIZE or level == 0:
                return cls(some, counts, level)._raise_level()

    def __add__(self, other: DistinctReadings) -> DistinctReadings:
        """Merge two samples."""
        hashes, places = np.unique(np.concatenate([self.hashes, other.hashes]), return_inverse=True)
        counts = np.bincount(places, np.concatenate([self.counts, other.counts]), len(hashes)).astype(np.int64)
        level = max(self.level, other.level)
        chosen = _has_leading_zeros(hashes, level)
        return DistinctReadings(hashes[chosen], counts[chosen], level)._raise_level()

    def _raise_level(self) -> DistinctReadings:
        """Require more leading zero bits of the hashes until at most `SAMPLE_SIZE` different readings remain."""
        hashes, counts, level = self.hashes, self.counts, self.level
        while len(hashes) > SAMPLE_SIZE:
            level += 1
            chosen = _has_leading_zeros(hashes, level)
            hashes, counts = hashes[chosen], counts[chosen]
        return DistinctReadings(hashes, counts, level)

    @property
    def multiplicity(self) -> float:
        """Mean number of times that each different reading occurs in the recording."""
        return float(self.counts.mean()) if len(self.counts) else 1.0


@dataclass(frozen=True, slots=True)
class Steps:
    """Count of the steps between consecutive readings, and the sum of their squared lengths."""

    count: int = 0
    squares: float = 0.0

    @classmethod
    def of(cls, axes: Floats) -> Steps:
        """Sum the steps of (3, N) readings."""
        with np.errstate(over="ignore", invalid="ignore"):  # readings out of any sensor's range
            steps = np.diff(axes).ravel()
            return cls(axes.shape[1] - 1, float(steps @ steps))

    def __add__(self, other: Steps) -> Steps:
        return Steps(self.count + other.count, self.squares + other.squares)

    def correlation(self, spread: float) -> float:
        """Correlation of consecutive readings; `spread` is the rms distance of the readings from their mean.

        >>> Steps.of(np.array([[1.0, -1.0, 1.0, -1.0]])).correlation(spread=1.0)
        -1.0
        """
        return 1.0 - self.squares / self.count / spread / (2.0 * spread) if self.count and spread else np.nan


@dataclass(frozen=True, slots=True)
class TimeStamps:
    """Statistics of the time stamps of one or several recordings."""

    start: float = np.nan  #: s: first time; NaN without times
    end: float = np.nan  #: s: last time
    seconds: float = 0.0  #: s: sum of the durations of all recordings
    steps: int = 0  #: number of steps between consecutive readings with a time
    longest_step: float = 0.0  #: s: largest step forward
    backward_steps: int = 0  #: number of steps back in time

    @classmethod
    def of(cls, time: Floats | None) -> Self:
        """Statistics of (N,) times in s; readings without a time are ignored."""
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
        """Append the next block of the same recording; the time between both blocks is a step."""
        both = self.merge(other)
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

    def merge(self, other: TimeStamps) -> TimeStamps:
        """Merge with a separate recording; the time between both is not a step."""
        return TimeStamps(
            start=other.start if np.isnan(self.start) else self.start,
            end=self.end if np.isnan(other.end) else other.end,
            seconds=self.seconds + other.seconds,
            steps=self.steps + other.steps,
            longest_step=max(self.longest_step, other.longest_step),
            backward_steps=self.backward_steps + other.backward_steps,
        )

    @property
    def mean_step(self) -> float:
        """Mean step in s; 0 without times."""
        return self.seconds / max(self.steps, 1)


@dataclass(frozen=True, slots=True)
class Rail:
    """End of an axis at which the sensor was saturated."""

    axis: int  #: index of the axis
    end: str  #: ``lowest`` or ``highest``
    value: float  #: in the unit of the readings: value at which the axis is saturated
    share: float  #: fraction of the readings that have exactly the value of saturation


@dataclass(frozen=True, slots=True, eq=False)
class DataQuality:
    """Quality statistics of one or several recordings."""

    rows: int = 0  #: usable readings
    repeats: int = 0  #: readings equal to the previous one in all three axes
    path: Steps = Steps()  #: steps between consecutive readings
    #: (3,): first reading; NaN without readings
    first: Floats = field(default_factory=lambda: np.full(3, np.nan))
    last: Floats = field(default_factory=lambda: np.full(3, np.nan))  #: (3,): last reading; NaN without readings
    lows: Lows = field(default_factory=Lows)  #: low end of each axis
    highs: Lows = field(default_factory=Lows)  #: high end of each axis: the low end of the negated readings
    seen: DistinctReadings = field(default_factory=DistinctReadings)  #: different readings, or a sample of them
    clock: TimeStamps = TimeStamps()  #: statistics of the time stamps
    skipped: tuple[Skipped, ...] = ()  #: rows that were skipped by the reader

    @classmethod
    def of(cls, samples: Samples) -> Self:
        """Statistics of one recording, or of one block of it."""
        readings = samples.field
        if not len(readings):
            return cls(skipped=samples.skipped)
        axes = np.ascontiguousarray(readings.T)
        return cls(
            rows=len(readings),
            repeats=_count_repeats(axes),
            path=Steps.of(axes),
            first=readings[0].copy(),
            last=readings[-1].copy(),
            lows=Lows.of_axes(axes),
            highs=Lows.of_axes(-axes),
            seen=DistinctReadings.of(readings),
            clock=TimeStamps.of(samples.time),
            skipped=samples.skipped,
        )

    def __add__(self, other: DataQuality) -> Self:
        """Append the next block of the same recording."""
        both = self.merge(other)
        repeats = both.repeats + int(np.array_equal(self.last, other.first))
        seam = Steps.of(np.stack([self.last, other.first], axis=1)) if self.rows and other.rows else Steps()
        return replace(both, repeats=repeats, path=both.path + seam, clock=self.clock + other.clock)

    def merge(self, other: DataQuality) -> Self:
        """Merge with a separate recording; the step from one recording to the other is not counted."""
        return type(self)(
            rows=self.rows + other.rows,
            repeats=self.repeats + other.repeats,
            path=self.path + other.path,
            first=self.first if self.rows else other.first,
            last=other.last if other.rows else self.last,
            lows=self.lows + other.lows,
            highs=self.highs + other.highs,
            seen=self.seen + other.seen,
            clock=self.clock.merge(other.clock),
            skipped=merge_skipped(self.skipped, other.skipped),
        )

    @property
    def extent(self) -> Floats:
        """(3,) range of each axis."""
        with np.errstate(over="ignore"):  # readings out of any sensor's range
            return -self.highs.values - self.lows.values

    @property
    def distinct(self) -> int:
        """Number of different readings; estimated from a sample if there are more than `SAMPLE_SIZE`."""
        return round(self.rows / self.seen.multiplicity)

    @property
    def rails(self) -> tuple[Rail, ...]:
        """Ends of axes at which the sensor was saturated, with many more readings than at the next value."""
        return tuple(
            Rail(axis, end, sign * float(ends.values[axis]), float(ends.counts[axis]) / self.rows)
            for end, sign, ends, axis in self._shared_ends()
            if ends.counts[axis] > MIN_RAIL_CONTRAST * ends.next_counts[axis]
        )

    @property
    def step(self) -> float:
        """Largest step between the last two values at an end of an axis with coarse resolution; 0 without one."""
        return max(
            (
                float(ends.next_values[axis] - ends.values[axis])
                for _, _, ends, axis in self._shared_ends()
                if ends.counts[axis] <= MIN_RAIL_CONTRAST * ends.next_counts[axis]
            ),
            default=0.0,
        )

    def _shared_ends(self) -> Iterator[tuple[str, float, Lows, int]]:
        """Yield ends of axes with many readings that differ widely in the other axes: rails, or coarse steps."""
        for end, sign, ends in (("lowest", 1.0, self.lows), ("highest", -1.0, self.highs)):
            for axis in range(3):
                is_many = ends.counts[axis] >= RAIL_COUNT and ends.counts[axis] > RAIL_SHARE * self.rows
                if is_many and self._has_wide_end(ends, axis):
                    yield end, sign, ends, axis

    def _has_wide_end(self, ends: Lows, axis: int) -> bool:
        """Whether the readings at the end of an axis that changes differ widely in the other two axes."""
        others, extent = [other for other in range(3) if other != axis], self.extent
        return bool(extent[axis] > 0.0 and np.all(ends.ranges[axis, others] > RAIL_WIDTH * extent[others]))


def _hashes(readings: Floats) -> NDArray[np.uint64]:
    """(N,) hashes of 63 bits of (N, 3) readings, equal to those of the engine (`native/quality.c`)."""
    hashes = np.zeros(len(readings), np.uint64)
    for axis in range(3):
        hashes ^= (readings[:, axis] + 0.0).view(np.uint64)  # -0 is 0
        hashes *= np.uint64(0xBF58476D1CE4E5B9)
        hashes ^= hashes >> np.uint64(29)
    hashes *= np.uint64(0x94D049BB133111EB)
    hashes ^= hashes >> np.uint64(32)
    return hashes >> np.uint64(1)


def _has_leading_zeros(hashes: NDArray[np.uint64], level: int) -> NDArray[np.bool_]:
    """(K,) booleans: whether each of (K,) hashes of 63 bits begins with `level` zero bits."""
    return hashes < np.uint64(1 << (63 - level))


def _count_repeats(axes: Floats) -> int:
    """Number of (3, N) readings that equal the previous reading."""
    same = np.flatnonzero(axes[0, 1:] == axes[0, :-1])
    return int(np.count_nonzero((axes[1:, same + 1] == axes[1:, same]).all(axis=0))) if len(same) else 0
