"""Odd inputs: each is either read as meant or refused in one line that says what was found and what to do."""

from __future__ import annotations

import gzip
from typing import TYPE_CHECKING

import numpy.testing as npt
import pytest

import flinders
from flinders import simulate
from flinders.errors import InputError, NoMagnetometer, UnreadableInput
from flinders.readers import read

if TYPE_CHECKING:
    from pathlib import Path

TWO = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
GOOD = b"1,2,3\n4,5,6\n"

READ: dict[str, tuple[bytes, list[list[float]], int]] = {
    # what it is: bytes, the field that comes out, rows left out
    "commas": (GOOD, TWO, 0),
    "semicolons": (b"1;2;3\n4;5;6\n", TWO, 0),
    "tabs": (b"1\t2\t3\n4\t5\t6\n", TWO, 0),
    "runs of spaces": (b"  1   2 3\n 4 5    6  \n", TWO, 0),
    "tabs and spaces mixed": (b"1\t 2 3\n4 5\t6\n", TWO, 0),
    "commas and spaces": (b"1, 2, 3\n4, 5, 6\n", TWO, 0),
    "no line end at the end": (b"1,2,3\n4,5,6", TWO, 0),
    "CR LF": (b"1,2,3\r\n4,5,6\r\n", TWO, 0),
    "CR alone": (b"1,2,3\r4,5,6\r", TWO, 0),
    "all line ends mixed": (b"1,2,3\r\n4,5,6\r7,8,9\n", [*TWO, [7.0, 8.0, 9.0]], 0),
    "a delimiter at the end of each line": (b"1,2,3,\n4,5,6,\n", TWO, 0),
    "a delimiter at the end of some lines": (b"1,2,3\n4,5,6,\n", TWO, 0),
    "blank lines between": (b"\n1,2,3\n\n \n4,5,6\n\n", TWO, 0),
    "comments of three kinds": (b"# a, b, c\n1,2,3\n% so\n// there\n4,5,6\n", TWO, 0),
    "decimal comma and semicolons": (b"1,5;2;3\n4,5;5;6\n", [[1.5, 2, 3], [4.5, 5, 6]], 0),
    "decimal comma and tabs": (b"1,5\t2\t3\n4,5\t5\t6\n", [[1.5, 2, 3], [4.5, 5, 6]], 0),
    "decimal comma and spaces": (b"1,5 2,0 3,0\n4,5 5,0 6,0\n", [[1.5, 2, 3], [4.5, 5, 6]], 0),
    "decimal comma in quotes": (b'"1,5","2,0","3,0"\n"4,5","5,0","6,0"\n', [[1.5, 2, 3], [4.5, 5, 6]], 0),
    "quoted cells": (b'"1","2","3"\n"4","5","6"\n', TWO, 0),
    "exponents and signs": (b"+1e0,2.E0,.3e1\n4,5,6\n", TWO, 0),
    "UTF-8 with byte order mark": (b"\xef\xbb\xbfmx,my,mz\n1,2,3\n4,5,6\n", TWO, 0),
    "UTF-16, little end first": (b"\xff\xfe" + "mx,my,mz\r\n1,2,3\r\n4,5,6\r\n".encode("utf-16-le"), TWO, 0),
    "UTF-16, big end first": (b"\xfe\xff" + "1,2,3\n4,5,6\n".encode("utf-16-be"), TWO, 0),
    "UTF-16 cut in a character": (b"\xff\xfe" + "1,2,3\n4,5,6\n".encode("utf-16-le") + b"7", TWO, 1),
    "Latin-1": ("mx (µT);my (µT);mz (µT)\n1;2;3\n4;5;6\n".encode("latin-1"), TWO, 0),
    "UTF-8 cut in a character": (GOOD + b"7,8,\xce", TWO, 1),
    "gzip": (gzip.compress(GOOD), TWO, 0),
    "gzip in two members": (gzip.compress(b"1,2,3\n") + gzip.compress(b"4,5,6\n"), TWO, 0),
    "gzip without its checksum": (gzip.compress(GOOD)[:-8], TWO, 1),
    "gzip cut short in a number": (gzip.compress(GOOD + b"7,8,9123", 0)[:-11], TWO, 1),
    "MotionCal in gzip cut short": (
        gzip.compress(b"Raw:0,0,0,0,0,0,10,20,30\nRaw:0,0,0,0,0,0,40,50,60\n")[:-8],
        TWO,
        1,
    ),
    "a sentence above": (b"hold sensor still for calibration ...\n1,2,3\n4,5,6\n", TWO, 0),
    "settings above the header": (b"Fs,50.00\nInitialization time,60\nmx,my,mz\n1,2,3\n4,5,6\n", TWO, 0),
    "the header in a comment": (b"# t my mx mz\n0 2 1 3\n1 5 4 6\n", TWO, 0),
    "the header again in the middle": (b"mx,my,mz\n1,2,3\nmx,my,mz\n4,5,6\n", TWO, 0),
    "a header of one file only, joined by cat": (b"mx,my,mz\n1,2,3\nx,y,z\n4,5,6\n", TWO, 1),
    "text in a column beside": (b"mx,fix,my,mz\n1,NoFix,2,3\n4,3D,5,6\n", TWO, 0),
    "time that is text": (b"time,mx,my,mz\n12:00:01,1,2,3\n12:00:02,4,5,6\n", TWO, 0),
    "an ascending first of four": (b"0.1,1,2,3\n0.2,4,5,6\n", TWO, 0),
    "a row of units below the header": (b"t,mx,my,mz\ns,nT,nT,nT\n0,1000,2000,3000\n1,4000,5000,6000\n", TWO, 0),
    "a row of units in brackets": (b"t;mx;my;mz\n[ms];[mT];[mT];[mT]\n0;1e-3;2e-3;3e-3\n1;4e-3;5e-3;6e-3\n", TWO, 0),
    "a row of units and no names": (b"uT,uT,uT\n1,2,3\n4,5,6\n", TWO, 0),
    "the minus sign of text processors": ("1,2,3\n−4,−5e−1,6\n".encode(), [[1, 2, 3], [-4, -0.5, 6]], 0),
    "the minus sign and decimal commas": ("1;2;3\n−4,5;5;6\n".encode(), [[1, 2, 3], [-4.5, 5, 6]], 0),
    "a bad line": (b"1,2,3\nwhat?\n4,5,6\n", TWO, 1),
    "a short line": (b"1,2,3\n4,5\n4,5,6\n", TWO, 1),
    "two lines run together": (b"1,2,3\n4,51,2,3\n4,5,6\n", TWO, 1),
    "underscores are no numbers": (b"1,2,3\n1_0,2,3\n4,5,6\n", TWO, 1),
    "a cell without value": (b"mx,my,mz\n1,2,3\n,5,6\n4,5,6\n", TWO, 1),
    "NaN in several spellings": (b"1,2,3\nnan,1,1\nNA,1,1\nnull,1,1\n4,5,6\n", TWO, 3),
    "too large for a float": (b"1,2,3\n1e999,2,3\n4,5,6\n", TWO, 1),
    "nearly too large for a float": (b"1e300,2,3\n4,5,6\n", [[1e300, 2, 3], [4, 5, 6]], 0),
    "too large in the unit used inside": (b"mx_T,my_T,mz_T\n1e305,0,0\n1e-6,2e-6,3e-6\n4e-6,5e-6,6e-6\n", TWO, 1),
    "zeros that fill up the end": (GOOD + b"\x00" * 4096, TWO, 1),
    "a line of 2 MB among good ones": (GOOD + b"7" * 2_000_000, TWO, 1),
    "JSON with null": (b'[{"x":1,"y":2,"z":3},{"x":null,"y":1,"z":1},{"x":4,"y":5,"z":6}]', TWO, 1),
    "JSON with a pair among triples": (b"[[1,2,3],[7,8],[4,5,6]]", TWO, 1),
    "JSON lines with a broken one": (b"[1,2,3]\n[4,\n[4,5,6]\n", TWO, 1),
    "JSON numbers without bounds": (b"[[1,2,3],[1" + b"0" * 400 + b",0,0],[4,5,6]]", TWO, 1),
    "a log line that begins like JSON": (b"[INFO] boot\n1,2,3\n4,5,6\n", TWO, 0),
    "MotionCal with LF, space and decimals": (
        b"Raw:0,0,0,0,0,0,10,20,30\nCal1:1,2\nRaw 0,0,0,0,0,0,40.0,50,60\n",
        TWO,
        0,
    ),
    "units of Adafruit": (b"Uni:0,0,0,0,0,0,1,2,3\r\nUni:0,0,0,0,0,0,4,5,6\r\n", TWO, 0),
    "the word Raw in a header": (b"Raw X,Raw Y,Raw Z\n1,2,3\n4,5,6\n", TWO, 0),
}

