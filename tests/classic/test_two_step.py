"""Two-step: its equations by hand, the x axis as the reference, and where it ends in a refusal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises
from tests.worlds import HARD_IRON

import flinders
from flinders import simulate
from flinders.apps.classic.recipes.two_step import TwoStep, triangular_model
from flinders.cli import main
from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators import Readings

if TYPE_CHECKING:
    from tests.trials import Choose

LEANING: Final = np.array([[1.0, 0.0, 0.0], [0.10, 1.1, 0.0], [0.02, -0.05, 0.9]])


def recorded(
    shape: flinders.arrays.Floats, noise: float = 0.0, *, n: int = 1000, seed: int = 1
) -> flinders.arrays.Floats:
    rng = np.random.default_rng(seed)
    directions = simulate.uniform_directions(rng, n)
    return np.asarray(HARD_IRON + 50.0 * directions @ shape.T + noise * rng.standard_normal((n, 3)), np.float64)


def test_both_steps_are_those_of_the_paper_written_out() -> None:
    """f by least squares over (x, y², y, z², z, 1), then offsets and gains from it; with noise, in µT as read."""
    x, y, z = (field := recorded(np.diag([0.9, 1.0, 1.2]), 0.5)).T
    design = np.column_stack([x, y**2, y, z**2, z, np.ones_like(x)])
    f = np.linalg.lstsq(design, -(x**2), rcond=None)[0]
    offset = [-f[0] / 2, -f[2] / (2 * f[1]), -f[4] / (2 * f[3])]
    gain = np.sqrt((offset[0] ** 2 + f[1] * offset[1] ** 2 + f[3] * offset[2] ** 2 - f[5]) / 50.0**2)
    gains = [gain, gain / np.sqrt(f[1]), gain / np.sqrt(f[3])]
    found = TwoStep().estimate(Readings.of(field)).ellipsoid
    npt.assert_allclose(found.centre, offset, rtol=1e-8)
    npt.assert_allclose(found.shape, 50.0 * np.diag(gains), atol=1e-6)


def test_the_triangular_model_comes_out_as_it_went_in() -> None:
    """Foster and Elkaim: x = a Bx, y = b (Bx sin ρ + By cos ρ), z = c (Bx sin λ + By cos λ sin φ + Bz cos λ cos φ)."""
    rho, lean, phi = np.radians([3.0, -2.0, 5.0])
    rows = [
        [1.1, 0.0, 0.0],
        [0.9 * np.sin(rho), 0.9 * np.cos(rho), 0.0],
        [1.3 * np.sin(lean), 1.3 * np.cos(lean) * np.sin(phi), 1.3 * np.cos(lean) * np.cos(phi)],
    ]
    found = TwoStep("non-orthogonal").estimate(Readings.of(recorded(np.array(rows))))
    npt.assert_allclose(triangular_model(found.ellipsoid, 50.0), [1.1, 0.9, 1.3, 3.0, -2.0, 5.0], atol=1e-9)
    npt.assert_allclose(found.ellipsoid.centre, HARD_IRON, atol=1e-8)
    assert found.method == "two-step non-orthogonal"


def test_moving_and_scaling_does_the_same_to_the_answer_and_swapping_axes_does_not() -> None:
    field = recorded(LEANING, 1.0)
    for model in ("orthogonal", "non-orthogonal"):
        fits = [TwoStep(model).estimate(Readings.of(x)).ellipsoid for x in (field, 3.0 * field + 100.0)]
        npt.assert_allclose(fits[1].centre, 3.0 * fits[0].centre + 100.0, atol=1e-7)
        npt.assert_allclose(fits[1].shape, 3.0 * fits[0].shape, atol=1e-7)
        swapped = TwoStep(model).estimate(Readings.of(field[:, ::-1])).ellipsoid
        assert np.abs(swapped.centre[::-1] - fits[0].centre).max() > 1e-4


@pytest.mark.parametrize("model", ["orthogonal", "non-orthogonal"])
def test_a_hyperboloid_is_refused_and_no_root_of_a_negative_number_taken(model: str) -> None:
    """f₂ < 0, where codes take √|f₂|: readings on x² + z² − y² = 1."""
    rng = np.random.default_rng(1)
    angle, y = rng.uniform(0, 2 * np.pi, 300), rng.uniform(-1, 1, 300)
    across = np.sqrt(1 + y**2)
    field = 50.0 * np.stack([across * np.cos(angle), y, across * np.sin(angle)], axis=1)
    with pytest.raises(NotAnEllipsoid) as caught:
        TwoStep(model).estimate(Readings.of(field))  # type: ignore[arg-type]
    assert caught.value.eigenvalues[1] < 0.0
    with pytest.raises(NotAnEllipsoid):
        flinders.fit(field, method=TwoStep(model))  # type: ignore[arg-type]


def test_the_covariance_is_that_of_many_recordings(trials: Choose) -> None:
    """Of the seven parameters it has, 200 recordings, seeds 0 to 199: χ² per degree of freedom within its scatter."""
    shape = np.diag([0.9, 1.0, 1.2])
    claim = trials(200, 40)
    found = [TwoStep().estimate(Readings.of(recorded(shape, 0.5, n=500, seed=seed))) for seed in claim.seeds]
    off = np.array(
        [np.append(one.ellipsoid.centre - HARD_IRON, np.diag(one.ellipsoid.shape - 50.0 * shape)) for one in found]
    )
    claimed = np.array([np.diag(one.covariance)[:6] for one in found])
    npt.assert_allclose(off.std(axis=0), np.sqrt(np.median(claimed, axis=0)), rtol=0.15 * claim.widening)


@pytest.mark.parametrize("seed", range(3))
def test_half_a_sphere_beside_auto_in_degrees(seed: int) -> None:
    """Four percent of noise: the orthogonal model off by degrees for soft iron, the other by its bias; both told."""
    half = simulate.tumble(seed=seed, motion="hemisphere", n=1000, noise=2.0)
    fits = {
        name: flinders.fit(half.samples, target_deg=90.0, **options)  # type: ignore[arg-type]
        for name, options in {
            "auto": {},
            "orthogonal": {"method": "two-step"},
            "non-orthogonal": {"method": TwoStep("non-orthogonal")},
        }.items()
    }
    off = {name: np.linalg.norm(fit.calibration.offset - half.sensor.offset) for name, fit in fits.items()}
    assert off["auto"] < 2.0
    assert off["orthogonal"] > 2.0 * off["auto"]
    assert off["non-orthogonal"] > 2.0 * off["auto"]
    for name, fit in fits.items():
        assert off[name] < 2.5 * np.sqrt(np.trace(fit.claim.covariance[:3, :3])), name
    assert fits["orthogonal"].claim.bias_deg > 1.0


def test_options_that_mean_nothing_are_refused(tmp_path: object) -> None:
    with assert_raises(UsageError):
        TwoStep("skew")  # type: ignore[arg-type]
    ended = CliRunner().invoke(main, ["calibrate", "none.csv", "--method", "two-step", "--option", "model=skew"])
    assert ended.exit_code == 2
    assert "orthogonal, non-orthogonal" in ended.output
