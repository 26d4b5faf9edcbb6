"""Counts of the lines of a text: readings, unusable rows, and other lines.

>>> from flinders.readers._grid import NumberRows
>>> tally = Tally()
>>> tally.add(NumberRows(np.zeros((2, 3)), range(1, 3), []), np.array([True, False]))
>>> tally.rows, tally.usable
(2, 1)
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import ACCOMPANYING, MAX_NOTED_LINES, NOT_FINITE, Skipped, silent_entries
from flinders.core.silence import find_silent
from flinders.errors import UnreadableInput
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from flinders.readers._columns import Columns
    from flinders.readers._grid import NumberRows
    from flinders.readers._line_shapes import LineShapes
    from flinders.readers._lines import Lines

UNREADABLE: Final = "unreadable"
OTHER: Final = "other"  # lines that do not belong to the dialect


class Tally:
    """Counts of readable and of unreadable lines, to refuse a file that is mostly unreadable."""

    def __init__(self) -> None:
        self.rows = self.usable = 0
        self.unreadable = 0
        self.first = self.last = (0, "")

    def add(self, rows: NumberRows, usable: NDArray[np.bool_]) -> None:
        """Count the lines of one block."""
        self.rows += len(usable)
        self.usable += int(usable.sum())
        if rows.unreadable:
            self.first = self.first if self.unreadable else rows.unreadable[0]
            self.last = rows.unreadable[-1]
            self.unreadable += len(rows.unreadable)

    def refuse_mostly_unreadable(self, name: str, skipped: tuple[Skipped, ...]) -> None:
        """Raise an error if more than half of the lines are unreadable, or if no reading is usable."""
        if self.unreadable > self.rows:
            raise UnreadableInput(
                f"{self.unreadable:,} of {self.unreadable + self.rows:,} lines of {name} are not readings. The first "
                f"is line {self.first[0]} ({shorten(self.first[1])!r}), the last is line {self.last[0]} "
                f"({shorten(self.last[1])!r}). Check what was recorded, or name the columns",
                hint={"columns": None},
            )
        if not self.usable:
            raise UnreadableInput(
                f"no usable reading in {name}: {'; '.join(map(str, skipped))}. A reading needs finite x, y and z: "
                "check the sensor and its wiring"
            )


def account_for_rows(
    lines: Lines,
    rows: NumberRows,
    usable: NDArray[np.bool_],
    columns: Columns,
    shapes: LineShapes,
    is_of_others: Callable[[str], bool],
) -> tuple[NumberRows, tuple[Skipped, ...]]:
    """Count unusable rows and other lines of a block, and remove the lines that accompany readings."""
    unusable = np.flatnonzero(~usable)
    read = columns.readings(rows.values[unusable].T)
    is_silent = find_silent(read)
    left_out = silent_entries(read[is_silent, 0], rows.numbers[unusable[is_silent]])
    if not is_silent.all():
        gaps = [rows.lines[int(place)] for place in unusable[~is_silent]]
        beside = [number for number in gaps if is_of_others(lines.texts[number - lines.first])]
        accounts = {NOT_FINITE: sorted(set(gaps).difference(beside)), ACCOMPANYING: beside}
        left_out += tuple(_skipped_lines(lines, numbers, why) for why, numbers in accounts.items() if numbers)
    if rows.unreadable:
        left_out += account_for_lines(lines, [number for number, _ in rows.unreadable], shapes, UNREADABLE)
        lost = [(number, text) for number, text in rows.unreadable if not shapes.accompanies(text)]
        rows = replace(rows, unreadable=lost)
    return rows, left_out


def account_for_lines(lines: Lines, others: Sequence[int], shapes: LineShapes, reason: str) -> tuple[Skipped, ...]:
    """Count lines that are not readings: with the given `reason`, or as lines that accompany readings."""
    if not others:
        return ()
    texts, known = lines.texts, frozenset(others)
    for number, text in enumerate(texts, lines.first):
        if text.strip():
            shapes.add(text, is_reading=number not in known)
    own = [number for number in others if shapes.accompanies(texts[number - lines.first])]
    accounts = {reason: sorted(known.difference(own)), ACCOMPANYING: own}
    return tuple(_skipped_lines(lines, numbers, why) for why, numbers in accounts.items() if numbers)


def _skipped_lines(lines: Lines, numbers: Sequence[int], reason: str) -> Skipped:
    """Record of the lines with these numbers, with the first one as an example."""
    example = lines.texts[numbers[0] - lines.first]
    return Skipped(reason, len(numbers), tuple(numbers[:MAX_NOTED_LINES]), shorten(example))
