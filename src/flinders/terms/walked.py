"""What the noise of a gyro pretends: it stands in the residuals of a window, and in their Jacobian.

The gyro's noise φ_j turns all readings after step j of a window. The field's direction there is not ΔR_kᵀv but off by

    T_k w_k,    T_k = ΔR_kᵀ [v]×,    w_k = Σ_{j≤k} φ_j,    E w_k w_lᵀ = s min(k, l) 1

a random walk. Residuals are off by P_k w_k, P the pushes; so is the Jacobian, which is taken at the same direction, and
the mean of their product is not zero: errors in variables, which shrink the shape as they do for noisy attitudes,
see `flinders.terms.pointing`. On the motions of MAGYC with five degrees of tilt that is half a standard deviation.

The window's own direction follows by h = −Π Σ U_lᵀP_l w_l, with U its Jacobian and Π = (Σ UᵀU)⁻¹, and leaves the
residuals r_k = −P_k w_k − U_k h. With C_j = Σ_{l≥j} U_lᵀP_l, H_k = Π Σ_l min(k, l) U_lᵀP_l and Θ = Σ Π U_kᵀP_k H_kᵀ,
for s = 1,

    E w_k r_kᵀ = H_kᵀU_kᵀ − k P_kᵀ,    E h r_kᵀ = H_k P_kᵀ − Θ U_kᵀ,    E h w_kᵀ = −H_k,    E h hᵀ = Θ

and all means of second order follow from these. The mean gradient is

    Σ E J(T_k w_k + t h)ᵀ r_k  +  Σ Jᵀ E r₂

J(·) being linear in the direction and t across it. r₂ comes of the mean of the direction, which is
−(k + tr Θ/2) v + Σᵢ Hᵢ × tᵢ, less what h takes up, and of E δUᵀ r. The parameters of the gyro itself, a turn of
B_k = Σ_{j≤k} b_j in all, have the noise in each b_j, too: B_k is off by Σ_{j≤k} (D_j φ_j + w_j × b_j) + B_k × w_k,
where D_j is how b_j goes with the rate.

When to use it: with the variance s that the residuals of the windows tell, to take the mean gradient off.

Source: our own, to second order in φ as `flinders.terms.magnitude` is in the noise of readings; held against draws of
the noise in ``tests/truth/test_walked.py``.

>>> from dataclasses import replace
>>> from flinders.terms import turning
>>> rate = np.random.default_rng(1).normal(size=(20, 25, 3))
>>> turned = turning.integrated(rate, np.full((20, 25), 0.2), np.zeros(3), np.zeros(6))
>>> seen = 50.0 * np.swapaxes(turned.rotations, 2, 3) @ [0.6, 0.0, 0.8]
>>> group, here = replace(Group.of(seen), turned=turned), Parameters.at(np.zeros(3), 50.0 * np.eye(3))
>>> layout, directions = Layout.of(), np.tile([0.6, 0.0, 0.8], (20, 1))
>>> gradient = mean_gradient(group, here, directions, layout, Weights(1.0))
>>> bool(np.all(gradient[3:6] < 0.0))                                        # it pretends a smaller shape
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from flinders.quadric import symmetric
from flinders.terms.parameters import Layout, Parameters, across
from flinders.terms.shared import Group, Rows, Weights, inverse_of, jacobian_of, rows_of
from flinders.terms.turning import cross_matrices

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Walked:
    """Windows, and what of second order a walk of one rad² a reading makes.

    Attributes
    ----------
    own : (W, n, k, 2) float
        U: Jacobian of the window's direction.
    pushes : (W, n, k, 3) float
        P.
    inverse : (W, 2, 2) float
        Π: covariance of the direction.
    steps : (W, n, 2, 3) float
        C: how the direction feels a turn at each step.
    follows : (W, n, 2, 3) float
        H: minus the covariance of the direction with the walk.
    spread : (W, 2, 2) float
        Θ: covariance of the direction that the walk makes.
    """

    own: Floats
    pushes: Floats
    inverse: Floats
    steps: Floats
    follows: Floats
    spread: Floats

    @classmethod
    def of(cls, rows: Rows, pushed: Floats) -> Self:
        """Take (W, k, n, …) rows and pushes."""
        own, pushes = np.swapaxes(rows.own, 1, 2), np.swapaxes(pushed, 1, 2)
        flat = rows.own.reshape(len(rows.own), -1, 2)
        inverse = inverse_of(np.swapaxes(flat, 1, 2) @ flat)
        products = np.swapaxes(own, 2, 3) @ pushes
        steps = np.cumsum(products[:, ::-1], axis=1)[:, ::-1].copy()
        steps[:, 0] = 0.0  # a window begins where its direction is
        follows = inverse[:, np.newaxis] @ np.cumsum(steps, axis=1)
        spread = inverse @ np.sum(products @ np.swapaxes(follows, 2, 3), axis=1)
        return cls(own, pushes, inverse, steps, follows, spread)

    @property
    def age(self) -> Floats:
        """(n, 1, 1) k: steps since the window began."""
        return np.arange(float(self.own.shape[1]))[:, np.newaxis, np.newaxis]

    @property
    def by_walk(self) -> Floats:
        """(W, n, 3, k) E w rᵀ."""
        mean: Floats = np.swapaxes(self.own @ self.follows - self.age * self.pushes, 2, 3)
        return mean

    @property
    def by_direction(self) -> Floats:
        """(W, n, 2, k) E h rᵀ."""
        mean: Floats = self.follows @ np.swapaxes(self.pushes, 2, 3)
        return mean - self.spread[:, np.newaxis] @ np.swapaxes(self.own, 2, 3)


class Turn(NamedTuple):
    """How parameters of the gyro turn a window.

    Attributes
    ----------
    columns : slice
    each : (W, n, 3, m) float
        b: by each step, in the axes of the window.
    by_rate : (m, 3, 3) float
        How that goes with the rate, in the axes of the body.
    """

    columns: slice
    each: Floats
    by_rate: Floats


def pushes(group: Group, at: Parameters, directions: Floats, weights: Weights) -> Floats:
    """(W, k, n, 3) how a turn φ, in the axes of the window's first reading, moves each residual after it."""
    turned = np.swapaxes(group.rotations, 2, 3) @ cross_matrices(directions)[:, np.newaxis]
    weight = np.sqrt(group.weight) / weights.noise
    moved = np.swapaxes(at.ellipsoid_like @ turned * weight[..., np.newaxis, np.newaxis], 1, 2)
    if group.trust is None:
        return moved
    trust = np.sqrt(group.trust) / weights.vertical
    if group.attitudes is not None:
        stands = np.swapaxes(group.attitudes @ turned * trust[..., np.newaxis, np.newaxis], 1, 2)
        return np.concatenate([moved, stands], axis=1)
    down = group.upright(at)
    if down is None:
        return moved
    raised = np.einsum("wnk,wnkj->wnj", down, turned) * trust[..., np.newaxis]
    return np.concatenate([moved, raised[:, np.newaxis]], axis=1)


