"""Fits of filtered readings, with a finding on the effect of the filter on the heading.

A filter removes spikes, but moves readings of a turning sensor inside the ellipsoid. Therefore each fit with a filter
is repeated without it and the two are compared: a difference within the claim is a note, a larger one a limit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.joining import join_recordings
from flinders.errors import FitError
from flinders.estimators.data import UnsaturatedRecording
from flinders.findings import certain_finding, link_causes
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import level_error
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.core.samples import Recording
    from flinders.findings import Finding
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter

MAX_EFFECT_DEG: Final = 180.0
"""Effect of a filter on the heading, in degrees, if no fit without the filter exists for comparison."""

FINDINGS_OF_READINGS: Final = ("saturated", "stale-repeats")
"""Findings on single readings, taken from unfiltered readings: a filter hides them, and a median causes them."""


def fit_filtered(
    parts: Sequence[Recording], by: Filter | None, *, notice: Callable[[str], object] = str, **options: Any
) -> Fit:
    """Fit filtered recordings together by `flinders.fit`, with a finding on the effect of the filter.

    Readings at a rail are removed before the filter is applied.

    Raises `FitError` if there is no calibration with the filter; `Refused` also has the finding on the filter.

    Parameters
    ----------
    parts : sequence of Recording
        Recordings of one sensor.
    by : Filter or None
        The filter; None to fit the recordings as they are.
    notice : callable
        Called with a line of advice if there is a calibration only without the filter; ignored by default.
    **options
        Keyword arguments of `flinders.fit`.
    """
    if by is None:
        return fit(join_recordings(parts), **options)
    plain, _ = _try_fit(join_recordings(parts), options)
    passed = filter_recordings(parts, by)
    result, refusal = _try_fit(passed, options)
    if result is None:
        if plain is not None and plain.verdict != "refused":
            notice("without the filter there is a calibration: leave --filter out")
        raise refusal or FitError("no calibration")
    dropped = (
        sum(_reading_count(_within_range(part)) for part in parts) - _reading_count(passed)
        if by.name == "kalman"
        else 0
    )
    of_fit = [finding for finding in result.findings if finding.code not in FINDINGS_OF_READINGS]
    recorded = [] if plain is None else [each for each in plain.findings if each.code in FINDINGS_OF_READINGS]
    finding = filtered_finding(result, plain, by, dropped)
    findings = link_causes([*of_fit, *recorded, finding])
    judged = replace(result, judgement=replace(result.judgement, findings=findings))
    if refusal is not None:
        raise Refused(judged)
    return judged


def _try_fit(recording: Recording, options: dict[str, Any]) -> tuple[Fit | None, FitError | None]:
    """Fit by `flinders.fit`; returns the fit, also a refused one, and the error of a refused or failed fit."""
    try:
        return fit(recording, **options), None
    except Refused as refused:
        return refused.fit, refused
    except FitError as error:
        return None, error


def filtered_finding(fit: Fit, plain: Fit | None, by: Filter, dropped: int) -> Finding:
    """Finding on the effect of a filter on the heading and on the strength of the field.

    The finding is a note if the effect is within the claim. It is a limit for a larger effect, or if only the fit with
    the filter is refused.

    `fit` is the fit with the filter, `plain` that without it, or None if it failed; `dropped` is the count of readings
    that the filter dropped.
    """
    claimed = fit.heading_error_deg.worst
    moved, smaller = (MAX_EFFECT_DEG, 0.0) if plain is None else _effect(fit, plain)
    is_to_blame = plain is None or fit.verdict == "refused" != plain.verdict
    values = {
        "moved_deg": moved,
        "claimed_deg": claimed,
        "allowed_deg": -1.0 if is_to_blame else claimed,
        "filter": str(by),
        "dropped": dropped,
        "smaller_share": smaller,
        "unfiltered": "" if plain is None else plain.verdict,
        "is_to_blame": is_to_blame,
    }
    return certain_finding(values, "filtered")


def _effect(fit: Fit, plain: Fit) -> tuple[float, float]:
    """Largest change of the heading by a filter, in degrees, and the share by which it reduces the field."""
    ours, theirs = fit.calibration.ellipsoid, plain.calibration.ellipsoid
    apart = ours.parameters - theirs.parameters
    dip, down = fit.heading_error_deg.dip_deg, down_direction(fit.claim.plane)
    moved = level_error(theirs, np.outer(apart, apart), dip_deg=dip, down=down).worst
    return float(np.nan_to_num(moved, nan=MAX_EFFECT_DEG)), 1.0 - ours.radius / theirs.radius


def filter_recordings(parts: Sequence[Recording], by: Filter) -> Recording:
    """One recording of all filtered readings."""
    from flinders.heading.smoothing import filter_recording

    return join_recordings([filter_recording(_within_range(part), by) for part in parts])


def _within_range(part: Recording) -> Recording:
    """A recording without readings at a rail."""
    rails = Summary.of_recording(part).health.rails
    return UnsaturatedRecording(part, rails) if rails else part


def _reading_count(recording: Recording) -> int:
    return sum(map(len, recording.blocks()))
