r"""Parquet and Arrow files whose rows are readings of many units: how they are opened, and which rows are whose.

>>> import tempfile
>>> import pyarrow
>>> from pyarrow import parquet
>>> columns = {"unit": ["A17", "A17", "B02"], "x_uT": [1.0, 2.0, 3.0], "y_uT": [4.0, 5.0, 6.0], "z_uT": [7.0, 8.0, 9.0]}
>>> path = tempfile.mkdtemp() + "/fleet.parquet"
>>> parquet.write_table(pyarrow.table(columns), path)
>>> with opened(store.Member("fleet.parquet", path, 0), Asked()) as file:
...     table = KeyedTable.of(file, Asked())
...     [(runs, values)] = table.batches((0,), names := Names())
...     file.groups, extents_of(file, table.keys), [names.pair(each) for each in runs.numbers.tolist()], runs.lengths
((3,), [('A17', 'B02')], [('A17', ''), ('B02', '')], array([2, 1]))
"""

from __future__ import annotations

import contextlib
import functools
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias
from urllib.parse import unquote

import numpy as np

from flinders.core.axes import Axes
from flinders.errors import FlindersError, UnreadableInput, UsageError
from flinders.fleet import store
from flinders.fleet.table import needs_arrow
from flinders.readers import Choice
from flinders.readers._extras import reading
from flinders.readers._names import CURRENT, CURRENTS, STRENGTH, TEMPERATURE, THROTTLE, THROTTLES, TIME
from flinders.readers._source import File
from flinders.readers._table import open_table
from flinders.readers.parquet import places_of, table_of, values_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fleet.store import Member
    from flinders.readers import TableRecording

Pair: TypeAlias = tuple[str, str]
"""Unit and recording."""

PARQUET: Final = (".parquet", ".pq")
ARROW: Final = (".arrow", ".feather")
TABLES: Final = PARQUET + ARROW
UNIT_COLUMNS: Final = (
    "unit", "unit_id", "device", "device_id", "serial", "serial_number", "vehicle", "vehicle_id", "sensor_id",
)  # fmt: skip
"""What a column is called that says which unit a row is of, where nobody says."""
RECORDING_COLUMNS: Final = ("recording", "recording_id", "session", "session_id", "log", "log_id", "date")
"""The same for which recording of it."""
BATCH_COLUMNS: Final = ("batch", "hw_batch", "lot", "hardware_batch", "hardware", "revision")
"""The same for the batch of hardware that the unit is of."""
NO_VALUE: Final = "__HIVE_DEFAULT_PARTITION__"
"""What stands for null in a path such as ``unit=__HIVE_DEFAULT_PARTITION__/part-0.parquet``."""
HALF: Final = 32
"""Bits of the number of a recording, below those of its unit."""
BUFFER: Final = 1 << 20
"""Bytes of a column that are read at a time: a row group may hold any number of rows."""
BATCH: Final = 131_072
"""Rows that are converted at a time."""
LOOKED_AT: Final = 1_024
"""Rows that columns are recognised by."""
HAVE_A_SAY: Final = (TIME, STRENGTH, TEMPERATURE, CURRENT, THROTTLE, CURRENTS, THROTTLES)
"""Kinds of columns that a fit without aids looks at; others are not read."""


@dataclass(frozen=True, slots=True)
class Asked:
    """How recordings are to be read, and what their fits are held against; as the options of `flinders fleet`.

    Attributes
    ----------
    columns, unit, scale, axes, sensor, as_logged
        As `flinders.open_recording`.
    unit_column, recording_column, batch_column : str, optional
        Of a table: which column, or part ``name=value`` of its path, says whose reading a row is, and of which batch
        of hardware its unit.
    target_deg, dip_deg : float
        As `flinders.fit`.
    polish : bool
        Go through the readings again; without, sums are all that is used.
    """

    columns: str | None = None
    unit: str | None = None
    scale: float | None = None
    axes: str = "x,y,z"
    sensor: str | None = None
    as_logged: bool = False
    unit_column: str | None = None
    recording_column: str | None = None
    batch_column: str | None = None
    target_deg: float = 1.0
    dip_deg: float = 60.0
    polish: bool = True


