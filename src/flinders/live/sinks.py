r"""Where a recording goes: a file that lasts, or what follows in a pipe.

>>> import tempfile
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> with ToFile(path) as sink:
...     sink.write("217,4,-586\n")
...     path.read_text()                                           # it is there at once
'217,4,-586\n'

A recording that a crash has ended is continued where it ends:

>>> _ = path.write_text("t_s,mag_x,mag_y,mag_z\n0.1,217,4,-586\n0.2,217,2,-5")
>>> with ToFile(path, resume=True) as sink:
...     sink.write("0.3,217,4,-586\n")
>>> print(path.read_text())
t_s,mag_x,mag_y,mag_z
0.1,217,4,-586
# cut off: 0.2,217,2,-5
0.3,217,4,-586
<BLANKLINE>
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol, Self

from flinders.core.files import reason, refuse_existing
from flinders.errors import OutputError, OutputExists
from flinders.live.transcript import escaped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType


ROWS: Final = 20
"""Rows by which a recording is recognised that is continued."""
GAP_S: Final = 0.001
"""Seconds between its last row and the next, at least."""
TIME: Final = re.compile(r'"?(\d+[.,]\d{4})')
"""What a row begins with whose time was put in front."""
AGAIN_S: Final = 3.0
"""Seconds after which what could not be written is tried again."""
MOST_WAITING: Final = 64 << 20
"""Characters that wait meanwhile, at most."""
TAIL: Final = 1 << 16
"""Bytes that are looked at for the end of the last whole line."""
BEGUN: Final = re.compile(r"^# flinders \S+ record: .*, begun (\S+)$", re.MULTILINE)


class Sink(Protocol):
    """Where a recording goes."""

    name: str

    def write(self, text: str) -> None:
        """Hand text on at once.

        Raises
        ------
        OutputError
            Where it cannot be written.
        """

    def sync(self) -> None:
        """See that it lasts, without waiting for it."""


@dataclass(frozen=True, slots=True)
class Resumed:
    """What has to be known of a recording to continue it.

    Attributes
    ----------
    header : str, optional
        What stands above its rows, which may be nothing; None where it has no rows.
    rows : tuple of str
        The first of them.
    seconds : float
        From its beginning to now, and no less than its last time where that is given by the recorder.
    """

    header: str | None
    rows: tuple[str, ...]
    seconds: float

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Self:
        """Look at a recording that `Recorder` has made, by whatever it was ended.

        Raises
        ------
        OutputError
            Where there is none, or it is something else.
        """
        file = Path(path)
        try:
            with file.open("rb") as content:
                head = content.read(TAIL).decode("utf-8", "replace")
                content.seek(max(file.stat().st_size - TAIL, 0))
                tail = content.read().decode("utf-8", "replace")
        except OSError as error:
            raise OutputError(f"{path}: cannot be continued: {reason(error)}") from None
        begun = BEGUN.search(head)
        if begun is None:
            raise OutputError(
                f"{path} is no recording of flinders record (none begins it): record into a file of its own"
            )
        whole = head.rpartition("\n")[0].splitlines()
        lines = [line for line in whole if line.strip() and not line.startswith("#")]
        since = (datetime.now(UTC) - datetime.fromisoformat(begun[1])).total_seconds()
        if not lines:
            return cls(None, (), max(since, 0.0))
        is_row = lines[0].lstrip('"')[:1].isdigit() or lines[0][:1] in "-+."
        header = "" if is_row else lines[0]
        last = _last_time(tail) if header.startswith("t_s") else 0.0
        return cls(header, tuple(lines[not is_row :][:ROWS]), max(since, last + GAP_S))


class ToFile:
    """A new file, written without a buffer of its own.

    Parameters
    ----------
    path : str or path
    force : bool
        Begin anew where there is a file already.
    resume : bool
        Go on at the end of the file that there is; a last line without its end is made a comment.

    Raises
    ------
    OutputExists, OutputError
        Where it cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], *, force: bool = False, resume: bool = False) -> None:
        self.name = os.fspath(path)
        refuse_existing(path, force=force or resume)
        try:
            flags = os.O_RDWR | os.O_APPEND | (0 if resume else os.O_CREAT if force else os.O_CREAT | os.O_EXCL)
            self._file = os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666)
            self._lock()
        except FileExistsError:
            raise OutputExists(path) from None
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be written: {reason(error)}") from None
        self._syncing = ThreadPoolExecutor(1, "sync")  # a slow disk must not keep a port from being read
        self._pending: Future[None] | None = None
        self._bytes = 0
        self._is_over, self._is_resumed = force, resume
        if resume:
            self._mend()

    def write(self, text: str) -> None:
        """As `Sink.write`; of lines that do not fit on the disk none is begun."""
        content = memoryview(text.encode())
        with self._failures():
            if self._is_over:  # what was there before goes when there is something in its place
                os.ftruncate(self._file, 0)
                self._is_over = False
            whole = os.fstat(self._file).st_size
            try:
                while content:
                    content = content[os.write(self._file, content) :]
            except OSError:
                with contextlib.suppress(OSError):  # half a line would read as other numbers
                    os.ftruncate(self._file, whole)
                raise
        self._bytes += len(text.encode())

    def sync(self) -> None:
        """As `Sink.sync`: in the background, and not again before it is done."""
        if self._pending is None or self._pending.done():
            self._finish()
            self._pending = self._syncing.submit(os.fsync, self._file)

    def close(self) -> None:
        """Wait until all of it is on the disk."""
        try:
            self._finish()
            with self._failures():
                os.fsync(self._file)
        finally:
            self._syncing.shutdown()
            os.close(self._file)

    def _lock(self) -> None:
        """See that nobody else records into the file.

        Raises
        ------
        OutputError
        """
        try:
            import fcntl
        except ImportError:  # Windows keeps others out by itself
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise OutputError(
                f"{self.name}: another program is recording into it: stop that one, or name another file"
            ) from None
        except OSError:  # a file system without locks
            return

    def _mend(self) -> None:
        """Make a comment of a last line without its end, which a crash has left."""
        with self._failures():
            size = os.fstat(self._file).st_size
            start, tail = size, b""
            while start and b"\n" not in tail:
                start = max(start - TAIL, 0)
                os.lseek(self._file, start, os.SEEK_SET)
                tail = os.read(self._file, size - start)
            torn = tail.rpartition(b"\n")[2]
            if torn:
                os.ftruncate(self._file, size - len(torn))
                comment = torn if torn.startswith(b"#") else f"# cut off: {escaped(torn)}".encode()
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
                f"{self.name}: cannot be written: {reason(error)}; the {self._bytes:,} bytes before are saved"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(OutputError):
            self.close()
        if not self._bytes and not self._is_over and not self._is_resumed:
            with contextlib.suppress(OSError):
                Path(self.name).unlink()


