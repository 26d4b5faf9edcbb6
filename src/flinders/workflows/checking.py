"""Check of a calibration on another recording, and the motion of its offset meanwhile.

>>> from dataclasses import replace
>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> fit = calibrate.fit(tumble.samples)
>>> check(simulate.tumble(seed=2, sensor=tumble.sensor).samples, fit).answer
'holds'
>>> moved = replace(tumble.sensor, offset=tumble.sensor.offset + [5.0, 0.0, 0.0])
>>> check(simulate.tumble(seed=3, sensor=moved).samples, fit).answer
'fails'
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

from flinders.comparison.comparison import LengthSums, common_dip_deg
from flinders.comparison.level_plane import compare_on
from flinders.core.compensation import Compensator, compensate_recording
from flinders.core.joining import single_recordings
from flinders.core.keywords import check_keywords
from flinders.diagnostics.random_walk import walk_through
from flinders.errors import NeedsSamples, TooFewSamples
from flinders.fitting.calibrate import fit
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Refused, with_name
from flinders.fitting.verdict import extrapolation_findings
from flinders.likelihood.site_field import Site, recorded_site
from flinders.readers import open_recording
from flinders.workflows.correction import PARAMETERS_ELSEWHERE
from flinders.workflows.onboard import onboard_fit
from flinders.workflows.recordings import compensation_at, fit_for, own_recordings, recording_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.comparison.comparison import Comparison
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.findings import Finding
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer
    from flinders.workflows.recordings import AnyCalibration, AnyReadings


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """A calibration compared with a fresh fit of another recording."""

    known: Fit  #: the calibration, for compensated readings
    fresh: Fit  #: fit of the recording; may be a refused fit
    comparison: Comparison | None  #: comparison of both; None if the fresh fit cannot be used
    refusal: Refused | None  #: why the fresh fit cannot be used
    strength: LengthSums  #: of the recording, corrected with the calibration
    fresh_strength: LengthSums | None  #: of the recording, corrected with the fresh fit
    made_from: tuple[str, ...]  #: names of those recordings from which the calibration was made, which prove nothing
    random_walk: RandomWalk | None  #: motion of the offset in the recording, if `follow`
    #: findings on disturbances beyond the range of the calibration; None if it follows none
    extrapolated: tuple[Finding, ...] | None
    target_deg: float  #: worst heading difference that is good enough
    dip_deg: float  #: inclination for the recording if it states no site

    @property
    def answer(self) -> Answer:
        """Whether the calibration holds, as `Comparison.answer`.

        It is also ``cannot-tell`` if the recording cannot be fitted, or if the calibration was made from it and does
        not fail.
        """
        if self.comparison is None:
            return "cannot-tell"
        return "cannot-tell" if self.made_from and self.comparison.answer == "holds" else self.comparison.answer

    @property
    def limiting(self) -> Finding | None:
        """Finding of the fresh fit that prevents a decision; None with a decision, or if the other claim is wider."""
        is_fresh = self.comparison is None or self.comparison.wider_claim == "b"
        limits = (each for each in self.fresh.findings if each.severity != "note")
        return next(limits, None) if self.answer == "cannot-tell" and is_fresh and not self.made_from else None

    def __repr__(self) -> str:
        if self.comparison is None:
            why = "" if self.refusal is None else f", {self.refusal.code}"
            return f"Check({self.answer}{why}: the recording cannot be fitted)"
        heading, chance = self.comparison.heading_difference_deg, self.comparison.p_value
        parts = (
            self.answer,
            f"heading difference {heading.rms:.2g}° rms, {heading.worst:.2g}° worst",
            "no uncertainty stated" if chance is None else f"p = {chance:.2g}",
            f"target {self.target_deg:g}°",
            f"fresh fit {self.fresh.verdict}",
        )
        return f"Check({', '.join(parts)})"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; without the refusal of a recording that cannot be fitted."""
        strength, fresh = self.strength.as_dict(), json_of(self.fresh)
        if self.comparison is None or self.fresh_strength is None:
            return {
                "answer": self.answer,
                # strength of the readings, corrected with the `calibration` and with the `fresh` fit
                "residual": {"calibration": strength},
                "fresh": fresh,  # the fit of the recording, as in `calibrate --json`
                **self._drift(self.dip_deg),
            }
        limiting = self.limiting
        result = {
            **self.comparison.as_dict(),
            "answer": self.answer,
            "residual": {"calibration": strength, "fresh": self.fresh_strength.as_dict()},
            "own_recordings": list(self.made_from),  # recordings from which the calibration was made, which prove
            # nothing code of the finding of the fresh fit that prevents a decision; null with a decision or without
            # such a finding
            "limiting_finding": None if limiting is None else limiting.code,
            "fresh": fresh,
            **self._drift(self.comparison.heading_difference_deg.dip_deg),
        }
        if self.extrapolated is not None:
            result["findings"] = [finding.as_dict() for finding in self.extrapolated]  # disturbances beyond their range
        return result

    def _drift(self, dip_deg: float) -> dict[str, Any]:
        """Motion of the offset, JSON-ready."""
        walk = self.random_walk
        return {} if walk is None else {"drift": walk.as_dict(level_deg=self.target_deg, dip_deg=abs(dip_deg))}


