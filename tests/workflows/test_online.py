"""A calibration that keeps itself: its laws, what it says of a truth, its file."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.sentences import assert_raises
from tests.worlds import walked_days

import flinders
from flinders import simulate
from flinders.core.offset_walk import Walk
from flinders.errors import DocumentError, UsageError
from flinders.fitting.result import bare_fit
from flinders.native.engine import engine
from flinders.native.layouts import ONLINE
from flinders.workflows.online import OnlineCalibration
from flinders.workflows.timeline import MAX_POINTS, OnlinePoint, Timeline

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.workflows.online_events import OnlineEvent

DAY_S = 86400.0
STEP = np.array([3.0, -4.0, 2.0])


def tumbled(seed: int, *, seconds: float = 60.0, sensor_seed: int = 1) -> tuple[Floats, Floats, simulate.Sensor]:
    """Readings of a sensor that a hand tumbles, their times, and the sensor."""
    sensor = simulate.tumble(seed=sensor_seed).sensor
    made = simulate.tumble(seed=seed, n=round(50 * seconds), sensor=sensor).samples
    assert made.time is not None
    return made.field, made.time, sensor


def worst_deg(online: OnlineCalibration, sensor: simulate.Sensor, offset: Floats) -> float:
    """True error of the heading of a level vehicle at the worst heading, its mean removed."""
    assert online.calibration is not None
    turn, dip = np.radians(np.arange(0.0, 360.0, 5.0)), math.radians(60.0)
    level = np.stack(
        [math.cos(dip) * np.cos(turn), -math.cos(dip) * np.sin(turn), np.full_like(turn, math.sin(dip))], 1
    )
    corrected = online.calibration.apply(50.0 * level @ sensor.matrix.T + offset)
    off = np.angle(np.exp(1j * (np.arctan2(-corrected[:, 1], corrected[:, 0]) - turn)))
    return float(np.degrees(np.abs(np.angle(np.exp(1j * (off - np.angle(np.exp(1j * off).mean()))))).max()))


def learnt(seed: int = 1) -> tuple[OnlineCalibration, simulate.Sensor]:
    """One that a minute of tumbling has made."""
    field, time, sensor = tumbled(seed)
    online = OnlineCalibration()
    online.add(field, time=time)
    return online, sensor


STATES: Final[dict[str, str]] = {}


def a_state(folder: Path) -> str:
    """The file of one that a minute of tumbling has made; it is made once."""
    if not STATES:
        learnt()[0].save(folder / "made.json")
        STATES["learnt"] = (folder / "made.json").read_text()
    return STATES["learnt"]


def test_the_record_has_the_engines_size() -> None:
    assert engine()._library.flinders_online_size() == ONLINE.itemsize


def test_a_tumble_is_learnt_and_true() -> None:
    field, time, sensor = tumbled(1)
    online = OnlineCalibration()
    assert online.state.doing == "learning"
    assert online.calibration is None
    codes = [event.code for event in online.add(field, time=time)]
    assert codes[:2] == ["learnt", "adopted"]
    assert set(codes[2:]) <= {"adopted"}
    assert online.state.verdict == "good"
    assert worst_deg(online, sensor, sensor.offset) < 2.0 * online.state.heading_error_deg
    assert online.fit is not None
    assert online.fit.verdict == "good"
    assert online.fit.heading_error_deg.worst == online.state.heading_error_deg


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(1, 900), min_size=1, max_size=12))
def test_how_readings_are_cut_changes_nothing(cuts: list[int]) -> None:
    field, time, _ = tumbled(2, seconds=40.0)
    whole, parts = OnlineCalibration(), OnlineCalibration()
    events = whole.add(field, time=time)
    found: list[OnlineEvent] = []
    row = 0
    for cut in [*cuts, len(field)]:
        found += parts.add(field[row : row + cut], time=time[row : row + cut])
        row += cut
    assert tuple(found) == events
    assert repr(parts.timeline) == repr(whole.timeline)
    assert parts._record.tobytes() == whole._record.tobytes()


def test_what_is_saved_goes_on(tmp_path: Path) -> None:
    field, time, _ = tumbled(3)
    online = OnlineCalibration()
    online.add(field[:1234], time=time[:1234])
    online.save(tmp_path / "state.json")
    again = OnlineCalibration.load(tmp_path / "state.json")
    assert again.state == online.state
    assert again.history == online.history
    assert repr(again.timeline) == repr(online.timeline)
    assert again.add(field[1234:], time=time[1234:]) == online.add(field[1234:], time=time[1234:])
    assert again.fit is not None
    assert online.fit is not None
    np.testing.assert_array_equal(again.fit.claim.covariance, online.fit.claim.covariance)
    assert repr(again.timeline) == repr(online.timeline)


def test_the_timeline_tells_what_was_known_at_events_and_every_minute() -> None:
    online, sensor = learnt()
    field, time, _ = tumbled(5, seconds=400.0)
    night = 8 * 3600.0
    online.add(field + STEP, time=time + night)
    points = online.timeline
    assert [code for point in points for code in point.events] == [event.code for event in online.history]
    times = np.array([point.time_s for point in points])
    assert (np.diff(times) > 0.0).all()
    read = times[[point.is_read for point in points] & (times > night)]
    assert np.diff(read).max() < 60.1
    grown = [point.heading_error_deg for point in points if not point.is_read]
    assert len(grown) == 7
    assert grown == sorted(grown)
    assert points[-1].doing == "undisturbed"
    off = np.abs(np.array(points[-1].offset) - sensor.offset - STEP)
    assert (off < 4.0 * np.array(points[-1].offset_sigma)).all()


def test_a_timeline_is_bounded_and_fine_where_it_is_recent() -> None:
    timeline = Timeline()
    for minute in range(12_000):
        timeline.put(OnlinePoint(60.0 * minute, "undisturbed", events=("adopted",) if minute % 1000 == 3 else ()))
        assert len(timeline.points) <= MAX_POINTS
    times = np.array([point.time_s for point in timeline.points])
    assert times[0] == 0.0
    assert (np.diff(times[times > times[-1] - 1800.0]) == 60.0).all()
    assert np.diff(times).max() < 3600.0
    assert sum(len(point.events) for point in timeline.points) == 12
    for part in range(3 * MAX_POINTS):  # events faster than any point
        timeline.put(OnlinePoint(720_000.0 + 1e-3 * part, "undisturbed", events=("adopted",)))
        assert len(timeline.points) <= MAX_POINTS


def test_the_claim_grows_while_nothing_is_learnt() -> None:
    online, _ = learnt()
    now = online.state.time_s
    claims = [online.at(now + ahead).heading_error_deg for ahead in (0.0, 60.0, 3600.0, DAY_S, 30 * DAY_S)]
    assert claims == sorted(claims)
    assert claims[-1] > 10 * claims[0]
    until = online.good_until_s
    assert online.at(until).heading_error_deg <= 1.0 < online.at(until + 2.0).heading_error_deg


def test_an_offset_that_moves_is_followed() -> None:
    online, sensor = learnt()
    now, before = online.state.time_s, worst_deg(online, sensor, sensor.offset)
    field, time, _ = tumbled(5)
    codes = [event.code for event in online.add(field + STEP, time=time + now + 60.0)]
    assert {"contradicted", "moved"} & set(codes)
    assert "adopted" in codes
    assert worst_deg(online, sensor, sensor.offset + STEP) < max(1.0, 3.0 * before)
    assert online.state.doing == "undisturbed"


def test_an_offset_that_moves_is_in_the_claim_within_seconds() -> None:
    online, sensor = learnt()
    now = online.state.time_s
    field, time, _ = tumbled(5, seconds=8.0)
    online.add(field + STEP, time=time + now + 60.0)
    assert worst_deg(online, sensor, sensor.offset + STEP) < online.state.bound_deg


def test_a_jump_between_two_readings_is_followed_at_once() -> None:
    field, time, sensor = tumbled(1, seconds=80.0)
    still = np.repeat(field[-1:], 500, axis=0) + np.random.default_rng(1).normal(scale=0.3, size=(500, 3))
    still[250:] += STEP
    online = OnlineCalibration()
    online.add(field, time=time)
    codes = [event.code for event in online.add(still, time=time[-1] + 0.02 * np.arange(1, 501))]
    assert "moved" in codes
    assert worst_deg(online, sensor, sensor.offset + STEP) < online.state.bound_deg


def test_something_that_passes_leaves_the_calibration_as_it_was() -> None:
    online, sensor = learnt()
    now = online.state.time_s
    field, time, _ = tumbled(6, seconds=120.0)
    peak = 30.0 * np.exp(-(((time - 20.0) / 4.0) ** 2))[:, np.newaxis] * [0.6, 0.0, 0.8]
    codes = [event.code for event in online.add(field + peak, time=time + now + 1.0)]
    assert "contradicted" in codes
    assert "passed" in codes
    assert "moved" not in codes
    assert worst_deg(online, sensor, sensor.offset) < online.state.bound_deg


def test_a_level_turn_is_learnt_as_one() -> None:
    turn = simulate.tumble(seed=4, n=6000, motion="level").samples
    assert turn.time is not None
    online = OnlineCalibration()
    online.add(turn.field, time=turn.time)
    assert online.state.doing != "learning"
    assert online._record["is_level"]


def test_it_begins_with_a_fit() -> None:
    tumble = simulate.tumble(seed=1)
    fit = flinders.fit(tumble.samples)
    online = OnlineCalibration(fit)
    online.add(tumble.samples.field[:1], time=[5 * DAY_S])
    assert online.state.heading_error_deg == pytest.approx(fit.heading_error_deg.worst, rel=0.05)
    assert OnlineCalibration(fit, at=0.0).at(5 * DAY_S).heading_error_deg > 5 * fit.heading_error_deg.worst


def test_a_unit_that_is_known_to_walk_slowly_claims_less_after_a_day() -> None:
    field, time, _ = tumbled(1, seconds=20.0)
    claims = []
    for walk in (None, 0.02, Walk(0.02, 0.018, 0.022), 1.0):
        online = OnlineCalibration(walk=walk)
        online.add(field, time=time)
        claims.append([online.at(time[-1] + seconds).heading_error_deg for seconds in (0.0, DAY_S)])
    now, day = np.array(claims).T
    assert np.ptp(now) < 0.02 * now[0]
    assert day[2] <= day[1] < 0.85 * day[0]
    assert day[3] > 1.2 * day[0]
    with assert_raises(UsageError):
        OnlineCalibration(walk=0.0)
    begun = OnlineCalibration(flinders.fit(simulate.tumble(seed=1).samples), at=0.0, walk=0.02)
    assert begun.at(0.0).walk < 0.1


def test_a_walk_that_is_known_wrongly_is_corrected_and_its_claim_stays_true() -> None:
    time, field, begins, offsets = walked_days(2, days=1.5, walk=0.6)
    online, off = OnlineCalibration(walk=0.2), []
    for begin, end, offset in zip(begins.tolist(), [*begins[1:].tolist(), math.inf], offsets, strict=True):
        state = online.at(begin)
        off.append((np.array(state.offset) - offset) / state.offset_sigma)
        rows = (time >= begin) & (time < end)
        online.add(field[rows], time=time[rows])
    assert np.sqrt(np.nanmean(np.square(off))) < 1.3
    assert 0.3 < online.state.walk < 0.9


def test_a_fit_that_cannot_go_on_is_refused() -> None:
    plain = bare_fit(flinders.Calibration.identity(field_strength=50.0))
    with assert_raises(UsageError):
        OnlineCalibration(plain)
    with assert_raises(UsageError):
        OnlineCalibration(target_deg=-1.0)
    with assert_raises(UsageError):
        OnlineCalibration(dip_deg=90.0)


def test_while_it_is_locked_nothing_is_adopted_and_the_claim_is_of_what_is_in_force() -> None:
    online, sensor = learnt()
    was = online.calibration
    online.is_locked = True
    field, time, _ = tumbled(5)
    online.add(field + STEP, time=time + online.state.time_s + 60.0)
    assert online.calibration is not None
    assert was is not None
    assert online.calibration.isclose(was)
    assert worst_deg(online, sensor, sensor.offset + STEP) < online.state.bound_deg
    online.adopt()
    assert worst_deg(online, sensor, sensor.offset + STEP) < 1.0
    online.take_back()
    assert online.calibration.isclose(was)
    assert [event.code for event in online.history[-2:]] == ["adopted", "taken-back"]


def test_nothing_to_adopt_or_take_back() -> None:
    with assert_raises(UsageError):
        OnlineCalibration().adopt()
    field, time, _ = tumbled(1, seconds=8.0)
    online = OnlineCalibration(flinders.fit(simulate.tumble(seed=1).samples), at=0.0)
    online.add(field[:5], time=time[:5])
    with assert_raises(UsageError):
        online.take_back()


def test_bad_readings_and_clocks_are_passed_over() -> None:
    field, time, _ = tumbled(1)
    online = OnlineCalibration()
    online.add(field, time=time)
    before = online._record.tobytes()
    online.add([[np.nan, 1.0, 2.0], [np.inf, 0.0, 0.0]], time=[time[-1] + 1.0, time[-1] + 2.0])
    assert online._record.tobytes() == before
    codes = [event.code for event in online.add(field[:100], time=time[:100])]
    assert codes == ["clock-back"]
    assert online.state.time_s == time[-1]
    assert online.add(np.empty((0, 3)), time=np.empty(0)) == ()


@pytest.mark.parametrize(
    "broken",
    [
        lambda _: "no JSON",
        lambda content: json.dumps({**content, "format": "another"}),
        lambda content: json.dumps({**content, "record": {}}),
        lambda content: json.dumps({**content, "record": {"version": 99, "state": 1, "dip_deg": 60.0}}),
        lambda content: json.dumps({**content, "record": {**content["record"], "version": 99, "noise": "nan"}}),
        lambda content: json.dumps({**content, "record": {**content["record"], "version": 99, "latest": [1.0] * 9}}),
        lambda content: json.dumps({**content, "record": {**content["record"], "version": 99, "target_deg": -1.0}}),
        lambda content: json.dumps(
            {**content, "record": {**content["record"], "version": 99, "latest_covariance": [-1.0] * 81}}
        ),
        lambda content: json.dumps({**content, "record": {**content["record"], "kept": 10**6}}),
        lambda content: json.dumps({**content, "record": {**content["record"], "state": 7}}),
        lambda content: json.dumps({**content, "record": {**content["record"], "field": [1.0]}}),
        lambda content: json.dumps({**content, "history": [{"code": "learnt"}]}),
        lambda content: json.dumps(
            {**content, "timeline": {**content["timeline"], "points": [[0.0, "away", True, [], *[1.0] * 8]]}}
        ),
        lambda _: json.dumps([1, 2]),
        lambda content: json.dumps(content)[:2000],
    ],
)
def test_a_file_that_is_no_state_is_refused(tmp_path: Path, broken: object) -> None:
    (tmp_path / "state.json").write_text(broken(json.loads(a_state(tmp_path))))  # type: ignore[operator]
    with assert_raises(DocumentError):
        OnlineCalibration.load(tmp_path / "state.json")


def of_another_release(path: Path, **changed: object) -> None:
    """Make a state one of another release: numbers changed, or left out where they are None."""
    content = json.loads(path.read_text())
    record = {name: value for name, value in {**content["record"], **changed}.items() if value is not None}
    path.write_text(json.dumps({**content, "record": record}))


@pytest.mark.parametrize(
    "changed",
    [
        {"version": 99, "added": [1.0, 2.0]},
        {"scatter": None, "newest_at": None},
        {"version": 0, "field": [0.0] * 30, "time": [0.0] * 10, "kept": 99, "rates": [0.5, 0.5], "place": -1.0},
    ],
)
def test_the_state_of_another_release_goes_on_without_its_evidence(tmp_path: Path, changed: dict[str, object]) -> None:
    sensor = tumbled(1, seconds=1.0)[2]
    (tmp_path / "state.json").write_text(a_state(tmp_path))
    online = OnlineCalibration.load(tmp_path / "state.json")
    online.is_locked, online.target_deg = True, 0.7
    online.save(tmp_path / "state.json")
    of_another_release(tmp_path / "state.json", **changed)
    again = OnlineCalibration.load(tmp_path / "state.json")
    assert again.is_converted
    assert [event.code for event in again.history] == [*(event.code for event in online.history), "other-release"]
    assert (again.is_locked, again.target_deg, again.state.time_s) == (True, 0.7, online.state.time_s)
    assert again.calibration is not None
    assert online.calibration is not None
    assert again.calibration.isclose(online.calibration)
    assert again.state.heading_error_deg == pytest.approx(online.state.heading_error_deg, rel=1e-3)
    again.is_locked = False
    field, time, _ = tumbled(5, seconds=20.0)
    again.add(field, time=time + online.state.time_s + 600.0)
    assert worst_deg(again, sensor, sensor.offset) < again.state.bound_deg
    again.save(tmp_path / "state.json")
    assert not OnlineCalibration.load(tmp_path / "state.json").is_converted


def test_what_contradicted_a_state_of_another_release_stays_in_its_claim(tmp_path: Path) -> None:
    online, sensor = learnt()
    field, time, _ = tumbled(5, seconds=8.0)
    online.add(field + 2.0 * STEP, time=time + online.state.time_s + 60.0)
    assert online.state.doing == "disturbed"
    online.save(tmp_path / "state.json")
    of_another_release(tmp_path / "state.json", version=99)
    again = OnlineCalibration.load(tmp_path / "state.json")
    assert again.state.doing == "undisturbed"
    assert worst_deg(again, sensor, sensor.offset + 2.0 * STEP) < again.state.bound_deg
    assert again.state.heading_error_deg > 0.9 * online.state.heading_error_deg


def test_a_state_of_another_release_that_knows_nothing_keeps_its_settings(tmp_path: Path) -> None:
    OnlineCalibration(target_deg=0.3, axes="x,-y,-z").save(tmp_path / "state.json")
    of_another_release(tmp_path / "state.json", version=99)
    again = OnlineCalibration.load(tmp_path / "state.json")
    assert (again.state.doing, again.target_deg, str(again.axes)) == ("learning", 0.3, "x,-y,-z")


def test_a_calibration_goes_on_following_a_current_that_is_recorded(tmp_path: Path) -> None:
    field, time, sensor = tumbled(3, seconds=60.0)
    current, wire = 8.0 * (1.0 + np.sin(time / 5.0)), np.array([0.3, -0.2, 0.1])
    flown = field + current[:, None] * wire
    start = flinders.fit(flinders.Samples.of(flown, unit="uT", time=time, current=current), disturbances=("current",))
    online, later = OnlineCalibration(start), time + 100.0
    events = online.add(flown[:1000], time=later[:1000], current=current[:1000])
    online.save(tmp_path / "state.json")
    online = OnlineCalibration.load(tmp_path / "state.json")
    events += online.add(flown[1000:], time=later[1000:], current=current[1000:])
    assert online.disturbances == ("current",)
    assert {event.code for event in events} <= {"adopted"}
    fit = online.fit
    assert fit is not None
    assert np.allclose(fit.calibration.disturbances[0].per_unit, wire, atol=0.02)
    corrected, truth = (
        fit.calibration.apply(flown, current=current),
        (field - sensor.offset) @ np.linalg.inv(sensor.matrix).T,
    )
    apart = corrected / np.linalg.norm(corrected, axis=1)[:, None] - truth / np.linalg.norm(truth, axis=1)[:, None]
    assert np.degrees(np.median(np.linalg.norm(apart, axis=1))) < 0.3
    with assert_raises(UsageError):
        online.add(flown[:5], time=later[:5] + 100.0)


def test_a_young_calibration_is_contradicted_by_no_clean_reading() -> None:
    for seed in (2, 4, 6):
        field, time, _ = tumbled(seed, sensor_seed=seed)
        read = np.ones(len(time), dtype=bool)
        read[2000:2025] = read[2500:2540] = False  # lost on the way, while the sensor turns
        events = OnlineCalibration().add(field[read], time=time[read])
        assert {event.code for event in events} == {"learnt", "adopted"}
