r"""Contents of a path that is not a recording of one sensor, for `flinders info`, `show` and `calibrate`.

The path is a folder of recordings, a table of readings of many units, or a table of `flinders fleet`. For each there is
a description and the commands to type next.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp(), "logs")
>>> for name in ("A17/monday.csv", "A17/friday.csv", "B02/monday.csv"):
...     (folder / name).parent.mkdir(parents=True, exist_ok=True)
...     _ = (folder / name).write_text("x,y,z\n")
>>> known = contents_of(str(folder))
>>> known.units, known.recordings, known.commands[0].startswith("flinders fleet")
(2, 3, True)
"""

from __future__ import annotations

import csv
import io
import shlex
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flinders.apps.fleet.names import CSV, TABLES, UNIT_COLUMNS, header_of
from flinders.errors import FlindersError, count_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.apps.fleet.not_good import NotGood

MAX_SENSORS_OF_A_BODY: Final = 8
"""Largest number of units in a table that may be the sensors of one body; their readings may be one recording."""
MAX_NAMES: Final = 3
"""Largest number of units that a message names."""
DEFAULT_TABLE: Final = "calibrations.parquet"


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """Contents of a path that is not a recording of one sensor."""

    path: str  # as it was given
    kind: str  # `folder`, `readings of many units` or `table of a fleet`
    units: int  # sensors or vehicles
    recordings: int  # number of recordings of all units; 0 if only readings are known
    unit_column: str = ""  # for readings: column with the unit of each row
    names: tuple[str, ...] = ()  # of the first units
    verdicts: dict[str, int] = field(default_factory=dict)  # of a table: recordings by verdict
    properties: tuple[str, ...] = ()  # of a table: columns that were added
    not_good: tuple[NotGood, ...] = ()  # of a table: the first recordings that are not good
    commands: tuple[str, ...] = ()  # commands to type next

    @property
    def is_one_recording(self) -> bool:
        """Whether the path may also be read as one recording: a few units may be sensors of one body."""
        return self.kind == "readings of many units" and self.units <= MAX_SENSORS_OF_A_BODY

    @property
    def words(self) -> str:
        """Description of the contents, in one line."""
        units = count_text(self.units, "unit")
        if self.kind == "table of a fleet":
            more = f"; with {', '.join(self.properties)}" if self.properties else ""
            return f"{self.path} is the table of a fleet: {count_text(self.recordings, 'recording')} of {units}{more}"
        first = ", ".join(self.names) + (" …" if self.units > len(self.names) else "")
        if self.kind == "folder":
            return f"{self.path} is a folder: {count_text(self.recordings, 'file')} of {units} ({first})"
        return f"{self.path} has readings of {units} ({first}), which the column {self.unit_column} tells apart"

    @property
    def advice(self) -> str:
        """Description of the contents, and the command to use instead of one for a single recording."""
        return f"{self.words}: {self.commands[0]}" if self.commands else f"{self.words}: give a recording"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)

    def page(self) -> RenderableType:
        """Lay out the contents as a page of the terminal."""
        from rich.console import Group

        from flinders.apps.fleet.run_page import cause_list, of_verdicts
        from flinders.report.terminal import next_commands, page

        bad = sum(self.verdicts.values()) - self.verdicts.get("good", 0)
        return page(
            Group(self.words, *([of_verdicts(self.verdicts)] if self.verdicts else [])),
            cause_list("not good", self.not_good, bad, self.path) if self.not_good else None,
            next_commands(self.commands) if self.commands else None,
        )


def contents_of(path: str) -> Contents | None:
    """Find out what a path contains; None for a recording of one sensor, and for a path that cannot be read."""
    try:
        if Path(path).is_dir():
            return _of_folder(path)
        if path.lower().endswith(TABLES):
            return _of_table(path)
        return _of_csv(path) if path.lower().endswith(CSV) and Path(path).is_file() else None
    except (FlindersError, OSError, ValueError, csv.Error):
        return None  # the reader of recordings reports the fault


