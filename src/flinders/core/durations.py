"""Durations written in a suitable unit, seconds to years.

>>> [duration_text(seconds) for seconds in (40.0, 700.0, 2e4, 1e6, 1e8, math.inf)]
['40 s', '12 min', '5.6 h', '12 days', '3.2 years', 'any time']
"""

from __future__ import annotations

import math
from typing import Final

from flinders.errors import figures

UNITS: Final = (("years", 365.25 * 86400.0, 1.0), ("days", 86400.0, 2.0), ("h", 3600.0, 1.0), ("min", 60.0, 1.0))
"""Units of a duration: name, size in seconds, and smallest count from which a duration is written in this unit."""


def duration_text(seconds: float) -> str:
    """Write a duration to two digits in a suitable unit."""
    if math.isinf(seconds):
        return "any time"
    for unit, size, least in UNITS:
        if seconds >= least * size:
            return f"{figures(seconds / size)} {unit}"
    return f"{figures(seconds)} s"
