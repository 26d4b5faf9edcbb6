"""How a sensor sits, in the settings of systems: put through each system's own formula, it is the calibration.

The formulas stand here a second time, from their sources: what the program before the mounting does, S (m − b) in the
sensor's own axes, then the system's own turn.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sentences import assert_raises
from tests.trials import examples

from flinders import fit, simulate
from flinders.core.axes import AXIS_ROTATIONS, SIGNED_PERMUTATIONS, Axes, nearest_axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import DocumentError, NotExportable
from flinders.fitting.export import export_fit
from flinders.geometry.rotation import rotations
from flinders.likelihood.site_field import Site
from flinders.targets import ExportOptions, find, read_back, registry
from flinders.targets._mounting import apart_deg, euler
from flinders.targets._placement import right_angled_axes
from flinders.targets._target import MOUNTING_KINDS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.targets import Export

ROWS = [row for row in registry().values() if row.keeps in MOUNTING_KINDS]
SOFT = np.array([[1.05, 0.04, -0.02], [0.04, 0.93, 0.03], [-0.02, 0.03, 1.1]])
OFFSET = np.array([10.0, -20.0, 30.0])


def sensor(turn: Floats, axes: str = "x,y,z", frame: str = "sensor") -> Calibration:
    """With a rotation into the body, of readings whose axes were mapped before."""
    return Calibration(
        turn @ SOFT, OFFSET, 48.0, rotation="estimated", raw=Unit.of("uT"), axes=Axes.of(axes), frame=frame
    )


def rotation_in(export: Export) -> Floats:
    """(3, 3) from the sensor's axes to the body's, by the system's own formula."""
    return FORMULAS[export.target](re.sub(r"/\*.*?\*/|<!--.*?-->|^#.*?$", "", export.text, flags=re.DOTALL | re.M))


def iio(text: str) -> Floats:
    """mount-matrix.txt: x' = mxx x + myx y + mzx z, and so on, with mxx, myx, mzx the first three strings."""
    mxx, myx, mzx, mxy, myy, mzy, mxz, myz, mzz = map(float, re.findall(r'"(\S+?)"', text))
    return np.array([[mxx, myx, mzx], [mxy, myy, mzy], [mxz, myz, mzz]])


def android(text: str) -> Floats:
    """AdditionalInfoType: "the inverse of the matrix applied to raw samples", as [R; t]."""
    rows = np.array([float(word) for word in re.findall(r"(-?\d+\.\d*(?:e[-+]?\d+)?)f", text)]).reshape(3, 4)
    npt.assert_array_equal(rows[:, 3], 0.0)
    return np.linalg.inv(rows[:, :3])


def zephyr(text: str) -> Floats:
    """icm4268x.c: value[i] = axis_align[i].sign * readings[axis_align[i].index], with sign the property less 1."""
    named = dict(re.findall(r"(axis-align-\S+) = <SENSOR_AXIS_ALIGN_DT_(\w+)>", text))
    rows = np.zeros((3, 3))
    for place, name in enumerate("xyz"):
        sign = {"NEG": 0, "POS": 2}[named[f"axis-align-{name}-sign"]] - 1
        rows[place, "XYZ".index(named[f"axis-align-{name}"])] = sign
    return rows


def c_axes(text: str) -> Floats:
    rows = np.zeros((3, 3))
    for place, (sign, index) in enumerate(re.findall(r"[xyz] = (-?)sensor\[(\d)\]", text)):
        rows[place, int(index)] = -1 if sign else 1
    return rows


def of_quaternion(x: float, y: float, z: float, w: float) -> Floats:
    """v' = v + 2 u × (u × v + w v), of each unit vector."""
    u = np.array([x, y, z])
    return np.stack([v + 2 * np.cross(u, np.cross(u, v) + w * v) for v in np.eye(3)], axis=1)


