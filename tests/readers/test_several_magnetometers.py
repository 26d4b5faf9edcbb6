"""Tables of several magnetometers: each is found, chosen and calibrated; no more are found than there are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from click.testing import CliRunner, Result
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.errors import UsageError
from flinders.readers._columns_by_name import by_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

ROWS: Final = 1500
OFFSETS: Final = ((12.0, -7.0, 30.0), (-40.0, 25.0, 3.0))
"""Of the two magnetometers of the tables that are written here, µT."""


def field_of(number: int) -> Floats:
    """Turned through all directions, noise of 0.3 µT, by one magnetometer or the other."""
    noise = np.random.default_rng(number)
    directions = noise.normal(size=(ROWS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found: Floats = 48.0 * directions + OFFSETS[number] + 0.3 * noise.normal(size=(ROWS, 3))
    return found


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty one to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(name: str, header: str, *columns: Floats) -> Path:
    path = Path(name)
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.6f")
    return path


def xyz(*sensors: str) -> list[str]:
    """The columns ``mag1_x``, ``mag1_y``, … of these sensors."""
    return [f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"]


@pytest.fixture
def two() -> Path:
    """Two magnetometers and their accelerometers, which read 1 and 2 on z."""
    beside = [np.tile([0.0, 0.0, number], (ROWS, 1)) for number in (1.0, 2.0)]
    header = ",".join(["t_s", *xyz("mag1", "acc1", "mag2", "acc2")])
    return write("two.csv", header, np.arange(ROWS) / 50, field_of(0), beside[0], field_of(1), beside[1])


def run(line: str, code: int = 0, stdin: bytes | None = None) -> Result:
    ended = CliRunner().invoke(main, line.split(), input=stdin)
    assert ended.exit_code == code, ended.output
    return ended


# what is a magnetometer of its own


@pytest.mark.parametrize(
    ("names", "sensors"),
    [
        (xyz("mag1", "mag2"), ["mag1", "mag2"]),
        (["mx0", "my0", "mz0", "mx1", "my1", "mz1"], ["m0", "m1"]),
        (["magX_imu1", "magY_imu1", "magZ_imu1", "magX_imu2", "magY_imu2", "magZ_imu2"], ["mag_imu1", "mag_imu2"]),
        ([f"imu{n}.mag.{axis}" for n in (1, 2, 3) for axis in "xyz"], ["imu1.mag", "imu2.mag", "imu3.mag"]),
        (xyz("mag_a", "mag_b"), ["mag_a", "mag_b"]),
        (xyz("mag_left", "mag_right"), ["mag_left", "mag_right"]),
        (xyz("mag_rm3100", "mag_lis3mdl"), ["mag_rm3100", "mag_lis3mdl"]),
        (xyz("mag", "mag2"), ["mag", "mag2"]),
        (xyz("mag", "mag"), ["mag", "mag 2"]),
        ([f"mag{n}[{axis}]" for n in (1, 2) for axis in range(3)], ["mag1", "mag2"]),
        ([f"B{n}{axis} (nT)" for n in (1, 2) for axis in "xyz"], ["B1", "B2"]),
        ([f"mag_{axis}_{n} [uT]" for n in (1, 2) for axis in "xyz"], ["mag_1", "mag_2"]),
        ([f"{axis}{n}" for n in (1, 2) for axis in "xyz"], ["xyz1", "xyz2"]),
        (xyz("mag1_raw", "mag1_cal", "mag2_raw", "mag2_cal"), ["mag1", "mag2"]),
        (xyz("mag1", "mag2", "mag_ned"), ["mag1", "mag2"]),
        (xyz("mag_ref", "mag1", "mag2", "mag1_lpf", "mag_filtered"), ["mag1", "mag2"]),
        (xyz("mag1_cal", "mag2"), ["mag2", "mag1"]),
        (xyz("mag_main", "mag_filtered", "mag_backup"), ["mag_main", "mag_backup"]),
        (xyz("mag_int1", "mag_int2"), ["mag_int1", "mag_int2"]),
        (xyz("mag_10", "mag_11", "mag_12"), ["mag_10", "mag_11", "mag_12"]),
        (xyz("mag_mmc5603", "mag_mmc5983"), ["mag_mmc5603", "mag_mmc5983"]),
        (xyz("unit1_mag", "unit2_mag"), ["unit1_mag", "unit2_mag"]),
    ],
)
def test_magnetometers_are_told_apart_by_number_place_letter_and_type(names: list[str], sensors: list[str]) -> None:
    found = by_name(names, np.zeros((2, len(names))))
    assert found is not None
    assert [each.name for each in found.magnetometers] == sensors
    assert found.field.cells == found.magnetometers[0].field.cells


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        (xyz("mag", "mag_raw"), "mag_raw_x"),
        (xyz("mag", "mag_cal"), "mag_x"),
        (["mag_x", "mag_y", "mag_z", "mag_x_filtered", "mag_y_filtered", "mag_z_filtered"], "mag_x"),
        (xyz("mag", "mag_filtered_5"), "mag_x"),
        (xyz("mag", "mag_lp10"), "mag_x"),
        (xyz("mag", "mag_cov", "mag_std", "mag_bias"), "mag_x"),
        (xyz("mag_filtered", "mag_main"), "mag_main_x"),
        (xyz("mag_primary", "mag_corrected"), "mag_primary_x"),
        (xyz("mag_main", "mag_filtered_5"), "mag_main_x"),
        (xyz("mag_t0", "mag_t1"), "mag_t0_x"),
        (xyz("mag_avg5", "mag_avg10"), "mag_avg5_x"),
        (xyz("mag_lp1", "mag_lp2"), "mag_lp1_x"),
        (xyz("mag_v1", "mag_v2"), "mag_v1_x"),
        (xyz("mag_25", "mag_50"), "mag_25_x"),
        (xyz("mag_25hz", "mag_26hz"), "mag_25hz_x"),
        (xyz("mag", "mag_main_field"), "mag_x"),
        (xyz("mag_int16", "mag"), "mag_x"),
        (xyz("mag_a", "mag_b", "mag"), "mag_x"),
        (xyz("mag_r", "mag_c"), "mag_r_x"),
        (xyz("mag", "mag_a", "mag_b"), "mag_x"),
        (["x", "y", "z", *xyz("mag1")], "mag1_x"),
        (["x", "y", "z", *xyz("mag_lpf")], "mag_lpf_x"),
        (["mx", "my", "mz", *xyz("mag_lpf")], "mx"),
        ([*xyz("magnetometer"), *xyz("magnetometer_uncalibrated")], "magnetometer_uncalibrated_x"),
        ([*xyz("acc1", "acc2"), "mx", "my", "mz"], "mx"),
        (["time", "mag_x", "mag_y", "mag_z", "mag_x"], "mag_x"),
        ([f"magnetic_field_covariance_{n}" for n in range(9)] + [f"magnetic_field.{axis}" for axis in "xyz"],
         "magnetic_field.x"),
    ],
)  # fmt: skip
def test_one_magnetometer_twice_is_no_second_one(names: list[str], taken: str) -> None:
    found = by_name(names, np.zeros((2, len(names))))
    assert found is not None
    assert (found.name, found.magnetometers, found.field.names[0]) == ("", (), taken)


NO_READINGS: Final = (
    "ref", "reference", "wmm", "wmm2025", "igrf", "igrf13", "ned", "enu", "earth", "world", "true", "model", "min",
    "max", "diff", "status", "unit", "dir", "expected",
)  # fmt: skip
COPIES: Final = ("lpf", "hpf", "hp", "ema2", "avg", "mean", "smooth", "filt", "filtered", "prev", "cal", "corrected")


@pytest.mark.parametrize("form", ["mag_{}_{}", "mag_{1}_{0}", "{}_mag_{}", "mag{}_{}"])
@pytest.mark.parametrize("readings", ["mag", "mag_body"])
def test_readings_are_taken_wherever_a_reference_or_a_copy_stands(form: str, readings: str) -> None:
    """And it is said that the other one is there."""
    for word in NO_READINGS + COPIES:
        other = [form.format(word, axis) for axis in "xyz"]
        for names in (other + xyz(readings), xyz(readings) + other):
            found = by_name(names, np.zeros((2, 6)))
            assert found is not None, names
            assert (found.field.names[0], found.magnetometers) == (f"{readings}_x", ()), names
            assert len(found.passed_over) == 1, names


@pytest.mark.parametrize("word", COPIES)
def test_a_copy_is_read_where_there_is_nothing_else(word: str) -> None:
    found = by_name(xyz(f"mag_{word}"), np.zeros((2, 3)))
    assert found is not None
    assert found.passed_over == ()


def test_what_is_passed_over_is_named_and_so_is_what_it_is() -> None:
    header = ",".join(xyz("mag_ref", "mag_lpf", "mag_25_uT", "mag"))
    found = str(flinders.open_recording(write("many.csv", header, *[field_of(0)] * 4)))
    assert_sentences(found)


def test_a_table_of_nothing_but_references_is_refused_unless_the_user_insists() -> None:
    path = write("only.csv", ",".join(xyz("mag_ref", "mag_min")), field_of(0), field_of(1))
    told = run(f"calibrate {path}", code=5).stderr
    assert_sentences(told)
    np.testing.assert_allclose(
        flinders.read(path, columns="mag_min_x,mag_min_y,mag_min_z").field, field_of(1), atol=1e-6
    )


def test_readings_by_a_short_name_come_before_a_reference_by_a_long_one() -> None:
    found = by_name([*xyz("mag_ref"), "mx", "my", "mz"], np.zeros((2, 6)))
    assert found is not None
    assert (found.field.names, found.passed_over) == (("mx", "my", "mz"), ("mag_ref (a reference)",))


def test_an_acceleration_in_axes_of_the_earth_is_not_taken() -> None:
    both = by_name(xyz("acc_ned", "mag", "acc"), np.zeros((2, 9)))
    assert both is not None
    acceleration = both.of_kind("acceleration")
    assert acceleration is not None
    assert acceleration.names[0] == "acc_x"
    alone = by_name(xyz("acc_ned", "mag"), np.zeros((2, 6)))
    assert alone is not None
    assert alone.of_kind("acceleration") is None
    assert_sentences(alone.left_out)


@pytest.mark.parametrize("odd", ["mag_²_{}", "mag_٣_{}", "mag_" + "9" * 6000 + "_{}", "mag_{}_007", "(({}", "magref{}"])
def test_an_odd_name_is_no_harm(odd: str) -> None:
    names = [*(odd.format(axis) for axis in "xyz"), *xyz("mag")]
    found = by_name(names, np.zeros((2, 6)))
    assert found is not None
    assert "mag_x" in [each.field.names[0] for each in found.magnetometers or (found,)]


@pytest.mark.parametrize(
    ("beside", "expected"),
    [
        (("acc1", "acc2"), ["acc1_x", "acc2_x"]),
        (("acc",), ["acc_x", "acc_x"]),
        (("acc2",), [None, "acc2_x"]),
        (("acc", "acc2"), ["acc_x", "acc2_x"]),
        (("imu1_acc", "imu2_acc"), ["imu1_acc_x", "imu2_acc_x"]),
        (("linear_acc", "acc"), ["acc_x", "acc_x"]),
    ],
)
def test_an_accelerometer_goes_with_the_magnetometer_of_its_number(
    beside: tuple[str, ...], expected: list[str | None]
) -> None:
    names = xyz("mag1", "mag2", *beside)
    found = by_name(names, np.zeros((2, len(names))))
    assert found is not None
    stand_beside = [each.of_kind("acceleration") for each in found.magnetometers]
    assert [column and column.names[0] for column in stand_beside] == expected


# reading and choosing


def test_the_first_is_read_and_names_the_others(two: Path) -> None:
    first = flinders.open_recording(two)
    assert_sentences(str(first))
    assert_sentences(str(flinders.open_recording(two, sensor="MAG2")))
    np.testing.assert_allclose(flinders.read(two).field, field_of(0), atol=1e-6)
    for number in (1, 2):
        found = flinders.read(two, sensor=str(number))
        np.testing.assert_allclose(found.field, field_of(number - 1), atol=1e-6)
        assert found.acceleration is not None
        assert set(found.acceleration[:, 2]) == {float(number)}


def test_columns_say_it_without_a_choice(two: Path) -> None:
    found = flinders.open_recording(two, columns="mag2_x,mag2_y,mag2_z")
    assert_sentences(str(found))
    samples = flinders.read(two, columns="mag2_x,mag2_y,mag2_z")
    assert samples.acceleration is not None
    assert set(samples.acceleration[:, 2]) == {2.0}
    with assert_raises(UsageError):
        flinders.open_recording(two, columns="mag2_x,mag2_y,mag2_z", sensor="2")


def test_one_that_there_is_not_is_refused_and_so_is_a_choice_of_one(two: Path) -> None:
    with assert_raises(UsageError):
        flinders.open_recording(two, sensor="3")
    one = write("one.csv", "mx,my,mz", field_of(0))
    with assert_raises(UsageError):
        flinders.open_recording(one, sensor="1")


def test_an_array_of_dozens_names_a_few() -> None:
    many = write("many.csv", ",".join(xyz(*(f"mag{n}" for n in range(1, 13)))), *[field_of(0)] * 12)
    assert "2 mag2, 3 mag3," in str(flinders.open_recording(many))
    assert_sentences(str(flinders.open_recording(many)))
    assert str(flinders.open_recording(many, sensor="mag12")).startswith("many.csv: mag12, ")


def write_json(path: Path, arrays: dict[str, Any]) -> None:
    rows = zip(*(value.tolist() for value in arrays.values()), strict=True)
    path.write_text(json.dumps([dict(zip(arrays, row, strict=True)) for row in rows]))


def write_npz(path: Path, arrays: dict[str, Any]) -> None:
    np.savez(path, **arrays)


def write_mat(path: Path, arrays: dict[str, Any]) -> None:
    pytest.importorskip("scipy.io").savemat(path, arrays)


def write_parquet(path: Path, arrays: dict[str, Any]) -> None:
    arrow = pytest.importorskip("pyarrow")
    columns = {"t": arrays["t"]} | {
        f"{name}_{axis}": arrays[name][:, place] for name in ("mag1", "mag2") for place, axis in enumerate("xyz")
    }
    pytest.importorskip("pyarrow.parquet").write_table(arrow.table(columns), path)


@pytest.mark.parametrize("written", [write_json, write_npz, write_mat, write_parquet])
def test_every_kind_of_table_may_hold_several(written: Callable[[Path, dict[str, Any]], None]) -> None:
    path = Path(f"two.{written.__name__.removeprefix('write_')}")
    written(path, {"t": np.arange(ROWS) / 50, "mag1": field_of(0), "mag2": field_of(1)})
    log = flinders.open_log(path, unit="uT")
    assert [instrument.name for instrument in log.instruments] == ["mag1", "mag2"]
    for number, instrument in enumerate(log.instruments):
        np.testing.assert_allclose(np.concatenate([block.field for block in instrument.blocks()]), field_of(number))
    assert_sentences(str(flinders.open_recording(path)))
    np.testing.assert_allclose(flinders.read(path, sensor="mag2").field, field_of(1))


def test_each_has_the_unit_of_its_own_names() -> None:
    path = write("units.csv", ",".join(xyz("mag_left_uT", "mag_right_mG")), field_of(0), 10.0 * field_of(1))
    assert [one.unit.name for one in flinders.open_log(path).instruments] == ["uT", "mG"]
    np.testing.assert_allclose(flinders.read(path, sensor="mag_right").field, field_of(1), atol=1e-6)


# the program


def test_all_of_a_table_are_calibrated_as_they_are_alone(two: Path) -> None:
    """Their offsets come out within four times the claimed uncertainty, each in its own file."""
    ended = run(f"calibrate {two} --unit uT --sensor all -o c-{{sensor}}.json --json")
    rows = json.loads(ended.stdout)["sensors"]
    assert [row["sensor"] for row in rows] == ["mag1", "mag2"]
    for number, row in enumerate(rows):
        saved = flinders.Calibration.load(f"c-{number + 1}.json")
        assert saved.sensor == row["sensor"]
        sigma = np.sqrt(np.diag(np.array(row["covariance"])))[:3]
        assert np.all(np.abs(saved.offset - OFFSETS[number]) < 4 * sigma)
    alone = run(f"calibrate {two} --unit uT --sensor 2 -o alone.json")
    assert_sentences(alone.stderr)
    np.testing.assert_array_equal(flinders.Calibration.load("alone.json").offset, saved.offset)
    assert flinders.Calibration.load("alone.json").sensor == "mag2"


def test_a_dead_one_does_not_keep_the_others_from_their_calibration() -> None:
    write("dead.csv", ",".join(xyz("mag1", "mag2")), field_of(0) * np.nan, field_of(1))
    ended = run("calibrate dead.csv --unit uT --sensor all -o d-{sensor}.json", code=5)
    assert_sentences(" ".join(ended.stdout.split()))
    assert not Path("d-1.json").exists()
    np.testing.assert_allclose(flinders.Calibration.load("d-2.json").offset, OFFSETS[1], atol=0.1)
    told = run("info dead.csv --unit uT").stdout
    assert "1  mag1  in uT" in told
    assert "2  mag2  in uT" in told
    Path("both.csv").write_text(",".join(xyz("mag1", "mag2")) + "\n" + "nan,nan,nan,nan,nan,nan\n" * 20)
    neither = run("calibrate both.csv --sensor all", code=5)
    assert_sentences(neither.stderr)


def test_info_counts_each_of_them(two: Path) -> None:
    told = json.loads(run(f"info {two} --json").stdout)
    counted = [(one["number"], one["name"], one["readings"], round(one["rate_hz"])) for one in told["sensors"]]
    assert counted == [(1, "mag1", ROWS, 50), (2, "mag2", ROWS, 50)]
    assert any("--sensor all" in command for command in told["commands"])


@pytest.mark.parametrize(
    "words",
    [
        "two.csv --sensor mag3",
        "one.csv --sensor all",
        "two.csv one.csv --sensor all",
        "two.csv one.csv --sensor 2",
        "two.csv --sensor all --columns 2,3,4",
        "two.csv --sensor all --topic mag",
        "two.csv --sensor all --as-logged",
    ],
)
def test_what_cannot_be_chosen_is_said(words: str, two: Path) -> None:
    assert two.exists()
    write("one.csv", "mag_x,mag_y,mag_z", field_of(0))
    assert_sentences(run(f"calibrate {words}", code=2).stderr)


def test_the_name_of_the_only_one_is_the_users() -> None:
    write("one.csv", "mag_x,mag_y,mag_z", field_of(0))
    run("calibrate one.csv --unit uT --sensor bow -o bow.json")
    assert flinders.Calibration.load("bow.json").sensor == "bow"


def test_columns_keep_the_name_of_the_magnetometer_that_they_are(two: Path) -> None:
    """So that the calibration is applied to it again, and not to the first."""
    run(f"calibrate {two} --unit uT --columns mag2_x,mag2_y,mag2_z -o columns.json")
    assert flinders.Calibration.load("columns.json").sensor == "mag2"
    assert_sentences(run(f"apply columns.json {two} -o o.csv").stderr)
    run(f"calibrate {two} --unit uT --columns 8,9,10 --sensor 2 -o same.json")
    assert flinders.Calibration.load("same.json").sensor == "mag2"
    run(f"calibrate {two} --unit uT --columns 8,9,10 --sensor bow -o bow.json")
    assert flinders.Calibration.load("bow.json").sensor == "bow"


def test_columns_of_a_copy_are_taken_where_they_were_asked_for() -> None:
    """A copy is no magnetometer of its own; a calibration of its columns remembers them."""
    header = ",".join(xyz("mag1", "mag2", "mag2_cal"))
    path = write("copy.csv", header, field_of(0), field_of(1), field_of(1) - OFFSETS[1])
    run(f"calibrate {path} --unit uT --columns mag2_cal_x,mag2_cal_y,mag2_cal_z -o copy.json")
    assert flinders.Calibration.load("copy.json").sensor == "mag2_cal"
    assert_sentences(run(f"apply copy.json {path} -o o.csv").stderr)


@pytest.mark.parametrize(
    "words",
    [
        "--columns mag2_x,mag2_y,mag2_z --sensor mag1",
        "--columns mag2_x,mag2_y,mag2_z --sensor 1",
        "--columns mag1_x,mag1_y,mag2_z --sensor mag1",
        "swapped.csv --columns 2,3,4",
    ],
)
def test_columns_of_another_magnetometer_than_is_named_are_refused(words: str, two: Path) -> None:
    write("swapped.csv", ",".join(["t_s", *xyz("mag2", "mag1")]), np.arange(ROWS) / 50, field_of(1), field_of(0))
    assert_sentences(run(f"calibrate {two} {words}", code=2).stderr)


# a calibration chooses its own


@pytest.fixture
def second(two: Path) -> Path:
    """A calibration of the second magnetometer."""
    run(f"calibrate {two} --unit uT --sensor 2 -o second.json")
    return Path("second.json")


def test_a_calibration_is_applied_to_the_magnetometer_it_is_for(second: Path, two: Path) -> None:
    ended = run(f"apply {second} {two} -o out.csv")
    assert_sentences(ended.stderr)
    piped = run(f"apply {second} -", stdin=two.read_bytes())
    for text in (Path("out.csv").read_text(), piped.stdout):
        rows = np.array([line.split(",") for line in text.splitlines()[1:]], float)
        np.testing.assert_allclose(rows[:, 1:4], field_of(0), atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(rows[:, 7:10], axis=1).mean(), 48.0, atol=0.05)
    assert_sentences(run(f"check {second} {two}", code=3).stderr)
    assert_sentences(run(f"heading {second} {two} --level -o h.csv", code=3).stderr)


def test_another_one_is_read_where_it_is_asked_for_and_that_is_said(second: Path, two: Path) -> None:
    ended = run(f"check {second} {two} --sensor mag1", code=4)
    assert_sentences(ended.stderr)


@pytest.mark.parametrize("command", ["apply", "heading", "check"])
def test_a_table_without_it_is_refused_and_says_what_there_is(command: str, second: Path) -> None:
    write("other.csv", ",".join(xyz("mag_left", "mag_right")), field_of(0), field_of(1))
    ended = run(f"{command} {second} other.csv", code=2)
    assert_sentences(ended.stderr)


def test_a_table_of_one_is_taken_as_it_is(second: Path) -> None:
    write("one.csv", "mag_x,mag_y,mag_z", field_of(1))
    assert "1.000 of the calibration's field" in run(f"apply {second} one.csv -o out.csv").stderr


# datagrams


def datagrams(field: Floats) -> list[str]:
    return [f"|{n / 50:.2f},0,0,9.8,0,0,0.1,{x:.4f},{y:.4f},{z:.4f},0,0,1.57*" for n, (x, y, z) in enumerate(field)]


@pytest.mark.parametrize("between", ["\n", "\r\n", ""])
def test_datagrams_of_magcc_are_read_without_options(between: str) -> None:
    """Also where they were caught one after the other, without line ends."""
    Path("caught.txt").write_text(between.join(datagrams(field_of(0))), newline="")
    found = flinders.read("caught.txt", unit="uT")
    np.testing.assert_allclose(found.field, field_of(0), atol=1e-4)
    assert found.time is not None
    assert found.acceleration is not None
    assert found.rate is not None
    np.testing.assert_allclose(np.diff(found.time), 0.02)
    assert (found.acceleration[0, 2], found.rate[0, 2]) == (9.8, 0.1)


def test_a_datagram_that_is_cut_short_is_counted_with_the_other_lines() -> None:
    lines = datagrams(field_of(0)[:20])
    lines[4], lines[0] = lines[4][:20], "listening on 50100"
    Path("caught.txt").write_text("\n".join(lines))
    recording = flinders.open_recording("caught.txt")
    assert sum(len(block) for block in recording.blocks()) == 18
    skipped = [entry for block in recording.blocks() for entry in block.skipped]
    assert [(entry.reason, entry.rows) for entry in skipped] == [("other", 2)]


def test_a_table_with_bars_is_no_datagram() -> None:
    Path("table.txt").write_text("|1,2,3*\n" + "1,2,3\n" * 20)
    assert len(flinders.read("table.txt")) == 20


# axes


def test_a_replay_of_px4_is_in_the_axes_of_the_vehicle() -> None:
    field = simulate.tumble(seed=1).samples.field[:50] / 100
    Path("replay.csv").write_text("".join(f"{4000 * n},mag,{x},{y},{z}\n" for n, (x, y, z) in enumerate(field)))
    assert flinders.read("replay.csv").frame == "vehicle"
    (instrument,) = flinders.open_log("replay.csv").instruments
    assert instrument.frame == "vehicle"
    write("one.csv", "mag_x,mag_y,mag_z", field_of(0))
    assert flinders.read("one.csv").frame == "sensor"
