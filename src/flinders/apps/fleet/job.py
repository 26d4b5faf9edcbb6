r"""A fleet run: plan partitions, calibrate them, commit each as it is done, and merge them into one table.

Beside the table, ``calibrations.parquet``, a folder ``calibrations.parquet.parts`` holds a file for each finished
partition, and the plan that they belong to. A run with `resume` does the missing ones; the table is the same to the
last byte, for any number of workers. The folder is removed when the table is written. If the table goes to a store, the
folder lies in the working directory.

The table is synced to the disk before it gets its name, partitions are not: after a power cut some may be missing, cut
short or empty. Their names hold length and check sum, and a partition that does not match is done again.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.apps.fleet.dataset import Options
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17.csv").write_text("x,y,z\n1,2,3\n")
>>> summary = run(str(folder), folder / "calibrations.parquet", Options(), workers=0)
>>> summary.rows, summary.verdicts, summary.codes
(1, {'refused': 1}, {'too-few-samples': 1})
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import platform
import secrets
import shutil
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from flinders.apps.fleet import worker
from flinders.apps.fleet.dataset import PARQUET
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.results import UnitResults, merge, needs_arrow, table_counts, total
from flinders.apps.fleet.scheduler import Abandoned, map_units, reach
from flinders.apps.fleet.storage import is_remote, put, refuse_object
from flinders.core.files import locked, reason, refuse_existing, write_all, write_text
from flinders.errors import FlindersError, OutputError, UsageError, counted
from flinders.findings.row import OF_A_TUMBLE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.apps.fleet.dataset import Options
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.apps.fleet.scheduler import WorkerDeath

    Map = Callable[..., Iterator[tuple[int, bytes | Abandoned]]]

PLAN: Final = "plan.json"
TABLE: Final = "table.parquet"
"""Table that goes to a store when it is complete."""
DONE: Final = "part-*.arrow"
OWNER: Final = "owner"
"""Which process has the folder."""
OURS: Final = (DONE, PLAN, TABLE, OWNER, ".flinders-*.tmp")
"""Files that a run may leave in its folder."""
LOGGER: Final = logging.getLogger("flinders.apps.fleet")
LISTED: Final = 8
"""Files of a partition that an event lists; it counts them all."""
UNREAD: Final = 1_000
"""Events about recordings that could not be read; more are only counted."""

ProgressCallback: TypeAlias = Callable[[int, int, int], None]
"""Called with the work done, the total of it, and the recordings so far."""


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
    seconds = time.monotonic() - begun
    return progress.finished(plan, counts, output=os.fspath(out), resumed=resumed, seconds=seconds)


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

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        # what a good verdict rests on
        fields["conditions"] = list(OF_A_TUMBLE) if self.verdicts.get("good") else []
        # units calibrated in a second
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields


# ----------------------------------------------------------------------------------------------------------- checkpoint


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The folder of finished partitions, which one run at a time may use."""

    folder: Path
    lock: int | None = None  # descriptor of the folder, while it is locked

    @classmethod
    def of(cls, out: str | os.PathLike[str], plan: Plan, *, resume: bool, force: bool) -> Checkpoint:
        """Create the folder, or open that of an earlier run.

        Raises UsageError if it holds partitions and neither `resume` nor `force` is given, if they are of another
        plan, or if it holds other files; OutputError if it cannot be created, or another run uses it.
        """
        table = os.fspath(out)
        folder = Path(f"{PurePosixPath(table).name if is_remote(table) else table}.parts")
        with contextlib.ExitStack() as undo:
            try:
                folder.mkdir(exist_ok=True)
                checkpoint = cls(folder, _lock(folder))
                undo.callback(checkpoint.close)
                checkpoint._prepare(resume=resume, force=force)
                (folder / OWNER).write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
            except OSError as error:
                raise OutputError(f"{folder}: cannot be written: {reason(error)}") from None
            checkpoint._match(plan)
            undo.pop_all()
        return checkpoint

    def close(self) -> None:
        """Let other runs use the folder."""
        if self.lock is not None:
            os.close(self.lock)

    def _prepare(self, *, resume: bool, force: bool) -> None:
        """Refuse what an earlier run or somebody else has left there, or remove it."""
        self._refuse_foreign()
        if self.done and not resume and not force:
            raise UsageError(
                f"{self.folder} holds what an earlier run has done: resume it, or begin again",
                hint={"resume": True, "force": True},
            )
        if not resume:
            for path in self.folder.iterdir():
                path.unlink()

    @property
    def done(self) -> int:
        """Number of files of partitions."""
        return sum(1 for _ in self.folder.glob(DONE))

    def _refuse_foreign(self) -> None:
        """Refuse a folder with other files, which would be removed with it."""
        if self.folder.is_dir():
            foreign = [each.name for each in self.folder.iterdir() if not any(each.match(name) for name in OURS)]
            if foreign:
                raise UsageError(
                    f"{self.folder} is where parts of the table are kept, and holds something else, "
                    f"{min(foreign)}: move that, or name another table"
                )

    def _match(self, plan: Plan) -> None:
        """Write the fingerprint of the plan, or refuse partitions of another plan."""
        path = self.folder / PLAN
        with contextlib.suppress(OSError, ValueError):
            if json.loads(path.read_text(encoding="utf-8"))["fingerprint"] == plan.fingerprint:
                return
        if self.done:
            raise UsageError(
                f"{self.folder} is of a run with other files, options or another release: name those again to resume "
                "it, or begin again",
                hint={"force": True},
            )
        about = {"fingerprint": plan.fingerprint, "partitions": len(plan.partitions)}
        write_text(json.dumps(about) + "\n", path, force=True)

    def finished(self) -> dict[int, Path]:
        """Files of finished partitions; those that are not as they were written are removed."""
        files = {}
        for path in sorted(self.folder.glob(DONE)):
            with contextlib.suppress(OSError, ValueError):  # a file of another name is not of a run
                place = int(path.name.split("-")[1])
                if path == self._path(place, path.read_bytes()):
                    files[place] = path
                else:
                    path.unlink()
        return files

    def _path(self, place: int, content: bytes) -> Path:
        """File of a partition with this content."""
        return self.folder / f"part-{place:07d}-{len(content)}-{zlib.crc32(content):08x}.arrow"

    def commit(self, place: int, content: bytes) -> Path:
        """Write the rows of a partition, all or none, and return the file; raises OutputError."""
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
        """Remove the folder; if that fails, nothing is lost."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _lock(folder: Path) -> int | None:
    """Lock a folder for this run; raises OutputError if another run has it. Folders of Windows have no locks."""
    if os.name == "nt":
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    if locked(descriptor):
        return descriptor
    os.close(descriptor)
    owner = "it has not said which"
    with contextlib.suppress(OSError):
        owner = (folder / OWNER).read_text(encoding="utf-8", errors="replace")
    raise OutputError(
        f"{folder}: another run is writing into it ({owner}): wait until that one has ended, or name another table"
    )


# ------------------------------------------------------------------------------------------------------------------ log


@contextlib.contextmanager
def log_to(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Append the events of runs within the block to a file, which a resumed run continues; raises OutputError."""
    if path is None:
        yield
        return
    handler, level = _JsonLines(path), LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.setLevel(level)
        LOGGER.removeHandler(handler)
        handler.close()


