"""A turn in one plane: its page for the terminal, and the turn in polar coordinates as SVG, before and after.

>>> from flinders.geometry.plane import PlaneEllipse, Turn
>>> heading = np.radians(np.arange(0, 360, 10))
>>> points = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5], axis=1)
>>> turn = Turn.of("xy", points, PlaneEllipse.of_points(points))
>>> [row[:2] for row in plane_rows(turn, "µT")][1:4]
[('mean Hx', '10.0000 µT'), ('mean Hy', '-5.0000 µT'), ('eigenvalues', '450.000, 200.000')]
>>> spacing_words(turn, 1.0, is_mean=True)
'36 points, widest gap 10°, first harmonic 0.000, second 0.000: evenly spaced, the mean can be trusted'

In the drawing the first axis of the plane points up and the second one to the right, as on a compass card with x ahead
and y to the right. Rings are lengths of the field.

>>> ring_step(38.0), ring_step(0.7), ring_step(4100.0)
(10.0, 0.2, 1000.0)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.comparison.composition import ANY_ANGLE, in_words, turns_of
from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.geometry.plane import across
from flinders.report import charts
from flinders.report.charts import Axis, Plot, circle, segment, text, thinned
from flinders.report.fit_pages import findings, good_to, of_fit
from flinders.report.formatting import degrees, minus
from flinders.report.terminal import graded, numbers, page, table

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import PlaneEllipse, Turn

NEGLIGIBLE: Final = 0.1
"""Of the target: what costs less is not worth a word."""

WIDE, HIGH, RADIUS = 800, 524, 152
LEFT, RIGHT, MIDDLE = 206.0, 594.0, 288.0
"""Centres of the two charts."""

SHOWN: Final = 720
"""Points that are drawn; more would be a smear."""

AROUND: Final = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
CIRCLE: Final = np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)


def of_turn(fit: Fit, turn: Turn, *, composed: Fit | None, after: str | None) -> RenderableType:
    """Lay out a turn in one plane, its calibration, and what it makes of the one that was loaded before."""
    mean_style, least_style = ("bold", "") if is_mean(fit) else ("", "bold")
    headings = (
        f"plane {turn.plane}, turned about {across(turn.plane)}",
        Column("mean and scatter", justify="right", style=mean_style),
        Column("least squares", justify="right", style=least_style),
    )
    recipe = table(headings, plane_rows(turn, label(fit.calibration.unit)))
    words = spacing_words(turn, fit.target_deg, is_mean=is_mean(fit))
    return Group(page(recipe, words), of_fit(fit), *([] if composed is None else [_composed(composed, after)]))


def is_mean(fit: Fit) -> bool:
    """Whether the offset is the mean of the points."""
    return fit.method.startswith("two-axis")


def plane_rows(turn: Turn, unit: str) -> list[tuple[str, str, str]]:
    """Name, what mean and scatter give and what least squares give, of each number of the recipe."""
    points, axes = f"{turn.spacing.points:,}", ["xyz".index(axis) + 1 for axis in turn.plane]
    entries = [f"S{row}{column}" for row in axes for column in axes]
    means = [f"mean H{axis}" for axis in turn.plane]
    names = (*means, "eigenvalues", "semi-axes", "axis ratio", "skew angle", *entries)
    cells = (_ellipse_cells(ellipse, unit) for ellipse in (turn.recipe, turn.ellipse))
    return [("points", points, points), *zip(names, *cells, strict=True)]


def _ellipse_cells(ellipse: PlaneEllipse, unit: str) -> list[str]:
    """Write an ellipse as the recipe has it."""
    first, second = (figures(value, 6) for value in ellipse.eigenvalues.tolist())
    long, short = (figures(axis, 6) for axis in ellipse.semi_axes.tolist())
    return [
        *(f"{value:.4f} {unit}" for value in ellipse.centre.tolist()),
        f"{first}, {second}",
        f"{long}, {short} {unit}",
        f"{ellipse.ratio:.5f}",
        f"{ellipse.direction_deg + 0.0:+.3f}°",
        *(f"{entry + 0.0:+.6f}" for entry in ellipse.matrix.ravel().tolist()),
    ]


def spacing_words(turn: Turn, target_deg: float, *, is_mean: bool) -> str:
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
    if spacing.cost_deg < NEGLIGIBLE * target_deg:
        return "evenly spaced, the mean can be trusted"
    cost = f"the mean {'costs' if is_mean else 'would cost'} up to {degrees(spacing.cost_deg)} of heading"
    if spacing.is_even(within_deg=target_deg):
        return f"{cost}, within the target of {target_deg:g}°"
    return f"not evenly spaced, {cost}"


def _composed(composed: Fit, after: str | None) -> RenderableType:
    """Lay out the numbers to be loaded, what is claimed of them, and what is open."""
    error = composed.heading_error_deg
    good = good_to(error, composed.target_deg)
    words = good if error.worst < ANY_ANGLE else "nothing is claimed of a heading"
    basis = f"{in_words(turns_of(composed.method))}; held level, dip {error.dip_deg:g}°"
    said = graded(composed.verdict, f"{words}, with these limits:", basis)
    title = Text(f"composed with {after}, to be loaded in its place", "bold")
    result = Group(title, numbers(composed.calibration, np.full(3, np.nan), composed.noise))
    return Group(page(result, said), findings(composed.findings))


# ----------------------------------------------------------------------------------------------------------- drawing


def drawing(turn: Turn, fit: Fit) -> str:
    """Draw a turn before and after the correction of a fit; of a refused one it says so, and gives no number of it."""
    loaded, unit = turn.recipe if is_mean(fit) else turn.ellipse, label(fit.calibration.unit)
    title = f"Turn in the plane {turn.plane}: {turn.spacing.points:,} points"
    subtitle = f"method {fit.method}; {evenness(turn, fit.target_deg, is_mean=is_mean(fit))}"
    refusal = "REFUSED: not fit for use" if fit.verdict == "refused" else ""
    return charts.drawing(
        WIDE,
        HIGH,
        f"{title}, before and after correction",
        text(24, 34, title, "start", "title"),
        text(24, 56, subtitle, "start"),
        text(WIDE - 24, 34, refusal, "end", "title refused"),
        _before(turn, loaded, unit),
        _words(LEFT, "before", _words_before(loaded, fit, unit)),
        _after(turn, loaded, unit),
        _words(RIGHT, "after", _words_after(loaded, fit, unit)),
    )


def ring_step(largest: float) -> float:
    """Length from ring to ring: 1, 2 or 5 times a power of ten, so that three to seven of them hold a length."""
    power = 10.0 ** math.floor(math.log10(largest / 2.0))
    return next((step * power for step in (0.5, 1.0, 2.0, 5.0) if largest / (step * power) <= 5.0), 5.0 * power)


def _axes(x: float, points: Floats) -> Plot:
    """Axes around a place of the drawing whose rings hold (n, 2) points."""
    largest = float(np.linalg.norm(points, axis=1).max())
    step = ring_step(largest)
    end = step * math.ceil(largest / step)
    return Plot(x - RADIUS, MIDDLE - RADIUS, 2.0 * RADIUS, 2.0 * RADIUS, Axis(-end, end), Axis(-end, end))


def _grid(plot: Plot, plane: str, unit: str) -> str:
    """Rings with their lengths, a spoke every 30°, and the names of the axes."""
    parts, step, x = [], ring_step(plot.up.high), plot.middle
    rings = round(plot.up.high / step)
    for ring in range(1, rings + 1):
        is_edge, radius = ring == rings, RADIUS * ring / rings
        out = 4.0 + radius * math.sqrt(0.5)
        words = f"{ring * step:g}{f' {unit}' * is_edge}"
        parts.append(circle("edge" if is_edge else "ring", x, MIDDLE, round(radius, 1)))
        parts.append(text(x + out, MIDDLE + out + 8, words, "start"))
    for turn in np.radians(range(0, 360, 30)).tolist():
        parts += [segment("grid", x, MIDDLE, x + RADIUS * math.sin(turn), MIDDLE - RADIUS * math.cos(turn))]
    return "".join(parts) + _names(x, *plane)


def _names(x: float, first: str, second: str) -> str:
    """Where the axes point."""
    return (
        text(x, MIDDLE - RADIUS - 8, f"+{first}", kind="name")
        + text(x, MIDDLE + RADIUS + 18, f"−{first}", kind="name")
        + text(x + RADIUS + 8, MIDDLE + 5, f"+{second}", "start", "name")
        + text(x - RADIUS - 8, MIDDLE + 5, f"−{second}", "end", "name")
    )


def _before(turn: Turn, loaded: PlaneEllipse, unit: str) -> str:
    """Points as recorded, the ellipse and its long axis, and the offset."""
    points, outline = thinned(turn.points, SHOWN), loaded.centre + CIRCLE @ loaded.shape
    plot = _axes(LEFT, np.concatenate([points, outline]))
    angle = math.radians(loaded.direction_deg)
    along = loaded.semi_axes[0] * np.array([math.cos(angle), math.sin(angle)])
    ends = np.array([loaded.centre - along, loaded.centre + along])
    return (
        _grid(plot, turn.plane, unit)
        + plot.line("outline before", *outline.T[::-1], is_closed=True)
        + plot.line("aim", *ends.T[::-1])
        + _points("before", plot, points)
        + plot.arm(*loaded.centre[::-1].tolist())
    )


def _after(turn: Turn, loaded: PlaneEllipse, unit: str) -> str:
    """Points as corrected, and the circle that they should lie on."""
    points, outline = loaded.correct(thinned(turn.points, SHOWN)), loaded.radius * CIRCLE
    plot = _axes(RIGHT, np.concatenate([points, outline]))
    edge = plot.line("outline after", *outline.T[::-1], is_closed=True)
    return _grid(plot, turn.plane, unit) + edge + _points("after", plot, points)


def _points(kind: str, plot: Plot, points: Floats) -> str:
    size = 4.0 if len(points) <= 72 else 2.5
    return "".join(circle(f"point {kind}", x, y, size) for x, y in plot.places(*points.T[::-1]).tolist())


def _words_before(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    if fit.verdict == "refused":
        return "the ellipse that this method makes of the points", "nothing of it is to be used"
    offset = ", ".join(minus(figures(value, 3)) for value in loaded.centre.tolist())
    return (
        f"offset {offset} {unit}; axis ratio {loaded.ratio:.3f}",
        f"heading off by up to {degrees(fit.uncorrected_heading_error_deg.worst)}",
    )


def _words_after(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    worst = degrees(fit.heading_error_deg.worst)
    if fit.verdict == "refused":
        return f"heading off by up to {worst} (1 σ, worst)", "not to be used"
    return (
        f"circle of {figures(loaded.radius, 4)} {unit}, points {figures(fit.noise)} {unit} off (1 σ)",
        f"heading good to {worst} (1 σ, worst)",
    )


def _words(x: float, title: str, lines: tuple[str, str]) -> str:
    """A title above a chart and two lines below it."""
    below = "".join(text(x, 484 + 20 * place, line) for place, line in enumerate(lines))
    return text(x, 98, title, kind="title") + below
