"""The covariance is the textbook's where residuals are white, and as wide as the errors where they are not."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import adversary
from benchmarks.claims import by_hand, remembering
from benchmarks.datasets import bound, dataset, parameter_error
from tests.trials import daily

import flinders
from flinders.estimators import Readings
from flinders.estimators.auto import Auto
from flinders.estimators.likelihood import Likelihood
from flinders.fitting.fit_json import json_of
from flinders.likelihood.magnitude import distances
from flinders.simulate import Sensor, tumble

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.trials import Choose, Trials

    from flinders.arrays import Floats
    from flinders.simulate import Simulated


def weighed(recording: Simulated, covariance: Floats, matrix: Floats, offset: Floats) -> float:
    off = parameter_error(matrix, offset, recording)
    return float(off @ np.linalg.solve(covariance, off)) / 9.0


def remembered(seed: int, n: int, memory: float) -> Floats:
    """Readings of a bare sensor by hand, with AR(1) noise of 0.5 µT on the strength alone."""
    truth = tumble(seed=seed, n=n, sensor=Sensor())
    noise = remembering(np.random.default_rng(seed), (n, 1), memory)
    return np.asarray(truth.directions * (50.0 + 0.5 * noise), np.float64)


def claims(record: Callable[[int], Simulated], trials: Trials) -> tuple[float, float]:
    """Mean squared error in units of the claimed covariance, and of the textbook's, over nine."""
    claimed, textbook = [], []
    for seed in trials.seeds:
        recording = record(seed)
        fit = flinders.fit(recording.samples.field, target_deg=90.0, site=flinders.Site(strength=50.0))
        plain = Auto().estimate(Readings.of(recording.samples.field)).textbook
        assert plain is not None
        found = fit.calibration.matrix, fit.calibration.offset
        claimed.append(weighed(recording, fit.claim.covariance, *found))
        textbook.append(weighed(recording, plain, *found))
    return float(np.mean(claimed)), float(np.mean(textbook))


@pytest.mark.parametrize("trial", [21, 95, 742, 1424])
def test_noise_that_moves_the_readings_of_a_clump_is_no_slow_noise(trial: int) -> None:
    """Jacobians at the readings follow their distances from an ellipsoid: errors were 5 to 16 times the bound."""
    recording = dataset("S6", trial, 2.0)
    fit = flinders.fit(recording.samples.field, target_deg=90.0, site=flinders.Site(strength=50.0))
    off = parameter_error(fit.calibration.matrix, fit.calibration.offset, recording)
    assert off @ bound(recording).information @ off / 9.0 < 3.0


@pytest.mark.parametrize("motion", ["uniform", "hand", "clumped"])
def test_white_residuals_leave_the_covariance_as_it_is(motion: str, trials: Choose) -> None:
    """But for a few recordings, by chance."""
    white, wider, claim = 0, [], trials(40, 6)
    for seed in claim.seeds:
        found = Likelihood().estimate(Readings.of(tumble(seed=seed, motion=motion).samples))
        assert found.correlation is not None
        assert found.textbook is not None
        wider.append(np.trace(found.covariance) / np.trace(found.textbook))
        if found.correlation.is_white:
            white += 1
            npt.assert_array_equal(found.covariance, found.textbook)
            assert found.correlation.independent_count(1000) == 1000
    assert white >= (1.0 - 0.2 * claim.widening) * claim.count
    assert float(np.mean(wider)) < 1.15**claim.widening


@pytest.mark.parametrize("memory", daily([0.0, 0.5, 0.8, 0.95], 2))
def test_noise_with_a_memory_is_allowed_for(memory: float, trials: Choose) -> None:
    claim = trials(40, 6)
    claimed, textbook = claims(lambda seed: by_hand(seed, memory=memory), claim)
    low, high = claim.ratios(0.6, 1.5)
    assert low < claimed < high
    if memory:
        assert textbook > 0.5**claim.widening * (1.0 + memory) / (1.0 - memory)


def test_a_distortion_that_belongs_to_the_direction_is_allowed_for(trials: Choose) -> None:
    """1 % of the field, where the textbook is off by a factor of five (in variance)."""
    claim = trials(40, 6)
    claimed, textbook = claims(lambda seed: by_hand(seed, distorted=0.01), claim)
    low, high = claim.ratios(0.5, 1.6)
    assert low < claimed < high
    assert textbook > 5.0 * low


@pytest.mark.parametrize("walk_s", daily([1.0, 3.0]))
def test_a_gradient_along_the_path_of_the_hand_is_allowed_for(walk_s: float, trials: Choose) -> None:
    """Where a walk takes three seconds, the claim is twice the error: 0.28 in variance, of 40 seeds."""
    claim = trials(40, 6)
    claimed, textbook = claims(lambda seed: by_hand(seed, gradient=0.01, walk_s=walk_s), claim)
    low, high = claim.ratios(0.2, 1.6)
    assert low < claimed < high
    assert textbook > 5.0 * 0.3**claim.widening