def log_event(event: str, **fields: object) -> None:
    """Log what happened, and its fields; raises OutputError if the file of `log_to` cannot be written."""
    LOGGER.info(event, extra={"fields": fields})


class _JsonLines(logging.Handler):
    """Appends events to a file, unbuffered; unlike other handlers it raises if it cannot."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open the file, and end a line that was cut."""
        super().__init__()
        self._path = path
        try:
            self._file = Path(path).open("ab", buffering=0)  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise self._refused(error) from None
        if _is_cut(path):
            self._write("\n")

    def emit(self, record: logging.LogRecord) -> None:
        """Write an event."""
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        fields: dict[str, object] = getattr(record, "fields", {})
        self._write(json.dumps({"time": time, "event": record.getMessage(), **fields}, allow_nan=False) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()

    def _write(self, line: str) -> None:
        """Write a line; raises OutputError."""
        try:
            write_all(self._file, line.encode())
        except OSError as error:
            raise self._refused(error) from None

    def _refused(self, error: OSError) -> OutputError:
        """Error of a log that cannot be written."""
        return OutputError(f"{self._path}: the log cannot be written: {reason(error)}")


def _is_cut(path: str | os.PathLike[str]) -> bool:
    """Whether the last line of a log is incomplete, as after a full disk; a pipe or a device has no last line."""
    if not Path(path).is_file() or not Path(path).stat().st_size:
        return False
    with Path(path).open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) != b"\n"


# ------------------------------------------------------------------------------------------------------------- progress


