"""The earth's field at a site, from the World Magnetic Model of the day.

>>> seattle = site_field(47.6205, -122.3493, year=2025.25)
>>> seattle.model, round(seattle.declination_deg, 2), round(seattle.inclination_deg, 2)
('WMM-2025', 15.07, 68.82)
>>> print(seattle)
WMM-2025 at 47.6205, -122.349, 0 m, in 2025.25: declination 15.07° E ± 0.39°, dip 68.8°, 52.77 µT

A compass shows magnetic north; ``true = magnetic + declination``, east positive.
The models hold from 2010 to 2030, each for five years from its epoch; the second of 2015 is used, which replaced the
first when the pole ran away from it. What they cannot show is local: rock, buildings, vehicles.
"""

from __future__ import annotations

import datetime
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import UsageError

if TYPE_CHECKING:
    from pygeomag import GeoMag

ASSUMED_DIP_DEG: Final = 60.0
"""Dip of the field where nobody says where a recording was made."""

FIRST_YEAR, LAST_YEAR = 2010.0, 2030.0
"""A model is available between these."""

LOWEST_M, HIGHEST_M = -1000.0, 850_000.0
"""Altitudes for which the models are made, in metres."""

BLACKOUT: Final = 2.0
"""µT of horizontal field below which declination means nothing, and a compass is of no use (NOAA's blackout zone)."""
CAUTION: Final = 6.0
"""µT of horizontal field below which a compass is unreliable (NOAA's caution zone)."""

_NANOTESLA: Final = 1e-3


@dataclass(frozen=True, slots=True)
class SiteField:
    """What a magnetometer should meet at a place and time."""

    model: str  #: its name, such as ``WMM-2025``
    latitude_deg: float  #: geodetic; north and east positive
    longitude_deg: float  #: east positive
    altitude_m: float  #: above the ellipsoid of WGS 84
    year: float  #: with its fraction
    north: float  #: µT: component along true north
    east: float  #: µT: component along true east
    down: float  #: µT: component along the vertical
    declination_deg: float  #: from true to magnetic north, east positive, in (−180, 180]
    inclination_deg: float  #: dip below the horizon, negative in the south
    horizontal: float  #: µT: length of the horizontal component
    strength: float  #: µT: length of the field
    #: the model's published uncertainty, 1 σ, crust and all, in degrees and µT; None for WMM-2010
    declination_sigma_deg: float | None = None
    inclination_sigma_deg: float | None = None  #: 1 σ of the model
    strength_sigma: float | None = None  #: µT: 1 σ of the model

    @property
    def is_blackout(self) -> bool:
        """The horizontal field is below 2 µT: no compass works here, and the declination means nothing."""
        return self.horizontal < BLACKOUT

    @property
    def is_caution(self) -> bool:
        """The horizontal field is below 6 µT: a compass is unreliable here."""
        return self.horizontal < CAUTION

    @property
    def doubt(self) -> str:
        """What to know where the field is nearly vertical; nothing elsewhere."""
        words = f"the horizontal field at this site is {1e3 * self.horizontal:,.0f} nT"
        if self.is_blackout:
            return f"{words}, below 2,000 nT: no compass can be trusted here, and the declination hardly at all"
        return f"{words}, below 6,000 nT: a compass is unreliable here" if self.is_caution else ""

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, under the names of the attributes."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __str__(self) -> str:
        sigma = "" if self.declination_sigma_deg is None else f" ± {self.declination_sigma_deg:.2f}°"
        side = "E" if self.declination_deg >= 0.0 else "W"
        return (
            f"{self.model} at {self.latitude_deg:g}, {self.longitude_deg:g}, {self.altitude_m:g} m, "
            f"in {self.year:.2f}: declination {abs(self.declination_deg):.2f}° {side}{sigma}, "
            f"dip {self.inclination_deg:.1f}°, {self.strength:.2f} µT"
        )


def site_field(latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0, *, year: float) -> SiteField:
    """Ask the World Magnetic Model of a year.

    Raises `UsageError` for a place that there is not, or a time without a model.

    Parameters
    ----------
    latitude_deg, longitude_deg : float, degrees
        Geodetic, −90 to 90 and −180 to 360; north and east positive.
    altitude_m : float, m
        Above the ellipsoid, −1,000 to 850,000; sea level is near enough.
    year : float
        With its fraction, as `year_of` gives it: 2010 to 2030.

    Notes
    -----
    Evaluated by pygeomag, which is loaded here. All of NOAA's printed test values for WMM2025 agree to the digit that
    is printed (``tests/core/test_geomag.py``).
    """
    _refuse_nowhere(latitude_deg, longitude_deg, altitude_m)
    model = _model(year)
    elements: Any = model.calculate(latitude_deg, longitude_deg, altitude_m / 1000.0, year)
    sigma: Any = elements.calculate_uncertainty() if year >= 2015.0 else None
    return SiteField(
        str(model.model),
        float(latitude_deg),
        float(longitude_deg),
        float(altitude_m),
        float(year),
        north=elements.x * _NANOTESLA,
        east=elements.y * _NANOTESLA,
        down=elements.z * _NANOTESLA,
        declination_deg=float(elements.d),
        inclination_deg=float(elements.i),
        horizontal=elements.h * _NANOTESLA,
        strength=elements.f * _NANOTESLA,
        declination_sigma_deg=None if sigma is None else float(min(sigma.d, 180.0)),
        inclination_sigma_deg=None if sigma is None else float(sigma.i),
        strength_sigma=None if sigma is None else sigma.f * _NANOTESLA,
    )


