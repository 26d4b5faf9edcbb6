r"""A whole run: planned, worked on partition by partition, each committed as it is done, and put together at the end.

Beside the table that is asked for, ``calibrations.parquet``, a folder ``calibrations.parquet.parts`` holds what is
done: a file for each partition, which appears under its name when it is complete, and the plan that they belong to.
Whoever starts again with `resume` does what is missing; the table is the same to the last byte, also for another number
of workers. The folder goes when the table is there. Of a table that goes to a store it lies in the working directory.

The table is on the disk before it has its name; for parts nobody waits. What a program that was killed has left is
whole. Of what a machine has left that lost its power parts may be missing, cut short or empty: the name of each tells
its length and check sum, and one that has not got them is done again.

>>> import tempfile
>>> from pathlib import Path, PurePosixPath
>>> from flinders.fleet.tables import Asked
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n")
>>> told = run(str(folder), folder / "calibrations.parquet", Asked(), workers=0)
>>> told.rows, told.verdicts, told.codes
(1, {'refused': 1}, {'too-few-samples': 1})
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import time
import zlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import OutputError, UsageError
from flinders.files import reason, refuse_existing, write_text
from flinders.fleet import work
from flinders.fleet.counts import Counts
from flinders.fleet.engine import Lost, map_units
from flinders.fleet.log import Log
from flinders.fleet.merge import merge
from flinders.fleet.plan import Partition, Plan, plan_of
from flinders.fleet.store import is_remote, put, refuse_object
from flinders.fleet.table import VERDICTS, Rows, needs_arrow, rows_in

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Callable, Iterator, Sequence

    from flinders.fleet.tables import Asked

    Engine = Callable[[Callable[[Partition], bytes], Sequence[Partition]], Iterator[tuple[int, bytes | Lost]]]

PLAN: Final = "plan.json"
TABLE: Final = "table.parquet"
"""What goes to a store when it is complete."""


@dataclass(frozen=True, slots=True)
class Told:
    """What came of a run, as it stands in the table, and how it went.

    Attributes
    ----------
    output : str
    files, partitions : int
    units, rows, readings : int
        Units, their recordings, which are the rows of the table, and readings.
    verdicts, codes, findings, units_of_field : dict
        How many rows there are of each verdict, error code, finding and unit of field.
    worst_deg : dict
        ``median``, ``p95`` and ``largest`` of the worst heading error of those that are good or limited.
    left_out : dict
        Files of other kinds, by their endings.
    resumed : int
        Partitions that an earlier run had done.
    retried : int
        Partitions that were taken apart because their workers died.
    seconds : float
    """

    output: str
    files: int
    partitions: int
    units: int
    rows: int
    readings: int
    verdicts: dict[str, int]
    codes: dict[str, int]
    findings: dict[str, int]
    units_of_field: dict[str, int]
    worst_deg: dict[str, float]
    left_out: dict[str, int]
    polish: bool
    resumed: int
    retried: int
    seconds: float

    @property
    def is_whole(self) -> bool:
        """Every recording has a calibration."""
        return not self.codes

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        return {**fields, "units_per_s": self.units / self.seconds if self.seconds else None}


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
    watch: Callable[[int, int, int], None] | None = None,
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
        Called with the work done so far, all there is, and the rows so far.
    notice : callable, optional
        Called with what keeps the work from going on.

    Raises
    ------
    UnreadableInput
        Where there is nothing to read.
    UsageError
        Where what an earlier run has left is in the way, or is of another run.
    OutputError
        Where results cannot be written; what is done by then stays done.
    LinkError
        For a scheduler that is not there.
    """
    begun = time.monotonic()
    log = log or Log()
    needs_arrow()
    far = os.fspath(out) if is_remote(os.fspath(out)) else None
    if far is None:
        refuse_existing(out, force=force)
    else:
        refuse_object(far, force=force)
    plan = plan_of(where, asked)
    parts = Parts.of(out, plan, resume=resume, force=force)
    kept = parts.kept()
    resumed = len(kept)
    missing = [place for place in range(len(plan.partitions)) if place not in kept]
    retried = 0
    with _kept(parts):
        log.event("planned", input=where, files=plan.files, partitions=len(plan.partitions), resumed=resumed)
        weights = [partition.weight for partition in plan.partitions]
        finished, rows = sum(weights) - sum(weights[place] for place in missing), 0

        def waits(words: str) -> None:
            log.event("waiting", message=words)
            notice(words)

        over = partial(map_units, workers=workers, scheduler=scheduler, notice=waits)
        for place, content, was_lost in _results(plan, missing, partial(work.done, asked=asked), over):
            kept[place] = parts.commit(place, content)
            count = rows_in(content)
            finished, rows, retried = finished + weights[place], rows + count, retried + was_lost
            log.event("partition", place=place, rows=count, lost=was_lost)
            if watch is not None:
                watch(finished, sum(weights), rows)
        table = parts.folder / TABLE if far else out
        merge([kept[place] for place in range(len(plan.partitions))], table)
        if far:
            put(parts.folder / TABLE, far)
    counted = Counts.of(table)
    parts.remove()
    told = _told(out, counted, plan, asked, resumed=resumed, retried=retried, seconds=time.monotonic() - begun)
    log.event("done", rows=told.rows, verdicts=told.verdicts, codes=told.codes, seconds=round(told.seconds, 3))
    return told


