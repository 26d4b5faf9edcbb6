"""Pages for the terminal: tables, facts, lines of numbers, a verdict, notes; and a fit drawn in twelve lines.

A page consists of blocks, with an empty line between them; a block that is None leaves no line.

>>> from rich.console import Console
>>> block = verdict("GOOD", "good", "headings good to 0.12°", "3,000 readings")
>>> Console(width=60).print(page(lines([("offset", "12.3", "µT")]), block, None), notes([("limits", "few readings")]))
<BLANKLINE>
offset   12.3   µT
<BLANKLINE>
GOOD  headings good to 0.12°
      3,000 readings
  ! few readings

Pictures use Braille characters, of eight dots each; terminals without these get plain characters.

>>> print(*braille(np.eye(8, dtype=bool)), sep=" / ")
⠑⢄⠀⠀ / ⠀⠀⠑⢄
>>> print(*letters(np.eye(8, dtype=bool)), sep=" / ")
::   /   ::
"""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np
from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from flinders.geometry.sphere import from_longitudes, tile_indices
from flinders.summary.coverage import cell_indices

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray
    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.report.figure_data import FigureData
    from flinders.report.view import View


COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red", "failed": "red"}
MARKS: Final = {"refuses": ("✗", "red"), "limits": ("!", "yellow"), "note": ("·", "dim")}


def page(*blocks: RenderableType | None) -> Group:
    """Place blocks below each other, with an empty line between them."""
    return Group(*(part for block in blocks if block is not None for part in ("", block)))


def table(
    headings: Iterable[str | Column], rows: Iterable[Sequence[RenderableType]], *, is_dense: bool = False
) -> Table:
    """A table: the first column is aligned left and the others right, unless a `Column` says otherwise."""
    columns = [
        Column(heading, justify="right" if place else "left") if isinstance(heading, str) else heading
        for place, heading in enumerate(headings)
    ]
    laid = Table(
        *columns, box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=is_dense, header_style=""
    )
    for row in rows:
        laid.add_row(*row)
    return laid


def whole_columns(names: Iterable[str]) -> list[Column]:
    """Columns of numbers that are never truncated."""
    return [Column(name, justify="right", no_wrap=True) for name in names]


def style_cells(style: str, *cells: str) -> list[Text]:
    """Cells of a highlighted row."""
    return [Text(cell, style) for cell in cells]


def facts(rows: Iterable[tuple[str, str]], width: int | None = None) -> Table:
    """Dimmed names with their values, which take as many lines as needed."""
    grid = Table.grid(Column(style="dim", no_wrap=True, width=width), Column(), padding=(0, 2))
    for name, text in rows:
        grid.add_row(name, Text(text))
    return grid


def lines(rows: Sequence[tuple[str, str, str]]) -> Text:
    """Name, numbers and unit in one line each, which is never truncated."""
    width = max(len(name) for name, _, _ in rows) + 3
    text = Text(no_wrap=True, overflow="ignore")
    for name, shown, unit in rows:
        text.append(f"{name:<{width}}", "dim").append(shown).append(f"   {unit}\n", "dim")
    text.rstrip()
    return text


def verdict(title: str, colour: str, words: str | Text, *more: str) -> Table:
    """The verdict with its meaning in words, and below it the numbers that it is based on."""
    grid = Table.grid(Column(no_wrap=True), Column(), padding=(0, 2))
    grid.add_row(Text(title, f"bold {COLOURS[colour]}"), words)
    for text in more:
        grid.add_row("", Text(text, "dim"))
    return grid


def notes(said: Iterable[tuple[str, ...]]) -> RenderableType:
    """Severity as a mark, words and, for a finding, its code, in one line each."""
    grid = Table.grid(padding=(0, 1))
    for severity, words, *codes in said:
        mark, style = MARKS[severity]
        text = Text(words, "dim" if style == "dim" else "")
        grid.add_row(Text(f"  {mark}", style), text.append("".join(f" [{code}]" for code in codes), "dim"))
    return grid if grid.row_count else Group()


def next_commands(commands: Sequence[str]) -> RenderableType:
    """The next commands, in one line each that is never truncated."""
    title = Text("next" if len(commands) == 1 else "next, one of", "bold")
    return Group(title, *(Text(f"   {command}", no_wrap=True, overflow="ignore") for command in commands))


# ------------------------------------------------------------------------------------------------- a fit in a few lines

ROWS, COLUMNS, MAP_WIDTH, GAP = 10, 20, 32, 3
WIDTH: Final = 2 * (COLUMNS + GAP) + MAP_WIDTH
"""Sizes in characters: rows of a picture; columns of a picture, of the map, of a gap between two, and of all."""

