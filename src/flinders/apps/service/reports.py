"""State of an online calibration at a time, as a line, as JSON, and as text for Prometheus."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from flinders.readers._times import MIN_EPOCH_S
from flinders.report.formatting import degrees
from flinders.workflows.online_events import ACTIVITIES, CODES, WORDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.verdicts import Verdict
    from flinders.workflows.timeline import Doing

Kind: TypeAlias = Literal["state", "event", "source", "send"]
MAX_DATE_S: Final = 2.5e11  # Latest date, seconds from 1970
VERDICTS: Final[dict[Verdict, str]] = {
    "good": "the heading error is within the target",
    "limited": "the heading error is beyond the target",
    "refused": "the heading error is beyond five times the target",
}
"""Sentences on a verdict that changed without an event of the calibration."""
EVENTS: Final = (*CODES.values(), "other-release", "good", "limited", "refused", "sent", "not-sent")
"""Events that are counted."""


@dataclass(frozen=True, slots=True)
class Report:
    """Report of an online calibration: its state at a time, or an event."""

    kind: Kind  # periodic state, event of the calibration, event of the source, or sending
    event: str | None  # code of the event, for an event of the source as in `FeedEvent`; None for a periodic state
    words: str | None  # the event in words
    time_s: float  # time by the clock of the readings, from 1970 if known
    time: str | None  # `time_s` as a date (UTC); None if it does not count from 1970
    doing: Doing  # `learning` without a calibration, `disturbed` if readings contradict it, else `undisturbed`
    verdict: Verdict  # `good` within the target, `refused` beyond five times the target or without a calibration
    heading_error_deg: float | None  # worst heading, level, 1 σ, with the calibration in force; None without one
    bound_deg: float | None  # bound on the heading error of all headings, with a probability of 95 %
    latest_deg: float | None  # heading error with the newest calibration, which may not be in force
    age_s: float | None  # time since readings last improved the calibration
    walk: float | None  # random walk of the offset in an hour, 1 σ, in `unit`
    offset: tuple[float, float, float] | None  # newest estimate, in force or not, in `unit`; None without an estimate
    offset_sigma: tuple[float, float, float] | None  # 1 σ of its components, in `unit`
    radius: float | None  # mean length of readings about the offset, in `unit`
    # unit of `walk`, `offset` and `radius`: `uT`, or `counts` if the scale is unknown; None before the first reading
    unit: str | None
    target_deg: float  # target of the heading error
    # time at which the error reaches the target without further updates; None if unknown, or beyond 10 years
    good_until_s: float | None
    good_until: str | None  # `good_until_s` as a date (UTC)
    is_locked: bool  # the calibration in force stays, despite newer estimates
    readings: int  # number of readings since this program was started
    events: dict[str, int]  # number of events since this program was started, by code
    not_understood: int  # lines of unknown format
    disconnections: int  # number of losses of the source
    is_connected: bool  # the source is present and sends readings
    source: str  # name of the source

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready form; unknown numbers are null."""
        return {name: _json_value(value) for name, value in asdict(self).items()}

    def line(self) -> str:
        """Line for the user: time, event, current heading error, and the time until which it is good."""
        parts = [moment(self.time_s), self.words or "", self._claim()]
        return "  ".join(filter(None, parts))

    def _claim(self) -> str:
        """Expected heading error in words."""
        error, bound, until = self.heading_error_deg, self.bound_deg, self.good_until_s
        if error is None or bound is None or not math.isfinite(error):
            return "" if self.kind == "source" else "no calibration yet"
        claim = f"heading error {degrees(error)}, 95 % within {degrees(bound)}"
        if self.verdict != "good" or until is None or math.isnan(until):
            return f"{claim}, target {self.target_deg:g}°"
        return f"{claim}, good {f'until {moment(until)}' if math.isfinite(until) else 'for ten years'}"

    def prometheus(self) -> str:
        """Text for the textfile collector of Prometheus's node exporter."""
        error, bound = self.heading_error_deg, self.bound_deg
        gauges = {
            "heading_error_degrees": ("Heading error of a level vehicle, worst heading, 1 sigma.", error),
            "heading_error_bound_degrees": ("Bound on the heading error of all headings, 95 %.", bound),
            "heading_error_target_degrees": ("Target of the heading error.", self.target_deg),
            "calibration_age_seconds": ("Time since readings last improved the calibration.", self.age_s),
            "good_until_timestamp_seconds": ("Time at which the heading error reaches the target.", self.good_until_s),
            "report_timestamp_seconds": ("Time of this report.", self.time_s),
            "connected": ("Whether the sensor is connected and sends readings.", float(self.is_connected)),
        }
        lines = [_metric(name, "gauge", words, {"": value}) for name, (words, value) in gauges.items()]
        states = {f'{{state="{name}"}}': float(name == self.doing) for name in ACTIVITIES}
        counted = {f'{{event="{name}"}}': float(self.events.get(name, 0)) for name in EVENTS}
        walk = {f'{{unit="{self.unit or ""}"}}': self.walk}
        lines += [
            _metric("calibration_state", "gauge", "State of the calibration.", states),
            _metric("offset_walk_per_root_hour", "gauge", "Random walk of the offset in an hour, 1 sigma.", walk),
            _metric("readings_total", "counter", "Readings taken.", {"": float(self.readings)}),
            _metric("events_total", "counter", "Number of events.", counted),
            _metric(
                "lines_not_understood_total", "counter", "Lines of unknown format.", {"": float(self.not_understood)}
            ),
            _metric("disconnections_total", "counter", "Losses of the source.", {"": float(self.disconnections)}),
        ]
        return "".join(lines)


def moment(seconds: float) -> str:
    """Time in words: a date if it counts from 1970, else a duration.

    >>> moment(1795946435.0), moment(4.84)
    ('2026-11-29 10:00:35', '4.8 s')
    """
    written = date_of(seconds)
    return f"{seconds:,.1f} s" if written is None else written[:-1].replace("T", " ")


def date_of(seconds: float) -> str | None:
    """Time as a date, UTC, if it counts from 1970, else None."""
    if not MIN_EPOCH_S <= seconds <= MAX_DATE_S:
        return None
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def words_of(code: str) -> str:
    """Sentence on an event, from its code."""
    return {str(known): words for table in (WORDS, VERDICTS) for known, words in table.items()}[code]


def _json_value(value: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, tuple):
        return list(value) if all(map(math.isfinite, value)) else None
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _metric(name: str, kind: str, words: str, values: Mapping[str, float | None]) -> str:
    """Lines of one metric, one for each label."""
    full = f"flinders_{name}"
    rows = (f"{full}{labels} {_number(value)}\n" for labels, value in values.items())
    return f"# HELP {full} {words}\n# TYPE {full} {kind}\n{''.join(rows)}"


def _number(value: float | None) -> str:
    """Number in the format of Prometheus."""
    if value is None or math.isnan(value):
        return "NaN"
    return f"{value:.15g}" if math.isfinite(value) else "+Inf"
