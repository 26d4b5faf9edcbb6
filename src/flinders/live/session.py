"""A live session: a pure reducer of readings and of a person's commands.

`step` makes of a session and an event the next session and notices for its pages. It knows no clock, socket or
thread: each event carries its time, so that a recorded list of events is a test and a demo.

>>> from flinders import simulate
>>> from flinders.live.buffer import rows_of
>>> from flinders.live.evaluation import evaluate
>>> from flinders.live.page_state import session_state
>>> rows = rows_of(simulate.tumble(seed=1).samples)
>>> session, replies = step(LiveSession(), Arrived(at=60.0, rows=rows, unit=Unit.of("uT")))
>>> wants_fit(session, at=60.0)
True
>>> session = begin_fit(session)
>>> session, replies = step(session, FitDone(at=60.1, evaluated=evaluate(session), seconds=0.01))
>>> session_state(session).phase, session_state(session).words.partition("(95 % ")[0]
('collecting', 'Almost: the worst heading error to expect is 0.066° ')
>>> session, replies = step(session, Ticked(at=61.0))                 # nothing more has come: that was all
>>> session_state(session).phase, session_state(session).words.split(". ")[0]
('good', 'Good: the worst heading error to expect is 0.066° (95 % within 0.16°), the target 1°')
>>> session, replies = step(session, Requested(at=61.0, command=Exclude(start_s=0.0, end_s=30.0)))
>>> session_state(session).excluded_readings, session_state(session).can_undo
(1501, True)

Memory is bounded: a buffer of `ReadingBuffer.most` readings (59 MB), 200 steps that can be undone, and of all else the
newest. Fits take at most `SHARE` of a core: the longer one takes, the later the next is due.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import UsageError
from flinders.fitting.refreshing import UNFIT, refuse_unfit
from flinders.live.buffer import Exclusions, ReadingBuffer, Span, Timeline, merged
from flinders.live.messages import (
    LARGEST_DIP_DEG,
    BackToLive,
    Clear,
    Command,
    Exclude,
    Notice,
    Pause,
    PreviousClear,
    Redo,
    Restore,
    SetDip,
    SetGoal,
    SetPlace,
    SetRefresh,
    SetTarget,
    SourceState,
    Undo,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.findings.poses import Frame
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal
    from flinders.likelihood.site_field import Site
    from flinders.live.messages import Link, PreviousState, Reason
    from flinders.report.view import View

FITTED: Final = 20_000  # Readings of a live fit, at most; of more, every second one, every third …
SHARE: Final = 0.03  # Of a core, that fits take
FASTEST_S: Final = 0.25  # From one fit to the next, at the least
RATE_S: Final = 2.0
ENOUGH_FITS: Final = 3
"""Fits in a row that have to be within the target before that is said: the first may be so by chance."""
SURE_S: Final = 1.0  # Or two of them, so many seconds apart; or one, after which nothing has come for as long
WHOLE: Final = 0.95
SETTLED_S, LASTING_S = 5.0, 75.0
"""Share of the sphere beyond which findings that last so many seconds are an alarm, and seconds after which any are:
until then more turning may end them (``python -m benchmarks.alarms``)."""
NO_SOURCE: Final = SourceState("no source", "simulated", "waiting", "")


@dataclass(frozen=True, slots=True, eq=False)
class Evaluated:
    """Result of a fit, and what a page shows of it; where there is none, `refusal` says why.

    `used` and `rejected` count readings, `key` is that of the series that was fitted. `alarms` has the codes of reasons
    that more turning may end, `alarmed_at` is when the first of the fits in a row was made that have any: -inf where
    these lasted long enough.
    """

    key: int
    fit: Fit | None = None
    view: View | None = None
    refusal: str = ""
    refusal_code: str = ""
    reasons: tuple[Reason, ...] = ()
    used: int = 0
    rejected: int = 0
    previous: PreviousState | None = None
    alarms: frozenset[str] = frozenset()
    alarmed_at: float | None = None

    @property
    def is_usable(self) -> bool:
        """Whether it gives a calibration."""
        return self.fit is not None and self.fit.verdict != "refused"

    def is_alarmed(self, at: float) -> bool:
        """Whether its alarms have lasted long enough, so that more turning would not end them."""
        if self.alarmed_at is None:
            return False
        is_whole = self.fit is not None and self.fit.coverage.fraction >= WHOLE
        return at - self.alarmed_at >= (SETTLED_S if is_whole else LASTING_S)


NO_FIT: Final = Evaluated(key=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Arrived:
    """Readings: (N, 7) time in s by the clock of the sensor, field in `unit.inside` and used axes, acceleration."""

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
class Unrecorded:
    """What arrives cannot be written down at present, and why; nothing where it can again."""

    at: float
    words: str


@dataclass(frozen=True, slots=True)
class Requested:
    """A page has asked for something."""

    at: float
    command: Command


@dataclass(frozen=True, slots=True, eq=False)
class FitDone:
    """A fit is done, and took so many seconds."""

    at: float
    evaluated: Evaluated
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A log was opened, to be shown in place of the sensor."""

    at: float
    name: str
    series: Series
    words: str


