r"""A fleet run: plan partitions, calibrate them, commit each as it is done, and merge them into one table.

Beside the table, ``calibrations.parquet``, a folder ``calibrations.parquet.parts`` holds a file for each finished
partition, and the plan that they belong to. A run with `resume` does the missing ones; the table is the same to the
last byte, for any number of workers. The folder is removed when the table is written. If the table goes to a store, the
folder lies in the working directory.

The table is synced to the disk before it gets its name, partitions are not: after a power cut some may be missing, cut
short or empty. Their names hold length and check sum, and a partition that does not match is done again.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.dataset import Options
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n")
>>> summary = run(str(folder), folder / "calibrations.parquet", Options(), workers=0)
>>> summary.rows, summary.verdicts, summary.codes
(1, {'refused': 1}, {'too-few-samples': 1})
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from flinders.core.files import refuse_existing
from flinders.errors import UsageError
from flinders.fleet import worker
from flinders.fleet.checkpoint import TABLE, Checkpoint
from flinders.fleet.dataset import PARQUET
from flinders.fleet.plan import plan_of
from flinders.fleet.progress import Progress, RunSummary, table_counts
from flinders.fleet.results import UnitResults, merge, needs_arrow
from flinders.fleet.scheduler import Abandoned, map_units, reach
from flinders.fleet.storage import is_remote, put, refuse_object

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from flinders.fleet.dataset import Options
    from flinders.fleet.plan import Partition, Plan
    from flinders.fleet.progress import ProgressCallback
    from flinders.fleet.scheduler import WorkerDeath

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

    Parameters
    ----------
    where : str
        A folder, a pattern, a file or a URL, as for `flinders.fleet.storage.listed`.
    out : str or path
        The Parquet file to write, or the URL of an object.
    options : Options
    workers, scheduler
        As for `flinders.fleet.scheduler.map_units`.
    resume : bool
        Continue an earlier run that did not finish.
    force : bool
        Overwrite `out`, and what an earlier run has left.
    watch : callable, optional
        A `flinders.fleet.progress.ProgressCallback`.
    notice : callable, optional
        Called with the reason why the work does not go on, and with what is done of a run that is interrupted.

    Raises
    ------
    UnreadableInput
        If there is nothing to read.
    UsageError
        For options that cannot be used, before anything is done; if an earlier run has left partitions, or those of
        another plan.
    OutputError
        If results cannot be written; partitions that are done stay done.
    LinkError
        If the scheduler is not there.
    """
    begun = time.monotonic()
    progress = Progress(watch, notice)
    with progress.ending():
        needs_arrow()
        options.check()
        refuse_output(out, force=force)
        if scheduler is not None:
            reach(scheduler)
        plan = plan_of(where, options)
        checkpoint = Checkpoint.of(out, plan, resume=resume, force=force)
        files = checkpoint.finished()
        resumed = len(files)
        progress.planned(plan, checkpoint, set(files), input=where, output=os.fspath(out))
        over = partial(_map, progress=progress, workers=workers, scheduler=scheduler)
        missing = [place for place in range(len(plan.partitions)) if place not in files]
        for place, content, was_lost in _results(
            plan, missing, partial(worker.calibrate_partition, options=options), over
        ):
            files[place] = checkpoint.commit(place, content)
            progress.committed(place, plan.partitions[place], content, was_lost=was_lost)
        counts = _write_table([files[place] for place in range(len(plan.partitions))], checkpoint, out)
    checkpoint.remove()
    summary = RunSummary(
        output=os.fspath(out),
        files=plan.files,
        partitions=len(plan.partitions),
        **counts,
        left_out=plan.left_out,
        resumed=resumed,
        workers_lost=progress.workers_lost,
        retried=len(progress.retried),
        seconds=time.monotonic() - begun,
    )
    progress.finished(summary)
    return summary


def refuse_output(out: str | os.PathLike[str], *, force: bool) -> None:
    """Refuse a table that could not be written at the end, or whose name does not end as one of Parquet.

    Raises
    ------
    UsageError, OutputError
    """
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
