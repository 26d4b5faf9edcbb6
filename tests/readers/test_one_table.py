"""Lines that are no rows of one magnetometer: they are refused with what to do, or read by the names in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders.errors import NoMagnetometer

if TYPE_CHECKING:
    from pathlib import Path

ROWS: Final = 120
NOISE: Final = np.random.default_rng(9)
DIRECTIONS: Final = NOISE.normal(size=(ROWS, 3))
UNIT: Final = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
FIELD: Final = (45.0 * UNIT + [12.0, -30.0, 5.0]).round(3)
GRAVITY: Final = (9.8 * UNIT[::-1]).round(3)


def rows(*forms: str) -> list[str]:
    """Lines of each moment: `m` and `a` are the readings, `n` counts them."""
    both = zip(FIELD.tolist(), GRAVITY.tolist(), strict=True)
    return [form.format(m=m, a=a, n=n, t=1000 + 20 * n) for n, (m, a) in enumerate(both) for form in forms]


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join([*lines, ""]))
    return path


ONE_VALUE: Final = {
    "one axis after the other": [
        "entity_id,state,last_changed",
        *(f"sensor.mag_{axis},{row[at]},{n}" for at, axis in enumerate("xyz") for n, row in enumerate(FIELD)),
    ],
    "axes in turn beside words": [
        "#group,false,false,true",
        ",result,_time,_value,_field,_measurement",
        *rows(*(f",0,2026-11-22T04:42:{{n:03d}}Z,{{m[{at}]}},{axis},mag" for at, axis in enumerate("xyz"))),
    ],
    "a time, a name and a value": [
        "time;name;value",
        *(f"{n};Magnetic Field-{axis};{row[at]}" for at, axis in enumerate("XYZ") for n, row in enumerate(FIELD)),
    ],
}


@pytest.mark.parametrize("lines", ONE_VALUE.values(), ids=ONE_VALUE)
def test_one_value_a_row_is_to_be_pivoted(lines: list[str], tmp_path: Path) -> None:
    with assert_raises(NoMagnetometer):
        flinders.read(written(tmp_path / "log.csv", lines))


@pytest.mark.parametrize(
    "lines",
    [
        rows("INSERT INTO mag VALUES({n},'2026-11-22 04:42:07',{m[0]},{m[1]},{m[2]});"),
        ["CREATE TABLE mag (x REAL, y REAL, z REAL);", *rows("insert into mag values ({m[0]}, {m[1]}, {m[2]});")],
        ["-- dump", *rows('INSERT INTO "mag" (x, y, z) VALUES ({m[0]}, {m[1]}, {m[2]});')],
    ],
)
def test_a_dump_of_a_data_base_is_to_be_exported(lines: list[str], tmp_path: Path) -> None:
    with assert_raises(NoMagnetometer):
        flinders.read(written(tmp_path / "dump.sql", lines))


@pytest.mark.parametrize(
    "lines",
    [
        ["kind,t,x,y,z", *rows("1,{t},{a[0]},{a[1]},{a[2]}", "4,{t},{m[0]},{m[1]},{m[2]}")],
        ["x;y;z;1-13 (sensors)", *rows("0.1;0.{n};0.2;4", "{m[0]};{m[1]};{m[2]};2")],
        rows("{t}.5 3 {a[0]} {a[1]} {a[2]} 7", "{t}.5 2 {m[0]} {m[1]} {m[2]} 7"),
    ],
    ids=["gravity", "rates", "no header"],
)
def test_a_number_that_tells_sensors_apart_is_no_reading_of_one(lines: list[str], tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv", lines)
    columns = None if "x" in lines[0] else "3,4,5"
    with assert_raises(NoMagnetometer):
        flinders.read(path, columns=columns)


@pytest.mark.parametrize(
    ("form", "header"),
    [("{m[0]},{m[1]},{m[2]},{s}", "x,y,z,second"), ("{s},{m[0]},{m[1]},{m[2]},7", "s,x,y,z,state")],
)
def test_whole_numbers_that_do_not_come_in_turn_tell_no_sensors_apart(form: str, header: str, tmp_path: Path) -> None:
    slowly = np.sort(np.linalg.norm(FIELD, axis=1).argsort())
    lines = [form.format(m=FIELD[row], s=place // 20) for place, row in enumerate(slowly)]
    assert len(flinders.read(written(tmp_path / "log.csv", [header, *lines]))) == ROWS


@pytest.mark.parametrize("names", [("acc", "mag"), ("mag", "acc"), ("m1", "m2")])
def test_matrices_one_below_the_other_are_not_one(names: tuple[str, str], tmp_path: Path) -> None:
    lines = ["# Created by Octave 6.4.0"]
    for name, values in zip(names, (GRAVITY, FIELD), strict=True):
        lines += [f"# name: {name}", "# type: matrix", "# columns: 3", *(" {} {} {}".format(*row) for row in values)]
    with assert_raises(NoMagnetometer):
        flinders.read(written(tmp_path / "both.txt", lines))


@pytest.mark.parametrize(
    "forms",
    [
        ("2026-11-22T04:42:07,FD,1E,{n},mavlink_raw_imu_t,time_ms,{t},xmag,{m[0]},ymag,{m[1]},zmag,{m[2]}, Len,41",),
        ("C4;imu_t;mag_x;{m[0]};mag_y;{m[1]};mag_z;{m[2]}", "1D;imu2_t;mag_x;1;mag_y;{n};mag_z;3;volt;12"),
        ("{n}\tmx\t{m[0]}\tmy\t{m[1]}\tmz\t{m[2]}\tE{n}", "{n}\tlat\t52.1\tlon\t9.8"),
    ],
)
def test_names_and_values_in_turn_are_read_by_the_names(forms: tuple[str, ...], tmp_path: Path) -> None:
    np.testing.assert_allclose(flinders.read(written(tmp_path / "log.csv", rows(*forms))).field, FIELD)


@pytest.mark.parametrize("names", ["field1,field2,field3", "Field 1,Field 2,Field 3", "field_4,field_5,field_6"])
def test_numbered_fields_of_a_weather_station_are_no_magnetometer(names: str, tmp_path: Path) -> None:
    lines = [f"entry_id,{names}", *(f"{n},{22 + n / 100},{60 - n / 100},{1013 + n / 50}" for n in range(ROWS))]
    with assert_raises(NoMagnetometer):
        flinders.read(written(tmp_path / "feed.csv", lines))


@pytest.mark.parametrize(
    "form", ["{n},{m[0]},{m[1]},{m[2]},b4:01,5,6", "a4:0f;{m[0]};{m[1]};{m[2]};1;2", "1,{m[0]},{m[1]},{m[2]},0c:1e,7"]
)
def test_an_address_is_no_label(form: str, tmp_path: Path) -> None:
    with assert_raises(NoMagnetometer):
        flinders.read(written(tmp_path / "log.csv", rows(form)))


@pytest.mark.parametrize(
    ("form", "step_s"),
    [
        ("11-22 04:42:{n:02d}.813  2211  2245 D MagActivity: x={m[0]} y={m[1]} z={m[2]}", 1.0),
        ("\x1b[0;32mI ({t}) QMC5883L: X: {m[0]}, Y: {m[1]}, Z: {m[2]}\x1b[0m", 0.02),
        ("I ({t}000) MAG: {m[0]}, {m[1]}, {m[2]}", 20.0),
        ("I1122 04:42:{n:02d}.813456 mag.cc:7] mag x={m[0]} y={m[1]} z={m[2]}", 1.0),
    ],
)
def test_logs_have_the_time_of_their_lines(form: str, step_s: float, tmp_path: Path) -> None:
    samples = flinders.read(written(tmp_path / "log.txt", rows(form)[:60]))
    np.testing.assert_allclose(samples.field, FIELD[:60])
    assert samples.time is not None
    np.testing.assert_allclose(np.diff(samples.time), step_s)


@pytest.mark.parametrize("name", ["Clock:offsetTime", "GPS TOW", "gps_time_of_week (s)"])
def test_times_by_other_names(name: str, tmp_path: Path) -> None:
    lines = [f"{name},mx,my,mz", *(f"{n / 5},{row[0]},{row[1]},{row[2]}" for n, row in enumerate(FIELD))]
    time = flinders.read(written(tmp_path / "log.csv", lines)).time
    assert time is not None
    np.testing.assert_allclose(np.diff(time), 0.2)


@pytest.mark.parametrize(
    "forms",
    [
        ("{n}.1,{a[0]},{a[1]},{a[2]},,,,", "{n}.2,,,,{m[0]},{m[1]},{m[2]},", "{n}.3,,,,,,,22.5"),
        ("{n}.1,,,,{m[0]},{m[1]},{m[2]},", "{n}.2,{a[0]},{a[1]},{a[2]},,,,"),
        ("{n}.1,,,,{m[0]},{m[1]},{m[2]},", "{n}.2,,,,,,,22.5"),
    ],
)
def test_rows_of_other_topics_are_no_lost_readings(forms: tuple[str, ...], tmp_path: Path) -> None:
    header = "t,ax,ay,az,/imu/mag/magnetic_field/x,/imu/mag/magnetic_field/y,/imu/mag/magnetic_field/z,temp"
    samples = flinders.read(written(tmp_path / "bag.csv", [header, *rows(*forms)]))
    assert samples.unit.name == "T"
    assert len(samples) == ROWS
    assert [(entry.reason, entry.rows) for entry in samples.skipped] == [("accompanying", ROWS * (len(forms) - 1))]


def test_a_row_with_an_empty_field_beside_other_readings_is_lost(tmp_path: Path) -> None:
    lines = ["t,ax,mx,my,mz", *rows("{n}.1,{a[0]},{m[0]},{m[1]},{m[2]}", "{n}.2,{a[0]},,,")]
    assert [entry.reason for entry in flinders.read(written(tmp_path / "log.csv", lines)).skipped] == ["not finite"]
