"""The calibration that a log says was on board: kept on its readings, judged, imported, drawn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.flight_log import RIGHT, ROUND, round_flight
from tests.sentences import assert_sentences
from tests.trials import daily
from tests.vehicles.test_px4 import EARTH, MODERN, turning

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance
from flinders.core.joining import join_recordings, read_into_memory
from flinders.errors import NoOnboardCalibration
from flinders.geometry.angles import wrap_180
from flinders.workflows.onboard import onboard_fit

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.testing import Result

    from flinders.core.samples import Samples

STALE = (400, -200, -400)
"""COMPASS_OFS that is off by 10 µT for the compass of `round_flight`."""


def run(*words: str, code: int) -> Result:
    ended = CliRunner().invoke(main, words)
    assert ended.exit_code == code, ended.output
    return ended


def flown(offset: tuple[int, int, int], motion: str = "uniform") -> Path:
    """A log of this compass in the working directory."""
    path = Path("flight.bin")
    path.write_bytes(round_flight(offset, motion))
    return path


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory is an empty one."""
    monkeypatch.chdir(tmp_path)


def moved(calibration: Calibration, along_x: float) -> Calibration:
    return replace(calibration, offset=calibration.offset + np.array([along_x, 0.0, 0.0]))


def log_with(onboard: Calibration | None, **more: Any) -> Samples:
    return replace(simulate.tumble(seed=3, sensor=ROUND).samples, onboard=onboard, **more)


# kept on the readings


@pytest.mark.parametrize("axes", ["x,y,z", "y,x,-z"])
def test_it_makes_readings_of_those_without_it_what_was_logged(axes: str) -> None:
    path = flown(STALE)
    raw, logged = (flinders.read(path, sensor=1, axes=axes, as_logged=is_logged) for is_logged in (False, True))
    assert raw.onboard is not None
    npt.assert_allclose(raw.onboard.apply(raw.field), logged.field, atol=1e-9)
    assert (raw.onboard.sensor, raw.onboard.frame, str(raw.onboard.axes)) == ("MAG", "vehicle", axes)
    assert raw.onboard.field_strength == pytest.approx(47.44, abs=0.01)  # that of the site
    assert logged.onboard is None


def test_a_compass_without_one_and_a_table_have_none() -> None:
    assert flinders.read(flown(STALE), sensor=2).onboard is None
    assert simulate.tumble(seed=1).samples.onboard is None


@pytest.mark.parametrize("topic", ["sensor_mag", "vehicle_magnetometer"])
def test_that_of_px4_is_before_the_mounting(topic: str, tmp_path: Path) -> None:
    (tmp_path / "flight.ulg").write_bytes(turning(topic, MODERN))
    samples = flinders.read(tmp_path / "flight.ulg")
    assert samples.onboard is not None
    npt.assert_allclose(samples.onboard.offset, [25.0, 0.0, 0.0], atol=1e-5)
    npt.assert_allclose(np.diag(samples.onboard.matrix), [1.0, 1.0, 1.25])
    npt.assert_allclose(
        np.linalg.norm(samples.onboard.apply(samples.field), axis=1), 100 * np.linalg.norm(EARTH), rtol=1e-4
    )


def test_logs_joined_have_that_of_all_and_of_different_ones_none() -> None:
    one, other = (Calibration(np.eye(3), np.array([x, 0.0, 0.0]), 50.0) for x in (1.0, 2.0))
    elsewhere = replace(one, field_strength=42.0)
    assert read_into_memory(join_recordings([log_with(one), log_with(elsewhere)])).onboard is not None
    assert read_into_memory(join_recordings([log_with(one), log_with(other)])).onboard is None
    assert read_into_memory(join_recordings([log_with(one), log_with(None)])).onboard is None


# judged


@pytest.mark.parametrize(
    ("offset", "motion", "answer"),
    [(RIGHT, "uniform", "holds"), (STALE, "uniform", "fails"), (RIGHT, "tilted", "cannot-tell")],
)
def test_calibrate_says_whether_a_change_is_worth_while(offset: tuple[int, int, int], motion: str, answer: str) -> None:
    flown(offset, motion)
    ended = CliRunner().invoke(main, ["calibrate", "flight.bin", "--sensor", "1", "--target", "0.3", "--json"])
    judged = json.loads(ended.stdout)["onboard"]
    assert judged["answer"] == answer
    assert judged["words"].startswith(f"COMPASS_OFS {offset[0]}, {offset[1]}, {offset[2]} mG")
    assert judged["changes"] == 0


