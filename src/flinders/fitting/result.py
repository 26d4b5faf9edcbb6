"""`Fit`, the result of each fit: calibration, evidence, claim, judgement and provenance.

A fit has these five values as attributes. Their most used properties are also attributes of the fit itself.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> fit
Fit(good, likelihood, heading error 0.059° rms, 0.066° worst, noise 0.498 µT, 2,922 readings)
>>> [name for name in dir(fit) if not name.startswith("_")]
['calibration', 'claim', 'evidence', 'findings', 'heading_error_deg', 'judgement', 'plot', 'provenance', 'save', \
'verdict']
>>> fit.evidence.method, fit.claim.target_deg, fit.judgement.conditions, fit.provenance.name
('likelihood', 1.0, ('uniform-field', 'constant-iron'), 'fit')
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, TypeAlias, overload

from msgspec import UNSET

from flinders.core.above import UPPER_FUNCTIONS
from flinders.core.calibration_file import PARAMETERS, Fitted, HeadingErrorRecord, write
from flinders.core.short_repr import ShortRepr
from flinders.core.units import unit_label
from flinders.errors import FitError, count_text, figures
from flinders.findings import VERDICTS, Finding, Verdict, first_causes
from flinders.fitting.claim import Claim, parameter_names
from flinders.fitting.evidence import Evidence
from flinders.fitting.good_until import good_until, recording_date, walk_record

if TYPE_CHECKING:
    import os

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import Document, FindingRecord, ProvenanceRecord, SourceFile
    from flinders.core.figure import Figure
    from flinders.core.offset_walk import Walk
    from flinders.core.samples import Recording
    from flinders.errors import FlindersError
    from flinders.findings import Condition
    from flinders.heading.error_propagation import HeadingError
    from flinders.readers import AnySource

    AnyReadings: TypeAlias = Recording | ArrayLike | AnySource


class Judged:
    """Base of values with findings, which give a verdict."""

    __slots__ = ()
    findings: tuple[Finding, ...]  #: most severe first

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``, by the most severe finding."""
        severities = {finding.severity for finding in self.findings}
        return next((verdict for severity, verdict in VERDICTS.items() if severity in severities), "good")

    @property
    def finding_records(self) -> tuple[FindingRecord, ...]:
        """Records of the findings for a calibration file."""
        return tuple(finding.to_record() for finding in self.findings)


