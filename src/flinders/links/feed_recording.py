"""Recording of a feed into a file until it is stopped, for sources of `flinders record` that send no lines.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders import read, simulate
>>> from flinders.links.feeds import Replay
>>> from flinders.links.recorder import FileSink
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> with FileSink(file) as sink:
...     statistics = record_feed(Replay(simulate.tumble(seed=1).samples, speed=None), sink, readings=120)
>>> statistics.readings, len(read(file))
(120, 120)
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from flinders.core.units import unit_label
from flinders.errors import UnreadableInput
from flinders.links.feeds import FeedEvent
from flinders.links.recorder import RecordedFeed
from flinders.links.transcript import RecordingStatistics

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.samples import Samples
    from flinders.links.feeds import Feed, Received
    from flinders.links.recorder import ResumedRecording, Sink

WAIT_S: Final = 0.1  # Longest wait for readings, the delay at the end of a recording
WATCH_S: Final = 0.5


class _LimitedFeed:
    """A feed that ends after a count of readings."""

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
    """Record a feed until it ends; parameters are those of `flinders.links.recorder.Recorder`.

    Raises
    ------
    OutputError
        If the file cannot be written; earlier readings are saved.
    UnreadableInput
        Without any reading.
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
    """Report an event to the user, and count disconnections."""
    match event.kind:
        case "connected" | "back":
            say(event.words)
        case "gone":
            statistics.disconnections += 1
            say(f"! {event.words}; readings so far are saved. Waiting for it to come back; Ctrl-C ends the recording")
        case _:
            say(f"! {event.words}")


def _count(samples: Samples, statistics: RecordingStatistics) -> None:
    """Add readings and their field strengths to the statistics."""
    statistics.unit = unit_label(samples.unit.inside)
    for at in () if samples.time is None else samples.time.tolist():
        statistics.count_row(at)
    statistics.measure(samples.field)
