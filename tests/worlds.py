"""Simulated worlds that tests share: a sensor with known iron, turns, disturbances, motors, sensors on one body.

Each builder takes a seed, and returns a recording with its truth, or readings only.

>>> turn = level_turn(1, n=4)
>>> turn.samples.field.shape, turn.directions[:, 2].round(3).tolist()
((4, 3), [0.866, 0.866, 0.866, 0.866])
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from benchmarks.service_bodies import seen, tumbled

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.fitting.result import Fit, Refused
from flinders.geometry.ellipsoid import upper_entries
from flinders.geometry.rotation import rotations
from flinders.simulate import Sensor, Simulated, motions
from flinders.simulate import attitudes as body_attitudes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.joining import Joined
    from flinders.estimators import Estimate, Estimator

FIELD_STRENGTH: Final = 50.0
"""Field strength in µT in all these worlds."""
SOFT_IRON: Final = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])
HARD_IRON: Final = np.array([20.0, 120.0, 90.0])
"""Hard iron in mG; with `SOFT_IRON` it makes the sensor of the MAGYC simulations, whose field is in mG too."""
SWAPS: Final = {
    "x": np.diag([-1.0, 1.0, 1.0]),
    "y": np.diag([1.0, -1.0, 1.0]),
    "z": np.diag([1.0, 1.0, -1.0]),
    "xy": np.eye(3)[[1, 0, 2]],
    "yz": np.eye(3)[[0, 2, 1]],
    "zx": np.eye(3)[[2, 1, 0]],
}
"""Exchanges of axes, in the order of the engine; each is its own inverse."""
SIX_READINGS: Final = np.array(
    [
        [167.4, -242.4, 91.7],
        [140.3, -221.9, 86.8],
        [152.4, -230.4, -0.6],
        [180.3, -270.6, 71.0],
        [190.9, -212.4, 62.7],
        [192.9, -242.4, 17.1],
    ]
)
"""Readings of the worked example in NXP's AN4246 rev. 4."""
SENSOR: Final = Sensor(SOFT_IRON, np.array([20.0, -60.0, 30.0]), 0.5)
RANDOM_SENSOR: Final = Sensor.random(np.random.default_rng(7))
TUMBLED_SENSOR: Final = simulate.tumble(seed=2, motion="uniform").sensor
OFFSET_SENSOR: Final = Sensor(offset=np.array([20.0, 5.0, -30.0]), noise=0.5)
"""A sensor with hard iron only."""
PER_AMPERE: Final = np.array([0.5, 0.0, -0.3])
"""Offset of a motor in µT/A."""
MOTORS: Final = simulate.MotorCurrent(per_ampere=PER_AMPERE)
ARMS: Final = np.array([[0.5, 0.1, -0.3], [-0.4, 0.2, 0.3], [0.1, -0.5, 0.2], [0.2, 0.4, -0.4]])
"""Offsets of four motors in µT/A."""
TURNED: Final = rotations(np.array([[0.3, -0.2, 1.4]]))[0]
"""(3, 3) rotation from the axes of a second sensor on a body to those of the first."""


def table_text(header: str, table: Floats) -> str:
    """A recording as CSV text, with three decimals in each number."""
    rows = (",".join(f"{value:.3f}" for value in row) for row in table)
    return "\n".join([header, *rows, ""])


def write_field(path: str | Path, field: Floats) -> None:
    """Write (N, 3) readings in µT as CSV."""
    Path(path).write_text(table_text("mag_x_uT,mag_y_uT,mag_z_uT", field), encoding="utf-8")


def judged(field: Floats | Samples | Joined, **options: object) -> Fit:
    """A fit, even a refused one."""
    try:
        return flinders.fit(field, **options)  # type: ignore[arg-type]
    except Refused as error:
        return error.fit


def method_with(name: str, **options: object) -> Estimator:
    """A method with a name, and with its options."""
    return flinders.estimators.METHODS[name](**options)


def rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


