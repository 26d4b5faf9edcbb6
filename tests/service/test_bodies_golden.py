"""How-to pages of five bodies: their commands and scripts run, print what the pages show, and what they advise is so.

Renew the pages with ``pytest --regenerate``.
"""

from __future__ import annotations

import re
import shlex
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np
import pytest
from tests.feeding import free_port
from tests.flight_log import dataflash
from tests.golden.sessions import ROOT
from tests.service.test_boat import answered, without_digits
from tests.trials import nightly
from tests.waiting import wait_until

from flinders import OnlineCalibration, Samples, simulate
from flinders.apps.service import simulate_boat
from flinders.apps.service.sources import of_wire
from flinders.cli import main
from flinders.fitting.fit_file import load
from flinders.links.transports import open_lines

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.simulate import Sensor

PAGES: Final = tuple(ROOT / "docs" / "service" / f"{body}.md" for body in ("robot", "boat", "drone", "wrist", "phone"))
SHELL: Final = re.compile(r"^```sh\n(.*?)^```$|`(flinders watch [^`]+)`", re.MULTILINE | re.DOTALL)
INLINE: Final = re.compile(r"`(flinders (?:export|apply) [^`]+)`")
RUN: Final = re.compile(r"^```(console|python)\n(?!>>>)(.*?)^```$", re.MULTILINE | re.DOTALL)
PORT: Final = 50100
OFFSET: Final = np.array([10.0, -20.0, 15.0])
MOVED: Final = np.array([4.0, -3.0, 2.0])
ROUTINE: Final = ("another calibration is in force", "simulated: ", " is in ", "; comma-separated; ", "; un-applied: ")
"""Lines that a page leaves out."""


def script(page: str, words: str) -> str:
    """The script of a page that has some words."""
    text = (ROOT / "docs" / "service" / page).read_text(encoding="utf-8")
    return next(str(code) for kind, code in RUN.findall(text) if kind == "python" and words in code)


def run(code: str, name: str) -> None:
    """Run a script, and close its socket."""
    names: dict[str, Any] = {}
    exec(compile(code, name, "exec"), names)
    if "wire" in names:
        names["wire"].close()


def log_flights() -> None:
    """Two flights, a week apart; the first begins with half a minute in the hands."""
    sensor = simulate.Sensor.random(np.random.default_rng(2), soft=0.1, hard=30.0, noise=0.3)
    in_hand, flight, next_flight = (
        simulate.tumble(seed, motion=motion, n=n, rate_hz=10.0, sensor=one).samples.field
        for seed, motion, n, one in (
            (2, "hand", 300, sensor), (52, "flight", 2400, sensor),
            (53, "flight", 2400, replace(sensor, offset=sensor.offset + MOVED)),
        )
    )  # fmt: skip
    Path("flight-1.bin").write_bytes(b"".join(dataflash(np.concatenate([in_hand, flight]))))
    Path("flight-2.bin").write_bytes(b"".join(dataflash(next_flight, week=2401)))


def log_walks() -> None:
    """Two archives of a phone's logger."""
    for walk in (1, 2):
        samples = simulate.tumble(walk, motion="eight", n=1500, sensor=simulate.tumble(1).sensor).samples
        assert samples.time is not None
        rows = (f"{at:.3f},{z:.3f},{y:.3f},{x:.3f}" for at, (x, y, z) in zip(samples.time, samples.field, strict=True))
        with zipfile.ZipFile(f"walk-{walk}.zip", "w") as archive:
            archive.writestr("MagnetometerUncalibrated.csv", "\n".join(["seconds_elapsed,z,y,x", *rows]))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_as_it_runs(page: Path, request: pytest.FixtureRequest) -> None:
    text = page.read_text(encoding="utf-8")
    log_flights()
    log_walks()

    def real(block: re.Match[str]) -> str:
        if block[1] == "python":
            run(block[2], page.name)
            return block[0]
        commands = [line for line in block[2].splitlines() if line.startswith("$ ")]
        return "```console\n" + "".join(f"{line}\n{answered(line[2:], ROUTINE)}\n" for line in commands) + "```"

    renewed = RUN.sub(real, text)
    for line in INLINE.findall(text):
        answered(line)
    if request.config.getoption("--regenerate", default=False):
        page.write_text(renewed, encoding="utf-8")
    assert without_digits(renewed) == without_digits(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_that_need_a_device_have_the_options_that_they_name(page: Path) -> None:
    blocks = [one or other for one, other in SHELL.findall(page.read_text(encoding="utf-8"))]
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("flinders ")]
    for line in lines:
        _, name, *words = shlex.split(line)
        command = main.get_command(click.Context(main), name)
        assert command is not None, line
        command.make_context(name, words)


