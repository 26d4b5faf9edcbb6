"""A session is made by what came: how it was cut up, and who looked on, makes no difference."""

from __future__ import annotations

import itertools
from base64 import b64decode
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.javascript import run
from tests.page_session import PageSession, frame_of_buffer
from tests.sentences import assert_raises
from tests.trials import examples

from flinders import simulate
from flinders.apps.live.buffer import ReadingBuffer, Timeline, rows_of, stride_for
from flinders.apps.live.messages import encode, parse
from flinders.errors import UsageError
from flinders.native import build

if TYPE_CHECKING:
    from types import SimpleNamespace

    from flinders.arrays import Floats

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

ROWS = rows_of(simulate.tumble(seed=1, n=600).samples)
SHARE, SHOWN = 0.03, 40_000
"""Of `RULES` in ``session.js``: of a core, that fits take, and points that are shown, at most."""

Command = dict[str, Any]

cuts = st.lists(st.integers(0, len(ROWS)), max_size=12).map(lambda places: [0, *sorted(places), len(ROWS)])
spans = st.tuples(st.floats(-1, 60), st.floats(0.01, 20)).map(lambda pair: (pair[0], pair[0] + pair[1]))
edits = st.one_of(
    spans.map(lambda span: of_span("exclude", span)),
    spans.map(lambda span: of_span("restore", span)),
    st.just({"type": "undo"}),
    st.just({"type": "redo"}),
)


ends = st.sampled_from([{"type": "finish"}, {"type": "collect"}])


def of_span(kind: str, span: tuple[float, float]) -> Command:
    return {"type": kind, "start_s": span[0], "end_s": span[1]}


def arrive(session: PageSession, places: list[int]) -> PageSession:
    """Let the readings come, cut at some places."""
    for begin, end in itertools.pairwise(places):
        if end > begin:
            session.arrived(ROWS[end - 1, 0], ROWS[begin:end])
    return session


def whole() -> PageSession:
    """A session that all readings have come to."""
    return arrive(PageSession(), [0, len(ROWS)])


def request(session: PageSession, *commands: Command) -> PageSession:
    for command in commands:
        session.requested(60.0, **command)
    return session


def fitted(session: PageSession) -> SimpleNamespace:
    found = session.evaluated()
    del found.key
    return found


@pytest.fixture(scope="module")
def fit_of_all() -> SimpleNamespace:
    return fitted(whole())


@examples(10)
@given(cuts)
def test_any_split_of_the_readings_gives_the_same_fit(fit_of_all: SimpleNamespace, places: list[int]) -> None:
    assert fitted(arrive(PageSession(), places)) == fit_of_all


@examples(50)
@given(st.lists(edits, max_size=10), spans)
def test_exclude_and_undo_is_as_if_nothing_had_happened(before: list[Command], span: tuple[float, float]) -> None:
    session = request(whole(), *before)
    spans, field = session.edits.excluded, session.used_field
    request(session, of_span("exclude", span))
    assume(session.edits.excluded != spans)
    request(session, {"type": "undo"})
    assert session.edits.excluded == spans
    npt.assert_array_equal(session.used_field, field)


@examples(50)
@given(st.lists(edits, max_size=30))
def test_spans_stay_in_order_and_apart_and_all_steps_can_be_undone(wishes: list[Command]) -> None:
    session = request(whole(), *wishes)
    flat = [edge for span in session.edits.excluded for edge in span]
    assert flat == sorted(flat)
    assert len(set(flat)) == len(flat)
    last = after_all(session, "redo")
    assert after_all(session, "undo") == ()
    assert after_all(session, "redo") == last


def after_all(session: PageSession, kind: str) -> tuple[tuple[float, float], ...]:
    """What is excluded after all steps back, or again."""
    while getattr(session.state, f"can_{kind}"):
        request(session, {"type": kind})
    return session.edits.excluded


@given(spans, st.integers(0, 599))
def test_a_reading_is_fitted_unless_its_time_was_taken_out(span: tuple[float, float], row: int) -> None:
    session = request(whole(), of_span("exclude", span))
    kept = session.used
    assert (row in kept) == (not span[0] <= ROWS[row, 0] <= span[1])
    assert session.state.excluded_readings == 600 - len(kept)


