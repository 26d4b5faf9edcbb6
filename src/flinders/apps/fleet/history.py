"""Histories of units: the calibrations of each in the order of time, read a bounded number of rows at a time.

Tables are sorted by unit, as `flinders fleet` writes them, so that several are read in parallel, and a unit is complete
once all tables have passed its name. Memory does not grow with the number of rows. A recording that is in several
tables counts once, with its row in the last of them.

The hardware batch of a unit comes from a column of the tables, or from a part of the unit's name (`BatchRule`).
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.dates import arrange, is_date
from flinders.apps.fleet.results import (
    LISTS,
    NAMES,
    UNNAMED_UNIT,
    lists,
    named_rows,
    needs_arrow,
    numbers,
    objects,
    reading_table,
    refuse_other_table,
    texts,
)
from flinders.comparison.pairs import EllipsoidPairs
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

    _Flags = NDArray[np.bool_]
    Paths = Sequence[str | os.PathLike[str]]

COLUMNS: Final = (
    "unit", "recording", "start_s", "verdict", "offset", "matrix", "covariance", "field_strength",
    "dip_deg", "unit_of_field",
)  # fmt: skip
IDENTITY_COLUMNS: Final = ("unit", "recording", "start_s", "end_s", "readings", "offset")
"""Columns that identify the recording of a row."""
TABLE: Final = "table of the row"
"""Name of an added column: the number of the table, counted from 0."""
BLOCK_ROWS: Final = 16_384
"""Number of rows that are read at a time, of all tables together."""


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSeries:
    """Offsets of U units over time, R in all."""

    first: NDArray[np.intp]  # (U + 1,) index of each unit's first recording, and R; recordings are in the order of time
    time: Floats  # (R,) in s, or the number of each recording if dates are not known
    offset: Floats  # (R, 3) as a fraction of the field
    covariance: Floats  # (R, 3, 3) of the offset


@dataclass(frozen=True, slots=True, eq=False)
class Histories:
    """Calibrations of U units, unit by unit and in the order of time."""

    unit: NDArray[np.object_]  # (U,) sorted names, including units without a calibration
    batch: NDArray[np.object_]  # (U,) hardware batch; empty if it is not known
    first: NDArray[np.intp]  # (U + 1,) index of each unit's first calibration, and R
    # (U,) whether the order of a unit's recordings is known; if not, recordings are sorted by name
    is_known: NDArray[np.bool_]
    is_dated: NDArray[np.bool_]  # (U,) whether the dates of all recordings of the unit are known
    recording: NDArray[np.object_]  # (R,) name of the recording
    date_s: Floats  # (R,) in s since 1970; NaN if it is not known
    calibrations: EllipsoidPairs  # R calibrations
    unit_of_field: NDArray[np.object_]  # (R,) ``uT`` or ``counts``
    dip_deg: Floats  # (R,) dip of the field for which headings were judged
    verdicts: Mapping[tuple[str, str], int]  # number of rows by batch and verdict, also of rows without a calibration
    left_out: int  # rows without a calibration, or in another unit of field than the first row of their unit
    duplicates: int  # rows of recordings that a later table has too

    @property
    def line(self) -> NDArray[np.intp]:
        """(R,) index of the unit of each calibration."""
        return np.repeat(np.arange(len(self.unit)), np.diff(self.first))

    @property
    def offsets(self) -> OffsetSeries:
        """Offsets over time, as fractions of the unit's first field strength; without dates, time counts recordings."""
        radius = self.calibrations.radius[self.first[self.line]] if len(self.calibrations) else np.empty(0)
        covariance = self.calibrations.covariance[:, :3, :3] / radius[:, np.newaxis, np.newaxis] ** 2
        time = np.where(self.is_dated[self.line], self.date_s, np.arange(len(self.line)) - self.first[self.line])
        return OffsetSeries(self.first, time, self.calibrations.centre / radius[:, np.newaxis], covariance)

    @classmethod
    def of_table(cls, table: Any, rule: BatchRule | None = None, duplicates: int = 0) -> Histories:  # noqa: ANN401
        """Make histories from the rows of whole units, one row for each recording."""
        from pyarrow import compute

        rows, table = len(table), named_rows(table)
        keys = [("unit", "ascending"), ("start_s", "ascending"), ("recording", "ascending")]
        table = table.take(compute.sort_indices(table, sort_keys=keys)).combine_chunks()
        names, begins, line = np.unique(objects(texts(table.column("unit"))), return_index=True, return_inverse=True)
        batch = objects(rule.of(table)) if rule else np.full(len(table), "", dtype=object)
        verdict = objects(texts(table.column("verdict")))
        usable = table.column("covariance").is_valid().to_numpy() & table.column("offset").is_valid().to_numpy()
        chosen = np.flatnonzero(usable & np.isin(verdict.astype(str), ["good", "limited"]))
        places, date_s, is_known, is_dated = _order_rows(table.take(chosen), line[chosen], len(names))
        chosen = chosen[places]
        field = objects(texts(table.column("unit_of_field")))[chosen]
        alike = _has_common_unit(line[chosen], field)
        chosen = chosen[alike]
        inside = table.take(chosen)
        offset, matrix, covariance = (
            lists(inside.column(name), LISTS[name]) for name in ("offset", "matrix", "covariance")
        )
        return cls(
            unit=names,
            batch=batch[begins],
            first=np.searchsorted(line[chosen], np.arange(len(names) + 1)),
            is_known=is_known,
            is_dated=is_dated,
            recording=objects(texts(inside.column("recording"))),
            date_s=date_s[alike],
            calibrations=EllipsoidPairs.of_columns(
                offset, matrix, covariance, numbers(inside.column("field_strength"))
            ),
            unit_of_field=field[alike],
            dip_deg=numbers(inside.column("dip_deg")),
            verdicts=Counter(zip(batch.tolist(), verdict.tolist(), strict=True)) if rule else {},
            left_out=rows - len(chosen),
            duplicates=duplicates,
        )


