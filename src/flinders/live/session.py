"""A live session: readings and wishes in, what a page shows out; a pure reducer.

`step` takes a session and an event to the next session and what is to be told. It knows no clock, no socket and no
thread: each event says when it was, and a recorded list of events is a test and a demo.

>>> from flinders import simulate
>>> from flinders.live.evaluation import evaluate
>>> rows = rows_of(simulate.tumble(seed=1).samples)
>>> session, told = step(Session(), Arrived(at=60.0, rows=rows, unit=Unit.of("uT")))
>>> wants_fit(session, at=60.0)
True
>>> session = begin_fit(session)
>>> session, told = step(session, Fitted(at=60.1, found=evaluate(snapshot(session)), seconds=0.01))
>>> state(session).phase, state(session).words
('collecting', 'Almost: the worst heading error to expect is 0.066° (1 σ), the target 1°; hold on a little.')
>>> session, told = step(session, Ticked(at=61.0))                 # nothing more has come: that was all
>>> state(session).phase, state(session).words
('good', 'Good: the worst heading error to expect is 0.066° (1 σ), the target 1°.')
>>> session, told = step(session, Asked(at=61.0, command=Exclude(start_s=0.0, end_s=30.0)))
>>> state(session).excluded_readings, state(session).can_undo
(1501, True)

How much it holds: `Track.most` readings, 59 MB; of the steps that can be undone 200; of all else, the newest. So it is
as large after hours at 1 kHz as after a quarter of one. When a fit is due is a matter of how long fits take: `SHARE` of
a core at the most.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit, label
from flinders.errors import figures
from flinders.live.messages import (
    BackToLive,
    Clear,
    Command,
    Dip,
    Exclude,
    FitMessage,
    Notice,
    Pause,
    PreviousClear,
    Reason,
    Redo,
    Restore,
    SetGoal,
    SourceState,
    State,
    Target,
    Undo,
    points_frame,
)
from flinders.live.snapshot import Evaluated, Snapshot
from flinders.live.spans import History, Span, merged
from flinders.live.track import COLUMNS, Track

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.judged import Judged
    from flinders.heading.guidance import Frame, Goal
    from flinders.live.messages import Link, Phase
    from flinders.report.view import View

FITTED: Final = 20_000
"""Readings of a live fit, at most; of more, every second one, every third …"""
SHARE: Final = 0.03
"""Of a core, that fits take."""
FASTEST_S: Final = 0.25
"""From one fit to the next, at the least."""
SILENT_S: Final = 3.0
"""Seconds without a reading after which that is said; or so many usual steps of a slow sensor."""
SILENT_STEPS: Final = 5.0
RATE_S: Final = 2.0
ENOUGH_FITS: Final = 3
"""Fits in a row that have to be within the target before that is said: the first may be so by chance."""
SURE_S: Final = 1.0
"""Or two of them, so many seconds apart; or one, after which nothing has come for as long."""
FRAME_POINTS: Final = 20_000
"""Points in one frame, at most: a page that comes late gets them in two."""

LEVEL_DEG: Final = 89.0
"""A calibration that holds up to so much tilt leaves nothing to be said about it."""

NO_SOURCE: Final = SourceState("no source", "simulated", "waiting", "")

Told = FitMessage | Notice
"""What a step tells all pages, beside the state."""


@dataclass(frozen=True, slots=True, eq=False)
class Arrived:
    """Readings: (N, 7) time in s on the session's timeline, field in `unit.inside` and used axes, acceleration."""

    at: float
    rows: Floats
    unit: Unit


@dataclass(frozen=True, slots=True)
class Linked:
    """The link to the source has changed."""

    at: float
    link: Link
    words: str


@dataclass(frozen=True, slots=True)
class Said:
    """Something that all pages are told once."""

    at: float
    severity: Literal["info", "warning", "error"]
    words: str


@dataclass(frozen=True, slots=True)
class Unrecorded:
    """What arrives cannot be written down at present, and why; nothing where it can again."""

    at: float
    words: str


@dataclass(frozen=True, slots=True)
class Asked:
    """A page has asked for something."""

    at: float
    command: Command


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A fit is done, and took so many seconds."""

    at: float
    found: Evaluated
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A log was opened, to be shown in place of the sensor."""

    at: float
    name: str
    track: Track
    unit: Unit
    axes: Axes
    frame: str
    words: str


@dataclass(frozen=True, slots=True, eq=False)
class GotPrevious:
    """A calibration to compare with."""

    at: float
    previous: Judged


