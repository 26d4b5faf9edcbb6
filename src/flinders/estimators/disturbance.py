"""What drives the offset, found along with the ellipsoid: motors, throttle, temperature.

Minimises

    Σ s(x − Σ P (c(t − lag) − reference))² / σ² + prior

over offset b, shape S, the offset per unit P of each disturbance, the growth a of the scale with the temperature, and
the lag of motors, s being the Sampson distance. `flinders.estimators.regressors` has the columns,
`flinders.estimators.disturbance_problem` the sum for the solver, `flinders.estimators.time_delay` looks for lags and
keeps those that readings prove, and `flinders.estimators.regressor_quality` says whether a column is fit to be used.

Use it where a current, a throttle or a temperature was recorded beside the readings and changed while the sensor was
turned. Not where the disturbance only changed in step with the attitude (see
`DisturbanceEstimate.attitude_collinearity`), nor for a sensor that was not turned: for that there is
`flinders.estimators.static_bench`.

The ellipsoid itself is then fitted to the settled readings by whatever method is asked for. What is not known of P is
carried over to b and S by `DisturbanceFit.carried`, so that their covariance is that of the joint fit:

    C = C | P + G C_P Gᵀ,        G = −(JᵀJ)⁻¹ JᵀJ_P

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
from flinders.core.compensation import compensated
from flinders.core.disturbance import Disturbance, motor
from flinders.core.joining import singles
from flinders.errors import NotTurned, UsageError
from flinders.estimators.disturbance_problem import DisturbanceProblem, settle
from flinders.estimators.regressor_quality import (
    RegressorError,
    attenuation,
    collinearity,
    curvature,
    monotonicity,
    noise_of,
    pooled,
    rounding,
    shared,
    widened,
)
from flinders.estimators.regressors import DisturbanceEstimate, Logged
from flinders.estimators.static_bench import still
from flinders.estimators.time_delay import lagging, lags_of, proven_lags, residuals_of
from flinders.heading.error_propagation import HeadingError, level_error
from flinders.likelihood import prior
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators.disturbance_problem import Solved
    from flinders.estimators.regressor_quality import Noise
    from flinders.estimators.time_delay import Lag
    from flinders.geometry.ellipsoid import Ellipsoid

LEANT: Final = 0.5
"""Leverage from which on a reading says more of the surface through it than all others say there."""

MOST_LEVERAGE: Final = 0.99
"""More would say anything of what the reading is off."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceFit:
    """Disturbances with their uncertainty, and what that does to an ellipsoid."""

    disturbances: tuple[Disturbance, ...]
    #: (K, K): of (P₁, P₂, …, a): three rows for each disturbance, and one for the growth of the scale with temperature
    covariance: Floats
    carried: Floats  #: (9, K): by how much offset and shape move for each unit of those
    ellipsoid: Ellipsoid  #: the one found along with them
    noise: float  #: standard deviation of the distances that are left, in the unit of the readings
    noise_without: float  #: the same of the best ellipsoid that follows nothing, over the same readings
    #: one for each disturbance, without what it does to headings
    estimates: tuple[DisturbanceEstimate, ...]
    constant: tuple[str, ...] = ()  #: disturbances that hardly changed, of which nothing was found
    #: (D, D): what a unit of one disturbance goes with of another motor's, in its unit, row by row; ones on the
    #: diagonal
    along: Floats = field(default_factory=lambda: np.eye(0))
    #: (9, 9): covariance of offset and shape from what single readings may be off on which they lean
    leaning: Floats = field(default_factory=lambda: np.zeros((9, 9)))

    @property
    def calibration(self) -> Calibration:
        """A calibration that follows the disturbances, by which readings are settled."""
        return replace(
            Calibration.from_ellipsoid(self.ellipsoid.centre, self.ellipsoid.shape), disturbances=self.disturbances
        )

    def with_states(self, states: Mapping[str, tuple[str, ...]]) -> DisturbanceFit:
        """The same with the words of columns of states, by name."""
        disturbances = tuple(one.with_states(states.get(one.name, ())) for one in self.disturbances)
        estimates = zip(self.estimates, disturbances, strict=True)
        worded = tuple(replace(estimate, disturbance=one) for estimate, one in estimates)
        return replace(self, disturbances=disturbances, estimates=worded)

    def widened(self, covariance: Floats) -> Floats:
        """(9, 9) covariance of offset and shape at the references, from that which takes the disturbances as known."""
        wider: Floats = covariance + self.leaning + self.carried @ self.covariance @ self.carried.T
        return wider

    def joint(self, covariance: Floats) -> Floats:
        """(9 + K, 9 + K) covariance of offset, shape and disturbances, given the widened one of offset and shape."""
        across = self.carried @ self.covariance
        return np.block([[covariance, across], [across.T, self.covariance]])

    def at_end(self, covariance: Floats, place: int) -> Floats:
        """(9, 9) the same at the far end of the range of one disturbance, the others at their references."""
        disturbance = self.disturbances[place]
        carried = self.carried.copy()
        away = (disturbance.farthest - disturbance.reference) * self.along[place]
        carried[:3, : 3 * len(away)] += np.kron(away, np.eye(3))
        wider: Floats = covariance + carried @ self.covariance @ carried.T
        return wider

    def remaining_error(
        self, ellipsoid: Ellipsoid, place: int, *, dip_deg: float, down: Floats | None = None
    ) -> HeadingError:
        """Heading error (1 σ) that the uncertainty of one disturbance leaves at the far end of its range."""
        return level_error(ellipsoid, self.at_end(np.zeros((9, 9)), place), dip_deg=dip_deg, down=down)


