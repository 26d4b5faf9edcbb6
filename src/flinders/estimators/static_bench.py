"""Disturbances of a sensor that is not turned, such as those of a motor on a bench.

The readings are a linear function of the disturbances,

    x = x₀ + Σ P (c(t − lag) − reference) + noise

estimated by least squares for each axis. A bench gives no offset or matrix; `StillSensor.add_to` adds the disturbances
to a calibration that was made without the motor.

When to use it: if the sensor is still, and the disturbance goes up **and down** several times. Do not use it if the
disturbance is switched on once: a motion of the sensor at the same time would have the same effect, and a finding warns
of it. If the sensor moves *with* the disturbance, such as when the motor lifts it, residuals do not show the motion,
but an accelerometer shows the tilt.

Source: CompassMot of ArduPilot, by regression instead of its filter.

>>> from flinders.core.samples import Samples
>>> rng = np.random.default_rng(1)
>>> current = 10.0 - 10.0 * np.cos(np.linspace(0.0, 20.0, 400))
>>> field = [20.0, -5.0, 43.0] + np.outer(current, [0.5, 0.0, -0.3]) + rng.normal(scale=0.2, size=(400, 3))
>>> bench = fit_still([Samples.of(field, unit="uT", current=current)], ["current"])
>>> bench.disturbances[0].per_unit.round(2) + 0.0, round(bench.noise, 1), bench.findings
(array([ 0.5,  0. , -0.3]), 0.2, ())
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import Disturbance
from flinders.errors import count_text
from flinders.estimators.covariance import Residuals
from flinders.estimators.disturbance_problem import EFFECT_SIGMA
from flinders.estimators.regressor_quality import (
    RegressorError,
    attenuation,
    collinearity,
    curvature,
    monotonicity,
    noise_of,
    rounding_variance,
    widen_covariance,
)
from flinders.estimators.regressors import DisturbanceEstimate, LoggedDisturbances
from flinders.estimators.time_delay import (
    ShiftedDepartures,
    lag_grid,
    lag_groups,
    search_lag,
    significant_lags,
    with_sigma,
)
from flinders.findings import Finding, findings_in
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.estimators.time_delay import Lag

MAX_STILL_RESIDUAL: Final = 0.03
"""Largest residual of a still sensor after compensation, relative to the length of the mean reading."""

MIN_EXPLAINED_SHARE: Final = 0.9
"""Smallest fraction of the variance that disturbances explain for a still sensor."""

MIN_TILT_SIGMAS: Final = 4.0
"""Smallest significant tilt of the vertical, in standard deviations."""

MIN_STEP_SHARE: Final = 0.25
"""Smallest fraction of the residual variance that a step explains if the sensor was moved once."""


@dataclass(frozen=True, slots=True, eq=False)
class StillSensor:
    """Disturbances of a sensor that is not turned."""

    #: disturbances without growth of the scale, which cannot be distinguished from the offset without turning
    disturbances: tuple[Disturbance, ...]
    covariance: Floats  #: (K, K): covariance of (P₁, P₂, …), three rows for each disturbance
    noise: float  #: standard deviation of the residuals of an axis, in the unit of the readings
    #: standard deviation over time of the effect of all disturbances, all axes together, in the unit of the readings
    moved: float
    constant: tuple[str, ...] = ()  #: disturbances that hardly changed, and were not estimated
    #: statistics of each disturbance
    estimates: tuple[DisturbanceEstimate, ...] = field(default=())
    #: size of a step in the residuals, in the unit of the readings, if it explains a quarter of their variance; else 0
    step: float = 0.0
    #: tilt of the vertical over the range of a disturbance, by an accelerometer; 0 without one, or if not significant
    tilted_deg: float = 0.0

    def with_states(self, states: Mapping[str, tuple[str, ...]]) -> StillSensor:
        """A copy in which columns of states have their two words, given by the name of the column."""
        disturbances = tuple(one.with_states(states.get(one.name, ())) for one in self.disturbances)
        estimates = zip(self.estimates, disturbances, strict=True)
        worded = tuple(replace(estimate, disturbance=one) for estimate, one in estimates)
        return replace(self, disturbances=disturbances, estimates=worded)

    def add_to(self, calibration: Calibration) -> Calibration:
        """Add these disturbances to a calibration of the same sensor; its other disturbances stay."""
        names = {disturbance.name for disturbance in self.disturbances}
        proven_lags = tuple(disturbance for disturbance in calibration.disturbances if disturbance.name not in names)
        return replace(calibration, disturbances=(*proven_lags, *self.disturbances))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about this bench: a sensor that moved, once or with a disturbance."""
        record = {"step": self.step, "noise": self.noise, "tilted_deg": self.tilted_deg}
        return tuple(findings_in(record, "bench-moved", "bench-tilted"))


