"""A sensor with its iron: what it makes of a field.

>>> Sensor(offset=[20, 120, 90]).read([[50, 0, 0]], np.random.default_rng(0))
array([[ 70., 120.,  90.]])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, frozen, table, triple
from flinders.arrays import matrix as square
from flinders.core.short_repr import ShortRepr
from flinders.errors import ArrayError, UsageError
from flinders.simulate._checks import not_negative

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike

SOFT_IRON: Final = 0.25
"""How far a scale of a random sensor is from 1 at most."""

ACROSS: Final = 0.6
"""Largest off-diagonal entry, as a share of that."""

STRONGEST: Final = 0.4545
"""From 1/2.2 on such a matrix may be singular."""

HARD_IRON: Final = 100.0
"""µT: how large the offset of an axis is at most."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sensor(ShortRepr):
    """A magnetometer and the iron around it: ``raw = matrix @ h + offset + noise``, then rounded and limited.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, or a matrix that is singular or mirrors.
    UsageError
        For negative noise, or a resolution or saturation that is not positive.
    """

    #: (3, 3), dimensionless: soft iron, scale and misalignment; need not be symmetric
    matrix: Floats = field(default_factory=lambda: np.eye(3))
    #: (3,), µT: hard iron: what the sensor reads in zero field
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    noise: float = 0.0  #: µT: one σ per axis, white
    resolution: float | None = None  #: µT: step of the converter, of which readings are multiples
    saturation: float | None = None  #: µT: where each axis saturates

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of the arrays."""
        object.__setattr__(self, "matrix", frozen(_unmirrored(square(self.matrix))))
        object.__setattr__(self, "offset", frozen(triple(self.offset)))
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
        soft: float = SOFT_IRON,
        hard: float = HARD_IRON,
        noise: float = 0.5,
        resolution: float | None = None,
        saturation: float | None = None,
    ) -> Self:
        """Draw a sensor like those on small boards: symmetric A, ±25 % scale, ±0.15 across, ±100 µT an axis.

        Raises `UsageError` unless 0 ≤ `strength` < 1.8 and 0 ≤ `soft` × `strength` < 0.45, or for a negative `hard`.

        Parameters
        ----------
        rng : Generator
            Nine draws: three scales, three across, three offsets.
        strength : float
            Factor on all of it: zero is a perfect sensor, below 1.8 the matrix is sure to be positive definite.
        soft : float
            How far a scale is from 1 at most; what is across is six tenths of it.
        hard : float, µT
            How large the offset of an axis is at most.
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
        if not 0.0 <= soft * strength < STRONGEST:
            raise UsageError(f"soft iron is {soft * strength:g}: need at least 0 and less than {STRONGEST:g}")
        hard = not_negative(hard, "hard iron", "µT")
        matrix = soft_iron(rng, scale=soft * strength, across=ACROSS * soft * strength)
        return cls(matrix, rng.uniform(-hard, hard, 3) * strength, noise, resolution, saturation)

    def read(self, field: ArrayLike, rng: Generator, *, shift: Floats | None = None) -> Floats:
        """(N, 3) readings, in µT, of an (N, 3) field in µT in the axes of the body.

        As many numbers are drawn whatever `noise` is. `shift`, (N, 3) µT, is by how much each reading is off for
        another reason. A wrong shape or values that are not finite raise `ArrayError`.
        """
        true = table(field)
        raw = true @ self.matrix.T + self.offset + self.noise * rng.standard_normal(true.shape)
        if shift is not None:
            raw = raw + shift
        if self.resolution is not None:
            raw = np.round(raw / self.resolution) * self.resolution
        return raw if self.saturation is None else np.clip(raw, -self.saturation, self.saturation)

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
        return symmetric_power(self.matrix @ self.matrix.T, -0.5), self.offset

    @property
    def rotation(self) -> Floats:
        """(3, 3) the rotation W A that remains after `correction`, which no magnetometer alone can know.

        >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> np.allclose(Sensor(matrix=np.diag([2.0, 3.0, 4.0]) @ quarter).rotation, quarter)
        True
        """
        return self.correction[0] @ self.matrix


def soft_iron(rng: Generator, *, scale: float = 0.25, across: float = 0.15) -> Floats:
    """(3, 3) symmetric matrix: 1 ± `scale` on the diagonal, ± `across` off it, all uniform.

    >>> soft_iron(np.random.default_rng(1), scale=0.0, across=0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    matrix = np.diag(1 + rng.uniform(-scale, scale, 3))
    upper = np.triu_indices(3, 1)
    matrix[upper] = rng.uniform(-across, across, 3)
    matrix.T[upper] = matrix[upper]
    return matrix


def symmetric_power(symmetric: Floats, power: float) -> Floats:
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
