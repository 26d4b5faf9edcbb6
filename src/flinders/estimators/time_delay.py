"""How much later readings follow what drives them: a profile over a grid of lags, and a parabola about the best.

With the surface as it is, and all parameters free to first order, what a lag leaves is

    χ²(lag) = min Σ (s + J_P P − J θ(lag))² / σ²

with columns smoothed as in `flinders.estimators.regressors`, as the noise of a meter would otherwise be less between
two of its values than at one, and any such lag look better. With d = ∂s/∂lag, made free of the parameters, and C the
covariance of what is left, the best lag scatters by

    var lag = H⁻¹ dᵀC d H⁻¹,        H = ½ ∂²Σ r²/∂lag²

H does not grow with the noise of the meter, which is the same at each lag, and d does. A lag is kept only where it
saves more than chance, three standard deviations, and where the columns as they were logged fit better with it too: a
few large steps that smoothing blurs must not decide.

When to use it: for motors, whose meter is filtered or whose clock is another one. Not for a temperature, which follows
in minutes. Motors of which each has a column of its own are logged by one meter, and have one lag.

>>> time = np.arange(600) / 50.0
>>> current = 10.0 + 5.0 * np.sin(3.0 * time)
>>> later = np.interp(time - 0.2, time, current) + np.random.default_rng(1).normal(scale=0.1, size=600)
>>> cost = lambda lag: float(np.sum((later - np.interp(time - lag, time, current)) ** 2)) / 0.1**2
>>> delay = profile("current", cost, grid_of(0.02))
>>> round(delay.seconds, 2), delay.is_proven, delay.is_beyond
(0.2, True, False)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import motor
from flinders.estimators.covariance import Residuals, time_of
from flinders.estimators.disturbance_problem import DisturbanceProblem, settle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.estimators.disturbance_problem import Solved
    from flinders.estimators.regressors import Logged, Track

SEARCHED_S: Final = 1.0
"""A lag is looked for up to so many seconds, either way."""

LAGS: Final = 20
"""Steps of that search on each side."""

PROVEN: Final = 9.0
"""χ² that a lag has to save: three standard deviations."""

SMALL_S: Final = 1e-3
"""Difference of two lags by which the slope in it is reported."""

UNLAGGED: Final = ("temperature",)
"""What follows in minutes."""


@dataclass(frozen=True, slots=True)
class Lag:
    """The best lag of one disturbance."""

    name: str  #: of the disturbance
    seconds: float  #: by how much readings follow later; negative where they come earlier
    sigma_s: float  #: its standard deviation
    saved: float  #: χ² that it saves, against none; in variances of the lag once its scatter is known
    #: the end of the search is best: the true one lies beyond it, or what was logged is something else
    is_beyond: bool = False

    @property
    def is_proven(self) -> bool:
        """No chance makes so much of it."""
        return self.saved > PROVEN

    @property
    def used_sigma_s(self) -> float:
        """Standard deviation of what is kept of it: about none where it is not proven, which it is off by itself."""
        return self.sigma_s if self.is_proven else float(np.hypot(self.sigma_s, self.seconds))


def grid_of(step_s: float) -> Floats:
    """(2 n + 1,) lags to try, in s, none of them in the middle; at least half a reading apart."""
    grid: Floats = np.arange(-LAGS, LAGS + 1) * max(SEARCHED_S / LAGS, step_s / 2.0)
    return grid


def profile(name: str, cost: Callable[[float], float], grid: Floats) -> Lag:
    """Look for the lag that costs least: on a grid, then by two parabolas.

    Parameters
    ----------
    cost : callable
        χ² at a lag in s.
    grid : (2 n + 1,) float, s
        As of `grid_of`.
    """
    costs = np.array([cost(lag) for lag in grid])
    least = int(np.argmin(costs))
    saved = float(costs[len(grid) // 2] - costs[least])
    if least in (0, len(grid) - 1) and saved > PROVEN:
        return Lag(name, float(grid[least]), np.inf, saved, is_beyond=True)
    place = int(np.clip(least, 1, len(grid) - 2))
    best, width = float(grid[place]), np.inf
    for _ in range(2):  # finer about the best
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


def lags_of(logged: Logged, names: tuple[str, ...], spread: float) -> tuple[dict[str, Lag], Solved | None]:
    """The best lag of each motor, and the last solution on the way there; none without times."""
    lags: dict[str, Lag] = {}
    solved: Solved | None = None
    for late in lagging(names) if logged.is_timed else ():
        for _ in range(2):  # the second time with the noise that the first lag leaves
            solved = settle(DisturbanceProblem(logged, names, spread, proven_lags(lags)), solved)
            cost = _Cost(logged, names, late, proven_lags(lags), solved)
            lag = cost.judged(profile(late[0], cost, grid_of(logged.step_s)))
            lags |= {name: replace(lag, name=name) for name in late}
            if not lag.is_proven:
                break
    return lags, solved


def lagging(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Disturbances that may come late, those together that have one lag.

    >>> lagging(["current1", "current2", "throttle", "temperature"])
    [('current1', 'current2'), ('throttle',)]
    """
    families: dict[tuple[str, bool], list[str]] = {}
    for name in names:
        kind, number = motor(name)
        if kind not in UNLAGGED:
            families.setdefault((kind, number > 0), []).append(name)
    return [tuple(family) for family in families.values()]


