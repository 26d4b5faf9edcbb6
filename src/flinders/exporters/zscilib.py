"""Constants for Zephyr's zscilib, ``zsl_fus_cal_corr_vec``: ``c = K (v + b)``, b minus the offset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.arrays import floats
from flinders.conventions._affine import OWN
from flinders.conventions.zscilib import Correction
from flinders.exporters._export import Written
from flinders.exporters._sheet import BLOCK, Sheet, digits

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="Zephyr zscilib",
    formula="c = K (v + b), b added",
    unit=OWN,
    keeps="all",
    storage="zsl_real_t: float32 or float64",
    fed=True,
    source="zscilib, src/orientation/fusion/calibration.c",
    comment=BLOCK,
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the arrays and how to use them."""
    found = Correction.of(calibration)
    rows = [f"    {', '.join(map(digits, row))}," for row in floats(found.matrix)]
    body = [
        "static zsl_real_t magn_K[9] = {", *rows, "};",
        f"static zsl_real_t magn_b[3] = {{ {', '.join(map(digits, floats(found.bias)))} }};",
    ]  # fmt: skip
    notes = ["use: zsl_mtx_from_arr(&K, magn_K); zsl_vec_from_arr(&b, magn_b); zsl_fus_cal_corr_vec(&v, &K, &b, &out);"]
    return Written(found.apply, body, {"K": found.matrix, "b": found.bias}, notes)
