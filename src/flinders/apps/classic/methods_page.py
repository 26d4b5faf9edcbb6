"""All methods on one recording, as a page of the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.core.units import unit_label
from flinders.errors import count_text
from flinders.findings import VERDICTS
from flinders.geometry.ellipsoid import upper_entries
from flinders.report.formatting import (
    OFFSET_RESOLUTION,
    align_points,
)
from flinders.report.terminal import COLOURS, notes, page, table, whole_columns

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from flinders.apps.classic.methods import Contest, Entry
    from flinders.core.calibration import Calibration
    from flinders.findings import Severity, Verdict


def of_contest(contest: Contest) -> RenderableType:
    """Lay out all methods on one recording: errors, calibrations, and reasons against trusting some.

    Refused calibrations are shown dim, for comparison with a spreadsheet or a paper; nothing is written.
    """
    entries = [entry for entry in contest.entries if entry.fit is not None]
    result = _method_numbers(entries) if entries else None
    return page(Group(_worth(contest), _basis(contest)), result, notes(_reasons(contest)))


def _worth(contest: Contest) -> Table:
    """Table of rms heading errors of each method: claimed, cross-validated, and relative to the first method."""
    names = ("\nclaimed", "cross-\nvalidated", f"from\n{contest.reference}", "\ntime", "\nverdict")
    headings = [Column("heading error,\nrms", no_wrap=True), *whole_columns(names)]
    return table(headings, [_method_row(entry) for entry in contest.entries])


def _method_row(entry: Entry) -> tuple[RenderableType, ...]:
    method, *cells, verdict = entry.cells
    return Text(method, "bold" if entry.verdict == "good" else ""), *cells, Text(verdict, COLOURS[entry.verdict])


def _basis(contest: Contest) -> Text:
    blocks = f"{contest.blocks} blocks of time, each held back once" if contest.blocks else "too few to hold any back"
    if contest.stride > 1:
        blocks = f"cross-validated on one of {contest.stride}: {blocks}"
    return Text(f"{count_text(contest.readings, 'reading')}; {blocks}", "dim")


def _method_numbers(entries: list[Entry]) -> Text:
    """Offset and upper triangle of the matrix of each method, one line for each."""
    calibrations = [entry.fit.calibration for entry in entries if entry.fit is not None]
    columns = [align_points(list(column)) for column in zip(*map(_entries, calibrations), strict=True)]
    rows = [(" ".join(cells[:3]), " ".join(cells[3:])) for cells in zip(*columns, strict=True)]
    width, (offset, matrix) = max(len(entry.method) for entry in entries), rows[0]
    title = f"offset, {unit_label(calibrations[0].unit)}".ljust(len(offset)) + "   "
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"{'':{width}}  {title}{'matrix: xx yy zz xy xz yz'.ljust(len(matrix))}\n", "dim")
    for entry, row in zip(entries, rows, strict=True):
        text.append(f"{entry.method:{width}}  {'   '.join(row)}\n", "dim" if entry.verdict == "refused" else "")
    text.rstrip()
    return text


def _entries(calibration: Calibration) -> list[str]:
    decimals = max(0, -math.floor(math.log10(OFFSET_RESOLUTION * calibration.field_strength)))
    offset = [f"{round(value, decimals) + 0.0:.{decimals}f}" for value in calibration.offset.tolist()]
    return [*offset, *(f"{value:.4f}" for value in upper_entries(calibration.matrix).tolist())]


def _reasons(contest: Contest) -> list[tuple[str, str]]:
    """Notes on methods that cannot be trusted, each a severity and a text; methods with equal reasons share a note.

    The text has the gravest reason in words, and the codes of further reasons.
    """
    said: dict[str, list[Entry]] = {}
    for entry in contest.entries:
        if entry.reasons:
            also = f" (also {', '.join(entry.codes[1:])})" if len(entry.codes) > 1 else ""
            said.setdefault(entry.reasons[0].replace(repr(entry.method), "it") + also, []).append(entry)
    return [
        (_SEVERITIES[entries[0].verdict], f"{', '.join(entry.method for entry in entries)}: {reason}")
        for reason, entries in said.items()
    ]


_SEVERITIES: Final[dict[Verdict, Severity]] = {verdict: severity for severity, verdict in VERDICTS.items()}
