"""Simulated lives of a magnetometer: readings over days of use, with the true soft iron and offset at each moment.

A life has the schedule of one of `benchmarks.service_bodies`, a sensor as in `benchmarks.adversary`, and events, each
kind of which can be left out:

walk          random walk of the offset of each axis, 0.02 to 0.5 µT/√h by unit
temperature   days and hours of ± 8 K, with an offset of up to 0.2 µT/K
steps         the offset moves by 0.5 to 20 µT at random moments: a battery exchanged, a part moved
magnetised    a magnet passes in 4 s and leaves 2 to 20 µT, half of which fades in hours
steel         steel passes for 2 to 30 s with a peak of 3 to 60 µT; a phone lies on a magnet for minutes
rooms         the field varies with the place by 5 to 20 % indoors; steel near a dock, a berth, the ground, in a car
currents      the body's own current makes a field along one wire, in proportion to its load
gaps          switched off, for minutes to a night
clock         stamps repeat, jump back by a second, or jump ahead by seconds or minutes

Readings are ``iron @ field + offset`` with white noise of 0.2 to 0.5 µT and slow noise of 0.05 to 0.2 µT, whose periods
are 5 s to 5 min. The true offset includes walk, temperature, steps and remaining magnetisation; passing steel, fields
of places and of currents are disturbances. The field outdoors is 50 µT with a dip of 60°. The code is independent of
`flinders.simulate`.

>>> life = live("drone", 1, days=0.02, kinds=())
>>> corrected = (life.field - life.offset_at(life.seconds)) @ np.linalg.inv(life.iron)
>>> bool(abs(np.linalg.norm(corrected, axis=1) - STRENGTH_UT).mean() < 1.0)
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.adversary import sensor, stream
from benchmarks.service_bodies import BODIES, DAY, FIRST_S, HOUR, course, down_of, rates_of, seen

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from numpy.random import Generator

    from benchmarks.service_bodies import Body, Spell
    from flinders.arrays import Floats

KINDS: Final = ("walk", "temperature", "steps", "magnetised", "steel", "rooms", "currents", "gaps", "clock")

STRENGTH_UT, DIP_DEG = 50.0, 60.0
NORTH_DOWN: Final = STRENGTH_UT * np.array([np.cos(np.radians(DIP_DEG)), 0.0, np.sin(np.radians(DIP_DEG))])

START_S: Final = 1.75e9
"""Stamp of the first reading: seconds since 1970."""
GRID_S: Final = 10.0
"""Time between two nodes of the walk and the temperature."""
FADE_S: Final = 3.0 * HOUR
"""Time constant of a fading magnetisation."""
MAX_CHUNK: Final = 200
"""Largest number of readings in a chunk."""
GYRO_NOISE, GYRO_BIAS = 0.005, 0.002
"""White noise of an angular rate, and 1 σ of its bias, rad/s."""
TURNING_RAD_S: Final = 0.04
"""Smallest yaw rate of a turning level body, rad/s; for other bodies four times this rate about any axis."""


@dataclass(frozen=True, slots=True)
class Event:
    """Event with begin and end in seconds of life; `size` in µT, or in seconds for a gap or a clock."""

    begin: float
    end: float
    kind: str
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Readings of one batch of a driver."""

    time: Floats  #: (n,) s, stamps
    field: Floats  #: (n, 3) µT
    rate: Floats  #: (n, 3) rad/s, body axes, with noise and a bias
    down: Floats  #: (n, 3) unit vectors of gravity in body axes, as from an accelerometer


@dataclass(frozen=True, slots=True, eq=False)
class Offsets:
    """The offset over a life, sensor axes, µT."""

    grid: Floats  #: (m,) s
    slow: Floats  #: (m, 3): hard iron, walk and temperature at the nodes
    at_s: Floats  #: (k,) s: moments of steps
    moves: Floats  #: (k, 3): change by each step
    fading: Floats  #: (k,): share of each that fades

    def at(self, seconds: Floats) -> Floats:
        """(n, 3) offsets at (n,) moments."""
        since = np.asarray(seconds, float)[:, None] - self.at_s
        left = np.where(since >= 0.0, 1.0 - self.fading * (1.0 - np.exp(-np.maximum(since, 0.0) / FADE_S)), 0.0)
        slow = np.stack([np.interp(seconds, self.grid, axis) for axis in self.slow.T], axis=1)
        offsets: Floats = slow + left @ self.moves
        return offsets


