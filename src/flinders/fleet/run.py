r"""A whole run: planned, worked on partition by partition, each committed as it is done, and put together at the end.

Beside the table that is asked for, ``calibrations.parquet``, a folder ``calibrations.parquet.parts`` holds what is
done: a file for each partition, which appears under its name when it is complete, and the plan that they belong to.
Whoever starts again with `resume` does what is missing; the table is the same to the last byte, also for another number
of workers. The folder goes when the table is there. Of a table that goes to a store it lies in the working directory.

The table is on the disk before it has its name; for parts nobody waits. What a program that was killed has left is
whole. Of what a machine has left that lost its power parts may be missing, cut short or empty: the name of each tells
its length and check sum, and one that has not got them is done again.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.tables import Asked
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n")
>>> told = run(str(folder), folder / "calibrations.parquet", Asked(), workers=0)
>>> told.rows, told.verdicts, told.codes
(1, {'refused': 1}, {'too-few-samples': 1})
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import TYPE_CHECKING

from flinders.core.axes import Axes
from flinders.core.files import refuse_existing
from flinders.core.units import COUNTS, Unit
from flinders.errors import UsageError
from flinders.fleet import work
from flinders.fleet.counts import Counts
from flinders.fleet.engine import Lost, map_units, reach
from flinders.fleet.journal import Journal
from flinders.fleet.log import Log
from flinders.fleet.merge import merge
from flinders.fleet.parts import TABLE, Parts
from flinders.fleet.plan import plan_of
from flinders.fleet.store import is_remote, put, refuse_object
from flinders.fleet.table import Rows, needs_arrow
from flinders.fleet.tables import PARQUET
from flinders.fleet.told import told_of
from flinders.readers._columns import asked_columns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from flinders.fleet.engine import Death
    from flinders.fleet.journal import Watch
    from flinders.fleet.plan import Partition, Plan
    from flinders.fleet.tables import Asked
    from flinders.fleet.told import Told

    Engine = Callable[..., Iterator[tuple[int, bytes | Lost]]]


def run(
    where: str,
    out: str | os.PathLike[str],
    asked: Asked,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    force: bool = False,
    log: Log | None = None,
    watch: Watch | None = None,
    notice: Callable[[str], None] = lambda _: None,
) -> Told:
    """Calibrate a fleet.

    Parameters
    ----------
    where : str
        A folder, a pattern, a file or a URL, as `flinders.fleet.store.listed`.
    out : str or path
        The Parquet file to write, or the URL of an object; parts of that are kept in the working directory.
    asked : Asked
        How recordings are read, and what fits are held against.
    workers, scheduler
        As `flinders.fleet.engine.map_units`.
    resume : bool
        Go on with what an earlier run, which did not come to its end, has left.
    force : bool
        Write over `out`, and over what an earlier run has left.
    log : Log, optional
    watch : callable, optional
        As `flinders.fleet.journal.Watch`.
    notice : callable, optional
        Called with what keeps the work from going on, and with what is kept of a run that is interrupted.

    Raises
    ------
    UnreadableInput
        Where there is nothing to read.
    UsageError
        For options that cannot be used, before anything else is done; where what an earlier run has left is in the
        way, or is of another run.
    OutputError
        Where results cannot be written; what is done by then stays done.
    LinkError
        For a scheduler that is not there.
    """
    begun = time.monotonic()
    journal = Journal(log or Log(), watch, notice)
    with journal.ending():
        needs_arrow()
        refuse_options(asked)
        refuse_output(out, force=force)
        if scheduler is not None:
            reach(scheduler)
        plan = plan_of(where, asked)
        parts = Parts.of(out, plan, resume=resume, force=force)
        kept = parts.kept()
        resumed = len(kept)
        journal.planned(plan, parts, set(kept), input=where, output=os.fspath(out), polish=asked.polish)
        over = partial(_over, journal=journal, workers=workers, scheduler=scheduler)
        missing = [place for place in range(len(plan.partitions)) if place not in kept]
        for place, content, was_lost in _results(plan, missing, partial(work.done, asked=asked), over):
            kept[place] = parts.commit(place, content)
            journal.committed(place, plan.partitions[place], content, was_lost=was_lost)
        counted = _put_together([kept[place] for place in range(len(plan.partitions))], parts, out)
    parts.remove()
    told = told_of(
        out,
        counted,
        plan,
        asked,
        resumed=resumed,
        workers_lost=journal.workers_lost,
        retried=len(journal.again),
        seconds=time.monotonic() - begun,
    )
    journal.done(told)
    return told


def refuse_options(asked: Asked) -> None:
    """Find what no recording can be read with, before any is.

    Raises
    ------
    UsageError
    """
    Unit.of(COUNTS if asked.unit is None else asked.unit, asked.scale)
    Axes.of(asked.axes)
    if asked.columns is not None:
        asked_columns(asked.columns)


def refuse_output(out: str | os.PathLike[str], *, force: bool) -> None:
    """Find out what could not be written in the end, and what is no name for the table.

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


def _put_together(files: Sequence[Path], parts: Parts, out: str | os.PathLike[str]) -> Counts:
    """Write the table, take it to its store, and count what is in it."""
    if not is_remote(os.fspath(out)):
        merge(files, out)
        return Counts.of(out)
    table = parts.folder / TABLE
    merge(files, table)
    put(table, os.fspath(out))
    return Counts.of(table)


def _over(
    do: Callable[[Partition], bytes],
    partitions: Sequence[Partition],
    *,
    journal: Journal,
    workers: int | None,
    scheduler: str | None,
    whole: Partition | None = None,
) -> Iterator[tuple[int, bytes | Lost]]:
    """Work on partitions, or on the parts of a `whole` one, and take note of workers that die."""

    def died(death: Death) -> None:
        journal.died(death, None if death.place is None else partitions[death.place], whole)

    return map_units(do, partitions, workers=workers, scheduler=scheduler, notice=journal.waits, died=died)


def _results(
    plan: Plan, missing: Sequence[int], do: Callable[[Partition], bytes], over: Engine
) -> Iterator[tuple[int, bytes, bool]]:
    """Each missing partition with its rows, and whether its workers died: such a one is taken apart at the end."""
    partitions = [plan.partitions[place] for place in missing]
    lost = []
    for place, result in over(do, partitions):
        if isinstance(result, Lost):
            lost.append((missing[place], result))
        else:
            yield missing[place], result, False
    for place, loss in sorted(lost, key=lambda each: each[0]):
        yield place, _apart(plan.partitions[place], loss, do, over), True


def _apart(partition: Partition, loss: Lost, do: Callable[[Partition], bytes], over: Engine) -> bytes:
    """The rows of a partition that cost its workers, file by file: only those of the guilty file are lost."""
    smaller = partition.split()
    rows = [] if smaller else [Rows.of(work.lost(partition, loss.attempts))]
    for place, result in over(do, smaller, whole=partition):
        own = work.lost(smaller[place], result.attempts) if isinstance(result, Lost) else None
        rows.append(Rows.of(own) if own is not None else Rows.from_bytes(result))  # type: ignore[arg-type]
    return Rows.joined(rows).sorted().to_bytes()
