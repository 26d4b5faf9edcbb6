"""Page of the terminal for a run: counts, verdicts, and the recordings that are not good with remedies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.apps.fleet.merging import common_findings
from flinders.errors import count_text, figures, percent
from flinders.findings.row import TUMBLE_CONDITIONS
from flinders.report.terminal import COLOURS, facts, page, style_cells, table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import RenderableType

    from flinders.apps.fleet.alerts import Alert
    from flinders.apps.fleet.job import RunSummary
    from flinders.apps.fleet.not_good import NotGood

SUFFIXES: Final = {"none": "without an ending"}
"""Words for kinds of files that have no suffix."""
MAX_SHOWN: Final = 20
"""Largest number of recordings that are not good, or of alerts, on the page; the tables have all."""
MAX_FINDINGS: Final = 8
"""Largest number of findings that the page counts."""


def of_run(summary: RunSummary, listed_in: str) -> RenderableType:
    """Lay out a run: counts, verdicts, recordings that are not good with remedies, and findings.

    `listed_in`: the file with all recordings that are not good or, for an extended table, with all alerts.
    """
    common = common_findings(summary.findings, summary.verdicts)
    others = {code: count for code, count in summary.findings.items() if code not in common}
    tables = [_run_list(summary, listed_in)] if summary.not_good or summary.alerts else []
    if others:
        frequent = [(code, f"{count:,}") for code, count in list(others.items())[:MAX_FINDINGS]]
        rest = [(f"and {len(others) - MAX_FINDINGS} more", "")] * (len(others) > MAX_FINDINGS)
        tables.append(table(("findings", "recordings"), [*frequent, *rest]))
    remarks = [f"true of each calibration: {', '.join(common)}"] if common else []
    return page(Group(_read(summary), of_verdicts(summary.verdicts)), *tables, Group(*remarks, *_remarks(summary)))


def _read(summary: RunSummary) -> str:
    """Numbers of files, units, recordings and readings."""
    content = (
        count_text(summary.units, "unit"),
        count_text(summary.rows, "recording"),
        count_text(summary.readings, "reading"),
    )
    files = count_text(summary.files, "new file" if summary.is_extended else "file")
    return f"{files}{'; in the table' if summary.is_extended else ''}: {', '.join(content)}"


def of_verdicts(verdicts: Mapping[str, int]) -> RenderableType:
    """Line with the share of recordings of each verdict."""
    total = sum(verdicts.values())
    line = Text()
    for place, (verdict, count) in enumerate(verdicts.items()):
        words = f"{percent(count, total)} {verdict}"
        line.append(", " if place else "").append(words, "bold " * (not place) + COLOURS[verdict])
    return line


def _run_list(summary: RunSummary, listed_in: str) -> RenderableType:
    """Recordings that are not good; for an extended table, alerts since the last run."""
    if summary.is_extended and not summary.alerts:
        return "nothing crossed a limit since the last run"
    if summary.is_extended:
        return cause_list("since the last run", summary.alerts, len(summary.alerts), listed_in)
    bad = sum(summary.verdicts.values()) - summary.verdicts.get("good", 0)
    return cause_list("not good", summary.not_good, bad, listed_in)


def cause_list(title: str, every: Sequence[Alert | NotGood], total: int, listed_in: str) -> RenderableType:
    """List the first of `total` recordings with the cause of each, then the remedy for each cause.

    `listed_in`: the file that lists all of them.
    """
    shown = [(row, row.cause or getattr(row, "alert", "")) for row in every[:MAX_SHOWN]]
    rows = [
        (
            *style_cells(COLOURS[row.verdict], row.unit, row.recording, row.verdict),
            cause,
            _number_and_limit(row.number, row.limit),
        )
        for row, cause in shown
    ]
    names = (Column(title, overflow="fold"), Column("recording", overflow="fold"))
    columns = [*names, *(Column(each, no_wrap=True) for each in ("verdict", "because"))]
    remedies = dict.fromkeys((cause, row.remedy) for row, cause in shown if row.remedy)
    more = [f"and {total - MAX_SHOWN:,} more: {listed_in} has them all"] if total > MAX_SHOWN else []
    return Group(table((*columns, "number / limit"), rows), *more, "", facts(list(remedies)))


def _number_and_limit(number: float, limit: float) -> str:
    """A number and its limit; empty if the number is not known."""
    if math.isnan(number):
        return ""
    return figures(number) if math.isnan(limit) else f"{figures(number)} / {figures(limit)}"


def _remarks(summary: RunSummary) -> list[str]:
    """Further lines of the page."""
    lines = []
    if summary.worst_deg:
        middle, most, largest = (figures(summary.worst_deg[name]) for name in ("median", "p95", "largest"))
        lines.append(f"worst heading error: median {middle}°, 95% below {most}°, largest {largest}° (1 σ)")
    if summary.verdicts.get("good"):
        lines.append(f"good {TUMBLE_CONDITIONS}")
    if summary.failed_readings:
        lines.append(f"readings of recordings that failed: {summary.failed_readings:,} of {summary.readings:,}")
    if len(summary.units_of_field) > 1:
        units = ", ".join(f"{count:,} in {unit}" for unit, count in summary.units_of_field.items())
        lines.append(f"units of field differ: {units}; offsets are in the unit of their row")
    if summary.other_files:
        kinds = ", ".join(f"{SUFFIXES.get(kind, kind)} ({count:,})" for kind, count in summary.other_files.items())
        lines.append(f"left out files that are no recordings: {kinds}")
    return lines + _remarks_on_run(summary)


def _remarks_on_run(summary: RunSummary) -> list[str]:
    """Lines about files of earlier runs, resumed partitions and lost workers."""
    lines = []
    if summary.files_changed or summary.files_vanished:
        changed, gone = count_text(summary.files_changed, "file"), summary.files_vanished
        lines.append(f"since they were fitted {changed} changed and {gone:,} vanished: the table has a row for each")
    if summary.files_later:
        lines.append(
            f"{count_text(summary.files_later, 'file')} came since the run that this one finished: run it again"
        )
    if summary.resumed:
        lines.append(f"{summary.resumed:,} of {count_text(summary.partitions, 'partition')} were done before")
    if summary.workers_lost or summary.retried:
        again = f"{count_text(summary.retried, 'partition')} {'was' if summary.retried == 1 else 'were'} done again"
        lines.append(f"{count_text(summary.workers_lost, 'worker')} died or left; {again}")
    return lines
