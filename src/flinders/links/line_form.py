"""Form of a sensor's lines: the format of the first ones, and of the table in which all lines are recorded."""

from __future__ import annotations

import contextlib
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from flinders.readers._cells import parse_number, quote_cell, split
from flinders.readers._layout import DELIMITER_WORDS, Cells, TextLayout, recognise_table
from flinders.readers._names import is_unit
from flinders.readers._recognition import recognise_layout

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.readers.dialects import Dialect

TIME_NAME: Final = "t_s"
PLAIN_NAMES: Final = ("mag_x", "mag_y", "mag_z")  # Names for three columns without a header
MIN_TABLE_LINES: Final = 3
"""Smallest number of lines with words before numbers in the same places that form a table; fewer are messages."""


@dataclass(frozen=True, slots=True)
class Form:
    """Format of a source's lines, and of the table in which they are recorded."""

    dialect: Dialect
    layout: TextLayout  # layout of the lines, or of the table rows that the dialect makes of them
    names: tuple[str, ...]  # names of the columns; empty if the source prints a time and no names
    is_timed: bool  # whether the lines contain a time

    @property
    def header(self) -> str:
        """The line above the rows; empty if there is none."""
        return ",".join(map(quote_cell, self.names))

    def is_heading(self, line: str) -> bool:
        """Whether a line repeats the header, or is a row of units below it."""
        cells = split(line.strip(), self.layout.grid.delimiter)
        is_header = line.strip() in (self.layout.header_text.strip(), self.header)
        return is_header or all(is_unit(cell.strip(" []()")) for cell in cells)

    def row(self, line: str, arrived: float) -> str | None:
        """Row for a line that arrived at `arrived` s after the start; None if the line cannot be parsed."""
        cells = self.dialect.row(line)
        if cells and not self.is_timed:
            cells = (f"{arrived:.4f}", *cells)
        return None if cells is None else ",".join(cells)

    def rows(self, lines: Sequence[str]) -> list[str]:
        """Rows for some lines; the state of the dialect stays unchanged."""
        trial = replace(self, dialect=deepcopy(self.dialect))  # a dialect stores parts of a reading
        return [row for line in lines if (row := trial.row(line, 0.0))]

    def __str__(self) -> str:
        return self.dialect.words


def recognise_form(lines: list[str], pattern: str | None = None) -> Form | None:
    """Form of the first lines of a source; None if no line has three numbers.

    >>> form = recognise_form(["starting up", "X: 21.7 Y: 0.4 Z: -58.6 uT", "X: 21.7 Y: 0.2 Z: -58.7 uT"])
    >>> print(form, "as", form.header)
    labelled lines as t_s,X (uT),Y (uT),Z (uT)
    >>> form.row("X: 21.5 Y: 0.3 Z: -58.5 uT", 0.25), form.row("low battery", 0.26)
    ('0.2500,21.5,0.3,-58.5', None)
    """
    for lay_out in (partial(recognise_table, ""), _layout_without_columns):
        with contextlib.suppress(Exception):  # a recording must go on whatever a board prints
            dialect, layout = recognise_layout("", lines, lay_out, pattern)
            words = f"lines of numbers, {DELIMITER_WORDS[layout.grid.delimiter]}-separated"
            return _make_form(
                dialect or Cells.of(layout, words), layout, lines, is_clear=lay_out is not _layout_without_columns
            )
    return None


def _make_form(dialect: Dialect, layout: TextLayout, lines: list[str], *, is_clear: bool) -> Form:
    """Form for a dialect and a layout; columns that have neither names nor a time get names."""
    form = Form(dialect, layout, dialect.names, is_timed=True)
    rows = [split(row, ",") for row in form.rows(lines)]
    width = layout.grid.width or max(map(len, rows), default=0)
    is_told = is_clear and layout.columns.device is not None and not dialect.names
    nameless = PLAIN_NAMES if is_clear and width == len(PLAIN_NAMES) else _default_names(layout, width, is_told=is_told)
    if (time := layout.columns.time) and _is_time([row[time.cells[0]] for row in rows if len(row) > time.cells[0]]):
        return replace(form, names=nameless) if is_told else form
    return replace(form, names=(TIME_NAME, *(dialect.names or nameless)), is_timed=False)


def _default_names(layout: TextLayout, width: int, *, is_told: bool) -> tuple[str, ...]:
    """Names for unnamed columns; with `is_told`, words in each row name the columns of magnetometer and time."""
    columns = layout.columns
    known = dict(zip(columns.field.cells, PLAIN_NAMES, strict=True)) if is_told else {}
    known |= {columns.time.cells[0]: "time"} if is_told and columns.time else {}
    return tuple(known.get(place, f"c{place + 1}") for place in range(width))


def _is_time(column: Sequence[str]) -> bool:
    """Whether a column rises like a time; a column ``T_C`` may also be a temperature."""
    times = [time for cell in column if (time := parse_number(cell, ".")) is not None]
    return all(b >= a for a, b in pairwise(times)) and (len(times) < 2 or times[-1] > times[0])


def _layout_without_columns(lines: list[str], header: Sequence[str] = (), **_: object) -> TextLayout:
    """Layout of a table whose magnetometer columns are not known; all columns are recorded."""
    layout = recognise_table("", lines, "1,2,3", header)
    if not layout.header:  # an increasing column may be an axis
        layout = replace(layout, columns=layout.columns.with_only())
    sign, decimal = layout.grid.delimiter, layout.grid.decimal
    rows = [split(line, sign) for line in lines]
    numeric = Counter(
        tuple(place for place, cell in enumerate(row) if cell.strip() and parse_number(cell, decimal) is not None)
        for row in rows
    )
    places, count = numeric.most_common(1)[0]
    if len(places) < len(PLAIN_NAMES) or count < max(MIN_TABLE_LINES, len(rows) / 2):
        return layout
    cells = places[: len(PLAIN_NAMES)]
    return replace(layout, grid=replace(layout.grid, cells=cells, needed=frozenset(cells)))
