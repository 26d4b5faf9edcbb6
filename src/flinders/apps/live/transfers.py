r"""Uploads with a limit on their unpacked size, and downloads of files that still grow.

The size stated in a compressed file is not trusted: the file is unpacked once, and refused as soon as it is too large.
Then its reader unpacks it again. Files on the command line have no such limit.

>>> import gzip
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "log.csv.gz"
>>> _ = path.write_bytes(gzip.compress(b"1,2,3\n" * 1000))
>>> with path.open("rb") as file:
...     sum(map(len, unpack(file)))
6000
>>> refuse_large(path, "log.csv.gz")
"""

from __future__ import annotations

import contextlib
import gzip
import os
import tempfile
import zipfile
from functools import partial
from typing import IO, TYPE_CHECKING, Final
from urllib.parse import quote

from starlette.responses import StreamingResponse

from flinders.apps.live.session_file import load
from flinders.errors import UnreadableInput
from flinders.readers._source import CHUNK_BYTES, GZIP
from flinders.readers._tokenizer import shorten
from flinders.readers.arrays import MAX_MEMBERS, ZIP
from flinders.readers.matlab import MAT, inflate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flinders.apps.live.session_file import Log

PACKED: Final = (GZIP, ZIP, MAT)
"""First bytes of compressed files."""
UNPACKED_BYTES: Final = 256 << 20
"""Largest unpacked size of an upload in bytes; reading so much text takes half a minute."""
MAX_LAYERS: Final = 3
"""Largest number of nested compressions, as many as readers unpack."""
PACKINGS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compression methods of archive members that `zipfile` unpacks in bounded memory."""
TAIL: Final = 1 << 16
"""Number of bytes that are searched at a time for the end of the last whole line."""


def load_upload(path: Path, name: str) -> tuple[Log, str]:
    """Read an uploaded recording; returns it with a sentence on its format. `UnreadableInput` if it is too large."""
    refuse_large(path, name)
    log, words, _ = load(path, name)
    return log, words


def refuse_large(path: Path, name: str) -> None:
    """Refuse a file that unpacks to more than `UNPACKED_BYTES` with `UnreadableInput`.

    A damaged archive passes: its reader reports it.
    """
    size = 0
    with path.open("rb") as file:
        for piece in unpack(file):
            size += len(piece)
            if size > UNPACKED_BYTES:
                raise UnreadableInput(
                    f"{name} unpacks to more than {UNPACKED_BYTES >> 20} MB, the limit of this page: "
                    "calibrate it with flinders calibrate"
                )


def unpack(file: IO[bytes], layers: int = MAX_LAYERS) -> Iterator[bytes]:
    """Yield the unpacked content of a file in pieces, then that of compressed files in it; nothing for a plain file."""
    for pieces in map(_valid_pieces, _packed_files(file)):
        first = next(pieces, b"")
        yield first
        if layers > 1 and first.startswith(PACKED):
            yield from _unpack_nested(first, pieces, layers - 1)
        else:
            yield from pieces


def _valid_pieces(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Yield pieces up to the first damaged one, which the reader reports."""
    with contextlib.suppress(Exception):
        yield from pieces


def _unpack_nested(first: bytes, pieces: Iterator[bytes], layers: int) -> Iterator[bytes]:
    """Yield the unpacked content of a file, then the content of a compressed file in it, up to `layers` deep."""
    with tempfile.TemporaryFile() as inner:
        inner.write(first)
        for piece in pieces:
            inner.write(piece)
            yield piece
        yield from unpack(inner, layers)


def _packed_files(file: IO[bytes]) -> Iterator[Iterator[bytes]]:
    """Yield the pieces of each file inside a compressed file.

    An archive with a method other than `PACKINGS` raises `UnreadableInput`.
    """
    file.seek(0)
    start = file.read(len(MAT))
    file.seek(0)
    if start.startswith(GZIP):
        yield _pieces(partial(gzip.GzipFile, fileobj=file))
    elif start.startswith(ZIP):
        yield from _members(file)
    elif start.startswith(MAT):
        yield inflate(file)


def _members(file: IO[bytes]) -> Iterator[Iterator[bytes]]:
    """Yield the pieces of each member of an archive, as `_packed_files`; none of a damaged archive."""
    with contextlib.suppress(zipfile.BadZipFile, NotImplementedError), zipfile.ZipFile(file) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        for member in members[:MAX_MEMBERS]:
            if member.compress_type not in PACKINGS:
                raise UnreadableInput(
                    f"{shorten(member.filename)} has an unusual compression: create the archive again with deflate"
                )
            yield _pieces(partial(archive.open, member))


def _pieces(opened: Callable[[], gzip.GzipFile | IO[bytes]]) -> Iterator[bytes]:
    """Open a compressed file, and yield its unpacked content in pieces."""
    with opened() as stream:
        yield from iter(partial(stream.read, CHUNK_BYTES), b"")


def snapshot(path: Path) -> StreamingResponse:
    """Answer with the complete lines that a file has now; the file may grow meanwhile."""
    with path.open("rb") as file:
        size = _whole_lines(file)
    name = quote(path.name)
    named = f'filename="{name}"' if name == path.name else f"filename*=utf-8''{name}"
    headers = {"Content-Length": f"{size}", "Content-Disposition": f"attachment; {named}"}
    return StreamingResponse(_first_bytes(path, size), media_type="text/csv", headers=headers)


def _whole_lines(file: IO[bytes]) -> int:
    """Size of a file up to the end of its last whole line."""
    end = file.seek(0, os.SEEK_END)
    while end > 0:
        start = max(end - TAIL, 0)
        file.seek(start)
        line_end = file.read(end - start).rfind(b"\n")
        if line_end >= 0:
            return start + line_end + 1
        end = start
    return 0


def _first_bytes(path: Path, size: int) -> Iterator[bytes]:
    """Yield the first bytes of a file, in pieces."""
    with path.open("rb") as file:
        while piece := file.read(min(CHUNK_BYTES, size)):
            size -= len(piece)
            yield piece
