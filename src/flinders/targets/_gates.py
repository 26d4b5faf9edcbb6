"""Limits by which firmware can tell a disturbed reading, as code: of strength, and of dip against an accelerometer.

>>> gates = Gates(strength_limit=2.5, dip_deg=60.0, dip_limit_deg=4.0)
>>> gates.signed_squares
(0.687..., 0.808...)
>>> print(*gates.words("uT"), sep=chr(10))
a clean reading is off by more than 2.5 µT of strength at most once in 10,000 times where the field is that of the \
recording
and by more than 4.0° of dip as seldom, with a vertical that is good to 1° (1 σ)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

from flinders.core.units import label
from flinders.errors import figures

CHANCE: Final = 1e-4
"""How often a clean reading is beyond a limit, at most."""
SIGMAS: Final = NormalDist().inv_cdf(1.0 - CHANCE / 2.0)
"""The limits, in standard deviations."""
TILT_DEG: Final = 1.0
"""1 σ of the vertical that firmware takes from its accelerometer, about each axis."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits of a corrected reading that nothing disturbs."""

    strength_limit: float  # how far its length may be off the field strength, in the calibration's unit
    # the dip, and how far the angle to the horizon may be off it; NaN where that cannot be told
    dip_deg: float = math.nan
    dip_limit_deg: float = math.nan

    @property
    def has_dip(self) -> bool:
        """There is a limit of dip."""
        return not math.isnan(self.dip_limit_deg)

    @property
    def signed_squares(self) -> tuple[float, float]:
        """sin x |sin x| at the limits of dip: compared without a square root; beyond 1 where any angle will do."""
        low, high = self.dip_deg - self.dip_limit_deg, self.dip_deg + self.dip_limit_deg
        below = -2.0 if low <= -90.0 else math.sin(math.radians(low))
        above = 2.0 if high >= 90.0 else math.sin(math.radians(high))
        return below * abs(below), above * abs(above)

    def words(self, unit: str) -> list[str]:
        """What the limits mean."""
        often = f"at most once in {round(1 / CHANCE):,} times where the field is that of the recording"
        words = [
            f"a clean reading is off by more than {figures(self.strength_limit)} {label(unit)} of strength {often}"
        ]
        if self.has_dip:
            words.append(
                f"and by more than {figures(self.dip_limit_deg)}° of dip as seldom, with a vertical that is good to "
                f"{TILT_DEG:.0f}° (1 σ)"
            )
        return words


C_STRENGTH: Final = """
#define {constant}_STRENGTH_LIMIT {limit} /* {result} */

/* Whether something disturbs a corrected reading, by its strength. */
static inline int {name}_strength_is_off(const float corrected[3])
{{
    const float lowest = {constant}_FIELD_STRENGTH - {constant}_STRENGTH_LIMIT;
    const float highest = {constant}_FIELD_STRENGTH + {constant}_STRENGTH_LIMIT;
    const float square = corrected[0] * corrected[0] + corrected[1] * corrected[1] + corrected[2] * corrected[2];
    return !(square >= lowest * lowest && square <= highest * highest);
}}"""

C_DIP: Final = """
/* sin |sin| of the least and the greatest dip. */
static const float {name}_dip_limits[2] = {{{low}, {high}}};

/* Whether something disturbs a corrected reading, by its dip: acceleration is what an accelerometer in the same axes
 * reads at rest, in any unit (with z down, it is negative when level). */
static inline int {name}_dip_is_off(const float corrected[3], const float acceleration[3])
{{
    float down = 0.0f, reading = 0.0f, weight = 0.0f, square;
    int axis;
    for (axis = 0; axis < 3; axis++) {{
        down -= corrected[axis] * acceleration[axis];
        reading += corrected[axis] * corrected[axis];
        weight += acceleration[axis] * acceleration[axis];
    }}
    square = down < 0.0f ? -down * down : down * down;
    return !(square >= {name}_dip_limits[0] * reading * weight && square <= {name}_dip_limits[1] * reading * weight);
}}"""

SKETCH_STRENGTH: Final = """
const float {constant}_STRENGTH = {strength}, {constant}_STRENGTH_LIMIT = {limit}; // {result}

// Whether something disturbs a corrected reading, by its strength.
bool {prefix}strengthIsOff(float x, float y, float z) {{
  const float lowest = {constant}_STRENGTH - {constant}_STRENGTH_LIMIT;
  const float highest = {constant}_STRENGTH + {constant}_STRENGTH_LIMIT;
  const float square = x * x + y * y + z * z;
  return !(square >= lowest * lowest && square <= highest * highest);
}}"""

SKETCH_DIP: Final = """
// Whether something disturbs a corrected reading, by its dip: ax, ay, az is what an accelerometer in the same axes
// reads at rest, in any unit (with z down, az is negative when level).
bool {prefix}dipIsOff(float x, float y, float z, float ax, float ay, float az) {{
  const float down = -(x * ax + y * ay + z * az);
  const float both = (x * x + y * y + z * z) * (ax * ax + ay * ay + az * az);
  const float square = down < 0.0f ? -down * down : down * down;
  return !(square >= {low} * both && square <= {high} * both);
}}"""

MODULE_STRENGTH: Final = """
STRENGTH_LIMIT = {limit}  # {result}


def strength_is_off(corrected):
    \"""Whether something disturbs a corrected reading, by its strength.\"""
    x, y, z = corrected
    square = x * x + y * y + z * z
    return not (FIELD_STRENGTH - STRENGTH_LIMIT) ** 2 <= square <= (FIELD_STRENGTH + STRENGTH_LIMIT) ** 2"""

MODULE_DIP: Final = """

def dip_is_off(corrected, acceleration):
    \"""By its dip; an accelerometer in the same axes, at rest, in any unit (with z down, negative when level).\"""
    x, y, z = corrected
    ax, ay, az = acceleration
    down = -(x * ax + y * ay + z * az)
    both = (x * x + y * y + z * z) * (ax * ax + ay * ay + az * az)
    return not {low} * both <= down * abs(down) <= {high} * both"""
