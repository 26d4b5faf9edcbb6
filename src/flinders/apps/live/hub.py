"""The hub of the live page: readings of a source, what a person did to them, and the pages that look at both.

A thread asks the sensor (`FeedThread`), and some twenty times a second the hub takes what came. Pages are woken when
there is something new; each takes it when its connection is free, so that a slow page gets fewer and larger frames, and
delays nobody. What the readings come to, each page finds out by itself; the calibration in the end is made here.

What only an answer needs is imported there: meanwhile the page is on its way to the browser.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import signal
from collections import deque
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from flinders.apps.live.buffer import rows_of
from flinders.apps.live.chip_notice import ChipNotice
from flinders.apps.live.messages import (
    Edits,
    FromServer,
    Kept,
    Limits,
    Linked,
    Notice,
    Previous,
    SourceState,
    TargetInfo,
    Unrecorded,
    Welcome,
    readings_frame,
)
from flinders.apps.live.session_file import line_of
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import UsageError
from flinders.fitting.fit_file import fit_from
from flinders.links.feeds import FeedEvent, FeedThread

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.apps.live.finished import CalibrationRequest, Finished, Wanted
    from flinders.apps.live.messages import Link
    from flinders.apps.live.session_file import Log, Supply
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

SOONEST_S: Final = 0.04
LATEST_S: Final = 0.1
"""From one look at what came to the next, and so from one frame to the next: as soon as something has come."""
MOST_NOTICES: Final = 50  # Notices that wait for one page; beyond that the oldest is dropped
UPLOAD_BYTES: Final = 64 << 20
MAX_LOGS: Final = 4  # That were dropped on pages, in memory
MAX_FINISHED: Final = 4  # Calibrations that may still be asked for
FRAME_ROWS: Final = 20_000  # Readings in one frame, at most
LINKS: Final[dict[str, Link]] = {
    "connected": "connected", "back": "connected", "silent": "waiting", "nothing": "waiting", "unclear": "waiting",
    "gone": "gone", "ended": "ended",
}  # fmt: skip
"""What an event of a feed makes of the link; others leave it as it is."""


@dataclass(slots=True, eq=False)
class Page:
    """One connection: what it has got, and what waits for it."""

    wake: asyncio.Event = field(default_factory=asyncio.Event)
    news: dict[type, FromServer] = field(default_factory=dict)
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=MOST_NOTICES))
    heard: int = 0  # messages that came from it
    generation: int = 0
    stride: int = 1
    count: int = 0  # rows of the buffer that it has
    total: int = 0  # readings that had come when it got the newest

    def tell(self, message: FromServer) -> None:
        """Let a message wait for it; of all but notices the newest of a kind is enough, and goes last."""
        if isinstance(message, Notice):
            self.notices.append(message)
        else:
            self.news.pop(type(message), None)
            self.news[type(message)] = message
        self.wake.set()

    def next_message(self) -> FromServer | None:
        """Take the message that has waited longest; None where none waits."""
        if self.news:
            return self.news.pop(next(iter(self.news)))
        return self.notices.popleft() if self.notices else None


UNRENEWED: Final = (
    "this session renewed an earlier calibration, which is not here: choose its file under Finish, Compare, or name it "
    "when you resume the session; meanwhile a calibration is made afresh"
)
"""Of a session that is resumed without the calibration that it renewed."""


def _numbered(previous: Previous) -> Previous:
    """A calibration from before with a number that tells it from others; none has none."""
    number = secrets.token_hex(8) if previous.text else ""
    return msgspec.structs.replace(previous, number=number)


class Hub:
    """What came, what was done to it, and the pages that look at it; `failure` is what has ended it."""

    def __init__(self, supply: Supply, previous: Previous | None = None, renewed: Fit | None = None) -> None:
        self.supply, self.pages = supply, set[Page]()
        self.source = SourceState(supply.feed.name, supply.kind, "waiting", "")
        self.previous, self.renewed = _numbered(previous or Previous()), renewed
        self.warning = UNRENEWED if supply.edits.refreshing and renewed is None else ""
        self.edits = self._renewing_what_is_there(supply.edits)
        self.log, self.timeline = supply.log, supply.timeline
        self.generation = 1
        self.unrecorded = ""
        self.chip_notice = ChipNotice()
        self.logs: dict[str, tuple[str, Log]] = {}
        self.finished: dict[str, Finished] = {}
        self.failure: Exception | None = None
        self.on_take: Callable[[], object] = lambda: None  # called after each look at what came
        self.name = secrets.token_hex(4)
        self._feed_thread = FeedThread(supply.feed)
        self._finishing = asyncio.Lock()
        self._recorded: Edits | None = None
        self._came = asyncio.Event()

    async def run(self) -> None:
        """Take in and tell, until cancelled."""
        loop = asyncio.get_running_loop()
        self._feed_thread.tell = lambda: loop.call_soon_threadsafe(self._came.set)
        self._feed_thread.start()
        try:
            while True:
                self._came.clear()
                self._take()
                self.on_take()
                await self._something()
        except Exception as error:  # noqa: BLE001 - a fault of ours ends the program, which reports it
            self.failure = error
            signal.raise_signal(signal.SIGTERM)

    async def stop(self) -> None:
        """Let go of the feed, once what it holds is written, and take the last of it."""
        await asyncio.to_thread(self._feed_thread.stop)
        if self.failure is None:
            self._take()

    def welcomed(self, page: Page) -> None:
        """Take a page in, with what it should know."""
        self.pages.add(page)
        if self.warning:
            page.tell(Notice("warning", self.warning))

    def welcome(self) -> Welcome:
        """The first message to a page."""
        from flinders.targets import registry
        from flinders.targets._target import MOUNTINGS

        written = [row for row in registry().values() if row.keeps not in MOUNTINGS]
        rows = sorted(written, key=lambda row: row.name != self.supply.target)
        return Welcome(
            version=version("flinders"),
            session=self.name,
            targets=tuple(TargetInfo(row.name, row.use, row.suffix) for row in rows),
            limits=Limits(UPLOAD_BYTES),
            source=self.source,
            axes=str(self.supply.axes),
            recording=str(self.supply.path),
            unrecorded=self.unrecorded,
            has_board=self.supply.board is not None,
            edits=self.edits,
            previous=self.previous,
        )

    def frame(self, page: Page) -> bytes | None:
        """The readings that a page does not have yet, as a frame; None where there is nothing new.

        A page with every second reading too many keeps every second one, as the frame's stride says.
        """
        buffer = self.log.buffer
        if page.generation != self.generation:
            page.generation, page.stride, page.count, page.total = self.generation, buffer.stride, 0, -1
        if page.total == buffer.total:
            return None
        page.count = -(-page.count // (buffer.stride // page.stride))
        first, rows = page.count, buffer.rows(page.count, FRAME_ROWS)
        page.stride, page.count = buffer.stride, page.count + len(rows)
        is_all = page.count == len(buffer)
        page.total = buffer.total if is_all else page.count * buffer.stride
        return readings_frame(
            generation=self.generation,
            first=first,
            stride=buffer.stride,
            total=page.total,
            is_last=is_all,
            rows=rows,
            latest=buffer.latest if is_all else rows[-1],
            is_microtesla=self.log.unit.inside == MICROTESLA,
            is_vehicle=self.log.advice_frame == "vehicle",
        )

    def edit(self, edits: Edits) -> None:
        """Keep what a person did on a page, write it down, and pass it on; what was left behind stays so.

        Raises `UsageError` where readings that have not come yet would be left behind.
        """
        if edits.begun_s != self.edits.begun_s:
            edits = msgspec.structs.replace(edits, begun_s=self._begun_anew(edits.begun_s))
        self.edits = self._renewing_what_is_there(edits)
        self._record_edits()
        for page in self.pages:
            page.tell(Kept(self.edits, page.heard))

    def _renewing_what_is_there(self, edits: Edits) -> Edits:
        """Take the wish to renew out of edits where there is no earlier calibration, as once a page took it away."""
        return edits if self.renewed else msgspec.structs.replace(edits, refreshing=False)

    def _begun_anew(self, begun_s: float | None) -> float:
        """Leave the readings up to a time behind, return that of the last of them, and send the others once more.

        Of a session so long that only some are in memory, all readings so far: those left would count as too few.
        """
        if begun_s is not None and begun_s > self.timeline.at:
            raise UsageError(f"begun anew at {begun_s:g} s: need a time up to that of the newest reading")
        self.generation += 1
        latest = max(time for time in (begun_s, self.edits.begun_s) if time is not None)
        latest = self.timeline.at if self.log.buffer.stride > 1 else latest
        self.log = self.log._replace(buffer=self.log.buffer.after(latest))
        return latest

    def _record_edits(self) -> None:
        """Write down what a person did, between the readings, once there are any."""
        edits = self.edits
        if edits != self._recorded and self.timeline.at > -np.inf:
            self._recorded = edits
            self._feed_thread.do(lambda: self.supply.sink.write(line_of(edits)))

    def compare_with(self, previous: Previous) -> None:
        """Keep a calibration from before, which is renewed once that is asked for, and pass it on to the pages."""
        from flinders.core.calibration_file import loads

        renewed = None
        if previous != Previous():
            document = loads(previous.text.encode(), source=previous.name)
            renewed = fit_from(document, name=previous.name)
        self.previous, self.renewed, self.warning = _numbered(previous), renewed, ""
        self._tell(self.previous)
        self.edit(msgspec.structs.replace(self.edits, refreshing=False))

    def keep(self, name: str, log: Log) -> str:
        """Hold a log that was dropped on a page, and forget the oldest of several; returns its number."""
        number = secrets.token_hex(8)
        self.logs[number] = name, log
        while len(self.logs) > MAX_LOGS:
            del self.logs[next(iter(self.logs))]
        return number

    def made(self) -> Finished:
        """The calibration of all readings of the sensor, after what was done to them."""
        from flinders.apps.live.finished import finished

        return finished("", self._wanted(self.edits, None))

    async def finish(self, request: CalibrationRequest) -> Finished:
        """Make the calibration of the sensor, or of a log, and hold it for whoever asks for exports.

        One at a time; of readings that are fixed it is made once, whichever page asks, also after it was loaded again.
        Raises `UsageError` for a log that is no longer in memory, and where the calibration to renew is no longer the
        one whose number the request has.
        """
        from flinders.apps.live.finished import finished

        if request.edits.refreshing and self.renewed is not None and request.previous != self.previous.number:
            raise UsageError(
                f"another page chose {self.previous.name} meanwhile: see what it says, and press Finish again"
            )
        async with self._finishing:
            made = next((each for each in self.finished.values() if each.request == request), None)
            if made is None:
                wanted = self._wanted(request.edits, request.log)
                made = await asyncio.to_thread(finished, secrets.token_hex(8), wanted)
                made = replace(made, request=request if request.is_fixed else None)
        self.finished.pop(made.number, None)
        self.finished[made.number] = made
        while len(self.finished) > MAX_FINISHED:
            del self.finished[next(iter(self.finished))]
        return made

    def _wanted(self, edits: Edits, number: str | None) -> Wanted:
        from flinders.apps.live.finished import Wanted

        if number is None:
            path = None if self.unrecorded else self.supply.path
            return Wanted(self.source.name, edits, self.log, path, self.supply.reading, self.renewed)
        if number not in self.logs:
            raise UsageError("that log is no longer in memory: drop it again")
        name, log = self.logs[number]
        return Wanted(name, edits, log, None, {}, self.renewed, is_of_sensor=False)

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
        """Take what the sensor gave: readings that came together as one."""
        batches: list[Samples] = []
        for received in self._feed_thread.taken():
            if isinstance(received, FeedEvent):
                self._arrive(batches)
                batches = []
                self._note(received)
            else:
                batches.append(received)
        self._arrive(batches)
        if (why := self.supply.sink.why) != self.unrecorded:
            self.unrecorded = why
            self._tell(Unrecorded(why))

    def _arrive(self, batches: list[Samples]) -> None:
        if not batches:
            return
        rows = np.concatenate([rows_of(batch, self.supply.axes) for batch in batches])
        rows[:, 0], self.timeline = self.timeline(rows[:, 0])
        self.log = self.log._replace(
            buffer=self.log.buffer.extended(rows), unit=Unit.of(batches[-1].unit.inside), frame=batches[-1].frame
        )
        self._record_edits()
        if words := self.chip_notice.words(self.log):
            self._tell(Notice("info", words))
        if self.source.link != "connected":
            self._link("connected", "")
        for page in self.pages:
            page.wake.set()

    def _note(self, event: FeedEvent) -> None:
        """Say what happened to the sensor."""
        link = LINKS.get(event.kind)
        if link is not None:
            words = "" if event.kind == "silent" else event.words
            if self._link(link, words) and words and link != "ended":
                self._tell(Notice("warning" if link == "gone" else "info", words))
        elif event.kind == "settled":
            self._tell(Notice("info", f"understood as {event.words}"))
        else:
            self._tell(Notice("warning", event.words))

    def _link(self, link: Link, words: str) -> bool:
        """Tell what the link is; returns whether it is another."""
        source = msgspec.structs.replace(self.source, link=link, words=words)
        if source == self.source:
            return False
        self.source = source
        self._tell(Linked(source))
        return True

    def _tell(self, message: FromServer) -> None:
        for page in self.pages:
            page.tell(message)
