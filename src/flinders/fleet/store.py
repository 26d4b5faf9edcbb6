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
import glob
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import MissingExtra, UnreadableInput
from flinders.files import reason

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC: Final = re.compile(r"[*?\[]")
REMOTE: Final = re.compile(r"(s3|s3a|gs|az|abfs|abfss|memory|https?|file)://")
"""What obstore is asked for; ``file://`` too, so that the way through it can be tried without a cloud."""
CHUNK: Final = 1 << 22


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
    """

    name: str
    where: str
    size: int
    stamp: str = ""


def is_remote(where: str) -> bool:
    """Whether obstore is asked for it.

    >>> is_remote("s3://fleet/2026/"), is_remote("logs/")
    (True, False)
    """
    return REMOTE.match(where) is not None


def listed(where: str) -> list[Member]:
    """The files that a folder, a pattern, a file or a URL names, by name; hidden ones and ``_SUCCESS`` are left out.

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
    return any(part.startswith((".", "_")) for part in PurePosixPath(name).parts)


def _files(where: str) -> Iterator[Member]:
    """Files of this machine."""
    root = Path(where)
    try:
        if root.is_file():
            yield _file(root, root.name)
        elif root.is_dir():
            for folder, folders, names in os.walk(root, followlinks=True, onerror=_raise):
                folders[:] = sorted(name for name in folders if not _is_hidden(name))
                found = (Path(folder) / name for name in names if not _is_hidden(name))
                yield from (_file(path, path.relative_to(root).as_posix()) for path in found if path.is_file())
        elif MAGIC.search(where):
            start = Path(*_fixed(Path(where).parts))
            for found_path in map(Path, glob.glob(where, recursive=True)):  # noqa: PTH207 - a pattern may be absolute
                name = found_path.relative_to(start).as_posix() if start.parts else found_path.as_posix()
                if found_path.is_file() and not _is_hidden(name):
                    yield _file(found_path, name)
        else:
            raise FileNotFoundError(2, "")
    except OSError as error:
        raise UnreadableInput(f"{where}: cannot be listed: {reason(error)}") from None


def _raise(error: OSError) -> None:
    raise error


def _fixed(parts: tuple[str, ...]) -> list[str]:
    """The parts of a pattern before the first with a star.

    >>> _fixed(("logs", "2026-*", "a.bin"))
    ['logs']
    """
    magic = next(place for place, part in enumerate(parts) if MAGIC.search(part))
    return list(parts[:magic])


def _file(path: Path, name: str) -> Member:
    status = path.stat()
    return Member(name, str(path), status.st_size, str(status.st_mtime_ns))


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


def _objects(where: str) -> Iterator[Member]:
    """Objects of a store."""
    is_folder = not MAGIC.search(where) and not PurePosixPath(where).suffix
    fixed = where.rstrip("/") if is_folder else MAGIC.split(where)[0].rpartition("/")[0]
    pattern = where[len(fixed) :].lstrip("/")
    with _told(where):
        store = obstore().store.from_url(fixed)
        for batch in store.list():
            for held in batch:
                name = str(held["path"])
                if not _is_hidden(name) and (not pattern or fnmatch.fnmatchcase(name, pattern)):
                    yield Member(name, f"{fixed}/{name}", int(held["size"]), str(held["e_tag"]))


@contextlib.contextmanager
def _told(where: str) -> Iterator[None]:
    """Turn whatever a store says into one line.

    Raises
    ------
    UnreadableInput
    """
    module = obstore()
    try:
        yield
    except (module.exceptions.BaseError, OSError, ValueError) as error:
        said = " ".join(str(error).split())[:200]
        raise UnreadableInput(f"{where}: the store says: {said}; check the name, the region and who you are") from None


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
    folder, _, name = member.where.rpartition("/")
    with _told(member.where):
        yield _Seekable(obstore().open_reader(obstore().store.from_url(folder), name))


class _Seekable:
    """A reader of obstore as pyarrow wants a file to be."""

    def __init__(self, reader: Any) -> None:  # noqa: ANN401
        self._reader = reader
        self.closed = False

    def read(self, size: int = -1) -> bytes:
        return bytes(self._reader.read(size) if size >= 0 else self._reader.read())

    def seek(self, offset: int, whence: int = 0) -> int:
        return int(self._reader.seek(offset, whence))

    def tell(self) -> int:
        return int(self._reader.tell())

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return False

    def flush(self) -> None:
        """Nothing is written."""

    def close(self) -> None:
        self._reader.close()
        self.closed = True


@contextlib.contextmanager
def fetched(member: Member) -> Iterator[Path]:
    """A member as a file of this machine; a copy of an object goes afterwards.

    Raises
    ------
    UnreadableInput
        Where it cannot be read.
    """
    if not is_remote(member.where):
        yield Path(member.where)
        return
    folder, _, name = member.where.rpartition("/")
    with tempfile.TemporaryDirectory(prefix="flinders-") as place:
        copy = Path(place) / name
        with _told(member.where), copy.open("wb") as file:
            for chunk in obstore().store.from_url(folder).get(name).stream(min_chunk_size=CHUNK):
                file.write(chunk)
        yield copy
