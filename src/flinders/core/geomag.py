"""The earth's field at a site: World Magnetic Model of its date, or IGRF-14 before 2010.

>>> seattle = site_field(47.6205, -122.3493, year=2025.25)
>>> seattle.model, round(seattle.declination_deg, 2), round(seattle.inclination_deg, 2)
('WMM-2025', 15.07, 68.82)
>>> print(seattle)
WMM-2025 at 47.6205, -122.349, 0 m, in 2025.25: declination 15.07° E ± 0.39°, dip 68.8°, 52.77 µT

A compass shows magnetic north; ``true = magnetic + declination``, east positive. `SiteField.grid` is grid north of the
map, ``grid = true − convergence``.
World Magnetic Models are valid from 2010 to 2030, each for five years from its epoch; of 2015 the second version is
used, which followed the motion of the pole. IGRF-14 is valid from 1900 to 2030 and is used before 2010. The
high-resolution model, WMMHR-2025, includes the crust to wavelengths of 300 km. No model includes local fields of rock,
buildings and vehicles.

>>> site_field(47.6205, -122.3493, year=2025.25, model="wmmhr").model, site_field(47.6205, -122.3493, year=1985.0).model
('WMMHR-2025', 'IGRF-14')
"""

from __future__ import annotations

import datetime
import math
import re
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from flinders.core import igrf
from flinders.core.grid_north import GridNorth, grid_north
from flinders.errors import UsageError

ASSUMED_DIP_DEG: Final = 60.0
"""Dip of the field, in degrees, if the place of a recording is not known."""

FieldModel = Literal["wmm", "wmmhr", "igrf"]
"""Families of models: World Magnetic Model, its high resolution, International Geomagnetic Reference Field."""

MODEL_YEARS: Final[dict[FieldModel, tuple[float, float]]] = {
    "wmm": (2010.0, 2030.0), "wmmhr": (2025.0, 2030.0), "igrf": (1900.0, 2030.0)
}  # fmt: skip
"""First and last year of each family of models."""

FIRST_YEAR, LAST_YEAR = MODEL_YEARS["igrf"]
"""First and last year for which any model is available."""

FIRST_CLOCK_YEAR, LAST_CLOCK_YEAR = MODEL_YEARS["wmm"]
"""Years for which the clock of a log is trusted: a clock that was never set, or rolled over, shows an earlier year."""

LOWEST_M, HIGHEST_M = -1000.0, 850_000.0
"""Range of altitudes of the models, in metres."""

BLACKOUT_UT: Final = 2.0
"""Horizontal field in µT below which a compass is unusable (NOAA's blackout zone)."""
CAUTION_UT: Final = 6.0
"""Horizontal field in µT below which a compass is unreliable (NOAA's caution zone)."""

FIRST_SIGMA_YEAR: Final = 2015.0
"""First year of a World Magnetic Model with a published formula of its uncertainty."""

_NANOTESLA: Final = 1e-3


