"""Days of five bodies, robot, boat, drone, wrist and phone: their rotations and the fields around them.

Each day is a list of spells, periods with one activity; a body at rest for long gives a reading each ten seconds. A
life begins with a calibration turn of `FIRST_S`: a robot spins on the spot, a boat goes in circles, the others are
tumbled by hand. Yaw, pitch and roll turn north, east, down into forward, right, down.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from numpy.random import Generator

    from flinders.arrays import Floats

HOUR: Final = 3600.0
DAY: Final = 24.0 * HOUR
FIRST_S: Final = 180.0
"""Duration of the calibration turn."""
FIRST_HOUR: Final = 5.0
"""Hour of the day at which a life begins."""


@dataclass(frozen=True, slots=True, eq=False)
class Spell:
    """A period with one activity of a body."""

    seconds: Floats  #: (n,) s of life
    angles: Floats  #: (n, 3) rad: yaw, pitch, roll
    place: Floats  #: (n, 3) µT, world axes: local field in addition to the earth's
    load: Floats  #: (n,) share of the largest current
    near: Floats  #: (n, 3) µT, body axes: field of a magnet near the sensor, or of the steel of a car


@dataclass(frozen=True, slots=True, eq=False)
class Rooms:
    """Source-free field that varies over metres: waves over the floor that decay upwards.

    ``B = Σ a exp(-κ h) (k̂ sin θ, -cos θ)``, θ = k·x + φ, κ = |k|: north, east, down.
    """

    waves: Floats  #: (m, 2) rad/m
    phases: Floats  #: (m,)
    size: float  #: µT of each wave

    @classmethod
    def random(cls, rng: Generator, share: float | None = None) -> Rooms:
        """A field that varies by 5 to 20 % of the earth's, rms, over 2 to 10 m."""
        turn = rng.uniform(0.0, 2.0 * np.pi, 10)
        number = 2.0 * np.pi / np.exp(rng.uniform(np.log(2.0), np.log(10.0), 10))
        sigma = 50.0 * (rng.uniform(0.05, 0.2) if share is None else share)
        waves = np.stack([number * np.cos(turn), number * np.sin(turn)], axis=1)
        return cls(waves, rng.uniform(0.0, 2.0 * np.pi, 10), sigma / np.sqrt(10.0))

    def at(self, north: Floats, east: Floats, height: Floats | float = 0.0) -> Floats:
        """(n, 3) µT at (n,) places, m."""
        total = np.zeros((len(north), 3))
        for wave, phase in zip(self.waves, self.phases, strict=True):
            theta, number = wave[0] * north + wave[1] * east + phase, np.hypot(*wave)
            sine, fading = np.sin(theta), self.size * np.exp(-number * height)
            total += fading * np.stack([wave[0] / number * sine, wave[1] / number * sine, -np.cos(theta)]).T
        return total


@dataclass(slots=True, eq=False)
class Diary:
    """List of consecutive spells, until the end of the last day."""

    rng: Generator
    end_s: float
    kinds: Collection[str]
    now: float = 0.0
    spells: list[Spell] = field(default_factory=list)

    @property
    def hour(self) -> float:
        """Present hour of the day; a life begins at `FIRST_HOUR`, so that a life of one day contains a night."""
        return (self.now / HOUR + FIRST_HOUR) % 24.0

    def times(self, lasts: float, rate_hz: float) -> Floats:
        """(n,) times of readings in the next spell, s from its beginning, at a rate in Hz."""
        return np.arange(0.0, min(lasts, self.end_s - self.now), 1.0 / rate_hz)

    def put(
        self,
        seconds: Floats,
        angles: Floats,
        *,
        place: Floats | None = None,
        load: Floats | float = 0.0,
        near: Floats | None = None,
    ) -> None:
        """Append a spell; the next one begins two seconds later."""
        if not len(seconds):
            return
        zero, rooms = np.zeros((len(seconds), 3)), "rooms" in self.kinds
        there = zero if place is None or not rooms else np.broadcast_to(place, zero.shape).copy()
        beside = zero if near is None else np.broadcast_to(near, zero.shape)
        self.spells.append(Spell(self.now + seconds, angles, there, np.broadcast_to(load, len(seconds)), beside))
        self.now += float(seconds[-1]) + 2.0

    def lie(
        self,
        lasts: float,
        angles: Floats,
        *,
        place: Floats | None = None,
        load: float = 0.0,
        near: Floats | None = None,
        sway: float = 0.0,
    ) -> None:
        """Append a rest: a reading a second for five minutes, then one each ten seconds. `sway` in rad."""
        lasts = min(lasts, self.end_s - self.now)
        seconds = np.concatenate([np.arange(0.0, min(lasts, 300.0)), np.arange(300.0, lasts, 10.0)])
        swayed = sway * course(self.rng, seconds, 100.0, 900.0) if sway else np.zeros((len(seconds), 3))
        self.put(seconds, angles + swayed * [1.0, 0.2, 0.2], place=place, load=load, near=near)

    def off(self, lasts: float, angles: Floats, place: Floats | None = None) -> None:
        """Append a time in which the body is switched off; a rest if the life has no gaps."""
        if "gaps" in self.kinds:
            self.now = min(self.now + lasts, self.end_s)
        else:
            self.lie(lasts, angles, place=place)


