"""``fit.plot(recording)``: figures of a fit with matplotlib, for papers and notebooks, in print colours.

>>> import flinders
>>> samples = flinders.simulate.tumble(seed=1, n=400).samples
>>> figure = flinders.fit(samples).plot(samples, "projections")
>>> [len(axes.collections) > 0 for axes in figure.axes]
[True, True, True, True, True, True]

The parts: `projections`, the three scatter plots that every recipe shows, before and after; `deviation` over the
heading of a level vehicle; `residuals` over time and counted; `coverage`, readings and predicted error in all
directions. They are the panels of the report (`flinders.report.figures`) on axes of matplotlib. Nothing global of
matplotlib is touched: no pyplot, no style, no window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import UsageError
from flinders.fitting.export import refuse_unfit
from flinders.foreign_errors import needs
from flinders.report import figures as drawing
from flinders.report import maps
from flinders.report.charts import MOST_DOTS
from flinders.report.colours import ROLES, colour_of
from flinders.report.figure_data import FigureData
from flinders.workflows.restoring import restore

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.report.charts import Panel

INK, FAINT, LINE, RAW, CORRECTED, REJECT = (
    ROLES["light"][role] for role in ("ink", "faint", "line", "raw", "corrected", "reject")
)

WIDTH: Final = 10.0
"""Of a figure, in inches."""

DOTS_PER_INCH: Final = 160

RC: Final = {
    "font.size": 9.0, "axes.edgecolor": LINE, "axes.labelcolor": FAINT, "axes.titlesize": 10.0,
    "xtick.color": FAINT, "ytick.color": FAINT, "axes.grid": True, "grid.color": LINE, "grid.linewidth": 0.7,
    "axes.axisbelow": True,
}  # fmt: skip

LEGEND: Final[dict[str, Any]] = {
    "frameon": False, "fontsize": 7.5, "labelcolor": FAINT, "columnspacing": 1.0, "handlelength": 0.9,
}  # fmt: skip

STYLES: Final[dict[str, dict[str, Any]]] = {
    "outline before": {"color": INK, "lw": 1.1, "ls": "--"},
    "outline after": {"color": INK, "lw": 1.1},
    "curve raw": {"color": RAW, "lw": 1.8},
    "line": {"color": INK, "lw": 1.1},
    "aim": {"color": INK, "lw": 1.1, "ls": ":"},
}
"""How lines are drawn, by their class in the style sheet of the report."""


def plot(fit: Fit, recording: Recording, what: str = "all") -> Figure:
    """Draw a part of a fit and its recording, one of `PARTS`, or all of them below each other.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    NotExportable
        If the fit was refused.
    UsageError
        If the part does not exist, or the fit states nothing to draw it from.
    """
    matplotlib, drawable = (needs(name, "plot", "drawing figures") for name in ("matplotlib", "matplotlib.figure"))
    if what != "all" and what not in PARTS:
        raise UsageError(f"figure {what!r} is not known: use all or one of {', '.join(PARTS)}")
    refuse_unfit(fit)
    if fit.evidence.coverage.by_cell is None:  # as of a file, which keeps no readings
        fit = restore(recording, fit).fit
    drawn = FigureData.of(fit, recording)
    view = drawn.view
    known = [] if view is None else [name for name in PARTS if name != "deviation" or view.turn is not None]
    names = [name for name in known if what in ("all", name)]
    if not names:
        raise UsageError(f"nothing is known to draw {what} from: the calibration states no uncertainty")
    heights = [PARTS[name][0] for name in names]
    with matplotlib.rc_context(RC):
        figure: Figure = drawable.Figure(figsize=(WIDTH, sum(heights)), dpi=DOTS_PER_INCH, layout="constrained")
        parts = figure.subfigures(len(names), 1, height_ratios=heights, squeeze=False)[:, 0]
        for name, part in zip(names, parts, strict=True):
            PARTS[name][1](part, drawn, fit)
    return figure


@dataclass(frozen=True, slots=True)
class AxesCanvas:
    """Axes of matplotlib that marks are drawn on as on a `flinders.report.charts.Plot`; none of them is text."""

    axes: Axes

    def line(self, kind: str, x: ArrayLike, y: ArrayLike, *, is_closed: bool = False) -> str:
        """A line through numbers."""
        places = np.stack([x, y], axis=1)
        self.axes.plot(*np.append(places, places[:is_closed], axis=0).T, **STYLES[kind])
        return ""

    def area(self, kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike) -> str:  # noqa: ARG002 - all alike
        """What lies between two lines."""
        self.axes.fill_between(x, low, high, color=CORRECTED, alpha=0.2, lw=0)
        return ""

    def dots(self, kind: str, x: ArrayLike, y: ArrayLike, *, most: int = MOST_DOTS) -> str:  # noqa: ARG002 - all
        """Dots, all of them."""
        self.axes.scatter(x, y, s=3, lw=0, alpha=0.55, color=RAW if kind == "before" else CORRECTED, rasterized=True)
        return ""

    def crosses(self, x: ArrayLike, y: ArrayLike) -> str:
        """Crosses, all of them."""
        if np.size(x):
            self.axes.scatter(x, y, s=16, marker="x", lw=1, color=REJECT)
        return ""

    def tiles(self, kind: str, rings: Sequence[Floats]) -> str:
        """Polygons of one class inside a disc of radius √2."""
        from matplotlib.collections import PolyCollection
        from matplotlib.patches import Circle

        shapes = PolyCollection(rings, facecolors=colour_of(kind, "light"), edgecolors="white", linewidths=0.4)
        self.axes.add_collection(shapes)
        shapes.set_clip_path(Circle((0.0, 0.0), np.sqrt(2.0), transform=self.axes.transData))
        return ""

    def arm(self, x: float, y: float) -> str:
        """Hard iron: a line from zero to the centre, and a dot there."""
        self.axes.plot([0.0, x], [0.0, y], color=INK, lw=0.9, marker="o", ms=3, markevery=[1])
        return ""

    def bars(self, kind: str, edges: ArrayLike, counts: Iterable[float]) -> str:  # noqa: ARG002 - all alike
        """A bar for each class."""
        self.axes.stairs(list(counts), edges, fill=True, color=CORRECTED, alpha=0.7)
        return ""

    def level(self, value: float, kind: str) -> str:
        """A line across."""
        self.axes.axhline(value, **STYLES[kind])
        return ""


def _draw(axes: Axes, panel: Panel, title: str = "") -> None:
    """Draw a panel of the report."""
    panel.draw(AxesCanvas(axes))
    ends = {"xlim": (panel.x.low, panel.x.high), "ylim": (panel.y.low, panel.y.high)}
    axes.set(**ends, xlabel=panel.x_words, ylabel=panel.y_words)
    if panel.y_ticks:
        axes.set_yticks(*zip(*panel.y_ticks, strict=True))
    axes.set_title(title or panel.title, color=INK, weight="bold")


def _projections(part: SubFigure, drawn: FigureData, _: Fit) -> None:
    """xy, xz and yz, before with the outline of the ellipsoid, after with the circle."""
    grid = part.subplots(2, 3)
    for row, is_corrected in zip(grid, (False, True), strict=True):
        for axes, plane in zip(row, drawing.PLANES, strict=True):
            title = f"{'after' if is_corrected else 'before'} correction" if plane == drawing.PLANES[1] else ""
            _draw(axes, drawing.projection(drawn, plane, is_corrected=is_corrected), title)
            axes.set_aspect("equal")
            axes.axhline(0.0, color=FAINT, lw=0.6)
            axes.axvline(0.0, color=FAINT, lw=0.6)


def _deviation(part: SubFigure, drawn: FigureData, fit: Fit) -> None:
    """What the raw compass is off over the heading, and 1 σ and 2 σ of the corrected one."""
    assert drawn.view is not None
    both = part.subplots(2, 1, sharex=True)
    for axes, panel in zip(both, drawing.deviations(drawn.view, fit.claim.target_deg), strict=True):
        _draw(axes, panel)
        axes.set(xticks=np.arange(0.0, 361.0, 45.0), xlabel="")
    both[1].set_xlabel("heading of a level vehicle, °")


def _residuals(part: SubFigure, drawn: FigureData, _: Fit) -> None:
    """How much longer corrected readings are than the field, over time and counted."""
    assert drawn.view is not None
    over, counted = part.subplots(1, 2, width_ratios=(2, 1))
    _draw(over, drawing.residuals_over_time(drawn), "residuals")
    if drawn.view.residuals is not None:
        _draw(counted, drawing.residuals_counted(drawn.view, drawn.unit))


def _coverage(part: SubFigure, drawn: FigureData, fit: Fit) -> None:
    """Readings and predicted error in all directions: two hemispheres each, in a projection that keeps areas."""
    from matplotlib.patches import Patch

    view, target = drawn.view, fit.claim.target_deg
    assert view is not None
    drawn_maps = (
        ("predicted error", maps.error_classes(view, target), maps.error_legend(target), "left"),
        ("readings", maps.seen_classes(view), maps.seen_legend(view), "right"),
    )
    grid = part.subplots(1, 4).reshape(2, 2)
    for pair, (title, classes, legend, side) in zip(grid, drawn_maps, strict=True):
        for axes, up in zip(pair, (1.0, -1.0), strict=True):
            _draw(axes, maps.hemisphere_panel(classes, up))
            axes.set_title(f"{title}, {'+z' if up > 0.0 else '−z'}", color=INK, fontsize=9)
            axes.set(xlim=(-1.6, 1.6), ylim=(-1.6, 1.6), aspect="equal")
            axes.set_axis_off()
            for x, name in ((1.55, "+x"), (-1.55, "−x")):
                axes.text(x, 0.0, name, color=FAINT, fontsize=7, ha="center", va="center")
        patches = [Patch(color=colour_of(kind, "light"), label=words) for kind, words in legend]
        part.legend(handles=patches, ncols=len(patches), **LEGEND | {"loc": f"outside lower {side}"})


PARTS: Final[dict[str, tuple[float, Callable[[SubFigure, FigureData, Fit], None]]]] = {
    "projections": (6.7, _projections),
    "deviation": (4.2, _deviation),
    "residuals": (2.9, _residuals),
    "coverage": (3.2, _coverage),
}
"""Height in inches and drawing of each part, in their order."""
