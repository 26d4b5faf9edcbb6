"""Readings that grow: immutable snapshots of one array of columns, bounded in memory.

>>> buffer = ReadingBuffer.empty().extended(np.array([[0.0, 1, 2, 3, *GAP], [0.1, 4, 5, 6, *GAP]]))
>>> later = buffer.extended(np.array([[0.2, 7, 8, 9, *GAP]]))
>>> len(buffer), len(later), later.field[-1]                                  # the earlier one is as it was
(2, 3, array([7., 8., 9.]))

Appending costs the same at any length: rows go into spare room at the end of the array, which only the newest state may
use. Up to `CAPACITY` readings stay in memory, 56 bytes each. Beyond that every second one is dropped, and of those that
follow every second one is taken: an hour at 1 kHz takes as much memory as a quarter of it. The file is complete.
Which readings stay depends on their count only, not on how they arrived.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Samples

CAPACITY: Final = 1 << 20  # Readings in memory, at most: 59 MB, and as much again for a moment while they are moved
COLUMNS: Final = 7  # Time in s, field and acceleration
GAP: Final = (np.nan, np.nan, np.nan)  # What stands for an acceleration that is not there
FIRST_ROOM: Final = 4096


def stride_for(total: int, most: int) -> int:
    """The smallest power of two such that of `total` readings, counted from the first, no more than `most` are taken.

    >>> stride_for(40_000, 40_000), stride_for(40_001, 40_000)
    (1, 2)
    """
    parts = -(-total // most)
    return 1 << max(parts - 1, 0).bit_length()


@dataclass(frozen=True, slots=True)
class Timeline:
    """Where a timeline has got to: the source's clock `last` read, the session's time `at`, the shift between them."""

    last: float = np.nan
    shift: float = 0.0
    at: float = -np.inf

    def __call__(self, times: Floats) -> tuple[Floats, Timeline]:
        """Put (N,) times of a source onto the session's timeline, which never goes back.

        A clock that was set back goes on from where it was; a time that is not there is that of the reading before.

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
        moved = np.maximum.accumulate(np.concatenate([[self.at], known[1:] + shifts]))[1:]  # despite rounding
        return moved, Timeline(float(known[-1]), float(shifts[-1]), float(moved[-1]))


@dataclass(slots=True)
class _Room:
    """An array with room at its end, and how much of it is taken."""

    rows: Floats
    taken: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class ReadingBuffer:
    """Readings in the order in which they came: of `total`, one of `stride` is in memory, and at most `most` are.

    Reading j in memory is reading number j · `stride`.
    """

    total: int = 0
    stride: int = 1
    has_acceleration: bool = False
    most: int = CAPACITY
    _count: int = 0
    _room: _Room = field(default_factory=lambda: _Room(np.empty((FIRST_ROOM, COLUMNS))))
    _latest: Floats = field(default_factory=lambda: np.full(COLUMNS, np.nan))

    @classmethod
    def empty(cls, most: int = CAPACITY) -> Self:
        """No readings."""
        return cls(most=most)

    def extended(self, rows: Floats) -> ReadingBuffer:
        """With (N, 7) rows more: time, field, acceleration."""
        if not len(rows):
            return self
        total = self.total + len(rows)
        stride = stride_for(total, self.most)
        thinned = self._rows[:: stride // self.stride] if stride > self.stride else None
        new = rows[-self.total % stride :: stride]
        has_acceleration = self.has_acceleration or bool(np.isfinite(rows[:, 4]).any())
        count = (self._count if thinned is None else len(thinned)) + len(new)
        room = self._room_for(thinned, len(new))
        room.rows[count - len(new) : count] = new
        room.taken = count
        return ReadingBuffer(total, stride, has_acceleration, self.most, count, room, rows[-1].copy())

    def _room_for(self, thinned: Floats | None, more: int) -> _Room:
        """The array to write into: the same where it has room and nobody else has gone on from here."""
        rows = self._rows if thinned is None else thinned
        needed = len(rows) + more
        if thinned is None and self._room.taken == self._count and needed <= len(self._room.rows):
            return self._room
        room = _Room(np.empty((min(max(2 * needed, FIRST_ROOM), max(self.most, needed)), COLUMNS)))
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
        """(N, 3) accelerations, NaN where there is none."""
        return self._rows[:, 4:]

    @property
    def latest(self) -> Floats:
        """(7,) the newest reading, also where it is not in memory; NaN before the first."""
        return self._latest

    @property
    def seconds(self) -> float:
        """Time of the newest reading; 0 before the first."""
        return 0.0 if not self.total else float(self._latest[0])

    def after(self, seconds: float) -> ReadingBuffer:
        """The readings later than a time, as a buffer of their own."""
        return ReadingBuffer.empty(self.most).extended(self._rows[self.time > seconds])

    def rows(self, start: int, most: int) -> Floats:
        """(N, 7) at most so many of the readings in memory, from number `start` on."""
        return self._rows[start : start + most]


def rows_of(samples: Samples, axes: Axes | None = None) -> Floats:
    """(N, 7) samples as rows of a buffer, turned as `Samples.turned` does; without times, a reading counts a second.

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
