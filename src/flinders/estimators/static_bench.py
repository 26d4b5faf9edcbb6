"""What drives the offset of a sensor that is not turned, as where a motor is run up on a bench.

The readings are a straight line in the disturbances,

    x = x₀ + Σ P (c(t − lag) − reference) + noise

by least squares, axis by axis. It tells neither offset nor matrix: what it finds goes `onto` a calibration that was
made without the motor.

When to use it: the sensor lies still, and the disturbance goes up **and down** again, several times. Not where it is
switched on once: a sensor that moved meanwhile would look the same, and `findings` says so. A sensor that moves *with*
the disturbance, as one that the motor lifts, leaves nothing in the readings; an accelerometer beside it shows its tilt.

Source: CompassMot of ArduPilot, by regression in place of its filter.

>>> from flinders.core.samples import Samples
>>> rng = np.random.default_rng(1)
>>> current = 10.0 - 10.0 * np.cos(np.linspace(0.0, 20.0, 400))
>>> field = [20.0, -5.0, 43.0] + np.outer(current, [0.5, 0.0, -0.3]) + rng.normal(scale=0.2, size=(400, 3))
>>> bench = still([Samples.of(field, unit="uT", current=current)], ["current"])
>>> bench.disturbances[0].per_unit.round(2) + 0.0, round(bench.noise, 1), bench.findings
(array([ 0.5,  0. , -0.3]), 0.2, ())
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import Disturbance
from flinders.errors import counted
from flinders.estimators.covariance import Residuals
from flinders.estimators.disturbance_problem import WEAK
from flinders.estimators.regressor_quality import (
    RegressorError,
    attenuation,
    collinearity,
    curvature,
    monotonicity,
    noise_of,
    rounding,
    widened,
)
from flinders.estimators.regressors import DisturbanceEstimate, Logged
from flinders.estimators.time_delay import Shifted, grid_of, lagging, profile, proven_lags, scattered
from flinders.findings import Finding, found_in
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.estimators.time_delay import Lag

UNMOVED: Final = 0.03
"""Of the length of the mean reading: residual of a still sensor once its disturbances are subtracted."""

SHARES: Final = 0.9
"""Of the scatter of a recording that a disturbance has to explain for its sensor to have been still."""

PROVEN: Final = 4.0
"""Standard deviations from which on a turn of the vertical is one."""

STEPPED: Final = 0.25
"""Share of what is left that one step explains, from which on it is one."""


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """What disturbances do to the readings of a sensor that is not turned."""

    #: without a gain: a sensor that is not turned does not tell scale from offset
    disturbances: tuple[Disturbance, ...]
    covariance: Floats  #: (K, K): of (P₁, P₂, …)
    noise: float  #: standard deviation of what is left of an axis, in the unit of the readings
    moved: float  #: standard deviation of what the disturbances make, all axes together, in that unit
    constant: tuple[str, ...] = ()  #: disturbances that hardly changed
    #: what is known of each disturbance beside its numbers
    estimates: tuple[DisturbanceEstimate, ...] = field(default=())
    #: the largest step in what is left, in the unit of the readings, where one explains a quarter of it; else 0
    step: float = 0.0
    #: by how much the vertical turns over the range of a disturbance, as an accelerometer shows; 0 where there is none,
    #: or where it may be its noise
    tilted_deg: float = 0.0

    def with_states(self, states: Mapping[str, tuple[str, ...]]) -> Still:
        """The same with the words of columns of states, by name."""
        disturbances = tuple(one.with_states(states.get(one.name, ())) for one in self.disturbances)
        estimates = zip(self.estimates, disturbances, strict=True)
        worded = tuple(replace(estimate, disturbance=one) for estimate, one in estimates)
        return replace(self, disturbances=disturbances, estimates=worded)

    def onto(self, calibration: Calibration) -> Calibration:
        """A calibration of the same sensor, made without these disturbances, that follows them; others it keeps."""
        names = {disturbance.name for disturbance in self.disturbances}
        proven_lags = tuple(disturbance for disturbance in calibration.disturbances if disturbance.name not in names)
        return replace(calibration, disturbances=(*proven_lags, *self.disturbances))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What speaks against this bench: a sensor that moved, once or along with a disturbance."""
        record = {"step": self.step, "noise": self.noise, "tilted_deg": self.tilted_deg}
        return tuple(found_in(record, "bench-moved", "bench-tilted"))


