"""File of a session: its header, the user's edits, and reading it again.

The recorder writes readings as they arrive, with the user's edits as comments between them, so that a session can
continue after a crash:

>>> done = Edits(excluded=((3.0, 5.5),), target_deg=0.5)
>>> edits_in(["0.1,1,2,3", line_of(done)]) == done
True

The final calibration uses all readings of the file, in the unit of the file, and not those in memory: so
``flinders calibrate SESSION`` gives the same result, except for excluded readings.
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
from flinders.core.files import free_path, reason_and_remedy
from flinders.core.samples import RecordingWrapper, frame_of
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import OutputError, UsageError, count_text
from flinders.likelihood.site_field import recorded_site
from flinders.links.recording_text import ResumedRecording
from flinders.links.sinks import FileSink, RetryingSink
from flinders.readers import open_recording

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator

    from flinders.apps.live.messages import Kind, Span
    from flinders.core.samples import Recording, Samples
    from flinders.likelihood.site_field import Site
    from flinders.links.feeds import Feed
    from flinders.links.sinks import Sink
    from flinders.links.transports import ByteSource

FOLDER: Final = "flinders-sessions"
PREFIX: Final = "# flinders live: "
DEFAULT_TARGET: Final = "arduino"
"""Default export target, unless readings come from an autopilot."""


def line_of(edits: Edits) -> str:
    """Write edits as a comment line for the file of a session."""
    return f"{PREFIX}{encode(edits)}\n"


def edits_in(lines: Iterable[str]) -> Edits:
    """Parse the edits in the last comment that has any; a comment that a crash has truncated is skipped."""
    edits = Edits()
    for line in lines:
        if line.startswith(PREFIX):
            with contextlib.suppress(UsageError):
                message = parse(line.removeprefix(PREFIX))
                edits = message if isinstance(message, Edits) else edits
    return edits


def read_edits(path: str | os.PathLike[str]) -> Edits:
    """Read the edits from the file of a session; `OutputError` if that fails."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            return edits_in(file)
    except OSError as error:
        raise OutputError(f"{path}: cannot be continued: {reason_and_remedy(error)}") from None


def excluded_spans(edits: Edits) -> tuple[Span, ...]:
    """Spans of time that a calibration leaves out, s."""
    paused = () if edits.paused_s is None else ((edits.paused_s, math.inf),)
    before = () if edits.begun_s is None else ((-math.inf, edits.begun_s),)
    later = () if edits.finished_s is None else ((math.nextafter(edits.finished_s, math.inf), math.inf),)
    return (*before, *edits.excluded, *paused, *later)


class Log(NamedTuple):
    """Readings in memory, with unit, axes, frame and site."""

    buffer: ReadingBuffer
    unit: Unit = Unit.of()
    axes: Axes = Axes()
    frame: str = "sensor"
    is_timed: bool = True  # whether times were recorded; otherwise the number of a reading serves as its time
    site: Site | None = None  # field at the place of the recording, from its file

    @property
    def advice_frame(self) -> Literal["sensor", "vehicle"]:
        """Frame in whose axes advice is worded: the vehicle if the mounting of the sensor is known, else the sensor."""
        return "vehicle" if self.frame == "vehicle" or not self.axes.is_identity else "sensor"

    def site_known(self, site: Site | None) -> Site | None:
        """Site for a comparison with these readings: without its field strength if they are in counts."""
        return site if site is None or self.unit.inside == MICROTESLA else replace(site, strength=None)


@dataclass(frozen=True, slots=True)
class Source:
    """Source of the readings of a session."""

    kind: Kind  # as in `SourceState`
    # returns a feed that records to a sink; arguments are the sink and ``resumed``, the recording to continue
    start: Callable[..., Feed]
    # arguments of `flinders.open_recording` for the recording
    reading: dict[str, Any] = field(default_factory=dict)
    board: ByteSource | None = None  # board that can receive a calibration
    site: Site | None = None  # field at the place of a log that is played back
    target: str = DEFAULT_TARGET  # default export target


