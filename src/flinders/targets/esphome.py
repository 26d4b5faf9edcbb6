"""Template sensors for ESPHome, which itself has no calibration: ``A (m − b)`` of field_strength_x, _y and _z."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.targets._code_text import digits
from flinders.targets._numbers import Affine
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

SENSOR: Final = r"""  - platform: template
    name: Magnetic field {axis}, corrected
    id: field_corrected_{axis}
    unit_of_measurement: "\u00b5T"
    accuracy_decimals: 2
    update_interval: 100ms
    lambda: |-
      return {x}
           + {y}
           + {z};"""


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write three template sensors; a calibration in counts raises `UnitError`."""
    affine = Affine.of(calibration, "uT", who="ESPHome").single
    body = ["sensor:"]
    for axis, row in zip("xyz", affine.matrix, strict=True):
        terms = {
            name: f"{digits(entry, 'f')} * (id(field_strength_{name}).state - ({digits(offset, 'f')}))"
            for name, entry, offset in zip("xyz", row, affine.offset, strict=True)
        }
        body += SENSOR.format(axis=axis, **terms).splitlines()
    notes = ["give the sensors of your magnetometer the ids field_strength_x, field_strength_y and field_strength_z"]
    return Written(affine.apply, body, {"matrix": affine.matrix, "offset": affine.offset}, notes)


TARGETS: Final = (
    Target(
        name="esphome",
        use="ESPHome template sensors",
        group="microcontrollers",
        suffix=".yaml",
        title="ESPHome",
        formula="A (m - b)",
        unit="uT",
        keeps="all",
        storage="float32",
        fed=True,
        source="no calibration of its own: a lambda on the states of its field_strength sensors, which are in uT",
        write=write,
    ),
)
