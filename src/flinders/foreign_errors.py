"""Conversion of exceptions of other packages to errors of Flinders: a missing package, a file that cannot be parsed.

>>> import_optional("json", "hdf5", "an HDF5 file").loads("[1, 2]")
[1, 2]
>>> import_optional("no_package", "hdf5", "an HDF5 file")
Traceback (most recent call last):
flinders.errors.MissingExtra: an HDF5 file needs no_package, which is not installed: pip install h5py (with uv: uv
pip install h5py)
"""

from __future__ import annotations

import re
import struct
import zlib
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import FlindersError, MissingExtra, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_MESSAGE_LENGTH: Final = 120
"""Longest part of another package's message that is shown, in characters."""


def import_optional(package: str, extra: str, what: str) -> Any:  # noqa: ANN401 - a module, and few of these have types
    """Import an optional package such as ``h5py``.

    `what` is the thing that needs the package, with an article: ``an HDF5 file``.

    Raises `MissingExtra`, with the command that installs the packages of the `extra`, if the package is not installed.
    """
    try:
        return import_module(package)
    except ImportError:
        missing = package.partition(".")[0]
        raise MissingExtra(missing, extra, what, packages_of_extra(extra) or [missing]) from None


def packages_of_extra(extra: str) -> list[str]:
    """Packages that an extra of Flinders installs, from its installed metadata; empty if the metadata is missing.

    >>> packages_of_extra("parquet"), packages_of_extra("fleet")
    (['pyarrow'], ['dask', 'distributed', 'pyarrow'])
    """
    from importlib import metadata

    try:
        requirements = metadata.requires("flinders") or []
    except metadata.PackageNotFoundError:
        return []
    of_extra = re.compile(rf"""([\w-]+)[^;]*; extra == ['"]{extra}['"]""")
    return [match[1] for requirement in requirements if (match := of_extra.match(requirement))]


INPUT_ERRORS: Final = (
    ValueError, LookupError, ArithmeticError, EOFError, OSError, MemoryError, RecursionError, struct.error, zlib.error,
)  # fmt: skip
"""Exceptions that the bytes of a file can cause in Flinders' own parsers; any other exception there is a bug."""


def _is_bug(error: Exception) -> bool:
    """Whether an exception is a bug of Flinders: raised in Flinders or in NumPy, and not by the bytes of a file.

    >>> def parsed(tag):
    ...     return tag.strip()
    >>> try:
    ...     parsed(1)
    ... except AttributeError as error:
    ...     parsed.__globals__["__name__"], _is_bug(error)
    ('flinders.foreign_errors', True)
    """
    from traceback import walk_tb

    modules = (str(frame.f_globals.get("__name__")) for frame, _ in walk_tb(error.__traceback__))
    packages = [module.partition(".")[0] for module in modules]
    raised_by = [package for package in packages if package != "numpy"][-1:]
    return raised_by == ["flinders"] and not isinstance(error, INPUT_ERRORS)


@contextmanager
def parser_errors(name: str, kind: str, *, advice: str = "copy it again") -> Iterator[None]:
    """Convert any exception of a parser in this context to an `UnreadableInput` of one line.

    `kind` is the expected kind of file, with an article; `advice` is the remedy for a broken file. Errors and bugs of
    Flinders itself pass through.

    >>> with parser_errors("log.parquet", "a Parquet table"):
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
        if _is_bug(error):
            raise
        said = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":").removesuffix(": ")
        message = "".join(letter if letter.isprintable() else "\ufffd" for letter in said)
        raise UnreadableInput(
            f"{name} cannot be read as {kind} ({message[:MAX_MESSAGE_LENGTH]}): it is broken or cut short; {advice}"
        ) from None
