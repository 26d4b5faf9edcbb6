"""Figures of the report as SVG, without a plotting library and without a script: what is drawn prints and lasts.

Colours are classes, which the style sheet of the report gives for light, dark and paper; so a figure is the same text
in all of them. Numbers and words of our own are all that is in it: no name of a file or sensor.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.report.drawn import Drawn
>>> samples = simulate.tumble(seed=1).samples
>>> drawn = Drawn.of(calibrate.fit(samples), samples)
>>> figure = error_map(drawn.view, 1.0)
>>> figure.startswith('<svg class="figure"'), "style=" in figure
(True, False)
>>> ticks(-3.2, 7.9, 6), dots([(1.0, 2.0), (1.1, 2.1), (4.0, 2.0)])
([-2.0, 0.0, 2.0, 4.0, 6.0], 'm2 4h0m6 0h0')
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import figures
from flinders.geometry.sphere import tiles
from flinders.report.beside import called
from flinders.report.colours import LEGEND, class_of, seen_ends, seen_level

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.disturbance import Driver
    from flinders.diagnostics.random_walk import Walk
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.report.drawn import Drawn
    from flinders.report.view import View

AXES: Final = "xyz"
PLANES: Final = ((0, 1), (0, 2), (1, 2))
"""What is to the right and what is up in each projection."""

SIDE, EDGE = 260, 34
"""Of a square figure, and its margin to the left and below."""
WIDE: Final = 820
MOST_DOTS: Final = 3_000
"""Dots in a figure; more would be a smear, and a large file."""
FARTHEST: Final = 4.0
"""The origin is in sight as long as the offset is no longer than so many field strengths."""

AZIMUTH, ELEVATION = math.radians(32.0), math.radians(20.0)
"""Where the eye of the 3-D view stands when it begins (``static/views/camera.js``)."""

SIGMAS: Final = 4.5
"""Residuals are shown up to so many standard deviations; what is farther off is drawn at the edge."""

PARAMETERS: Final = ("bx", "by", "bz", "Sxx", "Syy", "Szz", "Sxy", "Sxz", "Syz")

HATCH: Final = (
    '<defs><pattern id="{name}" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">'
    '<path class="hatch" d="M0 0V6"/></pattern></defs>'
)


@dataclass(frozen=True, slots=True)
class _Box:
    """A rectangle of a figure and what its ends stand for."""

    left: float
    top: float
    width: float
    height: float
    low: tuple[float, float]
    high: tuple[float, float]

    def x(self, value: float) -> float:
        """Place of a value along the first axis."""
        return self.left + self.width * (value - self.low[0]) / (self.high[0] - self.low[0])

    def y(self, value: float) -> float:
        """Place of a value along the second axis, which points up."""
        return self.top + self.height * (self.high[1] - value) / (self.high[1] - self.low[1])

    def places(self, points: ArrayLike) -> Floats:
        """(n, 2) places of (n, 2) points."""
        values = np.asarray(points, float).reshape(-1, 2)
        scale = np.array([self.width, -self.height]) / np.subtract(self.high, self.low)
        places: Floats = (values - self.low) * scale + [self.left, self.top + self.height]
        return places

    def holds(self, places: Floats) -> Floats:
        """Those (m, 2) of (n, 2) places that lie inside."""
        x, y = places.T
        inside = (x >= self.left) & (x <= self.left + self.width) & (y >= self.top) & (y <= self.top + self.height)
        held: Floats = places[inside]
        return held


# ------------------------------------------------------------------------------------------------------- projections


def projections(drawn: Drawn, *, is_corrected: bool) -> list[str]:
    """The readings seen along z, y and x: before with the ellipse that was found, after with the circle."""
    name = "after" if is_corrected else "before"
    points, low, high = extents(drawn, is_corrected=is_corrected)
    return [_projection(drawn, points, plane, (low, high), name) for plane in PLANES]


def _projection(drawn: Drawn, points: Floats, plane: tuple[int, int], ends: tuple[Floats, Floats], name: str) -> str:
    i, j = plane
    low, high = ends
    inner = SIDE - EDGE - 8
    box = _Box(EDGE, 8, inner, inner, (low[i], low[j]), (high[i], high[j]))
    is_used = drawn.is_used
    parts = [*_grid(box, drawn.unit, AXES[i], AXES[j]), f'<g clip-path="url(#clip-{name}-{i}{j})">']
    parts.append(_dots(name, box.holds(box.places(_thinned(points[is_used])[:, plane]))))
    parts.append(_crosses(box.holds(box.places(points[~is_used][:, plane]))))
    edge = outline(drawn, plane, is_corrected=name == "after")
    if len(edge):
        parts.append(f'<path class="outline {name}" d="{_path(box.places(edge))}Z"/>')
    if name == "before" and drawn.view is not None and drawn.view.shown is not None:
        parts.append(_arm(box.places([(0.0, 0.0), (drawn.view.shown.offset[i], drawn.view.shown.offset[j])])))
    parts.append("</g>")
    clip = (
        f'<clipPath id="clip-{name}-{i}{j}"><rect x="{box.left}" y="{box.top}" width="{inner}" height="{inner}"/>'
        "</clipPath>"
    )
    label = f"{AXES[i]}{AXES[j]} {name} correction"
    return _svg(SIDE, SIDE, f"Projection {label}", [clip, *parts])


def _before(drawn: Drawn) -> tuple[Floats, Floats, Floats]:
    """Readings, and the two corners of a cube that holds nearly all of them, the ellipsoid, and the origin if near."""
    low, high = _extent(drawn.raw[drawn.is_used] if drawn.is_used.any() else drawn.raw)
    shape = drawn.shape
    if shape is not None and drawn.view is not None and drawn.view.shown is not None:
        offset, reach = np.array(drawn.view.shown.offset), np.linalg.norm(shape, axis=1)
        low, high = np.minimum(low, offset - reach), np.maximum(high, offset + reach)
        if np.linalg.norm(offset) <= FARTHEST * drawn.view.shown.strength:
            low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    half = max(0.54 * float((high - low).max()), 1e-9)
    middle = (low + high) / 2.0
    return drawn.raw, middle - half, middle + half


def _after(drawn: Drawn) -> tuple[Floats, Floats, Floats]:
    strength = 1.0 if drawn.view is None or drawn.view.shown is None else drawn.view.shown.strength
    return drawn.corrected, np.full(3, -1.25 * strength), np.full(3, 1.25 * strength)


def _extent(points: Floats) -> tuple[Floats, Floats]:
    """Corners of what holds nearly all (n, 3) points."""
    if not len(points):
        return np.full(3, -1.0), np.full(3, 1.0)
    low, high = np.quantile(points, [0.002, 0.998], axis=0)
    return low, high


def outline(drawn: Drawn, plane: tuple[int, int], *, is_corrected: bool) -> Floats:
    """(72, 2) outline of the ellipsoid, or of the sphere that it becomes, seen along the third axis.

    None of it, (0, 2), where there is no surface.
    """
    name = "after" if is_corrected else "before"
    return _silhouette(drawn, np.eye(3)[[*plane, 3 - sum(plane)]], name)


def extents(drawn: Drawn, *, is_corrected: bool) -> tuple[Floats, Floats, Floats]:
    """(n, 3) readings, and the two corners (3,) of a cube to show them in, which is the same for all projections."""
    return _after(drawn) if is_corrected else _before(drawn)


# ------------------------------------------------------------------------------------------------------------ sphere


def pictures(drawn: Drawn, target_deg: float) -> list[tuple[str, str]]:
    """The 3-D view as it begins, for paper: readings before and after, and what is known in each direction.

    Returns
    -------
    list of (str, str)
        Title and figure.
    """
    found = [("Before", _cloud(drawn, "before"))]
    if drawn.view is not None and drawn.view.shown is not None:
        found += [("After", _cloud(drawn, "after")), ("Predicted error", _ball(drawn.view, target_deg))]
    return found


def _eye() -> Floats:
    """(3, 3) rows: to the right, up, towards the eye."""
    (ca, sa), (ce, se) = ((math.cos(angle), math.sin(angle)) for angle in (AZIMUTH, ELEVATION))
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def _cloud(drawn: Drawn, name: str) -> str:
    """Readings from that eye, those behind the middle fainter; with the outline of the ellipsoid or sphere."""
    eye, is_before = _eye(), name == "before"
    points = _thinned((drawn.raw if is_before else drawn.corrected)[drawn.is_used])
    out = (drawn.raw if is_before else drawn.corrected)[~drawn.is_used]
    shown = None if drawn.view is None else drawn.view.shown
    _, low, high = _before(drawn) if is_before else _after(drawn)
    middle = (low + high) / 2.0 if shown is None or not is_before else np.array(shown.offset)
    length = float((high - low).max()) * (0.22 if is_before else 0.46)
    origin = np.clip(np.zeros(3), low, high)  # where zero is far away, the axes stand at the edge
    has_origin = bool((origin == 0.0).all())
    held = [_extent(points @ eye.T)] if len(points) else []
    ends = np.concatenate([[origin], origin + length * np.eye(3)]) @ eye.T
    edge = _silhouette(drawn, eye, name)
    corners = np.concatenate([*(np.array(pair)[:, :2] for pair in held), ends[:, :2], edge])
    centre, half = (corners.min(axis=0) + corners.max(axis=0)) / 2.0, 0.54 * float(np.ptp(corners, axis=0).max())
    box = _Box(10, 10, SIDE - 20, SIDE - 20, tuple(centre - half), tuple(centre + half))

    def seen(vectors: ArrayLike) -> Floats:
        return box.places((np.asarray(vectors, float) @ eye.T)[..., :2])

    depth = (points - (middle if is_before else 0.0)) @ eye[2]
    parts = [*_triad(seen, origin, length), _dots(f"{name} far", box.holds(seen(points[depth < 0.0])))]
    if len(edge):
        parts.append(f'<path class="outline {name}" d="{_path(box.places(edge))}Z"/>')
    parts += [_dots(name, box.holds(seen(points[depth >= 0.0]))), _crosses(box.holds(seen(out)))]
    if is_before and shown is not None and has_origin:
        parts.append(_arm(seen([(0.0, 0.0, 0.0), shown.offset])))
    return _svg(SIDE, SIDE, f"Readings {name} correction, in three dimensions", parts)


def _silhouette(drawn: Drawn, eye: Floats, name: str) -> Floats:
    """(72, 2) outline of the ellipsoid, or of the sphere that it becomes; (0, 2) where there is none."""
    shape = drawn.shape
    if shape is None or drawn.view is None or drawn.view.shown is None:
        return np.empty((0, 2))
    middle = np.array(drawn.view.shown.offset) if name == "before" else np.zeros(3)
    across = shape if name == "before" else drawn.view.shown.strength * np.eye(3)
    return (eye[:2] @ middle) + _shadow(eye[:2] @ across)


def _shadow(rows: Floats) -> Floats:
    """(72, 2) outline of A u over all unit vectors u, for A of (2, 3): the circle under the root of A Aᵀ."""
    around = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    values, turns = np.linalg.eigh(rows @ rows.T)
    shadow: Floats = ((turns * np.sqrt(values)) @ np.stack([np.cos(around), np.sin(around)])).T
    return shadow


def _triad(seen: Callable[[ArrayLike], Floats], origin: Floats, length: float) -> Iterable[str]:
    """Axes through a point, with their names."""
    for axis, name in enumerate(AXES):
        (x0, y0), (x1, y1) = seen([origin, origin + length * np.eye(3)[axis]]).tolist()
        dx, dy = x1 - x0, y1 - y0
        away = 9.0 / max(math.hypot(dx, dy), 1.0)
        yield _line(x0, y0, x1, y1, "axis")
        yield _text(x1 + away * dx, y1 + away * dy + 4, name, "middle", "name")


def _ball(view: View, target_deg: float) -> str:
    """The sphere of tiles from the same eye."""
    eye, radius = _eye(), (SIDE - 8) / 2.5
    middle = SIDE / 2.0

    def seen(vectors: Floats) -> Floats:
        places: Floats = middle + radius * ((vectors @ eye.T)[..., :2] * [1.0, -1.0])
        return places

    facing = np.flatnonzero(tiles().centres @ eye[2] > -0.08)
    clip = f'<clipPath id="ball"><circle cx="{middle}" cy="{middle}" r="{radius:.1f}"/></clipPath>'
    parts = [HATCH.format(name="hatch-ball"), clip, '<g clip-path="url(#ball)">']
    parts += _tiled(view, target_deg, [(tile, seen(ring)) for tile, ring in _rings(facing)], "hatch-ball")
    parts.append("</g>")
    for axis, name in enumerate(AXES):
        for sign in (1.0, -1.0):
            end = np.zeros(3)
            end[axis] = sign
            if end @ eye[2] <= 0.0:
                continue
            (x0, y0), (x1, y1), (x2, y2) = seen(np.array([end, 1.16 * end, 1.26 * end]))
            parts += [
                _line(x0, y0, x1, y1, "axis"),
                _text(x2, y2 + 4, name if sign > 0 else f"−{name}", "middle", "name"),
            ]
    if view.guidance is not None and view.guidance.direction is not None:
        there = np.array(view.guidance.direction)
        x, y = seen(there)
        behind = "" if there @ eye[2] > 0.0 else " behind"
        parts.append(f'<circle class="next{behind}" cx="{x:.1f}" cy="{y:.1f}" r="9"/>')
    return _svg(SIDE, SIDE, "Predicted heading error in each direction, on the sphere", parts)


def _rings(which: Iterable[int]) -> list[tuple[int, Floats]]:
    """Corners of some tiles."""
    polygons = tiles().polygons()
    return [(int(tile), polygons[tile]) for tile in which]


def _tiled(view: View, target_deg: float, placed: Sequence[tuple[int, Floats]], hatch: str) -> list[str]:
    """Tiles of one colour as one path each; those without a reading are hatched besides."""
    paths: dict[str, str] = {}
    unseen = ""
    for tile, ring in placed:
        outline = _path(ring) + "Z"
        kind = class_of(view.tiles_deg[tile], target_deg)
        paths[kind] = paths.get(kind, "") + outline
        unseen += "" if view.tiles_seen[tile] else outline
    parts = [f'<path class="tile {kind}" d="{outline}"/>' for kind, outline in paths.items()]
    return [*parts, f'<path fill="url(#{hatch})" d="{unseen}"/>'] if unseen else parts


# -------------------------------------------------------------------------------------------------------------- maps

DISC, MAP_WIDE, MAP_HIGH = 114.0, 552, 282
MIDDLES: Final = (136.0, 416.0)


def error_map(view: View, target_deg: float) -> str:
    """Predicted error of all directions: two hemispheres in Lambert's azimuthal projection, which keeps areas."""
    parts = [HATCH.format(name="hatch-map")]
    for place, up in enumerate((1.0, -1.0)):
        parts += [_clip(place, "error"), f'<g clip-path="url(#error-{place})">']
        parts += _tiled(view, target_deg, _disc(place, up), "hatch-map")
        parts += ["</g>", *_rim(place, up)]
    if view.guidance is not None and view.guidance.direction is not None:
        there = np.array(view.guidance.direction)
        place = 0 if there[2] >= 0.0 else 1
        x, y = _lambert(there[np.newaxis], place, 1.0 if place == 0 else -1.0)[0]
        parts.append(f'<circle class="next" cx="{x:.1f}" cy="{y:.1f}" r="8"/>')
    return _svg(MAP_WIDE, MAP_HIGH, "Map of the predicted heading error over all directions of the field", parts)


