"""Bias of a fit from the noise of a gyro, which is both in the residuals of a window and in their Jacobian.

The gyro's noise φ_j turns all readings after step j of a window. The error of the field's direction ΔR_kᵀv is then a
random walk w_k of variance s per step, with E the expectation:

    T_k w_k,    T_k = ΔR_kᵀ [v]×,    w_k = Σ_{j≤k} φ_j,    E w_k w_lᵀ = s min(k, l) 1

The walk adds P_k w_k to the residuals, with P their derivative by a rotation. It also changes the Jacobian, which is
evaluated at the same direction. The mean of the product of both is not zero (errors in variables), and shrinks the
shape as noisy attitudes do, see `flinders.likelihood.attitude`. For the motions of MAGYC with a tilt of 5° this bias is
half a standard deviation.

The fitted direction of the window follows the walk by h = −Π Σ U_lᵀP_l w_l, with the Jacobian U of this direction and
Π = (Σ UᵀU)⁻¹. The remaining residuals are r_k = −P_k w_k − U_k h. With C_j = Σ_{l≥j} U_lᵀP_l,
H_k = Π Σ_l min(k, l) U_lᵀP_l and Θ = Σ Π U_kᵀP_k H_kᵀ, for s = 1,

    E w_k r_kᵀ = H_kᵀU_kᵀ − k P_kᵀ,    E h r_kᵀ = H_k P_kᵀ − Θ U_kᵀ,    E h w_kᵀ = −H_k,    E h hᵀ = Θ

from which all means of second order follow. The mean gradient is

    Σ E (∂J/∂q (T_k w_k + t h))ᵀ r_k  +  Σ Jᵀ E r₂

with t the tangents at the direction, and r₂ the residuals of second order. All columns of J except those of an
accelerometer's errors are linear in the direction q, so ∂J/∂q is computed as a difference of two Jacobians. r₂ follows
from the mean of the direction, −(k + tr Θ/2) v + Σᵢ Hᵢ × tᵢ, minus the part that h absorbs, and from E δUᵀ r. The
columns of the gyro's own parameters contain the noise, too: the rotation by a parameter is B_k = Σ_{j≤k} b_j, and its
error is Σ_{j≤k} (D_j φ_j + w_j × b_j) + B_k × w_k with D_j the derivative of b_j by the rate.

When to use it: to correct the bias of a fit with a gyro, with the variance s estimated from the residuals.

Source: derived here, to second order in φ, as `flinders.likelihood.magnitude` in the noise of readings;
``tests/likelihood/test_walked.py`` compares it with simulated noise.

>>> from dataclasses import replace
>>> from flinders.likelihood import gyro
>>> from flinders.likelihood.observations import residual_rows
>>> from flinders.likelihood.parameters import ParameterLayout, Parameters
>>> rate = np.random.default_rng(1).normal(size=(20, 25, 3))
>>> turned = gyro.integrate_rates(rate, np.full((20, 25), 0.2), np.zeros(3), np.zeros(6))
>>> seen = 50.0 * np.swapaxes(turned.rotations, 2, 3) @ [0.6, 0.0, 0.8]
>>> group, here = replace(ObservationGroup.of(seen), turned=turned), Parameters.at(np.zeros(3), 50.0 * np.eye(3))
>>> layout, directions = ParameterLayout.of(), np.tile([0.6, 0.0, 0.8], (20, 1))
>>> whole = here, directions, layout, Weights(1.0)
>>> turned = rotation_derivatives(group, here, directions, Weights(1.0))
>>> walked = WalkStatistics.of(residual_rows(group, *whole), turned)
>>> gradient = mean_gradient(walked, group, *whole)
>>> bool(np.all(gradient[3:6] < 0.0))                                        # the bias shrinks the shape
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.rotation import cross_matrices, make_contiguous, perpendicular_vectors, product
from flinders.likelihood.gyro import scale_matrix
from flinders.likelihood.observations import (
    ObservationGroup,
    ObservationRows,
    Weights,
    inverse_matrices,
    weighted_jacobian,
)

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.likelihood.parameters import ParameterLayout, Parameters

DIFFERENCE_STEP_RAD: Final = 1e-4
"""Step of the field's direction, in rad, in the difference of two Jacobians."""


