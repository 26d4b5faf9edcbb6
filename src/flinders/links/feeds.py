"""Feeds: readings of a running sensor, and what happens to it in between; a recording is one, played back.

>>> from flinders import simulate
>>> feed = Replay(simulate.tumble(seed=1).samples, speed=None)     # as fast as it is asked
>>> feed.next(0.1).words
'simulated hand, played back as fast as possible'
>>> [len(feed.next(0.1)) for _ in range(6)], feed.next(0.1).kind
([500, 500, 500, 500, 500, 500], 'ended')
>>> print(FeedEvent("gone", 12.5, "/dev/ttyACM0 is gone: check the cable"))
12.5 s: /dev/ttyACM0 is gone: check the cable

A feed knows no thread and no event loop: one thread asks, and each question takes at most its timeout. `Replay` is one;
the recorder of lines, a vehicle and a simulated sensor are others. `FeedThread` asks, and queues the answers, whatever
the server is doing meanwhile.
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

AT_ONCE: Final = 500  # Readings handed on together at most
ASSUMED_HZ: Final = 50.0  # Readings a second of a recording without times
LONGEST_GAP_S: Final = 2.0  # Seconds that a pause of a recording takes when it is played back, at most
SHORTEST_S: Final = 1e-4  # Least wait

Kind: TypeAlias = Literal[
    "connected", "settled", "several", "unclear", "silent", "nothing", "garbage", "no-answer", "lost", "gone", "back",
    "ended",
]  # fmt: skip
"""It is there; how its lines are written is known; they are of several devices; which of their numbers are the field is
not; nothing has come yet; nothing usable has; lines that are not like the first ones; the sensor did not answer; this
machine was too busy to take all; it went away; it is there again; nothing more will come."""


@dataclass(frozen=True, slots=True)
class FeedEvent:
    """Something that happened to a source of readings."""

    kind: Kind  #: as `Kind`
    at: float  #: s: since the start
    words: str  #: for people

    def __str__(self) -> str:
        return f"{self.at:.1f} s: {self.words}"


Received: TypeAlias = Samples | FeedEvent | None
"""Readings in order, with times and in the axes of the sensor; or one event; or None where nothing came."""


class Feed(Protocol):
    """A source of readings; `name` is for messages: ``/dev/ttyACM0``, ``tumble.csv``."""

    @property
    def name(self) -> str:
        """For messages."""

    def next(self, timeout: float) -> Received:
        """Return what has come, waiting at most so many seconds for it.

        After an event ``ended`` nothing comes.

        Raises
        ------
        FlindersError
            For what cannot be waited out; a source that is gone for a while is an event.
        """

    def close(self) -> None:
        """Let go of the source; closing twice does no harm."""


class Replay:
    """Plays a recording back, in the time that it took or faster.

    Parameters
    ----------
    recording : Recording
        Anything that `flinders.open_recording` opens, or samples.
    speed : float, optional
        So many times as fast as it was recorded; None for as fast as it is asked. Pauses of more than two seconds are
        shortened to two. A recording without times is taken to have 50 readings a second.
    clock, sleep : callable
        Seconds, ascending; and wait.

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
            raise UsageError(f"speed is {speed:g}: need a number above 0, or none for as fast as possible")
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
            Where the recording cannot be read to its end.
        """
        if not self._is_announced:
            self._load()
            self._is_announced, self._start = True, self._clock()
            return FeedEvent("connected", 0.0, self._words)
        if not len(self._block) and not self._is_over:
            self._load()
        if self._is_over:
            return self._ended(timeout)
        ready = AT_ONCE if self._speed is None else self._ready(timeout)
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
        return "" if self._is_timed else f", as if it had {ASSUMED_HZ:g} readings a second: the file has no times"

    def _load(self) -> None:
        """Take the next block, and say when each of its readings is due."""
        block = next(self._blocks, None)
        if block is None or not len(block):
            self._is_over = block is None
            return
        self._is_timed = block.time is not None
        counted = (self._count + np.arange(len(block))) / ASSUMED_HZ
        times = counted if block.time is None else block.time
        self._count += len(block)
        steps = np.diff(times, prepend=self._last if np.isfinite(self._last) else times[0])
        steps = np.clip(np.nan_to_num(steps), 0.0, LONGEST_GAP_S)
        self._due = self._played + np.cumsum(steps) / (self._speed or 1.0)
        self._played, self._last = float(self._due[-1]), float(times[-1])
        self._block = replace(block, time=times)

    def _ready(self, timeout: float) -> int:
        """Count the readings that are due, after waiting for the first of them."""
        if not len(self._due):
            return 0
        wait = float(self._due[0]) - (self._clock() - self._start)
        if wait > 0:
            self._sleep(max(min(wait, timeout), SHORTEST_S))
        ready = int(np.searchsorted(self._due, self._clock() - self._start, side="right"))
        return min(ready, AT_ONCE)

    def _ended(self, timeout: float) -> FeedEvent | None:
        if not self._has_ended:
            self._has_ended = True
            words = f"{self.name} has been played to its end{self._assumption}"
            return FeedEvent("ended", self._clock() - self._start, words)
        self._sleep(timeout)
        return None


class NoSensor:
    """A feed that ends at once, for a session that is looked at again.

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

