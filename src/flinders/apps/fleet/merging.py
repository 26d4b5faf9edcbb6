"""The table of a fleet: parts of rows, and the table to extend, merged in order with the memory of one row group."""

from __future__ import annotations

import heapq
import math
from bisect import bisect_right
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TextIO, TypeAlias, cast

import numpy as np

from flinders.apps.fleet.growth import FILE_CODES, FILES
from flinders.apps.fleet.properties import Properties, with_columns
from flinders.apps.fleet.results import (
    KEY,
    NAMES,
    TEXTS,
    VERDICTS,
    flags,
    integers,
    named_rows,
    needs_arrow,
    reading_table,
    refuse_other_table,
    schema,
    strings,
    texts,
)
from flinders.core.files import open_atomically

if TYPE_CHECKING:
    import os
    from collections.abc import Collection, Iterator, Mapping, Sequence
    from concurrent.futures import Future
    from pathlib import Path

    from numpy.typing import NDArray

    from flinders.apps.fleet.growth import ReadFiles
    from flinders.arrays import Floats

    RowKey: TypeAlias = tuple[str, str, float]  # cells of `KEY`

GROUP_ROWS: Final = 65_536
"""Number of rows in a row group of the table."""
COMPRESSION_LEVEL: Final = 3
"""Compression level of Zstandard; all settings of the writer are fixed, so that equal rows give equal bytes."""


def merge(
    parts: Sequence[Path | bytes | TableRows],
    out: str | os.PathLike[str],
    *,
    properties: Properties | None = None,
    files: ReadFiles | None = None,
) -> None:
    """Merge parts, each with its rows sorted by `KEY`, into a Parquet file; equal rows stay in the order of parts.

    A file is read when its first row is due. A row group needs a few files only, so that the memory needed is that of
    one row group. Raises OutputError.

    Parameters
    ----------
    parts : sequence
        Arrow files of rows, or their content, and the table to extend.
    out : str or path
        The Parquet file to write.
    properties : Properties, optional
        Properties of units, added as columns; by default the added columns of the parts.
    files : ReadFiles, optional
        Files that the rows were made from, stored in the footer.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders.apps.fleet.results import UnitResult, UnitResults
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name, units in (("a", ["A1", "A3"]), ("b", ["A2", "A4"])):
    ...     _ = (folder / name).write_bytes(UnitResults.of([UnitResult(unit=unit) for unit in units]).to_bytes())
    >>> merge([folder / "a", folder / "b"], folder / "all.parquet")
    >>> merge([TableRows(folder / "all.parquet"), folder / "b"], folder / "more.parquet")
    >>> UnitResults.read(folder / "more.parquet").unit.tolist()
    ['A1', 'A2', 'A2', 'A3', 'A4', 'A4']
    """
    needs_arrow()
    sources = [part if isinstance(part, TableRows) else PartRows(part) for part in parts]
    if properties is None:
        names = dict.fromkeys(name for source in sources for name in source.added)
        properties = Properties(tuple(names))
    with open_atomically(out, force=True) as file:
        _write(_groups(sources, properties), cast("TextIO", file).buffer, properties, files)
        for source in sources:
            source.close()  # Windows replaces no file that is open


def _write(groups: Iterator[Any], file: Any, properties: Properties, files: ReadFiles | None) -> None:  # noqa: ANN401 - pyarrow ships no types
    """Write row groups to a Parquet file, with the list of files in its footer."""
    from pyarrow import parquet

    options: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": COMPRESSION_LEVEL,
        "version": "2.6",
        "use_dictionary": [*TEXTS, *properties.names, "findings.list.element"],
        "write_page_checksum": True,
    }
    with parquet.ParquetWriter(file, schema(properties.names), **options) as writer:
        for group in groups:
            writer.write_table(group, row_group_size=GROUP_ROWS)
        if files is not None:
            writer.add_key_value_metadata({FILES: files.dumps()})


