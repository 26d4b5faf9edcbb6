"""``flinders drift``: units of a fleet whose compass changed, when it was moved, and how fast its offset drifts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import is_recording, refuse_calibration
from flinders.cli._output import refuse_twice, working
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.apps.fleet.overview import FleetDrift


class Drift(program.Group):
    """Options: tables of calibrations, the reference of the comparison, outputs."""

    tables: tuple[str, ...] = program.argument("TABLE|HISTORY...", nargs=-1)
    out: str | None = program.member(
        "-o", "--output", what="the table", metavar="FILE.parquet", help="Also write a table with a row for each unit."
    )
    report: str | None = program.member(
        "--report",
        what="the report",
        metavar="FILE.html",
        help="Also write a report of the changes in the fleet.",
    )
    against: Literal["first", "previous"] = program.member(
        "--against", type=click.Choice(["first", "previous"]), default="first", show_default=True,
        help="Earlier calibration of a unit with which the newest is compared.",
    )  # fmt: skip
    batch: str | None = program.member(
        "--batch", metavar="COLUMN|PATTERN",
        help="Hardware batch: a column, or a regular expression for a part of the unit's name "
        "[default: the column batch, or the name without its last part].",
    )  # fmt: skip
    limit: int = program.member(
        "--limit", type=click.IntRange(1, 1000), default=100, show_default=True, metavar="N",
        help="Largest number of units, and of steps, to list.",
    )  # fmt: skip
    target_deg: float = option.target("Change of heading that is good enough.")
    dip_deg: float | None = option.dip("Inclination of the field at the site [default: that of the tables].")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "drift",
    Drift,
    common=("report", "out", "against", "target_deg", "dip_deg", "batch", "limit"),
    epilog="""\b
Example:
  flinders drift calibrations.parquet --report drift.html
  flinders drift january.parquet june.parquet --against previous -o drift.parquet
  flinders drift states/*.state

\b
Exit codes:
  0  no unit has to be recalibrated, and no unit of HISTORY drifts faster than the others or was moved
  3  at least one unit has to be recalibrated, drifts faster than the others, or was moved
""",
)
def command(options: Drift) -> int:
    """Compare the calibrations of each unit of a fleet over time, in degrees of heading.

    TABLE is a table of `flinders fleet`, with several recordings of each unit. Recordings of one unit may be in several
    tables, and count once. A change is compared with the claimed uncertainty of both calibrations, a step also with the
    slow drift of this fleet. Recordings are ordered by date, else by name.

    HISTORY is a record of one unit by `flinders watch`: its state, the folder of --adopted, or the lines of --json; or
    a folder of these. The result is how fast the offset of each unit drifts, which units drift faster than the others,
    and which moved.
    """
    from flinders.apps.fleet.drift import drift_of
    from flinders.apps.fleet.drift_page import of_drift
    from flinders.apps.fleet.overview import UnitDrift
    from flinders.apps.fleet.tables import record_table
    from flinders.workflows.offset_history import is_history

    refuse_twice(options.tables)
    of_units = [is_history(path) for path in options.tables]
    if any(of_units):
        return _walks(options, options.tables[of_units.index(False)] if False in of_units else None)
    _refuse_no_table(options.tables)
    outputs = options.checked_outputs()
    with working() as watch, record_table(options.out, UnitDrift, force=options.force) as each:
        if watch is not None:
            watch("comparing calibrations")
        drift = drift_of(
            options.tables,
            target_deg=options.target_deg,
            dip_deg=options.dip_deg,
            against=options.against,
            batch=options.batch,
            most=options.limit,
            each=each,
        )
    if options.report is not None:
        outputs.write(_report(drift, options), options.report)
    outputs.print(drift.as_dict, lambda: of_drift(drift))
    outputs.say_written()
    return LIMITED if drift.states["recalibrate"] else GOOD


def _walks(options: Drift, other: str | None) -> int:
    """Print how offsets of units drifted, from their histories; `other` is an input that is no history."""
    from flinders.apps.fleet.tables import record_table
    from flinders.apps.fleet.walks import UnitWalk, walks_of
    from flinders.apps.fleet.walks_page import of_walks
    from flinders.apps.fleet.walks_report import page_of

    if other is not None:
        raise UsageError(f"{other} is no history of `flinders watch`: give tables alone, or histories alone")
    for name, field in (("--against", "against"), ("--batch", "batch")):
        if program.is_typed(field):
            raise UsageError(f"{name} needs tables of a fleet: leave it out")
    outputs = options.checked_outputs()
    with working() as watch, record_table(options.out, UnitWalk, force=options.force) as each:
        if watch is not None:
            watch("reading histories")
        fleet = walks_of(
            options.tables, target_deg=options.target_deg, dip_deg=options.dip_deg, most=options.limit, each=each
        )
    if options.report is not None:
        outputs.write(page_of(fleet, options.tables), options.report)
    outputs.print(fleet.as_dict, lambda: of_walks(fleet))
    outputs.say_written()
    return LIMITED if fleet.states["moved"] or fleet.states["faster"] else GOOD


def _refuse_no_table(paths: Iterable[str]) -> None:
    """Refuse calibrations, recordings and CSV files instead of a table."""
    from flinders.apps.fleet.tables import is_csv_of_fleet

    for path in paths:
        refuse_calibration(path, "flinders compare compares two; flinders drift needs a table of flinders fleet")
        if is_csv_of_fleet(path):
            raise UsageError(f"{path} is a CSV table: give a Parquet table, which flinders fleet writes too")
        if is_recording(path):
            raise UsageError(f"{path} is a recording: flinders fleet makes a table of a folder of recordings")


def _report(drift: FleetDrift, options: Drift) -> str:
    """HTML report of a fleet with its drift."""
    from flinders.apps.fleet.aggregate import overview_of
    from flinders.apps.fleet.report import page

    return page(overview_of(options.tables, batch=options.batch, target_deg=drift.target_deg), drift)
