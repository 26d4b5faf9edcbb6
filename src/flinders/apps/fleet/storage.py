r"""Storage of recordings: local files, or objects of ``s3://``, ``gs://`` and ``az://`` through obstore.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17").mkdir(), (folder / "A17" / "monday.csv").write_text("x,y,z\n")
>>> [(file.name, file.size) for file in list_files(str(folder))]
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

from flinders.core.files import reason_and_remedy, write_all
from flinders.errors import OutputError, OutputExists, UnreadableInput
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.errors import FlindersError

WILDCARD: Final = re.compile(r"[*?\[]")
STORE: Final = re.compile(r"(s3a?|gs|az|abfss?)://[^/]+")
"""Pattern of the store in a URL; the path of an object follows it."""
CHUNK_BYTES: Final = 1 << 22
MAX_WHOLE_BYTES: Final = 1 << 18
"""Largest size of an object that is read whole, which takes no longer than another request."""
CHECKPOINT_SUFFIXES: Final = (".parquet.parts", ".pq.parts")
"""Suffixes of the folder of a checkpoint."""
KINDS: Final = {stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device", stat.S_IFBLK: "device"}
"""Entries of a folder that are no files."""
VARIABLE_PREFIXES: Final = ("AWS_", "AZURE_", "GOOGLE_")
"""Prefixes of environment variables with address and credentials of a store."""


@dataclass(frozen=True, slots=True, order=True)
class StoredFile:
    """A file on the disk, or an object of a store."""

    name: str  # path below the folder that was given, with slashes
    where: str  # path or URL
    size: int  # bytes
    stamp: str = ""  # time of change or tag, which differs after the file has changed
    kind: str = ""  # kind of an entry that is no file, such as ``pipe``; it is never opened, since opening may block


def is_remote(where: str) -> bool:
    """Whether a path is a URL that obstore opens.

    >>> is_remote("s3://fleet/2026/"), is_remote("logs/")
    (True, False)
    """
    return STORE.match(where) is not None


def list_files(where: str) -> list[StoredFile]:
    """List the files of a folder, a pattern, a file or a URL, sorted by name, without hidden ones and checkpoints.

    Raises UnreadableInput if there are no files, or they cannot be listed, and MissingExtra for a URL without obstore.
    """
    files = sorted(_objects(where) if is_remote(where) else _files(where), key=attrgetter("name"))
    if not files:
        raise UnreadableInput(f"{where}: no files: give a folder, a pattern in quotes such as 'logs/*.bin', or a URL")
    return files


def _is_hidden(name: str) -> bool:
    """Whether a file is hidden, or belongs to a checkpoint."""
    return any(part.startswith((".", "_")) or part.endswith(CHECKPOINT_SUFFIXES) for part in PurePosixPath(name).parts)


def _files(where: str) -> Iterator[StoredFile]:
    """Yield local files."""
    root = Path(where)
    try:
        if root.is_file():
            yield _file(root, root.name)
        elif root.is_dir():
            yield from _files_below(root)
        elif WILDCARD.search(where):
            start = Path(*takewhile(lambda part: not WILDCARD.search(part), Path(where).parts))
            for found_path in map(Path, glob.glob(where, recursive=True)):  # noqa: PTH207 - a pattern may be absolute
                name = found_path.relative_to(start).as_posix() if start.parts else found_path.as_posix()
                if not found_path.is_dir() and not _is_hidden(name):
                    yield _file(found_path, name)
        else:
            raise FileNotFoundError(2, "")
    except OSError as error:
        raise UnreadableInput(f"{where}: cannot be listed: {reason_and_remedy(error)}") from None


def _files_below(root: Path) -> Iterator[StoredFile]:
    """Yield files in a folder and below; also folders that cannot be listed, for a row about them."""
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
            if name[0] in "._" or name.endswith(CHECKPOINT_SUFFIXES):
                continue
            if not _is_folder(entry):
                yield _file(entry, prefix + name)
            elif not _is_loop(folder, entry):
                folders.append((entry.path, f"{prefix}{name}/"))


def _is_folder(entry: os.DirEntry[str]) -> bool:
    """Whether an entry is a folder, or a link to one; False for a link in a loop."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def _is_loop(folder: str, entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder is a link to that folder or to one above it, which could be followed without end."""
    return entry.is_symlink() and Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(entry.path))


