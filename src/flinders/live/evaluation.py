"""Fits of a session: of a snapshot while readings arrive, and of all readings in the end.

>>> from flinders import simulate
>>> from flinders.core.units import Unit
>>> from flinders.live.buffer import rows_of
>>> from flinders.live.session import Arrived, LiveSession, step
>>> rows = rows_of(simulate.tumble(seed=1).samples)
>>> session, _ = step(LiveSession(), Arrived(at=60.0, rows=rows, unit=Unit.of("uT")))
>>> evaluated = evaluate(session)
>>> evaluated.view.verdict, evaluated.used, [reason.code for reason in evaluated.reasons]
('good', 3000, [])

The same session gives the same, in whichever thread, so that the server may run it while readings arrive. Guidance
begins at the present attitude of the sensor: `flinders.report.view` knows a fit and nothing of where the field points
now, so it names the best single direction; `guided` puts the first waypoint of `flinders.heading.path_planning` in its
place, on a sphere through the readings before any fit has a surface.

The calibration in the end (`finished`) is made from the file of the session, and not from the readings in memory, which
are fewer in a long one.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
from numpy.linalg import norm

from flinders.comparison.comparison import compare
from flinders.core.calibration_file import SourceFile
from flinders.core.units import EARTH_UT, MICROTESLA, label
from flinders.errors import FitError, FlindersError, UnreadableInput, counted, figures
from flinders.estimators.data import CountedRecording
from flinders.findings import CATALOGUE, first_causes
from flinders.fitting.calibrate import fit as fit_samples
from flinders.fitting.claim import heading_words
from flinders.fitting.refreshing import refresh
from flinders.fitting.result import Refused
from flinders.heading import path_planning
from flinders.likelihood.site_field import Site
from flinders.live.messages import PreviousState, Reason
from flinders.live.session import Evaluated, used_readings
from flinders.live.session_file import Edits, TrimmedRecording
from flinders.readers import open_recording
from flinders.report.view import GuidanceView, Shown, triple, view

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.diagnostics.soft_iron import Refreshed
    from flinders.estimators.outliers import Outlier
    from flinders.findings.poses import Frame
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal
    from flinders.live.messages import Span
    from flinders.live.session import LiveSession
    from flinders.report.view import View

STALE_S: Final = 2.0  # Seconds of equal readings after which a sensor is said to have stopped
STALE_ROWS: Final = 10
FROZEN_ROWS: Final = 20
FROZEN_S: Final = 2.0
"""Readings and seconds in which one axis stays as it is and the others do not, after which that is said."""
LIVELY: Final = 0.9  # Of its steps before, so many have to be changes: a coarse axis is equal for a while by itself
MOVING: Final = 0.1  # Of their range so far, that the other axes move by meanwhile
CONVERGED: Final = 5.0  # A fit has converged, and its findings are shown, once its error is below so many targets, …
CONVERGED_FRACTION: Final = 0.7  # … or so much of the sphere has been seen, …
CONVERGED_S: Final = 30.0  # … or so many seconds of readings are there: more of the same would not help
AT_ONCE: Final = frozenset({"saturated", "soft-iron-changed"})
"""Alarms that no more turning ends."""
DISTURBED: Final = frozenset({"field-changed", "outliers"})
"""Alarms that may end where the intervals of most outliers are left out."""
DENSE: Final = 0.5  # Runs of outliers are one interval where more than this share of its readings are such
OFFERED: Final = 3  # Intervals, at most
STILL_S: Final = 6.0  # Seconds without a turn after which somebody is reminded
STILL_DEG: Final = 5.0
LEAST_DEG: Final = 0.001  # A smaller difference is not shown as a number
OTHER_UNITS: Final = {"T": 1e-6, "mT": 1e-3, "G": 1e-2, "mG": 10.0, "nT": 1e3}
"""What the earth's field, in microtesla, is multiplied by where readings in another unit are taken for microtesla."""
SAID: Final = {
    "stale": (
        "the last {readings} are all the same: the sensor has stopped measuring, or a loop prints faster than it is "
        "read; check its wiring and its mode"
    ),
    "frozen-axis": (
        "axis {axis} has been the same for {seconds} s while the others change: turn the sensor another way, and where "
        "that does not wake it, the sensor or its wiring is at fault; then start again"
    ),
    "no-rotation": "it has not been turned for {seconds} s",
    "wrong-unit": "the field is {radius} µT, and the earth's {low} to {high} µT: {hint}. Headings do not depend on it",
    "other-unit": "as readings in {unit} would be; try {unit} as their unit",
    "no-unit": "check unit and scale",
    "renewed": "its soft iron is kept; the offset has moved by {moved}, which turns headings by up to {worst}°",
    "no-fit": "nothing to compare with yet",
    "agree": "it agrees with this one: no more apart than chance explains ({difference} of heading at the worst)",
    "differ": (
        "it differs from this one by more than chance, but by less than the target ({difference} of heading at the "
        "worst)"
    ),
    "contradict": (
        "it contradicts this one: something near the sensor has changed ({difference} of heading at the worst)"
    ),
}
"""Sentences of reasons, by their codes; the page that needs no program takes them, too (`flinders.standalone`)."""
INFORMATIVE: Final = ("stale-repeats", "mirrored-axes")
"""Findings that are told as they come, and warn of nothing."""


