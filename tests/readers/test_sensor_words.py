"""Rows of several sensors in one table, told apart by a word: the magnetometer's are read, others never."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders.errors import NoMagnetometer

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

ROWS: Final = 120
NOISE: Final = np.random.default_rng(8)
FIELD: Final = (45.0 * NOISE.normal(size=(ROWS, 3)) + [12.0, -30.0, 5.0]).round(3)
GRAVITY: Final = (9.8 * NOISE.normal(size=(ROWS, 3))).round(3)


def rows(*forms: str) -> list[str]:
    """Lines of each moment: `m` and `a` are the readings, `t` counts from 1,000 ms, `s` is the same in seconds."""
    both = zip(FIELD.tolist(), GRAVITY.tolist(), strict=True)
    return [form.format(m=m, a=a, t=1000 + 20 * n, s=1 + n / 50) for n, (m, a) in enumerate(both) for form in forms]


TEXTS: Final = {
    "a header for each in comments": [
        "# Accel,utcTimeMillis,AccelXMps2,AccelYMps2,AccelZMps2",
        "# Mag,utcTimeMillis,MagXMicroT,MagYMicroT,MagZMicroT",
        *rows("Accel,{t},{a[0]},{a[1]},{a[2]}", "Mag,{t},{m[0]},{m[1]},{m[2]}", "Fix,GPS,52.1,9.8,{t},5.5,1"),
    ],
    "semicolons and remarks with a header": [
        "% a log",
        "% ACCE;t(s);Acc_X;Acc_Y;Acc_Z;accuracy",
        "% MAGN;t(s);Mag_X(uT);Mag_Y(uT);Mag_Z(uT);accuracy",
        *rows("ACCE;{s};{a[0]};{a[1]};{a[2]};3", "MAGN;{s};{m[0]};{m[1]};{m[2]};3", "PRES;{s};1013.2;0"),
    ],
    "no header, and others of another width": rows(
        "{t}\tTYPE_ACCELEROMETER\t{a[0]}\t{a[1]}\t{a[2]}\t2",
        "{t}\tTYPE_MAGNETIC_FIELD\t{a[1]}\t{a[0]}\t{a[2]}\t2",
        "{t}\tTYPE_MAGNETIC_FIELD_UNCALIBRATED\t{m[0]}\t{m[1]}\t{m[2]}\t1.5\t-8\t4\t2",
    ),
    "a named column": ["time_ms,x,y,z,stream", *rows("{t},{a[0]},{a[1]},{a[2]},gyro", "{t},{m[0]},{m[1]},{m[2]},mag")],
    "records": rows(
        '{{"sensor": "Orientation", "t": "{s}", "z": "{a[2]}", "y": "{a[1]}", "x": "{a[0]}"}}',
        '{{"sensor": "Magnetometer", "t": "{s}", "z": "{m[2]}", "y": "{m[1]}", "x": "{m[0]}"}}',
    ),
}


@pytest.mark.parametrize("lines", TEXTS.values(), ids=TEXTS)
def test_rows_of_the_magnetometer_are_read_and_no_others(lines: list[str], tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("\n".join([*lines, ""]))
    samples = flinders.read(path)
    np.testing.assert_allclose(samples.field, FIELD)
    assert samples.time is not None
    assert float(samples.time[-1] - samples.time[0]) == pytest.approx(0.02 * (ROWS - 1))
    assert not samples.skipped


@pytest.mark.parametrize("name", ["no header, and others of another width", "a named column"])
def test_asking_for_columns_takes_the_rows_of_the_magnetometer_alone(name: str, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("\n".join(TEXTS[name]))
    columns = "3,4,5" if name.startswith("no header") else "x,y,z"
    np.testing.assert_allclose(flinders.read(path, columns=columns).field, FIELD)


def test_two_magnetometers_beside_another_sensor_are_two(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    forms = "{s},acc,{a[0]},{a[1]},{a[2]}", "{s},mag2,{a[1]},{a[0]},{a[2]}", "{s},mag1,{m[0]},{m[1]},{m[2]}"
    path.write_text("\n".join(["t,sensor,x,y,z", *rows(*forms)]))
    np.testing.assert_allclose(flinders.read(path, sensor="sensor=mag1").field, FIELD)
    np.testing.assert_allclose(flinders.read(path, sensor=2).field, GRAVITY[:, [1, 0, 2]])


@pytest.mark.parametrize("words", [("gyroscope", "accelerometer"), ("ACC", "orientation")])
def test_sensors_without_a_magnetometer_are_refused(words: tuple[str, str], tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    forms = (f"{{s}},{word},{{m[0]}},{{m[1]}},{{m[2]}}" for word in words)
    path.write_text("\n".join(["t,sensor,x,y,z", *rows(*forms)]))
    with assert_raises(NoMagnetometer):
        flinders.read(path)


def table(column: str, words: tuple[str, str]) -> dict[str, Any]:
    field: Floats = np.stack([GRAVITY, FIELD], axis=1).reshape(-1, 3)
    return {"t_s": np.repeat(np.arange(ROWS) / 50, 2), column: words * ROWS, **dict(zip("xyz", field.T, strict=True))}


COLUMNS: Final = [
    ("sensor", ("accelerometer", "magnetometer")),
    ("type", ("GYR", "MAG")),
    ("name", ("gravity", "Mag raw")),
]


@pytest.mark.parametrize(("column", "words"), COLUMNS)
def test_a_frame_in_memory_has_the_same_rule(column: str, words: tuple[str, str]) -> None:
    pandas = pytest.importorskip("pandas")
    np.testing.assert_allclose(flinders.read(pandas.DataFrame(table(column, words))).field, FIELD)


@pytest.mark.parametrize(("column", "words"), COLUMNS)
@pytest.mark.parametrize("suffix", ["parquet", "feather"])
def test_a_table_that_is_no_text_has_the_same_rule(
    suffix: str, column: str, words: tuple[str, str], tmp_path: Path
) -> None:
    arrow = pytest.importorskip("pyarrow")
    path, made = tmp_path / f"events.{suffix}", arrow.table(table(column, words))
    if suffix == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(made, path)
    else:
        pytest.importorskip("pyarrow.feather").write_feather(made, path, compression="uncompressed")
    np.testing.assert_allclose(flinders.read(path).field, FIELD)
