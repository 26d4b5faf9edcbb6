"""The International Geomagnetic Reference Field, 1900 to 2030: degree 10, from 1995 on degree 13.

>>> north, east, down = igrf_field(60.39299, 5.32415, year=1985.0)
>>> f"{north:.1f} {east:.1f} {down:.1f} nT"
'14966.5 -1135.0 47984.3 nT'

The potential is ``a Σ (a/r)ⁿ⁺¹ (gₙᵐ cos mλ + hₙᵐ sin mλ) Pₙᵐ(cos θ)`` with a = 6371.2 km and Schmidt's semi-normalised
Pₙᵐ; the field is its negative gradient. Between epochs of five years the coefficients are interpolated linearly.

Source: International Association of Geomagnetism and Aeronomy, *IGRF-14* (2024), doi:10.5281/zenodo.14012302. The table
``igrf14.shc`` is the file of that record, as ppigrf 2.1.0 distributes it (MIT licence, K. M. Laundal and IAGA's working
group V-MOD). Formulas: R. A. Langel, *The main field*, in Geomagnetism I (1987), section 2.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

MODEL_NAME: Final = "IGRF-14"

REFERENCE_RADIUS_KM: Final = 6371.2
"""Reference radius of the coefficients in km."""

EQUATORIAL_RADIUS_KM, FLATTENING = 6378.137, 1.0 / 298.257223563
"""The ellipsoid of WGS 84: equatorial radius in km and flattening."""

COMPONENT_SIGMA_NT: Final = (144.0, 136.0, 293.0)
"""Standard deviations of the model's north, east and down components in nT, including the crust.

Source: C. D. Beggan, *Evidence-based uncertainty estimates for the International Geomagnetic Reference Field*, Earth,
Planets and Space 74:17 (2022): observatories and repeat stations, 1980 to 2021.
"""
SIGMA_YEARS: Final = (1980.0, 2025.0)
"""First and last year of `COMPONENT_SIGMA_NT`: none is published before, and the model only predicts after."""

_TABLE: Final = Path(__file__).with_name("igrf14.shc")

_MIN_SINE: Final = 1e-10
"""Smallest sine of the colatitude: at a pole east is undefined."""


class Coefficients(NamedTuple):
    """Gauss coefficients of all epochs, nT."""

    years: Floats  # (E,) epochs
    g: Floats  # (E, 14, 14) by degree and order
    h: Floats  # (E, 14, 14)

    def at(self, year: float) -> tuple[Floats, Floats]:
        """(14, 14) g and h in a year, interpolated linearly, in nT."""
        after = int(np.clip(np.searchsorted(self.years, year, side="right"), 1, len(self.years) - 1))
        share = (year - self.years[after - 1]) / (self.years[after] - self.years[after - 1])
        g, h = ((1.0 - share) * table[after - 1] + share * table[after] for table in (self.g, self.h))
        return g, h


@functools.cache
def coefficients() -> Coefficients:
    """Read the table of coefficients, with a cache."""
    lines = [line.split() for line in _TABLE.read_text(encoding="ascii").splitlines() if not line.startswith("#")]
    degrees, years = int(lines[0][1]) + 1, np.array(lines[1], float)
    g, h = np.zeros((2, len(years), degrees, degrees))
    for n, m, *values in lines[2:]:
        table, order = (g, int(m)) if int(m) >= 0 else (h, -int(m))
        table[:, int(n), order] = np.array(values, float)
    return Coefficients(years, g, h)


def igrf_field(latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0, *, year: float) -> Floats:
    """(3,) field in nT along true north, east and down at a geodetic place.

    Parameters
    ----------
    latitude_deg, longitude_deg : float, degrees
        Geodetic, north and east positive.
    altitude_m : float, m
        Above the ellipsoid of WGS 84.
    year : float
        Decimal year, 1900 to 2030.
    """
    latitude, height = math.radians(latitude_deg), altitude_m / 1000.0
    eccentricity = FLATTENING * (2.0 - FLATTENING)  # squared
    normal = EQUATORIAL_RADIUS_KM / math.sqrt(1.0 - eccentricity * math.sin(latitude) ** 2)
    across = (normal + height) * math.cos(latitude)
    along = (normal * (1.0 - eccentricity) + height) * math.sin(latitude)
    radius, geocentric = math.hypot(across, along), math.atan2(along, across)
    north, east, down = geocentric_field(radius, 90.0 - math.degrees(geocentric), longitude_deg, year=year)
    turn = latitude - geocentric  # the vertical of the ellipsoid leans from the radius
    cosine, sine = math.cos(turn), math.sin(turn)
    return np.array([cosine * north + sine * down, east, cosine * down - sine * north])


def geocentric_field(radius_km: float, colatitude_deg: float, longitude_deg: float, *, year: float) -> Floats:
    """(3,) field in nT along geocentric north, east and towards the earth's centre."""
    g, h = coefficients().at(year)
    orders = np.arange(len(g))
    longitude = math.radians(longitude_deg)
    cosine = math.cos(math.radians(colatitude_deg))
    sine = max(math.sin(math.radians(colatitude_deg)), _MIN_SINE)
    legendre, slope = _legendre(cosine, sine, len(g))
    by_order = g * np.cos(orders * longitude) + h * np.sin(orders * longitude)
    across = orders * (h * np.cos(orders * longitude) - g * np.sin(orders * longitude))
    falling = (REFERENCE_RADIUS_KM / radius_km) ** (orders + 2.0)
    north = falling @ (by_order * slope).sum(axis=1)
    east = -(falling @ (across * legendre).sum(axis=1)) / sine
    down = -((orders + 1.0) * falling) @ (by_order * legendre).sum(axis=1)
    return np.array([north, east, down])


def _legendre(cosine: float, sine: float, size: int) -> tuple[Floats, Floats]:
    """(size, size) Schmidt's semi-normalised Pₙᵐ(cos θ) by degree and order, and their derivatives by θ."""
    value, slope = np.zeros((2, size, size))
    value[0, 0] = 1.0
    for n in range(1, size):
        step = 1.0 if n == 1 else math.sqrt((2 * n - 1) / (2 * n))
        value[n, n] = step * sine * value[n - 1, n - 1]
        slope[n, n] = step * (sine * slope[n - 1, n - 1] + cosine * value[n - 1, n - 1])
        for m in range(n):
            before, scale = math.sqrt(max((n - 1) ** 2 - m * m, 0)), math.sqrt(n * n - m * m)
            older, older_slope = (value[n - 2, m], slope[n - 2, m]) if n > 1 else (0.0, 0.0)
            value[n, m] = ((2 * n - 1) * cosine * value[n - 1, m] - before * older) / scale
            turned = cosine * slope[n - 1, m] - sine * value[n - 1, m]
            slope[n, m] = ((2 * n - 1) * turned - before * older_slope) / scale
    return value, slope
