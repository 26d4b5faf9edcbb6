"""Rotation matrices and rotation vectors, for many readings at once; and steps on the sphere of directions.

>>> quarter = rotations(np.array([[0.0, 0.0, np.pi / 2]]))
>>> bool(np.allclose(quarter[0], np.eye(3) + cross_matrices(np.array([0.0, 0.0, 1.0])) - np.diag([1.0, 1.0, 0.0])))
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.quaternions import from_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats


MAX_HALF_TURN_TRACE: Final = -0.999
"""Largest trace of a rotation R whose axis is computed from the quaternion; R − Rᵀ is nearly zero there."""


def make_contiguous(array: Floats, axes: int = 1) -> Floats:
    """Copy an array so that each component, an index of its last `axes` axes, is contiguous over the readings.

    Sums over readings are then fast.

    >>> make_contiguous(np.zeros((500, 3))).strides
    (8, 4000)
    """
    lead = array.ndim - axes
    pieces = np.ascontiguousarray(array.transpose(*range(lead, array.ndim), *range(lead)))
    return pieces.transpose(*range(axes, array.ndim), *range(axes))


def components(vectors: Floats) -> Floats:
    """(3, ...) view of (..., 3) vectors, ten times faster than `numpy.moveaxis`."""
    return vectors.transpose(-1, *range(vectors.ndim - 1))


def vectors_of(components: Floats) -> Floats:
    """(..., 3) view of (3, ...) components."""
    return components.transpose(*range(1, components.ndim), 0)


def product(first: Floats, second: Floats) -> Floats:
    """(W, n, i, k) product of (W, n, i, j) and (W, n or 1, j, k) matrices, several times faster than ``@``.

    The matrices are in the memory layout of `make_contiguous`.
    """
    pieces = np.empty((first.shape[2], second.shape[3], *first.shape[:2]))
    return np.einsum("wnij,wnjk->wnik", first, second, out=np.moveaxis(pieces, (0, 1), (2, 3)))


def transform_vectors(matrix: Floats, vectors: Floats) -> Floats:
    """(..., 3) product of one (3, 3) matrix and (..., 3) vectors, several times faster than ``@``.

    The vectors are in the memory layout of `make_contiguous`.

    >>> transform_vectors(np.diag([1.0, 2.0, 3.0]), np.ones((4, 1, 3)))[3, 0]
    array([1., 2., 3.])
    """
    pieces = components(vectors)
    return vectors_of((matrix @ pieces.reshape(3, -1)).reshape(pieces.shape))


def apply_matrices(matrices: Floats, vectors: Floats) -> Floats:
    """(W, n, i) product of (W, n, i, j) matrices and (W, n or 1, j) vectors, laid out as by `make_contiguous`."""
    return product(matrices, vectors[..., np.newaxis])[..., 0]


def rotations(vectors: ArrayLike) -> Floats:
    """(..., 3, 3) rotation matrices of (..., 3) rotation vectors in rad (Rodrigues), exact to rounding at any angle.

    >>> rotations(np.array([[0.0, 0.0, np.pi / 2]])).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    vectors = np.asarray(vectors, float)
    square = np.einsum("...i,...i->...", vectors, vectors)
    angle = np.sqrt(square)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - square / 6.0, np.sin(safe) / safe)
    bend = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(safe)) / safe**2)
    x, y, z = np.moveaxis(vectors, -1, 0)
    turned = np.empty((3, 3, *angle.shape))
    for i, j, along, aside in ((0, 1, z, x * y), (2, 0, y, x * z), (1, 2, x, y * z)):
        turned[i, j], turned[j, i] = bend * aside - sine * along, bend * aside + sine * along
    for i, along in enumerate((x, y, z)):
        turned[i, i] = 1.0 - bend * (square - along * along)
    return np.moveaxis(turned, (0, 1), (-2, -1))


def rotation_vectors(matrices: Floats) -> Floats:
    """(..., 3) rotation vectors, axis times angle in rad up to π, of (..., 3, 3) rotations; inverse of `rotations`.

    >>> rotation_vectors(rotations([[0.0, 0.0, 1.5708], [0.0, 3.1416, 0.0], [0.0, 0.0, 0.0]])).round(4) + 0.0
    array([[ 0.    ,  0.    ,  1.5708],
           [ 0.    , -3.1416,  0.    ],
           [ 0.    ,  0.    ,  0.    ]])
    """
    swapped = np.swapaxes(matrices, -1, -2)
    twice = (matrices - swapped)[..., [2, 0, 1], [1, 2, 0]]  # 2 sin of the angle, along the axis
    trace, sine = np.trace(matrices, axis1=-2, axis2=-1), np.linalg.norm(twice, axis=-1)
    factor = np.where(sine > 1e-12, np.arctan2(sine, trace - 1.0) / np.maximum(sine, 1e-12), 0.5)
    vectors: Floats = twice * factor[..., np.newaxis]
    is_large = trace < MAX_HALF_TURN_TRACE
    if np.any(is_large):
        quaternion = from_matrix(matrices[is_large])
        half = np.arccos(np.clip(quaternion[..., :1], -1.0, 1.0))
        vectors[is_large] = 2.0 * half / np.sin(half) * quaternion[..., 1:]
    return vectors


def best_rotation(turned: Floats, true: Floats) -> Floats:
    """(3, 3) rotation that maps (N, 3) vectors `turned` to `true` with the least squared error (Kabsch 1976)."""
    left, _, right = np.linalg.svd(true.T @ turned)
    left[:, 2] *= np.sign(np.linalg.det(left @ right))
    rotation: Floats = left @ right
    return rotation


def cross_matrices(vectors: Floats) -> Floats:
    """(..., 3, 3) matrices [v]× of (..., 3) vectors v, with [v]× w = v × w."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    crossed = np.zeros((3, 3, *x.shape))
    for i, j, along in ((0, 1, z), (2, 0, y), (1, 2, x)):
        crossed[i, j], crossed[j, i] = -along, along
    return np.moveaxis(crossed, (0, 1), (-2, -1))


def perpendicular_vectors(directions: Floats) -> Floats:
    """(..., 3, 2) two unit vectors perpendicular to each other and to (..., 3) directions.

    >>> bool(np.allclose(np.array([[0.6, 0.0, 0.8]]) @ perpendicular_vectors(np.array([[0.6, 0.0, 0.8]]))[0], 0.0))
    True
    """
    pieces = components(directions)
    helper = np.eye(3)[:, np.argmin(np.abs(pieces), axis=0)]
    vectors = np.empty((2, *pieces.shape))
    first, second = vectors
    _cross_into(first, pieces, helper)
    first /= lengths(vectors_of(first))
    _cross_into(second, pieces, first)
    return np.moveaxis(vectors, (0, 1), (-1, -2))


def _cross_into(crossed: Floats, first: Floats, second: Floats) -> None:
    """Write cross products of (3, ...) vectors, several times faster than `numpy.cross`."""
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(first[j] * second[k], first[k] * second[j], out=crossed[i, ...])


def step_on_sphere(directions: Floats, steps: Floats) -> Floats:
    """(..., 3) unit vectors after (..., 2) steps along `perpendicular_vectors` from (..., 3) directions."""
    ways = perpendicular_vectors(directions)
    moved = ways[..., 0] * steps[..., :1] + ways[..., 1] * steps[..., 1:] + directions
    unit: Floats = moved / lengths(moved)[..., np.newaxis]
    return unit


def lengths(vectors: Floats) -> Floats:
    """(...,) lengths of (..., 3) vectors."""
    length: Floats = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return length
