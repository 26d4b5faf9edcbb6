"""Tables in memory: data frames of pandas and polars, and whatever hands out a stream of Arrow.

Columns are recognised by the same names as those of files.

>>> import pyarrow
>>> table = pyarrow.table({"t_s": [0.0, 0.1], "mx_mG": [217, 217], "my_mG": [4, 2], "mz_mG": [-586, -587]})
>>> recording = open_frame(table)
>>> print(recording)
pyarrow Table: columns mx_mG, my_mG, mz_mG in mG, time in t_s; columns in memory
>>> next(recording.blocks()).field[1]
array([ 21.7,   0.2, -58.7])
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import BLOCK
from flinders.errors import MissingExtra
from flinders.foreign_errors import needs
from flinders.readers._devices import tells_rows_apart
from flinders.readers._source import File
from flinders.readers._table import Labels, Table, TableRecording, open_table
from flinders.readers.parquet import table_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

KIND: Final = "columns in memory"


def is_frame(source: object) -> bool:
    """Whether this is a table in memory, by what it can do."""
    return hasattr(source, "__arrow_c_stream__") or _is_pandas(source)


def open_frame(frame: Any, **options: Any) -> TableRecording:  # noqa: ANN401 - of packages that need not be there
    """Recognise the columns of a table in memory; options and errors are those of `open_table`.

    Without pyarrow a frame of polars is read too, but for dates in texts. Any other that only hands out a stream of
    Arrow raises `MissingExtra`.
    """
    name = name_of(frame)
    if _is_pandas(frame):
        return open_columns(columns_of(frame), name, **options)
    try:
        table = _of_arrow(frame, name)
    except MissingExtra:
        if not hands_out_columns(frame):
            raise
        return open_columns(columns_of(frame), name, **options)
    return open_table(File(name, Path(name), 0), table, **options)


def open_columns(columns: dict[str, Any], name: str, /, **options: Any) -> TableRecording:
    """Recognise columns of pandas or polars by name; options and errors are those of `open_table`."""
    return open_table(File(name, Path(name), 0), _of_columns(columns, name), **options)


def name_of(frame: object) -> str:
    """Name of a table in memory, for messages."""
    return f"{type(frame).__module__.partition('.')[0]} {type(frame).__name__}"


def hands_out_columns(frame: object) -> bool:
    """Whether `columns_of` takes it: a frame of pandas or polars."""
    return _is_pandas(frame) or hasattr(frame, "get_column")


def columns_of(frame: Any) -> dict[str, Any]:  # noqa: ANN401
    """Columns of a frame of pandas or polars by name."""
    if _is_pandas(frame):
        return _columns_of_pandas(frame)
    return {column: frame.get_column(column) for column in frame.columns}


def _is_pandas(frame: object) -> bool:
    """Whether it has columns of NumPy and an index."""
    return all(hasattr(frame, name) for name in ("columns", "index", "items", "dtypes"))


def _columns_of_pandas(frame: Any) -> dict[str, Any]:  # noqa: ANN401
    """Columns by name; the index comes first, where it is dates or has a name."""
    columns = {str(name): column for name, column in frame.items()}
    if frame.index.name or frame.index.dtype.kind == "M":
        columns = {str(frame.index.name or "time"): frame.index, **columns}
    return columns


def _of_columns(columns: dict[str, Any], source: str) -> Table:
    """Columns of numbers, dates and names of devices and sensors, of pandas or polars."""
    arrays = {name: _numbers(column) for name, column in columns.items()}
    labels = {name: Labels() for name, array in arrays.items() if array is None and tells_rows_apart(name)}
    arrays |= {name: known.numbers(words_of(columns[name])) for name, known in labels.items()}
    return Table.of_arrays(source, KIND, {name: array for name, array in arrays.items() if array is not None}, labels)


def _numbers(column: Any) -> NDArray[Any] | None:  # noqa: ANN401
    """Numbers with NaN for what is missing, dates in UTC; None for anything else."""
    kind = getattr(column.dtype, "kind", "") or column.to_numpy().dtype.kind  # types of polars have no kind
    try:
        return np.asarray(column, dtype="datetime64[ns]" if kind == "M" else np.float64)
    except (TypeError, ValueError):
        return None


def words_of(column: Any) -> Any:  # noqa: ANN401
    """Values of a column of pandas or polars, None for what is missing."""
    return column.where(column.notna(), None) if hasattr(column, "notna") else column.to_list()


def _of_arrow(frame: Any, name: str) -> Table:  # noqa: ANN401
    """Columns that come as a stream of Arrow."""
    table = needs("pyarrow", "parquet", f"a {name}").table(frame)

    def batches(names: list[str]) -> Iterator[Any]:
        yield from table.select(names).to_batches(max_chunksize=BLOCK)

    return table_of(KIND, table.schema, table.num_rows, batches, name)
