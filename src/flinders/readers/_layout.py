"""How text is written: as a table, with its delimiter, decimal sign and header, or in a dialect, which becomes one.

Every way of cutting lines is tried on the first few hundred; the one that yields the most lines of numbers is taken.
What stands above the first such line is preamble, and a header if it has as many cells as the readings and its names,
as `_names` reads them, hold a magnetometer.

>>> dialect = recognise(["starting up", "X: -20.8 Y: -20.2 Z: 26.1 uT", "X: -20.7 Y: -20.1 Z: 26.2 uT"])
>>> dialect.words, dialect.names
('labelled lines', ('X (uT)', 'Y (uT)', 'Z (uT)'))
>>> dialect.row("X: -20.6 Y: -20.0 Z: 26.3 uT"), dialect.row("low battery") is None
(['-20.6', '-20.0', '26.3'], True)
"""

from __future__ import annotations

import re
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from flinders.core.units import PARTED, SPELLINGS
from flinders.errors import FlindersError, NoMagnetometer, UnreadableInput, UsageError, figures
from flinders.readers._clock import Clock, Midnights, clocks_of
from flinders.readers._columns import Columns, choose, rising_in, seconds_and_nanoseconds
from flinders.readers._devices import (
    MAX_DEVICES,
    MIN_READINGS,
    are_ids,
    bare,
    devices_in,
    names_device,
    sensor_column,
    sensors_of_words,
)
from flinders.readers._heading import shifted
from flinders.readers._known_texts import refusal
from flinders.readers._likeness import GRAVITY, NEARLY, STEADY, XYZ, advice, groups, has_clock
from flinders.readers._names import (
    ACCELERATION,
    FIELD,
    FIRST,
    MOST_NAMED,
    RATE,
    Choice,
    Meaning,
    clearness,
    is_unit,
    magnetometers,
    meaning,
    names_magnetometer,
    vectors,
)
from flinders.readers._source import derived
from flinders.readers._tokenizer import (
    COMMENTS,
    CUT_OFF,
    ENDS_EARLY,
    GLUED,
    MOMENT,
    QUANTITY,
    SPACES,
    Grid,
    cut,
    fits,
    is_labelled,
    listed,
    names_of,
    number,
    pattern_of,
    quoted,
    shown,
    split,
)
from flinders.readers.dialects import Dialect, boxed, influx, json_records, labelled, marked, pairs, wrapped
from flinders.readers.dialects.pattern import Pattern

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.errors import InputError
    from flinders.readers._devices import Device, SensorColumn
    from flinders.readers._source import Source

    EveryLine: TypeAlias = Callable[[], Iterable[str]]

