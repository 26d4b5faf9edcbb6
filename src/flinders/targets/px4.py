"""PX4's compass parameters: ``m = R S ((r + x COMP) − OFF)``.

r is what the compass reads, in gauss and in its own axes; R turns what was corrected into the axes of the vehicle
(forward, right, down): by CAL_MAGn_ROT, or for an internal compass (ROT −1) as the board sits; S is symmetric, with
SCALE on its diagonal and ODIAG beside it; x is the throttle from 0 to 1 or the battery current in **kA**, as
CAL_MAG_COMP_TYP says. Ours is corrected = A (raw − b), so

    S = A,   OFF = b

>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.1, 1.0, 0.9]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("G"))
>>> for name, value in Px4Parameters.of(found, compass=1).rows()[:4]:
...     print(f"{name} {value:g}")
CAL_MAG1_XOFF 0.1
CAL_MAG1_YOFF -0.2
CAL_MAG1_ZOFF 0
CAL_MAG1_XSCALE 1.1
>>> turned_over = Px4Parameters.of(found, rotation=8)                  # ROLL_180
>>> turned_over.apply([[0.1, -0.2, 0.5]])                           # in gauss: 10, −20 and 50 µT
array([[ 0.  ,  0.  , -0.45]])

Offsets are subtracted here, and act before the mounting: ArduPilot adds them, after it.

Sources: ``Magnetometer::Correct`` and ``ParametersUpdate`` of PX4's ``src/lib/sensor_calibration`` (BSD-3-Clause; the
formula was taken from it and none of its code), ``src/lib/conversion/rotation.h``, limits of
``src/modules/sensors/module.yaml``, which gives the unit of the offsets as "m": it is gauss. Up to version 1.11 the
driver itself applied SCALE and OFF, and there was no ODIAG. The angles SENS_BOARD_X_OFF … Z_OFF turn after
SENS_BOARD_ROT, which a log of 2016 shows to the bit of its sensor; the newest versions leave them to the estimator
(since when was not seen).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import Floats, floats, vectors
from flinders.core.calibration import Calibration
from flinders.core.units import MICROTESLA, PER_UNIT, Unit
from flinders.errors import UnitError, UsageError, figures
from flinders.targets._affine import Affine, driver_in_recorded_axes, in_recorded_axes, single
from flinders.targets._autopilot import (
    MOTORS,
    ROTATIONS,
    chosen,
    euler,
    followed,
    in_six,
    inverse,
    listed,
    of_six,
    parse,
    read_motor,
    refuse_values,
    said,
    symmetric,
    turn_of,
)
from flinders.targets._export import ExportOptions, Written
from flinders.targets._parsing import decoded
from flinders.targets._target import Target, TargetReader

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from numpy.typing import ArrayLike

GAUSS: Final = PER_UNIT["G"]
"""µT in one gauss."""

DRIVE_UNITS: Final = {"throttle": 1.0, "current": 1000.0}
"""Throttle, and amperes in the kA in which PX4 has the current of the first battery."""

COMPASSES: Final = (0, 1, 2, 3)
LEAST_SCALE, MOST_SCALE = 0.1, 3.0
"""Range of CAL_MAGn_XSCALE."""
INTERNAL: Final = -1
"""CAL_MAGn_ROT of a compass on the board: it is turned as the board is."""

MOUNTINGS: Final = (
    *ROTATIONS,
    ("ROLL_270_YAW_180", 270.0, 0.0, 180.0), ("ROLL_270_YAW_270", 270.0, 0.0, 270.0),
    ("PITCH_90_YAW_180", 0.0, 90.0, 180.0), ("PITCH_9_YAW_180", 0.0, 9.0, 180.0), ("PITCH_45", 0.0, 45.0, 0.0),
    ("ROLL_270_YAW_225", 270.0, 0.0, 225.0), ("ROLL_270_YAW_315", 270.0, 0.0, 315.0),
)  # fmt: skip
"""Name, roll, pitch and yaw in degrees of CAL_MAGn_ROT and SENS_BOARD_ROT 0 to 47; older versions end at 40."""


@dataclass(frozen=True, slots=True, eq=False)
class Px4Parameters:
    """The parameters of one compass.

    Attributes
    ----------
    offset : (3,) float, G
        CAL_MAGn_XOFF to ZOFF.
    diagonal : (3,) float
        CAL_MAGn_XSCALE to ZSCALE.
    off_diagonal : (3,) float
        CAL_MAGn_XODIAG, YODIAG and ZODIAG: entries xy, xz and yz.
    compensation : (3,) float, G at full throttle or G/kA
        CAL_MAGn_XCOMP to ZCOMP, added to a reading before the offset is taken off.
    compensated_by : int
        CAL_MAG_COMP_TYP, one for all compasses: 0 nothing, 1 throttle, 2 the current of the first battery.
    rotation : int
        CAL_MAGn_ROT, a row of `MOUNTINGS`, or `INTERNAL`.
    board : (3, 3) float
        How the board sits, for an internal compass.
    device_id : int, optional
        CAL_MAGn_ID: PX4 uses the parameters for the compass with this number, as ``sensor_mag`` has it.
    priority : int, optional
        CAL_MAGn_PRIO, 0 to 100; 0 turns the compass off.
    compass : int
        n, from 0 to 3.
    """

    offset: Floats = field(default_factory=lambda: np.zeros(3))
    diagonal: Floats = field(default_factory=lambda: np.ones(3))
    off_diagonal: Floats = field(default_factory=lambda: np.zeros(3))
    compensation: Floats = field(default_factory=lambda: np.zeros(3))
    compensated_by: int = 0
    rotation: int = INTERNAL
    board: Floats = field(default_factory=lambda: np.eye(3))
    device_id: int | None = None
    priority: int | None = None
    compass: int = 0

    @classmethod
    def of(
        cls,
        calibration: Calibration,
        *,
        compass: int = 0,
        rotation: int = INTERNAL,
        device_id: int | None = None,
        priority: int | None = None,
        compensation: ArrayLike | None = None,
        lossy: bool = False,
    ) -> Self:
        """Turn a calibration into parameters; they act in the axes as recorded, which must be those of the sensor.

        Parameters
        ----------
        calibration : Calibration
            Of readings in the axes of the sensor, as ``sensor_mag`` of a PX4 log has them.
        compass : int
            n, from 0 to 3.
        rotation, device_id, priority : int, optional
            As the attributes of the same name; kept, and not used.
        compensation : (3,) array-like, optional
            CAL_MAGn_COMP: what is added to a reading, in G for each kA or at full throttle; by default that of the
            calibration, where it follows a current or, failing that, a throttle: −P.
        lossy : bool
            Leave a rotation of the calibration out, which belongs into the mounting.

        Raises
        ------
        UnitError
            For a calibration in counts.
        NotExportable
            For values that PX4 does not take: `beyond` names them, ``evidence["wanted"]`` holds them.
        UsageError
            For a compass or a mounting that there is not.
        """
        if calibration.unit != MICROTESLA:
            raise UnitError(
                "the calibration is in counts, and PX4's parameters are in gauss: calibrate again with --unit G "
                "(or mG, uT …), or with --scale where the microtesla in one count are known"
            )
        plain, follows = followed(calibration)
        matrix, centre = in_recorded_axes(plain)
        if compensation is None and follows is not None:
            per_unit = DRIVE_UNITS[follows.name]
            compensation = -driver_in_recorded_axes(calibration, follows) * per_unit / GAUSS
        symmetrical = symmetric(matrix, "PX4", "CAL_MAG ODIAG", by="CAL_MAGn_ROLL, PITCH and YAW", lossy=lossy)
        mounting(rotation)
        diagonal, off_diagonal = in_six(symmetrical)
        parameters = cls(
            offset=centre / GAUSS,
            diagonal=diagonal,
            off_diagonal=off_diagonal,
            compensation=np.zeros(3) if compensation is None else vectors(compensation, "compensation"),
            compensated_by=0 if follows is None else MOTORS[follows.name],
            rotation=rotation,
            device_id=device_id,
            priority=priority,
            compass=_known(compass),
        )
        parameters.refuse_beyond()
        return parameters

    @classmethod
    def read(cls, values: Mapping[str, float], compass: int = 0) -> Self:
        """Take one compass out of a vehicle's parameters; what is not there is the default.

        Examples
        --------
        >>> Px4Parameters.read({"CAL_MAG1_YOFF": -0.25, "CAL_MAG1_ROT": 6, "CAL_MAG1_ID": 592905}, 1).offset
        array([ 0.  , -0.25,  0.  ])
        """
        name = f"CAL_MAG{_known(compass)}_"

        def three(group: str, default: float = 0.0) -> Floats:
            return np.array([float(values.get(f"{name}{axis}{group}", default)) for axis in "XYZ"])

        def whole(group: str) -> int | None:
            value = float(values.get(f"{name}{group}", np.nan))
            return int(value) if np.isfinite(value) else None

        rotation = whole("ROT")
        return cls(
            offset=three("OFF"),
            diagonal=three("SCALE", 1.0),
            off_diagonal=three("ODIAG"),
            compensation=three("COMP"),
            compensated_by=_compensated_by(values),
            rotation=INTERNAL if rotation is None else rotation,
            board=board_mounting(values),
            device_id=whole("ID"),
            priority=whole("PRIO"),
            compass=compass,
        )

    @property
    def matrix(self) -> Floats:
        """(3, 3) S: the A of corrected = A (raw − b)."""
        return of_six(self.diagonal, self.off_diagonal)

    @property
    def centre(self) -> Floats:
        """(3,) OFF in µT: the b of corrected = A (raw − b)."""
        return floats(GAUSS * self.offset)

    @property
    def mounting(self) -> Floats:
        """(3, 3) R, from the axes of the sensor to those of the vehicle; a number that is not known turns nothing."""
        if self.rotation == INTERNAL:
            return self.board
        return mounting(self.rotation) if 0 <= self.rotation < len(MOUNTINGS) else np.eye(3)

    @property
    def is_identity(self) -> bool:
        """Nothing is corrected, whatever is turned."""
        return not self.offset.any() and np.array_equal(self.matrix, np.eye(3))

    def apply(self, raw: ArrayLike, drive: ArrayLike = 0.0) -> Floats:
        """Correct readings as PX4 does.

        Parameters
        ----------
        raw : (..., 3) G
            Readings in the axes of the sensor.
        drive : (...) kA or 0 to 1
            Current or throttle, as CAL_MAG_COMP_TYP says.

        Returns
        -------
        (..., 3) G
            In the axes of the vehicle.
        """
        added: Floats = floats(drive, "drive")[..., np.newaxis] * self.compensation
        readings: Floats = (vectors(raw, "raw", finite=False) + added - self.offset) @ (self.mounting @ self.matrix).T
        return readings

    def unapply(self, corrected: ArrayLike, drive: ArrayLike = 0.0) -> Floats:
        """Tell what the compass read, r = S⁻¹ Rᵀ m + OFF − x COMP.

        Parameters
        ----------
        corrected : (..., 3) G
            In the axes of the vehicle.
        drive : (...) kA or 0 to 1
            As for `apply`.

        Raises
        ------
        ArrayError
            Where S flattens readings and cannot be undone.

        Examples
        --------
        >>> set_up = Px4Parameters(offset=np.array([0.1, 0, -0.2]), off_diagonal=np.array([0.1, 0, 0]), rotation=6)
        >>> set_up.unapply(set_up.apply([0.1, 0.2, 0.3])).round(9)
        array([0.1, 0.2, 0.3])
        """
        added = floats(drive, "drive")[..., np.newaxis] * self.compensation
        back = inverse(self.matrix, self.words())
        turned = vectors(corrected, "corrected", finite=False) @ self.mounting
        readings: Floats = turned @ back.T + self.offset - added
        return readings

    def to_calibration(self, field_strength: float, *, known: bool = False, sensor: str | None = None) -> Calibration:
        """The calibration that the parameters stand for, without the mounting, in the axes of the sensor.

        COMP x is added to a reading: what the motors make of it is P = −COMP, for each A where x counts kA.

        Parameters
        ----------
        field_strength : float, µT
            Length of corrected readings, which parameters do not hold.
        known : bool
            It was given, and is no convention.
        sensor : str, optional

        Raises
        ------
        ArrayError
            Where S flattens readings.
        """
        plain = Calibration(self.matrix, self.centre, field_strength, known, raw=Unit.of("G"), sensor=sensor)
        name = next((name for name, number in MOTORS.items() if number == self.compensated_by), None)
        if name is None:
            return plain
        return replace(plain, disturbances=read_motor(name, -GAUSS * self.compensation / DRIVE_UNITS[name]))

    def rows(self) -> tuple[tuple[str, float], ...]:
        """Names and values to write: OFF, SCALE, ODIAG, then COMP, ROT, ID and PRIO where there are any to set.

        Real numbers are rounded to the float32 that PX4 keeps. CAL_MAGn_ROT is left out for an internal compass, as
        PX4 sets it to −1 by itself.
        """
        columns = {"OFF": self.offset, "SCALE": self.diagonal, "ODIAG": self.off_diagonal}
        if self.compensation.any():
            columns["COMP"] = self.compensation
        named = [
            (f"CAL_MAG{self.compass}_{axis}{group}", float(np.float32(value)) + 0.0)
            for group, values in columns.items()
            for axis, value in zip("XYZ", values, strict=True)
        ]
        whole = {
            "ROT": None if self.rotation == INTERNAL else self.rotation,
            "ID": self.device_id,
            "PRIO": self.priority,
        }
        return (*named, *((f"CAL_MAG{self.compass}_{key}", value) for key, value in whole.items() if value is not None))

    def as_held(self) -> Self:
        """The same after PX4 has kept each value as a float32."""
        return replace(
            self,
            offset=single(self.offset),
            diagonal=single(self.diagonal),
            off_diagonal=single(self.off_diagonal),
            compensation=single(self.compensation),
        )

    def words(self) -> str:
        """Write what is in force on one line, with its names.

        >>> Px4Parameters(offset=np.array([0.0282, -0.2002, -0.1369]), compass=1).words()
        'CAL_MAG1_OFF 0.0282, -0.2002, -0.1369 G'
        """
        parts = [f"CAL_MAG{self.compass}_OFF {listed(self.offset)} G"]
        if not np.all(self.diagonal == 1):
            parts.append(f"SCALE {listed(self.diagonal)}")
        if self.off_diagonal.any():
            parts.append(f"ODIAG {listed(self.off_diagonal)}")
        if self.compensation.any():
            parts.append(f"COMP {listed(self.compensation)}")
        return ", ".join(parts)

    def refuse_beyond(self) -> None:
        """Raise `NotExportable` for values out of the ranges that PX4's parameters have."""
        largest = float(np.finfo(np.float32).max)
        checked = {
            "SCALE": (self.diagonal, (self.diagonal >= LEAST_SCALE) & (self.diagonal <= MOST_SCALE)),
            "OFF": (self.offset, np.abs(self.offset) < largest),
            "ODIAG": (self.off_diagonal, np.abs(self.off_diagonal) < largest),
        }
        refuse_values(
            {
                f"CAL_MAG{self.compass}_{axis}{group}": (float(value), figures(value, 4))
                for group, (values, fits) in checked.items()
                for axis, value, fit in zip("XYZ", values, fits, strict=True)
                if not fit
            },
            f": PX4 takes a SCALE of {LEAST_SCALE:g} to {MOST_SCALE:g}, and float32 numbers. Check the unit of the "
            "recording and --field-strength, and that the axes are those of the sensor",
        )


