"""Effects that no ellipsoid models, and how often a good verdict is wrong because of them.

    python -m benchmarks.adversary [--trials 40] [--effects "cubic axis 4 µT" …] [--paths tumble …] [--processes 2]

A sensor in a hand is turned along a path. Its readings contain the field at the place, iron and currents on the body,
and faults of the sensor. The code is independent of `flinders.simulate`, so that both cannot contain the same mistake.
Prints Markdown.

A fit is *wrong* if its worst level heading error is above 1° and above twice the claim. The number in brackets is the
number to expect for true claims: it counts errors that are drawn from the claim, which consists of the covariance and,
for structure over direction, of harmonics of each axis. *Ratio* is the true divided by the claimed worst level heading
error of good fits; for true claims its median is 1.2 and its 90 % value 2.1. *Cautious* is the share of fits that are
not good although their error is within half the target.

With ``--felt`` an accelerometer is recorded too, and fits with the finding `attitude-dependent` are counted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit

SEED: Final = 19_770_905
STRENGTH_UT, DIP_DEG, TARGET_DEG = 48.0, 60.0, 1.0
NOISE_UT: Final = 0.2
GRAVITY: Final = 9.81
RATE_HZ: Final = 50.0
STEPS_PER_READING: Final = 4
"""Steps of the path per reading; an axis can lag by a part of a reading."""
HEADINGS: Final = np.radians(np.arange(0.0, 360.0, 5.0))
DRAWS: Final = 200
"""Number of errors that are drawn from a covariance."""
NORTH_DOWN: Final = STRENGTH_UT * np.array([np.cos(np.radians(DIP_DEG)), 0.0, np.sin(np.radians(DIP_DEG))])


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Motion of a sensor in small steps: (M,) times in s, (M, 3, 3) attitudes from body to world, (M, 3) m places."""

    time: Floats
    attitudes: Floats
    places: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """A sensor on its body: ``reading = iron @ field + offset``, before the errors of its axes."""

    iron: Floats
    offset: Floats


Field = Callable[["Generator", Path], "Floats"]
"""Function that returns (M, 3) µT along a path, to be added to the field in axes of the world or of the body."""
Rows = Callable[["Generator", "Floats"], "Floats"]
"""Function that returns changed readings, (N, 3) µT."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An effect on the readings of a recording.

    Attributes
    ----------
    place, body : Field, optional
        Field at the place, in axes of the world; field that the body adds, in axes of the sensor.
    axes : Rows, optional
        Change by the axes of the sensor, for readings without offset.
    lags : of Generator to (3,) s, optional
        Lag of each axis.
    rest : Rows, optional
        Change by rests, for readings without offset.
    log : Rows, optional
        Change of the rows of the log.
    noise : float, µT
    is_timed : bool
        Whether the log has times.
    seen : bool
        Whether a single recording can show the effect.
    linearize : bool
        Whether the fit corrects nonlinear axes.
    """

    place: Field | None = None
    body: Field | None = None
    axes: Rows | None = None
    lags: Callable[[Generator], Floats] | None = None
    rest: Rows | None = None
    log: Rows | None = None
    noise: float = NOISE_UT
    is_timed: bool = True
    seen: bool = True
    linearize: bool = False


@dataclass(frozen=True, slots=True)
class Trial:
    """One fit compared with the truth, in degrees; `expected` is the probability that a true claim looks wrong."""

    verdict: str
    codes: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    claimed: float = np.nan
    true: float = np.nan
    expected: float = 0.0

    @property
    def is_wrong(self) -> bool:
        """Whether the verdict is good although the error is far beyond the claim."""
        return self.verdict == "good" and self.true > max(TARGET_DEG, 2.0 * self.claimed)


def smooth(rng: Generator, steps: int, step_s: float, time_s: float, columns: int = 3) -> Floats:
    """(steps, columns) smooth random series of unit variance: white noise after two low-pass filters."""
    keep = float(np.exp(-step_s / time_s))
    warm = int(10 * time_s / step_s)
    course, first, second = np.empty((steps + warm, columns)), np.zeros(columns), np.zeros(columns)
    for row, push in enumerate(rng.standard_normal((steps + warm, columns))):
        first = keep * first + push
        second = keep * second + (1.0 - keep) * first
        course[row] = second
    course = course[warm:]
    scaled: Floats = course / course.std()
    return scaled


