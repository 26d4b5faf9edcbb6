"""Betaflight's ``mag_calibration``: ``m = aligned − magZero``, three whole numbers of raw counts, and no soft iron.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> zero = MagZero.of(Calibration(np.eye(3), [120.4, -31.6, 7.0], 400.0))
>>> zero.counts, zero.apply([520.0, -32.0, 7.0])
((120, -32, 7), array([400.,   0.,   0.]))
>>> read(b"set mag_calibration = 120,-32,7", "dump.txt", strength=400.0).offset
array([120., -32.,   7.])

It acts in the axes of the board, after ``align_mag``: those of ``magADC`` in its blackbox.

Source: Betaflight, ``cli/settings.c`` (mag_calibration) and ``sensors/compass.c``; int16.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import VEHICLE, Affine, acting
from flinders.conventions._counts import counts, in_16_bits, settings
from flinders.core.units import COUNTS
from flinders.errors import DocumentError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "Betaflight"
SETTING: Final = "mag_calibration"
NAMES: Final = tuple(f"{SETTING} {axis}" for axis in "xyz")


@dataclass(frozen=True, slots=True)
class MagZero:
    """The three numbers.

    Attributes
    ----------
    counts : (3,) int
        Subtracted.
    """

    counts: tuple[int, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round the offset, in the axes of the board; the matrix is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where 16 bits cannot hold it.
        """
        offset = Affine.of(calibration, COUNTS, who=WHO, acts=acting("mapped", calibration)).offset
        return cls(in_16_bits(offset, NAMES))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3) in counts."""
        corrected: Floats = vectors(field, finite=False) - floats(self.counts)
        return corrected


def sniff(head: bytes) -> bool:
    """Whether a file may be what Betaflight's CLI printed, or what is pasted into it."""
    return re.search(rb"(?i)\bset\s+mag_calibration\b", head) is not None


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the setting back, out of a dump or diff, for readings in the axes of the board; the matrix is the identity.

    `strength`, counts: length of a reading once the offset is taken off; it has to be given, since no other number
    tells it.

    Raises
    ------
    DocumentError
        Where it is missing, stands there with two values, or is not three whole numbers of 16 bits.
    """
    value = settings(content, source, [SETTING]).get(SETTING)
    words = [] if value is None else value.split(",")
    if len(words) != len(NAMES):
        raise DocumentError(f"{source}: {SETTING} is {value or 'missing'}: need a line set {SETTING} = x,y,z")
    zero = MagZero(counts(dict(zip(NAMES, words, strict=True)), NAMES, source))
    if strength is None:
        raise DocumentError(
            f"{source}: holds an offset of {zero.counts} counts, and nothing tells how long readings are: give "
            "--field-strength in counts, the length of a reading less the offset"
        )
    found = Affine(np.eye(3), floats(zero.counts), strength).to_calibration(COUNTS, known=True)
    return replace(found, frame=VEHICLE)
