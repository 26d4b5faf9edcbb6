"""Numbers that the program writes, in one reviewed table: ``tests/golden/files/numbers.json``.

A row is a JSON document or the lines of a CSV file, rounded where machines differ. `ROWS` says what makes each.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.golden.numbers import assert_numbers, flinders, lines, record
from tests.golden.sessions import rounded

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

EVERYTHING: Final = (
    "simulate three-axis -o rough.csv --motion flight --readings 60 --rate 10 --tilt 20 --noise 0.3 --resolution 0.15 "
    "--saturation 90 --outliers 0.1 --stationary 0.2 --motor 0.2 --drift 0.1 --step 3 --magnet 100 "
    "--gyro-bias 0.01,0,-0.02 --soft-iron 0.1 --hard-iron 40 --field-strength 48 --dip 65 --seed 3"
)
"""A recording with every disturbance that can be simulated."""


def demo() -> object:
    return rounded(json.loads(flinders("demo --json", 0, 3)))


def comparison() -> object:
    sensor = simulate.tumble(seed=2, motion="uniform").sensor
    for name, seed in (("monday", 3), ("tuesday", 4)):
        record(f"{name}.csv", simulate.tumble(seed=seed, motion="uniform", sensor=sensor))
        flinders(f"calibrate {name}.csv -o {name}.json", 0, 3)
    return rounded(json.loads(flinders("compare monday.json tuesday.json --json", 0, 4)))


def evaluation() -> object:
    """Names of the numbers; `test_evaluation` asks for what they are."""
    flinders("simulate three-axis -o tumble.csv --seed 7")
    flinders("calibrate tumble.csv -o calibration.json", 0, 3)
    return list(json.loads(flinders("evaluate calibration.json tumble.truth.json --json")))


def recording() -> object:
    flinders(EVERYTHING)
    return lines("rough.csv")


def truth() -> object:
    flinders(EVERYTHING)
    found = json.loads(Path("rough.truth.json").read_text(encoding="utf-8"))
    return rounded({**found, "version": "1.2.3"})


ROWS: Final[dict[str, Callable[[], object]]] = {
    "demo --json": demo,
    "compare --json": comparison,
    "evaluate --json, names": evaluation,
    "simulate three-axis, recording": recording,
    "simulate three-axis, truth": truth,
}


def test_numbers_are_those_of_the_table(request: pytest.FixtureRequest) -> None:
    assert_numbers("numbers.json", ROWS, request)