def _file(path: Path | os.DirEntry[str], name: str) -> StoredFile:
    """Description of a file; only its name for a broken link, or a file that cannot be read."""
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
    import_optional("obstore.store", "cloud", "an object store")
    return import_optional("obstore", "cloud", "an object store")


def _split(where: str) -> tuple[str, str]:
    """Split a URL into the store and the path in it.

    >>> _split("gs://fleet/2026/A17.csv")
    ('gs://fleet', '2026/A17.csv')
    """
    store = cast("re.Match[str]", STORE.match(where))[0]
    return store, where.removeprefix(store).strip("/")


def _store(where: str) -> Any:  # noqa: ANN401 - a store of obstore
    """Open the store of a URL, once for each environment, since that takes 10 ms and a connection."""
    return _store_in_environment(
        where, tuple((name, os.environ[name]) for name in sorted(os.environ) if name.startswith(VARIABLE_PREFIXES))
    )


@functools.lru_cache(maxsize=64)
def _store_in_environment(where: str, _: tuple[tuple[str, str], ...]) -> Any:  # noqa: ANN401
    """Open the store of a URL; the second argument, variables of the environment, is only a key of the cache."""
    return obstore().store.from_url(where)


def _objects(where: str) -> Iterator[StoredFile]:
    """Yield objects of a store."""
    is_folder = not WILDCARD.search(where) and (where.endswith("/") or not PurePosixPath(_split(where)[1]).suffix)
    fixed = where.rstrip("/") if is_folder else WILDCARD.split(where)[0].rpartition("/")[0]
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
        raise refused(f"{where}: error of the store: {message}; check name, region and credentials") from None


@contextlib.contextmanager
def open_stored(file: StoredFile) -> Iterator[Any]:
    """Open a file or object for random access; yields a local path or a binary file. Raises UnreadableInput."""
    if not is_remote(file.where):
        yield file.where
        return
    with _store_errors(file.where):
        store, path = _split(file.where)
        yield _Object(_store(store), path, file.size)


class _Object(io.RawIOBase):
    """Binary file with random access to an object; each read is a request, but a small object is read whole."""

    def __init__(self, store: Any, path: str, size: int) -> None:  # noqa: ANN401
        self._store, self._path, self._size = store, path, size
        self._at = self._first = 0
        self._content = b""

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any writable buffer
        begin, end = self._at, min(self._at + len(buffer), self._size)
        if begin < end and not self._first <= begin < end <= self._first + len(self._content):
            self._first, last = (0, self._size) if self._size <= MAX_WHOLE_BYTES else (begin, end)
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
def fetch(file: StoredFile) -> Iterator[Path]:
    """Copy an object to a temporary local file and yield its path; of a local file, yield its own path.

    Raises UnreadableInput if it cannot be read, and OutputError if the disk has no space for the copy.
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
            for chunk in _store(store).get(path).stream(min_chunk_size=CHUNK_BYTES):
                try:
                    write_all(written, bytes(chunk))
                except OSError as error:
                    raise OutputError(
                        f"{file.where}: cannot be copied to {place}: {reason_and_remedy(error)}"
                    ) from None
        yield copy


def exists(where: str) -> bool:
    """Whether a file or an object exists; raises OutputError for an error of the store."""
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
    """Refuse, before a long run, an object that cannot be written: raises OutputExists or OutputError."""
    _, path = _split(where)
    if not path or where.endswith("/"):
        raise OutputError(f"{where} is a folder: give the name of an object in it, such as calibrations.parquet")
    if exists(where) and not force:
        raise OutputExists(where)


def put(path: Path, where: str) -> None:
    """Copy a local file to an object, which appears when it is complete; raises OutputError."""
    store, name = _split(where)
    with _store_errors(where, OutputError):
        obstore().put(_store(store), name, path)
