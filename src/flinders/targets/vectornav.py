"""Register 23 of VectorNav's sensors, magnetometer compensation: ``X = C (M − B)``, in gauss.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> from flinders.targets import find
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> print(sentence := find("vectornav").render(calibration).text.strip())
$VNWRG,23,1.2500000,0.0000000,0.0000000,0.0000000,1.0000000,0.0000000,0.0000000,0.0000000,0.8000000,0.1000000,\
-0.2000000,0.3000000*55
>>> read(sentence.encode(), "line", strength=50.0).isclose(calibration)
True

Source: VN-100 user manual UM001, section 6.2.1: the twelve numbers are C, row by row, and B. Numbers are written with
seven decimals, which is 0.01 nT; the device uses single precision.
"""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Final

from flinders.errors import DocumentError
from flinders.targets._numbers import Affine, decode_text, numbers
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

PLACES: Final = 7
NAMES: Final = (*(f"C{row}{column}" for row in range(3) for column in range(3)), "B0", "B1", "B2")
SENTENCE_STARTS: Final = ("$VNWRG,23,", "$VNRRG,23,")
"""Starts of two sentences: the one that writes the register, and the response to the one that reads it."""


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the sentence with its checksum; `UnitError` for a calibration in counts."""
    register = Affine.of(calibration, "G", who="register 23").decimals(PLACES)
    values = ",".join(f"{value + 0.0:.{PLACES}f}" for value in (*register.matrix.ravel(), *register.offset))
    sentence = f"VNWRG,23,{values}"
    notes = ["for readings recorded with register 23 at its default, whose values it replaces"]
    lines = [f"${sentence}*{checksum(sentence):02X}"]
    return Written(register.apply, lines, {"C": register.matrix, "B": register.offset}, notes)


def checksum(body: str) -> int:
    """Exclusive or of all characters between ``$`` and ``*``.

    >>> f"{checksum('VNRRG,01'):02X}", f"{checksum('VNWRG,06,0'):02X}"
    ('72', '6C')
    """
    return reduce(xor, body.encode(), 0)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the sentence, or the device's response to ``$VNRRG,23``.

    `strength` is the length of corrected readings in µT, which the register does not contain; by default 50 µT.

    Raises `DocumentError` for any other sentence, and for a wrong or missing checksum.
    """
    line = decode_text(content, source).strip()
    head = next((head for head in SENTENCE_STARTS if line.startswith(head)), None)
    if head is None or "\n" in line:
        raise DocumentError(f"{source}: need one line that starts with {' or '.join(SENTENCE_STARTS)}")
    body, star, stated = line[1:].partition("*")
    if not star or stated.strip().upper() not in (f"{checksum(body):02X}", "XX"):
        raise DocumentError(f"{source}: checksum {stated or 'missing'}, need {checksum(body):02X}: copy the line again")
    words = body.split(",")[2:]
    if len(words) != len(NAMES):
        raise DocumentError(f"{source}: {len(words)} numbers, register 23 has {len(NAMES)}")
    values = numbers(dict(zip(NAMES, words, strict=True)), NAMES, source)
    return Affine(values[:9].reshape(3, 3), values[9:], 0.5).to_calibration("G", strength=strength)


TARGETS: Final = (
    Target(
        name="vectornav",
        use="VectorNav register 23",
        group="chips and IMUs",
        suffix=".txt",
        title="VectorNav register 23",
        formula="X = C (M - B)",
        unit="G",
        keeps="all",
        storage="seven decimals, kept as float32",
        source="VN-100 user manual UM001, section 6.2.1",
        comment=None,
        write=write,
        reader=TargetReader(rb"\A\s*\$VN", read, "VectorNav's register 23"),
    ),
)
