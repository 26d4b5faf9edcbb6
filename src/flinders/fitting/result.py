"""`Fit` is the only result: a calibration, how far to trust it, and what to know about it.

It is made by `flinders.fit` and read back from its calibration file, which keeps the numbers and no readings: what a
file does not state is NaN, None or empty, and what needs the readings raises `NeedsRecording`.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> loaded = Fit.from_document(fit.to_document(), name="monday.json")
>>> loaded
Fit(good, likelihood, heading error 0.059° rms, 0.066° worst, noise 0.498 µT, 2,922 readings)
>>> loaded.coverage.counts
Traceback (most recent call last):
flinders.errors.NeedsRecording: the calibration file keeps no readings, and the directions of the readings are needed: \
give the recording too, as flinders report CALIBRATION RECORDING does, or fit it again
"""

from __future__ import annotations

import dataclasses
import math
import os
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np
from msgspec import UNSET

from flinders.core.calibration import Calibration
from flinders.core.calibration_file import PARAMETERS, Fitted, HeadingErrorRecord, read, write
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.notebook import SIGNS, correction, refusal
from flinders.core.units import label
from flinders.errors import ArrayError, DocumentError, FitError, counted, figures
from flinders.findings import VERDICTS, Finding, Verdict, advice, first_causes
from flinders.findings.row import stated
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.fitting.aiding import Aiding
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import (
    DirectionError,
    HeadingError,
    attitude_limit_deg,
    direction_error_deg,
    level_bound_deg,
    level_error,
    raw_error,
    tilted_error,
)
from flinders.native.engine import engine
from flinders.summary.coverage import CELLS, Coverage

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document, FindingRecord, Provenance, SourceFile
    from flinders.diagnostics.attitude_dependence import AttitudeDependence
    from flinders.diagnostics.axis_swap import AxisSwap
    from flinders.diagnostics.repeatability import Repeats
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.diagnostics.systematic import AxisLag, Drift, Nonlinearity
    from flinders.diagnostics.unmodelled import Unmodelled
    from flinders.errors import FlindersError
    from flinders.estimators.outliers import Outlier
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Condition
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane

NOT_STATED: Final = "not stated"
"""Method of a calibration of which the file says nothing, as of one that was imported."""

NO_ERROR: Final = HeadingError(math.nan, math.nan, math.nan)

TILTS: Final = (10.0, 30.0, 90.0)
"""Degrees of tilt at which it is said how much worse headings get."""