@examples(50)
@given(
    st.lists(st.one_of(edits, ends), max_size=10), st.booleans(), st.sampled_from(["heading", "attitude"]),
    st.floats(0.01, 180.0), st.integers(1, len(ROWS)),
)  # fmt: skip
def test_another_page_takes_over_what_was_done_here(
    wishes: list[Command], is_paused: bool, goal: str, deg: float, until: int
) -> None:
    here = request(arrive(PageSession(), [0, until]), *wishes, {"type": "pause", "paused": is_paused})
    request(here, {"type": "goal", "goal": goal}, {"type": "target", "deg": deg})
    arrive(here, [until, len(ROWS)])
    there = whole()
    there.adopted(60.0, here.edits)
    assert there.edits == here.edits == parse(encode(here.edits))
    assert there.used == here.used


@given(cuts)
def test_two_pages_get_the_same_points_whenever_they_came(places: list[int]) -> None:
    """One page is there from the beginning, the other comes in the end."""
    session = PageSession()
    for begin, end in itertools.pairwise(places):
        arrive(session, [begin, end])
        early = session.points("early")
    assert times_of(early) == times_of(session.points("late")) == ROWS[:, 0].astype("<f4").tolist()


def times_of(points: SimpleNamespace) -> list[float]:
    """Times of what a page draws."""
    times: list[float] = np.frombuffer(b64decode(points.time), "<f4").tolist()
    return times


def test_the_same_events_give_the_same_messages_again() -> None:
    def told() -> tuple[Any, ...]:
        session = request(arrive(PageSession(), [0, 100, 600]), of_span("exclude", (1.0, 2.0)))
        notices = session.requested(61.0, "target", deg=0.5)
        session.fit()
        return notices, session.shown, session.state, session.points()

    assert told() == told()


def test_a_buffer_is_not_changed_by_what_comes_after_it() -> None:
    buffer = ReadingBuffer.empty().with_rows(ROWS[:300])
    before = buffer.field.copy()
    one, other = buffer.with_rows(ROWS[300:310]), buffer.with_rows(ROWS[400:410])
    npt.assert_array_equal(buffer.field, before)
    npt.assert_array_equal(one.field[300:], ROWS[300:310, 1:4])
    npt.assert_array_equal(other.field[300:], ROWS[400:410, 1:4])


@given(st.lists(st.integers(1, 700), min_size=1, max_size=12))
def test_memory_is_bounded_and_what_is_held_does_not_depend_on_how_it_came(batches: list[int]) -> None:
    rows = counted_rows(sum(batches))
    whole, buffer = ReadingBuffer.empty(128).with_rows(rows), ReadingBuffer.empty(128)
    session = PageSession(rules={"capacity": 128})
    for first, last in itertools.pairwise(np.cumsum([0, *batches]).tolist()):
        buffer = buffer.with_rows(rows[first:last])
        session.arrived(1.0, rows[first:last])
        assert len(buffer) <= 128
        assert len(buffer._room.rows) <= max(128, 4096)
    held = session.held
    assert (held.total, held.stride) == (buffer.total, buffer.stride) == (whole.total, whole.stride)
    npt.assert_array_equal(buffer.time, whole.time)
    npt.assert_array_equal(buffer.time, rows[:: whole.stride, 0])
    npt.assert_array_equal(buffer.time, held.time)


def counted_rows(count: int) -> Floats:
    """Rows that have their number as time."""
    rows = np.zeros((count, 7))
    rows[:, 0] = np.arange(count)
    return rows


