"""The acquisition thread: asks a feed and queues its answers, whatever the server is doing meanwhile.

>>> from flinders import simulate
>>> from flinders.live.feeds import Replay
>>> thread = FeedThread(Replay(simulate.tumble(seed=1, n=100).samples, speed=None))
>>> thread.start()
>>> thread.join()
>>> [type(received).__name__ for received in thread.taken()]
['FeedEvent', 'list', 'FeedEvent']

Work for the feed's thread, such as a line in its recording or a packet to its board, is handed over as a job and done
between two questions.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from concurrent.futures import Future
from typing import TYPE_CHECKING, Final, TypeVar

from flinders.errors import FlindersError
from flinders.live.readings import FeedEvent

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.live.feeds import Feed
    from flinders.live.readings import Reading

Result = TypeVar("Result")

ASK_S: Final = 0.05
"""Longest wait of one question."""
REST_S: Final = 0.045
"""From an answer to the next question, where little came: what comes meanwhile is then read in one go. A little below a
twentieth of a second, so that pages get twenty updates in each."""
LITTLE: Final = 40
"""Readings of an answer; a faster sensor is asked again at once, before what the system keeps for it is full."""
FULL: Final = 250_000
"""Readings that wait to be taken, at most: a recording played back as fast as possible waits for the server then."""
FULL_S: Final = 0.01
STOPPING_S: Final = 10.0
"""Seconds that a feed has to let go: longer than any of them waits for a host."""


class FeedThread(threading.Thread):
    """Asks a feed until it has ended, or is told to stop.

    Parameters
    ----------
    feed : Feed

    Attributes
    ----------
    tell : callable
        Called on the feed's thread when something is in the queue.
    """

    def __init__(self, feed: Feed) -> None:
        super().__init__(name="feed", daemon=True)
        self.tell: Callable[[], object] = lambda: None
        self._feed = feed
        self._queue: deque[list[Reading] | FeedEvent] = deque()
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
        except FlindersError as error:
            self._queue.append(FeedEvent("gone", 0.0, str(error)))
        except Exception as error:  # noqa: BLE001 - a thread that ends without a word would look like a silent sensor
            self._queue.append(
                FeedEvent("gone", 0.0, f"internal error: {type(error).__name__}: {error}; please report it")
            )
        finally:
            self._is_over = True
            self._do_jobs()
            with contextlib.suppress(FlindersError):
                self._feed.close()

    def taken(self) -> list[list[Reading] | FeedEvent]:
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
        if received:
            self._put += _size(received)
            self._queue.append(received)
            self.tell()
        if isinstance(received, FeedEvent):
            self._is_over = received.kind == "ended"
        elif 0 < len(received or ()) < LITTLE:
            self._stopping.wait(REST_S)

    def _do_jobs(self) -> None:
        while True:
            try:
                job = self._jobs.popleft()
            except IndexError:
                return
            job()


def _size(received: list[Reading] | FeedEvent) -> int:
    return 1 if isinstance(received, FeedEvent) else len(received)
