"""The fast lane: a stack of units from readings to judged calibrations, all at once.

A unit that needs anything but the plain course leaves the stack on the way; `Lane.at` names those that came through.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.stacked.stack import Stack
>>> tumbles = [simulate.tumble(seed=seed, n=500, motion="uniform").samples for seed in range(3)]
>>> judged = through(Stack.of(tumbles), target_deg=1.0, dip_deg=60.0)
>>> judged.at.tolist(), judged.numbers["worst_deg"].round(3) < 1.0
([0, 1, 2], array([ True,  True,  True]))
>>> alone = calibrate.fit(tumbles[0])
>>> bool(np.isclose(judged.numbers["worst_deg"][0], alone.heading_error_deg.worst, rtol=1e-9))
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.units import EARTH_UT, MICROTESLA
from flinders.diagnostics.unmoved import NARROW
from flinders.estimators.covariance import FEW as FEW_TO_CORRELATE
from flinders.estimators.data import LARGEST, SMALLEST
from flinders.estimators.likelihood import GLANCE
from flinders.likelihood.equations import FINEST
from flinders.likelihood.identifiability import FLATTEST
from flinders.stacked.algebra import (
    ENOUGH,
    Array,
    carriers,
    diagonals,
    in_segments,
    like,
    monomials,
    moving,
    namespace,
    put,
    scaled_inverse,
    squares,
    turned,
    weighed,
    with_ones,
)
from flinders.stacked.consistent import consistent
from flinders.stacked.hung import BatchResiduals, autocorrelated, may_have_changed, may_have_slipped
from flinders.stacked.judge import BatchQuality, Evidence, errors_facing, found_in
from flinders.stacked.likelihood import likelihood
from flinders.stacked.outliers import looked_for, may_be_bent
from flinders.stacked.places import Means, Sorted, covered, natural_sides
from flinders.stacked.sums import BatchMoments
from flinders.stacked.support import Supports, spurious_information
from flinders.stacked.surfaces import DOUBTFUL, EllipsoidBatch, of_units

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.findings import Severity
    from flinders.stacked.stack import Stack

FEWEST, MOST = FEW_TO_CORRELATE, 2 * GLANCE - 1
"""Readings of a unit, between which each pass goes through all of them."""

FARTHEST: Final = 20.0
"""Offset in spreads of the readings up to which sums about zero keep eleven digits."""

CANCELLED: Final = 1e7
"""Fourth moments over noise variance times spread squared: beyond that a variance from sums has lost nine digits."""

QUIETEST: Final = 1e-5
"""Of the readings: of less noise than that rounding leaves nine digits no more."""

UPPER: Final = np.flatnonzero(np.triu(np.ones((9, 9))).ravel())
"""The 45 entries of a covariance on and above its diagonal, row by row."""


@dataclass(frozen=True, eq=False)
class Lane:
    """What came of those units of a stack that came through.

    Attributes
    ----------
    at : (K,) int
        Which they are.
    numbers : mapping of (K,) or (K, m) arrays
        Columns of the table of a fleet, by name.
    findings : mapping of (K,) bool
        By code and severity, the most severe first.
    method : str
    """

    at: Array
    numbers: Mapping[str, Array]
    findings: Mapping[tuple[str, Severity], Array]
    method: str = "likelihood"

    def only(self, which: Array) -> Lane:
        """Those that (J,) ascending integers name."""
        xp = namespace(which)
        return Lane(
            xp.take(self.at, which),
            {name: xp.take(column, which, axis=0) for name, column in self.numbers.items()},
            {finding: xp.take(there, which) for finding, there in self.findings.items()},
            self.method,
        )


def through(stack: Stack, *, target_deg: float, dip_deg: float, polish: bool = True) -> Lane:
    """Fit, widen and judge those units of a stack that take the plain course.

    Parameters
    ----------
    stack : Stack
    target_deg, dip_deg : float
        As for `flinders.fit`.
    polish : bool
        Go through the readings; else the consistent fit from their sums.
    """
    units = _turned(_Units.of(stack), stack.unit.inside)
    if not units.at.shape[0]:
        return Lane(units.at, {}, {})
    claimed = (_of_readings if polish else _of_sums)(units)
    if claimed is None:
        return Lane(units.at[:0], {}, {})
    xp = namespace(claimed.covariance)
    (kept,) = xp.nonzero(claimed.are_plain)
    return _judged(units.only(claimed.units).only(kept), claimed.only(kept), stack.unit.inside, target_deg, dip_deg)


@dataclass(frozen=True, eq=False)
class _Units:
    """Units of a stack that are still in it: (U, 4, N) readings `with_ones` and what belongs to them."""

    at: Array
    readings: Array
    inside: Array | None
    count: Array
    sums: BatchMoments
    health: BatchQuality
    steps: Array | None

    @classmethod
    def of(cls, stack: Stack) -> Self:
        """All that have finite readings, as many as each pass goes through."""
        xp = namespace(stack.readings)
        inside = stack.inside
        finite = xp.all(xp.isfinite(xp.sum(stack.readings, axis=2)), axis=1)
        counts = like(stack.counts, stack.readings)
        (at,) = xp.nonzero(finite & (counts >= FEWEST) & (counts <= MOST))
        readings, inside = with_ones(stack.readings), None if inside is None else like(inside, stack.readings)
        chosen, there = of_units(readings, inside, at)
        count = xp.take(counts, at)
        if not at.shape[0]:
            none = xp.zeros((0,), dtype=stack.readings.dtype)
            return cls(at, chosen, there, count, BatchMoments(none, none), BatchQuality(none, none, none, none), None)
        steps = stack.steps
        steps = None if steps is None else xp.take(like(steps, stack.readings), at, axis=0)
        health = BatchQuality.of(chosen, there, count)
        sums = BatchMoments.of(chosen, there, xp.max(xp.maximum(health.high, -health.low), axis=1))
        return cls(at, chosen, there, count, sums, health, steps)

    @property
    def counted(self) -> Array:
        """(U,) readings, as numbers."""
        return namespace(self.readings).astype(self.count, self.readings.dtype)

    def only(self, which: Array) -> _Units:
        """Those that (K,) ascending integers name."""
        if which.shape[0] == self.at.shape[0]:
            return self
        xp = namespace(which)
        chosen, inside = of_units(self.readings, self.inside, which)
        at, count = xp.take(self.at, which), xp.take(self.count, which)
        steps = None if self.steps is None else xp.take(self.steps, which, axis=0)
        return _Units(at, chosen, inside, count, self.sums.only(which), self.health.only(which), steps)


def _turned(units: _Units, inside: str) -> _Units:
    """Those of sound health whose numbers can be calculated with, and that were turned out of one plane.

    Those whose readings lie close together beside their mean leave, too: the sensor may have been hardly turned.
    """
    xp = namespace(units.readings)
    if not units.at.shape[0]:
        return units
    sums = units.sums
    in_scale = (sums.unit > SMALLEST) & (sums.unit < LARGEST)
    size = xp.sqrt(xp.sum(sums.mean**2, axis=1))
    near = size < FARTHEST * sums.spread
    variances = xp.linalg.eigvalsh(xp.where((in_scale & near)[:, None, None], sums.covariance, 0.0))
    thick = variances[:, 0] > (1.0 + DOUBTFUL) * FLATTEST**2 * variances[:, 2]
    level = xp.minimum(size, EARTH_UT[1]) if inside == MICROTESLA else size
    wide = variances[:, 2] > (NARROW * level) ** 2
    return units.only(xp.nonzero(in_scale & near & thick & wide & units.health.are_sound)[0])


@dataclass(frozen=True, eq=False)
class _Claimed:
    """What is claimed of units: each attribute with U rows, see `Estimate`.

    Attributes
    ----------
    units : (U,) int
        Which of the units they are.
    ellipsoids : EllipsoidBatch
    covariance : (U, 9, 9)
    noise, prior_influence, lag_one : (U,)
    independent : (U,)
        Readings that say as much.
    repeated : (U,)
        Factor by which repeated readings widened the covariance.
    counts : (U, 100)
        Readings by direction.
    has_hole, are_plain : (U,) bool
    method : str
    """

    units: Array
    ellipsoids: EllipsoidBatch
    covariance: Array
    noise: Array
    prior_influence: Array
    lag_one: Array
    independent: Array
    repeated: Array
    counts: Array
    has_hole: Array
    are_plain: Array
    method: str

    def only(self, which: Array) -> _Claimed:
        """Those that (K,) ascending integers name."""
        xp = namespace(which)
        names = ("units", "covariance", "noise", "prior_influence", "lag_one", "independent", "repeated",
                 "counts", "has_hole", "are_plain")  # fmt: skip
        columns = {name: xp.take(getattr(self, name), which, axis=0) for name in names}
        return _Claimed(ellipsoids=self.ellipsoids.only(which), method=self.method, **columns)


def _of_readings(units: _Units) -> _Claimed | None:
    """The likelihood of the readings, widened for how their residuals hang together; None where all have left."""
    xp = namespace(units.readings)
    found = likelihood(units.readings, units.inside, units.sums, consistent(units.sums))
    if not found.at.shape[0]:
        return None
    units = units.only(found.at)
    surfaces = found.ellipsoids
    left = BatchResiduals.of(units.readings, units.inside, units.count, surfaces)
    hangs = autocorrelated(units.readings, units.inside, units.count, surfaces, left)
    counts, has_hole, clear, open_, sigma = in_segments(
        placed, units.readings, units.count, surfaces.centre, surfaces.inverse, surfaces.radius, left.distances
    )
    (doubtful,) = xp.nonzero(clear & open_)
    if doubtful.shape[0]:
        part = units.only(doubtful)
        bent = in_segments(may_be_bent, part.readings, part.count, xp.take(sigma, doubtful))
        clear = put(clear, doubtful, ~bent)
    (coloured,) = xp.nonzero(~hangs.are_white)
    changed = xp.zeros(units.at.shape, dtype=xp.bool)
    if coloured.shape[0]:
        part = units.only(coloured)
        moved = may_have_changed(part.readings, part.inside, part.count, surfaces.only(coloured), left.only(coloured))
        changed = put(changed, coloured, moved | may_have_slipped(part.readings, part.count))
    covariance = hangs.widened(found)
    share = units.counted / xp.maximum(units.counted - units.health.repeats, 1.0)
    known = xp.mean(diagonals(covariance) / diagonals(found.covariance), axis=1)
    repeated = xp.maximum(share / known, 1.0)
    independent = hangs.effective(units.counted / repeated)
    loud = found.noise > QUIETEST * xp.sqrt(xp.sum(units.sums.mean**2, axis=1) + units.sums.spread**2)
    return _Claimed(found.at, surfaces, covariance, found.noise, found.prior_influence, hangs.lag_one, independent,
                    repeated, counts, has_hole, hangs.are_plain & clear & ~changed & loud, "likelihood")  # fmt: skip


def placed(
    readings: Array, count: Array, centre: Array, inverse: Array, radius: Array, distances: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Coverage, holes, whether nothing asks for a robust fit and whether that is open, and standard deviations."""
    places = Sorted.of(readings, count, natural_sides(readings, count))
    means = Means.of(turned(moving(inverse, centre), readings), places)
    counts, has_hole = covered(means, readings.shape[0])
    asked, open_, sigma = looked_for(radius, distances, places)
    return counts, has_hole, places.are_plain & ~asked, open_, sigma