@dataclass(frozen=True, slots=True, eq=False)
class Life:
    """Readings of one life and its truth; arrays are by reading, `seconds` counts from the first one."""

    body: str
    seed: int
    seconds: Floats  #: (n,) s, true
    time: Floats  #: (n,) s, stamps
    field: Floats  #: (n, 3) µT
    rate: Floats  #: (n, 3) rad/s
    down: Floats  #: (n, 3)
    turning: Floats  #: (n,) s of turning so far
    iron: Floats  #: (3, 3)
    offsets: Offsets
    events: tuple[Event, ...]  #: in the order of their beginning
    end_s: float  #: length of the life, which may end in a gap

    def offset_at(self, seconds: Floats) -> Floats:
        """(n, 3) true offsets at (n,) moments, also without readings."""
        return self.offsets.at(seconds)

    def clock_at(self, seconds: Floats) -> Floats:
        """(n,) times of the clock at (n,) moments."""
        shifts = [np.where(seconds >= jump.begin, jump.size, 0.0) for jump in self.of_kind("jump")]
        return START_S + np.asarray(seconds, float) + sum(shifts)

    def of_kind(self, *kinds: str) -> tuple[Event, ...]:
        """Events of some kinds."""
        return tuple(event for event in self.events if event.kind in kinds)

    def chunks(self, stops: Floats) -> Iterator[tuple[int, Chunk | None]]:
        """Yield chunks of readings in order and, between them, None at each of the ascending times `stops`.

        With each of them comes the index of the next stop.
        """
        cuts = np.searchsorted(self.seconds, stops, side="right").tolist()
        begin = 0
        for number, cut in enumerate([*cuts, len(self.seconds)]):
            for first in range(begin, cut, MAX_CHUNK):
                rows = slice(first, min(first + MAX_CHUNK, cut))
                yield number, Chunk(self.time[rows], self.field[rows], self.rate[rows], self.down[rows])
            begin = cut
            if number < len(cuts):
                yield number, None


def live(name: str, seed: int, *, days: float = 1.0, kinds: Collection[str] = KINDS) -> Life:
    """Life of a body, determined by the seed; leaving out a kind of event does not change the others."""
    body = BODIES[name]
    spells = body.spells(stream(seed, name), days, kinds)
    seconds, angles, place, load, near = (
        np.concatenate([getattr(spell, of) for spell in spells])
        for of in ("seconds", "angles", "place", "load", "near")
    )
    events = [*gaps_of(spells, days * DAY), *magnets_of(spells)]
    if "steel" in kinds:
        events += steel(stream(seed, f"steel of {name}"), body, seconds, place)
    offsets, steps = offsets_of(seed, name, days * DAY, kinds, [event for event in events if event.kind == "gap"])
    for step in steps:
        if step.kind == "magnetised":
            rng = stream(seed, f"magnet {step.begin} of {name}")
            events.append(passing(rng, seconds, place, step.begin, 4.0, rng.uniform(50.0, 300.0)))
    of = sensor(stream(seed, f"sensor of {name}"))
    iron = np.eye(3) + body.iron * (of.iron - np.eye(3))
    rng = stream(seed, f"noise of {name}")
    field = seen(angles, NORTH_DOWN + place) @ iron + offsets.at(seconds) + near
    if "currents" in kinds:
        wire = rng.standard_normal(3)
        field += body.current_ut * rng.uniform(0.3, 1.0) * load[:, None] * wire / np.linalg.norm(wire)
    field += rng.uniform(0.2, 0.5) * rng.standard_normal(field.shape)
    field += rng.uniform(0.05, 0.2) * course(rng, seconds, 5.0, 300.0)
    rate = np.concatenate([rates_of(spell.seconds, spell.angles) for spell in spells])
    turns = np.abs(rate[:, 2]) > TURNING_RAD_S if body.is_level else np.linalg.norm(rate, axis=1) > 4 * TURNING_RAD_S
    turning = np.cumsum(np.where(turns, np.minimum(np.diff(seconds, prepend=seconds[0]), 1.0), 0.0))
    rate = rate + GYRO_BIAS * rng.standard_normal(3) + GYRO_NOISE * rng.standard_normal(rate.shape)
    down = down_of(angles) + 0.02 * rng.standard_normal(rate.shape)
    time, faults = stamped(stream(seed, f"clock of {name}"), seconds) if "clock" in kinds else (START_S + seconds, [])
    every = tuple(sorted([*events, *steps, *faults], key=lambda event: event.begin))
    return Life(name, seed, seconds, time, field, rate, down, turning, iron, offsets, every, days * DAY)


def gaps_of(spells: list[Spell], end_s: float) -> list[Event]:
    """Pauses of a minute and more between readings, and after the last."""
    begins = [float(spell.seconds[0]) for spell in spells[1:]]
    edges = zip([float(spell.seconds[-1]) for spell in spells], [*begins, end_s], strict=True)
    return [Event(begin, end, "gap", end - begin) for begin, end in edges if end - begin > 60.0]


def magnets_of(spells: list[Spell]) -> list[Event]:
    """Events of the spells in which a phone lies on a magnet."""
    sizes = [(spell, float(np.linalg.norm(spell.near, axis=1).max())) for spell in spells]
    return [
        Event(float(spell.seconds[0]), float(spell.seconds[-1]), "steel", size) for spell, size in sizes if size > 0.0
    ]


