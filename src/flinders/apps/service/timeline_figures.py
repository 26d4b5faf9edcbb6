"""Drawing of an online calibration over time: heading error on a logarithmic axis with events, and offsets.

>>> from flinders.workflows.timeline import OnlinePoint
>>> known = [OnlinePoint(60.0 * i, "undisturbed", 0.5, 1.2, (1.0, 2.0, 3.0), (0.1, 0.1, 0.2)) for i in range(9)]
>>> chart = timeline(known, target_deg=1.0, unit="µT", wide=True)
>>> chart.startswith("<svg"), chart.count('class="curve')
(True, 4)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from html import escape
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.apps.service.reports import moment, words_of
from flinders.readers._times import MIN_EPOCH_S
from flinders.report.charts import (
    Axis,
    Plot,
    chart,
    circle,
    rectangle,
    round_ticks,
    round_up,
    segment,
    shape,
    text,
)
from flinders.report.formatting import degrees

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.workflows.timeline import Code, OnlinePoint

MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86400.0
STEPS_S: Final = (
    *(1.0, 2.0, 5.0, 10.0, 30.0),
    *(minutes * MINUTE_S for minutes in (1, 2, 5, 10, 30)),
    *(hours * HOUR_S for hours in (1, 2, 3, 6, 12)),
    *(days * DAY_S for days in (1, 2, 5, 10, 30, 60, 180, 360)),
)
"""Possible steps of a time axis."""
MIN_DISTANCE_PX: Final = 1.5
"""Smallest distance of two points of a line in pixels; nearer points are left out."""
EVENT_ROW_PX: Final = 20.0
"""Height in pixels of the row of events above the heading error."""
MARKS: Final[dict[Code, str]] = {
    "adopted": "m0-4v8",
    "taken-back": "m0-4v8",
    "passed": "m-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0",
    "contradicted": "m0-5l5 9h-10z",
    "moved": "m0-6l6 6-6 6-6-6z",
    "learnt": "m-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0-9 0",
}
"""Shapes of events, in ascending importance; of several at one time, the most important is drawn."""
MAX_SIGMA_RATIO: Final = 4.0
"""Largest σ of a point that may widen the axis, in units of the median σ."""


@dataclass(frozen=True, slots=True)
class _Size:
    """Sizes of a drawing, in pixels."""

    width: float
    left: float
    claim: float  # height of the heading error's panel
    offset: float  # height of each offset's panel
    marks: int  # largest number of marks on the time axis


WIDE: Final = _Size(960.0, 50.0, 220.0, 84.0, 9)
NARROW: Final = _Size(350.0, 40.0, 190.0, 76.0, 4)


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points of a timeline, as columns."""

    time: Floats  # (n,) s
    error: Floats  # (n,) degrees
    bound: Floats  # (n,) degrees
    offset: Floats  # (n, 3)
    sigma: Floats  # (n, 3)
    is_read: NDArray[np.bool_]
    is_disturbed: NDArray[np.bool_]

    @classmethod
    def of(cls, points: Sequence[OnlinePoint]) -> Self:
        """Convert points to columns; the values before an event hold up to the event, where they change in a step."""
        points = list(_with_steps(points))
        return cls(
            np.array([point.time_s for point in points]),
            np.array([point.heading_error_deg for point in points]),
            np.array([point.bound_deg for point in points]),
            np.array([point.offset for point in points]),
            np.array([point.offset_sigma for point in points]),
            np.array([point.is_read for point in points]),
            np.array([point.doing == "disturbed" for point in points]),
        )


def _with_steps(points: Sequence[OnlinePoint]) -> Iterator[OnlinePoint]:
    before: OnlinePoint | None = None
    for point in points:
        if before is not None and point.events:
            yield replace(before, time_s=point.time_s, events=())
        yield point
        before = point


def timeline(
    points: Sequence[OnlinePoint],
    *,
    target_deg: float,
    unit: str,
    wide: bool,
    name: str = "timeline",
    begin: float = -math.inf,
) -> str:
    """Draw the points from the time `begin` on, but at least one; `name` has to be unique on the page."""
    size, drawn = WIDE if wide else NARROW, _Points.of(points)
    low, high = max(float(drawn.time[0]), begin), float(drawn.time[-1])
    across = Axis(low, max(high, low + 1.0))
    numbers = time_ticks(across.low, across.high, size.marks)
    width = size.width - size.left - 18.0
    claim = Plot(
        size.left, EVENT_ROW_PX + 4.0, width, size.claim, across, error_axis(drawn.error, drawn.bound, target_deg)
    )
    parts = [_claim(claim, drawn, target_deg, numbers, name)]
    plots = [claim]
    for place, up in enumerate(_offset_axes(drawn)):
        plot = Plot(size.left, plots[-1].bottom + 30.0, width, size.offset, across, up)
        shown = numbers if place == 2 else [(value, "") for value, _ in numbers]
        parts.append(_offset(plot, drawn, place, unit, shown, name))
        plots.append(plot)
    parts += [_events(plots, points)]
    return chart(size.width, plots[-1].bottom + 24.0, "Heading error and offsets over time", *parts)