@dataclass(frozen=True, slots=True, eq=False)
class GotPrevious:
    """A calibration to compare with."""

    at: float
    previous: Fit


@dataclass(frozen=True, slots=True)
class Ticked:
    """Time has passed."""

    at: float


Event = Arrived | Linked | Unrecorded | Requested | FitDone | Opened | GotPrevious | Ticked


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Readings that are fitted together: those of the sensor, or of a log."""

    buffer: ReadingBuffer = field(default_factory=ReadingBuffer.empty)
    unit: Unit = field(default_factory=Unit.of)
    axes: Axes = field(default_factory=Axes)
    frame: str = "sensor"
    exclusions: Exclusions = field(default_factory=Exclusions)  # what was taken out by hand
    paused_at: float | None = None  # s: since when what arrives is left out
    begun_s: float | None = None  # s: it was begun anew then: readings up to that time are on the disk only
    generation: int = 1  # of its points on the page
    key: int = 0  # changes with all that a fit depends on
    since: int = 0  # no fit with a smaller key is of these readings
    evaluated: Evaluated = NO_FIT
    # s: when the fits in a row were done that are within the target: the first three of them
    within: tuple[float, ...] = ()
    is_timed: bool = True  # the times are those of the readings, and not their numbers
    site: Site | None = None  # what a log states of the field where it was made, or a person by the place

    @property
    def known_site(self) -> Site | None:
        """The site as far as readings can be compared with it: those in counts have no strength."""
        if self.site is None or self.unit.inside == MICROTESLA:
            return self.site
        return replace(self.site, strength=None)

    @property
    def advice_frame(self) -> Frame:
        """Whose words advice is given in: those of a vehicle where somebody said how the sensor sits in it."""
        return "vehicle" if self.frame == "vehicle" or not self.axes.is_identity else "sensor"

    @property
    def excluded(self) -> tuple[Span, ...]:
        """Excluded intervals, with the present pause."""
        spans = self.exclusions.spans
        if self.paused_at is None or self.buffer.seconds < self.paused_at:
            return spans
        return merged([*spans, (self.paused_at, self.buffer.seconds)])


@dataclass(frozen=True, slots=True, eq=False)
class LiveSession:
    """State of the server, without its sockets."""

    source: SourceState = NO_SOURCE
    live: Series = field(default_factory=Series)
    timeline: Timeline = field(default_factory=Timeline)  # where the clock of the sensor has got to
    opened: Series | None = None  # a log, shown in place of `live`
    opened_name: str = ""
    target_deg: float = 1.0
    dip_deg: float | None = None  # as a person gave it
    goal: Goal = "heading"
    previous: Fit | None = None  # a calibration of this sensor from before
    refreshes: bool = False  # its soft iron is kept, and its hard iron found anew
    recording: str = ""
    unrecorded: str = ""  # why what arrives cannot be written down; nothing where it can
    has_board: bool = False  # the source is a board that takes a calibration
    revision: int = 0  # grows with each step that changes something
    # given out so far
    keys: int = 0
    generations: int = 1
    is_fitting: bool = False
    due_at: float = 0.0  # s: no fit before
    # s: newest event, and newest reading
    at: float = 0.0
    arrived_at: float = 0.0
    # tuple of (at, seconds, readings): of the last two seconds, and the one before: when they came, the time of the
    # last of them, and how many
    arrivals: tuple[tuple[float, float, int], ...] = ()

    @property
    def shown(self) -> Series:
        """The series that pages show and commands act on."""
        return self.live if self.opened is None else self.opened

    @property
    def renewed(self) -> Fit | None:
        """The calibration from before whose soft iron is kept, or None."""
        return self.previous if self.refreshes else None

    @property
    def is_followed(self) -> bool:
        """Somebody turns the sensor just now, and may be led."""
        return self.opened is None and self.live.paused_at is None and self.source.link == "connected"

    @property
    def view(self) -> View | None:
        """Its newest fit."""
        return self.shown.evaluated.view


Stepped = tuple[LiveSession, list[Notice]]


def step(session: LiveSession, event: Event) -> Stepped:
    """Take one event in; the notices are for all pages, and what else they show follows from the session."""
    return _STEPS[type(event)](replace(session, at=event.at), event)


def _changed(session: LiveSession, **changes: object) -> LiveSession:
    return replace(session, revision=session.revision + 1, **changes)  # type: ignore[arg-type]


def _with_shown(session: LiveSession, series: Series) -> LiveSession:
    """Replace the series that is shown."""
    return _changed(session, **{"live" if session.opened is None else "opened": series})


def _refit(session: LiveSession) -> LiveSession:
    """Mark the shown series as changed, so that it is soon fitted again."""
    keys = session.keys + 1
    session = replace(session, keys=keys, due_at=min(session.due_at, session.at))
    return _with_shown(session, replace(session.shown, key=keys))


def _alone(session: LiveSession) -> LiveSession:
    """Fit the shown series anew, and accept no fit that was begun before."""
    session = _refit(session)
    return _with_shown(session, replace(session.shown, since=session.keys))


def _arrived(session: LiveSession, event: Arrived) -> Stepped:
    """Add readings to those of the sensor; also while a log is shown."""
    if not len(event.rows):
        return session, []
    live = session.live
    keys = session.keys + (live.paused_at is None)
    times, timeline = session.timeline(event.rows[:, 0])
    rows = np.column_stack([times, event.rows[:, 1:]])
    live = replace(live, buffer=live.buffer.extended(rows), unit=event.unit)
    if live.paused_at is None:
        live = replace(live, key=keys)
    source = session.source
    if source.link != "connected":
        session = replace(session, source=SourceState(source.name, source.kind, "connected", ""))
    old = sum(arrival[0] <= event.at - RATE_S for arrival in session.arrivals)
    arrivals = (*session.arrivals[max(old - 1, 0) :], (event.at, timeline.at, len(rows)))
    return _changed(session, live=live, keys=keys, timeline=timeline, arrived_at=event.at, arrivals=arrivals), []


def _linked(session: LiveSession, event: Linked) -> Stepped:
    """Note that the link has changed, and say so."""
    source = SourceState(session.source.name, session.source.kind, event.link, event.words)
    if source == session.source:
        return session, []
    severity: Literal["info", "warning"] = "warning" if event.link == "gone" else "info"
    is_news = event.words and event.link != "ended"  # which a reason says
    return _changed(session, source=source), [Notice(severity, event.words)] if is_news else []


def _unrecorded(session: LiveSession, event: Unrecorded) -> Stepped:
    """Say that the recording has a hole, or goes on."""
    notice = Notice("error", event.words) if event.words else Notice("info", "what arrives is recorded again")
    return _changed(session, unrecorded=event.words), [notice]


def _got_previous(session: LiveSession, event: GotPrevious) -> Stepped:
    return _refit(_changed(session, previous=event.previous, refreshes=False)), []


def _ticked(session: LiveSession, _: Ticked) -> Stepped:
    return session, []


def _requested(session: LiveSession, event: Requested) -> Stepped:
    """Carry out a command of a page; one that changes nothing is no step."""
    return _ANSWERS[type(event.command)](session, event.command)


def _with_goal(session: LiveSession, **wish: object) -> Stepped:
    """Change what the calibration is compared with: target, dip, goal or another calibration."""
    ((name, value),) = wish.items()
    if getattr(session, name) == value:
        return session, []
    session = _refit(_changed(session, **wish))
    return _with_shown(session, replace(session.shown, within=())), []


def _refreshing(session: LiveSession, *, refresh: bool) -> Stepped:
    """Renew the calibration from before, or make one afresh; `UsageError` where there is none that can be renewed."""
    if refresh:
        if session.previous is None:
            raise UsageError(UNFIT["none"])
        refuse_unfit(session.previous)
    return _with_goal(session, refreshes=refresh)


def _placed(session: LiveSession, place: SetPlace) -> Stepped:
    """Take dip and strength of a place in place of the log's; `UsageError` where there is none or no heading."""
    from flinders.core.geomag import site_field
    from flinders.likelihood.site_field import Site

    field = site_field(place.latitude_deg, place.longitude_deg, year=place.year)
    dip_deg = round(field.inclination_deg, 1)
    if abs(dip_deg) > LARGEST_DIP_DEG:
        raise UsageError(f"the dip there is {dip_deg:g}°: no compass works where it is beyond {LARGEST_DIP_DEG:g}°")
    session = _refit(_with_shown(session, replace(session.shown, site=Site.of(field), within=())))
    session, _ = _with_goal(session, dip_deg=dip_deg)
    words = (
        f"the dip at {place.latitude_deg:g}°, {place.longitude_deg:g}° is {dip_deg:g}°, the strength of the field "
        f"{field.strength:.1f} µT ({field.model})"
    )
    return session, [Notice("info", words)]


