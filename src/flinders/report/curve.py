"""A deviation curve as plain characters and as SVG, without a plotting library.

>>> from flinders.deviation import fit
>>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
>>> scale(swing)
25.0
>>> dotted(10.5, 25.0, 21, seen=10.0)
'          |   o      '
>>> drawing(swing).startswith("<svg"), drawing(swing).count("<circle")
(True, 8)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.angles import shown_heading

if TYPE_CHECKING:
    from flinders.deviation import Deviation

STEPS: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 60.0, 90.0, 180.0)
"""Degrees at the ends of the axis of deviation."""

WIDE, HIGH, LEFT, TOP, RIGHT, BELOW = 720, 400, 56, 28, 16, 48
"""Of the drawing and its margins, in its own units."""


def scale(deviation: Deviation) -> float:
    """Degrees at the ends of the axis: the least step beyond curve and observations."""
    largest = max(deviation.largest_deg, float(np.abs(deviation.observed_deg).max()))
    return next((step for step in STEPS if step >= largest), STEPS[-1])


def dotted(value: float, end: float, width: int, *, seen: float | None = None) -> str:
    """One line of a curve: ``|`` at zero, ``*`` at the value, ``o`` where it was seen.

    Parameters
    ----------
    value, seen : float, degrees
        West is left.
    end : float, degrees
        At the ends of the line.
    width : int
        Characters; odd, so that zero has one of its own.
    """
    middle = width // 2
    line = [" "] * width
    line[middle] = "|"
    for sign, angle in (("*", value), ("o", seen)):
        if angle is not None:
            line[round(middle + middle * max(-1.0, min(1.0, angle / end)))] = sign
    return "".join(line)


def drawing(deviation: Deviation) -> str:
    """The curve over the compass heading as SVG: a band of 1 σ, the curve, the observations."""
    end = scale(deviation)
    around = np.arange(0.0, 361.0, 2.0)
    curve = deviation.at(around)
    sigma = deviation.sigma_at(around)
    parts = [*_frame(end)]
    if sigma is not None:
        there = [_point(*pair, end) for pair in zip(around, curve + sigma, strict=True)]
        back = [_point(*pair, end) for pair in zip(around[::-1], (curve - sigma)[::-1], strict=True)]
        parts.append(f'<polygon points="{" ".join(there + back)}" fill="#2563eb" fill-opacity="0.18"/>')
    line = " ".join(_point(*pair, end) for pair in zip(around, curve, strict=True))
    parts.append(f'<polyline points="{line}" fill="none" stroke="#2563eb" stroke-width="2"/>')
    for heading, seen in zip(deviation.compass_deg, deviation.observed_deg, strict=True):
        x, y = _point(heading, seen, end).split(",")
        parts.append(f'<circle cx="{x}" cy="{y}" r="4" fill="#b91c1c"/>')
    inside = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" width="{WIDE}" height="{HIGH}" '
        f'role="img" font-family="sans-serif" font-size="12">\n<title>Deviation over compass heading</title>\n'
        f'<rect width="{WIDE}" height="{HIGH}" fill="#ffffff"/>\n{inside}\n</svg>\n'
    )


def _point(heading: float, value: float, end: float) -> str:
    x = LEFT + (WIDE - LEFT - RIGHT) * heading / 360.0
    y = TOP + (HIGH - TOP - BELOW) * (0.5 - 0.5 * max(-1.0, min(1.0, value / end)))
    return f"{x:.1f},{y:.1f}"


def _frame(end: float) -> list[str]:
    """Grid, numbers and names of the axes."""
    lines = []
    for heading in range(0, 361, 45):
        (x, bottom), (_, top) = (_point(heading, value, end).split(",") for value in (-end, end))
        lines.append(f'<line x1="{x}" y1="{top}" x2="{x}" y2="{bottom}" stroke="#d4d4d8"/>')
        shown = f"{heading:03d}°" if heading == 360 else shown_heading(heading, 0)
        lines.append(f'<text x="{x}" y="{HIGH - BELOW + 16}" text-anchor="middle">{shown}</text>')
    for value in (-end, -end / 2.0, 0.0, end / 2.0, end):
        (left, y), (right, _) = (_point(heading, value, end).split(",") for heading in (0.0, 360.0))
        stroke = "#52525b" if value == 0.0 else "#d4d4d8"
        lines.append(f'<line x1="{left}" y1="{y}" x2="{right}" y2="{y}" stroke="{stroke}"/>')
        side = "E" if value > 0.0 else "W" if value < 0.0 else ""
        shown = f"{abs(value):g}° {side}".rstrip()
        lines.append(f'<text x="{LEFT - 6}" y="{float(y) + 4:.1f}" text-anchor="end">{shown}</text>')
    lines.append(f'<text x="{LEFT}" y="16">deviation, magnetic less compass</text>')
    lines.append(
        f'<text x="{(LEFT + WIDE - RIGHT) / 2:.0f}" y="{HIGH - 10}" text-anchor="middle">heading by compass</text>'
    )
    return lines
