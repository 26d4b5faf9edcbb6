"""Rests: intervals of constant direction, each of which counts as one reading in a fit, or is left out.

All readings of a rest together have the information of one reading, because the field differs from place to place.
Counted one by one, the readings of fifteen seconds on a table, where the field differs by 3 %, would outweigh the turn
before. If there are twenty times as many readings of turns as rests, the rests are left out, because they matter only
in directions without other readings. The engine finds rests (``flinders_rests``).

>>> poses = np.random.default_rng(1).normal(size=(12, 3))
>>> poses *= 50.0 / np.linalg.norm(poses, axis=1, keepdims=True)
>>> samples = Samples(np.repeat(poses, 10, axis=0), time=np.arange(120.0))
>>> rests = Rests.of(samples)
>>> len(rests), rests.bounds[0], rests.are_left_out
(12, array([ 0, 10]), False)
>>> averaged = rests.average(samples)
>>> len(averaged), averaged.time[:2]
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

MIDDLE_COLUMNS: Final = frozenset({"time", "attitude"})
"""Columns that cannot be averaged; for a rest the value at its middle is used."""


@dataclass(frozen=True, eq=False)
class Rests:
    """The rests of a recording in memory.

    Attributes
    ----------
    bounds : (R, 2) int
        First row of each rest, and the row after its last.
    are_left_out : bool
        Whether a fit leaves rests out; otherwise each rest is one reading, its mean.
    rows : int
        Number N of readings in the recording.
    time : (N,) float, s, optional
        Times of the readings.
    """

    bounds: NDArray[np.int64]
    are_left_out: bool
    rows: int
    time: Floats | None = None

    @classmethod
    def of(cls, samples: Samples, ends: NDArray[np.int64] | None = None) -> Self:
        """Find the rests of a recording; `ends`: (P,) row after the end of each of several joined recordings."""
        return cls(*engine().rests(samples.field, ends=ends), len(samples), samples.time)

    def __len__(self) -> int:
        return len(self.bounds)

    @property
    def at_rest(self) -> int:
        """Number of readings at rest."""
        return int(np.diff(self.bounds, axis=1).sum())

    @cached_property
    def begins(self) -> NDArray[np.bool_]:
        """(N,) whether each row of the recording is the first row of a reading in the fit."""
        begins = np.ones(self.rows, dtype=bool)
        for begin, end in self.bounds.tolist():
            begins[begin if self.are_left_out else begin + 1 : end] = False
        return begins

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """(M,) first row of each reading in the fit."""
        return np.flatnonzero(self.begins)

    @cached_property
    def last(self) -> NDArray[np.intp]:
        """(M,) last row of each reading in the fit."""
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

    def average(self, samples: Samples) -> Samples:
        """Samples for a fit, in which each rest is one reading or none."""
        if self.are_left_out:
            return samples[self.begins]
        there = {name: values for name in COLUMNS if (values := getattr(samples, name)) is not None}
        columns: dict[str, Any] = {name: self._average(name, values) for name, values in there.items()}
        return replace(samples, auxiliary={}, **columns)

    def _average(self, name: str, values: Floats) -> Floats:
        """Average a column over each reading in the fit, without NaN."""
        if name in MIDDLE_COLUMNS:
            lower, upper = values[self.first], values[self.last]
            return (lower + upper) / 2.0 if name == "time" else values[(self.first + self.last) // 2]
        is_there = np.isfinite(values)
        total = np.add.reduceat(np.where(is_there, values, 0.0), self.first)
        with np.errstate(invalid="ignore"):
            mean: Floats = total / np.add.reduceat(is_there, self.first, dtype=float)
        return mean
