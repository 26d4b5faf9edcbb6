r"""Recording of a running sensor: everything received is written to disk immediately, as text for `flinders.read`.

A line that cannot be parsed is stored as a comment and counted. Text is passed to the operating system immediately and
forced to the disk every second, so that a crash of the machine loses at most 1 s, and a killed program less.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.links.transports import ScriptedSource
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> board = ScriptedSource([b"booting\r\nRaw:0,0,8192,0,0,0,217,4,-5", b"86\r\nRaw:0,0,8192,0,0,0,217,2,-587\r\n"])
>>> with FileSink(file) as sink:
...     print(Recorder(board, sink, readings=2).run())
2 readings (Raw: lines) in 0.0 s, ..., strength 62.5 µT (62.5 to 62.6)
>>> print(file.read_text())
# flinders ... record: the script, begun ...Z
# booting
t_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT
...,0,0,1,0,0,0,21.7,0.4,-58.6
...,0,0,1,0,0,0,21.7,0.2,-58.7
<BLANKLINE>
>>> from flinders.readers import read
>>> read(file).field[0]
array([ 21.7,   0.4, -58.6])

A recorder is also a `Feed`: `next` records the received lines and returns readings and events. It writes to a sink:
a file, a file with retries when the disk is full (`RetryingSink`), standard output, or nowhere.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import sys
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

import numpy as np

from flinders.core.files import reason_and_remedy, refuse_existing, try_lock
from flinders.core.units import MICROTESLA
from flinders.errors import LinkError, OutputError, OutputExists, UnreadableInput, count_text
from flinders.links.feeds import FeedEvent
from flinders.links.transcript import RecordingStatistics, Taken, Transcript, escape_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.links.feeds import Feed, Received
    from flinders.links.transports import ByteSource

SYNC_S: Final = 1.0  # Time after which received text is forced to the disk
WAIT_S: Final = 0.1  # Longest wait for bytes, the delay at the end of a recording
WATCH_S: Final = 0.5
MAX_DATAGRAMS: Final = 5000  # Largest count of datagrams that are read together
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 2.0
"""First and longest time between tries to open a lost port again; it doubles with each try."""


class Recorder:
    """Recorder of a byte source, which is also a feed of its readings.

    Parameters
    ----------
    source : ByteSource
    sink : Sink, optional
        Without it nothing is written, and readings and events are only returned.
    seconds, readings : float and int, optional
        Duration after which `run` stops, and count of rows after which nothing more is read.
    resumed : ResumedRecording, optional
        The recording that is continued, of which `sink` is the file.
    stopped : callable
        Called by `run` to decide whether to stop for another reason.
    say : callable
        Called by `run` with each sentence for the user.
    watch : callable, optional
        Called by `run` twice per second with the statistics.
    clock : callable
        Monotonic clock in seconds.
    **reading
        ``columns``, ``unit``, ``scale`` and ``pattern``, if the lines do not state them, as for
        `flinders.open_recording`. The written text depends on the pattern alone.
    """

    def __init__(
        self,
        source: ByteSource,
        sink: Sink | None = None,
        *,
        seconds: float | None = None,
        readings: int | None = None,
        resumed: ResumedRecording | None = None,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        watch: Callable[[RecordingStatistics], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        **reading: Any,
    ) -> None:
        self.name = source.name
        self._source, self._sink, self._clock = source, sink or NullSink(), clock
        self._saved = "; all readings so far are saved" if sink else ""
        self._seconds, self._stopped, self._say, self._watch = seconds, stopped, say, watch
        before: dict[str, Any] = {} if resumed is None else {"header": resumed.header, "rows": resumed.rows}
        self._transcript = Transcript(source.name, is_framed=source.is_framed, most=readings, **before, **reading)
        self._earlier = resumed.seconds if resumed else 0.0
        self._start = clock()
        self._title = title(source.name, is_new=resumed is None)
        self._synced = self._watched = 0.0
        self._retry: tuple[float, float] | None = None
        self._lost = 0
        self._is_closed = False
        self._waiting: deque[Samples | FeedEvent] = deque([FeedEvent("connected", 0.0, f"{source.name} is open")])

    @property
    def statistics(self) -> RecordingStatistics:
        """Statistics of the recording so far."""
        return self._transcript.statistics

    @property
    def clock_start(self) -> float | None:
        """As `Transcript.clock_start`."""
        return self._transcript.clock_start

    def next(self, timeout: float = WAIT_S) -> Received:
        """As `Feed.next`; `OutputError` if the received text cannot be written; earlier text is saved."""
        if self._is_closed and not self._waiting:
            time.sleep(timeout)
        elif not self._waiting:
            if self._retry is None:
                self._listen(timeout)
            else:
                self._try_again(timeout)
            if self._now() - self._synced >= SYNC_S:
                self._synced = self._now()
                self._note_lost()
                self._sink.sync()
        return self._waiting.popleft() if self._waiting else None

    def close(self) -> None:
        """Write waiting lines, force them to the disk, and close the source; `next` still returns their readings."""
        if not self._is_closed:
            self._is_closed = True
            self._end()
            self._waiting.append(FeedEvent("ended", self._now(), f"{self.name} is closed"))
        self._source.close()

    def run(self) -> RecordingStatistics:
        """Record until the end, and write everything received by then.

        Raises
        ------
        OutputError
            If the sink cannot be written; earlier text is saved.
        UnreadableInput
            Without any line of numbers.
        """
        while not self._is_over():
            received = self.next(max(min(WAIT_S, self._remaining_s()), 0.0))
            if isinstance(received, FeedEvent):
                self._announce(received)
            if self._watch and self._now() - self._watched >= WATCH_S:
                self._watched = self._now()
                self._watch(self.statistics)
        self._end()
        if self._watch:
            self._watch(self.statistics)
        if not self.statistics.readings:
            raise UnreadableInput(self._transcript.nothing())
        return self.statistics

    def _now(self) -> float:
        return self._clock() - self._start + self._earlier

    def _remaining_s(self) -> float:
        """Seconds until the requested end."""
        return math.inf if self._seconds is None else self._seconds + self._earlier - self._now()

    def _is_over(self) -> bool:
        return (self._remaining_s() <= 0.0 and not self._waiting) or self._transcript.is_full or self._stopped()

    def _announce(self, event: FeedEvent) -> None:
        """Report an event to the user."""
        match event.kind:
            case "connected" | "unclear":  # reported at the end, with the statistics
                return
            case "settled":
                self._say(f"{self.name}: {event.words}")
            case "back":
                self._say(event.words)
            case "gone":
                self._say(f"! {event.words}. Waiting for it to come back; Ctrl-C ends the recording")
            case _:
                self._say(f"! {event.words}")

    def _listen(self, timeout: float) -> None:
        """Read and record bytes; queue an event if the source is disconnected."""
        try:
            content = self._read(timeout)
        except LinkError as error:
            self._record(self._transcript.record_loss(self._now()))
            self._sink.sync()
            self._retry = (self._clock() + FIRST_RETRY_S, FIRST_RETRY_S)
            self._waiting.append(FeedEvent("gone", self._now(), f"{error.message}{self._saved}"))
            return
        if content and self._title:
            self._sink.write(self._title)
            self._title = ""
        self._record(self._transcript.take(content, self._now()))

    def _read(self, timeout: float) -> bytes:
        """Wait for bytes; read all waiting datagrams, as their buffer is limited."""
        content = self._source.read(timeout)
        if not content or not self._source.is_framed:
            return content
        together = [content]
        while len(together) < MAX_DATAGRAMS and (content := self._source.read(0.0)):
            together.append(content)
        return b"\n".join(together)

    def _note_lost(self) -> None:
        """Report datagrams that the system has dropped because they were not read in time."""
        lost = getattr(self._source, "lost", 0)
        new, self._lost = lost - self._lost, lost
        if new <= 0:
            return
        self._transcript.statistics.datagrams_lost += new
        words = (
            f"{count_text(new, 'datagram')} {'was' if new == 1 else 'were'} lost by this machine, which was too busy"
        )
        self._sink.write(f"# {words}, before {self._now():.4f} s\n")
        self._waiting.append(
            FeedEvent("lost", self._now(), f"{words}: send several readings in one datagram, or fewer per second")
        )

    def _record(self, taken: Taken) -> None:
        """Write the text, and queue its readings and events."""
        if taken.text:
            self._sink.write(taken.text)
        for event in taken.events:
            if event.kind == "settled":
                self._waiting.append(event)
                self._waiting += self._unclear_event()
        if taken.readings is not None:
            self._waiting.append(taken.readings)
        self._waiting += [event for event in taken.events if event.kind != "settled"]

    def _unclear_event(self) -> Iterator[FeedEvent]:
        """Yield an event if lines arrive whose columns of the field are unknown."""
        form = self.statistics.form
        if form is not None and not self.statistics.unit:
            yield FeedEvent(
                "unclear",
                self._now(),
                "lines of numbers arrive, but the columns of the magnetometer are unclear: start again with --columns "
                f"X,Y,Z, three of {form.header}, and with --unit; the lines are recorded",
            )

    def _try_again(self, timeout: float) -> None:
        """Try to open the source again, at increasing intervals."""
        due, pause = self._retry or (0.0, FIRST_RETRY_S)
        left = due - self._clock()
        if left > 0:
            time.sleep(min(left, timeout))
        self.statistics.seconds = self._now()
        if left > timeout:
            return
        self._retry = (self._clock() + min(2 * pause, LAST_RETRY_S), min(2 * pause, LAST_RETRY_S))
        with contextlib.suppress(LinkError):
            self._source.reopen()
            self._retry = None
            self._record(self._transcript.back(self._now()))
            self._waiting.append(FeedEvent("back", self._now(), f"{self.name} is back"))

    def _end(self) -> None:
        self._record(self._transcript.end(self._now()))
        self._note_lost()
        self._sink.sync()


RECOGNITION_ROWS: Final = 20  # Count of rows by which the format of a continued recording is recognised
MIN_RESUME_GAP_S: Final = 0.001  # Smallest time between its last row and the next
TIME_CELL: Final = re.compile(r'"?(\d+[.,]\d{4})')  # Start of a row with a time of arrival
RETRY_S: Final = 3.0  # Time after which a failed write is tried again
MAX_WAITING_CHARACTERS: Final = 64 << 20  # Largest count of characters that wait meanwhile
TAIL_BYTES: Final = 1 << 16  # Bytes at the end in which the last complete line is searched
START_LINE: Final = re.compile(r"^# flinders \S+ record: .*, begun (\S+)$", re.MULTILINE)


class Sink(Protocol):
    """Destination of a recording; `why` is the reason why it cannot be written now, empty if it can."""

    name: str
    why: str

    def write(self, text: str) -> None:
        """Write text immediately; `OutputError` if that is impossible."""

    def sync(self) -> None:
        """Start forcing the text to the disk, without waiting."""


@dataclass(frozen=True, slots=True)
class ResumedRecording:
    """Properties of a recording that are needed to continue it.

    `header` is the line above its rows, possibly empty; None if there are no `rows`, of which the first are stored.
    `seconds` is the time from its start to now, at least its last time if that is a time of arrival.
    """

    header: str | None
    rows: tuple[str, ...]
    seconds: float

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Self:
        """Inspect a recording of `Recorder`; `OutputError` if there is none, or the file is another one."""
        file = Path(path)
        try:
            with file.open("rb") as content:
                head = content.read(TAIL_BYTES).decode("utf-8", "replace")
                content.seek(max(file.stat().st_size - TAIL_BYTES, 0))
                tail = content.read().decode("utf-8", "replace")
        except OSError as error:
            raise OutputError(f"{path}: cannot be continued: {reason_and_remedy(error)}") from None
        begun = START_LINE.search(head)
        if begun is None:
            raise OutputError(
                f"{path} is no recording of flinders record (its first line is missing): give such a recording, or a "
                "new file"
            )
        whole = head.rpartition("\n")[0].splitlines()
        lines = [line for line in whole if line.strip() and not line.startswith("#")]
        since = (datetime.now(UTC) - datetime.fromisoformat(begun[1])).total_seconds()
        if not lines:
            return cls(None, (), max(since, 0.0))
        is_row = lines[0].lstrip('"')[:1].isdigit() or lines[0][:1] in "-+."
        header = "" if is_row else lines[0]
        last = _last_time(tail) if header.startswith("t_s") else 0.0
        return cls(header, tuple(lines[not is_row :][:RECOGNITION_ROWS]), max(since, last + MIN_RESUME_GAP_S))


class FileSink:
    r"""Sink into a new file without buffering, or at the end of a recording that a crash has ended.

    Parameters
    ----------
    path : str or path
    force : bool
        Replace an existing file.
    resume : bool
        Continue at the end of the existing file; an incomplete last line is made a comment.

    Raises
    ------
    OutputExists, OutputError
        If the file exists or cannot be created.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "tumble.csv"
    >>> with FileSink(path) as sink:
    ...     sink.write("217,4,-586\n")
    ...     path.read_text()                                           # it is there at once
    '217,4,-586\n'
    >>> _ = path.write_text("t_s,mag_x,mag_y,mag_z\n0.1,217,4,-586\n0.2,217,2,-5")
    >>> with FileSink(path, resume=True) as sink:
    ...     sink.write("0.3,217,4,-586\n")
    >>> print(path.read_text())
    t_s,mag_x,mag_y,mag_z
    0.1,217,4,-586
    # cut off: 0.2,217,2,-5
    0.3,217,4,-586
    <BLANKLINE>
    """

    def __init__(self, path: str | os.PathLike[str], *, force: bool = False, resume: bool = False) -> None:
        self.name, self.why = os.fspath(path), ""
        refuse_existing(path, force=force or resume)
        try:
            flags = os.O_RDWR | os.O_APPEND | (0 if resume else os.O_CREAT if force else os.O_CREAT | os.O_EXCL)
            self._file = os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666)
            self._lock()
        except FileExistsError:
            raise OutputExists(path) from None
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be written: {reason_and_remedy(error)}") from None
        self._syncing = ThreadPoolExecutor(1, "sync")  # a slow disk must not delay reading a port
        self._pending: Future[None] | None = None
        self._bytes = 0
        self._is_over, self._is_new = force, not (force or resume)
        if resume:
            self._comment_incomplete_line()

    def write(self, text: str) -> None:
        """As `Sink.write`; lines that do not fit on the disk are not written partly."""
        content = memoryview(text.encode())
        with self._failures():
            if self._is_over:  # the old file is replaced only when there is new text
                os.ftruncate(self._file, 0)
                self._is_over = False
            whole = os.fstat(self._file).st_size
            try:
                while content:
                    content = content[os.write(self._file, content) :]
            except OSError:
                with contextlib.suppress(OSError):  # half a line would be read as other numbers
                    os.ftruncate(self._file, whole)
                raise
        self._bytes += len(text.encode())

    def sync(self) -> None:
        """As `Sink.sync`, in the background; a call during a running sync does nothing."""
        if self._pending is None or self._pending.done():
            self._finish()
            self._pending = self._syncing.submit(os.fsync, self._file)

    def close(self) -> None:
        """Wait until everything is on the disk; remove an empty new file."""
        try:
            self._finish()
            with self._failures():
                os.fsync(self._file)
        finally:
            self._syncing.shutdown()
            is_empty = self._is_new and not os.fstat(self._file).st_size
            os.close(self._file)
            if is_empty:
                Path(self.name).unlink(missing_ok=True)

    def _lock(self) -> None:
        """Lock the file against other recorders."""
        if not try_lock(self._file):  # Windows excludes other writers itself
            os.close(self._file)
            raise OutputError(f"{self.name}: another program is recording into it: stop it, or name another file")

    def _comment_incomplete_line(self) -> None:
        """Make a comment of an incomplete last line, as a crash leaves it."""
        with self._failures():
            size = os.fstat(self._file).st_size
            start, tail = size, b""
            while start and b"\n" not in tail:
                start = max(start - TAIL_BYTES, 0)
                os.lseek(self._file, start, os.SEEK_SET)
                tail = os.read(self._file, size - start)
            torn = tail.rpartition(b"\n")[2]
            if torn:
                os.ftruncate(self._file, size - len(torn))
                comment = torn if torn.startswith(b"#") else f"# cut off: {escape_bytes(torn)}".encode()
                os.write(self._file, comment + b"\n")

    def _finish(self) -> None:
        with self._failures():
            if self._pending is not None:
                self._pending.result()
        self._pending = None

    @contextlib.contextmanager
    def _failures(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno == errno.EINVAL:  # a device that cannot be synced
                return
            raise OutputError(
                f"{self.name}: cannot be written: {reason_and_remedy(error)}; "
                f"the {self._bytes:,} bytes before are saved"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.nullcontext() if error is None else contextlib.suppress(OutputError):
            self.close()


class RetryingSink:
    r"""A sink for a disk that may be full: text that cannot be written waits, and is tried again every 3 s.

    Parameters
    ----------
    sink : FileSink
    say : callable
        Called with the reason, and when writing continues.
    clock : callable
        Seconds, ascending.

    Attributes
    ----------
    missing : str
        Reason why some text is not on the disk, even if later text is; empty if all is.

    Examples
    --------
    >>> class Full:
    ...     name = "a.csv"
    ...     def write(self, text):
    ...         raise OutputError("a.csv: cannot be written: No space left on device")
    >>> sink = RetryingSink(Full(), print)
    >>> sink.write("217,4,-586\n")
    ! a.csv: cannot be written: No space left on device. It is held and tried again; make room on the disk
    >>> sink.why
    'a.csv: cannot be written: No space left on device'
    """

    def __init__(
        self, sink: FileSink, say: Callable[[str], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.name, self.why, self.missing = sink.name, "", ""
        self._sink, self._say, self._clock = sink, say, clock
        self._waiting: list[str] = []
        self._size, self._tried = 0, -math.inf

    def write(self, text: str) -> None:
        """As `Sink.write`; nothing is raised."""
        self._waiting.append(text)
        self._size += len(text)
        if not self.why or self._clock() - self._tried >= RETRY_S:
            self._try()
        if self._size > MAX_WAITING_CHARACTERS:
            self._waiting, self._size = [], 0
            self.missing = f"{self.why}; {MAX_WAITING_CHARACTERS >> 20} MB received since are lost"
            self._say(f"! {self.missing}")

    def sync(self) -> None:
        """As `Sink.sync`; nothing is raised."""
        if self.why:
            return
        try:
            self._sink.sync()
        except OutputError as error:
            self.missing = error.message
            self._fail(error)

    def close(self) -> None:
        """Try a last time; `OutputError` if the file lacks received text."""
        if self._waiting:
            self._try()
        self._sink.close()
        if self._waiting or self.missing:
            raise OutputError(f"{self.missing or self.why}; the recording is incomplete")

    def _try(self) -> None:
        self._tried = self._clock()
        try:
            self._sink.write("".join(self._waiting))
        except OutputError as error:
            self._fail(error)
            return
        self._waiting, self._size = [], 0
        if self.why:
            self.why = ""
            self._say(f"{self.name}: is written again{'' if self.missing else ', and nothing is missing'}")

    def _fail(self, error: OutputError) -> None:
        self._tried = self._clock()
        if not self.why:
            self._say(f"! {error.message}. It is held and tried again; make room on the disk")
        self.why = error.message


def title(name: str, *, is_new: bool) -> str:
    """First line of a recording, with its source and start time."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"# flinders {version('flinders')} record: {name}, {'begun' if is_new else 'resumed'} {now}\n"


