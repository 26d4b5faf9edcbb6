"""A session is a pure function of what came: how it was cut up, and who looked on, makes no difference."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.testing as npt
import pytest
from flinders.live.evaluation import evaluate
from flinders.live.page_state import Cursor, points, session_state
from flinders.live.session import (
    SHARE,
    Arrived,
    Evaluated,
    Event,
    FitDone,
    Linked,
    LiveSession,
    Requested,
    begin_fit,
    step,
    used_readings,
    wants_fit,
)
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.trials import examples

from flinders import simulate
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.live.buffer import SHOWN, Exclusions, ReadingBuffer, Timeline, rows_of, stride_for
from flinders.live.messages import Clear, Exclude, Notice, Pause, Redo, Restore, SetTarget, Undo, parse

UT = Unit.of("uT")
ROWS = rows_of(simulate.tumble(seed=1, n=600).samples)

cuts = st.lists(st.integers(0, len(ROWS)), max_size=12).map(lambda places: [0, *sorted(places), len(ROWS)])
spans = st.tuples(st.floats(-1, 60), st.floats(0.01, 20)).map(lambda pair: (pair[0], pair[0] + pair[1]))
edits = st.one_of(
    spans.map(lambda span: Exclude(*span)),
    spans.map(lambda span: Restore(*span)),
    st.builds(Undo),
    st.builds(Redo),
)


def arriving(places: list[int]) -> list[Event]:
    return [Arrived(ROWS[b - 1, 0], ROWS[a:b], UT) for a, b in itertools.pairwise(places) if b > a]


def replayed(events: list[Event], session: LiveSession) -> tuple[LiveSession, list[Notice]]:
    """Take a list of events in, one after the other."""
    replies: list[Notice] = []
    for event in events:
        session, more = step(session, event)
        replies += more
    return session, replies


def fitted(session: LiveSession) -> str:
    return repr(evaluate(session).view)


WHOLE = fitted(replayed(arriving([0, len(ROWS)]), LiveSession())[0])


@examples(10)
@given(cuts)
def test_any_split_of_the_readings_gives_the_same_fit(places: list[int]) -> None:
    session, _ = replayed(arriving(places), LiveSession())
    assert fitted(session) == WHOLE


@examples(50)
@given(st.lists(edits, max_size=10), spans)
def test_exclude_and_undo_is_as_if_nothing_had_happened(before: list[Exclude], span: tuple[float, float]) -> None:
    session, _ = replayed([*arriving([0, 600]), *(Requested(60.0, one) for one in before)], LiveSession())
    taken, _ = step(session, Requested(61.0, Exclude(*span)))
    assume(taken.shown.exclusions != session.shown.exclusions)
    later, _ = step(taken, Requested(62.0, Undo()))
    npt.assert_array_equal(used_readings(later)[0].field, used_readings(session)[0].field)
    assert session_state(later).excluded == session_state(session).excluded


@given(st.lists(edits, max_size=30))
def test_spans_stay_in_order_and_apart_and_all_steps_can_be_undone(wishes: list[Exclude]) -> None:
    session, _ = replayed([Requested(0.0, wish) for wish in wishes], LiveSession())
    flat = [edge for span in session.shown.exclusions.spans for edge in span]
    assert flat == sorted(flat)
    assert len(set(flat)) == len(flat)
    exclusions = session.shown.exclusions
    while exclusions.past:
        exclusions = exclusions.undone()
    assert exclusions.spans == ()
    while exclusions.future:
        exclusions = exclusions.redone()
    redone = session.shown.exclusions
    while redone.future:
        redone = redone.redone()
    assert exclusions.spans == redone.spans


@given(spans, st.integers(0, 599))
def test_a_reading_is_fitted_unless_its_time_was_taken_out(span: tuple[float, float], row: int) -> None:
    session, _ = replayed([*arriving([0, 600]), Requested(60.0, Exclude(*span))], LiveSession())
    kept = used_readings(session)[1]
    assert (row in kept) == (not span[0] <= ROWS[row, 0] <= span[1])
    assert session_state(session).excluded_readings == 600 - len(kept)


@given(cuts, st.integers(1, 40))
def test_two_pages_get_the_same_points_whenever_they_came(places: list[int], frame: int) -> None:
    """One page is there from the beginning, the other comes in the end."""
    session, early, received = LiveSession(), Cursor(), bytearray()
    for event in arriving(places):
        session, _ = step(session, event)
        content, early = points(session, early)
        if content is not None:
            received += content[32 + 24 :]
    content, late = points(session, Cursor())
    assert content is not None
    assert late.count == early.count == 600
    times = np.frombuffer(content, "<f4", 600, 56)
    npt.assert_array_equal(times, ROWS[:, 0].astype("<f4"))


def test_the_same_events_give_the_same_messages_again() -> None:
    events: list[Event] = [
        *arriving([0, 100, 600]),
        Requested(60.0, Exclude(1.0, 2.0)),
        Requested(61.0, SetTarget(0.5)),
    ]
    first, told = replayed(events, LiveSession())
    found = evaluate(first)
    first, more = step(begin_fit(first), FitDone(62.0, found, 0.01))
    second, told_again = replayed(events, LiveSession())
    second, more_again = step(begin_fit(second), FitDone(62.0, evaluate(second), 0.01))
    assert (told, repr(more), session_state(first)) == (told_again, repr(more_again), session_state(second))


def test_a_state_is_not_changed_by_what_comes_after_it() -> None:
    session, _ = replayed(arriving([0, 300]), LiveSession())
    before = used_readings(session)[0].field.copy()
    one, _ = step(session, Arrived(10.0, ROWS[300:310], UT))
    other, _ = step(session, Arrived(10.0, ROWS[400:410], UT))
    npt.assert_array_equal(used_readings(session)[0].field, before)
    npt.assert_array_equal(one.live.buffer.field[300:], ROWS[300:310, 1:4])
    npt.assert_array_equal(other.live.buffer.field[300:], ROWS[400:410, 1:4])


@given(st.lists(st.integers(1, 700), min_size=1, max_size=12))
def test_memory_is_bounded_and_what_is_held_does_not_depend_on_how_it_came(batches: list[int]) -> None:
    rows = np.zeros((sum(batches), 7))
    rows[:, 0] = np.arange(len(rows))
    whole, buffer = ReadingBuffer.empty(128).extended(rows), ReadingBuffer.empty(128)
    for first, last in itertools.pairwise(np.cumsum([0, *batches])):
        buffer = buffer.extended(rows[first:last])
        assert len(buffer) <= 128
        assert len(buffer._room.rows) <= max(128, 4096)
    assert (buffer.total, buffer.stride) == (whole.total, whole.stride)
    npt.assert_array_equal(buffer.time, whole.time)
    npt.assert_array_equal(buffer.time, rows[:: whole.stride, 0])


@given(st.integers(1, 10**7), st.integers(1, 10**5))
def test_a_stride_is_the_least_power_of_two_that_is_enough(total: int, most: int) -> None:
    stride = stride_for(total, most)
    assert stride & (stride - 1) == 0
    assert -(-total // stride) <= most
    assert stride == 1 or -(-total // (stride // 2)) > most


def test_when_the_stride_doubles_a_page_that_kept_every_second_point_has_the_right_ones() -> None:
    rows = np.zeros((SHOWN + 1000, 7))
    rows[:, 0] = np.arange(len(rows))
    session, cursor, page = LiveSession(), Cursor(), np.empty(0)
    for batch in np.array_split(rows, 90):
        session, _ = step(session, Arrived(1.0, batch, UT))
        while True:
            content, following = points(session, cursor)
            if content is None:
                break
            header = np.frombuffer(content, "<u4", 8)
            if following.stride != cursor.stride and cursor.count:
                page = page[::2]
            assert header[2] == len(page)
            page = np.concatenate([page, np.frombuffer(content, "<f4", header[3], 56)])
            cursor = following
    assert session_state(session).stride == 2
    npt.assert_array_equal(page, rows[::2, 0])


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=30), st.integers(0, 30))
def test_a_timeline_never_goes_back_and_does_not_depend_on_batches(times: list[float], cut: int) -> None:
    whole, _ = Timeline()(np.array(times))
    assert np.all(np.diff(whole) >= 0.0)
    if len(times) > 1 and cut and np.isfinite(times[0]):
        first, clock = Timeline()(np.array(times[:cut]))
        second, _ = clock(np.array(times[cut:]))
        npt.assert_array_equal(np.concatenate([first, second]), whole)


def test_fits_take_their_share_of_a_core_and_no_more() -> None:
    session, busy, now = LiveSession(), 0.0, 0.0
    for row in ROWS[:500]:
        now = row[0]
        session, _ = step(session, Arrived(now, row[np.newaxis], UT))
        if wants_fit(session, now):
            session = begin_fit(session)
            session, _ = step(session, FitDone(now, Evaluated(key=session.shown.key), 0.03))
            busy += 0.03
    assert 0.0 < busy <= SHARE * now + 0.03


def test_the_last_fit_of_a_source_that_has_ended_does_not_wait_for_its_share() -> None:
    session, _ = step(LiveSession(), Arrived(0.0, ROWS[:100], UT))
    session = begin_fit(session)
    session, _ = step(session, Arrived(0.5, ROWS[100:200], UT))
    session, _ = step(session, FitDone(1.0, Evaluated(key=0), 30.0))
    session, _ = step(session, Arrived(1.5, ROWS[200:300], UT))
    assert not wants_fit(session, 2.0)
    session, _ = step(session, Linked(2.0, "ended", "played to its end"))
    assert wants_fit(session, 2.0)
    session, _ = step(begin_fit(session), FitDone(2.5, Evaluated(key=session.shown.key), 30.0))
    assert not wants_fit(session, 1e6)


def test_a_pause_is_an_exclusion_that_can_be_undone() -> None:
    session, _ = step(LiveSession(), Arrived(2.0, ROWS[:100], UT))
    session, _ = step(session, Requested(2.0, Pause(paused=True)))
    session, _ = step(session, Arrived(4.0, ROWS[100:200], UT))
    assert session_state(session).excluded_readings == 100
    assert session_state(session).paused
    session, _ = step(session, Requested(4.0, Pause(paused=False)))
    session, _ = step(session, Arrived(6.0, ROWS[200:300], UT))
    numbers = used_readings(session)[1]
    npt.assert_array_equal(numbers, [*range(100), *range(200, 300)])
    session, _ = step(session, Requested(6.0, Undo()))
    assert len(used_readings(session)[0]) == 300


def test_a_fit_of_what_was_there_before_is_not_shown_after_clearing() -> None:
    session, _ = replayed(arriving([0, 600]), LiveSession())
    session = begin_fit(session)
    found = evaluate(session)
    session, _ = step(session, Requested(60.0, Clear()))
    session, told = step(session, FitDone(60.1, found, 0.01))
    assert session.view is None
    assert told == []
    assert session_state(session).readings == 0


@pytest.mark.parametrize("depth", [100, 20_000])
def test_nested_json_is_refused_in_words(depth: int) -> None:
    with pytest.raises(UsageError, match="not a message"):
        parse("[" * depth)


@given(st.binary(max_size=200) | st.text(max_size=200))
def test_what_a_page_sends_is_a_message_or_refused(content: bytes | str) -> None:
    words = "a message"
    try:
        parse(content)
    except UsageError as error:
        words = str(error)
    assert words


def test_history_remembers_a_bounded_number_of_steps() -> None:
    exclusions = Exclusions()
    for number in range(1000):
        exclusions = exclusions.excluding((number * 2.0, number * 2.0 + 1.0))
    assert len(exclusions.past) == 200
    assert len(exclusions.spans) == 1000
    assert exclusions.excluding((9000.0, 9001.0)) == exclusions