ASK_S: Final = 0.05  # Longest wait of one question
REST_S: Final = 0.045
"""From an answer to the next question, where little came: what comes meanwhile is then read in one go. A little below a
twentieth of a second, so that pages get twenty updates in each."""
LITTLE: Final = 40
"""Readings of an answer; a faster sensor is asked again at once, before what the system keeps for it is full."""
FULL: Final = 250_000
"""Readings that wait to be taken, at most: a recording played back as fast as possible waits for the server then."""
FULL_S: Final = 0.01
STOPPING_S: Final = 10.0  # Seconds that a feed has to let go: longer than any of them waits for a host


class FeedThread(threading.Thread):
    """Asks a feed until it has ended, or is told to stop; what else is to be done on its thread is a job between two.

    Parameters
    ----------
    feed : Feed

    Attributes
    ----------
    tell : callable
        Called on the feed's thread when something is in the queue.

    Examples
    --------
    >>> from flinders import simulate
    >>> thread = FeedThread(Replay(simulate.tumble(seed=1, n=100).samples, speed=None))
    >>> thread.start()
    >>> thread.join()
    >>> [type(received).__name__ for received in thread.taken()]
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
        """Ask; a feed that fails for good is one that has gone, and its reason is told."""
        try:
            while not self._stopping.is_set() and not self._is_over:
                self._do_jobs()
                if self._put - self._got >= FULL:
                    self._stopping.wait(FULL_S)
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

    def taken(self) -> list[Samples | FeedEvent]:
        """All that has come since this was last called, in order."""
        received = []
        while self._queue:
            received.append(self._queue.popleft())
            self._got += _size(received[-1])
        return received

    def do(self, job: Callable[[], Result]) -> Future[Result]:
        """Do something on the feed's thread, soon; where that has ended, at once."""
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
        """Ask no more, and wait until the feed has written what it holds."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOPPING_S)

    def _ask(self) -> None:
        received = self._feed.next(ASK_S)
        if received is None:
            return
        self._put += _size(received)
        self._queue.append(received)
        self.tell()
        if isinstance(received, FeedEvent):
            self._is_over = received.kind == "ended"
        elif len(received) < LITTLE:
            self._stopping.wait(REST_S)

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
    """Look up by its name what makes a feed of something that sends no lines: ``opened`` of its module.

    ``mavlink`` takes a `ByteSource` and the number of a magnetometer, ``ros2`` the names of topics and a unit.
    Raises `UsageError` where no package of `flinders.apps` reads that.
    """
    opened: Callable[..., Feed] = _opened("FEEDS", name)
    return opened


def publisher_kind(name: str) -> Callable[..., Any]:
    """Look up by its name what publishes beside a feed of that name: ``opened`` of its module, of the feed and a topic.

    Raises `UsageError` where no package of `flinders.apps` does.
    """
    return _opened("PUBLISHERS", name)


def _opened(table: str, name: str) -> Callable[..., Any]:
    """``opened`` of the module that a table names."""
    module = app_modules(table).get(name)
    if module is None:
        raise UsageError(f"this installation knows no {name}: install flinders anew")
    opened: Callable[..., Any] = import_module(module).opened
    return opened
