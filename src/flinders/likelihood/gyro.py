"""The field stands still while the body turns: what a gyro says of a few seconds of readings.

Within a window of some seconds the direction of the field in body axes is q_k = ΔR_k(d)ᵀ v: one free direction v for
the window, at its first reading, turned back by what the gyro has turned since,

    ΔR_k(d) = Π_{j<k} exp([(1 + Γ)(ω_j − d)]× Δt_j)

The rate is integrated, never the field differentiated, so that each reading enters once, with its own white noise; and
the equation is linear in it. The bias d is found with the rest: with J_k = −ΔR_kᵀ Σ_{j<k} ΔR_{j+1} Δt_j a change
of δ turns q_k by q_k × J_k δ. Γ is symmetric: what the scales of a gyro's three axes are off by, a few hundredths where
nobody has calibrated them, and by how much those axes are not square. Beside an accelerometer or an attitude, whose
axes are the body's, a small rotation ψ is found as well: 1 + Γ + [ψ]×. A body that turns by 15 rad in a window is lost
by ten degrees for one hundredth, long before the gyro's noise counts. A magnetometer that lags by δt reads
q_k + δt ω_k × q_k.

When to use it: the body turns about two axes or more while the field around it stays the same, if only by a few
degrees; hard and soft iron follow from much less turning than the length of the field alone needs. Rotation about one
axis says nothing of the offset along it.

Source: pre-integration as in T. Lupton, S. Sukkarieh, IEEE Trans. Robotics 28 (2012) 61–76, and C. Forster et
al., IEEE Trans. Robotics 33 (2017) 1–21; the field's equation ṁ = −ω × m as in G. Troni, L. L. Whitcomb, ICRA
2013; scales off by up to 3 % as data sheets of small gyros allow, such as InvenSense's MPU-6000.

>>> quarter = np.tile([0.0, 0.0, np.pi / 2], (1, 3, 1))                      # 90°/s about z, for two seconds
>>> turned = integrated(quarter, np.ones((1, 3)), np.zeros(3))
>>> (np.swapaxes(turned.rotations, 2, 3) @ [1.0, 0.0, 0.0]).round(6)[0] + 0.0
array([[ 1.,  0.,  0.],
       [ 0., -1.,  0.],
       [-1.,  0.,  0.]])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import symmetric
from flinders.geometry.rotation import cross_matrices, in_pieces, product, rotations
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats

WINDOW_S: Final = 5.0
"""Length of a window, in s: long enough to see a slow turn, and short enough for the gyro's noise to matter little."""

SHORTEST: Final = 4
"""Readings in a window; fewer say no more than as many single ones."""

GAP: Final = 3.0
"""Usual intervals between two readings that are a gap: nobody knows how the body turned meanwhile."""

BRIDGED: Final = 3
"""Missing rates in a row that their neighbours stand for."""

BIAS_SIGMA: Final = 0.1
"""rad/s: what the bias of a gyro may be."""

SCALE_SIGMA: Final = 0.02
"""What the scales of a gyro may be off by, and its axes from square, in rad: data sheets of small ones say 1 to 3 %."""

DELAY_SIGMA: Final = 0.05
"""s: by how much a magnetometer may lag."""

AGAIN: Final = 2e-3
"""rad: the rate is integrated anew once a change of its bias has turned the end of a window by more."""


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """How a body turned within windows."""

    rotations: Floats  # (W, n, 3, 3): ΔR: from body axes at each reading into those at the first of its window
    by_bias: Floats  # (W, n, 3, 3), s: J: a bias larger by δ turns ΔR_k by exp([J_k δ]×) on the right
    by_scale: Floats  # (W, n, 3, 9): the same for a Γ larger by γ, and for another ψ
    rate: Floats  # (W, n, 3), rad/s: as recorded
    interval: Floats  # (W, n), s: from each reading to the next
    bias: Floats  # (3,), rad/s
    scale: Floats  # (9,): Γ and ψ: for which all this holds

    def with_gyro(self, bias: Floats, scale: Floats) -> Turned:
        """The same for another gyro: to first order for a small change, integrated anew for a larger one.

        `bias`: (3,), rad/s; `scale`: (6,) or (9,), Γ, and ψ.
        """
        scale = _whole(scale)
        if np.array_equal(bias, self.bias) and np.array_equal(scale, self.scale):
            return self
        change = np.einsum("wnij,j->wni", self.by_bias, bias - self.bias)
        change += np.einsum("wnij,j->wni", self.by_scale, scale - self.scale)
        if float(np.abs(change).max(initial=0.0)) > AGAIN:
            return integrated(self.rate, self.interval, bias, scale)
        return replace(self, rotations=product(self.rotations, rotations(change)), bias=bias, scale=scale)

    def chunk(self, rows: slice) -> Self:
        """Some of the windows."""
        return replace(
            self, rotations=self.rotations[rows], by_bias=self.by_bias[rows], by_scale=self.by_scale[rows],
            rate=self.rate[rows], interval=self.interval[rows],
        )  # fmt: skip


