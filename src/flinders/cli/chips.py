"""``flinders chips``: the table of magnetometer chips, or one of them with its settings and sources."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_result


class Chips(program.Group):
    """Which chip, and how it is printed."""

    name: str | None = program.argument("[NAME]", required=False)
    as_json: bool = option.as_json()


@program.command_of(
    "chips",
    Chips,
    epilog="""\b
Example:
  flinders chips
  flinders chips HMC5883L
  flinders chips MPU-9250 --json
""",
)
def command(options: Chips) -> None:
    """List common magnetometer chips: µT per count, range, noise and axes, in the setting after power-on.

    With NAME, a chip or a package that contains one: all its settings, known errors in data sheets and libraries, and
    the sources of the values. A value without a source is left out. `flinders info` proposes unit and axes from this
    table.
    """
    from flinders.core.chips import chips, find_chip
    from flinders.report.chip_pages import of_chip, of_chips

    if options.name is None:
        rows = chips()
        print_result(
            lambda: {chip.name: chip.as_dict() for chip in rows}, lambda: of_chips(rows), as_json=options.as_json
        )
        return
    chip = find_chip(options.name)
    print_result(chip.as_dict, lambda: of_chip(chip), as_json=options.as_json)