def coverage_map(view: View) -> str:
    """Readings in each direction, on the same map."""
    ends = seen_ends(sum(view.tiles_seen) / len(view.tiles_seen))
    parts = []
    for place, up in enumerate((1.0, -1.0)):
        paths: dict[int, str] = {}
        for tile, ring in _disc(place, up):
            level = seen_level(view.tiles_seen[tile], ends)
            paths[level] = paths.get(level, "") + _path(ring) + "Z"
        parts += [_clip(place, "seen"), f'<g clip-path="url(#seen-{place})">']
        parts += [f'<path class="tile s{level}" d="{outline}"/>' for level, outline in paths.items()]
        parts += ["</g>", *_rim(place, up)]
    return _svg(MAP_WIDE, MAP_HIGH, "Map of the readings over all directions of the field", parts)


def _disc(place: int, up: float) -> list[tuple[int, Floats]]:
    """Tiles of a hemisphere, and those that reach into it, where they lie on the map."""
    which = np.flatnonzero(up * tiles().centres[:, 2] > -0.12)
    return [(tile, _lambert(ring, place, up)) for tile, ring in _rings(which)]


def _lambert(directions: Floats, place: int, up: float) -> Floats:
    """(k, 2) places of (k, 3) unit vectors: at √(2/(1 + z)) (x, y), so that a hemisphere has the radius √2.

    Both are seen from outside: y is up in the first, down in the second.
    """
    x, y, z = directions.T
    scale = DISC / math.sqrt(2.0) * np.sqrt(2.0 / (1.0 + up * z).clip(min=0.05))
    return np.stack([MIDDLES[place] + scale * x, MAP_HIGH / 2.0 + 4.0 - up * scale * y], axis=1)