WEIGHTS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Value of each dot in the code of a Braille character, by row and column of the dots."""

LETTERS: Final = {False: "█░▒·", True: "#+:."}
"""Marks of errors within and above the target, each with and without readings; by whether ASCII is needed."""

REQUIRED_LETTERS: Final = f"⣿{LETTERS[False]}"
"""Characters that a terminal must have, or else it gets ASCII."""

TINTS: Final = ("green", "green", "yellow", "red")


def plot(drawn: FigureData, fit: Fit, *, is_plain: bool = False, width: int = 80) -> Text:
    """Draw a good or limited fit in twelve lines; without the map on a narrow terminal.

    With `is_plain` only ASCII characters are used.
    """
    pictures = [
        ("before, x and y", _picture(drawn.raw[drawn.is_used], is_plain=is_plain), "yellow"),
        ("after", _picture(drawn.corrected[drawn.is_used], is_plain=is_plain), "cyan"),
    ]
    rows = list(_map(drawn.view, fit)) if width >= WIDTH and drawn.view is not None else []
    text = Text(no_wrap=True)
    titles = "".join(f"{title:<{COLUMNS + GAP}}" for title, _, _ in pictures)
    text.append(f"{titles}{'directions, +z above' if rows else ''}\n", "bold")
    for place in range(ROWS):
        for _, lines, colour in pictures:
            text.append(lines[place], colour).append(" " * GAP)
        for kind, run in groupby(rows[place] if rows else ()):
            text.append(LETTERS[is_plain][kind] * len(list(run)), TINTS[kind])
        text.append("\n")
    if rows:
        within, open_within, above, open_above = tuple(LETTERS[is_plain])
        words = f"{within} {open_within} within {fit.claim.target_deg:g}°, {above} {open_above} above; "
        words += f"{open_within} {open_above} not recorded"
        text.append("+ is zero".ljust(WIDTH - len(words)) + words, "dim")
    return text


def braille(dots: NDArray[np.bool_]) -> list[str]:
    """Lines of Braille characters for (4 r, 2 c) dots."""
    blocks = dots.reshape(len(dots) // 4, 4, -1, 2)
    codes = 0x2800 + np.einsum("rjck,jk->rc", blocks.astype(int), WEIGHTS)
    return ["".join(map(chr, row)) for row in codes.tolist()]


def letters(dots: NDArray[np.bool_]) -> list[str]:
    """(4 r, 2 c) dots as r lines of c characters: a dot, colon or hash, for few, some or many dots in its cell."""
    counts = dots.reshape(len(dots) // 4, 4, -1, 2).sum(axis=(1, 3))
    return ["".join(" .:::####"[count] for count in row) for row in counts.tolist()]


def _picture(points: Floats, *, is_plain: bool) -> list[str]:
    """Readings seen along z, with x to the right and y up; a cross marks zero if it is within the picture."""
    dots = np.zeros((4 * ROWS, 2 * COLUMNS), bool)
    if not len(points):
        return letters(dots)
    low, high = np.quantile(points[:, :2], [0.002, 0.998], axis=0)
    if (np.abs((low + high) / 2.0) <= 2.0 * (high - low).max()).all():
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    half = max(0.52 * float((high - low).max()), 1e-12)
    share = (points[:, :2] - (low + high) / 2.0) / half
    seen = share[(np.abs(share) < 1.0).all(axis=1)]
    columns, rows = ((seen * [1.0, -1.0] + 1.0) * [COLUMNS, 2.0 * ROWS]).astype(int).T
    dots[rows, columns] = True
    lines = letters(dots) if is_plain else braille(dots)
    x, y = -(low + high) / 2.0 / half
    if abs(x) < 1.0 and abs(y) < 1.0:
        row, column = int((1.0 - y) / 2.0 * ROWS), int((1.0 + x) / 2.0 * COLUMNS)
        lines[row] = f"{lines[row][:column]}+{lines[row][column + 1 :]}"
    return lines


def _map(view: View, fit: Fit) -> Iterator[list[int]]:
    """Yield the marks of directions in rows of equal area, from +z to −z, with x in the middle."""
    heights = 1.0 - 2.0 * (np.arange(ROWS) + 0.5) / ROWS
    around = 2.0 * np.pi * ((np.arange(MAP_WIDTH) + 0.5) / MAP_WIDTH - 0.5)
    for height in heights:
        directions = from_longitudes(np.full(MAP_WIDTH, height), around)
        errors = [view.tiles_deg[tile] for tile in tile_indices(directions).tolist()]
        is_seen = fit.evidence.coverage.counts[cell_indices(directions)] > 0.0
        yield [
            (0 if error is not None and error <= fit.claim.target_deg else 2) + (0 if seen else 1)
            for error, seen in zip(errors, is_seen.tolist(), strict=True)
        ]


def curve_line(value: float, end: float, width: int, *, seen: float | None = None) -> str:
    """One line of a curve, with west to the left: ``|`` at zero, ``*`` at the value, ``o`` at an observed value.

    >>> curve_line(10.5, 25.0, 21, seen=10.0)
    '          |   o      '
    """
    middle = width // 2
    line = [" "] * width
    line[middle] = "|"
    for sign, angle in (("*", value), ("o", seen)):
        if angle is not None:
            line[round(middle + middle * max(-1.0, min(1.0, angle / end)))] = sign
    return "".join(line)
