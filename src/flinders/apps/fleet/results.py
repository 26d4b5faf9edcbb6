"""Results of a fleet: a row for each recording of each unit, with its calibration or the reason for its absence.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1).samples
>>> row = UnitResult(unit="A17", start_s=0.0, end_s=60.0, readings=len(tumble)).with_fit(calibrate.fit(tumble))
>>> row.verdict, row.code, len(row.covariance)
('good', '', 45)
>>> rows = UnitResults.of([UnitResult(unit="B02", verdict="failed", code="unreadable"), row]).sorted()
>>> rows.unit.tolist(), rows.verdict.tolist(), rows.offset.shape
(['A17', 'B02'], ['good', 'failed'], (2, 3))
>>> back = UnitResults.from_arrow(rows.to_arrow())
>>> back.code.tolist(), bool(np.array_equal(back.covariance, rows.covariance, equal_nan=True))
(['', 'unreadable'], True)

Unknown values are NaN here and null in Arrow and Parquet.
"""

from __future__ import annotations

import contextlib
import math
import re
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import accumulate, chain
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.files import reason_and_remedy
from flinders.errors import DocumentError
from flinders.fitting.batch import WIDTHS, FitColumns, fill_row
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Sequence, Sized

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

KEY: Final = ("unit", "recording", "start_s")
"""Columns by which the table is sorted."""
VERSION: Final = "1"
"""Version of the columns, in the metadata of a file."""
SIGN: Final = b"flinders.apps.fleet"
"""Key in the metadata of a file by which a table of a fleet is recognised."""
MAX_MESSAGE_LENGTH: Final = 500
"""Largest number of characters of a message."""

UNNAMED_UNIT: Final = re.compile(r"^(\(.*\))?$", re.DOTALL)
"""Pattern of unit names in rows about readings without a unit or about unreadable files."""


def _unknown_numbers(length: int) -> tuple[float, ...]:
    """`length` times NaN, for numbers that are not known."""
    return (math.nan,) * length


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitResult:
    """Result of one recording of one unit."""

    unit: str  #: name of the sensor or vehicle
    recording: str = ""  #: name of the recording; empty if the unit has one recording without a name
    start_s: float = math.nan  #: earliest time of its readings, s since 1970 if it has dates; NaN without times
    end_s: float = math.nan  # latest time
    readings: int = 0  #: number of readings in the recording
    samples: int = 0  #: number of readings that the fit used
    #: ``good``, ``limited``, ``refused``, or ``failed`` if it could not be read or calculated at all
    verdict: str = "failed"
    code: str = ""  #: code of the error of a refused or failed recording, else empty
    #: reason why it is not good: code of the first finding, or of the error; empty for a good one
    cause: str = ""
    message: str = ""  #: first sentence of the verdict, with the remedy
    number: float = math.nan  #: number of the finding in `cause`: docs/findings.md has its meaning and unit
    limit: float = math.nan  #: limit for `number`, in the same unit
    method: str = ""  #: method of the final fit
    worst_deg: float = math.nan  #: heading error of a level vehicle at the worst heading, 1 σ, at a dip of `dip_deg`
    rms_deg: float = math.nan  #: heading error of a level vehicle, rms over all headings, 1 σ
    bound_95_deg: float = math.nan  #: bound of the heading error over all headings, with a probability of 95 %
    dip_deg: float = math.nan  #: dip of the field that heading errors are for
    offset: tuple[float, ...] = _unknown_numbers(3)  #: 3 float, in `unit_of_field`
    matrix: tuple[float, ...] = _unknown_numbers(9)  #: 9 float: correction matrix, row by row
    #: 45 float: upper triangle, row by row, of the covariance `Claim.claimed_covariance` of
    #: (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃)
    covariance: tuple[float, ...] = _unknown_numbers(45)
    noise: float = math.nan  #: noise of the readings about the ellipsoid, 1 σ, in `unit_of_field`
    field_strength: float = math.nan  # strength of the corrected field, in `unit_of_field`
    coverage: float = math.nan  #: fraction of the sphere that was covered
    findings: tuple[str, ...] = ()  #: codes of all findings, the gravest first
    unit_of_field: str = ""  #: ``uT`` or ``counts``
    batch: str = ""  #: hardware batch of the unit; empty if it is not known

    def with_fit(self, fit: Fit) -> Self:
        """Row with the numbers of a fit; without a calibration if the fit is refused."""
        return replace(self._with_columns(fit), unit_of_field=fit.calibration.unit)

    def with_error(self, error: Exception) -> Self:
        """Row with an error: a refused fit, readings that cannot be fitted, or a file that cannot be read.

        >>> from flinders.errors import TooFewSamples
        >>> row = UnitResult(unit="A17", readings=5).with_error(TooFewSamples(found=5, needed=10, method="likelihood"))
        >>> row.verdict, row.code, row.message[:18]
        ('refused', 'too-few-samples', '5 usable readings,')
        """
        fit = getattr(error, "fit", None)
        return self._with_columns(error) if fit is None else self.with_fit(fit)

    def _with_columns(self, result: Fit | Exception) -> Self:
        """Row with the columns that a fit or an error determines."""
        columns = FitColumns.empty(1)
        fill_row(columns, 0, result)
        own = ("readings", "unit_of_field")
        cells = {
            each.name: _cell(getattr(columns, each.name)[0]) for each in fields(FitColumns) if each.name not in own
        }
        return replace(self, **cells | {"message": one_line(cells["message"])})


