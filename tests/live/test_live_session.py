"""What a page is told of a sensor is what is so: phase, reasons, what changed since the last calibration."""

from __future__ import annotations

import itertools
import re
from base64 import b64decode
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.testing as npt
import pytest
from tests.flight_log import dataflash
from tests.page_session import PageSession, codes, frame_of_buffer, log_of, warnings
from tests.sentences import assert_sentences
from tests.trials import daily

from flinders import simulate
from flinders.apps.live.buffer import ReadingBuffer, rows_of
from flinders.apps.live.session_file import load
from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.fitting import calibrate
from flinders.fitting.result import Refused, with_name
from flinders.likelihood.site_field import Site
from flinders.native import build

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import SimpleNamespace

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

COUNTS = Unit.of("counts")


def after(samples: Samples, session: PageSession | None = None) -> PageSession:
    """A session that has seen these readings and fitted them."""
    session = session or PageSession()
    rows = rows_of(samples)
    session.arrived(float(rows[-1, 0]), rows, samples.unit)
    return fitted(session)


def fitted(session: PageSession) -> PageSession:
    """Fitted, and a second later, in which nothing came."""
    session.fit()
    session.ticked(session.at + 1.0)
    return session


def ticked(session: PageSession, at: float) -> SimpleNamespace:
    """What is shown later."""
    session.ticked(at)
    return session.state


def test_a_tumble_becomes_good() -> None:
    shown = after(simulate.tumble(seed=1).samples).state
    assert (shown.phase, shown.used, shown.rejected, codes(shown)) == ("good", 3000, 0, [])


def test_the_first_seconds_are_collecting_and_nothing_is_wrong() -> None:
    whole = simulate.tumble(seed=1).samples
    for count in (1, 5, 20, 60, 150):
        shown = after(whole[:count]).state
        assert shown.phase == "collecting", (count, shown.words)
        assert not warnings(shown.reasons)


def test_a_source_that_has_sent_nothing_yet_is_waited_for_and_one_that_stops_is_wrong() -> None:
    session = PageSession()
    assert session.linked(3.0, "waiting") == []
    for at in (1.0, 4.0, 4000.0):
        shown = ticked(session, at)
        assert (shown.phase, codes(shown)) == ("waiting", [])
        assert_sentences(shown.words)
    session.arrived(10.0, np.zeros((1, 7)))
    shown = ticked(session, 14.0)
    assert (shown.phase, codes(shown)) == ("wrong", ["nothing-arrives"])
    assert "baud" in shown.words


def test_a_resumed_session_whose_sensor_is_not_on_yet_is_not_wrong() -> None:
    session, buffer = PageSession(), log_of(simulate.tumble(seed=1).samples).buffer
    session.received(0.0, frame_of_buffer(buffer), is_old=True)
    session.fit()
    shown = ticked(session, 10.0)
    assert (shown.phase, codes(shown), shown.reasons[0].severity) == ("good", ["nothing-arrives"], "info")


def test_what_the_feed_says_of_silence_goes_before_what_is_guessed() -> None:
    session = PageSession()
    session.linked(3.5, "waiting", "900 bytes arrived and no line: check --baud")
    (reason,) = session.state.reasons
    assert (reason.code, reason.severity) == ("nothing-arrives", "warning")
    assert_sentences(reason.advice)
    session.arrived(4.0, np.zeros((1, 7)))
    assert session.state.source.link == "connected"


def test_a_slow_sensor_is_given_time() -> None:
    rows = rows_of(simulate.tumble(seed=1, n=20).samples)
    rows[:, 0] = np.arange(20) * 4.0
    session = PageSession()
    session.arrived(76.0, rows)
    assert codes(ticked(session, 86.0)) == []
    assert codes(ticked(session, 100.0)) == ["nothing-arrives"]


def test_a_cable_that_is_pulled_is_said_and_so_is_its_return() -> None:
    session = after(simulate.tumble(seed=1).samples)
    (told,) = session.linked(61.0, "gone", "/dev/ttyACM0 is gone: check the cable")
    assert (session.state.phase, codes(session.state)[0], told.severity) == ("wrong", "gone", "warning")
    assert len(session.linked(62.0, "connected", "/dev/ttyACM0 is back")) == 1
    assert session.state.phase == "good"


def test_a_stuck_axis_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[:, 1] = 7.0
    shown = after(replace(samples, field=field)).state
    assert (shown.phase, codes(shown)) == ("wrong", ["stuck-axis"])


