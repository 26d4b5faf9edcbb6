"""The page of a magnetic budget: what was given, what was found, by which formula, and for what that holds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Table
from rich.text import Text

from flinders.apps.classic.budget import QUANTITIES, UNITS
from flinders.errors import figures

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import RenderableType

    from flinders.apps.classic.budget import Budget, Kind

TITLES: Final = {"field": "horizontal field", "stray": "stray field", "error": "heading error"}

HANDY: Final[Mapping[Kind, tuple[str, ...]]] = {
    "field": ("uT",),
    "length": ("cm", "mm", "m", "km"),
    "current": ("A", "mA", "kA", "uA"),
    "moment": ("Am2", "mAm2", "uAm2"),
    "angle": ("deg",),
}
"""Units to write a result in where none was typed: the first that makes it a number from 0.1 to 1000."""

SIGNS: Final = {
    "cm3": "cm³", "mm3": "mm³", "m3": "m³", "uT": "µT", "deg": "°", "um": "µm", "uA": "µA", "Am2": "A·m²",
    "mAm2": "mA·m²", "uAm2": "µA·m²",
}  # fmt: skip

NOTES: Final = {
    "wire": "The whole field of the wire, its return far away; what of it is vertical turns no level compass.",
    "pair": "In the plane of both wires, which is the worst place. Twisted, they make far less.",
    "axial": "Off its poles, which is the worst direction. Nearer than three times its size a magnet is no dipole.",
    "equatorial": "Off its side; off its poles it is twice as much. Nearer than three times its size it is no dipole.",
}


def of_budget(budget: Budget) -> RenderableType:
    """Lay out a budget for a rich console."""
    grid = Table.grid(padding=(0, 2))
    for _ in range(2):
        grid.add_column(no_wrap=True)
    grid.add_column()
    for name, quantity in budget.given.items():
        grid.add_row(TITLES.get(name, name), written(QUANTITIES[name][0], quantity.value, [quantity.unit], typed=True))
    for name in budget.derived:
        grid.add_row(Text(TITLES.get(name, name), "bold"), Text(_value(budget, name), "bold"), _remark(budget, name))
    note = NOTES.get(budget.position or budget.kind)
    return Group(grid, "", note) if note else grid


def _value(budget: Budget, name: str) -> str:
    """What was found, in the unit of what was typed."""
    kind, value = QUANTITIES[name][0], budget.derived[name]
    if value is None:
        return "any"
    alike = [other for other in budget.given if QUANTITIES[other][0] == kind and other != "remanence"]
    return written(kind, value, [budget.given[other].unit for other in alike])


def _remark(budget: Budget, name: str) -> str:
    """The formula; of a heading error also what it means, and where the rule of thumb misses it."""
    if name != "error":
        return budget.why[name]
    known, value = budget.known, budget.derived[name]
    if value is None:
        return f"the stray field is {figures(known['stray'] / known['field'])} times the horizontal field"
    rule = math.degrees(known["stray"] / known["field"])
    rough = "" if figures(rule, 3) == figures(value, 3) else f"; b/H in radians, for small angles, is {rule:.3g}°"
    return f"worst over all headings, {budget.why[name]}{rough}"


def written(kind: Kind, value: float, units: Sequence[str], *, typed: bool = False) -> str:
    """Write a quantity with its unit: one that was typed where that suits, else a handy one.

    >>> written("length", 0.1528, ["mm"]), written("length", 15.28, ["mm"]), written("field", 4.0, [])
    ('153 mm', '15.3 m', '4.00 µT = 40.0 mG')
    """

    def number(unit: str) -> str:
        scaled = value / UNITS[kind][unit]
        digits = f"{scaled:.10g}" if typed else figures(scaled, 3)
        return f"{digits}{'' if unit == 'deg' else ' '}{SIGNS.get(unit, unit)}"

    if typed or kind == "field":
        return number(units[0]) if units else f"{number('uT')} = {number('mG')}"
    suits = (unit for unit in (*units, *HANDY[kind]) if 0.1 <= value / UNITS[kind][unit] < 1000)
    return number(next(suits, (*units, *HANDY[kind])[0]))
