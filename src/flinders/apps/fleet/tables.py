"""Writes tables of records as Parquet or, if the name of the file ends in .csv, as CSV for a spreadsheet.

The table of a fleet is also CSV if its name ends in .csv: each number of a list is a column, such as ``offset_x``, and
findings are separated by spaces. Reading such a file gives exactly the same numbers.

>>> flat_names()[:7], len(flat_names())
(('unit', 'recording', 'start_s', 'end_s', 'readings', 'samples', 'verdict'), 80)
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO, cast

from flinders.apps.fleet.names import CSV, PARQUET
from flinders.apps.fleet.results import COUNTS, LISTS, NAMES, NUMBERS, UnitResult, UnitResults, needs_arrow
from flinders.core.files import open_atomically, reason_and_remedy
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Mapping, Sequence

SYMMETRIC: Final = [f"{a}_{b}" for a in range(1, 10) for b in range(a, 10)]
"""Endings of the column names for the upper triangle of a 9 × 9 matrix."""
ENDINGS: Final = {
    "offset": list("xyz"),
    "matrix": [f"{row}{column}" for row in "xyz" for column in "xyz"],
    "covariance": SYMMETRIC,
}
"""Endings of the column names for the numbers of each list."""


def is_csv(path: str | os.PathLike[str]) -> bool:
    """Whether a table is CSV by its name."""
    return str(path).lower().endswith(CSV)


def refuse_ending(path: str, what: str) -> None:
    """Refuse a name that does not end as a table: raises UsageError."""
    if not path.lower().endswith((*PARQUET, CSV)):
        raise UsageError(f"{path}: {what} is Parquet or CSV: give it a name that ends in {PARQUET[0]} or {CSV}")


@contextlib.contextmanager
def record_table(
    path: str | os.PathLike[str] | None, record: type, *, force: bool = False
) -> Iterator[Callable[[Sequence[Any]], None] | None]:
    """Write a table, which appears under its name if the block ends without an error; raises OutputError.

    Yields a function that takes some records at a time, each a dataclass `record`; None without a path.
    """
    if path is None:
        yield None
        return
    with open_atomically(path, force=force) as file:
        if is_csv(path):
            writer = csv.writer(file, lineterminator="\n")
            names = [field.name for field in dataclasses.fields(record)]
            writer.writerow(names)
            yield lambda rows: writer.writerows([_cell(getattr(row, name)) for name in names] for row in rows)
            return
        from pyarrow import parquet

        schema = record_schema(record)
        with parquet.ParquetWriter(cast("TextIO", file).buffer, schema, write_page_checksum=True) as table:
            yield lambda rows: table.write_table(_table_of(rows, schema))


def record_schema(record: type) -> Any:  # noqa: ANN401 - pyarrow ships no types
    """Arrow schema of the fields of a record."""
    arrow = needs_arrow()
    kinds = {"str": arrow.string(), "int": arrow.int64(), "float": arrow.float64()}
    kinds["tuple[float, ...]"] = arrow.list_(arrow.float64())
    return arrow.schema([(field.name, kinds[str(field.type)]) for field in dataclasses.fields(record)])


def _table_of(rows: Sequence[Any], schema: Any) -> Any:  # noqa: ANN401
    """Arrow table of some records, null for NaN."""
    arrow = needs_arrow()
    columns = [
        arrow.array([getattr(row, field.name) for row in rows], field.type, from_pandas=True) for field in schema
    ]
    return arrow.table(columns, schema=schema)


def _cell(value: object) -> object:
    """Value of a cell: a list joined by spaces, empty for NaN."""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return "" if isinstance(value, float) and math.isnan(value) else value


# ---------------------------------------------------------------------------------------------- the table of a fleet


def flat_names() -> tuple[str, ...]:
    """Names of the columns of a fleet's table in CSV."""
    return tuple(
        flat for name in NAMES for flat in ([f"{name}_{end}" for end in ENDINGS[name]] if name in LISTS else [name])
    )


def write_csv(table: str | os.PathLike[str], out: str | os.PathLike[str]) -> None:
    """Write a fleet's table from a Parquet file as CSV; raises OutputError."""
    from pyarrow import parquet

    with open_atomically(out, force=True) as file, parquet.ParquetFile(table) as source:
        added = [name for name in source.schema_arrow.names if name not in NAMES]
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*flat_names(), *added])
        for batch in source.iter_batches():
            writer.writerows(_flat_cells(row, added) for row in batch.to_pylist())


def _flat_cells(row: Mapping[str, Any], added: Sequence[str]) -> Iterator[object]:
    """Yield the cells of a row of CSV."""
    for name in NAMES:
        if name in LISTS:
            yield from row[name] or [""] * LISTS[name]
        else:
            cell = row[name]
            yield " ".join(cell or ()) if name == "findings" else "" if cell is None else cell
    yield from (row[name] or "" for name in added)


def is_csv_of_fleet(path: str | os.PathLike[str]) -> bool:
    """Whether a file is the table of a fleet as CSV, by its first line."""
    with contextlib.suppress(OSError), Path(path).open(encoding="utf-8", errors="replace") as file:
        return file.readline(4096).startswith(",".join(flat_names()))
    return False


def read_table(path: str | os.PathLike[str]) -> UnitResults:
    """Read the table of a fleet, Parquet or CSV, into memory.

    Raises `DocumentError` if the file is no such table.
    """
    if not is_csv(path):
        return UnitResults.read(path)
    if not is_csv_of_fleet(path):
        raise DocumentError(f"{path}: this is no table of a fleet: make one with `flinders fleet`")
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            return UnitResults.of([_row(cells) for cells in _complete_lines(csv.DictReader(file))])
    except (OSError, ValueError, csv.Error) as error:
        words = reason_and_remedy(error) if isinstance(error, OSError) else str(error)
        raise DocumentError(f"{path}: cannot be read as a table of a fleet: {words}") from None


def _complete_lines(lines: csv.DictReader[str]) -> Iterator[dict[str, str]]:
    """Yield the cells of each line; raises `ValueError` for an incomplete line, as of an unfinished copy."""
    for cells in lines:
        if None in cells.values():
            raise ValueError(f"line {lines.line_num} is incomplete: copy or write the table again")
        yield cells


def _row(cells: Mapping[str, str]) -> UnitResult:
    """Make a row from the cells of a line of CSV."""
    values: dict[str, Any] = {}
    for name in NAMES:
        if name in LISTS:
            values[name] = tuple(_number(cells[f"{name}_{end}"]) for end in ENDINGS[name])
        elif name in NUMBERS:
            values[name] = _number(cells[name])
        elif name in COUNTS:
            values[name] = int(cells[name])
        else:
            values[name] = tuple(cells[name].split()) if name == "findings" else cells[name]
    return UnitResult(**values)


def _number(cell: str) -> float:
    return float(cell) if cell else math.nan