def test_lines_that_a_robot_sends_are_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    source = of_wire(open_lines(port=None, baud=0, udp=port, tcp=None), None)
    sends: dict[str, Any] = {}
    exec(script("robot.md", "def on_reading").replace(str(PORT), str(port)), sends)
    for row in range(60):
        sends["on_reading"](0.1 * row, 20.0 + row, -3.5, 41.25)
    got: list[Samples] = []

    def arrived() -> bool:
        one = source.next(0.1)
        got.extend([one] if isinstance(one, Samples) else [])
        return sum(len(each) for each in got) == 60

    wait_until(arrived)
    source.close()
    sends["wire"].close()
    assert {each.unit.name for each in got} == {"uT"}
    np.testing.assert_allclose(np.concatenate([each.field for each in got])[-1], [79.0, -3.5, 41.25])


def test_what_was_in_force_before_is_taken_back() -> None:
    answered("flinders simulate three-axis -o hand.csv --readings 1500")
    answered("flinders simulate three-axis -o again.csv --readings 3000 --sensor hand.truth.json")
    answered("flinders watch --replay hand.csv --state compass.state --adopted last.json")
    run(script("watch.md", "take_back"), "watch.md")
    before, last = OnlineCalibration.load("compass.state").calibration, load("last.json").calibration
    answered("flinders watch --replay again.csv --state compass.state --lock")
    online = OnlineCalibration.load("compass.state")
    assert online.calibration is not None
    assert before is not None
    np.testing.assert_array_equal(online.calibration.offset, before.offset)
    assert not before.isclose(last)


def turned(sensor: Sensor, period_s: float) -> Floats:
    """(N, 3) µT of three minutes of turns on the spot, ten readings a second."""
    heading = np.arange(1800) / 10.0 * 2.0 * np.pi / period_s
    level = 25.0 * np.stack([np.cos(heading), -np.sin(heading), np.full(1800, np.sqrt(3.0))], axis=1)
    return sensor.read(level, np.random.default_rng(1))


@pytest.mark.parametrize("askew_deg", [0.0, 4.0])
def test_a_degree_that_z_is_askew_stays_in_the_claim_of_a_robot(askew_deg: float) -> None:
    askew = simulate.turns(np.radians([[askew_deg, 0.0, 0.0]]))[0]
    online = OnlineCalibration()
    online.add(turned(simulate.Sensor(askew, OFFSET, noise=0.3), 25.0), time=np.arange(1800) / 10.0)
    assert online.is_level
    assert online.state.heading_error_deg == pytest.approx(max(askew_deg, 0.5), rel=0.3)


@pytest.mark.parametrize(("period_s", "until_s"), [(20.0, 80.0), (30.0, 90.0), (60.0, 120.0)])
def test_turns_on_the_spot_are_learnt_within_two_minutes(period_s: float, until_s: float) -> None:
    online = OnlineCalibration()
    sensor = simulate.Sensor(offset=OFFSET, noise=0.3)
    first, *_ = online.add(turned(sensor, period_s), time=np.arange(1800) / 10.0)
    assert first.code == "learnt"
    assert 60.0 < first.time_s < until_s


def test_the_axis_of_the_turns_of_a_robot_is_z() -> None:
    readings = turned(simulate.Sensor(offset=OFFSET, noise=0.3), 25.0)[:, [2, 0, 1]]
    assert OnlineCalibration().add(readings, time=np.arange(1800) / 10.0) == ()
    assert OnlineCalibration(axes="y,z,x").add(readings, time=np.arange(1800) / 10.0)[0].code == "learnt"


def test_what_moves_at_rest_is_seen_at_once_by_five_readings_a_second() -> None:
    online, sensor = OnlineCalibration(), simulate.Sensor(offset=OFFSET, noise=0.3)
    online.add(turned(sensor, 25.0), time=np.arange(1800) / 10.0)
    still = np.tile(OFFSET + np.array([25.0, 0.0, 43.0]), (100, 1)) + np.random.default_rng(2).normal(
        0.0, 0.3, (100, 3)
    )
    still[50:] += MOVED
    time = 180.0 + np.arange(100) / 5.0
    (moved,) = [event for event in online.add(still, time=time) if event.code == "moved"]
    assert moved.time_s - time[50] < 1.0


@pytest.mark.parametrize(("roll_deg", "is_level"), [nightly(2.0, True), nightly(8.0, False)])
def test_a_boat_that_rolls_in_its_circles_is_no_level_one(
    roll_deg: float, is_level: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulate_boat, "ROLL_DEG", (min(roll_deg, 4.0), roll_deg))
    samples = simulate_boat.boat(seed=1, days=0.42).simulated.samples
    online = OnlineCalibration()
    assert samples.time is not None
    online.add(samples.field, time=samples.time)
    assert online.is_level is is_level
    assert (online.state.heading_error_deg > 3.0) is is_level