@check_keywords(PARAMETERS_ELSEWHERE)
def check(
    source: AnyReadings,
    calibration: AnyCalibration | None = None,
    *,
    target_deg: float = 1.0,
    site: Site | None = None,
    at: Mapping[str, float] | None = None,
    follow: bool = False,
) -> Check:
    """Fit a recording and compare an earlier calibration with the fit.

    Turn the sensor through all directions, as for a calibration. With a level turn both are compared in its plane.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file, data frame, or list of these but arrays
        Raw readings, as for `flinders.apply`; several recordings are fitted together.
    calibration : Fit, Calibration or path, optional
        Calibration of this sensor. Without a stated uncertainty it counts as exact. By default the calibration that was
        in force on board when the log was made.
    target_deg : float, degrees
        Worst heading difference that is good enough.
    site : Site, optional
        Site of the recording: headings are compared at its inclination. By default the fresh fit uses the site in the
        log, and headings are compared at the dip of the calibration.
    at : mapping of str to float, optional
        As for `flinders.apply`.
    follow : bool
        Also estimate the motion of the offset within the recording, which needs times.

    Returns
    -------
    Check
        Answer, comparison and both fits; also if the fresh fit is refused.

    Raises
    ------
    FitError
        If the recording gives no fit at all, such as `TooFewSamples` and `Unmoved`; `NeedsSamples` without times for
        `follow`.
    NoOnboardCalibration
        Without a calibration, for readings that state none in force.
    InputError, UnitError, AxesError
        As `flinders.apply`.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> tumble = simulate.tumble(seed=4)
    >>> later = simulate.tumble(seed=5, sensor=tumble.sensor)
    >>> checked = check(later.samples, calibrate.fit(tumble.samples), follow=True)
    >>> checked.answer, checked.comparison.p_value > 0.01, checked.random_walk.is_proven
    ('holds', True, False)
    """
    recorded, judged = _open_both(source, calibration)
    known, compensator = compensation_at(judged, at)
    recording = compensate_recording(recorded, compensator.calibration)
    dip_deg = (
        site.inclination_deg if site is not None and site.inclination_deg is not None else abs(common_dip_deg(known))
    )
    asked = {"target_deg": target_deg, "dip_deg": dip_deg}
    extrapolated, strength = _extrapolation_findings(recorded, compensator), _strength(known.calibration, recording)
    own = tuple(own_recordings(known, single_recordings(recorded)))
    try:
        fresh = fit(recording, target_deg=target_deg, site=_site_of(recorded, site, dip_deg))
    except Refused as refused:
        walk = _walk_under(known, recording, dip_deg) if follow else None
        return Check(known, refused.fit, None, refused, strength, None, own, walk, extrapolated, **asked)
    compared_deg = common_dip_deg(known, fresh) if site is None else common_dip_deg(fresh)
    named = with_name(fresh, "fresh fit")
    comparison = compare_on(recording, known, named, dip_deg=compared_deg, target_deg=target_deg)
    fresh_strength = _strength(fresh.calibration, recording)
    walk = _walk_of(fresh, recording) if follow else None
    return Check(known, fresh, comparison, None, strength, fresh_strength, own, walk, extrapolated, **asked)


def _open_both(source: AnyReadings, calibration: AnyCalibration | None) -> tuple[Recording, Fit]:
    """The recording in unit and axes of the calibration, and the calibration, by default the one on board."""
    if calibration is None:
        recorded = source if hasattr(source, "blocks") else open_recording(source)
        return cast("Recording", recorded), onboard_fit(cast("Recording", recorded))
    known = fit_for(calibration)
    return recording_for(source, known), known


def _site_of(recorded: Recording, site: Site | None, dip_deg: float) -> Site:
    """The given site, with an inclination; else the site in the log; else the inclination alone."""
    if site is not None:
        return replace(site, inclination_deg=dip_deg)
    (first, *others) = single_recordings(recorded)
    stated = None if others else recorded_site(getattr(first, "recording", first))
    return Site(inclination_deg=dip_deg) if stated is None else stated[0]


def _extrapolation_findings(recorded: Recording, compensator: Compensator) -> tuple[Finding, ...] | None:
    """Findings on disturbances beyond the range of a calibration; None if it follows none."""
    calibration = compensator.calibration
    if not calibration.disturbances:
        return None
    for part in single_recordings(recorded):
        watch = Compensator(calibration, compensator.beyond)
        for block in part.blocks():
            watch(block)
    return tuple(extrapolation_findings(calibration, compensator.beyond))


def _strength(calibration: Calibration, recording: Recording) -> LengthSums:
    """Statistics of the lengths of corrected readings."""
    return sum((LengthSums.of_corrected(calibration, block.field) for block in recording.blocks()), LengthSums())


def _walk_of(fresh: Fit, recording: Recording) -> RandomWalk:
    """Motion of the offset within a recording, by the fit to it."""
    claim = fresh.claim
    return walk_through(recording, claim.ellipsoid, plane=claim.plane, dip_deg=claim.heading_error_deg.dip_deg)


def _walk_under(known: Fit, recording: Recording, dip_deg: float) -> RandomWalk | None:
    """Motion of the offset by the calibration, for a recording that cannot be fitted; None if undetermined."""
    with contextlib.suppress(NeedsSamples, TooFewSamples):
        return walk_through(recording, known.calibration.ellipsoid, dip_deg=dip_deg, is_own=False)
    return None
