"""Dialects: lines that are no table, and how each of them becomes a row of one.

A dialect is recognised by the first lines and then takes one line at a time, whether that comes from a file or from a
wire. A new one is a file with a `Dialect` and a function ``recognise``, and a line in `recognise` here.

>>> dialect = recognise(["starting up", "X: -20.8 Y: -20.2 Z: 26.1 uT", "X: -20.7 Y: -20.1 Z: 26.2 uT"])
>>> dialect.words, dialect.names
('labelled lines', ('X (uT)', 'Y (uT)', 'Z (uT)'))
>>> dialect.row("X: -20.6 Y: -20.0 Z: 26.3 uT"), dialect.row("low battery") is None
(['-20.6', '-20.0', '26.3'], True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.core.samples import Skipped
from flinders.readers._lines import ENDS_EARLY, shown
from flinders.readers._sniff import TRIED
from flinders.readers._source import derived
from flinders.readers.dialects import json_records, labelled, marked, wrapped

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.readers._lines import Lines
    from flinders.readers._source import Source
    from flinders.readers._tokenizer import Dialect

OTHER: Final = "other"  # Why lines are left out that are none of the dialect
MOST_NUMBERS: Final = 10  # Numbers of lines that are kept to be shown


def recognise(lines: list[str]) -> Dialect | None:
    """Find the dialect whose marks the lines bear; None for a table."""
    first = lines[:TRIED]
    return (
        marked.recognise(lines)
        or json_records.recognise(first)
        or wrapped.stamped(first, recognise)
        or wrapped.hexadecimal(first, _labelled)
        or labelled.recognise(first)
    )


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


class Transcription:
    """A recording in a dialect as a `table` without a header, each row in the place of its line, and what is no row."""

    def __init__(self, source: Source, dialect: Dialect, encoding: str) -> None:
        self._dialect, self._encoding = dialect, encoding
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
