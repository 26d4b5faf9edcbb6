"""The settings of RTIMULib: ``c = Corr ((m − off) scale − O)`` in µT, off and scale by the extremes of each axis.

With extremes of −R and +R on all axes, off is 0 and scale is 1, so that O is the offset and Corr the matrix. RTIMULib
ignores O and Corr unless the extremes are valid too.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> lines = write(calibration, ExportOptions()).body
>>> print(*lines[:3], lines[-1], sep=chr(10))
CompassCalValid=true
CompassCalMinX=-50.000000
CompassCalMaxX=50.000000
compassCalCorr33=0.800000
>>> read(chr(10).join(lines).encode(), "RTIMULib.ini").isclose(calibration)
True

Source: RTIMULib2, ``RTIMUSettings.cpp`` and ``RTIMU.cpp`` (calibrateAverageCompass). Readings are those after the
driver has exchanged axes. Numbers have six decimals and are read in single precision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import DocumentError
from flinders.targets._numbers import Affine, decode_text, numbers, parse_pairs
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

PLACES: Final = 6
VALID_KEY: Final = "CompassCalValid"
MIN_KEYS: Final = tuple(f"CompassCalMin{axis}" for axis in "XYZ")
MAX_KEYS: Final = tuple(f"CompassCalMax{axis}" for axis in "XYZ")
ELLIPSOID_VALID_KEY: Final = "compassCalEllipsoidValid"
OFFSET_KEYS: Final = tuple(f"compassCalOffset{axis}" for axis in "XYZ")
MATRIX_KEYS: Final = tuple(f"compassCalCorr{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the lines that replace lines with the same names; `UnitError` for a calibration in counts."""
    affine = Affine.of(calibration, "uT", who="RTIMULib").decimals(PLACES)
    reach = max(round(affine.strength, PLACES), 10.0**-PLACES)
    extremes: dict[str, float] = {}
    for low, high in zip(MIN_KEYS, MAX_KEYS, strict=True):
        extremes |= {low: -reach, high: reach}
    ellipsoid = dict(zip((*OFFSET_KEYS, *MATRIX_KEYS), (*affine.offset, *affine.matrix.ravel()), strict=True))
    lines = [f"{VALID_KEY}=true", *_lines(extremes), f"{ELLIPSOID_VALID_KEY}=true", *_lines(ellipsoid)]
    notes = ["replaces the lines of the same names in RTIMULib.ini; acts after the driver's own exchange of axes"]
    return Written(affine.apply, lines, dict(line.split("=") for line in lines), notes)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the settings; extremes and ellipsoid are combined.

    `strength` is the length of corrected readings in µT; by default half of the largest range.

    Raises `DocumentError` if the extremes are not valid or numbers are missing.
    """
    pairs = parse_pairs(decode_text(content, source), source)
    if pairs.get(VALID_KEY) != "true":
        raise DocumentError(
            f"{source}: {VALID_KEY} is {pairs.get(VALID_KEY, 'missing')}: RTIMULib then ignores the calibration"
        )
    lowest, highest = numbers(pairs, MIN_KEYS, source), numbers(pairs, MAX_KEYS, source)
    if np.any(lowest >= highest):
        raise DocumentError(f"{source}: {', '.join(MIN_KEYS)} must be below {', '.join(MAX_KEYS)}")
    offset: Floats = np.zeros(3)
    matrix: Floats = np.eye(3)
    if pairs.get(ELLIPSOID_VALID_KEY) == "true":
        offset, matrix = numbers(pairs, OFFSET_KEYS, source), numbers(pairs, MATRIX_KEYS, source).reshape(3, 3)
    ranges = highest - lowest
    scale = ranges.max() / ranges
    composed = Affine(matrix * scale, (lowest + highest) / 2 + offset / scale, float(ranges.max() / 2))
    return composed.to_calibration("uT", strength=strength)


def _lines(values: dict[str, float]) -> list[str]:
    """Names and numbers as lines of the file."""
    return [f"{name}={value + 0.0:.{PLACES}f}" for name, value in values.items()]


TARGETS: Final = (
    Target(
        name="rtimulib",
        use="lines of RTIMULib.ini",
        group="libraries, tools",
        suffix=".ini",
        title="RTIMULib.ini",
        formula="c = Corr ((m - off) scale - O), off = (Min + Max)/2 = 0, scale = 1",
        unit="uT",
        keeps="all",
        storage="six decimals, read as float32",
        source="RTIMUSettings.cpp, RTIMU.cpp",
        write=write,
        reader=TargetReader(rb"CompassCalValid|compassCalOffsetX", read, "RTIMULib.ini"),
    ),
)