ON_BOARD: Final = "magADC is after the board's own mag_zero and alignment, on INAV after its gain too"
"""What a blackbox logs; `compassUpdate` in `sensors/compass.c` of Betaflight and INAV."""
SIGNS: Final = (
    (",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (SPACES, "."), (SPACES, ","), (",", ","),
)  # fmt: skip
"""Delimiters and decimal signs; of equally good ones the first is taken."""
SPOKEN: Final = {",": "comma", ";": "semicolon", "\t": "tab", SPACES: "space"}
ONE_VALUE_SIGNS: Final = (",", ";", "\t", "|")  # Delimiters of tables with one value a row
TRIED: Final = 400  # Lines that are tried first
SAMPLED: Final = 200  # Rows looked at to tell numbers from text, and ascending times
SAME_WIDTH: Final = 0.6
"""Share of rows with the same number of cells from which on others count as broken; under a header they always do."""
HEADING: Final = 2  # Lines above a table of plain numbers that may hold anything
PRINTED: Final = 1024  # Characters of a line that are looked at for labels
LONGEST_EXAMPLE: Final = 160  # Characters of a line that is shown as a pattern
MOST_ABOVE: Final = 40  # Lines in which a header without readings is looked for
MOST_COLUMNS: Final = 4096  # Columns of a table
MOST_NAMES_OVER: Final = 2  # Names that a header may have more than lines have fields
NAMELESS: Final = 5  # Columns without a header, up to which a number ahead of three is that of a sensor
MAX_CODES: Final = 16  # Different whole numbers of a column that may say which sensor each line is of
IN_TURN: Final = 0.2  # Share of rows at which such a number changes
LEAST_OF_CODE: Final = 10  # Lines of such a number that are judged
APART: Final = 2.0
FAR_APART: Final = 5.0
"""Ratio of the median lengths of such lines, one of them that of gravity or not, from which on sensors are not one."""
MOST_RANGES: Final = 16  # Columns whose ranges are listed
_PLAIN: Final = re.compile(r"[-+.,;\s\d]*(?:(?:[eE][-+]\d|nan)[-+.,;\s\d]*)*", re.ASCII)
_GROUPED: Final = re.compile(r"[-+\u2212]?[1-9]\d{0,2}[.,]\d{3}")  # thousands, or three decimals
_OPENS_JSON: Final = re.compile(r"^\s*[\[{]")
_CLOCK: Final = re.compile(r"\d:\d\d:\d\d")
MATRIX: Final = re.compile(r"# (?:name: (?P<name>.+)|columns: (?P<columns>\d+)\s*$)")  # in text of Octave
ADDRESS_CELL: Final = re.compile(r"(?:^|[,;\t]) *[\da-f]{2}(?::[\da-f]{2})+ *(?=$|[,;\t])", re.IGNORECASE)
_END_OF_HEADER: Final = re.compile(r"\W*end[ _]of[ _]header\W*", re.IGNORECASE)  # numbers above are no readings
_UNITS: Final = re.compile(r"(?:(?:mag|field)[ _-]?)?units?", re.IGNORECASE)  # name of a column
_SAYS_UNIT: Final = re.compile(
    r"\W*(?:(?:mag[^\W_]*|(?:magnetic[ _])?field|the)[\W_]+)*units?(?:[ _]of[ _](?:the[ _])?(?:mag\w*|field))?"
    r"(?:\s+(?:is|are)\b|[\"']?\s*[:=,;\t])\s*[\"'\[(]?((?:(?:micro|milli|nano)[ _-])?[^\W\d_]+)\W*",
    re.IGNORECASE,
)
"""A line that says in which unit the field is."""
_OTHER_UNITS: Final = ("g", "mg", "t", "raw")  # gravity, and what says nothing
_LETTER: Final = re.compile(r"[^\W\d_]")


@dataclass(frozen=True, slots=True)
class TextLayout:
    """How a recording is written."""

    grid: Grid
    columns: Columns
    start: int = 1  # number of the first line with readings
    header: tuple[str, ...] = ()  # names of the columns
    units: tuple[str, ...] = ()  # those in a row below the header; empty where there is none
    header_line: int = 0  # where they stand; 0 where nowhere
    header_text: str = ""  # that line, as it is
    heading: str = ""  # of a header with another number of names than lines have fields, how many there are
    words: str = ""  # the dialect that was made a table of, for people
    spare: frozenset[int] = frozenset()  # columns that rows with a reading leave empty
    in_force: str = ""  # the calibration of the board that readings are after, where headers of a blackbox tell one
    encoding: str = "utf-8"
    newline: str = "\n"

    @property
    def is_blackbox(self) -> bool:
        """It is a log of Betaflight or INAV, whose readings are in the axes of the board."""
        return self.columns.field.names[0].casefold().startswith("magadc")

    def is_reading(self, text: str) -> bool:
        """Tell whether a line below the header should be a reading that is read."""
        return self._is_row(text) and not self.is_of_other_device(text)

    def is_of_other_device(self, text: str) -> bool:
        """Tell whether a line is a row of a device that is not read."""
        device = self.columns.device
        return device is not None and self._is_row(text) and device.is_of_other(split(text, self.grid.delimiter))

    def is_of_others(self, text: str) -> bool:
        """Tell whether a row holds what no row with a reading does, and no reading, as of other topics."""
        if not self.spare:
            return False
        cells = split(text, self.grid.delimiter)
        is_empty = not any(cells[cell].strip() for cell in self.columns.field.cells if cell < len(cells))
        return is_empty and any(cells[cell].strip() for cell in self.spare if cell < len(cells))

    def _is_row(self, text: str) -> bool:
        """Tell whether a line is no blank, comment or header come again."""
        return bool(text.strip()) and not _is_comment(text) and not (self.header_text and text == self.header_text)

    def __str__(self) -> str:
        if self.words:
            return self.words
        heading = self.heading or "no header" * (not self.header)
        parts = [heading] * bool(heading) + [f"{SPOKEN[self.grid.delimiter]}-separated"]
        written = ", ".join(parts + ["decimal comma"] * (self.grid.decimal == ","))
        written += f"; {ON_BOARD}" * self.is_blackbox
        return written + f"; recorded with {self.in_force} in force" * bool(self.in_force)


@dataclass(slots=True)
class Cells(Dialect):
    """Rows of a table."""

    grid: Grid
    header_text: str = ""  # a line that says their names

    @classmethod
    def of(cls, layout: TextLayout, words: str, nameless: Sequence[str] = ()) -> Cells:
        """Take the rows of a table; units that stand elsewhere go into its names, and without a header into none."""
        own = [each for each in (layout.columns, *layout.columns.magnetometers) if each.stated]
        told = {cell: each.unit for each in own for cell in each.field.cells}
        units = layout.units or [told.get(cell, "") for cell in range(len(layout.header))]
        named = zip_longest(layout.header, units, fillvalue="")
        names = [f"{name}_{unit}" if unit and not meaning(name).unit else name for name, unit in named]
        return cls(words, tuple(names or nameless), layout.grid, layout.header_text)

    def row(self, line: str) -> list[str] | None:
        """Cut a line; one of another width, or with words for the magnetometer's numbers, is another line."""
        if self.header_text and line == self.header_text:
            return []
        if _is_comment(line) or self.grid.row(line) is None:
            return None
        cells = split(line, self.grid.delimiter)[: self.grid.width or None]
        return [quoted(cell.strip().replace(self.grid.decimal, ".")) for cell in cells]


def recognise_layout(
    name: str,
    lines: list[str],
    lay_out: Callable[..., TextLayout],
    pattern: str | None = None,
    flat: str | None = None,
    every: EveryLine | None = None,
) -> tuple[Dialect | None, TextLayout]:
    """Recognise how lines are written: as a table, which `lay_out` does, or in a dialect that makes one.

    Raises what `lay_out` raises where they are neither; of a text that is known, `NoMagnetometer` says what it is.
    `lines` are the first of the file, and `every` gives all of it.
    """
    every = every or (lambda: lines)
    if pattern is None and (known := refusal(name, lines)):
        raise known
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines, flat)
    if isinstance(dialect, labelled.Labelled):
        _refuse_one_value(name, lines)
    if isinstance(dialect, labelled.Labelled) and not _names_magnetometer(dialect) and is_table(lines):
        dialect = None
    try:
        return dialect, _laid_out(name, lines, lay_out, dialect, every)
    except (NoMagnetometer, UnreadableInput):
        dialect = None if dialect else guess(lines)
        is_unread = dialect is None or (not _names_magnetometer(dialect) and is_table(lines))
        _refuse_one_value(name, lines, may_be_in_turn=is_unread)
        if is_unread:
            if known := refusal(name, lines, is_unread=True):
                raise known from None
            raise
    return dialect, _laid_out(name, lines, lay_out, dialect, every)


