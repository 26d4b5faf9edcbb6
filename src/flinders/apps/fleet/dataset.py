r"""Datasets of Parquet and Arrow files whose rows are readings of many units: files, row groups, key columns.

>>> import tempfile
>>> import pyarrow
>>> from pyarrow import parquet
>>> columns = {"unit": ["A17", "A17", "B02"], "x_uT": [1.0, 2.0, 3.0], "y_uT": [4.0, 5.0, 6.0], "z_uT": [7.0, 8.0, 9.0]}
>>> path = tempfile.mkdtemp() + "/fleet.parquet"
>>> parquet.write_table(pyarrow.table(columns), path)
>>> from flinders.apps.fleet.options import Options
>>> with open_table_file(storage.StoredFile("fleet.parquet", path, 0), Options()) as file:
...     table = KeyedTable.of(file, Options())
...     [(runs, values)] = table.batches((0,), names := Interner())
...     file.groups, extents_of(file, table.keys), [names.pairs[each] for each in runs.numbers.tolist()], runs.lengths
((3,), [('A17', 'B02')], [('A17', ''), ('B02', '')], array([2, 1]))
"""

from __future__ import annotations

import contextlib
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, cast

import numpy as np

from flinders.apps.fleet import storage
from flinders.apps.fleet.keys import KeyColumns, text_of, texts_of
from flinders.apps.fleet.names import CSV, PARQUET, header_of
from flinders.apps.fleet.results import needs_arrow
from flinders.core.axes import Axes
from flinders.errors import FlindersError, UnreadableInput, UsageError
from flinders.foreign_errors import parser_errors
from flinders.readers import Choice
from flinders.readers._names import CURRENT, CURRENTS, STRENGTH, TEMPERATURE, THROTTLE, THROTTLES, TIME
from flinders.readers._source import File
from flinders.readers._table import open_table
from flinders.readers.parquet import (
    TEXTS,
    group_extents,
    places_of,
    refuse_packed_groups,
    rows_of_batches,
    table_of,
    values_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.storage import StoredFile
    from flinders.core.samples import Samples
    from flinders.readers import TableRecording
    from flinders.readers._columns import Values
    from flinders.readers.parquet import Extent

Pair: TypeAlias = tuple[str, str]
"""Names of unit and recording."""

BUFFER_BYTES: Final = 1 << 20
"""Number of bytes of a column that are read at a time, as a row group may hold any number of rows."""
BATCH_ROWS: Final = 131_072
"""Number of rows that are converted at a time."""
PREVIEW_ROWS: Final = 1_024
"""Number of first rows from which columns are recognised."""
USED_COLUMNS: Final = (TIME, STRENGTH, TEMPERATURE, CURRENT, THROTTLE, CURRENTS, THROTTLES)
"""Kinds of columns that a fit without aiding sensors uses; others are not read."""


@dataclass(frozen=True, slots=True)
class TableFile:
    """An open table file, whose rows are read in groups."""

    name: str  # for messages
    kind: str  # Parquet, Arrow or CSV
    schema: Any
    groups: tuple[int, ...]  # rows of each row group or record batch
    read: Callable[..., Iterator[Any]]  # as `batches`
    # least and greatest value of a column in each group, None if the file does not state them
    extents: Callable[[str], list[tuple[str, str] | None]]

    @property
    def group(self) -> str:
        """Name of a group of rows in this kind of file."""
        return "row group" if self.kind == "Parquet" else "record batch"

    def batches(self, groups: Sequence[int], columns: list[str], rows: int = BATCH_ROWS) -> Iterator[Any]:
        """Yield record batches of some groups and columns, of 1 to `rows` rows; raises UnreadableInput."""
        with parser_errors(self.name, f"a table of {self.kind}"):
            yield from (batch for batch in self.read(groups, columns, rows) if batch.num_rows)


@contextlib.contextmanager
def open_table_file(file: StoredFile, options: Options) -> Iterator[TableFile]:
    """Open a Parquet or Arrow file, local or in a store; raises UnreadableInput if the file is broken or gone.

    A CSV of many units is read into memory, as one group of rows.
    """
    needs_arrow()
    is_parquet = file.name.lower().endswith(PARQUET)
    if file.name.lower().endswith(CSV):
        with storage.fetch(file) as path, parser_errors(file.name, "a table of text"):
            yield _csv(file.name, path, options)
        return
    with (
        storage.open_stored(file) as where,
        parser_errors(file.name, "a Parquet table" if is_parquet else "an Arrow file"),
    ):
        yield _parquet(file.name, where, file.size, options) if is_parquet else _arrow(file.name, where, file.size)


def _parquet(name: str, where: Any, size: int, options: Options) -> TableFile:  # noqa: ANN401
    """Open a Parquet file; a key column stays dictionary-encoded if the file stores it so."""
    from pyarrow import parquet

    bounded = {"buffer_size": BUFFER_BYTES, "pre_buffer": False, "page_checksum_verification": True}
    file = parquet.ParquetFile(where, **bounded)
    texts: list[str] = []
    with contextlib.suppress(FlindersError):  # raised where the keys are used
        keys = KeyColumns.of_schema(name, file.schema_arrow, options)
        texts += keys.columns if keys else ()
    if texts:
        file = parquet.ParquetFile(where, metadata=file.metadata, read_dictionary=texts, **bounded)
    metadata = file.metadata
    refuse_packed_groups(metadata, name, size)
    groups = tuple(metadata.row_group(group).num_rows for group in range(metadata.num_row_groups))

    def batches(wanted: Sequence[int], columns: list[str], rows: int) -> Iterator[Any]:
        yield from file.iter_batches(rows, row_groups=list(wanted), columns=columns, use_threads=False)

    def extents(column: str) -> list[tuple[str, str] | None]:
        kind = file.schema_arrow.field(column).type
        return [_extent(ends, kind) for ends in group_extents(metadata, column)]

    return TableFile(name, "Parquet", file.schema_arrow, groups, batches, extents)


def _csv(name: str, path: Path, options: Options) -> TableFile:
    """Open a table of text, with keys as texts."""
    from pyarrow import csv

    names, delimiter = header_of(path)
    keys = KeyColumns.of(name, names, options, needs_batch=False)
    kinds = dict.fromkeys(keys.columns if keys else (), needs_arrow().string())
    parse, convert = csv.ParseOptions(delimiter=delimiter), csv.ConvertOptions(column_types=kinds)
    return table_in_memory(name, "CSV", csv.read_csv(path, parse_options=parse, convert_options=convert))


def table_in_memory(name: str, kind: str, table: Any) -> TableFile:  # noqa: ANN401
    """Make a `TableFile` of one group from an Arrow table in memory."""

    def batches(_: Sequence[int], columns: list[str], rows: int) -> Iterator[Any]:
        yield from table.select(columns).to_batches(max_chunksize=rows)

    return TableFile(name, kind, table.schema, (table.num_rows,), batches, lambda _: [None])


def _extent(ends: Extent | None, kind: Any) -> tuple[str, str] | None:  # noqa: ANN401
    """Least and greatest text of a row group; None if the file does not state them, or values sort unlike texts."""
    types = needs_arrow().types
    kind = kind.value_type if types.is_dictionary(kind) else kind
    is_integer, is_text = types.is_integer(kind), str(kind) in TEXTS
    if ends is None or not (is_integer or is_text or "binary" in str(kind)):
        return None
    is_signed = types.is_signed_integer(kind)
    least, greatest = (text_of(int.from_bytes(end, "little", signed=is_signed) if is_integer else end) for end in ends)
    is_known = least <= greatest if is_text else least == greatest
    return (least, greatest) if is_known else None


def _arrow(name: str, where: Any, size: int) -> TableFile:  # noqa: ANN401
    """Open an Arrow file; only the columns that are read are unpacked."""
    import pyarrow
    from pyarrow import ipc

    source = pyarrow.memory_map(where) if isinstance(where, str) else where

    groups = tuple(rows_of_batches(source, name, size))
    schema = ipc.open_file(source).schema

    def batches(wanted: Sequence[int], columns: list[str], rows: int) -> Iterator[Any]:
        places = [place for place, column in enumerate(schema.names) if column in columns]
        file = ipc.open_file(source, options=ipc.IpcReadOptions(included_fields=places))
        for number in wanted:
            batch = file.get_batch(number).select(columns)
            batch.validate(full=True)
            yield from (batch.slice(start, rows) for start in range(0, batch.num_rows, rows))

    return TableFile(name, "Arrow", schema, groups, batches, lambda _: [None] * len(groups))


@dataclass(frozen=True, slots=True, eq=False)
class KeyedTable:
    """A table file of readings of many units, with its columns recognised."""

    file: TableFile
    keys: KeyColumns
    recording: TableRecording  # its columns, unit of field and axes

    @classmethod
    def of(cls, file: TableFile, options: Options) -> Self:
        """Recognise the columns.

        Raises NoMagnetometer if none, or not clearly three, are the magnetometer, UsageError if there is no column of
        units, or if the options do not fit the file.
        """
        names = list(file.schema.names)
        keys = KeyColumns.of_schema(file.name, file.schema, options)
        if keys is None:
            raise no_units(file.name, names)
        table = table_of(
            file.kind,
            _schema_without_keys(file.schema, keys),
            sum(file.groups),
            lambda names: _first_rows(file, names),
            file.name,
        )
        recording = open_table(
            File(file.name, Path(file.name), 0),
            table,
            columns=options.columns,
            unit=options.unit,
            scale=options.scale,
            axes=Axes.of(options.axes),
            choice=Choice(options.sensor, is_name=True),
        )
        recording.columns = replace(recording.columns.with_only(*USED_COLUMNS), is_assumed=False)
        return cls(file, keys, recording)

    @property
    def start_s(self) -> float:
        """Seconds that are subtracted from the times of this file."""
        time = self.recording.columns.time
        return 0.0 if time is None else time.start * time.factor

    def batches(self, groups: Sequence[int], names: Interner) -> Iterator[tuple[Runs, list[NDArray[np.floating]]]]:
        """Yield the recording of each row, as run lengths, and K columns (B,), for each batch of B rows, in order.

        `names` numbers the recordings, and gets the hardware batch of each.
        """
        places = places_of(self.schema)
        wanted = [places[cell] for cell in self.recording.columns.cells]
        for batch in self.file.batches(groups, sorted({*(column for column, _, _ in wanted), *self.keys.columns})):
            with parser_errors(self.file.name, f"a table of {self.file.kind}"):
                values = [values_of(batch.column(column), part) for column, part, _ in wanted]
            yield _runs(batch, self.keys, names), values

    def samples(self, values: Values, source: str) -> Samples:
        """Make `Samples` from the K columns (N,) of a recording."""
        known = self.recording
        return known.columns.samples(values, unit=known.unit, axes=known.axes, source=source)

    @property
    def schema(self) -> Any:  # noqa: ANN401
        """Schema without the key columns."""
        return _schema_without_keys(self.file.schema, self.keys)


def no_units(name: str, columns: Sequence[str]) -> UsageError:
    """Error for a table without a column of units."""
    return UsageError(
        f"{name} has no known column of units: its columns are {', '.join(columns[:24])}; need a column "
        "such as unit or serial, or the name of that column",
        hint={"unit_column": None},
    )


def counts_of(file: TableFile, keys: KeyColumns, groups: Sequence[int], names: Interner) -> Counter[Pair]:
    """Count the rows of each recording in some groups, from the key columns alone."""
    counts: Counter[int] = Counter()
    if not keys.columns:
        number = names.number(keys.pair, keys.batch.value)
        counts[number] = sum(file.groups[group] for group in groups)
    for batch in file.batches(groups, list(keys.columns)) if keys.columns else ():
        runs = _runs(batch, keys, names)
        for number, rows in zip(runs.numbers.tolist(), runs.lengths.tolist(), strict=True):
            counts[number] += rows
    return Counter({names.pairs[number]: rows for number, rows in counts.items()})


def _first_rows(file: TableFile, names: list[str]) -> Iterator[Any]:
    """Rows of the first readable group, from which columns are recognised; UnreadableInput if there is none."""
    unreadable = None
    for group in range(len(file.groups)):
        try:
            yield from file.batches((group,), names, PREVIEW_ROWS)
        except UnreadableInput as error:
            unreadable = unreadable or error
    if unreadable is not None:
        raise unreadable


def _runs(batch: Any, keys: KeyColumns, names: Interner) -> Runs:  # noqa: ANN401
    """Recording of each row of a batch, as run lengths; `names` gives each recording a number, and stores its batch."""
    every = (keys.unit, keys.recording, keys.batch)
    coded = [_dictionary(batch, key.column) if key.column else ([key.value], None) for key in every]
    return runs_of(coded, batch.num_rows, names)


def runs_of(coded: Sequence[tuple[list[str], NDArray[np.integer] | None]], rows: int, names: Interner) -> Runs:
    """Run lengths of recordings, from three columns: unit, recording and hardware batch.

    A column is given as its distinct texts and the (N,) index of each row's text; None as index means that all rows
    have the first text.
    """
    is_first = np.ones(rows, dtype=bool)
    changes = [places[1:] != places[:-1] for _, places in coded if places is not None]
    is_first[1:] = np.logical_or.reduce(changes) if changes else False
    first = np.flatnonzero(is_first)
    shape = [len(texts) for texts, _ in coded]
    places = tuple(np.zeros_like(first) if own is None else own[first].astype(np.int64) for _, own in coded)
    distinct, inverse = np.unique(np.ravel_multi_index(places, shape), return_inverse=True)
    chosen = np.unravel_index(distinct, shape)
    units, recordings, batches = (
        [texts[place] for place in own.tolist()] for (texts, _), own in zip(coded, chosen, strict=True)
    )
    numbers = np.array([*map(names.number, zip(units, recordings, strict=True), batches)], dtype=np.int64)
    return Runs.join([Runs(numbers[inverse], np.diff(first, append=rows))])


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Recording of each row of a table, as a run-length code.

    >>> Runs(np.array([7, 4]), np.array([2, 1])).rows
    array([7, 7, 4])
    """

    numbers: NDArray[np.int64]  # (R,) recording of each run, by its number in an `Interner`
    lengths: NDArray[np.int64]  # (R,) rows of each run

    @property
    def rows(self) -> NDArray[np.int64]:
        """(N,) number of the recording of each row."""
        return np.repeat(self.numbers, self.lengths)

    @classmethod
    def join(cls, parts: Sequence[Runs]) -> Self:
        """Concatenate parts; a run that continues in the next part becomes one run."""
        numbers = np.concatenate([np.empty(0, dtype=np.int64), *(part.numbers for part in parts)])
        lengths = np.concatenate([np.empty(0, dtype=np.int64), *(part.lengths for part in parts)])
        first = np.flatnonzero(np.diff(numbers, prepend=-1))
        return cls(numbers[first], np.add.reduceat(lengths, first) if len(first) else lengths)


class Interner:
    """Numbering of recordings in the order of their first use, with the hardware batches of their units.

    >>> names = Interner()
    >>> names.number(("A17", "monday")), names.number(("A17", "friday"), "lot 7"), names.number(("A17", "monday"))
    (0, 1, 0)
    >>> names.pairs[1], names.batches
    (('A17', 'friday'), {('A17', 'friday'): 'lot 7'})
    """

    def __init__(self) -> None:
        self.pairs: list[Pair] = []
        self.batches: dict[Pair, str] = {}
        self._numbers: dict[Pair, int] = {}

    def number(self, pair: Pair, batch: str = "") -> int:
        """Number of a recording, given at its first use. Of several hardware batches, the first by name is kept."""
        number = self._numbers.setdefault(pair, len(self.pairs))
        if number == len(self.pairs):
            self.pairs.append(pair)
        if batch and batch <= self.batches.get(pair, batch):
            self.batches[pair] = batch
        return number


def extents_of(file: TableFile, keys: KeyColumns) -> list[tuple[str, str] | None]:
    """Least and greatest unit in each group; None if neither the file nor its path states them."""
    if not keys.unit.column:
        return [(keys.unit.value, keys.unit.value)] * len(file.groups)
    return file.extents(keys.unit.column)


def units_of(file: TableFile, keys: KeyColumns, groups: Sequence[int]) -> set[str]:
    """Units of some groups, from the column of units alone; for an unreadable group, the units in the footer."""
    if not keys.unit.column:
        return {keys.unit.value}
    try:
        return _units_in(file, keys, groups)
    except UnreadableInput:
        ends = extents_of(file, keys)
    units: set[str] = set()
    for group in groups:
        try:
            units |= _units_in(file, keys, (group,))
        except UnreadableInput:
            units.update(ends[group] or ())
    return units


def _units_in(file: TableFile, keys: KeyColumns, groups: Sequence[int]) -> set[str]:
    """Units of some groups, from the column of units alone; raises UnreadableInput."""
    units: set[str] = set()
    for batch in file.batches(groups, [keys.unit.column]):
        texts, places = _dictionary(batch, keys.unit.column)
        units.update(texts[place] for place in np.unique(places).tolist())
    return units


def _schema_without_keys(schema: Any, keys: KeyColumns) -> Any:  # noqa: ANN401
    """Schema without the key columns."""
    return needs_arrow().schema([field for field in schema if field.name not in keys.columns])


def _dictionary(batch: Any, column: str) -> tuple[list[str], NDArray[np.integer]]:  # noqa: ANN401
    """Distinct texts of a column, and (B,) the index of each row's text; null is the empty text."""
    arrow = needs_arrow()
    array = batch.column(batch.schema.get_field_index(column))
    if not arrow.types.is_dictionary(array.type):
        if arrow.types.is_floating(array.type):
            from pyarrow import compute

            array = compute.if_else(compute.is_nan(array), None, array)
        array = texts_of(array).dictionary_encode()
    texts = [text_of(value) for value in array.dictionary.to_pylist()]
    places = array.indices
    if places.null_count:
        places, texts = places.fill_null(len(texts)), [*texts, ""]
    return texts, cast("NDArray[np.integer]", np.from_dlpack(places))
