"""How fast an offset walks, from estimates of it: recovered from filters that are tuned, slow and wary."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.sentences import assert_raises

from flinders.core.offset_walk import Walk
from flinders.errors import UsageError
from flinders.workflows.walk import MIN_STEPS, walk_of

RATE = 0.1


def filtered(
    seed: int, n: int = 80, *, tuned: float = 1.0, claims: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimates of a Kalman filter that takes the walk for `tuned` times what it is, and noise for `claims` times."""
    rng = np.random.default_rng(seed)
    hours = rng.exponential(3.0, n) + 2.0
    truth, at, variance = np.zeros(3), np.zeros(3), 1.0
    offset, sigma = [], []
    for hour in hours.tolist():
        truth = truth + rng.normal(0.0, RATE * math.sqrt(hour), 3)
        variance += (tuned * RATE) ** 2 * hour
        gain = variance / (variance + (claims * 0.1) ** 2)
        at = at + gain * (truth + rng.normal(0.0, 0.1, 3) - at)
        variance *= 1.0 - gain
        offset.append(at)
        sigma.append([math.sqrt(variance)] * 3)
    return 3600.0 * np.cumsum(hours), np.array(offset), np.array(sigma)


def test_the_rate_is_within_its_interval_as_often_as_that_says() -> None:
    walks = [walk_of(*filtered(seed)) for seed in range(20)]
    assert all(walk is not None for walk in walks)
    known = [walk for walk in walks if walk is not None]
    assert sum(walk.low < RATE < walk.high for walk in known) >= 17
    assert np.median([walk.rate for walk in known]) == pytest.approx(RATE, rel=0.08)
    assert max(walk.high / walk.low for walk in known) < 1.8


@pytest.mark.parametrize(("tuned", "claims"), [(0.3, 1.0), (3.0, 1.0), (1.0, 2.5), (1.0, 0.5)])
def test_a_filter_that_is_not_tuned_moves_it_by_less_than_half(tuned: float, claims: float) -> None:
    rates = [walk.rate for seed in range(6) if (walk := walk_of(*filtered(seed, 200, tuned=tuned, claims=claims)))]
    assert 0.6 * RATE < np.median(rates) < 1.4 * RATE


def test_a_step_is_no_walk() -> None:
    time, offset, sigma = filtered(3)
    before = walk_of(time, offset, sigma)
    moved = np.arange(len(time)) == 40
    offset = offset + 5.0 * (np.arange(len(time)) >= 40)[:, np.newaxis]
    with_step, without = walk_of(time, offset, sigma), walk_of(time, offset, sigma, moved)
    assert before is not None
    assert with_step is not None
    assert without is not None
    assert with_step.rate < 1.5 * before.rate
    assert without.rate == pytest.approx(before.rate, rel=0.1)


def test_an_axis_that_never_changes_tells_nothing() -> None:
    time, offset, sigma = filtered(4)
    offset[:, 2], sigma[:, 2] = 7.0, 1e-3
    walk = walk_of(time, offset, sigma)
    assert walk is not None
    assert walk.low < RATE < walk.high
    assert walk_of(time, np.ones_like(offset), sigma) is None


def test_few_estimates_tell_nothing() -> None:
    time, offset, sigma = filtered(5, MIN_STEPS + 1)
    assert walk_of(time, offset, sigma) is not None
    assert walk_of(time[1:], offset[1:], sigma[1:]) is None


def test_a_number_is_known_within_a_factor_of_two() -> None:
    walk = Walk.from_rate(0.3)
    assert walk.log_sigma == pytest.approx(math.log(2.0))
    assert walk.heading_deg(4 * 3600.0, radius=50.0, dip_deg=60.0) == pytest.approx(math.degrees(0.6 / 25.0))
    for rate in (0.0, -1.0, math.nan, math.inf):
        with assert_raises(UsageError):
            Walk.from_rate(rate)
