"""Convergence of an estimate with the number of readings, as an SVG drawing and as a CSV table.

>>> from flinders.estimators import Convergence, Estimate
>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> spheres = [Ellipsoid(np.full(3, 1.0 / step), 50.0 * np.eye(3)) for step in range(1, 9)]
>>> steps = Convergence.of(range(50, 450, 50), [Estimate(each, np.eye(9), 1.0, "one") for each in spheres])
>>> trace = Trace(steps, "one", unit="uT")
>>> convergence_drawing(trace).startswith("<svg"), len(convergence_table(trace).splitlines())
(True, 9)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self, cast

import numpy as np

from flinders.arrays import true_runs
from flinders.core.units import unit_label
from flinders.errors import FitError, count_text
from flinders.estimators import Readings, remove_saturated
from flinders.heading.error_propagation import level_gradients
from flinders.report.charts import (
    Axis,
    Panel,
    drawing,
    nearest_round,
    round_up,
    segment,
    text,
)
from flinders.report.formatting import minus, with_uncertainty

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators import Convergence, Estimator
    from flinders.estimators.trace import SequentialEstimator
    from flinders.report.charts import Canvas


# ------------------------------------------------------------------------------------------------------- a convergence

PARAMETERS: Final = (
    "offset_x", "offset_y", "offset_z",
    "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz",
)  # fmt: skip
"""Names of the nine parameters, in order."""

EARLY_DIVISOR: Final = 2
"""Divisor of the steps: the first 1 / `EARLY_DIVISOR` of them may lie outside the scale of a plot."""

MAX_TICK_SHARE: Final = 0.75
"""Share of all readings above which a number on the axis would overlap the last one."""

MIN_AXIS_DEG, MAX_AXIS_DEG = 0.01, 100.0
"""Ends of the axis of heading differences, in degrees; decades without values are left out."""


@dataclass(frozen=True, eq=False)
class Trace:
    """The convergence of an estimate, with the data that are needed to show it.

    Differences are taken from the last step with an ellipsoid: a method that diverges has none at the end.
    """

    steps: Convergence  # has an ellipsoid at one step or more
    method: str
    unit: str  # "uT" or "counts"
    dip_deg: float = 60.0
    target_deg: float = 1.0

    @classmethod
    def of(
        cls, recording: Recording, method: Estimator, *, dip_deg: float = 60.0, target_deg: float = 1.0
    ) -> Self | None:
        """Follow the estimate of a method over a recording; None if the method gives no result."""
        try:
            steps = cast("SequentialEstimator", method).converge(remove_saturated(Readings.of(recording)))
        except FitError:
            return None
        if steps.last is None:
            return None
        return cls(steps, method.name, unit=recording.unit.inside, dip_deg=dip_deg, target_deg=target_deg)

    @cached_property
    def differences(self) -> Floats:
        """(K, 9) difference of each parameter from its last value."""
        off: Floats = self.steps.parameters - self.steps.parameters[self.last]
        return off

    @cached_property
    def last(self) -> int:
        """The last step with an ellipsoid; without any, the last step."""
        return len(self.steps) - 1 if self.steps.last is None else self.steps.last

    @cached_property
    def heading_differences_deg(self) -> Floats:
        """(K,) difference in degrees of the worst level heading from the last step, to first order; at most 180."""
        known = self.steps.is_known
        gradients = level_gradients(self.steps.ellipsoid(self.last), dip_deg=self.dip_deg)
        errors: Floats = np.full(len(self.steps), np.nan)
        errors[known] = np.minimum(
            np.rad2deg(np.abs(self.differences[known] @ gradients.T).max(axis=1, initial=0.0)), 180.0
        )
        return errors


def convergence_table(trace: Trace) -> str:
    """Write a line for each step: number of readings, heading difference, parameters and their 1 σ.

    Unknown values are left empty.
    """
    steps = trace.steps
    columns = [f"{name}_{trace.unit}" for name in PARAMETERS]
    header = ["readings", "heading_off_deg", *columns, *(f"sigma_{name}" for name in columns)]
    numbers = np.concatenate([trace.heading_differences_deg[:, np.newaxis], steps.parameters, steps.sigmas], axis=1)
    lines = [
        ",".join([str(count), *("" if math.isnan(number) else f"{number:.9g}" for number in row)])
        for count, row in zip(steps.counts.tolist(), numbers.tolist(), strict=True)
    ]
    return "\n".join([",".join(header), *lines]) + "\n"


def convergence_drawing(trace: Trace) -> str:
    """Draw offset, shape and heading over the number of readings, one below the other."""
    panels = [_parameters(trace, "offset", range(3)), _parameters(trace, "shape", range(3, 9)), _headings(trace)]
    legends = [_legend(trace, range(3)), _legend(trace, range(3, 9)), []]
    parts, top = [text(58, 20, _title(trace), "start", "title")], 58.0
    for place, (panel, legend) in enumerate(zip(panels, legends, strict=True)):
        plot = panel.at(58, top + 18 * (len(legend) // 3), 478, 128)
        is_last = place == len(panels) - 1
        parts += [
            panel.grid(plot, is_last=is_last, gap=18.0),
            text(58, top - 5, panel.title, "start", "name"),
            *(_entry(top, *entry) for entry in enumerate(legend)),
            plot.clipped(f"plot{place}", *panel.draw(plot)),
        ]
        top = plot.bottom + 38
    if plot.up.low < trace.target_deg < plot.up.high:
        y = plot.y(trace.target_deg) - 5
        parts.append(text(plot.right - 4, y, f"target {trace.target_deg:g}°", "end", "halo"))
    parts.append(text(plot.middle, plot.bottom + 38, "readings seen (square-root scale)"))
    return drawing(560, plot.bottom + 46, "How the estimate settles", *parts)


def _title(trace: Trace) -> str:
    counts = trace.steps.counts.tolist()
    title = f"How {trace.method} settles over {count_text(counts[-1], 'reading')}"
    last = counts[trace.last]
    return title if last == counts[-1] else f"{title}: lost after {last:,}"


def _over_readings(trace: Trace) -> tuple[Axis, list[tuple[float, str]]]:
    """Axis of the number of readings and its numbers; the scale is a square root, as most changes are early."""
    whole = int(trace.steps.counts[-1])
    return Axis(0.0, float(whole), np.sqrt), [(count, f"{count:,}") for count in (0, *root_ticks(whole), whole)]


def _parameters(trace: Trace, name: str, which: range) -> Panel:
    """Differences of some parameters from their last values: bands of 1 σ, with the lines on top."""
    counts, sizes = (
        trace.steps.counts,
        (np.abs(trace.differences[:, which]) + trace.steps.sigmas[:, which])[: trace.last + 1],
    )
    later = sizes[len(sizes) // EARLY_DIVISOR :]
    largest = float(later[np.isfinite(later)].max(initial=0.0))
    end = round_up(largest, (1.0, 2.0, 4.0, 10.0)) if largest > 0.0 else 1.0

    def draw(canvas: Canvas) -> list[str]:
        bands, lines = [], []
        for place, parameter in enumerate(which):
            for run in true_runs(trace.steps.is_known):
                value, sigma = trace.differences[run, parameter], trace.steps.sigmas[run, parameter]
                low, high, shown = (edge.clip(-2.0 * end, 2.0 * end) for edge in (value - sigma, value + sigma, value))
                bands.append(canvas.area(f"band c{place}", counts[run], low, high))
                lines.append(canvas.line(_kind(place), counts[run], shown))
        return bands + lines

    rows = [(value, minus(f"{value:+g}") if value else "0") for value in np.linspace(-end, end, 5).tolist()]
    across, numbers = _over_readings(trace)
    title = f"{name}, {unit_label(trace.unit)}: off its last value, ± 1 σ"
    return Panel(across, Axis(-end, end), draw, title=title, x_ticks=numbers, y_ticks=rows)


def _kind(place: int) -> str:
    """Class of the line of one of six parameters: the first three are solid, the others are dashed."""
    return f"line c{place}{' dashed' * (place > 2)}"


def _legend(trace: Trace, which: range) -> list[str]:
    """Name, last value and uncertainty for each line."""
    last, sigma = trace.steps.parameters[trace.last], trace.steps.sigmas[trace.last]
    return [
        minus(f"{PARAMETERS[one].partition('_')[2]} {with_uncertainty(float(last[one]), float(sigma[one]))}")
        for one in which
    ]


def _entry(top: float, place: int, words: str) -> str:
    """One entry of a legend, of which three are side by side."""
    x, y = 58 + 478 / 3 * (place % 3), top + 13 + 18 * (place // 3)
    return segment(_kind(place), x, y - 4, x + 18, y - 4) + text(x + 24, y, words, "start", "small")


def _headings(trace: Trace) -> Panel:
    """Difference of the worst level heading from the last step, on a logarithmic axis, with the target."""
    known = trace.heading_differences_deg[trace.heading_differences_deg > 0.0]
    least, most = (float(known.min()), float(known.max())) if len(known) else (0.1, 1.0)
    low = 10.0 ** math.floor(math.log10(min(max(least, MIN_AXIS_DEG), MAX_AXIS_DEG / 10.0)))
    high = min(max(10.0 ** math.ceil(math.log10(most)), 10.0 * low), MAX_AXIS_DEG)
    off = trace.heading_differences_deg.clip(low / 10.0, 10.0 * high)

    def draw(canvas: Canvas) -> list[str]:
        aim = [canvas.level(trace.target_deg, "aim")] if low < trace.target_deg < high else []
        return aim + [canvas.line("line", trace.steps.counts[run], off[run]) for run in true_runs(trace.steps.is_known)]

    decades = [low * 10.0**decade for decade in range(round(math.log10(high / low)) + 1)]
    across, numbers = _over_readings(trace)
    title = "worst level heading: off that of the last"
    rows = [(number, f"{number:g}°") for number in decades]
    return Panel(across, Axis(low, high, np.log10), draw, title=title, x_ticks=numbers, y_ticks=rows)


def root_ticks(whole: int) -> list[int]:
    """Round numbers at about a quarter, half and three quarters of the length of a square-root axis from 0 to `whole`.

    >>> root_ticks(1000), root_ticks(2400), root_ticks(5)
    ([50, 200, 500], [200, 500, 1000], [1, 2])
    """
    counts = (nearest_round(whole * (place / 4) ** 2) for place in (1, 2, 3))
    return [int(count) for count in counts if 1.0 <= count <= MAX_TICK_SHARE * whole]
