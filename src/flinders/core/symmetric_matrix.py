"""Symmetric positive-definite (3, 3) matrices: checks, the Cholesky factor and its inverse.

>>> factor = cholesky(np.diag([4.0, 9.0, 16.0]))
>>> factor[:3], scaled_inverse(factor, 1.0).diagonal().round(4).tolist()
((2.0, 3.0, 4.0), [0.25, 0.1111, 0.0625])
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.arrays import Floats, matrix
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration_file import Rotation
    from flinders.errors import Hint


def invertible(values: ArrayLike, rotation: Rotation) -> Floats:
    """Let through a matrix that has an inverse, and is symmetric where `rotation` says so."""
    array = matrix(values)
    if rotation == "symmetric":
        symmetric(array, "matrix", "; say how it is turned if that is meant", {"rotation": "estimated"})
        if is_positive(array):
            return array
    largest, _, smallest = np.linalg.svd(array, compute_uv=False)
    if smallest <= largest * 3.0 * np.finfo(float).eps:  # as numpy.linalg.matrix_rank
        raise ArrayError("matrix is singular: it would flatten all readings into a plane, and has no inverse")
    return array


def is_positive(array: Floats) -> bool:
    """Whether a symmetric matrix is positive definite beyond doubt: all there is to know of most."""
    roots = cholesky(array)[:3]
    return bool(roots) and min(roots) > 1e-6 * max(roots)


def cholesky(array: Floats) -> tuple[float, ...]:
    """Entries 11, 22, 33, 21, 31, 32 of the Cholesky factor of a symmetric (3, 3) matrix; empty unless positive."""
    (a, _, _), (d, b, _), (e, f, c) = array.tolist()
    if not a > 0.0:
        return ()
    first = math.sqrt(a)
    d, e = d / first, e / first
    b -= d * d
    if not b > 0.0:
        return ()
    second = math.sqrt(b)
    f = (f - d * e) / second
    c -= e * e + f * f
    return (first, second, math.sqrt(c), d, e, f) if c > 0.0 else ()


def scaled_inverse(factor: tuple[float, ...], scale: float) -> Floats:
    """(3, 3) inverse of the matrix of a Cholesky factor, times a scale."""
    first, second, third, d, e, f = factor
    x, y, z = 1.0 / first, 1.0 / second, 1.0 / third  # the inverse of the factor, with u, v, w below its diagonal
    u, w = 0.0 - d * x * y, 0.0 - f * y * z  # no zero is negative
    v = 0.0 - (e * x + f * u) * z
    xy, xz, yz = scale * (u * y + v * w), scale * v * z, scale * w * z
    xx, yy, zz = scale * (x * x + u * u + v * v), scale * (y * y + w * w), scale * z * z
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def symmetric(array: Floats, name: str, advice: str = "", hint: Hint | None = None) -> Floats:
    """Let through a matrix that equals its transpose to within a millionth."""
    (_, d, e), (g, _, f), (h, i, _) = array.tolist()
    lack = max(abs(d - g), abs(e - h), abs(f - i))
    if lack and lack > 1e-6 * np.abs(array).max():
        raise ArrayError(
            f"{name} is not symmetric: entries across the diagonal differ by up to {lack:.3g}{advice}",
            hint=hint,
            lack=lack,
        )
    return array
