"""Where they must, all estimators agree; and each of the two that iterate gives what an independent solver gives.

The other solvers are written here as plainly as can be, with none of the library's algebra: explicit polynomials per
reading and bisection for the consistent fit, SciPy's least squares for the Sampson and the orthogonal distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import HARD_IRON, SOFT_IRON

from flinders import simulate
from flinders.apps.classic.recipes.alonso_shuster import AlonsoShuster
from flinders.apps.classic.recipes.axes import AxisAligned
from flinders.apps.classic.recipes.ekf import Ekf
from flinders.apps.classic.recipes.ellipsoid import Constrained
from flinders.apps.classic.recipes.li import Li
from flinders.apps.classic.recipes.sequential import Sequential
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.apps.classic.recipes.two_step import TwoStep
from flinders.apps.classic.two_axis_recipe import TwoAxisRecipe
from flinders.estimators import METHODS, Estimator, Readings
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.auto import Auto
from flinders.estimators.consistent import Consistent
from flinders.estimators.ellipse import Ellipse
from flinders.estimators.level import Level
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.minmax import MinMax
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

GENERAL: Final[list[Estimator]] = [
    Auto(),
    Auto(prior=None),
    Likelihood(),
    Robust(),
    Likelihood(prior=None, bias_correction=False),
    Consistent(),
    Li(),
    Li(k=4.0),
    Algebraic(),
    Algebraic("unit"),
    Algebraic("nxp"),
    Constrained(),
    Constrained("auto"),
    TwoStep("non-orthogonal"),
    AlonsoShuster(),
]
SHAPES: Final = {
    "sphere": 50.0 * np.eye(3),
    "axes": np.diag([45.0, 50.0, 60.0]),
    "general": 50.0 * SOFT_IRON,
}
MODELS: Final[dict[str, list[Estimator]]] = {
    "sphere": [
        Sphere(),
        AxisAligned(),
        TwoStep(),
        Sequential(),
        *(Constrained(radii) for radii in ("sphere", "xy", "xz", "yz")),
        *GENERAL,
    ],
    "axes": [AxisAligned(), TwoStep(), Constrained("aligned"), *GENERAL],
    "general": GENERAL,
}


def recorded(shape: Floats, noise: float, *, n: int = 1000, seed: int = 1, half: bool = False) -> Floats:
    rng = np.random.default_rng(seed)
    directions = (simulate.hemisphere if half else simulate.uniform_directions)(rng, n)
    return np.asarray(HARD_IRON + directions @ shape + noise * rng.standard_normal((n, 3)), np.float64)


def test_every_method_of_all_attitudes_takes_part() -> None:
    """But what does not look at most readings, or not back at them, or looks at a plane alone."""
    others = {Level, Ellipse, TwoAxisRecipe, MinMax, Ekf}
    assert {type(estimator) for estimator in MODELS["sphere"]} == set(METHODS.values()) - others


@pytest.mark.parametrize("kind", sorted(SHAPES))
@pytest.mark.parametrize(("noise", "tolerance"), [(0.0, 5e-7), (0.01, 5e-4), (0.1, 1e-2)])
def test_all_methods_agree_on_data_that_all_can_describe(kind: str, noise: float, tolerance: float) -> None:
    """To rounding without noise; with little of it to a twentieth of it, or where one has fewer unknowns, a third."""
    readings = Readings.of(recorded(SHAPES[kind], noise))
    reference = Auto().estimate(readings)
    for estimator in MODELS[kind]:
        found = estimator.estimate(readings)
        allowed = tolerance if estimator in GENERAL else tolerance + 0.3 * noise
        assert np.abs(found.ellipsoid.centre - reference.ellipsoid.centre).max() < allowed, estimator
        assert np.abs(found.ellipsoid.shape - reference.ellipsoid.shape).max() < allowed, estimator
        assert found.noise == pytest.approx(noise, rel=0.1, abs=2e-5)
        npt.assert_allclose(found.ellipsoid.centre, HARD_IRON, rtol=0, atol=1e-8 + 5 * noise * np.sqrt(3 / 1000))


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_all_methods_claim_like_uncertainties_of_the_offset(kind: str) -> None:
    """Within a fifth of each other all round, where weights hardly matter."""
    readings = Readings.of(recorded(SHAPES[kind], 0.5))
    sigmas = [np.sqrt(np.diag(estimator.estimate(readings).covariance)[:3]) for estimator in MODELS[kind]]
    for sigma in sigmas:
        npt.assert_allclose(sigma, sigmas[-1], rtol=0.2)


# The consistent fit, brute force.


def hermite(x: Floats, power: int, variance: float) -> Floats:
    """The polynomial t_k with E[t_k(x + noise)] = x^k."""
    if power == 0:
        return np.ones_like(x)
    if power == 1:
        return x
    if power == 2:
        return x**2 - variance
    if power == 3:
        return x**3 - 3 * x * variance
    return np.asarray(x**4 - 6 * x**2 * variance + 3 * variance**2, np.float64)


def psi(z: Floats, variance: float) -> Floats:
    """(10, 10) corrected scatter: Markovsky's η(p, q) with R(p, q, i) counted out, reading by reading."""
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2), (0, -1), (1, -1), (2, -1), (-1, -1)]
    matrix = np.empty((10, 10))
    for p, first in enumerate(pairs):
        for q, second in enumerate(pairs):
            powers = [(*first, *second).count(axis) for axis in range(3)]
            doubled = (2 if p in (3, 4, 5) else 1) * (2 if q in (3, 4, 5) else 1)
            product = np.prod([hermite(z[:, axis], powers[axis], variance) for axis in range(3)], axis=0)
            matrix[p, q] = doubled * product.sum()
    return matrix