@dataclass(frozen=True, slots=True)
class SiteField:
    """The earth's field at a place and time, by a model."""

    model: str  #: its name, such as ``WMM-2025``
    latitude_deg: float  #: geodetic; north and east positive
    longitude_deg: float  #: east positive
    altitude_m: float  #: above the ellipsoid of WGS 84
    year: float  #: decimal year
    north: float  #: µT: component along true north
    east: float  #: µT: component along true east
    down: float  #: µT: component along the vertical
    declination_deg: float  #: from true to magnetic north, east positive, in (−180, 180]
    inclination_deg: float  #: dip below the horizon, negative in the south
    horizontal: float  #: µT: length of the horizontal component
    strength: float  #: µT: length of the field
    #: 1 σ of the model, including the crust, as published; None if none is published: for WMM-2010, and for IGRF-14
    #: before 1980 and after 2025
    declination_sigma_deg: float | None = None
    inclination_sigma_deg: float | None = None  #: 1 σ of the model
    strength_sigma: float | None = None  #: µT: 1 σ of the model

    @property
    def is_blackout(self) -> bool:
        """Whether the horizontal field is below 2 µT, where no compass works."""
        return self.horizontal < BLACKOUT_UT

    @property
    def is_caution(self) -> bool:
        """Whether the horizontal field is below 6 µT, where a compass is unreliable."""
        return self.horizontal < CAUTION_UT

    @property
    def warning(self) -> str:
        """Warning where the field is nearly vertical; empty elsewhere."""
        words = f"the horizontal field at this site is {1e3 * self.horizontal:,.0f} nT"
        if self.is_blackout:
            return f"{words}, below 2,000 nT: neither a compass nor the declination can be trusted here"
        return f"{words}, below 6,000 nT: a compass is unreliable here" if self.is_caution else ""

    @property
    def grid(self) -> GridNorth:
        """Grid north of the map at this place: UTM, or UPS around the poles."""
        return grid_north(self.latitude_deg, self.longitude_deg)

    @property
    def grid_declination_deg(self) -> float:
        """From grid to magnetic north, east positive, in (−180, 180]: the declination less the convergence."""
        return 180.0 - (180.0 - self.declination_deg + self.grid.convergence_deg) % 360.0

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, under the names of the attributes."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__} | {
            "grid": self.grid.as_dict(),  # grid north of the map at this place
            "grid_declination_deg": self.grid_declination_deg,  # from grid to magnetic north, east positive
        }

    def __str__(self) -> str:
        sigma = "" if self.declination_sigma_deg is None else f" ± {self.declination_sigma_deg:.2f}°"
        side = "E" if self.declination_deg >= 0.0 else "W"
        return (
            f"{self.model} at {self.latitude_deg:g}, {self.longitude_deg:g}, {self.altitude_m:g} m, "
            f"in {self.year:.2f}: declination {abs(self.declination_deg):.2f}° {side}{sigma}, "
            f"dip {self.inclination_deg:.1f}°, {self.strength:.2f} µT"
        )


def site_field(
    latitude_deg: float, longitude_deg: float, altitude_m: float = 0.0, *, year: float, model: FieldModel | None = None
) -> SiteField:
    """Compute the earth's field at a place and time.

    Raises `UsageError` for a place that does not exist, a year without a model, or a model that is not valid then.

    Parameters
    ----------
    latitude_deg, longitude_deg : float, degrees
        Geodetic, −90 to 90 and −180 to 360; north and east positive.
    altitude_m : float, m
        Above the ellipsoid, −1,000 to 850,000; the height above sea level is accurate enough.
    year : float
        Decimal year, as from `decimal_year`, 1900 to 2030.
    model : ``wmm``, ``wmmhr`` or ``igrf``, optional
        Family of models; by default the World Magnetic Model of the year, before 2010 IGRF-14.

    Notes
    -----
    World Magnetic Models are evaluated by pygeomag, which is loaded here. All of NOAA's printed test values for WMM2025
    agree to the digit that is printed; IGRF-14 agrees to 0.01 nT with values of the British Geological Survey
    (``tests/core/test_geomag.py``, ``tests/core/test_igrf.py``).
    """
    _refuse_invalid_place(latitude_deg, longitude_deg, altitude_m)
    place = (float(latitude_deg), float(longitude_deg), float(altitude_m))
    family = _model_for(year, model)
    elements = _igrf_elements(*place, year) if family == "igrf" else _wmm_elements(*place, year, family)
    latitude_deg, longitude_deg, altitude_m = place
    return SiteField(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m, year=float(year), **elements
    )


