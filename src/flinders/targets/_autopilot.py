"""What ArduPilot and PX4 share: mountings by number, a symmetric matrix in six numbers, motors, parameter files.

>>> name, roll, pitch, yaw = ROTATIONS[10]
>>> name, euler(roll, pitch, yaw) @ [1, 0, 0]                  # turned over, its x to the right
('ROLL_180_YAW_90', array([0., 1., 0.]))

Sources: MAVLink's ``MAV_SENSOR_ROTATION``; PX4's ``src/lib/conversion/rotation.h``. Number 38 is 68° and 293° there,
and 68.8° and 293.3° in ArduPilot; from 41 on PX4 and ArduPilot mean different mountings by one number.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import floats
from flinders.core.disturbance import Disturbance
from flinders.errors import ArrayError, DocumentError, InputError, NotExportable, counted, figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

ROTATIONS: Final[tuple[tuple[str, float, float, float], ...]] = (
    ("NONE", 0, 0, 0), ("YAW_45", 0, 0, 45), ("YAW_90", 0, 0, 90), ("YAW_135", 0, 0, 135),
    ("YAW_180", 0, 0, 180), ("YAW_225", 0, 0, 225), ("YAW_270", 0, 0, 270), ("YAW_315", 0, 0, 315),
    ("ROLL_180", 180, 0, 0), ("ROLL_180_YAW_45", 180, 0, 45), ("ROLL_180_YAW_90", 180, 0, 90),
    ("ROLL_180_YAW_135", 180, 0, 135), ("PITCH_180", 0, 180, 0), ("ROLL_180_YAW_225", 180, 0, 225),
    ("ROLL_180_YAW_270", 180, 0, 270), ("ROLL_180_YAW_315", 180, 0, 315), ("ROLL_90", 90, 0, 0),
    ("ROLL_90_YAW_45", 90, 0, 45), ("ROLL_90_YAW_90", 90, 0, 90), ("ROLL_90_YAW_135", 90, 0, 135),
    ("ROLL_270", 270, 0, 0), ("ROLL_270_YAW_45", 270, 0, 45), ("ROLL_270_YAW_90", 270, 0, 90),
    ("ROLL_270_YAW_135", 270, 0, 135), ("PITCH_90", 0, 90, 0), ("PITCH_270", 0, 270, 0),
    ("PITCH_180_YAW_90", 0, 180, 90), ("PITCH_180_YAW_270", 0, 180, 270), ("ROLL_90_PITCH_90", 90, 90, 0),
    ("ROLL_180_PITCH_90", 180, 90, 0), ("ROLL_270_PITCH_90", 270, 90, 0), ("ROLL_90_PITCH_180", 90, 180, 0),
    ("ROLL_270_PITCH_180", 270, 180, 0), ("ROLL_90_PITCH_270", 90, 270, 0), ("ROLL_180_PITCH_270", 180, 270, 0),
    ("ROLL_270_PITCH_270", 270, 270, 0), ("ROLL_90_PITCH_180_YAW_90", 90, 180, 90), ("ROLL_90_YAW_270", 90, 0, 270),
    ("ROLL_90_PITCH_68_YAW_293", 90, 68, 293), ("PITCH_315", 0, 315, 0), ("ROLL_90_PITCH_315", 90, 315, 0),
)  # fmt: skip
"""Name, roll, pitch and yaw in degrees of 0 to 40."""

MOST_TURN_DEG: Final = 0.05
"""A symmetric matrix cannot turn; a calibration that turns by more is refused."""


def euler(roll: float, pitch: float, yaw: float) -> Floats:
    """(3, 3) R_z(yaw) R_y(pitch) R_x(roll), angles in degrees: vehicle = R sensor; right angles are exact.

    >>> euler(90, 0, 0) @ [0, 1, 0]
    array([0., 0., 1.])
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(turns := np.deg2rad([roll, pitch, yaw])), np.sin(turns)
    turned = np.array([
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ])  # fmt: skip
    return floats(np.where(np.abs(turned) < 1e-15, 0.0, turned) + 0.0)


