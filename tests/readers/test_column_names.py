"""What names of columns, labels and numbers of printed lines are taken for: one example of each rule."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from pyarrow import csv, parquet
from tests.sentences import assert_raises, assert_sentences

from flinders import fit, open_recording, simulate
from flinders.errors import UsageError
from flinders.readers._cells import decimal
from flinders.readers._clock import seconds_of
from flinders.readers._header import _with_sensors
from flinders.readers._instruments import polarities
from flinders.readers._likeness import ColumnGroup, advice, likeness
from flinders.readers._names import (
    Meaning,
    is_inconclusive,
    kind_of_chip,
    kind_of_no_readings,
    label,
    meaning,
    sensor_name,
)
from flinders.readers._refusals import ranges
from flinders.readers._times import reason_of_missing_digits
from flinders.readers._tokenizer import compile_pattern, names_of, pattern_of, split_line
from flinders.readers.dialects.json_records import flatten
from flinders.readers.dialects.wrapped import STAMP

if TYPE_CHECKING:
    from pathlib import Path


def test_columns_of_single_motors_are_recognised() -> None:
    assert meaning("esc[0].esc_current") == Meaning("currents", axis="0")
    assert (meaning("motor2").kind, meaning("current3_A").unit, meaning("current").kind) == (
        "throttles",
        "a",
        "current",
    )


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize(
    ("ending", "unit"),
    [
        ("_rad_s", "rad/s"),
        ("_deg_s", "deg/s"),
        ("_radians_per_second", "rad/s"),
        (" (deg s)", "deg/s"),
        ("_radps", "radps"),
        ("_s", ""),
    ],
)
def test_the_unit_of_a_rate_may_be_two_words(axis: str, ending: str, unit: str) -> None:
    found = meaning(f"gyro_{axis}{ending}")
    assert (found.kind, found.axis, found.unit) == ("rate", axis, unit)


@pytest.mark.parametrize(("name", "is_open"), [("ch4", True), ("x", True), ("acc_x", False), ("gps_lat", False)])
def test_a_name_that_says_nothing_may_be_an_axis(name: str, is_open: bool) -> None:
    assert is_inconclusive(name) == is_open


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mag_x", ()),
        ("imu1.mag.x (uT)", ("1",)),
        ("magX_left_raw", ("left",)),
        ("mag_rm3100_x", ("rm3100",)),
        ("my2", ("2",)),
        ("imu_mx", ("imu",)),
        ("lis3mdl_b_x", ("lis3mdl", "b")),
        ("mag_a_x", ("a",)),  # no ampere
        ("mag_x_t0", ("t0",)),  # no sensor 0
        ("mag_2_x_avg10", ("2",)),  # no sensor 10
    ],
)
def test_words_that_distinguish_a_sensor_are_its_label(name: str, words: tuple[str, ...]) -> None:
    assert label(name) == words


def test_a_chip_tells_what_it_measures_where_that_is_one_thing() -> None:
    chips = ("lis3mdl", "adxl345", "lsm303", "mag")
    assert tuple(map(kind_of_chip, chips)) == ("field", "acceleration", "", "")


def test_references_and_directions_are_no_readings() -> None:
    names = ("mag_x_wmm2025", "magNedX", "mag_unit_x", "unit2_mag_x")
    assert_sentences(tuple(map(kind_of_no_readings, names)))


@pytest.mark.parametrize(
    ("name", "axis", "sensor"),
    [
        ("mag1_x_uT", "x", "mag1"),
        ("Imu1.Mag.X (µT)", "x", "Imu1.Mag"),
        ("raw_mag_x_2", "x", "mag_2"),
        ("mx0", "x", "m0"),
        ("x2", "x", "xyz2"),
        ("mag1[0]", "0", "mag1"),
    ],
)
def test_a_sensor_is_called_what_its_columns_share(name: str, axis: str, sensor: str) -> None:
    assert sensor_name(name, axis) == sensor


def test_the_whole_name_of_a_sensor_lacks_its_axis_alone() -> None:
    assert sensor_name("raw_mag_x_uT", "x", whole=True) == "raw_mag_uT"


def test_sensors_in_a_line_of_their_own_are_put_before_the_axes_below_them() -> None:
    titles = ["", "Acc [g]", "", "", "Mag [uT]", "", ""]
    joined = _with_sensors(["t", "x", "y", "z", "x", "y", "z"], titles)
    assert joined[3:] == ["Acc z [g]", "Mag x [uT]", "Mag y [uT]", "Mag z [uT]"]
    assert _with_sensors(["t", "x", "y", "z"], ["recorded with a magnetometer", "2026-11-22"]) == []


def test_ranges_of_nameless_columns_are_listed() -> None:
    assert (
        ranges(np.array([[0.0, -301.5, np.nan], [0.25, 299.0, np.nan]]))
        == "1: 0 to 0.250, 2: -302 to 299, 3: no numbers"
    )


def test_a_time_cut_to_float32_is_not_a_buffer_of_readings() -> None:
    times = np.repeat([1732190000.0, 1732190128.0, 1732190256.0], 60)
    assert_sentences(reason_of_missing_digits(times.astype(np.float32).astype(float), "s"))
    assert reason_of_missing_digits(np.repeat([0.000, 0.320, 0.641, 0.960], 32), "s") == ""  # a buffer of 32


def test_gravity_is_known_by_its_length_and_a_magnetometer_is_not() -> None:
    assert likeness(np.tile([[0.1, -0.2, 9.8]], (20, 1))) == "gravity in m/s²"
    assert likeness(np.tile([[10.0, -20.0, 40.0]], (20, 1))) == ""


def test_advice_has_a_hint_for_the_columns_that_may_be_a_magnetometer() -> None:
    judged = [
        ColumnGroup(("1", "2", "3"), "a direction"),
        ColumnGroup(("4", "5", "6"), "strength 48.0", is_candidate=True),
    ]
    words, hint = advice(judged)
    assert hint == {"columns": "4,5,6"}
    assert_sentences(words)


def test_lines_with_the_same_gaps_have_their_numbers_found_at_once() -> None:
    match = compile_pattern(split_line("X: 1 Y: -2 uT")[1]).fullmatch("X:  10.5 \tY: 3 uT")
    assert match is not None
    assert match.groups() == ("10.5", "3")


def test_hexadecimal_numbers_with_all_their_digits_are_signed() -> None:
    numbers = ("0xFFFFFF38", "0x1F", "-0x10", "ovf", "-1.50")
    assert tuple(map(decimal, numbers)) == ("-200", "31", "-16", "nan", "-1.50")


def test_a_line_is_written_as_the_pattern_of_lines_like_it() -> None:
    assert pattern_of("<39.2/31.4/28.7/0>") == "<{x}/{y}/{z}/{n4}>"


def test_numbers_behind_one_label_are_its_axes() -> None:
    assert names_of(split_line("A: 12 -3 8190 M: 217 4 -586")[1]) == ("A x", "A y", "A z", "M x", "M y", "M z")
    assert names_of(split_line("Heading: 123.4 X: 1 Y: 2 Z: 3")[1]) == ("Heading", "X", "Y", "Z")


def test_words_of_registers_are_signed_and_stamps_count_from_midnight() -> None:
    assert split_line("0xFF38 0x0010")[0] == ["-200", "16"]
    stamp = STAMP.match("14:03:00.250 -> X: 1")
    assert stamp is not None
    assert seconds_of(stamp) == 50580.25


def test_keys_inside_objects_get_dots() -> None:
    assert flatten({"t": 1, "mag": {"x": 2, "y": [3]}}) == {"t": 1, "mag.x": 2, "mag.y.0": 3}


# pairs of readings after a set and a reset pulse

OWN_UT = np.array([150.0, -80.0, 40.0])


def pairs(folder: Path, *, named: str = "mag_{axis}_{pulse}_uT", sign: float = -1.0) -> Path:
    """A tumble of a sensor that flips its field with each pulse, and has an own offset that creeps by 20 µT."""
    tumble = simulate.tumble(seed=3, n=1500)
    time = tumble.samples.time
    assert time is not None
    own = OWN_UT + np.linspace(0.0, 20.0, 1500)[:, np.newaxis]
    noise = 0.5 * np.random.default_rng(1).normal(size=(1500, 3))
    header = ["t_s", *(named.format(axis=axis, pulse=pulse) for pulse in ("set", "reset") for axis in "xyz")]
    rows = np.hstack([time[:, np.newaxis], own + tumble.samples.field, own + sign * tumble.samples.field])
    rows[:, 4:] += noise
    path = folder / "pairs.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(header), comments="", fmt="%.3f")
    return path


@pytest.mark.parametrize("named", ["mag_{axis}_{pulse}_uT", "{axis}_{pulse}", "{pulse}_{axis}", "m{axis}_{pulse}"])
def test_set_and_reset_cancel_the_sensors_own_offset(named: str, tmp_path: Path) -> None:
    path = pairs(tmp_path, named=named)
    recording: Any = open_recording(path, unit="uT")
    assert "less" in recording.describe()
    assert_sentences(recording.describe())
    found, truth = fit(path, unit="uT"), simulate.tumble(seed=3, n=1500).sensor
    assert found.verdict == "good"
    npt.assert_allclose(found.calibration.offset, truth.offset, atol=0.2)


def test_a_table_of_pairs_is_read_as_its_text(tmp_path: Path) -> None:
    path = pairs(tmp_path)
    parquet.write_table(csv.read_csv(path), tmp_path / "pairs.parquet")
    text, table = (
        np.concatenate([block.field for block in open_recording(each).blocks()])
        for each in (path, tmp_path / "pairs.parquet")
    )
    npt.assert_allclose(table, text, atol=1e-9)


def test_pairs_that_are_alike_are_no_pairs(tmp_path: Path) -> None:
    recording: Any = open_recording(pairs(tmp_path, sign=1.0))
    said = recording.describe()
    assert "less" not in said
    assert_sentences(said)


def test_corrected_pairs_get_columns_of_their_own(tmp_path: Path) -> None:
    recording: Any = open_recording(pairs(tmp_path))
    with assert_raises(UsageError):
        next(recording.corrected_lines(lambda field: field))
    header = next(recording.corrected_lines(lambda field: field, add=True))
    assert header.rstrip().endswith("mag_x_set_uT_cal,mag_y_set_uT_cal,mag_z_set_uT_cal")


def test_a_set_without_its_reset_is_a_name_like_any_other() -> None:
    assert polarities(["mag_x_set", "mag_y_set", "reset", "setpoint", "offset_x"]) == {}
