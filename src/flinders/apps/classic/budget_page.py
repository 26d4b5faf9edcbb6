"""Page of the terminal for a magnetic budget: given quantities, results with formulas, and their validity."""

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

RESULT_UNITS: Final[Mapping[Kind, tuple[str, ...]]] = {
    "field": ("uT",),
    "length": ("cm", "mm", "m", "km"),
    "current": ("A", "mA", "kA", "uA"),
    "moment": ("Am2", "mAm2", "uAm2"),
    "angle": ("deg",),
}
"""Units of a result if no unit was typed; the first one that gives a number from 0.1 to 1000 is used."""

SIGNS: Final = {
    "cm3": "cm³", "mm3": "mm³", "m3": "m³", "uT": "µT", "deg": "°", "um": "µm", "uA": "µA", "Am2": "A·m²",
    "mAm2": "mA·m²", "uAm2": "µA·m²",
}  # fmt: skip

NOTES: Final = {
    "wire": "The whole field of the wire, with its return far away; its vertical part does not turn a level compass.",
    "pair": "In the plane of both wires, which is the worst place. The field of a twisted pair is far smaller.",
    "axial": "Off its poles, which is the worst direction. Nearer than three times its size a magnet is no dipole.",
    "equatorial": "Off its side; off its poles the field is twice as large. Valid from three times its size on.",
}


def of_budget(budget: Budget) -> RenderableType:
    """Lay out a budget for the terminal."""
    grid = Table.grid(padding=(0, 2))
    for _ in range(2):
        grid.add_column(no_wrap=True)
    grid.add_column()
    for name, quantity in budget.given.items():
        grid.add_row(
            TITLES.get(name, name), format_quantity(QUANTITIES[name][0], quantity.value, [quantity.unit], typed=True)
        )
    for name in budget.derived:
        grid.add_row(Text(TITLES.get(name, name), "bold"), Text(_value(budget, name), "bold"), _remark(budget, name))
    note = NOTES.get(budget.position or budget.kind)
    return Group(grid, "", note) if note else grid


def _value(budget: Budget, name: str) -> str:
    """Text of a result, in the unit of a typed quantity of the same kind."""
    kind, value = QUANTITIES[name][0], budget.derived[name]
    if value is None:
        return "any"
    alike = [other for other in budget.given if QUANTITIES[other][0] == kind and other != "remanence"]
    return format_quantity(kind, value, [budget.given[other].unit for other in alike])


def _remark(budget: Budget, name: str) -> str:
    """Remark on a result: its formula. For a heading error, also its meaning, and b/H in radians if that differs."""
    if name != "error":
        return budget.why[name]
    known, value = budget.known, budget.derived[name]
    if value is None:
        return f"the stray field is {figures(known['stray'] / known['field'])} times the horizontal field"
    rule = math.degrees(known["stray"] / known["field"])
    rough = "" if figures(rule, 3) == figures(value, 3) else f"; b/H in radians, for small angles, is {rule:.3g}°"
    return f"worst over all headings, {budget.why[name]}{rough}"


def format_quantity(kind: Kind, value: float, units: Sequence[str], *, typed: bool = False) -> str:
    """Format a quantity with its unit: a typed unit if that suits, else one of `RESULT_UNITS`.

    >>> [format_quantity("length", length, ["mm"]) for length in (0.1528, 15.28)], format_quantity("field", 4.0, [])
    (['153 mm', '15.3 m'], '4.00 µT = 40.0 mG')
    """

    def number(unit: str) -> str:
        scaled = value / UNITS[kind][unit]
        digits = f"{scaled:.10g}" if typed else figures(scaled, 3)
        return f"{digits}{'' if unit == 'deg' else ' '}{SIGNS.get(unit, unit)}"

    if typed or kind == "field":
        return number(units[0]) if units else f"{number('uT')} = {number('mG')}"
    suits = (unit for unit in (*units, *RESULT_UNITS[kind]) if 0.1 <= value / UNITS[kind][unit] < 1000)
    return number(next(suits, (*units, *RESULT_UNITS[kind])[0]))
