"""Random walk of an offset: its rate per root hour, and the uncertainty of the rate.

>>> Walk.from_rate(0.1).heading_deg(86400.0, radius=50.0, dip_deg=60.0) > 1.0           # 0.1 µT/√h: a degree in a day
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

from flinders.errors import UsageError, figures

HOUR_S: Final = 3600.0
RATE_FACTOR: Final = 2.0
"""Assumed 1 σ, as a factor, of a rate that is stated without an uncertainty."""
SIGMAS_95: Final = 1.96
"""Standard deviations of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class Walk:
    """Rate of the random walk of an offset, with its 95 % interval.

    >>> print(Walk.from_rate(0.1))
    0.10 (0.026 to 0.39) per root hour
    """

    rate: float  #: in the unit of the offset: 1 σ of the change of each axis in one hour; the change grows with √t
    low: float  #: lower end of the rate's 95 % interval
    high: float  #: upper end of the rate's 95 % interval

    @classmethod
    def from_rate(cls, rate: float, factor: float = RATE_FACTOR) -> Self:
        """Make a walk from a rate and 1 σ of the rate, as a factor.

        Raises `UsageError` unless the rate is positive.
        """
        if not (0.0 < rate < math.inf and factor > 1.0):
            raise UsageError(f"walk is {rate:g}: need a positive number, the change of the offset in one hour, 1 σ")
        wide = factor**SIGMAS_95
        return cls(rate, rate / wide, rate * wide)

    @property
    def log_sigma(self) -> float:
        """1 σ of the natural logarithm of the rate."""
        return math.log(self.high / self.low) / (2.0 * SIGMAS_95)

    def heading_deg(self, seconds: float, *, radius: float, dip_deg: float) -> float:
        """Heading error (1 σ) in degrees of a level vehicle at the worst heading, after `seconds` of the walk."""
        moved = self.rate * math.sqrt(seconds / HOUR_S)
        return math.degrees(moved / (radius * math.cos(math.radians(dip_deg))))

    def __str__(self) -> str:
        return f"{figures(self.rate)} ({figures(self.low)} to {figures(self.high)}) per root hour"

    def scale_rate(self, factor: float) -> Self:
        """The same walk in another unit; `factor` is the size of the old unit in the new one."""
        return type(self)(self.rate * factor, self.low * factor, self.high * factor)


PRIOR_WALK: Final = Walk(0.0065, 0.0003, 0.02)
"""Prior of the walk of a unit without a history, as shares of the field: rms and 95 % range of the rate.

It is the prior of the online calibration (``knowledge.c``).
"""
