"""Changes since an earlier calibration, for a fit that uses the soft iron of this calibration.

The engine tests whether readings contradict that soft iron (``refresh.c``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flinders.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Refreshed:
    """Changes of a fit that uses the soft iron of an earlier calibration."""

    previous: str  # name of the earlier calibration
    offset_change: Floats  # (3,): offset of the fit minus that of the earlier calibration, in the calibration's unit
    # worst level heading error if the vehicle continues to use the earlier calibration
    heading_change_deg: float
    soft_iron_p_value: float  # probability that readings show a change of the soft iron as large by chance
    distortion: float = 0.0  # `Residuals.distortion` of the earlier calibration, as it is a property of the sensor

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            "previous": self.previous,
            "offset_change": self.offset_change.tolist(),
            "heading_change_deg": self.heading_change_deg,
            "soft_iron_p_value": self.soft_iron_p_value,
        }
