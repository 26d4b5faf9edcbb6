"""The consistent fit of many units, from their sums.

As `flinders.estimators.consistent` fits one, to rounding.

>>> from flinders.stacked.algebra import lengths, with_ones
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(4, 3, 200))
>>> readings = 50.0 * directions / lengths(directions)[:, None] + rng.normal(size=(4, 3, 200)) + 20.0
>>> found = consistent(BatchMoments.of(with_ones(readings)))
>>> bool(found.are_plain.all()), found.ellipsoids.centre.round().tolist()[0]
(True, [20.0, 20.0, 20.0])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from flinders.estimators.consistent import HEAT
from flinders.estimators.consistent import STEPS as NEWTON_STEPS
from flinders.stacked.algebra import (
    Array,
    applied,
    like,
    lower_times_diagonal,
    namespace,
    put,
    signs,
    solved_with,
    symmetric,
)
from flinders.stacked.sums import PACKING, BatchMoments
from flinders.stacked.surfaces import EllipsoidBatch

INVERSE_STEPS: Final = 8
"""Of the variance; four are usual."""

HARDLY_CLOSED: Final = 1e-6
"""Of the largest eigenvalue of a quadric: below it is an open surface, or one that rounding may open."""


@dataclass(frozen=True, eq=False)
class Started:
    """What the consistent fit gives.

    Attributes
    ----------
    ellipsoids : EllipsoidBatch
    noise : (U,)
        In the unit of the readings.
    are_plain : (U,) bool
        A closed surface was found, in as many steps as are allowed; else the rest means nothing.
    """

    ellipsoids: EllipsoidBatch
    noise: Array
    are_plain: Array


def consistent(sums: BatchMoments) -> Started:
    """Fit all units from their sums as `flinders.estimators.consistent.adjusted` fits one."""
    xp = namespace(sums.values)
    coefficients, variance, settled = _adjusted(sums.about(sums.mean, sums.spread))
    local, closed = _ellipsoids_of(coefficients)
    spread = sums.spread
    found = EllipsoidBatch(sums.mean + spread[:, None] * local.centre, spread[:, None, None] * local.shape)
    return Started(found, spread * xp.sqrt(variance), settled & closed)


def _adjusted(scatter: Array) -> tuple[Array, Array, Array]:
    """(U, 10) coefficients, (U,) noise variances, (U,) whether they settled, see `adjusted_quadric`."""
    xp = namespace(scatter)
    first, second = _corrections(scatter)
    coefficients, variance, settled = _by_inverse_iteration(scatter, first, second)
    (others,) = xp.nonzero(~settled)
    if not others.shape[0]:
        return coefficients, variance, settled
    own, ours, sure = _by_eigenvalues(*(xp.take(part, others, axis=0) for part in (scatter, first, second)))
    return put(coefficients, others, own), put(variance, others, ours), put(settled, others, sure)


def _by_inverse_iteration(scatter: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """The same for those units that settle quickly: (U, 10), (U,), and (U,) whether they have.

    A solution with the corrected matrix turns the coefficients towards its smallest eigenvalue, and the variance
    follows their Rayleigh quotient: to third order, at a tenth of the cost of all eigenvalues. Nine positive entries of
    D say that none is below the one that is found.
    """
    xp = namespace(scatter)
    coefficients = xp.broadcast_to(like(_SPHERE, scatter), (scatter.shape[0], 10))
    variance, settled = xp.zeros_like(scatter[:, 0, 0]), xp.zeros((scatter.shape[0],), dtype=xp.bool)
    for step in range(INVERSE_STEPS):
        square = variance**2
        corrected = scatter + variance[:, None, None] * first + square[:, None, None] * second
        columns, diagonal = lower_times_diagonal(corrected)
        found = solved_with(columns, diagonal, coefficients)
        if not step:
            found = solved_with(columns, diagonal, found / xp.max(xp.abs(found), axis=1, keepdims=True))
        found = found / xp.max(xp.abs(found), axis=1, keepdims=True)
        coefficients = xp.where(settled[:, None], coefficients, found)
        of_scatter, of_first, of_second = (
            xp.sum(coefficients * applied(matrix, coefficients), axis=1) for matrix in (scatter, first, second)
        )
        slope = of_first + 2.0 * variance * of_second
        proposed = variance - (of_scatter + variance * of_first + square * of_second) / slope
        positive = xp.all(diagonal[:9, :] > 0.0, axis=0) & (slope < 0.0) & (proposed >= 0.0)
        now = positive & (xp.abs(proposed - variance) <= 1e-14 + 1e-11 * variance)
        variance = xp.where(settled | now, variance, proposed)
        settled = settled | now
        if bool(xp.all(settled)):
            break
    size = xp.sqrt(xp.sum(coefficients * coefficients, axis=1, keepdims=True))
    return coefficients / size, xp.maximum(variance, 0.0), settled & xp.isfinite(size[:, 0])


def _by_eigenvalues(scatter: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """The same by all eigenvalues of each step, for any units."""
    xp = namespace(scatter)
    low = xp.zeros_like(scatter[:, 0, 0])
    high = xp.linalg.eigvalsh(scatter[:, 6:9, 6:9])[:, 0] / scatter[:, 9, 9]
    variance, at = low, xp.arange(scatter.shape[0], device=scatter.device)
    done: list[tuple[Array, Array, Array]] = []
    for _ in range(NEWTON_STEPS):
        corrected = scatter + variance[:, None, None] * first + (variance**2)[:, None, None] * second
        values, vectors = xp.linalg.eigh(corrected)
        smallest, coefficients = values[:, 0], vectors[:, :, 0]
        low, high = xp.where(smallest > 0.0, variance, low), xp.where(smallest > 0.0, high, variance)
        sloped = first + 2.0 * variance[:, None, None] * second
        slope = xp.sum(coefficients * applied(sloped, coefficients), axis=1)
        falls = slope < 0.0
        proposed = xp.where(falls, variance - smallest / xp.where(falls, slope, -1.0), high)
        proposed = xp.where((low <= proposed) & (proposed <= high), proposed, (low + high) / 2.0)
        settled = xp.abs(proposed - variance) <= 1e-14 + 1e-11 * variance
        (there,), (on,) = xp.nonzero(settled), xp.nonzero(~settled)
        done.append(tuple(xp.take(part, there, axis=0) for part in (at, coefficients, variance)))
        if not on.shape[0]:
            break
        at, scatter, first, second, low, high, variance = (
            xp.take(part, on, axis=0) for part in (at, scatter, first, second, low, high, proposed)
        )
    else:
        done.append((at, xp.full((at.shape[0], 10), xp.nan), variance))
    order = xp.argsort(xp.concat([part[0] for part in done]))
    coefficients, variance = (xp.take(xp.concat([part[i] for part in done]), order, axis=0) for i in (1, 2))
    return coefficients, xp.maximum(variance, 0.0), xp.isfinite(coefficients[:, 0])


_TWICE: Final = 0.5 * HEAT @ HEAT

_SPHERE: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
"""Coefficients of the unit sphere, from which all coefficients begin."""


def _corrections(scatter: Array) -> tuple[Array, Array]:
    """(U, 10, 10) what a unit of noise variance, and its square, take off (U, 10, 10) scatter matrices."""
    xp = namespace(scatter)
    doubled = like(PACKING.doubled, scatter)
    packed = xp.take(xp.reshape(scatter / doubled, (-1, 100)), like(PACKING.first, scatter), axis=1)
    product = like(PACKING.product.ravel(), scatter)
    first, second = (
        xp.reshape(xp.take(packed @ like(heat.T, scatter), product, axis=1), (-1, 10, 10)) * doubled
        for heat in (HEAT, _TWICE)
    )
    return first, second


def _ellipsoids_of(coefficients: Array) -> tuple[EllipsoidBatch, Array]:
    """Ellipsoids of (U, 10) coefficients, and (U,) whether they are closed; the others are unit spheres."""
    xp = namespace(coefficients)
    finite = xp.all(xp.isfinite(coefficients), axis=1)
    coefficients = xp.where(finite[:, None], coefficients, 0.0)
    form = symmetric(coefficients[:, :6])
    sign = signs(xp.linalg.trace(form))
    form, coefficients = form * sign[:, None, None], coefficients * sign[:, None]
    values, vectors = xp.linalg.eigh(form)
    closed = finite & (values[:, 0] > HARDLY_CLOSED * xp.abs(values[:, 2]))
    values = xp.where(closed[:, None], values, 1.0)
    linear = applied(xp.matrix_transpose(vectors), coefficients[:, 6:9])
    centre = applied(vectors, linear / (-2.0 * values))
    level = xp.sum(centre * applied(form, centre), axis=1) - coefficients[:, 9]
    closed = closed & (level > 0.0)
    axes = xp.sqrt(xp.where(closed, level, 1.0)[:, None] / values)
    shape = (vectors * axes[:, None, :]) @ xp.matrix_transpose(vectors)
    return EllipsoidBatch(centre, shape), closed
