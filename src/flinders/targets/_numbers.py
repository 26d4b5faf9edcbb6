r"""Numbers of targets: in the target's unit and axes, rounded to fit, and parsed from files of other tools.

Numbers that are parsed must be finite; otherwise an error names the value.

>>> parse_pairs("a = 1.5\n# b = 2\nb=x", "settings.ini")
{'a': '1.5', 'b': 'x'}
>>> numbers({"a": "1.5", "b": "x"}, ["a", "b"], "settings.ini")
Traceback (most recent call last):
flinders.errors.DocumentError: settings.ini: b is 'x': need a finite number
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, Self, TypeAlias

import numpy as np

from flinders.arrays import check_vectors, to_floats
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import COUNTS, PER_UNIT, Unit
from flinders.errors import DocumentError, NotExportable, UnitError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.calibration_file import Rotation
    from flinders.core.disturbance import Disturbance

INT16: Final = (-(2**15), 2**15 - 1)
SETTING: Final = re.compile(r"\s*set\s+(\w+)\s*=(.*)", re.IGNORECASE)
"""A line that sets a parameter, as the command line of a board prints it."""

Acts: TypeAlias = Literal["recorded", "mapped", "across"]
"""Axes in which a target corrects readings.

``recorded``: those of the recording, mapped afterwards. ``mapped``: those of the calibration, mapped before.
``across``: raw readings in the former, corrected readings in the latter."""

VEHICLE: Final = "vehicle"
"""Frame of a calibration whose readings were recorded in axes of the vehicle."""
OWN, RECORDED = "own", "recorded"
"""Units of a target that accepts any unit: that of the calibration (µT or counts), and that of the recording."""
MAX_NUMBER: Final = 1e15
"""Largest number for a target, and inverse of the smallest one: the product of two still fits into float32."""
MOTOR_QUANTITIES: Final = {"current": 2, "throttle": 1}
"""Quantities that autopilots compensate, the preferred first, with their COMPASS_MOTCT and CAL_MAG_COMP_TYP."""


# a calibration in the unit and axes of a target


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """``corrected = matrix @ (raw - offset)``: (3, 3) matrix, (3,) offset, and the `strength` of corrected readings.

    >>> calibration = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
    >>> in_gauss = Affine.of(calibration, "G", who="this device")
    >>> in_gauss.offset.round(6), in_gauss.apply([0.5, -0.2, 0.3]).round(6)
    (array([ 0.1, -0.2,  0.3]), array([0.5, 0. , 0. ]))
    >>> in_gauss.to_calibration("G").isclose(calibration)
    True
    """

    matrix: Floats
    offset: Floats
    strength: float

    @classmethod
    def of(cls, calibration: Calibration, unit: str, *, who: str, acts: Acts = "recorded") -> Self:
        """Convert a calibration to a unit and to the axes in which a target corrects.

        Raises the errors of `per_unit`, and `NotExportable` for numbers that no magnetometer has.
        """
        size = per_unit(calibration, unit, who=who)
        matrix, offset = calibration.matrix, calibration.offset
        if acts == "recorded":
            matrix, offset = in_recorded_axes(calibration)
        elif acts == "across":
            back = unmapping_matrix(calibration)
            matrix, offset = matrix @ back.T, back @ offset
        strength = calibration.field_strength / size
        with np.errstate(over="ignore"):
            affine = cls(matrix, offset / size, strength)
        largest = max(float(np.abs(affine.matrix).max()), float(np.abs(affine.offset).max()), strength, 1 / strength)
        if not largest < MAX_NUMBER:
            raise NotExportable(
                f"a number such as {largest:.2g} is implausible for a magnetometer: check the unit of the recording, "
                "and the field strength if it was given",
                hint={"unit": None, "site": None},
                beyond=("matrix", "offset"),
            )
        return affine

    @property
    def single(self) -> Affine:
        """The numbers as float32."""
        return Affine(round_to_single(self.matrix), round_to_single(self.offset), self.strength)

    def decimals(self, places: int) -> Affine:
        """The numbers, rounded to a number of decimal places."""
        return Affine(np.round(self.matrix, places), np.round(self.offset, places), self.strength)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct (..., 3) readings in the target's unit."""
        corrected: Floats = (check_vectors(field, finite=False) - self.offset) @ self.matrix.T
        return corrected

    def to_calibration(self, unit: str, *, known: bool = False, strength: float | None = None) -> Calibration:
        """Calibration with these numbers, in the axes of the target.

        `unit` is the unit of the offset. `strength`, in µT or counts, is the field strength if the target does not
        store it; `known` says that it is known and not a convention. Raises `ArrayError` for numbers that flatten all
        readings into a plane, and `UsageError` for a field strength that is not positive.
        """
        raw = Unit.of(unit)
        length = self.strength * raw.scale if strength is None else strength
        rotation: Rotation = "symmetric" if np.array_equal(self.matrix, self.matrix.T) else "composed"
        return Calibration(
            self.matrix, raw.scale * self.offset, length, known or strength is not None, rotation, raw=raw
        )


