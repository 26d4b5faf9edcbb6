"""The beginning of a live session: its source, the file that it is recorded into, and what a resumed file holds.

>>> source = Source.simulated()
>>> source.kind, source.board
('simulated', None)
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.errors import counted
from flinders.live.buffer import Exclusions, Timeline
from flinders.live.evaluation import load
from flinders.live.feeds import Replay
from flinders.live.hub import Supply
from flinders.live.mavlink import Telemetry
from flinders.live.messages import SourceState
from flinders.live.recorder import Patient, RecordedFeed, Recorder, Resumed, ToFile
from flinders.live.session import Series, Session
from flinders.live.session_file import Edits, default_path
from flinders.live.simulated import SimulatedFeed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.core.axes import Axes
    from flinders.core.samples import Recording
    from flinders.live.feeds import Feed
    from flinders.live.messages import Kind
    from flinders.live.recorder import Sink
    from flinders.live.transports import ByteSource

SEED: Final = 1
"""Of the simulation, always the same sensor: a session of it can be resumed."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where the readings of a session come from.

    Attributes
    ----------
    kind : str
        As `SourceState` has it.
    start : callable
        Makes the feed that records into a sink, where a resumed recording ends.
    reading : dict
        How the recording is read, as `flinders.open_recording` takes it.
    board : ByteSource, optional
        The board at the other end, where a calibration can be sent to it.
    """

    kind: Kind
    start: Callable[[Sink, Resumed | None], Feed]
    reading: dict[str, Any] = field(default_factory=dict)
    board: ByteSource | None = None

    @classmethod
    def of_feed(cls, kind: Kind, feed: Feed) -> Self:
        """A feed of readings, which are recorded as a table."""
        return cls(kind, lambda sink, resumed: RecordedFeed(feed, sink, resumed=resumed))

    @classmethod
    def of_lines(cls, kind: Kind, wire: ByteSource, reading: dict[str, Any]) -> Self:
        """Lines of text, which are recorded as they come."""
        board = None if kind == "udp" else wire
        return cls(kind, lambda sink, resumed: Recorder(wire, sink, resumed=resumed, **reading), reading, board)

    @classmethod
    def of_vehicle(cls, link: ByteSource, *, compass: int = 1) -> Self:
        """The telemetry of a vehicle."""
        return cls.of_feed("mavlink", Telemetry(link, compass=compass))

    @classmethod
    def of_recording(cls, recording: Recording, *, speed: float = 1.0) -> Self:
        """A recording that is played back."""
        return cls.of_feed("replay", Replay(recording, speed=speed))

    @classmethod
    def simulated(cls) -> Self:
        """A simulated sensor."""
        return cls.of_feed("simulated", SimulatedFeed(SEED))


@contextlib.contextmanager
def begun(
    source: Source, axes: Axes, *, output: str | None = None, resume: str | None = None, say: Callable[[str], object]
) -> Iterator[tuple[Supply, Session, Timeline]]:
    """Begin a session, or continue the one that a file holds, and close its file at the end.

    Parameters
    ----------
    source : Source
    axes : Axes
    output, resume : str, optional
        The file that is recorded into: a new one, or that of an earlier session. Without both it is named by the date.
    say : callable
        Takes what a person should know.

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
    with _recording(path, is_resumed=resume is not None, say=say) as sink:
        series, timeline = Series(axes=axes), Timeline()
        if resumed is not None and resumed.header is not None:
            series, timeline = _continued(path, edits, axes, reading)
            say(f"{path}: goes on after {counted(series.buffer.total, 'reading')}")
        feed = source.start(sink, resumed)
        supply = Supply(
            feed,
            sink,
            path,
            axes,
            board=source.board,
            reading=reading,
            hint=lambda: _hint(feed),
            unrecorded=lambda: sink.why,
        )
        session = Session(
            live=series,
            target_deg=edits.target_deg,
            dip_deg=edits.dip_deg,
            goal=edits.goal,
            keys=series.key,
            source=SourceState(feed.name, source.kind, "waiting", ""),
            recording=str(path),
            has_board=source.board is not None,
        )
        yield supply, session, timeline


@contextlib.contextmanager
def _recording(path: Path, *, is_resumed: bool, say: Callable[[str], object]) -> Iterator[Patient]:
    """The file of a session; one with nothing in it goes."""
    sink = Patient(ToFile(path, resume=is_resumed), say)
    try:
        with contextlib.closing(sink):
            yield sink
    finally:
        with contextlib.suppress(OSError):
            if not path.stat().st_size:
                path.unlink()


def _continued(path: Path, edits: Edits, axes: Axes, reading: dict[str, Any]) -> tuple[Series, Timeline]:
    """The readings that the file of an earlier session holds, with what a person did to them."""
    before = () if edits.begun_s is None else ((-math.inf, edits.begun_s),)
    series, _, timeline = load(path, path.name, before, **reading)
    exclusions = Exclusions(edits.excluded)
    frame = Series(axes=axes).frame
    return replace(series, axes=axes, frame=frame, exclusions=exclusions, begun_s=edits.begun_s, key=1), timeline


def _hint(feed: Feed) -> str:
    """Why no reading comes of lines that do: nobody can tell which of their numbers are the field."""
    statistics = getattr(feed, "statistics", None)
    if statistics is None or not statistics.readings or statistics.form is None:
        return ""
    lines = counted(statistics.readings, "line")
    return (
        f"{lines} of numbers came, and which are the magnetometer's is not clear: start again with --columns X,Y,Z, "
        f"three of {statistics.form.header}, and with --unit; what came is recorded"
    )
