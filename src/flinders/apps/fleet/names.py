"""Names by which tables of many units are recognised: endings of files, and usual columns.

Nothing is imported here, since every recording that a command opens is held against these.
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
"""Names of a column of units, unless an option names it."""
RECORDING_COLUMNS: Final = ("recording", "recording_id", "session", "session_id", "log", "log_id", "date")
"""Names of a column of recordings."""
BATCH_COLUMNS: Final = ("batch", "hw_batch", "lot", "hardware_batch", "hardware", "revision")
"""Names of a column of hardware batches."""
DELIMITERS: Final = ",;\t"
"""What may stand between the cells of a table of text."""
MAX_HEADER: Final = 1 << 16
"""Letters of the first line of a table of text."""


def delimiter_of(header: str) -> str:
    """What stands between the cells of a table of text, by its first line.

    >>> delimiter_of("unit;firmware")
    ';'
    """
    return max(DELIMITERS, key=header.count)


def header_of(path: Path) -> tuple[list[str], str]:
    """Names in the first line of a table of text, and what stands between them."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        header = lines.readline(MAX_HEADER)
    delimiter = delimiter_of(header)
    return [cell.strip().strip('"') for cell in header.strip().split(delimiter)], delimiter
