"""A deviation curve as SVG, without a plotting library.

>>> from flinders.heading.deviation import fit
>>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
>>> drawing(swing).startswith("<svg"), drawing(swing).count("<circle")
(True, 8)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.angles import shown_heading
from flinders.heading.deviation import NAMES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.heading.deviation import Deviation

GRID: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0)
"""Degrees between the lines of the drawing."""
LINES: Final = 4
"""Lines above zero, at most, and as many below."""

WIDE, HIGH, LEFT, TOP, RIGHT, BELOW = 720, 468, 92, 84, 28, 98
"""Of the drawing and its margins, in its own units."""

POINTS: Final = ("N", "NE", "E", "SE", "S", "SW", "W", "NW", "N")

STYLE: Final = """\
svg { max-width: 100%; height: auto; font-family: system-ui, sans-serif; font-size: 14px }
.paper { fill: #ffffff } text { fill: #18181b } .title { font-size: 17px; font-weight: 600 } .faint { fill: #5b5b66 }
.grid { stroke: #e4e4e7 } .zero { stroke: #8b8b95 } .curve { stroke: #1d4ed8; stroke-width: 2.5; fill: none }
.blue { fill: #1d4ed8 } .red { fill: #c2410c } .band { fill-opacity: 0.16 } .off { stroke: #c2410c; stroke-width: 1.5 }
circle { stroke: #ffffff; stroke-width: 1.5 }
@media (max-width: 520px) { svg { font-size: 21px } .title { font-size: 21px } .between { display: none } }
@media (prefers-color-scheme: dark) {
.paper { fill: #18181b } text { fill: #f4f4f5 } .faint { fill: #a8a8b3 } .grid { stroke: #36363c }
.zero { stroke: #85858f } .curve { stroke: #7cb0ff } .blue { fill: #7cb0ff } .red { fill: #ff9d57 }
.band { fill-opacity: 0.22 } .off { stroke: #ff9d57 } circle { stroke: #18181b }
}"""
"""Light or dark as the reader's screen is; on a narrow one letters are larger and every second number is left out."""


def drawing(deviation: Deviation) -> str:
    """The curve over the compass heading as SVG: a band of 1 σ, the curve, what was observed and how far off it is."""
    around = np.arange(0.0, 361.0, 2.0)
    curve, sigma = deviation.at(around), deviation.sigma_at(around)
    step, count = _grid(np.concatenate([curve, deviation.observed_deg]), sigma)
    end = step * count
    parts = [*_head(deviation), *_frame(step, count), '<g clip-path="url(#inside)">']
    if sigma is not None:
        edges = [*zip(around, curve + sigma, strict=True), *zip(around[::-1], (curve - sigma)[::-1], strict=True)]
        parts.append(f'<polygon class="blue band" points="{_path(edges, end)}"/>')
    parts.append(f'<polyline class="curve" points="{_path(list(zip(around, curve, strict=True)), end)}"/>')
    parts += [*_observed(deviation, end), "</g>"]
    inside = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" width="{WIDE}" height="{HIGH}" '
        f'role="img">\n<title>Deviation over compass heading</title>\n<style>\n{STYLE}\n</style>\n'
        f'<clipPath id="inside"><rect x="{LEFT - 8}" y="{TOP}" width="{WIDE - LEFT - RIGHT + 16}" '
        f'height="{HIGH - TOP - BELOW}"/></clipPath>\n'
        f'<rect class="paper" width="{WIDE}" height="{HIGH}"/>\n{inside}\n</svg>\n'
    )


def _grid(values: Floats, sigma: Floats | None) -> tuple[float, int]:
    """Degrees from line to line, and how many lines there are above zero, so that all that is drawn lies inside."""
    largest = min(1.04 * (float(np.abs(values).max()) + (0.0 if sigma is None else float(sigma.max()))), 180.0)
    step = next((step for step in GRID if LINES * step >= largest), GRID[-1])
    return step, max(math.ceil(largest / step), 1)


def _point(heading: float, value: float, end: float) -> tuple[float, float]:
    x = LEFT + (WIDE - LEFT - RIGHT) * heading / 360.0
    y = TOP + (HIGH - TOP - BELOW) * (0.5 - 0.5 * value / end)
    return x, y


def _path(pairs: list[tuple[float, float]], end: float) -> str:
    places = (_point(heading, value, end) for heading, value in pairs)
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def _observed(deviation: Deviation, end: float) -> Iterator[str]:
    """What was seen, each joined to the curve."""
    for heading, seen, residual in zip(
        deviation.compass_deg, deviation.observed_deg, deviation.residual_deg, strict=True
    ):
        (x, y), (_, on_curve) = _point(heading, seen, end), _point(heading, seen - residual, end)
        yield f'<line class="off" x1="{x:.1f}" y1="{on_curve:.1f}" x2="{x:.1f}" y2="{y:.1f}"/>'
        yield f'<circle class="red" cx="{x:.1f}" cy="{y:.1f}" r="5"/>'


def _head(deviation: Deviation) -> Iterator[str]:
    """What is drawn, in which colour, and its coefficients."""
    yield '<text class="title" x="24" y="30">Deviation, magnetic less compass</text>'
    pairs = zip(NAMES, deviation.coefficients_deg, strict=True)
    shown = "   ".join(f"{name} {value + 0.0:+.2f}°" for name, value in pairs).replace("-", "\N{MINUS SIGN}")
    yield f'<text class="faint" x="24" y="58" xml:space="preserve">{shown}</text>'
    words = "curve" if deviation.covariance is None else "curve ± 1 σ"
    yield (
        f'<text x="{WIDE - RIGHT}" y="30" text-anchor="end" xml:space="preserve"><tspan class="red">seen</tspan>   '
        f'<tspan class="blue">{words}</tspan></text>'
    )


def _frame(step: float, count: int) -> Iterator[str]:
    """Grid, numbers and names of the axes."""
    end = step * count
    for place, name in enumerate(POINTS):
        (x, bottom), (_, top) = _point(45.0 * place, -end, end), _point(45.0 * place, end, end)
        yield f'<line class="grid" x1="{x:.1f}" y1="{top:.1f}" x2="{x:.1f}" y2="{bottom:.1f}"/>'
        shown = "360°" if place == 8 else shown_heading(45.0 * place, 0)
        kind = ' class="between"' if place % 2 else ""
        yield f'<text{kind} x="{x:.1f}" y="{HIGH - BELOW + 24}" text-anchor="middle">{shown}</text>'
        kind = f"faint{' between' if place % 2 else ''}"
        yield f'<text class="{kind}" x="{x:.1f}" y="{HIGH - BELOW + 50}" text-anchor="middle">{name}</text>'
    for line in range(-count, count + 1):
        (left, y), (right, _) = _point(0.0, line * step, end), _point(360.0, line * step, end)
        kind = "zero" if line == 0 else "grid"
        yield f'<line class="{kind}" x1="{left:.1f}" y1="{y:.1f}" x2="{right:.1f}" y2="{y:.1f}"/>'
        side = " E" if line > 0 else " W" if line < 0 else ""
        kind = ' class="between"' if line % 2 else ""
        shown = f"{abs(line) * step:.4g}°{side}"
        yield f'<text{kind} x="{LEFT - 12}" y="{y:.1f}" dy="0.35em" text-anchor="end">{shown}</text>'
    middle = (LEFT + WIDE - RIGHT) / 2.0
    yield f'<text class="faint" x="{middle:.1f}" y="{HIGH - 16}" text-anchor="middle">heading by compass</text>'