def about(vectors: Floats) -> Floats:
    """(M, 3, 3) rotations by (M, 3) rotation vectors in rad, with Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = (vectors / np.maximum(angle[:, :, 0], 1e-12)).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    turned: Floats = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return turned


def chained(steps: Floats, first: Floats) -> Floats:
    """(M, 3, 3) attitudes from `first` on; each is turned by the next of (M, 3, 3) `steps`, about body axes."""
    attitudes, attitude = np.empty_like(steps), first
    for row, step in enumerate(steps):
        attitude = attitude @ step
        attitudes[row] = attitude
    return attitudes


def anywhere(rng: Generator) -> Floats:
    """(3, 3) random attitude."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    turned: Floats = q * np.linalg.det(q)
    return turned


def held(rng: Generator, attitudes: Floats, step_s: float) -> Floats:
    """(M, 3) places of a sensor in a hand: the hand drifts by 8 cm, the sensor is 10 cm away from the wrist."""
    hand = 0.08 * smooth(rng, len(attitudes), step_s, 1.5)
    places: Floats = hand + attitudes @ np.array([0.1, 0.0, 0.0])
    return places


def turned(rng: Generator, rates: Floats, step_s: float) -> Path:
    """Path of a body that turns at (M, 3) rates in rad/s, about its own axes."""
    attitudes = chained(about(rates * step_s), anywhere(rng))
    return Path(step_s * np.arange(len(rates)), attitudes, held(rng, attitudes, step_s))


def tumble(rng: Generator, seconds: float = 60.0, rate: float = 1.8) -> Path:
    """Path of a hand that turns about all axes at about 100°/s."""
    step_s = 1.0 / (STEPS_PER_READING * RATE_HZ)
    return turned(rng, rate * smooth(rng, round(seconds / step_s), step_s, 0.6), step_s)


def eights(rng: Generator, seconds: float = 60.0) -> Path:
    """Path of figures of eight: the wrist rocks about two axes while the body turns about the vertical."""
    step_s = 1.0 / (STEPS_PER_READING * RATE_HZ)
    time = step_s * np.arange(round(seconds / step_s))
    phase, period = rng.uniform(0.0, 2 * np.pi, 3), rng.uniform(2.5, 3.5)
    turn = 2 * np.pi * time / period
    roll, pitch = 1.4 * np.sin(turn + phase[0]), 1.1 * np.sin(2 * turn + phase[1])
    yaw = 2 * np.pi * time / rng.uniform(15.0, 25.0) + 0.5 * smooth(rng, len(time), step_s, 2.0, 1)[:, 0]
    zero = np.zeros_like(time)
    attitudes = (
        about(np.stack([zero, zero, yaw], axis=1))
        @ about(np.stack([zero, pitch, zero], axis=1))
        @ about(np.stack([roll, zero, zero], axis=1))
    )
    return Path(time, attitudes, held(rng, attitudes, step_s))


def axis_by_axis(rng: Generator) -> Path:
    """Path of three full turns about each axis, one axis after the other, with a drift about the others."""
    step_s = 1.0 / (STEPS_PER_READING * RATE_HZ)
    each = round(20.0 / step_s)
    rates = 0.25 * smooth(rng, 3 * each, step_s, 1.0)
    for axis in range(3):
        rates[axis * each : (axis + 1) * each, axis] += 2 * np.pi * 3 / 20.0
    return turned(rng, rates, step_s)


PATHS: Final[dict[str, Callable[[Generator], Path]]] = {
    "tumble": tumble,
    "slow tumble": partial(tumble, seconds=120.0, rate=0.9),
    "short tumble": partial(tumble, seconds=15.0, rate=2.5),
    "figure eight": eights,
    "axis by axis": axis_by_axis,
}


def remembering(rng: Generator, path: Path, *, sigma: float, time_s: float) -> Floats:
    """Ornstein–Uhlenbeck noise of each axis, (M, 3) µT."""
    keep = float(np.exp(-(path.time[1] - path.time[0]) / time_s))
    course, value = np.empty((len(path.time), 3)), rng.standard_normal(3)
    for row, push in enumerate(np.sqrt(1.0 - keep * keep) * rng.standard_normal(course.shape)):
        value = keep * value + push
        course[row] = value
    scaled: Floats = sigma * course
    return scaled


def lasting(rng: Generator, path: Path, *, sigma: float) -> Floats:
    """Ornstein–Uhlenbeck noise with a time constant between 1 and 30 s, (M, 3) µT."""
    return remembering(rng, path, sigma=sigma, time_s=float(np.exp(rng.uniform(0.0, np.log(30.0)))))


