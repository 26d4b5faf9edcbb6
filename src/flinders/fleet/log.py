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
from typing import IO, TYPE_CHECKING, Self

from flinders.errors import OutputError
from flinders.files import reason

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator


@dataclass(frozen=True, slots=True)
class Log:
    """Where events go.

    Attributes
    ----------
    stream : text stream, optional
        None where nobody wants to know.
    """

    stream: IO[str] | None = None

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
            stream = Path(path).open("a", encoding="utf-8", newline="\n")  # noqa: SIM115 - closed below
        except OSError as error:
            raise OutputError(f"{path}: the log cannot be written: {reason(error)}") from None
        with stream:
            yield cls(stream)

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
        try:
            self.stream.write(json.dumps({"time": now, "event": event, **fields}, allow_nan=False) + "\n")
            self.stream.flush()
        except OSError as error:
            raise OutputError(f"the log cannot be written: {reason(error)}") from None
