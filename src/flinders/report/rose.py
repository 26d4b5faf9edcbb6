"""A turn in polar coordinates, before and after, as SVG: what is seen of hard and soft iron at a glance.

The first axis of the plane points up and the second one to the right, as on a compass rose with x ahead and y to the
right. Rings are lengths of the field.

>>> ring_step(38.0), ring_step(0.7), ring_step(4100.0)
(10.0, 0.2, 1000.0)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.units import label
from flinders.errors import figures
from flinders.report.fit_pages import evenness, is_mean
from flinders.report.formatting import degrees

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import PlaneEllipse, Turn

WIDE, HIGH, RADIUS = 800, 524, 152
LEFT, RIGHT, MIDDLE = 206.0, 594.0, 288.0
"""Centres of the two roses."""

SHOWN: Final = 720
"""Points that are drawn; more would be a smear."""

OUTLINE: Final = 120
"""Corners of an ellipse."""

STYLE: Final = """\
svg { max-width: 100%; height: auto; font-family: system-ui, sans-serif; font-size: 14px }
.paper { fill: #ffffff } text { fill: #18181b } .title { font-size: 17px; font-weight: 600 }
.faint { fill: #5b5b66 } .small { font-size: 12px } .grid { stroke: #e4e4e7; fill: none } .edge { stroke: #b5b5be }
.curve { stroke: #1d4ed8; stroke-width: 1.5; fill: none } .axis { stroke: #1d4ed8; stroke-dasharray: 5 4 }
.iron { stroke: #c2410c; stroke-width: 2.5 } .head { fill: #c2410c }
.dot { fill: #1d4ed8; stroke: #ffffff } .refused { fill: #b91c1c; font-size: 17px; font-weight: 700 }
.true { stroke: #8b8b95; stroke-width: 1.5; stroke-dasharray: 2 4; stroke-linecap: round; fill: none }
@media (prefers-color-scheme: dark) {
.paper { fill: #18181b } text { fill: #f4f4f5 } .faint { fill: #a8a8b3 } .grid { stroke: #36363c }
.edge { stroke: #5f5f68 } .curve, .axis { stroke: #7cb0ff } .dot { fill: #7cb0ff; stroke: #18181b }
.iron { stroke: #ff9d57 } .head { fill: #ff9d57 } .true { stroke: #85858f } .refused { fill: #f87171 }
}"""
"""Light or dark as the reader's screen is."""


def drawing(turn: Turn, fit: Fit) -> str:
    """Draw a turn before and after the correction of a fit; of a refused one it says so, and gives no number of it."""
    loaded = turn.recipe if is_mean(fit) else turn.ellipse
    points = turn.points[:: max(1, -(-len(turn.points) // SHOWN))]
    unit = label(fit.calibration.unit)
    title = f"Turn in the plane {turn.plane}: {turn.spacing.points:,} points"
    inside = "\n".join(
        [
            f'<text class="title" x="24" y="34">{title}</text>',
            f'<text class="faint" x="24" y="56">{_subtitle(turn, fit)}</text>',
            *_refused(fit),
            *_rose(LEFT, points, loaded, turn.plane, unit, is_raw=True),
            *_words(LEFT, "before", _before(loaded, fit, unit)),
            *_rose(RIGHT, loaded.correct(points), loaded, turn.plane, unit, is_raw=False),
            *_words(RIGHT, "after", _after(loaded, fit, unit)),
        ]
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" width="{WIDE}" height="{HIGH}" '
        f'role="img">\n<title>{title}, before and after correction</title>\n<style>\n{STYLE}\n</style>\n'
        f'<rect class="paper" width="{WIDE}" height="{HIGH}"/>\n{inside}\n</svg>\n'
    )


def ring_step(largest: float) -> float:
    """Length from ring to ring: 1, 2 or 5 times a power of ten, so that three to seven of them hold a length."""
    power = 10.0 ** math.floor(math.log10(largest / 2.0))
    return next((step * power for step in (0.5, 1.0, 2.0, 5.0) if largest / (step * power) <= 5.0), 5.0 * power)


def _subtitle(turn: Turn, fit: Fit) -> str:
    return f"method {fit.method}; {evenness(turn, fit.target_deg, is_mean=is_mean(fit))}"


def _refused(fit: Fit) -> Iterator[str]:
    """Say of a refused fit that it is one, where nobody can miss it."""
    if fit.verdict == "refused":
        yield f'<text class="refused" x="{WIDE - 24}" y="34" text-anchor="end">REFUSED: not fit for use</text>'


def _before(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    if fit.verdict == "refused":
        return "the ellipse that this method makes of the points", "nothing of it is to be used"
    x, y = loaded.centre
    raw = fit.uncorrected_heading_error_deg
    return (
        f"offset {_signed(float(x))}, {_signed(float(y))} {unit}; axis ratio {loaded.ratio:.3f}",
        f"heading off by up to {degrees(raw.worst)}",
    )


def _signed(value: float) -> str:
    return figures(value, 3).replace("-", "−")


def _after(loaded: PlaneEllipse, fit: Fit, unit: str) -> tuple[str, str]:
    if fit.verdict == "refused":
        return f"heading off by up to {degrees(fit.heading_error_deg.worst)} (1 σ, worst)", "not to be used"
    return (
        f"circle of {figures(loaded.radius, 4)} {unit}, points {figures(fit.noise)} {unit} off (1 σ)",
        f"heading good to {degrees(fit.heading_error_deg.worst)} (1 σ, worst)",
    )


def _words(x: float, title: str, lines: tuple[str, str]) -> Iterator[str]:
    yield f'<text class="title" x="{x:.0f}" y="98" text-anchor="middle">{title}</text>'
    for place, line in enumerate(lines):
        yield f'<text class="faint" x="{x:.0f}" y="{484 + 20 * place}" text-anchor="middle">{line}</text>'


def _rose(x: float, points: Floats, loaded: PlaneEllipse, plane: str, unit: str, *, is_raw: bool) -> Iterator[str]:
    """Rings, spokes, the ellipse or the circle, and the points."""
    outline = loaded.centre + _circle() @ loaded.shape if is_raw else loaded.radius * _circle()
    largest = float(np.linalg.norm(np.concatenate([points, outline]), axis=1).max())
    step = ring_step(largest)
    rings = math.ceil(largest / step)
    scale = RADIUS / (rings * step)
    yield from _grid(x, rings, step, plane, unit)
    if is_raw:
        yield f'<polygon class="curve" points="{_path(outline, x, scale)}"/>'
        yield from _long_axis(loaded, x, scale)
    else:
        yield f'<polygon class="true" points="{_path(outline, x, scale)}"/>'
    size = 4.0 if len(points) <= 72 else 2.5
    for place in _places(points, x, scale):
        yield f'<circle class="dot" cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="{size:g}"/>'
    if is_raw:
        yield from _arrow(loaded, x, scale)


def _grid(x: float, rings: int, step: float, plane: str, unit: str) -> Iterator[str]:
    """Rings with their lengths, a spoke every 30°, and the names of the axes."""
    for ring in range(1, rings + 1):
        edge = " edge" if ring == rings else ""
        yield f'<circle class="grid{edge}" cx="{x:.1f}" cy="{MIDDLE:.1f}" r="{RADIUS * ring / rings:.1f}"/>'
    for spoke in range(0, 360, 30):
        along, up = RADIUS * math.sin(math.radians(spoke)), RADIUS * math.cos(math.radians(spoke))
        yield f'<line class="grid" x1="{x:.1f}" y1="{MIDDLE:.1f}" x2="{x + along:.1f}" y2="{MIDDLE - up:.1f}"/>'
    first, second = plane[0], plane[1]
    for name, dx, dy in ((f"+{first}", 0, -RADIUS - 8), (f"−{first}", 0, RADIUS + 18)):
        yield f'<text x="{x + dx:.0f}" y="{MIDDLE + dy:.0f}" text-anchor="middle">{name}</text>'
    for name, dx, anchor in ((f"+{second}", RADIUS + 8, "start"), (f"−{second}", -RADIUS - 8, "end")):
        yield f'<text x="{x + dx:.0f}" y="{MIDDLE + 5:.0f}" text-anchor="{anchor}">{name}</text>'
    for ring in range(1, rings + 1):
        out = RADIUS * ring / rings * math.sqrt(0.5)
        length = f"{ring * step:g} {unit}" if ring == rings else f"{ring * step:g}"
        yield f'<text class="faint small" x="{x + out + 4:.0f}" y="{MIDDLE + out + 12:.0f}">{length}</text>'


def _long_axis(loaded: PlaneEllipse, x: float, scale: float) -> Iterator[str]:
    """The dominant direction, through the centre."""
    angle = math.radians(loaded.direction_deg)
    along = loaded.semi_axes[0] * np.array([math.cos(angle), math.sin(angle)])
    (x1, y1), (x2, y2) = _places(np.array([loaded.centre - along, loaded.centre + along]), x, scale)
    yield f'<line class="axis" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _arrow(loaded: PlaneEllipse, x: float, scale: float) -> Iterator[str]:
    """Hard iron: from zero to the centre."""
    ((x2, y2),) = _places(loaded.centre[np.newaxis], x, scale)
    length = math.hypot(x2 - x, y2 - MIDDLE)
    if length > 12.0:
        dx, dy = (x2 - x) / length, (y2 - MIDDLE) / length
        yield f'<line class="iron" x1="{x:.1f}" y1="{MIDDLE:.1f}" x2="{x2 - 8 * dx:.1f}" y2="{y2 - 8 * dy:.1f}"/>'
        corners = [(0.0, 0.0), (-11.0, 5.0), (-11.0, -5.0)]
        head = " ".join(f"{x2 + a * dx - b * dy:.1f},{y2 + a * dy + b * dx:.1f}" for a, b in corners)
        yield f'<polygon class="head" points="{head}"/>'


def _circle() -> Floats:
    angle = np.arange(OUTLINE) * (2.0 * np.pi / OUTLINE)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _path(points: Floats, x: float, scale: float) -> str:
    return " ".join(f"{across:.1f},{down:.1f}" for across, down in _places(points, x, scale))


def _places(points: Floats, x: float, scale: float) -> list[tuple[float, float]]:
    """Where points are drawn: the first axis up, the second to the right."""
    return [(x + scale * second, MIDDLE - scale * first) for first, second in points.tolist()]
