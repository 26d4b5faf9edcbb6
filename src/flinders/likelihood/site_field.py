"""What is known of the field at the site before anything is read: its strength, and how it dips.

The strength F says how large the shape is, as far as the sensor's gain is known: the mean of the three semi-axes is F
to within `gain_sigma` of itself. The inclination is that of the model to within a degree or so; iron around and rock
below make more difference than the model's own error.

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
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.core.geomag import recorded_field
from flinders.core.units import MICROTESLA
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField

GAIN_SIGMA: Final = 0.05
"""Of the strength: what data sheets give for the gain of a sensor; the crust that no model shows adds a hundredth."""

INCLINATION_SIGMA_DEG: Final = 1.0
"""Degrees, the same for the dip."""


@dataclass(frozen=True, slots=True)
class Site:
    """The field at a place.

    Raises `UsageError` for numbers that no site has.
    """

    strength: float | None = None  # in the unit of the readings
    inclination_deg: float | None = None  # positive where the field points below the horizon
    gain_sigma: float = GAIN_SIGMA  # by what share the mean gain of the sensor, and the strength with it, may be off
    inclination_sigma_deg: float = INCLINATION_SIGMA_DEG
    # somebody says that z of the axes in use points down in a level vehicle; an accelerometer goes before that
    z_down: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.strength is not None and not 0.0 < self.strength < math.inf:
            raise UsageError(f"strength is {self.strength:g}: need a number above 0, in the unit of the readings")
        if self.inclination_deg is not None and not abs(self.inclination_deg) <= 90.0:
            raise UsageError(f"inclination is {self.inclination_deg:g}°: need -90° to 90°")
        if not (self.gain_sigma > 0.0 and self.inclination_sigma_deg > 0.0):
            raise UsageError("what is known of a site is never exact: need uncertainties above 0")

    @classmethod
    def of(cls, field: SiteField, **more: Any) -> Self:
        """Take it from the World Magnetic Model; readings are then in µT."""
        return cls(field.strength, field.inclination_deg, **more)

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
