"""A line for Betaflight's CLI: three whole numbers of raw counts, subtracted after align_mag, and no soft iron."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.betaflight import MagZero
from flinders.core.units import COUNTS
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="Betaflight",
    formula="m = align(raw) - magZero",
    unit=COUNTS,
    keeps="offset",
    storage="int16, whole counts",
    source="cli/settings.c, sensors/compass.c",
    acts="mapped",
    lengths="as long as the sensor makes them",
)

RECORDED: Final = "for readings recorded with mag_calibration = 0,0,0: it replaces what the board holds"
"""No log tells what was in force, and ``magADC`` has it taken off."""


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the line; a recording that was not in raw counts raises `UnitError`.

    Raises
    ------
    NotExportable
        Where the soft iron left out costs more than a degree of heading, or int16 cannot hold the offset.
    """
    zero = MagZero.of(calibration)
    body = [f"set mag_calibration = {','.join(map(str, zero.counts))}", "save"]
    return Written(zero.apply, body, {"mag_calibration": zero.counts}, [RECORDED])
