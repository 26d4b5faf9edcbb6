r"""Datagrams of magcc, ``|…*`` with thirteen numbers, as they were caught: one a line, or one after the other.

They are time (s), acceleration, rate (rad/s), field, and roll, pitch and yaw (rad), as magcc takes them at UDP port
50100. The unit of the field is not in them.

>>> dialect = recognise(["waiting", "|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*"])
>>> dialect.row("|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*")[7], dialect.row("|1,2,3*")
('0.21', None)
>>> are_glued("|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*|0.2,0,0")
True
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.readers._lines import ENDS_EARLY, EndsEarly
from flinders.readers._numbers import number
from flinders.readers._tokenizer import Dialect

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.readers._source import Source

DATAGRAM: Final = re.compile(r"(?:.* -> )?\s*\|([^|*]*)\*\s*")
"""A serial monitor may put the time before."""
GLUED: Final = re.compile(r"^\s*\|(?:[^|*,\n]+,){12}[^|*,\n]+\*[^\S\n]*\|", re.MULTILINE)
NAMES: Final = (
    "t_s", "accel_x", "accel_y", "accel_z", "gyro_x_radps", "gyro_y_radps", "gyro_z_radps", "mag_x", "mag_y", "mag_z",
    "roll_rad", "pitch_rad", "yaw_rad",
)  # fmt: skip


@dataclass(slots=True)
class Magcc(Dialect):
    """A datagram in each line."""

    def row(self, line: str) -> list[str] | None:
        """Take the thirteen numbers of a datagram, as they are written; None where it is none."""
        found = DATAGRAM.fullmatch(line)
        cells = [cell.strip() for cell in found[1].split(",")] if found else []
        return cells if len(cells) == len(NAMES) and None not in [number(cell, ".") for cell in cells] else None


def recognise(lines: list[str]) -> Magcc | None:
    """Find a datagram among other lines."""
    dialect = Magcc("magcc datagrams", NAMES)
    return dialect if any(map(dialect.row, lines)) else None


def are_glued(beginning: str) -> bool:
    """Tell whether datagrams follow one another without the end of a line between them."""
    return GLUED.search(beginning) is not None


def one_a_line(source: Source) -> Iterator[bytes]:
    """Yield the bytes of a source with an end of line behind each datagram."""
    try:
        for chunk in source.chunks():
            yield chunk.replace(b"*", b"*\n")
    except EndsEarly:
        yield f"\n{ENDS_EARLY}\n".encode()
