"""A simulated sensor with its iron, which turns a field into readings.

>>> Sensor(offset=[20, 120, 90]).read([[50, 0, 0]], np.random.default_rng(0))
array([[ 70., 120.,  90.]])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, check_table, check_triple, read_only_copy
from flinders.arrays import check_matrix as square
from flinders.core.short_repr import ShortRepr
from flinders.errors import ArrayError, UsageError
from flinders.simulate._checks import not_negative

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike

MAX_SCALE_ERROR: Final = 0.25
"""Largest difference of a random sensor's scale from 1."""

OFF_DIAGONAL_RATIO: Final = 0.6
"""Ratio of the largest off-diagonal entry to the largest scale error."""

SOFT_IRON_LIMIT: Final = 0.4545
"""Largest scale error of a random matrix; from 1/2.2 on it may be singular."""

MAX_OFFSET: Final = 100.0
"""Largest offset in µT of an axis of a random sensor."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sensor(ShortRepr):
    """A magnetometer with the iron around it: ``raw = matrix @ field + offset + noise``, then rounded and limited.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, or a matrix that is singular or a reflection.
    UsageError
        For negative noise, or a resolution or saturation that is not positive.
    """

    #: (3, 3), dimensionless: soft iron, scale and misalignment; need not be symmetric
    matrix: Floats = field(default_factory=lambda: np.eye(3))
    #: (3,), µT: hard iron: reading of the sensor in zero field
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    noise: float = 0.0  #: µT: one σ per axis, white
    resolution: float | None = None  #: µT: step of the converter; readings are multiples of it
    saturation: float | None = None  #: µT: largest size of a reading of an axis

    def __post_init__(self) -> None:
        """Check the numbers and store read-only copies of the arrays."""
        object.__setattr__(self, "matrix", read_only_copy(_require_right_handed(square(self.matrix))))
        object.__setattr__(self, "offset", read_only_copy(check_triple(self.offset)))
        not_negative(self.noise, "noise", "µT")
        for name, value in (("resolution", self.resolution), ("saturation", self.saturation)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"{name} is {value:g} µT: need a positive number, or None")

    @classmethod
    def random(
        cls,
        rng: Generator,
        *,
        strength: float = 1.0,
        soft: float = MAX_SCALE_ERROR,
        hard: float = MAX_OFFSET,
        noise: float = 0.5,
        resolution: float | None = None,
        saturation: float | None = None,
    ) -> Self:
        """Draw a random sensor as on small boards: symmetric A, ±25 % scale, ±0.15 off-diagonal, ±100 µT per axis.

        Raises `UsageError` unless 0 ≤ `strength` < 1.8 and 0 ≤ `soft` × `strength` < 0.45, or for a negative `hard`.

        Parameters
        ----------
        rng : Generator
            Source of nine random numbers: three scales, three off-diagonal entries, three offsets.
        strength : float
            Factor by which all errors are multiplied: 0 gives a perfect sensor; below 1.8 the matrix is always
            positive definite.
        soft : float
            Largest difference of a scale from 1; off-diagonal entries are at most 0.6 of it.
        hard : float, µT
            Largest offset of an axis.
        noise, resolution, saturation : float, µT
            As the attributes of the same name.

        Examples
        --------
        >>> Sensor.random(np.random.default_rng(1), strength=0.1).matrix.round(3)
        array([[ 1.001,  0.013, -0.006],
               [ 0.013,  1.023, -0.002],
               [-0.006, -0.002,  0.982]])
        """
        if not 0.0 <= strength < 1.8:
            raise UsageError(f"strength is {strength:g}: need at least 0 and less than 1.8")
        if not 0.0 <= soft * strength < SOFT_IRON_LIMIT:
            raise UsageError(f"soft iron is {soft * strength:g}: need at least 0 and less than {SOFT_IRON_LIMIT:g}")
        hard = not_negative(hard, "hard iron", "µT")
        matrix = soft_iron(rng, scale=soft * strength, across=OFF_DIAGONAL_RATIO * soft * strength)
        return cls(matrix, rng.uniform(-hard, hard, 3) * strength, noise, resolution, saturation)

    def read(self, field: ArrayLike, rng: Generator, *, shift: Floats | None = None) -> Floats:
        """(N, 3) readings, in µT, of an (N, 3) field in µT in the axes of the body.

        `shift`, (N, 3) µT, is added to the readings, for disturbances. The count of random numbers that are drawn does
        not depend on the noise. Raises `ArrayError` for a wrong shape, or values that are not finite.
        """
        true = check_table(field)
        raw = true @ self.matrix.T + self.offset + self.noise * rng.standard_normal(true.shape)
        if shift is not None:
            raw = raw + shift
        if self.resolution is not None:
            raw = np.round(raw / self.resolution) * self.resolution
        return raw if self.saturation is None else np.clip(raw, -self.saturation, self.saturation)

    @property
    def sigma(self) -> float:
        """Noise of a reading in µT, one σ per axis: white noise and rounding, resolution/√12.

        >>> Sensor(noise=0.5, resolution=1.5).sigma
        0.661
        """
        return math.hypot(self.noise, (self.resolution or 0.0) / math.sqrt(12.0))

    @property
    def correction(self) -> tuple[Floats, Floats]:
        """(3, 3) symmetric W and (3,) offset in µT with ``|W (raw − offset)| = |h|``, except for noise.

        For the field h and the matrix A it is W = (A Aᵀ)^(−½), because then |W A h|² = hᵀ Aᵀ (A Aᵀ)⁻¹ A h = |h|². If A
        is symmetric and positive definite, W is A⁻¹; else the `rotation` W A remains.

        >>> Sensor(matrix=np.diag([1.25, 1.0, 0.8])).correction[0]
        array([[0.8 , 0.  , 0.  ],
               [0.  , 1.  , 0.  ],
               [0.  , 0.  , 1.25]])
        """
        return symmetric_power(self.matrix @ self.matrix.T, -0.5), self.offset

    @property
    def rotation(self) -> Floats:
        """(3, 3) rotation W A that remains after `correction`, which a magnetometer alone cannot observe.

        >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> np.allclose(Sensor(matrix=np.diag([2.0, 3.0, 4.0]) @ quarter).rotation, quarter)
        True
        """
        return self.correction[0] @ self.matrix


def soft_iron(rng: Generator, *, scale: float = 0.25, across: float = 0.15) -> Floats:
    """(3, 3) random symmetric matrix: uniform 1 ± `scale` on the diagonal, ± `across` off it.

    >>> soft_iron(np.random.default_rng(1), scale=0.0, across=0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    matrix = np.diag(1 + rng.uniform(-scale, scale, 3))
    upper = np.triu_indices(3, 1)
    matrix[upper] = rng.uniform(-across, across, 3)
    matrix.T[upper] = matrix[upper]
    return matrix


def symmetric_power(symmetric: Floats, power: float) -> Floats:
    """(3, 3) power of a symmetric matrix without negative eigenvalues, except for rounding errors."""
    values, axes = np.linalg.eigh(symmetric)
    raised: Floats = (axes * np.maximum(values, 0.0) ** power) @ axes.T
    return raised


def _require_right_handed(matrix: Floats) -> Floats:
    """Return a matrix with a positive determinant; raise `ArrayError` for others."""
    determinant = float(np.linalg.det(matrix))
    if not determinant > 0.0:
        raise ArrayError(f"matrix has determinant {determinant:g}: need a positive one; mirror with axes instead")
    return matrix
