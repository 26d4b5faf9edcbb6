"""Two calibrations side by side as a page for the terminal: the difference, what chance explains, the verdict.

>>> chance(0.43), chance(1e-9), chance(None)
('p = 0.43', 'p < 0.0001', 'no uncertainty is stated')
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.report.text import COLOURS, MARKS, degrees, four_digits
from flinders.units import label

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.comparison import Comparison, Strength
    from flinders.result import Fit

TITLES: Final = {"agree": ("AGREE", "HOLDS"), "differ": ("DIFFER", "IS OFF"), "contradict": ("CONTRADICT", "IS WRONG")}
"""Of two calibrations, and of one on another recording."""


def page(
    comparison: Comparison, *, fresh: Fit | None = None, strengths: tuple[Strength, Strength] | None = None
) -> RenderableType:
    """Lay out a comparison for a rich console.

    Parameters
    ----------
    comparison : Comparison
    fresh : Fit, optional
        Of the recording that a calibration is checked on: what limits it is said below.
    strengths : pair of Strength, optional
        Of that recording, under the calibration and under the fresh fit.
    """
    from rich.console import Group

    parts: list[RenderableType] = ["", _differences(comparison), ""]
    if strengths is not None:
        parts += [_strengths(*strengths), ""]
    return Group(*parts, _verdict(comparison, fresh))


def chance(p_value: float | None) -> str:
    """Write how often chance explains a difference."""
    if p_value is None:
        return "no uncertainty is stated"
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"


def _differences(comparison: Comparison) -> RenderableType:
    from rich import box
    from rich.table import Table

    unit = label(comparison.unit)
    found, claimed = comparison.heading_difference_deg, comparison.claimed_deg
    offset = ", ".join(f"{part + 0.0:+.2g}" for part in comparison.offset_difference)
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("")
    table.add_column("difference")
    table.add_column("claimed, 1 σ")
    table.add_row("heading, rms", degrees(found.rms), "" if claimed is None else degrees(claimed.rms), style="bold")
    table.add_row("heading, worst", degrees(found.worst), "" if claimed is None else degrees(claimed.worst))
    table.add_row("heading, mean", f"{comparison.heading_mean_deg + 0.0:+.2g}°", "")
    table.add_row("direction, rms", degrees(comparison.direction_difference_deg), "")
    table.add_row("offset", f"{offset} {unit} ({comparison.offset_share:.2%} of the field)", "")
    what = "" if comparison.is_scale_known else ", with that of the field"
    table.add_row("scale", f"{comparison.scale_difference:+.2%}{what}", "")
    return table


def _strengths(known: Strength, fresh: Strength) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    for heading in ("corrected with", "strength", "spread"):
        table.add_column(heading, justify="left" if heading == "corrected with" else "right")
    for name, strength in (("the calibration", known), ("a fresh fit", fresh)):
        table.add_row(name, four_digits(strength.mean), f"{strength.spread:.1%}")
    return table


def _verdict(comparison: Comparison, fresh: Fit | None) -> RenderableType:
    """Say what to make of it, and what it rests on."""
    from rich.table import Table
    from rich.text import Text

    limited = fresh is not None and fresh.verdict != "good"
    firm = comparison.is_telling and not limited
    colour = {"agree": "good" if firm else "limited", "differ": "limited", "contradict": "refused"}[comparison.verdict]
    basis = f"level, dip {abs(comparison.heading_difference_deg.dip_deg):g}°"
    if comparison.p_value is not None:
        basis += f"; χ² = {comparison.chi_square:.3g} for {comparison.freedom} degrees of freedom"
    if fresh is not None:
        basis += f"; {fresh.samples:,} readings, {fresh.coverage.fraction:.0%} of the sphere seen"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    title = TITLES[comparison.verdict][fresh is not None]
    grid.add_row(Text(title, f"bold {COLOURS[colour]}"), _words(comparison))
    grid.add_row("", Text(basis, "dim"))
    if fresh is not None and limited:
        mark, style = MARKS["limits"]
        for finding in fresh.findings:
            if finding.severity == "limits":
                grid.add_row(Text(f"  {mark}".rjust(len(title)), style=style), finding.advice)
    return grid


def _words(comparison: Comparison) -> str:
    told, target = chance(comparison.p_value), f"{comparison.target_deg:g}°"
    worst = degrees(comparison.heading_difference_deg.worst)
    if comparison.verdict == "agree":
        vague = "" if comparison.is_telling else f"; but they claim too little to tell {target}"
        return f"heading within {worst}, no more than chance explains ({told}){vague}"
    what = (
        "more than chance explains" if comparison.p_value is not None else "and nothing says how much chance explains"
    )
    side = "less" if comparison.verdict == "differ" else "more"
    return f"headings up to {worst} apart, {what} ({told}), and {side} than the target of {target}"