@dataclass(frozen=True, slots=True)
class Tabular:
    """An open file of rows.

    Attributes
    ----------
    name, kind : str
        For messages.
    schema : pyarrow.Schema
    groups : tuple of int
        Rows of each row group or record batch.
    batches : callable
        Yields record batches of some groups and columns, of so many rows at the most.
    extents : callable
        Least and greatest value of a column in each group, None where the file does not say.
    """

    name: str
    kind: str
    schema: Any
    groups: tuple[int, ...]
    batches: Callable[..., Iterator[Any]]
    extents: Callable[[str], list[tuple[str, str] | None]]

    @property
    def group(self) -> str:
        """What a group is called."""
        return "row group" if self.kind == "Parquet" else "record batch"


def refuse_empty(file: Tabular) -> None:
    """Refuse a table without rows.

    Raises
    ------
    UnreadableInput
    """
    if not sum(file.groups):
        raise UnreadableInput(f"{file.name} has no rows: record again, or check what was saved")


@contextlib.contextmanager
def opened(member: Member, asked: Asked) -> Iterator[Tabular]:
    """Open a Parquet or Arrow file, here or in a store.

    Raises
    ------
    UnreadableInput
        For a file that is gone, broken or cut short.
    """
    needs_arrow()
    with store.opened(member) as where:
        if member.name.lower().endswith(PARQUET):
            yield _parquet(member.name, where, asked)
        else:
            yield _arrow(member.name, where)


def _parquet(name: str, where: Any, asked: Asked) -> Tabular:  # noqa: ANN401
    """Open Parquet; keys are kept as the dictionaries that they were written as."""
    from pyarrow import parquet

    bounded = {"buffer_size": BUFFER, "pre_buffer": False, "page_checksum_verification": True}
    with reading(name, "a Parquet table"):
        file = parquet.ParquetFile(where, **bounded)
        texts: list[str] = []
        with contextlib.suppress(FlindersError):  # who looks for the keys is told
            keys = Keys.of_schema(name, file.schema_arrow, asked)
            texts += keys.columns if keys else ()
        if texts:
            file = parquet.ParquetFile(where, metadata=file.metadata, read_dictionary=texts, **bounded)
        metadata = file.metadata
        groups = tuple(metadata.row_group(group).num_rows for group in range(metadata.num_row_groups))

    def batches(wanted: Sequence[int], columns: list[str], rows: int = BATCH) -> Iterator[Any]:
        with reading(name, "a Parquet table"):
            yield from file.iter_batches(rows, row_groups=list(wanted), columns=columns, use_threads=False)

    def extents(column: str) -> list[tuple[str, str] | None]:
        leaves = [metadata.schema.column(place).path for place in range(len(metadata.schema))]
        if column not in leaves:
            return [None] * len(groups)
        place = leaves.index(column)
        return [_extent(metadata.row_group(group).column(place).statistics) for group in range(len(groups))]

    return Tabular(name, "Parquet", file.schema_arrow, groups, batches, extents)


def _extent(statistics: Any) -> tuple[str, str] | None:  # noqa: ANN401
    """Least and greatest text of a row group; None where it is not known, or numbers would be in another order."""
    if statistics is None or not statistics.has_min_max or statistics.null_count:
        return None
    ends = statistics.min, statistics.max
    if isinstance(ends[0], bool | float) or not isinstance(ends[0], str | bytes | int):
        return None  # these are written in another way in a column of texts
    least, greatest = map(text_of, ends)
    is_known = least <= greatest if isinstance(ends[0], str) else least == greatest
    return (least, greatest) if is_known else None


