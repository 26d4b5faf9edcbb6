"""What drives the offset, found along with the ellipsoid: motors, throttle, temperature.

Minimises

    Σ s(x − Σ P (c(t − lag) − reference))² / σ² + prior

over offset b, shape S, the offset per unit P of each driver, the growth a of the scale with the temperature, and the
lag of motors, s being the Sampson distance. Steps are damped Gauss–Newton steps with the columns of
`flinders.terms.driver`; readings that lie far off count less at first (Cauchy weights), and not at all in the end. The
lag is looked for on a grid, and kept only where readings prove it.

Use it where a current, a throttle or a temperature was recorded beside the readings and changed while the sensor was
turned. Not where the driver only changed in step with the attitude (see `Found.shared`), nor for a sensor that was not
turned: for that there is `still`.

The ellipsoid itself is then fitted to the settled readings by whatever method is asked for. What is not known of P is
carried over to b and S by `Driving.carried`, so that their covariance is that of the joint fit:

    C = C | P + G C_P Gᵀ,        G = −(JᵀJ)⁻¹ JᵀJ_P

>>> from flinders import simulate
>>> motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
>>> found = driving_of([simulate.tumble(seed=1, disturbances=[motors]).samples], ("current",))
>>> error = found.drivers[0].per_unit - [0.5, 0.0, -0.3]
>>> bool(np.all(np.abs(error) < 3.0 * np.sqrt(np.diag(found.covariance))))
True
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self, cast

import numpy as np

from flinders.calibration import Calibration
from flinders.coverage import directions_of
from flinders.driven import settled
from flinders.drivers import Driver, known, lagged
from flinders.errors import InputError, NotTurned, TooFewSamples, UsageError, counted
from flinders.estimators.correlation import Residuals, time_of
from flinders.heading import HeadingError, level_error
from flinders.planar import down_of
from flinders.quadric import Ellipsoid, symmetric
from flinders.result import Driven
from flinders.samples import singles
from flinders.terms import driver as term
from flinders.terms import magnitude, prior

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.result import Fit
    from flinders.samples import Recording, Samples

MOST: Final = 20_000
"""Readings of a longer recording that are looked at, spread evenly over it."""

ROUGHLY: Final = 1_000
"""Readings on which a start is found."""

FEWEST: Final = 30
"""Readings below which nothing is said of a driver."""

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

SEARCHED_S: Final = 1.0
"""A lag is looked for up to so many seconds, either way."""

LAGS: Final = 20
"""Steps of that search on each side."""

PROVEN: Final = 9.0
"""χ² that a lag has to save: three standard deviations."""

WEAK: Final = 1.0
"""Fields over the recorded range, 1 σ: what is thought likely of a driver before it is looked at."""

GROWTH: Final = 0.005
"""Share of the scale per °C, 1 σ: the same."""


@dataclass(frozen=True, slots=True)
class Found:
    """What is known of one driver beside its numbers.

    Attributes
    ----------
    name : str
    shared : float
        Share of what readings tell about it, in the worst direction, that offset and shape could explain as well.
    lag_sigma_s : float
        Standard deviation of the lag, s; NaN where none was looked for.
    chi_square : float
        What it takes off the sum of squares, in the noise variance that is left.
    """

    name: str
    shared: float
    lag_sigma_s: float
    chi_square: float


@dataclass(frozen=True, slots=True, eq=False)
class Driving:
    """Drivers with their uncertainty, and what that does to an ellipsoid.

    Attributes
    ----------
    drivers : tuple of Driver
    covariance : (K, K) float
        Of (P₁, P₂, …, a): three rows for each driver, and one for the growth with the temperature where there is one.
    carried : (9, K) float
        By how much offset and shape move for each unit of those.
    ellipsoid : Ellipsoid
        The one found along with them.
    noise : float
        Standard deviation of the distances that are left, in the unit of the readings.
    noise_without : float
        The same of the best ellipsoid that follows nothing, over the same readings.
    found : tuple of Found
        One for each driver.
    constant : tuple of str
        Drivers that hardly changed, of which nothing was found.
    """

    drivers: tuple[Driver, ...]
    covariance: Floats
    carried: Floats
    ellipsoid: Ellipsoid
    noise: float
    noise_without: float
    found: tuple[Found, ...]
    constant: tuple[str, ...] = ()

    @property
    def calibration(self) -> Calibration:
        """A calibration that follows the drivers, by which readings are settled."""
        return replace(Calibration.from_ellipsoid(self.ellipsoid.centre, self.ellipsoid.shape), drivers=self.drivers)

    def widened(self, covariance: Floats) -> Floats:
        """(9, 9) covariance of offset and shape at the references, from that which takes the drivers as known."""
        wider: Floats = covariance + self.carried @ self.covariance @ self.carried.T
        return wider

    def joint(self, covariance: Floats) -> Floats:
        """(9 + K, 9 + K) covariance of offset, shape and drivers, from that of offset and shape as it was widened."""
        across = self.carried @ self.covariance
        return np.block([[covariance, across], [across.T, self.covariance]])

    def at_end(self, covariance: Floats, place: int) -> Floats:
        """(9, 9) the same at the far end of the range of one driver, the others at their references."""
        driver = self.drivers[place]
        carried = self.carried.copy()
        carried[:3, 3 * place : 3 * place + 3] += (driver.farthest - driver.reference) * np.eye(3)
        wider: Floats = covariance + carried @ self.covariance @ carried.T
        return wider

    def left(self, ellipsoid: Ellipsoid, place: int, *, dip_deg: float, down: Floats | None = None) -> HeadingError:
        """Heading error (1 σ) that the uncertainty of one driver leaves at the far end of its range."""
        return level_error(ellipsoid, self.at_end(np.zeros((9, 9)), place), dip_deg=dip_deg, down=down)


def driving_of(
    recordings: Sequence[Recording], names: Sequence[str], *, spread: float | None = prior.SPREAD
) -> Driving:
    """Find what drives the offset.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one sensor; a lag does not reach from one into the next.
    names : sequence of str
        ``current``, ``throttle``, ``temperature``.
    spread : float, optional
        As for `flinders.terms.prior`, on the shape; None for the default, as a solver needs a hold.

    Raises
    ------
    UsageError
        For a name that is not known.
    InputError
        Where a recording lacks the column.
    TooFewSamples
        For fewer readings than anything can be told from.
    """
    logged = _Logged.of(recordings, tuple(dict.fromkeys(names)))
    moving, constant = logged.split()
    held = prior.SPREAD if spread is None else spread
    without = _settle(_Problem(logged, (), held, {}))
    if not moving:
        nothing = np.zeros((0, 0)), np.zeros((9, 0))
        return Driving((), *nothing, without.ellipsoid, without.noise, without.noise, (), constant)
    lags, sigmas, near = _lags(logged, moving, held)
    problem = _Problem(logged, moving, held, lags)
    solved = _settle(problem, near)
    return _told(problem, solved, sigmas, without, constant)


@dataclass(frozen=True, slots=True, eq=False)
class _Logged:
    """Columns of the recordings, one after the other.

    Attributes
    ----------
    field : (N, 3) float
    values : dict of str to (N,) float
        Of each driver, without lag.
    parts : list of (N_i,) slices of the above, with all that was logged of each
    """

    field: Floats
    values: dict[str, Floats]
    parts: tuple[_Part, ...]

    @classmethod
    def of(cls, recordings: Sequence[Recording], names: tuple[str, ...]) -> Self:
        """Go through the recordings once."""
        for name in names:
            known(name)
        wholes = [_Part.of(recording, names) for recording in recordings]
        total = sum(len(part.field) for part in wholes)
        if total < FEWEST:
            raise TooFewSamples(found=total, needed=FEWEST, method=f"with {' and '.join(names)}")
        stride = -(-total // MOST)
        parts = tuple(replace(part, stride=stride) for part in wholes)
        values = {name: np.concatenate([part.lagged(name, 0.0) for part in parts]) for name in names}
        return cls(np.concatenate([part.field[::stride] for part in parts]), values, parts)

    def lagged(self, name: str, lag_s: float) -> Floats:
        """(N,) values of a driver so much earlier."""
        if lag_s == 0.0:
            return self.values[name]
        return np.concatenate([part.lagged(name, lag_s) for part in self.parts])

    @property
    def is_timed(self) -> bool:
        """There are ascending times everywhere, and with them a before and an after."""
        return all(part.time is not None and bool(np.all(np.diff(part.time) > 0.0)) for part in self.parts)

    @property
    def step_s(self) -> float:
        """Usual time from one reading to the next."""
        return float(np.median(np.concatenate([np.diff(part.time) for part in self.parts if part.time is not None])))

    def split(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the drivers that changed, and of those that did not."""
        moving = tuple(name for name, values in self.values.items() if _changes(name, values))
        return moving, tuple(name for name in self.values if name not in moving)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Columns of one recording."""

    field: Floats
    time: Floats | None
    columns: dict[str, Floats]
    stride: int = 1

    @classmethod
    def of(cls, recording: Recording, names: tuple[str, ...]) -> Self:
        blocks: list[Samples] = [block for block in recording.blocks() if len(block)]
        columns = {}
        for name in names:
            pieces = [getattr(block, name) for block in blocks]
            if not blocks or any(piece is None for piece in pieces) or not np.isfinite(np.concatenate(pieces)).any():
                raise InputError(
                    f"{recording.source} has no {name}: record it beside the readings, or leave --with {name} out"
                )
            columns[name] = np.concatenate(pieces)
        times = [block.time for block in blocks]
        time = None if any(each is None for each in times) else np.concatenate([t for t in times if t is not None])
        return cls(np.concatenate([block.field for block in blocks]), time, columns)

    def lagged(self, name: str, lag_s: float) -> Floats:
        return lagged(self.columns[name], self.time, lag_s)[:: self.stride]


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """What is to be solved: readings, drivers with their lags, and the prior."""

    logged: _Logged
    names: tuple[str, ...]
    spread: float
    lags: dict[str, float]

    @property
    def references(self) -> Floats:
        """(K,) where the offset holds: no current, no throttle, the middle of the temperatures."""
        return np.array(
            [
                round(float(np.median(self.logged.values[name])), 1) if name == "temperature" else 0.0
                for name in self.names
            ]
        )

    @property
    def departures(self) -> Floats:
        """(N, K) values of the drivers less their references."""
        if not self.names:
            return np.zeros((len(self.logged.field), 0))
        rows = [self.logged.lagged(name, self.lags.get(name, 0.0)) for name in self.names]
        return np.stack(rows, axis=1) - self.references

    @property
    def warm(self) -> int | None:
        """Which driver is the temperature."""
        return self.names.index("temperature") if "temperature" in self.names else None


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """A solution: the ellipsoid, P and a, and what was found there."""

    ellipsoid: Ellipsoid
    driven: Floats
    distances: Floats
    jacobian: Floats
    used: NDArray[np.bool_]

    @property
    def noise(self) -> float:
        """Standard deviation of the distances of the readings that were used."""
        used = self.distances[self.used]
        return float(np.sqrt(used @ used / max(len(used) - self.jacobian.shape[1], 1)))


def _settle(problem: _Problem, start: _Solved | None = None) -> _Solved:
    """Solve from each of a few starts, robustly at first, and keep the best."""
    solver = _Solver.of(problem)
    if start is None:
        fewer = solver.thinned(ROUGHLY)
        roughly = [fewer.iterated(*one, None) for one in fewer.starts()]
        start = min(roughly, key=lambda one: _spread(one.distances))
    best = solver.at(start.ellipsoid, start.driven)
    used = _near(best.distances)
    for _ in range(3):
        best = solver.iterated(best.ellipsoid, best.driven, used)
        again = _near(best.distances)
        if np.array_equal(again, used):
            break
        used = again
    return replace(best, used=used)


@dataclass(frozen=True, slots=True, eq=False)
class _Solver:
    """Damped Gauss–Newton on (b, S, P, a)."""

    field: Floats
    departures: Floats
    warmth: Floats | None
    spread: float

    @classmethod
    def of(cls, problem: _Problem) -> Self:
        departures = problem.departures
        warm = problem.warm
        return cls(problem.logged.field, departures, None if warm is None else departures[:, warm], problem.spread)

    def thinned(self, most: int) -> _Solver:
        """The same on fewer readings, spread evenly over all."""
        stride = -(-len(self.field) // most)
        warmth = None if self.warmth is None else self.warmth[::stride]
        return _Solver(self.field[::stride], self.departures[::stride], warmth, self.spread)

    @property
    def count(self) -> int:
        """Of P and a."""
        return 3 * int(self.departures.shape[1]) + (self.warmth is not None)

    def starts(self) -> list[tuple[Ellipsoid, Floats]]:
        """Spheres about the readings: as they are, and with what sudden changes of the drivers make taken off."""
        driven: list[Floats] = [np.zeros(self.count)]
        if self.count:
            driven.append(self._by_steps())
        return [(_sphere(self._settled(driven_by, np.zeros(3))), driven_by) for driven_by in driven]

    def _by_steps(self) -> Floats:
        """(K,) P from steps between neighbours: where a driver jumps, the attitude has hardly changed."""
        wide = max(1, len(self.field) // 2000)
        steps, moved = (values[wide:] - values[:-wide] for values in (self.departures, self.field))
        shifts = np.linalg.lstsq(steps, moved, rcond=None)[0].ravel()
        return np.append(shifts, np.zeros(self.count - len(shifts)))

    def _settled(self, driven: Floats, centre: Floats) -> Floats:
        """(N, 3) readings without what drives them."""
        places = self.departures.shape[1]
        settled = self.field - self.departures @ driven[: 3 * places].reshape(places, 3)
        if self.warmth is None:
            return settled
        grown: Floats = centre + (settled - centre) / np.maximum(1.0 + driven[-1] * self.warmth, 0.1)[:, np.newaxis]
        return grown

    def at(self, ellipsoid: Ellipsoid, driven: Floats) -> _Solved:
        """Distances and their Jacobian."""
        settled = self._settled(driven, ellipsoid.centre)
        directions = directions_of(settled, ellipsoid)
        jacobian = np.column_stack(
            [
                magnitude.information(directions, ellipsoid),
                term.columns(directions, ellipsoid, self.departures, self.warmth),
            ]
        )
        return _Solved(
            ellipsoid, driven, magnitude.distances(settled, ellipsoid), jacobian, np.ones(len(settled), bool)
        )

    def iterated(self, ellipsoid: Ellipsoid, driven: Floats, used: NDArray[np.bool_] | None) -> _Solved:
        """Steps until they vanish; `used` None for Cauchy weights that are renewed at each."""
        now, damping = self.at(ellipsoid, driven), 1e-3
        for _ in range(STEPS):
            size = max(_spread(now.distances if used is None else now.distances[used]), 1e-9 * now.ellipsoid.radius)
            weights = 1.0 / (1.0 + (now.distances / (CAUCHY * size)) ** 2) if used is None else used.astype(float)
            matrix, gradient = self._equations(now, weights / size**2)
            cost = self._cost(now, used, size)
            while damping < LOST:
                step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)
                tried = self._moved(now, step)
                if tried is not None and self._cost(tried, used, size) <= cost + NO_WORSE:
                    break
                damping *= 5.0
            else:
                return now
            now, damping = tried, max(damping / 10.0, 1e-10)
            if np.abs(step[:9]).max() < SETTLED * now.ellipsoid.radius:
                return now
        return now

    def _equations(self, now: _Solved, weights: Floats) -> tuple[Floats, Floats]:
        """Normal matrix and gradient, with the prior."""
        weighted = now.jacobian * weights[:, np.newaxis]
        matrix, gradient = weighted.T @ now.jacobian, weighted.T @ now.distances
        believed = prior.equations(now.ellipsoid, spread=self.spread)
        matrix[:9, :9] += believed.matrix
        gradient[:9] += believed.gradient
        precision = self._precision(now.ellipsoid.radius)
        matrix[9:, 9:] += np.diag(precision)
        gradient[9:] -= precision * now.driven
        return matrix, gradient

    def _precision(self, radius: float) -> Floats:
        """(K,) of what is thought likely of P and a."""
        ranges = np.maximum(np.abs(self.departures).max(axis=0, initial=0.0), np.finfo(float).tiny)
        precision = np.repeat((ranges / (WEAK * radius)) ** 2, 3)
        return precision if self.warmth is None else np.append(precision, 1.0 / GROWTH**2)

    def _cost(self, now: _Solved, used: NDArray[np.bool_] | None, size: float) -> float:
        """What is minimised."""
        believed = prior.equations(now.ellipsoid, spread=self.spread).cost
        believed += float(self._precision(now.ellipsoid.radius) @ now.driven**2)
        scaled = (now.distances if used is None else now.distances[used]) / size
        if used is None:
            return float(CAUCHY**2 * np.log1p((scaled / CAUCHY) ** 2).sum()) + believed
        return float(scaled @ scaled) + believed

    def _moved(self, now: _Solved, step: Floats) -> _Solved | None:
        """Take a step, unless it opens the surface."""
        shape = now.ellipsoid.shape + symmetric(step[3:9])
        if np.linalg.eigvalsh(shape)[0] <= 1e-3 * now.ellipsoid.radius:
            return None
        return self.at(Ellipsoid(now.ellipsoid.centre + step[:3], shape), now.driven + step[9:])


def _lags(
    logged: _Logged, names: tuple[str, ...], spread: float
) -> tuple[dict[str, float], dict[str, float], _Solved | None]:
    """The lag of each motor-like driver, and its standard deviation, by a profile on a grid and a parabola there."""
    lags: dict[str, float] = {}
    sigmas: dict[str, float] = {}
    if not logged.is_timed:
        return lags, sigmas, None
    solved: _Solved | None = None
    for name in names:
        if name == "temperature":  # follows in minutes
            continue
        solved = _settle(_Problem(logged, names, spread, lags), solved)
        lag, sigma, saved = _profile(logged, names, name, spread, lags, solved)
        sigmas[name] = sigma
        if saved > PROVEN:
            lags[name] = lag
    return lags, sigmas, solved


def _profile(
    logged: _Logged, names: tuple[str, ...], name: str, spread: float, lags: dict[str, float], solved: _Solved
) -> tuple[float, float, float]:
    """The lag that leaves least, its standard deviation, and the χ² that it saves."""
    noise = solved.noise * np.sqrt(time_of(_residuals(solved).autocovariance()))
    step = max(SEARCHED_S / LAGS, logged.step_s / 2.0)
    grid = np.arange(-LAGS, LAGS + 1) * step
    costs = np.array([_linear_cost(logged, names, spread, {**lags, name: lag}, solved) for lag in grid]) / noise**2
    place = int(np.clip(np.argmin(costs), 1, len(grid) - 2))
    best, width = float(grid[place]), np.inf
    for _ in range(2):  # finer about the best
        low, middle, high = costs[place - 1 : place + 2]
        bend = low - 2.0 * middle + high
        if bend <= 0.0:
            break
        best = grid[place] + 0.5 * (low - high) / bend * (grid[1] - grid[0])
        width = float(np.sqrt(2.0 / bend) * (grid[1] - grid[0]))
        grid = best + np.array([-1.0, 0.0, 1.0]) * max(min(width, grid[1] - grid[0]), 1e-3)
        costs = np.array([_linear_cost(logged, names, spread, {**lags, name: lag}, solved) for lag in grid]) / noise**2
        place = 1
    without = _linear_cost(logged, names, spread, {**lags, name: 0.0}, solved) / noise**2
    return float(best), width, float(without - costs.min())


def _linear_cost(
    logged: _Logged, names: tuple[str, ...], spread: float, lags: dict[str, float], solved: _Solved
) -> float:
    """Σ s² that is left for other lags, the surface as it is and all parameters free to first order.

    Distances with what the drivers take off put back, s + J_P P, by least squares on the columns of the other lags.
    """
    used, places = solved.used, 3 * len(names)
    normals = solved.jacobian[used, :3]
    departures = _Problem(logged, names, spread, lags).departures[used]
    moved = (departures[:, :, np.newaxis] * normals[:, np.newaxis]).reshape(len(normals), -1)
    target = solved.distances[used] + solved.jacobian[used, 9 : 9 + places] @ solved.driven[:places]
    design = np.column_stack([solved.jacobian[used, :9], moved])
    gradient = design.T @ target
    return float(target @ target - gradient @ np.linalg.lstsq(design.T @ design, gradient, rcond=1e-12)[0])


def _residuals(solved: _Solved) -> Residuals:
    """What is left at the readings that were used, in the order of recording."""
    used = solved.used
    return Residuals(solved.distances[used], solved.jacobian[used], [np.arange(int(used.sum()))])


def _told(
    problem: _Problem, solved: _Solved, sigmas: dict[str, float], without: _Solved, constant: tuple[str, ...]
) -> Driving:
    """Put together what was found, with the covariance that the residuals allow."""
    solver = _Solver.of(problem)
    matrix, _ = solver._equations(solved, solved.used / solved.noise**2)
    inverse = _inverse(matrix)
    residuals = _residuals(solved)
    scatter = residuals.scatter(residuals.autocovariance()) / solved.noise**4
    believed, _ = solver._equations(solved, np.zeros(len(solved.distances)))
    covariance = inverse @ (scatter + believed) @ inverse
    carried = -_inverse(matrix[:9, :9]) @ matrix[:9, 9:]
    return Driving(
        _drivers(problem, solved),
        covariance[9:, 9:],
        carried,
        solved.ellipsoid,
        solved.noise,
        _noise_on(without, solved.used),
        tuple(_found(problem, solved, matrix, name, sigmas.get(name, np.nan)) for name in problem.names),
        constant,
    )


def _drivers(problem: _Problem, solved: _Solved) -> tuple[Driver, ...]:
    """The drivers that a solution stands for."""
    return tuple(
        Driver(
            name,
            solved.driven[3 * place : 3 * place + 3],
            float(reference),
            *_range(problem.logged.values[name]),
            problem.lags.get(name, 0.0),
            float(solved.driven[-1]) if name == "temperature" else 0.0,
        )
        for place, (name, reference) in enumerate(zip(problem.names, problem.references, strict=True))
    )


def _found(problem: _Problem, solved: _Solved, matrix: Floats, name: str, lag_sigma: float) -> Found:
    """What there is to say of one driver."""
    place = problem.names.index(name)
    rows = slice(9 + 3 * place, 12 + 3 * place)
    values = problem.departures[:, place]
    driven = solved.jacobian[:, :3] * (values - values[solved.used].mean())[:, np.newaxis]
    others = np.delete(solved.jacobian, np.arange(rows.start, rows.stop), axis=1)
    shared = term.shared(others[solved.used], driven[solved.used])
    per_unit = solved.driven[3 * place : 3 * place + 3]
    return Found(name, shared, lag_sigma, float(per_unit @ np.linalg.solve(_inverse(matrix)[rows, rows], per_unit)))


def _noise_on(solved: _Solved, used: NDArray[np.bool_]) -> float:
    """Root mean square distance over readings that another solution used."""
    return float(np.sqrt(np.mean(solved.distances[used] ** 2)))


def _inverse(matrix: Floats) -> Floats:
    """Inverse of a positive definite matrix whose entries have different units."""
    scale = np.sqrt(np.diag(matrix))
    inverse: Floats = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    return inverse


def _sphere(readings: Floats) -> Ellipsoid:
    """The sphere of the median reading and the median distance from it."""
    middle = np.median(readings, axis=0)
    about = readings - middle
    design = np.column_stack([2.0 * about, np.ones(len(about))])
    found = np.linalg.lstsq(design, np.einsum("ij,ij->i", about, about), rcond=None)[0]
    distances = np.linalg.norm(about - found[:3], axis=1)
    return Ellipsoid(middle + found[:3], max(float(np.median(distances)), 1e-12) * np.eye(3))


def _spread(distances: Floats) -> float:
    """Robust standard deviation about zero."""
    return 1.4826 * float(np.median(np.abs(distances)))


def _near(distances: Floats) -> NDArray[np.bool_]:
    """Which readings belong to the surface."""
    size = np.abs(distances)
    limit = max(FAR * _spread(distances), float(np.quantile(size, FEWEST_KEPT)))
    near: NDArray[np.bool_] = size <= max(limit, np.finfo(float).tiny)
    return near


def _range(values: Floats) -> tuple[float, float]:
    """Lowest and highest value."""
    return float(np.nanmin(values)), float(np.nanmax(values))


def _changes(name: str, values: Floats) -> bool:
    """Whether a driver changed enough for anything to be told of it."""
    low, high = np.nanquantile(values, [0.02, 0.98])
    return bool(high - low > known(name).least)


def following(source: object, names: Sequence[str], *, spread: float | None) -> tuple[Driving, Recording]:
    """Find what drives a recording, and settle it: what is left is fitted like any other.

    Raises
    ------
    UsageError
        For what is no recording, or a driver that is not known.
    NotTurned
        Where the sensor was still: `still` finds its drivers, and nothing finds an ellipsoid.
    InputError, TooFewSamples
        As `driving_of`.
    """
    if not hasattr(source, "blocks"):
        raise UsageError(f"to follow {' and '.join(names)} needs a recording with that column: give Samples")
    recording = cast("Recording", source)
    parts = list(singles(recording))
    unturned = still(parts, names)
    if unturned is not None:
        raise NotTurned(unturned.noise, " and ".join(names))
    driving = driving_of(parts, names, spread=spread)
    return driving, settled(recording, driving.calibration)


def told(fitted: Fit, driving: Driving) -> Fit:
    """A fit to settled readings, with what is known of its drivers."""
    calibration = replace(fitted.calibration, drivers=driving.drivers)
    dip, down = fitted.heading_error_deg.dip_deg, down_of(fitted.plane)
    driven = [
        Driven(
            driver.name,
            driver,
            taken_deg=calibration.driven_deg(driver, dip_deg=dip),
            left_deg=driving.left(fitted.ellipsoid, place, dip_deg=dip, down=down).worst,
            shared=found.shared,
            chi_square=found.chi_square,
            lag_sigma_s=found.lag_sigma_s,
        )
        for place, (driver, found) in enumerate(zip(driving.drivers, driving.found, strict=True))
    ]
    constant = [Driven(name) for name in driving.constant]
    return replace(
        fitted,
        calibration=calibration,
        driven=(*driven, *constant),
        drivers_covariance=driving.joint(fitted.covariance),
        noise_undriven=driving.noise_without,
    )


# a sensor that is not turned

UNMOVED: Final = 0.03
"""Of the length of the mean reading: what is left of a recording of a still sensor, once its drivers are taken off."""

SHARES: Final = 0.9
"""Of the scatter of a recording that a driver has to explain for its sensor to have been still."""


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """What drivers do to the readings of a sensor that is not turned.

    Attributes
    ----------
    drivers : tuple of Driver
        Without a gain: a sensor that is not turned does not tell scale from offset.
    covariance : (K, K) float
        Of (P₁, P₂, …).
    noise : float
        Standard deviation of what is left of an axis, in the unit of the readings.
    moved : float
        Standard deviation of what the drivers make, all axes together, in that unit.
    constant : tuple of str
        Drivers that hardly changed.
    """

    drivers: tuple[Driver, ...]
    covariance: Floats
    noise: float
    moved: float
    constant: tuple[str, ...] = ()

    def onto(self, calibration: Calibration) -> Calibration:
        """A calibration of the same sensor, made without these drivers, that follows them; others it keeps."""
        names = {driver.name for driver in self.drivers}
        kept = tuple(driver for driver in calibration.drivers if driver.name not in names)
        return replace(calibration, drivers=(*kept, *self.drivers))


def still(recordings: Sequence[Recording], names: Sequence[str]) -> Still | None:
    """Find the offset that drivers make where the sensor was not turned; None where it was.

    The readings are a straight line in the drivers, x = x₀ + Σ P c(t − lag), by least squares. What is left tells
    whether the sensor was still: a turn leaves much more than noise.

    Raises
    ------
    UsageError, InputError, TooFewSamples
        As `driving_of`.

    Examples
    --------
    >>> from flinders.samples import Samples
    >>> rng = np.random.default_rng(1)
    >>> current = np.linspace(0.0, 20.0, 400)
    >>> field = [20.0, -5.0, 43.0] + np.outer(current, [0.5, 0.0, -0.3]) + rng.normal(scale=0.2, size=(400, 3))
    >>> found = still([Samples.of(field, unit="uT", current=current)], ["current"])
    >>> found.drivers[0].per_unit.round(2) + 0.0, round(found.noise, 1)
    (array([ 0.5,  0. , -0.3]), 0.2)
    """
    logged = _Logged.of(recordings, tuple(dict.fromkeys(names)))
    moving, constant = logged.split()
    lags = _still_lags(logged, moving)
    problem = _Problem(logged, moving, prior.SPREAD, lags)
    left, shifts, design = _line(logged.field, problem.departures)
    freedom = max(len(left) - design.shape[1], 1)
    noise = float(np.sqrt(np.sum(left**2) / (3.0 * freedom)))
    length = float(np.linalg.norm(logged.field.mean(axis=0)))
    scatter = float(np.sqrt(np.mean(np.var(logged.field, axis=0))))
    if noise > UNMOVED * length or not (scatter <= UNMOVED * length or noise**2 < (1.0 - SHARES) * scatter**2):
        return None
    made = problem.departures @ shifts
    drivers = tuple(
        Driver(name, shifts[place], float(reference), *_range(logged.values[name]), lags.get(name, 0.0))
        for place, (name, reference) in enumerate(zip(moving, problem.references, strict=True))
    )
    return Still(drivers, _line_covariance(left, design), noise, float(np.sqrt(np.var(made, axis=0).sum())), constant)


def _line(field: Floats, departures: Floats) -> tuple[Floats, Floats, Floats]:
    """What a straight line in the drivers leaves (N, 3), its slopes (K, 3), and its design (N, K + 1)."""
    design = np.column_stack([departures, np.ones(len(field))])
    found = np.linalg.lstsq(design, field, rcond=None)[0]
    return field - design @ found, found[:-1], design


def _line_covariance(left: Floats, design: Floats) -> Floats:
    """(3 K, 3 K) of the slopes, each driver's three together; residuals that hang together count for fewer."""
    count = design.shape[1] - 1
    inverse = _inverse(design.T @ design)
    blocks = np.zeros((count, 3, count, 3))
    rows = [np.arange(len(left))]
    for axis in range(3):
        residuals = Residuals(left[:, axis], design, rows)
        covariance = inverse @ residuals.scatter(residuals.autocovariance()) @ inverse
        blocks[:, axis, :, axis] = covariance[:count, :count]
    return blocks.reshape(3 * count, 3 * count)


