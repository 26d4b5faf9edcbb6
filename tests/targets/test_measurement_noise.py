"""Laws and truth of what filters are told: the noise of a corrected reading, and the error of its calibration."""

from __future__ import annotations

import json
import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import flinders
from flinders import simulate
from flinders.fitting.measurement_noise import noise_of
from flinders.fitting.result import bare_fit
from flinders.targets._measurement_noise import YawFilter

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated

FILTERS = {
    "gyro and bias": YawFilter(rate_hz=15.0, drift=2.25e-6, bias_drift=1e-8),
    "fast bias": YawFilter(rate_hz=50.0, drift=2.5e-7, bias_drift=1e-3),
    "no bias": YawFilter(rate_hz=30.0, drift=2e-4),
}
RECORDINGS: dict[str, dict[str, Any]] = {
    "good": {"motion": "hand"},
    "limited": {"motion": "tilted", "n": 300, "noise": 1.0},
    "level only": {"motion": "level", "n": 60, "noise": 2.0},
}


@cache
def fitted(kind: str, seed: int = 1) -> tuple[Simulated, Fit]:
    """A recording of a kind, and its fit."""
    recording = simulate.tumble(seed=seed, **RECORDINGS[kind])
    return recording, flinders.fit(recording.samples)


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("sigma_deg", [0.5, 5.0, 40.0])
def test_what_a_filter_states_is_what_its_recursion_settles_at(name: str, sigma_deg: float) -> None:
    """The variance of the doubling algorithm and that of step after step."""
    yaw, noise = FILTERS[name], math.radians(sigma_deg) ** 2
    transition, process = yaw._model()
    variance = np.eye(len(transition))
    error = np.eye(len(transition))
    for _ in range(12_000):
        variance = transition @ variance @ transition.T + process
        gain = variance[:, 0] / (variance[0, 0] + noise)
        remaining = np.eye(len(gain)) - np.outer(gain, np.eye(len(gain))[0])
        variance = remaining @ variance
        error = remaining @ (transition @ error @ transition.T + process) @ remaining.T
        error += math.radians(2.0) ** 2 * np.outer(gain, gain)
    sigma = math.radians(sigma_deg)
    assert yaw.stated_deg(sigma) == pytest.approx(math.degrees(math.sqrt(variance[0, 0])), rel=1e-6)
    assert yaw.error_deg(sigma, 2.0) == pytest.approx(math.degrees(math.sqrt(error[0, 0])), rel=1e-6)


@pytest.mark.parametrize("name", FILTERS)
def test_an_exact_calibration_leaves_the_noise_of_a_reading(name: str) -> None:
    """Without a calibration's error the best filter has the noise of the readings, and states what it errs by."""
    sigma = FILTERS[name].measurement_sigma(0.0, 1.5)
    assert math.degrees(sigma) == pytest.approx(1.5, rel=1e-3)
    assert FILTERS[name].error_deg(sigma, 1.5) == pytest.approx(FILTERS[name].stated_deg(sigma), rel=1e-3)


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("claimed_deg", [0.1, 1.0, 4.0])
def test_a_filter_states_the_error_of_the_calibration_and_of_noise(name: str, claimed_deg: float) -> None:
    """Both parts are in what it states, and more of either needs more noise."""
    yaw = FILTERS[name]
    sigma = yaw.measurement_sigma(claimed_deg, 1.0)
    assert yaw.stated_deg(sigma) == pytest.approx(math.hypot(claimed_deg, yaw.error_deg(sigma, 1.0)), rel=1e-5)
    assert yaw.measurement_sigma(2.0 * claimed_deg, 1.0) > sigma
    assert yaw.measurement_sigma(claimed_deg, 2.0) > sigma


@pytest.mark.parametrize("kind", RECORDINGS)
def test_the_noise_of_a_reading_is_that_of_a_sensor_at_rest(kind: str) -> None:
    """White noise of the corrected field and of the heading, against many readings in one field."""
    recording, fit = fitted(kind)
    noise, rng = noise_of(fit), np.random.default_rng(3)
    assert noise is not None
    corrected, headings = [], []
    for heading in np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False):
        level = math.cos(math.radians(60.0))
        true = 50.0 * np.array([level * math.cos(heading), -level * math.sin(heading), math.sin(math.radians(60.0))])
        field = fit.calibration.apply(recording.sensor.read(np.tile(true, (4000, 1)), rng))
        corrected.append(field[:, :2].var(axis=0))
        phasors = field[:, 0] - 1j * field[:, 1]
        headings.append(np.angle(phasors / phasors.mean()).var())
    assert noise.reading == pytest.approx(math.sqrt(np.mean(corrected)), rel=0.12)
    assert noise.heading_reading_deg == pytest.approx(math.degrees(math.sqrt(np.mean(headings))), rel=0.15)


@pytest.mark.parametrize("kind", RECORDINGS)
def test_the_error_of_the_calibration_is_the_claim(kind: str) -> None:
    """Headings have that of the claim; the field's covariance has both parts, and is symmetric."""
    _, fit = fitted(kind)
    noise = noise_of(fit)
    assert noise is not None
    assert noise.heading_calibration_deg == fit.heading_error_deg.rms
    assert np.allclose(noise.field_covariance, noise.field_covariance.T, rtol=1e-9)
    assert noise.axis == pytest.approx(math.sqrt(np.trace(noise.field_covariance[:2, :2]) / 2.0), rel=1e-9)


def test_the_field_errs_as_its_covariance_says() -> None:
    """Errors of many calibrations' corrected fields, over what each states: one, on the average."""
    squares = []
    for seed in range(60):
        recording, fit = fitted("good", seed)
        noise, level = noise_of(fit), math.cos(math.radians(60.0))
        assert noise is not None
        headings = np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
        down = np.full(12, math.sin(math.radians(60.0)))
        true = 50.0 * np.stack([level * np.cos(headings), -level * np.sin(headings), down], axis=1)
        field = fit.calibration.apply(true @ recording.sensor.matrix.T + recording.sensor.offset)
        gain = fit.calibration.matrix @ recording.sensor.matrix * 50.0 / fit.calibration.field_strength
        left, _, right = np.linalg.svd(gain)  # a rotation is a matter of mounting
        errors = field * 50.0 / fit.calibration.field_strength @ (left @ right) - true
        squares.append(np.mean(errors[:, :2] ** 2) / noise.calibration**2)
    assert 0.6 < np.mean(squares) < 1.6


def test_a_larger_claim_is_a_larger_noise() -> None:
    """Sigma changes when the claim does."""
    good, limited = (noise_of(fitted(kind)[1]) for kind in ("good", "limited"))
    assert good is not None
    assert limited is not None
    assert good.heading_calibration_deg < limited.heading_calibration_deg
    assert good.calibration < limited.calibration


def test_a_calibration_without_a_claim_has_no_noise() -> None:
    """An imported calibration states neither noise nor uncertainty."""
    assert noise_of(bare_fit(flinders.Calibration.identity(field_strength=50.0))) is None


@pytest.mark.parametrize("kind", RECORDINGS)
def test_plain_numbers_have_the_noise(kind: str) -> None:
    """JSON for programs, in the file and among the fields of any target."""
    fit = fitted(kind)[1]
    noise = noise_of(fit)
    assert noise is not None
    written = json.loads("\n".join(line for line in flinders.export(fit, "json").text.splitlines()))["noise"]
    assert written == flinders.export(fit, "c").export.fields["noise"]
    assert written["heading_reading_deg"] == noise.heading_reading_deg
    assert np.array_equal(written["field_covariance"], noise.field_covariance)
