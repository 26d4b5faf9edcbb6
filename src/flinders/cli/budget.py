"""``flinders budget``: how much stray field there may be, and how far away its source must be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

import click

from flinders.cli import _options
from flinders.cli._output import print_json
from flinders.cli._output import show as show_page
from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.heading.budget import Heading, Kind, Position, UnitValue

KINDS: Final[Mapping[str, Kind]] = {
    "field": "field", "stray": "field", "error": "angle", "current": "current", "distance": "length",
    "separation": "length", "moment": "moment", "remanence": "field", "volume": "volume",
}  # fmt: skip
"""What each quantity is measured as."""

TITLES: Final = {"field": "horizontal field", "stray": "stray field", "error": "heading error"}

KEYS: Final = {
    "field": "field_uT", "stray": "stray_uT", "error": "error_deg", "current": "current_A", "distance": "distance_m",
    "separation": "separation_m", "moment": "moment_Am2", "remanence": "remanence_uT", "volume": "volume_m3",
}  # fmt: skip

HANDY: Final[Mapping[Kind, tuple[str, ...]]] = {
    "field": ("uT",),
    "length": ("cm", "mm", "m", "km"),
    "current": ("A", "mA", "kA", "uA"),
    "moment": ("Am2", "mAm2", "uAm2"),
    "angle": ("deg",),
}
"""Units to write a result in where none was typed: the first that makes it a number from 0.1 to 1000."""

SIGNS: Final = {
    "cm3": "cm³",
    "mm3": "mm³",
    "m3": "m³",
    "uT": "µT",
    "deg": "°",
    "um": "µm",
    "uA": "µA",
    "Am2": "A·m²",
    "mAm2": "mA·m²",
    "uAm2": "µA·m²",
}

NOTES: Final = {
    "wire": "The whole field of the wire, its return far away; what of it is vertical turns no level compass.",
    "pair": "In the plane of both wires, which is the worst place. Twisted, they make far less.",
    "axial": "Off its poles, which is the worst direction. Nearer than three times its size a magnet is no dipole.",
    "equatorial": "Off its side; off its poles it is twice as much. Nearer than three times its size it is no dipole.",
}


class Source(Protocol):
    """What makes a stray field: a wire, a pair or a magnet."""

    @property
    def formula(self) -> str:
        """How it makes it, for people."""


def _quantity(name: str, example: str, words: str) -> Callable[[_options.Function], _options.Function]:
    """An option that takes a number and its unit as they are typed."""
    return click.option(f"--{name}", metavar="VALUE", help=f"{words}, such as {example}.")


def _heading(function: _options.Function) -> _options.Function:
    """The stray field, and the heading error it makes in which field."""
    for option in (
        _options.old_as_json,
        _quantity("error", "1deg", "Worst heading error over all headings"),
        _quantity("stray", "2.6mG", "Stray field"),
        _quantity("field", "150mG", "Horizontal part of the earth's field"),
    ):
        function = option(function)
    return function


@click.group(
    "budget",
    short_help="Say how far a cable must be.",
    epilog="""\b
Example:
  flinders budget heading --field 150mG --error 1deg
  flinders budget wire --current 0.2A --field 150mG --error 1deg
""",
)
def command() -> None:
    """Say how much stray field there may be for a heading error, and how far its source must be.

    Each relation is solved for what is left out. Numbers come with their units, as they are typed: mG, uT, cm,
    mm, A, mA, deg. A calibration takes off what never changes; the budget is for what comes, goes or is switched.
    """


@command.command(
    "heading",
    short_help="Heading error and stray field.",
    epilog="""\b
Example:
  flinders budget heading --field 150mG --error 1deg
  flinders budget heading --field 20uT --stray 0.5uT
""",
)
@_heading
def heading(as_json: bool, **typed: str | None) -> None:
    """Find one of horizontal field, stray field and worst heading error from the other two."""
    budget = Budget("heading", _read(typed))
    if len(budget.given) != 2:
        raise UsageError("need exactly two of --field, --stray and --error: the third is found")
    budget.find_heading()
    budget.show(as_json=as_json)


@command.command(
    "wire",
    short_help="A wire whose return is far away.",
    epilog="""\b
Example:
  flinders budget wire --current 0.2A --distance 1cm
  flinders budget wire --current 0.2A --field 150mG --error 1deg
