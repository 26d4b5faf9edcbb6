"""Normal equations of a least-squares step, the sum over all observation terms.

>>> one = NormalEquations(np.eye(9), np.arange(9.0), 2.0, 3)
>>> (one + one).step()[:3], (one + one).count
(array([0., 1., 2.]), 6)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

MIN_NOISE: Final = 1e-6
"""Smallest standard deviation of readings, relative to the field; no sensor has a lower noise."""
MIN_EIGENVALUE_RATIO: Final = 1e-15
"""Smallest eigenvalue of a scaled matrix, relative to the largest eigenvalue, that is not a rounding error."""


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Sums over residuals r with Jacobian J = −∂r/∂θ."""

    matrix: Floats  # (9, 9): Σ JᵀJ
    gradient: Floats  # (9,): Σ Jᵀr
    cost: float  # Σ r²
    count: int  # number of residuals

    @classmethod
    def empty(cls) -> Self:
        """Equations without residuals, the zero of addition."""
        return cls(np.zeros((9, 9)), np.zeros(9), 0.0, 0)

    def __add__(self, other: NormalEquations) -> Self:
        return type(self)(
            self.matrix + other.matrix, self.gradient + other.gradient, self.cost + other.cost, self.count + other.count
        )

    def place_block(self, columns: slice, size: int) -> Self:
        """Equations of `size` parameters, with these equations at the places `columns` and zeros elsewhere."""
        matrix, gradient = np.zeros((size, size)), np.zeros(size)
        matrix[columns, columns], gradient[columns] = self.matrix, self.gradient
        return type(self)(matrix, gradient, self.cost, self.count)

    def step(self) -> Floats:
        """(9,) change of θ that solves the equations; the shortest solution if they are singular."""
        scale = self._scale
        try:
            solution = np.linalg.solve(self.matrix / np.outer(scale, scale), self.gradient / scale)
        except np.linalg.LinAlgError:
            return self.inverse() @ self.gradient
        step: Floats = solution / scale
        return step

    def inverse(self) -> Floats:
        """(9, 9) covariance of θ: inverse of the matrix, without its singular directions."""
        scale = self._scale
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        seen = values > MIN_EIGENVALUE_RATIO * values[-1]
        vectors = vectors[:, seen] / scale[:, np.newaxis]
        covariance: Floats = vectors / values[seen] @ vectors.T
        return covariance

    @property
    def _scale(self) -> Floats:
        """(9,) root of the diagonal of the matrix, by which it is scaled to diagonal 1."""
        diagonal = np.diag(self.matrix)
        scale: Floats = np.sqrt(
            np.maximum(diagonal, max(MIN_EIGENVALUE_RATIO * float(diagonal.max()), np.finfo(float).tiny))
        )
        return scale
