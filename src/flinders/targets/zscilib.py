"""Constants for Zephyr's zscilib, ``zsl_fus_cal_corr_vec``: ``c = K (v + b)``; b is added, so it is minus the offset.

>>> K, b = np.array([[0.99, 0.12, 0.01], [0.12, 0.87, 0.09], [0.01, 0.09, 0.92]]), np.array([1.2, -4.9, 5.7])
>>> Affine(K, -b, 1.0).apply([0.8, 1.2, 5.4]).round(3)                  # the example of its own test
array([ 1.647, -1.98 ,  9.899])

Source: zscilib, ``src/orientation/fusion/calibration.c``. The function works in any unit, with the precision of
``zsl_real_t``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.targets._code_text import float32s
from flinders.targets._comments import BLOCK
from flinders.targets._numbers import OWN, Affine
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the arrays, with a note on their use."""
    affine = Affine.of(calibration, OWN, who="zscilib").single
    bias = np.negative(affine.offset)
    body = [
        "static zsl_real_t magn_K[9] = {",
        *(f"    {float32s(row)}," for row in affine.matrix),
        "};",
        f"static zsl_real_t magn_b[3] = {{ {float32s(bias)} }};",
    ]
    notes = ["use: zsl_mtx_from_arr(&K, magn_K); zsl_vec_from_arr(&b, magn_b); zsl_fus_cal_corr_vec(&v, &K, &b, &out);"]
    return Written(affine.apply, body, {"K": affine.matrix, "b": bias}, notes)


TARGETS: Final = (
    Target(
        name="zscilib",
        use="Zephyr zscilib constants",
        group="microcontrollers",
        suffix=".h",
        title="Zephyr zscilib",
        formula="c = K (v + b), b added",
        unit=OWN,
        keeps="all",
        storage="zsl_real_t: float32 or float64",
        fed=True,
        source="zscilib, src/orientation/fusion/calibration.c",
        comment=BLOCK,
        write=write,
    ),
)
