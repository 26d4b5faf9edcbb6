"""Problem of `flinders.likelihood.solver` for offset, shape and disturbances, by the magnitude alone.

Minimises

    Σ ρ(s(x − Σ P (c(t − lag) − reference)) / σ) + prior

over (b, S, P, a), with the disturbances c. The scale of the earth's field may grow by a τ, with the departure τ of the
temperature from its reference. The direction of the field at a reading is no parameter, as the Sampson distance s does
not need it. With the Jacobian J = [n, n_i u_j] of `flinders.likelihood.magnitude` the change of s is linear in P, so
that a few steps from a good start are enough:

    ∂s/∂P = −n c,        ∂s/∂a = −τ n·S u

At first large distances have reduced weights, ρ(s) = k² log(1 + s²/k²). In the end outliers are left out, and
ρ(s) = s². Lags are known here; `flinders.estimators.time_delay` estimates them.

Source: the model is that of ArduPilot's CompassMot; P. W. Holland, R. E. Welsch, Comm. Statist. A 6 (1977) 813–827, for
Cauchy weights and their k.

>>> from flinders import simulate
>>> from flinders.estimators.regressors import LoggedDisturbances
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> samples = simulate.tumble(seed=1, disturbances=[motors]).samples
>>> logged = LoggedDisturbances.of([samples], ("current",))
>>> solved = solve_disturbances(DisturbanceProblem(logged, ("current",), 0.3, {}))
>>> solved.at.disturbances.round(1) + 0.0
array([[ 0.5,  0. , -0.3]])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Self, TypeAlias

import numpy as np

from flinders.geometry.ellipsoid import sphere_through, symmetric_matrix, upper_entries
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import NormalEquations
from flinders.likelihood.observations import EliminatedEquations
from flinders.likelihood.parameters import ParameterLayout, Surface
from flinders.likelihood.robust import robust_sigma
from flinders.likelihood.solver import Iterate, levenberg_marquardt
from flinders.summary.coverage import corrected_directions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.regressors import LoggedDisturbances
    from flinders.likelihood.solver import Equations

MAX_START_READINGS: Final = 1_000
"""Largest number of readings for the search of a start."""

MAX_COST_INCREASE: Final = 0.01
"""Largest increase of χ² by an accepted step; the Jacobian is that of the surface, not exactly that of the cost."""

LAST_STEP_SIGMAS: Final = 1e-5
"""Length of the last step in standard deviations: small, as steps converge slowly if a disturbance follows attitude."""

MIN_SCALE: Final = 1e-9
"""Smallest scale of the residuals, relative to the radius."""

OUTLIER_SIGMAS: Final = 4.0
"""Smallest distance of an outlier from the surface in robust standard deviations."""

CAUCHY_SIGMAS: Final = 2.4
"""Distance in robust standard deviations at which a Cauchy weight is one half."""

MIN_INLIER_SHARE: Final = 0.5
"""Smallest fraction of inliers among the readings; with fewer, the nearest readings count as inliers."""

EFFECT_SIGMA: Final = 1.0
"""Prior standard deviation of the change of the offset over a disturbance's recorded range, relative to the field."""

