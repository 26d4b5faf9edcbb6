"""Grid north of maps: UTM, and UPS around the poles, on the ellipsoid of WGS 84.

>>> grid_north(60.39135, 5.3249)
GridNorth(name='UTM 32N', convergence_deg=-3.19628144...)

Grid north points along a line of the grid, true north along the meridian, and the convergence γ is the angle from true
to grid north, east positive: ``grid bearing = true bearing − γ``. On the middle meridian of a zone γ is zero.

With conformal latitude χ and angle λ from the middle meridian, ``ζ′ = ξ′ + iη′``, ``tan ξ′ = tan χ / cos λ`` and
``tanh η′ = cos χ sin λ``, the projection is ``ζ = ζ′ + Σ αⱼ sin 2jζ′`` and
``γ = atan2(sin χ sin λ, cos λ) − arg(1 + Σ 2jαⱼ cos 2jζ′)``.

Source: C. F. F. Karney, *Transverse Mercator with an accuracy of a few nanometers*, Journal of Geodesy 85 (2011),
equations 7–12, 23–25 and 35, after L. Krüger (1912). Zones: DMA TM 8358.2, *The Universal Grids* (1989).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any, Final

from flinders.core.igrf import FLATTENING

ECCENTRICITY: Final = math.sqrt(FLATTENING * (2.0 - FLATTENING))

SOUTH_END_DEG, NORTH_END_DEG = -80.0, 84.0
"""Latitudes between which the grid is UTM."""

_N: Final = FLATTENING / (2.0 - FLATTENING)  # third flattening

KRUEGER_COEFFICIENTS: Final = (
    _N / 2 - _N**2 * 2 / 3 + _N**3 * 5 / 16 + _N**4 * 41 / 180,
    _N**2 * 13 / 48 - _N**3 * 3 / 5 + _N**4 * 557 / 1440,
    _N**3 * 61 / 240 - _N**4 * 103 / 140,
    _N**4 * 49561 / 161280,
)
"""α₁ to α₄ of Karney's equation 35. Higher terms change γ by less than 10⁻¹⁰ degrees within a zone."""


@dataclass(frozen=True, slots=True)
class GridNorth:
    """Grid north of a map at a place: the name of the grid, and its convergence."""

    name: str  #: grid and zone, such as ``UTM 32N``
    convergence_deg: float  #: from true to grid north, east positive, in (−180, 180]

    def as_dict(self) -> dict[str, Any]:
        """Attributes by their names, JSON-ready."""
        return {"name": self.name, "convergence_deg": self.convergence_deg}

    def __str__(self) -> str:
        side = "E" if self.convergence_deg >= 0.0 else "W"
        return f"grid north of {self.name} {abs(self.convergence_deg):.2f}° {side} of true north"


def grid_north(latitude_deg: float, longitude_deg: float) -> GridNorth:
    """Grid north of maps at a place: UTM from 80° S to 84° N, else UPS.

    Parameters
    ----------
    latitude_deg, longitude_deg : float, degrees
        Geodetic, −90 to 90 and −180 to 360; north and east positive.
    """
    longitude = (longitude_deg + 180.0) % 360.0 - 180.0
    if not SOUTH_END_DEG <= latitude_deg < NORTH_END_DEG:
        is_north = latitude_deg > 0.0
        turned = longitude if is_north or longitude == 0.0 else -longitude
        return GridNorth(f"UPS {'north' if is_north else 'south'}", 180.0 if turned == -180.0 else turned)
    zone = utm_zone(latitude_deg, longitude)
    middle = 6.0 * zone - 183.0
    convergence = utm_convergence_deg(latitude_deg, longitude - middle)
    return GridNorth(f"UTM {zone}{'N' if latitude_deg >= 0.0 else 'S'}", convergence)


def utm_zone(latitude_deg: float, longitude_deg: float) -> int:
    """Zone of UTM, 1 to 60, with the exceptions of Norway (32V) and Svalbard (31X, 33X, 35X, 37X).

    >>> utm_zone(47.62, -122.35), utm_zone(60.4, 5.3), utm_zone(78.2, 15.6), utm_zone(0.0, 180.0)
    (10, 32, 33, 1)
    """
    longitude = (longitude_deg + 180.0) % 360.0 - 180.0
    if 56.0 <= latitude_deg < 64.0 and 3.0 <= longitude < 12.0:
        return 32
    if 72.0 <= latitude_deg < 84.0 and 0.0 <= longitude < 42.0:
        return 31 + 2 * int((longitude + 3.0) // 12.0)
    return int((longitude + 180.0) // 6.0) + 1


def utm_convergence_deg(latitude_deg: float, from_middle_deg: float) -> float:
    """Convergence of a transverse Mercator grid, degrees.

    Parameters
    ----------
    latitude_deg : float, degrees
        Geodetic, north positive, away from the poles.
    from_middle_deg : float, degrees
        Longitude relative to the middle meridian, within ±90.
    """
    angle, sine = math.radians(from_middle_deg), math.sin(math.radians(latitude_deg))
    isometric = math.atanh(sine) - ECCENTRICITY * math.atanh(ECCENTRICITY * sine)
    conformal = math.sinh(isometric)  # tan χ
    spherical = complex(
        math.atan2(conformal, math.cos(angle)), math.asinh(math.sin(angle) / math.hypot(conformal, math.cos(angle)))
    )
    stretch = 1.0 + sum(2 * j * alpha * cmath.cos(2 * j * spherical) for j, alpha in enumerate(KRUEGER_COEFFICIENTS, 1))
    turned = math.atan2(math.tanh(isometric) * math.sin(angle), math.cos(angle))
    return math.degrees(turned - cmath.phase(stretch))
