"""The field of the site stands still in the world: what a logged attitude says.

With the attitude C_k of the body, from its axes into north, east and down, and one direction m for all readings,

    C_k q_k = m

so that the matrix is found in full, the rotation included. m is found with the rest; where the inclination of the site
is known it lies on that cone.

A logged attitude is no truth. Off by a small turn e it puts the field at Cᵀm = q − e × q, so that with q = Cᵀm in the
model x = b + S Rᵀ q + n the residual of a reading is n + S Rᵀ (e × q): larger across the field than along it,
and correlated with the Jacobian, which holds the same e. Least squares then shrink S, by the variance of e over that
of q: errors in variables. Half a degree of noise moves the shape of a leaning vehicle by more than its
claim. So q_k stays free for each reading, or for each window of a gyro, and the attitude is a measurement
of it beside that of the magnetometer: residuals x − b − S Rᵀ q over the noise of readings, m − C q over that of
attitudes. Both noises come from their residuals: that along the field holds the one, those across it both. The Jacobian
is taken where both measurements put q. There it is, to first order, independent of the residuals, which is what
makes the estimate consistent. Of second order the term adds nothing: the mean of C q − m is along m, where
neither q nor m can move.

When to use it: the attitude does not come from this compass: from an inertial navigator with two antennas, from a
camera, from a turntable. The yaw of an autopilot follows its own compass: the fit then repeats the old calibration,
and nothing in its residuals shows it. Without yaw, take the vertical alone, see `flinders.likelihood.dip`.

Source: M. Kok, T. B. Schön, IEEE Sensors J. 16 (2016): y = D R m + o + noise; W. A. Fuller, *Measurement Error
Models* (1987) §3.2, for errors in both sides of a non-linear relation.

>>> from flinders.geometry.quaternions import of_angles
>>> body_to_world(of_angles([[0.0, 0.0, np.pi / 2]])).round(9)[0] + 0.0
array([[ 0., -1.,  0.],
       [ 1.,  0.,  0.],
       [ 0.,  0.,  1.]])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.geometry.quaternions import rotated
from flinders.geometry.rotation import across, product
from flinders.likelihood.term import Block, Term

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.arrays import Floats

HUBER: Final = 3.0
"""Standard deviations about an axis beyond which an attitude counts less: one of a hundred in two components."""


def body_to_world(attitude: Floats) -> Floats:
    """(N, 3, 3) matrices of (N, 4) attitudes, from body axes into north, east and down; NaN where one is not known."""
    columns = [rotated(attitude, np.broadcast_to(axis, (len(attitude), 3))) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def fill(
    jacobian: Floats,
    columns: Mapping[str, slice],
    attitudes: Floats,
    direction: Floats,
    of_gyro: slice,
    moved: Floats | None,
) -> None:
    """Write the Jacobian of C q − m.

    Parameters
    ----------
    jacobian : (W, 3, n, P) float
    attitudes : (W, n, 3, 3) float
        C.
    direction : (3,) float
        m.
    of_gyro : slice
        Columns that go with `moved`.
    moved : (W, n, 3, m) float, optional
        How q goes with a gyro.
    """
    if "direction" in columns:
        jacobian[..., columns["direction"]] = -across(direction)[:, np.newaxis]
    if moved is not None:
        jacobian[..., of_gyro] = np.swapaxes(product(attitudes, moved), 1, 2)


TERM: Final = Term(
    "attitude",
    "logged attitude",
    "the logged attitude: the field stands still in the world",
    ("attitude",),
    (Block("direction", 2),),
)