def error_axis(error: Floats, bound: Floats, target_deg: float) -> Axis:
    """Logarithmic axis with all errors, their bounds and the target.

    >>> axis = error_axis(np.array([0.3, np.nan]), np.array([0.8, np.nan]), 1.0)
    >>> axis.low, axis.high
    (0.2, 2.0)
    """
    low = min(float(np.nanmin(error, initial=target_deg)), target_deg)
    high = max(float(np.nanmax(bound, initial=target_deg)), target_deg)
    bottom = 1.0 / round_up(1.2 / low, (1.0, 2.0, 5.0, 10.0))
    return Axis(bottom, min(max(round_up(1.1 * high, (1.0, 2.0, 5.0, 10.0)), 4.0 * bottom), 180.0), np.log10)


def error_ticks(axis: Axis) -> list[tuple[float, str]]:
    """Ticks of a logarithmic axis, at round numbers.

    >>> [words for _, words in error_ticks(Axis(0.2, 20.0, np.log10))]
    ['0.2°', '0.5°', '1°', '2°', '5°', '10°', '20°']
    """
    decades = range(math.floor(math.log10(axis.low)), math.ceil(math.log10(axis.high)) + 1)
    steps = (1.0, 2.0, 5.0) if axis.high / axis.low < 9999.0 else (1.0,)
    values = (step * 10.0**decade for decade in decades for step in steps)
    return [(value, f"{value:.6g}°") for value in values if axis.low * 0.999 <= value <= axis.high * 1.001]


def time_ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Ticks of a time axis, at round times; if the date is known, days begin at midnight (UTC).

    >>> time_ticks(1780272000.0, 1780272000.0 + 3 * 86400.0, 4)
    [(1780272000.0, '1 Jun'), (1780358400.0, '2 Jun'), (1780444800.0, '3 Jun'), (1780531200.0, '4 Jun')]
    >>> [words for _, words in time_ticks(1780272000.0, 1780272000.0 + 36 * 3600.0, 4)]
    ['1 Jun', '12:00', '2 Jun', '12:00']
    >>> time_ticks(0.0, 600.0, 3)
    [(0.0, '0'), (300.0, '5 min'), (600.0, '10 min')]
    """
    step = next((step for step in STEPS_S if (high - low) / step < most), STEPS_S[-1])
    count = math.floor((high - low) / step / most) + 1  # years
    first = math.ceil(low / step - 1e-9)
    values = [place * step for place in range(first, math.floor(high / step + 1e-9) + 1, count)]
    return [(value, _time_words(value, step)) for value in values]


def _time_words(value: float, step: float) -> str:
    if value < MIN_EPOCH_S:
        per, unit = next(
            (each for each in ((DAY_S, "days"), (HOUR_S, "h"), (MINUTE_S, "min")) if step >= each[0]), (1.0, "s")
        )
        return f"{value / per:,.6g} {unit}" if value else "0"
    date = datetime.fromtimestamp(value, UTC)
    if step >= 60.0 * DAY_S:
        return f"{date:%b %Y}"
    if value % DAY_S == 0.0:
        return f"{date.day} {date:%b}"
    return f"{date:%H:%M}" if step >= MINUTE_S else f"{date:%H:%M:%S}"


def _claim(plot: Plot, drawn: _Points, target_deg: float, numbers: list[tuple[float, str]], name: str) -> str:
    """Draw the heading error, its bound as the edge of a band, and the target."""
    lines = [_shades(plot, drawn)]
    for run in _runs(np.isfinite(drawn.error) & np.isfinite(drawn.bound)):
        time, error, bound = drawn.time[run], drawn.error[run], drawn.bound[run]
        lines.append(_band(plot, time, error, bound))
        lines.append(_line(plot, "curve corrected", time, error))
    y = plot.y(target_deg)
    return "".join(
        [
            plot.columns([(value, "") for value, _ in numbers]),
            plot.rows(error_ticks(plot.up)),
            plot.clipped(f"{name}-claim", *lines),
            plot.level(target_deg, "aim"),
            text(plot.right - 5.0, y - 5.0, f"target {target_deg:g}°", "end", "halo name"),
            plot.outline("frame"),
        ]
    )


def _offset(plot: Plot, drawn: _Points, axis: int, unit: str, numbers: list[tuple[float, str]], name: str) -> str:
    """Draw the offset along an axis, with a band of one standard deviation."""
    lines = [_shades(plot, drawn)]
    values, sigma = drawn.offset[:, axis], drawn.sigma[:, axis]
    for run in _runs(np.isfinite(values) & np.isfinite(sigma)):
        lines.append(_band(plot, drawn.time[run], values[run] - sigma[run], values[run] + sigma[run]))
        lines.append(_line(plot, "curve corrected thin", drawn.time[run], values[run]))
    return "".join(
        [
            plot.columns(numbers, gap=17.0),
            plot.rows(round_ticks(plot.up, 4)),
            plot.clipped(f"{name}-{'xyz'[axis]}", *lines),
            plot.outline("frame"),
            text(plot.left, plot.top - 7.0, f"offset {'xyz'[axis]}, {unit}", "start", "name"),
        ]
    )


def _offset_axes(drawn: _Points) -> list[Axis]:
    """Axes of the offset's three components, with equal spans; uncertain points, as at the start, may lie outside."""
    is_known = np.isfinite(drawn.offset).all(axis=1) & np.isfinite(drawn.sigma).all(axis=1)
    offset, sigma = drawn.offset[is_known], drawn.sigma[is_known]
    if not len(offset):
        return [Axis(-1.0, 1.0)] * 3
    usual = np.median(sigma, axis=0)
    is_near = (sigma <= MAX_SIGMA_RATIO * usual).all(axis=1)
    near = offset[is_near] if is_near.any() else offset
    low, high = near.min(axis=0), near.max(axis=0)
    half = float(((high - low) / 2.0 + 2.0 * usual).max())
    half = max(half, 1e-6)
    return [Axis(middle - half, middle + half) for middle in ((low + high) / 2.0).tolist()]