def mounting(rotation: int) -> Floats:
    """(3, 3) R of a CAL_MAGn_ROT or SENS_BOARD_ROT, vehicle = R sensor; −1 turns nothing.

    Raises
    ------
    UsageError
        For a number that is not known.

    Examples
    --------
    >>> mounting(6) @ [1, 0, 0]                                             # YAW_270: its x points to the left
    array([ 0., -1.,  0.])
    """
    if rotation == INTERNAL:
        return np.eye(3)
    if not 0 <= rotation < len(MOUNTINGS):
        raise UsageError(
            f"rotation {rotation} is not known: it is 0 (NONE) to {len(MOUNTINGS) - 1} ({MOUNTINGS[-1][0]}), "
            f"or {INTERNAL} for a compass on the board"
        )
    return euler(*MOUNTINGS[rotation][1:])


def board_mounting(values: Mapping[str, float]) -> Floats:
    """(3, 3) how the board sits: SENS_BOARD_ROT, then SENS_BOARD_X_OFF, Y_OFF and Z_OFF in degrees; vehicle = R board.

    >>> board_mounting({"SENS_BOARD_ROT": 4}) @ [1, 0, 0]                   # YAW_180
    array([-1.,  0.,  0.])
    """
    number = float(values.get("SENS_BOARD_ROT", 0))
    trim = [float(values.get(f"SENS_BOARD_{axis}_OFF", 0)) for axis in "XYZ"]
    turned = mounting(int(number)) if number in range(len(MOUNTINGS)) else np.eye(3)
    return euler(*trim) @ turned if np.isfinite(trim).all() and any(trim) else turned