def gradient(rng: Generator, path: Path, *, per_metre: float) -> Floats:
    """Field with a constant gradient and without sources: the gradient is a symmetric matrix with trace 0."""
    tensor = rng.standard_normal((3, 3))
    tensor = tensor + tensor.T - 2.0 * np.trace(tensor) / 3.0 * np.eye(3)
    grown: Floats = path.places @ (per_metre * tensor / np.linalg.norm(tensor))
    return grown


def desk(rng: Generator, path: Path, *, rms: float) -> Floats:
    """Field of steel below the hand: a dipole half a metre below, along the field that magnetises it."""
    from_it = path.places - np.array([*rng.uniform(-0.2, 0.2, 2), 0.5])
    distance = np.linalg.norm(from_it, axis=1)[:, None]
    along = from_it / distance
    moment = NORTH_DOWN / STRENGTH_UT
    field = (3.0 * (along @ moment)[:, None] * along - moment) / distance**3
    scaled: Floats = field * rms / np.sqrt(np.mean(np.sum(field**2, axis=1)))
    return scaled


def current(rng: Generator, path: Path, *, amplitude: float) -> Floats:
    """Field of a current that steps with the attitude, such as that of motors which hold a body against gravity."""
    side, wire = rng.standard_normal((2, 3))
    down = path.attitudes[:, 2] @ side / np.linalg.norm(side)
    field: Floats = np.round(2.0 * down)[:, None] / 2.0 * amplitude * wire / np.linalg.norm(wire)
    return field


def jump(rng: Generator, path: Path, *, by: float) -> Floats:
    """Field of a magnetised part that moves once."""
    moved = rng.standard_normal(3)
    at = rng.uniform(0.25, 0.75) * path.time[-1]
    field: Floats = (path.time > at)[:, None] * by * moved / np.linalg.norm(moved)
    return field


def drift(rng: Generator, path: Path, *, by: float) -> Floats:
    """Offset that follows a temperature; the temperature rises and then stays constant."""
    along = rng.standard_normal(3)
    rise = 1.0 - np.exp(-path.time / (0.3 * path.time[-1]))
    field: Floats = rise[:, None] * by * along / np.linalg.norm(along)
    return field


def passing(rng: Generator, path: Path, *, peak: float) -> Floats:
    """Field of a magnet that passes: a dipole on a straight line."""
    direction = rng.standard_normal(3)
    at = rng.uniform(0.2, 0.8) * path.time[-1]
    course = peak * (1.0 + ((path.time - at) / 0.7) ** 2) ** -1.5
    field: Floats = course[:, None] * direction / np.linalg.norm(direction)
    return field


def switching(rng: Generator, path: Path, *, amplitude: float) -> Floats:
    """Field of a load that is switched on for one to three seconds, at random attitudes."""
    course, now = np.zeros(len(path.time)), 0.0
    while now < path.time[-1]:
        now += rng.exponential(8.0)
        end = now + rng.uniform(1.0, 3.0)
        course[(path.time >= now) & (path.time < end)] = amplitude
        now = end
    wire = rng.standard_normal(3)
    field: Floats = course[:, None] * wire / np.linalg.norm(wire)
    return field


def bent(_: Generator, readings: Floats, *, quadratic: float = 0.0, cubic: float = 0.0) -> Floats:
    """Readings with a nonlinear first axis; `quadratic` and `cubic` are its errors in µT at the field strength."""
    share = readings[:, :1] / STRENGTH_UT
    axis = np.array([1.0, 0.0, 0.0])
    read: Floats = readings + (quadratic * share**2 + cubic * share**3) * axis
    return read


def lumpy(rng: Generator, readings: Floats, *, rms: float) -> Floats:
    """Readings whose length varies with the direction, by a random harmonic of degree three."""
    directions = readings / np.linalg.norm(readings, axis=1)[:, None]
    turn = anywhere(rng)
    x, y, z = (directions @ turn).T
    cubic = np.sqrt(105.0) * x * y * z
    read: Floats = readings + rms * cubic[:, None] * directions
    return read


def warped(rng: Generator, readings: Floats, *, rms: float) -> Floats:
    """Readings in which each axis has an error by its own random harmonic of degree three."""
    directions = readings / np.linalg.norm(readings, axis=1)[:, None]
    x, y, z = np.moveaxis(directions @ np.stack([anywhere(rng) for _ in range(3)]), 2, 0)
    read: Floats = readings + rms * np.sqrt(105.0) * (x * y * z).T
    return read


