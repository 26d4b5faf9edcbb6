"""Table of a station: a row for each test, appended in one write.

Columns common with `flinders fleet` have the same names; members of lists are columns of their own: ``offset_x``. A row
is one write at the end of the file, forced to the disk; a partial row after a power failure is removed when the table
is opened again.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> with StationTable(folder / "table.csv") as table:
...     table.append(StationRow(unit="A17", recording="A17/1.csv", result="fail", code="noise"))
>>> with (folder / "table.csv").open("a") as file:
...     _ = file.write("B02,tor")
>>> with StationTable(folder / "table.csv") as table:
...     table.append(StationRow(unit="A17", recording="A17/2.csv", result="pass"))
...     [(row["unit"], row["result"]) for row in table.rows], table.last("A17")["recording"]
([('A17', 'fail'), ('A17', 'pass')], 'A17/2.csv')
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.core.files import reason_and_remedy, try_lock
from flinders.errors import OutputError
from flinders.fitting.batch import FitColumns, fill_row

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from flinders.errors import FlindersError
    from flinders.fitting.result import Fit

VECTOR: Final = (math.nan,) * 3
MATRIX: Final = (math.nan,) * 9
TABLE_FILE: Final = "table.csv"
"""The table in the folder of a station."""
AXES: Final = "xyz"


@dataclass(frozen=True, slots=True, kw_only=True)
class StationRow:
    """One test of one unit."""

    unit: str  #: serial number
    recording: str  #: file of its readings, in the folder of the station's recordings
    result: str  #: ``pass``, ``fail`` or ``aborted``
    code: str = ""  #: code of the most severe miss; empty for a unit that passed
    message: str = ""  #: the most severe miss in words, with a remedy
    missed: tuple[str, ...] = ()  #: codes of all misses
    operator: str = ""  #: name of the operator
    station: str = ""  #: name of the station
    began: str = ""  #: date and time, UTC
    seconds: float = math.nan  #: from the serial number to the last reading
    start_s: float = math.nan  #: start of the test, s since 1970
    end_s: float = math.nan  #: end of the test, s since 1970
    readings: int = 0  #: number of readings
    samples: int = 0  #: number of readings used in the fit
    verdict: str = ""  #: verdict of the engine: ``good``, ``limited``, ``refused``, or ``failed`` without a fit
    method: str = ""  #: method of the fit
    worst_deg: float = math.nan  #: heading error at the worst heading, 1 σ
    rms_deg: float = math.nan  #: heading error, rms over all headings, 1 σ
    bound_95_deg: float = math.nan  #: bound of the heading error with a probability of 95 %
    dip_deg: float = math.nan  #: dip of the field that heading errors are for
    offset: tuple[float, ...] = VECTOR  #: in `unit_of_field`
    matrix: tuple[float, ...] = MATRIX  #: row by row
    noise: float = math.nan  #: in `unit_of_field`
    field_strength: float = math.nan  #: of corrected readings, in `unit_of_field`
    coverage: float = math.nan  #: fraction of the sphere that was covered
    findings: tuple[str, ...] = ()  #: codes, by severity
    unit_of_field: str = ""  #: ``uT`` or ``counts``

    def with_outcome(self, outcome: Fit | FlindersError, readings: int) -> Self:
        """Return the row with a fit, or with the reason for the missing fit."""
        columns = FitColumns.empty(1)
        fit = getattr(outcome, "fit", None) or outcome
        fill_row(columns, 0, fit)
        own = {"code", "message", "readings", "unit_of_field"}
        names = {each.name for each in fields(FitColumns)} & {each.name for each in fields(self)} - own
        cells = {name: _cell(getattr(columns, name)[0]) for name in names}
        unit = fit.calibration.unit if hasattr(fit, "calibration") else ""
        return replace(self, **cells, readings=readings, unit_of_field=unit)

    def cells(self) -> dict[str, str]:
        """Cells of the row, by column."""
        cells: dict[str, str] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "offset":
                cells |= {f"offset_{axis}": _text(part) for axis, part in zip(AXES, value, strict=True)}
            elif each.name == "matrix":
                places = [f"{row}{column}" for row in AXES for column in AXES]
                cells |= {f"matrix_{place}": _text(part) for place, part in zip(places, value, strict=True)}
            else:
                cells[each.name] = _text(value)
        return cells


def _cell(value: Any) -> Any:  # noqa: ANN401 - of NumPy
    return tuple(value.tolist()) if getattr(value, "ndim", 0) else getattr(value, "item", lambda: value)()


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.12g}" if math.isfinite(value) else ""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return " ".join(str(value).split())


COLUMNS: Final = tuple(StationRow(unit="", recording="", result="").cells())
"""The columns, in order."""


class StationTable:
    """A table for appending rows.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    rows : list of dict
        Rows of the table, by column.

    Raises
    ------
    OutputError
        If it cannot be written, another program writes it, or it has other columns.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {reason_and_remedy(error)}") from None
        try:
            self.rows = self._read()
        except OSError as error:
            os.close(self._file)
            raise OutputError(f"{path}: cannot be read: {reason_and_remedy(error)}") from None
        except OutputError:
            os.close(self._file)
            raise

    def append(self, row: StationRow) -> None:
        """Add a whole row; `OutputError` if that fails."""
        cells = row.cells()
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        size = os.fstat(self._file).st_size
        if not size:
            writer.writeheader()
        writer.writerow(cells)
        content = memoryview(text.getvalue().encode())
        try:
            while content:
                content = content[os.write(self._file, content) :]
            os.fsync(self._file)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, size)
            raise OutputError(f"{self.path}: cannot be written: {reason_and_remedy(error)}") from None
        self.rows.append(cells)

    def last(self, unit: str) -> dict[str, str] | None:
        """Return the newest row of a unit."""
        return next((row for row in reversed(self.rows) if row["unit"] == unit), None)

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _read(self) -> list[dict[str, str]]:
        """Read the rows, and remove a partial row at the end."""
        if not try_lock(self._file):
            raise OutputError(f"{self.path}: another station writes this table: stop it, or name another folder")
        content = self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            os.ftruncate(self._file, len(whole))
        return rows_of(self.path, whole.decode("utf-8", "replace"))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def rows_of(path: Path, text: str) -> list[dict[str, str]]:
    """Rows of the text of a table; `OutputError` for columns that are not those of a station."""
    reader = csv.DictReader(io.StringIO(text))
    if reader.fieldnames is not None and tuple(reader.fieldnames) != COLUMNS:
        missing = [name for name in COLUMNS if name not in reader.fieldnames]
        what = f"it has no {missing[0]}" if missing else "its columns are in another order"
        raise OutputError(f"{path}: is not a table of this station: {what}; move the file away, or name another folder")
    try:
        return list(reader)
    except csv.Error as error:
        raise OutputError(f"{path}: line {reader.line_num} cannot be read: {error}; move the file away") from None
