"""PX4's online observer of the offset: a first-order recursion with the gyro, which PX4 runs before take-off.

At each reading, with the rate ω and the time Δt since the last reading:

    p = x⁻ − ω × (x⁻ − b) Δt,     b⁺ = b + g Δt · (−ω × (x − p))

x⁻ is the last reading; it replaces the field that the published observer has as a part of its state. An error of the
offset across ω decays at the rate g Δt |ω|², so that the effect of PX4's gain depends on the rate of readings: at 50 Hz
and 1 rad/s the decay takes 2.5 s, at 0.1 rad/s four minutes. The observer starts at zero, and ignores soft iron and the
bias of the gyro. It uses a linear step instead of a rotation, which leaves an error that grows with the square of |ω|
Δt.

PX4's checks, which need gauss, are left out: PX4 accepts an offset when it is above 0.04 G and nearly constant while
the vehicle turns, and restarts from zero beyond 5 G.

PX4 Autopilot, ``FieldSensorBiasEstimator.hpp``, ``updateEstimate``; after G. Troni, L. L. Whitcomb, "Adaptive
estimation of measurement bias in three-dimensional field sensors with angular-rate sensors", Robotics: Science and
Systems IX (2013), eq. 11. An edition of the file leaves Δt out of b⁺.

>>> from flinders import simulate
>>> bare = simulate.Sensor(offset=[20.0, 12.0, -9.0], noise=0.0)
>>> recording = simulate.tumble(seed=1, motion="swayed", n=9000, sensor=bare, imu=simulate.Imu(gyro_noise=0.0))
>>> px4_observer(recording.samples).centre.round(1)
array([20., 12., -9.])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.emulations.gyro_windows import sphere_about, steps_of

if TYPE_CHECKING:
    from flinders import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

GAIN: Final = 20.0
"""PX4's learning gain in 1/s."""


def px4_observer(samples: Samples, gain: float = GAIN) -> Ellipsoid:
    """Sphere about the offset at the end of the recording; `gain` is g in 1/s.

    Raises
    ------
    NeedsRate, OneAxisTurned
        See `benchmarks.emulations.gyro_windows.steps_of`.
    NotAnEllipsoid
        If the gain is too large for these rates, so that the observer diverges.
    """
    offset = np.zeros(3)
    with np.errstate(over="ignore", invalid="ignore"):
        for steps in steps_of(samples):
            rate, weight = steps.turn, gain * steps.seconds[:, np.newaxis]
            across = np.einsum("ni,ni,jk->njk", rate, rate, np.eye(3)) - np.einsum("nj,nk->njk", rate, rate)  # WᵀW
            decays = np.eye(3) - (weight * steps.seconds[:, np.newaxis])[:, :, np.newaxis] * across
            innovation = steps.last - steps.begin + np.cross(rate, steps.begin) * steps.seconds[:, np.newaxis]
            for decay, pull in zip(decays, -np.cross(rate, innovation) * weight, strict=True):
                offset = decay @ offset + pull  # the step is linear in b
        return sphere_about(offset, samples)
