"""What most targets share: a matrix and an offset in the target's unit, ``corrected = matrix @ (raw - offset)``.

>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.25, 1.0, 0.8]), [10.0, -20.0, 30.0], 50.0, raw=Unit.of("uT"))
>>> in_gauss = Affine.of(found, "G", who="this device")
>>> in_gauss.offset.round(6), in_gauss.apply([0.5, -0.2, 0.3]).round(6)
(array([ 0.1, -0.2,  0.3]), array([0.5, 0. , 0. ]))
>>> in_gauss.to_calibration("G").isclose(found)
True
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, Self, TypeAlias

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.core.calibration import Calibration
from flinders.core.units import COUNTS, PER_UNIT, Unit
from flinders.errors import NotExportable, UnitError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.core.calibration_file import Rotation
    from flinders.core.disturbance import Disturbance

Acts: TypeAlias = Literal["recorded", "mapped", "across"]
"""In which axes a target works: those of the recording (mapped afterwards), those of the calibration (mapped before),
or from the first to the second."""

VEHICLE: Final = "vehicle"
"""The frame of a calibration of readings that were in the axes of the vehicle when they were recorded."""

OWN: Final = "own"
"""The unit of a target that takes any: that of the calibration, µT or counts."""

BEYOND_ALL: Final = 1e15
"""Numbers that no target gets to see, nor what is next to nothing: products of two of them suit single precision."""

RECORDED: Final = "recorded"
"""The unit of a target that takes readings as they were recorded."""


@dataclass(frozen=True, slots=True, eq=False)
class Affine:
    """``corrected = matrix @ (raw - offset)``.

    Attributes
    ----------
    matrix : (3, 3) float
    offset : (3,) float, in the target's unit
    strength : float, in the target's unit
        Length of corrected readings.
    """

    matrix: Floats
    offset: Floats
    strength: float

    @classmethod
    def of(cls, calibration: Calibration, unit: str, *, who: str, acts: Acts = "recorded") -> Self:
        """Express a calibration in a unit and in the axes in which a target works.

        Raises
        ------
        UnitError
            Where counts would have to become a unit, or the other way round.
        NotExportable
            For numbers that no magnetometer has.
        """
        size = per_unit(calibration, unit, who=who)
        matrix, offset = calibration.matrix, calibration.offset
        if acts == "recorded":
            matrix, offset = in_recorded_axes(calibration)
        elif acts == "across":
            back = _unmapped(calibration)
            matrix, offset = matrix @ back.T, back @ offset
        strength = calibration.field_strength / size
        with np.errstate(over="ignore"):
            affine = cls(matrix, offset / size, strength)
        largest = max(float(np.abs(affine.matrix).max()), float(np.abs(affine.offset).max()), strength, 1 / strength)
        if not largest < BEYOND_ALL:
            raise NotExportable(
                f"numbers like {largest:.2g} are not those of a magnetometer: check the unit of the recording, and "
                "--field-strength where it was given",
                beyond=("matrix", "offset"),
            )
        return affine

    @property
    def single(self) -> Self:
        """The same in single precision."""
        return replace(self, matrix=single(self.matrix), offset=single(self.offset), strength=self.strength)

    def decimals(self, places: int) -> Self:
        """Give the same as it is after `places` decimal places."""
        return replace(self, matrix=np.round(self.matrix, places), offset=np.round(self.offset, places))

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings: (..., 3) to (..., 3), in the target's unit."""
        corrected: Floats = (vectors(field, finite=False) - self.offset) @ self.matrix.T
        return corrected

    def to_calibration(
        self, unit: str, *, known: bool = False, sensor: str | None = None, strength: float | None = None
    ) -> Calibration:
        """The calibration that the numbers stand for, in the axes of the target.

        Parameters
        ----------
        unit : str
            Of the offset.
        known : bool
            The field strength was given, and is no convention.
        sensor : str, optional
        strength : float, optional, µT (or counts)
            Field strength, where the target does not hold it.

        Raises
        ------
        ArrayError
            Where they flatten all readings into a plane.
        UsageError
            For a field strength that is not positive.
        """
        raw = Unit.of(unit)
        length = self.strength * raw.scale if strength is None else strength
        rotation: Rotation = "symmetric" if np.array_equal(self.matrix, self.matrix.T) else "composed"
        return Calibration(
            self.matrix,
            raw.scale * self.offset,
            length,
            known or strength is not None,
            rotation,
            raw=raw,
            sensor=sensor,
        )


def in_recorded_axes(calibration: Calibration) -> tuple[Floats, Floats]:
    """(3, 3) matrix and (3,) offset that correct readings before their axes are mapped.

    With P the mapping, Pᵀ W P and Pᵀ b: mapped afterwards, the result is that of the calibration.

    >>> from flinders.core.axes import Axes
    >>> upside_down = Calibration(np.diag([1.0, 2.0, 0.5]), [10, 20, 30], 50.0, axes=Axes.of("y,x,-z"))
    >>> matrix, offset = in_recorded_axes(upside_down)
    >>> np.diag(matrix), offset
    (array([2. , 1. , 0.5]), array([ 20.,  10., -30.]))
    """
    back = _unmapped(calibration)
    return back @ calibration.matrix @ back.T, back @ calibration.offset


def driver_in_recorded_axes(calibration: Calibration, disturbance: Disturbance) -> Floats:
    """(3,) offset per unit of a disturbance in the axes as recorded, in the calibration's unit."""
    return floats(_unmapped(calibration) @ disturbance.per_unit)


def _unmapped(calibration: Calibration) -> Floats:
    """(3, 3) Pᵀ, from the axes of the calibration to those of the recording."""
    return calibration.axes.apply(np.eye(3))


