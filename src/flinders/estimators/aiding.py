"""Aided: offset, shape and rotation from all that a recording holds beside its magnetometer.

Minimises the sum of the squares of all residuals, each in its own standard deviation, over

    θ = (b, S, R, gyro bias, scales and delay, accelerometer bias and gains, sin I or m)

and a direction of the field for each group of readings that shares one, see `flinders.likelihood.observations`.
Levenberg–Marquardt on the normal equations of all groups, their directions eliminated; the noise of readings and of
verticals comes from their residuals (components of variance: each sum of squares over the residuals that are left
free); then the mean gradient that noise makes on the sphere is removed, as for `Likelihood`. It starts where large
residuals of readings count less, and leaves out readings that do not belong
(`flinders.estimators.joint_outliers`).

When to use it: wherever the body cannot be turned all over and there is a gyro, an accelerometer, or an attitude that
does not come from this compass. All claims are for what the recording shows: a gyro says nothing of the rotation
about an axis that it always turns about.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> aided = solve(drive.samples, ("rate", "dip"))
>>> error = np.abs(aided.parameters.offset - drive.sensor.offset)
>>> bool(np.all(error < 4.0 * np.sqrt(np.diag(aided.covariance)[:3]))), aided.aiding
(True, ('rate', 'dip'))
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.errors import FitError, NotAnEllipsoid, TooFewSamples, UsageError
from flinders.estimators.accelerometer import known_before
from flinders.estimators.auto import found_alone
from flinders.estimators.base import Estimate
from flinders.estimators.joint_covariance import (
    random_walk_of,
    scatter_of,
    span_of,
    spurious_information_of,
    without,
)
from flinders.estimators.joint_outliers import leaving_out, without_outliers
from flinders.estimators.likelihood import spheres_about
from flinders.estimators.rests import Rests
from flinders.likelihood import gyro, prior
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA, AccelerometerPrior
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.joint import JointProblem, deviance, initial, misfits
from flinders.likelihood.parameters import ROTATION_SIGMA, TERMS
from flinders.likelihood.solver import CORRECTED, EASED, STEPS, bias_corrected, levenberg_marquardt

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.joint import JointIterate
    from flinders.likelihood.parameters import ParameterLayout, Parameters
    from flinders.likelihood.prior import KnownShape
    from flinders.likelihood.site_field import Site
    from flinders.likelihood.solver import Equations

AIDS: Final = {term.name: term.words for term in TERMS.values()}
"""What can be asked for, and what it goes by."""

UNSEEN: Final = 0.5
"""Share of the prior's variance that is left of a rotation that nothing has seen."""

SPANNED, SAME_SPAN = 3, 0.2
"""Times that is looked at how verticals are correlated, and change of a logarithm that is none."""

WALKED: Final = 4
"""Times that the walk of a gyro is looked at again, as a fit that it bends shows it too small."""

STILL: Final = 0.1
"""Standard deviations: what a walk moves by less is left."""

FAR_SCALES: Final = 5.0
"""Standard deviations of what is thought of a gyro's scales: beyond, something else is wrong, and they are held."""

SEARCHED: Final = 2000
"""Readings that starts are tried on; all of them from where the best leads."""

SEARCH_STEPS, APPROACH_STEPS = 20, 8
"""Of a long recording, from each start with some readings, and from there with all: those of the correction follow."""

GLANCE: Final = 2
"""Steps of the correction, of a long recording, before verticals are looked at: correlated ones get another weight."""

FEWEST: Final = 12  # readings that are needed


