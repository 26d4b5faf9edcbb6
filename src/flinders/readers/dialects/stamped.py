"""Lines with the time in front, as serial monitors and loggers put it there: ``14:03:00.123 -> X: 1 Y: 2 Z: 3``.

What stands behind the stamp is a dialect of its own, or a table. A stamp without a date counts from midnight.

>>> from flinders.readers.dialects import recognise as of_any
>>> dialect = of_any(["14:03:00.100 -> X: 1 Y: 2 Z: 3", "14:03:00.200 -> X: 1 Y: 2 Z: 4"])
>>> dialect.words, dialect.names, dialect.row("14:03:00.300 -> X: 5 Y: 6 Z: 7")
('time stamps before labelled lines', ('time (s)', 'X', 'Y', 'Z'), ['50580.300', '5', '6', '7'])
>>> of_any(["2026-11-22 14:03:00 -> 1,2,3"]).row("2026-11-22 14:03:01 -> 4,5,6")
['1795356181.000', '4', '5', '6']
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from flinders.errors import FlindersError
from flinders.readers._numbers import row_of, split
from flinders.readers._sniff import SPOKEN, sniff
from flinders.readers._tokenizer import STAMP, seconds_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.readers._numbers import Grid
    from flinders.readers.dialects import Dialect

MOST: Final = 0.6  # Share of lines that have to have a stamp
DAY_S: Final = 86400.0
PLAIN: Final = ("x", "y", "z")  # Names of the columns of a table of three without a header


@dataclass(slots=True)
class Stamped:
    """A dialect, or a table, behind a time stamp."""

    inner: Dialect
    _midnights: float = field(default=0.0, init=False)
    _last: float = field(default=-1.0, init=False)

    @property
    def words(self) -> str:
        """For people."""
        return f"time stamps before {self.inner.words}"

    @property
    def names(self) -> tuple[str, ...]:
        """The time, and what the inner dialect names."""
        return ("time (s)", *self.inner.names)

    def row(self, line: str) -> Sequence[str] | None:
        """Take the time off a line, and put it before the cells of the rest; it goes on past midnight."""
        stamp = STAMP.match(line)
        seconds = seconds_of(stamp)
        if stamp is None or seconds is None:
            return None
        cells = self.inner.row(line[stamp.end() :])
        if not cells:
            return cells
        if seconds + self._midnights < self._last - DAY_S / 2:
            self._midnights += DAY_S
        self._last = seconds + self._midnights
        return [f"{self._last:.6f}".removesuffix("000"), *cells]


@dataclass(frozen=True, slots=True)
class Cells:
    """Rows of a table, cut at its delimiter."""

    grid: Grid
    names: tuple[str, ...]

    @property
    def words(self) -> str:
        """For people."""
        return f"{SPOKEN[self.grid.delimiter]}-separated numbers"

    def row(self, line: str) -> list[str] | None:
        """Cut a line; one of another width, or with words for the magnetometer's numbers, is another line."""
        cells = split(line, self.grid.delimiter)
        if row_of(cells, self.grid) is None:
            return None
        return [cell.strip().replace(self.grid.decimal, ".") for cell in cells[: self.grid.width or None]]


def recognise(
    lines: list[str], behind: Callable[[list[str]], Dialect | None], *, marked: bool = True
) -> Stamped | None:
    """Find stamps before most lines, and what stands behind them.

    Parameters
    ----------
    lines : list of str
    behind : callable
        Recognises the dialect of what stands behind the stamps.
    marked : bool
        Only stamps that a sign such as ``->`` parts from the rest, or a label follows; else before any table.
    """
    filled = [line for line in lines if line.strip()]
    stamps = [STAMP.match(line) for line in filled]
    rest = [line[stamp.end() :] for line, stamp in zip(filled, stamps, strict=True) if stamp]
    if not rest or len(rest) < MOST * len(filled):
        return None
    if marked and any(stamp["mark"] in (",", ";", "\t") for stamp in stamps if stamp):
        return None
    if inner := behind(rest):
        return Stamped(inner)
    if marked and not all(stamp["mark"] for stamp in stamps if stamp):
        return None
    table = _table(rest)
    return Stamped(table) if table else None


def _table(lines: list[str]) -> Cells | None:
    try:
        layout = sniff("", lines)
    except FlindersError:
        return None
    width = layout.grid.width
    return Cells(layout.grid, layout.header or (PLAIN if width == len(PLAIN) else tuple(map(str, range(1, width + 1)))))
