"""Colours of reports and figures: those of the live page, and a scale for predicted heading errors.

The scale is that of ``static/views/colours.js``, in classes (`tests/live/test_colours_agree.py`). It is logarithmic in
the ratio of error to target: teal at half the target, green at the target, amber at twice the target, and deep magenta
at the end. Lightness decreases steadily, so that the scale can be read in grey and in print.

>>> colour_of("e3", "light"), colour_of("e19", "light"), colour_of("unknown", "light")
('#4ac193', '#8d023f', '#c3cad2')
>>> class_of(0.9, 1.0), class_of(40.0, 1.0), class_of(None, 1.0)
('e3', 'e19', 'unknown')
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache
from typing import Final, Literal

Theme = Literal["light", "dark"]

ENDS: Final = (0.5, 12.0)
"""Ratio of error to target at the two ends of the scale."""

ERRORS: Final[dict[Theme, tuple[str, ...]]] = {
    "light": (
        "#59ccbb", "#54c8ae", "#4fc5a0", "#4ac193", "#4fbd84", "#7eb270", "#9da65b", "#b69842", "#cc891c", "#d07c0f",
        "#cf6f13", "#ce6215", "#cc5417", "#ca4519", "#c8321a", "#bc2b28", "#b02330", "#a41a37", "#98103c", "#8d023f",
    ),
    "dark": (
        "#63e2cd", "#61dfc0", "#5edcb3", "#5cd8a6", "#62d498", "#8ec881", "#acba69", "#c4ac4c", "#d99c23", "#dc8d15",
        "#db7f19", "#d9701b", "#d7611d", "#d4501e", "#d13c1f", "#c4352d", "#b72e35", "#ab263c", "#9e1e41", "#921445",
    ),
}  # fmt: skip
"""Colours of the error classes in each theme."""

STEPS: Final = len(ERRORS["light"])

LEGEND: Final = (0.5, 1.0, 2.0, 5.0)
"""Ratio of error to target at the marks of a legend."""

COVERAGE_COLOURS: Final[dict[Theme, tuple[str, ...]]] = {
    "light": ("#e8ecf0", "#b9d7ee", "#7db7e0", "#3a8cc8", "#0a5a96"),
    "dark": ("#232c36", "#234a66", "#2f7099", "#4aa0d0", "#8ed8ff"),
}
"""Colours of a tile by its number of readings: no reading, then the classes of `seen_ends`."""

ROLES: Final[dict[Theme, dict[str, str]]] = {
    "light": {
        "paper": "#f4f6f8", "panel": "#ffffff", "raised": "#f2f5f8", "line": "#dde3e9", "strong": "#7d8894",
        "ink": "#12181f", "faint": "#525e6b", "accent": "#0a66a5", "raw": "#b96200", "corrected": "#0a72b8",
        "reject": "#c8006e", "good": "#067a56", "limited": "#8f5b00", "refused": "#c01f2e", "seam": "#ffffff",
        "unknown": "#c3cad2", "next": "#12181f",
    },
    "dark": {
        "paper": "#0b0f14", "panel": "#12181f", "raised": "#1b232c", "line": "#28323d", "strong": "#637181",
        "ink": "#eef2f6", "faint": "#9aa8b7", "accent": "#58c4f5", "raw": "#f0a040", "corrected": "#58c4f5",
        "reject": "#ff5fa8", "good": "#4fd3a5", "limited": "#f2b640", "refused": "#ff7d7d", "seam": "#12181f",
        "unknown": "#3b4550", "next": "#f3f6f9",
    },
}  # fmt: skip
"""Colours by their role."""


SERIES: Final[dict[Theme, tuple[str, ...]]] = {
    "light": ("#0072b2", "#d55e00", "#009e73", "#7a5195", "#a06a00", "#c0398c"),
    "dark": ("#56b4e9", "#ff9a56", "#3ccf9f", "#b9a0f0", "#e0b84c", "#f28cc6"),
}
"""Six colours of lines that red-green colour-blind readers can distinguish, also in print (Okabe and Ito)."""


def colour_of(name: str, theme: Theme) -> str:
    """Colour for a name in a style sheet: a role, one of several lines, or a class of a map.

    >>> colour_of("ink", "dark"), colour_of("c1", "light"), colour_of("s1", "light")
    ('#eef2f6', '#d55e00', '#b9d7ee')
    """
    return _palette(theme)[name]


def class_of(deg: float | None, target_deg: float) -> str:
    """Class of an error in the style sheet."""
    if deg is None or math.isnan(deg):
        return "unknown"
    low, high = map(math.log, ENDS)
    share = (math.log(max(deg, 1e-9) / target_deg) - low) / (high - low)
    return f"e{min(max(int(share * STEPS), 0), STEPS - 1)}"


def variables(theme: Theme) -> str:
    """All colours of a theme as CSS variables."""
    return " ".join(f"--{name}: {colour};" for name, colour in _palette(theme).items())


@cache
def _palette(theme: Theme) -> dict[str, str]:
    """Colours by name: roles, lines (c), error classes (e) and classes of readings (s)."""
    series = {"c": SERIES[theme], "e": ERRORS[theme], "s": COVERAGE_COLOURS[theme]}
    numbered = {f"{letter}{place}": one for letter, row in series.items() for place, one in enumerate(row)}
    return ROLES[theme] | numbered


def seen_ends(share: float) -> tuple[int, int, int]:
    """Largest counts of the lower three classes of tiles: about ⅓, 1 and 3 times the equal share of readings.

    >>> seen_ends(15.6), seen_ends(0.3)
    ((5, 16, 47), (1, 2, 3))
    """
    first = max(1, round(share / 3.0))
    second = max(first + 1, round(share))
    return first, second, max(second + 1, round(3.0 * share))


def seen_level(count: int, ends: tuple[int, int, int]) -> int:
    """Index in `COVERAGE_COLOURS` of a tile with this number of readings.

    >>> [seen_level(count, (5, 16, 47)) for count in (0, 2, 6, 17, 50)]
    [0, 1, 2, 3, 4]
    """
    return 1 + bisect_left(ends, count) if count else 0
