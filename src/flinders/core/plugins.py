"""Rows that packages of `flinders.apps` and installed plugins add to tables of the library, such as that of readers.

A package of `flinders.apps` names its modules in ``rows.py``, in a mapping for each table; a module is imported at its
first use. The library works without any of these packages.

An installed package declares its row, or its sequence of rows, as an entry point in the group of the table:

    [project.entry-points."flinders.readers"]
    vendor = "vendor_flinders:READERS"

>>> app_modules("NO_SUCH_TABLE"), plugin_rows("flinders.no_such_table", str)
({}, ())
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar

from flinders.errors import PluginError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from importlib.metadata import EntryPoint
    from types import ModuleType

    from rich.console import RenderableType

Row = TypeVar("Row")

APPS: Final = "flinders.apps"
"""Name of the package that contains one package for each trade."""


@cache
def apps() -> tuple[str, ...]:
    """Names of the packages of `flinders.apps`, in alphabetical order."""
    folder = Path(__file__).parents[1] / "apps"
    return tuple(sorted(module.name for module in iter_modules([str(folder)]) if module.ispkg))


@cache
def app_modules(table: str) -> Mapping[str, str]:
    """Full names of the modules that packages of `flinders.apps` add to a table, by the name of their row."""
    return {name: f"{app}.{module}" for name, app, module in app_rows(table)}


@cache
def app_rows(table: str) -> tuple[tuple[str, str, Any], ...]:
    """Rows that packages of `flinders.apps` add to a table: name, full name of the package, and value."""
    return tuple(
        (name, f"{APPS}.{app}", row)
        for app in apps()
        for name, row in getattr(import_module(f"{APPS}.{app}.rows"), table, {}).items()
    )


def remark(about: str, *, before: str = "; ") -> str:
    """Remark that a package of `flinders.apps` adds to messages on the subject `about`; empty if there is none.

    A remark begins with the text `before`.

    >>> remark("no such thing")
    ''
    """
    return next((before + words for name, _, words in app_rows("REMARKS") if name == about), "")


class OtherContents(Protocol):
    """Content of a path that is not a recording of one sensor, such as recordings of many units or a fleet's table."""

    kind: str  # kind of content, in words
    is_one_recording: bool  # whether it can also be read as one recording
    advice: str  # for messages: kind of content, and the command to use instead

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""

    def page(self) -> RenderableType:
        """Page for the terminal."""


def other_contents(path: str) -> OtherContents | None:
    """Content of a path that a package of `flinders.apps` recognises; None if none does.

    >>> other_contents("no such file.csv")
    """
    for module in app_modules("CONTENTS").values():
        found: OtherContents | None = import_module(module).contents_of(path)
        if found is not None:
            return found
    return None


def modules_of(package: ModuleType, table: str, *, first: Iterable[str] = ()) -> dict[str, str]:
    """Full names, by short name, of the public modules of a package, and of the modules that `flinders.apps` adds.

    `table` is the table to which they are added. The names in `first` come first if they exist, then all others in
    alphabetical order.
    """
    own = {module.name: f"{package.__name__}.{module.name}" for module in iter_modules(package.__path__)}
    there = {**{name: path for name, path in own.items() if not name.startswith("_")}, **app_modules(table)}
    order = [*(name for name in first if name in there), *sorted(there)]
    return {name: there[name] for name in dict.fromkeys(order)}


def plugin_rows(group: str, kind: type[Row]) -> tuple[Row, ...]:
    """Load the rows of a group of entry points, ordered by the names of the entry points.

    Raises `PluginError` for a package that cannot be imported, or whose rows are not of type `kind`.
    """
    from importlib.metadata import entry_points

    entries = sorted(entry_points(group=group), key=lambda entry: entry.name)
    return tuple(row for entry in entries for row in _rows(entry, kind))


def _rows(entry: EntryPoint, kind: type[Row]) -> tuple[Row, ...]:
    """Rows of one entry point."""
    package = entry.dist.name if entry.dist else entry.value
    try:
        loaded = entry.load()
    except Exception as error:  # whatever other people's code raises
        raise PluginError(package, f"{entry.value} cannot be loaded ({type(error).__name__}: {error})") from error
    rows = (loaded,) if isinstance(loaded, kind) else tuple(loaded)
    if not all(isinstance(row, kind) for row in rows):
        raise PluginError(package, f"{entry.value} must be a {kind.__name__}, or a sequence of them")
    return rows
