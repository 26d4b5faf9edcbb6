"""Feeds: readings of a running sensor, and events of its source. A recording can be played back as a feed.

>>> from flinders import simulate
>>> feed = Replay(simulate.tumble(seed=1).samples, speed=None)     # as fast as it is asked
>>> feed.next(0.1).words
'simulated hand, played back as fast as possible'
>>> [len(feed.next(0.1)) for _ in range(6)], feed.next(0.1).kind
([500, 500, 500, 500, 500, 500], 'ended')
>>> print(FeedEvent("gone", 12.5, "/dev/ttyACM0 is gone: check the cable"))
12.5 s: /dev/ttyACM0 is gone: check the cable

A feed uses no thread and no event loop: one thread calls `next`, and each call takes no longer than its timeout.
`Replay`, the recorder of lines, a vehicle and a simulated sensor are feeds. `FeedThread` calls `next` on a thread of
its own and queues the results, so that the server is not delayed.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, TypeAlias, TypeVar

import numpy as np

from flinders.core.plugins import app_modules
from flinders.core.samples import Samples
from flinders.errors import FlindersError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

CHUNK_READINGS: Final = 500  # Largest number of readings that are returned together
ASSUMED_HZ: Final = 50.0  # Readings per second that are assumed for a recording without times
MAX_GAP_S: Final = 2.0  # Longest pause in a playback; a longer one is shortened
MIN_WAIT_S: Final = 1e-4  # Shortest wait

Kind: TypeAlias = Literal[
    "connected", "settled", "several", "unclear", "silent", "nothing", "garbage", "no-answer", "lost", "gone", "back",
    "ended",
]  # fmt: skip
"""Kinds of events of a source.

