"""How far residuals of a joint fit hang together, and what that does to its covariance.

What a fit's error depends on is the scatter of Σ Jr. White residuals give the normal matrix itself. Three things add
to it:

- in a window, the gyro's noise makes a random walk of the direction: each step φ at reading j moves all later ones by
  S ΔR_kᵀ (v × φ), see `_pushes`;
- residuals of single readings hang together in time, as in `flinders.estimators.correlation`;
- stretches of the recording differ by more than that explains: the factor `creep`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.correlation import Residuals
from flinders.pooling import chance_of
from flinders.terms import turning
from flinders.terms.shared import Group, Rows, inverse_of, rows_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.estimators.joint import Found, Problem

BLOCKS: Final = 8
BY_CHANCE: Final = 0.02
"""Stretches of a recording that are held against each other; what chance makes more often than this is chance."""

COARSE: Final = 25
"""Steps of a walk within a window that are looked at for its size."""

LOOKED_AT: Final = 20_000
"""Readings that tell how residuals hang together."""


@dataclass(slots=True, eq=False)
class _Evidence:
    """What stretches of the recording say, added up group by group."""

    scatter: Floats
    gradients: Floats
    squares: Floats


def scatter_of(problem: Problem, found: Found, textbook: Floats) -> tuple[Floats, float, float]:
    """(P, P) covariance of the gradient, the random walk within windows in rad/√s, and the creep.

    Parameters
    ----------
    problem : Problem
    found : Found
        Where it settled.
    textbook : (P, P) float
        Covariance of the parameters for white residuals.
    """
    size = problem.layout.size
    evidence = _Evidence(np.zeros((size, size)), np.zeros((BLOCKS, size)), np.zeros((BLOCKS, size, size)))
    readings = 1 + max(int(group.rows.max()) for group in found.groups)
    walked, walks = np.zeros((size, size)), np.zeros(2)
    looked, chosen = _looked_at(found.groups)
    for index, (group, directions) in enumerate(zip(found.groups, found.directions, strict=True)):
        rows = rows_of(group, found.at, directions, problem.layout, found.weights)
        jacobian, residual = _projected(rows, group)
        _add_blocks(evidence, group, jacobian, residual, readings)
        if group.turned is not None:
            flat = jacobian.reshape(-1, size)
            evidence.scatter += flat.T @ flat
            pushes = _pushes(group, found, directions)
            pulled = _later(jacobian.reshape(*pushes.shape[:3], size), pushes)
            steps = pulled[:, 1:].reshape(-1, size)
            walked += steps.T @ steps
            walks += _walks(rows, residual.reshape(rows.residual.shape), pushes, pulled, textbook)
        elif index in chosen:
            evidence.scatter += looked * _hung_together(rows, group, jacobian, residual)
    per_step = max(float(walks[0] / walks[1]), 0.0) if walks[1] > 0.0 else 0.0
    evidence.scatter += per_step * walked
    return evidence.scatter, math.sqrt(per_step / max(problem.interval, 1e-9)), _creep(evidence)


def _pushes(group: Group, found: Found, directions: Floats) -> Floats:
    """(W, k, n, 3) how a turn φ, in the axes of the window's first reading, moves each residual after it."""
    turned = np.swapaxes(group.rotations, 2, 3) @ turning.cross_matrices(directions)[:, np.newaxis]
    weight = np.sqrt(group.weight) / found.weights.noise
    moved = np.swapaxes(found.at.ellipsoid_like @ turned * weight[..., np.newaxis, np.newaxis], 1, 2)
    if group.down is None or group.trust is None:
        return moved
    raised = np.einsum("wnk,wnkj->wnj", group.down, turned) * np.sqrt(group.trust)[..., np.newaxis]
    return np.concatenate([moved, raised[:, np.newaxis] / found.weights.vertical], axis=1)


def _later(rows: Floats, pushes: Floats) -> Floats:
    """(W, n, 3, m) Σ over reading j and all after it of (W, k, n, m) rows times what a turn at j does to them."""
    windows, kinds, n, width = rows.shape
    by_reading = np.swapaxes(pushes, 1, 2).reshape(windows * n, kinds, 3)
    products = np.swapaxes(by_reading, 1, 2) @ np.swapaxes(rows, 1, 2).reshape(windows * n, kinds, width)
    summed: Floats = np.cumsum(products.reshape(windows, n, 3, width)[:, ::-1], axis=1)[:, ::-1]
    return summed


