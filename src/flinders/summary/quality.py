"""What a recording says about itself before any fit: repeats, stuck axes, rails and jumps in time.

None of it is a verdict; `flinders.fitting.verdict` turns these counts into findings. They add up in the order of
recording, like everything a `Summary` holds; recordings of their own are put `beside` each other.

>>> from flinders.core.samples import Samples
>>> DataQuality.of(Samples.of([[1, 2, 3], [1, 2, 3], [4, 2, 3]])).repeats
1
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.samples import added

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples, Skipped


RAIL_SHARE, RAIL_COUNT, RAIL_WIDTH = 0.01, 8, 0.25
"""Readings that share the very end of an axis: so many of all, so many, so far apart along the other axes."""

RAIL_CONTRAST: Final = 3
"""So many times the readings at the next value of the axis make a rail of those at its end; coarse steps have about as
many there. Of 1,400 unsaturated turns by hand in steps of 0.15 to 8 µT two are then called saturated
(`tests/fitting/test_verdict.py`, steps)."""

SAMPLE: Final = 4096
"""Different readings that are counted; of more a sample."""


@dataclass(frozen=True, slots=True, eq=False)
class Lows:
    """The smallest value of each axis, and the readings that have exactly that value.

    At a rail (a saturated axis) many readings share it while the other axes range widely; at the
    end of a sphere few do, close together.
    """

    values: Floats = field(default_factory=lambda: np.full(3, np.inf))  #: (3,)
    counts: Floats = field(default_factory=lambda: np.zeros(3))  #: (3,): readings that have that value
    #: (3,): the next larger value of each axis, and the readings that have that
    next_values: Floats = field(default_factory=lambda: np.full(3, np.inf))
    next_counts: Floats = field(default_factory=lambda: np.zeros(3))
    #: (3, 3): row i: smallest and largest reading, axis by axis, among those
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
        """(3,) the smallest value of both, the next one, and the readings that have the next one."""
        values = np.stack([self.values, self.next_values, other.values, other.next_values])
        counts = np.stack([self.counts, self.next_counts, other.counts, other.next_counts])
        lowest = values.min(axis=0)
        following = np.where(values > lowest, values, np.inf).min(axis=0)
        return lowest, following, np.where(values == following, counts, 0.0).sum(axis=0)

    @property
    def ranges(self) -> Floats:
        """(3, 3) how far each axis ranges among the readings at the end of axis i."""
        with np.errstate(over="ignore"):
            return self.most - self.least


@dataclass(frozen=True, slots=True, eq=False)
class DistinctReadings:
    """The different readings of a recording, or a sample of them: those whose hash begins with `level` zeros.

    The level is the lowest that leaves `SAMPLE` of them, so that the sample of a whole follows from those of its parts,
    and the same readings are in it whatever their order.

    Examples
    --------
    >>> readings = np.arange(60_000.0).reshape(-1, 3)
    >>> twice = DistinctReadings.of(readings) + DistinctReadings.of(readings)
    >>> len(twice.hashes), twice.multiplicity
    (2513, 2.0)
    """

    #: (K,) uint64: ascending, of 63 bits
    hashes: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))  #: (K,): readings of each
    level: int = 0

    @classmethod
    def of(cls, readings: Floats) -> DistinctReadings:
        """Look at (N, 3) readings."""
        hashes = _hashes(readings)
        level = max(len(hashes) // SAMPLE, 2).bit_length() - 1
        while True:  # from about twice as many as needed on, so that only few are sorted
            level -= 1
            some, counts = np.unique(hashes[_begins_with_zeros(hashes, level)], return_counts=True)
            if len(some) > SAMPLE or level == 0:
                return cls(some, counts, level)._thinned()

    def __add__(self, other: DistinctReadings) -> DistinctReadings:
        """The different readings of both."""
        hashes, places = np.unique(np.concatenate([self.hashes, other.hashes]), return_inverse=True)
        counts = np.bincount(places, np.concatenate([self.counts, other.counts]), len(hashes)).astype(np.int64)
        level = max(self.level, other.level)
        chosen = _begins_with_zeros(hashes, level)
        return DistinctReadings(hashes[chosen], counts[chosen], level)._thinned()

    def _thinned(self) -> DistinctReadings:
        """Those that are few enough."""
        hashes, counts, level = self.hashes, self.counts, self.level
        while len(hashes) > SAMPLE:
            level += 1
            chosen = _begins_with_zeros(hashes, level)
            hashes, counts = hashes[chosen], counts[chosen]
        return DistinctReadings(hashes, counts, level)

    @property
    def multiplicity(self) -> float:
        """How often a reading occurs, on average."""
        return float(self.counts.mean()) if len(self.counts) else 1.0


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps from one reading to the next: how many, and the sum of their squares."""

    count: int = 0
    squares: float = 0.0

    @classmethod
    def of(cls, axes: Floats) -> Steps:
        """Look at readings axis by axis, (3, N)."""
        with np.errstate(over="ignore", invalid="ignore"):  # of numbers that no sensor reads
            steps = np.diff(axes).ravel()
            return cls(axes.shape[1] - 1, float(steps @ steps))

    def __add__(self, other: Steps) -> Steps:
        return Steps(self.count + other.count, self.squares + other.squares)

    def correlation(self, spread: float) -> float:
        """Correlation of one reading with the next, of readings whose distance from their mean is `spread` (rms).

        >>> Steps.of(np.array([[1.0, -1.0, 1.0, -1.0]])).correlation(spread=1.0)
        -1.0
        """
        return 1.0 - self.squares / self.count / spread / (2.0 * spread) if self.count and spread else np.nan