@dataclass(frozen=True, slots=True, eq=False)
class Aided:
    """What was found."""

    parameters: Parameters
    # (P, P): of the free parameters, in the order of `layout`; a rotation by its rotation vector on the left, in rad
    covariance: Floats
    textbook: Floats  # (P, P): the same if all residuals were independent
    layout: ParameterLayout
    noise: float  # standard deviation of a component of a reading, in its unit
    # standard deviation of dᵀq, in rad across the vertical; with ``attitude``, of an attitude about each axis
    vertical_noise: float | None
    aiding: tuple[str, ...]  # those that were used
    used: int  # readings
    outliers: NDArray[np.intp]  # (K,): readings that did not belong, counted from 0
    prior_influence: float  # share of the least known parameter of the shape that the prior speaks for
    # rad/√s: random walk of the direction within windows that residuals show: the gyro's noise, and what looks like it
    walk: float
    # (3,): share of the prior's variance that is left of the rotation about the body's x, y and z
    rotation_seen: Floats
    # factor by which stretches of the recording scatter more than their residuals explain, in variance
    excess_variance: float = 1.0
    site_off: float | None = None  # standard deviations between the dip found and that of the site
    # the farthest of the gyro's scales, where beyond `FAR_SCALES`: they were held instead. 0 where they are usual.
    scales_off: float = 0.0
    gravity_reading: float = 1.0  # what accelerations are long at rest, in their recorded unit

    @property
    def ellipsoid(self) -> Ellipsoid:
        """In the magnetometer's own axes."""
        return self.parameters.ellipsoid

    @property
    def matrix(self) -> Floats:
        """(3, 3) R S⁻¹: takes readings about the offset to unit vectors in body axes."""
        return np.linalg.inv(self.parameters.ellipsoid_like)

    @property
    def sees_rotation(self) -> bool:
        """Something saw how the magnetometer is turned against the body, about one axis at least."""
        return "rotation" in self.layout and bool(np.any(self.rotation_seen < UNSEEN))

    @property
    def rotation_covariance(self) -> Floats | None:
        """(3, 3) rad², of the rotation; None where it was not looked for."""
        return self.of("rotation")

    def of(self, name: str) -> Floats | None:
        """(k, k) covariance of one block of parameters; None where it was not free."""
        if name not in self.layout:
            return None
        columns = self.layout.columns[name]
        part: Floats = self.covariance[columns, columns]
        return part

    def corrected(self, field: Floats) -> Floats:
        """(N, 3) unit-length field in body axes of (N, 3) readings."""
        turned: Floats = (field - self.parameters.offset) @ self.matrix.T
        return turned

    def estimate(self) -> Estimate:
        """The ellipsoid with its marginal covariance, as every other method gives it."""
        return Estimate(
            self.ellipsoid,
            self.covariance[:9, :9],
            self.noise,
            "aided",
            prior_influence=self.prior_influence,
            textbook=self.textbook[:9, :9],
            used=self.used,
            is_aided=True,
        )


def solve(
    samples: Samples,
    terms: Sequence[str] = ("rate", "dip"),
    *,
    site: Site | None = None,
    start: Ellipsoid | None = None,
    rotation: Floats | None = None,
    spread: float = prior.SPREAD,
    window_s: float = gyro.WINDOW_S,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
    near: Aided | None = None,
    shape: KnownShape | None = None,
    is_rough: bool = False,
) -> Aided:
    """Fit all that a recording holds.

    Raises `UsageError` for a term that is not known, or whose column is missing; `TooFewSamples` for fewer readings
    than parameters; `NotAnEllipsoid` if no step leads to a closed surface; `FitError` for a column in which nothing is
    told.

    Parameters
    ----------
    samples : Samples
        One recording, in memory.
    terms : sequence of str
        Of `AIDS`; none of them leaves the magnitude alone.
    site : Site, optional
        What is known of the field there.
    start : Ellipsoid, optional
        Where to begin; by default what `Auto` finds, or a sphere about the readings.
    rotation : (3, 3) float, optional
        Which way the magnetometer sits on the body, about which the rotation is looked for.
    spread : float
        Of the prior on the shape, see `flinders.likelihood.prior`.
    window_s : float
        Length of the windows of the rate, in s.
    gyro_scale : float
        What the scales of the gyro may be off by, 1 σ, and its axes from square and from those of an accelerometer, in
        rad: they are found with the rest.
        0 where that gyro has been calibrated. Scales that come out at more than `FAR_SCALES` times as much tell of
        something else that is wrong; they are then held, and `Aided.scales_off` says what they were.
    acceleration_bias : float
        What the accelerometer may be off by on each axis, 1 σ, in m/s²: it is found with the rest. 0 where that
        accelerometer has been calibrated; its gains are then exact, too.
    acceleration_gain : float
        What its gains may be off by, 1 σ, and its axes from square, in rad: found with the rest as well.
    near : Aided, optional
        Another fit to the same readings: tried before any other start.
    shape : KnownShape, optional
        Of an earlier calibration of this sensor, instead of `spread`.
    is_rough : bool
        Whether a fraction of a standard deviation does not matter, as for a check: few steps are taken.
    """
    refuse_without(samples, terms)
    samples = _rested(samples)
    accelerometer = _accelerometer(samples, terms, acceleration_bias, acceleration_gain)
    put = _Prepared(samples, tuple(terms), site, rotation, spread, window_s, accelerometer, shape, is_rough)
    aided = _solved(put, gyro_scale, start, near).finished()
    off = float(np.abs(aided.parameters.gyro_scale).max())
    if gyro_scale > 0.0 and off > FAR_SCALES * gyro_scale:
        return replace(_solved(put, 0.0, start, near).finished(), scales_off=off)
    return aided


