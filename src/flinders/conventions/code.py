"""Generated code: ``corrected = A (raw − b)`` in single precision, or in whole numbers of fixed point.

It takes readings as they were recorded and gives corrected ones in the axes of the calibration, so that the mapping of
axes is in the matrix. In single precision the recorded unit becomes µT where that is known. In fixed point input and
output are whole numbers of the recorded unit: the entries of A are kept in 15 or 31 bits, b in 2⁻⁸ or 2⁻⁴ of a unit.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0)
>>> code = FixedPoint.of(found, Q15)
>>> code.entries[0], code.shift, code.offset
((20480, 0, 0), 14, (30822, -8090, 1792))
>>> code.apply([440, -32, 7])                                           # 1.25 · 319.6 = 399.5, −0.4, 0
array([400.,   0.,   0.])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import RECORDED, Affine, whole
from flinders.core.units import COUNTS, MICROTESLA
from flinders.errors import NotExportable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "generated code"
ADVICE: Final = "readings are too large for this format: use the one in single precision"


@dataclass(frozen=True, slots=True)
class Format:
    """A format of fixed point.

    Attributes
    ----------
    name : str
        ``Q15`` or ``Q31``.
    bits : int
        Of an entry of the matrix, with its sign.
    fraction : int
        Bits of the offset behind the point.
    largest : int
        Readings may be from minus this, less one, to this; beyond it they are held there.
    """

    name: str
    bits: int
    fraction: int
    largest: int


Q15: Final = Format("Q15", 16, 8, 2**15 - 1)
Q31: Final = Format("Q31", 32, 4, 2**23 - 1)


def single_precision(calibration: Calibration) -> Affine:
    """(A, b) for readings in the recorded unit, in single precision; what comes out is in µT, or in counts."""
    found = Affine.of(calibration, RECORDED, who=WHO, acts="across")
    size = calibration.raw.scale
    return Affine(found.matrix * size, found.offset, calibration.field_strength).single


def unit_in(calibration: Calibration) -> str:
    """Name the unit of the readings that go in."""
    return calibration.raw.name


def unit_out(calibration: Calibration) -> str:
    """Name the unit of what comes out of `single_precision`."""
    return MICROTESLA if calibration.unit == MICROTESLA else COUNTS


@dataclass(frozen=True, slots=True)
class FixedPoint:
    """A correction in whole numbers: ``(Σ entries (raw 2^f − offset) + half) >> (shift + f)``.

    Attributes
    ----------
    format : Format
    entries : (3, 3) int
        Of the matrix, in units of 2^-shift.
    offset : (3,) int
        In units of 2^-f, f the `fraction` of the format.
    shift : int
        Bits of an entry behind the point: as many as the largest entry leaves.
    """

    format: Format
    entries: tuple[tuple[int, int, int], ...]
    offset: tuple[int, ...]
    shift: int

    @classmethod
    def of(cls, calibration: Calibration, form: Format) -> Self:
        """Round a calibration.

        Raises
        ------
        NotExportable
            For a matrix or an offset beyond the format.
        """
        found = Affine.of(calibration, RECORDED, who=WHO, acts="across")
        largest = float(np.abs(found.matrix).max())
        shift = form.bits - 1 - max(math.floor(math.log2(largest)) + 1, 0) if largest > 0 else form.bits - 1
        if np.rint(largest * 2.0**shift) >= 2 ** (form.bits - 1):
            shift -= 1
        if shift < 1:
            raise NotExportable(
                f"the matrix has an entry of {largest:.3g}, {form.name} holds up to {2 ** (form.bits - 2)}: {ADVICE}",
                beyond=("matrix",),
            )
        entries = np.rint(found.matrix * 2.0**shift).astype(np.int64)
        edge = (form.largest + 1) << form.fraction
        names = ("offset x", "offset y", "offset z")
        with np.errstate(over="ignore"):
            scaled = found.offset * 2.0**form.fraction
        offset = whole(scaled, names, lowest=-edge, highest=edge, advice=ADVICE)
        return cls(form, tuple(tuple(row) for row in entries.tolist()), offset, shift)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings as the code does, which rounds them first: (..., 3) to (..., 3), in the recorded unit."""
        form, edge = self.format, self.format.largest
        read = np.clip(np.nan_to_num(np.rint(vectors(field, finite=False))), -edge - 1, edge).astype(np.int64)
        moved = (read << form.fraction) - np.array(self.offset, np.int64)
        places = self.shift + form.fraction
        found = (moved @ np.array(self.entries, np.int64).T + (1 << (places - 1))) >> places
        return floats(np.clip(found, -edge - 1, edge))
