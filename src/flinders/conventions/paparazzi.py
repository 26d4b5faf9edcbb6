"""Paparazzi's ``MAG_X_NEUTRAL`` and ``MAG_X_SENS``: ``m = (raw − neutral) sens``, in the axes of the sensor.

Corrected readings are 2048 long, 1 in fixed point with eleven bits; with D the diagonal that comes nearest to the
matrix and F the length of corrected readings in counts, sens = 2048 D / F.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> defines = Defines.of(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0))
>>> defines.neutral, defines.sensitivity
((120, -32, 7), (6.4, 5.12, 4.096))
>>> defines.apply([440.0, -32.0, 7.0])
array([2048.,    0.,    0.])

Source: Paparazzi, ``sw/tools/calibration/calibration_utils.py`` (print_xml) and ``calibrate.py`` (the eleven bits). Its
build turns each sens into a fraction of 16-bit numbers, which is not imitated here.
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

WHO: Final = "Paparazzi"
UNITY: Final = 2**11
NEUTRALS: Final = ("MAG_X_NEUTRAL", "MAG_Y_NEUTRAL", "MAG_Z_NEUTRAL")
SENSITIVITIES: Final = ("MAG_X_SENS", "MAG_Y_SENS", "MAG_Z_SENS")
LOWEST, HIGHEST = -(2**31), 2**31 - 1
ADVICE: Final = "check the unit of the recording"


@dataclass(frozen=True, slots=True)
class Defines:
    """The six numbers.

    Attributes
    ----------
    neutral : (3,) int
        Offset in counts, subtracted.
    sensitivity : (3,) float
        Of each axis, to nine digits.
    """

    neutral: tuple[int, ...]
    sensitivity: tuple[float, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round the offset; what is beside the diagonal is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where the offset is no number of 32 bits.
        """
        found = Affine.of(calibration, COUNTS, who=WHO)
        with np.errstate(all="ignore"):
            sensitivity = UNITY * nearest_diagonal(found.matrix) / found.strength
        neutral = whole(found.offset, NEUTRALS, lowest=LOWEST, highest=HIGHEST, advice=ADVICE)
        return cls(neutral, tuple(float(f"{value:.9g}") for value in sensitivity))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3), 2048 for the earth's field."""
        corrected: Floats = (vectors(field, finite=False) - floats(self.neutral)) * floats(self.sensitivity)
        return corrected