def test_a_sensor_that_stops_measuring_is_stale() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[-150:] = field[-150]
    shown = after(replace(samples, field=field)).state
    assert (shown.phase, codes(shown)[0]) == ("wrong", "stale")
    assert "150 readings" in shown.words


def test_a_sensor_at_its_limit_is_saturated() -> None:
    samples = simulate.tumble(
        seed=1, sensor=simulate.Sensor(offset=np.array([30.0, 0.0, 0.0]), noise=0.3, saturation=60.0)
    ).samples
    shown = after(samples).state
    assert (shown.phase, codes(shown)) == ("wrong", ["saturated"])


def test_a_magnet_that_is_put_beside_it_changes_the_field() -> None:
    shown = after(simulate.tumble(seed=1, disturbances=[simulate.Step(6.0, at=0.5)]).samples).state
    assert shown.phase == "wrong"
    assert {"field-changed", "outliers", "structure", "noise"} & set(codes(shown))


def test_the_interval_in_which_something_stood_beside_it_is_offered_to_be_left_out() -> None:
    samples = simulate.tumble(seed=11, noise=0.4).samples[:2200]
    field = samples.field.copy()
    field[1400:] += (14.0, -9.0, 6.0)  # from 28 s on
    session = after(replace(samples, field=field))
    assert (session.state.phase, warnings(session.state.reasons)) == ("collecting", [])
    ((start, end),) = next(reason.spans for reason in session.state.reasons if reason.spans)
    assert start == pytest.approx(28.0, abs=0.2)
    assert end == pytest.approx(44.0, abs=0.2)
    session.requested(45.0, "exclude", start_s=start, end_s=end)
    assert fitted(session).state.phase == "good"
    session.requested(46.0, "undo")
    assert "outliers" in codes(fitted(session).state)


def test_the_dip_of_a_place_is_that_of_the_world_magnetic_model() -> None:
    session = PageSession()
    (notice,) = session.requested(1.0, "place", latitude_deg=52.5, longitude_deg=13.4, year=2026.5)
    assert session.state.dip_deg == pytest.approx(68.3, abs=0.3)  # Berlin
    assert_sentences(notice.words)
    for place in ((95.0, 0.0, 2026.5), (0.0, 0.0, 1900.0), (-64.0, 136.0, 2026.5)):
        (notice,) = session.requested(2.0, "place", **dict(zip(PLACED, place, strict=True)))
        assert notice.severity in ("warning", "error")
        assert session.state.dip_deg == pytest.approx(68.3, abs=0.3)


PLACED = ("latitude_deg", "longitude_deg", "year")


@pytest.mark.parametrize("unit", ["uT", "counts"])
def test_the_strength_of_a_place_counts_for_readings_in_microtesla(unit: str) -> None:
    tumble = simulate.tumble(seed=1, field_strength=49.9).samples
    session = after(Samples.of(tumble.field, unit=unit, time=tumble.time))
    session.requested(90.0, "place", latitude_deg=52.5, longitude_deg=13.4, year=2026.5)
    view = fitted(session).view
    assert view.field_strength_known == (unit == "uT")
    assert view.heading_error_deg.dip_deg == pytest.approx(68.3, abs=0.3)


def test_a_log_that_states_its_place_is_judged_there_until_somebody_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(b"".join(dataflash()))
    log, words, _ = load(path, "flight.bin")
    assert_sentences(words)
    session = PageSession()
    assert session.state.dip_assumed
    session.opened(1.0, "flight.bin", log)
    shown, view = session.state, session.evaluated().view
    assert (shown.dip_deg, shown.dip_assumed) == (60.2, False)
    assert view.heading_error_deg.dip_deg == pytest.approx(60.2, abs=0.05)
    assert view.field_strength_known
    session.requested(2.0, "place", latitude_deg=52.5, longitude_deg=13.4, year=2026.5)
    assert session.state.dip_deg == pytest.approx(68.3, abs=0.3)
    session.requested(3.0, "back_to_live")
    assert not session.state.dip_assumed


def test_a_sensor_that_lies_still_is_reminded_of_and_not_called_wrong() -> None:
    moving = simulate.tumble(seed=1).samples
    rng = np.random.default_rng(1)
    still = moving.field[-1] + 0.5 * rng.normal(size=(500, 3))
    field = np.concatenate([moving.field, still])
    shown = after(Samples.of(field, unit="uT", time=np.arange(len(field)) / 50.0)).state
    assert (shown.phase, codes(shown)) == ("good", ["no-rotation"])


