"""What a page is told of a sensor is what is so: phase, reasons, what changed since the last calibration."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from flinders import fitting, simulate
from flinders.axes import Axes
from flinders.judged import Judged
from flinders.live.messages import Reason, SetGoal, SourceState, State, Target
from flinders.live.session import (
    Arrived,
    Asked,
    Fitted,
    GotPrevious,
    Linked,
    Opened,
    Session,
    Stretch,
    Ticked,
    begin_fit,
    rows_of,
    snapshot,
    state,
    step,
)
from flinders.live.snapshot import evaluate
from flinders.live.track import Track
from flinders.samples import Samples
from flinders.units import Unit

SENSOR = SourceState("/dev/ttyACM0", "serial", "connected", "")


def after(samples: Samples, session: Session | None = None, **changes: object) -> Session:
    """A session that has seen these readings and fitted them."""
    session = session or Session(source=SENSOR)
    rows = rows_of(samples)
    session, _ = step(session, Arrived(float(rows[-1, 0]), rows, samples.unit))
    session = replace(session, **changes)  # type: ignore[arg-type]
    return fitted(session)


def fitted(session: Session) -> Session:
    session = begin_fit(session)
    return step(session, Fitted(session.at, evaluate(snapshot(session)), 0.01))[0]


def codes(shown: State) -> list[str]:
    return [reason.code for reason in shown.reasons]


def test_a_tumble_becomes_good() -> None:
    shown = state(after(simulate.tumble(seed=1).samples))
    assert (shown.phase, shown.used, shown.rejected, codes(shown)) == ("good", 3000, 0, [])


def test_the_first_seconds_are_collecting_and_nothing_is_wrong() -> None:
    whole = simulate.tumble(seed=1).samples
    for count in (1, 5, 20, 60, 150):
        shown = state(after(whole[:count]))
        assert shown.phase == "collecting", (count, shown.words)
        assert not [reason for reason in shown.reasons if reason.severity == "warning"]


def test_before_the_first_reading_it_waits_and_then_says_so() -> None:
    session, _ = step(Session(source=SENSOR), Ticked(1.0))
    assert state(session).words == "Waiting for the first reading."
    session, _ = step(session, Ticked(4.0))
    assert (state(session).phase, codes(state(session))) == ("wrong", ["nothing-arrives"])
    assert "baud" in state(session).words


def test_what_the_feed_says_of_silence_goes_before_what_is_guessed() -> None:
    session, _ = step(Session(source=SENSOR), Linked(3.5, "waiting", "900 bytes arrived and no line: check --baud"))
    assert state(session).reasons == (Reason("nothing-arrives", "900 bytes arrived and no line: check --baud"),)
    session, _ = step(session, Arrived(4.0, np.zeros((1, 7)), Unit.of("uT")))
    assert state(session).source.link == "connected"


def test_a_slow_sensor_is_given_time() -> None:
    rows = rows_of(simulate.tumble(seed=1, n=20).samples)
    rows[:, 0] = np.arange(20) * 4.0
    session, _ = step(Session(source=SENSOR), Arrived(76.0, rows, Unit.of("uT")))
    assert codes(state(step(session, Ticked(86.0))[0])) == []
    assert codes(state(step(session, Ticked(100.0))[0])) == ["nothing-arrives"]


def test_a_cable_that_is_pulled_is_said_and_so_is_its_return() -> None:
    session = after(simulate.tumble(seed=1).samples)
    gone, told = step(session, Linked(61.0, "gone", "/dev/ttyACM0 is gone: check the cable"))
    assert (state(gone).phase, codes(state(gone))[0], told[0].severity) == ("wrong", "gone", "warning")  # type: ignore[union-attr]
    back, told = step(gone, Linked(62.0, "connected", "/dev/ttyACM0 is back"))
    assert state(back).phase == "good"
    assert len(told) == 1


def test_a_stuck_axis_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[:, 1] = 7.0
    shown = state(after(replace(samples, field=field)))
    assert (shown.phase, codes(shown)) == ("wrong", ["stuck-axis"])


def test_a_sensor_that_stops_measuring_is_stale() -> None:
    samples = simulate.tumble(seed=1).samples
    field = samples.field.copy()
    field[-150:] = field[-150]
    shown = state(after(replace(samples, field=field)))
    assert (shown.phase, codes(shown)[0]) == ("wrong", "stale")
    assert "150 readings" in shown.words


def test_a_sensor_at_its_limit_is_saturated() -> None:
    samples = simulate.tumble(
        seed=1, sensor=simulate.Sensor(offset=np.array([30.0, 0.0, 0.0]), noise=0.3, limit=60.0)
    ).samples
    shown = state(after(samples))
    assert (shown.phase, codes(shown)) == ("wrong", ["saturated"])


def test_a_magnet_that_is_put_beside_it_changes_the_field() -> None:
    samples = simulate.tumble(seed=1, disturbances=[simulate.Step(6.0, at=0.5)]).samples
    shown = state(after(samples))
    assert shown.phase == "wrong"
    assert {"field-changed", "strays", "structure", "noise"} & set(codes(shown))


def test_a_sensor_that_lies_still_is_reminded_of_and_not_called_wrong() -> None:
    moving = simulate.tumble(seed=1).samples
    rng = np.random.default_rng(1)
    still = moving.field[-1] + 0.5 * rng.normal(size=(500, 3))
    field = np.concatenate([moving.field, still])
    shown = state(after(Samples.of(field, unit="uT", time=np.arange(len(field)) / 50.0)))
    assert (shown.phase, codes(shown)) == ("good", ["no-rotation"])


@pytest.mark.parametrize(("unit", "factor"), [("mG", 10.0), ("G", 0.01), ("nT", 1000.0), ("mT", 0.001)])
def test_readings_in_another_unit_are_recognised(unit: str, factor: float) -> None:
    samples = simulate.tumble(seed=1).samples
    shown = state(after(replace(samples, field=samples.field * factor)))
    assert (shown.phase, codes(shown)) == ("wrong", ["wrong-unit"])
    assert f"--unit {unit}" in shown.words


def test_counts_are_of_no_unit_and_none_is_wrong() -> None:
    samples = simulate.tumble(seed=1).samples
    shown = state(after(replace(samples, field=samples.field * 16.0, unit=Unit.of("counts"))))
    assert (shown.phase, shown.unit) == ("good", "counts")


def test_a_goal_beyond_level_headings_asks_for_more() -> None:
    session = after(simulate.tumble(seed=1, motion="tilted").samples)
    assert state(session).phase == "limited"
    wished = fitted(step(session, Asked(20.5, SetGoal("attitude")))[0])
    assert state(wished).phase == "collecting"
    assert wished.view is not None
    assert wished.view.guidance is not None
    assert wished.view.guidance.direction is not None


def test_a_stricter_target_is_asked_for_and_reached_later() -> None:
    session = after(simulate.tumble(seed=1).samples)
    stricter = fitted(step(session, Asked(61.0, Target(0.01)))[0])
    assert state(stricter).phase == "collecting"
    assert "the target 0.01°" in state(stricter).words


def test_advice_speaks_of_a_vehicle_where_its_axes_are_known() -> None:
    samples = simulate.tumble(seed=1, motion="tilted").samples
    bare = after(samples, goal="attitude")
    known = after(samples, Session(source=SENSOR, live=Stretch(axes=Axes.of("x,y,-z"))), goal="attitude")
    assert bare.view is not None
    assert bare.view.guidance is not None
    assert re.search(r"about [xyz] \([xyz] towards [xyz]\)", bare.view.guidance.words)
    assert known.view is not None
    assert known.view.guidance is not None
    assert re.search(r"its (nose|left|right)", known.view.guidance.words)


def test_the_calibration_from_before_agrees_or_does_not() -> None:
    sensor = simulate.Sensor(offset=np.array([20.0, -10.0, 5.0]), noise=0.5)
    moved = simulate.Sensor(offset=np.array([23.0, -10.0, 5.0]), noise=0.5)
    before = Judged.from_fit(fitting.fit(simulate.tumble(seed=2, sensor=sensor).samples), name="monday.json")
    for now, word, low, high in ((sensor, "agrees", 0.0, 0.3), (moved, "contradicts", 4.0, 9.0)):
        session = after(simulate.tumble(seed=3, sensor=now).samples)
        session = fitted(step(session, GotPrevious(61.0, before))[0])
        shown = state(session).previous
        assert shown is not None
        assert shown.change_deg is not None
        assert word in shown.words
        assert low <= shown.change_deg <= high  # 3 µT across 25 µT of horizontal field is 6.9°


def test_a_calibration_in_another_unit_is_not_compared_and_says_why() -> None:
    counts = replace(simulate.tumble(seed=2).samples, unit=Unit.of("counts"))
    before = Judged.from_fit(fitting.fit(counts), name="monday.json")
    session = after(simulate.tumble(seed=3).samples)
    shown = state(fitted(step(session, GotPrevious(61.0, before))[0])).previous
    assert shown is not None
    assert shown.change_deg is None
    assert "counts" in shown.words


def test_a_log_is_shown_in_place_of_the_sensor_which_goes_on() -> None:
    session = after(simulate.tumble(seed=1, n=500).samples)
    log = simulate.tumble(seed=2, n=800).samples
    track = Track.empty().extended(rows_of(log))
    session, _ = step(session, Opened(61.0, "flight.bin", track, log.unit, log.axes, "sensor", "flight.bin: 800"))
    session, _ = step(session, Arrived(62.0, rows_of(log[:100]), log.unit))
    assert (state(session).opened, state(session).readings) == ("flight.bin", 800)
    assert session.live.track.total == 600
    assert fitted(session).view is not None


def test_a_long_session_is_fitted_from_a_spread_of_its_readings() -> None:
    many = simulate.tumble(seed=1, n=50_000, motion="uniform").samples
    found = snapshot(step(Session(), Arrived(1.0, rows_of(many), many.unit))[0])
    assert found.numbers is not None
    assert 16_000 <= len(found.samples) <= 20_000
    assert (np.diff(found.numbers) == 3).all()
