"""``--filter``: readings through a filter, and what it did to the calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.cli._inputs import joined
from flinders.cli._output import say
from flinders.errors import FitError, counted, figures
from flinders.findings import CATALOGUE, Record, by_severity

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.findings import Finding
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter

UNKNOWN_DEG: Final = 180.0
"""What a filter may have moved the heading by, where there is nothing to hold it against."""

UNCOMPARED: Final = (
    "; without the filter there is no calibration to hold this one against, so nobody knows how far the filter has "
    "moved it: record again, turning slowly"
)
BEYOND: Final = (
    ", more than the {}° that are claimed. A filter takes spikes off, and pulls the readings of a turning sensor "
    "inside the ellipsoid: turn more slowly, or use 'auto' without --filter, which leaves spikes out by itself"
)
"""What a filter did, in the finding."""

HIDDEN: Final = ("saturated", "stale-repeats")
"""Findings about single readings, which a filter blurs, and a median invents: told of them as they were recorded."""


def fit_filtered(parts: Sequence[Recording], by: Filter, options: dict[str, Any]) -> Fit:
    """Fit recordings with their readings filtered, and without; say in the first what the filter did.

    Readings at a rail are left out before the filter could blur them.

    Raises
    ------
    FitError
        If there is no calibration with the filter; `Refused` says what the filter did, too.
    """
    from flinders.fitting.calibrate import fit
    from flinders.fitting.result import Refused

    plain = _tried(parts, options)
    passed = through(parts, by)
    try:
        result, is_refused = fit(passed, **options), False
    except Refused as refused:
        result, is_refused = refused.fit, True
    except FitError:
        if plain is not None and plain.verdict != "refused":
            say("without the filter there is a calibration: leave --filter out")
        raise
    dropped = sum(_rows(_within_range(part)) for part in parts) - _rows(passed) if by.name == "kalman" else 0
    judged = _with_findings(result, plain, filtered_finding(result, plain, by, dropped))
    if is_refused:
        raise Refused(judged)
    return judged


def _with_findings(fit: Fit, plain: Fit | None, filtered: Finding) -> Fit:
    """Add what the filter did, and state of single readings what was recorded, by severity."""
    fitted = [finding for finding in fit.findings if finding.code not in HIDDEN]
    recorded = [] if plain is None else [finding for finding in plain.findings if finding.code in HIDDEN]
    return replace(fit, findings=by_severity([*fitted, *recorded, filtered]))


def filtered_finding(fit: Fit, plain: Fit | None, by: Filter, dropped: int) -> Finding:
    """By how much a filter moved a calibration, and how much smaller it made its field.

    A note while that is within what is claimed; a limit beyond, and where the filter alone is why it is refused.

    Parameters
    ----------
    found, plain : Fit
        With the filter and without; None where there is none without.
    by : Filter
    dropped : int
        Readings that it dropped.
    """
    claimed = fit.heading_error_deg.worst
    moved, effect = (UNKNOWN_DEG, UNCOMPARED) if plain is None else _effect(fit, plain)
    is_to_blame = plain is None or fit.verdict == "refused" != plain.verdict
    allowed = -1.0 if is_to_blame else claimed  # nothing is
    if plain is not None and is_to_blame:
        effect += f"; without the filter the verdict is {plain.verdict}: leave --filter out, or turn more slowly"
    elif plain is not None:
        effect += ", within what is claimed" if moved <= claimed else BEYOND.format(figures(claimed))
    out = f", {counted(dropped, 'reading')} dropped" if dropped else ""
    numbers = {"moved_deg": moved, "claimed_deg": claimed, "allowed_deg": allowed}
    return CATALOGUE["filtered"].certain(Record(numbers, by=f"{by}{out}", effect=effect))


def _effect(fit: Fit, plain: Fit) -> tuple[float, str]:
    """Degrees by which a filter moved the heading at the worst, and what it did in words."""
    from flinders.geometry.ellipsoid import upper
    from flinders.geometry.plane import down_of
    from flinders.heading.error_propagation import level_error

    ours, theirs = fit.ellipsoid, plain.ellipsoid
    apart = np.concatenate([ours.centre - theirs.centre, upper(ours.shape - theirs.shape)])
    dip, down = fit.heading_error_deg.dip_deg, down_of(fit.plane)
    moved = level_error(theirs, np.outer(apart, apart), dip_deg=dip, down=down).worst
    smaller = 1.0 - ours.radius / theirs.radius
    size = f"{figures(abs(100 * smaller))}% {'smaller' if smaller > 0 else 'larger'}"
    return float(
        np.nan_to_num(moved, nan=UNKNOWN_DEG)
    ), f": that moves the heading by {figures(moved)}° at the worst and makes the field {size}"


def through(parts: Sequence[Recording], by: Filter) -> Recording:
    """Recordings as one, their readings filtered."""
    from flinders.heading.smoothing import filtered

    return joined([filtered(_within_range(part), by) for part in parts])


class Smoother:
    """Filters readings as they come, before something else is done with them: each result rests on what was before it.

    Parameters
    ----------
    by : Filter
    then : callable, optional
        Takes and gives (N, 3) readings.
    """

    def __init__(self, by: Filter, then: Callable[[Floats], Floats] | None = None) -> None:
        self._by, self._then = by, then
        self._stream = by.start(centred=False)

    def __call__(self, field: Floats, time: Floats | None = None) -> Floats:
        """Take (N, 3) readings with their (N,) times, and give as many; in the place of a spike what was expected."""
        smooth = self._stream.push(field, time).field
        return smooth if self._then is None else self._then(smooth)

    def smoothed(self, samples: Samples) -> Samples:
        """The same samples with a smooth field."""
        return replace(samples, field=self(samples.field, samples.time))

    def as_dict(self) -> dict[str, str | int | float]:
        """JSON-ready."""
        return {
            "name": self._by.name,
            "width": self._by.width,
            "lag_readings": self._by.lag,
            "spikes": self._stream.dropped,
            "restarts": self._stream.restarts,
        }

    def __str__(self) -> str:
        spikes, restarts = self._stream.dropped, self._stream.restarts
        dropped = f"; {counted(spikes, 'spike')} replaced by what was expected" if spikes else ""
        again = f"; started afresh {counted(restarts, 'time')}" if restarts else ""
        return f"filtered: {self._by}; what is written is {self._by.lag:g} readings late{dropped}{again}"


def _tried(parts: Sequence[Recording], options: dict[str, Any]) -> Fit | None:
    """The fit without a filter, also one that is refused; None where there is none."""
    from flinders.fitting.calibrate import fit
    from flinders.fitting.result import Refused

    try:
        return fit(joined(parts), **options)
    except Refused as refused:
        return refused.fit
    except FitError:
        return None


def _within_range(part: Recording) -> Recording:
    """A recording without the readings at a rail."""
    from flinders.estimators.data import WithinRange
    from flinders.summary.summary import Summary

    rails = Summary.through(part).health.rails
    return WithinRange(part, rails) if rails else part


def _rows(recording: Recording) -> int:
    return sum(map(len, recording.blocks()))