def _clip(place: int, name: str) -> str:
    return (
        f'<clipPath id="{name}-{place}"><circle cx="{MIDDLES[place]}" cy="{MAP_HIGH / 2 + 4}" r="{DISC}"/></clipPath>'
    )


def _rim(place: int, up: float) -> Iterable[str]:
    """The edge of a hemisphere, where x and y point, and which one it is."""
    x, y = MIDDLES[place], MAP_HIGH / 2.0 + 4.0
    yield f'<circle class="rim" cx="{x}" cy="{y}" r="{DISC}"/>'
    yield _line(x - DISC, y, x + DISC, y, "meridian") + _line(x, y - DISC, x, y + DISC, "meridian")
    yield _text(x, y + 4, "+z" if up > 0 else "−z", "middle", "name halo")
    above, below = ("+y", "−y") if up > 0 else ("−y", "+y")
    yield _text(x, y - DISC - 5, above, "middle") + _text(x, y + DISC + 14, below, "middle")
    yield _text(x - DISC - 4, y + 4, "−x", "end") + _text(x + DISC + 4, y + 4, "+x", "start")


def error_legend(target_deg: float) -> list[tuple[str, str]]:
    """Class and words of each mark."""
    last = len(LEGEND) - 1
    words = [
        f"{ratio * target_deg:.3g}°{' or less' if place == 0 else ' or more' if place == last else ''}"
        for place, ratio in enumerate(LEGEND)
    ]
    marks = [(class_of(ratio * target_deg, target_deg), text) for ratio, text in zip(LEGEND, words, strict=True)]
    return [*marks, ("unknown", "not known")]


