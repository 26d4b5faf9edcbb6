"""Two calibrations side by side as a page for the terminal: the difference, what chance explains, the verdict.

>>> chance(0.43), chance(1e-9)
('no more than chance explains (p = 0.43)', 'more than chance explains (p < 0.0001)')
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.comparison.comparison import CHANCE
from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.report.formatting import degrees, with_uncertainty
from flinders.report.text import COLOURS, MARKS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.comparison.comparison import Comparison, Strength
    from flinders.fitting.result import Fit

TITLES: Final = {"agree": ("AGREE", "HOLDS"), "differ": ("DIFFER", "IS OFF"), "contradict": ("CONTRADICT", "FAILS")}
"""Of two calibrations, and of one on another recording."""

TURNED: Final = (
    "their rotations into the body differ by more than chance explains: the sensor was turned in its mounting, or an "
    "instrument beside it"
)

UNTOLD: Final = "NO CHECK"
"""Of a calibration that agrees with its own recording."""


def page(
    comparison: Comparison,
    *,
    fresh: Fit | None = None,
    strengths: tuple[Strength, Strength] | None = None,
    own: Sequence[str] = (),
) -> RenderableType:
    """Lay out a comparison for a rich console.

    Parameters
    ----------
    comparison : Comparison
    fresh : Fit, optional
        Of the recording that a calibration is checked on: what limits it is said below.
    strengths : pair of Strength, optional
        Of that recording, under the calibration and under the fresh fit.
    own : sequence of str
        Names of the recordings, if any, that went into the calibration: agreement with those proves nothing.
    """
    from rich.console import Group

    parts: list[RenderableType] = ["", _angles(comparison), "", _numbers(comparison), ""]
    if strengths is not None:
        parts += [_strengths(*strengths), ""]
    return Group(*parts, _verdict(comparison, fresh, own))


def chance(p_value: float | None) -> str:
    """Say whether chance explains a difference."""
    if p_value is None:
        return "no uncertainty is stated, so nothing is left to chance"
    told = f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"
    return f"{'no more' if p_value >= CHANCE else 'more'} than chance explains ({told})"


def _table(*headings: str) -> Table:
    """Lay out a table as that of a fit: names to the left, numbers to the right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column(headings[0])
    for heading in headings[1:]:
        table.add_column(heading, justify="right")
    return table


def _angles(comparison: Comparison) -> RenderableType:
    found, claimed = comparison.heading_difference_deg, comparison.claimed_deg
    table = _table("difference", "rms", "worst", "mean")
    mean = f"{round(comparison.heading_mean_deg, 2) + 0.0:.2f}°"
    table.add_row("heading", _angle(found.rms), _angle(found.worst), mean, style="bold")
    if claimed is not None:
        table.add_row("  claimed, 1 σ", degrees(claimed.rms), degrees(claimed.worst), "")
    table.add_row("direction", _angle(comparison.direction_difference_deg), "", "")
    if (rotation := comparison.rotation) is not None:
        table.add_row("rotation in the body", _angle(rotation.angle_deg), "", "")
        if rotation.angle_sigma_deg is not None:
            table.add_row("  claimed, 1 σ", degrees(rotation.angle_sigma_deg), "", "")
    return table


def _numbers(comparison: Comparison) -> RenderableType:
    from rich.text import Text

    sigmas = (0.0, 0.0, 0.0) if comparison.offset_sigma is None else comparison.offset_sigma
    pairs = zip(comparison.offset_difference + 0.0, sigmas, strict=True)
    parts = "   ".join(with_uncertainty(*pair) for pair in pairs)
    scale = "" if comparison.is_scale_known else "   of sensor and field together"
    text = Text(no_wrap=True, overflow="ignore")
    text.append("offset   ", "dim").append(parts).append(
        f"   {label(comparison.unit)}, {_share(comparison.offset_share)} of the field\n", "dim"
    )
    text.append("scale    ", "dim").append(_share(comparison.scale_difference)).append(scale, "dim")
    return text


def _strengths(known: Strength, fresh: Strength) -> RenderableType:
    table = _table("corrected with", "strength", "spread")
    for name, strength in (("the calibration", known), ("a fresh fit", fresh)):
        table.add_row(name, figures(strength.mean, 4), _share(strength.spread))
    return table


def _verdict(comparison: Comparison, fresh: Fit | None, own: Sequence[str]) -> RenderableType:
    """Say what to make of it, what it rests on, and what limits it."""
    from rich.table import Table
    from rich.text import Text

    limits = [] if fresh is None else [finding.advice for finding in fresh.findings if finding.severity == "limits"]
    firm = comparison.is_telling and not limits and not own and not comparison.is_turned
    colour = {"agree": "good" if firm else "limited", "differ": "limited", "contradict": "refused"}[comparison.verdict]
    basis = f"held level, dip {abs(comparison.heading_difference_deg.dip_deg):g}°"
    if comparison.chi_square is not None:
        square = f"= {comparison.chi_square:.3g}" if comparison.chi_square < 1000.0 else "> 1000"
        basis += f"; χ² {square} for {comparison.freedom} degrees of freedom"
    if comparison.left_out_deg is not None:
        basis += f"; the rotation into the body of {degrees(comparison.left_out_deg)}, known to one alone, is left out"
    if fresh is not None:
        basis += f"; {counted(fresh.samples, 'reading')}, {fresh.coverage.fraction:.0%} of the sphere seen"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    untold = bool(own) and comparison.verdict == "agree"
    title = UNTOLD if untold else TITLES[comparison.verdict][fresh is not None]
    words = "a calibration fits its own readings, however the sensor has changed: this proves nothing"
    grid.add_row(Text(title, f"bold {COLOURS[colour]}"), words if untold else _words(comparison, limited=bool(limits)))
    grid.add_row("", Text(basis, "dim"))
    if own:
        limits.insert(0, f"{' and '.join(own)} went into this calibration: check it on a recording made since")
    if comparison.is_turned:
        limits.insert(0, TURNED)
    mark, style = MARKS["limits"]
    for limit in limits:
        grid.add_row(Text(f"  {mark}".rjust(len(title)), style=style), limit)
    return grid


def _words(comparison: Comparison, *, limited: bool) -> str:
    told, target = chance(comparison.p_value), f"{comparison.target_deg:g}°"
    worst = _angle(comparison.heading_difference_deg.worst)
    if comparison.verdict == "agree":
        vague = "" if comparison.is_telling else f"; but they claim too little to tell {target}: record for longer"
        limits = ", with these limits of the recording:" if limited else ""
        if comparison.p_value is None:
            return "the same calibration twice"
        return f"heading within {worst}, {told}{vague}{limits}"
    side, advice = {
        "differ": ("less", "good enough for that, and a new calibration will be better"),
        "contradict": ("more", "the sensor or what is near it has changed, calibrate again"),
    }[comparison.verdict]
    return f"headings up to {worst} apart, {side} than the target of {target} and {told}: {advice}"


def _angle(angle: float) -> str:
    """Write an angle, without the digits of rounding errors."""
    return degrees(angle) if angle > 1e-6 else "0°"


def _share(share: float) -> str:
    """Write a fraction as a percentage.

    >>> _share(0.00126), _share(-0.00001), _share(0.2), _share(float("inf"))
    ('0.13%', '0.00%', '20%', '> 1000%')
    """
    if not abs(share) < 10.0:
        return "> 1000%"
    decimals = 2 if abs(share) < 0.1 else 0
    return f"{round(share, decimals + 2) + 0.0:.{decimals}%}"
