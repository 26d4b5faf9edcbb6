"""What came of a run, as a page for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.errors import counted, figures, percent
from flinders.report.fleet_view import SUMS_ALONE

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.fleet.told import Told

COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red", "failed": "red"}
ENDINGS: Final = {"none": "without an ending"}
"""Kinds of files that are left out, where the word for one is not what it ends in."""
SHOWN: Final = 8
"""Codes and findings that are listed; the table has them all."""


def page(told: Told) -> RenderableType:
    """Lay out a run: what was there, verdicts, why there are rows without a calibration, and what was found."""
    from rich.console import Group

    parts = [_what(told), "", _verdicts(told)]
    if told.codes:
        parts += ["", _counted("no calibration because", told.codes)]
    if told.findings:
        parts += ["", _counted("findings", told.findings)]
    return Group("", *parts, "", *_remarks(told))


def _what(told: Told) -> str:
    held = ", ".join((counted(told.units, "unit"), counted(told.rows, "recording"), counted(told.readings, "reading")))
    return f"{counted(told.files, 'file')}: {held}"


def _verdicts(told: Told) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("verdict")
    for name in ("recordings", "share"):
        table.add_column(name, justify="right")
    for verdict, count in told.verdicts.items():
        table.add_row(verdict, f"{count:,}", percent(count, told.rows), style=COLOURS[verdict])
    return table


def _counted(title: str, counts: dict[str, int]) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column(title)
    table.add_column("recordings", justify="right")
    for code, count in list(counts.items())[:SHOWN]:
        table.add_row(code, f"{count:,}")
    if len(counts) > SHOWN:
        table.add_row(f"and {len(counts) - SHOWN} more", "")
    return table


def _remarks(told: Told) -> list[str]:
    """What else there is to know, a line each."""
    found = []
    if told.worst_deg:
        middle, most, largest = (figures(told.worst_deg[name]) for name in ("median", "p95", "largest"))
        found.append(f"worst heading error: median {middle}°, 95% below {most}°, largest {largest}° (1 σ)")
    if told.failed_readings:
        found.append(f"readings of recordings that failed: {told.failed_readings:,} of {told.readings:,}")
    if not told.polish:
        found.append(f"from sums alone: {SUMS_ALONE}")
    if len(told.units_of_field) > 1:
        units = ", ".join(f"{count:,} in {unit}" for unit, count in told.units_of_field.items())
        found.append(f"units of field differ: {units}; offsets are in the unit of their row")
    if told.left_out:
        kinds = ", ".join(f"{count:,} {ENDINGS.get(kind, kind)}" for kind, count in told.left_out.items())
        found.append(f"left out files that are no recordings: {kinds}")
    if told.resumed:
        found.append(f"{told.resumed:,} of {counted(told.partitions, 'partition')} were done before")
    if told.workers_lost or told.retried:
        again = f"{counted(told.retried, 'partition')} {'was' if told.retried == 1 else 'were'} done again"
        found.append(f"{counted(told.workers_lost, 'worker')} died or left; {again}")
    return found
