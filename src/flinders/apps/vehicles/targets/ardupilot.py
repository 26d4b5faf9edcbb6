"""ArduPilot's compass parameters: ``m = I ((r + OFS) SCALE) + MOT x``.

r is the reading of the compass in mG, already turned into the axes of the vehicle (forward, right, down). x is the
battery current in A or the throttle from 0 to 1, as selected by COMPASS_MOTCT. I is symmetric, with DIA on its diagonal
and ODI off the diagonal. A calibration here is corrected = A (raw − b), so

    SCALE = mean of the diagonal of A,   DIA, ODI = A / SCALE,   OFS = −b

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.1, 1.0, 0.9]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("mG"))
>>> for name, value in ArduPilotParameters.of(calibration, compass=2).rows()[:5]:
...     print(f"{name},{value:g}")
COMPASS_OFS2_X,-100
COMPASS_OFS2_Y,200
COMPASS_OFS2_Z,0
COMPASS_DIA2_X,1.1
COMPASS_DIA2_Y,1
>>> ArduPilotParameters.of(calibration).apply([[100.0, -200.0, 500.0]])  # in mG: 10, −20 and 50 µT
array([[  0.,   0., 450.]])

ArduPilot adds offsets, after the mounting; PX4 and most others subtract them, in the axes of the sensor.

A rotation of the calibration goes into COMPASS_ORIENT: r = R(orientation) sensor for an external compass, and for
101 and 102 R is the Euler rotation 321 of CUST_ROT1 or CUST_ROT2, in degrees. Internal compasses turn with the board.

Sources: ``AP_Compass_Backend::correct_field`` and ``rotate_field``, ``AP_CustomRotation::init`` at 2ddaf4b5 (ArduPilot,
GPL-3; the formulas were taken from them and none of their code); ``AP_Math/rotations.h`` and MAVLink's
``MAV_SENSOR_ROTATION`` for the mountings; limits of ``CompassCalibrator`` and of the check before arming. Older
firmware added the motor term before I; the version of the change is unknown. Both agree if I is the identity or there
is no motor term.
"""

from __future__ import annotations

import re
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
    symmetric_matrix,
)
from flinders.apps.vehicles.targets.estimators import EKF3, estimator_values
from flinders.apps.vehicles.targets.remounting import remounting, rotation_notes
from flinders.arrays import Floats, check_vectors, to_floats
from flinders.core.units import PER_UNIT
from flinders.errors import NotExportable, figures
from flinders.targets._mounting import Mounting, MountingTable, euler
from flinders.targets._numbers import (
    MOTOR_QUANTITIES,
    VEHICLE,
    Affine,
    in_recorded_axes,
    in_vehicle_axes,
    shift_in_recorded_axes,
    split_motor_disturbance,
)
from flinders.targets._target import ExportOptions, Limit, Target, TargetReader, Written

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    from flinders.core.calibration import Calibration

MG: Final = PER_UNIT["mG"]
"""µT in one mG."""
COMPASSES: Final = (1, 2, 3)
MAX_OFFSET_MG: Final = 1800.0
"""Default of COMPASS_OFFS_MAX, mG: a vehicle with longer offsets does not arm."""
MIN_DIAGONAL, MAX_DIAGONAL = 0.2, 5.0
MAX_OFF_DIAGONAL: Final = 1.0
"""Ranges of DIA and ODI that ArduPilot's own calibrator accepts."""
MAX_SCALE: Final = 1.5
"""A COMPASS_SCALE beyond 1/1.5 to 1.5 counts as 1."""
LIMITS: Final = (
    Limit("COMPASS_OFS", "offset", (0, 1, 2), 0.0, MAX_OFFSET_MG, unit=MG),
    *(
        Limit(f"COMPASS_DIA_{axis}", "iron", (at,), MIN_DIAGONAL, MAX_DIAGONAL)
        for axis, at in zip("XYZ", (0, 4, 8), strict=True)
    ),
    *(
        Limit(f"COMPASS_ODI_{axis}", "iron", (at,), -MAX_OFF_DIAGONAL, MAX_OFF_DIAGONAL)
        for axis, at in zip("XYZ", (1, 2, 5), strict=True)
    ),
    Limit("COMPASS_SCALE", "scale", (0,), 1 / MAX_SCALE, MAX_SCALE),
)
OFF, BY_THROTTLE, BY_CURRENT = 0, MOTOR_QUANTITIES["throttle"], MOTOR_QUANTITIES["current"]
"""Values of COMPASS_MOTCT: the quantity that multiplies COMPASS_MOT."""