def compasses(values: Iterable[str]) -> tuple[int, ...]:
    """Tell of which compasses there are parameters, by their names.

    >>> compasses(["CAL_MAG0_XOFF", "CAL_MAG2_ID", "CAL_MAG_SIDES"])
    (0, 2)
    """
    there = tuple(values)
    return tuple(n for n in COMPASSES if any(name.startswith(f"CAL_MAG{n}_") for name in there))


def of_device(values: Mapping[str, float], device_id: int) -> Px4Parameters | None:
    """The parameters that PX4 uses for the compass with this number, or None where there are none.

    >>> of_device({"CAL_MAG2_ID": 396809, "CAL_MAG2_XOFF": 0.5}, 396809).offset
    array([0.5, 0. , 0. ])
    """
    if device_id == 0:
        return None
    known = (Px4Parameters.read(values, compass) for compass in compasses(values))
    return next((one for one in known if one.device_id is not None and one.device_id % 2**32 == device_id), None)


def _compensated_by(values: Mapping[str, float]) -> int:
    """CAL_MAG_COMP_TYP; 0 for what PX4 does not know, or for ESC currents, of which a calibration has no column."""
    kind = float(values.get("CAL_MAG_COMP_TYP", 0.0))
    return int(kind) if kind in MOTORS.values() else 0


