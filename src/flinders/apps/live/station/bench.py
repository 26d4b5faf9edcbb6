"""Test bench of a station: one unit at a time, from serial number to row of the table.

A test has the phases ``ready`` for a serial number, ``confirm`` if the unit was tested before, ``testing``, ``judging``
while the calibration is made, and ``result``. The page of the operator sends requests and shows the state; all
decisions are made here. Each test that has begun ends in a row: with a result, stopped by the operator, or as
interrupted when the program starts again after a power failure.
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

from flinders.apps.live.finished import FinishInputs
from flinders.apps.live.station.judgement import EndedTest, ShownResult, judge_test, stopped_test
from flinders.errors import OutputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.apps.live.hub import Hub
    from flinders.apps.live.messages import Edits
    from flinders.apps.live.station.folder import StationFolder, UnitTest
    from flinders.apps.live.station.plan import Plan
    from flinders.apps.live.station.recordings import SerialNumberSource, UnitSink

Phase = Literal["ready", "confirm", "testing", "judging", "result"]

MAX_LISTED_TESTS: Final = 8  # Largest number of tests in the list of the page
MAX_NAME: Final = 100  # Largest number of characters of an operator's name


class StationState(Struct, frozen=True, kw_only=True):
    """State of a station, for the page of the operator."""

    phase: Phase
    serial: str  # serial number of the unit under test, or of the unit that `asked` is about
    board_serial: str  # serial number that the board reports
    asked: str  # question to the operator before a repeated test
    seconds: float  # seconds since the start of the test
    time_s: float  # duration of a test
    operator: str
    passed: int
    failed: int
    result: ShownResult | None
    trouble: str  # file that cannot be written, in words
    newest: tuple[ShownResult, ...]  # the newest tests, the newest first


class Station:
    """The test bench: one sensor, one unit at a time.

    Parameters
    ----------
    hub : Hub
        Hub of the readings; its feed records to `sink`.
    sink : UnitSink
    folder : StationFolder
    plan : Plan
    operator, name : str
        Names of the operator and of the station.
    board : SerialNumberSource, optional
        The wire, if the board reports its serial number.
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
        board: SerialNumberSource | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.hub, self.sink, self.folder, self.plan = hub, sink, folder, plan
        self.operator, self.name, self._board, self._clock = operator, name, board, clock
        self.phase: Phase = "ready"
        self.trouble = ""
        self._asked = "", ""  # serial number in question, and the question
        self._test: UnitTest | None = None
        self._begun = 0.0
        self._newest: list[ShownResult] = []
        self._counts = {"pass": 0, "fail": 0, "aborted": 0}
        self._turn = asyncio.Lock()
        self._ending: asyncio.Task[None] | None = None
        hub.on_take = self._tick

    @property
    def state(self) -> StationState:
        """State of the station, as the page shows it."""
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
        """Write the row of a test that was interrupted, in this or the last run of the program, and return the test.

        Also writes rows that failed before; raises `OutputError` if that fails again.
        """
        test = self.folder.interrupted_test()
        if test is None:
            self.folder.write_waiting()
        else:
            self.folder.end(stopped_test(test, self.folder.last_written(test), "interrupted").row)
        return test

    async def start(self, serial: str, *, again: bool = False) -> None:
        """Start the test of a unit; for a unit that was tested before, ask first unless `again` is set.

        Raises
        ------
        UsageError
            For an invalid serial number.
        OutputError
            If the table or the recording cannot be written.
        """
        async with self._turn:
            if self.phase in {"testing", "judging"}:  # the serial number was scanned twice
                return
            self._write_waiting()
            wanted = serial.strip() or (self._asked[0] if again else self.state.board_serial)
            self._refuse_serial(wanted)
            before = None if again or self.plan.serial.repeats else self.folder.table.last(wanted)
            if before is not None:
                self.phase, self._asked = "confirm", (wanted, _previous_test_words(before))
                return
            await self._begin(wanted)

    async def finish(self) -> None:
        """End the test, and determine its result from all readings."""
        async with self._turn:
            if self.phase == "testing" and self._test is not None:
                await self._end(self._test, is_aborted=False)

    async def abort(self) -> None:
        """Stop the test and keep its recording and row, or withdraw the question about a unit."""
        async with self._turn:
            if self.phase == "testing" and self._test is not None:
                await self._end(self._test, is_aborted=True)
            elif self.phase == "confirm":
                self.next()

    def next(self) -> None:
        """Return to the phase ``ready``."""
        if self.phase in {"confirm", "result"}:
            self.phase, self._asked = "ready", ("", "")

    def name_operator(self, name: str) -> None:
        """Set the operator's name; `UsageError` if it is too long."""
        if len(name) > MAX_NAME:
            raise UsageError(f"a name of {len(name)} letters: need at most {MAX_NAME}")
        self.operator = " ".join(name.split())

    def _refuse_serial(self, serial: str) -> None:
        if not serial:
            raise UsageError("no serial number: scan or type that of the unit")
        if not re.fullmatch(self.plan.serial.pattern, serial):
            raise UsageError(
                f"{serial[:64]!r} is not a serial number of this station: need {self.plan.serial.words}; scan the "
                "label of the unit again"
            )

    def _write_waiting(self) -> None:
        """Write a row that could not be written before; a test begins only with a complete table."""
        try:
            self.folder.write_waiting()
        except OutputError as error:
            self.trouble = error.message
            raise
        self.trouble = ""

    async def _begin(self, serial: str) -> None:
        test = self.folder.begin_test(serial, datetime.now(UTC), self.operator, self.name)
        path, source = self.folder.recording(test.recording), self.hub.source.name
        try:
            await self.hub.on_feed(lambda: self.sink.begin(path, source))
        except OutputError:
            self.folder.clear_journal()
            raise
        at = self.hub.timeline.at
        begun_s = at if math.isfinite(at) else self.hub.edits.begun_s
        self.hub.edit(msgspec.structs.replace(self.hub.edits, begun_s=begun_s, paused_s=None, finished_s=None))
        self._test, self._begun, self._asked, self.phase = test, self._clock(), ("", ""), "testing"

    def _tick(self) -> None:
        """End the test when its time is over, even without an open page."""
        is_over = self.phase == "testing" and self._clock() - self._begun >= self.plan.time_s
        if is_over and (self._ending is None or self._ending.done()):
            self._ending = asyncio.get_running_loop().create_task(self.finish())

    async def _end(self, test: UnitTest, *, is_aborted: bool) -> None:
        """End the recording, and write the files and the row."""
        self.phase = "judging"
        ended_at, is_gone = datetime.now(UTC), self.hub.source.link == "gone"
        not_recorded = await self.hub.on_feed(self.sink.end)
        edits = self.hub.edits
        self.hub.edit(msgspec.structs.replace(edits, paused_s=max(self.hub.timeline.at, 0.0)))
        if is_aborted:
            self._keep(stopped_test(test, ended_at, "aborted"))
            return
        events = (*["not-recorded"] * bool(not_recorded), *["sensor-gone"] * is_gone)
        wanted = self._finish_inputs(test, edits)
        try:
            ended = await asyncio.to_thread(judge_test, test, ended_at, wanted, self.plan, self.folder, events=events)
        except Exception:  # an internal error must not lose the row
            self._keep(stopped_test(test, ended_at, "fault"))
            raise
        self._keep(ended)

    def _finish_inputs(self, test: UnitTest, edits: Edits) -> FinishInputs:
        """Inputs of the calibration: the whole recording of a test."""
        path = self.folder.recording(test.recording)
        whole = msgspec.structs.replace(edits, begun_s=None, paused_s=None, finished_s=None, excluded=())
        return FinishInputs(test.serial, whole, self.hub.log, path, self.hub.supply.reading, None)

    def _keep(self, ended: EndedTest) -> None:
        """Write the row, and show the result."""
        self.trouble = ended.trouble
        try:
            self.folder.end(ended.row)
        except OutputError as error:
            self.trouble = error.message
        self._newest = [ended.shown, *self._newest][:MAX_LISTED_TESTS]
        self._counts[ended.shown.result] += 1
        self._test, self.phase = None, "result"


def _previous_test_words(row: dict[str, str]) -> str:
    """Sentence on an earlier test of a unit; skips dates and results that a spreadsheet has changed."""
    ended = {"pass": " and passed", "fail": " and failed", "aborted": " and was stopped"}.get(row["result"], "")
    when = " before"
    with contextlib.suppress(ValueError, TypeError):
        began = datetime.fromisoformat(row["began"]).astimezone()
        when = f" on {began.day} {began:%B} at {began:%H:%M}"
    return f"{row['unit']} was tested{when}{ended}."
