"""``flinders drift``: which units of a fleet have a compass that changed, and where something was moved."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Literal

import click

from flinders.cli import _options
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._talk import drawn, print_json, say, working
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.report.fleet_view import FleetDrift


@click.command(
    "drift",
    short_help="Say which units of a fleet have changed, and when.",
    epilog="""\b
Example:
  flinders drift calibrations.parquet --report drift.html
  flinders drift january.parquet june.parquet --against previous --out drift.parquet

\b
Exit codes:
  0  no unit is to be recalibrated
  3  some are
""",
)
@click.argument("tables", nargs=-1, required=True, metavar="TABLE...")
@click.option("--report", metavar="FILE.html", help="Also write a report of the fleet and how it changed.")
@click.option("-o", "--out", metavar="FILE.parquet", help="Also write a table with a row for each unit.")
@click.option(
    "--against",
    type=click.Choice(["first", "previous"]),
    default="first",
    show_default=True,
    help="Which calibration the newest is held against: what vehicles carry.",
)
@click.option(
    "--batch",
    metavar="COLUMN|PATTERN",
    help="What tells the hardware batch: a column, or a regular expression for a part of the unit's name "
    "[default: the column batch, or what stands before the last part of the name].",
)
@click.option(
    "--most", type=click.IntRange(1, 1000), default=100, show_default=True, help="Units, and steps, that are listed."
)
@click.option(
    "--target", "target_deg", type=_options.within(0, 180, "degrees above 0, up to 180"), default=1.0,
    show_default=True, metavar="DEG", help="Change of heading that is good enough.",
)  # fmt: skip
@click.option(
    "--dip", "dip_deg", type=_options.within(-89, 89, "degrees from -89 to 89"), metavar="DEG",
    help="Inclination of the field at the site [default: what the tables say].",
)  # fmt: skip
@_options.force
@_options.as_json
def command(
    tables: tuple[str, ...],
    report: str | None,
    out: str | None,
    against: Literal["first", "previous"],
    batch: str | None,
    most: int,
    target_deg: float,
    dip_deg: float | None,
    force: bool,
    as_json: bool,
) -> int:
    """Say how units of a fleet changed from recording to recording, in degrees of heading.

    TABLE is what `flinders fleet` writes, with several recordings of each unit; those of one unit may be in several
    tables, and count once. A change is held against what both calibrations claim, and a step against how this fleet
    drifts slowly. Recordings are taken in the order of their dates, else of their names.
    """
    from flinders.fleet.drift import drift_of
    from flinders.fleet.drift_table import writing

    _check_outputs(report, out, tables, force=force)
    with working() as watch, writing(out, force=force) as each:
        if watch is not None:
            watch("holding calibrations against each other")
        drift = drift_of(
            tables, target_deg=target_deg, dip_deg=dip_deg, against=against, batch=batch, most=most, each=each
        )
    if report is not None:
        _write_report(drift, tables, report, batch, force=force)
    if as_json:
        print_json(drift.as_dict())
    else:
        from flinders.report.drift_page import of_drift

        click.echo(drawn(of_drift(drift), sys.stdout))
    for path in (out, report):
        if path is not None:
            say(f"written to {path}")
    return LIMITED if drift.states["recalibrate"] else GOOD


def _check_outputs(report: str | None, out: str | None, tables: Sequence[str], *, force: bool) -> None:
    """Find what could not be written before anything is read.

    Raises
    ------
    UsageError
        Where a file is named for two of them, or is read.
    OutputError
    """
    from flinders.core.files import refuse_existing

    if report is not None and out is not None and os.path.realpath(report) == os.path.realpath(out):
        raise UsageError(f"the table and the report are both to be {out}: name two files")
    _options.refuse_twice(tables)
    for path in (report, out):
        if path is not None:
            _options.refuse_to_overwrite(path, tables)
            refuse_existing(path, force=force)


def _write_report(drift: FleetDrift, tables: Sequence[str], report: str, batch: str | None, *, force: bool) -> None:
    from flinders.core.files import write_text
    from flinders.fleet.aggregate import overview_of
    from flinders.report.fleet import page

    text = page(overview_of(tables, batch=batch, target_deg=drift.target_deg), drift)
    write_text(text, report, force=force)
