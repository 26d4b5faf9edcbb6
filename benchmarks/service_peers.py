"""Online estimators as in other projects, and the adapter of Flinders' own.

Each receives readings as they arrive and returns the correction ``matrix @ (reading - offset)`` at any time, with a
claim if it has one. `once` is common in products; `refit`, `px4` and `kalman` begin with the same fit, since their
projects calibrate the vehicle first. The others use raw readings only, like their projects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

import flinders
from benchmarks.service_bodies import FIRST_S, HOUR
from flinders.errors import FlindersError
from flinders.estimators.consistent import fit_adjusted
from flinders.estimators.data import Readings
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.summary.moments import Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from benchmarks.service_lives import Chunk
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

STRENGTH_UT, DIP_DEG = 50.0, 60.0
TARGET_DEG: Final = 1.0
LEVEL_UT: Final = STRENGTH_UT * math.cos(math.radians(DIP_DEG))
EYE: Final = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """Correction of an estimator at a moment: ``corrected = matrix @ (reading - offset)``."""

    matrix: Floats
    offset: Floats
    claim_deg: float | None = None  #: worst heading error, one σ
    bound_deg: float | None = None  #: bound, 95 %; by default 1.96 claims

    @property
    def bound(self) -> float | None:
        """Bound of the worst heading error, 95 %, degrees."""
        return 1.96 * self.claim_deg if self.bound_deg is None and self.claim_deg is not None else self.bound_deg


@dataclass(frozen=True, slots=True)
class Report:
    """An event that an estimator reports, at its stamp."""

    time: float
    code: str


class Estimator(Protocol):
    """An online calibration."""

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Add readings, and return reports."""

    def correction(self, time: float) -> Correction | None:
        """Return the correction at a time stamp not before the last reading; None without one in force."""


def fitted(time: Floats, field: Floats) -> Fit | None:
    """Fit of readings, also a refused one; None if no ellipsoid fits them."""
    try:
        return flinders.fit(flinders.Samples.of(field, unit="uT", time=time), target_deg=TARGET_DEG)
    except Refused as refused:
        return refused.fit
    except FlindersError:
        return None


class Once:
    """One fit of the first three minutes; its claim grows with a random walk of the offset of `walk` µT/√h.

    σ(t)² = σ(0)² + (walk √t / horizontal field)². The common practice: a calibration command, then constants.
    """

    def __init__(self, walk: float = 0.2) -> None:
        self.fit: Fit | None = None
        self._walk, self._begun = walk, 0.0
        self._held: list[Chunk] = []

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Collect readings of three minutes, then fit."""
        if self.fit is None:
            self._held.append(chunk)
            if chunk.time[-1] - self._held[0].time[0] > FIRST_S:
                time, field = (np.concatenate([getattr(one, of) for one in self._held]) for of in ("time", "field"))
                within = time - time[0] < FIRST_S
                self.fit, self._begun, self._held = fitted(time[within], field[within]), float(time[within][-1]), []
        return ()

    def correction(self, time: float) -> Correction | None:
        """Return the correction of the fit, with the grown claim."""
        if self.fit is None:
            return None
        grown = math.degrees(self._walk * math.sqrt(max(time - self._begun, 0.0) / HOUR) / LEVEL_UT)
        claim = math.hypot(self.fit.heading_error_deg.worst, grown)
        return Correction(self.fit.calibration.matrix, self.fit.calibration.offset, claim)


class Refit(Once):
    """`Once`, then each ten minutes a fit of the last half hour of readings with more than 6° a second.

    A fit replaces the one in force if it is not refused and claims less. It uses the defaults of `flinders.fit`, not
    the settings of any project.
    """

    LASTS_S, EACH_S = 0.5 * HOUR, 600.0

    def __init__(self, walk: float = 0.2) -> None:
        super().__init__(walk)
        self._time, self._field, self._tried = np.empty(0), np.empty((0, 3)), -math.inf

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Collect readings of turns, and fit them."""
        super().add(chunk)
        turns, now = turning(chunk), float(chunk.time[-1])
        self._time = np.concatenate([self._time, chunk.time[turns]])
        self._field = np.concatenate([self._field, chunk.field[turns]])
        if abs(now - self._tried) > self.EACH_S:
            self._tried = now
            recent = np.abs(now - self._time) < self.LASTS_S
            self._time, self._field = self._time[recent], self._field[recent]
            fit = fitted(self._time, self._field) if self.fit is not None else None
            held = self.correction(now)
            if fit is None or held is None or held.claim_deg is None or fit.verdict == "refused":
                return ()
            if fit.heading_error_deg.worst < held.claim_deg:
                self.fit, self._begun = fit, now
        return ()


