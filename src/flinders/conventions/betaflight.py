"""Betaflight's ``mag_calibration``: ``m = aligned − magZero``, three whole numbers of raw counts, and no soft iron.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> zero = MagZero.of(Calibration(np.eye(3), [120.4, -31.6, 7.0], 400.0))
>>> zero.counts, zero.apply([520.0, -32.0, 7.0])
((120, -32, 7), array([400.,   0.,   0.]))

It acts in the axes of the board, after ``align_mag``: those of ``magADC`` in its blackbox.

Source: Betaflight, ``cli/settings.c`` (mag_calibration) and ``sensors/compass.c``; int16.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import Affine, acting, whole
from flinders.units import COUNTS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.calibration import Calibration

WHO: Final = "Betaflight"
NAMES: Final = ("mag_calibration x", "mag_calibration y", "mag_calibration z")
LOWEST, HIGHEST = -(2**15), 2**15 - 1
ADVICE: Final = "take away or demagnetise what is near the sensor, and check the unit of the recording"


@dataclass(frozen=True, slots=True)
class MagZero:
    """The three numbers.

    Attributes
    ----------
    counts : (3,) int
        Subtracted.
    """

    counts: tuple[int, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round the offset, in the axes of the board; the matrix is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where 16 bits cannot hold it.
        """
        offset = Affine.of(calibration, COUNTS, who=WHO, acts=acting("mapped", calibration)).offset
        return cls(whole(offset, NAMES, lowest=LOWEST, highest=HIGHEST, advice=ADVICE))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3) in counts."""
        corrected: Floats = vectors(field, finite=False) - floats(self.counts)
        return corrected