NOT_WRITTEN: Final = (
    "COMPASS_MOT and COMPASS_MOTCT are not written: the values on board stay and belong to the old DIA, ODI and SCALE; "
    "if they are not 0 and DIA, ODI or SCALE changes, run CompassMot again"
)
"""Note on a motor compensation that is not written.

MOT x is added after I and SCALE. For new I' and SCALE' it would have to be I' SCALE' (I SCALE)⁻¹ MOT.
"""
COMPENSATED: Final = (
    "COMPASS_MOT is in mG per A (COMPASS_MOTCT 2) or at full throttle (1), added after DIA, ODI and SCALE; "
    "COMPASS_MOTCT is one for all compasses: set COMPASS_MOT of the others, or leave them 0"
)


@dataclass(frozen=True, slots=True, eq=False)
class ArduPilotParameters(CompassParameters):
    """The parameters of one compass, 1 to 3.

    - `offset`: COMPASS_OFS, (3,) in mG
    - `diagonal`: COMPASS_DIA, (3,); all zero counts as all one
    - `off_diagonal`: COMPASS_ODI, (3,) entries xy, xz and yz
    - `motor`: COMPASS_MOT, (3,) in mG/A, or mG at full throttle
    - `motor_by`: COMPASS_MOTCT: 0 off, 1 throttle, 2 current
    - `device_id`: COMPASS_DEV_ID
    """

    compass: int = 1
    scale: float = 0.0  #: COMPASS_SCALE; 0, or a value beyond 1/1.5 to 1.5, counts as 1
    orientation: int = 0  #: COMPASS_ORIENT, a row of `ORIENTATIONS`; ArduPilot uses it for external compasses only
    #: COMPASS_EXTERNAL: the compass is turned by its own orientation, not by that of the board
    external: bool = False
    #: (3,), degrees: CUST_ROT1 or CUST_ROT2, if `orientation` is one of `CUSTOM`: roll, pitch and yaw
    custom: Floats = field(default_factory=lambda: np.zeros(3))

    who: ClassVar[str] = "ArduPilot"
    unit: ClassVar[str] = "mG"
    frame: ClassVar[str] = VEHICLE
    compasses: ClassVar[tuple[int, ...]] = COMPASSES

    @classmethod
    def of(cls, calibration: Calibration, *, compass: int = 1, mounting: Floats | None = None) -> Self:
        """Convert a calibration to parameters; if it depends on a current or a throttle, COMPASS_MOT is −W P.

        A rotation of the calibration is left out: it belongs in the mounting, see `remounting`.

        Parameters
        ----------
        calibration : Calibration
            In the axes of the vehicle, as in a log of ArduPilot; or in those of the sensor, with its `mounting`.
        compass : int
            1, 2 or 3.
        mounting : (3, 3) float, optional
            Rotation R from the axes of the sensor to those of the vehicle; the parameters then hold R A Rᵀ and R b.

        Raises
        ------
        UnitError
            For a calibration in counts.
        NotExportable
            For values out of ArduPilot's range: `beyond` names them, ``evidence["wanted"]`` holds them.
        UsageError
            For another number of a compass.
        """
        root = cls.symmetric(calibration, compass)
        plain, follows = split_motor_disturbance(calibration)
        turn = np.eye(3) if mounting is None else mounting
        matrix = turn @ root @ turn.T
        scale = float(np.trace(matrix) / 3)
        if not 0 < scale < np.inf:
            name = f"COMPASS_SCALE{_digit(compass)}"
            raise NotExportable(
                f"COMPASS_SCALE would be {figures(scale, 4)}, and needs to be positive: an axis is reversed; "
                "map the axes of the recording instead",
                beyond=(name,),
                wanted={name: scale},
            )
        diagonal, off_diagonal = symmetric_entries(matrix / scale)
        parameters = cls(
            offset=-(turn @ in_recorded_axes(plain)[1]) / MG,
            diagonal=diagonal,
            off_diagonal=off_diagonal,
            scale=scale,
            compass=compass,
        )
        if follows is not None:
            motor = -matrix @ turn @ shift_in_recorded_axes(calibration, follows) / MG
            parameters = replace(parameters, motor=motor, motor_by=MOTOR_QUANTITIES[follows.name])
        parameters.refuse_beyond()
        return parameters

    @classmethod
    def read(cls, values: Mapping[str, float], compass: int = 1) -> Self:
        """Read the parameters of one compass from a vehicle's parameters, in either naming scheme.

        Missing and non-finite values are the default; another number of a compass raises `UsageError`.

        >>> ArduPilotParameters.read({"COMPASS_OFS3_X": -12.0, "COMPASS3_SCALE": 1.1}, 3).scale
        1.1
        """
        cls.refuse_unknown(compass)

        def one(group: str, axis: str = "", default: float = 0.0) -> float:
            given = (float(values.get(name, np.nan)) for name in names(group, compass, axis))
            return next((value for value in given if np.isfinite(value)), default)

        def three(group: str, default: float = 0.0) -> Floats:
            return np.array([one(group, axis, default) for axis in ("_X", "_Y", "_Z")])

        device, orientation = int(one("DEV_ID")), int(one("ORIENT"))
        custom = [float(values.get(name, 0.0)) for name in custom_names(orientation)]
        return cls(
            offset=three("OFS"),
            diagonal=three("DIA", 1.0),
            off_diagonal=three("ODI"),
            scale=one("SCALE"),
            motor=three("MOT"),
            motor_by=motor_kind(values, "COMPASS_MOTCT"),
            orientation=orientation,
            custom=np.nan_to_num(custom) if custom else np.zeros(3),
            external=one("EXTERNAL") > 0,
            compass=compass,
            device_id=device if device > 0 else None,
        )

    @property
    def gain(self) -> float:
        """Value of SCALE that ArduPilot uses: 1 if the parameter is 0 or out of range."""
        return self.scale if 1 / MAX_SCALE <= self.scale <= MAX_SCALE else 1.0

    @property
    def iron(self) -> Floats:
        """(3, 3) symmetric matrix I of DIA and ODI; its diagonal is 1 if DIA is all zero, as in ArduPilot."""
        return symmetric_matrix(self.diagonal if self.diagonal.any() else np.ones(3), self.off_diagonal)

    @property
    def matrix(self) -> Floats:
        """(3, 3) matrix A = SCALE I of corrected = A (raw − b)."""
        return self.gain * self.iron

    @property
    def centre(self) -> Floats:
        """(3,) centre b = −OFS of corrected = A (raw − b), in µT."""
        return -MG * self.offset + 0.0

    @classmethod
    def mounting_names(cls, compass: int) -> tuple[str, ...]:
        """Names of COMPASS_EXTERNAL and COMPASS_ORIENT; `custom_names` has those of a rotation set by angles."""
        return names("EXTERNAL", compass)[0], names("ORIENT", compass)[0]

    @property
    def own_mounting(self) -> Floats | None:
        """(3, 3) R, vehicle = R sensor; None for a compass that turns with the board, or an unknown number.

        >>> turned = {"COMPASS_EXTERNAL": 1.0, "COMPASS_ORIENT": 101.0, "CUST_ROT1_YAW": 90.0}
        >>> ArduPilotParameters.read(turned).own_mounting @ [1, 0, 0]
        array([0., 1., 0.])
        """
        if not self.external:
            return None
        if self.orientation in CUSTOM:
            return euler(*self.custom)
        return MOUNTINGS.rotation(self.orientation) if 0 <= self.orientation < len(ORIENTATIONS) else None

    @property
    def is_identity(self) -> bool:
        """Whether the parameters correct nothing."""
        return not (self.offset.any() or self.has_disturbances) and np.array_equal(self.matrix, np.eye(3))

    def apply(self, raw: ArrayLike, drive: ArrayLike = 0.0) -> Floats:
        """Correct readings as ArduPilot does, (..., 3) to (..., 3) mG in the axes of the vehicle.

        `drive`, (...), is the current in A or the throttle from 0 to 1, as selected by `motor_by`.
        """
        readings: Floats = (check_vectors(raw, "raw", finite=False) + self.offset) @ self.matrix.T + self._motor(drive)
        return readings

    def unapply(self, corrected: ArrayLike, drive: ArrayLike = 0.0, *, motor_offset: ArrayLike | None = None) -> Floats:
        """Return raw readings, r = I⁻¹ (m − MOT x) / SCALE − OFS, the inverse of `apply`.

        `motor_offset`, (..., 3) mG, is MOT x itself, if the log holds it. Raises `ArrayError` if I is singular.

        >>> offset, off_diagonal = np.array([-100.0, 0, 50]), np.array([0.1, 0, 0])
        >>> set_up = ArduPilotParameters(offset=offset, off_diagonal=off_diagonal, scale=1.2)
        >>> set_up.unapply(set_up.apply([1.0, 2.0, 3.0])).round(9)
        array([1., 2., 3.])
        """
        added = (
            self._motor(drive) if motor_offset is None else check_vectors(motor_offset, "motor_offset", finite=False)
        )
        back = self.inverse()
        with np.errstate(invalid="ignore", over="ignore"):
            readings: Floats = (check_vectors(corrected, "corrected", finite=False) - added) @ back.T - self.offset
        return readings

    def motor_shift(self, name: str) -> Floats:  # noqa: ARG002 - in mG for both
        """(3,) shift P = −A⁻¹ MOT of raw readings, in µT/A or µT at full throttle.

        ArduPilot adds MOT x to a corrected reading.
        """
        shift: Floats = -MG * np.linalg.solve(self.matrix, self.motor)
        return shift

    def rows(self) -> tuple[tuple[str, float], ...]:
        """Names and values to write: OFS, DIA, ODI, SCALE, and MOT with COMPASS_MOTCT where there is a motor term.

        Values are rounded to the float32 that ArduPilot keeps.
        """
        groups = {"OFS": self.offset, "DIA": self.diagonal, "ODI": self.off_diagonal, "SCALE": np.array([self.scale])}
        if self.motor.any():
            groups["MOT"] = self.motor
        rows = [
            (names(group, self.compass, axis)[0], float(np.float32(value)) + 0.0)
            for group, values in groups.items()
            for axis, value in zip(("_X", "_Y", "_Z") if len(values) == 3 else ("",), values, strict=True)
        ]
        return (*rows, *([("COMPASS_MOTCT", float(self.motor_by))] if self.motor.any() else []))

    def as_float32(self) -> Self:
        """Return the parameters after ArduPilot has stored each value as a float32."""
        return replace(super(ArduPilotParameters, self).as_float32(), scale=float(np.float32(self.scale)))

    def words(self) -> str:
        """Names and values of the offset and of further parameters with an effect, on one line.

        >>> ArduPilotParameters(offset=np.array([-12.0, 40.5, -93.0]), compass=2).words()
        'COMPASS_OFS2 -12, 40.5, -93 mG'
        """
        digit = _digit(self.compass)
        parts = [f"COMPASS_OFS{digit} {list_text(self.offset)} mG"]
        if not np.array_equal(self.iron, np.eye(3)):
            parts.append(f"COMPASS_DIA{digit} {list_text(np.diag(self.iron))}")
            parts.append(f"COMPASS_ODI{digit} {list_text(self.off_diagonal)}")
        if self.gain != 1.0:
            parts.append(f"COMPASS_SCALE{digit} {self.gain:.6g}")
        if self.has_disturbances:
            unit = "mG/A" if self.motor_by == BY_CURRENT else "mG at full throttle"
            parts.append(f"COMPASS_MOT{digit} {list_text(self.motor)} {unit}")
        return "; ".join(parts)

    def refuse_beyond(self) -> None:
        """Raise `NotExportable` for values that ArduPilot ignores or rejects, at arming or in its calibrator."""
        digit = _digit(self.compass)
        beyond: dict[str, tuple[float, str]] = {}
        length = float(np.linalg.norm(self.offset))
        if not length <= MAX_OFFSET_MG:
            words = f"{figures(length, 4)} mG long, and a vehicle arms with at most {MAX_OFFSET_MG:,.0f}"
            beyond[f"COMPASS_OFS{digit}"] = length, f"{words} (COMPASS_OFFS_MAX)"
        for name, values, low, high in (
            ("DIA", self.diagonal, MIN_DIAGONAL, MAX_DIAGONAL),
            ("ODI", self.off_diagonal, -MAX_OFF_DIAGONAL, MAX_OFF_DIAGONAL),
        ):
            for axis, value in zip("XYZ", values, strict=True):
                if not low < value < high:
                    words = f"{figures(value, 4)}, and needs to lie between {low:g} and {high:g}"
                    beyond[f"COMPASS_{name}{digit}_{axis}"] = float(value), words
        if not 1 / MAX_SCALE <= self.scale <= MAX_SCALE:
            words = (
                f"{figures(self.scale, 4)}, and ArduPilot ignores values not between {1 / MAX_SCALE:.3f} and "
                f"{MAX_SCALE:g}: corrected readings would be {figures(1 / self.scale, 3)} times as long. Check the "
                "unit of the recording and the field strength"
            )
            beyond[f"COMPASS_SCALE{digit}"] = self.scale, words
        advice = ". Remove or demagnetise iron near the compass, mount it elsewhere, or check the recording"
        refuse_values(beyond, advice)

    def _motor(self, drive: ArrayLike) -> Floats:
        """(..., 3) motor compensation MOT x in mG; 0 if COMPASS_MOTCT is off."""
        return to_floats(drive, "drive")[..., np.newaxis] * (self.motor if self.has_disturbances else np.zeros(3))