GROWTH_SIGMA: Final = 0.005
"""Prior standard deviation of the relative growth of the scale per °C."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbedSurface(Surface):
    """Offset and shape at the references of the disturbances, and the offset per unit of each disturbance."""

    disturbances: Floats  # (K, 3) P: change of the offset for each unit of each disturbance
    slope: float = 0.0  # a, 1/°C: relative growth of the scale

    def take_step(self, step: Floats, layout: ParameterLayout) -> Self:
        """Surface after a (P,) step."""
        shifts, growth = step[layout.columns["disturbances"]], step[layout.columns["slope"]]
        return type(self)(
            self.offset + step[:3],
            self.shape + symmetric_matrix(step[3:9]),
            self.disturbances + shifts.reshape(-1, 3),
            self.slope + float(growth.sum()),
        )


@dataclass(frozen=True, slots=True, eq=False)
class CompensatedReadings:
    """Readings whose magnitude after compensation is observed, as observations of the solver."""

    field: Floats  # (N, 3): readings
    departures: Floats  # (N, K): values of the disturbances minus their references
    warmth: Floats | None  # (N,), °C: departure of the temperature, if the scale can follow it
    inliers: NDArray[np.bool_] | None = None  # (N,): readings in the cost; None for Cauchy weights

    def thin(self, most: int) -> Self:
        """The observations of at most `most` readings, spread evenly."""
        stride = -(-len(self.field) // most)
        warmth = None if self.warmth is None else self.warmth[::stride]
        return replace(self, field=self.field[::stride], departures=self.departures[::stride], warmth=warmth)

    @property
    def layout(self) -> ParameterLayout:
        """Columns of the Jacobian: offset, shape, P and a."""
        end = 9 + 3 * self.departures.shape[1]
        size = end + (self.warmth is not None)
        return ParameterLayout({"disturbances": slice(9, end), "slope": slice(end, size)}, size)

    def compensate(self, at: DisturbedSurface) -> Floats:
        """(N, 3) readings at the references of the disturbances."""
        settled = self.field - self.departures @ at.disturbances
        if self.warmth is None:
            return settled
        grown: Floats = np.maximum(1.0 + at.slope * self.warmth, 0.1)[:, np.newaxis]
        return at.offset + (settled - at.offset) / grown

    def distances(self, at: DisturbedSurface) -> Floats:
        """(N,) Sampson distances."""
        return magnitude.distances(self.compensate(at), at.ellipsoid)

    def jacobian(self, at: DisturbedSurface) -> Floats:
        """(N, P) Jacobian: displacement of the surface at each of N readings by each of P parameters."""
        directions = corrected_directions(self.compensate(at), at.ellipsoid)
        jacobian = magnitude.information(directions, at.ellipsoid)
        columns = [jacobian, *(jacobian[:, :3] * values[:, np.newaxis] for values in self.departures.T)]
        if self.warmth is not None:
            columns.append(self.warmth * (jacobian[:, 3:] @ upper_entries(at.shape)))
        return np.column_stack(columns)

    def scale(self, at: DisturbedSurface) -> float:
        """Robust standard deviation of the distances of inliers."""
        distances = self.distances(at)
        counted = distances if self.inliers is None else distances[self.inliers]
        return max(robust_sigma(counted), MIN_SCALE * at.ellipsoid.radius)

    def at(self, _: DisturbedSurface) -> Self:
        """The same observations, which do not depend on the parameters."""
        return self

    def linearize(self, at: DisturbedSurface, _: Floats, __: ParameterLayout, scale: float) -> EliminatedEquations:
        """Normal equations of iteratively reweighted least squares; directions of the field do not occur."""
        scaled = self.distances(at) / scale
        weights = 1.0 / (1.0 + (scaled / CAUCHY_SIGMAS) ** 2) if self.inliers is None else self.inliers.astype(float)
        rows = self.jacobian(at) / scale
        weighted = rows * weights[:, np.newaxis]
        return EliminatedEquations.without_directions(weighted.T @ rows, weighted.T @ scaled, self._loss(scaled))

    def cost(self, at: DisturbedSurface, _: Floats, scale: float) -> float:
        """Σ ρ of the distances divided by their scale."""
        return self._loss(self.distances(at) / scale)

    def _loss(self, scaled: Floats) -> float:
        """Σ ρ of (N,) scaled distances."""
        if self.inliers is None:
            return float(CAUCHY_SIGMAS**2 * np.log1p((scaled / CAUCHY_SIGMAS) ** 2).sum())
        return float(scaled[self.inliers] @ scaled[self.inliers])


CompensatedIterate: TypeAlias = Iterate[DisturbedSurface, CompensatedReadings, float]


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Readings, and the prior of the parameters."""

    readings: CompensatedReadings
    spread: float  # spread of the prior of the shape
    tolerance: ClassVar[float] = MAX_COST_INCREASE
    last_step: ClassVar[float] = LAST_STEP_SIGMAS

    @property
    def layout(self) -> ParameterLayout:
        """Columns of the parameters."""
        return self.readings.layout

    def prior_equations(self, at: DisturbedSurface) -> NormalEquations:
        """Normal equations of the prior: soft iron is small, as are the effects of P and a over the recorded range."""
        matrix, gradient = np.zeros((self.layout.size, self.layout.size)), np.zeros(self.layout.size)
        shape = prior.equations(at.ellipsoid, spread=self.spread)
        ranges = np.maximum(np.abs(self.readings.departures).max(axis=0, initial=0.0), np.finfo(float).tiny)
        precision = np.repeat((ranges / (EFFECT_SIGMA * at.ellipsoid.radius)) ** 2, 3)
        if self.readings.warmth is not None:
            precision = np.append(precision, 1.0 / GROWTH_SIGMA**2)
        values = np.append(at.disturbances.ravel(), [] if self.readings.warmth is None else [at.slope])
        matrix[:9, :9], gradient[:9] = shape.matrix, shape.gradient
        matrix[9:, 9:], gradient[9:] = np.diag(precision), -precision * values
        return NormalEquations(matrix, gradient, shape.cost + float(precision @ values**2), 0)

    def reweigh(self, iterate: CompensatedIterate, _: Equations) -> CompensatedIterate:
        """Set the scale of the distances to their robust standard deviation."""
        return replace(iterate, weights=self.readings.scale(iterate.at))

    def solve(self, at: DisturbedSurface) -> DisturbedSurface:
        """Solution of the solver from a start."""
        start = Iterate(at, (self.readings,), (np.empty((0, 3)),), self.readings.scale(at))
        return levenberg_marquardt(self, start).at


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceProblem:
    """A recording, and the disturbances to estimate."""

    logged: LoggedDisturbances
    names: tuple[str, ...]  # names of the disturbances
    spread: float  # spread of the prior of the shape
    lags: dict[str, float]  # s: lags by the name of the disturbance; zero if missing

    @property
    def departures(self) -> Floats:
        """(N, K) values of the disturbances minus their references."""
        return self.logged.departures(self.names, self.lags)

    @property
    def readings(self) -> CompensatedReadings:
        """Field and disturbances as recorded."""
        departures = self.departures
        warmth = departures[:, self.names.index("temperature")] if "temperature" in self.names else None
        return CompensatedReadings(self.logged.field, departures, warmth)

    def prior_matrix(self, at: DisturbedSurface) -> Floats:
        """(P, P) inverse covariance of the prior."""
        return _Fit(self.readings, self.spread).prior_equations(at).matrix


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceSolution:
    """Solution of a `DisturbanceProblem`."""

    at: DisturbedSurface
    distances: Floats  # (N,)
    jacobian: Floats  # (N, 9 + K): derivatives by offset, shape, P₁, P₂, … and a
    used: NDArray[np.bool_]  # (N,): inliers

    @property
    def noise(self) -> float:
        """Standard deviation of the distances of inliers."""
        used = self.distances[self.used]
        return float(np.sqrt(used @ used / max(len(used) - self.jacobian.shape[1], 1)))


