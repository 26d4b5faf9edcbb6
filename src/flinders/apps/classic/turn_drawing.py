"""SVG drawing of a turn in one plane, in polar coordinates, before and after correction.

The first axis of the plane points up and the second to the right, as on a compass card with x ahead and y to the right.
Rings mark lengths of the field.

>>> ring_step(38.0), ring_step(0.7), ring_step(4100.0)
(10.0, 0.2, 1000.0)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.classic.pages import evenness, is_mean
from flinders.core.units import unit_label
from flinders.errors import figures
from flinders.fitting.claim import heading_words
from flinders.report.charts import (
    Axis,
    Plot,
    circle,
    drawing,
    segment,
    text,
    thin_out,
)
from flinders.report.formatting import degrees, minus

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import PlaneEllipse, Turn

RADIUS, LEFT, RIGHT, MIDDLE = 152, 206.0, 594.0, 288.0
"""Radius of the two charts, horizontal places of their centres, and vertical place of both centres, in pixels."""
MAX_POINTS: Final = 720
"""Largest number of points that are drawn."""
ANGLES_RAD: Final = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
CIRCLE: Final = np.stack([np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)], axis=1)


def turn_drawing(turn: Turn, fit: Fit) -> str:
    """Draw a turn before and after the correction of a fit; a refused fit is marked, without its numbers."""
    loaded, unit = turn.recipe if is_mean(fit) else turn.ellipse, unit_label(fit.calibration.unit)
    title = f"Turn in the plane {turn.plane}: {turn.spacing.points:,} points"
    subtitle = f"method {fit.evidence.method}; {evenness(turn, fit.claim.target_deg, is_mean=is_mean(fit))}"
    points, ellipse = thin_out(turn.points, MAX_POINTS), loaded.centre + CIRCLE @ loaded.shape
    return drawing(
        800,
        524,
        f"{title}, before and after correction",
        text(24, 34, title, "start", "title"),
        text(24, 56, subtitle, "start"),
        text(776, 34, "REFUSED: not fit for use" if fit.verdict == "refused" else "", "end", "title refused"),
        _side(LEFT, "before", turn.plane, unit, points, ellipse, loaded),
        _words(LEFT, "before", *_words_before(loaded, fit, unit)),
        _side(RIGHT, "after", turn.plane, unit, loaded.correct(points), loaded.radius * CIRCLE),
        _words(RIGHT, "after", *_words_after(loaded, fit, unit)),
    )


def ring_step(largest: float) -> float:
    """Distance of rings: 1, 2 or 5 times a power of ten, so that three to seven rings cover the largest length."""
    power = 10.0 ** math.floor(math.log10(largest / 2.0))
    return next((step * power for step in (0.5, 1.0, 2.0, 5.0) if largest / (step * power) <= 5.0), 5.0 * power)


def _polar(x: float, points: Floats, plane: str, unit: str) -> tuple[Plot, str]:
    """Plot of polar axes for (n, 2) points, centred at abscissa `x`, and the SVG of its rings, spokes and labels."""
    largest = float(np.linalg.norm(points, axis=1).max())
    step = ring_step(largest)
    rings = math.ceil(largest / step)
    end = Axis(-step * rings, step * rings)
    parts = []
    for ring in range(1, rings + 1):
        is_edge, radius = ring == rings, RADIUS * ring / rings
        out = 4.0 + radius * math.sqrt(0.5)
        parts.append(circle("edge" if is_edge else "ring", x, MIDDLE, round(radius, 1)))
        parts.append(text(x + out, MIDDLE + out + 8, f"{ring * step:g}{f' {unit}' * is_edge}", "start"))
    spokes = np.radians(range(0, 360, 30)).tolist()
    parts += [
        *(segment("grid", x, MIDDLE, x + RADIUS * math.sin(one), MIDDLE - RADIUS * math.cos(one)) for one in spokes),
        text(x, MIDDLE - RADIUS - 8, f"+{plane[0]}", kind="name"),
        text(x, MIDDLE + RADIUS + 18, f"−{plane[0]}", kind="name"),
        text(x + RADIUS + 8, MIDDLE + 5, f"+{plane[1]}", "start", "name"),
        text(x - RADIUS - 8, MIDDLE + 5, f"−{plane[1]}", "end", "name"),
    ]
    return Plot(x - RADIUS, MIDDLE - RADIUS, 2.0 * RADIUS, 2.0 * RADIUS, end, end), "".join(parts)


def _side(
    x: float, kind: str, plane: str, unit: str, points: Floats, outline: Floats, loaded: PlaneEllipse | None = None
) -> str:
    """One polar chart: points with their outline and, if `loaded` is given, long axis and offset of that ellipse."""
    plot, grid = _polar(x, np.concatenate([points, outline]), plane, unit)
    size = 4.0 if len(points) <= 72 else 2.5
    places = plot.places(*points.T[::-1]).tolist()
    marks = "".join(circle(f"point {kind}", right, down, size) for right, down in places)
    edge = plot.line(f"outline {kind}", *outline.T[::-1], is_closed=True)
    if loaded is None:
        return grid + edge + marks
    angle = math.radians(loaded.direction_deg)
    along = loaded.semi_axes[0] * np.array([math.cos(angle), math.sin(angle)])
    ends = np.array([loaded.centre - along, loaded.centre + along])
    return grid + edge + plot.line("aim", *ends.T[::-1]) + marks + plot.arm(*loaded.centre[::-1].tolist())


def _words_before(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    if fit.verdict == "refused":
        return "the ellipse of this method through the points", "its numbers must not be used"
    offset = ", ".join(minus(figures(value, 3)) for value in loaded.centre.tolist())
    return (
        f"offset {offset} {unit}; axis ratio {loaded.ratio:.3f}",
        f"heading off by up to {degrees(fit.claim.uncorrected_heading_error_deg.worst)}",
    )


def _words_after(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    if fit.verdict == "refused":
        return f"heading off by up to {heading_words(fit.claim)}", "must not be used"
    return (
        f"circle of {figures(loaded.radius, 4)} {unit}, points {figures(fit.evidence.noise)} {unit} off (1 σ)",
        f"heading good to {heading_words(fit.claim)}",
    )


def _words(x: float, title: str, first: str, second: str) -> str:
    """A title above a chart and two lines below it."""
    return text(x, 98, title, kind="title") + text(x, 484, first) + text(x, 504, second)
