"""``flinders fleet``: recordings of many units in, one table of calibrations out."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options
from flinders.cli._options import option
from flinders.cli._output import print_json, say, show
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.fleet.progress import ProgressCallback


@_options.command(
    "fleet",
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
@click.argument("source", metavar="INPUT")
@option("-o", "--out", required=True, metavar="FILE.parquet", help="The table to write, also to s3://, gs:// or az://.")
@option("--report", metavar="FILE.html", help="Also write a report of the whole fleet.")
@option(
    "--workers",
    heading=_options.METHOD,
    type=click.IntRange(0, 4096),
    metavar="N",
    help="Processes [default: one for each core].",
)
@option("--scheduler", heading=_options.METHOD, metavar="tcp://…", help="Work on this Dask cluster instead.")
@option("--resume", is_flag=True, help="Go on with what a run that was stopped has left.")
@option(
    "--moments-only",
    heading=_options.METHOD,
    is_flag=True,
    help="Use sums alone: faster, and blind to what only readings show.",
)
@option("--unit-column", metavar="NAME", help="Of tables: which column says whose reading a row is.")
@option(
    "--recording-column",
    heading=_options.RECORDING,
    metavar="NAME",
    help="Of tables: which column says of which recording it is.",
)
@option(
    "--batch-column",
    heading=_options.RECORDING,
    metavar="NAME",
    help="Of tables: which column says of which batch of hardware it is.",
)
@option(
    "--log",
    "log_file",
    heading=_options.OUTPUT,
    metavar="FILE",
    help="Add a line of JSON for each thing that happens to this file.",
)
@_options.some(_options.ReadingOptions, "columns", "unit", "scale", "axes", "as_logged")
@_options.sensor
@_options.judgement
@_options.force
@_options.as_json
def command(
    source: str,
    out: str,
    report: str | None,
    workers: int | None,
    scheduler: str | None,
    resume: bool,
    log_file: str | None,
    force: bool,
    as_json: bool,
    **reading: Any,
) -> int:
    """Calibrate all units of INPUT, and write a row for each of their recordings.

    INPUT is a folder or a pattern of logs, whose first folders or names are the units, or of Parquet and Arrow tables
    with a column of units; here, or at s3://, gs:// or az://. A recording that cannot be fitted or read is a row that
    says why.
    """
    from flinders.fleet.dataset import Options
    from flinders.fleet.job import run
    from flinders.fleet.progress import log_to

    if workers is not None and scheduler is not None:
        raise UsageError("--workers are processes of this machine, --scheduler has its own: leave one of them out")
    _check_outputs(out, report, log_file, force=force)
    reading["polish"] = not reading.pop("moments_only")
    with log_to(log_file), _progress() as watch:
        summary = run(
            source,
            out,
            Options(**reading),
            workers=workers,
            scheduler=scheduler,
            resume=resume,
            force=force,
            watch=watch,
            notice=say,
        )
    if as_json:
        print_json(summary.as_dict())
    else:
        from flinders.fleet.progress import page

        show(page(summary))
    if report is not None:
        _write_report(out, report, force=force)
    say(f"written to {out} in {summary.seconds:.1f} s" if sys.stderr.isatty() else f"written to {out}")
    return GOOD if summary.is_whole else LIMITED


def _check_outputs(out: str, report: str | None, log_file: str | None, *, force: bool) -> None:
    """Find what could not be written before anything is read.

    Raises
    ------
    UsageError, OutputError
    """
    from flinders.core.files import refuse_existing
    from flinders.fleet.storage import is_remote

    asked = [name for name in (out, report, log_file) if name is not None]
    named = [name if is_remote(name) else os.path.realpath(name) for name in asked]
    if len(set(named)) < len(named):
        raise UsageError("--out, --report and --log are files of their own: give each another name")
    if report is not None:
        refuse_existing(report, force=force)


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
