"""`Fit` is the only result: a calibration with what is known of it, and what to know about it.

>>> Finding("noise", "limits", 0.08, 0.05, "record away from iron").as_dict()["code"]
'noise'
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from msgspec import UNSET

from flinders.core.calibration_file import PARAMETERS, FindingRecord, Fitted, HeadingErrorRecord, beside_record, write
from flinders.core.notebook import SIGNS, correction, refusal
from flinders.core.units import label
from flinders.errors import FitError, counted, figures
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import attitude_limit_deg, direction_error_deg, raw_error, tilted_error
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable

    from msgspec import UnsetType

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import BesideRecord, Document, Provenance
    from flinders.core.disturbance import Driver
    from flinders.diagnostics.repeatability import Repeats
    from flinders.geometry.plane import Plane
    from flinders.heading.error_propagation import HeadingError
    from flinders.summary.coverage import Coverage

Severity = Literal["note", "limits", "refuses"]
Verdict = Literal["good", "limited", "refused"]

VERDICTS: Final[dict[Severity, Verdict]] = {"refuses": "refused", "limits": "limited", "note": "good"}
"""What each severity makes of a fit, the gravest first."""

TILTS: Final = (10.0, 30.0, 90.0)
"""Degrees of tilt at which it is said how much worse headings get."""

ONE_PLANE: Final = "one-plane"
"""The finding that no surface is supported by these readings, so that nothing which rests on one means anything."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something to know about a fit.

    Attributes
    ----------
    code : str
        Stable name, one of `flinders.fitting.verdict.CODES`.
    severity : str
        ``note``: good to know; ``limits``: the calibration holds with limits; ``refuses``: it is not given.
    number : float
        What was found; its meaning and unit belong to the code.
    limit : float
        What it was held against.
    advice : str
        What was found, and what to do, in a sentence.
    """

    code: str
    severity: Severity
    number: float
    limit: float
    advice: str

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {name: getattr(self, name) for name in self.__slots__}


def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Put findings in order of severity, those of one severity as they came."""
    order = list(VERDICTS)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))


@dataclass(frozen=True, slots=True)
class Stray:
    """A run of readings that do not belong to the rest.

    Attributes
    ----------
    first, last : int
        Usable readings, counted from 1 over all recordings.
    rows : int
        Strays among them.
    start, end : float, s
        Times of the first and the last; NaN without time.
    farthest : float
        Largest distance from the ellipsoid, in the unit of the readings.
    """

    first: int
    last: int
    rows: int
    start: float
    end: float
    farthest: float

    def as_dict(self) -> dict[str, int | float | None]:
        """JSON-ready fields; a time that is not known is None."""
        fields = dataclasses.asdict(self)
        return {name: None if value != value else value for name, value in fields.items()}  # noqa: PLR0124

    def __str__(self) -> str:
        rows = f"{self.rows:,} readings" if self.rows > 1 else "a reading"
        if np.isnan(self.start):
            if self.first == self.last:
                return f"reading {self.first}"
            return f"readings {self.first}–{self.last}: {rows}"
        return f"{self.start:.1f} s: {rows}" if self.rows == 1 else f"{self.start:.1f}–{self.end:.1f} s: {rows}"


class DirectionError(NamedTuple):
    """What to expect of the direction of the corrected field, 1 σ, in degrees: over the whole sphere and at the worst.

    >>> DirectionError(rms=0.1, worst=0.2)._asdict()
    {'rms': 0.1, 'worst': 0.2}
    """

    rms: float
    worst: float


@dataclass(frozen=True, slots=True)
class Drift:
    """A steady change over a recording, from its beginning to its end.

    Attributes
    ----------
    offset : (3,) float
        In the unit of the readings.
    strength : float
        Of the field, as a fraction of it.
    heading_deg : float
        What the change of the offset does to a level heading, at the worst heading.
    p_value : float
        How often chance alone makes as much.
    """

    offset: tuple[float, float, float]
    strength: float
    heading_deg: float
    p_value: float


@dataclass(frozen=True, slots=True)
class Slip:
    """Axes that changed their sign, or were exchanged, while the recording was made.

    Attributes
    ----------
    axes : str
        ``x``, ``y`` or ``z`` for a sign; ``xy``, ``yz`` or ``zx`` for two that were exchanged.
    rows : tuple of int
        Readings, counted from 0, from each of which on it is so, or is so no longer.
    gain : float
        How many times closer to an ellipsoid all readings lie once it is undone.
    """

    axes: str
    rows: tuple[int, ...]
    gain: float