def parameters_of(
    samples: Samples,
    terms: Sequence[str],
    *,
    rotation: Floats | None,
    near: Aided,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
) -> Parameters:
    """What `solve` finds in part of the readings of another fit, without what it claims, which takes as long again."""
    samples = _rested(samples)
    accelerometer = _accelerometer(samples, terms, acceleration_bias, acceleration_gain)
    put = _Prepared(samples, tuple(terms), None, rotation, prior.SPREAD, gyro.WINDOW_S, accelerometer)
    solved_for = _solved(put, gyro_scale, None, near)
    return bias_corrected(solved_for.problem.freed(), solved_for.iterate)[0].at


def _rested(samples: Samples) -> Samples:
    """Each rest as one reading or none, which no window of the gyro goes across; its short gaps are bridged before."""
    samples = replace(samples, rate=gyro.bridged(samples.time, samples.rate)[0])
    rests = Rests.of(samples)
    if not len(rests):
        return samples
    once = rests.fitted(samples)
    if once.rate is not None:
        once.rate[rests.last > rests.first] = np.nan
    return once


class _Prepared(NamedTuple):
    """What is asked for, but for the gyro's scales."""

    samples: Samples
    terms: tuple[str, ...]
    site: Site | None
    rotation: Floats | None
    spread: float
    window_s: float
    accelerometer: AccelerometerPrior | None
    shape: KnownShape | None = None
    is_rough: bool = False

    def problem(self, gyro_scale: float) -> JointProblem:
        """Put the readings in groups."""
        return JointProblem.of(
            self.samples, self.terms, self.site, self.rotation, self.spread, self.window_s,
            gyro_scale=gyro_scale, accelerometer=self.accelerometer, shape=self.shape, is_rough=self.is_rough,
        )  # fmt: skip


class _Solved(NamedTuple):
    """Where the best start leads without readings that do not belong, and how far the rate was moved for it."""

    problem: JointProblem
    iterate: JointIterate
    late_s: float  # in whole intervals

    def finished(self) -> Aided:
        """What is found and claimed."""
        aided = _finished(self.problem.freed(), self.iterate)
        whole = replace(aided.parameters, delay=aided.parameters.delay + self.late_s)
        return replace(aided, parameters=whole)


def _accelerometer(samples: Samples, terms: Sequence[str], bias: float, gain: float) -> AccelerometerPrior | None:
    """What is known of the accelerometer before, where it brings verticals and is not stated to be exact."""
    if "dip" not in terms or samples.acceleration is None or not bias:
        return None
    return known_before(samples.acceleration, AccelerometerPrior.of(bias=bias, gain=gain))


