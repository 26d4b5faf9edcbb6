"""PX4's compass parameters: ``m = R S ((r + x COMP) − OFF)``.

r is the raw reading, in gauss and in the compass's own axes. R turns the corrected reading into the axes of the vehicle
(forward, right, down): it is CAL_MAGn_ROT, or the board's mounting for an internal compass (ROT −1). S is symmetric,
with SCALE on its diagonal and ODIAG off the diagonal. x is the throttle from 0 to 1 or the battery current in **kA**,
as selected by CAL_MAG_COMP_TYP. A calibration here is corrected = A (raw − b), so

    S = A,   OFF = b

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.1, 1.0, 0.9]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("G"))
>>> for name, value in Px4Parameters.of(calibration, compass=1).rows()[:4]:
...     print(f"{name} {value:g}")
CAL_MAG1_XOFF 0.1
CAL_MAG1_YOFF -0.2
CAL_MAG1_ZOFF 0
CAL_MAG1_XSCALE 1.1
>>> turned_over = replace(Px4Parameters.of(calibration), rotation=8)                  # ROLL_180
>>> turned_over.apply([[0.1, -0.2, 0.5]])                           # in gauss: 10, −20 and 50 µT
array([[ 0.  ,  0.  , -0.45]])

PX4 subtracts offsets, before the mounting; ArduPilot adds them, after the mounting.

A rotation of the calibration goes into R of an external compass: CAL_MAGn_ROT, or for ROT 100 the Euler rotation 321
of CAL_MAGn_ROLL, PITCH and YAW in degrees. If one of these angles is not 0, ROT counts as 100.

Sources: ``Magnetometer::Correct``, ``set_custom_rotation`` and ``ParametersUpdate`` of PX4's
``src/lib/sensor_calibration`` (BSD-3-Clause; the formula was taken from it and none of its code),
``src/lib/conversion/rotation.h``, limits of ``src/modules/sensors/module.yaml``, which gives the unit of the offsets as
"m", though it is gauss. Up to version 1.11 the driver itself applied SCALE and OFF, and there was no ODIAG. The angles
SENS_BOARD_X_OFF … Z_OFF turn after SENS_BOARD_ROT, which a log of 2016 shows to the bit of its sensor; the newest
versions leave them to the estimator (first version unknown).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Final, Self

import numpy as np

from flinders.apps.vehicles.targets import inertial
from flinders.apps.vehicles.targets.autopilot import (
    ROTATIONS,
    CompassParameters,
    ParameterFile,
    list_text,
    motor_kind,
    mountings,
    refuse_values,
    symmetric_entries,
)
from flinders.apps.vehicles.targets.estimators import EKF2, estimator_values
from flinders.apps.vehicles.targets.remounting import remounting, rotation_notes
from flinders.arrays import Floats, check_vectors, to_floats
from flinders.core.units import PER_UNIT
from flinders.errors import UsageError, figures
from flinders.targets._mounting import Mounting, MountingTable, euler
from flinders.targets._numbers import (
    MOTOR_QUANTITIES,
    Affine,
    in_recorded_axes,
    shift_in_recorded_axes,
    split_motor_disturbance,
)
from flinders.targets._target import ExportOptions, Limit, Target, TargetReader, Written

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

GAUSS: Final = PER_UNIT["G"]
"""µT in one gauss."""
DRIVE_UNITS: Final = {"throttle": 1.0, "current": 1000.0}
"""Size of PX4's unit of each disturbance: 1 for a throttle, 1000 A for a battery current, which PX4 has in kA."""
COMPASSES: Final = (0, 1, 2, 3)
MIN_SCALE, MAX_SCALE = 0.1, 3.0
"""Range of CAL_MAGn_XSCALE."""
INTERNAL: Final = -1
"""CAL_MAGn_ROT of a compass on the board, which has the board's rotation."""

