r"""Records a running sensor: all that arrives goes to the disk as it arrives, as text that `flinders.read` reads.

A line that is not understood is kept as a comment and counted. What was received is handed to the operating system at
once and forced to the disk each second, so that a crash loses at most a second, and a program that is killed less.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.live.sinks import ToFile
>>> from flinders.live.transports import Scripted
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> board = Scripted([b"booting\r\nRaw:0,0,8192,0,0,0,217,4,-5", b"86\r\nRaw:0,0,8192,0,0,0,217,2,-587\r\n"])
>>> with ToFile(file) as sink:
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

A recorder is also a `Feed`: `next` records what has come and hands it on, as readings and events.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from typing import TYPE_CHECKING, Final

from flinders.errors import LinkError, UnreadableInput, counted
from flinders.live.readings import FeedEvent
from flinders.live.sinks import title
from flinders.live.transcript import RecordingStatistics, Taken, Transcript

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.live.readings import Reading
    from flinders.live.sinks import Resumed, Sink
    from flinders.live.transports import ByteSource

SYNC_S: Final = 1.0
"""Seconds after which what was received is forced to the disk."""
WAIT_S: Final = 0.1
"""Longest wait for bytes: how soon the end of a recording is noticed."""
WATCH_S: Final = 0.5
TOGETHER: Final = 5000
"""Datagrams that are taken together, at most."""
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 2.0
"""Seconds between tries to open a lost port again: each twice the one before, up to the last."""


class Recorder:
    """Takes what a source gives, writes it down, and hands it on.

    Parameters
    ----------
    source : ByteSource
    sink : Sink
    seconds, readings : float and int, optional
        When `run` stops, and after how many rows nothing more is taken.
    columns, unit, scale : optional
        For the readings that `next` hands on, where the lines do not tell; as `flinders.open_recording` takes them.
        What is written does not depend on them.
    pattern : str, optional
        How a line with a reading is written, where that is not recognised.
    resumed : Resumed, optional
        The recording that is continued, of which `sink` is the file.
    stopped : callable
        Tells `run` whether to stop for another reason.
    say : callable
        Told by `run` what a person at the bench should know, a sentence each.
    watch : callable, optional
        Called by `run` twice a second with what has been recorded.
    clock : callable
        Seconds, ascending.

    Attributes
    ----------
    name : str
        Of the source.
    statistics : RecordingStatistics
        What has been recorded so far.
    """

    def __init__(
        self,
        source: ByteSource,
        sink: Sink,
        *,
        seconds: float | None = None,
        readings: int | None = None,
        columns: str | None = None,
        unit: str | None = None,
        scale: float | None = None,
        pattern: str | None = None,
        resumed: Resumed | None = None,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        watch: Callable[[RecordingStatistics], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = source.name
        self._source, self._sink, self._clock = source, sink, clock
        self._seconds, self._stopped, self._say, self._watch = seconds, stopped, say, watch
        self._transcript = Transcript(
            source.name,
            is_framed=source.is_framed,
            columns=columns,
            unit=unit,
            scale=scale,
            pattern=pattern,
            most=readings,
            header=resumed.header if resumed else None,
            rows=resumed.rows if resumed else (),
        )
        self._earlier = resumed.seconds if resumed else 0.0
        self._start = clock()
        self._title = title(source.name, is_new=resumed is None)
        self._synced = self._watched = 0.0
        self._retry: tuple[float, float] | None = None
        self._lost = 0
        self._is_closed = False
        self._waiting: deque[list[Reading] | FeedEvent] = deque([FeedEvent("connected", 0.0, f"{source.name} is open")])

    @property
    def statistics(self) -> RecordingStatistics:
        """What has been recorded so far."""
        return self._transcript.statistics

    def next(self, timeout: float = WAIT_S) -> list[Reading] | FeedEvent:
        """Record what has come, and return it; nothing where nothing came within `timeout` seconds.

        Each event is returned once, before the readings that came after it.

        Raises
        ------
        OutputError
            Where it cannot be written; what came before is saved.
        """
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
        return self._waiting.popleft() if self._waiting else []

    def close(self) -> None:
        """Write what waits, see that it lasts, and let go of the source; `next` still hands on what is left."""
        if not self._is_closed:
            self._is_closed = True
            self._end()
            self._waiting.append(FeedEvent("ended", self._now(), f"{self.name} is closed"))
        self._source.close()

    def run(self) -> RecordingStatistics:
        """Record until the end; what was received by then is written.

        Raises
        ------
        OutputError
            Where it cannot be written; what came before is saved.
        UnreadableInput
            Where no line of numbers came at all.
        """
        while not self._is_over():
            received = self.next(self._wait())
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

    def _is_over(self) -> bool:
        late = self._seconds is not None and self._now() - self._earlier >= self._seconds
        return (late and not self._waiting) or self._transcript.is_full or self._stopped()

    def _wait(self) -> float:
        left = WAIT_S if self._seconds is None else self._seconds - (self._now() - self._earlier)
        return max(min(WAIT_S, left), 0.0)

    def _announce(self, event: FeedEvent) -> None:
        """Say what a person at the bench should know."""
        match event.kind:
            case "connected":
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
        """Take what comes, and note where the other end goes away."""
        try:
            content = self._read(timeout)
        except LinkError as error:
            self._keep(self._transcript.lost(self._now()))
            self._sink.sync()
            self._retry = (self._clock() + FIRST_RETRY_S, FIRST_RETRY_S)
            self._waiting.append(FeedEvent("gone", self._now(), f"{error}; what was recorded is saved"))
            return
        if content and self._title:
            self._sink.write(self._title)
            self._title = ""
        self._keep(self._transcript.take(content, self._now()))

    def _read(self, timeout: float) -> bytes:
        """Wait for what comes; of datagrams take all that wait, for there is only so much room for them."""
        content = self._source.read(timeout)
        if not content or not self._source.is_framed:
            return content
        together = [content]
        while len(together) < TOGETHER and (content := self._source.read(0.0)):
            together.append(content)
        return b"\n".join(together)

    def _note_lost(self) -> None:
        """Say where the system has thrown datagrams away, which nobody took in time."""
        lost = getattr(self._source, "lost", 0)
        new, self._lost = lost - self._lost, lost
        if new <= 0:
            return
        self._transcript.statistics.datagrams_lost += new
        words = f"{counted(new, 'datagram')} {'was' if new == 1 else 'were'} lost by this machine, which was too busy"
        self._sink.write(f"# {words}, before {self._now():.4f} s\n")
        self._waiting.append(
            FeedEvent("lost", self._now(), f"{words}: send several readings in one, or fewer a second")
        )

    def _keep(self, taken: Taken) -> None:
        """Write the text, and put in line what follows from it: what was recognised, the readings, what is amiss."""
        if taken.text:
            self._sink.write(taken.text)
        self._waiting += [event for event in taken.events if event.kind == "settled"]
        if taken.readings:
            self._waiting.append(taken.readings)
        self._waiting += [event for event in taken.events if event.kind != "settled"]

    def _try_again(self, timeout: float) -> None:
        """Wait for the other end, asking less and less often."""
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
            self._keep(self._transcript.back(self._now()))
            self._waiting.append(FeedEvent("back", self._now(), f"{self.name} is back"))

    def _end(self) -> None:
        self._keep(self._transcript.end(self._now()))
        self._note_lost()
        self._sink.sync()
