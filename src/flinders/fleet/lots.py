"""Readings of many recordings side by side: what a piece of a table has of each, and what several pieces have.

>>> from flinders.fleet.plan import Partition
>>> wanted = Wanted(Partition((), without=("B02",)))
>>> numbers = [wanted.names.number(unit) << HALF for unit in ("A17", "B02", "")]
>>> wanted.mask(np.array(numbers)), wanted.nobodys(np.array(numbers))
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
from flinders.estimators.cache import concatenated
from flinders.fleet.table import Row
from flinders.fleet.tables import HALF, Names, Runs
from flinders.stacked import Lined

if TYPE_CHECKING:
    from collections.abc import Container, Hashable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.core.units import Unit
    from flinders.fleet.plan import Partition, Piece
    from flinders.fleet.tables import KeyedTable, Pair


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One recording of one unit, ready to be fitted.

    Attributes
    ----------
    unit, recording : str
    source : Recording
    readings : int
        Rows that there are of it, those that cannot be used too.
    start_s : float, s
        What the times of `source` count from; NaN where that is not known.
    file : str
        Where it lies.
    """

    unit: str
    recording: str
    source: Recording
    readings: int
    start_s: float = 0.0
    file: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Lot:
    """The readings that one piece, or several, have of recordings.

    Attributes
    ----------
    pairs : sequence of (str, str)
        Unit and recording.
    lined : Lined
        The readings that can be used.
    rows : (R,) int
        How many rows each has.
    start_s : (R,) float, s
        What times of each count from.
    file : str
        Where they lie; empty where that is in several.
    """

    pairs: Sequence[Pair]
    lined: Lined
    rows: NDArray[np.int64]
    start_s: Floats
    file: str = ""

    @classmethod
    def joined(cls, lots: Sequence[Lot]) -> list[Lot]:
        """Put those together that may be fitted together: more of them at a time, and each costs less."""
        alike: dict[Hashable, list[Lot]] = defaultdict(list)
        for place, lot in enumerate(lots):
            whole = lot.lined.whole
            is_bare = whole.strength is None and not whole.skipped
            alike[(whole.unit, whole.axes, whole.time is None, whole.drivers) if is_bare else place].append(lot)
        return [each[0] if len(each) == 1 else cls._one(each) for each in alike.values()]

    @classmethod
    def _one(cls, lots: Sequence[Lot]) -> Lot:
        """Recordings in the same unit and axes, with the same beside their readings, one after the other."""
        wholes = [lot.lined.whole for lot in lots]
        field = np.concatenate([whole.field.T for whole in wholes], axis=1).T
        beside: dict[str, Any] = {
            name: np.concatenate([getattr(whole, name) for whole in wholes])
            for name in ("time", *KINDS, *MOTORS.values())
            if getattr(wholes[0], name) is not None
        }
        above = np.cumsum([0, *(len(whole) for whole in wholes[:-1])])
        ends = np.concatenate([lot.lined.ends + shift for lot, shift in zip(lots, above, strict=True)])
        whole = replace(wholes[0], field=field, **beside)
        sources = [source for lot in lots for source in lot.lined.sources]
        return cls(
            [pair for lot in lots for pair in lot.pairs],
            Lined(whole, ends, sources),
            np.concatenate([lot.rows for lot in lots]),
            np.concatenate([lot.start_s for lot in lots]),
        )

    def jobs(self) -> Iterator[Job]:
        """One by one."""
        columns = zip(self.pairs, self.lined, self.rows.tolist(), self.start_s.tolist(), strict=True)
        yield from (Job(*pair, samples, rows, start_s, self.file) for pair, samples, rows, start_s in columns)

    @property
    def spans(self) -> Floats:
        """(R, 2) the earliest and the latest time of each."""
        spans = np.full((len(self.pairs), 2), math.nan)
        time = self.lined.whole.time
        if time is not None:
            there = self.lined.counts > 0
            begins = (self.lined.ends - self.lined.counts)[there]
            for column, extreme in enumerate((np.fmin, np.fmax) if len(begins) else ()):
                spans[there, column] = self.start_s[there] + extreme.reduceat(time, begins)
        return spans


