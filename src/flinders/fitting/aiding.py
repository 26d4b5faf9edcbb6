"""Aiding sensors of a fit: `Instruments` is the request for them, `Aiding` has the results.

>>> calibrated = Instruments("rate", gyro_scale_sigma=0.0)
>>> calibrated.names, Instruments.of(("rate", "dip")).names, bool(Instruments.of(()))
(('rate',), ('rate', 'dip'), False)
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np
from msgspec import UNSET

from flinders.core.calibration_file import aiding_record
from flinders.core.inertial import STANDARD_GRAVITY, Inertial, TiltError, Triad
from flinders.errors import UsageError, figures
from flinders.estimators.accelerometer_poses import unit_of
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.heading.tilt_error import tilt_error
from flinders.likelihood.dip import ACCELERATION_SIGMA, GAIN_SIGMA, GRAVITY
from flinders.likelihood.gyro import SCALE_SIGMA, scale_matrix

if TYPE_CHECKING:
    from collections.abc import Sequence

    from msgspec import UnsetType

    from flinders.arrays import Floats
    from flinders.core.calibration_file import AidingRecord
    from flinders.diagnostics.instruments import Mistake
    from flinders.estimators.aiding import AidedFit

AUTO: Final = "auto"
"""Request for every aiding sensor and disturbance that improves the calibration."""

MAX_CLAIM_RATIO: Final = 1.05
"""Largest claimed heading error at which an aided fit is used, relative to the claim without aiding sensors."""

MAX_VERTICAL_CLAIM_RATIO: Final = 4.0
"""Largest heading error claimed with a vertical, as a multiple of that without; beyond it, the vertical is wrong."""

VERTICALS: Final = ("dip", "tilt")
"""Aiding sensors that show only the vertical; the rotation of the magnetometer against it can be used alone."""

ROTATION_ALONE: Final = "offset and shape stay those without it, and its rotation is used"

MAX_BIAS: Final = 2.0
"""Largest plausible bias of an accelerometer, 1 σ in m/s²."""

_GYRO: Final = ("gyro_scale", "gyro_turn")
"""Blocks of the gyro's matrix."""

MAX_GAIN_ERROR: Final = 0.5
"""Largest plausible relative error of a scale or gain, 1 σ."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Recorded instruments to use in a fit, with the standard deviations of their errors.

    Raises `UsageError` for implausible errors.

    Parameters
    ----------
    names : str or sequence of str
        ``rate``, ``dip``, ``tilt``, ``attitude``; or ``auto`` for those that improve the calibration, disturbances
        included.
    gyro_scale_sigma : float
        With ``rate``: error of the gyro's scales, as a share, 1 σ; 0 for a calibrated gyro.
    acceleration_bias_sigma : float, m/s²
        With ``dip``: bias of the accelerometer on each axis, 1 σ; 0 for a calibrated accelerometer.
    acceleration_gain_sigma : float
        With ``dip``: error of the accelerometer's gains, as a share, and of its orthogonality, in rad, 1 σ.
    """

    names: str | Sequence[str] = ()
    gyro_scale_sigma: float = SCALE_SIGMA
    acceleration_bias_sigma: float = ACCELERATION_SIGMA
    acceleration_gain_sigma: float = GAIN_SIGMA

    def __post_init__(self) -> None:
        """Refuse implausible errors."""
        names = (self.names,) * bool(self.names) if isinstance(self.names, str) else tuple(self.names)
        object.__setattr__(self, "names", names)
        for what, share, usual in (
            ("gyro scale", self.gyro_scale_sigma, SCALE_SIGMA),
            ("acceleration gain", self.acceleration_gain_sigma, GAIN_SIGMA),
        ):
            if not 0.0 <= share <= MAX_GAIN_ERROR:
                raise UsageError(f"{what} is {share:g}: need a share from 0 to {MAX_GAIN_ERROR:g}, such as {usual:g}")
        if not 0.0 <= self.acceleration_bias_sigma <= MAX_BIAS:
            raise UsageError(
                f"acceleration bias is {self.acceleration_bias_sigma:g} m/s²: need 0 to {MAX_BIAS:g}, such as "
                f"{ACCELERATION_SIGMA:g}"
            )

    @classmethod
    def of(cls, aiding: AnyAiding) -> Instruments:
        """Return `Instruments` unchanged; give names the default errors."""
        return aiding if isinstance(aiding, Instruments) else cls(aiding)

    @property
    def request(self) -> str | tuple[str, ...]:
        """The requested sensors: ``auto``, or a tuple of names."""
        return AUTO if tuple(self.names) == (AUTO,) else tuple(self.names)

    @property
    def sigmas(self) -> dict[str, float]:
        """Keyword arguments of `flinders.fitting.aid_selection.fit_with_aids` for the errors of the instruments."""
        return {
            "gyro_scale": self.gyro_scale_sigma,
            "acceleration_bias": self.acceleration_bias_sigma,
            "acceleration_gain": self.acceleration_gain_sigma,
        }

    def __bool__(self) -> bool:
        return bool(self.names)


