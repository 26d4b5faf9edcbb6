"""Numbers that recipes and the two-axis simulation write, in a reviewed table: ``tests/golden/files/recipes.json``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from tests.golden.numbers import assert_numbers, flinders, lines, record

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

DECIMAL: Final = re.compile(r"-?\d+\.\d+(e-?\d+)?")


def swing() -> object:
    flinders("simulate two-axis -o swing.csv")
    return lines("swing.csv")


def rose() -> object:
    flinders("simulate two-axis -o swing.csv --polar rose.csv")
    return lines("rose.csv")


def convergence() -> object:
    """Every seventh step and the last, to four digits."""
    record("tumble.csv", simulate.tumble(seed=2, motion="hand", n=1000))
    flinders("calibrate tumble.csv --method ekf --convergence steps.csv")
    header, *steps = (DECIMAL.sub(lambda number: f"{float(number[0]):.4g}", line) for line in lines("steps.csv"))
    return [header, *steps[::7], steps[-1]]


ROWS: Final[dict[str, Callable[[], object]]] = {
    "simulate two-axis, recording": swing,
    "simulate two-axis, rose": rose,
    "calibrate --convergence, ekf": convergence,
}


def test_numbers_are_those_of_the_table(request: pytest.FixtureRequest) -> None:
    assert_numbers("recipes.json", ROWS, request)