# mountings

EXACT_38: Final = (90, 68.8, 293.3)
"""ArduPilot's angles of ROLL_90_PITCH_68_YAW_293, from the entries of its matrix."""

ORIENTATIONS: Final = (
    *ROTATIONS[:38],
    (ROTATIONS[38][0], *EXACT_38),
    *ROTATIONS[39:],
    *mountings("PITCH_7 ROLL_45 ROLL_315"),
)
"""Name, roll, pitch and yaw in degrees of COMPASS_ORIENT 0 to 43."""

CUSTOM: Final = {101: "CUST_ROT1", 102: "CUST_ROT2"}
"""Numbers of mountings that are set by parameters: roll, pitch and yaw in degrees, with _ROLL, _PITCH and _YAW."""
MOUNTINGS: Final = MountingTable("ArduPilot", "COMPASS_ORIENT", ORIENTATIONS)
EXTERNAL_ONLY: Final = (
    "COMPASS_ORIENT turns external compasses only: COMPASS_EXTERNAL must be 1, and AHRS_ORIENTATION and the other "
    "compasses must not use CUST_ROT1; restart the vehicle afterwards"
)


def custom_names(orientation: int) -> tuple[str, ...]:
    """Names of the angles of a mounting that is set by parameters; none for others.

    >>> custom_names(102), custom_names(8)
    (('CUST_ROT2_ROLL', 'CUST_ROT2_PITCH', 'CUST_ROT2_YAW'), ())
    """
    prefix = CUSTOM.get(orientation)
    return tuple(f"{prefix}_{axis}" for axis in ("ROLL", "PITCH", "YAW")) if prefix else ()


