"""What every terminal page is laid out with: tables, lines of numbers, facts, a verdict and what limits it.

A page is a few blocks with an empty line before each; what is not known is None and leaves no line.

>>> from rich.console import Console
>>> block = verdict("GOOD", "good", "worst heading good to 0.12°", "3,000 readings")
>>> Console(width=60).print(page(lines([("offset", "12.3", "µT")]), block, None), notes([("limits", "few readings")]))
<BLANKLINE>
offset   12.3   µT
<BLANKLINE>
GOOD  worst heading good to 0.12°
      3,000 readings
  ! few readings
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich import box
from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from flinders.core.units import label
from flinders.errors import figures
from flinders.report.formatting import aligned, matrix_entries, offset_entries, on_the_point

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red"}
MARKS: Final = {"refuses": ("✗", "red"), "limits": ("!", "yellow"), "note": ("·", "dim")}


def page(*blocks: RenderableType | None) -> Group:
    """Put blocks below each other, each after an empty line."""
    return Group(*(part for block in blocks if block is not None for part in ("", block)))


def table(
    headings: Iterable[str | Column], rows: Iterable[Sequence[RenderableType]], *, is_dense: bool = False
) -> Table:
    """A table: its first column to the left, numbers to the right, but for a `Column` that says otherwise."""
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


def styled(style: str, *cells: str) -> list[Text]:
    """Cells of a row that stands out."""
    return [Text(cell, style) for cell in cells]


def facts(rows: Iterable[tuple[str, str]], width: int | None = None) -> Table:
    """Names, dim, and what is known of each, in as many lines as it takes."""
    grid = Table.grid(Column(style="dim", no_wrap=True, width=width), Column(), padding=(0, 2))
    for name, text in rows:
        grid.add_row(name, Text(text))
    return grid


def lines(rows: Sequence[tuple[str, str, str]]) -> Text:
    """Name, numbers and unit in a line each that is never cut, however narrow the page."""
    width = max(len(name) for name, _, _ in rows) + 3
    text = Text(no_wrap=True, overflow="ignore")
    for name, shown, unit in rows:
        text.append(f"{name:<{width}}", "dim").append(shown).append(f"   {unit}\n", "dim")
    text.rstrip()
    return text


def numbers(calibration: Calibration, offset_sigma: Floats, noise: float | None) -> Text:
    """Offset above matrix, in columns x, y and z, each on its decimal points."""
    unit = label(calibration.unit)
    offset = offset_entries(calibration, offset_sigma)
    shown = ["   ".join(row) for row in aligned(offset, *matrix_entries(calibration.matrix))]
    below, _ = on_the_point(["?" if noise is None else figures(noise, 3), offset[0]])
    shown.append(below.ljust(len(shown[0])))
    names, units = ("offset", "matrix", "", "", "noise"), (unit, "", "", "", unit)
    return lines(list(zip(names, shown, units, strict=True)))


def verdict(title: str, colour: str, words: str, *more: str | Text) -> Table:
    """The verdict, what it means in words and, below, what that rests on."""
    grid = Table.grid(Column(no_wrap=True), Column(), padding=(0, 2))
    grid.add_row(Text(title, f"bold {COLOURS[colour]}"), words)
    for text in more:
        grid.add_row("", Text(text, "dim") if isinstance(text, str) else text)
    return grid


def notes(said: Iterable[tuple[str, str]]) -> RenderableType:
    """Words with the mark of their severity before each; no line where there are none."""
    grid = Table.grid(padding=(0, 1))
    for severity, words in said:
        mark, style = MARKS[severity]
        grid.add_row(Text(f"  {mark}", style), Text(words, "dim" if style == "dim" else ""))
    return grid if grid.row_count else Group()
