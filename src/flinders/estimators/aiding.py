"""Aided: offset, shape and rotation from a magnetometer and aiding sensors.

Minimises the sum of the squares of all residuals, in their standard deviations, over

    θ = (b, S, R, gyro bias, scales and delay, accelerometer bias and gains, sin I or m)

and the direction of the field of each group of readings with a common direction, see
`flinders.likelihood.observations`. The directions are eliminated from the normal equations, which are solved by
Levenberg–Marquardt. The noise of readings and of verticals is estimated from their residuals (variance components).
Then the bias by noise on the curved sphere of directions is corrected, as for `Likelihood`. The start has reduced
weights for large residuals; outliers are left out (`flinders.estimators.joint_outliers`).

When to use it: if the body cannot be turned in all directions, and there is a gyro, an accelerometer, or an attitude
that is independent of this compass. If all turns of a recording are about one axis, a gyro does not observe the
rotation of the magnetometer about that axis.

>>> from flinders import simulate
>>> drive = simulate.tumble(seed=1, motion="flight", n=1500)
>>> aided = fit_aided(drive.samples, ("rate", "dip"))
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
from flinders.estimators.accelerometer import update_prior
from flinders.estimators.auto import fit_alone
from flinders.estimators.base import Estimate
from flinders.estimators.joint_covariance import (
    estimate_random_walk,
    gradient_scatter,
    joint_spurious_information,
    subtract_spurious,
    vertical_correlation,
)
from flinders.estimators.joint_outliers import fit_without_outliers, leave_out_runs
from flinders.estimators.likelihood import start_spheres
from flinders.estimators.rests import Rests
from flinders.likelihood import gyro, prior
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA, AccelerometerPrior
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.joint import JointProblem, deviance, has_misfit, start_iterate
from flinders.likelihood.parameters import ROTATION_SIGMA, TERMS
from flinders.likelihood.solver import (
    LAST_CORRECTION_SIGMAS,
    MAX_CORRECTION_STEPS,
    MAX_STEPS,
    correct_bias,
    levenberg_marquardt,
)

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

READ_AS: Final = {
    "time": "in a table it is read from a column such as time_s",
    "acceleration": "in a table it is read from columns such as acc_x, acc_y and acc_z",
    "rate": (
        "in a table it is read from columns such as gyro_x_rad_s or gyro_x_deg_s, and not from a gyro whose unit is "
        "not in the names"
    ),
    "attitude": (
        "in a table it is read from the columns attitude_w, attitude_x, attitude_y and attitude_z, a quaternion to "
        "north, east and down, and not from roll, pitch and yaw"
    ),
}
"""Words for the columns of a table from which a quantity is read."""
AIDING_TERMS: Final = {term.name: term.words for term in TERMS.values()}
"""Principle of each term of an aiding sensor in words, by the name of the term."""

MAX_OBSERVED_RATIO: Final = 0.5
"""Largest ratio of the variance of an observed rotation to the variance of its prior."""

MAX_SPAN_ESTIMATES, MAX_SPAN_CHANGE = 3, 0.2
"""Limits of the iteration for the correlation length of verticals: number of estimates, change of its logarithm."""

MAX_WALK_ESTIMATES: Final = 4
"""Largest number of estimates of a gyro's random walk; the first are too small, before the bias is corrected."""

MIN_WALK_STEP: Final = 0.1
"""Smallest step of the bias correction for a gyro's random walk that is taken, in standard deviations."""

MAX_SCALE_SIGMAS: Final = 5.0
"""Largest plausible scale error of a gyro, in standard deviations of the prior; a larger one shows another error."""

SEARCH_READINGS: Final = 2000
"""Number of readings by which starts are compared; the fit then uses all readings."""

SEARCH_STEPS, APPROACH_STEPS = 20, 8
"""Solver steps for a long recording: from each start with some readings; from the best start with all readings."""

LONG_CORRECTION_STEPS: Final = 2
"""Bias correction steps for a long recording, before the correlation length of verticals changes their weights."""

MIN_READINGS: Final = 12  # smallest number of readings


