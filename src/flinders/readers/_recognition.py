"""Recognition of the dialect of text lines; lines without a dialect are a table.

The dialects are tried in the order of `DIALECTS`, each if a line contains its sign. A dialect converts lines to rows of
a table.

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
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from flinders.errors import FlindersError, NoMagnetometer, UnreadableInput
from flinders.readers._cells import SPACES
from flinders.readers._delimiters import Cut, is_comment, signs_of, split_lines
from flinders.readers._header import find_header
from flinders.readers._known_texts import refusal
from flinders.readers._layout import DELIMITER_WORDS, TRIED_LINES, Cells, TextLayout, recognise_table
from flinders.readers._names import FIELD, clearness, meaning
from flinders.readers._refusals import refuse_one_value
from flinders.readers._source import derive_source
from flinders.readers.dialects import Dialect, boxed, influx, json_records, labelled, marked, pairs, wrapped
from flinders.readers.dialects.pattern import Pattern

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from flinders.readers._source import Source

    EveryLine: TypeAlias = Callable[[], Iterable[str]]

MAX_HEADING_LINES: Final = 2  # number of lines above a table of plain numbers that may be any text
_PLAIN: Final = re.compile(r"[-+.,;\s\d]*(?:(?:[eE][-+]\d|nan)[-+.,;\s\d]*)*", re.ASCII)
_OPENS_JSON: Final = re.compile(r"^\s*[\[{]")
_CLOCK: Final = re.compile(r"\d:\d\d:\d\d")
ADDRESS_CELL: Final = re.compile(r"(?:^|[,;\t]) *[\da-f]{2}(?::[\da-f]{2})+ *(?=$|[,;\t])", re.IGNORECASE)
_LETTER: Final = re.compile(r"[^\W\d_]")


def recognise_layout(
    name: str,
    lines: list[str],
    lay_out: Callable[..., TextLayout],
    pattern: str | None = None,
    flat: str | None = None,
    every: EveryLine | None = None,
) -> tuple[Dialect | None, TextLayout]:
    """Recognise the format of lines: a table, laid out by `lay_out`, or a dialect that converts lines to a table.

    Lines in no format raise the error of `lay_out`; for a known text that is `NoMagnetometer` with its kind. `lines`
    are the first lines of the file, and `every` yields all lines.
    """
    every = every or (lambda: lines)
    if pattern is None and (known := refusal(name, lines)):
        raise known
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines, flat)
    if isinstance(dialect, labelled.Labelled):
        refuse_one_value(name, lines)
    if isinstance(dialect, labelled.Labelled) and not _names_magnetometer(dialect) and is_table(lines):
        dialect = None
    try:
        return dialect, _lay_out(name, lines, lay_out, dialect, every)
    except (NoMagnetometer, UnreadableInput):
        dialect = None if dialect else guess(lines)
        is_unread = dialect is None or (not _names_magnetometer(dialect) and is_table(lines))
        refuse_one_value(name, lines, may_be_in_turn=is_unread)
        if is_unread:
            if known := refusal(name, lines, is_unread=True):
                raise known from None
            raise
    return dialect, _lay_out(name, lines, lay_out, dialect, every)


def _lay_out(
    name: str, lines: list[str], lay_out: Callable[..., TextLayout], dialect: Dialect | None, every: EveryLine
) -> TextLayout:
    """Layout of lines as a table, or of the table that a dialect makes from them."""
    if dialect is None:
        return lay_out(lines, every=every)
    trial = deepcopy(dialect)  # a dialect stores parts of a reading
    rows, filled = list[str](), 0
    for line in lines:
        rows.append(",".join(trial.row(line) or ()))
        filled += bool(rows[-1])
        if filled == TRIED_LINES:
            break
    if not filled:
        raise NoMagnetometer(f"{name} is {dialect.words} without a line of a magnetometer")
    return replace(lay_out(rows, header=dialect.names, every=partial(_rows_of, dialect, every)), words=dialect.words)


def _rows_of(dialect: Dialect, every: EveryLine) -> Iterator[str]:
    """Yield the rows of the table that a dialect makes from all lines."""
    trial = deepcopy(dialect)
    for line in every():
        if cells := trial.row(line):
            yield ",".join(cells)


def split_records(source: Source, encoding: str, beginning: str) -> Source | None:
    """Source with records of a JSON document, or datagrams, on separate lines; None for other text."""
    if json_records.is_document(beginning) or json_records.has_batches(beginning):
        return derive_source(source, json_records.records_as_lines(source, encoding))
    return derive_source(source, marked.datagrams_as_lines(source)) if marked.has_joined_datagrams(beginning) else None


def recognise(lines: list[str], flat: str | None = None) -> Dialect | None:
    """Find the dialect whose sign the lines contain; None for a table. With `flat`, a time and two axes are enough."""
    if is_plain(lines):
        return None
    if flat and (level := wrapped.find_stamps(lines[:TRIED_LINES], recognise, partial(rows_of_table, flat=flat))):
        return level
    for sign, recogniser, most in DIALECTS:
        some = lines[:most]
        if any(map(sign.search, some)) and (dialect := recogniser(some)):
            return dialect
    return None


def guess(lines: list[str]) -> Dialect | None:
    """Find a dialect for lines that are not a table: tuples, words before numbers, time stamps before a table."""
    return (
        wrapped.find_stamps(lines, recognise, rows_of_table, marked=False, share=wrapped.MIN_STAMP_SHARE_OF_OTHERS)
        or wrapped.find_stamps(
            lines, _recognise_labels, rows_of_table, marked=False, share=wrapped.MIN_STAMP_SHARE_OF_OTHERS
        )
        or labelled.recognise(lines, marked=False)
    )


def _recognise_labels(lines: list[str]) -> Dialect | None:
    """Find labels that name a magnetometer, or else three numbers between any words."""
    return labelled.recognise(lines) or labelled.recognise(lines, marked=False)


def _named_table(lines: list[str]) -> Cells | None:
    """Dialect for the rows of a table with a header; None without one."""
    table = rows_of_table(lines)
    return table if table and table.header_text else None


def _names_magnetometer(dialect: Dialect) -> bool:
    """Whether names contain a magnetometer as a word, and not just as a letter or an axis."""
    known = map(meaning, dialect.names)
    return any(each.kind == FIELD and each.axis and clearness(each.rank) == 0 for each in known)


def is_table(lines: list[str]) -> bool:
    """Whether lines that seem to have labels are a table: with names above, or with an address such as `b4:01`."""
    addressed = sum(ADDRESS_CELL.search(line) is not None for line in lines[:TRIED_LINES])
    return 2 * addressed > len(lines[:TRIED_LINES]) or names_columns(lines)


def names_columns(lines: list[str]) -> bool:
    """Whether lines are a table with names above its columns and a delimiter other than spaces."""
    some = [(place, text) for place, text in enumerate(lines[:TRIED_LINES]) if text.strip() and not is_comment(text)]
    cuts = (split_lines(some, signs) for signs in signs_of(some) if signs[0] != SPACES)
    best = max(cuts, key=Cut.score, default=None)
    if best is None or not best.rows or 2 * len(best.rows) < len(some):
        return False
    width = Counter(map(len, best.rows.values())).most_common(1)[0][0]
    start = min(place for place, cells in best.rows.items() if len(cells) == width)
    return find_header(lines[:start], best.signs[0], width, width)[0] >= 0


def rows_of_table(lines: list[str], flat: str | None = None) -> Cells | None:
    """Dialect of a table's rows after time stamps. Unnamed columns are x, y, z if three, and the axes `flat` if two."""
    try:
        layout = recognise_table("", lines, flat=flat)
    except FlindersError:
        return None
    width, axes = layout.grid.width, flat or ""
    nameless = next((each for each in ("xyz", axes) if len(each) == width), [str(place + 1) for place in range(width)])
    return Cells.of(layout, f"{DELIMITER_WORDS[layout.grid.delimiter]}-separated numbers", nameless)


class _Row(NamedTuple):
    """A dialect with the sign by which lines are checked for it."""

    sign: re.Pattern[str]
    recognise: Callable[[list[str]], Dialect | None]
    most: int | None = TRIED_LINES  # number of lines that are examined; None for all


DIALECTS: Final = (
    _Row(marked.SIGN, marked.recognise, None),  # a log may start with other messages
    _Row(_OPENS_JSON, json_records.recognise),
    _Row(boxed.RULER, boxed.recognise),
    _Row(influx.SIGN, influx.recognise),
    _Row(_CLOCK, lambda lines: wrapped.find_stamps(lines, recognise, rows_of_table)),
    _Row(pairs.SIGN, pairs.recognise),
    _Row(wrapped.LETTERED_WORD, lambda lines: wrapped.find_hexadecimal(lines, _recognise_labels, _named_table)),
    _Row(_LETTER, labelled.recognise),
)


def is_plain(lines: list[str]) -> bool:
    """Whether the lines after the first two contain only numbers and delimiters, as those of a table do."""
    return len(lines) > MAX_HEADING_LINES and all(map(_PLAIN.fullmatch, lines[MAX_HEADING_LINES:TRIED_LINES]))
