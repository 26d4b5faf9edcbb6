"""Bytes of a recording, from a file or a pipe, and the lines in them: as often as asked, in bounded memory.

What cannot be read twice (standard input, a named pipe) is first copied to a temporary file, which
goes when the `Source` does. Gzip is recognised by its first bytes. Lines end with LF, CR LF or CR;
one longer than `LONGEST` is cut, so a file without line ends costs no more memory than any other.
"""

from __future__ import annotations

import codecs
import contextlib
import gzip
import io
import os
import stat
import sys
import tempfile
import weakref
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, NamedTuple, cast

from flinders.errors import UnreadableInput
from flinders.readers._kinds import GZIP, foreign_kind
from flinders.samples import BLOCK

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator

HEAD: Final = 1 << 16
"""Bytes looked at to tell what a file is, and how its text is encoded."""
CHUNK: Final = 1 << 18
"""Bytes read at a time."""
LONGEST: Final = 1 << 20
"""Characters in the longest line that is kept whole."""
MOST_IN_BLOCK: Final = 1 << 23
"""Characters after which a block of lines ends early."""
CUT: Final = 60
"""Characters shown of a line in a message."""
CUT_OFF: Final = "…"
"""What stands at the end of a line that was longer than `LONGEST`."""


class Lines(NamedTuple):
    """A stretch of lines: the number of the first, their texts without line ends, bytes of the file read so far."""

    first: int
    texts: list[str]
    done: int


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class Source:
    """A file that stays where it is while it is being read.

    Attributes
    ----------
    name : str
        For messages.
    path : Path
        Where the bytes lie: the file itself, or its copy in a temporary file.
    size : int, bytes
        As it lies on the disk, compressed or not.
    """

    name: str
    path: Path
    size: int

    def head(self) -> bytes:
        """Return the first `HEAD` bytes, unpacked."""
        with self.opened() as (_, stream):
            return _read(self.name, stream, HEAD)

    @contextlib.contextmanager
    def opened(self) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
        """Open the file, giving it as it lies on the disk and unpacked.

        Raises
        ------
        UnreadableInput
            Where it is gone, or may not be read.
        """
        try:
            raw = self.path.open("rb")
        except OSError as error:
            raise refusal(self.name, error) from None
        with raw:
            start = _read(self.name, raw, 2)
            raw.seek(0)
            if start == GZIP:
                yield raw, cast("IO[bytes]", gzip.GzipFile(fileobj=raw))
            else:
                yield raw, raw

    def lines(self, encoding: str) -> Generator[Lines, None, None]:
        """Yield all lines, `BLOCK` at a time.

        Raises
        ------
        UnreadableInput
            Where the file cannot be opened, or its gzip data are broken.
        """
        with self.opened() as (raw, stream):
            first = 1
            pending: list[str] = []
            characters = 0
            for texts in _split(_decoded(self._chunks(stream), encoding)):
                pending += texts
                characters += sum(map(len, texts))
                while len(pending) >= BLOCK or characters > MOST_IN_BLOCK:
                    yield Lines(first, pending[:BLOCK], raw.tell())
                    first += len(pending[:BLOCK])
                    del pending[:BLOCK]
                    characters = sum(map(len, pending))
            if pending:
                yield Lines(first, pending, self.size)

    def _chunks(self, stream: IO[bytes]) -> Iterator[bytes]:
        while chunk := _read(self.name, stream, CHUNK):
            yield chunk


def find(path: str | os.PathLike[str]) -> Source:
    """Find what a path names; ``"-"`` is standard input.

    Raises
    ------
    UnreadableInput
        For a path where there is nothing, nothing readable, a folder or an empty file.
    """
    text = os.fspath(path)
    if text == "-":
        return _standard_input()
    file, name = Path(text), shown(text)
    try:
        status = file.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            with file.open("rb") as stream:
                return spooled(file.name, _read_all(file.name, stream))
    except (OSError, ValueError) as error:
        raise refusal(name, error) from None
    if stat.S_ISDIR(status.st_mode):
        raise UnreadableInput(f"{name} is a folder: give the recording in it")
    if status.st_size == 0:
        raise UnreadableInput(f"{file.name} is empty: record again, or check what was saved")
    return Source(file.name, file, status.st_size)


