"""Maps of all directions of the field with predicted errors or readings, on two hemispheres or on a sphere.

>>> [words for _, words in error_legend(1.0)]
['0.5° or less', '1°', '2°', '5° or more', 'not known']
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, get_args

import numpy as np

from flinders.geometry.sphere import tiles
from flinders.report.charts import Axis, Plot, chart, circle, clip_shapes, outline_of, rectangle, segment, text
from flinders.report.colours import LEGEND, STEPS, Theme, class_of, colour_of, seen_ends, seen_level

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.report.charts import Canvas
    from flinders.report.view import View


def hatch_pattern(name: str) -> str:
    """Hatching pattern for directions without readings."""
    return (
        f'<defs><pattern id="{name}" width="6" height="6" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><path class="hatch" d="M0 0V6"/></pattern></defs>'
    )


def tile_paths(plot: Canvas, classes: Sequence[str], rings: Mapping[int, Floats]) -> list[str]:
    """Tiles as one path for each class."""
    sorted_rings: dict[str, list[Floats]] = {}
    for tile, ring in rings.items():
        sorted_rings.setdefault(classes[tile], []).append(ring)
    return [plot.tiles(kind, rings) for kind, rings in sorted_rings.items()]


def error_tiles(plot: Plot, view: View, target_deg: float, rings: Mapping[int, Floats], hatch: str) -> list[str]:
    """Tiles in the colours of their predicted errors; tiles without a reading are hatched too."""
    unseen = "".join(
        outline_of(plot.places(*ring.T), is_closed=True) for tile, ring in rings.items() if not view.tiles_seen[tile]
    )
    hatched = [f'<path fill="url(#{hatch})" d="{unseen}"/>'] if unseen else []
    return [*tile_paths(plot, error_classes(view, target_deg), rings), *hatched]


DISC, MAP_WIDE, MAP_HIGH = 114.0, 552, 282
MIDDLES: Final = (136.0, 416.0)
LETTER: Final = 6.0
"""Width of a letter of a legend."""
MIDDLE: Final = MAP_HIGH / 2.0 + 4.0
HEMISPHERE_AXIS: Final = Axis(-math.sqrt(2.0), math.sqrt(2.0))
"""Ends of both axes of a hemisphere in Lambert's azimuthal equal-area projection."""


def error_map(view: View, target_deg: float) -> str:
    """Predicted error in all directions on two hemispheres; directions without a reading are hatched."""
    insides = [error_tiles(plot, view, target_deg, hemisphere(up), "hatch-map") for plot, up in _discs()]
    parts = [hatch_pattern("hatch-map"), *_framed_discs("error", insides)]
    if view.guidance is not None and view.guidance.direction is not None:
        there = np.array([view.guidance.direction])
        plot, up = _discs()[0 if there[0, 2] >= 0.0 else 1]
        ((x, y),) = plot.places(*_lambert(there, up).T).tolist()
        parts.append(circle("next", x, y, 8))
    return chart(MAP_WIDE, MAP_HIGH, "Map of the predicted heading error over all directions of the field", *parts)


def path_map(view: View, target_deg: float, path: Floats) -> str:
    """Predicted error in all directions, with dots for the (N, 3) directions of the field that a motion meets."""
    insides = [
        [
            *error_tiles(plot, view, target_deg, hemisphere(up), "hatch-path"),
            plot.dots("path", *_lambert(path[up * path[:, 2] >= 0.0], up).T),
        ]
        for plot, up in _discs()
    ]
    title = "Map of the expected heading error over all directions of the field, and the path of the motion"
    return chart(MAP_WIDE, MAP_HIGH, title, hatch_pattern("hatch-path"), *_framed_discs("path", insides))


def coverage_map(view: View) -> str:
    """Number of readings in each direction, on the same map."""
    insides = [tile_paths(plot, seen_classes(view), hemisphere(up)) for plot, up in _discs()]
    title = "Map of the readings over all directions of the field"
    return chart(MAP_WIDE, MAP_HIGH, title, *_framed_discs("seen", insides))


def error_classes(view: View, target_deg: float) -> list[str]:
    """Class of each tile by its predicted error."""
    return [class_of(error, target_deg) for error in view.tiles_deg]


def seen_classes(view: View) -> list[str]:
    """Class of each tile by its number of readings."""
    ends = _seen_ends(view)
    return [f"s{seen_level(count, ends)}" for count in view.tiles_seen]


