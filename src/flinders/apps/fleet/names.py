"""Names by which tables of many units are recognised: endings of files, and usual columns.

Nothing is imported here, since every recording that a command opens is compared with these names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

PARQUET: Final = (".parquet", ".pq")
ARROW: Final = (".arrow", ".feather")
TABLES: Final = PARQUET + ARROW
CSV: Final = ".csv"
UNIT_COLUMNS: Final = (
    "unit", "unit_id", "device", "device_id", "serial", "serial_number", "vehicle", "vehicle_id", "sensor_id",
)  # fmt: skip
"""Usual names of a column of units, unless an option names it."""
RECORDING_COLUMNS: Final = ("recording", "recording_id", "session", "session_id", "log", "log_id", "date")
"""Usual names of a column of recordings."""
BATCH_COLUMNS: Final = ("batch", "hw_batch", "lot", "hardware_batch", "hardware", "revision")
"""Usual names of a column of hardware batches."""
DELIMITERS: Final = ",;\t"
"""Delimiters that a table of text may have between its cells."""
MAX_HEADER: Final = 1 << 16
"""Largest number of characters in the first line of a table of text."""


def delimiter_of(header: str) -> str:
    """Delimiter of a table of text, from its first line.

    >>> delimiter_of("unit;firmware")
    ';'
    """
    return max(DELIMITERS, key=header.count)


def header_of(path: Path) -> tuple[list[str], str]:
    """Names in the first line of a table of text, and the delimiter between them."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        header = lines.readline(MAX_HEADER)
    delimiter = delimiter_of(header)
    return [cell.strip().strip('"') for cell in header.strip().split(delimiter)], delimiter
