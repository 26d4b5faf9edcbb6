"""Figures of a fit with matplotlib, for papers and notebooks: SVG, PNG or PDF, in print colours.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.report.figure_data import FigureData
>>> samples = simulate.tumble(seed=1, n=400).samples
>>> fit = calibrate.fit(samples)
>>> figure = figure_of(FigureData.of(fit, samples), fit, "projections")
>>> [len(axes.collections) > 0 for axes in figure.axes]
[True, True, True, True, True, True]

The parts: `projections`, the three scatter plots that every recipe shows, before and after; `deviation` over the
heading of a level vehicle; `residuals` over time and counted; `coverage`, readings and predicted error in all
directions. Nothing global of matplotlib is touched: no pyplot, no style, no window.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import MissingExtra, UsageError
from flinders.geometry.sphere import tiles
from flinders.report import figures as drawing
from flinders.report.colours import LEGEND, ROLES, SEEN, error_colour, seen_ends, seen_level

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import ModuleType

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.report.figure_data import FigureData

FORMATS: Final = ("svg", "png", "pdf")

INK, FAINT, LINE, RAW, CORRECTED, REJECT = (
    ROLES["light"][role] for role in ("ink", "faint", "line", "raw", "corrected", "reject")
)

WIDTH: Final = 10.0
"""Of a figure, in inches."""

HEIGHTS: Final = {"projections": 6.7, "deviation": 4.2, "residuals": 2.9, "coverage": 3.2}
"""Of each part."""

DOTS_PER_INCH: Final = 160

RC: Final = {
    "font.size": 9.0, "axes.edgecolor": LINE, "axes.labelcolor": FAINT, "axes.titlesize": 10.0,
    "xtick.color": FAINT, "ytick.color": FAINT, "axes.grid": True, "grid.color": LINE, "grid.linewidth": 0.7,
    "axes.axisbelow": True, "svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "flinders",
}  # fmt: skip


def figure_of(drawn: FigureData, fit: Fit, what: str = "all") -> Figure:
    """Draw a part, or all of them below each other.

    Parameters
    ----------
    drawn : FigureData
    fit : Fit
        Good or limited.
    what : str
        ``all`` or a key of `HEIGHTS`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtra
        Where matplotlib is not installed.
    UsageError
        For a part that there is not, or one of which nothing is known.
    """
    matplotlib = matplotlib_of()
    if what != "all" and what not in PARTS:
        raise UsageError(f"figure {what!r} is not known: use all or one of {', '.join(PARTS)}")
    names = [name for name in (PARTS if what == "all" else (what,)) if _is_known(drawn, name)]
    if not names:
        raise UsageError(f"nothing is known to draw {what} from: the calibration states no uncertainty")
    heights = [HEIGHTS[name] for name in names]
    with matplotlib.rc_context(RC):
        from matplotlib import figure as drawable

        figure = drawable.Figure(figsize=(WIDTH, sum(heights)), layout="constrained")
        parts = figure.subfigures(len(names), 1, height_ratios=heights, squeeze=False)[:, 0]
        for name, part in zip(names, parts, strict=True):
            PARTS[name](part, drawn, fit)
    return figure


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """The bytes of a file; the same figure gives the same bytes.

    Raises
    ------
    UsageError
        For a format that is none of `FORMATS`.
    """
    if kind not in FORMATS:
        raise UsageError(f"{kind!r} is no format of a figure: use a name that ends in {', '.join(FORMATS)}")
    undated = {"svg": {"Date": None}, "png": {}, "pdf": {"CreationDate": None}}[kind]
    content = io.BytesIO()
    with matplotlib_of().rc_context(RC):
        figure.savefig(content, format=kind, dpi=DOTS_PER_INCH, metadata=undated)
    return content.getvalue()


def matplotlib_of() -> ModuleType:
    """matplotlib, where it is installed.

    Raises
    ------
    MissingExtra
        Where it is not; says what to install.
    """
    try:
        import matplotlib as found
    except ImportError:
        raise MissingExtra("matplotlib", "plot", "drawing figures") from None
    return found


def _is_known(drawn: FigureData, name: str) -> bool:
    return drawn.view is not None and (name != "deviation" or drawn.view.turn is not None)


def _projections(part: SubFigure, drawn: FigureData, _: Fit) -> None:
    """xy, xz and yz, before with the outline of the ellipsoid, after with the circle."""
    grid = part.subplots(2, 3)
    for row, is_corrected in zip(grid, (False, True), strict=True):
        points, low, high = drawing.extents(drawn, is_corrected=is_corrected)
        for axes, (i, j) in zip(row, drawing.PLANES, strict=True):
            used, out = points[drawn.is_used], points[~drawn.is_used]
            axes.scatter(
                used[:, i], used[:, j], s=3, lw=0, alpha=0.55, color=CORRECTED if is_corrected else RAW, rasterized=True
            )
            if len(out):
                axes.scatter(out[:, i], out[:, j], s=16, marker="x", lw=1, color=REJECT)
            outline = drawing.outline(drawn, (i, j), is_corrected=is_corrected)
            axes.plot(*np.append(outline, outline[:1], axis=0).T, color=INK, lw=1.1, ls="-" if is_corrected else "--")
            axes.axhline(0.0, color=FAINT, lw=0.6)
            axes.axvline(0.0, color=FAINT, lw=0.6)
            axes.set(xlim=(low[i], high[i]), ylim=(low[j], high[j]), aspect="equal")
            axes.set_xlabel(f"{'xyz'[i]}, {drawn.unit}")
            axes.set_ylabel(f"{'xyz'[j]}, {drawn.unit}")
        row[1].set_title("after correction" if is_corrected else "before correction", color=INK, weight="bold")


def _deviation(part: SubFigure, drawn: FigureData, fit: Fit) -> None:
    """What the raw compass is off over the heading, and 1 σ and 2 σ of the corrected one."""
    assert drawn.view is not None
    assert drawn.view.turn is not None
    turn = drawn.view.turn
    heading = np.append(turn.heading_deg, 360.0)
    before, sigma = (np.append(row, row[0]) for row in (turn.before_deg, turn.sigma_deg))
    before[1:][np.abs(np.diff(before)) > 180.0] = np.nan
    above, below = part.subplots(2, 1, sharex=True)
    above.plot(heading, before, color=RAW, lw=1.8)
    above.set_ylabel("before, °")
    above.set_title("deviation of a level vehicle", color=INK, weight="bold")
    for factor in (2.0, 1.0):
        below.fill_between(heading, -factor * sigma, factor * sigma, color=CORRECTED, alpha=0.2, lw=0)
    if fit.target_deg < 6.0 * 2.0 * float(sigma.max()):
        for sign in (1.0, -1.0):
            below.axhline(sign * fit.target_deg, color=INK, ls=":", lw=1.1)
    below.set_ylabel("after, ± 1 σ, ± 2 σ, °")
    below.set(xlim=(0.0, 360.0), xticks=np.arange(0.0, 361.0, 45.0), xlabel="heading, °")


def _residuals(part: SubFigure, drawn: FigureData, fit: Fit) -> None:
    """How much longer corrected readings are than the field."""
    assert drawn.view is not None
    over, counted = part.subplots(1, 2, width_ratios=(3, 1), sharey=True)
    off, used = drawn.residuals, drawn.is_used
    end = drawing.SIGMAS * fit.noise if fit.noise > 0.0 else float(np.abs(off).max(initial=1e-9))
    over.axhspan(-2.0 * fit.noise, 2.0 * fit.noise, color=CORRECTED, alpha=0.12, lw=0)
    over.scatter(drawn.when[used], off[used].clip(-end, end), s=2, lw=0, color=CORRECTED, rasterized=True)
    if not used.all():
        over.scatter(drawn.when[~used], off[~used].clip(-end, end), s=16, marker="x", lw=1, color=REJECT)
    over.set_title("residuals", color=INK, weight="bold")
    over.set(xlabel="seconds" if drawn.clock == "s" else "number of the reading", ylabel=drawn.unit, ylim=(-end, end))
    if drawn.view.residuals is not None:
        edges, counts = drawn.view.residuals.edges, drawn.view.residuals.counts
        counted.stairs(counts, edges, orientation="horizontal", fill=True, color=CORRECTED, alpha=0.7)
    counted.set_xlabel("readings")


def _coverage(part: SubFigure, drawn: FigureData, fit: Fit) -> None:
    """Readings and predicted error in all directions: two hemispheres each, in a projection that keeps areas."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Circle

    view = drawn.view
    assert view is not None
    ends = seen_ends(sum(view.tiles_seen) / len(view.tiles_seen))
    colours = {
        "predicted error": [error_colour(error, fit.target_deg, "light") for error in view.tiles_deg],
        "readings": [SEEN["light"][seen_level(count, ends)] for count in view.tiles_seen],
    }
    grid = part.subplots(2, 4, height_ratios=(12, 1))
    rings = tiles().polygons()
    for place, (title, tints) in enumerate(colours.items()):
        for side, up in enumerate((1.0, -1.0)):
            axes = grid[0][2 * place + side]
            which = np.flatnonzero(up * tiles().centres[:, 2] > -0.12)
            shapes = PolyCollection(
                [_flat(rings[tile], up) for tile in which], facecolors=[tints[tile] for tile in which],
                edgecolors="white", linewidths=0.4,
            )  # fmt: skip
            axes.add_collection(shapes)
            shapes.set_clip_path(Circle((0.0, 0.0), np.sqrt(2.0), transform=axes.transData))
            axes.set(xlim=(-1.6, 1.6), ylim=(-1.6, 1.6), aspect="equal")
            axes.set_axis_off()
            axes.set_title(f"{title}, {'+z' if up > 0.0 else '−z'}", color=INK, fontsize=9)
            for sign in (1.0, -1.0):
                axes.text(
                    1.55 * sign, 0.0, f"{'+' if sign > 0 else '−'}x", color=FAINT, fontsize=7, ha="center", va="center"
                )
        _legend(grid[1][2 * place : 2 * place + 2], title, fit.target_deg, ends)


