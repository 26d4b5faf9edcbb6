"""The log of a run: a line of JSON for each thing that happened.

>>> import tempfile
>>> from pathlib import Path
>>> path = Path(tempfile.mkdtemp()) / "fleet.jsonl"
>>> with Log.to(path) as log:
...     log.event("planned", partitions=3)
>>> json.loads(path.read_text())["event"], json.loads(path.read_text())["partitions"]
('planned', 3)
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Self

from flinders.core.files import reason, write_all
from flinders.errors import OutputError

if TYPE_CHECKING:
    import io
    import os
    from collections.abc import Iterator


@dataclass(frozen=True, slots=True)
class Log:
    """Where events go.

    Attributes
    ----------
    stream : unbuffered file, optional
        None where nobody wants to know.
    """

    stream: io.FileIO | None = None

    @classmethod
    @contextlib.contextmanager
    def to(cls, path: str | os.PathLike[str] | None) -> Iterator[Self]:
        """Write to the end of a file, which a run that is resumed goes on with; to nowhere for None.

        Raises
        ------
        OutputError
            Where it cannot be written.
        """
        if path is None:
            yield cls()
            return
        try:
            stream = Path(path).open("ab", buffering=0)  # noqa: SIM115 - closed below; a buffer would fail again there
        except OSError as error:
            raise _cannot(path, error) from None
        with stream:
            log = cls(stream)
            if _is_cut(path):
                log._write("\n")
            yield log

    def event(self, event: str, **fields: object) -> None:
        """Write a line with the time, what happened, and what belongs to it; it is on its way before this returns.

        Raises
        ------
        OutputError
            Where it cannot be written.
        """
        if self.stream is None:
            return
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._write(json.dumps({"time": now, "event": event, **fields}, allow_nan=False) + "\n")

    def _write(self, line: str) -> None:
        """Write a line, or say why not."""
        assert self.stream is not None
        try:
            write_all(self.stream, line.encode())
        except OSError as error:
            raise _cannot(str(self.stream.name), error) from None


def _cannot(path: str | os.PathLike[str], error: OSError) -> OutputError:
    return OutputError(f"{path}: the log cannot be written: {reason(error)}")


def _is_cut(path: str | os.PathLike[str]) -> bool:
    """Whether the last line of a log has no end, since the disk was full; a pipe or a device has no last line."""
    if not Path(path).is_file() or not Path(path).stat().st_size:
        return False
    with Path(path).open("rb") as file:
        file.seek(-1, 2)
        return file.read(1) != b"\n"
