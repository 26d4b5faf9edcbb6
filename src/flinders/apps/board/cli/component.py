"""``flinders component``: a calibration as a component of firmware."""

from __future__ import annotations

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load
from flinders.cli._output import print_json, say


class ComponentCommand(program.Group):
    """A calibration, and the folder of its component."""

    calibration: str = program.argument("CALIBRATION")
    kind: str = program.member(
        "--for", type=click.Choice(("arduino", "esphome", "micropython", "zephyr")), required=True,
        help="Framework of the component.",
    )  # fmt: skip
    folder: str = program.member(
        "-o", "--output", required=True, metavar="DIR", help="Folder to create for the component."
    )
    force: bool = option.force("Overwrite files that are in the folder.")
    as_json: bool = option.as_json()


@program.command_of(
    "component",
    ComponentCommand,
    common=("kind", "folder", "force", "as_json"),
    epilog="""\b
Example:
  flinders component --for esphome calibration.json -o compass
  flinders component --for arduino calibration.json -o ~/Arduino/libraries/FlindersCompass

\b
Exit codes:
  4  refused: the calibration does not state its noise and its uncertainty
""",
)
def command(options: ComponentCommand) -> None:
    """Write CALIBRATION as a component: a folder ready for a framework of firmware.

    A library for Arduino and PlatformIO, an external component of ESPHome, a module of Zephyr, or a package for
    MicroPython and CircuitPython. Each gives the heading with its standard deviation at the current attitude, and
    detects a disturbed field.
    """
    from flinders.apps.board.component import COMPONENTS, warnings, write

    component = COMPONENTS[options.kind]
    fit = load("component --for FRAMEWORK", options.calibration)
    files = write(component, fit, options.folder, force=options.force)
    if options.as_json:
        paths, told = list(map(str, files)), warnings(fit)
        print_json({"component": component.name, "folder": options.folder, "files": paths, "warnings": told})
        return
    for warning in warnings(fit):
        say(f"! {warning}")
    say(f"{len(files)} files written to {options.folder}")
    say(component.next_step.replace("`", ""))