def test_its_heading_error_is_that_of_the_offset_that_is_left() -> None:
    fit = flinders.fit(log_with(None))
    off = moved(fit.calibration, 5.0)
    judged = flinders.judge_onboard(log_with(off), fit)
    assert judged is not None
    level = fit.calibration.field_strength * np.cos(np.deg2rad(60.0))
    assert judged.comparison.worst_deg == pytest.approx(np.rad2deg(np.arcsin(5.0 / level)), rel=0.02)
    assert judged.spread > 3.0 * fit.evidence.noise / fit.calibration.field_strength
    exact = flinders.judge_onboard(log_with(fit.calibration), fit)
    assert exact is not None
    assert exact.comparison.worst_deg < 1e-9
    assert exact.strength == pytest.approx(fit.calibration.field_strength)


def test_one_that_follows_a_current_is_taken_at_the_mean_of_the_log() -> None:
    fit = flinders.fit(log_with(None))
    rows = len(log_with(None))
    motors = Disturbance("current", np.array([0.5, 0.0, 0.0]), highest=20.0)
    followed = replace(moved(fit.calibration, -5.0), disturbances=(motors,))
    with_current = log_with(followed, current=np.tile([8.0, 12.0], rows // 2))
    for log, off in ((with_current, 0.0), (log_with(followed), 5.0)):
        judged = flinders.judge_onboard(log, fit)
        assert judged is not None
        npt.assert_allclose(judged.comparison.offset_difference, [off, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(("offset", "code"), [(RIGHT, 0), (STALE, 4)])
def test_check_of_a_log_alone_judges_it(offset: tuple[int, int, int], code: int) -> None:
    flown(offset)
    ended = run("check", "flight.bin", "--sensor", "1", "--json", code=code)
    assert json.loads(ended.stdout)["answer"] == {0: "holds", 4: "fails"}[code]
    assert ("flinders calibrate " in ended.stderr) == (code == 4)
    assert_sentences(ended.stderr)


def test_check_and_calibrate_give_one_number() -> None:
    flown(STALE)
    checked = json.loads(run("check", "flight.bin", "--sensor", "1", "--json", code=4).stdout)
    calibrated = json.loads(run("calibrate", "flight.bin", "--sensor", "1", "--json", code=0).stdout)["onboard"]
    for key in ("heading_difference_deg", "claimed_deg", "p_value"):
        assert checked[key] == calibrated[key]


@pytest.mark.parametrize(
    ("words", "hint"), [(["--sensor", "2"], "flinders calibrate"), (["--as-logged"], "--as-logged")]
)
def test_where_there_is_none_check_and_import_say_what_to_do(words: list[str], hint: str) -> None:
    flown(STALE)
    ended = run("check", "flight.bin", *words, "--json", code=5)
    error = json.loads(ended.stdout)["error"]
    assert error["code"] == NoOnboardCalibration.code
    assert hint in error["message"]


def test_readings_in_memory_without_one_raise() -> None:
    with pytest.raises(NoOnboardCalibration):
        flinders.check(log_with(None))
    with pytest.raises(NoOnboardCalibration):
        onboard_fit(join_recordings([log_with(None), log_with(None)]))


def test_all_sensors_have_theirs_in_the_table_and_in_json() -> None:
    flown(STALE)
    found = json.loads(CliRunner().invoke(main, ["calibrate", "flight.bin", "--sensor", "all", "--json"]).stdout)
    assert [row.get("onboard", {}).get("answer") for row in found["sensors"]] == ["fails", None]


# written as a file


def test_a_log_is_imported_and_goes_back_to_its_compass() -> None:
    flown(STALE)
    run("import", "flight.bin", "-o", "board.json", code=0)
    npt.assert_allclose(Calibration.load("board.json").offset, [-40.0, 20.0, 40.0], atol=1e-4)
    exported = run("export", "--for", "ardupilot", "board.json", code=0).stdout.splitlines()
    values = dict(line.split(",") for line in exported if line.startswith("COMPASS"))
    assert [float(values[f"COMPASS_OFS_{axis}"]) for axis in "XYZ"] == pytest.approx(STALE)
    checked = json.loads(run("check", "board.json", "flight.bin", "--json", code=4).stdout)
    assert checked["own_recordings"] == []  # no reading of the log is in it


def test_each_compass_that_had_one_gets_a_file() -> None:
    flown(STALE)
    ended = run("import", "flight.bin", "--sensor", "all", "-o", "board-{sensor}.json", "--json", code=0)
    assert [row["sensor"] for row in json.loads(ended.stdout)["sensors"]] == ["MAG"]
    assert Path("board-1.json").exists()
    assert not Path("board-2.json").exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["flight.bin", "--sensor", "2", "-o", "x.json"], 5),
        (["flight.bin", "--sensor", "all"], 2),
        (["flight.bin", "--compass", "1", "-o", "x.json"], 2),
        (["compass.param", "--sensor", "1", "-o", "x.json"], 2),
    ],
)
def test_what_cannot_be_imported_is_refused(words: list[str], code: int) -> None:
    flown(STALE)
    Path("compass.param").write_text("COMPASS_OFS_X,1\nCOMPASS_OFS_Y,2\nCOMPASS_OFS_Z,3\n", encoding="utf-8")
    run("import", *words, code=code)
    assert not Path("x.json").exists()


# headings over the log


@pytest.mark.parametrize("rotation", daily([2, 26, -1], 2))
def test_headings_with_what_was_right_on_board_are_the_yaw_but_for_the_declination(
    rotation: int, tmp_path: Path
) -> None:
    """The vehicle rolls and pitches by up to 40°, and a compass with a mounting of its own is turned into it."""
    path = tmp_path / "flight.ulg"
    path.write_bytes(turning("sensor_mag", MODERN | {"CAL_MAG0_ROT": rotation}))
    recording = flinders.open_recording(path)
    right = read_into_memory(recording).onboard
    assert right is not None
    history = flinders.heading_history(recording, right, moved(right, 3.0))
    assert history is not None
    assert (history.levelled_by, history.is_vehicle, history.declination_deg) == ("attitude", rotation >= 0, None)
    assert history.yaw_deg is not None
    declination = np.rad2deg(np.arctan2(EARTH[1], EARTH[0]))
    npt.assert_allclose(wrap_180(history.old_deg + declination - history.yaw_deg)[1:], 0.0, atol=0.1)
    assert np.nanmax(np.abs(history.difference_deg)) > 2.0


def test_without_an_attitude_the_accelerometer_levels_and_without_both_nothing() -> None:
    tumble = simulate.tumble(seed=1, motion="level")
    right = Calibration(np.eye(3), tumble.sensor.offset, 50.0, raw=tumble.samples.unit)
    found = [
        flinders.heading_history(samples, right, right)
        for samples in (tumble.samples, replace(tumble.samples, acceleration=None), replace(tumble.samples, time=None))
    ]
    assert [each and each.levelled_by for each in found] == ["acceleration", "nothing", None]


def test_the_report_draws_them_for_a_log_with_one_on_board() -> None:
    flown(STALE)
    for number, is_drawn in ((1, True), (2, False)):
        path = f"report-{number}.html"
        CliRunner().invoke(main, ["calibrate", "flight.bin", "--sensor", str(number), "--report", path])
        assert ('aria-labelledby="headings"' in Path(path).read_text(encoding="utf-8")) == is_drawn


# real flights


def test_what_was_on_board_of_a_real_flight(recordings: Callable[[str], Path]) -> None:
    path = str(recordings("dronekit_log171_3mags/log171.bin"))
    checked = json.loads(run("check", path, "--json", code=4).stdout)
    assert checked["heading_difference_deg"]["worst"] == pytest.approx(7.9, abs=0.05)
    assert checked["claimed_deg"]["worst"] == pytest.approx(3.4, abs=0.05)
    run("check", path, "--sensor", "2", code=3)
    run("check", path, "--sensor", "3", code=5)


def test_no_compass_with_six_readings_is_recommended(recordings: Callable[[str], Path]) -> None:
    path = str(recordings("px4_pyulog_cubeorange/sample_log_small.ulg"))
    found = json.loads(run("info", path, "--json", code=0).stdout)
    assert found["commands"] == []
    assert [bool(sensor["too_few"]) for sensor in found["sensors"]] == [False, True, True]
    assert found["sensors"][0]["unmoved"]


def test_what_is_claimed_of_a_sensor_alone_is_one_number(recordings: Callable[[str], Path]) -> None:
    path = str(recordings("dronekit_log171_3mags/log171.bin"))
    alone = json.loads(run("calibrate", path, "--sensor", "1", "--json", code=3).stdout)
    joint = json.loads(CliRunner().invoke(main, ["calibrate", path, "--sensor", "all", "--joint", "--json"]).stdout)
    claimed = joint["sensors"][0]["joint"]["alone_heading_error_deg"]
    assert claimed == alone["heading_error_deg"]["worst"]
