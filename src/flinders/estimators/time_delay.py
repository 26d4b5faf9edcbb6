"""Lag of readings behind a disturbance: χ² on a grid of lags, and a parabola about the best lag.

With a fixed surface, and all parameters free to first order, χ² at a lag is

    χ²(lag) = min over θ of Σ (s + J_P P − J(lag) θ)² / σ²

with the distances s, the effect J_P P of the disturbances in them, and the columns J of all parameters. Columns are
smoothed as in `flinders.estimators.regressors`, because interpolation between two values of a meter would reduce its
noise and favour such lags. With d = ∂s/∂lag after regression on the parameters, and C the covariance of the residuals
r, the best lag has the variance

    var lag = H⁻¹ dᵀC d H⁻¹,        H = ½ ∂²Σ r²/∂lag²

The noise of the meter is the same at each lag, so that H does not depend on it, but d does. A lag is used only if it
reduces χ² significantly, by three standard deviations, and if it also improves the fit with unsmoothed columns. The
second condition excludes lags that come from the smoothing of a few large steps.

When to use it: for motors, whose meter is filtered or has another clock. Not for a temperature, which acts within
minutes. Motors with one column each are logged by one meter, and have a common lag.

>>> time = np.arange(600) / 50.0
>>> current = 10.0 + 5.0 * np.sin(3.0 * time)
>>> later = np.interp(time - 0.2, time, current) + np.random.default_rng(1).normal(scale=0.1, size=600)
>>> cost = lambda lag: float(np.sum((later - np.interp(time - lag, time, current)) ** 2)) / 0.1**2
>>> delay = search_lag("current", cost, lag_grid(0.02))
>>> round(delay.seconds, 2), delay.is_proven, delay.is_beyond
(0.2, True, False)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import kind_and_motor
from flinders.estimators.covariance import Residuals, correlation_length
from flinders.estimators.disturbance_problem import DisturbanceProblem, solve_disturbances

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.estimators.disturbance_problem import DisturbanceSolution
    from flinders.estimators.regressors import LoggedDisturbances, Track

MAX_LAG_S: Final = 1.0
"""Largest lag of the search in s, of either sign."""

GRID_STEPS: Final = 20
"""Count of steps of the search on each side of a lag of zero."""

MIN_CHI_SQUARE: Final = 9.0
"""Smallest reduction of χ² by a significant lag, which is three standard deviations."""

DERIVATIVE_STEP_S: Final = 1e-3
"""Step of the lag in s for numerical derivatives."""

KINDS_WITHOUT_LAG: Final = ("temperature",)
"""Disturbances without an estimated lag, as they act within minutes."""


@dataclass(frozen=True, slots=True)
class Lag:
    """Best lag of one disturbance."""

    name: str  #: name of the disturbance
    seconds: float  #: s: delay of the readings behind the disturbance; negative if the readings are earlier
    sigma_s: float  #: s: standard deviation of `seconds`
    saved: float  #: reduction of χ² compared with no lag
    #: whether the best lag is the largest of the search: the true lag is larger, or the column is another quantity
    is_beyond: bool = False

    @property
    def is_proven(self) -> bool:
        """Whether the lag is significant."""
        return self.saved > MIN_CHI_SQUARE

    @property
    def used_sigma_s(self) -> float:
        """1 σ in s of the lag that is used; a lag that is not significant is not used, and counts as an error."""
        return self.sigma_s if self.is_proven else float(np.hypot(self.sigma_s, self.seconds))


def lag_grid(step_s: float) -> Floats:
    """(2 n + 1,) lags of the search in s, with 0 in the middle and steps of at least half a reading."""
    grid: Floats = np.arange(-GRID_STEPS, GRID_STEPS + 1) * max(MAX_LAG_S / GRID_STEPS, step_s / 2.0)
    return grid


def search_lag(name: str, cost: Callable[[float], float], grid: Floats) -> Lag:
    """Find the lag of the smallest cost on a grid, then by two parabolas.

    Parameters
    ----------
    name : str
        Name of the disturbance.
    cost : callable
        Returns χ² at a lag in s.
    grid : (2 n + 1,) float, s
        Lags of `lag_grid`.
    """
    costs = np.array([cost(lag) for lag in grid])
    least = int(np.argmin(costs))
    saved = float(costs[len(grid) // 2] - costs[least])
    if least in (0, len(grid) - 1) and saved > MIN_CHI_SQUARE:
        return Lag(name, float(grid[least]), np.inf, saved, is_beyond=True)
    place = int(np.clip(least, 1, len(grid) - 2))
    best, width = float(grid[place]), np.inf
    for _ in range(2):  # parabolas with closer points about the best lag
        low, middle, high = costs[place - 1 : place + 2]
        bend = low - 2.0 * middle + high
        if bend <= 0.0:
            break
        best = grid[place] + 0.5 * (low - high) / bend * (grid[1] - grid[0])
        width = float(np.sqrt(2.0 / bend) * (grid[1] - grid[0]))
        grid = best + np.array([-1.0, 0.0, 1.0]) * max(min(width, grid[1] - grid[0]), 1e-3)
        costs = np.array([cost(lag) for lag in grid])
        place = 1
    return Lag(name, float(best), width, float(cost(0.0) - costs.min()))


def estimate_lags(
    logged: LoggedDisturbances, names: tuple[str, ...], spread: float
) -> tuple[dict[str, Lag], DisturbanceSolution | None]:
    """Best lag of each motor by its name, and the last solution of the search; no lags without times."""
    lags: dict[str, Lag] = {}
    solved: DisturbanceSolution | None = None
    for late in lag_groups(names) if logged.is_timed else ():
        for _ in range(2):  # the second time with the noise at the first lag
            solved = solve_disturbances(DisturbanceProblem(logged, names, spread, significant_lags(lags)), solved)
            cost = _Cost(logged, names, late, significant_lags(lags), solved)
            lag = cost.assess(search_lag(late[0], cost, lag_grid(logged.step_s)))
            lags |= {name: replace(lag, name=name) for name in late}
            if not lag.is_proven:
                break
    return lags, solved


def lag_groups(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Groups of disturbances with a common lag.

    >>> lag_groups(["current1", "current2", "throttle", "temperature"])
    [('current1', 'current2'), ('throttle',)]
    """
    families: dict[tuple[str, bool], list[str]] = {}
    for name in names:
        kind, number = kind_and_motor(name)
        if kind not in KINDS_WITHOUT_LAG:
            families.setdefault((kind, number > 0), []).append(name)
    return [tuple(family) for family in families.values()]


