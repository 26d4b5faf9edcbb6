"""Lives and scores of `benchmarks.service`: its physics, its truth, and what it says of estimators that are known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import service
from benchmarks.service_bodies import BODIES, DAY, Rooms, down_of, rates_of, seen
from benchmarks.service_lives import KINDS, START_S, STRENGTH_UT, live, offsets_of
from benchmarks.service_peers import ESTIMATORS, Correction, Ours, Report, worst_deg

import flinders
from flinders.workflows.online_events import OnlineEvent

if TYPE_CHECKING:
    from benchmarks.service_lives import Chunk, Life

    from flinders.arrays import Floats

DRIFTS: Final = ("walk", "temperature", "steps", "clock", "gaps")
"""Kinds of events that are in the truth, or in no reading."""


@pytest.fixture(scope="module")
def phone() -> Life:
    return live("phone", 1, kinds=DRIFTS)


@pytest.fixture(scope="module")
def drone() -> Life:
    return live("drone", 1, days=0.2, kinds=DRIFTS)


@pytest.fixture(scope="module")
def calm() -> Life:
    """Three hours of a drone to which nothing happens."""
    return live("drone", 4, days=0.12, kinds=())


def strengths(life: Life) -> Floats:
    """(n,) lengths of readings that the truth corrects, µT."""
    corrected = np.linalg.solve(life.iron, (life.field - life.offset_at(life.seconds)).T)
    lengths: Floats = np.linalg.norm(corrected, axis=0)
    return lengths


@pytest.mark.parametrize("body", BODIES)
def test_the_truth_corrects_readings_to_one_strength(body: str) -> None:
    lengths = strengths(live(body, 2, days=0.05, kinds=DRIFTS))
    assert abs(lengths.mean() - STRENGTH_UT) < 0.15
    assert lengths.std() < 0.8  # noise of 0.2 to 0.5 µT, slow noise, soft iron


def test_what_belongs_to_a_place_or_passes_is_not_in_the_truth() -> None:
    life = live("wrist", 2, days=0.3, kinds=["steel"])
    off = np.abs(strengths(life) - STRENGTH_UT)
    near = np.zeros(len(off), dtype=bool)
    for event in life.of_kind("steel"):
        near |= (life.seconds >= event.begin) & (life.seconds <= event.end)
    assert near.any()
    assert off[near].max() > 3.0
    assert off[~near].max() < 3.0
    npt.assert_array_equal(life.offset_at(life.seconds[[0, -1]])[0], life.offset_at(life.seconds[[0, -1]])[1])


def test_steps_are_where_and_as_large_as_they_are_said(phone: Life) -> None:
    steps = phone.of_kind("step")
    assert steps
    for step in steps:
        before, after = phone.offset_at(np.array([step.begin - 1e-3, step.begin + 1e-3]))
        assert np.linalg.norm(after - before) == pytest.approx(step.size, rel=0.01)
        assert 0.5 <= step.size <= 20.0


def test_half_of_a_magnetisation_fades() -> None:
    offsets, (event, *_) = offsets_of(3, "phone", 10.0 * DAY, ["magnetised"], [])
    before, after, late = offsets.at(event.begin + np.array([-1.0, 1.0, 6e4]))
    assert np.linalg.norm(after - before) == pytest.approx(event.size, rel=0.01)
    assert np.linalg.norm(late - after) == pytest.approx(0.5 * event.size, rel=0.02)


def test_one_kind_less_leaves_the_others_as_they_are(drone: Life) -> None:
    less = live("drone", 1, days=0.2, kinds=["walk", "temperature", "steps", "gaps"])
    npt.assert_array_equal(less.field, drone.field)
    npt.assert_allclose(less.time - START_S, less.seconds, atol=1e-6)
    full = live("drone", 1, days=0.2, kinds=KINDS)
    npt.assert_array_equal(full.seconds, drone.seconds)
    assert full.of_kind("step", "gap") == drone.of_kind("step", "gap")


def test_stamps_jump_and_repeat_where_it_is_said(phone: Life) -> None:
    off = phone.time - phone.clock_at(phone.seconds)
    repeats = np.searchsorted(phone.seconds, [event.begin for event in phone.of_kind("repeat")])
    assert set(np.flatnonzero(np.abs(off) > 1e-6)) <= set(repeats.tolist())
    assert (np.diff(phone.time) < 0.0).sum() == sum(event.size < 0.0 for event in phone.of_kind("jump")) > 0


def test_no_reading_is_in_a_gap(drone: Life) -> None:
    assert drone.of_kind("gap")
    for gap in drone.of_kind("gap"):
        assert not np.any((drone.seconds > gap.begin) & (drone.seconds < gap.end))
    assert not live("drone", 1, days=0.2, kinds=()).of_kind("gap")


def test_rates_turn_gravity_and_north() -> None:
    seconds = np.arange(0.0, 20.0, 0.002)
    angles = np.stack([np.sin(seconds), 0.8 * np.sin(0.7 * seconds), seconds], axis=1)
    rates = rates_of(seconds, angles)
    for vectors in (down_of(angles), seen(angles, np.array([1.0, 0.0, 0.0]))):
        slope = np.gradient(vectors, seconds, axis=0)[1:-1]
        npt.assert_allclose(slope, -np.cross(rates, vectors)[1:-1], atol=1e-4)


def test_a_room_has_no_sources() -> None:
    room, at, step = Rooms.random(np.random.default_rng(1), 0.1), np.array([1.0, 2.0, 0.5]), 1e-4
    columns = []
    for axis in np.eye(3) * step:
        (north, east, height), (south, west, depth) = at + axis, at - axis
        one, other = (
            room.at(np.array([x]), np.array([y]), h)[0] for x, y, h in ((north, east, height), (south, west, depth))
        )
        columns.append((one - other) / (2.0 * step))
    slopes = np.stack(columns, axis=1) * [1.0, 1.0, -1.0]  # by north, east, down
    assert abs(np.trace(slopes)) < 1e-6
    npt.assert_allclose(slopes, slopes.T, atol=1e-6)


@dataclass
class Known:
    """An estimator that knows the truth but for an offset error: `off` µT ahead, or `sigma` on each axis."""

    life: Life
    claim_deg: float
    off: float = 0.0
    sigma: float = 0.0
    reports: bool = False
    told: int = 0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def add(self, chunk: Chunk) -> tuple[Report, ...]:
        now = float(chunk.time[-1])
        moved = [step for step in service.steps_of(self.life) if self.life.clock_at(np.array([step.begin]))[0] <= now]
        told, self.told = self.told, len(moved)
        return (Report(now, "moved"),) * (len(moved) - told) if self.reports else ()

    def correction(self, time: float) -> Correction | None:
        seconds = np.interp(time, self.life.clock_at(self.life.seconds), self.life.seconds)
        error = self.sigma * self.rng.standard_normal(3) + [self.off, 0.0, 0.0]
        offset = self.life.offset_at(np.array([seconds]))[0] + self.life.iron @ error
        return Correction(np.linalg.inv(self.life.iron), offset, self.claim_deg)


@pytest.fixture(scope="module")
def moved() -> Life:
    """A day with steps and a clock without faults."""
    return live("phone", 1, kinds=["walk", "steps"])


def test_an_estimator_that_knows_the_truth_is_within_at_once(moved: Life) -> None:
    score = service.scored(moved, "known", lambda: Known(moved, 0.1, reports=True))
    assert max(answer.error for answer in score.answers) < 0.05  # the walk within a reading
    assert all(answer.is_within for answer in score.answers)
    assert [step.covered for step in score.steps] == [step.back for step in score.steps] == [0.0] * len(score.steps)
    assert all(step.is_reported for step in score.steps)
    assert score.false_reports == 0
    assert 0.0 < score.calm_hours < 24.0


def test_an_estimator_that_is_off_is_within_nowhere(moved: Life) -> None:
    score = service.scored(moved, "off", lambda: Known(moved, 0.5, off=5.0))
    expected = math.degrees(math.asin(5.0 / 25.0))
    assert np.median([answer.error for answer in score.answers]) == pytest.approx(expected, rel=0.03)
    assert not any(answer.is_within for answer in score.answers)
    assert {step.covered for step in score.steps} == {math.inf}
    assert not any(step.is_reported for step in score.steps)


def test_a_true_claim_has_the_ratio_that_is_stated(moved: Life) -> None:
    claim = math.degrees(0.1 / 25.0)
    assert worst_deg(np.diag([0.01] * 3 + [0.0] * 6)) == pytest.approx(claim, rel=0.01)
    score = service.scored(moved, "true", lambda: Known(moved, claim, sigma=0.1))
    ratios = [answer.error / answer.claim for answer in score.answers]
    assert np.median(ratios) == pytest.approx(1.2, abs=0.12)
    assert np.mean([answer.is_within for answer in score.answers]) == pytest.approx(0.85, abs=0.06)


def test_a_report_without_a_step_is_false() -> None:
    life = live("drone", 1, days=0.05, kinds=())

    class Alarmed(Known):
        def add(self, chunk: Chunk) -> tuple[Report, ...]:
            return (Report(float(chunk.time[-1]), "moved"),)

    score = service.scored(life, "alarmed", lambda: Alarmed(life, 1.0))
    assert score.false_reports == len(score.codes) > 0
    assert score.calm_hours == pytest.approx(life.end_s / 3600.0)


@pytest.mark.parametrize(
    ("name", "limit_deg"),
    [("once", 1.0), ("refit", 1.0), ("px4", 4.0), ("kalman", 1.0), ("pypilot", 9.0), ("betaflight", 9.0)],
)
def test_a_peer_is_right_where_nothing_happens(name: str, limit_deg: float, calm: Life) -> None:
    score = service.scored(calm, name, ESTIMATORS[name])
    assert score.answers[-1].error < limit_deg


def test_kinds_of_moments(moved: Life) -> None:
    step = moved.of_kind("step")[0]
    assert service.kind_of(moved, step.begin + 10.0) == "step"
    assert service.kind_of(moved, step.begin - 1.0) in ("calm", "step")
    kinds = {service.kind_of(moved, moment.seconds) for moment in service.moments_of(moved) if moment.step >= 0}
    assert "calm" in kinds or "step" in kinds


def test_tables_have_a_row_for_each_estimator() -> None:
    scores = service.tried(("drone", 1), days=0.05, kinds=KINDS, names=["once", "pypilot"])
    lines = list(service.tables(scores, ["once", "pypilot"], ["drone"], detail=True))
    assert sum(line.startswith("| once | drone |") for line in lines) == 1
    widths = {line.count("|") for line in lines if line.startswith(("| pypilot | drone", "| estimator | body |"))}
    assert widths == {11}


def test_ours_is_asked_as_others_are(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stated:
        heading_error_deg, bound_deg = 0.5, 1.2

    class Online:
        calibration = flinders.Calibration.identity()

        def __init__(self, **settings: Any) -> None:
            assert settings == {"unit": "uT", "target_deg": 1.0}

        def add(self, field: Floats, *, time: Floats) -> tuple[OnlineEvent, ...]:
            assert field.shape == (len(time), 3)
            return (OnlineEvent(float(time[-1]), "moved", 0.5),)

        def at(self, time: float) -> Stated:
            assert time > START_S
            return Stated()

    monkeypatch.setattr(flinders, "OnlineCalibration", Online, raising=False)
    score = service.scored(live("drone", 1, days=0.02, kinds=()), "ours", Ours)
    assert {answer.bound for answer in score.answers} == {1.2}
    assert set(score.codes) == {"moved"}
