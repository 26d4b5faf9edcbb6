"""Folder of a station: one table, and files of each unit by serial number and time.

::

    table.csv                       a row for each test
    recordings/A17/2026-11-29_10-32-05.csv
    calibrations/A17/2026-11-29_10-32-05.json
    exports/…, certificates/…       likewise, if the station's file lists them
    unfinished.json                 the test in progress, for recovery after a power failure

`flinders fleet` reads ``recordings``: a folder for each unit, named by its serial number.
"""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import msgspec
from msgspec import Struct

from flinders.apps.live.station.recordings import folder_of
from flinders.apps.live.station.table import TABLE_FILE, StationRow, StationTable
from flinders.core.files import make_folder, write_text

if TYPE_CHECKING:
    from pathlib import Path

FORMAT: Final = "%Y-%m-%d_%H-%M-%S"


class UnitTest(Struct, frozen=True, kw_only=True):
    """A test of a unit in progress."""

    serial: str
    name: str  # of its files: folder and time, without suffix
    began: datetime
    operator: str = ""
    station: str = ""

    @property
    def recording(self) -> str:
        """File of the test in the folder of recordings."""
        return f"{self.name}.csv"

    def row(self, result: str, ended: datetime) -> StationRow:
        """Return the row of the test, without a calibration."""
        return StationRow(
            unit=self.serial,
            recording=self.recording,
            result=result,
            operator=self.operator,
            station=self.station,
            began=self.began.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
            seconds=round((ended - self.began).total_seconds(), 1),
            start_s=self.began.timestamp(),
            end_s=ended.timestamp(),
        )


class StationFolder:
    """An open folder of a station.

    Raises
    ------
    OutputError
        If the folder or its table cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        make_folder(path)
        self.table = StationTable(path / TABLE_FILE)
        self._waiting: list[StationRow] = []

    def begin_test(self, serial: str, began: datetime, operator: str, station: str) -> UnitTest:
        """Begin a test with unused file names; an entry in the journal gives the test a row even after a failure."""
        folder, when = folder_of(serial), began.astimezone().strftime(FORMAT)
        name, again = f"{folder}/{when}", 2
        while self.recording(f"{name}.csv").exists():
            name, again = f"{folder}/{when}_{again}", again + 1
        test = UnitTest(serial=serial, name=name, began=began, operator=operator, station=station)
        write_text(msgspec.json.encode(test).decode(), self._journal, force=True)
        return test

    def recording(self, name: str) -> Path:
        """Path of a recording."""
        return self.path / "recordings" / name

    def file_of(self, kind: str, test: UnitTest, suffix: str) -> Path:
        """Path of another file of a test; creates its folder."""
        path = self.path / kind / f"{test.name}{suffix}"
        make_folder(path.parent)
        return path

    def end(self, row: StationRow) -> None:
        """Add the row of an ended test; raises `OutputError` if the row has to wait, see `write_waiting`."""
        self._waiting.append(row)
        self.write_waiting()

    def write_waiting(self) -> None:
        """Write rows that failed before; raises `OutputError` if that fails again."""
        while self._waiting:
            self.table.append(self._waiting[0])
            self._waiting.pop(0)
        self.clear_journal()

    def clear_journal(self) -> None:
        """Clear the journal of the test in progress."""
        with contextlib.suppress(OSError):
            self._journal.unlink(missing_ok=True)

    def interrupted_test(self) -> UnitTest | None:
        """Return the test that a power failure or a crash has interrupted and that has no row yet."""
        try:
            test = msgspec.json.decode(self._journal.read_bytes(), type=UnitTest)
        except (OSError, msgspec.DecodeError):
            return None
        written = {row["recording"] for row in self.table.rows} | {row.recording for row in self._waiting}
        return None if test.recording in written else test

    def last_written(self, test: UnitTest) -> datetime:
        """Time of the last write to the recording of a test; its start without a recording."""
        try:
            return datetime.fromtimestamp(self.recording(test.recording).stat().st_mtime, UTC)
        except OSError:
            return test.began

    def close(self) -> None:
        """Close the table."""
        self.table.close()

    @property
    def _journal(self) -> Path:
        return self.path / "unfinished.json"