class Pypilot:
    """A sphere over spread points of the last hour, as the autopilot pypilot calibrates in the background.

    Up to 64 points 1.6 µT apart, each the mean of its readings and of gravity; points older than an hour are dropped.
    Each minute a sphere is fitted to nine or more, then offset, radius r and the sine s of the dip together:
    ``Σ (r² - |m - b|²)² + (600 (s - (m - b)·d / |m - b|))²``. It is accepted if r is 9 to 70 µT, headings cover
    60° or more, both centres agree within 5 µT and the offset moved by 0.32 µT or more. No soft iron, no claim.

    pypilot, ``calibration_fit.py`` of 2017 (commit f37e0e8): `SigmaPoints`, `FitPoints`, `CalibrationProcess`. Readings
    are thinned to five a second.
    """

    def __init__(self) -> None:
        self._points: list[list[Any]] = []  # mean reading with gravity, readings, last stamp
        self._last: list[Any] | None = None
        self._tried = self._taken = -math.inf
        self._offset: Floats | None = None

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Sort readings into points, and fit them each minute."""
        rows = np.hstack([chunk.field, chunk.down])
        for time, row in zip(chunk.time.tolist(), rows, strict=True):
            if abs(time - self._taken) >= 0.19:
                self._taken = time
                self._put(time, row)
        now = float(chunk.time[-1])
        if abs(now - self._tried) > 60.0:
            self._tried = now
            self._points = [point for point in self._points if point[1] >= 2 and now - point[2] < HOUR]
            self._fit()
        return ()

    def correction(self, time: float) -> Correction | None:  # noqa: ARG002 – it does not age
        """Return the last accepted offset."""
        return None if self._offset is None else Correction(EYE, self._offset)

    def _put(self, time: float, row: Floats) -> None:
        last = self._last
        if last is not None and _near(last[0], row):
            last[0], last[1], last[2] = last[0] + 0.01 * (row - last[0]), last[1] + 1, time
            return
        self._last = [row, 1, time] if last is None else None
        if last is None:
            return
        for point in self._points:
            if _near(point[0], last[0]):
                point[0], point[1], point[2] = point[0] + 0.01 * (last[0] - point[0]), point[1] + 1, last[2]
                return
        if len(self._points) == 64:
            at = np.array([point[0][:3] for point in self._points])
            apart = np.linalg.norm(at[:, None] - at, axis=2) + np.diag(np.full(64, np.inf))
            one, other = np.unravel_index(np.argmin(apart), apart.shape)
            del self._points[one if self._points[one][2] < self._points[other][2] else other]
        self._points.append(last)

    def _fit(self) -> None:
        if len(self._points) < 9:
            return
        rows = np.array([point[0] for point in self._points])
        field, down = rows[:, :3], rows[:, 3:]
        design = np.hstack([2.0 * field, np.ones((len(field), 1))])
        sphere = np.linalg.lstsq(design, (field**2).sum(axis=1), rcond=None)[0]
        square = sphere[3] + sphere[:3] @ sphere[:3]
        if square <= 0.0:
            return
        guess = np.array([*sphere[:3], math.sqrt(square), 0.0])
        for _ in range(20):  # Gauss–Newton
            off = field - guess[:3]
            length = np.linalg.norm(off, axis=1)
            along = (off * down).sum(axis=1) / length
            slope = (down - along[:, None] * off / length[:, None]) / length[:, None]
            one, zero = np.ones((len(field), 1)), np.zeros((len(field), 1))
            errors = np.concatenate([guess[3] ** 2 - length**2, 600.0 * (guess[4] - along)])
            jacobian = np.vstack(
                [np.hstack([2.0 * off, 2.0 * guess[3] * one, zero]), 600.0 * np.hstack([slope, zero, one])]
            )
            guess = guess - np.linalg.lstsq(jacobian, errors, rcond=None)[0]
        turned = np.sort(np.arctan2(*(_levelled(field - guess[:3], down)[:, [1, 0]].T)))
        gap = np.diff(turned, append=turned[0] + 2.0 * np.pi).max()
        apart = np.linalg.norm(guess[:3] - sphere[:3])
        moved = math.inf if self._offset is None else np.sum((guess[:3] - self._offset) ** 2)
        if 9.0 <= abs(guess[3]) <= 70.0 and 360.0 - math.degrees(gap) >= 60.0 and apart <= 5.0 and moved >= 0.1:
            self._offset = guess[:3]


def _near(one: Floats, other: Floats) -> bool:
    return bool((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 + (one[2] - other[2]) ** 2 < 2.56)


def _levelled(field: Floats, down: Floats) -> Floats:
    """Vectors turned by the smallest rotation of gravity (n, 3) to z."""
    axis = np.cross(down, [0.0, 0.0, 1.0])
    cosine = down[:, 2:] / np.linalg.norm(down, axis=1, keepdims=True)
    along = (axis * field).sum(axis=1, keepdims=True)
    level: Floats = cosine * field + np.cross(axis, field) + axis * along / (1.0 + np.maximum(cosine, -0.99))
    return level


class Observer:
    """PX4's observer of the offset by the gyro, on readings corrected by the first fit.

    ``b⁺ = b + g Δt (-ω × (x - p))`` with ``p = x⁻ - ω × (x⁻ - b) Δt`` and g = 18 (MBE_LEARN_GAIN). It restarts from
    zero if Δt is above 0.2 s or below 1 ms. An offset is valid once it is above 4 µT (0.04 G) and one axis
    turns twenty times faster, in rad/s, than the offset moves across it, in G/s, 0.02 G/s at the least. The last valid
    one is subtracted. The Δt of the gain is 20 ms, at which PX4 runs it, whatever the rate of the readings. No claim.

    PX4 Autopilot, ``MagBiasEstimator.cpp``, ``params.c`` (MBE_LEARN_GAIN 18), ``FieldSensorBiasEstimator.hpp``; after
    Troni and Whitcomb (2013). PX4 runs it before take-off only; here it runs always. That PX4 subtracts a valid offset
    is an assumption.
    """

    GAIN, SMALLEST_UT = 18.0, 4.0

    def __init__(self) -> None:
        self._first, self._valid = Once(), np.zeros(3)
        self._bias, self._last = np.zeros(3), np.zeros(3)
        self._time = -math.inf

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Update the offset with readings; the linear recursion uses plain numbers for speed."""
        self._first.add(chunk)
        fit = self._first.fit
        if fit is None:
            return ()
        scale = STRENGTH_UT / fit.calibration.field_strength
        field = scale * fit.calibration.apply(chunk.field)
        for time, now, rate in zip(chunk.time.tolist(), field, chunk.rate, strict=True):
            step, self._time = time - self._time, time
            if 0.001 <= step <= 0.2:
                self._observe(step, now, rate)
            else:
                self._bias = np.zeros(3)
            self._last = now
        return ()

    def _observe(self, step: float, now: Floats, rate: Floats) -> None:
        p, q, r = rate.tolist()
        (x, y, z), (u, v, w) = self._last.tolist(), self._bias.tolist()
        x, y, z = x - u, y - v, z - w
        a, b, c = (now - self._last).tolist()
        a, b, c = a + step * (q * z - r * y), b + step * (r * x - p * z), c + step * (p * y - q * x)
        gain = self.GAIN * 0.02
        move = (-gain * (q * c - r * b), -gain * (r * a - p * c), -gain * (p * b - q * a))
        self._bias = self._bias + move
        size = math.hypot(*self._bias.tolist())
        if size > 500.0:
            self._bias = np.zeros(3)
        elif size > self.SMALLEST_UT:
            i, j, k = (abs(one) / (100.0 * step) for one in move)
            fitness = (abs(p) / max(j + k, 0.02), abs(q) / max(i + k, 0.02), abs(r) / max(i + j, 0.02))
            if max(fitness) > 20.0:
                self._valid = self._bias

    def correction(self, time: float) -> Correction | None:
        """Return the first fit with the valid offset added."""
        first = self._first.correction(time)
        if first is None or self._first.fit is None:
            return None
        scale = STRENGTH_UT / self._first.fit.calibration.field_strength
        return Correction(first.matrix, first.offset + np.linalg.solve(scale * first.matrix, self._valid))