def urdf(text: str) -> Floats:
    """pose.h, setFromRPY: the quaternion of half angles; its rotation takes the child's vectors to the parent."""
    origin = ElementTree.fromstring(f"<robot>{text}</robot>").find("joint/origin")  # ours
    assert origin is not None
    roll, pitch, yaw = (float(word) / 2 for word in origin.get("rpy", "").split())
    sr, sp, sy, cr, cp, cy = *map(math.sin, (roll, pitch, yaw)), *map(math.cos, (roll, pitch, yaw))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return of_quaternion(x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


def transform(text: str) -> Floats:
    """static_transform_broadcaster_program.cpp: --qx --qy --qz --qw, of the child's frame in that of frame_id."""
    assert ("--frame-id imu_link " in text, "--child-frame-id magnetometer" in text) == (True, True)
    given = dict(re.findall(r"--(q[xyzw]) (\S+)", text))
    return of_quaternion(*(float(given[name]) for name in ("qx", "qy", "qz", "qw")))


FORMULAS: dict[str, Callable[[str], Floats]] = {
    "iio-mount-matrix": iio,
    "android-placement": android,
    "zephyr-axis-align": zephyr,
    "c-axes": c_axes,
    "urdf": urdf,
    "static-transform": transform,
}
FREE = [row.name for row in ROWS if row.keeps == "rotation"]


def test_each_has_its_formula_here() -> None:
    assert set(FORMULAS) == {row.name for row in ROWS}


def assert_corrects(export: Export, given: Calibration, mounting: Floats | None = None) -> None:
    """S (m − b) as the file says, and the system's turn, is the calibration's field in the axes of the body."""
    raw = simulate.uniform_directions(np.random.default_rng(1), 200) * 60.0
    values = export.fields["values"]
    found = (raw - values["offset"]) @ np.asarray(values["matrix"]).T @ rotation_in(export).T
    after = np.eye(3) if mounting is None else mounting
    if given.frame == "vehicle":  # what was recorded is mounted already, and the calibration's own mapping goes
        expected = given.apply(given.axes.apply(raw @ after.T)) @ given.axes.apply(np.eye(3)).T
    else:
        expected = given.apply(given.axes.apply(raw)) @ after.T
    npt.assert_allclose(found, expected, atol=1e-4)
    assert export.fields["checked"]["worst"] < 1e-4


@pytest.mark.parametrize("axes", ["x,y,z", "y,-x,z", "-z,x,-y"])
@pytest.mark.parametrize("name", FREE)
def test_the_systems_own_formula_gives_the_calibration(name: str, axes: str) -> None:
    """With any rotation, of readings whose axes were mapped; of a vehicle's, with the mounting in force."""
    for turn in rotations(np.random.default_rng(3).normal(scale=1.5, size=(5, 3))):
        assert_corrects(find(name).render(sensor(turn, axes)), sensor(turn, axes))
        mounting = euler(30.0, -50.0, 110.0)
        for frame in ("vehicle", "sensor"):
            given = sensor(turn, axes, frame)
            assert_corrects(find(name).render(given, asked=ExportOptions(mounting=mounting)), given, mounting)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_all_right_angles_are_written_exactly_and_read_back(row: object) -> None:
    for axes in AXIS_ROTATIONS:
        given = sensor(axes.matrix)
        export = find(row.name).render(given, asked=ExportOptions(mounting=np.eye(3)))  # type: ignore[attr-defined]
        npt.assert_allclose(rotation_in(export), axes.matrix, atol=1e-9)
        assert_corrects(export, given)
        if find(export.target).reader is not None:
            name, back = read_back(export.text.encode(), "file")
            assert (name, back.axes) == (export.target, axes)
            npt.assert_array_equal(back.matrix, np.eye(3))


@pytest.mark.parametrize("name", FREE)
@given(vector=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
@examples(30)
def test_any_rotation_is_read_back(name: str, vector: list[float]) -> None:
    turn = rotations(np.array(vector))
    export = find(name).render(sensor(turn), asked=ExportOptions(mounting=np.eye(3)))
    back = read_back(export.text.encode(), "file")[1]
    axes = right_angled_axes(turn)  # one that is nearly so is written as that
    assert apart_deg(back.matrix @ back.axes.matrix, turn if axes is None else axes.matrix) < 1e-4


def test_examples_of_the_sources_mean_here_what_they_mean_there() -> None:
    """Of mount-matrix.txt, of AdditionalInfoType and of sensor-axis-align.yaml."""
    tilted = b'mount-matrix = "1", "0", "0",\n "0", "0.866", "0.5",\n "0", "-0.5", "0.866";'
    npt.assert_allclose(read_back(tilted, "a.dts")[1].matrix, euler(-30, 0, 0), atol=1e-4)
    buffer = b"x_placement[12] = {0, 1, 0, 0, -1, 0, 0, 10, 0, 0, 1, -2.5};"
    # the device's X is the sensor's −Y, its Y is the sensor's X
    assert str(read_back(buffer, "a.h")[1].axes) == "-y,x,z"
    top = (
        b"axis-align-x = <SENSOR_AXIS_ALIGN_DT_Y>\naxis-align-y = <SENSOR_AXIS_ALIGN_DT_X>\n"
        b"axis-align-y-sign = <SENSOR_AXIS_ALIGN_DT_NEG>\naxis-align-z = <SENSOR_AXIS_ALIGN_DT_Z>\n"
    )
    assert str(read_back(top, "a.dts")[1].axes) == "y,-x,z"
    assert str(read_back(b"0, 1, 0; 1, 0, 0; 0, 0, -1\n", "in_magn_mount_matrix")[1].axes) == "y,x,-z"


def test_a_joint_is_found_among_others_and_roll_pitch_yaw_is_read() -> None:
    robot = (
        b'<?xml version="1.0"?><robot><joint name="wheel" type="fixed"><child link="w"/></joint>'
        b'<joint name="top" type="fixed"><child link="Mag_link"/><origin rpy="0 0 1.5707963267949"/></joint></robot>'
    )
    assert str(read_back(robot, "robot.urdf")[1].axes) == "-y,x,z"
    line = b"ros2 run tf2_ros static_transform_publisher --yaw 1.5707963267949 --frame-id a --child-frame-id b"
    assert str(read_back(line, "tf.sh")[1].axes) == "-y,x,z"


@pytest.mark.parametrize(
    "text",
    [
        b'mount-matrix = "1", "0", "0";',
        b"2, 0, 0; 0, 1, 0; 0, 0, 1",
        b"<joint><child link='mag'/></joint><joint name='mag'/>",
        b"<joint name='mag'><origin rpy='0 0'/></joint>",
        b"<joint",
        b"static_transform_publisher --qx 1 --qw 1",
        b"axis-align-x = <5>;",
        b"x_placement[12] = {1, 2};",
    ],
)
def test_what_is_no_mounting_is_refused_with_a_message(text: bytes) -> None:
    with pytest.raises(DocumentError):
        read_back(text, "file")


# right angles where the recording says so


def test_right_angles_are_taken_within_three_sigma_and_not_beyond() -> None:
    """Of rotations that scatter about right angles by their claim, 0.27 % are not; of such 6 σ away none is."""
    rng = np.random.default_rng(1)
    spread = np.deg2rad(np.array([1.0, 0.5, 2.0]))
    covariance = np.diag(spread**2)
    taken = 0
    for vector in rng.normal(size=(1000, 3)) * spread:
        axes = AXIS_ROTATIONS[int(rng.integers(24))]
        taken += right_angled_axes(rotations(vector) @ axes.matrix, covariance) == axes
    assert 992 <= taken <= 1000
    off = rng.normal(size=(100, 3))
    off *= 6.0 / np.linalg.norm(off, axis=1, keepdims=True)
    assert not any(right_angled_axes(rotations(vector * spread), covariance) for vector in off)


def test_a_rotation_that_is_hardly_known_is_no_right_angle() -> None:
    assert right_angled_axes(euler(1, 1, 1), np.deg2rad(60.0) ** 2 * np.eye(3)) is None
    assert right_angled_axes(euler(0, 0, 45), np.deg2rad(15.0) ** 2 * np.eye(3)) is None


def test_what_is_taken_for_right_angles_says_so_and_is_checked_as_that() -> None:
    given = sensor(euler(0.4, -0.3, 90.5))
    known = ExportOptions(rotation_covariance=np.deg2rad(0.4) ** 2 * np.eye(3))
    export = find("iio-mount-matrix").render(given, asked=known)
    npt.assert_allclose(rotation_in(export), euler(0, 0, 90), atol=1e-12)
    assert export.fields["values"]["right_angled"] == "-y,x,z"
    npt.assert_allclose(export.fields["values"]["sigma_deg"], 0.4)
    assert export.fields["checked"]["worst"] < 1e-4
    unknown = find("iio-mount-matrix").render(given)
    npt.assert_allclose(rotation_in(unknown), euler(0.4, -0.3, 90.5), atol=1e-8)
    assert unknown.fields["values"]["right_angled"] is None


@pytest.mark.parametrize("name", [row.name for row in ROWS if row.keeps == "axes"])
def test_what_holds_right_angles_alone_refuses_others_with_what_it_costs(name: str) -> None:
    given = sensor(euler(0, 0, 95))
    with pytest.raises(NotExportable) as refused:
        find(name).render(given)
    cost = math.degrees(math.atan(math.tan(math.radians(5.0)) / math.cos(math.radians(60.0))))
    assert refused.value.evidence["heading_deg"] == pytest.approx(cost, rel=1e-3)
    lossy = find(name).render(given, asked=ExportOptions(lossy=True))
    npt.assert_allclose(rotation_in(lossy), euler(0, 0, 90), atol=1e-12)
    assert find(name).render(sensor(euler(0, 0, 90.2))).fields["checked"]["heading_deg"] == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_mounting_that_nobody_knows_is_refused_unless_it_is_said(row: object) -> None:
    target = find(row.name)  # type: ignore[attr-defined]
    plain = Calibration(SOFT, OFFSET, 48.0, raw=Unit.of("uT"))
    with pytest.raises(NotExportable):
        target.render(plain)
    said = target.render(plain, asked=ExportOptions(mounting=np.eye(3)))
    npt.assert_array_equal(rotation_in(said), np.eye(3))
    with pytest.raises(NotExportable):
        target.render(sensor(euler(0, 0, 90), frame="vehicle"))


# a mirrored sensor


MIRRORS = [axes for axes in SIGNED_PERMUTATIONS if axes.is_mirror]


@pytest.mark.parametrize("name", ["urdf", "static-transform", "android-placement"])
def test_what_holds_rotations_refuses_a_mirrored_sensor_and_names_the_axis(name: str) -> None:
    for axes, axis in (("-x,y,z", "x"), ("x,-y,z", "y"), ("x,y,-z", "z")):
        with pytest.raises(NotExportable) as refused:
            find(name).render(sensor(euler(0, 0, 3), axes))
        assert (refused.value.evidence["axis"], refused.value.evidence["axes"]) == (axis, "x,y,z")
    for mirror in MIRRORS:
        with pytest.raises(NotExportable) as refused:
            find(name).render(sensor(np.eye(3), str(mirror)))
        assert not Axes.of(str(refused.value.evidence["axes"])).is_mirror


@pytest.mark.parametrize("name", ["iio-mount-matrix", "zephyr-axis-align", "c-axes"])
def test_what_holds_signs_of_axes_writes_a_mirrored_sensor_and_reads_it_back(name: str) -> None:
    for mirror in MIRRORS:
        given = sensor(np.eye(3), str(mirror))
        export = find(name).render(given)
        npt.assert_array_equal(rotation_in(export), mirror.matrix)
        assert_corrects(export, given)
        if find(name).reader is not None:
            assert read_back(export.text.encode(), "file")[1].axes == mirror


def test_a_mirrored_sensor_from_its_recording_to_its_mounting() -> None:
    """The axes that the finding names mend it: corrected readings are the true field, in the axes of the body."""
    true = simulate.tumble(seed=3, motion="swayed", n=1500, dip_deg=60.0)
    mounted = euler(1.0, -2.0, 91.0) @ np.diag([1.0, -1.0, 1.0])
    recorded = replace(true.samples, field=true.samples.field @ mounted)
    site = Site(None, 60.0, inclination_sigma_deg=1.0)
    wrong = fit(recorded, aiding=("dip", "rate"), site=site)
    finding = next(one for one in wrong.findings if one.code == "mirrored-axis")
    axes = Axes.of(str(finding.values["axes"]))
    assert axes == nearest_axes(mounted)
    assert finding.values["axis"] == axes.mirrored_axis
    for name in ("urdf", "iio-mount-matrix"):
        with assert_raises(NotExportable, beyond=("rotation",)):
            export_fit(wrong, find(name))

    found = fit(recorded.map_axes(axes), aiding=("dip", "rate"), site=site)
    codes = {one.code for one in found.findings}
    assert "mirrored-axes" in codes
    assert not codes & {"mirrored-axis", "swapped-axes", "site-differs"}
    export, _ = export_fit(found, find("iio-mount-matrix"))
    values = export.fields["values"]
    assert np.linalg.det(rotation_in(export)) == pytest.approx(-1.0)
    corrected = (recorded.field - values["offset"]) @ np.asarray(values["matrix"]).T @ rotation_in(export).T
    field = np.linalg.solve(true.sensor.matrix, (true.samples.field - true.sensor.offset).T)
    cosine = np.sum(corrected * field.T, axis=1) / np.linalg.norm(corrected, axis=1) / np.linalg.norm(field, axis=0)
    assert np.rad2deg(np.arccos(np.median(cosine))) < 2.0
    with pytest.raises(NotExportable):
        export_fit(found, find("urdf"))


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_function_in_c_exchanges_axes(tmp_path: Path) -> None:
    axes = Axes.of("-z,x,-y")
    (tmp_path / "axes.h").write_text(find("c-axes").render(sensor(np.eye(3), str(axes))).text)
    placed = find("android-placement").render(sensor(np.eye(3), str(axes)), asked=ExportOptions(name="top"))
    (tmp_path / "placement.h").write_text(placed.text)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "axes.h"\n#include "placement.h"\n'
        "int main(void) { float v[3] = {1, 2, 3}; magnetometer_to_body(v, v);"
        ' printf("%g %g %g %g\\n", v[0], v[1], v[2], top_placement[1]); return 0; }\n'
    )
    program = tmp_path / "main"
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-o", str(program), str(tmp_path / "main.c")]
    subprocess.run(command, check=True)
    out = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.split()
    npt.assert_array_equal([float(word) for word in out[:3]], axes.apply([1.0, 2.0, 3.0]))
