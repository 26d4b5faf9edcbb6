"""How a body moves while it is recorded; attitudes turn body axes into world axes: north, east, down.

A `Motion` draws a `Path`: the directions of the field that the body meets and, where it is followed in time, its
attitudes, rates and accelerations.

>>> course = Course(n=500, rate_hz=50.0, world=np.array([0.5, 0.0, 0.75**0.5]))
>>> path = MOTIONS["flight"].draw(np.random.default_rng(0), course)
>>> path.directions.shape, path.rate.shape
((500, 3), (500, 3))
>>> down = seen_from(path.attitudes, np.array([0.0, 0.0, 1.0]))
>>> bool(np.degrees(np.arccos(down[:, 2].min())) < MOTIONS["flight"].tilt_deg)
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from flinders.errors import UsageError
from flinders.geometry.plane import PLANES, order_of
from flinders.geometry.rotation import rotation_vectors
from flinders.geometry.sphere import clumped, hemisphere, uniform
from flinders.simulate._checks import count
from flinders.simulate.attitudes import integrated, posed, random_attitude, rates, seen_from, turns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.geometry.plane import Plane

RATE_HZ: Final = 50.0

GRAVITY: Final = 9.81
"""m/s²."""

SETTLING: Final = 200
"""Steps of the random walk before its start is forgotten."""

LEANING: Final = 0.8
"""s, time constant of each filter of a swayed body's leans: it goes from one side to the other in some seconds."""

ROCKING: Final = ((0.05, 0.08), (0.1, 0.3), (0.2, 0.4))
"""rad/s, slowest and fastest of what a rocked body's roll, pitch and heading reach."""

WOBBLING_HZ: Final = (0.25, 0.6)
"""Slowest and fastest of what a wobbled body's roll, pitch and heading swing at."""