def turning(chunk: Chunk) -> NDArray[np.bool_]:
    """(n,) whether the gyro reads more than 6° a second: at rest, a recursion with forgetting diverges."""
    turns: NDArray[np.bool_] = np.linalg.norm(chunk.rate, axis=1) > 0.1
    return turns


class Betaflight:
    """Recursive least squares of a sphere with adaptive forgetting, as Betaflight estimates the offset.

    ``1 = φᵀθ``, φ = (|m|², m); b = -θ₁₋₃ / 2 θ₀; λ⁺ = λmin + (1 - λmin) (λ / (λ + φᵀPφ))², λmin = 0.95, P(0) = 100.

    Betaflight, ``sensors/compass.c``: `compassBiasEstimatorApply`, `LAMBDA_MIN`, `P0`; in counts of the sensor, here
    0.1 µT; P in place of its factors U D Uᵀ. Betaflight runs it while a pilot turns the craft; here it runs always
    while the gyro reads more than 6° a second, and at ten readings a second at most, the lowest rate that its authors
    call usable. No soft iron, no claim.
    """

    FORGET, START = 0.95, 100.0

    def __init__(self) -> None:
        self._theta, self._spread = np.zeros(4), self.START * np.eye(4)
        self._keep, self._taken = self.FORGET, -math.inf
        self._offset: Floats | None = None

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Update with each reading."""
        counts = 10.0 * chunk.field
        rows = np.hstack([(counts**2).sum(axis=1, keepdims=True), counts])
        for time, row, turns in zip(chunk.time.tolist(), rows, turning(chunk).tolist(), strict=True):
            if abs(time - self._taken) < 0.09 or not turns:
                continue
            self._taken = time
            pull = self._spread @ row
            total = self._keep + float(row @ pull)
            self._theta = self._theta + pull * ((1.0 - float(row @ self._theta)) / total)
            self._spread = (self._spread - np.outer(pull, pull / total)) / self._keep
            self._keep = self.FORGET + (1.0 - self.FORGET) * (self._keep / total) ** 2
        self._spread = (self._spread + self._spread.T) / 2.0
        if self._theta[0]:
            self._offset = -0.05 * self._theta[1:] / self._theta[0]
        return ()

    def correction(self, time: float) -> Correction | None:  # noqa: ARG002 – it does not age
        """Return the present offset."""
        return None if self._offset is None else Correction(EYE, self._offset)


class Forgetting:
    """Least squares of a general ellipsoid with exponential forgetting: a memory of 10,000 readings.

    The sums of `benchmarks.emulations.forgetting`, of readings while the gyro reads more than 6° a second, fitted each
    half minute; the last closed ellipsoid with a field of 22 to 67 µT counts. Not the settings of any project;
    L. Ljung, "System Identification" (2nd ed. 1999), 11.2. No claim.
    """

    MEMORY: Final = 10_000.0

    def __init__(self) -> None:
        self._sums, self._tried = Moments.empty(), -math.inf
        self._found: Ellipsoid | None = None

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Scale the sums down, add readings, and fit each half minute."""
        field = chunk.field[turning(chunk)]
        ages = np.arange(len(field))[::-1] / self.MEMORY
        self._sums = self._sums * math.exp(-len(ages) / self.MEMORY) + Moments.of(field, weight=np.exp(-ages))
        if abs(chunk.time[-1] - self._tried) > 30.0:
            self._tried = float(chunk.time[-1])
            try:
                found = fit_adjusted(Readings(replace(Summary.empty(), moments=self._sums)))[0]
            except (FlindersError, np.linalg.LinAlgError):
                return ()
            if 22.0 < found.radius < 67.0:
                self._found = found
        return ()

    def correction(self, time: float) -> Correction | None:  # noqa: ARG002 – it does not age
        """Return the present ellipsoid."""
        found = self._found
        return None if found is None else Correction(np.linalg.inv(found.shape) * STRENGTH_UT, found.centre)