class Streamed:
    """A recording that yields blocks of some rows, and counts how often it was read."""

    def __init__(self, samples: Samples, rows: int = 777) -> None:
        self.whole, self.rows, self.passes = samples, rows, 0
        self.source, self.unit, self.axes = samples.source, samples.unit, samples.axes

    def blocks(self) -> Iterator[Samples]:
        """Yield the blocks from the first one on."""
        self.passes += 1
        return self.whole.blocks(self.rows)


def spiral(sigma: float, *, half: bool = False) -> Floats:
    """500 directions on a Fibonacci spiral, or those of them with u_z > 0, with noise of one seed."""
    i = np.arange(500) + 0.5
    z = 1.0 - 2.0 * i / 500.0
    longitude, across = np.pi * (1.0 + np.sqrt(5.0)) * i, np.sqrt(1.0 - z * z)
    directions = np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)
    noise = np.random.default_rng(20240601).standard_normal((500, 3))
    field = 50.0 * directions @ SOFT_IRON.T + HARD_IRON + sigma * noise
    kept: Floats = field[z > 0] if half else field
    return kept


def level_turn(
    seed: int,
    headings_deg: Floats | None = None,
    *,
    n: int = 600,
    noise: float = 0.5,
    dip_deg: float = 60.0,
    mounted: Sequence[float] = (0.0, 0.0, 0.0),
) -> Simulated:
    """A level turn of a random sensor, in order of time; `mounted` is a rotation vector in degrees."""
    rng = np.random.default_rng(seed)
    sensor = Sensor.random(rng, noise=noise)
    headings = np.linspace(0.0, 360.0, n, endpoint=False) if headings_deg is None else headings_deg
    attitudes = simulate.turns(np.outer(np.radians(headings), [0.0, 0.0, 1.0]))
    attitudes = attitudes @ simulate.turns([np.radians(mounted)])
    directions = simulate.in_body_axes(attitudes, simulate.north_and_down(dip_deg))
    raw = sensor.read(FIELD_STRENGTH * directions, rng)
    strays = np.zeros(len(headings), dtype=np.bool_)
    return Simulated(Samples.of(raw, unit="uT"), sensor, directions, FIELD_STRENGTH, strays)


def moved_alike(seed: int, share: float, moved: Floats) -> Floats:
    """(500, 3) readings of `SENSOR` in all directions, of which the first share is moved by one vector."""
    field = simulate.tumble(seed=seed, motion="uniform", n=500, sensor=SENSOR).samples.field.copy()
    field[: round(share * 500)] += moved
    return field


def passed_by_a_magnet(rows: slice) -> tuple[Simulated, Samples]:
    """A tumble by hand, and the same while a magnet passes: 40 µT along one direction of the world."""
    truth = simulate.tumble(seed=3, sensor=SENSOR)
    field = truth.samples.field.copy()
    assert truth.attitudes is not None
    field[rows] += 40.0 * truth.attitudes[rows, 2] @ SENSOR.matrix.T
    return truth, Samples.of(field, unit="uT", time=truth.samples.time)


def body(
    seed: int = 1, *, motion: str = "hand", n: int = 1500, noises: tuple[float, ...] = (0.5, 0.5), same: bool = False
) -> tuple[dict[str, Samples], list[Sensor], Floats]:
    """Recordings of sensors on one body, and the true direction of the field; all but the first sensor are `TURNED`."""
    rng = np.random.default_rng([seed, 17])
    path = simulate.tumble(seed=seed, motion=motion, n=n)
    recordings, sensors = {}, []
    for number, noise in enumerate(noises):
        sensor = replace(Sensor.random(rng, noise=noise), noise=noise)
        turn = np.eye(3) if number == 0 or same else TURNED
        field = sensor.read(FIELD_STRENGTH * path.directions @ turn, rng)
        recordings["abcd"[number]] = Samples.of(field, unit="uT", time=path.samples.time, source="abcd"[number])
        sensors.append(sensor)
    return recordings, sensors, path.directions