@pytest.mark.parametrize("noise", [0.02, 0.5, 3.0])
def test_a_sensor_that_has_never_been_turned_is_asked_to_start(noise: float) -> None:
    field = np.array([22.0, -8.0, 41.0]) + noise * np.random.default_rng(1).normal(size=(800, 3))
    shown = after(Samples.of(field, unit="uT", time=np.arange(800) / 50.0)).state
    assert (shown.phase, codes(shown)) == ("collecting", ["no-rotation"])
    assert shown.words.startswith("Start turning")


@pytest.mark.parametrize(("unit", "factor"), [("mG", 10.0), ("G", 0.01), ("nT", 1000.0), ("mT", 0.001)])
def test_readings_in_another_unit_are_recognised(unit: str, factor: float) -> None:
    samples = simulate.tumble(seed=1).samples
    shown = after(replace(samples, field=samples.field * factor)).state
    assert (shown.phase, codes(shown)) == ("wrong", ["wrong-unit"])
    assert_sentences(shown.words)


def test_counts_are_of_no_unit_and_none_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    shown = after(replace(samples, field=samples.field * 16.0, unit=COUNTS)).state
    assert (shown.phase, shown.unit) == ("good", "counts")


def test_a_goal_beyond_level_headings_asks_for_more() -> None:
    session = after(simulate.tumble(seed=1, motion="tilted").samples)
    assert session.state.phase == "limited"
    session.requested(20.5, "goal", goal="attitude")
    assert fitted(session).state.phase == "collecting"
    assert session.view.guidance.direction is not None


def test_a_stricter_target_is_asked_for_and_reached_later() -> None:
    session = after(simulate.tumble(seed=1).samples)
    session.requested(61.0, "target", deg=0.01)
    shown = fitted(session).state
    assert shown.phase == "collecting"
    assert "the target 0.01°" in shown.words


def test_advice_speaks_of_a_vehicle_where_its_axes_are_known() -> None:
    samples = simulate.tumble(seed=1, motion="tilted").samples
    bare = after(samples, PageSession(goal="attitude"))
    known = after(samples, PageSession(goal="attitude", frame="vehicle"))
    assert_sentences(bare.view.guidance.words)
    assert_sentences(known.view.guidance.words)


def test_who_turns_the_sensor_is_led_and_nobody_else() -> None:
    session = after(simulate.tumble(seed=1, motion="tilted").samples, PageSession(goal="attitude"))
    assert session.evaluated().view.guidance.is_path
    session.linked(70.0, "gone")
    assert not session.evaluated().view.guidance.is_path
    session.linked(71.0, "connected")
    session.requested(72.0, "pause", paused=True)
    assert not session.evaluated().view.guidance.is_path
    session.requested(73.0, "pause", paused=False)
    session.opened(74.0, "a.csv", log_of(simulate.tumble(seed=1, motion="tilted").samples))
    assert not session.evaluated().view.guidance.is_path


def test_the_calibration_from_before_holds_or_does_not() -> None:
    sensor = simulate.Sensor(offset=np.array([20.0, -10.0, 5.0]), noise=0.5)
    moved = simulate.Sensor(offset=np.array([23.0, -10.0, 5.0]), noise=0.5)
    before = with_name(calibrate.fit(simulate.tumble(seed=2, sensor=sensor).samples), "monday.json")
    for now, word, low, high in ((sensor, "still holds", 0.0, 0.3), (moved, "no longer holds", 4.0, 9.0)):
        session = after(simulate.tumble(seed=3, sensor=now).samples)
        session.got_previous(61.0, before)
        shown = fitted(session).state.previous
        assert shown.name == "monday.json"
        assert word in shown.words
        assert low <= shown.change_deg <= high  # 3 µT across 25 µT of horizontal field is 6.9°


def test_a_calibration_in_another_unit_is_not_compared_and_says_why() -> None:
    counts = replace(simulate.tumble(seed=2).samples, unit=COUNTS)
    session = after(simulate.tumble(seed=3).samples)
    session.got_previous(61.0, with_name(calibrate.fit(counts), "monday.json"))
    shown = fitted(session).state.previous
    assert shown.change_deg is None
    assert "counts" in shown.words


