"""Reading of files up to a size limit, and atomic writing.

A file is first written to a temporary file in the same folder, which is renamed once it is complete and
on the disk. No reader sees a partial file, and an interrupted run leaves none.

A compressed file of a few kilobytes can expand until the disk or the memory is full. A stream of more than
`MIN_RATIO_BYTES` bytes is refused during decompression once it exceeds `MAX_RATIO` times its compressed size; a chunk
that has to be in memory as a whole is refused at `MAX_CHUNK_BYTES` bytes.

>>> import zlib
>>> decompress_chunk(zlib.decompressobj(), zlib.compress(b"whole"))
b'whole'
>>> sum(map(len, limit_size("zeros.csv.gz", [bytes(1 << 23)] * 3, lambda: 20_000)))
Traceback (most recent call last):
flinders.errors.UnreadableInput: zeros.csv.gz unpacks to more than 24 MB from 20,000 bytes, as no recording does: unpack
it yourself if you trust it
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import stat
import sys
from itertools import count
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from flinders.errors import OutputError, OutputExists, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from io import FileIO

    from flinders.errors import FlindersError

REASONS_BY_ERRNO: Final = {
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
"""Reason and remedy for errors of the operating system, by their number."""

MIN_RATIO_BYTES, MAX_RATIO = 16 << 20, 250
"""Size in bytes from which the ratio is checked, and the largest ratio of decompressed to compressed size.

A table of digits compresses to a fifth, zeros to a thousandth.
"""
MAX_CHUNK_BYTES: Final = 1 << 30
"""Largest decompressed size of one chunk in bytes; a chunk of a bag has a few million."""
MAX_OWNER_BYTES: Final = 200  # bytes: longest name of the program that holds a lock
LOCK_OFFSET: Final = 1 << 20  # offset of the locked byte in a lock file on Windows


def reason_and_remedy(error: OSError | ValueError) -> str:
    """Reason and remedy for an error that a path caused, in words."""
    if isinstance(error, OSError) and error.errno is not None:
        return REASONS_BY_ERRNO.get(error.errno, error.strerror or str(error))
    return str(error)


def free_path(path: Path) -> Path:
    """A path of no existing file: `path`, else `path` with a number after its name.

    >>> free_path(Path(__file__)).name, free_path(Path("new.csv")).name
    ('files_2.py', 'new.csv')
    """
    names = (f"{path.stem}_{number}{path.suffix}" for number in count(2))
    return path if not path.exists() else next(free for name in names if not (free := path.with_name(name)).exists())


def read_bytes(path: str | os.PathLike[str], *, largest: int, what: str, refused: type[FlindersError]) -> bytes:
    """Read a file of at most `largest` bytes; a larger one, given by mistake, is not read into memory.

    Raises `refused` for a file that is larger or cannot be opened. `what` is the kind of file in words.
    """
    try:
        with Path(path).open("rb") as file:
            text = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise refused(f"{path} cannot be read: {reason_and_remedy(error)}") from None
    if len(text) > largest:
        raise refused(f"{path}: more than {largest // 2**20} MB is no {what}: check the name")
    return text


def is_bomb(unpacked: int, packed: int) -> bool:
    """Whether `unpacked` bytes from `packed` compressed bytes are more than any table of readings gives."""
    return unpacked > MIN_RATIO_BYTES and unpacked > MAX_RATIO * packed


def limit_size(
    name: str, chunks: Iterable[bytes], packed: Callable[[], int], *, most: int | None = None, ratio: bool = True
) -> Iterator[bytes]:
    """Yield decompressed chunks; raises `UnreadableInput` once they are too large.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    chunks : iterable of bytes
        Decompressed content.
    packed : callable
        Returns the number of compressed bytes read so far.
    most : int, optional
        Largest total size in bytes.
    ratio : bool
        Also check `MAX_RATIO`. Arrays may exceed it: zeros compress to a thousandth.
    """
    done = 0
    for chunk in chunks:
        done += len(chunk)
        if (most is not None and done > most) or (ratio and is_bomb(done, packed())):
            raise size_error(name, done, packed())
        yield chunk


def size_error(name: str, unpacked: int, packed: int) -> UnreadableInput:
    """Error for a file that expands to more bytes than a recording of its size can have."""
    return UnreadableInput(
        f"{name} unpacks to more than {unpacked >> 20:,} MB from {packed:,} bytes, as no recording does: unpack it "
        "yourself if you trust it"
    )


def refuse_bomb(name: str, unpacked: int, packed: int) -> None:
    """Refuse a file whose stated decompressed size is implausible for its `packed` bytes."""
    if is_bomb(unpacked, packed):
        raise UnreadableInput(
            f"{name} states {unpacked >> 20:,} MB of content in {packed:,} bytes, as no recording does: write it again "
            "without compression if you trust it"
        )


def decompress_chunk(unpacker: Any, packed: bytes) -> bytes:  # noqa: ANN401 - of zlib, bz2 …
    """Decompress a chunk; raises `ValueError` if it is truncated, `UnreadableInput` beyond `MAX_CHUNK_BYTES` bytes."""
    content: bytes = unpacker.decompress(packed, MAX_CHUNK_BYTES)
    if unpacker.eof:
        return content
    if len(content) >= MAX_CHUNK_BYTES:
        raise UnreadableInput(
            f"a compressed chunk of the recording has more than {MAX_CHUNK_BYTES >> 20} MB, as no logger writes: "
            "record again, or give another file"
        )
    raise ValueError("a compressed chunk is truncated")


def write_text(text: str, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a text file atomically; raises as `open_atomically`."""
    with open_atomically(path, force=force) as file:
        file.write(text)


