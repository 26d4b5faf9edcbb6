"""Recordings in slices of tables: side by side in memory, or streamed if one is too long for that.

>>> from flinders.fleet.plan import Partition
>>> rows = RowFilter(Partition((), without=("B02",)))
>>> numbers = np.array([rows.names.number(unit) << HALF for unit in ("A17", "B02", "")])
>>> rows.mask(numbers), rows.nameless_in(numbers)
(array([ True, False, False]), array([False, False,  True]))
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from flinders.core.disturbance import KINDS, MOTORS
from flinders.errors import UnitError
from flinders.estimators.data import concatenated
from flinders.fleet.dataset import HALF, Interner, KeyedTable, Runs
from flinders.fleet.results import UnitResult
from flinders.fleet.unreadable import open_as_planned
from flinders.stacked import Lined

if TYPE_CHECKING:
    from collections.abc import Container, Hashable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.samples import Recording, Samples
    from flinders.core.units import Unit
    from flinders.fleet.dataset import Options, Pair
    from flinders.fleet.plan import FileSlice, Partition


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One recording of one unit, ready to be fitted.

    Attributes
    ----------
    unit, recording : str
    source : Recording
    readings : int
        Its rows, unusable ones too.
    start_s : float, s
        Origin of the times of `source`; NaN if it is not known.
    file : str
        Name of its file.
    """

    unit: str
    recording: str
    source: Recording
    readings: int
    start_s: float = 0.0
    file: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSet:
    """Readings of several recordings, from one slice or from several.

    Attributes
    ----------
    pairs : sequence of (str, str)
        Unit and recording.
    lined : Lined
        Usable readings.
    rows : (R,) int
        Rows of each, unusable ones too.
    start_s : (R,) float, s
        Origin of the times of each.
    file : str
        Name of their file; empty if they are in several.
    """

    pairs: Sequence[Pair]
    lined: Lined
    rows: NDArray[np.int64]
    start_s: Floats
    file: str = ""

    @classmethod
    def joined(cls, sets: Sequence[RecordingSet]) -> list[RecordingSet]:
        """Join sets that can be fitted together: the larger a set, the less each recording costs."""
        alike: dict[Hashable, list[RecordingSet]] = defaultdict(list)
        for place, each in enumerate(sets):
            whole = each.lined.whole
            is_bare = whole.strength is None and not whole.skipped
            alike[(whole.unit, whole.axes, whole.time is None, whole.disturbances) if is_bare else place].append(each)
        return [some[0] if len(some) == 1 else cls._one(some) for some in alike.values()]

    @classmethod
    def _one(cls, sets: Sequence[RecordingSet]) -> RecordingSet:
        """Concatenate sets in the same unit and axes and with the same auxiliary columns."""
        wholes = [each.lined.whole for each in sets]
        field = np.concatenate([whole.field.T for whole in wholes], axis=1).T
        auxiliary: dict[str, Any] = {
            name: np.concatenate([getattr(whole, name) for whole in wholes])
            for name in ("time", *KINDS, *MOTORS.values())
            if getattr(wholes[0], name) is not None
        }
        above = np.cumsum([0, *(len(whole) for whole in wholes[:-1])])
        ends = np.concatenate([each.lined.ends + shift for each, shift in zip(sets, above, strict=True)])
        sources = [source for each in sets for source in each.lined.sources]
        return cls(
            [pair for each in sets for pair in each.pairs],
            Lined(replace(wholes[0], field=field, **auxiliary), ends, sources),
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
            there = self.lined.counts > 0
            begins = (self.lined.ends - self.lined.counts)[there]
            for column, extreme in enumerate((np.fmin, np.fmax) if len(begins) else ()):
                spans[there, column] = self.start_s[there] + extreme.reduceat(time, begins)
        return spans


class RowFilter:
    """Which rows of a table are taken, by the number of their recording.

    Parameters
    ----------
    partition : Partition
        Says which units are taken.
    some : container of (str, str), optional
        Which of their recordings; by default all.

    Attributes
    ----------
    names : Interner
    nameless : int
        Rows of no unit so far, which are never taken.
    """

    def __init__(self, partition: Partition, some: Container[Pair] | None = None) -> None:
        self.names = Interner()
        self.nameless = 0
        self._empty = self.names.number("")
        self._partition, self._some = partition, some
        self._known: dict[int, bool] = {}

    def takes(self, pair: Pair) -> bool:
        """Whether a recording is taken."""
        return self._partition.takes(pair[0]) and (self._some is None or pair in self._some)

    def nameless_in(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which rows are of no unit, if this partition reports those."""
        nameless: NDArray[np.bool_] = (numbers >> HALF == self._empty) & self.takes(("", ""))
        return nameless

    def mask(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which rows are taken."""
        if self._partition.only is None and not self._partition.without and self._some is None:
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
        values = values[:, np.argsort(every, kind="stable")]
        runs = Runs(*np.unique(every, return_counts=True))
    ends = np.cumsum(runs.lengths)
    field = [columns.cells.index(cell) for cell in columns.field.cells]
    with np.errstate(over="ignore", invalid="ignore"):
        is_whole = all(np.isfinite(values[row].sum()) for row in field)  # a sum is finite if all its terms are
    usable = np.isfinite(values[field]).all(axis=0) if not is_whole else np.ones(1, dtype=bool)
    if not usable.all():
        values, ends = values[:, usable], np.concatenate([[0], np.cumsum(usable)])[ends]
    if columns.time is not None:
        values = _sorted_by_time(values, ends, values[columns.cells.index(columns.time.cells[0])])
    pairs = [rows.names.pair(number) for number in runs.numbers.tolist()]
    lined = Lined(table.samples(values, part.file.name), ends, [" ".join(filter(None, pair)) for pair in pairs])
    return RecordingSet(pairs, lined, runs.lengths, np.full(len(pairs), table.start_s), part.file.name)


def _read(table: KeyedTable, part: FileSlice, rows: RowFilter) -> tuple[Runs, Floats]:
    """Run lengths of the rows of a slice that are taken, and their values (K, N)."""
    nameless = 0
    runs: list[Runs] = []
    values: list[Floats] = []
    for own, block in table.batches(part.groups, rows.names):
        mask = rows.mask(own.numbers)
        whole = mask.all()
        nameless += 0 if whole else int(own.lengths[rows.nameless_in(own.numbers)].sum())
        runs.append(own if whole else Runs(own.numbers[mask], own.lengths[mask]))
        values.append(block if whole else block[:, np.repeat(mask, own.lengths)])
    rows.nameless += nameless
    empty = np.empty((len(table.recording.columns.cells), 0))
    return Runs.joined(runs), values[0] if len(values) == 1 else np.concatenate([empty, *values], axis=1)


def _sorted_by_time(values: Floats, ends: NDArray[np.int64], time: Floats) -> Floats:
    """Sort columns (K, N) of recordings that end at (R,) `ends` by (N,) times, where all are known.

    >>> _sorted_by_time(np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([2, 4]), np.array([5.0, 3.0, 7.0, 7.0]))
    array([[2., 1., 3., 4.]])
    """
    back = time[1:] < time[:-1]
    back[ends[(ends > 0) & (ends < len(time))] - 1] = False
    if not back.any():
        return values
    of = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    moved = np.zeros(len(ends), dtype=bool)
    moved[of[:-1][back]] = True
    moved[of[~np.isfinite(time)]] = False
    rows, order = np.flatnonzero(moved[of]), np.arange(len(time))
    order[rows] = rows[np.lexsort((time[rows], of[rows]))]
    return values[:, order]


def merged_recording(parts: Sequence[Job]) -> Job | UnitResult:
    """Merge the parts of one recording from several slices, in the order of time if all times are known."""
    if len(parts) == 1:
        return parts[0]
    pair, rows = (parts[0].unit, parts[0].recording), sum(part.readings for part in parts)
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
    """Refuse readings in another unit of field than those of the first file.

    Raises
    ------
    UnitError
    """
    if unit.inside != known.inside:
        raise UnitError(
            f"its readings are in {known.inside} in {first} and in {unit.inside} in {file}: give --unit (and --scale "
            "for counts) so that all are in one unit"
        )


@dataclass(frozen=True, slots=True, eq=False)
class StreamedRecording:
    """A recording of more readings than fit into memory, read from its files on each pass.

    Attributes
    ----------
    partition : Partition
        Its files.
    pair : (str, str)
        Unit and recording.
    options : Options
    unit : Unit
    axes : Axes
    start_s : float, s
        Origin of its times.
    """

    partition: Partition
    pair: Pair
    options: Options
    unit: Unit
    axes: Axes
    start_s: float

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
                        samples = table.samples(values[:, mask], self.source)
                        yield delayed(samples, table.start_s - self.start_s)