def seen_legend(view: View) -> list[tuple[str, str]]:
    """Class and words of each level."""
    ends = seen_ends(sum(view.tiles_seen) / len(view.tiles_seen))
    firsts = [1, *(end + 1 for end in ends)]
    words = [
        f"{first:,}" if first == last else f"{first:,} to {last:,}" for first, last in zip(firsts, ends, strict=False)
    ]
    return [(f"s{level}", text) for level, text in enumerate(["none", *words, f"{firsts[-1]:,} or more"])]


# --------------------------------------------------------------------------------------------------------- residuals


def residuals(drawn: Drawn) -> str:
    """How much longer each corrected reading is than the field, over time; those left out as crosses."""
    assert drawn.view is not None
    noise, off, when = drawn.view.noise or 0.0, drawn.residuals, drawn.when
    end = _reach(noise, off)
    span = (float(when[0]), float(when[-1])) if len(when) > 1 and when[-1] > when[0] else (0.0, 1.0)
    box = _Box(58, 10, WIDE - 88, 170, (span[0], -end), (span[1], end))
    parts = list(_grid(box, drawn.unit, "", "", digits_x=_of_time(span, drawn.clock), many=8))
    if noise > 0.0:
        top, bottom = box.y(min(2.0 * noise, end)), box.y(-min(2.0 * noise, end))
        parts.append(
            f'<rect class="band" x="{box.left}" y="{top:.1f}" width="{box.width}" height="{bottom - top:.1f}"/>'
        )
    pairs = np.stack([when, off.clip(-end, end)], axis=1)
    used, out = pairs[drawn.is_used], pairs[~drawn.is_used]
    parts.append(_dots("after", box.places(used)))
    parts.append(_crosses(box.places(_thinned(out))))
    axis = "seconds" if drawn.clock == "s" else "number of the reading"
    parts.append(_text(box.left + box.width / 2, 216, axis, "middle"))
    parts.append(_text(14, box.top + box.height / 2, drawn.unit, "middle", turned=True))
    return _svg(WIDE, 222, "Residuals over time", parts)


