"""How much later readings follow what drives them: a profile over a grid of lags, and a parabola about the best.

With the surface as it is, and all parameters free to first order, what a lag leaves is

    χ²(lag) = min Σ (s + J_P P − J θ(lag))² / σ²

whose curvature at the least is that of 1/σ²(lag). A lag is kept only where it saves more χ² than chance: three standard
deviations. Residuals that hang together count for as many as are independent.

When to use it: for motors, whose meter is filtered or whose clock is another one. Not for a temperature, which follows
in minutes. Motors of which each has a column of its own are logged by one meter, and have one lag.

>>> time = np.arange(600) / 50.0
>>> current = 10.0 + 5.0 * np.sin(3.0 * time)
>>> later = np.interp(time - 0.2, time, current) + np.random.default_rng(1).normal(scale=0.1, size=600)
>>> cost = lambda lag: float(np.sum((later - np.interp(time - lag, time, current)) ** 2)) / 0.1**2
>>> found = profile("current", cost, grid_of(0.02))
>>> round(found.seconds, 2), found.is_proven, found.is_beyond
(0.2, True, False)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.drivers import motor
from flinders.estimators.correlation import Residuals, time_of
from flinders.estimators.settling import Problem, settle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.estimators.logged import Logged
    from flinders.estimators.settling import Solved

SEARCHED_S: Final = 1.0
"""A lag is looked for up to so many seconds, either way."""

LAGS: Final = 20
"""Steps of that search on each side."""

PROVEN: Final = 9.0
"""χ² that a lag has to save: three standard deviations."""

UNLAGGED: Final = ("temperature",)
"""What follows in minutes."""


@dataclass(frozen=True, slots=True)
class Lag:
    """The best lag of one driver.

    Attributes
    ----------
    name : str
        Of the driver.
    seconds : float
        By how much readings follow later; negative where they come earlier.
    sigma_s : float
        Its standard deviation.
    saved : float
        χ² that it saves, against none.
    is_beyond : bool
        The end of the search is best: the true one lies beyond it, or what was logged is something else.
    """

    name: str
    seconds: float
    sigma_s: float
    saved: float
    is_beyond: bool = False

    @property
    def is_proven(self) -> bool:
        """No chance makes so much of it."""
        return self.saved > PROVEN


def grid_of(step_s: float) -> Floats:
    """(2 n + 1,) lags to try, in s, none of them in the middle; at least half a reading apart."""
    grid: Floats = np.arange(-LAGS, LAGS + 1) * max(SEARCHED_S / LAGS, step_s / 2.0)
    return grid


def profile(name: str, cost: Callable[[float], float], grid: Floats) -> Lag:
    """Look for the lag that costs least: on a grid, then by two parabolas.

    Parameters
    ----------
    name : str
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
            solved = settle(Problem(logged, names, spread, kept(lags)), solved)
            lag = profile(late[0], _Cost(logged, names, late, kept(lags), solved), grid_of(logged.step_s))
            lags |= {name: replace(lag, name=name) for name in late}
            if not lag.is_proven:
                break
    return lags, solved


def lagging(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Drivers that may come late, those together that have one lag.

    >>> lagging(["current1", "current2", "throttle", "temperature"])
    [('current1', 'current2'), ('throttle',)]
    """
    families: dict[tuple[str, bool], list[str]] = {}
    for name in names:
        of, number = motor(name)
        if of not in UNLAGGED:
            families.setdefault((of, number > 0), []).append(name)
    return [tuple(family) for family in families.values()]


def kept(lags: dict[str, Lag]) -> dict[str, float]:
    """Those that are proven, in s."""
    return {name: lag.seconds for name, lag in lags.items() if lag.is_proven}


def residuals_of(solved: Solved) -> Residuals:
    """What is left at the readings that were used, in the order of recording."""
    used = solved.used
    return Residuals(solved.distances[used], solved.jacobian[used], [np.arange(int(used.sum()))])


class _Cost:
    """χ² that another lag of some drivers leaves, with the surface as it is and all parameters free to first order.

    Distances with what the drivers take off put back, s + J_P P, by least squares on the columns of the other lags.
    """

    def __init__(
        self, logged: Logged, names: tuple[str, ...], late: tuple[str, ...], lags: dict[str, float], solved: Solved
    ) -> None:
        self._logged, self._names, self._late, self._lags, self._used = logged, names, late, lags, solved.used
        places = 3 * len(names)
        self._shape = solved.jacobian[self._used, :9]
        self._target = solved.distances[self._used]
        self._target = self._target + solved.jacobian[self._used, 9 : 9 + places] @ solved.driven[:places]
        self._variance = solved.noise**2 * time_of(residuals_of(solved).autocovariance())

    def __call__(self, lag_s: float) -> float:
        """χ² at a lag in s."""
        departures = self._logged.departures(self._names, self._lags | dict.fromkeys(self._late, lag_s))[self._used]
        normals = self._shape[:, :3]
        moved = (departures[:, :, np.newaxis] * normals[:, np.newaxis]).reshape(len(normals), -1)
        design = np.column_stack([self._shape, moved])
        gradient = design.T @ self._target
        taken = gradient @ np.linalg.lstsq(design.T @ design, gradient, rcond=1e-12)[0]
        return float(self._target @ self._target - taken) / self._variance
