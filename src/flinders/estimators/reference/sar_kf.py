"""SAR-KF: a Kalman filter whose state is the true field and the offset, driven by the gyro."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.estimators.base import Estimate
from flinders.estimators.reference.gyro_windows import refuse_unless_positive, require_two_axes, sphere_about, steps_of
from flinders.likelihood.equations import FINEST
from flinders.simulate.rotations import turns

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.reference.gyro_windows import Steps

GYRO_NOISE: Final = 0.005
"""rad/s, one σ of each reading: that of the published simulation, and of ordinary MEMS gyros."""

USUAL: Final = 1.5382
"""Median length of three normal numbers."""

_EYE: Final = np.eye(3)


@dataclass(frozen=True, slots=True)
class SarKf:
    """Kalman filter of (x, b), with the gyro as its input and the readings as its measurements.

        d/dt (x, b) = [[−W, W], [0, 0]] (x, b),     y = x + n,     W = [ω]×           (section IV.B)

    Over a step with a constant rate, x⁺ = E x + (1 − E) b with E = exp(−W Δt), exactly. It is linear in the
    state, so nothing is differentiated or linearised. Noise of the gyro moves x by σ_g Δt across x − b each
    step, at the b found so far.

    Use it for parity with the published filter, and to see what a filter on board would have: it is the best of the
    methods that look for an offset alone. Not where soft iron or a bias of the gyro is there: neither is in its
    state, and what it claims does not know of them.

    Parameters
    ----------
    noise : float, optional
        Of the readings, one σ an axis, in their unit; by default from their third differences.
    gyro_noise : float, rad/s
        One σ an axis of each reading of the gyro.

    Notes
    -----
    It starts from the first reading and the mean of all, the latter as uncertain as the readings are spread. The
    published gains, one for the process and one for the measurement, are these two noises; the covariance is the
    filter's own, and what separates the answer from the likelihood joins it (`flinders.estimators.bias_inflation`).

    References
    ----------
    .. [1] G. Troni, L. L. Whitcomb (2019), see `SarLs`.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.estimators.data import Readings
    >>> bare = simulate.Sensor(offset=[20.0, 120.0, 90.0], noise=0.1)
    >>> recording = simulate.tumble(seed=1, motion="swayed", n=1500, sensor=bare)
    >>> found = SarKf().estimate(Readings.of(recording.samples))
    >>> error = found.ellipsoid.centre - bare.offset
    >>> bool(np.all(np.abs(error) < 3 * np.sqrt(np.diag(found.covariance)[:3]))), bool(np.abs(error).max() < 0.3)
    (True, True)
    """

    noise: float | None = None
    gyro_noise: float = GYRO_NOISE

    name: ClassVar[str] = "sar-kf"
    unknowns: ClassVar[int] = 5
    use: ClassVar[str] = "the offset from field and gyro by a Kalman filter: parity with Troni and Whitcomb"
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse noise that means nothing.

        Raises
        ------
        UsageError
            For anything but positive numbers.
        """
        refuse_unless_positive(gyro_noise=self.gyro_noise)
        if self.noise is not None:
            refuse_unless_positive(noise=self.noise)

    def estimate(self, readings: Readings) -> Estimate:
        """Filter the whole recording; the offset is that at its end.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NeedsSamples, NeedsRate
            If only sums were given; if there is no angular rate, or no times.
        OneAxisTurned
            If the body turned about one axis alone.
        """
        readings.require(self.unknowns, self.name)
        steps = steps_of(readings, self.name)
        require_two_axes(steps, self.name)
        origin, scale = readings.summary.moments.mean, readings.summary.moments.spread
        noise = max(noise_of(steps) if self.noise is None else self.noise, FINEST * scale) / scale
        offset: Floats = np.zeros(3)
        covariance: Floats = np.eye(3)
        for one in steps:
            offset, covariance = self._filtered(one, origin, scale, noise, offset, covariance)
        ellipsoid, whole, left = sphere_about(origin + scale * offset, readings, scale**2 * covariance)
        return Estimate(ellipsoid, whole, left, self.name, used=len(readings.summary))

    def _filtered(
        self, steps: Steps, origin: Floats, scale: float, noise: float, offset: Floats, covariance: Floats
    ) -> tuple[Floats, Floats]:
        """Offset (3,) and its covariance after a stretch, both in spreads of the readings."""
        state = np.concatenate([(steps.first - origin) / scale, offset])
        known = np.zeros((6, 6))
        known[:3, :3], known[3:, 3:] = noise**2 * _EYE, covariance
        measured = noise**2 * _EYE
        moves = turns(-steps.turn * steps.seconds[:, np.newaxis])  # E
        shaken = ((self.gyro_noise * steps.seconds) ** 2).tolist()
        change = np.eye(6)
        for move, jolt, reading in zip(moves, shaken, (steps.last - origin) / scale, strict=True):
            change[:3, :3], change[:3, 3:] = move, _EYE - move
            state = change @ state
            known = change @ known @ change.T
            arm = state[:3] - state[3:]
            known[:3, :3] += jolt * (arm @ arm * _EYE - np.outer(arm, arm))
            gain = np.linalg.solve(known[:3, :3] + measured, known[:3]).T
            state = state + gain @ (reading - state[:3])
            known = known - gain @ known[:3]
            known = (known + known.T) / 2.0
        return state[3:], known[3:, 3:]


def noise_of(steps: list[Steps]) -> float:
    """White noise of the readings, one σ an axis, from their third differences: a smooth turn has next to none.

    >>> from flinders.estimators.reference.gyro_windows import Steps
    >>> white = np.random.default_rng(1).normal(size=(2000, 3))
    >>> steps = Steps(white[0], white[1:], np.full(1999, 0.01), np.ones((1999, 3)))
    >>> round(noise_of([steps]), 1)
    1.0
    """
    third = np.concatenate([np.diff(one.last, n=3, axis=0) for one in steps])
    lengths = np.linalg.norm(third, axis=1)
    return float(np.median(lengths) / (USUAL * np.sqrt(20.0))) if len(lengths) else 0.0