@dataclass(frozen=True, slots=True, eq=False)
class AidedFit:
    """Result of a fit with aiding sensors."""

    parameters: Parameters
    # (P, P): covariance of the free parameters, in the order of `layout`; a rotation has the three components of its
    # rotation vector, applied on the left, in rad
    covariance: Floats
    textbook: Floats  # (P, P): covariance for independent residuals
    layout: ParameterLayout
    noise: float  # standard deviation of a component of a reading, in its unit
    # rad: standard deviation of the vertical about each horizontal axis; with ``attitude``, of the attitude about each
    # axis; None without either
    vertical_noise: float | None
    aiding: tuple[str, ...]  # names of the terms in the fit
    used: int  # number of readings in the fit
    outliers: NDArray[np.intp]  # (K,): index of each reading that was left out
    prior_influence: float  # fraction of information from the prior, in the least known parameter of the shape
    # rad/√s: random walk of the field's direction within windows, from the gyro's noise and similar errors
    walk: float
    # (3,): ratio of the variance of the rotation about the body's x, y and z to the variance of the prior
    rotation_variance_ratio: Floats
    # ratio of variances: scatter of parts of the recording over the scatter expected from their residuals
    excess_variance: float = 1.0
    # difference of the estimated dip from that of the site, in standard deviations; None if either is not known
    dip_difference: float | None = None
    # largest scale error of the gyro, if it exceeds `MAX_SCALE_SIGMAS` and the fit was repeated without scale errors;
    # else 0
    gyro_scale_error: float = 0.0
    gravity_reading: float = 1.0  # length of accelerations at rest, in their recorded unit

    @property
    def ellipsoid(self) -> Ellipsoid:
        """Ellipsoid in the magnetometer's own axes."""
        return self.parameters.ellipsoid

    @property
    def matrix(self) -> Floats:
        """(3, 3) matrix R S⁻¹, from readings minus the offset to unit vectors in body axes."""
        return np.linalg.inv(self.parameters.rotated_shape)

    @property
    def has_rotation(self) -> bool:
        """Whether the rotation from the magnetometer to the body is observed about at least one axis."""
        return "rotation" in self.layout and bool(np.any(self.rotation_variance_ratio < MAX_OBSERVED_RATIO))

    @property
    def rotation_covariance(self) -> Floats | None:
        """(3, 3) covariance of the rotation in rad²; None if it is not a free parameter."""
        return self.of("rotation")

    def of(self, name: str) -> Floats | None:
        """(k, k) covariance of a block of k parameters by its name; None if the block is not free."""
        if name not in self.layout:
            return None
        columns = self.layout.columns[name]
        part: Floats = self.covariance[columns, columns]
        return part

    def correct(self, field: Floats) -> Floats:
        """Correct (N, 3) readings to fields of unit length in body axes."""
        turned: Floats = (field - self.parameters.offset) @ self.matrix.T
        return turned

    def estimate(self) -> Estimate:
        """The ellipsoid and its covariance as an `Estimate`, as of a method for the magnetometer alone."""
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


def fit_aided(
    samples: Samples,
    terms: Sequence[str] = ("rate", "dip"),
    *,
    site: Site | None = None,
    start: Ellipsoid | None = None,
    rotation: Floats | None = None,
    spread: float = prior.SOFT_IRON_SPREAD,
    window_s: float = gyro.WINDOW_S,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
    near: AidedFit | None = None,
    shape: KnownShape | None = None,
    is_rough: bool = False,
) -> AidedFit:
    """Fit a magnetometer with aiding sensors.

    Raises `UsageError` for an unknown term, or a missing column; `TooFewSamples` for fewer readings than parameters;
    `NotAnEllipsoid` if no step leads to a closed surface; `FitError` for a column without valid values.

    Parameters
    ----------
    samples : Samples
        One recording, in memory.
    terms : sequence of str
        Names in `AIDING_TERMS`; an empty sequence uses the magnitude alone.
    site : Site, optional
        Known field of the site.
    start : Ellipsoid, optional
        Ellipsoid to start from; by default that of `Auto`, or a sphere about the readings.
    rotation : (3, 3) float, optional
        Assumed rotation from the magnetometer's axes to the body's, which is the mean of the prior.
    spread : float
        Spread of the prior of the shape, see `flinders.likelihood.prior`.
    window_s : float
        Length of the windows of the gyro, in s.
    gyro_scale : float
        Prior 1 σ of the gyro's scale errors, and of its misalignment angles in rad, which are estimated. 0 for a
        calibrated gyro. Scale errors of more than `MAX_SCALE_SIGMAS` times this value indicate another error: the fit
        is then repeated without scale errors, and `AidedFit.gyro_scale_error` has the largest one.
    acceleration_bias : float
        Prior 1 σ of the accelerometer's bias on each axis in m/s², which is estimated. 0 for a calibrated
        accelerometer, whose gains are then exact, too.
    acceleration_gain : float
        Prior 1 σ of the accelerometer's gains, and of its misalignment angles in rad, which are estimated.
    near : AidedFit, optional
        Another fit to the same readings, whose parameters are the first start.
    shape : KnownShape, optional
        Prior of the shape from an earlier calibration of this sensor, instead of `spread`.
    is_rough : bool
        Whether an error of a fraction of a standard deviation is acceptable, as for a check; saves steps.
    """
    refuse_missing_columns(samples, terms)
    samples = _average_rests(samples)
    accelerometer = _accelerometer(samples, terms, acceleration_bias, acceleration_gain)
    put = _Inputs(samples, tuple(terms), site, rotation, spread, window_s, accelerometer, shape, is_rough)
    aided = _solve_from_starts(put, gyro_scale, start, near).compute_claims()
    off = float(np.abs(aided.parameters.gyro_scale).max())
    if gyro_scale > 0.0 and off > MAX_SCALE_SIGMAS * gyro_scale:
        return replace(_solve_from_starts(put, 0.0, start, near).compute_claims(), gyro_scale_error=off)
    return aided


