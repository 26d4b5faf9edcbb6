"""Lines that boards print, beyond the shapes that were collected: what is read of them, and what is refused."""

from __future__ import annotations

import hashlib
import json
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.errors import InputError, NoMagnetometer
from flinders.readers._tokenizer import split_line

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


FIELD = np.round(simulate.tumble(seed=4).samples.field[:3000:50], 2)
GRAVITY = 9.81 * FIELD / np.linalg.norm(FIELD, axis=1, keepdims=True)


def axes(row: Iterable[float], form: str = ".2f") -> str:
    return " ".join(f"{axis}: {value:{form}}" for axis, value in zip("XYZ", row, strict=True))


def read(path: Path, lines: Iterable[str], encoding: str = "utf-8", **options: Any) -> flinders.Samples:
    path.write_text("\n".join([*lines, ""]), encoding=encoding)
    return flinders.read(path, **options)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "print.txt"


READ = {
    "colours of a terminal": [f"\x1b[32m{axes(row)} uT\x1b[0m" for row in FIELD],
    "plus signs": [f"{axes(row, '+.2f')} uT" for row in FIELD],
    "a log of ESP-IDF": [f"I ({1000 + 20 * n}) MAG: {axes(row)} uT" for n, row in enumerate(FIELD)],
    "a date before signs": [
        f"2026-11-22 14:03:{n % 60:02d}.5 " + " ".join(f"{value:.2f}" for value in row) for n, row in enumerate(FIELD)
    ],
    "NMEA between": [
        line for row in FIELD for line in ("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M", f"{axes(row)} uT")
    ],
    "a unit behind each number": [
        "Bx={:.2f}uT By={:.2f}uT Bz={:.2f}uT |B|={:.2f}uT".format(*row, float(np.linalg.norm(row))) for row in FIELD
    ],
    "a line for each axis": [
        f">mag_{axis}:{value:.2f}" for row in FIELD for axis, value in zip("xyz", row, strict=True)
    ],
    "gravity before it": [
        "acc: {:.2f} {:.2f} {:.2f} mag: {:.2f} {:.2f} {:.2f}".format(*both)
        for both in np.hstack([GRAVITY, FIELD]).tolist()
    ],
    "a minus apart from its number": [axes(row).replace("-", "-  ") for row in FIELD],
    "sentences with check sums": [
        "$MAG,{:.2f},{:.2f},{:.2f}*{:02X}".format(*row, 7 * n % 256) for n, row in enumerate(FIELD)
    ],
    "Raw: of three numbers": ["Raw: {:.2f},{:.2f},{:.2f}".format(*row) for row in FIELD],
    "a log of Zephyr": [
        f"[00:00:{n:02d}.100,000] <inf> main: " + ", ".join(f"{value:.2f}" for value in row)
        for n, row in enumerate(FIELD.tolist())
    ],
    "extremes between": [
        line for row in FIELD for line in (axes(row), "Min X: -50 Y: -60 Z: -70", "Max X: 50 Y: 60 Z: 70")
    ],
    "a column that says which sensor": [
        "time,sensor,x,y,z",
        *(
            "{},{},{:.2f},{:.2f},{:.2f}".format(n, sensor, *row)
            for n, both in enumerate(zip(GRAVITY, FIELD, strict=True))
            for sensor, row in zip(("acc", "mag"), both, strict=True)
        ),
    ],
}