def fit_disturbances(
    recordings: Sequence[Recording], names: Sequence[str], *, spread: float | None = prior.SPREAD
) -> DisturbanceFit:
    """Find what drives the offset.

    Raises `UsageError` for a name that is not known; `InputError` where a recording lacks the column; `TooFewSamples`
    for fewer readings than anything can be distinguished from.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one sensor; a lag does not reach from one into the next.
    names : sequence of str
        ``current``, ``throttle``, ``temperature``; of one motor ``current1`` or ``throttle1``, of all ``currents`` or
        ``throttles``; another column of numbers by its name in the log.
    spread : float, optional
        As for `flinders.likelihood.prior`, on the shape; None for the default, as a solver needs a hold.
    """
    logged = Logged.of(recordings, tuple(names))
    moving, constant = logged.split()
    prior_spread = prior.SPREAD if spread is None else spread
    without = settle(DisturbanceProblem(logged, (), prior_spread, {}))
    if not moving:
        nothing = np.zeros((0, 0)), np.zeros((9, 0))
        return DisturbanceFit((), *nothing, without.at.ellipsoid, without.noise, without.noise, (), constant)
    lags, near = lags_of(logged, moving, prior_spread)
    problem = DisturbanceProblem(logged, moving, prior_spread, proven_lags(lags))
    return _identified(problem, settle(problem, near), lags, without, constant)


def _identified(
    problem: DisturbanceProblem, solved: Solved, lags: dict[str, Lag], without: Solved, constant: tuple[str, ...]
) -> DisturbanceFit:
    """Put together what was found, with the covariance that the residuals allow."""
    residuals = residuals_of(solved)
    believed = problem.prior_matrix(solved.at)
    matrix = residuals.jacobian.T @ residuals.jacobian / solved.noise**2 + believed
    inverse = NormalEquations(matrix, np.zeros(len(matrix)), 0.0, 0).inverse()
    scatter = residuals.scatter(residuals.autocovariance()) / solved.noise**4
    covariance = _metered(problem, solved, inverse @ (scatter + believed) @ inverse, inverse)
    plain = NormalEquations(matrix[:9, :9], np.zeros(9), 0.0, 0).inverse()
    disturbances = _disturbances(problem, solved)
    return DisturbanceFit(
        disturbances,
        covariance[9:, 9:],
        -plain @ matrix[:9, 9:],
        solved.at.ellipsoid,
        solved.noise,
        _noise_on(without, solved.used),
        tuple(_estimate(problem, solved, (inverse, covariance), each, lags.get(each.name)) for each in disturbances),
        constant,
        _along(problem),
        _leaning(solved, matrix),
    )


def _leaning(solved: Solved, matrix: Floats) -> Floats:
    """(9, 9) covariance of offset and shape, the disturbances as found, from readings that the fit leans on.

    A reading of leverage h pulls the surface to itself, and its distance s says s/(1 − h) of what it may be off. The
    others of its kind tell nothing of that: a fit that was told by one reading across a gap of directions would claim
    the usual noise for it. Source: J. G. MacKinnon, H. White, J. Econometrics 29 (1985) 305–325, their HC3.
    """
    rows, distances = solved.jacobian[solved.used], solved.distances[solved.used]
    inverse = NormalEquations(matrix, np.zeros(len(matrix)), 0.0, len(rows)).inverse() / solved.noise**2
    leverage = np.minimum(np.einsum("ij,jk,ik->i", rows, inverse, rows), MOST_LEVERAGE)
    leant = leverage > LEANT
    off = distances[leant] / (1.0 - leverage[leant])
    plain = NormalEquations(matrix[:9, :9], np.zeros(9), 0.0, len(rows)).inverse() / solved.noise**2
    moved = (rows[leant, :9] * off[:, np.newaxis]) @ plain
    sensitivity: Floats = moved.T @ moved
    return sensitivity


