"""``flinders export``: write a calibration for another tool."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, provenance
from flinders.cli._output import Outputs, error_words, lossy_if_agreed, print_json, say
from flinders.cli.targets import NamingTargets
from flinders.errors import FlindersError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.calibration_file import SourceFile
    from flinders.core.inertial import Inertial
    from flinders.fitting.result import Fit
    from flinders.workflows.exporting import Exported


class ExportCommand(program.Group):
    """A calibration, and the target for which it is written."""

    calibration: str | None = program.argument("CALIBRATION", required=False)
    target: str | None = program.member("--for", metavar="TARGET", help="The target: one of `flinders targets`.")
    compass: int | None = program.member(
        "--compass", type=click.IntRange(0, 3), metavar="N",
        help="Number of the compass: {compasses} [default: the number in the log, else the first].",
    )  # fmt: skip
    mounting: str | None = option.mounting()
    sensors: tuple[str, ...] = program.member(
        "--with", metavar="SENSOR", multiple=True, type=click.Choice(["accelerometer", "gyro"]),
        help=(
            "accelerometer or gyro: also write the calibration of this sensor, from a fit with aiding sensors; may "
            "be given twice."
        ),
    )  # fmt: skip
    imu: int | None = program.member(
        "--imu", type=click.IntRange(0, 3), metavar="N",
        help="Number of the IMU of a vehicle, as the autopilot counts [default: its first].",
    )  # fmt: skip
    lossy: bool = option.lossy()
    name: str | None = program.member(
        "--name", metavar="NAME",
        help="Prefix of names in code, for code of two sensors in one program [default: flinders].",
    )  # fmt: skip
    noise: bool = program.flag(
        "--noise",
        "Also write the heading error, as parameters of the vehicle's estimator: EKF2_MAG_NOISE, EK3_YAW_M_NSE …",
    )
    output: str | None = option.output("the text", "Where to write [default: standard output].")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "export",
    ExportCommand,
    cls=NamingTargets,
    common=("target", "output", "compass", "lossy", "name", "force", "as_json"),
    headings={"Vehicle": ("mounting", "imu", "noise")},
    epilog="""\b
Example:
  flinders export --for arduino calibration.json -o mag.ino
  flinders export --for c calibration.json -o calibration.h
  flinders targets

\b
Exit codes:
  4  refused: the target cannot store the calibration; the message names the value and the loss
""",
)
def command(options: ExportCommand) -> None:
    """Write CALIBRATION for a target: parameters of an autopilot, registers of a sensor, code to compile.

    The output is checked first: fields of all directions are corrected by the target's own formula, with the numbers as
    they are written, and the largest error is printed. A value that the target cannot store is refused, not clipped. A
    target without soft iron is refused if the calibration needs soft iron.
    """
    from flinders.workflows.exporting import export

    if not options.calibration:
        raise UsageError(f"no calibration file: flinders export --for {options.target or 'arduino'} calibration.json")
    if not (target := options.target):
        command = shlex.join(["flinders", "export", "--for", "arduino", options.calibration])
        raise UsageError(f"no target: {command}; flinders targets lists them")
    path = options.output or "-"
    is_fields = options.as_json and path != options.output  # --json replaces the text on standard output
    outputs = Outputs.of(("the text", path), force=options.force, as_json=options.as_json and not is_fields)
    outputs.check([options.calibration])
    source = path_or_fit(options.calibration)
    asked: dict[str, Any] = {
        name: getattr(options, name) for name in ("compass", "mounting", "name", "sensors", "imu", "noise")
    }
    exported = lossy_if_agreed(lambda lossy: export(source, target, lossy=lossy, **asked), lossy=options.lossy)
    if not is_fields:
        outputs.write(exported.export.content, path)
    if options.as_json:
        print_json(exported.export.fields)
    _say(exported, is_hidden=path != "-" or options.as_json, is_asked=options.compass is not None)
    outputs.say_written()


def path_or_fit(path: str) -> Fit | Inertial:
    """Load a calibration, of a magnetometer or of an accelerometer."""
    from flinders.workflows.accelerometer import is_inertial, read_inertial

    return read_inertial(path) if is_inertial(path) else load("export --for TARGET", path)


def _say(exported: Exported, *, is_hidden: bool, is_asked: bool) -> None:
    """Print the error of the export, its limits and its compass; not if the terminal shows them as comments already."""
    export = exported.export
    if is_hidden or not export.has_comments:
        say(export.checked)
        for note in () if export.has_comments else export.fields["notes"]:
            say(note)
        for warning in (*exported.limits, *export.warnings):
            say(f"! {warning}")
    for note in exported.compass:
        say(f"! {note}" if is_asked else note)


def split_exports(values: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Split the values of ``calibrate --export`` into targets and files.

    Without a file, the file is named after the target.

    >>> split_exports(["json", "c:mag.h"]), split_exports([])
    ((('json', 'json.json'), ('c', 'mag.h')), ())
    """
    from flinders.targets import find

    split = [value.partition(":") for value in values]
    rows = [(find(target), path) for target, _, path in split]
    return tuple((row.name, path or f"{row.name}{row.suffix}") for row, path in rows)


def write_exports(
    fit: Fit,
    exports: Sequence[tuple[str, str]],
    outputs: Outputs,
    *,
    files: Sequence[SourceFile],
    calibration: str | None,
) -> None:
    """Write a fit for targets, after its `calibration` file was written; `files` are the recordings of the fit."""
    name = ", ".join(file.name for file in files)
    fit = replace(fit, provenance=replace(fit.provenance, name=name, record=provenance(files=files)))
    failed: list[FlindersError] = []
    for target, path in exports:
        try:
            _write_export(fit, target, path, outputs)
        except FlindersError as error:
            say(f"! nothing was written for {target}; {_whereabouts(calibration)}")
            failed.append(error)
    gravest = max(failed, key=lambda error: error.exit_code, default=None)
    for each in failed:
        if each is not gravest:
            say(f"! {error_words(each)}")
    if gravest is not None:
        raise gravest


def _write_export(fit: Fit, target: str, path: str, outputs: Outputs) -> None:
    """Write a fit for one target, and print its error."""
    from flinders.workflows.exporting import export

    exported = export(fit, target)
    outputs.write(exported.export.content, path)
    for line in (*exported.compass, exported.export.checked):
        say(f"{target}: {line}")
    for warning in exported.export.warnings:
        say(f"! {warning}")
    if path != "-":
        say(f"written to {path}")


def _whereabouts(calibration: str | None) -> str:
    """Sentence that says where the calibration is, if an export fails."""
    if calibration is None:
        return "no calibration file was asked for either: keep it with -o calibration.json"
    if calibration == "-":
        return "the calibration went to standard output"
    return f"the calibration is in {calibration}"
