"""Schema 2.2 of Betaflight's model file, as the Configurator writes it; the order of the fields is that of the file.

>>> print(msgspec.json.encode(MagNoise(sigma=0.005)).decode())
{"sigma":0.005,"sigma_xy":null,"sigma_z":null}

Source: betaflight-configurator, ``src/js/utils/magModelExport.ts`` at 7cd82d45: CharacterizationModel, and
computeMagQualityBounds with its limits, which follow those of ArduPilot's CompassCalibrator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Struct

from flinders.core.calibration_file import Positive, Triple

if TYPE_CHECKING:
    from flinders.arrays import Floats

VERSION: Final = "2.2"
SCHEMA: Final = f"https://betaflight.com/blackbox/mag-characterization-model/{VERSION}"

STRENGTH_MG: Final = (150.0, 950.0)
MAX_OFF_DIAGONAL: Final = 1.0
MAX_ANISOTROPY: Final = 2.24
"""Limits of `quality_bounds` on the field in mG and on the soft iron."""


class Vector(Struct, frozen=True, kw_only=True):
    """Components along three axes."""

    x: float
    y: float
    z: float


class EulerAngles(Struct, frozen=True, kw_only=True):
    """Angles in degrees of the rotation R_z(yaw) R_y(pitch) R_x(roll)."""

    roll: float
    pitch: float
    yaw: float


class CapturedUnder(Struct, frozen=True, kw_only=True):
    """Settings of the board during the recording."""

    alignment: int
    custom_angles: EulerAngles | None = None  # angles of alignment 9, which is CUSTOM
    mag_zero: Vector | None = None
    mag_zero_known: bool = False


class EllipsoidCorrection(Struct, frozen=True, kw_only=True):
    """Correction ``soft_iron (raw − center)``, whose results have the length `radius`."""

    center: Vector  # counts
    soft_iron: tuple[Triple, Triple, Triple]
    radius: Positive
    residual_rms: float | None  # rms deviation of the length of corrected readings from `radius`, in their unit


class GeoReference(Struct, frozen=True, kw_only=True):
    """The field at the place of the readings."""

    latitude_deg: float | None = None
    longitude_deg: float | None = None
    declination_deg: float | None = None
    inclination_deg: float | None = None
    field_strength_nt: Positive | None = None


class Alignment(Struct, frozen=True, kw_only=True):
    """The proposed mounting: vehicle = R sensor."""

    preset: int
    label: str | None = None
    euler_zyx_deg: EulerAngles | None = None


class Quality(Struct, frozen=True, kw_only=True):
    """Quality of the proposed mounting: its agreement with the dip of the field."""

    mean_residual_deg: float | None = None
    sample_count: int | None = None
    frob_norm: float | None = None
    cost: float | None = None


class MagNoise(Struct, frozen=True, kw_only=True):
    """Noise of a corrected reading: standard deviation of one axis, in gauss."""

    sigma: float | None = None
    sigma_xy: float | None = None
    sigma_z: float | None = None


class QualityBounds(Struct, frozen=True, kw_only=True):
    """Whether field and soft iron are within the Configurator's limits."""

    field_strength_mg: float | None = None
    field_strength_ok: bool | None = None
    soft_iron_offdiag_ratio: float | None = None
    soft_iron_offdiag_ok: bool | None = None
    soft_iron_anisotropy: float | None = None
    soft_iron_anisotropy_ok: bool | None = None
    bounds_ok: bool = False


class DownstreamFusion(Struct, frozen=True, kw_only=True):
    """Inputs of a filter that fuses the field."""

    frame: Literal["FRD"]
    nt_per_corrected_unit: float | None = None
    gauss_per_corrected_unit: float | None = None
    earth_field_ned_gauss: dict[str, float] | None = None
    mag_noise_gauss: MagNoise = MagNoise()
    quality_bounds: QualityBounds = QualityBounds()


class Model(Struct, frozen=True, kw_only=True):
    """Contents of a model file."""

    schema: str = msgspec.field(name="$schema", default=SCHEMA)
    version: Literal["2.2"] = VERSION
    captured_under: CapturedUnder | None
    ellipsoid_correction: EllipsoidCorrection
    geo_reference: GeoReference
    alignment: Alignment | None
    hard_iron: Vector
    quality: Quality | None = None
    quality_assessment: dict[str, Any] | None = None
    downstream_fusion: DownstreamFusion


def quality_bounds(soft_iron: Floats, strength_nt: float | None) -> QualityBounds:
    """Check the (3, 3) soft iron and the field strength in nT against the Configurator's limits.

    >>> quality_bounds(np.diag([5.0, 0.1, 1.0]), 53_000.0).soft_iron_anisotropy_ok
    False
    """
    diagonal = np.abs(np.diag(soft_iron))
    mean, least = float(diagonal.mean()), float(diagonal.min())
    ratio = float(np.abs(soft_iron - np.diag(np.diag(soft_iron))).max()) / mean if mean > 1e-12 else None
    anisotropy = float(diagonal.max()) / least if least > 1e-12 else None
    strength_mg = None if strength_nt is None else strength_nt / 100.0
    low, high = STRENGTH_MG
    within = (
        None if strength_mg is None else low <= strength_mg <= high,
        None if ratio is None else ratio < MAX_OFF_DIAGONAL,
        None if anisotropy is None else anisotropy < MAX_ANISOTROPY,
    )
    return QualityBounds(
        field_strength_mg=strength_mg,
        field_strength_ok=within[0],
        soft_iron_offdiag_ratio=ratio,
        soft_iron_offdiag_ok=within[1],
        soft_iron_anisotropy=anisotropy,
        soft_iron_anisotropy_ok=within[2],
        bounds_ok=all(within),
    )