def _solved(put: _Prepared, gyro_scale: float, start: Ellipsoid | None, near: Aided | None) -> _Solved:
    """Go down from each start until one leaves no more than noise.

    Raises `TooFewSamples`, `NotAnEllipsoid` or `FitError` as `solve`.
    """
    if len(put.samples) < FEWEST:
        raise TooFewSamples(found=len(put.samples), needed=FEWEST, method="aided")
    problem = put.problem(gyro_scale)
    _refuse_nothing(problem, put.samples)
    search_steps, steps = (SEARCH_STEPS, APPROACH_STEPS) if problem.is_long else (STEPS, STEPS)
    alone = found_alone(put.samples.field) if start is None else None
    starts = [start] if start is not None else _starts(put.samples, put.site, alone)
    some = _searched(_to_search(problem, alone).thinned(SEARCHED), _begins(problem, starts, near), search_steps)
    best = without_outliers(problem, initial(problem, some.at), steps)
    late = _whole_intervals(best.at.delay, problem.interval)
    if not late or put.samples.rate is None:
        return _Solved(problem, best, 0.0)
    late_s = late * problem.interval
    behind = put._replace(samples=replace(put.samples, rate=_moved_back(put.samples.rate, late))).problem(gyro_scale)
    at = replace(best.at, delay=best.at.delay - late_s)
    begin = initial(behind, behind.begin_near(at, problem.layout))
    return _Solved(behind, without_outliers(behind, begin, steps), late_s)


def _searched(problem: JointProblem, begins: Iterable[Parameters], steps: int) -> JointIterate:
    """Where the best of some starts leads, the first that leaves no more than noise.

    Raises `NotAnEllipsoid` where there is none.
    """
    best: JointIterate | None = None
    for begin in begins:
        iterate = levenberg_marquardt(problem, initial(problem, begin), steps)
        if best is None or deviance(problem, iterate) < deviance(problem, best):
            best = iterate
        if not misfits(iterate):
            break
    if best is None:
        raise NotAnEllipsoid((float("nan"),) * 3, "aided")
    return best


def _to_search(problem: JointProblem, alone: Estimate | None) -> JointProblem:
    """The problem of which a start is looked for: with less weight for large residuals, or without known outliers.

    The latter with an attitude alone: one of each reading holds the directions, as no vertical and no rate does.
    """
    if alone is None or not alone.plane or not alone.outliers or problem.aiding != ("attitude",):
        return problem.robust()
    return leaving_out(problem, alone.outliers)


def _begins(problem: JointProblem, starts: Iterable[Ellipsoid], near: Aided | None) -> Iterator[Parameters]:
    """Where to start: near another fit, and from ellipsoids."""
    if near is not None:
        yield problem.begin_near(near.parameters, near.layout)
    yield from map(problem.begin, starts)


def _starts(samples: Samples, site: Site | None, alone: Estimate | None) -> Iterator[Ellipsoid]:
    """Ellipsoids to begin with: that of all readings, and spheres about them."""
    if alone is not None and not alone.plane and not alone.unobserved:
        yield alone.ellipsoid
    yield from spheres_about(samples.field, None if site is None else site.strength)


def _refuse_nothing(problem: JointProblem, samples: Samples) -> None:
    """Refuse a column that is there and tells nothing.

    Raises `FitError`, which names it.
    """
    trusts = [group.trust for group in problem.groups if group.trust is not None]
    if trusts and not any(trust.any() for trust in trusts):
        column = "acceleration" if "dip" in problem.aiding else "attitude"
        raise FitError(
            f"{samples.source}: no reading has an {column} that tells a direction, all are zero or missing: "
            f"record it, or leave {' and '.join(aid for aid in problem.aiding if aid != 'rate')} out",
            column=column,
        )


def _whole_intervals(delay_s: float, interval_s: float) -> int:
    """How many readings a delay is, to the nearest; what is left of it moves readings by less than the rate changes."""
    return round(delay_s / interval_s) if interval_s > 0.0 else 0


def _moved_back(rate: Floats, rows: int) -> Floats:
    """(N, 3) rates, so many readings later; NaN where that was not recorded.

    >>> _moved_back(np.array([[1.0], [2.0], [3.0]]), 1).ravel()
    array([nan,  1.,  2.])
    """
    moved = np.roll(rate, rows, axis=0).astype(float)
    moved[slice(0, rows) if rows > 0 else slice(rows, None)] = np.nan
    return moved


def refuse_without(samples: Samples, terms: Iterable[str]) -> None:
    """Refuse terms that are not known, and those whose column a recording lacks.

    Raises `UsageError`, which names what is needed.
    """
    for term in terms:
        if term not in TERMS:
            raise UsageError(f"aid {term!r} is not known: use one of {', '.join(TERMS)}, or auto")
        for column in TERMS[term].needs:
            if getattr(samples, column) is None:
                raise UsageError(
                    f"{samples.source} has no {column}, which {term!r} goes by: leave {term!r} out, or record {column}"
                )


