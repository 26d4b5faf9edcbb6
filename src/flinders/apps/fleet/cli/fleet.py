"""``flinders fleet``: recordings of many units in, one table of calibrations out."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from typing import TYPE_CHECKING, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import console, print_result, say
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError, counted, figures, percent

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from flinders.apps.fleet.alerts import Alert
    from flinders.apps.fleet.job import RunSummary
    from flinders.apps.fleet.not_good import NotGood
    from flinders.apps.fleet.progress import ProgressCallback


class FleetReading(program.Group):
    """How recordings are read, and how their fits are judged: `flinders.apps.fleet.options.Options`."""

    unit_column: str | None = program.member(
        "--unit-column", metavar="NAME", help="Of tables: which column says whose reading a row is."
    )
    recording_column: str | None = program.member(
        "--recording-column", heading=program.RECORDING, metavar="NAME",
        help="Of tables: which column says of which recording it is.",
    )  # fmt: skip
    batch_column: str | None = program.member(
        "--batch-column", heading=program.RECORDING, metavar="NAME",
        help="Of tables: which column says of which batch of hardware it is.",
    )  # fmt: skip
    columns: str | None = program.same_as(option.ReadingOptions, "columns")
    unit: str | None = program.same_as(option.ReadingOptions, "unit")
    scale: float | None = program.same_as(option.ReadingOptions, "scale")
    axes: str = program.same_as(option.ReadingOptions, "axes")
    as_logged: bool = program.same_as(option.ReadingOptions, "as_logged")
    sensor: str | None = option.sensor(
        "Which magnetometer of several, by number or name [default: all, as units of their own]."
    )
    target_deg: float = option.target()
    dip_deg: float = option.dip(default=60.0)


class Fleet(program.Group):
    """Recordings of many units, how they are worked on, and what is written."""

    source: str = program.argument("INPUT")
    out: str = program.member(
        "-o", "--out", required=True, metavar="FILE.parquet",
        help="The table to write, also as CSV, or to s3://, gs:// or az://.",
    )  # fmt: skip
    append: bool = program.member(
        "--append", is_flag=True,
        help="Go on with what is there: fit new recordings alone, also after a run that was stopped.",
    )  # fmt: skip
    bad: str | None = program.member(
        "--bad", metavar="FILE.csv", help="Also write a table of all units that are not good, and why."
    )
    report: str | None = program.member("--report", metavar="FILE.html", help="Also write a report of the whole fleet.")
    alerts: str | None = program.member(
        "--alerts", heading=program.OUTPUT, metavar="FILE.csv",
        help="With --append, also write a table of what crossed a limit since the last run.",
    )  # fmt: skip
    properties: str | None = program.member(
        "--properties", heading=program.RECORDING, metavar="FILE.csv",
        help="Firmware, revision, place and so on of each unit: columns that are added by its name.",
    )  # fmt: skip
    workers: int | None = program.member(
        "--workers", heading=program.METHOD, type=click.IntRange(0, 4096), metavar="N",
        help="Processes [default: one for each core].",
    )  # fmt: skip
    scheduler: str | None = program.member(
        "--scheduler", heading=program.METHOD, metavar="tcp://…", help="Work on this Dask cluster instead."
    )
    log_file: str | None = program.member(
        "--log", heading=program.OUTPUT, metavar="FILE",
        help="Add a line of JSON for each thing that happens to this file.",
    )  # fmt: skip
    reading: FleetReading = program.group(FleetReading)
    force: bool = option.force()
    as_json: bool = option.as_json()

    def check(self) -> None:
        """Find what could not be done, or written, before anything is read.

        Raises `UsageError` or `OutputError`.
        """
        from flinders.apps.fleet.storage import is_remote
        from flinders.core.files import refuse_existing

        if self.workers is not None and self.scheduler is not None:
            raise UsageError("--workers are processes of this machine, --scheduler has its own: leave one of them out")
        named = (self.out, self.bad, self.alerts, self.report, self.log_file, self.properties)
        paths = [path for path in named if path is not None]
        if len({path if is_remote(path) else os.path.realpath(path) for path in paths}) < len(paths):
            raise UsageError("each of the files that are read or written needs a name of its own: two have the same")
        if self.report is not None:
            refuse_existing(self.report, force=self.force or self.append)


@program.command_of(
    "fleet",
    Fleet,
    common=("out", "append", "bad", "report", "unit_column", "columns", "unit"),
    epilog="""\b
