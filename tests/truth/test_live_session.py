"""What a page is told of a sensor is what is so: phase, reasons, what changed since the last calibration."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.flight_log import dataflash
from tests.trials import daily

from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import UnitError, UsageError
from flinders.fitting import calibrate
from flinders.live.buffer import ReadingBuffer, rows_of
from flinders.live.evaluation import WHILE_LEVEL, evaluate, finished
from flinders.live.messages import (
    BackToLive,
    Exclude,
    Notice,
    Reason,
    SessionState,
    SetGoal,
    SetPlace,
    SetRefresh,
    SetTarget,
    SourceState,
    Undo,
)
from flinders.live.page_state import session_state
from flinders.live.session import (
    Arrived,
    FitDone,
    GotPrevious,
    Linked,
    LiveSession,
    Opened,
    Requested,
    Series,
    Ticked,
    Unrecorded,
    begin_fit,
    step,
    used_readings,
)
from flinders.live.session_file import load

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

SENSOR = SourceState("/dev/ttyACM0", "serial", "connected", "")


def after(samples: Samples, session: LiveSession | None = None, **changes: object) -> LiveSession:
    """A session that has seen these readings and fitted them."""
    session = session or LiveSession(source=SENSOR)
    rows = rows_of(samples)
    session, _ = step(session, Arrived(float(rows[-1, 0]), rows, samples.unit))
    session = replace(session, **changes)  # type: ignore[arg-type]
    return fitted(session)


def fitted(session: LiveSession) -> LiveSession:
    """Fitted, and a second later, in which nothing came."""
    session = begin_fit(session)
    session, _ = step(session, FitDone(session.at, evaluate(session), 0.01))
    return step(session, Ticked(session.at + 1.0))[0]


def codes(shown: SessionState) -> list[str]:
    return [reason.code for reason in shown.reasons]


def test_a_tumble_becomes_good() -> None:
    shown = session_state(after(simulate.tumble(seed=1).samples))
    assert (shown.phase, shown.used, shown.rejected, codes(shown)) == ("good", 3000, 0, [])


def test_the_first_seconds_are_collecting_and_nothing_is_wrong() -> None:
    whole = simulate.tumble(seed=1).samples
    for count in (1, 5, 20, 60, 150):
        shown = session_state(after(whole[:count]))
        assert shown.phase == "collecting", (count, shown.words)
        assert not [reason for reason in shown.reasons if reason.severity == "warning"]


def test_a_source_that_has_sent_nothing_yet_is_waited_for_and_one_that_stops_is_wrong() -> None:
    session, notices = step(LiveSession(source=SENSOR), Linked(3.0, "waiting", ""))
    for at in (1.0, 4.0, 4000.0):
        shown = session_state(step(session, Ticked(at))[0])
        assert (shown.phase, shown.words, codes(shown)) == ("waiting", "Waiting for readings from /dev/ttyACM0.", [])
    assert notices == []
    session, _ = step(session, Arrived(10.0, np.zeros((1, 7)), Unit.of("uT")))
    shown = session_state(step(session, Ticked(14.0))[0])
    assert (shown.phase, codes(shown)) == ("wrong", ["nothing-arrives"])
    assert "baud" in shown.words


def test_a_resumed_session_whose_sensor_is_not_on_yet_is_not_wrong() -> None:
    live = after(simulate.tumble(seed=1).samples).live
    shown = session_state(step(LiveSession(source=SENSOR, live=live), Ticked(10.0))[0])
    assert (shown.phase, codes(shown), shown.reasons[0].severity) == ("good", ["nothing-arrives"], "info")


def test_what_the_feed_says_of_silence_goes_before_what_is_guessed() -> None:
    session, _ = step(LiveSession(source=SENSOR), Linked(3.5, "waiting", "900 bytes arrived and no line: check --baud"))
    assert session_state(session).reasons == (Reason("nothing-arrives", "900 bytes arrived and no line: check --baud"),)
    session, _ = step(session, Arrived(4.0, np.zeros((1, 7)), Unit.of("uT")))
    assert session_state(session).source.link == "connected"


def test_a_slow_sensor_is_given_time() -> None:
    rows = rows_of(simulate.tumble(seed=1, n=20).samples)
    rows[:, 0] = np.arange(20) * 4.0
    session, _ = step(LiveSession(source=SENSOR), Arrived(76.0, rows, Unit.of("uT")))
    assert codes(session_state(step(session, Ticked(86.0))[0])) == []
    assert codes(session_state(step(session, Ticked(100.0))[0])) == ["nothing-arrives"]


def test_a_cable_that_is_pulled_is_said_and_so_is_its_return() -> None:
    session = after(simulate.tumble(seed=1).samples)
    gone, told = step(session, Linked(61.0, "gone", "/dev/ttyACM0 is gone: check the cable"))
    assert (session_state(gone).phase, codes(session_state(gone))[0], told[0].severity) == ("wrong", "gone", "warning")
    back, told = step(gone, Linked(62.0, "connected", "/dev/ttyACM0 is back"))
    assert session_state(back).phase == "good"
    assert len(told) == 1


def test_a_stuck_axis_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[:, 1] = 7.0
    shown = session_state(after(replace(samples, field=field)))
    assert (shown.phase, codes(shown)) == ("wrong", ["stuck-axis"])


def test_a_sensor_that_stops_measuring_is_stale() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[-150:] = field[-150]
    shown = session_state(after(replace(samples, field=field)))
    assert (shown.phase, codes(shown)[0]) == ("wrong", "stale")
    assert "150 readings" in shown.words


def test_a_sensor_at_its_limit_is_saturated() -> None:
    samples = simulate.tumble(
        seed=1, sensor=simulate.Sensor(offset=np.array([30.0, 0.0, 0.0]), noise=0.3, saturation=60.0)
    ).samples
    shown = session_state(after(samples))
    assert (shown.phase, codes(shown)) == ("wrong", ["saturated"])


def test_a_magnet_that_is_put_beside_it_changes_the_field() -> None:
    samples = simulate.tumble(seed=1, disturbances=[simulate.Step(6.0, at=0.5)]).samples
    shown = session_state(after(samples))
    assert shown.phase == "wrong"
    assert {"field-changed", "outliers", "structure", "noise"} & set(codes(shown))


def test_the_interval_in_which_something_stood_beside_it_is_offered_to_be_left_out() -> None:
    samples = simulate.tumble(seed=11, noise=0.4).samples[:2200]
    field = samples.field.copy()
    field[1400:] += (14.0, -9.0, 6.0)  # from 28 s on
    session = after(replace(samples, field=field))
    reasons = [reason for reason in session_state(session).reasons if reason.severity == "warning"]
    ((start, end),) = reasons[0].spans
    assert start == pytest.approx(28.0, abs=0.2)
    assert end == pytest.approx(44.0, abs=0.2)
    session = fitted(step(session, Requested(45.0, Exclude(start, end)))[0])
    assert session_state(session).phase == "good"
    assert "outliers" in codes(session_state(fitted(step(session, Requested(46.0, Undo()))[0])))


def test_the_dip_of_a_place_is_that_of_the_world_magnetic_model() -> None:
    session, (notice,) = step(LiveSession(), Requested(1.0, SetPlace(52.5, 13.4, 2026.5)))
    assert session.dip_deg == pytest.approx(68.3, abs=0.3)  # Berlin
    assert "the strength of the field 50.1 µT (WMM-2025" in notice.words
    for place in (SetPlace(95.0, 0.0, 2026.5), SetPlace(0.0, 0.0, 1900.0), SetPlace(-64.0, 136.0, 2026.5)):
        with pytest.raises(UsageError):
            step(session, Requested(2.0, place))


@pytest.mark.parametrize("unit", ["uT", "counts"])
def test_the_strength_of_a_place_counts_for_readings_in_microtesla(unit: str) -> None:
    tumble = simulate.tumble(seed=1, field_strength=49.9).samples
    session, _ = step(
        after(Samples.of(tumble.field, unit=unit, time=tumble.time)), Requested(90.0, SetPlace(52.5, 13.4, 2026.5))
    )
    fit = evaluate(session).fit
    assert fit is not None
    assert fit.calibration.field_strength_known == (unit == "uT")
    assert fit.claim.dip_deg == pytest.approx(68.3, abs=0.3)


def test_a_log_that_states_its_place_is_judged_there_until_somebody_says_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(b"".join(dataflash()))
    series, words, _ = load(path, "flight.bin")
    assert "the log says where and when: WMM-2025 at 43.77, 11.26" in words
    assert session_state(LiveSession()).dip_assumed
    session, _ = step(LiveSession(), Opened(1.0, "flight.bin", series, words))
    shown, fit = session_state(session), evaluate(session).fit
    assert (shown.dip_deg, shown.dip_assumed) == (60.2, False)
    assert fit is not None
    assert fit.claim.dip_deg == pytest.approx(60.2, abs=0.05)
    assert fit.calibration.field_strength_known
    session, _ = step(session, Requested(2.0, SetPlace(52.5, 13.4, 2026.5)))
    assert session_state(session).dip_deg == pytest.approx(68.3, abs=0.3)
    assert session.shown.site is not None
    assert session.shown.site.strength == pytest.approx(50.1, abs=0.1)
    session, _ = step(session, Requested(3.0, BackToLive()))
    assert not session_state(session).dip_assumed


def test_a_sensor_that_lies_still_is_reminded_of_and_not_called_wrong() -> None:
    moving = simulate.tumble(seed=1).samples
    rng = np.random.default_rng(1)
    still = moving.field[-1] + 0.5 * rng.normal(size=(500, 3))
    field = np.concatenate([moving.field, still])
    shown = session_state(after(Samples.of(field, unit="uT", time=np.arange(len(field)) / 50.0)))
    assert (shown.phase, codes(shown)) == ("good", ["no-rotation"])


@pytest.mark.parametrize("noise", [0.02, 0.5, 3.0])
def test_a_sensor_that_has_never_been_turned_is_asked_to_start(noise: float) -> None:
    field = np.array([22.0, -8.0, 41.0]) + noise * np.random.default_rng(1).normal(size=(800, 3))
    shown = session_state(after(Samples.of(field, unit="uT", time=np.arange(800) / 50.0)))
    assert (shown.phase, codes(shown)) == ("collecting", ["no-rotation"])
    assert shown.words.startswith("Start turning")


@pytest.mark.parametrize(("unit", "factor"), [("mG", 10.0), ("G", 0.01), ("nT", 1000.0), ("mT", 0.001)])
def test_readings_in_another_unit_are_recognised(unit: str, factor: float) -> None:
    samples = simulate.tumble(seed=1).samples
    shown = session_state(after(replace(samples, field=samples.field * factor)))
    assert (shown.phase, codes(shown)) == ("wrong", ["wrong-unit"])
    assert f"try {unit} as their unit" in shown.words


def test_counts_are_of_no_unit_and_none_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    shown = session_state(after(replace(samples, field=samples.field * 16.0, unit=Unit.of("counts"))))
    assert (shown.phase, shown.unit) == ("good", "counts")


def test_a_goal_beyond_level_headings_asks_for_more() -> None:
    session = after(simulate.tumble(seed=1, motion="tilted").samples)
    assert session_state(session).phase == "limited"
    wished = fitted(step(session, Requested(20.5, SetGoal("attitude")))[0])
    assert session_state(wished).phase == "collecting"
    assert wished.view is not None
    assert wished.view.guidance is not None
    assert wished.view.guidance.direction is not None


def test_a_stricter_target_is_asked_for_and_reached_later() -> None:
    session = after(simulate.tumble(seed=1).samples)
    stricter = fitted(step(session, Requested(61.0, SetTarget(0.01)))[0])
    assert session_state(stricter).phase == "collecting"
    assert "the target 0.01°" in session_state(stricter).words


def test_advice_speaks_of_a_vehicle_where_its_axes_are_known() -> None:
    samples = simulate.tumble(seed=1, motion="tilted").samples
    bare = after(samples, goal="attitude")
    known = after(samples, LiveSession(source=SENSOR, live=Series(axes=Axes.of("x,y,-z"))), goal="attitude")
    assert bare.view is not None
    assert bare.view.guidance is not None
    assert re.search(r"about [xyz] \([xyz] towards [xyz]\)", bare.view.guidance.words)
    assert known.view is not None
    assert known.view.guidance is not None
    assert re.search(r"its (nose|left|right)", known.view.guidance.words)


def test_the_calibration_from_before_agrees_or_does_not() -> None:
    sensor = simulate.Sensor(offset=np.array([20.0, -10.0, 5.0]), noise=0.5)
    moved = simulate.Sensor(offset=np.array([23.0, -10.0, 5.0]), noise=0.5)
    before = calibrate.fit(simulate.tumble(seed=2, sensor=sensor).samples).with_name("monday.json")
    for now, word, low, high in ((sensor, "agrees", 0.0, 0.3), (moved, "contradicts", 4.0, 9.0)):
        session = after(simulate.tumble(seed=3, sensor=now).samples)
        session = fitted(step(session, GotPrevious(61.0, before))[0])
        shown = session_state(session).previous
        assert shown is not None
        assert shown.change_deg is not None
        assert word in shown.words
        assert low <= shown.change_deg <= high  # 3 µT across 25 µT of horizontal field is 6.9°


def test_a_calibration_in_another_unit_is_not_compared_and_says_why() -> None:
    counts = replace(simulate.tumble(seed=2).samples, unit=Unit.of("counts"))
    before = calibrate.fit(counts).with_name("monday.json")
    session = after(simulate.tumble(seed=3).samples)
    shown = session_state(fitted(step(session, GotPrevious(61.0, before))[0])).previous
    assert shown is not None
    assert shown.change_deg is None
    assert "counts" in shown.words


EARLIER = calibrate.fit(simulate.tumble(seed=2).samples).with_name("monday.json")
VEHICLE = simulate.tumble(seed=2).sensor
"""The sensor of it."""


def renewed(sensor: simulate.Sensor, earlier: Fit = EARLIER, **changes: object) -> LiveSession:
    """A session of a wobble in which an earlier calibration is renewed."""
    session, _ = step(LiveSession(source=SENSOR), GotPrevious(0.0, earlier))
    session, _ = step(session, Requested(0.0, SetRefresh(refresh=True)))
    samples = simulate.tumble(seed=3, motion="wobble", n=600, sensor=sensor).samples
    return after(replace(samples, **changes), session)  # type: ignore[arg-type]


def test_the_hard_iron_of_an_earlier_calibration_is_renewed_by_a_wobble() -> None:
    moved = replace(VEHICLE, offset=VEHICLE.offset + np.array([6.0, 0.0, -8.0]))
    session, afresh = renewed(moved), after(simulate.tumble(seed=3, motion="wobble", n=600, sensor=moved).samples)
    shown, fit = session_state(session), session.shown.evaluated.fit
    assert (shown.phase, shown.refreshing) == ("good", True)
    assert fit is not None
    assert session_state(afresh).phase == "collecting"
    assert (fit.method, finished(session, None, {}).fit.method) == ("refresh", "refresh")
    assert np.all(np.abs(fit.calibration.offset - moved.offset) < 4.0 * fit.claim.offset_sigma)
    assert shown.previous is not None
    assert shown.previous.words.startswith("its soft iron is kept; the offset has moved by 10.0 µT")


def test_a_renewed_calibration_whose_soft_iron_no_longer_fits_asks_for_a_tumble() -> None:
    bent = replace(VEHICLE, matrix=VEHICLE.matrix @ np.diag([1.12, 1.0, 0.9]))
    samples = simulate.tumble(seed=3, n=3000, sensor=bent).samples
    session, _ = step(LiveSession(source=SENSOR), GotPrevious(0.0, EARLIER))
    session, _ = step(session, Requested(0.0, SetRefresh(refresh=True)))
    shown = session_state(after(samples, session))
    assert (shown.phase, "soft-iron-changed" in codes(shown)) == ("wrong", True)
    assert re.search("soft iron of monday.json no longer fits.* tumble the sensor again", shown.words)
    session, _ = step(session, Requested(61.0, SetRefresh(refresh=False)))
    assert session_state(after(samples, session)).phase == "good"


def test_renewing_needs_an_earlier_calibration_that_can_be_renewed() -> None:
    asked = Requested(0.0, SetRefresh(refresh=True))
    with pytest.raises(UsageError, match="choose its file first"):
        step(LiveSession(source=SENSOR), asked)
    flat = calibrate.fit(simulate.tumble(seed=1, motion="level").samples).with_name("flat.json")
    session, _ = step(LiveSession(source=SENSOR), GotPrevious(0.0, flat))
    with pytest.raises(UsageError, match=r"flat\.json comes from a level turn"):
        step(session, asked)
    other, _ = step(renewed(VEHICLE), GotPrevious(99.0, EARLIER))
    assert not session_state(other).refreshing


def test_a_renewed_calibration_of_another_unit_is_refused_in_words() -> None:
    counts = replace(EARLIER, calibration=replace(EARLIER.calibration, raw=Unit.of("counts")))
    with pytest.raises(UnitError, match=r"monday\.json is for readings in counts"):
        renewed(VEHICLE, counts)


def test_a_log_is_shown_in_place_of_the_sensor_which_goes_on() -> None:
    session = after(simulate.tumble(seed=1, n=500).samples)
    log = simulate.tumble(seed=2, n=800).samples
    buffer = ReadingBuffer.empty().extended(rows_of(log))
    session, _ = step(
        session, Opened(61.0, "flight.bin", Series(buffer, log.unit, log.axes, "sensor"), "flight.bin: 800")
    )
    session, _ = step(session, Arrived(62.0, rows_of(log[:100]), log.unit))
    assert (session_state(session).opened, session_state(session).readings) == ("flight.bin", 800)
    assert session.live.buffer.total == 600
    assert fitted(session).view is not None


def test_a_long_session_is_fitted_from_a_spread_of_its_readings() -> None:
    many = simulate.tumble(seed=1, n=50_000, motion="uniform").samples
    samples, numbers = used_readings(step(LiveSession(), Arrived(1.0, rows_of(many), many.unit))[0])
    assert 16_000 <= len(samples) <= 20_000
    assert (np.diff(numbers) == 3).all()


def growing(rows: Floats, every_s: float) -> Iterator[SessionState]:
    """What is shown of a sensor that is turned, after each of its fits."""
    session = LiveSession(source=SENSOR)
    for at in np.arange(every_s, rows[-1, 0], every_s).tolist():
        new = rows[(rows[:, 0] > session.at) & (rows[:, 0] <= at)]
        session, _ = step(session, Arrived(at, new, Unit.of("uT")))
        session, _ = step(begin_fit(session), FitDone(at, evaluate(session), 0.01))
        yield session_state(session)


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
    assert re.search(r"to expect is [\d.]+° \(95 % within [\d.]+°\), the target 1°", shown[-1].words)


def test_a_stricter_target_has_to_be_reached_anew() -> None:
    rows = rows_of(simulate.tumble(seed=1).samples)
    session = LiveSession(source=SENSOR)
    for cut in (2000, 2100, 2200):
        session, _ = step(session, Arrived(float(rows[cut, 0]), rows[session.live.buffer.total : cut], Unit.of("uT")))
        session, _ = step(begin_fit(session), FitDone(session.at, evaluate(session), 0.01))
    assert session_state(session).phase == "good"
    session, _ = step(session, Requested(session.at, SetTarget(0.5)))
    assert session_state(session).words.startswith("Almost: ")


def test_a_limited_calibration_says_up_to_which_tilt_it_holds() -> None:
    shown = session_state(after(simulate.tumble(seed=1, motion="tilted").samples))
    assert shown.phase == "limited"
    assert re.search(r"up to \d+° of tilt; for more tilt than that, turn it", shown.words), shown.words


def test_who_turned_it_level_is_told_to_tilt_it_for_other_attitudes_alone() -> None:
    session = after(simulate.tumble(seed=1, motion="level", noise=0.05).samples)
    assert session_state(session).phase == "limited"
    assert "while level" in session_state(session).words
    for goal in ("heading", "attitude"):
        wished = fitted(step(session, Requested(20.5, SetGoal(goal)))[0])
        assert wished.view is not None
        assert wished.view.guidance is not None
        assert wished.view.guidance.words == WHILE_LEVEL[goal]
        assert (wished.view.level_deg is None) == (goal == "attitude")
    assert "upside down" not in WHILE_LEVEL["heading"]


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
    tumble = simulate.tumble(seed=11, n=2000)
    noise = np.random.default_rng(1).uniform(-50.0, 50.0, (2000, 3))
    session = after(replace(tumble.samples, field=noise))
    fit = session.shown.evaluated.fit
    assert fit is not None
    assert {"noise", "structure"} <= {finding.code for finding in fit.findings}
    assert [reason.code for reason in session.shown.evaluated.reasons if reason.severity == "warning"] == ["noise"]


def test_an_axis_that_stops_is_named_while_the_others_move() -> None:
    rows = rows_of(simulate.tumble(seed=3).samples)
    rows[1000:, 2] = rows[1000, 2]
    for total, is_said in ((1000, False), (1050, False), (1110, True), (2000, True)):
        shown = session_state(after(Samples.of(rows[:total, 1:4], time=rows[:total, 0])))
        assert ("frozen-axis" in codes(shown)) == is_said, (total, shown.words)
    assert shown.words.startswith("Axis y has been the same for 20.0 s while the others change")


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


def test_what_is_fitted_keeps_the_acceleration() -> None:
    samples = simulate.tumble(seed=1, n=500).samples
    down = np.tile([0.0, 0.0, 9.81], (500, 1))
    session = after(replace(samples, acceleration=down))
    kept = used_readings(session)[0].acceleration
    assert kept is not None
    npt.assert_array_equal(kept, down)
    assert used_readings(after(replace(samples, acceleration=None)))[0].acceleration is None


@pytest.mark.parametrize("together", daily([1, 3, 7], 2))
@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_the_rate_is_that_of_the_readings_however_they_come(together: int, speed: float) -> None:
    """50 Hz in batches, also played back ten times as fast."""
    rows = rows_of(simulate.tumble(seed=1).samples)
    session = LiveSession(source=SENSOR)
    for start in range(0, 1000, together):
        new = rows[start : start + together]
        session, _ = step(session, Arrived(float(new[-1, 0]) / speed, new, Unit.of("uT")))
    rate = session_state(session).rate_hz
    assert rate == pytest.approx(50.0, rel=1e-6)
    silent, _ = step(session, Ticked(session.at + 2.0))
    assert session_state(silent).rate_hz is None


def test_what_cannot_be_recorded_is_said_and_the_page_goes_on() -> None:
    session = after(simulate.tumble(seed=1).samples)
    broken, told = step(session, Unrecorded(61.0, "full.csv: cannot be written: the disk is full"))
    assert [(one.severity, one.words) for one in told] == [("error", broken.unrecorded)]
    assert (session_state(broken).phase, codes(session_state(broken))) == ("good", ["not-recorded"])
    mended, told = step(broken, Unrecorded(62.0, ""))
    assert codes(session_state(mended)) == []
    assert told == [Notice("info", "what arrives is recorded again")]


def test_a_calibration_can_be_sent_to_the_board_that_it_is_of() -> None:
    samples = simulate.tumble(seed=1).samples
    board = LiveSession(source=SENSOR, has_board=True)
    assert not session_state(board).can_send
    assert not session_state(after(samples[:60], board)).can_send
    assert not session_state(after(samples)).can_send
    ready = after(samples, board)
    assert session_state(ready).can_send
    buffer = ReadingBuffer.empty().extended(rows_of(samples))
    opened, _ = step(
        ready, Opened(61.0, "a.csv", Series(buffer, samples.unit, samples.axes, "sensor"), "a.csv: 3,000 readings")
    )
    assert not session_state(opened).can_send
    assert not session_state(fitted(opened)).can_send
    assert session_state(step(opened, Requested(62.0, BackToLive()))[0]).can_send


def test_a_span_beyond_all_sense_is_clipped_to_the_session() -> None:
    session = after(simulate.tumble(seed=1).samples)
    taken, _ = step(session, Requested(61.0, Exclude(-1e308, 1.0)))
    assert session_state(taken).excluded == ((0.0, 1.0),)
    nothing, _ = step(session, Requested(61.0, Exclude(1e6, 1e308)))
    assert (session_state(nothing).excluded, session_state(nothing).can_undo) == ((), False)
