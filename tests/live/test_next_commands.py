"""The command that is printed as the next one works as it is copied, for what each public sketch prints."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any, Final

import click
import pytest
from tests.live.test_line_shapes import options_of
from tests.program import Ended, flinders_
from tests.sketches import IDS, SHAPES, printed
from tests.trials import daily

from flinders import simulate
from flinders.cli import main
from flinders.links import transports

if TYPE_CHECKING:
    from pathlib import Path

TUMBLE: Final = simulate.tumble(seed=5).samples[::5]
WRITTEN: Final = (0, 3)
"""How a command ends that has written a calibration: good, or limited."""
REFUSED: Final = 4


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def recorded(shape: dict[str, Any], name: str, monkeypatch: pytest.MonkeyPatch) -> Ended:
    """Record what a board prints."""
    readings, _ = printed(shape, TUMBLE)
    lines = [*shape["boot"], *(line for reading in readings for line in reading), ""]
    board = transports.ScriptedSource(["\r\n".join(lines).encode()], is_framed=True)
    monkeypatch.setattr(transports, "open_lines", lambda **_: board)
    pattern = ["--pattern", shape["pattern"]] if "pattern" in shape else []
    return flinders_("record", "--serial", "-o", name, "--readings", str(len(TUMBLE) - 10), *pattern)


def next_words(ended: Ended) -> list[str]:
    """The words of the one command that is printed as the next."""
    (command,) = [line.removeprefix("next: ") for line in ended.err.splitlines() if line.startswith("next: ")]
    program, *words = shlex.split(command)
    assert program == "flinders"
    return words


@pytest.mark.parametrize("shape", daily(SHAPES, 4), ids=IDS)
def test_the_next_command_after_a_recording_has_nothing_to_fill_in(
    shape: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = recorded(shape, "my tumble.csv", monkeypatch)
    name, *words = next_words(ended)
    assert ended.code == 0
    assert (name, words[0]) == ("calibrate", "my tumble.csv")
    calibrate = main.commands[name]
    assert isinstance(calibrate, click.Command)
    typed = calibrate.make_context(name, words).params
    assert (typed["unit"], typed["output"]) == (None, "calibration.json")


@pytest.mark.parametrize("shape", daily(SHAPES, 8), ids=IDS)
def test_the_next_commands_lead_from_a_board_to_code_for_it(
    shape: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    calibrated = flinders_(*next_words(recorded(shape, "tumble.csv", monkeypatch)))
    assert calibrated.code in WRITTEN
    words = next_words(calibrated)
    assert words == ["export", "--for", "arduino", "calibration.json"]
    exported = flinders_(*words)
    assert exported.code == 0
    assert "correctMagnetometer" in exported.out


@pytest.mark.parametrize("shape", daily(SHAPES, 8), ids=IDS)
def test_the_next_commands_of_info_calibrate_what_a_serial_monitor_has_saved(
    shape: dict[str, Any], tmp_path: Path
) -> None:
    readings, _ = printed(shape, TUMBLE)
    lines = [*shape["boot"], *(line for reading in readings for line in reading), ""]
    (tmp_path / "print.txt").write_text("\r\n".join(lines), encoding="utf-8", newline="")
    options = [word for name, value in options_of(shape).items() for word in (f"--{name}", value)]
    commands = flinders_("info", "print.txt", *options, "--json").json["commands"]
    codes = [flinders_(*shlex.split(command)[1:]).code for command in commands]
    assert codes[0] in WRITTEN
    assert set(codes[1:]) <= {*WRITTEN, REFUSED}  # of the second sensor on a line, numbers that are no field


def test_a_calibration_that_is_there_is_not_in_the_way_of_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = []
    for name in ("tumble.csv", "again.csv"):
        words = next_words(recorded(SHAPES[0], name, monkeypatch))
        outputs.append(words[-1])
        assert flinders_(*words).code == 0
    assert outputs == ["calibration.json", "calibration_2.json"]
