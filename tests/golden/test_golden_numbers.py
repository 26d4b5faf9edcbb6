"""Numbers that other people's software, papers and manuals print, to the digits they give.

The deterministic data set and its table are §14 of the project's literature notes: 500 directions on a Fibonacci
spiral, a known soft iron and offset, noise from one seed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import HARD_IRON, SOFT_IRON, spiral

import flinders
from flinders.estimators import Estimator, Readings
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.minmax import MinMax
from flinders.fitting.axis_extremes import from_extremes

if TYPE_CHECKING:
    from flinders.estimators import Estimate

RADIUS: Final = 50.0 * float(np.cbrt(np.linalg.det(SOFT_IRON)))

OLS: Final = Algebraic("unit")
ALS: Final = Consistent()
NXP: Final = Algebraic("nxp")
SAMPSON: Final = Likelihood(prior=None, bias_correction=False)


def estimated(estimator: Estimator, sigma: float, *, half: bool = False) -> Estimate:
    return estimator.estimate(Readings.of(spiral(sigma, half=half)))


def test_the_data_set_is_the_one_the_table_was_made_from() -> None:
    root = np.linalg.inv(SOFT_IRON) * np.cbrt(np.linalg.det(SOFT_IRON))
    npt.assert_allclose(
        root[np.triu_indices(3)], [0.968164, -0.109338, -0.029951, 1.209213, -0.016238, 0.864239], atol=1e-6
    )
    assert pytest.approx(52.642425, abs=5e-7) == RADIUS
    assert len(spiral(0.5, half=True)) == 250


@pytest.mark.parametrize(
    ("estimator", "sigma", "half", "offset", "radius"),
    [
        (OLS, 0.5, False, "19.965664 119.987414 90.036034", 52.61910),
        (ALS, 0.5, False, "19.965666 119.987404 90.036029", 52.60925),
        (SAMPSON, 0.5, False, "19.972826 119.981238 90.029613", 52.61371),
        (NXP, 0.5, False, "19.965673 119.988251 90.027549", 52.61706),
        (OLS, 2.0, False, "19.869895 119.942991 90.147517", 52.66372),
        (ALS, 2.0, False, "19.869996 119.942313 90.147129", 52.50666),
        (SAMPSON, 2.0, False, "19.892375 119.923749 90.120863", 52.57790),
        (OLS, 0.5, True, "19.945319 120.220488 91.375501", 52.03652),
        (ALS, 0.5, True, "19.941309 120.220195 91.266240", 52.07418),
        (SAMPSON, 0.5, True, "19.922960 120.221195 91.015552", 52.18680),
    ],
)
def test_offset_and_radius_are_those_of_the_table(
    estimator: Estimator, sigma: float, half: bool, offset: str, radius: float
) -> None:
    found = estimated(estimator, sigma, half=half).ellipsoid
    # Six decimals are printed; the iterated rows were made with least_squares' default tolerances, 1e-8 of the cost.
    npt.assert_allclose(found.centre, [float(part) for part in offset.split()], rtol=0, atol=1.1e-6)
    assert found.radius == pytest.approx(radius, rel=1e-6)


@pytest.mark.parametrize(
    ("estimator", "height", "radius"), [(OLS, 95.912, 50.143), (ALS, 94.521, None), (SAMPSON, 93.791, None)]
)
def test_half_a_sphere_with_four_percent_noise(estimator: Estimator, height: float, radius: float | None) -> None:
    found = estimated(estimator, 2.0, half=True).ellipsoid
    assert found.centre[2] == pytest.approx(height, abs=5.1e-4)
    if radius is not None:
        assert found.radius == pytest.approx(radius, rel=1e-5)


@pytest.mark.parametrize(
    ("estimator", "sigma", "half", "noise"),
    [
        (ALS, 0.5, False, 0.508812),
        (ALS, 2.0, False, 2.029853),
        (ALS, 0.5, True, 0.491080),
        (ALS, 2.0, True, 1.958321),
        (SAMPSON, 0.5, False, 0.512693),
        (SAMPSON, 2.0, False, 2.046283),
        (SAMPSON, 0.5, True, 0.500558),
        (SAMPSON, 2.0, True, 1.995568),
    ],
)
def test_the_noise_found_is_that_of_the_table(estimator: Estimator, sigma: float, half: bool, noise: float) -> None:
    assert estimated(estimator, sigma, half=half).noise == pytest.approx(noise, abs=1e-6)


@pytest.mark.parametrize(
    ("sigma", "half", "sigmas"),
    [
        (0.5, False, (0.04107, 0.036141, 0.043804)),
        (2.0, False, (0.163252, 0.144798, 0.175049)),
        (0.5, True, (0.103728, 0.090552, 0.485987)),
        (2.0, True, (0.376167, 0.331290, 1.566086)),
    ],
)
def test_the_uncertainty_of_the_offset_is_that_of_the_table(
    sigma: float, half: bool, sigmas: tuple[float, ...]
) -> None:
    covariance = estimated(SAMPSON, sigma, half=half).covariance
    npt.assert_allclose(np.sqrt(np.diag(covariance)[:3]), sigmas, rtol=2e-5)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("estimator", [OLS, ALS, SAMPSON, NXP, Algebraic(), Likelihood()], ids=repr)
def test_without_noise_every_row_is_exact(estimator: Estimator, half: bool) -> None:
    found = estimated(estimator, 0.0, half=half).ellipsoid
    npt.assert_allclose(found.centre, HARD_IRON, rtol=0, atol=1e-9)
    npt.assert_allclose(found.shape, 50.0 * SOFT_IRON, rtol=0, atol=1e-9)
    assert found.radius == pytest.approx(RADIUS, rel=1e-11)


def test_the_documented_example_of_matlabs_magcal() -> None:
    """Centre (−50, 20, 100), radii (30, 20, 50): expmfs 31.0723, A = diag(1.03574, 1.55362, 0.62145)."""
    directions = np.random.default_rng(1).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    readings = directions * [30, 20, 50] + [-50, 20, 100]
    calibration = flinders.fit(readings, method=Algebraic("nxp")).calibration
    assert calibration.field_strength == pytest.approx(31.0723, abs=5e-5)
    npt.assert_allclose(calibration.matrix, np.diag([1.03574, 1.55362, 0.62145]), atol=5.1e-6)
    npt.assert_allclose(calibration.offset, [-50, 20, 100], atol=1e-8)


CAR: Final = np.array([[-157.0, 98.0], [-123.0, 124.0], [-109.0, 101.0]])
"""Smallest and largest of x, y and z on the console of the robot car."""


def car() -> Readings:
    """Readings with these extremes, each axis at its ends while the others are in their middle."""
    middle = CAR.mean(axis=1)
    ends = [np.where(np.arange(3) == axis, CAR[axis, end], middle) for axis in range(3) for end in (0, 1)]
    return Readings.of(np.array([*ends, middle + np.array([50.0, 50.0, 60.0])]))


def test_the_console_of_the_robot_car() -> None:
    """Xoff −29.5, 0.5, −4.0; Xsca 1.00, 1.03, 1.21."""
    estimate = MinMax("largest").estimate(car())
    assert estimate.strength == 127.5
    npt.assert_array_equal(estimate.ellipsoid.centre, [-29.5, 0.5, -4.0])
    npt.assert_array_equal((127.5 / estimate.ellipsoid.shape.diagonal()).round(2), [1.0, 1.03, 1.21])
    typed = from_extremes(CAR.ravel(), variant="largest")
    npt.assert_array_equal(typed.calibration.offset, [-29.5, 0.5, -4.0])
    npt.assert_array_equal(typed.scale.round(2), [1.0, 1.03, 1.21])


def test_the_cars_numbers_by_the_other_recipes() -> None:
    """The mean of 127.5, 123.5 and 105 is 118.667; full range puts each end at ±½."""
    mean, full = (from_extremes(CAR.ravel(), variant=variant).calibration for variant in ("mean", "full-range"))
    assert mean.field_strength == pytest.approx(118.6667, abs=5e-5)
    npt.assert_allclose(mean.matrix, np.diag([0.9307, 0.9609, 1.1302]), atol=5e-5)
    npt.assert_allclose(full.apply(CAR.T), [[-0.5] * 3, [0.5] * 3], atol=1e-15)