def still(recordings: Sequence[Recording], names: Sequence[str]) -> Still | None:
    """Find the offset that disturbances make where the sensor was not turned; None where it was.

    What is left tells whether the sensor was still: a turn leaves much more than noise.

    Raises `UsageError`, `InputError` or `TooFewSamples` as `flinders.estimators.disturbance.fit_disturbances`.

    Parameters
    ----------
    names : sequence of str
        ``current``, ``throttle``, ``temperature``.
    """
    logged = Logged.of(recordings, tuple(names))
    moving, constant = logged.split()
    lags = _lags(logged, moving)
    seconds = proven_lags(lags)
    departures = logged.departures(moving, seconds)
    left, _, design = _line(logged.field, departures)
    noise = float(np.sqrt(np.sum(left**2) / (3.0 * max(len(left) - design.shape[1], 1))))
    if not _is_still(logged.field, min(noise, _quiet(logged, moving))):
        return None
    believed = noise**2 * _precision(logged.field, departures)
    shifts = np.linalg.solve(design.T @ design + believed, design.T @ logged.field)[:-1]
    left = logged.field - logged.field.mean(axis=0) - (departures - departures.mean(axis=0)) @ shifts
    disturbances = tuple(
        Disturbance(name, shifts[place], logged.reference(name), *logged.range(name), seconds.get(name, 0.0))
        for place, name in enumerate(moving)
    )
    made = float(np.sqrt(np.var(departures @ shifts, axis=0).sum()))
    estimates = tuple(
        _estimate(disturbance, place, departures, left, lags) for place, disturbance in enumerate(disturbances)
    )
    covariance = _metered(logged, departures, left, disturbances, _covariance(left, design, believed))
    tilted = _tilted_deg(_felt(recordings, logged), departures)
    return Still(disturbances, covariance, noise, made, constant, estimates, _step(left), tilted)


def described(still: Still, unit: str) -> str:
    """Say that the sensor was not turned, and what that means."""
    names = " and ".join(disturbance.name for disturbance in still.disturbances)
    return (
        f"the sensor was not turned in this recording: {names} moved its readings by "
        f"{still.moved:.3g} {unit} (rms), and {still.noise:.2g} {unit} of noise was left in each axis; "
        f"this gives {counted(len(still.disturbances), 'disturbance')}, and no offset or matrix"
    )


def _is_still(readings: Floats, noise: float) -> bool:
    """What is left is noise, and the readings were either hardly scattered or scattered by the disturbances."""
    length = float(np.linalg.norm(readings.mean(axis=0)))
    scatter = float(np.sqrt(np.mean(np.var(readings, axis=0))))
    if noise > UNMOVED * length:
        return False
    return scatter <= UNMOVED * length or noise**2 < (1.0 - SHARES) * scatter**2


def _quiet(logged: Logged, names: tuple[str, ...]) -> float:
    """What a line in smoothed columns leaves of an axis, 1 σ, where there are times: a noisy meter is no turn."""
    if not (names and logged.is_timed):
        return np.inf
    left, _, design = _line(logged.field, Shifted(logged, names, (), {})(0.0))
    return float(np.sqrt(np.sum(left**2) / (3.0 * max(len(left) - design.shape[1], 1))))


def _line(readings: Floats, departures: Floats) -> tuple[Floats, Floats, Floats]:
    """What a straight line in the disturbances leaves (N, 3), its slopes (K, 3), and its design (N, K + 1)."""
    design = np.column_stack([departures, np.ones(len(readings))])
    solution = np.linalg.lstsq(design, readings, rcond=None)[0]
    return readings - design @ solution, solution[:-1], design


