"""The calibration file of Adafruit's SensorLab, ``sensor_calib.json``: ``c = S (m − h)``, in µT.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> from flinders.targets import find
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> text = find("sensorlab").render(found).text
>>> read(text.encode(), "sensor_calib.json").isclose(found, tolerance=1e-6)
True

Source: Adafruit_Sensor_Calibration, ``Adafruit_Sensor_Calibration_SDFat.cpp``. The library uses single precision.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.targets._inertial_forms import SENSORLAB
from flinders.targets._numbers import Affine, load_object, numbers, parse_list
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the file; the accelerometer and the gyro stay uncorrected. `UnitError` for a calibration in counts."""
    affine = Affine.of(calibration, "uT", who="SensorLab").single
    fields = {
        "mag_hardiron": [float(f"{value:.9g}") for value in affine.offset],
        "mag_softiron": [float(f"{value:.9g}") for value in affine.matrix.ravel()],
        "mag_field": float(f"{affine.strength:.9g}"),
        "gyro_zerorate": [0.0, 0.0, 0.0],
        "accel_zerog": [0.0, 0.0, 0.0],
    }
    return Written(affine.apply, json.dumps(fields, indent=1).splitlines(), fields)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the file back; a `strength`, in µT, has priority over the one in the file.

    Raises `DocumentError` for another file, or missing numbers.
    """
    fields = load_object(content, source)
    matrix = parse_list(fields, "mag_softiron", 9, source).reshape(3, 3)
    offset = parse_list(fields, "mag_hardiron", 3, source)
    length = float(numbers(fields, ["mag_field"], source)[0]) if strength is None else np.nan
    return Affine(matrix, offset, length).to_calibration("uT", strength=strength)


TARGETS: Final = (
    Target(
        name="sensorlab",
        use="Adafruit SensorLab JSON",
        group="libraries, tools",
        suffix=".json",
        title="Adafruit SensorLab",
        formula="c = S (m - h)",
        unit="uT",
        keeps="all",
        storage="JSON, read as float32",
        source="Adafruit_Sensor_Calibration_SDFat.cpp",
        comment=None,
        inertial=SENSORLAB,
        write=write,
        reader=TargetReader(rb'"mag_(?:hard|soft)iron"', read, "sensor_calib.json"),
    ),
)