def _laid_out(
    name: str, lines: list[str], lay_out: Callable[..., TextLayout], dialect: Dialect | None, every: EveryLine
) -> TextLayout:
    """Lay out a table, or the one that a dialect makes of these lines."""
    if dialect is None:
        return lay_out(lines, every=every)
    trial = deepcopy(dialect)  # it remembers parts of a reading
    rows, filled = list[str](), 0
    for line in lines:
        rows.append(",".join(trial.row(line) or ()))
        filled += bool(rows[-1])
        if filled == TRIED:
            break
    if not filled:
        raise NoMagnetometer(f"{name} is a {dialect.words} without a line of a magnetometer")
    return replace(lay_out(rows, header=dialect.names, every=partial(_rows_of, dialect, every)), words=dialect.words)


def _rows_of(dialect: Dialect, every: EveryLine) -> Iterator[str]:
    """Yield the rows of a table that a dialect makes of all lines."""
    trial = deepcopy(dialect)
    for line in every():
        if cells := trial.row(line):
            yield ",".join(cells)


def split_records(source: Source, encoding: str, beginning: str) -> Source | None:
    """Put records of a JSON document, or datagrams without line ends, in lines of their own; None for other lines."""
    if json_records.is_document(beginning) or json_records.has_several_to_a_record(beginning):
        return derived(source, json_records.records_as_lines(source, encoding))
    return derived(source, marked.datagrams_as_lines(source)) if marked.are_glued(beginning) else None


def recognise(lines: list[str], flat: str | None = None) -> Dialect | None:
    """Find the dialect whose signs the lines bear; None for a table. Behind time stamps two axes will do if `flat`."""
    if is_plain(lines):
        return None
    if flat and (level := wrapped.stamped(lines[:TRIED], recognise, partial(rows_of_table, flat=flat))):
        return level
    for sign, recogniser, most in DIALECTS:
        some = lines[:most]
        if any(map(sign.search, some)) and (dialect := recogniser(some)):
            return dialect
    return None


def guess(lines: list[str]) -> Dialect | None:
    """Find a dialect for lines that are no table either: tuples, words before numbers, time stamps before a table."""
    return (
        wrapped.stamped(lines, recognise, rows_of_table, marked=False, share=wrapped.SOME)
        or wrapped.stamped(lines, _labelled, rows_of_table, marked=False, share=wrapped.SOME)
        or labelled.recognise(lines, marked=False)
    )


def _labelled(lines: list[str]) -> Dialect | None:
    """Find labels that name a magnetometer, else three numbers between any words."""
    return labelled.recognise(lines) or labelled.recognise(lines, marked=False)


def _named_table(lines: list[str]) -> Cells | None:
    """Find the rows of a table with a header."""
    table = rows_of_table(lines)
    return table if table and table.header_text else None


def _names_magnetometer(dialect: Dialect) -> bool:
    """Tell whether names say in words that a magnetometer is among them, and not by a letter or an axis."""
    known = map(meaning, dialect.names)
    return any(each.kind == FIELD and each.axis and clearness(each.rank) == 0 for each in known)


def is_table(lines: list[str]) -> bool:
    """Tell whether lines are a table though cells look like labels: below names, or with an address such as `b4:01`."""
    addressed = sum(ADDRESS_CELL.search(line) is not None for line in lines[:TRIED])
    return 2 * addressed > len(lines[:TRIED]) or names_columns(lines)


def names_columns(lines: list[str]) -> bool:
    """Tell whether lines are a table with names above its columns, parted by more than spaces."""
    some = [(place, text) for place, text in enumerate(lines[:TRIED]) if text.strip() and not _is_comment(text)]
    cuts = (_cut(some, signs) for signs in _signs_of(some) if signs[0] != SPACES)
    best = max(cuts, key=_Cut.score, default=None)
    if best is None or not best.rows or 2 * len(best.rows) < len(some):
        return False
    width = Counter(map(len, best.rows.values())).most_common(1)[0][0]
    start = min(place for place, cells in best.rows.items() if len(cells) == width)
    return _header(lines[:start], best.signs[0], width, width)[0] >= 0


def rows_of_table(lines: list[str], flat: str | None = None) -> Cells | None:
    """Find the rows of a table, as behind time stamps; three columns without names are x, y, z, two those of `flat`."""
    try:
        layout = sniff("", lines, flat=flat)
    except FlindersError:
        return None
    width, axes = layout.grid.width, flat or ""
    nameless = next((each for each in ("xyz", axes) if len(each) == width), [str(place + 1) for place in range(width)])
    return Cells.of(layout, f"{SPOKEN[layout.grid.delimiter]}-separated numbers", nameless)


class _Row(NamedTuple):
    """A dialect, which is looked for where a line bears its sign."""

    sign: re.Pattern[str]
    recognise: Callable[[list[str]], Dialect | None]
    most: int | None = TRIED  # lines that are looked at


DIALECTS: Final = (
    _Row(marked.SIGN, marked.recognise, None),  # a log may begin with other messages
    _Row(_OPENS_JSON, json_records.recognise),
    _Row(boxed.RULER, boxed.recognise),
    _Row(influx.SIGN, influx.recognise),
    _Row(_CLOCK, lambda lines: wrapped.stamped(lines, recognise, rows_of_table)),
    _Row(pairs.SIGN, pairs.recognise),
    _Row(wrapped.LETTERED_WORD, lambda lines: wrapped.hexadecimal(lines, _labelled, _named_table)),
    _Row(_LETTER, labelled.recognise),
)


def is_plain(lines: list[str]) -> bool:
    """Tell whether lines, but for the first two, are nothing but numbers and delimiters: a table."""
    return len(lines) > HEADING and all(map(_PLAIN.fullmatch, lines[HEADING:TRIED]))