def _legend(pair: Sequence[Axes], title: str, target_deg: float, ends: tuple[int, int, int]) -> None:
    """Patches with words, over two places of the grid."""
    from matplotlib.patches import Patch

    if title == "readings":
        words = ["none", f"to {ends[0]:,}", f"to {ends[1]:,}", f"to {ends[2]:,}", "more"]
        tints = list(SEEN["light"])
    else:
        words = [f"{ratio * target_deg:.3g}°" for ratio in LEGEND]
        tints = [error_colour(ratio * target_deg, target_deg, "light") for ratio in LEGEND]
    for axes in pair:
        axes.set_axis_off()
    patches = [Patch(color=tint, label=word) for tint, word in zip(tints, words, strict=True)]
    pair[0].legend(handles=patches, loc="upper left", ncols=len(patches), frameon=False, fontsize=7.5, labelcolor=FAINT,
                   columnspacing=1.0, handlelength=0.9)  # fmt: skip


def _flat(ring: Floats, up: float) -> Floats:
    """Lambert's azimuthal projection of unit vectors, of radius √2 for a hemisphere."""
    x, y, z = ring.T
    scale = np.sqrt(2.0 / (1.0 + up * z).clip(min=0.05))
    return np.stack([scale * x, up * scale * y], axis=1)


PARTS: Final[dict[str, Callable[[SubFigure, FigureData, Fit], None]]] = {
    "projections": _projections,
    "deviation": _deviation,
    "residuals": _residuals,
    "coverage": _coverage,
}
"""By name, in the order in which they are drawn."""
