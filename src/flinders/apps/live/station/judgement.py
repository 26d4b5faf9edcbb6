"""Result of a test: calibration of its whole recording, missed limits, files, and row.

The calibration and its verdict are those of *Finish* of the live page, from the file of the unit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from msgspec import Struct

from flinders.apps.live.finished import finish_calibration
from flinders.apps.live.station.limits import Miss, misses
from flinders.apps.live.station.outputs import write_outputs
from flinders.apps.live.station.words import miss_words, numbers_of
from flinders.errors import FlindersError, OutputError, UnreadableInput
from flinders.fitting.result import Fit

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.apps.live.finished import FinishedCalibration, FinishInputs
    from flinders.apps.live.station.folder import StationFolder, UnitTest
    from flinders.apps.live.station.plan import Plan
    from flinders.apps.live.station.table import StationRow


Result = Literal["pass", "fail", "aborted"]


class ShownReason(Struct, frozen=True):
    """Reason why a unit fails, with a remedy."""

    code: str
    words: str
    remedy: str


class ShownResult(Struct, frozen=True):
    """Result of a test for the page."""

    serial: str
    result: Result
    reasons: tuple[ShownReason, ...] = ()
    numbers: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class EndedTest:
    """An ended test: its row, and the result that the page shows."""

    row: StationRow
    shown: ShownResult
    trouble: str = ""  # file that could not be written, in words


def stopped_test(test: UnitTest, ended: datetime, code: str) -> EndedTest:
    """Return an ended test without a calibration: aborted by the operator, or interrupted."""
    return _ended_test(test, test.row("aborted", ended), "aborted", (Miss(code),), None)


def judge_test(
    test: UnitTest,
    ended: datetime,
    wanted: FinishInputs,
    plan: Plan,
    folder: StationFolder,
    *,
    events: tuple[str, ...] = (),
) -> EndedTest:
    """Make the calibration of a test, write its files, and return its result.

    Parameters
    ----------
    test : UnitTest
    ended : datetime
    wanted : FinishInputs
        Recording of the test and settings of the fit.
    plan : Plan
    folder : StationFolder
    events : tuple of str
        Codes of other faults, such as ``sensor-gone``.
    """
    made = finish_calibration("", wanted)
    outcome, trouble = made.outcome, ""
    missed = [*map(Miss, events), *_reading_misses(made, plan)]
    if isinstance(outcome, Fit):
        try:
            write_outputs(made, test, ended, plan, folder, is_passed=not missed)
        except OutputError as error:
            trouble = error.message
        except FlindersError:
            missed.append(Miss("not-exported"))
    result: Result = "fail" if missed else "pass"
    row = test.row(result, ended).with_outcome(outcome, sum(file.rows for file in made.files))
    return replace(_ended_test(test, row, result, tuple(missed), outcome), trouble=trouble)


def _reading_misses(made: FinishedCalibration, plan: Plan) -> tuple[Miss, ...]:
    """Return the misses of a calibration; only ``no-readings`` if there are no readings."""
    is_empty = isinstance(made.outcome, UnreadableInput) or not sum(file.rows for file in made.files)
    return (Miss("no-readings"),) if is_empty else misses(made.outcome, plan.limits)


def _ended_test(
    test: UnitTest, row: StationRow, result: Result, missed: tuple[Miss, ...], outcome: Fit | FlindersError | None
) -> EndedTest:
    """Make an ended test from its row, with the result and the reasons that the page shows."""
    reasons = tuple(ShownReason(miss.code, *miss_words(miss, outcome)) for miss in missed)
    message = " ".join(f"{reason.words} {reason.remedy}" for reason in reasons[:1])
    row = replace(
        row,
        code=missed[0].code if missed else "",
        message=message,
        missed=tuple(dict.fromkeys(miss.code for miss in missed)),
    )
    numbers = tuple(numbers_of(outcome)) if isinstance(outcome, Fit) else ()
    return EndedTest(row, ShownResult(test.serial, result, reasons, numbers))
