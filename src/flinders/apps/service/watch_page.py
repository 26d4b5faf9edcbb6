r"""Page of an online calibration, one HTML file: current state, history, and events.

The file needs no server and no network. Its script reloads it, shows its age, and switches between light and dark;
without scripts, a browser reloads it as well.

>>> duration_words(95.0), duration_words(7500.0), duration_words(200000.0)
('95 s', '2\xa0h\xa05\xa0min', '2.3 days')
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from flinders.apps.service.reports import moment, words_of
from flinders.apps.service.timeline_figures import DAY_S, MARKS, timeline
from flinders.core.units import unit_label
from flinders.errors import figures
from flinders.findings.words import as_sentence, capitalise
from flinders.readers._times import MIN_EPOCH_S
from flinders.report.formatting import date_of, degrees
from flinders.report.html_file import html_file, style_of
from flinders.report.modules import join_modules

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.service.reports import Report
    from flinders.findings.row import Severity
    from flinders.workflows.online import OnlineCalibration
    from flinders.workflows.timeline import Doing, OnlinePoint

STATES: Final[dict[Doing, tuple[str, str]]] = {
    "learning": (
        "No calibration is known yet",
        "Turn the vehicle through all attitudes, or all the way round if it stays level.",
    ),
    "undisturbed": ("The newest readings agree with the calibration and improve it", "No action is needed."),
    "disturbed": (
        "The newest readings contradict the calibration: iron or a current is near, or the offset has moved",
        "The heading error includes the difference, and updates are suspended. Turn the vehicle to find the cause.",
    ),
}
"""Title of each state, and what the user should do."""
ADVICE: Final = {
    "good": "Headings are within the target of {target}.",
    "limited": "Headings are beyond the target of {target}: turn the vehicle, all the way round if it stays level.",
    "refused": "Headings are beyond five times the target of {target}: do not rely on this compass. Turn the vehicle, "
    "all the way round if it stays level.",
}
SQUARE: Final = "m-3.5-3.5h7v7h-7z"
"""SVG path of the mark of a changed verdict."""
MAX_EVENTS: Final = 15
"""Largest number of events in the table."""
SPANS: Final[tuple[tuple[str, str, float], ...]] = (
    ("day", "Last 24 hours", DAY_S),
    ("week", "Last week", 7.0 * DAY_S),
    ("all", "All", math.inf),
)
"""Spans of the timeline: name, words and seconds."""


@dataclass(frozen=True, slots=True)
class Note:
    """A note on the page, with its severity."""

    severity: Severity
    title: str
    words: str


@dataclass(frozen=True, slots=True)
class EventRow:
    """An event of the table."""

    when: str
    kind: str
    words: str
    error: str


def page(
    report: Report,
    online: OnlineCalibration | None,
    *,
    told: Sequence[Report] = (),
    troubles: Sequence[str] = (),
    not_sent: str = "",
    every: float | None = None,
    written: datetime | None = None,
) -> str:
    """Write the page.

    Parameters
    ----------
    report : Report
        Current state.
    online : OnlineCalibration, optional
        Calibration with history and timeline; None before the first reading.
    told : sequence of Report
        Changed verdicts and events of the source since the start of the program.
    troubles : sequence of str
        Sentences on files that cannot be written.
    not_sent : str
        Reason of the last failed sending.
    every : float, s, optional
        Period of rewriting the page; None for a final page.
    written : datetime, optional
        Time of writing, by default now.
    """
    when = written or datetime.now(UTC)
    points = () if online is None or not math.isfinite(report.time_s) else online.timeline_until(report.time_s)
    spans = _spans(points)
    given = {
        "report": report,
        "what": "Heading error now",
        "outcome": {"verdict": report.verdict, "title": _title(report), "sentence": _sentence(report)},
        "numbers": _numbers(report, online),
        "notes": _notes(report, troubles, not_sent, is_last=every is None),
        "spans": spans,
        "shown_span": _initial_span(spans),
        "charts": [(name, *_charts(points, seconds, report, name)) for name, _, seconds in spans],
        "events": _events(online, told),
        "shapes": MARKS | dict.fromkeys(ADVICE, SQUARE),
        "source": _source(report, online, is_last=every is None),
        "every": every,
        "written": when.timestamp(),
        "date": date_of(when),
        "release": version("flinders"),
    }
    script = f"\n{join_modules('apps/service/watch.js')}\n"
    style = style_of("apps/service/watch.css")
    return html_file("apps/service/watch.html.j2", given, style=style, script=script, filters=FILTERS)


def duration_words(seconds: float) -> str:
    """Write a duration in words."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    if seconds < 2.0 * DAY_S:
        hours, minutes = divmod(round(seconds / 60.0), 60)
        return "\N{NO-BREAK SPACE}".join(
            f"{count}\N{NO-BREAK SPACE}{unit}" for count, unit in ((hours, "h"), (minutes, "min")) if count
        )
    return f"{seconds / DAY_S:,.1f} days" if seconds < 20.0 * DAY_S else f"{seconds / DAY_S:,.0f} days"


def _title(report: Report) -> str:
    error = _number(report.heading_error_deg)
    return "No calibration yet" if math.isnan(error) else degrees(error)


