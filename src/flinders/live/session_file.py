"""The file of a session: how it begins, what was done by hand in it, and how it is read again.

Readings are written by the recorder, as they arrive. Between them stand comments with what a person did, so that a
session that was ended by a crash goes on as it was:

>>> done = Edits(excluded=((3.0, 5.5),), target_deg=0.5)
>>> print(done.line(), end="")
# flinders live: {"excluded":[[3.0,5.5]],"begun_s":null,"target_deg":0.5,"dip_deg":null,"goal":"heading","site":null}
>>> Edits.within(["0.1,1,2,3", done.line()]) == done
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
from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec
import numpy as np

from flinders.core.files import reason
from flinders.core.samples import Wrapped, frame_of
from flinders.core.units import Unit
from flinders.errors import OutputError, UsageError, counted
from flinders.likelihood.site_field import Site, recorded_site
from flinders.live.buffer import Exclusions, ReadingBuffer, Timeline, rows_of
from flinders.live.messages import SourceState
from flinders.live.recorder import Patient, Resumed, ToFile
from flinders.live.session import LiveSession, Series
from flinders.readers import open_recording

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator

    from flinders.core.axes import Axes
    from flinders.core.samples import Recording, Samples
    from flinders.live.buffer import Span
    from flinders.live.feeds import Feed
    from flinders.live.messages import Kind
    from flinders.live.recorder import Sink
    from flinders.live.transports import ByteSource

FOLDER: Final = "flinders-sessions"
SIGN: Final = "# flinders live: "


class Edits(msgspec.Struct, frozen=True, kw_only=True):
    """What a person did in a session, and the site of its log; readings up to `begun_s` were left behind."""

    excluded: tuple[tuple[float, float], ...] = ()
    begun_s: float | None = None
    target_deg: float = 1.0
    dip_deg: float | None = None
    goal: Literal["heading", "attitude"] = "heading"
    site: Site | None = None

    @classmethod
    def of(cls, session: LiveSession) -> Edits:
        """What was done in a session so far, on the readings of the sensor."""
        live = session.live
        return cls(
            excluded=live.excluded,
            begun_s=live.begun_s,
            target_deg=session.target_deg,
            dip_deg=session.dip_deg,
            goal=session.goal,
            site=live.site,
        )

    def line(self) -> str:
        """Write it as a comment."""
        return f"{SIGN}{msgspec.json.encode(self).decode()}\n"

    @classmethod
    def within(cls, lines: Iterable[str]) -> Edits:
        """What the last such comment says; one that a crash has cut is passed over."""
        edits = cls()
        for line in lines:
            if line.startswith(SIGN):
                with contextlib.suppress(msgspec.DecodeError, UsageError):
                    edits = msgspec.json.decode(line.removeprefix(SIGN), type=cls)
        return edits

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Edits:
        """What the file of a session says; `OutputError` where it cannot be read."""
        try:
            with Path(path).open(encoding="utf-8", errors="replace") as file:
                return cls.within(file)
        except OSError as error:
            raise OutputError(f"{path}: cannot be continued: {reason(error)}") from None

    @property
    def left_out(self) -> tuple[Span, ...]:
        """All spans that a calibration does without."""
        return self.excluded if self.begun_s is None else ((-np.inf, self.begun_s), *self.excluded)


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


@dataclass(frozen=True, slots=True, eq=False)
class Supply:
    """A source that is recorded: `feed` writes into `sink`, the file at `path`; `edits` stand there already."""

    feed: Feed
    sink: Sink
    path: Path
    axes: Axes
    board: ByteSource | None = None
    reading: dict[str, Any] = field(default_factory=dict)
    edits: Edits = field(default_factory=Edits)


@contextlib.contextmanager
def begun(
    source: Source, axes: Axes, *, output: str | None = None, resume: str | None = None, say: Callable[[str], object]
) -> Iterator[tuple[Supply, LiveSession]]:
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
    edits = Edits() if resume is None else Edits.read(resume)
    path = Path(resume or output or default_path(datetime.now(UTC)))
    reading = {**source.reading, "axes": str(axes)}
    with contextlib.closing(Patient(ToFile(path, resume=resume is not None), say)) as sink:
        session = LiveSession(
            live=Series(axes=axes, site=source.site or edits.site),
            target_deg=edits.target_deg,
            dip_deg=edits.dip_deg,
            goal=edits.goal,
            recording=str(path),
            has_board=source.board is not None,
        )
        if resumed is not None and resumed.header is not None:
            session = _continued(session, path, edits, reading)
            say(f"{path}: goes on after {counted(session.live.buffer.total, 'reading')}")
        feed = source.start(sink, resumed=resumed)
        session = replace(session, source=SourceState(feed.name, source.kind, "waiting", ""))
        yield Supply(feed, sink, path, axes, source.board, reading, edits), session


def _continued(session: LiveSession, path: Path, edits: Edits, reading: dict[str, Any]) -> LiveSession:
    """A session with the readings that the file of an earlier one holds, and what a person did to them."""
    before = () if edits.begun_s is None else ((-math.inf, edits.begun_s),)
    series, _, timeline = load(path, path.name, before, **reading)
    exclusions, begun_s = Exclusions(edits.excluded), edits.begun_s
    live = replace(session.live, buffer=series.buffer, unit=series.unit, exclusions=exclusions, begun_s=begun_s, key=1)
    return replace(session, live=live, keys=1, timeline=timeline)


def default_path(now: datetime, folder: str = FOLDER) -> Path:
    """Name a session by its time, in a folder that is made where it is not there; `OutputError` where it cannot be."""
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made: {reason(error)}; give the recording another place with --output"
        ) from None
    name = now.astimezone().strftime("%Y-%m-%d_%H-%M-%S")
    file = path / f"{name}.csv"
    again = 2
    while file.exists():
        file, again = path / f"{name}_{again}.csv", again + 1
    return file


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


def load(path: Path, name: str, spans: tuple[Span, ...] = (), **reading: Any) -> tuple[Series, str, Timeline]:
    """Read a recording as a series of readings, as many as a buffer holds, how it was read, and where its time ends.

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
    series = Series(buffer, unit, recording.axes, frame_of(recording), is_timed=trimmed.is_timed, site=site)
    said = "; ".join(filter(None, (words, counted(buffer.total, "reading"), of_site)))
    return series, said, trimmed.timeline
