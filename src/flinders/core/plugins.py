"""Rows that installed packages add to a table of this one, through entry points.

A package lists, in the group of a table, where its row or its sequence of rows is:

    [project.entry-points."flinders.readers"]
    vendor = "vendor_flinders:READERS"

>>> plugin_rows("flinders.no_such_table", str)
()
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from flinders.errors import PluginError

Row = TypeVar("Row")


def plugin_rows(group: str, kind: type[Row]) -> tuple[Row, ...]:
    """Load the rows of a group, in the order of the names of their entry points.

    Raises `PluginError` for a package that cannot be imported, or whose rows are of another kind.
    """
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
