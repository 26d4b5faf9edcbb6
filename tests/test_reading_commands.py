"""Commands of packages that read a recording say what they read, as those of the library do (`tests/cli`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences

from flinders import Calibration, Unit, simulate
from flinders.cli import main
from flinders.cli._commands import ROWS

if TYPE_CHECKING:
    from pathlib import Path

READING: Final = {
    "compare-methods": "compare-methods print.txt --methods auto,sphere",
    "swing": "swing calibration.json print.txt --level",
    "tolles-lawson": "tolles-lawson print.txt",
    "two-axis": "two-axis print.txt",
    "watch": "watch --replay print.txt",
}
TUMBLE: Final = simulate.tumble(seed=5, n=600, motion="uniform")


def test_the_commands_that_read_a_recording_are_these() -> None:
    places = {
        name: " ".join(word.metavar or "" for word in command.params if isinstance(word, click.Argument))
        for name, command in main.commands.items()
        if name not in ROWS
    }
    assert {name for name, place in places.items() if "RECORDING" in place or "LOG" in place} == READING.keys()


@pytest.mark.parametrize("words", READING.values(), ids=READING)
def test_every_command_says_how_many_readings_there_were_and_quotes_the_first_other_line(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    matrix, offset = TUMBLE.sensor.correction
    Calibration(matrix, offset, 50.0, raw=Unit.of("uT")).save("calibration.json")
    rows = enumerate(TUMBLE.samples.field)
    lines = [f"t: {0.02 * row:.2f} X: {x:.2f} Y: {y:.2f} Z: {z:.2f} uT" for row, (x, y, z) in rows]
    (tmp_path / "print.txt").write_text("\n".join(["LIS3MDL test", "LIS3MDL found", *lines, "low battery", ""]))
    told = [line for line in flinders_(*words.split()).err.splitlines() if line.startswith("print.txt: ")]
    (counted,) = [line for line in told if "600 readings" in line]
    assert "(line 1: 'LIS3MDL test')" in counted
    assert_sentences(counted)
