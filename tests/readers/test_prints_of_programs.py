"""What clients of data bases, LabVIEW, R and ROS write around their numbers: read, or refused with advice."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.readers.test_json_arrangements import FIELD, OTHER, ROWS, TIMES
from tests.sentences import assert_raises

import flinders
from flinders.errors import NoMagnetometer, UnreadableInput

if TYPE_CHECKING:
    from pathlib import Path

NAMES: Final = ("id", "ts", "mx", "my", "mz")
CELLS: Final = [
    (str(n), f"2026-11-22 04:42:{10 + 0.2 * n:06.3f}", *(f"{value:.3f}" for value in row))
    for n, row in enumerate(FIELD.tolist())
]


def boxed(bar: str, ruler: str, *, frame: bool, below: str = "") -> str:
    """A table between bars, as wide as its widest cells."""
    widths = [max(map(len, column)) for column in zip(NAMES, *CELLS, strict=True)]
    lines = [f" {bar} ".join(map(str.rjust, row, widths)) for row in (NAMES, *CELLS)]
    lines = [f"{bar} {line} {bar}" for line in lines] if frame else [f" {line}" for line in lines]
    return "\n".join([*([ruler] if frame else []), lines[0], ruler, *lines[1:], below, ""])


MYSQL: Final = "+-----+-------------------------+---------+---------+---------+"
TABLES: Final = {
    "mysql": boxed("|", MYSQL, frame=True, below=f"{MYSQL}\n{ROWS} rows in set (0.01 sec)"),
    "psql": boxed("|", MYSQL[1:-1], frame=False, below=f"({ROWS} rows)"),
    "Markdown": boxed("|", "|----:|:------------------------|--------:|--------:|--------:|", frame=True).partition(
        "\n"
    )[2],
    "DuckDB": boxed("│", "├─────┼─────────────────────────┼─────────┼─────────┼─────────┤", frame=True),
    "rulers between rows": boxed("|", MYSQL, frame=True).replace("|\n|", f"|\n{MYSQL}\n|"),
    "sec and nanosec": "".join(
        f"{1795322527 + n // 5},{200000000 * (n % 5) + 999},{x},{y},{z}\n" for n, (x, y, z) in enumerate(FIELD.tolist())
    ),
}
LVM: Final = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    f"Channels\t3\t\t\t\nSamples\t{ROWS}\t{ROWS}\t{ROWS}\t\nX0\t0\t0\t0\t\nDelta_X\t0.2\t0.2\t0.2\t\n"
    "***End_of_Header***\t\t\t\t\n"
)
HEADED: Final = {
    "a LabVIEW measurement": (LVM + "X_Value\tMag X\tMag Y\tMag Z\tComment\n", "{t}\t{x}\t{y}\t{z}\t\n"),
    "a header that says its end": ("Gain,1,2,3,4\n# end of header\nt,mx,my,mz\n", "{t},{x},{y},{z}\n"),
    "an abscissa": ("X;Bx;By;Bz\n", "{t};{x};{y};{z}\n"),
    "row names of R": ('"t" "mx" "my" "mz"\n', '"{n}" {t} {x} {y} {z}\n'),
}
REFUSED: Final = {
    "sqlite": "INSERT INTO mag VALUES(1,28.9,-31.9,47.2);\n" * 30,
    "mysqldump": "-- MySQL dump\n" + "insert into `mag` VALUES (1,28.9,-31.9,47.2),(2,23.1,-32.4,48.3);\n" * 30,
    "pg_dump": "COPY public.mag (id, mx, my, mz) FROM stdin;\n" + "1\t28.9\t-31.9\t47.2\n" * 30,
    "Home Assistant": "entity_id,state,last_changed\n"
    + "".join(f"sensor.mag_{axis},28.9,2026-11-22T04:42:07Z\n" for axis in "xyz" for _ in range(30)),
    "MVNX": '<?xml version="1.0"?>\n<mvnx version="4">\n',
    "XML": '<?xml version="1.0"?>\n<log/>\n',
}


def headed(name: str) -> str:
    head, form = HEADED[name]
    rows = zip(TIMES, FIELD.tolist(), strict=True)
    return head + "".join(form.format(n=n, t=t, x=x, y=y, z=z) for n, (t, (x, y, z)) in enumerate(rows))


@pytest.mark.parametrize("name", [*TABLES, *HEADED])
def test_what_a_program_writes_around_its_numbers_is_no_reading(name: str, tmp_path: Path) -> None:
    path = tmp_path / "table.txt"
    path.write_text(TABLES[name] if name in TABLES else headed(name), encoding="utf-8")
    samples = flinders.read(path)
    np.testing.assert_allclose(samples.field, FIELD, atol=1e-9)
    assert samples.time is not None
    np.testing.assert_allclose(samples.time - samples.time[0], TIMES, atol=1e-6)
    assert not samples.skipped


def test_an_error_between_rows_of_a_box_is_a_loss(tmp_path: Path) -> None:
    path = tmp_path / "table.txt"
    lines = TABLES["mysql"].splitlines()
    path.write_text("\n".join([*lines[:50], "ERROR 2013 (HY000): Lost connection", *lines[50:]]))
    assert [each.rows for each in flinders.read(path).skipped] == [1]


@pytest.mark.parametrize("name", REFUSED)
def test_what_holds_no_rows_of_readings_is_refused_with_advice(name: str, tmp_path: Path) -> None:
    text = REFUSED[name]
    path = tmp_path / "dump.txt"
    path.write_text(text)
    with assert_raises((NoMagnetometer, UnreadableInput)) as refused:
        flinders.read(path)
    assert "pattern" not in str(refused.value)


@pytest.mark.parametrize("sensors", [("1423", "1455"), ("701", "90210"), ("12", "4000")])
def test_folders_of_numbers_are_sensors(sensors: tuple[str, str], tmp_path: Path) -> None:
    path = tmp_path / "opal.json"
    records = [
        {sensors[0]: {"Magnetometer": one}, sensors[1]: {"Magnetometer": other}}
        for one, other in zip(FIELD.tolist(), OTHER.tolist(), strict=True)
    ]
    path.write_text("\n".join(str(record).replace("'", '"') for record in records))
    for number, field in (("1", FIELD), ("2", OTHER)):
        np.testing.assert_allclose(flinders.read(path, sensor=number).field, field)


@pytest.mark.parametrize("letters", ["bcd", "abc", "cd"])
def test_fluxgates_of_letters_in_a_row_are_magnetometers(letters: str, tmp_path: Path) -> None:
    path = tmp_path / "flux.csv"
    names = [f"flux_{letter}_{axis}" for letter in letters for axis in "xyzt"]
    rows = [",".join(f"{value}" for _ in letters for value in (*row, 45.0)) for row in FIELD.tolist()]
    path.write_text("\n".join([",".join(["tt", *names]), *(f"{t},{row}" for t, row in zip(TIMES, rows, strict=True))]))
    samples = flinders.read(path, sensor=str(len(letters)))
    np.testing.assert_allclose(samples.field, FIELD)
    assert samples.time is not None


def clocked(form: str, seconds: float) -> str:
    """A time of day in milliseconds, none of whose parts has leading zeros."""
    whole, rest = divmod(round(seconds * 1000), 1000)
    minute, second = divmod(whole, 60)
    return form.format(minute=minute, second=second, rest=rest)


@pytest.mark.parametrize(
    "form", ["4:{minute}:{second}:{rest}", "04:{minute:02d}:{second:02d}:{rest}", "4:{minute:02d}:{second}:{rest:03d}"]
)
@pytest.mark.parametrize("begun", [7.813, 58.9])
def test_milliseconds_behind_a_colon_need_no_zeros(form: str, begun: float, tmp_path: Path) -> None:
    path = tmp_path / "phone.csv"
    rows = [f"{x},{y},{z},{clocked(form, begun + t)}" for t, (x, y, z) in zip(TIMES, FIELD.tolist(), strict=True)]
    path.write_text("\n".join(["mx,my,mz,time", *rows]))
    time = flinders.read(path).time
    assert time is not None
    np.testing.assert_allclose(time - time[0], TIMES, atol=1e-6)


def test_two_digits_behind_a_third_colon_are_no_milliseconds(tmp_path: Path) -> None:
    path = tmp_path / "film.csv"
    rows = [f"{x},{y},{z},04:42:{n // 25:02d}:{n % 25:02d}" for n, (x, y, z) in enumerate(FIELD.tolist())]
    path.write_text("\n".join(["mx,my,mz,time", *rows]))
    assert flinders.read(path).time is None