def course(rng: Generator, seconds: Floats, shortest: float, longest: float, columns: int = 3) -> Floats:
    """(n, columns) smooth random series of unit variance: twelve sines with periods between two limits, s."""
    total = np.zeros((len(seconds), columns))
    for _ in range(12):
        period = np.exp(rng.uniform(np.log(shortest), np.log(longest), columns))
        total += np.sin(2.0 * np.pi * seconds[:, None] / period + rng.uniform(0.0, 2.0 * np.pi, columns))
    scaled: Floats = total / np.sqrt(6.0)
    return scaled


def seen(angles: Floats, world: Floats) -> Floats:
    """(n, 3) vectors of world axes (n, 3) or (3,) in the axes of a body with (n, 3) yaw, pitch, roll."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles).T, np.sin(angles).T
    north, east, down = np.broadcast_to(world, angles.shape).T
    ahead, right = cy * north + sy * east, cy * east - sy * north
    forward, below = cp * ahead - sp * down, sp * ahead + cp * down
    return np.stack([forward, cr * right + sr * below, cr * below - sr * right], axis=1)


def down_of(angles: Floats) -> Floats:
    """(n, 3) directions of gravity in body axes, from (n, 3) yaw, pitch and roll."""
    return seen(angles, np.array([0.0, 0.0, 1.0]))


def rates_of(seconds: Floats, angles: Floats) -> Floats:
    """(n, 3) angular rates about body axes in rad/s, from (n, 3) yaw, pitch and roll."""
    if len(seconds) < 2:
        return np.zeros_like(angles)
    yaw, pitch, roll = np.gradient(angles, seconds, axis=0).T
    (_, cp, cr), (_, sp, sr) = np.cos(angles).T, np.sin(angles).T
    return np.stack([roll - yaw * sp, pitch * cr + yaw * cp * sr, yaw * cp * cr - pitch * sr], axis=1)


def keyed(seconds: Floats, lasts: Floats, steps: Floats) -> Floats:
    """(n, columns) series that change by (m, columns) steps one after the other; each step lasts (m,) s."""
    at = np.concatenate([[0.0], np.cumsum(lasts)])
    values = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    return np.stack([np.interp(seconds, at, column) for column in values.T], axis=1)


def tumbled(rng: Generator, seconds: Floats, shortest: float = 2.0) -> Floats:
    """(n, 3) yaw, pitch, roll of a body turned by hand to all attitudes."""
    turned: Floats = course(rng, seconds, shortest, 12.0) * [2.5, 0.6, 2.0]
    turned[:, 1] = np.clip(turned[:, 1], -1.4, 1.4)
    return turned


def strolled(rng: Generator, seconds: Floats, speed: float) -> tuple[Floats, Floats, Floats]:
    """Yaw (n,) and places north and east (n,) m of a walk within a room of 6 × 6 m, with stops."""
    count = int(len(seconds) and seconds[-1] / 4.0) + 2
    steps = np.diff(rng.uniform(0.0, 6.0, (count + 1, 2)), axis=0)
    distance = np.hypot(*steps.T)
    turns = np.angle(np.exp(1j * np.diff(np.arctan2(steps[:, 1], steps[:, 0]), prepend=0.0)))
    stops = np.where(rng.random(count) < 0.3, rng.uniform(2.0, 20.0, count), 0.1)
    lasts = np.stack([stops, np.abs(turns) / 0.8, distance / speed], axis=1).ravel()
    moves = np.zeros((count, 3, 3))
    moves[:, 1, 0], moves[:, 2, 1:] = turns, steps
    yaw, north, east = keyed(seconds, lasts, moves.reshape(-1, 3)).T
    return yaw, north, east


def robot(diary: Diary) -> None:
    """Day of a robot, level, indoors: an hour of driving in one of four rooms, then charging; off at night."""
    rng = diary.rng
    rooms, dock = [Rooms.random(rng) for _ in range(4)], rng.standard_normal(3) * rng.uniform(2.0, 10.0)
    seconds = diary.times(FIRST_S, 10.0)
    spin = np.abs((seconds / 30.0) % 6.0 - 3.0) * 2.0 * np.pi
    shaken = np.radians(0.4) * course(rng, seconds, 1.0, 10.0)
    diary.put(seconds, shaken + spin[:, None] * [1.0, 0.0, 0.0], place=rooms[0].at(np.zeros(1), np.zeros(1)))
    while diary.now < diary.end_s:
        for _ in range(rng.integers(2, 5)):
            seconds = diary.times(rng.uniform(600.0, 1500.0), 10.0)
            yaw, north, east = strolled(rng, seconds, 0.4)
            shaken = np.radians(0.4) * course(rng, seconds, 1.0, 10.0)
            shaken[:, 0] += yaw
            speed = np.hypot(np.gradient(north), np.gradient(east)) * 10.0 if len(seconds) > 1 else 0.0
            place = rooms[rng.integers(4)].at(north, east)
            diary.put(seconds, shaken, place=place, load=np.minimum(0.2 + 2.0 * speed, 1.0))
        stands = np.array([rng.uniform(-3.0, 3.0), 0.0, 0.0])
        diary.lie(rng.uniform(1200.0, 2400.0), stands, place=dock, load=0.7)
        if diary.hour > 10.0:
            diary.off((24.0 - diary.hour) * HOUR, stands, dock)


def boat(diary: Diary) -> None:
    """Day of a boat with some degrees of roll and pitch: nine hours of long legs and turns, then a berth near steel.

    Under sail it heels by up to 12° away from the wind.
    """
    rng = diary.rng
    wind = rng.uniform(-3.0, 3.0)
    berth = rng.standard_normal(3) * rng.uniform(1.0, 6.0)
    lasts, turns = FIRST_S, np.radians(720.0)
    yaw = 0.0
    while diary.now < diary.end_s:
        is_first = diary.now == 0.0
        leg = 0.0 if is_first else np.exp(rng.uniform(np.log(60.0), np.log(4800.0)))
        seconds = diary.times(leg + lasts, 10.0)
        sea = course(rng, seconds, 3.0, 9.0) * np.radians([0.4, rng.uniform(0.5, 2.0), rng.uniform(1.0, 4.0)])
        weave = np.radians(3.0) * course(rng, seconds, 20.0, 120.0, columns=1)[:, 0]
        sea[:, 0] += yaw + weave + np.interp(seconds, [leg, leg + lasts], [0.0, turns])
        sails = not is_first and rng.random() < 0.6
        sea[:, 2] += np.radians(rng.uniform(2.0, 12.0) if sails else 0.0) * np.sin(sea[:, 0] - wind)
        diary.put(seconds, sea, load=0.1 if sails else 1.0)
        yaw += turns
        turns = np.radians(rng.choice([-1.0, 1.0]) * (360.0 if rng.random() < 0.15 else rng.uniform(30.0, 170.0)))
        lasts = np.abs(turns) / np.radians(rng.uniform(3.0, 6.0))
        if diary.hour > 9.0:
            moored = np.array([rng.uniform(-3.0, 3.0), 0.0, 0.0])
            diary.lie(rng.uniform(2.0, 6.0) * HOUR, moored, place=berth, load=0.05, sway=np.radians(3.0))
            diary.off((24.0 - diary.hour) * HOUR, moored, berth)


def drone(diary: Diary) -> None:
    """Day of a drone: one to three flights of 4 to 10 min, tilted by up to 25°, with landings between, then off."""
    rng = diary.rng
    diary.put(seconds := diary.times(FIRST_S, 50.0), tumbled(rng, seconds))
    while diary.now < diary.end_s:
        ground, stands = rng.standard_normal(3) * rng.uniform(0.5, 5.0), np.array([rng.uniform(-3.0, 3.0), 0.03, -0.02])
        diary.off(rng.uniform(0.5, 2.5) * HOUR if diary.hour < 9.0 else (24.0 - diary.hour) * HOUR, stands, ground)
        diary.put(seconds := diary.times(30.0, 25.0), course(rng, seconds, 3.0, 20.0) * [1.5, 0.3, 0.3])  # carried
        for _ in range(rng.integers(1, 4)):
            diary.lie(rng.uniform(30.0, 400.0), stands, place=ground, load=0.05)
            seconds = diary.times(rng.uniform(240.0, 600.0), 50.0)
            if len(seconds):
                angles, airborne = flown(rng, seconds, stands[0])
                throttle = 0.5 + 0.15 * course(rng, seconds, 1.0, 20.0, columns=1)[:, 0]
                place = np.exp(-8.0 * airborne)[:, None] * ground  # it climbs to 8 m, and the steel of the ground fades
                diary.put(seconds, angles, place=place, load=airborne * np.clip(throttle, 0.2, 1.0))
                stands = np.array([angles[-1, 0], 0.02, 0.03])
        diary.lie(rng.uniform(30.0, 120.0), stands, place=ground, load=0.05)


def flown(rng: Generator, seconds: Floats, yaw: float) -> tuple[Floats, Floats]:
    """(n, 3) yaw, pitch, roll of a flight, and (n,) relative height, 0 to 1."""
    tilt = np.clip(np.radians(8.0) * course(rng, seconds, 1.5, 15.0, columns=2), -0.44, 0.44)
    count = int(seconds[-1] / 5.0) + 2
    turns = np.where(rng.random(count) < 0.5, rng.uniform(-2.5, 2.5, count), 0.0)
    airborne: Floats = np.clip(np.minimum(seconds, seconds[-1] - seconds) / 4.0, 0.0, 1.0)
    turned: Floats = yaw + keyed(seconds, np.full(count, 5.0), turns[:, None])[:, 0]
    return np.stack([turned, airborne * tilt[:, 0], airborne * tilt[:, 1]], axis=1), airborne


def swung(rng: Generator, seconds: Floats, yaw: Floats) -> Floats:
    """(n, 3) yaw, pitch, roll of an arm that swings at a walk."""
    swing = np.sin(2.0 * np.pi * 0.9 * seconds + rng.uniform(0.0, 6.0))
    loose = 0.15 * course(rng, seconds, 1.0, 20.0)
    angles: Floats = np.stack([yaw + 0.2 * swing, -0.9 + 0.45 * swing, 1.2 + 0.2 * swing], axis=1) + loose
    return angles


def wrist(diary: Diary) -> None:
    """Day of a watch: at a desk, in manual work, walking indoors and outdoors; off at night."""
    rng = diary.rng
    rooms = [Rooms.random(rng) for _ in range(4)]
    diary.put(seconds := diary.times(FIRST_S, 20.0), tumbled(rng, seconds))
    while diary.now < diary.end_s:
        kind, room = rng.random(), rooms[rng.integers(4)]
        at = np.full(1, rng.uniform(0.0, 6.0))
        if kind < 0.45:  # at a desk: now and then it moves
            for _ in range(rng.integers(3, 9)):
                diary.lie(rng.uniform(60.0, 500.0), rng.uniform(-0.5, 0.5, 3), place=room.at(at, at, 0.8))
                seconds = diary.times(rng.uniform(3.0, 15.0), 20.0)
                moved = course(rng, seconds, 1.5, 6.0) * [0.6, 0.4, 0.8]
                diary.put(seconds, moved, place=room.at(at, at, 0.8))
        elif kind < 0.7:
            seconds = diary.times(rng.uniform(200.0, 900.0), 20.0)
            yaw, north, east = strolled(rng, seconds, 0.6)
            angles = tumbled(rng, seconds, 1.5)
            angles[:, 0] = 0.3 * angles[:, 0] + yaw
            diary.put(seconds, angles, place=room.at(north, east, 0.8))
        elif kind < 0.85:
            seconds = diary.times(rng.uniform(100.0, 400.0), 20.0)
            yaw, north, east = strolled(rng, seconds, 1.2)
            diary.put(seconds, swung(rng, seconds, yaw), place=room.at(north, east, 0.8))
        else:  # outdoors
            seconds = diary.times(rng.uniform(400.0, 1500.0), 20.0)
            count = int(len(seconds) and seconds[-1] / 40.0) + 2
            turns = rng.choice([-1.6, 0.0, 1.6], count)[:, None]
            yaw = keyed(seconds, np.full(count, 40.0), turns)[:, 0]
            diary.put(seconds, swung(rng, seconds, yaw))
        if diary.hour > 15.0:
            diary.off((24.0 - diary.hour) * HOUR, np.zeros(3), room.at(at, at, 0.8))


def phone(diary: Diary) -> None:
    """Day of a phone: on a table, in a pocket, in a car, on a magnet; turned by hand now and then; always on."""
    rng = diary.rng
    rooms = [Rooms.random(rng) for _ in range(4)]
    car = rng.standard_normal(3) * rng.uniform(3.0, 12.0)
    diary.put(seconds := diary.times(FIRST_S, 20.0), tumbled(rng, seconds))
    while diary.now < diary.end_s:
        kind, room = rng.random(), rooms[rng.integers(4)]
        there = room.at(np.full(1, rng.uniform(0.0, 6.0)), np.full(1, rng.uniform(0.0, 6.0)), 0.8)
        lies = np.array([rng.uniform(-3.0, 3.0), *rng.uniform(-0.05, 0.05, 2)])
        asleep = diary.hour > 15.0
        diary.lie((24.0 - diary.hour) * HOUR if asleep else rng.exponential(900.0), lies, place=there)
        if kind < 0.75:
            seconds = diary.times(rng.uniform(15.0, 90.0), 20.0)
            held = lies + course(rng, seconds, 2.0, 15.0) * [0.8, 0.5, 0.5]
            diary.put(seconds, held, place=there, load=0.6)
        elif kind < 0.88:
            seconds = diary.times(rng.uniform(200.0, 900.0), 20.0)
            yaw, north, east = strolled(rng, seconds, 1.2)
            step = np.sin(2.0 * np.pi * 0.9 * seconds)
            pocket = np.stack([yaw, 1.2 + 0.3 * step, 0.1 * step], axis=1) + 0.05 * course(rng, seconds, 1.0, 9.0)
            diary.put(seconds, pocket, place=room.at(north, east, 0.8) if rng.random() < 0.5 else None, load=0.1)
        elif kind < 0.94:
            seconds = diary.times(rng.uniform(600.0, 1800.0), 10.0)
            count = int(len(seconds) and seconds[-1] / 30.0) + 2
            yaw = keyed(seconds, np.full(count, 30.0), rng.choice([-1.6, 0.0, 0.0, 1.6], count)[:, None])[:, 0]
            mounted = np.stack([yaw, np.full_like(yaw, 0.9), np.zeros_like(yaw)], axis=1)
            shaken = mounted + 0.02 * course(rng, seconds, 0.5, 9.0)
            diary.put(seconds, shaken, near=car if "rooms" in diary.kinds else None, load=0.4)
        else:
            magnet = rng.standard_normal(3) * rng.uniform(15.0, 150.0)
            diary.lie(rng.uniform(60.0, 1800.0), lies, place=there, near=magnet if "steel" in diary.kinds else None)


@dataclass(frozen=True, slots=True)
class Body:
    """A body with the rates of its events."""

    day: Callable[[Diary], None]
    is_level: bool
    iron: float  #: share of the soft iron of `benchmarks.adversary`, which is ± 25 %
    current_ut: float  #: largest field of the current, at full load
    steel_per_hour: float
    steps_per_day: float
    swapped: float  #: probability of a step in a gap: another battery

    def spells(self, rng: Generator, days: float, kinds: Collection[str]) -> list[Spell]:
        """Spells of `days` days in the life of this body."""
        diary = Diary(rng, days * DAY, kinds)
        self.day(diary)
        return diary.spells


BODIES: Final[dict[str, Body]] = {
    "robot": Body(robot, True, 0.4, 2.0, 2.0, 1.0, 0.3),
    "boat": Body(boat, True, 0.2, 1.5, 0.5, 0.7, 0.2),
    "drone": Body(drone, False, 0.3, 5.0, 2.0, 0.3, 0.3),
    "wrist": Body(wrist, False, 0.3, 0.0, 3.0, 1.0, 0.2),
    "phone": Body(phone, False, 0.4, 1.0, 1.0, 1.5, 0.0),
}
