r"""One partition: its readings in, its rows out. Nothing that is wrong with a unit or a file ends the job.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.plan import plan_of
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n"), (folder / "B02.csv").write_text("nothing\n")
>>> asked = Asked()
>>> rows = Rows.joined(Rows.from_bytes(done(each, asked=asked)) for each in plan_of(str(folder), asked).partitions)
>>> list(zip(rows.unit.tolist(), rows.verdict.tolist(), rows.code.tolist()))
[('A17', 'refused', 'too-few-samples'), ('B02', 'failed', 'unreadable')]
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from flinders import fitting
from flinders.drivers import KINDS, MOTORS
from flinders.errors import FlindersError, InputError, UnitError
from flinders.estimators.kept import concatenated
from flinders.fleet import store
from flinders.fleet.plan import LARGEST, Partition, Piece, key_of
from flinders.fleet.table import LONGEST, NAMES, Row, Rows, objects
from flinders.fleet.tables import Asked, KeyedTable, Names, Runs, opened
from flinders.readers import open_log
from flinders.samples import Joined, Samples, frame_of
from flinders.stacked import Lined, fit_stack
from flinders.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.axes import Axes
    from flinders.readers import Instrument, Log
    from flinders.samples import Recording
    from flinders.stacked import Columns
    from flinders.units import Unit

Pair = tuple[str, str]


class LostWorker(InputError):
    """A file whose reading or fitting ends the worker that does it, time and again (`attempts`)."""

    code = "lost-worker"

    def __init__(self, name: str, attempts: int) -> None:
        self.attempts = attempts
        super().__init__(
            f"{name}: {attempts} workers died of it, one after the other: left out. Fit it by itself with flinders "
            "calibrate, and look at the memory of the machine"
        )


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
    """

    unit: str
    recording: str
    source: Recording
    readings: int
    start_s: float = 0.0


def done(partition: Partition, *, asked: Asked) -> bytes:
    """Work on a partition, and give its rows, sorted, as the bytes of an Arrow file.

    Parameters
    ----------
    partition : Partition
    asked : Asked
    """
    rows = _of_tables(partition, asked) if partition.pieces[0].groups else _of_logs(partition, asked)
    return rows.sorted().to_bytes()


def lost(partition: Partition, attempts: int) -> list[Row]:
    """The rows of a partition that no worker survives: those of its units where they are known, else of its files."""
    error = LostWorker(", ".join(piece.member.name for piece in partition.pieces), attempts)
    if partition.only is not None:
        return [Row.of_error(error, unit) for unit in partition.only]
    return [_failed(piece, LostWorker(piece.member.name, attempts)) for piece in partition.pieces]


def fitted(jobs: Sequence[Job], asked: Asked) -> Rows:
    """Fit recordings: those in memory together, each with the numbers that `flinders.fit` gives it by itself.

    Parameters
    ----------
    jobs : sequence of Job
    asked : Asked
        Of which the target, the dip and whether to polish count.
    """
    held = [job for job in jobs if isinstance(job.source, Samples)]
    others = [_row(job, asked) for job in jobs if not isinstance(job.source, Samples)]
    return Rows.joined([_together(held, asked), Rows.of(others)])


def _together(jobs: Sequence[Job], asked: Asked) -> Rows:
    """Fit recordings in memory as stacks; one by one, should that fail for any reason."""
    if not jobs:
        return Rows.of(())
    try:
        columns = _columns(cast("list[Samples]", [job.source for job in jobs]), asked)
    except Exception:  # noqa: BLE001 - the others are not to go without for one of them
        return Rows.of([_row(job, asked) for job in jobs])
    readings = [job.readings or len(job.source) for job in jobs]  # type: ignore[arg-type]
    spans = np.array([_span(job) for job in jobs])
    return _laid_out(columns, [(job.unit, job.recording) for job in jobs], np.array(readings, dtype=np.int64), spans)


def _lined(lot: _Lot, asked: Asked) -> Rows:
    """Fit what lies in one table as stacks; one by one, should that fail for any reason."""
    try:
        columns = _columns(lot.lined, asked)
    except Exception:  # noqa: BLE001 - as in `_together`
        return Rows.of([_row(job, asked) for job in lot.jobs()])
    return _laid_out(columns, lot.pairs, lot.rows, lot.spans)


def _columns(sources: Sequence[Samples] | Lined, asked: Asked) -> Columns:
    """Fit recordings in memory together."""
    return fit_stack(sources, target_deg=asked.target_deg, dip_deg=asked.dip_deg, polish=asked.polish)


