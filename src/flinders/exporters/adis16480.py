"""Registers of the ADIS16480 and ADIS16488 as a table to copy: name, page, address, code, sixteen bits.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> from flinders.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.75]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("mG"))
>>> export = render(found, target="adis16480")
>>> print(*[line for line in export.text.splitlines() if line.startswith("HARD")], sep=chr(10))
HARD_IRON_X       2     0x28   -1250  0xFB1E   -125.0 mG
HARD_IRON_Y       2     0x2A    2000  0x07D0   +200.0 mG
HARD_IRON_Z       2     0x2C       0  0x0000     +0.0 mG
>>> export.fields["checked"]["worst_mG"] < 1e-9
True
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, Final

from flinders.conventions._affine import refuse_mounted
from flinders.conventions.adis16480 import HARD_IRON_STEP_MG, MG, SOFT_IRON_STEP, Register, Registers
from flinders.errors import figures
from flinders.exporters._export import NOTHING_MORE, Asked, Deviation, Export
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

FORMULA: Final = "M_C = (I + S) M + H"

UNVERIFIED: Final = (
    "verify against your data sheet revision: that one step of S is 1/32768, and that H is added after (I + S)"
)
"""What no data sheet was seen to say."""

WIDTH: Final = 78

SHEET: Final = Sheet(
    title="ADIS16480 and ADIS16488",
    formula=FORMULA,
    unit="mG",
    keeps="all",
    storage="int16: H in 0.1 mG to +/-3276.7, S in 1/32768 to +/-100 %",
    source="data sheets, ADIS16480 Rev. H page 35 and ADIS16488 Rev. B page 25",
    unverified=(UNVERIFIED,),
)


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the twelve registers of the device that `target` names.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        Where a register cannot hold its value.
    """
    refuse_mounted(calibration, who=target.upper())
    registers = Registers.of(calibration)
    deviation = Deviation.of(calibration, lambda raw: MG * registers.apply(raw / MG), lossy=asked.lossy)
    strength = calibration.field_strength / MG
    checked = (
        f"checked: its own formula on {deviation.vectors} fields of {figures(strength, 4)} mG, at most "
        f"{figures(deviation.worst / MG)} mG and {figures(deviation.worst_deg)}° off the calibration"
    )
    notes = _notes(calibration)
    remarks = [f"{target.upper()}, magnetometer correction: {FORMULA}, in mG", *about, *notes, UNVERIFIED, checked]
    lines = [line for remark in remarks for line in _comment(remark)]
    table = [f"# {'register':<15}{'page':>4}  {'address':>7}  {'code':>6}  {'hex':<6}  {'value':>9}"]
    text = "\n".join([*lines, "#", *table, *map(_row, registers.rows), ""])
    decoded = registers.to_calibration(calibration.field_strength, known=calibration.field_strength_known)
    fields: dict[str, Any] = {
        "target": target,
        "formula": FORMULA,
        "unit": "mG",
        "hard_iron_step_mG": HARD_IRON_STEP_MG,
        "soft_iron_step": SOFT_IRON_STEP,
        "registers": [_as_dict(register) for register in registers.rows],
        "decoded": {"matrix": decoded.matrix.tolist(), "offset_mG": (decoded.offset / MG).tolist()},
        "checked": {
            "vectors": deviation.vectors,
            "field_mG": strength,
            "worst_mG": deviation.worst / MG,
            "worst_deg": deviation.worst_deg,
            "heading_deg": deviation.heading_deg,
        },
        "notes": [*about, *notes],
        "unverified": [UNVERIFIED],
    }
    return Export(target, text, fields, checked, (UNVERIFIED,))


def _notes(calibration: Calibration) -> list[str]:
    """For which readings the codes are right, and what the device puts out."""
    strength = f"{figures(calibration.field_strength / MG, 4)} mG"
    relative = "" if calibration.field_strength_known else ", which is relative, as no field strength was given"
    notes = [f"for readings recorded with these registers at 0; corrected ones are {strength} long{relative}"]
    if not calibration.axes.is_identity:
        notes.append(f"acts in the sensor's own axes: go on mapping them to {calibration.axes} afterwards")
    return notes


def _comment(remark: str) -> list[str]:
    """Break a remark into lines of comment."""
    return textwrap.wrap(
        remark, WIDTH, initial_indent="# ", subsequent_indent="#   ", break_long_words=False, break_on_hyphens=False
    )


def _row(register: Register) -> str:
    """One register as a line of columns."""
    value = f"{register.value:+.{1 if register.unit == 'mG' else 3}f} {register.unit}"
    return (
        f"{register.name:<17}{register.page:>2}  {f'0x{register.address:02X}':>7}  {register.code:>6}  "
        f"0x{register.word:04X}  {value:>9}"
    )


def _as_dict(register: Register) -> dict[str, int | float | str]:
    return {
        "name": register.name,
        "page": register.page,
        "address": register.address,
        "code": register.code,
        "word": register.word,
        "hex": f"0x{register.word:04X}",
        "value": register.value,
        "unit": register.unit,
    }
