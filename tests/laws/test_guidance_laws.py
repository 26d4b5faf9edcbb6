"""Laws of guidance: the best of all cells, whatever the sensor, its axes and its covariance."""

from __future__ import annotations

from itertools import pairwise, permutations, product
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.directions import direction_gradients
from tests.sentences import assert_raises

from flinders import simulate
from flinders.errors import UsageError
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import direction_errors_deg, level_error, level_gradients
from flinders.heading.guidance import guide, reading_variance
from flinders.likelihood import magnitude
from flinders.summary.coverage import CELL_CENTRES, Coverage

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.heading.guidance import Goal

MAPPINGS: Final = [
    np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((1, -1), repeat=3)
]
SHARPNESS, BATCH_SHARE = 4, 0.01
GOALS: Final[tuple[Goal, ...]] = ("heading", "attitude")
seeds = st.integers(0, 10_000)


def case(seed: int, rank: int = 9) -> tuple[Ellipsoid, Floats, Coverage]:
    """An ellipsoid, a covariance of some rank, and a coverage, all at random."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-2, 4)
    ellipsoid = Ellipsoid(scale * rng.normal(size=3), scale * simulate.soft_iron(rng))
    root = 0.02 * scale * rng.normal(size=(9, rank)) * 10.0 ** rng.uniform(-1, 1, rank)
    return ellipsoid, root @ root.T, Coverage.of(simulate.hemisphere(rng, 500))


def criterion(ellipsoid: Ellipsoid, covariance: Floats, goal: Goal, dip_deg: float) -> float:
    """Mean of the fourth powers of the variances that matter, one by one."""
    if goal == "heading":
        variances = [row @ covariance @ row for row in level_gradients(ellipsoid, dip_deg=dip_deg)]
    else:
        variances = [np.trace(rows @ covariance @ rows.T) for rows in direction_gradients(ellipsoid, CELL_CENTRES)]
    return float(np.mean(np.power(variances, SHARPNESS)))


@given(seeds, st.sampled_from(GOALS), st.floats(-80, 80), st.sampled_from([4, 6, 9]))
def test_no_other_cell_is_better_than_the_advice(seed: int, goal: Goal, dip_deg: float, rank: int) -> None:
    ellipsoid, covariance, coverage = case(seed, rank)
    noise = 0.01 * ellipsoid.radius
    advice = guide(ellipsoid, covariance, noise=noise, coverage=coverage, dip_deg=dip_deg, goal=goal)
    jacobian = magnitude.information(CELL_CENTRES, ellipsoid)
    variance = reading_variance(ellipsoid, covariance, noise, coverage.counts) / (BATCH_SHARE * coverage.readings)
    after = []
    for row in jacobian:
        gain = covariance @ row
        after.append(criterion(ellipsoid, covariance - np.outer(gain, gain) / (variance + row @ gain), goal, dip_deg))
    chosen = int(np.argmax(CELL_CENTRES @ advice.direction))
    assert after[chosen] <= min(after) * (1 + 1e-6)
    assert advice.after_deg <= advice.worst_deg * (1 + 1e-9)


@given(seeds)
def test_the_batch_is_what_an_inverse_of_the_information_gives(seed: int) -> None:
    ellipsoid, covariance, coverage = case(seed)
    advice = guide(ellipsoid, covariance, noise=0.0, coverage=coverage, batch=7)
    jacobian = magnitude.information(CELL_CENTRES, ellipsoid)
    row = jacobian[int(np.argmax(CELL_CENTRES @ advice.direction))]
    variance = reading_variance(ellipsoid, covariance, 0.0, coverage.counts)
    after = np.linalg.inv(np.linalg.inv(covariance) + 7.0 / variance * np.outer(row, row))
    assert advice.after_deg == pytest.approx(level_error(ellipsoid, after).worst, rel=1e-4)


@given(seeds, st.sampled_from(MAPPINGS))
def test_errors_of_directions_turn_with_the_axes(seed: int, mapping: Floats) -> None:
    ellipsoid, covariance, _ = case(seed)
    moved, carried = turned(ellipsoid, covariance, mapping)
    directions = simulate.fibonacci(60)
    npt.assert_allclose(
        direction_errors_deg(moved, carried, directions @ mapping.T),
        direction_errors_deg(ellipsoid, covariance, directions),
        rtol=1e-6,
    )


@given(seeds, st.sampled_from(GOALS), st.booleans(), st.booleans())
def test_advice_turns_with_the_axes_where_the_cells_do(seed: int, goal: Goal, over_y: bool, over_z: bool) -> None:
    """Cells map onto cells where y or z changes its sign."""
    ellipsoid, covariance, coverage = case(seed)
    mapping = np.diag([1.0, -1.0 if over_y else 1.0, -1.0 if over_z else 1.0])
    moved, carried = turned(ellipsoid, covariance, mapping)
    places = np.argmax(CELL_CENTRES @ mapping @ CELL_CENTRES.T, axis=1)
    counted = Coverage(coverage.counts[places], mapping @ coverage.hole, coverage.hole_deg)
    noise, dip_deg = 0.01 * ellipsoid.radius, 60.0
    here = guide(ellipsoid, covariance, noise=noise, coverage=coverage, dip_deg=dip_deg, goal=goal)
    there = guide(
        moved, carried, noise=noise, coverage=counted, dip_deg=dip_deg, down=mapping @ [0.0, 0.0, 1.0], goal=goal
    )
    npt.assert_allclose(there.errors_deg, here.errors_deg[places], rtol=1e-6)
    assert there.worst_deg == pytest.approx(here.worst_deg, rel=1e-6)
    assert there.after_deg == pytest.approx(here.after_deg, rel=1e-3)


@given(seeds, st.sampled_from(GOALS))
def test_a_larger_batch_and_a_better_reading_never_tell_less(seed: int, goal: Goal) -> None:
    ellipsoid, covariance, coverage = case(seed)
    noise = 0.01 * ellipsoid.radius
    afters = [
        criterion_after(ellipsoid, covariance, noise, coverage, goal, batch) for batch in (1.0, 5.0, 50.0, 5000.0)
    ]
    assert all(more <= less * (1 + 1e-9) for less, more in pairwise(afters))


def criterion_after(
    ellipsoid: Ellipsoid, covariance: Floats, noise: float, coverage: Coverage, goal: Goal, batch: float
) -> float:
    """The criterion at the advice, after a batch there."""
    advice = guide(ellipsoid, covariance, noise=noise, coverage=coverage, goal=goal, batch=batch)
    jacobian = magnitude.information(CELL_CENTRES, ellipsoid)
    row = jacobian[int(np.argmax(CELL_CENTRES @ advice.direction))]
    gain = covariance @ row
    variance = reading_variance(ellipsoid, covariance, noise, coverage.counts) / batch
    return criterion(ellipsoid, covariance - np.outer(gain, gain) / (variance + row @ gain), goal, 60.0)


def turned(ellipsoid: Ellipsoid, covariance: Floats, rotation: Floats) -> tuple[Ellipsoid, Floats]:
    """The same sensor in axes that are turned or mirrored."""
    change = np.stack(
        [
            np.concatenate([rotation @ e[:3], upper_entries(rotation @ symmetric_matrix(e[3:]) @ rotation.T)])
            for e in np.eye(9)
        ],
        axis=1,
    )
    moved = Ellipsoid(rotation @ ellipsoid.centre, rotation @ ellipsoid.shape @ rotation.T)
    return moved, change @ covariance @ change.T


def test_nothing_to_learn_and_nothing_known_are_both_answered() -> None:
    sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    empty = Coverage(np.zeros(100), CELL_CENTRES[0], 180.0)
    known = guide(sphere, np.zeros((9, 9)), noise=0.0, coverage=empty)
    assert (known.worst_deg, known.after_deg) == (0.0, 0.0)
    assert known.is_reached(1e-9)
    unknown = guide(sphere, 100.0 * np.eye(9), noise=0.5, coverage=empty)
    assert not unknown.is_reached(1.0)
    assert unknown.after_deg <= unknown.worst_deg


def test_there_is_no_heading_to_guide_at_the_poles() -> None:
    ellipsoid, covariance, coverage = case(1)
    with assert_raises(UsageError):
        guide(ellipsoid, covariance, noise=0.5, coverage=coverage, dip_deg=90.0)
    assert guide(ellipsoid, covariance, noise=0.5, coverage=coverage, dip_deg=90.0, goal="attitude").worst_deg > 0.0