def fit_still(recordings: Sequence[Recording], names: Sequence[str]) -> StillSensor | None:
    """Estimate the disturbances of a sensor that was not turned; None if it was turned.

    The residuals show whether the sensor was still: those of a turn are much larger than noise.

    Raises `UsageError`, `InputError` or `TooFewSamples` as `flinders.estimators.disturbance.fit_disturbances`.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings of one sensor.
    names : sequence of str
        ``current``, ``throttle``, ``temperature``, or other columns.
    """
    logged = LoggedDisturbances.of(recordings, tuple(names))
    moving, constant = logged.split()
    lags = _best_lags(logged, moving)
    seconds = significant_lags(lags)
    departures = logged.departures(moving, seconds)
    left, _, design = _regress(logged.field, departures)
    noise = float(np.sqrt(np.sum(left**2) / (3.0 * max(len(left) - design.shape[1], 1))))
    if not _is_still(logged.field, min(noise, _smoothed_residual(logged, moving))):
        return None
    believed = noise**2 * _prior_precision(logged.field, departures)
    shifts = np.linalg.solve(design.T @ design + believed, design.T @ logged.field)[:-1]
    left = logged.field - logged.field.mean(axis=0) - (departures - departures.mean(axis=0)) @ shifts
    disturbances = tuple(
        Disturbance(name, shifts[place], logged.reference(name), *logged.range(name), seconds.get(name, 0.0))
        for place, name in enumerate(moving)
    )
    made = float(np.sqrt(np.var(departures @ shifts, axis=0).sum()))
    estimates = tuple(
        _statistics(disturbance, place, departures, left, lags) for place, disturbance in enumerate(disturbances)
    )
    covariance = _add_meter_errors(logged, departures, left, disturbances, _covariance(left, design, believed))
    tilted = _tilted_deg(_accelerations(recordings, logged), departures)
    return StillSensor(disturbances, covariance, noise, made, constant, estimates, _largest_step(left), tilted)


def still_message(still: StillSensor, unit: str) -> str:
    """Message that the sensor was not turned, and what follows for the calibration."""
    names = " and ".join(disturbance.name for disturbance in still.disturbances)
    return (
        f"the sensor was not turned in this recording: {names} changed its readings by "
        f"{still.moved:.3g} {unit} (rms), and the residual noise of each axis is {still.noise:.2g} {unit}; "
        f"this gives {count_text(len(still.disturbances), 'disturbance')}, but no offset or matrix"
    )


def _is_still(readings: Floats, noise: float) -> bool:
    """Whether a sensor was still: the disturbances explain the readings except for noise."""
    length = float(np.linalg.norm(readings.mean(axis=0)))
    scatter = float(np.sqrt(np.mean(np.var(readings, axis=0))))
    if noise > MAX_STILL_RESIDUAL * length:
        return False
    return scatter <= MAX_STILL_RESIDUAL * length or noise**2 < (1.0 - MIN_EXPLAINED_SHARE) * scatter**2


def _smoothed_residual(logged: LoggedDisturbances, names: tuple[str, ...]) -> float:
    """1 σ of the residuals of an axis with smoothed columns, without noise of meters; infinite without times."""
    if not (names and logged.is_timed):
        return np.inf
    left, _, design = _regress(logged.field, ShiftedDepartures(logged, names, (), {})(0.0))
    return float(np.sqrt(np.sum(left**2) / (3.0 * max(len(left) - design.shape[1], 1))))