MOUNTINGS: Final = ROTATIONS + mountings("""
    ROLL_270_YAW_180 ROLL_270_YAW_270 PITCH_90_YAW_180 PITCH_9_YAW_180 PITCH_45 ROLL_270_YAW_225
    ROLL_270_YAW_315
""")
"""Name, roll, pitch and yaw in degrees of CAL_MAGn_ROT and SENS_BOARD_ROT 0 to 47; older versions end at 40."""
CUSTOM: Final = 100
"""CAL_MAGn_ROT of a compass whose rotation is CAL_MAGn_ROLL, PITCH and YAW."""
TABLE: Final = MountingTable("PX4", "CAL_MAGn_ROT", MOUNTINGS)
RESTART: Final = "restart the vehicle afterwards"
EXTERNAL_ONLY: Final = (
    "only an external compass has a mounting of its own: where CAL_MAGn_ROT is -1, it turns with the board. Old "
    "versions of PX4 have no CAL_MAGn_ROLL, PITCH and YAW, and no ROT above 40"
)


@dataclass(frozen=True, slots=True, eq=False)
class Px4Parameters(CompassParameters):
    """The parameters of one compass n, 0 to 3.

    - `offset`: CAL_MAGn_XOFF to ZOFF, (3,) in G
    - `diagonal`: CAL_MAGn_XSCALE to ZSCALE, (3,)
    - `off_diagonal`: CAL_MAGn_XODIAG, YODIAG and ZODIAG, (3,) entries xy, xz and yz
    - `motor`: CAL_MAGn_XCOMP to ZCOMP, (3,) in G at full throttle or G/kA, added to a reading before the offset is
      removed
    - `motor_by`: CAL_MAG_COMP_TYP, the same for all compasses: 0 off, 1 throttle, 2 current of the first battery
    - `device_id`: CAL_MAGn_ID; PX4 uses the parameters for the compass with this id, as in ``sensor_mag``
    """

    rotation: int = INTERNAL  #: CAL_MAGn_ROT, a row of `MOUNTINGS`, `CUSTOM` or `INTERNAL`
    custom: Floats = field(default_factory=lambda: np.zeros(3))  #: (3,), degrees: CAL_MAGn_ROLL, PITCH and YAW
    board: Floats = field(default_factory=lambda: np.eye(3))  #: (3, 3): mounting of the board, for an internal compass

    who: ClassVar[str] = "PX4"
    unit: ClassVar[str] = "G"
    compasses: ClassVar[tuple[int, ...]] = COMPASSES

    @classmethod
    def of(cls, calibration: Calibration, *, compass: int = 0) -> Self:
        """Convert a calibration to parameters; if it depends on a current or a throttle, COMP is −P.

        A rotation of the calibration is left out: it belongs in the mounting, see `remounting`.

        Parameters
        ----------
        calibration : Calibration
            Of readings in the axes of the sensor, as ``sensor_mag`` of a PX4 log has them.
        compass : int
            n, from 0 to 3.

        Raises
        ------
        UnitError
            For a calibration in counts.
        NotExportable
            For values out of PX4's range: `beyond` names them, ``evidence["wanted"]`` holds them.
        UsageError
            For another number of a compass.
        """
        matrix = cls.symmetric(calibration, compass)
        plain, follows = split_motor_disturbance(calibration)
        diagonal, off_diagonal = symmetric_entries(matrix)
        offset = in_recorded_axes(plain)[1] / GAUSS
        parameters = cls(offset=offset, diagonal=diagonal, off_diagonal=off_diagonal, compass=compass)
        if follows is not None:
            motor = -shift_in_recorded_axes(calibration, follows) * DRIVE_UNITS[follows.name] / GAUSS
            parameters = replace(parameters, motor=motor, motor_by=MOTOR_QUANTITIES[follows.name])
        parameters.refuse_beyond()
        return parameters

    @classmethod
    def read(cls, values: Mapping[str, float], compass: int = 0) -> Self:
        """Read one compass, 0 to 3, from a vehicle's parameters; missing parameters have their defaults.

        Raises `UsageError` for another number of a compass.

        >>> Px4Parameters.read({"CAL_MAG1_YOFF": -0.25, "CAL_MAG1_ROT": 6, "CAL_MAG1_ID": 592905}, 1).offset
        array([ 0.  , -0.25,  0.  ])
        """
        cls.refuse_unknown(compass)
        name = f"CAL_MAG{compass}_"

        def three(group: str, default: float = 0.0) -> Floats:
            return np.array([float(values.get(f"{name}{axis}{group}", default)) for axis in "XYZ"])

        def whole(group: str) -> int | None:
            value = float(values.get(f"{name}{group}", np.nan))
            return int(value) if np.isfinite(value) else None

        rotation = whole("ROT")
        custom = np.nan_to_num([float(values.get(f"{name}{axis}", 0.0)) for axis in ANGLES])
        if custom.any() and rotation not in (None, INTERNAL):
            rotation = CUSTOM
        return cls(
            offset=three("OFF"),
            diagonal=three("SCALE", 1.0),
            off_diagonal=three("ODIAG"),
            motor=three("COMP"),
            motor_by=motor_kind(values, "CAL_MAG_COMP_TYP"),  # a calibration has no column of ESC currents
            rotation=INTERNAL if rotation is None else rotation,
            custom=custom,
            board=board_mounting(values),
            device_id=whole("ID"),
            compass=compass,
        )

    @property
    def centre(self) -> Floats:
        """(3,) centre b = OFF of corrected = A (raw − b), in µT."""
        return to_floats(GAUSS * self.offset)

    @property
    def mounting(self) -> Floats:
        """(3, 3) mounting R, vehicle = R sensor; the identity for an unknown number."""
        if self.rotation == INTERNAL:
            return self.board
        if self.rotation == CUSTOM:
            return euler(*self.custom)
        return mounting(self.rotation) if 0 <= self.rotation < len(MOUNTINGS) else np.eye(3)

    @classmethod
    def mounting_names(cls, compass: int) -> tuple[str, ...]:
        """Names of the parameters of a mounting: CAL_MAGn_ROLL, PITCH, YAW and ROT."""
        return tuple(f"CAL_MAG{compass}_{group}" for group in (*ANGLES, "ROT"))

    @property
    def own_mounting(self) -> Floats | None:
        """(3, 3) mounting R, vehicle = R sensor; None for a compass on the board, or an unknown number."""
        is_known = self.rotation == CUSTOM or 0 <= self.rotation < len(MOUNTINGS)
        return self.mounting if is_known else None

    def apply(self, raw: ArrayLike, drive: ArrayLike = 0.0) -> Floats:
        """Correct readings as PX4 does: (..., 3) G in the axes of the sensor to (..., 3) G in those of the vehicle.

        `drive`, (...), is the current in kA or the throttle from 0 to 1, as selected by CAL_MAG_COMP_TYP.
        """
        added: Floats = to_floats(drive, "drive")[..., np.newaxis] * self.motor
        readings: Floats = (check_vectors(raw, "raw", finite=False) + added - self.offset) @ (
            self.mounting @ self.matrix
        ).T
        return readings

    def unapply(self, corrected: ArrayLike, drive: ArrayLike = 0.0) -> Floats:
        """Return raw readings, r = S⁻¹ Rᵀ m + OFF − x COMP, the inverse of `apply`; `ArrayError` for a singular S.

        >>> set_up = Px4Parameters(offset=np.array([0.1, 0, -0.2]), off_diagonal=np.array([0.1, 0, 0]), rotation=6)
        >>> set_up.unapply(set_up.apply([0.1, 0.2, 0.3])).round(9)
        array([0.1, 0.2, 0.3])
        """
        added = to_floats(drive, "drive")[..., np.newaxis] * self.motor
        turned = check_vectors(corrected, "corrected", finite=False) @ self.mounting
        readings: Floats = turned @ self.inverse().T + self.offset - added
        return readings

    def motor_shift(self, name: str) -> Floats:
        """(3,) shift P = −COMP of raw readings, in µT at full throttle or µT/A, since COMP x is added to a reading."""
        shift: Floats = -GAUSS * self.motor / DRIVE_UNITS[name]
        return shift

    def rows(self) -> tuple[tuple[str, float], ...]:
        """Names and values to write: OFF, SCALE, ODIAG, then COMP where there is a motor term, in PX4's float32."""
        groups = {"OFF": self.offset, "SCALE": self.diagonal, "ODIAG": self.off_diagonal}
        if self.motor.any():
            groups["COMP"] = self.motor
        return tuple(
            (f"CAL_MAG{self.compass}_{axis}{group}", float(np.float32(value)) + 0.0)
            for group, values in groups.items()
            for axis, value in zip("XYZ", values, strict=True)
        )

    def words(self) -> str:
        """Names and values of the offset and of further parameters with an effect, on one line.

        >>> Px4Parameters(offset=np.array([0.0282, -0.2002, -0.1369]), compass=1).words()
        'CAL_MAG1_OFF 0.0282, -0.2002, -0.1369 G'
        """
        parts = [f"CAL_MAG{self.compass}_OFF {list_text(self.offset)} G"]
        if not np.all(self.diagonal == 1):
            parts.append(f"SCALE {list_text(self.diagonal)}")
        if self.off_diagonal.any():
            parts.append(f"ODIAG {list_text(self.off_diagonal)}")
        if self.motor.any():
            parts.append(f"COMP {list_text(self.motor)}")
        return ", ".join(parts)

    def refuse_beyond(self) -> None:
        """Raise `NotExportable` for values out of the ranges of PX4's parameters."""
        largest = float(np.finfo(np.float32).max)
        checked = {
            "SCALE": (self.diagonal, (self.diagonal >= MIN_SCALE) & (self.diagonal <= MAX_SCALE)),
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
            f": PX4 accepts a SCALE of {MIN_SCALE:g} to {MAX_SCALE:g}, and float32 numbers. Check the unit of the "
            "recording and the field strength, and that the axes are those of the sensor",
        )


