"""Term of a logged attitude: the field has a constant direction in the world.

With the attitude C_k of the body, from its axes to north, east and down, and one direction m for all readings,

    C_k q_k = m

so the full matrix is determined, including its rotation. m is estimated with the other parameters; if the inclination
of the site is known, m has that inclination.

A logged attitude has errors. A small rotation error e gives the field Cᵀm = q − e × q. If the model x = b + S Rᵀ q + n
used q = Cᵀm, the residual of a reading would be n + S Rᵀ (e × q): larger across the field than along it, and correlated
with the Jacobian, which contains the same e. Least squares would then shrink S by the ratio of the variances of e and q
(errors in variables). Half a degree of noise changes the shape of a tilted vehicle by more than its claimed
uncertainty.

Therefore q_k is a free parameter of each reading, or of each window of a gyro, which both sensors measure. Residuals
are x − b − S Rᵀ q over the noise of readings, and m − C q over the noise of attitudes. Both noises are estimated from
the residuals: those along the field contain the noise of readings alone, those across the field contain both. The
Jacobian is evaluated at the q that both measurements determine. There it is independent of the residuals to first
order, so that the estimate is consistent. There is no bias of second order, because the mean of C q − m is along m,
where neither q nor m can move.

When to use it: if the attitude is independent of this compass, such as from an inertial navigator with two antennas, a
camera or a turntable. The yaw of an autopilot follows its own compass: the fit would then repeat the old calibration,
and the residuals would not show that. For an attitude without an independent yaw use only the vertical, see
`flinders.likelihood.dip`.

Source: M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016): y = D R m + o + noise; W. A. Fuller, *Measurement Error
Models* (1987) §3.2, for errors in both sides of a non-linear relation.

>>> from flinders.geometry.quaternions import from_angles
>>> body_to_world(from_angles([[0.0, 0.0, np.pi / 2]])).round(9)[0] + 0.0
array([[ 0., -1.,  0.],
       [ 1.,  0.,  0.],
       [ 0.,  0.,  1.]])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.quaternions import rotate_vectors
from flinders.geometry.rotation import perpendicular_vectors, product
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats

ATTITUDE_HUBER: Final = 3.0
"""Residual of an attitude, in standard deviations about an axis, from which its weight is reduced.

Of normal residuals with two components, one in a hundred is larger.
"""


def body_to_world(attitude: Floats) -> Floats:
    """(N, 3, 3) matrices of (N, 4) attitudes, from body axes to north, east and down; NaN if not known."""
    columns = [rotate_vectors(attitude, np.broadcast_to(axis, (len(attitude), 3))) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def fill_attitude(
    jacobian: Floats,
    columns: Mapping[str, slice],
    attitudes: Floats,
    direction: Floats,
    of_gyro: slice,
    moved: Floats | None,
) -> None:
    """Write the Jacobian of the residuals C q − m of attitudes.

    Parameters
    ----------
    jacobian : (W, 3, n, P) float
        Written in place.
    columns : mapping of str to slice
        Columns of the free blocks of parameters.
    attitudes : (W, n, 3, 3) float
        C.
    direction : (3,) float
        m.
    of_gyro : slice
        Columns of the gyro's parameters.
    moved : (W, n, 3, m) float, optional
        Derivative of q by the gyro's parameters.
    """
    if "direction" in columns:
        jacobian[..., columns["direction"]] = -perpendicular_vectors(direction)[:, np.newaxis]
    if moved is not None:
        jacobian[..., of_gyro] = np.swapaxes(product(attitudes, moved), 1, 2)


TERM: Final = Term(
    "attitude",
    "logged attitude",
    "the logged attitude: the field has a constant direction in the world",
    ("attitude",),
    (Block("direction", 2),),
)