def integrated(rate: Floats, interval: Floats, bias: Floats, scale: Floats | None = None) -> Turned:
    """Integrate rates over windows.

    Parameters
    ----------
    rate : (W, n, 3) float, rad/s
        Taken for constant from each reading to the next.
    interval : (W, n) float, s
        From each reading to the next; the last one of a window is not used.
    bias : (3,) float, rad/s
    scale : (6,) or (9,) float, optional
        Γ, and ψ; nothing where the gyro's scales are right and it sits straight.
    """
    gamma = _whole(np.zeros(6) if scale is None else scale)
    larger = grown(gamma)
    turned = in_pieces(rate - bias) * interval[..., np.newaxis]
    along = np.moveaxis(np.empty((3, 3, *interval.shape)), (0, 1), (2, 3))
    along[:, :1], along[:, 1:] = np.eye(3), rotations(turned[:, :-1] @ larger.T)
    reach = 1
    while reach < interval.shape[1]:  # products of 1, 2, 4, 8 … steps: as many rounds as the window's length has bits
        along[:, reach:] = product(along[:, :-reach], along[:, reach:])
        reach *= 2
    seconds = interval[:, :-1, np.newaxis, np.newaxis]
    by_bias = np.zeros_like(along)
    weighted = product(np.cumsum(along[:, 1:] * seconds, axis=1), larger[np.newaxis, np.newaxis])
    by_bias[:, 1:] = -product(np.swapaxes(along[:, 1:], 2, 3), weighted)
    return Turned(along, by_bias, _by_scale(along, turned), rate, interval, bias, gamma)


