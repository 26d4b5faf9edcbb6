"""Simulated recordings that measure accuracy, and the Cramér–Rao bound of each.

A data set has a name, a trial and a noise of the sensor. Truth and motion are the same for every noise. Other software
is measured with S1 … S8 too, so their random numbers must never change.

>>> recording = dataset("S1", trial=0, sigma=0.5)
>>> len(recording.samples), recording.samples.source
(500, 'S1, trial 0')
>>> bound(recording).angle_deg                 # no unbiased estimator has a smaller rms angle error
0.107
>>> matrix, offset = recording.sensor.correction
>>> bool(np.allclose(parameter_error(matrix, offset, recording), 0.0))
True

========================= ===========================================================================
``S1``                    500 readings, uniform directions
``S2``                    5,000 readings, uniform directions
``S3``                    tumbled by hand for 60 s at 50 Hz
``S4``                    2,000 readings, all headings, tilted by up to 35°
``S5``                    S1 with 3 % gross outliers
``S6``                    S1 and 750 more readings, 60 % of all, within 3° of one direction
``S7``                    1,000 readings of a level turn
``S8``                    S2 in steps of 0.3 µT
``strong iron``           500 readings; scale ± 40 %, ± 0.25 across, offset up to ten field strengths
``60 coarse samples``     60 readings in steps of 1.5 µT
``one hemisphere``        1,000 readings, all directions of one hemisphere
========================= ===========================================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders import simulate
from flinders.core.samples import Samples
from flinders.simulate import Sensor, Simulated

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.random import Generator

    from flinders.arrays import Floats

FIELD_STRENGTH: Final = 50.0
"""Field strength in µT."""

FIELD: Final = simulate.north_and_down(60.0)
SEED: Final = 20240607
ENTRIES: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Order of the entries of F · A, which follow the three of the offset in the nine parameters, all in µT."""


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """(N, 3) directions of the field; (N,) times, (N, 3) accelerations and (N, 3) rates if recorded."""

    directions: Floats
    time: Floats | None = None
    acceleration: Floats | None = None
    rate: Floats | None = None


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a data set is made; data sets with the same number `stream` share truth and motion."""

    stream: int
    path: Callable[[Generator], Path]
    sensor: Callable[[Generator, float], Sensor] = lambda rng, sigma: Sensor.random(rng, noise=sigma)
    outliers: float = 0.0
    sigmas: tuple[float, ...] | None = None  # noises in µT; None for those of the table


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Cramér–Rao bound: the accuracy of the best unbiased estimator.

    Attributes
    ----------
    angle_deg : float
        Root mean square angle error over 400 directions; NaN if the recording does not determine all nine parameters.
    information : (9, 9) float, µT⁻²
        Fisher information of offset and F · A, in the order of `ENTRIES`.
    """

    angle_deg: float
    information: Floats


def dataset(name: str, trial: int, sigma: float) -> Simulated:
    """Simulate a recording; `sigma` is the white noise of each axis in µT."""
    recipe = SETS[name]
    rng = np.random.default_rng([SEED, recipe.stream, trial])
    sensor = recipe.sensor(rng, sigma)
    path = recipe.path(rng)
    raw = sensor.read(FIELD_STRENGTH * path.directions, rng)
    fields, outliers = simulate.stray_fields(rng, len(raw), recipe.outliers)
    raw[outliers] += fields[outliers] * FIELD_STRENGTH
    samples = Samples.of(
        raw,
        unit="uT",
        time=path.time,
        acceleration=path.acceleration,
        rate=path.rate,
        source=f"{name}, trial {trial}",
    )
    return Simulated(samples, sensor, path.directions, FIELD_STRENGTH, outliers)


def bound(recording: Simulated) -> Bound:
    """Cramér–Rao bound of a recording with a symmetric true matrix; outliers are left out.

    The N true directions are unknown parameters too. They are eliminated (Schur complement), which leaves one component
    of each reading: that along the normal of the surface.
    """
    matrix = np.asarray(recording.sensor.matrix)
    directions = recording.directions[~recording.outliers]
    normals = directions @ np.linalg.inv(matrix)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gradients = np.einsum("ni,nik->nk", normals, _moved_by(directions))
    information = gradients.T @ gradients / recording.sensor.sigma**2
    return Bound(_angle_deg(matrix, information), information)


