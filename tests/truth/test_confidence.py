"""The bound of 95 % of a level turn is what simulated errors stay within."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest

from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.heading.error_propagation import (
    bounds_deg,
    deviation_covariance,
    deviation_covariances,
    level_error,
    level_gradients,
)

DRAWS = 20_000


@pytest.mark.parametrize("seed", range(6))
def test_simulated_errors_stay_within_the_bound_in_nineteen_of_twenty_turns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ellipsoid = Ellipsoid(rng.normal(size=3), 50.0 * np.eye(3) + symmetric(rng.normal(size=6)))
    root = rng.normal(size=(9, 9)) * np.exp(rng.normal(size=9))
    covariance = 0.01 * root @ root.T
    bound = float(bounds_deg(deviation_covariance(ellipsoid, covariance)[np.newaxis])[0])
    errors = np.rad2deg(level_gradients(ellipsoid) @ (0.1 * root) @ rng.normal(size=(9, DRAWS)))
    assert np.mean(np.abs(errors).max(axis=0) <= bound) == pytest.approx(0.95, abs=0.006)
    worst = level_error(ellipsoid, covariance).worst
    assert 1.95 * worst < bound < 3.09 * worst


def test_a_batch_carries_each_covariance_as_one_alone() -> None:
    rng = np.random.default_rng(7)
    ellipsoids = [Ellipsoid(np.zeros(3), 50.0 * np.eye(3) + symmetric(rng.normal(size=6))) for _ in range(3)]
    roots, dips = rng.normal(size=(3, 9, 9)), np.array([60.0, -30.0, 0.0])
    covariances = roots @ np.swapaxes(roots, 1, 2)
    each = [deviation_covariance(*pair, dip_deg=dip) for *pair, dip in zip(ellipsoids, covariances, dips, strict=True)]
    shapes = np.stack([ellipsoid.shape for ellipsoid in ellipsoids])
    npt.assert_allclose(deviation_covariances(shapes, covariances, dips), each, rtol=1e-9, atol=1e-9)


def test_what_is_not_known_has_no_bound() -> None:
    assert np.isnan(bounds_deg(np.full((1, 4, 4), np.nan))).all()
    assert bounds_deg(np.zeros((1, 4, 4))).tolist() == [0.0]
    assert bounds_deg(np.empty((0, 4, 4))).tolist() == []
