"""Tables of many columns: the magnetometer is chosen by what it is, and where that is not clear the user is asked."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly

import flinders
from flinders.cli import main
from flinders.errors import FlindersError, NoMagnetometer
from flinders.readers._columns_by_name import by_name
from flinders.readers._likeness import advice, groups, likeness

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

ROWS: Final = 400
HARD_IRON: Final = {"field": (30.0, -10.0, 5.0), "other field": (100.0, 10.0, -55.0)}


def directions(number: int, axes: int = 3) -> Floats:
    turned = np.random.default_rng(number).normal(size=(ROWS, axes))
    found: Floats = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return found


def noise(number: int, scale: float, axes: int = 3) -> Floats:
    found: Floats = np.random.default_rng(number).normal(size=(ROWS, axes)) * scale
    return found


SENSORS: Final[dict[str, Floats]] = {
    "time": np.arange(ROWS)[:, None] / 50,
    "acceleration": 9.81 * directions(1) + noise(2, 0.05),
    "acceleration in g": 1.0 * directions(3) + noise(4, 0.02),
    "acceleration in counts": 16384 * directions(5) + noise(6, 200),
    "rate": noise(7, 0.8),
    "rate in dps": noise(8, 60),
    "quaternion": directions(9, axes=4),
    "field": 48 * directions(10) + HARD_IRON["field"] + noise(11, 0.3),
    "other field": 480 * directions(12) + HARD_IRON["other field"] + noise(13, 3),
}
"""What stands side by side here; the fields are in µT and in mG."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty one to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(name: str, header: str, *sensors: str) -> Path:
    rows = np.column_stack([SENSORS[sensor] for sensor in sensors])
    delimiter = ";" if ";" in header else ","
    body = "\n".join(delimiter.join(f"{value:.6g}" for value in row) for row in rows)
    path = Path(name)
    path.write_text(f"{header}\n{body}\n" if header else f"{body}\n")
    return path


def run(line: str) -> Result:
    return CliRunner().invoke(main, shlex.split(line))


def xyz(*sensors: str) -> list[str]:
    return [f"{sensor}{axis}" for sensor in sensors for axis in "xyz"]


# what names say


@pytest.mark.parametrize(
    ("names", "sensors"),
    [
        (xyz("lis3mdl_"), ["lis3mdl_x"]),
        (xyz("LIS3MDL"), ["LIS3MDLx"]),
        (xyz("lsm6dsox_", "lis3mdl_"), ["lis3mdl_x"]),
        (xyz("adxl345_", "itg3200_", "hmc5883l_"), ["hmc5883l_x"]),
        (xyz("mpu6050_", "qmc5883l_"), ["qmc5883l_x"]),
        (xyz("rm3100_", "mmc5983ma_"), ["rm3100_x", "mmc5983ma_x"]),
        (xyz("mag_", "lis3mdl_"), ["mag_x", "lis3mdl_x"]),
        (xyz("lis3mdl_1_", "lis3mdl_2_"), ["lis3mdl_1_x", "lis3mdl_2_x"]),
        (xyz("mpu9250_a", "mpu9250_g", "mpu9250_m"), ["mpu9250_mx"]),
        (xyz("LSM303A_", "LSM303M_"), ["LSM303M_x"]),
        (xyz("lsm9ds1_acc_", "lsm9ds1_mag_"), ["lsm9ds1_mag_x"]),
        (xyz("imu_a", "imu_g", "imu_m"), ["imu_mx"]),
        (xyz("imu_m", "mag_", "imu_a", "imu_g"), ["imu_mx", "mag_x"]),
        (xyz("mag_", "imu_a", "imu_g", "imu_m"), ["mag_x", "imu_mx"]),
        (xyz("imu1_m", "imu2_m"), ["imu1_mx", "imu2_mx"]),
        (xyz("left_m", "right_m"), ["left_mx", "right_mx"]),
        (xyz("imu_m", "rm3100_"), ["imu_mx", "rm3100_x"]),
        (xyz("mag_", "lis3mdl_cal_"), ["mag_x"]),
        (["q0", "q1", "q2", "q3", *xyz("mag_")], ["mag_x"]),
    ],
)
def test_prefixes_name_sensors_and_chips_say_what_they_measure(names: list[str], sensors: list[str]) -> None:
    found = by_name(names, np.zeros((2, len(names))))
    assert found is not None
    assert [each.field.names[0] for each in found.magnetometers or (found,)] == sensors


