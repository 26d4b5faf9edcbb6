r"""Worker of a run: calibrates the recordings of one partition; an error costs a recording or a file, never the run.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.apps.fleet.plan import plan_of
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n"), (folder / "B02.csv").write_text("nothing\n")
>>> plan = plan_of(str(folder), Options())
>>> tables = [calibrate_partition(each, options=Options()) for each in plan.partitions]
>>> rows = UnitResults.join(map(UnitResults.from_bytes, tables))
>>> list(zip(rows.unit.tolist(), rows.verdict.tolist(), rows.code.tolist()))
[('A17', 'refused', 'too-few-samples'), ('B02', 'failed', 'unreadable')]
"""

from __future__ import annotations

import contextlib
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from flinders.apps.fleet import storage
from flinders.apps.fleet.dataset import Interner, KeyedTable, TableFile, counts_of, table_in_memory
from flinders.apps.fleet.frame import KeyedFrame
from flinders.apps.fleet.keys import KeyColumns, batch_in
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import MAX_ROWS, FileSlice, Partition, key_of, open_as_planned
from flinders.apps.fleet.recordings import (
    Job,
    RecordingSet,
    RowFilter,
    StreamedRecording,
    merged_recording,
    read_recordings,
)
from flinders.apps.fleet.results import VERDICTS, UnitResult, UnitResults, needs_arrow, objects, one_line
from flinders.apps.fleet.storage import StoredFile
from flinders.apps.fleet.unreadable import Unreadable, UnreadableGroups
from flinders.core.axes import Axes
from flinders.core.frames import hands_out_columns, is_frame
from flinders.core.keywords import check_keywords
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import FlindersError, InputError, MissingExtra, OutputError, UsageError, count_text
from flinders.estimators.data import CountedRecording, recording_of
from flinders.fitting.batch import FitColumns, fit_batch
from flinders.readers import open_log

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.dataset import Pair
    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.readers import Instrument, Log

Value = TypeVar("Value")


class LostWorker(InputError):
    """A file that kills each worker which reads or fits it (`attempts`: number of workers)."""

    code = "lost-worker"

    def __init__(self, name: str, attempts: int) -> None:
        self.attempts = attempts
        super().__init__(
            f"{name}: {attempts} workers died one after the other while they read or fitted this file: left out. Fit "
            "it by itself with flinders calibrate, and check the memory of the machine",
            attempts=attempts,
        )


class NoUnit(InputError):
    """Readings that name no unit: `rows` rows of a table, or a log in a Hive folder that stands for null."""

    code = "no-unit"

    def __init__(self, where: str, rows: int = 0) -> None:
        self.rows = rows
        super().__init__(
            f"{count_text(rows, 'row')} of {where} without a unit: not fitted; fill in the column of units, or name "
            "another column of units"
            if rows
            else f"{where} lies in a folder without the name of a unit: give that folder a name",
            hint={"unit_column": None} if rows else {},
            rows=rows,
        )


def calibrate_partition(partition: Partition, *, options: Options) -> bytes:
    """Calibrate a partition; returns its sorted rows as the bytes of an Arrow file."""
    rows = _fit_tables(partition, options) if partition.slices[0].groups else _fit_logs(partition, options)
    return rows.sorted().to_bytes()


def lost_rows(partition: Partition, attempts: int) -> list[UnitResult]:
    """Rows about a partition that killed its workers: one for each unit if they are known, else for each file."""
    error = LostWorker(", ".join(part.file.name for part in partition.slices), attempts)
    if partition.only is not None:
        return [UnitResult(unit=unit).with_error(error) for unit in partition.only]
    return [_failure_row(part, LostWorker(part.file.name, attempts)) for part in partition.slices]


# --------------------------------------------------------------------------------------------------------- in memory


