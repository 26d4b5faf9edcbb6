"""The calibration in the end, of all readings of a session, and a log that was opened in its place.

>>> import tempfile
>>> from flinders import simulate
>>> from flinders.live.session import Arrived, Session, step
>>> session, _ = step(Session(), Arrived(0.0, rows_of(simulate.tumble(seed=1).samples), Unit.of("uT")))
>>> finished(session, None, {}).fit.verdict
'good'

Of a sensor it is made from the file of the session, and not from the readings in memory, which are fewer in a long one.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flinders.core.calibration_file import SourceFile
from flinders.core.samples import Wrapped, frame_of
from flinders.core.units import Unit
from flinders.errors import FlindersError, UnreadableInput, counted, figures
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.live.buffer import ReadingBuffer, rows_of
from flinders.live.session import Series, snapshot
from flinders.live.session_file import Edits, TrimmedRecording
from flinders.readers import open_recording

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flinders.core.samples import Recording, Samples
    from flinders.fitting.result import Fit
    from flinders.live.buffer import Timeline
    from flinders.live.exclusions import Span
    from flinders.live.session import Session

CHUNK: Final = 1 << 20


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """What a session comes to.

    Attributes
    ----------
    key : int
        Of what was shown, as in `flinders.live.session`.
    name : str
        What it was made from.
    recording : Recording
        The readings.
    outcome : Fit or FlindersError
    files : tuple of SourceFile
    """

    key: int
    name: str
    recording: Recording
    outcome: Fit | FlindersError
    files: tuple[SourceFile, ...] = ()

    @property
    def fit(self) -> Fit:
        """The fit, good or limited.

        Raises
        ------
        FlindersError
            Why there is none, or none that may be used.
        """
        if isinstance(self.outcome, FlindersError):
            raise self.outcome
        return self.outcome

    @property
    def limits(self) -> list[str]:
        """What it is not good for."""
        return [finding.advice for finding in self.fit.findings if finding.severity == "limits"]

    @property
    def about(self) -> list[str]:
        """Where the numbers come from and what is claimed of them, for the head of an export."""
        worst = f"worst heading good to {figures(self.fit.heading_error_deg.worst)}° (1 σ)"
        return [
            f"from {self.name}",
            f"the calibration is {self.fit.verdict}: {worst}",
            *(f"limited: {limit}" for limit in self.limits),
        ]


@dataclass(slots=True, eq=False)
class _CountedRecording(Wrapped):
    """A recording that knows how many readings its last pass gave."""

    recording: Recording
    rows: int = 0

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        self.rows = 0
        for block in self.recording.blocks():
            self.rows += len(block)
            yield block


def finished(session: Session, path: Path | None, reading: dict[str, Any]) -> Finished:
    """Fit all readings of what is shown, but for those taken out.

    Parameters
    ----------
    session : Session
    path : Path, optional
        The file of the session; without it, and of a log, what is in memory is all.
    reading : dict
        How it is read, as `flinders.open_recording` takes it.
    """
    key, name = session.shown.key, session.opened_name or session.source.name
    if session.opened is not None or path is None:
        samples = snapshot(session, None).samples
        return Finished(key, name, samples, _outcome(session, samples))
    try:
        file = open_recording(path, **reading)
    except FlindersError as error:
        return Finished(key, path.name, snapshot(session, None).samples, _nothing_yet(error))
    counting = _CountedRecording(TrimmedRecording(file, Edits.of(session).left_out))
    outcome = _outcome(session, counting)
    return Finished(key, path.name, counting, outcome, (_source_file(path, counting.rows),))


def _nothing_yet(error: FlindersError) -> FlindersError:
    """What cannot be read of a recording that has just begun is no fault of its file."""
    if isinstance(error, UnreadableInput):
        return UnreadableInput("there are no readings yet to make a calibration from: turn the sensor first")
    return error


def _outcome(session: Session, recording: Recording) -> Fit | FlindersError:
    try:
        return fit(recording, target_deg=session.target_deg, dip_deg=session.dip_deg)
    except Refused as refused:
        return refused
    except FlindersError as error:
        return error


def _source_file(path: Path, rows: int) -> SourceFile:
    """The file as it is now; of one that grows, its beginning."""
    digest, size = hashlib.sha256(), 0
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
            size += len(chunk)
    return SourceFile(name=path.name, sha256=digest.hexdigest(), bytes=size, rows=rows)


def load(path: Path, name: str, spans: tuple[Span, ...] = (), **reading: Any) -> tuple[Series, str, Timeline]:
    """Read a recording as a series of readings, as many as a buffer holds, how it was read, and where its time ends.

    Parameters
    ----------
    path : Path
    name : str
        For messages, in place of its own.
    spans : tuple of (start, end), s
        Stretches of time to leave out.
    **reading
        As `flinders.open_recording` takes it.

    Raises
    ------
    InputError
        For what cannot be read.
    """
    recording = open_recording(path, **reading)
    trimmed = TrimmedRecording(recording, spans)
    buffer = ReadingBuffer.empty()
    for block in trimmed.blocks():
        buffer = buffer.extended(rows_of(block))
    words = str(recording).replace(str(path), name).replace(path.name, name)
    words = words if words.startswith(name) else f"{name}: {words}"
    series = Series(buffer, getattr(recording, "unit", Unit.of()), recording.axes, frame_of(recording))
    return series, f"{words}; {counted(buffer.total, 'reading')}", trimmed.timeline
