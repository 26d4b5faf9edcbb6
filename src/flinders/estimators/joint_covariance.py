"""Covariance of a joint fit, with autocorrelated residuals and without spurious information.

The error of a fit depends on the scatter of the gradient Σ Jr. For white residuals this scatter is the normal matrix.
Four effects add to it:

- within a window, the gyro's noise gives a random walk of the direction: a step φ at reading j changes all later
  readings by S ΔR_kᵀ (v × φ), see `flinders.likelihood.gyro_noise`;
- residuals of single readings are correlated in time, as in `flinders.estimators.covariance`;
- parts of the recording differ by more than these effects explain: the factor `excess_variance`;
- the disturbing field of outliers fades slowly, so that readings before and after outliers are disturbed, too. If the
  gradient g of these readings is larger than by chance, g gᵀ is added to the scatter.

Spurious information is removed, as in `flinders.likelihood.identifiability` for the magnitude alone. The Jacobian of a
reading is evaluated at a direction q with noise, and at a vertical d with the accelerometer's noise. Both noises change
the Jacobian, and the squares of these changes add spurious information to JᵀJ. With the Jacobian J(q, d) after
elimination of the group's own direction the spurious information is

    Σ (∂J/∂ε)ᵀ (∂J/∂ε)

over the noises ε in standard deviations: two components of q and two components of d. It is negligible for
well-observed parameters. It matters for a body that tilts by only a few degrees: the true information on the bias of
its accelerometer, and on the offset along its vertical, is small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.estimators.covariance import BLOCK_COUNT, DRIFT_PROBABILITY, Residuals, correlation_length, largest_excess
from flinders.estimators.outliers import MARGIN_READINGS, is_near
from flinders.geometry.rotation import perpendicular_vectors, step_on_sphere
from flinders.likelihood import gyro_noise as walked
from flinders.likelihood.observations import (
    ObservationGroup,
    ObservationRows,
    inverse_matrices,
    mixed_products,
    orthonormalise,
    own_jacobian,
    residual_rows,
    unweighted_residuals,
)
from flinders.summary.pooling import p_value_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.joint import JointIterate, JointProblem

MAX_INFORMATION_READINGS: Final = 2000
"""Largest number of readings from which spurious information is computed."""

MAX_SPURIOUS_SHARE: Final = 0.9
"""Largest fraction of the information that is removed as spurious, so that the matrix stays positive definite."""


def joint_spurious_information(problem: JointProblem, iterate: JointIterate) -> Floats:
    """(P, P) spurious information in the normal matrix, from noise in the Jacobian."""
    size = problem.layout.size
    total = np.zeros((size, size))
    every = max(1, -(-sum(group.rows.size for group in iterate.groups) // MAX_INFORMATION_READINGS))
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        some, towards = group.thin_windows(every), directions[::every]
        seen = len(directions) / len(towards)
        for first, second in _noisy_jacobians(some, towards, problem, iterate):
            moved = 0.5 * (first - second).transpose(3, 1, 0, 2).reshape(size, -1)
            total += seen * (moved @ moved.T)
    return total


def subtract_spurious(matrix: Floats, spurious: Floats, believed: Floats) -> Floats:
    """(P, P) information: `matrix` of the readings minus `spurious` information, plus the prior's `believed`.

    >>> subtract_spurious(np.diag([4.0, 4.0]), np.diag([1.0, 0.0]), np.eye(2)).round(9)
    array([[4., 0.],
           [0., 5.]])
    """
    whole = matrix + believed
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 1e-15 * values[-1])) * scale[:, np.newaxis]  # whole = root rootᵀ
    inverse = np.linalg.inv(root)
    shares, ways = np.linalg.eigh(inverse @ spurious @ inverse.T)
    from_readings = np.einsum("ij,ik,kj->j", ways, inverse @ matrix @ inverse.T, ways)
    left = root @ ways
    less: Floats = (left * (1.0 - np.clip(shares, 0.0, MAX_SPURIOUS_SHARE * from_readings))) @ left.T
    return less


def _noisy_jacobians(
    group: ObservationGroup, directions: Floats, problem: JointProblem, iterate: JointIterate
) -> Iterator[tuple[Floats, Floats]]:
    """Yield a pair of Jacobians for each kind of noise: at plus and at minus one standard deviation."""

    def jacobian(group: ObservationGroup, directions: Floats) -> Floats:
        return eliminate_directions(residual_rows(group, iterate.at, directions, problem.layout, iterate.weights))[0]

    own = own_jacobian(group, iterate.at, directions, iterate.weights)
    covariance = inverse_matrices(np.einsum("wkna,wknb->wab", own, own))
    values, vectors = np.linalg.eigh(covariance)
    for steps in np.moveaxis(vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis], 2, 0):
        yield jacobian(group, step_on_sphere(directions, steps)), jacobian(group, step_on_sphere(directions, -steps))
    if group.down is None or group.attitudes is not None:
        return
    sigma = iterate.weights.vertical / np.sqrt(max(1.0 - iterate.at.sine**2, 1e-3))
    alternating = np.where(np.arange(group.down.shape[1]) % 2, sigma, -sigma)[:, np.newaxis]  # each on its own
    observed = np.asarray(group.down.any(axis=2, keepdims=True))
    for aside in np.moveaxis(
        perpendicular_vectors(np.where(observed, group.down, [0.0, 0.0, 1.0])) * observed[..., np.newaxis], 3, 0
    ):
        up, down = group.down + alternating * aside, group.down - alternating * aside
        yield jacobian(replace(group, down=up), directions), jacobian(replace(group, down=down), directions)


MAX_WALK_RAD: Final = 0.1
"""Largest random walk in rad within a window for the bias correction, which is of second order."""

MAX_WALK_SHARE: Final = 0.8
"""Largest fraction of the variance of residuals of verticals that is attributed to a random walk."""

WALK_STEPS: Final = 25
"""Number of steps in a window by which the size of a random walk is estimated."""

MAX_CORRELATION_READINGS: Final = 20_000
"""Largest number of readings by which the correlation of residuals is estimated."""

FADING_READINGS: Final = 10 * MARGIN_READINGS
"""Readings before and after outliers in which their field can fade: five seconds at 50 Hz."""


@dataclass(slots=True, eq=False)
class _Sums:
    """Sums over parts of the recording, to which each group of readings is added."""

    scatter: Floats  # (P, P): scatter of the gradient
    gradients: Floats  # (B, P): Σ Jr of each block
    squares: Floats  # (B, P, P): Σ JJᵀ of each block
    fading_gradient: Floats  # (P,): Σ Jr of the readings near outliers
    fading_squares: Floats  # (P, P): Σ JJᵀ of the readings near outliers

    @classmethod
    def of(cls, size: int) -> Self:
        """Sums of zero for `size` parameters."""
        square = np.zeros((size, size))
        return cls(
            square, np.zeros((BLOCK_COUNT, size)), np.zeros((BLOCK_COUNT, size, size)), np.zeros(size), square.copy()
        )

    @property
    def basis(self) -> Floats:
        """(P, K) basis in which the scatter is the unit matrix."""
        diagonal = np.sqrt(np.maximum(np.diag(self.scatter), 1e-300))
        values, vectors = np.linalg.eigh(self.scatter / np.outer(diagonal, diagonal))
        independent = values > 1e-9 * values[-1]
        basis: Floats = vectors[:, independent] / np.sqrt(values[independent]) / diagonal[:, np.newaxis]
        return basis


class DirectionRandomWalk(NamedTuple):
    """Random walk of the field's direction within windows, from the gyro's noise and similar errors."""

    variance: float  # rad² per reading, about each axis
    bias_gradient: Floats  # (P,): mean gradient from the walk
    own: float  # fraction of the variance of residuals of verticals that is not from the walk
    steps: Floats  # (P, P): scatter of the gradient from a walk of 1 rad² per reading


class Scatter(NamedTuple):
    """Scatter of the gradient of a fit."""

    covariance: Floats  # (P, P): covariance of the gradient, without slow drifts
    excess_variance: float  # ratio of variances: scatter of parts of the recording over that of `covariance`
    fading: Floats  # (P, P): scatter of the gradient from the fading field of outliers

    @property
    def whole(self) -> Floats:
        """(P, P) total scatter of the gradient."""
        return self.excess_variance * self.covariance + self.fading


class CorrelationLength(NamedTuple):
    """Correlation length and noise of the residuals of verticals."""

    readings: float  # correlation length in readings; at least 1
    noise: float  # standard deviation of dᵀq in rad, with the current weights


def vertical_correlation(iterate: JointIterate) -> CorrelationLength:
    """Estimate the correlation length of the residuals of verticals in the order of time.

    A vertical has a reduced weight for the correlation length τ of the last estimate, so that its own noise has the
    variance 1/τ in units of that weight. After the fit of the direction of its group, the share Q of a residual
    remains. The expected square of the residual is Q²/τ from the noise of the vertical plus Q − Q² from the noise of
    readings.
    """
    rows, residuals, expected = [], [], 0.0
    span = iterate.weights.span
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        if group.down is None or group.attitudes is not None or group.trust is None:
            continue
        _, vertical = unweighted_residuals(group, iterate.at, directions)
        if vertical is not None:
            observed = group.trust > 0.0
            rows.append(group.rows[observed])
            residuals.append(vertical[..., 0][observed] * np.sqrt(group.trust[observed]))
            left = _share_left(own_jacobian(group, iterate.at, directions, iterate.weights))[observed]
            expected += float(np.sum(left**2 + span * (left - left**2)))
    if not rows:
        return CorrelationLength(1.0, iterate.weights.vertical)
    residual = np.concatenate(residuals)[np.argsort(np.concatenate(rows), kind="stable")]
    alone = Residuals(residual - residual.mean(), np.zeros((len(residual), 1)), [np.arange(len(residual))])
    noise = math.sqrt(float(np.sum(residual**2)) / max(expected, 1e-300))
    return CorrelationLength(max(1.0, correlation_length(alone.autocovariance())), noise)


def _share_left(own: Floats) -> Floats:
    """(W, n) share of the residual of each vertical that remains after the fit of the direction of its group.

    `own` is the result of `own_jacobian`.
    """
    upright = orthonormalise(own)[0][:, 3]
    left: Floats = 1.0 - np.einsum("wna,wna->wn", upright, upright)
    return left


def estimate_random_walk(problem: JointProblem, iterate: JointIterate, textbook: Floats) -> DirectionRandomWalk:
    """Estimate the random walk of directions within windows.

    `textbook` is the (P, P) covariance for independent residuals.
    """
    size = problem.layout.size
    walks, bias_gradient, steps = np.zeros(2), np.zeros(size), np.zeros((size, size))
    longest, lifted, heights = 1, 0.0, 0.0
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        if group.turned is None:
            continue
        rows = residual_rows(group, iterate.at, directions, problem.layout, iterate.weights)
        jacobian, residual = eliminate_directions(rows)
        pushes = walked.rotation_derivatives(group, iterate.at, directions, iterate.weights)
        pulled = _sum_later(jacobian, pushes)
        walks += _walk_score(rows, residual, pushes, pulled, textbook)
        pulled[:, 0] = 0.0  # a window begins where its direction is
        flat = pulled.transpose(3, 2, 0, 1).reshape(size, -1)
        steps += flat @ flat.T
        whole = walked.WalkStatistics.of(rows, pushes)
        bias_gradient += walked.mean_gradient(whole, group, iterate.at, directions, problem.layout, iterate.weights)
        longest = max(longest, pushes.shape[2])
        if group.down is not None and group.attitudes is None and group.trust is not None:
            lifted += _walk_squares(rows, pushes)
            heights += float(np.count_nonzero(group.trust))
    variance = max(float(walks[0] / walks[1]), 0.0) if walks[1] > 0.0 else 0.0
    own = 1.0 - min(variance * lifted / max(heights, 1.0), MAX_WALK_SHARE)
    return DirectionRandomWalk(variance, min(variance, MAX_WALK_RAD**2 / longest) * bias_gradient, own, steps)


def gradient_scatter(problem: JointProblem, iterate: JointIterate, walk: DirectionRandomWalk) -> Scatter:
    """Scatter of the gradient, estimated from the residuals of a fit.

    `iterate` is the state at convergence; `walk` is the random walk of the same fit.
    """
    size = problem.layout.size
    evidence = _Sums.of(size)
    fading = _near_outliers(iterate.groups)
    readings = len(fading)
    looked, chosen = _choose_groups(iterate.groups)
    for index, (group, directions) in enumerate(zip(iterate.groups, iterate.directions, strict=True)):
        rows = residual_rows(group, iterate.at, directions, problem.layout, iterate.weights)
        jacobian, residual = eliminate_directions(rows)
        squares = _add_blocks(evidence, group.rows[:, 0] * BLOCK_COUNT // readings, jacobian, residual)
        _add_fading(evidence, np.asarray(fading[group.rows].any(axis=1)), jacobian, residual)
        if group.turned is not None:
            evidence.scatter += squares
        elif index in chosen:
            evidence.scatter += looked * _autocorrelated_scatter(
                rows, _free_directions(rows.own[:, :, 0], iterate.at.direction)
            )
    evidence.scatter += walk.variance * walk.steps
    excess = _excess_variance(evidence)
    return Scatter(evidence.scatter, excess, _fading_scatter(evidence, excess))


def _sum_later(rows: Floats, pushes: Floats) -> Floats:
    """(W, n, 3, m) sums over each reading of a window and all later ones of (W, k, n, m) rows times `pushes`."""
    windows, _, n, width = rows.shape
    products = np.empty((width, 3, windows, n)).transpose(2, 3, 1, 0)
    np.einsum("wknj,wknm->wnjm", pushes, rows, out=products)
    summed: Floats = np.cumsum(products[:, ::-1], axis=1)[:, ::-1]
    return summed


def _walk_score(rows: ObservationRows, residual: Floats, pushes: Floats, pulled: Floats, textbook: Floats) -> Floats:
    """(2,) score and information of the variance of a random walk; their ratio is the variance in rad² per reading.

    Let φ_j be the steps of the walk with the variance s, w_j their effects on the residuals, n white noise, and P the
    projection that removes fitted directions and parameters. For residuals r = P(n + Σ w_j φ_j) the mean of Σ (w_jᵀr)²
    is Σ w_jᵀPw_j + s Σ (w_jᵀPw_l)². The sums are over a subset of the steps j.
    """
    stride = max(1, pushes.shape[2] // WALK_STEPS)
    starts = slice(stride // 2, None, stride)
    seen = _sum_later(residual[..., np.newaxis], pushes)[:, starts, :, 0]
    own = rows.own.reshape(len(rows.own), -1, 2)
    inverse = inverse_matrices(np.swapaxes(own, 1, 2) @ own)
    of_own, of_all = _sum_later(rows.own, pushes)[:, starts], pulled[:, starts]
    squares = _sum_later(pushes, pushes)[:, starts]
    lumps = squares.shape[1]
    last = np.maximum.outer(np.arange(lumps), np.arange(lumps))
    gram = squares[:, last].transpose(0, 1, 3, 2, 4).reshape(len(own), 3 * lumps, 3 * lumps)
    flat_own, flat_all = of_own.reshape(len(own), -1, 2), of_all.reshape(len(own), 3 * lumps, -1)
    gram = gram - flat_own @ inverse @ np.swapaxes(flat_own, 1, 2) - flat_all @ textbook @ np.swapaxes(flat_all, 1, 2)
    score = float(np.sum(seen**2)) - float(np.trace(gram, axis1=1, axis2=2).sum())
    return np.array([score, stride * float(np.sum(gram**2))])


def _walk_squares(rows: ObservationRows, pushes: Floats) -> float:
    """Expected sum of squared residuals of verticals from a walk of 1 rad² per reading, after fitting directions."""
    own = rows.own.reshape(len(rows.own), -1, 2)
    inverse = inverse_matrices(np.swapaxes(own, 1, 2) @ own)
    upright, raised = rows.own[:, 3:], pushes[:, 3:]
    of_uprights = upright.reshape(len(own), -1, 2)
    taken = _sum_later(rows.own, pushes) @ inverse[:, np.newaxis]  # (W, n, 3, 2): change of the direction by each step
    squares = np.trace(_sum_later(raised, raised), axis1=2, axis2=3).sum()
    crossed = np.sum(_sum_later(upright, raised) * taken)
    of_own = np.swapaxes(of_uprights, 1, 2) @ of_uprights
    return float(squares - 2.0 * crossed + np.sum((taken @ of_own[:, np.newaxis]) * taken))


def _choose_groups(groups: Sequence[ObservationGroup]) -> tuple[float, set[int]]:
    """Choose groups of single readings for the correlation estimate.

    Returns the ratio of all single readings to those in the chosen groups, and the indices of these groups.
    """
    single = [index for index, group in enumerate(groups) if group.turned is None]
    total = sum(groups[index].rows.size for index in single)
    every = max(1, -(-total // MAX_CORRELATION_READINGS))
    chosen = set(single[::every])
    some = sum(groups[index].rows.size for index in chosen)
    return total / max(some, 1), chosen


def eliminate_directions(rows: ObservationRows) -> tuple[Floats, Floats]:
    """(W, k, n, P) Jacobian and (W, k, n) residuals after elimination of the direction of each window."""
    own, _ = orthonormalise(rows.own)
    pulled = np.einsum("wkna,wkn->wa", own, rows.residual)
    mixed = mixed_products(rows.jacobian, own)[:, np.newaxis, np.newaxis]
    jacobian, part = rows.jacobian.copy("K"), np.empty_like(rows.jacobian)
    for axis in range(2):
        jacobian -= np.multiply(own[..., axis, np.newaxis], mixed[..., axis], out=part)
    return jacobian, rows.residual - np.einsum("wkna,wa->wkn", own, pulled)


def _add_blocks(evidence: _Sums, block: NDArray[np.intp], jacobian: Floats, residual: Floats) -> Floats:
    """Add gradients and squares of W windows to the sums of their blocks; returns the (P, P) sum of all squares.

    `block` is the (W,) index of the block of each window.
    """
    total = np.zeros_like(evidence.scatter)
    for index in np.unique(block):
        inside = slice(*np.searchsorted(block, [index, index + 1]))
        rows = jacobian[inside].transpose(3, 1, 0, 2).reshape(jacobian.shape[-1], -1)
        squares = rows @ rows.T
        evidence.squares[index] += squares
        evidence.gradients[index] += np.einsum("wknp,wkn->p", jacobian[inside], residual[inside])
        total += squares
    return total


def _near_outliers(groups: Sequence[ObservationGroup]) -> NDArray[np.bool_]:
    """(N,) whether each reading is near outliers."""
    outliers = np.zeros(1 + max(int(group.rows.max()) for group in groups), dtype=bool)
    for group in groups:
        outliers[group.rows[group.weight == 0.0]] = True
    return is_near(FADING_READINGS, outliers) if outliers.any() else outliers


def _add_fading(evidence: _Sums, windows: NDArray[np.bool_], jacobian: Floats, residual: Floats) -> None:
    """Add gradient and squares of (W,) windows near outliers."""
    if windows.any():
        rows = jacobian[windows].transpose(3, 1, 0, 2).reshape(jacobian.shape[-1], -1)
        evidence.fading_squares += rows @ rows.T
        evidence.fading_gradient += rows @ np.swapaxes(residual[windows], 0, 1).ravel()


def _fading_scatter(evidence: _Sums, excess: float) -> Floats:
    """(P, P) scatter g gᵀ from the gradient g of readings near outliers; zero if chance explains g.

    Let N_f and N be the squares Σ JJᵀ of these readings and of all, and M = N_f/N − (N_f/N)². In the basis in which the
    scatter is the unit matrix, gᵀg has the mean tr M and the variance 2 tr M² by chance.
    """
    basis = evidence.basis
    gradient = evidence.fading_gradient @ basis / math.sqrt(excess)
    share = basis.T @ evidence.fading_squares @ basis @ np.linalg.pinv(basis.T @ evidence.squares.sum(axis=0) @ basis)
    free = share - share @ share
    expected, taken = float(np.trace(free)), float(np.sum(free * free.T))
    added = np.outer(evidence.fading_gradient, evidence.fading_gradient)
    if expected <= 0.0 or taken <= 0.0:
        return np.zeros_like(added)
    chance = p_value_of(float(gradient @ gradient) * expected / taken, max(round(expected**2 / taken), 1))
    return added if chance < DRIFT_PROBABILITY else np.zeros_like(added)


def _autocorrelated_scatter(rows: ObservationRows, basis: Floats) -> Floats:
    """(P, P) scatter of Σ J r of single readings whose residuals are correlated in time.

    Each kind of residual has its own autocovariance.
    """
    jacobian = np.einsum("wkf,wkp->wfp", basis, rows.jacobian[:, :, 0])
    residual = np.einsum("wkf,wk->wf", basis, rows.residual[:, :, 0])
    total = np.zeros((jacobian.shape[-1], jacobian.shape[-1]))
    for kind in range(residual.shape[1]):
        own = Residuals(residual[:, kind], jacobian[:, kind], [np.arange(len(residual))])
        total += own.scatter(own.autocovariance())
    return total


def _free_directions(own: Floats, direction: Floats) -> Floats:
    """(W, k, f) directions in the space of a reading's k residuals that its own fitted direction does not absorb.

    The first is along the normal of the surface. A vertical has one more. An attitude has two more, across the site's
    field in world axes, as errors of attitudes are correlated there.
    """
    count, kinds, _ = own.shape
    normal = np.cross(own[:, :3, 0], own[:, :3, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    if kinds == 3:
        return normal[..., np.newaxis]
    tangent = np.ones((1, 1)) if kinds == 4 else perpendicular_vectors(direction)
    free = np.zeros((count, kinds, 1 + tangent.shape[1]))
    free[:, :3, 0] = normal
    inverse = inverse_matrices(np.swapaxes(own, 1, 2) @ own)
    free[:, 3:, 1:] = tangent
    free[:, :, 1:] -= own @ (inverse @ (np.swapaxes(own[:, 3:], 1, 2) @ tangent))
    values, vectors = np.linalg.eigh(np.swapaxes(free[:, :, 1:], 1, 2) @ free[:, :, 1:])
    root = vectors / np.sqrt(np.maximum(values, 1e-300))[:, np.newaxis]
    free[:, :, 1:] = free[:, :, 1:] @ root @ np.swapaxes(vectors, 1, 2)
    return free


def _excess_variance(evidence: _Sums) -> float:
    """Ratio of variances, at least 1: scatter of parts of the recording over that expected from the whole.

    It is computed as `flinders.estimators.covariance.Residuals.excess_variance`, over all parameters.
    """
    basis = evidence.basis
    gradients = evidence.gradients @ basis
    squares = np.swapaxes(basis, 0, 1) @ evidence.squares @ basis
    inverse = np.linalg.pinv(squares.sum(axis=0))
    gradients = gradients - squares @ (inverse @ gradients.sum(axis=0))  # at convergence the sum is the bias by noise
    return largest_excess(gradients, squares, inverse)