def _known(compass: int) -> int:
    """Let through a compass that there is."""
    if compass not in COMPASSES:
        raise UsageError(f"compass {compass}: PX4 keeps parameters of compass 0, 1, 2 and 3")
    return compass


# the file

FLOAT: Final = 9
"""MAV_PARAM_TYPE_REAL32, the last column of QGroundControl's file."""
WHOLE: Final = 6
"""MAV_PARAM_TYPE_INT32."""
COMPENSATED: Final = (
    "COMP is in G per kA (CAL_MAG_COMP_TYP 2, current of the first battery) or at full throttle (1), added to a "
    "reading before OFF is taken off; CAL_MAG_COMP_TYP is one for all compasses"
)

LEFT_OUT: Final = (
    "left out: a rotation of {turn}. It belongs into the mounting, before the rotation that is set now: put the "
    "product of both into CAL_MAG{compass}_ROLL, PITCH and YAW, which recent versions of PX4 have; the numbers stay as "
    "they are"
)


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the five columns that QGroundControl loads: vehicle, component, name, value, type.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        For values that PX4 does not take.
    UsageError
        For a compass that there is not.
    """
    return _written(calibration, lambda name, value: f"1\t1\t{name}\t{value}\t{_type(name)}", asked)


def write_shell(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write lines for the shell of the vehicle; raises as `write`."""
    return _written(calibration, lambda name, value: f"param set {name} {value}", asked)


