"""Events of a run as lines of JSON, in a file that a resumed run continues."""

from __future__ import annotations

import contextlib
import json
import logging
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flinders.core.files import reason, write_all
from flinders.errors import OutputError

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

LOGGER: Final = logging.getLogger("flinders.apps.fleet")


@contextlib.contextmanager
def log_to(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Append the events of runs within the block to a file, which a resumed run continues; raises OutputError."""
    if path is None:
        yield
        return
    handler, level = _JsonLines(path), LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.setLevel(level)
        LOGGER.removeHandler(handler)
        handler.close()


def log_event(event: str, **fields: object) -> None:
    """Log what happened, and its fields; raises OutputError if the file of `log_to` cannot be written."""
    LOGGER.info(event, extra={"fields": fields})


class _JsonLines(logging.Handler):
    """Appends events to a file, unbuffered; unlike other handlers it raises if it cannot."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open the file, and end a line that was cut."""
        super().__init__()
        self._path = path
        try:
            self._file = Path(path).open("ab", buffering=0)  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise self._refused(error) from None
        if _is_cut(path):
            self._write("\n")

    def emit(self, record: logging.LogRecord) -> None:
        """Write an event."""
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        fields: dict[str, object] = getattr(record, "fields", {})
        self._write(json.dumps({"time": time, "event": record.getMessage(), **fields}, allow_nan=False) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()

    def _write(self, line: str) -> None:
        """Write a line; raises OutputError."""
        try:
            write_all(self._file, line.encode())
        except OSError as error:
            raise self._refused(error) from None

    def _refused(self, error: OSError) -> OutputError:
        """Error of a log that cannot be written."""
        return OutputError(f"{self._path}: the log cannot be written: {reason(error)}")


def _is_cut(path: str | os.PathLike[str]) -> bool:
    """Whether the last line of a log is incomplete, as after a full disk; a pipe or a device has no last line."""
    if not Path(path).is_file() or not Path(path).stat().st_size:
        return False
    with Path(path).open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) != b"\n"
