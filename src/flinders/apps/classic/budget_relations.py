"""Relations of a magnetic budget: heading error, wire, pair of wires, magnet; each is solved for the missing quantity.

>>> stray_budget("wire", {"current": "0.2A", "distance": "1cm"}).derived
{'stray': 4.0}
>>> allowed = stray_budget("wire", {"current": "0.2A", "field": "150mG", "error": "1deg"})
>>> round(100.0 * allowed.known["distance"], 1)
15.3
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

from flinders.apps.classic.budget import QUANTITIES, Budget, Magnet, Pair, UnitValue, Wire
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.apps.classic.budget import Position

Relation: TypeAlias = Literal["heading", "wire", "pair", "magnet"]

SOURCES: Final[Mapping[Relation, tuple[str, ...]]] = {
    "wire": ("current", "distance"),
    "pair": ("current", "separation", "distance"),
    "magnet": ("moment", "distance"),
}
"""Quantities of each source of a stray field, without that field."""

HEADING: Final = ("field", "stray", "error")
MOMENT_SOURCES: Final[Mapping[Relation, tuple[str, ...]]] = {"magnet": ("remanence", "volume")}


def stray_budget(relation: Relation, given: Mapping[str, UnitValue | str], *, side: bool = False) -> Budget:
    """Solve for the missing quantity of a source of a stray field: its field, distance, current or heading error.

    Parameters
    ----------
    relation : ``heading``, ``wire``, ``pair`` or ``magnet``
    given : mapping of str to UnitValue or str
        Quantities with their units, such as ``{"current": "0.2A"}``: two of ``field``, ``stray`` and ``error`` for the
        heading; ``current``, ``separation`` and ``distance`` of wires; ``moment``, or ``remanence`` and ``volume``,
        and ``distance`` of a magnet.
    side : bool
        Whether the sensor is beside the magnet and not off its poles, in half the field.

    Raises
    ------
    UnitError
        For a unit that is missing, not known or of another kind.
    UsageError
        For unknown quantities, and for too many or too few of them.
    """
    names = (*SOURCES.get(relation, ()), *MOMENT_SOURCES.get(relation, ()), *HEADING)
    if relation != "heading" and relation not in SOURCES:
        raise UsageError(f"no relation {relation!r}: need one of heading, {', '.join(SOURCES)}")
    if wrong := [name for name in given if name not in names]:
        raise UsageError(f"a {relation} has no {' and no '.join(wrong)}: need {', '.join(names)}")
    values = {
        name: UnitValue.of(QUANTITIES[name][0], value, name) if isinstance(value, str) else value
        for name, value in given.items()
    }
    if relation == "heading":
        if len(values) != 2:
            raise UsageError("need exactly two of field, stray and error: the third is found")
        budget = Budget("heading", values)
        budget.find_heading()
        return budget
    if relation == "magnet":
        position: Position = "equatorial" if side else "axial"
        budget = Budget("magnet", values, position)
        budget.find_moment()
        budget.find_source(partial(Magnet.solve, position=position), SOURCES["magnet"])
        return budget
    budget = Budget(relation, values)
    budget.find_source(Wire.solve if relation == "wire" else Pair.solve, SOURCES[relation])
    return budget
