"""Simulated fleet: good units, and a few per cent of faulty ones, each labelled with its fault.

A unit depends on its number and the seed alone, so that any of a million units can be made again without the others.

>>> found = unit(7, seed=1)
>>> again = next(fleet(1, seed=1, first=7))
>>> found.name, found.fault, bool(np.all(found.samples.field == again.samples.field))
('0000007', '', True)

A fault can be selected by name, with the larger of its two severities or the smaller:

>>> unit(7, seed=1, fault="spikes").amount, unit(7, seed=1, fault="spikes", severity=1).amount
(0.2, 0.05)

A good unit has hard iron up to 60 µT in any direction, soft iron that stretches by up to 15 % along three axes in any
direction, noise of 0.1 to 1 µT, a field of 25 to 65 µT with a dip of 60°, and a resolution of 0.1 µT. It is turned for
10 s at 50 Hz, by a jig or by hand, through nearly all directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.geometry.sphere import uniform_directions
from flinders.simulate._checks import count, share
from flinders.simulate.attitudes import north_and_down, random_attitude, turns
from flinders.simulate.sensor import Sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.random import Generator

    from flinders.arrays import Floats

RATE_HZ: Final = 50.0
READINGS: Final = 500
BAD_SHARE: Final = 0.03
"""Share of units with a fault."""

DRIFTING_SHARE: Final = 0.05
"""Share of the units of a line whose offset moves between two recordings."""
OFFSET_CHANGE_UT: Final = (3.0, 12.0)
"""Range of the change of a moved offset, in µT: some degrees of heading."""

MAX_RECORDINGS: Final = 10
"""Largest number of recordings of a unit: one in each month from March on."""

MAX_HARD_IRON_UT: Final = 60.0
MAX_SOFT_IRON: Final = 0.15
NOISE_UT: Final = (0.1, 1.0)
FIELD_UT: Final = (25.0, 65.0)
STEP_UT: Final = 0.1
DIP_DEG: Final = 60.0
JIG_SHARE: Final = 0.5
"""Share of units that are turned by a jig; the others are turned by hand."""

CLOSEST_M, PAST_M_S, ARM_M = 0.2, 0.1, 0.04
"""Closest distance of a passing magnet in m, its speed in m/s, and distance of the sensor from the pivot in m."""

UNITS: Final = (0.01, 0.1, 10.0, 1000.0)
"""Factors between units that are easily confused: µT, mG, G and nT."""


@dataclass(frozen=True, slots=True, eq=False)
class Specimen:
    """A recording of one unit, and its fault."""

    number: int  #: number of the unit, from 0
    samples: Samples  #: in µT, with time
    sensor: Sensor  #: the true sensor, without the fault
    field_strength: float  #: µT
    fault: str = ""  #: one of `FAULTS`; empty for a good unit
    severity: int = 0  #: 1 for the smaller severity, 2 for the larger; 0 for a good unit
    amount: float = 0.0  #: amount of the fault, in the unit that `FAULTS` states
    #: (3, 3): matrix of a fault of the sensor itself, which multiplies every reading, also in use; else the identity
    lasting: Floats = field(default_factory=lambda: np.eye(3))

    @property
    def name(self) -> str:
        """Number of the unit in seven digits, so that names sort as numbers do."""
        return f"{self.number:07d}"


@dataclass(frozen=True, slots=True, eq=False)
class TurnedSensor:
    """A sensor and its motion, without a fault."""

    sensor: Sensor
    field_strength: float  #: µT
    time: Floats  #: (N,), s
    angles: Floats  #: (3, N), rad: heading, pitch and roll
    noise: Floats  #: (N, 3), µT

    def read(self, *, room: Floats | None = None, shift: Floats | None = None) -> Floats:
        """(N, 3) readings, in µT.

        `room`, (N, 3) north, east, down in µT, is added to the earth's field; `shift`, (N, 3) in µT, to the readings.
        """
        world = self.field_strength * north_and_down(DIP_DEG)[:, np.newaxis]
        body = to_body_axes(world if room is None else world + room.T, self.angles)
        raw = (self.sensor.matrix @ body).T + self.sensor.offset + self.noise
        readings: Floats = np.round((raw if shift is None else raw + shift) / STEP_UT) * STEP_UT
        return readings


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of fault, with its two severities."""

    words: str  #: description of the fault and of its amount
    smaller: float  #: amount of severity 1
    larger: float  #: amount of severity 2
    #: for a fault of one recording: returns (N, 3) faulty readings in µT, from turned sensor, amount and generator
    strike: Callable[[TurnedSensor, float, Generator], Floats] | None = None
    #: for a fault of the sensor: returns the (3, 3) matrix that multiplies every reading, from amount and generator
    lasting: Callable[[float, Generator], Floats] | None = None
    is_detectable: bool = True  #: False if another good sensor would give the same readings

    def amount(self, severity: int) -> float:
        """Amount of the fault: the smaller for severity 1, the larger for 2."""
        return self.larger if severity == 2 else self.smaller


