"""Variances of a full, uniform sphere in closed form, against 400 fits and against what each fit claims.

With N readings of noise σ in a field B all round (§12 of the literature notes):

- σ(V) = σ √(3/N) an axis and σ(B) = σ/√N
- off the diagonal, σ(M_ij) = (σ/B) √(15/4N)
- on it, σ(M_ii) = (σ/B) √(6/N) with correlation −1/4 where the field strength is given, M = B S⁻¹; with determinant
  one the entries add up to nothing, which leaves (σ/B) √(5/N) and −1/2. (The notes give the former for both; a
  heading does not tell them apart, as it sees differences only.)
- the heading of a level vehicle follows, with H = B cos I:
  σ²(ψ) = σ²(V)/H² + σ²(M_ij) (tan² I + ½) + σ²(M_ii) (2 − 2ρ)/8
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest

from flinders import simulate
from flinders.estimators import Estimator, Readings
from flinders.estimators.likelihood import Likelihood
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import level_error, level_turn

if TYPE_CHECKING:
    from flinders.arrays import Floats

N: Final = 1000
FIELD: Final = 50.0
SIGMA: Final = 0.5
TRIALS: Final = 400
METHOD: Final[Estimator] = Likelihood(prior=None)
OFFSET_SIGMA: Final = SIGMA * np.sqrt(3.0 / N)
FIELD_SIGMA: Final = SIGMA / np.sqrt(N)
DIAGONAL_SIGMA: Final = SIGMA / FIELD * np.sqrt(5.0 / N)
GIVEN_SIGMA: Final = SIGMA / FIELD * np.sqrt(6.0 / N)
CROSS_SIGMA: Final = SIGMA / FIELD * np.sqrt(15.0 / (4.0 * N))


WANTED: Final = np.repeat(
    [OFFSET_SIGMA, FIELD_SIGMA, DIAGONAL_SIGMA, CROSS_SIGMA, GIVEN_SIGMA, CROSS_SIGMA], [3, 1, 3, 3, 3, 3]
)


def results(ellipsoid: Ellipsoid) -> Floats:
    """(16,) offset, strength, entries 11, 22, 33, 12, 13, 23 of the matrix: determinant one, then strength given."""
    radius, root = ellipsoid.radius, upper_entries(np.linalg.inv(ellipsoid.shape))
    return np.concatenate([ellipsoid.centre, [radius], radius * root, FIELD * root])


@cache
def trials() -> tuple[Floats, Floats, tuple[Ellipsoid, ...]]:
    """(400, 16) results, (400, 9, 9) claimed covariances of (b, S), and the ellipsoids."""
    rng = np.random.default_rng(12)
    found = []
    for _ in range(TRIALS):
        directions = simulate.uniform_directions(rng, N)
        field = FIELD * directions + [20.0, 120.0, 90.0] + SIGMA * rng.standard_normal((N, 3))
        found.append(METHOD.estimate(Readings.of(field)))
    return (
        np.array([results(estimate.ellipsoid) for estimate in found]),
        np.array([estimate.covariance for estimate in found]),
        tuple(estimate.ellipsoid for estimate in found),
    )


@cache
def claimed() -> Floats:
    """(16, 16) mean claimed covariance of the results: carried over from (b, S) by central differences."""
    sphere = Ellipsoid(np.zeros(3), FIELD * np.eye(3))
    columns = []
    for unit in 1e-4 * np.eye(9):
        up, down = (
            results(Ellipsoid(sphere.centre + sign * unit[:3], sphere.shape + sign * symmetric_matrix(unit[3:])))
            for sign in (1, -1)
        )
        columns.append((up - down) / 2e-4)
    jacobian = np.stack(columns, axis=1)
    covariance: Floats = jacobian @ trials()[1].mean(axis=0) @ jacobian.T
    return covariance


@cache
def scattered() -> Floats:
    """(16, 16) covariance of the results over the trials."""
    covariance: Floats = np.cov(trials()[0].T)
    return covariance


def test_offset_strength_and_matrix_scatter_as_the_closed_forms_say() -> None:
    npt.assert_allclose(np.sqrt(np.diag(scattered())), WANTED, rtol=0.15)


def test_and_every_fit_claims_as_much() -> None:
    npt.assert_allclose(np.sqrt(np.diag(claimed())), WANTED, rtol=0.03)


@pytest.mark.parametrize(("first", "wanted"), [(4, -0.5), (10, -0.25)], ids=["determinant-one", "strength-given"])
def test_the_diagonal_of_the_matrix_is_correlated(first: int, wanted: float) -> None:
    for covariance, tolerance in ((claimed(), 0.01), (scattered(), 0.15)):
        block = covariance[first : first + 3, first : first + 3]
        sigmas = np.sqrt(np.diag(block))
        correlation = (block / np.outer(sigmas, sigmas))[np.triu_indices(3, 1)]
        npt.assert_allclose(correlation, wanted, atol=tolerance)


def test_there_is_no_bias_worth_the_name() -> None:
    """The mean over 400 fits lies within four of its own standard deviations of the truth."""
    found = trials()[0]
    wanted = np.array([20.0, 120.0, 90.0, FIELD, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0])
    off = (found.mean(axis=0) - wanted) / (found.std(axis=0) / np.sqrt(TRIALS))
    assert np.abs(off).max() < 4.0


@pytest.mark.parametrize(("dip_deg", "printed"), [(0.0, 0.048), (45.0, 0.066), (60.0, 0.091), (70.0, 0.132)])
def test_the_heading_of_a_level_vehicle_errs_as_the_closed_form_says(dip_deg: float, printed: float) -> None:
    dip = np.deg2rad(dip_deg)
    variance = (
        (OFFSET_SIGMA / (FIELD * np.cos(dip))) ** 2
        + CROSS_SIGMA**2 * (np.tan(dip) ** 2 + 0.5)
        + GIVEN_SIGMA**2 * (2.0 + 2.0 / 4.0) / 8.0
    )
    wanted = float(np.rad2deg(np.sqrt(variance)))
    assert wanted == pytest.approx(printed, rel=0.05)  # the notes print a Monte Carlo of it
    # What each fit claims.
    _, covariances, ellipsoids = trials()
    claims = [level_error(e, c, dip_deg=dip_deg).rms for e, c in zip(ellipsoids, covariances, strict=True)]
    assert float(np.sqrt(np.mean(np.square(claims)))) == pytest.approx(wanted, rel=0.03)
    # What its heading then errs by, the mean over all headings removed.
    heading, directions = level_turn(dip_deg)
    readings = np.array([[20.0], [120.0], [90.0]]) + FIELD * directions
    squares = []
    for ellipsoid in ellipsoids:
        x, y, _ = np.linalg.solve(ellipsoid.shape, readings - ellipsoid.centre[:, np.newaxis])
        error = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
        squares.append(np.mean((error - error.mean()) ** 2))
    assert float(np.rad2deg(np.sqrt(np.mean(squares)))) == pytest.approx(wanted, rel=0.15)