AnyAiding: TypeAlias = "str | Sequence[str] | Instruments"
"""Aiding sensors as a caller requests them."""


@dataclass(frozen=True, slots=True)
class AidingSensor:
    """Effect of one aiding sensor on a fit."""

    name: str  # one of `flinders.estimators.aiding.AIDING_TERMS`
    is_used: bool  # False if the sensor was left out
    heading_change_deg: float = 0.0  # change of the heading of a level vehicle by the sensor, rms
    before_deg: float = 0.0  # worst heading error that the fit claims without the sensor
    after_deg: float = 0.0  # worst heading error that the fit claims with the sensor
    reason: str = ""  # reason why the sensor was left out, in words
    code: str = ""  # code of the finding with this reason


@dataclass(frozen=True, slots=True, eq=False)
class Aiding:
    """Results of a fit with gyro, accelerometer or attitude, other than the ellipsoid."""

    sensors: tuple[AidingSensor, ...] = ()  # effect of each sensor, in the order in which they were tried
    # (3, 3): rotation from the magnetometer's axes to those of the body; None if not observed
    rotation: Floats | None = None
    rotation_covariance: Floats | None = None  # (3, 3), rad²: covariance of the rotation vector, in body axes
    gyro_bias: Floats | None = None  # (3,), rad/s: reading of the gyro at rest
    gyro_bias_sigma: Floats | None = None  # (3,), rad/s: 1 σ of `gyro_bias`
    # (3, 3): gains, non-orthogonality and mounting of the gyro: rate = matrix (reading − bias)
    gyro_matrix: Floats | None = None
    gyro_matrix_sigma: Floats | None = None  # (3, 3): 1 σ of each entry
    acceleration_bias: Floats | None = None  # (3,), m/s²: bias, which each reading of the accelerometer contains
    acceleration_bias_sigma: Floats | None = None  # (3,), m/s²: 1 σ of `acceleration_bias`
    # (3, 3): gains and non-orthogonality of the accelerometer: specific force = matrix (reading − bias)
    acceleration_matrix: Floats | None = None
    acceleration_matrix_sigma: Floats | None = None  # (3, 3): 1 σ of each entry
    gravity_reading: float | None = None  # length of the accelerometer's reading at rest, in its own unit
    tilt_error: TiltError | None = None  # error of the vertical that the corrected accelerometer shows at rest
    delay_s: float | None = None  # delay of the magnetometer behind the gyro
    delay_sigma_s: float | None = None  # 1 σ of `delay_s`
    dip_deg: float | None = None  # inclination of the field that the recording shows
    dip_sigma_deg: float | None = None  # 1 σ of `dip_deg`
    # ratio of the variance between stretches of the recording to that expected from their residuals
    excess_variance: float = 1.0
    mistakes: tuple[Mistake, ...] = ()

    def alignment_error_deg(self, dip_deg: float) -> float | None:
        """Heading error (rms over a level turn, 1 σ, in degrees) from the uncertainty of the rotation.

        A rotation about z adds to the heading directly; a tilt adds a part of the vertical field. With the covariance C
        of the rotation the variance is C₃₃ + ½ tan² I (C₁₁ + C₂₂).
        """
        if self.rotation_covariance is None:
            return None
        x, y, z = np.diag(self.rotation_covariance).tolist()
        return float(np.rad2deg(np.sqrt(z + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x + y))))

    @classmethod
    def of(cls, aided: AidedFit, *, each: tuple[AidingSensor, ...] = (), mistakes: tuple[Mistake, ...] = ()) -> Self:
        """Results of the aiding sensors in a fit."""
        at, layout = aided.parameters, aided.layout
        sine, delay = aided.of("sine"), aided.of("delay")
        gyro, accelerometer = _sigma(aided.of("gyro_bias")), _sigma(aided.of("accelerometer"))
        height = at.sine if "sine" in layout else float(at.direction[2]) if "direction" in layout else None
        level = np.sqrt(max(1.0 - at.sine**2, 1e-6))
        return cls(
            sensors=each,
            rotation=at.rotation if aided.has_rotation else None,
            rotation_covariance=aided.rotation_covariance if aided.has_rotation else None,
            gyro_bias=None if gyro is None else at.gyro_bias,
            gyro_bias_sigma=gyro,
            acceleration_bias=None if accelerometer is None else GRAVITY * at.accelerometer[:3],
            acceleration_bias_sigma=None if accelerometer is None else GRAVITY * accelerometer[:3],
            **_gyro_matrix(aided),
            **_acceleration_matrix(aided),
            delay_s=None if delay is None else at.delay,
            delay_sigma_s=None if delay is None else float(np.sqrt(delay[0, 0])),
            dip_deg=None if height is None else float(np.rad2deg(np.arcsin(np.clip(height, -1.0, 1.0)))),
            dip_sigma_deg=None if sine is None else float(np.rad2deg(np.sqrt(sine[0, 0]) / level)),
            excess_variance=aided.excess_variance,
            mistakes=mistakes,
        )

    @classmethod
    def from_record(cls, record: AidingRecord) -> Self:
        """Read the results of aiding sensors from the record of a calibration file."""
        return cls(
            rotation_covariance=_array(record.rotation_covariance),
            acceleration_bias=_array(record.acceleration_bias),
            acceleration_bias_sigma=_array(record.acceleration_bias_sigma),
            acceleration_matrix=_array(record.acceleration_matrix),
            acceleration_matrix_sigma=_array(record.acceleration_matrix_sigma),
            gravity_reading=None if record.gravity_reading is UNSET else record.gravity_reading,
            tilt_error=None if record.tilt_error_deg is UNSET else TiltError(*record.tilt_error_deg),
            gyro_bias=_array(record.gyro_bias),
            gyro_bias_sigma=_array(record.gyro_bias_sigma),
            gyro_matrix=_array(record.gyro_matrix),
            gyro_matrix_sigma=_array(record.gyro_matrix_sigma),
            dip_deg=None if record.dip_deg is UNSET else record.dip_deg,
            dip_sigma_deg=None if record.dip_sigma_deg is UNSET else record.dip_sigma_deg,
        )

    def left_out(self, with_deg: float, without_deg: float, *, is_refused: bool) -> Self:
        """Results if the calibration uses no aiding sensor; the rotation from vertical sensors is still used.

        Parameters
        ----------
        with_deg, without_deg : float
            Claimed heading error with the used sensors, and without any.
        is_refused : bool
            Whether the fit with the sensors was refused; its rotation is not used then.

        >>> sensors = AidingSensor("attitude", True), AidingSensor("rate", False, reason="turning is unknown")
        >>> [sensor.reason for sensor in Aiding(sensors).left_out(7.21, 2.2, is_refused=True).sensors]
        ['with it the heading error is 7.2°, without it 2.2°', 'turning is unknown']
        """
        used = [sensor.name for sensor in self.sensors if sensor.is_used]
        is_turned = (
            not is_refused and with_deg <= MAX_VERTICAL_CLAIM_RATIO * without_deg and bool({*VERTICALS} & {*used})
        )
        reason = claims_more(with_deg, without_deg, used)

        def with_reason(sensor: AidingSensor) -> AidingSensor:
            if not sensor.is_used:
                return sensor
            if is_turned and sensor.name in VERTICALS:
                return dataclasses.replace(sensor, reason=f"{reason}; {ROTATION_ALONE}")
            return dataclasses.replace(sensor, is_used=False, reason=reason, before_deg=without_deg, after_deg=with_deg)

        whole = self if is_turned else type(self)(mistakes=self.mistakes)
        return dataclasses.replace(whole, sensors=tuple(map(with_reason, self.sensors)), excess_variance=1.0)

    def to_record(self) -> AidingRecord | UnsetType:
        """Record for the calibration file; UNSET if there is nothing to store."""
        return aiding_record(
            rotation_covariance=self.rotation_covariance,
            acceleration_bias=self.acceleration_bias,
            acceleration_bias_sigma=self.acceleration_bias_sigma,
            acceleration_matrix=self.acceleration_matrix,
            acceleration_matrix_sigma=self.acceleration_matrix_sigma,
            gravity_reading=self.gravity_reading,
            tilt_error_deg=None if self.tilt_error is None else np.array(dataclasses.astuple(self.tilt_error)),
            gyro_bias=self.gyro_bias,
            gyro_bias_sigma=self.gyro_bias_sigma,
            gyro_matrix=self.gyro_matrix,
            gyro_matrix_sigma=self.gyro_matrix_sigma,
            dip_deg=self.dip_deg,
            dip_sigma_deg=self.dip_sigma_deg,
        )

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        biases = ("gyro_bias", "gyro_bias_sigma", "acceleration_bias", "acceleration_bias_sigma")
        matrices = (
            "rotation", "rotation_covariance", "acceleration_matrix", "acceleration_matrix_sigma", "gyro_matrix",
            "gyro_matrix_sigma",
        )  # fmt: skip
        arrays = {name: getattr(self, name) for name in (*matrices, *biases)}
        return {
            "sensors": [dataclasses.asdict(aid) for aid in self.sensors],
            **{name: None if value is None else value.tolist() for name, value in arrays.items()},
            "gravity_reading": self.gravity_reading,
            # `rms`, `worst` and `bound_95` of the vertical that the corrected accelerometer shows at rest
            "tilt_error_deg": None if self.tilt_error is None else dataclasses.asdict(self.tilt_error),
            **{name: getattr(self, name) for name in ("delay_s", "delay_sigma_s", "dip_deg", "dip_sigma_deg")},
            "excess_variance": self.excess_variance,
        }

    def inertial(self) -> Inertial:
        """Calibrations of the accelerometer and the gyro; None for each whose errors were not estimated.

        Directions of gravity determine the ratios of the accelerometer's gains, standard gravity determines their mean.
        """
        accelerometer = gyro = None
        if self.acceleration_matrix is not None and self.acceleration_bias is not None and self.gravity_reading:
            size = STANDARD_GRAVITY / self.gravity_reading
            own, sigma = self.acceleration_matrix_sigma, self.acceleration_bias_sigma
            accelerometer = Triad(
                size * self.acceleration_matrix,
                self.acceleration_bias / size,
                unit_of(self.gravity_reading),
                None if own is None else size * own,
                None if sigma is None else sigma / size,
            )
        if self.gyro_bias is not None:
            matrix = np.eye(3) if self.gyro_matrix is None else self.gyro_matrix
            gyro = Triad(matrix, self.gyro_bias, "rad/s", self.gyro_matrix_sigma, self.gyro_bias_sigma)
        return Inertial(accelerometer, gyro, self.tilt_error)


