r"""Datasets of Parquet and Arrow files whose rows are readings of many units: files, row groups, columns of keys.

>>> import tempfile
>>> import pyarrow
>>> from pyarrow import parquet
>>> columns = {"unit": ["A17", "A17", "B02"], "x_uT": [1.0, 2.0, 3.0], "y_uT": [4.0, 5.0, 6.0], "z_uT": [7.0, 8.0, 9.0]}
>>> path = tempfile.mkdtemp() + "/fleet.parquet"
>>> parquet.write_table(pyarrow.table(columns), path)
>>> with opened(storage.StoredFile("fleet.parquet", path, 0), Options()) as file:
...     table = KeyedTable.of(file, Options())
...     [(runs, values)] = table.batches((0,), names := Interner())
...     file.groups, extents_of(file, table.keys), [names.pair(each) for each in runs.numbers.tolist()], runs.lengths
((3,), [('A17', 'B02')], [('A17', ''), ('B02', '')], array([2, 1]))
"""

from __future__ import annotations

import contextlib
import functools
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, cast
from urllib.parse import unquote

import numpy as np

from flinders.apps.fleet import storage
from flinders.apps.fleet.results import needs_arrow
from flinders.core.axes import Axes
from flinders.core.units import COUNTS, Unit
from flinders.errors import FlindersError, UnreadableInput, UsageError, reading
from flinders.readers import Choice
from flinders.readers._asked_columns import asked_columns
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

    from flinders.apps.fleet.storage import StoredFile
    from flinders.core.samples import Samples
    from flinders.readers import TableRecording
    from flinders.readers._columns import Values
    from flinders.readers.parquet import Extent

Pair: TypeAlias = tuple[str, str]
"""Unit and recording."""

