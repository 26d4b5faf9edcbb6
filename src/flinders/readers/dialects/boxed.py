r"""Tables between bars and rulers, as printed by database clients, or in Markdown.

>>> dialect = recognise(["+----+------+------+------+", "| id |   mx |   my |   mz |", "+----+------+------+------+",
...                      "|  1 | 28.9 | 31.9 | 47.2 |"])
>>> dialect.names, dialect.row("|  2 | 28.4 | NULL | 47.0 |"), dialect.row("+----+----+"), dialect.row("(2 rows)")
(('id', 'mx', 'my', 'mz'), ['2', '28.4', 'NULL', '47.0'], (), ())
>>> dialect.row("ERROR: gone away") is None, recognise(["1|2|3", "4|5|6"])
(True, None)
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from flinders.readers._cells import parse_number, quote_cell
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

RULER: Final = re.compile(
    r"^\s*(?:[|+┌├└╒╞╘╔╠╚]\s*)?(?=[-=:─━═\s]*[+|┬┼┴╤╪╧╦╬╩])[-=:─━═]{2,}(?:\s*[|+┬┼┴╤╪╧╦╬╩]\s*[-=:─━═]{2,})*"
    r"\s*[|+┐┤┘╕╡╛╗╣╝]?\s*"
)
"""A line between rows, ``-----+-----``, ``|:---|---:|``."""
BARS: Final = re.compile(r"[|│┃║]")
_COUNT: Final = re.compile(r"\s*\(?[\d,]+ rows?\)?(?: in set.*)?\s*")  # line below the rows
WORDS: Final = "a table between bars"


class Boxed(Dialect):
    """Rows of cells between bars."""

    def row(self, line: str) -> Sequence[str] | None:
        """Split a line at its bars; a ruler, the header and the count of rows give no cells."""
        if RULER.fullmatch(line) or _COUNT.fullmatch(line):
            return ()
        cells = _cells(line)
        if len(cells) != len(self.names):
            return None
        return () if tuple(cells) == self.names else list(map(quote_cell, cells))


def recognise(lines: list[str]) -> Boxed | None:
    """Find names above a ruler, and lines with as many cells between bars."""
    filled = [line for line in lines if line.strip()]
    rows = [line for line in filled if not RULER.fullmatch(line)]
    widths = Counter(len(_cells(line)) for line in rows if BARS.search(line))
    width, often = max(widths.items(), key=lambda counted: counted[1], default=(0, 0))
    if width < len("xyz") or 2 * often < len(rows):
        return None
    heads = (_cells(line) for line, below in pairwise(filled) if RULER.fullmatch(below) and BARS.search(line))
    heads = (names for names in heads if len(names) == width and all(parse_number(name, ".") is None for name in names))
    names = next((names for names in heads if any(names)), None)
    return Boxed(WORDS, tuple(names)) if names else None


def _cells(line: str) -> list[str]:
    """Cells between the bars of a line; its first and last bar may be missing."""
    cells = [cell.strip() for cell in BARS.split(line.strip())]
    is_framed = BARS.match(line.strip()) is not None
    return cells[is_framed : len(cells) - (is_framed and not cells[-1])]