@check_keywords()
def fit_many(
    table: Any,  # noqa: ANN401 - of Arrow, pandas, polars or anything else that hands over Arrow's columns
    *,
    columns: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    unit_column: str | None = None,
    recording_column: str | None = None,
    batch_column: str | None = None,
    target_deg: float = 1.0,
    dip_deg: float = 60.0,
) -> UnitResults:
    """Calibrate many units, each as `flinders.fit` does; a unit that cannot be fitted is a row with the reason.

    Raises `UsageError` for a table without a column of units, and for unknown columns or units of field;
    `UnreadableInput` for a column of units that is nested or duplicate; `NoMagnetometer` if it is not clear which
    columns are the magnetometer; `MissingExtra` without pyarrow, for a table that is not of pandas or polars.

    Parameters
    ----------
    table : mapping, or table
        A mapping from the name of each unit to its readings, in `unit`: any source of `flinders.fit` but sums. Or a
        table of all readings with a column of units: of pyarrow, or with ``__arrow_c_stream__`` (pandas, polars).
    columns, unit, scale, axes
        As `flinders.read`.
    unit_column, recording_column, batch_column : str, optional
        For a table: the columns with unit, recording and hardware batch of each row; by default names such as
        ``unit`` or ``serial``, ``recording`` or ``session``, and ``batch`` or ``lot``.
    target_deg, dip_deg : float
        As `flinders.fit`.

    Returns
    -------
    UnitResults
        Sorted by unit, recording and start.

    >>> from flinders import simulate
    >>> rows = fit_many({f"A{seed}": simulate.tumble(seed=seed).samples for seed in (1, 2)})
    >>> rows, rows.offset.shape
    (UnitResults(2 good), (2, 3))
    """
    options = Options(
        columns=columns,
        unit=unit,
        scale=scale,
        axes=axes,
        unit_column=unit_column,
        recording_column=recording_column,
        batch_column=batch_column,
        target_deg=target_deg,
        dip_deg=dip_deg,
    )
    if isinstance(table, Mapping):
        jobs = [_unit_job(str(name), source, options) for name, source in table.items()]
        refused = UnitResults.of([row for row in jobs if isinstance(row, UnitResult)])
        return UnitResults.join([refused, fit_jobs([job for job in jobs if isinstance(job, Job)], options)]).sorted()
    keyed, length = _open_in_memory(table, options)
    whole = Partition((FileSlice(StoredFile("table", "", 0), (0,), length),))
    rows = RowFilter(whole)
    fits = _fit_set(read_recordings(keyed, whole.slices[0], rows), options)
    nameless = UnitResults.of(_nameless(whole, rows.nameless, Unreadable(whole, options)))
    return _add_batches(UnitResults.join([fits, nameless]), rows.names.batches).sorted()


def _unit_job(name: str, source: Any, options: Options) -> Job | UnitResult:  # noqa: ANN401
    """Recording of one unit of a mapping, ready to be fitted, or the row with its error."""
    try:
        unit = None if options.unit is None else Unit.of(options.unit, options.scale)
        source, _ = recording_of(source, unit, Axes.of(options.axes))
    except FlindersError as error:
        return UnitResult(unit=name).with_error(error)
    return Job(name, "", source, 0)


def _open_in_memory(table: Any, options: Options) -> tuple[KeyedTable | KeyedFrame, int]:  # noqa: ANN401
    """A table in memory with recognised columns, and its number of rows; raises `UsageError` if it is no table.

    Without pyarrow only frames of pandas or polars can be read; any other table raises `MissingExtra`.
    """
    if not is_frame(table):
        raise UsageError(
            f"{type(table).__name__} is no table: give units by name as a dict, or a table of pyarrow, pandas or "
            "polars with a column of units"
        )
    try:
        arrow = needs_arrow()
    except MissingExtra:
        if not hands_out_columns(table):
            raise
        frame = KeyedFrame.of(table, options)
        return frame, frame.rows
    file = table_in_memory("the table", "Arrow", table if isinstance(table, arrow.Table) else arrow.table(table))
    KeyColumns.of(file.name, file.schema.names, options)  # refuses options that name a missing column
    return KeyedTable.of(file, options), file.groups[0]


# -------------------------------------------------------------------------------------------------------------- fits


