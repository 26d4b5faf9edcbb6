"""The solver of `flinders.estimators.disturbance`: offset, shape, and what disturbances add to them, settled together.

Minimises

    Σ s(x − Σ P (c(t − lag) − reference))² / σ² + prior

by damped Gauss–Newton steps on (b, S, P, a) with the columns of `flinders.likelihood.disturbance`. Readings that lie
far off count less at first (Cauchy weights), and not at all in the end. Lags are given:
`flinders.estimators.time_delay` looks for them.

It stands beside `flinders.estimators.solver`, which eliminates a direction of the field for each reading or window:
here the magnitude alone counts, and there is none to be eliminated.

>>> from flinders import simulate
>>> from flinders.estimators.regressors import Logged
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> samples = simulate.tumble(seed=1, disturbances=[motors]).samples
>>> solved = settle(DisturbanceProblem(Logged.of([samples], ("current",)), ("current",), 0.3, {}))
>>> solved.coefficients.round(1) + 0.0
array([ 0.5,  0. , -0.3])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.estimators.robust import TO_SIGMA
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.likelihood import disturbance, magnitude, prior
from flinders.likelihood.equations import NormalEquations
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.regressors import Logged

ROUGHLY: Final = 1_000
"""Readings on which a start is found."""

STEPS: Final = 60
SETTLED: Final = 1e-6
"""Of the radius: after a shorter step none follows. The exact place is found by the fit to the settled readings."""

NO_WORSE: Final = 0.01
"""In χ²: a step that costs less is taken, as the Jacobian is that of the surface and not of the cost."""

LOST: Final = 1e6
"""Damping beyond which no step is worth taking."""

FAR: Final = 4.0
"""Robust standard deviations beyond which a reading is left out in the end."""

CAUCHY: Final = 2.4
"""Robust standard deviations at which a reading counts half at first."""

FEWEST_KEPT: Final = 0.5
"""Share of the readings that is kept, however far the others lie."""

WEAK: Final = 1.0
"""Fields over the recorded range, 1 σ: what is thought likely of a disturbance before it is looked at."""

GROWTH: Final = 0.005
"""Share of the scale per °C, 1 σ: the same."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbanceProblem:
    """What is to be solved.

    Attributes
    ----------
    logged : Logged
    names : tuple of str
        Of the disturbances that are followed.
    spread : float
        Of the prior on the shape.
    lags : dict of str to float, s
        Those that are not zero.
    """

    logged: Logged
    names: tuple[str, ...]
    spread: float
    lags: dict[str, float]

    @property
    def departures(self) -> Floats:
        """(N, K) values of the disturbances less their references."""
        return self.logged.departures(self.names, self.lags)

    @property
    def warm(self) -> int | None:
        """Which disturbance is the temperature."""
        return self.names.index("temperature") if "temperature" in self.names else None


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A solution, and what was found there.

    Attributes
    ----------
    ellipsoid : Ellipsoid
    coefficients : (K,) float
        P₁, P₂, … and a.
    distances : (N,) float
    jacobian : (N, 9 + K) float
    used : (N,) bool
        Readings that belong to the surface.
    """

    ellipsoid: Ellipsoid
    coefficients: Floats
    distances: Floats
    jacobian: Floats
    used: NDArray[np.bool_]

    @property
    def noise(self) -> float:
        """Standard deviation of the distances of the readings that were used."""
        used = self.distances[self.used]
        return float(np.sqrt(used @ used / max(len(used) - self.jacobian.shape[1], 1)))


def settle(problem: DisturbanceProblem, start: Solved | None = None) -> Solved:
    """Solve from each of a few starts, robustly at first, and keep the best."""
    solver = Solver.of(problem)
    if start is None:
        fewer = solver.thinned(ROUGHLY)
        roughly = [fewer.iterated(*one, None) for one in fewer.starts()]
        start = min(roughly, key=lambda one: spread_of(one.distances))
    best = solver.at(start.ellipsoid, start.coefficients)
    used = _near(best.distances)
    for _ in range(3):
        best = solver.iterated(best.ellipsoid, best.coefficients, used)
        again = _near(best.distances)
        if np.array_equal(again, used):
            break
        used = again
    return replace(best, used=used)


@dataclass(frozen=True, slots=True, eq=False)
class Solver:
    """Damped Gauss–Newton on (b, S, P, a).

    Attributes
    ----------
    field : (N, 3) float
    departures : (N, K) float
        Values of the disturbances less their references.
    warmth : (N,) float, optional
        That of the temperature among them, which the scale may follow.
    spread : float
        Of the prior on the shape.
    """

    field: Floats
    departures: Floats
    warmth: Floats | None
    spread: float

    @classmethod
    def of(cls, problem: DisturbanceProblem) -> Self:
        """Take what a problem holds."""
        departures = problem.departures
        warm = problem.warm
        return cls(problem.logged.field, departures, None if warm is None else departures[:, warm], problem.spread)

    def thinned(self, most: int) -> Solver:
        """The same on fewer readings, spread evenly over all."""
        stride = -(-len(self.field) // most)
        warmth = None if self.warmth is None else self.warmth[::stride]
        return Solver(self.field[::stride], self.departures[::stride], warmth, self.spread)

    @property
    def count(self) -> int:
        """Of P and a."""
        return 3 * int(self.departures.shape[1]) + (self.warmth is not None)

    def starts(self) -> list[tuple[Ellipsoid, Floats]]:
        """Spheres about the readings: as they are, and with what sudden changes of the disturbances make taken off."""
        coefficients: list[Floats] = [np.zeros(self.count)]
        if self.count:
            coefficients.append(self._by_steps())
        return [(_sphere(self._settled(coefficients, np.zeros(3))), coefficients) for coefficients in coefficients]

    def _by_steps(self) -> Floats:
        """(K,) P from steps between neighbours: where a disturbance jumps, the attitude has hardly changed."""
        wide = max(1, len(self.field) // 2000)
        steps, moved = (values[wide:] - values[:-wide] for values in (self.departures, self.field))
        shifts = np.linalg.lstsq(steps, moved, rcond=None)[0].ravel()
        return np.append(shifts, np.zeros(self.count - len(shifts)))

    def _settled(self, coefficients: Floats, centre: Floats) -> Floats:
        """(N, 3) readings without what drives them."""
        places = self.departures.shape[1]
        settled = self.field - self.departures @ coefficients[: 3 * places].reshape(places, 3)
        if self.warmth is None:
            return settled
        grown: Floats = (
            centre + (settled - centre) / np.maximum(1.0 + coefficients[-1] * self.warmth, 0.1)[:, np.newaxis]
        )
        return grown

    def at(self, ellipsoid: Ellipsoid, coefficients: Floats) -> Solved:
        """Distances and their Jacobian."""
        settled = self._settled(coefficients, ellipsoid.centre)
        directions = directions_of(settled, ellipsoid)
        jacobian = np.column_stack(
            [
                magnitude.information(directions, ellipsoid),
                disturbance.columns(directions, ellipsoid, self.departures, self.warmth),
            ]
        )
        return Solved(
            ellipsoid, coefficients, magnitude.distances(settled, ellipsoid), jacobian, np.ones(len(settled), bool)
        )

    def iterated(self, ellipsoid: Ellipsoid, coefficients: Floats, used: NDArray[np.bool_] | None) -> Solved:
        """Steps until they vanish; `used` None for Cauchy weights that are renewed at each."""
        now, damping = self.at(ellipsoid, coefficients), 1e-3
        for _ in range(STEPS):
            size = max(spread_of(now.distances if used is None else now.distances[used]), 1e-9 * now.ellipsoid.radius)
            weights = 1.0 / (1.0 + (now.distances / (CAUCHY * size)) ** 2) if used is None else used.astype(float)
            equations = self.equations(now, weights / size**2)
            cost = self._cost(now, used, size)
            while damping < LOST:
                step = np.linalg.solve(
                    equations.matrix + damping * np.diag(np.diag(equations.matrix)), equations.gradient
                )
                tried = self._stepped(now, step)
                if tried is not None and self._cost(tried, used, size) <= cost + NO_WORSE:
                    break
                damping *= 5.0
            else:
                return now
            now, damping = tried, max(damping / 10.0, 1e-10)
            if np.abs(step[:9]).max() < SETTLED * now.ellipsoid.radius:
                return now
        return now

    def equations(self, now: Solved, weights: Floats) -> NormalEquations:
        """Normal equations of weighed readings and the prior, of offset, shape, P and a."""
        weighted = now.jacobian * weights[:, np.newaxis]
        matrix, gradient = weighted.T @ now.jacobian, weighted.T @ now.distances
        believed = prior.equations(now.ellipsoid, spread=self.spread)
        matrix[:9, :9] += believed.matrix
        gradient[:9] += believed.gradient
        precision = self._precision(now.ellipsoid.radius)
        matrix[9:, 9:] += np.diag(precision)
        gradient[9:] -= precision * now.coefficients
        return NormalEquations(matrix, gradient, float(weights @ now.distances**2) + believed.cost, len(weights))

    def _precision(self, radius: float) -> Floats:
        """(K,) of what is thought likely of P and a."""
        ranges = np.maximum(np.abs(self.departures).max(axis=0, initial=0.0), np.finfo(float).tiny)
        precision = np.repeat((ranges / (WEAK * radius)) ** 2, 3)
        return precision if self.warmth is None else np.append(precision, 1.0 / GROWTH**2)

    def _cost(self, now: Solved, used: NDArray[np.bool_] | None, size: float) -> float:
        """What is minimised."""
        believed = prior.equations(now.ellipsoid, spread=self.spread).cost
        believed += float(self._precision(now.ellipsoid.radius) @ now.coefficients**2)
        scaled = (now.distances if used is None else now.distances[used]) / size
        if used is None:
            return float(CAUCHY**2 * np.log1p((scaled / CAUCHY) ** 2).sum()) + believed
        return float(scaled @ scaled) + believed

    def _stepped(self, now: Solved, step: Floats) -> Solved | None:
        """Take a step, unless it opens the surface."""
        shape = now.ellipsoid.shape + symmetric(step[3:9])
        if np.linalg.eigvalsh(shape)[0] <= 1e-3 * now.ellipsoid.radius:
            return None
        return self.at(Ellipsoid(now.ellipsoid.centre + step[:3], shape), now.coefficients + step[9:])


def spread_of(distances: Floats) -> float:
    """Robust standard deviation about zero."""
    return TO_SIGMA * float(np.median(np.abs(distances)))


def _near(distances: Floats) -> NDArray[np.bool_]:
    """Which readings belong to the surface."""
    size = np.abs(distances)
    limit = max(FAR * spread_of(distances), float(np.quantile(size, FEWEST_KEPT)))
    near: NDArray[np.bool_] = size <= max(limit, np.finfo(float).tiny)
    return near


def _sphere(readings: Floats) -> Ellipsoid:
    """A sphere about readings, by linear least squares about the median one; also of flat ones."""
    middle = np.median(readings, axis=0)
    about = readings - middle
    design = np.column_stack([2.0 * about, np.ones(len(about))])
    solution = np.linalg.lstsq(design, np.einsum("ij,ij->i", about, about), rcond=None)[0]
    distances = np.linalg.norm(about - solution[:3], axis=1)
    return Ellipsoid(middle + solution[:3], max(float(np.median(distances)), 1e-12) * np.eye(3))
