"""Noise and gate parameters of the estimators of PX4 and ArduPilot from the uncertainty of a calibration.

Both estimators use a compass in one of two ways, each with its own noise parameter.

- As an angle, fused with a gyro that has a bias (EKF2_HEAD_NOISE up to version 1.14, EK3_YAW_M_NSE). The filter
    treats the noise as white. The noise that is written makes the filter's variance equal to the true variance of its
    yaw (`YawFilter`) at a constant heading.
- As the vector of the field, with states for the earth's field and the body's field (EKF2_MAG_NOISE,
    EK3_MAG_M_NSE). One parameter is both the noise of a reading and the initial uncertainty of these states. The value
    written is both, added as variances: the noise averages out, and the uncertainty of the body's field stays until
    the vehicle turns.

>>> heading = EKF2.heading_sigma(1.0, 1.0)
>>> round(math.degrees(heading), 1), round(EKF2.yaw.stated_deg(heading), 2)
(20.6, 1.18)

Sources. PX4 (BSD-3-Clause): ``params_magnetometer.yaml`` and ``ekf2_params.c`` (names, ranges, defaults);
``covariance.cpp``: EKF2_GYR_NOISE 0.015 rad/s and EKF2_GYR_B_NOISE 0.001 rad/s², squared with the step of 10 ms;
``mag_control.cpp``: R_MAG and the variance of the first heading, EKF2_HEAD_NOISE also as limit of a heading that
agrees with GNSS, EKF2_MAG_CHK_STR and INC against the World Magnetic Model. ArduPilot (GPL-3; only its published
values are used): ``AP_NavEKF3.cpp`` (names, ranges, defaults), ``CovariancePrediction`` (GYRO_P_NSE, GBIAS_P_NSE at
10 ms), ``fuseEulerYaw`` (R_YAW). Values are the defaults.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.units import PER_UNIT
from flinders.errors import NotExportable, figures
from flinders.targets._measurement_noise import YawFilter
from flinders.targets._target import GATE_SIGMAS

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.targets._measurement_noise import MeasurementNoise
    from flinders.targets._target import ExportOptions, Gates

GAUSS: Final = PER_UNIT["G"]
"""µT in one gauss."""
MODEL_SIGMA, MODEL_DIP_SIGMA_DEG = 0.148, 0.20
"""µT and degrees: 1 σ of strength and dip of the World Magnetic Model, with the crust (WMM2020 report, table 5)."""
STRENGTH, INCLINATION = 1, 2
"""Bits of EKF2_MAG_CHECK."""


class Parameter(NamedTuple):
    """A parameter of an estimator, and its range."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Estimator:
    """Compass fusion of an autopilot's estimator, with default parameters."""

    who: str
    yaw: YawFilter
    heading_noise: Parameter  #: noise of a heading, rad
    field_noise: Parameter  #: noise of an axis of the field, G
    conditions: str  #: settings of the estimator for which the noise is right, in words

    def heading_sigma(self, calibration_deg: float, reading_deg: float) -> float:
        """Noise of a heading, rad, within the range of its parameter."""
        wanted = self.yaw.measurement_sigma(calibration_deg, reading_deg)
        return float(np.clip(wanted, self.heading_noise.low, self.heading_noise.high))

    def field_sigma(self, noise: MeasurementNoise) -> float:
        """Noise of an axis, G, within the range of its parameter."""
        return float(np.clip(noise.across / GAUSS, self.field_noise.low, self.field_noise.high))

    def values(self, noise: MeasurementNoise) -> dict[str, float]:
        """Names and values of the estimator's noise parameters, to three digits."""
        sigmas = {
            self.heading_noise.name: self.heading_sigma(noise.heading_calibration_deg, noise.heading_reading_deg),
            self.field_noise.name: self.field_sigma(noise),
        }
        return {name: float(f"{sigma:.3g}") for name, sigma in sigmas.items()}

    def notes(self, noise: MeasurementNoise, sigma: float) -> list[str]:
        """Notes on the meaning of the noise, and on clipping to a range; `sigma`, rad: written noise of a heading."""
        heading = self.heading_noise.name
        claimed = noise.heading_calibration_deg
        in_both = (
            f"{self.field_noise.name} (G) is {figures(noise.reading / GAUSS)} G of white noise and "
            f"{figures(noise.horizontal * math.radians(claimed) / GAUSS)} G that the calibration leaves across the "
            "horizontal field in every reading at one heading, added as variances"
        )
        notes = [self.yaw.words(heading, sigma, noise, who=f"{self.who} ({self.conditions})"), in_both]
        wanted = {
            self.heading_noise: self.yaw.measurement_sigma(claimed, noise.heading_reading_deg),
            self.field_noise: noise.across / GAUSS,
        }
        notes += [
            f"{parameter.name} is written as {figures(parameter.low)}, its minimum: {self.who} weights the compass "
            "less than it could"
            for parameter, least in wanted.items()
            if least < parameter.low
        ]
        too_sure = {
            self.heading_noise: "understates the error of its yaw",
            self.field_noise: "weights the compass more than it should",
        }
        notes += [
            f"{parameter.name} is written as {figures(parameter.high)}, its maximum, where {figures(most, 3)} would be "
            f"right: {self.who} {too_sure[parameter]}"
            for parameter, most in wanted.items()
            if most > parameter.high
        ]
        return notes