class Outcome:
    """Base of results that can be written to a calibration file."""

    __slots__ = ()

    def to_document(self, provenance: ProvenanceRecord | None = None) -> Document:
        """Content of the calibration file."""
        raise NotImplementedError

    def save(
        self, path: str | os.PathLike[str], *, force: bool = False, provenance: ProvenanceRecord | None = None
    ) -> None:
        """Write the calibration file atomically.

        Raises
        ------
        OutputExists
            If the file exists, unless `force`.
        OutputError
            If the file cannot be written.
        """
        write(self.to_document(provenance), path, force=force)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Judgement(Judged):
    """Findings, conditions and verdict of a fit."""

    findings: tuple[Finding, ...] = ()  #: most severe first
    #: conditions of the verdict, which a recording of this kind cannot test: for example, that the field was uniform,
    #: and that no current or iron near the sensor changed with the attitude
    conditions: tuple[Condition, ...] = ()
    stated_verdict: Verdict | None = None  #: verdict in the file, if its findings do not explain it

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``, by the most severe finding or the calibration file."""
        verdicts = {self.stated_verdict, Judged.verdict.__get__(self)}
        return next(verdict for verdict in VERDICTS.values() if verdict in verdicts)

    def __repr__(self) -> str:
        codes = ", ".join(finding.code for finding in self.findings) or "no findings"
        return f"Judgement({self.verdict}: {codes}{'; holds if ' * bool(self.conditions)}{', '.join(self.conditions)})"

    @property
    def is_flat(self) -> bool:
        """Whether the readings lie in one plane, so that no number of the ellipsoid can be trusted."""
        return any(finding.code == "one-plane" for finding in self.findings)


@dataclass(frozen=True, slots=True, repr=False)
class Provenance(ShortRepr):
    """Name of a fit in messages, and its origin: release, date and recordings."""

    name: str = "fit"  #: name in messages; for a loaded fit the path of its file
    record: ProvenanceRecord | None = None  #: release, date and recordings, if the calibration file states them
    #: the readings; only in the process that fitted them, as files, pickles and copies do not contain them
    recording: Recording | None = None
    walk: Walk | None = None  #: random walk of the offset of this unit, if its history is known

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without the readings."""
        return Provenance, (self.name, self.record, None, self.walk)

    @property
    def files(self) -> tuple[SourceFile, ...]:
        """Files of the recordings, if the calibration file states them."""
        return self.record.files if self.record else ()


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A calibration with its evidence, claim, judgement and provenance, and the most used properties of these."""

    calibration: Calibration  #: the correction; null in ``--json`` if the fit is refused
    evidence: Evidence  #: method of the calibration, and properties of its readings
    claim: Claim  #: covariance of the calibration, and the errors that follow from it
    judgement: Judgement  #: findings, verdict, and conditions of the verdict
    provenance: Provenance = Provenance()  #: name in messages; release, date and recordings of a loaded file

    @overload
    def plot(self, kind: str = "sphere", recording: AnyReadings | None = None) -> Figure: ...
    @overload
    def plot(self, kind: str = "sphere", recording: AnyReadings | None = None, *, ax: Axes) -> Axes: ...
    def plot(
        self, kind: str = "sphere", recording: AnyReadings | None = None, *, ax: Axes | None = None
    ) -> Figure | Axes:
        """Draw a figure of the fit, for a notebook or into given axes of matplotlib.

        Parameters
        ----------
        kind : str
            ``sphere``: readings before and after correction, and the expected heading error in each direction;
            ``residuals``: difference of the length of each corrected reading and the field strength, over time;
            ``deviation``: heading error of a level vehicle over its heading, before and after correction;
            ``strength``: length of each corrected reading over time, with the limit for disturbed readings.
        recording : Recording, (N, 3) array-like, path, open file or data frame, optional
            The readings; required for a loaded fit.
        ax : axes of matplotlib, optional
            Axes to draw into.

        Returns
        -------
        Figure or Axes
            Figure with a method ``save``; `ax` if given.

        Raises
        ------
        NeedsRecording
            For a loaded fit without `recording`.
        UsageError
            For an unknown kind, or the deviation of a fit that states no uncertainty.
        """
        drawn: Figure | Axes = UPPER_FUNCTIONS["plot"](self, kind, recording, ax=ax)
        return drawn

    def save(
        self, path: str | os.PathLike[str], *, force: bool = False, provenance: ProvenanceRecord | None = None
    ) -> None:
        """Write the calibration file atomically; `flinders.load` reads it.

        Raises
        ------
        OutputExists
            If the file exists, unless `force`.
        OutputError
            If the file cannot be written.
        """
        write(document_of(self, provenance), path, force=force)

    def _repr_html_(self) -> str:
        return str(UPPER_FUNCTIONS["html"](self))

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``, by the most severe finding or the calibration file."""
        return self.judgement.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings, most severe first."""
        return self.judgement.findings

    @property
    def heading_error_deg(self) -> HeadingError:
        """Expected heading error of a level vehicle, 1 σ; NaN if not stated."""
        return self.claim.heading_error_deg

    def __repr__(self) -> str:
        error, evidence = self.heading_error_deg, self.evidence
        if not evidence.is_described or math.isnan(error.worst):
            return f"Fit({self.verdict}, {evidence.method}, no heading error stated)"
        unit = unit_label(self.calibration.unit)
        noise = "" if math.isnan(evidence.noise) else f"noise {figures(evidence.noise, 3)} {unit}, "
        return (
            f"Fit({self.verdict}, {evidence.method}, heading error {error.rms:.2g}° rms, {error.worst:.2g}° worst, "
            f"{noise}{count_text(evidence.samples, 'reading')})"
        )


def bare_fit(calibration: Calibration, *, name: str = "fit") -> Fit:
    """A fit that consists of a calibration without evidence; its verdict is ``limited``."""
    unexplained = Judgement(stated_verdict="limited")
    return Fit(calibration, Evidence(), Claim(calibration), unexplained, Provenance(name))


def with_calibration(fit: Fit, calibration: Calibration) -> Fit:
    """The same fit with another calibration, also in its claim."""
    return replace(fit, calibration=calibration, claim=replace(fit.claim, calibration=calibration))


def with_walk(fit: Fit, walk: Walk | None) -> Fit:
    """The same fit with the random walk of its unit's offset, which the calibration file then states."""
    return replace(fit, provenance=replace(fit.provenance, walk=walk))


