"""Sinks of a recording: a file that is safe on disk within 1 s, one whose text waits for room on the disk, or a pipe.

Text is passed to the operating system immediately and forced to the disk every second. A crash of the machine therefore
loses at most 1 s of a recording, and a killed program loses less.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol, Self

from flinders.core.files import reason_and_remedy, refuse_existing, try_lock
from flinders.errors import OutputError, OutputExists
from flinders.links.recording_text import TAIL_BYTES, escape_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

SYNC_S: Final = 1.0  # Interval at which the text of a recording is forced to the disk
RETRY_S: Final = 3.0  # Time after which a failed write is tried again
MAX_WAITING_CHARACTERS: Final = 64 << 20  # Largest number of characters that wait for room on the disk


class Sink(Protocol):
    """Destination of a recording; `why` says why it cannot be written now, and is empty if it can."""

    name: str
    why: str

    def write(self, text: str) -> None:
        """Write text at once; `OutputError` if that is impossible."""

    def sync(self) -> None:
        """Start to force the text to the disk, without waiting for it."""


class FileSink:
    r"""Sink into a file, without buffering: a new file, or the end of a recording that a crash has ended.

    Parameters
    ----------
    path : str or path
    force : bool
        Replace an existing file.
    resume : bool
        Continue at the end of the existing file. An incomplete last line becomes a comment.

    Raises
    ------
    OutputExists, OutputError
        If the file exists, or cannot be created.

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
        self._syncing = ThreadPoolExecutor(1, "sync")  # a slow disk must not delay the reading of a port
        self._pending: Future[None] | None = None
        self._bytes = 0
        self._is_over, self._is_new = force, not (force or resume)
        if resume:
            self._comment_incomplete_line()

    def write(self, text: str) -> None:
        """As `Sink.write`; text that does not fit on the disk is not written at all."""
        content = memoryview(text.encode())
        with self._failures():
            if self._is_over:  # the old file is emptied only when there is new text
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
        """As `Sink.sync`, in the background; does nothing while an earlier call is still running."""
        if self._pending is None or self._pending.done():
            self._finish()
            self._pending = self._syncing.submit(os.fsync, self._file)

    def close(self) -> None:
        """Wait until everything is on the disk; a new file that is empty is removed."""
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
        if not try_lock(self._file):  # on Windows the system excludes other writers
            os.close(self._file)
            raise OutputError(f"{self.name}: another program is recording into it: stop it, or name another file")

    def _comment_incomplete_line(self) -> None:
        """Make a comment of an incomplete last line, which a crash leaves."""
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
        Called with the reason when a write fails, and again when writing continues.
    clock : callable
        Time in s, ascending.

    Attributes
    ----------
    missing : str
        Why some text is missing on the disk, even if later text is there; empty if nothing is missing.

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
        """As `Sink.write`; a failure is not raised."""
        self._waiting.append(text)
        self._size += len(text)
        if not self.why or self._clock() - self._tried >= RETRY_S:
            self._try()
        if self._size > MAX_WAITING_CHARACTERS:
            self._waiting, self._size = [], 0
            self.missing = f"{self.why}; {MAX_WAITING_CHARACTERS >> 20} MB received since are lost"
            self._say(f"! {self.missing}")

    def sync(self) -> None:
        """As `Sink.sync`; a failure is not raised."""
        if self.why:
            return
        try:
            self._sink.sync()
        except OutputError as error:
            self.missing = error.message
            self._fail(error)

    def close(self) -> None:
        """Try a last time to write; `OutputError` if the file lacks some of the received text."""
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


class StandardOutputSink:
    """Sink into standard output, for a pipe; `OutputError` if standard output is closed."""

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
        """Do nothing, since standard output is not a file on disk."""


class NullSink:
    """A sink for readings that are not stored."""

    name, why = "nowhere", ""

    def write(self, text: str) -> None:
        """As `Sink.write`."""

    def sync(self) -> None:
        """As `Sink.sync`."""
