"""Recording of a feed into a file until the recording is stopped, for sources of `flinders record` without lines.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders import read, simulate
>>> from flinders.links.feeds import Replay
>>> from flinders.links.sinks import FileSink
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> with FileSink(file) as sink:
...     statistics = record_feed(Replay(simulate.tumble(seed=1).samples, speed=None), sink, readings=120)
>>> statistics.readings, len(read(file))
(120, 120)
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.units import MICROTESLA, unit_label
from flinders.errors import OutputError, UnreadableInput
from flinders.links.feeds import FeedEvent
from flinders.links.recording_statistics import RecordingStatistics
from flinders.links.recording_text import title
from flinders.links.sinks import SYNC_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.links.feeds import Feed, Received
    from flinders.links.recording_text import ResumedRecording
    from flinders.links.sinks import Sink

WAIT_S: Final = 0.1  # Longest wait for readings, by which the end of a recording can be late
WATCH_S: Final = 0.5


class RecordedFeed:
    """Feed that records another feed as a table for `flinders.read`; events are recorded as comments.

    Parameters
    ----------
    feed : Feed
    sink : Sink
    resumed : ResumedRecording, optional
        The recording to continue; `sink` must be its file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders import read, simulate
    >>> from flinders.links.feeds import Replay
    >>> from flinders.links.sinks import FileSink
    >>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
    >>> tumble = simulate.tumble(seed=1, n=400).samples
    >>> with FileSink(file) as sink:
    ...     feed = RecordedFeed(Replay(tumble, speed=None), sink)
    ...     while not (isinstance(got := feed.next(0.1), FeedEvent) and got.kind == "ended"):
    ...         pass
    >>> abs(read(file).field - tumble.field).max() < 1e-6
    np.True_
    """

    def __init__(self, feed: Feed, sink: Sink, *, resumed: ResumedRecording | None = None) -> None:
        self._feed, self._sink = feed, sink
        self._header = resumed.header if resumed else None
        self._is_checked = self._header is None
        self._title = title(feed.name, is_new=resumed is None)
        self._synced = time.monotonic()

    @property
    def name(self) -> str:
        """Name of the feed."""
        return self._feed.name

    def next(self, timeout: float) -> Received:
        """As `Feed.next`; `OutputError` if the columns are not those of the recording to continue."""
        received = self._feed.next(timeout)
        if isinstance(received, FeedEvent):
            self._write("".join(f"# {line}\n" for line in str(received).splitlines()))
        elif received is not None:
            self._write(self._rows(received))
        if time.monotonic() - self._synced >= SYNC_S:
            self._synced = time.monotonic()
            self._sink.sync()
        return received

    def close(self) -> None:
        """As `Feed.close`."""
        self._sink.sync()
        self._feed.close()

    def _write(self, text: str) -> None:
        self._sink.write(self._title + text)
        self._title = ""

    def _rows(self, samples: Samples) -> str:
        columns = _columns(samples)
        header = ",".join(columns)
        if not self._is_checked and header != self._header:
            raise OutputError(
                f"{self.name} has the columns {header}, the continued recording {self._header or 'no header'}: "
                "start another recording"
            )
        is_new, self._is_checked = self._header is None, True
        self._header = self._header or header  # columns of the first block; one that is missing later is nan
        nothing = np.full(len(samples), np.nan)
        rows = zip(*[columns.get(name, nothing).tolist() for name in self._header.split(",")], strict=True)
        text = "".join(f"{at:.6f},{','.join(f'{value:.9g}' for value in rest)}\n" for at, *rest in rows)
        return f"{self._header}\n{text}" if is_new else text


def _columns(samples: Samples) -> dict[str, Floats]:
    """Columns of samples in the recorded table, by name."""
    unit = "uT" if samples.unit.inside == MICROTESLA else "counts"
    tables = {
        "t_s": samples.time,
        f"mag_x_{unit},mag_y_{unit},mag_z_{unit}": samples.field,
        "accel_x,accel_y,accel_z": samples.acceleration,
        "gyro_x_radps,gyro_y_radps,gyro_z_radps": samples.rate,
        "temp_C": samples.temperature,
    }
    columns: dict[str, Floats] = {}
    for names, table in tables.items():
        if table is not None:
            columns |= zip(names.split(","), np.atleast_2d(table.T), strict=True)
    return columns


class _LimitedFeed:
    """A feed that ends after a number of readings; None for no limit."""

    def __init__(self, feed: Feed, readings: int | None) -> None:
        self.name, self._feed, self._left = feed.name, feed, readings

    def next(self, timeout: float) -> Received:
        """As `Feed.next`."""
        if self._left == 0:
            return FeedEvent("ended", 0.0, f"all requested readings of {self.name} were received")
        received = self._feed.next(timeout)
        if self._left is None or received is None or isinstance(received, FeedEvent):
            return received
        taken = received[: self._left]
        self._left -= len(taken)
        return taken

    def close(self) -> None:
        """As `Feed.close`."""
        self._feed.close()


def record_feed(
    feed: Feed,
    sink: Sink,
    *,
    seconds: float | None = None,
    readings: int | None = None,
    resumed: ResumedRecording | None = None,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda _: None,
    watch: Callable[[RecordingStatistics], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> RecordingStatistics:
    """Record a feed until it ends. The parameters are those of `flinders.links.recorder.Recorder`.

    Raises
    ------
    OutputError
        If the file cannot be written; earlier readings are saved.
    UnreadableInput
        If the feed gives no reading at all.
    """
    recorded, statistics = RecordedFeed(_LimitedFeed(feed, readings), sink, resumed=resumed), RecordingStatistics()
    start, watched, why = clock(), 0.0, f"nothing arrived from {feed.name}"
    try:
        while not stopped() and (seconds is None or statistics.seconds < seconds):
            received = recorded.next(WAIT_S if seconds is None else max(min(WAIT_S, seconds - statistics.seconds), 0.0))
            statistics.seconds = clock() - start
            if isinstance(received, FeedEvent):
                if received.kind == "ended":
                    break
                why = received.words if received.kind not in ("connected", "back") else why
                _announce(received, statistics, say)
            elif received is not None:
                _count(received, statistics)
            if watch and statistics.seconds - watched >= WATCH_S:
                watched = statistics.seconds
                watch(statistics)
    finally:
        recorded.close()
    if not statistics.readings:
        raise UnreadableInput(why)
    return statistics


def _announce(event: FeedEvent, statistics: RecordingStatistics, say: Callable[[str], None]) -> None:
    """Tell the user about an event, and count disconnections."""
    match event.kind:
        case "connected" | "back":
            say(event.words)
        case "gone":
            statistics.disconnections += 1
            say(f"! {event.words}; readings so far are saved. Waiting for it to come back; Ctrl-C ends the recording")
        case _:
            say(f"! {event.words}")


def _count(samples: Samples, statistics: RecordingStatistics) -> None:
    """Count readings, and add their field strengths to the statistics."""
    statistics.unit = unit_label(samples.unit.inside)
    for at in () if samples.time is None else samples.time.tolist():
        statistics.count_row(at)
    statistics.measure(samples.field)
