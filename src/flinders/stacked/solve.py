"""Ellipsoids of many units at once: the consistent fit from sums, and the likelihood from readings.

The steps are those of `flinders.estimators.consistent` and of `flinders.estimators.likelihood`, in the same order
and to the same tolerances, so that the numbers are theirs to rounding. Whenever a unit needs something out of the
ordinary, a shorter step, a direction that is left to the prior, a decision that rounding could turn, it leaves the
stack: nothing is said of it here, and `flinders.fit` sees to it.

>>> from flinders.stacked.algebra import with_ones
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(4, 3, 200))
>>> readings = 50.0 * directions / lengths(directions)[:, None] + rng.normal(size=(4, 3, 200)) + 20.0
>>> readings = with_ones(readings)
>>> sums = Sums.of(readings)
>>> start = consistent(sums)
>>> found = likelihood(readings, None, sums, start)
>>> found.at.tolist(), found.ellipsoids.centre.round().tolist()[0]
([0, 1, 2, 3], [20.0, 20.0, 20.0])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.estimators.consistent import HEAT
from flinders.estimators.consistent import STEPS as NEWTON_STEPS
from flinders.estimators.estimate import FINEST
from flinders.estimators.likelihood import LONGEST_STEP, NO_WORSE, NOTHING, SETTLED_BUT_FOR_ONE, SHORTEST_AXIS, STEPS
from flinders.stacked.algebra import (
    ENOUGH,
    Array,
    applied,
    carriers,
    gathered,
    in_stretches,
    lengths,
    like,
    lower_times_diagonal,
    monomials,
    moving,
    namespace,
    outer,
    put,
    rows_like,
    scale_of,
    scaled_inverse,
    scaled_solve,
    signs,
    solved_with,
    squares,
    symmetric,
    turned,
    upper,
    weighed,
)
from flinders.stacked.sums import PACKING, Sums
from flinders.terms.prior import DEVIATOR, SENSE, SPREAD
from flinders.terms.support import UNSEEN, WELL_CONDITIONED

if TYPE_CHECKING:
    from collections.abc import Callable

WEAKEST: Final = 1e-5
"""Smallest eigenvalue of a scaled normal matrix with which rounding is still far below a billionth."""

DOUBTFUL: Final = 1e-4
"""Of a limit: what is nearer to it might be decided otherwise by a sum in another order."""

SMALL_STEP, CLEARLY = 0.05, 0.25
"""Of the radius, and of what would be unseen: so small a step does not make noise pretend four times as much."""

INVERSE_STEPS: Final = 8
"""Of the variance; four are usual."""

HARDLY_CLOSED: Final = 1e-6
"""Of the largest eigenvalue of a quadric: below it is an open surface, or one that rounding may open."""


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """U surfaces.

    Attributes
    ----------
    centre : (U, 3)
    shape : (U, 3, 3)
        As of `flinders.quadric.Ellipsoid`.
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

    def moved(self, step: Array) -> Ellipsoids:
        """Take (U, 9) steps in (b, S)."""
        return Ellipsoids(self.centre + step[:, :3], self.shape + symmetric(step[:, 3:]))

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


@dataclass(frozen=True, eq=False)
class Started:
    """What the consistent fit gives.

    Attributes
    ----------
    ellipsoids : Ellipsoids
    noise : (U,)
        In the unit of the readings.
    are_plain : (U,) bool
        A closed surface was found, in as many steps as are allowed; else the rest means nothing.
    """

    ellipsoids: Ellipsoids
    noise: Array
    are_plain: Array


def consistent(sums: Sums) -> Started:
    """Fit all units from their sums as `flinders.estimators.consistent.adjusted` fits one."""
    xp = namespace(sums.values)
    coefficients, variance, settled = _adjusted(sums.about(sums.mean, sums.spread))
    local, closed = _ellipsoids_of(coefficients)
    spread = sums.spread
    found = Ellipsoids(sums.mean + spread[:, None] * local.centre, spread[:, None, None] * local.shape)
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
    return coefficients / size, variance, settled & xp.isfinite(size[:, 0])


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


def _ellipsoids_of(coefficients: Array) -> tuple[Ellipsoids, Array]:
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
    return Ellipsoids(centre, shape), closed


