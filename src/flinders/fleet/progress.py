"""Progress of a fleet run, and its summary: events for its log, numbers for a progress bar, the page for the terminal.

Events go to the logger ``flinders.fleet``; `log_to` writes them to a file, one line of JSON each. docs/fleet.md has a
table of them.

>>> import tempfile
>>> path = Path(tempfile.mkdtemp()) / "fleet.jsonl"
>>> with log_to(path):
...     log_event("planned", partitions=3)
>>> json.loads(path.read_text())["event"], json.loads(path.read_text())["partitions"]
('planned', 3)
"""

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

import numpy as np

from flinders.core.files import reason, write_all
from flinders.errors import FlindersError, OutputError, counted, figures, percent
from flinders.fleet.results import VERDICTS, named_rows, needs_arrow

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray
    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.fleet.checkpoint import Checkpoint
    from flinders.fleet.plan import Partition, Plan
    from flinders.fleet.scheduler import WorkerDeath

LOGGER: Final = logging.getLogger("flinders.fleet")
LISTED: Final = 8
"""Files of a partition that an event lists; it counts them all."""
UNREAD: Final = 1_000
"""Events about recordings that could not be read; more are only counted."""
UNITS: Final = 200_000
"""Units that are counted for the progress bar, whose hashes are held; of more, recordings alone are counted."""

COUNTED: Final = {
    "verdict": "verdicts", "code": "codes", "findings": "findings", "unit_of_field": "units_of_field"
}  # fmt: skip
"""Columns of few texts that occur often, and the counts of them in a `RunSummary`."""
COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red", "failed": "red"}
SUFFIXES: Final = {"none": "without an ending"}
"""Words for kinds of files that are not their suffix."""
SHOWN: Final = 8
"""Codes and findings that the page lists; the table has them all."""

ProgressCallback: TypeAlias = Callable[[int, int, int, int | None], None]
"""Called with the work done and the total of it, and with recordings and, if they are counted, units so far."""


# --------------------------------------------------------------------------------------------------------------- log