def proven_lags(lags: dict[str, Lag]) -> dict[str, float]:
    """Those that are proven, in s."""
    return {name: lag.seconds for name, lag in lags.items() if lag.is_proven}


def residuals_of(solved: Solved) -> Residuals:
    """What is left at the readings that were used, in the order of recording."""
    used = solved.used
    return Residuals(solved.distances[used], solved.jacobian[used], [np.arange(int(used.sum()))])


class Shifted:
    """Departures of disturbances from their references, all smoothed, those of a family later by a lag that is tried.

    The others are smoothed as well: beside one that is not, one that is would stand for fast changes of its own.
    """

    def __init__(self, logged: Logged, names: tuple[str, ...], late: tuple[str, ...], lags: dict[str, float]) -> None:
        self._logged, self._names, self._lags = logged, names, lags
        courses = {name: logged.courses(name) for name in names}
        departed = [self._departed(name, courses[name], lags.get(name, 0.0)) for name in names]
        self._departures, self._courses = np.stack(departed, axis=1), {name: courses[name] for name in late}

    def __call__(self, lag_s: float) -> Floats:
        """(N, K) at a lag in s."""
        departures = self._departures.copy()
        for name, courses in self._courses.items():
            departures[:, self._names.index(name)] = self._departed(name, courses, lag_s)
        return departures

    def plainly(self, lag_s: float) -> Floats:
        """(N, K) the same of columns that are not smoothed."""
        return self._logged.departures(self._names, self._lags | dict.fromkeys(self._courses, lag_s))

    def _departed(self, name: str, courses: list[Track], lag_s: float) -> Floats:
        """(N,) of one of them."""
        departed: Floats = self._logged.along(courses, lag_s) - self._logged.reference(name)
        return departed

    def slope(self, lag_s: float) -> Floats:
        """(N, K) by how much they grow with it, for each s."""
        grown: Floats = (self(lag_s + SMALL_S) - self(lag_s - SMALL_S)) / (2.0 * SMALL_S)
        return grown


def scattered(lag: Lag, distances: Floats, moved: Floats, variance: float) -> Lag:
    """A lag with the standard deviation that what it leaves allows, and what it saves counted in that.

    Parameters
    ----------
    lag : Lag
        With that of the curvature alone.
    distances : (A, N) float
        What it leaves, axis by axis in the order of recording.
    moved : (A, N) float
        By how much those move with the lag, made free of all other parameters.
    variance : float
        That of χ².
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
    """χ² at another lag of some disturbances, with all parameters free to first order.

    Distances with what the disturbances take off put back, s + J_P P, by least squares on the columns of the other
    lags.
    """

    def __init__(
        self, logged: Logged, names: tuple[str, ...], late: tuple[str, ...], lags: dict[str, float], solved: Solved
    ) -> None:
        self._shifted, self._used = Shifted(logged, names, late, lags), solved.used
        places = 3 * len(names)
        self._shape = solved.jacobian[self._used, :9]
        self._target = solved.distances[self._used]
        self._target = self._target + solved.jacobian[self._used, 9 : 9 + places] @ solved.at.disturbances.ravel()
        self._variance = solved.noise**2 * time_of(residuals_of(solved).autocovariance())

    def __call__(self, lag_s: float) -> float:
        """χ² at a lag in s."""
        return self._left(self._shifted(lag_s))

    def judged(self, lag: Lag) -> Lag:
        """The same lag with the standard deviation that what it leaves allows; columns as logged have to be for it."""
        saved = self._left(self._shifted.plainly(0.0)) - self._left(self._shifted.plainly(lag.seconds))
        delay = self._scattered(lag)
        return replace(delay, saved=min(delay.saved, saved))

    def _left(self, departures: Floats) -> float:
        """χ² that departures leave."""
        gradient, square = self._equations(self._design(departures))
        taken = gradient @ np.linalg.lstsq(square, gradient, rcond=1e-12)[0]
        return float(self._target @ self._target - taken) / self._variance

    def _scattered(self, lag: Lag) -> Lag:
        """The same lag with the standard deviation that what it leaves allows."""
        design = self._design(self._shifted(lag.seconds))
        gradient, square = self._equations(design)
        inverse = np.linalg.pinv(square, rcond=1e-12, hermitian=True)
        solution = inverse @ gradient
        moved = self._columns(self._shifted.slope(lag.seconds)) @ solution[9:]
        moved -= design @ (inverse @ (design.T @ moved))
        return scattered(lag, (self._target - design @ solution)[np.newaxis], moved[np.newaxis], self._variance)

    def _equations(self, design: Floats) -> tuple[Floats, Floats]:
        """Gradient (K,) and square (K, K) of a design."""
        return design.T @ self._target, design.T @ design

    def _design(self, departures: Floats) -> Floats:
        """(M, 9 + 3 K) columns of offset, shape and P."""
        return np.column_stack([self._shape, self._columns(departures)])

    def _columns(self, departures: Floats) -> Floats:
        """(M, 3 K) those of P."""
        normals = self._shape[:, :3]
        moved: Floats = departures[self._used][:, :, np.newaxis] * normals[:, np.newaxis]
        return moved.reshape(len(normals), -1)
