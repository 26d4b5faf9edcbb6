"""Timeline of an online calibration, with a bounded number of points: dense at the end, thinned before.

The points depend only on the times of the readings, not on their division into blocks.

>>> timeline = Timeline()
>>> for minute in range(100_000):
...     timeline.put(OnlinePoint(60.0 * minute, "learning"))
>>> times = [point.time_s for point in timeline.points]
>>> len(times) <= MAX_POINTS, times[0], times[-1] - times[-2]
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

POINT_INTERVAL_S: Final = 60.0
"""Time in s between points without an event."""
MAX_POINTS: Final = 1000
MAX_POINTS_AFTER_THINNING: Final = 750
"""Largest number of points after thinning."""
MAX_EVENT_POINTS: Final = 300
"""Number of the newest points with events; these are never thinned."""
MIN_AGE_RATIO: Final = 32.0
"""Smallest ratio of a point's age to its distance from the next point, so that recent points stay dense."""
UNKNOWN_VECTOR: Final = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class OnlinePoint:
    """State of an online calibration at a time; numbers are NaN without a calibration."""

    time_s: float  #: time in s, by the clock of the readings
    doing: Doing
    heading_error_deg: float = math.nan  #: worst heading error with the calibration in force, 1 σ
    bound_deg: float = math.nan  #: 95 % bound of the error at all headings
    offset: tuple[float, float, float] = (
        UNKNOWN_VECTOR  #: newest estimate, in force or not, as `Calibration.offset`: µT or counts
    )
    offset_sigma: tuple[float, float, float] = UNKNOWN_VECTOR  #: 1 σ of each component of `offset`
    is_read: bool = True  #: whether there were readings at this time; False within a gap
    events: tuple[Code, ...] = ()  #: codes of events at this time


class Timeline:
    """Points in the order of time.

    Attributes
    ----------
    points : list of OnlinePoint
    due_s : float
        Time in s at which the next point is due.
    """

    def __init__(self) -> None:
        self.points: list[OnlinePoint] = []
        self.due_s = -math.inf
        self._interval_s = POINT_INTERVAL_S

    def put(self, point: OnlinePoint) -> None:
        """Add a point; if the last point has the same time, the new one replaces it and keeps its events."""
        if self.points and self.points[-1].time_s == point.time_s:
            point = replace(point, events=self.points.pop().events + point.events)
        self.points.append(point)
        self.due_s = _due_s(point.time_s)
        if len(self.points) > MAX_POINTS:
            self._thin()

    def _thin(self) -> None:
        """Remove points that are closer than an interval; the interval is doubled until enough are removed."""
        eventful = [index for index, point in enumerate(self.points) if point.events]
        always = {0, len(self.points) - 1, *eventful[-MAX_EVENT_POINTS:]}
        first, now = self.points[0].time_s, self.points[-1].time_s
        while True:
            kept = list[OnlinePoint]()
            for index, point in enumerate(self.points):
                apart = min(self._interval_s, max((now - point.time_s) / MIN_AGE_RATIO, POINT_INTERVAL_S))
                if index in always or point.time_s - kept[-1].time_s >= apart:
                    kept.append(point)
            if len(kept) <= MAX_POINTS_AFTER_THINNING or self._interval_s > now - first:
                break
            self._interval_s *= 2.0
        self.points = kept[-MAX_POINTS_AFTER_THINNING:]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready rows of numbers and words, one for each point; null stands for NaN."""
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
        """Read the output of `as_dict`; `ValueError`, `TypeError` or `KeyError` for anything else."""
        timeline = cls()
        timeline._interval_s = float(content["interval_s"])
        timeline.points = [_point(*row) for row in content["points"]]
        timeline.due_s = _due_s(timeline.points[-1].time_s) if timeline.points else timeline.due_s
        if len(timeline.points) > MAX_POINTS or not timeline._interval_s >= POINT_INTERVAL_S:
            raise ValueError("its timeline is invalid")
        return timeline


def _due_s(time_s: float) -> float:
    """Time in s at which the point after `time_s` is due."""
    return (math.floor(time_s / POINT_INTERVAL_S) + 1.0) * POINT_INTERVAL_S


def _point(time_s: float, doing: Doing, is_read: bool, events: list[Code], *rest: float | None) -> OnlinePoint:
    """A point from a row of a file; events that this release does not know are left out, `ValueError` if invalid."""
    if doing not in get_args(Doing):
        raise ValueError("a point of its timeline is invalid")
    error, bound, x, y, z, of_x, of_y, of_z = (math.nan if number is None else float(number) for number in rest)
    codes = tuple(code for code in events if code in get_args(Code))
    return OnlinePoint(float(time_s), doing, error, bound, (x, y, z), (of_x, of_y, of_z), bool(is_read), codes)
