"""Text of recordings by `flinders record`: first line, bytes in comments, and what is needed to continue one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from flinders.core.files import reason_and_remedy
from flinders.errors import OutputError

if TYPE_CHECKING:
    import os

RECOGNITION_ROWS: Final = 20  # Largest number of rows by which the format of a recording to continue is recognised
MIN_RESUME_GAP_S: Final = 0.001  # Smallest time between the last row of a recording and the first row that continues it
TIME_CELL: Final = re.compile(r'"?(\d+[.,]\d{4})')  # Start of a row with a time of arrival
TAIL_BYTES: Final = 1 << 16  # Number of bytes at each end of a file that are read to continue it
START_LINE: Final = re.compile(r"^# flinders \S+ record: .*, begun (\S+)$", re.MULTILINE)


def title(name: str, *, is_new: bool) -> str:
    """First line of a recording or of its continuation, with the name of the source and the time."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"# flinders {version('flinders')} record: {name}, {'begun' if is_new else 'resumed'} {now}\n"


def escape_bytes(line: bytes) -> str:
    """Bytes as printable ASCII text, from which ``unicode_escape`` restores the bytes."""
    return line.decode("latin-1").encode("unicode_escape").decode("ascii")


@dataclass(frozen=True, slots=True)
class ResumedRecording:
    """What is needed to continue a recording: header, first rows, and time since its start.

    `header` is the line above the rows: empty if there is none, None if there are no rows either. `rows` are the first
    rows. `seconds` is the time from the start of the recording to now; where rows begin with their time, it is not less
    than that of the last row.
    """

    header: str | None
    rows: tuple[str, ...]
    seconds: float

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Self:
        """Read a recording of `Recorder`; `OutputError` if the file does not exist or is not such a recording."""
        file = Path(path)
        try:
            with file.open("rb") as content:
                head = content.read(TAIL_BYTES).decode("utf-8", "replace")
                content.seek(max(file.stat().st_size - TAIL_BYTES, 0))
                tail = content.read().decode("utf-8", "replace")
        except OSError as error:
            raise OutputError(f"{path}: cannot be continued: {reason_and_remedy(error)}") from None
        begun = START_LINE.search(head)
        if begun is None:
            raise OutputError(
                f"{path} is no recording of flinders record (its first line is missing): give such a recording, or a "
                "new file"
            )
        whole = head.rpartition("\n")[0].splitlines()
        lines = [line for line in whole if line.strip() and not line.startswith("#")]
        since = (datetime.now(UTC) - datetime.fromisoformat(begun[1])).total_seconds()
        if not lines:
            return cls(None, (), max(since, 0.0))
        is_row = lines[0].lstrip('"')[:1].isdigit() or lines[0][:1] in "-+."
        header = "" if is_row else lines[0]
        last = _last_time(tail) if header.startswith("t_s") else 0.0
        return cls(header, tuple(lines[not is_row :][:RECOGNITION_ROWS]), max(since, last + MIN_RESUME_GAP_S))


def _last_time(tail: str) -> float:
    """Time in s of the last complete row; 0 if there is none."""
    for line in reversed(tail.rpartition("\n")[0].splitlines()):
        match = TIME_CELL.match(line)
        if match:
            return float(match[1].replace(",", "."))
    return 0.0
