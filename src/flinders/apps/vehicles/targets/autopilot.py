"""Common parts of ArduPilot and PX4: parameters of a compass, mountings by number, motors, parameter files.

Both correct with a symmetric matrix in six numbers, an offset, and a vector per A or at full throttle.

>>> from flinders.targets._mounting import euler
>>> name, roll, pitch, yaw = ROTATIONS[10]
>>> name, euler(roll, pitch, yaw) @ [1, 0, 0]                  # turned over, its x to the right
('ROLL_180_YAW_90', array([0., 1., 0.]))

Sources: MAVLink's ``MAV_SENSOR_ROTATION``; PX4's ``src/lib/conversion/rotation.h``. Number 38 is 68° and 293° there,
and 68.8° and 293.3° in ArduPilot; from 41 on PX4 and ArduPilot mean different mountings by one number.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Final, Self

import numpy as np

from flinders.arrays import Floats, to_floats
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import (
    ArrayError,
    DocumentError,
    InputError,
    NotExportable,
    UnitError,
    UsageError,
    count_text,
)
from flinders.targets._mounting import angles, split_rotation
from flinders.targets._numbers import (
    MOTOR_QUANTITIES,
    decode_text,
    in_recorded_axes,
    round_to_single,
    split_motor_disturbance,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flinders.targets._mounting import Angles

USUAL_STRENGTH_UT: Final = 50.0
"""Default length of corrected readings, µT: parameters do not hold the strength of the field."""
ANGLE: Final = re.compile(r"(ROLL|PITCH|YAW)_(\d+)")


def mountings(names: str) -> tuple[tuple[str, float, float, float], ...]:
    """Name of each mounting, and the roll, pitch and yaw in degrees that the name states.

    >>> mountings("NONE ROLL_180_YAW_45")
    (('NONE', 0.0, 0.0, 0.0), ('ROLL_180_YAW_45', 180.0, 0.0, 45.0))
    """
    angles = {name: dict(ANGLE.findall(name)) for name in names.split()}
    return tuple(
        (name, float(one.get("ROLL", 0)), float(one.get("PITCH", 0)), float(one.get("YAW", 0)))
        for name, one in angles.items()
    )


ROTATIONS: Final = mountings("""
    NONE YAW_45 YAW_90 YAW_135 YAW_180 YAW_225 YAW_270 YAW_315 ROLL_180 ROLL_180_YAW_45 ROLL_180_YAW_90
    ROLL_180_YAW_135 PITCH_180 ROLL_180_YAW_225 ROLL_180_YAW_270 ROLL_180_YAW_315 ROLL_90 ROLL_90_YAW_45
    ROLL_90_YAW_90 ROLL_90_YAW_135 ROLL_270 ROLL_270_YAW_45 ROLL_270_YAW_90 ROLL_270_YAW_135 PITCH_90 PITCH_270
    PITCH_180_YAW_90 PITCH_180_YAW_270 ROLL_90_PITCH_90 ROLL_180_PITCH_90 ROLL_270_PITCH_90 ROLL_90_PITCH_180
    ROLL_270_PITCH_180 ROLL_90_PITCH_270 ROLL_180_PITCH_270 ROLL_270_PITCH_270 ROLL_90_PITCH_180_YAW_90
    ROLL_90_YAW_270 ROLL_90_PITCH_68_YAW_293 PITCH_315 ROLL_90_PITCH_315