NAMES: Final = tuple(field.name for field in fields(UnitResult))
"""Names of the columns, in order."""
LISTS: Final = WIDTHS
"""Columns of lists, with their lengths; the numbers of a list are known or missing together."""
TEXTS, COUNTS, NUMBERS = (
    tuple(field.name for field in fields(UnitResult) if field.type == kind) for kind in ("str", "int", "float")
)
"""Columns of text, of whole numbers, and of a number that may be missing."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class UnitResults(FitColumns):
    """Rows of a fleet as columns: an (R,) array for each field of `UnitResult`, (R, K) for a field that is a list."""

    unit: NDArray[np.object_]
    recording: NDArray[np.object_]
    start_s: Floats
    end_s: Floats
    batch: NDArray[np.object_]

    @classmethod
    def of(cls, rows: Sequence[UnitResult]) -> Self:
        """Make columns from rows."""
        return cls(**{name: _column(name, [getattr(row, name) for row in rows]) for name in NAMES})

    @classmethod
    def join(cls, parts: Iterable[UnitResults]) -> Self:
        """Concatenate tables."""
        tables = list(parts)
        if not tables:
            return cls.of(())
        return cls(**{name: np.concatenate([getattr(part, name) for part in tables]) for name in NAMES})

    def __repr__(self) -> str:
        counts = ", ".join(f"{count:,} {verdict}" for verdict, count in self.verdicts().items())
        return f"UnitResults({counts or 'empty'})"

    def __getitem__(self, rows: slice | NDArray[Any] | Sequence[int]) -> Self:
        """Select some rows."""
        return type(self)(**{name: getattr(self, name)[rows] for name in NAMES})

    def row(self, place: int) -> UnitResult:
        """Row number `place` as a `UnitResult`."""
        return UnitResult(**{name: _cell(getattr(self, name)[place]) for name in NAMES})

    def verdicts(self) -> dict[str, int]:
        """Number of rows of each verdict that occurs, the best first."""
        return {name: count for name in VERDICTS if (count := int(np.count_nonzero(self.verdict == name)))}

    def sorted(self) -> Self:
        """Rows sorted by `KEY`, those without a time last."""
        start = np.where(np.isnan(self.start_s), np.inf, self.start_s).tolist()
        keys = list(zip(self.unit.tolist(), self.recording.tolist(), start, strict=True))
        return self[np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.intp)]

    def to_arrow(self) -> Any:  # noqa: ANN401 - pyarrow ships no types
        """Convert to an Arrow table.

        Raises `MissingExtra` if pyarrow is not installed.
        """
        arrow = needs_arrow()
        arrays = [_array(arrow, name, getattr(self, name)) for name in NAMES]
        return arrow.Table.from_arrays(arrays, schema=schema())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Stream of Arrow: ``polars.DataFrame(rows)``, ``pyarrow.table(rows)`` and DuckDB take the rows as they are."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> Any:  # noqa: ANN401
        """Convert to a pandas data frame, with NaN for missing numbers; raises as `to_arrow`, and ImportError."""
        return self.to_arrow().to_pandas()

    @classmethod
    def from_arrow(cls, table: Any) -> Self:  # noqa: ANN401
        """Convert an Arrow table that has the columns of `schema`.

        Raises `DocumentError` if columns are missing.
        """
        refuse_other_table(table.column_names, NAMES)
        return cls(**{name: _from_arrow(name, table.column(name)) for name in NAMES})

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a Parquet file of `flinders fleet`.

        Raises
        ------
        DocumentError
            If the file is no table of a fleet.
        """
        needs_arrow()
        from pyarrow import parquet

        with reading_table(path):
            table = parquet.read_table(path, page_checksum_verification=True)
        return cls.from_arrow(table)

    def to_bytes(self) -> bytes:
        """Write the rows as the bytes of an Arrow file, which a worker returns."""
        arrow = needs_arrow()
        table = self.to_arrow()
        sink = arrow.BufferOutputStream()
        with arrow.ipc.new_file(sink, table.schema) as writer:
            writer.write_table(table)
        return bytes(sink.getvalue().to_pybytes())

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """Read the bytes that `to_bytes` has made."""
        return cls.from_arrow(needs_arrow().ipc.open_file(content).read_all())


