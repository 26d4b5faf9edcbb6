"""``flinders firmware``: the calibrator for a microcontroller."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json, say


class Firmware(program.Group):
    """Options of the command."""

    folder: str = program.member(
        "-o", "--output", required=True, metavar="DIR", help="Folder to create for the package."
    )
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "firmware",
    Firmware,
    common=("folder", "force", "as_json"),
    epilog="""\b
Example:
  flinders firmware -o ~/Arduino/libraries/Flinders
  flinders live --serial /dev/ttyACM0
""",
)
def command(options: Firmware) -> None:
    """Write a library for Arduino, PlatformIO and CMake that calibrates a magnetometer on the board.

    The library is C99 without dependencies: the engine of this program in single precision, with the rules of the
    verdict that need at most 300 readings. Its example is a sketch for the LIS3MDL, which prints lines for flinders
    live and receives a calibration from flinders send --serial.
    """
    from flinders.apps.board import package

    files = package.write(options.folder, force=options.force)
    if options.as_json:
        print_json({"folder": options.folder, "version": package.VERSION, "files": list(map(str, files))})
        return
    say(f"{len(files)} files in {options.folder}: move the folder to your libraries, and open its example LIS3MDL")