def _sentence(report: Report) -> str:
    if not report.readings and math.isnan(_number(report.heading_error_deg)):
        return "No reading has arrived yet."
    if report.doing == "learning":
        return STATES["learning"][1]
    return ADVICE[report.verdict].format(target=f"{report.target_deg:g}°")


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _numbers(report: Report, online: OnlineCalibration | None) -> list[tuple[str, str, str]]:
    """Numbers at the head of the page: name, number and words of each; empty without a calibration."""
    if online is None or report.doing == "learning":
        return []
    adopted = [event.time_s for event in online.history if event.code in {"adopted", "taken-back"}]
    since = ("In force since", *_clock(adopted[-1], "when it was adopted")) if adopted else None
    age = _number(report.age_s)
    unit = unit_label(report.unit or "")
    numbers = [
        ("95 % bound", degrees(_number(report.bound_deg)), "for all headings"),
        _good_until(report),
        ("Last update", duration_words(age), f"ago, from readings of {moment(report.time_s - age)}"),
        since,
        ("Offset walks by", f"{figures(_number(report.walk))} {unit}", "in an hour, 1 σ, as estimated"),
    ]
    return [number for number in numbers if number is not None]


def _good_until(report: Report) -> tuple[str, str, str]:
    until = _number(report.good_until_s)
    if report.verdict != "good" or math.isnan(until):
        return "Good until", "–", f"beyond the target of {report.target_deg:g}° now"
    if math.isinf(until):
        return "Good until", "10 years", "and longer, without updates"
    return ("Good until", *_clock(until, f"in {duration_words(until - report.time_s)} without updates"))


def _clock(seconds: float, words: str) -> tuple[str, str]:
    """Two texts for a time: time of day, and date with further words; for a time without a date, only the time."""
    if seconds < MIN_EPOCH_S:
        return moment(seconds), words
    date = datetime.fromtimestamp(seconds, UTC)
    return f"{date:%H:%M}", f"{date:%a} {date.day} {date:%b %Y} UTC; {words}"


def _notes(report: Report, troubles: Sequence[str], not_sent: str, *, is_last: bool) -> list[Note]:
    """Notes on the state, the source, and problems that need the user."""
    means, advice = STATES[report.doing]
    severity: Severity = "limits" if report.doing == "disturbed" else "note"
    notes = [Note(severity, report.doing.capitalize(), f"{as_sentence(means)} {advice}")]
    if is_last:
        notes.append(Note("note", "Ended", "The program has ended, and this page is final."))
    elif not report.is_connected:
        words = f"No readings arrive from {report.source}: check that it is connected, on, and prints."
        notes.append(Note("limits", "No sensor", words))
    if report.is_locked:
        latest = _number(report.latest_deg)
        other = "" if math.isnan(latest) else f" With the newest one the heading error would be {degrees(latest)}."
        notes.append(Note("note", "Locked", f"The calibration in force stays, despite newer estimates.{other}"))
    notes += [Note("limits", "Not sent", as_sentence(not_sent))] if not_sent else []
    return [*notes, *(Note("limits", "Not written", as_sentence(words)) for words in troubles)]


def _source(report: Report, online: OnlineCalibration | None, *, is_last: bool) -> list[tuple[str, str]]:
    """Facts on the source of the readings: name and words of each."""
    state = "no longer read" if is_last else "sends readings" if report.is_connected else "sends no readings"
    return [
        ("Source", report.source),
        ("State", state),
        ("Readings", f"{report.readings:,} since the start of the program"),
        ("Newest reading", "none yet" if online is None or math.isnan(online.time_s) else moment(online.time_s)),
        ("Lines of unknown format", f"{report.not_understood:,}"),
        ("Disconnections", f"{report.disconnections:,}"),
    ]


def _spans(points: Sequence[OnlinePoint]) -> list[tuple[str, str, float]]:
    """Spans that the timeline can show: shorter ones if they differ from the whole, then the whole."""
    if len(points) < 2:
        return []
    whole = points[-1].time_s - points[0].time_s
    return [span for span in SPANS if span[2] < 0.8 * whole or span[0] == "all"]


def _initial_span(spans: Sequence[tuple[str, str, float]]) -> str:
    """Name of the span to show first."""
    names = [name for name, _, _ in spans]
    return "week" if "week" in names else "all"


def _charts(points: Sequence[OnlinePoint], seconds: float, report: Report, name: str) -> tuple[str, str]:
    """Drawings of a span of the timeline, for wide and for narrow screens."""
    begin = points[-1].time_s - seconds
    first = next(place for place, point in enumerate(points) if point.time_s >= begin)
    shown, unit = points[max(first - 1, 0) :], unit_label(report.unit or "")
    wide, narrow = (
        timeline(shown, target_deg=report.target_deg, unit=unit, wide=is_wide, name=f"{name}-{is_wide}", begin=begin)
        for is_wide in (True, False)
    )
    return wide, narrow


def _events(online: OnlineCalibration | None, told: Sequence[Report]) -> list[EventRow]:
    """Newest events, newest first; consecutive calibrations form one row."""
    of_calibration = [] if online is None else list(online.history)
    adopted_with = {event.time_s for event in of_calibration if event.code in {"learnt", "moved"}}
    rows = [
        (event.time_s, str(event.code), words_of(event.code), event.heading_error_deg)
        for event in of_calibration
        if not (event.code == "adopted" and event.time_s in adopted_with)
    ]
    rows += [(each.time_s, each.event or "", each.words or "", _number(each.heading_error_deg)) for each in told]
    rows.sort(key=lambda row: row[0])
    groups = [list(group) for _, group in itertools.groupby(rows, key=lambda row: row[1])]
    return [_row(group) for group in reversed(groups[-MAX_EVENTS:])]


def _row(group: Sequence[tuple[float, str, str, float]]) -> EventRow:
    """Row of consecutive events of one kind, with the time of the newest."""
    time_s, code, words, error = group[-1]
    often = f" ({len(group)} times since {moment(group[0][0])})" if len(group) > 1 else ""
    shown = "" if math.isnan(error) else degrees(error)
    return EventRow(moment(time_s) if math.isfinite(time_s) else "", code, f"{capitalise(words)}{often}", shown)


FILTERS: Final = {"sentence": as_sentence}
"""Filters of the template."""