def mounting_rows(mounting: Mounting, compass: int, orientation: int = 101) -> tuple[tuple[str, float], ...]:
    """Names and values of the parameters of a mounting; `orientation` is a number of `CUSTOM` for a mounting by angles.

    >>> mounting_rows(MOUNTINGS.mounting(euler(0, 0, 90)), 2)
    (('COMPASS_ORIENT2', 2.0),)
    >>> [name for name, _ in mounting_rows(MOUNTINGS.mounting(euler(0, 0, 91)), 1)][:3]
    ['CUST_ROT_ENABLE', 'CUST_ROT1_ROLL', 'CUST_ROT1_PITCH']
    """
    name = names("ORIENT", compass)[0]
    if mounting.number is not None:
        return ((name, float(mounting.number)),)
    own = zip(custom_names(orientation), mounting.angles, strict=True)
    return (("CUST_ROT_ENABLE", 1.0), *own, (name, float(orientation)))


def orientation_name(orientation: int) -> str:
    """Name of a mounting, from its number in COMPASS_ORIENT.

    >>> orientation_name(8), orientation_name(101), orientation_name(77)
    ('ROLL_180', 'CUST_ROT1', 'not known')
    """
    if 0 <= orientation < len(ORIENTATIONS):
        return ORIENTATIONS[orientation][0]
    return CUSTOM.get(orientation, "not known")