@dataclass(slots=True)
class Progress:
    """State of a run so far, and who is notified."""

    watch: ProgressCallback | None = None  # called as each partition is done
    notice: Callable[[str], None] = lambda _: None  # called with a line for the person who started the run
    workers_lost: int = 0
    retried: set[Partition] = field(default_factory=set)  # partitions that were run again because their worker died
    unread: int = 0  # recordings that could not be read
    _checkpoint: Checkpoint | None = None
    _partitions: int = 0
    _done: int = 0
    _total: int = 0
    _rows: int = 0

    def planned(self, plan: Plan, checkpoint: Checkpoint, finished: set[int], **fields: object) -> None:
        """Log the plan, and which of its partitions an earlier run has finished."""
        self._checkpoint, self._partitions = checkpoint, len(plan.partitions)
        weights = [partition.weight for partition in plan.partitions]
        self._total = sum(weights)
        self._done = sum(weight for place, weight in enumerate(weights) if place in finished)
        about = {"files": plan.files, "other_files": plan.other_files, "partitions": len(plan.partitions)}
        log_event("planned", **fields, **about, resumed=len(finished))

    def waits(self, words: str) -> None:
        """Log and say why the work does not go on."""
        log_event("waiting", message=words)
        self.notice(words)

    def died(self, death: WorkerDeath, partition: Partition | None, whole: Partition | None = None) -> None:
        """Log the death of a worker with its partition, which may be a part of a `whole` one."""
        self.workers_lost += 1
        fields: dict[str, Any] = {"worker": death.worker}
        if partition is None:
            fields["message"] = "a worker left the cluster, which does again what it was doing"
        else:
            self.retried.add(whole or partition)
            fields |= {**_files_of(partition), "attempt": death.attempts}
            fields["message"] = "a worker died while it did these files, which are done again"
        log_event("worker-lost", **fields)

    def committed(self, place: int, partition: Partition, content: bytes, *, was_lost: bool) -> None:
        """Log a partition whose rows are written, and move the progress bar."""
        rows = needs_arrow().ipc.open_file(content).read_all()
        if was_lost:
            self.retried.add(partition)
        verdicts, codes = (_counts_of(rows, name) for name in ("verdict", "code"))
        log_event(
            "partition",
            place=place,
            **_files_of(partition),
            units=len(rows.column("unit").unique()),
            rows=rows.num_rows,
            readings=total(rows.column("readings")),
            verdicts=verdicts,
            codes=codes,
            lost=was_lost,
        )
        if verdicts.get("failed"):
            self._log_unread(rows)
        self._done += partition.weight
        self._rows += rows.num_rows
        if self.watch is not None:
            self.watch(self._done, self._total, self._rows)

    def finished(self, plan: Plan, counts: dict[str, Any], *, output: str, resumed: int, seconds: float) -> RunSummary:
        """Sum up a run whose table is written, and log it."""
        summary = RunSummary(
            output=output,
            files=plan.files,
            partitions=len(plan.partitions),
            **counts,
            other_files=plan.other_files,
            resumed=resumed,
            workers_lost=self.workers_lost,
            retried=len(self.retried),
            seconds=seconds,
        )
        names = ("output", "units", "rows", "readings", "verdicts", "codes", "workers_lost", "retried")
        fields = {name: getattr(summary, name) for name in names}
        log_event("done", **fields, unread=self.unread, seconds=round(seconds, 3))
        return summary

    @contextlib.contextmanager
    def ending(self) -> Iterator[None]:
        """Log how a run ends that does not finish, and say how many of its partitions are done.

        An OutputError is raised with that added.
        """
        try:
            yield
        except BaseException as error:
            done = self._work_done()
            with contextlib.suppress(OutputError):  # the log may be what cannot be written
                self._log_end(error, done)
            if isinstance(error, KeyboardInterrupt) and done:
                self.notice(done)
            if isinstance(error, OutputError) and done:
                hint = {**error.hint, "resume": True}
                raise OutputError(f"{error.message}. {done}", hint=hint, **error.evidence) from None
            raise

    def _log_end(self, error: BaseException, done: str) -> None:
        """Log the last event of a run that does not finish."""
        state = {"done": self._checkpoint.done if self._checkpoint else 0, "partitions": self._partitions}
        if isinstance(error, KeyboardInterrupt | SystemExit):
            log_event("interrupted", message=done or "nothing is kept", **state)
        elif isinstance(error, FlindersError):
            log_event("failed", code=error.code, message=error.message, **state)
        else:
            log_event("failed", code="internal", message=f"{type(error).__name__}: {error}", **state)

    def _work_done(self) -> str:
        """Say how many partitions are done; a folder without any is removed."""
        if self._checkpoint is None:
            return ""
        done = self._checkpoint.done
        if not done:
            self._checkpoint.remove()
            return ""
        return f"{done:,} of {counted(self._partitions, 'partition')} are done, and kept: resume the run"

    def _log_unread(self, rows: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
        """Log each recording that could not be read, up to `UNREAD` of them."""
        from pyarrow import compute

        failed = rows.filter(compute.equal(rows.column("verdict"), "failed"))
        logged = failed.select(["unit", "recording", "code", "message"]).slice(0, max(UNREAD - self.unread, 0))
        for row in logged.to_pylist():
            log_event("unread", **row)
        before, self.unread = self.unread, self.unread + failed.num_rows
        if before <= UNREAD < self.unread:
            log_event("unread-more", message=f"{UNREAD:,} are told; what follows is counted, and in the table")


def _files_of(partition: Partition) -> dict[str, Any]:
    """Names of some files of a partition, and how many there are."""
    names = list(dict.fromkeys(part.file.name for part in partition.slices))
    return {"files": names[:LISTED], "file_count": len(names)}


def _counts_of(rows: Any, name: str) -> dict[str, int]:  # noqa: ANN401
    """Count rows by the texts of a column, the empty one left out."""
    counts = Counter(rows.column(name).to_pylist())
    return {text: count for text, count in sorted(counts.items(), key=str) if text}