def _of_folder(path: str) -> Contents | None:
    """Contents of a folder of recordings; None for a folder that is itself a recording, or has no recordings."""
    from flinders.apps.fleet.kinds import is_readable
    from flinders.apps.fleet.plan import key_of
    from flinders.apps.fleet.storage import list_files
    from flinders.readers import registry

    if any((Path(path) / reader.folder_file).is_file() for reader in registry() if reader.folder_file):
        return None
    names = [file.name for file in list_files(path) if not file.kind and is_readable(file.name)]
    units = sorted({key_of(name)[0] for name in names})
    if not names:
        return None
    return Contents(
        path=path,
        kind="folder",
        units=len(units),
        recordings=len(names),
        names=tuple(units[:MAX_NAMES]),
        commands=(shlex.join(["flinders", "fleet", path, "-o", DEFAULT_TABLE]),),
    )


def _of_table(path: str) -> Contents | None:
    """Contents of a Parquet or Arrow table; None for a recording of one sensor."""
    from flinders.apps.fleet.dataset import open_table_file, units_of
    from flinders.apps.fleet.keys import KeyColumns
    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.results import SIGN
    from flinders.apps.fleet.storage import StoredFile

    with open_table_file(StoredFile(Path(path).name, path, Path(path).stat().st_size), Options()) as file:
        if SIGN in (file.schema.metadata or {}):
            return _of_fleet(path, path)
        keys = KeyColumns.of_schema(file.name, file.schema, Options())
        if keys is None or not keys.unit.column:
            return None
        return _of_units(path, keys.unit.column, units_of(file, keys, range(len(file.groups))) - {""})


def _of_csv(path: str) -> Contents | None:
    """Contents of a table of text: that of a fleet, or one with a column of units; None for others."""
    names, delimiter = header_of(Path(path))
    header = [name.casefold() for name in names]
    place = next((header.index(name) for name in UNIT_COLUMNS if name in header), None)
    if place is not None and (table := _csv_of_fleet(path)) is not None:
        return _of_fleet(path, table)
    if place is None:
        return None
    with Path(path).open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = csv.reader(file, delimiter=delimiter)
        next(rows)
        return _of_units(path, names[place], set(_cells(rows, place)) - {""})


def _csv_of_fleet(path: str) -> io.BytesIO | None:
    """The table of a fleet in a CSV file, as Parquet; None for another file."""
    from flinders.apps.fleet.results import needs_arrow
    from flinders.apps.fleet.tables import is_csv_of_fleet, read_table

    if not is_csv_of_fleet(path):
        return None
    needs_arrow()
    from pyarrow import parquet

    content = io.BytesIO()
    parquet.write_table(read_table(path).to_arrow(), content)
    return content


def _cells(rows: Iterator[list[str]], place: int) -> Iterator[str]:
    """Yield the cells of a column."""
    return (row[place].strip() for row in rows if place < len(row))


def _of_units(path: str, column: str, units: set[str]) -> Contents | None:
    """Contents of a table with readings of several units; None for one unit."""
    if len(units) < 2:
        return None
    return Contents(
        path=path,
        kind="readings of many units",
        units=len(units),
        recordings=0,
        unit_column=column,
        names=tuple(sorted(units)[:MAX_NAMES]),
        commands=(shlex.join(["flinders", "fleet", path, "--unit-column", column, "-o", DEFAULT_TABLE]),),
    )


def _of_fleet(path: str, table: Any) -> Contents:  # noqa: ANN401 - a path, or an open file
    """Contents of a table of `flinders fleet`."""
    from pyarrow import parquet

    from flinders.apps.fleet.merging import table_counts
    from flinders.apps.fleet.not_good import first_of, not_good
    from flinders.apps.fleet.results import NAMES
    from flinders.apps.fleet.tables import is_csv

    counts = table_counts(table)
    with parquet.ParquetFile(table) as file:
        units = Counter(file.read(columns=["unit"]).column("unit").to_pylist())
        added = tuple(name for name in file.schema_arrow.names if name not in NAMES)
    named = [unit for unit in units if not unit.startswith("(")]
    is_drift_known = any(units[unit] > 1 for unit in named) and not is_csv(path)
    drift = [shlex.join(["flinders", "drift", path, "--report", "drift.html"])] if is_drift_known else []
    at = [shlex.join(["flinders", "fleet", "at", named[0], "--table", path, "-o", "calibration.json"])] if named else []
    return Contents(
        path=path,
        kind="table of a fleet",
        units=counts["units"],
        recordings=counts["rows"],
        names=tuple(named[:MAX_NAMES]),
        verdicts=counts["verdicts"],
        properties=added,
        not_good=first_of(not_good(table)),
        commands=(*drift, *at),
    )
