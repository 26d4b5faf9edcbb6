"""The half-turn test of ``flinders swing``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.findings.test_what_is_known import run

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rested(offset: tuple[float, float], headings: tuple[int, ...] = (0, 180, 90, 270)) -> str:
    """Write readings of a level sensor that rests for six seconds on each heading, with its hard iron."""
    rng = np.random.default_rng(1)
    angle = np.radians(np.repeat(headings, 300)) + rng.normal(0.0, 0.002, 300 * len(headings))
    field = np.stack(
        [25 * np.cos(angle) + offset[0], -25 * np.sin(angle) + offset[1], np.full(len(angle), 43.0)], axis=1
    )
    header = "t_s,mx_uT,my_uT,mz_uT"
    rows = np.column_stack([np.arange(len(angle)) / 50, field + rng.normal(0.0, 0.1, field.shape)])
    np.savetxt("rested.csv", rows, "%.4f", ",", header=header, comments="")
    return "rested.csv"


def test_the_half_turn_test_takes_a_recording_as_it_is() -> None:
    good = json.loads(run(f"swing {rested((0.0, 0.0))} --level --json").stdout)
    assert good["half_turns_pass"] is True
    assert len(good["half_turns"]) == 2
    bad = json.loads(run(f"swing {rested((2.0, 1.0))} --level --json", 4).stdout)
    b, c = (np.degrees(shift / 25.0) for shift in (2.0, 1.0))  # small angles
    assert bad["hard_iron_deg"]["B"] == pytest.approx(b, abs=0.2)
    assert bad["hard_iron_deg"]["C"] == pytest.approx(c, abs=0.2)
    assert "suit the calibration" not in run(f"swing {rested((2.0, 1.0))} --level", 4).stderr


def test_the_half_turn_test_takes_the_headings_of_a_table() -> None:
    magnetic = np.arange(0.0, 360.0, 45.0)
    compass = magnetic - 2.0 * np.sin(np.radians(magnetic)) - 3.0 * np.cos(np.radians(magnetic))
    rows = np.column_stack([compass, magnetic])
    np.savetxt("swing.csv", rows, "%.3f", ",", header="compass,magnetic", comments="")
    swing = json.loads(run("swing swing.csv --json", 0).stdout)
    assert len(swing["half_turns"]) == 4
    north = swing["half_turns"][0]
    assert north["error_deg"] == pytest.approx(6.0, abs=0.01)
    assert swing["half_turns_pass"] is False
