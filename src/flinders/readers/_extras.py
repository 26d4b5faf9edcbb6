"""What reads a format that the core does not: optional packages, imported when such a file is opened.

>>> needs("json", "px4", "a PX4 ULog").loads("[1, 2]")
[1, 2]
>>> needs("no_such_package", "px4", "a PX4 ULog")
Traceback (most recent call last):
flinders.errors.MissingExtra: a PX4 ULog needs no_such_package, which is not installed: pip install 'flinders[px4]'
"""

from __future__ import annotations

from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import FlindersError, MissingExtra, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator

LONGEST: Final = 120
"""Characters of another package's message that are passed on."""


def needs(package: str, extra: str, what: str) -> Any:  # noqa: ANN401 - a module, and few of these have types
    """Import an optional package such as ``pyarrow.parquet``, for `what` (with its article: ``a PX4 ULog``).

    Where it is not installed, `MissingExtra` says to install the `extra`: ``px4`` for ``pip install 'flinders[px4]'``.
    """
    try:
        return import_module(package)
    except ImportError:
        raise MissingExtra(package.partition(".")[0], extra, what) from None


@contextmanager
def reading(name: str, kind: str) -> Iterator[None]:
    """Let another package read a file, and turn whatever it raises into one line: on a broken file that is anything.

    `kind` is what the file should be, with its article. Errors of Flinders pass through.

    >>> with reading("flight.ulg", "a PX4 ULog"):
    ...     {}["sensor_mag"]
    Traceback (most recent call last):
    flinders.errors.UnreadableInput: flight.ulg cannot be read as a PX4 ULog (KeyError: 'sensor_mag'): it is broken or
    cut short; copy it again
    """
    try:
        yield
    except FlindersError:
        raise
    except Exception as error:  # noqa: BLE001 - other people's parsers, and bytes that anyone may have written
        said = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":").removesuffix(": ")
        message = "".join(letter if letter.isprintable() else "\ufffd" for letter in said)
        raise UnreadableInput(
            f"{name} cannot be read as {kind} ({message[:LONGEST]}): it is broken or cut short; copy it again"
        ) from None
