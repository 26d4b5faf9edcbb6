"""Lines for the airframe file of Paparazzi: offset and sensitivity of each axis, in the axes of the sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.paparazzi import NEUTRALS, SENSITIVITIES, Defines
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import MARKUP, Sheet
from flinders.units import COUNTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

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


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the defines for the section IMU.

    Raises
    ------
    UnitError
        Where the recording was not in raw counts.
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
    return SHEET.export(
        calibration,
        defines.apply,
        [*neutral, *sensitivity],
        target=target,
        about=about,
        asked=asked,
        values=values,
    )