def _metered(problem: DisturbanceProblem, solved: Solved, covariance: Floats, inverse: Floats) -> Floats:
    """(9 + K, 9 + K) covariance with what the meters add to it.

    What was rounded off is the same throughout a setting, and pulls as one beside what it does to the normal matrix.
    """
    used = solved.used
    normals = solved.jacobian[used, :3]
    squares, turned = np.linalg.eigh(normals.T @ normals)
    per_variance = turned * np.sqrt(np.maximum(squares, 0.0)) / solved.noise
    noises = _noises(problem, solved)
    meters, pulled = [], np.zeros_like(inverse)
    for place, name in enumerate(problem.names):
        rounded, setting = rounding(problem.logged.values[name], name)
        root = np.zeros((len(inverse), 3))
        root[9 + 3 * place : 12 + 3 * place] = per_variance
        meters.append(RegressorError(noises[name], rounded, root))
        rows = solved.jacobian[used] * (normals @ solved.at.disturbances[place])[:, np.newaxis]
        pulls = np.stack([np.bincount(setting[used], weights=column) for column in rows.T], axis=1)
        moved = pulls @ inverse / solved.noise**2
        pulled += rounded * moved.T @ moved
    coefficients = np.zeros(len(inverse))  # the growth of the scale is multiplied with no column of a meter alone
    coefficients[9 : 9 + 3 * len(problem.names)] = solved.at.disturbances.ravel()
    return widened(covariance, inverse, coefficients, meters) + pulled


def _noises(problem: DisturbanceProblem, solved: Solved) -> dict[str, Noise]:
    """Noise of each meter; those of motors that are followed one by one are of one kind."""
    used, departures, noises = solved.used, problem.departures, {}
    for place, name in enumerate(problem.names):
        sensitivity = solved.jacobian[used, :3] @ solved.at.disturbances[place]
        noises[name] = noise_of(departures[used, place], solved.distances[used], sensitivity)
    for late in lagging(problem.names):
        noises |= zip(late, pooled([noises[name] for name in late]), strict=True)
    return noises


def _along(problem: DisturbanceProblem) -> Floats:
    """(D, D) slopes through no current of each motor's column over another's, in one family; else the unit matrix."""
    departures = problem.departures
    products = departures.T @ departures
    slopes = products / np.diag(products)[:, np.newaxis]
    family = [motor(name) for name in problem.names]
    is_related = [[one[0] == other[0] and bool(one[1] and other[1]) for other in family] for one in family]
    return np.where(np.array(is_related) | np.eye(len(family), dtype=bool), slopes, 0.0)


def _disturbances(problem: DisturbanceProblem, solved: Solved) -> tuple[Disturbance, ...]:
    """The disturbances that a solution stands for."""
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
    problem: DisturbanceProblem, solved: Solved, covariances: tuple[Floats, Floats], found: Disturbance, lag: Lag | None
) -> DisturbanceEstimate:
    """What is known of one disturbance; `covariances` (9 + K, 9 + K) by white noise, and as claimed."""
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
        attitude_collinearity=shared(solved.jacobian[used, :9], coefficients),
        monotonicity=monotonicity(values),
        attenuation=attenuation(values, solved.distances[used], normals @ found.per_unit),
        lag_sigma_s=np.nan if lag is None else lag.used_sigma_s,
        chi_square=chi_square,
        is_lag_at_limit=lag is not None and lag.is_beyond,
        curvature=curvature(values, residuals_of(solved), normals, found.per_unit),
        collinearity=collinearity(values, np.delete(problem.departures[used], place, axis=1)),
        explained_share=share,
        explained_share_sigma=2.0 * share * (1.0 - share) * sigma / max(size, np.finfo(float).tiny),
        explained=size * float(np.std(values)),
        explained_sigma=sigma * float(np.std(values)),
    )


def _noise_on(solved: Solved, used: NDArray[np.bool_]) -> float:
    """Root mean square distance over readings that another solution used."""
    return float(np.sqrt(np.mean(solved.distances[used] ** 2)))


def with_disturbances(
    source: object, names: Sequence[str], *, spread: float | None
) -> tuple[DisturbanceFit, Recording]:
    """Find what drives a recording, and settle it: what is left is fitted like any other.

    Raises `UsageError` for what is no recording, or a disturbance that is not known; `NotTurned` where the sensor was
    still: `still` finds its disturbances, and nothing finds an ellipsoid; `InputError` or `TooFewSamples` as
    `fit_disturbances`.
    """
    if not hasattr(source, "blocks"):
        raise UsageError(f"to follow {' and '.join(names)} needs a recording with that column: give Samples")
    recording = cast("Recording", source)
    parts = list(singles(recording))
    unturned = still(parts, names)
    if unturned is not None:
        raise NotTurned(unturned.noise, " and ".join(names))
    found = fit_disturbances(parts, names, spread=spread)
    return found, compensated(recording, found.calibration)