def write_bytes(content: bytes, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a file of bytes atomically; raises as `open_atomically`."""
    with open_atomically(path, force=force, encoding="latin-1", newline="") as file:  # a character for each byte
        file.write(content.decode("latin-1"))


def write_folder(files: Mapping[str, str], directory: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
    """Write text files, given by name, into a folder that is created if needed; returns their paths by name.

    Raises `OutputExists`, before anything is written, if a file exists, unless `force`; `OutputError` if a file cannot
    be written.
    """
    texts = {Path(directory, name): text for name, text in sorted(files.items())}
    for path in texts:
        if path.exists() and not force:
            raise OutputExists(path)
    for path, text in texts.items():
        make_folder(path.parent)
        write_text(text, path, force=force)
    return list(texts)


def make_folder(folder: Path) -> None:
    """Create a folder and its parents if they do not exist; raises `OutputError` if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: the folder cannot be created: {reason_and_remedy(error)}") from None


def write_all(file: FileIO, content: bytes | memoryview) -> None:
    """Write all bytes to an unbuffered file; raises OSError.

    A buffered file would fail a second time when it is closed. A nearly full disk first writes a part of the bytes and
    fails at the next write.
    """
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]


def try_lock(descriptor: int) -> bool:
    """Lock an open file or folder until it is closed; returns False if another program has locked it.

    Returns True on systems and file systems without locks.
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


@contextlib.contextmanager
def lock_path(path: str | os.PathLike[str]) -> Iterator[None]:
    """Keep other programs from replacing a file, by a lock on ``PATH.lock``, which stays on the disk.

    The system releases the lock when the program ends, also by ``kill -9``. Systems and file systems without locks
    give no protection.

    Raises `OutputError` if another program has locked the file, or the lock file cannot be written.
    """
    target = Path(os.path.realpath(path))
    with _translate_errors(path):
        descriptor = os.open(target.with_name(f"{target.name}.lock"), os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not _lock_after_end(descriptor):
            owner = os.read(descriptor, MAX_OWNER_BYTES).decode(errors="replace").strip() or "its name is not known"
            raise OutputError(f"{path}: another program has locked this file ({owner}): stop it, or name another file")
        with contextlib.suppress(OSError):  # a full disk
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {platform.node()}\n".encode())
        yield
    finally:
        os.close(descriptor)


def _lock_after_end(descriptor: int) -> bool:
    """Lock a file as `try_lock` does; on Windows, where locked bytes cannot be read, lock a byte after its end."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, LOCK_OFFSET, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True
    return try_lock(descriptor)


def refuse_existing(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Check before a long run that its output file can be written; raises as `open_atomically`."""
    with _translate_errors(path):
        target = _resolved_path(path)
        _existing_permissions(target, force=force)
        if not target.parent.is_dir():
            raise FileNotFoundError
        if not os.access(target.parent, os.W_OK):
            raise PermissionError(errno.EACCES, "no permission")


@contextlib.contextmanager
def open_atomically(
    path: str | os.PathLike[str], *, force: bool = False, encoding: str = "utf-8", newline: str = "\n"
) -> Iterator[IO[str]]:
    """Open a text file for writing; it gets its name when the block ends without an error.

    A symbolic link is followed, and a replaced file keeps its permissions.

    Raises `OutputExists` if the file exists, unless `force`; `OutputError` if it cannot be written.
    """
    with _translate_errors(path):
        target = _resolved_path(path)
        permissions = _existing_permissions(target, force=force)
        temporary = target.with_name(f".flinders-{os.urandom(8).hex()}.tmp")
        try:
            with temporary.open("x", encoding=encoding, newline=newline) as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            if permissions is not None:
                temporary.chmod(permissions)
            _rename(temporary, target, force=force)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()


@contextlib.contextmanager
def _translate_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn errors of the operating system into errors of Flinders, with a remedy."""
    try:
        yield
    except FileExistsError:
        raise OutputExists(path) from None
    except FileNotFoundError:
        raise OutputError(f"{path}: cannot be written: no such folder: create it, or check the name") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason_and_remedy(error)}") from None


def _resolved_path(path: str | os.PathLike[str]) -> Path:
    """Path of the file that will be written, after symbolic links."""
    if "\0" in os.fspath(path):
        raise OSError(errno.EINVAL, "its name holds a null character: check the name")
    return Path(os.path.realpath(path))


def _existing_permissions(target: Path, *, force: bool) -> int | None:
    """Permissions of an existing file that may be replaced; None if there is no file."""
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


def _rename(temporary: Path, target: Path, *, force: bool) -> None:
    """Rename the finished temporary file; without `force`, an existing file is not replaced."""
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


def licence_text() -> str:
    """Text of Flinders' licence, from its installed distribution."""
    from importlib.metadata import distribution

    for file in distribution("flinders").files or ():
        if file.name == "LICENSE" and "licenses" in file.parts:
            return file.read_text()
    raise OutputError("the licence of flinders is not installed: install flinders again")
