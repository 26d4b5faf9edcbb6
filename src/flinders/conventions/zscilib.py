"""Zephyr's zscilib, ``zsl_fus_cal_corr_vec``: ``c = K (v + b)``: b is added, so it is minus the offset.

>>> example = Correction([[0.99, 0.12, 0.01], [0.12, 0.87, 0.09], [0.01, 0.09, 0.92]], [1.2, -4.9, 5.7])
>>> example.apply([0.8, 1.2, 5.4]).round(3)                             # the example of its own test
array([ 1.647, -1.98 ,  9.899])

Source: zscilib, ``src/orientation/fusion/calibration.c``. It works in any unit, in the precision of ``zsl_real_t``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import OWN, Affine

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "zscilib"


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """``corrected = matrix @ (raw + bias)``.

    Attributes
    ----------
    matrix : (3, 3) float
    bias : (3,) float, in the calibration's unit
        Minus the offset.
    """

    matrix: ArrayLike
    bias: ArrayLike

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round to single precision, in the axes as recorded."""
        found = Affine.of(calibration, OWN, who=WHO).single
        return cls(found.matrix, -found.offset)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) to (..., 3), in the calibration's unit."""
        corrected: Floats = (vectors(field, finite=False) + floats(self.bias)) @ floats(self.matrix).T
        return corrected