@contextlib.contextmanager
def log_to(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Append the events of runs within the block to a file, which a resumed run continues; to none for None.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
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
    """Log what happened, and its fields.

    Raises
    ------
    OutputError
        If the file of `log_to` cannot be written.
    """
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


# ---------------------------------------------------------------------------------------------------------- progress


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
    _units: set[int] | None = field(default_factory=set)

    def planned(self, plan: Plan, checkpoint: Checkpoint, finished: set[int], **fields: object) -> None:
        """Log the plan, and which of its partitions an earlier run has finished."""
        self._checkpoint, self._partitions = checkpoint, len(plan.partitions)
        weights = [partition.weight for partition in plan.partitions]
        self._total = sum(weights)
        self._done = sum(weight for place, weight in enumerate(weights) if place in finished)
        about = {"files": plan.files, "left_out": plan.left_out, "partitions": len(plan.partitions)}
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
            readings=int(rows.column("readings").to_numpy().sum()),
            verdicts=verdicts,
            codes=codes,
            lost=was_lost,
        )
        if verdicts.get("failed"):
            self._log_unread(rows)
        self._done += partition.weight
        self._rows += rows.num_rows
        if self.watch is not None:
            self.watch(self._done, self._total, self._rows, self._units_with(rows))

    def finished(self, summary: RunSummary) -> None:
        """Log that the table is written."""
        names = ("output", "units", "rows", "readings", "verdicts", "codes", "workers_lost", "retried")
        fields = {name: getattr(summary, name) for name in names}
        log_event("done", **fields, unread=self.unread, seconds=round(summary.seconds, 3))

    @contextlib.contextmanager
    def ending(self) -> Iterator[None]:
        """Log how a run ends that does not finish, and say how many of its partitions are done.

        Raises
        ------
        OutputError
            In place of another one, with that added.
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
                raise OutputError(f"{error}. {done}") from None
            raise

    def _log_end(self, error: BaseException, done: str) -> None:
        """Log the last event of a run that does not finish."""
        state = {"done": self._checkpoint.done if self._checkpoint else 0, "partitions": self._partitions}
        if isinstance(error, KeyboardInterrupt | SystemExit):
            log_event("interrupted", message=done or "nothing is kept", **state)
        elif isinstance(error, FlindersError):
            log_event("failed", code=error.code, message=str(error), **state)
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
        return f"{done:,} of {counted(self._partitions, 'partition')} are done, and kept: go on with --resume"

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

    def _units_with(self, rows: Any) -> int | None:  # noqa: ANN401
        """Count the units so far; None if there are too many to tell apart."""
        if self._units is not None:
            self._units.update(map(hash, rows.column("unit").unique().to_pylist()))
            if len(self._units) > UNITS:
                self._units = None
        return None if self._units is None else len(self._units)


def _files_of(partition: Partition) -> dict[str, Any]:
    """Names of some files of a partition, and how many there are."""
    names = list(dict.fromkeys(part.file.name for part in partition.slices))
    return {"files": names[:LISTED], "file_count": len(names)}


def _counts_of(rows: Any, name: str) -> dict[str, int]:  # noqa: ANN401
    """Count rows by the texts of a column, the empty one left out."""
    counts = Counter(rows.column(name).to_pylist())
    return {text: count for text, count in sorted(counts.items(), key=str) if text}


# ----------------------------------------------------------------------------------------------------------- summary


def table_counts(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Fields of `RunSummary` that a Parquet file sorted by unit gives; memory is that of a batch and of all errors.

    >>> import tempfile
    >>> from flinders.fleet.results import UnitResult, UnitResults, merge
    >>> folder = Path(tempfile.mkdtemp())
    >>> good = UnitResult(unit="A1", verdict="good", worst_deg=0.4)
    >>> rows = [good, UnitResult(unit="A2", code="unreadable"), UnitResult(unit="A2")]
    >>> _ = (folder / "part").write_bytes(UnitResults.of(rows).to_bytes())
    >>> merge([folder / "part"], folder / "all.parquet")
    >>> counts = table_counts(folder / "all.parquet")
    >>> counts["rows"], counts["units"], counts["verdicts"], counts["worst_deg"]["largest"], counts["failed_readings"]
    (3, 2, {'good': 1, 'failed': 2}, 0.4, 0)
    """
    needs_arrow()
    from pyarrow import parquet

    counters = {name: Counter[str]() for name in COUNTED}
    totals, last = Counter[str](), None
    errors: list[Floats] = [np.empty(0)]
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        for batch in file.iter_batches(columns=["unit", "readings", "worst_deg", *COUNTED]):
            for name, counter in counters.items():
                counter.update(_value_counts(batch.column(name)))
            errors.append(_heading_errors(batch))
            readings = batch.column("readings").to_numpy()
            failed = readings[_is_among(batch, VERDICTS[3:])]
            units = named_rows(batch).column("unit")
            totals.update(readings=int(readings.sum()), failed_readings=int(failed.sum()), rows=len(readings))
            if len(units):
                totals["units"] += len(units.unique()) - (units[0].as_py() == last)
                last = units[-1].as_py()
    verdicts = counters.pop("verdict")
    return {
        **{name: totals[name] for name in ("units", "rows", "readings", "failed_readings")},
        "verdicts": {name: verdicts[name] for name in VERDICTS if verdicts[name]},
        **{COUNTED[name]: _by_frequency(counter) for name, counter in counters.items()},
        "worst_deg": _spread(errors),
    }


def _spread(errors: Sequence[Floats]) -> dict[str, float]:
    """Median, 95th percentile and maximum of heading errors; empty without any."""
    known = np.concatenate(errors)
    if not len(known):
        return {}
    return dict(zip(("median", "p95", "largest"), np.percentile(known, [50, 95, 100]).tolist(), strict=True))


