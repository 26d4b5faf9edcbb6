"""How a fleet changed, as a page for the terminal: states, the units to recalibrate, and what was moved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.errors import counted, figures
from flinders.report.fleet import chance, when
from flinders.report.fleet_view import STATES
from flinders.report.text import degrees
from flinders.units import label

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from flinders.report.fleet_view import Drift

COLOURS: Final = {"recalibrate": "red", "unsure": "yellow", "changed": "yellow", "steady": "green"}
SHOWN: Final = 12
"""Units and steps that are listed; the report and ``--out`` have more."""


def page(drift: Drift) -> RenderableType:
    """Lay out a drift for a rich console."""
    from rich.console import Group

    parts: list[RenderableType] = ["", _states(drift)]
    if drift.listed:
        parts += ["", _units(drift)]
    if drift.steps:
        parts += ["", _steps(drift)]
    return Group(*parts, "", *_remarks(drift))


def _table(*headings: str, texts: int = 1) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if place < texts else "right", no_wrap=place < texts)
    return table


def _states(drift: Drift) -> RenderableType:
    table = _table("units", "", "")
    table.columns[2].justify = "left"
    for name, words in STATES.items():
        if drift.states[name]:
            table.add_row(name, f"{drift.states[name]:,}", words, style=COLOURS.get(name, "dim"))
    return table


def _units(drift: Drift) -> RenderableType:
    table = _table("worst first", "state", "heading", "1 σ", "offset", "matrix", "since", texts=2)
    for one in drift.listed[:SHOWN]:
        numbers = (one.worst_deg, one.sigma_deg, one.offset_deg, one.matrix_deg)
        table.add_row(one.unit, one.state, *map(degrees, numbers), when(one.first_s))
    if len(drift.listed) > SHOWN:
        more = drift.states["recalibrate"] + drift.states["unsure"] - SHOWN
        table.add_row(f"and {more:,} more", "")
    return table


def _steps(drift: Drift) -> RenderableType:
    table = _table("moved", "heading", "offset by", "chance", "after", "before")
    for one in drift.steps[:SHOWN]:
        moved = f"{figures(sum(value**2 for value in one.moved) ** 0.5)} {label(one.unit_of_field)}"
        days = when(one.before_s), when(one.after_s)
        table.add_row(one.unit, degrees(one.worst_deg), moved, chance(one.p_value), *days)
    if drift.step_count > SHOWN:
        table.add_row(f"and {drift.step_count - SHOWN:,} more")
    return table


def _remarks(drift: Drift) -> list[str]:
    """What else there is to know, a line each."""
    against = "its first" if drift.against == "first" else "the one before"
    what = f"{counted(drift.calibrations, 'calibration')} of {counted(drift.units, 'unit')}"
    found = [f"{what}; the newest of each against {against}, held level, dip {abs(drift.dip_deg):g}°"]
    if drift.session > 1.05:
        found.append(f"recordings scatter {figures(drift.session**0.5)} times as far as they claim: allowed for")
    if drift.walk_deg > 0.005:
        found.append(f"slow drift of this fleet: {degrees(drift.walk_deg)} of heading over a year (1 σ)")
    if drift.left_out:
        found.append(f"{counted(drift.left_out, 'row')} left out: refused, failed, or in another unit than the others")
    found.append(
        f"chance alone lists a unit, or a step, in {drift.chance:.0%} of fleets of this size in which nothing changed"
    )
    return found
