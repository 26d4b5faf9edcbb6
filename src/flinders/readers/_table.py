"""Tables other than text, with named columns of numbers: an array, a MATLAB file, a Parquet table.

Columns are recognised by the same names as in text.

>>> import numpy as np
>>> from flinders.readers._source import File
>>> from pathlib import Path
>>> columns = {"t (s)": np.array([0.0, 0.1]), "mag (mG)": np.array([[217.0, 4.0, -586.0], [217.0, 2.0, -587.0]])}
>>> table = Table.of_arrays("tumble.npz", "named arrays", columns)
>>> table.names
('t (s)', 'mag.x (mG)', 'mag.y (mG)', 'mag.z (mG)')
>>> recording = open_table(File("tumble.npz", Path("tumble.npz"), 0), table)
>>> print(recording)
tumble.npz: columns mag.x (mG), mag.y (mG), mag.z (mG) in mG, time in t (s); named arrays
>>> next(recording.blocks()).field[1]
array([ 21.7,   0.2, -58.7])
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import BLOCK_ROWS, Skipped, merge_skipped
from flinders.core.time_span import TimeSpan
from flinders.errors import NoMagnetometer, UnreadableInput, count_text
from flinders.readers._auxiliary import places_in
from flinders.readers._choice import FIRST_SENSOR, Choice
from flinders.readers._column_choice import choose, rising_in
from flinders.readers._columns import Columns, ColumnsRecording, unit_of
from flinders.readers._devices import MAX_SENSORS, Device, SensorColumn, devices_in, names_device, sensor_column
from flinders.readers._likeness import XYZ
from flinders.readers._names import AUXILIARY
from flinders.readers._refusals import ranges
from flinders.readers._resample import number_skipped_rows
from flinders.readers._source import raise_own_errors
from flinders.readers._tokenizer import list_columns, shorten

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.core.units import Unit
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._source import Progress, Source

SAMPLED_ROWS: Final = 200  # rows that are examined to tell times from other numbers
MAX_COLUMNS: Final = 512  # largest number of columns in an array of readings


class Labels:
    """Numbers that stand for the words of a column, in the order of their first occurrence.

    >>> labels = Labels()
    >>> labels.numbers(["b4:01", "b4:02", None, "b4:01"]), labels.word(1.0)
    (array([ 0.,  1., nan,  0.]), 'b4:02')
    """

    def __init__(self) -> None:
        self._places: dict[str, int] = {}

    def numbers(self, words: Iterable[object]) -> Floats:
        """(N,) number for each word, equal for equal words; NaN for None."""
        places = self._places
        return np.array(
            [np.nan if word is None else places.setdefault(str(word), len(places)) for word in words], float
        )

    def word(self, number: float) -> str:
        """The word for a number."""
        return self.words[int(number)]

    @property
    def words(self) -> list[str]:
        """All words so far."""
        return list(self._places)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of numbers, and a function that yields them in blocks."""

    kind: str  # name of the kind for users: ``Parquet``, ``named arrays``
    names: tuple[str, ...]  # names of the columns; empty if they have none
    width: int  # columns
    length: int  # rows
    rows: Callable[
        [Sequence[int]], Iterator[Floats]
    ]  # yields (N, K) blocks of the columns at these places, in this order
    labels: Mapping[int, Labels] = field(default_factory=dict)  # labels of columns of words, by place
    #: places of further columns of words, by name, after all others
    text_columns: Mapping[str, int] = field(default_factory=dict)

    def sensors(self) -> SensorColumn | None:
        """Column of words that names the sensor of each row; None if there is none."""
        for place, labels in self.labels.items():
            for _ in self.rows([place]):  # labels collect its words
                if len(labels.words) > MAX_SENSORS:
                    break
            if found := sensor_column([(word,) for word in labels.words], (0,)):
                return found._replace(place=place)
        return None

    def devices(self, sensors: SensorColumn | None = None) -> tuple[Device, ...]:
        """Devices that a column distinguishes, combined with the magnetometers among the sensors that rows name."""
        told = sensors.place if sensors else None
        places = [place for place, name in enumerate(self.names) if names_device(name, self.names) and place != told]

        def rows() -> Iterator[tuple[str, ...]]:
            for block in self.rows(places):
                yield from (self.words(places, row) for row in block.tolist())

        found = devices_in(self.names, places, rows) if places else ()
        return sensors.devices(self.names, found) if sensors else found

    def words(self, places: Sequence[int], row: Sequence[float]) -> tuple[str, ...]:
        """Words of a row in some columns."""
        return tuple(
            "" if math.isnan(value) else self.labels[place].word(value) if place in self.labels else f"{value:.12g}"
            for place, value in zip(places, row, strict=True)
        )

    def words_of(self, columns: Columns, values: Floats) -> dict[str, NDArray[np.str_]]:
        """(N,) words of each requested column of words, from the values of its cells."""
        asked = (each for each in columns.auxiliary if each.kind == AUXILIARY and each.cells[0] in self.labels)
        found = {}
        for each in asked:
            numbers = columns.values_of_column(values, each)[:, 0]
            known = np.array([*self.labels[each.cells[0]].words, ""])
            found[each.names[0]] = known[np.where(np.isnan(numbers), -1, numbers).astype(int)]
        return found

    def belongs_to(self, device: Device, values: Floats) -> NDArray[np.bool_]:
        """(N,) booleans: whether a row belongs to a device."""
        distinct, places = np.unique(values, axis=0, return_inverse=True)
        known = [self.words(device.cells, row) == device.words for row in distinct.tolist()]
        return np.array(known, dtype=bool)[places.ravel()]

    @classmethod
    def of_arrays(
        cls,
        source: str,
        kind: str,
        arrays: Mapping[str, NDArray[Any]],
        labels: Mapping[str, Labels] | None = None,
        words: Mapping[str, Sequence[object]] | None = None,
    ) -> Table:
        """Combine arrays side by side: those with the most common length; an (N, 3) array makes three columns.

        Arrays are (N,), (N, K) or (K, N) of numbers or dates, or structured; others are left out. A name may be empty.
        `words` are columns that are read only on request. Raises `NoMagnetometer` if no array is left.
        """
        columns = [column for name, array in arrays.items() for column in _columns_of(name, array)]
        if not columns:
            shapes = ", ".join(f"{shorten(name) or 'an array'} {a.shape} of {a.dtype}" for name, a in arrays.items())
            raise NoMagnetometer(
                f"{source} holds no columns of numbers: {shapes or 'no arrays'}; need an array of N readings by 3, or "
                "arrays of equal length by name"
            )
        length = Counter(len(column) for _, column in columns).most_common(1)[0][0]
        alike = [(name, column) for name, column in columns if len(column) == length]
        names = tuple(name for name, _ in alike)
        values = [column for _, column in alike]

        others = {name: each for name, each in (words or {}).items() if len(each) == length}
        hidden = dict(zip(range(len(alike), len(alike) + len(others)), others, strict=True))
        labelled = {place: labels[name] for place, name in enumerate(names) if labels and name in labels}
        labelled |= {place: Labels() for place in hidden}

        def part(cell: int, rows: slice) -> Floats:
            if cell in hidden:
                return labelled[cell].numbers(others[hidden[cell]][rows])
            return _floats(values[cell][rows])

        def rows(cells: Sequence[int]) -> Iterator[Floats]:
            for start in range(0, length, BLOCK_ROWS):
                yield np.stack([part(cell, slice(start, start + BLOCK_ROWS)) for cell in cells], axis=1)

        places = {name: place for place, name in hidden.items()}
        return cls(kind, names if any(names) else (), len(alike), length, rows, labelled, places)


