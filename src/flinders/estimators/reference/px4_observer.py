"""PX4's online observer of the offset: a first-order recursion driven by the gyro."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.estimators.base import Estimate
from flinders.estimators.reference.gyro_windows import refuse_unless_positive, require_two_axes, sphere_about, steps_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.reference.gyro_windows import Steps

GAIN: Final = 20.0
"""1/s, PX4's learning gain."""

LATE: Final = 0.2
"""Share of the recording, at its end, over which the scatter of the answer is taken."""


@dataclass(frozen=True, slots=True)
class Px4Observer:
    """Observer of the offset, as PX4 runs it before take-off.

    At each reading, with ω the rate and Δt the time since the last one

        p = x⁻ − ω × (x⁻ − b) Δt,     b⁺ = b + g Δt · (−ω × (x − p))

    x⁻ being the last reading: the field's half of the state of the published observer is replaced by what was measured.
    An error of the offset across ω decays at the rate g Δt |ω|², so PX4's gain is one for its rate of readings: at
    50 Hz and 1 rad/s it takes two and a half seconds, at 0.1 rad/s four minutes.

    Use it to see what a PX4 vehicle would have learnt from a recording. Not for accuracy: soft iron and the gyro's
    bias are not in it, it begins at zero and forgets the early readings, and its straight step in place of a rotation
    leaves an error that grows with the square of |ω| Δt.

    Parameters
    ----------
    gain : float, 1/s
        g; PX4 has 20.

    Notes
    -----
    Left out are PX4's guards, which need gauss: it takes an offset for learnt once it is above 0.04 G and hardly
    moves while the vehicle turns, and starts again from zero beyond 5 G.
    Covariance: scatter over the last fifth of the recording, and what is left of the start, which is taken to be off
    by as much as the answer is; what separates the answer from the likelihood joins it
    (`flinders.estimators.bias_inflation`).

    References
    ----------
    .. [1] PX4 Autopilot, ``FieldSensorBiasEstimator.hpp``, ``updateEstimate``; after G. Troni, L. L. Whitcomb,
       "Adaptive estimation of measurement bias in three-dimensional field sensors with angular-rate sensors",
       Robotics: Science and Systems IX (2013), eq. 11. An edition of the file leaves Δt out of b⁺.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.estimators.data import Readings
    >>> bare = simulate.Sensor(offset=[20.0, 12.0, -9.0], noise=0.0)
    >>> recording = simulate.tumble(seed=1, motion="swayed", n=9000, sensor=bare, imu=simulate.Imu(gyro_noise=0.0))
    >>> Px4Observer().estimate(Readings.of(recording.samples)).ellipsoid.centre.round(1)
    array([20., 12., -9.])
    """

    gain: float = GAIN

    name: ClassVar[str] = "px4-observer"
    unknowns: ClassVar[int] = 5
    use: ClassVar[str] = "the offset that PX4's online observer would learn from field and gyro"
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse a gain that means nothing.

        Raises
        ------
        UsageError
            For anything but a positive number.
        """
        refuse_unless_positive(gain=self.gain)

    def estimate(self, readings: Readings) -> Estimate:
        """Observe the whole recording; the offset is that at its end.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NeedsSamples, NeedsRate
            If only sums were given; if there is no angular rate, or no times.
        OneAxisTurned
            If the body turned about one axis alone.
        NotAnEllipsoid
            If the gain is too large for these rates, and the observer runs away.
        """
        readings.require(self.unknowns, self.name)
        steps = steps_of(readings, self.name)
        require_two_axes(steps, self.name)
        followed, left = self.followed(steps)
        offset = followed[-1]
        late = followed[-max(2, round(LATE * len(followed))) :]
        with np.errstate(over="ignore", invalid="ignore"):
            apart = late - offset
            start = left @ offset
            covariance = apart.T @ apart / len(apart) + np.outer(start, start)
        ellipsoid, whole, noise = sphere_about(offset, readings, covariance)
        return Estimate(ellipsoid, whole, noise, self.name, used=len(readings.summary))

    def followed(self, steps: list[Steps]) -> tuple[Floats, Floats]:
        """(M, 3) the offset after each step, and (3, 3) what is left of an error at the start."""
        offset, left = np.zeros(3), np.eye(3)
        followed: list[Floats] = []
        with np.errstate(over="ignore", invalid="ignore"):
            for one in steps:
                decays, pulls = self._affine(one)
                for decay, pull in zip(decays, pulls, strict=True):
                    offset = decay @ offset + pull
                    followed.append(offset)
                    left = decay @ left
        return np.array(followed), left

    def _affine(self, steps: Steps) -> tuple[Floats, Floats]:
        """(M, 3, 3) and (M, 3): each step as b⁺ = D b + p, for it is linear in b."""
        rate, weight = steps.turn, self.gain * steps.seconds
        across = np.einsum("ni,ni,jk->njk", rate, rate, np.eye(3)) - np.einsum("nj,nk->njk", rate, rate)  # WᵀW
        decays: Floats = np.eye(3) - (weight * steps.seconds)[:, np.newaxis, np.newaxis] * across
        begin, seconds = steps.begin, steps.seconds[:, np.newaxis]
        innovation = steps.last - begin + np.cross(rate, begin) * seconds  # with b = 0
        pulls: Floats = -np.cross(rate, innovation) * weight[:, np.newaxis]
        return decays, pulls
