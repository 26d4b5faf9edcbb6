"""Recordings of units, read from slices of tables: in memory, or streamed if a recording is too long for memory.

>>> from flinders.apps.fleet.plan import Partition
>>> rows = RowFilter(Partition((), without=("B02",)))
>>> numbers = np.array([rows.names.number((unit, "")) for unit in ("A17", "B02", "")])
>>> rows.mask(numbers), rows.is_nameless(numbers)
(array([ True, False, False]), array([False, False,  True]))
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from flinders.apps.fleet.dataset import Interner, KeyedTable, Runs
from flinders.apps.fleet.plan import open_as_planned
from flinders.apps.fleet.results import UnitResult
from flinders.core.joining import concatenate
from flinders.core.silence import find_silent
from flinders.errors import UnitError
from flinders.fitting.batch import ConcatenatedRecordings

if TYPE_CHECKING:
    from collections.abc import Container, Hashable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.dataset import Pair
    from flinders.apps.fleet.frame import KeyedFrame
    from flinders.apps.fleet.options import Options
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
    readings: int  # number of rows of the recording, including unusable ones
    start_s: float = 0.0  # s, origin of the times of `source`; NaN if it is not known
    file: str = ""  # name of the recording's file

    @property
    def pair(self) -> Pair:
        """Names of unit and recording."""
        return self.unit, self.recording


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Readings of several recordings, from one slice or from several."""

    pairs: Sequence[Pair]  # unit and recording
    lined: ConcatenatedRecordings  # usable readings
    rows: NDArray[np.int64]  # (R,) number of rows of each recording, including unusable ones
    start_s: Floats  # (R,) in s, origin of the times of each recording
    file: str = ""  # name of the file; empty for several files

    @classmethod
    def join(cls, sets: Sequence[RecordingSet]) -> list[RecordingSet]:
        """Join sets that can be fitted together, as each recording of a larger set costs less time."""
        alike: dict[Hashable, list[RecordingSet]] = defaultdict(list)
        for place, each in enumerate(sets):
            whole = each.lined.whole
            is_bare = whole.strength is None and not whole.skipped
            alike[(whole.unit, whole.axes, whole.time is None, whole.disturbances) if is_bare else place].append(each)
        return [group[0] if len(group) == 1 else cls._concatenate(group) for group in alike.values()]

    @classmethod
    def _concatenate(cls, sets: Sequence[RecordingSet]) -> RecordingSet:
        """Concatenate sets in the same unit and axes and with the same auxiliary columns."""
        wholes = [each.lined.whole for each in sets]
        above = np.cumsum([0, *(len(whole) for whole in wholes[:-1])])
        ends = np.concatenate([each.lined.ends + shift for each, shift in zip(sets, above, strict=True)])
        sources = [source for each in sets for source in each.lined.sources]
        return cls(
            [pair for each in sets for pair in each.pairs],
            ConcatenatedRecordings(concatenate(wholes, wholes[0]), ends, sources),
            np.concatenate([each.rows for each in sets]),
            np.concatenate([each.start_s for each in sets]),
        )

    def jobs(self) -> Iterator[Job]:
        """Yield the recordings one by one."""
        columns = zip(self.pairs, self.lined, self.rows.tolist(), self.start_s.tolist(), strict=True)
        yield from (Job(*pair, samples, rows, start_s, self.file) for pair, samples, rows, start_s in columns)

    @property
    def spans(self) -> Floats:
        """(R, 2) earliest and latest time of each recording, in s; NaN without times."""
        spans = np.full((len(self.pairs), 2), math.nan)
        time = self.lined.whole.time
        if time is not None:
            filled = self.lined.counts > 0
            begins = (self.lined.ends - self.lined.counts)[filled]
            for column, extreme in enumerate((np.fmin, np.fmax) if len(begins) else ()):
                spans[filled, column] = self.start_s[filled] + extreme.reduceat(time, begins)
        return spans


class RowFilter:
    """Selects the rows of a partition, or of `selected` recordings, and counts rows without a unit."""

    def __init__(self, partition: Partition, selected: Container[Pair] | None = None) -> None:
        self.names = Interner()
        self.nameless = 0
        self._partition, self._selected = partition, selected
        self._uses: list[int] = []  # use of each recording in `names`

    def takes(self, pair: Pair) -> bool:
        """Whether the rows of a recording are selected."""
        return self._partition.takes(pair[0]) and (self._selected is None or pair in self._selected)

    def is_nameless(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) whether rows have no unit and this partition reports them."""
        nameless: NDArray[np.bool_] = self._uses_of(numbers) == NAMELESS
        return nameless

    def mask(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) whether rows are selected."""
        taken: NDArray[np.bool_] = self._uses_of(numbers) == TAKEN
        return taken

    def _uses_of(self, numbers: NDArray[np.int64]) -> NDArray[np.int8]:
        """(B,) use of each row: one of the constants below."""
        for unit, recording in self.names.pairs[len(self._uses) :]:
            is_taken = self.takes((unit, recording if unit else ""))
            self._uses.append((TAKEN if unit else NAMELESS) if is_taken else PASSED_OVER)
        return np.array(self._uses, dtype=np.int8)[numbers]