@dataclass(slots=True, eq=False)
class TableRecording(ColumnsRecording):
    """Recording of a table. It yields its readings in bounded memory, any number of times."""

    file: Source  # file on disk from which the bytes are read
    table: Table
    columns: Columns
    unit: Unit  # of the magnetometer's columns
    axes: Axes = field(default_factory=Axes)  # mapping of the recorded axes
    progress: Progress | None = None  # called with the bytes read so far, estimated from the number of rows
    span: TimeSpan = field(default_factory=TimeSpan)  # the part of the recording that is read
    source: str = field(init=False)
    is_unit_given: bool = field(default=False, init=False)  # whether the user gave the unit
    # rows that were skipped in the last pass, or in the present one so far
    skipped: tuple[Skipped, ...] = field(default=(), init=False)
    # temporary files that must exist while the recording is used
    temporary_files: tuple[Source, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        """Set the source to the name of the file."""
        self.source = self.file.name

    @property
    def readings(self) -> int | None:
        """Number of rows; None if only the rows of one device are read."""
        return self.table.length if self.columns.device is None else None

    def with_auxiliary(self, names: Sequence[str], *, are_needed: bool = True) -> TableRecording:
        """The recording with further columns, of numbers or words.

        Raises `InputError` for a missing name if `are_needed`; otherwise the name is left out.
        """
        there = dict(zip((name.strip() for name in self.table.names), range(self.table.width), strict=False))
        there |= {name: place for name, place in self.table.text_columns.items() if name not in there}
        places = places_in(self.source, list(there), names, are_needed=are_needed)
        columns = self.columns.with_auxiliary(places, [there[name] for name in places])
        recording = replace(self, columns=columns)
        recording.is_unit_given, recording.temporary_files = self.is_unit_given, self.temporary_files
        return recording

    def with_columns(self, columns: Columns, unit: str | None, scale: float | None) -> TableRecording:
        """The recording of these columns, in the unit that their names state or the user gives."""
        own = unit_of(columns, self.source, unit, scale)
        recording = replace(self, columns=columns.with_given_unit(unit, scale).with_strength_in(own), unit=own)
        recording.temporary_files = self.temporary_files
        return recording

    @raise_own_errors
    def blocks(self) -> Iterator[Samples]:
        """Yield the readings from the first on, about 8192 at a time.

        Raises `UnreadableInput` if the file cannot be read to its end or no reading is finite, and `UsageError` if the
        span contains no reading.
        """
        self.skipped = ()
        clock, done, usable, device = self.span.clock(self.source), 0, 0, self.columns.device
        for values in self.table.rows((*self.columns.cells, *(device.cells if device else ()))):
            own = values[self.table.belongs_to(device, values[:, -len(device.cells) :])] if device else values
            words = self.table.words_of(self.columns, own.T)
            samples = self.columns.samples(own.T, unit=self.unit, axes=self.axes, source=self.source, words=words)
            self.skipped = merge_skipped(self.skipped, number_skipped_rows(samples, done).skipped)
            done += len(values)
            usable += len(samples)
            if self.progress and self.file.size:
                self.progress(int(self.file.size * done / self.table.length), self.file.size)
            within = clock.is_within(samples)
            if within.any():
                yield clock.select(samples, within)
        if not usable:
            raise UnreadableInput(
                f"no usable reading in {self.source}: {'; '.join(map(str, self.skipped)) or 'it has no rows'}. A "
                "reading needs finite x, y and z: check the sensor and its wiring"
            )
        clock.refuse_empty()

    def written(self) -> str:
        """Description of the format."""
        return self.table.kind + ("" if self.table.names else ", columns without names")


def open_table(
    file: Source,
    table: Table,
    *,
    columns: AnyColumns | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: Axes | None = None,
    flat: str | None = None,
    choice: Choice = FIRST_SENSOR,
    progress: Progress | None = None,
) -> TableRecording:
    """Recognise the columns of a table; parameters are those of `flinders.readers.open_recording`.

    `NoMagnetometer` is raised if the magnetometer's columns are not clear or contain no numbers. `UsageError` is raised
    for columns or a magnetometer that do not exist, `UnitError` for a unit that contradicts the names, and
    `UnreadableInput` for a table without rows.
    """
    if not table.length:
        raise UnreadableInput(f"{file.name} has no rows: record again, or check what was saved")
    if not table.width:
        raise NoMagnetometer(f"{file.name} holds no columns of numbers: need three, x y z")
    block = next(table.rows(range(table.width)), None)
    if block is None:
        raise UnreadableInput(
            f"{file.name} should have {count_text(table.length, 'row')} but contains none: copy it again"
        )
    if len(block) == table.length:  # the whole table, which need not be read again
        again = table.rows
        table = replace(
            table,
            rows=lambda cells: iter([block[:, list(cells)]]) if max(cells, default=0) < table.width else again(cells),
        )
    devices = table.devices(table.sensors())
    own = block[table.belongs_to(devices[0], block[:, list(devices[0].cells)])] if devices else block
    first = own[:SAMPLED_ROWS] if len(own) else block[:SAMPLED_ROWS]
    columns = columns or choice.remembered_columns(table.names, table.width, rising_in(first) if choice.forms else ())
    known = choose(table.names, first, columns, flat=flat, choice=choice, source=file.name, devices=devices)
    if known is None:
        raise NoMagnetometer(_unknown_columns_words(file.name, table, first), hint=XYZ)
    settled = unit_of(known, file.name, unit, scale)
    known = known.with_given_unit(unit, scale).with_strength_in(settled)
    return TableRecording(file, table, known, settled, axes or Axes(), progress)


def _unknown_columns_words(name: str, table: Table, first: Floats) -> str:
    if not table.names:
        return (
            f"{name} has {table.width} columns without names: need three, x y z, or four with the time first; they go "
            f"from {ranges(first)}; say which are the magnetometer, by number"
        )
    return (
        f"no magnetometer among the columns of {name}: {list_columns(table.names)}; "
        "say which three it is, by name or by number"
    )


def _columns_of(name: str, array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the named columns of one array; none if it holds no numbers."""
    if array.dtype.names:
        for part in array.dtype.names:
            yield from _columns_of(f"{name}.{part}" if name else part, array[part])
    elif array.dtype.kind in "iufbM" and array.ndim in {1, 2} and array.size > 1:
        rows = array.reshape(-1, 1) if 1 in array.shape or array.ndim == 1 else array
        if rows.shape[0] <= 4 < rows.shape[1]:
            rows = rows.T  # one reading per column, as in MATLAB
        width = rows.shape[1]
        if width <= MAX_COLUMNS:
            yield from ((named_part(name, place, width), rows[:, place]) for place in range(width))


def named_part(name: str, place: int, width: int) -> str:
    """Name of one column of an array, with its unit at the end: ``mag (mG)`` gives ``mag.x (mG)``."""
    if width == 1 or not name:
        return name
    bare, bracket, unit = name.partition(" (")
    return f"{bare}.{'xyz'[place] if width == 3 else place + 1}{bracket}{unit}"


def _floats(column: NDArray[Any]) -> Floats:
    """Numbers unchanged, and dates as nanoseconds since 1970, which are recognised as a time."""
    if column.dtype.kind == "M":
        return np.where(np.isnat(column), np.nan, column.astype("datetime64[ns]").astype(np.int64).astype(float))
    return column.astype(float)
