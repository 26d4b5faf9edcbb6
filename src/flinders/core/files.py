"""Files read up to a size, and written whole or not at all.

What is written goes into a temporary file beside the target first, which takes its name once it is
complete and on the disk: no reader ever meets half of it, and an interrupted run leaves nothing behind.

A few kilobytes can be packed so that they fill a disk, or the memory. A stream of more than `LARGE` bytes is refused
while it is being unpacked, once it has `MOST_RATIO` times the bytes that it came of; a piece that has to be in memory
as a whole, at `MOST_PIECE` bytes.

>>> import zlib
>>> unpacked_piece(zlib.decompressobj(), zlib.compress(b"whole"))
b'whole'
>>> sum(map(len, metered("zeros.csv.gz", [bytes(1 << 23)] * 3, lambda: 20_000)))
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

LARGE, MOST_RATIO = 16 << 20, 250
"""Bytes from which on the ratio counts, and the ratio: a table of digits packs to a fifth, zeros to a thousandth."""
MOST_PIECE: Final = 1 << 30
"""Bytes that one packed piece may have, unpacked: a chunk of a bag has a few million."""
LONGEST_OWNER: Final = 200  # Bytes that say which program has locked a file
LOCKED_BYTE: Final = 1 << 20


def reason(error: OSError | ValueError) -> str:
    """Say what is wrong with a path, and what to do."""
    if isinstance(error, OSError) and error.errno is not None:
        return REASONS.get(error.errno, error.strerror or str(error))
    return str(error)


def free_path(path: Path) -> Path:
    """A path that no file has: this one, or one with a number behind its name.

    >>> free_path(Path(__file__)).name, free_path(Path("new.csv")).name
    ('files_2.py', 'new.csv')
    """
    names = (f"{path.stem}_{number}{path.suffix}" for number in count(2))
    return path if not path.exists() else next(free for name in names if not (free := path.with_name(name)).exists())


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


def is_bomb(unpacked: int, packed: int) -> bool:
    """Tell whether so many bytes have come of so few as no table of readings packs to."""
    return unpacked > LARGE and unpacked > MOST_RATIO * packed


def metered(
    name: str, chunks: Iterable[bytes], packed: Callable[[], int], *, most: int | None = None, ratio: bool = True
) -> Iterator[bytes]:
    """Pass on what is unpacked, and refuse what becomes too much with `UnreadableInput`.

    Parameters
    ----------
    name : str
        For messages.
    chunks : iterable of bytes
        Unpacked.
    packed : callable
        Gives the bytes of which what has come so far was made.
    most : int, optional
        Bytes that are let pass at most.
    ratio : bool
        Judge it by `MOST_RATIO` too, which arrays need not keep: one of zeros packs to a thousandth.
    """
    done = 0
    for chunk in chunks:
        done += len(chunk)
        if (most is not None and done > most) or (ratio and is_bomb(done, packed())):
            raise too_much(name, done, packed())
        yield chunk


def too_much(name: str, unpacked: int, packed: int) -> UnreadableInput:
    """Say that so few bytes unpack to more than any recording has."""
    return UnreadableInput(
        f"{name} unpacks to more than {unpacked >> 20:,} MB from {packed:,} bytes, as no recording does: unpack it "
        "yourself if you trust it"
    )


def refuse_bomb(name: str, unpacked: int, packed: int) -> None:
    """Refuse a file that says it holds more than so few bytes of readings pack to."""
    if is_bomb(unpacked, packed):
        raise UnreadableInput(
            f"{name} is said to hold {unpacked >> 20:,} MB in {packed:,} bytes, as no recording does: write it anew "
            "without packing if you trust it"
        )


def unpacked_piece(unpacker: Any, packed: bytes) -> bytes:  # noqa: ANN401 - of zlib, bz2 …
    """Unpack a piece; one that is cut raises `ValueError`, and more than `MOST_PIECE` bytes `UnreadableInput`."""
    content: bytes = unpacker.decompress(packed, MOST_PIECE)
    if unpacker.eof:
        return content
    if len(content) >= MOST_PIECE:
        raise UnreadableInput(
            f"a packed piece of the recording has more than {MOST_PIECE >> 20} MB: no logger wrote it"
        )
    raise ValueError("a packed piece is not whole")


def write_text(text: str, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a text file; as `replacing`."""
    with replacing(path, force=force) as file:
        file.write(text)


def write_bytes(content: bytes, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a file of bytes; as `replacing`."""
    with replacing(path, force=force, encoding="latin-1", newline="") as file:  # a character for each byte
        file.write(content.decode("latin-1"))


def write_folder(files: Mapping[str, str], directory: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
    """Write text files by their names below a folder, which is made; the paths, in order of name.

    Raises `OutputExists` where a file is there and `force` is not given: nothing was written then; `OutputError` where
    a file cannot be written.
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


@contextlib.contextmanager
def exclusive(path: str | os.PathLike[str]) -> Iterator[None]:
    """Keep a file that is replaced whole for this program, by a lock on ``PATH.lock`` beside it, which stays there.

    The system unlocks it when a program ends, also by ``kill -9``. Systems and file systems without locks keep nobody
    out.

    Raises `OutputError` where another program keeps the file, or nothing can be written beside it.
    """
    target = Path(os.path.realpath(path))
    with _refusals(path):
        descriptor = os.open(target.with_name(f"{target.name}.lock"), os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not _locked_far(descriptor):
            owner = os.read(descriptor, LONGEST_OWNER).decode(errors="replace").strip() or "it has not said which"
            raise OutputError(f"{path}: another program keeps this file ({owner}): stop that one, or name another file")
        with contextlib.suppress(OSError):  # a full disk
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {platform.node()}\n".encode())
        yield
    finally:
        os.close(descriptor)


def _locked_far(descriptor: int) -> bool:
    """As `locked`; of Windows, which lets nobody read what is locked, a byte behind the end of the file."""
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True
    return locked(descriptor)


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


def licence() -> str:
    """The licence of flinders, which is in its distribution."""
    from importlib.metadata import distribution

    for file in distribution("flinders").files or ():
        if file.name == "LICENSE" and "licenses" in file.parts:
            return file.read_text()
    raise OutputError("the licence of flinders is not installed with it: install flinders anew")
