"""Change points: where the offset of a sensor jumped from one recording to the next, as when a battery was moved.

For each interval between two recordings the offset before it is estimated from the recordings before, and the offset
after it from those after, each by a Kalman filter with a slow random walk. A step is the difference, beyond the
uncertainty of both and of the random walk over the interval:

    z = sᵀ (P₋ + P₊ + q² Δt)⁻¹ s,     s = b₊ − b₋

which is chi-square with three degrees of freedom if nothing moved. If other intervals show that a unit drifts faster
than its fleet, its own drift is used, and z/3 is F-distributed. With three recordings or more, a step must also
be significant on top of a straight line: by the decrease in χ², again with three degrees of freedom.

>>> from flinders.apps.fleet.history import OffsetSeries
>>> rng = np.random.default_rng(3)
>>> offset = rng.normal(size=(8, 3)) * 0.002 + np.where(np.arange(8) >= 5, 0.03, 0.0)[:, np.newaxis]
>>> line = OffsetSeries(np.array([0, 8]), np.arange(8) * 86400.0, offset, np.tile(0.002**2 * np.eye(3), (8, 1, 1)))
>>> [(step.after, step.p_value < 1e-9) for step in change_points(line, Variance(), chance=1e-3)]
[(4, True)]

Two recordings Δt apart, with covariances P and P′, differ by a vector with the covariance λ (P + P′) + q² Δt. The
variance factor λ accounts for the place and motion of a recording, which its claimed covariance leaves out; q is the
random walk of the sensors of this fleet. Both are estimated from medians of chi-square over pairs with small and with
large Δt, on which the few units that moved have little effect.

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
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.pairs import p_values
from flinders.summary.pooling import p_value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.history import OffsetSeries
    from flinders.arrays import Floats

    Places = NDArray[np.intp]

CHI_SQUARE_MEDIAN: Final = 2.366
"""Median of chi-square with three degrees of freedom."""
MAX_PAIRS: Final = 20_000
"""Largest number of pairs of recordings from which the variance of a fleet is estimated."""
MIN_PAIRS: Final = 40
"""Smallest number of pairs from which a variance is estimated; with fewer, claimed covariances stay as they are."""
GROUPS: Final = 4
"""Number of groups of pairs, by the ratio of time to claimed variance."""
FACTORS: Final = np.geomspace(1.0, 100.0, 25)
"""Variance factors that are tried."""
WALKS: Final = 24
"""Number of random walks that are tried, besides zero."""
YEAR_S: Final = 365.25 * 86400.0


@dataclass(frozen=True, slots=True)
class Variance:
    """Variance of the offset from one recording to another: a factor on claimed variances, and a random walk."""

    factor: float = 1.0  # λ: the true variance is λ times the claimed one; 1 or more
    # q of each axis, as a fraction of the field per √s; per √recording if dates are not known
    random_walk: float = 0.0
    pairs: int = 0  # number of pairs

    def heading_deg(self, seconds: float, *, dip_deg: float = 60.0) -> float:
        """Worst 1 σ heading error, in degrees, of a level vehicle after a random walk of so many seconds.

        >>> round(Variance(random_walk=1e-6).heading_deg(YEAR_S), 2)
        0.64
        """
        return math.degrees(self.random_walk * math.sqrt(seconds) / math.cos(math.radians(dip_deg)))


def estimate_variance(changes: Floats, claimed: Floats, seconds: Floats) -> Variance:
    """Estimate variance factor and random walk from n pairs of recordings.

    `changes` (n, 3) of the offset are fractions of the field, and `claimed` (n, 3, 3) are the covariances P + P′ of
    these fractions. Pairs with a time of NaN are left out. Without dates, `seconds` are numbers of recordings.
    """
    known = np.isfinite(seconds) & np.isfinite(changes).all(axis=1)
    if np.count_nonzero(known) < MIN_PAIRS:
        return Variance(pairs=int(np.count_nonzero(known)))
    values, axes = np.linalg.eigh(claimed[known])
    values = values.clip(min=1e-30)
    squares = np.einsum("nji,nj->ni", axes, changes[known]) ** 2
    time = np.abs(seconds[known])
    groups = np.array_split(np.argsort(time / values.mean(axis=1), kind="stable"), GROUPS)
    walks = np.append(0.0, np.geomspace(1e-3, 1e3, WALKS) * _typical_walk(squares, time))
    pairs = _Pairs(squares, values, time, groups)
    factor, square = pairs.nearest(FACTORS, walks)
    steps = np.geomspace(0.7, 1.4, 9)
    factor, square = pairs.nearest(np.maximum(1.0, factor * steps), square * steps)
    return Variance(factor, math.sqrt(square), len(time))


def _typical_walk(squares: Floats, time: Floats) -> float:
    """Squared random walk of each axis that would explain the changes without errors of the calibrations."""
    far = time > 0.0
    if not far.any():
        return 0.0
    return float(np.median(squares[far].sum(axis=1) / time[far]) / CHI_SQUARE_MEDIAN)


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Squared changes and claimed variances of n pairs of recordings, along axes of their claimed covariance."""

    squares: Floats  # (n, 3) squared changes
    values: Floats  # (n, 3) claimed variances
    time: Floats  # (n,) time between both recordings, s
    groups: list[Places]  # indices of pairs, grouped by the ratio of time to claimed variance

    def nearest(self, factors: Floats, walks: Floats) -> tuple[float, float]:
        """Variance factor and squared random walk with the smallest misfit, among those given."""
        misfits = np.stack([self._misfits(factors, walk) for walk in walks.tolist()])
        row, column = np.unravel_index(int(np.argmin(misfits)), misfits.shape)
        return float(factors[column]), float(walks[row])

    def _misfits(self, factors: Floats, walk: float) -> Floats:
        """(F,) misfit of each factor: squared log ratios of the groups' median chi-square to the expected median.

        A small penalty on the factor is added, so that of equal misfits the smallest factor wins.
        """
        drift, axes = walk * self.time, zip(self.squares.T, self.values.T, strict=True)
        chi_square = np.add.reduce([square / (factors[:, np.newaxis] * value + drift) for square, value in axes])
        medians = np.stack([np.median(chi_square[:, group], axis=1) for group in self.groups]).clip(min=1e-300)
        misfits: Floats = np.sum(np.log(medians / CHI_SQUARE_MEDIAN) ** 2, axis=0) + 1e-4 * np.log(factors)
        return misfits