PASSED_OVER, TAKEN, NAMELESS = range(3)
"""Uses of a row: skipped, fitted, or counted as a row without a unit."""


def read_recordings(table: KeyedTable | KeyedFrame, part: FileSlice, rows: RowFilter) -> RecordingSet:
    """Read the recordings of a slice, each in the order of time, or of its rows if times are not known."""
    columns = table.recording.columns
    runs, values = _read(table, part, rows)
    if len(np.unique(runs.numbers)) < len(runs.numbers):
        every = runs.rows
        order = np.argsort(every, kind="stable")
        values = [column[order] for column in values]
        runs = Runs(*np.unique(every, return_counts=True))
    ends = np.cumsum(runs.lengths)
    field = [columns.cells.index(cell) for cell in sorted(columns.needed_cells)]
    is_silent = find_silent(columns.readings(values))
    with np.errstate(over="ignore", invalid="ignore"):
        is_whole = all(np.isfinite(values[place].sum()) for place in field)  # a sum is finite if all its terms are
    if not is_whole or is_silent.any():
        usable = np.logical_and.reduce([~is_silent, *(np.isfinite(values[place]) for place in field)])
        values, ends = [column[usable] for column in values], np.concatenate([[0], np.cumsum(usable)])[ends]
    if columns.time is not None:
        values = _sort_by_time(values, ends, values[columns.cells.index(columns.time.cells[0])])
    pairs = [rows.names.pairs[number] for number in runs.numbers.tolist()]
    lined = ConcatenatedRecordings(
        table.samples(values, part.file.name), ends, [" ".join(filter(None, pair)) for pair in pairs]
    )
    return RecordingSet(pairs, lined, runs.lengths, np.full(len(pairs), table.start_s), part.file.name)


def _read(table: KeyedTable | KeyedFrame, part: FileSlice, rows: RowFilter) -> tuple[Runs, list[NDArray[np.floating]]]:
    """Read the selected rows of a slice: the recording of each row, as run lengths, and K columns (N,)."""
    nameless = 0
    runs: list[Runs] = []
    values: list[list[NDArray[np.floating]]] = []
    for every, block in table.batches(part.groups, rows.names):
        own, columns, mask = every, block, rows.mask(every.numbers)
        if not mask.all():
            nameless += int(every.lengths[rows.is_nameless(every.numbers)].sum())
            is_taken = np.repeat(mask, every.lengths)
            own, columns = Runs(every.numbers[mask], every.lengths[mask]), [column[is_taken] for column in block]
        runs.append(own)
        values.append(columns)
    rows.nameless += nameless
    empty = [[np.empty(0)] * len(table.recording.columns.cells)]
    whole = values[0] if len(values) == 1 else [*map(np.concatenate, zip(*(values or empty), strict=True))]
    return Runs.join(runs), whole


def _sort_by_time(
    values: list[NDArray[np.floating]], ends: NDArray[np.int64], time: NDArray[np.floating]
) -> list[NDArray[np.floating]]:
    """Sort the rows of each recording by time; rows of a recording with unknown times stay as they are.

    `values` are columns (N,), `ends` the (R,) index after the last row of each recording, `time` (N,) in s.

    >>> _sort_by_time([np.array([1.0, 2.0, 3.0, 4.0])], np.array([2, 4]), np.array([5.0, 3.0, 7.0, 7.0]))
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
    later = [delay(each, part.start_s - start) for each, part in zip(samples, parts, strict=True)]
    whole = concatenate(later, later[0])
    if whole.time is not None and np.isfinite(whole.time).all() and (np.diff(whole.time) < 0.0).any():
        whole = whole[np.argsort(whole.time, kind="stable").tolist()]
    return Job(*pair, whole, rows, start)


def delay(samples: Samples, seconds: float) -> Samples:
    """Samples with `seconds` added to their times."""
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
        """Make the recording of a unit in a partition; unit, axes and origin of time are those of its first file."""
        with open_as_planned(partition.slices[0], options) as file:
            table = KeyedTable.of(file, options)
            return cls(partition, pair, options, table.recording.unit, table.recording.axes, table.start_s)

    @property
    def source(self) -> str:
        """Names of unit and recording, for messages."""
        return " ".join(filter(None, self.pair))

    def blocks(self) -> Iterator[Samples]:
        """Yield the readings block by block."""
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
                        yield delay(samples, table.start_s - self.start_s)
