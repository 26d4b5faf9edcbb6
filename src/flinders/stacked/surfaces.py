"""Surfaces of many units, and one pass through the readings near each.

>>> import numpy as np
>>> from flinders.stacked.algebra import with_ones
>>> surfaces = EllipsoidBatch(np.zeros((1, 3)), 50.0 * np.eye(3)[None])
>>> readings = with_ones(np.array([[[51.0, 0.0], [0.0, 49.0], [0.0, 0.0]]]))
>>> surface(readings, surfaces.centre, surfaces.inverse)[4].round(12)
array([[ 1., -1.]])
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

from flinders.estimators.likelihood import SHORTEST_AXIS
from flinders.stacked.algebra import (
    ENOUGH,
    Array,
    applied,
    carriers,
    lengths,
    monomials,
    moving,
    namespace,
    rows_like,
    squares,
    symmetric,
    turned,
    weighed,
)

DOUBTFUL: Final = 1e-4
"""Of a limit: what is nearer to it might be decided otherwise by a sum in another order."""


@dataclass(frozen=True, eq=False)
class EllipsoidBatch:
    """U surfaces.

    Attributes
    ----------
    centre : (U, 3)
    shape : (U, 3, 3)
        As of `flinders.geometry.ellipsoid.Ellipsoid`.
    """

    centre: Array
    shape: Array

    @cached_property
    def inverse(self) -> Array:
        """(U, 3, 3) inverses of the shapes."""
        return namespace(self.shape).linalg.inv(self.shape)

    @cached_property
    def semi_axes(self) -> Array:
        """(U, 3) ascending."""
        return namespace(self.shape).linalg.eigvalsh(self.shape)

    @cached_property
    def radius(self) -> Array:
        """(U,) geometric means of the semi-axes."""
        xp = namespace(self.shape)
        return xp.maximum(xp.linalg.det(self.shape), 0.0) ** (1.0 / 3.0)

    def moved(self, step: Array) -> EllipsoidBatch:
        """Take (U, 9) steps in (b, S)."""
        return EllipsoidBatch(self.centre + step[:, :3], self.shape + symmetric(step[:, 3:]))

    @property
    def are_closed(self) -> Array:
        """(U,) bool, by a margin that rounding does not cross."""
        axes = self.semi_axes
        return axes[:, 0] > (1.0 + DOUBTFUL) * SHORTEST_AXIS * axes[:, 2]

    def only(self, which: Array) -> Self:
        """Those units that (K,) ascending integers name."""
        if which.shape[0] == self.centre.shape[0]:
            return self
        xp = namespace(which)
        return type(self)(xp.take(self.centre, which, axis=0), xp.take(self.shape, which, axis=0))


def of_units(readings: Array, inside: Array | None, at: Array) -> tuple[Array, Array | None]:
    """Readings and their places of units `at`, without a copy where those are all."""
    xp = namespace(readings)
    if at.shape[0] == readings.shape[0]:
        return readings, inside
    some = xp.permute_dims(xp.take(xp.permute_dims(readings, (1, 0, 2)), at, axis=1), (1, 0, 2))
    return some, None if inside is None else xp.take(inside, at, axis=0)


def surface(readings: Array, centre: Array, inverse: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Corrected readings y (u, 3, N), their directions and normals, and their lengths and distances s (u, N)."""
    y = turned(moving(inverse, centre), readings)
    length = lengths(y)
    unit = y * (1.0 / length)[:, None, :]
    normal = turned(inverse, unit)
    steepness = lengths(normal)
    flatness = 1.0 / steepness
    normal *= flatness[:, None, :]
    length -= 1.0
    length *= flatness
    return y, unit, normal, steepness, length


def products_at(readings: Array, inside: Array | None, centre: Array, inverse: Array) -> Array:
    """(u, 10, 10) products of Jacobian rows at the foot points and of distances, as `magnitude.equations`."""
    xp = namespace(readings)
    y = turned(moving(inverse, centre), readings)
    length, normal = lengths(y), turned(inverse, y)
    square = squares(normal)
    off = (length - 1.0) * length
    foot = turned(inverse, normal)
    foot *= (-off / square)[:, None, :]
    foot += y
    foot *= (1.0 / lengths(foot))[:, None, :]
    rows = monomials(foot, room=1)
    others = weighing(rows, off / xp.sqrt(square), squares(turned(inverse, foot)), inside)
    return carried(rows @ xp.matrix_transpose(others), inverse)


def weighing(rows: Array, distances: Array, square: Array, inside: Array | None) -> Array:
    """(u, 5, N) q/l² and s/l, with which rows of z and s l are multiplied; see `carried`.

    Parameters
    ----------
    rows : (u, 10, N)
        z, the `monomials` of directions, of which q are `ENOUGH`; its last row is filled with s l.
    distances : (u, N)
        s.
    square : (u, N)
        l², the squares of the lengths of normals.
    inside : (u, N) or None
    """
    xp = namespace(rows)
    length = xp.sqrt(square)
    others = rows_like(rows, 5)
    others[:, :4, :] = rows[:, ENOUGH, :]
    others[:, :4, :] *= (1.0 / square)[:, None, :]
    others[:, 4, :] = distances
    others[:, 4, :] /= length
    if inside is not None:
        others *= inside[:, None, :]
    rows[:, 9, :] = distances
    rows[:, 9, :] *= length
    return others


def carried(sums: Array, inverse: Array) -> Array:
    """(u, 10, 10) products of Jacobian rows and distances from (u, 10, 5) sums, see `carriers`."""
    xp = namespace(sums)
    products = xp.empty((sums.shape[0], 10, 10), dtype=sums.dtype, device=sums.device)
    carrier = carriers(inverse)
    products[:, :9, :9] = carrier @ weighed(sums[:, :9, :4]) @ xp.matrix_transpose(carrier)
    products[:, :9, 9] = applied(carrier, sums[:, :9, 4])
    products[:, 9, :9] = products[:, :9, 9]
    products[:, 9, 9] = sums[:, 9, 4]
    return products


def bent(readings: Array, inside: Array | None, centre: Array, inverse: Array) -> Array:
    """(u, 9) mean gradient that noise makes on a curved surface, as `magnitude.curvature`.

    With κ₁ = |V²d|²/|Vd|² and κ₂ = |V³d|²/|Vd|² of readings d off the centre, V being the inverse of the shape, the
    Laplacian of a distance over its steepness is tr V²/κ₁ − 2 κ₂/κ₁² + 1.
    """
    xp = namespace(readings)
    y = turned(moving(inverse, centre), readings)
    normal = turned(inverse, y)
    square, length = squares(normal), lengths(y)
    flat = length * length / square
    weight = squares(turned(inverse, normal)) / square
    weight *= -2.0
    weight += xp.linalg.trace(inverse @ inverse)[:, None]
    weight *= flat
    weight += 1.0
    if inside is not None:
        weight *= inside
    y *= (1.0 / length)[:, None, :]
    return 0.5 * applied(carriers(inverse), applied(monomials(y), weight))