class Wanted:
    """Which rows are taken, by the number of their unit and recording.

    Parameters
    ----------
    partition : Partition
        Says which units.
    some : container of (str, str), optional
        Which of their recordings, by unit and recording; by default all.

    Attributes
    ----------
    names : Names
    nameless : int
        Rows that were met of no unit, which are never taken.
    """

    def __init__(self, partition: Partition, some: Container[Pair] | None = None) -> None:
        self.names = Names()
        self.nameless = 0
        self._nobody = self.names.number("")
        self._partition, self._some = partition, some
        self._known: dict[int, bool] = {}

    def takes(self, pair: Pair) -> bool:
        """Whether a recording is taken."""
        return self._partition.takes(pair[0]) and (self._some is None or pair in self._some)

    def nobodys(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which of these are of no unit, where those are the partition's to tell of."""
        nobodys: NDArray[np.bool_] = (numbers >> HALF == self._nobody) & self.takes(("", ""))
        return nobodys

    def mask(self, numbers: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(B,) which of these are taken."""
        if self._partition.only is None and not self._partition.without and self._some is None:
            somebodys: NDArray[np.bool_] = numbers >> HALF != self._nobody
            return somebodys
        distinct, places = np.unique(numbers, return_inverse=True)
        return np.array([self._one(number) for number in distinct.tolist()], dtype=bool)[places]

    def _one(self, number: int) -> bool:
        if number not in self._known:
            pair = self.names.pair(number)
            self._known[number] = bool(pair[0]) and self.takes(pair)
        return self._known[number]


def lot_of(table: KeyedTable, piece: Piece, wanted: Wanted) -> Lot:
    """What a piece has of each recording: in the order of time, or of its rows where times are not known."""
    columns = table.recording.columns
    nameless = 0
    parts: list[Runs] = []
    values: list[Floats] = []
    for own, block in table.batches(piece.groups, wanted.names):
        mask = wanted.mask(own.numbers)
        whole = mask.all()
        nameless += 0 if whole else int(own.lengths[wanted.nobodys(own.numbers)].sum())
        parts.append(own if whole else Runs(own.numbers[mask], own.lengths[mask]))
        values.append(block if whole else block[:, np.repeat(mask, own.lengths)])
    runs = Runs.joined(parts)
    read = values[0] if len(values) == 1 else np.concatenate([np.empty((len(columns.cells), 0)), *values], axis=1)
    del parts, values
    if len(np.unique(runs.numbers)) < len(runs.numbers):
        every = runs.rows
        read = read[:, np.argsort(every, kind="stable")]
        runs = Runs(*np.unique(every, return_counts=True))
    ends = np.cumsum(runs.lengths)
    field = [columns.cells.index(cell) for cell in columns.field.cells]
    with np.errstate(over="ignore", invalid="ignore"):
        is_whole = all(np.isfinite(read[row].sum()) for row in field)  # a sum is whenever all its terms are
    usable = np.isfinite(read[field]).all(axis=0) if not is_whole else np.ones(1, dtype=bool)
    if not usable.all():
        read, ends = read[:, usable], np.concatenate([[0], np.cumsum(usable)])[ends]
    if columns.time is not None:
        read = _in_order(read, ends, read[columns.cells.index(columns.time.cells[0])])
    wanted.nameless += nameless
    pairs = [wanted.names.pair(number) for number in runs.numbers.tolist()]
    lined = Lined(table.samples(read, piece.member.name), ends, [" ".join(filter(None, pair)) for pair in pairs])
    return Lot(pairs, lined, runs.lengths, np.full(len(pairs), table.start_s), piece.member.name)


def _in_order(values: Floats, ends: NDArray[np.int64], time: Floats) -> Floats:
    """Put columns (K, N) of recordings that end at (R,) `ends` in the order of (N,) times, where all are known.

    >>> _in_order(np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([2, 4]), np.array([5.0, 3.0, 7.0, 7.0]))
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


def gathered(parts: Sequence[Job]) -> Job | Row:
    """One recording from what several pieces have of it, in the order of time where they have times."""
    pair, rows = (parts[0].unit, parts[0].recording), sum(part.readings for part in parts)
    if len(parts) == 1:
        return parts[0]
    samples = cast("list[Samples]", [part.source for part in parts])
    try:
        for part, each in zip(parts, samples, strict=True):
            refuse_other_unit(part.file, each.unit, parts[0].file, samples[0].unit)
    except UnitError as error:
        return Row.of_error(error, pair[0], recording=pair[1], readings=rows)
    start = min(part.start_s for part in parts)
    later = [moved(each, part.start_s - start) for each, part in zip(samples, parts, strict=True)]
    whole = concatenated(later, later[0])
    if whole.time is not None and np.isfinite(whole.time).all() and (np.diff(whole.time) < 0.0).any():
        whole = whole[np.argsort(whole.time, kind="stable").tolist()]
    return Job(*pair, whole, rows, start)


def moved(samples: Samples, seconds: float) -> Samples:
    """Samples on another clock."""
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
