"""``flinders export``: a calibration written for what uses it."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from flinders.cli import _options, targets
from flinders.cli._inputs import for_use, known_of, only, provenance, refuse_on_top
from flinders.cli._options import option
from flinders.cli._output import Outputs, print_json, say
from flinders.errors import FlindersError, UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration_file import SourceFile
    from flinders.fitting.result import Fit
    from flinders.targets import Export, Target


@click.command(
    "export",
    cls=targets.NamingTargets,
    common=("target", "output", "compass", "listed", "lossy", "name", "force", "as_json"),
    short_help="Write a calibration for what uses it.",
    epilog="""\b
Example:
  flinders export --to ardupilot --compass 2 calibration.json -o compass.param
  flinders export --to c calibration.json -o calibration.h
  flinders targets

\b
Exit codes:
  4  refused: the target cannot hold it; says which value and what is lost
""",
)
@click.argument("calibration", required=False, metavar="CALIBRATION")
@option("--to", "target", metavar="TARGET", help="What to write it for, one of those of `flinders targets`.")
@option("--list", "listed", is_flag=True, help="List the targets, as `flinders targets` does.")
@option(
    "--compass", type=click.IntRange(0, 3), metavar="N",
    help="Which compass it is for: {compasses} [default: the one of the log, else the first].",
)  # fmt: skip
@option("--lossy", is_flag=True, help="Write it also where what the target cannot hold costs more than 1° of heading.")
@option(
    "--name", metavar="NAME",
    help="What names in code begin with, for code of two sensors in one program [default: flinders].",
)  # fmt: skip
@option("-o", "--output", metavar="FILE", help="Where to write [default: standard output].")
@_options.force
@_options.as_json
def command(
    calibration: str | None,
    target: str | None,
    listed: bool,
    compass: int | None,
    lossy: bool,
    name: str | None,
    output: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write CALIBRATION for a target: parameters of an autopilot, registers of a sensor, code to compile in.

    What is written is checked first: the target's own formula is run on fields of all directions with the
    numbers as they are written, and the largest error found is told. A value that the target cannot hold is
    refused, not cut, and so is a target without room for soft iron that matters.
    """
    if listed:
        targets.show(as_json=as_json)
        return
    if not calibration or not target:
        raise UsageError(
            "need a calibration file and a target: flinders export --to ardupilot calibration.json; "
            "flinders targets names them"
        )
    row = _taking(target, compass=compass, name=name)
    path = output or "-"
    outputs = Outputs.of(("the text", path), force=force, as_json=as_json and path == output)
    outputs.check([calibration])
    fit = for_use("export --to TARGET", calibration)
    export, notes = rendered(fit, row, compass=compass, lossy=lossy, name=name)
    if path != "-":
        save(export, path, force=force)
    if as_json:
        print_json(export.fields)
    elif path == "-":
        show(export)
    if path != "-" or as_json or not export.has_comments:
        _say_notes(export, fit)
    for line in notes:
        say(line if compass is None else f"! {line}")
    outputs.say_written()


def _taking(target: str, *, compass: int | None, name: str | None) -> Target:
    """Look up a target, and refuse options that it does not take.

    Raises
    ------
    UsageError
    """
    from flinders.targets import find, registry

    row = find(target)
    if compass is not None and not row.compasses:
        takes = ", ".join(each.name for each in registry().values() if each.compasses)
        raise UsageError(f"--compass goes with {takes}: {row.name} holds one compass only")
    if name is not None and not row.named:
        takes = ", ".join(each.name for each in registry().values() if each.named)
        raise UsageError(f"--name goes with {takes}: {row.name} has no names to choose, leave it out")
    return row


def rendered(
    fit: Fit, row: Target, *, compass: int | None = None, lossy: bool = False, name: str | None = None
) -> tuple[Export, list[str]]:
    """Write a calibration for a target, and what to say of the compass that it is for.

    Raises
    ------
    NotExportable, UnitError, UsageError
        Where the target cannot hold it, or nobody knows for which compass it is.
    """
    from flinders.targets import ExportOptions

    if row.compasses:
        refuse_on_top(fit, row.name)
    number, told = placed(fit, row, compass)
    asked = ExportOptions(compass=number, lossy=lossy, name=name)
    return row.render(fit.calibration, about=[*about(fit), *told], asked=asked), told


def _say_notes(export: Export, fit: Fit) -> None:
    """Say what is known of it; what stands in the file already is left out."""
    say(export.checked)
    for note in () if export.has_comments else export.fields["notes"]:
        say(note)
    for warning in (*_limits(fit), *export.warnings):
        say(f"! {warning}")


