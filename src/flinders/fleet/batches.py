"""What tells the hardware batch of a unit: a column of the fleet's tables, or a part of the unit's name.

>>> Batches(pattern=pattern_of("^L[0-9]", ())).of_name("L2-0017")
'L2'
>>> Batches(pattern=PREFIX).of_name("board-2024-17")
'board-2024'
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import UsageError
from flinders.fleet.table import needs_arrow

if TYPE_CHECKING:
    import os
    from collections.abc import Collection, Iterator, Sequence

    Paths = Sequence[str | os.PathLike[str]]

COLUMN: Final = "batch"
"""What tells it where nobody says otherwise and there is something in it."""
PREFIX: Final = re.compile(r"^(.+)[-_:/.][^-_:/.]+$")
"""What stands before the last part of a unit's name, which is taken for its batch where nothing tells it."""
UNNAMED: Final = re.compile(r"^(\(.*\))?$", re.DOTALL)
"""What rows of readings that no unit is known of, and of files that cannot be read, have in place of a unit's name."""
MOST: Final = 2_000
"""Names that tell more batches than that tell none."""


@dataclass(frozen=True, slots=True)
class Batches:
    """What tells the batch: the column, else the pattern.

    Attributes
    ----------
    column : str
        Empty where the name of the unit tells it.
    pattern : re.Pattern
        Of its first group, or of all that it finds.
    is_guess : bool
        Whether nobody said so.
    """

    column: str = ""
    pattern: re.Pattern[str] = PREFIX
    is_guess: bool = False

    @property
    def words(self) -> str:
        """What tells it, for people."""
        if self.column:
            return f"the column {self.column}"
        return "the name of the unit" if self.is_guess else f"{self.pattern.pattern!r} in the name"

    def of(self, table: Any) -> list[str]:  # noqa: ANN401 - pyarrow ships no types
        """Batch of the unit of each row of a table of Arrow that has all rows of its units; empty where none is known.

        Of a unit whose rows say several it is the first of them by name.
        """
        units = texts(table.column("unit"))
        known: dict[str, str] = {}
        if self.column:
            for unit, batch in zip(units, texts(table.column(self.column)), strict=True):
                if batch:
                    known[unit] = min(batch, known.get(unit, batch))
            return [known.get(unit, "") for unit in units]
        return [known[unit] if unit in known else known.setdefault(unit, self.of_name(unit)) for unit in units]

    def of_name(self, unit: str) -> str:
        """Batch that a unit's name tells; empty where it tells none."""
        found = self.pattern.search(unit)
        if found is None:
            return ""
        return (found[1] if self.pattern.groups else found[0]) or ""

    def are_told(self, names: Collection[str], rows: int) -> bool:
        """Whether these batches of so many rows tell anything."""
        return any(names) and len(names) <= MOST and (not self.is_guess or 2 <= len(names) <= rows / 4)


def batches_of(paths: Paths, asked: str | None) -> Batches:
    """Find what tells the batch.

    Parameters
    ----------
    paths : sequence of path
        Tables of `flinders fleet`.
    asked : str, optional
        A column of one of them, or a regular expression for a part of the unit's name. By default the column ``batch``
        where it holds something, or what stands before the last part of the name.

    Raises
    ------
    UsageError
        For a column or an expression that tells no batch, naming the columns there are.
    """
    columns = _columns(paths)
    if columns is None:
        return Batches(is_guess=True)  # what is wrong with the files is said where they are read
    if asked is None:
        return Batches(column=COLUMN) if _holds(paths, COLUMN) else Batches(is_guess=True)
    if asked in columns:
        if not _holds(paths, asked):
            raise UsageError(f"batch {asked!r}: that column is empty in all rows; {_choice(columns)}")
        return Batches(column=asked)
    batches = Batches(pattern=pattern_of(asked, columns))
    if not any(batches.of_name(unit) for unit in _cells(paths, "unit") if not UNNAMED.search(unit)):
        raise UsageError(
            f"batch {asked!r} is no column of the table, and as a regular expression finds nothing in the name of any "
            f"unit; {_choice(columns)}"
        )
    return batches


def of_units(table: Any) -> Any:  # noqa: ANN401
    """Rows of a table of Arrow that are of a unit: not those that say what failed before any was known."""
    from pyarrow import array

    units = texts(table.column("unit"))
    unnamed = {unit for unit in set(units) if UNNAMED.search(unit)}
    if not unnamed:
        return table
    verdicts = texts(table.column("verdict"))
    unnamed -= {unit for unit, verdict in zip(units, verdicts, strict=True) if verdict != "failed"}
    return table.filter(array([unit not in unnamed for unit in units]))


def pattern_of(text: str, columns: Sequence[str]) -> re.Pattern[str]:
    """Read a regular expression that tells the batch.

    Raises
    ------
    UsageError
    """
    try:
        return re.compile(text)
    except re.error as error:
        raise UsageError(
            f"batch {text!r} is neither a column of the table nor a regular expression ({error}); {_choice(columns)}"
        ) from None


def texts(column: Any) -> list[str]:  # noqa: ANN401
    """Cells of a column as texts, empty for null."""
    from pyarrow import compute

    cells: list[str] = compute.fill_null(column.cast("string"), "").to_pylist()
    return cells


def _choice(columns: Sequence[str]) -> str:
    return (
        f"name a column ({', '.join(columns)}), or write what to find in the names of units, such as '^[A-Z]+'; "
        "flinders fleet --batch-column NAME takes a column of the readings into its table"
    )


def _columns(paths: Paths) -> list[str] | None:
    """Columns that some table has and that hold one text or number each; None where a table cannot be read."""
    arrow = needs_arrow()
    from pyarrow import parquet

    found: dict[str, None] = {}
    try:
        for path in paths:
            fields = parquet.read_schema(path)
            found.update((field.name, None) for field in fields if not arrow.types.is_nested(field.type))
    except (OSError, arrow.lib.ArrowException):
        return None
    return list(found)


def _holds(paths: Paths, name: str) -> bool:
    return any(cell for cell in _cells(paths, name))


def _cells(paths: Paths, name: str) -> Iterator[str]:
    """Each text of a column once or more, one table after the other; of tables that have it."""
    arrow = needs_arrow()
    from pyarrow import parquet

    for path in paths:
        try:
            with parquet.ParquetFile(path) as file:
                if name in file.schema_arrow.names:
                    for batch in file.iter_batches(columns=[name]):
                        yield from texts(batch.column(0).cast("string").unique())
        except (OSError, arrow.lib.ArrowException):
            return  # said where the table is read
