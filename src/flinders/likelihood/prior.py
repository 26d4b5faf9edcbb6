"""Soft iron is mild unless the readings say otherwise.

Where a recording leaves a direction unseen, nothing but experience speaks for the shape there.
The prior says that the departure of S/R from the identity (R the mean semi-axis) is about
`spread`, alike in all directions:

    cost = |dev(S)/R|² / (2 spread²)

with dev(S) = S − R·1 and the Frobenius norm, so that each off-diagonal entry has the standard
deviation `spread`. It says nothing of the centre and nothing of the size; `sense` keeps those from running
away where nothing else holds them. With readings all around
it has no effect worth a digit; where they are missing it lets the fit fall back to "no soft iron
there" with an uncertainty of that size.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> round(equations(sphere, spread=0.3).cost, 12)
0.0
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import UsageError
from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from flinders.arrays import Floats

SPREAD: Final = 0.3
"""Default departure of the scaled matrix from the identity: the soft iron of ordinary mountings, and more."""

SENSE: Final = 10.0

# Deviator of the entries 11, 22, 33, 12, 13, 23; an off-diagonal entry stands twice in the matrix.
DEVIATOR: Final = np.zeros((6, 6))
DEVIATOR[:3, :3] = np.eye(3) - 1.0 / 3.0
DEVIATOR[3:, 3:] = np.sqrt(2.0) * np.eye(3)


def check(spread: object) -> None:
    """Let a spread through that means something, or None for no prior.

    Raises
    ------
    UsageError
        For anything but a positive number.
    """
    if spread is not None and not (isinstance(spread, int | float) and 0.0 < spread < np.inf):
        raise UsageError(f"prior is {spread!r}: need a positive number such as {SPREAD:g}, or None")


def equations(ellipsoid: Ellipsoid, *, spread: float = SPREAD) -> NormalEquations:
    """Give the prior's normal equations, its residuals in standard deviations."""
    entries = upper(ellipsoid.shape)
    scale = np.sqrt(2.0) * spread * float(entries[:3].mean())
    residual: Floats = DEVIATOR @ entries / scale
    jacobian = np.zeros((6, 9))
    jacobian[:, 3:] = -DEVIATOR / scale
    jacobian[:, 3:6] += residual[:, np.newaxis] / entries[:3].sum()
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)


def sense(ellipsoid: Ellipsoid, middle: Floats, spread: float) -> NormalEquations:
    """Give normal equations that keep what no reading speaks for within sense.

    The centre lies within ten spreads of the readings from their middle, and the size is theirs to a factor of about
    ten. A level turn leaves both open across its plane; anything that was seen does not feel it.

    Parameters
    ----------
    ellipsoid : Ellipsoid
    middle : (3,) float
        Mean reading.
    spread : float
        Root mean square distance of the readings from it.
    """
    width = SENSE * spread
    residual = np.append(ellipsoid.centre - middle, np.trace(ellipsoid.shape) / 3.0 - spread) / width
    jacobian = np.zeros((4, 9))
    jacobian[:3, :3] = -np.eye(3) / width
    jacobian[3, 3:6] = -1.0 / (3.0 * width)
    return NormalEquations(jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 0)
