"""State of a run so far, and who is notified: its log, its progress bar, and the person who started it."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from flinders.apps.fleet.event_log import log_event
from flinders.apps.fleet.merging import total
from flinders.apps.fleet.results import needs_arrow
from flinders.errors import FlindersError, OutputError, counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.apps.fleet.checkpoint import Checkpoint
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.apps.fleet.scheduler import WorkerDeath

LISTED: Final = 8
"""Files of a partition that an event lists; it counts them all."""
UNREAD: Final = 1_000
"""Events about recordings that could not be read; more are only counted."""

ProgressCallback: TypeAlias = Callable[[int, int, int], None]
"""Called with the work done, the total of it, and the recordings so far."""


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
                hint = {**error.hint, "append": True}
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
        return f"{done:,} of {counted(self._partitions, 'partition')} are done, and kept: go on with the run"

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
