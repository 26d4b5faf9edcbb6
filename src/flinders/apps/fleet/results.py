"""Results of a fleet: a row for each recording of each unit, with its calibration or the reason why there is none.

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

import heapq
import math
import re
from collections import Counter
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import accumulate, chain, islice
from typing import TYPE_CHECKING, Any, Final, Self, TextIO, TypeAlias, cast

import numpy as np

from flinders.core.files import replacing
from flinders.errors import DocumentError, needs
from flinders.fitting.batch import WIDTHS, FitColumns, fill_row

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
    from pathlib import Path

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

    RowKey: TypeAlias = tuple[str, str, float]  # cells of `KEY`

KEY: Final = ("unit", "recording", "start_s")
"""Columns by which the table is sorted."""
VERSION: Final = "1"
"""Version of the columns, in the metadata of a file."""
SIGN: Final = b"flinders.apps.fleet"
"""Key of that metadata, by which a table of a fleet is recognised."""
GROUP: Final = 65_536
"""Rows in a row group of the table."""
LONGEST: Final = 500
"""Characters of a message, at most."""

UNNAMED: Final = re.compile(r"^(\(.*\))?$", re.DOTALL)
"""In place of a unit's name, in rows of readings without a unit and of unreadable files."""
LEVEL: Final = 3
"""Level of compression; settings of the writer are fixed, so that the same rows are the same bytes."""


def _missing(length: int) -> tuple[float, ...]:
    """Unknown numbers."""
    return (math.nan,) * length


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitResult:
    """Result of one recording of one unit."""

    unit: str  #: name of the sensor or vehicle
    recording: str = ""  #: name of the recording; empty if the unit has one recording without a name
    start_s: float = math.nan  #: earliest time of its readings, s since 1970 if it has dates; NaN without times
    end_s: float = math.nan  # latest time
    readings: int = 0  #: those there were
    samples: int = 0  #: those that the fit used
    #: ``good``, ``limited``, ``refused``, or ``failed`` if it could not be read or calculated at all
    verdict: str = "failed"
    code: str = ""  #: of the error of a refused or failed one, else empty
    message: str = ""  #: of the same error
    method: str = ""  #: method of the final fit
    worst_deg: float = math.nan  #: heading error of a level vehicle at the worst heading, 1 σ, at a dip of `dip_deg`
    rms_deg: float = math.nan  #: the same over all headings
    bound_95_deg: float = math.nan  #: heading error that it stays within at all headings with a probability of 95 %
    dip_deg: float = math.nan  #: dip of the field that heading errors are for
    offset: tuple[float, ...] = _missing(3)  #: 3 float, in `unit_of_field`
    matrix: tuple[float, ...] = _missing(9)  #: 9 float: row by row
    #: 45 float: of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), as `Claim.claimed_covariance`: its upper triangle, row by row
    covariance: tuple[float, ...] = _missing(45)
    noise: float = math.nan  #: of the readings about the ellipsoid, in `unit_of_field`
    field_strength: float = math.nan  # strength of the corrected field, in `unit_of_field`
    coverage: float = math.nan  #: fraction of the sphere that was covered
    findings: tuple[str, ...] = ()  #: codes, by severity
    unit_of_field: str = ""  #: ``uT`` or ``counts``
    batch: str = ""  #: hardware batch of the unit; empty if it is not known

    def with_fit(self, fit: Fit) -> Self:
        """Row with a fit; one that is refused gives no calibration."""
        return replace(self._filled(fit), unit_of_field=fit.calibration.unit)

    def with_error(self, error: Exception) -> Self:
        """Row with an error: a fit that was refused, readings without one, or a file that cannot be read.

        >>> from flinders.errors import TooFewSamples
        >>> row = UnitResult(unit="A17", readings=5).with_error(TooFewSamples(found=5, needed=10, method="likelihood"))
        >>> row.verdict, row.code, row.message[:18]
        ('refused', 'too-few-samples', '5 usable readings,')
        """
        fit = getattr(error, "fit", None)
        return self._filled(error) if fit is None else self.with_fit(fit)

    def _filled(self, result: Fit | Exception) -> Self:
        """Row with the columns of a fit or an error."""
        columns = FitColumns.empty(1)
        fill_row(columns, 0, result)
        own = ("readings", "unit_of_field")
        cells = {
            each.name: _cell(getattr(columns, each.name)[0]) for each in fields(FitColumns) if each.name not in own
        }
        return replace(self, **cells | {"message": one_line(cells["message"])})


