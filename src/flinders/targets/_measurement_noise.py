"""Noise of corrected readings for a filter: white noise of each reading, and the constant error of the calibration.

Noise differs from reading to reading. The error of a calibration is the same in every reading at an attitude: a filter
cannot average it, and it stays as long as a vehicle holds its heading. A filter has one number for both, the
measurement noise R, which it treats as white. If R is just the sum of the two variances, the filter is too confident.
`YawFilter` finds the R for which the filter's own variance is that of its actual error. In the example the calibration
has an error of 1° and the gyro one of 0.6°, and the filter states both.

>>> compass_and_gyro = YawFilter(rate_hz=15.0, drift=2.25e-6, bias_drift=1e-8)
>>> sigma = compass_and_gyro.measurement_sigma(calibration_deg=1.0, reading_deg=0.5)
>>> round(math.degrees(sigma), 1), round(compass_and_gyro.stated_deg(sigma), 2)
(20.5, 1.18)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.short_repr import ShortRepr
from flinders.errors import figures

if TYPE_CHECKING:
    from flinders.arrays import Floats

MIN_SIGMA, MAX_SIGMA = 1e-6, 1e3
"""Range in rad in which the measurement noise is searched."""
BISECTIONS: Final = 20
"""Number of bisections; they determine the measurement noise to 2e-5 of its value."""
MAX_DOUBLINGS: Final = 60
"""Largest number of doublings of the time in which a variance settles."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeasurementNoise(ShortRepr):
    """Standard deviations of a corrected reading by noise, and by the error of the calibration."""

    reading: float  #: of one horizontal axis by white noise, for one reading, in the calibration's unit
    #: of one horizontal axis by the calibration, constant at an attitude; mean over a level turn
    calibration: float
    heading_reading_deg: float  #: of the heading of a level vehicle by white noise, for one reading
    #: of a level heading by the calibration, constant at a heading; mean over a turn (the claim's rms)
    heading_calibration_deg: float
    horizontal: float  #: horizontal part of the field, in the calibration's unit
    dip_deg: float  #: dip of the field for which the headings hold
    dip_assumed: bool  #: whether the location of the readings is unknown, so that the dip is an assumption
    #: (3, 3): covariance of a corrected reading by both, in the square of the calibration's unit; mean over a level
    #: turn
    field_covariance: Floats

    def with_error(self, heading_deg: float) -> MeasurementNoise:
        """Copy with a further error of each level heading, 1 σ in degrees, that readings do not show."""
        off = self.horizontal * math.radians(heading_deg)
        return replace(
            self,
            calibration=math.hypot(self.calibration, off),
            heading_calibration_deg=math.hypot(self.heading_calibration_deg, heading_deg),
            field_covariance=self.field_covariance + off**2 * np.eye(3),
        )

    def as_dict(self, unit: str) -> dict[str, object]:
        """JSON-ready fields; `unit` is the unit of the calibration."""
        return {
            "unit": unit,  # of the field
            "reading": self.reading,  # of one horizontal axis of one reading, 1 σ: white
            "calibration": self.calibration,  # of one horizontal axis, 1 σ: constant in all readings of an attitude
            "heading_reading_deg": self.heading_reading_deg,  # of a level heading of one reading, 1 σ: white
            "heading_calibration_deg": self.heading_calibration_deg,  # 1 σ: constant in all readings of a heading
            "dip_deg": self.dip_deg,  # dip for which headings hold
            "field_covariance": self.field_covariance.tolist(),  # (3, 3): of a corrected reading, both parts
        }

    @property
    def axis(self) -> float:
        """Standard deviation of one horizontal axis of a corrected reading, by noise and by the calibration."""
        return math.hypot(self.reading, self.calibration)

    @property
    def across(self) -> float:
        """Standard deviation of a corrected reading across the horizontal field, by noise and by the calibration."""
        return math.hypot(self.reading, self.horizontal * math.radians(self.heading_calibration_deg))

    @property
    def heading_deg(self) -> float:
        """Standard deviation in degrees of a level heading of one reading, by noise and by the calibration."""
        return math.hypot(self.heading_reading_deg, self.heading_calibration_deg)


