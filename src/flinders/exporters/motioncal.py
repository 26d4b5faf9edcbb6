"""MotionCal's packet of 68 bytes, which is also what PJRC's and Adafruit's sketches keep in EEPROM.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.exporters import Asked
>>> from flinders.core.units import Unit
>>> packet = write(Calibration(np.eye(3), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT")), Asked()).data
>>> packet[:2].hex(), len(packet)
('7554', 68)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.motioncal import Packet
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="MotionCal packet",
    formula="c = W (m - V), det W = 1",
    unit="uT",
    keeps="symmetric",
    storage="68 bytes: 117 84, 16 float32 little endian, CRC-16/MODBUS",
    source="MotionCal rawdata.c and visualize.c, NXPMotionSense.h, Adafruit_Sensor_Calibration_EEPROM.cpp",
    lengths="B long, as they are in the middle of the ellipsoid: the matrix has determinant 1",
    comment=None,
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the bytes; the text shows them in hexadecimal.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        Where a rotation in the matrix would be lost, of more than a degree of heading.
    """
    packet = Packet.of(calibration)
    data = packet.encode()
    values = {"offset": packet.offset, "field": packet.strength, "matrix": packet.matrix, "hex": data.hex()}
    body = [data[start : start + 16].hex(" ") for start in range(0, len(data), 16)]
    return Written(packet.apply, body, values, data=data)