def _precision(readings: Floats, departures: Floats) -> Floats:
    """(K + 1, K + 1) of what is thought likely of the slopes: what disturbances make is no longer than the readings."""
    length = max(float(np.linalg.norm(readings.mean(axis=0))), np.finfo(float).tiny)
    return np.diag(np.append((np.abs(departures).max(axis=0, initial=0.0) / (WEAK * length)) ** 2, 0.0))


def _covariance(left: Floats, design: Floats, believed: Floats | None = None) -> Floats:
    """(3 K, 3 K) of the slopes, each disturbance's three together; correlated residuals count for fewer.

    `believed` (K + 1, K + 1) is what was thought likely before, in the variance of the noise: it alone speaks of what
    disturbances that rise and fall together do one by one.
    """
    count = design.shape[1] - 1
    before = np.zeros((count + 1, count + 1)) if believed is None else believed
    inverse = NormalEquations(design.T @ design + before, np.zeros(count + 1), 0.0, len(left)).inverse()
    noise = float(np.mean(left**2))
    blocks = np.zeros((count, 3, count, 3))
    rows = [np.arange(len(left))]
    for axis in range(3):
        residuals = Residuals(left[:, axis], design, rows)
        covariance = inverse @ (residuals.scatter(residuals.autocovariance()) + noise * before) @ inverse
        blocks[:, axis, :, axis] = covariance[:count, :count]
    return blocks.reshape(3 * count, 3 * count)


def _metered(
    logged: Logged, departures: Floats, left: Floats, disturbances: Sequence[Disturbance], covariance: Floats
) -> Floats:
    """(3 K, 3 K) covariance of the slopes with what the noise of meters adds to it."""
    about = departures - departures.mean(axis=0)
    inverse = np.kron(np.linalg.pinv(about.T @ about, hermitian=True), np.eye(3))
    meters = [
        RegressorError(
            noise_of(departures[:, place], *_along(disturbance, left)),
            rounding(logged.values[disturbance.name], disturbance.name)[0],
            np.sqrt(len(left)) * np.eye(3 * len(disturbances))[:, 3 * place : 3 * place + 3],
        )
        for place, disturbance in enumerate(disturbances)
    ]
    coefficients = np.concatenate([np.zeros(0), *(disturbance.per_unit for disturbance in disturbances)])
    return widened(covariance, inverse, coefficients, meters)


def _along(disturbance: Disturbance, left: Floats) -> tuple[Floats, Floats]:
    """(N,) what is left along what a disturbance makes, and by how much that moves with one unit of it."""
    size = float(np.linalg.norm(disturbance.per_unit))
    along = left @ disturbance.per_unit / size if size > 0.0 else np.zeros(len(left))
    return along, np.full(len(left), size)


def _lags(logged: Logged, names: tuple[str, ...]) -> dict[str, Lag]:
    """The best lag of each motor."""
    lags: dict[str, Lag] = {}
    for late in lagging(names) if logged.is_timed else ():
        cost = _LineCost(logged, Shifted(logged, names, late, proven_lags(lags)))
        lag = cost.scattered(profile(late[0], cost, grid_of(logged.step_s)))
        lags |= {name: replace(lag, name=name) for name in late}
    return lags


class _LineCost:
    """χ² that a straight line leaves, in the variance that the best lag leaves."""

    def __init__(self, logged: Logged, shifted: Shifted) -> None:
        self._field, self._shifted = logged.field, shifted
        least = min(float(np.sum(self._left(lag) ** 2)) for lag in grid_of(logged.step_s))
        self._variance = max(least / (3.0 * len(logged.field)), 1e-300)

    def __call__(self, lag_s: float) -> float:
        """χ² at a lag in s."""
        return float(np.sum(self._left(lag_s) ** 2)) / self._variance

    def scattered(self, lag: Lag) -> Lag:
        """The same lag with the standard deviation that what it leaves allows."""
        left, slopes, design = _line(self._field, self._shifted(lag.seconds))
        moved = self._shifted.slope(lag.seconds) @ slopes
        moved -= design @ np.linalg.lstsq(design, moved, rcond=None)[0]
        return scattered(lag, left.T, moved.T, self._variance)

    def _left(self, lag_s: float) -> Floats:
        """(N, 3) what a line leaves."""
        return _line(self._field, self._shifted(lag_s))[0]


