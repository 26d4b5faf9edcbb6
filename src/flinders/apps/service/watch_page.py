r"""What is known of a calibration that keeps itself, as one HTML file: now, over time, and what happened.

The file needs nothing else: no server, no network. Its script loads it again, says how old it is, and switches between
light and dark; without the script a browser loads it again, too.

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

from flinders.apps.service.clocks import FROM_1970_S
from flinders.apps.service.reports import moment, words_of
from flinders.apps.service.timeline_figures import DAY_S, MARKS, timeline
from flinders.core.units import label
from flinders.errors import figures
from flinders.findings.words import as_sentence, capitalised
from flinders.report.formatting import date_of, degrees
from flinders.report.html_file import html_file, style_of
from flinders.report.modules import joined

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
    "undisturbed": ("The newest readings agree with the calibration, which learns from them", "Nothing is to be done."),
    "disturbed": (
        "The newest readings contradict the calibration: iron or a current is near, or the offset has moved",
        "The difference is in the heading error, and nothing is learnt. Turn the vehicle: that tells which it is.",
    ),
}
"""What each state means, and what to do."""
ADVICE: Final = {
    "good": "Headings are within the target of {target}.",
    "limited": "Headings are beyond the target of {target}: turn the vehicle, all the way round if it stays level.",
    "refused": "Headings are beyond five times the target of {target}: do not rely on this compass. Turn the vehicle, "
    "all the way round if it stays level.",
}
SQUARE: Final = "m-3.5-3.5h7v7h-7z"
"""How a verdict that changed is drawn."""
NEWEST: Final = 15
"""Events in the table."""
SPANS: Final[tuple[tuple[str, str, float], ...]] = (
    ("day", "Last 24 hours", DAY_S),
    ("week", "Last week", 7.0 * DAY_S),
    ("all", "All", math.inf),
)
"""That the timeline can show: name, words and seconds."""


@dataclass(frozen=True, slots=True)
class Note:
    """Something to know."""

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
        What is known now.
    online : OnlineCalibration, optional
        With its history and its timeline; None before the first reading.
    told : sequence of Report
        Verdicts that changed and events of the source, since the program was started.
    troubles : sequence of str
        What cannot be written now, a sentence each.
    not_sent : str
        Why the last calibration that was to be sent was not.
    every : float, s, optional
        After which the page is written again; None of one that is not.
    written : datetime, optional
        By default now.
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
        "shown_span": _usual(spans),
        "charts": [(name, *_charts(points, seconds, report, name)) for name, _, seconds in spans],
        "events": _events(online, told),
        "shapes": MARKS | dict.fromkeys(ADVICE, SQUARE),
        "source": _source(report, online, is_last=every is None),
        "every": every,
        "written": when.timestamp(),
        "date": date_of(when),
        "release": version("flinders"),
    }
    script = f"\n{joined('apps/service/watch.js')}\n"
    style = style_of("apps/service/watch.css")
    return html_file("apps/service/watch.html.j2", given, style=style, script=script, filters=FILTERS)


def duration_words(seconds: float) -> str:
    """Say how long something takes."""
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
        return "No reading has come yet."
    if report.doing == "learning":
        return STATES["learning"][1]
    return ADVICE[report.verdict].format(target=f"{report.target_deg:g}°")


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _numbers(report: Report, online: OnlineCalibration | None) -> list[tuple[str, str, str]]:
    """Name, number and words of what is known; nothing without a calibration."""
    if online is None or report.doing == "learning":
        return []
    adopted = [event.time_s for event in online.history if event.code in {"adopted", "taken-back"}]
    since = ("In force since", *_clock(adopted[-1], "when it was adopted")) if adopted else None
    age = _number(report.age_s)
    unit = label(report.unit or "")
    numbers = [
        ("95 % bound", degrees(_number(report.bound_deg)), "no heading is farther off, with 95 %"),
        _good_until(report),
        ("Learnt last", duration_words(age), f"ago, from readings of {moment(report.time_s - age)}"),
        since,
        ("Offset walks by", f"{figures(_number(report.walk))} {unit}", "in an hour, 1 σ: as it was learnt"),
    ]
    return [number for number in numbers if number is not None]


def _good_until(report: Report) -> tuple[str, str, str]:
    until = _number(report.good_until_s)
    if report.verdict != "good" or math.isnan(until):
        return "Good until", "–", f"beyond the target of {report.target_deg:g}° now"
    if math.isinf(until):
        return "Good until", "10 years", "and longer, if nothing is learnt"
    return ("Good until", *_clock(until, f"in {duration_words(until - report.time_s)} if nothing is learnt"))


def _clock(seconds: float, words: str) -> tuple[str, str]:
    """A time of day, and its day with other words; of a clock without a date, the time alone."""
    if seconds < FROM_1970_S:
        return moment(seconds), words
    date = datetime.fromtimestamp(seconds, UTC)
    return f"{date:%H:%M}", f"{date:%a} {date.day} {date:%b %Y} UTC; {words}"


def _notes(report: Report, troubles: Sequence[str], not_sent: str, *, is_last: bool) -> list[Note]:
    """What there is to know: state, source, and what else asks for somebody."""
    means, advice = STATES[report.doing]
    severity: Severity = "limits" if report.doing == "disturbed" else "note"
    notes = [Note(severity, report.doing.capitalize(), f"{as_sentence(means)} {advice}")]
    if is_last:
        notes.append(Note("note", "Ended", "The program has ended, and this page stays as it is."))
    elif not report.is_connected:
        words = f"No readings come from {report.source}: see that it is connected, on, and prints."
        notes.append(Note("limits", "No sensor", words))
    if report.is_locked:
        latest = _number(report.latest_deg)
        other = "" if math.isnan(latest) else f" With the newest one the heading error would be {degrees(latest)}."
        notes.append(Note("note", "Locked", f"The calibration in force stays, whatever is learnt.{other}"))
    notes += [Note("limits", "Not sent", as_sentence(not_sent))] if not_sent else []
    return [*notes, *(Note("limits", "Not written", as_sentence(words)) for words in troubles)]


def _source(report: Report, online: OnlineCalibration | None, *, is_last: bool) -> list[tuple[str, str]]:
    """Name and words of what is known of the source."""
    state = "not read any more" if is_last else "readings come" if report.is_connected else "no readings come"
    return [
        ("Source", report.source),
        ("State", state),
        ("Readings", f"{report.readings:,} since the program was started"),
        ("Newest reading", "none yet" if online is None or math.isnan(online.time_s) else moment(online.time_s)),
        ("Lines not understood", f"{report.not_understood:,}"),
        ("Disconnections", f"{report.disconnections:,}"),
    ]


def _spans(points: Sequence[OnlinePoint]) -> list[tuple[str, str, float]]:
    """What the timeline can show, the whole last; shorter ones where they differ from it."""
    if len(points) < 2:
        return []
    whole = points[-1].time_s - points[0].time_s
    return [span for span in SPANS if span[2] < 0.8 * whole or span[0] == "all"]


def _usual(spans: Sequence[tuple[str, str, float]]) -> str:
    """The span that is shown at first."""
    names = [name for name, _, _ in spans]
    return "week" if "week" in names else "all"


def _charts(points: Sequence[OnlinePoint], seconds: float, report: Report, name: str) -> tuple[str, str]:
    """A span of the timeline, for wide and for narrow screens."""
    begin = points[-1].time_s - seconds
    first = next(place for place, point in enumerate(points) if point.time_s >= begin)
    shown, unit = points[max(first - 1, 0) :], label(report.unit or "")
    wide, narrow = (
        timeline(shown, target_deg=report.target_deg, unit=unit, wide=is_wide, name=f"{name}-{is_wide}", begin=begin)
        for is_wide in (True, False)
    )
    return wide, narrow


def _events(online: OnlineCalibration | None, told: Sequence[Report]) -> list[EventRow]:
    """The newest events, the newest first; calibrations that followed each other count as one."""
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
    return [_row(group) for group in reversed(groups[-NEWEST:])]


def _row(group: Sequence[tuple[float, str, str, float]]) -> EventRow:
    """Events of one kind that followed each other, as the newest of them."""
    time_s, code, words, error = group[-1]
    often = f" ({len(group)} times since {moment(group[0][0])})" if len(group) > 1 else ""
    shown = "" if math.isnan(error) else degrees(error)
    return EventRow(moment(time_s) if math.isfinite(time_s) else "", code, f"{capitalised(words)}{often}", shown)


FILTERS: Final = {"sentence": as_sentence}
"""How the page writes words."""