def _value_counts(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """Count each text of a column, or of the lists in one."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _heading_errors(batch: Any) -> Floats:  # noqa: ANN401
    """Known heading errors of a batch, of rows that have a calibration."""
    worst: Floats = np.asarray(batch.column("worst_deg").to_numpy(zero_copy_only=False), dtype=float)
    known: Floats = worst[_is_among(batch, VERDICTS[:2]) & np.isfinite(worst)]
    return known


def _is_among(batch: Any, verdicts: Sequence[str]) -> NDArray[np.bool_]:  # noqa: ANN401
    """(R,) whether rows of a batch have one of these verdicts."""
    from pyarrow import array, compute

    among: NDArray[np.bool_] = compute.is_in(batch.column("verdict"), value_set=array(verdicts)).to_numpy(False)
    return among


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Summary of a fleet run: rows written, units refused, files left out, duration."""

    output: str
    files: int
    partitions: int
    units: int  # units, their recordings, which are the rows of the table, and readings
    rows: int
    readings: int
    failed_readings: int  # readings of recordings that failed; an unreadable one has as many as its footer says
    verdicts: dict[str, int]  # rows of each verdict, error code, finding and unit of field
    codes: dict[str, int]
    findings: dict[str, int]
    units_of_field: dict[str, int]
    # ``median``, ``p95`` and ``largest`` of the worst heading error of rows that are good or limited
    worst_deg: dict[str, float]
    left_out: dict[str, int]  # files of other kinds, by their suffix
    resumed: int  # partitions that an earlier run had done
    workers_lost: int  # workers that died, or left the cluster
    # partitions that were run again because their worker died; a cluster reports only those that it gave up
    retried: int
    seconds: float

    @property
    def is_whole(self) -> bool:
        """Whether every recording has a calibration."""
        return not self.codes

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    """Counts with the most frequent first, the empty text left out."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}


# -------------------------------------------------------------------------------------------------------------- page


def page(summary: RunSummary) -> RenderableType:
    """Lay out a run: what was read, verdicts, why rows have no calibration, and findings."""
    from rich.console import Group

    content = (counted(summary.units, "unit"), counted(summary.rows, "recording"), counted(summary.readings, "reading"))
    verdicts = _table("verdict", "recordings", "share")
    for verdict, count in summary.verdicts.items():
        verdicts.add_row(verdict, f"{count:,}", percent(count, summary.rows), style=COLOURS[verdict])
    parts = [f"{counted(summary.files, 'file')}: {', '.join(content)}", "", verdicts]
    for title, counts in (("no calibration because", summary.codes), ("findings", summary.findings)):
        if counts:
            parts += ["", _most_frequent(title, counts)]
    return Group("", *parts, "", *_remarks(summary))


def _table(first: str, *numbers: str) -> Any:  # noqa: ANN401 - rich is imported late
    """Empty table with a column of texts and columns of numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column(first)
    for name in numbers:
        table.add_column(name, justify="right")
    return table


def _most_frequent(title: str, counts: dict[str, int]) -> RenderableType:
    """Table of the most frequent codes."""
    table = _table(title, "recordings")
    for code, count in list(counts.items())[:SHOWN]:
        table.add_row(code, f"{count:,}")
    if len(counts) > SHOWN:
        table.add_row(f"and {len(counts) - SHOWN} more", "")
    return table  # type: ignore[no-any-return]


def _remarks(summary: RunSummary) -> list[str]:
    """Further lines of the page."""
    lines = []
    if summary.worst_deg:
        middle, most, largest = (figures(summary.worst_deg[name]) for name in ("median", "p95", "largest"))
        lines.append(f"worst heading error: median {middle}°, 95% below {most}°, largest {largest}° (1 σ)")
    if summary.failed_readings:
        lines.append(f"readings of recordings that failed: {summary.failed_readings:,} of {summary.readings:,}")
    if len(summary.units_of_field) > 1:
        units = ", ".join(f"{count:,} in {unit}" for unit, count in summary.units_of_field.items())
        lines.append(f"units of field differ: {units}; offsets are in the unit of their row")
    if summary.left_out:
        kinds = ", ".join(f"{count:,} {SUFFIXES.get(kind, kind)}" for kind, count in summary.left_out.items())
        lines.append(f"left out files that are no recordings: {kinds}")
    if summary.resumed:
        lines.append(f"{summary.resumed:,} of {counted(summary.partitions, 'partition')} were done before")
    if summary.workers_lost or summary.retried:
        again = f"{counted(summary.retried, 'partition')} {'was' if summary.retried == 1 else 'were'} done again"
        lines.append(f"{counted(summary.workers_lost, 'worker')} died or left; {again}")
    return lines