class Patient:
    r"""A sink that survives a full disk: text that cannot be written waits, and is tried again every few seconds.

    Parameters
    ----------
    sink : ToFile
    say : callable
        Told why, and when it goes on.
    clock : callable
        Seconds, ascending.

    Attributes
    ----------
    name : str
    why : str
        Why what comes cannot be written now; nothing where it can.
    missing : str
        Why something is not on the disk, also where what came later is; nothing where all is.

    Examples
    --------
    >>> class Full:
    ...     name = "a.csv"
    ...     def write(self, text):
    ...         raise OutputError("a.csv: cannot be written: No space left on device")
    >>> sink = Patient(Full(), print)
    >>> sink.write("217,4,-586\n")
    ! a.csv: cannot be written: No space left on device. It is held and tried again; make room on the disk
    >>> sink.why
    'a.csv: cannot be written: No space left on device'
    """

    def __init__(self, sink: ToFile, say: Callable[[str], object], clock: Callable[[], float] = time.monotonic) -> None:
        self.name, self.why, self.missing = sink.name, "", ""
        self._sink, self._say, self._clock = sink, say, clock
        self._waiting: list[str] = []
        self._size, self._tried = 0, -math.inf

    def write(self, text: str) -> None:
        """As `Sink.write`; nothing is raised."""
        self._waiting.append(text)
        self._size += len(text)
        if not self.why or self._clock() - self._tried >= AGAIN_S:
            self._try()
        if self._size > MOST_WAITING:
            self._waiting, self._size = [], 0
            self.missing = f"{self.why}; {MOST_WAITING >> 20} MB that came since are lost"
            self._say(f"! {self.missing}")

    def sync(self) -> None:
        """As `Sink.sync`; nothing is raised."""
        if self.why:
            return
        try:
            self._sink.sync()
        except OutputError as error:
            self.missing = str(error)
            self._fail(error)

    def close(self) -> None:
        """Try a last time.

        Raises
        ------
        OutputError
            Where not all that came is in the file.
        """
        if self._waiting:
            self._try()
        self._sink.close()
        if self._waiting or self.missing:
            raise OutputError(f"{self.missing or self.why}; the recording is not whole")

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
            self._say(f"! {error}. It is held and tried again; make room on the disk")
        self.why = str(error)


def title(name: str, *, is_new: bool) -> str:
    """Write the first line of a recording: what it is of, and since when."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"# flinders {version('flinders')} record: {name}, {'begun' if is_new else 'resumed'} {now}\n"


def _last_time(tail: str) -> float:
    """The time of the last whole row; 0 where there is none."""
    for line in reversed(tail.rpartition("\n")[0].splitlines()):
        match = TIME.match(line)
        if match:
            return float(match[1].replace(",", "."))
    return 0.0


class ToStandardOutput:
    """Standard output, for what follows in a pipe.

    Raises
    ------
    OutputError
        Where it is closed.
    """

    name = "standard output"

    def __init__(self) -> None:
        if sys.__stdout__ is None:
            raise OutputError(f"{self.name} is closed: name a file with -o")

    def write(self, text: str) -> None:
        """As `Sink.write`."""
        try:
            sys.stdout.write(text)
            sys.stdout.flush()
        except OSError as error:
            why = "whoever read it has gone" if isinstance(error, BrokenPipeError) else reason(error)
            raise OutputError(f"{self.name} cannot be written: {why}") from None

    def sync(self) -> None:
        """Nothing to do."""
