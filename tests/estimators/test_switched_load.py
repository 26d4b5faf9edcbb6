"""A load that switches by itself is left out, and slow noise is not taken for one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.worlds import judged, with_slow_noise

from flinders import Samples, simulate
from flinders.native.engine import engine

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

STEPS = 7.0
"""Kurtosis of steps of residuals above which something comes and goes."""

PLAIN = simulate.Sensor(noise=0.2)


def switched(field: Floats, seed: int, apart: float = 400.0) -> Floats:
    """Readings (N, 3) with 2 µT of a load that is on for fifty to a hundred and fifty, so many `apart`."""
    rng = np.random.default_rng(seed)
    is_on, at = np.zeros(len(field), dtype=bool), 0
    while at < len(field):
        at += int(rng.exponential(apart))
        length = int(rng.integers(50, 150))
        is_on[at : at + length] = True
        at += length
    wire = rng.normal(size=3)
    return field + 2.0 * is_on[:, np.newaxis] * wire / np.linalg.norm(wire)


def test_a_load_on_and_off_is_left_out_and_limits() -> None:
    """Of ten, at least eight; a fit to all of them is one to a mixture, and off by up to two degrees."""
    fits = [judged(in_ut(switched(tumbled(seed), seed))) for seed in range(10)]
    assert sum(fit.evidence.method == "robust" for fit in fits) >= 8
    assert not [fit for fit in fits if fit.evidence.method == "robust" and fit.evidence.noise > 0.35]


def test_a_load_that_is_on_as_long_as_off_is_an_unsteady_field() -> None:
    """Nobody can tell which readings are with it; all ten have steps, and none is good."""
    fields = [switched(tumbled(seed), seed, apart=120.0) for seed in range(10)]
    assert all(engine().fit(field)["steps_kurtosis"] > STEPS for field in fields)
    fits = [judged(in_ut(field)) for field in fields]
    assert "good" not in {fit.verdict for fit in fits}
    assert all(any(finding.code == "unsteady-field" for finding in fit.findings) for fit in fits)


@pytest.mark.nightly
def test_noise_that_lasts_has_no_steps(trials: Choose) -> None:
    """None of 1,200 recordings, of noise that is correlated for 0.4 to 20 s, steps as a load does."""
    many = trials(1200, 100)
    for seed in many.seeds:
        rng = np.random.default_rng(seed)
        field = with_slow_noise(tumbled(seed % 8), sigma=rng.uniform(0.2, 1.0), memory=rng.uniform(20, 1000), seed=seed)
        assert not engine().fit(field)["steps_kurtosis"] > STEPS


@pytest.mark.nightly
def test_slow_noise_is_not_taken_for_a_load(trials: Choose) -> None:
    """Of 1,200 recordings with it, 14 were, each of 600 readings."""
    many, robust = trials(400, 40), 0
    for seed in many.seeds:
        rng = np.random.default_rng(seed)
        field = with_slow_noise(tumbled(seed % 8), sigma=rng.uniform(0.2, 1.0), memory=rng.uniform(20, 1000), seed=seed)
        robust += int(engine().fit(field)["is_robust"])
    assert robust <= 0.05 * many.count


def tumbled(seed: int) -> Floats:
    """Readings of a minute by hand."""
    return simulate.tumble(seed=seed, n=3000, sensor=PLAIN).samples.field


def in_ut(field: Floats) -> Samples:
    """Readings in µT."""
    return Samples.of(field, unit="uT")
