"""Targets of vehicles: the formula of each from its source, what it has no room for, and its files read back."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.targets.test_targets import (
    COUNT_UT,
    READABLE,
    SINGLE_UT,
    assert_formula,
    pairs,
    readings,
    rendered,
    sensor,
    symmetric,
)

from flinders import simulate
from flinders.arrays import Floats, to_floats
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import DocumentError, InputError, NotExportable, UsageError
from flinders.targets import Export, ExportOptions, find, read_back
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.targets import Export


def ardupilot(export: Export, r: Floats) -> Floats:
    p = {name: float(np.float32(v)) for name, v in pairs(export.text, r"^(\w+),(\S+)$").items()}
    iron = symmetric(*(p[f"COMPASS_{group}_{axis}"] for group in ("DIA", "ODI") for axis in "XYZ"))
    return to_floats((r + [p[f"COMPASS_OFS_{axis}"] for axis in "XYZ"]) * p["COMPASS_SCALE"] @ iron.T)


def px4(export: Export, r: Floats) -> Floats:
    p = {
        name: float(np.float32(v))
        for name, v in pairs(export.text, r"^(?:1\t1\t|param set )(CAL_MAG0_\w+)[ \t](\S+)").items()
    }
    scale = symmetric(*(p[f"CAL_MAG0_{axis}{group}"] for group in ("SCALE", "ODIAG") for axis in "XYZ"))
    return to_floats((r - [p[f"CAL_MAG0_{axis}OFF"] for axis in "XYZ"]) @ scale.T)


def betaflight(export: Export, r: Floats) -> Floats:
    found = re.search(r"^set mag_calibration = (-?\d+),(-?\d+),(-?\d+)$", export.text, re.MULTILINE)
    assert found
    return to_floats(np.rint(r) - [int(word) for word in found.groups()])


def inav(export: Export, r: Floats) -> Floats:
    p = pairs(export.text, r"^set (\w+) = (-?\d+)$")
    zero, gain = (np.array([p[f"mag{kind}_{axis}"] for axis in "xyz"]) for kind in ("zero", "gain"))
    return to_floats(np.trunc((np.rint(r) - zero) * 1024 / gain))


def paparazzi(export: Export, r: Floats) -> Floats:
    p = pairs(export.text, r'<define name="(\w+)" value="(\S+?)"')
    neutral, sens = (np.array([p[f"MAG_{axis}_{kind}"] for axis in "XYZ"]) for kind in ("NEUTRAL", "SENS"))
    return to_floats((np.rint(r) - neutral) * sens)


def madgwick(export: Export, r: Floats) -> Floats:
    p = pairs(export.text, r"(mag_bias_\w): (\S+)")
    return to_floats(r - [p[f"mag_bias_{axis}"] for axis in "xyz"])


def pipeline(export: Export, r: Floats) -> Floats:
    p = pairs(export.text, r"(initial_mag_bias_\w): (\S+)")
    matrix = re.search(r"initial_mag_scaling_matrix: \[([^\]]*)\]", export.text)
    assert matrix
    rows = np.array([float(word) for word in matrix[1].split(",")]).reshape(3, 3)
    return to_floats((r - [p[f"initial_mag_bias_{axis}"] for axis in "xyz"]) @ rows.T)


def betaflight_model(export: Export, r: Floats) -> Floats:
    """applyEllipsoidCorrection of ellipsoidFit.ts."""
    correction = json.loads(export.text)["ellipsoid_correction"]
    centre = [correction["center"][axis] for axis in "xyz"]
    return to_floats((r - centre) @ np.array(correction["soft_iron"]).T)


FORMULAS: dict[str, Callable[[Export, Floats], Floats]] = {
    "ardupilot": ardupilot, "px4": px4, "px4-shell": px4, "betaflight": betaflight,
    "betaflight-model": betaflight_model, "inav": inav, "paparazzi": paparazzi, "ros-madgwick": madgwick,
    "ros-pipeline": pipeline,
}  # fmt: skip
BOUND_UT = {
    # half a count of the offset and half a count of the reading, on each axis
    "betaflight": 3**0.5 * COUNT_UT,
    # the same, half a step of each gain of some 256 counts or more, and one of 1024 cut off
    "inav": 3**0.5 * (COUNT_UT * 1.25 + 48 * 0.5 / 256 + 48 / 1024),
    "paparazzi": 3**0.5 * COUNT_UT * 1.25,
}
"""What rounding allows, in µT; elsewhere that of single precision."""


@pytest.mark.parametrize("axes", ["x,y,z", "x,-y,-z", "-z,x,-y"])
@pytest.mark.parametrize("name", FORMULAS)
def test_the_targets_own_formula_gives_the_calibration(name: str, axes: str) -> None:
    """With three mountings and three sensors."""
    assert_formula(name, FORMULAS[name], axes, BOUND_UT.get(name, SINGLE_UT))


def test_lengths_are_those_that_a_target_wants() -> None:
    """1024 of INAV, 2048 of Paparazzi."""
    given = sensor(1, "counts", keeps="diagonal")
    raw = readings(given) / COUNT_UT
    npt.assert_allclose(np.linalg.norm(inav(rendered("inav", given), raw), axis=1), 1024, rtol=0.01)
    npt.assert_allclose(np.linalg.norm(paparazzi(rendered("paparazzi", given), raw), axis=1), 2048, rtol=0.01)


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_compass_that_is_mounted_at_an_angle(name: str) -> None:
    """ROLL_180_YAW_45: a log of ArduPilot is in the axes of the vehicle, one of PX4 in those of the sensor."""
    mounting = euler(180, 0, 45)
    truth = sensor(4, "uT")
    seen = readings(truth)  # in the axes of the sensor
    in_vehicle = truth.apply(seen) @ mounting.T
    if name == "ardupilot":
        turned = replace(truth, matrix=mounting @ truth.matrix @ mounting.T, offset=mounting @ truth.offset)
        found = 0.1 * ardupilot(rendered(name, turned), 10 * seen @ mounting.T)
    else:
        found = 100 * px4(rendered(name, truth), seen / 100) @ mounting.T
    npt.assert_allclose(found, in_vehicle, atol=SINGLE_UT)


def test_signs_worked_by_hand() -> None:
    """An offset of +10, −20, +30 µT: who adds, who subtracts, and in which unit."""
    given = Calibration(np.diag([1.25, 1.0, 0.8]), np.array([10.0, -20, 30]), 50.0, raw=Unit.of("uT"))
    assert "COMPASS_OFS_X,-100\nCOMPASS_OFS_Y,200\nCOMPASS_OFS_Z,-300\n" in rendered("ardupilot", given).text
    assert_sentences(rendered("px4-shell", given).text)
    assert "initial_mag_bias_y: -2.000000000e-05\n" in rendered("ros-pipeline", given).text
    counts = replace(given, matrix=np.diag([1.0, 1.0, 1.0]), raw=Unit.of("counts", 0.1))
    assert "set mag_calibration = 100,-200,300\n" in rendered("betaflight", counts).text
    assert "set maggain_x = 500\n" in rendered("inav", counts).text


def test_which_compass() -> None:
    given = sensor(0)
    assert "COMPASS_OFS2_X," in rendered("ardupilot", given, compass=2).text
    assert "CAL_MAG3_XOFF" in rendered("px4", given, compass=3).text
    with assert_raises(UsageError):
        rendered("ardupilot", given, compass=0)


@pytest.mark.parametrize("name", ["betaflight", "inav", "paparazzi", "ros-madgwick"])
def test_soft_iron_that_has_no_room_is_refused_with_what_it_costs(name: str) -> None:
    unit = "mG" if name == "ros-madgwick" else "counts"
    given = sensor(2, unit)
    with assert_raises(NotExportable, beyond=("matrix",), numbers=False) as caught:
        rendered(name, given)
    told = caught.value.evidence["heading_deg"]
    export = rendered(name, given, lossy=True)
    assert export.fields["checked"]["heading_deg"] == told
    assert_sentences(export.warnings)


def test_soft_iron_that_costs_little_is_written_with_a_warning() -> None:
    matrix = np.diag([1.003, 1.0, 0.998])
    given = Calibration(matrix, np.array([5.0, 6, 7]), 50.0, raw=Unit.of("uT"))
    export = rendered("ros-madgwick", given)
    (warning,) = export.warnings
    assert_sentences(warning)
    assert "# imu_filter_madgwick holds" in export.text


def test_the_heading_error_told_is_the_worst_of_all_attitudes() -> None:
    """Held so that the vertical is anywhere 30° from the field, the dip being 60°."""
    given = sensor(3, "mG", keeps="diagonal")
    export = rendered("ros-madgwick", given, lossy=True)
    told = export.fields["checked"]["heading_deg"]
    field = simulate.uniform_directions(np.random.default_rng(1), 2000)
    found = 1e6 * madgwick(export, given.unapply(given.field_strength * field) * 1e-6)
    worst = 0.0
    for angle in np.arange(0, 2 * np.pi, 0.1):
        first = np.cross(field, np.roll(field, 1, axis=1))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        across = np.cos(angle) * first + np.sin(angle) * np.cross(field, first)
        down = np.cos(np.deg2rad(30)) * field + np.sin(np.deg2rad(30)) * across
        level = [vector - np.sum(vector * down, axis=1, keepdims=True) * down for vector in (field, found)]
        cosine = np.sum(level[0] * level[1], axis=1) / np.prod([np.linalg.norm(each, axis=1) for each in level], axis=0)
        worst = max(worst, float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1)).max())))
    assert worst == pytest.approx(told, rel=0.05)
    assert worst <= told * 1.02


def test_a_rotation_that_a_symmetric_matrix_cannot_hold_is_refused() -> None:
    given = replace(sensor(1), matrix=euler(0, 0, 5) @ sensor(1).matrix, rotation="estimated")
    for name in ("ardupilot", "px4"):
        with assert_raises(NotExportable, beyond=("matrix",)):
            rendered(name, given)


@pytest.mark.parametrize(
    "name",
    [
        "betaflight",
        "inav",
    ],
)
def test_whole_numbers_that_are_too_large_are_named(name: str) -> None:
    with assert_raises(NotExportable):
        rendered(name, Calibration(np.eye(3), np.array([40000.0, 0, 0]), 500.0))


@pytest.mark.parametrize("name", ["inav", "paparazzi"])
def test_an_axis_that_would_be_turned_over_is_refused(name: str) -> None:
    mirrored = Calibration(np.diag([1.0, 1, -1]), np.array([1.0, 2, 3]), 500.0, rotation="composed")
    with assert_raises(NotExportable):
        rendered(name, mirrored)


def test_radii_alone_leave_the_strength_open() -> None:
    """As for a fit without a field strength, the matrix has determinant 1 then."""
    for name in ("inav", "paparazzi"):
        _, back = read_back(rendered(name, sensor(3, "counts", keeps="diagonal")).text.encode(), "file")
        assert not back.field_strength_known
        assert np.linalg.det(back.matrix) == pytest.approx(1)


def test_settings_are_found_in_a_whole_dump() -> None:
    """Of a board with profiles that hold other names again and again, and pins called COMPASS."""
    dump = (
        "# dump\n# Betaflight / STM32F7X2 4.5.0\nresource COMPASS_CS 1 NONE\nset gyro_lpf = 1\n"
        "SET MAG_CALIBRATION = 12,-7,3 \nprofile 0\nset p_roll = 45\nprofile 1\nset p_roll = 50\n"
    )
    name, back = read_back(dump.encode(), "dump.txt", strength=500.0)
    assert (name, back.offset.tolist()) == ("betaflight", [12.0, -7.0, 3.0])
    six = "".join(
        f"set mag{kind}_{axis} = {value}\n" for kind, value in (("zero", -5), ("gain", 1024)) for axis in "xyz"
    )
    name, back = read_back(b"# INAV\r\n" + six.replace("\n", "\r\n").encode(), "dump.txt")
    assert name == "inav"
    assert back.field_strength == pytest.approx(1024)


def test_an_airframe_is_read_without_what_is_commented_out() -> None:
    rows = [f"<define name='IMU_MAG_{axis}_{kind}' value=' {value} ' integer='16'/>"
            for kind, value in (("NEUTRAL", -20), ("SENS", 4.0)) for axis in "XYZ"]  # fmt: skip
    old = '<!-- <define name="MAG_X_NEUTRAL" value="99"/> <!-- -->'
    airframe = f'<airframe><section name="IMU">{old}{"".join(rows)}<define name="MAG_X_SIGN" value="1"/></section>'
    name, back = read_back(airframe.encode(), "airframe.xml")
    assert (name, back.offset.tolist()) == ("paparazzi", [-20.0] * 3)
    assert back.field_strength == pytest.approx(512)
    unclosed = airframe + '<!-- <define name="MAG_X_NEUTRAL" value="99"/>'
    assert read_back(unclosed.encode(), "airframe.xml")[1].isclose(back)


def test_a_vehicle_with_several_compasses_asks_which() -> None:
    both = "\n".join(rendered("ardupilot", sensor(n), compass=n).text for n in (1, 2)).encode()
    with assert_raises(DocumentError):
        read_back(both, "vehicle.param")
    _, second = read_back(both, "vehicle.param", compass=2)
    npt.assert_allclose(second.offset, sensor(2).offset, atol=1e-4)
    with assert_raises(DocumentError):
        read_back(both, "vehicle.param", compass=3)


INAV = b"".join(b"set mag%b_%c = %d\n" % (kind, axis, number) for kind, number in ((b"zero", -5), (b"gain", 1024))
                for axis in b"xyz")  # fmt: skip
AIRFRAME = b"".join(b'<define name="MAG_%c_%b" value="%b"/>' % (axis, kind, number)
                    for kind, number in ((b"NEUTRAL", b"-20"), (b"SENS", b"4.0")) for axis in b"XYZ")  # fmt: skip


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b"initial_mag_bias_x: 1\n",
        b"initial_mag_bias_x: 1\ninitial_mag_bias_y: 1\ninitial_mag_bias_z: 1\n",
        b"COMPASS_OFS_X,hello\n",
        b"COMPASS_DEC,0.1\n",
        b"1\t1\tCAL_MAG_SIDES\t63\t6\n",
        b"COMPASS_OFS_X \xff\n",
        b"set mag_calibration = 1,2\n",
        b"set mag_calibration = 1,2,x\n",
        b"set mag_calibration = 1,2,0.5\n",
        b"set mag_calibration = 1,2,40000\n",
        b"set mag_calibration = 1,2,3\nset mag_calibration = 1,2,4\n",
        b"set mag_calibration = 1,2,3\n",
        b"set magzero_x = 1\nset magzero_y = 1\nset magzero_z = 1\n",
        INAV.replace(b"1024", b"0"),
        AIRFRAME.replace(b'"4.0"', b'"-4.0"'),
        AIRFRAME.replace(b'"-20"', b'"-20.5"'),
        AIRFRAME.replace(b"MAG_Z_SENS", b"MAG_Z_SIGN"),
        AIRFRAME + b'<define name="IMU_MAG_X_SENS" value="5"/>',
        b'<define name="MAG_X_NEUTRAL" value="1"/>',
    ],
)
def test_files_that_are_damaged_or_none_are_refused_with_a_message(content: bytes) -> None:
    with assert_raises(InputError):
        read_back(content, "file")


IN_COUNTS = [name for name in READABLE if find(name).unit == "counts"]


@pytest.mark.parametrize("axes", ["x,y,z", "-z,x,-y"])
@pytest.mark.parametrize("name", IN_COUNTS)
def test_what_was_written_in_counts_is_read_back(name: str, axes: str) -> None:
    """Within half a count of offset and half a step of gain; what is written again is the same to the letter."""
    row = find(name)
    is_mapped = row.acts == "mapped"
    given = sensor(7, "counts", axes, keeps="offset" if row.keeps == "offset" else "diagonal")
    text = rendered(name, given).text
    found, back = read_back(text.encode(), "file", strength=given.field_strength / COUNT_UT)
    assert found == name
    assert (back.unit, back.frame) == ("counts", "vehicle" if is_mapped else "sensor")
    recorded = readings(given)
    out = COUNT_UT * back.apply((given.axes.apply(recorded) if is_mapped else recorded) / COUNT_UT)
    expected = given.apply(given.axes.apply(recorded))
    if not is_mapped:
        out = given.axes.apply(out)
    assert np.linalg.norm(out - expected, axis=1).max() <= BOUND_UT.get(name, BOUND_UT["paparazzi"])
    again = row.render(back, asked=ExportOptions(lossy=True)).text
    settings = [line for line in text.splitlines() if line.startswith(("set ", "<define"))]
    assert [line for line in again.splitlines() if line.startswith(("set ", "<define"))] == settings