TURNING_OVER: Final = 0.05
"""Share of the readings of planar sweeps that are taken while the body is turned from one plane to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """How a body turns."""

    time: Floats  #: (N,), s
    attitudes: Floats  #: (N, 3, 3): rotations from body axes into world axes (north, east, down)
    rate: Floats  #: (N, 3), rad/s: angular rate in body axes: constant from each instant to the next
    #: (N, 3), m/s²: what moves the body, in world axes and without gravity; a body that turns on the spot has none
    acceleration: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What is asked of a motion."""

    n: int  #: readings
    rate_hz: float
    world: Floats  #: (3,): unit direction of the field: north, east, down
    tilt_deg: float | None = None  #: in place of the motion's own limit


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """What a body meets."""

    directions: Floats  #: (N, 3): unit direction of the field in body axes
    attitudes: Floats | None = None  #: (N, 3, 3)
    rate: Floats | None = None  #: (N, 3), rad/s
    acceleration: Floats | None = None  #: (N, 3), m/s²: as those of `Trajectory`


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion by name."""

    draw: Callable[[Generator, Course], Path]  #: of a generator and a `Course`; gives a `Path`
    seconds: float | None = None  #: how long it is unless someone says otherwise; None for 1,000 readings in no order
    tilt_deg: float | None = None  #: how far the body is tilted at most, where that is limited and can be chosen


def tilted(rng: Generator, n: int, *, tilt_deg: float = 35.0) -> Floats:
    """(n, 3, 3) attitudes: all headings, tilted about any level axis by up to `tilt_deg`; in no order.

    >>> down = seen_from(tilted(np.random.default_rng(0), 1000), np.array([0.0, 0.0, 1.0]))
    >>> bool(np.degrees(np.arccos(down[:, 2].min())) < 35)
    True
    """
    heading, axis = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 2 * np.pi, n)
    tilt = np.radians(rng.uniform(0, tilt_deg, n))
    tilts = turns(np.stack([np.cos(axis) * tilt, np.sin(axis) * tilt, np.zeros(n)], axis=1))
    return turns(np.outer(heading, [0.0, 0.0, 1.0])) @ tilts


def level_turn(rng: Generator, n: int) -> Floats:
    """(n, 3, 3) attitudes: all headings, level; in no order.

    >>> level_turn(np.random.default_rng(0), 3)[:, 2].tolist()
    [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    """
    return turns(np.outer(rng.uniform(0, 2 * np.pi, n), [0.0, 0.0, 1.0]))


def hand_tumble(
    rng: Generator, *, seconds: float = 60.0, rate_hz: float = RATE_HZ, speed: float = 1.5, smoothness: float = 0.6
) -> Trajectory:
    """Turn a body over and over, as a hand does: smooth, at random, slowly covering all directions.

    Body rates are white noise through two equal low-pass filters.

    Parameters
    ----------
    speed : float, rad/s
        Root mean square rate about each axis.
    smoothness : float, s
        Time constant of each filter.

    Examples
    --------
    >>> turning = hand_tumble(np.random.default_rng(0), seconds=10)
    >>> turning.attitudes.shape, float(turning.time[-1]), float(np.sqrt(np.mean(turning.rate**2)))
    ((500, 3, 3), 9.98, 1.5)
    """
    n = count(round(seconds * rate_hz))
    rate = wandering(rng, n, math.exp(-1.0 / (rate_hz * smoothness)))
    rate *= speed / np.sqrt(np.mean(rate**2))
    attitudes = integrated(random_attitude(rng), turns(rate * (1 / rate_hz)))
    return Trajectory(_clock(n, rate_hz), attitudes, rate)


def figure_eight(rng: Generator, *, seconds: float = 60.0, rate_hz: float = RATE_HZ, period: float = 3.0) -> Trajectory:
    """Wave a body in figures of eight, as phones ask for: over to either side, the nose twice up and down.

    Each eight, of `period` s, rolls by about 110° to either side and pitches by about 55° at twice the pace, while the
    whole body turns around three times in all. No two are the same.

    >>> figure_eight(np.random.default_rng(0), seconds=10).attitudes.shape
    (500, 3, 3)
    """
    n = count(round(seconds * rate_hz))
    sway = _limited(rng, n, rate_hz, seconds=3.0)
    time = _clock(n, rate_hz)
    phase = 2 * np.pi * time / period + 0.5 * sway[:, 0] + rng.uniform(0, 2 * np.pi)
    roll = np.radians(110 + 20 * sway[:, 1]) * np.sin(phase)
    pitch = np.radians(55 + 15 * sway[:, 2]) * np.sin(2 * phase)
    heading = rng.uniform(0, 2 * np.pi) + 6 * np.pi * time / seconds
    return _trajectory(posed(heading, pitch, roll), rate_hz)


def drive(
    rng: Generator,
    *,
    seconds: float = 300.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 6.0,
    speed: float = 8.0,
) -> Trajectory:
    """Drive through bends and over hills: all headings in time, and never tilted by more than `tilt_deg`.

    The `speed` in m/s is constant: the acceleration is that of bends.

    >>> on_a_floor = drive(np.random.default_rng(0), seconds=10, tilt_deg=0.0)
    >>> on_a_floor.attitudes[:, 2].tolist() == [[0.0, 0.0, 1.0]] * 500
    True
    """
    n = count(round(seconds * rate_hz))
    bends = 0.35 * _limited(rng, n, rate_hz, seconds=3.0)[:, 0]
    slope = math.radians(tilt_deg) * _limited(rng, n, rate_hz, seconds=4.0)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bends) / rate_hz
    attitudes = posed(heading, 0.9 * slope[:, 0], 0.4 * slope[:, 1])
    return _trajectory(attitudes, rate_hz, _to_the_right(heading, speed * bends))


def flight(
    rng: Generator,
    *,
    seconds: float = 300.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 35.0,
    speed: float = 15.0,
) -> Trajectory:
    """Fly in banked turns, climbing and sinking; bank and pitch together are never more than `tilt_deg`.

    Turns are coordinated: at speed v, m/s, and bank φ the heading turns by g tan φ / v, and the accelerometer feels no
    sideways pull, so that what it calls down leans with the craft.

    >>> flight(np.random.default_rng(0), seconds=10).acceleration.shape
    (500, 3)
    """
    n = count(round(seconds * rate_hz))
    lean = math.radians(tilt_deg) * _limited(rng, n, rate_hz, seconds=2.0)
    bank, pitch = 0.85 * lean[:, 0], 0.45 * lean[:, 1]
    bends = GRAVITY * np.tan(bank) / speed
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bends) / rate_hz
    return _trajectory(posed(heading, pitch, bank), rate_hz, _to_the_right(heading, speed * bends))


def swayed(
    rng: Generator,
    *,
    seconds: float = 60.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 35.0,
    turns_each: float = 2.0,
) -> Trajectory:
    """Turn a body through all headings while it leans to all sides: what `tilted` draws, in the order of time.

    A vehicle that can be pushed around and leant over by less than `tilt_deg`, and not turned upside down. It turns
    around `turns_each` times, on the spot, so that nothing but gravity is felt.

    >>> leant = swayed(np.random.default_rng(0)).attitudes[:, 2, 2]
    >>> bool(25 < np.degrees(np.arccos(leant.min())) < 35)
    True
    """
    n = count(round(seconds * rate_hz))
    smooth = wandering(rng, n, math.exp(-1.0 / (rate_hz * LEANING)))
    smooth /= np.sqrt(np.mean(smooth**2))
    far = np.hypot(smooth[:, 0], smooth[:, 1])
    lean = smooth * (math.radians(tilt_deg) * np.tanh(far / 2) / np.maximum(far, 1e-12))[:, np.newaxis]
    heading = rng.uniform(0, 2 * np.pi) + 2 * np.pi * turns_each * _clock(n, rate_hz) / seconds + 0.3 * smooth[:, 2]
    attitudes = turns(np.outer(heading, [0.0, 0.0, 1.0])) @ turns(lean * [1.0, 1.0, 0.0])
    return _trajectory(attitudes, rate_hz)


def rocked(
    rng: Generator,
    *,
    seconds: float = 600.0,
    rate_hz: float = RATE_HZ,
    amplitudes_deg: Sequence[float] = (5.0, 45.0, 360.0),
) -> Trajectory:
    """Rock a body about each of its axes, each as a sine of its own: the motion of the MAGYC simulations.

    Roll, pitch and heading are A sin((w/A) t + φ), so that w is the largest rate: 0.05 … 0.08, 0.1 … 0.3 and
    0.2 … 0.4 rad/s, drawn with the phases. `amplitudes_deg` (5, 45, 360) is called WAM there, (5, 5, 360) MAM and
    (5, 45, 90) LAM; `rate_hz` is 10.

    References
    ----------
    S. Rodríguez-Martínez and G. Troni (2024), see `benchmarks.emulations.magyc_ls`; numbers as in their code.

    Examples
    --------
    >>> gentle = rocked(np.random.default_rng(0), amplitudes_deg=(5.0, 5.0, 360.0)).attitudes[:, 2, 2]
    >>> bool(6 < np.degrees(np.arccos(gentle.min())) < 7.1)
    True
    """
    time = _clock(count(round(seconds * rate_hz)), rate_hz)
    angles: list[Floats] = []
    for amplitude, (slowest, fastest) in zip(np.radians(amplitudes_deg), ROCKING, strict=True):
        fast, phase = rng.uniform(slowest, fastest), rng.uniform(0, 2 * np.pi)
        angles.append(amplitude * np.sin(fast / amplitude * time + phase))
    roll, pitch, heading = angles
    return _trajectory(posed(heading, pitch, roll), rate_hz)


def wobble(rng: Generator, *, seconds: float = 10.0, rate_hz: float = RATE_HZ, tilt_deg: float = 30.0) -> Trajectory:
    """Rock a body that stands on its wheels or in the hand to and fro, by `tilt_deg` about each of its axes.

    Roll, pitch and heading are sines of 0.25 to 0.6 Hz with phases of their own, about any heading.

    >>> leaning = np.degrees(np.arccos(wobble(np.random.default_rng(0)).attitudes[:, 2, 2]))
    >>> bool(30.0 < leaning.max() < 45.0)
    True
    """
    time = _clock(count(round(seconds * rate_hz)), rate_hz)
    frequency, phase = rng.uniform(*WOBBLING_HZ, (3, 1)), rng.uniform(0, 2 * np.pi, (3, 1))
    roll, pitch, heading = math.radians(tilt_deg) * np.sin(2 * np.pi * frequency * time + phase)
    return _trajectory(posed(heading + rng.uniform(0, 2 * np.pi), pitch, roll), rate_hz)


def planar_sweeps(
    rng: Generator,
    *,
    seconds: float = 60.0,
    rate_hz: float = RATE_HZ,
    planes: Sequence[str] = PLANES,
    turns_each: float = 2.0,
) -> Trajectory:
    """Turn a body about its own axes, one after the other, each pointing down meanwhile.

    What the plain procedure for two-axis fits asks for: flat on the table around, on its side around, on its end
    around, `turns_each` times in each of the planes ``xy``, ``yz`` and ``zx``, named by the two axes that lie level.
    In between the body is turned over. A plane that is not known, or none, raises `UsageError`.

    >>> flat = planar_sweeps(np.random.default_rng(0), seconds=10, planes=["xy"])
    >>> bool(np.allclose(flat.attitudes[:, 2], [0.0, 0.0, 1.0]))
    True
    """
    if not planes or not set(planes) <= set(PLANES):
        raise UsageError(f"planes {','.join(planes)!r}: need one or more of {', '.join(PLANES)}")
    n = count(round(seconds * rate_hz))
    over = round(n * TURNING_OVER) if len(planes) > 1 else 0
    parts: list[Floats] = []
    for plane, rows in zip(planes, np.array_split(np.arange(n - over * (len(planes) - 1)), len(planes)), strict=True):
        heading = rng.uniform(0, 2 * np.pi) + np.linspace(0.0, 2 * np.pi * turns_each, len(rows), endpoint=False)
        flat = posed(heading, 0.0, 0.0) @ np.eye(3)[list(order_of(cast("Plane", plane)))]
        if parts and over and len(flat):
            parts.append(_between(parts[-1][-1], flat[0], over))
        parts.append(flat)
    return _trajectory(np.concatenate(parts), rate_hz)


def _spread(draw: Callable[[Generator, int], Floats]) -> Callable[[Generator, Course], Path]:
    """Make a motion of a function that draws directions."""
    return lambda rng, course: Path(draw(rng, course.n))


def _posed(draw: Callable[..., Floats]) -> Callable[[Generator, Course], Path]:
    """Make a motion of a function that draws attitudes."""

    def path(rng: Generator, course: Course) -> Path:
        attitudes = draw(rng, course.n, **_limits(course))
        return Path(seen_from(attitudes, course.world), attitudes)

    return path


def _followed(draw: Callable[..., Trajectory], **options: object) -> Callable[[Generator, Course], Path]:
    """Make a motion of a function that follows a body in time."""

    def path(rng: Generator, course: Course) -> Path:
        seconds = course.n / course.rate_hz
        turning = draw(rng, seconds=seconds, rate_hz=course.rate_hz, **options, **_limits(course))
        return Path(seen_from(turning.attitudes, course.world), turning.attitudes, turning.rate, turning.acceleration)

    return path


def _limits(course: Course) -> dict[str, float]:
    """The limit of the tilt, where one is asked for."""
    return {} if course.tilt_deg is None else {"tilt_deg": course.tilt_deg}


MOTIONS: Final[Mapping[str, Motion]] = {
    "hand": Motion(_followed(hand_tumble), 60.0),
    "uniform": Motion(_spread(uniform)),
    "tilted": Motion(_posed(tilted), tilt_deg=35.0),
    "level": Motion(_posed(level_turn)),
    "hemisphere": Motion(_spread(hemisphere)),
    "clumped": Motion(_spread(clumped)),
    "eight": Motion(_followed(figure_eight), 60.0),
    "drive": Motion(_followed(drive), 300.0, 6.0),
    "flight": Motion(_followed(flight), 300.0, 35.0),
    "swayed": Motion(_followed(swayed), 60.0, 35.0),
    "rocked": Motion(_followed(rocked), 600.0),
    "wobble": Motion(_followed(wobble), 10.0, 30.0),
    "sweeps": Motion(_followed(planar_sweeps), 60.0),
    "sweep-xy": Motion(_followed(planar_sweeps, planes=["xy"]), 30.0),
    "sweep-yz": Motion(_followed(planar_sweeps, planes=["yz"]), 30.0),
    "sweep-zx": Motion(_followed(planar_sweeps, planes=["zx"]), 30.0),
}
"""What `tumble` knows, by name."""


def _clock(n: int, rate_hz: float) -> Floats:
    """(n,) instants in s, the first at zero."""
    time: Floats = np.arange(n, dtype=np.float64) * (1 / rate_hz)
    return time


def _trajectory(attitudes: Floats, rate_hz: float, acceleration: Floats | None = None) -> Trajectory:
    """Say when each attitude was taken, and how fast the body turns there."""
    return Trajectory(_clock(len(attitudes), rate_hz), attitudes, rates(attitudes, rate_hz), acceleration)


def _limited(rng: Generator, n: int, rate_hz: float, *, seconds: float) -> Floats:
    """(n, 3) smooth at random between −1 and 1, which are never reached; `seconds` is the time of each filter."""
    smooth = wandering(rng, n, math.exp(-1.0 / (rate_hz * seconds)))
    limited: Floats = np.tanh(1.2 * smooth / np.sqrt(np.mean(smooth**2)))
    return limited


def _to_the_right(heading: Floats, acceleration: Floats) -> Floats:
    """(N, 3) in world axes, an acceleration (N,) that points to the right of a heading in rad, level."""
    return np.stack([-np.sin(heading), np.cos(heading), np.zeros(len(heading))], axis=1) * acceleration[:, np.newaxis]


def _between(first: Floats, last: Floats, n: int) -> Floats:
    """(n, 3, 3) attitudes on the shortest way from one (3, 3) to another, both left out."""
    vector = rotation_vectors((first.T @ last)[np.newaxis])
    steps = np.arange(1, n + 1)[:, np.newaxis] / (n + 1)
    between: Floats = first @ turns(steps * vector)
    return between


def wandering(rng: Generator, n: int, memory: float) -> Floats:
    """(n, 3) white noise through two low-pass filters that keep `memory` of their state each step."""
    white = math.sqrt(1 - memory * memory) * rng.standard_normal((n + SETTLING, 3))
    smooth = [_low_pass((1 - memory) * _low_pass(axis, memory), memory) for axis in white.T]
    return np.stack(smooth, axis=1)[SETTLING:]


def _low_pass(values: Floats, memory: float) -> Floats:
    """Add `memory` of the sum before to each of (N,) values: in floats of Python, which beat arrays of one number."""
    return np.array(list(accumulate(values.tolist(), lambda state, value: memory * state + value)))