REFUSED: dict[str, tuple[bytes, type[InputError], str]] = {
    # what it is: bytes, error, part of its message
    "nothing": (b"", UnreadableInput, "is empty"),
    "blank lines": (b" \n\t\r\n", UnreadableInput, "only blank lines"),
    "a byte order mark alone": (b"\xef\xbb\xbf", UnreadableInput, "only blank lines"),
    "comments": (b"# a\n# b\n", UnreadableInput, "only comments"),
    "prose": (
        b"Dear diary,\ntoday I calibrated\n",
        UnreadableInput,
        "no readings are recognised in odd.csv (line 1: 'Dear diary,')",
    ),
    "a header alone": (b"mx,my,mz\n", UnreadableInput, "no readings below"),
    "zeros": (b"\x00" * 1000, UnreadableInput, "binary file"),
    "binary": (bytes(range(256)) * 4, UnreadableInput, "binary file"),
    "a PNG": (b"\x89PNG\r\n\x1a\n" + bytes(50), UnreadableInput, "a PNG image"),
    "a JPEG": (b"\xff\xd8\xff\xe0" + bytes(50), UnreadableInput, "a JPEG image"),
    "a broken ZIP": (b"PK\x03\x04" + bytes(50), UnreadableInput, "cannot be read as a ZIP archive"),
    "a PDF": (b"%PDF-1.7\n1 0 obj\n", UnreadableInput, "a PDF"),
    "a page of the web": (b"\n<!DOCTYPE html>\n<html>1,2,3", UnreadableInput, "download the raw file"),
    "a Parquet table": (b"PAR1" + bytes(50), UnreadableInput, "Parquet"),
    "xz": (b"\xfd7zXZ\x00" + bytes(50), UnreadableInput, "unxz"),
    "gzip of nothing": (gzip.compress(b""), UnreadableInput, "only blank lines"),
    "gzip cut short in its own header": (gzip.compress(GOOD)[:8], UnreadableInput, "odd.csv is cut short: its gzip"),
    "gzip cut short before anything": (gzip.compress(GOOD)[:12], UnreadableInput, "odd.csv is cut short"),
    "gzip cut short in the header": (
        gzip.compress(b"a header of words that do not repeat, mx, my, mz\n1,2,3\n")[:30],
        UnreadableInput,
        "cut short before its first reading",
    ),
    "gzip of JSON cut short": (gzip.compress(b"[[1,2,3],[4,5,6]]")[:-9], UnreadableInput, "cut short"),
    "gzip of gzip": (gzip.compress(gzip.compress(GOOD)), UnreadableInput, "compressed twice"),
    "gzip magic and rubbish": (b"\x1f\x8b" + b"rubbish" * 9, UnreadableInput, "gzip"),
    "one line of 10 MB": (b"a" * 10_000_000, UnreadableInput, "longer than a million characters"),
    "one line of 10 MB of numbers": (b"1 " * 5_000_000, UnreadableInput, "longer than a million characters"),
    "one column": (b"1\n2\n3\n", NoMagnetometer, "fewer than three numbers"),
    "two columns": (b"x,y\n1,2\n3,4\n", NoMagnetometer, "(line 2: '1,2')"),
    "four without time": (b"5,1,2,3\n5,1,2,3\n", NoMagnetometer, "has 4 columns and no header (line 1: '5,1,2,3')"),
    "six without header": (b"1,2,3,4,5,6\n2,3,4,5,6,7\n", NoMagnetometer, "from 1: 1.00 to 2.00, 2: 2.00"),
    "an accelerometer": (
        b"ax,ay,az\n1,2,3\n",
        NoMagnetometer,
        "no magnetometer among the columns of odd.csv: ax, ay, az",
    ),
    "an accelerometer by its unit": (b"x (m/s^2),y (m/s^2),z (m/s^2)\n1,2,3\n", NoMagnetometer, "x (m/s^2)"),
    "positions": (b"pos_x,pos_y,pos_z\n1,2,3\n", NoMagnetometer, "pos_x"),
    "offsets alone": (b"mag_ofs_x,mag_ofs_y,mag_ofs_z\n1,2,3\n", NoMagnetometer, "mag_ofs_x"),
    "only NaN": (
        b"nan,nan,nan\nnan,nan,nan\n",
        UnreadableInput,
        "no usable reading in odd.csv: 2 rows without finite readings",
    ),
    "only infinity": (b"inf,1,2\n-inf,1,2\n", UnreadableInput, "2 rows without finite readings"),
    "more bad than good": (
        b"1,2,3\nfirst bad\nx\nlast bad\n",
        UnreadableInput,
        "3 of 4 lines of odd.csv are not readings. The first is line 2 ('first bad'), the last is line 4 ('last bad')",
    ),
    "JSON cut short": (b"[[1,2,3],[4,5", UnreadableInput, "starts like JSON"),
    "JSON without records": (b"[]", UnreadableInput, "an empty list"),
    "JSON that is one object": (b'{"mag":\n [[1,2,3]]}', UnreadableInput, "one object"),
    "a calibration file": (
        b'{\n  "flinders": "calibration",\n  "schema": 1\n}\n',
        UnreadableInput,
        "a calibration file of Flinders",
    ),
    "a calibration file in one line": (
        b'{"flinders": "calibration", "schema": 1, "calibration": {}}',
        UnreadableInput,
        "is a calibration file",
    ),
    "JSON of words": (b'["a", "b"]', UnreadableInput, "no readings are recognised"),
    "JSON nested too deep": (b"[" * 100_000, UnreadableInput, "JSON"),
    "escape codes of a terminal": (b"\x1b[31mred\x1b[0m\n", UnreadableInput, "\ufffd[31mred"),
}


