"""Feed of a simulated sensor in a hand: first only rocked, the most common mistake, then turned through all directions.

A calibration within 1° takes half a minute, so that a new user sees the page's advice first.

>>> feed = SimulatedFeed(seed=1, speed=None)
>>> feed.next(0.1).words
'a simulated sensor, 50 readings a second'
>>> readings = feed.next(0.1)
>>> len(readings), readings.unit.inside
(500, 'uT')
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.geometry.rotation import rotations
from flinders.links.feeds import FeedEvent, Received, Replay
from flinders.simulate import Imu, Sensor, hand_tumble, in_body_axes, north_and_down, specific_force
from flinders.simulate.attitudes import integrate_steps, random_attitude
from flinders.simulate.motions import Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.random import Generator

    from flinders.arrays import Floats

RATE_HZ: Final = 50.0
FIELD_UT: Final = 50.0
DIP_DEG: Final = 60.0
ROCKING_S: Final = 16.0
ROCKING: Final = ((0.5, 0.25), (0.4, 0.375), (0.0, 0.0))
"""Amplitude, rad/s, and frequency, Hz, of the rate about each axis while rocking, by about ±20°."""
TUMBLE_S: Final = 60.0
TUMBLE_RADPS: Final = 0.8
"""Turn rate of a slow hand, rad/s."""
COMMENTS: Final = (
    (4.0, "the simulated hand only rocks the sensor, a common mistake: most directions of the sphere stay unknown"),
    (ROCKING_S, "now it turns the sensor over, through all directions: the error falls"),
)
"""Times of the simulation in s, and the comments that are shown at these times."""


class SimulatedFeed(Replay):
    """A sensor with its iron, turned in a field of 50 µT that points 60° down.

    Parameters
    ----------
    seed : int
        The same seed gives the same sensor, tumble and noise.
    speed : float, optional
        Speed relative to the clock; None for as fast as possible.
    clock, sleep : callable
        Functions that return ascending seconds, and wait.

    Attributes
    ----------
    sensor : Sensor
        The sensor: as on small boards, with 0.5 µT of noise.

    Raises
    ------
    UsageError
        For a speed that is not positive.
    """

    def __init__(
        self,
        seed: int = 0,
        *,
        speed: float | None = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        of_sensor, of_motion, noise = np.random.default_rng(seed).spawn(3)
        self.sensor = Sensor.random(of_sensor)
        path = rocking_then_tumble(of_motion)
        super().__init__(_EndlessTumble(self.sensor, path, noise), speed=speed, clock=clock, sleep=sleep)
        self._said = list(COMMENTS)
        self._reached_s = 0.0

    @property
    def _words(self) -> str:
        return f"a simulated sensor, {RATE_HZ:g} readings a second"

    def next(self, timeout: float) -> Received:
        """As `Feed.next`, with comments on the motion of the hand."""
        if self._said and self._reached_s >= self._said[0][0]:
            return FeedEvent("connected", *self._said.pop(0))
        received = super().next(timeout)
        if isinstance(received, Samples) and received.time is not None:
            self._reached_s = float(received.time[-1])
        return received


def rocking_then_tumble(rng: Generator) -> Trajectory:
    """Rock a body for `ROCKING_S`, and tumble it for `TUMBLE_S`."""
    time: Floats = np.arange(round(ROCKING_S * RATE_HZ)) / RATE_HZ
    rocking = np.stack([amplitude * np.cos(2.0 * np.pi * hertz * time) for amplitude, hertz in ROCKING], axis=1)
    tumbling = hand_tumble(rng, seconds=TUMBLE_S, rate_hz=RATE_HZ, speed=TUMBLE_RADPS)
    rate = np.concatenate([rocking, tumbling.rate])
    attitudes = integrate_steps(random_attitude(rng), rotations(rate / RATE_HZ))
    return Trajectory(np.arange(len(rate)) / RATE_HZ, attitudes, rate)


@dataclass(frozen=True, slots=True, eq=False)
class _EndlessTumble:
    """An endless recording: one path, forwards and backwards, each time with new noise."""

    sensor: Sensor
    path: Trajectory
    noise: Generator
    source: ClassVar = "simulation"
    unit: ClassVar = Unit.of("uT")
    axes: ClassVar = Axes()

    def blocks(self) -> Iterator[Samples]:
        imu, count = Imu(), len(self.path.attitudes)
        for turn in itertools.count():
            sign = -1 if turn % 2 else 1
            attitudes, rate = self.path.attitudes[::sign], sign * self.path.rate[::sign]
            field = FIELD_UT * in_body_axes(attitudes, north_and_down(DIP_DEG))
            yield Samples.of(
                self.sensor.read(field, self.noise),
                unit=self.unit,
                time=(turn * count + np.arange(count)) / RATE_HZ,
                acceleration=specific_force(attitudes, self.noise, noise=imu.acceleration_noise),
                rate=rate + imu.gyro_bias + imu.gyro_noise * self.noise.standard_normal(rate.shape),
                source=self.source,
            )