def fit_parameters(
    samples: Samples,
    terms: Sequence[str],
    *,
    rotation: Floats | None,
    near: AidedFit,
    gyro_scale: float = SCALE_SIGMA,
    acceleration_bias: float = ACCELERATION_SIGMA,
    acceleration_gain: float = GAIN_SIGMA,
) -> Parameters:
    """Fit the parameters alone to a part of the readings of the fit `near`; claims would take longer.

    Other arguments are those of `fit_aided`.
    """
    samples = _average_rests(samples)
    accelerometer = _accelerometer(samples, terms, acceleration_bias, acceleration_gain)
    put = _Inputs(samples, tuple(terms), None, rotation, prior.SOFT_IRON_SPREAD, gyro.WINDOW_S, accelerometer)
    solved_for = _solve_from_starts(put, gyro_scale, None, near)
    return correct_bias(solved_for.problem.free_accelerometer(), solved_for.iterate)[0].at


def _average_rests(samples: Samples) -> Samples:
    """Samples for the fit: each rest is one reading or none and ends a gyro window; short gyro gaps are filled."""
    samples = replace(samples, rate=gyro.bridge_gaps(samples.time, samples.rate)[0])
    rests = Rests.of(samples)
    if not len(rests):
        return samples
    once = rests.average(samples)
    if once.rate is not None:
        once.rate[rests.last > rests.first] = np.nan
    return once


class _Inputs(NamedTuple):
    """Arguments of `fit_aided`, except the gyro's scales."""

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
        """Make the problem; `gyro_scale` is 1 σ of the prior of the gyro's scale errors."""
        return JointProblem.of(
            self.samples, self.terms, self.site, self.rotation, self.spread, self.window_s,
            gyro_scale=gyro_scale, accelerometer=self.accelerometer, shape=self.shape, is_rough=self.is_rough,
        )  # fmt: skip


class _Solution(NamedTuple):
    """Solution from the best start without outliers, and the shift of the gyro's time."""

    problem: JointProblem
    iterate: JointIterate
    late_s: float  # s: shift of the angular rate in whole intervals of the readings

    def compute_claims(self) -> AidedFit:
        """Correct the bias, and compute the claims."""
        aided = _compute_claims(self.problem.free_accelerometer(), self.iterate)
        whole = replace(aided.parameters, delay=aided.parameters.delay + self.late_s)
        return replace(aided, parameters=whole)


def _accelerometer(samples: Samples, terms: Sequence[str], bias: float, gain: float) -> AccelerometerPrior | None:
    """Prior of the accelerometer's errors; None if no accelerometer is used, or it is stated to be exact."""
    if "dip" not in terms or samples.acceleration is None or not bias:
        return None
    return update_prior(samples.acceleration, AccelerometerPrior.of(bias=bias, gain=gain))


