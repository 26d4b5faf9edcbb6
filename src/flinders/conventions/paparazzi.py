"""Paparazzi's ``MAG_X_NEUTRAL`` and ``MAG_X_SENS``: ``m = (raw − neutral) sens``, in the axes of the sensor.

Corrected readings are 2048 long, 1 in fixed point with eleven bits; with D the diagonal that comes nearest to the
matrix and F the length of corrected readings in counts, sens = 2048 D / F.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> defines = Defines.of(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0))
>>> defines.neutral, defines.sensitivity
((120, -32, 7), (6.4, 5.12, 4.096))
>>> defines.apply([440.0, -32.0, 7.0])
array([2048.,    0.,    0.])
>>> values = (*defines.neutral, *defines.sensitivity)
>>> lines = [f'<define name="{name}" value="{value}"/>' for name, value in zip(NAMES, values, strict=True)]
>>> read("".join(lines).encode(), "airframe.xml").matrix.diagonal()
array([1.25, 1.  , 0.8 ])

Source: Paparazzi, ``sw/tools/calibration/calibration_utils.py`` (print_xml) and ``calibrate.py`` (the eleven bits). Its
build turns each sens into a fraction of 16-bit numbers, which is not imitated here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.conventions._affine import whole
from flinders.conventions._counts import counts, of_radii, offset_and_radii
from flinders.conventions._parsing import decoded, keyed, numbers
from flinders.errors import DocumentError, NotExportable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "Paparazzi"
UNITY: Final = 2**11
NEUTRALS: Final = ("MAG_X_NEUTRAL", "MAG_Y_NEUTRAL", "MAG_Z_NEUTRAL")
SENSITIVITIES: Final = ("MAG_X_SENS", "MAG_Y_SENS", "MAG_Z_SENS")
NAMES: Final = (*NEUTRALS, *SENSITIVITIES)
SIGNS: Final = ("MAG_X_SIGN", "MAG_Y_SIGN", "MAG_Z_SIGN")
LOWEST, HIGHEST = -(2**31), 2**31 - 1
ADVICE: Final = "check the unit of the recording"
DEFINE: Final = re.compile(r"<define\b([^<>]*)>")
ATTRIBUTE: Final = re.compile(r"""\b(name|value)\s*=\s*("[^"]*"|'[^']*')""")


@dataclass(frozen=True, slots=True)
class Defines:
    """The six numbers.

    Attributes
    ----------
    neutral : (3,) int
        Offset in counts, subtracted.
    sensitivity : (3,) float
        Of each axis, to nine digits.
    """

    neutral: tuple[int, ...]
    sensitivity: tuple[float, ...]

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round the offset; what is beside the diagonal is left out.

        Raises
        ------
        UnitError
            Where the recording was not in counts.
        NotExportable
            Where the offset is no number of 32 bits, or an axis would change its sign.
        """
        offset, radii = offset_and_radii(calibration, who=WHO)
        if not np.all(radii > 0):
            raise NotExportable(
                "a sensitivity would not be above 0, and change the sign of its axis: map it with --axes when you "
                "calibrate",
                beyond=SENSITIVITIES,
            )
        neutral = whole(offset, NEUTRALS, lowest=LOWEST, highest=HIGHEST, advice=ADVICE)
        return cls(neutral, tuple(float(f"{UNITY / radius:.9g}") for radius in radii))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in counts to (..., 3), 2048 for the earth's field."""
        corrected: Floats = (vectors(field, finite=False) - floats(self.neutral)) * floats(self.sensitivity)
        return corrected


def sniff(head: bytes) -> bool:
    """Whether a file may be an airframe of Paparazzi, or a part of one."""
    return b"<define" in head and re.search(rb"MAG_[XYZ]_(?:NEUTRAL|SENS)", head) is not None


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the defines back, with or without the prefix ``IMU_``; those in comments are left aside.

    `strength`, counts: length of corrected readings; without it the geometric mean of the radii, 2048 / sens.

    Raises
    ------
    DocumentError
        Where one is missing, stands there with two values or is no such number, and where an axis is turned over.
    """
    found = _defines(decoded(content, source), source)
    turned = [name for name in SIGNS if found.get(name, "1").strip() not in {"1", "+1"}]
    if turned:
        raise DocumentError(
            f"{source}: {turned[0]} is {found[turned[0]]}: whether the numbers stand before or after that change of "
            "sign is not known here; take the axes of IMU_MAG_RAW, and define no sign but 1"
        )
    neutral = counts(found, NEUTRALS, source, lowest=LOWEST, highest=HIGHEST)
    sensitivity = numbers(found, SENSITIVITIES, source)
    if not np.all(sensitivity > 0):
        raise DocumentError(f"{source}: {', '.join(SENSITIVITIES)} must be above 0: an axis is lost or turned over")
    return of_radii(neutral, UNITY / sensitivity, strength)


def _defines(text: str, source: str) -> dict[str, str]:
    """The defines of the magnetometer, by name without prefix."""
    first, *rest = text.split("<!--")
    bare = "".join([first, *(part.partition("-->")[2] for part in rest)])
    lines = []
    for define in DEFINE.finditer(bare):
        fields = {name: value[1:-1] for name, value in ATTRIBUTE.findall(define[1])}
        name = fields.get("name", "").removeprefix("IMU_")
        if name in {*NAMES, *SIGNS}:
            lines.append(f"{name}={' '.join(fields.get('value', '').split())}")
    return keyed("\n".join(lines), source)