def evaluate(session: LiveSession) -> Evaluated:
    """Fit what a session shows and look at what came out."""
    samples, numbers = used_readings(session)
    fit, refusal, code = _fitted(session, samples)
    page_view = None
    if fit is not None:
        goal, frame = session.goal, session.shown.advice_frame
        page_view = view(fit, samples, numbers=numbers, goal=goal, frame=frame)
        if session.is_followed:
            page_view = guided(page_view, fit, samples, goal=goal, frame=frame)
        page_view = _beyond_level(page_view, fit)
    of_fit = list(_of_fit(fit, samples))
    alarms = frozenset(reason.code for reason in of_fit if reason.severity == "warning") - AT_ONCE
    reasons = [*_of_refusal(code, refusal), *_of_motion(samples, fit), *of_fit]
    used = 0 if page_view is None else sum(page_view.tiles_seen) or len(samples)
    return Evaluated(
        key=session.shown.key,
        fit=fit,
        view=page_view,
        refusal=refusal,
        refusal_code=code,
        reasons=tuple(sorted(reasons, key=lambda reason: reason.severity != "warning")),
        used=used,
        rejected=0 if page_view is None else len(samples) - used,
        previous=_compared(fit, session),
        alarms=alarms,
        alarmed_at=_alarmed_at(session, alarms),
    )


def _beyond_level(page_view: View, fit: Fit) -> View:
    """Say what is missing of a calibration that is good while level: more level turns would add nothing."""
    is_done = fit.claim.plane and fit.verdict == "limited" and fit.heading_error_deg.worst <= fit.claim.target_deg
    if not is_done or page_view.guidance is None:
        return page_view
    words = "it is good while level; for headings that hold when it is tilted, turn it tilted and upside down too"
    return msgspec.structs.replace(page_view, guidance=msgspec.structs.replace(page_view.guidance, words=words))


def _fit(session: LiveSession, recording: Recording) -> Fit:
    """Fit readings of what is shown, at its site; with the soft iron from before where that is renewed."""
    renewed = session.renewed
    fitted = fit_samples if renewed is None else partial(refresh, previous=renewed)
    site = Site.stated(session.shown.known_site, inclination_deg=session.dip_deg)
    return fitted(recording, target_deg=session.target_deg, site=site)


def _fitted(session: LiveSession, samples: Samples) -> tuple[Fit | None, str, str]:
    """The fit, or why there is none and the code of that."""
    try:
        return _fit(session, samples), "", ""
    except Refused as refused:
        return refused.fit, "", ""
    except FitError as error:
        return None, error.message, error.code


def _of_refusal(code: str, words: str) -> Iterator[Reason]:
    """Why there is no fit; that there are too few readings yet is no fault."""
    if code in ("stuck-axis", "out-of-scale"):
        yield Reason(code, words)
    elif code:
        yield Reason("no-rotation" if code == "unmoved" else code, words, "info")


