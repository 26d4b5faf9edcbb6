"""Datagrams of magcc, ``|…*`` with thirteen numbers, as they were caught: one a line, or one after the other.

They are time (s), acceleration, rate (rad/s), field, and roll, pitch and yaw (rad), as magcc takes them at UDP port
50100. The unit of the field is not in them.

>>> is_magcc("|0.1,0,0,9.8,0,0,0.1,0.21,0.01,-0.58,0,0,1.57*")
True
>>> row = Magcc().row
>>> row("|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*")[7], row("|1,2,3*")
('0.21', None)
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.readers._lines import ENDS_EARLY, EndsEarly
from flinders.readers._numbers import number
from flinders.readers._source import Source, derived

if TYPE_CHECKING:
    from collections.abc import Iterator

DATAGRAM: Final = re.compile(r"\s*\|([^|*]*)\*\s*")
FIRST: Final = re.compile(r"^(?:.* -> )?[^\S\n]*\|((?:[^|*,\n]+,){12}[^|*,\n]+)\*", re.MULTILINE)
"""One at the start of a line; a serial monitor may put the time before."""
LONGEST: Final = 1 << 16
"""Characters without an end after which a datagram is none."""
NAMES: Final = (
    "t_s", "accel_x", "accel_y", "accel_z", "gyro_x_radps", "gyro_y_radps", "gyro_z_radps", "mag_x", "mag_y", "mag_z",
    "roll_rad", "pitch_rad", "yaw_rad",
)  # fmt: skip


def is_magcc(text: str) -> bool:
    """Tell whether a text begins with such datagrams, or with lines that are none before them."""
    return any(_numbers(found[1]) is not None for found in FIRST.finditer(text))


@dataclass(frozen=True, slots=True)
class Magcc:
    """A datagram in each line."""

    words: str = "magcc datagrams"
    names: tuple[str, ...] = NAMES

    def row(self, line: str) -> list[str] | None:
        """Take the thirteen numbers of a datagram, as they are written; None where it is none."""
        found = DATAGRAM.fullmatch(line)
        return _numbers(found[1]) if found else None


def recognise(lines: list[str]) -> Magcc | None:
    """Find a datagram among other lines."""
    return Magcc() if any(map(Magcc().row, lines)) else None


def table_of_datagrams(source: Source, encoding: str) -> tuple[Source, tuple[str, ...]]:
    """Turn datagrams into a table, which is kept as the file is: on the disk, or not at all.

    Returns
    -------
    Source, tuple of str
        The table, and the names of its columns.
    """
    return derived(source, _rows(source, encoding)), NAMES


def _rows(source: Source, encoding: str) -> Iterator[bytes]:
    """Yield the datagrams of each chunk as lines; what is cut short is a line too, and counted with the unreadable."""
    decoder, rest = codecs.getincrementaldecoder(encoding)("replace"), ""
    try:
        for chunk in source.chunks():
            *whole, rest = f"{rest}{decoder.decode(chunk)}".split("*")
            rest = rest[-LONGEST:]
            yield "".join(map(_lines, whole)).encode()
    except EndsEarly:
        yield f"{ENDS_EARLY}\n".encode()
        return
    yield _lines(rest).encode()


def _lines(text: str) -> str:
    """What stands behind each bar, up to the end of its line."""
    parts = [part.partition("\n")[0].strip() for part in text.split("|")[1:]]
    return "".join(f"{part}\n" for part in parts)


def _numbers(text: str) -> list[str] | None:
    found = [cell.strip() for cell in text.split(",")]
    return found if len(found) == len(NAMES) and None not in [number(cell, ".") for cell in found] else None
