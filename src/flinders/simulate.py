"""Recordings with known truth: a sensor and its iron, a motion, noise, all from one seed.

One line gives a recording, and what a perfect fit would find in it:

>>> recording = tumble(seed=1)
>>> len(recording.samples), recording.samples.unit.inside, recording.field_strength
(3000, 'uT', 50.0)
>>> matrix, offset = recording.sensor.correction
>>> corrected = (recording.samples.field - offset) @ matrix.T
>>> float(np.linalg.norm(corrected, axis=1).std())      # only the noise is left
0.5
>>> angle_error_deg(matrix, offset, recording)
0.0
>>> angle_error_deg(matrix, offset + [1, 0, 0], recording)
0.9

Truth is ``raw = A h + b + n`` of DESIGN.md §2. World axes are north, east, down; body axes forward,
right, down; an attitude turns body axes into world axes.

Which motion when:

============== =============================================== ============ ====
``hand``       tumbled by hand for a minute, smooth in time    acceleration rate
``uniform``    all directions alike: the best there is
``tilted``     all headings, tilted by up to 35°: a vehicle    acceleration
``level``      all headings, level: no 3-D fit can be right    acceleration
``hemisphere`` the field never comes from above: a robot
``clumped``    held still for most of the time
============== =============================================== ============ ====
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from flinders.arrays import Floats, table, vectors
from flinders.arrays import matrix as square
from flinders.coverage import around_z
from flinders.coverage import fibonacci as fibonacci  # noqa: PLC0414  whoever simulates finds it here too
from flinders.errors import ArrayError, UsageError
from flinders.samples import Samples

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

GRAVITY: Final = 9.81
"""m/s²."""

ACCELERATION_NOISE: Final = 0.05
"""m/s², one σ per axis."""

RATE_NOISE: Final = 0.005
"""rad/s, one σ per axis."""

RATE_HZ: Final = 50.0

SETTLING: Final = 200
"""Steps of the random walk before its start is forgotten."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """A magnetometer and the iron around it: ``raw = matrix @ h + offset + noise``, then rounded and limited.

    Attributes
    ----------
    matrix : (3, 3) float, dimensionless
        Soft iron, scale and misalignment; need not be symmetric.
    offset : (3,) float, µT
        Hard iron: what the sensor reads in zero field.
    noise : float, µT
        One σ per axis, white.
    resolution : float, µT, optional
        Step of the converter; readings are multiples of it.
    limit : float, µT, optional
        Where each axis saturates.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, or a matrix that is singular or mirrors.
    UsageError
        For negative noise, or a resolution or limit that is not positive.

    Examples
    --------
    >>> Sensor(offset=[20, 120, 90]).read([[50, 0, 0]], np.random.default_rng(0))
    array([[ 70., 120.,  90.]])
    """

    matrix: Floats = field(default_factory=lambda: np.eye(3))
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    noise: float = 0.0
    resolution: float | None = None
    limit: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of the arrays."""
        object.__setattr__(self, "matrix", _frozen(_unmirrored(square(self.matrix))))
        object.__setattr__(self, "offset", _frozen(_triple(self.offset)))
        if not (math.isfinite(self.noise) and self.noise >= 0):
            raise UsageError(f"noise is {self.noise:g} µT: need zero or more")
        for name, value in (("resolution", self.resolution), ("limit", self.limit)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"{name} is {value:g} µT: need a positive number, or None")

    @classmethod
    def random(
        cls,
        rng: Generator,
        *,
        strength: float = 1.0,
        noise: float = 0.5,
        resolution: float | None = None,
        limit: float | None = None,
    ) -> Self:
        """Draw a sensor like those on small boards: symmetric A, ±25 % scale, ±0.15 across, ±100 µT an axis.

        Parameters
        ----------
        rng : Generator
            Nine draws: three scales, three across, three offsets.
        strength : float
            Factor on all of it: zero is a perfect sensor, below 1.8 the matrix is sure to be positive definite.
        noise, resolution, limit : float, µT
            As the attributes of the same name.

        Raises
        ------
        UsageError
            Unless 0 ≤ `strength` < 1.8.

        Examples
        --------
        >>> Sensor.random(np.random.default_rng(1), strength=0.1).matrix.round(3)
        array([[ 1.001,  0.013, -0.006],
               [ 0.013,  1.023, -0.002],
               [-0.006, -0.002,  0.982]])
        """
        if not 0.0 <= strength < 1.8:
            raise UsageError(f"strength is {strength:g}: need at least 0 and less than 1.8")
        matrix = soft_iron(rng, scale=0.25 * strength, across=0.15 * strength)
        return cls(matrix, rng.uniform(-100.0, 100.0, 3) * strength, noise, resolution, limit)

    def read(self, field: ArrayLike, rng: Generator) -> Floats:
        """Read a field.

        Parameters
        ----------
        field : (N, 3) array-like, µT
            True field in the axes of the body.
        rng : Generator
            For the noise; the same number of draws whatever `noise` is.

        Returns
        -------
        (N, 3) float, µT

        Raises
        ------
        ArrayError
            For a wrong shape or values that are not finite.
        """
        true = table(field)
        raw = true @ self.matrix.T + self.offset + self.noise * rng.standard_normal(true.shape)
        if self.resolution is not None:
            raw = np.round(raw / self.resolution) * self.resolution
        return raw if self.limit is None else np.clip(raw, -self.limit, self.limit)

    @property
    def sigma(self) -> float:
        """Noise of a reading in µT, one σ per axis: white noise, and that of rounding, resolution/√12.

        >>> Sensor(noise=0.5, resolution=1.5).sigma
        0.661
        """
        return math.hypot(self.noise, (self.resolution or 0.0) / math.sqrt(12.0))

    @property
    def correction(self) -> tuple[Floats, Floats]:
        """(3, 3) symmetric W and (3,) offset in µT with ``|W (raw − offset)| = |h|``, but for the noise.

        W = (A Aᵀ)^(−½), as then |W A h|² = hᵀ Aᵀ (A Aᵀ)⁻¹ A h = |h|². It is A⁻¹ where A is symmetric
        and positive definite; else it leaves `rotation`.

        >>> Sensor(matrix=np.diag([1.25, 1.0, 0.8])).correction[0]
        array([[0.8 , 0.  , 0.  ],
               [0.  , 1.  , 0.  ],
               [0.  , 0.  , 1.25]])
        """
        return _symmetric_power(self.matrix @ self.matrix.T, -0.5), self.offset

    @property
    def rotation(self) -> Floats:
        """(3, 3) the rotation W A that remains after `correction`, which no magnetometer alone can know.

        >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> np.allclose(Sensor(matrix=np.diag([2.0, 3.0, 4.0]) @ quarter).rotation, quarter)
        True
        """
        return self.correction[0] @ self.matrix