""",
)
@_quantity("current", "0.2A", "Current in the wire")
@_quantity("distance", "1cm", "Distance from the middle of the wire")
@_heading
def wire(as_json: bool, **typed: str | None) -> None:
    """Find field, current or distance of a long straight wire whose current returns far away.

    With --field and --error in place of --stray it is the distance or current that is allowed.
    """
    from flinders.heading.budget import Wire

    budget = Budget("wire", _read(typed))
    budget.find_source(Wire.solve, ("current", "distance"))
    budget.show(as_json=as_json)


@command.command(
    "pair",
    short_help="A wire with its return beside it.",
    epilog="""\b
Example:
  flinders budget pair --current 10A --separation 5mm --distance 10cm
  flinders budget pair --current 10A --separation 5mm --field 20uT --error 1deg
""",
)
@_quantity("current", "10A", "Current in both wires, there and back")
@_quantity("separation", "5mm", "Distance between the middles of the wires")
@_quantity("distance", "10cm", "Distance from the middle between both")
@_heading
def pair(as_json: bool, **typed: str | None) -> None:
    """Find field, current, separation or distance of two long straight wires that carry a current there and back.

    With --field and --error in place of --stray it is the distance, current or separation that is allowed.
    """
    from flinders.heading.budget import Pair

    budget = Budget("pair", _read(typed))
    budget.find_source(Pair.solve, ("current", "separation", "distance"))
    budget.show(as_json=as_json)


@command.command(
    "magnet",
    short_help="A magnet, as a dipole.",
    epilog="""\b
Example:
  flinders budget magnet --moment 0.24Am2 --distance 30cm
  flinders budget magnet --remanence 1.3T --volume 0.236cm3 --field 20uT --error 1deg