Example:
  flinders fleet logs/ --out calibrations.parquet --bad bad.csv --report fleet.html
  flinders fleet logs/ --out calibrations.parquet --append --alerts alerts.csv
  flinders fleet 'line-7/*.parquet' --unit-column serial --unit mG --out calibrations.parquet
  flinders fleet s3://fleet/2026/ --out s3://fleet/2026.parquet --scheduler tcp://10.0.0.1:8786

\b
Exit codes:
  0  every recording has a calibration; of a table that was extended: nothing crossed a limit
  3  written; some recordings were refused or could not be read, and say why; of a table that was extended:
     something crossed a limit since the last run
""",
)
def command(options: Fleet) -> int:
    """Calibrate all units of INPUT, and write a row for each of their recordings.

    INPUT is a folder or a pattern of logs, whose first folders or names are the units, or of Parquet and Arrow tables
    with a column of units; here, or at s3://, gs:// or az://. A recording that cannot be fitted or read is a row that
    says why. `flinders fleet at` writes the calibration of one unit.
    """
    from flinders.apps.fleet.event_log import log_to
    from flinders.apps.fleet.job import Outputs, run
    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.properties import Properties

    options.check()
    reading = options.reading
    known = None if options.properties is None else Properties.read(options.properties, reading.unit_column)
    with log_to(options.log_file), _progress() as watch:
        summary = run(
            options.source,
            Outputs(options.out, options.bad, options.alerts),
            Options(**reading.as_dict()),
            workers=options.workers,
            scheduler=options.scheduler,
            append=options.append,
            force=options.force,
            properties=known,
            watch=watch,
            notice=say,
        )
    print_result(summary.as_dict, lambda: of_run(summary, options.bad or options.out), as_json=options.as_json)
    if summary.worst_deg and not options.as_json and not program.is_typed("dip_deg"):
        say(f"heading errors are for a dip of {reading.dip_deg:g}° (assumed): give that of the site by --dip")
    if options.report is not None:
        _write_report(options.out, options.report, force=options.force or options.append)
    for path, what in ((options.bad, "units that are not good"), (options.alerts, "alerts")):
        if path is not None:
            say(f"{what} are in {path}")
    duration = f" in {summary.seconds:.1f} s" if sys.stderr.isatty() else ""
    say(f"written to {options.out}{duration}")
    return GOOD if summary.is_whole else LIMITED


def _write_report(out: str, report: str, *, force: bool) -> None:
    """Write the report of a fleet."""
    from flinders.apps.fleet.aggregate import overview_of
    from flinders.apps.fleet.report import page
    from flinders.apps.fleet.storage import StoredFile, fetched
    from flinders.core.files import write_text

    with fetched(StoredFile(out, out, 0)) as table:
        write_text(page(overview_of([table])), report, force=force)
    say(f"report written to {report}")


@contextlib.contextmanager
def _progress() -> Iterator[ProgressCallback | None]:
    """A bar on stderr with recordings, how many a second, and the time left; only on a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.fields[state]}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(), transient=True) as shown:
        task = shown.add_task("", total=None, state="looking at what is there")

        def update(done: int, total: int, rows: int) -> None:
            elapsed = shown.tasks[0].elapsed or 0.0
            rate = f", {rows / elapsed:,.0f} a second" if elapsed else ""
            shown.update(task, completed=done, total=total, state=f"{counted(rows, 'recording')}{rate}")

        yield update


# ----------------------------------------------------------------------------------------------------------------- page

SUFFIXES: Final = {"none": "without an ending"}
"""Words for kinds of files that are not their suffix."""
SHOWN: Final = 20
"""Recordings that are not good, and alerts, that the page lists; the tables have them all."""
FREQUENT: Final = 8
"""Findings that the page counts."""


def of_run(summary: RunSummary, listed_in: str) -> RenderableType:
    """Lay out a run: what was read, how many are good, which are not and what to do, and findings.

    `listed_in`: the file with all that are not good.
    """
    from rich.console import Group

    from flinders.apps.fleet.merging import common_findings
    from flinders.report.terminal import page, table

    common = common_findings(summary.findings, summary.verdicts)
    others = {code: count for code, count in summary.findings.items() if code not in common}
    tables = [_listed(summary, listed_in)] if summary.not_good or summary.alerts else []
    if others:
        frequent = [(code, f"{count:,}") for code, count in list(others.items())[:FREQUENT]]
        rest = [(f"and {len(others) - FREQUENT} more", "")] * (len(others) > FREQUENT)
        tables.append(table(("findings", "recordings"), [*frequent, *rest]))
    remarks = [f"true of each calibration: {', '.join(common)}"] if common else []
    return page(Group(_read(summary), of_verdicts(summary.verdicts)), *tables, Group(*remarks, *_remarks(summary)))


