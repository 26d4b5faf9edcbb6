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
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from flinders.core.samples import Samples, frame_of
from flinders.errors import FlindersError, InputError, OutputError, UnreadableInput, counted
from flinders.fitting import calibrate
from flinders.fleet import store
from flinders.fleet.gaps import NOT_PLANNED, Gaps, opened_as_planned
from flinders.fleet.lots import Job, Lot, Wanted, gathered, lot_of
from flinders.fleet.plan import LARGEST, Partition, Piece, key_of
from flinders.fleet.streamed import Streamed
from flinders.fleet.table import LONGEST, NAMES, VERDICTS, Row, Rows, objects
from flinders.fleet.tables import Asked, KeyedTable, Keys, Names, batch_in, counts_of, opened, refuse_empty
from flinders.readers import open_log
from flinders.stacked import Lined, fit_stack
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.fleet.tables import Pair, Tabular
    from flinders.readers import Instrument, Log
    from flinders.stacked import Columns

Found = TypeVar("Found")


class LostWorker(InputError):
    """A file whose reading or fitting ends the worker that does it, time and again (`attempts`)."""

    code = "lost-worker"

    def __init__(self, name: str, attempts: int) -> None:
        self.attempts = attempts
        super().__init__(
            f"{name}: {attempts} workers died of it, one after the other: left out. Fit it by itself with flinders "
            "calibrate, and look at the memory of the machine"
        )


class NoUnit(InputError):
    """Readings of which nothing says which unit they are of (`rows` of a table, or a log in a folder of null)."""

    code = "no-unit"

    def __init__(self, where: str, rows: int = 0) -> None:
        self.rows = rows
        super().__init__(
            f"{counted(rows, 'row')} of {where} name no unit: fitted to none; fill the column of units in, or name "
            "another one with --unit-column"
            if rows
            else f"{where} lies in a folder of no unit: give that folder a name"
        )


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


def _lined(lot: Lot, asked: Asked) -> Rows:
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
        "batch": np.full(len(pairs), "", dtype=object),
        "message": objects([message and " ".join(message.split())[:LONGEST] for message in columns.message.tolist()]),
    }
    return Rows(**{name: own[name] if name in own else getattr(columns, name) for name in NAMES})


def _span(job: Job) -> tuple[float, float]:
    """The earliest and the latest time of what is in memory."""
    time = getattr(job.source, "time", None)
    if time is None or not len(time):
        return math.nan, math.nan
    return job.start_s + float(np.fmin.reduce(time)), job.start_s + float(np.fmax.reduce(time))


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
        fit = calibrate.fit(source, **options)
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
            self._first = float(np.fmin(self._first, np.fmin.reduce(block.time)))
            self._last = float(np.fmax(self._last, np.fmax.reduce(block.time)))

    def span(self, start_s: float) -> dict[str, float]:
        """The earliest and the latest time."""
        return {"start_s": start_s + self._first, "end_s": start_s + self._last}


def _failed(piece: Piece, error: Exception) -> Row:
    """The row of a file that cannot be read."""
    if piece.groups:
        return Row.of_error(error, f"({piece.member.name})", readings=piece.rows)
    if piece.is_table:
        row = Row.of_error(error, f"({piece.member.name})")
        where = f"it cannot be told whose readings are in {piece.member.name}"
        said = f"{where}, and a unit that has some of them and others elsewhere was fitted without them: {row.message}"
        return replace(row, message=said[:LONGEST])
    unit, recording = key_of(piece.member.name)
    return Row.of_error(error, unit, recording=recording)


def _of_logs(partition: Partition, asked: Asked) -> Rows:
    """The rows of log files."""
    with contextlib.ExitStack() as copies:
        found = [_log(piece, asked, copies) for piece in partition.pieces]
        failed = Rows.of([row for row in found if isinstance(row, Row)])
        rows = Rows.joined([failed, fitted([job for job in found if isinstance(job, Job)], asked)])
    names = [piece.member.name for piece in partition.pieces]
    return _of_batches(rows, {key_of(name): batch for name in names if (batch := batch_in(name, asked))})


def _of_batches(rows: Rows, batches: Mapping[Pair, str]) -> Rows:
    """Rows with the batches of hardware that their units are of."""
    if not batches:
        return rows
    pairs = zip(rows.unit.tolist(), rows.recording.tolist(), strict=True)
    return replace(rows, batch=objects([batches.get(pair, "") for pair in pairs]))