def _reach(noise: float, off: Floats) -> float:
    """What an axis of residuals goes to."""
    spread = SIGMAS * noise if noise > 0.0 else float(np.abs(off).max(initial=0.0))
    return spread if spread > 0.0 else 1.0


def _of_time(span: tuple[float, float], clock: str) -> str:
    return "," if clock == "reading" or span[1] >= 1e4 else ""


def histogram(view: View, unit: str) -> str:
    """Residuals counted, with the bell of as many and as much noise."""
    assert view.residuals is not None
    edges, counts = np.array(view.residuals.edges), np.array(view.residuals.counts, float)
    width, total, noise = edges[1] - edges[0], counts.sum(), view.noise or 0.0
    middles = np.linspace(edges[0], edges[-1], 121)
    bell = (
        total * width / (noise * math.sqrt(2.0 * math.pi)) * np.exp(-0.5 * (middles / noise) ** 2)
        if noise > 0.0
        else np.zeros(121)
    )
    most = max(float(counts.max(initial=0.0)), float(bell.max()), 1.0) * 1.08
    box = _Box(46, 10, SIDE + 100 - 58, 170, (float(edges[0]), 0.0), (float(edges[-1]), most))
    parts = list(_grid(box, unit, "", "", many=5))
    bars = "".join(
        f"M{box.x(a):.1f} {box.y(0):.1f}V{box.y(n):.1f}H{box.x(b) - 0.6:.1f}V{box.y(0):.1f}Z"
        for a, b, n in zip(edges[:-1], edges[1:], counts, strict=True)
        if n
    )
    parts.append(f'<path class="bar" d="{bars}"/>')
    parts.append(f'<path class="bell" d="{_path(box.places(np.stack([middles, bell], axis=1)))}"/>')
    parts.append(_text(box.left + box.width / 2, 216, f"longer than the field, {unit}", "middle"))
    return _svg(SIDE + 100, 222, "Histogram of the residuals", parts)