def fit_jobs(jobs: Sequence[Job], options: Options) -> UnitResults:
    """Fit recordings together, with the same numbers as `flinders.fit` for each."""
    if not jobs:
        return UnitResults.of(())
    sources = [job.source if isinstance(job.source, Samples) else CountedRecording(job.source) for job in jobs]
    try:
        columns = fit_batch(cast("list[Samples]", sources), target_deg=options.target_deg, dip_deg=options.dip_deg)
    except Exception as error:  # noqa: BLE001 - one recording must not cost the others
        return _fit_one_by_one(jobs, options, error)
    readings = [job.readings or len(source) for job, source in zip(jobs, sources, strict=True)]
    spans = [np.add(job.start_s, source.span) for job, source in zip(jobs, sources, strict=True)]
    return _rows(columns, [job.pair for job in jobs], np.array(readings, dtype=np.int64), np.array(spans))


def _fit_one_by_one(jobs: Sequence[Job], options: Options, error: Exception) -> UnitResults:
    """Fit recordings one by one, after one of them has ended the joint fit with an error."""
    if len(jobs) > 1:
        return UnitResults.join(fit_jobs([job], options) for job in jobs)
    row = UnitResult(unit=jobs[0].unit, recording=jobs[0].recording, readings=jobs[0].readings)
    return UnitResults.of([replace(row, unit_of_field=jobs[0].source.unit.inside).with_error(error)])


def _fit_set(recordings: RecordingSet, options: Options) -> UnitResults:
    """Fit a set of recordings in common columns."""
    try:
        columns = fit_batch(recordings.lined, target_deg=options.target_deg, dip_deg=options.dip_deg)
    except Exception:  # noqa: BLE001 - one recording must not cost the others
        return fit_jobs(list(recordings.jobs()), options)
    return _rows(columns, recordings.pairs, recordings.rows, recordings.spans)


def _rows(columns: FitColumns, pairs: Sequence[Pair], readings: NDArray[np.int64], spans: Floats) -> UnitResults:
    """Rows of fits with unit and recording, (R,) numbers of readings, and (R, 2) first and last times in s."""
    own = {
        "message": objects([message and one_line(message) for message in columns.message.tolist()]),
        "readings": readings,
    }
    filled = {each.name: getattr(columns, each.name) for each in fields(FitColumns)}
    return UnitResults(
        unit=objects([unit for unit, _ in pairs]),
        recording=objects([recording for _, recording in pairs]),
        start_s=spans[:, 0],
        end_s=spans[:, 1],
        batch=objects([""] * len(pairs)),
        **filled | own,
    )


def _failure_row(part: FileSlice, error: Exception) -> UnitResult:
    """Row about a file that cannot be read."""
    name = part.file.name
    if part.groups:
        return UnitResult(unit=f"({name})", readings=part.rows).with_error(error)
    if part.is_table:
        return UnreadableGroups(part, "", (), 0, 0, error).row
    unit, recording = key_of(name)
    return UnitResult(unit=unit, recording=recording).with_error(error)


def _add_batches(rows: UnitResults, batches: Mapping[Pair, str]) -> UnitResults:
    """Rows with the hardware batches of their units."""
    if not batches:
        return rows
    pairs = zip(rows.unit.tolist(), rows.recording.tolist(), strict=True)
    return replace(rows, batch=objects([batches.get(pair, "") for pair in pairs]))


# -------------------------------------------------------------------------------------------------------------- logs


def _fit_logs(partition: Partition, options: Options) -> UnitResults:
    """Calibrate the log files of a partition."""
    with contextlib.ExitStack() as copies:
        jobs = [(part, each) for part in partition.slices for each in _log(part, options, copies)]
        failed = UnitResults.of([each for _, each in jobs if isinstance(each, UnitResult)])
        rows = UnitResults.join([failed, fit_jobs([each for _, each in jobs if isinstance(each, Job)], options)])
    pairs = {(each.unit, each.recording): batch_in(part.file.name, options) for part, each in jobs}
    return _add_batches(rows, {pair: batch for pair, batch in pairs.items() if batch})