def _estimate(
    disturbance: Disturbance, place: int, disturbances: Floats, left: Floats, lags: dict[str, Lag]
) -> DisturbanceEstimate:
    """What is known of one of the disturbances beside its numbers."""
    departures, design = disturbances[:, place], np.column_stack([disturbances, np.ones(len(left))])
    lag = lags.get(disturbance.name)
    return DisturbanceEstimate(
        disturbance.name,
        disturbance,
        monotonicity=monotonicity(departures),
        attenuation=attenuation(departures, *_along(disturbance, left)),
        lag_sigma_s=np.nan if lag is None else lag.used_sigma_s,
        is_lag_at_limit=lag is not None and lag.is_beyond,
        curvature=_curvature(disturbance, departures, left, design),
        collinearity=collinearity(departures, np.delete(disturbances, place, axis=1)),
    )


def _curvature(disturbance: Disturbance, departures: Floats, left: Floats, design: Floats) -> float:
    """How far all axes together are off a straight line, as a share of what the disturbance makes."""
    count = len(left)
    rows = [np.arange(axis * count, (axis + 1) * count) for axis in range(3)]
    residuals = Residuals(left.T.ravel(), np.kron(np.eye(3), design), rows)
    return curvature(np.tile(departures, 3), residuals, np.repeat(np.eye(3), count, axis=0), disturbance.per_unit)


def _felt(recordings: Sequence[Recording], logged: Logged) -> Floats | None:
    """(N, 3) what an accelerometer felt at the readings that are looked at; None where one has none."""
    felt: list[Floats] = []
    for recording, part in zip(recordings, logged.parts, strict=True):
        pieces = [block.acceleration for block in recording.blocks() if len(block)]
        given = [piece for piece in pieces if piece is not None]
        if len(given) < len(pieces):
            return None
        felt.append(np.concatenate(given)[:: part.stride])
    return np.concatenate(felt)


def _tilted_deg(felt: Floats | None, departures: Floats) -> float:
    """By how much the vertical turns over the range of the disturbance that turns it most; 0 where that may be noise.

    >>> current = np.tile(np.linspace(0.0, 20.0, 50), 4)
    >>> leaning = np.radians(0.1 * current)
    >>> felt = 9.8 * np.stack([np.sin(leaning), 0.0 * leaning, -np.cos(leaning)], axis=1)
    >>> round(_tilted_deg(felt, current[:, np.newaxis]), 1)
    2.0
    """
    if felt is None or not departures.shape[1]:
        return 0.0
    finite = np.isfinite(felt).all(axis=1)
    gravity = float(np.linalg.norm(felt[finite].mean(axis=0))) if finite.sum() > departures.shape[1] + 1 else 0.0
    if not gravity > 0.0:
        return 0.0
    unit = felt[finite] / gravity
    left, slopes, design = _line(unit, departures[finite])
    vertical = unit.mean(axis=0)
    level = np.eye(3) - np.outer(vertical, vertical)
    covariance, most = _covariance(left, design), 0.0
    for place, slope in enumerate(slopes):
        block = covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
        turned, sigma = np.linalg.norm(level @ slope), np.sqrt(np.linalg.eigvalsh(block)[-1].clip(0.0))
        if turned > PROVEN * sigma:
            most = max(most, float(turned * np.ptp(departures[:, place])))
    return float(np.degrees(np.arctan(most)))


def _step(left: Floats) -> float:
    """Size of the step that explains most of what is left; 0 where that is less than a quarter of it."""
    count = len(left)
    before = np.arange(1, count)[:, np.newaxis]
    sums = np.cumsum(left, axis=0)[:-1]
    gains = np.sum(sums**2, axis=1) * count / (before * (count - before))[:, 0]
    place = int(np.argmax(gains))
    share = float(gains[place]) / max(float(np.sum(left**2)), np.finfo(float).tiny)
    if share < STEPPED:
        return 0.0
    first, rest = left[: place + 1].mean(axis=0), left[place + 1 :].mean(axis=0)
    return float(np.linalg.norm(rest - first))
