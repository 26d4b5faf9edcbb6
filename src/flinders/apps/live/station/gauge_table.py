"""Measured values of a gauge study, from a table with a row for each test.

>>> noises = [("A", 1), ("A", 2), ("B", 3), ("B", 5)]
>>> rows = [{"unit": unit, "operator": "Ada", "noise": str(noise)} for unit, noise in noises]
>>> table = measured_table(rows, "noise")
>>> table.parts, table.operators, table.values.tolist()
(('A', 'B'), ('Ada',), [[[1.0, 2.0]], [[3.0, 5.0]]])
>>> measured_table(rows[1:], "noise")
Traceback (most recent call last):
flinders.errors.UsageError: part A was measured once by Ada: need each part at least twice by each operator
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.live.station.table import TABLE_FILE
from flinders.core.files import read_bytes
from flinders.errors import UnreadableInput, UsageError, count_text

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping

    from flinders.arrays import Floats

TABLE_BYTES: Final = 256 << 20
QUANTITIES: Final = ("offset_x", "offset_y", "offset_z", "worst_deg", "noise", "field_strength")
"""Columns that are studied by default."""
OPERATOR: Final = "operator"
"""Column of a station's table with the operator."""
NOBODY: Final = "(no operator)"


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTable:
    """Values of one quantity."""

    quantity: str
    unit: str  #: unit of the values
    parts: tuple[str, ...]
    operators: tuple[str, ...]
    values: Floats  #: (P, O, R) by part, operator and repeat
    left_out: int  #: number of rows that are not used: a part has more than R rows from an operator


def read_rows(path: str | os.PathLike[str]) -> list[dict[str, str]]:
    """Read the table of a station; `path` is the table or the folder that has it. Raises `UnreadableInput`."""
    path = Path(path, TABLE_FILE) if Path(path).is_dir() else path
    content = read_bytes(path, largest=TABLE_BYTES, what="table of a station", refused=UnreadableInput)
    reader = csv.DictReader(StringIO(content.decode("utf-8-sig", "replace")))
    try:
        rows = list(reader)
    except csv.Error as error:
        raise UnreadableInput(f"{path}: line {reader.line_num} cannot be read: {error}; check its quotes") from None
    if "unit" not in (reader.fieldnames or ()):
        raise UnreadableInput(f"{path}: is not a table of a station: it has no column unit")
    return rows


def measured_table(
    rows: Iterable[Mapping[str, str]], quantity: str, *, part: str = "unit", operator: str = OPERATOR
) -> MeasuredTable:
    """Arrange a column by part, operator and repeat.

    Parameters
    ----------
    rows : iterable of mappings
        Rows of the table, by column.
    quantity : str
        Column of numbers; rows without a number, as of stopped tests, are left out.
    part, operator : str
        Columns with part and operator; a table without a column `OPERATOR` has one operator.

    Raises
    ------
    UsageError
        For a missing column, and parts that were not measured at least twice by each operator.
    """
    cells: dict[tuple[str, str], list[float]] = defaultdict(list)
    units: dict[str, None] = {}
    for row in rows:
        if missing := [name for name in (quantity, part, operator) if name not in row and name != OPERATOR]:
            raise UsageError(f"the table has no column {missing[0]}: it has {', '.join(filter(None, row))}")
        value = _number(row[quantity])
        if math.isfinite(value):
            cells[row.get(part) or "", row.get(operator) or NOBODY].append(value)
            units[row.get("unit_of_field") or ""] = None
    parts = tuple(dict.fromkeys(name for name, _ in cells))
    operators = tuple(dict.fromkeys(name for _, name in cells))
    repeats = _repeats(cells, parts, operators, quantity)
    values = np.array([[cells[name, who][:repeats] for who in operators] for name in parts])
    left_out = sum(map(len, cells.values())) - values.size
    return MeasuredTable(quantity, _unit(quantity, tuple(units)), parts, operators, values, left_out)


def _repeats(
    cells: Mapping[tuple[str, str], list[float]], parts: tuple[str, ...], operators: tuple[str, ...], quantity: str
) -> int:
    """Number R of measurements that every part has at least from every operator."""
    if len(parts) < 2:
        raise UsageError(f"{count_text(len(parts), 'part')} with {quantity}: a gauge study needs two, better ten")
    for part in parts:
        for operator in operators:
            count = len(cells.get((part, operator), ()))
            if count < 2:
                often = "never" if count == 0 else "once"
                raise UsageError(
                    f"part {part} was measured {often} by {operator}: need each part at least twice by each operator"
                )
    return min(len(cells[part, operator]) for part in parts for operator in operators)


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _unit(quantity: str, units: tuple[str, ...]) -> str:
    """Unit of a quantity: degrees by its name, else the unit of the field."""
    if quantity.endswith("_deg"):
        return "°"
    is_of_field = quantity.startswith("offset") or quantity in {"noise", "field_strength"}
    return units[0] if is_of_field and len(units) == 1 else ""