def mean_gradient(group: Group, at: Parameters, directions: Floats, layout: Layout, weights: Weights) -> Floats:
    """(P,) mean gradient, in standard deviations, that a walk of one rad² a reading makes.

    Parameters
    ----------
    group : Group
        Windows of a gyro.
    at : Parameters
    directions : (W, 3) float
        Of each window, as they have settled.
    layout : Layout
    weights : Weights
    """
    rows = rows_of(group, at, directions, layout, weights)
    walked = Walked.of(rows, pushes(group, at, directions, weights))
    gradient = _of_model(walked, rows, directions)
    together = _together(walked, group, directions)
    nowhere = np.zeros((*group.weight.shape, 3))
    still = jacobian_of(group, at, nowhere, layout, weights)
    for axis in range(3):
        along = jacobian_of(group, at, nowhere + np.eye(3)[axis], layout, weights) - still
        gradient += np.einsum("wknp,wnk->p", along, together[:, :, axis])
    for turn in _turns(group, at, layout):
        gradient[turn.columns] += _of_gyro(walked, turn, group.rotations)
    return gradient


def _together(walked: Walked, group: Group, directions: Floats) -> Floats:
    """(W, n, 3, k) E δq rᵀ: how the direction at each reading goes with its residuals."""
    off = cross_matrices(directions)[:, np.newaxis] @ walked.by_walk
    off = off + across(directions)[:, np.newaxis] @ walked.by_direction
    mean: Floats = np.swapaxes(group.rotations, 2, 3) @ off
    return mean


