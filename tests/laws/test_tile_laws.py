"""The tiles are a partition of the sphere into pieces of nearly one size."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st

from flinders.geometry.sphere import TILE_COUNT, fibonacci, tile_indices, tiles


def test_areas_are_alike_and_make_up_the_sphere() -> None:
    shares = tiles().areas * TILE_COUNT / (4.0 * np.pi)
    is_pentagon = np.array([len(corners) == 5 for corners in tiles().polygons()])
    assert is_pentagon.sum() == 12
    npt.assert_allclose(tiles().areas.sum(), 4.0 * np.pi, rtol=1e-12)
    assert 0.92 < shares[~is_pentagon].min() < shares[~is_pentagon].max() < 1.04
    npt.assert_allclose(shares[is_pentagon], 0.82, atol=0.01)


def test_corners_are_as_far_from_three_centres_and_no_centre_is_nearer() -> None:
    cosines = np.sort(tiles().corners.reshape(-1, 3) @ tiles().centres.T, axis=1)
    npt.assert_allclose(cosines[:, -3], cosines[:, -1], atol=1e-12)
    assert np.all(cosines[:, -4] < cosines[:, -1] - 1e-4)


def test_corners_go_round_anticlockwise() -> None:
    for centre, ring in zip(tiles().centres, tiles().polygons(), strict=True):
        turning = np.linalg.det(
            np.stack([np.broadcast_to(centre, ring.shape), ring, np.roll(ring, -1, axis=0)], axis=1)
        )
        assert np.all(turning > 0.0)


def test_each_centre_lies_in_its_own_tile_and_on_its_centroid() -> None:
    npt.assert_array_equal(tile_indices(tiles().centres), np.arange(TILE_COUNT))
    many = fibonacci(200_000)
    found = tile_indices(many)
    middles = np.stack([np.bincount(found, many[:, axis], TILE_COUNT) for axis in range(3)], axis=1)
    middles = middles / np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.rad2deg(np.arccos(np.sum(middles * tiles().centres, axis=1).clip(-1, 1))).max() < 0.2


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6))
def test_a_direction_falls_into_the_tile_of_the_nearest_centre_whatever_its_length(seed: int, length: float) -> None:
    directions = np.random.default_rng(seed).normal(size=(50, 3))
    cosines = directions @ tiles().centres.T
    found = tile_indices(length * directions)
    size = np.linalg.norm(directions, axis=1)
    npt.assert_allclose(cosines[np.arange(50), found], cosines.max(axis=1), atol=1e-6 * size.max())


def test_no_directions_fall_into_no_tile() -> None:
    assert tile_indices(np.empty((0, 3))).shape == (0,)
