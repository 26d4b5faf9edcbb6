"""A line for Betaflight's CLI: three whole numbers of raw counts, subtracted after align_mag, and no soft iron."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.betaflight import MagZero
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import Sheet
from flinders.units import COUNTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

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


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the line.

    Raises
    ------
    UnitError
        Where the recording was not in raw counts.
    NotExportable
        Where the soft iron left out costs more than a degree of heading, or int16 cannot hold the offset.
    """
    zero = MagZero.of(calibration)
    body = [f"set mag_calibration = {','.join(map(str, zero.counts))}", "save"]
    return SHEET.export(
        calibration, zero.apply, body, target=target, about=about, asked=asked, values={"mag_calibration": zero.counts}
    )