PARQUET: Final = (".parquet", ".pq")
ARROW: Final = (".arrow", ".feather")
TABLES: Final = PARQUET + ARROW
UNIT_COLUMNS: Final = (
    "unit", "unit_id", "device", "device_id", "serial", "serial_number", "vehicle", "vehicle_id", "sensor_id",
)  # fmt: skip
"""Names of a column of units, unless an option names it."""
RECORDING_COLUMNS: Final = ("recording", "recording_id", "session", "session_id", "log", "log_id", "date")
"""Names of a column of recordings."""
BATCH_COLUMNS: Final = ("batch", "hw_batch", "lot", "hardware_batch", "hardware", "revision")
"""Names of a column of hardware batches."""
NO_VALUE: Final = "__HIVE_DEFAULT_PARTITION__"
"""Null in a path such as ``unit=__HIVE_DEFAULT_PARTITION__/part-0.parquet``."""
HALF: Final = 32
"""Bits of the number of a recording in a pair, below those of the number of its unit."""
BUFFER: Final = 1 << 20
"""Bytes of a column that are read at a time: a row group may hold any number of rows."""
BATCH: Final = 131_072
"""Rows that are converted at a time."""
PREVIEW: Final = 1_024
"""Rows from which columns are recognised."""
AS_THEY_ARE: Final = "x,y,z"
"""Axes of a sensor that are not exchanged."""
USED: Final = (TIME, STRENGTH, TEMPERATURE, CURRENT, THROTTLE, CURRENTS, THROTTLES)
"""Kinds of columns that a fit without aiding sensors uses; others are not read."""


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `flinders fleet` and `flinders.fit_many`: how recordings are read, and how their fits are judged.

    >>> Options(axes="x,x,z").check()
    Traceback (most recent call last):
        ...
    flinders.errors.AxesError: axes 'x,x,z': need x, y and z once each with signs, such as 'x,-y,-z' or '-y,x,z'
    """

    # as for `flinders.open_recording`
    columns: str | None = None
    unit: str | None = None
    scale: float | None = None
    axes: str = AS_THEY_ARE
    sensor: str | None = None
    as_logged: bool = False
    # of a table: the column, or part ``name=value`` of its path, with the unit, the recording and the hardware batch
    unit_column: str | None = None
    recording_column: str | None = None
    batch_column: str | None = None
    # as for `flinders.fit`
    target_deg: float = 1.0
    dip_deg: float = 60.0

    def check(self) -> None:
        """Refuse options that no recording can be read with.

        Raises `UsageError`.
        """
        if self.unit is not None or self.scale is not None:
            Unit.of(COUNTS if self.unit is None else self.unit, self.scale)
        if self.axes != AS_THEY_ARE:
            Axes.of(self.axes)
        if self.columns is not None:
            asked_columns(self.columns)


@dataclass(frozen=True, slots=True)
class TableFile:
    """An open file of rows."""

    name: str  # for messages
    kind: str
    schema: Any
    groups: tuple[int, ...]  # rows of each row group or record batch
    read: Callable[..., Iterator[Any]]  # as `batches`
    # least and greatest value of a column in each group, None if the file does not say
    extents: Callable[[str], list[tuple[str, str] | None]]

    @property
    def group(self) -> str:
        """Name of a group of rows in this kind of file."""
        return "row group" if self.kind == "Parquet" else "record batch"

    def batches(self, groups: Sequence[int], columns: list[str], rows: int = BATCH) -> Iterator[Any]:
        """Yield record batches of some groups and columns, of up to so many rows; raises UnreadableInput."""
        with reading(self.name, f"a table of {self.kind}"):
            yield from self.read(groups, columns, rows)


@contextlib.contextmanager
def opened(file: StoredFile, options: Options) -> Iterator[TableFile]:
    """Open a Parquet or Arrow file, of this machine or in a store; raises UnreadableInput if it is broken or gone."""
    needs_arrow()
    is_parquet = file.name.lower().endswith(PARQUET)
    with storage.opened(file) as where, reading(file.name, "a Parquet table" if is_parquet else "an Arrow file"):
        yield _parquet(file.name, where, file.size, options) if is_parquet else _arrow(file.name, where, file.size)


def _parquet(name: str, where: Any, size: int, options: Options) -> TableFile:  # noqa: ANN401
    """Open a Parquet file; keys stay the dictionaries that they were written as."""
    from pyarrow import parquet

    bounded = {"buffer_size": BUFFER, "pre_buffer": False, "page_checksum_verification": True}
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


def _extent(ends: Extent | None, kind: Any) -> tuple[str, str] | None:  # noqa: ANN401
    """Least and greatest text of a row group; None if it is not known, or values would sort differently."""
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
    """Open an Arrow file, of which only the columns that are read are unpacked."""
    import pyarrow
    from pyarrow import ipc

    source = pyarrow.memory_map(where) if isinstance(where, str) else where

    def only(places: Sequence[int]) -> Any:  # noqa: ANN401
        return ipc.open_file(source, options=ipc.IpcReadOptions(included_fields=list(places)))

    if isinstance(where, str):  # of a store, all of it would have to be fetched first
        rows_of_batches(source, name, size)
    whole = only(())
    schema, groups = whole.schema, _rows_of(whole, only)

    def batches(wanted: Sequence[int], columns: list[str], rows: int) -> Iterator[Any]:
        file = only([place for place, column in enumerate(schema.names) if column in columns])
        for number in wanted:
            batch = file.get_batch(number).select(columns)
            batch.validate(full=True)
            yield from (batch.slice(start, rows) for start in range(0, batch.num_rows, rows))

    return TableFile(name, "Arrow", schema, groups, batches, lambda _: [None] * len(groups))


def _rows_of(file: Any, only: Callable[[Sequence[int]], Any]) -> tuple[int, ...]:  # noqa: ANN401
    """Rows of each record batch, from its first readable column; 0 if none is, an error if no record batch is."""
    counts: dict[int, int] = {}
    unreadable = None
    for place in range(len(file.schema)):
        column = only([place])
        for number in set(range(file.num_record_batches)) - counts.keys():
            try:
                counts[number] = column.get_batch(number).num_rows
            except Exception as error:  # noqa: BLE001 - on a broken file that is anything, as in `reading`
                unreadable = error
        if len(counts) == file.num_record_batches:
            break
    if unreadable is not None and not any(counts.values()):
        raise unreadable
    return tuple(counts.get(number, 0) for number in range(file.num_record_batches))


@dataclass(frozen=True, slots=True)
class KeyColumns:
    """Columns of a table, or values in its path, that identify unit, recording and hardware batch of a row."""

    unit: str = ""  # columns; empty if the path holds the value, or nothing does
    recording: str = ""
    unit_value: str = ""  # values in the path
    recording_value: str = ""
    batch: str = ""  # columns; empty if the path holds the value, or nothing does
    batch_value: str = ""  # values in the path

    @classmethod
    def of(cls, name: str, columns: Sequence[str], options: Options, *, needs_batch: bool = True) -> Self | None:
        """Find them among columns and in a path such as ``unit=A17/part-0.parquet``; None without a unit.

        Raises UsageError if one that the options name is in neither.

        >>> KeyColumns.of("serial=7/date=2026-11-21/part-0.parquet", ["t", "x", "y", "z"], Options())
        KeyColumns(unit='', recording='', unit_value='7', recording_value='2026-11-21', batch='', batch_value='')
        """
        values = in_path(name)
        unit = _key(values, columns, options.unit_column, UNIT_COLUMNS, name)
        if unit is None:
            return None
        recording = _key(values, columns, options.recording_column, RECORDING_COLUMNS, name) or ("", "")
        batch = _key(values, columns, options.batch_column, BATCH_COLUMNS, name, needed=needs_batch) or ("", "")
        return cls(unit[0], recording[0], unit[1], recording[1], *batch)

    @classmethod
    def of_schema(cls, name: str, schema: Any, options: Options) -> Self | None:  # noqa: ANN401
        """Find them as `of`; a nested column is no batch, and a table may lack the batch that the options name.

        Raises UsageError if the unit or the recording that the options name is nowhere, UnreadableInput if a column of
        keys is nested or duplicate.
        """
        own = (options.recording_column, RECORDING_COLUMNS), (options.batch_column, BATCH_COLUMNS)
        guessed = {column for named, usual in own if named is None for column in usual}
        columns = [field.name for field in schema if field.name.casefold() not in guessed or _is_text(field.type)]
        keys = cls.of(name, columns, options, needs_batch=False)
        for column in keys.columns if keys else ():
            _refuse_column(name, schema, column)
        return keys

    @classmethod
    def of_path(cls, name: str, options: Options) -> Self | None:
        """Keys from the path of a file that cannot be opened; None if it does not name the unit."""
        with contextlib.suppress(UsageError):
            keys = cls.of(name, (), replace(options, recording_column=None, batch_column=None))
            return keys if keys is not None and keys.unit_value else None
        return None

    @property
    def columns(self) -> tuple[str, ...]:
        """Keys that are columns."""
        return tuple(filter(None, (self.unit, self.recording, self.batch)))


@functools.lru_cache(maxsize=256)
def _is_text(kind: Any) -> bool:  # noqa: ANN401
    """Whether values of a type of Arrow can be texts: those of a struct or a list cannot."""
    arrow = needs_arrow()
    try:
        _texts(arrow.nulls(0, kind)).dictionary_encode()
    except arrow.ArrowException:
        return False
    return True


def _refuse_column(name: str, schema: Any, column: str) -> None:  # noqa: ANN401
    """Refuse a column of keys that is nested or duplicate."""
    count = schema.names.count(column)
    if count > 1:
        raise UnreadableInput(f"{name} has {count} columns {column}: give all but one another name, or leave them out")
    kind = schema.field(column).type
    if not _is_text(kind):
        raise UnreadableInput(
            f"{name}: column {column} holds {kind}, which names nothing: make it a column of texts or numbers, or give "
            "it another name"
        )


def in_path(name: str) -> dict[str, str]:
    """Values in the folders of a path, as Hive writes it; null is the empty text.

    >>> in_path("unit=A%2017/date=__HIVE_DEFAULT_PARTITION__/part-0.parquet")
    {'unit': 'A 17', 'date': ''}
    """
    parts = (part.split("=", 1) for part in PurePosixPath(name).parts[:-1] if "=" in part)
    return {key: "" if value == NO_VALUE else text_of(unquote(value)) for key, value in parts}


def batch_in(name: str, options: Options) -> str:
    """Hardware batch in the path of a log; empty if there is none.

    >>> batch_in("batch=2026-04/A17/monday.csv", Options())
    '2026-04'
    """
    values = in_path(name)
    wanted = BATCH_COLUMNS if options.batch_column is None else (options.batch_column,)
    return next((values[each] for each in wanted if each in values), "")


def _key(
    values: dict[str, str],
    columns: Sequence[str],
    column: str | None,
    usual: Sequence[str],
    name: str,
    *,
    needed: bool = True,
) -> tuple[str, str] | None:
    """Column that holds a key, or its value in the path; UsageError if one that is named and needed is in neither."""
    lowered = {each.casefold(): each for each in reversed(columns)}
    for wanted in usual if column is None else (column,):
        if wanted in values:
            return "", values[wanted]
        if wanted.casefold() in lowered:
            return lowered[wanted.casefold()], ""
    if column is not None and needed:
        raise UsageError(f"{name} has no column {column}: there are {', '.join(columns[:24])}")
    return None


@dataclass(frozen=True, slots=True, eq=False)
class KeyedTable:
    """A table of readings of units."""

    file: TableFile
    keys: KeyColumns
    recording: TableRecording  # its columns, unit of field and axes

    @classmethod
    def of(cls, file: TableFile, options: Options) -> Self:
        """Recognise the columns.

        Raises NoMagnetometer if none, or not clearly three, are the magnetometer, UsageError if there is no column of
        units, and for options that the file does not fit.
        """
        names = list(file.schema.names)
        keys = KeyColumns.of_schema(file.name, file.schema, options)
        if keys is None:
            raise UsageError(
                f"{file.name} does not say which unit a row is of: there are {', '.join(names[:24])}; need a column "
                "such as unit or serial, or its name",
                hint={"unit_column": None},
            )
        table = table_of(
            file.kind,
            _without(file.schema, keys),
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
        recording.columns = replace(recording.columns.only(*USED), is_assumed=False)
        return cls(file, keys, recording)

    @property
    def start_s(self) -> float:
        """Seconds that are subtracted from the times of this file."""
        time = self.recording.columns.time
        return 0.0 if time is None else time.start * time.factor

    def batches(self, groups: Sequence[int], names: Interner) -> Iterator[tuple[Runs, list[NDArray[np.floating]]]]:
        """Yield recordings, as numbers of `names`, which takes their hardware batches, and K columns (B,), in order."""
        places = places_of(self.schema)
        wanted = [places[cell] for cell in self.recording.columns.cells]
        for batch in self.file.batches(groups, sorted({*(column for column, _, _ in wanted), *self.keys.columns})):
            if not batch.num_rows:
                continue
            with reading(self.file.name, f"a table of {self.file.kind}"):
                values = [values_of(batch.column(column), part) for column, part, _ in wanted]
            yield _runs(batch, self.keys, names), values

    def samples(self, values: Values, source: str) -> Samples:
        """Samples of K columns (N,)."""
        known = self.recording
        return known.columns.samples(values, unit=known.unit, axes=known.axes, source=source)

    @property
    def schema(self) -> Any:  # noqa: ANN401
        """Columns that are no keys."""
        return _without(self.file.schema, self.keys)


def counts_of(file: TableFile, keys: KeyColumns, groups: Sequence[int], names: Interner) -> Counter[Pair]:
    """Count the rows of each recording in some groups, from the columns of keys alone."""
    counts: Counter[int] = Counter()
    if not keys.unit and not keys.recording:
        number = names.number(keys.unit_value) << HALF | names.number(keys.recording_value)
        counts[number] = sum(file.groups[group] for group in groups)
        names.note(number, keys.batch_value)
    for batch in file.batches(groups, list(keys.columns)) if keys.columns else ():
        runs = _runs(batch, keys, names)
        if keys.unit or keys.recording:
            for number, rows in zip(runs.numbers.tolist(), runs.lengths.tolist(), strict=True):
                counts[number] += rows
    return Counter({names.pair(number): rows for number, rows in counts.items()})


def _first_rows(file: TableFile, names: list[str]) -> Iterator[Any]:
    """Rows of the first readable group, from which columns are recognised; UnreadableInput if there is none."""
    unreadable = None
    for group in range(len(file.groups)):
        try:
            yield from file.batches((group,), names, PREVIEW)
        except UnreadableInput as error:
            unreadable = unreadable or error
    if unreadable is not None:
        raise unreadable


def _runs(batch: Any, keys: KeyColumns, names: Interner) -> Runs:  # noqa: ANN401
    """Run lengths of pairs of unit and recording."""
    units = _coded(batch, keys.unit, keys.unit_value, names)
    recordings = _coded(batch, keys.recording, keys.recording_value, names)
    is_first = np.ones(batch.num_rows, dtype=bool)
    changes = [places[1:] != places[:-1] for _, places in (units, recordings) if places is not None]
    is_first[1:] = np.logical_or.reduce(changes) if changes else False
    first = np.flatnonzero(is_first)
    unit, recording = (
        codes[np.zeros_like(first) if places is None else places[first]] for codes, places in (units, recordings)
    )
    runs = Runs(unit << HALF | recording, np.diff(first, append=batch.num_rows))
    if keys.batch or keys.batch_value:
        _note(runs, batch, keys, names)
    return runs


def _note(runs: Runs, batch: Any, keys: KeyColumns, names: Interner) -> None:  # noqa: ANN401
    """Record the hardware batches of rows."""
    numbers, inverse = np.unique(runs.numbers, return_inverse=True)
    if not keys.batch:
        for number in numbers.tolist():
            names.note(number, keys.batch_value)
        return
    texts, places = _dictionary(batch, keys.batch)
    both = np.repeat(inverse, runs.lengths) * len(texts) + places.astype(np.int64)
    both = np.unique(both[np.flatnonzero(np.diff(both, prepend=-1))])
    for number, place in zip(numbers[both // len(texts)].tolist(), (both % len(texts)).tolist(), strict=True):
        names.note(number, texts[place])


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Run lengths of the numbers of recordings, of consecutive rows.

    >>> Runs(np.array([7, 4]), np.array([2, 1])).rows
    array([7, 7, 4])
    """

    numbers: NDArray[np.int64]  # (R,)
    lengths: NDArray[np.int64]  # (R,) rows of each run

    @property
    def rows(self) -> NDArray[np.int64]:
        """(N,) the number of each row."""
        return np.repeat(self.numbers, self.lengths)

    @classmethod
    def joined(cls, parts: Sequence[Runs]) -> Self:
        """Concatenate; a run that continues in the next part is one."""
        numbers = np.concatenate([np.empty(0, dtype=np.int64), *(part.numbers for part in parts)])
        lengths = np.concatenate([np.empty(0, dtype=np.int64), *(part.lengths for part in parts)])
        first = np.flatnonzero(np.diff(numbers, prepend=-1))
        return cls(numbers[first], np.add.reduceat(lengths, first) if len(first) else lengths)