def _written(calibration: Calibration, line: Callable[[str, str], str], asked: ExportOptions) -> Written:
    """The parameters of one compass, the first unless another is asked for, each as a line."""
    compass = 0 if asked.compass is None else asked.compass
    Affine.of(calibration, "G", who="PX4")  # refuses counts, and numbers beyond all bounds
    parameters = Px4Parameters.of(calibration, compass=compass, rotation=INTERNAL, lossy=asked.lossy).as_held()
    values: dict[str, float] = dict(parameters.rows())
    compensated: Callable[[Floats, float], Floats] | None = None
    if (motor := followed(calibration)[1]) is not None:
        values["CAL_MAG_COMP_TYP"] = MOTORS[motor.name]
        size = DRIVE_UNITS[motor.name]
        compensated = lambda raw, value: parameters.apply(raw, value / size)  # noqa: E731 - in the unit of COMP_TYP

    body = [line(name, f"{value:.9g}") for name, value in values.items()]
    ready = (
        f"CAL_MAG{compass}_ID must already be the device_id of this sensor, and CAL_MAG{compass}_ROT its mounting; "
        "restart the vehicle afterwards"
    )
    turn = turn_of(in_recorded_axes(calibration)[0])
    notes = [] if turn is None else [LEFT_OUT.format(turn=said(turn), compass=compass)]
    notes += [ready] if compensated is None else [ready, COMPENSATED]
    return Written(parameters.apply, body, values, notes, compensated=compensated)


