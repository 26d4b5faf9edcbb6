"""Colours of the report and of figures: those of the page, with its scale for predicted heading errors.

The scale is that of ``static/views/colours.js``, to the digit (`tests/agreement/test_colours_agree.py`): it runs over
error ÷ target on a logarithm, from teal where the target is met twice over, through green at the target and amber at
its double, to deep magenta. Lightness falls all the way, so that it reads in grey and in print.

>>> error_colour(0.5, 1.0, "light"), error_colour(12.0, 1.0, "light")
('#5bcdc1', '#870041')
>>> error_colour(None, 1.0, "light") == UNKNOWN["light"]
True
>>> class_of(0.9, 1.0), class_of(40.0, 1.0), class_of(None, 1.0)
('e3', 'e19', 'unknown')

Source: B. Ottosson, "A perceptual color space for image processing" (2020), the matrices of OKLab.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache
from typing import Final, Literal

Theme = Literal["light", "dark"]

THEMES: Final[tuple[Theme, ...]] = ("light", "dark")

STOPS: Final[dict[Theme, tuple[tuple[float, float, float, float], ...]]] = {
    "dark": (
        (0.5, 0.84, 0.115, 184),
        (1.0, 0.79, 0.14, 160),
        (2.0, 0.73, 0.15, 76),
        (5.0, 0.575, 0.19, 33),
        (12.0, 0.42, 0.16, 2),
    ),
    "light": (
        (0.5, 0.78, 0.105, 186),
        (1.0, 0.72, 0.135, 160),
        (2.0, 0.68, 0.145, 70),
        (5.0, 0.55, 0.19, 32),
        (12.0, 0.4, 0.165, 2),
    ),
}
"""Error ÷ target, and lightness, chroma and hue (degrees) of OKLCH there."""

UNKNOWN: Final[dict[Theme, str]] = {"dark": "#3b4550", "light": "#c3cad2"}

STEPS: Final = 20
"""Classes that a figure sorts errors into, so that one style sheet colours it for each theme."""

LEGEND: Final = (0.5, 1.0, 2.0, 5.0)
"""Error ÷ target where a legend has its marks."""

SEEN: Final[dict[Theme, tuple[str, ...]]] = {
    "light": ("#e8ecf0", "#b9d7ee", "#7db7e0", "#3a8cc8", "#0a5a96"),
    "dark": ("#232c36", "#234a66", "#2f7099", "#4aa0d0", "#8ed8ff"),
}
"""Readings in a tile: none, and the classes of `seen_ends`."""

ROLES: Final[dict[Theme, dict[str, str]]] = {
    "light": {
        "paper": "#f4f6f8", "panel": "#ffffff", "raised": "#f2f5f8", "line": "#dde3e9", "strong": "#7d8894",
        "ink": "#12181f", "faint": "#525e6b", "accent": "#0a66a5", "raw": "#b96200", "corrected": "#0a72b8",
        "reject": "#c8006e", "good": "#067a56", "limited": "#8f5b00", "refused": "#c01f2e", "seam": "#ffffff",
        "unknown": UNKNOWN["light"], "next": "#12181f",
    },
    "dark": {
        "paper": "#0b0f14", "panel": "#12181f", "raised": "#1b232c", "line": "#28323d", "strong": "#637181",
        "ink": "#eef2f6", "faint": "#9aa8b7", "accent": "#58c4f5", "raw": "#f0a040", "corrected": "#58c4f5",
        "reject": "#ff5fa8", "good": "#4fd3a5", "limited": "#f2b640", "refused": "#ff7d7d", "seam": "#12181f",
        "unknown": UNKNOWN["dark"], "next": "#f3f6f9",
    },
}  # fmt: skip
"""What is drawn in which colour."""


SERIES: Final[dict[Theme, tuple[str, ...]]] = {
    "light": ("#0072b2", "#d55e00", "#009e73", "#7a5195", "#a06a00", "#c0398c"),
    "dark": ("#56b4e9", "#ff9a56", "#3ccf9f", "#b9a0f0", "#e0b84c", "#f28cc6"),
}
"""Six lines apart also for those who do not see red from green (Okabe and Ito), and for a printer."""


def colour_of(name: str, theme: Theme) -> str:
    """The colour that a style sheet means by a name: a role, a line of several, or a class of a map.

    >>> colour_of("ink", "dark"), colour_of("c1", "light"), colour_of("s1", "light")
    ('#eef2f6', '#d55e00', '#b9d7ee')
    """
    return _palette(theme)[name]


def error_colour(deg: float | None, target_deg: float, theme: Theme) -> str:
    """The colour of a predicted heading error, as ``#rrggbb``; that for "nothing is known" where it is None or NaN."""
    if deg is None or math.isnan(deg):
        return UNKNOWN[theme]
    stops = STOPS[theme]
    ratio = min(max(deg / target_deg, stops[0][0]), stops[-1][0])
    upper = next(place for place in range(1, len(stops)) if ratio <= stops[place][0])
    below, above = stops[upper - 1], stops[upper]
    share = math.log(ratio / below[0]) / math.log(above[0] / below[0])
    first, second = _lab(*below[1:]), _lab(*above[1:])
    return _hex(*(a + share * (b - a) for a, b in zip(first, second, strict=True)))