@dataclass(frozen=True, slots=True, eq=False)
class WalkStatistics:
    """Second-order statistics of W windows of n readings, for a walk of 1 rad² per reading.

    Letters are those of the head of this module.
    """

    rows: ObservationRows  # residuals and Jacobians of the windows
    own: Floats  # (W, n, k, 2): U, Jacobian of the residuals by the window's direction
    pushes: Floats  # (W, n, k, 3): P, derivative of the residuals by a rotation
    inverse: Floats  # (W, 2, 2): Π, covariance of the direction for white residuals
    products: Floats  # (W, n, 2, 3): UᵀP
    steps: Floats  # (W, n, 2, 3): C, effect of a rotation at each step on the direction
    follows: Floats  # (W, n, 2, 3): H, negative covariance of the direction with the walk
    spread: Floats  # (W, 2, 2): Θ, covariance of the direction from the walk

    @classmethod
    def of(cls, rows: ObservationRows, pushed: Floats) -> Self:
        """Compute the statistics from the (W, k, n, …) rows of the windows and their `rotation_derivatives`."""
        own, pushes = np.swapaxes(rows.own, 1, 2), np.swapaxes(pushed, 1, 2)
        flat = rows.own.reshape(len(rows.own), -1, 2)
        inverse = inverse_matrices(np.swapaxes(flat, 1, 2) @ flat)
        products = product(np.swapaxes(own, 2, 3), pushes)
        steps = _reverse_cumsum(products).copy()
        steps[:, 0] = 0.0  # a window begins where its direction is
        follows = make_contiguous(inverse[:, np.newaxis] @ np.cumsum(steps, axis=1), 2)
        spread = inverse @ np.einsum("wnij,wnkj->wik", products, follows)
        return cls(rows, own, pushes, inverse, products, steps, follows, spread)

    @property
    def age(self) -> Floats:
        """(n, 1, 1) number k of steps since the beginning of the window."""
        return np.arange(float(self.own.shape[1]))[:, np.newaxis, np.newaxis]

    @property
    def by_walk(self) -> Floats:
        """(W, n, 3, k) covariance E w rᵀ of the walk with the residuals."""
        return np.swapaxes(product(self.own, self.follows) - self.age * self.pushes, 2, 3)

    @property
    def by_direction(self) -> Floats:
        """(W, n, 2, k) covariance E h rᵀ of the fitted direction with the residuals."""
        of_own = np.einsum("wab,wnkb->wnak", self.spread, self.own)
        mean: Floats = product(self.follows, np.swapaxes(self.pushes, 2, 3)) - of_own
        return mean


def rotation_derivatives(group: ObservationGroup, at: Parameters, directions: Floats, weights: Weights) -> Floats:
    """(W, k, n, 3) derivative P of each residual by an earlier rotation φ, in axes of the window's first reading."""
    pushed = np.zeros((3, group.residuals_per_reading, *group.weight.shape)).transpose(2, 1, 3, 0)
    turned = _rotate_back(group, cross_matrices(directions))
    of_field = np.tensordot(at.rotated_shape, np.moveaxis(turned, (2, 3), (0, 1)), 1).transpose(2, 0, 3, 1)
    pushed[:, :3] = of_field * (np.sqrt(group.weight) / weights.noise)[:, np.newaxis, :, np.newaxis]
    if group.trust is None:
        return pushed
    trust = (np.sqrt(group.trust) * weights.steepness)[..., np.newaxis]
    if group.attitudes is not None:
        pushed[:, 3:] = np.swapaxes(product(group.attitudes, turned) * trust[..., np.newaxis], 1, 2)
    elif (down := group.corrected_verticals(at)) is not None:
        pushed[:, 3] = np.einsum("wni,wnij->wnj", down, turned) * trust
    return pushed


def mean_gradient(
    walk: WalkStatistics,
    group: ObservationGroup,
    at: Parameters,
    directions: Floats,
    layout: ParameterLayout,
    weights: Weights,
) -> Floats:
    """(P,) mean gradient from a walk of 1 rad² per reading, for residuals in standard deviations.

    Parameters
    ----------
    walk : WalkStatistics
        Statistics of these windows.
    group : ObservationGroup
        Windows of a gyro.
    at : Parameters
        Values of the parameters.
    directions : (W, 3) float
        Fitted direction of each window.
    layout : ParameterLayout
        Free parameters.
    weights : Weights
        Standard deviations of the residuals.
    """
    gradient = _model_gradient(walk, directions) + _gyro_gradient(walk, group, at, layout)
    together = _direction_residual_covariance(walk, group, directions)
    q, _ = group.rotated_directions(at, directions)
    here = weighted_jacobian(group, at, q, layout, weights)
    for axis in range(3):
        aside = weighted_jacobian(group, at, q + DIFFERENCE_STEP_RAD * np.eye(3)[axis], layout, weights)
        gradient += np.einsum("wknp,wnk->p", (aside - here) / DIFFERENCE_STEP_RAD, together[:, :, axis])
    return gradient


def _rotate_back(group: ObservationGroup, matrices: Floats) -> Floats:
    """(W, n, 3, k) products of (W, 3, k) matrices of each window with the inverse rotations to its readings."""
    return product(np.swapaxes(group.rotations, 2, 3), matrices[:, np.newaxis])


def _direction_residual_covariance(walk: WalkStatistics, group: ObservationGroup, directions: Floats) -> Floats:
    """(W, n, 3, k) covariance E δq rᵀ of the field's direction at each reading with the residuals of the reading."""
    of_walk = product(_rotate_back(group, cross_matrices(directions)), walk.by_walk)
    mean: Floats = of_walk + product(_rotate_back(group, perpendicular_vectors(directions)), walk.by_direction)
    return mean