@dataclass(frozen=True, slots=True)
class TimeStamps:
    """Time stamps of a recording, or of several."""

    start: float = np.nan  #: s; NaN without time
    end: float = np.nan  #: s
    seconds: float = 0.0  #: s: from the first to the last of each recording, added up
    steps: int = 0  #: from one reading with a time to the next
    longest_step: float = 0.0  #: s: largest step forward
    backward_steps: int = 0  #: steps that go back

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
    """An end of an axis at which the sensor was at its limit."""

    axis: int
    end: str  #: ``lowest`` or ``highest``
    value: float
    share: float  #: of the readings, how many have exactly that value


@dataclass(frozen=True, slots=True, eq=False)
class DataQuality:
    """Counts over a recording."""

    rows: int = 0  #: usable readings
    repeats: int = 0  #: readings equal to the one before in all three axes
    path: Steps = Steps()  #: from one reading to the next
    #: (3,): the first and the last reading; NaN where there is none
    first: Floats = field(default_factory=lambda: np.full(3, np.nan))
    last: Floats = field(default_factory=lambda: np.full(3, np.nan))
    lows: Lows = field(default_factory=Lows)  #: the low end of each axis
    highs: Lows = field(default_factory=Lows)  #: the high end: the low end of the readings with their sign changed
    seen: DistinctReadings = field(default_factory=DistinctReadings)  #: the different readings
    clock: TimeStamps = TimeStamps()  #: what the time stamps say
    skipped: tuple[Skipped, ...] = ()  #: rows left out while reading

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
            path=Steps.of(axes),
            first=readings[0].copy(),
            last=readings[-1].copy(),
            lows=Lows.along(axes),
            highs=Lows.along(-axes),
            seen=DistinctReadings.of(readings),
            clock=TimeStamps.of(samples.time),
            skipped=samples.skipped,
        )

    def __add__(self, other: DataQuality) -> Self:
        """`other` goes on where this ends."""
        both = self.merged(other)
        repeats = both.repeats + int(np.array_equal(self.last, other.first))
        seam = Steps.of(np.stack([self.last, other.first], axis=1)) if self.rows and other.rows else Steps()
        return replace(both, repeats=repeats, path=both.path + seam, clock=self.clock + other.clock)

    def merged(self, other: DataQuality) -> Self:
        """Both, where `other` is a recording of its own: its first reading repeats none and follows none."""
        return type(self)(
            rows=self.rows + other.rows,
            repeats=self.repeats + other.repeats,
            path=self.path + other.path,
            first=self.first if self.rows else other.first,
            last=other.last if other.rows else self.last,
            lows=self.lows + other.lows,
            highs=self.highs + other.highs,
            seen=self.seen + other.seen,
            clock=self.clock.merged(other.clock),
            skipped=added(self.skipped, other.skipped),
        )

    @property
    def extent(self) -> Floats:
        """(3,) range of each axis."""
        with np.errstate(over="ignore"):  # of numbers that no sensor reads
            return -self.highs.values - self.lows.values

    @property
    def distinct(self) -> int:
        """Different readings, wherever they stand; of more than `SAMPLE` from a sample of them."""
        return round(self.rows / self.seen.multiplicity)

    @property
    def rails(self) -> tuple[Rail, ...]:
        """Where the sensor was at its limit: far more readings share the end of an axis than its next value."""
        return tuple(
            Rail(axis, end, sign * float(ends.values[axis]), float(ends.counts[axis]) / self.rows)
            for end, sign, ends, axis in self._shared_ends()
            if ends.counts[axis] > RAIL_CONTRAST * ends.next_counts[axis]
        )

    @property
    def step(self) -> float:
        """Largest step between the last two values of an axis that is read in coarse steps; 0 where none is."""
        return max(
            (
                float(ends.next_values[axis] - ends.values[axis])
                for _, _, ends, axis in self._shared_ends()
                if ends.counts[axis] <= RAIL_CONTRAST * ends.next_counts[axis]
            ),
            default=0.0,
        )

    def _shared_ends(self) -> Iterator[tuple[str, float, Lows, int]]:
        """Ends of axes that many readings share, far apart along the others: rails, or coarse steps."""
        for end, sign, ends in (("lowest", 1.0, self.lows), ("highest", -1.0, self.highs)):
            for axis in range(3):
                is_many = ends.counts[axis] >= RAIL_COUNT and ends.counts[axis] > RAIL_SHARE * self.rows
                if is_many and self._is_wide(ends, axis):
                    yield end, sign, ends, axis

    def _is_wide(self, ends: Lows, axis: int) -> bool:
        """Whether readings at the end of an axis that does change lie far apart along the other two."""
        others, extent = [other for other in range(3) if other != axis], self.extent
        return bool(extent[axis] > 0.0 and np.all(ends.ranges[axis, others] > RAIL_WIDTH * extent[others]))


def _hashes(readings: Floats) -> NDArray[np.uint64]:
    """(N,) hashes of 63 bits of (N, 3) readings, as of the engine (`native/quality.c`)."""
    hashes = np.zeros(len(readings), np.uint64)
    for axis in range(3):
        hashes ^= (readings[:, axis] + 0.0).view(np.uint64)  # -0 is 0
        hashes *= np.uint64(0xBF58476D1CE4E5B9)
        hashes ^= hashes >> np.uint64(29)
    hashes *= np.uint64(0x94D049BB133111EB)
    hashes ^= hashes >> np.uint64(32)
    return hashes >> np.uint64(1)


def _begins_with_zeros(hashes: NDArray[np.uint64], level: int) -> NDArray[np.bool_]:
    """Which of (K,) hashes of 63 bits begin with so many zeros."""
    return hashes < np.uint64(1 << (63 - level))


def _repeats(axes: Floats) -> int:
    """How many readings, (3, N), equal the one before."""
    same = np.flatnonzero(axes[0, 1:] == axes[0, :-1])
    return int(np.count_nonzero((axes[1:, same + 1] == axes[1:, same]).all(axis=0))) if len(same) else 0
