"""A calibration in the axes as recorded, where a sensor's own registers act.

>>> from flinders.core.axes import Axes
>>> from flinders.core.calibration import Calibration
>>> upside_down = Calibration(np.diag([1.0, 2.0, 0.5]), [10, 20, 30], 50.0, axes=Axes.of("y,x,-z"))
>>> matrix, offset = in_recorded_axes(upside_down)
>>> np.diag(matrix), offset
(array([2. , 1. , 0.5]), array([ 20.,  10., -30.]))
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration


def in_recorded_axes(calibration: Calibration) -> tuple[Floats, Floats]:
    """(3, 3) matrix and (3,) offset that correct readings before their axes are mapped.

    With P the mapping, Pᵀ W P and Pᵀ b: mapped afterwards, the result is that of the calibration.
    """
    back = calibration.axes.apply(np.eye(3))  # rows P eᵢ: Pᵀ
    return back @ calibration.matrix @ back.T, back @ calibration.offset