def significant_lags(lags: dict[str, Lag]) -> dict[str, float]:
    """Significant lags in s, by the name of the disturbance."""
    return {name: lag.seconds for name, lag in lags.items() if lag.is_proven}


def solution_residuals(solved: DisturbanceSolution) -> Residuals:
    """Residuals of a solution at the readings in the fit, in the order of recording."""
    used = solved.used
    return Residuals(solved.distances[used], solved.jacobian[used], [np.arange(int(used.sum()))])


class ShiftedDepartures:
    """Smoothed values of disturbances minus their references, with a variable lag of one group of disturbances.

    All disturbances are smoothed. Otherwise the fast changes of one disturbance could replace the changes that
    smoothing removes from another one.
    """

    def __init__(
        self, logged: LoggedDisturbances, names: tuple[str, ...], late: tuple[str, ...], lags: dict[str, float]
    ) -> None:
        self._logged, self._names, self._lags = logged, names, lags
        courses = {name: logged.courses(name) for name in names}
        departed = [self._departures_of(name, courses[name], lags.get(name, 0.0)) for name in names]
        self._departures, self._courses = np.stack(departed, axis=1), {name: courses[name] for name in late}

    def __call__(self, lag_s: float) -> Floats:
        """(N, K) departures at a lag in s."""
        departures = self._departures.copy()
        for name, courses in self._courses.items():
            departures[:, self._names.index(name)] = self._departures_of(name, courses, lag_s)
        return departures

    def unsmoothed_departures(self, lag_s: float) -> Floats:
        """(N, K) departures at a lag in s, of columns without smoothing."""
        return self._logged.departures(self._names, self._lags | dict.fromkeys(self._courses, lag_s))

    def _departures_of(self, name: str, courses: list[Track], lag_s: float) -> Floats:
        """(N,) departures of one disturbance."""
        departed: Floats = self._logged.along(courses, lag_s) - self._logged.reference(name)
        return departed

    def slope(self, lag_s: float) -> Floats:
        """(N, K) derivative of the departures by the lag, per s."""
        grown: Floats = (self(lag_s + DERIVATIVE_STEP_S) - self(lag_s - DERIVATIVE_STEP_S)) / (2.0 * DERIVATIVE_STEP_S)
        return grown