def in_recorded_axes(calibration: Calibration) -> tuple[Floats, Floats]:
    """(3, 3) matrix and (3,) offset that correct readings before their axes are mapped.

    With the mapping P they are Pᵀ W P and Pᵀ b. If corrected readings are mapped afterwards, the result is that of the
    calibration.

    >>> upside_down = Calibration(np.diag([1.0, 2.0, 0.5]), [10, 20, 30], 50.0, axes=Axes.of("y,x,-z"))
    >>> matrix, offset = in_recorded_axes(upside_down)
    >>> np.diag(matrix), offset
    (array([2. , 1. , 0.5]), array([ 20.,  10., -30.]))
    """
    back = unmapping_matrix(calibration)
    return back @ calibration.matrix @ back.T, back @ calibration.offset


def in_vehicle_axes(calibration: Calibration) -> Calibration:
    """Calibration for readings in the axes of the vehicle, whether or not they were recorded in these axes.

    >>> mapped = Calibration(np.eye(3), [1, 2, 3], 50.0, axes=Axes.of("x,-y,-z"))
    >>> in_recorded_axes(in_vehicle_axes(mapped))[1]
    array([1., 2., 3.])
    >>> in_recorded_axes(in_vehicle_axes(replace(mapped, frame="vehicle")))[1]      # as the log had them
    array([ 1., -2., -3.])
    """
    return calibration if calibration.frame == VEHICLE else replace(calibration, axes=Axes())


def shift_in_recorded_axes(calibration: Calibration, disturbance: Disturbance) -> Floats:
    """(3,) change of the offset per unit of a disturbance, in the recorded axes and the calibration's unit."""
    return to_floats(unmapping_matrix(calibration) @ disturbance.per_unit)


def unmapping_matrix(calibration: Calibration) -> Floats:
    """(3, 3) Pᵀ: from the axes of the calibration to those of the recording."""
    return calibration.axes.apply(np.eye(3))


def axes_of_action(acts: Acts, calibration: Calibration) -> Acts:
    """Axes in which a target corrects this recording; for readings in vehicle axes, always those of the recording."""
    return "recorded" if acts == "mapped" and calibration.frame == VEHICLE else acts


def in_sensor_axes(calibration: Calibration, mounting: Floats) -> Calibration:
    """Convert a calibration for readings in vehicle axes to the sensor's axes before the mounting.

    `mounting` is the (3, 3) rotation from the sensor's axes to those of the vehicle.

    >>> turned = Calibration(np.diag([1.0, 2.0, 0.5]), [10, 20, 30], 50.0, frame="vehicle")
    >>> upright = in_sensor_axes(turned, np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    >>> upright.offset, np.diag(upright.matrix), upright.frame
    (array([ 20., -10.,  30.]), array([2. , 1. , 0.5]), 'sensor')
    """
    matrix, offset = in_recorded_axes(calibration)
    disturbances = tuple(
        replace(each, per_unit=mounting.T @ shift_in_recorded_axes(calibration, each))
        for each in calibration.disturbances
    )
    turned = mounting.T @ matrix @ mounting
    return replace(
        calibration,
        matrix=(turned + turned.T) / 2 if calibration.rotation == "symmetric" else turned,
        offset=mounting.T @ offset,
        axes=Axes(),
        frame="sensor",
        disturbances=disturbances,
    )


