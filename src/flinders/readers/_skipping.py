"""What is left out of a recording: counted, shown, and too much of it refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Skipped
from flinders.errors import UnreadableInput
from flinders.readers._lines import Lines, shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.readers._numbers import NumberRows

UNREADABLE: Final = "unreadable"
NOT_FINITE: Final = "not finite"
SHOWN_LINES: Final = 10


class Tally:
    """Counts what is read and what is not, so that a file of which little can be read is refused."""

    def __init__(self) -> None:
        self.rows = self.usable = 0
        self.unreadable = 0
        self.first = self.last = (0, "")

    def add(self, rows: NumberRows, usable: NDArray[np.bool_]) -> None:
        """Count one stretch."""
        self.rows += len(usable)
        self.usable += int(usable.sum())
        if rows.unreadable:
            self.first = self.first if self.unreadable else rows.unreadable[0]
            self.last = rows.unreadable[-1]
            self.unreadable += len(rows.unreadable)

    def judge(self, name: str, skipped: tuple[Skipped, ...]) -> None:
        """Refuse a file more than half of which is unreadable, or in which nothing can be used.

        Raises
        ------
        UnreadableInput
            With the first and last such line, and how many there are.
        """
        if self.unreadable > self.rows:
            raise UnreadableInput(
                f"{self.unreadable:,} of {self.unreadable + self.rows:,} lines of {name} are not readings: "
                f"the first is line {self.first[0]} ({shown(self.first[1])!r}), the last line {self.last[0]} "
                f"({shown(self.last[1])!r}); check what was recorded, or name the columns with --columns"
            )
        if not self.usable:
            raise UnreadableInput(
                f"no usable reading in {name}: {'; '.join(map(str, skipped))}; need finite x, y and z: "
                "check the sensor and its wiring"
            )


def added(one: tuple[Skipped, ...], other: tuple[Skipped, ...]) -> tuple[Skipped, ...]:
    """Put two accounts of what was left out together, one entry a reason."""
    reasons = {entry.reason: entry for entry in one}
    for entry in other:
        reasons[entry.reason] = reasons[entry.reason] + entry if entry.reason in reasons else entry
    return tuple(reasons.values())


def left_out_of(lines: Lines, rows: NumberRows, usable: NDArray[np.bool_]) -> tuple[Skipped, ...]:
    """Account for the rows of a stretch that cannot be used, and the lines that are none."""
    found = []
    if not usable.all():
        gaps = [rows.lines[int(place)] for place in np.flatnonzero(~usable)]
        found.append((NOT_FINITE, gaps, lines.texts[gaps[0] - lines.first]))
    if rows.unreadable:
        found.append((UNREADABLE, [line for line, _ in rows.unreadable], rows.unreadable[0][1]))
    return tuple(
        Skipped(reason, len(numbers), tuple(numbers[:SHOWN_LINES]), shown(example))
        for reason, numbers, example in found
    )
