"""``flinders methods``: what there is, and when to use it."""

from __future__ import annotations

import sys

import click

from flinders.cli import _options
from flinders.cli._talk import drawn, print_json


@click.command(
    "methods",
    short_help="List the methods and when to use each.",
    epilog="""\b
Example:
  flinders methods
  flinders calibrate --method sphere tumble.csv
""",
)
@_options.as_json
def command(as_json: bool) -> None:
    """List the methods of estimation and when to use each."""
    from flinders.estimators import METHODS

    if as_json:
        print_json({name: {"unknowns": method.unknowns, "use": method.use} for name, method in METHODS.items()})
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("method", style="bold")
    table.add_column("unknowns", justify="right")
    table.add_column("when to use it")
    for name, method in METHODS.items():
        table.add_row(name, str(method.unknowns), method.use)
    click.echo(drawn(table, sys.stdout))
