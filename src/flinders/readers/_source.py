r"""Bytes of a file or a pipe, as often as asked or as they arrive, and what they are by the first of them.

What cannot be read twice (standard input, a named pipe, a serial port) is either copied to a temporary
file, which goes when its `File` does, or, where one pass is enough, read as a `ByteStream` that keeps
nothing. Gzip is recognised by its first bytes.

>>> piped = spooled("-", [b"mx,my,mz\n", b"1,2,3\n"])
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

from flinders.core.files import REASONS, is_bomb, metered, reason
from flinders.errors import UnreadableInput, UsageError
from flinders.foreign_errors import reading
from flinders.readers._foreign_files import refuse_foreign
from flinders.readers._lines import EndsEarly, Lines, encoding_of, lines_of
from flinders.readers._tokenizer import cut, shown

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from _typeshed import WriteableBuffer

P = ParamSpec("P")
Item = TypeVar("Item")
Progress: TypeAlias = "Callable[[int, int | None], None]"
"""Called once a block with the bytes read so far and, where it is known, those there are."""
GZIP: Final = b"\x1f\x8b"
HEAD: Final = 1 << 16
"""Bytes looked at to tell what a file is, and how its text is encoded."""
END: Final = 1 << 14
"""Bytes at the start and at the end by which a file that has grown is told from one that was written over."""
CHUNK: Final = 1 << 18
"""Bytes read at a time."""
MOST_SPOOLED: Final = 64 << 30
"""Bytes copied to a temporary file before it is given up: a pipe may have no end."""
MOST_MEMBER: Final = 4 << 30
"""Bytes of a member of an archive, or of a packed file of a recording of ROS 2, unpacked."""
LONGEST_MESSAGE: Final = 1 << 16
"""Bytes of a message of a log of messages, of which length or number have two bytes at most."""
ENOUGH_ROWS, ENOUGH_LINES = 20, 400
"""Lines of numbers of one width, and lines at all, after which no more is waited for to tell what a stream is."""
NOTHING_PIPED: Final = "nothing was piped in"
LEAST_NUMBERS: Final = 3
"""In a line with a reading."""


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class File:
    """A file that stays where it is while it is being read."""

    name: str  # for messages
    path: Path  # where the bytes lie: the file itself, or its copy in a temporary file
    size: int  # as it lies on the disk, compressed or not
    status: os.stat_result | None = None  # of the file when it was found; None where nobody else changes it
    ends: bytes = b""  # its first and last bytes then

    def is_packed(self) -> bool:
        """Whether it lies on the disk as gzip; raises as `opened`."""
        with self.opened() as (_, unpacked):
            return isinstance(unpacked, gzip.GzipFile)

    def head(self) -> bytes:
        """Return the first `HEAD` bytes, unpacked."""
        head = b""
        with self.opened() as (_, unpacked):
            try:
                for chunk in _chunks(self.name, unpacked.read1):
                    head += chunk
                    if len(head) >= HEAD:
                        break
            except EndsEarly as cut:
                if not head:
                    raise cut.refusal(self.name) from None
        return head[:HEAD]

    def opening(self, encoding: str) -> tuple[list[str], bool]:
        """Return the first lines, a block of them, and whether they are all."""
        with contextlib.closing(self.lines(encoding)) as blocks:
            first = next(blocks, Lines(1, "", 0, 0))
            return first.texts, next(blocks, None) is None

    def last_lines(self, encoding: str) -> list[str]:
        """Return the whole lines among its last bytes; none where it is packed."""
        return [] if self.is_packed() else self.ends[-END:].decode(encoding, "replace").splitlines()[1:]

    @contextlib.contextmanager
    def opened(self) -> Iterator[tuple[io.BufferedReader, io.BufferedIOBase]]:
        """Open the file, giving it as it lies on the disk and unpacked; `UnreadableInput` where it cannot be read."""
        try:
            raw: Any = io.BufferedReader(UpTo(self.path, self.status.st_size if self.status else None))
        except OSError as error:
            raise refusal(self.name, error) from None
        with raw:
            start = _read(self.name, raw.read, len(GZIP))
            raw.seek(0)
            yield raw, gzip.GzipFile(fileobj=raw) if start == GZIP else raw

    @contextlib.contextmanager
    def mapped(self) -> Iterator[mmap.mmap]:
        """Have the bytes as they lie on the disk without reading them in; raises as `opened`."""
        with contextlib.ExitStack() as opened:
            try:
                stream = opened.enter_context(self.path.open("rb"))
                content = opened.enter_context(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
            except (OSError, ValueError) as error:
                raise refusal(self.name, error) from None
            yield content

    def chunks(self) -> Iterator[bytes]:
        """Yield all bytes, unpacked; raise `EndsEarly` where they have no end, and as `lines`."""
        with self.opened() as (raw, unpacked):
            yield from self._bounded(raw, unpacked)

    def lines(self, encoding: str, blocks: int = 1) -> Generator[Lines, None, None]:
        """Yield all lines, `BLOCK` at a time, or after the first so many blocks at a time.

        A file that cannot be opened, whose gzip data are broken or unpack to too much raises `UnreadableInput`.
        """
        with self.opened() as (raw, unpacked):
            yield from lines_of(self._bounded(raw, unpacked), encoding, raw.tell, blocks=blocks)

    def refuse_changed(self) -> None:
        """Refuse a file that is another one by now, or was written over; one that grew or is gone is read as it was."""
        if self.status is None or not self.path.exists():
            return
        now, then = self.path.stat(), self.status
        is_as_it_was = (now.st_size, now.st_mtime_ns) == (then.st_size, then.st_mtime_ns)
        has_grown = now.st_size > then.st_size and _ends(self.name, self.path, then.st_size) == self.ends
        if not os.path.samestat(now, then) or not (is_as_it_was or has_grown):
            raise UnreadableInput(f"{self.name} was replaced or changed while it was read: read it again")

    def _bounded(self, raw: io.BufferedReader, unpacked: io.BufferedIOBase) -> Iterator[bytes]:
        """Yield all bytes; once packed ones look like those of a bomb, weigh the rest before more is passed on."""
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
        """Unpack all of it, and refuse what becomes too much."""
        with self.opened() as (_, unpacked), contextlib.suppress(EndsEarly):
            for _chunk in metered(self.name, _chunks(self.name, unpacked.read1), lambda: self.size):
                pass


def _ends(name: str, path: Path, size: int) -> bytes:
    """The first and the last `END` bytes of a file of a size; `UnreadableInput` where it cannot be read."""
    try:
        with io.BufferedReader(UpTo(path, size)) as file:
            first = file.read(END)
            file.seek(max(size - END, 0))
            return first + file.read(END)
    except OSError as error:
        raise refusal(name, error) from None


class UpTo(io.FileIO):
    """A file that ends at the size it had, however it grows."""

    def __init__(self, path: Path, size: int | None = None) -> None:
        super().__init__(path)
        self._size = os.fstat(self.fileno()).st_size if size is None else size

    def readinto(self, buffer: WriteableBuffer, /) -> int | None:
        """Read into a buffer, up to that size."""
        return super().readinto(memoryview(buffer)[: max(self._size - self.tell(), 0)])

    def readall(self) -> bytes:
        """Read the rest, up to that size."""
        return super().read(max(self._size - self.tell(), 0)) or b""


class ByteStream:
    """Bytes, unpacked, that come once and are not kept, such as those of a sensor that is still running."""

    size: Final = None

    def __init__(self, name: str, chunks: Iterator[bytes]) -> None:
        self.name = name
        self._arriving = chunks
        self._head = b""
        self._is_enough = self._ended = self._is_read = False
        self._cut: EndsEarly | None = None

    def head(self) -> bytes:
        """Wait for enough to tell what it is: lines of numbers, `HEAD` bytes, the end; nothing is refused."""
        try:
            while not self._is_enough and (chunk := next(self._arriving, None)) is not None:
                self._head += chunk
                ends_line = b"\n" in chunk or b"\r" in chunk
                self._is_enough = len(self._head) >= HEAD or (ends_line and _shows_layout(self._head))
        except EndsEarly as cut:
            self._cut = cut
        self._ended = not self._is_enough
        if not self._head:
            empty = UnreadableInput(f"{self.name} is empty: {NOTHING_PIPED}")
            raise self._cut.refusal(self.name) if self._cut else empty
        return self._head

    def opening(self, encoding: str) -> tuple[list[str], bool]:
        """Return the lines that have arrived so far; whether they are all is not known before they are read."""
        texts = [text for lines in lines_of(self._so_far(), encoding, lambda: 0) for text in lines.texts]
        return texts if self._ended or len(texts) < 2 else texts[:-1], False

    def chunks(self) -> Iterator[bytes]:
        """Yield all bytes as they arrive; raise `EndsEarly` where they have no end, `UsageError` the second time."""
        if self._is_read:
            raise UsageError(
                f"{self.name} was opened for one pass and has been read: to go over it again, open it for more",
                hint={"once": False},
            )
        self._is_read = True
        yield from self._so_far()
        yield from self._arriving

    def lines(self, encoding: str) -> Iterator[Lines]:
        """Yield all lines, those that arrive together at a time; `UnreadableInput` for broken gzip data."""
        done = 0

        def counted() -> Iterator[bytes]:
            nonlocal done
            for chunk in self.chunks():
                done += len(chunk)
                yield chunk

        yield from lines_of(counted(), encoding, lambda: done, least=1)

    def _so_far(self) -> Iterator[bytes]:
        yield self.head()
        if self._cut:
            raise self._cut


Source: TypeAlias = File | ByteStream


Check: TypeAlias = "Callable[[str, bytes], object]"
"""Raises `UnreadableInput` where a source of this name cannot be read that starts with these bytes."""


def find(path: str | os.PathLike[str] | IO[Any], *, once: bool = False, check: Check = refuse_foreign) -> Source:
    """Find what a path names, a file, a pipe or a device; ``"-"`` is standard input, and an open file is read on.

    Where one pass is enough (`once`), what can be read only once is not kept, and comes as it arrives; else it is
    copied, if its first bytes pass the `check`. A path where there is nothing, nothing readable, a folder or an empty
    file raises `UnreadableInput`.
    """
    if not isinstance(path, (str, os.PathLike)):
        return _of_open_file(path, check)
    text = os.fspath(path)
    if text == "-":
        return _piped("standard input", _standard_input(), once, check)
    file, name = Path(text), shown(text)
    try:
        status = file.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            with contextlib.ExitStack() as stack:
                source = _piped(file.name, stack.enter_context(file.open("rb")), once, check)
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
    r"""The name of a file with U+FFFD for bytes that are no UTF-8: no report and no table can hold those.

    >>> printable(os.fsdecode(b"A\xff.csv"))
    'A\ufffd.csv'
    """
    return os.fsencode(name).decode(errors="replace")


def sound(passed: Callable[P, Iterator[Item]]) -> Callable[P, Iterator[Item]]:
    """Have a method that goes through a recording raise only errors of Flinders, also for a file that was replaced."""

    @functools.wraps(passed)
    def checked(*args: P.args, **options: P.kwargs) -> Iterator[Item]:
        recording: Any = args[0]
        with reading(recording.source, "a recording"):
            yield from passed(*args, **options)
            file = getattr(recording, "original", None) or recording.file
            if isinstance(file, File):
                file.refuse_changed()

    return checked


def spooled(name: str, chunks: Iterable[bytes], *, empty: str = "record again, or check what was saved") -> File:
    """Copy what can be read only once to a temporary file, which is deleted with the source or at exit.

    Nothing, and what cannot be written, raise `UnreadableInput`; `empty` says what to do about nothing.
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
            f"{name} cannot be copied to {folder}: {reason(error)}; or set TMPDIR to another folder"
        ) from None
    finally:
        if source is None and path is not None:
            path.unlink(missing_ok=True)
    return source


