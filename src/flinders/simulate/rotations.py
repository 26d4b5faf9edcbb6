"""Attitudes as matrices, from body axes into world axes: made, followed, and turned into rates.

>>> quarter = turns([[0.0, 0.0, np.pi / 2]])[0]
>>> rotation_vectors(np.stack([quarter, np.eye(3)])).round(4).tolist()
[[0.0, 0.0, 1.5708], [0.0, 0.0, 0.0]]
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.arrays import Floats, table

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike


def turns(vectors: ArrayLike) -> Floats:
    """(N, 3, 3) rotations by (N, 3) rotation vectors in rad (Rodrigues).

    >>> turns([[0.0, 0.0, np.pi / 2]]).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    vector = table(vectors, "rotation vectors")
    angle = np.linalg.norm(vector, axis=1)
    x, y, z = (vector / np.where(angle < 1e-12, 1.0, angle)[:, np.newaxis]).T
    zero = np.zeros(len(vector))
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angle)[:, np.newaxis, np.newaxis], np.cos(angle)[:, np.newaxis, np.newaxis]
    rotations: Floats = np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)
    return rotations


def rotation_vectors(rotations: Floats) -> Floats:
    """(N, 3) rotation vectors in rad of (N, 3, 3) rotations by less than half a turn: the inverse of `turns`."""
    vee = np.stack(
        [
            rotations[:, 2, 1] - rotations[:, 1, 2],
            rotations[:, 0, 2] - rotations[:, 2, 0],
            rotations[:, 1, 0] - rotations[:, 0, 1],
        ],
        axis=1,
    )
    twice_sine = np.linalg.norm(vee, axis=1)
    angle = np.arctan2(twice_sine, np.trace(rotations, axis1=1, axis2=2) - 1.0)
    factor = np.where(twice_sine > 1e-12, angle / np.maximum(twice_sine, 1e-12), 0.5)
    vectors: Floats = vee * factor[:, np.newaxis]
    return vectors


def rates(attitudes: Floats, rate_hz: float) -> Floats:
    """(N, 3) body rates in rad/s, constant from each of (N, 3, 3) attitudes to the next; the last goes on."""
    if len(attitudes) < 2:
        return np.zeros((len(attitudes), 3))
    steps = np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:]
    rate = rotation_vectors(steps) * rate_hz
    return np.concatenate([rate, rate[-1:]])


def posed(heading: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Floats:
    """(N, 3, 3) attitudes of a body that turns to a heading, raises its nose and then drops its right side; in rad.

    >>> posed([np.pi / 2], [0.0], [0.0]).round(3)[0].tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    headings, pitches, rolls = np.broadcast_arrays(*(np.atleast_1d(angle) for angle in (heading, pitch, roll)))
    x, y, z = np.eye(3)
    attitudes: Floats = turns(np.outer(headings, z)) @ turns(np.outer(pitches, y)) @ turns(np.outer(rolls, x))
    return attitudes


def seen_from(attitudes: Floats, world: Floats) -> Floats:
    """(N, 3) a fixed world vector (3,) in the body axes of each of (N, 3, 3) attitudes.

    >>> seen_from(posed([0.3], [0.0], [0.0]), np.array([0.0, 0.0, 1.0]))
    array([[0., 0., 1.]])
    """
    seen: Floats = np.einsum("nji,j->ni", attitudes, world)
    return seen


def north_and_down(dip_deg: float) -> Floats:
    """(3,) unit direction of a field that dips by `dip_deg`: north, east, down.

    >>> north_and_down(30.0).round(3)
    array([0.866, 0.   , 0.5  ])
    """
    dip = math.radians(dip_deg)
    return np.array([math.cos(dip), 0.0, math.sin(dip)])


def followed(start: Floats, steps: Floats) -> Floats:
    """(N, 3, 3) attitudes from the first one on, each turned by its step (N, 3, 3) in body axes."""
    attitudes = np.empty_like(steps)
    attitudes[0] = start
    for index in range(1, len(steps)):
        attitudes[index] = attitudes[index - 1] @ steps[index - 1]
        if index % 100 == 0:  # rounding adds up: back to the nearest rotation
            left, _, right = np.linalg.svd(attitudes[index])
            attitudes[index] = left @ right
    return attitudes


def random_attitude(rng: Generator) -> Floats:
    """(3, 3) a rotation, all alike (QR of a Gaussian matrix with the signs of R taken out)."""
    orthogonal, triangular = np.linalg.qr(rng.standard_normal((3, 3)))
    attitude: Floats = orthogonal * np.sign(np.diag(triangular))
    if np.linalg.det(attitude) < 0:
        attitude[:, 0] *= -1
    return attitude