def claims_more(with_deg: float, without_deg: float, used: Sequence[str] = ()) -> str:
    """Words that a fit with aiding sensors claims more heading error than the fit without them.

    >>> claims_more(7.21, 2.2), claims_more(7.21, 2.2, ("rate", "dip"))[:47]
    ('with it the heading error is 7.2°, without it 2.2°', 'with rate and dip the heading error is 7.2°, wi')
    """
    those, them = (" and ".join(used), "them") if len(used) > 1 else ("it", "it")
    return f"with {those} the heading error is {figures(with_deg)}°, without {them} {figures(without_deg)}°"


def _acceleration_matrix(aided: AidedFit) -> dict[str, Any]:
    """Gains and misalignment of the accelerometer with 1 σ, its unit, and the error of its vertical."""
    covariance, errors = aided.of("accelerometer"), aided.parameters.accelerometer
    if covariance is None:
        return {}
    return {
        "acceleration_matrix": np.eye(3) + symmetric_matrix(errors[3:]),
        "acceleration_matrix_sigma": symmetric_matrix(np.sqrt(np.diag(covariance)[3:])),
        "gravity_reading": aided.gravity_reading,
        "tilt_error": tilt_error(errors, covariance),
    }


def _gyro_matrix(aided: AidedFit) -> dict[str, Any]:
    """Gains, misalignment and mounting of the gyro with 1 σ, as far as they were estimated."""
    if aided.of("gyro_scale") is None:
        return {}
    at, columns = aided.parameters, aided.layout.columns
    rows = np.concatenate([np.arange(columns[name].start, columns[name].stop) for name in _GYRO if name in columns])
    turn = at.gyro_turn if "gyro_turn" in columns else np.zeros(3)
    by = _entries(len(rows))
    variances = np.einsum("ri,ij,rj->r", by, aided.covariance[np.ix_(rows, rows)], by).reshape(3, 3)
    return {"gyro_matrix": scale_matrix(np.concatenate([at.gyro_scale, turn])), "gyro_matrix_sigma": np.sqrt(variances)}


def _entries(free: int) -> Floats:
    """(9, n) derivative of the entries of 1 + Γ + [ψ]× with respect to the first n parameters of Γ and ψ."""
    moved: Floats = np.array([(scale_matrix(row) - np.eye(3)).ravel() for row in np.eye(9)[:free]]).T
    return moved


def _sigma(covariance: Floats | None) -> Floats | None:
    """(N,) standard deviations; None for a block that was not estimated."""
    return None if covariance is None else np.sqrt(np.diag(covariance))


def _array(value: object) -> Floats | None:
    """An array of the numbers in a file; None if the file states none."""
    return None if value is UNSET else np.asarray(value, float)
