"""Laws of the estimators: moving, scaling and turning the readings does the same to the ellipsoid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.sentences import assert_raises
from tests.trials import examples

from flinders import simulate
from flinders.apps.classic.recipes.axes import AxisAligned
from flinders.apps.classic.recipes.ellipsoid import Constrained
from flinders.apps.classic.recipes.li import Li
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.errors import NeedsSamples
from flinders.estimators import METHODS, Estimator, Readings
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.auto import Auto
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.minmax import MinMax
from flinders.estimators.robust import Robust
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.apps.classic.recipes.ellipsoid import Radii
    from flinders.arrays import Floats

TURNED: list[Estimator] = [
    Auto(),
    Auto(prior=None),
    Likelihood(bias_correction=False, prior=None),
    Consistent(),
    Algebraic(),
    Li(k=4.0),
    Li(),
    Sphere(),
    Constrained(),
    Constrained("sphere"),
]
"""These do not care how the sensor's axes lie."""

ALIGNED: list[Estimator] = [AxisAligned(), Constrained("aligned"), MinMax(), MinMax("largest"), MinMax("full-range")]
"""These are about the sensor's own axes, and treat them alike."""

SCALED: list[Estimator] = [*TURNED, *ALIGNED, Algebraic("unit"), *(Constrained(radii) for radii in ("xy", "xz", "yz"))]
"""These do not care about the unit."""

MOVED: list[Estimator] = [*SCALED, Algebraic("nxp")]
"""These do not care where zero is."""

shifts = arrays(np.float64, 3, elements=st.floats(-400, 400))
rotations = arrays(np.float64, (3, 3), elements=st.floats(-2, 2)).map(
    lambda entries: np.asarray(np.linalg.qr(entries + np.diag([3.0, -0.5, 0.7]))[0], np.float64)
)
few = examples(15)


def all_round(seed: int) -> Floats:
    """A noisy tumble."""
    return simulate.tumble(seed=seed, motion="uniform", n=200, noise=1.0).samples.field


def half_way(seed: int) -> Floats:
    """A tumble of half the sphere."""
    return simulate.tumble(seed=seed, motion="hemisphere", n=300, noise=0.3).samples.field


CLOUDS = [all_round(11), half_way(12)]
seeds = st.integers(0, 2**32 - 1)
fields = seeds.map(all_round) | seeds.map(half_way)


def label(estimator: Estimator) -> str:
    return repr(estimator)


def same(estimator: Estimator, field: Floats, changed: Floats, matrix: Floats, shift: Floats) -> None:
    """The fit of what was changed is the changed fit: x → M x + t, M a multiple of an orthogonal matrix."""
    one, other = estimator.estimate(Readings.of(field)), estimator.estimate(Readings.of(changed))
    size = float(np.cbrt(abs(np.linalg.det(matrix))))
    radius = size * one.ellipsoid.radius
    npt.assert_allclose(other.ellipsoid.centre, matrix @ one.ellipsoid.centre + shift, rtol=0, atol=2e-6 * radius)
    npt.assert_allclose(
        other.ellipsoid.shape, matrix @ one.ellipsoid.shape @ matrix.T / size, rtol=0, atol=2e-6 * radius
    )
    assert other.noise == pytest.approx(size * one.noise, rel=1e-5)
    assert other.method == one.method


@pytest.mark.parametrize("estimator", MOVED, ids=label)
@given(field=fields, shift=shifts)
@few
def test_moving_the_readings_moves_the_centre(estimator: Estimator, field: Floats, shift: Floats) -> None:
    same(estimator, field, field + shift, np.eye(3), shift)


@pytest.mark.parametrize("estimator", SCALED, ids=label)
@given(field=fields, power=st.floats(-4, 4))
@few
def test_another_unit_gives_the_same_ellipsoid_in_that_unit(estimator: Estimator, field: Floats, power: float) -> None:
    factor = 10.0**power
    same(estimator, field, factor * field, factor * np.eye(3), np.zeros(3))


@pytest.mark.parametrize("estimator", TURNED, ids=label)
@given(field=fields, rotation=rotations)
@few
def test_turning_or_mirroring_the_readings_turns_the_ellipsoid(
    estimator: Estimator, field: Floats, rotation: Floats
) -> None:
    same(estimator, field, field @ rotation.T, rotation, np.zeros(3))


@pytest.mark.parametrize("estimator", [*ALIGNED, Algebraic("unit"), Algebraic("nxp")], ids=label)
@pytest.mark.parametrize("field", CLOUDS, ids=["full", "half"])
def test_the_other_methods_follow_when_axes_are_swapped_or_change_sign(estimator: Estimator, field: Floats) -> None:
    for matrix in (np.eye(3)[[1, 2, 0]], np.diag([1.0, -1.0, -1.0]), np.eye(3)[[1, 0, 2]] * [1.0, 1.0, -1.0]):
        same(estimator, field, field @ matrix.T, matrix, np.zeros(3))


@pytest.mark.parametrize("estimator", [Algebraic("unit"), Algebraic("nxp"), *ALIGNED], ids=label)
def test_these_do_depend_on_how_the_axes_lie(estimator: Estimator) -> None:
    rotation = simulate.turns([[0.3, -0.5, 0.8]])[0]
    field = CLOUDS[1]
    one, other = (estimator.estimate(Readings.of(x)).ellipsoid for x in (field, field @ rotation.T))
    assert np.linalg.norm(other.centre - rotation @ one.centre) > 3e-5 * one.radius


