"""The earth's field at a site, from the World Magnetic Model of the day; before 2010 from IGRF-14.

>>> seattle = site_field(47.6205, -122.3493, year=2025.25)
>>> seattle.model, round(seattle.declination_deg, 2), round(seattle.inclination_deg, 2)
('WMM-2025', 15.07, 68.82)
>>> print(seattle)
WMM-2025 at 47.6205, -122.349, 0 m, in 2025.25: declination 15.07° E ± 0.39°, dip 68.8°, 52.77 µT

A compass shows magnetic north; ``true = magnetic + declination``, east positive. `SiteField.grid` is north of the map's
grid, ``grid = true − convergence``.
World Magnetic Models hold from 2010 to 2030, each for five years from its epoch; the second of 2015 is used, which
replaced the first when the pole ran away from it. IGRF-14 holds from 1900 to 2030 and serves the years before. The
model of high resolution, WMMHR-2025, shows the crust to wavelengths of 300 km. What no model shows is local: rock,
buildings, vehicles.

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
"""Dip of the field where nobody says where a recording was made."""

FieldModel = Literal["wmm", "wmmhr", "igrf"]
"""Families of models: World Magnetic Model, its high resolution, International Geomagnetic Reference Field."""

YEARS: Final[dict[FieldModel, tuple[float, float]]] = {
    "wmm": (2010.0, 2030.0), "wmmhr": (2025.0, 2030.0), "igrf": (1900.0, 2030.0)
}  # fmt: skip
"""A model is available between these."""

FIRST_YEAR, LAST_YEAR = YEARS["igrf"]
"""Some model is available between these."""

FIRST_CLOCK_YEAR, LAST_CLOCK_YEAR = YEARS["wmm"]
"""Years in which the clock of a log is believed: one that was never set, or has rolled over, shows an earlier one."""

LOWEST_M, HIGHEST_M = -1000.0, 850_000.0
"""Altitudes for which the models are made, in metres."""

BLACKOUT: Final = 2.0
"""µT of horizontal field below which declination means nothing, and a compass is of no use (NOAA's blackout zone)."""
CAUTION: Final = 6.0
"""µT of horizontal field below which a compass is unreliable (NOAA's caution zone)."""

FIRST_JUDGED_YEAR: Final = 2015.0
"""First year of a World Magnetic Model with a published formula of its uncertainty."""

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
    #: the model's published uncertainty, 1 σ, crust and all, in degrees and µT; None where none is published: of
    #: WMM-2010, and of IGRF-14 before 1980 and after 2025
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

    @property
    def grid(self) -> GridNorth:
        """North of the grid of maps there: UTM, or UPS around the poles."""
        return grid_north(self.latitude_deg, self.longitude_deg)

    @property
    def grid_declination_deg(self) -> float:
        """From grid to magnetic north, east positive, in (−180, 180]: the declination less the convergence."""
        return 180.0 - (180.0 - self.declination_deg + self.grid.convergence_deg) % 360.0

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, under the names of the attributes."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__} | {
            "grid": self.grid.as_dict(),  # north of the grid of maps there
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
    """Ask a model of the earth's field.

    Raises `UsageError` for a place that there is not, a time without a model, or a model that does not hold then.

    Parameters
    ----------
    latitude_deg, longitude_deg : float, degrees
        Geodetic, −90 to 90 and −180 to 360; north and east positive.
    altitude_m : float, m
        Above the ellipsoid, −1,000 to 850,000; sea level is near enough.
    year : float
        With its fraction, as `year_of` gives it: 1900 to 2030.
    model : ``wmm``, ``wmmhr`` or ``igrf``, optional
        Family of models; by default the World Magnetic Model of the year, before 2010 IGRF-14.

    Notes
    -----
    World Magnetic Models are evaluated by pygeomag, which is loaded here. All of NOAA's printed test values for WMM2025
    agree to the digit that is printed; IGRF-14 agrees to 0.01 nT with values of the British Geological Survey
    (``tests/core/test_geomag.py``, ``tests/core/test_igrf.py``).
    """
    _refuse_nowhere(latitude_deg, longitude_deg, altitude_m)
    place = (float(latitude_deg), float(longitude_deg), float(altitude_m))
    family = _model_of(year, model)
    elements = _of_igrf(*place, year) if family == "igrf" else _of_wmm(*place, year, family)
    latitude_deg, longitude_deg, altitude_m = place
    return SiteField(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m, year=float(year), **elements
    )


def _of_wmm(
    latitude_deg: float, longitude_deg: float, altitude_m: float, year: float, family: FieldModel
) -> dict[str, Any]:
    """The field by the World Magnetic Model of a year, under the names of `SiteField`."""
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
    if year < FIRST_JUDGED_YEAR:
        return elements
    sigma: Any = found.calculate_uncertainty()
    return elements | {
        "declination_sigma_deg": float(min(sigma.d, 180.0)),
        "inclination_sigma_deg": float(sigma.i),
        "strength_sigma": sigma.f * _NANOTESLA,
    }


def _of_igrf(latitude_deg: float, longitude_deg: float, altitude_m: float, year: float) -> dict[str, Any]:
    """The field by IGRF-14 under the names of `SiteField`, from 1980 to 2025 with its uncertainty, to first order."""
    north, east, down = (igrf.igrf_field(latitude_deg, longitude_deg, altitude_m, year=year) * _NANOTESLA).tolist()
    horizontal, strength = math.hypot(north, east), math.hypot(north, east, down)
    declination, inclination = math.atan2(east, north), math.atan2(down, horizontal)
    elements = {
        "model": igrf.NAME, "north": north, "east": east, "down": down, "declination_deg": math.degrees(declination),
        "inclination_deg": math.degrees(inclination), "horizontal": horizontal, "strength": strength,
    }  # fmt: skip
    if not igrf.JUDGED_YEARS[0] <= year <= igrf.JUDGED_YEARS[1]:
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
    """The field where and when a log, or a magnetometer of one, says that it was made; None where it does not.

    Also None where its clock shows a year before 2010: give place and day of such a log.
    """
    position, begun = getattr(log, "position", None), getattr(log, "begun", None)
    if position is None or begun is None or not FIRST_CLOCK_YEAR <= begun.year < LAST_CLOCK_YEAR:
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
            f"{_shown(day)} lies outside the models of the earth's field, from {FIRST_YEAR:.0f} to {LAST_YEAR:.0f}: "
            "give the date of the recording, or leave the place out"
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


def _model_of(year: float, asked: FieldModel | None) -> FieldModel:
    """The family of models that is asked for, where it holds; by default the best known that holds in a year."""
    year_of(year)
    if asked is None:
        return "wmm" if year >= YEARS["wmm"][0] else "igrf"
    if asked not in get_args(FieldModel):
        raise UsageError(f"field model {asked!r} is not known: need one of {', '.join(get_args(FieldModel))}")
    first, last = YEARS[asked]
    if not first <= year <= last:
        raise UsageError(f"{asked} holds from {first:.0f} to {last:.0f}, and {year:g} is outside: leave the model out")
    return asked


def _refuse_nowhere(latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
    """Refuse a place that is not on, or near, the earth."""
    if not -90.0 <= latitude_deg <= 90.0:
        swapped = "; the latitude comes first" if abs(latitude_deg) <= 180.0 and abs(longitude_deg) <= 90.0 else ""
        raise UsageError(f"latitude is {latitude_deg:g}°: need −90° to 90°{swapped}")
    if not -180.0 <= longitude_deg <= 360.0:
        raise UsageError(f"longitude is {longitude_deg:g}°: need −180° to 180°, east positive")
    if not LOWEST_M <= altitude_m <= HIGHEST_M:
        raise UsageError(f"altitude is {altitude_m:g} m: need {LOWEST_M:,.0f} to {HIGHEST_M:,.0f} metres")