def _arrow(name: str, where: Any) -> Tabular:  # noqa: ANN401
    """Open an Arrow file, of which no more columns are unpacked than are asked for."""
    import pyarrow
    from pyarrow import ipc

    source = pyarrow.memory_map(where) if isinstance(where, str) else where

    def only(places: Sequence[int]) -> Any:  # noqa: ANN401
        return ipc.open_file(source, options=ipc.IpcReadOptions(included_fields=list(places)))

    with reading(name, "an Arrow file"):
        whole = only(())
        schema, groups = whole.schema, _rows_of(whole, only)

    def batches(wanted: Sequence[int], columns: list[str], rows: int = BATCH) -> Iterator[Any]:
        with reading(name, "an Arrow file"):
            file = only([place for place, column in enumerate(schema.names) if column in columns])
            for number in wanted:
                batch = file.get_batch(number).select(columns)
                batch.validate(full=True)
                yield from (batch.slice(start, rows) for start in range(0, batch.num_rows, rows))

    return Tabular(name, "Arrow", schema, groups, batches, lambda _: [None] * len(groups))


def _rows_of(file: Any, only: Callable[[Sequence[int]], Any]) -> tuple[int, ...]:  # noqa: ANN401
    """Rows of each record batch, as the first of its columns tells that can be read; 0 where none can.

    Raises
    ------
    Exception
        What Arrow raises, where no record batch can be read.
    """
    counts: dict[int, int] = {}
    refused = None
    for place in range(len(file.schema)):
        column = only([place])
        for number in set(range(file.num_record_batches)) - counts.keys():
            try:
                counts[number] = column.get_batch(number).num_rows
            except Exception as error:  # noqa: BLE001 - on a broken file that is anything, as in `reading`
                refused = error
        if len(counts) == file.num_record_batches:
            break
    if refused is not None and not any(counts.values()):
        raise refused
    return tuple(counts.get(number, 0) for number in range(file.num_record_batches))


class NoBatch(UsageError):
    """A column that was asked for as the batch of hardware, and is not there."""


@dataclass(frozen=True, slots=True)
class Keys:
    """Where a table says whose reading a row is.

    Attributes
    ----------
    unit, recording, batch : str
        The columns; empty where the path says it, or nothing does.
    unit_value, recording_value, batch_value : str
        What the path says.
    """

    unit: str = ""
    recording: str = ""
    unit_value: str = ""
    recording_value: str = ""
    batch: str = ""
    batch_value: str = ""

    @classmethod
    def of(cls, name: str, columns: Sequence[str], asked: Asked) -> Self | None:
        """Find them in the names of columns and in a path such as ``unit=A17/part-0.parquet``; None without a unit.

        Raises
        ------
        UsageError
            Where one that was asked for is in neither.

        Examples
        --------
        >>> Keys.of("serial=7/date=2026-11-21/part-0.parquet", ["t", "x", "y", "z"], Asked())
        Keys(unit='', recording='', unit_value='7', recording_value='2026-11-21', batch='', batch_value='')
        """
        values = in_path(name)
        unit = _key(values, columns, asked.unit_column, UNIT_COLUMNS, name)
        if unit is None:
            return None
        recording = _key(values, columns, asked.recording_column, RECORDING_COLUMNS, name) or ("", "")
        try:
            batch = _key(values, columns, asked.batch_column, BATCH_COLUMNS, name) or ("", "")
        except UsageError as error:
            raise NoBatch(str(error)) from None
        return cls(unit[0], recording[0], unit[1], recording[1], *batch)

    @classmethod
    def of_schema(cls, name: str, schema: Any, asked: Asked) -> Self | None:  # noqa: ANN401
        """Find them as `of`; what is nested is no batch, and a table need not have the batch that was asked for.

        Raises
        ------
        UsageError
            Where the unit or the recording that was asked for is nowhere.
        UnreadableInput
            Where the column of units, or one that was asked for, is nested, or there twice.
        """
        own = (asked.recording_column, RECORDING_COLUMNS), (asked.batch_column, BATCH_COLUMNS)
        guessed = {column for named, usual in own if named is None for column in usual}
        columns = [field.name for field in schema if field.name.casefold() not in guessed or _is_text(field.type)]
        try:
            keys = cls.of(name, columns, asked)
        except NoBatch:
            keys = cls.of(name, columns, replace(asked, batch_column=None))
            keys = keys and replace(keys, batch="", batch_value="")
        for column in keys.columns if keys else ():
            _refuse_column(name, schema, column)
        return keys

    @classmethod
    def of_path(cls, name: str, asked: Asked) -> Self | None:
        """What the path of a file says that cannot be opened; None where it does not say the unit."""
        with contextlib.suppress(UsageError):
            keys = cls.of(name, (), replace(asked, recording_column=None, batch_column=None))
            return keys if keys is not None and keys.unit_value else None
        return None

    @property
    def columns(self) -> tuple[str, ...]:
        """Those of them that are columns."""
        return tuple(filter(None, (self.unit, self.recording, self.batch)))


