"""``flinders import``: what another tool, or a vehicle by its log, holds, as a calibration file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import of_content, provenance
from flinders.cli._output import cost_words, print_json, say, strength_words
from flinders.cli.targets import NamingTargets
from flinders.core.units import label
from flinders.errors import ArrayError, DocumentError, UsageError, figures

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord

LARGEST: Final = 4 * 2**20
"""Bytes; files of parameters have some ten thousand."""


class Import(program.Group):
    """A file of another tool, and what it is read as."""

    file: str = program.argument("FILE")
    target: str | None = program.member("--for", metavar="TARGET", help="Whose file it is [default: by its content].")
    compass: int | None = program.member(
        "--compass", type=click.IntRange(0, 3), metavar="N", help="Which compass of several, as the file counts."
    )
    sensor: str | None = option.sensor(
        "Of a log, which magnetometer, by number or name, or all of them [default: the only one with a calibration].",
        "N|NAME|all",
    )
    field_strength: float | None = option.field_strength(
        "Strength of the field at the site, where the file does not hold it: in µT, in counts for files in counts.",
        heading="",
        keywords=("strength",),
    )
    output: str = option.output("the calibration", "Calibration file to write [default: standard output].", default="-")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "import",
    Import,
    cls=NamingTargets,
    common=("output", "target", "compass", "sensor", "force", "as_json"),
    epilog="""\b
Example:
  flinders import compass.param -o calibration.json
  flinders import vehicle.params --compass 1 -o calibration.json
  flinders import flight.bin --sensor 1 -o on-board.json
""",
)
def command(options: Import) -> None:
    """Read the calibration that another tool holds out of FILE, and write it as a calibration file.

    FILE may be a log: what is written is the calibration that was in force on board when it was made.

    FILE is what `flinders export` writes for the targets that `flinders targets` marks, or what the tool itself
    saved: {saved}. It knows no uncertainty, and nothing of the recording.
    """
    from flinders.core.calibration_file import dumps
    from flinders.core.files import read_bytes
    from flinders.targets import read_back

    file = options.file
    if file == "-":
        raise UsageError("the file to import must have a name: flinders import compass.param -o calibration.json")
    from flinders.cli._import_log import is_log

    if options.target is None and is_log(file):
        _import_log(options)
        return
    if options.sensor is not None:
        raise UsageError(f"--sensor goes with a log, and {file} is none: choose one of several with --compass")
    outputs = options.checked_outputs()
    content = read_bytes(file, largest=LARGEST, what="file of parameters", refused=DocumentError)
    _refuse_own(content, file)
    try:
        name, calibration = read_back(
            content, file, target=options.target, strength=options.field_strength, compass=options.compass
        )
    except ArrayError as error:
        raise DocumentError(f"{file}: {error.message}", hint=error.hint, **error.evidence) from None
    outputs.write(
        dumps(calibration.to_document(provenance=_provenance(content, file, name, options.compass))), options.output
    )
    if options.as_json:
        print_json({"target": name, "calibration": calibration.as_dict()})
    for line in (*_words(file, name, calibration), *_stated(content, file, name)):
        say(line)
    outputs.say_written()


def _import_log(options: Import) -> None:
    """Take what was in force on board when a log was made."""
    from flinders.cli._import_log import import_log

    if options.compass is not None:
        raise UsageError("--compass goes with a file of parameters: choose a magnetometer of the log with --sensor")
    import_log(
        options.file,
        sensor=options.sensor,
        field_strength=options.field_strength,
        output=options.output,
        force=options.force,
        as_json=options.as_json,
    )


def _provenance(content: bytes, file: str, name: str, compass: int | None) -> ProvenanceRecord | None:
    """Of which compass of the vehicle it is, where there are several: it goes back to that one."""
    from flinders.readers._source import printable
    from flinders.targets import find

    target = find(name)
    if target.reader is None or target.reader.which is None:
        return None
    number, device = target.reader.which(content, file, compass)
    autopilot = "px4" if target.family == "px4" else "ardupilot"
    source = of_content(printable(file), content, autopilot=autopilot, compass=number, device_id=device)
    return provenance(files=[source])


def _refuse_own(content: bytes, file: str) -> None:
    """Notice a calibration file, which needs no import."""
    if content.lstrip()[:1] == b"{" and b'"field_strength_known"' in content and b'"calibration"' in content:
        raise UsageError(f"{file} is a calibration file already: give it to the command that needs it")


def _words(file: str, name: str, calibration: Calibration) -> list[str]:
    """What was found, and what the file does not hold."""
    from flinders.targets import find

    if find(name).keeps in ("rotation", "axes"):
        return [f"{file}: {name}, a mounting alone: it turns readings, and corrects none"]
    unit = label(calibration.unit)
    offset = ", ".join(figures(value, 4) for value in calibration.offset)
    words = [f"{file}: {name}, for readings in {calibration.raw.name}; offset {offset} {unit}"]
    if not calibration.field_strength_known:
        words.append(strength_words(calibration))
    words += [
        f"it follows {disturbance} ({unit}): {cost_words(calibration, disturbance)} (dip 60°)"
        for disturbance in calibration.disturbances
    ]
    if find(name).acts == "mapped":
        words.append("! for readings in the axes of the vehicle or board, after the mounting")
    return words


def _stated(content: bytes, file: str, name: str) -> list[str]:
    """What the file states beside the calibration."""
    from flinders.targets import find

    reader = find(name).reader
    return [] if reader is None or reader.states is None else reader.states(content, file)
