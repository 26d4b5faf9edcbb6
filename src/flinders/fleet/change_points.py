"""Change points: where a sensor's offset jumped from one recording to the next, as where a battery was moved.

For each gap between two recordings the offset just before it is estimated from those before, and the offset just after
it from those after, each by a Kalman filter that lets the offset walk slowly. A step is what they differ by, beyond
what both are uncertain by and what the walk makes across the gap:

    z = sᵀ (P₋ + P₊ + q² Δt)⁻¹ s,     s = b₊ − b₋

which chance makes chi-square with three degrees of freedom. A unit whose other gaps show that it drifts faster than
its fleet is held against its own drift, and z/3 is F then. Of three recordings or more, a step must show as well on top
of an offset that drifts along a straight line: what takes off as much, of χ² with three degrees of freedom.

>>> rng = np.random.default_rng(3)
>>> offset = rng.normal(size=(8, 3)) * 0.002 + np.where(np.arange(8) >= 5, 0.03, 0.0)[:, np.newaxis]
>>> line = OffsetSeries(np.array([0, 8]), np.arange(8) * 86400.0, offset, np.tile(0.002**2 * np.eye(3), (8, 1, 1)))
>>> [(step.after, step.p_value < 1e-9) for step in change_points(line, Variance(), chance=1e-3)]
[(4, True)]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.batch import chances
from flinders.fleet.variance import MEDIAN, Variance
from flinders.summary.pooling import chance_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

    Places = NDArray[np.intp]

SIDE: Final = 6
"""Recordings on either side of a gap that are looked at."""
ODD: Final = 0.05
"""Other gaps that chance makes less often than this show a drift of the unit's own."""
EACH: Final = 2
"""Degrees of freedom that a gap gives to a unit's own drift, which is taken as their lower median."""


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSeries:
    """Offsets of many units over time.

    Attributes
    ----------
    first : (U + 1,) int
        Where the recordings of each unit begin, in the order of time; and the end of the last.
    time : (R,) float, s
        Or where no dates are known the number of each recording.
    offset : (R, 3) float
        As a fraction of the field.
    covariance : (R, 3, 3) float
    """

    first: Places
    time: Floats
    offset: Floats
    covariance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ChangePoint:
    """A change point.

    Attributes
    ----------
    after : int
        The recording just before it, of all in `OffsetSeries`.
    moved : (3,) float
        By what the offset changed, as a fraction of the field.
    p_value : float
        How often chance makes one gap show as much.
    """

    after: int
    moved: Floats
    p_value: float


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """What each of G gaps shows.

    Attributes
    ----------
    stretch : (G,) int
        In which stretch of recordings it is.
    after : (G,) int
        The recording before it.
    moved : (G, 3) float
        The step.
    p_value : (G,) float
        How often chance makes as much of one.
    chi_square : (G,) float
        Of that step.
    square : (G,) float
        The walk, squared, that it was held against.
    """

    stretch: Places
    after: Places
    moved: Floats
    p_value: Floats
    chi_square: Floats
    square: Floats

    def best(self, chance: float) -> Places:
        """(B,) the gap of each stretch that chance explains least, where that is less often than `chance`."""
        order = np.lexsort((-self.chi_square, self.p_value, self.stretch))
        is_first = np.diff(self.stretch[order], prepend=-1) > 0
        best = order[is_first]
        return best[self.p_value[best] < chance]


def change_points(lines: OffsetSeries, scatter: Variance, *, chance: float) -> list[ChangePoint]:
    """Find change points; a unit that has one is looked at again on either side of it.

    Parameters
    ----------
    lines : OffsetSeries
    scatter : Variance
        Of the fleet.
    chance : float
        A gap is a step where chance makes as much of one less often than this.

    Returns
    -------
    list of ChangePoint
        In the order of recordings.
    """
    cuts: list[Places] = []
    begin, end = lines.first[:-1], lines.first[1:]
    while len(begin):
        gaps = interval_tests(lines, begin, end, scatter)
        best = gaps.best(chance)
        on_line = [_on_a_line(lines, gaps, place, (begin, end), scatter) for place in best.tolist()]
        best = best[chances(np.array(on_line), np.full(len(best), 3)) < chance]
        cut, stretch = gaps.after[best] + 1, gaps.stretch[best]
        cuts.append(cut)
        begin, end = np.concatenate([begin[stretch], cut]), np.concatenate([cut, end[stretch]])
    return _once_more(lines, np.sort(np.concatenate([*cuts, lines.first[:0]])), scatter, chance)


