r"""Bytes of a file, read as often as needed, or of a pipe, read as they arrive.

Input that cannot be read twice (standard input, a named pipe, a serial port) is copied to a temporary file, which is
deleted together with its `File`. If one pass is enough, the input is read as a `ByteStream` instead, which stores
nothing. Gzip is recognised by its first bytes.

>>> piped = spool("-", [b"mx,my,mz\n", b"1,2,3\n"])
>>> piped.size, [lines.texts for lines in piped.lines("utf-8")]
(15, [['mx,my,mz', '1,2,3']])
"""

from __future__ import annotations

import contextlib
import functools
import gzip
import io
import itertools
import mmap
import os
import stat
import sys
import weakref
import zlib
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, ParamSpec, TypeAlias, TypeVar, cast

from flinders.core.files import REASONS_BY_ERRNO, is_bomb, limit_size, reason_and_remedy
from flinders.errors import UnreadableInput, UsageError
from flinders.foreign_errors import parser_errors
from flinders.readers._foreign_files import refuse_foreign
from flinders.readers._lines import EndsEarly, Lines, encoding_of, lines_of
from flinders.readers._tokenizer import shorten, split_line

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from _typeshed import WriteableBuffer

P = ParamSpec("P")
Item = TypeVar("Item")
Progress: TypeAlias = "Callable[[int, int | None], None]"
"""Called once per block with the bytes read so far and the total, or None if the total is unknown."""
GZIP: Final = b"\x1f\x8b"
HEAD_BYTES: Final = 1 << 16
"""Number of first bytes by which the format and the encoding of a file are recognised."""
END_BYTES: Final = 1 << 14
"""Number of bytes at each end of a file that are compared, to distinguish growth from overwriting."""
CHUNK_BYTES: Final = 1 << 18
"""Number of bytes per read."""
MAX_SPOOLED_BYTES: Final = 64 << 30
"""Largest size of a temporary copy in bytes. A longer pipe is refused, as it may be endless."""
MAX_MEMBER_BYTES: Final = 4 << 30
"""Largest unpacked size in bytes of a member of an archive, or of a packed file of a ROS 2 recording."""
MAX_MESSAGE_BYTES: Final = 1 << 16
"""Largest size in bytes of a message in a log: its length field has at most two bytes."""
MIN_ROWS, MIN_LINES = 20, 400
"""Number of rows of numbers with one width, or of lines, that are enough to recognise the format of a stream."""
EMPTY_PIPE_MESSAGE: Final = "nothing was piped in"
MIN_NUMBERS: Final = 3
"""Smallest number of numbers in a line that is a reading."""


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class File:
    """A file whose content must not change while it is read."""

    name: str  # for messages
    path: Path  # location of the bytes: the file itself or its temporary copy
    size: int  # size on disk in bytes, compressed or not
    status: os.stat_result | None = None  # status of the file when it was found; None for a private copy
    ends: bytes = b""  # its first and last bytes when it was found

    def is_packed(self) -> bool:
        """Whether the file on disk is compressed with gzip; raises the errors of `open_streams`."""
        with self.open_streams() as (_, unpacked):
            return isinstance(unpacked, gzip.GzipFile)

    def head(self) -> bytes:
        """Return the first `HEAD_BYTES` bytes, unpacked."""
        head = b""
        with self.open_streams() as (_, unpacked):
            try:
                for chunk in _chunks(self.name, unpacked.read1):
                    head += chunk
                    if len(head) >= HEAD_BYTES:
                        break
            except EndsEarly as cut:
                if not head:
                    raise cut.refusal(self.name) from None
        return head[:HEAD_BYTES]

    def opening(self, encoding: str) -> tuple[list[str], bool]:
        """The first block of lines, and whether these are all lines."""
        with contextlib.closing(self.lines(encoding)) as blocks:
            first = next(blocks, Lines(1, "", 0, 0))
            return first.texts, next(blocks, None) is None

    def last_lines(self, encoding: str) -> list[str]:
        """The complete lines among the last bytes; none for a compressed file."""
        return [] if self.is_packed() else self.ends[-END_BYTES:].decode(encoding, "replace").splitlines()[1:]

    @contextlib.contextmanager
    def open_streams(self) -> Iterator[tuple[io.BufferedReader, io.BufferedIOBase]]:
        """Open the file, and yield two streams of bytes, raw and unpacked; `UnreadableInput` if it cannot be read."""
        try:
            raw: Any = io.BufferedReader(UpTo(self.path, self.status.st_size if self.status else None))
        except OSError as error:
            raise refusal(self.name, error) from None
        with raw:
            start = _read(self.name, raw.read, len(GZIP))
            raw.seek(0)
            yield raw, gzip.GzipFile(fileobj=raw) if start == GZIP else raw

    @contextlib.contextmanager
    def mapped_bytes(self) -> Iterator[mmap.mmap]:
        """Map the raw bytes of the file into memory; raises the errors of `open_streams`."""
        with contextlib.ExitStack() as opened:
            try:
                stream = opened.enter_context(self.path.open("rb"))
                content = opened.enter_context(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
            except (OSError, ValueError) as error:
                raise refusal(self.name, error) from None
            yield content

    def chunks(self) -> Iterator[bytes]:
        """Yield all bytes, unpacked; raises `EndsEarly` for gzip data that are cut short, and the errors of `lines`."""
        with self.open_streams() as (raw, unpacked):
            yield from self._limited_chunks(raw, unpacked)

    def lines(self, encoding: str, blocks: int = 1) -> Generator[Lines, None, None]:
        """Yield all lines: first `blocks` blocks of `BLOCK_ROWS` lines, then one block at a time.

        Raises `UnreadableInput` if the file cannot be opened, or its gzip data are broken or unpack to too much.
        """
        with self.open_streams() as (raw, unpacked):
            yield from lines_of(self._limited_chunks(raw, unpacked), encoding, raw.tell, blocks=blocks)

    def refuse_changed(self) -> None:
        """Raise an error if the file was replaced or overwritten; a file that grew or was deleted is accepted."""
        if self.status is None or not self.path.exists():
            return
        now, then = self.path.stat(), self.status
        is_as_it_was = (now.st_size, now.st_mtime_ns) == (then.st_size, then.st_mtime_ns)
        has_grown = now.st_size > then.st_size and _ends(self.name, self.path, then.st_size) == self.ends
        if not os.path.samestat(now, then) or not (is_as_it_was or has_grown):
            raise UnreadableInput(f"{self.name} was replaced or changed while it was read: read it again")

    def _limited_chunks(self, raw: io.BufferedReader, unpacked: io.BufferedIOBase) -> Iterator[bytes]:
        """Yield all bytes, unpacked; at the compression ratio of a decompression bomb, first check the total size."""
        chunks = _chunks(self.name, unpacked.read1)
        if not isinstance(unpacked, gzip.GzipFile):
            yield from chunks
            return
        done, is_weighed = 0, False
        for chunk in chunks:
            done += len(chunk)
            if not is_weighed and is_bomb(done, raw.tell()):
                self._weigh()
                is_weighed = True
            yield chunk

    def _weigh(self) -> None:
        """Unpack the whole file, and raise an error if its content is too large."""
        with self.open_streams() as (_, unpacked), contextlib.suppress(EndsEarly):
            for _chunk in limit_size(self.name, _chunks(self.name, unpacked.read1), lambda: self.size):
                pass


def _ends(name: str, path: Path, size: int) -> bytes:
    """First and last `END_BYTES` bytes of a file of `size` bytes; `UnreadableInput` if it cannot be read."""
    try:
        with io.BufferedReader(UpTo(path, size)) as file:
            first = file.read(END_BYTES)
            file.seek(max(size - END_BYTES, 0))
            return first + file.read(END_BYTES)
    except OSError as error:
        raise refusal(name, error) from None


class UpTo(io.FileIO):
    """A file that ends where it ended when it was opened, even if it has grown since."""

    def __init__(self, path: Path, size: int | None = None) -> None:
        super().__init__(path)
        self._size = os.fstat(self.fileno()).st_size if size is None else size

    def readinto(self, buffer: WriteableBuffer, /) -> int | None:
        """Read into a buffer, up to the size at opening."""
        return super().readinto(memoryview(buffer)[: max(self._size - self.tell(), 0)])

    def readall(self) -> bytes:
        """Read the rest, up to the size that the file had when it was opened."""
        return super().read(max(self._size - self.tell(), 0)) or b""


class ByteStream:
    """Unpacked bytes that arrive once and are not stored, such as those of a sensor that is still running."""

    size: Final = None

    def __init__(self, name: str, chunks: Iterator[bytes]) -> None:
        self.name = name
        self._arriving = chunks
        self._head = b""
        self._is_enough = self._ended = self._is_read = False
        self._cut: EndsEarly | None = None

    def head(self) -> bytes:
        """Wait for enough bytes to recognise the format: some rows of numbers, `HEAD_BYTES` bytes, or the end."""
        try:
            while not self._is_enough and (chunk := next(self._arriving, None)) is not None:
                self._head += chunk
                ends_line = b"\n" in chunk or b"\r" in chunk
                self._is_enough = len(self._head) >= HEAD_BYTES or (ends_line and _shows_layout(self._head))
        except EndsEarly as cut:
            self._cut = cut
        self._ended = not self._is_enough
        if not self._head:
            empty = UnreadableInput(f"{self.name} is empty: {EMPTY_PIPE_MESSAGE}")
            raise self._cut.refusal(self.name) if self._cut else empty
        return self._head

    def opening(self, encoding: str) -> tuple[list[str], bool]:
        """The lines that have arrived so far, and False, since the stream may have more."""
        texts = [text for lines in lines_of(self._so_far(), encoding, lambda: 0) for text in lines.texts]
        return texts if self._ended or len(texts) < 2 else texts[:-1], False

    def chunks(self) -> Iterator[bytes]:
        """Yield all bytes as they arrive; raises `EndsEarly` for data cut short, and `UsageError` on a second pass."""
        if self._is_read:
            raise UsageError(
                f"{self.name} was opened for a single pass and has been read: open it for several passes",
                hint={"once": False},
            )
        self._is_read = True
        yield from self._so_far()
        yield from self._arriving

    def lines(self, encoding: str) -> Iterator[Lines]:
        """Yield all lines, grouped as they arrive; `UnreadableInput` for broken gzip data."""
        done = 0

        def counted_chunks() -> Iterator[bytes]:
            nonlocal done
            for chunk in self.chunks():
                done += len(chunk)
                yield chunk

        yield from lines_of(counted_chunks(), encoding, lambda: done, least=1)

    def _so_far(self) -> Iterator[bytes]:
        yield self.head()
        if self._cut:
            raise self._cut


Source: TypeAlias = File | ByteStream


Check: TypeAlias = "Callable[[str, bytes], object]"
"""Check of a source by its name and first bytes, which raises `UnreadableInput` if the source cannot be read."""


def find(path: str | os.PathLike[str] | IO[Any], *, once: bool = False, check: Check = refuse_foreign) -> Source:
    """Find the source of a path: a file, a pipe or a device; ``"-"`` is standard input, an open file is read on.

    A source that can be read only once is copied, if its first bytes pass the `check`. With `once` it is not copied,
    and its bytes come as they arrive. `UnreadableInput` is raised for a path without a file or without permission, a
    folder, and an empty file.
    """
    if not isinstance(path, (str, os.PathLike)):
        return _of_open_file(path, check)
    text = os.fspath(path)
    if text == "-":
        return _open_pipe("standard input", _standard_input(), once, check)
    file, name = Path(text), shorten(text)
    try:
        status = file.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            with contextlib.ExitStack() as stack:
                source = _open_pipe(file.name, stack.enter_context(file.open("rb")), once, check)
                weakref.finalize(source, stack.pop_all().close)
                return source
    except (OSError, ValueError) as error:
        raise refusal(name, error) from None
    if stat.S_ISDIR(status.st_mode):
        raise UnreadableInput(f"{name} is a folder: give the recording in it")
    if status.st_size == 0:
        raise UnreadableInput(f"{printable(file.name)} is empty: record again, or check what was saved")
    ends = _ends(name, file, status.st_size)
    return File(printable(file.name), file, status.st_size, status, ends)


def printable(name: str) -> str:
    r"""Name of a file with U+FFFD for bytes that are not UTF-8, which reports and tables cannot contain.

    >>> printable(os.fsdecode(b"A\xff.csv"))
    'A\ufffd.csv'
    """
    return os.fsencode(name).decode(errors="replace")


def raise_own_errors(passed: Callable[P, Iterator[Item]]) -> Callable[P, Iterator[Item]]:
    """Decorate a pass over a recording: it then raises only errors of Flinders, and refuses a replaced file."""

    @functools.wraps(passed)
    def checked_pass(*args: P.args, **options: P.kwargs) -> Iterator[Item]:
        recording: Any = args[0]
        with parser_errors(recording.source, "a recording"):
            yield from passed(*args, **options)
            file = getattr(recording, "original", None) or recording.file
            if isinstance(file, File):
                file.refuse_changed()

    return checked_pass


def spool(name: str, chunks: Iterable[bytes], *, empty: str = "record again, or check what was saved") -> File:
    """Copy chunks to a temporary file, which is deleted with the source or at exit.

    `UnreadableInput` is raised if the copy fails or the input is empty; `empty` is the advice for empty input.
    """
    import tempfile

    path: Path | None = None
    source: File | None = None
    try:
        handle, place = tempfile.mkstemp(prefix="flinders-", suffix=".spool")
        path = Path(place)
        with os.fdopen(handle, "wb") as file:
            size = _copy(name, chunks, file, empty)
        source = File(name, path, size)
        weakref.finalize(source, path.unlink, missing_ok=True)
    except OSError as error:
        folder = f"the temporary folder {tempfile.tempdir}" if tempfile.tempdir else "a temporary folder"
        raise UnreadableInput(
            f"{name} cannot be copied to {folder}: {reason_and_remedy(error)}; or set TMPDIR to another folder"
        ) from None
    finally:
        if source is None and path is not None:
            path.unlink(missing_ok=True)
    return source


def derive_source(source: Source, chunks: Iterator[bytes]) -> Source:
    """Source of bytes that were derived from another source, of the same kind: a stream or a temporary file."""
    return ByteStream(source.name, chunks) if isinstance(source, ByteStream) else spool(source.name, chunks)


def on_disk(source: Source) -> File:
    """The source as an uncompressed file, for readers that need random access."""
    return (
        source if isinstance(source, File) and not source.is_packed() else spool(source.name, unpacked_chunks(source))
    )


def unpacked_chunks(source: Source) -> Iterator[bytes]:
    """Yield all bytes, unpacked; `UnreadableInput` for compressed data that are cut short or too large."""
    try:
        yield from source.chunks()
    except EndsEarly as cut:
        raise cut.refusal(source.name) from None


def refusal(name: str, error: OSError | ValueError) -> UnreadableInput:
    """Error of one line for an error of the operating system."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return UnreadableInput(f"{name} does not exist: check the name and the folder")
        case PermissionError():
            return UnreadableInput(f"{name} may not be read: ask for permission, or copy it to where you may")
        case OSError():
            advice = "" if error.errno in REASONS_BY_ERRNO else "; try a copy of it"
            return UnreadableInput(f"{name} cannot be read: {reason_and_remedy(error)}{advice}")
        case _:
            return UnreadableInput(f"{name} holds a character that no file name can have: check the name")


def _of_open_file(file: IO[Any], check: Check) -> Source:
    """Source with a copy of the rest of an open file, of bytes or of text."""
    name = str(getattr(file, "name", type(file).__name__))
    pieces = iter(partial(file.read, CHUNK_BYTES), file.read(0))
    chunks = (piece.encode() if isinstance(piece, str) else piece for piece in pieces)
    return spool(name, _checked_chunks(name, chunks, check))


def _standard_input() -> io.BufferedIOBase:
    if sys.stdin is None or sys.stdin.closed:
        raise UnreadableInput("standard input is closed: pipe a recording in, or give a file name")
    buffer = getattr(sys.stdin, "buffer", None)  # missing if a program has replaced standard input by a text stream
    return cast("io.BufferedIOBase", buffer) if buffer else io.BytesIO(sys.stdin.read().encode())


def _open_pipe(name: str, stream: io.BufferedIOBase, once: bool, check: Check) -> Source:
    if once:
        return ByteStream(name, _as_it_arrives(name, stream))
    return spool(name, _checked_chunks(name, _chunks(name, stream.read), check), empty=EMPTY_PIPE_MESSAGE)


def _checked_chunks(name: str, chunks: Iterator[bytes], check: Check) -> Iterator[bytes]:
    """Yield chunks, after a check that the first one passes `check` or is gzip."""
    first = next(chunks, b"")
    if first and not first.startswith(GZIP):
        check(name, first[:HEAD_BYTES])
    return itertools.chain([first], chunks)


def _as_it_arrives(name: str, stream: io.BufferedIOBase) -> Iterator[bytes]:
    """Yield the unpacked bytes of a pipe as soon as they arrive."""
    start = b""
    while len(start) < len(GZIP) and (more := _read(name, stream.read1, CHUNK_BYTES)):
        start += more
    if start.startswith(GZIP):
        packed = _Ahead(start, stream)
        unpacked = gzip.GzipFile(fileobj=cast("IO[bytes]", packed))
        yield from limit_size(name, _chunks(name, unpacked.read1), lambda: packed.given)
    elif start:
        yield start
        yield from _chunks(name, stream.read1)


class _Ahead:
    """A pipe whose first bytes were read already; `given` counts the bytes that were returned."""

    def __init__(self, start: bytes, stream: io.BufferedIOBase) -> None:
        self._start, self._stream, self.given = start, stream, 0

    def read(self, size: int) -> bytes:
        taken = self._start[:size] or self._stream.read1(size)
        self._start = self._start[size:]
        self.given += len(taken)
        return taken


def _shows_layout(head: bytes) -> bool:
    """Whether the start of a stream shows its layout, so that nobody waits for more from a slow sensor."""
    text = head.decode(encoding_of(head), "replace")
    lines = [line for line in text.splitlines(keepends=True) if line.endswith(("\n", "\r"))]
    rows = Counter(filter(None, map(_row_width, lines)))
    return len(lines) >= MIN_LINES or max(rows.values(), default=0) >= MIN_ROWS


def _row_width(line: str) -> int:
    """Number of numbers in a line; 0 if they are too few for a reading."""
    numbers = len(split_line(line)[0])
    return numbers if numbers >= MIN_NUMBERS else 0


def _copy(name: str, chunks: Iterable[bytes], file: IO[bytes], empty: str) -> int:
    """Write chunks to a file, and return the number of bytes."""
    size = 0
    for chunk in chunks:
        size += file.write(chunk)
        if size > MAX_SPOOLED_BYTES:
            raise UnreadableInput(f"{name} is longer than {MAX_SPOOLED_BYTES >> 30} GB: save it as a file, or cut it")
    if size == 0:
        raise UnreadableInput(f"{name} is empty: {empty}")
    return size


def _chunks(name: str, read: Callable[[int], bytes]) -> Iterator[bytes]:
    while chunk := _read(name, read, CHUNK_BYTES):
        yield chunk


def _read(name: str, read: Callable[[int], bytes], size: int) -> bytes:
    try:
        return read(size)
    except EOFError:
        raise EndsEarly from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise UnreadableInput(f"{name} has broken gzip data ({error}): copy it again") from None
    except OSError as error:
        raise refusal(name, error) from None


def filled_size(path: Path) -> int:
    """Size of a file in bytes, without trailing zeros if these are too many to be the end of a message."""
    with path.open("rb") as file:
        size = end = file.seek(0, os.SEEK_END)
        while end > 0:
            start = max(end - (1 << 20), 0)
            file.seek(start)
            filled = file.read(end - start).rstrip(b"\0")
            if filled:
                return start + len(filled) if size - start - len(filled) > MAX_MESSAGE_BYTES else size
            end = start
    return size


def reserved_words(size: int) -> str:
    """Notice that trailing zeros were left out."""
    return f"{size:,} bytes of zeros at its end are left out: the logger had reserved them, and did not close it"
