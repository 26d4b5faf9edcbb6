"""Alternating names and values in the cells of a line: ``2026-11-22T04:42:07,FD,raw_imu,xmag,292,ymag,-328,zmag,475``.

Other cells may be before and between the pairs, and vary from line to line. A word without a value, such as the name of
a message, must be the same in all lines that are read.

>>> dialect = recognise([f"1E,{n},imu,time_ms,{n}0,xmag,{n},ymag,-328,zmag,475, Len,41" for n in range(9)])
>>> dialect.names, dialect.row("5C,9,imu,time_ms,90,xmag,7,ymag,8,zmag,9, Len,41"), dialect.row("1D,2,gps,lat,52.1")
(('time_ms', 'xmag', 'ymag', 'zmag', 'Len'), ['90', '7', '8', '9', '41'], None)
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from flinders.readers._cells import parse_number
from flinders.readers._instruments import magnetometers
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

DELIMITERS: Final = (",", ";", "\t")
SIGN: Final = re.compile(r"(?:[,;\t] *[^\W\d][^,;\t]*[,;\t] *[-+]?[\d.]+ *){3}")
NAME: Final = re.compile(r"[^\W\d][^,;\t]*")
TITLE: Final = re.compile(r"[^\W\d_][\w./]{4,}")
"""A word without a value that names the message of a line."""
MIN_NAME_SHARE: Final = 0.9
"""Smallest share of the magnetometer's lines that contain a name; a rarer word is not a name."""


@dataclass(slots=True)
class Pairs(Dialect):
    """Lines that contain certain names, each before its value."""

    needed: frozenset[str]  # names of the magnetometer
    delimiter: str
    title: str  # title of these lines

    def row(self, line: str) -> Sequence[str] | None:
        """Values after the names; None if those of the magnetometer are missing."""
        title, values = _pairs(line, self.delimiter)
        is_own = self.needed <= values.keys() and title == self.title
        return [values.get(name, "") for name in self.names] if is_own else None


def recognise(lines: list[str]) -> Pairs | None:
    """Find names of a magnetometer that recur, each before a number."""
    for delimiter in DELIMITERS:
        rows = [_pairs(line, delimiter) for line in lines]
        counts = Counter(name for _, row in rows for name in row)
        if not (found := magnetometers(tuple(counts))):
            continue
        needed = frozenset(list(counts)[cell] for cell in found[0].cells)
        titles = Counter(title for title, row in rows if needed <= row.keys())
        title = max(titles, key=titles.__getitem__, default="")
        own = [row for each, row in rows if needed <= row.keys() and each == title]
        shared = Counter(name for row in own for name in row)
        names = tuple(name for name, count in shared.items() if count >= MIN_NAME_SHARE * len(own))
        if own:
            return Pairs("names and values in turn", names, needed, delimiter, title)
    return None


def _pairs(line: str, delimiter: str) -> tuple[str, dict[str, str]]:
    """Words of a line that are not names of numbers, joined; and its numbers, each by the name in front of it."""
    cells = [cell.strip() for cell in line.split(delimiter)]
    both = (each for each in pairwise(cells) if NAME.fullmatch(each[0]) and each[1])
    values = {
        name: value for name, value in both if parse_number(name, ".") is None and parse_number(value, ".") is not None
    }
    return " ".join(cell for cell in cells if cell not in values and TITLE.fullmatch(cell)), values
