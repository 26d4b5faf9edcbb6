r"""Lines of a running sensor as rows of a table that `flinders.read` reads.

How the first lines are written decides how all are read; it is recognised as in a file, so that what a file can hold can
be recorded. Time of arrival is put in front where the lines have no time of their own.

>>> form = settle(["starting up", "Raw:0,0,8192,0,0,16,217,4,-586", "Raw:0,0,8192,0,0,16,217,2,-587"])
>>> print(form)
Raw: lines
>>> form.header
't_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT'
>>> form.row("Raw:0,0,8192,0,0,16,217,4,-586", 0.25)
Row(text='0.2500,0,0,1,0,0,1,21.7,0.4,-58.6', field=(21.7, 0.4, -58.6))
>>> form.row("low battery", 0.26) is None
True
"""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.errors import FlindersError
from flinders.readers._numbers import SPACES, fits, number, split
from flinders.readers._sniff import COMMENTS, SPOKEN, Layout, sniff
from flinders.readers.dialects import guess, motioncal, recognise
from flinders.readers.dialects.pattern import Pattern
from flinders.readers.text import unit_of
from flinders.units import Unit, label

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.readers._numbers import Grid
    from flinders.readers.dialects import Dialect

TIME: Final = "t_s"
PLAIN: Final = ("mag_x", "mag_y", "mag_z")
"""Names of three columns without a header."""


class Row(NamedTuple):
    """A line as a row of the table, and the field in it; nothing of both where it is a part of a reading."""

    text: str
    field: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Form:
    """How a source writes its lines.

    Attributes
    ----------
    words : str
        For people.
    header : str
        What stands above the rows; empty where that is nothing.
    take : callable
        Line to row, without the time of arrival; nothing for a part of a reading, None where it is not understood.
    delimiter, decimal : str
        As in `Grid`.
    cells : tuple of int
        Where the field is in what `take` gives; empty where that is not known.
    scale : float
        From there to `unit`.
    unit : str
        ``µT`` or ``counts``.
    is_timed : bool
        The lines have a time of their own.
    """

    words: str
    header: str
    take: Callable[[str], str | None]
    delimiter: str = ","
    decimal: str = "."
    cells: tuple[int, ...] = ()
    scale: float = 1.0
    unit: str = "counts"
    is_timed: bool = False

    def row(self, line: str, arrived: float) -> Row | None:
        """Make a row of a line that arrived so many seconds after the start; None where it is not understood."""
        text = self.take(line)
        if not text:
            return None if text is None else Row("", ())
        cells = split(text, self.delimiter)
        values = [number(cells[cell], self.decimal) for cell in self.cells]
        field = tuple(value * self.scale for value in values if value is not None)
        return Row(text if self.is_timed else f"{self._time(arrived)}{self.delimiter}{text}", field)

    def _time(self, arrived: float) -> str:
        written = f"{arrived:.4f}".replace(".", self.decimal)
        return f'"{written}"' if self.delimiter == self.decimal else written

    def __str__(self) -> str:
        return self.words


def settle(lines: list[str], pattern: str | None = None) -> Form | None:
    """Tell from the first lines how they are written; None where none of them holds three numbers.

    Raises
    ------
    UsageError
        For a pattern that names no numbers.
    """
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines)
    layout = None if dialect else _layout(lines)
    dialect = dialect or (None if layout else guess(lines))
    if dialect is not None:
        return _transcribed(lines, dialect)
    if layout is not None:
        return _form(layout, lines, _kept(layout.grid, sorted(layout.grid.needed)))
    layout = _layout(lines, "1,2,3")  # it is not clear which the magnetometer's are: all are recorded
    return None if layout is None else _form(layout, lines, _kept(layout.grid, range(3)), is_clear=False)


def is_marked(line: str) -> bool:
    """Tell whether a line shows by its start that nothing of it is missing there; ``17,4,-586`` may have been 217."""
    if line.lstrip().startswith(("{", "[", "|", "(")) or motioncal.LINE.match(line):
        return True
    return not all(number(cell, ".") is not None for cell in re.split(r"[\s,;]+", line.strip()))


def _transcribed(lines: list[str], dialect: Dialect) -> Form | None:
    """Lay out lines in a dialect as the table that they stand for."""
    tried = deepcopy(dialect)  # a dialect remembers parts of a reading
    rows = [",".join(cells) for line in lines if (cells := tried.row(line))]
    take = partial(_joined, dialect)
    layout = _layout(rows, names=dialect.names)
    is_clear = layout is not None
    layout = layout or _layout(rows, "1,2,3", names=dialect.names)
    return layout and _form(layout, rows, take, words=dialect.words, names=dialect.names, is_clear=is_clear)


def _joined(dialect: Dialect, line: str) -> str | None:
    """Take a line in a dialect as a row."""
    cells = dialect.row(line)
    return None if cells is None else ",".join(cells)


def _layout(lines: list[str], columns: str | None = None, names: Sequence[str] = ()) -> Layout | None:
    """Recognise lines of numbers as a file with them would be; None where it is not clear what they are."""
    try:
        return sniff("", lines, columns, names)
    except FlindersError:
        return None


def _kept(grid: Grid, needed: Sequence[int]) -> Callable[[str], str | None]:
    """Take the lines of a table as they are, those with all of the needed numbers."""

    def take(line: str) -> str | None:
        text = line.strip(" ")
        cells = split(text, grid.delimiter)
        if text.startswith(COMMENTS) or not (fits(cells, grid.width) if grid.width else len(cells) > max(needed)):
            return None
        return None if any(number(cells[cell], grid.decimal) is None for cell in needed) else text

    return take


def _form(
    layout: Layout,
    lines: list[str],
    take: Callable[[str], str | None],
    *,
    words: str = "",
    names: Sequence[str] = (),
    is_clear: bool = True,
) -> Form:
    """Put together how lines are recorded; columns without names get some."""
    grid, chosen = layout.grid, layout.columns
    sign, is_timed = grid.delimiter, chosen.time is not None and _runs(lines, grid, chosen.time.cells[0])
    title = sign.join(names) if names else layout.header_text.strip().lstrip("#%/ ")
    if not title and not is_timed:
        width = grid.width or len(split(lines[-1], sign))
        title = sign.join(PLAIN if width == len(PLAIN) else [f"c{place + 1}" for place in range(width)])
    unit = unit_of(chosen, "", None, None) if is_clear else Unit.of()
    return Form(
        words or f"lines of numbers, {SPOKEN[sign]}-separated",
        title if is_timed or not title else f"{TIME}{sign}{title}",
        take,
        " " if sign == SPACES else sign,
        grid.decimal,
        chosen.field.cells if is_clear else (),
        unit.scale,
        label(unit.inside),
        is_timed,
    )


def _runs(lines: list[str], grid: Grid, cell: int) -> bool:
    """Tell whether a column does what time does; ``T_C`` may be a temperature."""
    rows = [cells for line in lines if len(cells := split(line, grid.delimiter)) > cell]
    times = [time for row in rows if (time := number(row[cell], grid.decimal)) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])
