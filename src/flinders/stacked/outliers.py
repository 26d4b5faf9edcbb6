"""Which of many units have residuals that ask for a robust fit: `flinders.estimators.robust.asks_for_it`, unit by unit.

The same statistics of the same readings, and the same few draws where those leave it open.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from flinders.estimators.robust import (
    ENOUGH_TO_JUDGE,
    FAR_OUT,
    FEW_DRAWS,
    FEW_SCORED,
    HEAVY_TAIL,
    LONGEST_AXIS,
    MASKED,
    NORMAL,
    PEAKED,
    PEAKED_ERRORS,
    POINTS,
    QUIET,
    RIDGE,
    SEED,
    TO_SIGMA,
    VERY_FAR_OUT,
)
from flinders.likelihood.equations import ROUNDING
from flinders.stacked.algebra import (
    Array,
    applied,
    lengths,
    like,
    moving,
    namespace,
    picked,
    symmetric,
    turned,
    with_ones,
)
from flinders.stacked.places import Sorted, medians, natural_sides
from flinders.stacked.surfaces import EllipsoidBatch, surface

_ROOTS: Final = np.eye(9) * ROUNDING

OUT_OF_THE_WAY: Final = 1e300
"""Is added to distances that do not count."""


def looked_for(radius: Array, distances: Array, places: Sorted) -> tuple[Array, Array, Array]:
    """(U,) whether residuals ask for a robust fit, whether that is open, and their standard deviations.

    Parameters
    ----------
    radius : (U,)
        Of the fit.
    distances : (U, N)
        From it.
    places : Sorted
    """
    xp = namespace(distances)
    off = xp.abs(picked(distances, places.order))
    kept = xp.astype(places.kept, off.dtype)
    many = xp.sum(kept, axis=1)
    sigma = _typical(off + (1.0 - kept) * OUT_OF_THE_WAY, many)
    off *= kept
    farthest = xp.max(off, axis=1)
    squares = off * off
    square = xp.sum(squares, axis=1) / many
    heavy = square > ((HEAVY_TAIL + 3.0 / xp.sqrt(many)) * sigma) ** 2
    kurtosis = xp.sum(squares * squares, axis=1) / many / xp.maximum(square * square, float(np.finfo(float).tiny))
    error = xp.sqrt(24.0 / many)
    peaked = kurtosis > xp.maximum(3.0 + PEAKED_ERRORS * error, PEAKED)
    enough = many >= ENOUGH_TO_JUDGE
    asked = xp.where(enough, heavy | peaked | (farthest > FAR_OUT * sigma), farthest > VERY_FAR_OUT * sigma)
    is_normal = (xp.abs(kurtosis - 3.0) < NORMAL * error) & (square < (QUIET * radius) ** 2)
    return asked, enough & ~asked & ~is_normal, sigma


def _typical(distances: Array, many: Array) -> Array:
    """(U,) standard deviations of the `many` smallest of (U, N) absolute distances, as `typical_distance`."""
    xp = namespace(distances)
    freedom = xp.maximum(many - 9.0, 1.0) / many
    return TO_SIGMA * medians(distances, xp.astype(many, xp.int64)) / xp.sqrt(freedom)


@lru_cache(maxsize=1024)
def _drawn(count: int, kept: int) -> tuple[np.ndarray, np.ndarray]:
    """(150,) readings that are scored of those kept, and (24, 12) draws among these, as for a recording of `count`."""
    rng = np.random.default_rng(SEED)
    rng.permutation(count)
    scored = rng.choice(kept, FEW_SCORED, replace=False)
    return scored, np.argsort(rng.random((FEW_DRAWS, FEW_SCORED)), axis=1)[:, :POINTS]


def may_be_bent(readings: Array, count: Array, sigma: Array) -> Array:
    """(U,) whether an ellipsoid through a few of (U, 4, N) readings is clearly nearer to the median one than the fit.

    From that they have (U,) standard deviations `sigma`. Also where it is not known.
    """
    xp = namespace(readings)
    places = Sorted.of(readings, count, natural_sides(readings, count))
    many = xp.sum(xp.astype(places.kept, xp.int64), axis=1)
    enough = many > FEW_SCORED
    pairs = zip(np.asarray(count).tolist(), np.asarray(many).tolist(), strict=True)
    drawn = [_drawn(whole, max(kept, FEW_SCORED + 1)) for whole, kept in pairs]
    spread = xp.sort(xp.where(places.kept, places.order, readings.shape[2]), axis=1)
    order = xp.minimum(spread, readings.shape[2] - 1)
    scored = picked(order, like(np.stack([pair[0] for pair in drawn]), readings) % readings.shape[2])
    some = picked(readings[:, :3, :], scored)
    middle = FEW_SCORED // 2
    ascending = xp.sort(some, axis=2)
    origin = 0.5 * (ascending[:, :, middle - 1] + ascending[:, :, middle])
    far = xp.sort(lengths(some - origin[:, :, None]), axis=1)
    scale = 0.5 * (far[:, middle - 1] + far[:, middle])
    local = (some - origin[:, :, None]) / scale[:, None, None]
    best, found = _best(local, like(np.stack([pair[1] for pair in drawn]), readings))
    other = EllipsoidBatch(origin + scale[:, None] * best.centre, scale[:, None, None] * best.shape)
    distances = xp.abs(surface(readings, other.centre, other.inverse)[4])
    distances = xp.where(places.kept, picked(distances, places.order), xp.inf)
    better = _typical(distances, xp.astype(many, readings.dtype)) < MASKED * sigma
    return ~enough | (found & better)


def _best(local: Array, draws: Array) -> tuple[EllipsoidBatch, Array]:
    """The draw of each unit that is nearest to half of (U, 3, 150) readings, and (U,) whether there is one."""
    xp = namespace(local)
    units, tried, points = draws.shape
    chosen = xp.reshape(picked(local, xp.reshape(draws, (units, -1))), (units, 3, tried, points))
    centres, inverses, closed = _ellipsoids(xp.reshape(xp.permute_dims(chosen, (0, 2, 1, 3)), (-1, 3, points)))
    moves, there = moving(inverses, centres), with_ones(local)
    length, steepness = (_lengths_of_each(each, there, tried) for each in (moves, inverses @ moves))
    off = xp.sort(xp.abs(length - 1.0) * length / steepness, axis=2)[:, :, FEW_SCORED // 2]
    scores = xp.where(xp.reshape(closed, (units, tried)), off, xp.inf)
    at = xp.argmin(scores, axis=1) + tried * xp.arange(units)
    shape = xp.linalg.inv(xp.take(inverses, at, axis=0))
    return EllipsoidBatch(xp.take(centres, at, axis=0), shape), xp.isfinite(xp.min(scores, axis=1))


def _lengths_of_each(moves: Array, readings: Array, tried: int) -> Array:
    """(U, H, N) lengths of (U, 4, N) readings as each of H (3, 4) matrices moves them, at least 1e-12."""
    xp = namespace(readings)
    moved = turned(xp.reshape(moves, (readings.shape[0], 3 * tried, 4)), readings)
    square = moved[:, ::3, :] ** 2 + moved[:, 1::3, :] ** 2 + moved[:, 2::3, :] ** 2
    return xp.maximum(xp.sqrt(square), 1e-12)


def _ellipsoids(points: Array) -> tuple[Array, Array, Array]:
    """Centres (H, 3) and inverse shapes (H, 3, 3) through (H, 3, 12) points, and (H,) whether they are sensible.

    As `flinders.estimators.robust` finds them; those that are not sensible are unit spheres.
    """
    xp = namespace(points)
    x, y, z = points[:, 0, :], points[:, 1, :], points[:, 2, :]
    rows = xp.stack([x * x - z * z, y * y - z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z, xp.ones_like(x)], axis=1)
    normal = rows @ xp.matrix_transpose(rows) + like(RIDGE, points)
    normal = normal + xp.linalg.trace(normal)[:, None, None] * like(_ROOTS, points)
    found = -xp.linalg.solve(normal, applied(rows, x * x + y * y + z * z)[:, :, None])[:, :, 0]
    a, b = found[:, 0], found[:, 1]
    form = symmetric(xp.concat([xp.stack([1.0 + a, 1.0 + b, 1.0 - a - b], axis=1), found[:, 2:5]], axis=1))
    values, vectors = xp.linalg.eigh(form)
    closed = values[:, 0] > xp.maximum(LONGEST_AXIS**-2 * values[:, 2], 1e-9)
    values = xp.where(closed[:, None], values, 1.0)
    linear = applied(xp.matrix_transpose(vectors), found[:, 5:8])
    level = 0.25 * xp.sum(linear**2 / values, axis=1) - found[:, 8]
    closed = closed & (level > 0.0)
    roots = xp.sqrt(values / xp.where(closed, level, 1.0)[:, None])
    centres = applied(vectors, -0.5 * linear / values)
    return centres, (vectors * roots[:, None, :]) @ xp.matrix_transpose(vectors), closed