def _of_model(walked: Walked, rows: Rows, directions: Floats) -> Floats:
    """(P,) Σ Jᵀ E r₂: residuals have a mean, and the window's direction follows it."""
    n, width = rows.jacobian.shape[2:]
    tangent, model = across(directions), np.swapaxes(rows.model, 1, 2)
    aside = np.swapaxes(tangent, 1, 2)[:, np.newaxis]
    middle = np.cross(walked.follows, np.broadcast_to(aside, walked.follows.shape)).sum(axis=2)  # Σ Hᵢ × tᵢ
    shorter = np.arange(n) + 0.5 * np.trace(walked.spread, axis1=1, axis2=2)[:, np.newaxis]
    along = np.einsum("wnj,wj->wn", middle, directions) - shorter
    mean = -model * along[..., np.newaxis] - (walked.own @ (middle @ tangent)[..., np.newaxis])[..., 0]
    pulled = np.sum(np.swapaxes(walked.own, 2, 3) @ mean[..., np.newaxis], axis=1) + _of_own(walked, model, directions)
    left = mean - (walked.own @ (walked.inverse @ pulled)[:, np.newaxis])[..., 0]
    gradient: Floats = np.swapaxes(left, 1, 2).ravel() @ rows.jacobian.reshape(-1, width)
    return gradient


def _of_own(walked: Walked, model: Floats, directions: Floats) -> Floats:
    """(W, 2, 1) Σ E δUᵀ r, with δU the turn of t₁ and t₂: by the walk tᵢ × w, and −hᵢ v as the direction moves on."""
    tangent = across(directions)
    axes = np.concatenate([np.swapaxes(tangent, 1, 2), directions[:, np.newaxis]], axis=1)
    first, second, middle = np.moveaxis(axes[:, np.newaxis] @ walked.by_walk, 2, 0)  # E of w along t₁, t₂ and v
    by_direction = walked.by_direction
    sums = [
        model * (second - by_direction[:, :, 0]) - walked.own[..., 1] * middle,
        walked.own[..., 0] * middle - model * (first + by_direction[:, :, 1]),
    ]
    return np.stack([one.sum(axis=(1, 2)) for one in sums], axis=1)[..., np.newaxis]


def _turns(group: Group, at: Parameters, layout: Layout) -> Iterator[Turn]:
    """How bias and scales of the gyro turn a window, where they are looked for."""
    if group.turned is None:
        return
    seconds = np.zeros(group.weight.shape)
    seconds[:, 1:] = group.turned.interval[:, :-1]
    if "gyro_bias" in layout:
        each = -group.rotations * seconds[..., np.newaxis, np.newaxis]
        yield Turn(layout.columns["gyro_bias"], each, np.zeros((3, 3, 3)))
    if "gyro_scale" in layout:
        by_rate = np.array([symmetric(unit) for unit in np.eye(6)])
        before = np.roll(group.turned.rate - at.gyro_bias, 1, axis=1) * seconds[..., np.newaxis]
        yield Turn(layout.columns["gyro_scale"], group.rotations @ np.einsum("cij,wnj->wnic", by_rate, before), by_rate)


def _of_gyro(walked: Walked, turn: Turn, rotations: Floats) -> Floats:
    """(m,) Σ (P_k δB_k)ᵀ r_k on average, with E φ_j r_kᵀ = C_jᵀ Π U_kᵀ − P_kᵀ for a step j up to the reading."""
    back = np.swapaxes(walked.follows, 2, 3)
    felt = np.swapaxes(walked.steps, 2, 3) @ walked.inverse[:, np.newaxis]
    gradient = np.zeros(len(turn.by_rate))
    for column, sense in enumerate(turn.by_rate):
        noise = rotations @ sense @ np.swapaxes(rotations, 2, 3)  # D
        noise[:, 0] = 0.0
        crossed = cross_matrices(turn.each[..., column])
        whole = np.cumsum(crossed, axis=1)
        by_pushes = np.cumsum(noise - walked.age * crossed, axis=1) + walked.age * whole
        by_own = np.cumsum(noise @ felt - crossed @ back, axis=1) + whole @ back
        mean = walked.own @ np.swapaxes(by_own, 2, 3) - walked.pushes @ np.swapaxes(by_pushes, 2, 3)
        gradient[column] = float(np.sum(walked.pushes * mean))
    return gradient
