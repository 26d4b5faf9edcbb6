"""Readings that a log holds in the axes of the vehicle, and the number of its compass, kept until a target has them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.apps.vehicles.targets.autopilot import parse
from flinders.cli import main
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.joining import Joined
from flinders.core.samples import Samples, frame_of
from flinders.core.units import Unit
from flinders.errors import AxesError, NotExportable
from flinders.fitting.calibrate import fit
from flinders.targets import find, read_back, registry

if TYPE_CHECKING:
    from click.testing import Result

    from flinders.arrays import Floats

LISTS = """\
FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 134, 34, MAG, QBhhhhhhhhhB, TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health
FMT, 129, 31, PARM, QNf, TimeUS,Name,Value
"""
DEVICE = 97539
MAPPED = Axes.of("z,x,y")
OFS = np.array([-90.0, 120.0, 30.0])
ON_BOARD = {"COMPASS_OFS_X": -90, "COMPASS_OFS_Y": 120, "COMPASS_OFS_Z": 30, "COMPASS_DEV_ID2": DEVICE}
BEFORE_THE_MOUNTING = ["px4", "px4-shell", "motioncal", "sensorlab", "rtimulib", "vectornav", "adis16480"]


def flight(seed: int = 11) -> str:
    """A log of two compasses as text; the second has no calibration on board, and iron of its own."""
    rng = np.random.default_rng(seed)
    field = simulate.uniform_directions(rng, 600)
    first = 480 * field - OFS
    second = 500 * field @ np.array([[1.05, 0.04, -0.03], [0.04, 0.95, 0.02], [-0.03, 0.02, 1.0]]) + np.array(
        [70, -45, 160]
    )
    lines = [f"PARM, 1000, {name}, {value}" for name, value in ON_BOARD.items()]
    for row, (one, other) in enumerate(zip(np.trunc(first + OFS), np.trunc(second), strict=True)):
        lines.append(f"MAG, {1000000 + 100000 * row}, 0, {_listed(one)}, -90, 120, 30, 0, 0, 0, 1")
        lines.append(f"MAG, {1000000 + 100000 * row}, 1, {_listed(other)}, 0, 0, 0, 0, 0, 0, 1")
    return LISTS + "\n".join([*lines, ""])


def _listed(values: Floats) -> str:
    return ", ".join(f"{value:.0f}" for value in values)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with the log of two compasses in it."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    Path("two.log").write_text(flight(), encoding="utf-8")
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(main, words)


def corrected(values: dict[str, float], digit: str, readings: Floats) -> Floats:
    """m = I ((r + OFS) SCALE) of readings in mG, from the bare parameters."""
    offset, diagonal, beside = (
        np.array([values[f"COMPASS_{group}{digit}_{axis}"] for axis in "XYZ"]) for group in ("OFS", "DIA", "ODI")
    )
    xy, xz, yz = beside
    iron = np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return np.array([iron @ ((reading + offset) * values[f"COMPASS_SCALE{digit}"]) for reading in readings])


@pytest.mark.parametrize("axes", ["x,y,z", "x,-y,-z", "y,-x,z", "z,x,y"])
def test_parameters_correct_a_log_as_the_calibration_does_however_axes_are_mapped(axes: str) -> None:
    assert run("calibrate", "two.log", "--sensor", "2", "--axes", axes, "-o", "c.json").exit_code == 0
    assert run("export", "--for", "ardupilot", "c.json", "-o", "c.param").exit_code == 0
    found = Calibration.load("c.json")
    assert (found.frame, str(found.axes)) == ("vehicle", axes)
    readings = flinders.open_log("two.log").sensor("2")
    raw = np.concatenate([block.field for block in readings.blocks()])  # µT, in the axes of the vehicle
    back = np.linalg.inv(found.axes.apply(np.eye(3)))
    expected = found.apply(found.axes.apply(raw)) @ back
    given = corrected(parse(Path("c.param").read_text(encoding="utf-8"), "c.param"), "2", raw / 0.1)
    npt.assert_allclose(0.1 * given, expected, atol=1e-4)


def test_the_second_compass_is_written_as_the_second() -> None:
    ended = run("calibrate", "two.log", "--sensor", "2", "--export", "ardupilot:-", "-o", "c.json")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr, about="device id 97539")
    for text in (ended.stdout, run("export", "--for", "ardupilot", "c.json").stdout):
        names = [line.split(",")[0] for line in text.splitlines() if line.startswith("COMPASS_")]
        assert names[:3] == ["COMPASS_OFS2_X", "COMPASS_OFS2_Y", "COMPASS_OFS2_Z"]
        assert "COMPASS_OFS_X" not in names
        assert_sentences(text, about="device id 97539")
    file = json.loads(Path("c.json").read_text(encoding="utf-8"))["provenance"]["files"][0]
    assert (file["autopilot"], file["compass"], file["device_id"]) == ("ardupilot", 2, DEVICE)


def test_another_compass_is_written_where_that_is_asked_and_said_in_the_file() -> None:
    assert run("calibrate", "two.log", "--sensor", "2", "-o", "c.json").exit_code == 0
    ended = run("export", "--for", "ardupilot", "--compass", "1", "c.json")
    assert ended.exit_code == 0
    assert "COMPASS_OFS_X," in ended.stdout
    assert_sentences(ended.stderr, about="compass 1")
    assert_sentences(ended.stdout, about="compass 1")
    assert run("export", "--for", "ardupilot", "--compass", "2", "c.json").stderr == ""


def test_a_calibration_of_two_compasses_together_goes_to_neither_unasked() -> None:
    for number in "12":
        assert run("calibrate", "two.log", "--sensor", number, "-o", f"{number}.json").exit_code == 0
    files = [json.loads(Path(f"{number}.json").read_text(encoding="utf-8")) for number in "12"]
    files[0]["provenance"]["files"] += files[1]["provenance"]["files"]
    Path("both.json").write_text(json.dumps(files[0]), encoding="utf-8")
    ended = run("export", "--for", "ardupilot", "both.json")
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert_sentences(ended.stderr)
    asked = run("export", "--for", "ardupilot", "--compass", "2", "both.json")
    assert asked.exit_code == 0
    assert_sentences(asked.stderr)


@pytest.mark.parametrize("target", BEFORE_THE_MOUNTING)
def test_what_acts_before_the_mounting_does_not_get_numbers_from_after_it(target: str) -> None:
    assert run("calibrate", "two.log", "--sensor", "1", "-o", "c.json").exit_code == 0
    ended = run("export", "--for", target, "c.json", "-o", "out")
    assert ended.exit_code == 4
    assert_sentences(ended.stderr)
    assert not Path("out").exists()
    assert run("calibrate", "two.log", "--sensor", "1", "--export", f"{target}:out").exit_code == 4
    text = Path("c.json").read_text(encoding="utf-8").replace('"frame": "vehicle"', '"frame": "sensor"')
    Path("c.json").write_text(text, encoding="utf-8")
    assert run("export", "--for", target, "c.json", "-o", "out").exit_code == 0


@pytest.mark.parametrize("command", ["apply", "heading", "check"])
def test_a_calibration_is_not_for_a_log_in_other_axes(command: str) -> None:
    assert run("calibrate", "two.log", "--sensor", "1", "-o", "c.json").exit_code == 0
    text = Path("c.json").read_text(encoding="utf-8").replace('"frame": "vehicle"', '"frame": "sensor"')
    Path("c.json").write_text(text, encoding="utf-8")
    ended = run(command, "c.json", "two.log", "--sensor", "1")
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert_sentences(ended.stderr)


def test_a_blackbox_goes_to_betaflight_and_not_to_inav() -> None:
    """``magADC`` is after the alignment of the board, where Betaflight acts and INAV does not."""
    field = np.rint(500 * simulate.uniform_directions(np.random.default_rng(5), 400) + [100, -50, 30]).astype(int)
    rows = "\n".join(f"{row},{1000 * row},{x},{y},{z}" for row, (x, y, z) in enumerate(field.tolist()))
    Path("log.csv").write_text(f"loopIteration,time,magADC[0],magADC[1],magADC[2]\n{rows}\n", encoding="ascii")
    assert run("calibrate", "log.csv", "-o", "c.json").exit_code == 0
    assert Calibration.load("c.json").frame == "vehicle"
    written = run("export", "--for", "betaflight", "c.json")
    assert "set mag_calibration = 100,-50,30\n" in written.stdout
    assert_sentences(written.stdout.replace("\n#  ", ""), about="0,0,0")
    refused = run("export", "--for", "inav", "c.json")
    assert (refused.exit_code, refused.stdout) == (4, "")
    assert_sentences(refused.stderr)
    Path("dump.txt").write_text("set mag_calibration = 100,-50,30\n", encoding="ascii")
    assert run("import", "dump.txt", "--field-strength", "500", "-o", "back.json").exit_code == 0
    assert run("export", "--for", "inav", "back.json").exit_code == 4  # as a dump is treated


def test_parameters_of_ardupilot_are_in_the_axes_of_the_vehicle_and_stay_so() -> None:
    Calibration(np.diag([1.1, 0.9, 1.0]), np.array([9.0, -12, 3]), 49.0, raw=Unit.of("mG")).save("c.json")
    assert run("export", "--for", "ardupilot", "c.json", "-o", "c.param").exit_code == 0
    assert run("import", "c.param", "-o", "back.json").exit_code == 0
    assert Calibration.load("back.json").frame == "vehicle"
    assert run("export", "--for", "px4", "back.json").exit_code == 4
    again = run("export", "--for", "ardupilot", "back.json")
    assert parse(again.stdout, "again") == parse(Path("c.param").read_text(encoding="utf-8"), "c.param")


@pytest.mark.parametrize(
    ("target", "compass", "first"), [("ardupilot", "3", "COMPASS_OFS3_X"), ("px4", "2", "CAL_MAG2_XOFF")]
)
def test_what_was_imported_goes_back_to_its_compass(target: str, compass: str, first: str) -> None:
    Calibration(np.diag([1.1, 0.9, 1.0]), np.array([9.0, -12, 3]), 49.0, raw=Unit.of("mG")).save("c.json")
    assert run("export", "--for", target, "--compass", compass, "c.json", "-o", "c.param").exit_code == 0
    assert run("import", "c.param", "-o", "back.json").exit_code == 0
    again = run("export", "--for", target, "back.json")
    assert again.exit_code == 0
    assert first in again.stdout
    assert_sentences(again.stderr)


def test_every_target_refuses_or_says_in_which_axes_readings_go_in() -> None:
    found = Calibration(np.eye(3), np.array([1.0, 2, 3]), 50.0, raw=Unit.of("uT"), axes=MAPPED, frame="vehicle")
    refused = []
    for name, row in registry().items():
        if row.unit == "counts":
            continue
        try:
            export = row.render(found)
        except NotExportable:
            refused.append(name)
            continue
        assert_sentences([f"{name}:", *(note for note in export.fields["notes"] if "axes of the vehicle" in note)])
    assert set(refused) == {row.name for row in registry().values() if row.refuses_mounted and row.unit != "counts"}
    assert set(refused) >= {*BEFORE_THE_MOUNTING, "adafruit-eeprom", "adis16488"}


def test_betaflight_takes_off_what_the_board_had_in_its_own_axes() -> None:
    found = Calibration(np.eye(3), np.array([100.0, -200, 300]), 500.0, axes=MAPPED, frame="vehicle")
    assert parse_line(find("betaflight").render(found).text) == "-200,300,100"  # z, x, y are 100, −200, 300


def parse_line(text: str) -> str:
    """The value of the one setting."""
    return next(line.split(" = ")[1] for line in text.splitlines() if line.startswith("set mag_calibration"))


def test_other_readings_are_in_the_axes_of_the_sensor() -> None:
    assert frame_of(Samples.of(simulate.uniform_directions(np.random.default_rng(1), 5))) == "sensor"
    assert read_back(b"CAL_MAG0_XOFF 0.1\n", "p.txt", target="px4")[1].frame == "sensor"


def test_readings_in_memory_keep_their_axes() -> None:
    assert fit(flinders.read("two.log", sensor="2")).calibration.frame == "vehicle"


def test_recordings_in_unlike_axes_are_not_put_together() -> None:
    compass = flinders.open_log("two.log").sensor("1")
    text = Samples.of(500 * simulate.uniform_directions(np.random.default_rng(2), 50), unit="mG", source="tumble.csv")
    with assert_raises(AxesError):
        Joined((compass, text))
    assert fit(Joined((compass, compass))).calibration.frame == "vehicle"


def test_a_calibration_in_vehicle_axes_is_applied_to_its_own_log() -> None:
    assert run("calibrate", "two.log", "--sensor", "2", "--axes", "x,-y,-z", "-o", "c.json").exit_code == 0
    assert run("apply", "c.json", "two.log", "--sensor", "2").exit_code == 0
    checked = run("check", "c.json", "two.log", "--sensor", "2")
    assert checked.exit_code == 3  # for no other reason than this one
    assert_sentences(" ".join(checked.stdout.split()), about="two.log")
    headings = run("heading", "c.json", "two.log", "--sensor", "2", "--level")
    assert headings.exit_code == 3  # for no other reason than that it was tumbled
    assert headings.stderr.count("  ! ") == 1
    assert_sentences(headings.stderr)
