"""Finish: a calibration that stays as it is, while readings go on being recorded, until somebody collects more."""

from __future__ import annotations

from base64 import b64decode
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.live.test_live_session import disturbed_later, fitted
from tests.page_session import PageSession, log_of, warnings
from tests.sentences import assert_sentences

from flinders import simulate
from flinders.apps.live.buffer import rows_of
from flinders.apps.live.messages import readings_frame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.apps.live.messages import Link
    from flinders.arrays import Floats


BESIDE_IRON: Final = np.array([0.0, 30.0, -20.0, 15.0, 0.0, 0.0, 0.0])
"""What something that the board is put down beside adds to a row, µT."""


def finished_after(seconds: float) -> PageSession:
    """A session of a tumble that was finished after a time, and whose last fit is done."""
    session = collected(seconds)
    session.requested(session.at, "finish")
    return fitted(session)


def collected(seconds: float) -> PageSession:
    """A session of a tumble, and the fit of it."""
    session = PageSession()
    session.arrived(seconds, between(0.0, seconds))
    return fitted(session)


def drawn(session: PageSession) -> NDArray[np.float32]:
    """Times of the readings that a page draws."""
    return np.frombuffer(b64decode(session.points().time), "<f4")


def between(start_s: float, end_s: float) -> Floats:
    """Readings of a tumble of a minute after one time and up to another."""
    rows = rows_of(simulate.tumble(seed=11, noise=0.4).samples)
    return rows[(rows[:, 0] > start_s) & (rows[:, 0] <= end_s)]


def test_after_finish_readings_are_counted_and_change_nothing() -> None:
    session = finished_after(30.0)
    before, view, edits = session.state, session.view, session.edits
    session.arrived(40.0, between(30.0, 40.0) + BESIDE_IRON)
    assert not session.wants_fit(41.0)
    after = session.state
    assert (after.finished.seconds, before.finished.since, after.finished.since) == (edits.finished_s, 0, 500)
    assert (after.phase, after.words, after.used) == (before.phase, before.words, before.used)
    assert (session.view, session.edits) == (view, edits)
    assert session.used == list(range(before.readings))
    assert after.readings == before.readings + 500


def test_collect_more_takes_in_what_came_since_and_goes_on() -> None:
    session = finished_after(30.0)
    session.arrived(40.0, between(30.0, 40.0))
    session.requested(40.0, "collect")
    assert fitted(session).state.finished is None
    assert session.used == list(range(session.state.readings))
    assert session.edits.finished_s is None
    session.arrived(45.0, between(40.0, 45.0))
    assert session.wants_fit(45.0)


def test_what_is_drawn_ends_with_the_calibration_and_grows_once_more_is_collected() -> None:
    session = finished_after(30.0)
    before = drawn(session)
    session.arrived(40.0, between(30.0, 40.0))
    npt.assert_array_equal(drawn(session), before)
    session.requested(40.0, "collect")
    npt.assert_array_equal(drawn(session), session.held.time.astype(np.float32))


def test_a_kept_result_is_what_is_finished_and_what_is_drawn() -> None:
    session = disturbed_later(28.0)
    seconds = session.state.kept.seconds
    assert drawn(session)[-1] > seconds
    session.requested(session.at, "finish")
    assert drawn(session)[-1] == np.float32(seconds)
    assert fitted(session).state.phase == "good"
    assert session.state.finished.since > 100
    session.requested(session.at, "collect")
    assert fitted(session).state.kept.seconds == seconds


def test_a_finished_calibration_is_kept_where_what_is_collected_then_spoils_it() -> None:
    session = finished_after(30.0)
    before = session.edits.finished_s
    session.arrived(40.0, between(30.0, 40.0) + BESIDE_IRON)
    session.requested(40.0, "collect")
    assert fitted(session).state.phase == "good"
    assert session.shown.view.verdict != "good"
    session.requested(42.0, "finish")
    assert session.edits.finished_s == before


