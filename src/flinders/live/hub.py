"""The hub of the live page: the session, what goes into it, and the pages that look at it.

A thread asks the sensor (`FeedThread`), and some twenty times a second the hub takes what came into the session
(`session.step`). Fits run in another thread. Pages are woken when there is something new; each takes the newest state
when its connection is free, so that a slow page gets fewer and larger frames, and delays nobody.

What only a fit or an answer needs is imported there: meanwhile the page is on its way to the browser.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import signal
import time
from collections import deque
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.units import Unit
from flinders.errors import FlindersError, fault_words
from flinders.live.buffer import rows_of
from flinders.live.feeds import FeedEvent, FeedThread
from flinders.live.messages import Hello, Limits, Notice, TargetInfo
from flinders.live.page_state import Cursor, session_state
from flinders.live.session import (
    Arrived,
    Evaluated,
    Event,
    FitDone,
    Linked,
    LiveSession,
    Ticked,
    Unrecorded,
    begin_fit,
    step,
    wants_fit,
)
from flinders.live.session_file import Edits
from flinders.report.view import tiles_view

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.samples import Samples
    from flinders.live.evaluation import Finished
    from flinders.live.messages import Link
    from flinders.live.session_file import Supply
    from flinders.report.view import View

SOONEST_S: Final = 0.04
LATEST_S: Final = 0.1
"""From one look at what came to the next, and so from one frame to the next: as soon as something has come."""
MOST_NOTICES: Final = 50  # Notices that wait for a page, at most; older ones go
UPLOAD_BYTES: Final = 64 << 20
LINKS: Final[dict[str, Link]] = {
    "connected": "connected", "back": "connected", "silent": "waiting", "nothing": "waiting", "unclear": "waiting",
    "gone": "gone", "ended": "ended",
}  # fmt: skip
"""What an event of a feed makes of the link; others leave it as it is."""


@dataclass(slots=True, eq=False)
class Page:
    """One connection: what it has got, and what waits for it."""

    wake: asyncio.Event = field(default_factory=asyncio.Event)
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=MOST_NOTICES))
    cursor: Cursor = field(default_factory=Cursor)
    state_revision: int = -1
    view: View | None = None
    stated_at: float = -1.0
    is_urgent: bool = False


class Hub:
    """The session, what goes into it, and the pages that look at it; `failure` is what has ended it."""

    def __init__(self, session: LiveSession, supply: Supply, clock: Callable[[], float] = time.monotonic) -> None:
        self.session, self.supply, self.pages = session, supply, set[Page]()
        self.failure: Exception | None = None
        self.name = secrets.token_hex(4)
        self._clock, self._start = clock, clock()
        self._feed_thread = FeedThread(supply.feed)
        self._edits = supply.edits
        self._fits: set[asyncio.Task[None]] = set()
        self._final: Finished | None = None
        self._finishing = asyncio.Lock()
        self._came = asyncio.Event()

    @property
    def now(self) -> float:
        """Seconds since the server began."""
        return self._clock() - self._start

    async def run(self) -> None:
        """Take in, fit and tell, until cancelled."""
        loop = asyncio.get_running_loop()
        self._feed_thread.tell = lambda: loop.call_soon_threadsafe(self._came.set)
        self._feed_thread.start()
        try:
            while True:
                self._came.clear()
                self._take()
                self._fit_if_due()
                self._wake_pages()
                await self._something()
        except Exception as error:  # noqa: BLE001 - a fault of ours ends the program, which reports it
            self.failure = error
            signal.raise_signal(signal.SIGTERM)

    async def stop(self) -> None:
        """Let go of the feed, once what it holds is written."""
        await asyncio.to_thread(self._feed_thread.stop)

    def take(self, event: Event) -> None:
        """Take one event into the session, and tell all pages what follows from it."""
        before = self.session
        self.session, notices = step(self.session, event)
        for notice in notices:
            self._tell(notice)
        if isinstance(event, Arrived | Ticked):
            return
        if self.session is not before:
            for page in self.pages:
                page.is_urgent = True
        self._record_edits()

    def hello(self) -> Hello:
        """The first message to a page."""
        from flinders.targets import registry

        return Hello(
            version=version("flinders"),
            session=self.name,
            tiles=tiles_view(),
            targets=tuple(TargetInfo(row.name, row.use, row.suffix) for row in registry().values()),
            limits=Limits(UPLOAD_BYTES),
            state=session_state(self.session),
            view=self.session.view,
        )

    async def final(self) -> Finished:
        """The calibration of all readings, made once for each state of the session.

        From the file; where that has a hole, from what is in memory.
        """
        from flinders.live.evaluation import finished

        async with self._finishing:
            session = self.session
            path = None if session.unrecorded else self.supply.path
            final = self._final
            if final is None or final.key != session.shown.key:
                final = await asyncio.to_thread(finished, session, path, self.supply.reading)
                self._final = final
        return final

    async def on_feed(self, job: Callable[[], Any]) -> Any:  # noqa: ANN401 - whatever the job gives
        """Do something on the thread of the feed."""
        return await asyncio.wrap_future(self._feed_thread.do(job))

    async def _something(self) -> None:
        """Wait until something has come, or for so long that time itself may have something to say."""
        await asyncio.sleep(SOONEST_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LATEST_S - SOONEST_S):
                await self._came.wait()

    def _take(self) -> None:
        """Take what the sensor gave: readings that came together as one event."""
        batches: list[Samples] = []
        for received in self._feed_thread.taken():
            if isinstance(received, FeedEvent):
                self._arrive(batches)
                batches = []
                self._note(received)
            else:
                batches.append(received)
        self._arrive(batches)
        self.take(Ticked(self.now))
        if (why := self.supply.sink.why) != self.session.unrecorded:
            self.take(Unrecorded(self.now, why))

    def _arrive(self, batches: list[Samples]) -> None:
        if not batches:
            return
        rows = np.concatenate([rows_of(batch, self.supply.axes) for batch in batches])
        self.take(Arrived(self.now, rows, Unit.of(batches[-1].unit.inside)))

    def _note(self, event: FeedEvent) -> None:
        """Say what happened to the sensor."""
        link = LINKS.get(event.kind)
        if link is not None:
            self.take(Linked(self.now, link, "" if event.kind == "silent" else event.words))
        elif event.kind == "settled":
            self._tell(Notice("info", f"understood as {event.words}"))
        else:
            self._tell(Notice("warning", event.words))

    def _record_edits(self) -> None:
        """Write down what a person did, between the readings."""
        edits = Edits.of(self.session)
        if edits != self._edits:
            self._edits = edits
            self._feed_thread.do(lambda: self.supply.sink.write(edits.line()))

    def _fit_if_due(self) -> None:
        """Begin a fit in a thread of its own, where one is due."""
        if not wants_fit(self.session, self.now):
            return
        self.session = begin_fit(self.session)
        task = asyncio.get_running_loop().create_task(self._fit(self.session))
        self._fits.add(task)
        task.add_done_callback(self._fits.discard)

    async def _fit(self, session: LiveSession) -> None:
        evaluated, seconds = await asyncio.to_thread(_timed, session)
        self.take(FitDone(self.now, evaluated, seconds))

    def _tell(self, notice: Notice) -> None:
        for page in self.pages:
            page.notices.append(notice)

    def _wake_pages(self) -> None:
        for page in self.pages:
            page.wake.set()


def _timed(session: LiveSession) -> tuple[Evaluated, float]:
    """Fit what a session holds, and say how long the processor took: how busy the machine is otherwise is no matter."""
    from flinders.live.evaluation import evaluate

    begun = time.thread_time()
    try:
        evaluated = evaluate(session)
    except FlindersError as error:
        evaluated = Evaluated(session.shown.key, refusal=error.message)
    except Exception as error:  # noqa: BLE001 - a recording that provokes a fault of ours must not end the page
        evaluated = Evaluated(session.shown.key, refusal=fault_words(error))
    return evaluated, time.thread_time() - begun
