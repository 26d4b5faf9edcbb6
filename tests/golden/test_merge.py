"""What `flinders merge` prints, to the letter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.golden.sessions import session
from tests.worlds import TUMBLED_SENSOR

from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def calibrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three calibrations of a sensor, and one after its battery moved."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    moved = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + np.array([3, 0, 0]))
    for seed, (name, sensor) in enumerate(
        (("monday", TUMBLED_SENSOR), ("tuesday", TUMBLED_SENSOR), ("friday", TUMBLED_SENSOR), ("moved", moved)), 3
    ):
        field = simulate.tumble(seed=seed, motion="uniform", sensor=sensor).samples.field
        rows = [",".join(f"{value:.3f}" for value in row) for row in field]
        Path(f"{name}.csv").write_text("\n".join(["mag_x_uT,mag_y_uT,mag_z_uT", *rows, ""]), encoding="utf-8")
        assert CliRunner().invoke(main, ["calibrate", f"{name}.csv", "-o", f"{name}.json"]).exit_code == 0


def test_three_that_belong_together_and_one_that_does_not(golden: Golden) -> None:
    lines = (
        "flinders merge monday.json tuesday.json friday.json -o merged.json",
        "flinders merge monday.json tuesday.json moved.json -o other.json",
    )
    golden("cli/merge.txt", session(*lines, code=4))


def test_help(golden: Golden) -> None:
    golden("cli/flinders-merge-help.txt", session("flinders merge --help"))
