"""Several magnetometers calibrated together as a page for the terminal: a row each, and what the others tell of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import counted, figures
from flinders.fitting.result import Fit, Refused
from flinders.report.formatting import degrees
from flinders.report.info import written_time
from flinders.report.text import COLOURS, MARKS

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.comparison.multi_sensor import Member, Together
    from flinders.errors import FlindersError
    from flinders.findings import Verdict


def page(found: Together, target_deg: float) -> RenderableType:
    """Lay out magnetometers that were calibrated together.

    Parameters
    ----------
    found : Together
    target_deg : float
        Worst heading error that is good enough.
    """
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="", padding=(0, 1))
    table.add_column("\n")
    table.add_column("\nmagnetometer", overflow="fold", min_width=12)
    for heading in ("heading\nalone", "\ntogether", f"axes of\n{found.reference}", "\nbut for", "\noff by"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("\nverdict")
    for number, member in enumerate(found.members, 1):
        verdict = verdict_of(member.fit)
        table.add_row(
            str(number), member.name, _error(member.alone), _error(member.fit), *_placed(found, member),
            Text(verdict, COLOURS[verdict]),
        )  # fmt: skip
    basis = f"heading: the worst error, 1 σ, held level; the target is {target_deg:g}°"
    return Group("", table, "", _reasons(found), Text(f"{_agreed(found)}\n{basis}", "dim"))


def verdict_of(outcome: Fit | FlindersError) -> Verdict:
    """That of a fit; ``refused`` where there is none."""
    return outcome.verdict if isinstance(outcome, Fit) else "refused"


def _error(outcome: Fit | FlindersError) -> str:
    """Worst heading error, of what is refused too, since it says how far it is from being of use."""
    fit = outcome.fit if isinstance(outcome, Refused) else outcome
    return degrees(fit.heading_error_deg.worst) if isinstance(fit, Fit) else "–"


def _placed(found: Together, member: Member) -> tuple[str, str, str]:
    """Which axes it has, how far it is off them, and what its readings are usually off."""
    if member.rotation is None:
        return "", "", ""
    off = "" if member.name == found.reference else f"{member.off_axes_deg:.1f}°"
    if off and member.rotation_sigma_deg is not None:
        off = f"{member.off_axes_deg:.1f} ± {figures(float(member.rotation_sigma_deg.max()), 1)}°"
    return member.axes, off, degrees(member.scatter_deg) if member.scatter_deg else ""


def _reasons(found: Together) -> RenderableType:
    """What limits each: what the others tell of it first."""
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 1))
    for number, member in enumerate(found.members, 1):
        fit = member.fit.fit if isinstance(member.fit, Refused) else member.fit
        if not isinstance(fit, Fit):
            grid.add_row(Text("  ✗", style="red"), Text(f"{number} {fit}"))
            continue
        graver = [finding for finding in fit.findings if finding.severity != "note" and finding not in member.findings]
        told = [finding for finding in member.findings if finding.code != "turned-to"]
        for finding in (*told, *graver[:1]):
            mark, style = MARKS[finding.severity]
            grid.add_row(Text(f"  {mark}", style=style), Text(f"{number} {finding.advice}"))
    return grid


def _agreed(found: Together) -> str:
    """Over how long they were held against each other."""
    over = f"{counted(found.agreement.moments, 'moment')} common to two or more"
    seconds = f", over {written_time(found.agreement.seconds)}" if found.agreement.seconds else ""
    axes = "of gyro and accelerometer" if found.in_body else f"of {found.reference}"
    own = [member.name for member in found.members if member.is_kept]
    but = f", those of {' and '.join(own)} in their own" if own else ""
    corrected = f"corrected readings are in the axes {axes}{but}\n" if found.is_joint else ""
    return f"{corrected}{over}{seconds}; off by: readings averaged over a second, in degrees of heading, 1 σ"