def unit(
    number: int,
    *,
    seed: int = 0,
    bad: float = BAD_SHARE,
    readings: int = READINGS,
    fault: str | None = None,
    severity: int = 2,
) -> Specimen:
    """Make one unit of a fleet.

    Raises `UsageError` for a fault or severity that does not exist, or numbers out of range.

    Parameters
    ----------
    number : int
        Number of the unit, from 0; with the seed of the fleet it determines the unit.
    bad : float
        Share of units with a fault; fault and severity are drawn uniformly.
    fault : str, optional
        One of `FAULTS`, or the empty text for a good unit, instead of a drawn fault; sensor and motion stay the same.
    severity : int
        Severity of that fault: 1 or 2.

    Examples
    --------
    >>> good, flipped = (unit(3, fault=fault) for fault in ("", "flipped-throughout"))
    >>> moved = np.abs(np.abs(good.samples.field) - np.abs(flipped.samples.field)).max(axis=0)
    >>> bool(moved.max() == 0.0)
    True
    """
    if number < 0 or seed < 0:
        raise UsageError(f"unit {number} of seed {seed}: need numbers from 0 on")
    rng = np.random.default_rng([seed, number])
    drawn, which, how = rng.random(3)
    if fault is None:
        fault = list(FAULTS)[int(which * len(FAULTS))] if drawn < share(bad, "bad", "the units") else ""
        severity = 1 + int(how * 2.0)
    if fault not in {"", *FAULTS} or severity not in {1, 2}:
        raise UsageError(f"fault {fault!r} of severity {severity} is not known: use 1 or 2 of {', '.join(FAULTS)}")
    turned = _draw_turn(rng, count(readings, 12))
    if not fault:
        return _specimen(number, turned, turned.read())
    kind = FAULTS[fault]
    amount = kind.amount(severity)
    readings_ut = turned.read() if kind.strike is None else kind.strike(turned, amount, rng)
    lasting = np.eye(3) if kind.lasting is None else kind.lasting(amount, rng)
    made = _specimen(number, turned, readings_ut @ lasting.T)
    return replace(made, fault=fault, severity=severity, amount=amount, lasting=lasting)


def _specimen(number: int, turned: TurnedSensor, readings: Floats) -> Specimen:
    """Recording of a unit, not yet labelled with a fault."""
    samples = Samples.of(readings, unit="uT", time=turned.time, source=f"unit {number:07d}")
    return Specimen(number, samples, turned.sensor, turned.field_strength)


def fleet(
    n: int, seed: int = 0, bad: float = BAD_SHARE, *, readings: int = READINGS, first: int = 0
) -> Iterator[Specimen]:  # fmt: skip
    """Yield `n` units, numbered from `first` on; other parameters and errors as for `unit`.

    >>> sorted({unit.fault for unit in fleet(200, seed=3, readings=20) if unit.fault})[:2]
    ['flipped-throughout', 'level-turn']
    """
    return (unit(number, seed=seed, bad=bad, readings=readings) for number in range(first, first + n))


@dataclass(frozen=True, slots=True)
class LineTruth:
    """Truth of one recording of a simulated line."""

    unit: str  # name of the unit
    recording: str  # name of its file
    fault: str  # one of those in docs/fleet/faults.md; empty for a good unit
    amount: float  # amount of the fault
    offset_change: float  # length of the change of the offset since the first recording of the unit, µT
    offset: tuple[float, ...]  # 3 float: offset of the sensor without the fault, µT
    matrix: tuple[float, ...]  # 9 float: matrix of the sensor without the fault, row by row
    field_strength: float  # field strength of the earth at the site, µT