def bisected(field: Floats) -> tuple[Ellipsoid, float]:
    """The consistent ellipsoid and σ by bisecting σ² down to rounding."""
    origin = field.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((field - origin) ** 2, axis=1))))
    z = (field - origin) / scale
    low, high = 0.0, float(np.linalg.eigvalsh(np.cov(z.T, bias=True))[0])
    for _ in range(45):
        middle = (low + high) / 2
        if np.linalg.eigvalsh(psi(z, middle))[0] > 0:
            low = middle
        else:
            high = middle
    coefficients = np.linalg.eigh(psi(z, low))[1][:, 0]
    return Ellipsoid.from_quadric(coefficients).in_frame(origin, scale), scale * float(np.sqrt(low))


@pytest.mark.parametrize("half", [False, True], ids=["full", "half"])
@pytest.mark.parametrize("noise", [0.1, 2.0])
def test_the_consistent_fit_is_that_of_bisection_with_a_polynomial_for_each_reading(noise: float, half: bool) -> None:
    field = recorded(SHAPES["general"], noise, n=300, half=half)
    ellipsoid, sigma = bisected(field)
    found = Consistent().estimate(Readings.of(field))
    assert found.noise == pytest.approx(sigma, rel=1e-8)
    npt.assert_allclose(found.ellipsoid.centre, ellipsoid.centre, rtol=0, atol=1e-7)
    npt.assert_allclose(found.ellipsoid.shape, ellipsoid.shape, rtol=0, atol=1e-7)


# The likelihood, by SciPy.


def parameters(ellipsoid: Ellipsoid) -> Floats:
    return np.concatenate([ellipsoid.centre, upper_entries(ellipsoid.shape)])


def sampson(field: Floats) -> Callable[[Floats], Floats]:
    """Residuals (|u| − 1) |u| / |Tᵀu| with u = T (x − b), T = S⁻¹, as the notes write it."""

    def residuals(theta: Floats) -> Floats:
        inverse = np.linalg.inv(symmetric_matrix(theta[3:]))
        u = (field - theta[:3]) @ inverse.T
        n = np.linalg.norm(u, axis=1)
        return np.asarray((n - 1) * n / np.linalg.norm(u @ inverse, axis=1), np.float64)

    return residuals


