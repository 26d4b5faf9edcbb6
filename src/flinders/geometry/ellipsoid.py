"""Ellipsoids, and their conversion from and to the ten coefficients of a quadric.

A quadric is the set of x with xᵀQx + lᵀx + d = 0. Its coefficients are stored in the order

    Q₁₁, Q₂₂, Q₃₃, Q₁₂, Q₁₃, Q₂₃, l₁, l₂, l₃, d

of the monomials x², y², z², 2xy, 2xz, 2yz, x, y, z, 1.

>>> ellipsoid = Ellipsoid(np.array([1.0, 2.0, 3.0]), np.diag([4.0, 5.0, 6.0]))
>>> Ellipsoid.from_quadric(ellipsoid.as_quadric()).isclose(ellipsoid)
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.errors import NotAnEllipsoid

if TYPE_CHECKING:
    from flinders.arrays import Floats

PARAMETER_DERIVATIVES: Final = np.zeros((12, 9))
"""(12, 9) matrix that makes the derivatives of v·b + vᵀS u by b and the symmetric S from v and the products v_i u_j."""

PARAMETER_DERIVATIVES[[0, 1, 2], [0, 1, 2]] = 1.0
PARAMETER_DERIVATIVES[[3, 7, 11, 4, 6, 5, 9, 8, 10], [3, 4, 5, 6, 6, 7, 7, 8, 8]] = 1.0

SYMMETRIC_INDEX: Final = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""(3, 3) index of each entry of a symmetric matrix in the list of its entries 11, 22, 33, 12, 13, 23."""


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The points centre + shape · u for all unit vectors u."""

    centre: Floats  #: (3,): centre
    #: (3, 3): symmetric and positive definite matrix, whose eigenvalues are the semi-axes. An ellipsoid determines the
    #: shape only up to a rotation on the right; the symmetric one is used by convention.
    shape: Floats

    @classmethod
    def from_quadric(cls, coefficients: Floats, *, method: str = "") -> Self:
        """Ellipsoid of (10,) coefficients, which may all have the opposite sign.

        Raises `NotAnEllipsoid` if the quadric is open, imaginary or not finite.
        """
        form, linear, constant = symmetric_matrix(coefficients[:6]), coefficients[6:9], coefficients[9]
        if not np.all(np.isfinite(coefficients)):
            raise NotAnEllipsoid((float("nan"),) * 3, method)
        if np.trace(form) < 0:
            form, linear, constant = -form, -linear, -constant
        eigenvalues, vectors = np.linalg.eigh(form)
        if not eigenvalues[0] > 1e-12 * abs(eigenvalues[2]):
            raise _not_closed_error(eigenvalues, method)
        centre = vectors @ (vectors.T @ linear / (-2.0 * eigenvalues))
        level = centre @ form @ centre - constant
        if not level > 0:
            raise _not_closed_error(-eigenvalues, method)
        return cls(centre, (vectors * np.sqrt(level / eigenvalues)) @ vectors.T)

    def as_quadric(self) -> Floats:
        """(10,) coefficients, scaled so that xᵀQx + lᵀx + d = |shape⁻¹(x − centre)|² − 1."""
        root = np.linalg.inv(self.shape)
        form = root @ root
        linear = form @ self.centre
        return np.concatenate([upper_entries(form), -2.0 * linear, [self.centre @ linear - 1.0]])

    def in_frame(self, origin: Floats, scale: float) -> Self:
        """The same surface in coordinates x = origin + scale · z; this ellipsoid has the coordinates z."""
        return type(self)(origin + scale * self.centre, scale * self.shape)

    @cached_property
    def radius(self) -> float:
        """Geometric mean of the semi-axes."""
        determinant = np.linalg.det(self.shape)
        if 1e-200 < determinant < 1e200:
            return float(np.cbrt(determinant))
        return float(np.cbrt(np.linalg.det(self.shape / self.scale)) * self.scale)

    @property
    def scale(self) -> float:
        """Power of two above the largest entry of the shape, by which the shape is divided for its determinant."""
        return float(2.0 ** np.frexp(np.abs(self.shape).max())[1].clip(-1000, 1000))

    @cached_property
    def semi_axes(self) -> Floats:
        """(3,) semi-axes, ascending."""
        semi_axes: Floats = np.linalg.eigvalsh(self.shape)
        semi_axes.flags.writeable = False
        return semi_axes

    @classmethod
    def of_parameters(cls, parameters: Floats) -> Self:
        """Ellipsoid of (9,) parameters in the order of the attribute `parameters`."""
        return cls(parameters[:3], symmetric_matrix(parameters[3:]))

    @property
    def parameters(self) -> Floats:
        """(9,) parameters in the order of covariances: the centre, then S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃."""
        return np.concatenate([self.centre, upper_entries(self.shape)])

    def isclose(self, other: Ellipsoid, rtol: float = 1e-9) -> bool:
        """Whether both surfaces agree within `rtol` times the radius."""
        tolerance = rtol * self.radius
        return bool(
            np.allclose(self.centre, other.centre, rtol=0, atol=tolerance)
            and np.allclose(self.shape, other.shape, rtol=0, atol=tolerance)
        )

    def __repr__(self) -> str:
        centre = ", ".join(f"{value:.6g}" for value in self.centre)
        axes = ", ".join(f"{value:.6g}" for value in self.semi_axes)
        return f"Ellipsoid(centre=({centre}), semi_axes=({axes}))"


def symmetric_matrix(entries: Floats) -> Floats:
    """(3, 3) symmetric matrix from its entries 11, 22, 33, 12, 13, 23."""
    matrix: Floats = entries[SYMMETRIC_INDEX]
    return matrix


def upper_entries(matrix: Floats) -> Floats:
    """(..., 6) entries 11, 22, 33, 12, 13, 23 of (..., 3, 3) symmetric matrices."""
    entries: Floats = matrix.reshape(*matrix.shape[:-2], 9)[..., [0, 4, 8, 1, 2, 5]]
    return entries


def sphere_through(points: Floats, origin: Floats | None = None) -> tuple[Floats, float]:
    """Centre (k,) and radius of the sphere, or circle, through (N, k) points by linear least squares (Kåsa 1976).

    Solves |x|² = 2 c·x + r² − |c|² with x relative to `origin`, by default the mean of the points. For points in a
    plane the centre is in that plane.

    >>> sphere_through(np.array([[3.0, 0.0], [1.0, 2.0], [-1.0, 0.0], [1.0, -2.0]]))
    (array([1., 0.]), 2.0)
    """
    begin = points.mean(axis=0) if origin is None else origin
    scale = float(np.abs(points - begin).max()) or 1.0
    about = (points - begin) / scale
    rows = np.column_stack([2.0 * about, np.ones(len(about))])
    *centre, rest = np.linalg.lstsq(rows, np.einsum("ij,ij->i", about, about), rcond=None)[0]
    return begin + scale * np.array(centre), scale * math.sqrt(max(rest + float(np.dot(centre, centre)), 0.0))


def subtract_centre(readings: Floats, centre: Floats) -> Floats:
    """(3, N) differences of (N, 3) readings from a centre, contiguous by axis, for four times faster sums."""
    local: Floats = np.subtract(readings.T, centre[:, np.newaxis], order="C")
    return local


def parameter_derivatives(vectors: Floats, directions: Floats) -> Floats:
    """(..., K, 9) derivatives of v·b + vᵀS u by the nine parameters of an ellipsoid.

    `vectors` v and `directions` u are (..., 3, K).
    """
    products = vectors[..., np.newaxis, :] * directions[..., np.newaxis, :, :]
    rows = np.concatenate([vectors, products.reshape(*vectors.shape[:-2], 9, -1)], axis=-2)
    coefficients: Floats = rows.mT @ PARAMETER_DERIVATIVES
    return coefficients


def _not_closed_error(eigenvalues: Floats, method: str) -> NotAnEllipsoid:
    """Error for a quadric that is not an ellipsoid, with its eigenvalues divided by the largest."""
    largest = float(np.abs(eigenvalues).max()) or 1.0
    return NotAnEllipsoid(tuple(float(value) / largest for value in eigenvalues), method)