@dataclass(frozen=True, slots=True, eq=False)
class Turning:
    """How a body turns.

    Attributes
    ----------
    time : (N,) float, s
    attitudes : (N, 3, 3) float
        Rotations from body axes into world axes (north, east, down).
    rate : (N, 3) float, rad/s
        Angular rate in body axes: constant from each instant to the next.
    """

    time: Floats
    attitudes: Floats
    rate: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """A recording, and the truth behind it.

    Attributes
    ----------
    samples : Samples
        In µT; acceleration and rate where the motion has them.
    sensor : Sensor
    directions : (N, 3) float
        True unit direction of the field in body axes.
    field_strength : float, µT
    strays : (N,) bool
        Readings taken in a stray field: those of no use.
    attitudes : (N, 3, 3) float, optional
        True attitudes, from body axes into world axes, where the motion has them.
    """

    samples: Samples
    sensor: Sensor
    directions: Floats
    field_strength: float
    strays: NDArray[np.bool_]
    attitudes: Floats | None = None


def tumble(
    seed: int | Generator = 0,
    *,
    motion: str = "hand",
    n: int | None = None,
    sensor: Sensor | None = None,
    field_strength: float = 50.0,
    dip_deg: float = 60.0,
    noise: float | None = None,
    outliers: float = 0.0,
) -> Simulated:
    """Record a sensor in motion.

    Sensor, motion, stray fields and noise have each a random stream of their own: with the same seed, another
    noise or share of outliers leaves the sensor and its path as they are.

    Parameters
    ----------
    seed : int or Generator
        The same seed gives the same recording.
    motion : str
        ``hand``, ``uniform``, ``tilted``, ``level``, ``hemisphere`` or ``clumped``; see the head of this module.
    n : int, optional
        Readings; by default 3,000, a minute at 50 Hz, by hand, else 1,000.
    sensor : Sensor, optional
        By default `Sensor.random`.
    field_strength : float, µT
    dip_deg : float
        How far the field points down from the horizon; for the motions that are attitudes.
    noise : float, µT, optional
        In place of the sensor's own, which is 0.5 for a random one.
    outliers : float
        Share of readings, 0 … 1, taken in a stray field of half to three times `field_strength` in any direction.

    Raises
    ------
    UsageError
        For a motion that is not known, or a number out of its range.

    Examples
    --------
    >>> level = tumble(seed=3, motion="level", n=200, sensor=Sensor(), dip_deg=70)
    >>> float(np.ptp(level.samples.field[:, 2]))       # a level sensor never leaves its plane
    0.0
    >>> int(tumble(n=500, outliers=0.03).strays.sum())
    15
    """
    if motion not in MOTIONS:
        raise UsageError(f"motion {motion!r} is not known: use one of {', '.join(MOTIONS)}")
    count = _count(n, 3000 if motion == "hand" else 1000)
    of_sensor, of_motion, of_strays, of_noise = np.random.default_rng(seed).spawn(4)
    sensor = Sensor.random(of_sensor) if sensor is None else sensor
    sensor = sensor if noise is None else replace(sensor, noise=noise)
    path = MOTIONS[motion](of_motion, count, north_and_down(dip_deg))
    stray, strays = _stray_fields(of_strays, count, outliers)
    true = _positive(field_strength, "field_strength") * (path.directions + stray)
    samples = Samples.of(
        sensor.read(true, of_noise),
        unit="uT",
        time=np.arange(count) / RATE_HZ,
        acceleration=None if path.attitudes is None else specific_force(path.attitudes, of_noise),
        rate=None if path.rate is None else path.rate + RATE_NOISE * of_noise.standard_normal((count, 3)),
        source=f"simulated {motion}",
    )
    return Simulated(samples, sensor, path.directions, field_strength, strays, path.attitudes)