@dataclass(frozen=True, slots=True)
class YawFilter:
    """A Kalman filter of yaw, and optionally of the gyro's bias, with measurements of a gyro and a compass."""

    rate_hz: float  #: headings per second that the filter uses
    drift: float  #: rad²/s: growth of the yaw variance that the filter assumes for gyro noise
    bias_drift: float = 0.0  #: rad²/s³: growth of the variance of the gyro bias; 0 for a filter without that state
    #: whether `drift` is actual gyro noise; otherwise it is a margin, and the yaw has no such error
    is_of_gyro: bool = True

    def stated_deg(self, sigma: float) -> float:
        """Standard deviation of the yaw in degrees that the settled filter states for noise of `sigma` rad."""
        return _stated_deg(self._settle(sigma))

    def error_deg(self, sigma: float, reading_deg: float) -> float:
        """Standard deviation of the yaw in degrees by noise of `reading_deg` per heading, if `sigma` rad are assumed.

        With `is_of_gyro`, the gyro noise is included.
        """
        return self._error_deg(self._settle(sigma), reading_deg)

    def measurement_sigma(self, calibration_deg: float, reading_deg: float) -> float:
        """Measurement noise, 1 σ in rad, for which the filter states the actual error of its yaw.

        The actual error is that of the calibration at a constant heading, with the effect of noise added. For an exact
        calibration the result is the noise of one reading.
        """
        low, high = math.log(max(math.radians(reading_deg), MIN_SIGMA)), math.log(MAX_SIGMA)
        for _ in range(BISECTIONS):
            middle = (low + high) / 2.0
            settled = self._settle(math.exp(middle))
            is_too_sure = _stated_deg(settled) < math.hypot(calibration_deg, self._error_deg(settled, reading_deg))
            low, high = (middle, high) if is_too_sure else (low, middle)
        return math.exp(low)

    def _error_deg(self, settled: tuple[Floats, Floats], reading_deg: float) -> float:
        """Yaw error of a settled filter in degrees, by the noise of the headings that its gain weights."""
        transition, process = self._model()
        gain, _ = settled
        remaining = np.eye(len(gain))
        remaining[:, 0] -= gain
        carried = remaining @ transition
        added = math.radians(reading_deg) ** 2 * np.outer(gain, gain)
        if self.is_of_gyro:
            added += remaining @ process @ remaining.T
        variance = np.linalg.solve(np.eye(carried.size) - np.kron(carried, carried), added.ravel())
        return math.degrees(math.sqrt(variance[0]))

    def _settle(self, sigma: float) -> tuple[Floats, Floats]:
        """Kalman gain of the settled filter for a heading, and variance before the heading is used.

        The variance is the solution of the algebraic Riccati equation by the doubling algorithm: E. K.-W. Chu, H.-Y.
        Fan, W.-W. Lin, Linear Algebra and its Applications 396 (2005) 55.
        """
        transition, process = self._model()
        measured = np.zeros_like(process)
        measured[0, 0] = sigma**-2
        prior = _solve_riccati(transition.T, measured, process)
        return prior[:, 0] / (prior[0, 0] + sigma**2), prior

    def words(self, name: str, sigma: float, noise: MeasurementNoise, *, who: str) -> str:
        """Words on the error of yaw that `who` states with a noise of `sigma` rad, and on the actual error."""
        return (
            f"{name} is {sigma:.3g} rad, {figures(math.degrees(sigma))}°: with it {who} states "
            f"{figures(self.stated_deg(sigma))}° of yaw (1 σ) on a constant heading. The calibration's error there is "
            f"{figures(noise.heading_calibration_deg)}°, and constant; a reading has "
            f"{figures(noise.heading_reading_deg)}° of noise, which averages away"
        )

    def _model(self) -> tuple[Floats, Floats]:
        """Transition matrix and process noise from one heading to the next."""
        step = 1.0 / self.rate_hz
        if not self.bias_drift:
            return np.eye(1), np.array([[self.drift * step]])
        cross = -self.bias_drift * step**2 / 2.0
        yaw = self.drift * step + self.bias_drift * step**3 / 3.0
        return np.array([[1.0, -step], [0.0, 1.0]]), np.array([[yaw, cross], [cross, self.bias_drift * step]])


def _stated_deg(settled: tuple[Floats, Floats]) -> float:
    """Standard deviation of yaw in degrees that a filter in its steady state claims after it has used a heading."""
    gain, prior = settled
    return math.degrees(math.sqrt((1.0 - gain[0]) * prior[0, 0]))


def _solve_riccati(transition: Floats, measured: Floats, process: Floats) -> Floats:
    """(n, n) settled variance before a measurement with the information `measured`; `transition` is transposed."""
    moved, information, variance = transition, measured, process
    for _ in range(MAX_DOUBLINGS):
        solved = np.linalg.solve(np.eye(len(variance)) + information @ variance, np.hstack([moved, information]))
        onward, gained = np.hsplit(solved, 2)
        added = moved.T @ variance @ onward
        information = information + moved @ gained @ moved.T
        moved, variance = moved @ onward, variance + (added + added.T) / 2.0
        if np.abs(added).max() <= 1e-13 * np.abs(variance).max():
            break
    return variance