def with_name(fit: Fit, name: str) -> Fit:
    """The same fit with another name."""
    return replace(fit, provenance=replace(fit.provenance, name=name))


def with_recording(fit: Fit, recording: Recording | None) -> Fit:
    """The same fit with the recording of its readings."""
    return replace(fit, provenance=replace(fit.provenance, recording=recording))


def document_of(fit: Fit, provenance: ProvenanceRecord | None = None) -> Document:
    """Content of the calibration file of a fit; `provenance` is by default that of a loaded fit."""
    origin = provenance or fit.provenance.record
    return fit.calibration.to_document(fit=_record(fit, origin), provenance=origin)


def _record(fit: Fit, origin: ProvenanceRecord | None) -> Fitted | None:
    """Record of the fit for a calibration file; None if the fit states nothing but the calibration."""
    evidence, claim = fit.evidence, fit.claim
    if not evidence.is_described:
        return None
    joint = evidence.disturbances.covariance
    until = good_until(fit)
    rows = (claim.covariance if joint is None else joint).tolist()
    covariance = tuple(map(tuple, rows)) if claim.states_uncertainty else None
    return Fitted(
        method=evidence.method,
        samples=evidence.samples,
        noise=finite_or_none(evidence.noise),
        covariance_of=parameter_names(fit.calibration) if covariance else PARAMETERS,
        covariance=covariance,
        verdict=fit.verdict,
        heading_error_deg=heading_record(claim),
        good_until=UNSET if until is None else until.to_record(recording_date(origin)),
        walk=UNSET if fit.provenance.walk is None else walk_record(fit.provenance.walk),
        coverage=evidence.coverage.as_dict(),
        findings=fit.judgement.finding_records,
        conditions=fit.judgement.conditions or UNSET,
        plane=claim.plane or UNSET,
        z_down=evidence.z_down if claim.plane else UNSET,
        aiding=UNSET if evidence.aiding is None else evidence.aiding.to_record(),
    )


def heading_record(claim: Claim) -> HeadingErrorRecord | None:
    """Record of the heading error for a file; None if not stated."""
    error = claim.heading_error_deg
    if math.isnan(error.worst):
        return None
    return HeadingErrorRecord(
        rms=error.rms,
        worst=error.worst,
        bound_95=finite_or_none(claim.heading_bound_deg),
        dip_deg=finite_or_none(error.dip_deg),
        dip_assumed=claim.dip_assumed,
        target_deg=claim.target_deg,
        structure_deg=claim.structure_deg,
    )


def finite_or_none(number: float) -> float | None:
    """A number for a file; None for NaN."""
    return None if math.isnan(number) else number


def fit_of(outcome: Fit | FlindersError) -> Fit | None:
    """The fit in an outcome of fitting, which may be the error of a refused fit; None for other errors."""
    return outcome.fit if isinstance(outcome, Refused) else outcome if isinstance(outcome, Fit) else None


class Refused(FitError):
    """A fit must not be used; the attribute `fit` has the fit with its findings."""

    code: ClassVar[str] = "refused"

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        reasons = [finding for finding in fit.findings if finding.severity == "refuses"]
        causes = [finding for finding in first_causes(fit.findings) if finding.severity == "refuses"]
        super().__init__("; ".join(finding.advice for finding in causes))
        self.evidence = {finding.code: finding.number for finding in reasons}


def tilt_words(fit: Fit) -> str:
    """Sentence on the largest tilt at which the fit of a level turn meets its target; empty for other fits."""
    limit = next((finding.number for finding in fit.findings if finding.code == "level-plane"), None)
    if limit is None:
        return ""
    if not limit >= 1.0:
        return "it is based on a level turn: for a level vehicle only"
    within = "its target" if math.isnan(fit.heading_error_deg.worst) else f"{fit.claim.target_deg:g}°"
    return f"it is based on a level turn: within {within} up to {limit:.0f}° of tilt"