def _laid_out(columns: Columns, pairs: Sequence[Pair], readings: NDArray[np.int64], spans: Floats) -> Rows:
    """Rows of fits, with whose they are, (R,) how many readings there were, and (R, 2) from when to when, in s."""
    own: dict[str, Any] = {
        "unit": objects([unit for unit, _ in pairs]),
        "recording": objects([recording for _, recording in pairs]),
        "start_s": spans[:, 0],
        "end_s": spans[:, 1],
        "readings": readings,
        "message": objects([message and " ".join(message.split())[:LONGEST] for message in columns.message.tolist()]),
    }
    return Rows(**{name: own[name] if name in own else getattr(columns, name) for name in NAMES})


def _span(job: Job) -> tuple[float, float]:
    """Times of the first and the last reading of what is in memory."""
    time = getattr(job.source, "time", None)
    if time is None or not len(time):
        return math.nan, math.nan
    return job.start_s + float(time[0]), job.start_s + float(time[-1])


def _row(job: Job, asked: Asked) -> Row:
    """Fit one, whatever comes of it."""
    watched = Watched(job.source)
    source: Recording | Summary = watched
    options: dict[str, Any] = {"target_deg": asked.target_deg, "dip_deg": asked.dip_deg}
    told: dict[str, Any] = {"recording": job.recording}
    try:
        if isinstance(job.source, Samples):
            source = job.source
            watched.see(job.source)
        if not asked.polish:
            source = Summary.of(source) if isinstance(source, Samples) else Summary.through(watched)
            options |= {"method": "consistent", "unit": job.source.unit, "axes": job.source.axes}
        fit = fitting.fit(source, **options)
    except Exception as error:  # noqa: BLE001 - whatever one recording of a million does, the others are fitted
        told |= {**watched.span(job.start_s), "readings": job.readings or watched.rows}
        return Row.of_error(error, job.unit, unit_of_field=job.source.unit.inside, **told)
    told |= {**watched.span(job.start_s), "readings": job.readings or watched.rows}
    return Row.of_fit(fit, job.unit, **told)


class Watched:
    """A recording, and how many readings it had from when to when, once it was gone through.

    Attributes
    ----------
    recording : Recording
    rows : int
    """

    def __init__(self, recording: Recording) -> None:
        self.recording, self.source = recording, recording.source
        self.unit, self.axes, self.frame = recording.unit, recording.axes, frame_of(recording)
        self._begin()

    def _begin(self) -> None:
        self.rows, self._first, self._last = 0, math.nan, math.nan

    def blocks(self) -> Iterator[Samples]:
        """Go through it."""
        self._begin()
        for block in self.recording.blocks():
            self.see(block)
            yield block

    def see(self, block: Samples) -> None:
        """Take note of a block."""
        self.rows += len(block)
        if block.time is not None and len(block):
            self._first = float(block.time[0]) if math.isnan(self._first) else self._first
            self._last = float(block.time[-1])

    def span(self, start_s: float) -> dict[str, float]:
        """Times of the first and the last reading."""
        return {"start_s": start_s + self._first, "end_s": start_s + self._last}


def _failed(piece: Piece, error: Exception) -> Row:
    """The row of a file that cannot be read."""
    if piece.groups:
        return Row.of_error(error, "", recording=piece.member.name)
    unit, recording = key_of(piece.member.name)
    return Row.of_error(error, unit, recording=recording)


def _of_logs(partition: Partition, asked: Asked) -> Rows:
    """The rows of log files."""
    with contextlib.ExitStack() as copies:
        found = [_log(piece, asked, copies) for piece in partition.pieces]
        failed = Rows.of([row for row in found if isinstance(row, Row)])
        return Rows.joined([failed, fitted([job for job in found if isinstance(job, Job)], asked)])


def _log(piece: Piece, asked: Asked, copies: contextlib.ExitStack) -> Job | Row:
    """Open a log file; a copy of one from a store stays until the fits are done."""
    unit, recording = key_of(piece.member.name)
    try:
        log = open_log(
            copies.enter_context(store.fetched(piece.member)),
            columns=asked.columns,
            unit=asked.unit,
            scale=asked.scale,
            axes=asked.axes,
            as_logged=asked.as_logged,
        )
        begun = 0.0 if log.begun is None else log.begun.timestamp()
        return Job(unit, recording, _short(_instrument(log, asked)), 0, begun)
    except Exception as error:  # noqa: BLE001 - as in `_row`: one file of a million
        return _failed(piece, error)


def _instrument(log: Log, asked: Asked) -> Instrument:
    """The magnetometer that is meant, by default the first."""
    return log.instruments[0] if asked.sensor is None else log.sensor(asked.sensor)


def _short(source: Recording) -> Recording:
    """A recording of one block as what is in it; a longer one as it is."""
    blocks = source.blocks()
    first = next(blocks, None)
    return source if first is None or next(blocks, None) is not None else first


