r"""Where recordings lie: files of this machine, or objects of ``s3://``, ``gs://`` and ``az://`` through obstore.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17").mkdir(), (folder / "A17" / "monday.csv").write_text("x,y,z\n")
>>> [(file.name, file.size) for file in listed(str(folder))]
[('A17/monday.csv', 6)]
"""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import glob
import io
import os
import re
import stat
import tempfile
from dataclasses import dataclass
from itertools import takewhile
from operator import attrgetter
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.core.files import reason, write_all
from flinders.errors import MissingExtra, OutputError, OutputExists, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.errors import FlindersError

MAGIC: Final = re.compile(r"[*?\[]")
STORE: Final = re.compile(r"(s3a?|gs|az|abfss?)://[^/]+")
"""The store in a URL; the path of an object follows."""
CHUNK: Final = 1 << 22
WHOLE: Final = 1 << 18
"""Bytes of an object that is read whole: as many take no longer than another request."""
PARTS: Final = (".parquet.parts", ".pq.parts")
"""Suffixes of the folder of a checkpoint."""
KINDS: Final = {stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device", stat.S_IFBLK: "device"}
"""Entries of a folder that are no files."""
NAMED_BY: Final = ("AWS_", "AZURE_", "GOOGLE_")
"""Prefixes of environment variables with address and credentials of a store."""


@dataclass(frozen=True, slots=True, order=True)
class StoredFile:
    """A file or object."""

    name: str  # path below the folder that was given, with slashes
    where: str  # its path or URL
    size: int  # bytes
    stamp: str = ""  # changes when it does
    kind: str = ""  # if it is no file, what it is, such as ``pipe``: it is never opened, since that may block


def is_remote(where: str) -> bool:
    """Whether a path is a URL that obstore opens.

    >>> is_remote("s3://fleet/2026/"), is_remote("logs/")
    (True, False)
    """
    return STORE.match(where) is not None


def listed(where: str) -> list[StoredFile]:
    """List the files of a folder, a pattern, a file or a URL, sorted by name, without hidden ones and checkpoints.

    Raises UnreadableInput if there is nothing, or it cannot be listed, and MissingExtra for a URL without obstore.
    """
    files = sorted(_objects(where) if is_remote(where) else _files(where), key=attrgetter("name"))
    if not files:
        raise UnreadableInput(f"{where}: no files: give a folder, a pattern in quotes such as 'logs/*.bin', or a URL")
    return files


def _is_hidden(name: str) -> bool:
    """Whether a file is hidden, or of a checkpoint."""
    return any(part.startswith((".", "_")) or part.endswith(PARTS) for part in PurePosixPath(name).parts)


def _files(where: str) -> Iterator[StoredFile]:
    """List files of this machine."""
    root = Path(where)
    try:
        if root.is_file():
            yield _file(root, root.name)
        elif root.is_dir():
            yield from _below(root)
        elif MAGIC.search(where):
            start = Path(*takewhile(lambda part: not MAGIC.search(part), Path(where).parts))
            for found_path in map(Path, glob.glob(where, recursive=True)):  # noqa: PTH207 - a pattern may be absolute
                name = found_path.relative_to(start).as_posix() if start.parts else found_path.as_posix()
                if not found_path.is_dir() and not _is_hidden(name):
                    yield _file(found_path, name)
        else:
            raise FileNotFoundError(2, "")
    except OSError as error:
        raise UnreadableInput(f"{where}: cannot be listed: {reason(error)}") from None


def _below(root: Path) -> Iterator[StoredFile]:
    """List files in a folder and below; folders that may not be listed too, for a row of their own."""
    os.scandir(root).close()
    folders = [(str(root), "")]
    while folders:
        folder, prefix = folders.pop()
        try:
            entries = list(os.scandir(folder))
        except OSError:
            yield StoredFile(prefix, folder, 0)
            continue
        for entry in entries:
            name = entry.name
            if name[0] in "._" or name.endswith(PARTS):
                continue
            if not _is_folder(entry):
                yield _file(entry, prefix + name)
            elif not _leads_up(folder, entry):
                folders.append((entry.path, f"{prefix}{name}/"))


def _is_folder(entry: os.DirEntry[str]) -> bool:
    """Whether an entry is a folder, or a link to one; a link that leads in a circle is none."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def _leads_up(folder: str, entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder is a link to it or to one above, which would be followed without end."""
    return entry.is_symlink() and Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(entry.path))


def _file(path: Path | os.DirEntry[str], name: str) -> StoredFile:
    """Describe a file; of a dangling link, and of what may not be read, the name alone."""
    where = os.fspath(path)
    try:
        status = path.stat()
    except OSError:
        return StoredFile(name, where, 0)
    mode = stat.S_IFMT(status.st_mode)
    kind = "" if mode == stat.S_IFREG else KINDS.get(mode, "")
    return StoredFile(name, where, status.st_size, str(status.st_mtime_ns), kind)


def obstore() -> Any:  # noqa: ANN401 - the module
    """Import obstore; raises MissingExtra if it is not installed."""
    try:
        import obstore
        import obstore.store
    except ImportError:
        raise MissingExtra("obstore", "cloud", "an object store") from None
    return obstore


