"""What is known of a calibration that keeps itself at a time: a line, JSON, and text for Prometheus."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from flinders.apps.service.clocks import FROM_1970_S
from flinders.report.formatting import degrees
from flinders.workflows.online_events import CODES, DOING, WORDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.verdicts import Verdict
    from flinders.workflows.timeline import Doing

Kind: TypeAlias = Literal["state", "event", "source", "send"]
LATEST_S: Final = 2.5e11  # Seconds from 1970 that a date can have
VERDICTS: Final[dict[Verdict, str]] = {
    "good": "the heading error is within the target",
    "limited": "the heading error is beyond the target",
    "refused": "the heading error is beyond five times the target",
}
"""What a verdict means that changed without an event of the calibration."""
EVENTS: Final = (*CODES.values(), "other-release", "good", "limited", "refused", "sent", "not-sent")
"""What is counted."""


@dataclass(frozen=True, slots=True)
class Report:
    """What is known at a time."""

    kind: Kind  # why it is told: time has passed, something happened to the calibration or the source, it was sent
    event: str | None  # what happened; of the source as in `Recording`; None where time has passed
    words: str | None  # the same, for people
    time_s: float  # s: by the clock of the readings, from 1970 where that is known
    time: str | None  # the same as a date (UTC)
    doing: Doing  # `learning` without a calibration, `undisturbed`, or `disturbed` where readings contradict it
    verdict: Verdict  # `good` within the target, `refused` beyond five times the target or without a calibration
    heading_error_deg: float | None  # worst heading, level, 1 σ, with the calibration in force; None without one
    bound_deg: float | None  # that no heading exceeds with 95 %
    latest_deg: float | None  # heading error with the newest calibration, which may not be in force
    age_s: float | None  # since readings last told something of the calibration
    walk: float | None  # by which the offset moves in an hour, 1 σ, in `unit`
    offset: tuple[float, float, float] | None  # newest estimate, in force or not, in `unit`; None without one
    offset_sigma: tuple[float, float, float] | None  # 1 σ of its components, in `unit`
    radius: float | None  # mean length of readings about the offset, in `unit`
    # of `walk`, `offset` and `radius`: `uT`, or `counts` where no scale is known; None before the first reading
    unit: str | None
    target_deg: float  # heading error that is good enough
    good_until_s: (
        float | None
    )  # s: when it reaches the target if nothing is learnt; None where unknown, or beyond 10 years
    good_until: str | None  # the same as a date (UTC)
    is_locked: bool  # the calibration in force stays, whatever is learnt
    readings: int  # since this program was started
    events: dict[str, int]  # how often each event has happened since then, by name
    not_understood: int  # lines
    disconnections: int  # how often the source went away
    is_connected: bool  # the source is there, and sends readings
    source: str  # where readings come from

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; numbers that are not known are null."""
        return {name: _known(value) for name, value in asdict(self).items()}

    def line(self) -> str:
        """For people: the time, what happened, the heading error now, and how long it is good."""
        parts = [moment(self.time_s), self.words or "", self._claim()]
        return "  ".join(filter(None, parts))

    def _claim(self) -> str:
        """What to expect of the heading."""
        error, bound, until = self.heading_error_deg, self.bound_deg, self.good_until_s
        if error is None or bound is None or not math.isfinite(error):
            return "" if self.kind == "source" else "no calibration yet"
        claim = f"heading error {degrees(error)}, 95 % within {degrees(bound)}"
        if self.verdict != "good" or until is None or math.isnan(until):
            return f"{claim}, target {self.target_deg:g}°"
        return f"{claim}, good {f'until {moment(until)}' if math.isfinite(until) else 'for ten years'}"

    def prometheus(self) -> str:
        """For the textfile collector of Prometheus's node exporter."""
        error, bound = self.heading_error_deg, self.bound_deg
        gauges = {
            "heading_error_degrees": ("Heading error of a level vehicle, worst heading, 1 sigma.", error),
            "heading_error_bound_degrees": ("Heading error that no heading exceeds with 95 %.", bound),
            "heading_error_target_degrees": ("Heading error that is good enough.", self.target_deg),
            "calibration_age_seconds": ("Since readings last told something of the calibration.", self.age_s),
            "good_until_timestamp_seconds": ("When the heading error reaches the target.", self.good_until_s),
            "report_timestamp_seconds": ("When this was known.", self.time_s),
            "connected": ("Whether the sensor is there, and sends readings.", float(self.is_connected)),
        }
        lines = [_metric(name, "gauge", words, {"": value}) for name, (words, value) in gauges.items()]
        states = {f'{{state="{name}"}}': float(name == self.doing) for name in DOING}
        counted = {f'{{event="{name}"}}': float(self.events.get(name, 0)) for name in EVENTS}
        walk = {f'{{unit="{self.unit or ""}"}}': self.walk}
        lines += [
            _metric("calibration_state", "gauge", "What the calibration does now.", states),
            _metric("offset_walk_per_root_hour", "gauge", "By which the offset moves in an hour, 1 sigma.", walk),
            _metric("readings_total", "counter", "Readings taken.", {"": float(self.readings)}),
            _metric("events_total", "counter", "What has happened.", counted),
            _metric("lines_not_understood_total", "counter", "Lines left out.", {"": float(self.not_understood)}),
            _metric("disconnections_total", "counter", "How often the source went.", {"": float(self.disconnections)}),
        ]
        return "".join(lines)


def moment(seconds: float) -> str:
    """A time for people: a date where it counts from 1970.

    >>> moment(1795946435.0), moment(4.84)
    ('2026-11-29 10:00:35', '4.8 s')
    """
    written = date_of(seconds)
    return f"{seconds:,.1f} s" if written is None else written[:-1].replace("T", " ")


def date_of(seconds: float) -> str | None:
    """A time as a date, UTC, where it counts from 1970."""
    if not FROM_1970_S <= seconds <= LATEST_S:
        return None
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def words_of(code: str) -> str:
    """What an event means."""
    return {str(known): words for table in (WORDS, VERDICTS) for known, words in table.items()}[code]


def _known(value: Any) -> Any:  # noqa: ANN401 - JSON
    if isinstance(value, tuple):
        return list(value) if all(map(math.isfinite, value)) else None
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _metric(name: str, kind: str, words: str, values: Mapping[str, float | None]) -> str:
    """Lines of one metric, by its labels."""
    full = f"flinders_{name}"
    rows = (f"{full}{labels} {_number(value)}\n" for labels, value in values.items())
    return f"# HELP {full} {words}\n# TYPE {full} {kind}\n{''.join(rows)}"


def _number(value: float | None) -> str:
    """A number as Prometheus reads it."""
    if value is None or math.isnan(value):
        return "NaN"
    return f"{value:.15g}" if math.isfinite(value) else "+Inf"
