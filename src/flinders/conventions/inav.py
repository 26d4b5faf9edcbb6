"""INAV's ``magzero`` and ``maggain``: ``m = (raw − zero) 1024 / gain``, whole numbers, in the axes of the sensor.

A gain is the radius of its axis in counts, so that corrected readings are 1024 long; with D the diagonal that comes
nearest to the matrix and F the length of corrected readings in counts, gain = F / D.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> settings = Settings.of(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0))
>>> settings.zero, settings.gain
((120, -32, 7), (320, 400, 500))
>>> settings.apply([440.0, -32.0, 7.0])
array([1024.,    0.,    0.])

Source: INAV, ``sensors/compass.c`` at 005b1ee7; int16, and a division that leaves off what is behind the point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import Affine, nearest_diagonal, whole
from flinders.units import COUNTS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.calibration import Calibration

WHO: Final = "INAV"
UNITY: Final = 1024
"""Length of a corrected reading."""
ZEROS: Final = ("magzero_x", "magzero_y", "magzero_z")
GAINS: Final = ("maggain_x", "maggain_y", "maggain_z")
LOWEST, HIGHEST = -(2**15), 2**15 - 1
ADVICE: Final = "take away or demagnetise what is near the sensor, and check the unit of the recording"


@dataclass(frozen=True, slots=True)
class Settings:
    """The six numbers.

    Attributes
    ----------
    zero : (3,) int
        Offset in counts, subtracted.
    gain : (3,) int
        Radius of each axis in counts.
    """

    zero: tuple[int, ...]
    gain: tuple[int, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round offset and radii; what is beside the diagonal is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where 16 bits cannot hold them.
        """
        found = Affine.of(calibration, COUNTS, who=WHO)
        with np.errstate(all="ignore"):
            radii = found.strength / nearest_diagonal(found.matrix)
        zero = whole(found.offset, ZEROS, lowest=LOWEST, highest=HIGHEST, advice=ADVICE)
        return cls(zero, whole(radii, GAINS, lowest=1, highest=HIGHEST, advice=ADVICE))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3) whole numbers, 1024 for the earth's field."""
        scaled = (vectors(field, finite=False) - floats(self.zero)) * UNITY / floats(self.gain)
        return np.trunc(scaled) + 0.0