def mounting(rotation: int) -> Floats:
    """(3, 3) rotation R of a CAL_MAGn_ROT or SENS_BOARD_ROT, vehicle = R sensor; the identity for −1.

    Raises `UsageError` for an unknown number.

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


ANGLES: Final = ("ROLL", "PITCH", "YAW")


def mounting_rows(mounting: Mounting, compass: int) -> tuple[tuple[str, float], ...]:
    """Names and values to write: the angles, which are 0 for a mounting by its number, and ROT.

    >>> mounting_rows(TABLE.mounting(euler(180, 0, 0)), 1)[2:]
    (('CAL_MAG1_YAW', 0.0), ('CAL_MAG1_ROT', 8.0))
    """
    own = ((f"CAL_MAG{compass}_{axis}", angle) for axis, angle in zip(ANGLES, mounting.angles, strict=True))
    return (*own, (f"CAL_MAG{compass}_ROT", float(CUSTOM if mounting.number is None else mounting.number)))


def board_mounting(values: Mapping[str, float]) -> Floats:
    """(3, 3) mounting of the board, vehicle = R board: SENS_BOARD_ROT, then SENS_BOARD_X_OFF, Y_OFF and Z_OFF, degrees.

    >>> board_mounting({"SENS_BOARD_ROT": 4}) @ [1, 0, 0]                   # YAW_180
    array([-1.,  0.,  0.])
    """
    number = float(values.get("SENS_BOARD_ROT", 0))
    trim = [float(values.get(f"SENS_BOARD_{axis}_OFF", 0)) for axis in "XYZ"]
    turned = mounting(int(number)) if number in range(len(MOUNTINGS)) else np.eye(3)
    return euler(*trim) @ turned if np.isfinite(trim).all() and any(trim) else turned


def compasses(values: Iterable[str]) -> tuple[int, ...]:
    """Numbers of the compasses that have parameters among these names.

    >>> compasses(["CAL_MAG0_XOFF", "CAL_MAG2_ID", "CAL_MAG_SIDES"])
    (0, 2)
    """
    there = tuple(values)
    return tuple(n for n in COMPASSES if any(name.startswith(f"CAL_MAG{n}_") for name in there))


def of_device(values: Mapping[str, float], device_id: int) -> Px4Parameters | None:
    """Return the parameters that PX4 uses for the compass with this device id, or None.

    >>> of_device({"CAL_MAG2_ID": 396809, "CAL_MAG2_XOFF": 0.5}, 396809).offset
    array([0.5, 0. , 0. ])
    """
    if device_id == 0:
        return None
    known = (Px4Parameters.read(values, compass) for compass in compasses(values))
    return next((one for one in known if one.device_id is not None and one.device_id % 2**32 == device_id), None)


# the file

FLOAT, WHOLE = 9, 6
"""MAV_PARAM_TYPE_REAL32 and INT32, the last column of QGroundControl's file."""
WHOLE_SUFFIXES: Final = ("COMP_TYP", "_ROT", "_CHECK")
"""Suffixes of parameters with whole numbers."""
COMPENSATED: Final = (
    "COMP is in G per kA (CAL_MAG_COMP_TYP 2, current of the first battery) or at full throttle (1), added to a "
    "reading before OFF is removed; CAL_MAG_COMP_TYP is one for all compasses"
)


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the five columns that QGroundControl loads: vehicle, component, name, value, type.

    Raises as `Px4Parameters.of`.
    """

    def line(name: str, value: str) -> str:
        return f"1\t1\t{name}\t{value}\t{WHOLE if name.endswith(WHOLE_SUFFIXES) else FLOAT}"

    return _write_lines(calibration, line, asked)


def write_shell(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write lines for the shell of the vehicle; raises as `write`."""
    return _write_lines(calibration, lambda name, value: f"param set {name} {value}", asked)


