"""Registers of the ADIS16480 and ADIS16488 as a table to copy: name, page, address, code, sixteen bits.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.75]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("mG"))
>>> from flinders.exporters import find
>>> export = find("adis16480").render(found)
>>> print(*[line for line in export.text.splitlines() if line.startswith("HARD")], sep=chr(10))
HARD_IRON_X       2     0x28   -1250  0xFB1E   -125.0 mG
HARD_IRON_Y       2     0x2A    2000  0x07D0   +200.0 mG
HARD_IRON_Z       2     0x2C       0  0x0000     +0.0 mG
>>> export.fields["checked"]["worst"] < 1e-9
True
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from flinders.conventions.adis16480 import HARD_IRON_STEP_MG, MG, SOFT_IRON_STEP, Register, Registers
from flinders.errors import ArrayError, NotExportable
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="ADIS16480",
    formula="M_C = (I + S) M + H",
    unit="mG",
    keeps="all",
    storage="int16: H in 0.1 mG to +/-3276.7, S in 1/32768 to +/-100 %",
    source="data sheets, ADIS16480 Rev. H page 35 and ADIS16488 Rev. B page 25",
    errors_in="mG",
    unverified=("that one step of S is 1/32768, and that H is added after (I + S); look both up in your data sheet",),
)
"""What no data sheet was seen to say is `unverified`."""
LATER: Final = replace(SHEET, title="ADIS16488")

HEADING: Final = f"# {'register':<15}{'page':>4}  {'address':>7}  {'code':>6}  {'hex':<6}  {'value':>9}"


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the twelve registers.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        Where a register cannot hold its value, or its steps are too coarse for it.
    """
    registers = Registers.of(calibration)
    decoded = _decoded(registers, calibration.field_strength)
    values: dict[str, Any] = {
        "hard_iron_step_mG": HARD_IRON_STEP_MG,
        "soft_iron_step": SOFT_IRON_STEP,
        "registers": [_as_dict(register) for register in registers.rows],
        "decoded": {"matrix": decoded.matrix, "offset_mG": decoded.offset / MG},
    }
    body = ["#", HEADING, *map(_row, registers.rows)]
    return Written(registers.apply, body, values, ["for readings recorded with these registers at 0"])


def _decoded(registers: Registers, strength: float) -> Calibration:
    """What the codes stand for; codes that lose a direction of the field are refused."""
    try:
        return registers.to_calibration(strength)
    except ArrayError:
        raise NotExportable(
            "rounded to the steps of the registers, all readings would lie in a plane: check the unit of the "
            "recording, and --field-strength where it was given",
            beyond=(),
        ) from None


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