@pytest.mark.parametrize(
    "names",
    [
        xyz("mpu6050_"),
        xyz("adxl345_"),
        xyz("lsm303_"),
        xyz("mpu9250_"),
        xyz("imu_"),
        xyz("imu_b"),
        ["imu_b_x", "imu_b_y", "imu_b_z"],
        xyz("sensor_a"),
        xyz("pos_m"),
    ],
)
def test_names_that_do_not_say_it_are_no_magnetometer(names: list[str]) -> None:
    assert by_name(names, np.zeros((2, len(names)))) is None


def test_accelerometer_and_gyro_of_a_device_go_with_its_magnetometer() -> None:
    found = by_name(xyz("imu_a", "imu_m", "mag_", "acc_"), np.zeros((2, 12)))
    assert found is not None
    beside = [each.of_kind("acceleration") for each in found.magnetometers]
    assert [column and column.names[0] for column in beside] == ["imu_ax", "acc_x"]


def test_a_chip_is_named_in_the_first_line() -> None:
    found = flinders.open_recording(write("chip.csv", ",".join(xyz("lsm6dsox_", "lis3mdl_")), "acceleration", "field"))
    assert_sentences(str(found))


# headers of two lines


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("time,Accelerometer,,,Magnetometer,,\n,x,y,z,x,y,z", xyz("Magnetometer ")),
        (",acc,acc,acc,mag,mag,mag\nt,x,y,z,x,y,z", xyz("mag ")),
        ("t,Acc,,,Mag\ns,x,y,z,x,y,z", xyz("Mag ")),
        ("time,Accelerometer,,,Magnetometer,,\n,x,y,z,x,y,z\ns,m/s2,m/s2,m/s2,uT,uT,uT", xyz("Magnetometer ")),
        (",acc,acc,acc,mag,mag,mag\n,x,y,z,x,y,z\ntime,,,,,,", xyz("mag ")),
        ("# ,Accelerometer,,,Magnetometer,,\n# t,x,y,z,x,y,z", xyz("Magnetometer ")),
        (",IMU,,,LIS3MDL,,\nt,x,y,z,x,y,z", xyz("LIS3MDL ")),
        ("Time;Accelerometer [g];;;Magnetometer [µT];;\n[s];X;Y;Z;X;Y;Z", [f"Magnetometer {a} [µT]" for a in "XYZ"]),
        (",Accelerometer,,,Magnetometer,,\nt,X-axis,Y-axis,Z-axis,X-axis,Y-axis,Z-axis",
         [f"Magnetometer {axis}-axis" for axis in "XYZ"]),
    ],
)  # fmt: skip
def test_a_line_of_sensors_above_the_axes_is_part_of_their_names(header: str, columns: list[str]) -> None:
    path = write("grouped.csv", header, "time", "acceleration", "field")
    found = flinders.read(path, unit="uT")
    np.testing.assert_allclose(found.field, SENSORS["field"], rtol=1e-5)
    assert found.time is not None
    assert f"columns {', '.join(columns)} " in str(flinders.open_recording(path))
    assert run(f"info {path} --json").exit_code == 0


@pytest.mark.parametrize(
    "header", ["magnetometer log,2026-11-22\nt,x,y,z", "Device,Firmware,Rate,Range\nt,x,y,z", "t,x,y,z\ns,uT,uT,uT"]
)
def test_a_title_or_a_line_of_units_is_no_line_of_sensors(header: str) -> None:
    found = flinders.open_recording(write("titled.csv", header, "time", "field"))
    assert "columns x, y, z in" in str(found)


def test_a_header_of_two_lines_without_a_magnetometer_is_refused() -> None:
    path = write("none.csv", "time,Accelerometer,,,Gyroscope,,\n,x,y,z,x,y,z", "time", "acceleration", "rate")
    with assert_raises(NoMagnetometer):
        flinders.open_recording(path)


def test_a_corrected_copy_keeps_a_header_of_two_lines() -> None:
    header = "time,Accelerometer,,,Magnetometer,,\n,x,y,z,x,y,z"
    path = write("grouped.csv", header, "time", "acceleration", "field")
    run(f"calibrate {path} --unit uT -o c.json")
    assert run(f"apply c.json {path} -o copy.csv").exit_code == 0
    assert Path("copy.csv").read_text().startswith(f"{header}\n")
    strengths = np.linalg.norm(flinders.read("copy.csv").field, axis=1)
    np.testing.assert_allclose(strengths, 48.0, atol=2.0)


