"""What a sensor reads that is turned about one of its axes: an ellipse, whatever else is known of its ellipsoid.

With the field u = (cos I cos ψ, −cos I sin ψ, sin I), in the order of the plane, it is

    (b + sin I S₃) + cos I S₂ (cos ψ, −sin ψ)

for S₃ the column of the shape that belongs to the axis turned about and S₂ the part of it in the plane. It is linear in
offset and shape, so a covariance comes along. Two calibrations of which one knows a plane alone are held against each
other there, and a method that fits a plane is asked about it.

>>> turned = Ellipsoid(np.array([10.0, 20.0, 30.0]), np.diag([50.0, 40.0, 60.0]))
>>> flat = equator(turned, "xy", dip_deg=60.0)
>>> flat.centre.round(9), np.diag(flat.shape).round(9)
(array([10., 20.,  0.]), array([25. , 20. , 22.5]))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.geometry.plane import order_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.geometry.plane import Plane


def equator(ellipsoid: Ellipsoid, plane: Plane, *, dip_deg: float) -> Ellipsoid:
    """Take the ellipse of a turn as the equator of an ellipsoid, whose third semi-axis is the mean of the two.

    Parameters
    ----------
    ellipsoid : Ellipsoid
    plane : str
        ``xy``, ``yz`` or ``zx``; the third axis is the one that is turned about.
    dip_deg : float
        Inclination of the field towards that axis.
    """
    parameters = to_equator(plane, dip_deg=dip_deg) @ ellipsoid.parameters
    return Ellipsoid(parameters[:3], symmetric(parameters[3:]))


def to_equator(plane: Plane, *, dip_deg: float) -> Floats:
    """(9, 9) matrix from (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃) to those of the equator; its rank is five."""
    first, second, third = order_of(plane)
    dip = np.deg2rad(dip_deg)
    rows = np.zeros((9, 9))
    for place in (first, second):
        rows[place, place] = 1.0
        rows[place, _ENTRY[place, third]] = np.sin(dip)
        rows[_ENTRY[place, place], _ENTRY[place, place]] = np.cos(dip)
        rows[_ENTRY[third, third], _ENTRY[place, place]] = np.cos(dip) / 2.0
    rows[_ENTRY[first, second], _ENTRY[first, second]] = np.cos(dip)
    return rows


_ENTRY = np.array([[3, 6, 7], [6, 4, 8], [7, 8, 5]])
"""Where each entry of the shape stands among the nine."""
