r"""Lines of a running sensor as rows of a table that `flinders.read` reads.

How the first lines are written decides how all are read; it is recognised as in a file, so that what a file can hold
can be recorded. Time of arrival is put in front where the lines have no time of their own.

>>> form = settle(["starting up", "X: 21.7 Y: 0.4 Z: -58.6 uT", "X: 21.7 Y: 0.2 Z: -58.7 uT"])
>>> print(form, "as", form.header)
labelled lines as t_s,X (uT),Y (uT),Z (uT)
>>> form.row("X: 21.5 Y: 0.3 Z: -58.5 uT", 0.25), form.row("low battery", 0.26)
('0.2500,21.5,0.3,-58.5', None)
"""

from __future__ import annotations

import re
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Final

from flinders.errors import FlindersError
from flinders.readers._names import is_unit, meaning
from flinders.readers._numbers import SPACES, Grid, number, row_of, split
from flinders.readers._sniff import COMMENTS, SPOKEN, TextLayout, sniff
from flinders.readers.dialects import guess, marked, recognise
from flinders.readers.dialects.pattern import Pattern

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.readers._tokenizer import Dialect

TIME: Final = "t_s"
PLAIN: Final = ("mag_x", "mag_y", "mag_z")  # Names of three columns without a header
SEVERAL: Final = 3
"""Lines with numbers in the same places that are a table where words stand before them; a message comes once."""


@dataclass(frozen=True, slots=True)
class Form:
    """How a source writes its lines."""

    words: str  # for people
    header: str  # what stands above the rows; empty where that is nothing
    take: Callable[[str], str | None]  # line to row without a time; nothing for a part of a reading, None where unknown
    delimiter: str
    decimal: str
    is_timed: bool  # the lines have a time of their own
    printed: str  # the header as the source prints it

    def is_heading(self, line: str) -> bool:
        """Tell whether a line is the header come again, or a row of units below it."""
        cells = split(line.strip(), SPACES if self.delimiter.isspace() else self.delimiter)
        return line.strip() in (self.printed, self.header) or all(is_unit(cell.strip(" []()")) for cell in cells)

    def row(self, line: str, arrived: float) -> str | None:
        """Make a row of a line that arrived so many seconds after the start; None where it is not understood."""
        text = self.take(line)
        return f"{self._time(arrived)}{self.delimiter}{text}" if text and not self.is_timed else text

    def _time(self, arrived: float) -> str:
        written = f"{arrived:.4f}".replace(".", self.decimal)
        return f'"{written}"' if self.delimiter == self.decimal else written

    def __str__(self) -> str:
        return self.words


def settle(lines: list[str], pattern: str | None = None) -> Form | None:
    """Recognise from the first lines how they are written; None where none of them holds three numbers."""
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines)
    layout = None if dialect else _layout(lines)
    if dialect := dialect or (None if layout else guess(lines)):
        return _transcribed(lines, dialect)
    layout = layout or _unclear(lines)
    return _form(layout, lines, partial(_as_it_is, layout.grid)) if layout else None


def is_marked(line: str) -> bool:
    """Tell whether a line shows by its start that nothing of it is missing there; ``17,4,-586`` may have been 217."""
    if line.lstrip().startswith(("{", "[", "|", "(")) or marked.is_marked(line):
        return True
    return not all(number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


def _transcribed(lines: list[str], dialect: Dialect) -> Form | None:
    """Lay out lines in a dialect as the table that they stand for."""
    first = partial(_joined, deepcopy(dialect))  # a dialect remembers parts of a reading
    rows = [row for row in map(first, lines) if row]
    layout = _layout(rows, names=dialect.names) or _unclear(rows, dialect.names)
    return None if layout is None else _form(layout, rows, partial(_joined, dialect), dialect.words, dialect.names)


def _layout(lines: list[str], columns: str | None = None, names: Sequence[str] = ()) -> TextLayout | None:
    """Recognise lines of numbers as a file with them would be; None where it is not clear what they are."""
    try:
        return sniff("", lines, columns, names)
    except FlindersError:
        return None


def _unclear(lines: list[str], names: Sequence[str] = ()) -> TextLayout | None:
    """Recognise a table of which all is recorded, as it is not clear what is the magnetometer: by three numbers."""
    layout = _layout(lines, "1,2,3", names)
    if layout is None:
        return None
    grid = layout.grid
    rows = [split(line, grid.delimiter) for line in lines]
    numeric = Counter(
        tuple(place for place, cell in enumerate(cells, 1) if cell.strip() and number(cell, grid.decimal) is not None)
        for cells in rows
    )
    places, count = numeric.most_common(1)[0]
    if len(places) >= len(PLAIN) and count >= max(SEVERAL, len(rows) / 2):
        return _layout(lines, ",".join(map(str, places[: len(PLAIN)])), names) or layout
    return layout


def _joined(dialect: Dialect, line: str) -> str | None:
    """Take a line in a dialect as a row."""
    cells = dialect.row(line)
    return None if cells is None else ",".join(cells)


def _as_it_is(grid: Grid, line: str) -> str | None:
    """Take a line of a table as it is, where its numbers are there."""
    text = line.strip(" ")
    return None if text.startswith(COMMENTS) or row_of(split(text, grid.delimiter), grid) is None else text


def _form(
    layout: TextLayout, lines: list[str], take: Callable[[str], str | None], words: str = "", names: Sequence[str] = ()
) -> Form:
    """Put together how lines are recorded; columns without names get some."""
    grid, sign, time = layout.grid, layout.grid.delimiter, layout.columns.time
    is_timed = time is not None and _runs(lines, grid, time.cells[0])
    title = sign.join(names) or _title(layout)
    if not title and not is_timed:
        width = grid.width or len(split(lines[-1], sign))
        title = sign.join(PLAIN if width == len(PLAIN) else [f"c{place + 1}" for place in range(width)])
    header = title if is_timed or not title else f"{TIME}{sign}{title}"
    words = words or f"lines of numbers, {SPOKEN[sign]}-separated"
    return Form(
        words, header, take, " " if sign == SPACES else sign, grid.decimal, is_timed, layout.header_text.strip()
    )


def _title(layout: TextLayout) -> str:
    """Write the header of a table with the units, and the sensors, that stand in lines of their own."""
    title, sign = layout.header_text.strip().lstrip("#%/ "), layout.grid.delimiter
    named = zip_longest(layout.header, layout.units, fillvalue="")
    names = [f"{name}_{unit}" if unit and not meaning(name).unit else name for name, unit in named]
    is_whole = all(name in title for name in names)
    is_cuttable = not any(sign in name for name in names)
    return sign.join(names) if names and not is_whole and is_cuttable else title


def _runs(lines: list[str], grid: Grid, cell: int) -> bool:
    """Tell whether a column does what time does; ``T_C`` may be a temperature."""
    rows = [cells for line in lines if len(cells := split(line, grid.delimiter)) > cell]
    times = [time for row in rows if (time := number(row[cell], grid.decimal)) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])
