"""SVG drawing of a deviation curve over the compass heading, with its band of 1 σ and the observations.

>>> from flinders.apps.marine.deviation import fit
>>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
>>> swing_drawing(swing).startswith("<svg"), swing_drawing(swing).count("<circle")
(True, 8)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.marine.deviation import NAMES
from flinders.report.charts import (
    Axis,
    Panel,
    Plot,
    circle,
    clip_shapes,
    compass_ticks,
    drawing,
    key,
    rectangle,
    segment,
    text,
)
from flinders.report.formatting import minus

if TYPE_CHECKING:
    from flinders.apps.marine.deviation import Deviation
    from flinders.report.charts import Canvas

GRID: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0)
"""Possible distances of the lines of the drawing, in degrees."""
MAX_LINES: Final = 4
"""Largest number of lines above zero; there are as many below."""
NARROW_STYLE: Final = """\
.figure .curve { stroke-width: 2.5 }
@media (max-width: 520px) { .figure text, .figure .title { font-size: 21px } .figure .between { display: none } }
"""
"""Style for a narrow screen: larger letters, and every second number hidden."""


def swing_drawing(deviation: Deviation) -> str:
    """Drawing of a deviation curve and the observations it was fitted to."""
    around = np.arange(0.0, 361.0, 2.0)
    curve, sigma = deviation.at(around), deviation.sigma_at(around)
    spread = 0.0 if sigma is None else float(sigma.max())
    largest = min(1.04 * (float(np.abs([*curve, *deviation.observed_deg]).max()) + spread), 180.0)
    step = next((step for step in GRID if MAX_LINES * step >= largest), GRID[-1])
    count = max(math.ceil(largest / step), 1)

    def draw(canvas: Canvas) -> list[str]:
        band = "" if sigma is None else canvas.area("band", around, curve - sigma, curve + sigma)
        return [band, canvas.line("curve corrected", around, curve)]

    numbers = [(line * step, _east_or_west(line * step)) for line in range(-count, count + 1)]
    panel = Panel(Axis(0.0, 360.0), Axis(-step * count, step * count), draw, x_ticks=compass_ticks(), y_ticks=numbers)
    plot = panel.at(92, 84, 576, 300)
    edge = rectangle("", plot.left - 8, plot.top, plot.width + 16, plot.height)
    pairs = zip(NAMES, (deviation.coefficients_deg.round(2) + 0.0).tolist(), strict=True)  # no −0.00
    return drawing(
        720,
        452,
        "Deviation over compass heading",
        text(24, 30, "Deviation, magnetic less compass", "start", "title"),
        text(24, 58, "\N{EM SPACE}".join(minus(f"{name} {value:+.2f}°") for name, value in pairs), "start"),
        key(696, 30, ("raw", "seen"), ("corrected", "curve" if sigma is None else "curve ± 1 σ")),
        panel.grid(plot, gap=24),
        clip_shapes("inside", edge, *panel.draw(plot), _observations(deviation, plot)),
        text(plot.middle, 436, "heading by compass"),
        style=NARROW_STYLE,
    )


def _east_or_west(deviation_deg: float) -> str:
    """Deviation in degrees, east or west."""
    side = " E" if deviation_deg > 0.0 else " W" if deviation_deg < 0.0 else ""
    return f"{abs(deviation_deg):.4g}°{side}"


def _observations(deviation: Deviation, plot: Plot) -> str:
    """SVG of the observations, each joined to the curve by a line."""
    rows = zip(deviation.compass_deg, deviation.observed_deg, deviation.residual_deg, strict=True)
    return "".join(
        segment("residual", plot.x(heading), plot.y(observed - residual), plot.x(heading), plot.y(observed))
        + circle("observed", plot.x(heading), plot.y(observed), 5)
        for heading, observed, residual in rows
    )