@pytest.mark.parametrize("name", READ)
def test_odd_inputs_are_read(name: str, tmp_path: Path) -> None:
    """The numbers come out, and what is left out is counted."""
    content, field, left_out = READ[name]
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    samples = read(path)
    npt.assert_allclose(samples.field, field)
    assert sum(entry.rows for entry in samples.skipped) == left_out


@pytest.mark.parametrize("name", REFUSED)
def test_odd_inputs_are_refused(name: str, tmp_path: Path) -> None:
    """In one line of the right kind, printable, with what was found."""
    content, error, fragment = REFUSED[name]
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    with pytest.raises(error) as caught:
        read(path)
    message = str(caught.value)
    assert type(caught.value) is error
    assert fragment in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize("path", ["nowhere/at/all.csv", "a\0b", "x" * 5000, "."])
def test_odd_paths_are_refused(path: str) -> None:
    """No error of the operating system gets out, and no endless name."""
    with pytest.raises(UnreadableInput) as caught:
        read(path)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("scale", [2.0**-30, 2.0**36, 2.0**42])
def test_what_is_covered_does_not_depend_on_the_unit(scale: float) -> None:
    field = simulate.tumble(seed=1, n=1000).samples.field
    assert flinders.fit(scale * field).evidence.coverage.fraction == flinders.fit(field).evidence.coverage.fraction
