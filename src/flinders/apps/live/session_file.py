"""The file of a session: how it begins, what was done by hand in it, and how it is read again.

Readings are written by the recorder, as they arrive. Between them stand comments with what a person did, so that a
session that was ended by a crash goes on as it was:

>>> done = Edits(excluded=((3.0, 5.5),), target_deg=0.5)
>>> edits_in(["0.1,1,2,3", line_of(done)]) == done
True

The readings that a calibration is made of in the end are those of the file, and not those in memory: all of them, with
the unit they were written in, so that ``flinders calibrate SESSION`` finds the same, but for what was taken out.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import msgspec
import numpy as np

from flinders.apps.live.buffer import ReadingBuffer, Timeline, rows_of
from flinders.apps.live.messages import Edits, encode, parse
from flinders.core.axes import Axes
from flinders.core.files import free_path, reason
from flinders.core.samples import Wrapped, frame_of
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import OutputError, UsageError, counted
from flinders.likelihood.site_field import recorded_site
from flinders.links.recorder import Patient, Resumed, ToFile
from flinders.readers import open_recording

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator

    from flinders.apps.live.messages import Kind, Span
    from flinders.core.samples import Recording, Samples
    from flinders.likelihood.site_field import Site
    from flinders.links.feeds import Feed
    from flinders.links.recorder import Sink
    from flinders.links.transports import ByteSource

FOLDER: Final = "flinders-sessions"
SIGN: Final = "# flinders live: "
FIRST_TARGET: Final = "arduino"
"""What a calibration is most likely for, unless its readings come from an autopilot."""


def line_of(edits: Edits) -> str:
    """What a person did, as a comment of the file."""
    return f"{SIGN}{encode(edits)}\n"


def edits_in(lines: Iterable[str]) -> Edits:
    """What the last such comment says; one that a crash has cut is passed over."""
    edits = Edits()
    for line in lines:
        if line.startswith(SIGN):
            with contextlib.suppress(UsageError):
                message = parse(line.removeprefix(SIGN))
                edits = message if isinstance(message, Edits) else edits
    return edits


def read_edits(path: str | os.PathLike[str]) -> Edits:
    """What the file of a session says; `OutputError` where it cannot be read."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            return edits_in(file)
    except OSError as error:
        raise OutputError(f"{path}: cannot be continued: {reason(error)}") from None


def left_out(edits: Edits) -> tuple[Span, ...]:
    """All spans that a calibration does without."""
    paused = () if edits.paused_s is None else ((edits.paused_s, math.inf),)
    before = () if edits.begun_s is None else ((-math.inf, edits.begun_s),)
    later = () if edits.finished_s is None else ((math.nextafter(edits.finished_s, math.inf), math.inf),)
    return (*before, *edits.excluded, *paused, *later)


class Log(NamedTuple):
    """Readings in memory with all that is known of them."""

    buffer: ReadingBuffer
    unit: Unit = Unit.of()
    axes: Axes = Axes()
    frame: str = "sensor"
    is_timed: bool = True  # the times are those of the readings, and not their numbers
    site: Site | None = None  # what it states of the field where it was made

    @property
    def advice_frame(self) -> Literal["sensor", "vehicle"]:
        """Whose words advice is given in: those of a vehicle where somebody said how the sensor sits in it."""
        return "vehicle" if self.frame == "vehicle" or not self.axes.is_identity else "sensor"

    def site_known(self, site: Site | None) -> Site | None:
        """A site as far as these readings can be compared with it: those in counts have no strength."""
        return site if site is None or self.unit.inside == MICROTESLA else replace(site, strength=None)


@dataclass(frozen=True, slots=True)
class Source:
    """Where the readings of a session come from."""

    kind: Kind  # as `SourceState` has it
    # makes of a sink, and of the recording that is ``resumed``, the feed that records into it
    start: Callable[..., Feed]
    # how the recording is read, as `flinders.open_recording` takes it
    reading: dict[str, Any] = field(default_factory=dict)
    board: ByteSource | None = None  # the board at the other end, where a calibration can be sent to it
    site: Site | None = None  # what a log that is played back states of the field where it was made
    target: str = FIRST_TARGET  # what its calibration is most likely for


@dataclass(frozen=True, slots=True, eq=False)
class Supply:
    """A source that is recorded: `feed` writes into `sink`, the file at `path`, in which the others stand already."""

    feed: Feed
    kind: Kind
    sink: Sink
    path: Path
    axes: Axes
    board: ByteSource | None = None
    reading: dict[str, Any] = field(default_factory=dict)
    edits: Edits = field(default_factory=Edits)
    log: Log = field(default_factory=lambda: Log(ReadingBuffer.empty()))
    timeline: Timeline = field(default_factory=Timeline)
    target: str = FIRST_TARGET