def _log(piece: Piece, asked: Asked, copies: contextlib.ExitStack) -> Job | Row:
    """Open a log file; a copy of one from a store stays until the fits are done."""
    unit, recording = key_of(piece.member.name)
    if not unit and not piece.is_table:
        return _failed(piece, NoUnit(piece.member.name))
    try:
        refused = _refused(piece, asked) if piece.is_refused else None
        if refused is not None:
            return _failed(replace(piece, is_table=True), refused)
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
    except OutputError:  # no room for a copy: that is no fault of the file, and the next has none either
        raise
    except Exception as error:  # noqa: BLE001 - as in `_row`: one file of a million
        return _failed(piece, error)


def _refused(piece: Piece, asked: Asked) -> FlindersError | None:
    """Why a file that could not be opened as a table is not fitted now; None where it is the log of one unit.

    Raises
    ------
    FlindersError
        Where it still cannot be opened.
    """
    with opened(piece.member, asked) as file:
        try:
            if not piece.is_table and Keys.of_schema(file.name, file.schema, asked) is None:
                return None
            refuse_empty(file)
            KeyedTable.of(file, asked)
        except FlindersError as error:
            return error
    return UnreadableInput(f"{piece.member.name} {NOT_PLANNED}")


def _instrument(log: Log, asked: Asked) -> Instrument:
    """The magnetometer that is meant, by default the first; that of a table of one has no name, and is meant by any."""
    if asked.sensor is None or (log.is_table and len(log.instruments) == 1):
        return log.instruments[0]
    return log.sensor(asked.sensor)


def _short(source: Recording) -> Recording:
    """A recording of one block as what is in it; a longer one as it is."""
    blocks = source.blocks()
    first = next(blocks, None)
    return source if first is None or next(blocks, None) is not None else first


def _of_tables(partition: Partition, asked: Asked) -> Rows:
    """The rows of files of rows; those with more than `LARGEST` rows are gone through several times."""
    gaps = Gaps(partition, asked)
    if partition.rows <= LARGEST:
        return _taken(partition, asked, gaps)
    names = Names()
    counts_of_pieces = [(piece, _counted(piece, asked, gaps, names)) for piece in partition.pieces]
    counts: Counter[Pair] = sum((own for _, own in counts_of_pieces), Counter())
    wanted = {pair: rows for pair, rows in sorted(counts.items()) if partition.takes(pair[0])}
    nameless = sum(rows for (unit, _), rows in wanted.items() if not unit)
    held = {pair: rows for pair, rows in wanted.items() if pair[0] and rows <= LARGEST}
    found = [_taken(partition, asked, gaps, some) for some in _stacks(held)]
    streamed = []
    for pair, rows in wanted.items():
        if pair[0] and pair not in held:
            pieces = tuple(piece for piece, own in counts_of_pieces if own[pair])
            streamed.append(_streamed(replace(partition, pieces=pieces), pair, rows, asked, gaps))
    others = gaps.rows({pair: 0 for pair in gaps.lost(wanted) - wanted.keys() if partition.takes(pair[0])})
    others += _nobodys(partition, nameless, gaps)
    return _of_batches(Rows.joined([*found, Rows.of(streamed + others)]), gaps.batches(names.batches))


def _counted(piece: Piece, asked: Asked, gaps: Gaps, names: Names) -> Counter[Pair]:
    """How many readings of each recording a piece has, as far as its columns of keys can be read."""

    def counted_in(file: Tabular, groups: Sequence[int]) -> Counter[Pair]:
        keys = Keys.of_schema(file.name, file.schema, asked) or Keys()
        return counts_of(file, keys, groups, names)

    counts = _of_readable(piece, asked, gaps, counted_in) or Counter()
    return counts + gaps.counts_in(piece)


def _nobodys(partition: Partition, rows: int, gaps: Gaps) -> list[Row]:
    """Rows for readings that name no unit, and for those whose unit cannot be read; of these only once."""
    found = gaps.untold() if partition.only is None else []
    if rows:
        pieces = [piece.member.name for piece in partition.pieces]
        where = ", ".join(pieces[:3]) + f" and {len(pieces) - 3} more" * (len(pieces) > 3)
        found.append(Row.of_error(NoUnit(where, rows), "", readings=rows))
    return found


