"""The file of Adafruit's SensorLab, ``sensor_calib.json``: ``c = S (m − h)``, in µT."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from flinders.conventions.adafruit import dumps, of
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="Adafruit SensorLab",
    formula="c = S (m - h)",
    unit="uT",
    keeps="all",
    storage="JSON, read as float32",
    source="Adafruit_Sensor_Calibration_SDFat.cpp",
    comment=None,
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the file; gyroscope and accelerometer stay uncorrected; a calibration in counts raises `UnitError`."""
    numbers = of(calibration)
    text = dumps(numbers).rstrip("\n")
    return Written(numbers.apply, [text], json.loads(text))
