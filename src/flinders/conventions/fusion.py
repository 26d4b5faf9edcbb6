"""The magnetometer model of x-io's Fusion up to version 1.1, ``c = S u − h``: h is subtracted after the soft iron.

From 1.2.0 on (September 2023) it is ``c = S (u − h)``, which is `Affine`. Ours is corrected = W (raw − b), so

    S = W,   h = W b   (up to 1.1),   h = b   (from 1.2)

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> found = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> old = OldModel.of(found)
>>> old.offset
array([ 12.5, -20. ,  15. ])
>>> old.apply([10.0, -20.0, 130.0])
array([ 0.,  0., 50.])

Source: xioTechnologies/Fusion, ``FusionCalibration.h`` and its change in commit 15e463c. Numbers are single precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, vectors
from flinders.conventions._affine import OWN, Affine, single

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "Fusion"


@dataclass(frozen=True, slots=True, eq=False)
class OldModel:
    """``corrected = matrix @ raw - offset``.

    Attributes
    ----------
    matrix : (3, 3) float32
    offset : (3,) float32, in the calibration's unit
        W b.
    """

    matrix: Floats
    offset: Floats

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round to single precision, in the axes as recorded."""
        found = Affine.of(calibration, OWN, who=WHO)
        with np.errstate(all="ignore"):
            return cls(single(found.matrix), single(found.matrix @ found.offset))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) to (..., 3), in the calibration's unit."""
        corrected: Floats = vectors(field, finite=False) @ self.matrix.T - self.offset
        return corrected


def of(calibration: Calibration) -> Affine:
    """The model from 1.2 on, rounded to single precision, in the axes as recorded."""
    return Affine.of(calibration, OWN, who=WHO).single