def _order_rows(table: Any, line: NDArray[np.intp], units: int) -> tuple[NDArray[np.intp], Floats, _Flags, _Flags]:  # noqa: ANN401
    """Indices of rows in the order of recordings, their dates, and for each unit whether order and dates are known.

    Rows come sorted by unit and clock. A unit whose clocks all have dates, all different, needs no other order.
    """
    start = numbers(table.column("start_s"))
    is_odd = ~is_date(start)
    is_odd[np.flatnonzero((np.diff(line) == 0) & (np.diff(start) == 0.0))] = True
    places, date_s = np.arange(len(line)), start.copy()
    is_known, is_dated = np.ones(units, bool), np.ones(units, bool)
    odd = np.unique(line[is_odd])
    begins, ends = np.searchsorted(line, odd), np.searchsorted(line, odd, side="right")
    recording, tables = table.column("recording"), table.column(TABLE).to_numpy()
    for unit, begin, end in zip(odd.tolist(), begins.tolist(), ends.tolist(), strict=True):
        names = texts(recording.slice(begin, end - begin))
        order = arrange(names, start[begin:end], tables[begin:end].tolist())
        places[begin:end] = begin + np.array(order.places)
        date_s[begin:end] = order.date_s
        is_known[unit], is_dated[unit] = order.is_known, order.is_dated
    return places, date_s, is_known, is_dated


def histories(
    paths: Sequence[str | os.PathLike[str]], *, rule: BatchRule | None = None, rows: int = BLOCK_ROWS
) -> Iterator[Histories]:
    """Yield histories of whole units from Parquet tables of a fleet, each from about `rows` rows of all tables.

    Raises DocumentError for a file that is no table of a fleet, or is not sorted by unit.
    """
    columns = (*COLUMNS, rule.column) if rule and rule.column else COLUMNS
    for table in _unit_tables(paths, columns, rows=rows):
        whole = _without_duplicates(table)
        yield Histories.of_table(whole, rule, len(table) - len(whole))


def whole_units(paths: Sequence[str | os.PathLike[str]], columns: Sequence[str]) -> Iterator[Any]:
    """Yield Arrow tables with all rows of some units, in the order of the units' names, each recording once.

    An added column is null for tables without it; errors as for `histories`.
    """
    for table in _unit_tables(paths, columns):
        yield _without_duplicates(table)


