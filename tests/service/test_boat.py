"""A week of a boat: what is simulated is true, a watch of it may be killed, and docs/service/week.md shows it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from click.testing import CliRunner
from tests.golden.sessions import ROOT
from tests.program import flinders_
from tests.sentences import assert_raises
from tests.service.test_watch import POSIX, program
from tests.waiting import wait_until

from flinders import OnlineCalibration
from flinders.apps.service.simulate_boat import BEGINS_S, MOVE_UT, boat
from flinders.cli import main
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

PAGE: Final = ROOT / "docs" / "service" / "week.md"
CONSOLE: Final = re.compile(r"(?<=^```console\n)(.*?)(?=^```$)", re.MULTILINE | re.DOTALL)
ROUTINE: Final = ("another calibration is in force", "the heading error is")
"""Lines that the page leaves out."""
MORNING: Final = 0.43
"""Days until a boat has been at sea for two hours."""


def test_readings_are_those_of_the_true_offset() -> None:
    life = boat(seed=3, days=MORNING, noise=0.0)
    made, shift, time = life.simulated, life.simulated.shift, life.simulated.samples.time
    assert shift is not None
    assert time is not None
    at_sea = (np.diff(time, prepend=0.0) < 1.0) & ~made.outliers
    field = (made.samples.field - made.sensor.offset - shift) @ np.linalg.inv(made.sensor.matrix).T
    assert abs(np.linalg.norm(field[at_sea], axis=1) - 50.0).max() < 1.0
    assert (shift[-1] == 0.0).all()
    moved = next(event for event in life.events if event.kind == "moved")
    row = int(np.searchsorted(time, moved.begin_s))
    assert np.linalg.norm(shift[row] - shift[row - 1]) == pytest.approx(MOVE_UT, abs=0.01)


def test_a_seed_gives_the_same_days_and_a_longer_life_begins_alike() -> None:
    one, again, longer = boat(seed=2, days=0.4), boat(seed=2, days=0.4), boat(seed=2, days=0.45)
    np.testing.assert_array_equal(one.simulated.samples.field, again.simulated.samples.field)
    assert one.events == again.events
    count = len(one.simulated.samples)
    np.testing.assert_array_equal(longer.simulated.samples.time[:count], one.simulated.samples.time)  # type: ignore[index]
    for days in (0.0, 0.2, float("nan"), 1000.0):
        with assert_raises(UsageError):
            boat(days=days)


def test_a_night_has_no_readings() -> None:
    life = boat(days=1.6)
    time = life.simulated.samples.time
    assert time is not None
    night = next(event for event in life.events if event.kind == "off")
    assert not ((time > night.begin_s) & (time < night.end_s)).any()
    assert time[-1] > night.end_s
    assert time[0] > BEGINS_S


@POSIX
def test_a_watch_that_was_killed_knows_the_same_in_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert flinders_("simulate", "boat", "--days", str(MORNING), "-o", "life.csv").code == 0
    words = ("--replay", "life.csv", "--every", "300")
    whole = flinders_("watch", *words, "--state", "whole.state", "--status", "whole.json", "--json")
    events = [line["event"] for line in map(json.loads, whole.out.splitlines()) if line["kind"] == "event"]
    assert events[0] == "learnt"
    assert "moved" in events
    killed = program(*words, "--state", "boat.state")
    wait_until(Path("boat.state").exists)
    wait_until(lambda: OnlineCalibration.load("boat.state").state.doing != "learning")
    killed.kill()
    killed.communicate()
    reached = OnlineCalibration.load("boat.state").time_s
    assert (
        flinders_("watch", *words, "--state", "boat.state", "--status", "again.json", "--page", "boat.html").code == 0
    )
    first, again = (json.loads(Path(name).read_text()) for name in ("whole.json", "again.json"))
    assert reached < again["time_s"]
    for name in ("heading_error_deg", "bound_deg", "latest_deg", "walk", "good_until_s", "time_s", "verdict"):
        assert again[name] == first[name], name
    assert Path("boat.state").read_bytes() == Path("whole.state").read_bytes()  # also its history and its timeline
    assert "The offset has moved" in Path("boat.html").read_text(encoding="utf-8")


def answered(line: str, routine: Sequence[str] = ROUTINE) -> str:
    """What a command prints, without what is said again and again."""
    ended = CliRunner().invoke(main, line.split()[1:], prog_name="flinders")
    assert ended.exit_code == 0, ended.output
    lines: list[str] = []
    for shown in ended.output.splitlines():
        if not any(words in shown for words in routine):
            lines.append(shown)
        elif lines[-1:] != ["…"]:
            lines.append("…")
    return "\n".join(lines)


@pytest.mark.nightly
def test_the_week_is_as_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")

    def real(shown: re.Match[str]) -> str:
        commands = [line for line in shown[1].splitlines() if line.startswith("$ ")]
        return "".join(f"{command}\n{answered(command[2:])}\n" for command in commands)

    renewed = CONSOLE.sub(real, text)
    if request.config.getoption("--regenerate", default=False):
        PAGE.write_text(renewed, encoding="utf-8")
    assert without_digits(renewed) == without_digits(PAGE.read_text(encoding="utf-8"))


def without_digits(text: str) -> str:
    """Numbers differ a little from machine to machine: hours stay, and what happened."""
    return re.sub(r"(?<=[\d.])[\d.]+|(?<=:)\d\d", "", text)
