"""What is known of the field at the site before anything is read: its strength, and how it dips.

A number without an uncertainty says how a fit is used: corrected readings have that length, and headings are judged at
that dip. A number with its uncertainty counts in the fit as well.
The strength F then says how large the shape is, as far as the sensor's gain is known: the mean of the three semi-axes
is F to within `gain_sigma` of itself. The inclination is that of the model to within a degree or so; iron around and
rock below make more difference than the model's own error. `Site.of` takes both from the model, with uncertainties.

When to use it: the recording is in a true unit, and the sensor could not be turned over, so that size and offset
across its plane cannot be distinguished.

A strength that is known to one per cent says nothing while the gain of the sensor is known to a quarter: where that
has been measured, give a smaller `gain_sigma`.

A level turn looks the same with z down and with z up, and the offset in z that its dip gives differs by twice the field
along z. Where no accelerometer was recorded, say that z points down, once it does (`z_down`): else the claim holds for
both.

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

GAIN_SIGMA: Final = 0.05
"""Of the strength: what data sheets give for the gain of a sensor; the crust that no model shows adds a hundredth."""

INCLINATION_SIGMA_DEG: Final = 1.0
"""Degrees, the same for the dip."""


@dataclass(frozen=True, slots=True, repr=False)
class Site(ShortRepr):
    """The field at a place, and how the sensor is mounted in it.

    Raises `UsageError` for numbers that no site has.

    Parameters
    ----------
    strength : float, optional
        Strength of the field, in the unit of the readings. Corrected readings have that length; with `gain_sigma`, as
        far as the readings do not contradict it.
    inclination_deg : float, optional
        Inclination, at which headings are judged; positive where the field points below the horizon.
    gain_sigma : float
        By what share the mean gain of the sensor, and the strength with it, may be off, 1 σ. By default infinite: the
        strength says nothing of the sensor.
    inclination_sigma_deg : float
        What the inclination may be off by, 1 σ. By default infinite: headings are judged at it, and that is all.
    z_down : bool
        z of the axes in use points down in a level vehicle; an accelerometer goes before that.
    alignment_sigma_deg : float, optional
        How well the mounting is known, 1 σ about each axis: its heading error is stated separately, since no
        magnetometer sees it. Of a level turn at a known site it also says how steep a tilt can be, see docs/level.md.
    length : float, optional
        Length that corrected readings shall have, where it is not `strength`; whatever the readings say.

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
            raise UsageError("what is known of a site is never exact: need uncertainties above 0")
        if self.alignment_sigma_deg is not None and not 0.0 <= self.alignment_sigma_deg <= 180.0:
            raise UsageError(f"alignment sigma is {self.alignment_sigma_deg:g}°: need an angle from 0° to 180°")

    @classmethod
    def of(cls, field: SiteField, **more: Any) -> Self:
        """Take it from the World Magnetic Model, with what gains and places are usually off by; readings are in µT."""
        usual = {"gain_sigma": GAIN_SIGMA, "inclination_sigma_deg": INCLINATION_SIGMA_DEG}
        return cls(field.strength, field.inclination_deg, **{**usual, **more})

    @classmethod
    def stated(
        cls, known: Self | None = None, *, strength: float | None = None, inclination_deg: float | None = None
    ) -> Self | None:
        """A known site with the numbers that somebody states, without uncertainty; None where neither is there.

        A stated strength sets the length of corrected readings; the known strength still counts in the fit.

        >>> Site.stated(Site(50.0, 60.0, 0.05, 1.0), inclination_deg=66.0).evidence.inclination_deg is None
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
        """Length of corrected readings, whatever the readings say; None of a strength that counts in the fit."""
        return self.length if self.length is not None or math.isfinite(self.gain_sigma) else self.strength

    @property
    def evidence(self) -> Self | None:
        """The site with the numbers that have an uncertainty, which count in a fit; None where neither has."""
        strength = self.strength if math.isfinite(self.gain_sigma) else None
        inclination_deg = self.inclination_deg if math.isfinite(self.inclination_sigma_deg) else None
        if strength is None and inclination_deg is None:
            return None
        return replace(self, strength=strength, inclination_deg=inclination_deg)

    @property
    def judged(self) -> Self:
        """What a fit is judged with: length of corrected readings, dip and mounting, without uncertainties."""
        return type(self)(self.fixed_length, self.inclination_deg, alignment_sigma_deg=self.alignment_sigma_deg)

    @property
    def sine(self) -> float | None:
        """Of the inclination."""
        return None if self.inclination_deg is None else math.sin(math.radians(self.inclination_deg))

    @property
    def sine_sigma(self) -> float:
        """Standard deviation of the sine; at the poles as flat as a degree is round."""
        level = math.cos(math.radians(self.inclination_deg or 0.0))
        return math.radians(self.inclination_sigma_deg) * max(level, math.radians(self.inclination_sigma_deg))


def recorded_site(recording: object, **more: Any) -> tuple[Site, str] | None:
    """The site that a log, or a magnetometer of one, states, and words that say so; None where it states none.

    `more` goes to `Site`. Readings in counts know no strength, and have none.
    """
    field, unit = recorded_field(recording), getattr(recording, "unit", None)
    if field is None or (unit is not None and unit.inside != MICROTESLA):
        return None
    return Site.of(field, **more), f"the log says where and when: {field}; used"
