"""Term of a gyro: the field is constant in the world while the body turns, within windows of a few seconds.

Within a window the direction of the field in body axes is q_k = ΔR_k(d)ᵀ v. The direction v at the first reading is
free for each window; ΔR_k is the rotation of the body since then, by the gyro,

    ΔR_k(d) = Π_{j<k} exp([(1 + Γ)(ω_j − d)]× Δt_j)

The rate is integrated, the field is not differentiated. So each reading occurs once, with its own white noise, and the
equation is linear in the reading. The bias d is estimated: with J_k = −ΔR_kᵀ Σ_{j<k} ΔR_{j+1} Δt_j a change δ of the
bias turns q_k by q_k × J_k δ. The symmetric Γ has the scale errors of the gyro's axes, a few hundredths if
uncalibrated, and their non-orthogonality. If an accelerometer or an attitude defines the body axes, a small rotation ψ
of the gyro is estimated as well: 1 + Γ + [ψ]×. A scale error of one hundredth gives an error of ten degrees if the body
turns by 15 rad in a window, much more than the gyro's noise. A magnetometer with a delay δt reads q_k + δt ω_k × q_k.

When to use it: if the body turns about two axes or more, even by a few degrees, in a constant field. Hard and soft iron
then follow from much less turning than with the length of the field alone. If the body turns about only one axis, the
offset along that axis is not determined.

Source: pre-integration as in T. Lupton, S. Sukkarieh, IEEE Trans. Robotics 28 (2012) 61–76, and C. Forster et
al., IEEE Trans. Robotics 33 (2017) 1–21; the field's equation ṁ = −ω × m as in G. Troni, L. L. Whitcomb, ICRA
2013; scale errors of up to 3 % by data sheets of small gyros, such as InvenSense's MPU-6000.

>>> quarter = np.tile([0.0, 0.0, np.pi / 2], (1, 3, 1))                      # 90°/s about z, for two seconds
>>> turned = integrate_rates(quarter, np.ones((1, 3)), np.zeros(3))
>>> (np.swapaxes(turned.rotations, 2, 3) @ [1.0, 0.0, 0.0]).round(6)[0] + 0.0
array([[ 1.,  0.,  0.],
       [ 0., -1.,  0.],
       [-1.,  0.,  0.]])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.rotation import cross_matrices, make_contiguous, product, rotations
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats

WINDOW_S: Final = 5.0
"""Length of a window in s: long enough for a slow turn, short enough to limit the integrated noise of the gyro."""

MIN_WINDOW_READINGS: Final = 4
"""Smallest number of readings in a window; fewer readings have no more information than single ones."""

MAX_GAP_INTERVALS: Final = 3.0
"""Smallest gap, in median intervals of the readings, at which a window ends, as the motion in it is not known."""

MAX_BRIDGED_READINGS: Final = 3
"""Largest number of consecutive missing rates that are interpolated."""

BIAS_SIGMA_RADPS: Final = 0.1
"""Prior standard deviation of a gyro's bias in rad/s."""

SCALE_SIGMA: Final = 0.02
"""Prior standard deviation of a gyro's scales, and of its misalignment angles in rad: 1 to 3 % in data sheets."""

DELAY_SIGMA_S: Final = 0.05
"""Prior standard deviation of a magnetometer's delay in s."""

MAX_FIRST_ORDER_RAD: Final = 2e-3
"""Largest rotation in rad, by a change of the gyro's parameters, that is computed without integrating again."""