def _unit_tables(
    paths: Sequence[str | os.PathLike[str]], columns: Sequence[str], *, rows: int = BLOCK_ROWS
) -> Iterator[Any]:
    """Yield tables with all rows of some units, from all paths, in the order of the units' names."""
    arrow = needs_arrow()
    wanted = tuple(dict.fromkeys((*columns, *IDENTITY_COLUMNS)))
    feeds = [_read_numbered(number, path, wanted, max(rows // len(paths), 1)) for number, path in enumerate(paths)]
    waiting: list[Any] = [next(feed, None) for feed in feeds]
    more = [table is not None for table in waiting]
    while any(table is not None for table in waiting):
        open_ends = [_last_unit(table) for table, goes_on in zip(waiting, more, strict=True) if goes_on]
        limit = min(open_ends) if open_ends else None
        taken = []
        for place, table in enumerate(waiting):
            if table is not None:
                done, waiting[place] = _split(table, limit)
                taken.append(done)
        whole = arrow.concat_tables(taken)
        if len(whole):
            yield whole
        for place, goes_on in enumerate(more):
            if goes_on and (waiting[place] is None or _last_unit(waiting[place]) == limit):
                further = next(feeds[place], None)
                more[place] = further is not None
                if further is not None:
                    left = waiting[place]
                    waiting[place] = further if left is None else arrow.concat_tables([left, further])


def _read_numbered(number: int, path: str | os.PathLike[str], columns: Sequence[str], rows: int) -> Iterator[Any]:
    """Yield some columns of a table, `rows` rows at a time, with a column for the number of the table."""
    arrow = needs_arrow()
    from pyarrow import parquet

    last = ""
    with reading_table(path), parquet.ParquetFile(path, page_checksum_verification=True) as file:
        refuse_other_table(file.schema_arrow.names, columns, path)
        present = [name for name in columns if name in file.schema_arrow.names]
        for batch in file.iter_batches(rows, columns=present):
            if len(batch):
                last = _check_sorted(path, batch.column("unit").to_pylist(), last)
                yield _complete_columns(arrow, arrow.Table.from_batches([batch]), columns, number)


def _complete_columns(arrow: Any, table: Any, columns: Sequence[str], number: int) -> Any:  # noqa: ANN401
    """Table with columns in the given order, added columns as texts, and the number of the table."""
    names = table.column_names

    def cells(name: str) -> Any:  # noqa: ANN401
        if name not in names:
            return arrow.nulls(len(table), arrow.string())
        return table.column(name) if name in NAMES else table.column(name).cast("string")

    arrays = [*map(cells, columns), arrow.array(np.full(len(table), number))]
    return arrow.table(arrays, names=[*columns, TABLE])


def _without_duplicates(table: Any) -> Any:  # noqa: ANN401
    """Rows of whole units, without recordings that a later table has too."""
    from pyarrow import array

    tables = table.column(TABLE).to_pylist()
    if len(set(tables)) == 1:
        return table
    keys = list(map(_key, *(table.column(name).to_pylist() for name in IDENTITY_COLUMNS)))
    newest = dict(zip(keys, tables, strict=True))  # rows are in the order of their tables
    return table.filter(array([newest[key] == number for key, number in zip(keys, tables, strict=True)]))


def _key(unit: str, recording: str | None, start_s: float | None, *others: Any) -> tuple[Any, ...]:
    """Key of a recording, equal in all tables that have it: unit, name and start.

    If the start is no date, end and number of readings are added, and also the offset of a recording without a name.
    """
    if start_s is not None and is_date(np.array([start_s]))[0]:
        return unit, recording, start_s
    *span, offset = others
    own = () if recording else tuple(f"{value:.6g}" for value in offset or ())
    return unit, recording, start_s, *span, *own


def _check_sorted(path: str | os.PathLike[str], units: list[str | None], last: str) -> str:
    """Last unit of some rows; refuse a table that is not sorted by unit, or has a row without a unit."""
    for unit in units:
        if unit is None or unit < last:
            fault = "a row has no unit" if unit is None else f"{unit!r} comes after {last!r}"
            raise DocumentError(f"{path}: {fault}: sort the table by unit, as `flinders fleet` writes it")
        last = unit
    return last


def _last_unit(table: Any) -> str:  # noqa: ANN401
    """Unit of the last row."""
    return str(table.column("unit")[len(table) - 1].as_py())


def _split(table: Any, limit: str | None) -> tuple[Any, Any]:  # noqa: ANN401
    """Split a table: rows of units whose names sort before `limit`, and the others; all and None without a limit."""
    if limit is None:
        return table, None
    from pyarrow import compute

    count = compute.sum(compute.less(table.column("unit"), limit)).as_py() or 0
    left = table.slice(count)
    return table.slice(0, count), left if len(left) else None


def _has_common_unit(line: NDArray[np.intp], field: NDArray[np.object_]) -> NDArray[np.bool_]:
    """(n,) whether a row's readings are in µT or in counts as in the first row of the same device."""
    if not len(line):
        return np.zeros(0, dtype=bool)
    first = np.searchsorted(line, line)
    alike: NDArray[np.bool_] = field == field[first]
    return alike


# ------------------------------------------------------------------------------------------------------ hardware batch

BATCH_COLUMN: Final = "batch"
"""Default column of the hardware batch, unless it is empty."""
PREFIX: Final = re.compile(r"^(.+)[-_:/.][^-_:/.]+$")
"""Pattern of a hardware batch in a unit's name, if no column has the batch: all but the last part of the name."""
MAX_BATCHES: Final = 2_000
"""Largest number of hardware batches; with more, none is assumed."""


@dataclass(frozen=True, slots=True)
class BatchRule:
    """Rule for the hardware batch of a unit: a column of the table, or else a pattern in the unit's name.

    >>> BatchRule(pattern=pattern_of("^L[0-9]", ())).of_name("L2-0017")
    'L2'
    >>> BatchRule(pattern=PREFIX).of_name("board-2024-17")
    'board-2024'
    """

    column: str = ""  # column of the batch; empty if the name of the unit holds it
    pattern: re.Pattern[str] = PREFIX  # for the name: the batch is its first group, or the whole match
    is_guess: bool = False  # whether the rule is a default

    @property
    def words(self) -> str:
        """Description of the rule."""
        if self.column:
            return f"the column {self.column}"
        return "the name of the unit" if self.is_guess else f"{self.pattern.pattern!r} in the name"

    def of(self, table: Any) -> list[str]:  # noqa: ANN401 - pyarrow ships no types
        """Batch of each row's unit, empty if unknown; if a unit has several batches, the first by name.

        The table has all rows of its units.
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
        """Batch in a unit's name; empty if there is none."""
        match = self.pattern.search(unit)
        if match is None:
            return ""
        return (match[1] if self.pattern.groups else match[0]) or ""

    def are_useful(self, names: Collection[str], rows: int) -> bool:
        """Whether these batches, of `rows` rows in all, are shown: not too many, and not a poor guess."""
        return any(names) and len(names) <= MAX_BATCHES and (not self.is_guess or 2 <= len(names) <= rows / 4)


def batch_rule(paths: Paths, text: str | None) -> BatchRule:
    """Rule for hardware batches: a column of a table, or a regular expression for a part of the unit's name.

    By default the column ``batch`` if it is not empty, else all but the last part of the name. Raises UsageError for a
    text that gives no batch.
    """
    columns = _columns(paths)
    if columns is None:
        return BatchRule(is_guess=True)  # errors are raised where the files are read
    if text is None:
        return BatchRule(column=BATCH_COLUMN) if _has_text(paths, BATCH_COLUMN) else BatchRule(is_guess=True)
    if text in columns:
        if not _has_text(paths, text):
            raise UsageError(f"batch {text!r}: that column is empty in all rows; {_advice(columns)}")
        return BatchRule(column=text)
    batches = BatchRule(pattern=pattern_of(text, columns))
    if not any(batches.of_name(unit) for unit in _cells(paths, "unit") if not UNNAMED_UNIT.search(unit)):
        raise UsageError(
            f"batch {text!r} is no column of the table, and as a regular expression matches no name of a unit; "
            f"{_advice(columns)}"
        )
    return batches


def pattern_of(text: str, columns: Sequence[str]) -> re.Pattern[str]:
    """Compile a regular expression for the batch; raises UsageError."""
    try:
        return re.compile(text)
    except re.error as error:
        raise UsageError(
            f"batch {text!r} is neither a column of the table nor a regular expression ({error}); {_advice(columns)}"
        ) from None


def _advice(columns: Sequence[str]) -> str:
    """Advice on how to name a batch."""
    return (
        f"name a column ({', '.join(columns)}), or give a pattern for the names of units, such as '^[A-Z]+'; "
        "flinders fleet --batch-column NAME copies a column of the readings to its table"
    )


def _columns(paths: Paths) -> list[str] | None:
    """Names of the columns of all tables, without nested ones; None if a table cannot be read."""
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


def added_columns(paths: Paths) -> list[str]:
    """Names of the columns with properties of units."""
    return [name for name in _columns(paths) or () if name not in NAMES]


def _has_text(paths: Paths, name: str) -> bool:
    """Whether a column has a text that is not empty."""
    return any(cell for cell in _cells(paths, name))


def _cells(paths: Paths, name: str) -> Iterator[str]:
    """Yield the distinct texts of a column, for each part of each table that has the column."""
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