@contextlib.contextmanager
def _kept(parts: Parts) -> Iterator[None]:
    """Say of a result that cannot be written what is left of the work.

    Raises
    ------
    OutputError
    """
    try:
        yield
    except OutputError as error:
        done = sum(1 for _ in parts.folder.glob("part-*.arrow"))
        raise OutputError(f"{error}. {done} partitions are done, and kept: go on with --resume") from None


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
    for place, result in over(do, smaller):
        own = work.lost(smaller[place], result.attempts) if isinstance(result, Lost) else None
        rows.append(Rows.of(own) if own is not None else Rows.from_bytes(result))  # type: ignore[arg-type]
    return Rows.joined(rows).sorted().to_bytes()


@dataclass(frozen=True, slots=True)
class Parts:
    """The folder of what is done.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    @classmethod
    def of(cls, out: str | os.PathLike[str], plan: Plan, *, resume: bool, force: bool) -> Parts:
        """Make it, or find it again.

        Raises
        ------
        UsageError
            Where it is there and nobody said what to do about it, or belongs to another plan.
        OutputError
            Where it cannot be made.
        """
        beside = os.fspath(out)
        parts = cls(Path(f"{PurePosixPath(beside).name if is_remote(beside) else beside}.parts"))
        if parts.folder.exists() and not resume and not force:
            raise UsageError(
                f"{parts.folder} holds what an earlier run has done: go on with --resume, or begin again with --force"
            )
        try:
            if parts.folder.exists() and not resume:
                shutil.rmtree(parts.folder)
            parts.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{parts.folder}: cannot be written: {reason(error)}") from None
        parts._agree(plan)
        return parts

    def _agree(self, plan: Plan) -> None:
        """Keep the plan, or see that it is the one that is kept.

        Raises
        ------
        UsageError
            Where it is another.
        """
        path = self.folder / PLAN
        with contextlib.suppress(OSError, ValueError):
            if json.loads(path.read_text(encoding="utf-8"))["fingerprint"] == plan.fingerprint:
                return
        if any(self.folder.glob("part-*.arrow")):
            raise UsageError(
                f"{self.folder} is of a run with other files, options or another release: name those again, or begin "
                "again with --force and without --resume"
            )
        held = {"fingerprint": plan.fingerprint, "partitions": len(plan.partitions)}
        write_text(json.dumps(held) + "\n", path, force=True)

    def kept(self) -> dict[int, Path]:
        """Files of the partitions that are done; those that a power cut has spoilt are taken away.

        >>> import tempfile
        >>> parts = Parts(Path(tempfile.mkdtemp()))
        >>> paths = [parts.commit(place, b"rows") for place in range(3)]
        >>> _ = paths[2].write_bytes(b"row")
        >>> sorted(parts.kept()), paths[2].exists()
        ([0, 1], False)
        """
        found = {}
        for path in sorted(self.folder.glob("part-*.arrow")):
            with contextlib.suppress(OSError):
                place = int(path.name.split("-")[1])
                if path == self._path(place, path.read_bytes()):
                    found[place] = path
                else:
                    path.unlink()
        return found

    def _path(self, place: int, content: bytes) -> Path:
        """Where the rows of a partition are, once they are there."""
        return self.folder / f"part-{place:07d}-{len(content)}-{zlib.crc32(content):08x}.arrow"

    def commit(self, place: int, content: bytes) -> Path:
        """Write the rows of a partition, all of them or none, and return the file.

        Raises
        ------
        OutputError
            Where they cannot be written.
        """
        path = self._path(place, content)
        temporary = self.folder / f".flinders-{secrets.token_hex(8)}.tmp"
        try:
            temporary.write_bytes(content)
            return temporary.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {reason(error)}") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def remove(self) -> None:
        """Take it away; what cannot be taken away does no harm."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _told(
    out: str | os.PathLike[str],
    counted: Counts,
    plan: Plan,
    asked: Asked,
    *,
    resumed: int,
    retried: int,
    seconds: float,
) -> Told:
    """Put together what was read back of the table, and how the run went."""
    worst = counted.worst_deg
    places = zip(("median", "p95", "largest"), np.percentile(worst, [50, 95, 100]) if len(worst) else (), strict=False)
    return Told(
        output=os.fspath(out),
        files=plan.files,
        partitions=len(plan.partitions),
        units=counted.units,
        rows=counted.rows,
        readings=counted.readings,
        verdicts={name: counted.texts["verdict"][name] for name in VERDICTS if counted.texts["verdict"][name]},
        codes=_most_first(counted.texts["code"]),
        findings=_most_first(counted.texts["findings"]),
        units_of_field=_most_first(counted.texts["unit_of_field"]),
        worst_deg={name: float(value) for name, value in places},
        left_out=plan.left_out,
        polish=asked.polish,
        resumed=resumed,
        retried=retried,
        seconds=seconds,
    )


def _most_first(counts: Counter[str]) -> dict[str, int]:
    """The most frequent first, and nothing of what is empty."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}