def _regress(readings: Floats, departures: Floats) -> tuple[Floats, Floats, Floats]:
    """(N, 3) residuals of a linear regression on the disturbances, (K, 3) slopes and (N, K + 1) design."""
    design = np.column_stack([departures, np.ones(len(readings))])
    solution = np.linalg.lstsq(design, readings, rcond=None)[0]
    return readings - design @ solution, solution[:-1], design


def _prior_precision(readings: Floats, departures: Floats) -> Floats:
    """(K + 1, K + 1) precision of the prior: effects of disturbances are no larger than the readings."""
    length = max(float(np.linalg.norm(readings.mean(axis=0))), np.finfo(float).tiny)
    return np.diag(np.append((np.abs(departures).max(axis=0, initial=0.0) / (EFFECT_SIGMA * length)) ** 2, 0.0))


def _covariance(left: Floats, design: Floats, believed: Floats | None = None) -> Floats:
    """(3 K, 3 K) covariance of the slopes, grouped by disturbance, with correlated residuals.

    `believed` is the (K + 1, K + 1) precision of the prior, times the variance of the noise. The prior determines the
    separate slopes of collinear disturbances.
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


def _add_meter_errors(
    logged: LoggedDisturbances,
    departures: Floats,
    left: Floats,
    disturbances: Sequence[Disturbance],
    covariance: Floats,
) -> Floats:
    """(3 K, 3 K) covariance of the slopes, including the noise of the meters."""
    about = departures - departures.mean(axis=0)
    inverse = np.kron(np.linalg.pinv(about.T @ about, hermitian=True), np.eye(3))
    meters = [
        RegressorError(
            noise_of(departures[:, place], *_residuals_along(disturbance, left)),
            rounding_variance(logged.values[disturbance.name], disturbance.name)[0],
            np.sqrt(len(left)) * np.eye(3 * len(disturbances))[:, 3 * place : 3 * place + 3],
        )
        for place, disturbance in enumerate(disturbances)
    ]
    coefficients = np.concatenate([np.zeros(0), *(disturbance.per_unit for disturbance in disturbances)])
    return widen_covariance(covariance, inverse, coefficients, meters)


def _residuals_along(disturbance: Disturbance, left: Floats) -> tuple[Floats, Floats]:
    """(N,) residuals along the effect of a disturbance, and their (N,) derivatives by the disturbance."""
    size = float(np.linalg.norm(disturbance.per_unit))
    along = left @ disturbance.per_unit / size if size > 0.0 else np.zeros(len(left))
    return along, np.full(len(left), size)


def _best_lags(logged: LoggedDisturbances, names: tuple[str, ...]) -> dict[str, Lag]:
    """Best lag of each motor."""
    lags: dict[str, Lag] = {}
    for late in lag_groups(names) if logged.is_timed else ():
        cost = _LineCost(logged, ShiftedDepartures(logged, names, late, significant_lags(lags)))
        lag = cost.with_residual_sigma(search_lag(late[0], cost, lag_grid(logged.step_s)))
        lags |= {name: replace(lag, name=name) for name in late}
    return lags


class _LineCost:
    """χ² of a linear regression as a function of the lag; the unit is the residual variance at the best lag."""

    def __init__(self, logged: LoggedDisturbances, shifted: ShiftedDepartures) -> None:
        self._field, self._shifted = logged.field, shifted
        least = min(float(np.sum(self._residuals_at(lag) ** 2)) for lag in lag_grid(logged.step_s))
        self._variance = max(least / (3.0 * len(logged.field)), 1e-300)

    def __call__(self, lag_s: float) -> float:
        """χ² at a lag in s."""
        return float(np.sum(self._residuals_at(lag_s) ** 2)) / self._variance

    def with_residual_sigma(self, lag: Lag) -> Lag:
        """The lag with a standard deviation from the correlated residuals."""
        left, slopes, design = _regress(self._field, self._shifted(lag.seconds))
        moved = self._shifted.slope(lag.seconds) @ slopes
        moved -= design @ np.linalg.lstsq(design, moved, rcond=None)[0]
        return with_sigma(lag, left.T, moved.T, self._variance)

    def _residuals_at(self, lag_s: float) -> Floats:
        """(N, 3) residuals at a lag."""
        return _regress(self._field, self._shifted(lag_s))[0]


def _statistics(
    disturbance: Disturbance, place: int, disturbances: Floats, left: Floats, lags: dict[str, Lag]
) -> DisturbanceEstimate:
    """Statistics of one of the disturbances."""
    departures, design = disturbances[:, place], np.column_stack([disturbances, np.ones(len(left))])
    lag = lags.get(disturbance.name)
    return DisturbanceEstimate(
        disturbance.name,
        disturbance,
        monotonicity=monotonicity(departures),
        attenuation=attenuation(departures, *_residuals_along(disturbance, left)),
        lag_sigma_s=np.nan if lag is None else lag.used_sigma_s,
        is_lag_at_limit=lag is not None and lag.is_beyond,
        curvature=_curvature(disturbance, departures, left, design),
        collinearity=collinearity(departures, np.delete(disturbances, place, axis=1)),
    )


def _curvature(disturbance: Disturbance, departures: Floats, left: Floats, design: Floats) -> float:
    """Nonlinear part of a disturbance's effect on all axes, relative to the linear effect."""
    count = len(left)
    rows = [np.arange(axis * count, (axis + 1) * count) for axis in range(3)]
    residuals = Residuals(left.T.ravel(), np.kron(np.eye(3), design), rows)
    return curvature(np.tile(departures, 3), residuals, np.repeat(np.eye(3), count, axis=0), disturbance.per_unit)


