"""``--chip``: the count and the axes of a recording from the table of chips, and what cannot be taken from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.worlds import table_text

from flinders import simulate
from flinders.cli import main
from flinders.core.calibration import Calibration

if TYPE_CHECKING:
    from click.testing import Result


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counts of 0.15 µT, without a unit and in milligauss."""
    monkeypatch.chdir(tmp_path)
    counts = np.round(simulate.tumble(seed=1).samples.field / 0.15)
    (tmp_path / "counts.csv").write_text(table_text("mx,my,mz", counts), encoding="utf-8")
    (tmp_path / "gauss.csv").write_text(table_text("mx (mG),my (mG),mz (mG)", counts), encoding="utf-8")


def run(*words: str) -> Result:
    return CliRunner().invoke(main, list(words))


def test_a_calibration_has_the_count_and_the_axes_of_the_chip() -> None:
    by_chip = run("calibrate", "counts.csv", "--chip", "MPU-9250:16bits", "-o", "chip.json", "--json")
    typed = run("calibrate", "counts.csv", "--scale", "0.15", "--axes", "y,x,-z", "-o", "typed.json", "--json")
    assert by_chip.exit_code == typed.exit_code == 0
    assert json.loads(by_chip.stdout) == json.loads(typed.stdout)
    made = Calibration.load("chip.json")
    assert made.raw.scale == 0.15
    assert str(made.axes) == "y,x,-z"
    assert_sentences(by_chip.stderr, about="chip MPU-9250")


def test_a_report_lists_the_chip_and_not_what_was_taken_from_it() -> None:
    ended = run("calibrate", "counts.csv", "--chip", "MPU-9250:16bits", "--report", "chip.html")
    assert ended.exit_code == 0, ended.output
    text = Path("chip.html").read_text(encoding="utf-8")
    assert "<dt>--chip</dt><dd>MPU-9250:16bits</dd>" in text
    assert "<dt>--scale</dt>" not in text
    assert "<dt>--axes</dt>" not in text


@pytest.mark.parametrize(
    "words",
    [
        "counts.csv --chip HMC5883L",
        "counts.csv --chip BMM350",
        "counts.csv --chip BMX055",
        "counts.csv --chip RM3100",
        "counts.csv --chip IST8310:16bits --axes x,y,z",
        "gauss.csv --chip MPU-9250 --unit mG",
        "counts.csv --chip AK8963:16bits",
    ],
)
def test_what_is_taken_is_said(words: str) -> None:
    ended = run("calibrate", *words.split())
    assert_sentences(next(line for line in ended.stderr.splitlines() if line.startswith("chip ")))


@pytest.mark.parametrize(
    "words",
    [
        "calibrate counts.csv --chip MPU-9250",
        "calibrate counts.csv --chip HMC5883M",
        "calibrate counts.csv --chip HMC5883L --scale 0.1",
        "calibrate counts.csv --chip HMC5883L --unit mG",
        "calibrate counts.csv --chip RM3100 --unit mG --axes -x,-y,z",
        "calibrate gauss.csv --chip LIS2MDL",
        "live --simulate --chip HMC5883L",
        "live --replay counts.csv --chip QMC5883L:30G",
    ],
)
def test_what_the_table_does_not_know_is_refused(words: str) -> None:
    ended = run(*words.split())
    assert ended.exit_code == 2, ended.output
    assert_sentences(ended.stderr)


def test_each_command_with_a_scale_takes_a_chip() -> None:
    for name in ("calibrate", "compare-methods", "two-axis", "tolles-lawson", "live", "station"):
        assert "--chip NAME" in run(name, "--help").stdout, name
