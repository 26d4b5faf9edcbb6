"""Number of trials of a claim: a few in every run, hundreds with ``pytest -m claims``.

`examples` does the same for the examples of a law; ``pytest --hypothesis-profile=full`` runs all of them.

A bound for the mean of all trials must be √(all / few) times as wide for the mean of a few trials, which is `widening`.
A smoke test with few trials still fails if the claim is wrong by more than that.

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
        Factor by which bounds are wider than for all trials; 1 for all trials.
    """

    count: int
    widening: float

    @classmethod
    def choose(cls, is_complete: bool, complete: int, smoke: int) -> Trials:
        count = complete if is_complete else smoke
        return cls(count, math.sqrt(complete / count))

    @property
    def seeds(self) -> range:
        """One seed for each trial."""
        return range(self.count)

    def ratios(self, low: float, high: float) -> tuple[float, float]:
        """Bounds of a ratio; for all trials they are ``low`` and ``high``."""
        return low**self.widening, high**self.widening


Choose: TypeAlias = Callable[[int, int], Trials]


def examples(complete: int) -> settings:
    """Settings of a law: all examples with ``--hypothesis-profile=full``, else one in ten and at least three."""
    return settings(max_examples=max(min(3, complete), complete * settings().max_examples // 100))


def nightly(*values: object) -> ParameterSet:
    """A case of a parametrised test that only nightly runs include, since other cases take the same path."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def daily(cases: Collection[object], every: int | None = None) -> list[ParameterSet]:
    """Cases that take the same path: every run includes the first and then each `every`-th, nightly runs include all.

    A case can be a tuple of values.

    >>> [len(case.marks) for case in daily(["bag", "mcap", ("db3", 3), "zip"], 2)]
    [0, 1, 0, 1]
    """
    sets = [case if isinstance(case, tuple) else (case,) for case in cases]
    step = every or len(sets)
    return [pytest.param(*values) if place % step == 0 else nightly(*values) for place, values in enumerate(sets)]