@contextlib.contextmanager
def begun(
    source: Source, axes: Axes, *, output: str | None = None, resume: str | None = None, say: Callable[[str], object]
) -> Iterator[Supply]:
    """Begin a session, or continue the one that a file holds, and close its file at the end.

    It is recorded into a new file, `output`, or goes on with one to `resume`; without both the file is named by the
    date. What a person should know goes to `say`.

    Raises
    ------
    OutputError
        If the file cannot be written, or not all that came is in it at the end.
    InputError
        If the file of an earlier session cannot be read.
    """
    resumed = None if resume is None else Resumed.of(resume)
    edits = Edits() if resume is None else read_edits(resume)
    edits = msgspec.structs.replace(edits, site=source.site or edits.site)
    path = Path(resume or output or default_path(datetime.now(UTC)))
    reading = {**source.reading, "axes": str(axes)}
    with contextlib.closing(Patient(ToFile(path, resume=resume is not None), say)) as sink:
        log, timeline = Log(ReadingBuffer.empty(), axes=axes), Timeline()
        if resumed is not None and resumed.header is not None:
            before = left_out(Edits(begun_s=edits.begun_s))
            log, _, timeline = load(path, path.name, before, **reading)
            edits = _ended_pause(edits, log.buffer.seconds)
            say(f"{path}: goes on after {counted(log.buffer.total, 'reading')}")
        feed = source.start(sink, resumed=resumed)
        yield Supply(feed, source.kind, sink, path, axes, source.board, reading, edits, log, timeline, source.target)


def _ended_pause(edits: Edits, seconds: float) -> Edits:
    """A pause that lasted until a session ended, as a stretch of time that is left out."""
    if edits.paused_s is None:
        return edits
    before = tuple(span for span in edits.excluded if span[1] < edits.paused_s)
    ends = [span[1] for span in edits.excluded[len(before) :]]
    begin = min([edits.paused_s, *(span[0] for span in edits.excluded[len(before) :])])
    paused = () if seconds < edits.paused_s else ((begin, max([seconds, *ends])),)
    return msgspec.structs.replace(edits, excluded=(*before, *paused), paused_s=None)


def default_path(now: datetime, folder: str = FOLDER) -> Path:
    """Name a session by its time, in a folder that is made where it is not there; `OutputError` where it cannot be."""
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made: {reason(error)}; give the recording another place with --output"
        ) from None
    return free_path(path / f"{now.astimezone():%Y-%m-%d_%H-%M-%S}.csv")


@dataclass(slots=True, eq=False)
class TrimmedRecording(Wrapped):
    """A recording on the timeline of its session, without some spans of time, whose ends are included.

    `timeline` is where the last pass ended; without times, readings are numbered in their place.

    Examples
    --------
    >>> from flinders.core.samples import Samples
    >>> samples = Samples.of(np.ones((5, 3)), time=[0, 1, 2, 3, 4])
    >>> [block.time.tolist() for block in TrimmedRecording(samples, ((1.0, 2.0),)).blocks()]
    [[0.0, 3.0, 4.0]]
    """

    recording: Recording
    spans: tuple[Span, ...]
    timeline: Timeline = field(default_factory=Timeline)
    is_timed: bool = True

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        self.timeline, count = Timeline(), 0
        for block in self.recording.blocks():
            self.is_timed = block.time is not None
            times = np.arange(count, count + len(block), dtype=float) if block.time is None else block.time
            count += len(block)
            times, self.timeline = self.timeline(times)
            used = np.ones(len(block), bool)
            for start, end in self.spans:
                used &= (times < start) | (times > end)
            yield replace(block, time=times)[used]


def load(path: Path, name: str, spans: tuple[Span, ...] = (), **reading: Any) -> tuple[Log, str, Timeline]:
    """Read a recording, as many readings as a buffer holds, how it was read, and where its time ends.

    It is called by a name in messages, spans of time are left out, and it is read as `flinders.open_recording` does.
    """
    recording = open_recording(path, **reading)
    trimmed = TrimmedRecording(recording, spans)
    buffer = ReadingBuffer.empty()
    for block in trimmed.blocks():
        buffer = buffer.extended(rows_of(block))
    words = str(recording).replace(str(path), name).replace(path.name, name)
    words = words if words.startswith(name) else f"{name}: {words}"
    unit = getattr(recording, "unit", Unit.of())
    site, of_site = recorded_site(recording, z_down=not recording.axes.is_identity) or (None, "")
    log = Log(buffer, unit, recording.axes, frame_of(recording), trimmed.is_timed, site)
    said = "; ".join(filter(None, (words, counted(buffer.total, "reading"), of_site)))
    return log, said, trimmed.timeline