def angle_error_deg(
    matrix: ArrayLike,
    offset: ArrayLike,
    truth: Simulated,
    *,
    rotation: Literal["symmetric", "best"] = "symmetric",
) -> float:
    """Root mean square angle between true and corrected field, over 400 directions spread evenly, in degrees.

    The matrix is judged by its symmetric root (MᵀM)^½, which is all that an ellipsoid fixes of it; its scale
    does not count.

    Parameters
    ----------
    matrix : (3, 3) array-like
        Of the calibration that is judged.
    offset : (3,) array-like, µT
    truth : Simulated
        Its sensor and field strength.
    rotation : str
        ``symmetric`` counts the sensor's own `Sensor.rotation` as error, as a heading would; ``best`` takes the
        best rotation away first, for sensors whose matrix is not symmetric.

    Raises
    ------
    ArrayError
        For a wrong shape or values that are not finite.

    Examples
    --------
    >>> recording = tumble(sensor=Sensor(matrix=[[1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    >>> angle_error_deg(*recording.sensor.correction, recording)
    2.3
    >>> angle_error_deg(*recording.sensor.correction, recording, rotation="best")
    0.0
    """
    root = _symmetric_power(square(matrix).T @ square(matrix), 0.5)
    true = fibonacci(400)
    raw = truth.field_strength * true @ truth.sensor.matrix.T + truth.sensor.offset
    corrected = (raw - _triple(offset)) @ root
    if rotation == "best":
        corrected = corrected @ _best_rotation(corrected, true).T
    across = np.linalg.norm(np.cross(corrected, true), axis=1)
    angles = np.arctan2(across, np.sum(corrected * true, axis=1))
    return math.degrees(math.sqrt(np.mean(angles**2)))


