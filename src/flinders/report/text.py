"""A fit as a page for the terminal: before and after, the numbers with their uncertainty, the verdict.

>>> with_uncertainty(28.5571, 0.0432), with_uncertainty(-0.00234, 1.2)
('28.557 ± 0.043', '0.0 ± 1.2')
>>> on_the_point(["-69.788 ± 0.017", "0.911712", "12"])
['-69.788 ± 0.017', '  0.911712     ', ' 12            ']
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.fitting.verdict import OF_THE_RECORDING, UPSIDE_DOWN, movement

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.finding import Finding
    from flinders.fitting.result import Fit

COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red"}
MARKS: Final = {"refuses": ("✗", "red"), "limits": ("!", "yellow"), "note": ("·", "dim")}
FINEST: Final = 2e-4
"""Of the field: an offset that is rounded to this moves no heading by more than a fiftieth of a degree."""

DECIMALS: Final = 6
"""Most decimals of a number that is shown with its uncertainty, and those of a matrix with entries about one."""


def page(fit: Fit) -> RenderableType:
    """Lay out a fit for a rich console.

    Of a refused one no number of the calibration is shown: none can be trusted, and what stands on a screen is
    copied into a firmware sooner or later. It says why, how to do better, and what is odd about the recording.
    """
    from rich.console import Group

    if fit.verdict != "refused":
        found = numbers(fit.calibration, fit.offset_sigma, fit.noise)
        return Group("", _before_and_after(fit), "", found, "", _verdict(fit), listed(fit.findings, movement(fit)))
    reasons = [finding for finding in fit.findings if finding.severity != "note" or finding.code in OF_THE_RECORDING]
    return Group("", _verdict(fit), listed(reasons, movement(fit)))


def with_uncertainty(value: float, sigma: float, *, finest: float = math.inf) -> str:
    """Write a number to the second digit of its standard deviation, and to a multiple of `finest` at the least.

    Errors of several numbers may cancel, as those of a level turn's offset and shape do: then each of them matters to
    more digits than its own uncertainty says.

    >>> with_uncertainty(-17.0318, 15.3, finest=0.01)
    '-17.03 ± 15'
    """
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.6g}"
    if max(abs(value), sigma) >= 1e9:
        return f"{value:.6g} ± {sigma:.2g}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    if digits > DECIMALS:
        return f"{value:.{DECIMALS}f} ± {sigma:.1g}"
    more = max(digits, min(DECIMALS, math.ceil(-math.log10(finest)))) if 0.0 < finest < math.inf else digits
    shown = round(value, more) + 0.0
    return f"{shown:.{more}f} ± {sigma:.{digits}f}"


def degrees(angle: float) -> str:
    """Write an angle of error: two digits, and no more than anyone could mean.

    >>> degrees(0.0664), degrees(12.3), degrees(float("nan"))
    ('0.066°', '12°', '> 100°')
    """
    return f"{figures(angle)}°" if angle < 10 else f"{angle:.0f}°" if angle < 100 else "> 100°"


def on_the_point(numbers: Sequence[str]) -> list[str]:
    """Pad numbers so that they stand below each other at their decimal points."""
    cut = [(number, _point(number)) for number in numbers]
    before = max(point for _, point in cut)
    after = max(len(number) - point for number, point in cut)
    return [" " * (before - point) + number + " " * (after - len(number) + point) for number, point in cut]


def _point(number: str) -> int:
    """Where the decimal point of a number stands, or would stand."""
    value = number.partition(" ")[0]
    return value.find(".") if "." in value else len(value)


def _before_and_after(fit: Fit) -> RenderableType:
    from rich import box
    from rich.table import Table

    unit = label(fit.calibration.unit)
    raw, error = fit.uncorrected_heading_error_deg, fit.heading_error_deg
    strength, spread = fit.uncorrected_strength
    field = fit.calibration.field_strength
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("")
    for heading in ("strength", "spread", "heading error, rms", "worst"):
        table.add_column(heading, justify="right")
    table.add_row("before", f"{figures(strength, 4)} {unit}", f"{spread:.1%}", degrees(raw.rms), degrees(raw.worst))
    left = f"{fit.noise / fit.ellipsoid.radius:.1%}"
    table.add_row("after", f"{figures(field, 4)} {unit}", left, degrees(error.rms), degrees(error.worst), style="bold")
    return table


def numbers(calibration: Calibration, offset_sigma: Floats, noise: float | None) -> RenderableType:
    """Offset above matrix, in columns x, y and z, each on its decimal points; never cut, however narrow the page."""
    from rich.text import Text

    unit = label(calibration.unit)
    offset = [
        with_uncertainty(*pair, finest=FINEST * calibration.field_strength)
        for pair in zip(calibration.offset, offset_sigma, strict=True)
    ]
    columns = [on_the_point(column) for column in zip(offset, *matrix_entries(calibration.matrix), strict=True)]
    noise_shown = on_the_point(["?" if noise is None else figures(noise, 3), offset[0]])[0].ljust(len(columns[0][0]))
    rows = [*zip(*columns, strict=True), (noise_shown, *(" " * len(column[0]) for column in columns[1:]))]
    text = Text(no_wrap=True, overflow="ignore")
    for title, cells, ending in zip(("offset", "matrix", "", "", "noise"), rows, (unit, "", "", "", unit), strict=True):
        text.append(f"{title:6}   ", "dim").append("   ".join(cells)).append(f"   {ending}\n", "dim")
    text.rstrip()
    return text


def matrix_entries(matrix: Floats) -> list[list[str]]:
    """Write a matrix with as many decimals everywhere: seven digits of its largest entry."""
    largest = float(abs(matrix).max())
    decimals = DECIMALS - math.floor(math.log10(largest) + 1e-9)
    if not 0 <= decimals <= 2 * DECIMALS:
        return [[f"{value:.{DECIMALS}e}" for value in row.tolist()] for row in matrix]
    return [[f"{round(value, decimals) + 0.0:.{decimals}f}" for value in row.tolist()] for row in matrix]


def _verdict(fit: Fit) -> RenderableType:
    """Say what it is good for, and for whom the number holds."""
    from rich.table import Table
    from rich.text import Text

    from flinders.report.beside import mounting

    error = fit.heading_error_deg
    within = f"worst heading good to {degrees(error.worst)} (1 σ; the target is {fit.target_deg:g}°)"
    words = {
        "good": f"{within}, {reach(fit)}",
        "limited": f"{within}, with these limits:",
        "refused": "not fit for use, no calibration was written",
    }[fit.verdict]
    seen = "" if fit.is_flat or fit.plane else f", {fit.coverage.fraction:.0%} of the sphere seen"
    basis = f"{counted(fit.samples, 'reading')}{seen}; {fit.method}"
    if fit.verdict != "refused":
        basis += f"; held level, dip {error.dip_deg:.3g}°"
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    grid.add_row(Text(fit.verdict.upper(), f"bold {COLOURS[fit.verdict]}"), words)
    grid.add_row("", Text(basis, "dim"))
    if fit.verdict != "refused" and (adds := mounting(fit)):
        grid.add_row("", adds)
    return grid


def reach(fit: Fit) -> str:
    """Say up to which tilt a fit is as good as was asked for."""
    limit = fit.attitude_limit_deg
    return "at any attitude" if limit >= UPSIDE_DOWN else f"up to {limit:.0f}° of tilt"


def listed(findings: Iterable[Finding], turn: str = "") -> RenderableType:
    """Say what limits it and what to do; how to move on, which is `turn`, is said once."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 1))
    said = False
    for finding in findings:
        mark, style = MARKS[finding.severity]
        advice = finding.advice.replace(turn, "turn the sensor as above") if said else finding.advice
        said = said or bool(turn and turn in finding.advice)
        grid.add_row(Text(f"  {mark}", style=style), Text(advice, style="dim" if style == "dim" else ""))
    return grid
