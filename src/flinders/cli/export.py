"""``flinders export``: a calibration written for what uses it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from flinders.cli import _options
from flinders.cli._calibration import is_recording
from flinders.cli._talk import drawn, print_json, say
from flinders.errors import DocumentError, NotExportable, UsageError, figures

if TYPE_CHECKING:
    from flinders.judged import Judged


@click.command(
    "export",
    short_help="Write a calibration for what uses it.",
    epilog="""\b
Example:
  flinders export --list
  flinders export --to adis16480 calibration.json -o registers.txt

\b
Exit codes:
  4  refused: the target cannot hold it; says which value and what is lost
""",
)
@click.argument("calibration", required=False, metavar="CALIBRATION")
@click.option("--to", "target", metavar="TARGET", help="What to write it for, one of those that --list names.")
@click.option("--list", "listed", is_flag=True, help="List the targets.")
@click.option("-o", "--output", metavar="FILE", help="Where to write [default: standard output].")
@_options.force
@_options.as_json
def command(
    calibration: str | None, target: str | None, listed: bool, output: str | None, force: bool, as_json: bool
) -> None:
    """Write CALIBRATION for a target: registers to program into a sensor, with their codes.

    What is written is checked first: the target's own formula is run on fields of all directions with the
    numbers as they are written, and the largest error found is told. A value that the target cannot hold is
    refused, not cut.
    """
    from flinders.exporters import find
    from flinders.files import refuse_existing, write_text

    if listed:
        _list(as_json=as_json)
        return
    if not calibration or not target:
        raise UsageError(
            "need a calibration file and a target: flinders export --to adis16480 calibration.json; "
            "flinders export --list names the targets"
        )
    exporter = find(target)
    if output == "-" and as_json:
        raise UsageError("--json and the text would both go to standard output: name a file with -o")
    _options.refuse_to_overwrite(output, [calibration])
    to_file = output if output != "-" else None
    if to_file:
        refuse_existing(to_file, force=force)
    judged = _load(calibration)
    export = exporter.render(judged.calibration, target=exporter.name, about=_about(judged))
    if to_file:
        write_text(export.text, to_file, force=force)
    if as_json:
        print_json(export.fields)
    elif not to_file:
        click.echo(export.text, nl=False)
    if to_file or as_json:
        say(export.checked)
        for warning in (*_limits(judged), *export.warnings):
            say(f"! {warning}")
    if to_file:
        say(f"written to {to_file}")


def _list(*, as_json: bool) -> None:
    """Print what a calibration can be written for."""
    from flinders.exporters import EXPORTERS

    if as_json:
        print_json({row.name: {"use": row.use, "suffix": row.suffix, "docs": row.docs} for row in EXPORTERS.values()})
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column("target", style="bold")
    for heading in ("what is written", "file", "more in docs"):
        table.add_column(heading)
    for row in EXPORTERS.values():
        table.add_row(row.name, row.use, f"*{row.suffix}", row.docs)
    click.echo(drawn(table, sys.stdout))


def _load(path: str) -> Judged:
    """Load a calibration that may be used.

    Raises
    ------
    UsageError
        For a recording, or standard input.
    DocumentError
        For what is no calibration file.
    NotExportable
        For one that was refused.
    """
    from flinders.judged import Judged

    if path == "-":
        raise UsageError("the calibration must be a file: flinders export --to TARGET calibration.json")
    try:
        judged = Judged.load(path)
    except DocumentError:
        if is_recording(path):
            raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None
        raise
    if judged.record is not None and judged.record.verdict == "refused":
        raise NotExportable(
            f"{path} was refused as not fit for use: record anew and calibrate again", beyond=(), verdict="refused"
        )
    return judged


def _about(judged: Judged) -> list[str]:
    """Tell where the numbers come from, and what is claimed of them."""
    sensor = f", sensor {judged.calibration.sensor}" if judged.calibration.sensor else ""
    told = [f"from {judged.name}{sensor}"]
    if judged.record is not None and judged.record.verdict is not None:
        error = judged.record.heading_error_deg
        worst = f": worst heading good to {figures(error.worst)}° (1 σ)" if error is not None else ""
        told.append(f"the calibration is {judged.record.verdict}{worst}")
    return [*told, *_limits(judged)]


def _limits(judged: Judged) -> list[str]:
    """What the calibration is not good for, as its file says."""
    findings = judged.record.findings if judged.record is not None else ()
    return [f"limited: {finding.advice}" for finding in findings if finding.severity == "limits"]
