r"""Properties of units (firmware, revision, place, …) from a CSV: columns of texts, joined by the name of the unit.

>>> import tempfile
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "units.csv"
>>> _ = path.write_text("serial,firmware,place\nA17,1.2,Kiel\nB02,1.3,Oslo\n")
>>> known = Properties.read(path)
>>> known.names, known.of("B02"), known.of("B02 MAG2"), known.of("C05")
(('firmware', 'place'), ('1.3', 'Oslo'), ('1.3', 'Oslo'), ('', ''))
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.apps.fleet.names import UNIT_COLUMNS, delimiter_of
from flinders.apps.fleet.results import NAMES, needs_arrow, schema, strings, texts
from flinders.core.files import read_bytes
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

MAX_BYTES: Final = 1 << 28
"""Largest size of a list of units, in bytes."""


@dataclass(frozen=True, slots=True)
class Properties:
    """Properties of units, such as firmware or place, that do not come from recordings."""

    names: tuple[str, ...]  # names of the properties
    # values by unit; None if the rows of the table keep the properties that they have
    known: Mapping[str, tuple[str, ...]] | None = field(default=None, repr=False)

    @classmethod
    def read(cls, path: str | os.PathLike[str], unit_column: str | None = None) -> Self:
        """Read a CSV with a column of units and columns of properties.

        Lines without a unit are skipped. Raises `UnreadableInput` if the file cannot be read, and `UsageError` if no
        column names units, a property has the name of a column of the table, or a unit occurs twice.
        """
        content = read_bytes(path, largest=MAX_BYTES, what="list of units", refused=UnreadableInput)
        text = content.decode("utf-8-sig", "replace")
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter_of(text.partition("\n")[0]))
        try:
            rows = list(reader)
        except csv.Error as error:
            raise UnreadableInput(f"{path}: line {reader.line_num} cannot be read: {error}; check its quotes") from None
        columns = [name.strip() for name in rows[0]] if rows else []
        place = _unit_place(path, columns, unit_column)
        names = tuple(name for at, name in enumerate(columns) if at != place)
        _refuse_names(path, names)
        known: dict[str, tuple[str, ...]] = {}
        for row in rows[1:]:
            cells = [cell.strip() for cell in (*row, *[""] * len(columns))[: len(columns)]]
            unit = cells.pop(place)
            if unit and known.setdefault(unit, tuple(cells)) != tuple(cells):
                raise UsageError(f"{path} has unit {unit} twice, with different values: leave one of the two out")
        return cls(names, known)

    def of(self, unit: str) -> tuple[str, ...]:
        """Properties of a unit; those of `A17` are also those of its second magnetometer, `A17 MAG2`."""
        known = self.known or {}
        name = unit
        while name and name not in known:
            name = name.rpartition(" ")[0]
        return known.get(name, ("",) * len(self.names))

    def join(self, table: Any) -> Any:  # noqa: ANN401 - pyarrow ships no types
        """Replace the added columns of an Arrow table by columns with these properties."""
        if self.known is None or not self.names:
            return table
        arrow = needs_arrow()
        units = texts(table.column("unit"))
        of_units = {unit: self.of(unit) for unit in dict.fromkeys(units)}
        columns = zip(*(of_units[unit] for unit in units), strict=True) if units else [()] * len(self.names)
        arrays = [*table.select(NAMES).columns, *(strings(arrow, column) for column in columns)]
        return arrow.Table.from_arrays(arrays, schema=schema(self.names))


def with_columns(table: Any, added: Sequence[str]) -> Any:  # noqa: ANN401
    """Arrow table with the columns of a fleet and the `added` ones of texts, null if the table lacks them."""
    arrow = needs_arrow()
    there = table.column_names
    nulls = arrow.nulls(len(table), arrow.string())
    arrays = [table.column(name) if name in there else nulls for name in (*NAMES, *added)]
    return arrow.Table.from_arrays(arrays, schema=schema(tuple(added)))


def _unit_place(path: str | os.PathLike[str], columns: Sequence[str], unit_column: str | None) -> int:
    """Index of the column of units."""
    lowered = [name.casefold() for name in columns]
    for wanted in (*([unit_column.casefold()] if unit_column else []), *UNIT_COLUMNS):
        if wanted in lowered:
            return lowered.index(wanted)
    raise UsageError(
        f"{path} has no known column of units: its columns are {', '.join(columns[:24]) or 'none'}; need a "
        "header with a column such as unit or serial, or the name of that column",
        hint={"unit_column": None},
    )


def _refuse_names(path: str | os.PathLike[str], names: Sequence[str]) -> None:
    """Refuse properties without a name, or with the name of another property or of a column of the table."""
    for name in names:
        if not name or name in NAMES or names.count(name) > 1:
            raise UsageError(f"{path}: a property cannot be called {name!r}: give the column another name")
