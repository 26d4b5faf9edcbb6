"""Columns that the user requests, by name or by number counted from 1.

>>> places_of_columns("mx,my,MZ", ["t", "mx", "my", "mz"], 4), places_of_columns("2,3,4", [], 4)
((1, 2, 3), (1, 2, 3))
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from flinders.core.plugins import remark
from flinders.errors import UsageError, did_you_mean
from flinders.readers._columns import Columns, column_of
from flinders.readers._names import ACCELERATION, STRENGTH, unit_of_strength
from flinders.readers._tokenizer import list_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    AnyColumns: TypeAlias = str | Sequence[str | int]
    """Names or numbers of columns, in one text or one by one."""


def parse_columns(columns: AnyColumns, *, flat: bool = False) -> list[str]:
    """Split the columns that the user requested: three different names or numbers; two are accepted if `flat`."""
    asked = parts_of(columns)
    count = len(asked)
    if not (count == 3 or (flat and count == 2)) or len({part.casefold() for part in asked}) != count:
        two = remark("two columns") if count == 2 else ""
        three = f"three different ones, such as 'mx,my,mz' or '4,5,6'{two}"
        need = "two or three different ones, such as 'mx,my' or '4,5'" if flat else three
        raise UsageError(f"columns {columns!r}: need {need}")
    return asked


def parts_of(columns: AnyColumns) -> list[str]:
    """Split a list of columns into names and numbers.

    >>> parts_of("mx, my,mz"), parts_of([4, 5, "x, raw"])
    (['mx', 'my', 'mz'], ['4', '5', 'x, raw'])
    """
    return [str(part).strip() for part in (columns.split(",") if isinstance(columns, str) else columns)]


def places_of_columns(columns: AnyColumns, names: Sequence[str], width: int, *, flat: bool = False) -> tuple[int, ...]:
    """Places of requested columns in a line; each is requested by name or by number counted from 1."""
    known = [name.strip() for name in names]
    places = tuple(_place(part, known, width) for part in parse_columns(columns, flat=flat))
    if len(set(places)) != len(places):
        many = "two" if len(places) == 2 else "three"
        raise UsageError(f"columns {columns!r} name one column twice: need {many} different ones")
    return places


def with_acceleration(asked: str, names: Sequence[str], columns: Columns, width: int) -> Columns:
    """Columns with the requested accelerometer; raises an error if it is read as the magnetometer."""
    if not width:
        raise UsageError(f"acceleration {asked!r}: lines differ in length, so columns cannot be counted")
    own = column_of(ACCELERATION, places_of_columns(asked, names, width), names)
    if taken := [name for name, cell in zip(own.names, own.cells, strict=True) if cell in columns.field.cells]:
        raise UsageError(
            f"acceleration {asked!r}: {', '.join(taken)} is read as the magnetometer: also name the columns of the "
            "magnetometer",
            hint={"columns": None},
        )
    others = tuple(column for column in columns.auxiliary if column.kind != ACCELERATION)
    return replace(columns, auxiliary=(*others, own))


def with_strength(asked: str, names: Sequence[str], columns: Columns, width: int) -> Columns:
    """Columns with the requested field strength; raises an error if it is read as the magnetometer."""
    if not width:
        raise UsageError(f"scalar {asked!r}: lines differ in length, so columns cannot be counted")
    place = _place(asked, [name.strip() for name in names], width)
    own = column_of(STRENGTH, [place], names)
    if place in columns.field.cells:
        raise UsageError(
            f"scalar {asked!r}: {own.names[0]} is read as the vector magnetometer: name the three columns of the "
            "vector magnetometer",
            hint={"columns": None},
        )
    others = tuple(column for column in columns.auxiliary if column.kind != STRENGTH and place not in column.cells)
    return replace(columns, auxiliary=(*others, replace(own, unit=unit_of_strength(own.names[0]))))


def _place(asked: str, names: list[str], width: int) -> int:
    """Place of one column: by its exact name, else by its name regardless of case, else by its number."""
    folded = [name.casefold() for name in names]
    for known, wanted in ((names, asked), (folded, asked.casefold())):
        if wanted in known:
            return known.index(wanted)
    if asked.isdecimal() and 1 <= int(asked) <= width:
        return int(asked) - 1
    there = f"the columns are {list_columns(names)}" if names else f"the table has no header and {width} columns"
    meant = did_you_mean(asked, names)
    raise UsageError(f"there is no column {asked!r}{meant}: {there}; give names or numbers from 1 to {width}")