def placed(fit: Fit, row: Target, asked: int | None = None) -> tuple[int | None, list[str]]:
    """Which compass of a vehicle a calibration goes to, that of the log unless another is asked, and what to say of it.

    Nothing is said where the compass is not known, or is the one that was asked for.

    Raises
    ------
    UsageError
        Where it was made from several compasses, and none was asked.
    """
    if not row.compasses:
        return None, []
    known, devices = (known_of(fit, row.family, what) for what in ("compass", "device_id"))
    if not known - {asked}:
        return asked, []
    device = f" (device id {min(devices)})" if len(devices) == 1 else ""
    if asked is None:
        number = only(fit, known, "compass", "--compass")
        return number, [f"for compass {number} of the vehicle{device}"]
    there = " and ".join(map(str, sorted(known)))
    return asked, [f"for compass {asked}, as asked; it was made from compass {there} of the vehicle{device}"]


def named(values: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Split the values of ``calibrate --export``: targets, and their files, which have the target's name by default.

    Raises
    ------
    UsageError
        For a target that there is not.

    Examples
    --------
    >>> named(["ardupilot", "c:mag.h"]), named([])
    ((('ardupilot', 'ardupilot.param'), ('c', 'mag.h')), ())
    """
    from flinders.targets import find

    split = [value.partition(":") for value in values]
    rows = [(find(target), path) for target, _, path in split]
    return tuple((row.name, path or f"{row.name}{row.suffix}") for row, path in rows)


def export_fit(
    fit: Fit, exports: Sequence[tuple[str, str]], *, files: Sequence[SourceFile], force: bool, calibration: str | None
) -> None:
    """Write a fit for targets, after its `calibration` file; `files` are what it was made from.

    Raises
    ------
    FlindersError
        Where a target cannot hold it, nobody knows for which compass it is, or it cannot be written; the gravest, once
        all were tried. What has become of the calibration, which is written by then, is said before.
    """
    fit = replace(fit, name=", ".join(file.name for file in files), provenance=provenance(files=files))
    failed: list[FlindersError] = []
    for target, path in exports:
        try:
            _export_to(fit, target, path, force=force)
        except FlindersError as error:
            say(f"! nothing was written for {target}; {_kept(calibration)}")
            failed.append(error)
    gravest = max(failed, key=lambda error: error.exit_code, default=None)
    for each in failed:
        if each is not gravest:
            say(f"! {each}")
    if gravest is not None:
        raise gravest


def _export_to(fit: Fit, target: str, path: str, *, force: bool) -> None:
    """Write it for one target, and say what that costs; raises as `export_fit`."""
    from flinders.targets import find

    export, notes = rendered(fit, find(target))
    if path == "-":
        show(export)
    else:
        save(export, path, force=force)
    for line in (*notes, export.checked):
        say(f"{target}: {line}")
    for warning in export.warnings:
        say(f"! {warning}")
    if path != "-":
        say(f"written to {path}")


def _kept(calibration: str | None) -> str:
    """Where the calibration is that a target did not get."""
    if calibration is None:
        return "no calibration file was asked for either: keep it with -o calibration.json"
    if calibration == "-":
        return "the calibration went to standard output"
    return f"the calibration is in {calibration}"


def save(export: Export, path: str, *, force: bool) -> None:
    """Write the file, whole or not at all; raises as `files.replacing`."""
    from flinders.core.files import write_bytes, write_text

    if export.data is None:
        write_text(export.text, path, force=force)
    else:
        write_bytes(export.data, path, force=force)


def show(export: Export) -> None:
    """Print what would be in the file.

    Raises
    ------
    UsageError
        For bytes, where a person would see them.
    """
    if export.data is None:
        click.echo(export.text, nl=False)
        return
    if sys.stdout.isatty():
        raise UsageError(f"{export.target} is {len(export.data)} bytes, and no text: name a file with -o")
    click.echo(export.data, nl=False)


def about(fit: Fit) -> list[str]:
    """Tell where the numbers come from, and what is claimed of them."""
    sensor = f", sensor {fit.calibration.sensor}" if fit.calibration.sensor else ""
    told = [f"from {fit.name}{sensor}"]
    if fit.is_described:
        worst_deg = fit.heading_error_deg.worst
        worst = "" if math.isnan(worst_deg) else f": worst heading good to {figures(worst_deg)}° (1 σ)"
        told.append(f"the calibration is {fit.verdict}{worst}")
    return [*told, *_limits(fit)]


def _limits(fit: Fit) -> list[str]:
    """What the calibration is not good for, as its file says."""
    return [f"limited: {finding.advice}" for finding in fit.findings if finding.severity == "limits"]
