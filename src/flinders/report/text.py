"""A fit as a page for the terminal: before and after, the numbers with their uncertainty, the verdict.

>>> with_uncertainty(28.5571, 0.0432), with_uncertainty(-0.00234, 1.2)
('28.557 ± 0.043', '0.0 ± 1.2')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.units import label

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.result import Finding, Fit

COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red"}
WORDS: Final = {
    "good": "within the target at every heading",
    "limited": "usable with the limits below",
    "refused": "not fit for use",
}
MARKS: Final = {"refuses": ("✗", "red"), "limits": ("!", "yellow"), "note": ("·", "dim")}


def page(fit: Fit) -> RenderableType:
    """Lay out a fit for a rich console."""
    from rich.console import Group
    from rich.padding import Padding

    parts: list[RenderableType] = [_before_and_after(fit), "", _numbers(fit), "", _verdict(fit)]
    if fit.findings:
        parts += [Padding(_findings(fit.findings), (0, 0, 0, 2))]
    return Group(*parts)


def with_uncertainty(value: float, sigma: float) -> str:
    """Write a number to the second digit of its standard deviation."""
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.6g}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    shown = round(value, digits) + 0.0
    return f"{shown:.{digits}f} ± {sigma:.{digits}f}"


def degrees(angle: float) -> str:
    """Write an angle of error: two digits, and no more than anyone could mean."""
    return f"{angle:.2g}°" if angle < 10 else f"{min(angle, 180):.0f}°" if angle < 100 else "> 100°"


def _before_and_after(fit: Fit) -> RenderableType:
    from rich import box
    from rich.table import Table

    unit = label(fit.calibration.unit)
    raw, error = fit.uncorrected_heading_error_deg, fit.heading_error_deg
    strength, spread = fit.uncorrected_strength
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    for heading in ("strength", "spread", "heading error, rms", "worst"):
        table.add_column(heading, justify="right")
    table.add_row("before", f"{strength:.4g} {unit}", f"{spread:.1%}", degrees(raw.rms), degrees(raw.worst))
    field = fit.calibration.field_strength
    table.add_row(
        "after", f"{field:.4g} {unit}", f"{fit.noise / field:.1%}", degrees(error.rms), degrees(error.worst),
        style="bold",
    )  # fmt: skip
    return table


def _numbers(fit: Fit) -> RenderableType:
    from rich.table import Table

    grid = Table.grid(padding=(0, 3))
    grid.add_column(style="dim")
    for _ in range(3):
        grid.add_column(justify="right")
    grid.add_column(style="dim")
    offset = [with_uncertainty(*pair) for pair in zip(fit.calibration.offset, fit.offset_sigma, strict=True)]
    grid.add_row("offset", *offset, label(fit.calibration.unit))
    for title, row in zip(("matrix", "", ""), fit.calibration.matrix, strict=True):
        grid.add_row(title, *_entries(row), "")
    grid.add_row("noise", f"{fit.noise:.3g}", "", "", label(fit.calibration.unit))
    return grid


def _entries(row: Floats) -> Iterable[str]:
    return (f"{float(value):.6f}" for value in row)


def _verdict(fit: Fit) -> RenderableType:
    from rich.text import Text

    error = fit.heading_error_deg
    text = Text.assemble((fit.verdict.upper(), f"bold {COLOURS[fit.verdict]}"), f"  {WORDS[fit.verdict]}")
    text.append(
        f" (level vehicle, dip {error.dip_deg:g}°, target {fit.target_deg:g}°, 1 σ; {fit.samples:,} readings, "
        f"{fit.coverage.fraction:.0%} of the sphere seen)",
        style="dim",
    )
    return text


def _findings(findings: Iterable[Finding]) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 1))
    for finding in findings:
        mark, style = MARKS[finding.severity]
        grid.add_row(Text(mark, style=style), Text(finding.advice, style="dim" if style == "dim" else ""))
    return grid
