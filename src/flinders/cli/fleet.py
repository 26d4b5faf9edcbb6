"""``flinders fleet``: recordings of many units in, one table of calibrations out."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli._output import print_result, say
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.fleet.progress import ProgressCallback


class FleetReading(option.Group):
    """How recordings are read, and how their fits are judged: `flinders.fleet.dataset.Options`."""

    unit_column: str | None = option.member(
        "--unit-column", metavar="NAME", help="Of tables: which column says whose reading a row is."
    )
    recording_column: str | None = option.member(
        "--recording-column", heading=option.RECORDING, metavar="NAME",
        help="Of tables: which column says of which recording it is.",
    )  # fmt: skip
    batch_column: str | None = option.member(
        "--batch-column", heading=option.RECORDING, metavar="NAME",
        help="Of tables: which column says of which batch of hardware it is.",
    )  # fmt: skip
    columns: str | None = option.same_as(option.ReadingOptions, "columns")
    unit: str | None = option.same_as(option.ReadingOptions, "unit")
    scale: float | None = option.same_as(option.ReadingOptions, "scale")
    axes: str = option.same_as(option.ReadingOptions, "axes")
    as_logged: bool = option.same_as(option.ReadingOptions, "as_logged")
    sensor: str | None = option.sensor()
    target_deg: float = option.target()
    dip_deg: float = option.dip(default=60.0)


class Fleet(option.Group):
    """Recordings of many units, how they are worked on, and what is written."""

    source: str = option.argument("INPUT")
    out: str = option.member(
        "-o", "--out", required=True, metavar="FILE.parquet",
        help="The table to write, also to s3://, gs:// or az://.",
    )  # fmt: skip
    report: str | None = option.member("--report", metavar="FILE.html", help="Also write a report of the whole fleet.")
    workers: int | None = option.member(
        "--workers", heading=option.METHOD, type=click.IntRange(0, 4096), metavar="N",
        help="Processes [default: one for each core].",
    )  # fmt: skip
    scheduler: str | None = option.member(
        "--scheduler", heading=option.METHOD, metavar="tcp://…", help="Work on this Dask cluster instead."
    )
    resume: bool = option.member("--resume", is_flag=True, help="Go on with what a run that was stopped has left.")
    moments_only: bool = option.member("--moments-only", is_flag=True, hidden=True)
    log_file: str | None = option.member(
        "--log", heading=option.OUTPUT, metavar="FILE",
        help="Add a line of JSON for each thing that happens to this file.",
    )  # fmt: skip
    reading: FleetReading = option.group(FleetReading)
    force: bool = option.force()
    as_json: bool = option.as_json()

    def check(self) -> None:
        """Find what could not be done, or written, before anything is read.

        Raises
        ------
        UsageError, OutputError
        """
        from flinders.core.files import refuse_existing
        from flinders.fleet.storage import is_remote

        if self.workers is not None and self.scheduler is not None:
            raise UsageError("--workers are processes of this machine, --scheduler has its own: leave one of them out")
        paths = [path for path in (self.out, self.report, self.log_file) if path is not None]
        if len({path if is_remote(path) else os.path.realpath(path) for path in paths}) < len(paths):
            raise UsageError("--out, --report and --log are files of their own: give each another name")
        if self.report is not None:
            refuse_existing(self.report, force=self.force)
        if self.moments_only:
            say("--moments-only does nothing any more, as fits of all readings take less time now: leave it out")


@option.command_of(
    "fleet",
    Fleet,
    common=("out", "report", "unit_column", "columns", "unit", "resume"),
    short_help="Calibrate many units at once: one table out.",
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
    from flinders.fleet.dataset import Options
    from flinders.fleet.job import run
    from flinders.fleet.progress import log_to, page

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
    print_result(summary.as_dict, lambda: page(summary), as_json=options.as_json)
    if options.report is not None:
        _write_report(options.out, options.report, force=options.force)
    duration = f" in {summary.seconds:.1f} s" if sys.stderr.isatty() else ""
    say(f"written to {options.out}{duration}")
    return GOOD if summary.is_whole else LIMITED


def _write_report(out: str, report: str, *, force: bool) -> None:
    """Write the report of a fleet."""
    from flinders.core.files import write_text
    from flinders.fleet.aggregate import overview_of
    from flinders.fleet.storage import StoredFile, fetched
    from flinders.report.fleet import page

    with fetched(StoredFile(out, out, 0)) as table:
        write_text(page(overview_of([table])), report, force=force)
    say(f"report written to {report}")


@contextlib.contextmanager
def _progress() -> Iterator[ProgressCallback | None]:
    """A bar on stderr with recordings, how many a second, their units, and the time left; only on a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.fields[state]}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("", total=None, state="looking at what is there")

        def update(done: int, total: int, rows: int, units: int | None) -> None:
            elapsed = shown.tasks[0].elapsed or 0.0
            of_units = "" if units is None else f" of {counted(units, 'unit')}"
            rate = f", {rows / elapsed:,.0f} a second" if elapsed else ""
            shown.update(task, completed=done, total=total, state=f"{counted(rows, 'recording')}{of_units}{rate}")

        yield update