def grown(scale: Floats) -> Floats:
    """(3, 3) 1 + Γ + [ψ]× of (9,) both.

    >>> grown(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02])).tolist()
    [[1.1, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    larger: Floats = np.eye(3) + symmetric(scale[:6]) + cross_matrices(scale[6:])
    return larger


def _whole(scale: Floats) -> Floats:
    """(9,) Γ and ψ, of (6,) Γ alone or of both."""
    return np.concatenate([scale, np.zeros(9 - len(scale))])


def _by_scale(along: Floats, turned: Floats) -> Floats:
    """(W, n, 3, 9) how larger Γ and ψ turn ΔR_k, of (W, n, 3) what the gyro turned by from each reading to the next."""
    moved = np.moveaxis(np.zeros((3, 9, *turned.shape[:2])), (0, 1), (2, 3))
    for i, j, column in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        moved[..., j, 6 + column], moved[..., i, 6 + column] = turned[..., i], -turned[..., j]
    for column, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        moved[..., i, column] = turned[..., j]
        moved[..., j, column] = turned[..., i]
    summed = np.zeros_like(moved)
    summed[:, 1:] = np.cumsum(product(along[:, 1:], moved[:, :-1]), axis=1)
    return product(np.swapaxes(along, 2, 3), summed)


def bridged(time: Floats | None, rate: Floats | None) -> tuple[Floats | None, int]:
    """(N, 3) rates with short gaps filled between their neighbours by a straight line, and how many readings that is.

    A gap of at most `BRIDGED` readings is one; what is longer stays NaN, and ends a window. Anything of other shape
    than times and rates comes back as it is.

    >>> time, rate = np.arange(9.0), np.outer(np.arange(9.0), [1.0, 0.0, 0.0])
    >>> rate[[2, 4, 5, 6, 7]] = np.nan
    >>> filled, count = bridged(time, rate)
    >>> filled[:, 0], count
    (array([ 0.,  1.,  2.,  3., nan, nan, nan, nan,  8.]), 1)
    """
    if time is None or rate is None:
        return rate, 0
    known = np.isfinite(rate).all(axis=1)
    there = np.flatnonzero(known)
    if known.all() or len(there) < 2:
        return rate, 0
    rows = np.arange(len(rate))
    after = np.clip(np.searchsorted(there, rows), 1, len(there) - 1)
    before, behind = there[after - 1], there[after]
    span = time[behind] - time[before]
    inside = ~known & (rows > before) & (rows < behind) & (behind - before <= BRIDGED + 1) & (span > 0.0)
    share = np.where(inside, (time - time[before]) / np.where(span > 0.0, span, 1.0), 0.0)[:, np.newaxis]
    filled: Floats = np.where(inside[:, np.newaxis], rate[before] * (1.0 - share) + rate[behind] * share, rate)
    return filled, int(np.count_nonzero(inside))


def windows(time: Floats, rate: Floats, *, window_s: float = WINDOW_S) -> NDArray[np.intp]:
    """(W, n) which readings are in which window: as many whole windows as each stretch without a gap has room for.

    Parameters
    ----------
    time : (N,) float, s
    rate : (N, 3) float, rad/s
        NaN where it is not known, which ends a stretch.
    window_s : float
        About how long a window is; a recording that is shorter is one window.

    >>> time = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(2.0, 2.5, 0.1)])
    >>> windows(time, np.zeros((15, 3)), window_s=0.5)
    array([[ 0,  1,  2,  3,  4],
           [ 5,  6,  7,  8,  9],
           [10, 11, 12, 13, 14]])
    """
    if len(time) < SHORTEST:
        return np.empty((0, SHORTEST), dtype=np.intp)
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else np.inf
    sound = (steps > 0.0) & (steps < GAP * usual) & np.isfinite(rate[:-1]).all(axis=1)
    edges = np.concatenate([[0], np.flatnonzero(~sound) + 1, [len(time)]])
    lengths = np.diff(edges)
    n = max(SHORTEST, min(round(window_s / usual) if np.isfinite(usual) else 1, int(lengths.max())))
    starts = [np.arange(begin, begin + length - n + 1, n) for begin, length in zip(edges[:-1], lengths, strict=True)]
    first = np.concatenate(starts).astype(np.intp)
    return first[:, np.newaxis] + np.arange(n)


def columns_of(columns: Mapping[str, slice]) -> slice:
    """Columns of the gyro's bias, scales and delay, which lie side by side; of (name, columns) of all blocks."""
    of_gyro = [columns[block.name] for block in TERM.blocks if block.name in columns]
    return slice(of_gyro[0].start, of_gyro[-1].stop) if of_gyro else slice(0, 0)


def moved(turned: Turned, q: Floats, turning: Floats, columns: Mapping[str, slice]) -> Floats:
    """How the field's direction at each reading goes with bias, scales and delay of the gyro.

    Parameters
    ----------
    q : (W, n, 3) float
        The field's direction.
    turning : (W, n, 3) float, rad/s
        That the body turns by.
    columns : mapping of str to slice
        Of all blocks that are free.

    Returns
    -------
    (W, n, 3, m) float
        In the order of `columns_of`.
    """
    mine = columns_of(columns)
    change = np.empty((3, mine.stop - mine.start, *q.shape[:2]))
    x, y, z = np.moveaxis(q, -1, 0)
    scale, turn = turned.by_scale[..., :6], turned.by_scale[..., 6:]
    for name, turns in (("gyro_bias", turned.by_bias), ("gyro_scale", scale), ("gyro_turn", turn)):
        if name in columns:
            begin = columns[name].start - mine.start
            a, b, c = np.moveaxis(turns, (2, 3), (0, 1))
            part = change[:, begin : begin + len(a)]
            part[0], part[1], part[2] = y * c - z * b, z * a - x * c, x * b - y * a
    if "delay" in columns:
        change[:, -1] = np.moveaxis(np.cross(turning, q), -1, 0)
    return np.moveaxis(change, (0, 1), (2, 3))


TERM: Final = Term(
    "rate",
    "gyro",
    "the gyro: the field turns as the body turns back",
    ("rate", "time"),
    (
        Block("gyro_bias", 3, BIAS_SIGMA),
        Block("gyro_scale", 6, SCALE_SIGMA),
        Block("gyro_turn", 3, SCALE_SIGMA),
        Block("delay", 1, DELAY_SIGMA),
    ),
)