def solve_disturbances(problem: DisturbanceProblem, start: DisturbanceSolution | None = None) -> DisturbanceSolution:
    """Solve robustly from the best of a few starts or from `start`, then without outliers."""
    readings = problem.readings
    at = _start(readings.thin(MAX_START_READINGS), problem.spread) if start is None else start.at
    used = _find_inliers(readings.distances(at))
    for _ in range(3):
        at = _Fit(replace(readings, inliers=used), problem.spread).solve(at)
        again = _find_inliers(readings.distances(at))
        if np.array_equal(again, used):
            break
        used = again
    return DisturbanceSolution(at, readings.distances(at), readings.jacobian(at), used)


def _start(readings: CompensatedReadings, spread: float) -> DisturbedSurface:
    """Best solution of two starts: spheres about the readings, and about readings less `_shifts_from_steps`."""
    shifts: list[Floats] = [np.zeros((readings.departures.shape[1], 3))]
    if readings.departures.shape[1]:
        shifts.append(_shifts_from_steps(readings))
    solutions = [_Fit(readings, spread).solve(_sphere(readings, shift)) for shift in shifts]
    return min(solutions, key=lambda at: robust_sigma(readings.distances(at)))


def _shifts_from_steps(readings: CompensatedReadings) -> Floats:
    """(K, 3) P from differences of consecutive readings: the attitude hardly changes while a disturbance jumps."""
    wide = max(1, len(readings.field) // 2000)
    steps, moved = (values[wide:] - values[:-wide] for values in (readings.departures, readings.field))
    shifts: Floats = np.linalg.lstsq(steps, moved, rcond=None)[0]
    return shifts


def _find_inliers(distances: Floats) -> NDArray[np.bool_]:
    """(N,) whether each reading is an inlier, by its distance from the surface."""
    size = np.abs(distances)
    limit = max(OUTLIER_SIGMAS * robust_sigma(distances), float(np.quantile(size, MIN_INLIER_SHARE)))
    near: NDArray[np.bool_] = size <= max(limit, np.finfo(float).tiny)
    return near


def _sphere(readings: CompensatedReadings, shifts: Floats) -> DisturbedSurface:
    """Sphere about compensated readings, by linear least squares about their median; also for readings in a plane."""
    settled = readings.field - readings.departures @ shifts
    centre, _ = sphere_through(settled, np.median(settled, axis=0))
    radius = max(float(np.median(np.linalg.norm(settled - centre, axis=1))), 1e-12)
    return DisturbedSurface(centre, radius * np.eye(3), shifts)
