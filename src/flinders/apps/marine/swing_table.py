r"""Tables of a swing: one heading a line, by the compass and by its reference.

>>> import tempfile
>>> from pathlib import Path
>>> file = Path(tempfile.mkdtemp()) / "swing.csv"
>>> _ = file.write_text("compass,magnetic\n0,10.5\n45,65\n90,101.5\n")
>>> table = read_swing(file)
>>> table.columns["magnetic"], table.lines
(array([ 10.5,  65. , 101.5]), (2, 3, 4))
>>> print(table)
swing.csv: 3 headings; columns compass, magnetic
>>> table.deviations(None)
(array([ 0., 45., 90.]), array([10.5, 20. , 11.5]))
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UnreadableInput, UsageError, count_text
from flinders.geometry.angles import wrap_180, wrap_360
from flinders.readers._cells import COMMENTS, parse_number
from flinders.readers._foreign_files import foreign_kind
from flinders.readers._known_texts import refusal
from flinders.readers._lines import encoding_of
from flinders.readers._source import HEAD_BYTES, find
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField

NAMES: Final = {
    "compass": r"compass|steered|read(ing)?|indicated|measured|sensor",
    "magnetic": r"mag(netic)?|known|reference|heading|wanted",
    "true": r"true|geographic|chart|gps|gnss",
    "deviation": r"dev(iation)?|delta|error",
    "sigma": r"sigma|std|uncertainty|scatter",
}
"""Pattern of the words that name each column; the first known word in a header cell counts."""

COLUMN_PAIRS: Final = (
    ("compass", "magnetic"),
    ("compass", "deviation"),
    ("compass", "true"),
    ("magnetic", "deviation"),
)
"""Pairs of columns that are sufficient, the best first."""

NEED: Final = (
    "need two columns under a header, such as compass,magnetic or compass,deviation or compass,true, in degrees, "
    "one heading a line"
)


@dataclass(frozen=True, slots=True, eq=False)
class SwingTable:
    """Table of a swing, column by column."""

    source: str  #: name of the file
    #: two of ``compass``, ``magnetic``, ``true`` and ``deviation``, and ``sigma`` if it is present: (N,), degrees
    columns: Mapping[str, Floats]
    lines: tuple[int, ...]  #: line numbers of the headings, counted from 1

    def __str__(self) -> str:
        """Name and contents of the table."""
        return f"{self.source}: {count_text(len(self.lines), 'heading')}; columns {', '.join(self.columns)}"

    @property
    def is_true(self) -> bool:
        """Whether the table has true headings, which need the declination of the place."""
        return "true" in self.columns

    def deviations(self, site: SiteField | None) -> tuple[Floats, Floats]:
        """(N,) compass headings, and (N,) magnetic less compass headings, degrees.

        Raises `UsageError` for true headings without a site, and for a site without true headings.
        """
        if self.is_true == (site is None):
            advice = "true headings: give the place and day of the swing" if self.is_true else (
                "no true headings: give no place, or call its column 'true'"
            )  # fmt: skip
            raise UsageError(f"{self.source} has {advice}", hint={"site": None})
        columns = dict(self.columns)
        if site is not None:
            columns["magnetic"] = wrap_360(columns["true"] - site.declination_deg)
        deviation = (
            columns["deviation"] if "deviation" in columns else wrap_180(columns["magnetic"] - columns["compass"])
        )
        compass = columns["compass"] if "compass" in columns else wrap_360(columns["magnetic"] - deviation)
        return compass, deviation


def read_swing(path: str | os.PathLike[str]) -> SwingTable:
    """Read a table of a swing with a header; cells are separated by commas, semicolons, tabs or spaces.

    E and W after a deviation are signs. Without a header, two columns are compass and magnetic heading.

    Raises `UnreadableInput` for a missing file or another table, `UsageError` for a heading beyond 360°, with the
    number of the line.
    """
    name, text = _text_of(path)
    if refused := refusal(name, text.splitlines()):
        raise refused
    rows = [
        (line, cells)
        for line, content in enumerate(text.splitlines(), 1)
        if (cells := _cells(content)) and not content.lstrip().startswith(COMMENTS)
    ]
    if not rows:
        raise UnreadableInput(f"{name} is empty: {NEED}")
    known, body = _columns(name, rows)
    numbers = [[_degrees(name, line, cells, place) for place in known.values()] for line, cells in body]
    if not numbers:
        raise UnreadableInput(f"{name} has a header and no headings below it: {NEED}")
    columns = dict(zip(known, np.array(numbers).T, strict=True))
    lines = tuple(line for line, _ in body)
    for kind in ("compass", "magnetic", "true", "deviation"):
        refuse_beyond_circle(columns.get(kind, ()), (f"{kind} in line {line} of {name}" for line in lines))
    return SwingTable(name, columns, lines)


def refuse_beyond_circle(angles: Iterable[float], places: Iterable[str]) -> None:
    """Refuse angles beyond 360°, as after a typing error; raises `UsageError`."""
    for angle, place in zip(angles, places, strict=False):
        if abs(angle) > 360.0:
            raise UsageError(f"{place} is {angle:g}°: need degrees from −360 to 360")


def _text_of(path: str | os.PathLike[str]) -> tuple[str, str]:
    """Name and content of a small text file, or of standard input."""
    source = find(path, once=False)
    head = source.head()
    if kind := foreign_kind(head):
        raise UnreadableInput(f"{source.name} is {kind.name}: {NEED}")
    if len(head) >= HEAD_BYTES:  # a swing has a few dozen lines
        raise UnreadableInput(f"{source.name} is too long for a table of a swing: {NEED}")
    try:
        return source.name, head.decode(encoding_of(head)).removeprefix("\ufeff")
    except UnicodeDecodeError:
        raise UnreadableInput(f"{source.name} is no text: {NEED}") from None


def _cells(line: str) -> list[str]:
    """Cells of a line, split at tabs, semicolons or commas if there are any, else at spaces."""
    for mark in ("\t", ";", ","):
        if mark in line:
            return [cell.strip().strip('"') for cell in line.split(mark)]
    return line.split()


def _columns(name: str, rows: list[tuple[int, list[str]]]) -> tuple[dict[str, int], list[tuple[int, list[str]]]]:
    """Find the index of each column, and return it with the lines below the header."""
    line, first = rows[0]
    if all(_number(cell) is not None for cell in first):
        if len(first) != 2:
            raise UnreadableInput(f"{name} has {len(first)} columns and no header (line {line}): {NEED}")
        return {"compass": 0, "magnetic": 1}, rows
    known: dict[str, int] = {}
    for place, cell in enumerate(first):
        kind = _kind(cell)
        if kind and kind not in known:
            known[kind] = place
    for pair in COLUMN_PAIRS:
        if set(pair) <= known.keys():
            columns: dict[str, int] = {kind: known[kind] for kind in (*pair, "sigma") if kind in known}
            return columns, rows[1:]
    raise UnreadableInput(f"columns of {name} are {', '.join(first)} (line {line}): {NEED}")


def _kind(name: str) -> str:
    """Kind of column from the first known word of its name; empty for an unknown name."""
    for word in re.findall(r"[a-z]+", name.casefold()):
        for kind, pattern in NAMES.items():
            if re.fullmatch(pattern, word):
                return kind
    return ""


def _degrees(name: str, line: int, cells: Sequence[str], place: int) -> float:
    """Number in one cell of a line; raises UnreadableInput with the line's number if the cell has no number."""
    value = _number(cells[place]) if place < len(cells) else None
    if value is None or not np.isfinite(value):
        raise UnreadableInput(
            f"line {line} of {name} has no number of degrees in column {place + 1} "
            f"({shorten(' '.join(cells))!r}): {NEED}"
        )
    return value


def _number(cell: str) -> float | None:
    """Degrees in a cell, negative if W follows the number; None for another text.

    >>> _number("10.5"), _number("8 W"), _number("3,5°E"), _number("north")
    (10.5, -8.0, 3.5, None)
    """
    match = re.fullmatch(r"(.*?)\s*(?:°|deg)?\s*([EeWw]?)", cell.strip())
    if match is None:
        return None
    value = parse_number(match[1], ".")
    value = parse_number(match[1], ",") if value is None else value
    return -value if value is not None and match[2] in {"W", "w"} else value