def _events(plots: Sequence[Plot], points: Sequence[OnlinePoint]) -> str:
    """Draw a mark above the heading error for each event, and a line through all panels at moves of the offset."""
    parts: list[str] = []
    claim = plots[0]
    marked = [(point, code) for code in MARKS for point in points if code == _main_event(point)]
    for point, code in marked:
        if point.time_s < claim.across.low:
            continue
        x, y = claim.x(point.time_s), claim.top - EVENT_ROW_PX / 2.0
        if code == "moved":
            parts += [segment("moved", x, plot.top, x, plot.bottom) for plot in plots]
        words = f"{moment(point.time_s)}: {words_of(code)}, heading error {degrees(point.heading_error_deg)}"
        parts.append(
            f'<path class="mark {code}" d="M{x:.1f} {y:.1f}{MARKS[code]}"><title>{escape(words)}</title></path>'
        )
    return "".join(parts)


def _main_event(point: OnlinePoint) -> Code | None:
    """Most important event of a point in time; None without an event."""
    return next((code for code in reversed(MARKS) if code in point.events), None)


def _shades(plot: Plot, drawn: _Points) -> str:
    """Shade times without readings, and times at which readings contradicted the calibration."""
    last = len(drawn.time) - 1
    spans = [("unread", max(run.start - 1, 0), min(run.stop, last)) for run in _runs(~drawn.is_read)]
    spans += [("disturbed", run.start, min(run.stop, last)) for run in _runs(drawn.is_disturbed & drawn.is_read)]
    parts = []
    for kind, first, end in spans:
        left, right = plot.x(drawn.time[first]), plot.x(drawn.time[end])
        parts.append(rectangle(kind, round(left, 1), plot.top, round(max(right - left, 1.0), 1), plot.height))
    return "".join(parts)


def _runs(mask: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield slices of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2).tolist():
        yield slice(first, end)


def _band(plot: Plot, time: Floats, low: Floats, high: Floats) -> str:
    there, back = _places(plot, time, high), _places(plot, time, low)[::-1]
    return shape("band", np.concatenate([there, back]), is_closed=True)


def _line(plot: Plot, kind: str, time: Floats, values: Floats) -> str:
    places = _places(plot, time, values)
    return shape(kind, places) if len(places) > 1 else circle("dot", float(places[0, 0]), float(places[0, 1]), 2.0)


def _places(plot: Plot, time: Floats, values: Floats) -> Floats:
    """(m, 2) points in pixels, without points nearer than `MIN_DISTANCE_PX` to the one before."""
    places = plot.places(time, values)
    kept = [0]
    for row in range(1, len(places)):
        if row == len(places) - 1 or math.dist(places[row], places[kept[-1]]) >= MIN_DISTANCE_PX:
            kept.append(row)
    few: Floats = places[kept]
    return few