@pytest.mark.parametrize("lines", READ.values(), ids=READ)
def test_the_magnetometer_of_a_print_is_read(lines: list[str], path: Path) -> None:
    samples = read(path, ["booting", *lines])
    np.testing.assert_allclose(samples.field / samples.unit.scale, FIELD, atol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_micro_is_read_in_any_encoding(encoding: str, path: Path) -> None:
    samples = read(path, [f"{axes(row)} µT" for row in FIELD], encoding)
    assert samples.unit.name == "uT"
    np.testing.assert_allclose(samples.field, FIELD, atol=1e-9)


def test_a_message_counts_the_numbers_of_a_line_rightly(path: Path) -> None:
    with pytest.raises(InputError, match=r"pattern='\{x\}, \{y\}, \{z\};'"):
        read(path, ["M = [", *["{:.2f}, {:.2f}, {:.2f};".format(*row) for row in FIELD], "];"])


@pytest.mark.parametrize("mark", [",", "."])
def test_a_separator_of_thousands_is_no_decimal_sign(mark: str, path: Path) -> None:
    lines = [";".join(f"{100 * int(value):,}".replace(",", mark) for value in row) for row in FIELD]
    with assert_raises(InputError, "unreadable"):
        read(path, ["mag_x;mag_y;mag_z", *lines])
    assert len(read(path, ["mag_x;mag_y;mag_z", *lines], columns="mag_x,mag_y,mag_z")) == len(FIELD)


def test_a_pattern_reads_numbers_right_behind_letters(path: Path) -> None:
    lines = [axes(row).replace(": ", "") for row in FIELD]
    np.testing.assert_allclose(read(path, lines, pattern="X{x} Y{y} Z{z}").field, FIELD, atol=1e-9)


def test_spaces_cost_no_more_than_letters() -> None:
    lines = [f": {' ' * 1900}- x 1 2 {n}" for n in range(20)]
    start = time.process_time()
    for line in lines:
        split_line(line)
    assert time.process_time() - start < 1.0  # 7.7 s where each run of spaces is tried from each of its places


@pytest.mark.parametrize("end", range(1, 25))
def test_a_line_cut_anywhere_is_counted_and_never_read(end: int, path: Path) -> None:
    whole = [f"{axes(row)} uT" for row in FIELD]
    cut = f"{axes(FIELD[7])} uT"[:end]
    samples = read(path, [*whole[:20], cut, *whole[20:]])
    np.testing.assert_allclose(samples.field, FIELD, atol=1e-9)
    assert [(entry.reason, entry.rows, entry.lines) for entry in samples.skipped] == [("other", 1, (21,))]


def test_the_first_line_of_output_counts_and_quotes_what_is_no_reading(path: Path) -> None:
    samples = read(path, ["LIS3MDL found!", *[f"{axes(row)} uT" for row in FIELD], "low battery"])
    (entry,) = samples.skipped
    assert (entry.rows, entry.example) == (2, "LIS3MDL found!")


def test_a_pattern_reads_what_is_not_recognised(path: Path) -> None:
    lines = [f"<{x:.2f}/{y:.2f}/{z:.2f}/{n}>" for n, (x, y, z) in enumerate(FIELD)]
    with pytest.raises(InputError, match=r"pattern='<\{x\}/\{y\}/\{z\}/\{n4\}>'"):
        read(path, lines)
    np.testing.assert_allclose(read(path, lines, pattern="<{x}/{y}/{z}/{n4}>").field, FIELD, atol=1e-9)


@pytest.mark.parametrize("pattern", ["", "x y z", "{x} {y}", "{x} {x} {x}", "{} {} {}"])
def test_a_pattern_without_three_names_is_a_wrong_use(pattern: str, path: Path) -> None:
    with assert_raises(flinders.errors.UsageError):
        read(path, ["1 2 3"], pattern=pattern)


def test_a_pattern_is_for_text_only(tmp_path: Path) -> None:
    np.save(tmp_path / "tumble.npy", FIELD)
    with assert_raises(flinders.errors.UsageError):
        flinders.read(tmp_path / "tumble.npy", pattern="{x} {y} {z}")


def test_midnight_between_stamps_does_not_turn_time_back(path: Path) -> None:
    stamps = ["23:59:59.900", "00:00:00.100"] + [f"00:00:{n:02d}.100" for n in range(1, 59)]
    lines = [f"{stamp} -> {axes(row)} uT" for stamp, row in zip(stamps, FIELD, strict=True)]
    time = read(path, lines).time
    assert time is not None
    assert (np.diff(time) > 0).all()
    np.testing.assert_allclose(time[1] - time[0], 0.2)


def test_two_magnetometers_by_label_are_both_named(path: Path) -> None:
    lines = ["mag1: {:.2f}, {:.2f}, {:.2f} mag2: {:.2f}, {:.2f}, {:.2f}".format(*row, *(2 * row)) for row in FIELD]
    path.write_text("\n".join(lines), encoding="utf-8")
    assert [instrument.name for instrument in flinders.open_log(path).instruments] == ["mag1", "mag2"]
    np.testing.assert_allclose(flinders.read(path, sensor="mag2").field, 2 * FIELD, atol=0.011)


def test_a_print_of_acceleration_is_no_magnetometer_in_words(path: Path) -> None:
    with assert_raises(NoMagnetometer):
        read(path, [f"Accel {axes(row)}" for row in GRAVITY])


@pytest.mark.parametrize("name", ["print.txt", "print.json"])
def test_a_calibration_names_the_file_that_was_printed_and_not_the_table_made_of_it(name: str, tmp_path: Path) -> None:
    path, out = tmp_path / name, tmp_path / "calibration.json"
    rows = simulate.tumble(seed=4).samples.field[::10]
    text = json.dumps(rows.tolist()) if name.endswith("json") else "".join(f"{axes(row)} uT\n" for row in rows)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path), "-o", str(out)])
    assert ended.value.code == 0
    (file,) = json.loads(out.read_text(encoding="utf-8"))["provenance"]["files"]
    assert file["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (file["bytes"], file["rows"]) == (path.stat().st_size, len(rows))


def words(row: Iterable[float]) -> str:
    """Hexadecimal words of eighths."""
    return " ".join(f"{int(8 * value) & 0xFFFF:04x}" for value in row)


@pytest.mark.parametrize("first", [1000, 9700])
def test_a_decimal_time_before_hexadecimal_words_stays_decimal(first: int, path: Path) -> None:
    """Also while it has as many digits as the words, and where it gets one more."""
    found = read(path, [f"{first + 20 * n} {words(row)}" for n, row in enumerate(FIELD)])
    np.testing.assert_array_equal(found.field, np.trunc(8 * FIELD))
    assert found.time is not None
    np.testing.assert_allclose(found.time, (first + 20.0 * np.arange(len(FIELD))) / 1000)
