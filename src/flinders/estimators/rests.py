"""Rests: intervals in which the direction stands still, each of which is one reading of a fit, or none.

However often it is read, one place tells of the surface what one reading tells, with what the field differs by from
place to place. Fifteen seconds on a table where the field is off by 3 % would otherwise outweigh the turn before them.
Where readings of a turn are twenty times as many as rests, these are left out: they would only speak of directions
that the turn did not see. The engine finds rests (``flinders_rests``), and a fit by it alone does this itself.

>>> poses = np.random.default_rng(1).normal(size=(12, 3))
>>> poses *= 50.0 / np.linalg.norm(poses, axis=1, keepdims=True)
>>> samples = Samples(np.repeat(poses, 10, axis=0), time=np.arange(120.0))
>>> rests = Rests.of(samples)
>>> len(rests), rests.bounds[0], rests.are_left_out
(12, array([ 0, 10]), False)
>>> fitted = rests.fitted(samples)
>>> len(fitted), fitted.time[:2]
(12, array([ 4.5, 14.5]))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.samples import COLUMNS, Samples
from flinders.native.engine import engine
from flinders.summary.summary import RestSpan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

OF_THE_MIDDLE: Final = frozenset({"time", "attitude"})
"""Columns that have no mean: of a rest the value in its middle counts."""


@dataclass(frozen=True, eq=False)
class Rests:
    """The rests of a recording in memory.

    Attributes
    ----------
    bounds : (R, 2) int
        First row of each rest, and the row behind its last.
    are_left_out : bool
        A fit leaves them out; else each is one reading of it, its mean.
    rows : int
        Readings of the recording.
    time : (N,) float, s, optional
        Of these.
    """

    bounds: NDArray[np.int64]
    are_left_out: bool
    rows: int
    time: Floats | None = None

    @classmethod
    def of(cls, samples: Samples, ends: NDArray[np.int64] | None = None) -> Self:
        """Those of a recording, or of several: `ends` (P,) of these."""
        return cls(*engine().rests(samples.field, ends=ends), len(samples), samples.time)

    def __len__(self) -> int:
        return len(self.bounds)

    @property
    def at_rest(self) -> int:
        """Readings at rest."""
        return int(np.diff(self.bounds, axis=1).sum())

    @cached_property
    def begins(self) -> NDArray[np.bool_]:
        """(N,) rows of the recording at which a reading of a fit begins."""
        begins = np.ones(self.rows, dtype=bool)
        for begin, end in self.bounds.tolist():
            begins[begin if self.are_left_out else begin + 1 : end] = False
        return begins

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """(M,) these rows."""
        return np.flatnonzero(self.begins)

    @cached_property
    def last(self) -> NDArray[np.intp]:
        """(M,) row of the recording at which it ends."""
        if self.are_left_out:
            return self.first
        return np.append(self.first[1:], self.rows) - 1

    @property
    def spans(self) -> tuple[RestSpan, ...]:
        """First and last reading of each rest, counted from 1, and their times."""
        return tuple(
            RestSpan(begin + 1, end, *((np.nan, np.nan) if self.time is None else self.time[[begin, end - 1]].tolist()))
            for begin, end in self.bounds.tolist()
        )

    def fitted(self, samples: Samples) -> Samples:
        """The readings of the recording that a fit goes by."""
        if self.are_left_out:
            return samples[self.begins]
        there = {name: values for name in COLUMNS if (values := getattr(samples, name)) is not None}
        columns: dict[str, Any] = {name: self._averaged(name, values) for name, values in there.items()}
        return replace(samples, auxiliary={}, **columns)

    def _averaged(self, name: str, values: Floats) -> Floats:
        """One column: means of those values that are there."""
        if name in OF_THE_MIDDLE:
            lower, upper = values[self.first], values[self.last]
            return (lower + upper) / 2.0 if name == "time" else values[(self.first + self.last) // 2]
        is_there = np.isfinite(values)
        total = np.add.reduceat(np.where(is_there, values, 0.0), self.first)
        with np.errstate(invalid="ignore"):
            mean: Floats = total / np.add.reduceat(is_there, self.first, dtype=float)
        return mean