""")
"""Name, roll, pitch and yaw in degrees of the mountings 0 to 40, which ArduPilot and PX4 share."""


# the parameters of a compass


@dataclass(frozen=True, slots=True, eq=False)
class CompassParameters:
    """The parameters of one compass."""

    offset: Floats = field(default_factory=lambda: np.zeros(3))  # (3,), in `unit`
    diagonal: Floats = field(default_factory=lambda: np.ones(3))  # (3,): diagonal of the symmetric matrix
    off_diagonal: Floats = field(default_factory=lambda: np.zeros(3))  # (3,): its entries xy, xz and yz
    # (3,): added field in `unit`, per A or kA of current, or at full throttle
    motor: Floats = field(default_factory=lambda: np.zeros(3))
    motor_by: int = 0  # quantity that multiplies `motor`: one of `MOTOR_QUANTITIES`, or 0 for none
    compass: int = 0  # number of the compass
    device_id: int | None = None

    who: ClassVar[str]
    unit: ClassVar[str]
    frame: ClassVar[str] = "sensor"
    compasses: ClassVar[tuple[int, ...]]

    @classmethod
    def read(cls, values: Mapping[str, float], compass: int) -> Self:
        """Read one compass from a vehicle's parameters; `UsageError` for another number of a compass."""
        raise NotImplementedError

    @property
    def matrix(self) -> Floats:
        """(3, 3) matrix A of corrected = A (raw − b)."""
        return symmetric_matrix(self.diagonal, self.off_diagonal)

    @property
    def centre(self) -> Floats:
        """(3,) centre b of corrected = A (raw − b), in µT."""
        raise NotImplementedError

    @property
    def has_disturbances(self) -> bool:
        """Whether the parameters compensate for motors."""
        return self.motor_by in MOTOR_QUANTITIES.values() and bool(self.motor.any())

    def as_float32(self) -> Self:
        """Return the parameters after the autopilot has stored each value as a float32."""
        diagonal, off_diagonal = round_to_single(self.diagonal), round_to_single(self.off_diagonal)
        stored = replace(self, offset=round_to_single(self.offset), motor=round_to_single(self.motor))
        return replace(stored, diagonal=diagonal, off_diagonal=off_diagonal)

    def words(self) -> str:
        """Names and values of the offset and of further parameters with an effect, on one line."""
        raise NotImplementedError

    @classmethod
    def mounting_names(cls, compass: int) -> tuple[str, ...]:
        """Names of the parameters with the mounting of a compass."""
        raise NotImplementedError

    @property
    def own_mounting(self) -> Floats | None:
        """(3, 3) mounting R, vehicle = R sensor; None for a compass on the board, or an unknown mounting."""
        raise NotImplementedError

    @property
    def mounting_angles(self) -> Angles | None:
        """Roll, pitch and yaw of the compass's own mounting, in degrees; None without one."""
        own = self.own_mounting
        if own is None:
            return None
        roll, pitch, yaw = (round(angle, 6) + 0.0 for angle in angles(own))
        return roll, pitch, yaw

    def inverse(self) -> Floats:
        """(3, 3) inverse A⁻¹ of the matrix; `ArrayError` if A is singular."""
        try:
            return to_floats(np.linalg.inv(self.matrix))
        except np.linalg.LinAlgError:
            raise ArrayError(
                f"{self.words()}: this matrix flattens all readings into a plane, so raw readings cannot be recovered"
            ) from None

    def motor_shift(self, name: str) -> Floats:
        """(3,) shift of raw readings, in µT/A or µT at full throttle."""
        raise NotImplementedError

    def to_calibration(self, field_strength: float, *, known: bool = False) -> Calibration:
        """Convert the parameters to a calibration, without a mounting, with motors if `has_disturbances`.

        Parameters lack the length of corrected readings: `field_strength` gives it in µT, and `known` says whether it
        was measured. They also lack the range of currents in which the motors were calibrated; a throttle goes from 0
        to 1. Raises `ArrayError` for a singular matrix.
        """
        raw = Unit.of(self.unit)
        plain = Calibration(self.matrix, self.centre, field_strength, known, raw=raw, frame=self.frame)
        if not self.has_disturbances:
            return plain
        name = next(name for name, number in MOTOR_QUANTITIES.items() if number == self.motor_by)
        motor = Disturbance(name, self.motor_shift(name), highest=1.0 if name == "throttle" else 0.0)
        return replace(plain, disturbances=(motor,))

    @classmethod
    def refuse_unknown(cls, compass: int) -> None:
        """Raise `UsageError` for a number that no compass of the autopilot has."""
        if compass not in cls.compasses:
            numbers = f"{', '.join(map(str, cls.compasses[:-1]))} and {cls.compasses[-1]}"
            raise UsageError(f"compass {compass}: {cls.who} keeps parameters of compass {numbers}")

    @classmethod
    def symmetric(cls, calibration: Calibration, compass: int) -> Floats:
        """(3, 3) the symmetric matrix of a calibration without motors, in the recorded axes, without its rotation.

        Raises `UnitError` for a calibration in counts; `UsageError` for another number of a compass.
        """
        cls.refuse_unknown(compass)
        if calibration.unit != MICROTESLA:
            others = "mG, uT" if cls.unit == "G" else "G, uT"
            raise UnitError(
                f"the calibration is in counts, and {cls.who}'s parameters are in {cls.unit}: calibrate again in "
                f"{cls.unit} (or {others} …), or give the sensor's µT per count",
                hint={"unit": cls.unit, "scale": None},
            )
        return split_rotation(in_recorded_axes(split_motor_disturbance(calibration)[0])[0])[0]


def symmetric_matrix(diagonal: Floats, off_diagonal: Floats) -> Floats:
    """(3, 3) symmetric matrix with a diagonal and entries xy, xz and yz.

    >>> symmetric_matrix(np.ones(3), np.array([0.1, 0.2, 0.3]))
    array([[1. , 0.1, 0.2],
           [0.1, 1. , 0.3],
           [0.2, 0.3, 1. ]])
    """
    xy, xz, yz = off_diagonal
    return to_floats(np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]]))


