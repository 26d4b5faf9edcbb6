"""How an estimate settles while readings come in: as a drawing (SVG) and as a table (CSV).

>>> from flinders.estimators import Readings
>>> from flinders.estimators.reference.sequential import Sequential
>>> from flinders.simulate import tumble
>>> steps = Sequential().converge(Readings.of(tumble(seed=1, n=400).samples), steps=8)
>>> trace = Trace(steps, "sequential", unit="uT")
>>> drawing(trace).startswith("<svg"), len(table(trace).splitlines())
(True, 9)
>>> table(trace).splitlines()[0][:60]
'readings,heading_off_deg,offset_x_uT,offset_y_uT,offset_z_uT'
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Self, cast

import numpy as np

from flinders.arrays import runs
from flinders.core.units import label
from flinders.errors import FitError, counted
from flinders.estimators import Readings, within_range
from flinders.fitting.calibrate import estimator_of
from flinders.heading.error_propagation import level_gradients
from flinders.report import charts
from flinders.report.charts import Axis, Plot, nearest_round, round_up, segment, text
from flinders.report.formatting import minus, with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators import Convergence
    from flinders.estimators.reference.trace import Watched

    Scale = Callable[[ArrayLike], Floats]

PARAMETERS: Final = (
    "offset_x", "offset_y", "offset_z",
    "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz",
)  # fmt: skip
"""What each parameter is called, in their order."""

WIDE, LEFT, RIGHT, BELOW = 560, 58, 12, 46
"""Of the drawing and its margins, in its own units: letters are 14 of them, and so can be read on a telephone."""

PLOT, LINE, GAP = 128, 18, 20
"""Heights of a plot, of a line of letters, and between two plots."""

BEGINNING: Final = 2
"""The scale of a plot is that of all but one step in so many, the first ones: they are far off, and run out of it."""

NEAR_END: Final = 0.75
"""Share of all readings from which on a number would run into the last one."""

LEAST_DEG, MOST_DEG = 0.01, 100.0
"""Ends of the axis of headings, in degrees; a decade is left out where nothing is in it."""


@dataclass(frozen=True, eq=False)
class Trace:
    """A convergence with what is needed to show it.

    The last value is that of the last step with an ellipsoid: a method that loses its way has none at the end.

    Attributes
    ----------
    steps : Convergence
        With an ellipsoid at one step at the least.
    method : str
    unit : str
        ``uT`` or ``counts``.
    dip_deg : float
    target_deg : float
    """

    steps: Convergence
    method: str
    unit: str
    dip_deg: float = 60.0
    target_deg: float = 1.0

    @classmethod
    def of(
        cls, recording: Recording, method: str, options: dict[str, Any], site: dict[str, Any], target_deg: float
    ) -> Self | None:
        """Watch a method on a recording, with its own options and those of the site; None where it gives nothing."""
        estimator = estimator_of(method, options, site)
        try:
            steps = cast("Watched", estimator).converge(within_range(Readings.of(recording)))
        except FitError:
            return None
        if steps.last is None:
            return None
        return cls(steps, method, unit=recording.unit.inside, dip_deg=site["dip_deg"], target_deg=target_deg)

    @cached_property
    def off(self) -> Floats:
        """(K, 9) how far each parameter is off its last value."""
        off: Floats = self.steps.parameters - self.steps.parameters[self.last]
        return off

    @cached_property
    def last(self) -> int:
        """The last step that has an ellipsoid; of none, the last of all."""
        return len(self.steps) - 1 if self.steps.last is None else self.steps.last

    @cached_property
    def heading_off_deg(self) -> Floats:
        """(K,) how far the worst level heading is off the last one, to first order; at most 180."""
        known = self.steps.is_known
        gradients = level_gradients(self.steps.ellipsoid(self.last), dip_deg=self.dip_deg)
        errors: Floats = np.full(len(self.steps), np.nan)
        errors[known] = np.minimum(np.rad2deg(np.abs(self.off[known] @ gradients.T).max(axis=1, initial=0.0)), 180.0)
        return errors


def table(trace: Trace) -> str:
    """A line for each step: readings seen, how far the heading is off the last, parameters and their 1 σ.

    What is not known yet is left empty.
    """
    steps = trace.steps
    columns = [f"{name}_{trace.unit}" for name in PARAMETERS]
    header = ["readings", "heading_off_deg", *columns, *(f"sigma_{name}" for name in columns)]
    numbers = np.concatenate([trace.heading_off_deg[:, np.newaxis], steps.parameters, steps.sigmas], axis=1)
    lines = [
        ",".join([str(count), *("" if math.isnan(number) else f"{number:.9g}" for number in row)])
        for count, row in zip(steps.counts.tolist(), numbers.tolist(), strict=True)
    ]
    return "\n".join([",".join(header), *lines]) + "\n"


def drawing(trace: Trace) -> str:
    """Three plots over the readings seen, as SVG for light and dark pages: offset, shape, heading."""
    unit, top = label(trace.unit), 20.0 + GAP
    parts = [text(LEFT, 20, _title(trace), "start", "title")]
    for name, which in (("offset", range(3)), ("shape", range(3, 9))):
        title = f"{name}, {unit}: off its last value, ± 1 σ"
        plot = _plot(top + LINE * (1 + len(which) // 3), trace, *_ends(trace, which))
        parts += [*_legend(trace, title, which, top), _parameters(trace, which, plot)]
        top = plot.bottom + GAP
    plot = _plot(top + LINE, trace, *_decades(trace), scale=np.log10)
    parts += [text(LEFT, top + LINE - 5, "worst level heading: off that of the last", "start", "name")]
    parts += [_headings(trace, plot), _counts(trace, plot)]
    high = plot.bottom + BELOW
    parts.append(text(plot.middle, high - 8, "readings seen (square-root scale)"))
    return charts.drawing(WIDE, high, "How the estimate settles", *parts)


def _title(trace: Trace) -> str:
    counts = trace.steps.counts.tolist()
    title = f"How {trace.method} settles over {counted(counts[-1], 'reading')}"
    last = counts[trace.last]
    return title if last == counts[-1] else f"{title}: lost after {last:,}"


def _plot(top: float, trace: Trace, low: float, high: float, scale: Scale = np.asarray) -> Plot:
    """A plot over the root of the readings seen, since most happens at the beginning."""
    across = Axis(0.0, float(trace.steps.counts[-1]), np.sqrt)
    return Plot(LEFT, top, WIDE - LEFT - RIGHT, PLOT, across, Axis(low, high, scale))


def _ends(trace: Trace, which: range) -> tuple[float, float]:
    """Ends of an axis that nearly all of some parameters stay inside, but for the first steps; ±1 of zeros."""
    sizes = (np.abs(trace.off[:, which]) + trace.steps.sigmas[:, which])[: trace.last + 1]
    later = sizes[len(sizes) // BEGINNING :]
    largest = float(later[np.isfinite(later)].max(initial=0.0))
    end = round_up(largest, (1.0, 2.0, 4.0, 10.0)) if largest > 0.0 else 1.0
    return -end, end


def _parameters(trace: Trace, which: range, plot: Plot) -> str:
    """Some parameters off their last values: bands of 1 σ first, then the lines, so that none is hidden."""
    counts, off, sigmas = trace.steps.counts, trace.off, trace.steps.sigmas
    ends, known = (plot.up.low, plot.up.high), runs(trace.steps.is_known)
    bands, lines = [], []
    for place, parameter in enumerate(which):
        for run in known:
            value, sigma = off[run, parameter], sigmas[run, parameter]
            low, high = (np.clip(edge, 2 * ends[0], 2 * ends[1]) for edge in (value - sigma, value + sigma))
            bands.append(plot.area(f"band c{place}", counts[run], low, high))
            lines.append(plot.line(_kind(place), counts[run], value.clip(2 * ends[0], 2 * ends[1])))
    rows = [(value, minus(f"{value:+g}") if value else "0") for value in np.linspace(*ends, 5).tolist()]
    return plot.rows(rows) + plot.clipped(f"plot{plot.top:.0f}", *bands, *lines)


def _kind(place: int) -> str:
    """Class of the line of one of six parameters: the first three are whole, the others dashed."""
    return f"line c{place}{' dashed' * (place > 2)}"


def _legend(trace: Trace, title: str, which: range, top: float) -> list[str]:
    """A title, and below it the name, last value and uncertainty of each line."""
    parts = [text(LEFT, top + LINE - 5, title, "start", "name")]
    last, sigma = trace.steps.parameters[trace.last], trace.steps.sigmas[trace.last]
    for place, parameter in enumerate(which):
        x = LEFT + (WIDE - LEFT - RIGHT) / 3 * (place % 3)
        y = top + LINE * (2 + place // 3) - 5
        name = PARAMETERS[parameter].partition("_")[2]
        value = with_uncertainty(float(last[parameter]), float(sigma[parameter]))
        parts.append(segment(_kind(place), x, y - 4, x + 18, y - 4))
        parts.append(text(x + 24, y, minus(f"{name} {value}"), "start", "small"))
    return parts


def _decades(trace: Trace) -> tuple[float, float]:
    """Ends of the axis of headings, whole decades around what is known."""
    known = trace.heading_off_deg[trace.heading_off_deg > 0.0]
    least, most = (float(known.min()), float(known.max())) if len(known) else (0.1, 1.0)
    low = 10.0 ** math.floor(math.log10(min(max(least, LEAST_DEG), MOST_DEG / 10.0)))
    return low, min(max(10.0 ** math.ceil(math.log10(most)), 10.0 * low), MOST_DEG)


def _headings(trace: Trace, plot: Plot) -> str:
    """How far the worst level heading is off the last, by decades, with the target."""
    low, high = plot.up.low, plot.up.high
    numbers = [low * 10.0**decade for decade in range(round(math.log10(high / low)) + 1)]
    parts = [plot.rows([(number, f"{number:g}°") for number in numbers])]
    if low < trace.target_deg < high:
        parts.append(plot.level(trace.target_deg, "aim"))
        y = plot.y(trace.target_deg) - 5
        parts.append(text(plot.right - 4, y, f"target {trace.target_deg:g}°", "end", "halo"))
    off = trace.heading_off_deg.clip(low / 10.0, 10.0 * high)
    lines = [plot.line("line", trace.steps.counts[run], off[run]) for run in runs(trace.steps.is_known)]
    return "".join(parts) + plot.clipped(f"plot{plot.top:.0f}", *lines)


def _counts(trace: Trace, plot: Plot) -> str:
    """Numbers of readings below the last plot: the first, the last, and round ones where there is room."""
    whole = int(trace.steps.counts[-1])
    y = plot.bottom + 16
    ends = text(plot.x(0.0), y, "0", "start") + text(plot.x(whole), y, f"{whole:,}", "end")
    return ends + "".join(text(plot.x(count), y, f"{count:,}") for count in root_ticks(whole))


def root_ticks(whole: int) -> list[int]:
    """Round numbers about a quarter, half and three quarters along an axis of roots from 0 to `whole`.

    >>> root_ticks(1000), root_ticks(2400), root_ticks(5)
    ([50, 200, 500], [200, 500, 1000], [1, 2])
    """
    counts = (nearest_round(whole * (place / 4) ** 2) for place in (1, 2, 3))
    return [int(count) for count in counts if 1.0 <= count <= NEAR_END * whole]
