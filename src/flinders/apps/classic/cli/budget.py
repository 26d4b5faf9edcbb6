"""``flinders budget``: the stray field that a heading error allows, and the distance of its source."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_result
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.apps.classic.budget import Budget, UnitValue


def _quantity(name: str, example: str, words: str) -> program.Field:
    """Option for a number with its unit."""
    return program.member(f"--{name}", metavar="VALUE", help=f"{words}, such as {example}.")


class Heading(program.Group):
    """Options: horizontal field, stray field and heading error."""

    field: str | None = _quantity("field", "150mG", "Horizontal part of the earth's field")
    stray: str | None = _quantity("stray", "2.6mG", "Stray field")
    error: str | None = _quantity("error", "1deg", "Worst heading error over all headings")
    as_json: bool = option.as_json(heading="")


class Wire(program.Group):
    """Options of a wire whose return is far away."""

    current: str | None = _quantity("current", "0.2A", "Current in the wire")
    distance: str | None = _quantity("distance", "1cm", "Distance from the middle of the wire")
    heading: Heading = program.group(Heading)


class Pair(program.Group):
    """Options of a wire and its return."""

    current: str | None = _quantity("current", "10A", "Current in both wires, there and back")
    separation: str | None = _quantity("separation", "5mm", "Distance between the middles of the wires")
    distance: str | None = _quantity("distance", "10cm", "Distance from the middle between both")
    heading: Heading = program.group(Heading)


class Magnet(program.Group):
    """Options of a magnet: its moment, or its remanence and volume."""

    moment: str | None = _quantity("moment", "0.24Am2", "Magnetic moment")
    remanence: str | None = _quantity(
        "remanence", "1.3T", "Remanence of the magnet, in place of its moment, with its volume"
    )
    volume: str | None = _quantity("volume", "0.236cm3", "Volume of the magnet")
    distance: str | None = _quantity("distance", "30cm", "Distance from the middle of the magnet")
    side: bool = program.flag("--side", "The sensor is beside the magnet, not off its poles: half the field.")
    heading: Heading = program.group(Heading)


@click.group(
    "budget",
    epilog="""\b
Example:
  flinders budget heading --field 150mG --error 1deg
  flinders budget wire --current 0.2A --field 150mG --error 1deg
""",
)
def command() -> None:
    """Find the stray field that a heading error allows, and the distance that its source must have.

    Each relation is solved for the quantity that is left out. Type numbers with their units: mG, uT, cm, mm, A, mA,
    deg. A calibration removes constant fields; the budget is for fields that change or are switched.
    """


@program.command_of(
    "heading",
    Heading,
    command,
    short_help="Heading error and stray field.",
    epilog="""\b
Example:
  flinders budget heading --field 150mG --error 1deg
  flinders budget heading --field 20uT --stray 0.5uT
""",
)
def heading(options: Heading) -> None:
    """Find one of horizontal field, stray field and worst heading error from the other two."""
    from flinders.apps.classic.budget_relations import stray_budget

    given = _read(options)
    if len(given) != 2:
        raise UsageError("need exactly two of --field, --stray and --error: the third is found")
    _print(stray_budget("heading", given), as_json=options.as_json)


@program.command_of(
    "wire",
    Wire,
    command,
    short_help="A wire whose return is far away.",
    epilog="""\b
Example:
  flinders budget wire --current 0.2A --distance 1cm
  flinders budget wire --current 0.2A --field 150mG --error 1deg
""",
)
def wire(options: Wire) -> None:
    """Find field, current or distance of a long straight wire whose current returns far away.

    With --field and --error in place of --stray, the result is the allowed distance or current.
    """
    from flinders.apps.classic.budget_relations import stray_budget

    _print(stray_budget("wire", _read(options)), as_json=options.heading.as_json)


@program.command_of(
    "pair",
    Pair,
    command,
    short_help="A wire and its parallel return.",
    epilog="""\b
Example:
  flinders budget pair --current 10A --separation 5mm --distance 10cm
  flinders budget pair --current 10A --separation 5mm --field 20uT --error 1deg
""",
)
def pair(options: Pair) -> None:
    """Find field, current, separation or distance of two long straight wires that carry a current there and back.

    With --field and --error in place of --stray, the result is the allowed distance, current or separation.
    """
    from flinders.apps.classic.budget_relations import stray_budget

    _print(stray_budget("pair", _read(options)), as_json=options.heading.as_json)


@program.command_of(
    "magnet",
    Magnet,
    command,
    short_help="A magnet, as a dipole.",
    epilog="""\b
Example:
  flinders budget magnet --moment 0.24Am2 --distance 30cm
  flinders budget magnet --remanence 1.3T --volume 0.236cm3 --field 20uT --error 1deg
""",
)
def magnet(options: Magnet) -> None:
    """Find field, moment or distance of a magnet.

    With --field and --error in place of --stray, the result is the allowed distance or moment.
    """
    from flinders.apps.classic.budget_relations import stray_budget

    _print(stray_budget("magnet", _read(options), side=options.side), as_json=options.heading.as_json)


def _read(options: program.Group) -> dict[str, UnitValue | str]:
    """Quantities that were typed as options, in the order of the options."""
    from flinders.apps.classic.budget import QUANTITIES, UnitValue

    given: dict[str, UnitValue | str] = {}
    for name, text in options.typed_options().items():
        if not isinstance(text, str):
            continue
        quantity = name.removeprefix("--")
        given[quantity] = UnitValue.of(QUANTITIES[quantity][0], text, name)
    return given


def _print(budget: Budget, *, as_json: bool) -> None:
    """Print given quantities, results, and their validity."""
    from flinders.apps.classic.budget_page import of_budget

    print_result(budget.as_dict, lambda: of_budget(budget), as_json=as_json)