def parameter_error(matrix: Floats, offset: Floats, recording: Simulated) -> Floats:
    """(9,) errors in µT of a (3,) offset and of F · A of a (3, 3) matrix with ``|corrected| = F``."""
    values, axes = np.linalg.eigh(matrix.T @ matrix)
    shape = (axes / np.sqrt(values)) @ axes.T - recording.sensor.matrix
    entries = [recording.field_strength * shape[row, column] for row, column in ENTRIES]
    return np.concatenate([offset - recording.sensor.offset, entries])


def heading_error_deg(matrix: Floats, offset: Floats, recording: Simulated) -> float:
    """Rms heading error of a level turn in degrees, minus the mean error, which a level turn cannot determine."""
    headings = np.arange(360) * (2 * np.pi / 360)
    turn = simulate.turns(np.outer(headings, [0.0, 0.0, 1.0]))
    field = FIELD_STRENGTH * simulate.in_body_axes(turn, FIELD)
    corrected = (field @ recording.sensor.matrix.T + recording.sensor.offset - offset) @ matrix.T
    phasors = np.exp(1j * (np.arctan2(-corrected[:, 1], corrected[:, 0]) - headings))
    errors = np.angle(phasors / np.mean(phasors))
    return math.degrees(math.sqrt(np.mean(errors**2)))


def _moved_by(directions: Floats) -> Floats:
    """(N, 3, 9) derivatives of readings with respect to each parameter, at (N, 3) directions of the field."""
    moved = np.zeros((len(directions), 3, 9))
    moved[:, :, :3] = np.eye(3)
    for index, (row, column) in enumerate(ENTRIES, start=3):
        moved[:, row, index] = directions[:, column]
        moved[:, column, index] = directions[:, row]
    return moved


def _angle_deg(matrix: Floats, information: Floats) -> float:
    """Angle error over 400 directions in degrees, by the Fisher information."""
    if np.linalg.cond(information) > 1e12:
        return math.nan
    true = simulate.fibonacci(400)
    moved = np.einsum("ij,njk->nik", np.linalg.inv(matrix), _moved_by(true)) / FIELD_STRENGTH
    across = np.eye(3) - np.einsum("ni,nj->nij", true, true)
    turned = across @ moved
    square = np.einsum("nij,jk,nik->", turned, np.linalg.inv(information), turned) / len(true)
    return math.degrees(math.sqrt(square))


def _by_hand(rng: Generator) -> Path:
    """Tumble by hand with an accelerometer and a gyro; the gyro has a bias."""
    turning = simulate.hand_tumble(rng)
    bias = rng.normal(0, 0.01, 3)
    rate = turning.rate + bias + rng.normal(0, simulate.RATE_NOISE, turning.rate.shape)
    acceleration = simulate.specific_force(turning.attitudes, rng)
    return Path(simulate.in_body_axes(turning.attitudes, FIELD), turning.time, acceleration, rate)


def _strong_iron(rng: Generator, sigma: float) -> Sensor:
    """Sensor with strong iron; its offset has any direction and up to ten field strengths."""
    matrix = simulate.soft_iron(rng, scale=0.4, across=0.25)
    offset = simulate.uniform_directions(rng, 1)[0] * rng.uniform(0, 10 * FIELD_STRENGTH)
    return Sensor(matrix, offset, noise=sigma)


def _stepped(resolution: float) -> Callable[[Generator, float], Sensor]:
    """Function that makes a sensor whose readings are multiples of a step in µT."""
    return lambda rng, sigma: Sensor.random(rng, noise=sigma, resolution=resolution)


def _uniform(n: int) -> Callable[[Generator], Path]:
    """Function that makes a path of n uniform directions."""
    return lambda rng: Path(simulate.uniform_directions(rng, n))


SETS: Final[Mapping[str, Recipe]] = {
    "S1": Recipe(0, _uniform(500)),
    "S2": Recipe(1, _uniform(5000)),
    "S3": Recipe(2, _by_hand),
    "S4": Recipe(3, lambda rng: Path(simulate.in_body_axes(simulate.tilted(rng, 2000), FIELD))),
    "S5": Recipe(0, _uniform(500), outliers=0.03),
    "S6": Recipe(5, lambda rng: Path(simulate.clumped_directions(rng, 1250))),
    "S7": Recipe(6, lambda rng: Path(simulate.in_body_axes(simulate.level_turn(rng, 1000), FIELD))),
    "S8": Recipe(1, _uniform(5000), sensor=_stepped(0.3)),
    "strong iron": Recipe(8, _uniform(500), sensor=_strong_iron),
    "60 coarse samples": Recipe(9, _uniform(60), sensor=_stepped(1.5), sigmas=(0.5,)),
    "one hemisphere": Recipe(10, lambda rng: Path(simulate.hemisphere(rng, 1000))),
}