def _discs() -> list[tuple[Plot, float]]:
    """Plots of both hemispheres on the map, with the sign of z in each."""
    size = 2.0 * DISC
    plots = [Plot(middle - DISC, MIDDLE - DISC, size, size, HEMISPHERE_AXIS, HEMISPHERE_AXIS) for middle in MIDDLES]
    return list(zip(plots, (1.0, -1.0), strict=True))


def _framed_discs(name: str, insides: Sequence[Sequence[str]]) -> list[str]:
    """Both hemispheres, each with its edge, its pole, and the directions of x and y."""
    parts = []
    for place, (x, sides, inside) in enumerate(zip(MIDDLES, ("+z +y −y", "−z −y +y"), insides, strict=True)):
        pole, above, below = sides.split()
        parts += [
            clip_shapes(f"{name}-{place}", circle("", x, MIDDLE, DISC), *inside),
            circle("rim", x, MIDDLE, DISC),
            segment("meridian", x - DISC, MIDDLE, x + DISC, MIDDLE),
            segment("meridian", x, MIDDLE - DISC, x, MIDDLE + DISC),
            text(x, MIDDLE + 4, pole, kind="name halo"),
            text(x, MIDDLE - DISC - 5, above),
            text(x, MIDDLE + DISC + 14, below),
            text(x - DISC - 4, MIDDLE + 4, "−x", "end"),
            text(x + DISC + 4, MIDDLE + 4, "+x", "start"),
        ]
    return parts


def hemisphere(up: float) -> dict[int, Floats]:
    """Corners of the tiles that are at least partly in a hemisphere, on a disc of radius √2, by tile."""
    polygons = tiles().polygons()
    return {tile: _lambert(polygons[tile], up) for tile in np.flatnonzero(up * tiles().centres[:, 2] > -0.12).tolist()}


def _lambert(directions: Floats, up: float) -> Floats:
    """(k, 2) positions √(2/(1 + z)) (x, y) of (k, 3) unit vectors, seen from outside: y is up for +z, down for −z."""
    x, y, z = directions.T
    scale = np.sqrt(2.0 / (1.0 + up * z).clip(min=0.05))
    return np.stack([scale * x, up * scale * y], axis=1)


def tile_rules() -> str:
    """Colours of the error classes, light and dark, for a drawing in a separate file."""
    light, dark = map(_tile_colours, get_args(Theme))
    return f"{light} @media (prefers-color-scheme: dark) {{ {dark} }}"


def page_tile_rules() -> str:
    """Colours of the error classes and of the classes of readings, for a page that has them as variables."""
    classes = [*(f"e{step}" for step in range(STEPS)), "unknown", *(f"s{level}" for level in range(5))]
    return "\n".join(f".{name} {{ fill: var(--{name}); }}" for name in classes)


def _tile_colours(theme: Theme) -> str:
    """Colours of the error classes in one theme."""
    classes = (*(f"e{step}" for step in range(STEPS)), "unknown")
    return " ".join(f".{name} {{ fill: {colour_of(name, theme)} }}" for name in classes)


def error_legend(target_deg: float) -> list[tuple[str, str]]:
    """Class and words of each mark in the legend of predicted errors."""
    words = [f"{ratio * target_deg:.3g}°" for ratio in LEGEND]
    words = [f"{words[0]} or less", *words[1:-1], f"{words[-1]} or more"]
    marks = [(class_of(ratio * target_deg, target_deg), shown) for ratio, shown in zip(LEGEND, words, strict=True)]
    return [*marks, ("unknown", "not known")]


def legend_row(right: float, y: float, target_deg: float, words: str) -> str:
    """Legend of predicted errors in a row that ends at `right`: colours, each with its angle."""
    marks, x, parts = error_legend(target_deg), right, []
    for kind, shown in reversed(marks):
        x -= 30.0 + LETTER * len(shown)
        parts.append(rectangle(kind, x, y - 10.0, 12, 12) + text(x + 17.0, y, shown, "start"))
    return "".join([*parts, text(x - 12.0, y, words, "end")])


def seen_legend(view: View) -> list[tuple[str, str]]:
    """CSS class and label of each level of the number of readings."""
    ends = _seen_ends(view)
    firsts = [1, *(end + 1 for end in ends)]
    words = [
        f"{first:,}" if first == last else f"{first:,} to {last:,}" for first, last in zip(firsts, ends, strict=False)
    ]
    return [(f"s{level}", shown) for level, shown in enumerate(["none", *words, f"{firsts[-1]:,} or more"])]


def _seen_ends(view: View) -> tuple[int, int, int]:
    return seen_ends(sum(view.tiles_seen) / len(view.tiles_seen))
