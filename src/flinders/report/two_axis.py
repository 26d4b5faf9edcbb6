"""A turn in one plane as a page for the terminal: the recipe's table beside least squares, and how points are spaced.

>>> from flinders.geometry.plane import PlaneEllipse, Turn
>>> heading = np.radians(np.arange(0, 360, 10))
>>> points = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5], axis=1)
>>> turn = Turn.of("xy", points, PlaneEllipse.of_points(points))
>>> [(name, mean) for name, mean, _ in rows(turn, "µT")][1:4]
[('mean Hx', '10.0000 µT'), ('mean Hy', '-5.0000 µT'), ('eigenvalues', '450.000, 200.000')]
>>> trust(turn, 1.0, is_mean=True)
'36 points, widest gap 10°, first harmonic 0.000, second 0.000: evenly spaced, the mean can be trusted'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.composition import ANY_ANGLE, in_words
from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.geometry.plane import across
from flinders.report.formatting import degrees
from flinders.report.text import COLOURS, listed, numbers
from flinders.report.text import page as fit_page

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.comparison.composition import Composed
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import PlaneEllipse, Turn

NOTHING: Final = 0.1
"""Of the target: what costs less is not worth a word."""


def page(fit: Fit, turn: Turn, *, composed: Composed | None, after: str | None) -> RenderableType:
    """Lay out a turn, its calibration, and what it makes of the one that was loaded before."""
    from rich.console import Group

    parts: list[RenderableType] = [
        "",
        _table(fit, turn),
        "",
        trust(turn, fit.target_deg, is_mean=is_mean(fit)),
        fit_page(fit),
    ]
    if composed is not None:
        parts += ["", *_composed(composed, after)]
    return Group(*parts)


def _composed(composed: Composed, after: str | None) -> Iterator[RenderableType]:
    """Lay out the numbers to be loaded, what is claimed of them, and what is open."""
    from rich.table import Table
    from rich.text import Text

    yield Text(f"composed with {after}, to be loaded in its place", "bold")
    yield numbers(composed.calibration, np.full(3, np.nan), composed.fit.noise)
    yield ""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    error = composed.heading_error_deg
    good = f"worst heading good to {degrees(error.worst)} (1 σ; the target is {composed.fit.target_deg:g}°)"
    words = good if error.worst < ANY_ANGLE else "nothing is claimed of a heading"
    grid.add_row(Text(composed.verdict.upper(), f"bold {COLOURS[composed.verdict]}"), f"{words}, with these limits:")
    grid.add_row("", Text(f"{in_words(composed.turns)}; held level, dip {error.dip_deg:g}°", "dim"))
    yield grid
    yield listed(composed.findings)


def rows(turn: Turn, unit: str) -> list[tuple[str, str, str]]:
    """Name, what mean and scatter give and what least squares give, of each number of the recipe."""
    return [
        ("points", *(f"{turn.spacing.points:,}" for _ in range(2))),
        *zip(_names(turn.plane), *(_cells(found, unit) for found in (turn.recipe, turn.ellipse)), strict=True),
    ]


def is_mean(fit: Fit) -> bool:
    """Whether the offset is the mean of the points."""
    return fit.method.startswith("two-axis")


def trust(turn: Turn, target_deg: float, *, is_mean: bool) -> str:
    """Say how the points are spaced, and whether their mean is the centre."""
    spacing = turn.spacing
    instead = "" if spacing.is_even(within_deg=target_deg) or not is_mean else "; use --method ellipse"
    return (
        f"{counted(spacing.points, 'point')}, widest gap {spacing.widest_gap_deg:.0f}°, first harmonic "
        f"{spacing.first:.3f}, second {spacing.second:.3f}: {evenness(turn, target_deg, is_mean=is_mean)}{instead}"
    )


def evenness(turn: Turn, target_deg: float, *, is_mean: bool) -> str:
    """Say what the spacing of the points costs, or would cost, those who take the mean."""
    spacing = turn.spacing
    if spacing.cost_deg < NOTHING * target_deg:
        return "evenly spaced, the mean can be trusted"
    cost = f"the mean {'costs' if is_mean else 'would cost'} up to {degrees(spacing.cost_deg)} of heading"
    if spacing.is_even(within_deg=target_deg):
        return f"{cost}, within the target of {target_deg:g}°"
    return f"not evenly spaced, {cost}"


def _names(plane: str) -> tuple[str, ...]:
    entries = [f"S{'xyz'.index(row) + 1}{'xyz'.index(column) + 1}" for row in plane for column in plane]
    return (f"mean H{plane[0]}", f"mean H{plane[1]}", "eigenvalues", "semi-axes", "axis ratio", "skew angle", *entries)


def _cells(found: PlaneEllipse, unit: str) -> tuple[str, ...]:
    """Write an ellipse as the recipe has it."""
    x, y = found.centre.tolist()
    (s11, s12), (s21, s22) = found.matrix.tolist()
    long, short = (figures(axis, 6) for axis in found.semi_axes.tolist())
    first, second = (figures(value, 6) for value in found.eigenvalues.tolist())
    return (
        f"{x:.4f} {unit}", f"{y:.4f} {unit}", f"{first}, {second}", f"{long}, {short} {unit}", f"{found.ratio:.5f}",
        f"{found.direction_deg + 0.0:+.3f}°", *(f"{entry + 0.0:+.6f}" for entry in (s11, s12, s21, s22)),
    )  # fmt: skip


def _table(fit: Fit, turn: Turn) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column(f"plane {turn.plane}, turned about {across(turn.plane)}")
    table.add_column("mean and scatter", justify="right", style="bold" if is_mean(fit) else "")
    table.add_column("least squares", justify="right", style="" if is_mean(fit) else "bold")
    for row in rows(turn, label(fit.calibration.unit)):
        table.add_row(*row)
    return table
