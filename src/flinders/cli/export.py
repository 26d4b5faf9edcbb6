"""``flinders export``: a calibration written for what uses it."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from flinders.cli import _options, targets
from flinders.cli._calibration import for_use, known_of, only, refuse_on_top
from flinders.cli._talk import print_json, say
from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.document import SourceFile
    from flinders.exporters import Export, Exporter
    from flinders.judged import Judged
    from flinders.result import Fit


@click.command(
    "export",
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
@click.option("--to", "target", metavar="TARGET", help="What to write it for, one of those of `flinders targets`.")
@click.option("--list", "listed", is_flag=True, help="List the targets, as `flinders targets` does.")
@click.option(
    "--compass", type=click.IntRange(0, 3), metavar="N",
    help="Which compass it is for: ArduPilot's 1 to 3, PX4's 0 to 3 [default: the one of the log, else the first].",
)  # fmt: skip
@click.option(
    "--lossy", is_flag=True, help="Write it also where what the target cannot hold costs more than 1° of heading."
)
@click.option("-o", "--output", metavar="FILE", help="Where to write [default: standard output].")
@_options.force
@_options.as_json
def command(
    calibration: str | None,
    target: str | None,
    listed: bool,
    compass: int | None,
    lossy: bool,
    output: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write CALIBRATION for a target: parameters of an autopilot, registers of a sensor, code to compile in.

    What is written is checked first: the target's own formula is run on fields of all directions with the
    numbers as they are written, and the largest error found is told. A value that the target cannot hold is
    refused, not cut, and so is a target without room for soft iron that matters.
    """
    from flinders.exporters import Asked, find
    from flinders.files import refuse_existing

    if listed:
        targets.show(as_json=as_json)
        return
    if not calibration or not target:
        raise UsageError(
            "need a calibration file and a target: flinders export --to ardupilot calibration.json; "
            "flinders targets names them"
        )
    exporter = find(target)
    if compass is not None and not exporter.compasses:
        raise UsageError(f"--compass goes with ardupilot, px4 and px4-shell: {exporter.name} holds one compass only")
    if output == "-" and as_json:
        raise UsageError("--json and the text would both go to standard output: name a file with -o")
    _options.refuse_to_overwrite(output, [calibration])
    to_file = output if output != "-" else None
    if to_file:
        refuse_existing(to_file, force=force)
    judged = _loaded(calibration, exporter)
    number, told = placed(judged, exporter, compass)
    asked = Asked(compass=number, lossy=lossy)
    export = exporter.render(judged.calibration, target=exporter.name, about=[*about(judged), *told], asked=asked)
    if to_file:
        save(export, to_file, force=force)
    if as_json:
        print_json(export.fields)
    elif not to_file:
        show(export)
    if to_file or as_json or not export.told:
        _tell(export, judged)
    for line in told:
        say(line if compass is None else f"! {line}")
    if to_file:
        say(f"written to {to_file}")


def _tell(export: Export, judged: Judged) -> None:
    """Say what is known of it; what stands in the file already is left out."""
    say(export.checked)
    for note in () if export.told else export.fields["notes"]:
        say(note)
    for warning in (*_limits(judged), *export.warnings):
        say(f"! {warning}")


def _loaded(path: str, exporter: Exporter) -> Judged:
    """Load a calibration that a target may have."""
    judged = for_use("export --to TARGET", path)
    if exporter.compasses:
        refuse_on_top(judged, exporter.name)
    return judged


def placed(judged: Judged, exporter: Exporter, asked: int | None = None) -> tuple[int | None, list[str]]:
    """Which compass of a vehicle a calibration goes to, that of the log unless another is asked, and what to say of it.

    Nothing is said where the compass is not known, or is the one that was asked for.

    Raises
    ------
    UsageError
        Where it was made from several compasses, and none was asked.
    """
    if not exporter.compasses:
        return None, []
    autopilot = exporter.name.partition("-")[0]
    known, devices = (known_of(judged, autopilot, what) for what in ("compass", "device_id"))
    if not known - {asked}:
        return asked, []
    device = f" (device id {min(devices)})" if len(devices) == 1 else ""
    if asked is None:
        number = only(judged, known, "compass", "--compass")
        return number, [f"for compass {number} of the vehicle{device}"]
    there = " and ".join(map(str, sorted(known)))
    return asked, [f"for compass {asked}, as asked; it was made from compass {there} of the vehicle{device}"]


def named(value: str | None) -> tuple[str | None, str | None]:
    """Split the value of ``calibrate --export``: the target, and the file, which has the target's name by default.

    Raises
    ------
    UsageError
        For a target that there is not.

    Examples
    --------
    >>> named("ardupilot"), named("c:mag.h"), named(None)
    (('ardupilot', 'ardupilot.param'), ('c', 'mag.h'), (None, None))
    """
    if value is None:
        return None, None
    from flinders.exporters import find

    target, _, path = value.partition(":")
    exporter = find(target)
    return exporter.name, path or f"{exporter.name}{exporter.suffix}"


def refuse_with(value: str | None, option: str) -> None:
    """Refuse ``calibrate --export`` beside an option that it does not go with.

    Raises
    ------
    UsageError
    """
    if value is not None:
        raise UsageError(f"--export does not go with {option}: write the calibration with -o, then use flinders export")


def beside(fit: Fit, target: str, path: str, *, files: Sequence[SourceFile], force: bool) -> None:
    """Write a fit for a target, beside its calibration file; `files` are what it was made from.

    Raises
    ------
    NotExportable, UnitError, UsageError
        Where the target cannot hold it, or nobody knows for which compass it is; the calibration file is written by
        then.
    """
    from flinders.exporters import Asked, find
    from flinders.judged import Judged

    judged = replace(Judged.from_fit(fit, name=", ".join(file.name for file in files)), files=tuple(files))
    exporter = find(target)
    if exporter.compasses:
        refuse_on_top(judged, exporter.name)
    number, told = placed(judged, exporter)
    export = exporter.render(
        judged.calibration, target=target, about=[*about(judged), *told], asked=Asked(compass=number)
    )
    if path == "-":
        show(export)
    else:
        save(export, path, force=force)
    for line in (*told, export.checked):
        say(f"{target}: {line}")
    for warning in export.warnings:
        say(f"! {warning}")
    if path != "-":
        say(f"written to {path}")


def save(export: Export, path: str, *, force: bool) -> None:
    """Write the file, whole or not at all; raises as `files.replacing`."""
    from flinders.files import write_bytes, write_text

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


def about(judged: Judged) -> list[str]:
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