def sniff(
    name: str,
    texts: list[str],
    columns: str | None = None,
    header: Sequence[str] = (),
    flat: str | None = None,
    choice: Choice = FIRST,
    every: EveryLine | None = None,
) -> TextLayout:
    """Recognise by its first lines how a table is laid out; `header` are names that are known from elsewhere."""
    end = max((place for place, text in enumerate(texts[:TRIED]) if _END_OF_HEADER.fullmatch(text)), default=-1)
    texts = [""] * (end + 1) + texts[end + 1 :]
    lines = [(place, text) for place, text in enumerate(texts) if text.strip() and not _is_comment(text)]
    if not lines:
        blank = not any(text.strip() for text in texts)
        content = "blank lines" if blank else "comments"
        marked = "" if blank else f"; where readings begin with {' or '.join(COMMENTS)}, say how they are printed"
        raise UnreadableInput(
            f"{name} holds only {content}: need lines of numbers, one reading each{marked}",
            hint={} if blank else {"pattern": None},
        )
    for some, least in ((lines[:TRIED], 3), (lines, 3), *([(lines, 2)] if flat else [])):
        best = max((_cut(some, signs, least) for signs in _signs_of(some)), key=_Cut.score, default=None)
        if best is not None and best.rows:
            choosing = partial(choose, flat=flat, choice=choice, source=name)
            return _table(name, texts, best, header, choosing, columns, choice, every or (lambda: texts))
    raise _extremes(name, [text for _, text in lines]) or _nothing(name, lines)


def _table(
    name: str,
    texts: list[str],
    best: _Cut,
    known: Sequence[str],
    choosing: partial[Columns | None],
    asked: str | None,
    choice: Choice,
    every: EveryLine,
) -> TextLayout:
    """Lay out a table from the lines that are rows of numbers."""
    signs, rows = best.signs, best.rows
    words = [at for at, value in enumerate(next(iter(best.values.values()))) if value is None]
    sensors = sensor_column(list(rows.values()), words)
    rows = {place: cells for place, cells in rows.items() if not sensors or sensors.is_of_first(cells)}
    width, often = Counter(map(len, rows.values())).most_common(1)[0]
    if width > MOST_COLUMNS:
        raise NoMagnetometer(f"{name} has {width:,} columns: cut the magnetometer's out, with its time")
    places = [place for place, cells in rows.items() if len(cells) == width]
    start, alike = min(places), [rows[place] for place in places]
    filled = width - next((at for at in range(width) if any(cells[-1 - at].strip() for cells in alike)), 0)
    above = _above(texts[:start], signs[0], sensors)
    place, header = (-1, list(known)) if known else _header(above, signs[0], filled, width)
    width = len(header) if filled <= len(header) <= width else filled  # each line ends with delimiters
    values, clocks = _first_numbers(best, places, width, texts[start:])
    misfit = None if header else _misfit(name, above, signs[0], values, clocks, asked)
    place, header = (misfit.place, misfit.names) if misfit else (place, header)
    times = {cell for clock in clocks for cell in clock.cells}.union(() if header else seconds_and_nanoseconds(values))
    devices = _devices(header, [cells[:width] for cells in alike], times, signs[0], every, sensors)
    if devices and (own := [place for place in places if not devices[0].is_of_other(rows[place])]):
        values, clocks = _first_numbers(best, own, width, texts[start:])
    asked = asked or choice.remembered(header, width, rising_in(values) if choice.forms else ())
    units = _units(texts[place + 1 : start], signs[0], len(header)) if place >= 0 else ()
    if not header:
        _refuse_matrices(name, texts)
    if not header and asked is None and not sensors:
        _refuse_nameless(name, devices, clocks, width)
        values = _longer(texts[start:], values, signs)
    heading = misfit.words(width) if misfit else ""
    line = f" (line {start + 1}: {shown(texts[start])!r})"
    choosing = partial(choosing, asked=asked, heading=heading, quoted=line, cells=alike[0][:width], clocks=clocks)
    chosen = choosing(header, values, units=units, devices=devices, is_told=sensors is not None)
    if chosen is None:
        raise _no_magnetometer(name, header, values, texts[start], f"{heading or 'no header'}{line}", line)
    if chosen.device is None:
        _refuse_coded(name, header, values, chosen.field.cells)
    if unit := _told_unit(header, alike, texts[:start]):
        chosen = chosen.in_told(unit)
    if asked is None:
        _refuse_unsafe(name, header, alike, chosen, signs[1])
    numbers = ", ".join(str(cell + 1) for cell in chosen.field.cells)
    is_even = header or often >= SAME_WIDTH * len(rows)
    return TextLayout(
        grid=Grid(*signs, width if is_even else 0, chosen.cells, chosen.needed, chosen.clock),
        columns=chosen,
        start=_first_row(texts, place + 1, start) + 1,
        header=tuple(header),
        units=tuple(units),
        header_line=place + 1,
        header_text=texts[place] if place >= 0 else "",
        spare=_spare(alike, chosen.field.cells),
        heading=f"{heading} ({', '.join(chosen.field.names)} of columns {numbers})" if heading and header else heading,
    )


def _refuse_unsafe(
    name: str, header: Sequence[str], alike: Sequence[Sequence[str]], chosen: Columns, decimal: str
) -> None:
    """Refuse columns that nobody asked for, where rows are of several sensors or thousands are grouped."""
    if not header or meaning(chosen.field.names[0]).is_bare:
        _refuse_mixed(name, header, alike)
    _refuse_thousands(name, alike, chosen, decimal)


def _spare(rows: Sequence[Sequence[str]], field: Sequence[int]) -> frozenset[int]:
    """Places that are empty in each row with something of the field."""
    filled = [{place for place, cell in enumerate(row) if cell.strip()} for row in rows]
    return frozenset(range(len(rows[0]))).difference(*(places for places in filled if places & set(field)))


def _first_numbers(best: _Cut, places: Sequence[int], width: int, texts: Sequence[str]) -> tuple[Floats, list[Clock]]:
    """Numbers of the first of some rows, with the seconds of times that are no numbers, and the columns of these."""
    some = places[:SAMPLED]
    values = np.array([best.values[place][:width] for place in some], dtype=float)
    return values, _clocks(texts, [best.rows[place] for place in some], values, best.signs[0])