@pytest.mark.parametrize("memory", daily([0.5, 0.8, 0.95]))
def test_independent_samples_are_those_of_an_autoregressive_process(memory: float, trials: Choose) -> None:
    """N (1 − ρ)/(1 + ρ)."""
    claim = trials(12, 5)
    recordings = (remembered(seed, 3000, memory) for seed in claim.seeds)
    found = [
        flinders.fit(recording, target_deg=90.0).evidence.residuals.independent_samples for recording in recordings
    ]
    assert float(np.median(found)) == pytest.approx(3000 * (1 - memory) / (1 + memory), rel=0.25 * claim.widening)


@pytest.mark.parametrize(
    ("motion", "n"), daily([("hand", 1000), ("uniform", 300), ("eight", 600), ("hemisphere", 400)], 2)
)
def test_white_noise_is_no_distortion(motion: str, n: int, trials: Choose) -> None:
    claim = trials(500, 20)
    fields = (tumble(seed=seed, motion=motion, n=n, noise=0.3).samples.field for seed in claim.seeds)
    found = [Auto().estimate(Readings.of(field)).correlation for field in fields]
    assert sum(correlation is not None and correlation.direction > 0.0 for correlation in found) <= 0.002 * claim.count


def test_the_direction_of_a_distortion_is_told_from_its_time() -> None:
    """In each of five recordings, and within half of it in the median."""
    recordings = [Readings.of(by_hand(seed, distorted=0.01, sigma=0.2).samples.field) for seed in range(1, 6)]
    sizes = [correlation.direction for readings in recordings if (correlation := Auto().estimate(readings).correlation)]
    assert len(sizes) == 5
    assert min(sizes) > 0.0
    assert float(np.median(sizes)) == pytest.approx(0.5, rel=0.5)


@pytest.mark.parametrize(
    ("effect", "is_structure"),
    [
        (adversary.Effect(axes=partial(adversary.warped, rms=0.3)), True),
        (adversary.Effect(body=partial(adversary.remembering, sigma=0.25, time_s=1.0)), False),
    ],
    ids=["structure", "slow noise"],
)
def test_structure_in_fifteen_seconds_is_told_from_slow_noise(
    effect: adversary.Effect, trials: Choose, *, is_structure: bool
) -> None:
    """Few visits to a direction are farther apart than the memory of such noise."""
    found, claim = [], trials(200, 5)
    for seed in claim.seeds:
        path = adversary.PATHS["short tumble"](adversary.stream(seed, "path"))
        sensor = adversary.sensor(adversary.stream(seed, "sensor"))
        correlation = Auto().estimate(Readings.of(adversary.recorded(seed, sensor, effect, path))).correlation
        found.append(correlation is not None and correlation.direction > 0.0)
    assert np.mean(found) >= 1.0 - 0.1 * claim.widening if is_structure else not any(found)


@pytest.mark.nightly
def test_long_recordings_are_judged_by_stretches_and_agree_with_the_whole(trials: Choose) -> None:
    """A quarter of the readings is looked at, in stretches."""
    ratios, claim = [], trials(6, 2)
    for seed in claim.seeds:
        field = remembered(seed, 48_000, 0.8)
        part = Likelihood().estimate(Readings.of(field))
        residuals = distances(field, part.ellipsoid)
        lag_one = float(residuals[1:] @ residuals[:-1] / (residuals @ residuals))
        assert part.correlation is not None
        assert part.correlation.lag_one == pytest.approx(lag_one, abs=0.03)
        ratios.append(part.correlation.time / ((1.0 + 0.8) / (1.0 - 0.8)))
    assert math.exp(float(np.mean(np.log(ratios)))) == pytest.approx(1.0, abs=0.25 * claim.widening)


def test_few_readings_say_nothing_of_their_correlation() -> None:
    found = Likelihood().estimate(Readings.of(tumble(seed=1, motion="uniform", n=49).samples))
    assert found.correlation is None
    fit = flinders.fit(tumble(seed=1, motion="uniform", n=49).samples)
    assert fit.evidence.residuals.independent_samples == np.inf
    assert json_of(fit)["independent_samples"] == 49


@pytest.mark.nightly
def test_a_variance_is_never_below_the_textbook() -> None:
    for seed in range(12):
        recording = by_hand(seed, gradient=0.01, walk_s=3.0)
        found = Auto().estimate(Readings.of(recording.samples.field))
        assert found.textbook is not None
        root = np.linalg.inv(np.linalg.cholesky(found.textbook))
        assert np.linalg.eigvalsh(root @ found.covariance @ root.T)[0] > 0.99