# what values say


@pytest.mark.parametrize(
    ("header", "sensors"),
    [
        ("", ("acceleration", "field")),
        ("", ("time", "field", "acceleration")),
        ("", ("time", "acceleration in counts", "rate", "field")),
        ("", ("acceleration", "rate in dps", "field")),
        ("", ("time", "acceleration in g", "rate", "other field")),
        ("", ("time", "quaternion", "acceleration", "rate", "field")),
        ("", ("field", "quaternion")),
        ("t,x,y,z,x,y,z", ("time", "acceleration", "field")),
        ("time,ch1,ch2,ch3,ch4,ch5,ch6,ch7,ch8,ch9", ("time", "acceleration", "rate", "field")),
        ("t,q0,q1,q2,q3,a,b,c", ("time", "quaternion", "field")),
        ("mpu9250_x,mpu9250_y,mpu9250_z,lsm303_x,lsm303_y,lsm303_z", ("acceleration", "field")),
        ("lat,lon,alt,u 1,u 2,u 3", ("field", "other field")),
    ],
)
def test_the_only_one_that_values_leave_is_proposed_and_what_is_proposed_works(
    header: str, sensors: tuple[str, ...]
) -> None:
    path = write("wide.csv", header, *sensors)
    with pytest.raises(NoMagnetometer):
        flinders.open_recording(path)
    ended = run(f"info {path}")
    assert ended.exit_code == 5
    (option,) = re.findall(r"if so, name them \((--columns (?:'[^']*'|\S+?))\)$", ended.stderr.strip())
    shown = run(f"info {path} --unit uT --json {option}")
    (command,) = json.loads(shown.stdout)["commands"]
    assert run(command.removeprefix("flinders ")).exit_code in {0, 3}
    offset = flinders.Calibration.load("calibration.json").offset
    name = "other field" if "other field" in sensors else "field"
    np.testing.assert_allclose(offset, HARD_IRON[name], atol=3.0)


@pytest.mark.parametrize("header", ["", "t,x,y,z,x,y,z"])
def test_of_two_that_may_be_it_both_are_named_with_their_strengths(header: str) -> None:
    ended = run(f"info {write('both.csv', header, 'time', 'other field', 'field')}")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)


def test_where_values_leave_none_that_is_said() -> None:
    ended = run(f"info {write('none.csv', '', 'time', 'quaternion', 'acceleration')}")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)


OTHERS: Final = tuple(name for name in SENSORS if "field" not in name)


@given(st.permutations([*OTHERS, "field"]), st.integers(2, len(OTHERS)))
def test_in_whatever_order_they_stand_nothing_but_the_magnetometer_is_proposed(order: list[str], most: int) -> None:
    sensors = [*order[:most], "field"] if "field" not in order[:most] else order[:most]
    values = np.column_stack([SENSORS[sensor] for sensor in sensors])
    first = 1 + sum(SENSORS[sensor].shape[1] for sensor in sensors[: sensors.index("field")])
    proposed = [group.columns for group in groups(values, range(values.shape[1])) if group.is_candidate]
    assert proposed == [f"{first},{first + 1},{first + 2}"]