@dataclass(frozen=True, slots=True, eq=False)
class WindowRotation:
    """Rotation of a body within W windows of n readings, by its gyro."""

    rotations: Floats  # (W, n, 3, 3): ΔR, from body axes at each reading to those at the first reading of the window
    by_bias: Floats  # (W, n, 3, 3), s: J: a change δ of the bias multiplies ΔR_k by exp([J_k δ]×) on the right
    by_scale: Floats  # (W, n, 3, 9): matrices as `by_bias` for changes of Γ and ψ
    rate: Floats  # (W, n, 3), rad/s: recorded rates
    interval: Floats  # (W, n), s: time from each reading to the next
    bias: Floats  # (3,), rad/s: bias with which `rotations` were computed
    scale: Floats  # (9,): Γ and ψ with which `rotations` were computed

    def with_gyro(self, bias: Floats, scale: Floats) -> WindowRotation:
        """The rotation for other parameters of the gyro: to first order for small changes, else integrated again.

        `bias` is (3,) in rad/s; `scale` is (6,) Γ, or (9,) Γ and ψ.
        """
        scale = _scale_and_turn(scale)
        if np.array_equal(bias, self.bias) and np.array_equal(scale, self.scale):
            return self
        change = np.einsum("wnij,j->wni", self.by_bias, bias - self.bias)
        change += np.einsum("wnij,j->wni", self.by_scale, scale - self.scale)
        if float(np.abs(change).max(initial=0.0)) > MAX_FIRST_ORDER_RAD:
            return integrate_rates(self.rate, self.interval, bias, scale)
        return replace(self, rotations=product(self.rotations, rotations(change)), bias=bias, scale=scale)

    def chunk(self, rows: slice) -> Self:
        """The rotation in the windows that `rows` selects."""
        return replace(
            self, rotations=self.rotations[rows], by_bias=self.by_bias[rows], by_scale=self.by_scale[rows],
            rate=self.rate[rows], interval=self.interval[rows],
        )  # fmt: skip


def integrate_rates(rate: Floats, interval: Floats, bias: Floats, scale: Floats | None = None) -> WindowRotation:
    """Integrate angular rates over windows to rotations.

    Parameters
    ----------
    rate : (W, n, 3) float, rad/s
        Rates, assumed constant from each reading to the next.
    interval : (W, n) float, s
        Time from each reading to the next; the last interval of a window is not used.
    bias : (3,) float, rad/s
        Bias, which is subtracted from the rate.
    scale : (6,) or (9,) float, optional
        Γ, or Γ and ψ; by default zero.
    """
    gamma = _scale_and_turn(np.zeros(6) if scale is None else scale)
    larger = scale_matrix(gamma)
    turned = make_contiguous(rate - bias) * interval[..., np.newaxis]
    along = np.moveaxis(np.empty((3, 3, *interval.shape)), (0, 1), (2, 3))
    along[:, :1], along[:, 1:] = np.eye(3), rotations(turned[:, :-1] @ larger.T)
    reach = 1
    while reach < interval.shape[1]:  # products of 1, 2, 4, 8 … steps: log₂ n passes
        along[:, reach:] = product(along[:, :-reach], along[:, reach:])
        reach *= 2
    seconds = interval[:, :-1, np.newaxis, np.newaxis]
    by_bias = np.zeros_like(along)
    weighted = product(np.cumsum(along[:, 1:] * seconds, axis=1), larger[np.newaxis, np.newaxis])
    by_bias[:, 1:] = -product(np.swapaxes(along[:, 1:], 2, 3), weighted)
    return WindowRotation(along, by_bias, _scale_derivatives(along, turned), rate, interval, bias, gamma)