def _of_tables(partition: Partition, asked: Asked) -> Rows:
    """The rows of files of rows; those with more than `LARGEST` rows are gone through several times."""
    if partition.rows <= LARGEST:
        return _taken(partition, asked)
    counts: Counter[Pair] = Counter()
    sound: list[Piece] = []
    failed: list[Row] = []
    for piece in partition.pieces:
        try:
            with opened(piece.member, asked) as file:
                counts += KeyedTable.of(file, asked).counts(piece.groups, Names())
            sound.append(piece)
        except FlindersError as error:
            failed.append(_failed(piece, error))
    wanted = {pair: rows for pair, rows in sorted(counts.items()) if _is_wanted(partition, pair[0])}
    stacks = _stacks({pair: rows for pair, rows in wanted.items() if rows <= LARGEST})
    held = replace(partition, pieces=tuple(sound))
    found = [_taken(held, asked, some.__contains__, is_first=some is stacks[0]) for some in stacks]
    streamed = [_streamed(partition, pair, rows, asked) for pair, rows in wanted.items() if rows > LARGEST]
    return Rows.joined([*found, Rows.of(failed + streamed)])


def of_table(table: KeyedTable, partition: Partition, asked: Asked) -> Rows:
    """The rows of one table that is in memory, of which a partition says what is taken."""
    return _lined(_lot(table, partition.pieces[0], Wanted(partition)), asked)


def _is_wanted(partition: Partition, unit: str) -> bool:
    return unit not in partition.without if partition.only is None else unit in partition.only


def _stacks(counts: dict[Pair, int]) -> list[set[Pair]]:
    """Recordings in sets that fit into memory.

    >>> [len(some) for some in _stacks({("A", ""): 600_000, ("B", ""): 300_000, ("C", ""): 300_000})]
    [2, 1]
    """
    stacks: list[set[Pair]] = []
    room = 0
    for pair, rows in counts.items():
        if rows > room:
            stacks.append(set())
            room = LARGEST
        stacks[-1].add(pair)
        room -= rows
    return stacks