def _read(summary: RunSummary) -> str:
    """What was read, and what the table has."""
    content = (counted(summary.units, "unit"), counted(summary.rows, "recording"), counted(summary.readings, "reading"))
    files = f"{counted(summary.files, 'new file')}; in the table" if summary.is_extended else counted(summary.files, "file")
    return f"{files}: {', '.join(content)}"


def of_verdicts(verdicts: Mapping[str, int]) -> RenderableType:
    """The line that counts good recordings, and the others."""
    from rich.text import Text

    from flinders.report.terminal import COLOURS

    total = sum(verdicts.values())
    line = Text()
    for place, (verdict, count) in enumerate(verdicts.items()):
        words = f"{percent(count, total)} {verdict}"
        line.append(", " if place else "").append(words, "bold " * (not place) + COLOURS[verdict])
    return line


def _listed(summary: RunSummary, listed_in: str) -> RenderableType:
    """Recordings that are not good, or what crossed a limit since the last run: why, and what to do."""
    from rich.console import Group
    from rich.table import Column

    from flinders.report.terminal import COLOURS, facts, page, styled, table

    every: Sequence[Alert | NotGood] = summary.alerts if summary.is_extended else summary.not_good
    total = len(every) if summary.is_extended else sum(summary.verdicts.values()) - summary.verdicts.get("good", 0)
    shown = [(row, getattr(row, "alert", row.cause) if not row.cause else row.cause) for row in every[:SHOWN]]
    rows = [
        (*styled(COLOURS[row.verdict], row.unit, row.recording, row.verdict), cause, _compared(row.number, row.limit))
        for row, cause in shown
    ]
    title = "since the last run" if summary.is_extended else "not good"
    names = (Column(title, overflow="fold"), Column("recording", overflow="fold"), "verdict", "because")
    columns = [Column(each, no_wrap=True) if isinstance(each, str) else each for each in names]
    remedies = dict.fromkeys((cause, row.remedy) for row, cause in shown)
    more = [f"and {total - SHOWN:,} more: {listed_in} has them all"] if total > SHOWN else []
    return page(Group(table((*columns, "number / limit"), rows), *more), facts(list(remedies)))


def _compared(number: float, limit: float) -> str:
    """A number and the limit that it was compared with; nothing where there is none."""
    if math.isnan(number):
        return ""
    return figures(number) if math.isnan(limit) else f"{figures(number)} / {figures(limit)}"


def _remarks(summary: RunSummary) -> list[str]:
    """Further lines of the page."""
    from flinders.findings.row import TUMBLE_STATED

    lines = []
    if summary.worst_deg:
        middle, most, largest = (figures(summary.worst_deg[name]) for name in ("median", "p95", "largest"))
        lines.append(f"worst heading error: median {middle}°, 95% below {most}°, largest {largest}° (1 σ)")
    if summary.verdicts.get("good"):
        lines.append(f"good {TUMBLE_STATED}")
    if summary.failed_readings:
        lines.append(f"readings of recordings that failed: {summary.failed_readings:,} of {summary.readings:,}")
    if len(summary.units_of_field) > 1:
        units = ", ".join(f"{count:,} in {unit}" for unit, count in summary.units_of_field.items())
        lines.append(f"units of field differ: {units}; offsets are in the unit of their row")
    if summary.other_files:
        kinds = ", ".join(f"{count:,} {SUFFIXES.get(kind, kind)}" for kind, count in summary.other_files.items())
        lines.append(f"left out files that are no recordings: {kinds}")
    return lines + _remarks_on_run(summary)


def _remarks_on_run(summary: RunSummary) -> list[str]:
    """Lines about files that were read before, and how the run went."""
    lines = []
    if summary.files_changed or summary.files_vanished:
        changed, gone = counted(summary.files_changed, "file"), summary.files_vanished
        lines.append(f"since they were fitted {changed} changed and {gone:,} vanished: rows say which")
    if summary.files_later:
        lines.append(f"{counted(summary.files_later, 'file')} came since the run that this one finished: run it again")
    if summary.resumed:
        lines.append(f"{summary.resumed:,} of {counted(summary.partitions, 'partition')} were done before")
    if summary.workers_lost or summary.retried:
        again = f"{counted(summary.retried, 'partition')} {'was' if summary.retried == 1 else 'were'} done again"
        lines.append(f"{counted(summary.workers_lost, 'worker')} died or left; {again}")
    return lines