@pytest.mark.parametrize("is_renewed", [False, True])
def test_a_log_in_other_axes_is_neither_compared_nor_renewed_and_says_why(is_renewed: bool) -> None:
    tumble = simulate.tumble(seed=2).samples
    session = after(tumble)
    session.got_previous(61.0, with_name(calibrate.fit(tumble), "monday.json"))
    assert fitted(session).state.previous.change_deg == pytest.approx(0.0, abs=0.01)
    session.requested(62.0, "refresh", refresh=is_renewed)
    session.opened(63.0, "a.csv", log_of(replace(tumble, axes=Axes.of("x,-y,-z"))))
    shown = fitted(session)
    assert_sentences(shown.shown.refusal if is_renewed else shown.state.previous.words)
    assert shown.state.previous.change_deg is None


EARLIER = with_name(calibrate.fit(simulate.tumble(seed=2).samples), "monday.json")
VEHICLE = simulate.tumble(seed=2).sensor
"""The sensor of it."""


def renewing(earlier: Fit = EARLIER) -> PageSession:
    """A session in which an earlier calibration is to be renewed."""
    session = PageSession()
    session.got_previous(0.0, earlier)
    assert session.requested(0.0, "refresh", refresh=True) == []
    return session


def renewed(sensor: simulate.Sensor, earlier: Fit = EARLIER) -> PageSession:
    """One of a wobble in which that is done."""
    return after(simulate.tumble(seed=3, motion="wobble", n=600, sensor=sensor).samples, renewing(earlier))


def test_the_hard_iron_of_an_earlier_calibration_is_renewed_by_a_wobble() -> None:
    moved = replace(VEHICLE, offset=VEHICLE.offset + np.array([6.0, 0.0, -8.0]))
    session, afresh = renewed(moved), after(simulate.tumble(seed=3, motion="wobble", n=600, sensor=moved).samples)
    shown, view = session.state, session.view
    assert (shown.phase, shown.refreshing) == ("good", True)
    assert afresh.state.phase == "collecting"
    assert view.method == "refresh"
    assert np.all(np.abs(np.array(view.offset) - moved.offset) < 4.0 * np.array(view.offset_sigma))
    assert_sentences(shown.previous.words)


def test_a_renewed_calibration_whose_soft_iron_no_longer_fits_asks_for_a_tumble() -> None:
    bent = replace(VEHICLE, matrix=VEHICLE.matrix @ np.diag([1.12, 1.0, 0.9]))
    samples = simulate.tumble(seed=3, n=3000, sensor=bent).samples
    session = after(samples, renewing())
    shown = session.state
    assert (shown.phase, "soft-iron-changed" in codes(shown)) == ("wrong", True)
    assert_sentences(shown.words)
    session.requested(61.0, "refresh", refresh=False)
    assert fitted(session).state.phase == "good"


def test_renewing_needs_an_earlier_calibration_that_can_be_renewed() -> None:
    session = PageSession()
    (notice,) = session.requested(0.0, "refresh", refresh=True)
    assert_sentences(notice.words)
    session.got_previous(0.0, with_name(calibrate.fit(simulate.tumble(seed=1, motion="level").samples), "flat.json"))
    (notice,) = session.requested(0.0, "refresh", refresh=True)
    assert_sentences(notice.words)
    other = renewed(VEHICLE)
    assert other.state.refreshing
    other.got_previous(99.0, EARLIER)
    assert not other.state.refreshing


def test_a_renewed_calibration_of_another_unit_is_refused_in_words() -> None:
    counts = replace(EARLIER, calibration=replace(EARLIER.calibration, raw=COUNTS))
    shown = renewed(VEHICLE, counts).shown
    assert shown.view is None
    assert_sentences(shown.refusal)


def test_a_log_is_shown_in_place_of_the_sensor_which_goes_on() -> None:
    session = after(simulate.tumble(seed=1, n=500).samples)
    log = simulate.tumble(seed=2, n=800).samples
    session.opened(61.0, "flight.bin", log_of(log))
    session.arrived(62.0, rows_of(log[:100]), log.unit)
    assert (session.state.opened, session.state.readings) == ("flight.bin", 800)
    assert session.held.total == 600
    assert fitted(session).view is not None


def test_a_long_session_is_fitted_from_a_spread_of_its_readings() -> None:
    many = simulate.tumble(seed=1, n=50_000, motion="uniform").samples
    session = PageSession()
    session.arrived(1.0, rows_of(many), many.unit)
    assert 16_000 <= len(session.used) <= 20_000
    assert (np.diff(session.used) == 3).all()