def _solve_from_starts(put: _Inputs, gyro_scale: float, start: Ellipsoid | None, near: AidedFit | None) -> _Solution:
    """Solve from each start until the residuals of one are only noise.

    Raises `TooFewSamples`, `NotAnEllipsoid` or `FitError` as `fit_aided`.
    """
    if len(put.samples) < MIN_READINGS:
        raise TooFewSamples(found=len(put.samples), needed=MIN_READINGS, method="aided")
    problem = put.problem(gyro_scale)
    _refuse_empty_column(problem, put.samples)
    search_steps, steps = (SEARCH_STEPS, APPROACH_STEPS) if problem.is_long else (MAX_STEPS, MAX_STEPS)
    alone = fit_alone(put.samples.field) if start is None else None
    starts = [start] if start is not None else _start_ellipsoids(put.samples, put.site, alone)
    some = _search(
        _search_problem(problem, alone).thin(SEARCH_READINGS), _start_parameters(problem, starts, near), search_steps
    )
    best = fit_without_outliers(problem, start_iterate(problem, some.at), steps)
    late = _whole_intervals(best.at.delay, problem.interval)
    if not late or put.samples.rate is None:
        return _Solution(problem, best, 0.0)
    late_s = late * problem.interval
    behind = put._replace(samples=replace(put.samples, rate=_shift_rate(put.samples.rate, late))).problem(gyro_scale)
    at = replace(best.at, delay=best.at.delay - late_s)
    begin = start_iterate(behind, behind.begin_from(at, problem.layout))
    return _Solution(behind, fit_without_outliers(behind, begin, steps), late_s)


def _search(problem: JointProblem, begins: Iterable[Parameters], steps: int) -> JointIterate:
    """Best solution from several starts; stops at the first whose residuals are only noise.

    Raises `NotAnEllipsoid` if there is no start.
    """
    best: JointIterate | None = None
    for begin in begins:
        iterate = levenberg_marquardt(problem, start_iterate(problem, begin), steps)
        if best is None or deviance(problem, iterate) < deviance(problem, best):
            best = iterate
        if not has_misfit(iterate):
            break
    if best is None:
        raise NotAnEllipsoid((float("nan"),) * 3, "aided")
    return best


def _search_problem(problem: JointProblem, alone: Estimate | None) -> JointProblem:
    """The problem for the search of a start, in which outliers have little effect.

    Large residuals have reduced weights. For a level turn with attitudes, which determine the direction at each
    reading, outliers of the magnetometer alone are left out instead.
    """
    if alone is None or not alone.plane or not alone.outliers or problem.aiding != ("attitude",):
        return problem.make_robust()
    return leave_out_runs(problem, alone.outliers)


def _start_parameters(
    problem: JointProblem, starts: Iterable[Ellipsoid], near: AidedFit | None
) -> Iterator[Parameters]:
    """Yield parameters to start from: those of another fit, and from ellipsoids."""
    if near is not None:
        yield problem.begin_from(near.parameters, near.layout)
    yield from map(problem.begin, starts)


def _start_ellipsoids(samples: Samples, site: Site | None, alone: Estimate | None) -> Iterator[Ellipsoid]:
    """Yield ellipsoids to start from: that of the magnetometer alone, and spheres about the readings."""
    if alone is not None and not alone.plane and not alone.unobserved:
        yield alone.ellipsoid
    yield from start_spheres(samples.field, None if site is None else site.strength)


def _refuse_empty_column(problem: JointProblem, samples: Samples) -> None:
    """Refuse an aiding column without valid values.

    Raises `FitError`, which names the column.
    """
    trusts = [group.trust for group in problem.groups if group.trust is not None]
    if trusts and not any(trust.any() for trust in trusts):
        column = "acceleration" if "dip" in problem.aiding else "attitude"
        raise FitError(
            f"{samples.source}: no reading has a valid {column}, all are zero or missing: "
            f"record it, or leave {' and '.join(aid for aid in problem.aiding if aid != 'rate')} out",
            column=column,
        )


def _whole_intervals(delay_s: float, interval_s: float) -> int:
    """Number of whole reading intervals in a delay; the fit estimates the rest of the delay."""
    return round(delay_s / interval_s) if interval_s > 0.0 else 0


def _shift_rate(rate: Floats, rows: int) -> Floats:
    """(N, 3) rates shifted by `rows` readings to later times; NaN where none was recorded.

    >>> _shift_rate(np.array([[1.0], [2.0], [3.0]]), 1).ravel()
    array([nan,  1.,  2.])
    """
    moved = np.roll(rate, rows, axis=0).astype(float)
    moved[slice(0, rows) if rows > 0 else slice(rows, None)] = np.nan
    return moved


