"""Checks of (3, 3) matrices: invertible, symmetric, positive definite."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.arrays import Floats, check_matrix
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration_file import Rotation
    from flinders.errors import Hint


def check_invertible(values: ArrayLike, rotation: Rotation) -> Floats:
    """Check that a matrix has an inverse, and that it is symmetric if `rotation` is ``symmetric``."""
    array = check_matrix(values)
    if rotation == "symmetric":
        check_symmetric(
            array, "matrix", "; give its rotation if it is meant to be asymmetric", {"rotation": "estimated"}
        )
        if is_positive_definite(array):
            return array
    largest, _, smallest = np.linalg.svd(array, compute_uv=False)
    if smallest <= largest * 3.0 * np.finfo(float).eps:  # as numpy.linalg.matrix_rank
        raise ArrayError("matrix is singular, it maps all readings to a plane: need a matrix with an inverse")
    return array


def is_positive_definite(array: Floats) -> bool:
    """Whether a symmetric matrix is positive definite, with a margin for rounding errors.

    >>> is_positive_definite(np.diag([4.0, 9.0, 16.0])), is_positive_definite(np.diag([4.0, 9.0, -1.0]))
    (True, False)
    """
    least, _, largest = np.linalg.eigvalsh(array)
    return bool(least > 1e-12 * abs(largest))


def check_symmetric(array: Floats, name: str, advice: str = "", hint: Hint | None = None) -> Floats:
    """Check that a matrix equals its transpose to within 1e-6 of its largest entry."""
    (_, d, e), (g, _, f), (h, i, _) = array.tolist()
    lack = max(abs(d - g), abs(e - h), abs(f - i))
    if lack and lack > 1e-6 * np.abs(array).max():
        raise ArrayError(
            f"{name} is not symmetric: entries across the diagonal differ by up to {lack:.3g}{advice}",
            hint=hint,
            lack=lack,
        )
    return array