@dataclass(frozen=True, slots=True)
class Unfollowed:
    """Something that was recorded beside the readings and moves them, and that the calibration does not follow.

    Attributes
    ----------
    name : str
        ``current``, ``throttle`` or ``temperature``.
    per_unit : tuple of float
        By how much it moves the offset for each unit of it, roughly, in the unit of the readings.
    heading_deg : float
        What that makes of a level heading at the far end of its recorded range, at most.
    chi_square : float
        How much better residuals are explained with it, for independent readings.
    """

    name: str
    per_unit: tuple[float, ...]
    heading_deg: float
    chi_square: float


@dataclass(frozen=True, slots=True)
class Driven:
    """What is known of something that the offset follows.

    Attributes
    ----------
    name : str
        ``current``, ``throttle`` or ``temperature``; of one motor ``current1`` or ``throttle1``.
    driver : Driver, optional
        None where it hardly changed, and nothing was found.
    taken_deg : float
        Heading error that following it takes away, at the far end of its recorded range, at the worst attitude.
    left_deg : float
        Heading error (1 σ) that its own uncertainty leaves there, at the worst heading; of motors of which each has
        a driver of its own, with the others as they usually were then.
    shared : float
        Share of what tells about it that the attitude could explain as well, 0 to 1.
    chi_square : float
        What it takes off the sum of squares, in the noise that is left.
    lag_sigma_s : float, s
        Of its lag; NaN where none was looked for.
    lag_is_beyond : bool
        The end of the search for a lag is best.
    one_way : float
        Share of its course that a monotone function of time explains, 0 to 1.
    attenuation : float
        By which share its offset per unit is too small, as its meter is noisy.
    curvature : float
        How far what it makes is off a straight line, as a share of what it makes; 0 where that may be chance.
    alike : float
        Share of its course that the other drivers explain, 0 to 1.
    """

    name: str
    driver: Driver | None = None
    taken_deg: float = 0.0
    left_deg: float = 0.0
    shared: float = 0.0
    chi_square: float = 0.0
    lag_sigma_s: float = np.nan
    lag_is_beyond: bool = False
    one_way: float = 0.0
    attenuation: float = 0.0
    curvature: float = 0.0
    alike: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        fields = {name: getattr(self, name) for name in self.__slots__ if name != "driver"}
        finite = {
            name: value if isinstance(value, str) or np.isfinite(value) else None for name, value in fields.items()
        }
        return {**finite, "found": self.driver is not None}


@dataclass(frozen=True, slots=True)
class Aid:
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


@dataclass(frozen=True, slots=True)
class Mistake:
    """What does not fit together in a recording.

    Attributes
    ----------
    code : str
        Of the finding that it makes.
    aid : str
        Which aid it is about.
    number, limit : float
        As those of a finding.
    words : str
    drops : bool
        The aid was left out for it.
    """

    code: str
    aid: str
    number: float
    limit: float
    words: str
    drops: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Aids:
    """What gyro, accelerometer or attitude told beside the ellipsoid.

    Attributes
    ----------
    each : tuple of Aid
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
    creep : float
        Factor by which stretches of the recording scatter more than their residuals explain, in variance.
    mistakes : tuple of Mistake
    """

    each: tuple[Aid, ...]
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
    creep: float = 1.0
    mistakes: tuple[Mistake, ...] = ()

    def alignment_error_deg(self, dip_deg: float) -> float | None:
        """Heading error (rms over a level turn, 1 σ) that the rotation's own uncertainty makes.

        A turn about z goes straight into the heading, tilts mix the vertical field in: C₃₃ + ½ tan² I (C₁₁ + C₂₂).
        """
        if self.rotation_covariance is None:
            return None
        x, y, z = np.diag(self.rotation_covariance).tolist()
        return float(np.rad2deg(np.sqrt(z + 0.5 * np.tan(np.deg2rad(dip_deg)) ** 2 * (x + y))))

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
            **{name: getattr(self, name) for name in ("delay_s", "delay_sigma_s", "dip_deg", "dip_sigma_deg", "creep")},
        }


