"""A calibration held against a level turn: a right one agrees however the sensor sits, and a changed one does not."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import daily

import flinders
from flinders.comparison.level_plane import LevelPair, compare_with_turn
from flinders.core.samples import Samples
from flinders.fitting.result import Fit, bare_fit
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

SOFT = np.eye(3) + np.array([[0.06, 0.05, -0.04], [-0.05, -0.03, 0.08], [0.07, -0.02, 0.02]])
HARD = np.array([30.0, -20.0, 45.0])
DIP = np.deg2rad(60.0)


def reading(body: Floats, mounting: tuple[float, float, float], seed: int, moved: Floats | None = None) -> Samples:
    """What a sensor with soft and hard iron reads of (N, 3) unit fields in the body that it is mounted in."""
    rng = np.random.default_rng(seed)
    field = 50.0 * body @ (SOFT @ euler(*mounting)).T + HARD + (0.0 if moved is None else moved)
    return Samples.of(field + rng.normal(scale=0.3, size=field.shape), unit="uT", time=np.arange(len(field)) / 25.0)


def level_turn(n: int = 1500, sway_deg: float = 0.0) -> Floats:
    """(N, 3) fields of a body that turns twice, and rolls to and fro on its way."""
    time = np.arange(n) / 25.0
    roll = np.deg2rad(sway_deg) * np.sin(2.0 * np.pi * time / 4.1)
    heading = np.linspace(0.0, 4.0 * np.pi, n)
    north, east, down = np.cos(DIP) * np.cos(heading), -np.cos(DIP) * np.sin(heading), np.full(n, np.sin(DIP))
    cos, sin = np.cos(roll), np.sin(roll)
    return np.stack([north, cos * east + sin * down, cos * down - sin * east], axis=1)


@cache
def known(mounting: tuple[float, float, float]) -> Fit:
    """The calibration from a tumble of the same sensor."""
    directions = np.random.default_rng(1).normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return flinders.fit(reading(directions, mounting, 2))


def turned(samples: Samples) -> Fit:
    """A fresh fit to a level turn, which is one of x and y alone."""
    fresh = flinders.fit(samples)
    assert fresh.claim.plane == "xy"
    return fresh


@pytest.mark.parametrize("mounting", [(0.0, 0.0, 0.0), (8.0, -5.0, 0.0), (-6.0, 11.0, 120.0)])
@pytest.mark.parametrize("sway_deg", daily([2.0, 0.0]))
def test_a_right_calibration_agrees_with_a_level_turn(mounting: tuple[float, float, float], sway_deg: float) -> None:
    samples = reading(level_turn(sway_deg=sway_deg), mounting, 3)
    fresh = turned(samples)
    found = compare_with_turn(known(mounting), fresh, samples)
    assert found.answer in {"holds", "cannot-tell"}
    assert found.heading_difference_deg.worst < (0.15 if sway_deg == 0.0 else 0.6)
    assert found.heading_difference_deg.dip_deg == pytest.approx(60.0, abs=0.5)


def test_differences_are_as_large_as_they_are_claimed_to_be(trials: Choose) -> None:
    """Chi-square of 20 turns is on average its degrees of freedom: five of an ellipse less the scale."""
    mounting = (8.0, -5.0, 0.0)
    squares, claim = [], trials(20, 6)
    for seed in claim.seeds:
        samples = reading(level_turn(400), mounting, 100 + seed)
        found = compare_with_turn(known(mounting), turned(samples), samples)
        assert found.freedom == 4
        squares.append(found.chi_square or 0.0)
    low, high = claim.ratios(2.2 / 4.0, 6.2 / 4.0)
    assert low < np.mean(squares) / 4.0 < high


def test_what_moved_in_the_plane_of_the_turn_is_found_and_what_moved_across_it_is_not() -> None:
    """1 µT forward in the body is 1/25 rad at the worst heading; down in the body it is another height of the field."""
    mounting = (8.0, -5.0, 0.0)
    inside, across = (50.0 * SOFT @ euler(*mounting) @ axis / 50.0 for axis in np.eye(3)[[0, 2]])
    moved = reading(level_turn(), mounting, 5, inside)
    found = compare_with_turn(known(mounting), turned(moved), moved)
    assert found.answer == "fails"
    assert found.heading_difference_deg.worst == pytest.approx(np.rad2deg(1.0 / 25.0), rel=0.1)
    higher = reading(level_turn(), mounting, 5, across)
    assert compare_with_turn(known(mounting), turned(higher), higher).answer == "holds"


def test_a_calibration_that_is_taken_as_exact_adds_nothing_to_the_claim() -> None:
    samples = reading(level_turn(), (0.0, 0.0, 0.0), 6)
    exact = bare_fit(known((0.0, 0.0, 0.0)).calibration)
    held = LevelPair.of(exact, turned(samples), samples)
    assert (held.known.claim.states_uncertainty, held.fresh.claim.states_uncertainty) == (False, True)