def growing(rows: Floats, every_s: float) -> Iterator[SimpleNamespace]:
    """What is shown of a sensor that is turned, after each of its fits."""
    session = PageSession()
    for at in np.arange(every_s, rows[-1, 0], every_s).tolist():
        session.arrived(at, rows[(rows[:, 0] > session.at) & (rows[:, 0] <= at)])
        session.fit()
        yield session.state


def disturbed_later(start_s: float, **changes: Any) -> PageSession:
    """A session that was good, and beside which something has stood since a time."""
    rows = rows_of(simulate.tumble(seed=11, noise=0.4).samples)
    rows[rows[:, 0] >= start_s, 1:4] += (14.0, -9.0, 6.0)
    session = PageSession(**changes)
    for at in np.arange(1.0, start_s + 12.0).tolist():
        session.arrived(at, rows[(rows[:, 0] > session.at) & (rows[:, 0] <= at)])
        session.fit()
    return session


def test_a_good_result_is_kept_and_it_is_said_that_something_changed() -> None:
    session = disturbed_later(28.0)
    shown = session.state
    assert (shown.phase, shown.kept.is_changed, codes(shown)[0]) == ("good", True, "changed-since")
    assert 27.0 <= shown.kept.seconds <= 34.0
    assert (session.view.verdict, session.shown.view.verdict) == ("good", "limited")
    session.requested(session.at, "finish")
    assert (session.finishing.finished_s, session.finishing.excluded) == (shown.kept.seconds, ())
    assert (session.state.phase, session.state.kept, session.view.verdict) == ("good", None, "good")


def test_all_readings_count_again_where_somebody_says_so() -> None:
    session = disturbed_later(28.0)
    session.requested(session.at, "use_all")
    assert fitted(session).state.kept is None
    assert session.state.phase != "good"
    assert session.finishing.excluded == ()
    session.requested(session.at, "exclude", start_s=28.0, end_s=45.0)
    assert fitted(session).state.phase == "good"


@pytest.mark.parametrize(
    ("change", "is_kept"),
    [
        ({"paused_s": 39.0}, True),
        ({"excluded": ((36.0, 39.0),)}, True),
        ({"excluded": ((10.0, 12.0),)}, False),
        ({"target_deg": 3.0}, False),
    ],
)
def test_edits_of_another_page_end_a_kept_result_only_where_it_depends_on_them(
    change: dict[str, object], is_kept: bool
) -> None:
    session = disturbed_later(28.0)
    session.adopted(session.at, msgspec.structs.replace(session.edits, **change))
    assert (fitted(session).state.kept is not None) is is_kept


def test_what_is_yet_to_come_in_a_pause_is_left_out_in_the_end() -> None:
    """The server may have readings by then that the page has not."""
    session = after(simulate.tumble(seed=1).samples)
    session.requested(session.at, "pause", paused=True)
    assert session.finishing.paused_s == session.edits.paused_s
    assert session.finishing.paused_s is not None


def test_a_log_is_finished_by_its_own_site_and_not_by_that_of_the_sensor() -> None:
    session = after(simulate.tumble(seed=1).samples)
    session.requested(session.at, "place", latitude_deg=47.0, longitude_deg=8.0, year=2026.0)
    session.requested(session.at, "clear")
    there = session.edits.site
    assert there is not None
    site = Site(30.0, 20.0, 0.05, 1.0, z_down=True)
    session.opened(session.at, "log", log_of(simulate.tumble(seed=2).samples)._replace(site=site))
    assert (session.finishing.site, session.finishing.begun_s) == (site, None)
    session.requested(session.at, "place", latitude_deg=0.0, longitude_deg=0.0, year=2026.0)
    assert session.finishing.site not in (site, there)
    assert session.edits.site == there


def test_the_last_readings_of_an_ended_source_do_not_bring_it_back() -> None:
    session = PageSession()
    session.linked(0.0, "ended")
    session.received(0.1, frame_of_buffer(ReadingBuffer.empty().with_rows(rows_of(simulate.tumble(seed=1).samples))))
    assert session.state.source.link == "ended"