def _write_lines(calibration: Calibration, line: Callable[[str, str], str], asked: ExportOptions) -> Written:
    """Write the parameters of one compass, by default the first, each as a line."""
    compass = 0 if asked.compass is None else asked.compass
    Affine.of(calibration, "G", who="PX4")  # refuses counts, and numbers out of float32
    new = remounting(calibration, asked.mounting, TABLE, after=False)
    turn = np.eye(3) if new is None else new.turn
    parameters = Px4Parameters.of(calibration, compass=compass).as_float32()
    values = dict([*(() if new is None else mounting_rows(new.mounting, compass)), *parameters.rows()])
    motor = split_motor_disturbance(calibration)[1]
    if motor is not None:
        values["CAL_MAG_COMP_TYP"] = MOTOR_QUANTITIES[motor.name]
    size = 1.0 if motor is None else DRIVE_UNITS[motor.name]
    of_estimator, its_notes = estimator_values(EKF2, calibration, asked)
    values |= of_estimator

    def apply(raw: Floats, value: float = 0.0) -> Floats:
        """Correct raw readings; `value` is a current in A, or a throttle as a share."""
        return parameters.apply(raw, value / size) @ turn.T

    its_mounting = "" if new else f", and CAL_MAG{compass}_ROT its mounting"
    notes = [
        *(rotation_notes(calibration) if new is None else [new.words(f"CAL_MAG{compass}_ROT"), EXTERNAL_ONLY]),
        f"CAL_MAG{compass}_ID must already be the device_id of this sensor{its_mounting}; {RESTART}",
        *[COMPENSATED] * (motor is not None),
        *its_notes,
    ]
    body = [line(name, f"{value:.9g}") for name, value in values.items()]
    compensated = None if motor is None else apply
    return Written(apply, body, values, notes, compensated=compensated, turn=None if new is None else turn)


