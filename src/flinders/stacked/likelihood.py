"""The likelihood of the readings of many units: from the consistent fit to what is claimed of independent residuals.

The steps are those of `flinders.estimators.likelihood`, in the same order and to the same tolerances, so that the
numbers are its to rounding. Whenever a unit needs something out of the ordinary, a shorter step, a direction that is
left to the prior, a decision that rounding could turn, it leaves the stack: nothing is said of it here, and
`flinders.fit` sees to it.

>>> import numpy as np
>>> from flinders.stacked.algebra import lengths, with_ones
>>> from flinders.stacked.consistent import consistent
>>> from flinders.stacked.sums import BatchMoments
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(4, 3, 200))
>>> readings = 50.0 * directions / lengths(directions)[:, None] + rng.normal(size=(4, 3, 200)) + 20.0
>>> readings = with_ones(readings)
>>> sums = BatchMoments.of(readings)
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

from flinders.estimators.likelihood import LONGEST_STEP, NO_WORSE, NOTHING, SETTLED_BUT_FOR_ONE, STEPS
from flinders.likelihood.equations import FINEST
from flinders.likelihood.prior import DEVIATOR, SENSE, SPREAD
from flinders.stacked.algebra import (
    Array,
    in_segments,
    like,
    namespace,
    put,
    scaled_inverse,
    scaled_solve,
    upper,
)
from flinders.stacked.support import Supports, spurious_information
from flinders.stacked.surfaces import DOUBTFUL, EllipsoidBatch, bent, of_units, products_at

if TYPE_CHECKING:
    from flinders.stacked.consistent import Started
    from flinders.stacked.sums import BatchMoments

SMALL_STEP: Final = 0.05
"""Of the radius: after such a step what was seen well is still seen, see `flinders.stacked.support.CLEARLY`."""


@dataclass(frozen=True, eq=False)
class Posteriors:
    """What readings and prior say near U surfaces, see `flinders.estimators.likelihood`.

    Attributes
    ----------
    at : (U,) int
        Which units of the stack they are.
    ellipsoids : EllipsoidBatch
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
    ellipsoids: EllipsoidBatch
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

    def step(self, bias: Array | float = 0.0) -> Array:
        """(U, 9) Gauss–Newton steps, with (U, 9) of the gradient taken off."""
        return scaled_solve(self.prior[:, :9, :9] + self.weighed, self.gradient - bias)

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


def likelihood(readings: Array, inside: Array | None, sums: BatchMoments, start: Started) -> BatchFit:
    """Settle all units from the consistent fit, as `flinders.estimators.likelihood.Likelihood` settles one.

    Parameters
    ----------
    readings : (U, 4, N)
        See `with_ones`.
    inside : (U, N) or None
        1 for readings, 0 for what fills the rows up.
    sums : BatchMoments
    start : Started

    Returns
    -------
    BatchFit
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


def _stepped(now: Posteriors, step: Array, readings: Array, inside: Array | None, sums: BatchMoments) -> Posteriors:
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
    readings: Array,
    inside: Array | None,
    at: Array,
    ellipsoids: EllipsoidBatch,
    sums: BatchMoments,
    *,
    sound: Array | None = None,
) -> Posteriors:
    """Linearise at surfaces: one pass through the readings of units `at`."""
    xp = namespace(readings)
    products = in_segments(
        products_at, *of_units(readings, inside, at), ellipsoids.centre, ellipsoids.inverse
    ) if at.shape[0] else xp.zeros((0, 10, 10), dtype=readings.dtype)  # fmt: skip
    sound = xp.zeros(at.shape, dtype=xp.bool) if sound is None else sound
    return Posteriors(at, ellipsoids, sums.count, products, sums.mean, sums.spread, sound)


def mild_and_sensible(ellipsoids: EllipsoidBatch, middle: Array, spread: Array) -> Array:
    """(U, 10, 10) products of the residuals of `likelihood.prior`, `equations` and `sense`, and their Jacobian."""
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


def mild(ellipsoids: EllipsoidBatch) -> Array:
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
    supports = _supports(now, readings, inside)
    object.__setattr__(now, "sound", now.sound | supports.are_clear)
    return now.sound | supports.are_plain


@dataclass(frozen=True, eq=False)
class BatchFit:
    """What the likelihood of U units gives, before it is known how their residuals hang together.

    Attributes
    ----------
    at : (U,) int
        Which units of the stack they are.
    ellipsoids : EllipsoidBatch
    noise : (U,)
    covariance : (U, 9, 9)
        For independent residuals.
    prior : (U, 9, 9)
        Information of the prior.
    variance : (U,)
        That readings are weighed with.
    prior_influence : (U,)
        Share of the worst known shape parameter that the prior speaks for.
    """

    at: Array
    ellipsoids: EllipsoidBatch
    noise: Array
    covariance: Array
    prior: Array
    variance: Array
    prior_influence: Array

    def only(self, which: Array) -> Self:
        """Those that (K,) ascending integers name."""
        if which.shape[0] == self.at.shape[0]:
            return self
        xp = namespace(which)
        at, noise, covariance, prior, variance, prior_influence = (
            xp.take(part, which, axis=0)
            for part in (self.at, self.noise, self.covariance, self.prior, self.variance, self.prior_influence)
        )
        return type(self)(at, self.ellipsoids.only(which), noise, covariance, prior, variance, prior_influence)


def _fitted(found: Posteriors, readings: Array, inside: Array | None) -> BatchFit:
    """Take the last step, with the bias of a curved surface subtracted, and claim what the readings support."""
    xp = namespace(readings)
    supports = _supports(found, readings, inside)
    (kept,) = xp.nonzero(supports.are_plain)
    found, information = found.only(kept), xp.take(supports.information, kept, axis=0)
    surfaces = found.ellipsoids
    bias = in_segments(
        bent, *of_units(readings, inside, found.at), surfaces.centre, surfaces.inverse
    ) if kept.shape[0] else 0.0  # fmt: skip
    moved = surfaces.moved(found.step(bias))
    covariance = scaled_inverse(found.prior[:, :9, :9] + information)
    prior_influence = _prior_influence(covariance, surfaces)
    fitted = BatchFit(found.at, moved, found.noise, covariance, found.prior[:, :9, :9], found.variance, prior_influence)
    return fitted.only(xp.nonzero(moved.are_closed)[0])


def _prior_influence(covariance: Array, ellipsoids: EllipsoidBatch) -> Array:
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
    surfaces = EllipsoidBatch(
        xp.take(xp.concat([part.ellipsoids.centre for part in parts]), order, axis=0),
        xp.take(xp.concat([part.ellipsoids.shape for part in parts]), order, axis=0),
    )
    return Posteriors(ellipsoids=surfaces, **{name: xp.take(column, order, axis=0) for name, column in columns.items()})


def _supports(now: Posteriors, readings: Array, inside: Array | None) -> Supports:
    """What the readings of a stack support where they were linearised."""

    def spurious(weak: Array) -> Array:
        part = now.only(weak)
        chosen = of_units(readings, inside, part.at)
        return in_segments(spurious_information, *chosen, part.ellipsoids.centre, part.ellipsoids.inverse)

    return Supports.of(now.weighed, spurious)