def line_of(
    units: int,
    *,
    seed: int = 1,
    bad: float = BAD_SHARE,
    drifting: float = DRIFTING_SHARE,
    recordings: int = 2,
    readings: int = READINGS,
) -> Iterator[tuple[LineTruth, Samples]]:
    """Yield truth and readings of each recording of a simulated line, month by month from March 2026 on.

    Parameters
    ----------
    units : int
        Number of units.
    bad : float
        Share of units that have a fault at their first recording; a fault of the sensor itself lasts.
    drifting : float
        Share of units whose offset moves after the first recording.
    recordings : int
        Number of recordings of each unit, up to `MAX_RECORDINGS`.

    >>> truths = [truth for truth, _ in line_of(40, drifting=0.2, readings=50)]
    >>> len(truths), truths[1].unit, truths[1].recording, sum(truth.offset_change > 0.0 for truth in truths)
    (80, 'U0000', '2026-04-01.csv', 8)
    """
    share(drifting, "drifting", "the units")
    if not 1 <= recordings <= MAX_RECORDINGS:
        raise UsageError(f"recordings is {recordings}: need 1 to {MAX_RECORDINGS} of each unit, a month apart")
    for number in range(count(units, 1)):
        first = unit(number, seed=seed, bad=bad, readings=readings)
        rng = np.random.default_rng([seed, number, 1])
        amount = rng.uniform(*OFFSET_CHANGE_UT) if rng.random() < drifting else 0.0
        moved = amount * uniform_directions(rng, 1)[0]
        for visit in range(recordings):
            shift = moved if visit else np.zeros(3)
            samples = first.samples if not visit else _record_again(first, shift, rng, readings)
            yield (
                LineTruth(
                    unit=f"U{number:04d}",
                    recording=f"2026-{3 + visit:02d}-01.csv",
                    fault="" if visit and np.array_equal(first.lasting, np.eye(3)) else first.fault,
                    amount=first.amount,
                    offset_change=float(np.linalg.norm(shift)),
                    offset=tuple((first.sensor.offset + shift).tolist()),
                    matrix=tuple(first.sensor.matrix.ravel().tolist()),
                    field_strength=first.field_strength,
                ),
                samples,
            )


def _record_again(first: Specimen, shift: Floats, rng: Generator, readings: int) -> Samples:
    """Another recording of a unit whose offset has moved, with another motion."""
    sensor = replace(first.sensor, offset=first.sensor.offset + shift)
    noise = sensor.noise * rng.standard_normal((readings, 3))
    turned = replace(_draw_turn(rng, readings), sensor=sensor, field_strength=first.field_strength, noise=noise)
    return Samples.of(turned.read() @ first.lasting.T, unit="uT", time=turned.time, source=f"unit {first.name}")


def to_body_axes(world: Floats, angles: Floats) -> Floats:
    """(3, N) vectors in body axes at (3, N) heading, pitch and roll, from (3, 1) or (3, N) north, east, down.

    >>> to_body_axes(np.array([[1.0], [0.0], [0.0]]), np.array([[np.pi / 2], [0.0], [0.0]])).T.round(3) + 0.0
    array([[ 0., -1.,  0.]])
    """
    (sine, sine_pitch, sine_roll), (cosine, cosine_pitch, cosine_roll) = np.sin(angles), np.cos(angles)
    north, east, down = world
    ahead, right = cosine * north + sine * east, cosine * east - sine * north
    below = sine_pitch * ahead + cosine_pitch * down
    return np.stack(
        [
            cosine_pitch * ahead - sine_pitch * down,
            cosine_roll * right + sine_roll * below,
            cosine_roll * below - sine_roll * right,
        ]
    )


def to_earth_axes(body: Floats, angles: Floats) -> Floats:
    """(3, N) north, east, down from (3, 1) or (3, N) vectors in body axes at (3, N) angles: inverts `to_body_axes`.

    >>> quarter = np.array([[np.pi / 2], [0.0], [0.0]])
    >>> to_earth_axes(np.array([[0.0], [-1.0], [0.0]]), quarter).T.round(3) + 0.0
    array([[1., 0., 0.]])
    """
    (sine, sine_pitch, sine_roll), (cosine, cosine_pitch, cosine_roll) = np.sin(angles), np.cos(angles)
    ahead, right, below = body
    across, under = cosine_roll * right - sine_roll * below, sine_roll * right + cosine_roll * below
    level = cosine_pitch * ahead + sine_pitch * under
    return np.stack(
        [
            cosine * level - sine * across,
            sine * level + cosine * across,
            cosine_pitch * under - sine_pitch * ahead,
        ]
    )


