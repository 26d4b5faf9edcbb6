"""Calibration of a survey instrument: two sensors and the axis of a laser, which give azimuth, inclination and roll.

A cave or geological surveyor's instrument (DistoX, SAP6) has a magnetometer, an accelerometer and a laser. Its
calibration converts readings of both sensors to axes of the instrument, one of which is the axis of the laser.

>>> instrument = SurveyCalibration.identity()
>>> angles = instrument.angles([[0.5, 0.0, 0.8]], [[0.0, 0.0, 1.0]])              # held level, the laser to the north
>>> np.stack([angles.azimuth_deg, angles.inclination_deg, angles.roll_deg]).round(6).T + 0.0
array([[0., 0., 0.]])

The calibration is made from shots, each with one reading of both sensors:

>>> shots = Shots(np.ones((3, 3)), np.ones((3, 3)), groups=np.array([1, 1, 2]))
>>> len(shots[shots.groups == 1]), shots.numbers
(2, (1, 2, 3))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Self

import msgspec
import numpy as np

from flinders.arrays import check_table, to_floats
from flinders.core.axes import Axes
from flinders.core.calibration import RECORDED_AXES, UNKNOWN_UNIT, Calibration
from flinders.core.calibration_file import Recorded, SurveyRecord, read, write
from flinders.errors import ArrayError, DocumentError, NoAccelerometer, UsageError

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document, Fitted, ProvenanceRecord
    from flinders.core.samples import Samples
    from flinders.core.units import Unit


class Angles(NamedTuple):
    """Directions of shots, in degrees."""

    azimuth_deg: Floats  #: (N,) from magnetic north, 0 to 360
    inclination_deg: Floats  #: (N,) above the horizon
    roll_deg: Floats  #: (N,) to the right, −180 to 180


def pointing_angles(field: Floats, down: Floats) -> Angles:
    """Angles of the x axis of an instrument, from (..., 3) field and gravity in its axes forward, right and down.

    Source: B. Heeb, *A General Calibration Algorithm for 3-Axis Compass/Clinometer Devices*, CREG Journal 73 (2009).
    """
    west = np.cross(field, down)
    x, y, z = (vector[..., 0] / np.linalg.norm(vector, axis=-1) for vector in (np.cross(down, west), west, down))
    return Angles(
        np.degrees(np.arctan2(-y, x)) % 360.0,
        np.degrees(np.arctan2(-z, np.hypot(x, y))),
        np.degrees(np.arctan2(down[..., 1], down[..., 2])),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SurveyCalibration:
    """Corrections of both sensors into right-handed axes of the instrument, one of which is the axis of the laser."""

    magnetometer: Calibration
    accelerometer: Calibration  #: correction of readings that point down
    pointing: Pointing = "x"  #: axis of the laser: x, y or z
    #: (3,): q, one over the unit of the accelerometer, which corrects readings g + q g²
    quadratic: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def identity(cls, pointing: Pointing = "x") -> Self:
        """Return the calibration of an instrument without errors."""
        return cls(Calibration.identity(), Calibration.identity(), pointing)

    def angles(self, magnetic: ArrayLike, gravity: ArrayLike) -> Angles:
        """Azimuth from magnetic north, inclination and roll, from (N, 3) readings in mapped axes.

        The roll is positive to the right. Zero roll depends on the axis of the laser: z points down for a laser along
        x, z points up for a laser along y, and y points down for a laser along z.
        """
        axes = FORWARD_RIGHT_DOWN[self.pointing]
        readings = to_floats(gravity)
        field = self.magnetometer.apply(magnetic)
        down = self.accelerometer.apply(readings + self.quadratic * readings**2)
        return pointing_angles(axes.apply(field), axes.apply(down))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a calibration file; raises `DocumentError` for that of a magnetometer alone."""
        return cls.from_document(read(path), source=str(path))

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write a calibration file completely or not at all; raises as `Calibration.save`."""
        write(self.to_document(), path, force=force)

    @classmethod
    def from_document(cls, document: Document, *, source: str = "calibration") -> Self:
        """Calibration from the contents of a calibration file; `source` is its name in messages."""
        survey = document.survey
        if isinstance(survey, msgspec.UnsetType):
            raise DocumentError(
                f"{source} is the calibration of a magnetometer alone: need that of a survey instrument, which "
                "flinders survey writes"
            )
        gravity = msgspec.structs.replace(
            document, calibration=survey.accelerometer, raw=Recorded(unit="counts", axes=survey.acceleration_axes)
        )
        return cls(
            Calibration.from_document(document, source=source),
            Calibration.from_document(gravity, source=source),
            survey.pointing,
            survey.quadratic,
        )

    def to_document(self, *, fit: Fitted | None = None, provenance: ProvenanceRecord | None = None) -> Document:
        """Contents of a calibration file: the magnetometer, with accelerometer and axis of the laser added."""
        gravity = self.accelerometer.to_document()
        record = SurveyRecord(
            accelerometer=gravity.calibration,
            acceleration_axes=gravity.raw.axes,
            pointing=self.pointing,
            quadratic=self.quadratic,
        )
        document = self.magnetometer.to_document(fit=fit, provenance=provenance)
        return msgspec.structs.replace(document, survey=record)


Pointing = Literal["x", "y", "z"]

FORWARD_RIGHT_DOWN: Final[dict[Pointing, Axes]] = {"x": Axes(), "y": Axes.of("y,x,-z"), "z": Axes.of("z,x,y")}
"""Axes forward, right and down of an instrument, by the axis of its laser."""

PROCEDURE: Final = np.array([
    (0, 0), (90, 0), (0, 90), (180, 0), (270, 0), (0, -90),
    (45, 35.26), (135, -35.26), (225, 35.26), (315, -35.26), (45, -35.26), (135, 35.26), (225, -35.26), (315, 35.26),
])  # fmt: skip
"""(14, 2) azimuth and inclination in degrees of the sides and corners of a cube, for four rolls 90° apart in each."""

ROLLS_DEG: Final = np.array([0.0, 90.0, 180.0, 270.0])


@dataclass(frozen=True, slots=True, eq=False)
class Shots:
    """Readings of a survey instrument: one reading of both sensors for each shot.

    Raises
    ------
    ArrayError
        For arrays of another shape or length, or values that are not finite.
    """

    magnetic: Floats  #: (N, 3), in `unit`
    #: (N, 3), any unit: points down, opposite to the specific force of `flinders.core.samples.Samples`
    gravity: Floats
    #: (N,): number of the direction of each shot; None if it was not recorded
    groups: NDArray[np.intp] | None = None
    numbers: tuple[int, ...] = ()  #: numbers of the shots in the file; by default 1, 2, 3, …
    pointing: Pointing = "x"  #: axis of the laser: x, y or z
    unit: Unit = UNKNOWN_UNIT  #: unit of the magnetometer
    #: mapping from recorded axes of each sensor to right-handed axes of the instrument
    axes: Axes = RECORDED_AXES
    acceleration_axes: Axes = RECORDED_AXES
    source: str = "shots"

    @classmethod
    def of(cls, samples: Samples, axes: Axes, acceleration_axes: Axes, pointing: Pointing) -> Self:
        """Shots from a recording, one for each reading; raises `NoAccelerometer` without an accelerometer."""
        if samples.acceleration is None:
            raise NoAccelerometer(
                f"{samples.source} has no accelerometer: a survey instrument needs columns of both sensors, one shot a "
                "line"
            )
        return cls(
            axes.apply(samples.field), acceleration_axes.apply(-samples.acceleration), pointing=pointing,
            unit=samples.unit, axes=axes, acceleration_axes=acceleration_axes, source=samples.source,
        )  # fmt: skip

    def __post_init__(self) -> None:
        """Check the arrays."""
        for name in ("magnetic", "gravity"):
            object.__setattr__(self, name, check_table(getattr(self, name), name))
        if not self.numbers:
            object.__setattr__(self, "numbers", tuple(range(1, len(self) + 1)))
        for name in ("gravity", "groups", "numbers"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self):
                raise ArrayError(f"{name} has {len(values)} rows, and magnetic {len(self)}: need one for each shot")
        if self.pointing not in FORWARD_RIGHT_DOWN:
            raise UsageError(f"pointing is {self.pointing!r}: need x, y or z")

    def __len__(self) -> int:
        return len(self.magnetic)

    def __getitem__(self, rows: NDArray[np.bool_]) -> Self:
        """Select the shots for which (N,) `rows` is true."""
        return replace(
            self,
            magnetic=self.magnetic[rows],
            gravity=self.gravity[rows],
            groups=None if self.groups is None else self.groups[rows],
            numbers=tuple(np.array(self.numbers)[rows].tolist()),
        )
