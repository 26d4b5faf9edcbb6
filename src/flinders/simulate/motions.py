"""Motions of a body; attitudes rotate body axes into world axes: north, east, down.

A `Motion` draws a random `Path`: the directions of the field in body axes and, for a motion in time, attitudes, rates
and accelerations.

>>> course = Course(n=500, rate_hz=50.0, world=np.array([0.5, 0.0, 0.75**0.5]))
>>> path = MOTIONS["flight"].draw(np.random.default_rng(0), course)
>>> path.directions.shape, path.rate.shape
((500, 3), (500, 3))
>>> down = in_body_axes(path.attitudes, np.array([0.0, 0.0, 1.0]))
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
from flinders.geometry.plane import PLANES, axis_order
from flinders.geometry.rotation import rotation_vectors
from flinders.geometry.sphere import clumped_directions, hemisphere, uniform_directions
from flinders.simulate._checks import count
from flinders.simulate.attitudes import attitudes_of, in_body_axes, integrate_steps, random_attitude, rates, turns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.geometry.plane import Plane

RATE_HZ: Final = 50.0

GRAVITY: Final = 9.81
"""m/s²."""

SETTLING_STEPS: Final = 200
"""Count of steps after which a random process no longer depends on its start."""

LEAN_TIME_CONSTANT_S: Final = 0.8
"""Time constant in s of each low-pass filter for the lean of a swayed body, which changes sides in some seconds."""

ROCKING_RATES: Final = ((0.05, 0.08), (0.1, 0.3), (0.2, 0.4))
"""Range in rad/s of the largest rate of roll, of pitch and of heading of a rocked body."""

WOBBLE_RANGE_HZ: Final = (0.25, 0.6)
"""Range in Hz of the frequencies of roll, pitch and heading of a wobbled body."""

TURN_OVER_SHARE: Final = 0.05
"""Share of the readings of planar sweeps while the body is turned from one plane to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Attitudes of a body over time."""

    time: Floats  #: (N,), s
    attitudes: Floats  #: (N, 3, 3): rotations from body axes into world axes (north, east, down)
    rate: Floats  #: (N, 3), rad/s: angular rate in body axes, constant between times
    #: (N, 3), m/s²: acceleration of the body in world axes, without gravity; None for a body that turns on the spot
    acceleration: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Requested properties of a motion."""

    n: int  #: count of readings
    rate_hz: float  #: readings per second
    world: Floats  #: (3,): unit direction of the field: north, east, down
    tilt_deg: float | None = None  #: largest tilt; None for the default of the motion


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Field directions in a moving body, with its motion."""

    directions: Floats  #: (N, 3): unit direction of the field in body axes
    attitudes: Floats | None = None  #: (N, 3, 3): rotations from body axes into world axes
    rate: Floats | None = None  #: (N, 3), rad/s: angular rate in body axes
    acceleration: Floats | None = None  #: (N, 3), m/s²: acceleration as in `Trajectory`


@dataclass(frozen=True, slots=True)
class Motion:
    """A named motion with its defaults."""

    draw: Callable[[Generator, Course], Path]  #: function from a generator and a `Course` to a `Path`
    seconds: float | None = None  #: default duration; None for 1,000 readings in random order
    tilt_deg: float | None = None  #: default of the largest tilt; None if there is no such parameter


def tilted(rng: Generator, n: int, *, tilt_deg: float = 35.0) -> Floats:
    """(n, 3, 3) attitudes: all headings, tilted about any level axis by up to `tilt_deg`; in random order.

    >>> down = in_body_axes(tilted(np.random.default_rng(0), 1000), np.array([0.0, 0.0, 1.0]))
    >>> bool(np.degrees(np.arccos(down[:, 2].min())) < 35)
    True
    """
    heading, axis = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 2 * np.pi, n)
    tilt = np.radians(rng.uniform(0, tilt_deg, n))
    tilts = turns(np.stack([np.cos(axis) * tilt, np.sin(axis) * tilt, np.zeros(n)], axis=1))
    return turns(np.outer(heading, [0.0, 0.0, 1.0])) @ tilts


def level_turn(rng: Generator, n: int) -> Floats:
    """(n, 3, 3) attitudes: all headings, level; in random order.

    >>> level_turn(np.random.default_rng(0), 3)[:, 2].tolist()
    [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    """
    return turns(np.outer(rng.uniform(0, 2 * np.pi, n), [0.0, 0.0, 1.0]))


def hand_tumble(
    rng: Generator, *, seconds: float = 60.0, rate_hz: float = RATE_HZ, speed: float = 1.5, smoothness: float = 0.6
) -> Trajectory:
    """Tumble a body by hand, smoothly and randomly, so that in time all directions are covered.

    Body rates are white noise through two equal low-pass filters.

    Parameters
    ----------
    speed : float, rad/s
        Rms rate about each axis.
    smoothness : float, s
        Time constant of each filter.

    Examples
    --------
    >>> turning = hand_tumble(np.random.default_rng(0), seconds=10)
    >>> turning.attitudes.shape, float(turning.time[-1]), float(np.sqrt(np.mean(turning.rate**2)))
    ((500, 3, 3), 9.98, 1.5)
    """
    n = count(round(seconds * rate_hz))
    rate = smooth_noise(rng, n, math.exp(-1.0 / (rate_hz * smoothness)))
    rate *= speed / np.sqrt(np.mean(rate**2))
    attitudes = integrate_steps(random_attitude(rng), turns(rate * (1 / rate_hz)))
    return Trajectory(_clock(n, rate_hz), attitudes, rate)


def figure_eight(rng: Generator, *, seconds: float = 60.0, rate_hz: float = RATE_HZ, period: float = 3.0) -> Trajectory:
    """Wave a body in figures of eight, as phones request it: roll to either side, nose up and down twice.

    Each figure of `period` s rolls by about 110° to either side, and pitches by about 55° at twice the frequency. The
    body turns around three times in all, so that no two figures are the same.

    >>> figure_eight(np.random.default_rng(0), seconds=10).attitudes.shape
    (500, 3, 3)
    """
    n = count(round(seconds * rate_hz))
    sway = _bounded_noise(rng, n, rate_hz, seconds=3.0)
    time = _clock(n, rate_hz)
    phase = 2 * np.pi * time / period + 0.5 * sway[:, 0] + rng.uniform(0, 2 * np.pi)
    roll = np.radians(110 + 20 * sway[:, 1]) * np.sin(phase)
    pitch = np.radians(55 + 15 * sway[:, 2]) * np.sin(2 * phase)
    heading = rng.uniform(0, 2 * np.pi) + 6 * np.pi * time / seconds
    return _trajectory(attitudes_of(heading, pitch, roll), rate_hz)


def drive(
    rng: Generator,
    *,
    seconds: float = 300.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 6.0,
    speed: float = 8.0,
) -> Trajectory:
    """Drive through bends and over hills: all headings over time, tilted by at most `tilt_deg`.

    The `speed` in m/s is constant, so that only bends cause acceleration.

    >>> on_a_floor = drive(np.random.default_rng(0), seconds=10, tilt_deg=0.0)
    >>> on_a_floor.attitudes[:, 2].tolist() == [[0.0, 0.0, 1.0]] * 500
    True
    """
    n = count(round(seconds * rate_hz))
    bends = 0.35 * _bounded_noise(rng, n, rate_hz, seconds=3.0)[:, 0]
    slope = math.radians(tilt_deg) * _bounded_noise(rng, n, rate_hz, seconds=4.0)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bends) / rate_hz
    attitudes = attitudes_of(heading, 0.9 * slope[:, 0], 0.4 * slope[:, 1])
    return _trajectory(attitudes, rate_hz, _to_the_right(heading, speed * bends))


def flight(
    rng: Generator,
    *,
    seconds: float = 300.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 35.0,
    speed: float = 15.0,
) -> Trajectory:
    """Fly in banked turns, climbing and sinking; bank and pitch together are at most `tilt_deg`.

    Turns are coordinated: at speed v in m/s and bank φ the heading rate is g tan φ / v. The accelerometer then measures
    no sideways component, so that its vertical leans with the aircraft.

    >>> flight(np.random.default_rng(0), seconds=10).acceleration.shape
    (500, 3)
    """
    n = count(round(seconds * rate_hz))
    lean = math.radians(tilt_deg) * _bounded_noise(rng, n, rate_hz, seconds=2.0)
    bank, pitch = 0.85 * lean[:, 0], 0.45 * lean[:, 1]
    bends = GRAVITY * np.tan(bank) / speed
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bends) / rate_hz
    return _trajectory(attitudes_of(heading, pitch, bank), rate_hz, _to_the_right(heading, speed * bends))


def swayed(
    rng: Generator,
    *,
    seconds: float = 60.0,
    rate_hz: float = RATE_HZ,
    tilt_deg: float = 35.0,
    turns_each: float = 2.0,
) -> Trajectory:
    """Turn a body through all headings while it leans to all sides: as `tilted`, but continuous in time.

    This is the motion of a vehicle that can be turned and tilted by less than `tilt_deg`, but not turned upside down.
    It turns around `turns_each` times on the spot, so that the accelerometer measures gravity alone.

    >>> leant = swayed(np.random.default_rng(0)).attitudes[:, 2, 2]
    >>> bool(25 < np.degrees(np.arccos(leant.min())) < 35)
    True
    """
    n = count(round(seconds * rate_hz))
    smooth = smooth_noise(rng, n, math.exp(-1.0 / (rate_hz * LEAN_TIME_CONSTANT_S)))
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
    """Rock a body about each of its axes by a different sine: the motion of the MAGYC simulations.

    Roll, pitch and heading are A sin((w/A) t + φ), so that w is the largest rate. It is drawn from `ROCKING_RATES`,
    with random phases φ. The simulations of MAGYC call the `amplitudes_deg` (5, 45, 360) WAM, (5, 5, 360) MAM and (5,
    45, 90) LAM; their `rate_hz` is 10.

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
    for amplitude, (slowest, fastest) in zip(np.radians(amplitudes_deg), ROCKING_RATES, strict=True):
        fast, phase = rng.uniform(slowest, fastest), rng.uniform(0, 2 * np.pi)
        angles.append(amplitude * np.sin(fast / amplitude * time + phase))
    roll, pitch, heading = angles
    return _trajectory(attitudes_of(heading, pitch, roll), rate_hz)


def wobble(rng: Generator, *, seconds: float = 10.0, rate_hz: float = RATE_HZ, tilt_deg: float = 30.0) -> Trajectory:
    """Wobble a body on its wheels or in the hand by `tilt_deg` about each of its axes.

    Roll, pitch and heading are sines of 0.25 to 0.6 Hz with random phases, about a random heading.

    >>> leaning = np.degrees(np.arccos(wobble(np.random.default_rng(0)).attitudes[:, 2, 2]))
    >>> bool(30.0 < leaning.max() < 45.0)
    True
    """
    time = _clock(count(round(seconds * rate_hz)), rate_hz)
    frequency, phase = rng.uniform(*WOBBLE_RANGE_HZ, (3, 1)), rng.uniform(0, 2 * np.pi, (3, 1))
    roll, pitch, heading = math.radians(tilt_deg) * np.sin(2 * np.pi * frequency * time + phase)
    return _trajectory(attitudes_of(heading + rng.uniform(0, 2 * np.pi), pitch, roll), rate_hz)


def planar_sweeps(
    rng: Generator,
    *,
    seconds: float = 60.0,
    rate_hz: float = RATE_HZ,
    planes: Sequence[str] = PLANES,
    turns_each: float = 2.0,
) -> Trajectory:
    """Turn a body about each of its axes in turn, while that axis points down.

    This is the procedure for two-axis fits: the body is turned flat on the table, on its side, and on its end. It is
    turned `turns_each` times in each of the planes ``xy``, ``yz`` and ``zx``, which are named by the two level axes,
    and then turned over to the next plane. Raises `UsageError` for an unknown plane, or no plane.

    >>> flat = planar_sweeps(np.random.default_rng(0), seconds=10, planes=["xy"])
    >>> bool(np.allclose(flat.attitudes[:, 2], [0.0, 0.0, 1.0]))
    True
    """
    if not planes or not set(planes) <= set(PLANES):
        raise UsageError(f"planes {','.join(planes)!r}: need one or more of {', '.join(PLANES)}")
    n = count(round(seconds * rate_hz))
    over = round(n * TURN_OVER_SHARE) if len(planes) > 1 else 0
    parts: list[Floats] = []
    for plane, rows in zip(planes, np.array_split(np.arange(n - over * (len(planes) - 1)), len(planes)), strict=True):
        heading = rng.uniform(0, 2 * np.pi) + np.linspace(0.0, 2 * np.pi * turns_each, len(rows), endpoint=False)
        flat = attitudes_of(heading, 0.0, 0.0) @ np.eye(3)[list(axis_order(cast("Plane", plane)))]
        if parts and over and len(flat):
            parts.append(_interpolated_attitudes(parts[-1][-1], flat[0], over))
        parts.append(flat)
    return _trajectory(np.concatenate(parts), rate_hz)


def _motion_of_directions(draw: Callable[[Generator, int], Floats]) -> Callable[[Generator, Course], Path]:
    """Motion from a function that draws directions."""
    return lambda rng, course: Path(draw(rng, course.n))


def _motion_of_attitudes(draw: Callable[..., Floats]) -> Callable[[Generator, Course], Path]:
    """Motion from a function that draws attitudes."""

    def path(rng: Generator, course: Course) -> Path:
        attitudes = draw(rng, course.n, **_limits(course))
        return Path(in_body_axes(attitudes, course.world), attitudes)

    return path


def _motion_in_time(draw: Callable[..., Trajectory], **options: object) -> Callable[[Generator, Course], Path]:
    """Motion from a function that draws a trajectory."""

    def path(rng: Generator, course: Course) -> Path:
        seconds = course.n / course.rate_hz
        turning = draw(rng, seconds=seconds, rate_hz=course.rate_hz, **options, **_limits(course))
        return Path(
            in_body_axes(turning.attitudes, course.world), turning.attitudes, turning.rate, turning.acceleration
        )

    return path


def _limits(course: Course) -> dict[str, float]:
    """Keyword arguments with the largest tilt, if it was requested; else empty."""
    return {} if course.tilt_deg is None else {"tilt_deg": course.tilt_deg}


MOTIONS: Final[Mapping[str, Motion]] = {
    "hand": Motion(_motion_in_time(hand_tumble), 60.0),
    "uniform": Motion(_motion_of_directions(uniform_directions)),
    "tilted": Motion(_motion_of_attitudes(tilted), tilt_deg=35.0),
    "level": Motion(_motion_of_attitudes(level_turn)),
    "hemisphere": Motion(_motion_of_directions(hemisphere)),
    "clumped": Motion(_motion_of_directions(clumped_directions)),
    "eight": Motion(_motion_in_time(figure_eight), 60.0),
    "drive": Motion(_motion_in_time(drive), 300.0, 6.0),
    "flight": Motion(_motion_in_time(flight), 300.0, 35.0),
    "swayed": Motion(_motion_in_time(swayed), 60.0, 35.0),
    "rocked": Motion(_motion_in_time(rocked), 600.0),
    "wobble": Motion(_motion_in_time(wobble), 10.0, 30.0),
    "sweeps": Motion(_motion_in_time(planar_sweeps), 60.0),
    "sweep-xy": Motion(_motion_in_time(planar_sweeps, planes=["xy"]), 30.0),
    "sweep-yz": Motion(_motion_in_time(planar_sweeps, planes=["yz"]), 30.0),
    "sweep-zx": Motion(_motion_in_time(planar_sweeps, planes=["zx"]), 30.0),
}
"""Motions of `tumble` by name."""


def _clock(n: int, rate_hz: float) -> Floats:
    """(n,) times in s, the first at zero."""
    time: Floats = np.arange(n, dtype=np.float64) * (1 / rate_hz)
    return time


def _trajectory(attitudes: Floats, rate_hz: float, acceleration: Floats | None = None) -> Trajectory:
    """Trajectory from attitudes, with their times and rates."""
    return Trajectory(_clock(len(attitudes), rate_hz), attitudes, rates(attitudes, rate_hz), acceleration)


def _bounded_noise(rng: Generator, n: int, rate_hz: float, *, seconds: float) -> Floats:
    """(n, 3) smooth random numbers strictly between −1 and 1; `seconds` is the time constant of each filter."""
    smooth = smooth_noise(rng, n, math.exp(-1.0 / (rate_hz * seconds)))
    limited: Floats = np.tanh(1.2 * smooth / np.sqrt(np.mean(smooth**2)))
    return limited


def _to_the_right(heading: Floats, acceleration: Floats) -> Floats:
    """(N, 3) level acceleration in world axes, of the (N,) size `acceleration` to the right of a heading in rad."""
    return np.stack([-np.sin(heading), np.cos(heading), np.zeros(len(heading))], axis=1) * acceleration[:, np.newaxis]


def _interpolated_attitudes(first: Floats, last: Floats, n: int) -> Floats:
    """(n, 3, 3) attitudes on the shortest rotation from one (3, 3) attitude to another, without these two."""
    vector = rotation_vectors((first.T @ last)[np.newaxis])
    steps = np.arange(1, n + 1)[:, np.newaxis] / (n + 1)
    between: Floats = first @ turns(steps * vector)
    return between


def smooth_noise(rng: Generator, n: int, memory: float) -> Floats:
    """(n, 3) white noise through two low-pass filters with the pole `memory`."""
    white = math.sqrt(1 - memory * memory) * rng.standard_normal((n + SETTLING_STEPS, 3))
    smooth = [_low_pass((1 - memory) * _low_pass(axis, memory), memory) for axis in white.T]
    return np.stack(smooth, axis=1)[SETTLING_STEPS:]


def _low_pass(values: Floats, memory: float) -> Floats:
    """First-order recursive filter of (N,) values with the pole `memory`, in Python floats, which are faster here."""
    return np.array(list(accumulate(values.tolist(), lambda state, value: memory * state + value)))