def _still_lags(logged: _Logged, names: tuple[str, ...]) -> dict[str, float]:
    """The lag of each driver but the temperature, where one leaves clearly less than none."""
    lags: dict[str, float] = {}
    if not logged.is_timed:
        return lags
    grid = np.arange(-LAGS, LAGS + 1) * max(SEARCHED_S / LAGS, logged.step_s / 2.0)
    for name in names:
        if name == "temperature":
            continue
        costs = np.array(
            [
                np.sum(
                    _line(logged.field, _Problem(logged, names, prior.SPREAD, {**lags, name: lag}).departures)[0] ** 2
                )
                for lag in grid
            ]
        )
        best = int(np.argmin(costs))
        variance = costs[best] / (3.0 * len(logged.field))
        if (costs[LAGS] - costs[best]) / max(variance, 1e-300) > PROVEN:
            lags[name] = float(grid[best])
    return lags


def described(still_found: Still, unit: str) -> str:
    """Say that the sensor was not turned, and what that means."""
    names = " and ".join(driver.name for driver in still_found.drivers)
    return (
        f"the sensor was not turned in this recording: {names} moved its readings by "
        f"{still_found.moved:.3g} {unit} (rms), and {still_found.noise:.2g} {unit} of noise was left in each axis; "
        f"this gives {counted(len(still_found.drivers), 'driver')}, and no offset or matrix"
    )
