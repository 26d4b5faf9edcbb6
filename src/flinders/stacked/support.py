"""Which directions of parameter space the readings of many units see, and how much of that noise only pretends.

As `flinders.likelihood.identifiability` looks at one.

>>> supports = Supports.of(np.eye(9)[None], lambda weak: np.zeros((len(weak), 9, 9)))
>>> supports.are_clear, supports.are_plain
(array([ True]), array([ True]))
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.likelihood.identifiability import UNSEEN, WELL_CONDITIONED
from flinders.stacked.algebra import (
    ENOUGH,
    Array,
    applied,
    carriers,
    gathered,
    lengths,
    like,
    lower_times_diagonal,
    monomials,
    moving,
    namespace,
    outer,
    put,
    scale_of,
    squares,
    turned,
    weighed,
)
from flinders.stacked.surfaces import DOUBTFUL

if TYPE_CHECKING:
    from collections.abc import Callable


WEAKEST: Final = 1e-5
"""Smallest eigenvalue of a scaled normal matrix with which rounding is still far below a billionth."""

CLEARLY: Final = 0.25
"""Of what would be unseen: with less of it a small step does not make noise pretend as much as that."""


@dataclass(frozen=True, eq=False)
class Supports:
    """Directions of parameter space of U units, see `flinders.likelihood.identifiability.Support`.

    Attributes
    ----------
    are_clear : (U,) bool
        All directions are seen well, or noise pretends so little of what is known of any that this is still so after a
        small step.
    information : (U, 9, 9)
        What remains of the normal matrix after what noise pretends.
    are_plain : (U,) bool
        All directions are seen, by more than rounding could change.
    """

    are_clear: Array
    information: Array
    are_plain: Array

    @classmethod
    def of(cls, information: Array, spurious: Callable[[Array], Array]) -> Self:
        """Look at normal matrices, and at what noise pretends where they are not well-conditioned.

        Parameters
        ----------
        information : (U, 9, 9)
            In standard deviations.
        spurious : callable
            Gives the (K, 9, 9) matrices of `spurious_information` of those that (K,) integers name.
        """
        xp = namespace(information)
        finite = xp.all(xp.isfinite(information), axis=(1, 2))
        information = xp.where(finite[:, None, None], information, like(np.eye(9), information))
        scale = scale_of(information)
        scaled = information / outer(scale)
        least = (1.0 + DOUBTFUL) * WELL_CONDITIONED
        _, diagonal = lower_times_diagonal(scaled - least * like(np.eye(9), scaled))
        sound = finite & xp.all(diagonal > 0.0, axis=0)
        (weak,) = xp.nonzero(~sound)
        if not weak.shape[0]:
            return cls(sound, information, sound)
        scale = xp.take(scale, weak, axis=0)
        values, vectors = xp.linalg.eigh(xp.take(scaled, weak, axis=0))
        smallest = values[:, 0]
        plain = (smallest < (1.0 - DOUBTFUL) * WELL_CONDITIONED) & (smallest > WEAKEST)
        noise = xp.sum(vectors * ((spurious(weak) / outer(scale)) @ vectors), axis=1)
        share = xp.clip(noise / xp.maximum(values, float(np.finfo(float).tiny)), 0.0, 1.0)
        spread = vectors * scale[:, :, None]
        left = (spread * (values * (1.0 - share) ** 2)[:, None, :]) @ xp.matrix_transpose(spread)
        most = xp.max(share, axis=1)
        seen = plain & (most < (1.0 - DOUBTFUL) * UNSEEN)
        return cls(
            put(sound, weak, seen & (most < CLEARLY * UNSEEN)), put(information, weak, left), put(sound, weak, seen)
        )


def spurious_information(readings: Array, inside: Array | None, centre: Array, inverse: Array) -> Array:
    """(u, 9, 9) information that noise pretends, for a unit of its variance, as `support.spurious_information`.

    A direction t along the surface, at right angles to the normal n, turns the row of a reading in the direction u by
    f = (B t − (uᵀV³t/|Vu|²) T z)/|Vu|, see `carriers`, with B t = ``gathered(V²t, u) + gathered(Vu, Vt)``, of which the
    last counts for the shape only. With B V u = C z and B V³u = D z, what two such directions give is the sum over all
    less that of n: products of monomials in four weights, and no row of any reading.

    Parameters
    ----------
    readings : (u, 4, N)
    inside : (u, N), optional
        How often each counts.
    centre, inverse : (u, 3), (u, 3, 3)
    """
    xp = namespace(readings)
    unit = turned(moving(inverse, centre), readings)
    unit *= (1.0 / lengths(unit))[:, None, :]
    normal = turned(inverse, unit)
    along = turned(inverse, normal)
    flat, once, twice = 1.0 / squares(normal), squares(along), squares(turned(inverse, along))
    weights = [flat if inside is None else flat * inside]
    weights.append(weights[0] * flat)
    weights.append(weights[1] * (once * flat))
    weights.append(weights[1] * flat * (twice - once * once * flat))
    rows = monomials(unit)
    first, second, third, fourth = (
        weighed(rows @ xp.matrix_transpose(rows[:, ENOUGH, :] * weight[:, None, :])) for weight in weights
    )
    square = inverse @ inverse
    normals, c, d = carriers(inverse), _along(inverse, square, inverse), _along(inverse, square, square @ inverse)
    mixed = (c @ third - d @ second) @ xp.matrix_transpose(normals)
    found = normals @ fourth @ xp.matrix_transpose(normals) - c @ second @ xp.matrix_transpose(c)
    return _turning(inverse, square, first) + found + mixed + xp.matrix_transpose(mixed)


_PAIRED: Final = np.zeros((9, 6))
_PAIRED[np.arange(9), [0, 5, 4, 5, 1, 3, 4, 3, 2]] = 1.0
"""Which product of two coordinates is which of the last six `monomials`."""
_ONE, _OTHER = np.divmod(np.arange(9), 3)


def _paired(one: Array, other: Array) -> Array:
    """(u, 6, 9) what (u, 3, 3) matrices X and Y give of ``gathered(X a, Y b)`` for the shape, by products aᵢ bⱼ."""
    xp = namespace(one)
    left, right = xp.take(one, like(_ONE, one), axis=2), xp.take(other, like(_OTHER, other), axis=2)
    return gathered(left, right)[:, 3:, :]


def _along(inverse: Array, square: Array, power: Array) -> Array:
    """(u, 9, 9) matrices C that give B Vᵏu = C z of `monomials` z of u, for the (u, 3, 3) `power` Vᵏ."""
    xp = namespace(inverse)
    same = xp.zeros_like(inverse) + like(np.eye(3), inverse)
    products = _paired(square @ power, same) + _paired(inverse, inverse @ power)
    carried = xp.zeros((inverse.shape[0], 9, 9), dtype=inverse.dtype, device=inverse.device)
    carried[:, :3, :3] = square @ power
    carried[:, 3:, 3:] = products @ like(_PAIRED, products)
    return carried


def _turning(inverse: Array, square: Array, sums: Array) -> Array:
    """(u, 9, 9) Σ w B Bᵀ from (u, 9, 9) Σ w zzᵀ; B is V² for the offset, and linear in u for the shape."""
    xp = namespace(inverse)
    same = xp.zeros_like(inverse) + like(np.eye(3), inverse)
    second, first = sums[:, :3, :3], xp.sum(sums[:, :3, 3:6], axis=2)
    of_steps, of_turns = (xp.reshape(_paired(*both), (-1, 6, 3, 3)) for both in ((square, same), (inverse, inverse)))
    linear = of_steps + xp.matrix_transpose(of_turns)  # by the axis of t, then of u
    found = xp.zeros_like(sums)
    found[:, :3, :3] = xp.linalg.trace(second)[:, None, None] * (square @ square)
    for axis in range(3):
        own = linear[:, :, axis, :]
        found[:, :3, 3:] += square[:, :, axis, None] * applied(own, first)[:, None, :]
        found[:, 3:, 3:] += own @ second @ xp.matrix_transpose(own)
    found[:, 3:, :3] = xp.matrix_transpose(found[:, :3, 3:])
    return found