@dataclass(frozen=True, slots=True, eq=False)
class _Lot:
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
    """

    pairs: Sequence[Pair]
    lined: Lined
    rows: NDArray[np.int64]
    start_s: Floats

    @classmethod
    def joined(cls, lots: Sequence[_Lot]) -> list[_Lot]:
        """Put those together that may be fitted together: more of them at a time, and each costs less."""
        alike: dict[Hashable, list[_Lot]] = defaultdict(list)
        for place, lot in enumerate(lots):
            whole = lot.lined.whole
            is_bare = whole.strength is None and not whole.skipped
            alike[(whole.unit, whole.axes, whole.time is None, whole.drivers) if is_bare else place].append(lot)
        return [each[0] if len(each) == 1 else cls._one(each) for each in alike.values()]

    @classmethod
    def _one(cls, lots: Sequence[_Lot]) -> _Lot:
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
        yield from (Job(*pair, samples, rows, start_s) for pair, samples, rows, start_s in columns)

    @property
    def spans(self) -> Floats:
        """(R, 2) times of the first and the last reading of each."""
        spans = np.full((len(self.pairs), 2), math.nan)
        time = self.lined.whole.time
        if time is not None:
            there = self.lined.counts > 0
            ends = self.lined.ends[there]
            spans[there, 0] = self.start_s[there] + time[ends - self.lined.counts[there]]
            spans[there, 1] = self.start_s[there] + time[ends - 1]
        return spans


def _taken(
    partition: Partition, asked: Asked, is_taken: Callable[[Pair], bool] | None = None, *, is_first: bool = True
) -> Rows:
    """Read what is taken of a partition into memory, and fit it."""
    wanted = Wanted(partition, is_taken)
    lots: list[_Lot] = []
    failed: list[Row] = []
    for piece in partition.pieces:
        try:
            with opened(piece.member, asked) as file:
                lots.append(_lot(KeyedTable.of(file, asked), piece, wanted))
        except Exception as error:  # noqa: BLE001 - as in `_row`: one file of many
            failed += [_failed(piece, error)] if is_first else []
    held = Counter(pair for lot in lots for pair in lot.pairs)
    whole: list[_Lot] = []
    parts: dict[Pair, list[Job]] = defaultdict(list)
    for lot in lots:
        if all(held[pair] == 1 for pair in lot.pairs):
            whole.append(lot)
        else:
            for job in lot.jobs():
                parts[job.unit, job.recording].append(job)
    jobs = [_gathered(each) for _, each in sorted(parts.items())]
    rows = [job for job in jobs if isinstance(job, Row)]
    rest = fitted([job for job in jobs if isinstance(job, Job)], asked)
    del lots
    return Rows.joined([Rows.of(failed + rows), rest, *(_lined(lot, asked) for lot in _Lot.joined(whole))])


class Wanted:
    """Which rows are taken, by the number of their unit and recording.

    Parameters
    ----------
    partition : Partition
        Says which units.
    is_taken : callable, optional
        Says which of these, by unit and recording; by default all.
    """

    def __init__(self, partition: Partition, is_taken: Callable[[Pair], bool] | None = None) -> None:
        self.names = Names()
        self._partition, self._is_taken = partition, is_taken
        self._known: dict[int, bool] = {}

    def mask(self, numbers: Any) -> Any:  # noqa: ANN401 - arrays
        """(B,) which of these are taken."""
        if self._partition.only is None and not self._partition.without and self._is_taken is None:
            return np.ones(numbers.shape, dtype=bool)
        distinct, places = np.unique(numbers, return_inverse=True)
        return np.array([self._one(number) for number in distinct.tolist()], dtype=bool)[places]

    def _one(self, number: int) -> bool:
        if number not in self._known:
            pair = self.names.pair(number)
            self._known[number] = _is_wanted(self._partition, pair[0]) and (
                self._is_taken is None or self._is_taken(pair)
            )
        return self._known[number]


def _lot(table: KeyedTable, piece: Piece, wanted: Wanted) -> _Lot:
    """What a piece has of each recording, in the order of its rows."""
    columns = table.recording.columns
    parts: list[Runs] = []
    values: list[Floats] = []
    for own, block in table.batches(piece.groups, wanted.names):
        mask = wanted.mask(own.numbers)
        whole = mask.all()
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
    pairs = [wanted.names.pair(number) for number in runs.numbers.tolist()]
    lined = Lined(table.samples(read, piece.member.name), ends, [" ".join(filter(None, pair)) for pair in pairs])
    return _Lot(pairs, lined, runs.lengths, np.full(len(pairs), table.start_s))


def _gathered(parts: Sequence[Job]) -> Job | Row:
    """One recording from what several pieces have of it, in the order of time where they have times."""
    pair, rows = (parts[0].unit, parts[0].recording), sum(part.readings for part in parts)
    if len(parts) == 1:
        return parts[0]
    samples = cast("list[Samples]", [part.source for part in parts])
    try:
        Joined(tuple(samples))
    except UnitError as error:
        return Row.of_error(error, pair[0], recording=pair[1], readings=rows)
    start = min(part.start_s for part in parts)
    later = [_moved(each, part.start_s - start) for each, part in zip(samples, parts, strict=True)]
    whole = concatenated(later, later[0])
    if whole.time is not None and np.isfinite(whole.time).all() and (np.diff(whole.time) < 0.0).any():
        whole = whole[np.argsort(whole.time, kind="stable").tolist()]
    return Job(*pair, whole, rows, start)


def _moved(samples: Samples, seconds: float) -> Samples:
    """Samples on another clock."""
    return samples if samples.time is None or not seconds else replace(samples, time=samples.time + seconds)


def _streamed(partition: Partition, pair: Pair, rows: int, asked: Asked) -> Row:
    """Fit a recording of more rows than are held in memory, going through its files as often as that takes."""
    try:
        source = Streamed.of(partition, pair, asked)
    except Exception as error:  # noqa: BLE001 - as in `_row`
        return Row.of_error(error, pair[0], recording=pair[1], readings=rows)
    return _row(Job(*pair, source, rows, source.start_s), asked)


@dataclass(frozen=True, slots=True, eq=False)
class Streamed:
    """A recording that is read from files of rows each time it is gone through.

    Attributes
    ----------
    partition : Partition
        The files.
    pair : (str, str)
        Unit and recording.
    asked : Asked
    unit : Unit
    axes : Axes
    start_s : float, s
        What its times count from.
    """

    partition: Partition
    pair: Pair
    asked: Asked
    unit: Unit
    axes: Axes
    start_s: float

    @classmethod
    def of(cls, partition: Partition, pair: Pair, asked: Asked) -> Streamed:
        """Look at the first file."""
        with opened(partition.pieces[0].member, asked) as file:
            table = KeyedTable.of(file, asked)
            return cls(partition, pair, asked, table.recording.unit, table.recording.axes, table.start_s)

    @property
    def source(self) -> str:
        """Unit and recording."""
        return " ".join(filter(None, self.pair))

    def blocks(self) -> Iterator[Samples]:
        """Go through its readings."""
        for piece in self.partition.pieces:
            wanted = Wanted(self.partition, self.pair.__eq__)
            with opened(piece.member, self.asked) as file:
                table = KeyedTable.of(file, self.asked)
                for runs, values in table.batches(piece.groups, wanted.names):
                    mask = np.repeat(wanted.mask(runs.numbers), runs.lengths)
                    if mask.any():
                        samples = table.samples(values[:, mask], self.source)
                        yield _moved(samples, table.start_s - self.start_s)
