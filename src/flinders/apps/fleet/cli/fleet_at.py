"""``flinders fleet at``: the calibration that a unit had at a date, from the table of a fleet."""

from __future__ import annotations

import math

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import say
from flinders.cli._program import EXITS
from flinders.cli._spelling import in_options
from flinders.fitting.fit_file import fit_from


class FleetAt(program.Group):
    """Options: a unit, a date, and the table with the calibrations of the unit."""

    unit: str = program.argument("UNIT")
    date: str | None = program.member(
        "--date",
        metavar="DATE",
        help="Date at which the calibration is valid, such as 2026-04-01 [default: the newest].",
    )
    table: str = program.member(
        "--table", default="calibrations.parquet", show_default=True, metavar="TABLE", help="Table of flinders fleet."
    )
    output: str | None = option.output("the calibration", "Where to write the calibration file.")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "fleet at",
    FleetAt,
    common=("date", "table", "output"),
    epilog="""\b
Example:
  flinders fleet at V101 --date 2026-04-01 -o V101.json
  flinders fleet at V101 --table line-7.parquet

\b
Exit codes:
  0  the calibration is good
  3  the calibration is limited
  4  the unit has no calibration at that date
""",
)
def command(options: FleetAt) -> int:
    """Write the calibration that UNIT had at a date, as an ordinary calibration file.

    A calibration is valid from its recording on until the next one of its unit; a recording that was refused or could
    not be read changes nothing. A folder that is called `at` is given to `flinders fleet` as ./at.
    """
    from datetime import UTC, datetime

    from msgspec.structs import replace

    from flinders.apps.fleet.store import calibration_at, date_of, document_of, options_of, rows_of
    from flinders.core.calibration_file import ProvenanceRecord, dumps
    from flinders.core.version import VERSION
    from flinders.report.fit_pages import page_of_file

    outputs = options.checked_outputs(options.table)
    date = None if options.date is None else date_of(options.date)
    found = calibration_at(rows_of(options.table, options.unit), options.unit, date)
    document = document_of(found.row, options_of(options.table))
    if options.output:
        made = ProvenanceRecord(flinders=VERSION, date=datetime.now(UTC).replace(microsecond=0))
        outputs.write(dumps(replace(document, provenance=made)), options.output)
    fit = fit_from(document, name=f"{options.unit}, {found.row.recording}")
    outputs.print(found.as_dict, lambda: page_of_file(fit, in_options, is_verbose=False))
    until = "" if math.isnan(found.next_s) else f" until {_day(found.next_s)}"
    since = "always" if math.isnan(found.date_s) else f"from {_day(found.date_s)}"
    recording = f" ({found.row.recording})" if found.row.recording else ""
    say(f"{options.unit}: valid {since}{recording}{until}")
    for row in found.later:
        say(f"{row.recording} was {row.verdict} ({row.cause}) and gives no newer calibration")
    outputs.say_written("nothing was written: name a file with -o")
    return EXITS[fit.verdict]


def _day(seconds: float) -> str:
    from flinders.apps.fleet.report import format_day

    return format_day(seconds)
