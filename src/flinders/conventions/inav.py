r"""INAV's ``magzero`` and ``maggain``: ``m = (raw − zero) 1024 / gain``, whole numbers, in the axes of the sensor.

A gain is the radius of its axis in counts, so that corrected readings are 1024 long; with D the diagonal that comes
nearest to the matrix and F the length of corrected readings in counts, gain = F / D.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> settings = Settings.of(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0))
>>> settings.zero, settings.gain
((120, -32, 7), (320, 400, 500))
>>> settings.apply([440.0, -32.0, 7.0])
array([1024.,    0.,    0.])
>>> dump = b"set magzero_x = 120\nset magzero_y = -32\nset magzero_z = 7\n"
>>> dump += b"set maggain_x = 320\nset maggain_y = 400\nset maggain_z = 500\n"
>>> read(dump, "dump.txt").matrix.diagonal()
array([1.25, 1.  , 0.8 ])

Source: INAV, ``sensors/compass.c`` at 005b1ee7; int16, and a division that leaves off what is behind the point.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._counts import counts, in_16_bits, of_radii, offset_and_radii, settings
from flinders.errors import DocumentError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "INAV"
UNITY: Final = 1024
"""Length of a corrected reading."""
ZEROS: Final = ("magzero_x", "magzero_y", "magzero_z")
GAINS: Final = ("maggain_x", "maggain_y", "maggain_z")


@dataclass(frozen=True, slots=True)
class Settings:
    """The six numbers.

    Attributes
    ----------
    zero : (3,) int
        Offset in counts, subtracted.
    gain : (3,) int
        Radius of each axis in counts.
    """

    zero: tuple[int, ...]
    gain: tuple[int, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round offset and radii; what is beside the diagonal is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where 16 bits cannot hold them.
        """
        offset, radii = offset_and_radii(calibration, who=WHO)
        return cls(in_16_bits(offset, ZEROS), in_16_bits(radii, GAINS, lowest=1))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3) whole numbers, 1024 for the earth's field."""
        scaled = (vectors(field, finite=False) - floats(self.zero)) * UNITY / floats(self.gain)
        return np.trunc(scaled) + 0.0


def sniff(head: bytes) -> bool:
    """Whether a file may be what INAV's CLI printed, or what is pasted into it."""
    return re.search(rb"(?i)\bset\s+mag(?:zero|gain)_[xyz]\b", head) is not None


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the settings back, out of a dump, for readings in the axes of the sensor.

    `strength`, counts: length of corrected readings; without it the geometric mean of the gains.

    Raises
    ------
    DocumentError
        Where one is missing, stands there with two values, or is none that INAV holds.
    """
    found = settings(content, source, [*ZEROS, *GAINS])
    missing = [name for name in (*ZEROS, *GAINS) if name not in found]
    if missing:
        raise DocumentError(
            f"{source}: no {', '.join(missing)}: need all six, magzero_x to maggain_z. INAV's diff leaves out what is "
            "at its default: save what dump prints"
        )
    zero, gain = counts(found, ZEROS, source), counts(found, GAINS, source, lowest=1)
    return of_radii(zero, floats(gain), strength)