@dataclass(frozen=True, eq=False)
class Posteriors:
    """What readings and prior say near U surfaces, see `flinders.estimators.likelihood`.

    Attributes
    ----------
    at : (U,) int
        Which units of the stack they are.
    ellipsoids : Ellipsoids
        Where they were linearised.
    count : (U,)
        Readings.
    products : (U, 10, 10)
        Σ of the products of Jacobian and distance, of the readings in their unit.
    middle, spread : (U, 3), (U,)
        Mean reading, and root mean square distance from it.
    sound : (U,) bool
        A step before has shown that all directions are seen well.
    """

    at: Array
    ellipsoids: Ellipsoids
    count: Array
    products: Array
    middle: Array
    spread: Array
    sound: Array

    @cached_property
    def noise(self) -> Array:
        """(U,) standard deviation of the residuals."""
        xp = namespace(self.products)
        return xp.sqrt(xp.maximum(self.products[:, 9, 9], 0.0) / xp.maximum(self.count - 9.0, 1.0))

    @cached_property
    def variance(self) -> Array:
        """(U,) that readings are weighed with."""
        return namespace(self.noise).maximum(self.noise, FINEST * self.ellipsoids.radius) ** 2

    @cached_property
    def weighed(self) -> Array:
        """(U, 9, 9) normal matrices of the readings, in standard deviations."""
        return self.products[:, :9, :9] / self.variance[:, None, None]

    @cached_property
    def prior(self) -> Array:
        """(U, 10, 10) the prior's, with gradient and cost in the last column."""
        return mild_and_sensible(self.ellipsoids, self.middle, self.spread)

    @property
    def gradient(self) -> Array:
        """(U, 9) of both."""
        return self.prior[:, :9, 9] + self.products[:, :9, 9] / self.variance[:, None]

    def step(self, bent: Array | float = 0.0) -> Array:
        """(U, 9) Gauss–Newton steps, with (U, 9) of the gradient taken off."""
        return scaled_solve(self.prior[:, :9, :9] + self.weighed, self.gradient - bent)

    def cost(self, variance: Array) -> Array:
        """(U,) χ² of the readings for a noise variance, and the prior's."""
        return self.products[:, 9, 9] / variance + self.prior[:, 9, 9]

    def only(self, which: Array) -> Posteriors:
        """Those that (K,) ascending integers name."""
        if which.shape[0] == self.at.shape[0]:
            return self
        xp = namespace(which)
        parts = (self.count, self.products, self.middle, self.spread, self.sound)
        return Posteriors(
            xp.take(self.at, which),
            self.ellipsoids.only(which),
            *(xp.take(part, which, axis=0) for part in parts),
        )


def likelihood(readings: Array, inside: Array | None, sums: Sums, start: Started) -> Fitted:
    """Settle all units from the consistent fit, as `flinders.estimators.likelihood.Likelihood` settles one.

    Parameters
    ----------
    readings : (U, 4, N)
        See `with_ones`.
    inside : (U, N) or None
        1 for readings, 0 for what fills the rows up.
    sums : Sums
    start : Started

    Returns
    -------
    Fitted
        Of those units for which each decision was the plain one.
    """
    xp = namespace(readings)
    (at,) = xp.nonzero(start.are_plain)
    now = _seen(readings, inside, at, start.ellipsoids.only(at), sums.only(at))
    settled: list[Posteriors] = []
    for _ in range(STEPS):
        now = now.only(xp.nonzero(_are_seen(now, readings, inside))[0])
        if not now.at.shape[0]:
            break
        step = now.step()
        longest = xp.max(xp.abs(step), axis=1) / now.ellipsoids.radius
        settled.append(now.only(xp.nonzero(longest < (1.0 - DOUBTFUL) * SETTLED_BUT_FOR_ONE)[0]))
        (on,) = xp.nonzero(longest > (1.0 + DOUBTFUL) * SETTLED_BUT_FOR_ONE)
        if not on.shape[0]:
            break
        cut = xp.minimum(LONGEST_STEP / xp.take(longest, on), 1.0)
        now = _stepped(now.only(on), xp.take(step, on, axis=0) * cut[:, None], readings, inside, sums)
    return _fitted(_joined(settled) if settled else now, readings, inside)


def _stepped(now: Posteriors, step: Array, readings: Array, inside: Array | None, sums: Sums) -> Posteriors:
    """Take full steps; those units for which one opens the surface or makes the fit worse leave the stack."""
    xp = namespace(readings)
    moved = now.ellipsoids.moved(step)
    (kept,) = xp.nonzero(moved.are_closed)
    now = now.only(kept)
    small = xp.max(xp.abs(xp.take(step, kept, axis=0)), axis=1) < SMALL_STEP * now.ellipsoids.radius
    tried = _seen(readings, inside, now.at, moved.only(kept), sums.only(now.at), sound=now.sound & small)
    (better,) = xp.nonzero(tried.cost(now.variance) <= now.cost(now.variance) + (1.0 - DOUBTFUL) * NO_WORSE)
    return tried.only(better)


