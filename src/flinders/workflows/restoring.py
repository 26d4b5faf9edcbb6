"""Restoration of a fit from its calibration file and a recording, without a new fit.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.fitting.fit_file import fit_from
>>> from flinders.fitting.result import document_of
>>> samples = simulate.tumble(seed=1).samples
>>> fit = calibrate.fit(samples)
>>> again = restore(samples, fit_from(document_of(fit)))
>>> again.fit.verdict, abs(again.fit.heading_error_deg.worst - fit.heading_error_deg.worst) < 1e-9, again.notes
('good', True, ())
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.comparison.comparison import LengthSums
from flinders.core.compensation import compensate_recording
from flinders.core.joining import read_into_memory, single_recordings
from flinders.core.keywords import check_keywords
from flinders.findings import by_severity, certain_finding
from flinders.fitting.fit_file import fit_for
from flinders.summary.cloud import Cloud
from flinders.summary.coverage import Coverage
from flinders.workflows.correction import PARAMETERS_ELSEWHERE
from flinders.workflows.notes import Note
from flinders.workflows.recordings import own_recordings, recording_for

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.fitting.result import Fit
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.workflows.recordings import AnyReadings

MIN_STRENGTH, MAX_STRENGTH = 0.97, 1.03
"""Limits of the mean length of corrected readings in a matching recording, relative to the calibration's field."""

MAX_SPREAD: Final = 0.05
"""Largest spread of the lengths in a matching recording, relative to their mean."""


@dataclass(frozen=True, slots=True, eq=False)
class RestoredFit:
    """A fit restored from a calibration and a recording."""

    known: Fit  #: calibration as it was loaded
    recording: Recording  #: recording in the unit and axes of the calibration
    fit: Fit  #: calibration with the noise and coverage of the recording, if it states none itself
    notes: tuple[Note, ...]  #: notes on a recording that does not match


@check_keywords(PARAMETERS_ELSEWHERE)
def restore(
    source: AnyReadings, calibration: AnyCalibration, *, target_deg: float | None = None, dip_deg: float | None = None
) -> RestoredFit:
    """Combine a loaded calibration with a recording, for reports and figures.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file, data frame, or list of these but arrays
        Raw readings, as for `flinders.apply`: those of the calibration, or others from the same sensor.
    calibration : Fit, Calibration or path
        Calibration. If it states no uncertainty, the result claims none and has a finding about that.
    target_deg, dip_deg : float, degrees
        Target, and dip for the heading error; by default those of the file, else 1° and 60°.

    Raises
    ------
    InputError, UnitError, AxesError
        The errors of `flinders.apply`.
    """
    known = fit_for(calibration)
    recorded = recording_for(source, known)
    field = read_into_memory(compensate_recording(recorded, known.calibration)).field
    parts = list(single_recordings(recorded))
    is_own = len(own_recordings(known, parts)) == len(parts)
    notes = () if is_own else tuple(_notes(known, field))
    return RestoredFit(known, recorded, _restore(known, field, target_deg, dip_deg), notes)


def _notes(known: Fit, field: Floats) -> Iterator[Note]:
    """Notes if (N, 3) compensated readings of another recording do not match the calibration."""
    strength = LengthSums.of_corrected(known.calibration.affine, field)
    if not MIN_STRENGTH <= strength.mean <= MAX_STRENGTH or strength.spread > MAX_SPREAD:
        yield Note("odd-strength", values={"mean": strength.mean, "spread": strength.spread})
    if known.provenance.files:
        yield Note("other-recording")


def _restore(fit: Fit, field: Floats, target_deg: float | None, dip_deg: float | None) -> Fit:
    """The fit with noise and coverage of (N, 3) compensated readings; a new dip changes its heading error."""
    dip = fit.claim.known_dip_deg if dip_deg is None else math.copysign(dip_deg, dip_deg * fit.claim.known_dip_deg)
    no_uncertainty = certain_finding({"is_unstated": 1.0, "unstated_deg": math.nan}, "no-uncertainty")
    unstated = () if fit.claim.states_uncertainty else (no_uncertainty,)
    strength = LengthSums.of_corrected(fit.calibration.affine, field)
    noise = fit.calibration.field_strength * math.hypot(strength.mean - 1.0, strength.spread)
    evidence = replace(
        fit.evidence,
        noise=noise if math.isnan(fit.evidence.noise) else fit.evidence.noise,
        samples=fit.evidence.samples if fit.evidence.is_described else len(field),
        coverage=_coverage(field, fit.calibration.ellipsoid),
        disturbances=replace(fit.evidence.disturbances, covariance=None),
        aiding=None,
    )
    claim = replace(
        fit.claim,
        heading_error_deg=fit.claim.level_error(dip),
        target_deg=target_deg or fit.claim.target_deg,
        dip_deg=abs(dip) if dip_deg is None else dip_deg,
    )
    judgement = replace(fit.judgement, findings=by_severity([*fit.findings, *unstated]))
    return replace(fit, evidence=evidence, claim=claim, judgement=judgement)


def _coverage(field: Floats, ellipsoid: Ellipsoid) -> Coverage:
    """Coverage of directions by readings, as the calibration corrects them."""
    if not len(field):
        return Coverage.of(np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
    return Coverage.of_cloud(Cloud.of(field), ellipsoid)