def _finished(problem: JointProblem, iterate: JointIterate) -> Aided:
    """Take off what the sphere's curvature adds, and say how far to trust what is left."""
    steps = GLANCE if problem.is_long else CORRECTED
    iterate, equations = _spanned(problem, *bias_corrected(problem, iterate, steps=steps))
    inverse = _inverse(equations)
    walk = random_walk_of(problem, iterate, inverse)
    for _ in range(WALKED):
        iterate = replace(iterate, weights=iterate.weights._replace(own=walk.own))
        if (problem.is_long and walk.variance == 0.0) or _left(equations, walk.bent) < STILL:
            break
        iterate, equations = bias_corrected(problem, iterate, walk.bent)
        inverse = _inverse(equations)
        walk = random_walk_of(problem, iterate, inverse)
    scatter = scatter_of(problem, iterate, walk)
    believed = equations.prior.matrix
    information = without(equations.matrix, spurious_information_of(problem, iterate), believed)
    textbook = replace(equations.prior, matrix=information).inverse()
    covariance = textbook @ (believed + scatter.whole) @ textbook
    seen: Floats = np.ones(3)
    if "rotation" in problem.layout:
        columns = problem.layout.columns["rotation"]
        seen = np.diag(textbook)[columns] / ROTATION_SIGMA**2
    outliers = np.sort(np.concatenate([group.rows[group.weight == 0.0] for group in iterate.groups]))
    return Aided(
        iterate.at,
        covariance,
        textbook,
        problem.layout,
        iterate.weights.noise,
        iterate.weights.vertical if any(group.trust is not None for group in iterate.groups) else None,
        problem.aiding,
        sum(group.count for group in iterate.groups),
        outliers,
        problem.prior.influence(iterate.at, textbook[:9, :9]),
        math.sqrt(walk.variance / max(problem.interval, 1e-9)),
        seen,
        scatter.excess_variance,
        _site_off(problem, iterate, covariance),
        gravity_reading=1.0 if problem.accelerometer is None else problem.accelerometer.scale,
    )


def _spanned(problem: JointProblem, iterate: JointIterate, equations: Equations) -> tuple[JointIterate, Equations]:
    """Weigh verticals for as many as say something of their own: else they would outvote all that is thought before."""
    for _ in range(SPANNED):
        span = span_of(iterate)
        is_same = abs(math.log(span.readings / iterate.weights.span)) < SAME_SPAN
        if is_same and (not problem.is_long or _left(equations) < EASED):
            break
        if not is_same:
            iterate = replace(iterate, weights=iterate.weights._replace(span=span.readings))
        iterate, equations = bias_corrected(problem, iterate)
        if not is_same:
            iterate = replace(iterate, weights=iterate.weights._replace(vertical=span_of(iterate).noise))
    return iterate, equations


def _left(equations: Equations, bias: Floats | float = 0.0) -> float:
    """Length of the step that is left to take, in standard deviations."""
    gradient = equations.unbiased(bias).gradient + equations.prior.gradient
    return math.sqrt(max(float(gradient @ _inverse(equations) @ gradient), 0.0))


def _inverse(equations: Equations) -> Floats:
    """(P, P) covariance for residuals that are independent."""
    return replace(equations.prior, matrix=equations.matrix + equations.prior.matrix).inverse()


def _site_off(problem: JointProblem, iterate: JointIterate, covariance: Floats) -> float | None:
    """How far the dip found is from that of the site, in standard deviations of what the site is known to."""
    if problem.site is None or problem.site.sine is None:
        return None
    if "sine" in problem.layout:
        column = problem.layout.columns["sine"].start
        left = max(1.0 - covariance[column, column] / problem.site.sine_sigma**2, 0.0)
        return float((iterate.at.sine - problem.site.sine) / problem.site.sine_sigma / math.sqrt(max(left, 1e-6)))
    if "direction" in problem.layout:
        return float((iterate.at.direction[2] - problem.site.sine) / problem.site.sine_sigma)
    return None
