"""A disturbance that follows the attitude is named where an accelerometer was recorded, and noise is not."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

import flinders
from flinders import simulate
from flinders.diagnostics.attitude_dependence import attitude_dependence_of
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

PER_VERTICAL = np.outer([1.0, -0.5, 0.4], [0.3, 1.0, 0.2])
"""µT for each unit of the vertical: a wire, and the side whose load grows as it comes down."""


def tumbled(seed: int, *, motion: str = "hand", n: int = 2000) -> Samples:
    return simulate.tumble(seed=seed, motion=motion, n=n, noise=0.2).samples


def vertical(samples: Samples) -> Floats:
    assert samples.acceleration is not None
    down: Floats = -samples.acceleration / np.linalg.norm(samples.acceleration, axis=1, keepdims=True)
    return down


def followed(samples: Samples, per_vertical: Floats = PER_VERTICAL) -> Samples:
    return replace(samples, field=samples.field + vertical(samples) @ per_vertical.T)


def judged(samples: Samples) -> Fit:
    try:
        return flinders.fit(samples)
    except Refused as refusal:
        return refusal.fit


def codes(fit: Fit) -> list[str]:
    return [finding.code for finding in fit.findings]


@pytest.mark.parametrize("seed", range(5))
def test_a_current_that_follows_the_attitude_limits_a_fit(seed: int) -> None:
    """Without the accelerometer most such fits look good."""
    fit = judged(followed(tumbled(seed)))
    assert "attitude-dependent" in codes(fit)
    assert fit.verdict == "limited"
    assert fit.evidence.diagnosis.attitude_dependence is not None
    assert fit.evidence.diagnosis.attitude_dependence.explained > 0.2


def slow(rng: np.random.Generator, samples: Samples) -> Samples:
    """Noise of 0.5 µT with a memory of four seconds."""
    keep = np.exp(-1.0 / 200.0)
    pushes = 0.5 * np.sqrt(1.0 - keep * keep) * rng.standard_normal((len(samples) + 1000, 3))
    noise = np.apply_along_axis(lambda axis: np.convolve(axis, keep ** np.arange(1000), "valid"), 0, pushes)
    return replace(samples, field=samples.field + noise[: len(samples)])


def bent(samples: Samples) -> Samples:
    """An axis with a cubic term."""
    middle = np.ptp(samples.field, axis=0) / 2.0 + samples.field.min(axis=0)
    return replace(samples, field=samples.field + 3.0 * ((samples.field - middle) / 50.0) ** 3 * [1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "change", [lambda samples: samples, bent, partial(slow, np.random.default_rng(1))], ids=["white", "bent", "slow"]
)
@pytest.mark.parametrize("motion", ["hand", "eight"])
def test_noise_and_axes_that_are_not_linear_follow_no_attitude(
    change: Callable[[Samples], Samples], motion: str
) -> None:
    assert "attitude-dependent" not in codes(judged(change(tumbled(3, motion=motion))))


def test_the_axes_of_the_accelerometer_do_not_matter() -> None:
    """The products of two vectors span the same in any axes."""
    samples = followed(tumbled(1))
    assert samples.acceleration is not None
    fit = judged(samples)
    turned = replace(samples, acceleration=samples.acceleration @ simulate.turns([[0.3, -0.8, 1.1]])[0])
    one, other = (attitude_dependence_of(some, fit.calibration.ellipsoid, dip_deg=60.0) for some in (samples, turned))
    assert one is not None
    assert other is not None
    assert other.significance == pytest.approx(one.significance)
    assert other.heading_deg == pytest.approx(one.heading_deg)


def test_a_level_turn_tells_nothing() -> None:
    samples = followed(tumbled(1, motion="level"))
    assert attitude_dependence_of(samples, flinders.fit(tumbled(1)).calibration.ellipsoid, dip_deg=60.0) is None


def test_readings_without_noise_follow_no_attitude() -> None:
    exact = simulate.tumble(seed=1, n=500, sensor=simulate.Sensor(), noise=0.0).samples
    assert attitude_dependence_of(exact, Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), dip_deg=60.0) is None


def test_an_accelerometer_without_values_tells_nothing() -> None:
    samples = tumbled(1)
    empty = replace(samples, acceleration=np.full((len(samples), 3), np.nan))
    assert attitude_dependence_of(empty, flinders.fit(samples).calibration.ellipsoid, dip_deg=60.0) is None
