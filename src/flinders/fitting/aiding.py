"""What aiding sensors did to a fit: which were used, and what they tell beside the ellipsoid."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from msgspec import UNSET

from flinders.core.calibration_file import aiding_record
from flinders.geometry.ellipsoid import symmetric
from flinders.likelihood.dip import GRAVITY

if TYPE_CHECKING:
    from msgspec import UnsetType

    from flinders.arrays import Floats
    from flinders.core.calibration_file import AidingRecord
    from flinders.diagnostics.instruments import Mistake
    from flinders.estimators.aiding import Aided

AUTO: Final = "auto"
"""What is asked for where each aiding sensor and disturbance is to be used that makes the calibration better."""


@dataclass(frozen=True, slots=True)
class AidingSensor:
    """What one aiding sensor did to a fit."""

    name: str  # one of `flinders.estimators.aiding.AIDS`
    is_used: bool  # False where it was left out
    heading_change_deg: float = 0.0  # by how much it changed the heading of a level vehicle, rms
    before_deg: float = 0.0  # worst heading error claimed without it
    after_deg: float = 0.0  # worst heading error claimed with it
    reason: str = ""  # why it was left out
    code: str = ""  # of the finding that says the same


@dataclass(frozen=True, slots=True, eq=False)
class Aiding:
    """What gyro, accelerometer or attitude tell beside the ellipsoid."""

    sensors: tuple[AidingSensor, ...] = ()  # in the order in which they were taken
    # (3, 3): from the magnetometer's axes to those of the body; None where nothing saw it
    rotation: Floats | None = None
    rotation_covariance: Floats | None = None  # (3, 3), rad²: of its rotation vector, in body axes
    gyro_bias: Floats | None = None  # (3,), rad/s: what the gyro reads at rest
    gyro_bias_sigma: Floats | None = None  # (3,), rad/s: 1 σ
    acceleration_bias: Floats | None = None  # (3,), m/s²: what the accelerometer reads too much
    acceleration_bias_sigma: Floats | None = None  # (3,), m/s²: 1 σ
    # (3, 3): gains and non-orthogonality of the accelerometer: the specific force is this times what it reads, less its
    # bias
    acceleration_matrix: Floats | None = None
    delay_s: float | None = None  # by how much the magnetometer is behind the gyro
    delay_sigma_s: float | None = None  # 1 σ
    dip_deg: float | None = None  # inclination of the field as the recording shows it
    dip_sigma_deg: float | None = None  # 1 σ
    # factor by which stretches of the recording scatter more than their residuals explain, in variance
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
    def of(cls, aided: Aided, *, each: tuple[AidingSensor, ...] = (), mistakes: tuple[Mistake, ...] = ()) -> Self:
        """What a fit with aiding sensors knows beside its ellipsoid."""
        at, layout = aided.parameters, aided.layout
        sine, delay = aided.of("sine"), aided.of("delay")
        gyro, accelerometer = _sigma(aided.of("gyro_bias")), _sigma(aided.of("accelerometer"))
        height = at.sine if "sine" in layout else float(at.direction[2]) if "direction" in layout else None
        level = np.sqrt(max(1.0 - at.sine**2, 1e-6))
        return cls(
            sensors=each,
            rotation=at.rotation if aided.sees_rotation else None,
            rotation_covariance=aided.rotation_covariance if aided.sees_rotation else None,
            gyro_bias=None if gyro is None else at.gyro_bias,
            gyro_bias_sigma=gyro,
            acceleration_bias=None if accelerometer is None else GRAVITY * at.accelerometer[:3],
            acceleration_bias_sigma=None if accelerometer is None else GRAVITY * accelerometer[:3],
            acceleration_matrix=None if accelerometer is None else np.eye(3) + symmetric(at.accelerometer[3:]),
            delay_s=None if delay is None else at.delay,
            delay_sigma_s=None if delay is None else float(np.sqrt(delay[0, 0])),
            dip_deg=None if height is None else float(np.rad2deg(np.arcsin(np.clip(height, -1.0, 1.0)))),
            dip_sigma_deg=None if sine is None else float(np.rad2deg(np.sqrt(sine[0, 0]) / level)),
            excess_variance=aided.excess_variance,
            mistakes=mistakes,
        )

    @classmethod
    def from_record(cls, record: AidingRecord) -> Self:
        """What a calibration file keeps of it."""
        return cls(
            rotation_covariance=_array(record.rotation_covariance),
            acceleration_bias=_array(record.acceleration_bias),
            acceleration_bias_sigma=_array(record.acceleration_bias_sigma),
            acceleration_matrix=_array(record.acceleration_matrix),
            dip_deg=None if record.dip_deg is UNSET else record.dip_deg,
            dip_sigma_deg=None if record.dip_sigma_deg is UNSET else record.dip_sigma_deg,
        )

    def to_record(self) -> AidingRecord | UnsetType:
        """What the calibration file keeps of it."""
        return aiding_record(
            rotation_covariance=self.rotation_covariance,
            acceleration_bias=self.acceleration_bias,
            acceleration_bias_sigma=self.acceleration_bias_sigma,
            acceleration_matrix=self.acceleration_matrix,
            dip_deg=self.dip_deg,
            dip_sigma_deg=self.dip_sigma_deg,
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        biases = ("gyro_bias", "gyro_bias_sigma", "acceleration_bias", "acceleration_bias_sigma")
        matrices = ("rotation", "rotation_covariance", "acceleration_matrix")
        arrays = {name: getattr(self, name) for name in (*matrices, *biases)}
        return {
            "sensors": [dataclasses.asdict(aid) for aid in self.sensors],
            **{name: None if value is None else value.tolist() for name, value in arrays.items()},
            **{name: getattr(self, name) for name in ("delay_s", "delay_sigma_s", "dip_deg", "dip_sigma_deg")},
            "excess_variance": self.excess_variance,
        }


def _sigma(covariance: Floats | None) -> Floats | None:
    """(N,) standard deviations; None of what was not estimated."""
    return None if covariance is None else np.sqrt(np.diag(covariance))


def _array(value: object) -> Floats | None:
    """An array of what a file states; None where it does not."""
    return None if value is UNSET else np.asarray(value, float)
