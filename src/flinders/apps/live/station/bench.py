"""The unit on the bench: from its serial number to its row in the table.

A test goes through four phases: ``ready`` for a serial number, ``confirm`` where that one was tested before,
``testing`` and ``result``; ``judging`` lies between the last two while the calibration of the recording is made. The
page of the operator asks, and shows the state; nothing is decided there. A test that has begun ends in a row: with a
result, stopped by the operator, or as interrupted when the program starts again after a power failure.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final, Literal

import msgspec
from msgspec import Struct

from flinders.apps.live.finished import Wanted
from flinders.apps.live.station.judgement import EndedTest, ShownResult, judged, stopped
from flinders.errors import OutputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.apps.live.hub import Hub
    from flinders.apps.live.messages import Edits
    from flinders.apps.live.station.folder import StationFolder, UnitTest
    from flinders.apps.live.station.plan import Plan
    from flinders.apps.live.station.recordings import Announcing, UnitSink

Phase = Literal["ready", "confirm", "testing", "judging", "result"]

NEWEST: Final = 8  # Tests that the page lists
MAX_NAME: Final = 100  # Characters of an operator's name


class StationState(Struct, frozen=True, kw_only=True):
    """What the page shows."""

    phase: Phase
    serial: str  # of the unit that is tested, or asked about
    board_serial: str  # what the board says
    asked: str  # what is to be known before a unit is tested again
    seconds: float  # since the test began
    time_s: float  # after which it is judged
    operator: str
    passed: int
    failed: int
    result: ShownResult | None
    trouble: str  # what cannot be written
    newest: tuple[ShownResult, ...]  # the newest tests, the newest first


class Station:
    """The test bench: one sensor, one unit at a time.

    Parameters
    ----------
    hub : Hub
        With the readings; its feed records into `sink`.
    sink : UnitSink
    folder : StationFolder
    plan : Plan
    operator, name : str
        Who tests, and what the station is called.
    board : Announcing, optional
        The wire, where the board says its serial number.
    clock : callable
        Seconds, ascending.
    """

    def __init__(
        self,
        hub: Hub,
        sink: UnitSink,
        folder: StationFolder,
        plan: Plan,
        *,
        operator: str = "",
        name: str = "",
        board: Announcing | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.hub, self.sink, self.folder, self.plan = hub, sink, folder, plan
        self.operator, self.name, self._board, self._clock = operator, name, board, clock
        self.phase: Phase = "ready"
        self.trouble = ""
        self._asked = "", ""  # serial number, and what is known of it
        self._test: UnitTest | None = None
        self._begun = 0.0
        self._newest: list[ShownResult] = []
        self._counts = {"pass": 0, "fail": 0, "aborted": 0}
        self._turn = asyncio.Lock()
        self._ending: asyncio.Task[None] | None = None
        hub.on_take = self._tick

    @property
    def state(self) -> StationState:
        """What the page shows."""
        is_testing = self.phase in {"testing", "judging"}
        return StationState(
            phase=self.phase,
            serial=self._test.serial if self._test and is_testing else self._asked[0],
            board_serial=self._board.serial if self._board else "",
            asked=self._asked[1],
            seconds=self._clock() - self._begun if is_testing else 0.0,
            time_s=self.plan.time_s,
            operator=self.operator,
            passed=self._counts["pass"],
            failed=self._counts["fail"],
            result=self._newest[0] if self.phase == "result" else None,
            trouble=self.trouble,
            newest=tuple(self._newest),
        )

    def recover(self) -> UnitTest | None:
        """Write the row of a test that was interrupted, here or when the program last ran, and return the test.

        Rows that could not be written before are written too; raises `OutputError` where they still cannot be.
        """
        test = self.folder.interrupted()
        if test is None:
            self.folder.write_waiting()
        else:
            self.folder.end(stopped(test, self.folder.last_written(test), "interrupted").row)
        return test

    async def start(self, serial: str, *, again: bool = False) -> None:
        """Test a unit; one that was tested before is asked about first, unless that is meant: `again`.

        Raises
        ------
        UsageError
            For what is no serial number.
        OutputError
            Where the table or the recording cannot be written.
        """
        async with self._turn:
            if self.phase in {"testing", "judging"}:  # a serial number that was scanned twice
                return
            self._write_waiting()
            wanted = serial.strip() or (self._asked[0] if again else self.state.board_serial)
            self._refuse_serial(wanted)
            before = None if again or self.plan.serial.repeats else self.folder.table.last(wanted)
            if before is not None:
                self.phase, self._asked = "confirm", (wanted, _known(before))
                return
            await self._begin(wanted)

    async def finish(self) -> None:
        """Judge the unit by all that it has sent."""
        async with self._turn:
            if self.phase == "testing" and self._test is not None:
                await self._end(self._test, is_aborted=False)

    async def abort(self) -> None:
        """Stop the test, whose recording and row are kept; or take the question about a unit back."""
        async with self._turn:
            if self.phase == "testing" and self._test is not None:
                await self._end(self._test, is_aborted=True)
            elif self.phase == "confirm":
                self.next()

    def next(self) -> None:
        """Be ready for the next unit."""
        if self.phase in {"confirm", "result"}:
            self.phase, self._asked = "ready", ("", "")

    def name_operator(self, name: str) -> None:
        """Say who tests from now on; `UsageError` for a name that is too long."""
        if len(name) > MAX_NAME:
            raise UsageError(f"a name of {len(name)} letters: need at most {MAX_NAME}")
        self.operator = " ".join(name.split())

    def _refuse_serial(self, serial: str) -> None:
        if not serial:
            raise UsageError("there is no serial number: scan or type that of the unit")
        if not re.fullmatch(self.plan.serial.pattern, serial):
            raise UsageError(
                f"{serial[:64]!r} is no serial number of this station: need {self.plan.serial.words}; scan the label "
                "of the unit again"
            )

    def _write_waiting(self) -> None:
        """Write the row that could not be written before: no unit is begun before the table is complete."""
        try:
            self.folder.write_waiting()
        except OutputError as error:
            self.trouble = error.message
            raise
        self.trouble = ""

    async def _begin(self, serial: str) -> None:
        test = self.folder.begun(serial, datetime.now(UTC), self.operator, self.name)
        path, source = self.folder.recording(test.recording), self.hub.source.name
        try:
            await self.hub.on_feed(lambda: self.sink.begin(path, source))
        except OutputError:
            self.folder.forget()
            raise
        at = self.hub.timeline.at
        begun_s = at if math.isfinite(at) else self.hub.edits.begun_s
        self.hub.edit(msgspec.structs.replace(self.hub.edits, begun_s=begun_s, paused_s=None, finished_s=None))
        self._test, self._begun, self._asked, self.phase = test, self._clock(), ("", ""), "testing"

    def _tick(self) -> None:
        """Judge the unit when its time is over, also where no page is open."""
        is_over = self.phase == "testing" and self._clock() - self._begun >= self.plan.time_s
        if is_over and (self._ending is None or self._ending.done()):
            self._ending = asyncio.get_running_loop().create_task(self.finish())

    async def _end(self, test: UnitTest, *, is_aborted: bool) -> None:
        """End the recording, and write files and row."""
        self.phase = "judging"
        ended_at, is_gone = datetime.now(UTC), self.hub.source.link == "gone"
        not_recorded = await self.hub.on_feed(self.sink.end)
        edits = self.hub.edits
        self.hub.edit(msgspec.structs.replace(edits, paused_s=max(self.hub.timeline.at, 0.0)))
        if is_aborted:
            self._keep(stopped(test, ended_at, "aborted"))
            return
        events = (*["not-recorded"] * bool(not_recorded), *["sensor-gone"] * is_gone)
        wanted = self._wanted(test, edits)
        try:
            ended = await asyncio.to_thread(judged, test, ended_at, wanted, self.plan, self.folder, events=events)
        except Exception:  # a fault of ours must not cost the row
            self._keep(stopped(test, ended_at, "fault"))
            raise
        self._keep(ended)

    def _wanted(self, test: UnitTest, edits: Edits) -> Wanted:
        """The recording of a test, all of it."""
        path = self.folder.recording(test.recording)
        whole = msgspec.structs.replace(edits, begun_s=None, paused_s=None, finished_s=None, excluded=())
        return Wanted(test.serial, whole, self.hub.log, path, self.hub.supply.reading, None)

    def _keep(self, ended: EndedTest) -> None:
        """Write the row, and show the result."""
        self.trouble = ended.trouble
        try:
            self.folder.end(ended.row)
        except OutputError as error:
            self.trouble = error.message
        self._newest = [ended.shown, *self._newest][:NEWEST]
        self._counts[ended.shown.result] += 1
        self._test, self.phase = None, "result"


def _known(row: dict[str, str]) -> str:
    """What is known of a unit that was tested before; dates and results that a spreadsheet has changed are left out."""
    ended = {"pass": " and passed", "fail": " and failed", "aborted": " and was stopped"}.get(row["result"], "")
    when = " before"
    with contextlib.suppress(ValueError, TypeError):
        began = datetime.fromisoformat(row["began"]).astimezone()
        when = f" on {began.day} {began:%B} at {began:%H:%M}"
    return f"{row['unit']} was tested{when}{ended}."
