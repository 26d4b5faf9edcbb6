r"""Numbers as targets hold them: rounded to what fits, and read back out of what other tools write.

All that is read is finite, or an error names what is not.

>>> keyed("a = 1.5\n# b = 2\nb=x", "settings.ini")
{'a': '1.5', 'b': 'x'}
>>> numbers({"a": "1.5", "b": "x"}, ["a", "b"], "settings.ini")
Traceback (most recent call last):
flinders.errors.DocumentError: settings.ini: b is 'x': need a finite number
"""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import floats
from flinders.core.units import COUNTS
from flinders.errors import DocumentError, NotExportable
from flinders.targets._target import Affine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

INT16: Final = (-(2**15), 2**15 - 1)
SETTING: Final = re.compile(r"\s*set\s+(\w+)\s*=(.*)", re.IGNORECASE)
"""A line of what Betaflight's and INAV's command lines print."""


# written


def whole(values: Floats, names: Sequence[str], *, lowest: int, highest: int, advice: str) -> tuple[int, ...]:
    """Round to whole numbers, half to even, that a register or setting can hold.

    Those beyond its range raise `NotExportable`, which names them, with what they would be.

    >>> whole(np.array([1.4, -2.6]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
    (1, -3)
    >>> whole(np.array([1.4, -9.0]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
    Traceback (most recent call last):
    flinders.errors.NotExportable: y would be -9 and holds -8 to 7: turn back
    """
    rounded = np.rint(values)
    beyond = {name: value for name, value in zip(names, rounded, strict=True) if not lowest <= value <= highest}
    if beyond:
        refusals = (f"{name} would be {value:,.6g} and holds {lowest} to {highest}" for name, value in beyond.items())
        exact = dict(zip(names, values.tolist(), strict=True))
        raise NotExportable(
            f"{'; '.join(refusals)}: {advice}", beyond=[*beyond], wanted={name: exact[name] for name in beyond}
        )
    return tuple(int(value) for value in rounded)


def in_16_bits(values: Floats, names: Sequence[str], *, lowest: int = INT16[0]) -> tuple[int, ...]:
    """Round to whole counts that an int16 holds; others raise `NotExportable`."""
    advice = "take away or demagnetise what is near the sensor, and check the unit of the recording"
    return whole(values, names, lowest=lowest, highest=INT16[1], advice=advice)


def nearest_diagonal(matrix: Floats) -> Floats:
    """(3,) the diagonal D that corrects best without the rest: least ‖D W⁻¹ − I‖, row by row.

    With V = W⁻¹, d_i = V_ii / Σ_j V_ij²: over all directions of the field, the mean square of what remains is least.

    >>> nearest_diagonal(np.diag([2.0, 1.0, 0.5]))
    array([2. , 1. , 0.5])
    """
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(matrix)
        diagonal: Floats = np.diag(inverse) / np.sum(inverse**2, axis=1)
    return diagonal


def offset_and_radii(calibration: Calibration, *, who: str, turn: Floats | None = None) -> tuple[Floats, Floats]:
    """(3,) offset and (3,) radii in counts, in the axes as recorded; soft iron off the diagonal is left out.

    `turn`, (3, 3), is a rotation of the calibration that is in the mounting.

    A radius is what an axis reads along the field: with D the diagonal that comes nearest to the matrix and F the
    length of corrected readings, F / D.

    >>> from flinders.core.calibration import Calibration
    >>> board = Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0)
    >>> offset, radii = offset_and_radii(board, who="a board")
    >>> radii
    array([320., 400., 500.])
    >>> of_radii(offset, radii).isclose(board)
    True
    """
    affine = Affine.of(calibration, COUNTS, who=who)
    matrix = affine.matrix if turn is None else turn.T @ affine.matrix
    with np.errstate(all="ignore"):
        return affine.offset, affine.strength / nearest_diagonal(matrix)