VERDICTS: Final = ("good", "limited", "refused", "failed")
"""Verdicts of rows, from the best to the worst."""


@cache
def needs_arrow() -> Any:  # noqa: ANN401
    """Import pyarrow, which writes the table of a fleet; raises MissingExtra."""
    import_optional("pyarrow.ipc", "fleet", "the table of a fleet")
    return import_optional("pyarrow", "fleet", "the table of a fleet")


@contextlib.contextmanager
def reading_table(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn errors of reading a table of a fleet into `DocumentError`."""
    from pyarrow.lib import ArrowException

    try:
        yield
    except (OSError, ArrowException) as error:
        is_of_system = isinstance(error, OSError) and error.errno is not None
        why = f": {reason_and_remedy(error)}" if is_of_system else f" ({error}): need a table of `flinders fleet`"
        raise DocumentError(f"{path}: cannot be read as a table of a fleet{why}") from None


def refuse_other_table(names: Sequence[str], needed: Sequence[str], path: str | os.PathLike[str] = "") -> None:
    """Refuse a table that lacks columns of `flinders fleet`: raises DocumentError."""
    missing = [name for name in needed if name in NAMES and name not in names]
    if missing:
        where = f"{path}: " if path else ""
        raise DocumentError(
            f"{where}this is no table of a fleet: it has no {', '.join(missing)}; make one with `flinders fleet`"
        )


@cache
def schema(added: tuple[str, ...] = ()) -> Any:  # noqa: ANN401
    """Arrow schema of the table; `added` are columns of texts after the fixed ones."""
    arrow = needs_arrow()
    kinds = {
        **dict.fromkeys(TEXTS, arrow.string()),
        **dict.fromkeys(COUNTS, arrow.int64()),
        **dict.fromkeys(NUMBERS, arrow.float64()),
        **{name: arrow.list_(arrow.float64(), length) for name, length in LISTS.items()},
        "findings": arrow.list_(arrow.string()),
    }
    columns = [*((name, kinds[name]) for name in NAMES), *((name, arrow.string()) for name in added)]
    return arrow.schema(columns, metadata={SIGN: VERSION})


def _column(name: str, cells: Sequence[Any]) -> NDArray[Any]:
    """Make a NumPy column from the cells of rows."""
    if name in LISTS:
        return np.array(cells, dtype=float).reshape(len(cells), LISTS[name])
    if name in NUMBERS:
        return np.array(cells, dtype=float)
    if name in COUNTS:
        return np.array(cells, dtype=np.int64)
    return objects(cells)


def objects(cells: Sequence[Any]) -> NDArray[np.object_]:
    """(R,) array of texts, or of tuples of them."""
    column = np.empty(len(cells), dtype=object)
    for place, cell in enumerate(cells):  # a slice would make a matrix of tuples of equal length
        column[place] = cell
    return column


def one_line(message: str) -> str:
    """Message in one line of at most `MAX_MESSAGE_LENGTH` characters."""
    return " ".join(message.split())[:MAX_MESSAGE_LENGTH]


def _cell(cell: Any) -> Any:  # noqa: ANN401
    """Convert a cell of a NumPy column to a Python value."""
    if isinstance(cell, np.ndarray):
        return tuple(cell.tolist())
    return cell.item() if isinstance(cell, np.generic) else cell


def _array(arrow: Any, name: str, column: NDArray[Any]) -> Any:  # noqa: ANN401
    """Arrow array of a column, null for NaN. `pyarrow.array` is not used: it imports pandas, 0.25 s and 30 MB."""
    if name in COUNTS:
        return integers(arrow, column)
    kind = schema().field(name).type
    if name in NUMBERS:
        values = np.asarray(column, dtype=float)
        return _primitive(kind, values, ~np.isnan(values))
    if name in LISTS:
        values = np.asarray(column, dtype=float)
        known = _validity(~np.isnan(values).all(axis=1))
        flat = _primitive(kind.value_type, values.ravel())
        return arrow.Array.from_buffers(kind, len(values), [known], children=[flat])
    if name == "findings":
        cells = column.tolist()
        codes = strings(arrow, list(chain.from_iterable(cells)))
        return arrow.Array.from_buffers(kind, len(cells), [None, _offsets(cells)], children=[codes])
    return strings(arrow, column.tolist())


def _primitive(kind: Any, column: NDArray[Any], known: NDArray[np.bool_] | None = None) -> Any:  # noqa: ANN401
    """Arrow array of an (R,) column of numbers, without a copy; null where `known` is False."""
    arrow = needs_arrow()
    buffers = [None if known is None else _validity(known), arrow.py_buffer(np.ascontiguousarray(column))]
    return arrow.Array.from_buffers(kind, len(column), buffers)


def integers(arrow: Any, column: NDArray[Any]) -> Any:  # noqa: ANN401
    """Arrow array of whole numbers."""
    return _primitive(arrow.int64(), column.astype(np.int64, copy=False))


def strings(arrow: Any, texts: Sequence[str]) -> Any:  # noqa: ANN401
    """Arrow array of texts."""
    encoded = list(map(str.encode, texts))
    buffers = [None, _offsets(encoded), arrow.py_buffer(b"".join(encoded))]
    return arrow.Array.from_buffers(arrow.string(), len(encoded), buffers)


def _offsets(cells: Sequence[Sized]) -> Any:  # noqa: ANN401
    """Arrow buffer of the start of each cell in the joined values, and the end of the last."""
    ends = accumulate(map(len, cells), initial=0)
    return needs_arrow().py_buffer(np.fromiter(ends, np.int32, len(cells) + 1))


def _validity(known: NDArray[np.bool_]) -> Any:  # noqa: ANN401
    """Arrow buffer with a bit for each row: 1 if it is not null."""
    return needs_arrow().py_buffer(np.packbits(known, bitorder="little"))


def _from_arrow(name: str, column: Any) -> NDArray[Any]:  # noqa: ANN401
    """Convert an Arrow column to NumPy, with NaN for null."""
    column = column.combine_chunks()
    if name in LISTS:
        return lists(column, LISTS[name])
    if name in NUMBERS:
        return numbers(column)
    if name in COUNTS:
        return np.array(np.from_dlpack(column), dtype=np.int64)
    cells = column.to_pylist()
    return objects([tuple(cell or ()) for cell in cells] if name == "findings" else [cell or "" for cell in cells])


def numbers(column: Any) -> Floats:  # noqa: ANN401
    """(R,) cells of a column of numbers, NaN for null."""
    column = _one_chunk(column)
    cells = np.full(len(column), np.nan)
    cells[flags(column.is_valid())] = np.from_dlpack(column.drop_null())
    return cells


def flags(column: Any) -> NDArray[np.bool_]:  # noqa: ANN401
    """(R,) cells of a column of true and false, none of them null."""
    return np.array(np.from_dlpack(_one_chunk(column.cast("uint8"))), dtype=bool)


def _one_chunk(column: Any) -> Any:  # noqa: ANN401
    """Column in one chunk, which NumPy can read without pandas."""
    return column.combine_chunks() if hasattr(column, "combine_chunks") else column


def lists(column: Any, length: int) -> Floats:  # noqa: ANN401
    """(R, length) cells of a column of lists, NaN for null."""
    column = _one_chunk(column)
    rows = np.full((len(column), length), np.nan)
    cells = np.array(np.from_dlpack(column.drop_null().flatten()), dtype=float)
    rows[flags(column.is_valid())] = cells.reshape(-1, length)
    return rows


def named_rows(table: Any) -> Any:  # noqa: ANN401
    """Rows of a table that have a unit, without rows of files that failed before their unit was known."""
    from pyarrow import array

    units = texts(table.column("unit"))
    unnamed = {unit for unit in set(units) if UNNAMED_UNIT.search(unit)}
    if not unnamed:
        return table
    verdicts = texts(table.column("verdict"))
    unnamed -= {unit for unit, verdict in zip(units, verdicts, strict=True) if verdict != "failed"}
    return table.filter(array([unit not in unnamed for unit in units]))


def texts(column: Any) -> list[str]:  # noqa: ANN401
    """Cells of a column as texts, empty for null."""
    return [cell or "" for cell in column.cast("string").to_pylist()]