STRIP: Final = 72
"""Height of what one axis has of a figure of three."""


def wandered(walk: Walk, unit: str, plane: Plane | None = None) -> str:
    """Offset along each axis over time, less that of the fit, with the band of one standard deviation.

    Of readings of one plane, the two axes in it.
    """
    axes = sorted(AXES.index(axis) for axis in plane or AXES)
    half = (walk.time[1] - walk.time[0]) / 2.0 if len(walk.time) > 1 else 0.5
    span = (float(walk.time[0] - half), float(walk.time[-1] + half))
    when = np.concatenate([span[:1], walk.time, span[1:]])
    path, sigma = (np.pad(rows[:, axes], ((1, 1), (0, 0)), mode="edge") for rows in (walk.path, walk.sigma))
    end = _round_up(1.02 * float((np.abs(path) + sigma).max()))
    parts: list[str] = []
    for place, axis in enumerate(axes):
        is_last = place == len(axes) - 1
        box = _Box(58, 10 + place * (STRIP + 18), WIDE - 88, STRIP, (span[0], -end), (span[1], end))
        parts += _strip(box, _of_time(span, "s"), numbered=is_last)
        low, high = (np.column_stack([when, path[:, place] + sign * sigma[:, place]]) for sign in (-1.0, 1.0))
        parts.append(f'<path class="band" d="{_path(box.places(np.concatenate([high, low[::-1]])))}Z"/>')
        line = _path(box.places(np.column_stack([when, path[:, place]])))
        parts.append(f'<path class="curve corrected" d="{line}"/>')
        parts.append(_text(box.left + 6, box.top + 14, f"{AXES[axis]}, {unit}", "start", "name halo"))
    below = box.top + box.height
    parts.append(_text(box.left + box.width / 2, below + 36, "seconds", "middle"))
    return _svg(WIDE, below + 42, "Offset over time, less that of the fit", parts)


def _strip(box: _Box, digits_x: str, *, numbered: bool) -> Iterable[str]:
    """Lines and numbers of one of several figures that lie above each other and have one axis of time."""
    across, upward = ticks(box.low[0], box.high[0], 8), [box.low[1], 0.0, box.high[1]]
    for value in across:
        x = box.x(value)
        yield _line(x, box.top, x, box.top + box.height, "grid")
        if numbered:
            yield _text(x, box.top + box.height + 14, _shown(value, across, digits_x), "middle")
    for value in upward:
        yield _line(box.left, box.y(value), box.left + box.width, box.y(value), "zero" if value == 0 else "grid")
        yield _text(box.left - 5, box.y(value) + 4, f"{value:+.3g}".replace("-", "−") if value else "0", "end")


def followed(drawn: Drawn, driver: Driver) -> str:
    """Strength of the corrected field over what drives the offset: with that left in, and taken off."""
    assert drawn.view is not None
    assert drawn.view.shown is not None
    driving = drawn.driving[driver.name]
    is_shown = drawn.is_used & np.isfinite(driving)
    values, origin = driving[is_shown], driver.reference
    rows = [drawn.strengths(is_followed=is_followed)[is_shown] for is_followed in (False, True)]
    low, high = np.quantile(rows, [0.002, 0.998]) if len(values) else (0.0, 1.0)
    margin = 0.06 * max(float(high - low), 1e-9)
    first, last = float(values.min(initial=origin)), float(values.max(initial=origin))
    box = _Box(58, 10, WIDE - 88, 190, (first, low - margin), (max(last, first + 1e-9), high + margin))
    parts = list(_grid(box, drawn.unit, "", "", many=8))
    for kind, strengths in zip(("before", "after"), rows, strict=True):
        parts.append(_dots(kind, box.holds(box.places(_thinned(np.stack([values, strengths], axis=1))))))
    level = box.y(drawn.view.shown.strength)
    parts.append(_line(box.left, level, box.left + box.width, level, "aim"))
    parts.append(_text(box.left + box.width / 2, 236, called(driver), "middle"))
    parts.append(_text(14, box.top + box.height / 2, drawn.unit, "middle", turned=True))
    return _svg(WIDE, 242, f"Strength of the corrected field over {driver.name}, before and after following it", parts)


# --------------------------------------------------------------------------------------------------------- deviation


