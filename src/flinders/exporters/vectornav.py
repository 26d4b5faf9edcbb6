"""The sentence that writes register 23 of VectorNav's sensors: ``X = C (M − B)``, in gauss."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.vectornav import of, sentence
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="VectorNav register 23",
    formula="X = C (M - B)",
    unit="G",
    keeps="all",
    storage="seven decimals, kept as float32",
    source="VN-100 user manual UM001, section 6.2.1",
    comment=None,
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the sentence with its checksum; a calibration in counts raises `UnitError`."""
    register = of(calibration)
    notes = ["for readings recorded with register 23 at its default: it replaces what the device holds"]
    return Written(register.apply, [sentence(register)], {"C": register.matrix, "B": register.offset}, notes)
