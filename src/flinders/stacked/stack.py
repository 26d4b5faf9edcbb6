"""Readings of many units, side by side.

>>> from flinders.core.samples import Samples
>>> stack = Stack.of([Samples.of(np.ones((4, 3))), Samples.of(np.ones((2, 3)))])
>>> stack, stack.counts
(Stack(2 units of up to 4 readings), array([4, 2]))
>>> len(stack[1])
2
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from flinders.arrays import column, floats
from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import ArrayError, UnitError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """Readings of U units in one unit and set of axes.

    Attributes
    ----------
    readings : (U, 3, N) float, in `unit.inside`
        x, y and z of the readings of each, filled up with its first reading; an array of any library that keeps the
        array API standard.
    counts : (U,) int
        How many each has.
    unit : Unit
    axes : Axes
    time : (U, N) float, s, optional
        NaN where there is no reading.
    """

    readings: Any
    counts: NDArray[np.int64]
    unit: Unit = field(default_factory=Unit.of)
    axes: Axes = field(default_factory=Axes)
    time: Floats | None = None

    @classmethod
    def of(cls, units: Sequence[Samples]) -> Self:
        """Stack recordings; those of unlike lengths are filled up.

        Raises
        ------
        ArrayError
            For none, or an empty one.
        UnitError
            For readings in unlike units.
        """
        counts = np.array([len(one) for one in units], dtype=np.int64)
        if not len(units) or not counts.all():
            raise ArrayError(
                f"{len(units)} units, {int(np.count_nonzero(counts == 0))} without readings: need some of each"
            )
        inside = {one.unit.inside for one in units}
        if len(inside) > 1:
            raise UnitError(f"units are in {' and '.join(sorted(inside))}: stack those that are in one unit")
        longest = int(counts.max())
        if (counts == longest).all():
            readings = np.ascontiguousarray(np.stack([one.field for one in units]).swapaxes(1, 2))
        else:
            readings = np.empty((len(units), 3, longest))
            for rows, one in zip(readings, units, strict=True):
                rows[:, : len(one)] = one.field.T
                rows[:, len(one) :] = one.field[0][:, np.newaxis]
        return cls(readings, counts, units[0].unit, units[0].axes, _times(units, longest))

    @classmethod
    def cut(
        cls,
        field: ArrayLike,
        counts: ArrayLike,
        *,
        time: ArrayLike | None = None,
        unit: Unit | None = None,
        axes: Axes | None = None,
    ) -> Self:
        """Cut the rows of a table, in the order of their units.

        Parameters
        ----------
        field : (M, 3) array-like
            Readings of all units, one after the other, in `unit.inside`.
        counts : (U,) array-like of int
            Rows of each unit.
        time : (M,) array-like, s, optional
        unit, axes : Unit, Axes, optional

        Raises
        ------
        ArrayError
            For shapes that do not go together.

        Examples
        --------
        >>> Stack.cut(np.zeros((6, 3)), [2, 4])
        Stack(2 units of up to 4 readings)
        """
        rows, many = floats(field, "field"), np.asarray(counts, np.int64)
        if rows.shape != (int(many.sum()), 3) or not len(many) or many.min() < 1:
            raise ArrayError(
                f"field has shape {rows.shape}, counts add up to {int(many.sum())}: need one row a reading"
            )
        longest = int(many.max())
        ends = np.cumsum(many)[:, np.newaxis]
        place = np.arange(longest)
        at = np.where(place < many[:, np.newaxis], ends - many[:, np.newaxis] + place, ends - many[:, np.newaxis])
        readings = np.ascontiguousarray(
            (rows.reshape(-1, longest, 3) if at.size == len(rows) else rows[at]).swapaxes(1, 2)
        )
        when = None
        if time is not None:
            when = np.where(place < many[:, np.newaxis], column(time, len(rows), "time")[at], np.nan)
        return cls(readings, many, unit or Unit.of(), axes or Axes(), when)

    def __len__(self) -> int:
        return len(self.counts)

    def __getitem__(self, place: int) -> Samples:
        """One of them, as a recording."""
        count = int(self.counts[place])
        readings = np.asarray(self.readings[place, :, :count]).T
        time = None if self.time is None else self.time[place, :count]
        return Samples(readings.copy(), unit=self.unit, axes=self.axes, time=time)

    def __repr__(self) -> str:
        return f"Stack({len(self)} units of up to {self.readings.shape[2]} readings)"

    @property
    def inside(self) -> Floats | None:
        """(U, N) float: 1 for readings, 0 for what fills rows up; None where all have as many."""
        many = self.readings.shape[2]
        if bool((self.counts == many).all()):
            return None
        return (np.arange(many) < self.counts[:, np.newaxis]).astype(float)

    @property
    def steps(self) -> Floats | None:
        """(U, 3) steps back in time, longest and usual step in s; None without time."""
        if self.time is None:
            return None
        steps = np.diff(self.time, axis=1)
        least = steps.min(axis=1, initial=np.inf)
        if not np.isnan(least).any():
            back = np.count_nonzero(steps < 0.0, axis=1) if (least < 0.0).any() else np.zeros(len(steps))
            return np.stack([back, steps.max(axis=1, initial=0.0), steps.sum(axis=1) / max(steps.shape[1], 1)], axis=1)
        there = ~np.isnan(steps)
        total = np.where(there, steps, 0.0).sum(axis=1)
        back = np.count_nonzero(np.where(there, steps, 0.0) < 0.0, axis=1)
        longest = np.where(there, steps, 0.0).max(axis=1, initial=0.0)
        return np.stack([back, longest, total / np.maximum(there.sum(axis=1), 1)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Lined:
    """Recordings that lie one after the other in the same columns, as in a table of a fleet.

    A sequence of `Samples`, of which each is made when it is asked for.

    Attributes
    ----------
    whole : Samples
        The readings of all.
    ends : (U,) int
        Where those of each end.
    sources : sequence of str
        Where each came from, for messages.

    Examples
    --------
    >>> lined = Lined(Samples.of(np.arange(18.0).reshape(6, 3)), np.array([2, 6]), ["A17", "B02"])
    >>> lined[1].source, len(lined[1]), lined.stack(np.array([0, 1]))
    ('B02', 4, Stack(2 units of up to 4 readings))
    """

    whole: Samples
    ends: NDArray[np.int64]
    sources: Sequence[str]

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, place: int) -> Samples:
        """One of them."""
        begin = int(self.ends[place - 1]) if place else 0
        return replace(self.whole[begin : int(self.ends[place])], source=self.sources[place])

    def __iter__(self) -> Iterator[Samples]:
        return (self[place] for place in range(len(self)))

    @property
    def counts(self) -> NDArray[np.int64]:
        """(U,) how many readings each has."""
        return np.diff(self.ends, prepend=0)

    def stack(self, places: NDArray[np.intp]) -> Stack:
        """Those at (K,) places, none of them empty; without a copy where all are alike and follow each other."""
        counts = self.counts[places]
        begins, longest = self.ends[places] - counts, int(counts.max())
        field, time = self.whole.field.T, self.whole.time
        if (np.diff(begins, append=begins[-1] + longest) == longest).all() and counts[-1] == longest:
            cut = slice(int(begins[0]), int(begins[0]) + longest * len(places))
            readings = np.ascontiguousarray(field[:, cut]).reshape(3, -1, longest)
            when = None if time is None else time[cut].reshape(-1, longest)
        else:
            place = np.arange(longest)
            there = place < counts[:, np.newaxis]
            at = begins[:, np.newaxis] + np.where(there, place, 0)
            readings = np.take(field, at, axis=1)
            when = None if time is None else np.where(there, time[at], np.nan)
        return Stack(readings.swapaxes(0, 1), counts, self.whole.unit, self.whole.axes, when)


def _times(units: Sequence[Samples], longest: int) -> Floats | None:
    """(U, N) times, NaN where there are none; None where no unit has any."""
    if all(one.time is None for one in units):
        return None
    time = np.full((len(units), longest), np.nan)
    for rows, one in zip(time, units, strict=True):
        if one.time is not None:
            rows[: len(one)] = one.time
    return time