def _seen(
    readings: Array, inside: Array | None, at: Array, ellipsoids: Ellipsoids, sums: Sums, *, sound: Array | None = None
) -> Posteriors:
    """Linearise at surfaces: one pass through the readings of units `at`."""
    xp = namespace(readings)
    products = in_stretches(
        products_at, *of_units(readings, inside, at), ellipsoids.centre, ellipsoids.inverse
    ) if at.shape[0] else xp.zeros((0, 10, 10), dtype=readings.dtype)  # fmt: skip
    sound = xp.zeros(at.shape, dtype=xp.bool) if sound is None else sound
    return Posteriors(at, ellipsoids, sums.count, products, sums.mean, sums.spread, sound)


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


def _bent(readings: Array, inside: Array | None, centre: Array, inverse: Array) -> Array:
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


def mild_and_sensible(ellipsoids: Ellipsoids, middle: Array, spread: Array) -> Array:
    """(U, 10, 10) products of the residuals of `flinders.terms.prior`, `equations` and `sense`, and their Jacobian."""
    xp = namespace(middle)
    rows = xp.zeros((middle.shape[0], 10, 10), dtype=middle.dtype, device=middle.device)
    rows[:, :6, :] = mild(ellipsoids)
    width = SENSE * spread
    for axis in range(3):
        rows[:, 6 + axis, axis] = -1.0 / width
        rows[:, 9, 3 + axis] = -1.0 / (3.0 * width)
    rows[:, 6:9, 9] = (ellipsoids.centre - middle) / width[:, None]
    rows[:, 9, 9] = (xp.linalg.trace(ellipsoids.shape) / 3.0 - spread) / width
    return xp.matrix_transpose(rows) @ rows


def mild(ellipsoids: Ellipsoids) -> Array:
    """(U, 6, 10) Jacobian and, in the last column, residual of the prior on soft iron."""
    xp = namespace(ellipsoids.shape)
    entries = upper(ellipsoids.shape)
    trace = xp.sum(entries[:, :3], axis=1)
    scale = (math.sqrt(2.0) * SPREAD / 3.0) * trace
    residual = entries @ like(DEVIATOR.T, entries) / scale[:, None]
    rows = xp.zeros((entries.shape[0], 6, 10), dtype=entries.dtype, device=entries.device)
    rows[:, :, 3:9] = -like(DEVIATOR, entries) / scale[:, None, None]
    rows[:, :, 3:6] += residual[:, :, None] / trace[:, None, None]
    rows[:, :, 9] = residual
    return rows


def _are_seen(now: Posteriors, readings: Array, inside: Array | None) -> Array:
    """(U,) whether all directions are seen; sets `sound` of those where they are seen well."""
    xp = namespace(readings)
    if bool(xp.all(now.sound)):
        return now.sound
    supports = Supports.at(now, readings, inside)
    object.__setattr__(now, "sound", now.sound | supports.are_clear)
    return now.sound | supports.are_plain


@dataclass(frozen=True, eq=False)
class Supports:
    """Directions of parameter space of U units, see `flinders.terms.support.Support`.

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
    def of(cls, information: Array, pretence: Callable[[Array], Array]) -> Self:
        """Look at normal matrices, and at what noise pretends where they are not well-conditioned.

        Parameters
        ----------
        information : (U, 9, 9)
            In standard deviations.
        pretence : callable
            Gives the (K, 9, 9) matrices of `flinders.terms.support.pretended` of those that (K,) integers name.
        """
        xp = namespace(information)
        scale = scale_of(information)
        scaled = information / outer(scale)
        least = (1.0 + DOUBTFUL) * WELL_CONDITIONED
        _, diagonal = lower_times_diagonal(scaled - least * like(np.eye(9), scaled))
        sound = xp.all(diagonal > 0.0, axis=0)
        (weak,) = xp.nonzero(~sound)
        if not weak.shape[0]:
            return cls(sound, information, sound)
        scale = xp.take(scale, weak, axis=0)
        values, vectors = xp.linalg.eigh(xp.take(scaled, weak, axis=0))
        smallest = values[:, 0]
        plain = (smallest < (1.0 - DOUBTFUL) * WELL_CONDITIONED) & (smallest > WEAKEST)
        noise = xp.sum(vectors * ((pretence(weak) / outer(scale)) @ vectors), axis=1)
        share = xp.clip(noise / xp.maximum(values, float(np.finfo(float).tiny)), 0.0, 1.0)
        spread = vectors * scale[:, :, None]
        left = (spread * (values * (1.0 - share) ** 2)[:, None, :]) @ xp.matrix_transpose(spread)
        most = xp.max(share, axis=1)
        seen = plain & (most < (1.0 - DOUBTFUL) * UNSEEN)
        return cls(
            put(sound, weak, seen & (most < CLEARLY * UNSEEN)), put(information, weak, left), put(sound, weak, seen)
        )

    @classmethod
    def at(cls, now: Posteriors, readings: Array, inside: Array | None) -> Self:
        """Those of the readings of a stack where they were linearised."""

        def pretence(weak: Array) -> Array:
            part = now.only(weak)
            chosen = of_units(readings, inside, part.at)
            return in_stretches(pretended, *chosen, part.ellipsoids.centre, part.ellipsoids.inverse)

        return cls.of(now.weighed, pretence)


def pretended(readings: Array, inside: Array | None, centre: Array, inverse: Array) -> Array:
    """(u, 9, 9) information that noise pretends, for a unit of its variance, as `support.pretended`.

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


