"""Files that are no recording, or not one that is read yet: what they are, and what to do, is said of each."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.errors import NoMagnetometer, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

TYPED: Final = "--minmax=-183,171,-204,149,-260,88"
EXTREMES: Final = {
    "one a line": ("-183\n171\n-204\n149\n-260\n88\n", TYPED),
    "two a line": ("-183 171\n-204 149\n-260 88\n", TYPED),
    "all in a line": ("-183,171,-204,149,-260,88\n", TYPED),
    "labels": ("X min: -183 max: 171\nY min: -204 max: 149\nZ min: -260 max: 88\n", TYPED),
    "a label each": ("xmin=-183\nxmax=171\nymin=-204\nymax=149\nzmin=-260\nzmax=88\n", TYPED),
    "smallest first": ("-183\n-204\n-260\n171\n149\n88\n", "--minmax=X0,X1,Y0,Y1,Z0,Z1"),
}


@pytest.mark.parametrize("form", EXTREMES)
def test_six_numbers_are_typed(form: str, tmp_path: Path) -> None:
    text, typed = EXTREMES[form]
    (tmp_path / "six.txt").write_text(text)
    with assert_raises(NoMagnetometer) as caught:
        flinders.read(tmp_path / "six.txt")
    assert typed in str(caught.value)


def counts() -> Floats:
    noise = np.random.default_rng(2)
    directions = noise.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found: Floats = (453.0 * directions + [120.0, -300.0, 50.0] + 3.0 * noise.normal(size=(300, 3))).round()
    return found


HEXADECIMAL: Final = {
    "padded": ("mx my mz temp", "{:04X} {:04X} {:04X} 08FC", 16),
    "small letters": ("mag_x,mag_y,mag_z", "{:04x},{:04x},{:04x}", 16),
    "behind a time": ("t_ms;mx;my;mz", "{n};{:04X};{:04X};{:04X}", 16),
    "of 32 bits": ("mx\tmy\tmz", "{:08X}\t{:08X}\t{:08X}", 32),
    "without zeros": ("mx my mz", "{:X} {:X} {:X}", 32),
    "with 0x": ("mx my mz", "0x{:04X} 0x{:04X} 0x{:04X}", 16),
}


@pytest.mark.parametrize("form", HEXADECIMAL)
def test_words_under_a_header_are_in_twos_complement(form: str, tmp_path: Path) -> None:
    """Also in rows of digits alone."""
    header, line, bits = HEXADECIMAL[form]
    words = [[int(value) % (1 << bits) for value in row] for row in counts()]
    lines = [line.format(*row, n=20 * n) for n, row in enumerate(words)]
    (tmp_path / "log.txt").write_text("\n".join([header, *lines]))
    samples = flinders.read(tmp_path / "log.txt")
    np.testing.assert_array_equal(samples.field, counts())
    assert (samples.time is not None) == ("t_ms" in header)


@pytest.mark.parametrize(
    "fields",
    [
        "loopIteration,time,magADC[0],magADC[1],magADC[2]",
        "loopIteration,time,gyroADC[0]",
        "",
    ],
)
def test_a_blackbox_is_decoded_elsewhere(fields: str, tmp_path: Path) -> None:
    head = "H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"
    head += f"H Field I name:{fields}\n" if fields else ""
    (tmp_path / "log.bbl").write_bytes(head.encode() + bytes(range(256)) * 8)
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "log.bbl")


PACKETS: Final[dict[str, Callable[[int], bytes]]] = {
    "MAVLink 1": lambda n: bytes([0xFE, 26, n, 1, 1, 27]) + struct.pack("<Q9h", n, *range(9)) + b"\x12\x34",
    "MAVLink 2": lambda n: bytes([0xFD, 10, 0, 0, n, 1, 1, 27, 0, 0]) + bytes(range(10)) + b"\x12\x34",
    "signed": lambda n: bytes([0xFD, 10, 1, 0, n, 1, 1, 27, 0, 0]) + bytes(range(10)) + b"\x12\x34" + bytes(13),
}


@pytest.mark.parametrize("version", PACKETS)
def test_a_stream_of_packets_without_times_is_no_tlog(version: str, tmp_path: Path) -> None:
    (tmp_path / "stream.mavlink").write_bytes(b"".join(map(PACKETS[version], range(60))))
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "stream.mavlink")


def element(kind: int, content: bytes) -> bytes:
    """An element of a MATLAB file, filled up to 8 bytes."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def mat_of_objects(path: Path, *objects: tuple[str, str]) -> None:
    """Write variables as ``save('-v7')`` lays out objects of classes, unpacked."""
    header = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x01IM"
    arrays = [
        element(14, element(6, struct.pack("<II", 17, 0)) + b"".join(element(1, word.encode()) for word in words))
        for words in ((name, "MCOS", kind) for name, kind in objects)
    ]
    path.write_bytes(header + b"".join(arrays))


def mat_7_3_of_objects(path: Path, *objects: tuple[str, str]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, kind in objects:
            file[name] = np.arange(6, dtype=np.uint32).reshape(1, 6)
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
            file[name].attrs["MATLAB_object_decode"] = np.int32(3)
    content = bytearray(path.read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(content)


@pytest.mark.parametrize("write", [mat_of_objects, mat_7_3_of_objects])
def test_objects_of_matlab_are_named(write: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write(path, ("mag", "timeseries"), ("acc", "timeseries"))
    with pytest.raises(NoMagnetometer) as refused:
        flinders.read(path)
    assert all(f"{name}: timeseries" in str(refused.value) for name in ("mag", "acc"))
    assert_sentences(str(refused.value))
    write(path, ("TT", "timetable"))
    with assert_raises(NoMagnetometer):
        flinders.read(path)
