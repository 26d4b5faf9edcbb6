"""A calibration is a value: it corrects readings, can be inverted, composed, saved and loaded.

>>> tilted = Calibration.from_ellipsoid(centre=[-50, 20, 100], shape=np.diag([30.0, 20.0, 50.0]), raw=Unit.of("uT"))
>>> tilted
Calibration(offset=[-50, 20, 100] uT, matrix=[[1.036, 0, 0], [0, 1.554, 0], [0, 0, 0.6214]], \
field_strength=31.07 uT, scale unknown, rotation symmetric)
>>> reading = [-50, 20, 150]                           # straight up, 50 µT above the centre
>>> tilted.apply(reading).round(4)
array([ 0.    ,  0.    , 31.0723])
>>> (tilted.inv @ tilted).apply(reading).round(4)
array([-50.,  20., 150.])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np

from flinders.arrays import Floats, floats, matrix, vectors
from flinders.axes import Axes
from flinders.document import Correction, Document, Fitted, Provenance, Recorded, Rotation, read, write
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError, UsageError
from flinders.units import COUNTS, MICROTESLA, Unit

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike

UNSTATED: Final = Unit.of()
AS_RECORDED: Final = Axes()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Calibration:
    """``corrected = matrix @ (raw - offset)``, and ``|corrected| = field_strength``.

    Attributes
    ----------
    matrix : (3, 3) float, dimensionless
        Soft iron and scale; read-only.
    offset : (3,) float, in `unit`
        Hard iron, in mapped axes: what the sensor reads in zero field; read-only.
    field_strength : float, in `unit`
        Length of corrected readings.
    field_strength_known : bool
        It was given; otherwise the matrix has determinant 1, and this is the radius that results.
    rotation : str
        An ellipsoid fixes the matrix only up to a rotation on the left. ``symmetric``: the symmetric matrix
        was taken by convention; ``estimated``: the fit saw the rotation; ``composed``: a product or inverse.
    raw : Unit
        The unit the recording was written in; ``raw.inside`` is the unit of the calibration.
    axes : Axes
        How recorded axes are turned before `apply`.
    sensor : str, optional
        Name or serial number.
    frame : str
        What the recorded axes are: ``sensor``, its own; or ``vehicle``, which readings were turned into, by how the
        sensor is mounted, before they were logged. `axes` comes after either.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, a singular matrix, or one that is not symmetric
        although `rotation` says so.
    UsageError
        For a field strength that is not a positive number, or a rotation that is not known.
    """

    matrix: Floats
    offset: Floats
    field_strength: float
    field_strength_known: bool = False
    rotation: Rotation = "symmetric"
    raw: Unit = UNSTATED
    axes: Axes = AS_RECORDED
    sensor: str | None = None
    frame: str = "sensor"

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        if self.rotation not in get_args(Rotation):
            raise UsageError(f"rotation is {self.rotation!r}: need one of {', '.join(get_args(Rotation))}")
        object.__setattr__(self, "matrix", _frozen(_invertible(self.matrix, self.rotation)))
        object.__setattr__(self, "offset", _frozen(_triple(self.offset, "offset")))
        object.__setattr__(self, "field_strength", _positive(self.field_strength, "field_strength"))

    @classmethod
    def identity(
        cls, *, field_strength: float = 1.0, raw: Unit = UNSTATED, axes: Axes = AS_RECORDED, sensor: str | None = None
    ) -> Calibration:
        """Change nothing: where a chain of calibrations starts.

        >>> Calibration.identity().apply([1.0, 2.0, 3.0])
        array([1., 2., 3.])
        """
        return cls(np.eye(3), np.zeros(3), field_strength, raw=raw, axes=axes, sensor=sensor)

    @classmethod
    def from_ellipsoid(
        cls,
        centre: ArrayLike,
        shape: ArrayLike,
        *,
        field_strength: float | None = None,
        raw: Unit = UNSTATED,
        axes: Axes = AS_RECORDED,
        sensor: str | None = None,
        frame: str = "sensor",
    ) -> Calibration:
        """Turn an ellipsoid of readings into the sphere it should have been.

        Parameters
        ----------
        centre : (3,) in ``raw.inside``
            Middle of the ellipsoid.
        shape : (3, 3) in ``raw.inside``
            Symmetric, positive definite; maps unit directions to readings: ``raw = centre + shape @ direction``.
        field_strength : float, optional, in ``raw.inside``
            F, where it is known: ``matrix = F shape⁻¹``. Where it is not, the matrix has determinant 1, which
            makes F the geometric mean of the radii (NXP AN4246; MotionCal; MATLAB's magcal).
        raw, axes, sensor, frame
            How the readings were recorded, as the attributes of the same name.

        Raises
        ------
        ArrayError
            Unless `shape` is symmetric and positive definite.
        UsageError
            For a field strength that is not positive.

        Examples
        --------
        The example of MATLAB's ``magcal``: 31.0723 = (30 · 20 · 50)^⅓.

        >>> found = Calibration.from_ellipsoid([-50, 20, 100], np.diag([30.0, 20.0, 50.0]))
        >>> round(found.field_strength, 4), np.diag(found.matrix).round(5)
        (31.0723, array([1.03574, 1.55362, 0.62145]))
        """
        radii, directions = np.linalg.eigh(_symmetric(matrix(shape, "shape"), "shape"))
        if radii[0] <= 0:
            raise ArrayError(f"shape has radii {np.array2string(radii, precision=4)}: all three must be positive")
        known = field_strength is not None
        strength = _positive(field_strength, "field_strength") if known else float(np.exp(np.log(radii).mean()))
        inverse = (directions * (strength / radii)) @ directions.T
        inverse = (inverse + inverse.T) / 2
        return cls(inverse, vectors(centre, "centre"), strength, known, raw=raw, axes=axes, sensor=sensor, frame=frame)

    @property
    def unit(self) -> str:
        """Unit of readings, offset and field strength: ``uT``, or ``counts`` where no scale is known."""
        return self.raw.inside

    @property
    def shape(self) -> Floats:
        """(3, 3), in `unit`: maps unit directions of the field to readings about the offset, ``F matrix⁻¹``."""
        return self.field_strength * floats(np.linalg.inv(self.matrix))

    @property
    def is_identity(self) -> bool:
        """Readings come out as they go in."""
        return bool(not self.offset.any() and np.array_equal(self.matrix, np.eye(3)))

    @property
    def inv(self) -> Calibration:
        """The way back, from corrected readings to raw ones.

        Its field strength is the geometric mean of the radii of the raw ellipsoid, so that ``c.inv.inv`` is ``c``.

        >>> there = Calibration(np.diag([2.0, 1.0, 0.5]), [10, 0, -10], 50.0, raw=Unit.of("uT"))
        >>> there.inv.apply(there.apply([1.0, 2.0, 3.0]))
        array([1., 2., 3.])
        """
        radius = self.field_strength * float(np.exp(-np.linalg.slogdet(self.matrix)[1] / 3))
        return Calibration(
            floats(np.linalg.inv(self.matrix)),
            -self.matrix @ self.offset,
            radius,
            self.field_strength_known,
            "composed",
            raw=Unit.of(self.unit),
            sensor=self.sensor,
            frame=self.frame,
        )

    def apply(self, raw: ArrayLike) -> Floats:
        """Correct readings.

        Parameters
        ----------
        raw : (..., 3) in `unit`
            Raw readings in mapped axes (see `axes`); a reading with NaN in it comes out as NaN.

        Returns
        -------
        (..., 3) in `unit`
            Of length `field_strength` where only the earth's field was there.

        Raises
        ------
        ArrayError
            For a wrong shape, or values that are no numbers.

        Examples
        --------
        >>> centred = Calibration(np.eye(3), [10, 20, 30], 50.0)
        >>> centred.apply([[10, 20, 80], [60, 20, 30]])
        array([[ 0.,  0., 50.],
               [50.,  0.,  0.]])
        """
        with np.errstate(invalid="ignore", over="ignore"):  # infinite readings become NaN
            return (vectors(raw, "raw", finite=False) - self.offset) @ self.matrix.T

    def unapply(self, corrected: ArrayLike) -> Floats:
        """Tell what the sensor reads in a field: (..., 3) in `unit` to (..., 3) in `unit`.

        >>> Calibration(np.diag([2.0, 1.0, 0.5]), [10, 20, 30], 50.0).unapply([0, 0, 50])
        array([ 10.,  20., 130.])
        """
        with np.errstate(invalid="ignore", over="ignore"):
            return vectors(corrected, "corrected", finite=False) @ np.linalg.inv(self.matrix).T + self.offset

    def __matmul__(self, first: Calibration) -> Calibration:
        """``(b @ a).apply(x) == b.apply(a.apply(x))``: `first` acts first.

        The recording's unit, axes and frame are those of `first`, the field strength is that of `self`; an identity
        leaves the other as it is.

        Raises
        ------
        UnitError
            Where one is in µT and the other in counts.
        """
        if not isinstance(first, Calibration):
            return NotImplemented
        if self.unit != first.unit:
            raise UnitError(f"a calibration in {self.unit} cannot follow one in {first.unit}: give the scale of counts")
        sensor = self.sensor if first.sensor is None else first.sensor
        if self.is_identity:
            return replace(first, sensor=sensor)
        recorded = replace(self, raw=first.raw, axes=first.axes, sensor=sensor)
        if first.is_identity:
            return recorded
        return replace(
            recorded,
            matrix=self.matrix @ first.matrix,
            offset=first.offset + np.linalg.solve(first.matrix, self.offset),
            rotation="composed",
            frame=first.frame,
        )

    def isclose(self, other: Calibration, *, tolerance: float = 1e-9) -> bool:
        """Whether both correct alike, in the same unit and axes: within `tolerance` as a fraction of the field.

        >>> once = Calibration(np.eye(3), [10, 20, 30], 50.0)
        >>> once.isclose(Calibration(np.eye(3), [10, 20, 30.4], 50.0), tolerance=0.01)
        True
        """
        field, gain = self.field_strength, float(np.abs(self.matrix).max())
        return (
            (self.unit, self.axes) == (other.unit, other.axes)
            and abs(field - other.field_strength) <= tolerance * field
            and bool(np.abs(self.offset - other.offset).max() <= tolerance * field)
            and bool(np.abs(self.matrix - other.matrix).max() <= tolerance * gain)
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Read a calibration file.

        Raises
        ------
        DocumentError
            For a file that cannot be opened or understood; says what is wrong, in one line.
        """
        return cls.from_document(read(path), source=str(path))

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write a calibration file, whole or not at all; `load` reads back the same numbers to the bit.

        Raises
        ------
        OutputExists
            Where there is a file already, unless `force`.
        OutputError
            Where it cannot be written.
        """
        write(self.to_document(), path, force=force)

    @classmethod
    def from_document(cls, document: Document, *, source: str = "calibration") -> Calibration:
        """Take the correction out of a calibration file; `source` names it in messages.

        Raises
        ------
        DocumentError
            Where its parts contradict each other or the matrix is singular.
        """
        correction, raw = document.calibration, document.raw
        try:
            return cls(
                np.array(correction.matrix),
                np.array(correction.offset),
                correction.field_strength,
                correction.field_strength_known,
                correction.rotation,
                _recorded_unit(raw, correction.unit),
                Axes.of(raw.axes),
                raw.sensor,
                raw.frame,
            )
        except (ArrayError, UnitError, AxesError) as error:
            raise DocumentError(f"{source}: {error}") from None

    def to_document(self, *, fit: Fitted | None = None, provenance: Provenance | None = None) -> Document:
        """Make the content of a calibration file, with how it was found where that is known."""
        rows, offset = map(tuple, self.matrix.tolist()), self.offset.tolist()
        content: dict[str, Any] = {**self.as_dict(), "matrix": tuple(rows), "offset": tuple(offset)}
        unit: Any = self.raw.name  # whatever the schema does not allow is refused when the document is written
        raw = Recorded(unit=unit, scale=self.raw.scale, axes=str(self.axes), sensor=self.sensor, frame=self.frame)
        return Document(calibration=Correction(**content), raw=raw, fit=fit, provenance=provenance)

    def as_dict(self) -> dict[str, object]:
        """Give the correction as plain numbers, lists and strings, ready for JSON.

        >>> Calibration.identity(field_strength=48).as_dict()["offset"]
        [0.0, 0.0, 0.0]
        """
        return {
            "offset": self.offset.tolist(),
            "matrix": self.matrix.tolist(),
            "field_strength": self.field_strength,
            "field_strength_known": self.field_strength_known,
            "unit": self.unit,
            "rotation": self.rotation,
        }

    def __repr__(self) -> str:
        rows = ", ".join(map(_short, self.matrix))
        strength = f"{self.field_strength:.4g} {self.unit}" + ", scale unknown" * (not self.field_strength_known)
        return (
            f"Calibration(offset={_short(self.offset)} {self.unit}, matrix=[{rows}], "
            f"field_strength={strength}, rotation {self.rotation})"
        )


def _invertible(values: ArrayLike, rotation: Rotation) -> Floats:
    """Let through a matrix that has an inverse, and is symmetric where `rotation` says so."""
    array = matrix(values)
    if np.linalg.matrix_rank(array) < 3:
        raise ArrayError("matrix is singular: it would flatten all readings into a plane, and has no inverse")
    if rotation == "symmetric":
        _symmetric(array, "matrix", "; say rotation='estimated' or 'composed' if that is meant")
    return array


def _symmetric(array: Floats, name: str, advice: str = "") -> Floats:
    """Let through a matrix that equals its transpose to within a millionth."""
    lack = float(np.abs(array - array.T).max())
    if lack > 1e-6 * np.abs(array).max():
        raise ArrayError(f"{name} is not symmetric: entries across the diagonal differ by up to {lack:.3g}{advice}")
    return array


def _triple(values: ArrayLike, name: str) -> Floats:
    """Let through three finite numbers."""
    array = vectors(values, name)
    if array.shape != (3,):
        raise ArrayError(f"{name} has shape {array.shape}: need (3,)")
    return array


def _positive(value: ArrayLike | None, name: str) -> float:
    """Let through one positive finite number."""
    number = floats(0.0 if value is None else value, name)
    if number.shape != () or not (np.isfinite(number) and number > 0):
        raise UsageError(f"{name} is {number}: need one positive number")
    return float(number)


def _frozen(array: Floats) -> Floats:
    """Copy an array and make the copy read-only."""
    copy = array.copy()
    copy.flags.writeable = False
    return copy


def _recorded_unit(raw: Recorded, inside: str) -> Unit:
    """Find the recording's unit, which must agree with that of the calibration."""
    unit = Unit.of(raw.unit, raw.scale if (raw.unit, inside) == (COUNTS, MICROTESLA) else None)
    if unit != Unit(raw.unit, raw.scale, inside):
        raise UnitError(
            f"raw.unit {raw.unit!r} with scale {raw.scale:g} and calibration.unit {inside!r} contradict each other: "
            f"one {raw.unit} is {unit.scale:g} {unit.inside}"
        )
    return unit


def _short(row: Floats) -> str:
    """Write a row of numbers with four digits each."""
    return "[" + ", ".join(f"{entry + 0.0:.4g}" for entry in row) + "]"
