"""How an estimate settles while readings come in: as a drawing (SVG) and as a table (CSV).

>>> from flinders.estimators import Readings
>>> from flinders.estimators.reference.sequential import Sequential
>>> from flinders.simulate import tumble
>>> settling = Sequential().converge(Readings.of(tumble(seed=1, n=400).samples), steps=8)
>>> settled = Settling(settling, "sequential", unit="uT")
>>> drawing(settled).startswith("<svg"), len(table(settled).splitlines())
(True, 9)
>>> table(settled).splitlines()[0][:60]
'readings,heading_off_deg,offset_x_uT,offset_y_uT,offset_z_uT'
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.units import label
from flinders.errors import counted
from flinders.heading.error_propagation import level_gradients
from flinders.report.formatting import with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators import Convergence

PARAMETERS: Final = (
    "offset_x", "offset_y", "offset_z",
    "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz",
)  # fmt: skip
"""What each parameter is called, in their order."""

WIDE, LEFT, RIGHT, BELOW = 560, 58, 12, 46
"""Of the drawing and its margins, in its own units: letters are 13 of them, and so can be read on a telephone."""

PLOT, LINE, GAP = 128, 18, 20
"""Heights of a plot, of a line of letters, and between two plots."""

BEGINNING: Final = 2
"""The scale of a plot is that of all but one step in so many, the first ones: they are far off, and run out of it."""

LEAST_DEG, MOST_DEG = 0.01, 100.0
"""Ends of the axis of headings, in degrees; a decade is left out where nothing is in it."""

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#7a5195", "#a06a00", "#c0398c")
"""Of six lines on white: apart also for those who do not see red from green (Okabe and Ito), and for a printer."""

ON_BLACK: Final = ("#56b4e9", "#ff9a56", "#3ccf9f", "#b9a0f0", "#e0b84c", "#f28cc6")

STYLE: Final = """<style>
@media (prefers-color-scheme: dark) {{
.ground {{ fill: #18181b }} text {{ fill: #e4e4e7; stroke: #18181b }} .quiet {{ fill: #a1a1aa }}
.grid {{ stroke: #3f3f46 }} .zero {{ stroke: #a1a1aa }} .heading {{ stroke: #e4e4e7 }}
{lines}
}}
</style>"""


@dataclass(frozen=True, eq=False)
class Settling:
    """A convergence with what is needed to show it.

    The last value is that of the last step with an ellipsoid: a method that loses its way has none at the end.

    Attributes
    ----------
    steps : Convergence
        With an ellipsoid at one step at the least.
    method : str
    unit : str
        ``uT`` or ``counts``.
    dip_deg : float
    target_deg : float
    """

    steps: Convergence
    method: str
    unit: str
    dip_deg: float = 60.0
    target_deg: float = 1.0

    @cached_property
    def off(self) -> Floats:
        """(K, 9) how far each parameter is off its last value."""
        off: Floats = self.steps.parameters - self.steps.parameters[self.last]
        return off

    @cached_property
    def last(self) -> int:
        """The last step that has an ellipsoid; of none, the last of all."""
        return len(self.steps) - 1 if self.steps.last is None else self.steps.last

    @cached_property
    def heading_off_deg(self) -> Floats:
        """(K,) how far the worst level heading is off the last one, to first order; at most 180."""
        known = self.steps.is_known
        gradients = level_gradients(self.steps.ellipsoid(self.last), dip_deg=self.dip_deg)
        found: Floats = np.full(len(self.steps), np.nan)
        found[known] = np.minimum(np.rad2deg(np.abs(self.off[known] @ gradients.T).max(axis=1, initial=0.0)), 180.0)
        return found


def table(settling: Settling) -> str:
    """A line for each step: readings seen, how far the heading is off the last, parameters and their 1 σ.

    What is not known yet is left empty.
    """
    steps = settling.steps
    columns = [f"{name}_{settling.unit}" for name in PARAMETERS]
    header = ["readings", "heading_off_deg", *columns, *(f"sigma_{name}" for name in columns)]
    numbers = np.concatenate([settling.heading_off_deg[:, np.newaxis], steps.parameters, steps.sigmas], axis=1)
    lines = [
        ",".join([str(count), *("" if math.isnan(number) else f"{number:.9g}" for number in row)])
        for count, row in zip(steps.counts.tolist(), numbers.tolist(), strict=True)
    ]
    return "\n".join([",".join(header), *lines]) + "\n"


def drawing(settling: Settling) -> str:
    """Three plots over the readings seen, as SVG for light and dark pages: offset, shape, heading."""
    unit = label(settling.unit)
    parts = [_text(LEFT, 20, _title(settling), weight="bold", size=15)]
    top = 20.0 + GAP
    for title, first, last in (("offset", 0, 3), ("shape", 3, 9)):
        drawn, top = _parameters(settling, f"{title}, {unit}: off its last value, ± 1 σ", range(first, last), top)
        parts += drawn
    drawn, top = _headings(settling, top)
    parts += drawn
    high = top - GAP + BELOW
    parts.append(_text((LEFT + WIDE - RIGHT) / 2, high - 8, "readings seen (square-root scale)", anchor="middle"))
    lines = " ".join(
        f".line{place} {{ stroke: {colour} }} .band{place} {{ fill: {colour} }}"
        for place, colour in enumerate(ON_BLACK)
    )
    inside = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {high:.0f}" width="{WIDE}" height="{high:.0f}" '
        f'style="max-width: 100%; height: auto" role="img" font-family="sans-serif" font-size="13" '
        'stroke-linejoin="round">\n'
        f"<title>How the estimate settles</title>\n{STYLE.format(lines=lines)}\n"
        f'<rect class="ground" width="{WIDE}" height="{high:.0f}" fill="#ffffff"/>\n{inside}\n</svg>\n'
    )


def _title(settling: Settling) -> str:
    counts = settling.steps.counts.tolist()
    title = f"How {settling.method} settles over {counted(counts[-1], 'reading')}"
    held = counts[settling.last]
    return title if held == counts[-1] else f"{title}: lost after {held:,}"


@dataclass(frozen=True, slots=True)
class _Frame:
    """Where a plot lies, and what its ends mean."""

    top: float
    low: float
    high: float
    readings: int

    def x(self, count: float) -> float:
        """Place of a number of readings: by its root, since most happens at the beginning."""
        return LEFT + (WIDE - LEFT - RIGHT) * math.sqrt(count / self.readings)

    def y(self, value: float) -> float:
        """Place of a value; what is far outside stays just outside."""
        share = (value - self.low) / (self.high - self.low)
        return self.top + PLOT * (1.0 - max(-1.0, min(2.0, share)))


def _parameters(settling: Settling, title: str, which: range, top: float) -> tuple[list[str], float]:
    """Draw some parameters off their last values, each with a band of 1 σ; and say where the next plot begins."""
    steps = settling.steps
    parts, below = _legend(settling, title, which, top)
    sizes = np.abs(settling.off[:, which]) + steps.sigmas[:, which]
    end = _scale(sizes[: settling.last + 1])
    frame = _Frame(below, -end, end, int(steps.counts[-1]))
    parts += _grid(frame, [(value, f"{value:+g}" if value else "0") for value in (-end, -end / 2, 0.0, end / 2, end)])
    parts += _clipped(frame, _bands(settling, which, frame))
    return parts, below + PLOT + GAP


def _bands(settling: Settling, which: range, frame: _Frame) -> Iterator[str]:
    """Bands first, then the lines, so that none is hidden."""
    counts, off, sigmas = settling.steps.counts, settling.off, settling.steps.sigmas
    for place, parameter in enumerate(which):
        for run in _runs(settling):
            value, sigma = off[run, parameter], sigmas[run, parameter]
            there = _points(frame, counts[run], value + sigma)
            back = _points(frame, counts[run][::-1], (value - sigma)[::-1])
            yield (
                f'<polygon class="band{place}" points="{there} {back}" fill="{COLOURS[place]}" '
                f'fill-opacity="{0.2 if len(which) == 3 else 0.1}"/>'
            )
    for place, parameter in enumerate(which):
        dashes = ' stroke-dasharray="5 3"' if place > 2 else ""
        for run in _runs(settling):
            points = _points(frame, counts[run], off[run, parameter])
            yield (
                f'<polyline class="line{place}" points="{points}" fill="none" stroke="{COLOURS[place]}" '
                f'stroke-width="1.8" stroke-linejoin="round"{dashes}/>'
            )


def _headings(settling: Settling, top: float) -> tuple[list[str], float]:
    """Draw how far the worst level heading is off the last, by decades, with the target."""
    known = settling.heading_off_deg[np.isfinite(settling.heading_off_deg)]
    told = known[known > 0.0]
    decades = range(round(math.log10(LEAST_DEG)), round(math.log10(MOST_DEG)) + 1)
    least, most = (float(told.min()), float(told.max())) if len(told) else (0.1, 1.0)
    low = max([decade for decade in decades if 10.0**decade <= least] or [decades[0]])
    high = min([decade for decade in decades if 10.0**decade >= most and decade > low] or [decades[-1]])
    parts = [_text(LEFT, top + LINE - 5, "worst level heading: off that of the last", weight="bold")]
    frame = _Frame(top + LINE, low, high, int(settling.steps.counts[-1]))
    parts += _grid(frame, [(decade, f"{10.0**decade:g}°") for decade in range(low, high + 1)])
    target = math.log10(settling.target_deg)
    if low < target < high:
        y = frame.y(target)
        parts.append(_line(LEFT, y, WIDE - RIGHT, y, "zero", "#52525b", ' stroke-dasharray="2 3"'))
        parts.append(_text(WIDE - RIGHT - 4, y - 4, f"target {settling.target_deg:g}°", anchor="end", quiet=True))
    lines = []
    for run in _runs(settling):
        off = settling.heading_off_deg[run]
        points = _points(frame, settling.steps.counts[run], np.log10(np.maximum(off, 1e-9)))
        lines.append(f'<polyline class="heading" points="{points}" fill="none" stroke="#18181b" stroke-width="1.8"/>')
    parts += _clipped(frame, iter(lines))
    for count in sorted({round(frame.readings * (share / 4) ** 2) for share in range(5)}):
        anchor = "start" if count == 0 else "end" if count == frame.readings else "middle"
        parts.append(_text(frame.x(count), frame.top + PLOT + 16, f"{count:,}", anchor=anchor))
    return parts, frame.top + PLOT + GAP


def _runs(settling: Settling) -> list[slice]:
    """Steps in a row that have an ellipsoid."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], settling.steps.is_known, [False]]).astype(int)))
    return [slice(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]


def _scale(sizes: Floats) -> float:
    """A round number that nearly all (K, m) sizes stay below, but those of the first steps; 1 where all are zero."""
    later = sizes[len(sizes) // BEGINNING :]
    later = later[np.isfinite(later)]
    largest = float(later.max()) if len(later) else 0.0
    if not largest > 0.0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(step * decade for step in (1.0, 2.0, 4.0, 10.0) if step * decade >= largest)


def _legend(settling: Settling, title: str, which: range, top: float) -> tuple[list[str], float]:
    """A title, and below it the name, last value and uncertainty of each line; and where the plot begins."""
    parts = [_text(LEFT, top + LINE - 5, title, weight="bold")]
    last, sigma = settling.steps.parameters[settling.last], settling.steps.sigmas[settling.last]
    for place, parameter in enumerate(which):
        x = LEFT + (WIDE - LEFT - RIGHT) / 3 * (place % 3)
        y = top + LINE * (2 + place // 3) - 5
        dashes = ' stroke-dasharray="5 3"' if place > 2 else ""
        parts.append(_line(x, y - 4, x + 18, y - 4, f"line{place}", COLOURS[place], f' stroke-width="2.4"{dashes}'))
        name = PARAMETERS[parameter].partition("_")[2]
        value = with_uncertainty(float(last[parameter]), float(sigma[parameter]))
        parts.append(_text(x + 24, y, f"{name} {value}".replace("-", "−"), size=12))
    return parts, top + LINE * (2 + (len(which) - 1) // 3)


def _grid(frame: _Frame, ticks: list[tuple[float, str]]) -> list[str]:
    """Lines across with their numbers."""
    parts = []
    for value, shown in ticks:
        y = frame.y(value)
        is_zero = shown == "0"
        parts.append(
            _line(LEFT, y, WIDE - RIGHT, y, "zero" if is_zero else "grid", "#71717a" if is_zero else "#e4e4e7")
        )
        parts.append(_text(LEFT - 6, y + 4, shown.replace("-", "−"), anchor="end"))
    return parts


def _points(frame: _Frame, counts: NDArray[np.int64], values: Floats) -> str:
    pairs = zip(counts.tolist(), values.tolist(), strict=True)
    return " ".join(f"{frame.x(count):.1f},{frame.y(value):.1f}" for count, value in pairs)


def _clipped(frame: _Frame, shapes: Iterator[str]) -> list[str]:
    """What runs out of a plot ends at its edge."""
    name = f"plot{frame.top:.0f}"
    wide = WIDE - LEFT - RIGHT
    box = f'<rect x="{LEFT}" y="{frame.top:.1f}" width="{wide}" height="{PLOT}"/>'
    return [f'<clipPath id="{name}">{box}</clipPath>', f'<g clip-path="url(#{name})">', *shapes, "</g>"]


def _line(x1: float, y1: float, x2: float, y2: float, kind: str, colour: str, more: str = "") -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}"{more}/>'


def _text(
    x: float, y: float, text: str, *, anchor: str = "start", weight: str = "", size: int = 0, quiet: bool = False
) -> str:
    kind = ' class="quiet" fill="#52525b"' if quiet else ' fill="#18181b"'
    bold = f' font-weight="{weight}"' if weight else ""
    large = f' font-size="{size}"' if size else ""
    place = f' text-anchor="{anchor}"' if anchor != "start" else ""
    halo = ' stroke="#ffffff" stroke-width="3" paint-order="stroke"' if quiet else ' stroke-width="0"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{kind}{bold}{large}{place}{halo}>{text}</text>'