def _longer(texts: Sequence[str], values: Floats, signs: tuple[str, str]) -> Floats:
    """Numbers of all of these lines, where an axis of a table without a header only rises through the first."""
    width = values.shape[1]
    if width not in (3, 4) or not has_clock(values[:, width - 3 :]):
        return values
    cut = (split(text, signs[0]) for text in texts)
    rows = [[number(cell, signs[1]) for cell in cells] for cells in cut if len(cells) == width]
    return np.array(rows, dtype=float)


def _clocks(texts: Sequence[str], rows: Sequence[Sequence[str]], values: Floats, delimiter: str) -> list[Clock]:
    """Find the columns that are times and no numbers, and put seconds into their `values`.

    Where some rows do not tell the day from the month, all of these lines may.
    """
    words = [place for place, column in enumerate(values.T) if np.isfinite(column).mean() < 0.5]
    clocks = []
    for clock in clocks_of(rows, words):
        known = clock if clock.is_settled else Clock.of((split(text, delimiter) for text in texts), clock.cells)
        seconds = np.array([known.seconds(row) for row in rows[: len(values)]])
        values[:, known.cell] = Midnights(known).past(seconds)
        clocks.append(known)
    return clocks


def _devices(
    header: Sequence[str],
    alike: Sequence[Sequence[str]],
    times: Container[int],
    delimiter: str,
    every: EveryLine,
    sensors: SensorColumn | None,
) -> tuple[Device, ...]:
    """Devices that a column of a table tells apart, by its name or the first rows, and then by all of its rows.

    The columns of `times` name none; that of `sensors` says which rows are of a magnetometer.
    """
    width = len(alike[0])
    free = [place for place in range(width) if place not in times and not (sensors and place == sensors.place)]
    if header:
        places = [at for at in free if at < len(header) and names_device(header[at], header)]
        places = [at for at in places if not all(is_unit(row[at].strip()) for row in alike)]
    else:
        ahead = width - len("xyz") if width <= NAMELESS else 0
        places = [at for at in free if are_ids((row[at] for row in alike), is_ahead=at < ahead)]

    def rows() -> Iterator[tuple[str, ...]]:
        for text in every():
            cells = split(text, delimiter)
            if fits(cells, width):
                yield tuple(cells[place] for place in places)

    found = devices_in(header, places, rows) if places else ()
    return sensors.devices(header, found) if sensors else found


def _is_comment(text: str) -> bool:
    return text.lstrip().startswith(COMMENTS)


class _Cut(NamedTuple):
    """Lines cut at a delimiter: those that are rows of numbers, by their place."""

    signs: tuple[str, str]
    rows: dict[int, list[str]]  # cells
    values: dict[int, list[float | None]]  # their numbers, None for text
    numbers: int  # in all of them

    def score(self) -> tuple[int, int]:
        """How well delimiter and decimal sign fit."""
        return len(self.rows), self.numbers


def _signs_of(lines: list[tuple[int, str]]) -> list[tuple[str, str]]:
    """Leave out delimiters of no line, and decimal commas that no cell can have: cut at commas, it is one in quotes."""
    whole = "\n".join(text for _, text in lines)
    has_comma, has_quote = "," in whole, '"' in whole
    there = {delimiter for delimiter, _ in SIGNS if delimiter in whole} - {SPACES}
    if any(len(text.split()) > 1 for _, text in lines) or GLUED.search(whole.replace('"', "")):
        there.add(SPACES)
    decimals = (signs for signs in SIGNS if signs[0] in there)
    return [signs for signs in decimals if signs[1] == "." or (has_quote if signs[0] == "," else has_comma)]


def _cut(lines: list[tuple[int, str]], signs: tuple[str, str], least: int = 3) -> _Cut:
    """Cut lines, and pick those that hold at least so many numbers, and more numbers than words."""
    delimiter, decimal = signs
    rows, values, total = {}, {}, 0
    for place, text in lines:
        cells = split(text, delimiter)
        if len(cells) < least:
            continue
        known = [number(cell, decimal) for cell in cells]
        blank, words = len(cells) - len(list(filter(str.strip, cells))), known.count(None)
        numbers = len(cells) - blank - words
        if numbers >= least and numbers >= words:
            rows[place], values[place] = cells, known
            total += numbers
    return _Cut(signs, rows, values, total)


def _first_row(texts: list[str], after: int, start: int) -> int:
    """Place of the first line that looks like a reading, however it is cut: it counts, also if it cannot be read."""
    between = [(place, text) for place, text in enumerate(texts[after:start], after) if not _is_comment(text)]
    return min((place for signs in SIGNS for place in _cut(between, signs).rows), default=start)


# What stands above the readings ---------------------------------------------------------------------------------------


def _above(texts: Sequence[str], delimiter: str, sensors: SensorColumn | None) -> list[str]:
    """Lines above the readings; of several headers those of the sensor that is read, where each begins with its own."""
    if sensors is None:
        return list(texts)
    own = [text if sensors.is_of_first(_names_in(text, delimiter)) else "" for text in texts]
    return own if any(own) else list(texts)


def _header(above: list[str], delimiter: str, filled: int, width: int) -> tuple[int, list[str]]:
    """Find the header above the readings: the nearest line that names a magnetometer, or else columns at all.

    Lines have `width` cells, of which the first `filled` hold something.
    """
    fallback: tuple[int, list[str]] = (-1, [])
    for place in range(len(above) - 1, -1, -1):
        names = _names_in(above[place], delimiter)
        if not (fits(names, width) or filled <= len(names) < width):
            continue
        names = names[:width]
        if all(is_unit(name) for name in names if name):
            continue
        if grouped := _with_sensors(names, _names_in(above[place - 1], delimiter) if place else []):
            lower = fallback[1][: len(grouped)]  # of a column whose name stands in a line of its own
            return place, [name or below for name, below in zip_longest(grouped, lower, fillvalue="")]
        if names_magnetometer(names):
            return place, names
        if not fallback[1] and not _is_comment(above[place]) and _could_name(names, delimiter):
            fallback = place, names
    return fallback