def _wmm_elements(
    latitude_deg: float, longitude_deg: float, altitude_m: float, year: float, family: FieldModel
) -> dict[str, Any]:
    """Field by the World Magnetic Model of a year, as arguments of `SiteField`."""
    from pygeomag import GeoMag

    model = GeoMag(base_year=min(math.floor(year), 2029), high_resolution=family == "wmmhr")
    found: Any = model.calculate(latitude_deg, longitude_deg, altitude_m / 1000.0, year)
    elements = {
        "model": str(model.model),
        "north": found.x * _NANOTESLA,
        "east": found.y * _NANOTESLA,
        "down": found.z * _NANOTESLA,
        "declination_deg": float(found.d),
        "inclination_deg": float(found.i),
        "horizontal": found.h * _NANOTESLA,
        "strength": found.f * _NANOTESLA,
    }
    if year < FIRST_SIGMA_YEAR:
        return elements
    sigma: Any = found.calculate_uncertainty()
    return elements | {
        "declination_sigma_deg": float(min(sigma.d, 180.0)),
        "inclination_sigma_deg": float(sigma.i),
        "strength_sigma": sigma.f * _NANOTESLA,
    }


def _igrf_elements(latitude_deg: float, longitude_deg: float, altitude_m: float, year: float) -> dict[str, Any]:
    """Field by IGRF-14, as arguments of `SiteField`; from 1980 to 2025 with its uncertainty, to first order."""
    north, east, down = (igrf.igrf_field(latitude_deg, longitude_deg, altitude_m, year=year) * _NANOTESLA).tolist()
    horizontal, strength = math.hypot(north, east), math.hypot(north, east, down)
    declination, inclination = math.atan2(east, north), math.atan2(down, horizontal)
    elements = {
        "model": igrf.MODEL_NAME, "north": north, "east": east, "down": down,
        "declination_deg": math.degrees(declination), "inclination_deg": math.degrees(inclination),
        "horizontal": horizontal, "strength": strength,
    }  # fmt: skip
    if not igrf.SIGMA_YEARS[0] <= year <= igrf.SIGMA_YEARS[1]:
        return elements
    x, y, z = (sigma * _NANOTESLA for sigma in igrf.COMPONENT_SIGMA_NT)
    sine, cosine = math.sin(declination), math.cos(declination)
    along, across = math.hypot(cosine * x, sine * y), math.hypot(sine * x, cosine * y)  # the magnetic meridian
    dip_sigma = math.hypot(horizontal * z, down * along) / strength**2
    return elements | {
        "declination_sigma_deg": min(math.degrees(across / max(horizontal, _NANOTESLA)), 180.0),
        "inclination_sigma_deg": math.degrees(dip_sigma),
        "strength_sigma": math.hypot(north * x, east * y, down * z) / strength,
    }


def newest_model() -> dict[str, Any]:
    """The newest World Magnetic Model, JSON-ready: name, epoch, years of validity, and coefficients.

    Each row of coefficients has g and h in nT, and their changes in nT a year. Rows are in the order of the model's
    file: degree 1, orders 0 and 1; degree 2, orders 0 to 2; and so on.

    >>> model = newest_model()
    >>> model["name"], model["epoch"], len(model["coefficients"]), model["coefficients"][0]
    ('WMM-2025', 2025.0, 90, [-29351.8, 0.0, 12.0, 0.0])
    """
    from pygeomag.wmm.wmm_2025 import WMM_2025

    (epoch, name, _), rows = WMM_2025
    coefficients = [list(numbers) for _, _, *numbers in rows]
    return {"name": name, "epoch": epoch, "years": 5, "coefficients": coefficients}


def recorded_field(log: object) -> SiteField | None:
    """Earth's field at the place and date in a log, or in the part of one magnetometer; None without place or date.

    Also None if the log's clock shows a year outside of those of the World Magnetic Model, such as a clock that was
    never set: give place and day of such a log.
    """
    position, start_time = getattr(log, "position", None), getattr(log, "start_time", None)
    if position is None or start_time is None or not FIRST_CLOCK_YEAR <= start_time.year < LAST_CLOCK_YEAR:
        return None
    return site_field(position.latitude_deg, position.longitude_deg, position.altitude_m, year=decimal_year(start_time))