def _edited(session: LiveSession, edit: Callable[[Exclusions], Exclusions]) -> Stepped:
    """Change the exclusions; without a difference it is no step."""
    exclusions = edit(session.shown.exclusions)
    if exclusions == session.shown.exclusions:
        return session, []
    return _refit(_with_shown(session, replace(session.shown, exclusions=exclusions))), []


def _excluded(session: LiveSession, start: float, end: float) -> Stepped:
    """Exclude an interval, as far as readings have come: later ones are never excluded."""
    buffer = session.shown.buffer
    if not buffer.total:
        return session, []
    span = (max(start, min(float(buffer.time[0]), 0.0)), min(end, buffer.seconds))
    if span[0] > span[1]:
        return session, []
    return _edited(session, lambda exclusions: exclusions.excluding(span))


def _paused(session: LiveSession, *, paused: bool) -> Stepped:
    """Exclude new readings from now on, or no longer: a pause is an exclusion that can be undone."""
    live = session.live
    if session.opened is not None:
        return session, [Notice("warning", "a log is shown, and nothing arrives in it: go back to the sensor first")]
    if paused == (live.paused_at is not None):
        return session, []
    if paused:
        after = float(np.nextafter(live.buffer.seconds, np.inf)) if live.buffer.total else 0.0
        return _changed(session, live=replace(live, paused_at=after)), []
    exclusions = live.exclusions
    if live.paused_at is not None and live.buffer.seconds > live.paused_at:
        exclusions = exclusions.excluding((live.paused_at, live.buffer.seconds))
    return _refit(_changed(session, live=replace(live, paused_at=None, exclusions=exclusions))), []


