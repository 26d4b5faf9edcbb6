"""A fit as a page for the terminal: before and after, the numbers with their uncertainty, the verdict.

>>> with_uncertainty(28.5571, 0.0432), with_uncertainty(-0.00234, 1.2)
('28.557 ± 0.043', '0.0 ± 1.2')
>>> on_the_point(["-69.788 ± 0.017", "0.911712", "12"])
['-69.788 ± 0.017', '  0.911712     ', ' 12            ']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.fitting.advice import UPSIDE_DOWN, movement
from flinders.fitting.verdict import OF_THE_RECORDING
from flinders.report.beside import mounting
from flinders.report.formatting import FINEST, degrees, matrix_entries, on_the_point, with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.findings import Finding
    from flinders.fitting.result import Fit

COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red"}
MARKS: Final = {"refuses": ("✗", "red"), "limits": ("!", "yellow"), "note": ("·", "dim")}


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


def _verdict(fit: Fit) -> RenderableType:
    """Say what it is good for, and for whom the number holds."""
    from rich.table import Table
    from rich.text import Text

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