@pytest.mark.parametrize(("every_s", "fits"), daily([(0.5, 2), (2.0, 1)]))
def test_a_target_is_reached_when_several_fits_say_so(every_s: float, fits: int) -> None:
    shown = list(itertools.islice(growing(rows_of(simulate.tumble(seed=1).samples), every_s), int(24 / every_s)))
    almost = [one.words.startswith("Almost: ") for one in shown]
    first = almost.index(True)
    assert {one.phase for one in shown[: first + 1]} == {"collecting"}
    held = "".join("a" if is_almost else one.phase[0] for is_almost, one in zip(almost, shown, strict=True))
    assert re.search(rf"[cw]a{{{fits}}}[gl]", held), held
    assert not re.search(r"c[gl]", held), held
    assert shown[-1].phase == "good"
    assert_sentences(shown[-1].words)


def test_a_stricter_target_has_to_be_reached_anew() -> None:
    rows = rows_of(simulate.tumble(seed=1).samples)
    session = PageSession()
    for begin, end in itertools.pairwise((0, 2000, 2100, 2200)):
        session.arrived(float(rows[end, 0]), rows[begin:end])
        session.fit()
    assert session.state.phase == "good"
    session.requested(session.at, "target", deg=0.5)
    assert session.state.words.startswith("Almost: ")


def test_a_limited_calibration_says_up_to_which_tilt_it_holds() -> None:
    shown = after(simulate.tumble(seed=1, motion="tilted").samples).state
    assert shown.phase == "limited"
    assert_sentences(shown.words)


def test_who_turned_it_level_is_told_to_tilt_it_and_not_to_keep_it_level() -> None:
    session = after(simulate.tumble(seed=1, motion="level", noise=0.05).samples)
    assert session.state.phase == "limited"
    assert "while level" in session.state.words
    assert "upside down" in session.state.words
    assert_sentences(session.view.guidance.words)


def test_a_broken_sensor_is_called_wrong_however_far_from_its_target_it_is() -> None:
    """Two sensors that are far apart, in turn: no calibration is near, and more turning would not help."""
    one, other = (
        simulate.tumble(seed=3, n=5000, sensor=simulate.Sensor.random(np.random.default_rng(k))) for k in (5, 77)
    )
    rows = rows_of(one.samples)
    rows[1::2, 1:4] = other.samples.field[1::2]
    shown = list(growing(rows, 21.0))
    assert shown[-1].phase == "wrong", shown[-1].words


def test_what_follows_from_the_first_cause_is_not_said_beside_it() -> None:
    """Columns of no sensor are noise, and no structure as well."""
    tumble = simulate.tumble(seed=11, n=2000).samples
    samples = replace(tumble, field=np.random.default_rng(1).uniform(-50.0, 50.0, (2000, 3)))
    with pytest.raises(Refused) as caught:
        calibrate.fit(samples)
    assert {"noise", "structure"} <= {finding.code for finding in caught.value.fit.findings}
    assert warnings(after(samples).shown.reasons) == ["noise"]


def test_an_axis_that_stops_is_named_while_the_others_move() -> None:
    rows = rows_of(simulate.tumble(seed=3).samples)
    rows[1000:, 2] = rows[1000, 2]
    for total, is_said in ((1000, False), (1050, False), (1110, True), (2000, True)):
        shown = after(Samples.of(rows[:total, 1:4], time=rows[:total, 0])).state
        assert ("frozen-axis" in codes(shown)) == is_said, (total, shown.words)
    assert_sentences(shown.words)


@pytest.mark.parametrize("motion", daily(["hand", "tilted", "level", "sweeps"], 2))
def test_a_sound_sensor_that_is_turned_is_never_called_wrong(motion: str) -> None:
    """Seeds 1 and 2, also with a resolution far coarser than the noise."""
    for seed in (1, 2):
        rows = rows_of(simulate.tumble(seed=seed, motion=motion).samples)
        for step_ut in (0.0, 0.3):
            coarse = rows.copy()
            if step_ut:
                coarse[:, 1:4] = np.round(rows[:, 1:4] / step_ut) * step_ut
            for shown in growing(coarse, 12.0):
                assert shown.phase != "wrong", (seed, step_ut, shown.words)


def test_points_keep_the_acceleration() -> None:
    samples = simulate.tumble(seed=1, n=500).samples
    down = np.tile([0.0, 0.0, 9.81], (500, 1))
    for acceleration in (down, None):
        session = PageSession()
        session.arrived(10.0, rows_of(replace(samples, acceleration=acceleration)))
        drawn = session.points().acceleration
        assert (drawn is not None) == (acceleration is not None)
        if drawn is not None:
            npt.assert_array_equal(np.frombuffer(b64decode(drawn), "<f4").reshape(-1, 3), down.astype("<f4"))


