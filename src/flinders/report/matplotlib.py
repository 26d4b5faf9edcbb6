"""Panels of figures on axes of matplotlib, in print colours.

>>> from matplotlib.figure import Figure
>>> from flinders.report.charts import Axis, Panel
>>> axes = Figure().subplots()
>>> draw_panel(axes, Panel(Axis(0, 1), Axis(0, 1), lambda plot: [plot.level(0.5, "aim")], "seconds"))
>>> len(axes.lines), axes.get_xlabel()
(1, 'seconds')

No global state of matplotlib is changed: no pyplot, no style, no window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.report.charts import MAX_DOTS
from flinders.report.colours import ROLES, colour_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.report.charts import Panel

INK, RAW, CORRECTED, REJECT = (ROLES["light"][role] for role in ("ink", "raw", "corrected", "reject"))

STYLES: Final[dict[str, dict[str, Any]]] = {
    "outline before": {"color": INK, "lw": 1.1, "ls": "--"},
    "outline after": {"color": INK, "lw": 1.1},
    "curve raw": {"color": RAW, "lw": 1.8},
    "line": {"color": INK, "lw": 1.1},
    "aim": {"color": INK, "lw": 1.1, "ls": ":"},
}
"""Line styles by their class in the style sheet of the report."""


@dataclass(frozen=True, slots=True)
class AxesCanvas:
    """Axes of matplotlib with the methods of `flinders.report.charts.Plot`; the methods return no text."""

    axes: Axes

    def line(self, kind: str, x: ArrayLike, y: ArrayLike, *, is_closed: bool = False) -> str:
        """A line through points."""
        places = np.stack([x, y], axis=1)
        self.axes.plot(*np.append(places, places[:is_closed], axis=0).T, **STYLES[kind])
        return ""

    def area(self, kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> str:  # noqa: ARG002 - all alike
        """The area between two lines."""
        self.axes.fill_between(x, low, high, color=CORRECTED, alpha=0.2, lw=0)
        return ""

    def dots(self, kind: str, x: ArrayLike, y: ArrayLike, *, most: int = MAX_DOTS) -> str:  # noqa: ARG002 - all
        """Dots, all of them."""
        colour, alpha = RAW if kind.startswith("before") else CORRECTED, 0.2 if kind.endswith("far") else 0.55
        self.axes.scatter(x, y, s=3, lw=0, alpha=alpha, color=colour, rasterized=True)
        return ""

    def crosses(self, x: ArrayLike, y: ArrayLike) -> str:
        """Crosses, all of them."""
        if np.size(x):
            self.axes.scatter(x, y, s=16, marker="x", lw=1, color=REJECT)
        return ""

    def tiles(self, kind: str, rings: Sequence[Floats]) -> str:
        """Polygons of one class."""
        from matplotlib.collections import PolyCollection

        self.axes.add_collection(PolyCollection(rings, facecolors=colour_of(kind, "light"), edgecolors="white"))
        return ""

    def arm(self, x: float, y: float) -> str:
        """Hard iron as a line from zero to the centre of the readings, with a dot there."""
        self.axes.plot([0.0, x], [0.0, y], color=INK, lw=0.9, marker="o", ms=3, markevery=[1])
        return ""

    def bars(self, kind: str, edges: ArrayLike, counts: Iterable[float]) -> str:  # noqa: ARG002 - all alike
        """A bar for each class of a histogram."""
        self.axes.stairs(list(counts), edges, fill=True, color=CORRECTED, alpha=0.7)
        return ""

    def level(self, value: float, kind: str) -> str:
        """A horizontal line."""
        self.axes.axhline(value, **STYLES[kind])
        return ""


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw a panel: its marks, the ends of its axes, and its words."""
    panel.draw(AxesCanvas(axes))
    axes.set(xlim=(panel.x.low, panel.x.high), ylim=(panel.y.low, panel.y.high))
    axes.set(xlabel=panel.x_words, ylabel=panel.y_words, title=panel.title)
    for ticks, place in ((panel.x_ticks, axes.set_xticks), (panel.y_ticks, axes.set_yticks)):
        if ticks:
            place(*zip(*ticks, strict=True))
