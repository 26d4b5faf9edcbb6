"""A turn in polar coordinates, before and after, as SVG: what is seen of hard and soft iron at a glance.

The first axis of the plane points up and the second one to the right, as on a compass card with x ahead and y to the
right. Rings are lengths of the field.

>>> ring_step(38.0), ring_step(0.7), ring_step(4100.0)
(10.0, 0.2, 1000.0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.units import label
from flinders.errors import figures
from flinders.report import charts
from flinders.report.charts import circle, segment, shape, text, thinned
from flinders.report.fit_pages import evenness, is_mean
from flinders.report.formatting import degrees, minus

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import PlaneEllipse, Turn

WIDE, HIGH, RADIUS = 800, 524, 152
LEFT, RIGHT, MIDDLE = 206.0, 594.0, 288.0
"""Centres of the two charts."""

SHOWN: Final = 720
"""Points that are drawn; more would be a smear."""

AROUND: Final = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
CIRCLE: Final = np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)


@dataclass(frozen=True, slots=True)
class PolarAxes:
    """Rings around a place of the drawing, and how large what they hold is."""

    x: float
    step: float
    rings: int

    @classmethod
    def around(cls, x: float, points: Floats) -> PolarAxes:
        """Rings that hold (n, 2) points."""
        largest = float(np.linalg.norm(points, axis=1).max())
        step = ring_step(largest)
        return cls(x, step, math.ceil(largest / step))

    def places(self, points: Floats) -> Floats:
        """(n, 2) places of (n, 2) points: the first axis up, the second to the right."""
        scale = RADIUS / (self.rings * self.step)
        return np.stack([self.x + scale * points[:, 1], MIDDLE - scale * points[:, 0]], axis=1)

    def grid(self, plane: str, unit: str) -> str:
        """Rings with their lengths, a spoke every 30°, and the names of the axes."""
        parts = []
        for ring in range(1, self.rings + 1):
            is_edge, radius = ring == self.rings, RADIUS * ring / self.rings
            out = 4.0 + radius * math.sqrt(0.5)
            words = f"{ring * self.step:g}{f' {unit}' * is_edge}"
            parts.append(circle("edge" if is_edge else "ring", self.x, MIDDLE, round(radius, 1)))
            parts.append(text(self.x + out, MIDDLE + out + 8, words, "start"))
        for turn in np.radians(range(0, 360, 30)).tolist():
            along, up = RADIUS * math.sin(turn), RADIUS * math.cos(turn)
            parts.append(segment("grid", self.x, MIDDLE, self.x + along, MIDDLE - up))
        return "".join(parts) + self._names(plane)

    def _names(self, plane: str) -> str:
        """Where the axes point."""
        first, second = plane[0], plane[1]
        return (
            text(self.x, MIDDLE - RADIUS - 8, f"+{first}", kind="name")
            + text(self.x, MIDDLE + RADIUS + 18, f"−{first}", kind="name")
            + text(self.x + RADIUS + 8, MIDDLE + 5, f"+{second}", "start", "name")
            + text(self.x - RADIUS - 8, MIDDLE + 5, f"−{second}", "end", "name")
        )


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


def _before(turn: Turn, loaded: PlaneEllipse, unit: str) -> str:
    """Points as recorded, the ellipse and its long axis, and the offset."""
    points, outline = thinned(turn.points, SHOWN), loaded.centre + CIRCLE @ loaded.shape
    polar = PolarAxes.around(LEFT, np.concatenate([points, outline]))
    angle = math.radians(loaded.direction_deg)
    along = loaded.semi_axes[0] * np.array([math.cos(angle), math.sin(angle)])
    ends = polar.places(np.array([loaded.centre - along, loaded.centre + along]))
    parts = [polar.grid(turn.plane, unit), shape("outline before", polar.places(outline), is_closed=True)]
    parts += [shape("aim", ends), _points("before", polar.places(points))]
    ((x, y),) = polar.places(loaded.centre[np.newaxis]).tolist()
    parts.append(segment("iron", polar.x, MIDDLE, x, y) + circle("iron-end", x, y, 3))
    return "".join(parts)


def _after(turn: Turn, loaded: PlaneEllipse, unit: str) -> str:
    """Points as corrected, and the circle that they should lie on."""
    points, outline = loaded.correct(thinned(turn.points, SHOWN)), loaded.radius * CIRCLE
    polar = PolarAxes.around(RIGHT, np.concatenate([points, outline]))
    edge = shape("outline after", polar.places(outline), is_closed=True)
    return polar.grid(turn.plane, unit) + edge + _points("after", polar.places(points))


def _points(kind: str, places: Floats) -> str:
    size = 4.0 if len(places) <= 72 else 2.5
    return "".join(circle(f"point {kind}", x, y, size) for x, y in places.tolist())


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
