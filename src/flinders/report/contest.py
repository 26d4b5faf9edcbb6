"""All methods on one recording as a page for the terminal: worth, numbers, and why some are not to be trusted.

>>> duration(0.00421), duration(12.5), duration(90)
('4.2 ms', '12 s', '90 s')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.findings import VERDICTS
from flinders.geometry.ellipsoid import upper
from flinders.report.formatting import FINEST, degrees, on_the_point
from flinders.report.text import COLOURS, MARKS

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from flinders.comparison.methods import Contest, Entry
    from flinders.core.calibration import Calibration
    from flinders.findings import Severity, Verdict
    from flinders.heading.error_propagation import HeadingError

NOTHING: Final = 1e-4
"""Degrees of heading that come from rounding alone."""


def page(contest: Contest) -> RenderableType:
    """Lay out a contest for a rich console.

    Numbers of refused calibrations are here, dim, because they are compared with those of a spreadsheet or a paper;
    nothing is written.
    """
    from rich.console import Group

    entries = [entry for entry in contest.entries if entry.fit is not None]
    found: list[RenderableType] = [_numbers(entries), ""] if entries else []
    return Group("", _worth(contest), _basis(contest), "", *found, _reasons(contest))


def duration(seconds: float) -> str:
    """Write how long something took, to two digits."""
    return f"{figures(seconds * 1e3)} ms" if seconds < 1.0 else f"{figures(seconds)} s"


def _table(*headings: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="", padding=(0, 1))
    table.add_column(headings[0], no_wrap=True)
    for heading in headings[1:]:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _worth(contest: Contest) -> RenderableType:
    """Rms heading errors of each method: claimed, cross-validated, and from the first."""
    from rich.text import Text

    table = _table(
        "heading error,\nrms", "\nclaimed", "cross-\nvalidated", f"from\n{contest.reference}", "\ntime", "\nverdict"
    )
    for entry in contest.entries:
        claimed = None if entry.fit is None else entry.fit.heading_error_deg
        shown = None if entry.validation is None else entry.validation.heading_error_deg
        table.add_row(
            Text(entry.method, "bold" if entry.verdict == "good" else ""),
            _angle(claimed),
            _angle(shown),
            _angle(entry.apart_deg),
            duration(entry.seconds),
            Text(entry.verdict, COLOURS[entry.verdict]),
        )
    return table


def _angle(error: HeadingError | None) -> str:
    if error is None:
        return "–"
    return degrees(error.rms) if error.rms > NOTHING else "0°"


def _basis(contest: Contest) -> RenderableType:
    from rich.text import Text

    blocks = f"{contest.blocks} blocks of time, each held back once" if contest.blocks else "too few to hold any back"
    if contest.stride > 1:
        blocks = f"cross-validated on one of {contest.stride}: {blocks}"
    return Text(f"{counted(contest.readings, 'reading')}; {blocks}", "dim")


def _numbers(entries: list[Entry]) -> RenderableType:
    """Offsets, and matrices as their diagonal and what is above it, one line for each method."""
    from rich.text import Text

    calibrations = [entry.fit.calibration for entry in entries if entry.fit is not None]
    columns = [on_the_point(list(column)) for column in zip(*map(_entries, calibrations), strict=True)]
    width = max(len(entry.method) for entry in entries)
    spans = [sum(len(column[0]) for column in part) + len(part) - 1 for part in (columns[:3], columns[3:])]
    unit = label(calibrations[0].unit)
    titles = f"offset, {unit}".ljust(spans[0]) + "   " + "matrix: xx yy zz xy xz yz".ljust(spans[1])
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"{'':{width}}  {titles}\n", "dim")
    for entry, *cells in zip(entries, *columns, strict=True):
        line = " ".join(cells[:3]) + "   " + " ".join(cells[3:])
        text.append(f"{entry.method:{width}}  {line}\n", "dim" if entry.verdict == "refused" else "")
    text.rstrip()
    return text


def _entries(calibration: Calibration) -> list[str]:
    decimals = max(0, -math.floor(math.log10(FINEST * calibration.field_strength)))
    offset = [f"{round(value, decimals) + 0.0:.{decimals}f}" for value in calibration.offset.tolist()]
    return [*offset, *(f"{value:.4f}" for value in upper(calibration.matrix).tolist())]


def _reasons(contest: Contest) -> RenderableType:
    """Why a method is not to be trusted here: the gravest reason in words, the others by their code; each said once."""
    from rich.table import Table
    from rich.text import Text

    said: dict[str, list[Entry]] = {}
    for entry in contest.entries:
        if entry.reasons:
            also = f" (also {', '.join(entry.codes[1:])})" if len(entry.codes) > 1 else ""
            said.setdefault(entry.reasons[0].replace(repr(entry.method), "it") + also, []).append(entry)
    grid = Table.grid(padding=(0, 1))
    for reason, entries in said.items():
        mark, style = MARKS[_SEVERITIES[entries[0].verdict]]
        names = ", ".join(entry.method for entry in entries)
        grid.add_row(Text(f"  {mark}", style=style), Text(f"{names}: {reason}"))
    return grid


_SEVERITIES: Final[dict[Verdict, Severity]] = {verdict: severity for severity, verdict in VERDICTS.items()}
