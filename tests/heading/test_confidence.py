"""The bound of 95 % of a level turn is what simulated errors stay within."""

from __future__ import annotations

import numpy as np
import pytest

from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.heading.error_propagation import level_bound_deg, level_error, level_gradients

DRAWS = 20_000


@pytest.mark.parametrize("seed", range(6))
def test_simulated_errors_stay_within_the_bound_in_nineteen_of_twenty_turns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ellipsoid = Ellipsoid(rng.normal(size=3), 50.0 * np.eye(3) + symmetric_matrix(rng.normal(size=6)))
    root = rng.normal(size=(9, 9)) * np.exp(rng.normal(size=9))
    covariance = 0.01 * root @ root.T
    bound = level_bound_deg(ellipsoid, covariance)
    errors = np.rad2deg(level_gradients(ellipsoid) @ (0.1 * root) @ rng.normal(size=(9, DRAWS)))
    assert np.mean(np.abs(errors).max(axis=0) <= bound) == pytest.approx(0.95, abs=0.006)
    worst = level_error(ellipsoid, covariance).worst
    assert 1.95 * worst < bound < 3.09 * worst


def test_what_is_not_known_has_no_bound() -> None:
    sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    assert np.isnan(level_bound_deg(sphere, np.full((9, 9), np.nan)))
    assert level_bound_deg(sphere, np.zeros((9, 9))) == 0.0