def refuse_missing_columns(samples: Samples, terms: Iterable[str]) -> None:
    """Refuse unknown terms, and terms whose column is missing in the recording.

    Raises `UsageError`, which names the column.
    """
    for term in terms:
        if term not in TERMS:
            raise UsageError(f"aiding sensor {term!r} is not known: use one of {', '.join(TERMS)}, or auto")
        for column in TERMS[term].needs:
            if getattr(samples, column) is None:
                raise UsageError(
                    f"{samples.source} has no {column}, which {term!r} needs: leave {term!r} out, or record {column}; "
                    f"{READ_AS[column]}"
                )


def _compute_claims(problem: JointProblem, iterate: JointIterate) -> AidedFit:
    """Subtract the bias by the sphere's curvature, and compute the claims."""
    steps = LONG_CORRECTION_STEPS if problem.is_long else MAX_CORRECTION_STEPS
    iterate, equations = _weight_verticals(problem, *correct_bias(problem, iterate, steps=steps))
    inverse = _inverse(equations)
    walk = estimate_random_walk(problem, iterate, inverse)
    for _ in range(MAX_WALK_ESTIMATES):
        iterate = replace(iterate, weights=iterate.weights._replace(own=walk.own))
        is_negligible = problem.is_long and walk.variance == 0.0
        if is_negligible or _next_step_length(equations, walk.bias_gradient) < MIN_WALK_STEP:
            break
        iterate, equations = correct_bias(problem, iterate, walk.bias_gradient)
        inverse = _inverse(equations)
        walk = estimate_random_walk(problem, iterate, inverse)
    scatter = gradient_scatter(problem, iterate, walk)
    believed = equations.prior.matrix
    information = subtract_spurious(equations.matrix, joint_spurious_information(problem, iterate), believed)
    textbook = replace(equations.prior, matrix=information).inverse()
    covariance = textbook @ (believed + scatter.whole) @ textbook
    seen: Floats = np.ones(3)
    if "rotation" in problem.layout:
        columns = problem.layout.columns["rotation"]
        seen = np.diag(textbook)[columns] / ROTATION_SIGMA**2
    outliers = np.sort(np.concatenate([group.rows[group.weight == 0.0] for group in iterate.groups]))
    return AidedFit(
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
        _site_difference(problem, iterate, covariance),
        gravity_reading=1.0 if problem.accelerometer is None else problem.accelerometer.scale,
    )


def _weight_verticals(
    problem: JointProblem, iterate: JointIterate, equations: Equations
) -> tuple[JointIterate, Equations]:
    """Weight verticals by their correlation length, so that correlated verticals do not outweigh the priors."""
    for _ in range(MAX_SPAN_ESTIMATES):
        span = vertical_correlation(iterate)
        is_same = abs(math.log(span.readings / iterate.weights.span)) < MAX_SPAN_CHANGE
        if is_same and (not problem.is_long or _next_step_length(equations) < LAST_CORRECTION_SIGMAS):
            break
        if not is_same:
            iterate = replace(iterate, weights=iterate.weights._replace(span=span.readings))
        iterate, equations = correct_bias(problem, iterate)
        if not is_same:
            iterate = replace(iterate, weights=iterate.weights._replace(vertical=vertical_correlation(iterate).noise))
    return iterate, equations


def _next_step_length(equations: Equations, bias: Floats | float = 0.0) -> float:
    """Length of the next solver step in standard deviations."""
    gradient = equations.unbiased(bias).gradient + equations.prior.gradient
    return math.sqrt(max(float(gradient @ _inverse(equations) @ gradient), 0.0))


def _inverse(equations: Equations) -> Floats:
    """(P, P) covariance for independent residuals."""
    return replace(equations.prior, matrix=equations.matrix + equations.prior.matrix).inverse()


def _site_difference(problem: JointProblem, iterate: JointIterate, covariance: Floats) -> float | None:
    """Estimated dip minus the site's dip, in standard deviations of the site's dip; None if unknown."""
    if problem.site is None or problem.site.sine is None:
        return None
    if "sine" in problem.layout:
        column = problem.layout.columns["sine"].start
        left = max(1.0 - covariance[column, column] / problem.site.sine_sigma**2, 0.0)
        return float((iterate.at.sine - problem.site.sine) / problem.site.sine_sigma / math.sqrt(max(left, 1e-6)))
    if "direction" in problem.layout:
        return float((iterate.at.direction[2] - problem.site.sine) / problem.site.sine_sigma)
    return None