def _walks(rows: Rows, residual: Floats, pushes: Floats, pulled: Floats, textbook: Floats) -> Floats:
    """(2,) score and information for the variance of a walk, in rad² a reading: their ratio is the estimate.

    For residuals r = P(n + Σ w_j φ_j), P taking off directions and parameters, Σ (w_jᵀr)² has the mean
    Σ w_jᵀPw_j + s Σ (w_jᵀPw_l)². A few of the steps j stand for all.
    """
    stride = max(1, pushes.shape[2] // COARSE)
    starts = slice(stride // 2, None, stride)
    seen = _later(residual[..., np.newaxis], pushes)[:, starts, :, 0]
    own = rows.own.reshape(len(rows.own), -1, 2)
    inverse = inverse_of(np.swapaxes(own, 1, 2) @ own)
    of_own, of_all = _later(rows.own, pushes)[:, starts], pulled[:, starts]
    squares = _later(pushes, pushes)[:, starts]
    lumps = squares.shape[1]
    last = np.maximum.outer(np.arange(lumps), np.arange(lumps))
    gram = squares[:, last].transpose(0, 1, 3, 2, 4).reshape(len(own), 3 * lumps, 3 * lumps)
    flat_own, flat_all = of_own.reshape(len(own), -1, 2), of_all.reshape(len(own), 3 * lumps, -1)
    gram = gram - flat_own @ inverse @ np.swapaxes(flat_own, 1, 2) - flat_all @ textbook @ np.swapaxes(flat_all, 1, 2)
    score = float(np.sum(seen**2)) - float(np.trace(gram, axis1=1, axis2=2).sum())
    return np.array([score, stride * float(np.sum(gram**2))])


def _looked_at(groups: Sequence[Group]) -> tuple[float, set[int]]:
    """Which groups without windows tell how residuals hang together, and for how many times as many they stand."""
    single = [index for index, group in enumerate(groups) if group.turned is None]
    total = sum(groups[index].rows.size for index in single)
    every = max(1, -(-total // LOOKED_AT))
    chosen = set(single[::every])
    some = sum(groups[index].rows.size for index in chosen)
    return total / max(some, 1), chosen


def _projected(rows: Rows, group: Group) -> tuple[Floats, Floats]:
    """Jacobian (W, k n, P) and residuals (W, k n) without what the windows' own directions take up."""
    count, width = len(rows.residual), rows.jacobian.shape[-1]
    jacobian, residual = rows.jacobian.reshape(count, -1, width), rows.residual.reshape(count, -1)
    if not group.is_eliminated:
        return jacobian, residual
    own = rows.own.reshape(count, -1, 2)
    taken = own @ inverse_of(np.swapaxes(own, 1, 2) @ own)
    left = residual - (taken @ (residual[:, np.newaxis] @ own).swapaxes(1, 2))[..., 0]
    return jacobian - taken @ (np.swapaxes(own, 1, 2) @ jacobian), left


def _add_blocks(evidence: _Evidence, group: Group, jacobian: Floats, residual: Floats, readings: int) -> None:
    """Add gradients and squares to the stretch of the recording they belong to."""
    if group.is_eliminated:
        block = np.minimum(group.rows[:, 0] * BLOCKS // readings, BLOCKS - 1)
    else:
        each = np.minimum(group.rows[0] * BLOCKS // readings, BLOCKS - 1)
        block = np.tile(each, 3)
        jacobian, residual = jacobian[0][:, np.newaxis], residual[0][:, np.newaxis]
    for index in np.unique(block):
        rows = jacobian[block == index].reshape(-1, jacobian.shape[-1])
        evidence.squares[index] += rows.T @ rows
        evidence.gradients[index] += residual[block == index].ravel() @ rows


def _hung_together(rows: Rows, group: Group, jacobian: Floats, residual: Floats) -> Floats:
    """(P, P) scatter of Σ J r with residuals that hang together in time, each kind on its own."""
    width = jacobian.shape[-1]
    if group.is_eliminated and group.weight.shape[1] == 1:
        basis = _free(rows.own[:, :, 0])
        jacobian = np.einsum("wkf,wkp->wfp", basis, rows.jacobian[:, :, 0])
        residual = np.einsum("wkf,wk->wf", basis, rows.residual[:, :, 0])
    else:
        jacobian = np.swapaxes(jacobian.reshape(-1, group.weight.shape[1], width), 0, 1)
        residual = residual.reshape(-1, group.weight.shape[1]).T
    total = np.zeros((width, width))
    for kind in range(residual.shape[1]):
        own = Residuals(residual[:, kind], jacobian[:, kind], [np.arange(len(residual))])
        total += own.scatter(own.autocovariance())
    return total


def _free(own: Floats) -> Floats:
    """(W, k, k − 2) directions of residual space that a reading's own direction leaves free: outward, and upward."""
    normal = np.cross(own[:, :3, 0], own[:, :3, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    if own.shape[1] == 3:
        return normal[..., np.newaxis]
    outward = np.concatenate([normal, np.zeros((len(own), 1))], axis=1)
    inverse = inverse_of(np.swapaxes(own, 1, 2) @ own)
    upward = -np.einsum("wka,wab,wb->wk", own, inverse, own[:, 3])
    upward[:, 3] += 1.0
    upward /= np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-300)
    return np.stack([outward, upward], axis=-1)


def _creep(evidence: _Evidence) -> float:
    """Factor by which stretches of the recording scatter more than a scatter of the whole allows; at least 1.

    As `flinders.estimators.correlation.Residuals.creep`, over all parameters.
    """
    diagonal = np.sqrt(np.maximum(np.diag(evidence.scatter), 1e-300))
    values, vectors = np.linalg.eigh(evidence.scatter / np.outer(diagonal, diagonal))
    kept = values > 1e-9 * values[-1]
    basis = vectors[:, kept] / np.sqrt(values[kept]) / diagonal[:, np.newaxis]
    gradients = evidence.gradients @ basis
    squares = np.swapaxes(basis, 0, 1) @ evidence.squares @ basis
    inverse = np.linalg.pinv(squares.sum(axis=0))
    largest = 1.0
    while len(gradients) >= 4:
        shares = inverse @ squares
        taken = float(np.sum(shares * np.swapaxes(shares, 1, 2)))
        total, expected = float(np.sum(gradients**2)), gradients.shape[1] - taken
        if expected > 0.0 and chance_of(total * expected / taken, max(round(expected**2 / taken), 1)) < BY_CHANCE:
            largest = max(largest, total / expected)
        gradients, squares = gradients[::2] + gradients[1::2], squares[::2] + squares[1::2]
    return largest