def of_radii(offset: Sequence[float] | Floats, radii: Floats, strength: float | None = None) -> Calibration:
    """The calibration of readings in counts that offset and radii stand for.

    Radii alone tell no `strength` F, in counts: without one it is their geometric mean, where D has determinant 1.
    """
    length = float(np.exp(np.mean(np.log(radii)))) if strength is None else strength
    return Affine(np.diag(length / radii), floats(offset), length).to_calibration(COUNTS, known=strength is not None)


# read back; each function raises `DocumentError` for what it cannot take


def decoded(content: bytes, source: str) -> str:
    """Read text."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"{source}: byte {error.start + 1} is not text in UTF-8: check the name") from None


def keyed(text: str, source: str, separator: str = "=") -> dict[str, str]:
    """Read lines of key and value; those that begin with ``#`` or ``;`` and those without a separator say nothing."""
    pairs: dict[str, str] = {}
    for line in text.splitlines():
        key, between, value = line.partition(separator)
        key, value = key.strip(), value.split("#")[0].strip()
        if not between or key.startswith(("#", ";")):
            continue
        if pairs.setdefault(key, value) != value:
            raise DocumentError(f"{source}: {key} is {pairs[key]} and again {value}: keep one of them")
    return pairs


def loaded(content: bytes, source: str) -> dict[str, object]:
    """Read a JSON object."""
    try:
        fields = json.loads(decoded(content, source))
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{source}: is no JSON: {error}") from None
    if not isinstance(fields, dict):
        raise DocumentError(f"{source}: is no JSON object: check the name")
    return fields


def settings(content: bytes, source: str, names: Sequence[str]) -> dict[str, str]:
    r"""Read ``set NAME = VALUE`` out of what a command line printed: of these names, those that are there.

    >>> settings(b"# dump\nset magzero_x = -7\nset p_roll = 45\n", "dump.txt", ["magzero_x", "magzero_y"])
    {'magzero_x': '-7'}
    """
    matches = map(SETTING.fullmatch, decoded(content, source).splitlines())
    lines = [f"{line[1].lower()}={line[2]}" for line in matches if line and line[1].lower() in names]
    return keyed("\n".join(lines), source)


def numbers(values: Mapping[str, object], names: Sequence[str], source: str) -> Floats:
    """(N,) the finite numbers of these names."""
    missing = [name for name in names if name not in values]
    if missing:
        raise DocumentError(f"{source}: no {', '.join(missing)}: need {names[0]} to {names[-1]}, all {len(names)}")
    return np.array([_number(values[name], name, source) for name in names])


def listed(values: Mapping[str, object], name: str, length: int, source: str) -> Floats:
    """(length,) a list of finite numbers."""
    entries = values.get(name)
    if not isinstance(entries, list) or len(entries) != length:
        raise DocumentError(f"{source}: {name} is {_short(entries)}: need a list of {length} numbers")
    return np.array([_number(value, f"{name}[{place}]", source) for place, value in enumerate(entries)])


def counts(
    words: Mapping[str, object], names: Sequence[str], source: str, *, between: tuple[int, int] = INT16
) -> tuple[int, ...]:
    """Read whole counts between the lowest and the highest that the target takes.

    >>> counts({"magzero_x": "-7"}, ["magzero_x"], "dump.txt")
    (-7,)
    """
    lowest, highest = between
    values = numbers(words, names, source)
    for name, value in zip(names, values, strict=True):
        if not (value.is_integer() and lowest <= value <= highest):
            raise DocumentError(f"{source}: {name} is {words[name]}: need a whole number, {lowest} to {highest}")
    return tuple(int(value) for value in values)


def _number(value: object, name: str, source: str) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise DocumentError(f"{source}: {name} is {_short(value)}: need a finite number")
    return number


def _short(value: object) -> str:
    text = repr(value)
    return "missing" if value is None else text if len(text) <= 40 else f"{text[:37]}..."
