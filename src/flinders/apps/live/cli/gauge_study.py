"""``flinders gauge-study``: repeatability and reproducibility of a station's measurements."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json, show
from flinders.cli._program import GOOD, LIMITED, REFUSED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.live.station.gauge_pages import QuantityStudy

EXITS = {"acceptable": GOOD, "marginal": LIMITED, "unacceptable": REFUSED}


class GaugeOptions(program.Group):
    """A table of measurements, and the quantities to study."""

    table: str = program.argument("TABLE.csv")
    quantities: tuple[str, ...] = program.member(
        "--quantity", multiple=True, metavar="COLUMN",
        help="Column to study [default: offset of each axis, heading error, noise, field strength].",
    )  # fmt: skip
    part: str = program.member(
        "--part", default="unit", show_default=True, metavar="COLUMN", help="Column with the part."
    )
    who: str = program.member(
        "--by", default="operator", show_default=True, metavar="COLUMN", help="Column with the operator."
    )
    plan: str | None = program.member(
        "--plan", metavar="PLAN.toml", help="Plan of the station; states results as shares of its pass ranges too."
    )
    report: str | None = program.member(
        "--report", what="the report", metavar="FILE.html", help="Also write a report as one HTML file."
    )
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "gauge-study",
    GaugeOptions,
    common=("quantities", "part", "who", "plan", "report", "force", "as_json"),
    epilog="""\b
Example:
  flinders gauge-study line-3/table.csv --plan line-3.toml --report gauge.html
""",
)
def command(options: GaugeOptions) -> int:
    """Study the repeatability and reproducibility (gauge R&R) of a station, by analysis of variance.

    The table, or the one in the folder of a station, needs each part measured at least twice by each operator: test
    units several times with `repeats = true` in the station's file. The exit code is 0 for an acceptable gauge, 3 for a
    marginal one, and 4 for an unacceptable one.
    """
    options.checked_outputs(options.plan)
    from flinders.apps.live.station import gauge_pages
    from flinders.core.files import write_text

    studied = _studies(options)
    if options.report is not None:
        write_text(gauge_pages.html(studied, Path(options.table).name), options.report, force=options.force)
    if options.as_json:
        print_json({each.measured.quantity: _as_dict(each) for each in studied})
    else:
        show(gauge_pages.terminal(studied))
    return max(EXITS[each.grade] for each in studied)


def _studies(options: GaugeOptions) -> Sequence[QuantityStudy]:
    """Return a study of each quantity."""
    from flinders.apps.live.station.gauge import gauge_study
    from flinders.apps.live.station.gauge_pages import QuantityStudy
    from flinders.apps.live.station.gauge_table import QUANTITIES, measured_table, read_rows
    from flinders.apps.live.station.plan import read_plan

    rows = read_rows(options.table)
    limits = read_plan(options.plan).limits if options.plan else None
    studied = []
    for quantity in options.quantities or QUANTITIES:
        measured = measured_table(rows, quantity, part=options.part, operator=options.who)
        tolerance = limits.tolerance(quantity) if limits else math.nan
        studied.append(QuantityStudy(measured, gauge_study(measured.values), tolerance))
    return studied


def _as_dict(each: QuantityStudy) -> dict[str, Any]:
    """JSON-ready: a study with its quantity."""
    return {
        "unit": each.measured.unit,  # of the quantity
        **each.study.as_dict(),
        "grade": each.grade,  # by the share of the pass range where there is one: acceptable, marginal or unacceptable
        # six standard deviations of the gauge in per cent of the pass range; null without one
        "percent_of_tolerance": each.percent_of_tolerance,
    }
