"""Axes that are read at different moments are found, by their amount, and nothing else is taken for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_sentences
from tests.trials import daily

import flinders
from flinders import Samples
from flinders.fitting.result import Refused
from flinders.native.engine import engine
from flinders.simulate import tumble

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.simulate import Sensor


def late(samples: Samples, lags_s: tuple[float, float, float]) -> Floats:
    """Readings whose axes are so much late."""
    time, field = samples.time, samples.field.T
    assert time is not None
    return np.stack([np.interp(time - lag, time, axis) for lag, axis in zip(lags_s, field, strict=True)], axis=1)


@pytest.mark.parametrize("lags_ms", [(20, 0, 0), (0, 60, 0), (40, 50, 65)])
def test_lags_are_found_about_their_mean(lags_ms: tuple[float, float, float]) -> None:
    samples = tumble(seed=1, noise=0.2).samples
    lags_s = np.array(lags_ms) / 1000.0
    x, y, z = lags_s
    record = engine().fit(late(samples, (x, y, z)), time=samples.time)
    assert record["lag_by_chance"] < 1e-10
    assert record["axis_lag"] == pytest.approx(lags_s - lags_s.mean(), abs=0.1 * float(np.ptp(lags_s)))


def test_a_lag_of_all_axes_is_none() -> None:
    samples = tumble(seed=2).samples
    assert engine().fit(late(samples, (0.05, 0.05, 0.05)), time=samples.time)["lag_by_chance"] > 1e-3


def test_without_times_it_is_counted_in_readings() -> None:
    samples = tumble(seed=3, noise=0.2).samples
    lags = engine().fit(late(samples, (0.04, 0.0, 0.0)))["axis_lag"]
    assert lags == pytest.approx(np.array([4.0, -2.0, -2.0]) / 3.0, abs=0.2)


def test_readings_across_a_gap_say_nothing_of_it() -> None:
    """Rates across the places where nothing was recorded would be those of nothing."""
    samples = tumble(seed=4).samples
    assert samples.time is not None
    there = np.arange(len(samples)) % 300 < 200
    record = engine().fit(samples.field[there], time=samples.time[there])
    assert record["lag_by_chance"] > 1e-3


@pytest.mark.parametrize("time_s", daily([0.0, 1.0, 10.0]))
def test_noise_is_not_taken_for_it(time_s: float, trials: Choose) -> None:
    """White noise, and noise that is correlated for a second or ten."""
    chances = []
    for seed in trials(1000, 30).seeds:
        samples = tumble(seed=seed, n=1500).samples
        rng = np.random.default_rng([5, seed])
        chances.append(engine().fit(samples.field + _slow(rng, 1500, time_s), time=samples.time)["lag_by_chance"])
    assert np.mean(np.array(chances) < 0.05) < 0.15
    assert min(chances) > 1e-5


def _slow(rng: np.random.Generator, count: int, time_s: float) -> Floats:
    """Ornstein-Uhlenbeck noise of 0.5 µT, read 50 times a second."""
    keep = np.exp(-1.0 / (50.0 * time_s)) if time_s else 1.0
    noise = np.sqrt(1.0 - keep**2) * rng.normal(scale=0.5, size=(count, 3))
    noise[0] = rng.normal(scale=0.5, size=3) if time_s else 0.0
    for row in range(1, count):
        noise[row] += keep * noise[row - 1]
    return np.asarray(noise)


@pytest.mark.parametrize("lag_s", [0.02, 0.06])
def test_the_claim_covers_what_a_lag_costs_and_names_the_axis(lag_s: float) -> None:
    """Without it a sensor that is turned quickly is several claims off."""
    tumbled = tumble(seed=7, noise=0.2)
    samples, sensor = tumbled.samples, tumbled.sensor
    fit = fitted(Samples.of(late(samples, (0.0, lag_s, 0.0)), unit="uT", time=samples.time))
    finding = next(finding for finding in fit.findings if finding.code == "axis-lag")
    assert_sentences(finding.advice)
    assert_sentences(finding.advice)
    assert fit.evidence.diagnosis.axis_lag is not None
    assert fit.evidence.diagnosis.axis_lag.is_timed
    assert fit.heading_error_deg.worst >= finding.number == fit.evidence.diagnosis.axis_lag.heading_deg
    true = heading_error(sensor, fit)
    assert true < 2.5 * fit.heading_error_deg.worst


def heading_error(sensor: Sensor, fit: flinders.Fit) -> float:
    """Worst error of a level heading without its mean, degrees, where the field dips by 60°."""
    turned = np.radians(np.arange(0.0, 360.0, 5.0))
    level = 50.0 * np.stack([0.5 * np.cos(turned), -0.5 * np.sin(turned), np.full(72, np.sqrt(0.75))], axis=1)
    corrected = fit.calibration.apply(level @ sensor.matrix.T + sensor.offset)
    off = np.degrees(np.arctan2(-corrected[:, 1], corrected[:, 0]) - turned)
    off = (off - off[0] + 180.0) % 360.0 - 180.0
    return float(np.abs(off - off.mean()).max())


def fitted(samples: Samples) -> flinders.Fit:
    """The fit, refused or not."""
    try:
        return flinders.fit(samples)
    except Refused as refusal:
        return refusal.fit