def _log(part: FileSlice, options: Options, copies: contextlib.ExitStack) -> Sequence[Job | UnitResult]:
    """Jobs for the magnetometers of a log file; a copy of an object stays until the fits are done."""
    unit, recording = key_of(part.file.name)
    if not unit and not part.is_table:
        return [_failure_row(part, NoUnit(part.file.name))]
    if part.error is not None:
        return [_failure_row(part, part.error)]
    try:
        log = open_log(
            copies.enter_context(storage.fetch(part.file)),
            columns=options.columns,
            unit=options.unit,
            scale=options.scale,
            axes=options.axes,
            as_logged=options.as_logged,
        )
        begun = 0.0 if log.begun is None else log.begun.timestamp()
        return [Job(name, recording, _first_block(each), 0, begun) for name, each in _instruments(log, unit, options)]
    except OutputError:  # no space for a copy, which is no fault of the file
        raise
    except Exception as error:  # noqa: BLE001 - one file must not cost the others
        return [_failure_row(part, error)]


def _instruments(log: Log, unit: str, options: Options) -> list[tuple[str, Instrument]]:
    """Magnetometers that the options select, by default all, with their units; the first has the unit of the log."""
    if options.sensor is not None and not (log.is_table and len(log.instruments) == 1):
        return [(unit, log.sensor(options.sensor))]
    first, *others = log.instruments
    return [(unit, first), *((f"{unit} {other.name}", other) for other in others)]


def _first_block(source: Recording) -> Recording:
    """The only block of a recording, or the recording itself if it has several."""
    blocks = source.blocks()
    first = next(blocks, None)
    return source if first is None or next(blocks, None) is not None else first


# ------------------------------------------------------------------------------------------------------------ tables


def _fit_tables(partition: Partition, options: Options) -> UnitResults:
    """Calibrate the tables of a partition; a partition of more than `MAX_ROWS` rows is read several times."""
    unreadable = Unreadable(partition, options)
    if partition.rows <= MAX_ROWS:
        return _fit_in_memory(partition, options, unreadable)
    names = Interner()
    counts_of_slices = [(part, _counts(part, options, unreadable, names)) for part in partition.slices]
    counts: Counter[Pair] = sum((own for _, own in counts_of_slices), Counter())
    wanted = {pair: rows for pair, rows in sorted(counts.items()) if partition.takes(pair[0])}
    nameless = sum(rows for (unit, _), rows in wanted.items() if not unit)
    short = {pair: rows for pair, rows in wanted.items() if pair[0] and rows <= MAX_ROWS}
    fits = [_fit_in_memory(partition, options, unreadable, selected) for selected in _sets_in_memory(short)]
    rows = []
    for pair, count in wanted.items():
        if pair[0] and pair not in short:
            slices = tuple(part for part, own in counts_of_slices if own[pair])
            rows.append(_fit_long(replace(partition, slices=slices), pair, count, options, unreadable))
    others = unreadable.recordings(wanted) - wanted.keys()
    rows += unreadable.rows({pair: 0 for pair in others if partition.takes(pair[0])})
    rows += _nameless(partition, nameless, unreadable)
    return _add_batches(UnitResults.join([*fits, UnitResults.of(rows)]), unreadable.batches(names.batches))


def _counts(part: FileSlice, options: Options, unreadable: Unreadable, names: Interner) -> Counter[Pair]:
    """Number of rows of each recording in a slice, as far as its key columns can be read."""

    def count(file: TableFile, groups: Sequence[int]) -> Counter[Pair]:
        keys = KeyColumns.of_schema(file.name, file.schema, options) or KeyColumns()
        return counts_of(file, keys, groups, names)

    return (_read_readable(part, options, unreadable, count) or Counter()) + unreadable.counts_in(part)


def _nameless(partition: Partition, rows: int, unreadable: Unreadable) -> list[UnitResult]:
    """Rows about readings without a unit, and about readings whose unit cannot be read, which are reported once."""
    report = unreadable.unknown_rows() if partition.only is None else []
    if rows:
        names = [part.file.name for part in partition.slices]
        where = ", ".join(names[:3]) + f" and {len(names) - 3} more" * (len(names) > 3)
        report.append(UnitResult(unit="", readings=rows).with_error(NoUnit(where, rows)))
    return report


def _sets_in_memory(counts: dict[Pair, int]) -> list[set[Pair]]:
    """Split recordings into sets that fit into memory.

    >>> [len(pairs) for pairs in _sets_in_memory({("A", ""): 600_000, ("B", ""): 300_000, ("C", ""): 300_000})]
    [2, 1]
    """
    sets: list[set[Pair]] = []
    room = 0
    for pair, rows in counts.items():
        if rows > room:
            sets.append(set())
            room = MAX_ROWS
        sets[-1].add(pair)
        room -= rows
    return sets


