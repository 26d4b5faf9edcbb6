r"""Where recordings lie: files of this machine, or objects of ``s3://``, ``gs://`` and ``az://`` through obstore.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> _ = (folder / "A17").mkdir(), (folder / "A17" / "monday.csv").write_text("x,y,z\n")
>>> [(member.name, member.size) for member in listed(str(folder))]
[('A17/monday.csv', 6)]
"""

from __future__ import annotations

import contextlib
import fnmatch
import functools
import glob
import os
import re
import stat
import tempfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from flinders.core.files import reason, write_all
from flinders.errors import MissingExtra, OutputError, OutputExists, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.errors import FlindersError

MAGIC: Final = re.compile(r"[*?\[]")
REMOTE: Final = re.compile(r"(s3|s3a|gs|az|abfs|abfss|memory|https?|file)://")
"""What obstore is asked for; ``file://`` too, so that the way through it can be tried without a cloud."""
CHUNK: Final = 1 << 22
WHOLE: Final = 1 << 18
"""Bytes of an object that is read whole: as many take no longer than another request."""
BUCKET: Final = re.compile(r"(?:s3a?|gs|az|abfss?)://[^/]*")
"""What of a URL says whose store it is; after it comes the path of an object, as it is called there."""
PARTS: Final = (".parquet.parts", ".pq.parts")
"""How the folder ends in which a run keeps what it has done."""
KINDS: Final = {stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket", stat.S_IFCHR: "device", stat.S_IFBLK: "device"}
"""What may lie in a folder and is no file."""
NAMED_BY: Final = ("AWS_", "AZURE_", "GOOGLE_")
"""How variables begin that say where a store is and who asks."""


@dataclass(frozen=True, slots=True, order=True)
class Member:
    """One file or object.

    Attributes
    ----------
    name : str
        Below what was given, with slashes.
    where : str
        Its path or URL.
    size : int, bytes
    stamp : str
        Changes when it does.
    kind : str
        What it is where it is no file, such as ``pipe``: never to be opened, since that may wait for ever.
    """

    name: str
    where: str
    size: int
    stamp: str = ""
    kind: str = ""


def is_remote(where: str) -> bool:
    """Whether obstore is asked for it.

    >>> is_remote("s3://fleet/2026/"), is_remote("logs/")
    (True, False)
    """
    return REMOTE.match(where) is not None


def listed(where: str) -> list[Member]:
    """The files that a folder, a pattern, a file or a URL names, by name.

    Hidden ones and ``_SUCCESS`` are left out, and so is the folder in which a run keeps what it has done.

    Raises
    ------
    UnreadableInput
        Where there is nothing, or it cannot be listed.
    MissingExtra
        For a URL, where obstore is not installed.
    """
    members = sorted(_objects(where) if is_remote(where) else _files(where))
    if not members:
        raise UnreadableInput(f"{where}: no files: give a folder, a pattern in quotes such as 'logs/*.bin', or a URL")
    return members


def _is_hidden(name: str) -> bool:
    return any(part.startswith((".", "_")) or part.endswith(PARTS) for part in PurePosixPath(name).parts)


def _files(where: str) -> Iterator[Member]:
    """Files of this machine."""
    root = Path(where)
    try:
        if root.is_file():
            yield _file(root, root.name)
        elif root.is_dir():
            yield from _below(root)
        elif MAGIC.search(where):
            start = Path(*_fixed(Path(where).parts))
            for found_path in map(Path, glob.glob(where, recursive=True)):  # noqa: PTH207 - a pattern may be absolute
                name = found_path.relative_to(start).as_posix() if start.parts else found_path.as_posix()
                if not found_path.is_dir() and not _is_hidden(name):
                    yield _file(found_path, name)
        else:
            raise FileNotFoundError(2, "")
    except OSError as error:
        raise UnreadableInput(f"{where}: cannot be listed: {reason(error)}") from None


def _below(root: Path) -> Iterator[Member]:
    """Files in a folder and those below; of what may not be looked at, or is not there, its name, for a row of its own.

    Raises
    ------
    OSError
        Where the folder itself may not be listed.
    """
    closed: list[str] = []
    os.scandir(root).close()
    for folder, folders, names in os.walk(root, followlinks=True, onerror=lambda error: closed.append(error.filename)):
        here = Path(folder)
        folders[:] = sorted(name for name in folders if not _is_hidden(name) and not _leads_up(here, name))
        for path in (here / name for name in names if not _is_hidden(name)):
            yield _file(path, path.relative_to(root).as_posix())
    yield from (Member(f"{Path(name).relative_to(root).as_posix()}/", name, 0) for name in closed)


def _leads_up(folder: Path, name: str) -> bool:
    """Whether an entry of a folder is a link to it or to one above: who follows it comes here again and again."""
    link = folder / name
    is_link = os.path.islink(link)  # noqa: PTH114 - False where it may not be looked at
    return is_link and Path(os.path.realpath(folder)).is_relative_to(os.path.realpath(link))


def _fixed(parts: tuple[str, ...]) -> list[str]:
    """The parts of a pattern before the first with a star.

    >>> _fixed(("logs", "2026-*", "a.bin"))
    ['logs']
    """
    magic = next(place for place, part in enumerate(parts) if MAGIC.search(part))
    return list(parts[:magic])


def _file(path: Path, name: str) -> Member:
    """What lies there; of a link to nothing, and of what may not be looked at, no more than the name."""
    try:
        status = path.stat()
    except OSError:
        return Member(name, str(path), 0)
    return Member(name, str(path), status.st_size, str(status.st_mtime_ns), KINDS.get(stat.S_IFMT(status.st_mode), ""))


def obstore() -> Any:  # noqa: ANN401 - the module
    """Import obstore.

    Raises
    ------
    MissingExtra
        Where it is not installed.
    """
    try:
        import obstore
        import obstore.store
    except ImportError:
        raise MissingExtra("obstore", "cloud", "an object store") from None
    return obstore


def _split(where: str) -> tuple[str, str]:
    """The store of a URL, and the path in it.

    >>> _split("gs://fleet/2026/A17.csv"), _split("memory://logs/A17.csv")
    (('gs://fleet', '2026/A17.csv'), ('memory://logs', 'A17.csv'))
    """
    bucket = BUCKET.match(where)
    store, _, path = (bucket[0], "", where[bucket.end() :].strip("/")) if bucket else where.rpartition("/")
    return store, path


def _store(where: str) -> Any:  # noqa: ANN401 - a store of obstore
    """The store of a URL: one for all that ask alike, since a new one takes 10 ms and a connection of its own."""
    return _made(where, tuple((name, os.environ[name]) for name in sorted(os.environ) if name.startswith(NAMED_BY)))


@functools.lru_cache(maxsize=64)
def _made(where: str, _: tuple[tuple[str, str], ...]) -> Any:  # noqa: ANN401
    return obstore().store.from_url(where)


def _objects(where: str) -> Iterator[Member]:
    """Objects of a store."""
    is_folder = not MAGIC.search(where) and (where.endswith("/") or not PurePosixPath(_split(where)[1]).suffix)
    fixed = where.rstrip("/") if is_folder else MAGIC.split(where)[0].rpartition("/")[0]
    pattern = where[len(fixed) :].lstrip("/")
    with _told(where):
        store, folder = _split(fixed) if BUCKET.match(fixed) else (fixed, "")
        for batch in _store(store).list(folder or None):
            for held in batch:
                name = str(held["path"])[len(folder) :].lstrip("/")
                if not _is_hidden(name) and (not pattern or fnmatch.fnmatchcase(name, pattern)):
                    yield Member(name, f"{fixed}/{name}", int(held["size"]), str(held["e_tag"]))


@contextlib.contextmanager
def _told(where: str, refused: type[FlindersError] = UnreadableInput) -> Iterator[None]:
    """Turn whatever a store says into one line.

    Raises
    ------
    FlindersError
        Of the type `refused`.
    """
    module = obstore()
    try:
        yield
    except (module.exceptions.BaseError, OSError, ValueError) as error:
        said = " ".join(str(error).split())[:200]
        raise refused(f"{where}: the store says: {said}; check the name, the region and who you are") from None


@contextlib.contextmanager
def opened(member: Member) -> Iterator[Any]:
    """Open a member for reading here and there, such as the footer and some row groups.

    Raises
    ------
    UnreadableInput
        Where it is gone, or may not be read.
    """
    if not is_remote(member.where):
        yield member.where
        return
    with _told(member.where):
        store, path = _split(member.where)
        yield _Seekable(_store(store), path, member.size)


class _Seekable:
    """An object as pyarrow wants a file to be: each read is a request, but that of a small object is its only one.

    Parameters
    ----------
    store : store of obstore
    path : str
    size : int, bytes
    """

    def __init__(self, store: Any, path: str, size: int) -> None:  # noqa: ANN401
        self._store, self._path, self._size = store, path, size
        self._at = self._first = 0
        self._held = b""
        self.closed = False

    def read(self, size: int = -1) -> bytes:
        begin, end = self._at, self._size if size < 0 else min(self._at + size, self._size)
        if begin >= end:
            return b""
        if begin < self._first or end > self._first + len(self._held):
            self._first, last = (0, self._size) if self._size <= WHOLE else (begin, end)
            self._held = bytes(obstore().get_range(self._store, self._path, start=self._first, end=last))
        self._at = end
        return self._held[begin - self._first : end - self._first]

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return False

    def flush(self) -> None:
        """Nothing is written."""

    def close(self) -> None:
        self._held, self.closed = b"", True


@contextlib.contextmanager
def fetched(member: Member) -> Iterator[Path]:
    """A member as a file of this machine; a copy of an object goes afterwards.

    Raises
    ------
    UnreadableInput
        Where it cannot be read.
    OutputError
        Where there is no room for a copy.
    """
    if not is_remote(member.where):
        if member.name.endswith("/"):
            raise UnreadableInput(f"{member.name} cannot be listed: ask for permission to read the folder")
        yield Path(member.where)
        return
    store, path = _split(member.where)
    with tempfile.TemporaryDirectory(prefix="flinders-") as place:
        copy = Path(place) / PurePosixPath(path).name
        with _told(member.where), copy.open("wb", buffering=0) as file:
            for chunk in _store(store).get(path).stream(min_chunk_size=CHUNK):
                try:
                    write_all(file, bytes(chunk))
                except OSError as error:
                    raise OutputError(f"{member.where}: cannot be copied to {place}: {reason(error)}") from None
        yield copy


def refuse_object(where: str, *, force: bool = False) -> None:
    """Find out before a long run whether an object could be written at its end, as far as asking tells.

    Raises
    ------
    OutputExists
        Where there is one already, unless `force`.
    OutputError
        Where the URL names none, or the store does not answer.
    """
    store, path = _split(where)
    if not path or where.endswith("/"):
        raise OutputError(f"{where}: it is a folder: give the name of an object in it, such as calibrations.parquet")
    with _told(where, OutputError):
        try:
            obstore().head(_store(store), path)
        except FileNotFoundError:
            return
    if not force:
        raise OutputExists(where)


def put(path: Path, where: str) -> None:
    """Write a file of this machine as an object, which is there when all of it is.

    Raises
    ------
    OutputError
        Where the store does not take it.
    """
    store, name = _split(where)
    with _told(where, OutputError):
        obstore().put(_store(store), name, path)
