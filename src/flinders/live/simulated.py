"""A simulated sensor that tumbles by itself, for ever.

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
from flinders.live.feeds import Replay
from flinders.simulate import Imu, Sensor, hand_tumble, north_and_down, seen_from, specific_force

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.random import Generator

    from flinders.simulate import Trajectory

RATE_HZ: Final = 50.0
FIELD_UT: Final = 50.0
DIP_DEG: Final = 60.0
TUMBLE_S: Final = 60.0  # Seconds of tumbling that are drawn, and gone through again and again, forwards and backwards


class SimulatedFeed(Replay):
    """A sensor with its iron, turned in a field of 50 µT that points 60° down.

    Parameters
    ----------
    seed : int
        The same seed gives the same sensor, tumble and noise.
    speed : float, optional
        So many times as fast as by the clock; None for as fast as it is asked.
    clock, sleep : callable
        Seconds, ascending; and wait.

    Attributes
    ----------
    sensor : Sensor
        As on small boards, with 0.5 µT of noise.

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
        path = hand_tumble(of_motion, seconds=TUMBLE_S, rate_hz=RATE_HZ)
        super().__init__(_EndlessTumble(self.sensor, path, noise), speed=speed, clock=clock, sleep=sleep)
        self._words = f"a simulated sensor, {RATE_HZ:g} readings a second"


@dataclass(frozen=True, slots=True, eq=False)
class _EndlessTumble:
    """A recording without end: one path, forwards and backwards, each time with other noise."""

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
            field = FIELD_UT * seen_from(attitudes, north_and_down(DIP_DEG))
            yield Samples.of(
                self.sensor.read(field, self.noise),
                unit=self.unit,
                time=(turn * count + np.arange(count)) / RATE_HZ,
                acceleration=specific_force(attitudes, self.noise, noise=imu.acceleration_noise),
                rate=rate + imu.gyro_bias + imu.gyro_noise * self.noise.standard_normal(rate.shape),
                source=self.source,
            )
