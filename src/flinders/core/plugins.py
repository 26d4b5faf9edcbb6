"""Rows that other packages add to a table of this one: those of `flinders.apps`, and installed ones.

A package of `flinders.apps` names its modules in ``rows.py``, a mapping for each table, and nothing is imported before
it is asked for. What is not there adds nothing: the library works without any of them.

An installed package lists, in the group of a table, where its row or its sequence of rows is:

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
"""Package of the packages for one trade each."""


@cache
def apps() -> tuple[str, ...]:
    """Names of the packages of `flinders.apps`, in alphabetical order."""
    folder = Path(__file__).parents[1] / "apps"
    return tuple(sorted(module.name for module in iter_modules([str(folder)]) if module.ispkg))


@cache
def app_modules(table: str) -> Mapping[str, str]:
    """Full names of the modules that packages of `flinders.apps` add to a table, each by what the table calls it."""
    return {name: f"{app}.{module}" for name, app, module in app_rows(table)}


@cache
def app_rows(table: str) -> tuple[tuple[str, str, Any], ...]:
    """Rows that packages of `flinders.apps` add to a table: name, full name of the package, and what it says of it."""
    return tuple(
        (name, f"{APPS}.{app}", row)
        for app in apps()
        for name, row in getattr(import_module(f"{APPS}.{app}.rows"), table, {}).items()
    )


def remark(about: str, *, before: str = "; ") -> str:
    """What a package of `flinders.apps` says of something that it can do, behind `before`; empty without it.

    >>> remark("no such thing")
    ''
    """
    return next((before + words for name, _, words in app_rows("REMARKS") if name == about), "")


class OtherContents(Protocol):
    """What a path holds that is no recording of one sensor: many units, or what a command for these wrote."""

    kind: str  # in words
    is_one_recording: bool  # whether it may be read as a recording all the same
    instead: str  # what it is, and what to type in place of a command for one recording

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""

    def page(self) -> RenderableType:
        """For the terminal."""


def other_contents(path: str) -> OtherContents | None:
    """What a package of `flinders.apps` makes of a path; None if it is a recording of one sensor for all of them.

    >>> other_contents("no such file.csv")
    """
    for module in app_modules("CONTENTS").values():
        found: OtherContents | None = import_module(module).recognised(path)
        if found is not None:
            return found
    return None


def modules_of(package: ModuleType, table: str, *, first: Iterable[str] = ()) -> dict[str, str]:
    """Full names of the public modules of a package and of those that `flinders.apps` adds to its table, by last part.

    Those of `first` come first, as far as they are there, and all others by name.
    """
    own = {module.name: f"{package.__name__}.{module.name}" for module in iter_modules(package.__path__)}
    there = {**{name: path for name, path in own.items() if not name.startswith("_")}, **app_modules(table)}
    order = [*(name for name in first if name in there), *sorted(there)]
    return {name: there[name] for name in dict.fromkeys(order)}


def plugin_rows(group: str, kind: type[Row]) -> tuple[Row, ...]:
    """Load the rows of a group, in the order of the names of their entry points.

    Raises `PluginError` for a package that cannot be imported, or whose rows are of another kind.
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
        raise PluginError(package, f"{entry.value} has to be a {kind.__name__}, or a sequence of them")
    return rows