@dataclass(frozen=True, slots=True, eq=False)
class Supply:
    """A source with its recording: `feed` writes to `sink`, the file at `path`; `log` has the earlier readings."""

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
    target: str = DEFAULT_TARGET


@contextlib.contextmanager
def open_session(
    source: Source, axes: Axes, *, output: str | None = None, resume: str | None = None, say: Callable[[str], object]
) -> Iterator[Supply]:
    """Begin a session, or continue the one in a file, and close its file at the end.

    Records to a new file `output`, or continues the file `resume`; without both, the file is named by the date. `say`
    receives messages for the user.

    Raises
    ------
    OutputError
        If the file cannot be written, or lacks readings at the end.
    InputError
        If the file of an earlier session cannot be read.
    """
    resumed = None if resume is None else ResumedRecording.of(resume)
    edits = Edits() if resume is None else read_edits(resume)
    edits = msgspec.structs.replace(edits, site=source.site or edits.site)
    path = Path(resume or output or default_path(datetime.now(UTC)))
    reading = {**source.reading, "axes": str(axes)}
    with contextlib.closing(RetryingSink(FileSink(path, resume=resume is not None), say)) as sink:
        log, timeline = Log(ReadingBuffer.empty(), axes=axes), Timeline()
        if resumed is not None and resumed.header is not None:
            before = excluded_spans(Edits(begun_s=edits.begun_s))
            log, _, timeline = load(path, path.name, before, **reading)
            edits = _close_pause(edits, log.buffer.seconds)
            say(f"{path}: continues after {count_text(log.buffer.total, 'reading')}")
        feed = source.start(sink, resumed=resumed)
        yield Supply(feed, source.kind, sink, path, axes, source.board, reading, edits, log, timeline, source.target)


def _close_pause(edits: Edits, seconds: float) -> Edits:
    """Convert a pause that lasted to the end of a session to an excluded span of time."""
    if edits.paused_s is None:
        return edits
    before = tuple(span for span in edits.excluded if span[1] < edits.paused_s)
    ends = [span[1] for span in edits.excluded[len(before) :]]
    begin = min([edits.paused_s, *(span[0] for span in edits.excluded[len(before) :])])
    paused = () if seconds < edits.paused_s else ((begin, max([seconds, *ends])),)
    return msgspec.structs.replace(edits, excluded=(*before, *paused), paused_s=None)


def default_path(now: datetime, folder: str = FOLDER) -> Path:
    """Path of a session's file, named by the time `now`, in a folder that is created; `OutputError` if that fails."""
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be created: {reason_and_remedy(error)}; give the recording another place with --output"
        ) from None
    return free_path(path / f"{now.astimezone():%Y-%m-%d_%H-%M-%S}.csv")


@dataclass(slots=True, eq=False)
class TrimmedRecording(RecordingWrapper):
    """A recording on the timeline of its session, without some spans of time, whose ends are left out too.

    `timeline` is the state after the last pass. Without recorded times, the number of a reading serves as its time.

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
        """Yield the blocks of the recording."""
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
    """Read a recording; returns the readings that a buffer holds, a sentence on the format, and the timeline's state.

    `name` is used in messages, `spans` of time are left out, and `reading` are arguments of `flinders.open_recording`.
    """
    recording = open_recording(path, **reading)
    trimmed = TrimmedRecording(recording, spans)
    buffer = ReadingBuffer.empty()
    for block in trimmed.blocks():
        buffer = buffer.with_rows(rows_of(block))
    words = str(recording).replace(str(path), name).replace(path.name, name)
    words = words if words.startswith(name) else f"{name}: {words}"
    unit = getattr(recording, "unit", Unit.of())
    site, of_site = recorded_site(recording, z_down=not recording.axes.is_identity) or (None, "")
    log = Log(buffer, unit, recording.axes, frame_of(recording), trimmed.is_timed, site)
    said = "; ".join(filter(None, (words, count_text(buffer.total, "reading"), of_site)))
    return log, said, trimmed.timeline
