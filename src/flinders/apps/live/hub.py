"""Hub of the live page: readings of a source, the user's edits, and the connected pages.

A thread reads the sensor (`FeedThread`), and about twenty times a second the hub collects its readings and wakes the
pages. A page receives new readings when its connection is free, so a slow page gets fewer and larger frames, and delays
no other page. Each page fits the readings by itself; the final calibration is made here.

Modules that only some answers need are imported when they are needed, so that the page loads sooner.
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

    from flinders.apps.live.finished import CalibrationRequest, FinishedCalibration, FinishInputs
    from flinders.apps.live.messages import Link
    from flinders.apps.live.session_file import Log, Supply
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

MIN_PERIOD_S: Final = 0.04
MAX_PERIOD_S: Final = 0.1
"""Longest time between two collections of readings, s, while no readings arrive; `MIN_PERIOD_S` while they do."""
MAX_NOTICES: Final = 50  # Most queued notices per page; then the oldest is dropped
UPLOAD_BYTES: Final = 64 << 20
MAX_LOGS: Final = 4  # Most logs in memory that were dropped on pages
MAX_FINISHED: Final = 4  # Most final calibrations in memory
FRAME_ROWS: Final = 20_000  # Most readings in one frame
LINKS: Final[dict[str, Link]] = {
    "connected": "connected", "back": "connected", "silent": "waiting", "nothing": "waiting", "unclear": "waiting",
    "gone": "gone", "ended": "ended",
}  # fmt: skip
"""State of the link after an event of a feed; other events do not change it."""


@dataclass(slots=True, eq=False)
class Page:
    """Connection to a page: readings sent, and messages queued."""

    wake: asyncio.Event = field(default_factory=asyncio.Event)
    news: dict[type, FromServer] = field(default_factory=dict)
    notices: deque[Notice] = field(default_factory=lambda: deque(maxlen=MAX_NOTICES))
    heard: int = 0  # messages received from the page
    generation: int = 0  # generation of the readings sent to it, see `readings_frame`
    stride: int = 1  # stride of the readings sent to it
    count: int = 0  # rows of the buffer sent to it
    total: int = 0  # readings received when the newest row was sent

    def queue_message(self, message: FromServer) -> None:
        """Queue a message; except for notices, it replaces an earlier message of its kind."""
        if isinstance(message, Notice):
            self.notices.append(message)
        else:
            self.news.pop(type(message), None)
            self.news[type(message)] = message
        self.wake.set()

    def next_message(self) -> FromServer | None:
        """Remove and return the oldest queued message; None without one."""
        if self.news:
            return self.news.pop(next(iter(self.news)))
        return self.notices.popleft() if self.notices else None


MISSING_PREVIOUS: Final = (
    "this session renewed an earlier calibration, which is missing: choose its file under Finish, Compare, or give "
    "it when you resume the session. Until then, the calibration is made without it"
)
"""Notice for a session that is resumed without the calibration that it renewed."""


def _with_number(previous: Previous) -> Previous:
    """Give an earlier calibration an identifying number; without an earlier calibration nothing changes."""
    number = secrets.token_hex(8) if previous.text else ""
    return msgspec.structs.replace(previous, number=number)


class Hub:
    """Readings, the user's edits, and connected pages; `failure` is the exception that ended the hub."""

    def __init__(self, supply: Supply, previous: Previous | None = None, renewed: Fit | None = None) -> None:
        self.supply, self.pages = supply, set[Page]()
        self.source = SourceState(supply.feed.name, supply.kind, "waiting", "")
        self.previous, self.renewed = _with_number(previous or Previous()), renewed
        self.warning = MISSING_PREVIOUS if supply.edits.refreshing and renewed is None else ""
        self.edits = self._without_missing_previous(supply.edits)
        self.log, self.timeline = supply.log, supply.timeline
        self.generation = 1
        self.unrecorded = ""
        self.chip_notice = ChipNotice()
        self.logs: dict[str, tuple[str, Log]] = {}
        self.finished: dict[str, FinishedCalibration] = {}
        self.failure: Exception | None = None
        self.on_take: Callable[[], object] = lambda: None  # called after each collection of readings
        self.name = secrets.token_hex(4)
        self._feed_thread = FeedThread(supply.feed)
        self._finishing = asyncio.Lock()
        self._recorded: Edits | None = None
        self._came = asyncio.Event()

    async def run(self) -> None:
        """Collect readings and inform pages, until cancelled."""
        loop = asyncio.get_running_loop()
        self._feed_thread.tell = lambda: loop.call_soon_threadsafe(self._came.set)
        self._feed_thread.start()
        try:
            while True:
                self._came.clear()
                self._take()
                self.on_take()
                await self._wait_for_feed()
        except Exception as error:  # noqa: BLE001 - an internal error ends the program, which reports it
            self.failure = error
            signal.raise_signal(signal.SIGTERM)

    async def stop(self) -> None:
        """Close the feed once its readings are written, and collect the last of them."""
        await asyncio.to_thread(self._feed_thread.stop)
        if self.failure is None:
            self._take()

    def add_page(self, page: Page) -> None:
        """Add a page, and queue its first messages."""
        self.pages.add(page)
        if self.warning:
            page.queue_message(Notice("warning", self.warning))

    def welcome(self) -> Welcome:
        """Return the first message to a page."""
        from flinders.targets import registry
        from flinders.targets._target import MOUNTING_KINDS

        written = [row for row in registry().values() if row.keeps not in MOUNTING_KINDS]
        rows = sorted(written, key=lambda row: row.name != self.supply.target)
        return Welcome(
            version=version("flinders"),
            session=self.name,
            targets=tuple(TargetInfo(row.name, row.use, row.suffix, row.group) for row in rows),
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
        """Return the readings that a page lacks, as a frame; None without new ones.

        If the stride has doubled, the page drops every second reading, by the frame's stride.
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
        """Store the edits of a page, write them to the file, and pass them on to the pages.

        Discarded readings stay discarded.

        Raises `UsageError` if the edits discard future readings.
        """
        if edits.begun_s != self.edits.begun_s:
            edits = msgspec.structs.replace(edits, begun_s=self._restart_after(edits.begun_s))
        self.edits = self._without_missing_previous(edits)
        self._record_edits()
        for page in self.pages:
            page.queue_message(Kept(self.edits, page.heard))

    def _without_missing_previous(self, edits: Edits) -> Edits:
        """Edits; without an earlier calibration, their request to renew one is removed."""
        return edits if self.renewed else msgspec.structs.replace(edits, refreshing=False)

    def _restart_after(self, begun_s: float | None) -> float:
        """Discard the readings up to a time, send the others to the pages again, and return the time that was used.

        In a session with thinned readings, all readings so far are discarded, since too few would remain.
        """
        if begun_s is not None and begun_s > self.timeline.at:
            raise UsageError(f"restart at {begun_s:g} s: need a time up to that of the newest reading")
        self.generation += 1
        latest = max(time for time in (begun_s, self.edits.begun_s) if time is not None)
        latest = self.timeline.at if self.log.buffer.stride > 1 else latest
        self.log = self.log._replace(buffer=self.log.buffer.after(latest))
        return latest

    def _record_edits(self) -> None:
        """Write the edits to the file, between the readings, once there are readings."""
        edits = self.edits
        if edits != self._recorded and self.timeline.at > -np.inf:
            self._recorded = edits
            self._feed_thread.do(lambda: self.supply.sink.write(line_of(edits)))

    def compare_with(self, previous: Previous) -> None:
        """Store an earlier calibration, to be renewed on request, and pass it on to the pages."""
        from flinders.core.calibration_file import loads

        renewed = None
        if previous != Previous():
            document = loads(previous.text.encode(), source=previous.name)
            renewed = fit_from(document, name=previous.name)
        self.previous, self.renewed, self.warning = _with_number(previous), renewed, ""
        self._send_to_pages(self.previous)
        self.edit(msgspec.structs.replace(self.edits, refreshing=False))

    def keep(self, name: str, log: Log) -> str:
        """Store a log that was dropped on a page, and return its number; of too many logs, the oldest is removed."""
        number = secrets.token_hex(8)
        self.logs[number] = name, log
        while len(self.logs) > MAX_LOGS:
            del self.logs[next(iter(self.logs))]
        return number

    def finish_now(self) -> FinishedCalibration:
        """Return the calibration of the sensor's readings with the user's edits."""
        from flinders.apps.live.finished import finish_calibration

        return finish_calibration("", self._finish_inputs(self.edits, None))

    async def finish(self, request: CalibrationRequest) -> FinishedCalibration:
        """Make the final calibration of the sensor or of a log, and store it for exports.

        Requests run one at a time. A request with fixed readings is computed once for all pages, also after a reload.
        Raises `UsageError` for a log that is no longer in memory, or if the calibration to renew has another number
        than in the request.
        """
        from flinders.apps.live.finished import finish_calibration

        if request.edits.refreshing and self.renewed is not None and request.previous != self.previous.number:
            raise UsageError(
                f"another page chose {self.previous.name} meanwhile: check that page, and press Finish again"
            )
        async with self._finishing:
            made = next((each for each in self.finished.values() if each.request == request), None)
            if made is None:
                wanted = self._finish_inputs(request.edits, request.log)
                made = await asyncio.to_thread(finish_calibration, secrets.token_hex(8), wanted)
                made = replace(made, request=request if request.is_fixed else None)
        self.finished.pop(made.number, None)
        self.finished[made.number] = made
        while len(self.finished) > MAX_FINISHED:
            del self.finished[next(iter(self.finished))]
        return made

    def _finish_inputs(self, edits: Edits, number: str | None) -> FinishInputs:
        from flinders.apps.live.finished import FinishInputs

        if number is None:
            path = None if self.unrecorded else self.supply.path
            return FinishInputs(self.source.name, edits, self.log, path, self.supply.reading, self.renewed)
        if number not in self.logs:
            raise UsageError("that log is no longer in memory: drop it again")
        name, log = self.logs[number]
        return FinishInputs(name, edits, log, None, {}, self.renewed, is_of_sensor=False)

    async def on_feed(self, job: Callable[[], Any]) -> Any:  # noqa: ANN401 - result of the job
        """Run a job on the thread of the feed."""
        return await asyncio.wrap_future(self._feed_thread.do(job))

    async def _wait_for_feed(self) -> None:
        """Wait for readings or events, at most `MAX_PERIOD_S`."""
        await asyncio.sleep(MIN_PERIOD_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(MAX_PERIOD_S - MIN_PERIOD_S):
                await self._came.wait()

    def _take(self) -> None:
        """Collect readings and events of the feed; readings that arrived together form one batch."""
        batches: list[Samples] = []
        for received in self._feed_thread.take():
            if isinstance(received, FeedEvent):
                self._arrive(batches)
                batches = []
                self._note(received)
            else:
                batches.append(received)
        self._arrive(batches)
        if (why := self.supply.sink.why) != self.unrecorded:
            self.unrecorded = why
            self._send_to_pages(Unrecorded(why))

    def _arrive(self, batches: list[Samples]) -> None:
        if not batches:
            return
        rows = np.concatenate([rows_of(batch, self.supply.axes) for batch in batches])
        rows[:, 0], self.timeline = self.timeline(rows[:, 0])
        self.log = self.log._replace(
            buffer=self.log.buffer.with_rows(rows), unit=Unit.of(batches[-1].unit.inside), frame=batches[-1].frame
        )
        self._record_edits()
        if words := self.chip_notice.words(self.log):
            self._send_to_pages(Notice("info", words))
        if self.source.link != "connected":
            self._link("connected", "")
        for page in self.pages:
            page.wake.set()

    def _note(self, event: FeedEvent) -> None:
        """Inform pages of an event of the sensor."""
        link = LINKS.get(event.kind)
        if link is not None:
            words = "" if event.kind == "silent" else event.words
            if self._link(link, words) and words and link != "ended":
                self._send_to_pages(Notice("warning" if link == "gone" else "info", words))
        elif event.kind == "settled":
            self._send_to_pages(Notice("info", f"understood as {event.words}"))
        else:
            self._send_to_pages(Notice("warning", event.words))

    def _link(self, link: Link, words: str) -> bool:
        """Set the state of the link and inform pages; returns whether it changed."""
        source = msgspec.structs.replace(self.source, link=link, words=words)
        if source == self.source:
            return False
        self.source = source
        self._send_to_pages(Linked(source))
        return True

    def _send_to_pages(self, message: FromServer) -> None:
        for page in self.pages:
            page.queue_message(message)