class Outcome:
    """A calibration with findings: it has a verdict, and a file it can be written to."""

    __slots__ = ()
    findings: tuple[Finding, ...]  #: most severe first

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the most severe finding says."""
        severities = {finding.severity for finding in self.findings}
        return next((verdict for severity, verdict in VERDICTS.items() if severity in severities), "good")

    @property
    def finding_records(self) -> tuple[FindingRecord, ...]:
        """The findings as they stand in a file."""
        return tuple(finding.to_record() for finding in self.findings)

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


def _stated(number: float) -> float | None:
    """A number as it stands in a file, where there is no NaN."""
    return None if math.isnan(number) else number


@dataclass(frozen=True, slots=True, eq=False)
class Fit(Outcome):
    """A calibration, how it was found and how far to trust it."""

    calibration: Calibration  #: the correction; None where it is refused
    method: str = NOT_STATED  #: what was run in the end; ``not stated`` where a file says nothing but the calibration
    #: (9, 9): of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the
    #: square of the calibration's unit. Singular where the method holds some of them; zeros where no uncertainty is
    #: stated, see `states_uncertainty`.
    covariance: Floats = field(default_factory=lambda: np.zeros((9, 9)))
    #: standard deviation of the readings' distance from the ellipsoid, in the calibration's unit; NaN if not stated
    noise: float = math.nan
    samples: int = 0  #: readings used; 0 if not stated
    #: directions seen. Of a loaded fit only its numbers are known, not the readings of each direction.
    coverage: Coverage = field(default_factory=Coverage)
    heading_error_deg: HeadingError = NO_ERROR  #: expected of a level vehicle, 1 σ; NaN if not stated
    target_deg: float = 1.0  #: the worst heading error that was asked for
    #: inclination of the field at the site. That of `heading_error_deg` has the sign that the recording shows: the
    #: other one for a sensor mounted upside down.
    dip_deg: float = ASSUMED_DIP_DEG
    dip_assumed: bool = False  #: nobody said where the readings were taken, and `dip_deg` is a guess
    prior_influence: float = 0.0  #: share of the least known shape parameter that the prior speaks for, 0 to 1
    unobserved: int = 0  #: directions of parameter space of which the readings say nothing; the prior holds them
    #: heading error (1 σ) from a mounting of the stated uncertainty, beside `heading_error_deg`
    alignment_error_deg: float | None = None
    #: heading error (rms) that the method's own bias and misfit cost, as far as the readings show; in the covariance
    bias_deg: float = 0.0
    textbook_covariance: Floats | None = None  #: (9, 9): as `covariance`, if residuals were independent
    #: independent readings that say as much as those used, whose residuals are correlated
    independent_samples: float = np.inf
    #: correlation of a residual with the next; None where the residuals were not looked at
    autocorrelation: float | None = None
    outliers: tuple[Outlier, ...] = ()  #: runs of readings that were rejected
    #: standard deviation of what belongs to the direction and no ellipsoid takes off, in the calibration's unit
    distortion: float = 0.0
    #: part of the heading error that belongs to the direction: as much across the field as the distortion is along it
    #: (1 σ), or that of axes that are proven not to be linear or to be late (at the worst heading), whichever is larger
    structure_deg: float = 0.0
    drift: Drift | None = None  #: where the recording is one and long enough
    #: of the axes, where the fit is one of a hundred readings or more as they were recorded. Where it is proven,
    #: `structure_deg` has it, or what the linearization of the calibration leaves of it.
    nonlinearity: Nonlinearity | None = None
    axis_lag: AxisLag | None = None  #: how late each axis is read, likewise
    #: what a good verdict rests on and no recording of this kind shows: that the field is the same wherever the sensor
    #: was, and that neither current nor iron near it changed with its attitude. Other evidence ends them.
    conditions: tuple[Condition, ...] = ()
    axis_swap: AxisSwap | None = None  #: where the readings tell that axes slipped in mid-recording
    unmodelled: Unmodelled | None = None  #: a disturbance that was recorded, moves the readings, and is not followed
    #: a disturbance that follows the attitude, as an accelerometer shows
    attitude_dependence: AttitudeDependence | None = None
    #: what the tilt by an accelerometer adds to a heading, where one was recorded at rest and nothing corrects it; else
    #: not a number
    tilt_error_deg: float = math.nan
    repeats: Repeats | None = None  #: several recordings, compared with each other; their scatter is in the covariance
    #: whether the readings were corrected before, and the fit is shrunk towards leaving them as they are:
    #: `flinders.fitting.shrinkage`
    is_shrunk: bool = False
    #: ``xy``, ``yz`` or ``zx`` where the readings of one plane are all that it rests on: headings are then those of a
    #: turn about the third axis
    plane: Plane | None = None
    disturbances: tuple[DisturbanceEstimate, ...] = ()  #: what the offset was asked to follow
    #: (9 + K, 9 + K): of the nine of `covariance` and the offset per unit of each disturbance, with the growth of the
    #: scale last
    disturbances_covariance: Floats | None = None
    noise_uncompensated: float | None = None  #: `noise` of the best ellipsoid that follows nothing
    aiding: Aiding | None = None  #: what was recorded beside the magnetometer and helped
    refreshed: Refreshed | None = None  #: where the shape is that of an earlier calibration, see `flinders.refresh`
    #: False where an accelerometer shows that z points elsewhere, so that the dip of the site was left out; None where
    #: that dip was used and neither an accelerometer nor anybody says which way z points
    z_down: bool | None = True
    findings: tuple[Finding, ...] = ()  #: most severe first
    name: str = "fit"  #: what messages call it: the path of a file that was loaded
    provenance: Provenance | None = None  #: release, date and recordings that a loaded file states
    stated_verdict: Verdict | None = None  #: verdict that a file states and its findings do not explain

    def __post_init__(self) -> None:
        """Refuse a covariance of another shape.

        Raises
        ------
        ArrayError
        """
        if np.shape(self.covariance) != (9, 9):
            raise ArrayError(f"covariance has shape {np.shape(self.covariance)}: need (9, 9), of offset and shape")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Fit:
        """Read a calibration file.

        Raises
        ------
        DocumentError
            For a file that cannot be opened or understood, or whose covariance is none of offset and shape.
        """
        return cls.from_document(read(path), name=os.fspath(path))

    @classmethod
    def from_document(cls, document: Document, *, name: str = "calibration") -> Fit:
        """Take the fit out of the content of a calibration file; `name` is what messages call it.

        Raises
        ------
        DocumentError
            As `load`.
        """
        fit = cls(Calibration.from_document(document, source=name), name=name, provenance=document.provenance)
        return fit if document.fit is None else _with_record(fit, document.fit)

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the most severe finding or the file says; limited if none does."""
        undescribed: Verdict | None = None if self.is_described else "limited"
        verdicts = {self.stated_verdict, undescribed, Outcome.verdict.__get__(self)}
        return next(verdict for verdict in VERDICTS.values() if verdict in verdicts)

    @property
    def is_described(self) -> bool:
        """Whether it says how it was found; an imported calibration does not."""
        return self.method != NOT_STATED

    @property
    def states_uncertainty(self) -> bool:
        """Whether it has a covariance; an imported calibration, or one composed of several turns, has none."""
        return bool(self.covariance.any())

    @property
    def files(self) -> tuple[SourceFile, ...]:
        """The recordings that it came from, where a file states them."""
        return self.provenance.files if self.provenance else ()

    @property
    def is_flat(self) -> bool:
        """The readings lie in one plane: there is no sphere to have seen a part of, and no number to trust."""
        return any(finding.code == "one-plane" for finding in self.findings)

    @property
    def tilt_words(self) -> str:
        """Up to which tilt a fit that rests on a level turn is within its target; nothing for any other."""
        limit = next((finding.number for finding in self.findings if finding.code == "level-plane"), None)
        if limit is None:
            return ""
        if not limit >= 1.0:
            return "it rests on a level turn: for a level vehicle only"
        within = "its target" if math.isnan(self.heading_error_deg.worst) else f"{self.target_deg:g}°"
        return f"it rests on a level turn: within {within} up to {limit:.0f}° of tilt"

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration makes a sphere, in the magnetometer's own axes: it knows no rotation."""
        return self.calibration.ellipsoid

    @property
    def known_dip_deg(self) -> float:
        """Inclination of the field with the sign that the recording shows; that of the site where none is stated."""
        dip_deg = self.heading_error_deg.dip_deg
        return self.dip_deg if math.isnan(dip_deg) else dip_deg

    @property
    def offset_sigma(self) -> Floats:
        """(3,) standard deviation of the offset, in the calibration's unit."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def direction_error_deg(self) -> DirectionError:
        """What to expect of the direction of the corrected field over the whole sphere, 1 σ."""
        return direction_error_deg(self.ellipsoid, self.claimed_covariance)

    @property
    def textbook_heading_error_deg(self) -> HeadingError | None:
        """What the covariance for independent residuals would claim."""
        if self.textbook_covariance is None:
            return None
        down = down_of(self.plane)
        return level_error(self.ellipsoid, self.textbook_covariance, dip_deg=self.known_dip_deg, down=down)

    @property
    def claimed_covariance(self) -> Floats:
        """(9, 9) covariance of which every stated error of heading and direction follows, at any dip and attitude.

        That of offset and shape, with what belongs to the direction as an uncertain offset P = σ² S Sᵀ: it moves the
        corrected field by σ in every direction, and a level heading by σ / cos I = `structure_deg` at every heading.
        """
        if not self.structure_deg:
            return self.covariance
        return engine().with_structure(
            self.ellipsoid.shape, self.covariance, structure_deg=self.structure_deg, dip_deg=self.known_dip_deg
        )

    def level_error(self, dip_deg: float | None = None) -> HeadingError:
        """What to expect of the heading of a level vehicle, 1 σ; by default at the dip that the fit was judged at."""
        dip = self.known_dip_deg if dip_deg is None else dip_deg
        return level_error(self.ellipsoid, self.claimed_covariance, dip_deg=dip, down=down_of(self.plane))

    @property
    def heading_bound_deg(self) -> float:
        """What a level heading errs by at most, at all headings, with a probability of 95 %; NaN if not stated.

        `flinders.heading.error_propagation` of `claimed_covariance`.
        """
        if not self.states_uncertainty:
            return math.nan
        dip, down = self.known_dip_deg, down_of(self.plane)
        bound_deg = level_bound_deg(self.ellipsoid, self.claimed_covariance, dip_deg=dip, down=down)
        return float(f"{bound_deg:.4g}")  # a file that is read and written again has the same digits

    @property
    def heading_words(self) -> str:
        """The worst heading error, 1 σ, and its bound, as ``0.32° (95 % within 0.71°)``."""
        return f"{figures(self.heading_error_deg.worst)}° ({self.bound_words})"

    @property
    def bound_words(self) -> str:
        """The bound of a level heading; where there is none, what the heading error itself is."""
        bound_deg = self.heading_bound_deg
        return f"95 % within {figures(bound_deg)}°" if bound_deg < ANY_ANGLE_DEG else "1 σ"

    @property
    def dip_words(self) -> str:
        """Dip that headings are judged at, with the sign that the recording shows, as ``dip 60° (assumed)``."""
        return f"dip {self.known_dip_deg:.3g}°{' (assumed)' if self.dip_assumed else ''}"

    def tilted_error(self, tilt_deg: float) -> HeadingError:
        """What to expect of the heading of a vehicle that is rolled or pitched, and knows how far."""
        dip, down = self.known_dip_deg, down_of(self.plane)
        return tilted_error(self.ellipsoid, self.claimed_covariance, dip_deg=dip, tilt_deg=tilt_deg, down=down)

    @property
    def attitude_limit_deg(self) -> float:
        """Tilt up to which the worst heading error is within the target: 0 where even level it is not, 180 for all."""
        dip, down = self.known_dip_deg, down_of(self.plane)
        claimed, limit = self.claimed_covariance, self.target_deg
        return attitude_limit_deg(self.ellipsoid, claimed, dip_deg=dip, limit_deg=limit, down=down)

    @property
    def per_degree_of_tilt(self) -> float:
        """Degrees by which a degree of tilt adds to the worst heading error, independent of what a level one has."""
        return float(np.sqrt(max(self.tilted_error(1.0).worst ** 2 - self.heading_error_deg.worst**2, 0.0)))

    @property
    def uncorrected_heading_error_deg(self) -> HeadingError:
        """What the heading of the same vehicle errs by without the calibration, if the calibration is right."""
        return raw_error(self.ellipsoid, dip_deg=self.known_dip_deg, down=down_of(self.plane))

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
        error = self._heading_record
        fields = {
            "verdict": self.verdict,
            "method": self.method,
            "calibration": self.calibration.as_dict(),
            "heading_error_deg": None if error is None else msgspec.structs.asdict(error),
            "uncorrected_heading_error_deg": _rms_and_worst(self.uncorrected_heading_error_deg),
            "textbook_heading_error_deg": _rms_and_worst(self.textbook_heading_error_deg),
            "alignment_error_deg": self.alignment_error_deg,
            # worst heading error (1 σ) at a tilt of 10°, 30° and 90°
            "tilted_heading_error_deg": {f"{tilt:g}": self.tilted_error(tilt).worst for tilt in TILTS},
            "attitude_limit_deg": self.attitude_limit_deg,
            "direction_error_deg": _rms_and_worst(self.direction_error_deg),
            "bias_deg": self.bias_deg,
            "prior_influence": self.prior_influence,
            "unobserved": self.unobserved,
            "noise": _stated(self.noise),
            "samples": self.samples,
            "independent_samples": min(self.independent_samples, float(self.samples)),
            "autocorrelation": self.autocorrelation,
            "outliers": [outlier.as_dict() for outlier in self.outliers],
            "distortion": self.distortion,
            "drift": None if self.drift is None else dataclasses.asdict(self.drift),
            "nonlinearity": None if self.nonlinearity is None else dataclasses.asdict(self.nonlinearity),
            "axis_lag": None if self.axis_lag is None else dataclasses.asdict(self.axis_lag),
            "conditions": list(self.conditions),
            "repeats": None if self.repeats is None else self.repeats.as_dict(),
            "coverage": self.coverage.as_dict(),
            "covariance": self.covariance.tolist(),
            **self._disturbances_as_dict(),
            **({} if self.aiding is None else {"aiding": self.aiding.as_dict()}),
            **({} if self.refreshed is None else {"refreshed": self.refreshed.as_dict()}),
            "findings": [finding.as_dict() for finding in self.findings],
        }
        untrusted = _ON_A_SURFACE if self.is_flat else _REFUSED if self.verdict == "refused" else ()
        unstated = () if self.states_uncertainty else _OF_THE_COVARIANCE
        return {**fields, **dict.fromkeys((*untrusted, *unstated))}

    def _disturbances_as_dict(self) -> dict[str, Any]:
        """What is known of the disturbances; no key where it follows none."""
        if not self.disturbances:
            return {}
        return {
            "disturbances": [each.as_dict() for each in self.disturbances],
            "noise_uncompensated": self.noise_uncompensated,
        }

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
        """The calibration file with all of this in it; of a loaded fit by default with the provenance it has."""
        return self.calibration.to_document(fit=self._record(), provenance=provenance or self.provenance)

    def _record(self) -> Fitted | None:
        """What a calibration file keeps of it beside the calibration."""
        if not self.is_described:
            return None
        covariance = tuple(tuple(row) for row in self._covariance.tolist()) if self.states_uncertainty else None
        return Fitted(
            method=self.method,
            samples=self.samples,
            noise=_stated(self.noise),
            covariance_of=self._parameters if covariance else PARAMETERS,
            covariance=covariance,
            verdict=self.verdict,
            heading_error_deg=self._heading_record,
            coverage=self.coverage.as_dict(),
            findings=self.finding_records,
            conditions=self.conditions or UNSET,
            plane=self.plane or UNSET,
            z_down=self.z_down if self.plane else UNSET,
            aiding=UNSET if self.aiding is None else self.aiding.to_record(),
        )

    @property
    def _heading_record(self) -> HeadingErrorRecord | None:
        """The heading error as it stands in a file; None where none is stated."""
        error = self.heading_error_deg
        if math.isnan(error.worst):
            return None
        bound, dip_deg = _stated(self.heading_bound_deg), _stated(error.dip_deg)
        return HeadingErrorRecord(
            rms=error.rms,
            worst=error.worst,
            bound_95=bound,
            dip_deg=dip_deg,
            dip_assumed=self.dip_assumed,
            target_deg=self.target_deg,
            structure_deg=self.structure_deg,
        )

    def __repr__(self) -> str:
        error = self.heading_error_deg
        if not self.is_described or math.isnan(error.worst):
            return f"Fit({self.verdict}, {self.method}, no heading error stated)"
        noise = "" if math.isnan(self.noise) else f"noise {figures(self.noise, 3)} {label(self.calibration.unit)}, "
        return (
            f"Fit({self.verdict}, {self.method}, heading error {error.rms:.2g}° rms, {error.worst:.2g}° worst, "
            f"{noise}{counted(self.samples, 'reading')})"
        )

    def _repr_html_(self) -> str:
        """What a notebook shows; of a refused fit no number of the calibration."""
        title = f"{SIGNS[self.verdict]} {self.verdict}: "
        title += f"{self.method}, {counted(self.samples, 'reading')}" if self.is_described else "nothing is stated"
        causes = [finding for finding in first_causes(self.findings) if finding.severity != "note"]
        words = [f"{SIGNS[finding.severity]} {advice(finding)}" for finding in causes]
        if self.verdict == "refused":
            return refusal(title, words)
        calibration = self.calibration
        good = f"headings good to {self.heading_words}, level, {self.dip_words}; the target is {self.target_deg:g}°"
        good = "no heading error stated" if math.isnan(self.heading_error_deg.worst) else good
        # pages are above this package, and found by name
        pictures = import_module("flinders.report.notebook").pictures(self) if self.states_uncertainty else ""
        return correction(
            calibration.matrix.tolist(),
            calibration.offset.tolist(),
            label(calibration.unit),
            title=title,
            words=[good, *filter(None, [stated(self.conditions)]), *words],
            offset_sigma=self.offset_sigma.tolist() if self.states_uncertainty else None,
            terms=None if calibration.linearization is None else calibration.linearization.as_dict(),
            pictures=pictures,
        )


_REFUSED: Final = ("calibration", "uncorrected_heading_error_deg")
"""Keys of a fit that are None where it is refused."""

_ON_A_SURFACE: Final = (
    *_REFUSED, "heading_error_deg", "textbook_heading_error_deg", "tilted_heading_error_deg", "attitude_limit_deg",
    "direction_error_deg", "bias_deg", "coverage",
)  # fmt: skip
"""Keys that are None where the readings are flat."""


_OF_THE_COVARIANCE: Final = (
    "tilted_heading_error_deg", "attitude_limit_deg", "direction_error_deg", "bias_deg", "covariance",
)  # fmt: skip
"""Keys that are None where no uncertainty is stated."""


def _with_record(fit: Fit, record: Fitted) -> Fit:
    """A calibration with what its file states of the fit."""
    findings = tuple(Finding.from_record(each, fit.name) for each in record.findings)
    error = record.heading_error_deg
    loaded = replace(
        fit,
        method=record.method,
        noise=math.nan if record.noise is None else record.noise,
        samples=record.samples,
        coverage=Coverage.from_dict(record.coverage),
        plane=record.plane or None,
        z_down=True if record.z_down is UNSET else record.z_down,
        aiding=None if record.aiding is UNSET else Aiding.from_record(record.aiding),
        findings=findings,
        conditions=record.conditions or (),
    )
    if error is not None:
        dip_deg = math.nan if error.dip_deg is None else error.dip_deg
        stated = HeadingError(error.rms, error.worst, dip_deg)
        known_dip_deg = fit.dip_deg if error.dip_deg is None else abs(error.dip_deg)
        target_deg = error.target_deg or fit.target_deg
        loaded = replace(loaded, heading_error_deg=stated, target_deg=target_deg)
        loaded = replace(loaded, dip_deg=known_dip_deg, dip_assumed=error.dip_assumed)
        loaded = replace(loaded, structure_deg=error.structure_deg)
        if error.structure_deg:
            across = math.radians(error.structure_deg) * math.cos(math.radians(loaded.known_dip_deg))
            loaded = replace(loaded, distortion=across * loaded.ellipsoid.radius)
        if loaded.aiding is not None:
            loaded = replace(loaded, alignment_error_deg=loaded.aiding.alignment_error_deg(known_dip_deg))
    if record.covariance is not None:
        loaded = _with_covariance(loaded, record.covariance_of, np.array(record.covariance))
    return loaded if record.verdict == loaded.verdict else replace(loaded, stated_verdict=record.verdict or "limited")


def _with_covariance(fit: Fit, names: tuple[str, ...], whole: Floats) -> Fit:
    """Give a fit the covariance (K, K) of its file.

    Raises
    ------
    DocumentError
        Unless it is a covariance of offset and shape.
    """
    missing = [parameter for parameter in PARAMETERS if parameter not in names]
    if missing:
        raise DocumentError(f"{fit.name}: fit.covariance lacks {', '.join(missing)}: need offset and shape, all nine")
    rows = [names.index(parameter) for parameter in PARAMETERS]
    covariance = whole[np.ix_(rows, rows)]
    _refuse_no_covariance(covariance, fit.name)
    is_whole = len(names) > len(PARAMETERS) and names == fit._parameters
    return replace(
        fit,
        covariance=covariance,
        disturbances_covariance=whole if is_whole else None,
    )


def _refuse_no_covariance(covariance: Floats, name: str) -> None:
    """Refuse a matrix (9, 9) that is no covariance.

    Raises
    ------
    DocumentError
    """
    largest = float(np.abs(covariance).max())
    lack = float(np.abs(covariance - covariance.T).max())
    if lack > 1e-6 * largest:
        raise DocumentError(
            f"{name}: fit.covariance is not symmetric: entries across the diagonal differ by up to {lack:.3g}"
        )
    lowest = float(np.linalg.eigvalsh(covariance)[0])
    if lowest < -1e-6 * largest:
        raise DocumentError(f"{name}: fit.covariance has the eigenvalue {lowest:.3g}: no variance is negative")


def _rms_and_worst(error: HeadingError | DirectionError | None) -> dict[str, float] | None:
    """JSON-ready."""
    return None if error is None else {"rms": error.rms, "worst": error.worst}


def fit_of(outcome: Fit | FlindersError) -> Fit | None:
    """The fit of an outcome, good or refused; None where there is none."""
    return outcome.fit if isinstance(outcome, Refused) else outcome if isinstance(outcome, Fit) else None


class Refused(FitError):
    """A fit exists and is not fit for use: `fit` holds it with its findings, for those who want to look."""

    code: ClassVar[str] = "refused"

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        reasons = [finding for finding in fit.findings if finding.severity == "refuses"]
        causes = [finding for finding in first_causes(fit.findings) if finding.severity == "refuses"]
        super().__init__("; ".join(finding.advice for finding in causes))
        self.evidence = {finding.code: finding.number for finding in reasons}
