"""Change of a fleet over time, as a page of the terminal.

>>> day_or_name(1.7e9, "flight 12"), day_or_name(float("nan"), "flight 12"), day_or_name(float("nan"), "")
('2023-11-14', 'flight 12', '–')
>>> day_or_name(float("nan"), "returned/session 0017.csv")
'…session 0017.csv'
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column

from flinders.apps.fleet.overview import STATES
from flinders.apps.fleet.report import chance, common_unit, format_day, order_notes
from flinders.core.units import unit_label
from flinders.errors import count_text, figures, percent
from flinders.report.formatting import (
    degrees,
)
from flinders.report.terminal import page, style_cells, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType
    from rich.table import Table
    from rich.text import Text

    from flinders.apps.fleet.overview import BatchDrift, FleetDrift

STATE_COLOURS: Final = {
    "recalibrate": "red", "unsure": "yellow", "changed": "yellow", "unordered": "yellow", "steady": "green",
}  # fmt: skip
MAX_ROWS: Final = 12
"""Largest number of units, steps and batches that are listed; the report and ``--output`` have more."""
MAX_NAME_LENGTH: Final = 17
"""Largest number of characters of a recording's name that are shown."""


def of_drift(drift: FleetDrift) -> RenderableType:
    """Lay out the drift of a fleet: states, units to recalibrate, steps, and batches."""
    units = _units(drift) if drift.listed else None
    steps = _steps(drift) if drift.steps else None
    batches = _batches(drift) if drift.batches else None
    return page(_states(drift), units, steps, batches, Group(*_remarks(drift)))


def day_or_name(seconds: float, recording: str) -> str:
    """Day of a recording; if the date is not known, the end of its name."""
    if math.isfinite(seconds) or not recording:
        return format_day(seconds)
    return recording if len(recording) <= MAX_NAME_LENGTH else f"…{recording[1 - MAX_NAME_LENGTH :]}"


def _states(drift: FleetDrift) -> Table:
    rows = [
        style_cells(STATE_COLOURS.get(name, "dim"), name, f"{drift.states[name]:,}", words)
        for name, words in STATES.items()
        if drift.states[name]
    ]
    return table((Column("units", no_wrap=True), "", Column("")), rows, is_dense=True)


def _units(drift: FleetDrift) -> Table:
    names = (Column("worst first", overflow="fold"), Column("state", no_wrap=True))
    rows = [
        (one.unit, one.state, *map(_known_angle, (one.worst_deg, one.sigma_deg, one.offset_deg, one.matrix_deg)),
         day_or_name(one.reference_s, one.reference), day_or_name(one.newest_s, one.newest))
        for one in drift.listed[:MAX_ROWS]
    ]  # fmt: skip
    count = drift.states["recalibrate"] + drift.states["unsure"] if len(drift.listed) > MAX_ROWS else 0
    dates = (Column(each, justify="right", no_wrap=True) for each in (drift.against, "newest"))
    return table((*names, "heading", "1 σ", "offset", "matrix", *dates), [*rows, *_more(count)], is_dense=True)


def _known_angle(angle_deg: float) -> str:
    """Cell of an angle in degrees; empty if the angle is not known."""
    return "" if math.isnan(angle_deg) else degrees(angle_deg)


def _steps(drift: FleetDrift) -> Table:
    unit = common_unit(drift.steps)
    by = f"offset by, {unit}" if unit else "offset by"
    headings = (Column("moved", no_wrap=True), "heading", by, "chance", "after", "before")
    rows = [
        (one.unit, degrees(one.worst_deg),
         f"{figures(math.hypot(*one.offset_change))} {unit_label(one.unit_of_field)}".removesuffix(f" {unit}"),
         chance(one.p_value), day_or_name(one.before_s, one.before), day_or_name(one.after_s, one.after))
        for one in drift.steps[:MAX_ROWS]
    ]  # fmt: skip
    return table(headings, [*rows, *_more(drift.step_count)], is_dense=True)


def _batches(drift: FleetDrift) -> Table:
    headings = (Column("batch", no_wrap=True), "units", "recalibrate", "changed", "steps", "not good")
    rows = [_batch_row(one) for one in _shown_batches(drift.batches, MAX_ROWS)]
    return table((*headings, Column("stands out by")), [*rows, *_more(len(drift.batches))], is_dense=True)


def _batch_row(one: BatchDrift) -> list[Text]:
    counts = (one.units, one.states.get("recalibrate", 0), one.states.get("changed", 0), one.step_units)
    cells = (*(f"{count:,}" for count in counts), percent(*one.not_good), ", ".join(one.stands_out))
    return style_cells("yellow" if one.stands_out else "", one.batch or "not known", *cells)


def _more(count: int) -> list[tuple[str]]:
    """Last row, with the number of rows that are not shown, if there are any."""
    return [(f"and {count - MAX_ROWS:,} more",)] if count > MAX_ROWS else []


def _shown_batches(batches: Sequence[BatchDrift], most: int) -> list[BatchDrift]:
    """Select `most` batches, sorted by name: those that stand out, then those with the largest share of changes."""
    worst = sorted(batches, key=lambda one: (not one.stands_out, -one.changed_units / max(one.units, 1), one.batch))[
        :most
    ]
    return sorted(worst, key=lambda one: one.batch)


def _remarks(drift: FleetDrift) -> list[str]:
    """Remarks below the tables, one line each."""
    against = "its first" if drift.against == "first" else "the one before"
    what = f"{count_text(drift.calibrations, 'calibration')} of {count_text(drift.units, 'unit')}"
    remarks = [f"{what}; the newest of each against {against}, level vehicle, dip {abs(drift.dip_deg):.3g}°"]
    remarks += order_notes(drift)
    if drift.variance_factor > 1.05:
        remarks.append(
            f"recordings scatter {figures(drift.variance_factor**0.5)} times as far as they claim: tests allow for it"
        )
    if drift.random_walk_deg_per_root_year > 0.005:
        remarks.append(
            f"slow drift of this fleet: {degrees(drift.random_walk_deg_per_root_year)} of heading over a year (1 σ)"
        )
    undated = drift.undated
    if undated.units and undated.variance_factor > 1.05:
        times = figures(undated.variance_factor**0.5)
        remarks.append(f"recordings without dates scatter {times} times as far as they claim: tests allow for it")
    if undated.units and undated.random_walk_deg_per_root_recording > 0.005:
        by = f"{degrees(undated.random_walk_deg_per_root_recording)} of heading from one recording to the next (1 σ)"
        remarks.append(f"slow drift where no dates are known: {by}")
    if drift.without_calibration:
        rows = count_text(drift.without_calibration, "row")
        remarks.append(f"{rows} left out: refused, failed, or in another unit than the others")
    if drift.batches:
        remarks.append(f"the batch is taken from {drift.batch_source}")
    share = f"{drift.false_alarm_probability:.0%} of fleets of this size in which nothing changed"
    return [*remarks, f"chance alone lists a unit, or a step, in {share}"]
