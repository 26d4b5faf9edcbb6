"""`Fit` is the only result: a calibration with its evidence, the claim that follows, its judgement and its provenance.

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

import math
import os
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np
from msgspec import UNSET

from flinders.core.calibration import Calibration
from flinders.core.calibration_file import PARAMETERS, Fitted, HeadingErrorRecord, read, write
from flinders.core.displays import DISPLAYS
from flinders.core.units import label
from flinders.errors import DocumentError, FitError, counted, figures
from flinders.findings import VERDICTS, Finding, Verdict, first_causes
from flinders.fitting.aiding import Aiding
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Disturbances, Evidence, Residuals
from flinders.heading.error_propagation import DirectionError, HeadingError
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document, FindingRecord, ProvenanceRecord, SourceFile
    from flinders.core.samples import Recording
    from flinders.errors import FlindersError
    from flinders.findings import Condition

TILTS: Final = (10.0, 30.0, 90.0)
"""Degrees of tilt at which it is said how much worse headings get."""


class Judged:
    """What has findings has a verdict."""

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


class Outcome:
    """What a calibration file can be written of."""

    __slots__ = ()

    def to_document(self, provenance: ProvenanceRecord | None = None) -> Document:
        """The calibration file with all of this in it."""
        raise NotImplementedError

    def save(
        self, path: str | os.PathLike[str], *, force: bool = False, provenance: ProvenanceRecord | None = None
    ) -> None:
        """Write the calibration file, whole or not at all.

        Raises
        ------
        OutputExists
            Where there is a file already, unless `force`.
        OutputError
            Where it cannot be written.
        """
        write(self.to_document(provenance), path, force=force)


@dataclass(frozen=True, slots=True, eq=False)
class Judgement(Judged):
    """What is said of a fit."""

    findings: tuple[Finding, ...] = ()  #: most severe first
    #: what a verdict rests on and no recording of this kind shows: that the field is the same wherever the sensor
    #: was, and that neither current nor iron near it changed with its attitude. Other evidence ends them.
    conditions: tuple[Condition, ...] = ()
    stated_verdict: Verdict | None = None  #: verdict that a file states and its findings do not explain

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the most severe finding or the file says."""
        verdicts = {self.stated_verdict, Judged.verdict.__get__(self)}
        return next(verdict for verdict in VERDICTS.values() if verdict in verdicts)

    @property
    def is_flat(self) -> bool:
        """The readings lie in one plane: there is no sphere to have seen a part of, and no number to trust."""
        return any(finding.code == "one-plane" for finding in self.findings)


@dataclass(frozen=True, slots=True)
class Provenance:
    """What messages call a fit, and what its file states of where it comes from."""

    name: str = "fit"  #: of a fit that was loaded, the path of its file
    record: ProvenanceRecord | None = None  #: release, date and recordings, of a file that states them

    @property
    def files(self) -> tuple[SourceFile, ...]:
        """The recordings that it came from, where a file states them."""
        return self.record.files if self.record else ()


def _stated(number: float) -> float | None:
    """A number as it stands in a file, where there is no NaN."""
    return None if math.isnan(number) else number


