"""The calibration file of Adafruit's SensorLab, ``sensor_calib.json``: ``c = S (m − h)``, in µT.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> read(dumps(of(found)).encode(), "sensor_calib.json").isclose(found, tolerance=1e-6)
True

Source: Adafruit_Sensor_Calibration, ``Adafruit_Sensor_Calibration_SDFat.cpp``. The library keeps single precision.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.conventions._affine import Affine
from flinders.conventions._parsing import listed, loaded, numbers

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

WHO: Final = "SensorLab"


def of(calibration: Calibration) -> Affine:
    """Round to single precision, in µT and in the axes as recorded; `calibration` in counts raises `UnitError`."""
    return Affine.of(calibration, "uT", who=WHO).single


def dumps(numbers: Affine) -> str:
    """Lay out the file; gyroscope and accelerometer are left uncorrected."""
    fields = {
        "mag_hardiron": [float(f"{value:.9g}") for value in numbers.offset],
        "mag_softiron": [float(f"{value:.9g}") for value in numbers.matrix.ravel()],
        "mag_field": float(f"{numbers.strength:.9g}"),
        "gyro_zerorate": [0.0, 0.0, 0.0],
        "accel_zerog": [0.0, 0.0, 0.0],
    }
    return json.dumps(fields, indent=1) + "\n"


def sniff(head: bytes) -> bool:
    """Whether a file may be one of SensorLab."""
    return b'"mag_hardiron"' in head or b'"mag_softiron"' in head


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the file back; `strength`, in µT, goes before the one in it.

    Raises
    ------
    DocumentError
        For what is none, or lacks numbers.
    """
    fields = loaded(content, source)
    matrix = listed(fields, "mag_softiron", 9, source).reshape(3, 3)
    offset = listed(fields, "mag_hardiron", 3, source)
    if strength is None:
        (strength,) = numbers(fields, ["mag_field"], source)
        return Affine(matrix, offset, float(strength)).to_calibration("uT")
    return Affine(matrix, offset, np.nan).to_calibration("uT", strength=strength)