def of_table(table: KeyedTable, partition: Partition, asked: Asked) -> Rows:
    """The rows of one table that is in memory, of which a partition says what is taken."""
    wanted = Wanted(partition)
    rows = _lined(lot_of(table, partition.pieces[0], wanted), asked)
    nobodys = _nobodys(partition, wanted.nameless, Gaps(partition, asked))
    return _of_batches(Rows.joined([rows, Rows.of(nobodys)]), wanted.names.batches)


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


def _taken(partition: Partition, asked: Asked, gaps: Gaps, some: Container[Pair] | None = None) -> Rows:
    """Read a partition into memory, or `some` of its recordings, and fit them."""
    wanted = Wanted(partition, some)
    lots = [lot for piece in partition.pieces for lot in _read(piece, asked, wanted, gaps)]
    held = Counter(pair for lot in lots for pair in lot.pairs)
    lost = {pair for pair in gaps.lost(held) if wanted.takes(pair)}
    whole: list[Lot] = []
    parts: dict[Pair, list[Job]] = defaultdict(list)
    for lot in lots:
        if all(held[pair] == 1 and pair not in lost for pair in lot.pairs):
            whole.append(lot)
        else:
            for job in lot.jobs():
                parts[job.unit, job.recording].append(job)
    rows = gaps.rows({pair: sum(job.readings for job in parts.pop(pair, ())) for pair in sorted(lost)})
    jobs = [gathered(each) for _, each in sorted(parts.items())]
    rows += [job for job in jobs if isinstance(job, Row)]
    if some is None:
        nameless = wanted.nameless + (gaps.nameless if wanted.takes(("", "")) else 0)
        rows += _nobodys(partition, nameless, gaps)
    rest = fitted([job for job in jobs if isinstance(job, Job)], asked)
    del lots
    fits = Rows.joined([Rows.of(rows), rest, *(_lined(lot, asked) for lot in Lot.joined(whole))])
    return _of_batches(fits, gaps.batches(wanted.names.batches))


def _read(piece: Piece, asked: Asked, wanted: Wanted, gaps: Gaps) -> list[Lot]:
    """What is wanted of a piece; of one that is broken, what can be read of it."""

    def read_of(file: Tabular, groups: Sequence[int]) -> Lot:
        return lot_of(KeyedTable.of(file, asked), replace(piece, groups=tuple(groups)), wanted)

    lot = _of_readable(piece, asked, gaps, read_of)
    return [] if lot is None else [lot]


def _of_readable(
    piece: Piece, asked: Asked, gaps: Gaps, look: Callable[[Tabular, Sequence[int]], Found]
) -> Found | None:
    """Look at the row groups of a piece; where that fails, at those that can be read; None where there are none."""
    for is_sound in (True, False):
        groups = piece.groups if is_sound else gaps.look(piece)
        if not groups:
            break
        try:
            with opened_as_planned(piece, asked) as file:
                return look(file, groups)
        except Exception as error:  # noqa: BLE001 - as in `_row`: one file of many
            if not is_sound:
                gaps.give_up(piece, error)
    return None


def _streamed(partition: Partition, pair: Pair, rows: int, asked: Asked, gaps: Gaps) -> Row:
    """Fit a recording of more rows than are held in memory, going through its files as often as that takes."""
    row = _row_of(partition, pair, rows, asked)
    if row.verdict != VERDICTS[-1]:
        return row
    sound = tuple(replace(piece, groups=groups) for piece in partition.pieces if (groups := gaps.look(piece)))
    if pair in gaps.lost([pair]):
        lost = sum(gap.counts[pair] for gap in gaps.found)
        return gaps.rows({pair: rows - lost})[0]
    return row if sound == partition.pieces else _row_of(replace(partition, pieces=sound), pair, rows, asked)


def _row_of(partition: Partition, pair: Pair, rows: int, asked: Asked) -> Row:
    """Fit a recording of a partition all of which can be read, else say why not."""
    try:
        source = Streamed.of(partition, pair, asked)
    except Exception as error:  # noqa: BLE001 - as in `_row`
        return Row.of_error(error, pair[0], recording=pair[1], readings=rows)
    return _row(Job(*pair, source, rows, source.start_s), asked)
