"""Jacobians against differences, and the bias of curvature against a Monte Carlo of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.numpy_likelihood import exact_equations
from tests.worlds import HARD_IRON, SOFT_IRON

from flinders import simulate
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.likelihood import magnitude, prior

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

ELLIPSOID = Ellipsoid(HARD_IRON, 50.0 * SOFT_IRON)


def moved(change: Floats) -> Ellipsoid:
    return Ellipsoid(ELLIPSOID.centre + change[:3], ELLIPSOID.shape + symmetric_matrix(change[3:]))


def differences(value: Callable[[Floats], Floats], step: float = 1e-4) -> Floats:
    """(..., 9) central differences with respect to (b, S)."""
    columns = [(value(step * unit) - value(-step * unit)) / (2.0 * step) for unit in np.eye(9)]
    return np.stack(columns, axis=-1)


def on_the_surface(n: int) -> tuple[Floats, Floats]:
    directions = simulate.fibonacci(n)
    return directions, ELLIPSOID.centre + directions @ ELLIPSOID.shape


def scattered(n: int, noise: float) -> Floats:
    return on_the_surface(n)[1] + noise * np.random.default_rng(1).standard_normal((n, 3))


def test_the_distance_is_the_true_one_near_the_surface() -> None:
    directions, surface = on_the_surface(60)
    normals = np.linalg.solve(ELLIPSOID.shape, directions.T).T
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for distance in (-1e-3, 1e-3):
        npt.assert_allclose(magnitude.distances(surface + distance * normals, ELLIPSOID), distance, rtol=1e-4)


def test_the_foot_point_jacobian_is_how_distances_change_on_the_surface() -> None:
    directions, surface = on_the_surface(60)
    wanted = -differences(lambda change: magnitude.distances(surface, moved(change)))
    npt.assert_allclose(magnitude.information(directions, ELLIPSOID), wanted, atol=1e-8)
    equations = magnitude.equations([surface], ELLIPSOID)
    npt.assert_allclose(equations.matrix, wanted.T @ wanted, atol=1e-6)
    assert equations.count == 60


def test_away_from_the_surface_the_foot_point_jacobian_differs_by_first_order_only() -> None:
    readings = scattered(60, 1.0)
    wanted = -differences(lambda change: magnitude.distances(readings, moved(change)))
    found = magnitude.equations([readings], ELLIPSOID).matrix
    npt.assert_allclose(found, wanted.T @ wanted, atol=0.1 * np.abs(found).max())


@pytest.mark.parametrize("noise", [0.0, 1.0, 10.0, 40.0])
def test_the_exact_gradient_is_that_of_the_sampson_cost_anywhere(noise: float) -> None:
    readings = scattered(60, noise)
    wanted = -differences(lambda change: magnitude.distances(readings, moved(change)))
    s = magnitude.distances(readings, ELLIPSOID)
    found = exact_equations([readings], ELLIPSOID)
    npt.assert_allclose(found.gradient, wanted.T @ s, rtol=1e-6, atol=1e-5)
    npt.assert_allclose(found.matrix, wanted.T @ wanted, rtol=1e-6, atol=1e-5)
    assert found.cost == pytest.approx(s @ s)


def test_equations_do_not_depend_on_how_the_readings_come_in_blocks() -> None:
    readings = scattered(20_000, 1.0)
    whole = magnitude.equations([readings], ELLIPSOID)
    parts = magnitude.equations(np.array_split(readings, 13), ELLIPSOID)
    npt.assert_allclose(parts.matrix, whole.matrix, rtol=1e-10, atol=1e-8)
    npt.assert_allclose(parts.gradient, whole.gradient, rtol=1e-10, atol=1e-8)
    assert parts.count == whole.count == 20_000


def test_curvature_is_the_mean_gradient_that_noise_causes() -> None:
    """Monte Carlo of E[Σ J s] with mirrored noise, which takes the part of first order out of the scatter."""
    sigma, rounds = 0.5, 3000
    _, surface = on_the_surface(40)
    rng = np.random.default_rng(2)
    total = np.zeros(9)
    for _ in range(rounds // 100):
        noise = sigma * rng.standard_normal((100, 40, 3))
        pairs = np.concatenate([surface + noise, surface - noise]).reshape(-1, 3)
        total += magnitude.equations([pairs], ELLIPSOID).gradient
    found = total / (2 * rounds)
    wanted = sigma**2 * magnitude.curvature(surface, ELLIPSOID)
    # Gradients on the diagonal of S are about 0.1; measured to about one in three hundred.
    npt.assert_allclose(found, wanted, rtol=0, atol=0.015 * np.abs(wanted).max())
    assert np.abs(wanted[3:6]).min() > 0.5 * np.abs(wanted).max()


def test_curvature_of_a_sphere_is_that_of_a_sphere() -> None:
    """On a sphere of radius R, E[|x|] − R = σ²/R: the mean distance that noise adds, all of it outwards."""
    sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    directions = simulate.fibonacci(1000)
    found = magnitude.curvature(50.0 * directions, sphere)
    npt.assert_allclose(found[3:6], 1000 / 3 / 50.0, rtol=1e-3)
    npt.assert_allclose(found[[0, 1, 2, 6, 7, 8]], 0.0, atol=0.05)


def test_the_prior_costs_what_its_formula_says() -> None:
    for spread in (0.1, 0.3):
        shape = ELLIPSOID.shape
        radius = np.trace(shape) / 3.0
        deviator = shape / radius - np.eye(3)
        found = prior.equations(ELLIPSOID, spread=spread)
        assert found.cost == pytest.approx(float(np.sum(deviator**2)) / (2.0 * spread**2))
        assert found.count == 0


def test_the_gradient_of_the_prior_is_that_of_its_cost() -> None:
    spread = 0.3

    def cost(change: Floats) -> Floats:
        shape = ELLIPSOID.shape + symmetric_matrix(change[3:])
        radius = np.trace(shape) / 3.0
        deviator = shape - radius * np.eye(3)
        return np.asarray(np.sum(deviator**2) / (2.0 * spread**2 * radius**2))

    found = prior.equations(ELLIPSOID, spread=spread)
    npt.assert_allclose(found.gradient, -0.5 * differences(cost), atol=1e-7)


def test_the_prior_says_nothing_of_centre_and_size_and_nothing_against_a_sphere() -> None:
    found = prior.equations(Ellipsoid(np.array([1.0, 2.0, 3.0]), 50.0 * np.eye(3)))
    npt.assert_allclose(found.gradient, 0.0, atol=1e-12)
    npt.assert_allclose(found.matrix[:3], 0.0)
    size = np.concatenate([np.zeros(3), upper_entries(np.eye(3))])
    npt.assert_allclose(found.matrix @ size, 0.0, atol=1e-15)
    assert np.linalg.matrix_rank(found.matrix) == 5


def test_off_diagonal_entries_have_the_stated_standard_deviation() -> None:
    spread, radius = 0.2, 50.0
    found = prior.equations(Ellipsoid(np.zeros(3), radius * np.eye(3)), spread=spread)
    npt.assert_allclose(1.0 / np.sqrt(np.diag(found.matrix)[6:]), spread * radius)
