"""Angles modulo 360°: headings in [0, 360) and differences in (−180, 180].

>>> wrap_360([-10.0, 360.0, 725.0]), wrap_180([350.0, -180.0, 181.0])
(array([350.,   0.,   5.]), array([ -10.,  180., -179.]))

A tiny negative angle is not 360:

>>> float(wrap_360(-1e-20))
0.0
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.arrays import Floats, to_floats

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def wrap_360(angle_deg: ArrayLike) -> Floats:
    """Angles of any shape modulo 360°, in [0, 360); NaN stays."""
    turned = np.asarray(np.mod(to_floats(angle_deg, "angle"), 360.0))
    return np.where(turned >= 360.0, 0.0, turned) + 0.0  # the remainder of −1e-20 is rounded up to 360


def wrap_180(angle_deg: ArrayLike) -> Floats:
    """Differences of angles of any shape modulo 360°, in (−180, 180]; NaN stays."""
    return 180.0 - wrap_360(180.0 - to_floats(angle_deg, "angle"))


def mean_deg(angles_deg: ArrayLike) -> float:
    """Circular mean of (N,) angles in degrees, in [0, 360); NaN if their unit vectors cancel.

    >>> round(mean_deg([350.0, 20.0]), 9)
    5.0
    """
    total = complex(np.exp(1j * np.deg2rad(to_floats(angles_deg, "angles"))).sum())
    return float(wrap_360(np.rad2deg(np.angle(total)))) if abs(total) > 1e-9 else float("nan")


def deflection_deg(share: float) -> float:
    """Largest angle in degrees by which a vector turns if another of `share` times its length is added to it.

    It is asin(`share`), and 180° for a share of 1 or more.

    >>> round(deflection_deg(0.1), 2), deflection_deg(1.2)
    (5.74, 180.0)
    """
    return float(np.rad2deg(np.arcsin(share))) if share < 1.0 else 180.0


def heading_text(heading_deg: float, digits: int = 1) -> str:
    """Write a heading as navigators do: three digits before the point, and 000 instead of 360.

    >>> heading_text(7.25), heading_text(359.96), heading_text(45.0, 0)
    ('007.2°', '000.0°', '045°')
    """
    if not np.isfinite(heading_deg):
        return "?"
    rounded = float(wrap_360(round(float(heading_deg), digits)))
    return f"{rounded:0{4 + digits if digits else 3}.{digits}f}°"