class Outcome:
    """A calibration with findings: it has a verdict, and a file it can be written to.

    Attributes
    ----------
    findings : tuple of Finding
        Gravest first.
    """

    __slots__ = ()
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the gravest finding says."""
        severities = {finding.severity for finding in self.findings}
        return next((verdict for severity, verdict in VERDICTS.items() if severity in severities), "good")

    @property
    def finding_records(self) -> tuple[FindingRecord, ...]:
        """The findings as they stand in a file."""
        return tuple(FindingRecord(**finding.as_dict()) for finding in self.findings)

    def to_document(self, provenance: Provenance | None = None) -> Document:
        """The calibration file with all of this in it."""
        raise NotImplementedError

    def save(self, path: str | os.PathLike[str], *, force: bool = False, provenance: Provenance | None = None) -> None:
        """Write the calibration file, whole or not at all.

        Raises
        ------
        OutputExists
            Where there is a file already, unless `force`.
        OutputError
            Where it cannot be written.
        """
        write(self.to_document(provenance), path, force=force)


def error_record(error: HeadingError, target_deg: float) -> HeadingErrorRecord:
    """A heading error as it stands in a file."""
    return HeadingErrorRecord(rms=error.rms, worst=error.worst, dip_deg=error.dip_deg, target_deg=target_deg)


@dataclass(frozen=True, slots=True, eq=False)
class Fit(Outcome):
    """A calibration, how it was found and how far to trust it.

    Attributes
    ----------
    calibration : Calibration
    method : str
        What was run in the end.
    covariance : (9, 9) float
        Of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the
        square of the calibration's unit. Singular where the method holds some of them.
    noise : float
        Standard deviation of the readings' distance from the ellipsoid, in the calibration's unit.
    samples : int
        Readings used.
    coverage : Coverage
        Directions seen.
    heading_error_deg : HeadingError
        Expected of a level vehicle, 1 σ.
    target_deg : float
        The worst heading error that was asked for.
    dip_deg : float
        Inclination of the field at the site. That of `heading_error_deg` has the sign that the recording shows: the
        other one for a sensor mounted upside down.
    held : float
        Share of the least known shape parameter that the prior speaks for, 0 to 1.
    textbook_heading_error_deg : HeadingError
        What the covariance for independent residuals would claim.
    independent_samples : float
        Independent readings that say as much as those used, whose residuals hang together.
    autocorrelation : float, optional
        Correlation of a residual with the next; None where the residuals were not looked at.
    strays : tuple of Stray
        Runs of readings that were rejected.
    unseen : int
        Directions of parameter space of which the readings say nothing; the prior holds them.
    alignment_error_deg : float, optional
        Heading error (1 σ) from a mounting of the stated uncertainty, beside `heading_error_deg`.
    bias_deg : float
        Heading error (rms) that the method's own bias and misfit cost, as far as the readings show; in the covariance.
    distortion : float
        Standard deviation of what belongs to the direction and no ellipsoid takes off, in the calibration's unit;
        `structure_deg` of it is in the heading error.
    drift : Drift, optional
        Where the recording is one and long enough.
    slip : Slip, optional
        Where the readings tell that axes slipped in mid-recording.
    unfollowed : Unfollowed, optional
        A driver that was recorded, moves the readings, and is not followed.
    repeats : Repeats, optional
        Several recordings, held against each other; their scatter is in the covariance.
    plane : str, optional
        ``xy``, ``yz`` or ``zx`` where the readings of one plane are all that it rests on: headings are then those of
        a turn about the third axis.
    driven : tuple of Driven
        What the offset was asked to follow.
    drivers_covariance : (9 + K, 9 + K) float, optional
        Of the nine of `covariance` and the offset per unit of each driver, with the growth of the scale last.
    noise_undriven : float, optional
        `noise` of the best ellipsoid that follows nothing.
    aids : Aids, optional
        What was recorded beside the magnetometer and helped.
    z_down : bool, optional
        False where an accelerometer shows that z points elsewhere, so that the dip of the site was left out; None where
        that dip was used and neither an accelerometer nor anybody says which way z points.
    findings : tuple of Finding
        Gravest first.
    """

    calibration: Calibration
    method: str
    covariance: Floats
    noise: float
    samples: int
    coverage: Coverage
    heading_error_deg: HeadingError
    target_deg: float = 1.0
    dip_deg: float = 60.0
    held: float = 0.0
    unseen: int = 0
    alignment_error_deg: float | None = None
    bias_deg: float = 0.0
    textbook_heading_error_deg: HeadingError | None = None
    independent_samples: float = np.inf
    autocorrelation: float | None = None
    strays: tuple[Stray, ...] = ()
    distortion: float = 0.0
    drift: Drift | None = None
    slip: Slip | None = None
    unfollowed: Unfollowed | None = None
    repeats: Repeats | None = None
    plane: Plane | None = None
    driven: tuple[Driven, ...] = ()
    drivers_covariance: Floats | None = None
    noise_undriven: float | None = None
    aids: Aids | None = None
    z_down: bool | None = True
    findings: tuple[Finding, ...] = ()

    @property
    def is_flat(self) -> bool:
        """The readings lie in one plane: there is no sphere to have seen a part of, and no number to trust."""
        return any(finding.code == ONE_PLANE for finding in self.findings)

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration makes a sphere, in the magnetometer's own axes: it knows no rotation."""
        if self.calibration.rotation == "symmetric":
            return Ellipsoid(self.calibration.offset, self.calibration.shape)
        squares, axes = np.linalg.eigh(self.calibration.shape @ self.calibration.shape.T)
        return Ellipsoid(self.calibration.offset, (axes * np.sqrt(squares)) @ axes.T)

    @property
    def offset_sigma(self) -> Floats:
        """(3,) standard deviation of the offset, in the calibration's unit."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def direction_error_deg(self) -> DirectionError:
        """What to expect of the direction of the corrected field over the whole sphere, 1 σ."""
        return DirectionError(*direction_error_deg(self.ellipsoid, self.covariance))

    def tilted_error(self, tilt_deg: float) -> HeadingError:
        """What to expect of the heading of a vehicle that is rolled or pitched, and knows how far."""
        dip = self.heading_error_deg.dip_deg
        down = down_of(self.plane)
        error = tilted_error(self.ellipsoid, self.covariance, dip_deg=dip, tilt_deg=tilt_deg, down=down)
        return error.beside(self.structure_deg)

    @property
    def structure_deg(self) -> float:
        """Heading error (1 σ) from what belongs to the direction: as much across the field as it shows along it."""
        level = np.cos(np.deg2rad(self.heading_error_deg.dip_deg))
        return float(np.rad2deg(self.distortion / (self.ellipsoid.radius * level)))

    @property
    def attitude_limit_deg(self) -> float:
        """Tilt up to which the worst heading error is within the target: 0 where even level it is not, 180 for all."""
        left = self.target_deg**2 - self.structure_deg**2
        if left <= 0.0:
            return 0.0
        dip, down = self.heading_error_deg.dip_deg, down_of(self.plane)
        limit = float(np.sqrt(left))
        return attitude_limit_deg(self.ellipsoid, self.covariance, dip_deg=dip, limit_deg=limit, down=down)

    @property
    def per_degree_of_tilt(self) -> float:
        """Degrees by which a degree of tilt adds to the worst heading error, independent of what a level one has."""
        return float(np.sqrt(max(self.tilted_error(1.0).worst ** 2 - self.heading_error_deg.worst**2, 0.0)))

    @property
    def uncorrected_heading_error_deg(self) -> HeadingError:
        """What the heading of the same vehicle errs by without the calibration, if the calibration is right."""
        return raw_error(self.ellipsoid, dip_deg=self.heading_error_deg.dip_deg, down=down_of(self.plane))

    @property
    def uncorrected_strength(self) -> tuple[float, float]:
        """Mean length of the raw readings over the directions recorded, and its spread as a fraction of the mean."""
        readings = self.ellipsoid.centre + CELLS @ self.ellipsoid.shape
        lengths = np.linalg.norm(readings, axis=1)
        mean = float(np.average(lengths, weights=self.coverage.counts))
        spread = float(np.sqrt(np.average((lengths - mean) ** 2, weights=self.coverage.counts)))
        return mean, spread / mean

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints.

        What a refusal makes untrustworthy is None, so that nobody copies it: the calibration and what follows from
        it, and of flat readings all that rests on a surface. The evidence stays, and so do the attributes.
        """
        fields = {
            "verdict": self.verdict,
            "method": self.method,
            "calibration": self.calibration.as_dict(),
            "heading_error_deg": {
                "rms": self.heading_error_deg.rms,
                "worst": self.heading_error_deg.worst,
                "dip_deg": self.heading_error_deg.dip_deg,
                "target_deg": self.target_deg,
            },
            "uncorrected_heading_error_deg": _rms_and_worst(self.uncorrected_heading_error_deg),
            "textbook_heading_error_deg": _rms_and_worst(self.textbook_heading_error_deg),
            "alignment_error_deg": self.alignment_error_deg,
            "tilted_heading_error_deg": {f"{tilt:g}": self.tilted_error(tilt).worst for tilt in TILTS},
            "attitude_limit_deg": self.attitude_limit_deg,
            "direction_error_deg": _rms_and_worst(self.direction_error_deg),
            "bias_deg": self.bias_deg,
            "held": self.held,
            "unseen": self.unseen,
            "noise": self.noise,
            "samples": self.samples,
            "independent_samples": min(self.independent_samples, float(self.samples)),
            "autocorrelation": self.autocorrelation,
            "strays": [stray.as_dict() for stray in self.strays],
            "distortion": self.distortion,
            "drift": None if self.drift is None else dataclasses.asdict(self.drift),
            "repeats": None if self.repeats is None else self.repeats.as_dict(),
            "coverage": self.coverage.as_dict(),
            "covariance": self.covariance.tolist(),
            **self._driven_as_dict(),
            **({} if self.aids is None else {"aids": self.aids.as_dict()}),
            "findings": [finding.as_dict() for finding in self.findings],
        }
        untrusted = _ON_A_SURFACE if self.is_flat else _REFUSED if self.verdict == "refused" else ()
        return {**fields, **dict.fromkeys(untrusted)}

    def _driven_as_dict(self) -> dict[str, Any]:
        """What is known of the drivers; no key where it follows none."""
        if not self.driven:
            return {}
        return {"driven": [each.as_dict() for each in self.driven], "noise_undriven": self.noise_undriven}

    @property
    def _covariance(self) -> Floats:
        """That of all parameters, the drivers among them."""
        return self.covariance if self.drivers_covariance is None else self.drivers_covariance

    @property
    def _parameters(self) -> tuple[str, ...]:
        """What the rows of that stand for."""
        drivers = self.calibration.drivers
        named = [f"{driver.kind.key}_{axis}" for driver in drivers for axis in "xyz"]
        growth = [f"{driver.kind.key}_scale" for driver in drivers if driver.name == "temperature"]
        return (*PARAMETERS, *named, *growth)

    def to_document(self, provenance: Provenance | None = None) -> Document:
        """The calibration file with all of this in it."""
        fitted = Fitted(
            method=self.method,
            samples=self.samples,
            noise=self.noise,
            covariance_of=self._parameters,
            covariance=tuple(tuple(row) for row in self._covariance.tolist()),
            verdict=self.verdict,
            heading_error_deg=error_record(self.heading_error_deg, self.target_deg),
            coverage=self.coverage.as_dict(),
            findings=self.finding_records,
            beside=UNSET if self.aids is None else self.aids.to_record(),
        )
        return self.calibration.to_document(fit=fitted, provenance=provenance)

    def __repr__(self) -> str:
        error = self.heading_error_deg
        noise = f"{figures(self.noise, 3)} {label(self.calibration.unit)}"
        return (
            f"Fit({self.verdict}, {self.method}, heading error {error.rms:.2g}° rms, {error.worst:.2g}° worst, "
            f"noise {noise}, {counted(self.samples, 'reading')})"
        )

    def _repr_html_(self) -> str:
        """What a notebook shows; of a refused fit no number of the calibration."""
        title = f"{SIGNS[self.verdict]} {self.verdict}: {self.method}, {counted(self.samples, 'reading')}"
        told = [finding for finding in self.findings if finding.severity != "note"]
        words = [f"{SIGNS[finding.severity]} {finding.advice}" for finding in told]
        if self.verdict == "refused":
            return refusal(title, words)
        error, calibration = self.heading_error_deg, self.calibration
        good = f"worst heading good to {figures(error.worst)}° (1 σ; the target is {self.target_deg:g}°), held level"
        return correction(
            calibration.matrix.tolist(),
            calibration.offset.tolist(),
            label(calibration.unit),
            title=title,
            words=[good, *words],
            offset_sigma=self.offset_sigma.tolist(),
        )


_REFUSED: Final = ("calibration", "uncorrected_heading_error_deg")
"""Keys of a fit that are None where it is refused."""

_ON_A_SURFACE: Final = (
    *_REFUSED, "heading_error_deg", "textbook_heading_error_deg", "tilted_heading_error_deg", "attitude_limit_deg",
    "direction_error_deg", "bias_deg", "coverage",
)  # fmt: skip
"""Keys that are None where the readings are flat."""


def _rms_and_worst(error: HeadingError | DirectionError | None) -> dict[str, float] | None:
    """JSON-ready."""
    return None if error is None else {"rms": error.rms, "worst": error.worst}


class Refused(FitError):
    """A fit exists and is not fit for use: `fit` holds it with its findings, for those who want to look."""

    code: ClassVar[str] = "refused"

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        reasons = [finding for finding in fit.findings if finding.severity == "refuses"]
        super().__init__(
            "; ".join(finding.advice for finding in reasons), **{finding.code: finding.number for finding in reasons}
        )