def _of_fit(fit: Fit | None, samples: Samples) -> Iterator[Reason]:
    """What the findings of a fit say is wrong; of one that is only beginning, nothing yet."""
    if fit is None:
        return
    converged = (
        fit.heading_error_deg.worst < CONVERGED * fit.claim.target_deg
        or fit.coverage.fraction >= CONVERGED_FRACTION
        or _seconds(samples) >= CONVERGED_S
    )
    spans = _disturbed(fit)
    for finding in first_causes(fit.findings):
        if CATALOGUE[finding.code].alarm and finding.severity != "note" and (converged or finding.code in AT_ONCE):
            yield Reason(finding.code, finding.advice, spans=spans if finding.code in DISTURBED else ())
        elif finding.code in INFORMATIVE:
            yield Reason(finding.code, finding.advice, "info")
    if converged and not fit.judgement.is_flat:
        yield from _of_unit(fit)


def _disturbed(fit: Fit) -> tuple[Span, ...]:
    """The longest intervals that outliers fill; none where these are few, since the fit does without them."""
    if all(finding.code != "outliers" or finding.severity == "note" for finding in fit.findings):
        return ()
    spans = [(run.start_s, run.end_s) for run in _joined(fit.evidence.outliers) if run.start_s < run.end_s]
    longest = sorted(spans, key=lambda span: span[0] - span[1])[:OFFERED]
    return tuple(sorted(longest))


def _joined(outliers: Sequence[Outlier]) -> list[Outlier]:
    """Runs joined where most readings from the first to the last are outliers.

    >>> from flinders.estimators.outliers import Outlier
    >>> runs = [Outlier(10, 20, 11, 0.2, 0.4, 9.0), Outlier(22, 40, 19, 0.44, 0.8, 9.0)]
    >>> runs.append(Outlier(90, 90, 1, 1.8, 1.8, 9.0))
    >>> [(run.first, run.last, run.readings, run.start_s) for run in _joined(runs)]
    [(10, 40, 30, 0.2), (90, 90, 1, 1.8)]
    """
    joined: list[Outlier] = []
    for run in sorted(outliers, key=lambda run: run.first):
        whole = run
        if joined and joined[-1].readings + run.readings > DENSE * (run.last - joined[-1].first + 1):
            before = joined.pop()
            whole = replace(run, first=before.first, start_s=before.start_s, readings=before.readings + run.readings)
        joined.append(whole)
    return joined


def _alarmed_at(session: LiveSession, alarms: frozenset[str]) -> float | None:
    """When the first of the fits in a row was made that have alarms; what has become one remains it."""
    before = session.shown.evaluated
    if not alarms:
        return None
    if before.is_alarmed(session.at):
        return -math.inf
    return session.at if before.alarmed_at is None else before.alarmed_at


def _seconds(samples: Samples) -> float:
    """From the first reading to the last; 0 where there are no times."""
    return 0.0 if samples.time is None or not len(samples) else float(samples.time[-1] - samples.time[0])


def _of_unit(fit: Fit) -> Iterator[Reason]:
    """Whether the field is none of the earth's, and which other unit would explain it."""
    calibration, radius = fit.calibration, fit.calibration.ellipsoid.radius
    low, high = EARTH_UT
    if calibration.unit != MICROTESLA or low <= radius <= high:
        return
    likely = [unit for unit, factor in OTHER_UNITS.items() if low <= radius / factor <= high]
    hint = SAID["other-unit"].format(unit=likely[0]) if likely else SAID["no-unit"]
    words = SAID["wrong-unit"].format(radius=figures(radius, 3), low=f"{low:g}", high=f"{high:g}", hint=hint)
    yield Reason("wrong-unit", words)


def _of_motion(samples: Samples, fit: Fit | None) -> Iterator[Reason]:
    """Whether the newest readings still change, and turn."""
    time = samples.time
    count = len(samples)
    if time is None or not count:
        time = np.arange(float(count))
    same = _equal_at_the_end(samples.field)
    if same >= STALE_ROWS and time[-1] - time[-same] >= STALE_S:
        yield Reason("stale", SAID["stale"].format(readings=counted(same, "reading")))
    elif frozen := _frozen(samples.field, time):
        axis, seconds = frozen
        yield Reason("frozen-axis", SAID["frozen-axis"].format(axis=axis, seconds=f"{seconds:.1f}"))
    elif fit is not None and not fit.judgement.is_flat and time[-1] - time[0] > STILL_S:
        newest = samples.field[time >= time[-1] - STILL_S]
        if len(newest) > 3 and _widest_deg(fit.calibration.apply(newest)) < STILL_DEG:
            yield Reason("no-rotation", SAID["no-rotation"].format(seconds=f"{STILL_S:.0f}"), "info")


