"""Files read up to a size, and written whole or not at all.

What is written goes into a temporary file beside the target first, which takes its name once it is
complete and on the disk: no reader ever meets half of it, and an interrupted run leaves nothing behind.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from flinders.errors import OutputError, OutputExists

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import FileIO

    from flinders.errors import FlindersError

REASONS: Final = {
    errno.ENOENT: "no such file or folder: check the name",
    errno.ENOTDIR: "a part of its path is a file, not a folder: check the name",
    errno.EISDIR: "it is a directory: give the name of a file",
    errno.EACCES: "no permission: change the permissions, or use another folder",
    errno.EPERM: "no permission: change the permissions, or use another folder",
    errno.EROFS: "the file system is read-only: use another folder",
    errno.ENOSPC: "no space left on the disk: free some, or use another disk",
    errno.EDQUOT: "the disk quota is used up: free some space, or use another disk",
    errno.EBADF: "it is closed: leave it open, or name a file",
    errno.ENAMETOOLONG: "the name is too long: use a shorter one",
    errno.ELOOP: "its symbolic links lead in a circle: give the name of a file",
}
"""What to do about an error of the operating system."""


def reason(error: OSError | ValueError) -> str:
    """Say what is wrong with a path, and what to do."""
    if isinstance(error, OSError) and error.errno is not None:
        return REASONS.get(error.errno, error.strerror or str(error))
    return str(error)


def read_bytes(path: str | os.PathLike[str], *, largest: int, what: str, refused: type[FlindersError]) -> bytes:
    """Read a file that is known to be small, `what`: a name that is mixed up does not fill the memory.

    What cannot be opened, or has more than `largest` bytes, raises the error `refused`.
    """
    try:
        with Path(path).open("rb") as file:
            text = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise refused(f"{path}: cannot be read: {reason(error)}") from None
    if len(text) > largest:
        raise refused(f"{path}: more than {largest // 2**20} MB is no {what}: check the name")
    return text


def write_text(text: str, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a text file; as `replacing`."""
    with replacing(path, force=force) as file:
        file.write(text)


def write_bytes(content: bytes, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a file of bytes; as `replacing`."""
    with replacing(path, force=force, encoding="latin-1", newline="") as file:  # a character for each byte
        file.write(content.decode("latin-1"))


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it, unless it is there; `OutputError` says why it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: no folder can be made there: {reason(error)}") from None


def write_all(file: FileIO, content: bytes | memoryview) -> None:
    """Write to a file without a buffer, which would fail again when it is closed; raises OSError.

    A disk that is nearly full takes a part, and says only of the rest that it is full.
    """
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]


def locked(descriptor: int) -> bool:
    """Lock an open file or folder for this program until it is closed; False where another program has locked it.

    True on systems and file systems without such locks.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def refuse_existing(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Find out before a long run whether a file could be written at its end; raises as `replacing`."""
    with _refusals(path):
        target = _target(path)
        _permissions(target, force=force)
        if not target.parent.is_dir():
            raise FileNotFoundError
        if not os.access(target.parent, os.W_OK):
            raise PermissionError(errno.EACCES, "no permission")


@contextlib.contextmanager
def replacing(
    path: str | os.PathLike[str], *, force: bool = False, encoding: str = "utf-8", newline: str = "\n"
) -> Iterator[IO[str]]:
    """Open a text file for writing that appears under its name when the block ends well.

    A symbolic link stays, and what it points to is written; a file that is replaced keeps its permissions.

    Raises `OutputExists` where there is a file already, unless `force`; `OutputError` where it cannot be written.
    """
    with _refusals(path):
        target = _target(path)
        permissions = _permissions(target, force=force)
        temporary = target.with_name(f".flinders-{os.urandom(8).hex()}.tmp")
        try:
            with temporary.open("x", encoding=encoding, newline=newline) as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            if permissions is not None:
                temporary.chmod(permissions)
            _publish(temporary, target, force=force)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()


@contextlib.contextmanager
def _refusals(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn what the operating system says into what to do about it."""
    try:
        yield
    except FileExistsError:
        raise OutputExists(path) from None
    except FileNotFoundError:
        raise OutputError(f"{path}: cannot be written: no such folder: create it, or check the name") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason(error)}") from None


def _target(path: str | os.PathLike[str]) -> Path:
    """Follow symbolic links to the file that will be written."""
    if "\0" in os.fspath(path):
        raise OSError(errno.EINVAL, "its name holds a null character: check the name")
    return Path(os.path.realpath(path))


def _permissions(target: Path, *, force: bool) -> int | None:
    """Look at what is there: its permissions if it may be replaced, None if there is nothing."""
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "a directory")
    if stat.S_ISLNK(mode):
        raise OSError(errno.ELOOP, "a circle")
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is a device or a pipe: give the name of a file")
    if not force:
        raise FileExistsError
    if not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, "read-only")
    return stat.S_IMODE(mode)


def _publish(temporary: Path, target: Path, *, force: bool) -> None:
    """Give a finished file its name; without `force`, a file that appeared meanwhile is kept."""
    if not force:
        try:
            target.hardlink_to(temporary)  # unlike a rename, refuses a name that is taken
        except FileExistsError:
            raise
        except OSError:
            pass  # a file system without hard links
        else:
            return
    temporary.replace(target)