def _accelerations(recordings: Sequence[Recording], logged: LoggedDisturbances) -> Floats | None:
    """(N, 3) accelerations at the readings in the fit; None if a recording has none."""
    accelerations: list[Floats] = []
    for recording, part in zip(recordings, logged.parts, strict=True):
        pieces = [block.acceleration for block in recording.blocks() if len(block)]
        given = [piece for piece in pieces if piece is not None]
        if len(given) < len(pieces):
            return None
        accelerations.append(np.concatenate(given)[:: part.stride])
    return np.concatenate(accelerations)


def _tilted_deg(acceleration: Floats | None, departures: Floats) -> float:
    """Largest tilt of the vertical over the range of a disturbance, in degrees; 0 if not significant.

    >>> current = np.tile(np.linspace(0.0, 20.0, 50), 4)
    >>> tilt = np.radians(0.1 * current)
    >>> acceleration = 9.8 * np.stack([np.sin(tilt), 0.0 * tilt, -np.cos(tilt)], axis=1)
    >>> round(_tilted_deg(acceleration, current[:, np.newaxis]), 1)
    2.0
    """
    if acceleration is None or not departures.shape[1]:
        return 0.0
    finite = np.isfinite(acceleration).all(axis=1)
    is_enough = finite.sum() > departures.shape[1] + 1
    gravity = float(np.linalg.norm(acceleration[finite].mean(axis=0))) if is_enough else 0.0
    if not gravity > 0.0:
        return 0.0
    unit = acceleration[finite] / gravity
    left, slopes, design = _regress(unit, departures[finite])
    vertical = unit.mean(axis=0)
    level = np.eye(3) - np.outer(vertical, vertical)
    covariance, most = _covariance(left, design), 0.0
    for place, slope in enumerate(slopes):
        block = covariance[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
        turned, sigma = np.linalg.norm(level @ slope), np.sqrt(np.linalg.eigvalsh(block)[-1].clip(0.0))
        if turned > MIN_TILT_SIGMAS * sigma:
            most = max(most, float(turned * np.ptp(departures[:, place])))
    return float(np.degrees(np.arctan(most)))


def _largest_step(left: Floats) -> float:
    """Size of the step that explains most of the residual variance; 0 if less than `MIN_STEP_SHARE` of it."""
    count = len(left)
    before = np.arange(1, count)[:, np.newaxis]
    sums = np.cumsum(left, axis=0)[:-1]
    gains = np.sum(sums**2, axis=1) * count / (before * (count - before))[:, 0]
    place = int(np.argmax(gains))
    share = float(gains[place]) / max(float(np.sum(left**2)), np.finfo(float).tiny)
    if share < MIN_STEP_SHARE:
        return 0.0
    first, rest = left[: place + 1].mean(axis=0), left[place + 1 :].mean(axis=0)
    return float(np.linalg.norm(rest - first))