def spooled(name: str, chunks: Iterable[bytes]) -> Source:
    """Copy what can be read only once to a temporary file, which is deleted with the source or at exit.

    Raises
    ------
    UnreadableInput
        Where nothing comes, what comes is not text, or the disk is full.
    """
    handle, place = tempfile.mkstemp(prefix="flinders-", suffix=".spool")
    path = Path(place)
    source: Source | None = None
    try:
        with os.fdopen(handle, "wb") as file:
            size = _copy(name, chunks, file)
        source = Source(name, path, size)
        weakref.finalize(source, path.unlink, missing_ok=True)
    except OSError as error:
        raise refusal(name, error) from None
    finally:
        if source is None:
            path.unlink(missing_ok=True)
    return source


def encoding_of(head: bytes) -> str:
    """Tell how text is encoded: by its byte order mark, else UTF-8 where it decodes, else Latin-1."""
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF32_LE, "utf-32"),
        (codecs.BOM_UTF32_BE, "utf-32"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if head.startswith(mark):
            return encoding
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character cut off at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def newline_of(head: bytes) -> str:
    """Tell how the first line ends; LF where none does."""
    text = head.decode(encoding_of(head), "replace")
    ends = [(place, end) for end in ("\r\n", "\n", "\r") if (place := text.find(end)) >= 0]
    return min(ends, key=lambda found: found[0])[1] if ends else "\n"


def shown(text: str) -> str:
    """Cut a line to what fits in a message, without characters that a terminal would act on."""
    cut = text.strip()[: CUT + 1]
    clean = "".join(letter if letter.isprintable() else " " if letter == "\t" else "\ufffd" for letter in cut)
    return clean if len(clean) <= CUT else clean[: CUT - 1] + "…"


def refusal(name: str, error: OSError | ValueError) -> UnreadableInput:
    """Turn an error of the operating system into one line."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return UnreadableInput(f"{name} does not exist: check the name and the folder")
        case PermissionError():
            return UnreadableInput(f"{name} may not be read: ask for permission, or copy it to where you may")
        case OSError():
            return UnreadableInput(f"{name} cannot be read: {error.strerror or error}; try a copy of it")
        case _:
            return UnreadableInput(f"{name} is not a file name: {error}")


def _standard_input() -> Source:
    name = "standard input"
    if sys.stdin is None or sys.stdin.closed:
        raise UnreadableInput(f"{name} is closed: pipe a recording in, or give a file name")
    stream = getattr(sys.stdin, "buffer", None)
    chunks = iter(lambda: sys.stdin.read(CHUNK).encode(), b"") if stream is None else _read_all(name, stream)
    return spooled(name, chunks)


def _copy(name: str, chunks: Iterable[bytes], file: IO[bytes]) -> int:
    """Write chunks to a file and count bytes; a stream that is not a recording is refused at its first chunk."""
    size = 0
    for chunk in chunks:
        if size == 0 and not chunk.startswith(GZIP) and (kind := foreign_kind(chunk)):
            raise UnreadableInput(f"{name} is {kind.name}: {kind.advice}")
        size += file.write(chunk)
    if size == 0:
        raise UnreadableInput(f"{name} is empty: nothing was piped in")
    return size


def _read_all(name: str, stream: IO[bytes]) -> Iterator[bytes]:
    while chunk := _read(name, stream, CHUNK):
        yield chunk


def _read(name: str, stream: IO[bytes], size: int) -> bytes:
    try:
        return stream.read(size)
    except EOFError:
        raise UnreadableInput(f"{name} is cut short: its gzip data have no end; copy it again") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise UnreadableInput(f"{name} has broken gzip data ({error}): copy it again") from None
    except OSError as error:
        raise refusal(name, error) from None


def _decoded(chunks: Iterator[bytes], encoding: str) -> Iterator[str]:
    """Decode chunk by chunk, with every line end as LF; bytes that mean nothing become U+FFFD."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)("replace"), translate=True)
    for chunk in chunks:
        yield decoder.decode(chunk)
    yield decoder.decode(b"", final=True)


def _split(texts: Iterator[str]) -> Iterator[list[str]]:
    """Cut text into lines; what exceeds `LONGEST` in a line is dropped, with a mark that no number has."""
    rest = ""
    for text in texts:
        lines = (rest + text).split("\n")
        rest = lines.pop()
        if lines:
            lines[0] = _shortened(lines[0])
        if len(rest) > LONGEST:
            rest = rest[: LONGEST + 1]
        yield lines
    if rest:
        yield [_shortened(rest)]


def _shortened(line: str) -> str:
    return line if len(line) <= LONGEST else line[:CUT] + CUT_OFF