@functools.lru_cache(maxsize=256)
def _is_text(kind: Any) -> bool:  # noqa: ANN401
    """Whether the values of a type of Arrow can be written as texts: those of a struct or a list cannot."""
    arrow = needs_arrow()
    try:
        _texts(arrow.nulls(0, kind)).dictionary_encode()
    except arrow.ArrowException:
        return False
    return True


def _refuse_column(name: str, schema: Any, column: str) -> None:  # noqa: ANN401
    """Refuse a column that cannot tell whose rows they are.

    Raises
    ------
    UnreadableInput
    """
    there = schema.names.count(column)
    if there > 1:
        raise UnreadableInput(f"{name} has {there} columns {column}: give all but one another name, or leave them out")
    kind = schema.field(column).type
    if not _is_text(kind):
        raise UnreadableInput(
            f"{name}: column {column} holds {kind}, which names nothing: make it a column of texts or numbers, or give "
            "it another name"
        )


def in_path(name: str) -> dict[str, str]:
    """What the folders of a path say, as Hive and others write it: null is the empty text.

    >>> in_path("unit=A%2017/date=__HIVE_DEFAULT_PARTITION__/part-0.parquet")
    {'unit': 'A 17', 'date': ''}
    """
    parts = (part.split("=", 1) for part in PurePosixPath(name).parts[:-1] if "=" in part)
    return {key: "" if value == NO_VALUE else text_of(unquote(value)) for key, value in parts}


def batch_in(name: str, asked: Asked) -> str:
    """The batch that the path of a log says; empty where it says none.

    >>> batch_in("batch=2026-04/A17/monday.csv", Asked())
    '2026-04'
    """
    values = in_path(name)
    wanted = BATCH_COLUMNS if asked.batch_column is None else (asked.batch_column,)
    return next((values[each] for each in wanted if each in values), "")


def _key(
    values: dict[str, str], columns: Sequence[str], asked: str | None, usual: Sequence[str], name: str
) -> tuple[str, str] | None:
    """The column that holds a key, or its value in the path; None where neither does.

    Raises
    ------
    UsageError
        Where the one that was asked for is in neither.
    """
    lowered = {column.casefold(): column for column in reversed(columns)}
    for wanted in usual if asked is None else (asked,):
        if wanted in values:
            return "", values[wanted]
        if wanted.casefold() in lowered:
            return lowered[wanted.casefold()], ""
    if asked is not None:
        raise UsageError(f"{name} has no column {asked}: there are {', '.join(columns[:24])}")
    return None


