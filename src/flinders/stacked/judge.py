"""What is said of many units: health, heading errors and findings, as `flinders.fitting.verdict` says it of one.

The rules are those of `flinders.findings`, applied to columns. A unit with any other, or one that refuses the
calibration, leaves the stack.

>>> from flinders.stacked.surfaces import EllipsoidBatch
>>> spheres = EllipsoidBatch(np.zeros((1, 3)), 50.0 * np.eye(3)[None])
>>> offset_only = np.diag([0.25, 0.25, 0.25, 0, 0, 0, 0, 0, 0])[None]
>>> rms, worst = level_errors(spheres, offset_only, np.array([60.0]))
>>> round(float(rms[0]), 2), round(float(worst[0]), 2)
(1.15, 1.15)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.units import EARTH_UT, MICROTESLA
from flinders.findings import CATALOGUE, VERDICTS
from flinders.fitting.verdict import ALTERNATING
from flinders.heading.error_propagation import HEADINGS, level_turn
from flinders.stacked.algebra import Array, gathered, in_segments, like, namespace, put, signs
from flinders.summary.coverage import CELLS, LEANING, LEANING_LEAST, UPRIGHT
from flinders.summary.quality import RAIL_COUNT, RAIL_SHARE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.findings import Severity
    from flinders.stacked.surfaces import EllipsoidBatch

CODES: Final = (
    *("heading-error", "coverage", "noise", "prior", "few-samples", "inflation", "axis-ratio", "field-strength"),
    *("correlated", "unit-unknown", "scale-unknown", "rotation-unknown", "stale-repeats", "time-back", "time-gap"),
)
"""Findings that are made here."""


@dataclass(frozen=True, eq=False)
class BatchQuality:
    """Counts over the readings of U units, see `flinders.summary.quality.DataQuality`.

    Attributes
    ----------
    low, high : (U, 3)
        Ends of each axis.
    repeats : (U,)
        Readings equal to the one before.
    are_sound : (U,) bool
        No axis is stuck, and too few readings share its end for a rail.
    """

    low: Array
    high: Array
    repeats: Array
    are_sound: Array

    @property
    def extent(self) -> Array:
        """(U, 3) range of each axis."""
        return self.high - self.low

    @classmethod
    def of(cls, readings: Array, inside: Array | None, count: Array) -> Self:
        """Look at (U, 3, N) readings, or those `with_ones`."""
        return cls(*in_segments(_health, readings, inside, count))

    def only(self, which: Array) -> Self:
        """Those that (K,) integers name."""
        xp = namespace(which)
        parts = (self.low, self.high, self.repeats, self.are_sound)
        return type(self)(*(xp.take(part, which, axis=0) for part in parts))


def _health(readings: Array, inside: Array | None, count: Array) -> tuple[Array, Array, Array, Array]:
    """Ends, repeats and soundness of one stretch of units; rows are filled up with their first reading."""
    xp = namespace(readings)
    readings = readings[:, :3, :]
    low, high = xp.min(readings, axis=2), xp.max(readings, axis=2)
    there = None if inside is None else inside > 0.0
    ends = [readings == end[:, :, None] for end in (low, high)]
    railed = _are_many(ends[0] | ends[1], there, count)
    if bool(xp.any(railed)):  # of either end, and it matters of which
        railed = _are_many(ends[0], there, count) | _are_many(ends[1], there, count)
    same = readings[:, :, 1:] == readings[:, :, :-1]
    repeated = same[:, 0, :] & same[:, 1, :] & same[:, 2, :]
    if there is not None:
        repeated = repeated & there[:, 1:]
    repeats = xp.astype(xp.count_nonzero(repeated, axis=1), readings.dtype)
    return low, high, repeats, xp.all(high > low, axis=1) & ~railed


def _are_many(same: Array, there: Array | None, count: Array) -> Array:
    """(u,) whether so many readings of an axis share an end, (u, 3, N) bool, that it is a rail."""
    xp = namespace(same)
    most = xp.max(xp.count_nonzero(same if there is None else same & there[:, None, :], axis=2), axis=1)
    return (most >= RAIL_COUNT) & (xp.astype(most, xp.float64) > RAIL_SHARE * xp.astype(count, xp.float64))


def facings(counts: Array, dip_deg: float) -> tuple[Array, Array]:
    """(U,) dip with the sign that (U, 100) readings by direction show, and (U,) whether they leave the other one open.

    As `flinders.summary.coverage.Coverage.facings`.
    """
    xp = namespace(counts)
    readings = xp.maximum(xp.sum(counts, axis=1), 1.0)
    upright = (counts @ like(CELLS[:, 2], counts)) / readings
    seen = xp.astype(xp.sum(xp.astype(counts > 0.0, xp.int64), axis=1), counts.dtype)
    limit = xp.maximum(LEANING / xp.sqrt(xp.maximum(seen, 1.0)), LEANING_LEAST)
    along = -upright if dip_deg < 0.0 else upright
    leans = xp.abs(along) > limit
    clear = xp.abs(upright) >= UPRIGHT * abs(math.sin(math.radians(dip_deg)))
    facing = dip_deg * signs(xp.where(clear, along + limit, limit))
    return facing, leans & ~clear


def level_errors(ellipsoids: EllipsoidBatch, covariance: Array, dip_deg: Array) -> tuple[Array, Array]:
    """(U,) rms and worst heading error of a level vehicle in degrees, as `error_propagation.level_error`.

    Parameters
    ----------
    ellipsoids : EllipsoidBatch
    covariance : (U, 9, 9)
    dip_deg : (U,)
        All of one size, of either sign.
    """
    xp = namespace(covariance)
    _, fields = level_turn(abs(float(dip_deg[0])), None)
    heading = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    across = np.stack([np.sin(heading), np.cos(heading), np.zeros(HEADINGS)]) / math.cos(
        math.radians(abs(float(dip_deg[0])))
    )
    sign = signs(dip_deg)
    upside = xp.stack([xp.ones_like(sign), xp.ones_like(sign), sign], axis=1)
    directions = like(fields, covariance)[None, :, :] * upside[:, :, None]
    gradient = gathered(ellipsoids.inverse @ like(across, covariance), directions)
    gradient -= xp.mean(gradient, axis=2, keepdims=True)
    variance = xp.clip(xp.sum((covariance @ gradient) * gradient, axis=1), 0.0, xp.inf)
    degrees = 180.0 / math.pi
    return xp.sqrt(xp.mean(variance, axis=1)) * degrees, xp.sqrt(xp.max(variance, axis=1)) * degrees


def errors_facing(
    ellipsoids: EllipsoidBatch, covariance: Array, counts: Array, dip_deg: float
) -> tuple[Array, Array, Array]:
    """Heading errors (U,), rms and worst, and their dip: of both signs of the dip the worse, where both are open."""
    xp = namespace(covariance)
    facing, either = facings(counts, dip_deg)
    rms, worst = level_errors(ellipsoids, covariance, facing)
    (open_,) = xp.nonzero(either)
    if open_.shape[0]:
        some = xp.take(facing, open_), xp.take(rms, open_), xp.take(worst, open_)
        other = -some[0], *level_errors(ellipsoids.only(open_), xp.take(covariance, open_, axis=0), -some[0])
        swap = other[2] > some[2]
        facing, rms, worst = (
            put(whole, open_, xp.where(swap, theirs, ours))
            for whole, theirs, ours in zip((facing, rms, worst), other, some, strict=True)
        )
    return rms, worst, facing


@dataclass(frozen=True, eq=False)
class Evidence:
    """What findings are made of, for U units; each attribute (U,) unless said otherwise.

    Attributes
    ----------
    ellipsoids : EllipsoidBatch
    worst_deg, noise, prior_influence, independent, lag_one, count
        As the attributes of `flinders.fitting.result.Fit`; `prior_influence` is zero and `lag_one` too where
        nobody looked.
    has_hole : bool
    extent : (U, 3)
    repeats
    steps : (U, 3) or None
        Steps back in time, longest and usual step; None without time.
    """

    ellipsoids: EllipsoidBatch
    worst_deg: Array
    noise: Array
    prior_influence: Array
    independent: Array
    lag_one: Array
    count: Array
    has_hole: Array
    extent: Array
    repeats: Array
    steps: Array | None = None


def found_in(evidence: Evidence, inside: str, target_deg: float) -> tuple[Mapping[tuple[str, Severity], Array], Array]:
    """Which findings of `CODES` there are, each (U,) bool; and (U,) whether there may be none beside them.

    Parameters
    ----------
    evidence : Evidence
    inside : str
        Unit of the readings: ``uT`` or ``counts``.
    target_deg : float
    """
    xp = namespace(evidence.noise)
    record = _columns(evidence, inside, target_deg)
    found: dict[tuple[str, Severity], Array] = {}
    leave = xp.isnan(evidence.worst_deg)
    for code in (*CODES, "alternating"):
        rule = CATALOGUE[code].rule
        assert rule is not None
        for severity, holds in rule.holds(record).items():
            if severity == "refuses" or code == "alternating":
                leave = leave | holds
            else:
                found[code, severity] = holds
    return by_gravity(found), ~leave


def by_gravity(found: Mapping[tuple[str, Severity], Array]) -> dict[tuple[str, Severity], Array]:
    """Put the most severe first, those of one severity as they came."""
    return {key: found[key] for severity in VERDICTS for key in found if key[1] == severity}


def _columns(evidence: Evidence, inside: str, target_deg: float) -> dict[str, Array]:
    """What the rules compare, as columns of U units."""
    xp = namespace(evidence.noise)
    axes, count = evidence.ellipsoids.semi_axes, evidence.count
    radius = xp.exp(xp.mean(xp.log(axes), axis=1))
    independent = xp.minimum(evidence.independent, count)
    nothing, everything = xp.zeros_like(radius), xp.ones_like(radius)
    is_earths = inside == MICROTESLA
    steps = xp.zeros((count.shape[0], 3), dtype=radius.dtype) if evidence.steps is None else evidence.steps
    return {
        "target_deg": nothing + target_deg,
        "worst_deg": evidence.worst_deg,
        "hole_deg": xp.where(evidence.has_hole, nothing + 180.0, nothing),
        "noise_share": evidence.noise / radius,
        "prior_share": evidence.prior_influence,
        "independent": independent,
        "independent_share": independent / count,
        "inflation": 2.0 * axes[:, 2] / xp.max(evidence.extent, axis=1),
        "axis_ratio": axes[:, 2] / axes[:, 0],
        "times_outside_earth": xp.maximum(EARTH_UT[0] / radius, radius / EARTH_UT[1]) if is_earths else nothing,
        "is_in_counts": nothing if is_earths else everything,
        "is_relative": everything,
        "is_unaligned": everything,
        "repeated_share": evidence.repeats / count,
        "backward_steps": steps[:, 0],
        "longest_step_s": steps[:, 1],
        "usual_step_s": steps[:, 2],
        "next_correlation": evidence.lag_one,
        "alternating_limit": xp.minimum(-4.0 / xp.sqrt(count), nothing + ALTERNATING),
        "alternating_deg": nothing,
    }
