"""A simulated recording with its truth: a sensor, a motion and disturbances, from one seed.

`lines` writes it as a logger does, with a header that `flinders.readers` recognises:

>>> header, *rows = lines(tumble(seed=1, motion="level", n=2).samples)
>>> header
'time_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x_mps2,acc_y_mps2,acc_z_mps2'
>>> [row.split(",")[0] for row in rows]
['0.0000', '0.0200']
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.arrays import check_matrix as square
from flinders.arrays import check_triple, read_only_copy
from flinders.core.files import open_atomically
from flinders.core.named_columns import are_words
from flinders.core.samples import Samples
from flinders.core.short_repr import ShortRepr
from flinders.errors import UsageError
from flinders.geometry.rotation import best_rotation
from flinders.geometry.sphere import fibonacci
from flinders.simulate._checks import count, not_negative, positive, share
from flinders.simulate.attitudes import in_body_axes, north_and_down
from flinders.simulate.disturbances import Effect, stray_fields
from flinders.simulate.motions import GRAVITY, MOTIONS, RATE_HZ, Course, Motion, Path
from flinders.simulate.sensor import Sensor, symmetric_power

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence

    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.simulate.disturbances import Perturbation

ACCELERATION_NOISE: Final = 0.05
"""Default noise of an accelerometer in m/s², one σ per axis."""

RATE_NOISE: Final = 0.005
"""Default noise of a gyro in rad/s, one σ per axis."""

UNTIMED_READINGS: Final = 1000
"""Default count of readings of a motion without a duration."""

PAUSE_COUNT: Final = 3
"""Count of pauses, if a share of the readings is at rest."""


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """Gyro and accelerometer of a magnetometer, in its axes.

    Raises
    ------
    ArrayError, UsageError
        For a bias that is not three finite numbers, or negative noise.
    """

    gyro_bias: Floats = field(default_factory=lambda: np.zeros(3))  #: (3,), rad/s: reading of the gyro at rest
    gyro_noise: float = RATE_NOISE  #: rad/s: one σ per axis
    acceleration_noise: float = ACCELERATION_NOISE  #: m/s²: one σ per axis

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "gyro_bias", read_only_copy(check_triple(self.gyro_bias, "gyro_bias")))
        not_negative(self.gyro_noise, "gyro_noise", "rad/s")
        not_negative(self.acceleration_noise, "acceleration_noise", "m/s²")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulated(ShortRepr):
    """A simulated recording with its truth."""

    samples: Samples  #: readings in µT, with acceleration and rate if the motion has them
    sensor: Sensor  #: the simulated sensor
    directions: Floats  #: (N, 3): true unit direction of the field in body axes
    field_strength: float  #: µT: strength of the field
    outliers: NDArray[np.bool_]  #: (N,): whether the reading was taken in a stray field
    #: (N, 3, 3): true attitudes, from body axes into world axes, if the motion has them
    attitudes: Floats | None = None
    dip_deg: float = 60.0  #: inclination of the field
    motion: str = ""  #: name of the motion
    seed: int | None = None  #: seed, if it was a number
    rate_hz: float | None = None  #: readings per second
    imu: Imu | None = None  #: if acceleration or rate are recorded
    shift: Floats | None = None  #: (N, 3), µT: effect of disturbances on the raw readings, without stray fields
    disturbances: tuple[str, ...] = ()  #: kinds of the disturbances


def tumble(
    seed: int | Generator = 0,
    *,
    motion: str | Motion = "hand",
    n: int | None = None,
    rate_hz: float = RATE_HZ,
    tilt_deg: float | None = None,
    stationary: float = 0.0,
    sensor: Sensor | None = None,
    field_strength: float = 50.0,
    dip_deg: float = 60.0,
    noise: float | None = None,
    outliers: float = 0.0,
    disturbances: Sequence[Perturbation] = (),
    imu: Imu | None = None,
) -> Simulated:
    """Simulate a recording of a moving sensor.

    Sensor, motion, stray fields, noise, pauses and each disturbance have separate random streams: with the same seed, a
    change of noise, share of outliers or disturbances does not change the sensor and its path.

    Raises `UsageError` for an unknown motion, or a number out of its range.

    Parameters
    ----------
    seed : int or Generator
        The same seed gives the same recording.
    motion : str or Motion
        One of `MOTIONS`, see the head of this package; or another `Motion`.
    n : int, optional
        Count of readings. By default it follows from the duration of the motion, 3,000 for a minute by hand; it is
        1,000 for a motion in random order.
    tilt_deg : float, optional
        Largest tilt of the body, for motions with such a limit.
    stationary : float
        Share of the readings, 0 … 1, at which the body is held still, in three pauses.
    sensor : Sensor, optional
        By default `Sensor.random`.
    field_strength, dip_deg : float, µT and degrees
        Strength and inclination of the field; the inclination matters for motions with attitudes.
    noise : float, µT, optional
        Noise in place of that of the sensor; 0.5 by default for a random sensor.
    outliers : float
        Share of readings, 0 … 1, taken in a stray field of half to three times `field_strength` in any direction.
    imu : Imu, optional
        Gyro and accelerometer in place of the default ones.

    Examples
    --------
    >>> level = tumble(seed=3, motion="level", n=200, sensor=Sensor(), dip_deg=70)
    >>> float(np.ptp(level.samples.field[:, 2]))       # a level sensor never leaves its plane
    0.0
    >>> int(tumble(n=500, outliers=0.03).outliers.sum())
    15
    """
    course = _course_of(motion, n, positive(rate_hz, "rate_hz"), dip_deg, tilt_deg)
    of_sensor, of_motion, of_outliers, of_noise = np.random.default_rng(seed).spawn(4)
    of_pauses, *of_disturbances = of_noise.spawn(1 + len(disturbances))
    sensor, imu = _sensor(sensor, noise, of_sensor), imu or Imu()
    kind, name = (MOTIONS[motion], motion) if isinstance(motion, str) else (motion, "motion")
    path = _path_with_pauses(of_pauses, kind.draw, of_motion, course, share(stationary, "stationary"))
    stray, is_outlier = stray_fields(of_outliers, course.n, outliers)
    time = np.arange(course.n) / course.rate_hz
    effects = [one.on(time, rng) for one, rng in zip(disturbances, of_disturbances, strict=True)]
    shift = _total([effect.shift for effect in effects])
    true = positive(field_strength, "field_strength") * (path.directions * _gain(effects, course.n) + stray)
    raw = sensor.read(true, of_noise, shift=shift)
    return Simulated(
        _samples(raw, time, path, imu, effects, of_noise, source=f"simulated {name}"),
        sensor,
        path.directions,
        field_strength,
        _combined_outliers(is_outlier, effects),
        path.attitudes,
        dip_deg=float(dip_deg),
        motion=name,
        seed=seed if isinstance(seed, int) else None,
        rate_hz=float(rate_hz),
        imu=None if path.attitudes is None else imu,
        shift=shift,
        disturbances=tuple(one.kind for one in disturbances),
    )


def specific_force(
    attitudes: Floats, rng: Generator, *, noise: float = ACCELERATION_NOISE, acceleration: Floats | None = None
) -> Floats:
    """(N, 3) readings of an accelerometer in m/s², with noise: −g on z if level and at rest.

    `acceleration` is that of the body, (N, 3) m/s² in world axes; None if it turns on the spot.

    >>> specific_force(np.eye(3)[np.newaxis], np.random.default_rng(0)).round(1)
    array([[ 0. ,  -0. ,  -9.8]])
    """
    felt = in_body_axes(attitudes, np.array([0.0, 0.0, -GRAVITY]))
    if acceleration is not None:
        felt = felt + np.einsum("nji,nj->ni", attitudes, acceleration)
    return felt + rng.normal(0.0, noise, felt.shape)


def angle_error_deg(
    matrix: ArrayLike,
    offset: ArrayLike,
    truth: Simulated,
    *,
    rotation: Literal["symmetric", "best"] = "symmetric",
) -> float:
    """Rms angle in degrees between true and corrected field, over 400 directions spread evenly.

    An ellipsoid determines only the symmetric root (MᵀM)^½ of the (3, 3) matrix M, which is therefore used; the scale
    has no effect. With ``rotation="symmetric"`` the `Sensor.rotation` counts as an error, as it does for headings. With
    ``"best"`` the rotation that fits best is removed first, for sensors whose matrix is not symmetric.

    Raises `ArrayError` for a wrong shape or values that are not finite.

    Examples
    --------
    >>> recording = tumble(sensor=Sensor(matrix=[[1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    >>> angle_error_deg(*recording.sensor.correction, recording)
    2.3
    >>> angle_error_deg(*recording.sensor.correction, recording, rotation="best")
    0.0
    """
    root = symmetric_power(square(matrix).T @ square(matrix), 0.5)
    true = fibonacci(400)
    raw = truth.field_strength * true @ truth.sensor.matrix.T + truth.sensor.offset
    corrected = (raw - check_triple(offset)) @ root
    if rotation == "best":
        corrected = corrected @ best_rotation(corrected, true).T
    across = np.linalg.norm(np.cross(corrected, true), axis=1)
    angles = np.arctan2(across, np.sum(corrected * true, axis=1))
    return math.degrees(math.sqrt(np.mean(angles**2)))


def _course_of(motion: str | Motion, n: int | None, rate_hz: float, dip_deg: float, tilt_deg: float | None) -> Course:
    """Course of a motion, with its parameters checked."""
    if isinstance(motion, str) and motion not in MOTIONS:
        raise UsageError(f"motion {motion!r} is not known: use one of {', '.join(MOTIONS)}")
    kind = MOTIONS[motion] if isinstance(motion, str) else motion
    usual = UNTIMED_READINGS if kind.seconds is None else round(kind.seconds * rate_hz)
    if tilt_deg is not None and kind.tilt_deg is None:
        limited = [name for name, other in MOTIONS.items() if other.tilt_deg is not None]
        raise UsageError(f"tilt applies only to the motions {', '.join(limited)}: leave it out for {motion}")
    if tilt_deg is not None and not 0.0 <= tilt_deg <= 90.0:
        raise UsageError(f"tilt is {tilt_deg:g}°: need 0° to 90°")
    if not -90.0 <= dip_deg <= 90.0:
        raise UsageError(f"dip is {dip_deg:g}°: need −90° to 90°")
    return Course(count(usual if n is None else n), rate_hz, north_and_down(dip_deg), tilt_deg)


def _sensor(sensor: Sensor | None, noise: float | None, rng: Generator) -> Sensor:
    """The given sensor or a random one, with its noise replaced by `noise` if given."""
    sensor = Sensor.random(rng) if sensor is None else sensor
    return sensor if noise is None else replace(sensor, noise=noise)


def _path_with_pauses(
    of_pauses: Generator, draw: Callable[[Generator, Course], Path], rng: Generator, course: Course, stationary: float
) -> Path:
    """Draw a path in which the body is held still for a share of the readings."""
    still = min(round(stationary * course.n), course.n - 1)
    if still == 0:
        return draw(rng, course)
    path = draw(rng, replace(course, n=course.n - still))
    pauses = of_pauses.integers(0, course.n - still, PAUSE_COUNT)
    rows = np.sort(np.concatenate([np.arange(course.n - still), np.resize(pauses, still)]))
    moving = np.append(np.diff(rows) > 0, True)[:, np.newaxis]
    return Path(
        path.directions[rows],
        None if path.attitudes is None else path.attitudes[rows],
        None if path.rate is None else path.rate[rows] * moving,
        None if path.acceleration is None else path.acceleration[rows] * moving,
    )


def _samples(
    raw: Floats, time: Floats, path: Path, imu: Imu, effects: Sequence[Effect], rng: Generator, *, source: str
) -> Samples:
    """Samples with the readings and those of the other instruments."""
    return Samples.of(
        raw,
        unit="uT",
        time=time,
        acceleration=_acceleration(path, imu, rng),
        rate=_rate(path, imu, rng),
        temperature=_last(effects, "temperature"),
        current=_total([effect.current for effect in effects]),
        currents=_last(effects, "currents"),
        auxiliary={name: values for effect in effects for name, values in effect.auxiliary.items()},
        source=source,
    )


def _acceleration(path: Path, imu: Imu, rng: Generator) -> Floats | None:
    """(N, 3) readings of the accelerometer; None without attitudes."""
    if path.attitudes is None:
        return None
    return specific_force(path.attitudes, rng, noise=imu.acceleration_noise, acceleration=path.acceleration)


def _rate(path: Path, imu: Imu, rng: Generator) -> Floats | None:
    """(N, 3) readings of the gyro; None without rates."""
    if path.rate is None:
        return None
    return path.rate + imu.gyro_bias + imu.gyro_noise * rng.standard_normal(path.rate.shape)


def _gain(effects: Sequence[Effect], n: int) -> Floats:
    """(n, 1) factor on the earth's field."""
    gains = [effect.gain for effect in effects if effect.gain is not None]
    product: Floats = np.prod([np.ones(n), *gains], axis=0)
    return product[:, np.newaxis]


def _combined_outliers(is_outlier: NDArray[np.bool_], effects: Sequence[Effect]) -> NDArray[np.bool_]:
    """(N,) outliers by a stray field or any disturbance."""
    marked: NDArray[np.bool_] = np.logical_or.reduce(
        [is_outlier, *(effect.outliers for effect in effects if effect.outliers is not None)]
    )
    return marked


def _last(effects: Sequence[Effect], name: str) -> Floats | None:
    """Column of the last effect that has this column, because there is only one thermometer."""
    columns = [column for effect in effects if (column := getattr(effect, name)) is not None]
    return columns[-1] if columns else None


def _total(columns: Sequence[Floats | None]) -> Floats | None:
    """Sum of the columns that are not None: of shifts, or of currents, because one meter measures all motors."""
    there = [column for column in columns if column is not None]
    total: Floats | None = np.sum(there, axis=0) if there else None
    return total


DIGITS: Final = 4
"""Count of decimals of all numbers: 0.1 nT, 0.1 ms, 0.0001 rad/s."""


def lines(samples: Samples, *, corrected: Floats | None = None) -> Iterator[str]:
    """Yield header and rows, without line ends; numbers have four decimals, so that all machines write the same text.

    `corrected`, (N, 3) in the unit of the samples, adds three columns with names that end in ``_cal``.
    """
    columns = samples.as_columns()
    if corrected is not None:
        columns |= {f"mag_{axis}_{samples.unit.inside}_cal": corrected[:, i] for i, axis in enumerate("xyz")}
    yield ",".join(columns)
    yield from map(",".join, zip(*map(_cells, columns.values()), strict=True))


def _cells(values: NDArray[Any]) -> list[str]:
    """(N,) values as text: words unchanged, numbers with `DIGITS` decimals."""
    if are_words(values):
        return [str(value) for value in values.tolist()]
    return [f"{value:.{DIGITS}f}" for value in np.round(values, DIGITS) + 0.0]


def write_csv(samples: Samples, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a recording atomically; raises as `flinders.core.files.open_atomically`."""
    with open_atomically(path, force=force) as file:
        file.writelines(f"{line}\n" for line in lines(samples))
