"""What other packages raise, as errors of this library: a package that is missing, a file that a parser cannot read.

>>> needs("json", "hdf5", "an HDF5 file").loads("[1, 2]")
[1, 2]
>>> needs("no_package", "hdf5", "an HDF5 file")
Traceback (most recent call last):
flinders.errors.MissingExtra: an HDF5 file needs no_package, which is not installed: pip install 'flinders[hdf5]' ...
"""

from __future__ import annotations

import struct
import zlib
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import FlindersError, MissingExtra, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_MESSAGE: Final = 120
"""Characters of another package's message that are passed on."""


def needs(package: str, extra: str, what: str) -> Any:  # noqa: ANN401 - a module, and few of these have types
    """Import an optional package such as ``h5py``, for `what` (with its article: ``an HDF5 file``).

    Where it is not installed, `MissingExtra` says to install the `extra`, ``hdf5``: ``pip install 'flinders[hdf5]'``.
    """
    try:
        return import_module(package)
    except ImportError:
        raise MissingExtra(package.partition(".")[0], extra, what) from None


OF_BYTES: Final = (
    ValueError, LookupError, ArithmeticError, EOFError, OSError, MemoryError, RecursionError, struct.error, zlib.error,
)  # fmt: skip
"""What the bytes of a file make this program's own parsers raise; anything else that they raise is a fault of ours."""


def _is_our_fault(error: Exception) -> bool:
    """Whether this program raised it, or an array that it handled, and no bytes of a file are the cause.

    >>> def parsed(tag):
    ...     return tag.strip()
    >>> try:
    ...     parsed(1)
    ... except AttributeError as error:
    ...     parsed.__globals__["__name__"], _is_our_fault(error)
    ('flinders.foreign_errors', True)
    """
    from traceback import walk_tb

    modules = (str(frame.f_globals.get("__name__")) for frame, _ in walk_tb(error.__traceback__))
    packages = [module.partition(".")[0] for module in modules]
    raised_by = [package for package in packages if package != "numpy"][-1:]
    return raised_by == ["flinders"] and not isinstance(error, OF_BYTES)


@contextmanager
def reading(name: str, kind: str, *, advice: str = "copy it again") -> Iterator[None]:
    """Let a parser read a file, and turn whatever it raises into one line: on a broken file that is anything.

    `kind` is what the file should be, with its article, and `advice` what to do about a broken one. Errors of Flinders
    pass through, and so do faults of this program, which are no file's.

    >>> with reading("log.parquet", "a Parquet table"):
    ...     {}["mag_x"]
    Traceback (most recent call last):
    flinders.errors.UnreadableInput: log.parquet cannot be read as a Parquet table (KeyError: 'mag_x'): it is broken or
    cut short; copy it again
    """
    try:
        yield
    except FlindersError:
        raise
    except Exception as error:
        if _is_our_fault(error):
            raise
        said = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":").removesuffix(": ")
        message = "".join(letter if letter.isprintable() else "\ufffd" for letter in said)
        raise UnreadableInput(
            f"{name} cannot be read as {kind} ({message[:MAX_MESSAGE]}): it is broken or cut short; {advice}"
        ) from None