@dataclass(frozen=True, slots=True, eq=False)
class KeyedTable:
    """A table of readings of units.

    Attributes
    ----------
    file : Tabular
    keys : Keys
    recording : TableRecording
        Knows which columns are what, the unit and the axes.
    """

    file: Tabular
    keys: Keys
    recording: TableRecording

    @classmethod
    def of(cls, file: Tabular, asked: Asked) -> Self:
        """Recognise the columns.

        Raises
        ------
        NoMagnetometer
            Where none, or not clearly three, are the magnetometer.
        UsageError
            Where no column says which unit a row is of, and for columns and units that cannot be.
        """
        names = list(file.schema.names)
        keys = Keys.of_schema(file.name, file.schema, asked)
        if keys is None:
            raise UsageError(
                f"{file.name} does not say which unit a row is of: need a column such as unit or serial, or name it "
                f"with --unit-column; there are {', '.join(names[:24])}"
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
            columns=asked.columns,
            unit=asked.unit,
            scale=asked.scale,
            axes=Axes.of(asked.axes),
            choice=Choice(asked.sensor, is_name=True),
        )
        recording.columns = recording.columns.only(*HAVE_A_SAY)
        return cls(file, keys, recording)

    @property
    def start_s(self) -> float:
        """What is taken off the times of this file, s."""
        time = self.recording.columns.time
        return 0.0 if time is None else time.start * time.factor

    def batches(self, groups: Sequence[int], names: Names) -> Iterator[tuple[Runs, Floats]]:
        """Yield whose rows they are, numbered by `names`, which get to know batches, and values (K, B), in order."""
        places = places_of(self.schema)
        wanted = [places[cell] for cell in self.recording.columns.cells]
        for batch in self.file.batches(groups, sorted({*(column for column, _, _ in wanted), *self.keys.columns})):
            if not batch.num_rows:
                continue
            values = np.empty((len(wanted), batch.num_rows))
            with reading(self.file.name, f"a table of {self.file.kind}"):
                for row, (column, part, _) in zip(values, wanted, strict=True):
                    row[:] = values_of(batch.column(column), part)
            yield _runs(batch, self.keys, names), values

    def samples(self, values: Floats, source: str) -> Samples:
        """Readings of values (K, N)."""
        known = self.recording
        return known.columns.samples(values.T, unit=known.unit, axes=known.axes, source=source)

    @property
    def schema(self) -> Any:  # noqa: ANN401
        """The columns that are no keys."""
        return _without(self.file.schema, self.keys)


def counts_of(file: Tabular, keys: Keys, groups: Sequence[int], names: Names) -> Counter[Pair]:
    """How many rows each recording of each unit has in some groups, from the columns of keys alone."""
    found: Counter[int] = Counter()
    if not keys.unit and not keys.recording:
        number = names.number(keys.unit_value) << HALF | names.number(keys.recording_value)
        found[number] = sum(file.groups[group] for group in groups)
        names.note(number, keys.batch_value)
    for batch in file.batches(groups, list(keys.columns)) if keys.columns else ():
        runs = _runs(batch, keys, names)
        if keys.unit or keys.recording:
            for number, rows in zip(runs.numbers.tolist(), runs.lengths.tolist(), strict=True):
                found[number] += rows
    return Counter({names.pair(number): rows for number, rows in found.items()})


def _first_rows(file: Tabular, names: list[str]) -> Iterator[Any]:
    """Rows of the first group that can be read, which columns are recognised by.

    Raises
    ------
    UnreadableInput
        Where none can.
    """
    refused = None
    for group in range(len(file.groups)):
        try:
            yield from file.batches((group,), names, LOOKED_AT)
        except UnreadableInput as error:
            refused = refused or error
    if refused is not None:
        raise refused


def _runs(batch: Any, keys: Keys, names: Names) -> Runs:  # noqa: ANN401
    """Numbers of the pairs of unit and recording of rows that follow each other."""
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