NAMES: Final = tuple(field.name for field in fields(UnitResult))
"""The columns, in order."""
LISTS: Final = WIDTHS
"""Columns of so many numbers, which are missing together."""
TEXTS, COUNTS, NUMBERS = (
    tuple(field.name for field in fields(UnitResult) if field.type == kind) for kind in ("str", "int", "float")
)
"""Columns of text, of whole numbers, and of a number that may be missing."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class UnitResults(FitColumns):
    """Many rows, column by column: (R,) arrays by the names of `UnitResult`, and (R, K) ones for its lists."""

    unit: NDArray[np.object_]
    recording: NDArray[np.object_]
    start_s: Floats
    end_s: Floats
    batch: NDArray[np.object_]

    @classmethod
    def of(cls, rows: Sequence[UnitResult]) -> Self:
        """Make columns of rows."""
        return cls(**{name: _column(name, [getattr(row, name) for row in rows]) for name in NAMES})

    @classmethod
    def joined(cls, parts: Iterable[UnitResults]) -> Self:
        """Concatenate tables."""
        tables = list(parts)
        if not tables:
            return cls.of(())
        return cls(**{name: np.concatenate([getattr(part, name) for part in tables]) for name in NAMES})

    def __repr__(self) -> str:
        counts = ", ".join(f"{count:,} {verdict}" for verdict, count in self.verdicts().items())
        return f"UnitResults({counts or 'empty'})"

    def __getitem__(self, rows: slice | NDArray[Any] | Sequence[int]) -> Self:
        """Take some rows."""
        return type(self)(**{name: getattr(self, name)[rows] for name in NAMES})

    def row(self, place: int) -> UnitResult:
        """One row."""
        return UnitResult(**{name: _cell(getattr(self, name)[place]) for name in NAMES})

    def verdicts(self) -> dict[str, int]:
        """Number of rows of each verdict that occurs, the best first."""
        return {name: count for name in VERDICTS if (count := int(np.count_nonzero(self.verdict == name)))}

    def sorted(self) -> Self:
        """Sorted by `KEY`, rows without a time last."""
        start = np.where(np.isnan(self.start_s), np.inf, self.start_s).tolist()
        keys = list(zip(self.unit.tolist(), self.recording.tolist(), start, strict=True))
        return self[np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.intp)]

    def to_arrow(self) -> Any:  # noqa: ANN401 - pyarrow ships no types
        """As a table of Arrow.

        Raises `MissingExtra` if pyarrow is not installed.
        """
        arrow = needs_arrow()
        arrays = [_array(arrow, name, getattr(self, name)) for name in NAMES]
        return arrow.Table.from_arrays(arrays, schema=schema())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Stream of Arrow: ``polars.DataFrame(rows)``, ``pyarrow.table(rows)`` and DuckDB take the rows as they are."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> Any:  # noqa: ANN401
        """As a data frame of pandas, missing numbers as NaN; raises as `to_arrow`, and ImportError without pandas."""
        return self.to_arrow().to_pandas()

    @classmethod
    def from_arrow(cls, table: Any) -> Self:  # noqa: ANN401
        """From a table of Arrow that has the columns of `schema`.

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
            If it is none.
        """
        needs_arrow()
        from pyarrow import parquet
        from pyarrow.lib import ArrowException

        try:
            table = parquet.read_table(path, page_checksum_verification=True)
        except (OSError, ArrowException) as error:
            raise DocumentError(
                f"{path}: cannot be read as a table of a fleet ({error}): need what `flinders fleet` writes"
            ) from None
        return cls.from_arrow(table)

    def to_bytes(self) -> bytes:
        """As an Arrow file, which a worker returns."""
        arrow = needs_arrow()
        table = self.to_arrow()
        sink = arrow.BufferOutputStream()
        with arrow.ipc.new_file(sink, table.schema) as writer:
            writer.write_table(table)
        return bytes(sink.getvalue().to_pybytes())

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """From `to_bytes`."""
        return cls.from_arrow(needs_arrow().ipc.open_file(content).read_all())


VERDICTS: Final = ("good", "limited", "refused", "failed")
"""From the best to the worst."""


@cache
def needs_arrow() -> Any:  # noqa: ANN401
    """Import pyarrow, which writes the table of a fleet; raises MissingExtra."""
    needs("pyarrow.ipc", "fleet", "the table of a fleet")
    return needs("pyarrow", "fleet", "the table of a fleet")


def refuse_other_table(names: Sequence[str], needed: Sequence[str], path: str | os.PathLike[str] = "") -> None:
    """Refuse a table that lacks columns of `flinders fleet`: raises DocumentError."""
    missing = [name for name in needed if name in NAMES and name not in names]
    if missing:
        where = f"{path}: " if path else ""
        raise DocumentError(
            f"{where}this is no table of a fleet: it has no {', '.join(missing)}; make one with `flinders fleet`"
        )


@cache
def schema() -> Any:  # noqa: ANN401
    """Columns and types of the table in Arrow and Parquet."""
    arrow = needs_arrow()
    kinds = {
        **dict.fromkeys(TEXTS, arrow.string()),
        **dict.fromkeys(COUNTS, arrow.int64()),
        **dict.fromkeys(NUMBERS, arrow.float64()),
        **{name: arrow.list_(arrow.float64(), length) for name, length in LISTS.items()},
        "findings": arrow.list_(arrow.string()),
    }
    return arrow.schema([(name, kinds[name]) for name in NAMES], metadata={SIGN: VERSION})


def _column(name: str, cells: Sequence[Any]) -> NDArray[Any]:
    """Column of the cells of rows."""
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
    for place, cell in enumerate(cells):  # a slice would take tuples of one length for rows of a matrix
        column[place] = cell
    return column


def one_line(message: str) -> str:
    """A message as it stands in the table."""
    return " ".join(message.split())[:LONGEST]


def _cell(cell: Any) -> Any:  # noqa: ANN401
    """Cell of a column as a value of Python."""
    if isinstance(cell, np.ndarray):
        return tuple(cell.tolist())
    return cell.item() if isinstance(cell, np.generic) else cell


def _array(arrow: Any, name: str, column: NDArray[Any]) -> Any:  # noqa: ANN401
    """Column as Arrow, null for NaN; `pyarrow.array` is not used, as it imports pandas: 0.25 s and 30 MB a process."""
    if name in COUNTS:
        return _integers(arrow, column)
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
        codes = _strings(arrow, list(chain.from_iterable(cells)))
        return arrow.Array.from_buffers(kind, len(cells), [None, _offsets(cells)], children=[codes])
    return _strings(arrow, column.tolist())


def _primitive(kind: Any, column: NDArray[Any], known: NDArray[np.bool_] | None = None) -> Any:  # noqa: ANN401
    """Numbers of a type of Arrow from the memory of (R,) a column, null where they are not known."""
    arrow = needs_arrow()
    buffers = [None if known is None else _validity(known), arrow.py_buffer(np.ascontiguousarray(column))]
    return arrow.Array.from_buffers(kind, len(column), buffers)


def _integers(arrow: Any, column: NDArray[Any]) -> Any:  # noqa: ANN401
    """Whole numbers as Arrow."""
    return _primitive(arrow.int64(), column.astype(np.int64, copy=False))


def _strings(arrow: Any, texts: Sequence[str]) -> Any:  # noqa: ANN401
    """Texts as Arrow."""
    encoded = list(map(str.encode, texts))
    buffers = [None, _offsets(encoded), arrow.py_buffer(b"".join(encoded))]
    return arrow.Array.from_buffers(arrow.string(), len(encoded), buffers)


def _offsets(cells: Sequence[Sized]) -> Any:  # noqa: ANN401
    """Where each of some cells begins in the values of all, and where the last ends."""
    ends = accumulate(map(len, cells), initial=0)
    return needs_arrow().py_buffer(np.fromiter(ends, np.int32, len(cells) + 1))


def _validity(known: NDArray[np.bool_]) -> Any:  # noqa: ANN401
    """Which rows are not null, a bit for each."""
    return needs_arrow().py_buffer(np.packbits(known, bitorder="little"))


def _from_arrow(name: str, column: Any) -> NDArray[Any]:  # noqa: ANN401
    """Column from Arrow, NaN for null."""
    column = column.combine_chunks()
    if name in LISTS:
        return lists(column, LISTS[name])
    if name in NUMBERS:
        return numbers(column)
    if name in COUNTS:
        return np.array(column.to_numpy(zero_copy_only=False), dtype=np.int64)
    cells = column.to_pylist()
    return objects([tuple(cell or ()) for cell in cells] if name == "findings" else [cell or "" for cell in cells])


def numbers(column: Any) -> Floats:  # noqa: ANN401
    """(R,) cells of a column of numbers, NaN for null."""
    return np.array(column.to_numpy(zero_copy_only=False), dtype=float)


def lists(column: Any, length: int) -> Floats:  # noqa: ANN401
    """(R, length) cells of a column of lists, NaN for null."""
    column = column.combine_chunks() if hasattr(column, "combine_chunks") else column
    rows = np.full((len(column), length), np.nan)
    known = np.asarray(column.is_valid())
    rows[known] = np.asarray(column.drop_null().flatten(), dtype=float).reshape(-1, length)
    return rows


def named_rows(table: Any) -> Any:  # noqa: ANN401
    """Rows of a table that have a unit: not those of files that failed before one was known."""
    from pyarrow import array

    units = texts(table.column("unit"))
    unnamed = {unit for unit in set(units) if UNNAMED.search(unit)}
    if not unnamed:
        return table
    verdicts = texts(table.column("verdict"))
    unnamed -= {unit for unit, verdict in zip(units, verdicts, strict=True) if verdict != "failed"}
    return table.filter(array([unit not in unnamed for unit in units]))


def texts(column: Any) -> list[str]:  # noqa: ANN401
    """Cells of a column as texts, empty for null."""
    return [cell or "" for cell in column.cast("string").to_pylist()]


# ------------------------------------------------------------------------------------------------------------- merge


def merge(parts: Sequence[Path], out: str | os.PathLike[str]) -> None:
    """Merge Arrow files of rows, each sorted by `KEY`, into a Parquet file; of equal rows the first come first.

    A file is opened when its first row comes next, and a row group is taken from a few files, so that memory is that of
    a row group. Raises OutputError.

    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name, units in (("a", ["A1", "A3"]), ("b", ["A2", "A4"])):
    ...     _ = (folder / name).write_bytes(UnitResults.of([UnitResult(unit=unit) for unit in units]).to_bytes())
    >>> merge([folder / "a", folder / "b"], folder / "all.parquet")
    >>> UnitResults.read(folder / "all.parquet").unit.tolist()
    ['A1', 'A2', 'A3', 'A4']
    """
    needs_arrow()
    with replacing(out, force=True) as file:
        _write(_groups(parts), cast("TextIO", file).buffer)


def _write(groups: Iterator[Any], file: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
    """Write row groups."""
    from pyarrow import parquet

    options: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": LEVEL,
        "version": "2.6",
        "use_dictionary": [*TEXTS, "findings.list.element"],
        "write_page_checksum": True,
    }
    with parquet.ParquetWriter(file, schema(), **options) as writer:
        for group in groups:
            writer.write_table(group, row_group_size=GROUP)


def _groups(parts: Sequence[Path]) -> Iterator[Any]:
    """Tables of the rows of one row group each, in order."""
    rows = _rows(parts)
    while group := list(islice(rows, GROUP)):
        yield _gathered(parts, np.array(group))


def _rows(parts: Sequence[Path]) -> Iterator[tuple[int, int]]:
    """Yield the number of a file and that of a row in it, in order of the rows."""
    for _, place, row in heapq.merge(*(_keyed(place, path) for place, path in enumerate(parts))):
        yield place, row


def _keyed(place: int, path: Path) -> Iterator[tuple[RowKey, int, int]]:
    """Rows of a file with their keys; all but the first are read when its turn comes."""
    yield from ((key, place, 0) for key in _keys(_mapped(path).slice(0, 1)))
    yield from ((key, place, row) for row, key in enumerate(_keys(_mapped(path).slice(1)), 1))


def _mapped(path: Path) -> Any:  # noqa: ANN401
    """Rows of a file, mapped into memory and not read."""
    arrow = needs_arrow()
    return arrow.ipc.open_file(arrow.memory_map(str(path))).read_all()


def _keys(table: Any) -> list[RowKey]:  # noqa: ANN401
    """Cells of `KEY` of each row; a missing time comes last."""
    unit, recording, start = (table.column(name).to_pylist() for name in KEY)
    return list(zip(unit, recording, (math.inf if time is None else time for time in start), strict=True))


def _gathered(parts: Sequence[Path], rows: NDArray[np.int64]) -> Any:  # noqa: ANN401
    """Table of (G, 2) rows, each the number of a file and of a row in it."""
    arrow = needs_arrow()
    order = np.argsort(rows[:, 0], kind="stable")
    places, first = np.unique(rows[order, 0], return_index=True)
    taken = zip(places.tolist(), np.split(rows[order, 1], first[1:]), strict=True)
    pieces = (_mapped(parts[place]).take(_integers(arrow, numbers)) for place, numbers in taken)
    whole = arrow.concat_tables(pieces).combine_chunks()
    is_ordered = bool((np.diff(order) == 1).all())
    return whole if is_ordered else whole.take(_integers(arrow, np.argsort(order)))


# --------------------------------------------------------------------------------------------------------------- counts

REJECTED: Final = 100
"""Recordings without a calibration that a summary names; the table has all of them."""

COUNTED: Final = {
    "verdict": "verdicts", "code": "codes", "findings": "findings", "unit_of_field": "units_of_field"
}  # fmt: skip
"""Columns of few texts that occur often, and what their counts are called."""


def table_counts(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Units, rows and readings of a table sorted by unit, and counts of verdicts; memory is that of a batch.

    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> good = UnitResult(unit="A1", verdict="good", worst_deg=0.4)
    >>> rows = [good, UnitResult(unit="A2", code="unreadable"), UnitResult(unit="A2")]
    >>> _ = (folder / "part").write_bytes(UnitResults.of(rows).to_bytes())
    >>> merge([folder / "part"], folder / "all.parquet")
    >>> counts = table_counts(folder / "all.parquet")
    >>> counts["rows"], counts["units"], counts["verdicts"], counts["worst_deg"]["largest"], counts["failed_readings"]
    (3, 2, {'good': 1, 'failed': 2}, 0.4, 0)
    """
    needs_arrow()
    from pyarrow import parquet

    counters = {name: Counter[str]() for name in COUNTED}
    totals, last = Counter[str](), None
    rejected: list[dict[str, str]] = []
    errors: list[Floats] = [np.empty(0)]
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        for batch in file.iter_batches(columns=["unit", "recording", "readings", "worst_deg", *COUNTED]):
            for name, counter in counters.items():
                counter.update(_value_counts(batch.column(name)))
            errors.append(_heading_errors(batch))
            readings = batch.column("readings")
            failed = readings.filter(_is_among(batch, VERDICTS[3:]))
            if len(rejected) < REJECTED:
                some = batch.filter(_is_among(batch, VERDICTS[2:]))
                some = some.select(["unit", "recording", "code", "findings"])
                rejected += map(_named, some.slice(0, REJECTED - len(rejected)).to_pylist())
            units = named_rows(batch).column("unit")
            totals.update(readings=total(readings), failed_readings=total(failed), rows=len(readings))
            if len(units):
                totals["units"] += len(units.unique()) - (units[0].as_py() == last)
                last = units[-1].as_py()
    verdicts = counters.pop("verdict")
    return {
        **{name: totals[name] for name in ("units", "rows", "readings", "failed_readings")},
        "verdicts": {name: verdicts[name] for name in VERDICTS if verdicts[name]},
        **{COUNTED[name]: _by_frequency(counter) for name, counter in counters.items()},
        "worst_deg": _spread(errors),
        "rejected": rejected,
    }