def soft_iron(rng: Generator, *, scale: float = 0.25, across: float = 0.15) -> Floats:
    """(3, 3) symmetric matrix: 1 ± `scale` on the diagonal, ± `across` beside it, all uniform.

    >>> soft_iron(np.random.default_rng(1), scale=0.0, across=0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    matrix = np.diag(1 + rng.uniform(-scale, scale, 3))
    upper = np.triu_indices(3, 1)
    matrix[upper] = rng.uniform(-across, across, 3)
    matrix.T[upper] = matrix[upper]
    return matrix


def north_and_down(dip_deg: float) -> Floats:
    """(3,) unit direction of a field that dips by `dip_deg`: north, east, down.

    >>> north_and_down(30.0).round(3)
    array([0.866, 0.   , 0.5  ])
    """
    dip = math.radians(dip_deg)
    return np.array([math.cos(dip), 0.0, math.sin(dip)])


def specific_force(attitudes: Floats, rng: Generator) -> Floats:
    """(N, 3) acceleration in m/s² that a body turning on the spot measures, with noise: level, −g on z.

    >>> specific_force(np.eye(3)[np.newaxis], np.random.default_rng(0)).round(1)
    array([[ 0. ,  -0. ,  -9.8]])
    """
    still = seen_from(attitudes, np.array([0.0, 0.0, -GRAVITY]))
    return still + rng.normal(0.0, ACCELERATION_NOISE, still.shape)


def seen_from(attitudes: Floats, world: Floats) -> Floats:
    """(N, 3) a fixed world vector (3,) in the body axes of each of (N, 3, 3) attitudes.

    >>> seen_from(level_turn(np.random.default_rng(0), 1), np.array([0.0, 0.0, 1.0]))
    array([[0., 0., 1.]])
    """
    seen: Floats = np.einsum("nji,j->ni", attitudes, world)
    return seen


def uniform(rng: Generator, n: int) -> Floats:
    """(n, 3) directions, all alike.

    >>> bool(np.abs(uniform(np.random.default_rng(0), 10_000).mean(axis=0)).max() < 0.02)
    True
    """
    vector = rng.standard_normal((n, 3))
    unit: Floats = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


def hemisphere(rng: Generator, n: int) -> Floats:
    """(n, 3) directions with z ≥ 0: of a sensor that is never turned over, where the field points down.

    >>> bool(hemisphere(np.random.default_rng(0), 1000)[:, 2].min() >= 0)
    True
    """
    directions = uniform(rng, n)
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def clump(rng: Generator, n: int, *, half_angle_deg: float = 3.0) -> Floats:
    """(n, 3) directions within a small angle of one that is drawn first.

    >>> close = clump(np.random.default_rng(0), 100)
    >>> bool(np.degrees(np.arccos((close @ close.T).min())) < 6)
    True
    """
    pole = uniform(rng, 1)[0]
    near = around_z(rng.uniform(math.cos(math.radians(half_angle_deg)), 1, n), rng.uniform(0, 2 * np.pi, n))
    aside = np.array([1.0, 0.0, 0.0]) if abs(pole[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    east = np.cross(pole, aside)
    east /= np.linalg.norm(east)
    turned: Floats = near @ np.stack([east, np.cross(pole, east), pole])
    return turned


def clumped(rng: Generator, n: int, *, share: float = 0.6) -> Floats:
    """(n, 3) directions: all alike first, then a `share` of them in one `clump`.

    >>> bool(clumped(np.random.default_rng(0), 10)[-6:].std(axis=0).max() < 0.05)
    True
    """
    together = round(n * share)
    return np.concatenate([uniform(rng, n - together), clump(rng, together)])


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
) -> Turning:
    """Turn a body over and over, as a hand does: smooth, at random, slowly covering all directions.

    Body rates are white noise through two equal low-pass filters.

    Parameters
    ----------
    rng : Generator
    seconds, rate_hz : float
        How long, and how many instants a second.
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
    count = _count(round(seconds * rate_hz), 0)
    rate = _wandering(rng, count, math.exp(-1.0 / (rate_hz * smoothness)))
    rate *= speed / np.sqrt(np.mean(rate**2))
    attitudes = _followed(_random_attitude(rng), turns(rate * (1 / rate_hz)))
    time: Floats = np.arange(count, dtype=np.float64) * (1 / rate_hz)
    return Turning(time, attitudes, rate)


def turns(vectors: ArrayLike) -> Floats:
    """(N, 3, 3) rotations by (N, 3) rotation vectors in rad (Rodrigues).

    >>> turns([[0.0, 0.0, np.pi / 2]]).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    vector = table(vectors, "rotation vectors")
    angle = np.linalg.norm(vector, axis=1)
    x, y, z = (vector / np.where(angle < 1e-12, 1.0, angle)[:, np.newaxis]).T
    zero = np.zeros(len(vector))
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angle)[:, np.newaxis, np.newaxis], np.cos(angle)[:, np.newaxis, np.newaxis]
    rotations: Floats = np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)
    return rotations


@dataclass(frozen=True, slots=True, eq=False)
class _Path:
    """Directions of the field (N, 3), and the attitudes (N, 3, 3) and rates (N, 3) they come from."""

    directions: Floats
    attitudes: Floats | None = None
    rate: Floats | None = None


def _by_hand(rng: Generator, n: int, world: Floats) -> _Path:
    """Tumble by hand for n readings."""
    turning = hand_tumble(rng, seconds=n / RATE_HZ)
    return _Path(seen_from(turning.attitudes, world), turning.attitudes, turning.rate)


def _spread(draw: Callable[[Generator, int], Floats]) -> Callable[[Generator, int, Floats], _Path]:
    """Make a motion of a function that draws directions."""
    return lambda rng, n, _: _Path(draw(rng, n))


def _posed(draw: Callable[[Generator, int], Floats]) -> Callable[[Generator, int, Floats], _Path]:
    """Make a motion of a function that draws attitudes."""

    def path(rng: Generator, n: int, world: Floats) -> _Path:
        attitudes = draw(rng, n)
        return _Path(seen_from(attitudes, world), attitudes)

    return path


MOTIONS: Final[Mapping[str, Callable[[Generator, int, Floats], _Path]]] = {
    "hand": _by_hand,
    "uniform": _spread(uniform),
    "tilted": _posed(tilted),
    "level": _posed(level_turn),
    "hemisphere": _spread(hemisphere),
    "clumped": _spread(clumped),
}
"""What `tumble` knows, by name: each draws n readings' paths in a field of the given world direction."""