def refuse_mounted(calibration: Calibration, *, who: str) -> None:
    """Raise `NotExportable` for readings in vehicle axes, for a target that corrects them before the mounting."""
    if calibration.frame == VEHICLE:
        raise NotExportable(
            f"the calibration is for readings in the axes of the vehicle, and {who} corrects readings in the axes of "
            "the sensor: the numbers would be wrong for a rotated sensor. State the mounting of the sensor in the "
            "vehicle (none if the axes are the same), or calibrate from readings in the axes of the sensor, or "
            "choose a target that corrects readings as recorded (c, json)",
            hint={"mounting": None},
            beyond=(),
            frame=calibration.frame,
        )


def per_unit(calibration: Calibration, unit: str, *, who: str) -> float:
    """Size of one unit of a target, in the unit of the calibration.

    Raises `UnitError` if only one of the two units is counts.
    """
    if unit == OWN:
        return 1.0
    if unit == COUNTS != calibration.raw.name:
        raise UnitError(
            f"the recording was in {calibration.raw.name}, and {who} uses the sensor's raw counts: record "
            "these, and calibrate again",
            hint={"unit": COUNTS},
        )
    if unit in (RECORDED, COUNTS):
        return calibration.raw.scale
    if calibration.unit == COUNTS:
        raise UnitError(
            f"the calibration is in counts, and {who} works in {unit}: calibrate again with the microtesla per "
            "count from the sensor's data sheet, or with a unit if the readings have one",
            hint={"scale": None, "unit": None},
        )
    return PER_UNIT[unit]


def split_motor_disturbance(calibration: Calibration) -> tuple[Calibration, Disturbance | None]:
    """Calibration with motors at rest, and the disturbance that an autopilot compensates, or None.

    >>> from flinders.core.disturbance import Disturbance
    >>> both = (Disturbance("current", [0.5, 0, 0], highest=20), Disturbance("throttle", [3, 0, 0], highest=1))
    >>> plain, motor = split_motor_disturbance(Calibration(np.eye(3), [10, 0, 0], 50.0, disturbances=both))
    >>> plain.offset, motor.name
    (array([10.,  0.,  0.]), 'current')
    """
    ours = {disturbance.name: disturbance for disturbance in calibration.disturbances}
    motor = next((ours[name] for name in MOTOR_QUANTITIES if name in ours), None)
    return calibration.at(**({motor.name: 0.0} if motor else {})), motor


def round_to_single(values: ArrayLike) -> Floats:
    """Round to float32.

    >>> float(round_to_single(0.1)) - 0.1
    1.49e-09
    """
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(values, np.float32).astype(np.float64)


# written


def round_to_integers(
    values: Floats, names: Sequence[str], *, lowest: int, highest: int, advice: str
) -> tuple[int, ...]:
    """Round to integers, half to even, within the range of a register or setting.

    Raises `NotExportable` for values out of range, with their names and exact values.

    >>> round_to_integers(np.array([1.4, -2.6]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
    (1, -3)
    >>> round_to_integers(np.array([1.4, -9.0]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
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
    """Round to counts of an int16; `NotExportable` for values out of range."""
    advice = "remove or demagnetise magnetic parts near the sensor, and check the unit of the recording"
    return round_to_integers(values, names, lowest=lowest, highest=INT16[1], advice=advice)


def nearest_diagonal(matrix: Floats) -> Floats:
    """(3,) diagonal D that approximates a matrix best: with the least ‖D W⁻¹ − I‖, row by row.

    With V = W⁻¹, d_i = V_ii / Σ_j V_ij². D has the smallest mean square of the residual over all directions of the
    field.

    >>> nearest_diagonal(np.diag([2.0, 1.0, 0.5]))
    array([2. , 1. , 0.5])
    """
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(matrix)
        diagonal: Floats = np.diag(inverse) / np.sum(inverse**2, axis=1)
    return diagonal


def offset_and_radii(calibration: Calibration, *, who: str, turn: Floats | None = None) -> tuple[Floats, Floats]:
    """(3,) offset and (3,) radii in counts, in the recorded axes; off-diagonal soft iron is omitted.

    `turn` is a (3, 3) rotation of the calibration that the mounting contains.

    A radius is the reading of an axis along the field, F / D: F is the length of corrected readings, and D the diagonal
    nearest to the matrix.

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
    """Calibration in counts with an offset and radii.

    Radii do not determine the field strength F in counts, `strength`. By default it is their geometric mean, with which
    D has the determinant 1.
    """
    length = float(np.exp(np.mean(np.log(radii)))) if strength is None else strength
    return Affine(np.diag(length / radii), to_floats(offset), length).to_calibration(COUNTS, known=strength is not None)