def scale_matrix(scale: Floats) -> Floats:
    """(3, 3) matrix 1 + Γ + [ψ]× of (9,) Γ and ψ.

    >>> scale_matrix(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02])).tolist()
    [[1.1, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    larger: Floats = np.eye(3) + symmetric_matrix(scale[:6]) + cross_matrices(scale[6:])
    return larger


def _scale_and_turn(scale: Floats) -> Floats:
    """(9,) Γ and ψ from (6,) Γ, with ψ = 0, or from both."""
    return np.concatenate([scale, np.zeros(9 - len(scale))])


def _scale_derivatives(along: Floats, turned: Floats) -> Floats:
    """(W, n, 3, 9) derivative of ΔR_k by Γ and ψ; `turned` is the (W, n, 3) rotation in rad to the next reading."""
    moved = np.moveaxis(np.zeros((3, 9, *turned.shape[:2])), (0, 1), (2, 3))
    for i, j, column in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        moved[..., j, 6 + column], moved[..., i, 6 + column] = turned[..., i], -turned[..., j]
    for column, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        moved[..., i, column] = turned[..., j]
        moved[..., j, column] = turned[..., i]
    summed = np.zeros_like(moved)
    summed[:, 1:] = np.cumsum(product(along[:, 1:], moved[:, :-1]), axis=1)
    return product(np.swapaxes(along, 2, 3), summed)


def bridge_gaps(time: Floats | None, rate: Floats | None) -> tuple[Floats | None, int]:
    """Fill gaps of at most `MAX_BRIDGED_READINGS` readings in (N, 3) rates; returns them and the number of filled ones.

    Longer gaps stay NaN and end a window. Without times the rates are returned unchanged.

    >>> time, rate = np.arange(9.0), np.outer(np.arange(9.0), [1.0, 0.0, 0.0])
    >>> rate[[2, 4, 5, 6, 7]] = np.nan
    >>> filled, count = bridge_gaps(time, rate)
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
    inside = ~known & (rows > before) & (rows < behind) & (behind - before <= MAX_BRIDGED_READINGS + 1) & (span > 0.0)
    share = np.where(inside, (time - time[before]) / np.where(span > 0.0, span, 1.0), 0.0)[:, np.newaxis]
    filled: Floats = np.where(inside[:, np.newaxis], rate[before] * (1.0 - share) + rate[behind] * share, rate)
    return filled, int(np.count_nonzero(inside))


def window_rows(time: Floats, rate: Floats, *, window_s: float = WINDOW_S) -> NDArray[np.intp]:
    """Divide each stretch of readings without a gap into windows: (W, n) indices of the readings of each window.

    Parameters
    ----------
    time : (N,) float, s
        Times of the readings.
    rate : (N, 3) float, rad/s
        Rates; a stretch ends at NaN.
    window_s : float
        Approximate length of a window in s; a recording that is shorter than this is one window.

    >>> time = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(2.0, 2.5, 0.1)])
    >>> window_rows(time, np.zeros((15, 3)), window_s=0.5)
    array([[ 0,  1,  2,  3,  4],
           [ 5,  6,  7,  8,  9],
           [10, 11, 12, 13, 14]])
    """
    if len(time) < MIN_WINDOW_READINGS:
        return np.empty((0, MIN_WINDOW_READINGS), dtype=np.intp)
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else np.inf
    sound = (steps > 0.0) & (steps < MAX_GAP_INTERVALS * usual) & np.isfinite(rate[:-1]).all(axis=1)
    edges = np.concatenate([[0], np.flatnonzero(~sound) + 1, [len(time)]])
    lengths = np.diff(edges)
    n = max(MIN_WINDOW_READINGS, min(round(window_s / usual) if np.isfinite(usual) else 1, int(lengths.max())))
    starts = [np.arange(begin, begin + length - n + 1, n) for begin, length in zip(edges[:-1], lengths, strict=True)]
    first = np.concatenate(starts).astype(np.intp)
    return first[:, np.newaxis] + np.arange(n)


def gyro_columns(columns: Mapping[str, slice]) -> slice:
    """Contiguous columns of the gyro's parameters, from the columns of all free blocks."""
    of_gyro = [columns[block.name] for block in TERM.blocks if block.name in columns]
    return slice(of_gyro[0].start, of_gyro[-1].stop) if of_gyro else slice(0, 0)


def direction_derivatives(turned: WindowRotation, q: Floats, turning: Floats, columns: Mapping[str, slice]) -> Floats:
    """Derivative of the field's direction at each reading by the gyro's bias, scales and delay.

    Parameters
    ----------
    turned : WindowRotation
        Rotation of the body within the windows.
    q : (W, n, 3) float
        Direction of the field.
    turning : (W, n, 3) float, rad/s
        Angular rate of the body.
    columns : mapping of str to slice
        Columns of all free blocks.

    Returns
    -------
    (W, n, 3, m) float
        In the order of `gyro_columns`.
    """
    mine = gyro_columns(columns)
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
    "the gyro: in body axes the field turns opposite to the body",
    ("rate", "time"),
    (
        Block("gyro_bias", 3, BIAS_SIGMA_RADPS),
        Block("gyro_scale", 6, SCALE_SIGMA),
        Block("gyro_turn", 3, SCALE_SIGMA),
        Block("delay", 1, DELAY_SIGMA_S),
    ),
)