def with_slow_noise(field: Floats, *, sigma: float, memory: float, seed: int = 1) -> Floats:
    """(N, 3) readings with an Ornstein–Uhlenbeck disturbance of each axis, with `memory` readings as time constant."""
    decay = np.exp(-1.0 / memory)
    steps = np.sqrt(1.0 - decay**2) * np.random.default_rng(seed).normal(size=field.shape)
    course = np.zeros_like(field)
    for row in range(1, len(field)):
        course[row] = decay * course[row - 1] + steps[row]
    return field + sigma * course


def carried_about(seed: int, *, varies: float, turns: float, rows: int = 900, noise: float = 0.3) -> Samples:
    """A sensor that is turned while it is carried through a field; the field varies by a fraction (rms) of itself."""
    rng = np.random.default_rng([seed, round(1000 * varies), round(10 * turns)])
    rate = motions.smooth_noise(rng, rows, 1.0 - 3.0 * max(turns, 1.0) / rows)
    rate *= 2.0 * np.pi * turns / np.linalg.norm(rate, axis=1).sum()
    place = np.cumsum(motions.smooth_noise(rng, rows, 1.0 - 20.0 / rows), axis=0)
    place = (place - place.mean(axis=0)) / place.std()
    waves = [(rng.normal(size=3), 0.7 * rng.normal(size=3), rng.uniform(0.0, 6.0)) for _ in range(5)]
    iron = np.sum([np.outer(np.sin(place @ along + phase), size) for size, along, phase in waves], axis=0)
    iron -= iron.mean(axis=0)
    iron *= varies * FIELD_STRENGTH / np.sqrt(np.mean(np.sum(iron**2, axis=1)))
    attitudes = body_attitudes.integrate_steps(body_attitudes.random_attitude(rng), body_attitudes.turns(rate))
    world = FIELD_STRENGTH * body_attitudes.north_and_down(60.0) + iron
    sensor = Sensor(np.eye(3) + rng.normal(scale=0.05, size=(3, 3)), rng.normal(scale=12.0, size=3), noise)
    field = sensor.read(np.einsum("nji,nj->ni", attitudes, world), rng)
    return Samples.of(field, unit="uT", time=np.arange(rows) / 50.0)


def walked_days(
    seed: int, *, days: float, walk: float, every_s: tuple[float, float] = (1800.0, 3600.0), rate_hz: float = 4.0
) -> tuple[Floats, Floats, Floats, Floats]:
    """Days of a sensor that is sometimes tumbled for half a minute, and whose offset walks by µT per root hour.

    Returns (N,) times in s, (N, 3) readings in µT, (k,) start times of tumbles in s, and (k, 3) offsets at these times.
    """
    rng = np.random.default_rng(seed)
    begins, now = list[float](), 0.0
    while now < days * 86400.0:
        begins.append(now)
        now += float(rng.uniform(*every_s))
    steps = rng.normal(0.0, walk, (len(begins), 3)) * np.sqrt(np.diff(begins, prepend=0.0) / 3600.0)[:, np.newaxis]
    offsets = HARD_IRON / 10.0 + np.cumsum(steps, axis=0)
    times, fields = [], []
    for number, (begin, offset) in enumerate(zip(begins, offsets, strict=True)):
        seconds = np.arange(0.0, 30.0 if number else 120.0, 1.0 / rate_hz)
        field = seen(tumbled(rng, seconds), np.array([25.0, 0.0, 43.3])) + offset
        times.append(begin + seconds)
        fields.append(field + rng.normal(0.0, 0.3, field.shape))
    return np.concatenate(times), np.concatenate(fields), np.array(begins), offsets


def true_parameters(truth: Simulated) -> Floats:
    """(9,) offset and entries of F W⁻¹ that a perfect fit finds."""
    matrix, offset = truth.sensor.correction
    return np.concatenate([offset, upper_entries(truth.field_strength * np.linalg.inv(matrix))])


def errors(found: Estimate, truth: Simulated) -> Floats:
    """(9,) errors of a fit's parameters."""
    wanted = true_parameters(truth)
    return np.concatenate([found.ellipsoid.centre, upper_entries(found.ellipsoid.shape)]) - wanted