def derived(source: Source, chunks: Iterator[bytes]) -> Source:
    """Keep what is made of a source's bytes as long as the source itself is kept."""
    return ByteStream(source.name, chunks) if isinstance(source, ByteStream) else spooled(source.name, chunks)


def on_disk(source: Source) -> File:
    """Have it as a file without packing around it, for readers that do not go from the first byte to the last."""
    return source if isinstance(source, File) and not source.is_packed() else spooled(source.name, unpacked(source))


def unpacked(source: Source) -> Iterator[bytes]:
    """Yield all bytes; compressed ones without their end, or that are too many, raise `UnreadableInput`."""
    try:
        yield from source.chunks()
    except EndsEarly as cut:
        raise cut.refusal(source.name) from None


def refusal(name: str, error: OSError | ValueError) -> UnreadableInput:
    """Turn an error of the operating system into one line."""
    match error:
        case FileNotFoundError() | NotADirectoryError():
            return UnreadableInput(f"{name} does not exist: check the name and the folder")
        case PermissionError():
            return UnreadableInput(f"{name} may not be read: ask for permission, or copy it to where you may")
        case OSError():
            advice = "" if error.errno in REASONS else "; try a copy of it"
            return UnreadableInput(f"{name} cannot be read: {reason(error)}{advice}")
        case _:
            return UnreadableInput(f"{name} is not a file name: {error}")


