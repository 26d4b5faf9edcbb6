"""Layout of a table: delimiter, decimal sign, header and columns, recognised from its first lines.

All delimiters are tried on the first few hundred lines; the one with the most rows of numbers is used. The lines above
the first row are the preamble. A line of the preamble is the header if it has as many cells as the rows, and if its
names, parsed by `_names`, contain a magnetometer.

>>> lines = ["first flight", "t_s;mag_x_uT;mag_y_uT;mag_z_uT", "0,0;20,1;-3,0;41,2", "0,1;20,2;-3,1;41,3"]
>>> layout = recognise_table("log.csv", lines)
>>> str(layout), layout.start, layout.columns.field.names
('semicolon-separated, decimal comma', 3, ('mag_x_uT', 'mag_y_uT', 'mag_z_uT'))
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from flinders.errors import NoMagnetometer, UnreadableInput
from flinders.readers._cells import COMMENTS, SPACES, has_width, parse_number, quote_cell, split
from flinders.readers._choice import FIRST_SENSOR, Choice
from flinders.readers._clock import Clock, Midnights, clocks_of
from flinders.readers._column_choice import choose, rising_in
from flinders.readers._delimiters import Cut, first_row, is_comment, signs_of, split_lines
from flinders.readers._devices import are_ids, devices_in, names_device, sensor_column
from flinders.readers._grid import Grid
from flinders.readers._header import find_header, find_misfit, lines_above, stated_unit, units_below
from flinders.readers._likeness import has_clock
from flinders.readers._names import is_unit, meaning
from flinders.readers._refusals import (
    MAX_NAMELESS_COLUMNS,
    extremes_alone,
    no_magnetometer,
    no_readings_found,
    refuse_coded,
    refuse_matrices,
    refuse_nameless,
    refuse_unsafe,
)
from flinders.readers._times import seconds_and_nanoseconds
from flinders.readers._tokenizer import shorten
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._columns import Columns
    from flinders.readers._devices import Device, SensorColumn

    EveryLine: TypeAlias = Callable[[], Iterable[str]]

ON_BOARD: Final = "magADC is after the board's own mag_zero and alignment, on INAV after its gain too"
"""Note on readings in a blackbox; source: `compassUpdate` in `sensors/compass.c` of Betaflight and INAV."""
DELIMITER_WORDS: Final = {",": "comma", ";": "semicolon", "\t": "tab", SPACES: "space"}
TRIED_LINES: Final = 400  # lines that are tried first
SAMPLED_ROWS: Final = 200  # rows that are examined to distinguish numbers from text, and to find ascending times
MIN_SAME_WIDTH_SHARE: Final = 0.6
"""Smallest share of rows with the most common width for which other rows count as broken; not needed with a header."""
MAX_COLUMNS: Final = 4096  # largest number of columns in a table
_END_OF_HEADER: Final = re.compile(r"\W*end[ _]of[ _]header\W*", re.IGNORECASE)  # no line above this one is a reading


@dataclass(frozen=True, slots=True)
class TextLayout:
    """Layout of a recording in text."""

    grid: Grid
    columns: Columns
    start: int = 1  # number of the first line with readings
    header: tuple[str, ...] = ()  # names of the columns
    units: tuple[str, ...] = ()  # units in a row below the header; empty without one
    header_line: int = 0  # number of the header line; 0 without one
    header_text: str = ""  # text of the header line
    heading: str = ""  # words for a header that does not fit the columns
    words: str = ""  # description of the dialect, if the text was converted to a table
    spare: frozenset[int] = frozenset()  # columns that are empty in all rows with a reading
    in_force: str = ""  # onboard calibration that a blackbox states in its headers, and that its readings include
    encoding: str = "utf-8"
    newline: str = "\n"

    @property
    def is_blackbox(self) -> bool:
        """Whether the table is a decoded blackbox log, whose readings are in the axes of the board."""
        return self.columns.field.names[0].casefold().startswith("magadc")

    def is_reading(self, text: str) -> bool:
        """Whether a line below the header is expected to be a reading of the selected device."""
        return self._is_row(text) and not self.is_of_other_device(text)

    def is_of_other_device(self, text: str) -> bool:
        """Whether a line is a row of another device."""
        device = self.columns.device
        return device is not None and self._is_row(text) and device.is_of_other(split(text, self.grid.delimiter))

    def is_spare(self, text: str) -> bool:
        """Tell whether a row has values only in columns that rows with a reading leave empty, such as another topic."""
        if not self.spare:
            return False
        cells = split(text, self.grid.delimiter)
        is_empty = not any(cells[cell].strip() for cell in self.columns.field.cells if cell < len(cells))
        return is_empty and any(cells[cell].strip() for cell in self.spare if cell < len(cells))

    def _is_row(self, text: str) -> bool:
        """Whether a line is none of these: blank, a comment, a repeated header."""
        return bool(text.strip()) and not is_comment(text) and not (self.header_text and text == self.header_text)

    def __str__(self) -> str:
        if self.words:
            return self.words
        heading = self.heading or "no header" * (not self.header)
        parts = [heading] * bool(heading) + [f"{DELIMITER_WORDS[self.grid.delimiter]}-separated"]
        written = ", ".join(parts + ["decimal comma"] * (self.grid.decimal == ","))
        written += f"; {ON_BOARD}" * self.is_blackbox
        return written + f"; recorded with {self.in_force} in force" * bool(self.in_force)


@dataclass(slots=True)
class Cells(Dialect):
    """Dialect of lines that are rows of a table."""

    grid: Grid
    header_text: str = ""  # the header line

    @classmethod
    def of(cls, layout: TextLayout, words: str, nameless: Sequence[str] = ()) -> Cells:
        """Dialect for a table with a layout; units that are stated outside the header are appended to its names."""
        own = [each for each in (layout.columns, *layout.columns.magnetometers) if each.stated]
        told = {cell: each.unit for each in own for cell in each.field.cells}
        units = layout.units or [told.get(cell, "") for cell in range(len(layout.header))]
        named = zip_longest(layout.header, units, fillvalue="")
        names = [f"{name}_{unit}" if unit and not meaning(name).unit else name for name, unit in named]
        return cls(words, tuple(names or nameless), layout.grid, layout.header_text)

    def row(self, line: str) -> list[str] | None:
        """Split a line into cells; a line of another width, or with text in place of the field, gives no row."""
        if self.header_text and line == self.header_text:
            return []
        if is_comment(line) or self.grid.row(line) is None:
            return None
        cells = split(line, self.grid.delimiter)[: self.grid.width or None]
        return [quote_cell(cell.strip().replace(self.grid.decimal, ".")) for cell in cells]


def recognise_table(
    name: str,
    texts: list[str],
    columns: AnyColumns | None = None,
    header: Sequence[str] = (),
    flat: str | None = None,
    choice: Choice = FIRST_SENSOR,
    every: EveryLine | None = None,
) -> TextLayout:
    """Recognise the layout of a table from its first lines; `header` are names of columns that are known otherwise."""
    end = max((place for place, text in enumerate(texts[:TRIED_LINES]) if _END_OF_HEADER.fullmatch(text)), default=-1)
    texts = [""] * (end + 1) + texts[end + 1 :]
    lines = [(place, text) for place, text in enumerate(texts) if text.strip() and not is_comment(text)]
    if not lines:
        blank = not any(text.strip() for text in texts)
        content = "blank lines" if blank else "comments"
        marked = "" if blank else f"; if readings begin with {' or '.join(COMMENTS)}, state how they are printed"
        raise UnreadableInput(
            f"{name} holds only {content}: need lines of numbers, one reading each{marked}",
            hint={} if blank else {"pattern": None},
        )
    for some, least in ((lines[:TRIED_LINES], 3), (lines, 3), *([(lines, 2)] if flat else [])):
        best = max((split_lines(some, signs, least) for signs in signs_of(some)), key=Cut.score, default=None)
        if best is not None and best.rows:
            choosing = partial(choose, flat=flat, choice=choice, source=name)
            return _table(name, texts, best, header, choosing, columns, choice, every or (lambda: texts))
    raise extremes_alone(name, [text for _, text in lines]) or no_readings_found(name, lines)


class Body(NamedTuple):
    """Rows of numbers in a table; if each row names its sensor, only the rows of the magnetometer."""

    rows: dict[int, list[str]]  # cells by line index
    places: list[int]  # line indices of rows with the most common width
    width: int  # the most common width
    sensors: SensorColumn | None  # column that names the sensor of each row

    @classmethod
    def of(cls, best: Cut, name: str) -> Body:
        """Take the rows of a split text; raises `NoMagnetometer` if they have too many columns."""
        words = [at for at, value in enumerate(next(iter(best.values.values()))) if value is None]
        sensors = sensor_column(list(best.rows.values()), words)
        rows = {place: cells for place, cells in best.rows.items() if not sensors or sensors.is_of_first(cells)}
        ((width, _),) = Counter(map(len, rows.values())).most_common(1)
        if width > MAX_COLUMNS:
            raise NoMagnetometer(f"{name} has {width:,} columns: keep only those of the magnetometer and of its time")
        return cls(rows, [place for place, cells in rows.items() if len(cells) == width], width, sensors)

    @property
    def start(self) -> int:
        """Line index of the first row."""
        return min(self.places)

    @property
    def rows_of_one_width(self) -> list[list[str]]:
        """Cells of the rows with the most common width."""
        return [self.rows[place] for place in self.places]

    @property
    def filled_width(self) -> int:
        """Width without columns at the end that are empty in all rows."""
        alike = self.rows_of_one_width
        return self.width - next((at for at in range(self.width) if any(cells[-1 - at].strip() for cells in alike)), 0)

    def is_even(self, has_header: bool) -> bool:
        """Whether rows of another width count as broken: always under a header, otherwise if they are few."""
        return has_header or len(self.places) >= MIN_SAME_WIDTH_SHARE * len(self.rows)


class Head(NamedTuple):
    """Header of a table, and the first rows of numbers below it."""

    place: int  # line index of the header; -1 without one
    names: list[str]
    width: int  # columns
    words: str  # words for a header that does not fit the columns
    values: Floats
    clocks: list[Clock]

    @classmethod
    def of(
        cls, name: str, texts: list[str], best: Cut, body: Body, known: Sequence[str], asked: AnyColumns | None
    ) -> Head:
        """Find the header above the rows; `known` are names from elsewhere, `asked` are the requested columns."""
        sign, start, filled = best.signs[0], body.start, body.filled_width
        above = lines_above(texts[:start], sign, body.sensors)
        place, names = (-1, list(known)) if known else find_header(above, sign, filled, body.width)
        width = len(names) if filled <= len(names) <= body.width else filled
        values, clocks = _first_numbers(best, body.places, width, texts[start:])
        misfit = None if names else find_misfit(name, above, sign, values, clocks, asked)
        place, names = (misfit.place, misfit.names) if misfit else (place, names)
        return cls(place, names, width, misfit.words(width) if misfit else "", values, clocks)


def _table(
    name: str,
    texts: list[str],
    best: Cut,
    known: Sequence[str],
    choosing: partial[Columns | None],
    asked: AnyColumns | None,
    choice: Choice,
    every: EveryLine,
) -> TextLayout:
    """Lay out a table from the lines that are rows of numbers."""
    signs, body = best.signs, Body.of(best, name)
    head, start = Head.of(name, texts, best, body, known, asked), body.start
    devices = _devices(head, body, signs[0], every)
    if devices and (own := [place for place in body.places if not devices[0].is_of_other(body.rows[place])]):
        values, clocks = _first_numbers(best, own, head.width, texts[start:])
        head = head._replace(values=values, clocks=clocks)
    asked = asked or choice.remembered_columns(head.names, head.width, rising_in(head.values) if choice.forms else ())
    if not head.names:
        refuse_matrices(name, texts)
        if asked is None and not body.sensors:
            refuse_nameless(name, devices, head.clocks, head.width)
            head = head._replace(values=_numbers_of_all(texts[start:], head.values, signs))
    units = units_below(texts[head.place + 1 : start], signs[0], len(head.names)) if head.place >= 0 else ()
    choosing = partial(choosing, asked=asked, units=units, devices=devices)
    chosen = _choose_columns(name, texts, head, body, choosing)
    if asked is None:
        refuse_unsafe(name, head.names, body.rows_of_one_width, chosen, signs[1])
    width = head.width if body.is_even(bool(head.names)) else 0
    numbers = ", ".join(str(cell + 1) for cell in chosen.field.cells)
    named = f" ({', '.join(chosen.field.names)} of columns {numbers})" if head.words and head.names else ""
    return TextLayout(
        grid=Grid(*signs, width, chosen.cells, chosen.needed_cells, chosen.clock),
        columns=chosen,
        start=first_row(texts, head.place + 1, start) + 1,
        header=tuple(head.names),
        units=tuple(units),
        header_line=head.place + 1,
        header_text=texts[head.place] if head.place >= 0 else "",
        spare=_spare_columns(body.rows_of_one_width, chosen.field.cells),
        heading=head.words + named,
    )


def _choose_columns(name: str, texts: list[str], head: Head, body: Body, choosing: partial[Columns | None]) -> Columns:
    """Choose the columns, in the unit stated above them; raises `NoMagnetometer` if the choice is unclear."""
    start, header, values, alike = body.start, head.names, head.values, body.rows_of_one_width
    line = f" (line {start + 1}: {shorten(texts[start])!r})"
    chosen = choosing(
        header,
        values,
        heading=head.words,
        quoted=line,
        cells=alike[0][: head.width],
        clocks=head.clocks,
        is_told=body.sensors is not None,
    )
    if chosen is None:
        raise no_magnetometer(name, header, values, texts[start], f"{head.words or 'no header'}{line}", line)
    if chosen.device is None:
        refuse_coded(name, header, values, chosen.field.cells)
    unit = stated_unit(header, alike, texts[:start])
    return chosen.in_stated_unit(unit) if unit else chosen


def _spare_columns(rows: Sequence[Sequence[str]], field: Sequence[int]) -> frozenset[int]:
    """Places that are empty in every row that has a value of the field."""
    filled = [{place for place, cell in enumerate(row) if cell.strip()} for row in rows]
    return frozenset(range(len(rows[0]))).difference(*(places for places in filled if places & set(field)))


def _first_numbers(best: Cut, places: Sequence[int], width: int, texts: Sequence[str]) -> tuple[Floats, list[Clock]]:
    """Numbers of the first rows, and the clocks of their times; a time that is text is in seconds."""
    some = places[:SAMPLED_ROWS]
    values = np.array([best.values[place][:width] for place in some], dtype=float)
    return values, _clocks(texts, [best.rows[place] for place in some], values, best.signs[0])


def _numbers_of_all(texts: Sequence[str], values: Floats, signs: tuple[str, str]) -> Floats:
    """Numbers of all lines, if an axis only rises in the first lines of a table without a header; else unchanged."""
    width = values.shape[1]
    if width not in (3, 4) or not has_clock(values[:, width - 3 :]):
        return values
    cut = (split(text, signs[0]) for text in texts)
    rows = [[parse_number(cell, signs[1]) for cell in cells] for cells in cut if len(cells) == width]
    return np.array(rows, dtype=float)


def _clocks(texts: Sequence[str], rows: Sequence[Sequence[str]], values: Floats, delimiter: str) -> list[Clock]:
    """Find the time columns that are not numeric, and put their seconds into `values`.

    All lines are used if the first rows leave the order of day and month open.
    """
    words = [place for place, column in enumerate(values.T) if np.isfinite(column).mean() < 0.5]
    clocks = []
    for clock in clocks_of(rows, words):
        known = clock if clock.is_settled else Clock.of((split(text, delimiter) for text in texts), clock.cells)
        seconds = np.array([known.seconds(row) for row in rows[: len(values)]])
        values[:, known.cell] = Midnights(known).unwrap(seconds)
        clocks.append(known)
    return clocks


def _devices(head: Head, body: Body, delimiter: str, every: EveryLine) -> tuple[Device, ...]:
    """Devices that a column distinguishes: found by its name or in the first rows, then listed from all rows.

    Columns of times are ignored. If a column names sensors, only the rows of a magnetometer count.
    """
    header, width, sensors = head.names, head.width, body.sensors
    times = {cell for clock in head.clocks for cell in clock.cells}
    times = times.union(() if header else seconds_and_nanoseconds(head.values))
    alike = [cells[:width] for cells in body.rows_of_one_width]
    free = [place for place in range(width) if place not in times and not (sensors and place == sensors.place)]
    if header:
        places = [at for at in free if at < len(header) and names_device(header[at], header)]
        places = [at for at in places if not all(is_unit(row[at].strip()) for row in alike)]
    else:
        ahead = width - len("xyz") if width <= MAX_NAMELESS_COLUMNS else 0
        places = [at for at in free if are_ids((row[at] for row in alike), is_ahead=at < ahead)]

    def rows() -> Iterator[tuple[str, ...]]:
        for text in every():
            cells = split(text, delimiter)
            if has_width(cells, width):
                yield tuple(cells[place] for place in places)

    found = devices_in(header, places, rows) if places else ()
    return sensors.devices(header, found) if sensors else found