def deviation(view: View, target_deg: float) -> str:
    """A level turn: what the raw compass is off over the heading, and 1 σ and 2 σ of the corrected one."""
    assert view.turn is not None
    heading = np.append(view.turn.heading_deg, 360.0)
    before, sigma = (np.append(row, row[0]) for row in (view.turn.before_deg, view.turn.sigma_deg))
    parts: list[str] = []
    end = _round_up(1.06 * float(np.abs(before).max()))
    end = 180.0 if end > 150.0 else end
    box = _Box(58, 24, WIDE - 88, 120, (0.0, -end), (360.0, end))
    parts += [_text(box.left, 15, "before: the raw compass", "start", "name raw"), *_turn(box, numbered=False)]
    parts.append(f'<path class="curve raw" d="{_broken(box, heading, before)}"/>')
    most = max(2.0 * float(sigma.max()), 1e-9)
    is_near = target_deg < 6.0 * most
    end = _round_up(1.1 * (max(most, target_deg) if is_near else most))
    box = _Box(58, 180, WIDE - 88, 120, (0.0, -end), (360.0, end))
    parts += [_text(box.left, 171, "after: expected, ± 1 σ and ± 2 σ", "start", "name corrected"), *_turn(box)]
    for factor in (2.0, 1.0):
        edge = np.concatenate(
            [
                np.stack([heading, factor * sigma], axis=1),
                np.stack([heading, -factor * sigma], axis=1)[::-1],
            ]
        )
        parts.append(f'<path class="band" d="{_path(box.places(edge))}Z"/>')
    if is_near:
        for sign in (1.0, -1.0):
            parts.append(
                _line(box.left, box.y(sign * target_deg), box.left + box.width, box.y(sign * target_deg), "aim")
            )
        parts.append(_text(box.left + box.width - 4, box.y(target_deg) + 13, f"target {target_deg:g}°", "end", "name"))
    parts.append(_text(box.left + box.width / 2, 336, "heading of a level vehicle", "middle"))
    return _svg(WIDE, 342, "Deviation over the heading, before and after", parts)


def _turn(box: _Box, *, numbered: bool = True) -> Iterable[str]:
    """Lines for a turn, with degrees and the points of the compass."""
    for place, name in enumerate(("N", "NE", "E", "SE", "S", "SW", "W", "NW", "N")):
        x = box.x(45.0 * place)
        yield _line(x, box.top, x, box.top + box.height, "grid")
        if numbered:
            yield _text(x, box.top + box.height + 16, f"{name} {45 * place:03d}°", "middle")
    values = [-180.0, -90.0, 0.0, 90.0, 180.0] if box.high[1] == 180.0 else ticks(box.low[1], box.high[1], 5)
    for value in values:
        yield _line(box.left, box.y(value), box.left + box.width, box.y(value), "zero" if value == 0 else "grid")
        yield _text(box.left - 6, box.y(value) + 4, f"{_shown(value, values)}°", "end")


def _broken(box: _Box, heading: Floats, angle: Floats) -> str:
    """A line over the heading that does not run from −180° to 180° and back."""
    runs = np.split(np.arange(len(angle)), np.flatnonzero(np.abs(np.diff(angle)) > 180.0) + 1)
    return "".join(_path(box.places(np.stack([heading[run], angle[run]], axis=1))) for run in runs)


# ------------------------------------------------------------------------------------------------------- correlation


def correlation(fit: Fit) -> str:
    """How the errors of the nine parameters hang together: a square for each pair, the number in hundredths."""
    sigma = np.sqrt(np.diag(fit.covariance).clip(min=0.0))
    is_free = sigma > 0.0
    scale = np.where(is_free, sigma, 1.0)
    values = fit.covariance / np.outer(scale, scale)
    side, first = 34, 40
    parts = []
    for row, name in enumerate(PARAMETERS):
        y = first + side * row
        parts.append(_text(first - 6, y + side / 2 + 4, name, "end"))
        parts.append(_text(first + side * row + side / 2, first - 8, name, "middle"))
        for column in range(row + 1):
            x, value = first + side * column, float(np.clip(values[row, column], -1.0, 1.0))
            is_known = bool(is_free[row] and is_free[column])
            kind = "positive" if value > 0.0 else "negative"
            opacity = abs(value) if is_known else 0.0
            parts.append(f'<rect class="cell" x="{x}" y="{y}" width="{side - 2}" height="{side - 2}"/>')
            parts.append(
                f'<rect class="{kind}" x="{x}" y="{y}" width="{side - 2}" height="{side - 2}" '
                f'fill-opacity="{0.75 * opacity:.2f}"/>'
            )
            shown = f"{100.0 * value:.0f}".replace("-", "−") if is_known else "–"
            parts.append(_text(x + side / 2 - 1, y + side / 2 + 3, shown, "middle", "small"))
    size = first + 9 * side + 4
    return _svg(size, size, "Correlation of the parameters, in hundredths", parts)


