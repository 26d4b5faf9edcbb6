"""What `flinders merge` prints, to the letter."""

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
def calibrations() -> None:
    """Three calibrations of a sensor, and one after its battery moved."""
    moved = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + np.array([3, 0, 0]))
    for seed, (name, sensor) in enumerate(
        (("monday", TUMBLED_SENSOR), ("tuesday", TUMBLED_SENSOR), ("friday", TUMBLED_SENSOR), ("moved", moved)), 3
    ):
        field = simulate.tumble(seed=seed, motion="uniform", sensor=sensor).samples.field
        write_field(f"{name}.csv", field)
        assert CliRunner().invoke(main, ["calibrate", f"{name}.csv", "-o", f"{name}.json"]).exit_code == 0


def test_three_that_belong_together_and_one_that_does_not(golden: Golden) -> None:
    lines = (
        "flinders merge monday.json tuesday.json friday.json -o merged.json",
        "flinders merge monday.json tuesday.json moved.json -o other.json",
    )
    golden("cli/merge.txt", session(*lines, code=4))