# names of parameters

OF_COMPASS: Final = re.compile(r"COMPASS_(OFS|DIA|ODI|SCALE|MOT|ORIENT|EXTERNAL|EXTERN|DEV_ID)([23]?)(_[XYZ])?")
"""Pattern of a parameter of one compass in the first naming scheme: group, number, axis."""


def compasses(values: Iterable[str]) -> tuple[int, ...]:
    """Numbers of the compasses that have parameters among these names.

    >>> compasses(["COMPASS_OFS_X", "COMPASS_OFS3_X", "COMPASS_USE2"])
    (1, 3)
    """
    there = set(values)
    return tuple(compass for compass in COMPASSES if there.intersection(names("OFS", compass, "_X")))


def names(group: str, compass: int, axis: str = "") -> tuple[str, str]:
    """Names of a parameter of a compass, in each naming scheme.

    >>> names("OFS", 2, "_X"), names("EXTERNAL", 3)
    (('COMPASS_OFS2_X', 'COMPASS2_OFS_X'), ('COMPASS_EXTERN3', 'COMPASS3_EXTERN'))
    """
    short = "EXTERN" if group == "EXTERNAL" else group
    first = f"COMPASS_{group}" if compass == 1 else f"COMPASS_{short}{compass}"
    return f"{first}{axis}", f"COMPASS{compass}_{short}{axis}"