@pytest.mark.parametrize("link", ["gone", "ended", "waiting"])
def test_a_board_that_is_unplugged_after_finish_takes_nothing_away(link: Link) -> None:
    session = finished_after(30.0)
    before = session.state
    session.linked(31.0, link, "the port is gone")
    session.ticked(60.0)
    assert (session.state.phase, session.state.words) == (before.phase, before.words)
    assert warnings(session.state.reasons) == warnings(before.reasons)
    assert session.state.source.link == link


def test_a_calibration_that_misses_its_target_says_so_when_it_is_finished() -> None:
    session = finished_after(3.0)
    state = session.state
    assert (state.phase, state.finished is not None) == ("collecting", True)
    assert_sentences(state.words)
    session.requested(session.at, "collect")
    assert not session.state.words.startswith("Misses the target")


def test_finish_before_the_first_reading_finishes_nothing() -> None:
    session = PageSession()
    session.requested(1.0, "finish")
    assert (session.state.finished, session.edits.finished_s) == (None, None)


def test_finish_twice_is_finish_once() -> None:
    session = finished_after(30.0)
    edits = session.edits
    session.arrived(35.0, between(30.0, 35.0))
    session.requested(35.0, "finish")
    assert session.edits == edits


def test_a_pause_ends_with_collect_more_and_begins_no_longer_once_it_is_finished() -> None:
    session = collected(30.0)
    session.requested(30.0, "pause", paused=True)
    session.arrived(33.0, between(30.0, 33.0))
    session.requested(33.0, "finish")
    session.requested(33.0, "collect")
    assert (session.state.paused, session.state.excluded_readings) == (False, 150)
    session.requested(34.0, "finish")
    assert [told.severity for told in session.requested(34.0, "pause", paused=True)] == ["warning"]
    assert not session.state.paused


def test_what_is_asked_of_a_finished_calibration_is_asked_of_its_readings() -> None:
    session = finished_after(30.0)
    session.arrived(40.0, between(30.0, 40.0))
    session.requested(40.0, "target", deg=0.05)
    assert fitted(session).state.phase == "collecting"
    session.requested(40.0, "exclude", start_s=10.0, end_s=12.0)
    assert fitted(session).state.finished.seconds == pytest.approx(30.0, abs=0.03)
    assert len(session.used) == 1500 - session.state.excluded_readings


def test_start_again_ends_a_finished_calibration() -> None:
    session = finished_after(30.0)
    session.arrived(33.0, between(30.0, 33.0))
    session.requested(33.0, "clear")
    assert (session.state.finished, session.edits.finished_s) == (None, None)
    assert session.edits.begun_s == pytest.approx(33.0, abs=0.03)


def test_a_log_is_finished_as_it_is() -> None:
    session = PageSession()
    session.opened(1.0, "log", log_of(simulate.tumble(seed=2).samples))
    session.requested(1.0, "finish")
    assert (session.state.finished, session.finishing.finished_s, session.edits.finished_s) == (None, None, None)


def test_another_page_and_one_that_is_loaded_again_come_to_the_same_fit() -> None:
    """Whatever they have got when they hear of it: a page may hear of Finish before all readings of it."""
    session = finished_after(30.0)
    session.arrived(40.0, between(30.0, 40.0))
    other = PageSession()
    other.received(20.0, frame_of(between(0.0, 20.0), 0))
    other.adopted(20.0, session.edits)
    other.received(40.0, frame_of(between(20.0, 40.0), 1000))
    assert fitted(other).view == session.view
    assert vars(other.state.finished) == vars(session.state.finished)
    other.requested(40.0, "collect")
    session.adopted(41.0, other.edits)
    assert session.state.finished is None
    assert fitted(session).view == fitted(other).view


def frame_of(rows: Floats, first: int) -> bytes:
    """Readings from a number on, as a server passes them on."""
    return readings_frame(
        generation=0, first=first, stride=1, total=first + len(rows), is_last=True, rows=rows, latest=rows[-1],
        is_microtesla=True, is_vehicle=False,
    )  # fmt: skip