@dataclass(slots=True)
class PairSample:
    """A sample of pairs of recordings, of every `stride`-th unit; if it grows too large, the stride is doubled."""

    stride: int = 1
    parts: list[tuple[int, Floats, Floats, Floats]] = field(default_factory=list)

    def add(self, number: int, series: OffsetSeries, first: int, count: int) -> None:
        """Add the pairs of a unit; `number` counts the units of the whole fleet."""
        if number % self.stride == 0:
            self.parts.append((number, *_pairs(series, first, count)))

    def bound(self) -> None:
        """Drop units until at most `MAX_PAIRS` pairs are left."""
        while sum(len(part[3]) for part in self.parts) > MAX_PAIRS and len(self.parts) > 1:
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
    """At most 20 pairs of successive recordings of one unit, and the pair of its first and last."""
    a = np.arange(first, first + count - 1)[:20]
    b = a + 1
    if count > 2:
        a, b = np.append(a, first), np.append(b, first + count - 1)
    claimed = series.covariance[a] + series.covariance[b]
    return series.offset[b] - series.offset[a], claimed, series.time[b] - series.time[a]


MAX_SIDE_RECORDINGS: Final = 6
"""Largest number of recordings that are used on either side of an interval."""
OWN_DRIFT_SIGNIFICANCE: Final = 0.05
"""Significance at which the other intervals show that a unit drifts faster than its fleet."""
INTERVAL_FREEDOM: Final = 2
"""Degrees of freedom of each interval in a unit's own drift, which is the lower median over its intervals."""


@dataclass(frozen=True, slots=True, eq=False)
class ChangePoint:
    """A change point of an offset: the interval between two recordings in which it moved."""

    after: int  # index in `OffsetSeries` of the last recording before it
    moved: Floats  # (3,) change of the offset, as a fraction of the field
    p_value: float  # of the test of this interval


@dataclass(frozen=True, slots=True, eq=False)
class IntervalTests:
    """Results of the test of G intervals between recordings for a step of the offset."""

    segment: Places  # (G,) its segment of recordings
    after: Places  # (G,) index of the last recording before it
    moved: Floats  # (G, 3) the step, as a fraction of the field
    p_value: Floats  # (G,) probability of a step at least as large by chance
    chi_square: Floats  # (G,) of the step
    square: Floats  # (G,) squared random walk for this interval

    def best(self, chance: float) -> Places:
        """(B,) the most significant interval of each segment, if it is significant at `chance`."""
        order = np.lexsort((-self.chi_square, self.p_value, self.segment))
        is_first = np.diff(self.segment[order], prepend=-1) > 0
        best = order[is_first]
        return best[self.p_value[best] < chance]


