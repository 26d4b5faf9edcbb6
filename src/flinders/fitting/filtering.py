"""Fits of filtered readings, and what the filter did: a finding that says by how far it moved the heading.

A filter takes spikes off, and pulls the readings of a turning sensor inside the ellipsoid. So each fit with a filter is
made without it too, and the two are compared: a note where they differ by less than is claimed, a limit beyond.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.joining import joined
from flinders.errors import FitError
from flinders.estimators.data import WithinRange
from flinders.findings import certain, linked
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import level_error
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.core.samples import Recording
    from flinders.findings import Finding
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter

UNKNOWN_DEG: Final = 180.0
"""What a filter may have moved the heading by, where there is nothing to compare it with."""

OF_SINGLE_READINGS: Final = ("saturated", "stale-repeats")
"""Findings that a filter blurs, and a median invents: they are those of the readings as recorded."""


def fit_filtered(
    parts: Sequence[Recording], by: Filter | None, *, notice: Callable[[str], object] = str, **options: Any
) -> Fit:
    """Fit recordings together by `flinders.fit`, their readings filtered; a finding says what the filter did.

    Readings at a rail are left out before the filter could blur them.

    Raises `FitError` if there is no calibration with the filter; `Refused` says what the filter did, too.

    Parameters
    ----------
    parts : sequence of Recording
        Of one sensor.
    by : Filter or None
        Without a filter the recordings are fitted as they are.
    notice : callable
        Takes a line of advice where the filter alone is why there is no calibration; by default nobody does.
    **options
        Those of `flinders.fit`.
    """
    if by is None:
        return fit(joined(parts), **options)
    plain, _ = _tried(joined(parts), options)
    passed = through(parts, by)
    result, refusal = _tried(passed, options)
    if result is None:
        if plain is not None and plain.verdict != "refused":
            notice("without the filter there is a calibration: leave --filter out")
        raise refusal or FitError("no calibration")
    dropped = sum(_rows(_within_range(part)) for part in parts) - _rows(passed) if by.name == "kalman" else 0
    of_fit = [finding for finding in result.findings if finding.code not in OF_SINGLE_READINGS]
    recorded = [] if plain is None else [each for each in plain.findings if each.code in OF_SINGLE_READINGS]
    finding = filtered_finding(result, plain, by, dropped)
    findings = linked([*of_fit, *recorded, finding])
    judged = replace(result, judgement=replace(result.judgement, findings=findings))
    if refusal is not None:
        raise Refused(judged)
    return judged


def _tried(recording: Recording, options: dict[str, Any]) -> tuple[Fit | None, FitError | None]:
    """A fit, also one that is refused, and why it is refused."""
    try:
        return fit(recording, **options), None
    except Refused as refused:
        return refused.fit, refused
    except FitError as error:
        return None, error


def filtered_finding(fit: Fit, plain: Fit | None, by: Filter, dropped: int) -> Finding:
    """By how much a filter moved a calibration, and how much smaller it made its field.

    A note while that is within what is claimed; a limit beyond, and where the filter alone is why it is refused.

    `fit` and `plain`: with the filter and without; None where there is none without; `dropped`: readings that it
    dropped.
    """
    claimed = fit.heading_error_deg.worst
    moved, smaller = (UNKNOWN_DEG, 0.0) if plain is None else _effect(fit, plain)
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
    return certain(values, "filtered")


def _effect(fit: Fit, plain: Fit) -> tuple[float, float]:
    """Degrees by which a filter moved the heading at the worst, and by which share it made the field smaller."""
    ours, theirs = fit.calibration.ellipsoid, plain.calibration.ellipsoid
    apart = ours.parameters - theirs.parameters
    dip, down = fit.heading_error_deg.dip_deg, down_of(fit.claim.plane)
    moved = level_error(theirs, np.outer(apart, apart), dip_deg=dip, down=down).worst
    return float(np.nan_to_num(moved, nan=UNKNOWN_DEG)), 1.0 - ours.radius / theirs.radius


def through(parts: Sequence[Recording], by: Filter) -> Recording:
    """Recordings as one, their readings filtered."""
    from flinders.heading.smoothing import filtered

    return joined([filtered(_within_range(part), by) for part in parts])


def _within_range(part: Recording) -> Recording:
    """A recording without the readings at a rail."""
    rails = Summary.through(part).health.rails
    return WithinRange(part, rails) if rails else part


def _rows(recording: Recording) -> int:
    return sum(map(len, recording.blocks()))
