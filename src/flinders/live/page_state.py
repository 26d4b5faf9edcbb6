"""What a page shows of a session: its state in words and numbers, and the points that the page lacks.

>>> from flinders.live.session import LiveSession
>>> session_state(LiveSession()).phase, session_state(LiveSession()).words
('waiting', 'Waiting for readings from no source.')
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.units import label
from flinders.errors import figures
from flinders.live.messages import Reason, SessionState, points_frame
from flinders.live.session import ENOUGH_FITS, RATE_S, SURE_S, is_over, is_settled, worst_deg

if TYPE_CHECKING:
    from flinders.live.messages import Phase
    from flinders.live.session import LiveSession
    from flinders.report.view import View

SILENT_S: Final = 3.0  # Seconds without a reading after which that is said; or so many usual steps of a slow sensor
SILENT_STEPS: Final = 5.0
FRAME_POINTS: Final = 20_000  # Points in one frame, at most: a page that comes late gets them in two
TILT: Final = "tilt it by 30° to all sides for ten seconds, or turn it on level ground"
LEVEL_DEG: Final = 89.0  # A calibration that is good to so much tilt needs no word about tilt


def session_state(session: LiveSession) -> SessionState:
    """The state message of a session."""
    shown, evaluated = session.shown, session.shown.evaluated
    phase, words, told, reasons = _phase(session)
    dip_deg = _known_dip_deg(session)
    return SessionState(
        revision=session.revision,
        source=session.source,
        unit=label(shown.unit.inside),
        readings=shown.buffer.total,
        used=evaluated.used,
        rejected=evaluated.rejected,
        excluded_readings=shown.buffer.count_within(shown.excluded),
        rate_hz=_rate_hz(session),
        seconds=shown.buffer.seconds if shown.is_timed else None,
        phase=phase,
        words=words,
        told=told,
        reasons=reasons,
        target_deg=session.target_deg,
        dip_deg=ASSUMED_DIP_DEG if dip_deg is None else dip_deg,
        dip_assumed=dip_deg is None,
        goal=session.goal,
        excluded=shown.excluded,
        can_undo=bool(shown.exclusions.past),
        can_redo=bool(shown.exclusions.future),
        stride=shown.buffer.shown_stride,
        paused=session.live.paused_at is not None,
        recording=session.recording or None,
        previous=None if session.previous is None else evaluated.previous,
        refreshing=session.renewed is not None,
        opened=session.opened_name or None,
        can_send=session.has_board and session.opened is None and evaluated.is_usable,
    )


def _known_dip_deg(session: LiveSession) -> float | None:
    """Dip that a person gave, or else that of the site of the shown log to a tenth; None where one is assumed."""
    site = session.shown.site
    if session.dip_deg is not None or site is None or site.inclination_deg is None:
        return session.dip_deg
    return round(site.inclination_deg, 1)


def _rate_hz(session: LiveSession) -> float | None:
    """Readings a second by their own times, over the last two seconds; None where none came."""
    # from the last reading of the first arrival to the last of all: it does not matter how many came together
    arrivals = session.arrivals
    if len(arrivals) < 2:
        return None
    first, last = arrivals[0], arrivals[-1]
    is_silent = session.at - last[0] >= max(RATE_S, 2.0 * (last[0] - arrivals[-2][0]))
    if is_silent or last[1] <= first[1]:
        return None
    return sum(count for _, _, count in arrivals[1:]) / (last[1] - first[1])


def _phase(session: LiveSession) -> tuple[Phase, str, str | None, tuple[Reason, ...]]:
    """Phase of the session, a sentence about it, the code of the reason that it says, and the reasons against it."""
    link = [] if session.opened is not None else _of_link(session)
    unrecorded = [Reason("not-recorded", session.unrecorded, "info")] if session.unrecorded else []
    reasons = (*link, *_settled(session), *unrecorded)
    wrong = next((reason for reason in reasons if reason.severity == "warning"), None)
    if wrong is not None:
        return "wrong", _sentence(wrong.advice), wrong.code, reasons
    if not session.shown.buffer.total and session.source.link != "ended":
        return "waiting", f"Waiting for readings from {session.source.name}.", None, reasons
    if session.view is None:
        return "collecting", *_before_a_fit(session), reasons
    phase, words = _of_view(session, session.view)
    return phase, words, None, reasons


def _settled(session: LiveSession) -> tuple[Reason, ...]:
    """Reasons of the newest fit; a finding that more turning may end is no warning yet."""
    reasons = [
        reason if is_settled(session, reason.code) else Reason(reason.code, f"so far {reason.advice}", "info")
        for reason in session.shown.evaluated.reasons
    ]
    return tuple(sorted(reasons, key=lambda reason: reason.severity != "warning"))


def _of_view(session: LiveSession, view: View) -> tuple[Phase, str]:
    """How far the newest fit has come."""
    target, worst = f"the target {session.target_deg:g}°", worst_deg(session, view)
    if worst is None:
        return "collecting", view.sentence
    if worst > session.target_deg:
        known = f"the worst error to expect is {figures(worst)}° (1 σ)" if worst < 90.0 else "no heading is known yet"
        return "collecting", f"Keep turning: {known}, {target}."
    what = "heading error" if session.goal == "heading" else "error at any attitude"
    done = f"the worst {what} to expect is {figures(worst)}° ({_bound(session, view)}), {target}"
    if not all(is_settled(session, code) for code in session.shown.evaluated.alarms):
        return "collecting", f"Keep turning: {done}, but a fault was found that more readings may disprove."
    if view.verdict != "refused" and not _is_sure(session):
        return "collecting", f"Almost: {done}; keep turning a little."
    by_verdict: dict[str, tuple[Phase, str]] = {
        "good": ("good", f"Good: {done}.{_resting_on(view)}"),
        "limited": ("limited", f"Good enough, with limits: {done}{_as_far_as(view)}."),
        "refused": ("wrong", view.sentence),
    }
    return by_verdict[view.verdict]


def _bound(session: LiveSession, view: View) -> str:
    """What all headings are within, where that is the goal; else what the error is."""
    error = view.heading_error_deg
    if session.goal != "heading" or error is None:
        return "1 σ"
    return f"95 % within {figures(error.bound_95)}°"


def _resting_on(view: View) -> str:
    """What that rests on."""
    return f" {_sentence(view.condition)}" if view.condition else ""


def _as_far_as(view: View) -> str:
    """Up to which tilt that holds, and what is missing beyond."""
    limit = view.attitude_limit_deg
    if limit is None or limit >= LEVEL_DEG:
        return ""
    tilt = "while level" if limit < 1.0 else f"up to {limit:.0f}° of tilt"
    return f", {tilt}; for more tilt than that, turn it tilted and upside down too"


def _is_sure(session: LiveSession) -> bool:
    """Whether it takes no further fit to say that the target is reached: several did, or there will be no other."""
    within = session.shown.within
    is_repeated = len(within) >= ENOUGH_FITS or (len(within) > 0 and within[-1] - within[0] >= SURE_S)
    return is_repeated or is_over(session)


def _before_a_fit(session: LiveSession) -> tuple[str, str | None]:
    """What to say while there are no numbers, and the code of the reason that it is."""
    if not session.shown.buffer.total:
        return f"{session.source.name} has ended without a reading.", None
    turn = "turn the sensor slowly through all directions" if session.renewed is None else TILT
    if any(reason.code == "no-rotation" for reason in session.shown.evaluated.reasons):
        return f"Start turning: {turn}.", None
    evaluated = session.shown.evaluated
    if not evaluated.refusal:
        return f"Looking at the first readings. {_sentence(turn)}", None
    return _sentence(evaluated.refusal), evaluated.refusal_code or None


def _sentence(words: str) -> str:
    """Begin with a capital, unless it begins with a name: that of a file or port is written as it is.

    >>> _sentence("no reading has come"), _sentence("full.csv: cannot be written"), _sentence("")
    ('No reading has come.', 'full.csv: cannot be written.', '.')
    """
    first = words.partition(" ")[0].rstrip(",")
    begin = words[:1].upper() if first.isalpha() else words[:1]
    return f"{begin}{words[1:].rstrip('.')}."


def _of_link(session: LiveSession) -> list[Reason]:
    """Reasons why no readings arrive."""
    source, since = session.source, session.at - session.arrived_at
    if source.link == "gone":
        return [Reason("gone", source.words or f"{source.name} is gone: check the cable")]
    total, seconds = session.live.buffer.total, session.live.buffer.seconds
    patience = max(SILENT_S, SILENT_STEPS * seconds / total if total else 0.0)
    if source.link == "waiting" and not total and source.words:
        return [Reason("nothing-arrives", source.words)]
    if source.link in ("connected", "waiting") and total and since > patience:
        return [Reason("nothing-arrives", _nothing_arrives(session, since), _severity(session))]
    if source.link == "ended":
        return [Reason("ended", source.words or f"{source.name} has ended", "info")]
    return []


def _severity(session: LiveSession) -> Literal["info", "warning"]:
    """A source that has stopped is a fault; one that has sent nothing yet, as in a resumed session, is not."""
    return "warning" if session.arrived_at else "info"


def _nothing_arrives(session: LiveSession, since: float) -> str:
    """How long no reading has come, and what to check."""
    return (
        f"no reading has come for {since:.0f} s from {session.source.name}: check that the sensor is on and prints "
        "its readings, and that port, cable and baud rate are right"
    )


@dataclass(frozen=True, slots=True)
class Cursor:
    """How far a page has got with the points."""

    # of those it has
    generation: int = 0
    stride: int = 1
    count: int = 0  # how many it has
    total: int = -1  # readings there were when the newest reading was sent


def points(session: LiveSession, cursor: Cursor) -> tuple[bytes | None, Cursor]:
    """The points that a page does not have yet, and the newest reading; None where there is nothing new.

    A page with every second point too many keeps every second one, as the frame's stride says.
    """
    shown = session.shown
    buffer, stride = shown.buffer, shown.buffer.shown_stride
    if cursor.generation != shown.generation:
        count = 0
    elif cursor.total == buffer.total and cursor.stride == stride:
        return None, cursor
    else:
        count = -(-cursor.count // (stride // cursor.stride))
    time, raw, acceleration = buffer.shown(count, FRAME_POINTS)
    frame = points_frame(
        generation=shown.generation,
        first=count,
        stride=stride,
        now=buffer.latest[1:],
        time=time,
        field=raw,
        acceleration=acceleration if buffer.has_acceleration else None,
    )
    is_all = len(time) < FRAME_POINTS
    return frame, Cursor(shown.generation, stride, count + len(time), buffer.total if is_all else -1)
