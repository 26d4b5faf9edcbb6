r"""Recordings of a station: readings go to the file of the unit under test, and are dropped between tests.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> sink = UnitSink(print)
>>> sink.write("# flinders 1.0 record: the board, begun\nt_s,mag_x,mag_y,mag_z\n0.1,20,4,-58\n")
>>> sink.begin(folder / "A17.csv", "the board")
>>> sink.write("0.2,21,4,-58\n")
>>> sink.end()
''
>>> print((folder / "A17.csv").read_text().partition("\n")[2])
t_s,mag_x,mag_y,mag_z
0.2,21,4,-58
<BLANKLINE>
>>> folder_of("A/17"), folder_of("..")
('A%2F17', '%2E.')
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from flinders.core.files import make_folder
from flinders.errors import LinkError, OutputError
from flinders.links.recording_text import title
from flinders.links.sinks import FileSink, RetryingSink

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.links.transports import ByteSource

MAX_LINE: Final = 4096  # Longest line in bytes that is searched for a serial number


def folder_of(serial: str) -> str:
    """Name of the folder of a unit: its serial number, with characters invalid in a path escaped as ``%2F``."""
    name = quote(serial, safe="+")
    return f"%2E{name[1:]}" if name.startswith(".") else name


class UnitSink:
    """A sink that writes to the file of the unit under test.

    Each file begins with the header that the recorder wrote once. All methods are called on one thread.
    """

    name = "the units' recordings"

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self._header: str | None = None
        self._sink: RetryingSink | None = None
        self.why = ""  #: as `Sink.why`

    def write(self, text: str) -> None:
        """As `Sink.write`."""
        if self._header is None:
            self._header = _header_in(text)
        if self._sink:
            self._sink.write(text)
            self.why = self._sink.why

    def sync(self) -> None:
        """As `Sink.sync`."""
        if self._sink:
            self._sink.sync()
            self.why = self._sink.why

    def begin(self, path: Path, source: str) -> None:
        """Start a new file; `OutputError` if it cannot be created."""
        self.end()
        make_folder(path.parent)
        self._sink = RetryingSink(FileSink(path), self._say)
        header = f"{self._header}\n" if self._header else ""
        self._sink.write(title(source, is_new=True) + header)

    def end(self) -> str:
        """Close the file once it is on the disk; returns the reason if readings are missing in it, else empty."""
        sink, self._sink, self.why = self._sink, None, ""
        if sink is None:
            return ""
        try:
            sink.close()
        except OutputError as error:
            return error.message
        return ""


def _header_in(text: str) -> str | None:
    """Find the header line in a recorder's text; empty if the rows have no header, None before the first row."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            return "" if line.lstrip('"')[:1].isdigit() or line[:1] in "-+." else line
    return None


class SerialNumberSource:
    r"""A source of bytes that also extracts the serial number of the board.

    >>> from flinders.links.transports import ScriptedSource
    >>> board = SerialNumberSource(ScriptedSource([b"serial: A", b"17\r\n1,2,3\n"]), r"serial: (\w+)")
    >>> board.read(0.1), board.serial, board.read(0.1), board.serial
    (b'serial: A', '', b'17\r\n1,2,3\n', 'A17')
    """

    def __init__(self, source: ByteSource, line: str) -> None:
        self._source, self._line, self._rest = source, re.compile(line), b""
        self.name, self.is_framed = source.name, source.is_framed
        self.serial = ""  #: last serial number of the board; empty after it was unplugged

    def read(self, timeout: float) -> bytes:
        """As `ByteSource.read`."""
        try:
            content = self._source.read(timeout)
        except LinkError:
            self.serial, self._rest = "", b""
            raise
        *lines, rest = (self._rest + content).split(b"\n")
        self._rest = rest[-MAX_LINE:]
        for line in lines:
            found = self._line.search(line[:MAX_LINE].decode("utf-8", "replace").strip())
            if found and found[1]:
                self.serial = found[1].strip()
        return content

    def write(self, content: bytes) -> None:
        """As `ByteSource.write`."""
        self._source.write(content)

    def reopen(self) -> None:
        """As `ByteSource.reopen`."""
        self._source.reopen()

    def close(self) -> None:
        """As `ByteSource.close`."""
        self._source.close()
