"""``flinders fleet``: recordings of many units in, one table of calibrations out."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import console, print_result, say
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.apps.fleet.progress import ProgressCallback


class FleetReading(program.Group):
    """Options of reading recordings and judging their fits, as in `flinders.apps.fleet.options.Options`."""

    unit_column: str | None = program.member(
        "--unit-column", metavar="NAME", help="For tables: column with the unit of each row."
    )
    recording_column: str | None = program.member(
        "--recording-column", heading=program.RECORDING, metavar="NAME",
        help="For tables: column with the recording of each row.",
    )  # fmt: skip
    batch_column: str | None = program.member(
        "--batch-column", heading=program.RECORDING, metavar="NAME",
        help="For tables: column with the hardware batch of each row.",
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
    """Options: recordings of many units, processes, outputs."""

    source: str = program.argument("INPUT")
    out: str = program.member(
        "-o", "--output", required=True, metavar="FILE.parquet",
        help="The table to write, also as CSV, or to s3://, gs:// or az://.",
    )  # fmt: skip
    append: bool = program.member(
        "--append", is_flag=True,
        help="Extend the table with new recordings, or continue a run that was stopped.",
    )  # fmt: skip
    bad: str | None = program.member(
        "--bad", metavar="FILE.csv", help="Also write a table of all units that are not good, with the reasons."
    )
    report: str | None = program.member("--report", metavar="FILE.html", help="Also write a report of the whole fleet.")
    alerts: str | None = program.member(
        "--alerts", heading=program.OUTPUT, metavar="FILE.csv",
        help="With --append, also write a table of units and files that crossed a limit since the last run.",
    )  # fmt: skip
    properties: str | None = program.member(
        "--properties", heading=program.RECORDING, metavar="FILE.csv",
        help="Table of properties of each unit, such as firmware or revision, to add as columns.",
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
        help="Append a line of JSON to this file for each event of the run.",
    )  # fmt: skip
    reading: FleetReading = program.group(FleetReading)
    force: bool = option.force()
    as_json: bool = option.as_json()

    def check(self) -> None:
        """Refuse options that conflict, and outputs that cannot be written, before anything is read.

        Raises `UsageError` or `OutputError`.
        """
        from flinders.apps.fleet.storage import is_remote
        from flinders.apps.fleet.tables import is_csv
        from flinders.core.files import refuse_existing

        if self.workers is not None and self.scheduler is not None:
            raise UsageError("--workers are processes here, --scheduler has workers of its own: leave one of them out")
        named = (self.out, self.bad, self.alerts, self.report, self.log_file, self.properties)
        paths = [path for path in named if path is not None]
        if len({path if is_remote(path) else os.path.realpath(path) for path in paths}) < len(paths):
            raise UsageError("two of the files to read or write have the same name: give each a name of its own")
        if self.report is not None:
            if is_csv(self.out):
                raise UsageError(f"{self.out}: a report needs a Parquet table: give the table a name in .parquet")
            refuse_existing(self.report, force=self.force or self.append)


@program.command_of(
    "fleet",
    Fleet,
    common=("out", "append", "bad", "report", "unit_column", "columns", "unit"),
    epilog="""\b
Example:
  flinders fleet logs/ -o calibrations.parquet --bad bad.csv --report fleet.html
  flinders fleet logs/ -o calibrations.parquet --append --alerts alerts.csv
  flinders fleet 'line-7/*.parquet' --unit-column serial --unit mG -o calibrations.parquet
  flinders fleet s3://fleet/2026/ -o s3://fleet/2026.parquet --scheduler tcp://10.0.0.1:8786

\b
Exit codes:
  0  every recording has a calibration; for an extended table: nothing crossed a limit
  3  the table is written, but some recordings were refused or could not be read; for an extended table:
     something crossed a limit since the last run
""",
)
def command(options: Fleet) -> int:
    """Calibrate all units of INPUT, and write a row for each of their recordings.

    INPUT is a folder or a pattern of logs, whose first folders or names are the units, or of Parquet and Arrow tables
    with a column of units; here, or at s3://, gs:// or az://. A recording that cannot be fitted or read is a row with
    the reason. `flinders fleet at` writes the calibration of one unit.
    """
    from flinders.apps.fleet.job import Outputs, run
    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.progress import log_to
    from flinders.apps.fleet.properties import Properties
    from flinders.apps.fleet.run_page import of_run

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
    of_alerts = options.alerts or "the table that --alerts writes"
    listed_in = of_alerts if summary.is_extended else options.bad or options.out
    print_result(summary.as_dict, lambda: of_run(summary, listed_in), as_json=options.as_json)
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
    """Write the HTML report of a fleet's table."""
    from flinders.apps.fleet.aggregate import overview_of
    from flinders.apps.fleet.report import page
    from flinders.apps.fleet.storage import StoredFile, fetch
    from flinders.core.files import write_text

    with fetch(StoredFile(out, out, 0)) as table:
        write_text(page(overview_of([table])), report, force=force)
    say(f"report written to {report}")


@contextlib.contextmanager
def _progress() -> Iterator[ProgressCallback | None]:
    """Progress bar on stderr with recordings, their rate, and the remaining time; only on a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.fields[state]}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(), transient=True) as shown:
        task = shown.add_task("", total=None, state="listing the input")

        def update(done: int, total: int, rows: int) -> None:
            elapsed = shown.tasks[0].elapsed or 0.0
            rate = f", {rows / elapsed:,.0f} a second" if elapsed else ""
            shown.update(task, completed=done, total=total, state=f"{count_text(rows, 'recording')}{rate}")

        yield update