def _named(row: dict[str, Any]) -> dict[str, str]:
    """A row without a calibration, with the finding that refuses a fit."""
    cause = row["findings"][0] if row["code"] == "refused" and row["findings"] else ""
    return {"unit": row["unit"], "recording": row["recording"], "code": row["code"], "finding": cause}


def common_findings(findings: Mapping[str, int], verdicts: Mapping[str, int]) -> list[str]:
    """Findings that all calibrations of a fleet have, by the rows with each finding and verdict; none of one alone.

    >>> common_findings({"scale-unknown": 6, "outliers": 2}, {"good": 5, "limited": 1, "refused": 2})
    ['scale-unknown']
    """
    calibrations = sum(verdicts.get(verdict, 0) for verdict in VERDICTS[:2])
    return [code for code, count in findings.items() if count >= calibrations > 1]


def _spread(errors: Sequence[Floats]) -> dict[str, float]:
    """Median, 95th percentile and maximum of heading errors; empty without any."""
    known = np.concatenate(errors)
    if not len(known):
        return {}
    return dict(zip(("median", "p95", "largest"), np.percentile(known, [50, 95, 100]).tolist(), strict=True))


def _value_counts(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """Count each text of a column, or of the lists in one."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _heading_errors(batch: Any) -> Floats:  # noqa: ANN401
    """Known heading errors of a batch, of rows that have a calibration."""
    column = batch.column("worst_deg").filter(_is_among(batch, VERDICTS[:2]))
    worst = np.asarray(np.from_dlpack(column.drop_null()), dtype=float)
    known: Floats = worst[np.isfinite(worst)]
    return known


def _is_among(batch: Any, verdicts: Sequence[str]) -> Any:  # noqa: ANN401
    """(R,) of Arrow: whether rows of a batch have one of these verdicts."""
    from pyarrow import compute

    return compute.is_in(batch.column("verdict"), value_set=_strings(needs_arrow(), verdicts))


def total(column: Any) -> int:  # noqa: ANN401
    """Sum of a column of whole numbers."""
    from pyarrow import compute

    return int(compute.sum(column).as_py() or 0)


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    """Counts with the most frequent first, the empty text left out."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}