class _Misfit(NamedTuple):
    """A header with another number of names than lines have fields."""

    place: int
    written: int  # names
    names: list[str]  # one for each field, some of them empty; none where values do not tell whose they are
    text: str

    def words(self, width: int) -> str:
        """How many there are of each."""
        return f"a header of {self.written} names over {width} fields" if self.written != width else ""


def _misfit(
    name: str, above: list[str], delimiter: str, values: Floats, clocks: Sequence[Clock], asked: str | None
) -> _Misfit | None:
    """Find a header that fits by no number, or no delimiter: the nearest that has the names that are meant.

    Raises `NoMagnetometer` where it names a magnetometer and values do not tell which columns it is.
    """
    width, other = values.shape[1], None
    parts = [part.strip().casefold() for part in asked.split(",")] if asked else []
    wanted = [part for part in parts if not part.isdecimal()]
    for place, sign in ((place, sign) for place in range(len(above) - 1, -1, -1) for sign in dict(SIGNS)):
        names = _named_in(above[place], sign)
        least = 3 if sign == delimiter != SPACES else width / 2 if sign == delimiter else width
        is_close = least <= len(names) <= width + MOST_NAMES_OVER * (sign == delimiter)
        is_meant = set(wanted) <= set(map(str.casefold, names)) if wanted else names_magnetometer(names)
        if is_close and is_meant:
            header = names if len(names) == width else shifted(names, values, clocks, wanted)
            if header or asked is None or wanted:
                return _settled(name, _Misfit(place, len(names), header, above[place]), values, wanted)
        could_be = is_close and sign == delimiter and not _is_comment(above[place])
        if other is None and could_be and _could_name(names, sign):
            other = _Misfit(place, len(names), [], above[place])
    return other


def _settled(name: str, found: _Misfit, values: Floats, wanted: Sequence[str]) -> _Misfit:
    """Ask where a header names what is wanted and values do not tell which columns that is."""
    if found.names:
        return found
    what = f"{found.words(values.shape[1])} (line {found.place + 1}: {shown(found.text)!r})"
    if wanted:
        asked = ",".join(wanted)
        raise UsageError(f"columns {asked!r}: {name} has {what}, which may be of other columns: give numbers")
    judged = groups(values, range(values.shape[1]))
    told, hint = advice(judged) if judged else (f"say which, by number; they go from {ranges(values)}", XYZ)
    raise NoMagnetometer(f"{name} has {what}, and values do not tell which fields the names are of; {told}", hint=hint)


def _named_in(text: str, delimiter: str) -> list[str]:
    """Names of a line without those that are empty at its end; none where some are numbers, or come again."""
    names = [name.rstrip(",;") for name in _names_in(text, delimiter)]
    while names and not names[-1]:
        names.pop()
    filled = list(filter(None, names))
    is_text = all(number(name, ".") is None for name in filled) and len(set(filled)) == len(filled)
    return names if is_text else []


def _names_in(text: str, delimiter: str) -> list[str]:
    """Cut a line of names, also in a comment."""
    bare = text.lstrip()
    sign = next((sign for sign in COMMENTS if bare.startswith(sign)), "")
    return [cell.strip() for cell in split(bare.removeprefix(sign).lstrip() if sign else text, delimiter)]


def _with_sensors(names: Sequence[str], titles: Sequence[str]) -> list[str]:
    """Put the sensors of a line before the axes below it, each above its columns or the first; else nothing."""
    below = [meaning(name) for name in names]
    axes = [place for place, each in enumerate(below) if each.axis and (each.is_bare or not each.kind)]
    if len(axes) < 3 or len(titles) > len(names) + 1 or sum(map(bool, titles)) < 2:
        return []
    joined, title = [], ""
    for name, above in zip_longest(names, titles[: len(names)], fillvalue=""):
        title = above or title
        bracket = min((place for sign in "[(" if (place := title.find(sign)) > 0), default=len(title))
        parts = (title[:bracket].strip(), name, title[bracket:])
        joined.append(" ".join(filter(None, parts)) if name else above)
    known = [meaning(name) if place in axes else Meaning("") for place, name in enumerate(joined)]
    plain = [Meaning("") if each.is_bare else each for each in known]
    is_clear = any(vectors(joined, plain, kind) for kind in (FIELD, ACCELERATION, RATE))
    return joined if is_clear and len({joined[place] for place in axes}) == len(axes) else []


def _units(below: list[str], delimiter: str, width: int) -> list[str]:
    """Find a row of units between the header and the readings, one a column; nothing where there is none."""
    for text in below:
        cells = [cell.strip("[]()") for cell in _names_in(text, delimiter)]
        units = [cell if is_unit(cell) else "" for cell in cells]
        if fits(cells, width) and sum(map(bool, units)) >= max(3, sum(map(bool, cells)) / 2):
            return units
    return []


def _told_unit(header: Sequence[str], rows: Sequence[Sequence[str]], above: Sequence[str]) -> str:
    """Unit that a column of units, or a line above the readings, says the field is in; nothing where none does."""
    places = [place for place, name in enumerate(header) if _UNITS.fullmatch(name.strip())]
    words = [{row[place].strip() for row in rows if place < len(row)} for place in places]
    said = [word for each in words if len(each) == 1 for word in each]
    lines = filter(None, map(_SAYS_UNIT.fullmatch, above[:MOST_ABOVE]))
    said += [match[1] for match in lines]
    known = (SPELLINGS.get(PARTED.sub(r"\1", word).casefold(), "") for word in said if word not in _OTHER_UNITS)
    return next(filter(None, known), "")


def _could_name(names: list[str], delimiter: str) -> bool:
    """Tell a header from a sentence: no numbers and, where spaces part the cells, a name that means something."""
    if not any(names) or any(name and number(name, ".") is not None for name in names):
        return False
    return delimiter != SPACES or any(meaning(name).kind for name in names)