def _last_time(tail: str) -> float:
    """Time of the last complete row; 0 if there is none."""
    for line in reversed(tail.rpartition("\n")[0].splitlines()):
        match = TIME_CELL.match(line)
        if match:
            return float(match[1].replace(",", "."))
    return 0.0


class StandardOutputSink:
    """Sink into standard output, for a pipe; `OutputError` if it is closed."""

    name, why = "standard output", ""

    def __init__(self) -> None:
        if sys.__stdout__ is None:
            raise OutputError(f"{self.name} is closed: name a file with -o")

    def write(self, text: str) -> None:
        """As `Sink.write`."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError as error:
            why = "the reading program has ended" if isinstance(error, BrokenPipeError) else reason_and_remedy(error)
            raise OutputError(f"{self.name} cannot be written: {why}") from None

    def sync(self) -> None:
        """Do nothing, as standard output is not a file on disk."""


class NullSink:
    """A sink for readings that are not stored."""

    name, why = "nowhere", ""

    def write(self, text: str) -> None:
        """As `Sink.write`."""

    def sync(self) -> None:
        """As `Sink.sync`."""


class RecordedFeed:
    """Feed that records another feed as a table for `flinders.read`; events become comments.

    Parameters
    ----------
    feed : Feed
    sink : Sink
    resumed : ResumedRecording, optional
        The recording that is continued, of which `sink` is the file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders import read, simulate
    >>> from flinders.links.feeds import Replay
    >>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
    >>> tumble = simulate.tumble(seed=1, n=400).samples
    >>> with FileSink(file) as sink:
    ...     feed = RecordedFeed(Replay(tumble, speed=None), sink)
    ...     while not (isinstance(got := feed.next(0.1), FeedEvent) and got.kind == "ended"):
    ...         pass
    >>> abs(read(file).field - tumble.field).max() < 1e-6
    np.True_
    """

    def __init__(self, feed: Feed, sink: Sink, *, resumed: ResumedRecording | None = None) -> None:
        self._feed, self._sink = feed, sink
        self._header = resumed.header if resumed else None
        self._is_checked = self._header is None
        self._title = title(feed.name, is_new=resumed is None)
        self._synced = time.monotonic()

    @property
    def name(self) -> str:
        """Name of the feed."""
        return self._feed.name

    def next(self, timeout: float) -> Received:
        """As `Feed.next`; `OutputError` if the columns differ from those of the continued recording."""
        received = self._feed.next(timeout)
        if isinstance(received, FeedEvent):
            self._write("".join(f"# {line}\n" for line in str(received).splitlines()))
        elif received is not None:
            self._write(self._rows(received))
        if time.monotonic() - self._synced >= SYNC_S:
            self._synced = time.monotonic()
            self._sink.sync()
        return received

    def close(self) -> None:
        """As `Feed.close`."""
        self._sink.sync()
        self._feed.close()

    def _write(self, text: str) -> None:
        self._sink.write(self._title + text)
        self._title = ""

    def _rows(self, samples: Samples) -> str:
        columns = _columns(samples)
        header = ",".join(columns)
        if not self._is_checked and header != self._header:
            raise OutputError(
                f"{self.name} has the columns {header}, the continued recording {self._header or 'no header'}: "
                "start another recording"
            )
        is_new, self._is_checked = self._header is None, True
        self._header = self._header or header  # a column that is sometimes missing stays as in the first block
        nothing = np.full(len(samples), np.nan)
        rows = zip(*[columns.get(name, nothing).tolist() for name in self._header.split(",")], strict=True)
        text = "".join(f"{at:.6f},{','.join(f'{value:.9g}' for value in rest)}\n" for at, *rest in rows)
        return f"{self._header}\n{text}" if is_new else text


def _columns(samples: Samples) -> dict[str, Floats]:
    """Columns of a recorded feed, by their names."""
    unit = "uT" if samples.unit.inside == MICROTESLA else "counts"
    tables = {
        "t_s": samples.time,
        f"mag_x_{unit},mag_y_{unit},mag_z_{unit}": samples.field,
        "accel_x,accel_y,accel_z": samples.acceleration,
        "gyro_x_radps,gyro_y_radps,gyro_z_radps": samples.rate,
        "temp_C": samples.temperature,
    }
    columns: dict[str, Floats] = {}
    for names, table in tables.items():
        if table is not None:
            columns |= zip(names.split(","), np.atleast_2d(table.T), strict=True)
    return columns
