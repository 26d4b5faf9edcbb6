"""Tables in memory, recognised by their methods: their columns, and copies with other columns.

Supported are frames of pandas, Modin, Dask and polars, a mapping of columns, a structured array, a data set of xarray
and a relation of DuckDB; pyarrow makes a table of other objects with ``__arrow_c_stream__``. None of these packages is
imported here.

>>> table = {"mx": [1.0, 2.0], "my": [3.0, 4.0]}
>>> is_frame(table), list(columns_of(table)), is_frame([1.0, 2.0])
(True, ['mx', 'my'], False)
>>> with_columns(table, {"my": np.array([0.0, 0.0])})["my"], table["my"]
(array([0., 0.]), [3.0, 4.0])
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

    Columns = dict[str, Any]


class HasColumns(Protocol):
    """Any data frame; for type checkers."""

    @property
    def columns(self) -> Any: ...  # noqa: ANN401, D102


def is_frame(source: object) -> bool:
    """Whether an object is a table in memory, by its methods."""
    if isinstance(source, np.ndarray | list | tuple):
        return getattr(getattr(source, "dtype", None), "names", None) is not None
    if has_columns(source):
        return True
    is_one_column = hasattr(source, "dtype") or hasattr(source, "chunks")  # a series, or an array of Arrow
    return hasattr(source, "__arrow_c_stream__") and not is_one_column


def has_columns(frame: object) -> bool:
    """Whether an object is a frame whose columns `columns_of` can return."""
    return any(kind.accepts(frame) for kind in KINDS)


def columns_of(frame: Any) -> Columns:  # noqa: ANN401 - types of packages that may be missing
    """Columns of a frame by name: arrays, or the frame's own series."""
    return _kind_of(frame).columns(frame)


def with_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy a frame with (N,) columns that replace those of the same names, or are appended.

    Raises `UsageError` for a frame to which no columns can be written.
    """
    return _kind_of(frame).with_columns(frame, columns)


def labels_of(frame: Any) -> dict[str, Any]:  # noqa: ANN401
    """Labels of a frame's columns, by the text of each label."""
    if hasattr(frame, "collect_schema"):
        names = frame.collect_schema().names()
    elif (names := getattr(frame, "column_names", getattr(frame, "columns", None))) is None:
        names = frame.dtype.names if isinstance(frame, np.ndarray) else frame
    return {str(name): name for name in names}


def name_of(frame: object) -> str:
    """Type of a frame with its package, for messages.

    >>> name_of({}), name_of(np.zeros(2))
    ('dict', 'numpy ndarray')
    """
    package = type(frame).__module__.partition(".")[0]
    return type(frame).__name__ if package == "builtins" else f"{package} {type(frame).__name__}"


def is_pandas(frame: object) -> bool:
    """Whether an object has columns and an index, as frames of pandas, Modin and Dask do."""
    return all(hasattr(frame, name) for name in ("columns", "index", "items", "dtypes"))


class FrameKind(NamedTuple):
    """A kind of table in memory."""

    accepts: Callable[[Any], bool]
    columns: Callable[[Any], Columns]
    with_columns: Callable[[Any, Mapping[Any, Floats]], Any]


def _kind_of(frame: object) -> FrameKind:
    """First kind of table that accepts a frame; Arrow if none does."""
    return next((kind for kind in KINDS if kind.accepts(frame)), ARROW)


def _pandas_columns(frame: Any) -> Columns:  # noqa: ANN401
    """Columns by name; the index comes first if it has dates or a name."""
    frame = frame.compute() if hasattr(frame, "compute") else frame
    columns = {str(name): column for name, column in frame.items()}
    if frame.index.name or frame.index.dtype.kind == "M":
        columns = {str(frame.index.name or "time"): frame.index, **columns}
    return columns


def _with_pandas_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy with the same index."""
    if hasattr(frame, "compute"):
        raise _read_only_error(frame, "frame.compute()")
    copy = frame.copy()
    for name, values in columns.items():
        copy[name] = values
    return copy


def _polars_columns(frame: Any) -> Columns:  # noqa: ANN401
    """Columns by name; a lazy frame is evaluated."""
    frame = frame if hasattr(frame, "get_column") else frame.collect()
    return {name: frame.get_column(name) for name in frame.columns}


def _with_polars_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy, lazy if the frame is lazy."""
    if not hasattr(frame, "get_column"):
        return _with_polars_columns(frame.collect(), columns).lazy()
    series = _package_of(frame).Series
    return frame.with_columns([series(name, values) for name, values in columns.items()])


