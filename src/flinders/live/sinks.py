r"""Where a recording goes: a file that lasts, or what follows in a pipe.

>>> import tempfile
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> with ToFile(path) as sink:
...     sink.write("217,4,-586\n")
...     path.read_text()                                           # it is there at once
'217,4,-586\n'
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

from flinders.errors import OutputError, OutputExists
from flinders.files import reason, refuse_existing

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType


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


class ToFile:
    """A new file, written without a buffer of its own.

    Parameters
    ----------
    path : str or path
    force : bool
        Begin anew where there is a file already.

    Raises
    ------
    OutputExists, OutputError
        Where it cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        self.name = os.fspath(path)
        refuse_existing(path, force=force)
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (0 if force else os.O_EXCL)
            self._file = os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666)
        except FileExistsError:
            raise OutputExists(path) from None
        except OSError as error:
            raise OutputError(f"{self.name}: cannot be written: {reason(error)}") from None
        self._syncing = ThreadPoolExecutor(1, "sync")  # a slow disk must not keep a port from being read
        self._pending: Future[None] | None = None
        self._bytes = 0
        self._is_over = force

    def write(self, text: str) -> None:
        """As `Sink.write`."""
        content = memoryview(text.encode())
        with self._failures():
            if self._is_over:  # what was there before goes when there is something in its place
                os.ftruncate(self._file, 0)
                self._is_over = False
            while content:
                content = content[os.write(self._file, content) :]
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
        if not self._bytes and not self._is_over:
            with contextlib.suppress(OSError):
                Path(self.name).unlink()


class ToStandardOutput:
    """Standard output, for what follows in a pipe."""

    name = "standard output"

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
