"""``flinders methods``: what there is, and when to use it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final

import click

from flinders.cli import _options
from flinders.cli._talk import drawn, print_json

if TYPE_CHECKING:
    from flinders.estimators import Method

ELLIPSOID: Final = 9
"""Parameters of an ellipsoid: three of the offset, six of the shape."""


@click.command(
    "methods",
    short_help="List the methods and when to use each.",
    epilog="""\b
Example:
  flinders methods
  flinders calibrate --method sphere tumble.csv
  flinders calibrate --method ellipsoid --option radii=xy tumble.csv
""",
)
@_options.as_json
def command(as_json: bool) -> None:
    """List the methods of estimation and when to use each."""
    from flinders.cli._method_options import listed
    from flinders.estimators import ROWS

    if as_json:
        print_json({name: {**_as_dict(row), "options": listed(row.kind)} for name, row in ROWS.items()})
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("method", style="bold")
    table.add_column("parameters\nfound", justify="right")
    table.add_column("readings,\nat least", justify="right")
    table.add_column("when to use it")
    for name, row in ROWS.items():
        parameters, least, use = _as_dict(row).values()
        options = [f"option {option}: {', '.join(values)}" for option, values in listed(row.kind).items()]
        table.add_row(name, str(parameters), str(least), "\n".join([str(use), *options]))
    click.echo(drawn(table, sys.stdout))


def _as_dict(row: Method) -> dict[str, int | str]:
    """JSON-ready: the parameters of its ellipsoid, which has no more than nine, without the noise."""
    parameters = min(row.kind.unknowns - 1, ELLIPSOID)
    return {"parameters": parameters, "least_readings": row.kind.unknowns, "use": row.use}