def _type(name: str) -> int:
    """MAV_PARAM_TYPE of a parameter."""
    return WHOLE if name == "CAL_MAG_COMP_TYP" else FLOAT


def read(content: bytes, source: str, *, strength: float | None = None, compass: int | None = None) -> Calibration:
    """Read the parameters of one compass back, from either kind of file.

    `strength`, µT: length of corrected readings, which they do not hold; 50 µT where it is not given. `compass`:
    which one; the only one where there is one.

    Raises
    ------
    InputError
        For lines that are no parameters, or none of such a compass.
    """
    values, wanted = _chosen(content, source, compass)
    return Px4Parameters.read(values, wanted).to_calibration(strength or 50.0, known=strength is not None)


def which(content: bytes, source: str, compass: int | None = None) -> tuple[int, int | None]:
    """Number, and device id where the file has it, of the compass that `read` takes; raises as `read`."""
    values, wanted = _chosen(content, source, compass)
    device = Px4Parameters.read(values, wanted).device_id
    return wanted, device % 2**32 if device else None


def _chosen(content: bytes, source: str, compass: int | None) -> tuple[dict[str, float], int]:
    """The parameters of a file, and the number of the compass that is meant."""
    lines = (line.strip().removeprefix("param set ") for line in decoded(content, source).splitlines())
    values = parse("\n".join(lines), source)
    there = [number for number in COMPASSES if f"CAL_MAG{number}_XOFF" in values]
    return values, chosen(there, compass, source, "CAL_MAG0_XOFF and so on")


PX4: Final = Target(
    name="px4",
    use="PX4, file of QGroundControl",
    suffix=".params",
    title="PX4",
    formula="m = R S (r - OFF), S of SCALE and ODIAG, OFF subtracted, R the mounting",
    unit="G",
    keeps="symmetric",
    storage="float32; SCALE 0.1 to 3",
    source="Magnetometer.hpp and .cpp, sensors/module.yaml",
    follows="motors",
    compasses=range(4),
    write=write,
    reader=TargetReader(rb"CAL_MAG", read, "parameters of PX4", which),
)
TARGETS: Final = (
    PX4,
    replace(PX4, name="px4-shell", use="PX4, lines for its shell", suffix=".txt", write=write_shell),
)
