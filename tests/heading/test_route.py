"""Who follows the planned way is done with much less turning, and the words turn the body the way that is meant."""

from __future__ import annotations

import numpy as np
import pytest
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.errors import ArrayError
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading import path_planning
from flinders.heading.guidance import guide
from flinders.simulate import turns


def partly_known() -> path_planning.Belief:
    fit = flinders.fit(simulate.tumble(seed=3, motion="tilted").samples)
    return path_planning.Belief.of(fit.claim, fit.evidence.noise, fit.evidence.coverage)


def test_the_way_is_no_worse_than_standing_still_and_beats_any_single_direction() -> None:
    fit = flinders.fit(simulate.tumble(seed=3, motion="tilted", n=300).samples)
    belief = path_planning.Belief.of(fit.claim, fit.evidence.noise, fit.evidence.coverage)
    way = path_planning.plan(belief, [0.0, 0.0, 1.0], goal="attitude", target_deg=1e-3)
    assert way.after_deg < way.worst_deg
    taken = path_planning.READINGS_PER_DEG * 35.0 * 6
    one = guide(
        fit.calibration.ellipsoid,
        fit.claim.covariance,
        noise=fit.evidence.noise,
        coverage=fit.evidence.coverage,
        goal="attitude",
        batch=taken,
    )
    assert way.after_deg < one.after_deg


def test_the_way_ends_where_the_target_is_reached() -> None:
    belief = partly_known()
    short = path_planning.plan(belief, [0.0, 0.0, 1.0], goal="attitude", target_deg=1.5)
    long = path_planning.plan(belief, [0.0, 0.0, 1.0], goal="attitude", target_deg=0.3)
    assert len(short.waypoints) < len(long.waypoints) <= 6
    assert short.after_deg <= 1.5


def test_a_level_heading_needs_no_way_overhead() -> None:
    """What a level heading needs is seen level: the way for it does not lead to the far side."""
    belief = partly_known()
    heading = path_planning.plan(belief, [0.5, 0.0, 0.87], goal="heading", target_deg=1.0)
    attitude = path_planning.plan(belief, [0.5, 0.0, 0.87], goal="attitude", target_deg=1.0)
    assert heading.worst_deg < attitude.worst_deg


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
def test_the_words_turn_the_field_the_way_that_is_meant(axis: list[float]) -> None:
    """A body that turns by ω sees a fixed field turn by −ω."""
    told: dict[tuple[int, ...], str] = {
        (1, 0, 0): "roll it to its right", (-1, 0, 0): "roll it to its left",
        (0, 1, 0): "raise its nose", (0, -1, 0): "lower its nose",
        (0, 0, 1): "turn it to its right", (0, 0, -1): "turn it to its left",
    }  # fmt: skip
    about = np.array(axis)
    start = np.roll(about, 1)
    after = turns([0.6 * about])[0].T @ start
    way = path_planning.Route(start, after[np.newaxis], 2.0, 1.0)
    assert way.words("vehicle") == told[tuple(int(part) for part in axis)]


def test_words_of_a_bare_sensor_name_its_sides() -> None:
    way = path_planning.Route(np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.5, 0.87], [0.5, 0.5, 0.7]]), 2.0, 1.0)
    assert_sentences(way.words("sensor"))


def test_legs_that_turn_alike_are_one() -> None:
    along = [[0.0, np.sin(angle), np.cos(angle)] for angle in (0.5, 1.0, 1.5)]
    assert_sentences(path_planning.Route(np.array([0.0, 0.0, 1.0]), np.array(along), 2.0, 1.0).words())


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_rough_finds_the_centre_of_an_arc_in_its_plane(tilt: float) -> None:
    rng = np.random.default_rng(2)
    angle = np.linspace(0.0, np.radians(100.0), 60)[:, np.newaxis]
    across = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    arc = 48.0 * (np.cos(angle) * [1.0, 0.0, 0.0] + np.sin(angle) * across) + [20.0, 0.0, 0.0]
    belief = path_planning.rough_belief(arc + 0.2 * rng.standard_normal(arc.shape))
    assert belief is not None
    assert np.linalg.norm(belief.ellipsoid.centre - [20.0, 0.0, 0.0]) < 2.0
    normal = np.cross([1.0, 0.0, 0.0], across)
    sigma = np.sqrt([one @ belief.covariance[:3, :3] @ one for one in (normal, across)])
    assert sigma[0] > 3.0 * sigma[1]


@pytest.mark.parametrize(
    "readings",
    [
        np.empty((0, 3)),
        np.ones((2, 3)),
        np.ones((50, 3)),
        np.linspace([0.0, 0.0, 0.0], [1.0, 2.0, 3.0], 50),
        50.0 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.0, 0.5, 50)]),
    ],
    ids=["none", "few", "still", "line", "short arc"],
)
def test_rough_does_not_guess(readings: np.ndarray) -> None:
    assert path_planning.rough_belief(readings) is None


def test_a_reading_at_the_centre_has_no_direction_but_makes_no_fault() -> None:
    belief = path_planning.Belief(Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), np.eye(9), 1.0)
    assert not belief.direction([0.0, 0.0, 0.0]).any()
    with assert_raises(ArrayError):
        path_planning.plan(belief, belief.direction([0.0, 0.0, 0.0]))


@pytest.mark.parametrize("wrong", [[1.0, 2.0], [[1.0, 2.0, 3.0]], 5.0])
def test_a_direction_is_three_numbers(wrong: object) -> None:
    with pytest.raises(ArrayError, match=r"need \(3,\)"):
        path_planning.plan(partly_known(), wrong)  # type: ignore[arg-type]
