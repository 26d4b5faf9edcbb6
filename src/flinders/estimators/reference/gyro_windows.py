"""Readings beside the rate at which the body turned: what the methods of this family look at.

A field that is fixed in the world turns in the body, ẋ = −ω × (x − b). From one reading to the next, with the rate
constant in between, u = x − b turns by the angle θ = |ω| Δt:

    x⁺ − x = −ω' Δt × ((x⁺ + x)/2 − b),     ω' = ω · tan(θ/2) / (θ/2)

which is exact (Cayley's form of a rotation), so that no error of the difference quotient is left. The noise of the
difference and that of the mean of two readings are independent, too.

Time has to be there, and is used as it is told; where it stands still, goes back or jumps by more than three usual
steps, one stretch ends and the next begins.

>>> from flinders import simulate
>>> recording = simulate.tumble(seed=1, n=500, noise=0.0, imu=simulate.Imu(gyro_noise=0.0), sensor=simulate.Sensor())
>>> from flinders.estimators.data import Readings
>>> [steps] = steps_of(Readings.of(recording.samples), "sar-ls")
>>> moved = steps.slope + np.cross(steps.rate, steps.middle)
>>> len(steps), float(np.abs(moved).max()) < 1e-9
(499, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NeedsRate, NeedsSamples, NotAnEllipsoid, OneAxisTurned, UsageError
from flinders.estimators.uncertainty import SPHERICAL, algebraic_noise
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood.equations import FINEST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

GAP: Final = 3.0
"""Usual steps of time beyond which two readings do not follow each other."""

ACROSS: Final = 0.05
"""Rates across the main axis of turning, over those about it, below which noise of the gyro passes for them."""

BLOCKS: Final = 20
"""Stretches of time of which each is left out in turn: enough for a covariance, longer than residuals remember."""


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Consecutive pairs of readings.

    Attributes
    ----------
    first : (3,) float
        Reading before the first step, in the unit of the readings.
    last : (M, 3) float
        Reading at the end of each step.
    seconds : (M,) float, s
        How long each takes.
    turn : (M, 3) float, rad/s
        Angular rate, constant over the step: what the gyro read at its beginning.
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
        """(M, 3) mean of the two readings."""
        middle: Floats = (self.begin + self.last) / 2.0
        return middle

    @property
    def slope(self) -> Floats:
        """(M, 3) difference of the two readings, a second."""
        slope: Floats = (self.last - self.begin) / self.seconds[:, np.newaxis]
        return slope

    @property
    def rate(self) -> Floats:
        """(M, 3) ω' of the head of this module, rad/s."""
        half = np.linalg.norm(self.turn, axis=1) * self.seconds / 2.0
        stretched: Floats = self.turn * np.where(half > 1e-8, np.tan(half) / np.maximum(half, 1e-8), 1.0)[:, np.newaxis]
        return stretched


def refuse_unless_positive(**options: object) -> None:
    """Let options of a method through that are positive numbers.

    Raises
    ------
    UsageError
        For any other; names it.
    """
    for name, value in options.items():
        if not (isinstance(value, int | float) and 0.0 < value < np.inf):
            raise UsageError(f"{name} is {value!r}: need a positive number")


def steps_of(readings: Readings, method: str) -> list[Steps]:
    """Take the steps out of each recording, without gaps.

    Raises
    ------
    NeedsSamples
        If only sums were given.
    NeedsRate
        If a recording has no angular rate, no times, or no two readings that follow each other.
    """
    found: list[Steps] = []
    for part in readings.each:
        found += _split(*_columns(part, method))
    if not found:
        raise NeedsRate(method, "two readings that follow each other in time beside the angular rate")
    return found


def require_two_axes(steps: list[Steps], method: str) -> None:
    """Refuse rates that are all about one axis.

    Raises
    ------
    OneAxisTurned
        If the root mean square rate across the main axis is below a twentieth of that about it.
    """
    square = sum((np.asarray(one.turn.T @ one.turn) for one in steps), np.zeros((3, 3)))
    values = np.maximum(np.linalg.eigvalsh(square), 0.0)
    found = float(np.sqrt(values[1] / values[2])) if values[2] > 0.0 else 0.0
    if not found >= ACROSS:
        raise OneAxisTurned(found=found, needed=ACROSS, method=method)


def sphere_about(centre: Floats, readings: Readings, covariance: Floats) -> tuple[Ellipsoid, Floats, float]:
    """The sphere about a centre (3,) that its method found, the (9, 9) covariance with the radius', and the noise.

    The radius is the root mean square distance of the readings. What the method leaves out, soft iron and gains, is
    seen as noise.

    Parameters
    ----------
    centre : (3,) float
    readings : Readings
    covariance : (3, 3) float
        Of the centre.

    Raises
    ------
    NotAnEllipsoid
        For a centre so far from its readings that their sums do not tell.
    """
    moments = readings.summary.moments
    if not np.all(np.isfinite(centre)) or not np.all(np.isfinite(covariance)):
        raise NotAnEllipsoid((np.nan,) * 3)
    radius = float(np.hypot(moments.spread, np.linalg.norm(moments.mean - centre)))
    ellipsoid = Ellipsoid(centre, radius * np.eye(3))
    noise = algebraic_noise(readings, ellipsoid, 4)
    whole = np.zeros((9, 9))
    whole[:3, :3] = covariance
    size = SPHERICAL[:, 3] * max(noise, FINEST * radius) / np.sqrt(moments.count)
    return ellipsoid, whole + np.outer(size, size), noise


def cut(count: int, blocks: int = BLOCKS) -> NDArray[np.int64]:
    """Beginnings of about equally long stretches of so many rows, for `numpy.add.reduceat`.

    >>> cut(10, 4)
    array([0, 2, 5, 7])
    """
    return np.unique(np.arange(blocks) * count // blocks)


def _columns(part: Readings, method: str) -> tuple[Floats, Floats, Floats]:
    """(N, 3) field, (N,) time and (N, 3) rate of one recording; readings whose rate is not known are left out."""
    if part.recording is None:
        raise NeedsSamples(method)
    fields: list[Floats] = [np.empty((0, 3))]
    times: list[Floats] = [np.empty(0)]
    rates: list[Floats] = [np.empty((0, 3))]
    for block in part.recording.blocks():
        if block.rate is None:
            raise NeedsRate(method)
        if block.time is None:
            raise NeedsRate(method, "times")
        fields.append(block.field)
        times.append(block.time)
        rates.append(block.rate)
    field, time, rate = np.concatenate(fields), np.concatenate(times), np.concatenate(rates)
    known = np.isfinite(time) & np.isfinite(rate).all(axis=1)
    return field[known], time[known], rate[known]


def _split(field: Floats, time: Floats, rate: Floats) -> list[Steps]:
    """Consecutive readings, cut where time does not go on."""
    seconds = np.diff(time)
    if not np.any(seconds > 0.0):
        return []
    usual = float(np.median(seconds[seconds > 0.0]))
    broken = np.flatnonzero((seconds <= 0.0) | (seconds > GAP * usual)) + 1
    rows = np.split(np.arange(len(time)), broken)
    return [
        Steps(field[some[0]], field[some[1:]], seconds[some[:-1]], rate[some[:-1]]) for some in rows if len(some) > 1
    ]