def _frozen(field: Floats, time: Floats) -> tuple[str, float] | None:
    """Which axis has stopped in the newest readings while the others move, and since how many seconds.

    >>> time = np.arange(400) / 50.0
    >>> field = 50.0 * np.sin(np.outer(time, [1.0, 1.3, 1.7]))
    >>> _frozen(field, time) is None
    True
    >>> field[250:, 1] = field[250, 1]
    >>> _frozen(field, time)
    ('y', 2.98)
    """
    spread = np.ptp(field, axis=0) if len(field) else np.zeros(3)
    for axis in range(3):
        run = _equal_at_the_end(field[:, [axis]])
        if not FROZEN_ROWS <= run < len(field) or time[-1] - time[-run] < FROZEN_S:
            continue
        before = np.diff(field[: len(field) - run + 1, axis])
        others = [other for other in range(3) if other != axis]
        moves = np.ptp(field[-run:, others], axis=0) >= MOVING * spread[others]
        if moves.all() and np.mean(before != 0.0) >= LIVELY:
            return "xyz"[axis], round(float(time[-1] - time[-run]), 3)
    return None


def _equal_at_the_end(field: Floats) -> int:
    """How many readings, counted from the end, are the same.

    >>> _equal_at_the_end(np.array([[1.0, 2, 3], [4, 5, 6], [4, 5, 6]]))
    2
    """
    if not len(field):
        return 0
    unlike = np.flatnonzero(np.any(field != field[-1], axis=1))
    return len(field) - (int(unlike[-1]) + 1 if len(unlike) else 0)


def _widest_deg(corrected: Floats) -> float:
    """How far directions are from their mean, at the most."""
    lengths = np.linalg.norm(corrected, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
    directions = corrected / lengths
    mean = directions.mean(axis=0)
    mean /= max(float(np.linalg.norm(mean)), np.finfo(float).tiny)
    return float(np.rad2deg(np.arccos(np.clip(directions @ mean, -1.0, 1.0))).max())


def _compared(fit: Fit | None, session: LiveSession) -> PreviousState | None:
    """How far the calibration from before is off the present one."""
    previous = session.previous
    if previous is None:
        return None
    if fit is None or fit.verdict == "refused":
        return PreviousState(previous.name, None, SAID["no-fit"])
    if fit.evidence.diagnosis.refreshed is not None:
        return _renewed(fit.evidence.diagnosis.refreshed, label(fit.calibration.unit))
    try:
        apart = compare(previous, fit.with_name("this one"), dip_deg=fit.claim.dip_deg, target_deg=session.target_deg)
    except FlindersError as error:
        return PreviousState(previous.name, None, error.message)
    worst = apart.heading_difference_deg.worst
    difference = f"{figures(worst)}°" if worst >= LEAST_DEG else f"less than {LEAST_DEG:g}°"
    return PreviousState(previous.name, worst, SAID[apart.verdict].format(difference=difference))


def _renewed(refreshed: Refreshed, unit: str) -> PreviousState:
    """What has changed since the calibration that is renewed."""
    moved = f"{figures(float(norm(refreshed.offset_change)))} {unit}"
    words = SAID["renewed"].format(moved=moved, worst=figures(refreshed.heading_change_deg))
    return PreviousState(refreshed.previous, refreshed.heading_change_deg, words)


KNOWN_DEG: Final = 10.0  # A fit that is farther off than this in some direction is asked for none
SPEED_DEG: Final = 90.0  # Degrees a second that a hand turns a sensor by, for what its readings along the way are worth


def guided(view: View, fit: Fit, samples: Samples, *, goal: Goal = "heading", frame: Frame = "sensor") -> View:
    """Put the path from the newest reading into the view of a fit, which may be refused; not where it gains nothing.

    >>> from flinders import simulate
    >>> samples = simulate.tumble(seed=1, motion="tilted").samples
    >>> fit = fit_samples(samples, target_deg=0.1)
    >>> guided(view(fit, samples), fit, samples).guidance.words
    'follow the arrow: turn it about x (y towards z), then about z (x towards y)'
    """
    if fit.claim.plane or not len(samples):
        return view
    belief = believe(fit, samples.field)
    if belief is None:
        return view
    here = belief.direction(samples.field[-1])
    if not here.any():
        return view
    is_seen_from_below = fit.heading_error_deg.dip_deg * fit.claim.dip_deg < 0.0
    path = path_planning.plan(
        belief,
        here,
        target_deg=fit.claim.target_deg,
        goal=goal,
        dip_deg=fit.claim.dip_deg,
        down=np.array([0.0, 0.0, -1.0]) if is_seen_from_below else None,
        readings_per_deg=_readings_per_deg(samples),
    )
    if not len(path.waypoints) or (path.worst_deg <= fit.claim.target_deg and not belief.is_rough):
        return view
    words = f"follow the arrow: {path.words(frame)}"
    leads = GuidanceView(triple(path.waypoints[0]), words, path.worst_deg, path.after_deg, goal, frame, is_path=True)
    return msgspec.structs.replace(view, guidance=leads, shown=_round(belief) if belief.is_rough else view.shown)


def believe(fit: Fit | None, readings: ArrayLike) -> path_planning.Belief | None:
    """What is known after a fit of (N, 3) readings, also a refused one: what it claims, or else a sphere."""
    if fit is None or fit.judgement.is_flat or fit.claim.direction_error_deg.worst > KNOWN_DEG:
        return path_planning.rough(readings)
    return path_planning.Belief.of(fit.claim, fit.noise, fit.coverage)


def _readings_per_deg(samples: Samples) -> float:
    """What the sensor gives for each degree that it is turned by."""
    time = samples.time
    if time is None or len(time) < 2 or not time[-1] > time[0]:
        return path_planning.READINGS_PER_DEG
    return (len(time) - 1) / float(time[-1] - time[0]) / SPEED_DEG


def _round(belief: path_planning.Belief) -> Shown:
    """A sphere to draw readings on that no fit has a surface for."""
    radius = belief.ellipsoid.radius
    return Shown(triple(belief.ellipsoid.centre), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), radius)


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """What a session comes to: the outcome of the readings that were shown under this key, and what they are from."""

    key: int
    name: str
    recording: Recording
    outcome: Fit | FlindersError
    files: tuple[SourceFile, ...] = ()

    @property
    def fit(self) -> Fit:
        """The fit, good or limited; raises why there is none, or none that may be used."""
        if isinstance(self.outcome, FlindersError):
            raise self.outcome
        return self.outcome

    @property
    def limits(self) -> list[str]:
        """What it is not good for."""
        return [finding.advice for finding in self.fit.findings if finding.severity == "limits"]

    @property
    def about(self) -> list[str]:
        """Where the numbers come from and what is claimed of them, for the head of an export."""
        return [
            f"from {self.name}",
            f"the calibration is {self.fit.verdict}: headings good to {heading_words(self.fit.claim)}",
            *(f"limited: {limit}" for limit in self.limits),
        ]