@dataclass(frozen=True, slots=True)
class Ticked:
    """Time has passed."""

    at: float


Event = Arrived | Linked | Said | Unrecorded | Asked | Fitted | Opened | GotPrevious | Ticked


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Readings that are looked at as one: what the sensor gives, or a log.

    Attributes
    ----------
    track : Track
    unit, axes, frame
        Of its readings.
    history : History
        What was taken out by hand.
    paused_at : float, s, optional
        Since when what arrives is left out.
    begun_s : float, s, optional
        It was begun anew then: readings up to that time are on the disk only.
    generation : int
        Of its points on the page.
    key : int
        Changes with all that a fit depends on.
    since : int
        No fit with a smaller key is of these readings.
    found : Evaluated, optional
        The newest fit.
    within : tuple of float, s
        When the fits in a row were done that are within the target: the first three of them.
    """

    track: Track = field(default_factory=Track.empty)
    unit: Unit = field(default_factory=Unit.of)
    axes: Axes = field(default_factory=Axes)
    frame: str = "sensor"
    history: History = field(default_factory=History)
    paused_at: float | None = None
    begun_s: float | None = None
    generation: int = 1
    key: int = 0
    since: int = 0
    found: Evaluated | None = None
    within: tuple[float, ...] = ()

    @property
    def excluded(self) -> tuple[Span, ...]:
        """What is taken out, the pause that is going on included."""
        spans = self.history.spans
        if self.paused_at is None or self.track.seconds < self.paused_at:
            return spans
        return merged([*spans, (self.paused_at, self.track.seconds)])


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """All that the server knows, but for its sockets.

    Attributes
    ----------
    source : SourceState
    live : Stretch
    opened : Stretch, optional
        Shown in its place, and by what name.
    target_deg, dip_deg, goal
        What the calibration is held against.
    previous : Judged, optional
    recording : str
    unrecorded : str
        Why what arrives cannot be written down; nothing where it can.
    has_board : bool
        The source is a board that takes a calibration.
    revision : int
        Grows with each step that changes something.
    keys, generations : int
        Given out so far.
    is_fitting : bool
    due_at : float, s
        No fit before.
    at, arrived_at : float, s
        Newest event, and newest reading.
    arrivals : tuple of (at, seconds, readings)
        Of the last two seconds, and the one before: when they came, the time of the last of them, and how many.
    """

    source: SourceState = NO_SOURCE
    live: Stretch = field(default_factory=Stretch)
    opened: Stretch | None = None
    opened_name: str = ""
    target_deg: float = 1.0
    dip_deg: float = 60.0
    goal: Goal = "heading"
    previous: Judged | None = None
    recording: str = ""
    unrecorded: str = ""
    has_board: bool = False
    revision: int = 0
    keys: int = 0
    generations: int = 1
    is_fitting: bool = False
    due_at: float = 0.0
    at: float = 0.0
    arrived_at: float = 0.0
    arrivals: tuple[tuple[float, float, int], ...] = ()

    @property
    def shown(self) -> Stretch:
        """What pages see, and commands act on."""
        return self.live if self.opened is None else self.opened

    @property
    def view(self) -> View | None:
        """The newest fit of that."""
        return None if self.shown.found is None else self.shown.found.view


Stepped = tuple[Session, list[Told]]


def rows_of(samples: Samples) -> Floats:
    """(N, 7) samples as rows of a track; without times a reading counts a second, for want of better."""
    rows = np.full((len(samples), COLUMNS), np.nan)
    rows[:, 0] = np.arange(len(samples)) if samples.time is None else samples.time
    rows[:, 1:4] = samples.field
    if samples.acceleration is not None:
        rows[:, 4:] = samples.acceleration
    return rows


def step(session: Session, event: Event) -> tuple[Session, list[Told]]:
    """Take one event in."""
    return _STEPS[type(event)](replace(session, at=event.at), event)


def _changed(session: Session, **changes: object) -> Session:
    return replace(session, revision=session.revision + 1, **changes)  # type: ignore[arg-type]


def _with_shown(session: Session, stretch: Stretch) -> Session:
    """Put what is shown anew in its place."""
    return _changed(session, **{"live" if session.opened is None else "opened": stretch})


def _refit(session: Session, *, soon: bool = True) -> Session:
    """Mark what is shown as changed, so that it is fitted again; what a person asked for, soon."""
    keys = session.keys + 1
    session = replace(session, keys=keys, due_at=min(session.due_at, session.at) if soon else session.due_at)
    return _with_shown(session, replace(session.shown, key=keys))


def _alone(session: Session) -> Session:
    """Fit what is shown anew, and take no fit for it that was begun before."""
    session = _refit(session)
    return _with_shown(session, replace(session.shown, since=session.keys))


def _arrived(session: Session, event: Arrived) -> Stepped:
    """Add readings to what the sensor gives; also while a log is shown."""
    if not len(event.rows):
        return session, []
    live = session.live
    keys = session.keys + (live.paused_at is None)
    live = replace(live, track=live.track.extended(event.rows), unit=event.unit)
    if live.paused_at is None:
        live = replace(live, key=keys)
    source = session.source
    if source.link != "connected":
        session = replace(session, source=SourceState(source.name, source.kind, "connected", ""))
    old = sum(arrival[0] <= event.at - RATE_S for arrival in session.arrivals)
    arrivals = (*session.arrivals[max(old - 1, 0) :], (event.at, float(event.rows[-1, 0]), len(event.rows)))
    return _changed(session, live=live, keys=keys, arrived_at=event.at, arrivals=arrivals), []


def _linked(session: Session, event: Linked) -> Stepped:
    """Note that the link has changed, and say so."""
    source = SourceState(session.source.name, session.source.kind, event.link, event.words)
    if source == session.source:
        return session, []
    severity: Literal["info", "warning"] = "warning" if event.link == "gone" else "info"
    return _changed(session, source=source), [Notice(severity, event.words)] if event.words else []


def _said(session: Session, event: Said) -> Stepped:
    return session, [Notice(event.severity, event.words)]


def _unrecorded(session: Session, event: Unrecorded) -> Stepped:
    """Say that the recording has a hole, or goes on."""
    told = Notice("error", event.words) if event.words else Notice("info", "what arrives is recorded again")
    return _changed(session, unrecorded=event.words), [told]


def _got_previous(session: Session, event: GotPrevious) -> Stepped:
    return _refit(_changed(session, previous=event.previous)), []


def _ticked(session: Session, _: Ticked) -> Stepped:
    return session, []


def _asked(session: Session, event: Asked) -> Stepped:
    """Do what a page asks for; what changes nothing is no step."""
    return _ANSWERS[type(event.command)](session, event.command)


def _held_against(session: Session, **wish: object) -> Stepped:
    """Hold the calibration against something else: a target, a dip, a goal, another calibration."""
    ((name, value),) = wish.items()
    if getattr(session, name) == value:
        return session, []
    session = _refit(_changed(session, **wish))
    return _with_shown(session, replace(session.shown, within=())), []


def _edited(session: Session, edit: Callable[[History], History]) -> Stepped:
    """Take out or put back; nothing happens where that is as it was."""
    history = edit(session.shown.history)
    if history == session.shown.history:
        return session, []
    return _refit(_with_shown(session, replace(session.shown, history=history))), []


def _excluded(session: Session, start: float, end: float) -> Stepped:
    """Take a stretch out, as far as there is one: what is still to come is never taken out."""
    track = session.shown.track
    if not track.total:
        return session, []
    span = (max(start, min(float(track.time[0]), 0.0)), min(end, track.seconds))
    if span[0] > span[1]:
        return session, []
    return _edited(session, lambda history: history.excluding(span))


def _paused(session: Session, *, paused: bool) -> Stepped:
    """Leave out what arrives from now on, or no longer: a pause is an exclusion that can be undone."""
    live = session.live
    if session.opened is not None:
        return session, [Notice("warning", "a log is shown, and nothing arrives in it: go back to live first")]
    if paused == (live.paused_at is not None):
        return session, []
    if paused:
        after = float(np.nextafter(live.track.seconds, np.inf)) if live.track.total else 0.0
        return _changed(session, live=replace(live, paused_at=after)), []
    history = live.history
    if live.paused_at is not None and live.track.seconds > live.paused_at:
        history = history.excluding((live.paused_at, live.track.seconds))
    return _refit(_changed(session, live=replace(live, paused_at=None, history=history))), []


def _cleared(session: Session) -> Stepped:
    """Begin anew with nothing."""
    if session.opened is not None:
        return session, [Notice("warning", "a log is shown, which cannot be begun anew: go back to live first")]
    old = session.live
    number, keys = session.generations + 1, session.keys + 1
    live = Stretch(
        Track.empty(old.track.most),
        begun_s=old.track.seconds if old.track.total else old.begun_s,
        unit=old.unit,
        axes=old.axes,
        frame=old.frame,
        generation=number,
        key=keys,
        since=keys,
    )
    session = _changed(session, live=live, generations=number, keys=keys, arrivals=())
    return session, [FitMessage(session.revision, None), Notice("info", "begun anew; what was recorded before is kept")]


def _back_to_live(session: Session) -> Stepped:
    """Close the log."""
    if session.opened is None:
        return session, []
    number = session.generations + 1
    live = replace(session.live, generation=number)
    session = _alone(_changed(session, opened=None, opened_name="", live=live, generations=number))
    return session, [FitMessage(session.revision, session.view)]


def _opened(session: Session, event: Opened) -> Stepped:
    """Show a log."""
    number = session.generations + 1
    stretch = Stretch(event.track, unit=event.unit, axes=event.axes, frame=event.frame, generation=number)
    session = _alone(_changed(session, opened=stretch, opened_name=event.name, generations=number))
    return session, [FitMessage(session.revision, None), Notice("info", event.words)]


def _fitted(session: Session, event: Fitted) -> Stepped:
    """Keep a fit, unless what is shown is no longer what it was made of."""
    session = replace(session, is_fitting=False, due_at=event.at + max(event.seconds / SHARE, FASTEST_S))
    shown, key = session.shown, event.found.key
    newest = -1 if shown.found is None else shown.found.key
    if not max(shown.since, newest + 1) <= key <= shown.key:
        return session, []
    shown = replace(shown, found=event.found)
    within = (*shown.within, event.at)[:ENOUGH_FITS] if _is_within(session, event.found) else ()
    session = _with_shown(session, replace(shown, within=within))
    return session, [FitMessage(session.revision, event.found.view)]


_STEPS: Final[dict[type, Callable[[Session, Any], Stepped]]] = {
    Arrived: _arrived,
    Linked: _linked,
    Said: _said,
    Unrecorded: _unrecorded,
    Asked: _asked,
    Fitted: _fitted,
    Opened: _opened,
    GotPrevious: _got_previous,
    Ticked: _ticked,
}
_ANSWERS: Final[dict[type, Callable[[Session, Any], Stepped]]] = {
    Target: lambda session, asked: _held_against(session, target_deg=asked.deg),
    Dip: lambda session, asked: _held_against(session, dip_deg=asked.deg),
    SetGoal: lambda session, asked: _held_against(session, goal=asked.goal),
    PreviousClear: lambda session, _: _held_against(session, previous=None),
    Exclude: lambda session, asked: _excluded(session, asked.start_s, asked.end_s),
    Restore: lambda session, asked: _edited(session, lambda history: history.restoring((asked.start_s, asked.end_s))),
    Undo: lambda session, _: _edited(session, History.undone),
    Redo: lambda session, _: _edited(session, History.redone),
    Pause: lambda session, asked: _paused(session, paused=asked.paused),
    Clear: lambda session, _: _cleared(session),
    BackToLive: lambda session, _: _back_to_live(session),
}


def wants_fit(session: Session, at: float) -> bool:
    """Whether something changed since the last fit, none is running, and one is due, or the source has ended."""
    shown = session.shown
    is_new = bool(shown.track.total) and (shown.found is None or shown.found.key != shown.key)
    is_due = at >= session.due_at or session.source.link == "ended"
    return is_new and not session.is_fitting and is_due


def begin_fit(session: Session) -> Session:
    """Note that a fit runs."""
    return replace(session, is_fitting=True)


def snapshot(session: Session, most: int | None = FITTED) -> Snapshot:
    """What a fit of the present readings needs: those not taken out, spread evenly where there are too many.

    Parameters
    ----------
    session : Session
    most : int, optional
        Readings, at most; None for all that are held.
    """
    shown = session.shown
    used = np.flatnonzero(~shown.track.within(shown.excluded))
    if most is not None and len(used) > most:
        used = used[:: -(-len(used) // most)]
    samples = Samples(
        field=shown.track.field[used],
        unit=shown.unit,
        axes=shown.axes,
        time=shown.track.time[used],
        acceleration=shown.track.acceleration[used] if shown.track.has_acceleration else None,
        source=session.opened_name or session.source.name,
        frame=shown.frame,
    )
    return Snapshot(
        key=shown.key,
        samples=samples,
        numbers=used * shown.track.stride,
        target_deg=session.target_deg,
        dip_deg=session.dip_deg,
        goal=session.goal,
        frame=_spoken(shown),
        previous=session.previous,
        is_followed=session.opened is None and session.live.paused_at is None and session.source.link == "connected",
    )


def _spoken(stretch: Stretch) -> Frame:
    """Which words advice is given in: those of a vehicle where somebody said how the sensor sits in it."""
    return "vehicle" if stretch.frame == "vehicle" or not stretch.axes.is_identity else "sensor"


def state(session: Session) -> State:
    """All that a page shows beside the fit and the points."""
    shown, found = session.shown, session.shown.found
    phase, words, reasons = _phase(session)
    rejected = 0 if found is None else found.rejected
    return State(
        revision=session.revision,
        source=session.source,
        unit=label(shown.unit.inside),
        readings=shown.track.total,
        used=0 if found is None else found.used,
        rejected=rejected,
        excluded_readings=shown.track.count_within(shown.excluded),
        rate_hz=_rate_hz(session),
        seconds=shown.track.seconds,
        phase=phase,
        words=words,
        reasons=reasons,
        target_deg=session.target_deg,
        dip_deg=session.dip_deg,
        goal=session.goal,
        excluded=shown.excluded,
        can_undo=bool(shown.history.past),
        can_redo=bool(shown.history.future),
        stride=shown.track.shown_stride,
        has_acceleration=shown.track.has_acceleration,
        paused=session.live.paused_at is not None,
        recording=session.recording or None,
        previous=None if found is None or session.previous is None else found.previous,
        opened=session.opened_name or None,
        can_send=session.has_board and session.opened is None and _is_usable(found),
    )


def _is_usable(found: Evaluated | None) -> bool:
    """Whether a fit gives a calibration."""
    return found is not None and found.fit is not None and found.fit.verdict != "refused"


def _rate_hz(session: Session) -> float | None:
    """Readings a second by their own times, over the last two seconds; None where none came.

    From the last reading of the first arrival to the last of all, so that it does not matter how many came together.
    """
    arrivals = session.arrivals
    if len(arrivals) < 2:
        return None
    first, last = arrivals[0], arrivals[-1]
    is_silent = session.at - last[0] >= max(RATE_S, 2.0 * (last[0] - arrivals[-2][0]))
    if is_silent or last[1] <= first[1]:
        return None
    return sum(count for _, _, count in arrivals[1:]) / (last[1] - first[1])


def _phase(session: Session) -> tuple[Phase, str, tuple[Reason, ...]]:
    """How far it has come, in a sentence, and what is in the way."""
    found = session.shown.found
    link = [] if session.opened is not None else _of_link(session)
    unrecorded = [Reason("not-recorded", session.unrecorded, "info")] if session.unrecorded else []
    reasons = (*link, *(() if found is None else found.reasons), *unrecorded)
    wrong = next((reason for reason in reasons if reason.severity == "warning"), None)
    if wrong is not None:
        return "wrong", _sentence(wrong.advice), reasons
    phase, words = _of_view(session)
    return phase, words, reasons


def _of_view(session: Session) -> tuple[Phase, str]:
    """How far the newest fit has come."""
    view = session.view
    if view is None:
        return "collecting", _before_a_fit(session)
    target, worst = f"the target {session.target_deg:g}°", _worst_deg(session, view)
    if worst is None:
        return "collecting", view.sentence
    if worst > session.target_deg:
        told = f"{figures(worst)}° (1 σ)" if worst < 90.0 else "any angle"
        return "collecting", f"Keep turning: the worst error to expect is {told}, {target}."
    what = "heading error" if session.goal == "heading" else "error at any attitude"
    done = f"the worst {what} to expect is {figures(worst)}° (1 σ), {target}"
    if view.verdict != "refused" and not _is_sure(session):
        return "collecting", f"Almost: {done}; hold on a little."
    by_verdict: dict[str, tuple[Phase, str]] = {
        "good": ("good", f"Good: {done}."),
        "limited": ("limited", f"Good enough, with limits: {done}{_as_far_as(view)}."),
        "refused": ("wrong", view.sentence),
    }
    return by_verdict[view.verdict]


def _worst_deg(session: Session, view: View) -> float | None:
    """The error that is held against the target; None where it is not known."""
    error = view.heading_error_deg
    if error is None or view.guidance is None:
        return None
    return error.worst if session.goal == "heading" else max(error.worst, view.guidance.worst_deg)


def _as_far_as(view: View) -> str:
    """Up to which tilt that holds, and what is missing beyond."""
    limit = view.attitude_limit_deg
    if limit is None or limit >= LEVEL_DEG:
        return ""
    held = "held level" if limit < 1.0 else f"up to {limit:.0f}° of tilt"
    return f", {held}; for more tilt than that, turn it tilted and upside down too"


def _is_within(session: Session, found: Evaluated) -> bool:
    """Whether a fit says that the target is reached, and nothing that speaks against it."""
    worst = None if found.view is None else _worst_deg(session, found.view)
    is_clean = all(reason.severity != "warning" for reason in found.reasons)
    return worst is not None and worst <= session.target_deg and is_clean and _is_usable(found)


def _is_sure(session: Session) -> bool:
    """Whether it takes no further fit to say that the target is reached: several did, or there will be no other.

    What grows gets further fits. A log, a pause and a sensor that is silent do not.
    """
    shown, within = session.shown, session.shown.within
    if len(within) >= ENOUGH_FITS or (within and within[-1] - within[0] >= SURE_S):
        return True
    is_of_all = shown.found is not None and shown.found.key == shown.key
    is_over = shown.paused_at is not None or session.source.link in ("ended", "gone")
    is_still = is_over or session.at - session.arrived_at >= SURE_S
    return is_of_all and (session.opened is not None or is_still)


def _before_a_fit(session: Session) -> str:
    """What to say while there are no numbers."""
    found = session.shown.found
    if not session.shown.track.total:
        return "Waiting for the first reading."
    if found is None or not found.refusal:
        return "Looking at the first readings. Turn the sensor slowly through all directions."
    return _sentence(found.refusal)


def _sentence(words: str) -> str:
    """Begin with a capital, unless it begins with a name: that of a file or port is written as it is.

    >>> _sentence("no reading has come"), _sentence("full.csv: cannot be written"), _sentence("")
    ('No reading has come.', 'full.csv: cannot be written.', '.')
    """
    first = words.partition(" ")[0].rstrip(",")
    begin = words[:1].upper() if first.isalpha() else words[:1]
    return f"{begin}{words[1:].rstrip('.')}."


def _of_link(session: Session) -> list[Reason]:
    """What is wrong on the way from the sensor."""
    source, since = session.source, session.at - session.arrived_at
    if source.link == "gone":
        return [Reason("gone", source.words or f"{source.name} is gone: check the cable")]
    total, seconds = session.live.track.total, session.live.track.seconds
    patience = max(SILENT_S, SILENT_STEPS * seconds / total if total else 0.0)
    if source.link in ("connected", "waiting") and since > patience:
        told = source.words if total == 0 and source.link == "waiting" else ""
        return [Reason("nothing-arrives", told or _nothing_arrives(session, since))]
    if source.link == "ended":
        return [Reason("ended", source.words or f"{source.name} has ended", "info")]
    return []


def _nothing_arrives(session: Session, since: float) -> str:
    begun = "has come for" if session.live.track.total else "has come yet, for"
    return (
        f"no reading {begun} {since:.0f} s from {session.source.name}: see that the sensor is on and prints its "
        "readings, and that port, cable and baud rate are right"
    )


@dataclass(frozen=True, slots=True)
class Cursor:
    """How far a page has got with the points.

    Attributes
    ----------
    generation, stride : int
        Of those it has.
    count : int
        How many it has.
    total : int
        Readings there were when the newest reading was sent.
    """

    generation: int = 0
    stride: int = 1
    count: int = 0
    total: int = -1


def points(session: Session, cursor: Cursor) -> tuple[bytes | None, Cursor]:
    """The points that a page does not have yet, and the newest reading; None where there is nothing new.

    A page with every second point too many keeps every second one, as the frame's stride says.
    """
    shown = session.shown
    track, stride = shown.track, shown.track.shown_stride
    if cursor.generation != shown.generation:
        count = 0
    elif cursor.total == track.total and cursor.stride == stride:
        return None, cursor
    else:
        count = -(-cursor.count // (stride // cursor.stride))
    time, raw, acceleration = track.shown(count, FRAME_POINTS)
    frame = points_frame(
        generation=shown.generation,
        first=count,
        stride=stride,
        now=track.latest[1:],
        time=time,
        field=raw,
        acceleration=acceleration if track.has_acceleration else None,
    )
    is_all = len(time) < FRAME_POINTS
    return frame, Cursor(shown.generation, stride, count + len(time), track.total if is_all else -1)


def replayed(events: Sequence[Event], session: Session) -> tuple[Session, list[Told]]:
    """Take a list of events in, one after the other."""
    told: list[Told] = []
    for event in events:
        session, more = step(session, event)
        told += more
    return session, told
