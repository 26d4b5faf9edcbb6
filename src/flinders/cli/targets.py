"""``flinders targets``: what a calibration can be written for."""

from __future__ import annotations

import sys
import textwrap
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options
from flinders.cli._talk import drawn, print_json

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.exporters import Exporter

WIDTH: Final = 78


@click.command(
    "targets",
    short_help="List what a calibration can be written for.",
    epilog="""\b
Example:
  flinders targets
  flinders export --to ardupilot calibration.json -o compass.param
""",
)
@_options.as_json
def command(as_json: bool) -> None:
    """List the targets of `flinders export`: what each one holds, in which unit, and whether it is read back.

    A star marks what could not be verified in any source, and the lines below the table say what that is.

    With --json also the formula, the axes, how numbers are stored, and the source of all that.
    """
    show(as_json=as_json)


def show(*, as_json: bool) -> None:
    """Print the table of targets, and below it what nobody could verify of those with a star."""
    from flinders.exporters import EXPORTERS

    if as_json:
        print_json({row.name: _as_dict(row) for row in EXPORTERS.values()})
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("target", style="bold")
    for heading in ("what is written", "holds", "unit", "import"):
        table.add_column(heading)
    for row in EXPORTERS.values():
        unit = {"own": "any", "recorded": "any"}.get(row.sheet.unit, row.sheet.unit)
        star = " *" if row.sheet.unverified else ""
        table.add_row(f"{row.name}{star}", row.use, row.sheet.keeps, unit, "yes" if row.reader else "")
    click.echo(drawn(table, sys.stdout))
    for clause, names in _unverified(EXPORTERS.values()).items():
        click.echo(textwrap.fill(f"* not verified of {', '.join(names)}: {clause}", WIDTH, subsequent_indent="  "))


def _unverified(rows: Iterable[Exporter]) -> dict[str, list[str]]:
    """What nobody could verify, and of which targets."""
    found: dict[str, list[str]] = {}
    for row in rows:
        for clause in row.sheet.unverified:
            found.setdefault(clause, []).append(row.name)
    return found


def _as_dict(row: Exporter) -> dict[str, Any]:
    """A row of the table in full, for programs."""
    return {
        "use": row.use,
        "suffix": row.suffix,
        "formula": row.sheet.formula,
        "unit": row.sheet.unit,
        "holds": row.sheet.holds,
        "axes": row.sheet.where,
        "storage": row.sheet.storage,
        "source": row.sheet.source,
        "unverified": row.sheet.unverified,
        "import": row.reader is not None,
        "docs": row.docs,
    }
