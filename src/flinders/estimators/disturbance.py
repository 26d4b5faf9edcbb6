"""Joint fit of the ellipsoid and the disturbances of the offset: motors, throttle, temperature.

Minimises

    Σ s(x − Σ P (c(t − lag) − reference))² / σ² + prior

over offset b, shape S, the offset per unit P of each disturbance, the growth a of the scale with the temperature, and
the lag of motors, with the Sampson distance s. `flinders.estimators.regressors` has the columns,
`flinders.estimators.disturbance_problem` the problem of the solver, `flinders.estimators.time_delay` estimates lags and
keeps the significant ones, and `flinders.estimators.regressor_quality` checks the quality of a column.

Use it if a current, a throttle or a temperature was recorded with the readings and changed while the sensor was turned.
Do not use it if the disturbance changed only with the attitude (see `DisturbanceEstimate.attitude_collinearity`). For a
sensor that was not turned use `flinders.estimators.static_bench`.

The ellipsoid is then fitted to the compensated readings by any method. The uncertainty of P is propagated to b and S by
the derivative G, `DisturbanceFit.ellipsoid_derivative`. The covariance C of b and S is then that of the joint fit, with
C₀ for known disturbances and C_P of P:

    C = C₀ + G C_P Gᵀ,        G = −(JᵀJ)⁻¹ JᵀJ_P

>>> from flinders import simulate
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> found = fit_disturbances([simulate.tumble(seed=1, disturbances=[motors]).samples], ("current",))
>>> error = found.disturbances[0].per_unit - [0.5, 0.0, -0.3]
>>> bool(np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(found.covariance))))
True
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.core.calibration import Calibration
from flinders.core.compensation import compensate_recording
from flinders.core.disturbance import Disturbance, kind_and_motor
from flinders.core.joining import single_recordings
from flinders.errors import NotTurned, UsageError
from flinders.estimators.disturbance_problem import DisturbanceProblem, solve_disturbances
from flinders.estimators.regressor_quality import (
    RegressorError,
    attenuation,
    collinearity,
    curvature,
    monotonicity,
    noise_of,
    pool_noise,
    rounding_variance,
    shared_information,
    widen_covariance,
)
from flinders.estimators.regressors import DisturbanceEstimate, LoggedDisturbances
from flinders.estimators.static_bench import fit_still
from flinders.estimators.time_delay import estimate_lags, lag_groups, significant_lags, solution_residuals
from flinders.heading.error_propagation import HeadingError, level_error
from flinders.likelihood import prior
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators.disturbance_problem import DisturbanceSolution
    from flinders.estimators.regressor_quality import Noise
    from flinders.estimators.time_delay import Lag
    from flinders.geometry.ellipsoid import Ellipsoid

MIN_LEVERAGE: Final = 0.5
"""Leverage from which a single reading determines the surface in its direction more than all others together."""

MAX_LEVERAGE: Final = 0.99
"""Largest leverage in the estimate of a reading's error; the estimate diverges at 1."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceFit:
    """Estimated disturbances with their covariance, and the effect of their uncertainty on the ellipsoid."""

    disturbances: tuple[Disturbance, ...]
    #: (K, K): covariance of (P₁, P₂, …, a): three rows for each disturbance, and one for the growth of the scale with
    #: the temperature
    covariance: Floats
    ellipsoid_derivative: Floats  #: (9, K): derivative of offset and shape by these parameters
    ellipsoid: Ellipsoid  #: ellipsoid of the joint fit
    noise: float  #: standard deviation of the distances from the ellipsoid, in the unit of the readings
    #: standard deviation of the distances of the same readings from the best ellipsoid without disturbances
    noise_without: float
    #: statistics of each disturbance, without its effect on headings
    estimates: tuple[DisturbanceEstimate, ...]
    constant: tuple[str, ...] = ()  #: disturbances that hardly changed, which are not estimated
    #: (D, D): regression slope of each motor's disturbance (column) on another one (row), in its unit; ones on the
    #: diagonal
    motor_slopes: Floats = field(default_factory=lambda: np.eye(0))
    #: (9, 9): covariance of offset and shape from the errors of single readings of high leverage
    leverage_covariance: Floats = field(default_factory=lambda: np.zeros((9, 9)))

    @property
    def calibration(self) -> Calibration:
        """A calibration with the disturbances, to compensate readings."""
        return replace(
            Calibration.from_ellipsoid(self.ellipsoid.centre, self.ellipsoid.shape), disturbances=self.disturbances
        )

    def with_states(self, states: Mapping[str, tuple[str, ...]]) -> DisturbanceFit:
        """A copy in which columns of states have their two words, given by the name of the column."""
        disturbances = tuple(one.with_states(states.get(one.name, ())) for one in self.disturbances)
        estimates = zip(self.estimates, disturbances, strict=True)
        worded = tuple(replace(estimate, disturbance=one) for estimate, one in estimates)
        return replace(self, disturbances=disturbances, estimates=worded)

    def widen(self, covariance: Floats) -> Floats:
        """(9, 9) covariance of offset and shape at the references of the disturbances.

        `covariance` is that of offset and shape for known disturbances.
        """
        derivative = self.ellipsoid_derivative
        wider: Floats = covariance + self.leverage_covariance + derivative @ self.covariance @ derivative.T
        return wider

    def joint_covariance(self, covariance: Floats) -> Floats:
        """(9 + K, 9 + K) covariance of offset, shape and disturbances.

        `covariance` is the (9, 9) result of `widen` for offset and shape.
        """
        across = self.ellipsoid_derivative @ self.covariance
        return np.block([[covariance, across], [across.T, self.covariance]])

    def at_end(self, covariance: Floats, place: int) -> Floats:
        """(9, 9) covariance of offset and shape with one disturbance at the far end of its range."""
        disturbance = self.disturbances[place]
        ellipsoid_derivative = self.ellipsoid_derivative.copy()
        away = (disturbance.extreme_value - disturbance.reference) * self.motor_slopes[place]
        ellipsoid_derivative[:3, : 3 * len(away)] += np.kron(away, np.eye(3))
        wider: Floats = covariance + ellipsoid_derivative @ self.covariance @ ellipsoid_derivative.T
        return wider

    def remaining_error(
        self, ellipsoid: Ellipsoid, place: int, *, dip_deg: float, down: Floats | None = None
    ) -> HeadingError:
        """Heading error (1 σ) from the uncertainty of one disturbance, at the far end of its range."""
        return level_error(ellipsoid, self.at_end(np.zeros((9, 9)), place), dip_deg=dip_deg, down=down)


