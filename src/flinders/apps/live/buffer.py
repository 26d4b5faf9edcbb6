"""Growing buffer of readings with bounded memory and immutable snapshots.

>>> buffer = ReadingBuffer.empty().with_rows(np.array([[0.0, 1, 2, 3, *GAP], [0.1, 4, 5, 6, *GAP]]))
>>> later = buffer.with_rows(np.array([[0.2, 7, 8, 9, *GAP]]))
>>> len(buffer), len(later), later.field[-1]                                  # the earlier buffer is unchanged
(2, 3, array([7., 8., 9.]))

The cost of appending does not depend on the length: rows go into spare capacity at the end of the array, which only the
newest snapshot may use. Up to `CAPACITY` readings stay in memory, 56 bytes each. Beyond that, every second reading is
dropped, and of later readings every second is stored: an hour at 1 kHz needs as much memory as a quarter of an hour.
The file of the session has all readings. The choice of readings depends on their count only, not on the sizes of
batches.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Samples

CAPACITY: Final = 1 << 20  # Largest number of readings in memory: 59 MB, and briefly twice that during a copy
COLUMNS: Final = 7  # Time in s, field and acceleration
GAP: Final = (np.nan, np.nan, np.nan)  # Marks a missing acceleration
INITIAL_CAPACITY: Final = 4096


def stride_for(total: int, most: int) -> int:
    """Smallest power of two by which `total` readings are thinned to at most `most`.

    >>> stride_for(40_000, 40_000), stride_for(40_001, 40_000)
    (1, 2)
    """
    parts = -(-total // most)
    return 1 << max(parts - 1, 0).bit_length()


@dataclass(frozen=True, slots=True)
class Timeline:
    """State of a timeline, in s: last time of the source's clock, last time of the session, and their difference."""

    last: float = np.nan
    shift: float = 0.0
    at: float = -np.inf

    def __call__(self, times: Floats) -> tuple[Floats, Timeline]:
        """Convert (N,) times of a source, s, to the session's timeline, which never decreases.

        After a clock was set back, the timeline continues from its last time. A reading without a time gets that of the
        reading before.

        >>> times, clock = Timeline()(np.array([1.0, 1.5, 0.0, 0.5]))
        >>> times.tolist(), clock
        ([1.0, 1.5, 1.5, 2.0], Timeline(last=0.5, shift=1.5, at=2.0))
        """
        if not len(times):
            return times, self
        first = times[0] if np.isnan(self.last) else self.last
        known = np.concatenate([[first if np.isfinite(first) else 0.0], times])
        whole = np.maximum.accumulate(np.where(np.isfinite(known), np.arange(len(known)), 0))
        known = known[whole]
        steps = np.diff(known)
        shifts = np.cumsum([self.shift, *np.where(steps < 0.0, -steps, 0.0)])[1:]
        # the maximum corrects for rounding
        moved = np.maximum.accumulate(np.concatenate([[self.at], known[1:] + shifts]))[1:]
        return moved, Timeline(float(known[-1]), float(shifts[-1]), float(moved[-1]))


@dataclass(slots=True)
class _Storage:
    """An array with spare capacity, and the number of used rows."""

    rows: Floats
    taken: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class ReadingBuffer:
    """Readings in order of arrival: of `total` readings, every `stride`-th is in memory, and at most `most`.

    Reading j in memory is reading number j · `stride` of the session.
    """

    total: int = 0
    stride: int = 1
    has_acceleration: bool = False
    most: int = CAPACITY
    _count: int = 0
    _room: _Storage = field(default_factory=lambda: _Storage(np.empty((INITIAL_CAPACITY, COLUMNS))))
    _latest: Floats = field(default_factory=lambda: np.full(COLUMNS, np.nan))

    @classmethod
    def empty(cls, most: int = CAPACITY) -> Self:
        """Return a buffer without readings, for at most `most` of them."""
        return cls(most=most)

    def with_rows(self, rows: Floats) -> ReadingBuffer:
        """Return a buffer with (N, 7) further rows: time, field, acceleration."""
        if not len(rows):
            return self
        total = self.total + len(rows)
        stride = stride_for(total, self.most)
        thinned = self._rows[:: stride // self.stride] if stride > self.stride else None
        new = rows[-self.total % stride :: stride]
        has_acceleration = self.has_acceleration or bool(np.isfinite(rows[:, 4]).any())
        count = (self._count if thinned is None else len(thinned)) + len(new)
        room = self._storage_for(thinned, len(new))
        room.rows[count - len(new) : count] = new
        room.taken = count
        return ReadingBuffer(total, stride, has_acceleration, self.most, count, room, rows[-1].copy())

    def _storage_for(self, thinned: Floats | None, more: int) -> _Storage:
        """Array for further rows: the present one if no other snapshot has used its spare capacity, else a copy."""
        rows = self._rows if thinned is None else thinned
        needed = len(rows) + more
        if thinned is None and self._room.taken == self._count and needed <= len(self._room.rows):
            return self._room
        room = _Storage(np.empty((min(max(2 * needed, INITIAL_CAPACITY), max(self.most, needed)), COLUMNS)))
        room.rows[: len(rows)] = rows
        return room

    @property
    def _rows(self) -> Floats:
        return self._room.rows[: self._count]

    def __len__(self) -> int:
        return self._count

    @property
    def time(self) -> Floats:
        """(N,) seconds, ascending."""
        return self._rows[:, 0]

    @property
    def field(self) -> Floats:
        """(N, 3) raw readings."""
        return self._rows[:, 1:4]

    @property
    def acceleration(self) -> Floats:
        """(N, 3) accelerations, NaN if missing."""
        return self._rows[:, 4:]

    @property
    def latest(self) -> Floats:
        """(7,) the newest reading, even if not in memory; NaN before the first."""
        return self._latest

    @property
    def seconds(self) -> float:
        """Time of the newest reading; 0 before the first."""
        return 0.0 if not self.total else float(self._latest[0])

    def after(self, seconds: float) -> ReadingBuffer:
        """Return a buffer of the readings after a time."""
        return ReadingBuffer.empty(self.most).with_rows(self._rows[self.time > seconds])

    def rows(self, start: int, most: int) -> Floats:
        """(N, 7) at most `most` readings in memory, from number `start` on."""
        return self._rows[start : start + most]


def rows_of(samples: Samples, axes: Axes | None = None) -> Floats:
    """Convert samples to (N, 7) rows of a buffer, turned as by `Samples.turned`; without times, one reading a second.

    >>> from flinders.core.axes import Axes
    >>> from flinders.core.samples import Samples
    >>> rows_of(Samples.of([[1, 2, 3]], time=[0.5]), Axes.of("x,-y,-z"))[0, :4]
    array([ 0.5,  1. , -2. , -3. ])
    """
    rows = np.full((len(samples), COLUMNS), np.nan)
    rows[:, 0] = np.arange(len(samples)) if samples.time is None else samples.time
    rows[:, 1:4] = samples.field
    if samples.acceleration is not None:
        rows[:, 4:] = samples.acceleration
    if axes is not None and not axes.is_identity:
        rows[:, 1:4] = axes.apply(rows[:, 1:4])
        rows[:, 4:] = rows[:, 4:] if axes.is_mirror else axes.apply(rows[:, 4:])
    return rows
