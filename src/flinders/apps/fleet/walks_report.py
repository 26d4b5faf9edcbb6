"""Report of the drift of units from their histories, as one HTML file: states, rates, steps, offsets over time."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.fleet.report import FILTERS
from flinders.apps.fleet.walks import STATES
from flinders.apps.fleet.walks_page import remarks, shown_time, walk_words
from flinders.core.units import unit_label
from flinders.findings.words import as_sentence
from flinders.report.charts import Axis, Panel, round_up, stack_panels
from flinders.report.formatting import date_of, minus
from flinders.report.html_file import html_file, script_of, style_of
from flinders.workflows.offset_history import OffsetHistory, find_histories

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from flinders.apps.fleet.walks import FleetWalk
    from flinders.report.charts import Canvas

MAX_DRAWN: Final = 12
"""Largest number of units whose offset is drawn, the most urgent first."""
WIDTH: Final = 720.0


def page_of(fleet: FleetWalk, paths: Sequence[str | os.PathLike[str]]) -> str:
    """The report as one HTML file; the histories of units that are drawn are read again."""
    urgent = [one.unit for one in fleet.listed[:MAX_DRAWN]]
    drawn = {
        name: OffsetHistory.read(path, name=name) for path, name in find_histories(paths).items() if name in urgent
    }
    given = {
        "fleet": fleet,
        "states": STATES,
        "remarks": [as_sentence(words).rstrip(".") for words in remarks(fleet)],
        "figures": [(name, offset_over_time(drawn[name])) for name in urgent if len(drawn[name].time_s) > 1],
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    filters = {**FILTERS, "time": shown_time, "walk": walk_words}
    style = style_of("apps/fleet/fleet.css")
    return html_file("apps/fleet/walks.html.j2", given, style=style, script=script_of(), filters=filters)


def offset_over_time(history: OffsetHistory) -> str:
    """Drawing of the offset along each axis over time, minus its median, with a band of one standard deviation."""
    estimates = history.estimates
    hours = (estimates.time_s - estimates.time_s[0]) / 3600.0
    off = estimates.offset - np.median(estimates.offset, axis=0)
    end = round_up(1.02 * float((np.abs(off) + estimates.sigma).max()) or 1.0)
    moved = (np.array(history.moved_s) - estimates.time_s[0]) / 3600.0
    is_long = hours[-1] > 72.0
    when, moves = (hours / 24.0, moved / 24.0) if is_long else (hours, moved)
    words = f"{'days' if is_long else 'hours'} from {shown_time(float(estimates.time_s[0]))}"
    columns = zip("xyz", off.T, estimates.sigma.T, strict=True)

    def panel(axis: str, value: np.ndarray, sigma: np.ndarray) -> Panel:
        def draw(plot: Canvas) -> list[str]:
            ends = [np.array([at, at]) for at in moves.tolist()]
            return [
                plot.area("band", when, value - sigma, value + sigma),
                plot.line("curve corrected thin", when, value),
                *(plot.line("aim", at, np.array([-end, end])) for at in ends),
            ]

        numbers = [(place, minus(f"{place:+.3g}") if place else "0") for place in (-end, 0.0, end)]
        title = f"{axis}, {unit_label(history.unit)}"
        across = Axis(0.0, float(when[-1]) or 1.0)
        return Panel(across, Axis(-end, end), draw, words, title=title, y_ticks=numbers)

    return stack_panels(
        f"Offset of {history.name} over time", [panel(*each) for each in columns], wide=WIDTH, high=72.0
    )