def fit_disturbances(
    recordings: Sequence[Recording], names: Sequence[str], *, spread: float | None = prior.SOFT_IRON_SPREAD
) -> DisturbanceFit:
    """Estimate disturbances of the offset.

    Raises `UsageError` for an unknown name; `InputError` if a recording lacks the column; `TooFewSamples` for too few
    readings.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings of one sensor; lags do not cross their ends.
    names : sequence of str
        ``current``, ``throttle``, ``temperature``; of one motor ``current1`` or ``throttle1``, of all ``currents`` or
        ``throttles``; another column of numbers by its name in the log.
    spread : float, optional
        Spread of the prior of the shape, see `flinders.likelihood.prior`; None for the default, which the solver needs.
    """
    logged = LoggedDisturbances.of(recordings, tuple(names))
    moving, constant = logged.split()
    prior_spread = prior.SOFT_IRON_SPREAD if spread is None else spread
    without = solve_disturbances(DisturbanceProblem(logged, (), prior_spread, {}))
    if not moving:
        nothing = np.zeros((0, 0)), np.zeros((9, 0))
        return DisturbanceFit((), *nothing, without.at.ellipsoid, without.noise, without.noise, (), constant)
    lags, near = estimate_lags(logged, moving, prior_spread)
    problem = DisturbanceProblem(logged, moving, prior_spread, significant_lags(lags))
    return _make_fit(problem, solve_disturbances(problem, near), lags, without, constant)