def newest_model() -> dict[str, Any]:
    """The newest model as data: name, epoch, for how many years, and coefficients g, h and their change in a year, nT.

    In the order of its file: degree 1, orders 0 and 1; degree 2, orders 0 to 2; and so on.

    >>> model = newest_model()
    >>> model["name"], model["epoch"], len(model["coefficients"]), model["coefficients"][0]
    ('WMM-2025', 2025.0, 90, [-29351.8, 0.0, 12.0, 0.0])
    """
    from pygeomag.wmm.wmm_2025 import WMM_2025

    (epoch, name, _), rows = WMM_2025
    coefficients = [list(numbers) for _, _, *numbers in rows]
    return {"name": name, "epoch": epoch, "years": 5, "coefficients": coefficients}


def recorded_field(log: object) -> SiteField | None:
    """The field where and when a log, or a magnetometer of one, says that it was made; None where it does not."""
    position, begun = getattr(log, "position", None), getattr(log, "begun", None)
    if position is None or begun is None or not FIRST_YEAR <= begun.year < LAST_YEAR:
        return None
    return site_field(position.latitude_deg, position.longitude_deg, position.altitude_m, year=year_of(begun))


def place_of(text: str) -> tuple[float, float, float]:
    """Read ``"LAT,LON"`` or ``"LAT,LON,ALT"``: degrees, north and east positive, and metres; else raise `UsageError`.

    >>> place_of("47.6, -122.3"), place_of("-33.9,151.2,40")
    ((47.6, -122.3, 0.0), (-33.9, 151.2, 40.0))
    """
    parts = text.replace("\N{MINUS SIGN}", "-").split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in {2, 3}:
        raise UsageError(
            f"{text!r} is no place: need latitude,longitude in degrees, north and east positive, and if you like the "
            "altitude in metres, such as 47.62,-122.35 or -33.9,151.2,40"
        )
    latitude, longitude, altitude = (*numbers, 0.0)[:3]
    _refuse_nowhere(latitude, longitude, altitude)
    return latitude, longitude, altitude


def year_of(day: datetime.date | str | float) -> float:
    """Turn a day into a year with its fraction.

    Text is ``2026-11-21`` or ``2026.9``, a number is a year already. What is no day, or one without a model, raises
    `UsageError`.

    >>> year_of("2025-07-02"), year_of(datetime.date(2026, 1, 1)), year_of("2027.5")
    (2025.498..., 2026.0, 2027.5)
    """
    year = _read(day) if isinstance(day, str) else _fraction(day) if isinstance(day, datetime.date) else float(day)
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise UsageError(
            f"{_shown(day)} lies outside the World Magnetic Models from {FIRST_YEAR:.0f} to {LAST_YEAR:.0f}: give the "
            "date of the recording, or leave the place out"
        )
    return year


def _read(text: str) -> float:
    """A day or year as it is typed."""
    bare = text.strip()
    if re.fullmatch(r"\d{4}(\.\d+)?", bare):
        return float(bare)
    try:
        return _fraction(datetime.datetime.fromisoformat(bare))
    except ValueError:
        raise UsageError(
            f"{text!r} is no date: need the day of the recording such as 2026-11-21, or a year such as 2026.9"
        ) from None


def _fraction(day: datetime.date) -> float:
    """Year and the part of it that is over at the beginning of the day, or at the time of a datetime."""
    start = datetime.date(day.year, 1, 1)
    length = 366.0 if day.year % 4 == 0 and (day.year % 100 != 0 or day.year % 400 == 0) else 365.0
    days = float(datetime.date(day.year, day.month, day.day).toordinal() - start.toordinal())
    if isinstance(day, datetime.datetime):
        days += (day.hour + day.minute / 60.0 + day.second / 3600.0) / 24.0
    return day.year + days / length


def _shown(day: datetime.date | str | float) -> str:
    return f"{day:g}" if isinstance(day, float | int) else str(day)


def _model(year: float) -> GeoMag:
    """Load the coefficients of the model that holds in a year."""
    from pygeomag import GeoMag

    year_of(year)
    return GeoMag(base_year=min(math.floor(year), 2029))


def _refuse_nowhere(latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
    """Refuse a place that is not on, or near, the earth."""
    if not -90.0 <= latitude_deg <= 90.0:
        swapped = "; the latitude comes first" if abs(latitude_deg) <= 180.0 and abs(longitude_deg) <= 90.0 else ""
        raise UsageError(f"latitude is {latitude_deg:g}°: need −90° to 90°{swapped}")
    if not -180.0 <= longitude_deg <= 360.0:
        raise UsageError(f"longitude is {longitude_deg:g}°: need −180° to 180°, east positive")
    if not LOWEST_M <= altitude_m <= HIGHEST_M:
        raise UsageError(f"altitude is {altitude_m:g} m: need {LOWEST_M:,.0f} to {HIGHEST_M:,.0f} metres")