def _mapping_columns(frame: Mapping[Any, Any]) -> Columns:
    """Columns as arrays."""
    return {str(name): column if hasattr(column, "dtype") else np.asarray(column) for name, column in frame.items()}


def _structured_columns(frame: Any) -> Columns:  # noqa: ANN401
    """Fields of a structured array by name."""
    return {name: frame[name] for name in frame.dtype.names}


def _with_structured_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy of a structured array; replaced and new fields are float64."""
    replaced = {name: np.dtype((np.float64, values.shape[1:])) for name, values in columns.items()}
    kinds = {name: frame.dtype[name] for name in frame.dtype.names} | replaced
    copy = np.empty(frame.shape, dtype=list(kinds.items()))
    for name in kinds:
        copy[name] = columns[name] if name in columns else frame[name]
    return copy


def _xarray_columns(frame: Any) -> Columns:  # noqa: ANN401
    """Coordinates by name, then data variables."""
    return {str(name): np.asarray(frame[name]) for name in (*frame.coords, *frame.data_vars)}


def _with_xarray_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy; new columns get the dimension of the existing ones."""
    dims = next(frame[name].dims for name in columns if name in frame)
    return frame.assign({name: (dims, values) for name, values in columns.items()})


def _duckdb_columns(frame: Any) -> Columns:  # noqa: ANN401
    """Columns of a relation by name; runs its query."""
    return dict(frame.fetchnumpy())


def _with_arrow_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Copy of a pyarrow table with replaced or new columns."""
    if not hasattr(frame, "set_column"):
        raise _read_only_error(frame, "pyarrow.table(frame)")
    for name, values in columns.items():
        places = frame.schema.get_all_field_indices(name)
        array = _arrow_array(_package_of(frame), values)
        frame = frame.set_column(places[0], name, array) if places else frame.append_column(name, array)
    return frame


def _arrow_array(arrow: Any, values: Floats) -> Any:  # noqa: ANN401
    """Arrow array of (N,) numbers, or of N lists for (N, K) numbers."""
    flat = arrow.array(values.ravel())
    return flat if values.ndim == 1 else arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _refuse_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """Refuse a relation of DuckDB: a query cannot take columns of other tables."""
    del columns
    raise _read_only_error(frame, "frame.df()")


def _read_only_error(frame: object, instead: str) -> UsageError:
    """Error for a frame that takes no columns; `instead` is the expression to give in its place."""
    return UsageError(f"columns cannot be written to a {name_of(frame)}: give {instead} instead")


def _package_of(frame: object) -> Any:  # noqa: ANN401
    """Package of a data frame, such as pandas or polars, which is imported already."""
    return sys.modules[type(frame).__module__.partition(".")[0]]


KINDS: Final = (
    FrameKind(
        lambda frame: hasattr(frame, "get_column") or hasattr(frame, "collect_schema"),
        _polars_columns,
        _with_polars_columns,
    ),
    FrameKind(is_pandas, _pandas_columns, _with_pandas_columns),
    FrameKind(lambda frame: hasattr(frame, "data_vars"), _xarray_columns, _with_xarray_columns),
    FrameKind(lambda frame: isinstance(frame, Mapping), _mapping_columns, lambda frame, columns: {**frame, **columns}),
    FrameKind(
        lambda frame: bool(getattr(getattr(frame, "dtype", None), "names", None)),
        _structured_columns,
        _with_structured_columns,
    ),
    FrameKind(lambda frame: hasattr(frame, "fetchnumpy"), _duckdb_columns, _refuse_columns),
)
"""Kinds of tables with columns by name, in the order in which they are tried."""

ARROW: Final = FrameKind(lambda frame: hasattr(frame, "__arrow_c_stream__"), lambda _: {}, _with_arrow_columns)
"""Other objects with an Arrow stream, from which pyarrow makes a table."""