def without_turn(matrix: Floats) -> tuple[Floats, float]:
    """The symmetric P of matrix = Q P with Q a rotation, and the angle of Q in degrees: all a symmetric target loses.

    >>> held, turn_deg = without_turn(euler(0, 0, 5) @ np.diag([1.0, 2.0, 3.0]))
    >>> held.round(9), round(turn_deg, 9)
    (array([[1., 0., 0.],
           [0., 2., 0.],
           [0., 0., 3.]]), 5.0)
    """
    if np.array_equal(matrix, matrix.T):
        return matrix, 0.0
    left, sizes, right = np.linalg.svd(matrix)
    root = right.T @ np.diag(sizes) @ right
    cosine = (np.trace(left @ right) - 1) / 2
    return (root + root.T) / 2, float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))


def angles_of(rotation: Floats) -> tuple[float, float, float]:
    """Roll, pitch and yaw in degrees, as `euler` takes them.

    >>> [round(angle, 9) for angle in angles_of(euler(10, -20, 170))]
    [10.0, -20.0, 170.0]
    """
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = math.asin(min(max(-float(rotation[2, 0]), -1.0), 1.0))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def turn_of(matrix: Floats) -> Floats | None:
    """(3, 3) the rotation Q of matrix = Q P that a symmetric target cannot hold; None where it hardly turns."""
    root, angle = without_turn(matrix)
    if angle <= MOST_TURN_DEG:
        return None
    rotation: Floats = matrix @ np.linalg.inv(root)
    return rotation


def said(rotation: Floats) -> str:
    """A rotation in words, as autopilots take it.

    >>> said(euler(0, -12, 3))
    'roll 0.00°, pitch −12.00°, yaw 3.00°'
    """
    named = zip(("roll", "pitch", "yaw"), angles_of(rotation), strict=True)
    return ", ".join(f"{name} {round(angle, 2) + 0.0:.2f}°" for name, angle in named).replace("-", "−")


def symmetric(matrix: Floats, who: str, beyond: str, *, by: str, lossy: bool = False) -> Floats:
    """(3, 3) the symmetric matrix of what hardly turns, for an autopilot that holds six numbers.

    Raises
    ------
    NotExportable
        For a matrix that turns readings by more than `MOST_TURN_DEG`, unless `lossy`; `by` is what sets the mounting
        instead.
    """
    root, angle = without_turn(matrix)
    if angle > MOST_TURN_DEG and not lossy:
        raise NotExportable(
            f"the calibration turns readings by {figures(angle)}°, and {who}'s symmetric matrix cannot: flinders "
            f"export --lossy writes the rest, and says what roll, pitch and yaw then belong into the mounting ({by})",
            beyond=(beyond,),
            turn_deg=angle,
        )
    return root


# a symmetric matrix in six numbers


def of_six(diagonal: Floats, off_diagonal: Floats) -> Floats:
    """(3, 3) the symmetric matrix of its diagonal and its entries xy, xz and yz.

    >>> of_six(np.ones(3), np.array([0.1, 0.2, 0.3]))
    array([[1. , 0.1, 0.2],
           [0.1, 1. , 0.3],
           [0.2, 0.3, 1. ]])
    """
    xy, xz, yz = off_diagonal
    return floats(np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]]))


def in_six(matrix: Floats) -> tuple[Floats, Floats]:
    """(3,) diagonal and (3,) entries xy, xz and yz of a symmetric matrix."""
    return np.diag(matrix), matrix[[0, 0, 1], [1, 2, 2]]


def refuse_values(beyond: Mapping[str, tuple[float, str]], advice: str) -> None:
    """Raise `NotExportable` for parameters, each with its value and what it would be, unless there are none."""
    if beyond:
        wanted = {name: value for name, (value, _) in beyond.items()}
        clauses = "; ".join(f"{name} would be {words}" for name, (_, words) in beyond.items())
        raise NotExportable(f"{clauses}{advice}", beyond=wanted, wanted=wanted)


