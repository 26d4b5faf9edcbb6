"""Rests: intervals in which the direction stands still, each of which is one reading of a fit.

However often it is read, one place tells of the surface what one reading tells, with what the field differs by from
place to place. Fifteen seconds on a table where the field is off by 3 % would otherwise outweigh the turn before them.
The engine finds rests (``flinders_rests``), and a fit by it alone averages them itself.

>>> turn = np.random.default_rng(1).normal(size=(100, 3))
>>> turn *= 50.0 / np.linalg.norm(turn, axis=1, keepdims=True)
>>> samples = Samples(np.concatenate([turn, np.tile([51.5, 0.0, 0.0], (200, 1))]), time=np.arange(300.0))
>>> rests = Rests.of(samples)
>>> rests.bounds, rests.rows, rests.count
(array([[100, 300]]), 300, 101)
>>> averaged = rests.averaged(samples)
>>> averaged.field[-1], averaged.time[-1]
(array([51.5,  0. ,  0. ]), 199.5)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.samples import COLUMNS, Samples
from flinders.native.engine import engine

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
    rows : int
        Readings of the recording.
    time : (N,) float, s, optional
        Of these.
    """

    bounds: NDArray[np.int64]
    rows: int
    time: Floats | None = None

    @classmethod
    def of(cls, samples: Samples, ends: NDArray[np.int64] | None = None) -> Self:
        """Those of a recording, or of several: `ends` (P,) of these."""
        return cls(engine().rests(samples.field, ends=ends), len(samples), samples.time)

    def __len__(self) -> int:
        return len(self.bounds)

    @property
    def at_rest(self) -> int:
        """Readings at rest."""
        return int(np.diff(self.bounds, axis=1).sum())

    @property
    def count(self) -> int:
        """Readings with each rest as one."""
        return len(self.first)

    @cached_property
    def first(self) -> NDArray[np.intp]:
        """(M,) row of the recording at which each reading begins, with each rest as one."""
        begins = np.ones(self.rows, dtype=bool)
        for begin, end in self.bounds.tolist():
            begins[begin + 1 : end] = False
        return np.flatnonzero(begins)

    @cached_property
    def last(self) -> NDArray[np.intp]:
        """(M,) row of the recording at which each reading ends."""
        return np.append(self.first[1:], self.rows) - 1

    def averaged(self, samples: Samples) -> Samples:
        """The recording with each rest as one reading."""
        there = {name: values for name in COLUMNS if (values := getattr(samples, name)) is not None}
        columns: dict[str, Any] = {name: self._averaged(name, values) for name, values in there.items()}
        return replace(samples, **columns)

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