def _stray_fields(rng: Generator, n: int, share: float) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, 3) stray fields in field strengths, zero but for a share of the readings, and (n,) which those are."""
    if not 0.0 <= share <= 1.0:
        raise UsageError(f"outliers is {share:g}: need a share of the readings, 0 to 1")
    count = round(share * n)
    rows = rng.choice(n, count, replace=False)
    fields, strays = np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    fields[rows] = uniform(rng, count) * rng.uniform(0.5, 3.0, (count, 1))
    strays[rows] = True
    return fields, strays


def _wandering(rng: Generator, n: int, memory: float) -> Floats:
    """(n, 3) white noise through two low-pass filters that keep `memory` of their state each step."""
    white = rng.standard_normal((n + SETTLING, 3))
    first, second = np.zeros(3), np.zeros(3)
    wandering = np.empty((n + SETTLING, 3))
    drive = math.sqrt(1 - memory * memory)
    for step, push in enumerate(white):
        first = memory * first + drive * push
        second = memory * second + (1 - memory) * first
        wandering[step] = second
    return wandering[SETTLING:]


def _followed(start: Floats, steps: Floats) -> Floats:
    """(N, 3, 3) attitudes from the first one on, each turned by its step (N, 3, 3) in body axes."""
    attitudes = np.empty_like(steps)
    attitudes[0] = start
    for index in range(1, len(steps)):
        attitudes[index] = attitudes[index - 1] @ steps[index - 1]
        if index % 100 == 0:  # rounding adds up: back to the nearest rotation
            left, _, right = np.linalg.svd(attitudes[index])
            attitudes[index] = left @ right
    return attitudes


def _random_attitude(rng: Generator) -> Floats:
    """(3, 3) a rotation, all alike (QR of a Gaussian matrix with the signs of R taken out)."""
    orthogonal, triangular = np.linalg.qr(rng.standard_normal((3, 3)))
    attitude: Floats = orthogonal * np.sign(np.diag(triangular))
    if np.linalg.det(attitude) < 0:
        attitude[:, 0] *= -1
    return attitude


def _best_rotation(turned: Floats, true: Floats) -> Floats:
    """(3, 3) the rotation that brings (N, 3) vectors closest to the true ones (Kabsch 1976)."""
    left, _, right = np.linalg.svd(true.T @ turned)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    rotation: Floats = left @ right
    return rotation


def _symmetric_power(symmetric: Floats, power: float) -> Floats:
    """(3, 3) power of a symmetric matrix that has no negative eigenvalues but by rounding."""
    values, axes = np.linalg.eigh(symmetric)
    raised: Floats = (axes * np.maximum(values, 0.0) ** power) @ axes.T
    return raised


def _unmirrored(matrix: Floats) -> Floats:
    """Let through a matrix that can be inverted and keeps right-handed axes right-handed."""
    determinant = float(np.linalg.det(matrix))
    if not determinant > 0.0:
        raise ArrayError(f"matrix has determinant {determinant:g}: need a positive one; mirror with axes instead")
    return matrix


def _triple(values: ArrayLike) -> Floats:
    """Let through three finite numbers."""
    array = vectors(values, "offset")
    if array.shape != (3,):
        raise ArrayError(f"offset has shape {array.shape}: need (3,)")
    return array


def _positive(value: float, name: str) -> float:
    """Let through a positive number."""
    if not (math.isfinite(value) and value > 0):
        raise UsageError(f"{name} is {value:g}: need a positive number")
    return value


def _count(n: int | None, default: int) -> int:
    """Let through a number of readings."""
    count = default if n is None else n
    if count < 1:
        raise UsageError(f"n is {count}: need at least one reading")
    return count


def _frozen(array: Floats) -> Floats:
    """Copy an array and make the copy read-only."""
    copy = array.copy()
    copy.flags.writeable = False
    return copy