@dataclass(frozen=True, slots=True, eq=False)
class Fit(Outcome):
    """A calibration, how it was found and how far to trust it: five values, and what is asked of them most."""

    calibration: Calibration  #: the correction; ``--json`` has null where it is refused
    evidence: Evidence  #: how it was found, and what the readings showed
    claim: Claim  #: its covariance, and the errors that follow of it
    judgement: Judgement  #: findings, verdict, and what a verdict rests on
    provenance: Provenance = Provenance()  #: what messages call it; release, date and recordings of a loaded file

    def plot(self, recording: Recording, what: str = "all") -> Figure:
        """Draw the fit and its recording with matplotlib, as `flinders.report.matplotlib.plot` does."""
        figure: Figure = DISPLAYS["plot"](self, recording, what)
        return figure

    def _repr_html_(self) -> str:
        return str(DISPLAYS["html"](self))

    @classmethod
    def of(cls, calibration: Calibration, *, name: str = "fit") -> Fit:
        """A calibration of which nothing else is stated: its verdict is limited."""
        unexplained = Judgement(stated_verdict="limited")
        return cls(calibration, Evidence(), Claim(calibration), unexplained, Provenance(name))

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
        fit = cls.of(Calibration.from_document(document, source=name))
        fit = replace(fit, provenance=Provenance(name, document.provenance))
        return fit if document.fit is None else _with_record(fit, document.fit)

    def with_calibration(self, calibration: Calibration) -> Fit:
        """The same fit with another calibration, which its claim is then about."""
        return replace(self, calibration=calibration, claim=replace(self.claim, calibration=calibration))

    def with_name(self, name: str) -> Fit:
        """The same fit by another name."""
        return replace(self, provenance=replace(self.provenance, name=name))

    @property
    def name(self) -> str:
        """What messages call it: the path of a file that was loaded."""
        return self.provenance.name

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the most severe finding or the file says; limited if none does."""
        return self.judgement.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Most severe first."""
        return self.judgement.findings

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """What a verdict rests on and no recording shows, such as a field that is the same everywhere."""
        return self.judgement.conditions

    @property
    def heading_error_deg(self) -> HeadingError:
        """What to expect of a level vehicle, 1 σ; NaN if not stated."""
        return self.claim.heading_error_deg

    @property
    def method(self) -> str:
        """What was run in the end; ``not stated`` where a file says nothing but the calibration."""
        return self.evidence.method

    @property
    def samples(self) -> int:
        """Readings used; 0 if not stated."""
        return self.evidence.samples

    @property
    def noise(self) -> float:
        """Standard deviation of the distance from the ellipsoid, in the calibration's unit; NaN if not stated."""
        return self.evidence.noise

    @property
    def coverage(self) -> Coverage:
        """Directions seen. Of a loaded fit only its numbers are known, not the readings of each direction."""
        return self.evidence.coverage

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints.

        What a refusal makes untrustworthy is None, so that nobody copies it: the calibration and what follows from
        it, and of flat readings all that rests on a surface. The evidence stays, and so do the attributes.
        """
        error, claim, evidence = self._heading_record, self.claim, self.evidence
        diagnosis, residuals = evidence.diagnosis, evidence.residuals
        fields = {
            "verdict": self.verdict,
            "method": self.method,
            "calibration": self.calibration.as_dict(),
            "heading_error_deg": None if error is None else msgspec.structs.asdict(error),
            "uncorrected_heading_error_deg": _rms_and_worst(claim.uncorrected_heading_error_deg),
            "textbook_heading_error_deg": _rms_and_worst(claim.textbook_heading_error_deg),
            "alignment_error_deg": claim.alignment_error_deg,
            # worst heading error (1 σ) at a tilt of 10°, 30° and 90°
            "tilted_heading_error_deg": {f"{tilt:g}": claim.tilted_error(tilt).worst for tilt in TILTS},
            "attitude_limit_deg": claim.attitude_limit_deg,
            "direction_error_deg": _rms_and_worst(claim.direction_error_deg),
            "bias_deg": claim.bias_deg,
            "prior_influence": evidence.prior_influence,
            "unobserved": evidence.unobserved,
            "noise": _stated(self.noise),
            "samples": self.samples,
            "independent_samples": min(residuals.independent_samples, float(self.samples)),
            "autocorrelation": residuals.autocorrelation,
            "outliers": [outlier.as_dict() for outlier in evidence.outliers],
            "distortion": residuals.distortion,
            "drift": None if diagnosis.drift is None else asdict(diagnosis.drift),
            "nonlinearity": None if diagnosis.nonlinearity is None else asdict(diagnosis.nonlinearity),
            "axis_lag": None if diagnosis.axis_lag is None else asdict(diagnosis.axis_lag),
            "conditions": list(self.conditions),
            "repeats": None if diagnosis.repeats is None else diagnosis.repeats.as_dict(),
            "coverage": self.coverage.as_dict(),
            "covariance": claim.covariance.tolist(),
            **self._disturbances_as_dict(),
            **({} if evidence.aiding is None else {"aiding": evidence.aiding.as_dict()}),
            **({} if diagnosis.refreshed is None else {"refreshed": diagnosis.refreshed.as_dict()}),
            "findings": [finding.as_dict() for finding in self.findings],
        }
        untrusted = _ON_A_SURFACE if self.judgement.is_flat else _REFUSED if self.verdict == "refused" else ()
        unstated = () if self.claim.states_uncertainty else _OF_THE_COVARIANCE
        return {**fields, **dict.fromkeys((*untrusted, *unstated))}

    def _disturbances_as_dict(self) -> dict[str, Any]:
        """What is known of the disturbances; no key where it follows none."""
        disturbances = self.evidence.disturbances
        if not disturbances.estimates:
            return {}
        return {
            "disturbances": [each.as_dict() for each in disturbances.estimates],
            "noise_uncompensated": disturbances.noise_uncompensated,
        }

    @property
    def _covariance(self) -> Floats:
        """That of all parameters, the disturbances among them."""
        joint = self.evidence.disturbances.covariance
        return self.claim.covariance if joint is None else joint

    @property
    def _parameters(self) -> tuple[str, ...]:
        """What the rows of that stand for."""
        disturbances = self.calibration.disturbances
        named = [f"{disturbance.kind.key}_{axis}" for disturbance in disturbances for axis in "xyz"]
        growth = [f"{disturbance.kind.key}_scale" for disturbance in disturbances if disturbance.name == "temperature"]
        return (*PARAMETERS, *named, *growth)

    def to_document(self, provenance: ProvenanceRecord | None = None) -> Document:
        """The calibration file with all of this in it; of a loaded fit by default with the provenance it has."""
        return self.calibration.to_document(fit=self._record(), provenance=provenance or self.provenance.record)

    def _record(self) -> Fitted | None:
        """What a calibration file keeps of it beside the calibration."""
        if not self.evidence.is_described:
            return None
        covariance = tuple(tuple(row) for row in self._covariance.tolist()) if self.claim.states_uncertainty else None
        return Fitted(
            method=self.method,
            samples=self.samples,
            noise=_stated(self.noise),
            covariance_of=self._parameters if covariance else PARAMETERS,
            covariance=covariance,
            verdict=self.verdict,
            heading_error_deg=self._heading_record,
            coverage=self.coverage.as_dict(),
            findings=self.judgement.finding_records,
            conditions=self.conditions or UNSET,
            plane=self.claim.plane or UNSET,
            z_down=self.evidence.z_down if self.claim.plane else UNSET,
            aiding=UNSET if self.evidence.aiding is None else self.evidence.aiding.to_record(),
        )

    @property
    def _heading_record(self) -> HeadingErrorRecord | None:
        """The heading error as it stands in a file; None where none is stated."""
        error = self.heading_error_deg
        if math.isnan(error.worst):
            return None
        bound, dip_deg = _stated(self.claim.heading_bound_deg), _stated(error.dip_deg)
        return HeadingErrorRecord(
            rms=error.rms,
            worst=error.worst,
            bound_95=bound,
            dip_deg=dip_deg,
            dip_assumed=self.claim.dip_assumed,
            target_deg=self.claim.target_deg,
            structure_deg=self.claim.structure_deg,
        )

    def __repr__(self) -> str:
        error = self.heading_error_deg
        if not self.evidence.is_described or math.isnan(error.worst):
            return f"Fit({self.verdict}, {self.method}, no heading error stated)"
        noise = "" if math.isnan(self.noise) else f"noise {figures(self.noise, 3)} {label(self.calibration.unit)}, "
        return (
            f"Fit({self.verdict}, {self.method}, heading error {error.rms:.2g}° rms, {error.worst:.2g}° worst, "
            f"{noise}{counted(self.samples, 'reading')})"
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
    evidence = Evidence(
        method=record.method,
        samples=record.samples,
        noise=math.nan if record.noise is None else record.noise,
        coverage=Coverage.from_dict(record.coverage),
        z_down=True if record.z_down is UNSET else record.z_down,
        aiding=None if record.aiding is UNSET else Aiding.from_record(record.aiding),
    )
    claim = replace(fit.claim, plane=record.plane or None)
    if (error := record.heading_error_deg) is not None:
        claim = _with_error(claim, error, evidence.aiding)
    if error is not None and error.structure_deg:
        across = math.radians(error.structure_deg) * math.cos(math.radians(claim.known_dip_deg))
        evidence = replace(evidence, residuals=Residuals(distortion=across * fit.calibration.ellipsoid.radius))
    findings = tuple(Finding.from_record(each, fit.name) for each in record.findings)
    judgement = Judgement(findings, record.conditions or ())
    if record.verdict != judgement.verdict:
        judgement = replace(judgement, stated_verdict=record.verdict or "limited")
    loaded = replace(fit, evidence=evidence, claim=claim, judgement=judgement)
    if record.covariance is None:
        return loaded
    return _with_covariance(loaded, record.covariance_of, np.array(record.covariance))


def _with_error(claim: Claim, error: HeadingErrorRecord, aiding: Aiding | None) -> Claim:
    """The claim with the heading error that the calibration file states."""
    dip_deg = math.nan if error.dip_deg is None else error.dip_deg
    known_dip_deg = claim.dip_deg if error.dip_deg is None else abs(error.dip_deg)
    return replace(
        claim,
        heading_error_deg=HeadingError(error.rms, error.worst, dip_deg),
        target_deg=error.target_deg or claim.target_deg,
        dip_deg=known_dip_deg,
        dip_assumed=error.dip_assumed,
        structure_deg=error.structure_deg,
        alignment_error_deg=None if aiding is None else aiding.alignment_error_deg(known_dip_deg),
    )


def _with_covariance(fit: Fit, names: tuple[str, ...], whole: Floats) -> Fit:
    """Give a fit the covariance (K, K) of its file.

    Raises
    ------
    DocumentError
        Unless it is a covariance of offset and shape.
    """
    name = fit.name
    missing = [parameter for parameter in PARAMETERS if parameter not in names]
    if missing:
        raise DocumentError(f"{name}: fit.covariance lacks {', '.join(missing)}: need offset and shape, all nine")
    rows = [names.index(parameter) for parameter in PARAMETERS]
    covariance = whole[np.ix_(rows, rows)]
    _refuse_no_covariance(covariance, name)
    loaded = replace(fit, claim=replace(fit.claim, covariance=covariance))
    if len(names) == len(PARAMETERS) or names != fit._parameters:
        return loaded
    return replace(loaded, evidence=replace(fit.evidence, disturbances=Disturbances(covariance=whole)))


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


def tilt_words(fit: Fit) -> str:
    """Up to which tilt a fit that rests on a level turn is within its target; nothing for any other."""
    limit = next((finding.number for finding in fit.findings if finding.code == "level-plane"), None)
    if limit is None:
        return ""
    if not limit >= 1.0:
        return "it rests on a level turn: for a level vehicle only"
    within = "its target" if math.isnan(fit.heading_error_deg.worst) else f"{fit.claim.target_deg:g}°"
    return f"it rests on a level turn: within {within} up to {limit:.0f}° of tilt"