def finished(session: LiveSession, path: Path | None, reading: dict[str, Any]) -> Finished:
    """Fit all readings of what is shown, but for those taken out.

    They are in the file at `path`, which is read as `flinders.open_recording` takes `reading`; without it, and of a
    log, what is in memory is all.
    """
    key, name = session.shown.key, session.opened_name or session.source.name
    earlier = () if session.renewed is None else session.renewed.provenance.files
    if session.opened is not None or path is None:
        samples = used_readings(session, None)[0]
        return Finished(key, name, samples, _outcome(session, samples), earlier)
    try:
        file = open_recording(path, **reading)
    except FlindersError as error:
        return Finished(key, path.name, used_readings(session, None)[0], _nothing_yet(error))
    counting = CountedRecording(TrimmedRecording(file, Edits.of(session).left_out))
    outcome = _outcome(session, counting)
    return Finished(key, path.name, counting, outcome, (_source_file(path, counting.rows), *earlier))


def _nothing_yet(error: FlindersError) -> FlindersError:
    """What cannot be read of a recording that has just begun is no fault of its file."""
    if isinstance(error, UnreadableInput):
        return UnreadableInput("there are no readings yet to make a calibration from: turn the sensor first")
    return error


def _outcome(session: LiveSession, recording: Recording) -> Fit | FlindersError:
    try:
        return _fit(session, recording)
    except Refused as refused:
        return refused
    except FlindersError as error:
        return error


def _source_file(path: Path, rows: int) -> SourceFile:
    """The file as it is now; of one that grows, its beginning."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return SourceFile(name=path.name, sha256=digest, bytes=file.tell(), rows=rows)