def _groups(sources: Sequence[Rows], properties: Properties) -> Iterator[Any]:
    """Yield tables of one row group each, in order."""
    waiting, count = [np.empty((0, 2), dtype=np.int64)], 0
    for rows in _order(sources):
        waiting.append(rows)
        count += len(rows)
        if count >= GROUP_ROWS:
            every = np.concatenate(waiting)
            whole = count - count % GROUP_ROWS
            for first in range(0, whole, GROUP_ROWS):
                yield properties.join(_gather(sources, every[first : first + GROUP_ROWS], properties.names))
            waiting, count = [every[whole:]], count - whole
    if count:
        yield properties.join(_gather(sources, np.concatenate(waiting), properties.names))


def _order(sources: Sequence[Rows]) -> Iterator[NDArray[np.int64]]:
    """Yield (n, 2) indices of source and row, in the order of the merged table.

    Rows of the table to extend come in long runs.
    """
    parts = [(place, source) for place, source in enumerate(sources) if isinstance(source, PartRows)]
    rows = heapq.merge(*(_numbered_keys(place, source) for place, source in parts))
    for place, source in enumerate(sources):
        if isinstance(source, TableRows):
            yield from _merge_into(place, source, rows)
    while some := [(place, row) for _, place, row in islice(rows, GROUP_ROWS)]:
        yield np.array(some)


def _merge_into(place: int, table: TableRows, rows: Iterator[tuple[RowKey, int, int]]) -> Iterator[NDArray[np.int64]]:
    """Yield indices of source and row for the rows of a table with new rows merged into them, in order."""
    waiting = next(rows, None)
    for group in table.groups():
        begun = 0
        while waiting is not None and (at := group.place_of(waiting[0])) < len(group.rows):
            yield _run(place, group.rows[begun:at])
            yield np.array([waiting[1:]])
            begun, waiting = at, next(rows, None)
        yield _run(place, group.rows[begun:])
    if waiting is not None:
        yield np.array([waiting[1:]])