@pytest.mark.parametrize("field", CLOUDS, ids=["full", "half"])
def test_two_equal_radii_go_where_their_axes_go(field: Floats) -> None:
    """Swapping y and z makes a fit with equal x and y one with equal x and z; the third choice has both in itself."""
    swap = np.eye(3)[[0, 2, 1]]
    pairs: list[tuple[Radii, Radii]] = [("xy", "xz"), ("xz", "xy"), ("yz", "yz")]
    for radii, other in pairs:
        one = Constrained(radii).estimate(Readings.of(field)).ellipsoid
        swapped = Constrained(other).estimate(Readings.of(field @ swap)).ellipsoid
        npt.assert_allclose(swapped.centre, swap @ one.centre, rtol=0, atol=1e-6 * one.radius)
        npt.assert_allclose(swapped.shape, swap @ one.shape @ swap, rtol=0, atol=1e-6 * one.radius)


CENTRED: list[Constrained] = [Constrained(radii, centred=True) for radii in ("free", "aligned", "xy", "sphere")]


@pytest.mark.parametrize("estimator", CENTRED, ids=label)
@given(power=st.floats(-4, 4), rotation=rotations)
@few
def test_a_centred_fit_takes_another_unit_and_turns_if_its_model_does(
    estimator: Constrained, power: float, rotation: Floats
) -> None:
    field = CLOUDS[0] - CLOUDS[0].mean(axis=0)
    factor = 10.0**power
    same(estimator, field, factor * field, factor * np.eye(3), np.zeros(3))
    if estimator.radii in ("free", "sphere"):
        same(estimator, field, field @ rotation.T, rotation, np.zeros(3))


@pytest.mark.parametrize("estimator", CENTRED, ids=label)
def test_a_centred_fit_does_not_move_with_its_readings(estimator: Constrained) -> None:
    field = CLOUDS[0] - CLOUDS[0].mean(axis=0)
    for shift in (0.0, 3.0):
        found = estimator.estimate(Readings.of(field + shift))
        npt.assert_array_equal(found.ellipsoid.centre, 0.0)
        npt.assert_array_equal(found.covariance[:3], 0.0)


def test_nxp_depends_on_the_unit_and_on_which_reading_comes_first() -> None:
    field = CLOUDS[1]
    one = Algebraic("nxp").estimate(Readings.of(field)).ellipsoid
    scaled = Algebraic("nxp").estimate(Readings.of(10.0 * field)).ellipsoid
    rolled = Algebraic("nxp").estimate(Readings.of(np.roll(field, 50, axis=0))).ellipsoid
    assert np.linalg.norm(scaled.centre / 10.0 - one.centre) > 3e-5 * one.radius
    assert np.linalg.norm(rolled.centre - one.centre) > 3e-5 * one.radius


PLANAR = {"level", "ellipse", "two-axis"}

LEVEL_TURNS = [
    simulate.tumble(seed=11, motion="level", n=200, noise=1.0).samples.field,
    simulate.tumble(seed=12, motion="level", n=300, noise=0.3).samples.field,
]


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"robust", "ekf"}))  # which draw, and go by, the order
@given(which=st.sampled_from([0, 1]), seed=st.integers(0, 1000))
@few
def test_the_order_of_the_readings_does_not_matter(name: str, which: int, seed: int) -> None:
    field = (LEVEL_TURNS if name in PLANAR else CLOUDS)[which]
    shuffled = np.random.default_rng(seed).permutation(field)
    one, other = (METHODS[name]().estimate(Readings.of(x)) for x in (field, shuffled))
    # Where residuals hang together by chance, in one order of sixty, they weigh a little less beside the prior.
    found = [fit.correlation for fit in (one, other)]
    hang_together = any(each and max(each.time, each.excess_variance) > 1.0 for each in found)
    # Where four that are alike by chance come one behind the other, they are a rest.
    has_rest = len(engine().rests(shuffled)[0]) > 0
    is_another = hang_together or has_rest
    assert other.ellipsoid.isclose(one.ellipsoid, rtol=3e-3 if is_another else 1e-6)
    # How residuals hang together in time is a matter of their order; the rest of the covariance is not.
    claims = [fit.covariance if fit.textbook is None else fit.textbook for fit in (one, other)]
    npt.assert_allclose(claims[1], claims[0], rtol=1e-2 if is_another else 1e-4, atol=1e-5 * np.abs(claims[0]).max())


@pytest.mark.parametrize("name", sorted(METHODS))
def test_sums_alone_give_the_same_where_sums_are_enough(name: str) -> None:
    readings = Readings.of(CLOUDS[0])
    if name not in (*PLANAR, "likelihood", "robust", "alonso-shuster", "sequential", "ekf"):
        whole = METHODS[name]().estimate(readings if name != "auto" else Readings(readings.summary))
        sums = METHODS[name]().estimate(Readings(readings.summary))
        assert sums.ellipsoid.isclose(whole.ellipsoid, rtol=1e-12)


def test_sums_cannot_honour_what_only_readings_can() -> None:
    sums = Readings(Readings.of(CLOUDS[0]).summary)
    for asking in (Auto(robust=True), Auto(prior=0.1), Likelihood(), Robust()):
        with assert_raises(NeedsSamples):
            asking.estimate(sums)
    assert Auto(prior=None).estimate(sums).method == "consistent"


@pytest.mark.parametrize("estimator", MOVED, ids=label)
def test_every_covariance_is_symmetric_and_has_no_negative_variance(estimator: Estimator) -> None:
    for field in CLOUDS:
        covariance = estimator.estimate(Readings.of(field)).covariance
        npt.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-12 * np.abs(covariance).max())
        assert np.linalg.eigvalsh(covariance)[0] >= -1e-12 * np.abs(covariance).max()
