"""Page of the terminal for the drift of units from their histories.

>>> shown_time(1795946435.0), shown_time(93600.0), shown_time(float("nan"))
('2026-11-29 10:00', '26.0 h', '–')
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column

from flinders.apps.fleet.report import chance, common_unit
from flinders.apps.fleet.walks import STATES
from flinders.core.units import unit_label
from flinders.errors import count_text, figures
from flinders.readers._times import MIN_EPOCH_S
from flinders.report.formatting import degrees, with_uncertainty
from flinders.report.terminal import page, style_cells, table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.apps.fleet.walks import FleetWalk, UnitWalk

STATE_COLOURS: Final = {"moved": "red", "faster": "yellow", "steady": "green"}
MAX_ROWS: Final = 12
"""Largest number of units, steps and estimates that are listed; ``--output`` and ``--json`` have more."""


def of_walks(fleet: FleetWalk) -> RenderableType:
    """Lay out states, random walks and steps of units; for a single unit, also its offset over time."""
    unit = fleet.listed[0].unit_of_field if fleet.listed else ""
    history = None if fleet.history is None else _history(fleet.history, unit)
    steps = _steps(fleet) if fleet.steps else None
    return page(_states(fleet), _units(fleet), steps, history, Group(*remarks(fleet)))


def shown_time(seconds: float) -> str:
    """Format a time: date and hour if it counts from 1970, else hours."""
    if not math.isfinite(seconds):
        return "–"
    if seconds < MIN_EPOCH_S:
        return f"{seconds / 3600.0:,.1f} h"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M}"


def walk_words(one: UnitWalk) -> str:
    """Random walk of a unit in an hour, with its 95 % interval."""
    if math.isnan(one.walk):
        return "–"
    return f"{figures(one.walk)} ({figures(one.walk_low)} to {figures(one.walk_high)})"


def remarks(fleet: FleetWalk) -> list[str]:
    """Remarks below the tables, one line each."""
    found = ["walk: change of an offset in an hour, 1 σ, with its 95 % interval; it grows with the root of time"]
    if math.isfinite(fleet.walk_spread):
        found.append(
            f"a unit walks {degrees(fleet.typical_walk_deg)} of heading in a day in the median; units are within a "
            f"factor of {figures(fleet.walk_spread)} of that (1 σ)"
        )
    share = f"{fleet.false_alarm_probability:.0%}"
    what = f"a step between {count_text(fleet.intervals, 'pair')} of estimates, or a faster unit,"
    return [*found, f"chance alone lists {what} in {share} of fleets of this size in which nothing changed"]


def _states(fleet: FleetWalk) -> Table:
    rows = [
        style_cells(STATE_COLOURS.get(name, "dim"), name, f"{fleet.states[name]:,}", words)
        for name, words in STATES.items()
        if fleet.states[name]
    ]
    return table((Column("units", no_wrap=True), "", Column("")), rows, is_dense=True)


def _units(fleet: FleetWalk) -> Table:
    unit = common_unit(fleet.listed)
    headings = (
        Column("unit", no_wrap=True), Column("state", no_wrap=True), f"walk, {unit}" if unit else "walk", "in a day",
        "steps", "from", "to",
    )  # fmt: skip
    rows = [
        (one.unit, one.state, walk_words(one) if unit else f"{walk_words(one)} {unit_label(one.unit_of_field)}",
         "" if math.isnan(one.walk_deg) else degrees(one.walk_deg), str(one.steps),
         shown_time(one.begin_s), shown_time(one.end_s))
        for one in fleet.listed[:MAX_ROWS]
    ]  # fmt: skip
    return table(headings, [*rows, *_more(fleet.units)], is_dense=True)


def _steps(fleet: FleetWalk) -> Table:
    unit = common_unit(fleet.steps)
    by = f"offset by, {unit}" if unit else "offset by"
    rows = [
        (one.unit, degrees(one.worst_deg),
         f"{figures(math.hypot(*one.offset_change))} {unit_label(one.unit_of_field)}".removesuffix(f" {unit}"),
         chance(one.p_value), shown_time(one.before_s), shown_time(one.after_s))
        for one in fleet.steps[:MAX_ROWS]
    ]  # fmt: skip
    headings = (Column("moved", no_wrap=True), "heading", by, "chance", "after", "before")
    return table(headings, [*rows, *_more(fleet.step_count)], is_dense=True)


def _history(history: Mapping[str, Sequence[Any]], unit: str) -> Table:
    """Table of up to `MAX_ROWS` estimates of a unit, with the first and the last."""
    count = len(history["time_s"])
    places = np.unique(np.linspace(0, count - 1, min(count, MAX_ROWS)).round().astype(int)).tolist() if count else []
    rows = [
        (shown_time(history["time_s"][place]),
         *map(with_uncertainty, history["offset"][place], history["sigma"][place]))
        for place in places
    ]  # fmt: skip
    shown = unit_label(unit)
    return table((Column("time", no_wrap=True), *(f"offset {axis}, {shown}" for axis in "xyz")), rows, is_dense=True)


def _more(count: int) -> list[tuple[str]]:
    """Last row, with the number of rows that are not shown, if there are any."""
    return [(f"and {count - MAX_ROWS:,} more",)] if count > MAX_ROWS else []
