"""TWOSTEP's rows of the deterministic data set: §2 of the project's literature notes, computed there, not published.

The data set is that of `test_golden_numbers.py`. One of the rows is no solution, and is shown to be none.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import HARD_IRON, SOFT_IRON, spiral

from flinders.apps.classic.recipes.alonso_shuster import AlonsoShuster
from flinders.apps.classic.recipes.attitude_independent import (
    Collapsed,
    ProductSums,
    Reference,
    beta,
    ellipsoid_of,
    parameters,
)
from flinders.estimators import Readings

if TYPE_CHECKING:
    from flinders.apps.classic.recipes.attitude_independent import Weights
    from flinders.arrays import Floats


@pytest.mark.parametrize(
    ("weights", "sigma", "half", "offset", "digits"),
    [
        ("prior", 0.5, False, "19.964744 119.988589 90.036932", 6),
        ("prior", 2.0, False, "19.868555 119.952192 90.163428", 6),
        ("prior", 0.5, True, "19.913091 120.241008 90.921729", 6),
        ("prior", 2.0, True, "19.503 121.431 85.162", 3),
        ("estimate", 0.5, False, "19.965660 119.987380 90.036031", 6),
        ("estimate", 2.0, False, "19.869573 119.940755 90.147149", 6),
        ("estimate", 0.5, True, "19.926619 120.218630 90.821371", 6),
    ],
)
def test_hard_iron_is_that_of_the_table(weights: Weights, sigma: float, half: bool, offset: str, digits: int) -> None:
    """With |H| = 50 and the true σ; hard iron is (I + D)⁻¹b."""
    found = AlonsoShuster(weights, noise=sigma, field_strength=50.0).estimate(Readings.of(spiral(sigma, half=half)))
    npt.assert_allclose(
        found.ellipsoid.centre, [float(part) for part in offset.split()], rtol=0, atol=1.1 * 10**-digits
    )


def test_the_matrix_is_that_of_the_table() -> None:
    found = AlonsoShuster("prior", noise=0.5, field_strength=50.0).estimate(Readings.of(spiral(0.5)))
    upper = (50.0 * np.linalg.inv(found.ellipsoid.shape))[np.triu_indices(3)]
    npt.assert_allclose(upper, [0.920966, -0.104380, -0.028695, 1.147655, -0.016961, 0.820686], atol=6e-7)


def test_the_last_row_of_the_table_is_the_300th_of_whole_steps_that_go_round_in_a_circle() -> None:
    """Half a sphere, σ = 2: the table's (19.795498, 120.802160, 92.807227) is where a limit of 300 steps cut them off.

    The steps come back to where they were after twelve, the cost there is 23 % above the least on the way, and
    the next step is 3.8 µT away. With steps that may only make it smaller the way leads to D = −I, and is refused.
    """
    readings = Readings.of(spiral(2.0, half=True))
    reference = Reference.of(readings, "", 50.0)
    sums = ProductSums.of(reference, 2.0 / 50.0)
    theta, costs, centres = reference.start(), [], []
    for _ in range(301):
        theta = theta - np.linalg.solve(sums.information(theta), sums.gradient(theta))
        costs.append(sums.cost(theta))
        centres.append(centre(theta, reference))
    npt.assert_allclose(centres[299], [19.795498, 120.802160, 92.807227], rtol=0, atol=1.1e-6)
    npt.assert_allclose(centres[299 - 12], centres[299], atol=0.03)
    assert np.linalg.norm(centres[300] - centres[299]) > 3.0
    assert costs[299] > 1.2 * min(costs)
    with pytest.raises(Collapsed) as caught:
        AlonsoShuster(noise=2.0, field_strength=50.0).estimate(readings)
    assert caught.value.gain_ratio < 0.5
    assert (caught.value.exit_code, caught.value.code) == (4, "collapsed")


def centre(theta: Floats, reference: Reference) -> Floats:
    """(3,) hard iron of θ', also where I + E has a negative eigenvalue: (I + E)⁻¹c."""
    return reference.origin + reference.size * np.linalg.solve(np.eye(3) + full(theta[3:]), theta[:3])


def full(entries: Floats) -> Floats:
    return np.array(entries[[0, 3, 4, 3, 1, 5, 4, 5, 2]]).reshape(3, 3)


def test_constant_strength_makes_the_centred_step_minus_one_exactly() -> None:
    """θ' = (0; −1, −1, −1, 0, 0, 0) for any readings: §2, first pitfall."""
    reference = Reference.of(Readings.of(spiral(0.5)), "", 50.0)
    theta = ProductSums.of(reference, 0.01).solve()
    npt.assert_allclose(theta, [0, 0, 0, -1, -1, -1, 0, 0, 0], atol=1e-10)


def test_the_gradient_is_that_of_the_cost() -> None:
    reference = Reference.of(Readings.of(spiral(0.5)), "", 50.0)
    sums, theta = ProductSums.of(reference, 0.01), reference.start() + 0.01
    moves = 1e-6 * np.eye(9)
    slopes = [(sums.cost(theta + move) - sums.cost(theta - move)) / 4e-6 for move in moves]
    npt.assert_allclose(sums.gradient(theta), slopes, rtol=1e-5, atol=1e-4 * np.abs(slopes).max())
    curved = [(beta(theta + move)[0] - beta(theta - move)[0]) / 2e-6 for move in moves]
    npt.assert_allclose(beta(theta)[1], curved, rtol=1e-6, atol=1e-8)


def test_without_noise_it_is_exact() -> None:
    found = AlonsoShuster(field_strength=50.0).estimate(Readings.of(spiral(0.0))).ellipsoid
    npt.assert_allclose(found.centre, HARD_IRON, atol=1e-7)
    npt.assert_allclose(found.shape, 50.0 * SOFT_IRON, atol=1e-7)
    b, d = parameters(Reference.of(Readings.of(spiral(0.0)), "", 50.0).start())
    assert ellipsoid_of(b, d, Reference.of(Readings.of(spiral(0.0)), "", 50.0)).isclose(found, rtol=1e-9)
