"""Normal equations of a least-squares step: what every observation term adds to.

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

FINEST: Final = 1e-6
"""Of the field: no sensor resolves less, and no fit claims to."""
ROUNDING: Final = 1e-15


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Sums over residuals r with Jacobian J = −∂r/∂θ."""

    matrix: Floats  # (9, 9): Σ JᵀJ
    gradient: Floats  # (9,): Σ Jᵀr
    cost: float  # Σ r²
    count: int  # residuals added up

    @classmethod
    def empty(cls) -> Self:
        """No residuals."""
        return cls(np.zeros((9, 9)), np.zeros(9), 0.0, 0)

    def __add__(self, other: NormalEquations) -> Self:
        return type(self)(
            self.matrix + other.matrix, self.gradient + other.gradient, self.cost + other.cost, self.count + other.count
        )

    def placed(self, columns: slice, size: int) -> Self:
        """The same as some columns of so many parameters."""
        matrix, gradient = np.zeros((size, size)), np.zeros(size)
        matrix[columns, columns], gradient[columns] = self.matrix, self.gradient
        return type(self)(matrix, gradient, self.cost, self.count)

    def step(self) -> Floats:
        """(9,) change of θ that solves the equations; the smallest one where they leave it open."""
        scale = self._scale
        try:
            solution = np.linalg.solve(self.matrix / np.outer(scale, scale), self.gradient / scale)
        except np.linalg.LinAlgError:
            return self.inverse() @ self.gradient
        step: Floats = solution / scale
        return step

    def inverse(self) -> Floats:
        """(9, 9) inverse of the matrix, without the directions it leaves open: the covariance of θ."""
        scale = self._scale
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        seen = values > ROUNDING * values[-1]
        vectors = vectors[:, seen] / scale[:, np.newaxis]
        covariance: Floats = vectors / values[seen] @ vectors.T
        return covariance

    @property
    def _scale(self) -> Floats:
        """Root of the diagonal: in this scale the matrix has ones there, whatever the units."""
        diagonal = np.diag(self.matrix)
        scale: Floats = np.sqrt(np.maximum(diagonal, max(ROUNDING * float(diagonal.max()), np.finfo(float).tiny)))
        return scale
