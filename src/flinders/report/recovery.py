"""A swung two-axis compass as a page for the terminal: what is true, what was found, and the headings before and after.

>>> from flinders.simulate import TwoAxis
>>> [name for name, *_ in rows(TwoAxis(), TwoAxis())]
['scale x', 'scale y', 'offset x', 'offset y', 'skew', 'noise']
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.report.formatting import degrees

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.simulate.two_axis import Polar, TwoAxis


def rows(true: TwoAxis, found: TwoAxis) -> list[tuple[str, float, float, str]]:
    """Name, true value, found value and unit of each parameter."""
    return [
        ("scale x", true.scale[0], found.scale[0], ""),
        ("scale y", true.scale[1], found.scale[1], ""),
        ("offset x", true.offset[0], found.offset[0], " µT"),
        ("offset y", true.offset[1], found.offset[1], " µT"),
        ("skew", true.skew_deg, found.skew_deg, "°"),
        ("noise", true.noise, found.noise, " µT"),
    ]


def page(true: TwoAxis, found: TwoAxis, polar: Polar) -> RenderableType:
    """Lay out a recovery for a rich console."""
    from rich import box
    from rich.console import Group
    from rich.table import Table

    recovery = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    headings = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    for table, names in (
        (recovery, ("parameter", "true", "found", "error")),
        (headings, ("heading", "error, rms", "worst", "radius")),
    ):
        table.add_column(names[0])
        for name in names[1:]:
            table.add_column(name, justify="right")
    for name, expected, value, unit in rows(true, found):
        error = round(value - expected, 4) + 0.0
        recovery.add_row(name, *(f"{number:.4f}{unit}" for number in (expected, value)), f"{error:+.4f}{unit}")
    headings.add_row("raw", *_cells(polar.raw_error_deg, polar.raw_radius))
    headings.add_row("corrected", *_cells(polar.corrected_error_deg, polar.corrected_radius))
    return Group("", recovery, "", headings)


def _cells(errors: Floats, radius: Floats) -> tuple[str, str, str]:
    """Errors, rms and worst, and the range of the radius."""
    rms, worst = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
    return _angle(rms), _angle(worst), f"{radius.min():.2f} to {radius.max():.2f} µT"


def _angle(angle: float) -> str:
    """Write an angle, without the digits of rounding errors."""
    return degrees(angle) if angle > 1e-6 else "0°"