def change_points(series: OffsetSeries, variance: Variance, *, chance: float) -> list[ChangePoint]:
    """Change points significant at `chance`, in the order of recordings.

    After one is found, the recordings on each side of it are searched again.
    """
    cuts: list[Places] = []
    begin, end = series.first[:-1], series.first[1:]
    while len(begin):
        tests = interval_tests(series, begin, end, variance)
        best = tests.best(chance)
        beyond_line = [_step_chi_square(series, tests, place, (begin, end), variance) for place in best.tolist()]
        best = best[p_values(np.array(beyond_line), np.full(len(best), 3)) < chance]
        cut, segment = tests.after[best] + 1, tests.segment[best]
        cuts.append(cut)
        begin, end = np.concatenate([begin[segment], cut]), np.concatenate([cut, end[segment]])
    return _test_again(series, np.sort(np.concatenate([*cuts, series.first[:0]])), variance, chance)


def _test_again(series: OffsetSeries, cuts: Places, variance: Variance, chance: float) -> list[ChangePoint]:
    """Test each step again between its neighbouring steps: a step found early may be an artefact of two later ones."""
    if not len(cuts):
        return []
    ends = np.union1d(cuts, series.first)
    at = np.searchsorted(ends, cuts)
    tests = interval_tests(series, ends[at - 1], ends[at + 1], variance)
    here = np.flatnonzero(tests.after + 1 == cuts[tests.segment])
    here = here[tests.p_value[here] < chance]
    return [
        ChangePoint(int(tests.after[place]), tests.moved[place], float(tests.p_value[place])) for place in here.tolist()
    ]


def interval_tests(series: OffsetSeries, begin: Places, end: Places, variance: Variance) -> IntervalTests:
    """Test each interval between two recordings of S segments: the offset after it against the offset before it.

    Segment s has the recordings from `begin[s]` up to, but without, `end[s]`.
    """
    count = np.maximum(end - begin - 1, 0)
    segment = np.repeat(np.arange(len(begin)), count)
    after = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count) + begin[segment]
    low, high = begin[segment], end[segment]
    if not len(after):
        return IntervalTests(segment, after, np.empty((0, 3)), np.empty(0), np.empty(0), np.empty(0))
    square, freedom = _random_walks(series, after, low, high, variance)
    before, before_sigma = _estimates(series, after, -1, (low, high), square, variance)
    behind, behind_sigma = _estimates(series, after + 1, 1, (low, high), square, variance)
    moved = behind - before
    interval = np.abs(series.time[after + 1] - series.time[after])
    covariance = before_sigma + behind_sigma + (square * interval)[:, np.newaxis, np.newaxis] * np.eye(3)
    chi_square = _whitened_squares(moved, covariance)
    p_value = p_values(chi_square, np.full(len(after), 3))
    for place in np.flatnonzero(freedom).tolist():
        p_value[place] = p_value_of(float(chi_square[place]), 3, others=float(freedom[place]))
    return IntervalTests(segment, after, moved, p_value, chi_square, square)


def _estimates(
    series: OffsetSeries,
    places: Places,
    direction: int,
    ends: tuple[Places, Places],
    square: Floats,
    variance: Variance,
) -> tuple[Floats, Floats]:
    """(G, 3) Kalman estimates of the offset at G recordings and their (G, 3, 3) covariances.

    An estimate uses the recording itself and the recordings on one side of it: `direction` is −1 for earlier, 1 for
    later ones.
    """
    information, weighted = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3, 1))
    origin = series.offset[places]
    for steps in range(MAX_SIDE_RECORDINGS - 1, -1, -1):
        here = places + direction * steps
        is_there = (here >= ends[0]) & (here < ends[1])
        here = np.where(is_there, here, places)
        nearer = np.where(is_there, here - direction * min(steps, 1), places)
        precision = np.linalg.inv(variance.factor * series.covariance[here]) * is_there[:, np.newaxis, np.newaxis]
        information = information + precision
        weighted = weighted + precision @ (series.offset[here] - origin)[:, :, np.newaxis]
        added = square * np.abs(series.time[nearer] - series.time[here])
        shrink = np.linalg.inv(np.eye(3) + added[:, np.newaxis, np.newaxis] * information)  # (1 + q² Δt Λ)⁻¹
        information, weighted = shrink @ information, shrink @ weighted
    covariance = np.linalg.inv(information)
    return origin + (covariance @ weighted)[:, :, 0], covariance


