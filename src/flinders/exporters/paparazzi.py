"""Lines for the airframe file of Paparazzi: offset and sensitivity of each axis, in the axes of the sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.paparazzi import NEUTRALS, SENSITIVITIES, Defines
from flinders.core.units import COUNTS
from flinders.exporters._export import Written
from flinders.exporters._sheet import MARKUP, Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="Paparazzi",
    formula="m = (raw - NEUTRAL) SENS",
    unit=COUNTS,
    keeps="diagonal",
    storage="NEUTRAL in whole counts; SENS becomes a fraction of 16-bit numbers",
    source="sw/tools/calibration/calibration_utils.py and calibrate.py",
    lengths="2048 long",
    unverified=("that it acts in the axes of the IMU_MAG_RAW messages, before the mounting",),
    comment=MARKUP,
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the defines for the section IMU; a recording that was not in raw counts raises `UnitError`.

    Raises
    ------
    NotExportable
        Where what is left out costs more than a degree of heading.
    """
    defines = Defines.of(calibration)
    neutral = [
        f'<define name="{name}" value="{value}"/>' for name, value in zip(NEUTRALS, defines.neutral, strict=True)
    ]
    sensitivity = [
        f'<define name="{name}" value="{value:.9g}" integer="16"/>'
        for name, value in zip(SENSITIVITIES, defines.sensitivity, strict=True)
    ]
    values = dict(zip((*NEUTRALS, *SENSITIVITIES), (*defines.neutral, *defines.sensitivity), strict=True))
    return Written(defines.apply, [*neutral, *sensitivity], values)