``connected``: the source is open. ``settled``: the format of its lines is recognised. ``several``: lines come from
several devices. ``unclear``: the columns of the field are not known. ``silent``: no bytes have arrived. ``nothing``: no
usable line has arrived. ``garbage``: lines are unlike the first ones. ``no-answer``: the sensor did not answer its
board. ``lost``: this machine was too busy to receive everything. ``gone``: the source was disconnected. ``back``: it is
connected again. ``ended``: no more readings follow.
"""


@dataclass(frozen=True, slots=True)
class FeedEvent:
    """An event of a source of readings."""

    kind: Kind  #: kind of the event
    at: float  #: s: time since the start
    words: str  #: sentence for users

    def __str__(self) -> str:
        return f"{self.at:.1f} s: {self.words}"


Received: TypeAlias = Samples | FeedEvent | None
"""Readings in the order of time, in the axes of the sensor; or one event; or None if there is neither."""


class Feed(Protocol):
    """A source of readings; `name` is its name in messages: ``/dev/ttyACM0``, ``tumble.csv``."""

    @property
    def name(self) -> str:
        """Name of the source in messages."""

    def next(self, timeout: float) -> Received:
        """Return readings or an event; wait no longer than `timeout` s.

        After an event ``ended``, the result is always None.

        Raises
        ------
        FlindersError
            For a permanent error. A temporary loss of the source is an event.
        """

    def close(self) -> None:
        """Close the source; a second call does nothing."""


class Replay:
    """Feed that plays a recording back, at the speed of the recording or faster.

    Parameters
    ----------
    recording : Recording
        A recording in any form that `flinders.open_recording` reads, or samples.
    speed : float, optional
        Factor on the recorded speed; None for as fast as `next` is called. Pauses of more than 2 s are shortened to 2
        s. A recording without times is assumed to have 50 readings per second.
    clock, sleep : callable
        Monotonic clock in seconds, and wait.

    Raises
    ------
    UsageError
        For a speed that is not positive.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        speed: float | None = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if speed is not None and not 0 < speed < np.inf:
            raise UsageError(f"speed is {speed:g}: need a number above 0, or None for as fast as possible")
        self.name, self._is_timed = recording.source, True
        self._speed, self._clock, self._sleep = speed, clock, sleep
        self._blocks = recording.blocks()
        self._block = Samples.of(np.empty((0, 3)))
        self._due: Floats = np.zeros(0)
        self._played, self._last, self._count = 0.0, np.nan, 0
        self._start = clock()
        self._is_announced = self._is_over = self._has_ended = False

    def next(self, timeout: float) -> Received:
        """As `Feed.next`.

        Raises
        ------
        InputError
            If the recording cannot be read to its end.
        """
        if not self._is_announced:
            self._load()
            self._is_announced, self._start = True, self._clock()
            return FeedEvent("connected", 0.0, self._words)
        if not len(self._block) and not self._is_over:
            self._load()
        if self._is_over:
            return self._end_event(timeout)
        ready = CHUNK_READINGS if self._speed is None else self._due_count(timeout)
        taken, self._block, self._due = self._block[:ready], self._block[ready:], self._due[ready:]
        return taken if len(taken) else None

    def close(self) -> None:
        """As `Feed.close`."""
        self._is_over = True

    @property
    def _words(self) -> str:
        how = "as fast as possible" if self._speed is None else f"at {self._speed:g} times its speed"
        return f"{self.name}, played back {how}{self._assumption}"

    @property
    def _assumption(self) -> str:
        return "" if self._is_timed else f", with {ASSUMED_HZ:g} readings per second assumed, as the file has no times"

    def _load(self) -> None:
        """Load the next block, and compute the time at which each of its readings is due."""
        block = next(self._blocks, None)
        if block is None or not len(block):
            self._is_over = block is None
            return
        self._is_timed = block.time is not None
        counted = (self._count + np.arange(len(block))) / ASSUMED_HZ
        times = counted if block.time is None else block.time
        self._count += len(block)
        steps = np.diff(times, prepend=self._last if np.isfinite(self._last) else times[0])
        steps = np.clip(np.nan_to_num(steps), 0.0, MAX_GAP_S)
        self._due = self._played + np.cumsum(steps) / (self._speed or 1.0)
        self._played, self._last = float(self._due[-1]), float(times[-1])
        self._block = replace(block, time=times)

    def _due_count(self, timeout: float) -> int:
        """Number of readings that are due, after a wait for the first of them."""
        if not len(self._due):
            return 0
        wait = float(self._due[0]) - (self._clock() - self._start)
        if wait > 0:
            self._sleep(max(min(wait, timeout), MIN_WAIT_S))
        ready = int(np.searchsorted(self._due, self._clock() - self._start, side="right"))
        return min(ready, CHUNK_READINGS)

    def _end_event(self, timeout: float) -> FeedEvent | None:
        if not self._has_ended:
            self._has_ended = True
            words = f"{self.name} has been played to its end{self._assumption}"
            return FeedEvent("ended", self._clock() - self._start, words)
        self._sleep(timeout)
        return None


class NoSensor:
    """A feed that ends at once, to show a saved session.

    >>> NoSensor("session.csv").next(0.1).words
    'session.csv is shown without a sensor: start again with its source to go on with it'
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def next(self, _timeout: float) -> FeedEvent:
        """As `Feed.next`."""
        words = f"{self.name} is shown without a sensor: start again with its source to go on with it"
        return FeedEvent("ended", 0.0, words)

    def close(self) -> None:
        """As `Feed.close`."""


Result = TypeVar("Result")

CALL_S: Final = 0.05  # Timeout of one call of `next`
PAUSE_S: Final = 0.045
"""Pause in s between calls that return few readings, so that readings in the pause are taken together.