def acting(acts: Acts, calibration: Calibration) -> Acts:
    """In which axes a target works, in those of this recording: after the mounting is as recorded for a vehicle's."""
    return "recorded" if acts == "mapped" and calibration.frame == VEHICLE else acts


def refuse_mounted(calibration: Calibration, *, who: str) -> None:
    """Refuse a calibration of readings in the axes of the vehicle for what corrects them before the mounting.

    Raises
    ------
    NotExportable
    """
    if calibration.frame == VEHICLE:
        raise NotExportable(
            f"the calibration is for readings in the axes of the vehicle, and {who} corrects them before the mounting, "
            "in the sensor's own axes: the numbers would be wrong wherever the sensor is turned. Calibrate from "
            "readings in the sensor's own axes, such as sensor_mag of a PX4 log, or write it for a target that acts "
            "after the mounting (ardupilot) or on readings as recorded (c, json). Where the sensor sits exactly as the "
            'vehicle does, set "frame" to "sensor" in the calibration file',
            beyond=(),
            frame=calibration.frame,
        )


def per_unit(calibration: Calibration, unit: str, *, who: str) -> float:
    """What one of a target's units is, in the unit of the calibration.

    Raises
    ------
    UnitError
        Where the calibration is in counts and the target works in a unit of field, or the other way round.
    """
    if unit == OWN:
        return 1.0
    if unit == RECORDED:
        return calibration.raw.scale
    if unit == COUNTS:
        if calibration.raw.name != COUNTS:
            raise UnitError(
                f"the recording was in {calibration.raw.name}, and {who} works in the raw counts of the sensor: record "
                "these, and calibrate again with --unit counts"
            )
        return calibration.raw.scale
    if calibration.unit == COUNTS:
        raise UnitError(
            f"the calibration is in counts, and {who} works in {unit}: calibrate again with --scale UT (microtesla in "
            "one count, from the sensor's data sheet), or with --unit where the readings have one"
        )
    return PER_UNIT[unit]


def single(values: ArrayLike) -> Floats:
    """Round to single precision.

    >>> float(single(0.1)) - 0.1
    1.49e-09
    """
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(values, np.float32).astype(np.float64)


def symmetric_root(matrix: Floats) -> Floats:
    """(3, 3) the symmetric S of W = R S with a rotation R, for targets that hold six numbers: S = (WᵀW)^½.

    >>> turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    >>> symmetric_root(turn @ np.diag([2.0, 1.0, 0.5])).round(9)
    array([[2. , 0. , 0. ],
           [0. , 1. , 0. ],
           [0. , 0. , 0.5]])
    """
    if np.array_equal(matrix, matrix.T):
        return matrix
    with np.errstate(all="ignore"):
        squares, axes = np.linalg.eigh(matrix.T @ matrix)
        root = (axes * np.sqrt(np.maximum(squares, 0))) @ axes.T
    return floats((root + root.T) / 2)


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


def whole(values: Floats, names: Sequence[str], *, lowest: int, highest: int, advice: str) -> tuple[int, ...]:
    """Round to whole numbers, half to even, that a register or setting can hold.

    Raises
    ------
    NotExportable
        For those beyond its range: names them, with what they would be.

    Examples
    --------
    >>> whole(np.array([1.4, -2.6]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
    (1, -3)
    >>> whole(np.array([1.4, -9.0]), ["x", "y"], lowest=-8, highest=7, advice="turn back")
    Traceback (most recent call last):
    flinders.errors.NotExportable: y would be -9 and holds -8 to 7: turn back
    """
    rounded = np.rint(values)
    beyond = [index for index, value in enumerate(rounded) if not lowest <= value <= highest]
    if beyond:
        refusals = [
            f"{names[index]} would be {rounded[index]:,.6g} and holds {lowest} to {highest}" for index in beyond
        ]
        raise NotExportable(
            f"{'; '.join(refusals)}: {advice}",
            beyond=[names[index] for index in beyond],
            wanted={names[index]: float(values[index]) for index in beyond},
        )
    return tuple(int(value) for value in rounded)


def offset_and_radii(calibration: Calibration, *, who: str) -> tuple[Floats, Floats]:
    """(3,) offset and (3,) radii in counts, in the axes as recorded; soft iron off the diagonal is left out.

    A radius is what an axis reads along the field: with D the diagonal that comes nearest to the matrix and F the
    length of corrected readings, F / D.

    >>> board = Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0)
    >>> offset, radii = offset_and_radii(board, who="a board")
    >>> radii
    array([320., 400., 500.])
    >>> of_radii(offset, radii).isclose(board)
    True
    """
    affine = Affine.of(calibration, COUNTS, who=who)
    with np.errstate(all="ignore"):
        return affine.offset, affine.strength / nearest_diagonal(affine.matrix)


def of_radii(offset: Sequence[float] | Floats, radii: Floats, strength: float | None = None) -> Calibration:
    """The calibration of readings in counts that offset and radii stand for.

    Radii alone tell no `strength` F, in counts: without one it is their geometric mean, where D has determinant 1.
    """
    length = float(np.exp(np.mean(np.log(radii)))) if strength is None else strength
    return Affine(np.diag(length / radii), floats(offset), length).to_calibration(COUNTS, known=strength is not None)


def in_16_bits(values: Floats, names: Sequence[str], *, lowest: int = -(2**15)) -> tuple[int, ...]:
    """Round to whole counts that an int16 holds; others raise `NotExportable`."""
    advice = "take away or demagnetise what is near the sensor, and check the unit of the recording"
    return whole(values, names, lowest=lowest, highest=2**15 - 1, advice=advice)