def _of_open_file(file: IO[Any], check: Check) -> Source:
    """Copy what is left in an open file, of bytes or of text."""
    name = str(getattr(file, "name", type(file).__name__))
    pieces = iter(partial(file.read, CHUNK), file.read(0))
    chunks = (piece.encode() if isinstance(piece, str) else piece for piece in pieces)
    return spooled(name, _checked(name, chunks, check))


def _standard_input() -> io.BufferedIOBase:
    if sys.stdin is None or sys.stdin.closed:
        raise UnreadableInput("standard input is closed: pipe a recording in, or give a file name")
    buffer = getattr(sys.stdin, "buffer", None)  # none where a program has put other text in its place
    return cast("io.BufferedIOBase", buffer) if buffer else io.BytesIO(sys.stdin.read().encode())


def _piped(name: str, stream: io.BufferedIOBase, once: bool, check: Check) -> Source:
    if once:
        return ByteStream(name, _as_it_arrives(name, stream))
    return spooled(name, _checked(name, _chunks(name, stream.read), check), empty=NOTHING_PIPED)


def _checked(name: str, chunks: Iterator[bytes], check: Check) -> Iterator[bytes]:
    """Yield chunks if the first passes the check, or is packed."""
    first = next(chunks, b"")
    if first and not first.startswith(GZIP):
        check(name, first[:HEAD])
    return itertools.chain([first], chunks)