def _run(place: int, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, 2) indices of source and row, for rows of one source."""
    return np.stack([np.full_like(rows, place), rows], axis=1)


def _numbered_keys(place: int, source: PartRows) -> Iterator[tuple[RowKey, int, int]]:
    """Yield key, number of the source and number of the row, for each row of a source."""
    yield from ((key, place, row) for key, row in source.row_keys())


def _gather(sources: Sequence[Rows], rows: NDArray[np.int64], added: Sequence[str]) -> Any:  # noqa: ANN401
    """Collect rows into one table, from their (G, 2) indices of source and row."""
    arrow = needs_arrow()
    order = np.argsort(rows[:, 0], kind="stable")
    places, first = np.unique(rows[order, 0], return_index=True)
    taken = zip(places.tolist(), np.split(rows[order, 1], first[1:]), strict=True)
    pieces = (with_columns(sources[place].take(numbers), added) for place, numbers in taken)
    whole = arrow.concat_tables(pieces).combine_chunks()
    is_ordered = bool((np.diff(order) == 1).all())
    return whole if is_ordered else whole.take(integers(arrow, np.argsort(order)))


class PartRows:
    """Sorted rows of an Arrow file, mapped into memory; rows after the first are read when their turn comes."""

    added: tuple[str, ...] = ()

    def __init__(self, content: Path | bytes) -> None:
        self._content = content

    def row_keys(self) -> Iterator[tuple[RowKey, int]]:
        """Yield the cells of `KEY` and the number of each row."""
        yield from ((key, 0) for key in _keys(self._table().slice(0, 1)))
        yield from ((key, row) for row, key in enumerate(_keys(self._table().slice(1)), 1))

    def take(self, numbers: NDArray[np.int64]) -> Any:  # noqa: ANN401
        """Table of some rows, in the order of their numbers."""
        return self._table().take(integers(needs_arrow(), numbers))

    def _table(self) -> Any:  # noqa: ANN401
        arrow = needs_arrow()
        content = self._content if isinstance(self._content, bytes) else arrow.memory_map(str(self._content))
        return arrow.ipc.open_file(content).read_all()

    def close(self) -> None:
        """Do nothing: no file stays open."""


class TableRows:
    """Sorted rows of an earlier table, without rows about files; one row group is in memory."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        needs_arrow()
        from pyarrow import parquet

        with reading_table(path):
            self._file = parquet.ParquetFile(path, page_checksum_verification=True)
        names = self._file.schema_arrow.names
        refuse_other_table(names, NAMES, path)
        self.added = tuple(name for name in names if name not in NAMES)
        metadata = self._file.metadata
        self._ends = np.cumsum([metadata.row_group(group).num_rows for group in range(metadata.num_row_groups)])
        self._last_group: tuple[int, Any] = (-1, None)
        self._path = path
        self._ahead: Future[Any] | None = None

    def read_ahead(self) -> None:
        """Begin to read the first row group in a thread, while this process waits for its workers."""
        from pyarrow import parquet

        def first() -> Any:  # noqa: ANN401
            with parquet.ParquetFile(self._path, page_checksum_verification=True) as file:  # a reader for each thread
                return file.read_row_group(0)

        if len(self._ends):
            self._ahead = ThreadPoolExecutor(1).submit(first)

    def groups(self) -> Iterator[_KeyGroup]:
        """Yield the keys of each row group, without rows about files."""
        for group, end in enumerate(self._ends.tolist()):
            table = self._group(group)
            is_about = _is_in(table.column("code"), FILE_CODES)
            rows = np.arange(end - len(table), end)[~flags(is_about)]
            yield _KeyGroup(rows, table if len(rows) == len(table) else table.filter(_invert(is_about)))

    def take(self, numbers: NDArray[np.int64]) -> Any:  # noqa: ANN401
        """Table of the rows with these numbers, which are in ascending order."""
        arrow = needs_arrow()
        if not len(numbers):
            return self._file.schema_arrow.empty_table()
        groups, first = np.unique(np.searchsorted(self._ends, numbers, side="right"), return_index=True)
        pieces = []
        for group, own in zip(groups.tolist(), np.split(numbers, first[1:]), strict=True):
            table = self._group(group)
            places = own - (self._ends[group] - len(table))
            is_run = places[-1] - places[0] == len(places) - 1
            pieces.append(table.slice(places[0], len(places)) if is_run else table.take(integers(arrow, places)))
        return arrow.concat_tables(pieces)

    def of_units(self, units: Collection[str]) -> Any:  # noqa: ANN401
        """Table of all rows of some units."""
        numbers = [np.empty(0, dtype=np.int64)]
        for group, end in enumerate(self._ends.tolist()):
            table = self._group(group)
            is_about = _is_in(table.column("code"), FILE_CODES)
            places = np.flatnonzero(flags(_is_in(table.column("unit"), list(units))) & ~flags(is_about))
            numbers.append(places + (end - len(table)))
        return self.take(np.concatenate(numbers))

    def units(self) -> list[str]:
        """Unit of each row."""
        return texts(self._columns("unit").column("unit"))

    def file_rows(self) -> set[tuple[str, str]]:
        """Unit and code of the rows about files."""
        table = self._columns("unit", "code")
        table = table.filter(_is_in(table.column("code"), FILE_CODES))
        return set(zip(texts(table.column("unit")), texts(table.column("code")), strict=True))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _columns(self, *names: str) -> Any:  # noqa: ANN401
        with reading_table(self._path):
            return self._file.read(columns=list(names))

    def _group(self, group: int) -> Any:  # noqa: ANN401
        if self._last_group[0] != group:
            ahead, self._ahead = self._ahead, None
            with reading_table(self._path):
                table = ahead.result() if ahead is not None and group == 0 else self._file.read_row_group(group)
            self._last_group = group, table
        return self._last_group[1]


Rows: TypeAlias = "PartRows | TableRows"


class _KeyGroup:
    """Keys of the rows of one row group of a table, in order."""

    def __init__(self, rows: NDArray[np.int64], table: Any) -> None:  # noqa: ANN401
        self.rows = rows  # (R,) numbers of the rows in the table
        self._table = table.select(KEY)
        self._units = np.array(texts(self._table.column("unit")))

    def place_of(self, key: RowKey) -> int:
        """Index of the first row after a key."""
        first, end = (int(np.searchsorted(self._units, key[0], side)) for side in ("left", "right"))
        return first + bisect_right(_keys(self._table.slice(first, end - first)), key) if first < end else first


def _keys(table: Any) -> list[RowKey]:  # noqa: ANN401
    """Cells of `KEY` of each row; a missing time comes last."""
    unit, recording, start = (table.column(name).to_pylist() for name in KEY)
    return list(zip(unit, recording, (math.inf if time is None else time for time in start), strict=True))


