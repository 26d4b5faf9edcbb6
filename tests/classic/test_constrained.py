"""Ellipsoids with constraints: what each names, beside an independent solution, and what a wrong one costs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import HARD_IRON, SOFT_IRON

import flinders
from flinders import simulate
from flinders.apps.classic.recipes.axes import AxisAligned
from flinders.apps.classic.recipes.ellipsoid import Constrained
from flinders.apps.classic.recipes.sphere import Sphere
from flinders.errors import FitError, NotAnEllipsoid, TooFewSamples, UsageError
from flinders.estimators import Readings, fit_error
from flinders.estimators.algebraic import Algebraic
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from flinders.apps.classic.recipes.ellipsoid import Radii
    from flinders.arrays import Floats
    from flinders.estimators import Estimator

SKEW: Final = 50.0 * SOFT_IRON
PAIRS: Final = {"xy": (50.0, 50.0, 65.0), "xz": (50.0, 65.0, 50.0), "yz": (65.0, 50.0, 50.0)}


def recorded(shape: Floats, noise: float = 0.5, *, n: int = 500, seed: int = 1) -> Floats:
    rng = np.random.default_rng(seed)
    white = noise * rng.standard_normal((n, 3))
    return np.asarray(HARD_IRON + simulate.uniform_directions(rng, n) @ shape + white, np.float64)


def petrov(field: Floats, equals: str) -> Ellipsoid:
    """``ellipsoid_fit`` of 2015 written anew: Σ squares = D u, solved by QR, in a frame about the mean."""
    origin, scale = field.mean(axis=0), float(np.std(field) * np.sqrt(3))
    x, y, z = ((field - origin) / scale).T
    one, nought = np.ones_like(x), np.zeros((3, 0))
    flatter = {"z": (x * x + y * y - 2 * z * z, [1, 1, -2]), "y": (x * x + z * z - 2 * y * y, [1, -2, 1])}
    chosen = {"": "zy", "0": "zy", "0xy": "z", "0xz": "y", "xyz": ""}[equals]
    squares = [flatter[name][0] for name in chosen]
    weights = np.array([flatter[name][1] for name in chosen], float).T if chosen else nought
    cross = [2 * x * y, 2 * x * z, 2 * y * z] if equals == "" else []
    design = np.stack([*squares, *cross, 2 * x, 2 * y, 2 * z, one], axis=1)
    u = np.linalg.lstsq(design, x * x + y * y + z * z, rcond=None)[0]
    diagonal = weights @ u[: len(chosen)] - 1.0
    off = u[len(chosen) : len(chosen) + len(cross)] if cross else np.zeros(3)
    rest = u[len(chosen) + len(cross) :]
    quadric = np.concatenate([diagonal, off, 2 * rest[:3], rest[3:]])
    return Ellipsoid.from_quadric(quadric).in_frame(origin, scale)


@pytest.mark.parametrize(
    ("radii", "equals"), [("free", ""), ("aligned", "0"), ("xy", "0xy"), ("xz", "0xz"), ("sphere", "xyz")]
)
@pytest.mark.parametrize("noise", [0.0, 0.5, 2.0])
def test_each_choice_is_that_of_ellipsoid_fit(radii: Radii, equals: str, noise: float) -> None:
    """On readings that suit none of them, so that every constraint acts."""
    field = recorded(SKEW, noise)
    found, wanted = Constrained(radii).estimate(Readings.of(field)).ellipsoid, petrov(field, equals)
    npt.assert_allclose(found.centre, wanted.centre, rtol=0, atol=1e-8)
    npt.assert_allclose(found.shape, wanted.shape, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("radii", "same"),
    [("free", Algebraic()), ("sym", Algebraic()), ("aligned", AxisAligned()), ("diag", AxisAligned()),
     ("sphere", Sphere()), ("eye", Sphere())],
)  # fmt: skip
def test_three_of_them_are_methods_of_their_own(radii: Radii, same: Estimator) -> None:
    readings = Readings.of(recorded(SKEW))
    found, wanted = Constrained(radii).estimate(readings), same.estimate(readings)
    assert found.ellipsoid.isclose(wanted.ellipsoid, rtol=1e-9)
    npt.assert_allclose(found.covariance, wanted.covariance, rtol=0, atol=1e-8 * np.abs(wanted.covariance).max())
    assert found.noise == pytest.approx(wanted.noise, rel=1e-9)


@pytest.mark.parametrize("radii", sorted(PAIRS))
def test_two_equal_radii_are_found_within_what_is_claimed(radii: Radii) -> None:
    shape = np.diag(PAIRS[radii])
    off = []
    for seed in range(30):
        found = Constrained(radii).estimate(Readings.of(recorded(shape, seed=seed)))
        first, second = ("xyz".index(letter) for letter in radii)
        assert found.ellipsoid.shape[first, first] == pytest.approx(found.ellipsoid.shape[second, second], rel=1e-12)
        npt.assert_allclose(found.ellipsoid.shape, np.diag(np.diag(found.ellipsoid.shape)), atol=1e-12)
        sigma = np.sqrt(np.diag(found.covariance)[:6])
        error = np.append(found.ellipsoid.centre - HARD_IRON, np.diag(found.ellipsoid.shape - shape))
        off.append(error / sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.3


@pytest.mark.parametrize(("radii", "semi"), [("free", (45, 50, 60)), ("xy", (50, 50, 65)), ("sphere", (50, 50, 50))])
def test_a_centred_fit_finds_the_radii_about_zero(radii: Radii, semi: tuple[float, float, float]) -> None:
    shape = np.diag(np.array(semi, float))
    off = []
    for seed in range(30):
        found = Constrained(radii, centred=True).estimate(Readings.of(recorded(shape, seed=seed) - HARD_IRON))
        npt.assert_array_equal(found.ellipsoid.centre, 0.0)
        npt.assert_array_equal(found.covariance[:3], 0.0)
        off.append(np.diag(found.ellipsoid.shape - shape) / np.sqrt(np.diag(found.covariance)[3:6]))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_a_centre_that_is_not_zero_is_an_error_that_is_told() -> None:
    """6 µT of offset left in: the claim grows to it."""
    field = recorded(50.0 * np.eye(3), n=2000) - HARD_IRON + [6.0, 0.0, 0.0]
    fit = flinders.fit(field, target_deg=30.0, method=flinders.estimators.Constrained(radii="sphere", centred=True))
    assert fit.evidence.method == "ellipsoid sphere centred"
    assert fit.verdict == "limited"
    assert fit.claim.offset_sigma[0] == pytest.approx(6.0, rel=0.05)
    assert fit.claim.bias_deg > 5.0


@pytest.mark.parametrize("radii", ["aligned", "xy", "sphere"])
def test_a_constraint_that_does_not_hold_is_in_the_claim(radii: Radii) -> None:
    for seed in range(5):
        fit = flinders.fit(
            recorded(SKEW, n=2000, seed=seed), target_deg=60.0, method=flinders.estimators.Constrained(radii=radii)
        )
        off = np.concatenate([fit.calibration.offset - HARD_IRON, (fit.calibration.shape - SKEW)[np.triu_indices(3)]])
        claimed = np.sqrt(np.diag(fit.claim.covariance)[[0, 1, 2, 3, 6, 7, 4, 8, 5]])
        assert np.linalg.norm(off) < 1.5 * np.linalg.norm(claimed)
        assert fit.claim.bias_deg > 3.0


def test_equal_diagonal_entries_do_not_make_equal_radii_once_there_are_cross_terms() -> None:
    """What ``ellipsoid_fit`` of 2015 calls ``'xy'`` constrains Q₁₁ = Q₂₂, of which neither implies the other."""
    unequal = np.sqrt(1.0 / np.linalg.eigvalsh(np.array([[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 2.0]])))
    assert np.abs(np.diff(unequal)).min() > 0.1
    turn = simulate.turns([[0.9, 0.4, 0.3]])[0]
    spheroid = turn @ np.diag([50.0**-2, 50.0**-2, 65.0**-2]) @ turn.T
    assert abs(spheroid[0, 0] - spheroid[1, 1]) > 0.05 * spheroid[0, 0]


# magcal


@pytest.mark.parametrize(
    ("semi", "turned", "true"),
    [((50.0, 50.0, 50.0), False, "sphere"), ((45.0, 50.0, 60.0), False, "aligned"), ((45.0, 50.0, 60.0), True, "free")],
)
def test_auto_ends_with_the_model_of_the_smallest_fit_error(
    semi: tuple[float, float, float], turned: bool, true: Radii
) -> None:
    """Which is the true one or, as unknowns cost nothing, a richer one; never a poorer one."""
    turn = simulate.turns([[0.9, 0.4, 0.3]])[0] if turned else np.eye(3)
    readings = Readings.of(recorded(turn @ np.diag(semi) @ turn.T))
    radii, found = Constrained("auto").choose_radii(readings)
    order: list[Radii] = ["sphere", "aligned", "free"]
    fits = {model: Constrained(model).estimate(readings).ellipsoid for model in order}
    errors = {model: fit_error(readings.summary.moments, fit) for model, fit in fits.items()}
    assert order.index(radii) >= order.index(true)
    assert errors[radii] == min(errors.values())
    assert found.isclose(Constrained("auto").estimate(readings).ellipsoid)


def test_auto_goes_without_the_models_that_want_more_readings() -> None:
    field = recorded(50.0 * np.eye(3), n=9)
    assert Constrained("auto").estimate(Readings.of(field[:6])).method == "ellipsoid sphere"
    assert Constrained("auto").estimate(Readings.of(field)).method in {"ellipsoid sphere", "ellipsoid aligned"}


# What cannot be done.


@pytest.mark.parametrize(
    ("radii", "centred", "needed"),
    [("free", False, 10), ("aligned", False, 7), ("xy", False, 6), ("sphere", False, 5), ("eye", False, 5),
     ("auto", False, 5), ("free", True, 7), ("aligned", True, 4), ("yz", True, 3), ("sphere", True, 2)],
)  # fmt: skip
def test_fewer_unknowns_need_fewer_readings(radii: Radii, centred: bool, needed: int) -> None:
    field = recorded(50.0 * np.eye(3), n=40) - (HARD_IRON if centred else 0.0)
    with pytest.raises(TooFewSamples) as caught:
        Constrained(radii, centred).estimate(Readings.of(field[: needed - 1]))
    assert caught.value.needed == needed


@pytest.mark.parametrize("radii", ["free", "aligned", "xy", "xz", "yz", "sphere", "auto"])
@pytest.mark.parametrize("centred", [False, True])
def test_a_ring_is_never_good(radii: Radii, centred: bool) -> None:
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    turn = simulate.turns([[0.9, 0.4, 0.3]])[0]
    ring = np.stack([40 * np.cos(angle), 40 * np.sin(angle), np.full(400, 30.0)], axis=1) @ turn.T
    for noise in (0.0, 0.3):
        field = ring + noise * np.random.default_rng(1).standard_normal(ring.shape)
        try:
            fit = flinders.fit(field, method=flinders.estimators.Constrained(radii=radii, centred=centred))
        except FitError:
            continue
        assert fit.verdict == "limited"


def test_readings_of_a_hyperboloid_are_refused() -> None:
    rng = np.random.default_rng(2)
    along, angle = rng.uniform(-40.0, 40.0, 400), rng.uniform(0.0, 2 * np.pi, 400)
    radius = np.sqrt(2500.0 + along**2)
    field = np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=1)
    models: list[Radii] = ["free", "aligned", "xy"]
    for radii in models:
        with pytest.raises(NotAnEllipsoid):
            Constrained(radii).estimate(Readings.of(field))


@pytest.mark.parametrize("options", [{"radii": "yx"}, {"radii": None}, {"centred": 1}, {"centred": "yes"}])
def test_options_that_mean_nothing_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=next(iter(options))):
        Constrained(**options)
