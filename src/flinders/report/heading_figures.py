"""Figures of the heading over a log: with the onboard and the new calibration, and their difference.

>>> import numpy as np
>>> from flinders.workflows.log_headings import HeadingHistory
>>> seconds = np.linspace(0.0, 60.0, 5000)
>>> turning = (6.0 * seconds) % 360.0
>>> history = HeadingHistory(seconds, (turning + 3.0) % 360.0, turning, None, "nothing", None, is_vehicle=True)
>>> figure = headings_over_time(history, 1.0)
>>> figure.count("curve raw thin"), stride_of(history)
(3, 4)
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.report.charts import Axis, Panel, round_ticks, round_up, stack_panels
from flinders.report.figures import WIDTH
from flinders.report.formatting import minus

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.report.charts import Canvas
    from flinders.workflows.log_headings import HeadingHistory

MAX_POINTS: Final = 1500
"""Largest number of points in a line; of a longer log, every k-th reading is drawn."""
GAP_STEPS: Final = 10.0
"""Gap in time that interrupts a line, in median steps of the clock."""
STEP_DEG: Final = 15.0
SECTORS: Final = 24
"""Step in degrees for the ends of the heading axis, and number of such steps in a turn."""
QUARTERS: Final = {0.0: "N", 90.0: "E", 180.0: "S", 270.0: "W"}
TILT_WORDS: Final = {
    "attitude": "tilt is removed with roll and pitch of the logged attitude",
    "acceleration": "tilt is removed with the accelerometer, which is wrong while a vehicle accelerates or turns",
    "nothing": "neither attitude nor acceleration was logged, and the vehicle is assumed to be level",
}
YAW: Final = "The yaw is the autopilot's own estimate, and may depend on this compass."


def headings_over_time(history: HeadingHistory, target_deg: float) -> str:
    """Headings over time with both calibrations and by the attitude; below, the difference of the calibrations."""
    title = "Heading over time by what was on board and by the new calibration, and their difference"
    return stack_panels(title, [_headings(history), _difference(history, target_deg)], wide=WIDTH, high=150.0)


def history_words(history: HeadingHistory) -> str:
    """Caption of the figure: which heading, from which north, and how tilt was removed."""
    whose = "Heading of the vehicle" if history.is_vehicle else "Heading of the compass's x axis"
    north = history.declination_deg
    from_north = "from magnetic north" if north is None else minus(f"from true north (declination {north:.1f}°)")
    how = TILT_WORDS[history.levelled_by]
    stride = stride_of(history)
    thinned = f" One of {stride} readings is drawn." if stride > 1 else ""
    apart = " It refers to true north, and differs by the declination, which the log does not contain." * (
        north is None
    )
    yaw = "" if history.yaw_deg is None else f" {YAW}{apart}"
    return f"{whose} over the log, {from_north}; {how}.{yaw}{thinned}"


def stride_of(history: HeadingHistory) -> int:
    """Step between drawn readings, in readings."""
    return max(1, -(-len(history.seconds) // MAX_POINTS))


def _across(history: HeadingHistory) -> Axis:
    return Axis(0.0, float(history.seconds[-1]))


def _headings(history: HeadingHistory) -> Panel:
    """Headings with both calibrations, and the yaw of the attitude; the axis starts where headings are rarest."""
    lines = [("curve raw thin", history.old_deg), ("curve corrected thin", history.new_deg)]
    if history.yaw_deg is not None:
        lines.append(("curve yaw thin", history.yaw_deg))
    first = _rarest_direction(np.concatenate([degrees for _, degrees in lines]))
    shown = [(kind, first + np.mod(degrees - first, 360.0)) for kind, degrees in lines]
    everything = np.concatenate([degrees for _, degrees in shown])
    low = STEP_DEG * math.floor(float(np.nanmin(everything, initial=first + 360.0)) / STEP_DEG)
    high = STEP_DEG * math.ceil(float(np.nanmax(everything, initial=first)) / STEP_DEG)
    up = Axis(low, high) if high > low else Axis(first, first + 360.0)

    def draw(plot: Canvas) -> list[str]:
        return [mark for kind, degrees in shown for mark in _line(plot, kind, history, degrees)]

    title = "heading" if history.declination_deg is None else "true heading"
    return Panel(_across(history), up, draw, "seconds", title=title, y_ticks=_compass(up))


def _rarest_direction(degrees: Floats) -> float:
    """Direction, in steps of `STEP_DEG`, that is farthest from most of the angles."""
    counts = np.bincount(np.mod(degrees[np.isfinite(degrees)] // STEP_DEG, SECTORS).astype(int), minlength=SECTORS)
    around = sum(np.roll(counts, shift) for shift in range(SECTORS // 4)) + np.roll(counts, -1)
    return float(STEP_DEG * np.argmin(around))


def _compass(up: Axis) -> list[tuple[float, str]]:
    """Numbers for an axis of headings, with the names of the four quarters."""
    step = 90.0 if up.high - up.low > 180.0 else 45.0 if up.high - up.low > 60.0 else STEP_DEG
    values = np.arange(math.ceil(up.low / step) * step, up.high + 1.0, step).tolist()
    return [(value, f"{QUARTERS.get(value % 360.0, '')} {value % 360.0:03.0f}°".strip()) for value in values]


def _difference(history: HeadingHistory, target_deg: float) -> Panel:
    """Heading with the onboard calibration minus heading with the new one, between lines at ± the target."""
    difference = history.difference_deg
    largest = float(np.nanmax(np.abs(difference), initial=0.0))
    end = min(round_up(1.1 * max(largest, target_deg)), 180.0)

    def draw(plot: Canvas) -> list[str]:
        limits = [plot.level(sign * target_deg, "aim") for sign in (1.0, -1.0)] if target_deg < end else []
        return [*_line(plot, "curve raw thin", history, difference), *limits]

    up, words = Axis(-end, end), f"on board less new; dotted: target {target_deg:g}°"
    return Panel(_across(history), up, draw, "seconds", title=words, y_ticks=round_ticks(up, 5, "°"))


def _line(plot: Canvas, kind: str, history: HeadingHistory, degrees: Floats) -> list[str]:
    """Line of every k-th angle; it is interrupted at wraps, at missing values, and at gaps in the log."""
    stride = stride_of(history)
    seconds, angles = history.seconds[::stride], degrees[::stride]
    known = np.isfinite(angles)
    seconds, angles = seconds[known], angles[known]
    if len(seconds) < 2:
        return []
    steps = np.diff(seconds)
    is_cut = (np.abs(np.diff(angles)) > 180.0) | (steps > GAP_STEPS * float(np.median(steps)))
    ends = [0, *(np.flatnonzero(is_cut) + 1).tolist(), len(seconds)]
    return [plot.line(kind, seconds[i:j], angles[i:j]) for i, j in itertools.pairwise(ends) if j - i > 1]
