"""A calibration from six typed numbers as a page for the terminal: the table that such a board shows, and the limits.

>>> from rich.console import Console
>>> from flinders.fitting.axis_extremes import from_extremes
>>> Console(width=60).print(table(from_extremes([-157, 98, -123, 124, -109, 101], variant="largest")))
     min   max   offset   half-range   scale
────────────────────────────────────────────
x   -157    98    -29.5        127.5    1.00
y   -123   124      0.5        123.5    1.03
z   -109   101     -4.0        105.0    1.21
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.report.text import COLOURS, MARKS, numbers

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from flinders.fitting.axis_extremes import Extremes


def page(found: Extremes) -> RenderableType:
    """Lay out what six numbers give for a rich console."""
    from rich.console import Group

    unknown = found.low * float("nan")
    result = numbers(found.calibration, unknown, None)
    return Group("", table(found), "", result, "", _verdict(found), _findings(found))


def table(found: Extremes) -> Table:
    """Lay out the six numbers with the offset and the scale of each axis."""
    from rich import box
    from rich.table import Table

    rows = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    rows.add_column("")
    for heading in ("min", "max", "offset", "half-range", "scale"):
        rows.add_column(heading, justify="right")
    half = found.ellipsoid.shape.diagonal()
    digits = max(0, min(12, _decimals(found)))
    for axis, letter in enumerate("xyz"):
        ends = (f"{found.low[axis]:.{digits}f}", f"{found.high[axis]:.{digits}f}")
        middle = (f"{found.calibration.offset[axis]:.{digits + 1}f}", f"{half[axis]:.{digits + 1}f}")
        scale = found.scale[axis]
        rows.add_row(letter, *ends, *middle, f"{scale:.2f}" if scale >= 0.1 else f"{scale:.3g}")
    return rows


def _decimals(found: Extremes) -> int:
    """Decimals that all six numbers need, up to six digits in all."""
    values = [*found.low.tolist(), *found.high.tolist()]
    written = [f"{value:.6g}" for value in values]
    if any("e" in text for text in written):
        return 3
    return max(len(text.partition(".")[2]) for text in written)


def _verdict(found: Extremes) -> RenderableType:
    """Say that nothing is claimed."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    verdict = Text(found.verdict.upper(), f"bold {COLOURS[found.verdict]}")
    grid.add_row(verdict, "how good it is nobody knows, with these limits:")
    grid.add_row("", Text("six typed numbers; minmax", "dim"))
    return grid


def _findings(found: Extremes) -> RenderableType:
    """What limits it."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 1))
    for finding in found.findings:
        mark, style = MARKS[finding.severity]
        grid.add_row(Text(f"  {mark}", style=style), Text(finding.advice, style="dim" if style == "dim" else ""))
    return grid
