"""What an online calibration knew over time: points close together at the end, thinned before, bounded in number.

The times of the readings alone decide which points there are: how readings are cut makes no difference.

>>> timeline = Timeline()
>>> for minute in range(100_000):
...     timeline.put(OnlinePoint(60.0 * minute, "learning"))
>>> times = [point.time_s for point in timeline.points]
>>> len(times) <= MOST_POINTS, times[0], times[-1] - times[-2]
(True, 0.0, 60.0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self, get_args

if TYPE_CHECKING:
    from collections.abc import Mapping

Doing = Literal["learning", "undisturbed", "disturbed"]
Code = Literal["learnt", "contradicted", "passed", "moved", "adopted", "clock-back", "taken-back", "other-release"]

EVERY_S: Final = 60.0
"""From one point to the next, without an event."""
MOST_POINTS: Final = 1000
LEFT_POINTS: Final = 750
"""After thinning, at most."""
MOST_EVENTS: Final = 300
"""Points of events that are kept whatever is thinned: the newest."""
AGES: Final = 32.0
"""Points are no further apart than their age over this: what is recent stays fine."""
UNKNOWN: Final = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class OnlinePoint:
    """What was known at a time. Numbers are NaN while there is no calibration."""

    time_s: float  #: by the clock of the readings
    doing: Doing
    heading_error_deg: float = math.nan  #: with the calibration in force, worst heading, 1 σ
    bound_deg: float = math.nan  #: that no heading exceeds with 95 %
    offset: tuple[float, float, float] = (
        UNKNOWN  #: newest estimate, in force or not, as `Calibration.offset`: µT or counts
    )
    offset_sigma: tuple[float, float, float] = UNKNOWN  #: 1 σ of each of its components
    is_read: bool = True  #: whether readings came; False of a time between readings that are far apart
    events: tuple[Code, ...] = ()  #: what happened then


class Timeline:
    """Points in the order of time.

    Attributes
    ----------
    points : list of OnlinePoint
    due_s : float
        Time from which on the next point is due.
    """

    def __init__(self) -> None:
        self.points: list[OnlinePoint] = []
        self.due_s = -math.inf
        self._interval_s = EVERY_S

    def put(self, point: OnlinePoint) -> None:
        """Add a point; one of the same time takes the place of the last, whose events stay."""
        if self.points and self.points[-1].time_s == point.time_s:
            point = replace(point, events=self.points.pop().events + point.events)
        self.points.append(point)
        self.due_s = _due_s(point.time_s)
        if len(self.points) > MOST_POINTS:
            self._thin()

    def _thin(self) -> None:
        """Leave out points that are closer together than an interval, which is doubled until enough are left out."""
        eventful = [index for index, point in enumerate(self.points) if point.events]
        always = {0, len(self.points) - 1, *eventful[-MOST_EVENTS:]}
        first, now = self.points[0].time_s, self.points[-1].time_s
        while True:
            kept = list[OnlinePoint]()
            for index, point in enumerate(self.points):
                apart = min(self._interval_s, max((now - point.time_s) / AGES, EVERY_S))
                if index in always or point.time_s - kept[-1].time_s >= apart:
                    kept.append(point)
            if len(kept) <= LEFT_POINTS or self._interval_s > now - first:
                break
            self._interval_s *= 2.0
        self.points = kept[-LEFT_POINTS:]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: for each point a row of numbers and words; NaN is null, as JSON has none."""
        rows = [
            [
                point.time_s, point.doing, point.is_read, point.events,
                *(
                    number if math.isfinite(number) else None
                    for number in (point.heading_error_deg, point.bound_deg, *point.offset, *point.offset_sigma)
                ),
            ]
            for point in self.points
        ]  # fmt: skip
        return {"interval_s": self._interval_s, "points": rows}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Self:
        """Read what `as_dict` gave; ValueError, TypeError or KeyError for anything else."""
        timeline = cls()
        timeline._interval_s = float(content["interval_s"])
        timeline.points = [_point(*row) for row in content["points"]]
        timeline.due_s = _due_s(timeline.points[-1].time_s) if timeline.points else timeline.due_s
        if len(timeline.points) > MOST_POINTS or not timeline._interval_s >= EVERY_S:
            raise ValueError("its timeline is none")
        return timeline


def _due_s(time_s: float) -> float:
    """When the point after one is due."""
    return (math.floor(time_s / EVERY_S) + 1.0) * EVERY_S


def _point(time_s: float, doing: Doing, is_read: bool, events: list[Code], *rest: float | None) -> OnlinePoint:
    """A row of a file as a point, without what other releases call events; ValueError for one that is none."""
    if doing not in get_args(Doing):
        raise ValueError("a point of its timeline is none")
    error, bound, x, y, z, of_x, of_y, of_z = (math.nan if number is None else float(number) for number in rest)
    codes = tuple(code for code in events if code in get_args(Code))
    return OnlinePoint(float(time_s), doing, error, bound, (x, y, z), (of_x, of_y, of_z), bool(is_read), codes)
