"""Calibrations put together as a page for the terminal: each against the others, the result, the verdict.

>>> explained(0.43), explained(1e-9)
('p = 0.43', 'p < 0.0001')
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import counted
from flinders.report.formatting import degrees
from flinders.report.text import COLOURS, MARKS, numbers

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.comparison.merging import Merged


def page(merged: Merged) -> RenderableType:
    """Lay out what was merged for a rich console; of a refused one no number of the calibration."""
    from rich.console import Group

    found = [numbers(merged.calibration, merged.offset_sigma, merged.noise), ""]
    result = [] if merged.verdict == "refused" else found
    return Group("", _parts(merged), "", *result, _verdict(merged), _findings(merged))


def explained(p_value: float) -> str:
    """How often chance does as much."""
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"


def _parts(merged: Merged) -> RenderableType:
    """Each calibration against the others."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("calibration", overflow="fold")
    for heading in ("readings", "claims", "off the others", "chance"):
        table.add_column(heading, justify="right", no_wrap=True)
    for part in merged.repeats.parts:
        off = f"{degrees(part.off_deg)} ± {degrees(part.off_sigma_deg)}"
        readings = f"{part.samples:,}" if part.samples else ""
        table.add_row(part.source, readings, degrees(part.claimed_deg), off, explained(part.p_value))
    return table


def _verdict(merged: Merged) -> RenderableType:
    """Say what it is good for, and what there is to know."""
    from rich.table import Table
    from rich.text import Text

    error, verdict = merged.heading_error_deg, merged.verdict
    within = f"worst heading good to {degrees(error.worst)} (1 σ; the target is {merged.target_deg:g}°)"
    words = {
        "good": within,
        "limited": f"{within}, with these limits:",
        "refused": "not fit for use, nothing was written",
    }[verdict]
    basis = f"{counted(len(merged.repeats.parts), 'calibration')}"
    if merged.samples:
        basis += f" of {counted(merged.samples, 'reading')}"
    basis += f"; chance scatters them as far with {explained(merged.repeats.p_value)}"
    if verdict != "refused":
        basis += f"; held level, dip {error.dip_deg:g}°"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    grid.add_row(Text(verdict.upper(), f"bold {COLOURS[verdict]}"), words)
    grid.add_row("", Text(basis, "dim"))
    return grid


def _findings(merged: Merged) -> RenderableType:
    """What limits it; where it is refused, only why."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 1))
    for finding in merged.findings:
        if finding.severity != "note" or merged.verdict != "refused":
            mark, style = MARKS[finding.severity]
            grid.add_row(Text(f"  {mark}", style=style), Text(finding.advice, style="dim" if style == "dim" else ""))
    return grid