def inverse(matrix: Floats, words: str) -> Floats:
    """(3, 3) the inverse of a correction whose parameters are `words`; `ArrayError` where it flattens readings."""
    try:
        return floats(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        raise ArrayError(
            f"{words}: this flattens all readings into a plane, so that what the compass read is lost"
        ) from None


def listed(values: Iterable[float]) -> str:
    """Write numbers for a sentence, to six digits."""
    return ", ".join(f"{value + 0.0:.6g}" for value in values)


# motors

MOTORS: Final = {"current": 2, "throttle": 1}
"""What both autopilots follow, the better witness first, and the number of their COMPASS_MOTCT and CAL_MAG_COMP_TYP."""


def followed(calibration: Calibration) -> tuple[Calibration, Disturbance | None]:
    """Split off the disturbance that an autopilot compensates from the calibration with motors at rest.

    >>> from flinders.core.calibration import Calibration
    >>> both = (Disturbance("current", [0.5, 0, 0], highest=20), Disturbance("throttle", [3, 0, 0], highest=1))
    >>> plain, motor = followed(Calibration(np.eye(3), [10, 0, 0], 50.0, disturbances=both))
    >>> plain.offset, motor.name
    (array([10.,  0.,  0.]), 'current')
    """
    ours = {disturbance.name: disturbance for disturbance in calibration.disturbances}
    motor = next((ours[name] for name in MOTORS if name in ours), None)
    if motor is None:
        return calibration.at(), None
    return calibration.at(**{motor.name: 0.0}), motor


def read_motor(name: str, per_unit: Floats) -> tuple[Disturbance, ...]:
    """What an autopilot takes off for its motors, as a disturbance; none where it is nothing.

    Parameters do not say at which currents they were found; a throttle goes from 0 to 1.

    >>> print(*read_motor("current", np.array([0.5, 0.0, -0.3])))
    current: 0.5, 0, -0.3 per A, from 0 A, range unknown
    """
    if not np.any(per_unit):
        return ()
    return (Disturbance(name, per_unit, highest=1.0 if name == "throttle" else 0.0),)


# parameter files

NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,15}")
"""A parameter has a name of up to 16 characters."""


def parse(text: str, source: str = "parameters") -> dict[str, float]:
    r"""Read a parameter file, as Mission Planner, MAVProxy or QGroundControl write it.

    Parameters
    ----------
    text : str
        ``NAME,value`` or ``NAME value`` a line, or the five columns of QGroundControl with the name in the third; what
        follows # is a remark. Of a name that comes twice, the last counts.
    source : str
        For messages.

    Raises
    ------
    InputError
        For lines that are no parameters; names the first, and how many there are.

    Examples
    --------
    >>> parse("# my boat\nCOMPASS_OFS_X,-12.5\nCOMPASS_OFS_Y  40\n1\t1\tCOMPASS_OFS_Z\t-93.0\t9\n")
    {'COMPASS_OFS_X': -12.5, 'COMPASS_OFS_Y': 40.0, 'COMPASS_OFS_Z': -93.0}
    """
    values: dict[str, float] = {}
    bad: list[tuple[int, str]] = []
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1):
        words = [word for word in re.split(r"[,=\s]+", line.split("#", 1)[0].strip()) if word]
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
            f"{source} line {number} is no parameter ({line[:40]!r}; {counted(len(bad), 'such line')}): need "
            "NAME,value a line, such as COMPASS_OFS_X,-12.5"
        )
    return values


def chosen(there: Sequence[int], wanted: int | None, source: str, need: str) -> int:
    """Which of several compasses: the one that is wanted, or the only one.

    Raises
    ------
    DocumentError
        Where it is not there, or there are several; `need` names the parameters of one.

    Examples
    --------
    >>> chosen([1, 2], None, "vehicle.param", "COMPASS_OFS_X")
    Traceback (most recent call last):
    flinders.errors.DocumentError: vehicle.param: holds compass 1 and 2: say which one with --compass
    """
    if not there:
        raise DocumentError(f"{source}: holds no offsets of a compass: need {need}")
    numbers = " and ".join(map(str, there))
    if wanted is None and len(there) > 1:
        raise DocumentError(f"{source}: holds compass {numbers}: say which one with --compass")
    if wanted is not None and wanted not in there:
        raise DocumentError(f"{source}: holds compass {numbers} and not {wanted}: check --compass")
    return there[0] if wanted is None else wanted


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
