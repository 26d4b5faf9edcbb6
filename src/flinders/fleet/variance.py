"""How far offsets of a fleet differ from one recording to the next: by more than is claimed, and by more as time goes.

Between two recordings Δt apart, whose claims are P and P′, an offset changes by a vector with the covariance
λ (P + P′) + q² Δt. λ is what the place and the way of turning add to what each recording claims; q is the slow drift
that sensors of this fleet have. Both are such that, for pairs near in time and for pairs far apart, half of all
changes are as large as chance makes half of them: medians, to which units that moved mean little.

>>> rng = np.random.default_rng(1)
>>> seconds = rng.choice([60.0, 1e6], 4000)
>>> changes = rng.normal(size=(4000, 3)) * np.sqrt(2.0 * 0.02**2 + 1e-9 * seconds)[:, np.newaxis]
>>> found = estimate_variance(changes, np.tile(0.02**2 * np.eye(3), (4000, 1, 1)), seconds)
>>> f"{found.session:.1f} {found.walk**2:.0e}"                   # of claims of which two make the 2 above
'2.0 1e-09'
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

MEDIAN: Final = 2.366
"""Of chi-square with three degrees of freedom."""
FEWEST: Final = 40
"""Pairs below which claims are taken as they are."""
GROUPS: Final = 4
"""Into which pairs are sorted by how much time counts in them."""
SESSIONS: Final = np.geomspace(1.0, 100.0, 25)
WALKS: Final = 24
"""Sizes of a walk that are tried, beside none."""
YEAR: Final = 365.25 * 86400.0
DAY: Final = 86400.0


@dataclass(frozen=True, slots=True)
class Variance:
    """How offsets of a fleet scatter.

    Attributes
    ----------
    session : float
        λ, by which claimed variances are too small; 1 where they are not.
    walk : float, per root second
        q of each axis, as a fraction of the field; per root recording where no dates are known.
    pairs : int
        That it rests on.
    """

    session: float = 1.0
    walk: float = 0.0
    pairs: int = 0

    def heading_deg(self, seconds: float, *, dip_deg: float = 60.0) -> float:
        """1 σ of the heading of a level vehicle, in degrees, at the worst, that the slow drift makes in a time.

        >>> round(Variance(walk=1e-6).heading_deg(YEAR), 2)
        0.64
        """
        return math.degrees(self.walk * math.sqrt(seconds) / math.cos(math.radians(dip_deg)))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {"session": self.session, "walk_per_root_second": self.walk, "pairs": self.pairs}


def estimate_variance(changes: Floats, claimed: Floats, seconds: Floats) -> Variance:
    """Find both from pairs of recordings.

    Parameters
    ----------
    changes : (n, 3) float
        Of the offset, as a fraction of the field.
    claimed : (n, 3, 3) float
        P + P′, in the square of that.
    seconds : (n,) float
        From one recording to the other, or where no dates are known how many recordings on it is; pairs of which it is
        not known are left out.
    """
    known = np.isfinite(seconds) & np.isfinite(changes).all(axis=1)
    if np.count_nonzero(known) < FEWEST:
        return Variance(pairs=int(np.count_nonzero(known)))
    values, axes = np.linalg.eigh(claimed[known])
    values = values.clip(min=1e-30)
    squares = np.einsum("nji,nj->ni", axes, changes[known]) ** 2
    time = np.abs(seconds[known])
    groups = np.array_split(np.argsort(time / values.mean(axis=1), kind="stable"), GROUPS)
    walks = np.append(0.0, np.geomspace(1e-3, 1e3, WALKS) * _typical(squares, time))
    tried = [(session, square) for square in walks.tolist() for session in SESSIONS.tolist()]
    session, square = min(tried, key=lambda pair: _misfit(pair, squares, values, time, groups))
    factors = np.geomspace(0.7, 1.4, 9)
    finer = [(max(1.0, session * a), square * b) for b in factors.tolist() for a in factors.tolist()]
    session, square = min(finer, key=lambda pair: _misfit(pair, squares, values, time, groups))
    return Variance(float(session), math.sqrt(square), len(time))


def _typical(squares: Floats, time: Floats) -> float:
    """A walk, squared, that alone would make the changes."""
    far = time > 0.0
    if not far.any():
        return 0.0
    return float(np.median(squares[far].sum(axis=1) / time[far]) / MEDIAN)


def _misfit(
    pair: tuple[float, float], squares: Floats, values: Floats, time: Floats, groups: list[np.ndarray[Any, Any]]
) -> float:
    """How far the median of each group is from what chance makes it, and how far the claims are from being believed."""
    session, square = pair
    chi_square = np.sum(squares / (session * values + square * time[:, np.newaxis]), axis=1)
    medians = np.array([np.median(chi_square[group]) for group in groups]).clip(min=1e-300)
    return float(np.sum(np.log(medians / MEDIAN) ** 2)) + 1e-4 * math.log(session)
