"""Known field of the site: its strength and inclination.

A strength or inclination without an uncertainty is not used in the fit. The strength then only sets the length of
corrected readings, and headings are judged at the inclination. With an uncertainty, strength or inclination is also an
observation in the fit. The strength F then determines the size of the ellipsoid: the mean of the three semi-axes is F
with the relative standard deviation `gain_sigma`, the uncertainty of the sensor's gain. The inclination agrees with
that of the geomagnetic model to within about a degree; nearby iron and rock contribute more than the error of the
model. `Site.of` takes strength and inclination from the model, with usual uncertainties.

When to use it: if the recording is in a physical unit, and the sensor could not be turned upside down. The readings
alone then do not distinguish the size of the ellipsoid from its offset along the axis of the turn.

A strength that is known to one per cent has no effect if the gain of the sensor is known only to a quarter. If the gain
has been measured, give a smaller `gain_sigma`.

The readings of a level turn are the same with z down and with z up, but the offset along z that follows from the dip
differs by twice the vertical field. Without an accelerometer, state that z points down (`z_down`); otherwise the claim
covers both cases.

Source: NOAA/NCEI, *The US/UK World Magnetic Model for 2025–2030*, its error model; data sheets for
the gain, such as ±5 % for Honeywell's HMC5883L.

>>> round(Site(strength=50.0, inclination_deg=30.0).sine, 9)
0.5
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.core.geomag import recorded_field
from flinders.core.short_repr import ShortRepr
from flinders.core.units import MICROTESLA
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField

USUAL_GAIN_SIGMA: Final = 0.05
"""Relative standard deviation of a sensor's gain by data sheets; local fields of the crust add 0.01."""

INCLINATION_SIGMA_DEG: Final = 1.0
"""Standard deviation of the inclination in degrees."""


@dataclass(frozen=True, slots=True, repr=False)
class Site(ShortRepr):
    """Known field at a place, and the mounting of the sensor.

    Raises `UsageError` for implausible numbers.

    Parameters
    ----------
    strength : float, optional
        Strength of the field, in the unit of the readings. Corrected readings have this length; with `gain_sigma` it is
        an observation that the readings can correct.
    inclination_deg : float, optional
        Inclination at which headings are judged; positive if the field points below the horizon.
    gain_sigma : float
        Relative uncertainty of the sensor's mean gain and of the strength together, 1 σ. By default infinite: the
        strength is not used in the fit.
    inclination_sigma_deg : float
        Uncertainty of the inclination in degrees, 1 σ. By default infinite: the inclination is not used in the fit.
    z_down : bool
        Whether z of the axes in use points down in a level vehicle; an accelerometer takes precedence.
    alignment_sigma_deg : float, optional
        Uncertainty of the mounting about each axis in degrees, 1 σ. Its heading error is stated separately, because a
        magnetometer cannot observe it. For a level turn at a known site it also limits the tilt, see docs/level.md.
    length : float, optional
        Length of corrected readings, if it shall differ from `strength`.

    >>> seen = Site(strength=50.0, gain_sigma=0.05, inclination_deg=60.0).evidence
    >>> seen.strength, seen.inclination_deg, Site(strength=50.0, inclination_deg=60.0).evidence
    (50.0, None, None)
    """

    strength: float | None = None
    inclination_deg: float | None = None
    gain_sigma: float = math.inf
    inclination_sigma_deg: float = math.inf
    z_down: bool = False
    alignment_sigma_deg: float | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for what, value in (("strength", self.strength), ("length", self.length)):
            if value is not None and not 0.0 < value < math.inf:
                raise UsageError(f"{what} is {value:g}: need a number above 0, in the unit of the readings")
        if self.inclination_deg is not None and not abs(self.inclination_deg) <= 90.0:
            raise UsageError(f"inclination is {self.inclination_deg:g}°: need -90° to 90°")
        if not (self.gain_sigma > 0.0 and self.inclination_sigma_deg > 0.0):
            raise UsageError("uncertainties of strength and inclination must be above 0: no site is known exactly")
        if self.alignment_sigma_deg is not None and not 0.0 <= self.alignment_sigma_deg <= 180.0:
            raise UsageError(f"alignment sigma is {self.alignment_sigma_deg:g}°: need an angle from 0° to 180°")

    @classmethod
    def of(cls, field: SiteField, **more: Any) -> Self:
        """Make the site from a model's field, with usual uncertainties of gain and inclination; for readings in µT."""
        usual = {"gain_sigma": USUAL_GAIN_SIGMA, "inclination_sigma_deg": INCLINATION_SIGMA_DEG}
        return cls(field.strength, field.inclination_deg, **{**usual, **more})

    @classmethod
    def merge_stated(
        cls, known: Self | None = None, *, strength: float | None = None, inclination_deg: float | None = None
    ) -> Self | None:
        """Merge a known site with numbers that the user states without uncertainty; None if nothing is known.

        A stated strength sets the length of corrected readings; the known strength is still used in the fit.

        >>> Site.merge_stated(Site(50.0, 60.0, 0.05, 1.0), inclination_deg=66.0).evidence.inclination_deg is None
        True
        """
        if strength is None and inclination_deg is None:
            return known
        site = cls() if known is None else known
        if strength is not None:
            site = replace(site, length=strength, strength=strength if site.strength is None else site.strength)
        if inclination_deg not in (None, site.inclination_deg):
            site = replace(site, inclination_deg=inclination_deg, inclination_sigma_deg=math.inf)
        return site

    @property
    def fixed_length(self) -> float | None:
        """Fixed length of corrected readings; None if the strength is used in the fit."""
        return self.length if self.length is not None or math.isfinite(self.gain_sigma) else self.strength

    @property
    def evidence(self) -> Self | None:
        """The site reduced to the numbers with an uncertainty, which are observations in a fit; None without any."""
        strength = self.strength if math.isfinite(self.gain_sigma) else None
        inclination_deg = self.inclination_deg if math.isfinite(self.inclination_sigma_deg) else None
        if strength is None and inclination_deg is None:
            return None
        return replace(self, strength=strength, inclination_deg=inclination_deg)

    @property
    def for_judgement(self) -> Self:
        """The site reduced to the numbers for the judgement of a fit: length of corrected readings, dip, mounting."""
        return type(self)(self.fixed_length, self.inclination_deg, alignment_sigma_deg=self.alignment_sigma_deg)

    @property
    def sine(self) -> float | None:
        """Sine of the inclination; None if not known."""
        return None if self.inclination_deg is None else math.sin(math.radians(self.inclination_deg))

    @property
    def sine_sigma(self) -> float:
        """Standard deviation of the sine of the inclination, to second order, which matters near the poles."""
        level = math.cos(math.radians(self.inclination_deg or 0.0))
        return math.radians(self.inclination_sigma_deg) * max(level, math.radians(self.inclination_sigma_deg))


def recorded_site(recording: object, **more: Any) -> tuple[Site, str] | None:
    """Site from the place and date in a log, or in the part of one magnetometer, and a message about it.

    None without place or date, and for readings in counts, whose strength is not known. `more` are arguments of `Site`.
    """
    field, unit = recorded_field(recording), getattr(recording, "unit", None)
    if field is None or (unit is not None and unit.inside != MICROTESLA):
        return None
    return Site.of(field, **more), f"place and date are in the log: {field}"
