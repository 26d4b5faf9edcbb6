"""What sensors beside the magnetometer did to a fit."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from msgspec import UNSET

from flinders.core.calibration_file import beside_record

if TYPE_CHECKING:
    from msgspec import UnsetType

    from flinders.arrays import Floats
    from flinders.core.calibration_file import BesideRecord
    from flinders.diagnostics.instruments import Mistake

AUTO: Final = "auto"
"""What is asked for where each aiding sensor and disturbance is to be used that makes the calibration better."""


@dataclass(frozen=True, slots=True)
class AidingSensor:
    """What one aid did to a fit.

    Attributes
    ----------
    name : str
        One of `flinders.estimators.aiding.AIDS`.
    kept : bool
    changed_deg : float
        By how much it changed the heading of a level vehicle, rms.
    before_deg, after_deg : float
        Worst heading error that is claimed without and with it.
    words : str
        Why it was left out.
    """

    name: str
    kept: bool
    changed_deg: float = 0.0
    before_deg: float = 0.0
    after_deg: float = 0.0
    words: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Aiding:
    """What gyro, accelerometer or attitude told beside the ellipsoid.

    Attributes
    ----------
    each : tuple of AidingSensor
        In the order in which they were taken.
    rotation : (3, 3) float, optional
        From the magnetometer's axes to those of the body; None where nothing saw it.
    rotation_covariance : (3, 3) float, optional, rad²
        Of its rotation vector, in body axes.
    gyro_bias, gyro_bias_sigma : (3,) float, optional, rad/s
    acceleration_bias, acceleration_bias_sigma : (3,) float, optional, m/s²
    delay_s, delay_sigma_s : float, optional
        By how much the magnetometer is behind the gyro.
    dip_deg, dip_sigma_deg : float, optional
        Inclination of the field as the recording shows it.
    excess_variance : float
        Factor by which stretches of the recording scatter more than their residuals explain, in variance.
    mistakes : tuple of Mistake
    """

    each: tuple[AidingSensor, ...] = ()
    rotation: Floats | None = None
    rotation_covariance: Floats | None = None
    gyro_bias: Floats | None = None
    gyro_bias_sigma: Floats | None = None
    acceleration_bias: Floats | None = None
    acceleration_bias_sigma: Floats | None = None
    delay_s: float | None = None
    delay_sigma_s: float | None = None
    dip_deg: float | None = None
    dip_sigma_deg: float | None = None
    excess_variance: float = 1.0
    mistakes: tuple[Mistake, ...] = ()

    def alignment_error_deg(self, dip_deg: float) -> float | None:
        """Heading error (rms over a level turn, 1 σ) that the rotation's own uncertainty makes.

        A turn about z goes straight into the heading, tilts mix the vertical field in: C₃₃ + ½ tan² I (C₁₁ + C₂₂).
        """
        if self.rotation_covariance is None:
            return None
        x, y, z = np.diag(self.rotation_covariance).tolist()
        return float(np.rad2deg(np.sqrt(z + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x + y))))

    @classmethod
    def from_record(cls, record: BesideRecord) -> Self:
        """What a calibration file keeps of it."""
        return cls(
            rotation_covariance=_array(record.rotation_covariance),
            acceleration_bias=_array(record.acceleration_bias),
            acceleration_bias_sigma=_array(record.acceleration_bias_sigma),
        )

    def to_record(self) -> BesideRecord | UnsetType:
        """What the calibration file keeps of it."""
        return beside_record(
            rotation_covariance=self.rotation_covariance,
            acceleration_bias=self.acceleration_bias,
            acceleration_bias_sigma=self.acceleration_bias_sigma,
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        biases = ("gyro_bias", "gyro_bias_sigma", "acceleration_bias", "acceleration_bias_sigma")
        arrays = {name: getattr(self, name) for name in ("rotation", "rotation_covariance", *biases)}
        return {
            "each": [dataclasses.asdict(aid) for aid in self.each],
            **{name: None if value is None else value.tolist() for name, value in arrays.items()},
            **{name: getattr(self, name) for name in ("delay_s", "delay_sigma_s", "dip_deg", "dip_sigma_deg")},
            "creep": self.excess_variance,
        }


def _array(value: object) -> Floats | None:
    """An array of what a file states; None where it does not."""
    return None if value is UNSET else np.asarray(value, float)
