"""Check of a calibration on another recording, and estimate of the motion of its offset meanwhile.

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
from flinders.fitting.fit_file import fit_for
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Refused, with_name
from flinders.fitting.verdict import extrapolation_findings
from flinders.likelihood.site_field import Site, recorded_site
from flinders.readers import open_recording
from flinders.workflows.correction import PARAMETERS_ELSEWHERE
from flinders.workflows.onboard import onboard_fit
from flinders.workflows.recordings import compensation_at, own_recordings, recording_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.comparison.comparison import Comparison
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.findings import Finding
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer
    from flinders.workflows.recordings import AnyReadings


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """A calibration, compared with a new fit of another recording."""

    known: Fit  #: the calibration, in the form for compensated readings
    fresh: Fit  #: new fit of the recording, which may be refused
    comparison: Comparison | None  #: comparison of both; None if the new fit cannot be used
    refusal: Refused | None  #: reason why the new fit cannot be used; None if it can
    strength: LengthSums  #: lengths of the readings after correction with the calibration
    fresh_strength: LengthSums | None  #: lengths of the readings after correction with the new fit
    #: names of recordings that the calibration was made from: agreement with these proves nothing
    made_from: tuple[str, ...]
    random_walk: RandomWalk | None  #: motion of the offset within the recording, if `follow`
    #: findings on disturbances beyond the range in the calibration; None if the calibration has no disturbances
    extrapolated: tuple[Finding, ...] | None
    target_deg: float  #: largest acceptable heading difference in degrees
    dip_deg: float  #: dip for the recording in degrees, if the recording states no site

    @property
    def answer(self) -> Answer:
        """Whether the calibration still holds, as in `Comparison.answer`.

        It is ``cannot-tell`` too if the recording cannot be fitted. If the calibration was made from the recording, the
        answer is ``cannot-tell`` or ``fails``.
        """
        if self.comparison is None:
            return "cannot-tell"
        return "cannot-tell" if self.made_from and self.comparison.answer == "holds" else self.comparison.answer

    @property
    def limiting(self) -> Finding | None:
        """Finding of the new fit that prevents a decision; None with a decision, or if the other claim is wider."""
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
        """JSON-ready fields, without the refusal of a recording that cannot be fitted."""
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
            # names of recordings that the calibration was made from: agreement with these proves nothing
            "own_recordings": list(self.made_from),
            # code of the finding of the `fresh` fit that prevents a decision; null with a decision or without a finding
            "limiting_finding": None if limiting is None else limiting.code,
            "fresh": fresh,
            **self._drift(self.comparison.heading_difference_deg.dip_deg),
        }
        if self.extrapolated is not None:
            result["findings"] = [finding.as_dict() for finding in self.extrapolated]  # disturbances beyond their range
        return result

    def _drift(self, dip_deg: float) -> dict[str, Any]:
        """JSON-ready fields for the motion of the offset."""
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

    Turn the sensor through all directions, as for a calibration. Two calibrations are compared in the plane of a level
    turn if the recording is one.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file, data frame, or list of these but arrays
        Raw readings, as for `flinders.apply`; several recordings are fitted together.
    calibration : Fit, Calibration or path, optional
        Calibration of this sensor. If it states no uncertainty, it counts as exact. By default the onboard calibration
        at the end of the log.
    target_deg : float, degrees
        Largest acceptable heading difference.
    site : Site, optional
        Site of the recording, at whose dip headings are compared. By default the new fit uses the site in the log, and
        headings are compared at the dip of the calibration.
    at : mapping of str to float, optional
        Values of disturbances, as for `flinders.apply`.
    follow : bool
        Also estimate the motion of the offset within the recording; this needs times.

    Returns
    -------
    Check
        Answer, comparison and both fits, even if the new fit is refused.

    Raises
    ------
    FitError
        If the recording gives no fit at all, such as `TooFewSamples` and `Unmoved`. `NeedsSamples` for `follow` without
        times.
    NoOnboardCalibration
        If no calibration is given and the readings state no onboard calibration.
    InputError, UnitError, AxesError
        The errors of `flinders.apply`.

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
    """The recording in the unit and axes of the calibration, and the calibration, by default the onboard one."""
    if calibration is None:
        recorded = source if hasattr(source, "blocks") else open_recording(source)
        return cast("Recording", recorded), onboard_fit(cast("Recording", recorded))
    known = fit_for(calibration)
    return recording_for(source, known), known


def _site_of(recorded: Recording, site: Site | None, dip_deg: float) -> Site:
    """The given site with an inclination; else the site in the log; else a site with the inclination alone."""
    if site is not None:
        return replace(site, inclination_deg=dip_deg)
    (first, *others) = single_recordings(recorded)
    stated = None if others else recorded_site(getattr(first, "recording", first))
    return Site(inclination_deg=dip_deg) if stated is None else stated[0]


def _extrapolation_findings(recorded: Recording, compensator: Compensator) -> tuple[Finding, ...] | None:
    """Findings on disturbances beyond the range in a calibration; None if the calibration has no disturbances."""
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
    """Motion of the offset within a recording, with the fit of that recording."""
    claim = fresh.claim
    return walk_through(recording, claim.ellipsoid, plane=claim.plane, dip_deg=claim.heading_error_deg.dip_deg)


def _walk_under(known: Fit, recording: Recording, dip_deg: float) -> RandomWalk | None:
    """Motion of the offset with the known calibration, for a recording without a fit; None if undetermined."""
    with contextlib.suppress(NeedsSamples, TooFewSamples):
        return walk_through(recording, known.calibration.ellipsoid, dip_deg=dip_deg, is_own=False)
    return None