class Kalman:
    """Extended Kalman filter of offset and soft iron, nine parameters with random walks.

    ``|(I + D) m - b|² = F²`` with noise of each reading; b and D walk. The equation is that of Crassidis, Lai and
    Harman, "Real-time attitude-independent three-axis magnetometer calibration", J. Guid. Control Dyn. 28 (2005),
    section III.B, whose parameters do not walk. Its numbers are PX4's for the offset in EKF2: noise 5 µT
    (EKF2_MAG_NOISE), walk 0.01 µT/s in steps of 10 ms, which is 0.06 µT/√h (EKF2_MAG_B_NOISE), a gate of three σ
    (EKF2_MAG_GATE), at most 15 readings a second (EKF2_MAG_RATE; from ``params_magnetometer.yaml``; that the noise is
    one of steps of 10 ms is from memory). D walks by 10⁻⁴/√h. It starts from the first fit, with σ of 5 µT and 2 %, and
    restarts if an entry of D exceeds 0.2: level turns alone have a second solution, I + D = 0 and |b| = F.
    F is 50 µT. The claim is that of its covariance. Ten readings are linearized at once.
    """

    NOISE_UT, WALK_UT, SHAPE_WALK, GATE, LARGEST = 5.0, 0.06, 1e-4, 3.0, 0.2

    def __init__(self) -> None:
        self._first = Once()
        self._time: float | None = None
        self._start()

    def _start(self) -> None:
        self._state, self._spread = np.zeros(9), np.diag([25.0] * 3 + [4e-4] * 6)

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Predict and update, ten readings at a time."""
        self._first.add(chunk)
        fit = self._first.fit
        if fit is None:
            return ()
        scale = STRENGTH_UT / fit.calibration.field_strength
        field, time = scale * fit.calibration.apply(chunk.field), chunk.time
        kept = np.flatnonzero(np.diff(np.floor(15.0 * time), prepend=-1.0))
        for rows in np.array_split(kept, max(1, len(kept) // 10)):
            if len(rows):
                self._predict(float(time[rows[-1]]))
                self._update(field[rows])
        return ()

    def _walked(self, time: float) -> Floats:
        hours = 0.0 if self._time is None else max(time - self._time, 0.0) / HOUR
        grown: Floats = self._spread + hours * np.diag([self.WALK_UT**2] * 3 + [self.SHAPE_WALK**2] * 6)
        return grown

    def _predict(self, time: float) -> None:
        self._spread, self._time = self._walked(time), time

    def _update(self, field: Floats) -> None:
        matrix = EYE + symmetric_matrix(self._state[3:])
        corrected = field @ matrix - self._state[:3]
        x, y, z = field.T
        u, v, w = corrected.T
        entries = np.stack([u * x, v * y, w * z, u * y + v * x, u * z + w * x, v * z + w * y], axis=1)
        slopes = 2.0 * np.hstack([-corrected, entries])
        lengths = (corrected**2).sum(axis=1)
        noise = 4.0 * self.NOISE_UT**2 * ((corrected @ matrix) ** 2).sum(axis=1)
        innovation = STRENGTH_UT**2 - lengths
        total = slopes @ self._spread @ slopes.T + np.diag(noise)
        near = innovation**2 < self.GATE**2 * np.diag(total)
        if near.any():
            slopes, total, innovation = slopes[near], total[np.ix_(near, near)], innovation[near]
            gain = np.linalg.solve(total, slopes @ self._spread).T
            self._state = self._state + gain @ innovation
            left = self._spread - gain @ slopes @ self._spread
            self._spread = (left + left.T) / 2.0
            if np.abs(self._state[3:]).max() > self.LARGEST:
                self._start()

    def correction(self, time: float) -> Correction | None:
        """Return the state, with the heading error of its covariance."""
        fit = self._first.fit
        if fit is None:
            return None
        scale = STRENGTH_UT / fit.calibration.field_strength
        matrix, base = EYE + symmetric_matrix(self._state[3:]), scale * fit.calibration.matrix
        offset = fit.calibration.offset + np.linalg.solve(matrix @ base, self._state[:3])
        return Correction(matrix @ base, offset, worst_deg(self._walked(time)))


def worst_deg(spread: Floats) -> float:
    """Largest 1 σ of the level heading error over all headings, degrees, for a covariance (9, 9) of a calibration."""
    turn = np.radians(np.arange(0.0, 360.0, 5.0))
    north, east, down = np.cos(turn), -np.sin(turn), np.full_like(turn, math.tan(math.radians(DIP_DEG)))
    zero = np.zeros_like(turn)
    forward = np.stack([-zero - 1.0 / LEVEL_UT, zero, zero, north, zero, zero, east, down, zero], axis=1)
    right = np.stack([zero, zero - 1.0 / LEVEL_UT, zero, zero, east, zero, north, zero, down], axis=1)
    slopes = -np.sin(turn)[:, None] * forward - np.cos(turn)[:, None] * right
    slopes -= slopes.mean(axis=0)
    return math.degrees(math.sqrt(max(np.einsum("hi,ij,hj->h", slopes, spread, slopes).max(), 0.0)))


class Ours:
    """`flinders.OnlineCalibration` with a target of 1°."""

    def __init__(self) -> None:
        self._online = flinders.OnlineCalibration(unit="uT", target_deg=TARGET_DEG)

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        """Add readings with their time stamps."""
        return tuple(Report(one.time_s, one.code) for one in self._online.add(chunk.field, time=chunk.time))

    def correction(self, time: float) -> Correction | None:
        """Return the calibration in force with its state at that moment."""
        calibration = self._online.calibration
        state = self._online.at(time)
        if calibration is None:
            return None
        claim, bound = float(state.heading_error_deg), float(state.bound_deg)
        if not math.isfinite(claim):
            return None
        return Correction(calibration.matrix, calibration.offset, claim, bound)


ESTIMATORS: Final[dict[str, Callable[[], Estimator]]] = {
    "ours": Ours,
    "once": Once,
    "refit": Refit,
    "pypilot": Pypilot,
    "px4": Observer,
    "betaflight": Betaflight,
    "forgetting": Forgetting,
    "kalman": Kalman,
}