# What is refused ------------------------------------------------------------------------------------------------------


def _refuse_nameless(name: str, devices: Sequence[Device], clocks: Sequence[Clock], width: int) -> None:
    """Refuse a table without a header in which a column says which of several sensors each line is of."""
    if devices and width <= NAMELESS:
        words = ", ".join(" ".join(device.words) for device in devices[:MOST_NAMED])
        column = devices[0].cells[0]
        taken = {*devices[0].cells, *(cell for clock in clocks for cell in clock.cells)}
        others = ",".join([str(cell + 1) for cell in range(width) if cell not in taken][-3:])
        raise NoMagnetometer(
            f"column {column + 1} of {name} says which sensor each line is of ({words}): name the columns of x, y and "
            "z, and say which sensor is meant",
            hint={"columns": others, "sensor": None},
        )


def _refuse_matrices(name: str, texts: Sequence[str]) -> None:
    """Refuse text of Octave with two matrices or more of three columns, one below the other."""
    named = (match for text in texts if text.startswith("# ") and (match := MATRIX.match(text)))
    known: list[str] = []
    wide: list[str] = []
    for match in named:
        known += [match["name"]] if match["name"] else []
        wide += known[-1:] if int(match["columns"] or 0) >= len("xyz") else []
    if len(wide) > 1:
        raise NoMagnetometer(
            f"{name} has several matrices, one below the other ({', '.join(wide)}): save the magnetometer's alone, "
            f"such as with save -text field.txt {wide[-1]}"
        )


@np.errstate(over="ignore", invalid="ignore")
def _refuse_coded(name: str, header: Sequence[str], values: Floats, cells: Sequence[int]) -> None:
    """Refuse a table in which a number says which sensor a line is of: lengths of x, y and z differ with it by far."""
    lengths = np.linalg.norm(values[:, cells], axis=1)
    for place in (place for place in range(values.shape[1]) if place not in cells):
        known = values[:, place][np.isfinite(values[:, place])]
        codes, steps = np.unique(known), np.diff(known)
        is_in_turn = np.mean(steps != 0) > IN_TURN and (steps < 0).any() if len(steps) else False
        if not (is_in_turn and len(codes) <= MAX_CODES and (codes == np.floor(codes)).all()):
            continue
        own = {int(code): lengths[(values[:, place] == code) & np.isfinite(lengths)] for code in codes}
        usual = {code: float(np.median(each)) for code, each in own.items() if len(each) >= LEAST_OF_CODE}
        factor = APART if any(_is_gravity(own[code], length) for code, length in usual.items()) else FAR_APART
        if usual and min(usual.values()) * factor < max(usual.values()):
            column = repr(header[place].strip()) if header else str(place + 1)
            told = ", ".join(f"{code}: {figures(length, 3)}" for code, length in usual.items())
            raise NoMagnetometer(
                f"column {column} of {name} says by a number which sensor each line is of, it seems, for their lengths "
                f"are far apart ({told}): keep the lines of the magnetometer"
            )


def _is_gravity(lengths: Floats, usual: float) -> bool:
    """Tell whether lengths are those of gravity in m/s² or g."""
    is_near = any(abs(usual / GRAVITY[unit] - 1) < NEARLY for unit in ("m/s²", "g"))
    return is_near and float(np.median(np.abs(lengths - usual))) < STEADY * usual


def _refuse_one_value(name: str, lines: Sequence[str], *, may_be_in_turn: bool = False) -> None:
    """Refuse a table with one value a row, whose axis a word in the row names: ``sensor.field_x,28.90,2026-11-22``.

    Labelled lines are read where the axes come in turn.
    """
    texts = [text for text in lines if text.strip() and not _is_comment(text)]
    for delimiter in ONE_VALUE_SIGNS:
        rows = [split(text, delimiter) for text in texts if delimiter in text]
        if 2 * len(rows) <= len(texts):
            continue
        width = Counter(map(len, rows)).most_common(1)[0][0]
        for place in range(width):
            words = [bare(row[place]) for row in rows if len(row) == width > 1]
            told = _axes_of_words(words)
            if told and (may_be_in_turn or not _are_in_turn([word for word in words if word in told])):
                raise NoMagnetometer(
                    f"{name} has one value a row, of which column {place + 1} says what it is ({', '.join(told)}): "
                    "pivot it, so that x, y and z of a moment stand in one row, or export a column for each"
                )


def _axes_of_words(words: Sequence[str]) -> list[str]:
    """Repeated words that name the three axes of a magnetometer; none where there are too many."""
    counts = Counter(words)
    often = sorted(word for word, count in counts.items() if count >= MIN_READINGS and number(word, ".") is None)
    found = magnetometers(often) if len(counts) <= MAX_DEVICES else ()
    return [often[cell] for cell in found[0].cells] if found else []


def _are_in_turn(words: Sequence[str]) -> bool:
    """Tell whether most words are followed by another one."""
    return 2 * sum(one != other for one, other in pairwise(words)) > len(words)


