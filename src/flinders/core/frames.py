"""Tables in memory by what they can do: columns out of them, and a copy with other columns.

Frames of pandas, Modin, Dask and polars, a mapping of columns, a structured array, a data set of xarray and a relation
of DuckDB hand out their columns; of whatever else has ``__arrow_c_stream__`` pyarrow makes a table. No package is
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
    """A data frame, for type checkers."""

    @property
    def columns(self) -> Any: ...  # noqa: ANN401, D102


def is_frame(source: object) -> bool:
    """Whether this is a table in memory, by what it can do."""
    if isinstance(source, np.ndarray | list | tuple):
        return getattr(getattr(source, "dtype", None), "names", None) is not None
    if hands_out_columns(source):
        return True
    is_one_column = hasattr(source, "dtype") or hasattr(source, "chunks")  # a series, or an array of Arrow
    return hasattr(source, "__arrow_c_stream__") and not is_one_column


def hands_out_columns(frame: object) -> bool:
    """Whether `columns_of` takes it."""
    return any(kind.accepts(frame) for kind in KINDS)


def columns_of(frame: Any) -> Columns:  # noqa: ANN401 - of packages that need not be there
    """Columns by name, as the frame has them: arrays, or its own series."""
    return _kind_of(frame).columns(frame)


def with_columns(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A copy with these columns, (N,) each, in the place of those of the same names, or after the others.

    Raises `UsageError` for a frame that cannot be given back.
    """
    return _kind_of(frame).with_columns(frame, columns)


def labels_of(frame: Any) -> dict[str, Any]:  # noqa: ANN401
    """Names of the columns as text, with each as the frame has it."""
    if hasattr(frame, "collect_schema"):
        names = frame.collect_schema().names()
    elif (names := getattr(frame, "column_names", getattr(frame, "columns", None))) is None:
        names = frame.dtype.names if isinstance(frame, np.ndarray) else frame
    return {str(name): name for name in names}


def name_of(frame: object) -> str:
    """What messages call it.

    >>> name_of({}), name_of(np.zeros(2))
    ('dict', 'numpy ndarray')
    """
    package = type(frame).__module__.partition(".")[0]
    return type(frame).__name__ if package == "builtins" else f"{package} {type(frame).__name__}"


def is_pandas(frame: object) -> bool:
    """Whether it has columns and an index, as frames of pandas, Modin and Dask do."""
    return all(hasattr(frame, name) for name in ("columns", "index", "items", "dtypes"))


class FrameKind(NamedTuple):
    """A kind of table in memory."""

    accepts: Callable[[Any], bool]
    columns: Callable[[Any], Columns]
    with_columns: Callable[[Any, Mapping[Any, Floats]], Any]


def _kind_of(frame: object) -> FrameKind:
    """The first kind that takes it."""
    return next((kind for kind in KINDS if kind.accepts(frame)), ARROW)


def _of_pandas(frame: Any) -> Columns:  # noqa: ANN401
    """Columns by name; the index comes first, where it is dates or has a name."""
    frame = frame.compute() if hasattr(frame, "compute") else frame
    columns = {str(name): column for name, column in frame.items()}
    if frame.index.name or frame.index.dtype.kind == "M":
        columns = {str(frame.index.name or "time"): frame.index, **columns}
    return columns


