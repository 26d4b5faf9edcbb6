"""A deviation curve held against the largest deviation that a rule allows.

>>> from flinders.heading.deviation import fit
>>> swing = fit(range(0, 360, 30), [3, 4, 2, 0, -1, -2, -3, -4, -2, 0, 1, 2])
>>> [conformity(swing, limit).verdict for limit in (10.0, 4.0, 3.0)]
['within', 'open', 'beyond']
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.heading.deviation import Deviation

SURE: Final = 2.0
"""Standard deviations of the curve that have to fit inside the limit too."""


@dataclass(frozen=True, slots=True)
class Conformity:
    """What decides whether a curve keeps a limit: the reading or the place on the curve that comes nearest to it."""

    limit_deg: float
    largest_deg: float  # deviation there, without its sign
    compass_deg: float
    sigma_deg: float | None  # of the curve there; None where it is not known
    is_reading: bool  # of the swing, and not of the curve

    @property
    def verdict(self) -> str:
        """``beyond`` the limit, ``within`` it with two standard deviations to spare, and else ``open``."""
        if self.largest_deg > self.limit_deg:
            return "beyond"
        is_sure = self.sigma_deg is not None and self.largest_deg + SURE * self.sigma_deg <= self.limit_deg
        return "within" if is_sure else "open"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {**values, "verdict": self.verdict}


def conformity(deviation: Deviation, limit_deg: float) -> Conformity:
    """Hold against a limit the readings of a swing, none of which may be beyond, and the curve at whole degrees."""
    around, observed = np.arange(360.0), np.abs(deviation.observed_deg)
    curve, sigma = np.abs(deviation.at(around)), deviation.sigma_at(around)
    worst = int(observed.argmax())
    if observed[worst] > max(limit_deg, float(curve.max())):
        return Conformity(limit_deg, float(observed[worst]), float(deviation.compass_deg[worst]), None, True)
    is_beyond = bool(curve.max() > limit_deg)
    place = int((curve if is_beyond or sigma is None else curve + SURE * sigma).argmax())
    known = None if sigma is None else float(sigma[place])
    return Conformity(limit_deg, float(curve[place]), float(around[place]), known, False)