def _note(runs: Runs, batch: Any, keys: Keys, names: Names) -> None:  # noqa: ANN401
    """Take note of the batches of hardware that rows name."""
    numbers, of = np.unique(runs.numbers, return_inverse=True)
    if not keys.batch:
        for number in numbers.tolist():
            names.note(number, keys.batch_value)
        return
    texts, places = _dictionary(batch, keys.batch)
    both = np.repeat(of, runs.lengths) * len(texts) + places
    both = np.unique(both[np.flatnonzero(np.diff(both, prepend=-1))])
    for number, place in zip(numbers[both // len(texts)].tolist(), (both % len(texts)).tolist(), strict=True):
        names.note(number, texts[place])


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Whose rows they are, of rows that follow each other.

    >>> Runs(np.array([7, 4]), np.array([2, 1])).rows
    array([7, 7, 4])

    Attributes
    ----------
    numbers : (R,) int
    lengths : (R,) int
        How many rows each run has.
    """

    numbers: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @property
    def rows(self) -> NDArray[np.int64]:
        """(N,) the number of each row."""
        return np.repeat(self.numbers, self.lengths)

    @classmethod
    def joined(cls, parts: Sequence[Runs]) -> Self:
        """One after the other; a run that goes on in the next part is one."""
        numbers = np.concatenate([np.empty(0, dtype=np.int64), *(part.numbers for part in parts)])
        lengths = np.concatenate([np.empty(0, dtype=np.int64), *(part.lengths for part in parts)])
        first = np.flatnonzero(np.diff(numbers, prepend=-1))
        return cls(numbers[first], np.add.reduceat(lengths, first) if len(first) else lengths)


class Names:
    """Texts and their numbers, in the order in which they were met; a pair of them is one number, and has a batch.

    >>> names = Names()
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
        """Keep the batch of hardware of a pair; of several the first in the order of their names."""
        if batch and batch <= self._batches.get(number, batch):
            self._batches[number] = batch

    @property
    def batches(self) -> dict[Pair, str]:
        """The batches of those pairs that have one."""
        return {self.pair(number): batch for number, batch in self._batches.items()}


def extents_of(file: Tabular, keys: Keys) -> list[tuple[str, str] | None]:
    """Least and greatest unit in each group, where the file or its path says so."""
    if not keys.unit:
        return [(keys.unit_value, keys.unit_value)] * len(file.groups)
    return file.extents(keys.unit)


def units_of(file: Tabular, keys: Keys, groups: Sequence[int]) -> set[str]:
    """The units of some groups, from their column alone; of a group that cannot be read those that its footer names."""
    if not keys.unit:
        return {keys.unit_value}
    try:
        return _units_in(file, keys, groups)
    except UnreadableInput:
        ends = extents_of(file, keys)
    found: set[str] = set()
    for group in groups:
        try:
            found |= _units_in(file, keys, (group,))
        except UnreadableInput:
            found.update(ends[group] or ())
    return found


def _units_in(file: Tabular, keys: Keys, groups: Sequence[int]) -> set[str]:
    """The units of some groups, from their column alone.

    Raises
    ------
    UnreadableInput
        Where that cannot be read.
    """
    found: set[str] = set()
    for batch in file.batches(groups, [keys.unit]):
        texts, places = _dictionary(batch, keys.unit)
        found.update(texts[place] for place in np.unique(places).tolist())
    return found


def _without(schema: Any, keys: Keys) -> Any:  # noqa: ANN401
    """The columns of a schema that are no keys."""
    return needs_arrow().schema([field for field in schema if field.name not in keys.columns])


def _coded(
    batch: Any,  # noqa: ANN401
    column: str,
    value: str,
    names: Names,
) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """Numbers of texts, and (B,) which of them each row has; None where the path says one text for all."""
    texts, places = _dictionary(batch, column) if column else ([value], None)
    return np.array([names.number(text) for text in texts], dtype=np.int64), places


def _dictionary(batch: Any, column: str) -> tuple[list[str], NDArray[np.int64]]:  # noqa: ANN401
    """The texts of a column, each once, and (B,) which of them each row has; a null is the empty text."""
    arrow = needs_arrow()
    from pyarrow import compute

    array = batch.column(batch.schema.get_field_index(column))
    if not arrow.types.is_dictionary(array.type):
        if arrow.types.is_floating(array.type):
            array = compute.if_else(compute.is_nan(array), None, array)
        array = _texts(array).dictionary_encode()
    texts = [text_of(value) for value in array.dictionary.to_pylist()]
    places = array.indices
    if places.null_count:
        places, texts = places.fill_null(len(texts)), [*texts, ""]
    return texts, places.to_numpy(zero_copy_only=False)


def _texts(array: Any) -> Any:  # noqa: ANN401
    """A column of keys as texts; bytes, and texts each of which stands there once, as they are.

    Raises
    ------
    pyarrow.ArrowException
        Where these have none.
    """
    arrow = needs_arrow()
    is_kept = "binary" in str(array.type) or arrow.types.is_dictionary(array.type)
    return array if is_kept else array.cast(arrow.string())


def text_of(value: object) -> str:
    r"""What stands in a column of keys, as text: bytes are UTF-8 where they can be, and blanks are nothing.

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