def _model_gradient(walk: WalkStatistics, directions: Floats) -> Floats:
    """(P,) Σ Jᵀ E r₂: the mean of the residuals, and of the fitted direction of the window, times the Jacobian."""
    tangent, model = perpendicular_vectors(directions), np.swapaxes(walk.rows.model, 1, 2)
    first, second = walk.follows[..., 0, :], walk.follows[..., 1, :]
    middle = np.cross(first, tangent[:, np.newaxis, :, 0]) + np.cross(second, tangent[:, np.newaxis, :, 1])  # Σ Hᵢ × tᵢ
    shorter = np.arange(model.shape[1]) + 0.5 * np.trace(walk.spread, axis1=1, axis2=2)[:, np.newaxis]
    along = np.einsum("wnj,wj->wn", middle, directions) - shorter
    mean = -model * along[..., np.newaxis] - np.einsum("wnka,wna->wnk", walk.own, middle @ tangent)
    pulled = np.einsum("wnka,wnk->wa", walk.own, mean) + _own_direction_gradient(walk, model, directions)
    left = mean - np.einsum("wnka,wab,wb->wnk", walk.own, walk.inverse, pulled)
    gradient: Floats = np.einsum("wknp,wnk->p", walk.rows.jacobian, left)
    return gradient


def _own_direction_gradient(walk: WalkStatistics, model: Floats, directions: Floats) -> Floats:
    """(W, 2) Σ E δUᵀ r, with δU the change of U by that of the tangents tᵢ: tᵢ × w from the walk, and −hᵢ v from h."""
    tangent = perpendicular_vectors(directions)
    axes = np.concatenate([np.swapaxes(tangent, 1, 2), directions[:, np.newaxis]], axis=1)
    first, second, middle = (np.einsum("wj,wnjk->wnk", axes[:, i], walk.by_walk) for i in range(3))
    by_direction = walk.by_direction
    sums = [
        model * (second - by_direction[:, :, 0]) - walk.own[..., 1] * middle,
        walk.own[..., 0] * middle - model * (first + by_direction[:, :, 1]),
    ]
    return np.stack([one.sum(axis=(1, 2)) for one in sums], axis=1)


def _gyro_gradient(walk: WalkStatistics, group: ObservationGroup, at: Parameters, layout: ParameterLayout) -> Floats:
    """(P,) mean gradient Σ E (P_k δB_k)ᵀ r_k of the gyro's own parameters.

    With E φ_j r_kᵀ = C_jᵀ Π U_kᵀ − P_kᵀ for steps j up to the reading, the mean is linear in D_j and b_j, with the same
    coefficients for all parameters of the gyro.
    """
    gradient = np.zeros(layout.size)
    if group.turned is None:
        return gradient
    of_noise, of_turn = _step_coefficients(walk)
    rotations = group.rotations
    seconds = np.zeros(group.weight.shape)
    seconds[:, 1:] = group.turned.interval[:, :-1]
    turned = np.einsum("wnij,wni,wn->wnj", rotations, of_turn, seconds)  # in the axes of the body
    if "gyro_bias" in layout:
        gradient[layout.columns["gyro_bias"]] = -turned.sum(axis=(0, 1))
    if "gyro_scale" in layout or "gyro_turn" in layout:
        before = np.roll(group.turned.rate - at.gyro_bias, 1, axis=1)
        along = np.einsum("wnij,wnik->jk", rotations, product(of_noise, rotations))  # Σ R_jᵀ … R_j
        along += turned.reshape(-1, 3).T @ before.reshape(-1, 3)
        of_all = [float(np.sum(along * (scale_matrix(unit) - np.eye(3)))) for unit in np.eye(9)]
        for name, part in (("gyro_scale", of_all[:6]), ("gyro_turn", of_all[6:])):
            if name in layout:
                gradient[layout.columns[name]] = part
    return gradient


def _step_coefficients(walk: WalkStatistics) -> tuple[Floats, Floats]:
    """(W, n, 3, 3) coefficient of D_j and (W, n, 3) coefficient of b_j in the mean gradient of the gyro's parameters.

    Both are sums over all readings from step j on.
    """
    since, stiff = np.swapaxes(walk.steps, 2, 3), product(np.swapaxes(walk.pushes, 2, 3), walk.pushes)
    stiffer = _reverse_cumsum(stiff)
    of_noise = product(since, np.einsum("wab,wnbj->wnaj", walk.inverse, walk.steps)) - stiffer
    of_noise[:, 0] = 0.0
    pulled = product(np.swapaxes(walk.products, 2, 3), walk.follows) - walk.age * stiff
    crossed = walk.age * stiffer + _reverse_cumsum(pulled) - product(since, walk.follows)
    of_turn = [crossed[..., j, i] - crossed[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    return of_noise, np.moveaxis(np.array(of_turn), 0, -1)


def _reverse_cumsum(steps: Floats) -> Floats:
    """(W, n, …) sums over each reading of a window and all later ones."""
    summed: Floats = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]
    return summed