@pytest.mark.parametrize("together", daily([1, 3, 7], 2))
@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_the_rate_is_that_of_the_readings_however_they_come(together: int, speed: float) -> None:
    """50 Hz in batches, also played back ten times as fast."""
    rows = rows_of(simulate.tumble(seed=1).samples)
    session = PageSession()
    for start in range(0, 1000, together):
        new = rows[start : start + together]
        session.arrived(float(new[-1, 0]) / speed, new)
    assert session.state.rate_hz == pytest.approx(50.0, rel=1e-6)
    assert ticked(session, session.at + 2.0).rate_hz is None


def test_what_cannot_be_recorded_is_said_and_the_page_goes_on() -> None:
    session = after(simulate.tumble(seed=1).samples)
    session.unrecorded(61.0, "full.csv: cannot be written: the disk is full")
    assert (session.state.phase, codes(session.state)) == ("good", ["not-recorded"])
    session.unrecorded(62.0, "")
    assert codes(session.state) == []


def test_a_calibration_can_be_sent_to_the_board_that_it_is_of() -> None:
    samples = simulate.tumble(seed=1).samples
    assert not PageSession(hasBoard=True).state.can_send
    assert not after(samples[:60], PageSession(hasBoard=True)).state.can_send
    assert not after(samples).state.can_send
    session = after(samples, PageSession(hasBoard=True))
    assert session.state.can_send
    session.opened(61.0, "a.csv", log_of(samples))
    assert not session.state.can_send
    assert not fitted(session).state.can_send
    session.requested(62.0, "back_to_live")
    assert session.state.can_send


def test_a_result_that_is_kept_can_be_sent_whatever_the_newest_fit_is() -> None:
    session = disturbed_later(28.0, hasBoard=True)
    rows = np.full((5000, 7), np.nan)
    rows[:, 0] = session.at + 0.01 * np.arange(5000)
    rows[:, 1:4] = np.random.default_rng(1).uniform(-500.0, 500.0, (5000, 3))
    session.arrived(session.at + 50.0, rows)
    session.fit()
    assert (session.shown.record, session.state.kept is None) == (None, False)
    assert session.state.can_send


def test_a_stretch_that_is_one_too_many_is_refused_with_advice() -> None:
    session = after(simulate.tumble(seed=1).samples)
    for stretch in range(1000):
        assert session.requested(61.0, "exclude", start_s=0.05 * stretch, end_s=0.05 * stretch + 0.02) == []
    (notice,) = session.requested(62.0, "exclude", start_s=55.0, end_s=56.0)
    assert_sentences(notice.words)
    assert session.requested(63.0, "exclude", start_s=10.0, end_s=20.0) == []
    assert session.requested(64.0, "exclude", start_s=55.0, end_s=56.0) == []
    assert len(session.state.excluded) < 900


def test_a_span_beyond_all_sense_is_clipped_to_the_session() -> None:
    session = after(simulate.tumble(seed=1).samples)
    session.requested(61.0, "exclude", start_s=1e6, end_s=1e308)
    assert (session.state.excluded, session.state.can_undo) == ([], False)
    session.requested(61.0, "exclude", start_s=-1e308, end_s=1.0)
    assert session.state.excluded == [[0.0, 1.0]]


def test_a_log_is_neither_paused_nor_started_again() -> None:
    session = after(simulate.tumble(seed=1, n=500).samples)
    session.opened(61.0, "flight.bin", log_of(simulate.tumble(seed=2, n=800).samples))
    for command in ({"type": "pause", "paused": True}, {"type": "clear"}):
        (notice,) = session.requested(62.0, **command)
        assert notice.severity == "warning"
        assert_sentences(notice.words)
    assert (session.state.readings, session.state.paused) == (800, False)
    session.requested(63.0, "exclude", start_s=0.0, end_s=1.0)
    session.requested(64.0, "back_to_live")
    assert (session.state.readings, session.state.excluded, session.state.opened) == (500, [], None)


def test_what_goes_wrong_in_the_page_itself_is_a_refusal_in_words() -> None:
    session = PageSession(frame="nowhere")
    session.arrived(1.0, rows_of(simulate.tumble(seed=1, n=500).samples))
    session.fit()
    shown = session.state
    assert (shown.phase, session.view) == ("collecting", None)
    assert_sentences(shown.words)
