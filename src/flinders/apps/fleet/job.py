r"""A fleet run: plan partitions, calibrate them, commit each as it is done, and merge them into one table.

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
from typing import TYPE_CHECKING, Any

from flinders.apps.fleet import worker
from flinders.apps.fleet.checkpoint import TABLE, Checkpoint
from flinders.apps.fleet.dataset import PARQUET
from flinders.apps.fleet.event_log import log_event
from flinders.apps.fleet.merging import merge, table_counts
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.progress import Progress
from flinders.apps.fleet.results import UnitResults, needs_arrow
from flinders.apps.fleet.scheduler import Abandoned, map_units, reach
from flinders.apps.fleet.storage import is_remote, put, refuse_object
from flinders.core.files import refuse_existing
from flinders.errors import UsageError
from flinders.findings.row import OF_A_TUMBLE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.apps.fleet.progress import ProgressCallback
    from flinders.apps.fleet.scheduler import WorkerDeath

    Map = Callable[..., Iterator[tuple[int, bytes | Abandoned]]]


def run(
    where: str,
    out: str | os.PathLike[str],
    options: Options,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    force: bool = False,
    watch: ProgressCallback | None = None,
    notice: Callable[[str], None] = lambda _: None,
) -> RunSummary:
    """Calibrate a fleet.

    Raises `UnreadableInput` if there is nothing to read; `UsageError` for options that cannot be used, before anything
    is done; if an earlier run has left partitions, or those of another plan; `OutputError` if results cannot be
    written; partitions that are done stay done; `LinkError` if the scheduler is not there.

    Parameters
    ----------
    where : str
        A folder, a pattern, a file or a URL, as for `flinders.apps.fleet.storage.listed`.
    out : str or path
        The Parquet file to write, or the URL of an object.
    workers, scheduler
        As for `flinders.apps.fleet.scheduler.map_units`.
    resume : bool
        Continue an earlier run that did not finish.
    force : bool
        Overwrite `out`, and what an earlier run has left.
    watch : callable, optional
        A `ProgressCallback`.
    notice : callable, optional
        Called with the reason why the work does not go on, and with what is done of a run that is interrupted.
    """
    begun = time.monotonic()
    progress = Progress(watch, notice)
    with progress.ending(), contextlib.ExitStack() as ending:
        plan = _planned(where, out, options, scheduler, force=force)
        checkpoint = Checkpoint.of(out, plan, resume=resume, force=force)
        ending.callback(checkpoint.close)
        files = checkpoint.finished()
        resumed = len(files)
        progress.planned(plan, checkpoint, set(files), input=where, output=os.fspath(out))
        do = partial(worker.calibrate_partition, options=options)
        over = partial(_map, progress=progress, workers=workers, scheduler=scheduler)
        missing = [place for place in range(len(plan.partitions)) if place not in files]
        for place, content, was_lost in _results(plan, missing, do, over):
            files[place] = checkpoint.commit(place, content)
            progress.committed(place, plan.partitions[place], content, was_lost=was_lost)
        counts = _write_table([files[place] for place in range(len(plan.partitions))], checkpoint, out)
        checkpoint.remove()
    summary = RunSummary(
        output=os.fspath(out),
        files=plan.files,
        partitions=len(plan.partitions),
        **counts,
        other_files=plan.other_files,
        resumed=resumed,
        workers_lost=progress.workers_lost,
        retried=len(progress.retried),
        seconds=time.monotonic() - begun,
    )
    log_event("done", **summary.logged, unread=progress.unread)
    return summary


def _planned(where: str, out: str | os.PathLike[str], options: Options, scheduler: str | None, *, force: bool) -> Plan:
    """Plan partitions, after everything that can be refused before a recording is opened."""
    needs_arrow()
    options.check()
    refuse_output(out, force=force)
    if scheduler is not None:
        reach(scheduler)
    return plan_of(where, options)


def refuse_output(out: str | os.PathLike[str], *, force: bool) -> None:
    """Refuse a table that could not be written, or is not named as Parquet: raises UsageError or OutputError."""
    name = os.fspath(out)
    if is_remote(name):
        refuse_object(name, force=force)
    else:
        refuse_existing(out, force=force)
    if not name.lower().endswith(PARQUET):
        raise UsageError(f"{name}: the table is Parquet: give it a name that ends in {PARQUET[0]}")


def _write_table(files: Sequence[Path], checkpoint: Checkpoint, out: str | os.PathLike[str]) -> dict[str, Any]:
    """Merge partitions into the table, copy it to its store if it has one, and count its rows."""
    if not is_remote(os.fspath(out)):
        merge(files, out)
        return table_counts(out)
    table = checkpoint.folder / TABLE
    merge(files, table)
    put(table, os.fspath(out))
    return table_counts(table)


def _map(
    do: Callable[[Partition], bytes],
    partitions: Sequence[Partition],
    *,
    progress: Progress,
    workers: int | None,
    scheduler: str | None,
    whole: Partition | None = None,
) -> Iterator[tuple[int, bytes | Abandoned]]:
    """Calibrate partitions, or the parts of a `whole` one, and log workers that die."""

    def died(death: WorkerDeath) -> None:
        progress.died(death, None if death.place is None else partitions[death.place], whole)

    return map_units(do, partitions, workers=workers, scheduler=scheduler, notice=progress.waits, died=died)


def _results(
    plan: Plan, missing: Sequence[int], do: Callable[[Partition], bytes], over: Map
) -> Iterator[tuple[int, bytes, bool]]:
    """Yield missing partitions with their rows, and whether their workers died; those last, file by file."""
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
    """Rows of a partition that no worker survived: only those of the file to blame are lost."""
    parts = partition.split()
    rows = [] if parts else [UnitResults.of(worker.lost(partition, attempts))]
    for place, result in over(do, parts, whole=partition):
        if isinstance(result, Abandoned):
            rows.append(UnitResults.of(worker.lost(parts[place], result.attempts)))
        else:
            rows.append(UnitResults.from_bytes(result))
    return UnitResults.joined(rows).sorted().to_bytes()


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Summary of a fleet run: rows written, units refused, files left out, duration."""

    output: str  # the table that was written
    files: int  # that were read
    partitions: int  # parts that the run was cut into
    units: int  # sensors or vehicles
    rows: int  # recordings, which are the rows of the table
    readings: int  # of all recordings
    failed_readings: int  # readings of recordings that failed; an unreadable one has as many as its footer says
    verdicts: dict[str, int]  # rows by verdict
    codes: dict[str, int]  # rows by error code
    findings: dict[str, int]  # rows that have each
    units_of_field: dict[str, int]  # rows by unit of field
    # ``median``, ``p95`` and ``largest`` of the worst heading error of rows that are good or limited
    worst_deg: dict[str, float]
    rejected: list[dict[str, str]]  # unit, recording, code and finding of the first rows that are refused or failed
    other_files: dict[str, int]  # files that are no recordings, by their suffix, or by what Flinders wrote them as
    resumed: int  # partitions that an earlier run had done
    workers_lost: int  # workers that died, or left the cluster
    # partitions that were run again because their worker died; a cluster reports only those that it gave up
    retried: int
    seconds: float  # duration of the run

    @property
    def is_whole(self) -> bool:
        """Whether every recording has a calibration."""
        return not self.codes

    @property
    def logged(self) -> dict[str, Any]:
        """Fields of the last event of a run."""
        names = ("output", "units", "rows", "readings", "verdicts", "codes", "workers_lost", "retried")
        return {name: getattr(self, name) for name in names} | {"seconds": round(self.seconds, 3)}

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        # what verdicts rest on that are no refusals
        fields["conditions"] = list(OF_A_TUMBLE) if self.verdicts.get("good") or self.verdicts.get("limited") else []
        # units calibrated in a second
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields
