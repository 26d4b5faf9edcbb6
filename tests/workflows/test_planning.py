"""Plans of recordings: laws of what to expect, the information bound, recordings that follow a plan, and mistakes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from benchmarks.datasets import bound
from benchmarks.plan import Followed
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly

import flinders
from flinders.cli.plan import BODIES as LISTED
from flinders.errors import FitError, UnitError, UsageError
from flinders.heading.error_propagation import direction_error_deg
from flinders.simulate.bodies import BODIES, UPSIDE_DOWN_DEG
from flinders.workflows.planned_fit import MAX_READINGS, REACHED_RANK, RecordingSettings, expected_fit
from flinders.workflows.planning import noise_of, plan

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.workflows.planned_fit import ExpectedFit

CHANCE: Final = 1.05
"""Factor by which chance alone may make a claim larger."""


@cache
def expected(body: str, noise: float = 0.5, *, circles: int = 1, tilt_deg: float | None = None) -> ExpectedFit:
    """What to expect of turns level and with each side lowered; of a body that stays level, of level turns."""
    carrier = BODIES[body]
    sequence = carrier.sequences(tilt_deg)[min(1, len(carrier.sequences(tilt_deg)) - 1)]
    turns = tuple(turn for turn in sequence for _ in range(circles))
    found = expected_fit(turns, RecordingSettings(carrier.seconds(turns), noise, carrier.sway_deg))
    assert found is not None
    return found


def worst_deg(found: ExpectedFit) -> float:
    return found.fit.claim.heading_error_deg.worst


@pytest.mark.parametrize("body", ["hand", "drone", nightly("wrist"), nightly("robot"), nightly("boat")])
def test_more_time_is_never_worse(body: str) -> None:
    once, twice = expected(body), expected(body, circles=2)
    assert worst_deg(twice) < CHANCE * worst_deg(once)
    assert twice.information_error_deg < CHANCE * once.information_error_deg


@pytest.mark.parametrize("body", ["hand", nightly("drone"), nightly("robot")])
def test_the_error_grows_with_the_noise(body: str) -> None:
    quiet, noisy = expected(body), expected(body, 1.0)
    assert noisy.information_error_deg == pytest.approx(2.0 * quiet.information_error_deg, rel=0.03)
    assert worst_deg(noisy) == pytest.approx(2.0 * worst_deg(quiet), rel=0.15)


def test_more_tilt_is_never_worse() -> None:
    found = [expected("drone", tilt_deg=tilt) for tilt in (20.0, 35.0, 45.0)]
    worst = [worst_deg(each) for each in found]
    reach = [each.fit.claim.attitude_limit_deg for each in found]
    assert worst == sorted(worst, reverse=True)
    assert reach == sorted(reach)


def test_readings_that_are_averaged_tell_as_much_as_each_by_itself() -> None:
    sequence = BODIES["hand"].sequences()[1]
    slow = RecordingSettings(seconds=40.0, noise=0.5, sway_deg=8.0, rate_hz=100.0)
    fast = replace(slow, rate_hz=400.0, noise=1.0)
    assert (slow.averaged, fast.averaged) == (1, math.ceil(16_000 / MAX_READINGS))
    one, other = (expected_fit(sequence, each) for each in (slow, fast))
    assert one is not None
    assert other is not None
    assert worst_deg(other) == pytest.approx(worst_deg(one), rel=0.05)


def test_the_information_error_is_the_cramer_rao_bound() -> None:
    """Of a motion through all directions, where the prior does not count."""
    found = expected("hand")
    claim = found.fit.claim
    assert claim.textbook_covariance is not None
    textbook = direction_error_deg(claim.ellipsoid, claim.textbook_covariance)
    assert textbook.rms == pytest.approx(bound(found.simulated).angle_deg, rel=0.05)


@pytest.mark.parametrize("body", ["hand", "robot", nightly("drone"), nightly("boat"), nightly("wrist")])
def test_recordings_that_follow_a_plan_err_and_claim_as_predicted(body: str, trials: Choose) -> None:
    count = trials(40, 12)
    followed = Followed.of(plan(body, noise=0.5, alternatives=False), count.count)
    low, high = count.ratios(0.8, 1.25)
    assert low < followed.predicted_deg / followed.achieved_deg < high
    assert followed.predicted_deg < high * followed.claimed_deg
    assert followed.claimed_deg < high * followed.plan.expected.high_error_deg
    assert followed.row().startswith(f"| {body} |")


def test_a_level_body_is_told_what_limits_it() -> None:
    robot = plan("robot", noise="0.5 uT", alternatives=False)
    assert_sentences(robot.steps)
    assert robot.as_dict()["expected"]["findings"] == ["level-plane"]
    assert robot.expected.fit.claim.attitude_limit_deg < 1.0
    assert robot.expected.rank(0.0) == REACHED_RANK


def test_the_field_of_a_place_counts() -> None:
    site = flinders.Site(strength=50.0, inclination_deg=60.0, gain_sigma=0.05, inclination_sigma_deg=1.0, z_down=True)
    known, unknown = (plan("robot", noise=0.5, site=place, alternatives=False) for place in (site, None))
    tilts = [each.expected.fit.claim.per_degree_of_tilt for each in (known, unknown)]
    assert tilts[0] < 0.3 * tilts[1]


def test_a_time_that_is_given_is_used() -> None:
    given = plan("drone", noise=0.5, seconds=100.0, alternatives=False)
    assert given.seconds == 100.0
    assert given.readings == 5000
    assert len(given.sequence) == 10  # two circles in each attitude
    hurried = plan("hand", noise=0.5, seconds=5.0, alternatives=False)
    assert [turn.tilt_deg for turn in hurried.sequence] == [0.0]


def test_an_accelerometer_helps_a_body_that_is_tilted_a_little() -> None:
    drone = BODIES["drone"]
    sequence = drone.sequences(20.0)[1]
    alone = RecordingSettings(drone.seconds(sequence), 0.5, drone.sway_deg)
    claims = [expected_fit(sequence, each, draws=3) for each in (alone, replace(alone, aiding=("dip",)))]
    assert all(claims)
    worst = [worst_deg(each) for each in claims if each is not None]
    assert worst[1] < 0.5 * worst[0]


@pytest.mark.nightly
def test_a_plan_says_what_more_time_tilt_and_sensors_would_gain() -> None:
    tilted = plan("drone", noise=0.5, tilt_deg=20.0, seconds=42.0)
    names = [each.name for each in tilted.alternatives]
    assert names == ["time", "tilt", "tilt", "tilt", "dip", "rate"]
    assert [each.tilt_deg for each in tilted.alternatives if each.name == "tilt"] == [30.0, 40.0, 55.0]
    assert [each.as_dict()["more"] for each in tilted.alternatives] == names


@pytest.mark.parametrize(
    ("body", "options", "words"),
    [
        ("dron", {"noise": 0.5}, "did you mean 'drone'"),
        ("hand", {"noise": -0.5}, "need a number above 0"),
        ("hand", {"noise": "-0.5uT"}, "need a number above 0"),
        ("hand", {"noise": math.nan}, "need a number above 0"),
        ("hand", {"noise": "0.5"}, "has no unit: give it as 0.5uT"),
        ("hand", {"noise": "3 counts"}, "is in counts"),
        ("hand", {"noise": "1.2.3uT"}, "is no number"),
        ("hand", {"noise": "ak8963"}, "no source states the noise"),
        ("hand", {"noise": ""}, "is no number with a unit"),
        ("boat", {"noise": 0.5, "seconds": 20.0}, "turns once around in 60 s or more"),
        ("boat", {"noise": 0.5, "seconds": 0.0}, "need a number above 0"),
        ("hand", {"noise": 0.5, "rate_hz": -50.0}, "need a number above 0"),
        ("hand", {"noise": 0.5, "target_deg": 0.0}, "need a number above 0"),
        ("hand", {"noise": 0.5, "tilt_deg": 200.0}, "need 0° to 180°"),
        ("hand", {"noise": 0.5, "aiding": "gps"}, "use one of dip, rate"),
    ],
)
def test_a_mistake_is_answered_with_what_is_needed(body: str, options: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError) as refused:
        plan(body, **options)  # type: ignore[arg-type]
    assert words in refused.value.message


def test_an_unknown_unit_is_named() -> None:
    with pytest.raises(UnitError, match="furlong"):
        noise_of("1 furlong")


def test_too_few_readings_give_no_plan() -> None:
    with assert_raises(FitError):
        plan("hand", noise=0.5, rate_hz=0.1, seconds=40.0)


def test_help_lists_the_bodies() -> None:
    tilts = {0.0: "level", UPSIDE_DOWN_DEG: "any attitude"}
    assert LISTED.keys() == BODIES.keys()
    for name, words in LISTED.items():
        description, _, tilt = words.partition(": ")
        assert BODIES[name].description.startswith(description)
        assert tilt == tilts.get(BODIES[name].tilt_deg, f"tilted by up to {BODIES[name].tilt_deg:g}°")


def test_every_body_has_steps_for_each_of_its_sequences() -> None:
    for body in BODIES.values():
        for sequence in body.sequences():
            steps = body.steps(sequence)
            assert len(steps) == len(sequence) == len(set(steps))
        assert np.all(np.diff([body.seconds(sequence) for sequence in body.sequences()]) > 0.0)
