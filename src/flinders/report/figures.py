"""Figures of a calibration's report: readings before and after correction, sphere, residuals, deviation.

The figures contain only numbers and fixed words: no names of files or sensors.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.report.figure_data import FigureData
>>> samples = simulate.tumble(seed=1).samples
>>> drawn = FigureData.of(calibrate.fit(samples), samples)
>>> figure = ball(drawn.view, 1.0)
>>> 'class="figure"' in figure, "style=" in figure
(True, False)
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.sphere import tiles
from flinders.report.charts import (
    MAX_DOTS,
    Axis,
    Panel,
    Plot,
    chart,
    circle,
    clip_shapes,
    compass_ticks,
    label_numbers,
    rectangle,
    round_ticks,
    round_up,
    segment,
    stack_panels,
    text,
    thin_out,
)
from flinders.report.formatting import minus, with_unit
from flinders.report.maps import error_tiles, hatch_pattern

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.disturbance import Disturbance
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.report.charts import Canvas
    from flinders.report.figure_data import FigureData
    from flinders.report.view import View

AXES: Final = "xyz"
PLANES: Final = ((0, 1), (0, 2), (1, 2))
"""Axes of the sensor to the right and upwards, for each projection."""

SIDE, EDGE = 260, 34
"""Side of a square figure, and its margin below; the left margin is larger for long numbers."""
DIGIT_WIDTH: Final = 7.0
"""Width of a digit next to an axis."""
WIDTH: Final = 820
MAX_OFFSET_RATIO: Final = 4.0
"""Longest offset, relative to the field strength, for which the origin is shown."""

AZIMUTH, ELEVATION = math.radians(32.0), math.radians(20.0)
"""Initial viewpoint of the 3-D view in rad, as in ``static/views/camera.js``."""

PREDICTED_TITLE: Final = "Predicted error"
"""Title of the sphere of directions with predicted errors."""

MAX_SIGMAS: Final = 4.5
"""Range of residuals in standard deviations; larger residuals are drawn at the edge."""

PARAMETERS: Final = ("bx", "by", "bz", "Sxx", "Syy", "Szz", "Sxy", "Sxz", "Syz")


# ------------------------------------------------------------------------------------------------------- projections


def projections(drawn: FigureData, *, is_corrected: bool) -> list[str]:
    """Readings seen along z, y and x: before correction with the fitted ellipse, after it with the circle."""
    name, figures = "after" if is_corrected else "before", []
    panels = [projection(drawn, plane, is_corrected=is_corrected) for plane in PLANES]
    edge = max(EDGE, *map(_width_of_numbers, panels))
    inner = SIDE - edge - 8
    for (i, j), panel in zip(PLANES, panels, strict=True):
        plot = panel.at(edge, 8, inner, inner)
        parts = (
            panel.grid(plot),
            text(plot.right - 6, plot.bottom - 6, panel.x_words, "end", "name halo"),
            text(plot.left + 6, plot.top + 14, AXES[j], "start", "name halo"),
            plot.clipped(f"clip-{name}-{i}{j}", *panel.draw(plot)),
        )
        figures.append(chart(SIDE, plot.bottom + EDGE, f"Projection {AXES[i]}{AXES[j]} {name} correction", *parts))
    return figures


def _width_of_numbers(panel: Panel) -> float:
    """Width of the numbers next to the vertical axis of a panel."""
    return 10.0 + DIGIT_WIDTH * max((len(words) for _, words in round_ticks(panel.y, 5)), default=0)


def projection(drawn: FigureData, plane: tuple[int, int], *, is_corrected: bool) -> Panel:
    """Readings seen along one axis, with the outline of the ellipsoid or sphere."""
    (i, j), name, shown = plane, "after" if is_corrected else "before", drawn.shown
    points, low, high = extents(drawn, is_corrected=is_corrected)
    used, out = points[drawn.is_used], points[~drawn.is_used]
    edge = outline(drawn, plane, is_corrected=is_corrected)

    def draw(plot: Canvas) -> list[str]:
        marks = [plot.dots(name, used[:, i], used[:, j]), plot.crosses(out[:, i], out[:, j])]
        marks.append(plot.line(f"outline {name}", *edge.T, is_closed=True))
        return marks if is_corrected or shown is None else [*marks, plot.arm(shown.offset[i], shown.offset[j])]

    across, up = (Axis(float(low[axis]), float(high[axis])) for axis in plane)
    return Panel(across, up, draw, f"{AXES[i]}, {drawn.unit}", f"{AXES[j]}, {drawn.unit}")


def extents(drawn: FigureData, *, is_corrected: bool) -> tuple[Floats, Floats, Floats]:
    """(n, 3) readings, and two opposite corners (3,) of a cube around them, which all projections share."""
    if is_corrected:
        strength = 1.0 if drawn.shown is None else drawn.shown.strength
        return drawn.corrected, np.full(3, -1.25 * strength), np.full(3, 1.25 * strength)
    low, high = _extent(drawn.raw[drawn.is_used] if drawn.is_used.any() else drawn.raw)
    shown, shape = drawn.shown, drawn.shape
    if shown is not None and shape is not None:
        offset, reach = np.array(shown.offset), np.linalg.norm(shape, axis=1)
        low, high = np.minimum(low, offset - reach), np.maximum(high, offset + reach)
        if np.linalg.norm(offset) <= MAX_OFFSET_RATIO * shown.strength:
            low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    half = max(0.54 * float((high - low).max()), 1e-9)
    middle = (low + high) / 2.0
    return drawn.raw, middle - half, middle + half


def _extent(points: Floats) -> tuple[Floats, Floats]:
    """Two opposite corners (3,) of a box around nearly all of (n, 3) points."""
    if not len(points):
        return np.full(3, -1.0), np.full(3, 1.0)
    low, high = np.quantile(points, [0.002, 0.998], axis=0)
    return low, high


def outline(drawn: FigureData, plane: tuple[int, int], *, is_corrected: bool) -> Floats:
    """(72, 2) outline of the ellipsoid, or of the sphere after correction, seen along the third axis.

    (0, 2) without a surface.
    """
    return _silhouette(drawn, np.eye(3)[list(plane)], is_corrected=is_corrected)


def _silhouette(drawn: FigureData, screen: Floats, *, is_corrected: bool) -> Floats:
    """(72, 2) outline on a screen; the rows of (2, 3) `screen` are right and up. (0, 2) without a surface."""
    shown, shape = drawn.shown, drawn.shape
    if shown is None or shape is None:
        return np.empty((0, 2))
    if is_corrected:
        return _shadow(shown.strength * screen)
    edge: Floats = screen @ np.array(shown.offset) + _shadow(screen @ shape)
    return edge


def _shadow(rows: Floats) -> Floats:
    """(72, 2) outline of A u over all unit vectors u, for A of (2, 3): the root of A Aᵀ maps the unit circle to it."""
    around = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    values, turns = np.linalg.eigh(rows @ rows.T)
    shadow: Floats = ((turns * np.sqrt(values)) @ np.stack([np.cos(around), np.sin(around)])).T
    return shadow


# ------------------------------------------------------------------------------------------------------------ sphere


def pictures(drawn: FigureData, target_deg: float) -> list[tuple[str, str]]:
    """Still images of the 3-D view for paper: readings before and after, and the predicted errors.

    Returns
    -------
    list of (str, str)
        Title and figure.
    """
    titled = [("Before", _cloud(drawn, is_corrected=False))]
    if drawn.view is not None and drawn.view.shown is not None:
        titled.append(("After", _cloud(drawn, is_corrected=True)))
        titled.append((PREDICTED_TITLE, ball(drawn.view, target_deg)))
    return titled


def _eye() -> Floats:
    """(3, 3) with rows to the right, up, and towards the viewpoint."""
    (ca, sa), (ce, se) = ((math.cos(angle), math.sin(angle)) for angle in (AZIMUTH, ELEVATION))
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def _cloud(drawn: FigureData, *, is_corrected: bool) -> str:
    """Readings from the viewpoint of the 3-D view, with the axes of the sensor."""
    panel, ends = cloud(drawn, is_corrected=is_corrected), _ends_of_axes(drawn, is_corrected=is_corrected)
    plot = panel.at(10, 10, SIDE - 20, SIDE - 20)
    name = "after" if is_corrected else "before"
    parts = [_triad(plot.places(*ends.T[:2])), *panel.draw(plot)]
    return chart(SIDE, SIDE, f"Readings {name} correction, in three dimensions", *parts)


def cloud(drawn: FigureData, *, is_corrected: bool) -> Panel:
    """Readings from the viewpoint, fainter behind the centre, with the outline of the ellipsoid or sphere."""
    eye, name, shown = _eye(), "after" if is_corrected else "before", drawn.shown
    readings, low, high = extents(drawn, is_corrected=is_corrected)
    points, out = thin_out(readings[drawn.is_used], MAX_DOTS) @ eye.T, readings[~drawn.is_used] @ eye.T
    edge, ends = _silhouette(drawn, eye[:2], is_corrected=is_corrected), _ends_of_axes(drawn, is_corrected=is_corrected)
    corners = np.concatenate([np.array(_extent(points)) if len(points) else ends, ends])[:, :2]
    centre = (low + high) / 2.0 if shown is None or is_corrected else np.array(shown.offset)
    is_far = points[:, 2] < centre @ eye[2]
    has_arm = not is_corrected and shown is not None and not np.clip(np.zeros(3), low, high).any()

    def draw(plot: Canvas) -> list[str]:
        return [
            plot.dots(f"{name} far", *points[is_far].T[:2]),
            plot.line(f"outline {name}", *edge.T, is_closed=True),
            plot.dots(name, *points[~is_far].T[:2]),
            plot.crosses(*out.T[:2]),
            plot.arm(*(eye @ np.array(shown.offset))[:2].tolist()) if has_arm and shown is not None else "",
        ]

    return Panel(*_around(np.concatenate([corners, edge])), draw)


def _ends_of_axes(drawn: FigureData, *, is_corrected: bool) -> Floats:
    """(4, 3): origin of the sensor's axes, then the ends of x, y and z; a distant origin is moved to the edge."""
    _, low, high = extents(drawn, is_corrected=is_corrected)
    origin = np.clip(np.zeros(3), low, high)
    length = float((high - low).max()) * (0.46 if is_corrected else 0.22)
    ends: Floats = np.concatenate([[origin], origin + length * np.eye(3)]) @ _eye().T
    return ends


