"""Lines for INAV's CLI: offset and radius of each axis in whole counts, in the axes of the sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.inav import GAINS, ZEROS, Settings
from flinders.core.units import COUNTS
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="INAV",
    formula="m = align((raw - magzero) 1024 / maggain)",
    unit=COUNTS,
    keeps="diagonal",
    storage="int16, whole counts; the result in whole numbers as well",
    source="sensors/compass.c at 005b1ee7",
    lengths="1024 long",
)

RECORDED: Final = "for readings recorded with magzero 0 and maggain 1024 on each axis: it replaces what the board holds"
"""No log tells what was in force, and ``magADC`` is after it."""


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the lines; a recording that was not in raw counts raises `UnitError`.

    Raises
    ------
    NotExportable
        Where what is left out costs more than a degree of heading, or int16 cannot hold the numbers.
    """
    settings = Settings.of(calibration)
    values = dict(zip((*ZEROS, *GAINS), (*settings.zero, *settings.gain), strict=True))
    body = [*(f"set {name} = {value}" for name, value in values.items()), "save"]
    return Written(settings.apply, body, values, [RECORDED])
