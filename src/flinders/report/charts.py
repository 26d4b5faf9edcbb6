"""Elements of all charts in SVG: panels with axes, numbers, lines, areas, dots, bars and words.

A `Panel` is marks over two axes. It is drawn on a `Plot`, which converts numbers to positions and gives SVG, or on axes
of matplotlib (`flinders.report.matplotlib`). Round charts and maps are made of shapes only.

A chart is text: shapes with classes. Their colours in light, in dark and on paper are in ``static/figure.css``. Inside
a page a chart has the colours of the page; as a separate file it contains the rules that it uses, for both themes.

>>> plot = Plot(40, 10, 200, 100, Axis(0, 10), Axis(1, 100, np.log10))
>>> plot.places([0, 5], [1, 10]).tolist()
[[40.0, 110.0], [140.0, 60.0]]
>>> plot.line("curve", [0, 5], [1, 10])
'<path class="curve" d="M40.0 110.0L140.0 60.0"/>'
>>> ticks(-3.2, 7.9, 6), dot_path([(1.0, 2.0), (1.1, 2.1), (4.0, 2.0)])
([-2.0, 0.0, 2.0, 4.0, 6.0], 'm2 4h0m6 0h0')
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from flinders.report.colours import colour_of
from flinders.report.formatting import minus
from flinders.report.modules import asset

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.report.colours import Theme

    Ticks = Sequence[tuple[float, str]]
    """Positions on an axis, each with its label."""

MAX_DOTS: Final = 3_000
"""Largest number of dots of one kind in a plot. More dots would merge, and enlarge the file."""
MAX_CROSSES: Final = 500
COMPASS_POINTS: Final = ("N", "NE", "E", "SE", "S", "SW", "W", "NW", "N")

FONT: Final = ".figure { max-width: 100%; height: auto; font-family: system-ui, sans-serif }"
FILE_STYLE: Final = f"""\
{FONT}
.figure text {{ font-size: 14px }} .figure .small {{ font-size: 12px }} .figure .title {{ font-size: 17px }}"""


# -------------------------------------------------------------------------------------------------------------- plots


@dataclass(frozen=True, slots=True)
class Axis:
    """Ends of an axis, and the function that scales its numbers, such as a logarithm."""

    low: float
    high: float
    scale: Callable[[ArrayLike], Floats] = np.asarray

    def share(self, values: ArrayLike) -> Floats:
        """Positions of numbers along the axis, from 0 to 1."""
        low, high = (float(self.scale(end)) for end in (self.low, self.high))
        share: Floats = (np.asarray(self.scale(values), float) - low) / (high - low)
        return share


@dataclass(frozen=True, slots=True)
class Plot:
    """A rectangle of a chart with one axis to the right and one upwards."""

    left: float
    top: float
    width: float
    height: float
    across: Axis
    up: Axis

    @property
    def right(self) -> float:
        """Right edge of the rectangle in the drawing."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Bottom edge of the rectangle in the drawing."""
        return self.top + self.height

    @property
    def middle(self) -> float:
        """Horizontal centre of the rectangle in the drawing."""
        return self.left + self.width / 2.0

    def x(self, value: float) -> float:
        """Horizontal position in the drawing for a number."""
        return self.left + self.width * float(self.across.share(value))

    def y(self, value: float) -> float:
        """Vertical position in the drawing for a number."""
        return self.bottom - self.height * float(self.up.share(value))

    def places(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(n, 2) positions in the drawing for pairs of numbers."""
        return np.stack(
            [self.left + self.width * self.across.share(x), self.bottom - self.height * self.up.share(y)], axis=1
        )

    def inside(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(m, 2) positions of those pairs of numbers that are inside the rectangle."""
        places = self.places(x, y)
        near, far = np.array([self.left, self.top]) - 1e-6, np.array([self.right, self.bottom]) + 1e-6
        inside: Floats = places[((places >= near) & (places <= far)).all(axis=1)]
        return inside

    def line(self, kind: str, x: ArrayLike, y: ArrayLike, *, is_closed: bool = False) -> str:
        """A line through points."""
        return shape(kind, self.places(x, y), is_closed=is_closed)

    def area(self, kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> str:
        """The area between two lines."""
        there, back = self.places(x, high), self.places(x, low)[::-1]
        return shape(kind, np.concatenate([there, back]), is_closed=True)

    def dots(self, kind: str, x: ArrayLike, y: ArrayLike, *, most: int = MAX_DOTS) -> str:
        """Dots inside the rectangle; only every k-th if there are more than `most`."""
        return dots(kind, thin_out(self.inside(x, y), most))

    def crosses(self, x: ArrayLike, y: ArrayLike) -> str:
        """Crosses inside the rectangle; only every k-th if there are too many."""
        places = thin_out(self.inside(x, y), MAX_CROSSES).tolist()
        marks = "".join(f"M{x - 3:.1f} {y - 3:.1f}l6 6m0-6l-6 6" for x, y in places)
        return f'<path class="reject" d="{marks}"/>' if marks else ""

    def tiles(self, kind: str, rings: Sequence[Floats]) -> str:
        """Polygons of one class as a single path."""
        outlines = (outline_of(self.places(*ring.T), is_closed=True) for ring in rings)
        return f'<path class="tile {kind}" d="{"".join(outlines)}"/>'

    def arm(self, x: float, y: float) -> str:
        """Hard iron as a line from zero to the centre of the readings, with a dot there."""
        end = self.x(x), self.y(y)
        return segment("iron", self.x(0.0), self.y(0.0), *end) + circle("iron-end", *end, 3)

    def bars(self, kind: str, edges: ArrayLike, counts: Iterable[float], *, least: float = 0.0) -> str:
        """A bar for each class with a count; each bar is at least `least` high."""
        sides, zero = self.places(edges, np.zeros(np.size(edges)))[:, 0].tolist(), f"{self.bottom:.1f}"
        parts = [
            f"M{first:.1f} {zero}V{min(self.y(count), self.bottom - least):.1f}H{last - 0.7:.1f}V{zero}Z"
            for first, last, count in zip(sides[:-1], sides[1:], counts, strict=True)
            if count
        ]
        return f'<path class="{kind}" d="{"".join(parts)}"/>' if parts else ""

    def level(self, value: float, kind: str) -> str:
        """A horizontal line at a number of the vertical axis."""
        return segment(kind, self.left, self.y(value), self.right, self.y(value))

    def upright(self, value: float, kind: str) -> str:
        """A vertical line at a number of the horizontal axis."""
        return segment(kind, self.x(value), self.top, self.x(value), self.bottom)

    def columns(self, numbers: Ticks, *, gap: float = 14.0) -> str:
        """Vertical lines with their numbers below; zero is highlighted unless it is at an end."""
        return "".join(
            self.upright(value, "zero" if value == 0.0 and self.across.share(value) > 0.02 else "grid")
            + text(self.x(value), self.bottom + gap, shown, kind=_tick_class(place, numbers))
            for place, (value, shown) in enumerate(numbers)
        )

    def rows(self, numbers: Ticks, *, gap: float = 14.0) -> str:
        """Horizontal lines with their numbers to the left; zero is highlighted."""
        return "".join(
            self.level(value, "grid" if value else "zero")
            + text(self.left - gap / 2.0, self.y(value) + 4, shown, "end", _tick_class(place, numbers))
            for place, (value, shown) in enumerate(numbers)
        )

    def outline(self, kind: str) -> str:
        """Outline of the rectangle."""
        return rectangle(kind, self.left, self.top, self.width, self.height)

    def clipped(self, name: str, *parts: str) -> str:
        """Shapes clipped at the edge of the rectangle."""
        return clip_shapes(name, self.outline(""), *parts)


class Canvas(Protocol):
    """Surface for marks: a `Plot` in SVG, or axes of matplotlib, whose methods return no text."""

    def line(self, kind: str, x: ArrayLike, y: ArrayLike, *, is_closed: bool = False) -> str: ...  # noqa: D102
    def area(self, kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> str: ...  # noqa: D102
    def dots(self, kind: str, x: ArrayLike, y: ArrayLike, *, most: int = MAX_DOTS) -> str: ...  # noqa: D102
    def crosses(self, x: ArrayLike, y: ArrayLike) -> str: ...  # noqa: D102
    def tiles(self, kind: str, rings: Sequence[Floats]) -> str: ...  # noqa: D102
    def arm(self, x: float, y: float) -> str: ...  # noqa: D102
    def bars(self, kind: str, edges: ArrayLike, counts: Iterable[float]) -> str: ...  # noqa: D102
    def level(self, value: float, kind: str) -> str: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Panel:
    """Marks over two axes, for SVG and for matplotlib."""

    x: Axis
    y: Axis
    draw: Callable[[Canvas], Iterable[str]]
    x_words: str = ""  # label of the axis
    y_words: str = ""
    title: str = ""  # shown above the panel
    kind: str = ""  # class of its colour
    x_ticks: Ticks = ()  # numbers with their labels; empty for round numbers
    y_ticks: Ticks = ()

    def at(self, left: float, top: float, width: float, height: float) -> Plot:
        """The plot of the panel in a drawing."""
        return Plot(left, top, width, height, self.x, self.y)

    def grid(self, plot: Plot, *, is_last: bool = True, gap: float = 14.0) -> str:
        """Frame, lines and numbers; of panels with a common axis, only the last has the numbers below."""
        across = self.x_ticks or round_ticks(self.x, 8 if plot.width > 2.0 * plot.height else 5)
        columns = plot.columns(across if is_last else [(value, "") for value, _ in across], gap=gap)
        return columns + plot.rows(self.y_ticks or round_ticks(self.y, 5), gap=gap) + plot.outline("frame")

    def frame_panel(self, plot: Plot, *, is_last: bool = True) -> str:
        """The panel in its plot: grid, marks and words."""
        return "".join(
            [
                self.grid(plot, is_last=is_last),
                *self.draw(plot),
                text(plot.left, plot.top - 9, self.title, "start", f"name {self.kind}".strip()),
                text(14, plot.top + plot.height / 2.0, self.y_words, is_turned=True),
                text(plot.middle, plot.bottom + 36, self.x_words if is_last else ""),
            ]
        )


def stack_panels(title: str, panels: Sequence[Panel], *, wide: float, high: float, left: float = 58.0) -> str:
    """A chart of panels, one below the other, with a common horizontal axis; each panel is `high` high."""
    top, parts = 10.0, []
    for panel in panels:
        top += 16.0 if panel.title else 0.0
        plot = panel.at(left, top, wide - left - 30.0, high)
        parts.append(panel.frame_panel(plot, is_last=panel is panels[-1]))
        top = plot.bottom + 16.0
    return chart(wide, plot.bottom + 42.0, title, *parts)


def _tick_class(place: int, numbers: Ticks) -> str:
    """Class of every second number, counted from the middle; narrow charts hide these numbers."""
    return "between" if (place - len(numbers) // 2) % 2 else ""


def compass_ticks() -> list[tuple[float, str]]:
    """The eight points of the compass, with their degrees."""
    return [(45.0 * place, f"{name} {45 * place:03d}°") for place, name in enumerate(COMPASS_POINTS)]


def round_ticks(axis: Axis, most: int, unit: str = "") -> list[tuple[float, str]]:
    """Round numbers of an axis with their labels, at most about `most`."""
    return label_numbers(ticks(axis.low, axis.high, most), unit=unit)


MIN_WIDTH: Final = 1e-11
"""Width of an axis below which it would show only rounding errors."""


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers from `low` to `high`, at most about `most`; just one if the ends differ only by rounding.

    >>> ticks(-1.0, 1.0, 5), ticks(-2e-13, 2e-13, 5)
    ([-1.0, -0.5, 0.0, 0.5, 1.0], [0.0])
    """
    width = high - low
    if not (width > MIN_WIDTH and math.isfinite(width)):
        return [round(low, 9) + 0.0]
    step = round_up(width / most, (1.0, 2.0, 5.0, 10.0))
    first = math.ceil(low / step - 1e-9)
    return [round(place * step, 12) + 0.0 for place in range(first, math.floor(high / step + 1e-9) + 1)]


def round_up(value: float, steps: Sequence[float] = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)) -> float:
    """The next larger number of a series of round numbers, which repeats in each decade.

    >>> round_up(0.13), round_up(340.0, (1.0, 2.0, 5.0, 10.0))
    (0.15, 500.0)
    """
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-300)))
    return next(step * decade for step in steps if step * decade >= value * (1.0 - 1e-9))


def nearest_round(value: float) -> float:
    """The number nearest to a value, by ratio, among 1, 2 and 5 times powers of ten.

    >>> nearest_round(62.0), nearest_round(250.0), nearest_round(0.8)
    (50.0, 200.0, 1.0)
    """
    decade = 10.0 ** math.floor(math.log10(value))
    return min((step * decade for step in (1.0, 2.0, 5.0, 10.0)), key=lambda step: abs(math.log(step / value)))


def label_numbers(values: Sequence[float], unit: str = "") -> list[tuple[float, str]]:
    """Labels of numbers with as many decimals as they need to differ; from 10,000 on, thousands are separated.

    >>> label_numbers([-0.5, 0.0, 0.5])
    [(-0.5, '−0.5'), (0.0, '0.0'), (0.5, '0.5')]
    """
    step = abs(values[1] - values[0]) if len(values) > 1 else abs(values[0]) or 1.0
    decimals = max(0, min(6, -math.floor(math.log10(step) + 1e-9)))
    mark = "," if max(map(abs, values)) >= 1e4 else ""
    return [(value, minus(f"{value:{mark}.{decimals}f}{unit}")) for value in values]


# ------------------------------------------------------------------------------------------------------------- shapes


def outline_of(places: Floats, *, is_closed: bool = False) -> str:
    """Attribute `d` of an SVG path through (n, 2) positions."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places.tolist()) + "Z" * is_closed


def shape(kind: str, places: Floats, *, is_closed: bool = False) -> str:
    """A line through (n, 2) positions; empty for no positions."""
    return f'<path class="{kind}" d="{outline_of(places, is_closed=is_closed)}"/>' if len(places) else ""


def segment(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    """A line between two positions."""
    return f'<path class="{kind}" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>'


def circle(kind: str, x: float, y: float, radius: float) -> str:
    """A circle; without a class it is a clip path."""
    return f'<circle{_class(kind)} cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>'


def rectangle(kind: str, left: float, top: float, width: float, height: float, more: str = "") -> str:
    """A rectangle; without a class it is a clip path."""
    return f'<rect{_class(kind)} x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}"{more}/>'


def text(x: float, y: float, words: str, anchor: str = "middle", kind: str = "", *, is_turned: bool = False) -> str:
    """Words at a position, escaped for SVG; empty for no words."""
    if not words:
        return ""
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if is_turned else ""
    return f'<text{_class(kind)} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turn}>{escape(words)}</text>'


def key(x: float, y: float, *entries: tuple[str, str]) -> str:
    """Words, each in the colour of the mark that they name; their right ends are aligned."""
    words = "\N{EM SPACE}".join(f'<tspan class="name {kind}">{escape(name)}</tspan>' for kind, name in entries)
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="end">{words}</text>'


def dot_path(places: ArrayLike) -> str:
    """Attribute `d` of an SVG path of dots in half units, a few characters each, without duplicates."""
    cells = np.unique(np.rint(2.0 * np.asarray(places, float).reshape(-1, 2)).astype(int)[:, ::-1], axis=0)
    steps = np.diff(cells, axis=0, prepend=0)
    return "".join(f"m{x}{'' if y < 0 else ' '}{y}h0" for y, x in steps.tolist())


def dots(kind: str, places: Floats) -> str:
    """Many small dots."""
    return f'<path class="dots {kind}" transform="scale(.5)" d="{dot_path(places)}"/>' if len(places) else ""


def thin_out(rows: Floats, most: int) -> Floats:
    """Every k-th row, so that at most `most` are left."""
    few: Floats = rows[:: max(1, -(-len(rows) // most))]
    return few


def clip_shapes(name: str, outline: str, *parts: str) -> str:
    """Shapes clipped at an outline; the name must be unique in a page."""
    return f'<clipPath id="{name}">{outline}</clipPath><g clip-path="url(#{name})">{"".join(parts)}</g>'


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""


# ----------------------------------------------------------------------------------------------------- whole drawings


def chart(width: float, height: float, title: str, *parts: str, more: str = "") -> str:
    """A chart for a page, which provides the colours."""
    return (
        f'<svg class="figure"{more} viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" '
        f'role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )


def row_of_charts(
    title: str,
    charts: Sequence[tuple[str, float, float]],
    *parts: str,
    gap: float = 20.0,
    top: float = 0.0,
    foot: float = 0.0,
) -> str:
    """A row of charts, each with its width and height, with `parts` at the `top` and at the `foot`."""
    high, left, placed = max(height for _, _, height in charts), 0.0, list(parts)
    for each, width, height in charts:
        placed.append(each.replace("<svg ", f'<svg x="{left:g}" y="{top + (high - height) / 2.0:g}" ', 1))
        left += width + gap
    return chart(left - gap, top + high + foot, title, *placed)


def as_file(chart: str, style: str = "") -> str:
    """A chart of a page as a separate file, light or dark like the reader's screen.

    >>> as_file(chart(20, 10, "a box", rectangle("frame", 0, 0, 20, 10)))[:55]
    '<svg xmlns="http://www.w3.org/2000/svg" class="figure" '
    """
    head, _, shapes = chart.removeprefix("<svg ").partition(">")
    ground = '<rect class="ground" width="100%" height="100%"/>'
    rules = f"<style>{rules_for(ground + shapes)}\n{FONT}\n{style}</style>"
    return f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{rules}{ground}{shapes}'


def drawing(width: float, height: float, title: str, *parts: str, style: str = "") -> str:
    """A chart as a separate file, light or dark like the reader's screen, with one shape per line."""
    shapes = [rectangle("ground", 0, 0, width, height), *parts]
    rules = f"<style>\n{rules_for(''.join(shapes))}\n{FILE_STYLE}\n{style}</style>"
    whole = chart(width, height, title, rules, *shapes, more=' xmlns="http://www.w3.org/2000/svg"')
    return whole.replace("><", ">\n<") + "\n"


def rules_for(shapes: str) -> str:
    """The rules of ``figure.css`` that apply to shapes, with the colours of the light theme, then of the dark theme.

    Colours are literal, since not every SVG program supports variables.
    """
    kinds = {kind for kinds in re.findall(r'class="([^"]*)"', shapes) for kind in kinds.split()}
    sheet = asset("static/figure.css").splitlines()
    rules = [line for line in sheet if line.startswith(".figure") and _is_used(line, kinds)]
    dark = "\n".join(_with_colours(rule, "dark") for rule in rules if "var(" in rule)
    light = "\n".join(_with_colours(rule, "light") for rule in rules)
    return f"{light}\n@media (prefers-color-scheme: dark) {{\n{dark}\n}}"


def _is_used(rule: str, kinds: set[str]) -> bool:
    """Whether all classes in one of a rule's selectors occur among the given classes."""
    selectors = rule.partition("{")[0].split(",")
    return any(set(re.findall(r"\.([\w-]+)", one)) - {"figure"} <= kinds for one in selectors)


def _with_colours(rule: str, theme: Theme) -> str:
    return re.sub(r"var\(--([\w-]+)\)", lambda match: colour_of(match[1], theme), rule)
