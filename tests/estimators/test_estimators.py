"""Known sensor in, same sensor out, within the claimed uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.datasets import heading_error_deg
from tests.sentences import assert_raises, assert_sentences
from tests.worlds import SOFT_IRON, Streamed, errors, true_parameters

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import FitError, NeedsSamples, UsageError
from flinders.estimators import Estimator, Readings, data, method_class
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.auto import Auto
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import upper_entries
from flinders.simulate import Sensor, angle_error_deg, tumble

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

GENERAL: Final[list[Estimator]] = [
    Auto(),
    Auto(prior=None),
    Likelihood(prior=None, bias_correction=False),
    Consistent(),
    Algebraic(),
    Algebraic("unit"),
    Algebraic("nxp"),
]
CROOKED: Final = np.array([[1.10, 0.12, -0.05], [-0.02, 0.90, 0.08], [0.04, -0.06, 1.20]])


@pytest.mark.parametrize("estimator", GENERAL, ids=repr)
@pytest.mark.parametrize("strengths", [0.0, 1.0, 10.0])
def test_readings_without_noise_give_the_truth_to_rounding(estimator: Estimator, strengths: float) -> None:
    """To a thousand-millionth of the field, also beside ten field strengths of hard iron."""
    offset = strengths * 50.0 * np.array([0.48, -0.6, 0.64])
    truth = tumble(seed=4, motion="uniform", n=300, sensor=Sensor(SOFT_IRON, offset))
    found = estimator.estimate(Readings.of(truth.samples))
    npt.assert_allclose(errors(found, truth) / 50.0, 0.0, atol=1e-9)
    assert found.noise < 1e-5 * 50.0


def test_the_consistent_fit_recovers_the_noise_and_the_truth() -> None:
    for seed, sigma in ((1, 0.5), (2, 2.0), (3, 5.0)):
        truth = tumble(seed=seed, motion="uniform", n=100_000, noise=sigma)
        found = Consistent().estimate(Readings.of(truth.samples))
        assert found.noise == pytest.approx(sigma, rel=4.0 / np.sqrt(2 * 100_000))
        assert np.abs(errors(found, truth) / np.sqrt(np.diag(found.covariance))).max() < 4.0


def test_half_a_sphere_and_ten_percent_noise_leave_the_consistent_fit_unbiased() -> None:
    """Where plain least squares is 10 µT off, at σ = 5 µT on half a sphere (§5 of the literature notes)."""
    rng = np.random.default_rng(5)
    field = (
        50.0 * simulate.hemisphere(rng, 200_000) @ SOFT_IRON.T + [20, 120, 90] + 5.0 * rng.standard_normal((200_000, 3))
    )
    readings = Readings.of(field)
    consistent, plain = (
        e.estimate(readings).ellipsoid.centre - [20, 120, 90] for e in (Consistent(), Algebraic("unit"))
    )
    assert np.abs(consistent).max() < 1.0
    assert np.abs(plain).max() > 8.0


@pytest.mark.parametrize(
    ("motion", "n", "noise", "complete"),
    [("uniform", 500, 0.5, 100), ("uniform", 500, 2.0, 100), ("hand", 500, 0.5, 40), ("hemisphere", 1000, 0.5, 100)],
)
@pytest.mark.parametrize("estimator", [Auto(), Consistent()], ids=repr)
def test_errors_are_as_large_as_claimed(
    estimator: Estimator, motion: str, n: int, noise: float, complete: int, trials: Choose
) -> None:
    """Errors weighed with the claimed covariance are χ² of nine degrees: their mean is nine."""
    weighed, claim = [], trials(complete, 12)
    for seed in claim.seeds:
        truth = tumble(seed=1000 + seed, motion=motion, n=n, noise=noise)
        found = estimator.estimate(Readings.of(truth.samples))
        off = errors(found, truth)
        weighed.append(off @ np.linalg.solve(found.covariance, off))
    assert float(np.mean(weighed)) == pytest.approx(9.0, abs=4.0 * np.sqrt(18.0 / claim.count) + 0.5)


def test_sixty_coarse_readings_are_fitted_within_what_they_claim(trials: Choose) -> None:
    weighed, angles, claim = [], [], trials(60, 20)
    for seed in claim.seeds:
        sensor = Sensor.random(np.random.default_rng(seed), noise=0.5, resolution=1.5)
        truth = tumble(seed=seed, motion="uniform", n=60, sensor=sensor)
        fit = flinders.fit(truth.samples)
        off = np.concatenate([fit.calibration.offset, upper_entries(fit.calibration.shape)]) - true_parameters(truth)
        weighed.append(off @ np.linalg.solve(fit.claim.covariance, off))
        angles.append(angle_error_deg(fit.calibration.matrix, fit.calibration.offset, truth))
    assert float(np.mean(weighed)) == pytest.approx(9.0, abs=4.0 * np.sqrt(18.0 / claim.count) + 1.0)
    assert float(np.sqrt(np.mean(np.square(angles)))) < 0.6


def test_half_a_sphere_is_enough_and_strong_iron_no_harm() -> None:
    rng = np.random.default_rng(6)
    for strength in (1.0, 1.7):
        sensor = Sensor.random(rng, strength=strength)
        truth = tumble(seed=7, motion="hemisphere", n=3000, sensor=sensor)
        fit = flinders.fit(truth.samples)
        assert angle_error_deg(fit.calibration.matrix, fit.calibration.offset, truth) < 0.4


@pytest.mark.parametrize(
    "matrix",
    [
        CROOKED,
        SOFT_IRON @ simulate.turns([[0.3, -0.2, 0.9]])[0],
        np.diag([1.2, 0.9, 1.0]) @ simulate.turns([[1.5, 0, 1.0]])[0],
    ],
    ids=["crooked", "turned", "swapped"],
)
def test_an_asymmetric_truth_is_found_up_to_one_rotation(matrix: Floats) -> None:
    truth = tumble(seed=8, motion="uniform", n=5000, sensor=Sensor(matrix, np.array([20.0, -60.0, 30.0]), 0.1))
    fit = flinders.fit(truth.samples)
    found = (fit.calibration.matrix, fit.calibration.offset)
    assert angle_error_deg(*found, truth, rotation="best") < 0.02
    assert angle_error_deg(*found, truth) > 2.0
    # W A / F is that rotation: orthogonal, and not the identity.
    rotation = truth.field_strength / fit.calibration.field_strength * fit.calibration.matrix @ matrix
    npt.assert_allclose(rotation @ rotation.T, np.eye(3), atol=2e-3)
    finding = next(finding for finding in fit.findings if finding.code == "rotation-unknown")
    assert finding.severity == "note"
    assert_sentences(finding.advice)
    assert fit.calibration.rotation == "symmetric"


def test_repeated_readings_widen_the_covariance() -> None:
    """A log four times as fast as its sensor holds no more than the sensor gave."""
    field = tumble(seed=9, motion="uniform", n=500).samples.field
    once, fourfold = flinders.fit(field), flinders.fit(np.repeat(field, 4, axis=0))
    npt.assert_allclose(np.diag(fourfold.claim.covariance), np.diag(once.claim.covariance), rtol=0.1)
    assert fourfold.evidence.samples == 500
    assert "stale-repeats" in {finding.code for finding in fourfold.findings}


def test_readings_are_thinned_evenly_and_alike_however_they_come() -> None:
    samples = Samples.of(np.arange(30_000.0).reshape(-1, 3))
    whole, blocks = Readings.of(samples), Readings(Readings.of(samples).summary, Streamed(samples))
    for limit in (1, 7, 999, 1000, 3333, 9999, 10_000, 50_000):
        thinned = whole.thin(limit)
        assert len(thinned) <= limit
        assert len(thinned) >= min(limit, 10_000) / 2
        assert len(set(np.diff(thinned[:, 0]).tolist())) <= 1
        assert np.array_equal(blocks.thin(limit), thinned)


def test_a_recording_too_long_to_hold_gives_the_fit_of_the_array(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = tumble(seed=10, n=6000)
    whole = flinders.fit(truth.samples)
    short = Streamed(truth.samples)
    held = flinders.fit(short)
    assert short.passes == 1
    npt.assert_allclose(held.calibration.offset, whole.calibration.offset, rtol=0, atol=1e-9)
    monkeypatch.setattr(data, "MAX_HELD_READINGS", 3000)
    long = Streamed(truth.samples)
    part = flinders.fit(long)
    assert long.passes > 1
    every_second = flinders.fit(truth.samples[::2])
    assert part.evidence.samples == every_second.evidence.samples
    npt.assert_allclose(part.calibration.offset, every_second.calibration.offset, rtol=0, atol=1e-6)
    npt.assert_allclose(part.claim.covariance, every_second.claim.covariance, rtol=1e-3, atol=1e-9)


def test_the_likelihood_asks_for_readings_where_there_are_only_sums() -> None:
    summary = Readings.of(tumble(seed=1, motion="uniform", n=100).samples).summary
    with assert_raises(NeedsSamples):
        Likelihood().estimate(Readings(summary))
    assert Auto().estimate(Readings(summary)).method == "consistent"
    assert flinders.fit(summary).evidence.method == "consistent"


@pytest.mark.parametrize(("program", "method"), [("magneto", "li"), ("MotionCal", "algebraic"), ("nxp", "algebraic")])
def test_the_name_of_a_program_is_answered_with_the_method_of_its_numbers(program: str, method: str) -> None:
    with pytest.raises(UsageError, match=f"did you mean '{method}'"):
        method_class(program)


def test_a_given_field_strength_scales_the_matrix_and_nothing_else() -> None:
    truth = tumble(seed=2, motion="uniform", n=1000)
    free, scaled = flinders.fit(truth.samples), flinders.fit(truth.samples, site=flinders.Site(strength=48.5))
    npt.assert_array_equal(free.calibration.offset, scaled.calibration.offset)
    lengths = np.linalg.norm(scaled.calibration.apply(truth.samples.field), axis=1)
    assert float(lengths.mean()) == pytest.approx(48.5, rel=1e-3)
    assert float(np.linalg.det(free.calibration.matrix)) == pytest.approx(1.0)
    assert free.heading_error_deg.worst == pytest.approx(scaled.heading_error_deg.worst, rel=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("n", [12, 20])
def test_few_readings_claim_what_few_residuals_tell_of_their_noise(n: int) -> None:
    """Three and eleven residuals beyond the unknowns: taken for exact, their noise would claim too little."""
    ratios = []
    for seed in range(80):
        recording = simulate.tumble(seed=seed, n=n, motion="uniform")
        try:
            fit = flinders.fit(recording.samples)
        except Refused as refusal:
            fit = refusal.fit
        except FitError:
            continue
        found = fit.calibration
        ratios.append(heading_error_deg(found.matrix, found.offset, recording) / fit.heading_error_deg.rms)
    assert len(ratios) > 60
    assert 0.6 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.3