It is a little shorter than 50 ms, for 20 updates of a page per second.
"""
MAX_PAUSED_READINGS: Final = 40
"""Largest number of readings in a call before a pause. After more, the next call follows at once: buffers may fill."""
MAX_QUEUED_READINGS: Final = 250_000
"""Largest number of readings in the queue; a fast playback then waits for the server."""
QUEUE_WAIT_S: Final = 0.01
STOPPING_S: Final = 10.0  # Longest wait for a feed to close; longer than any wait for a host


class FeedThread(threading.Thread):
    """Thread that reads a feed until the feed ends or is stopped; between calls of `next` it runs jobs.

    Parameters
    ----------
    feed : Feed

    Attributes
    ----------
    tell : callable
        Called on this thread when there is something in the queue.

    Examples
    --------
    >>> from flinders import simulate
    >>> thread = FeedThread(Replay(simulate.tumble(seed=1, n=100).samples, speed=None))
    >>> thread.start()
    >>> thread.join()
    >>> [type(received).__name__ for received in thread.take()]
    ['FeedEvent', 'Samples', 'FeedEvent']
    """

    def __init__(self, feed: Feed) -> None:
        super().__init__(name="feed", daemon=True)
        self.tell: Callable[[], object] = lambda: None
        self._feed = feed
        self._queue: deque[Samples | FeedEvent] = deque()
        self._jobs: deque[Callable[[], None]] = deque()
        self._stopping = threading.Event()
        self._is_over = False
        self._put = self._got = 0

    def run(self) -> None:
        """Read the feed; a permanent error is queued as an event ``gone`` with its reason."""
        try:
            while not self._stopping.is_set() and not self._is_over:
                self._do_jobs()
                if self._put - self._got >= MAX_QUEUED_READINGS:
                    self._stopping.wait(QUEUE_WAIT_S)
                else:
                    self._ask()
        except Exception as error:  # noqa: BLE001 - a thread that ends without a word would look like a silent sensor
            internal = f"internal error: {type(error).__name__}: {error}; please report it"
            words = error.message if isinstance(error, FlindersError) else internal
            self._queue.append(FeedEvent("gone", 0.0, words))
        finally:
            self._is_over = True
            self._do_jobs()
            with contextlib.suppress(FlindersError):
                self._feed.close()

    def take(self) -> list[Samples | FeedEvent]:
        """Readings and events since the last call, in order."""
        received = []
        while self._queue:
            received.append(self._queue.popleft())
            self._got += _size(received[-1])
        return received

    def do(self, job: Callable[[], Result]) -> Future[Result]:
        """Run a job on this thread soon; if the thread has ended, run it at once."""
        future: Future[Result] = Future()

        def done() -> None:
            try:
                future.set_result(job())
            except BaseException as error:  # noqa: BLE001 - belongs to whoever waits for the result
                future.set_exception(error)

        self._jobs.append(done)
        if self._is_over:
            self._do_jobs()
        return future

    def stop(self) -> None:
        """Stop reading, and wait until the feed has written everything."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOPPING_S)

    def _ask(self) -> None:
        received = self._feed.next(CALL_S)
        if received is None:
            return
        self._put += _size(received)
        self._queue.append(received)
        self.tell()
        if isinstance(received, FeedEvent):
            self._is_over = received.kind == "ended"
        elif len(received) < MAX_PAUSED_READINGS:
            self._stopping.wait(PAUSE_S)

    def _do_jobs(self) -> None:
        while True:
            try:
                job = self._jobs.popleft()
            except IndexError:
                return
            job()


def _size(received: Samples | FeedEvent) -> int:
    return 1 if isinstance(received, FeedEvent) else len(received)


def feed_kind(name: str) -> Callable[..., Feed]:
    """Function ``open_feed`` that opens a feed for a kind of source without lines.

    The arguments for ``mavlink`` are a `ByteSource` and the number of a magnetometer, those for ``ros2`` are names of
    topics and a unit. Raises `UsageError` if no package of `flinders.apps` reads the kind.
    """
    open_feed: Callable[..., Feed] = _open_function("FEEDS", name, "open_feed")
    return open_feed


def publisher_kind(name: str) -> Callable[..., Any]:
    """Function ``open_publisher`` that opens a publisher for a kind of feed, from the feed and a topic.

    Raises `UsageError` if no package of `flinders.apps` publishes the kind.
    """
    return _open_function("PUBLISHERS", name, "open_publisher")


def _open_function(table: str, name: str, function: str) -> Callable[..., Any]:
    """Function of this name, in the module that a table of `flinders.apps` has for a kind."""
    module = app_modules(table).get(name)
    if module is None:
        raise UsageError(f"this installation has no {name}: install flinders again")
    opener: Callable[..., Any] = getattr(import_module(module), function)
    return opener
