"""The file of Adafruit's SensorLab, ``sensor_calib.json``: ``c = S (m − h)``, in µT."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from flinders.conventions.adafruit import dumps, of
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

SHEET: Final = Sheet(
    title="Adafruit SensorLab",
    formula="c = S (m - h)",
    unit="uT",
    keeps="all",
    storage="JSON, read as float32",
    source="Adafruit_Sensor_Calibration_SDFat.cpp",
    comment=None,
)


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the file; gyroscope and accelerometer stay uncorrected.

    Raises
    ------
    UnitError
        For a calibration in counts.
    """
    numbers = of(calibration)
    text = dumps(numbers).rstrip("\n")
    return SHEET.export(
        calibration, numbers.apply, [text], target=target, about=about, asked=asked, values=json.loads(text)
    )