def _split(where: str) -> tuple[str, str]:
    """Split a URL into the store and the path in it.

    >>> _split("gs://fleet/2026/A17.csv")
    ('gs://fleet', '2026/A17.csv')
    """
    store = cast("re.Match[str]", STORE.match(where))[0]
    return store, where.removeprefix(store).strip("/")


def _store(where: str) -> Any:  # noqa: ANN401 - a store of obstore
    """Open the store of a URL: once for each environment, since it takes 10 ms and a connection."""
    return _made(where, tuple((name, os.environ[name]) for name in sorted(os.environ) if name.startswith(NAMED_BY)))


@functools.lru_cache(maxsize=64)
def _made(where: str, _: tuple[tuple[str, str], ...]) -> Any:  # noqa: ANN401
    """Open the store of a URL in an environment."""
    return obstore().store.from_url(where)


def _objects(where: str) -> Iterator[StoredFile]:
    """List objects of a store."""
    is_folder = not MAGIC.search(where) and (where.endswith("/") or not PurePosixPath(_split(where)[1]).suffix)
    fixed = where.rstrip("/") if is_folder else MAGIC.split(where)[0].rpartition("/")[0]
    pattern = where[len(fixed) :].lstrip("/")
    with _store_errors(where):
        store, folder = _split(fixed)
        for batch in _store(store).list(folder or None):
            for entry in batch:
                name = str(entry["path"])[len(folder) :].lstrip("/")
                if not _is_hidden(name) and (not pattern or fnmatch.fnmatchcase(name, pattern)):
                    yield StoredFile(name, f"{fixed}/{name}", int(entry["size"]), str(entry["e_tag"]))


@contextlib.contextmanager
def _store_errors(where: str, refused: type[FlindersError] = UnreadableInput) -> Iterator[None]:
    """Turn errors of a store into one line, raised as an error of type `refused`."""
    module = obstore()
    try:
        yield
    except (module.exceptions.BaseError, OSError, ValueError) as error:
        message = " ".join(str(error).split())[:200]
        raise refused(f"{where}: the store says: {message}; check the name, the region and who you are") from None


@contextlib.contextmanager
def opened(file: StoredFile) -> Iterator[Any]:
    """Open a file for random access, such as to its footer and some row groups; raises UnreadableInput."""
    if not is_remote(file.where):
        yield file.where
        return
    with _store_errors(file.where):
        store, path = _split(file.where)
        yield _Object(_store(store), path, file.size)


class _Object(io.RawIOBase):
    """An object as a file of random access: each read is a request, but a small object is read whole by the first."""

    def __init__(self, store: Any, path: str, size: int) -> None:  # noqa: ANN401
        self._store, self._path, self._size = store, path, size
        self._at = self._first = 0
        self._content = b""

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any writable buffer
        begin, end = self._at, min(self._at + len(buffer), self._size)
        if begin < end and not self._first <= begin < end <= self._first + len(self._content):
            self._first, last = (0, self._size) if self._size <= WHOLE else (begin, end)
            self._content = bytes(obstore().get_range(self._store, self._path, start=self._first, end=last))
        self._at = max(begin, end)
        buffer[: self._at - begin] = self._content[begin - self._first : self._at - self._first]
        return self._at - begin

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True


@contextlib.contextmanager
def fetched(file: StoredFile) -> Iterator[Path]:
    """Copy an object to a file of this machine, which is removed afterwards; a local file is given as it is.

    Raises UnreadableInput if it cannot be read, and OutputError if there is no room for the copy.
    """
    if not is_remote(file.where):
        if file.name.endswith("/"):
            raise UnreadableInput(f"{file.name} cannot be listed: ask for permission to read the folder")
        yield Path(file.where)
        return
    store, path = _split(file.where)
    with tempfile.TemporaryDirectory(prefix="flinders-") as place:
        copy = Path(place) / PurePosixPath(path).name
        with _store_errors(file.where), copy.open("wb", buffering=0) as written:
            for chunk in _store(store).get(path).stream(min_chunk_size=CHUNK):
                try:
                    write_all(written, bytes(chunk))
                except OSError as error:
                    raise OutputError(f"{file.where}: cannot be copied to {place}: {reason(error)}") from None
        yield copy


def exists(where: str) -> bool:
    """Whether there is a file or an object; raises OutputError if the store does not say."""
    if not is_remote(where):
        return Path(where).exists()
    store, path = _split(where)
    with _store_errors(where, OutputError):
        try:
            obstore().head(_store(store), path)
        except FileNotFoundError:
            return False
    return True


def refuse_object(where: str, *, force: bool = False) -> None:
    """Refuse, before a long run, an object that could not be written at its end: raises OutputExists or OutputError."""
    _, path = _split(where)
    if not path or where.endswith("/"):
        raise OutputError(f"{where}: it is a folder: give the name of an object in it, such as calibrations.parquet")
    if exists(where) and not force:
        raise OutputExists(where)


def put(path: Path, where: str) -> None:
    """Copy a file of this machine to an object, which appears when it is complete; raises OutputError."""
    store, name = _split(where)
    with _store_errors(where, OutputError):
        obstore().put(_store(store), name, path)
