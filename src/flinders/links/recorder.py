r"""Recording of a running sensor: all that is received is written to disk at once, as text for `flinders.read`.

A line that cannot be parsed is written as a comment, and counted.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.links.sinks import FileSink
>>> from flinders.links.transports import ScriptedSource
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> board = ScriptedSource([b"booting\r\nRaw:0,0,8192,0,0,0,217,4,-5", b"86\r\nRaw:0,0,8192,0,0,0,217,2,-587\r\n"])
>>> with FileSink(file) as sink:
...     print(Recorder(board, sink, readings=2).run())
2 readings (Raw: lines) in 0.0 s, ..., strength 62.5 µT (62.5 to 62.6)
>>> print(file.read_text())
# flinders ... record: the script, begun ...Z
# booting
t_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT
...,0,0,1,0,0,0,21.7,0.4,-58.6
...,0,0,1,0,0,0,21.7,0.2,-58.7
<BLANKLINE>
>>> from flinders.readers import read
>>> read(file).field[0]
array([ 21.7,   0.4, -58.6])

A recorder is also a `Feed`: `next` records the lines that have arrived, and returns readings and events. It writes to a
sink (`flinders.links.sinks`): a file, a file with retries while the disk is full, standard output, or nothing.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import LinkError, UnreadableInput, count_text
from flinders.links.feeds import FeedEvent
from flinders.links.recording_text import title
from flinders.links.sinks import SYNC_S, NullSink
from flinders.links.transcript import Taken, Transcript

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.core.samples import Samples
    from flinders.links.feeds import Received
    from flinders.links.recording_statistics import RecordingStatistics
    from flinders.links.recording_text import ResumedRecording
    from flinders.links.sinks import Sink
    from flinders.links.transports import ByteSource

WAIT_S: Final = 0.1  # Longest wait for bytes, by which the end of a recording can be late
WATCH_S: Final = 0.5  # Interval at which `watch` is called
MAX_DATAGRAMS: Final = 5000  # Largest number of datagrams that are read together
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 2.0
"""First and longest time between attempts to open a lost port again; the time doubles with each attempt."""


class Recorder:
    """Recorder of a source of bytes, which is also a feed of its readings.

    Parameters
    ----------
    source : ByteSource
    sink : Sink, optional
        Destination of the text. Without it nothing is written, and readings and events are only returned.
    seconds, readings : float and int, optional
        Duration after which `run` stops, and number of rows after which nothing more is read.
    resumed : ResumedRecording, optional
        The recording to continue; `sink` must be its file.
    stopped : callable
        Called by `run`, which stops when the result is true.
    say : callable
        Called by `run` with each sentence for the user.
    watch : callable, optional
        Called by `run` twice per second with the statistics.
    clock : callable
        Monotonic clock in seconds.
    **reading
        ``columns``, ``unit``, ``scale`` and ``pattern`` as for `flinders.open_recording`, if the lines do not state
        them. The recorded text depends on the pattern only.
    """

    def __init__(
        self,
        source: ByteSource,
        sink: Sink | None = None,
        *,
        seconds: float | None = None,
        readings: int | None = None,
        resumed: ResumedRecording | None = None,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        watch: Callable[[RecordingStatistics], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        **reading: Any,
    ) -> None:
        self.name = source.name
        self._source, self._sink, self._clock = source, sink or NullSink(), clock
        self._saved = "; all readings so far are saved" if sink else ""
        self._seconds, self._stopped, self._say, self._watch = seconds, stopped, say, watch
        before: dict[str, Any] = {} if resumed is None else {"header": resumed.header, "rows": resumed.rows}
        self._transcript = Transcript(source.name, is_framed=source.is_framed, most=readings, **before, **reading)
        self._earlier = resumed.seconds if resumed else 0.0
        self._start = clock()
        self._title = title(source.name, is_new=resumed is None)
        self._synced = self._watched = 0.0
        self._retry: tuple[float, float] | None = None
        self._lost = 0
        self._is_closed = False
        self._waiting: deque[Samples | FeedEvent] = deque([FeedEvent("connected", 0.0, f"{source.name} is open")])

    @property
    def statistics(self) -> RecordingStatistics:
        """Statistics of the recording so far."""
        return self._transcript.statistics

    @property
    def clock_start(self) -> float | None:
        """As `Transcript.clock_start`."""
        return self._transcript.clock_start

    def next(self, timeout: float = WAIT_S) -> Received:
        """As `Feed.next`; `OutputError` if the received text cannot be written, while earlier text is saved."""
        if self._is_closed and not self._waiting:
            time.sleep(timeout)
        elif not self._waiting:
            if self._retry is None:
                self._listen(timeout)
            else:
                self._try_again(timeout)
            if self._now() - self._synced >= SYNC_S:
                self._synced = self._now()
                self._note_lost()
                self._sink.sync()
        return self._waiting.popleft() if self._waiting else None

    def close(self) -> None:
        """Write waiting lines, force them to the disk, and close the source; `next` still returns the last readings."""
        if not self._is_closed:
            self._is_closed = True
            self._end()
            self._waiting.append(FeedEvent("ended", self._now(), f"{self.name} is closed"))
        self._source.close()

    def run(self) -> RecordingStatistics:
        """Record until the end, and write all that has been received by then.

        Raises
        ------
        OutputError
            If the sink cannot be written; earlier text is saved.
        UnreadableInput
            If no line of numbers was received.
        """
        while not self._is_over():
            received = self.next(max(min(WAIT_S, self._remaining_s()), 0.0))
            if isinstance(received, FeedEvent):
                self._announce(received)
            if self._watch and self._now() - self._watched >= WATCH_S:
                self._watched = self._now()
                self._watch(self.statistics)
        self._end()
        if self._watch:
            self._watch(self.statistics)
        if not self.statistics.readings:
            raise UnreadableInput(self._transcript.nothing())
        return self.statistics

    def _now(self) -> float:
        return self._clock() - self._start + self._earlier

    def _remaining_s(self) -> float:
        """Time in s until the requested end."""
        return math.inf if self._seconds is None else self._seconds + self._earlier - self._now()

    def _is_over(self) -> bool:
        return (self._remaining_s() <= 0.0 and not self._waiting) or self._transcript.is_full or self._stopped()

    def _announce(self, event: FeedEvent) -> None:
        """Tell the user about an event."""
        match event.kind:
            case "connected" | "unclear":  # told at the end, with the statistics
                return
            case "settled":
                self._say(f"{self.name}: {event.words}")
            case "back":
                self._say(event.words)
            case "gone":
                self._say(f"! {event.words}. Waiting for it to come back; Ctrl-C ends the recording")
            case _:
                self._say(f"! {event.words}")

    def _listen(self, timeout: float) -> None:
        """Read and record bytes; if the source is disconnected, queue an event."""
        try:
            content = self._read(timeout)
        except LinkError as error:
            self._record(self._transcript.record_loss(self._now()))
            self._sink.sync()
            self._retry = (self._clock() + FIRST_RETRY_S, FIRST_RETRY_S)
            self._waiting.append(FeedEvent("gone", self._now(), f"{error.message}{self._saved}"))
            return
        if content and self._title:
            self._sink.write(self._title)
            self._title = ""
        self._record(self._transcript.take(content, self._now()))

    def _read(self, timeout: float) -> bytes:
        """Wait for bytes. All datagrams that wait are read, since the system's buffer for them is limited."""
        content = self._source.read(timeout)
        if not content or not self._source.is_framed:
            return content
        together = [content]
        while len(together) < MAX_DATAGRAMS and (content := self._source.read(0.0)):
            together.append(content)
        return b"\n".join(together)

    def _note_lost(self) -> None:
        """Record how many datagrams the system has dropped, since they were not read in time, and queue an event."""
        lost = getattr(self._source, "lost", 0)
        new, self._lost = lost - self._lost, lost
        if new <= 0:
            return
        self._transcript.statistics.datagrams_lost += new
        words = (
            f"{count_text(new, 'datagram')} {'was' if new == 1 else 'were'} lost by this machine, which was too busy"
        )
        self._sink.write(f"# {words}, before {self._now():.4f} s\n")
        self._waiting.append(
            FeedEvent("lost", self._now(), f"{words}: send several readings in one datagram, or fewer per second")
        )

    def _record(self, taken: Taken) -> None:
        """Write the text of received bytes, and queue their readings and events."""
        if taken.text:
            self._sink.write(taken.text)
        for event in taken.events:
            if event.kind == "settled":
                self._waiting.append(event)
                self._waiting += self._unclear_event()
        if taken.readings is not None:
            self._waiting.append(taken.readings)
        self._waiting += [event for event in taken.events if event.kind != "settled"]

    def _unclear_event(self) -> Iterator[FeedEvent]:
        """Yield an event if lines of numbers arrive and the columns of the field are not clear."""
        form = self.statistics.form
        if form is not None and not self.statistics.unit:
            yield FeedEvent(
                "unclear",
                self._now(),
                "lines of numbers arrive, but the columns of the magnetometer are unclear: start again with --columns "
                f"X,Y,Z, three of {form.header}, and with --unit; the lines are recorded",
            )

    def _try_again(self, timeout: float) -> None:
        """Try to open the source again, at longer and longer intervals."""
        due, pause = self._retry or (0.0, FIRST_RETRY_S)
        left = due - self._clock()
        if left > 0:
            time.sleep(min(left, timeout))
        self.statistics.seconds = self._now()
        if left > timeout:
            return
        self._retry = (self._clock() + min(2 * pause, LAST_RETRY_S), min(2 * pause, LAST_RETRY_S))
        with contextlib.suppress(LinkError):
            self._source.reopen()
            self._retry = None
            self._record(self._transcript.back(self._now()))
            self._waiting.append(FeedEvent("back", self._now(), f"{self.name} is back"))

    def _end(self) -> None:
        self._record(self._transcript.end(self._now()))
        self._note_lost()
        self._sink.sync()
