"""Attitudes of a body: rotations from body axes into world axes (north, east, down), and angular rates.

>>> north = np.array([1.0, 0.0, 0.0])
>>> in_body_axes(attitudes_of([np.pi / 2], [0.0], [0.0]), north).round(3) + 0.0
array([[ 0., -1.,  0.]])
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import check_table
from flinders.geometry.rotation import cross_matrices, rotation_vectors

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

BLOCK_STEPS: Final = 64
"""Count of steps of a turn that are multiplied before the product is made orthogonal."""


def turns(vectors: ArrayLike) -> Floats:
    """(N, 3, 3) rotations by (N, 3) rotation vectors in rad (Rodrigues).

    The result may differ from that of `flinders.geometry.rotation.rotations` in the last bit; this function is used so
    that the recording of a seed stays the same.

    >>> turns([[0.0, 0.0, np.pi / 2]]).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    vector = check_table(vectors, "rotation vectors")
    angle = np.linalg.norm(vector, axis=1)
    cross = cross_matrices(vector / np.where(angle < 1e-12, 1.0, angle)[:, np.newaxis])
    sine, cosine = np.sin(angle)[:, np.newaxis, np.newaxis], np.cos(angle)[:, np.newaxis, np.newaxis]
    rotations: Floats = np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)
    return rotations


def north_and_down(dip_deg: float) -> Floats:
    """(3,) unit direction of a field with the inclination `dip_deg`: north, east, down.

    >>> north_and_down(30.0).round(3)
    array([0.866, 0.   , 0.5  ])
    """
    dip = math.radians(dip_deg)
    return np.array([math.cos(dip), 0.0, math.sin(dip)])


def attitudes_of(heading: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Floats:
    """(N, 3, 3) attitudes of a body from heading, pitch (nose up) and roll (right side down), in rad.

    >>> attitudes_of([np.pi / 2], [0.0], [0.0]).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    headings, pitches, rolls = np.broadcast_arrays(*(np.atleast_1d(angle) for angle in (heading, pitch, roll)))
    x, y, z = np.eye(3)
    turned: Floats = turns(np.outer(headings, z)) @ turns(np.outer(pitches, y))
    return turned @ turns(np.outer(rolls, x))


def in_body_axes(attitudes: Floats, world: Floats) -> Floats:
    """(N, 3) world vector (3,) in the body axes of each of (N, 3, 3) attitudes.

    >>> in_body_axes(attitudes_of([0.3], [0.0], [0.0]), np.array([0.0, 0.0, 1.0]))
    array([[0., 0., 1.]])
    """
    seen: Floats = np.einsum("nji,j->ni", attitudes, world)
    return seen


def random_attitude(rng: Generator) -> Floats:
    """(3, 3) uniformly distributed random rotation, by QR of a Gaussian matrix with the signs of R removed."""
    orthogonal, triangular = np.linalg.qr(rng.standard_normal((3, 3)))
    attitude: Floats = orthogonal * np.sign(np.diag(triangular))
    if np.linalg.det(attitude) < 0:
        attitude[:, 0] *= -1
    return attitude


def rates(attitudes: Floats, rate_hz: float) -> Floats:
    """(N, 3) angular rates in rad/s in body axes, constant between (N, 3, 3) attitudes; the last rate is repeated."""
    if len(attitudes) < 2:
        return np.zeros((len(attitudes), 3))
    steps = np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:]
    rate = rotation_vectors(steps) * rate_hz
    return np.concatenate([rate, rate[-1:]])


def integrate_steps(start: Floats, steps: Floats) -> Floats:
    """(N, 3, 3) attitudes: the start, and then each attitude rotated by the next of (N, 3, 3) steps in body axes.

    For speed, products of the steps within a block are computed for all blocks together.
    """
    count = -(-len(steps) // BLOCK_STEPS)
    padded = np.concatenate([steps, np.broadcast_to(np.eye(3), (count * BLOCK_STEPS - len(steps), 3, 3))])
    turns_by = padded.reshape(count, BLOCK_STEPS, 3, 3)
    within = np.empty_like(turns_by)
    within[:, 0] = np.eye(3)
    for place in range(1, BLOCK_STEPS):
        np.matmul(within[:, place - 1], turns_by[:, place - 1], out=within[:, place])
    whole = within[:-1, -1] @ turns_by[:-1, -1]
    begins = np.stack(list(accumulate(whole, lambda attitude, turn: _nearest_rotation(attitude @ turn), initial=start)))
    attitudes: Floats = (begins[:, np.newaxis] @ within).reshape(-1, 3, 3)[: len(steps)]
    return attitudes


def _nearest_rotation(attitude: Floats) -> Floats:
    """Nearest rotation to a matrix, which removes accumulated rounding errors."""
    left, _, right = np.linalg.svd(attitude)
    nearest: Floats = left @ right
    return nearest