def parse_place(text: str) -> tuple[float, float, float]:
    """Parse ``"LAT,LON"`` or ``"LAT,LON,ALT"``: degrees, north and east positive, and metres, or raise `UsageError`.

    >>> parse_place("47.6, -122.3"), parse_place("-33.9,151.2,40")
    ((47.6, -122.3, 0.0), (-33.9, 151.2, 40.0))
    """
    parts = text.replace("\N{MINUS SIGN}", "-").split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in {2, 3}:
        raise UsageError(
            f"{text!r} is not a place: need latitude,longitude in degrees, north and east positive, optionally with "
            "the altitude in metres, such as 47.62,-122.35 or -33.9,151.2,40"
        )
    latitude, longitude, altitude = (*numbers, 0.0)[:3]
    _refuse_invalid_place(latitude, longitude, altitude)
    return latitude, longitude, altitude


def decimal_year(day: datetime.date | str | float) -> float:
    """Convert a day to a decimal year.

    Text is ``2026-11-21`` or ``2026.9``; a number is a decimal year. Raises `UsageError` for text that is not a date,
    and for a year without a model.

    >>> decimal_year("2025-07-02"), decimal_year(datetime.date(2026, 1, 1)), decimal_year("2027.5")
    (2025.498..., 2026.0, 2027.5)
    """
    year = (
        _parse_year(day)
        if isinstance(day, str)
        else _decimal_year(day)
        if isinstance(day, datetime.date)
        else float(day)
    )
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise UsageError(
            f"{_date_text(day)} is outside the models of the earth's field, {FIRST_YEAR:.0f} to {LAST_YEAR:.0f}: "
            "give the date of the recording, or leave the place out"
        )
    return year


def _parse_year(text: str) -> float:
    """Parse a day or a decimal year."""
    bare = text.strip()
    if re.fullmatch(r"\d{4}(\.\d+)?", bare):
        return float(bare)
    try:
        return _decimal_year(datetime.datetime.fromisoformat(bare))
    except ValueError:
        raise UsageError(
            f"{text!r} is not a date: need the day of the recording such as 2026-11-21, or a year such as 2026.9"
        ) from None


def _decimal_year(day: datetime.date) -> float:
    """Decimal year at the beginning of a day, or at the time of a datetime."""
    start = datetime.date(day.year, 1, 1)
    length = 366.0 if day.year % 4 == 0 and (day.year % 100 != 0 or day.year % 400 == 0) else 365.0
    days = float(datetime.date(day.year, day.month, day.day).toordinal() - start.toordinal())
    if isinstance(day, datetime.datetime):
        days += (day.hour + day.minute / 60.0 + day.second / 3600.0) / 24.0
    return day.year + days / length


def _date_text(day: datetime.date | str | float) -> str:
    return f"{day:g}" if isinstance(day, float | int) else str(day)


def _model_for(year: float, asked: FieldModel | None) -> FieldModel:
    """Family of models for a year: the requested one if it is valid then, by default the most accurate one."""
    decimal_year(year)
    if asked is None:
        return "wmm" if year >= MODEL_YEARS["wmm"][0] else "igrf"
    if asked not in get_args(FieldModel):
        raise UsageError(f"field model {asked!r} is not known: need one of {', '.join(get_args(FieldModel))}")
    first, last = MODEL_YEARS[asked]
    if not first <= year <= last:
        raise UsageError(f"{asked} is valid from {first:.0f} to {last:.0f}, not in {year:g}: leave the model out")
    return asked


def _refuse_invalid_place(latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
    """Refuse a place that is not on or near the earth."""
    if not -90.0 <= latitude_deg <= 90.0:
        swapped = "; the latitude comes first" if abs(latitude_deg) <= 180.0 and abs(longitude_deg) <= 90.0 else ""
        raise UsageError(f"latitude is {latitude_deg:g}°: need −90° to 90°{swapped}")
    if not -180.0 <= longitude_deg <= 360.0:
        raise UsageError(f"longitude is {longitude_deg:g}°: need −180° to 180°, east positive")
    if not LOWEST_M <= altitude_m <= HIGHEST_M:
        raise UsageError(f"altitude is {altitude_m:g} m: need {LOWEST_M:,.0f} to {HIGHEST_M:,.0f} metres")
