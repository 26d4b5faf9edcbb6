"""How fast an offset walks at random: a rate per root hour, and how well it is known.

>>> Walk.known(0.1).heading_deg(86400.0, radius=50.0, dip_deg=60.0) > 1.0           # 0.1 µT/√h: a degree in a day
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

from flinders.errors import UsageError, figures

HOUR_S: Final = 3600.0
KNOWN_FACTOR: Final = 2.0
"""Within which a rate is known that is a bare number, 1 σ."""
BOUND: Final = 1.96
"""Standard deviations of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class Walk:
    """How fast an offset walks.

    >>> print(Walk.known(0.1))
    0.10 (0.026 to 0.39) per root hour
    """

    rate: float  #: by which it moves in an hour along each axis, 1 σ, in the unit of the offset; it grows with √t
    low: float  #: of the 95 % interval
    high: float

    @classmethod
    def known(cls, rate: float, factor: float = KNOWN_FACTOR) -> Self:
        """A rate that is known within a factor, 1 σ; `UsageError` for one that is not positive."""
        if not (0.0 < rate < math.inf and factor > 1.0):
            raise UsageError(f"walk is {rate:g}: need what the offset moves in an hour, 1 σ, a positive number")
        wide = factor**BOUND
        return cls(rate, rate / wide, rate * wide)

    @property
    def log_sigma(self) -> float:
        """1 σ of the natural logarithm of the rate."""
        return math.log(self.high / self.low) / (2.0 * BOUND)

    def heading_deg(self, seconds: float, *, radius: float, dip_deg: float) -> float:
        """Worst 1 σ of the heading of a level vehicle, in degrees, that the walk makes in a time."""
        moved = self.rate * math.sqrt(seconds / HOUR_S)
        return math.degrees(moved / (radius * math.cos(math.radians(dip_deg))))

    def __str__(self) -> str:
        return f"{figures(self.rate)} ({figures(self.low)} to {figures(self.high)}) per root hour"

    def scaled(self, factor: float) -> Self:
        """The same in another unit, of which the old one is `factor`."""
        return type(self)(self.rate * factor, self.low * factor, self.high * factor)


PRIOR_WALK: Final = Walk(0.0065, 0.0003, 0.02)
"""Walk of a unit without a history, as a share of the field: root mean square and 95 % range of the rates that a
calibration that goes on thinks of beforehand (``knowledge.c``)."""
