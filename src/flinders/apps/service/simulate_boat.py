"""Simulated compass of a boat over some days with disturbances, to test an online calibration.

Each day a small yacht lies at a berth, is at sea in the morning and in the afternoon, rests in between, and is off for
the night. At sea it makes long legs with turns between them, rolls and pitches in waves, and heels away from the wind.
It begins with two circles in rough water. Steel passes now and then, and once iron near the compass is moved for good.

>>> life = boat(seed=1, days=2.0)
>>> [event.kind for event in life.events if event.kind != "steel"]
['circles', 'off', 'moved', 'off']
>>> float(np.linalg.norm(life.simulated.shift[0])) > 4.5
True
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.simulate import Sensor, Simulated, attitudes_of, north_and_down

if TYPE_CHECKING:
    from numpy.random import Generator

    from flinders.arrays import Floats

DAY_S, HOUR_S = 86400.0, 3600.0
BEGINS_S: Final = 1_780_272_000.0
"""Monday, 1 June 2026, 00:00 UTC."""
MAX_DAYS: Final = 100.0
RATE_HZ, REST_HZ = 2.0, 0.2
"""Readings a second at sea, and at a berth."""
ON_H, OFF_H = 8.0, 19.0
"""Hours of the day at which the instruments are switched on and off."""
OUTINGS_H: Final = ((8.5, 12.0), (14.0, 17.0))
"""Hours of the day at sea, ± half an hour."""
CIRCLES_S: Final = 240.0
"""Duration of two slow circles."""
MOVE_UT: Final = 5.0
MOVE_SHARE: Final = 4.0 / 7.0
"""Share of the readings that come before iron is moved."""
STEEL_PER_DAY: Final = 1.5
ROLL_DEG: Final = (4.0, 8.0)
"""Rolling in waves, root mean square: in calm and in rough water."""
HEEL_DEG: Final = (2.0, 12.0)
"""Range of the heel under sail, on a course across the wind."""
BERTH_UT: Final = 2.0
"""Disturbance of the field at a berth, 1 σ along each axis."""
WALK_UT: Final = 0.05
"""Random walk of the offset of an axis in an hour, 1 σ."""
NOISE_UT: Final = 0.3

Kind = Literal["circles", "steel", "moved", "off"]


@dataclass(frozen=True, slots=True)
class BoatEvent:
    """An event in the simulated days of a boat."""

    kind: Kind  # two circles, passing steel, iron moved for good, or instruments switched off
    begin_s: float  # start of the event, s from 1970
    end_s: float  # end of the event, s from 1970
    size_ut: float  # µT: the largest change of the field at the compass; 0 without one


@dataclass(frozen=True, slots=True, eq=False)
class BoatLife:
    """Simulated readings of a boat over some days, and the truth."""

    #: readings, with the sensor at the end of the simulation; `shift` is the offset of each less that at the end
    simulated: Simulated
    events: tuple[BoatEvent, ...]  #: in the order of time

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        shift = self.simulated.shift
        assert shift is not None
        return {
            "readings": len(shift),  # number
            "begin_offset_ut": (self.simulated.sensor.offset + shift[0]).tolist(),  # (3,) µT: of the first reading
            "end_offset_ut": self.simulated.sensor.offset.tolist(),  # (3,) µT: of the last one
            "events": [asdict(event) for event in self.events],  # in the order of time
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Spell:
    """A period with one activity of the boat."""

    time: Floats  # (n,) s
    angles: Floats  # (n, 3) rad: heading, pitch, roll
    is_at_sea: bool


def boat(
    seed: int = 1,
    *,
    days: float = 7.0,
    field_strength: float = 50.0,
    dip_deg: float = 60.0,
    noise: float = NOISE_UT,
) -> BoatLife:
    """Simulate a boat for some days.

    Raises `UsageError` for a number out of its range.

    Parameters
    ----------
    seed : int
        The same seed gives the same days.
    days : float
        Duration from midnight on; the last day may be incomplete.
    field_strength, dip_deg : float, µT and degrees
    noise : float, µT
        White, 1 σ of each axis.
    """
    if not ON_H / 24.0 < days <= MAX_DAYS:
        raise UsageError(f"days is {days:g}: need more than {ON_H / 24.0:.2g}, and at most {MAX_DAYS:g}")
    of_sensor, of_course, of_offset, of_steel, of_noise = np.random.default_rng(seed).spawn(5)
    spells = _spells(of_course, days * DAY_S)
    time, angles = (np.concatenate([getattr(spell, name) for spell in spells]) for name in ("time", "angles"))
    is_at_sea = np.concatenate([np.full(len(spell.time), spell.is_at_sea) for spell in spells])
    shift, moved = _shift(of_offset, time, is_at_sea)
    steel, passed = _steel(of_steel, time, is_at_sea)
    berth = BERTH_UT * of_steel.standard_normal(3) * ~is_at_sea[:, np.newaxis]
    earth, attitudes = field_strength * north_and_down(dip_deg), attitudes_of(*angles.T)
    sensor = replace(Sensor.random(of_sensor, soft=0.05, hard=30.0), noise=noise)
    raw = sensor.read(np.einsum("nji,nj->ni", attitudes, earth + berth + steel), of_noise, shift=shift)
    simulated = Simulated(
        Samples.of(raw, unit="uT", time=BEGINS_S + time, source="simulated boat"),
        sensor,
        np.einsum("nji,j->ni", attitudes, earth / field_strength),
        field_strength,
        np.linalg.norm(steel, axis=1) > 1.0,
        dip_deg=dip_deg,
        motion="boat",
        seed=seed,
        shift=shift,
        disturbances=("walk", "moved", "steel", "berth"),
    )
    first = BEGINS_S + float(next(spell for spell in spells if spell.is_at_sea).time[0])
    circles = BoatEvent("circles", first, first + CIRCLES_S, 0.0)
    events = [circles, moved, *passed, *_nights(days)]
    return BoatLife(simulated, tuple(sorted(events, key=lambda event: event.begin_s)))


def _nights(days: float) -> list[BoatEvent]:
    """Periods in which the instruments are off, until the next morning or the end."""
    off = [(day + OFF_H / 24.0, min(day + 1.0 + ON_H / 24.0, days)) for day in range(math.ceil(days))]
    return [
        BoatEvent("off", BEGINS_S + begin * DAY_S, BEGINS_S + end * DAY_S, 0.0) for begin, end in off if begin < days
    ]


def _spells(rng: Generator, until_s: float) -> list[_Spell]:
    """List the activities of the boat up to a time, one after the other."""
    wind, heading = rng.uniform(-math.pi, math.pi, 2).tolist()
    spells: list[_Spell] = []
    for day in range(math.ceil(until_s / DAY_S)):
        wind += rng.normal(0.0, 0.8)
        rests_s = day * DAY_S + ON_H * HOUR_S
        for first, last in OUTINGS_H:
            goes_s, comes_s = (day * DAY_S + HOUR_S * (hour + rng.uniform(-0.5, 0.5)) for hour in (first, last))
            spells.append(_rest_at_berth(rng, rests_s, goes_s, heading))
            spells.append(_sail(rng, goes_s, comes_s, heading, wind, has_circles=len(spells) == 1))
            heading, rests_s = float(spells[-1].angles[-1, 0]), comes_s
        spells.append(_rest_at_berth(rng, rests_s, day * DAY_S + OFF_H * HOUR_S, heading))
    counts = [int(np.searchsorted(spell.time, until_s)) for spell in spells]
    return [
        _Spell(spell.time[:count], spell.angles[:count], spell.is_at_sea)
        for spell, count in zip(spells, counts, strict=True)
        if count
    ]


def _rest_at_berth(rng: Generator, begins_s: float, ends_s: float, heading: float) -> _Spell:
    """Motion of the boat at a berth: it sways on its lines."""
    time = np.arange(begins_s, ends_s, 1.0 / REST_HZ)
    angles = np.radians([3.0, 0.3, 0.6]) * _waves(rng, time, 30.0, 600.0) + [heading, 0.0, 0.0]
    return _Spell(time, angles, is_at_sea=False)


def _sail(rng: Generator, begins_s: float, ends_s: float, heading: float, wind: float, *, has_circles: bool) -> _Spell:
    """Legs of 5 to 60 minutes with a turn of 30 to 170° after each; some go all the way round."""
    at, course, heels = [0.0], [heading], [0.0]
    if has_circles:
        at.append(CIRCLES_S)
        course.append(heading + 4.0 * math.pi)
        heels.append(0.0)
    while at[-1] < ends_s - begins_s:
        leg = math.exp(rng.uniform(math.log(300.0), math.log(3600.0)))
        angle = 360.0 if rng.random() < 0.15 else rng.uniform(30.0, 170.0)
        turn = rng.choice([-1.0, 1.0]) * math.radians(angle)
        heel = math.radians(rng.uniform(*HEEL_DEG)) * (rng.random() < 0.5)
        at += [at[-1] + leg, at[-1] + leg + angle / rng.uniform(2.0, 5.0)]
        course += [course[-1], course[-1] + turn]
        heels += [heel, heel]
    time = np.arange(0.0, ends_s - begins_s, 1.0 / RATE_HZ)
    angles = (
        math.radians(ROLL_DEG[1] if has_circles else rng.uniform(*ROLL_DEG))
        * np.array([0.3, 0.5, 1.0])
        * _waves(rng, time, 3.5, 9.0)
    )
    angles[:, 0] += np.interp(time, at, course) + math.radians(2.5) * _waves(rng, time, 20.0, 120.0)[:, 0]
    angles[:, 2] += np.interp(time, at, heels) * np.sin(angles[:, 0] - wind)
    return _Spell(begins_s + time, angles, is_at_sea=True)


def _waves(rng: Generator, time: Floats, shortest_s: float, longest_s: float) -> Floats:
    """(n, 3) smooth series of unit variance, with periods between two limits."""
    periods = np.exp(rng.uniform(math.log(shortest_s), math.log(longest_s), (8, 3)))
    phases = rng.uniform(0.0, 2.0 * math.pi, (8, 3))
    total = np.zeros((len(time), 3))
    for period, phase in zip(periods, phases, strict=True):
        total += np.sin(2.0 * math.pi / period * time[:, np.newaxis] + phase)
    return total / 2.0


def _shift(rng: Generator, time: Floats, is_at_sea: Floats) -> tuple[Floats, BoatEvent]:
    """(n, 3) offset at each reading less that at the end, µT, and the event in which it moved."""
    hours = np.arange(math.floor(time[0] / HOUR_S), math.ceil(time[-1] / HOUR_S) + 1.0)
    walk = np.cumsum(WALK_UT * rng.standard_normal((len(hours), 3)), axis=0)
    offset = np.stack([np.interp(time / HOUR_S, hours, axis) for axis in walk.T], axis=1)
    turn, sink = rng.uniform(-math.pi, math.pi), rng.uniform(-0.5, 0.5)
    level = math.sqrt(1.0 - sink**2)
    after = np.flatnonzero(is_at_sea)
    moved_s = float(time[after[round(MOVE_SHARE * len(after))]])
    offset[time >= moved_s] += MOVE_UT * np.array([level * math.cos(turn), level * math.sin(turn), sink])
    return offset - offset[-1], BoatEvent("moved", BEGINS_S + moved_s, BEGINS_S + moved_s, MOVE_UT)


def _steel(rng: Generator, time: Floats, is_at_sea: Floats) -> tuple[Floats, list[BoatEvent]]:
    """(n, 3) field of passing steel, µT north, east, down: a dipole on a straight line, for 10 to 60 s."""
    field, events = np.zeros((len(time), 3)), list[BoatEvent]()
    rows = np.flatnonzero(is_at_sea)
    count = math.ceil(STEEL_PER_DAY * len(rows) / (6.5 * HOUR_S * RATE_HZ))
    for row in np.sort(rng.choice(rows, count, replace=False)):
        lasts, peak, way = rng.uniform(10.0, 60.0), rng.uniform(6.0, 25.0), rng.standard_normal(3)
        near = slice(*np.searchsorted(time, [time[row] - lasts / 2.0, time[row] + lasts / 2.0]))
        swell = (1.0 + (6.0 * (time[near] - time[row]) / lasts) ** 2) ** -1.5 - 10.0**-1.5
        field[near] += peak * swell[:, np.newaxis] * way / np.linalg.norm(way)
        begin = BEGINS_S + float(time[row]) - lasts / 2.0
        events.append(BoatEvent("steel", begin, begin + lasts, peak))
    return field, events