def steel(rng: Generator, body: Body, seconds: Floats, place: Floats) -> list[Event]:
    """Add the fields of passing steel to the local fields `place`, world axes; return the events."""
    hours = float(np.minimum(np.diff(seconds), 1.0).sum()) / HOUR
    events = []
    for _ in range(rng.poisson(body.steel_per_hour * hours)):
        middle, lasts = float(seconds[rng.integers(len(seconds))]), rng.uniform(2.0, 30.0)
        passed = passing(rng, seconds, place, middle, lasts, float(np.exp(rng.uniform(np.log(3.0), np.log(60.0)))))
        events += [passed] if passed.begin > FIRST_S else []
    return events


def passing(rng: Generator, seconds: Floats, place: Floats, middle: float, lasts: float, peak: float) -> Event:
    """Add the field of a dipole that passes on a straight line; without a field during the calibration turn."""
    event, direction = Event(middle - lasts / 2.0, middle + lasts / 2.0, "steel", peak), unit(rng)
    if event.begin > FIRST_S:
        rows = slice(*np.searchsorted(seconds, [event.begin, event.end]))
        profile = (1.0 + (6.0 * (seconds[rows] - middle) / lasts) ** 2) ** -1.5 - 10.0**-1.5
        place[rows] += peak * profile[:, None] * direction
    return event


def offsets_of(
    seed: int, name: str, end_s: float, kinds: Collection[str], gaps: list[Event]
) -> tuple[Offsets, list[Event]]:
    """The offset over a life, and its steps."""
    body, grid = BODIES[name], np.arange(0.0, end_s + 2.0 * GRID_S, GRID_S)
    slow = np.tile(sensor(stream(seed, f"sensor of {name}")).offset, (len(grid), 1))
    if "walk" in kinds:
        rng = stream(seed, f"walk of {name}")
        sigma = np.exp(rng.uniform(np.log(0.02), np.log(0.5), 3))
        slow += np.cumsum(sigma * np.sqrt(GRID_S / HOUR) * rng.standard_normal(slow.shape), axis=0)
    if "temperature" in kinds:
        rng = stream(seed, f"temperature of {name}")
        day = np.sin(2.0 * np.pi * (grid / (DAY) + rng.random()))
        kelvin = 6.0 * day + 2.0 * course(rng, grid, HOUR, 6.0 * HOUR, columns=1)[:, 0]
        slow += kelvin[:, None] * rng.uniform(0.02, 0.2) * unit(rng)
    steps: list[Event] = []
    moves, fading = [], []
    rng = stream(seed, f"steps of {name}")
    swapped = [gap.begin + 0.5 * gap.size for gap in gaps if rng.random() < body.swapped]
    moments = [
        *rng.uniform(FIRST_S, end_s, rng.poisson(body.steps_per_day * end_s / (DAY))),
        *swapped,
    ]
    for moment in moments if "steps" in kinds else ():
        steps.append(Event(float(moment), float(moment), "step", float(np.exp(rng.uniform(np.log(0.5), np.log(20.0))))))
        moves.append(steps[-1].size * unit(rng))
        fading.append(0.0)
    rng = stream(seed, f"magnetised of {name}")
    for moment in rng.uniform(FIRST_S, end_s, rng.poisson(0.5 * end_s / (DAY))):
        if "magnetised" in kinds:
            size = float(np.exp(rng.uniform(np.log(2.0), np.log(20.0))))
            steps.append(Event(float(moment), float(moment), "magnetised", size))
            moves.append(size * unit(rng))
            fading.append(0.5)
    at_s = np.array([step.begin for step in steps])
    return Offsets(grid, slow, at_s, np.reshape(moves, (-1, 3)), np.array(fading)), steps


def unit(rng: Generator) -> Floats:
    """(3,) random unit vector."""
    direction = rng.standard_normal(3)
    scaled: Floats = direction / np.linalg.norm(direction)
    return scaled


def stamped(rng: Generator, seconds: Floats) -> tuple[Floats, list[Event]]:
    """(n,) time stamps of a clock with faults, and the events of these faults."""
    per_day = max(1.0, 3.0 * seconds[-1] / (DAY))
    back = [-1.0] * rng.poisson(per_day)
    ahead = np.exp(rng.uniform(np.log(2.0), np.log(600.0), rng.poisson(per_day / 2.0)))
    time = START_S + seconds
    events = []
    for size in [*back, *ahead]:
        begin = float(seconds[rng.integers(1, len(seconds))])
        time = time + np.where(seconds >= begin, size, 0.0)
        events.append(Event(begin, begin, "jump", float(size)))
    for row in np.sort(rng.integers(1, len(seconds), rng.poisson(10.0 * per_day))):
        time[row] = time[row - 1]
        events.append(Event(float(seconds[row]), float(seconds[row]), "repeat", 0.0))
    return time, events