@dataclass(frozen=True, eq=False)
class Fitted:
    """What the likelihood of U units gives, before it is known how their residuals hang together.

    Attributes
    ----------
    at : (U,) int
        Which units of the stack they are.
    ellipsoids : Ellipsoids
    noise : (U,)
    covariance : (U, 9, 9)
        For independent residuals.
    prior : (U, 9, 9)
        Information of the prior.
    variance : (U,)
        That readings are weighed with.
    held : (U,)
        Share of the worst known shape parameter that the prior speaks for.
    """

    at: Array
    ellipsoids: Ellipsoids
    noise: Array
    covariance: Array
    prior: Array
    variance: Array
    held: Array

    def only(self, which: Array) -> Self:
        """Those that (K,) ascending integers name."""
        if which.shape[0] == self.at.shape[0]:
            return self
        xp = namespace(which)
        at, noise, covariance, prior, variance, held = (
            xp.take(part, which, axis=0)
            for part in (self.at, self.noise, self.covariance, self.prior, self.variance, self.held)
        )
        return type(self)(at, self.ellipsoids.only(which), noise, covariance, prior, variance, held)


def _fitted(found: Posteriors, readings: Array, inside: Array | None) -> Fitted:
    """Take the last step, with the bias of a curved surface subtracted, and claim what the readings support."""
    xp = namespace(readings)
    supports = Supports.at(found, readings, inside)
    (kept,) = xp.nonzero(supports.are_plain)
    found, information = found.only(kept), xp.take(supports.information, kept, axis=0)
    surfaces = found.ellipsoids
    bent = in_stretches(
        _bent, *of_units(readings, inside, found.at), surfaces.centre, surfaces.inverse
    ) if kept.shape[0] else 0.0  # fmt: skip
    moved = surfaces.moved(found.step(bent))
    covariance = scaled_inverse(found.prior[:, :9, :9] + information)
    held = _held(covariance, surfaces)
    fitted = Fitted(found.at, moved, found.noise, covariance, found.prior[:, :9, :9], found.variance, held)
    return fitted.only(xp.nonzero(moved.are_closed)[0])


def _held(covariance: Array, ellipsoids: Ellipsoids) -> Array:
    """(U,) largest share of the information about any parameters that is the prior's, as `Likelihood` finds it."""
    xp = namespace(covariance)
    rows = mild(ellipsoids)[:, :, :9]
    at_most = xp.sum(covariance * (xp.matrix_transpose(rows) @ rows), axis=(1, 2))
    (much,) = xp.nonzero(at_most >= NOTHING)
    if not much.shape[0]:
        return at_most
    some = xp.take(rows, much, axis=0)
    carried = some @ xp.take(covariance, much, axis=0) @ xp.matrix_transpose(some)  # (6, 6), of the same eigenvalues
    largest = xp.linalg.eigvalsh(carried)[:, -1:]
    return put(at_most[:, None], much, xp.clip(largest, 0.0, 1.0))[:, 0]


def _joined(parts: list[Posteriors]) -> Posteriors:
    """Put those together that settled after unlike numbers of steps, in the order of the stack."""
    if len(parts) == 1:
        return parts[0]
    xp = namespace(parts[0].at)
    names = ("at", "count", "products", "middle", "spread", "sound")
    columns = {name: xp.concat([getattr(part, name) for part in parts]) for name in names}
    order = xp.argsort(columns["at"])
    surfaces = Ellipsoids(
        xp.take(xp.concat([part.ellipsoids.centre for part in parts]), order, axis=0),
        xp.take(xp.concat([part.ellipsoids.shape for part in parts]), order, axis=0),
    )
    return Posteriors(ellipsoids=surfaces, **{name: xp.take(column, order, axis=0) for name, column in columns.items()})
