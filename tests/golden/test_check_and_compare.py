"""What `flinders check` and `flinders compare` print, to the letter."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.golden.sessions import session
from tests.worlds import TUMBLED_SENSOR, write_field

from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def recordings() -> None:
    """Recordings of a sensor, one after its offset moved by 5 µT, one tilted by 35° at most; calibrations of two."""
    moved = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + np.array([5, 0, 0]))
    for seed, (name, sensor) in enumerate(
        (("monday", TUMBLED_SENSOR), ("tuesday", TUMBLED_SENSOR), ("moved", moved)), 3
    ):
        field = simulate.tumble(seed=seed, motion="uniform", sensor=sensor).samples.field
        write_field(f"{name}.csv", field)
    field = simulate.tumble(seed=6, motion="tilted", sensor=TUMBLED_SENSOR).samples.field
    write_field("deck.csv", field)
    for name in ("monday", "tuesday"):
        assert CliRunner().invoke(main, ["calibrate", f"{name}.csv", "-o", f"{name}.json"]).exit_code == 0


def test_a_calibration_that_holds_and_one_that_fails(golden: Golden) -> None:
    lines = "flinders check monday.json tuesday.csv", "flinders check monday.json moved.csv"
    golden("cli/check.txt", session(*lines, code=4))


def test_a_calibration_of_which_a_recording_cannot_tell(golden: Golden) -> None:
    golden("cli/check-cannot-tell.txt", session("flinders check monday.json deck.csv", code=3))


def test_two_calibrations(golden: Golden) -> None:
    golden("cli/compare.txt", session("flinders compare monday.json tuesday.json"))
