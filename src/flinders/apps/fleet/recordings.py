"""Recordings in slices of tables: side by side in memory, streamed if one is too long for that, or unreadable.

Usually a single page of a table is broken, and with it a row group. The recordings in it fail, and the others go on.
They are read from the columns of keys alone; if those are what is broken, the footer still has the number of rows, and
perhaps the first and last unit.

>>> from flinders.apps.fleet.plan import Partition
>>> rows = RowFilter(Partition((), without=("B02",)))
>>> numbers = np.array([rows.names.number(unit) << HALF for unit in ("A17", "B02", "")])
>>> rows.mask(numbers), rows.nameless_in(numbers)
(array([ True, False, False]), array([False, False,  True]))
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.apps.fleet.dataset import (
    HALF,
    Interner,
    KeyColumns,
    KeyedTable,
    Runs,
    batch_in,
    counts_of,
    extents_of,
    opened,
)
from flinders.apps.fleet.results import UnitResult, one_line
from flinders.core.joining import concatenated
from flinders.core.silence import silent
from flinders.errors import FlindersError, UnitError, counted
from flinders.fitting.batch import Lined

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.dataset import Options, Pair, TableFile
    from flinders.apps.fleet.plan import FileSlice, Partition
    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Recording, Samples
    from flinders.core.units import Unit


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One recording of one unit, ready to be fitted."""

    unit: str
    recording: str
    source: Recording
    readings: int  # its rows, unusable ones too
    start_s: float = 0.0  # s, origin of the times of `source`; NaN if it is not known
    file: str = ""  # name of its file

    @property
    def pair(self) -> Pair:
        """Unit and recording."""
        return self.unit, self.recording


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Readings of several recordings, from one slice or from several."""

    pairs: Sequence[Pair]  # unit and recording
    lined: Lined  # usable readings
    rows: NDArray[np.int64]  # (R,) rows of each, unusable ones too
    start_s: Floats  # (R,) in s, origin of the times of each
    file: str = ""  # name of their file; empty if they are in several

    @classmethod
    def joined(cls, sets: Sequence[RecordingSet]) -> list[RecordingSet]:
        """Join sets that can be fitted together: the larger a set, the less each recording costs."""
        alike: dict[Hashable, list[RecordingSet]] = defaultdict(list)
        for place, each in enumerate(sets):
            whole = each.lined.whole
            is_bare = whole.strength is None and not whole.skipped
            alike[(whole.unit, whole.axes, whole.time is None, whole.disturbances) if is_bare else place].append(each)
        return [group[0] if len(group) == 1 else cls._one(group) for group in alike.values()]

    @classmethod
    def _one(cls, sets: Sequence[RecordingSet]) -> RecordingSet:
        """Concatenate sets in the same unit and axes and with the same auxiliary columns."""
        wholes = [each.lined.whole for each in sets]
        above = np.cumsum([0, *(len(whole) for whole in wholes[:-1])])
        ends = np.concatenate([each.lined.ends + shift for each, shift in zip(sets, above, strict=True)])
        sources = [source for each in sets for source in each.lined.sources]
        return cls(
            [pair for each in sets for pair in each.pairs],
            Lined(concatenated(wholes, wholes[0]), ends, sources),
            np.concatenate([each.rows for each in sets]),
            np.concatenate([each.start_s for each in sets]),
        )

    def jobs(self) -> Iterator[Job]:
        """Yield the recordings one by one."""
        columns = zip(self.pairs, self.lined, self.rows.tolist(), self.start_s.tolist(), strict=True)
        yield from (Job(*pair, samples, rows, start_s, self.file) for pair, samples, rows, start_s in columns)

    @property
    def spans(self) -> Floats:
        """(R, 2) earliest and latest time of each."""
        spans = np.full((len(self.pairs), 2), math.nan)
        time = self.lined.whole.time
        if time is not None:
            filled = self.lined.counts > 0
            begins = (self.lined.ends - self.lined.counts)[filled]
            for column, extreme in enumerate((np.fmin, np.fmax) if len(begins) else ()):
                spans[filled, column] = self.start_s[filled] + extreme.reduceat(time, begins)
        return spans


class RowFilter:
    """Which rows of a table are taken, of a partition or of `selected` recordings, and how many name no unit."""

    def __init__(self, partition: Partition, selected: Container[Pair] | None = None) -> None:
        self.names = Interner()
        self.nameless = 0
        self._empty = self.names.number("")
        self._partition, self._selected = partition, selected
        self._known: dict[int, bool] = {}

    def takes(self, pair: Pair) -> bool:
        """Whether a recording is taken."""
        return self._partition.takes(pair[0]) and (self._selected is None or pair in self._selected)

    def nameless_in(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which rows are of no unit, if this partition reports those."""
        nameless: NDArray[np.bool_] = (numbers >> HALF == self._empty) & self.takes(("", ""))
        return nameless

    def mask(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which rows are taken."""
        if self._partition.only is None and not self._partition.without and self._selected is None:
            named: NDArray[np.bool_] = numbers >> HALF != self._empty
            return named
        distinct, places = np.unique(numbers, return_inverse=True)
        return np.array([self._one(number) for number in distinct.tolist()], dtype=bool)[places]

    def _one(self, number: int) -> bool:
        """Whether the recording with a number is taken."""
        if number not in self._known:
            pair = self.names.pair(number)
            self._known[number] = bool(pair[0]) and self.takes(pair)
        return self._known[number]


def read_recordings(table: KeyedTable, part: FileSlice, rows: RowFilter) -> RecordingSet:
    """Read the recordings of a slice, each in the order of time, or of its rows if times are not known."""
    columns = table.recording.columns
    runs, values = _read(table, part, rows)
    if len(np.unique(runs.numbers)) < len(runs.numbers):
        every = runs.rows
        order = np.argsort(every, kind="stable")
        values = [column[order] for column in values]
        runs = Runs(*np.unique(every, return_counts=True))
    ends = np.cumsum(runs.lengths)
    field = [columns.cells.index(cell) for cell in sorted(columns.needed)]
    is_silent = silent(columns.readings(values))
    with np.errstate(over="ignore", invalid="ignore"):
        is_whole = all(np.isfinite(values[place].sum()) for place in field)  # a sum is finite if all its terms are
    if not is_whole or is_silent.any():
        usable = np.logical_and.reduce([~is_silent, *(np.isfinite(values[place]) for place in field)])
        values, ends = [column[usable] for column in values], np.concatenate([[0], np.cumsum(usable)])[ends]
    if columns.time is not None:
        values = _sorted_by_time(values, ends, values[columns.cells.index(columns.time.cells[0])])
    pairs = [rows.names.pair(number) for number in runs.numbers.tolist()]
    lined = Lined(table.samples(values, part.file.name), ends, [" ".join(filter(None, pair)) for pair in pairs])
    return RecordingSet(pairs, lined, runs.lengths, np.full(len(pairs), table.start_s), part.file.name)


def _read(table: KeyedTable, part: FileSlice, rows: RowFilter) -> tuple[Runs, list[NDArray[np.floating]]]:
    """Run lengths of the rows of a slice that are taken, and their K columns (N,)."""
    nameless = 0
    runs: list[Runs] = []
    values: list[list[NDArray[np.floating]]] = []
    for every, block in table.batches(part.groups, rows.names):
        own, columns, mask = every, block, rows.mask(every.numbers)
        if not mask.all():
            nameless += int(every.lengths[rows.nameless_in(every.numbers)].sum())
            is_taken = np.repeat(mask, every.lengths)
            own, columns = Runs(every.numbers[mask], every.lengths[mask]), [column[is_taken] for column in block]
        runs.append(own)
        values.append(columns)
    rows.nameless += nameless
    empty = [[np.empty(0)] * len(table.recording.columns.cells)]
    whole = values[0] if len(values) == 1 else [*map(np.concatenate, zip(*(values or empty), strict=True))]
    return Runs.joined(runs), whole


def _sorted_by_time(
    values: list[NDArray[np.floating]], ends: NDArray[np.int64], time: NDArray[np.floating]
) -> list[NDArray[np.floating]]:
    """Sort columns (N,) of recordings that end at (R,) `ends` by (N,) times, where all are known.

    >>> _sorted_by_time([np.array([1.0, 2.0, 3.0, 4.0])], np.array([2, 4]), np.array([5.0, 3.0, 7.0, 7.0]))
    [array([2., 1., 3., 4.])]
    """
    back = time[1:] < time[:-1]
    back[ends[(ends > 0) & (ends < len(time))] - 1] = False
    if not back.any():
        return values
    recording = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    moved = np.zeros(len(ends), dtype=bool)
    moved[recording[:-1][back]] = True
    moved[recording[~np.isfinite(time)]] = False
    rows, order = np.flatnonzero(moved[recording]), np.arange(len(time))
    order[rows] = rows[np.lexsort((time[rows], recording[rows]))]
    return [column[order] for column in values]


def merged_recording(parts: Sequence[Job]) -> Job | UnitResult:
    """Merge the parts of one recording from several slices, in the order of time if all times are known."""
    if len(parts) == 1:
        return parts[0]
    pair, rows = parts[0].pair, sum(part.readings for part in parts)
    samples = cast("list[Samples]", [part.source for part in parts])
    try:
        for part, each in zip(parts, samples, strict=True):
            refuse_other_unit(part.file, each.unit, parts[0].file, samples[0].unit)
    except UnitError as error:
        return UnitResult(unit=pair[0], recording=pair[1], readings=rows).with_error(error)
    start = min(part.start_s for part in parts)
    later = [delayed(each, part.start_s - start) for each, part in zip(samples, parts, strict=True)]
    whole = concatenated(later, later[0])
    if whole.time is not None and np.isfinite(whole.time).all() and (np.diff(whole.time) < 0.0).any():
        whole = whole[np.argsort(whole.time, kind="stable").tolist()]
    return Job(*pair, whole, rows, start)


def delayed(samples: Samples, seconds: float) -> Samples:
    """Samples with later times."""
    return samples if samples.time is None or not seconds else replace(samples, time=samples.time + seconds)


def refuse_other_unit(file: str, unit: Unit, first: str, known: Unit) -> None:
    """Refuse readings in another unit of field than those of the first file: raises UnitError."""
    if unit.inside != known.inside:
        raise UnitError(
            f"its readings are in {known.inside} in {first} and in {unit.inside} in {file}: give the unit (and "
            "the scale of counts) so that all are in one unit"
        )


@dataclass(frozen=True, slots=True, eq=False)
class StreamedRecording:
    """A recording of more readings than fit into memory, read from its files on each pass."""

    partition: Partition  # its files
    pair: Pair  # unit and recording
    options: Options
    unit: Unit
    axes: Axes
    start_s: float  # s, origin of its times

    @classmethod
    def of(cls, partition: Partition, pair: Pair, options: Options) -> StreamedRecording:
        """Take unit, axes and origin of time from the first file."""
        with open_as_planned(partition.slices[0], options) as file:
            table = KeyedTable.of(file, options)
            return cls(partition, pair, options, table.recording.unit, table.recording.axes, table.start_s)

    @property
    def source(self) -> str:
        """Unit and recording."""
        return " ".join(filter(None, self.pair))

    def blocks(self) -> Iterator[Samples]:
        """Read it block by block."""
        for part in self.partition.slices:
            rows = RowFilter(self.partition, (self.pair,))
            with open_as_planned(part, self.options) as file:
                table = KeyedTable.of(file, self.options)
                first = self.partition.slices[0].file.name
                refuse_other_unit(part.file.name, table.recording.unit, first, self.unit)
                for runs, values in table.batches(part.groups, rows.names):
                    mask = np.repeat(rows.mask(runs.numbers), runs.lengths)
                    if mask.any():
                        samples = table.samples([column[mask] for column in values], self.source)
                        yield delayed(samples, table.start_s - self.start_s)


# ---------------------------------------------------------------------------------------------------------- unreadable

LISTED: Final = 4
"""Groups that a message lists; it counts the others."""


@dataclass(frozen=True, slots=True)
class UnreadableGroups:
    """Groups of a file that cannot be read."""

    part: FileSlice  # slice that they belong to
    group: str  # name of a group in its file
    groups: tuple[int, ...]  # which of how many groups, counted from 0
    group_count: int
    rows: int
    error: Exception
    # rows of each recording; empty if the keys cannot be read either
    counts: Counter[Pair] = field(default_factory=Counter)
    ends: tuple[str, ...] = ()  # if they cannot: units with some of the rows, according to footer or path
    is_complete: bool = False  # whether no other units have any

    @property
    def place(self) -> str:
        """Groups, for people: counted from 1; empty if it is all of them."""
        if len(self.groups) == self.group_count:
            return ""
        named = [str(group + 1) for group in self.groups[:LISTED]]
        more = [f"{len(self.groups) - LISTED} more"] * (len(self.groups) > LISTED)
        *first, last = named + more
        plural = ("es" if self.group.endswith("ch") else "s") * (len(self.groups) > 1)
        return f"{self.group}{plural} {', '.join(first)}{' and ' if first else ''}{last} of {self.group_count}"

    @property
    def where(self) -> str:
        """Groups and file, for people."""
        name = self.part.file.name
        return f"{self.place} of {name}" if self.place else name

    @property
    def row(self) -> UnitResult:
        """A row for those whose units are not known; no unit has such a name."""
        rows = f" ({counted(self.rows, 'row')})" if self.rows else ""
        why = self.error.message if isinstance(self.error, FlindersError) else self.error
        message = (
            f"it cannot be told whose readings are in {self.where}{rows}, and a unit that has some of them and others "
            f"elsewhere was fitted without them: {why}"
        )
        return _row(self.error, (f"({self.part.file.name})", self.place), self.rows, message)


@contextlib.contextmanager
def open_as_planned(part: FileSlice, options: Options) -> Iterator[TableFile]:
    """Open the file of a slice; one that could not be opened for the plan raises the error of then."""
    if part.error is not None:
        raise part.error
    with opened(part.file, options) as file:
        yield file


class Unreadable:
    """Unreadable groups of the slices of a partition.

    >>> import tempfile
    >>> from pathlib import Path
    >>> import pyarrow
    >>> from pyarrow import parquet
    >>> from flinders.apps.fleet.dataset import Options
    >>> from flinders.apps.fleet.plan import plan_of
    >>> path = Path(tempfile.mkdtemp()) / "fleet.parquet"
    >>> parquet.write_table(pyarrow.table({"unit": ["A17", "A17", "B02"], "x": [1.0, 2.0, 3.0]}), path)
    >>> (partition,) = plan_of(str(path), Options()).partitions
    >>> unreadable = Unreadable(partition, Options())
    >>> unreadable.readable_groups(partition.slices[0])
    ()
    >>> [(row.unit, row.readings, row.code) for row in unreadable.rows({("A17", ""): 0, ("B02", ""): 0})]
    [('A17', 2, 'no-magnetometer'), ('B02', 1, 'no-magnetometer')]
    """

    def __init__(self, partition: Partition, options: Options) -> None:
        self.all: list[UnreadableGroups] = []
        self._names = Interner()
        self._partition, self._options = partition, options
        self._readable: dict[FileSlice, tuple[int, ...]] = {}

    def readable_groups(self, part: FileSlice) -> tuple[int, ...]:
        """Groups of a slice that can be read, each by itself; the others are recorded with their recordings."""
        if part not in self._readable:
            self._record(part, lambda file: self._errors(part, file))
        return self._readable[part]

    def give_up(self, part: FileSlice, error: Exception) -> None:
        """Record all of a slice, though each of its groups could be read."""
        errors = dict.fromkeys(self._readable.get(part, part.groups), error)
        self._record(part, lambda _: errors)
        self._readable[part] = ()

    def _record(self, part: FileSlice, errors_of: Callable[[TableFile], Mapping[int, Exception]]) -> None:
        """Record the groups of a slice with errors."""
        try:
            with open_as_planned(part, self._options) as file:
                keys = KeyColumns.of_schema(file.name, file.schema, self._options) or KeyColumns()
                errors = errors_of(file)
                self.all += list(self._with_recordings(part, file, keys, errors))
        except Exception as error:  # noqa: BLE001 - a broken file may raise anything, and costs its recordings alone
            errors = dict.fromkeys(part.groups, error)
            self.all = [each for each in self.all if each.part != part]  # all of it, with what was recorded before
            self.all.append(self._unopened(part, error))
        self._readable[part] = tuple(group for group in part.groups if group not in errors)

    def counts_in(self, part: FileSlice) -> Counter[Pair]:
        """Unreadable rows of each recording in a slice."""
        return sum((each.counts for each in self.all if each.part == part), Counter())

    def _unopened(self, part: FileSlice, error: Exception) -> UnreadableGroups:
        """A slice whose file cannot be opened any more: its rows, and the unit in its path."""
        keys = KeyColumns.of_path(part.file.name, self._options)
        groups = UnreadableGroups(
            part, "", part.groups, len(part.groups), part.rows, error, ends=self._partition.only or ()
        )
        if keys is None:
            return groups
        number = self._names.number(keys.unit_value) << HALF | self._names.number(keys.recording_value)
        self._names.note(number, batch_in(part.file.name, self._options))
        if keys.recording_value:
            return replace(groups, counts=Counter({(keys.unit_value, keys.recording_value): part.rows}), ends=())
        return replace(groups, ends=(keys.unit_value,), is_complete=True)

    def _errors(self, part: FileSlice, file: TableFile) -> dict[int, Exception]:
        """Errors of the groups of a slice that cannot be read."""
        errors: dict[int, Exception] = {}
        try:
            table = KeyedTable.of(file, self._options)
        except Exception as error:  # noqa: BLE001 - as in `_record`: all groups, with their recordings
            return dict.fromkeys(part.groups, error)
        for group in part.groups:
            try:
                for _ in table.batches((group,), self._names):
                    pass
            except Exception as error:  # noqa: BLE001 - as in `_record`: this group, and the others are read
                errors[group] = error
        return errors

    def _with_recordings(
        self, part: FileSlice, file: TableFile, keys: KeyColumns, errors: Mapping[int, Exception]
    ) -> Iterator[UnreadableGroups]:
        """Groups with errors whose recordings can be read, and those of which the footer has two units at most."""
        counts: Counter[Pair] = Counter()
        known: list[int] = []
        unknown: list[int] = []
        ends: set[str] = set()
        for group in errors:
            try:
                counts += counts_of(file, keys, (group,), self._names)
                known.append(group)
            except Exception:  # noqa: BLE001 - as in `_record`: its keys are broken too
                units = set(extents_of(file, keys)[group] or ())
                if len(units) == 1 and not keys.recording:
                    unit = units.pop()
                    counts[unit, keys.recording_value] += file.groups[group]
                    number = self._names.number(unit) << HALF | self._names.number(keys.recording_value)
                    self._names.note(number, keys.batch_value)
                    known.append(group)
                else:
                    unknown.append(group)
                    ends |= units - {""}
        for groups, own, named in ((known, counts, ()), (unknown, Counter(), tuple(sorted(ends)))):
            if groups:
                rows = sum(file.groups[group] for group in groups)
                every = len(file.groups)
                yield UnreadableGroups(part, file.group, tuple(groups), every, rows, errors[groups[0]], own, named)

    def recordings(self, read: Iterable[Pair]) -> set[Pair]:
        """Recordings with unreadable rows; of units that the footer names those that were `read`."""
        recordings = {pair for each in self.all for pair in each.counts if pair[0]}
        ends = {unit for each in self.all for unit in each.ends}
        present = {pair for pair in read if pair[0] in ends}
        return recordings | present | {(unit, "") for unit in ends - {unit for unit, _ in present}}

    def rows(self, readable: Mapping[Pair, int]) -> list[UnitResult]:
        """Rows of `recordings`, given how many readings of each can be read."""
        groups_of: dict[Pair, list[UnreadableGroups]] = defaultdict(list)
        for each in self.all:
            for pair in readable:
                if pair in each.counts or pair[0] in each.ends:
                    groups_of[pair].append(each)
        return [_of_recording(pair, groups, readable[pair]) for pair, groups in groups_of.items()]

    def unknown(self) -> list[UnitResult]:
        """Rows for groups whose units are not known."""
        return [each.row for each in self.all if not each.counts and not each.is_complete]

    def batches(self, known: Mapping[Pair, str]) -> dict[Pair, str]:
        """Hardware batches that are known, and those of unreadable recordings."""
        own = self._names.batches
        return {pair: min(each[pair] for each in (known, own) if pair in each) for pair in {*known, *own}}

    @property
    def nameless(self) -> int:
        """Rows that name no unit."""
        return sum(rows for each in self.all for (unit, _), rows in each.counts.items() if not unit)


def _of_recording(pair: Pair, groups: list[UnreadableGroups], readable: int) -> UnitResult:
    """Row of a recording with unreadable rows."""
    lost = sum(each.counts[pair] for each in groups)
    every, where = counted(readable + lost, "reading"), " and ".join(each.where for each in groups[:LISTED])
    share = f"{lost:,} of its {every}" if lost < readable + lost else f"its {every}"
    if any(each.ends or not each.rows for each in groups):
        others = f", besides {counted(readable, 'reading')} that can be read," if readable else ""
        share = f"some of its readings{others}"
    return _row(groups[0].error, pair, readable + lost, f"{share} lie in {where}: {groups[0].error}")


def _row(error: Exception, pair: Pair, readings: int, message: str) -> UnitResult:
    """Row with the code of an error and a longer message."""
    row = UnitResult(unit=pair[0], recording=pair[1], readings=readings).with_error(error)
    return replace(row, message=one_line(message))