class Interner:
    """Numbers for texts, in the order of their first use; a pair of them is one number, and may have a hardware batch.

    >>> names = Interner()
    >>> pair = names.number("A17") << HALF | names.number("monday")
    >>> names.pair(pair)
    ('A17', 'monday')
    """

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._texts: list[str] = []
        self._batches: dict[int, str] = {}

    def number(self, text: str) -> int:
        """The number of a text, a new one for a new text."""
        number = self._numbers.setdefault(text, len(self._texts))
        if number == len(self._texts):
            self._texts.append(text)
        return number

    def pair(self, number: int) -> Pair:
        """Unit and recording of a number."""
        return self._texts[number >> HALF], self._texts[number & (1 << HALF) - 1]

    def note(self, number: int, batch: str) -> None:
        """Record the hardware batch of a pair; of several the first by name."""
        if batch and batch <= self._batches.get(number, batch):
            self._batches[number] = batch

    @property
    def batches(self) -> dict[Pair, str]:
        """Hardware batches of pairs that have one."""
        return {self.pair(number): batch for number, batch in self._batches.items()}


def extents_of(file: TableFile, keys: KeyColumns) -> list[tuple[str, str] | None]:
    """Least and greatest unit in each group; None if neither file nor path says."""
    if not keys.unit:
        return [(keys.unit_value, keys.unit_value)] * len(file.groups)
    return file.extents(keys.unit)