def _draw_turn(rng: Generator, n: int) -> TurnedSensor:
    """Draw a sensor and its motion at random."""
    axes = turns(uniform_directions(rng, 1) * rng.uniform(0.0, math.pi))[0]
    matrix = axes @ np.diag(1.0 + rng.uniform(-MAX_SOFT_IRON, MAX_SOFT_IRON, 3)) @ axes.T
    offset = uniform_directions(rng, 1)[0] * rng.uniform(0.0, MAX_HARD_IRON_UT)
    noise = math.exp(rng.uniform(*np.log(NOISE_UT)))
    strength = rng.uniform(*FIELD_UT)
    time = np.arange(n) / RATE_HZ
    angles = (_jig_angles if rng.random() < JIG_SHARE else _hand_angles)(rng, np.linspace(0.0, READINGS / RATE_HZ, n))
    return TurnedSensor(
        Sensor(matrix, offset, noise, STEP_UT), strength, time, angles, noise * rng.standard_normal((n, 3))
    )  # fmt: skip


def _jig_angles(rng: Generator, time: Floats) -> Floats:
    """(3, N) angles of a jig, rad: a fast roll, about one turn a second, and a slow pitch, at constant heading."""
    fast, slow = rng.uniform(0.8, 1.2), rng.uniform(0.07, 0.13)
    start, pitch, heading = rng.uniform(0.0, 2.0 * math.pi, 3)
    roll = start + 2.0 * math.pi * fast * time
    return np.stack([np.full(len(time), heading), pitch + 2.0 * math.pi * slow * time, roll])


def _hand_angles(rng: Generator, time: Floats) -> Floats:
    """(3, N) angles of a turn by hand, rad: heading, pitch and roll with uneven rates."""
    rates = rng.uniform([0.12, 0.25, 0.5], [0.2, 0.4, 0.9])[:, np.newaxis]
    phases = rng.uniform(0.0, 2.0 * math.pi, (2, 3, 1))
    heading, pitch, roll = 2.0 * math.pi * rates * time + phases[0]
    uneven = rng.uniform(0.2, 0.6, (3, 1)) * np.sin(2.0 * math.pi * rng.uniform(0.3, 0.7, (3, 1)) * time + phases[1])
    angles: Floats = np.stack([heading, rng.uniform(1.0, 1.5) * np.sin(pitch), roll]) + uneven
    return angles


def _last_part(n: int, amount: float) -> slice:
    """Slice of the last readings; `amount` is their share of all n."""
    return slice(n - round(amount * n), n)


