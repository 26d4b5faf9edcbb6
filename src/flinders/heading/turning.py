"""Deviations while a vehicle turns, against another instrument that gives its heading, with the lag between them.

A compass that lags by τ reads behind while it turns, by τ times the rate, and ahead while it turns the other way. Where
a vehicle turns both ways τ comes out of the readings; turned one way it looks like A, of which it then is an
uncertainty: τ is known beforehand to be 0 ± `LAG_S`.

>>> time = np.arange(0.0, 480.0, 0.5)
>>> heading = np.where(time < 240.0, 1.5 * time, 720.0 - 1.5 * time)
>>> lagged = np.interp(time - 0.6, time, heading)
>>> swing = turning(time, lagged % 360.0, (heading + 2.0) % 360.0)
>>> float(np.abs(swing.deviation_deg - 2.0).max()) < 0.1, swing.said[0][:24]
(True, 'the compass lags by 0.60')
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.errors import FitError
from flinders.geometry.angles import folded, mean_deg
from flinders.heading.deviation import LEAST, design
from flinders.heading.legs import LoggedSwing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

SECTOR_DEG: Final = 15.0
"""A reading is the mean while the compass passes one sector."""
LAG_S: Final = 1.0
"""1 σ of the lag, before it is seen."""
LEAST_READINGS: Final = 3
"""In a sector."""
STEPS: Final = 4
"""In which lag and scatter settle."""
FINEST_DEG: Final = 0.01
"""Scatter of a reading that is assumed at least."""


def turning(time: Floats, compass_deg: Floats, heading_deg: Floats) -> LoggedSwing:
    """Take a reading from each sector that the compass passes, the lag taken out.

    Parameters
    ----------
    time, compass_deg, heading_deg : (N,)
        s, degrees by the compass, and magnetic degrees by the other instrument; NaN where it has none.

    Raises
    ------
    FitError
        Where it passed fewer than five sectors.
    """
    is_known = np.isfinite(heading_deg)
    time, compass, heading = time[is_known], compass_deg[is_known], heading_deg[is_known]
    passes = _passes(compass)
    if len(passes) < LEAST:
        raise FitError(
            f"the compass passed {len(passes)} sectors of {SECTOR_DEG:g}° with another heading beside it, five "
            "coefficients need a whole circle: turn slowly all round, once each way",
            found=len(passes),
            needed=LEAST,
        )
    around = np.rad2deg(np.unwrap(np.deg2rad(heading)))
    rows = _Rows.of(time, compass, around, passes)
    lag, variance, scatter = 0.0, LAG_S**2, FINEST_DEG
    for _ in range(STEPS if rows.is_both_ways else 0):
        step, variance, scatter = rows.lag(lag)
        lag += step
        rows = _Rows.of(time, compass, np.interp(time - lag, time, around), passes)
    along = np.linalg.lstsq(design(rows.compass_deg), rows.rate, rcond=None)[0]
    return LoggedSwing(
        rows.compass_deg,
        rows.deviation_deg,
        np.full(len(passes), scatter),
        np.array([float(time[part.stop - 1] - time[part.start]) for part in passes]),
        variance * np.outer(along, along),
        (_words(lag, variance**0.5, is_both_ways=rows.is_both_ways),),
        is_steady=False,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """A reading from each pass: (N,) heading by the compass, deviation and mean rate, degrees and degrees a second."""

    compass_deg: Floats
    deviation_deg: Floats
    rate: Floats

    @classmethod
    def of(cls, time: Floats, compass_deg: Floats, heading_deg: Floats, passes: Sequence[slice]) -> Self:
        """Take the means of the passes; `heading_deg` without seams."""
        off = folded(heading_deg - compass_deg)
        ends = [(part.start, part.stop - 1) for part in passes]
        return cls(
            np.array([mean_deg(compass_deg[part]) for part in passes]),
            folded([mean_deg(off[part]) for part in passes]),
            np.array([(heading_deg[last] - heading_deg[first]) / (time[last] - time[first]) for first, last in ends]),
        )

    @property
    def is_both_ways(self) -> bool:
        """Turned one way and the other, in enough sectors each."""
        return min(int(np.sum(self.rate > 0.0)), int(np.sum(self.rate < 0.0))) >= LEAST

    def lag(self, known: float) -> tuple[float, float, float]:
        """What is left of the lag after `known` of it was taken out, s; its variance; the scatter of a reading."""
        rows, scatter = np.column_stack([design(self.compass_deg), self.rate]), 1.0
        for _ in range(STEPS):
            prior = scatter / LAG_S
            weighted = np.vstack([rows, [0.0] * LEAST + [prior]])
            solution = np.linalg.lstsq(weighted, np.append(self.deviation_deg, -prior * known), rcond=None)[0]
            residual = self.deviation_deg - rows @ solution
            scatter = max(float(np.sqrt(np.sum(residual**2) / max(len(rows) - LEAST, 1))), FINEST_DEG)
        inverse = np.linalg.pinv(weighted.T @ weighted)
        return float(solution[-1]), scatter**2 * float(inverse[-1, -1]), scatter


def _words(lag: float, sigma: float, *, is_both_ways: bool) -> str:
    """What was taken out, or assumed."""
    if is_both_ways:
        return f"the compass lags by {lag:.2f} ± {sigma:.2f} s (1 σ), which was taken out"
    return f"turned one way alone, a lag of 0 ± {sigma:g} s (1 σ) is in the uncertainty of A: turn both ways"


def _passes(compass_deg: Floats) -> list[slice]:
    """Stretches in one sector."""
    edges = np.flatnonzero(np.diff(np.floor(compass_deg / SECTOR_DEG), prepend=-1.0, append=-1.0)).tolist()
    return [slice(start, stop) for start, stop in pairwise(edges) if stop - start >= LEAST_READINGS]
