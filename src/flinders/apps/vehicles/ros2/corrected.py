"""Content of ROS messages from a calibration in force: corrected fields in tesla, covariances, and a diagnosis.

The covariance of a corrected reading adds the noise of a reading and the error of the calibration in its direction
(`flinders.fitting.measurement_noise`).

>>> from flinders import fit, simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> corrected = corrected_field(fit(tumble), tumble.field[:1])
>>> round(1e6 * float((corrected.field**2).sum() ** 0.5), 1), corrected.covariance.shape
(48.6, (1, 3, 3))
>>> bool(corrected.covariance[0].diagonal().max() ** 0.5 < 1e-6)
True
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flinders.core.units import MICROTESLA, PER_UNIT
from flinders.errors import UnitError
from flinders.fitting.measurement_noise import field_covariance

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.verdicts import Verdict
    from flinders.workflows.online import OnlineCalibration

TESLA: Final = 1.0 / PER_UNIT["T"]
"""Tesla in one microtesla."""
LEVELS: Final[dict[Verdict, int]] = {"good": 0, "limited": 1, "refused": 2}
"""Level of ``diagnostic_msgs/DiagnosticStatus`` for each verdict: ``OK``, ``WARN`` or ``ERROR``."""
STATUS: Final = "flinders: magnetometer calibration"
CORRECTED: Final = "/imu/mag_corrected"
"""Default topic of corrected readings."""
DIAGNOSTICS: Final = "/diagnostics"
CALIBRATION: Final = "/calibration"
"""Suffix of the calibration's topic, appended to the topic of the corrected readings."""
PERIOD_S: Final = 1.0
"""Seconds between two diagnoses, and between two updates of the covariance."""


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedField:
    """Corrected readings and their covariance, in the units of ``sensor_msgs/MagneticField``."""

    field: Floats  #: (N, 3) T, in the axes of the readings
    covariance: Floats  #: (N, 3, 3) T², about the same axes; zero if unknown, as the message defines


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """State of a calibration in the fields of ``diagnostic_msgs/DiagnosticStatus``."""

    level: int  #: as `LEVELS`
    message: str
    values: dict[str, str]


def corrected_field(fit: Fit, readings: Floats) -> CorrectedField:
    """Correct readings by a fit, with their covariance.

    Parameters
    ----------
    fit : Fit
    readings : (N, 3) µT
        In the recorded axes. The axes of the fit are applied for the correction and undone in the corrected readings.

    Raises
    ------
    UnitError
        For a calibration in counts.
    """
    calibration = fit.calibration
    if calibration.unit != MICROTESLA:
        raise UnitError("the calibration is in counts, and a MagneticField in tesla: calibrate from the topic itself")
    mapping = calibration.axes.matrix
    fields = calibration.apply(readings @ mapping.T)
    return CorrectedField(
        TESLA * fields @ mapping,
        TESLA**2 * mapping.T @ field_covariance(fit, fields) @ mapping,
    )


def diagnosis_of(online: OnlineCalibration, now: float) -> Diagnosis:
    """Return the state of an online calibration at a time of its readings."""
    state = online.at(now)
    if state.doing == "learning":
        words = "no calibration yet: turn the sensor through all directions, or a level vehicle all the way round"
    elif state.doing == "disturbed":
        words = "readings contradict the calibration: iron passes by, or the offset has moved"
    elif state.verdict == "good":
        words = f"headings are good to {state.heading_error_deg:.2g}° (1 σ)"
    else:
        words = (
            f"heading error {state.heading_error_deg:.2g}° (1 σ) is beyond the target of {state.target_deg:g}°: turn "
            "the sensor, all the way round if it is level"
        )
    values = {
        "verdict": state.verdict,
        "doing": state.doing,
        "heading_error_deg": state.heading_error_deg,
        "bound_deg": state.bound_deg,
        "target_deg": state.target_deg,
        "age_s": state.age_s,
        "good_until_s": online.good_until_s,
        "walk_uT": state.walk,
        **{f"offset_{axis}_uT": value for axis, value in zip("xyz", state.offset, strict=True)},
        **{f"offset_sigma_{axis}_uT": value for axis, value in zip("xyz", state.offset_sigma, strict=True)},
    }
    return Diagnosis(LEVELS[state.verdict], words, {name: _text(value) for name, value in values.items()})


def _text(value: Any) -> str:  # noqa: ANN401 - a word or a number
    """A word or a number as JSON has it; unknown numbers are null."""
    if isinstance(value, str):
        return value
    return json.dumps(float(value)) if math.isfinite(value) else "null"


class CalibrationNews:
    """Output of an online calibration that is due: its fit, at most once a second, and the file of a new calibration.

    Parameters
    ----------
    online : OnlineCalibration
    """

    def __init__(self, online: OnlineCalibration) -> None:
        self._online = online
        self._asked, self._diagnosed = -math.inf, -math.inf
        self._fit: Fit | None = None
        self._told: bytes = b""

    def fit(self) -> Fit | None:
        """Return the fit in force, at most one second old; None without one."""
        now = self._online.time_s
        if not abs(now - self._asked) < PERIOD_S:
            self._asked, self._fit = now, self._online.fit
        return self._fit

    def diagnosis(self, now: float) -> Diagnosis | None:
        """Return the state at a time; None within a second of the previous one, and before the first reading."""
        if math.isnan(self._online.time_s) or not abs(now - self._diagnosed) >= PERIOD_S:
            return None
        self._diagnosed = now
        return diagnosis_of(self._online, now)

    def new_file(self) -> str | None:
        """Return the calibration file of the fit in force if that calibration is new, else None."""
        fit = self.fit()
        if fit is None:
            return None
        key = fit.calibration.matrix.tobytes() + fit.calibration.offset.tobytes()
        if key == self._told:
            return None
        self._told = key
        return file_text(fit)


def file_text(fit: Fit) -> str:
    """Text of the calibration file that `Fit.save` would write."""
    from flinders.core.calibration_file import dumps
    from flinders.fitting.result import document_of

    return dumps(document_of(fit))
