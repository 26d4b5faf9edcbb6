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
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypeVar, get_args, overload

import numpy as np
from msgspec import to_builtins

from flinders.arrays import Floats, Value, floats, four_digits, frozen, matrix, positive, triple, vectors
from flinders.core.above import ABOVE
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
from flinders.core.calibration_parts import fields_in, records_of, refuse_disturbances, refuse_linearization
from flinders.core.disturbance import Disturbance, checked, disturbed_alike, effect, known, named
from flinders.core.frames import is_frame
from flinders.core.linearization import bend_alike
from flinders.core.notebook import correction
from flinders.core.symmetric_matrix import invertible, is_positive, symmetric
from flinders.core.units import Unit, label
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError, UsageError
from flinders.geometry.angles import deflection_deg
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from flinders.core.frames import HasColumns
    from flinders.core.linearization import Linearization

UNSTATED: Final = Unit.of()
AS_RECORDED: Final = Axes()
Frame = TypeVar("Frame", bound="HasColumns | Mapping[Any, Any]")
ROTATIONS: Final = get_args(Rotation)


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Value):
    """``corrected = matrix @ (raw - offset)``, and ``|corrected| = field_strength``.

    Raises
    ------
    ArrayError
        For a wrong shape, values that are not finite, a singular matrix, or one that is not symmetric
        although `rotation` says so.
    UsageError
        For a field strength that is not a positive number, or a rotation that is not known.
    """

    matrix: Floats  #: (3, 3), dimensionless: soft iron and scale; read-only
    offset: Floats  #: (3,), in `unit`: hard iron, in mapped axes: what the sensor reads in zero field; read-only
    field_strength: float  #: in `unit`: length of corrected readings
    #: it was given; otherwise the matrix has determinant 1, and this is the radius that results
    field_strength_known: bool = False
    #: an ellipsoid fixes the matrix only up to a rotation on the left. ``symmetric``: the symmetric matrix was taken by
    #: convention; ``estimated``: the fit saw the rotation; ``composed``: a product or inverse.
    rotation: Rotation = "symmetric"
    raw: Unit = UNSTATED  #: the unit the recording was written in; ``raw.inside`` is the unit of the calibration
    axes: Axes = AS_RECORDED  #: how recorded axes are turned before `apply`
    sensor: str | None = None  #: name or serial number
    #: what the recorded axes are: ``sensor``, its own; or ``vehicle``, which readings were turned into, by how the
    #: sensor is mounted, before they were logged. `axes` comes after either.
    frame: str = "sensor"
    #: what the offset follows: a current, a throttle, a temperature, any column of a log. With any of them
    #: ``corrected = matrix @ (raw - offset - Σ P (c - reference)) / (1 + a (T - reference))``.
    disturbances: tuple[Disturbance, ...] = ()
    #: of axes that are not linear: with it ``raw - offset`` becomes ``linearization.apply(raw - offset)``
    linearization: Linearization | None = None

    def __post_init__(self) -> None:
        """Check the numbers and keep read-only copies of them."""
        if self.rotation not in ROTATIONS:
            raise UsageError(f"rotation is {self.rotation!r}: need one of {', '.join(ROTATIONS)}")
        object.__setattr__(self, "matrix", frozen(invertible(self.matrix, self.rotation)))
        object.__setattr__(self, "offset", frozen(triple(self.offset, "offset")))
        object.__setattr__(self, "field_strength", positive(self.field_strength, "field_strength"))
        if self.disturbances:
            object.__setattr__(self, "disturbances", checked(self.disturbances))

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

        Raises `ArrayError` unless `shape` is symmetric and positive definite; `UsageError` for a field strength that is
        not positive.

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

        Examples
        --------
        >>> found = Calibration.from_ellipsoid([-50, 20, 100], np.diag([30.0, 20.0, 50.0]))        # as MATLAB's magcal
        >>> round(found.field_strength, 4), np.diag(found.matrix).round(5)
        (31.0723, array([1.03574, 1.55362, 0.62145]))
        """
        array = symmetric(matrix(shape, "shape"), "shape")
        ellipsoid = Ellipsoid(vectors(centre, "centre"), (array + array.T) / 2)
        if not ellipsoid.semi_axes[0] > 0.0:
            radii = np.array2string(ellipsoid.semi_axes, precision=4)
            raise ArrayError(f"shape has radii {radii}: all three must be positive")
        known = field_strength is not None
        strength = positive(field_strength, "field_strength") if known else ellipsoid.radius
        inverse = strength * floats(np.linalg.inv(ellipsoid.shape))
        inverse = (inverse + inverse.T) / 2.0 + 0.0  # no zero is negative
        made = cls(inverse, ellipsoid.centre, strength, known, raw=raw, axes=axes, sensor=sensor, frame=frame)
        vars(made)["ellipsoid"] = ellipsoid
        return made

    @property
    def unit(self) -> str:
        """Unit of readings, offset and field strength: ``uT``, or ``counts`` where no scale is known."""
        return self.raw.inside

    @property
    def shape(self) -> Floats:
        """(3, 3), in `unit`: maps unit directions of the field to readings about the offset, ``F matrix⁻¹``."""
        return self.field_strength * floats(np.linalg.inv(self.matrix))

    @cached_property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that it makes a sphere, in the magnetometer's own axes: an ellipsoid knows no rotation."""
        shape = self.shape
        if self.rotation == "symmetric" and is_positive(shape):
            return Ellipsoid(self.offset, (shape + shape.T) / 2.0)
        squares, axes = np.linalg.eigh(shape @ shape.T)
        return Ellipsoid(self.offset, (axes * np.sqrt(squares)) @ axes.T)

    @property
    def rotation_matrix(self) -> Floats:
        """(3, 3) from the magnetometer's own axes to those it corrects to; unity where it knows no rotation."""
        left, _, right = np.linalg.svd(self.matrix @ self.ellipsoid.shape / self.field_strength)  # rounding off
        turned: Floats = left @ right
        return turned

    @property
    def is_affine(self) -> bool:
        """It is `matrix` and `offset`, and nothing else: no disturbance, no linearization."""
        return not self.disturbances and self.linearization is None

    @property
    def affine(self) -> Calibration:
        """Matrix and offset alone, for readings that `flinders.core.compensation` has compensated."""
        return self if self.is_affine else replace(self, disturbances=(), linearization=None)

    @property
    def is_identity(self) -> bool:
        """Readings come out as they go in."""
        return bool(self.is_affine and not self.offset.any() and np.array_equal(self.matrix, np.eye(3)))

    @property
    def inv(self) -> Calibration:
        """The way back, from corrected readings to raw ones; `UsageError` where the offset follows a disturbance.

        Its field strength is the geometric mean of the radii of the raw ellipsoid, so that ``c.inv.inv`` is ``c``.

        >>> there = Calibration(np.diag([2.0, 1.0, 0.5]), [10, 0, -10], 50.0, raw=Unit.of("uT"))
        >>> there.inv.apply(there.apply([1.0, 2.0, 3.0]))
        array([1., 2., 3.])
        """
        refuse_disturbances(self.disturbances, "be inverted")
        refuse_linearization(self.linearization, "be inverted")
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

        Raises `ArrayError` for a wrong shape, or values that are no numbers; `UsageError` where a disturbance is not
        given. For a frame what `flinders.apply` and `flinders.headings` raise.

        Parameters
        ----------
        raw : (..., 3) in `unit`, or data frame
            Raw readings in mapped axes (see `axes`); a reading with NaN in it comes out as NaN. A frame is as it was
            recorded: its unit and axes are those of the recording, its disturbances are columns.
        current, throttle, temperature : (...), A, 0 to 1 and °C, optional
            Values of the `disturbances`; of one with a lag those of so much before the reading. What the calibration
            does not ask for is left alone.
        **others : (...) or (..., M)
            The same of each motor, where each has an offset of its own: ``current1``, …, or all of M motors together as
            ``currents`` or ``throttles``; and of other columns by their names in the log, ``**{"BAT.Curr": values}``,
            the words of states among them.

        columns : str or sequence of str or int, optional
            The magnetometer's columns of a frame, ``["mx", "my", "mz"]``, where their names do not say so.
        heading, level : bool
            Add a column ``heading_deg``: magnetic headings, degrees, of a frame with accelerations, which remove the
            tilt; with `level` of x and y alone.

        Returns
        -------
        (..., 3) in `unit`
            Of length `field_strength` where only the earth's field was there. Of a frame a copy of its kind with the
            corrected field in the same columns and unit; NaN where a row is no reading.

        Examples
        --------
        >>> centred = Calibration(np.eye(3), [10, 20, 30], 50.0)
        >>> centred.apply([[10, 20, 80], [60, 20, 30]])
        array([[ 0.,  0., 50.],
               [50.,  0.,  0.]])
        >>> flown = replace(centred, disturbances=(Disturbance("current", [0.5, 0.0, 0.0], highest=20.0),))
        >>> flown.apply([15, 20, 80], current=10.0)                 # motors that add half a microtesla for each ampere
        array([ 0.,  0., 50.])
        """
        given = {"current": current, "throttle": throttle, "temperature": temperature, **others}
        if is_frame(raw):
            return ABOVE["correct_frame"](self, raw, columns=columns, heading=heading, level=level, given=given)
        if columns is not None or heading or level:
            raise UsageError("an array has no names of columns: columns and headings are of a data frame")
        shift, gain = self._effect(**given)
        with np.errstate(invalid="ignore", over="ignore"):  # infinite readings become NaN
            readings = vectors(raw, "raw", finite=False)
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
        """Predict what the sensor reads in a field, (..., 3) in `unit`, with the disturbances of `apply`.

        >>> Calibration(np.diag([2.0, 1.0, 0.5]), [10, 20, 30], 50.0).unapply([0, 0, 50])
        array([ 10.,  20., 130.])
        """
        shift, gain = self._effect(current=current, throttle=throttle, temperature=temperature, **others)
        with np.errstate(invalid="ignore", over="ignore"):
            field = vectors(corrected, "corrected", finite=False) @ np.linalg.inv(self.matrix).T
            if self.is_affine:
                return field + self.offset
            linear = field * gain[..., np.newaxis]
            departures = linear if self.linearization is None else self.linearization.invert(linear)
            raw: Floats = departures + self.offset + shift
            return raw

    def _effect(self, **given: ArrayLike | None) -> tuple[Floats, Floats]:
        """What disturbances of these values add to readings, and what they multiply the field by."""
        if not self.disturbances and all(values is None for values in given.values()):
            return np.zeros(3), np.ones(())
        return effect(self.disturbances, named(self.disturbances, **given))

    def at(self, **values: float | str) -> Calibration:
        """The plain calibration at fixed values of its disturbances, of each that is not given at its reference.

        A value of what is none of its disturbances raises `UsageError`.

        >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
        >>> Calibration(np.eye(3), [10, 20, 30], 50.0, disturbances=(motors,)).at(current=10.0).offset
        array([15., 20., 30.])
        """
        return replace(self.holding(**values), disturbances=()) if self.disturbances or values else self

    def holding(self, **values: float | str) -> Calibration:
        """The calibration at fixed values of some of its disturbances; it goes on following the others.

        A value of what is none of its disturbances, or is no number, raises `UsageError`.
        """
        ours = {disturbance.name: disturbance for disturbance in self.disturbances}
        for name, value in values.items():
            known(name)
            if name not in ours:
                raise UsageError(f"the calibration does not follow {name}: it follows {', '.join(ours) or 'nothing'}")
            if not np.isfinite(ours[name].numbers(value)):
                raise UsageError(f"{name} is {value}: need a number")
        fixed = [ours[name] for name in values]
        shift, gain = effect(fixed, {name: ours[name].numbers(value) for name, value in values.items()})
        left = tuple(disturbance for disturbance in self.disturbances if disturbance.name not in values)
        return replace(self, offset=self.offset + shift, matrix=self.matrix / float(gain), disturbances=left)

    def disturbance_deg(self, disturbance: Disturbance, value: float | None = None, *, dip_deg: float = 60.0) -> float:
        """Heading error, in degrees, of leaving a disturbance out at a value: at the worst attitude and heading.

        By default the value is the end of its recorded range that is farther from its reference. `dip_deg` is the
        inclination of the field: what stands across its level part turns the heading, by 180° where it is stronger.

        >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
        >>> round(Calibration(np.eye(3), [0, 0, 0], 50.0, disturbances=(motors,)).disturbance_deg(motors), 1)
        23.6
        """
        shift = disturbance.shift(disturbance.farthest if value is None else value)
        across = float(np.linalg.norm(self.matrix @ shift)) / (self.field_strength * np.cos(np.deg2rad(dip_deg)))
        return deflection_deg(across)

    def __matmul__(self, first: Calibration) -> Calibration:
        """``(b @ a).apply(x) == b.apply(a.apply(x))``: `first` acts first.

        The recording's unit, axes and frame are those of `first`, the field strength is that of `self`; an identity
        leaves the other as it is.

        Raises `UnitError` where one is in µT and the other in counts; `UsageError` where this one follows a
        disturbance, or the scale of `first` does, or axes are linearized.
        """
        if not isinstance(first, Calibration):
            return NotImplemented
        if self.unit != first.unit:
            raise UnitError(f"a calibration in {self.unit} cannot follow one in {first.unit}: give the scale of counts")
        refuse_disturbances(self.disturbances, "follow another one")
        sensor = self.sensor if first.sensor is None else first.sensor
        if self.is_identity:
            return replace(first, sensor=sensor)
        recorded = replace(self, raw=first.raw, axes=first.axes, sensor=sensor)
        if first.is_identity:
            return recorded
        refuse_linearization(self.linearization, "follow another one")
        refuse_linearization(first.linearization, "come before another one")
        if any(disturbance.gain_per_unit for disturbance in first.disturbances):
            refuse_disturbances(first.disturbances, "come before another one where its scale follows the temperature")
        return replace(
            recorded,
            matrix=self.matrix @ first.matrix,
            offset=first.offset + np.linalg.solve(first.matrix, self.offset),
            rotation="composed",
            frame=first.frame,
            disturbances=first.disturbances,
        )

    def turned(self, axes: Axes) -> Calibration:
        """The same calibration for recorded readings that are mapped to other axes before it acts.

        With P the mapping, P W Pᵀ and P b. A calibration of mapped readings raises `AxesError`.

        >>> centred = Calibration(np.eye(3), [10, 20, 30], 50.0).turned(Axes.of("y,x,-z"))
        >>> centred.offset, str(centred.axes)
        (array([ 20.,  10., -30.]), 'y,x,-z')
        """
        if axes == self.axes:
            return self
        if not self.axes.is_identity:
            raise AxesError(f"the calibration is for axes {self.axes} already: map it from the recorded axes at once")
        turn = axes.apply(np.eye(3)).T
        disturbances = tuple(replace(each, per_unit=turn @ each.per_unit) for each in self.disturbances)
        matrix, offset = turn @ self.matrix @ turn.T, turn @ self.offset
        return replace(self, matrix=matrix, offset=offset, axes=axes, disturbances=disturbances)

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
            and disturbed_alike(self.disturbances, other.disturbances, tolerance * field)
            and bend_alike(self.linearization, other.linearization, self.shape, tolerance * field)
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Read a calibration file; what cannot be opened or understood raises `DocumentError`, in one line."""
        return cls.from_document(read(path), source=str(path))

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write a calibration file, whole or not at all; `load` reads back the same numbers to the bit.

        Raises `OutputExists` where there is a file already, unless `force`; `OutputError` where it cannot be written.
        """
        write(self.to_document(), path, force=force)

    @classmethod
    def from_document(cls, document: Document, *, source: str = "calibration") -> Calibration:
        """Take the correction out of a calibration file; `source` names it in messages.

        Parts that contradict each other and a matrix that is singular raise `DocumentError`.
        """
        try:
            return cls(**fields_in(document.calibration, document.raw))
        except (ArrayError, UnitError, AxesError, UsageError) as error:
            raise DocumentError(f"{source}: {error.message}", hint=error.hint, **error.evidence) from None

    def to_document(self, *, fit: Fitted | None = None, provenance: ProvenanceRecord | None = None) -> Document:
        """Make the content of a calibration file, with how it was found where that is known."""
        rows, offset = map(tuple, self.matrix.tolist()), self.offset.tolist()
        content: dict[str, Any] = {**self.as_dict(), "matrix": tuple(rows), "offset": tuple(offset)}
        content |= {kind: group for kind, group in records_of(self.disturbances).items() if content.pop(kind, None)}
        if terms := content.pop("linearization", None):
            content["linearization"] = LinearizationRecord(**{name: tuple(term) for name, term in terms.items()})
        unit: Any = self.raw.name  # whatever the schema does not allow is refused when the document is written
        raw = Recorded(unit=unit, scale=self.raw.scale, axes=str(self.axes), sensor=self.sensor, frame=self.frame)
        return Document(calibration=Correction(**content), raw=raw, fit=fit, provenance=provenance)

    def as_dict(self) -> dict[str, object]:
        """Give the correction as plain numbers, lists and strings, ready for JSON.

        >>> Calibration.identity(field_strength=48).as_dict()["offset"]
        [0.0, 0.0, 0.0]
        """
        follows = {kind: to_builtins(group) for kind, group in records_of(self.disturbances).items() if group}
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
        """What a notebook shows."""
        unit = label(self.unit)
        length = f"corrected readings are {self.field_strength:.4g} {unit} long"
        length += ", as none was given" * (not self.field_strength_known)
        title = "Calibration" if self.sensor is None else f"Calibration of {self.sensor}"
        words = (length, *(f"the offset follows {disturbance}" for disturbance in self.disturbances))
        terms = None if self.linearization is None else self.linearization.as_dict()
        return correction(self.matrix.tolist(), self.offset.tolist(), unit, title=title, words=words, terms=terms)
