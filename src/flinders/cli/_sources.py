"""The recordings of a run as files: what was read of them and left out, and by which hash they are known again."""

from __future__ import annotations

import contextlib
import hashlib
import os
from typing import TYPE_CHECKING

from flinders.cli._talk import say
from flinders.errors import FlindersError, TooFewSamples, counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.core.calibration_file import Provenance, SourceFile
    from flinders.core.samples import Recording, Samples, Skipped
    from flinders.readers._source import File


def sha256(recording: Recording) -> str:
    """Hash a file as it lies on the disk; what was spooled, for standard input."""
    digest = hashlib.sha256()
    with file_of(recording).opened() as (raw, _):
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def file_of(recording: Recording) -> File:
    """The file that a recording was read from, also where a table was made of what a board printed."""
    found: File = getattr(recording, "original", None) or recording.file  # type: ignore[attr-defined]
    return found


@contextlib.contextmanager
def saying_what_was_skipped(recordings: Iterable[Recording]) -> Iterator[None]:
    """Where readings are too few, say what was left out of these recordings: it may be the reason.

    Raises
    ------
    TooFewSamples
        Again, with that.
    """
    try:
        yield
    except TooFewSamples as error:
        skipped = [entry for recording in recordings for entry in getattr(recording, "skipped", ())]
        raise TooFewSamples(
            found=error.found, needed=error.needed, method=error.method, skipped=skipped, how=error.how
        ) from None


class Counted:
    """A recording that knows how many rows its last pass gave, and says once what was read.

    Attributes
    ----------
    recording : Recording
    file : File
        That it was read from.
    rows : int
    """

    def __init__(self, recording: Recording) -> None:
        from flinders.core.samples import frame_of

        self.recording, self.source = recording, recording.source
        self.unit, self.axes, self.frame = recording.unit, recording.axes, frame_of(recording)
        self.file = file_of(recording)
        self.rows = 0
        self._is_said = False

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """What the last pass left out."""
        skipped: tuple[Skipped, ...] = getattr(self.recording, "skipped", ())
        return skipped

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording; after the first time, or where that breaks off, say what was read."""
        self.rows = 0
        try:
            for block in self.recording.blocks():
                self.rows += len(block)
                yield block
        except FlindersError:
            self._say(str(self.recording))
            raise
        self._say(f"{self.recording}; {read_and_left_out(self.rows, self.skipped)}")

    def _say(self, words: str) -> None:
        if not self._is_said:
            self._is_said = True
            say(words)


def read_and_left_out(rows: int, skipped: Iterable[Skipped]) -> str:
    """Say how many readings there are, and what is none, with the first such line.

    >>> from flinders.core.samples import Skipped
    >>> read_and_left_out(600, [Skipped("other", 3, (1, 2, 3), "LIS3MDL found"), Skipped("not finite", 1, (9,))])
    "600 readings, 3 other lines (line 1: 'LIS3MDL found'), 1 not finite line (line 9)"
    """
    words = [counted(rows, "reading")]
    for entry in skipped:
        example = f": {entry.example!r}" if entry.example else ""
        where = f" (line {entry.lines[0]}{example})" if entry.lines else ""
        words.append(f"{counted(entry.rows, f'{entry.reason} line')}{where}")
    return ", ".join(words)


def provenance(parts: Sequence[Counted]) -> Provenance:
    """Which release made it, when, from which files."""
    from datetime import UTC, datetime
    from importlib.metadata import version

    from flinders.core.calibration_file import Provenance

    return Provenance(
        flinders=version("flinders"),
        date=datetime.now(UTC).replace(microsecond=0),
        files=tuple(_source_file(part) for part in parts),
    )


def _source_file(part: Counted) -> SourceFile:
    """Name, hash and size of a file, and how many readings it gave."""
    from flinders.core.calibration_file import SourceFile

    recording = part.recording
    size = file_of(recording).size
    return SourceFile(
        name=os.fsencode(part.source).decode(errors="replace"),
        sha256=sha256(recording),
        bytes=size,
        rows=part.rows,
        as_logged=getattr(recording, "as_logged", False) and getattr(recording, "stored", None) is not None,
        autopilot=getattr(recording, "autopilot", None),
        compass=getattr(recording, "compass", None),
        device_id=getattr(recording, "device_id", None),
    )
