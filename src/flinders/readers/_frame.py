"""Tables in memory as recordings: data frames of any kind, and other objects that export an Arrow stream.

Columns are recognised by the same names as in files.

>>> import pyarrow
>>> table = pyarrow.table({"t_s": [0.0, 0.1], "mx_mG": [217, 217], "my_mG": [4, 2], "mz_mG": [-586, -587]})
>>> recording = open_frame(table)
>>> print(recording)
pyarrow Table: columns mx_mG, my_mG, mz_mG in mG, time in t_s; columns in memory
>>> next(recording.blocks()).field[1]
array([ 21.7,   0.2, -58.7])
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.frames import columns_of, has_columns, name_of
from flinders.core.samples import BLOCK_ROWS
from flinders.errors import MissingExtra
from flinders.foreign_errors import import_optional
from flinders.readers._devices import may_distinguish_rows
from flinders.readers._source import File
from flinders.readers._table import Labels, Table, TableRecording, open_table
from flinders.readers.parquet import table_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

KIND: Final = "columns in memory"


def open_frame(frame: Any, **options: Any) -> TableRecording:  # noqa: ANN401 - of packages that need not be there
    """Recognise the columns of a table in memory; options and errors are those of `open_table`.

    Without pyarrow a polars frame can be read, except for dates in text. A frame that only exports an Arrow stream
    raises `MissingExtra` without pyarrow.
    """
    name = name_of(frame)
    if hasattr(frame, "get_column"):
        with suppress(MissingExtra):
            return open_table(File(name, Path(name), 0), _of_arrow(frame, name), **options)
    if has_columns(frame):
        return open_columns(columns_of(frame), name, **options)
    return open_table(File(name, Path(name), 0), _of_arrow(frame, name), **options)


def open_columns(columns: dict[str, Any], name: str, /, **options: Any) -> TableRecording:
    """Recognise columns by name; options and errors are those of `open_table`."""
    return open_table(File(name, Path(name), 0), _of_columns(columns, name), **options)


def _of_columns(columns: dict[str, Any], source: str) -> Table:
    """Table of those columns that hold numbers, dates, or names of devices and sensors."""
    arrays = {name: _numbers(column) for name, column in columns.items()}
    labels = {name: Labels() for name, array in arrays.items() if array is None and may_distinguish_rows(name)}
    arrays |= {name: known.numbers(words_of(columns[name])) for name, known in labels.items()}
    words = {name: words_of(columns[name]) for name, array in arrays.items() if array is None}
    numbers = {name: array for name, array in arrays.items() if array is not None}
    return Table.of_arrays(source, KIND, numbers, labels, {name: list(each) for name, each in words.items()})


def _numbers(column: Any) -> NDArray[Any] | None:  # noqa: ANN401
    """Numbers of a column, with NaN for missing values and dates in UTC; None for a column without numbers."""
    if isinstance(column, np.ma.MaskedArray):
        fill = np.nan if column.dtype.kind in "iufb" else None
        column = np.ma.filled(column.astype(np.float64) if fill is not None else column, fill)
    if getattr(column, "ndim", 1) > 1 or getattr(column.dtype, "names", None):
        return np.asarray(column)
    kind = getattr(column.dtype, "kind", "") or column.to_numpy().dtype.kind  # polars types have no kind
    try:
        return np.asarray(column, dtype="datetime64[ns]" if kind == "M" else np.float64)
    except (TypeError, ValueError):
        return None


def words_of(column: Any) -> Any:  # noqa: ANN401
    """Values of a column; a missing value is None."""
    if hasattr(column, "notna"):
        return column.where(column.notna(), None)
    return column.to_list() if hasattr(column, "to_list") else np.asarray(column).tolist()


def _of_arrow(frame: Any, name: str) -> Table:  # noqa: ANN401
    """Table of the columns that a frame exports as an Arrow stream."""
    table = import_optional("pyarrow", "parquet", f"a {name}").table(frame)

    def batches(names: list[str]) -> Iterator[Any]:
        yield from table.select(names).to_batches(max_chunksize=BLOCK_ROWS)

    return table_of(KIND, table.schema, table.num_rows, batches, name)
