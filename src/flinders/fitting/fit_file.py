"""Reading of a calibration file as a `Fit`, which has the numbers of the fit but not its readings.

Values that the file does not state are NaN, None or empty. Methods that need readings raise `NeedsRecording`.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.fitting.result import document_of
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> loaded = fit_from(document_of(fit), name="monday.json")
>>> loaded
Fit(good, likelihood, heading error 0.059° rms, 0.066° worst, noise 0.498 µT, 2,922 readings)
>>> loaded.evidence.coverage.counts
Traceback (most recent call last):
flinders.errors.NeedsRecording: the calibration file contains no readings, and the directions of the readings are \
needed: give the recording too, as in flinders report CALIBRATION RECORDING, or fit it again
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np
from msgspec import UNSET

from flinders.core.calibration import Calibration
from flinders.core.calibration_file import PARAMETERS, Fitted, HeadingErrorRecord, read
from flinders.core.offset_walk import Walk
from flinders.errors import DocumentError, UsageError
from flinders.findings import Finding
from flinders.fitting.aiding import Aiding
from flinders.fitting.claim import parameter_names
from flinders.fitting.evidence import Disturbances, Evidence, Residuals
from flinders.fitting.result import Fit, Judgement, Provenance, bare_fit
from flinders.heading.error_propagation import HeadingError
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document
    from flinders.fitting.claim import Claim

    AnyCalibration: TypeAlias = Fit | Calibration | str | os.PathLike[str]


def load(path: str | os.PathLike[str]) -> Fit:
    """Read the fit in a calibration file, as `Fit.save` and ``flinders calibrate`` write it.

    Raises
    ------
    DocumentError
        For a file that cannot be opened or understood, or whose covariance is not one of offset and shape.
    """
    return fit_from(read(path), name=os.fspath(path))


def fit_for(calibration: AnyCalibration) -> Fit:
    """A calibration as a `Fit`: a `Calibration` without a claim, or a file that is loaded.

    Raises `UsageError` for another type, such as a recording in the place of the calibration.
    """
    if isinstance(calibration, Fit):
        return calibration
    if isinstance(calibration, Calibration):
        return bare_fit(calibration)
    if not isinstance(cast("object", calibration), str | os.PathLike):
        given = type(calibration).__name__
        raise UsageError(
            f"calibration is of type {given}: need a Fit, a Calibration or a path; a recording comes before its "
            "calibration"
        )
    return load(calibration)


def fit_from(document: Document, *, name: str = "calibration") -> Fit:
    """The fit in the content of a calibration file; `name` is its name in messages.

    Raises
    ------
    DocumentError
        As `load`.
    """
    fit = bare_fit(Calibration.from_document(document, source=name))
    fit = replace(fit, provenance=Provenance(name, document.provenance))
    return fit if document.fit is None else _with_record(fit, document.fit)


def _with_record(fit: Fit, record: Fitted) -> Fit:
    """Add the values that a calibration file states to a fit."""
    evidence = Evidence(
        method=record.method,
        samples=record.samples,
        noise=math.nan if record.noise is None else record.noise,
        coverage=Coverage.from_dict(record.coverage),
        z_down=True if record.z_down is UNSET else record.z_down,
        aiding=None if record.aiding is UNSET else Aiding.from_record(record.aiding),
    )
    walk = None if record.walk is UNSET else Walk(record.walk.rate, record.walk.low, record.walk.high)
    claim = replace(fit.claim, plane=record.plane or None)
    if (error := record.heading_error_deg) is not None:
        claim = _with_error(claim, error, evidence.aiding)
    if error is not None and error.structure_deg:
        across = math.radians(error.structure_deg) * math.cos(math.radians(claim.known_dip_deg))
        evidence = replace(evidence, residuals=Residuals(distortion=across * fit.calibration.ellipsoid.radius))
    findings = tuple(Finding.from_record(each, fit.provenance.name) for each in record.findings)
    judgement = Judgement(findings, record.conditions or ())
    if record.verdict != judgement.verdict:
        judgement = replace(judgement, stated_verdict=record.verdict or "limited")
    provenance = replace(fit.provenance, walk=walk)
    loaded = replace(fit, evidence=evidence, claim=claim, judgement=judgement, provenance=provenance)
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
    """Add the (K, K) covariance of a calibration file to a fit.

    Raises
    ------
    DocumentError
        Unless it is a covariance of offset and shape.
    """
    name = fit.provenance.name
    missing = [parameter for parameter in PARAMETERS if parameter not in names]
    if missing:
        raise DocumentError(f"{name}: fit.covariance lacks {', '.join(missing)}: need offset and shape, all nine")
    rows = [names.index(parameter) for parameter in PARAMETERS]
    covariance = whole[np.ix_(rows, rows)]
    _refuse_no_covariance(covariance, name)
    loaded = replace(fit, claim=replace(fit.claim, covariance=covariance))
    if len(names) == len(PARAMETERS) or names != parameter_names(fit.calibration):
        return loaded
    return replace(loaded, evidence=replace(fit.evidence, disturbances=Disturbances(covariance=whole)))


def _refuse_no_covariance(covariance: Floats, name: str) -> None:
    """Refuse a (9, 9) matrix that is not a covariance.

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
