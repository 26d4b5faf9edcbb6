"""Template sensors for ESPHome, which has no calibration of its own: ``A (m − b)`` of field_strength_x, _y and _z."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import Affine
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet, digits

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="ESPHome",
    formula="A (m - b)",
    unit="uT",
    keeps="all",
    storage="float32",
    fed=True,
    source="no calibration of its own: a lambda on the states of its field_strength sensors, which are in uT",
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write three template sensors; a calibration in counts raises `UnitError`."""
    numbers = Affine.of(calibration, "uT", who=SHEET.title).single
    body = ["sensor:", *(line for place in range(3) for line in _sensor(place, numbers.matrix, numbers.offset))]
    values = {"matrix": numbers.matrix, "offset": numbers.offset}
    notes = ["give the sensors of your magnetometer the ids field_strength_x, field_strength_y and field_strength_z"]
    return Written(numbers.apply, body, values, notes)


def _sensor(place: int, matrix: Floats, offset: Floats) -> list[str]:
    terms = [
        f"{digits(matrix[place, column], 'f')} * (id(field_strength_{axis}).state - ({digits(offset[column], 'f')}))"
        for column, axis in enumerate("xyz")
    ]
    return [
        "  - platform: template",
        f"    name: Magnetic field {'xyz'[place]}, corrected",
        f"    id: field_corrected_{'xyz'[place]}",
        r'    unit_of_measurement: "\u00b5T"',
        "    accuracy_decimals: 2",
        "    update_interval: 100ms",
        "    lambda: |-",
        f"      return {terms[0]}",
        f"           + {terms[1]}",
        f"           + {terms[2]};",
    ]