# --------------------------------------------------------------------------------------------------------------- counts

COUNT_NAMES: Final = {
    "verdict": "verdicts", "code": "codes", "findings": "findings", "unit_of_field": "units_of_field"
}  # fmt: skip
"""Columns with few different texts, and the names under which these are counted."""


def table_counts(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Numbers of units, rows and readings of a table sorted by unit, and counts of verdicts, codes and findings.

    Rows about files are counted in the codes only. The memory needed is that of one batch of rows.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders.apps.fleet.results import UnitResult, UnitResults
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

    counters = {name: Counter[str]() for name in COUNT_NAMES}
    totals, last = Counter[str](), None
    errors: list[Floats] = [np.empty(0)]
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        for every in file.iter_batches(columns=["unit", "readings", "worst_deg", *COUNT_NAMES]):
            counters["code"].update(_value_counts(every.column("code")))
            batch = every.filter(_invert(_is_in(every.column("code"), FILE_CODES)))
            for name in ("verdict", "findings", "unit_of_field"):
                counters[name].update(_value_counts(batch.column(name)))
            errors.append(_heading_errors(batch))
            readings = batch.column("readings")
            failed = readings.filter(_is_among(batch, VERDICTS[3:]))
            units = named_rows(batch).column("unit")
            totals.update(readings=total(readings), failed_readings=total(failed), rows=len(readings))
            if len(units):
                totals["units"] += len(units.unique()) - (units[0].as_py() == last)
                last = units[-1].as_py()
    verdicts = counters.pop("verdict")
    return {
        **{name: totals[name] for name in ("units", "rows", "readings", "failed_readings")},
        "verdicts": {name: verdicts[name] for name in VERDICTS if verdicts[name]},
        **{COUNT_NAMES[name]: _by_frequency(counter) for name, counter in counters.items()},
        "worst_deg": _error_quantiles(errors),
    }


def common_findings(findings: Mapping[str, int], verdicts: Mapping[str, int]) -> list[str]:
    """Findings that all calibrations of a fleet share, from numbers of rows by finding and by verdict.

    Empty for a single calibration.

    >>> common_findings({"scale-unknown": 6, "outliers": 2}, {"good": 5, "limited": 1, "refused": 2})
    ['scale-unknown']
    """
    calibrations = sum(verdicts.get(verdict, 0) for verdict in VERDICTS[:2])
    return [code for code, count in findings.items() if count >= calibrations > 1]


def _error_quantiles(errors: Sequence[Floats]) -> dict[str, float]:
    """Median, 95th percentile and maximum of heading errors; empty without any."""
    known = np.concatenate(errors)
    if not len(known):
        return {}
    return dict(zip(("median", "p95", "largest"), np.percentile(known, [50, 95, 100]).tolist(), strict=True))


def _value_counts(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """Count each text of a column, or of the lists in a column."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _heading_errors(batch: Any) -> Floats:  # noqa: ANN401
    """Known heading errors of a batch, of rows that have a calibration."""
    column = batch.column("worst_deg").filter(_is_among(batch, VERDICTS[:2]))
    worst = np.asarray(np.from_dlpack(column.drop_null()), dtype=float)
    known: Floats = worst[np.isfinite(worst)]
    return known


def _is_in(column: Any, words: Sequence[str]) -> Any:  # noqa: ANN401
    """(R,) Arrow mask: whether cells of a column are among some texts."""
    from pyarrow import compute

    return compute.is_in(column, value_set=strings(needs_arrow(), words))


def _invert(mask: Any) -> Any:  # noqa: ANN401
    """(R,) Arrow mask, inverted."""
    from pyarrow import compute

    return compute.invert(mask)


def _is_among(batch: Any, verdicts: Sequence[str]) -> Any:  # noqa: ANN401
    """(R,) Arrow mask: whether rows of a batch have one of these verdicts."""
    return _is_in(batch.column("verdict"), verdicts)


def total(column: Any) -> int:  # noqa: ANN401
    """Sum of a column of whole numbers."""
    from pyarrow import compute

    return int(compute.sum(column).as_py() or 0)


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    """Counts with the most frequent first, the empty text left out."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}
