"""Attitudes as unit quaternions (w, x, y, z), which rotate vectors from one set of axes to another: v' = q v q*.

An attitude rotates from the axes of a body, forward, right, down, to north, east, down. ``product(a, b)`` is Hamilton's
product, which applies b first and then a. A quaternion and its negative are the same attitude.

>>> east = from_angles([0.0, 0.0, np.pi / 2])                    # roll, pitch, yaw: level, its nose points east
>>> rotate_vectors(east, [1.0, 0.0, 0.0]).round(9)
array([0., 1., 0.])
>>> nose_up = from_angles([0.0, np.pi / 6, 0.0])
>>> rotate_vectors(product(east, nose_up), [1.0, 0.0, 0.0]).round(3)
array([ 0.   ,  0.866, -0.5  ])

Source: J. Kuipers, *Quaternions and Rotation Sequences*, 1999, for the formulas; K. Shoemake, *Animating Rotation with
Quaternion Curves*, 1985, for the interpolation between two attitudes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import check_vectors, to_floats
from flinders.errors import ArrayError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

MAX_LENGTH_ERROR: Final = 0.01
"""Largest difference of a quaternion's length from 1 that is taken as rounding."""
LINEAR_ANGLE_RAD: Final = 1e-6
"""Half of the angle between two attitudes, in rad, below which the interpolation between them is linear."""


def check_attitudes(values: ArrayLike) -> Floats:
    """Check (..., 4) quaternions and normalise them; NaN if a component is missing.

    Raises `ArrayError` for a wrong shape, or a length that is not 1 to within a hundredth.

    Examples
    --------
    >>> check_attitudes([[1.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0]])
    array([[ 1.,  0.,  0.,  0.],
           [nan, nan, nan, nan]])
    """
    array = to_floats(values, "attitude")
    if array.ndim == 0 or array.shape[-1] != 4:
        raise ArrayError(f"attitude has shape {array.shape}: need (..., 4), one quaternion w, x, y, z a reading")
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    off = np.argwhere(np.abs(length[..., 0] - 1) > MAX_LENGTH_ERROR)
    if len(off):
        row = tuple(int(index) for index in off[0])
        raise ArrayError(
            f"attitude at index {row} has length {length[row][0]:.3g} ({len(off):,} such): need unit quaternions "
            "w, x, y, z"
        )
    unit: Floats = array / length
    return unit


def valid_attitudes(values: Floats) -> Floats:
    """(N, 4) quaternions of a log, normalised; NaN if the length is not 1 to within a hundredth.

    >>> valid_attitudes(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]))
    array([[ 1.,  0.,  0.,  0.],
           [nan, nan, nan, nan]])
    """
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(values, axis=1, keepdims=True)
        return np.where(np.abs(length - 1) <= MAX_LENGTH_ERROR, values / np.where(length > 0, length, 1.0), np.nan)


def product(left: Floats, right: Floats) -> Floats:
    """(..., 4) Hamilton's product, the attitude that applies `right` first and then `left`."""
    a, b = np.asarray(left), np.asarray(right)
    w = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    rest = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([w, rest], axis=-1)


def inverse(attitude: Floats) -> Floats:
    """(..., 4) inverse attitude.

    >>> product(inverse(from_angles([0.1, 0.2, 0.3])), from_angles([0.1, 0.2, 0.3])).round(12) + 0.0
    array([1., 0., 0., 0.])
    """
    back: Floats = attitude * np.array([1.0, -1.0, -1.0, -1.0])
    return back


def rotate_vectors(attitude: Floats, vector: ArrayLike) -> Floats:
    """Rotate (..., 3) vectors by (..., 4) unit quaternions: v + 2 w (u × v) + 2 u × (u × v), u = (x, y, z)."""
    v, u = check_vectors(vector, "vector", finite=False), attitude[..., 1:]
    twice = 2.0 * np.cross(u, v)
    turned: Floats = v + attitude[..., :1] * twice + np.cross(u, twice)
    return turned


def from_angles(angles: ArrayLike) -> Floats:
    """(..., 4) attitudes of (..., 3) roll, pitch and yaw in rad: R_z(yaw) R_y(pitch) R_x(roll)."""
    half = check_vectors(angles, "angles", finite=False) / 2.0
    with np.errstate(invalid="ignore"):
        (cr, cp, cy), (sr, sp, sy) = np.moveaxis(np.cos(half), -1, 0), np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def from_matrix(matrix: Floats) -> Floats:
    """(..., 4) quaternions of (..., 3, 3) rotations, with w ≥ 0.

    The largest of w, x, y, z is computed first, which avoids division by a small number (Shepperd 1978).

    >>> from_matrix(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])).round(4)
    array([0.7071, 0.    , 0.    , 0.7071])
    """
    x, y, z = np.moveaxis(np.diagonal(matrix, axis1=-2, axis2=-1), -1, 0)
    added, taken = matrix + np.swapaxes(matrix, -1, -2), matrix - np.swapaxes(matrix, -1, -2)
    xy, yz, zx = added[..., 0, 1], added[..., 1, 2], added[..., 2, 0]
    wx, wy, wz = taken[..., 2, 1], taken[..., 0, 2], taken[..., 1, 0]
    rows = [
        [1 + x + y + z, wx, wy, wz],
        [wx, 1 + x - y - z, xy, zx],
        [wy, xy, 1 - x + y - z, yz],
        [wz, zx, yz, 1 - x - y + z],
    ]  # 4 q qᵀ: each row is q times one of its numbers
    four = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    largest = np.argmax(np.diagonal(four, axis1=-2, axis2=-1), axis=-1)
    best = np.take_along_axis(four, largest[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    unit: Floats = best / np.linalg.norm(best, axis=-1, keepdims=True)
    return np.where(unit[..., :1] < 0, -unit, unit)


def interpolate_attitudes(first: Floats, second: Floats, share: Floats) -> Floats:
    """(N, 4) attitudes interpolated on the shortest rotation between two, at a constant rate (slerp).

    (sin((1 − s)θ) q₀ + sin(sθ) q₁) / sin θ with θ half of the angle between the two attitudes.

    Parameters
    ----------
    first, second : (N, 4) float
        Unit quaternions.
    share : (N,) float
        s: 0 at the first, 1 at the second.

    Examples
    --------
    >>> level, over = from_angles([[0.0, 0.0, 0.0]]), from_angles([[1.0, 0.0, 0.0]])
    >>> np.allclose(interpolate_attitudes(level, -over, np.array([0.3])), from_angles([[0.3, 0.0, 0.0]]))
    True
    """
    cosine = np.sum(first * second, axis=1)
    second = np.where(cosine[:, np.newaxis] < 0, -second, second)
    half = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    straight = half < LINEAR_ANGLE_RAD
    sine = np.where(straight, 1.0, np.sin(half))
    start = np.where(straight, 1.0 - share, np.sin((1.0 - share) * half) / sine)
    end = np.where(straight, share, np.sin(share * half) / sine)
    mixed = start[:, np.newaxis] * first + end[:, np.newaxis] * second
    unit: Floats = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return unit
