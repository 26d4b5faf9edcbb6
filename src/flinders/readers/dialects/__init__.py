"""Dialects: lines that are no table, and how each of them becomes a row of one.

A dialect is recognised by the first lines and then takes one line at a time, whether that comes from a file or from a
wire. A new one is a file with a `Dialect` and a function ``recognise``, and a row of ``DIALECTS`` here.

>>> dialect = recognise(["starting up", "X: -20.8 Y: -20.2 Z: 26.1 uT", "X: -20.7 Y: -20.1 Z: 26.2 uT"])
>>> dialect.words, dialect.names
('labelled lines', ('X (uT)', 'Y (uT)', 'Z (uT)'))
>>> dialect.row("X: -20.6 Y: -20.0 Z: 26.3 uT"), dialect.row("low battery") is None
(['-20.6', '-20.0', '26.3'], True)
"""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.samples import Skipped
from flinders.errors import NoMagnetometer, UnreadableInput
from flinders.readers._layout import TRIED
from flinders.readers._source import derived
from flinders.readers._tokenizer import ENDS_EARLY, shown
from flinders.readers.dialects import json_records, labelled, marked, wrapped
from flinders.readers.dialects.pattern import Pattern

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.readers._layout import Dialect, TextLayout
    from flinders.readers._source import Source
    from flinders.readers._tokenizer import Lines

OTHER: Final = "other"  # Why lines are left out that are none of the dialect
MOST_NUMBERS: Final = 10  # Numbers of lines that are kept to be shown


def recognise_layout(
    name: str, lines: list[str], lay_out: Callable[..., TextLayout], pattern: str | None = None
) -> tuple[Dialect | None, TextLayout]:
    """Recognise how lines are written: as a table, which `lay_out` does, or in a dialect that makes one.

    Raises
    ------
    InputError
        What `lay_out` raises, where they are neither.
    """
    dialect = Pattern.of(pattern) if pattern is not None else recognise(lines)
    try:
        return dialect, _laid_out(name, lines, lay_out, dialect)
    except (NoMagnetometer, UnreadableInput):
        dialect = None if dialect else guess(lines)
        if dialect is None:
            raise
    return dialect, _laid_out(name, lines, lay_out, dialect)


def _laid_out(name: str, lines: list[str], lay_out: Callable[..., TextLayout], dialect: Dialect | None) -> TextLayout:
    """Lay out a table, or the one that a dialect makes of these lines."""
    if dialect is None:
        return lay_out(lines)
    trial = deepcopy(dialect)  # it remembers parts of a reading
    rows, filled = list[str](), 0
    for line in lines:
        rows.append(",".join(trial.row(line) or ()))
        filled += bool(rows[-1])
        if filled == TRIED:
            break
    if not filled:
        raise NoMagnetometer(f"{name} is a {dialect.words} without a line of a magnetometer")
    return replace(lay_out(rows, header=dialect.names), words=dialect.words)


def split_records(source: Source, encoding: str, beginning: str) -> Source | None:
    """Put records of a JSON document, or datagrams without line ends, in lines of their own; None for other lines."""
    if json_records.is_document(beginning):
        return derived(source, json_records.records_as_lines(source, encoding))
    return derived(source, marked.datagrams_as_lines(source)) if marked.are_glued(beginning) else None


def recognise(lines: list[str]) -> Dialect | None:
    """Find the dialect whose signs the lines bear; None for a table."""
    for sign, recogniser, most in DIALECTS:
        some = lines[:most]
        if any(map(sign.search, some)) and (dialect := recogniser(some)):
            return dialect
    return None


def guess(lines: list[str]) -> Dialect | None:
    """Find a dialect for lines that are no table either: tuples, words before numbers, time stamps before a table."""
    return (
        wrapped.stamped(lines, recognise, marked=False)
        or wrapped.stamped(lines, _labelled, marked=False)
        or labelled.recognise(lines, marked=False)
    )


def _labelled(lines: list[str]) -> Dialect | None:
    """Find labels that name a magnetometer, else three numbers between any words."""
    return labelled.recognise(lines) or labelled.recognise(lines, marked=False)


class _Row(NamedTuple):
    """A dialect, which is looked for where a line bears its sign."""

    sign: re.Pattern[str]
    recognise: Callable[[list[str]], Dialect | None]
    most: int | None = TRIED  # lines that are looked at


DIALECTS: Final = (
    _Row(marked.SIGN, marked.recognise, None),  # a log may begin with other messages
    _Row(re.compile(r"^\s*[\[{]"), json_records.recognise),
    _Row(re.compile(r"\d:\d\d:\d\d"), lambda lines: wrapped.stamped(lines, recognise)),
    _Row(wrapped.LETTERED_WORD, lambda lines: wrapped.hexadecimal(lines, _labelled)),
    _Row(re.compile(r"[^\W\d_]"), labelled.recognise),
)


class Transcription:
    """A recording in a dialect as a `table` without a header, each row in the place of its line, and what is no row."""

    def __init__(self, source: Source, dialect: Dialect, encoding: str) -> None:
        self._dialect, self._encoding, self.frame = dialect, encoding, dialect.frame
        self._others, self._numbers, self._example = 0, list[int](), ""
        self.table = derived(source, self._rows(source))

    def others(self, before: int = 0) -> tuple[Skipped, ...]:
        """Account for the lines that are none of the dialect, less so many that are accounted for already."""
        if self._others <= before:
            return ()
        numbers = () if before else tuple(self._numbers)
        return (Skipped(OTHER, self._others - before, numbers, "" if before else self._example),)

    def _rows(self, source: Source) -> Iterator[bytes]:
        """Yield the rows of each block of lines."""
        row = self._dialect.row
        for lines in source.lines(self._encoding):
            rows = [
                self._other(lines, place, text) if (cells := row(text)) is None else ",".join(cells)
                for place, text in enumerate(lines.texts)
            ]
            yield "\n".join([*rows, ""]).encode()

    def _other(self, lines: Lines, place: int, text: str) -> str:
        """Count a line that is no reading; a blank row takes its place, and rows keep the numbers of their lines."""
        if text == ENDS_EARLY:
            return text
        if text.strip():
            self._others += 1
            self._example = self._example or shown(text)
            if len(self._numbers) < MOST_NUMBERS:
                self._numbers.append(lines.first + place)
        return ""