def _as_it_arrives(name: str, stream: io.BufferedIOBase) -> Iterator[bytes]:
    """Yield the bytes of a pipe, unpacked, and wait only where there are none."""
    start = b""
    while len(start) < len(GZIP) and (more := _read(name, stream.read1, CHUNK)):
        start += more
    if start.startswith(GZIP):
        packed = _Ahead(start, stream)
        unpacked = gzip.GzipFile(fileobj=cast("IO[bytes]", packed))
        yield from metered(name, _chunks(name, unpacked.read1), lambda: packed.given)
    elif start:
        yield start
        yield from _chunks(name, stream.read1)


class _Ahead:
    """A pipe of which the first bytes were read already; gives what has arrived, and counts it in `given`."""

    def __init__(self, start: bytes, stream: io.BufferedIOBase) -> None:
        self._start, self._stream, self.given = start, stream, 0

    def read(self, size: int) -> bytes:
        taken = self._start[:size] or self._stream.read1(size)
        self._start = self._start[size:]
        self.given += len(taken)
        return taken


def _shows_layout(head: bytes) -> bool:
    """Tell whether the start of a stream shows how it is written; a slow sensor is not waited for any longer."""
    text = head.decode(encoding_of(head), "replace")
    lines = [line for line in text.splitlines(keepends=True) if line.endswith(("\n", "\r"))]
    rows = Counter(filter(None, map(_row_width, lines)))
    return len(lines) >= ENOUGH_LINES or max(rows.values(), default=0) >= ENOUGH_ROWS


def _row_width(line: str) -> int:
    """Count the numbers of a line; 0 where they are too few for a reading."""
    numbers = len(cut(line)[0])
    return numbers if numbers >= LEAST_NUMBERS else 0


def _copy(name: str, chunks: Iterable[bytes], file: IO[bytes], empty: str) -> int:
    """Write chunks to a file and count bytes."""
    size = 0
    for chunk in chunks:
        size += file.write(chunk)
        if size > MOST_SPOOLED:
            raise UnreadableInput(f"{name} is longer than {MOST_SPOOLED >> 30} GB: save it as a file, or cut it")
    if size == 0:
        raise UnreadableInput(f"{name} is empty: {empty}")
    return size


def _chunks(name: str, read: Callable[[int], bytes]) -> Iterator[bytes]:
    while chunk := _read(name, read, CHUNK):
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
    """Size of a file without the zeros behind it, where a logger has reserved more than a message can have of them."""
    with path.open("rb") as file:
        size = end = file.seek(0, os.SEEK_END)
        while end > 0:
            start = max(end - (1 << 20), 0)
            file.seek(start)
            filled = file.read(end - start).rstrip(b"\0")
            if filled:
                return start + len(filled) if size - start - len(filled) > LONGEST_MESSAGE else size
            end = start
    return size


def reserved_words(size: int) -> str:
    """Say that so many zeros were left out."""
    return f"{size:,} bytes of zeros at its end are left out: the logger had reserved them, and did not close it"
