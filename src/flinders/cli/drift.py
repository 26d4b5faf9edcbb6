"""``flinders drift``: which units of a fleet have a compass that changed, and where something was moved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import click

from flinders.cli import _options
from flinders.cli._options import option
from flinders.cli._output import Outputs, print_json, refuse_twice, show, working
from flinders.cli._program import GOOD, LIMITED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.report.fleet_view import FleetDrift


@_options.command(
    "drift",
    common=("report", "out", "against", "target_deg", "dip_deg", "batch", "limit"),
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
@option("--report", metavar="FILE.html", help="Also write a report of the fleet and how it changed.")
@option("-o", "--out", metavar="FILE.parquet", help="Also write a table with a row for each unit.")
@option(
    "--against",
    type=click.Choice(["first", "previous"]),
    default="first",
    show_default=True,
    help="Which calibration the newest is held against: what vehicles carry.",
)
@option(
    "--batch",
    metavar="COLUMN|PATTERN",
    help="What tells the hardware batch: a column, or a regular expression for a part of the unit's name "
    "[default: the column batch, or what stands before the last part of the name].",
)
@option(
    "--limit", was=("--most",), type=click.IntRange(1, 1000), default=100, show_default=True, metavar="N",
    help="Units, and steps, that are listed at most.",
)  # fmt: skip
@_options.target("Change of heading that is good enough.")
@_options.dip("Inclination of the field at the site [default: what the tables say].")
@_options.force
@_options.as_json
def command(
    tables: tuple[str, ...],
    report: str | None,
    out: str | None,
    against: Literal["first", "previous"],
    batch: str | None,
    limit: int,
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
    from flinders.fleet.drift import drift_of, drift_table

    refuse_twice(tables)
    outputs = Outputs.of(("the table", out), ("the report", report, "--report"), force=force)
    outputs.check(tables)
    with working() as watch, drift_table(out, force=force) as each:
        if watch is not None:
            watch("holding calibrations against each other")
        drift = drift_of(
            tables, target_deg=target_deg, dip_deg=dip_deg, against=against, batch=batch, most=limit, each=each
        )
    if report is not None:
        _write_report(drift, tables, report, batch, force=force)
    if as_json:
        print_json(drift.as_dict())
    else:
        from flinders.report.drift_page import of_drift

        show(of_drift(drift))
    outputs.say_written()
    return LIMITED if drift.states["recalibrate"] else GOOD


def _write_report(drift: FleetDrift, tables: Sequence[str], report: str, batch: str | None, *, force: bool) -> None:
    """Write the report of a fleet and how it changed."""
    from flinders.core.files import write_text
    from flinders.fleet.aggregate import overview_of
    from flinders.report.fleet import page

    text = page(overview_of(tables, batch=batch, target_deg=drift.target_deg), drift)
    write_text(text, report, force=force)
