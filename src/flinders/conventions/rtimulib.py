"""The settings of RTIMULib: ``c = Corr ((m − off) scale − O)``, off and scale from the extremes of each axis, in µT.

With extremes of −R and +R on all axes off is 0 and scale is 1, and O and Corr are offset and matrix. RTIMULib skips
them unless the extremes are valid too.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> settings = Settings.of(found)
>>> print(*settings.lines()[:3], settings.lines()[-1], sep=chr(10))
CompassCalValid=true
CompassCalMinX=-50.000000
CompassCalMaxX=50.000000
compassCalCorr33=0.800000
>>> read(chr(10).join(settings.lines()).encode(), "RTIMULib.ini").isclose(found)
True

Source: RTIMULib2, ``RTIMUSettings.cpp`` and ``RTIMU.cpp`` (calibrateAverageCompass). Readings are those after the
driver's exchange of axes. Numbers have six decimals, and are read as single precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, vectors
from flinders.conventions._affine import Affine
from flinders.conventions._parsing import decoded, keyed, numbers
from flinders.errors import DocumentError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

WHO: Final = "RTIMULib"
PLACES: Final = 6
VALID: Final = "CompassCalValid"
LOWEST: Final = tuple(f"CompassCalMin{axis}" for axis in "XYZ")
HIGHEST: Final = tuple(f"CompassCalMax{axis}" for axis in "XYZ")
ELLIPSOID_VALID: Final = "compassCalEllipsoidValid"
OFFSET: Final = tuple(f"compassCalOffset{axis}" for axis in "XYZ")
MATRIX: Final = tuple(f"compassCalCorr{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """What the lines say.

    Attributes
    ----------
    lowest, highest : (3,) float, µT
        Extremes of each axis.
    offset : (3,) float, µT
        Subtracted after the extremes were used.
    matrix : (3, 3) float
    """

    lowest: Floats
    highest: Floats
    offset: Floats
    matrix: Floats

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round to six decimals; in the axes as recorded.

        Raises
        ------
        UnitError
            For a calibration in counts.
        """
        found = Affine.of(calibration, "uT", who=WHO).decimals(PLACES)
        reach = np.full(3, np.maximum(np.round(found.strength, PLACES), 10.0**-PLACES))
        return cls(-reach, reach, found.offset, found.matrix)

    @property
    def middle(self) -> Floats:
        """(3,) off, in µT."""
        return (self.lowest + self.highest) / 2

    @property
    def scale(self) -> Floats:
        """(3,) the largest range over that of each axis."""
        ranges = self.highest - self.lowest
        scale: Floats = ranges.max() / ranges
        return scale

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) in µT to (..., 3) in µT."""
        scaled = (vectors(field, finite=False) - self.middle) * self.scale
        corrected: Floats = (scaled - self.offset) @ self.matrix.T
        return corrected

    def lines(self) -> list[str]:
        """The settings as they stand in the file."""
        values = {
            **dict(zip(LOWEST, self.lowest, strict=True)),
            **dict(zip(HIGHEST, self.highest, strict=True)),
            **dict(zip(OFFSET, self.offset, strict=True)),
            **dict(zip(MATRIX, self.matrix.ravel(), strict=True)),
        }
        written = {name: f"{value + 0.0:.{PLACES}f}" for name, value in values.items()}
        extremes = [f"{name}={written[name]}" for pair in zip(LOWEST, HIGHEST, strict=True) for name in pair]
        ellipsoid = [f"{name}={written[name]}" for name in (*OFFSET, *MATRIX)]
        return [f"{VALID}=true", *extremes, f"{ELLIPSOID_VALID}=true", *ellipsoid]


def sniff(head: bytes) -> bool:
    """Whether a file may hold settings of RTIMULib."""
    return b"CompassCalValid" in head or b"compassCalOffsetX" in head


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the settings back, extremes and ellipsoid composed.

    `strength`, µT: length of corrected readings; half of the largest range where it is not given.

    Raises
    ------
    DocumentError
        Where the extremes are not valid, or numbers are missing.
    """
    found = keyed(decoded(content, source), source)
    if found.get(VALID) != "true":
        raise DocumentError(f"{source}: {VALID} is {found.get(VALID, 'missing')}: RTIMULib uses no calibration then")
    lowest, highest = numbers(found, LOWEST, source), numbers(found, HIGHEST, source)
    if np.any(lowest >= highest):
        raise DocumentError(f"{source}: {', '.join(LOWEST)} must be below {', '.join(HIGHEST)}")
    offset: Floats = np.zeros(3)
    matrix: Floats = np.eye(3)
    if found.get(ELLIPSOID_VALID) == "true":
        offset, matrix = numbers(found, OFFSET, source), numbers(found, MATRIX, source).reshape(3, 3)
    settings = Settings(lowest, highest, offset, matrix)
    whole = Affine(
        matrix * settings.scale, settings.middle + offset / settings.scale, float((highest - lowest).max() / 2)
    )
    return whole.to_calibration("uT", strength=strength)
