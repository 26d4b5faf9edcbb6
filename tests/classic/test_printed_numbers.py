"""Numbers that papers, manuals and other software print for these recipes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.golden.test_reference_numbers import carried
from tests.golden.test_reference_numbers import directions as partial_coverage
from tests.worlds import HARD_IRON, SIX_READINGS, SOFT_IRON, spiral

import flinders
from flinders.apps.classic.recipes.axes import AxisAligned
from flinders.apps.classic.recipes.ellipsoid import Constrained
from flinders.apps.classic.recipes.li import Li
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.estimators import Estimator, Readings, fit_error
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.simulate import hemisphere

if TYPE_CHECKING:
    from tests.trials import Choose


OLS: Final = Algebraic("unit")
ALS: Final = Consistent()
SAMPSON: Final = Likelihood(prior=None, bias_correction=False)
LI4: Final = Li(k=4.0)


@pytest.mark.parametrize(
    ("estimator", "sigma", "half", "offset", "radius"),
    [
        (LI4, 0.5, False, "19.965705 119.987385 90.035983", 52.61706),
        (Sphere(), 0.5, False, "19.980117 119.964560 90.030444", 53.95222),
        (Constrained("eye"), 0.5, False, "19.980117 119.964560 90.030444", 53.95222),
        (LI4, 2.0, False, "19.872250 119.941186 90.144072", 52.63299),
        (LI4, 0.5, True, "19.970840 120.226319 91.988709", 51.76799),
    ],
)
def test_offset_and_radius_are_those_of_the_table(
    estimator: Estimator, sigma: float, half: bool, offset: str, radius: float
) -> None:
    found = estimator.estimate(Readings.of(spiral(sigma, half=half))).ellipsoid
    npt.assert_allclose(found.centre, [float(part) for part in offset.split()], rtol=0, atol=1.1e-6)
    assert found.radius == pytest.approx(radius, rel=1e-6)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("estimator", [LI4, Li(), Constrained()], ids=repr)
def test_without_noise_every_row_is_exact(estimator: Estimator, half: bool) -> None:
    found = estimator.estimate(Readings.of(spiral(0.0, half=half))).ellipsoid
    npt.assert_allclose(found.centre, HARD_IRON, rtol=0, atol=1e-9)
    npt.assert_allclose(found.shape, 50.0 * SOFT_IRON, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "method", [AxisAligned(), Constrained("sym"), Constrained("diag"), Constrained("auto")], ids=repr
)
def test_the_documented_example_of_matlabs_magcal(method: Estimator) -> None:
    """Centre (−50, 20, 100), radii (30, 20, 50): expmfs 31.0723, A = diag(1.03574, 1.55362, 0.62145)."""
    directions = np.random.default_rng(1).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    calibration = flinders.fit(directions * [30, 20, 50] + [-50, 20, 100], method=method).calibration
    assert calibration.field_strength == pytest.approx(31.0723, abs=5e-5)
    npt.assert_allclose(calibration.matrix, np.diag([1.03574, 1.55362, 0.62145]), atol=5.1e-6)
    npt.assert_allclose(calibration.offset, [-50, 20, 100], atol=1e-8)


def test_the_fit_error_of_the_sphere_is_what_nxp_reports() -> None:
    readings = Readings.of(spiral(0.5))
    found = Sphere().estimate(readings).ellipsoid
    assert found.radius == pytest.approx(53.952221, abs=5.1e-7)
    assert fit_error(readings.summary.moments, found) == pytest.approx(0.09373216, abs=5.1e-9)


def test_the_worked_example_of_an4246() -> None:
    """AN4246 rev. 4 prints β and V; its B = 47.0 comes from rounded intermediates, exactly it is 47.236."""
    readings = Readings.of(SIX_READINGS)
    found = Sphere().estimate(readings).ellipsoid
    npt.assert_allclose(found.centre.round(2), [155.74, -239.12, 45.83])
    beta = [*(2.0 * found.centre), found.radius**2 - found.centre @ found.centre]
    npt.assert_allclose(np.array(beta[:3]).round(2), [311.47, -478.25, 91.66])
    assert beta[3] == pytest.approx(-81303.2, abs=0.05)
    assert found.radius == pytest.approx(47.236, abs=5e-4)
    assert found.radius**2 == pytest.approx(2231.27, abs=5e-3)
    assert fit_error(readings.summary.moments, found) == pytest.approx(0.00298, abs=5e-6)


def flat_ellipsoid() -> Readings:
    """The surface x²/4 + y² + 4 z² = 1: I = J = 5.25, so that k J − I² > 0 only for k > 5.25."""
    return Readings.of(np.random.default_rng(2).permutation(flinders.simulate.fibonacci(300)) * [2.0, 1.0, 0.5])


def test_k_of_four_cannot_represent_a_long_ellipsoid() -> None:
    form = np.array([0.25, 1.0, 4.0])
    trace, minors = form.sum(), form[0] * form[1] + form[1] * form[2] + form[0] * form[2]
    assert (trace, minors) == (5.25, 5.25)
    assert 4.0 * minors - trace**2 == pytest.approx(-6.5625)
    found = LI4.estimate(flat_ellipsoid()).ellipsoid
    assert found.semi_axes[2] / found.semi_axes[0] < 3.5


@pytest.mark.parametrize("k", [5.3, 6.0, 100.0, 1e6, None])
def test_k_above_the_ratio_of_invariants_finds_it_exactly(k: float | None) -> None:
    found = Li(k=k).estimate(flat_ellipsoid()).ellipsoid
    npt.assert_allclose(found.semi_axes, [0.5, 1.0, 2.0], rtol=1e-9)
    npt.assert_allclose(found.centre, 0.0, atol=1e-9)


@pytest.mark.parametrize("k", [4.0, 10.0, None])
def test_a_sphere_is_a_sphere_for_any_k(k: float | None) -> None:
    readings = Readings.of(47.0 * flinders.simulate.fibonacci(100) + [3.0, -40.0, 500.0])
    found = Li(k=k).estimate(readings).ellipsoid
    npt.assert_allclose(found.semi_axes, 47.0, rtol=1e-8)
    npt.assert_allclose(found.centre, [3.0, -40.0, 500.0], atol=1e-7)


def test_li_pulls_towards_spheres_where_half_is_unseen(trials: Choose) -> None:
    """Median centre error on half a sphere, 4 % noise, N = 1000: Li 7.7 µT, OLS 2.1, consistent 0.79, Sampson 0.68."""
    rng, claim = np.random.default_rng(20240601), trials(120, 30)
    errors: dict[str, list[float]] = {"li": [], "ols": [], "als": [], "sampson": []}
    methods: dict[str, Estimator] = {"li": LI4, "ols": OLS, "als": ALS, "sampson": SAMPSON}
    for _ in claim.seeds:
        field = 50.0 * hemisphere(rng, 1000) @ SOFT_IRON.T + HARD_IRON + 2.0 * rng.standard_normal((1000, 3))
        readings = Readings.of(field)
        for name, method in methods.items():
            errors[name].append(float(np.linalg.norm(method.estimate(readings).ellipsoid.centre - HARD_IRON)))
    medians = {name: float(np.median(values)) for name, values in errors.items()}
    printed = {"li": 7.7, "ols": 2.1, "als": 0.79, "sampson": 0.68}
    assert medians == pytest.approx(printed, rel=0.2 * claim.widening)


@pytest.mark.nightly
@pytest.mark.parametrize(("motion", "printed"), [("60", 11.4), ("vehicle", 20.0)])
def test_the_median_centre_error_of_partial_coverage(motion: str, printed: float, trials: Choose) -> None:
    """80 runs of 1,000 readings with 0.5 µT of noise, on paths of our own."""
    rng, claim = np.random.default_rng(1), trials(80, 20)
    errors = []
    for _ in claim.seeds:
        noise = 0.5 * rng.standard_normal((1000, 3))
        readings = Readings.of(50.0 * partial_coverage(rng, motion) @ SOFT_IRON.T + HARD_IRON + noise)
        errors.append(float(np.linalg.norm(LI4.estimate(readings).ellipsoid.centre - HARD_IRON)))
    assert np.median(errors) == pytest.approx(printed, rel=0.2 * claim.widening)


def test_a_ring_without_soft_iron_does_not_deceive_a_sphere() -> None:
    """Yaw all round, a pitch of 20°, dip 60°: a general fit is tens of µT off."""
    rng = np.random.default_rng(3)
    body = carried(rng.uniform(0.0, 360.0, 1000), rng.uniform(-20.0, 20.0, 1000), 0.0, 60.0)
    readings = Readings.of(50.0 * body + HARD_IRON + 0.5 * rng.standard_normal((1000, 3)))
    assert np.linalg.norm(Sphere().estimate(readings).ellipsoid.centre - HARD_IRON) < 1.0
