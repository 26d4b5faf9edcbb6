"""What a test comes to: the calibration of its whole recording, what that misses, and its files and row.

The calibration is made and judged as *Finish* of the live page does it, by the engine, from the file of the unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from msgspec import Struct

from flinders.apps.live.finished import finished
from flinders.apps.live.station.limits import Miss, misses
from flinders.apps.live.station.outputs import write_outputs
from flinders.apps.live.station.words import numbers_of, said
from flinders.errors import FlindersError, OutputError, UnreadableInput
from flinders.fitting.result import Fit

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.apps.live.finished import Finished, Wanted
    from flinders.apps.live.station.folder import StationFolder, UnitTest
    from flinders.apps.live.station.plan import Plan
    from flinders.apps.live.station.table import StationRow


Result = Literal["pass", "fail", "aborted"]


class ShownReason(Struct, frozen=True):
    """Why a unit fails, and what to do about it."""

    code: str
    words: str
    remedy: str


class ShownResult(Struct, frozen=True):
    """How a test ended, for the page."""

    serial: str
    result: Result
    reasons: tuple[ShownReason, ...] = ()
    numbers: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class EndedTest:
    """A test that is over."""

    row: StationRow
    shown: ShownResult
    trouble: str = ""  # what could not be written


def stopped(test: UnitTest, ended: datetime, code: str) -> EndedTest:
    """A test without a calibration: aborted by the operator, or interrupted."""
    return _ended(test, test.row("aborted", ended), "aborted", (Miss(code),), None)


def judged(
    test: UnitTest, ended: datetime, wanted: Wanted, plan: Plan, folder: StationFolder, *, events: tuple[str, ...] = ()
) -> EndedTest:
    """Make the calibration of a test, write its files, and say whether the unit passes.

    Parameters
    ----------
    test : UnitTest
    ended : datetime
    wanted : Wanted
        Its recording, and how it is fitted.
    plan : Plan
    folder : StationFolder
    events : tuple of str
        Codes of what went wrong beside the readings, such as ``sensor-gone``.
    """
    made = finished("", wanted)
    outcome, trouble = made.outcome, ""
    missed = [*map(Miss, events), *_of_readings(made, plan)]
    if isinstance(outcome, Fit):
        try:
            write_outputs(made, test, ended, plan, folder, is_passed=not missed)
        except OutputError as error:
            trouble = error.message
        except FlindersError:
            missed.append(Miss("not-exported"))
    result: Result = "fail" if missed else "pass"
    row = test.row(result, ended).with_outcome(outcome, sum(file.rows for file in made.files))
    return replace(_ended(test, row, result, tuple(missed), outcome), trouble=trouble)


def _of_readings(made: Finished, plan: Plan) -> tuple[Miss, ...]:
    """What the readings miss; a recording without readings is none that anybody can judge."""
    is_empty = isinstance(made.outcome, UnreadableInput) or not sum(file.rows for file in made.files)
    return (Miss("no-readings"),) if is_empty else misses(made.outcome, plan.limits)


def _ended(
    test: UnitTest, row: StationRow, result: Result, missed: tuple[Miss, ...], outcome: Fit | FlindersError | None
) -> EndedTest:
    """The row and what the page shows, with why."""
    reasons = tuple(ShownReason(miss.code, *said(miss, outcome)) for miss in missed)
    message = " ".join(f"{reason.words} {reason.remedy}" for reason in reasons[:1])
    row = replace(
        row,
        code=missed[0].code if missed else "",
        message=message,
        missed=tuple(dict.fromkeys(miss.code for miss in missed)),
    )
    numbers = tuple(numbers_of(outcome)) if isinstance(outcome, Fit) else ()
    return EndedTest(row, ShownResult(test.serial, result, reasons, numbers))
