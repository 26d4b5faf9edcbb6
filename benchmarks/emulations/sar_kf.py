"""SAR-KF: a Kalman filter with a gyro, whose state is the true field and the offset.

    d/dt (x, b) = [[−W, W], [0, 0]] (x, b),     y = x + n,     W = [ω]×           (section IV.B)

Over a step with a constant rate, x⁺ = E x + (1 − E) b with E = exp(−W Δt) is exact. The model is linear in the state,
so that it needs no linearization. Noise of the gyro moves x by σ_g Δt across x − b in each step, with the present
estimate of b. The filter starts from the first reading and from the mean of all readings, whose uncertainty is the
spread of the readings. Its state contains neither soft iron nor a bias of the gyro.

G. Troni, L. L. Whitcomb (2019), see `benchmarks.emulations.sar_ls`. The two published gains, for the process and for
the measurement, are the two noises.

>>> from flinders import simulate
>>> bare = simulate.Sensor(offset=[20.0, 120.0, 90.0], noise=0.1)
>>> recording = simulate.tumble(seed=1, motion="swayed", n=1500, sensor=bare)
>>> bool(np.abs(sar_kf(recording.samples).centre - bare.offset).max() < 0.3)
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.emulations.gyro_windows import sphere_about, steps_of
from flinders.likelihood.equations import MIN_NOISE
from flinders.simulate import turns
from flinders.summary.moments import Moments

if TYPE_CHECKING:
    from benchmarks.emulations.gyro_windows import Steps
    from flinders import Samples
    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid

GYRO_NOISE: Final = 0.005
"""Noise of each reading of the gyro, 1 σ in rad/s: that of the published simulation, and of ordinary MEMS gyros."""

MEDIAN_LENGTH: Final = 1.5382
"""Median length of a vector of three standard normal numbers."""

_EYE: Final = np.eye(3)


def sar_kf(samples: Samples, noise: float | None = None, gyro_noise: float = GYRO_NOISE) -> Ellipsoid:
    """Sphere about the offset at the end of the recording.

    Parameters
    ----------
    samples : Samples
    noise : float, optional
        Noise of the readings, 1 σ of each axis, in their unit; by default from their third differences.
    gyro_noise : float, rad/s
        Noise of each reading of the gyro, 1 σ of each axis.

    Raises
    ------
    NeedsRate, OneAxisTurned
        See `benchmarks.emulations.gyro_windows.steps_of`.
    """
    steps = steps_of(samples)
    moments = Moments.of(samples.field)
    origin, scale = moments.mean, moments.spread
    sigma = max(noise_of(steps) if noise is None else noise, MIN_NOISE * scale) / scale
    offset: Floats = np.zeros(3)
    covariance: Floats = np.eye(3)
    for one in steps:
        offset, covariance = _filtered(_scaled(one, origin, scale), sigma, gyro_noise, offset, covariance)
    return sphere_about(origin + scale * offset, samples)


def _scaled(steps: Steps, origin: Floats, scale: float) -> Steps:
    """Steps with readings relative to an origin, in units of their spread."""
    return type(steps)((steps.first - origin) / scale, (steps.last - origin) / scale, steps.seconds, steps.turn)


def _filtered(
    steps: Steps, noise: float, gyro_noise: float, offset: Floats, covariance: Floats
) -> tuple[Floats, Floats]:
    """Offset (3,) and its covariance after a segment, in units of the spread of the readings."""
    state = np.concatenate([steps.first, offset])
    known = np.zeros((6, 6))
    known[:3, :3], known[3:, 3:] = noise**2 * _EYE, covariance
    moves = turns(-steps.turn * steps.seconds[:, np.newaxis])  # E
    shaken = ((gyro_noise * steps.seconds) ** 2).tolist()
    change = np.eye(6)
    for move, jolt, reading in zip(moves, shaken, steps.last, strict=True):
        change[:3, :3], change[:3, 3:] = move, _EYE - move
        state = change @ state
        known = change @ known @ change.T
        arm = state[:3] - state[3:]
        known[:3, :3] += jolt * (arm @ arm * _EYE - np.outer(arm, arm))
        gain = np.linalg.solve(known[:3, :3] + noise**2 * _EYE, known[:3]).T
        state = state + gain @ (reading - state[:3])
        known = known - gain @ known[:3]
        known = (known + known.T) / 2.0
    return state[3:], known[3:, 3:]


def noise_of(steps: list[Steps]) -> float:
    """White noise of the readings, 1 σ of each axis, from their third differences, which are small in a smooth turn.

    >>> from benchmarks.emulations.gyro_windows import Steps
    >>> white = np.random.default_rng(1).normal(size=(2000, 3))
    >>> steps = Steps(white[0], white[1:], np.full(1999, 0.01), np.ones((1999, 3)))
    >>> round(noise_of([steps]), 1)
    1.0
    """
    third = np.concatenate([np.diff(one.last, n=3, axis=0) for one in steps])
    lengths = np.linalg.norm(third, axis=1)
    return float(np.median(lengths) / (MEDIAN_LENGTH * np.sqrt(20.0))) if len(lengths) else 0.0