def _of_sums(units: _Units) -> _Claimed | None:
    """The consistent fit, and what it claims; None where all have left."""
    xp = namespace(units.readings)
    start = consistent(units.sums)
    (closed,) = xp.nonzero(start.are_plain)
    if not closed.shape[0]:
        return None
    units, surfaces, noise = units.only(closed), start.ellipsoids.only(closed), xp.take(start.noise, closed)
    covariance, counts, has_hole, clear = in_segments(
        _claimed_of_sums, units.readings, units.count, surfaces.centre, surfaces.inverse, surfaces.shape, noise
    )
    repeated = units.counted / xp.maximum(units.counted - units.health.repeats, 1.0)
    sums, none = units.sums, xp.zeros_like(noise)
    far = xp.sum(sums.mean**2, axis=1) / sums.spread**2
    clear = clear & ((1.0 + far**2) * sums.spread**2 < CANCELLED * noise**2)
    return _Claimed(closed, surfaces, covariance, noise, none, none, none + xp.inf, repeated, counts, has_hole, clear,
                    "consistent")  # fmt: skip


def _claimed_of_sums(
    readings: Array, count: Array, centre: Array, inverse: Array, shape: Array, noise: Array
) -> tuple[Array, Array, Array, Array]:
    """Covariances as of `algebraic_covariance`, coverage, holes, and whether all was plain, of one stretch of units."""
    xp = namespace(readings)
    places = Sorted.of(readings, count, natural_sides(readings, count), ranked=False)
    means = Means.of(turned(moving(inverse, centre), readings), places)
    units = readings.shape[0]
    counts, has_hole = covered(means, units)
    surfaces = EllipsoidBatch(centre, shape)
    directions, many = means.table(xp.arange(units), units)
    variance = (xp.maximum(noise, FINEST * surfaces.radius) ** 2)[:, None, None]
    information, closed, middle = _weighed_thrice(directions, many, inverse, surfaces.radius)

    def spurious(weak: Array) -> Array:
        chosen = (xp.take(part, weak, axis=0) for part in (centre, shape, directions, many, inverse))
        return _spurious_information(*chosen)

    supports = Supports.of(information / variance, spurious)
    closed = xp.where(supports.are_plain[:, None, None], closed, like(np.eye(9), readings))
    back = scaled_inverse(closed)
    return variance * (back @ middle @ back), counts, has_hole, places.are_plain & supports.are_plain