def _around(points: Floats) -> tuple[Axis, Axis]:
    """Axes of a square around (n, 2) points."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.54 * float((high - low).max())
    across, up = (Axis(middle - half, middle + half) for middle in ((low + high) / 2.0).tolist())
    return across, up


def _triad(ends: Floats) -> str:
    """Axes with their names, from the first of four positions to each of the others."""
    (x0, y0), *tips = ends.tolist()
    parts = []
    for name, (x1, y1) in zip(AXES, tips, strict=True):
        away = 9.0 / max(math.hypot(x1 - x0, y1 - y0), 1.0)
        parts.append(segment("axis", x0, y0, x1, y1))
        parts.append(text(x1 + away * (x1 - x0), y1 + away * (y1 - y0) + 4, name, kind="name"))
    return "".join(parts)


def ball(view: View, target_deg: float) -> str:
    """The sphere of directions, coloured by predicted error, from the viewpoint."""
    eye, radius, middle = _eye(), (SIDE - 8) / 2.5, SIDE / 2.0
    plot = Plot(middle - radius, middle - radius, 2 * radius, 2 * radius, Axis(-1.0, 1.0), Axis(-1.0, 1.0))
    polygons = tiles().polygons()
    facing = np.flatnonzero(tiles().centres @ eye[2] > -0.08)
    rings = {tile: (polygons[tile] @ eye.T)[:, :2] for tile in facing.tolist()}
    rim = circle("", middle, middle, radius)
    parts = [
        hatch_pattern("hatch-ball"),
        clip_shapes("ball", rim, *error_tiles(plot, view, target_deg, rings, "hatch-ball")),
    ]
    for end in (sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)):
        if end @ eye[2] > 0.0:
            name = f"{'−' * bool(end.min() < 0.0)}{AXES[int(np.abs(end).argmax())]}"
            right, up = np.outer([1.0, 1.16, 1.26], eye[:2] @ end).T
            (x0, y0), (x1, y1), (x2, y2) = plot.places(right, up).tolist()
            parts.append(segment("axis", x0, y0, x1, y1) + text(x2, y2 + 4, name, kind="name halo"))
    if view.guidance is not None and view.guidance.direction is not None:
        right, up, near = eye @ np.array(view.guidance.direction)
        parts.append(circle("next behind" if near <= 0.0 else "next", plot.x(right), plot.y(up), 9))
    return chart(SIDE, SIDE, "Predicted heading error in each direction, on the sphere", *parts)


# --------------------------------------------------------------------------------------------------------- residuals


def residuals(drawn: FigureData) -> str:
    """Length of each corrected reading minus the field strength, over time; rejected readings are crosses."""
    return stack_panels("Residuals over time", [residuals_over_time(drawn)], wide=WIDTH, high=170.0)


def residuals_over_time(drawn: FigureData) -> Panel:
    """Residuals over time with a band of two standard deviations; rejected readings are crosses."""
    assert drawn.view is not None
    noise, when, is_used = drawn.view.noise or 0.0, drawn.when, drawn.is_used
    end = MAX_SIGMAS * noise if noise > 0.0 else float(np.abs(drawn.residuals).max(initial=0.0)) or 1.0
    span, words = _span(drawn)
    off, twice = drawn.residuals.clip(-end, end), min(2.0 * noise, end)

    def draw(plot: Canvas) -> list[str]:
        return [
            plot.area("band", span, [-twice] * 2, [twice] * 2) if noise > 0.0 else "",
            plot.dots("after", when[is_used], off[is_used], most=len(off)),
            plot.crosses(when[~is_used], off[~is_used]),
        ]

    return Panel(Axis(*span), Axis(-end, end), draw, words, drawn.unit)


def _span(drawn: FigureData) -> tuple[tuple[float, float], str]:
    """First and last position of the readings on the time axis, and its unit."""
    when, words = drawn.when, "seconds" if drawn.clock == "s" else "number of the reading"
    return ((float(when[0]), float(when[-1])) if len(when) > 1 and when[-1] > when[0] else (0.0, 1.0)), words


def strength_over_time(drawn: FigureData, limit: float | None) -> Panel:
    """Length of each corrected reading, with the field strength and a band for undisturbed readings."""
    assert drawn.shown is not None
    field, is_used = drawn.shown.strength, drawn.is_used
    lengths = field + drawn.residuals
    farthest = float(np.quantile(np.abs(drawn.residuals), 0.998)) if len(lengths) else 1.0
    reach = 1.15 * max(farthest, limit or 0.0, 1e-9)
    span, words = _span(drawn)

    def draw(plot: Canvas) -> list[str]:
        band = "" if limit is None else plot.area("band", span, [field - limit] * 2, [field + limit] * 2)
        marks = [
            plot.dots("after", drawn.when[is_used], lengths[is_used], most=len(lengths)),
            plot.crosses(drawn.when[~is_used], lengths[~is_used].clip(field - reach, field + reach)),
        ]
        return [band, *marks, plot.level(field, "aim")]

    return Panel(Axis(*span), Axis(field - reach, field + reach), draw, words, drawn.unit)


def histogram(view: View, unit: str) -> str:
    """Histogram of the residuals, with a normal distribution of equal count and standard deviation, as a chart."""
    return stack_panels(
        "Histogram of the residuals", [residual_histogram(view, unit)], wide=378.0, high=170.0, left=46.0
    )


def residual_histogram(view: View, unit: str) -> Panel:
    """Histogram of the residuals, with a normal distribution of equal count and standard deviation, as a panel."""
    assert view.residuals is not None
    edges, counts, noise = view.residuals.edges, view.residuals.counts, view.noise or 0.0
    middles = np.linspace(edges[0], edges[-1], 121)
    height = sum(counts) * (edges[1] - edges[0]) / (noise * math.sqrt(2.0 * math.pi)) if noise > 0.0 else 0.0
    bell = height * np.exp(-0.5 * (middles / (noise or 1.0)) ** 2)

    def draw(plot: Canvas) -> list[str]:
        return [plot.bars("bar", edges, counts), plot.line("line", middles, bell)]

    most = 1.08 * max(*counts, height, 1.0)
    return Panel(Axis(edges[0], edges[-1]), Axis(0.0, most), draw, f"longer than the field, {unit}")


def offset_over_time(walk: RandomWalk, unit: str, plane: Plane | None = None) -> str:
    """Offset along each axis over time minus that of the fit, with a band of one standard deviation.

    For readings in one plane, only the two axes in the plane.
    """
    axes = sorted(AXES.index(axis) for axis in plane or AXES)
    half = (walk.time[1] - walk.time[0]) / 2.0 if len(walk.time) > 1 else 0.5
    when = np.concatenate([walk.time[:1] - half, walk.time, walk.time[-1:] + half])
    path, sigma = (np.pad(rows[:, axes], ((1, 1), (0, 0)), mode="edge") for rows in (walk.path, walk.sigma))
    end = round_up(1.02 * float((np.abs(path) + sigma).max()))
    columns = zip(axes, path.T, sigma.T, strict=True)
    panels = [_strip(f"{AXES[axis]}, {unit}", when, value, one, end) for axis, value, one in columns]
    return stack_panels("Offset over time, less that of the fit", panels, wide=WIDTH, high=72.0)


def _strip(title: str, when: Floats, value: Floats, sigma: Floats, end: float) -> Panel:
    """Panel of one axis."""

    def draw(plot: Canvas) -> list[str]:
        return [plot.area("band", when, value - sigma, value + sigma), plot.line("curve corrected thin", when, value)]

    numbers = [(place, minus(f"{place:+.3g}") if place else "0") for place in (-end, 0.0, end)]
    across = Axis(float(when[0]), float(when[-1]))
    return Panel(across, Axis(-end, end), draw, "seconds", title=title, y_ticks=numbers)


def compensation_chart(drawn: FigureData, disturbance: Disturbance) -> str:
    """Length of corrected readings over a disturbance: with the effect of the disturbance, and without it."""
    assert drawn.shown is not None
    driving = drawn.driving[disturbance.name]
    is_shown = drawn.is_used & np.isfinite(driving)
    values, origin, strength = driving[is_shown], disturbance.reference, drawn.shown.strength
    before, after = (drawn.strengths(is_compensated=is_taken_off)[is_shown] for is_taken_off in (False, True))
    low, high = np.quantile([before, after], [0.002, 0.998]).tolist() if len(values) else (0.0, 1.0)
    margin = 0.06 * max(high - low, 1e-9)
    first, last = float(values.min(initial=origin)), float(values.max(initial=origin))

    def draw(plot: Canvas) -> list[str]:
        return [plot.dots("before", values, before), plot.dots("after", values, after), plot.level(strength, "aim")]

    across, up = Axis(first, max(last, first + 1e-9)), Axis(low - margin, high + margin)
    title = f"Strength of the corrected field over {disturbance.name}, before and after following it"
    return stack_panels(title, [Panel(across, up, draw, with_unit(disturbance), drawn.unit)], wide=WIDTH, high=190.0)


# --------------------------------------------------------------------------------------------------------- deviation


def deviation(view: View, target_deg: float, *, wide: float = WIDTH, high: float = 120.0) -> str:
    """Deviation over a level turn: of the raw compass, and 1 σ and 2 σ of the corrected compass, as a chart."""
    return stack_panels(
        "Deviation over the heading, before and after", deviations(view, target_deg), wide=wide, high=high
    )


def deviations(view: View, target_deg: float) -> tuple[Panel, Panel]:
    """Deviation over a level turn: of the raw compass, and the expected one of the corrected compass, as panels."""
    assert view.turn is not None
    heading = np.append(view.turn.heading_deg, 360.0)
    before, sigma = (np.append(row, row[0]) for row in (view.turn.before_deg, view.turn.sigma_deg))
    largest = round_up(1.06 * float(np.abs(before).max()))
    most = max(2.0 * float(sigma.max()), 1e-9)
    has_target = target_deg < 6.0 * most

    def draw_before(plot: Canvas) -> list[str]:
        return [plot.line("curve raw", heading[run], before[run]) for run in _runs(before)]

    def draw_after(plot: Canvas) -> list[str]:
        bands = [plot.area("band", heading, -factor * sigma, factor * sigma) for factor in (2.0, 1.0)]
        return bands + [plot.level(sign * target_deg, "aim") for sign in (1.0, -1.0) if has_target]

    target = f"; dotted: target {target_deg:g}°" if has_target else ""
    return (
        _turn(180.0 if largest > 150.0 else largest, draw_before, "before: the raw compass", "raw"),
        _turn(
            round_up(1.1 * max(most, target_deg if has_target else 0.0)),
            draw_after,
            f"after: expected, ± 1 σ and ± 2 σ{target}",
            "corrected",
        ),
    )


def _turn(end: float, draw: Callable[[Canvas], list[str]], title: str, kind: str) -> Panel:
    """A panel with the deviation over the heading."""
    up = Axis(-end, end)
    numbers = label_numbers([-180.0, -90.0, 0.0, 90.0, 180.0], "°") if end == 180.0 else round_ticks(up, 5, "°")
    words = "heading of a level vehicle"
    return Panel(Axis(0.0, 360.0), up, draw, words, title=title, kind=kind, x_ticks=compass_ticks(), y_ticks=numbers)


def _runs(angle: Floats) -> list[slice]:
    """Slices of consecutive angles, cut at jumps between −180° and 180°."""
    cuts = [0, *(np.flatnonzero(np.abs(np.diff(angle)) > 180.0) + 1).tolist(), len(angle)]
    return [slice(first, last) for first, last in itertools.pairwise(cuts)]


# ------------------------------------------------------------------------------------------------------- correlation


def correlation(fit: Fit) -> str:
    """Correlation of the errors of the nine parameters: a square for each pair, with its value in hundredths."""
    sigma = np.sqrt(np.diag(fit.claim.covariance).clip(min=0.0))
    is_free = sigma > 0.0
    scale = np.where(is_free, sigma, 1.0)
    values = np.where(np.outer(is_free, is_free), fit.claim.covariance / np.outer(scale, scale), np.nan).clip(-1.0, 1.0)
    side, first = 34, 40
    parts = []
    for row, name in enumerate(PARAMETERS):
        y = first + side * row
        parts.append(text(first - 6, y + side / 2 + 4, name, "end") + text(y + side / 2, first - 8, name))
        for column, value in enumerate(values[row, : row + 1].tolist()):
            parts.append(_cell(first + side * column, y, side - 2, value))
    size = first + 9 * side + 4
    return chart(size, size, "Correlation of the parameters, in hundredths", *parts)


def _cell(x: float, y: float, side: float, value: float) -> str:
    """A square for a correlation: its colour shows the sign, its opacity the size."""
    kind, strength = "positive" if value > 0.0 else "negative", 0.0 if math.isnan(value) else abs(value)
    shown = "–" if math.isnan(value) else minus(f"{100.0 * value:.0f}")
    return (
        rectangle("cell", x, y, side, side)
        + rectangle(kind, x, y, side, side, f' fill-opacity="{0.75 * strength:.2f}"')
        + text(x + side / 2, y + side / 2 + 4, shown, kind="small")
    )
