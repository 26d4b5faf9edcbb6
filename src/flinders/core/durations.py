"""Durations written in a suitable unit, seconds to years.

>>> [duration_text(seconds) for seconds in (40.0, 700.0, 2e4, 1e6, 1e8, math.inf)]
['40 s', '12 min', '5.6 h', '12 days', '3.2 years', 'any time']
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.language import ENGLISH
from flinders.errors import figures

if TYPE_CHECKING:
    from flinders.core.language import Language

UNITS: Final = (("years", 365.25 * 86400.0, 1.0), ("days", 86400.0, 2.0), ("h", 3600.0, 1.0), ("min", 60.0, 1.0))
"""Units of a duration: name, size in seconds, and smallest count from which a duration is written in this unit."""


def duration_text(seconds: float, language: Language = ENGLISH) -> str:
    """Write a duration to two digits in a suitable unit."""
    if math.isinf(seconds):
        return language.phrase("duration.any", "any time")
    unit, size = next(((unit, size) for unit, size, least in UNITS if seconds >= least * size), ("s", 1.0))
    return f"{language.numeral(figures(seconds / size))} {language.phrase(f'duration.{unit}', unit)}"