def _pandas_with(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A copy, with the same index."""
    if hasattr(frame, "compute"):
        raise _not_given_back(frame, "frame.compute()")
    copy = frame.copy()
    for name, values in columns.items():
        copy[name] = values
    return copy


def _of_polars(frame: Any) -> Columns:  # noqa: ANN401
    """Columns by name; a lazy frame is collected."""
    frame = frame if hasattr(frame, "get_column") else frame.collect()
    return {name: frame.get_column(name) for name in frame.columns}


def _polars_with(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A copy; of a lazy frame a lazy one."""
    if not hasattr(frame, "get_column"):
        return _polars_with(frame.collect(), columns).lazy()
    series = _package_of(frame).Series
    return frame.with_columns([series(name, values) for name, values in columns.items()])


def _of_mapping(frame: Mapping[Any, Any]) -> Columns:
    """Columns as arrays."""
    return {str(name): column if hasattr(column, "dtype") else np.asarray(column) for name, column in frame.items()}


def _of_structured(frame: Any) -> Columns:  # noqa: ANN401
    """Fields of records."""
    return {name: frame[name] for name in frame.dtype.names}


def _structured_with(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A copy of records; fields that are replaced or new hold double-precision numbers."""
    replaced = {name: np.dtype((np.float64, values.shape[1:])) for name, values in columns.items()}
    kinds = {name: frame.dtype[name] for name in frame.dtype.names} | replaced
    copy = np.empty(frame.shape, dtype=list(kinds.items()))
    for name in kinds:
        copy[name] = columns[name] if name in columns else frame[name]
    return copy


def _of_xarray(frame: Any) -> Columns:  # noqa: ANN401
    """Coordinates, then variables."""
    return {str(name): np.asarray(frame[name]) for name in (*frame.coords, *frame.data_vars)}


def _xarray_with(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A copy; columns that are new have the dimension of the others."""
    dims = next(frame[name].dims for name in columns if name in frame)
    return frame.assign({name: (dims, values) for name, values in columns.items()})


def _of_duckdb(frame: Any) -> Columns:  # noqa: ANN401
    """Columns of a relation, which is run."""
    return dict(frame.fetchnumpy())


def _arrow_with(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A table of pyarrow with other columns."""
    if not hasattr(frame, "set_column"):
        raise _not_given_back(frame, "pyarrow.table(frame)")
    for name, values in columns.items():
        places = frame.schema.get_all_field_indices(name)
        array = _arrow_array(_package_of(frame), values)
        frame = frame.set_column(places[0], name, array) if places else frame.append_column(name, array)
    return frame


def _arrow_array(arrow: Any, values: Floats) -> Any:  # noqa: ANN401
    """A column of numbers, or of (N, K) lists of K numbers."""
    flat = arrow.array(values.ravel())
    return flat if values.ndim == 1 else arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _refused(frame: Any, columns: Mapping[Any, Floats]) -> Any:  # noqa: ANN401
    """A relation of DuckDB is a query, which holds no columns of others."""
    del columns
    raise _not_given_back(frame, "frame.df()")


def _not_given_back(frame: object, instead: str) -> UsageError:
    """What to give in the place of a frame that takes no columns."""
    return UsageError(f"a {name_of(frame)} is read, and takes no columns: give {instead}, which does")


def _package_of(frame: object) -> Any:  # noqa: ANN401
    """The package of a frame, which is loaded where there is one."""
    return sys.modules[type(frame).__module__.partition(".")[0]]


KINDS: Final = (
    FrameKind(lambda frame: hasattr(frame, "get_column") or hasattr(frame, "collect_schema"), _of_polars, _polars_with),
    FrameKind(is_pandas, _of_pandas, _pandas_with),
    FrameKind(lambda frame: hasattr(frame, "data_vars"), _of_xarray, _xarray_with),
    FrameKind(lambda frame: isinstance(frame, Mapping), _of_mapping, lambda frame, columns: {**frame, **columns}),
    FrameKind(
        lambda frame: bool(getattr(getattr(frame, "dtype", None), "names", None)), _of_structured, _structured_with
    ),
    FrameKind(lambda frame: hasattr(frame, "fetchnumpy"), _of_duckdb, _refused),
)
"""Kinds of tables that hand out their columns, in the order in which they are asked."""

ARROW: Final = FrameKind(lambda frame: hasattr(frame, "__arrow_c_stream__"), lambda _: {}, _arrow_with)
"""Whatever hands out a stream of Arrow: pyarrow makes a table of it."""