def _step_chi_square(
    series: OffsetSeries, tests: IntervalTests, place: int, ends: tuple[Places, Places], variance: Variance
) -> float:
    """Decrease in chi-square by a step on top of a straight line; infinite for two recordings, which allow no test."""
    segment, after = tests.segment[place], int(tests.after[place])
    first, end = (
        max(int(ends[0][segment]), after + 1 - MAX_SIDE_RECORDINGS),
        min(int(ends[1][segment]), after + 1 + MAX_SIDE_RECORDINGS),
    )
    if end - first < 3:
        return np.inf
    time = series.time[first:end] - series.time[first]
    covariance = np.kron(tests.square[place] * np.minimum(time[:, np.newaxis], time), np.eye(3))
    for row in range(end - first):
        inside = slice(3 * row, 3 * row + 3)
        covariance[inside, inside] += variance.factor * series.covariance[first + row]
    offset = (series.offset[first:end] - series.offset[first]).ravel()
    trend = [np.ones(len(time)), time / max(float(time[-1]), np.finfo(float).tiny)]
    step = (np.arange(first, end) > after).astype(float)
    return _chi_square(offset, trend, covariance) - _chi_square(offset, [*trend, step], covariance)


def _chi_square(offset: Floats, regressors: Sequence[Floats], covariance: Floats) -> float:
    """Chi-square of (3 n,) offsets about a combination of regressors (n,), fitted to each axis."""
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    design = root @ np.kron(np.stack(regressors, axis=1), np.eye(3))
    whitened = root @ offset
    about = whitened - design @ np.linalg.lstsq(design, whitened, rcond=None)[0]
    return float(about @ about)


def _random_walks(
    series: OffsetSeries, after: Places, low: Places, high: Places, variance: Variance
) -> tuple[Floats, Floats]:
    """(G,) squared random walk q² of each interval, and degrees of freedom of q²: 0 for the q of the fleet."""
    excess, chi_square = _successive_walks(series, variance)
    around = np.concatenate([np.arange(1 - MAX_SIDE_RECORDINGS, 0), np.arange(1, MAX_SIDE_RECORDINGS)])
    others = after[:, np.newaxis] + around
    is_there = (others >= low[:, np.newaxis]) & (others < high[:, np.newaxis] - 1)
    others = np.where(is_there, others, 0)
    is_there &= np.isfinite(excess[others])
    count = is_there.sum(axis=1)
    odd = p_values(np.where(is_there, chi_square[others], 0.0).sum(axis=1), 3 * count) < OWN_DRIFT_SIGNIFICANCE
    sizes = np.sort(np.where(is_there, excess[others], np.inf), axis=1)
    own = sizes[np.arange(len(after)), np.maximum(count - 1, 0) // 2]
    faster = odd & (count > 0) & (own > variance.random_walk**2)
    return np.where(faster, own, variance.random_walk**2), np.where(faster, INTERVAL_FREEDOM * count, 0).astype(float)


def _successive_walks(series: OffsetSeries, variance: Variance) -> tuple[Floats, Floats]:
    """(R − 1,) squared random walk of each change between successive recordings, and chi-square of the change.

    The random walk is NaN if both recordings have the same time.
    """
    changes, interval = np.diff(series.offset, axis=0), np.abs(np.diff(series.time))
    noise = variance.factor * (series.covariance[1:] + series.covariance[:-1])
    beyond = np.sum(changes**2, axis=1) - np.einsum("nii->n", noise)
    excess = beyond.clip(min=0.0) / np.where(interval > 0.0, interval, np.nan) / CHI_SQUARE_MEDIAN
    added = (variance.random_walk**2 * interval)[:, np.newaxis, np.newaxis] * np.eye(3)
    return excess, _whitened_squares(changes, noise + added)


def _whitened_squares(vectors: Floats, covariance: Floats) -> Floats:
    """(n,) vᵀ C⁻¹ v of (n, 3) vectors v with (n, 3, 3) covariances C."""
    squares: Floats = np.einsum("ni,ni->n", vectors, np.linalg.solve(covariance, vectors[:, :, np.newaxis])[:, :, 0])
    return squares