def _cleared(session: LiveSession) -> Stepped:
    """Begin anew without readings."""
    if session.opened is not None:
        return session, [
            Notice("warning", "a log is shown, which cannot be started again: go back to the sensor first")
        ]
    old = session.live
    number, keys = session.generations + 1, session.keys + 1
    live = Series(
        ReadingBuffer.empty(old.buffer.most),
        begun_s=old.buffer.seconds if old.buffer.total else old.begun_s,
        unit=old.unit,
        axes=old.axes,
        frame=old.frame,
        site=old.site,
        generation=number,
        key=keys,
        since=keys,
    )
    session = _changed(session, live=live, generations=number, keys=keys, arrivals=())
    return session, [Notice("info", "started again; earlier readings stay in the recording")]


def _back_to_live(session: LiveSession) -> Stepped:
    """Close the log."""
    if session.opened is None:
        return session, []
    number = session.generations + 1
    live = replace(session.live, generation=number)
    return _alone(_changed(session, opened=None, opened_name="", live=live, generations=number)), []


def _opened(session: LiveSession, event: Opened) -> Stepped:
    """Show a log."""
    number = session.generations + 1
    series = replace(event.series, generation=number)
    session = _alone(_changed(session, opened=series, opened_name=event.name, generations=number))
    return session, [Notice("info", event.words)]


def _fitted(session: LiveSession, event: FitDone) -> Stepped:
    """Take a fit over, unless it is of another series than the shown one."""
    session = replace(session, is_fitting=False, due_at=event.at + max(event.seconds / SHARE, FASTEST_S))
    shown, key = session.shown, event.evaluated.key
    if not max(shown.since, shown.evaluated.key + 1) <= key <= shown.key:
        return session, []
    shown = replace(shown, evaluated=event.evaluated)
    within = (*shown.within, event.at)[:ENOUGH_FITS] if _is_within(session, event.evaluated) else ()
    return _with_shown(session, replace(shown, within=within)), []


