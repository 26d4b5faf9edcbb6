"""What targets in raw counts share: an offset in whole counts, and of a matrix no more than a radius for each axis.

A radius is what an axis reads along the field: with D the diagonal that comes nearest to the matrix and F the length of
corrected readings, F / D. Radii alone tell no F: without one it is their geometric mean, where D has determinant 1.

>>> from flinders.core.calibration import Calibration
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0)
>>> offset, radii = offset_and_radii(found, who="a board")
>>> radii
array([320., 400., 500.])
>>> of_radii(offset, radii).isclose(found)
True
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import Floats, floats
from flinders.conventions._affine import Affine, nearest_diagonal, whole
from flinders.conventions._parsing import decoded, keyed, numbers
from flinders.core.units import COUNTS
from flinders.errors import DocumentError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.core.calibration import Calibration

LOWEST, HIGHEST = -(2**15), 2**15 - 1
ADVICE: Final = "take away or demagnetise what is near the sensor, and check the unit of the recording"
SETTING: Final = re.compile(r"\s*set\s+(\w+)\s*=(.*)", re.IGNORECASE)


def offset_and_radii(calibration: Calibration, *, who: str) -> tuple[Floats, Floats]:
    """(3,) offset and (3,) radii in counts, in the axes as recorded; what is beside the diagonal is left out.

    Raises
    ------
    UnitError
        Where the recording was not in counts.
    """
    found = Affine.of(calibration, COUNTS, who=who)
    with np.errstate(all="ignore"):
        return found.offset, found.strength / nearest_diagonal(found.matrix)


def of_radii(offset: Sequence[float] | Floats, radii: Floats, strength: float | None = None) -> Calibration:
    """The calibration of readings in counts that offset and radii stand for; `strength` is its F, in counts."""
    length = float(np.exp(np.mean(np.log(radii)))) if strength is None else strength
    return Affine(np.diag(length / radii), floats(offset), length).to_calibration(COUNTS, known=strength is not None)


def in_16_bits(values: Floats, names: Sequence[str], *, lowest: int = LOWEST) -> tuple[int, ...]:
    """Round to whole counts that an int16 holds; others raise `NotExportable`."""
    return whole(values, names, lowest=lowest, highest=HIGHEST, advice=ADVICE)


def settings(content: bytes, source: str, names: Sequence[str]) -> dict[str, str]:
    r"""Read ``set NAME = VALUE`` out of what a command line printed: of these names, those that are there.

    Raises
    ------
    DocumentError
        For what is no text, or a name with two values.

    Examples
    --------
    >>> settings(b"# dump\nset magzero_x = -7\nset p_roll = 45\n", "dump.txt", ["magzero_x", "magzero_y"])
    {'magzero_x': '-7'}
    """
    found = map(SETTING.fullmatch, decoded(content, source).splitlines())
    lines = [f"{line[1].lower()}={line[2]}" for line in found if line and line[1].lower() in names]
    return keyed("\n".join(lines), source)


def counts(
    words: Mapping[str, object], names: Sequence[str], source: str, *, lowest: int = LOWEST, highest: int = HIGHEST
) -> tuple[int, ...]:
    """Read whole counts.

    Raises
    ------
    DocumentError
        For names that are missing, fractions, and numbers beyond what the target takes.

    Examples
    --------
    >>> counts({"magzero_x": "-7"}, ["magzero_x"], "dump.txt")
    (-7,)
    """
    found = numbers(words, names, source)
    for name, value in zip(names, found, strict=True):
        if not (value.is_integer() and lowest <= value <= highest):
            raise DocumentError(f"{source}: {name} is {words[name]}: need a whole number, {lowest} to {highest}")
    return tuple(int(value) for value in found)
