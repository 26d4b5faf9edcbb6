"""``flinders fleet``: recordings of many units in, one table of calibrations out."""

from __future__ import annotations

import contextlib
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
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.apps.fleet.job import RunSummary
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
        help="The table to write, also to s3://, gs:// or az://.",
    )  # fmt: skip
    report: str | None = program.member("--report", metavar="FILE.html", help="Also write a report of the whole fleet.")
    workers: int | None = program.member(
        "--workers", heading=program.METHOD, type=click.IntRange(0, 4096), metavar="N",
        help="Processes [default: one for each core].",
    )  # fmt: skip
    scheduler: str | None = program.member(
        "--scheduler", heading=program.METHOD, metavar="tcp://…", help="Work on this Dask cluster instead."
    )
    resume: bool = program.member("--resume", is_flag=True, help="Go on with what a run that was stopped has left.")
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
        paths = [path for path in (self.out, self.report, self.log_file) if path is not None]
        if len({path if is_remote(path) else os.path.realpath(path) for path in paths}) < len(paths):
            raise UsageError("--out, --report and --log are files of their own: give each another name")
        if self.report is not None:
            refuse_existing(self.report, force=self.force)


@program.command_of(
    "fleet",
    Fleet,
    common=("out", "report", "unit_column", "columns", "unit", "resume"),
    epilog="""\b
Example:
  flinders fleet logs/ --out calibrations.parquet
  flinders fleet 'line-7/*.parquet' --unit-column serial --unit mG --out calibrations.parquet
  flinders fleet s3://fleet/2026/ --out s3://fleet/2026.parquet --scheduler tcp://10.0.0.1:8786
  flinders fleet logs/ --out calibrations.parquet --resume

\b
Exit codes:
  0  every recording has a calibration
  3  written; some recordings were refused or could not be read, and say why
""",
)
def command(options: Fleet) -> int:
    """Calibrate all units of INPUT, and write a row for each of their recordings.

    INPUT is a folder or a pattern of logs, whose first folders or names are the units, or of Parquet and Arrow tables
    with a column of units; here, or at s3://, gs:// or az://. A recording that cannot be fitted or read is a row that
    says why.
    """
    from flinders.apps.fleet.event_log import log_to
    from flinders.apps.fleet.job import run
    from flinders.apps.fleet.options import Options

    options.check()
    with log_to(options.log_file), _progress() as watch:
        summary = run(
            options.source,
            options.out,
            Options(**options.reading.as_dict()),
            workers=options.workers,
            scheduler=options.scheduler,
            resume=options.resume,
            force=options.force,
            watch=watch,
            notice=say,
        )
    print_result(summary.as_dict, lambda: of_run(summary), as_json=options.as_json)
    if summary.worst_deg and not options.as_json and not program.is_typed("dip_deg"):
        say(f"heading errors are for a dip of {options.reading.dip_deg:g}° (assumed): give that of the site by --dip")
    if options.report is not None:
        _write_report(options.out, options.report, force=options.force)
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
SHOWN: Final = 8
"""Codes and findings that the page lists; the table has them all."""


def of_run(summary: RunSummary) -> RenderableType:
    """Lay out a run: what was read, verdicts, why rows have no calibration, and findings."""
    from rich.console import Group
    from rich.table import Column

    from flinders.apps.fleet.merging import common_findings
    from flinders.report.terminal import COLOURS, page, styled, table

    content = (counted(summary.units, "unit"), counted(summary.rows, "recording"), counted(summary.readings, "reading"))
    verdicts = [
        styled(COLOURS[verdict], verdict, f"{count:,}", percent(count, summary.rows))
        for verdict, count in summary.verdicts.items()
    ]
    tables = [table(("verdict", "recordings", "share"), verdicts)]
    if summary.rejected:
        rows = [(row["unit"], row["recording"], row["finding"] or row["code"]) for row in summary.rejected[:SHOWN]]
        more = summary.verdicts.get("refused", 0) + summary.verdicts.get("failed", 0) - SHOWN
        rest = [(f"and {more:,} more", "", "")] * (more > 0)
        headings = ("refused or failed", Column("recording"), Column("because"))
        tables.append(table(headings, [*(styled("red", *row) for row in rows), *rest]))
    common = common_findings(summary.findings, summary.verdicts)
    others = {code: count for code, count in summary.findings.items() if code not in common}
    for title, counts in (("no calibration because", summary.codes), ("findings", others)):
        if counts:
            frequent = [(code, f"{count:,}") for code, count in list(counts.items())[:SHOWN]]
            rest_of = [(f"and {len(counts) - SHOWN} more", "")] * (len(counts) > SHOWN)
            tables.append(table((title, "recordings"), [*frequent, *rest_of]))
    remarks = [f"true of each calibration: {', '.join(common)}"] if common else []
    read = f"{counted(summary.files, 'file')}: {', '.join(content)}"
    return page(read, *tables, Group(*remarks, *_remarks(summary)))


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
    if summary.resumed:
        lines.append(f"{summary.resumed:,} of {counted(summary.partitions, 'partition')} were done before")
    if summary.workers_lost or summary.retried:
        again = f"{counted(summary.retried, 'partition')} {'was' if summary.retried == 1 else 'were'} done again"
        lines.append(f"{counted(summary.workers_lost, 'worker')} died or left; {again}")
    return lines