# Reading of files: each function raises `DocumentError` for invalid content.


def decode_text(content: bytes, source: str) -> str:
    """Decode UTF-8 text."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"{source}: byte {error.start + 1} is not text in UTF-8: check the name") from None


def parse_pairs(text: str, source: str, separator: str = "=") -> dict[str, str]:
    """Keys and values in lines; lines that start with ``#`` or ``;``, or have no separator, are ignored."""
    pairs: dict[str, str] = {}
    for line in text.splitlines():
        key, between, value = line.partition(separator)
        key, value = key.strip(), value.split("#")[0].strip()
        if not between or key.startswith(("#", ";")):
            continue
        if pairs.setdefault(key, value) != value:
            raise DocumentError(f"{source}: {key} is {pairs[key]}, and later {value}: keep one of them")
    return pairs


def load_object(content: bytes, source: str) -> dict[str, object]:
    """Parse a JSON object."""
    try:
        fields = json.loads(decode_text(content, source))
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{source}: is no JSON: {error}") from None
    if not isinstance(fields, dict):
        raise DocumentError(f"{source}: is no JSON object: check the name")
    return fields


def settings(content: bytes, source: str, names: Sequence[str]) -> dict[str, str]:
    r"""Values in lines ``set NAME = VALUE`` that a command line printed, by name; only the given names.

    >>> settings(b"# dump\nset magzero_x = -7\nset p_roll = 45\n", "dump.txt", ["magzero_x", "magzero_y"])
    {'magzero_x': '-7'}
    """
    matches = map(SETTING.fullmatch, decode_text(content, source).splitlines())
    lines = [f"{line[1].lower()}={line[2]}" for line in matches if line and line[1].lower() in names]
    return parse_pairs("\n".join(lines), source)


def numbers(values: Mapping[str, object], names: Sequence[str], source: str) -> Floats:
    """(N,) finite numbers with these names."""
    missing = [name for name in names if name not in values]
    if missing:
        raise DocumentError(f"{source}: no {', '.join(missing)}: need {names[0]} to {names[-1]}, all {len(names)}")
    return np.array([_number(values[name], name, source) for name in names])


def parse_list(values: Mapping[str, object], name: str, length: int, source: str) -> Floats:
    """(length,) finite numbers of a list."""
    entries = values.get(name)
    if not isinstance(entries, list) or len(entries) != length:
        raise DocumentError(f"{source}: {name} is {_shorten(entries)}: need a list of {length} numbers")
    return np.array([_number(value, f"{name}[{place}]", source) for place, value in enumerate(entries)])


def parse_counts(
    words: Mapping[str, object], names: Sequence[str], source: str, *, between: tuple[int, int] = INT16
) -> tuple[int, ...]:
    """Integers with these names, within the target's range.

    >>> parse_counts({"magzero_x": "-7"}, ["magzero_x"], "dump.txt")
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
        raise DocumentError(f"{source}: {name} is {_shorten(value)}: need a finite number")
    return number


def _shorten(value: object) -> str:
    text = repr(value)
    return "missing" if value is None else text if len(text) <= 40 else f"{text[:37]}..."


def yaml_text(value: object, decimals: int = 17) -> str:
    """A scalar, list or mapping in YAML. Floats get a point and a signed exponent, since YAML 1.1 reads 1e-05 as text.

    >>> print(yaml_text({"unit": "T", "columns": {"BAT[1].Curr": [1e-5, -2.0]}}, 3))
    {unit: "T", columns: {"BAT[1].Curr": [1.000e-05, -2.000e+00]}}
    """
    if isinstance(value, dict):
        names = (name if name.isidentifier() else json.dumps(name) for name in value)
        members = (yaml_text(member, decimals) for member in value.values())
        return f"{{{', '.join(f'{name}: {member}' for name, member in zip(names, members, strict=True))}}}"
    if isinstance(value, list):
        return f"[{', '.join(yaml_text(member, decimals) for member in value)}]"
    return f"{value:.{decimals}e}" if isinstance(value, float) else json.dumps(value)