def spellings(name: str) -> tuple[str, str]:
    """Names of a parameter in both naming schemes; `name` is that in the first. Parameters of no compass have one name.

    >>> spellings("COMPASS_OFS2_X"), spellings("COMPASS_SCALE"), spellings("CUST_ROT1_YAW")
    (('COMPASS_OFS2_X', 'COMPASS2_OFS_X'), ('COMPASS_SCALE', 'COMPASS1_SCALE'), ('CUST_ROT1_YAW', 'CUST_ROT1_YAW'))
    """
    match = OF_COMPASS.fullmatch(name)
    if match is None:
        return name, name
    group, digit, axis = match.groups()
    return names("EXTERNAL" if group.startswith("EXTERN") else group, int(digit or 1), axis or "")


def _digit(compass: int) -> str:
    """Digit of a compass in names such as COMPASS_OFS2_X; none for the first."""
    return "" if compass == 1 else str(compass)


# the file


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the parameters of one compass, by default the first; raises as `ArduPilotParameters.of`."""
    compass = 1 if asked.compass is None else asked.compass
    in_place = in_vehicle_axes(calibration)
    Affine.of(in_place, "mG", who="ArduPilot")  # refuses counts, and numbers out of float32
    new = remounting(in_place, asked.mounting, MOUNTINGS, after=True)
    turn = None if new is None else new.turn
    parameters = ArduPilotParameters.of(in_place, compass=compass, mounting=turn).as_float32()
    values = dict([*(() if new is None else mounting_rows(new.mounting, compass)), *parameters.rows()])
    of_estimator, its_notes = estimator_values(EKF3, calibration, asked)
    values |= of_estimator
    body = [f"{name},{value:.9g}" for name, value in values.items()]
    has_motor = parameters.has_disturbances

    def apply(raw: Floats, drive: ArrayLike = 0.0) -> Floats:
        return parameters.apply(raw if turn is None else raw @ turn.T, drive)

    notes = [
        *(rotation_notes(in_place) if new is None else [new.words("COMPASS_ORIENT"), EXTERNAL_ONLY]),
        COMPENSATED if has_motor else NOT_WRITTEN,
        *its_notes,
    ]
    return Written(apply, body, values, notes, compensated=apply if has_motor else None, turn=turn)


FILE: Final = ParameterFile(ArduPilotParameters, compasses, "COMPASS_OFS_X")
TARGETS: Final = (
    Target(
        name="ardupilot",
        use="ArduPilot parameters",
        group="autopilots",
        suffix=".param",
        title="ArduPilot",
        formula="m = I ((r + OFS) SCALE), I of DIA and ODI, OFS added",
        unit="mG",
        keeps="symmetric",
        storage="float32; OFS up to 1800 long, DIA 0.2 to 5, ODI -1 to 1, SCALE 1/1.5 to 1.5",
        source="AP_Compass_Backend::correct_field, CompassCalibrator",
        acts="mapped",
        follows="motors",
        estimator="EKF3",
        compasses=range(1, 4),
        mountings=MOUNTINGS,
        limits=LIMITS,
        inertial=inertial.ARDUPILOT,
        write=write,
        # excludes pins of the same name in Betaflight
        reader=TargetReader(
            rb"(?s)\A(?!.*resource COMPASS_).*COMPASS1?_", FILE.read, "parameters of ArduPilot", FILE.which
        ),
    ),
)
