"""A deviation curve over the compass heading as SVG: a band of 1 σ, the curve, what was observed and how far off it is.

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
from flinders.report import charts
from flinders.report.charts import COMPASS_POINTS, Axis, Plot, segment, text
from flinders.report.formatting import minus

if TYPE_CHECKING:
    from flinders.heading.deviation import Deviation

GRID: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0)
"""Degrees between the lines of the drawing."""
LINES: Final = 4
"""Lines above zero, at most, and as many below."""

WIDE, HIGH = 720, 468

NARROW: Final = """\
.figure .curve { stroke-width: 2.5 }
@media (max-width: 520px) { .figure text, .figure .title { font-size: 21px } .figure .between { display: none } }
"""
"""On a narrow screen letters are larger and every second number is left out."""


def drawing(deviation: Deviation) -> str:
    """Draw a curve and what it was fitted to."""
    around = np.arange(0.0, 361.0, 2.0)
    curve, sigma = deviation.at(around), deviation.sigma_at(around)
    spread = 0.0 if sigma is None else float(sigma.max())
    largest = 1.04 * (float(np.abs([*curve, *deviation.observed_deg]).max()) + spread)
    step = next((step for step in GRID if LINES * step >= min(largest, 180.0)), GRID[-1])
    count = max(math.ceil(min(largest, 180.0) / step), 1)
    plot = Plot(92, 84, WIDE - 120, HIGH - 182, Axis(0.0, 360.0), Axis(-step * count, step * count))
    inside = ["" if sigma is None else plot.area("band", around, curve - sigma, curve + sigma)]
    inside += [plot.line("curve corrected", around, curve), _observed(deviation, plot)]
    edge = charts.rectangle("", plot.left - 8, plot.top, plot.width + 16, plot.height)
    parts = [*_head(deviation), _frame(plot, step, count), charts.clipped("inside", edge, *inside)]
    return charts.drawing(WIDE, HIGH, "Deviation over compass heading", *parts, style=NARROW)


def _observed(deviation: Deviation, plot: Plot) -> str:
    """What was observed, each joined to the curve."""
    rows = zip(deviation.compass_deg, deviation.observed_deg, deviation.residual_deg, strict=True)
    return "".join(
        segment("residual", plot.x(heading), plot.y(observed - residual), plot.x(heading), plot.y(observed))
        + charts.circle("observed", plot.x(heading), plot.y(observed), 5)
        for heading, observed, residual in rows
    )


def _head(deviation: Deviation) -> list[str]:
    """What is drawn, in which colour, and its coefficients."""
    pairs = zip(NAMES, deviation.coefficients_deg, strict=True)
    shown = "\N{EM SPACE}".join(minus(f"{name} {value + 0.0:+.2f}°") for name, value in pairs)
    words = "curve" if deviation.covariance is None else "curve ± 1 σ"
    return [
        text(24, 30, "Deviation, magnetic less compass", "start", "title"),
        text(24, 58, shown, "start"),
        charts.key(WIDE - 28, 30, ("raw", "seen"), ("corrected", words)),
    ]


def _frame(plot: Plot, step: float, count: int) -> str:
    """Grid, numbers and names of the axes."""
    parts = []
    for place, name in enumerate(COMPASS_POINTS):
        shown, kind = "360°" if place == 8 else shown_heading(45.0 * place, 0), "between" if place % 2 else ""
        x = plot.x(45.0 * place)
        parts.append(plot.upright(45.0 * place, "grid"))
        parts.append(text(x, plot.bottom + 24, shown, kind=kind) + text(x, plot.bottom + 50, name, kind=kind))
    for line in range(-count, count + 1):
        side = " E" if line > 0 else " W" if line < 0 else ""
        shown, kind = f"{abs(line) * step:.4g}°{side}", "between" if line % 2 else ""
        y = plot.y(line * step)
        parts.append(plot.level(line * step, "grid" if line else "zero"))
        parts.append(text(plot.left - 12, y + 5, shown, "end", kind))
    return "".join(parts) + text(plot.middle, HIGH - 16, "heading by compass")
