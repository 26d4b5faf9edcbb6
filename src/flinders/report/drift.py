"""How a fleet changed, as a page for the terminal: states, the units to recalibrate, what was moved, and batches.

>>> shown_when(1.7e9, "flight 12"), shown_when(float("nan"), "flight 12"), shown_when(float("nan"), "")
('2023-11-14', 'flight 12', '–')
>>> shown_when(float("nan"), "returned/session 0017.csv")
'…session 0017.csv'
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import counted, figures, percent
from flinders.report.fleet import about_order, chance, when
from flinders.report.fleet_view import STATES
from flinders.report.formatting import degrees

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.report.fleet_view import BatchDrift, Drift

COLOURS: Final = {
    "recalibrate": "red", "unsure": "yellow", "changed": "yellow", "unordered": "yellow", "steady": "green",
}  # fmt: skip
SHOWN: Final = 12
"""Units, steps and batches that are listed; the report and ``--out`` have more."""
LONGEST: Final = 17
"""Characters of a recording's name that are shown."""


def page(drift: Drift) -> RenderableType:
    """Lay out a drift for a rich console."""
    from rich.console import Group

    parts: list[RenderableType] = ["", _states(drift)]
    if drift.listed:
        parts += ["", _units(drift)]
    if drift.steps:
        parts += ["", _steps(drift)]
    if drift.batches:
        parts += ["", _batches(drift)]
    return Group(*parts, "", *_remarks(drift))


def shown_when(seconds: float, recording: str) -> str:
    """Write the day of a recording; where no date is known, the end of its name."""
    if math.isfinite(seconds) or not recording:
        return when(seconds)
    return recording if len(recording) <= LONGEST else f"…{recording[1 - LONGEST :]}"


def _table(*headings: str, texts: int = 1) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True, header_style="")
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
    table = _table("worst first", "state", "heading", "1 σ", "offset", "matrix", drift.against, "newest", texts=2)
    for one in drift.listed[:SHOWN]:
        numbers = (one.worst_deg, one.sigma_deg, one.offset_deg, one.matrix_deg)
        days = shown_when(one.reference_s, one.reference), shown_when(one.newest_s, one.newest)
        table.add_row(one.unit, one.state, *map(degrees, numbers), *days)
    if len(drift.listed) > SHOWN:
        more = drift.states["recalibrate"] + drift.states["unsure"] - SHOWN
        table.add_row(f"and {more:,} more", "")
    return table


def _steps(drift: Drift) -> RenderableType:
    table = _table("moved", "heading", "offset by", "chance", "after", "before")
    for one in drift.steps[:SHOWN]:
        moved = f"{figures(sum(value**2 for value in one.moved) ** 0.5)} {label(one.unit_of_field)}"
        days = shown_when(one.before_s, one.before), shown_when(one.after_s, one.after)
        table.add_row(one.unit, degrees(one.worst_deg), moved, chance(one.p_value), *days)
    if drift.step_count > SHOWN:
        table.add_row(f"and {drift.step_count - SHOWN:,} more")
    return table


def _batches(drift: Drift) -> RenderableType:
    table = _table("batch", "units", "recalibrate", "changed", "steps", "not good", "stands out by")
    table.columns[-1].justify = "left"
    for one in shown_batches(drift.batches, SHOWN):
        counts = (one.units, one.states.get("recalibrate", 0), one.states.get("changed", 0), one.stepped)
        style = "yellow" if one.stands_out else None
        told = ", ".join(one.stands_out)
        table.add_row(one.batch or "not known", *(f"{n:,}" for n in counts), percent(*one.not_good), told, style=style)
    if len(drift.batches) > SHOWN:
        table.add_row(f"and {len(drift.batches) - SHOWN:,} more")
    return table


def shown_batches(batches: Sequence[BatchDrift], most: int) -> list[BatchDrift]:
    """Take so many by name: those that stand out, and of the others those with the largest share that changed."""
    worst = sorted(batches, key=lambda one: (not one.stands_out, -one.changed / max(one.units, 1), one.batch))[:most]
    return sorted(worst, key=lambda one: one.batch)


def _remarks(drift: Drift) -> list[str]:
    """What else there is to know, a line each."""
    against = "its first" if drift.against == "first" else "the one before"
    what = f"{counted(drift.calibrations, 'calibration')} of {counted(drift.units, 'unit')}"
    found = [f"{what}; the newest of each against {against}, held level, dip {abs(drift.dip_deg):g}°"]
    found += about_order(drift)
    if drift.session > 1.05:
        found.append(f"recordings scatter {figures(drift.session**0.5)} times as far as they claim: allowed for")
    if drift.walk_deg > 0.005:
        found.append(f"slow drift of this fleet: {degrees(drift.walk_deg)} of heading over a year (1 σ)")
    undated = drift.undated
    if undated.units and undated.session > 1.05:
        found.append(
            f"recordings without dates scatter {figures(undated.session**0.5)} times as far as they claim: allowed for"
        )
    if undated.units and undated.walk_deg > 0.005:
        found.append(
            f"slow drift where no dates are known: {degrees(undated.walk_deg)} of heading from one recording to the "
            "next (1 σ)"
        )
    if drift.left_out:
        found.append(f"{counted(drift.left_out, 'row')} left out: refused, failed, or in another unit than the others")
    if drift.batches:
        found.append(f"the batch is told by {drift.batch_of}")
    found.append(
        f"chance alone lists a unit, or a step, in {drift.chance:.0%} of fleets of this size in which nothing changed"
    )
    return found