# ------------------------------------------------------------------------------------------------------------- parts


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers from `low` to `high`, about `most` of them or fewer."""
    width = high - low
    if not (width > 0.0 and math.isfinite(width)):
        return [low]
    step = _step(width / most)
    first = math.ceil(low / step - 1e-9)
    return [round(place * step, 12) + 0.0 for place in range(first, math.floor(high / step + 1e-9) + 1)]


def _step(rough: float) -> float:
    decade = 10.0 ** math.floor(math.log10(rough))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= rough * (1.0 - 1e-9))


def _round_up(value: float) -> float:
    """The next of a series of round numbers."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-9)))
    steps = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return next(step * decade for step in steps if step * decade >= value * (1.0 - 1e-9))


def _shown(value: float, values: Sequence[float], mark: str = "") -> str:
    """A tick with as many decimals as tell it from the next one."""
    step = abs(values[1] - values[0]) if len(values) > 1 else abs(value) or 1.0
    decimals = max(0, min(6, -math.floor(math.log10(step) + 1e-9)))
    return f"{value:{mark}.{decimals}f}".replace("-", "−")


def _grid(box: _Box, unit: str, right: str, up: str, *, digits_x: str = "", many: int = 5) -> Iterable[str]:
    """Lines and numbers of both axes, and what they are."""
    across, upward = ticks(box.low[0], box.high[0], many), ticks(box.low[1], box.high[1], 5)
    for value in across:
        x = box.x(value)
        yield _line(x, box.top, x, box.top + box.height, "zero" if value == 0 and right else "grid")
        yield _text(x, box.top + box.height + 14, _shown(value, across, digits_x), "middle")
    for value in upward:
        y = box.y(value)
        yield _line(box.left, y, box.left + box.width, y, "zero" if value == 0 else "grid")
        yield _text(box.left - 5, y + 4, _shown(value, upward), "end")
    yield f'<rect class="frame" x="{box.left}" y="{box.top}" width="{box.width}" height="{box.height}"/>'
    if right:
        yield _text(box.left + box.width - 6, box.top + box.height - 6, f"{right}, {unit}", "end", "name halo")
        yield _text(box.left + 6, box.top + 14, up, "start", "name halo")


def dots(places: ArrayLike) -> str:
    """Points as the `d` of a path in half units, each place once: a few letters for each."""
    cells = np.unique(np.rint(2.0 * np.asarray(places, float).reshape(-1, 2)).astype(int)[:, ::-1], axis=0)
    steps = np.diff(cells, axis=0, prepend=0)
    return "".join(f"m{x}{'' if y < 0 else ' '}{y}h0" for y, x in steps.tolist())


def _dots(kind: str, places: Floats) -> str:
    return f'<path class="dots {kind}" transform="scale(.5)" d="{dots(places)}"/>' if len(places) else ""


def _crosses(places: Floats) -> str:
    if not len(places):
        return ""
    marks = "".join(f"M{x - 3:.1f} {y - 3:.1f}l6 6m0-6l-6 6" for x, y in _thinned(places, 500).tolist())
    return f'<path class="reject" d="{marks}"/>'


def _thinned(points: Floats, most: int = MOST_DOTS) -> Floats:
    thinned: Floats = points[:: max(1, -(-len(points) // most))]
    return thinned


def _arm(places: Floats) -> str:
    """The offset: a line from the origin to the centre, and a dot there."""
    (x0, y0), (x1, y1) = places.tolist()
    return _line(x0, y0, x1, y1, "iron") + f'<circle class="iron-end" cx="{x1:.1f}" cy="{y1:.1f}" r="3"/>'


def _path(places: Floats) -> str:
    """A line through places."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places.tolist())


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> str:
    return f'<path class="{kind}" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>'


def _text(x: float, y: float, text: str, anchor: str, kind: str = "", *, turned: bool = False) -> str:
    classes = f' class="{kind}"' if kind else ""
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    return f'<text{classes} x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{turn}>{escape(text)}</text>'


def _svg(width: float, height: float, title: str, parts: Iterable[str]) -> str:
    return (
        f'<svg class="figure" viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" '
        f'aria-label="{escape(title)}">{"".join(parts)}</svg>'
    )


def length(value: float, unit: str) -> str:
    """A field with its unit.

    >>> length(49.3021, "µT")
    '49.30 µT'
    """
    return f"{figures(value, 4)} {unit}"
