"""What a filter has to assume of a corrected reading: noise that is white, and an error that is not.

Noise differs from reading to reading. The error that a calibration leaves is the same in every reading of an attitude:
no filter averages it away, and a vehicle that holds its heading keeps it. A filter has one number for both, the
measurement noise R, which it takes for white. With R as large as both together it is sure of itself where it is wrong;
`YawFilter` finds the R at which its own variance is that of its error.

>>> compass_and_gyro = YawFilter(rate_hz=15.0, drift=2.25e-6, bias_drift=1e-8)
>>> sigma = compass_and_gyro.measurement_sigma(calibration_deg=1.0, reading_deg=0.5)
>>> math.degrees(sigma) > 10.0, round(math.degrees(compass_and_gyro.steady(sigma).sigma), 2)
(True, 1.0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.short_repr import ShortRepr

if TYPE_CHECKING:
    from flinders.arrays import Floats

MAX_SIGMA: Final = 1e3
"""rad: no measurement noise is larger than this."""
BISECTIONS: Final = 50
"""Steps in which the measurement noise is found, to far below a millionth of it."""
DOUBLINGS: Final = 60
"""Doublings of the time over which a variance settles, at most."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MeasurementNoise(ShortRepr):
    """Standard deviations of a corrected reading, apart: of its noise, and of what the calibration leaves."""

    reading: float  #: of one horizontal axis of one reading, in the calibration's unit: white
    #: the same of what the calibration leaves: alike in every reading of an attitude; mean over a level turn
    calibration: float
    heading_reading_deg: float  #: of the heading of one reading of a level vehicle: white
    #: of a level heading, mean over a turn (the claim's rms): the same in every reading of a heading
    heading_calibration_deg: float
    horizontal: float  #: horizontal part of the field, in the calibration's unit
    dip_deg: float  #: dip of the field for which the headings hold
    dip_assumed: bool  #: nobody said where the readings were taken
    #: (9, 9): of offset b and shape S of the ellipsoid, in squares of the calibration's unit, as the claim has it
    covariance: Floats
    #: (3, 3): of a corrected reading in the calibration's unit, both parts, mean over a level turn
    field_covariance: Floats

    @property
    def axis(self) -> float:
        """Of one horizontal axis of a corrected reading, both parts."""
        return math.hypot(self.reading, self.calibration)

    @property
    def heading_deg(self) -> float:
        """Of the heading of one reading of a level vehicle, both parts."""
        return math.hypot(self.heading_reading_deg, self.heading_calibration_deg)


class SteadyState(NamedTuple):
    """A filter that has settled."""

    sigma: float  # rad: 1 σ of its yaw, as it states it
    noise_share: float  # variance of its yaw by white measurement noise, over the variance of that


@dataclass(frozen=True, slots=True)
class YawFilter:
    """A Kalman filter of yaw, and of the gyro's bias where it has that state, fed by a gyro and a compass."""

    rate_hz: float  #: headings that it takes each second
    drift: float  #: rad²/s: growth of its yaw variance by the noise that it assumes of the gyro
    bias_drift: float = 0.0  #: rad²/s³: growth of the variance of the gyro's bias; without one it has no such state

    def steady(self, sigma: float) -> SteadyState:
        """The settled filter with a measurement noise of `sigma`, in rad.

        The variance solves the algebraic Riccati equation, by the doubling algorithm of E. K. Chu, H. Y. Fan,
        W. W. Lin, "A structure-preserving doubling algorithm", Linear Algebra Appl. 396 (2005).
        """
        transition, process = self._model()
        measurement = np.zeros_like(process)
        measurement[0, 0] = 1.0
        prior = _riccati(transition.T, measurement / sigma**2, process)
        gain = prior[:, 0] / (prior[0, 0] + sigma**2)
        remaining = np.eye(len(prior)) - np.outer(gain, measurement[0])
        carried = remaining @ transition
        settled = np.linalg.solve(np.eye(carried.size) - np.kron(carried, carried), np.outer(gain, gain).ravel())
        return SteadyState(math.sqrt((remaining @ prior)[0, 0]), float(settled[0]))

    def measurement_sigma(self, calibration_deg: float, reading_deg: float) -> float:
        """Measurement noise, 1 σ in rad, with which the filter states the error that its yaw has.

        That is the calibration's error at a heading that is held, and what is left of the noise of the readings; never
        less than that noise.
        """
        kept, white = math.radians(calibration_deg) ** 2, math.radians(reading_deg) ** 2
        low, high = math.log(max(math.radians(reading_deg), 1e-6)), math.log(MAX_SIGMA)
        for _ in range(BISECTIONS):
            middle = (low + high) / 2.0
            settled = self.steady(math.exp(middle))
            too_sure = settled.sigma**2 < kept + settled.noise_share * white
            low, high = (middle, high) if too_sure else (low, middle)
        return math.exp(low)

    def _model(self) -> tuple[Floats, Floats]:
        """Transition and process noise from one heading to the next."""
        step = 1.0 / self.rate_hz
        if not self.bias_drift:
            return np.eye(1), np.array([[self.drift * step]])
        cross = -self.bias_drift * step**2 / 2.0
        yaw = self.drift * step + self.bias_drift * step**3 / 3.0
        return np.array([[1.0, -step], [0.0, 1.0]]), np.array([[yaw, cross], [cross, self.bias_drift * step]])


def _riccati(transition: Floats, measured: Floats, process: Floats) -> Floats:
    """(n, n) settled variance before a measurement of information `measured`; `transition` is transposed."""
    moved, information, variance = transition, measured, process
    for _ in range(DOUBLINGS):
        solved = np.linalg.solve(np.eye(len(variance)) + information @ variance, np.hstack([moved, information]))
        onward, gained = np.hsplit(solved, 2)
        added = moved.T @ variance @ onward
        information = information + moved @ gained @ moved.T
        moved, variance = moved @ onward, variance + (added + added.T) / 2.0
        if np.abs(added).max() <= 1e-13 * np.abs(variance).max():
            break
    return variance