def _once_more(lines: OffsetSeries, cuts: Places, scatter: Variance, chance: float) -> list[ChangePoint]:
    """Look at each step once more, between those beside it: one found early may have been the shadow of two others."""
    if not len(cuts):
        return []
    ends = np.union1d(cuts, lines.first)
    at = np.searchsorted(ends, cuts)
    gaps = interval_tests(lines, ends[at - 1], ends[at + 1], scatter)
    here = np.flatnonzero(gaps.after + 1 == cuts[gaps.stretch])
    here = here[gaps.p_value[here] < chance]
    return [
        ChangePoint(int(gaps.after[place]), gaps.moved[place], float(gaps.p_value[place])) for place in here.tolist()
    ]


def interval_tests(lines: OffsetSeries, begin: Places, end: Places, scatter: Variance) -> Gaps:
    """Hold what is before each gap against what is after it.

    Parameters
    ----------
    lines : OffsetSeries
    begin, end : (S,) int
        Stretches of recordings that belong together.
    scatter : Variance
    """
    count = np.maximum(end - begin - 1, 0)
    stretch = np.repeat(np.arange(len(begin)), count)
    after = np.arange(len(stretch)) - np.repeat(np.cumsum(count) - count, count) + begin[stretch]
    low, high = begin[stretch], end[stretch]
    if not len(after):
        return Gaps(stretch, after, np.empty((0, 3)), np.empty(0), np.empty(0), np.empty(0))
    square, freedom = _walks(lines, after, low, high, scatter)
    before, before_sigma = _known(lines, after, -1, (low, high), square, scatter)
    behind, behind_sigma = _known(lines, after + 1, 1, (low, high), square, scatter)
    moved = behind - before
    gap = np.abs(lines.time[after + 1] - lines.time[after])
    covariance = before_sigma + behind_sigma + (square * gap)[:, np.newaxis, np.newaxis] * np.eye(3)
    chi_square = _squares(moved, covariance)
    p_value = chances(chi_square, np.full(len(after), 3))
    for place in np.flatnonzero(freedom).tolist():
        p_value[place] = chance_of(float(chi_square[place]), 3, others=float(freedom[place]))
    return Gaps(stretch, after, moved, p_value, chi_square, square)


def _known(
    lines: OffsetSeries, places: Places, way: int, ends: tuple[Places, Places], square: Floats, scatter: Variance
) -> tuple[Floats, Floats]:
    """Offset (G, 3) and its covariance (G, 3, 3) at (G,) recordings, from them and those on one side of them."""
    information, voice = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3, 1))
    origin = lines.offset[places]
    for steps in range(SIDE - 1, -1, -1):
        here = places + way * steps
        is_there = (here >= ends[0]) & (here < ends[1])
        here = np.where(is_there, here, places)
        nearer = np.where(is_there, here - way * min(steps, 1), places)
        precision = np.linalg.inv(scatter.session * lines.covariance[here]) * is_there[:, np.newaxis, np.newaxis]
        information = information + precision
        voice = voice + precision @ (lines.offset[here] - origin)[:, :, np.newaxis]
        spread = square * np.abs(lines.time[nearer] - lines.time[here])
        kept = np.linalg.inv(np.eye(3) + spread[:, np.newaxis, np.newaxis] * information)  # (1 + q² Δt Λ)⁻¹
        information, voice = kept @ information, kept @ voice
    covariance = np.linalg.inv(information)
    return origin + (covariance @ voice)[:, :, 0], covariance