def with_sigma(lag: Lag, distances: Floats, moved: Floats, variance: float) -> Lag:
    """The lag with a standard deviation from correlated residuals, and `Lag.saved` scaled accordingly.

    Parameters
    ----------
    lag : Lag
        Lag with a standard deviation from the curvature of χ² alone.
    distances : (A, N) float
        Residuals at this lag, for each axis in the order of recording.
    moved : (A, N) float
        Derivative of the residuals by the lag, after regression on all other parameters.
    variance : float
        Variance of the residuals by which χ² is scaled.
    """
    pulls = distances * moved
    rows = list(np.arange(pulls.size).reshape(pulls.shape))
    residuals = Residuals(pulls.ravel(), np.ones((pulls.size, 1)), rows)
    scatter = float(residuals.scatter(residuals.autocovariance())[0, 0])
    if not (np.isfinite(lag.sigma_s) and scatter > 0.0):
        return lag
    sigma = lag.sigma_s**2 * float(np.sqrt(scatter)) / variance
    return replace(lag, sigma_s=sigma, saved=lag.saved * (lag.sigma_s / sigma) ** 2)


class _Cost:
    """χ² as a function of the lag of a group of disturbances, with all parameters free to first order.

    The distances without compensation, s + J_P P, are regressed on the shifted columns.
    """

    def __init__(
        self,
        logged: LoggedDisturbances,
        names: tuple[str, ...],
        late: tuple[str, ...],
        lags: dict[str, float],
        solved: DisturbanceSolution,
    ) -> None:
        self._shifted, self._used = ShiftedDepartures(logged, names, late, lags), solved.used
        places = 3 * len(names)
        self._shape = solved.jacobian[self._used, :9]
        self._target = solved.distances[self._used]
        self._target = self._target + solved.jacobian[self._used, 9 : 9 + places] @ solved.at.disturbances.ravel()
        self._variance = solved.noise**2 * correlation_length(solution_residuals(solved).autocovariance())

    def __call__(self, lag_s: float) -> float:
        """χ² at a lag in s."""
        return self._chi_square(self._shifted(lag_s))

    def assess(self, lag: Lag) -> Lag:
        """The lag with a standard deviation from the residuals.

        `Lag.saved` is at most the reduction of χ² with unsmoothed columns.
        """
        saved = self._chi_square(self._shifted.unsmoothed_departures(0.0)) - self._chi_square(
            self._shifted.unsmoothed_departures(lag.seconds)
        )
        delay = self._with_sigma(lag)
        return replace(delay, saved=min(delay.saved, saved))

    def _chi_square(self, departures: Floats) -> float:
        """χ² with given departures."""
        gradient, square = self._equations(self._design(departures))
        taken = gradient @ np.linalg.lstsq(square, gradient, rcond=1e-12)[0]
        return float(self._target @ self._target - taken) / self._variance

    def _with_sigma(self, lag: Lag) -> Lag:
        """The lag with a standard deviation from the residuals."""
        design = self._design(self._shifted(lag.seconds))
        gradient, square = self._equations(design)
        inverse = np.linalg.pinv(square, rcond=1e-12, hermitian=True)
        solution = inverse @ gradient
        moved = self._columns(self._shifted.slope(lag.seconds)) @ solution[9:]
        moved -= design @ (inverse @ (design.T @ moved))
        return with_sigma(lag, (self._target - design @ solution)[np.newaxis], moved[np.newaxis], self._variance)

    def _equations(self, design: Floats) -> tuple[Floats, Floats]:
        """(K,) gradient and (K, K) normal matrix of a design."""
        return design.T @ self._target, design.T @ design

    def _design(self, departures: Floats) -> Floats:
        """(M, 9 + 3 K) design with columns of offset, shape and P."""
        return np.column_stack([self._shape, self._columns(departures)])

    def _columns(self, departures: Floats) -> Floats:
        """(M, 3 K) columns of P."""
        normals = self._shape[:, :3]
        moved: Floats = departures[self._used][:, :, np.newaxis] * normals[:, np.newaxis]
        return moved.reshape(len(normals), -1)