def _make_fit(
    problem: DisturbanceProblem,
    solved: DisturbanceSolution,
    lags: dict[str, Lag],
    without: DisturbanceSolution,
    constant: tuple[str, ...],
) -> DisturbanceFit:
    """Make the result, with a covariance by the residuals."""
    residuals = solution_residuals(solved)
    believed = problem.prior_matrix(solved.at)
    matrix = residuals.jacobian.T @ residuals.jacobian / solved.noise**2 + believed
    inverse = NormalEquations(matrix, np.zeros(len(matrix)), 0.0, 0).inverse()
    scatter = residuals.scatter(residuals.autocovariance()) / solved.noise**4
    covariance = _add_meter_errors(problem, solved, inverse @ (scatter + believed) @ inverse, inverse)
    plain = NormalEquations(matrix[:9, :9], np.zeros(9), 0.0, 0).inverse()
    disturbances = _disturbances(problem, solved)
    return DisturbanceFit(
        disturbances,
        covariance[9:, 9:],
        -plain @ matrix[:9, 9:],
        solved.at.ellipsoid,
        solved.noise,
        _rms_over(without, solved.used),
        tuple(_estimate(problem, solved, (inverse, covariance), each, lags.get(each.name)) for each in disturbances),
        constant,
        _motor_slopes(problem),
        _leverage_covariance(solved, matrix),
    )


def _leverage_covariance(solved: DisturbanceSolution, matrix: Floats) -> Floats:
    """(9, 9) covariance of offset and shape, for known disturbances, from errors of readings of high leverage.

    A reading of leverage h pulls the surface towards itself, so that its error is estimated from its distance s as
    s/(1 − h). The noise of the other readings would not show an error of a reading that is alone in its direction.
    Source: J. G. MacKinnon, H. White, J. Econometrics 29 (1985) 305–325, HC3.
    """
    rows, distances = solved.jacobian[solved.used], solved.distances[solved.used]
    inverse = NormalEquations(matrix, np.zeros(len(matrix)), 0.0, len(rows)).inverse() / solved.noise**2
    leverage = np.minimum(np.einsum("ij,jk,ik->i", rows, inverse, rows), MAX_LEVERAGE)
    leant = leverage > MIN_LEVERAGE
    off = distances[leant] / (1.0 - leverage[leant])
    plain = NormalEquations(matrix[:9, :9], np.zeros(9), 0.0, len(rows)).inverse() / solved.noise**2
    moved = (rows[leant, :9] * off[:, np.newaxis]) @ plain
    sensitivity: Floats = moved.T @ moved
    return sensitivity


def _add_meter_errors(
    problem: DisturbanceProblem, solved: DisturbanceSolution, covariance: Floats, inverse: Floats
) -> Floats:
    """(9 + K, 9 + K) covariance, including noise and rounding of the meters of the disturbances.

    A rounding error is constant while the meter shows one value, so that all these readings have a common error.
    """
    used = solved.used
    normals = solved.jacobian[used, :3]
    squares, turned = np.linalg.eigh(normals.T @ normals)
    per_variance = turned * np.sqrt(np.maximum(squares, 0.0)) / solved.noise
    noises = _meter_noises(problem, solved)
    meters, pulled = [], np.zeros_like(inverse)
    for place, name in enumerate(problem.names):
        rounded, setting = rounding_variance(problem.logged.values[name], name)
        root = np.zeros((len(inverse), 3))
        root[9 + 3 * place : 12 + 3 * place] = per_variance
        meters.append(RegressorError(noises[name], rounded, root))
        rows = solved.jacobian[used] * (normals @ solved.at.disturbances[place])[:, np.newaxis]
        pulls = np.stack([np.bincount(setting[used], weights=column) for column in rows.T], axis=1)
        moved = pulls @ inverse / solved.noise**2
        pulled += rounded * moved.T @ moved
    coefficients = np.zeros(len(inverse))  # 0 for the growth of the scale, which has no column of its own
    coefficients[9 : 9 + 3 * len(problem.names)] = solved.at.disturbances.ravel()
    return widen_covariance(covariance, inverse, coefficients, meters) + pulled


def _meter_noises(problem: DisturbanceProblem, solved: DisturbanceSolution) -> dict[str, Noise]:
    """Noise of each meter, by the name of the disturbance; the meters of single motors have a common noise."""
    used, departures, noises = solved.used, problem.departures, {}
    for place, name in enumerate(problem.names):
        sensitivity = solved.jacobian[used, :3] @ solved.at.disturbances[place]
        noises[name] = noise_of(departures[used, place], solved.distances[used], sensitivity)
    for late in lag_groups(problem.names):
        noises |= zip(late, pool_noise([noises[name] for name in late]), strict=True)
    return noises


