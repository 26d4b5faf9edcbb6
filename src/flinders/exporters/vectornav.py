"""The sentence that writes register 23 of VectorNav's sensors: ``X = C (M − B)``, in gauss."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.vectornav import of, sentence
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

SHEET: Final = Sheet(
    title="VectorNav register 23",
    formula="X = C (M - B)",
    unit="G",
    keeps="all",
    storage="seven decimals, kept as float32",
    source="VN-100 user manual UM001, section 6.2.1",
    comment=None,
)


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the sentence with its checksum.

    Raises
    ------
    UnitError
        For a calibration in counts.
    """
    register = of(calibration)
    notes = ["for readings recorded with register 23 at its default: it replaces what the device holds"]
    values = {"C": register.matrix, "B": register.offset}
    return SHEET.export(
        calibration,
        register.apply,
        [sentence(register)],
        target=target,
        about=about,
        asked=asked,
        values=values,
        notes=notes,
    )