def units_of(file: TableFile, keys: KeyColumns, groups: Sequence[int]) -> set[str]:
    """Units of some groups, from their column alone; of an unreadable group those that the footer names."""
    if not keys.unit:
        return {keys.unit_value}
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
    """Units of some groups, from their column alone; raises UnreadableInput."""
    units: set[str] = set()
    for batch in file.batches(groups, [keys.unit]):
        texts, places = _dictionary(batch, keys.unit)
        units.update(texts[place] for place in np.unique(places).tolist())
    return units


def _without(schema: Any, keys: KeyColumns) -> Any:  # noqa: ANN401
    """Columns of a schema that are no keys."""
    return needs_arrow().schema([field for field in schema if field.name not in keys.columns])


def _coded(
    batch: Any,  # noqa: ANN401
    column: str,
    value: str,
    names: Interner,
) -> tuple[NDArray[np.int64], NDArray[np.integer] | None]:
    """Numbers of texts, and (B,) the index of each row's; None if the path has one text for all rows."""
    texts, places = _dictionary(batch, column) if column else ([value], None)
    return np.array([names.number(text) for text in texts], dtype=np.int64), places


def _dictionary(batch: Any, column: str) -> tuple[list[str], NDArray[np.integer]]:  # noqa: ANN401
    """Distinct texts of a column, and (B,) the index of each row's; null is the empty text."""
    arrow = needs_arrow()
    array = batch.column(batch.schema.get_field_index(column))
    if not arrow.types.is_dictionary(array.type):
        if arrow.types.is_floating(array.type):
            from pyarrow import compute

            array = compute.if_else(compute.is_nan(array), None, array)
        array = _texts(array).dictionary_encode()
    texts = [text_of(value) for value in array.dictionary.to_pylist()]
    places = array.indices
    if places.null_count:
        places, texts = places.fill_null(len(texts)), [*texts, ""]
    return texts, cast("NDArray[np.integer]", np.from_dlpack(places))


def _texts(array: Any) -> Any:  # noqa: ANN401
    """Column of keys as texts; bytes and dictionaries stay as they are; raises ArrowException."""
    arrow = needs_arrow()
    is_text = "binary" in str(array.type) or arrow.types.is_dictionary(array.type)
    return array if is_text else array.cast(arrow.string())


def text_of(value: object) -> str:
    r"""Cell of a column of keys as text: bytes are UTF-8 if valid, blanks are empty.

    >>> text_of(b"A17"), text_of(b"\xff\x00"), text_of(7), text_of("  "), text_of(None)
    ('A17', 'ff00', '7', '', '')
    """
    if value is None:
        return ""
    if isinstance(value, bytes):
        try:
            text = value.decode()
        except UnicodeDecodeError:
            text = value.hex()
    else:
        text = str(value)
    return text if text.strip() else ""