@given(st.integers(1, 10**7), st.integers(1, 10**5))
def test_a_stride_is_the_least_power_of_two_that_is_enough(total: int, most: int) -> None:
    stride = stride_for(total, most)
    assert stride & (stride - 1) == 0
    assert -(-total // stride) <= most
    assert stride == 1 or -(-total // (stride // 2)) > most


def test_when_the_stride_doubles_a_page_that_kept_every_second_point_has_the_right_ones() -> None:
    rows = counted_rows(SHOWN + 1000)
    session, strides = PageSession(), set()
    for batch in np.array_split(rows, 90):
        session.arrived(1.0, batch)
        points = session.points()
        is_thinned = points.stride not in strides
        strides.add(points.stride)
        assert (points.first == 0) == is_thinned
        assert session.points().first is None
    assert (session.state.stride, strides) == (2, {1, 2})
    npt.assert_array_equal(times_of(points), rows[::2, 0].astype("<f4"))


times_of_a_clock = st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=30)


@given(times_of_a_clock, st.integers(0, 30))
def test_a_timeline_never_goes_back_and_does_not_depend_on_batches(times: list[float], cut: int) -> None:
    whole, _ = Timeline()(np.array(times))
    assert np.all(np.diff(whole) >= 0.0)
    if len(times) > 1 and cut and np.isfinite(times[0]):
        first, clock = Timeline()(np.array(times[:cut]))
        second, _ = clock(np.array(times[cut:]))
        npt.assert_array_equal(np.concatenate([first, second]), whole)


@given(times_of_a_clock)
def test_the_page_without_a_program_has_the_timeline_of_the_server(times: list[float]) -> None:
    assume(times)
    session, rows = PageSession(), np.zeros((len(times), 7))
    rows[:, 0] = times
    session.arrived(1.0, rows)
    npt.assert_allclose(session.held.time, Timeline()(np.array(times))[0], rtol=1e-12, atol=1e-6)


def test_fits_take_their_share_of_a_core_and_no_more() -> None:
    session, busy = PageSession(), 0.0
    for row in ROWS[:500]:
        session.arrived(row[0], row[np.newaxis])
        if session.wants_fit(row[0]):
            session.begin_fit()
            session.fit_done(row[0], seconds=0.03)
            busy += 0.03
    assert 0.0 < busy <= SHARE * ROWS[499, 0] + 0.03


def test_the_last_fit_of_a_source_that_has_ended_does_not_wait_for_its_share() -> None:
    session = PageSession()
    session.arrived(0.0, ROWS[:100])
    session.begin_fit()
    session.arrived(0.5, ROWS[100:200])
    session.fit_done(1.0, seconds=30.0)
    session.arrived(1.5, ROWS[200:300])
    assert not session.wants_fit(2.0)
    session.linked(2.0, "ended", "played to its end")
    assert session.wants_fit(2.0)
    session.begin_fit()
    session.fit_done(2.5, seconds=30.0)
    assert not session.wants_fit(1e6)


def test_one_fit_runs_at_a_time_and_of_the_newest_readings() -> None:
    session = PageSession()
    session.arrived(0.0, ROWS[:100])
    session.begin_fit()
    session.arrived(50.0, ROWS[100:200])
    assert not session.wants_fit(60.0)
    session.fit_done(60.0)
    assert session.wants_fit(70.0)
    session.fit()
    assert session.shown.used + session.shown.rejected == 200


def test_a_pause_is_an_exclusion_that_can_be_undone() -> None:
    session = PageSession()
    session.arrived(2.0, ROWS[:100])
    session.requested(2.0, "pause", paused=True)
    session.arrived(4.0, ROWS[100:200])
    assert session.state.excluded_readings == 100
    assert session.state.paused
    session.requested(4.0, "pause", paused=False)
    session.arrived(6.0, ROWS[200:300])
    assert session.used == [*range(100), *range(200, 300)]
    session.requested(6.0, "undo")
    assert len(session.used) == 300


def test_a_fit_of_what_was_there_before_is_not_shown_after_clearing() -> None:
    session = whole()
    session.begin_fit()
    (notice,) = session.requested(60.0, "clear")
    assert notice.severity == "info"
    session.fit_done(60.1)
    assert session.view is None
    assert session.state.readings == 0
    assert session.edits.begun_s == ROWS[-1, 0]


@examples(50)
@given(cuts)
def test_a_page_has_what_the_server_has_whenever_it_came(places: list[int]) -> None:
    """Readings that the server has in memory come as frames; what is there already changes nothing."""
    here, there, buffer = arrive(PageSession(), places), PageSession(), ReadingBuffer.empty(512)
    for begin, end in itertools.pairwise(places):
        buffer = buffer.with_rows(ROWS[begin:end])
    frame = frame_of_buffer(buffer)
    for number in range(2):
        there.received(float(number), frame, is_old=number == 0)
    npt.assert_array_equal(there.held.time, here.held.time[:: buffer.stride])
    npt.assert_array_equal(there.held.field, here.held.field[:: buffer.stride])
    assert (there.state.readings, there.state.seconds) == (here.state.readings, here.state.seconds)


@pytest.mark.parametrize("depth", [100, 20_000])
def test_nested_json_is_refused_in_words(depth: int) -> None:
    with assert_raises(UsageError):
        parse("[" * depth)


@given(st.binary(max_size=200) | st.text(max_size=200))
def test_what_a_page_sends_is_a_message_or_refused(content: bytes | str) -> None:
    words = "a message"
    try:
        parse(content)
    except UsageError as error:
        words = str(error)
    assert words


HISTORY = """
const { Exclusions } = await load("buffer.js");
let exclusions = new Exclusions();
for (let number = 0; number < 1000; number++) exclusions = exclusions.excluding([2 * number, 2 * number + 1]);
return [exclusions.past.length, exclusions.spans.length, exclusions.excluding([9000, 9001]) === exclusions];
"""


def test_history_remembers_a_bounded_number_of_steps() -> None:
    assert run(HISTORY, None) == [200, 1000, True]
