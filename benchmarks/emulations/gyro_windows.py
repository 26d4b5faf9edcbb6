"""Steps from reading to reading with the angular rate, as input of emulations that use a gyro.

A field that is fixed in the world turns in the body, ẋ = −ω × (x − b). From one reading to the next, with the rate
constant in between, u = x − b turns by the angle θ = |ω| Δt:

    x⁺ − x = −ω' Δt × ((x⁺ + x)/2 − b),     ω' = ω · tan(θ/2) / (θ/2)

The equation is exact (Cayley's form of a rotation), while a difference quotient would have an error. The noises of the
difference of two readings and of their mean are independent.

Times are used as recorded. A new segment begins where time stands still, goes back, or jumps by more than three median
steps.

>>> from flinders import simulate
>>> recording = simulate.tumble(seed=1, n=500, noise=0.0, imu=simulate.Imu(gyro_noise=0.0), sensor=simulate.Sensor())
>>> [steps] = steps_of(recording.samples)
>>> moved = steps.slope + np.cross(steps.rate, steps.middle)
>>> len(steps), float(np.abs(moved).max()) < 1e-9
(499, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import FitError, NotAnEllipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.summary.moments import Moments

if TYPE_CHECKING:
    from flinders import Samples
    from flinders.arrays import Floats

MAX_GAP_STEPS: Final = 3.0
"""Longest step between consecutive readings, in median steps."""

MIN_RATE_RATIO: Final = 0.05
"""Smallest ratio of rates across the main axis of turning to those about it; smaller ones may be noise of the gyro."""


class NeedsRate(FitError):
    """The recording lacks an angular rate, times, or two consecutive readings."""


class OneAxisTurned(FitError):
    """The body turned about one axis only, so that the offset along this axis is unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Steps between consecutive readings.

    Attributes
    ----------
    first : (3,) float
        Reading before the first step, in the unit of the readings.
    last : (M, 3) float
        Reading at the end of each step.
    seconds : (M,) float, s
        Duration of each step.
    turn : (M, 3) float, rad/s
        Angular rate, which counts as constant over the step: the reading of the gyro at its beginning.
    """

    first: Floats
    last: Floats
    seconds: Floats
    turn: Floats

    def __len__(self) -> int:
        return len(self.last)

    @property
    def begin(self) -> Floats:
        """(M, 3) reading at the beginning of each step."""
        return np.concatenate([self.first[np.newaxis], self.last[:-1]])

    @property
    def middle(self) -> Floats:
        """(M, 3) mean of the two readings of each step."""
        middle: Floats = (self.begin + self.last) / 2.0
        return middle

    @property
    def slope(self) -> Floats:
        """(M, 3) difference of the two readings of each step, per second."""
        slope: Floats = (self.last - self.begin) / self.seconds[:, np.newaxis]
        return slope

    @property
    def rate(self) -> Floats:
        """(M, 3) ω' of the equation above, in rad/s."""
        half = np.linalg.norm(self.turn, axis=1) * self.seconds / 2.0
        stretched: Floats = self.turn * np.where(half > 1e-8, np.tan(half) / np.maximum(half, 1e-8), 1.0)[:, np.newaxis]
        return stretched


def steps_of(samples: Samples) -> list[Steps]:
    """Steps of a recording, in segments without gaps; readings without a rate are left out.

    Raises
    ------
    NeedsRate
        If angular rate or times are missing, or there are no two consecutive readings.
    OneAxisTurned
        If the rms rate across the main axis is less than a twentieth of that about it.
    """
    if samples.rate is None or samples.time is None:
        raise NeedsRate("the emulations with a gyro need an angular rate and times")
    known = np.isfinite(samples.time) & np.isfinite(samples.rate).all(axis=1)
    steps = _split(samples.field[known], samples.time[known], samples.rate[known])
    if not steps:
        raise NeedsRate("no two readings follow each other in time")
    _require_two_axes(steps)
    return steps


def sphere_about(centre: Floats, samples: Samples) -> Ellipsoid:
    """Sphere about a (3,) centre, whose radius is the rms distance of the readings.

    Raises
    ------
    NotAnEllipsoid
        For a centre that is not finite, such as that of an observer that diverges.
    """
    moments = Moments.of(samples.field)
    with np.errstate(over="ignore"):
        radius = float(np.hypot(moments.spread, np.linalg.norm(moments.mean - centre)))
    if not np.isfinite(radius):
        raise NotAnEllipsoid((np.nan,) * 3)
    return Ellipsoid(centre, radius * np.eye(3))


def _require_two_axes(steps: list[Steps]) -> None:
    """Raise `OneAxisTurned` if all rates are about one axis."""
    square = sum((np.asarray(one.turn.T @ one.turn) for one in steps), np.zeros((3, 3)))
    values = np.maximum(np.linalg.eigvalsh(square), 0.0)
    across = float(np.sqrt(values[1] / values[2])) if values[2] > 0.0 else 0.0
    if not across >= MIN_RATE_RATIO:
        raise OneAxisTurned(f"rates across the main axis are {across:.1%} of those about it, need {MIN_RATE_RATIO:.0%}")


def _split(field: Floats, time: Floats, rate: Floats) -> list[Steps]:
    """Segments of consecutive readings, split where times are irregular."""
    seconds = np.diff(time)
    if not np.any(seconds > 0.0):
        return []
    usual = float(np.median(seconds[seconds > 0.0]))
    broken = np.flatnonzero((seconds <= 0.0) | (seconds > MAX_GAP_STEPS * usual)) + 1
    rows = np.split(np.arange(len(time)), broken)
    return [
        Steps(field[some[0]], field[some[1:]], seconds[some[:-1]], rate[some[:-1]]) for some in rows if len(some) > 1
    ]