def orthogonal(field: Floats) -> Callable[[Floats], Floats]:
    """Distances to the nearest point, y a²/(a² + λ) in the principal frame with λ by Newton's method."""

    def residuals(theta: Floats) -> Floats:
        axes, frame = np.linalg.eigh(symmetric_matrix(theta[3:]))
        y = (field - theta[:3]) @ frame
        squares = axes**2
        multiplier = np.zeros(len(y))
        for _ in range(30):
            scaled = y * axes / (squares + multiplier[:, np.newaxis])
            value = np.sum(scaled**2, axis=1) - 1
            slope = -2 * np.sum(scaled**2 / (squares + multiplier[:, np.newaxis]), axis=1)
            multiplier = multiplier - value / slope
        foot = y * squares / (squares + multiplier[:, np.newaxis])
        outside = np.sign(np.sum((y / axes) ** 2, axis=1) - 1)
        return np.asarray(outside * np.linalg.norm(y - foot, axis=1), np.float64)

    return residuals


def by_scipy(residuals: Callable[[Floats], Floats], start: Ellipsoid) -> Floats:
    from scipy.optimize import least_squares

    solution = least_squares(residuals, parameters(start), method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found: Floats = solution.x
    return found


@pytest.mark.parametrize("half", [False, True], ids=["full", "half"])
@pytest.mark.parametrize("noise", [0.1, 0.5, 2.0])
def test_the_uncorrected_likelihood_is_scipys_minimum_of_the_sampson_cost(noise: float, half: bool) -> None:
    field = recorded(SHAPES["general"], noise, n=400, half=half)
    readings = Readings.of(field)
    found = Likelihood(prior=None, bias_correction=False).estimate(readings)
    wanted = by_scipy(sampson(field), Consistent().estimate(readings).ellipsoid)
    off = np.abs(parameters(found.ellipsoid) - wanted) / np.sqrt(np.diag(found.covariance))
    assert off.max() < 1e-5
    cost = float(np.sum(sampson(field)(wanted) ** 2))
    assert found.noise == pytest.approx(np.sqrt(cost / (400 - 9)), rel=1e-9)


@pytest.mark.parametrize(("noise", "share"), [(0.1, 0.005), (0.5, 0.02), (2.0, 0.08)])
def test_the_orthogonal_distance_gives_nearly_the_same(noise: float, share: float) -> None:
    """Sampson's distance is the orthogonal one to first order: the fits differ by a share of σ that grows with σ."""
    field = recorded(SHAPES["general"], noise, n=400)
    readings = Readings.of(field)
    found = Likelihood(prior=None, bias_correction=False).estimate(readings)
    wanted = by_scipy(orthogonal(field), found.ellipsoid)
    off = np.abs(parameters(found.ellipsoid) - wanted) / np.sqrt(np.diag(found.covariance))
    assert off.max() < share
    residuals = orthogonal(field)(parameters(found.ellipsoid))
    npt.assert_allclose(sampson(field)(parameters(found.ellipsoid)), residuals, atol=noise**2 / 5 + 1e-6)


def test_the_covariance_is_that_of_scipys_jacobian() -> None:
    from scipy.optimize import least_squares

    field = recorded(SHAPES["general"], 0.5, n=400)
    readings = Readings.of(field)
    found = Likelihood(prior=None, bias_correction=False).estimate(readings)
    solution = least_squares(sampson(field), parameters(found.ellipsoid), method="lm")
    wanted = float(np.sum(solution.fun**2)) / (400 - 9) * np.linalg.inv(solution.jac.T @ solution.jac)
    npt.assert_allclose(found.covariance, wanted, rtol=0, atol=1e-4 * np.abs(wanted).max())