def _weighed_thrice(directions: Array, many: Array, inverse: Array, radius: Array) -> tuple[Array, Array, Array]:
    """Σ n JJᵀ (u, 9, 9) of rows at (u, 3, W) directions, each n times; with weights l² R²; and with their squares.

    l are the lengths of normals, see `carriers`.
    """
    xp = namespace(directions)
    square = squares(turned(inverse, directions))
    rows = monomials(directions)
    carrier = carriers(inverse)
    weight, scale = many / square, (radius**2)[:, None, None]
    found = []
    for part in range(3):
        sums = rows @ xp.matrix_transpose(rows[:, ENOUGH, :] * weight[:, None, :])
        found.append(scale**part * (carrier @ weighed(sums) @ xp.matrix_transpose(carrier)))
        weight = weight * square
    first, second, third = found
    return first, second, third


def _spurious_information(centre: Array, shape: Array, directions: Array, many: Array, inverse: Array) -> Array:
    """What noise pretends at (u, 3, W) directions with so many readings each, as `spurious_information`."""
    return spurious_information(with_ones(centre[:, :, None] + shape @ directions), many, centre, inverse)


def _judged(units: _Units, claimed: _Claimed, inside: str, target_deg: float, dip_deg: float) -> Lane:
    """Widen for few and repeated readings, carry over to headings, and lay out what the table of a fleet holds."""
    xp = namespace(claimed.covariance)
    if not units.at.shape[0]:
        return Lane(units.at, {}, {})
    freedom = units.counted / claimed.repeated - 9.0
    covariance = claimed.covariance * (claimed.repeated * freedom / (freedom - 2.0))[:, None, None]
    rms, worst, facing = errors_facing(claimed.ellipsoids, covariance, claimed.counts, dip_deg)
    evidence = Evidence(
        claimed.ellipsoids, worst, claimed.noise, claimed.prior_influence, claimed.independent, claimed.lag_one,
        units.counted, claimed.has_hole, units.health.extent, units.health.repeats, units.steps,
    )  # fmt: skip
    findings, plain = found_in(evidence, inside, target_deg)
    radius, matrix = _corrections(claimed.ellipsoids)
    numbers = {
        "used": units.count,
        "worst_deg": worst,
        "rms_deg": rms,
        "dip_deg": facing,
        "offset": claimed.ellipsoids.centre,
        "matrix": xp.reshape(matrix, (-1, 9)),
        "covariance": xp.take(xp.reshape(covariance, (-1, 81)), like(UPPER, covariance), axis=1),
        "noise": claimed.noise,
        "radius": radius,
        "coverage": xp.sum(xp.astype(claimed.counts > 0.0, covariance.dtype), axis=1) / claimed.counts.shape[1],
    }
    (kept,) = xp.nonzero(plain & (freedom >= 3.0))
    return Lane(units.at, numbers, findings, claimed.method).only(kept)


def _corrections(ellipsoids: EllipsoidBatch) -> tuple[Array, Array]:
    """(U,) field strengths and (U, 3, 3) matrices of determinant 1, as `Calibration.from_ellipsoid`."""
    xp = namespace(ellipsoids.shape)
    radii, directions = xp.linalg.eigh(ellipsoids.shape)
    strength = xp.exp(xp.mean(xp.log(radii), axis=1))
    matrix = (directions * (strength[:, None] / radii)[:, None, :]) @ xp.matrix_transpose(directions)
    return strength, 0.5 * (matrix + xp.matrix_transpose(matrix))
