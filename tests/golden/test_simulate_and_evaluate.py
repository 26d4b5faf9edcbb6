"""What `flinders simulate` writes and `flinders evaluate` prints, to the letter."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner
from tests.golden.sessions import rounded, session

from flinders.cli import main

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def page_of_80_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", ["simulate", "simulate three-axis", "simulate two-axis", "evaluate"])
def test_help(command: str, golden: Golden) -> None:
    golden(f"cli/flinders-{command.replace(' ', '-')}-help.txt", session(f"flinders {command} --help"))


def test_a_calibration_that_knows_its_errors(golden: Golden) -> None:
    lines = (
        "flinders simulate three-axis -o tumble.csv --seed 7",
        "flinders calibrate tumble.csv -o calibration.json --json",
        "flinders evaluate calibration.json tumble.truth.json",
    )
    shown = session(*lines)
    shown = re.sub(
        r"(?ms)^\$ flinders calibrate.*?(?=^\$)", "$ flinders calibrate tumble.csv -o calibration.json\n…\n", shown
    )
    golden("cli/evaluate.txt", shown)


def test_one_that_does_not(golden: Golden) -> None:
    """The field of the motors passes for iron, and no method knows of it."""
    session("flinders simulate three-axis -o flight.csv --motion flight --motor 0.3 --seed 7")
    session("flinders calibrate flight.csv -o calibration.json", code=3)
    golden("cli/evaluate-worse.txt", session("flinders evaluate calibration.json flight.truth.json", code=4))


def test_a_recovery_of_a_two_axis_compass(golden: Golden) -> None:
    golden("cli/two-axis.txt", session("flinders simulate two-axis -o swing.csv --polar rose.csv"))
    golden("cli/two-axis-rose.csv", Path("rose.csv").read_text(encoding="utf-8"))
    golden("cli/two-axis-swing.csv", Path("swing.csv").read_text(encoding="utf-8"))


def test_a_recording_with_everything_and_its_truth(golden: Golden) -> None:
    words = (
        "simulate three-axis -o rough.csv --motion flight --readings 60 --rate 10 --tilt 20 --noise 0.3 "
        "--resolution 0.15 --saturation 90 --outliers 0.1 --stationary 0.2 --motor 0.2 --drift 0.1 --step 3 "
        "--magnet 100 "
        "--gyro-bias 0.01,0,-0.02 --soft-iron 0.1 --hard-iron 40 --field-strength 48 --dip 65 --seed 3"
    )
    assert CliRunner().invoke(main, words.split()).exit_code == 0
    golden("cli/rough.csv", Path("rough.csv").read_text(encoding="utf-8"))
    found = json.loads(Path("rough.truth.json").read_text(encoding="utf-8"))
    golden("cli/rough.truth.json", json.dumps({**rounded(found), "version": "1.2.3"}, indent=1) + "\n")  # type: ignore[dict-item]


def test_an_evaluation_as_json(golden: Golden) -> None:
    session("flinders simulate three-axis -o tumble.csv --seed 7", "flinders calibrate tumble.csv -o c.json")
    ended = CliRunner().invoke(main, ["evaluate", "c.json", "tumble.truth.json", "--json"])
    assert ended.exit_code == 0
    keys = list(json.loads(ended.stdout))
    golden("cli/evaluate-keys.json", json.dumps(keys, indent=1) + "\n")
