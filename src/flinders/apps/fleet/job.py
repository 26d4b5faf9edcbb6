r"""A fleet run: plan partitions, calibrate each and write its file, and merge the files into one table.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.apps.fleet.options import Options
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n")
>>> summary = run(str(folder), folder / "calibrations.parquet", Options(), workers=0)
>>> summary.rows, summary.verdicts, summary.codes
(1, {'refused': 1}, {'too-few-samples': 1})
"""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flinders.apps.fleet import worker
from flinders.apps.fleet.alerts import Alert, alerts_of, file_alerts
from flinders.apps.fleet.checkpoint import TABLE, Checkpoint, files_begun
from flinders.apps.fleet.growth import ChangedFile, ReadFiles, VanishedFile, fault_rows
from flinders.apps.fleet.merging import TableRows, merge, table_counts
from flinders.apps.fleet.not_good import NotGood, first_of, not_good
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.progress import Progress, log_event
from flinders.apps.fleet.results import UnitResults, needs_arrow
from flinders.apps.fleet.scheduler import Abandoned, begin_processes, map_units, reach
from flinders.apps.fleet.storage import StoredFile, exists, fetch, is_remote, put, refuse_object
from flinders.apps.fleet.tables import is_csv, record_table, refuse_ending, write_csv
from flinders.core.files import refuse_existing
from flinders.errors import OutputError, UsageError
from flinders.findings.row import TUMBLE_ASSUMPTIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.apps.fleet.progress import ProgressCallback
    from flinders.apps.fleet.properties import Properties
    from flinders.apps.fleet.scheduler import WorkerDeath

    Map = Callable[..., Iterator[tuple[int, bytes | Abandoned]]]


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files that a run writes."""

    table: str  # Parquet or CSV, or the URL of an object
    bad: str | None = None  # table of the recordings that are not good
    alerts: str | None = None  # table of units and files that crossed a limit since the last run

    def check(self, *, append: bool, force: bool) -> None:
        """Refuse outputs that cannot be written: raises UsageError or OutputError."""
        if is_remote(self.table):
            refuse_object(self.table, force=force or append)
        refuse_ending(self.table, "the table")
        if append and is_csv(self.table):
            raise UsageError(f"{self.table}: a CSV table has no list of its input files: extend a Parquet table")
        if self.alerts is not None and not append:
            raise UsageError(
                "alerts compare with the last run: extend an existing table",
                hint={"append": True},
            )
        if not is_remote(self.table):
            refuse_existing(self.table, force=force or append)
        for path, what in ((self.bad, "the table of units that are not good"), (self.alerts, "the table of alerts")):
            if path is not None:
                refuse_ending(path, what)
                refuse_existing(path, force=force or append)


def run(
    where: str,
    out: str | os.PathLike[str] | Outputs,
    options: Options,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    append: bool = False,
    force: bool = False,
    properties: Properties | None = None,
    watch: ProgressCallback | None = None,
    notice: Callable[[str], None] = lambda _: None,
) -> RunSummary:
    """Calibrate a fleet.

    Raises `UnreadableInput` if there is nothing to read; `UsageError`, before anything is calibrated, for options that
    cannot be used and for partitions of an earlier run that `append` cannot continue; `OutputError` if results cannot
    be written (finished partitions are kept); `LinkError` if the scheduler cannot be reached.

    Parameters
    ----------
    where : str
        A folder, a pattern, a file or a URL, as for `flinders.apps.fleet.storage.list_files`.
    out : str, path or Outputs
        The Parquet or CSV file to write, or the URL of an object.
    workers, scheduler
        As for `flinders.apps.fleet.scheduler.map_units`.
    append : bool
        Continue an earlier run that did not finish, and add the rows of new files to an existing table.
    force : bool
        Overwrite `out`, and remove the partitions of an earlier run.
    properties : Properties, optional
        Properties of units, added to the table as columns.
    watch : callable, optional
        A `ProgressCallback`.
    notice : callable, optional
        Called with a line of text: the reason why the run waits, or the progress of a run that is interrupted.
    """
    begun = time.monotonic()
    outputs = out if isinstance(out, Outputs) else Outputs(os.fspath(out))
    progress = Progress(watch, notice)
    with progress.log_ending(), contextlib.ExitStack() as ending:
        _prepare(outputs, options, scheduler, append=append, force=force)
        found = _stamp(outputs.table)
        if scheduler is None and workers != 0:
            begin_processes()
        earlier = ending.enter_context(_open_earlier(outputs.table, options)) if append else None
        plan = _make_plan(where, outputs, options, earlier, append=append)
        checkpoint = Checkpoint.of(outputs.table, plan, append=append, force=force)
        ending.callback(checkpoint.close)
        if not force and _stamp(outputs.table) != found:
            raise OutputError(f"{outputs.table}: another run has written this table since this run began: run it again")
        if earlier is not None:
            earlier.rows.read_ahead()
        files = checkpoint.finished_files()
        resumed = len(files)
        progress.log_plan(plan, checkpoint, set(files), input=where, output=outputs.table)
        over = partial(_map, progress=progress, workers=workers, scheduler=scheduler)
        parts = _calibrate(plan, files, checkpoint, options, over, progress)
        alerts = _alerts(earlier, parts, plan, options) if earlier else []
        with record_table(outputs.alerts, Alert, force=True) as each:
            if each is not None:
                each(alerts)
        counts = _write_table(earlier, parts, plan, checkpoint, outputs, properties)
        checkpoint.remove()
    summary = RunSummary(
        output=outputs.table,
        files=plan.files,
        files_changed=sum(isinstance(error, ChangedFile) for error in plan.faults.values()),
        files_vanished=sum(isinstance(error, VanishedFile) for error in plan.faults.values()),
        files_later=plan.later,
        is_extended=earlier is not None,
        partitions=len(plan.partitions),
        **counts,
        alerts=tuple(alerts),
        other_files=plan.other_files,
        resumed=resumed,
        workers_lost=progress.workers_lost,
        retried=len(progress.retried),
        seconds=time.monotonic() - begun,
    )
    log_event("done", **summary.log_fields, unread=progress.unread)
    return summary


def _prepare(outputs: Outputs, options: Options, scheduler: str | None, *, append: bool, force: bool) -> None:
    """Check options, outputs and scheduler before a recording is opened."""
    needs_arrow()
    options.check()
    if append and force:
        raise UsageError(
            "a table is either extended or begun again: leave one of them out", hint={"append": True, "force": True}
        )
    outputs.check(append=append, force=force)
    if scheduler is not None:
        reach(scheduler)


def _stamp(table: str) -> tuple[int, int, int] | None:
    """Inode, size in bytes and time of change of a table, to detect a replaced table; None without a file."""
    try:
        status = None if is_remote(table) else os.stat(table)  # noqa: PTH116 - a text, which may be a URL
    except OSError:
        return None
    return status and (status.st_ino, status.st_size, status.st_mtime_ns)


@dataclass(frozen=True, slots=True)
class _Earlier:
    """The table to extend: its rows, and the files that it was made from."""

    rows: TableRows
    read: ReadFiles


@contextlib.contextmanager
def _open_earlier(table: str, options: Options) -> Iterator[_Earlier | None]:
    """Open the table to extend; None if it does not exist."""
    if not exists(table):
        yield None
        return
    with fetch(StoredFile(table, table, 0)) as path:
        read = ReadFiles.of_table(path)
        read.refuse_other_options(options, table)
        yield _Earlier(TableRows(path), read)


def _make_plan(where: str, outputs: Outputs, options: Options, earlier: _Earlier | None, *, append: bool) -> Plan:
    """Plan partitions of all files, or of new ones if a table is extended."""
    begun = files_begun(outputs.table) if append else ()
    return plan_of(where, options, earlier=earlier.read if earlier else None, begun=begun)


def _alerts(earlier: _Earlier, parts: Sequence[Path], plan: Plan, options: Options) -> list[Alert]:
    """Alerts about new rows, compared with earlier rows of their units, and about changed or vanished files."""
    new = UnitResults.join(UnitResults.from_bytes(path.read_bytes()) for path in parts)
    known_units = set(earlier.rows.units())
    told = [
        place
        for place, (unit, verdict) in enumerate(zip(new.unit.tolist(), new.verdict.tolist(), strict=True))
        if verdict != "good" or unit in known_units
    ]
    rows = [new.row(place) for place in told]
    again = known_units & {row.unit for row in rows}
    known = UnitResults.from_arrow(earlier.rows.of_units(again)) if again else UnitResults.of(())
    before = [known.row(place) for place in range(len(known))]
    said = earlier.rows.file_rows()
    news = [(name, error) for name, error in plan.faults.items() if (f"({name})", error.code) not in said]
    return [*alerts_of(rows, before, target_deg=options.target_deg), *file_alerts(news)]


def _write_table(
    earlier: _Earlier | None,
    parts: Sequence[Path],
    plan: Plan,
    checkpoint: Checkpoint,
    outputs: Outputs,
    properties: Properties | None,
) -> dict[str, Any]:
    """Merge all rows into the table, and write the table of units that are not good; return counts for the summary."""
    about_files = fault_rows(plan.faults).to_bytes()
    sources: list[Path | bytes | TableRows] = [*([earlier.rows] if earlier else []), *parts, about_files]
    is_direct = not is_remote(outputs.table) and not is_csv(outputs.table)
    table = Path(outputs.table) if is_direct else checkpoint.folder / TABLE
    merge(sources, table, properties=properties, files=plan.read)
    counts = table_counts(table)
    with record_table(outputs.bad, NotGood, force=True) as each:
        listed = first_of(_copy_rows(not_good(table), each))
    if is_remote(outputs.table):
        put(table, outputs.table)
    elif is_csv(outputs.table):
        write_csv(table, outputs.table)
    return {**counts, "not_good": listed}


def _copy_rows(
    some: Iterable[list[NotGood]], each: Callable[[Sequence[NotGood]], None] | None
) -> Iterator[list[NotGood]]:
    """Yield the recordings that are not good, after passing them to the writer of their table."""
    for rows in some:
        if each is not None:
            each(rows)
        yield rows


def _map(
    do: Callable[[Partition], bytes],
    partitions: Sequence[Partition],
    *,
    progress: Progress,
    workers: int | None,
    scheduler: str | None,
    whole: Partition | None = None,
) -> Iterator[tuple[int, bytes | Abandoned]]:
    """Calibrate partitions, or the parts of a `whole` partition, in worker processes, and log workers that die."""

    def log_death(death: WorkerDeath) -> None:
        progress.log_death(death, None if death.place is None else partitions[death.place], whole)

    return map_units(do, partitions, workers=workers, scheduler=scheduler, notice=progress.log_wait, died=log_death)


def _calibrate(
    plan: Plan, files: dict[int, Path], checkpoint: Checkpoint, options: Options, over: Map, progress: Progress
) -> list[Path]:
    """Calibrate the partitions that have no file yet; return the files of all partitions, in their order."""
    do = partial(worker.calibrate_partition, options=options)
    missing = [place for place in range(len(plan.partitions)) if place not in files]
    for place, content, was_lost in _results(plan, missing, do, over):
        files[place] = checkpoint.commit(place, content)
        progress.log_partition(place, plan.partitions[place], content, was_lost=was_lost)
    return [files[place] for place in range(len(plan.partitions))]


def _results(
    plan: Plan, missing: Sequence[int], do: Callable[[Partition], bytes], over: Map
) -> Iterator[tuple[int, bytes, bool]]:
    """Yield the number of each missing partition, its rows, and whether its workers died.

    Partitions whose workers died come last, and are calibrated file by file.
    """
    partitions = [plan.partitions[place] for place in missing]
    abandoned = []
    for place, result in over(do, partitions):
        if isinstance(result, Abandoned):
            abandoned.append((missing[place], result.attempts))
        else:
            yield missing[place], result, False
    for place, attempts in sorted(abandoned):
        yield place, _file_by_file(plan.partitions[place], attempts, do, over), True


def _file_by_file(partition: Partition, attempts: int, do: Callable[[Partition], bytes], over: Map) -> bytes:
    """Calibrate a partition whose workers died, file by file, so that only the rows of the fatal file are lost."""
    parts = partition.split()
    rows = [] if parts else [UnitResults.of(worker.lost_rows(partition, attempts))]
    for place, result in over(do, parts, whole=partition):
        if isinstance(result, Abandoned):
            rows.append(UnitResults.of(worker.lost_rows(parts[place], result.attempts)))
        else:
            rows.append(UnitResults.from_bytes(result))
    return UnitResults.join(rows).sorted().to_bytes()


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Summary of a fleet run: rows written, units refused, files left out, duration."""

    output: str  # the table that was written
    files: int  # files that were read in this run
    files_changed: int  # files that have changed since they were fitted
    files_vanished: int  # files that were fitted and are no longer there
    files_later: int  # new files that wait for the next run, since this run completed a stopped one
    is_extended: bool  # whether rows were added to an existing table
    partitions: int  # parts into which the run was split
    units: int  # sensors or vehicles in the table
    rows: int  # recordings, which are the rows of the table
    readings: int  # of all recordings
    failed_readings: int  # readings of recordings that failed; for unreadable ones the number in the footer
    verdicts: dict[str, int]  # rows by verdict
    codes: dict[str, int]  # rows by error code
    findings: dict[str, int]  # rows by finding
    units_of_field: dict[str, int]  # rows by unit of field
    # ``median``, ``p95`` and ``largest`` of the worst heading error of rows that are good or limited
    worst_deg: dict[str, float]
    not_good: tuple[NotGood, ...]  # the first recordings that are not good, refused and failed ones before limited ones
    alerts: tuple[Alert, ...]  # units and files that crossed a limit since the last run; empty for a new table
    other_files: dict[str, int]  # number of files that are no recordings, by suffix, or by kind if Flinders wrote them
    resumed: int  # partitions that an earlier run had finished
    workers_lost: int  # workers that died, or left the cluster
    # partitions that were run again because their worker died; a cluster reports only those that it abandoned
    retried: int
    seconds: float  # duration of the run

    @property
    def is_whole(self) -> bool:
        """Whether every recording has a calibration; for an extended table, whether nothing crossed a limit."""
        return not (self.alerts if self.is_extended else self.codes)

    @property
    def log_fields(self) -> dict[str, Any]:
        """Fields of the last event of a run."""
        names = ("output", "units", "rows", "readings", "verdicts", "codes", "workers_lost", "retried")
        more = {"alerts": len(self.alerts), "seconds": round(self.seconds, 3)}
        return {name: getattr(self, name) for name in names} | more

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        fields |= {name: [row.as_dict() for row in fields[name]] for name in ("not_good", "alerts")}
        # conditions that a good or limited verdict assumes
        fields["conditions"] = (
            list(TUMBLE_ASSUMPTIONS) if self.verdicts.get("good") or self.verdicts.get("limited") else []
        )
        # units calibrated in a second
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields
