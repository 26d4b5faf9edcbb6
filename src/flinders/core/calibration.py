"""The calibration of a magnetometer: a value that corrects readings and can be inverted, composed, saved and loaded.

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
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypeVar, get_args, overload

import numpy as np
from msgspec import to_builtins

from flinders.arrays import (
    Floats,
    Value,
    check_matrix,
    check_positive,
    check_triple,
    check_vectors,
    four_digits,
    read_only_copy,
    to_floats,
)
from flinders.core.above import UPPER_FUNCTIONS
from flinders.core.axes import Axes
from flinders.core.calibration_file import (
    Correction,
    Document,
    Fitted,
    LinearizationRecord,
    ProvenanceRecord,
    Recorded,
    Rotation,
    read,
    write,
)
from flinders.core.calibration_parts import (
    calibration_arguments,
    disturbance_records,
    refuse_disturbances,
    refuse_linearization,
)
from flinders.core.disturbance import (
    Disturbance,
    check_disturbances,
    have_equal_disturbances,
    kind_of,
    shift_and_gain,
    values_by_name,
)
from flinders.core.frames import is_frame
from flinders.core.linearization import have_equal_linearization
from flinders.core.notebook import correction_html
from flinders.core.symmetric_matrix import check_invertible, check_symmetric, is_positive_definite
from flinders.core.units import Unit, unit_label
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError, UsageError
from flinders.geometry.angles import deflection_deg
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.core.frames import HasColumns
    from flinders.core.linearization import Linearization

UNKNOWN_UNIT: Final = Unit.of()
RECORDED_AXES: Final = Axes()
Frame = TypeVar("Frame", bound="HasColumns | Mapping[Any, Any]")
ROTATIONS: Final = get_args(Rotation)


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Value):
    """``corrected = matrix @ (raw - offset)``, and ``|corrected| = field_strength``.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, a singular matrix, or a matrix that is not symmetric
        although `rotation` is ``symmetric``.
    UsageError
        For a field strength that is not a positive number, or a value of `rotation` that is not known.
    """

    matrix: Floats  #: (3, 3), dimensionless: soft iron and scale; read-only
    offset: Floats  #: (3,), in `unit`, mapped axes: hard iron, the reading in zero field; read-only
    field_strength: float  #: in `unit`: length of corrected readings
    #: whether the field strength was given; otherwise it follows from a matrix of determinant 1
    field_strength_known: bool = False
    #: an ellipsoid determines the matrix only up to a rotation on the left. ``symmetric``: the symmetric matrix,
    #: by convention; ``estimated``: the fit determined the rotation; ``composed``: a product or inverse.
    rotation: Rotation = "symmetric"
    raw: Unit = UNKNOWN_UNIT  #: the unit the recording was written in; ``raw.inside`` is the unit of the calibration
    axes: Axes = RECORDED_AXES  #: mapping of the recorded axes before `apply`
    sensor: str | None = None  #: name or serial number
    #: frame of the recorded axes: ``sensor``; or ``vehicle`` if the logger rotated the readings by the mounting of the
    #: sensor. `axes` maps either of them.
    frame: str = "sensor"
    #: quantities that the offset follows: a current, a throttle, a temperature, any column of a log. A quantity with
    #: the value c adds P (c - reference) to the offset. A temperature T also scales the field by
    #: 1 + a (T - reference): ``corrected = matrix @ (raw - offset - Σ P (c - reference)) / (1 + a (T - reference))``.
    disturbances: tuple[Disturbance, ...] = ()
    #: correction of nonlinear axes, None for linear ones: ``matrix @ linearization.apply(raw - offset)``
    linearization: Linearization | None = None

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        if self.rotation not in ROTATIONS:
            raise UsageError(f"rotation is {self.rotation!r}: need one of {', '.join(ROTATIONS)}")
        object.__setattr__(self, "matrix", read_only_copy(check_invertible(self.matrix, self.rotation)))
        object.__setattr__(self, "offset", read_only_copy(check_triple(self.offset, "offset")))
        object.__setattr__(self, "field_strength", check_positive(self.field_strength, "field_strength"))
        if self.disturbances:
            object.__setattr__(self, "disturbances", check_disturbances(self.disturbances))

    @classmethod
    def identity(
        cls,
        *,
        field_strength: float = 1.0,
        raw: Unit = UNKNOWN_UNIT,
        axes: Axes = RECORDED_AXES,
        sensor: str | None = None,
    ) -> Calibration:
        """The calibration that changes no reading, as the start of a chain of calibrations.

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
        raw: Unit = UNKNOWN_UNIT,
        axes: Axes = RECORDED_AXES,
        sensor: str | None = None,
        frame: str = "sensor",
    ) -> Calibration:
        """Make the calibration that maps an ellipsoid of readings to a sphere.

        Raises `ArrayError` unless `shape` is symmetric and positive definite; `UsageError` for a field strength that is
        not positive.

        Parameters
        ----------
        centre : (3,) in ``raw.inside``
            Middle of the ellipsoid.
        shape : (3, 3) in ``raw.inside``
            Symmetric, positive definite; maps unit directions to readings: ``raw = centre + shape @ direction``.
        field_strength : float, optional, in ``raw.inside``
            F, if known: ``matrix = F shape⁻¹``. Otherwise the matrix has determinant 1, and F is the geometric mean
            of the radii (NXP AN4246; MotionCal; MATLAB's magcal).
        raw, axes, sensor, frame
            As the attributes of the same names.

        Examples
        --------
        >>> found = Calibration.from_ellipsoid([-50, 20, 100], np.diag([30.0, 20.0, 50.0]))        # as MATLAB's magcal
        >>> round(found.field_strength, 4), np.diag(found.matrix).round(5)
        (31.0723, array([1.03574, 1.55362, 0.62145]))
        """
        array = check_symmetric(check_matrix(shape, "shape"), "shape")
        ellipsoid = Ellipsoid(check_vectors(centre, "centre"), (array + array.T) / 2)
        if not ellipsoid.semi_axes[0] > 0.0:
            radii = np.array2string(ellipsoid.semi_axes, precision=4)
            raise ArrayError(f"shape has radii {radii}: all three must be positive")
        known = field_strength is not None
        strength = check_positive(field_strength, "field_strength") if known else ellipsoid.radius
        inverse = strength * to_floats(np.linalg.inv(ellipsoid.shape))
        inverse = (inverse + inverse.T) / 2.0 + 0.0  # no zero is negative
        made = cls(inverse, ellipsoid.centre, strength, known, raw=raw, axes=axes, sensor=sensor, frame=frame)
        vars(made)["ellipsoid"] = ellipsoid
        return made

    @property
    def unit(self) -> str:
        """Unit of readings, offset and field strength: ``uT``, or ``counts`` if no scale is known."""
        return self.raw.inside

    @property
    def shape(self) -> Floats:
        """(3, 3), in `unit`: maps unit directions of the field to readings about the offset, ``F matrix⁻¹``."""
        return self.field_strength * to_floats(np.linalg.inv(self.matrix))

    @cached_property
    def ellipsoid(self) -> Ellipsoid:
        """Ellipsoid on which raw readings of a constant field lie; it does not depend on the calibration's rotation."""
        shape = self.shape
        if self.rotation == "symmetric" and is_positive_definite(shape):
            return Ellipsoid(self.offset, (shape + shape.T) / 2.0)
        squares, axes = np.linalg.eigh(shape @ shape.T)
        return Ellipsoid(self.offset, (axes * np.sqrt(squares)) @ axes.T)

    @property
    def rotation_matrix(self) -> Floats:
        """(3, 3) rotation from the magnetometer's own axes to those of corrected readings.

        It is the identity if `matrix` is symmetric.
        """
        left, _, right = np.linalg.svd(self.matrix @ self.ellipsoid.shape / self.field_strength)  # rounding off
        turned: Floats = left @ right
        return turned

    @property
    def is_affine(self) -> bool:
        """Whether the calibration has only `matrix` and `offset`: no disturbance, no linearization."""
        return not self.disturbances and self.linearization is None

    @property
    def affine(self) -> Calibration:
        """Matrix and offset alone, for readings that `flinders.core.compensation` has compensated."""
        return self if self.is_affine else replace(self, disturbances=(), linearization=None)

    @property
    def is_identity(self) -> bool:
        """Whether the calibration leaves each reading unchanged."""
        return bool(self.is_affine and not self.offset.any() and np.array_equal(self.matrix, np.eye(3)))

    @property
    def inv(self) -> Calibration:
        """The inverse, from corrected to raw readings; `UsageError` if the offset follows a disturbance.

        The field strength of the inverse is the geometric mean of the radii of the raw ellipsoid, so that ``c.inv.inv``
        is ``c``.

        >>> there = Calibration(np.diag([2.0, 1.0, 0.5]), [10, 0, -10], 50.0, raw=Unit.of("uT"))
        >>> there.inv.apply(there.apply([1.0, 2.0, 3.0]))
        array([1., 2., 3.])
        """
        refuse_disturbances(self.disturbances, "be inverted")
        refuse_linearization(self.linearization, "be inverted")
        radius = self.field_strength * float(np.exp(-np.linalg.slogdet(self.matrix)[1] / 3))
        return Calibration(
            to_floats(np.linalg.inv(self.matrix)),
            -self.matrix @ self.offset,
            radius,
            self.field_strength_known,
            "composed",
            raw=Unit.of(self.unit),
            sensor=self.sensor,
            frame=self.frame,
        )

    @overload
    def apply(
        self,
        raw: Frame,
        *,
        columns: str | Sequence[str | int] | None = None,
        heading: bool = False,
        level: bool = False,
    ) -> Frame: ...
    @overload
    def apply(self, raw: ArrayLike, **disturbances: ArrayLike | None) -> Floats: ...
    def apply(  # type: ignore[misc]  # no disturbance is called like an option of a frame
        self,
        raw: Any,
        *,
        current: ArrayLike | None = None,
        throttle: ArrayLike | None = None,
        temperature: ArrayLike | None = None,
        columns: str | Sequence[str | int] | None = None,
        heading: bool = False,
        level: bool = False,
        **others: ArrayLike | None,
    ) -> Any:
        """Correct readings, or the magnetometer's columns of a data frame.

        Raises `ArrayError` for a wrong shape, or values that are not numbers; `UsageError` if the values of a
        disturbance are missing. For a frame also the errors of `flinders.apply` and `flinders.headings`.

        Parameters
        ----------
        raw : (..., 3) in `unit`, or data frame
            Raw readings in mapped axes (see `axes`); a reading with a NaN gives NaN. A frame has the unit and axes of
            the recording, and a column for each disturbance.
        current, throttle, temperature : (...), A, 0 to 1 and °C, optional
            Values of the `disturbances`; for a disturbance with a lag, the values that were recorded the lag before
            each reading. Values that the calibration does not need are ignored.
        **others : (...) or (..., M)
            Values for each motor if each has an offset of its own: ``current1``, …, or all M motors together as
            ``currents`` or ``throttles``; and other columns by their names in the log, ``**{"BAT.Curr": values}``, of
            numbers or of the two words of a state.

        columns : str or sequence of str or int, optional
            The magnetometer's columns of a frame, ``["mx", "my", "mz"]``, if their names are not recognised.
        heading, level : bool
            Add a column ``heading_deg`` to a frame: magnetic headings in degrees. `heading` removes the tilt by the
            accelerations of the frame; `level` uses x and y alone.

        Returns
        -------
        (..., 3) in `unit`
            Corrected readings, of length `field_strength` in the undisturbed field of the earth. For a frame, a copy of
            the same type with the corrected field in the same columns and unit; NaN in rows without a valid reading.

        Examples
        --------
        >>> centred = Calibration(np.eye(3), [10, 20, 30], 50.0)
        >>> centred.apply([[10, 20, 80], [60, 20, 30]])
        array([[ 0.,  0., 50.],
               [50.,  0.,  0.]])
        >>> flown = replace(centred, disturbances=(Disturbance("current", [0.5, 0.0, 0.0], highest=20.0),))
        >>> flown.apply([15, 20, 80], current=10.0)                 # the motors add 0.5 µT for each ampere
        array([ 0.,  0., 50.])
        """
        given = {"current": current, "throttle": throttle, "temperature": temperature, **others}
        if is_frame(raw):
            return UPPER_FUNCTIONS["correct_frame"](
                self, raw, columns=columns, heading=heading, level=level, given=given
            )
        if columns is not None or heading or level:
            raise UsageError("an array has no named columns: to name columns or add headings, give a data frame")
        shift, gain = self._effect(**given)
        with np.errstate(invalid="ignore", over="ignore"):  # infinite readings become NaN
            readings = check_vectors(raw, "raw", finite=False)
            if self.is_affine:
                return (readings - self.offset) @ self.matrix.T
            departures = readings - self.offset - shift
            linear = departures if self.linearization is None else self.linearization.apply(departures)
            corrected: Floats = linear @ self.matrix.T / gain[..., np.newaxis]
            return corrected

    def unapply(
        self,
        corrected: ArrayLike,
        *,
        current: ArrayLike | None = None,
        throttle: ArrayLike | None = None,
        temperature: ArrayLike | None = None,
        **others: ArrayLike | None,
    ) -> Floats:
        """Compute the (..., 3) raw readings that `apply` would correct to these fields, in `unit`.

        Values of disturbances are given as in `apply`.

        >>> Calibration(np.diag([2.0, 1.0, 0.5]), [10, 20, 30], 50.0).unapply([0, 0, 50])
        array([ 10.,  20., 130.])
        """
        shift, gain = self._effect(current=current, throttle=throttle, temperature=temperature, **others)
        with np.errstate(invalid="ignore", over="ignore"):
            field = check_vectors(corrected, "corrected", finite=False) @ np.linalg.inv(self.matrix).T
            if self.is_affine:
                return field + self.offset
            linear = field * gain[..., np.newaxis]
            departures = linear if self.linearization is None else self.linearization.invert(linear)
            raw: Floats = departures + self.offset + shift
            return raw

    def _effect(self, **given: ArrayLike | None) -> tuple[Floats, Floats]:
        """Shift of raw readings (..., 3), in `unit`, and factor of the earth's field (...), by the disturbances."""
        if not self.disturbances and all(values is None for values in given.values()):
            return np.zeros(3), np.ones(())
        return shift_and_gain(self.disturbances, values_by_name(self.disturbances, **given))

    def at(self, **values: float | str) -> Calibration:
        """The calibration at fixed values of its disturbances, as one that follows no disturbance.

        A disturbance without a given value is at its reference.

        Raises `UsageError` for the value of a disturbance that the calibration does not follow.

        >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
        >>> Calibration(np.eye(3), [10, 20, 30], 50.0, disturbances=(motors,)).at(current=10.0).offset
        array([15., 20., 30.])
        """
        return replace(self.hold_values(**values), disturbances=()) if self.disturbances or values else self

    def hold_values(self, **values: float | str) -> Calibration:
        """The calibration at fixed values of some of its disturbances; the other disturbances stay.

        Raises `UsageError` for a disturbance that the calibration does not follow, or a value that is not a number.
        """
        ours = {disturbance.name: disturbance for disturbance in self.disturbances}
        for name, value in values.items():
            kind_of(name)
            if name not in ours:
                raise UsageError(
                    f"the calibration does not depend on {name}, only on {', '.join(ours) or 'the readings'}: leave "
                    f"{name} out"
                )
            if not np.isfinite(ours[name].numbers(value)):
                raise UsageError(f"{name} is {value}: need a number")
        fixed = [ours[name] for name in values]
        shift, gain = shift_and_gain(fixed, {name: ours[name].numbers(value) for name, value in values.items()})
        left = tuple(disturbance for disturbance in self.disturbances if disturbance.name not in values)
        return replace(self, offset=self.offset + shift, matrix=self.matrix / float(gain), disturbances=left)

    def disturbance_deg(self, disturbance: Disturbance, value: float | None = None, *, dip_deg: float = 60.0) -> float:
        """Heading error in degrees if a disturbance is not corrected, at the worst attitude and heading.

        `value` is the value of the disturbance; by default the end of its recorded range that is farther from its
        reference. `dip_deg` is the inclination of the field. The result is 180° if the disturbance is stronger than the
        horizontal field.

        >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
        >>> round(Calibration(np.eye(3), [0, 0, 0], 50.0, disturbances=(motors,)).disturbance_deg(motors), 1)
        23.6
        """
        shift = disturbance.shift(disturbance.extreme_value if value is None else value)
        across = float(np.linalg.norm(self.matrix @ shift)) / (self.field_strength * np.cos(np.deg2rad(dip_deg)))
        return deflection_deg(across)

    def __matmul__(self, first: Calibration) -> Calibration:
        """``(b @ a).apply(x) == b.apply(a.apply(x))``: `first` acts first.

        The unit, axes and frame of the product are those of `first`, the field strength is that of `self`. The product
        with an identity is the other calibration.

        Raises `UnitError` if one is in µT and the other in counts. Raises `UsageError` if `self` follows a disturbance,
        if the scale of `first` follows a temperature, or if one of the two linearizes axes.
        """
        if not isinstance(first, Calibration):
            return NotImplemented
        if self.unit != first.unit:
            raise UnitError(
                f"a calibration in {self.unit} cannot be applied after one in {first.unit}: give the scale of counts"
            )
        refuse_disturbances(self.disturbances, "come after another calibration")
        sensor = self.sensor if first.sensor is None else first.sensor
        if self.is_identity:
            return replace(first, sensor=sensor)
        recorded = replace(self, raw=first.raw, axes=first.axes, sensor=sensor)
        if first.is_identity:
            return recorded
        refuse_linearization(self.linearization, "come after another calibration")
        refuse_linearization(first.linearization, "come before another calibration")
        if any(disturbance.gain_per_unit for disturbance in first.disturbances):
            refuse_disturbances(
                first.disturbances, "come before another calibration if its scale follows the temperature"
            )
        return replace(
            recorded,
            matrix=self.matrix @ first.matrix,
            offset=first.offset + np.linalg.solve(first.matrix, self.offset),
            rotation="composed",
            frame=first.frame,
            disturbances=first.disturbances,
        )

    def map_axes(self, axes: Axes) -> Calibration:
        """The same calibration for readings in the mapped axes `axes`: matrix P W Pᵀ and offset P b for a mapping P.

        Raises `AxesError` if the calibration is for mapped readings already.

        >>> centred = Calibration(np.eye(3), [10, 20, 30], 50.0).map_axes(Axes.of("y,x,-z"))
        >>> centred.offset, str(centred.axes)
        (array([ 20.,  10., -30.]), 'y,x,-z')
        """
        if axes == self.axes:
            return self
        if not self.axes.is_identity:
            raise AxesError(f"the calibration is for axes {self.axes} already: give one mapping from the recorded axes")
        turn = axes.apply(np.eye(3)).T
        disturbances = tuple(replace(each, per_unit=turn @ each.per_unit) for each in self.disturbances)
        matrix, offset = turn @ self.matrix @ turn.T, turn @ self.offset
        return replace(self, matrix=matrix, offset=offset, axes=axes, disturbances=disturbances)

    def isclose(self, other: Calibration, *, tolerance: float = 1e-9) -> bool:
        """Whether two calibrations in the same unit and axes correct alike, within `tolerance` as a share of the field.

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
            and have_equal_disturbances(self.disturbances, other.disturbances, tolerance * field)
            and have_equal_linearization(self.linearization, other.linearization, self.shape, tolerance * field)
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Read a calibration file; raises `DocumentError` if it cannot be opened or parsed."""
        return cls.from_document(read(path), source=str(path))

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write a calibration file, whole or not at all; `load` reads back the same numbers to the bit.

        Raises `OutputExists` if the file exists, unless `force`; `OutputError` if it cannot be written.
        """
        write(self.to_document(), path, force=force)

    @classmethod
    def from_document(cls, document: Document, *, source: str = "calibration") -> Calibration:
        """Make the calibration of the content of a calibration file; `source` names the file in messages.

        Raises `DocumentError` for parts that contradict each other, or a singular matrix.
        """
        try:
            return cls(**calibration_arguments(document.calibration, document.raw))
        except (ArrayError, UnitError, AxesError, UsageError) as error:
            raise DocumentError(f"{source}: {error.message}", hint=error.hint, **error.evidence) from None

    def to_document(self, *, fit: Fitted | None = None, provenance: ProvenanceRecord | None = None) -> Document:
        """Make the content of a calibration file, with the record of its fit and its provenance if given."""
        rows, offset = map(tuple, self.matrix.tolist()), self.offset.tolist()
        content: dict[str, Any] = {**self.as_dict(), "matrix": tuple(rows), "offset": tuple(offset)}
        content |= {
            kind: group for kind, group in disturbance_records(self.disturbances).items() if content.pop(kind, None)
        }
        if terms := content.pop("linearization", None):
            content["linearization"] = LinearizationRecord(**{name: tuple(term) for name, term in terms.items()})
        unit: Any = self.raw.name  # a unit that the schema does not allow is refused when the document is written
        raw = Recorded(unit=unit, scale=self.raw.scale, axes=str(self.axes), sensor=self.sensor, frame=self.frame)
        return Document(calibration=Correction(**content), raw=raw, fit=fit, provenance=provenance)

    def as_dict(self) -> dict[str, object]:
        """Give the correction as plain numbers, lists and strings, ready for JSON.

        >>> Calibration.identity(field_strength=48).as_dict()["offset"]
        [0.0, 0.0, 0.0]
        """
        follows = {kind: to_builtins(group) for kind, group in disturbance_records(self.disturbances).items() if group}
        terms = {} if self.linearization is None else self.linearization.as_dict()
        return {
            "offset": self.offset.tolist(),
            "matrix": self.matrix.tolist(),
            "field_strength": self.field_strength,
            "field_strength_known": self.field_strength_known,
            "unit": self.unit,
            "rotation": self.rotation,
            **follows,
            **({"linearization": terms} if terms else {}),
        }

    def __repr__(self) -> str:
        rows = ", ".join(map(four_digits, self.matrix))
        strength = f"{self.field_strength:.4g} {self.unit}" + ", scale unknown" * (not self.field_strength_known)
        follows = "".join(f", follows {disturbance.name}" for disturbance in self.disturbances)
        follows += ", linearizes axes" if self.linearization is not None else ""
        offset = f"{four_digits(self.offset)} {self.unit}"
        parts = f"offset={offset}, matrix=[{rows}], field_strength={strength}, rotation {self.rotation}{follows}"
        return f"Calibration({parts})"

    def _repr_html_(self) -> str:
        """HTML of the calibration for a notebook."""
        unit = unit_label(self.unit)
        length = f"corrected readings have length {self.field_strength:.4g} {unit}"
        length += "; no field strength was given" * (not self.field_strength_known)
        title = "Calibration" if self.sensor is None else f"Calibration of {self.sensor}"
        words = (length, *(f"the offset follows {disturbance}" for disturbance in self.disturbances))
        terms = None if self.linearization is None else self.linearization.as_dict()
        return correction_html(self.matrix.tolist(), self.offset.tolist(), unit, title=title, words=words, terms=terms)