def _motor_slopes(problem: DisturbanceProblem) -> Floats:
    """(D, D) slopes through zero between the columns of motors of one kind; otherwise the unit matrix."""
    departures = problem.departures
    products = departures.T @ departures
    slopes = products / np.diag(products)[:, np.newaxis]
    family = [kind_and_motor(name) for name in problem.names]
    is_related = [[one[0] == other[0] and bool(one[1] and other[1]) for other in family] for one in family]
    return np.where(np.array(is_related) | np.eye(len(family), dtype=bool), slopes, 0.0)


def _disturbances(problem: DisturbanceProblem, solved: DisturbanceSolution) -> tuple[Disturbance, ...]:
    """Disturbances of a solution."""
    return tuple(
        Disturbance(
            name,
            solved.at.disturbances[place],
            problem.logged.reference(name),
            *problem.logged.range(name),
            problem.lags.get(name, 0.0),
            solved.at.slope if name == "temperature" else 0.0,
        )
        for place, name in enumerate(problem.names)
    )


def _estimate(
    problem: DisturbanceProblem,
    solved: DisturbanceSolution,
    covariances: tuple[Floats, Floats],
    found: Disturbance,
    lag: Lag | None,
) -> DisturbanceEstimate:
    """Statistics of one disturbance; `covariances` are the (9 + K, 9 + K) ones for white noise, and as claimed."""
    inverse, claimed = covariances
    place, used = problem.names.index(found.name), solved.used
    rows = slice(9 + 3 * place, 12 + 3 * place)
    values = problem.departures[used, place]
    normals = solved.jacobian[used, :3]
    coefficients = normals * (values - values.mean())[:, np.newaxis]
    chi_square = float(found.per_unit @ np.linalg.solve(inverse[rows, rows], found.per_unit))
    share, size = chi_square / (chi_square + len(values)), float(np.linalg.norm(found.per_unit))
    along = found.per_unit / max(size, np.finfo(float).tiny)
    sigma = float(np.sqrt(along @ claimed[rows, rows] @ along))
    return DisturbanceEstimate(
        found.name,
        found,
        attitude_collinearity=shared_information(solved.jacobian[used, :9], coefficients),
        monotonicity=monotonicity(values),
        attenuation=attenuation(values, solved.distances[used], normals @ found.per_unit),
        lag_sigma_s=np.nan if lag is None else lag.used_sigma_s,
        chi_square=chi_square,
        is_lag_at_limit=lag is not None and lag.is_beyond,
        curvature=curvature(values, solution_residuals(solved), normals, found.per_unit),
        collinearity=collinearity(values, np.delete(problem.departures[used], place, axis=1)),
        explained_share=share,
        explained_share_sigma=2.0 * share * (1.0 - share) * sigma / max(size, np.finfo(float).tiny),
        explained=size * float(np.std(values)),
        explained_sigma=sigma * float(np.std(values)),
    )


def _rms_over(solved: DisturbanceSolution, used: NDArray[np.bool_]) -> float:
    """Rms distance from the surface of a solution, over the `used` readings of another solution."""
    return float(np.sqrt(np.mean(solved.distances[used] ** 2)))


def fit_and_compensate(
    source: object, names: Sequence[str], *, spread: float | None
) -> tuple[DisturbanceFit, Recording]:
    """Estimate the disturbances of a recording, and compensate the recording for them.

    The compensated recording can be fitted by any method. Raises `UsageError` for a source that is not a recording, or
    an unknown disturbance. Raises `NotTurned` if the sensor was still: `fit_still` then estimates its disturbances, but
    no ellipsoid. Raises `InputError` or `TooFewSamples` as `fit_disturbances`.
    """
    if not hasattr(source, "blocks"):
        raise UsageError(
            f"to correct for {' and '.join(names)}, give a recording with such a column, for example Samples"
        )
    recording = cast("Recording", source)
    parts = list(single_recordings(recording))
    unturned = fit_still(parts, names)
    if unturned is not None:
        raise NotTurned(unturned.noise, " and ".join(names))
    found = fit_disturbances(parts, names, spread=spread)
    return found, compensate_recording(recording, found.calibration)