def _fit_in_memory(
    partition: Partition, options: Options, unreadable: Unreadable, selected: Container[Pair] | None = None
) -> UnitResults:
    """Read a partition, or its `selected` recordings, into memory, and fit them."""
    filtered = RowFilter(partition, selected)
    sets = [each for part in partition.slices for each in _read(part, options, filtered, unreadable)]
    occurrences = Counter(pair for each in sets for pair in each.pairs)
    failed = {pair for pair in unreadable.recordings(occurrences) if filtered.takes(pair)}
    whole: list[RecordingSet] = []
    parts: dict[Pair, list[Job]] = defaultdict(list)
    for each in sets:
        if all(occurrences[pair] == 1 and pair not in failed for pair in each.pairs):
            whole.append(each)
        else:
            for job in each.jobs():
                parts[job.pair].append(job)
    rows = unreadable.rows({pair: sum(job.readings for job in parts.pop(pair, ())) for pair in sorted(failed)})
    jobs = [merged_recording(own) for _, own in sorted(parts.items())]
    rows += [job for job in jobs if isinstance(job, UnitResult)]
    if selected is None:
        nameless = filtered.nameless + (unreadable.nameless_count if filtered.takes(("", "")) else 0)
        rows += _nameless(partition, nameless, unreadable)
    rest = fit_jobs([job for job in jobs if isinstance(job, Job)], options)
    del sets
    fits = UnitResults.join(
        [UnitResults.of(rows), rest, *(_fit_set(each, options) for each in RecordingSet.join(whole))]
    )
    return _add_batches(fits, unreadable.batches(filtered.names.batches))


def _read(part: FileSlice, options: Options, filtered: RowFilter, unreadable: Unreadable) -> list[RecordingSet]:
    """Read the recordings of a slice, without the row groups that cannot be read."""

    def read(file: TableFile, groups: Sequence[int]) -> RecordingSet:
        return read_recordings(KeyedTable.of(file, options), replace(part, groups=tuple(groups)), filtered)

    recordings = _read_readable(part, options, unreadable, read)
    return [] if recordings is None else [recordings]


def _read_readable(
    part: FileSlice, options: Options, unreadable: Unreadable, read: Callable[[TableFile, Sequence[int]], Value]
) -> Value | None:
    """Read the groups of a slice, or if that fails its readable groups; None if there are none."""
    for is_whole in (True, False):
        groups = part.groups if is_whole else unreadable.readable_groups(part)
        if not groups:
            break
        try:
            with open_as_planned(part, options) as file:
                return read(file, groups)
        except Exception as error:  # noqa: BLE001 - one file must not cost the others
            if not is_whole:
                unreadable.give_up(part, error)
    return None


def _fit_long(partition: Partition, pair: Pair, rows: int, options: Options, unreadable: Unreadable) -> UnitResult:
    """Fit a recording of more rows than fit into memory, reading its files on each pass."""
    row = _fit_streamed(partition, pair, rows, options)
    if row.verdict != VERDICTS[-1]:
        return row
    readable = tuple(
        replace(part, groups=groups) for part in partition.slices if (groups := unreadable.readable_groups(part))
    )
    if pair in unreadable.recordings([pair]):
        lost = sum(each.counts[pair] for each in unreadable.all)
        return unreadable.rows({pair: rows - lost})[0]
    if readable == partition.slices:
        return row
    return _fit_streamed(replace(partition, slices=readable), pair, rows, options)


def _fit_streamed(partition: Partition, pair: Pair, rows: int, options: Options) -> UnitResult:
    """Fit a recording from its files; if they cannot be read, the row has the reason."""
    try:
        source = StreamedRecording.of(partition, pair, options)
    except Exception as error:  # noqa: BLE001 - as in `_row`
        return UnitResult(unit=pair[0], recording=pair[1], readings=rows).with_error(error)
    return fit_jobs([Job(*pair, source, rows, source.start_s)], options).row(0)