def _swap_late(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with two axes exchanged in the last part."""
    readings = turned.read()
    first, second, _ = rng.permutation(3)
    part = _last_part(len(readings), amount)
    readings[part, [first, second]] = readings[part, [second, first]]
    return readings


def _flip_late(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with the sign of one axis inverted in the last part."""
    readings = turned.read()
    readings[_last_part(len(readings), amount), rng.integers(3)] *= -1.0
    return readings


def _stick_late(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with one axis constant in the last part."""
    readings = turned.read()
    axis, part = rng.integers(3), _last_part(len(readings), amount)
    readings[part, axis] = readings[part.start, axis]
    return readings


def _saturate(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with one end of an axis clipped."""
    readings = turned.read()
    axis, sign = rng.integers(3), rng.choice([-1.0, 1.0])
    most = np.quantile(sign * readings[:, axis], 1.0 - amount, method="lower")
    readings[:, axis] = sign * np.minimum(sign * readings[:, axis], most)
    return readings


def _jump(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with a sudden change of the offset."""
    share_before, direction = rng.uniform(0.2, 0.8), uniform_directions(rng, 1)
    after = np.arange(len(turned.time)) >= share_before * len(turned.time)
    return turned.read(shift=amount * after[:, np.newaxis] * direction)


def _pass_magnet(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings while a magnet is carried past in a straight line."""
    across, along, _ = random_attitude(rng)
    pole = uniform_directions(rng, 1)[0]
    passed = PAST_M_S * (turned.time - rng.uniform(0.3, 0.7) * turned.time[-1])
    arm = to_earth_axes(ARM_M * uniform_directions(rng, 1).T, turned.angles)
    away = arm - CLOSEST_M * across[:, np.newaxis] - passed * along[:, np.newaxis]
    distance = np.linalg.norm(away, axis=0)
    towards = away / distance
    dipole = 3.0 * (pole @ towards) * towards - pole[:, np.newaxis]
    return turned.read(room=(amount * (CLOSEST_M / distance) ** 3 * dipole).T)


def _turn_level(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings of a turn about the vertical with a small tilt."""
    around = turned.angles[2] + rng.uniform(0.0, 2.0 * math.pi)
    lean = math.radians(amount) * np.sin(turned.angles[:2] * 1.7)
    return replace(turned, angles=np.stack([around, *lean])).read()


def _rest(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings at rest, with a small tilt only."""
    rest = rng.uniform(0.0, 2.0 * math.pi, (3, 1))
    lean = math.radians(amount) * np.sin(turned.angles * 1.7)
    return replace(turned, angles=rest + lean).read()


def _repeat(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings, some of which repeat the previous one."""
    readings = turned.read()
    fresh = rng.random(len(readings)) >= amount
    fresh[0] = True
    return readings[np.maximum.accumulate(np.where(fresh, np.arange(len(readings)), 0))]


def _add_spikes(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with single outliers."""
    readings = turned.read()
    struck = rng.choice(len(readings), round(amount * len(readings)), replace=False)
    lengths = turned.field_strength * rng.uniform(0.5, 3.0, (len(struck), 1))
    readings[struck] += lengths * uniform_directions(rng, len(struck))
    return readings


def _warm_up(turned: TurnedSensor, amount: float, rng: Generator) -> Floats:
    """(N, 3) readings with an offset that drifts while the sensor warms up."""
    progress = np.arange(len(turned.time)) / len(turned.time)
    warmer = np.expm1(-progress / 0.5) / math.expm1(-2.0)
    return turned.read(shift=amount * warmer[:, np.newaxis] * uniform_directions(rng, 1))


def _scale_all(amount: float, rng: Generator) -> Floats:
    """(3, 3) matrix that scales all readings."""
    factor: Floats = np.eye(3) * (amount if amount > 0.0 else rng.choice(UNITS))
    return factor


def _scale_axis(amount: float, rng: Generator) -> Floats:
    """(3, 3) matrix that scales one axis."""
    return np.diag(np.where(np.arange(3) == rng.integers(3), amount, 1.0))


def _swap_axes(amount: float, rng: Generator) -> Floats:  # noqa: ARG001 - this fault has no amount
    """(3, 3) matrix that exchanges two axes."""
    first, second, _ = rng.permutation(3)
    order = np.arange(3)
    order[[first, second]] = second, first
    exchanged: Floats = np.eye(3)[order]
    return exchanged


def _flip_axis(amount: float, rng: Generator) -> Floats:  # noqa: ARG001 - this fault has no amount
    """(3, 3) matrix that inverts one axis."""
    return _scale_axis(-1.0, rng)


FAULTS: Final[Mapping[str, Fault]] = {
    "swapped-axes": Fault("two axes exchanged for the last part of the recording, as a share", 0.1, 0.5, _swap_late),
    "flipped-sign": Fault("one axis with the other sign for the last part, as a share", 0.1, 0.5, _flip_late),
    "stuck-axis": Fault("one axis that holds its value for the last part, as a share", 0.2, 1.0, _stick_late),
    "saturated-axis": Fault("one end of an axis cut off, share of the readings", 0.03, 0.15, _saturate),
    "wrong-unit": Fault("all readings times a factor; 0 for one of 0.01, 0.1, 10, 1000", 2.0, 0.0, lasting=_scale_all),
    "hard-iron-jump": Fault("an offset that changes at once and stays, µT", 2.0, 15.0, _jump),
    "nearby-magnet": Fault(
        "a magnet carried past at 20 cm in ten seconds; its field there, across its axis, in µT",
        3.0,
        30.0,
        _pass_magnet,
    ),
    "level-turn": Fault("turned about the vertical only, leaning by so many degrees", 5.0, 0.0, _turn_level),
    "no-rotation": Fault("at rest but for so many degrees either way", 20.0, 0.0, _rest),
    "stale-repeats": Fault("readings that repeat the one before, as a share", 0.2, 0.6, _repeat),
    "spikes": Fault("single readings off by 0.5 to 3 field strengths, as a share", 0.05, 0.2, _add_spikes),
    "thermal-drift": Fault("an offset that warms up and settles, µT from beginning to end", 1.5, 10.0, _warm_up),
    "one-gain": Fault("one axis reads so many times as much", 2.0, 4.0, lasting=_scale_axis),
    "swapped-throughout": Fault("two axes exchanged all the time", 1.0, 1.0, lasting=_swap_axes, is_detectable=False),
    "flipped-throughout": Fault(
        "one axis with the other sign all the time", 1.0, 1.0, lasting=_flip_axis, is_detectable=False
    ),
}
"""Kinds of faults of a unit, by name."""
