"""A log of ArduPilot with two simulated compasses, the first of which has offsets, and with a position."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats

HEAD: Final = b"\xa3\x95"
SHAPES: Final = {
    "PARM": (33, "<Q16sf", "QNf", "TimeUS,Name,Value"),
    "GPS": (34, "<QBIHBhiii", "QBIHBcLLe", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt"),
    "MAG": (35, "<Qhhhhhh", "Qhhhhhh", "TimeUS,MagX,MagY,MagZ,OfsX,OfsY,OfsZ"),
    "MAG2": (36, "<Qhhhhhh", "Qhhhhhh", "TimeUS,MagX,MagY,MagZ,OfsX,OfsY,OfsZ"),
}
"""Number, layout and description of each message that is written."""
OFFSETS: Final = {"MAG": (905, -668, -342), "MAG2": (0, 0, 0)}


def dataflash(
    first: Floats | None = None, *, week: int = 2400, offset: tuple[int, int, int] = OFFSETS["MAG"]
) -> Iterator[bytes]:
    """Yield the messages of a log.

    `first` are the readings of the first compass at 10 Hz in µT, `offset` is its COMPASS_OFS in mG, and `week` is the
    GPS week.
    """
    offsets = {**OFFSETS, "MAG": offset}
    yield _said("FMT", 128, 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    for name, (number, layout, letters, labels) in SHAPES.items():
        yield _said(name, number, 3 + struct.calcsize(layout), letters, labels)
    for axis, part in zip("XYZ", offset, strict=True):
        yield _message("PARM", 0, f"COMPASS_OFS_{axis}".encode(), float(part))
    yield _message("GPS", 1_000, 3, 388_800_000, week, 12, 80, 437_700_000, 112_600_000, 5_000)
    for number, seed in enumerate((2, 5)):
        field = simulate.tumble(seed=seed, motion="uniform" if number == 0 else "tilted").samples.field
        field = field if first is None or number else first
        name = ("MAG", "MAG2")[number]
        corrected = np.rint(10.0 * field + offsets[name]).astype(int).tolist()
        for row, axes in enumerate(corrected):
            yield _message(name, 20_000 + 100_000 * row + 5_000_000 * (row > 600), *axes, *offsets[name])


ROUND: Final = simulate.Sensor(np.eye(3), np.array([-30.0, 20.0, 40.0]), noise=0.3)
"""A compass without soft iron; a log states its calibration completely by offsets."""
RIGHT: Final = (300, -200, -400)
"""COMPASS_OFS that is right for the compass `ROUND`."""


def round_flight(offset: tuple[int, int, int] = RIGHT, motion: str = "uniform") -> bytes:
    """Log whose first compass is `ROUND`, with the onboard offset that is right for it, or with another one."""
    field = simulate.tumble(seed=3, sensor=ROUND, motion=motion, n=1000).samples.field
    return b"".join(dataflash(field, offset=offset))


def _said(name: str, number: int, length: int, letters: str, labels: str) -> bytes:
    cells = (name.encode(), letters.encode(), labels.encode())
    return HEAD + struct.pack("<BBB4s16s64s", 128, number, length, *cells)


def _message(name: str, *values: float | bytes) -> bytes:
    number, layout, _, _ = SHAPES[name]
    return HEAD + bytes([number]) + struct.pack(layout, *values)