def _on_a_line(lines: OffsetSeries, gaps: Gaps, place: int, ends: tuple[Places, Places], scatter: Variance) -> float:
    """Chi-square that a step takes off on top of a straight line; of two recordings nobody can tell, and it is any."""
    stretch, after = gaps.stretch[place], int(gaps.after[place])
    first, end = max(int(ends[0][stretch]), after + 1 - SIDE), min(int(ends[1][stretch]), after + 1 + SIDE)
    if end - first < 3:
        return np.inf
    time = lines.time[first:end] - lines.time[first]
    covariance = np.kron(gaps.square[place] * np.minimum(time[:, np.newaxis], time), np.eye(3))
    for row in range(end - first):
        inside = slice(3 * row, 3 * row + 3)
        covariance[inside, inside] += scatter.session * lines.covariance[first + row]
    offset = (lines.offset[first:end] - lines.offset[first]).ravel()
    line = [np.ones(len(time)), time / max(float(time[-1]), np.finfo(float).tiny)]
    step = (np.arange(first, end) > after).astype(float)
    return _left(offset, line, covariance) - _left(offset, [*line, step], covariance)


def _left(offset: Floats, courses: Sequence[Floats], covariance: Floats) -> float:
    """Chi-square that (3 n,) offsets leave about sums of courses (n,), which each axis has its own share of."""
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    design = root @ np.kron(np.stack(courses, axis=1), np.eye(3))
    seen = root @ offset
    about = seen - design @ np.linalg.lstsq(design, seen, rcond=None)[0]
    return float(about @ about)


def _walks(lines: OffsetSeries, after: Places, low: Places, high: Places, scatter: Variance) -> tuple[Floats, Floats]:
    """(G,) q² to hold each gap against, and the degrees of freedom of a unit's own, 0 for that of the fleet."""
    excess, chi_square = _between_neighbours(lines, scatter)
    around = np.concatenate([np.arange(1 - SIDE, 0), np.arange(1, SIDE)])
    others = after[:, np.newaxis] + around
    is_there = (others >= low[:, np.newaxis]) & (others < high[:, np.newaxis] - 1)
    others = np.where(is_there, others, 0)
    is_there &= np.isfinite(excess[others])
    count = is_there.sum(axis=1)
    odd = chances(np.where(is_there, chi_square[others], 0.0).sum(axis=1), 3 * count) < ODD
    sizes = np.sort(np.where(is_there, excess[others], np.inf), axis=1)
    own = sizes[np.arange(len(after)), np.maximum(count - 1, 0) // 2]
    faster = odd & (count > 0) & (own > scatter.walk**2)
    return np.where(faster, own, scatter.walk**2), np.where(faster, EACH * count, 0).astype(float)


def _between_neighbours(lines: OffsetSeries, scatter: Variance) -> tuple[Floats, Floats]:
    """(R − 1,) the walk, squared, that each change to the next recording shows, and that change as a chi-square.

    Between recordings of the same time there is none, and the first is NaN.
    """
    changes, gap = np.diff(lines.offset, axis=0), np.abs(np.diff(lines.time))
    noise = scatter.session * (lines.covariance[1:] + lines.covariance[:-1])
    beyond = np.sum(changes**2, axis=1) - np.einsum("nii->n", noise)
    excess = beyond.clip(min=0.0) / np.where(gap > 0.0, gap, np.nan) / MEDIAN
    spread = (scatter.walk**2 * gap)[:, np.newaxis, np.newaxis] * np.eye(3)
    return excess, _squares(changes, noise + spread)


def _squares(vectors: Floats, covariance: Floats) -> Floats:
    """(n,) vᵀ C⁻¹ v of (n, 3) vectors."""
    squares: Floats = np.einsum("ni,ni->n", vectors, np.linalg.solve(covariance, vectors[:, :, np.newaxis])[:, :, 0])
    return squares
