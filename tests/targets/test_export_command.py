"""`flinders export` as a user meets it: what it writes and where, what it refuses, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main
from flinders.core import calibration_file
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import registry

if TYPE_CHECKING:
    from click.testing import Result

TO = ("--for", "esphome")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with calibrations in it: a plain one, and one in counts."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    made([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]], [12, -30, 7]).save("calibration.json")
    made(np.eye(3), [100, 0, 0], unit="counts").save("counts.json")
    return tmp_path


def made(matrix: object, offset: object, *, unit: str = "mG", **more: Any) -> Calibration:
    return Calibration(np.array(matrix, float), np.array(offset, float), 49.0, raw=Unit.of(unit), **more)


def export(*words: str) -> Result:
    return CliRunner().invoke(main, ["export", *words])


def test_a_file_is_written_and_never_written_over_unasked() -> None:
    assert export(*TO, "calibration.json", "-o", "sensor.txt").exit_code == 0
    written = Path("sensor.txt").read_text(encoding="utf-8")
    assert written == export(*TO, "calibration.json").stdout
    again = export(*TO, "calibration.json", "-o", "sensor.txt")
    assert again.exit_code == 6
    assert_sentences(again.stderr)
    assert export(*TO, "calibration.json", "-o", "sensor.txt", "--force").exit_code == 0
    over = export(*TO, "calibration.json", "-o", "calibration.json", "--force")
    assert over.exit_code == 2
    assert_sentences(over.stderr)


def test_mapped_axes_and_a_sensor_are_told() -> None:
    from flinders.core.axes import Axes

    made(np.eye(3), [1, 2, 3], axes=Axes.of("x,-y,-z"), sensor="SN 7").save("turned.json")
    text = export(*TO, "turned.json").stdout
    assert_sentences(text, about="x,-y,-z")
    assert_sentences(text, about="SN 7")


def test_a_limited_calibration_says_what_it_is_not_good_for() -> None:
    record("deck.csv", "tilted")
    assert CliRunner().invoke(main, ["calibrate", "deck.csv", "-o", "deck.json"]).exit_code == 3
    ended = export(*TO, "deck.json", "-o", "deck.txt")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    assert_sentences(Path("deck.txt").read_text(encoding="utf-8"), about="limited")


def test_a_refused_calibration_is_not_exported() -> None:
    found = calibration_file.Fitted(method="auto", samples=100, verdict="refused")
    calibration_file.write(Calibration.load("calibration.json").to_document(fit=found), "refused.json")
    ended = export(*TO, "refused.json", "-o", "sensor.txt")
    assert ended.exit_code == 4
    assert_sentences(ended.stderr)
    assert not Path("sensor.txt").exists()


def test_the_targets_are_listed() -> None:
    listed = CliRunner().invoke(main, ["targets"])
    assert listed.exit_code == 0
    assert all(name in listed.stdout for name in registry())
    assert set(json.loads(CliRunner().invoke(main, ["targets", "--json"]).stdout)) == set(registry())


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("", 2),
        ("calibration.json", 2),
        ("--for esphome", 2),
        ("--for yml calibration.json", 2),
        ("--for esphome counts.json", 2),
        ("--for esphome -", 2),
        ("--for esphome tumble.csv", 2),
        ("--for esphome missing.json", 5),
        ("--for esphome calibration.json -o nowhere/sensor.txt", 6),
        ("--for esphome calibration.json -o .", 6),
        ("--for esphome calibration.json -o - --json", 2),
        ("--for esphome calibration.json calibration.json", 2),
    ],
)
def test_wrong_use_is_one_line_on_stderr(words: str, code: int) -> None:
    record("tumble.csv", "uniform")
    ended = export(*words.split())
    assert ended.exit_code == code
    assert_sentences(ended.stderr)
    assert len(ended.stderr.splitlines()) == 1
    assert ended.stdout == "" or "--json" in words


def record(name: str, motion: str) -> None:
    field = simulate.tumble(seed=2, motion=motion).samples.field
    write_field(name, field)
