"""A simulated sensor: it tumbles by itself, or turns to a given attitude.

>>> feed = SimulatedFeed(seed=1, speed=None)
>>> feed.next(0.1).kind, len(feed.next(0.1))
('connected', 50)
>>> feed.turn_to(np.eye(3))                                        # level, heading north
>>> readings = [reading for _ in range(20) for reading in feed.next(0.1)]
>>> level = feed.truth.sensor.matrix @ [25.0, 0.0, 43.3] + feed.truth.sensor.offset
>>> bool(np.abs(np.array(readings[-1].field) - level).max() < 3.0)  # its noise is 0.5 µT
True
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import floats
from flinders.arrays import matrix as square
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.live.feeds import FeedEvent, Reading, readings_of
from flinders.simulate import (
    Imu,
    Sensor,
    hand_tumble,
    north_and_down,
    rotation_vectors,
    seen_from,
    specific_force,
    turns,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

AT_ONCE: Final = 50
"""Readings handed on together at full speed; otherwise those that are due, a second's at most."""
TUMBLE_S: Final = 60.0
"""Seconds of tumbling that are drawn at a time, and gone through again and again, forwards and backwards."""
SHORTEST_S: Final = 1e-4
"""Least wait."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedSite:
    """What is true of a simulated sensor.

    Attributes
    ----------
    sensor : Sensor
    field_strength : float, µT
    dip_deg : float
    """

    sensor: Sensor
    field_strength: float
    dip_deg: float


class SimulatedFeed:
    """A sensor with its iron, turned in the earth's field.

    Parameters
    ----------
    seed : int
        The same seed gives the same sensor, tumble and noise.
    sensor : Sensor, optional
        By default one as on small boards, with 0.5 µT of noise.
    imu : Imu, optional
        Its gyro and accelerometer.
    field_strength, dip_deg : float, µT and degrees
    rate_hz : float
        Readings a second.
    turn_deg_s : float
        How fast it turns to a given attitude.
    speed : float, optional
        So many times as fast as by the clock; None for as fast as it is asked.
    clock, sleep : callable
        Seconds, ascending; and wait.

    Attributes
    ----------
    truth : SimulatedSite

    Raises
    ------
    UsageError
        For a rate or speed that is not positive.
    """

    name = "simulation"

    def __init__(
        self,
        seed: int = 0,
        *,
        sensor: Sensor | None = None,
        imu: Imu | None = None,
        field_strength: float = 50.0,
        dip_deg: float = 60.0,
        rate_hz: float = 50.0,
        turn_deg_s: float = 90.0,
        speed: float | None = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        for what, value in (
            ("rate_hz", rate_hz),
            ("turn_deg_s", turn_deg_s),
            ("speed", 1.0 if speed is None else speed),
        ):
            if not 0 < value < math.inf:
                raise UsageError(f"{what} is {value:g}: need a number above 0")
        of_sensor, of_motion, self._noise = np.random.default_rng(seed).spawn(3)
        self.truth = SimulatedSite(Sensor.random(of_sensor) if sensor is None else sensor, field_strength, dip_deg)
        self._imu = Imu() if imu is None else imu
        self._world, self._step = north_and_down(dip_deg), 1.0 / rate_hz
        self._speed, self._clock, self._sleep = speed, clock, sleep
        tumble = hand_tumble(of_motion, seconds=TUMBLE_S, rate_hz=rate_hz)
        self._rates, self._attitude = tumble.rate, tumble.attitudes[0]
        self._most = math.radians(turn_deg_s) * self._step
        self._lock = threading.Lock()
        self._wanted: Floats | None = None
        self._count, self._start = 0, clock()
        self._is_announced = self._is_over = False

    @property
    def attitude(self) -> Floats:
        """(3, 3) the present attitude, from body axes into world axes (north, east, down)."""
        return floats(self._attitude)

    def turn_to(self, attitude: ArrayLike | None) -> None:
        """Turn to an attitude by the shortest way and stay there, or go on tumbling; from any thread.

        Parameters
        ----------
        attitude : (3, 3) array-like, optional
            A rotation, from body axes into world axes; None to tumble.

        Raises
        ------
        ArrayError
            For another shape, or numbers that are not finite.
        UsageError
            For a matrix that is no rotation.
        """
        wanted = None if attitude is None else square(attitude)
        if wanted is not None and not (
            np.allclose(wanted @ wanted.T, np.eye(3), atol=1e-6) and np.linalg.det(wanted) > 0
        ):
            raise UsageError(
                "attitude is no rotation: its columns must be the body's axes, of length 1 and right-handed"
            )
        with self._lock:
            self._wanted = wanted

    def next(self, timeout: float) -> list[Reading] | FeedEvent:
        """As `Feed.next`."""
        if not self._is_announced:
            self._is_announced, self._start = True, self._clock()
            return FeedEvent("connected", 0.0, f"a simulated sensor, {1 / self._step:g} readings a second")
        if self._is_over:
            self._sleep(timeout)
            return []
        return self._measured(self._due(timeout))

    def close(self) -> None:
        """As `Feed.close`."""
        self._is_over = True

    def _due(self, timeout: float) -> int:
        """Count the readings that are due, after waiting for the first of them; while nobody asks it stands still."""
        if self._speed is None:
            return AT_ONCE
        step = self._step / self._speed
        if int((self._clock() - self._start) / step) <= self._count:
            wait = (self._count + 1) * step - (self._clock() - self._start)
            self._sleep(max(min(wait, timeout), SHORTEST_S))
        due = int((self._clock() - self._start) / step) - self._count
        most = max(AT_ONCE, round(1.0 / step))
        if due > most:
            self._start += (due - most) * step
        return max(min(due, most), 0)

    def _measured(self, count: int) -> list[Reading]:
        """Go on by so many steps, and measure at each."""
        if not count:
            return []
        steps = [self._stepped() for _ in range(count)]
        attitudes, rate = np.array([step[0] for step in steps]), np.array([step[1] for step in steps])
        true = self.truth.field_strength * seen_from(attitudes, self._world)
        turned = rate + self._imu.gyro_bias + self._imu.gyro_noise * self._noise.standard_normal(rate.shape)
        samples = Samples.of(
            self.truth.sensor.read(true, self._noise),
            unit="uT",
            time=self._step * (self._count - count + np.arange(count)),
            acceleration=specific_force(attitudes, self._noise, noise=self._imu.acceleration_noise),
            rate=turned,
            source=self.name,
        )
        return readings_of(samples)

    def _stepped(self) -> tuple[Floats, Floats]:
        """Present attitude and rate: towards the given attitude, or as the tumble goes on."""
        with self._lock:
            wanted = self._wanted
        if wanted is None:
            place = self._count % (2 * len(self._rates))
            rate = self._rates[place] if place < len(self._rates) else -self._rates[-1 - place % len(self._rates)]
        else:
            left = _vector(self._attitude.T @ wanted)
            size = float(np.linalg.norm(left))
            rate = left * min(1.0, self._most / max(size, 1e-12)) / self._step
        before = self._attitude
        left, _, right = np.linalg.svd(before @ turns(rate[np.newaxis] * self._step)[0])  # rounding adds up
        self._attitude = floats(left @ right)
        self._count += 1
        return before, rate


def _vector(rotation: Floats) -> Floats:
    """(3,) rotation vector in rad of a rotation, by half a turn too."""
    if np.trace(rotation) > -1.0 + 1e-9:
        return floats(rotation_vectors(rotation[np.newaxis])[0])
    return floats(math.pi * np.linalg.eigh(rotation + rotation.T)[1][:, -1])