EKF2: Final = Estimator(
    who="EKF2",
    yaw=YawFilter(rate_hz=15.0, drift=0.015**2 * 0.01, bias_drift=0.001**2 * 0.01),
    heading_noise=Parameter("EKF2_HEAD_NOISE", 0.01, 1.0),
    field_noise=Parameter("EKF2_MAG_NOISE", 0.001, 1.0),
    conditions="EKF2_GYR_NOISE 0.015, EKF2_GYR_B_NOISE 0.001, EKF2_MAG_RATE 15",
)
EKF3: Final = Estimator(
    who="EKF3",
    yaw=YawFilter(rate_hz=10.0, drift=0.015**2 * 0.01, bias_drift=0.001**2 * 0.01),
    heading_noise=Parameter("EK3_YAW_M_NSE", 0.05, 1.0),
    field_noise=Parameter("EK3_MAG_M_NSE", 0.01, 0.5),
    conditions="EK3_GYRO_P_NSE 0.015, EK3_GBIAS_P_NSE 0.001, 10 readings a second",
)


def estimator_values(
    estimator: Estimator, calibration: Calibration, asked: ExportOptions
) -> tuple[dict[str, float], list[str]]:
    """Names and values of an estimator's parameters, with notes; empty unless the user requested them.

    Raises `NotExportable` if the calibration states no noise or no uncertainty.
    """
    if not asked.estimator:
        return {}, []
    if asked.noise is None:
        raise NotExportable(
            f"the noise for {estimator.who} needs a heading error, and the calibration states none: fit a recording, "
            "or leave the noise out",
            hint={"noise": None},
            beyond=(estimator.heading_noise.name, estimator.field_noise.name),
        )
    values = estimator.values(asked.noise)
    notes = estimator.notes(asked.noise, values[estimator.heading_noise.name])
    if estimator is EKF2:
        values |= _checks(asked.gates, calibration)
    return values, notes


def _checks(gates: Gates | None, calibration: Calibration) -> dict[str, float]:
    """Values of EKF2_MAG_CHECK, and of the limits of strength and dip if their spread is known."""
    checks: dict[str, float] = {}
    if gates is not None and calibration.field_strength_known:
        limit = math.hypot(gates.strength_limit, GATE_SIGMAS * MODEL_SIGMA) / GAUSS
        checks["EKF2_MAG_CHK_STR"] = min(math.ceil(100.0 * limit) / 100.0, 1.0)
    if gates is not None and gates.has_dip:
        limit = math.hypot(gates.dip_limit_deg, GATE_SIGMAS * MODEL_DIP_SIGMA_DEG)
        checks["EKF2_MAG_CHK_INC"] = min(math.ceil(10.0 * limit) / 10.0, 90.0)
    if not checks:
        return {}
    bits = STRENGTH * ("EKF2_MAG_CHK_STR" in checks) + INCLINATION * ("EKF2_MAG_CHK_INC" in checks)
    return {"EKF2_MAG_CHECK": float(bits), **checks}