def class_of(deg: float | None, target_deg: float) -> str:
    """The class of a style sheet that an error belongs to."""
    if deg is None or math.isnan(deg):
        return "unknown"
    low, high = _ends()
    share = (math.log(max(deg, 1e-9) / target_deg) - low) / (high - low)
    return f"e{min(max(int(share * STEPS), 0), STEPS - 1)}"


def variables(theme: Theme) -> str:
    """All colours of a theme as CSS variables."""
    return " ".join(f"--{name}: {colour};" for name, colour in _palette(theme).items())


@cache
def _palette(theme: Theme) -> dict[str, str]:
    """Colours by name: roles, lines of several (c), and the classes of errors (e) and of readings (s)."""
    low, high = _ends()
    middles = [math.exp(low + (step + 0.5) / STEPS * (high - low)) for step in range(STEPS)]
    errors = [error_colour(ratio, 1.0, theme) for ratio in middles]
    series = {"c": SERIES[theme], "e": errors, "s": SEEN[theme]}
    numbered = {f"{letter}{place}": one for letter, row in series.items() for place, one in enumerate(row)}
    return ROLES[theme] | numbered


def seen_ends(share: float) -> tuple[int, int, int]:
    """Most readings of a tile in each class but the last, about a third, all and three times what is an even share.

    >>> seen_ends(15.6), seen_ends(0.3)
    ((5, 16, 47), (1, 2, 3))
    """
    first = max(1, round(share / 3.0))
    second = max(first + 1, round(share))
    return first, second, max(second + 1, round(3.0 * share))


def seen_level(count: int, ends: tuple[int, int, int]) -> int:
    """Which colour of `SEEN` a tile has with so many readings.

    >>> [seen_level(count, (5, 16, 47)) for count in (0, 2, 6, 17, 50)]
    [0, 1, 2, 3, 4]
    """
    return 1 + bisect_left(ends, count) if count else 0


def _ends() -> tuple[float, float]:
    return math.log(STOPS["light"][0][0]), math.log(STOPS["light"][-1][0])


def _lab(lightness: float, chroma: float, hue: float) -> tuple[float, float, float]:
    turn = math.radians(hue)
    return lightness, chroma * math.cos(turn), chroma * math.sin(turn)


def _hex(L: float, a: float, b: float) -> str:
    """OKLab to sRGB, cut to what a screen can show."""
    cones = (
        (L + 0.3963377774 * a + 0.2158037573 * b) ** 3,
        (L - 0.1055613458 * a - 0.0638541728 * b) ** 3,
        (L - 0.0894841775 * a - 1.291485548 * b) ** 3,
    )
    rows = (
        (4.0767416621, -3.3077115913, 0.2309699292),
        (-1.2684380046, 2.6097574011, -0.3413193965),
        (-0.0041960863, -0.7034186147, 1.707614701),
    )
    linear = (sum(factor * cone for factor, cone in zip(row, cones, strict=True)) for row in rows)
    return "#" + "".join(f"{math.floor(255.0 * _gamma(part) + 0.5):02x}" for part in linear)


def _gamma(linear: float) -> float:
    cut = min(max(linear, 0.0), 1.0)
    return 12.92 * cut if cut <= 0.0031308 else 1.055 * cut ** (1.0 / 2.4) - 0.055
