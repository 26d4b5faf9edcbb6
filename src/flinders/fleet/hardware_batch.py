"""Hardware batch of a unit: from a column of the tables of a fleet, or from a part of the unit's name.

>>> BatchRule(pattern=pattern_of("^L[0-9]", ())).of_name("L2-0017")
'L2'
>>> BatchRule(pattern=PREFIX).of_name("board-2024-17")
'board-2024'
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import UsageError
from flinders.fleet.results import UNNAMED, needs_arrow, texts

if TYPE_CHECKING:
    import os
    from collections.abc import Collection, Iterator, Sequence

    Paths = Sequence[str | os.PathLike[str]]

COLUMN: Final = "batch"
"""Column that is used by default, unless it is empty."""
PREFIX: Final = re.compile(r"^(.+)[-_:/.][^-_:/.]+$")
"""All but the last part of a unit's name: its batch, if there is no column."""
MOST: Final = 2_000
"""More batches than this are taken for none."""


@dataclass(frozen=True, slots=True)
class BatchRule:
    """Rule for the batch: the column, else the pattern.

    Attributes
    ----------
    column : str
        Empty if the name of the unit holds it.
    pattern : re.Pattern
        Its first group, or all that it matches.
    is_guess : bool
        Whether it is a default.
    """

    column: str = ""
    pattern: re.Pattern[str] = PREFIX
    is_guess: bool = False

    @property
    def words(self) -> str:
        """The rule, for people."""
        if self.column:
            return f"the column {self.column}"
        return "the name of the unit" if self.is_guess else f"{self.pattern.pattern!r} in the name"

    def of(self, table: Any) -> list[str]:  # noqa: ANN401 - pyarrow ships no types
        """Batch of the unit of each row of a table with all rows of its units, the first by name; empty if unknown."""
        units = texts(table.column("unit"))
        known: dict[str, str] = {}
        if self.column:
            for unit, batch in zip(units, texts(table.column(self.column)), strict=True):
                if batch:
                    known[unit] = min(batch, known.get(unit, batch))
            return [known.get(unit, "") for unit in units]
        return [known[unit] if unit in known else known.setdefault(unit, self.of_name(unit)) for unit in units]

    def of_name(self, unit: str) -> str:
        """Batch in a unit's name; empty if there is none."""
        match = self.pattern.search(unit)
        if match is None:
            return ""
        return (match[1] if self.pattern.groups else match[0]) or ""

    def are_useful(self, names: Collection[str], rows: int) -> bool:
        """Whether these batches of so many rows are worth showing."""
        return any(names) and len(names) <= MOST and (not self.is_guess or 2 <= len(names) <= rows / 4)


def batch_rule(paths: Paths, text: str | None) -> BatchRule:
    """Choose the rule for hardware batches.

    Parameters
    ----------
    paths : sequence of path
        Tables of `flinders fleet`.
    text : str, optional
        A column of one of them, or a regular expression for a part of the unit's name. By default the column ``batch``
        if it is not empty, else all but the last part of the name.

    Raises
    ------
    UsageError
        For a column or an expression that gives no batch.
    """
    columns = _columns(paths)
    if columns is None:
        return BatchRule(is_guess=True)  # errors are raised where the files are read
    if text is None:
        return BatchRule(column=COLUMN) if _holds(paths, COLUMN) else BatchRule(is_guess=True)
    if text in columns:
        if not _holds(paths, text):
            raise UsageError(f"batch {text!r}: that column is empty in all rows; {_choice(columns)}")
        return BatchRule(column=text)
    batches = BatchRule(pattern=pattern_of(text, columns))
    if not any(batches.of_name(unit) for unit in _cells(paths, "unit") if not UNNAMED.search(unit)):
        raise UsageError(
            f"batch {text!r} is no column of the table, and as a regular expression finds nothing in the name of any "
            f"unit; {_choice(columns)}"
        )
    return batches


def pattern_of(text: str, columns: Sequence[str]) -> re.Pattern[str]:
    """Compile a regular expression for the batch.

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


def _choice(columns: Sequence[str]) -> str:
    """Advice on how to name a batch."""
    return (
        f"name a column ({', '.join(columns)}), or write what to find in the names of units, such as '^[A-Z]+'; "
        "flinders fleet --batch-column NAME takes a column of the readings into its table"
    )


def _columns(paths: Paths) -> list[str] | None:
    """Columns of all tables that are not nested; None if a table cannot be read."""
    arrow = needs_arrow()
    from pyarrow import parquet

    columns: dict[str, None] = {}
    try:
        for path in paths:
            fields = parquet.read_schema(path)
            columns.update((field.name, None) for field in fields if not arrow.types.is_nested(field.type))
    except (OSError, arrow.lib.ArrowException):
        return None
    return list(columns)


def _holds(paths: Paths, name: str) -> bool:
    """Whether a column has a text that is not empty."""
    return any(cell for cell in _cells(paths, name))


def _cells(paths: Paths, name: str) -> Iterator[str]:
    """Texts of a column, each at least once, of all tables that have it."""
    arrow = needs_arrow()
    from pyarrow import parquet

    for path in paths:
        try:
            with parquet.ParquetFile(path) as file:
                if name in file.schema_arrow.names:
                    for batch in file.iter_batches(columns=[name]):
                        yield from texts(batch.column(0).cast("string").unique())
        except (OSError, arrow.lib.ArrowException):
            return  # raised where the table is read
