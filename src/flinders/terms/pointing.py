"""The field of the site stands still in the world: what a logged attitude says.

With the attitude C_k of the body, from its axes into north, east and down, and one direction m for all readings,

    q_k = C_kᵀ m

so that each reading gives all three components of its residual, and the matrix is found in full, the rotation included.
m is found with the rest; where the inclination of the site is known it lies on that cone.

When to use it: the attitude does not come from this compass: from an inertial navigator with two antennas, from a
camera, from a turntable. The yaw of an autopilot follows its own compass: the fit then repeats the old calibration,
and nothing in its residuals shows it. Without yaw, take the vertical alone, see `flinders.terms.inclination`.

Source: M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016): y = D R m + o + noise.

>>> from flinders.quaternions import of_angles
>>> body_to_world(of_angles([[0.0, 0.0, np.pi / 2]])).round(9)[0] + 0.0
array([[ 0., -1.,  0.],
       [ 1.,  0.,  0.],
       [ 0.,  0.,  1.]])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.quaternions import rotated

if TYPE_CHECKING:
    from flinders.arrays import Floats


def body_to_world(attitude: Floats) -> Floats:
    """(N, 3, 3) matrices of (N, 4) attitudes, from body axes into north, east and down; NaN where one is not known."""
    columns = [rotated(attitude, np.broadcast_to(axis, (len(attitude), 3))) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def mean_direction(matrices: Floats, directions: Floats) -> Floats:
    """(3,) the direction in the world that (N, 3) directions in body axes agree on best.

    >>> mean_direction(np.eye(3)[np.newaxis], np.array([[0.0, 0.6, 0.8]]))
    array([0. , 0.6, 0.8])
    """
    total = np.einsum("nij,nj->i", matrices, directions)
    unit: Floats = total / max(float(np.linalg.norm(total)), 1e-300)
    return unit