""",
)
@_quantity("moment", "0.24Am2", "Magnetic moment")
@_quantity("remanence", "1.3T", "Remanence of the magnet, in place of its moment, with its volume")
@_quantity("volume", "0.236cm3", "Volume of the magnet")
@_quantity("distance", "30cm", "Distance from the middle of the magnet")
@click.option("--side", is_flag=True, help="The sensor is off its side, not off its poles: half the field.")
@_heading
def magnet(side: bool, as_json: bool, **typed: str | None) -> None:
    """Find field, moment or distance of a magnet.

    With --field and --error in place of --stray it is the distance or moment that is allowed.
    """
    from functools import partial

    from flinders.heading.budget import Magnet

    position: Position = "equatorial" if side else "axial"
    budget = Budget("magnet", _read(typed), position=position)
    budget.find_moment()
    budget.find_source(partial(Magnet.solve, position=position), ("moment", "distance"))
    budget.show(as_json=as_json)


def _read(typed: Mapping[str, str | None]) -> dict[str, UnitValue]:
    """Read what was typed, in the order of the options.

    Raises
    ------
    UsageError
        For what is no number with a unit.
    """
    from flinders.heading.budget import UnitValue

    given = {}
    for name, text in typed.items():
        if text is not None:
            try:
                given[name] = UnitValue.of(KINDS[name], text)
            except UsageError as error:
                raise type(error)(f"--{name} {str(error).removeprefix(KINDS[name]).strip()}") from None
    return given


@dataclass
class Budget:
    """What was given and what was found, in the order in which it is told.

    Attributes
    ----------
    kind : str
        ``heading``, ``wire``, ``pair`` or ``magnet``.
    given : name to UnitValue
    position : str, optional
        Of the sensor beside a magnet.
    found : name to number, in the units of `flinders.heading.budget`
    why : name to the formula it was found by
    """

    kind: str
    given: dict[str, UnitValue]
    position: Position | None = None
    found: dict[str, float | None] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)

    @property
    def known(self) -> dict[str, float]:
        """All that is known by now."""
        solved = {name: value for name, value in self.found.items() if value is not None}
        return {name: quantity.value for name, quantity in self.given.items()} | solved

    def find_heading(self) -> None:
        """Find the third of field, stray field and error where two are known; the error is None where it is any."""
        from flinders.heading.budget import Heading

        known = self.known
        if {"field", "stray"} <= known.keys() and known["stray"] > known["field"]:
            self.found["error"] = None
            return
        solved = Heading.solve(field=known.get("field"), stray=known.get("stray"), error_deg=known.get("error"))
        self._add(solved, {"field": solved.field, "stray": solved.stray, "error": solved.error_deg})

    def find_moment(self) -> None:
        """Find the moment of a magnet from its remanence and volume, where they are given.

        Raises
        ------
        UsageError
            Where one of them is missing, or the moment is given as well.
        """
        from flinders.heading.budget import magnet_moment

        made = [self.given[name].value for name in ("remanence", "volume") if name in self.given]
        if len(made) == 1 or (made and "moment" in self.given):
            raise UsageError("give --moment, or --remanence and --volume together")
        if made:
            self.found["moment"] = magnet_moment(remanence=made[0], volume=made[1])
            self.why["moment"] = "m = B_r V / µ₀"

    def find_source(self, solve: Callable[..., Source], names: tuple[str, ...]) -> None:
        """Find what is left out of a source, by its stray field or that which the heading error allows.

        Raises
        ------
        UsageError
            Where too much or too little is given.
        """
        heading = [name for name in ("field", "stray", "error") if name in self.given]
        if len(heading) > 2:
            raise UsageError(
                "--field, --stray and --error are all given, and two of them make the third: leave out one"
            )
        if len(heading) == 2:
            self.find_heading()
        missing = [name for name in (*names, "stray") if name not in self.known]
        options = " and ".join(f"--{name}" for name in names)
        if not missing:
            raise UsageError(f"{options} make a stray field, and another is given: leave out what is to be found")
        if len(missing) > 1:
            raise UsageError(
                f"too little is given: need {options} to find the stray field, or all but one of them and --stray, "
                "or --field and --error, to find that one"
            )
        solved = solve(**{name: self.known.get(name) for name in (*names, "stray")})
        self._add(solved, {missing[0]: getattr(solved, missing[0])})
        if len(heading) == 1 and heading[0] != "stray":
            self.find_heading()

    def _add(self, solved: Source | Heading, values: Mapping[str, float]) -> None:
        """Take in what was not known before, and by which formula."""
        for name, value in values.items():
            if name not in self.known:
                self.found[name], self.why[name] = value, solved.formula

    def show(self, *, as_json: bool) -> None:
        """Print it: what was given, what was found, and for what that holds."""
        if as_json:
            print_json(self.as_dict())
            return
        from rich.console import Group
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 2))
        for _ in range(2):
            grid.add_column(no_wrap=True)
        grid.add_column()
        for name, quantity in self.given.items():
            grid.add_row(TITLES.get(name, name), _written(KINDS[name], quantity.value, [quantity.unit], typed=True))
        for name in self.found:
            grid.add_row(Text(TITLES.get(name, name), "bold"), Text(self._value(name), "bold"), self._remark(name))
        note = NOTES.get(self.position or self.kind)
        show_page(Group(grid, "", note) if note else grid)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: each quantity under its name with its unit, and which were found; an error of null is any."""
        values = {KEYS[name]: self.known.get(name) for name in KEYS if name in self.known or name in self.found}
        fields: dict[str, Any] = {"kind": self.kind, **({"position": self.position} if self.position else {}), **values}
        return {**fields, "found": [KEYS[name] for name in self.found], "formulas": [*dict.fromkeys(self.why.values())]}

    def _value(self, name: str) -> str:
        value = self.found[name]
        if value is None:
            return "any"
        kind = KINDS[name]
        alike = [other for other in self.given if KINDS[other] == kind and other != "remanence"]
        units = [self.given[other].unit for other in alike]
        return _written(kind, value, units)

    def _remark(self, name: str) -> str:
        """The formula; of a heading error also what it means, and where the rule of thumb misses it."""
        if name != "error":
            return self.why[name]
        known, value = self.known, self.found[name]
        if value is None:
            return f"the stray field is {figures(known['stray'] / known['field'])} times the horizontal field"
        rule = 57.29577951308232 * known["stray"] / known["field"]
        rough = "" if figures(rule, 3) == figures(value, 3) else f"; b/H in radians, for small angles, is {rule:.3g}°"
        return f"worst over all headings, {self.why[name]}{rough}"


def _written(kind: Kind, value: float, units: list[str], *, typed: bool = False) -> str:
    """Write a quantity with its unit: one that was typed where that suits, else a handy one.

    >>> _written("length", 0.1528, ["mm"]), _written("length", 15.28, ["mm"]), _written("field", 4.0, [])
    ('153 mm', '15.3 m', '4.00 µT = 40.0 mG')
    """
    from flinders.heading.budget import UNITS

    def number(unit: str) -> str:
        scaled = value / UNITS[kind][unit]
        return (
            f"{f'{scaled:.10g}' if typed else figures(scaled, 3)}{'' if unit == 'deg' else ' '}{SIGNS.get(unit, unit)}"
        )

    if typed or kind == "field":
        return number(units[0]) if units else f"{number('uT')} = {number('mG')}"
    suits = (unit for unit in (*units, *HANDY[kind]) if 0.1 <= value / UNITS[kind][unit] < 1000)
    return number(next(suits, (*units, *HANDY[kind])[0]))
