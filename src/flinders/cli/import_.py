"""``flinders import``: read a calibration from another tool's file or a vehicle's log."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import provenance, source_file_of_content
from flinders.cli._output import cost_words, print_json, say, strength_words
from flinders.cli.targets import NamingTargets
from flinders.core.units import unit_label
from flinders.errors import ArrayError, DocumentError, UsageError, figures

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord

MAX_FILE_BYTES: Final = 4 * 2**20
"""Largest size of a file to import, in bytes; a file of parameters has some ten thousand."""


class Import(program.Group):
    """A file of another tool, and options for reading it."""

    file: str = program.argument("FILE")
    target: str | None = program.member("--for", metavar="TARGET", help="Tool of the file [default: by its content].")
    compass: int | None = program.member(
        "--compass", type=click.IntRange(0, 3), metavar="N", help="Number of the compass, as counted in the file."
    )
    sensor: str | None = option.sensor(
        "For a log: which magnetometer, by number or name, or all of them [default: the only one with a calibration].",
        "N|NAME|all",
    )
    field_strength: float | None = option.field_strength(
        "Field strength at the site, if the file does not contain it: in µT, in counts for files in counts.",
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
    """Read the calibration of another tool from FILE, and write it as a calibration file.

    FILE may be a log; then its onboard calibration is written.

    FILE is an export by `flinders export` for a target marked in `flinders targets`, or a file of the tool itself:
    {saved}. Such files contain no uncertainty, and nothing about the recording.
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
        raise UsageError(
            f"--sensor needs a log, and {file} is not a log: choose one of several compasses with --compass"
        )
    outputs = options.checked_outputs()
    content = read_bytes(file, largest=MAX_FILE_BYTES, what="file of parameters", refused=DocumentError)
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
    for line in (*_words(file, name, calibration), *_other_contents(content, file, name)):
        say(line)
    outputs.say_written()


def _import_log(options: Import) -> None:
    """Import the onboard calibration of a log."""
    from flinders.cli._import_log import import_log

    if options.compass is not None:
        raise UsageError("--compass needs a file of parameters: choose a magnetometer of the log with --sensor")
    import_log(
        options.file,
        sensor=options.sensor,
        field_strength=options.field_strength,
        output=options.output,
        force=options.force,
        as_json=options.as_json,
    )


def _provenance(content: bytes, file: str, name: str, compass: int | None) -> ProvenanceRecord | None:
    """Provenance that names one of several compasses of a vehicle, so that a later export is for that compass."""
    from flinders.readers._source import printable
    from flinders.targets import find

    target = find(name)
    if target.reader is None or target.reader.which is None:
        return None
    number, device = target.reader.which(content, file, compass)
    autopilot = "px4" if target.family == "px4" else "ardupilot"
    source = source_file_of_content(printable(file), content, autopilot=autopilot, compass=number, device_id=device)
    return provenance(files=[source])


def _refuse_own(content: bytes, file: str) -> None:
    """Refuse a calibration file of Flinders, which needs no import."""
    if content.lstrip()[:1] == b"{" and b'"field_strength_known"' in content and b'"calibration"' in content:
        raise UsageError(f"{file} is a calibration file already: no import is needed")


def _words(file: str, name: str, calibration: Calibration) -> list[str]:
    """Lines about the imported calibration, and about values that the file lacks."""
    from flinders.targets import find

    if find(name).keeps in ("rotation", "axes"):
        return [f"{file}: {name}, a mounting only: it rotates readings, and corrects none"]
    unit = unit_label(calibration.unit)
    offset = ", ".join(figures(value, 4) for value in calibration.offset)
    words = [f"{file}: {name}, for readings in {calibration.raw.name}; offset {offset} {unit}"]
    if not calibration.field_strength_known:
        words.append(strength_words(calibration))
    words += [
        f"it corrects for {disturbance} ({unit}): {cost_words(calibration, disturbance)} (dip 60°)"
        for disturbance in calibration.disturbances
    ]
    if find(name).acts == "mapped":
        words.append("! for readings in the axes of the vehicle or board, after the mounting")
    return words


def _other_contents(content: bytes, file: str, name: str) -> list[str]:
    """Lines about other contents of the file."""
    from flinders.targets import find

    reader = find(name).reader
    return [] if reader is None or reader.states is None else reader.states(content, file)