def test_a_sensor_at_rest_is_judged_by_its_strength() -> None:
    levels = np.tile([0.3, -0.2, 9.78, 21.0, 4.0, -43.0, 0.0, 0.0, 0.0], (100, 1))
    still = np.column_stack([np.arange(100.0), levels + noise(1, 0.02, axes=9)[:100]])
    assert [group.names for group in groups(still, range(10)) if group.is_candidate] == [("5", "6", "7")]
    assert "strength" not in advice(groups(still, range(10)))[0]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("every", "counts"),
    [
        (4, {"field": (305, 305), "acceleration": (42, 134), "rate": (2, 106), "acceleration by hand": (0, 16)}),
        nightly(
            1, {"field": (1171, 1171), "acceleration": (157, 513), "rate": (12, 414), "acceleration by hand": (0, 56)}
        ),
    ],
)
def test_real_magnetometers_may_be_one_by_their_values_and_few_other_sensors_may(
    recordings: Callable[[str], Path], every: int, counts: dict[str, tuple[int, int]]
) -> None:
    """Stretches of 200 readings that may be a magnetometer's, and all there are; a night judges each."""
    judged: dict[str, list[bool]] = {"field": [], "acceleration": [], "rate": [], "acceleration by hand": []}
    for path in sorted(recordings(".").rglob("*")):
        if path.suffix not in {".csv", ".txt", ".npz", ".lis"}:
            continue
        try:
            samples = flinders.read(path)
        except FlindersError:
            continue
        is_by_hand = path.stem in {"acc", "acc_data", "icm_20948_cal_acc", "reference_magneto14_acc"}
        for kind in ("field", "acceleration", "rate"):
            values = getattr(samples, kind)
            for start in range(0, 0 if values is None else len(values) - 100, 200 * every):
                found = groups(values[start : start + 200], range(3))
                key = "acceleration by hand" if is_by_hand else kind
                judged[key].append(any(group.is_candidate for group in found))
    counted = {kind: (sum(each), len(each)) for kind, each in judged.items()}
    assert counted == counts


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("jremington_icm20948/icm_20948_get_cal_data_OUTPUT.txt", "4,5,6"),
        ("pichim_betaflight/20231014_apex5_mag_gyro.txt", "1,2,3"),
    ],
)
def test_of_real_captures_of_six_columns_the_magnetometer_is_proposed(
    recordings: Callable[[str], Path], name: str, columns: str
) -> None:
    with assert_raises(NoMagnetometer) as refused:
        flinders.open_recording(recordings(name))
    assert refused.value.hint == {"columns": columns}


# flinders info


@pytest.mark.parametrize(
    ("header", "sensors"),
    [
        ("t,x,y,z", ("time", "acceleration")),
        ("t,x,y,z", ("time", "acceleration in counts")),
        ("", ("acceleration in g",)),
    ],
)
def test_gravity_in_columns_without_telling_names_is_never_proposed(header: str, sensors: tuple[str, ...]) -> None:
    path = write("gravity.csv", header, *sensors)
    contents = json.loads(run(f"info {path} --json").stdout)
    assert contents["commands"] == []
    assert contents["sensors"][0]["resembles"].endswith(" g") or "m/s²" in contents["sensors"][0]["resembles"]
    told = " ".join(run(f"info {path}").stdout.split())
    found = re.search(r"name them \((--columns \S+)\)", told)
    assert found is not None
    assert json.loads(run(f"info {path} --json {found[1]}").stdout)["commands"]


@pytest.mark.parametrize("factor", [1.0, 9.80665, 1024.0])
def test_a_magnetometer_that_is_called_so_is_proposed_whatever_its_strength(factor: float) -> None:
    np.savez("normalised.npz", mag=factor * directions(1))
    contents = json.loads(run("info normalised.npz --json").stdout)
    assert_sentences(contents["commands"])


def test_info_numbers_each_magnetometer_with_its_strength_and_its_commands_work() -> None:
    header = ",".join(["time", *xyz("imu_a", "imu_g", "imu_m", "mag_"), "q0", "q1", "q2", "q3"])
    path = write("wide.csv", header, "time", "acceleration", "rate", "field", "other field", "quaternion")
    contents = json.loads(run(f"info {path} --json").stdout)
    assert [(one["number"], one["name"], round(one["strength"])) for one in contents["sensors"]] == [
        (1, "imu_m", 48), (2, "mag", 480),
    ]  # fmt: skip
    told = " ".join(run(f"info {path}").stdout.split())
    assert_sentences(told)
    assert "passed over: q0, q1, q2, q3 (a quaternion)" in told
    for command in contents["commands"]:
        assert run(command.removeprefix("flinders ").replace("-o ", "--force -o ")).exit_code in {0, 3}
    assert_sentences(run(f"calibrate {path} --unit uT -o one.json").stderr)


@pytest.mark.parametrize(("values", "says"), [
    (SENSORS["acceleration"], "gravity in m/s²"),
    (SENSORS["acceleration in counts"], "gravity in counts of 1/16384 g"),
    (directions(3), "a direction, or gravity in g"),
    (SENSORS["field"], ""),
    (1024 * directions(3) + 400, ""),
    (SENSORS["rate"], ""),
    (np.full((50, 3), np.nan), ""),
    (np.zeros((50, 3)), ""),
    (np.full((50, 3), 1e300), ""),
])  # fmt: skip
def test_likeness_is_told_where_it_is_plain(values: Floats, says: str) -> None:
    assert likeness(values) == says