def stale(rng: Generator, rows: Floats, *, share: float) -> Floats:
    """Rows in which one axis sometimes repeats its previous reading."""
    rows = rows.copy()
    for row in 1 + np.flatnonzero(rng.random(len(rows) - 1) < share):
        rows[row, 0] = rows[row - 1, 0]
    return rows


def shuffled(rng: Generator, rows: Floats) -> Floats:
    """Rows in random order."""
    order: Floats = rng.permutation(rows)
    return order


def tiled(rng: Generator, rows: Floats, *, distinct: int, times: int) -> Floats:
    """Few readings that are each repeated many times, but not consecutively."""
    return np.tile(rows[rng.choice(len(rows), distinct, replace=False)], (times, 1))


def stepped(_: Generator, rows: Floats, *, step: float) -> Floats:
    """Rows that are rounded to multiples of a coarse step."""
    return step * np.round(rows / step)


def cut(rng: Generator, rows: Floats) -> Floats:
    """Rows of which a third is missing, in three pieces."""
    lost = np.zeros(len(rows), dtype=bool)
    for begin in rng.choice(len(rows), 3, replace=False):
        lost[begin : begin + len(rows) // 9] = True
    return rows[~lost]


def rested(rng: Generator, readings: Floats, *, rests: int) -> Floats:
    """Readings with some rests of 5 to 60 s in another field, before, during or after the turn."""
    for _ in range(rests):
        amid, seconds, off = int(rng.integers(len(readings))), rng.uniform(5.0, 60.0), rng.uniform(-0.2, 0.2)
        at = (0, amid, len(readings) - 1)[rng.integers(3)]
        still = np.tile((1.0 + off) * readings[at], (round(STEPS_PER_READING * RATE_HZ * seconds), 1))
        readings = np.concatenate([readings[:at], still, readings[at:]])
    return readings


def thinned(_: Generator, rows: Floats, *, count: int) -> Floats:
    """Few of the readings, evenly distributed over the time of the turn."""
    return rows[:: len(rows) // count][:count]


def one_late(late_s: float) -> Callable[[Generator], Floats]:
    """Function that returns lags of the axes, of which one differs from the others."""
    return lambda rng: late_s * np.eye(3)[rng.integers(3)]


def all_late(rng: Generator) -> Floats:
    """(3,) lags of the axes: 50 ms ± 30 %."""
    lags: Floats = 0.05 * (1.0 + 0.3 * rng.standard_normal(3))
    return lags


def _slow(sigma: float, time_s: float, *, log: Rows | None = None) -> Effect:
    return Effect(body=partial(remembering, sigma=sigma, time_s=time_s), log=log, is_timed=log is None)


EFFECTS: Final[dict[str, Effect]] = {
    "nothing": Effect(),
    "no noise": Effect(noise=1e-9),
    "steps of 3 µT": Effect(log=partial(stepped, step=3.0)),
    "a third of the rows lost": Effect(log=cut, is_timed=False),
    "memory 4 s, 0.5 µT": _slow(0.5, 4.0),
    "memory 10 s, 0.5 µT": _slow(0.5, 10.0),
    "memory 30 s, 0.5 µT": _slow(0.5, 30.0),
    "memory 10 s, 1.5 µT": _slow(1.5, 10.0),
    "memory 10 s, 0.5 µT, shuffled": _slow(0.5, 10.0, log=shuffled),
    **{
        f"{count} readings, memory 1 to 30 s, 0.5 µT": Effect(
            body=partial(lasting, sigma=0.5), log=partial(thinned, count=count), is_timed=False
        )
        for count in (20, 30, 40)
    },
    "a rest, field within 20 %": Effect(rest=partial(rested, rests=1)),
    "three rests, field within 20 %": Effect(rest=partial(rested, rests=3)),
    "cubic axis 1 µT": Effect(axes=partial(bent, cubic=1.0)),
    "cubic axis 4 µT": Effect(axes=partial(bent, cubic=4.0)),
    "quadratic axis 2 µT": Effect(axes=partial(bent, quadratic=2.0)),
    "cubic axis 4 µT, linearized": Effect(axes=partial(bent, cubic=4.0), linearize=True),
    "quadratic axis 2 µT, linearized": Effect(axes=partial(bent, quadratic=2.0), linearize=True),
    "one axis late by 20 ms": Effect(lags=one_late(0.02)),
    "one axis late by 60 ms": Effect(lags=one_late(0.06)),
    "axes late by 50 ms ± 30 %": Effect(lags=all_late),
    "structure of degree 3, 0.3 µT": Effect(axes=partial(lumpy, rms=0.3)),
    "structure of degree 3, 1 µT": Effect(axes=partial(lumpy, rms=1.0)),
    "axes off by degree 3, 0.3 µT": Effect(axes=partial(warped, rms=0.3)),
    "one axis stale, 5 %": Effect(log=partial(stale, share=0.05)),
    "one axis stale, 30 %": Effect(log=partial(stale, share=0.3)),
    "12 readings, 50 times each": Effect(log=partial(tiled, distinct=12, times=50), is_timed=False),
    "jump of 2 µT": Effect(body=partial(jump, by=2.0)),
    "drift of 3 µT": Effect(body=partial(drift, by=3.0)),
    "magnet passes, 20 µT": Effect(body=partial(passing, peak=20.0)),
    "load on and off, 2 µT": Effect(body=partial(switching, amplitude=2.0)),
    "gradient of 4 µT/m": Effect(place=partial(gradient, per_metre=4.0), seen=False),
    "steel desk, 3 µT": Effect(place=partial(desk, rms=3.0), seen=False),
    "current with attitude, 1.5 µT": Effect(body=partial(current, amplitude=1.5), seen=False),
}


def sensor(rng: Generator) -> Sensor:
    """Random sensor with soft iron of ± 25 % and an offset of up to two field strengths."""
    mixed = rng.uniform(-0.25, 0.25, (3, 3))
    iron = np.diag(rng.uniform(0.75, 1.25, 3)) + 0.3 * (mixed + mixed.T)
    direction = rng.standard_normal(3)
    return Sensor(iron, direction / np.linalg.norm(direction) * rng.uniform(0.0, 2.0) * STRENGTH_UT)


def recorded(seed: int, of: Sensor, effect: Effect, path: Path, *, place: int = 0) -> Samples:
    """Recording of a sensor on a path, at the first place or at another one."""
    field = NORTH_DOWN + (0.0 if effect.place is None else effect.place(stream(seed, f"place {place}"), path))
    inside = np.einsum("mji,mj->mi", path.attitudes, np.broadcast_to(field, path.places.shape))
    readings = inside @ of.iron
    if effect.body is not None:
        readings = readings + effect.body(stream(seed, f"body {place}"), path)
    if effect.axes is not None:
        readings = effect.axes(stream(seed, "axes"), readings)
    if effect.lags is not None:
        lags = effect.lags(stream(seed, "lags"))
        late = [np.interp(path.time - lags[axis], path.time, readings[:, axis]) for axis in range(3)]
        readings = np.stack(late, axis=1)
    if effect.rest is not None:
        readings = effect.rest(stream(seed, f"rest {place}"), readings)
    rows = readings[::STEPS_PER_READING] + of.offset
    rows = rows + effect.noise * stream(seed, f"noise {place}").standard_normal(rows.shape)
    rows = rows if effect.log is None else effect.log(stream(seed, f"log {place}"), rows)
    return Samples.of(rows, unit="uT", time=np.arange(len(rows)) / RATE_HZ if effect.is_timed else None)


def felt(samples: Samples, seed: int, path: Path) -> Samples:
    """Recording with an accelerometer, which measures the motion of the hand too, with noise of 0.05 m/s²."""
    moved = np.gradient(np.gradient(path.places, path.time, axis=0), path.time, axis=0) - [0.0, 0.0, GRAVITY]
    force = np.einsum("mji,mj->mi", path.attitudes, moved)[::STEPS_PER_READING]
    return replace(samples, acceleration=force + 0.05 * stream(seed, "felt").standard_normal(force.shape))


def stream(seed: int, what: str) -> Generator:
    """Random numbers for one purpose of a trial, independent of those for other purposes."""
    return np.random.default_rng([SEED, seed, *what.encode()])


def level_field() -> Floats:
    """(72, 3) directions of the field in the axes of a level body, one for each of `HEADINGS`."""
    dip = np.radians(DIP_DEG)
    return np.stack(
        [np.cos(dip) * np.cos(HEADINGS), -np.cos(dip) * np.sin(HEADINGS), np.full_like(HEADINGS, np.sin(dip))], axis=1
    )


def level(seed: int, of: Sensor, effect: Effect) -> Floats:
    """(72, 3) readings without noise of a sensor on a level body, one for each of `HEADINGS`."""
    readings: Floats = STRENGTH_UT * level_field() @ of.iron
    readings = readings if effect.axes is None else effect.axes(stream(seed, "axes"), readings)
    return readings + of.offset


def headings(corrected: Floats) -> Floats:
    """(…, 72) heading errors in degrees of (…, 72, 3) level readings, minus their mean."""
    error = np.angle(np.exp(1j * (np.arctan2(-corrected[..., 1], corrected[..., 0]) - HEADINGS)))
    mean = np.angle(np.exp(1j * error).mean(axis=-1, keepdims=True))
    off: Floats = np.degrees(np.angle(np.exp(1j * (error - mean))))
    return off


def turned_by(off: Floats) -> Floats:
    """(D, 72) heading errors in degrees, minus their mean, for (D, 72, 3) errors of the level field's direction."""
    turns = np.degrees(
        -(np.sin(HEADINGS) * off[:, :, 0] + np.cos(HEADINGS) * off[:, :, 1]) / np.cos(np.radians(DIP_DEG))
    )
    centred: Floats = turns - turns.mean(axis=1, keepdims=True)
    return centred


def of_unit_worst(turns: Floats) -> Floats:
    """(D, 72) heading errors, scaled so that their root mean square at the worst heading is 1."""
    scaled: Floats = turns / max(np.sqrt(np.mean(turns**2, axis=0)).max(), 1e-12)
    return scaled


@cache
def of_structure() -> Floats:
    """(`DRAWS`, 72) heading errors by a harmonic of degree three for each axis."""
    rng, field = np.random.default_rng(SEED), level_field()
    return of_unit_worst(turned_by(np.stack([warped(rng, field, rms=1.0) - field for _ in range(DRAWS)])))


def of_parameters(fit: Fit) -> Floats:
    """(`DRAWS`, 72) heading errors that are drawn from the covariance of a fit."""
    iron = fit.calibration.field_strength * np.linalg.inv(fit.calibration.matrix)
    values, vectors = np.linalg.eigh(fit.claim.covariance)
    errors = np.random.default_rng(SEED).standard_normal((DRAWS, 9)) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    shape = errors[:, [3, 6, 7, 6, 4, 8, 7, 8, 5]].reshape(-1, 3, 3)
    moved = errors[:, None, :3] + np.einsum("dij,hj->dhi", shape, level_field())
    return of_unit_worst(turned_by(-np.einsum("ij,dhj->dhi", np.linalg.inv(iron), moved)))


def probability(fit: Fit) -> float:
    """Probability that a true claim counts as wrong, by errors that are drawn from the claim."""
    worst, structure = fit.heading_error_deg.worst, fit.claim.structure_deg
    if not (np.isfinite(worst) and np.isfinite(fit.claim.covariance).all()):
        return 0.0
    rest = np.sqrt(max(worst**2 - structure**2, 0.0))
    largest = np.abs(rest * of_parameters(fit) + structure * of_structure()).max(axis=1)
    return float(np.mean(largest > max(TARGET_DEG, 2.0 * worst)))


def fitted(source: Recording, *, linearize: bool = False) -> Fit | None:
    """Fit of a recording, even a refused one; None if there is no fit."""
    try:
        return flinders.fit(source, target_deg=TARGET_DEG, linearize=linearize)
    except Refused as refusal:
        return refusal.fit
    except flinders.FlindersError:
        return None


def tried(row: tuple[str, int], seed: int, paths: Sequence[Path]) -> Trial:
    """Trial of an effect, with a recording at each of some places."""
    name, places = row
    effect, of = EFFECTS[name], sensor(stream(seed, "sensor"))
    each = [recorded(seed, of, effect, path, place=place) for place, path in enumerate(paths[:places])]
    fit = fitted(each[0] if places == 1 else Joined(tuple(each)), linearize=effect.linearize)
    if fit is None:
        return Trial("refused")
    true = float(np.abs(headings(fit.calibration.apply(level(seed, of, effect)))).max())
    codes = tuple(finding.code for finding in fit.findings)
    return Trial(fit.verdict, codes, fit.judgement.conditions, fit.heading_error_deg.worst, true, probability(fit))


def tried_on(case: tuple[str, int], *, rows: Sequence[tuple[str, int]]) -> list[Trial]:
    """Trials of all rows of the table with one seed. They share paths, since paths take longer than fits."""
    path, seed = case
    places = range(max(places for _, places in rows))
    paths = [PATHS[path](stream(seed, f"path {place}")) for place in places]
    return [tried(row, seed, paths) for row in rows]


def is_named(case: tuple[str, str, int]) -> bool:
    """Whether a fit with an accelerometer has the finding `attitude-dependent`."""
    name, path, seed = case
    turned = PATHS[path](stream(seed, "path 0"))
    fit = fitted(felt(recorded(seed, sensor(stream(seed, "sensor")), EFFECTS[name], turned), seed, turned))
    return fit is not None and any(finding.code == "attitude-dependent" for finding in fit.findings)


HEAD: Final = (
    "| effect | good, limited, refused | wrong (expected) | ratio 50 / 90 % | cautious | unconditional | first |\n"
    "|---|---|---|---|---:|---:|---|"
)


def row(name: str, trials: Sequence[Trial]) -> str:
    """A row of the table."""
    verdicts = [trial.verdict for trial in trials]
    good = [trial for trial in trials if trial.verdict == "good"]
    ratios = [trial.true / trial.claimed for trial in good if trial.claimed > 0.0]
    quantiles = " / ".join(f"{ratio:.1f}" for ratio in np.quantile(ratios, [0.5, 0.9])) if ratios else "–"
    cautious = [trial for trial in trials if trial.verdict != "good" and trial.true < TARGET_DEG / 2]
    bare = sum(not trial.conditions for trial in good)
    firsts = [code for trial in trials for code in trial.codes[:1] if code not in UNRELATED_FINDINGS]
    first = max(set(firsts), key=firsts.count) if firsts else ""
    return (
        f"| {name} | {', '.join(str(verdicts.count(verdict)) for verdict in ('good', 'limited', 'refused'))} | "
        f"{sum(trial.is_wrong for trial in good)} ({sum(trial.expected for trial in good):.1f}) | "
        f"{quantiles} | {len(cautious) / len(trials):.0%} | {bare} | {first} |"
    )


UNRELATED_FINDINGS: Final = frozenset({"rotation-unknown", "scale-unknown", "correlated", "stale-repeats"})
"""Findings that are not about an effect."""


def table(effects: Sequence[str], paths: Sequence[str], trials: int, processes: int) -> Iterator[str]:
    """Yield a row for each effect; for an effect that no single recording shows, a second row with a second place."""
    rows = [(name, places) for name in effects for places in ((1,) if EFFECTS[name].seen else (1, 2))]
    with ProcessPoolExecutor(processes) as pool:
        each = list(pool.map(partial(tried_on, rows=rows), cases_of(paths, trials)))
    yield HEAD
    for (name, places), tried_of in zip(rows, zip(*each, strict=True), strict=True):
        yield row(name if places == 1 else f"{name}; recorded elsewhere too", tried_of)


def cases_of(paths: Sequence[str], trials: int) -> list[tuple[str, int]]:
    """Paths with seeds, `trials` cases altogether."""
    return list(product(paths, range(-(-trials // len(paths)))))


def felt_table(effects: Sequence[str], paths: Sequence[str], trials: int, processes: int) -> Iterator[str]:
    """Yield for each effect the number of recordings with the finding `attitude-dependent`, by path."""
    yield "| effect | recordings | " + " | ".join(paths) + " |\n|---|---:|" + "---:|" * len(paths)
    with ProcessPoolExecutor(processes) as pool:
        for name in effects:
            cases = [(name, *case) for case in cases_of(paths, trials)]
            named = np.reshape(list(pool.map(is_named, cases, chunksize=4)), (len(paths), -1)).sum(axis=1)
            yield f"| {name} | {len(cases)} | " + " | ".join(map(str, named)) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=40, help="fits of each effect, over all paths")
    parser.add_argument("--effects", nargs="+", default=list(EFFECTS), choices=EFFECTS, metavar="EFFECT")
    parser.add_argument("--paths", nargs="+", default=list(PATHS), choices=PATHS, metavar="PATH")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--felt", action="store_true", help="with an accelerometer: count findings on the attitude")
    chosen = parser.parse_args(arguments)
    for line in (felt_table if chosen.felt else table)(chosen.effects, chosen.paths, chosen.trials, chosen.processes):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
