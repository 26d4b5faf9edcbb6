"""Tells recordings from other files of an input: by name or, for files that Flinders wrote, by content.

>>> is_readable("A17/monday.csv"), is_readable("A17/notes.md")
(True, False)
"""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flinders.apps.fleet.names import CSV, TABLES, header_of
from flinders.apps.fleet.storage import is_remote
from flinders.apps.fleet.storage import open_stored as stored
from flinders.apps.fleet.tables import is_csv_of_fleet
from flinders.errors import FlindersError
from flinders.readers import registry
from flinders.readers.dialects.json_records import own_kind as kind_of_json

if TYPE_CHECKING:
    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.storage import StoredFile

TABLES_OF_FLEETS: Final = "tables of fleets"
"""Kind of the tables of earlier runs, which may lie among the recordings."""
OWN_FILES: Final = {"truth": "truth files", "calibration": "calibration files"}
"""Other files that Flinders writes next to recordings, by the kind that the file states."""
MAX_OWN_BYTES: Final = 1 << 20
"""Largest size of a truth or calibration file in bytes; usual files have a few thousand."""


@cache
def _endings() -> tuple[str, ...]:
    """File name extensions that are read from a folder, and ``/`` for subfolders that cannot be listed."""
    return (*{suffix for reader in registry() for suffix in reader.suffixes}, *TABLES, "/")


def is_readable(name: str) -> bool:
    """Whether a file of a folder is read, by its name; a pattern as input reads every file that it matches."""
    return name.lower().endswith(_endings())


def is_csv_of_units(file: StoredFile, options: Options) -> bool:
    """Whether a file is a table of text with the column of units that the options name."""
    name = options.unit_column
    if name is None or is_remote(file.where) or not file.name.lower().endswith(CSV):
        return False
    try:
        columns, _ = header_of(Path(file.where))
    except OSError:
        return False
    return name.casefold() in [column.casefold() for column in columns]


def own_kind(file: StoredFile) -> str:
    """Kind of a CSV or JSON file that Flinders wrote, by its contents; empty for other files."""
    if file.name.lower().endswith(CSV) and not is_remote(file.where) and is_csv_of_fleet(file.where):
        return TABLES_OF_FLEETS
    if not file.name.lower().endswith(".json") or file.size > MAX_OWN_BYTES:
        return ""
    with contextlib.suppress(FlindersError, OSError), stored(file) as source:
        content = Path(source).read_bytes() if isinstance(source, str) else source.read()
        return OWN_FILES.get(kind_of_json(content.decode("utf-8", "replace")), "")
    return ""
