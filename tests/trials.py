"""How often a claim is tried: a few times in every run, hundreds of times by ``pytest -m claims``.

The same for the examples of a law: `examples`, all of them by ``pytest --hypothesis-profile=full``.

A bound that holds for the mean of all trials is √(all / few) times as wide for the mean of a few, which is `widening`:
a smoke test of few trials still fails where the claim is wrong by more than that.

>>> few = Trials.choose(False, 400, 25)
>>> few.count, few.widening
(25, 4.0)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from _pytest.mark import ParameterSet


@dataclass(frozen=True)
class Trials:
    """Number of trials of a statistical claim.

    Attributes
    ----------
    count : int
    widening : float
        How much wider the bounds of all trials are made for these: 1 for all.
    """

    count: int
    widening: float

    @classmethod
    def choose(cls, is_complete: bool, complete: int, smoke: int) -> Trials:
        count = complete if is_complete else smoke
        return cls(count, math.sqrt(complete / count))

    @property
    def seeds(self) -> range:
        """One seed a trial."""
        return range(self.count)

    def ratios(self, low: float, high: float) -> tuple[float, float]:
        """Bounds of a ratio, of which all trials keep ``low < ratio < high``."""
        return low**self.widening, high**self.widening


Choose: TypeAlias = Callable[[int, int], Trials]


def examples(complete: int) -> settings:
    """Settings of a law: so many examples under ``--hypothesis-profile=full``, else one in ten, at least three."""
    return settings(max_examples=max(min(3, complete), complete * settings().max_examples // 100))


def nightly(*values: object) -> ParameterSet:
    """A case of a parametrised test that only a night runs, because others go the same path."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def daily(cases: Collection[object], every: int | None = None) -> list[ParameterSet]:
    """Cases of one path: every run takes the first and then each `every`-th, a night takes the others too.

    A tuple holds the values of a case.

    >>> [len(case.marks) for case in daily(["bag", "mcap", ("db3", 3), "zip"], 2)]
    [0, 1, 0, 1]
    """
    sets = [case if isinstance(case, tuple) else (case,) for case in cases]
    step = every or len(sets)
    return [pytest.param(*values) if place % step == 0 else nightly(*values) for place, values in enumerate(sets)]