def symmetric_entries(matrix: Floats) -> tuple[Floats, Floats]:
    """(3,) diagonal and (3,) entries xy, xz and yz of a symmetric matrix."""
    return np.diag(matrix), matrix[[0, 0, 1], [1, 2, 2]]


def motor_kind(values: Mapping[str, float], name: str) -> int:
    """Number of a quantity of `MOTOR_QUANTITIES` that a parameter selects; 0 for other values."""
    kind = float(values.get(name, 0.0))
    return int(kind) if kind in MOTOR_QUANTITIES.values() else 0


def refuse_values(beyond: Mapping[str, tuple[float, str]], advice: str) -> None:
    """Raise `NotExportable` if there are parameters out of range, given with value and description."""
    if beyond:
        wanted = {name: value for name, (value, _) in beyond.items()}
        clauses = "; ".join(f"{name} would be {words}" for name, (_, words) in beyond.items())
        raise NotExportable(f"{clauses}{advice}", beyond=wanted, wanted=wanted)


def list_text(values: Iterable[float]) -> str:
    """Write numbers for a sentence, to six digits, with commas."""
    return ", ".join(f"{value + 0.0:.6g}" for value in values)


# parameter files

NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,15}")
"""Pattern of the name of a parameter, up to 16 characters."""


@dataclass(frozen=True, slots=True)
class ParameterFile:
    """Reader of one compass in a parameter file; `read` and `which` are used by a `TargetReader`."""

    kind: type[CompassParameters]
    # ``offsets(values)`` returns the numbers of the compasses with offsets
    offsets: Callable[[Mapping[str, float]], Sequence[int]]
    need: str  # example of a needed parameter, for messages

    def read(
        self, content: bytes, source: str, *, strength: float | None = None, compass: int | None = None
    ) -> Calibration:
        """Read the calibration of one compass from a parameter file.

        `strength` in µT is by default `USUAL_STRENGTH_UT`; `compass` is by default the only one in the file.
        """
        parameters = self.parameters(content, source, compass)
        return parameters.to_calibration(strength or USUAL_STRENGTH_UT, known=strength is not None)

    def which(self, content: bytes, source: str, compass: int | None = None) -> tuple[int, int | None]:
        """Number of the compass that `read` uses, and its device id if in the file."""
        parameters = self.parameters(content, source, compass)
        return parameters.compass, parameters.device_id % 2**32 if parameters.device_id else None

    def parameters(self, content: bytes, source: str, compass: int | None) -> CompassParameters:
        """Read the wanted compass, or the only one; `InputError` if it is missing, or the choice is open."""
        values = parse(decode_text(content, source), source)
        there = self.offsets(values)
        if not there:
            raise DocumentError(f"{source}: holds no offsets of a compass: need {self.need} and so on")
        numbers = " and ".join(map(str, there))
        if compass is None and len(there) > 1:
            raise DocumentError(f"{source}: holds compass {numbers}: choose one", hint={"compass": None})
        if compass is not None and compass not in there:
            raise DocumentError(
                f"{source}: holds compass {numbers} and not {compass}: check which one is meant", hint={"compass": None}
            )
        return self.kind.read(values, there[0] if compass is None else compass)


def parse(text: str, source: str = "parameters") -> dict[str, float]:
    r"""Read a parameter file, as Mission Planner, MAVProxy or QGroundControl write it; `source` names it in messages.

    Lines are ``NAME,value``, ``NAME value``, ``param set NAME value`` or the five columns of QGroundControl with the
    name in the third; text after # is a remark. For a repeated name, the last value counts. Other lines raise
    `InputError`, which states the first and their number.

    >>> parse("# my boat\nCOMPASS_OFS_X,-12.5\nCOMPASS_OFS_Y  40\n1\t1\tCOMPASS_OFS_Z\t-93.0\t9\n")
    {'COMPASS_OFS_X': -12.5, 'COMPASS_OFS_Y': 40.0, 'COMPASS_OFS_Z': -93.0}
    """
    values: dict[str, float] = {}
    bad: list[tuple[int, str]] = []
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        bare = line.split("#", 1)[0].strip().removeprefix("param set ")
        words = [word for word in re.split(r"[,=\s]+", bare) if word]
        if not words:
            continue
        name, value = (words[2:4] if len(words) == 5 else [*words, ""])[:2]
        parsed = _number(value)
        if NAME.fullmatch(name) and parsed is not None:
            values[name] = parsed
        else:
            bad.append((number, line.strip()))
    if bad:
        number, line = bad[0]
        raise InputError(
            f"{source} line {number} is no parameter ({line[:40]!r}; {count_text(len(bad), 'such line')}): need "
            "NAME,value a line, such as COMPASS_OFS_X,-12.5"
        )
    return values


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
