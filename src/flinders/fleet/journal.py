"""What a run says while it goes: to its log, to a progress bar, and to the person at the terminal.

docs/fleet.md has a table of the events.

>>> said = []
>>> Journal(notice=said.append).waits("no workers")
>>> said
['no workers']
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from flinders.errors import FlindersError, OutputError, counted
from flinders.fleet.log import Log
from flinders.fleet.table import needs_arrow

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.fleet.engine import Death
    from flinders.fleet.parts import Parts
    from flinders.fleet.plan import Partition, Plan
    from flinders.fleet.told import Told

NAMED: Final = 8
"""Files of a partition that an event names; it counts them all."""
UNREAD: Final = 1_000
"""Events of what could not be read; after that they are counted."""
UNITS: Final = 200_000
"""Units that are told apart for the progress bar, for which a few of them are held; of more, recordings are counted."""

Watch: TypeAlias = Callable[[int, int, int, int | None], None]
"""Called with the work done so far, all there is, and the recordings and, where they are known, units so far."""


@dataclass(slots=True)
class Journal:
    """What happened so far, and who is told.

    Attributes
    ----------
    log : Log
    watch : callable, optional
        As `Watch`.
    notice : callable
        Called with a line for the person who started the run.
    workers_lost : int
    again : set of Partition
        Those that were done again since their worker died.
    unread : int
        Rows of what could not be read.
    """

    log: Log = field(default_factory=Log)
    watch: Watch | None = None
    notice: Callable[[str], None] = lambda _: None
    workers_lost: int = 0
    again: set[Partition] = field(default_factory=set)
    unread: int = 0
    _parts: Parts | None = None
    _partitions: int = 0
    _finished: int = 0
    _whole: int = 0
    _rows: int = 0
    _units: set[int] | None = field(default_factory=set)

    def planned(self, plan: Plan, parts: Parts, kept: set[int], **fields: object) -> None:
        """All is known that is to be done, and what of it an earlier run has done."""
        self._parts, self._partitions = parts, len(plan.partitions)
        weights = [partition.weight for partition in plan.partitions]
        self._whole = sum(weights)
        self._finished = sum(weight for place, weight in enumerate(weights) if place in kept)
        about = {"files": plan.files, "left_out": plan.left_out, "partitions": len(plan.partitions)}
        self.log.event("planned", **fields, **about, resumed=len(kept))

    def waits(self, words: str) -> None:
        """The work does not go on."""
        self.log.event("waiting", message=words)
        self.notice(words)

    def died(self, death: Death, partition: Partition | None, whole: Partition | None = None) -> None:
        """A worker died of, or beside, a partition, which is a part of a `whole` one or that itself."""
        self.workers_lost += 1
        fields: dict[str, Any] = {"worker": death.worker}
        if partition is None:
            fields["message"] = "a worker left the cluster, which does again what it was doing"
        else:
            self.again.add(whole or partition)
            fields |= {**_named(partition), "attempt": death.attempts}
            fields["message"] = "a worker died while it did these files, which are done again"
        self.log.event("worker-lost", **fields)

    def committed(self, place: int, partition: Partition, content: bytes, *, was_lost: bool) -> None:
        """The rows of a partition are kept."""
        rows = needs_arrow().ipc.open_file(content).read_all()
        if was_lost:
            self.again.add(partition)
        counts = {name: _counted(rows, name) for name in ("verdict", "code")}
        self.log.event(
            "partition",
            place=place,
            **_named(partition),
            units=len(rows.column("unit").unique()),
            rows=rows.num_rows,
            readings=int(rows.column("readings").to_numpy().sum()),
            verdicts=counts["verdict"],
            codes=counts["code"],
            lost=was_lost,
        )
        if counts["verdict"].get("failed"):
            self._tell_unread(rows)
        self._finished += partition.weight
        self._rows += rows.num_rows
        if self.watch is not None:
            self.watch(self._finished, self._whole, self._rows, self._units_with(rows))

    def done(self, told: Told) -> None:
        """The table is written."""
        fields = {
            name: getattr(told, name)
            for name in ("output", "units", "rows", "readings", "verdicts", "codes", "workers_lost", "retried")
        }
        self.log.event("done", **fields, unread=self.unread, seconds=round(told.seconds, 3))

    @contextlib.contextmanager
    def ending(self) -> Iterator[None]:
        """Tell of a run that ends otherwise, and how much of it is kept.

        Raises
        ------
        OutputError
            In place of one: saying that too.
        """
        try:
            yield
        except BaseException as error:
            kept = self._kept()
            with contextlib.suppress(OutputError):  # the log may be what is wrong
                self._ended(error, kept)
            if isinstance(error, KeyboardInterrupt) and kept:
                self.notice(kept)
            if isinstance(error, OutputError) and kept:
                raise OutputError(f"{error}. {kept}") from None
            raise

    def _ended(self, error: BaseException, kept: str) -> None:
        """Write the last event."""
        told: dict[str, Any] = {"done": self._parts.done if self._parts else 0, "partitions": self._partitions}
        if isinstance(error, KeyboardInterrupt | SystemExit):
            self.log.event("interrupted", message=kept or "nothing is kept", **told)
        else:
            code = error.code if isinstance(error, FlindersError) else "internal"
            message = str(error) if isinstance(error, FlindersError) else f"{type(error).__name__}: {error}"
            self.log.event("failed", code=code, message=message, **told)

    def _kept(self) -> str:
        """Say what of the work is kept; a folder in which there is nothing goes."""
        if self._parts is None:
            return ""
        done = self._parts.done
        if not done:
            self._parts.remove()
            return ""
        return f"{done:,} of {counted(self._partitions, 'partition')} are done, and kept: go on with --resume"

    def _tell_unread(self, rows: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
        """An event for each row of what could not be read; when there are too many of them, one that says so."""
        from pyarrow import compute

        failed = rows.filter(compute.equal(rows.column("verdict"), "failed"))
        told = failed.select(["unit", "recording", "code", "message"]).slice(0, max(UNREAD - self.unread, 0))
        for row in told.to_pylist():
            self.log.event("unread", **row)
        before, self.unread = self.unread, self.unread + failed.num_rows
        if before <= UNREAD < self.unread:
            self.log.event("unread-more", message=f"{UNREAD:,} are told; what follows is counted, and in the table")

    def _units_with(self, rows: Any) -> int | None:  # noqa: ANN401
        """How many units there are so far; None for too many to tell apart."""
        if self._units is not None:
            self._units.update(map(hash, rows.column("unit").unique().to_pylist()))
            if len(self._units) > UNITS:
                self._units = None
        return None if self._units is None else len(self._units)


def _named(partition: Partition) -> dict[str, Any]:
    """Files of a partition: some of their names, and how many there are."""
    names = list(dict.fromkeys(piece.member.name for piece in partition.pieces))
    return {"files": names[:NAMED], "file_count": len(names)}


def _counted(rows: Any, name: str) -> dict[str, int]:  # noqa: ANN401
    """How many rows there are of each text of a column; none of what is empty."""
    counts = Counter(rows.column(name).to_pylist())
    return {text: count for text, count in sorted(counts.items(), key=str) if text}