def _refuse_mixed(name: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Refuse a table in which a column of words says which sensor each line is of, and none is a magnetometer."""
    for place in range(min(map(len, rows))):
        known = sensors_of_words(row[place] for row in rows)
        if others := [word for word, each in known.items() if each.kind != FIELD]:
            column = f"column {header[place].strip()!r}" if header else f"column {place + 1}"
            raise NoMagnetometer(
                f"{column} of {name} says which sensor each line is of, such as {others[0]!r}: keep the lines of "
                "the magnetometer, or name the columns to read them all",
                hint={"columns": None},
            )


def _refuse_thousands(name: str, rows: Sequence[Sequence[str]], columns: Columns, decimal: str) -> None:
    """Refuse readings in which commas or points part thousands: whole numbers up to 999, above it three more digits."""
    grouped: list[str] = []
    whole: list[float] = []
    for cell in (row[place].strip() for row in rows for place in columns.field.cells):
        if decimal not in cell:
            value = number(cell, ".")
            whole += [] if value is None else [abs(value)]
        elif _GROUPED.fullmatch(cell):
            grouped.append(cell)
        else:
            return
    if len(grouped) >= 3 and 100 <= max(whole, default=0) < 1000:
        raise UnreadableInput(
            f"numbers of {name} such as {grouped[0]!r} beside {max(whole):.0f} have {decimal!r} between thousands, it "
            "seems: save it without a separator of thousands, or name the columns where it is the decimal sign",
            hint={"columns": None},
        )


def ranges(values: Floats) -> str:
    """Range of each column of a table without names: ``1: 0 to 0.25, 2: -302 to 299``."""
    columns = [column[np.isfinite(column)] for column in values.T]
    ends = [f"{figures(each.min(), 3)} to {figures(each.max(), 3)}" if len(each) else "no numbers" for each in columns]
    written = [f"{number}: {each}" for number, each in enumerate(ends[:MOST_RANGES], 1)]
    return ", ".join(written + ["…"] * (len(ends) > MOST_RANGES))


def _extremes(name: str, texts: Sequence[str]) -> NoMagnetometer | None:
    """Say what to do with six numbers alone, the smallest and the largest of each axis; None for anything else."""
    if len(texts) > 2 * len("xyz"):
        return None
    numbers = [each for text in texts for each in cut(text[:PRINTED])[0]]
    if len(numbers) != 2 * len("xyz"):
        return None
    pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    in_turn = all((number(low, ".") or 0.0) < (number(high, ".") or 0.0) for low, high in pairs)
    typed = ",".join(numbers) if in_turn else "X0,X1,Y0,Y1,Z0,Z1"
    return NoMagnetometer(
        f"{name} has six numbers and no readings: where they are the smallest and the largest reading of each axis, "
        f"type them: flinders calibrate --minmax={typed}"
    )


def _no_magnetometer(
    name: str, header: list[str], values: Floats, text: str, heading: str, line: str
) -> NoMagnetometer:
    if not header and len(values) == 1 and (extremes := _extremes(name, [text])):
        return extremes
    if header:
        return NoMagnetometer(
            f"no magnetometer among the columns of {name}: {listed(header)}; "
            "say which three it is, by name or by number",
            hint=XYZ,
        )
    return _other_labels(name, text, line) or NoMagnetometer(
        f"{name} has {values.shape[1]} columns and {heading}: need three, x y z, "
        f"or four with the time first; they go from {ranges(values)}; say which are the magnetometer, by number",
        hint=XYZ,
    )


def _other_labels(name: str, text: str, line: str) -> NoMagnetometer | None:
    """Say what the labels of a line are, where they are of other sensors."""
    gaps = cut(text[:PRINTED])[1]
    names = names_of(gaps) if len(gaps) > 1 else ()
    others = {meaning(each).kind for each in names} & {ACCELERATION, RATE}
    if not others and not (is_labelled(gaps) and any(map(QUANTITY.search, names))):
        return None
    what = " and ".join(sorted(others)) or ", ".join(dict.fromkeys(filter(None, names)))
    return NoMagnetometer(
        f"the labels of {name} tell of {what} and of no magnetometer{line}: let the board print its magnetometer "
        "too, or say which numbers of a line it is",
        hint={"pattern": None},
    )


def _nothing(name: str, lines: list[tuple[int, str]]) -> InputError:
    """Say what a file without rows of three numbers holds instead."""
    if lines[-1][1] == ENDS_EARLY:
        return UnreadableInput(
            f"{name} is cut short before its first reading: its gzip data have no end; copy it again"
        )
    few = max((_cut(lines, signs, 1).rows for signs in SIGNS), key=len)
    numbers = [(at, text) for at, text in lines if len(cut(text[:PRINTED])[0]) >= 3]
    headed = next(
        (
            at
            for at, text in lines[:MOST_ABOVE]
            for sign, _ in SIGNS
            if names_magnetometer(split(text[: 16 * PRINTED], sign))
        ),
        None,
    )
    if headed is not None and not few and not numbers:
        return UnreadableInput(
            f"{name} has a header (line {headed + 1}) and no readings below it: record again, or check what was saved"
        )
    if 2 * len(few) >= len(lines) and len(numbers) < len(few):
        place, text = next((place, text) for place, text in lines if place in few)
        return NoMagnetometer(
            f"{name} has fewer than three numbers a line (line {place + 1}: {shown(text)!r}): "
            "need three, x y z, one reading a line; two, of a level turn, are for flinders two-axis"
        )
    place, text = lines[0]
    if text.endswith(CUT_OFF):
        return UnreadableInput(
            f"line {place + 1} of {name} is longer than a million characters ({shown(text)!r}): need one reading a line"
        )
    place, text = numbers[0] if numbers else lines[0]
    line = f" (line {place + 1}: {shown(text)!r})"
    if not numbers and any(MOMENT.search(text[:PRINTED]) for _, text in lines[:MOST_ABOVE]):
        return NoMagnetometer(
            f"no magnetometer in {name}: no line has three numbers besides dates and times{line}; need x, y and z of a "
            "reading on a line"
        )
    return (_other_labels(name, text, line) if numbers else None) or _unrecognised(name, text if numbers else "", line)


def _unrecognised(name: str, text: str, line: str) -> UnreadableInput:
    """Say that no readings are recognised, and offer the ``--pattern`` of a line that has numbers."""
    pattern = pattern_of(text) if len(text) <= LONGEST_EXAMPLE else ""
    example = ", as here if those are x, y and z" if pattern else ""
    return UnreadableInput(
        f"no readings are recognised in {name}{line}: need three columns of numbers, "
        f"labels such as 'X: -20.8 Y: -20.2 Z: 26.1 uT', or how a line is printed{example}",
        hint={"pattern": pattern or None},
    )
