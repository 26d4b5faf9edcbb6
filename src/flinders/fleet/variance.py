"""Variance of offsets between recordings of a fleet: a factor on the claimed variances, and a random walk over time.

Between two recordings Δt apart with covariances P and P′, an offset changes by a vector with the covariance
λ (P + P′) + q² Δt. The variance factor λ is what place and motion add to what each recording claims; q is the random
walk of sensors of this fleet. Both are estimated from medians of chi-square over pairs with small and with large Δt,
to which units that moved mean little.

>>> rng = np.random.default_rng(1)
>>> seconds = rng.choice([60.0, 1e6], 4000)
>>> changes = rng.normal(size=(4000, 3)) * np.sqrt(2.0 * 0.02**2 + 1e-9 * seconds)[:, np.newaxis]
>>> variance = estimate_variance(changes, np.tile(0.02**2 * np.eye(3), (4000, 1, 1)), seconds)
>>> f"{variance.factor:.1f} {variance.random_walk**2:.0e}"
'2.0 1e-09'
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fleet.history import OffsetSeries

MEDIAN: Final = 2.366
"""Median of chi-square with three degrees of freedom."""
MOST_PAIRS: Final = 20_000
"""Pairs of recordings from which the variance of a fleet is estimated, at most."""
FEWEST: Final = 40
"""Pairs below which claims are not changed."""
GROUPS: Final = 4
"""Groups of pairs, by the share of time in their variance."""
FACTORS: Final = np.geomspace(1.0, 100.0, 25)
WALKS: Final = 24
"""Sizes of a random walk that are tried, besides none."""
YEAR: Final = 365.25 * 86400.0


@dataclass(frozen=True, slots=True)
class Variance:
    """Variance of offsets between recordings."""

    factor: float = 1.0  # λ, by which claimed variances are too small; 1 if they are not
    # per root second, q of each axis, as a fraction of the field; per root recording if dates are not known
    random_walk: float = 0.0
    pairs: int = 0  # number of pairs

    def heading_deg(self, seconds: float, *, dip_deg: float = 60.0) -> float:
        """Worst 1 σ of the heading of a level vehicle, in degrees, that the random walk makes in a time.

        >>> round(Variance(random_walk=1e-6).heading_deg(YEAR), 2)
        0.64
        """
        return math.degrees(self.random_walk * math.sqrt(seconds) / math.cos(math.radians(dip_deg)))


def estimate_variance(changes: Floats, claimed: Floats, seconds: Floats) -> Variance:
    """Estimate both from pairs: (n, 3) changes as fractions of the field, (n, 3, 3) P + P′ in its square, (n,) times.

    Pairs with a time of NaN are left out; without dates a time is a number of recordings.
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
    tried = [(factor, square) for square in walks.tolist() for factor in FACTORS.tolist()]
    factor, square = min(tried, key=lambda pair: _misfit(pair, squares, values, time, groups))
    steps = np.geomspace(0.7, 1.4, 9)
    finer = [(max(1.0, factor * a), square * b) for b in steps.tolist() for a in steps.tolist()]
    factor, square = min(finer, key=lambda pair: _misfit(pair, squares, values, time, groups))
    return Variance(float(factor), math.sqrt(square), len(time))


def _typical(squares: Floats, time: Floats) -> float:
    """Squared random walk that alone would explain the changes."""
    far = time > 0.0
    if not far.any():
        return 0.0
    return float(np.median(squares[far].sum(axis=1) / time[far]) / MEDIAN)


def _misfit(
    pair: tuple[float, float], squares: Floats, values: Floats, time: Floats, groups: list[np.ndarray[Any, Any]]
) -> float:
    """Distance of the medians of chi-square from that of chance, with a slight preference for a small factor."""
    factor, square = pair
    chi_square = np.sum(squares / (factor * values + square * time[:, np.newaxis]), axis=1)
    medians = np.array([np.median(chi_square[group]) for group in groups]).clip(min=1e-300)
    return float(np.sum(np.log(medians / MEDIAN) ** 2)) + 1e-4 * math.log(factor)


@dataclass(slots=True)
class PairSample:
    """A sample of pairs of recordings, of every `stride`-th unit; if it grows too large, the stride is doubled."""

    stride: int = 1
    parts: list[tuple[int, Floats, Floats, Floats]] = field(default_factory=list)

    def add(self, number: int, series: OffsetSeries, first: int, count: int) -> None:
        """Add the unit of this number in the whole fleet."""
        if number % self.stride == 0:
            self.parts.append((number, *_pairs(series, first, count)))

    def bound(self) -> None:
        """Reduce to `MOST_PAIRS`."""
        while sum(len(part[3]) for part in self.parts) > MOST_PAIRS and len(self.parts) > 1:
            self.stride *= 2
            self.parts = [part for part in self.parts if part[0] % self.stride == 0] or self.parts[:1]

    def variance(self) -> Variance:
        """Estimate the variance from all pairs."""
        if not self.parts:
            return Variance()
        _, changes, claimed, times = zip(*self.parts, strict=True)
        return estimate_variance(np.concatenate(changes), np.concatenate(claimed), np.concatenate(times))

    def typical_time(self) -> float:
        """Median time between the recordings of a pair."""
        return float(np.median(np.concatenate([part[3] for part in self.parts])))


def _pairs(series: OffsetSeries, first: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Pairs of successive recordings of one unit, and the first with the last; a bounded number."""
    a = np.arange(first, first + count - 1)[:20]
    b = a + 1
    if count > 2:
        a, b = np.append(a, first), np.append(b, first + count - 1)
    claimed = series.covariance[a] + series.covariance[b]
    return series.offset[b] - series.offset[a], claimed, series.time[b] - series.time[a]
