"""Progress of a run, for its log, its progress bar, and messages to the user."""

from __future__ import annotations

import contextlib
import json
import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from flinders.apps.fleet.merging import total
from flinders.apps.fleet.results import needs_arrow
from flinders.core.files import reason_and_remedy, write_all
from flinders.errors import FlindersError, OutputError, count_text

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from flinders.apps.fleet.checkpoint import Checkpoint
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.apps.fleet.scheduler import WorkerDeath

MAX_LISTED: Final = 8
"""Largest number of files of a partition that an event lists; all are counted."""
MAX_UNREAD: Final = 1_000
"""Largest number of events about unreadable recordings; further ones are only counted."""

ProgressCallback: TypeAlias = Callable[[int, int, int], None]
"""Called with the work done and the total work, in bytes to read, and the number of recordings so far."""


@dataclass(slots=True)
class Progress:
    """Progress of a run, and the callbacks that report it."""

    watch: ProgressCallback | None = None  # called when a partition is finished
    notice: Callable[[str], None] = lambda _: None  # called with a line of text for the user
    workers_lost: int = 0
    retried: set[Partition] = field(default_factory=set)  # partitions that were run again because their worker died
    unread: int = 0  # recordings that could not be read
    _checkpoint: Checkpoint | None = None
    _partitions: int = 0
    _done: int = 0
    _total: int = 0
    _rows: int = 0

    def log_plan(self, plan: Plan, checkpoint: Checkpoint, finished: set[int], **fields: object) -> None:
        """Log the plan, and which of its partitions an earlier run has finished."""
        self._checkpoint, self._partitions = checkpoint, len(plan.partitions)
        weights = [partition.weight for partition in plan.partitions]
        self._total = sum(weights)
        self._done = sum(weight for place, weight in enumerate(weights) if place in finished)
        about = {"files": plan.files, "other_files": plan.other_files, "partitions": len(plan.partitions)}
        log_event("planned", **fields, **about, resumed=len(finished))

    def log_wait(self, words: str) -> None:
        """Log and report why the run waits."""
        log_event("waiting", message=words)
        self.notice(words)

    def log_death(self, death: WorkerDeath, partition: Partition | None, whole: Partition | None = None) -> None:
        """Log the death of a worker with its partition, which may be a part of a `whole` one."""
        self.workers_lost += 1
        fields: dict[str, Any] = {"worker": death.worker}
        if partition is None:
            fields["message"] = "a worker left the cluster, which repeats the work of that worker"
        else:
            self.retried.add(whole or partition)
            fields |= {**_files_of(partition), "attempt": death.attempts}
            fields["message"] = "a worker died while it calibrated these files, which are calibrated again"
        log_event("worker-lost", **fields)

    def log_partition(self, place: int, partition: Partition, content: bytes, *, was_lost: bool) -> None:
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

    @contextlib.contextmanager
    def log_ending(self) -> Iterator[None]:
        """Log the end of a run that does not finish, and report how many of its partitions are finished.

        An OutputError is raised again with that number in its message.
        """
        try:
            yield
        except BaseException as error:
            done = self._work_done()
            with contextlib.suppress(OutputError):  # the error may be that of the log
                self._log_end(error, done)
            if isinstance(error, KeyboardInterrupt) and done:
                self.notice(done)
            if isinstance(error, OutputError) and done:
                hint = {**error.hint, "append": True}
                raise OutputError(f"{error.message}. {done}", hint=hint, **error.evidence) from None
            raise

    def _log_end(self, error: BaseException, done: str) -> None:
        """Log the last event of a run that does not finish."""
        state = {"done": self._checkpoint.finished_count if self._checkpoint else 0, "partitions": self._partitions}
        if isinstance(error, KeyboardInterrupt | SystemExit):
            log_event("interrupted", message=done or "nothing is kept", **state)
        elif isinstance(error, FlindersError):
            log_event("failed", code=error.code, message=error.message, **state)
        else:
            log_event("failed", code="internal", message=f"{type(error).__name__}: {error}", **state)

    def _work_done(self) -> str:
        """Message about the number of finished partitions; a folder without any is removed."""
        if self._checkpoint is None:
            return ""
        done = self._checkpoint.finished_count
        if not done:
            self._checkpoint.remove()
            return ""
        return f"{done:,} of {count_text(self._partitions, 'partition')} are finished and kept: continue the run"

    def _log_unread(self, rows: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
        """Log each recording that could not be read, up to `MAX_UNREAD` of them."""
        from pyarrow import compute

        failed = rows.filter(compute.equal(rows.column("verdict"), "failed"))
        logged = failed.select(["unit", "recording", "code", "message"]).slice(0, max(MAX_UNREAD - self.unread, 0))
        for row in logged.to_pylist():
            log_event("unread", **row)
        before, self.unread = self.unread, self.unread + failed.num_rows
        if before <= MAX_UNREAD < self.unread:
            log_event("unread-more", message=f"{MAX_UNREAD:,} are logged; further ones are counted, and in the table")


def _files_of(partition: Partition) -> dict[str, Any]:
    """Names of the first files of a partition, and the number of all."""
    names = list(dict.fromkeys(part.file.name for part in partition.slices))
    return {"files": names[:MAX_LISTED], "file_count": len(names)}


def _counts_of(rows: Any, name: str) -> dict[str, int]:  # noqa: ANN401
    """Count rows by the texts of a column, the empty one left out."""
    counts = Counter(rows.column(name).to_pylist())
    return {text: count for text, count in sorted(counts.items(), key=str) if text}


# ----------------------------------------------------------------------------------------------------------------- log

LOGGER: Final = logging.getLogger("flinders.apps.fleet")


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
    """Log an event with its fields; raises OutputError if the file of `log_to` cannot be written."""
    LOGGER.info(event, extra={"fields": fields})


class _JsonLines(logging.Handler):
    """Handler that appends each event to a file at once; raises OutputError if the file cannot be written."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open the file, and end an incomplete last line."""
        super().__init__()
        self._path = path
        try:
            self._file = Path(path).open("ab", buffering=0)  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise self._refusal(error) from None
        if _is_cut(path):
            self._write("\n")

    def emit(self, record: logging.LogRecord) -> None:
        """Write an event as a line of JSON."""
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
            raise self._refusal(error) from None

    def _refusal(self, error: OSError) -> OutputError:
        """Error of a log that cannot be written."""
        return OutputError(f"{self._path}: the log cannot be written: {reason_and_remedy(error)}")


def _is_cut(path: str | os.PathLike[str]) -> bool:
    """Whether the last line of a log is incomplete, as after a full disk; a pipe or a device has no last line."""
    if not Path(path).is_file() or not Path(path).stat().st_size:
        return False
    with Path(path).open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) != b"\n"
