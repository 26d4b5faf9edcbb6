"""`Fit` is the only result: a calibration with what is known of it, and what to know about it.

>>> Finding("noise", "limits", 0.08, 0.05, "record away from iron").as_dict()["code"]
'noise'
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from msgspec import UNSET

from flinders.core.calibration_file import PARAMETERS, FindingRecord, Fitted, HeadingErrorRecord, write
from flinders.core.notebook import SIGNS, correction, refusal
from flinders.core.units import label
from flinders.deprecation import renamed_attribute
from flinders.errors import FitError, counted, figures
from flinders.findings import VERDICTS, Finding, Verdict
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import (
    DirectionError,
    attitude_limit_deg,
    direction_error_deg,
    raw_error,
    tilted_error,
)
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    import os

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import Document, Provenance
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.drift import Drift
    from flinders.diagnostics.repeatability import Repeats
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.estimators.outliers import Outlier
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.fitting.aiding import Aiding
    from flinders.geometry.plane import Plane
    from flinders.heading.error_propagation import HeadingError
    from flinders.summary.coverage import Coverage

TILTS: Final = (10.0, 30.0, 90.0)
"""Degrees of tilt at which it is said how much worse headings get."""


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
    outliers : tuple of Outlier
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
    axis_swap : AxisSwap, optional
        Where the readings tell that axes slipped in mid-recording.
    unmodelled : Unmodelled, optional
        A disturbance that was recorded, moves the readings, and is not followed.
    repeats : Repeats, optional
        Several recordings, held against each other; their scatter is in the covariance.
    plane : str, optional
        ``xy``, ``yz`` or ``zx`` where the readings of one plane are all that it rests on: headings are then those of
        a turn about the third axis.
    disturbances : tuple of DisturbanceEstimate
        What the offset was asked to follow.
    disturbances_covariance : (9 + K, 9 + K) float, optional
        Of the nine of `covariance` and the offset per unit of each disturbance, with the growth of the scale last.
    noise_uncompensated : float, optional
        `noise` of the best ellipsoid that follows nothing.
    aiding : Aiding, optional
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
    outliers: tuple[Outlier, ...] = ()
    distortion: float = 0.0
    drift: Drift | None = None
    axis_swap: AxisSwap | None = None
    unmodelled: Unmodelled | None = None
    repeats: Repeats | None = None
    plane: Plane | None = None
    disturbances: tuple[DisturbanceEstimate, ...] = ()
    disturbances_covariance: Floats | None = None
    noise_uncompensated: float | None = None
    aiding: Aiding | None = None
    z_down: bool | None = True
    findings: tuple[Finding, ...] = ()

    strays = renamed_attribute("strays", "outliers")
    slip = renamed_attribute("slip", "axis_swap")
    unfollowed = renamed_attribute("unfollowed", "unmodelled")
    driven = renamed_attribute("driven", "disturbances")
    noise_undriven = renamed_attribute("noise_undriven", "noise_uncompensated")
    aids = renamed_attribute("aids", "aiding")

    @property
    def is_flat(self) -> bool:
        """The readings lie in one plane: there is no sphere to have seen a part of, and no number to trust."""
        return any(finding.code == "one-plane" for finding in self.findings)

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
            "strays": [outlier.as_dict() for outlier in self.outliers],
            "distortion": self.distortion,
            "drift": None if self.drift is None else dataclasses.asdict(self.drift),
            "repeats": None if self.repeats is None else self.repeats.as_dict(),
            "coverage": self.coverage.as_dict(),
            "covariance": self.covariance.tolist(),
            **self._driven_as_dict(),
            **({} if self.aiding is None else {"aids": self.aiding.as_dict()}),
            "findings": [finding.as_dict() for finding in self.findings],
        }
        untrusted = _ON_A_SURFACE if self.is_flat else _REFUSED if self.verdict == "refused" else ()
        return {**fields, **dict.fromkeys(untrusted)}

    def _driven_as_dict(self) -> dict[str, Any]:
        """What is known of the disturbances; no key where it follows none."""
        if not self.disturbances:
            return {}
        return {"driven": [each.as_dict() for each in self.disturbances], "noise_undriven": self.noise_uncompensated}

    @property
    def _covariance(self) -> Floats:
        """That of all parameters, the disturbances among them."""
        return self.covariance if self.disturbances_covariance is None else self.disturbances_covariance

    @property
    def _parameters(self) -> tuple[str, ...]:
        """What the rows of that stand for."""
        disturbances = self.calibration.disturbances
        named = [f"{disturbance.kind.key}_{axis}" for disturbance in disturbances for axis in "xyz"]
        growth = [f"{disturbance.kind.key}_scale" for disturbance in disturbances if disturbance.name == "temperature"]
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
            beside=UNSET if self.aiding is None else self.aiding.to_record(),
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