_STEPS: Final[dict[type, Callable[[LiveSession, Any], Stepped]]] = {
    Arrived: _arrived,
    Linked: _linked,
    Unrecorded: _unrecorded,
    Requested: _requested,
    FitDone: _fitted,
    Opened: _opened,
    GotPrevious: _got_previous,
    Ticked: _ticked,
}
_ANSWERS: Final[dict[type, Callable[[LiveSession, Any], Stepped]]] = {
    SetTarget: lambda session, command: _with_goal(session, target_deg=command.deg),
    SetDip: lambda session, command: _with_goal(session, dip_deg=command.deg),
    SetPlace: _placed,
    SetGoal: lambda session, command: _with_goal(session, goal=command.goal),
    PreviousClear: lambda session, _: _with_goal(session, previous=None),
    SetRefresh: lambda session, command: _refreshing(session, refresh=command.refresh),
    Exclude: lambda session, command: _excluded(session, command.start_s, command.end_s),
    Restore: lambda session, command: _edited(
        session, lambda exclusions: exclusions.restoring((command.start_s, command.end_s))
    ),
    Undo: lambda session, _: _edited(session, Exclusions.undone),
    Redo: lambda session, _: _edited(session, Exclusions.redone),
    Pause: lambda session, command: _paused(session, paused=command.paused),
    Clear: lambda session, _: _cleared(session),
    BackToLive: lambda session, _: _back_to_live(session),
}


def wants_fit(session: LiveSession, at: float) -> bool:
    """Whether something changed since the last fit, none is running, and one is due, or the source has ended."""
    shown = session.shown
    is_new = bool(shown.buffer.total) and shown.evaluated.key != shown.key
    is_due = at >= session.due_at or session.source.link == "ended"
    return is_new and not session.is_fitting and is_due


def begin_fit(session: LiveSession) -> LiveSession:
    """Note that a fit runs."""
    return replace(session, is_fitting=True)


def used_readings(session: LiveSession, most: int | None = FITTED) -> tuple[Samples, NDArray[np.intp]]:
    """Readings not taken out, at most so many or all, spread evenly; and (N,) which of the session each is."""
    shown = session.shown
    used = np.flatnonzero(~shown.buffer.within(shown.excluded))
    if most is not None and len(used) > most:
        used = used[:: -(-len(used) // most)]
    samples = Samples(
        field=shown.buffer.field[used],
        unit=shown.unit,
        axes=shown.axes,
        time=shown.buffer.time[used],
        acceleration=shown.buffer.acceleration[used] if shown.buffer.has_acceleration else None,
        source=session.opened_name or session.source.name,
        frame=shown.frame,
    )
    return samples, used * shown.buffer.stride


def worst_deg(session: LiveSession, view: View) -> float | None:
    """The error that is compared with the target; None where it is not known."""
    error = view.heading_error_deg
    if error is None or view.guidance is None:
        return None
    return error.worst if session.goal == "heading" else max(error.worst, view.guidance.worst_deg)


def is_over(session: LiveSession) -> bool:
    """Whether the newest fit is of all readings, and no more come: of a log, in a pause, of a silent sensor."""
    shown = session.shown
    has_ended = shown.paused_at is not None or session.source.link in ("ended", "gone")
    is_silent = has_ended or session.at - session.arrived_at >= SURE_S
    return shown.evaluated.key == shown.key and (session.opened is not None or is_silent)


def is_settled(session: LiveSession, code: str) -> bool:
    """Whether more turning would not end what a reason says."""
    evaluated = session.shown.evaluated
    return code not in evaluated.alarms or is_over(session) or evaluated.is_alarmed(session.at)


def _is_within(session: LiveSession, evaluated: Evaluated) -> bool:
    """Whether a fit says that the target is reached, and nothing that speaks against it."""
    worst = None if evaluated.view is None else worst_deg(session, evaluated.view)
    is_clean = all(reason.severity != "warning" for reason in evaluated.reasons)
    return worst is not None and worst <= session.target_deg and is_clean and evaluated.is_usable