def _compasses_with_offsets(values: Mapping[str, float]) -> list[int]:
    return [number for number in COMPASSES if f"CAL_MAG{number}_XOFF" in values]


FILE: Final = ParameterFile(Px4Parameters, _compasses_with_offsets, "CAL_MAG0_XOFF")
PX4: Final = Target(
    name="px4",
    use="PX4, file of QGroundControl",
    group="autopilots",
    suffix=".params",
    title="PX4",
    formula="m = R S (r - OFF), S of SCALE and ODIAG, OFF subtracted, R the mounting",
    unit="G",
    keeps="symmetric",
    storage="float32; SCALE 0.1 to 3",
    source="Magnetometer.hpp and .cpp, sensors/module.yaml",
    follows="motors",
    estimator="EKF2",
    compasses=range(4),
    mountings=TABLE,
    limits=tuple(
        Limit(f"CAL_MAG0_{axis}SCALE", "matrix", (at,), MIN_SCALE, MAX_SCALE)
        for axis, at in zip("XYZ", (0, 4, 8), strict=True)
    ),
    inertial=inertial.PX4,
    write=write,
    reader=TargetReader(rb"CAL_MAG", FILE.read, "parameters of PX4", FILE.which),
)
TARGETS: Final = (
    PX4,
    replace(
        PX4,
        name="px4-shell",
        use="PX4, lines for its shell",
        suffix=".txt",
        write=write_shell,
        inertial=inertial.PX4_SHELL,
    ),
)
