"""A calibration against the truth as a page for the terminal: true errors, claimed ones, their ratio, the verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import figures
from flinders.report.comparison import chance
from flinders.report.formatting import degrees, with_uncertainty
from flinders.report.text import COLOURS

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.comparison.evaluation import Evaluation

TITLES: Final = {"as claimed": "AS CLAIMED", "worse than claimed": "WORSE THAN CLAIMED", "unclaimed": "NO CLAIM"}


def page(told: Evaluation) -> RenderableType:
    """Lay out an evaluation for a rich console."""
    from rich.console import Group

    return Group("", _angles(told), "", _numbers(told), "", _verdict(told))


def _angles(told: Evaluation) -> RenderableType:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("error")
    for name in ("rms", "worst", "claimed, rms", "worst", "true / claimed"):
        table.add_column(name, justify="right")
    heading, claimed = told.heading_error_deg, told.claimed_heading_deg
    rows = (
        ("level heading", (heading.rms, heading.worst), claimed and (claimed.rms, claimed.worst), told.heading_ratio),
        ("direction", told.freed_direction_error_deg, told.claimed_direction_deg, told.direction_ratio),
        ("  with its rotation", told.direction_error_deg, None, None),
    )
    for name, true, claims, ratio in rows:
        cells = [_angle(angle) for angle in true] + [_angle(angle) for angle in claims or ()]
        cells += [""] * (4 - len(cells)) + ["" if ratio is None else figures(ratio)]
        table.add_row(name, *cells, style="bold" if name == "level heading" else None)
    return table


def _numbers(told: Evaluation) -> RenderableType:
    from rich.text import Text

    sigmas = (0.0, 0.0, 0.0) if told.offset_sigma is None else told.offset_sigma
    parts = "   ".join(with_uncertainty(*pair) for pair in zip(told.offset_error + 0.0, sigmas, strict=True))
    ratio = "" if told.offset_ratio is None else f", {figures(told.offset_ratio)} times what is claimed"
    scale = (
        ("", "not claimed: no field strength was given") if told.scale_error is None else (_share(told.scale_error), "")
    )
    text = Text(no_wrap=True, overflow="ignore")
    for name, number, words in (
        ("offset", parts, f"   {label(told.unit)}"),
        ("", "", f"{_share(told.offset_share)} of the field{ratio}"),
        ("matrix", _share(told.matrix_error), "   rotation and scale taken off"),
        ("rotation", _angle(told.rotation_deg), "   which no magnetometer alone can see"),
        ("mean", _angle(told.heading_mean_deg), "   of the heading, taken off above: as of a turned mounting"),
        ("scale", *scale),
    ):
        text.append(f"{name:<11}", "dim").append(number).append(f"{words}\n", "dim")
    text.rstrip()
    return text


def _verdict(told: Evaluation) -> RenderableType:
    from rich.table import Table
    from rich.text import Text

    colour = "good" if told.is_on_target else "limited"
    if told.verdict == "worse than claimed":
        colour = "limited" if told.is_on_target else "refused"
    side = "within" if told.is_on_target else "beyond"
    words = (
        f"headings are off by up to {_angle(told.heading_error_deg.worst)}, {side} the target of {told.target_deg:g}°"
    )
    reasons = {
        "as claimed": f"the errors are {chance(told.p_value)}",
        "worse than claimed": f"the errors are {chance(told.p_value)}",
        "unclaimed": "the calibration states no uncertainty",
    }
    basis = f"held level, dip {told.heading_error_deg.dip_deg:g}°"
    if told.chi_square is not None:
        square = f"= {told.chi_square:.3g}" if told.chi_square < 1000.0 else "> 1000"
        basis += f"; χ² {square} for {told.freedom} degrees of freedom"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    grid.add_row(Text(TITLES[told.verdict], f"bold {COLOURS[colour]}"), f"{words}; {reasons[told.verdict]}")
    grid.add_row("", Text(basis, "dim"))
    return grid


def _angle(angle: float) -> str:
    """Write an angle, without the digits of rounding errors.

    >>> _angle(0.0321), _angle(-1.234), _angle(1e-9)
    ('0.032°', '-1.2°', '0°')
    """
    if abs(angle) <= 1e-6:
        return "0°"
    return f"{'-' if angle < 0 else ''}{degrees(abs(angle))}"


def _share(share: float) -> str:
    """Write a fraction as a percentage to two digits.

    >>> _share(0.00126), _share(0.2), _share(-0.0312), _share(1e-12), _share(12.0)
    ('0.13%', '20%', '-3.1%', '0%', '> 1000%')
    """
    if not abs(share) < 10.0:
        return "> 1000%"
    return f"{figures(100 * share)}%" if abs(share) > 1e-9 else "0%"
