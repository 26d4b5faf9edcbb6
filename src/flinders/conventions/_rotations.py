"""Mountings by number: the table that MAVLink, PX4 and ArduPilot share, and what a symmetric matrix cannot hold.

>>> name, roll, pitch, yaw = ROTATIONS[10]
>>> name, euler(roll, pitch, yaw) @ [1, 0, 0]                  # turned over, its x to the right
('ROLL_180_YAW_90', array([0., 1., 0.]))

Sources: MAVLink's ``MAV_SENSOR_ROTATION``; PX4's ``src/lib/conversion/rotation.h``. Number 38 is 68° and 293° there,
and 68.8° and 293.3° in ArduPilot; from 41 on PX4 and ArduPilot mean different mountings by one number.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import floats
from flinders.errors import NotExportable, figures

if TYPE_CHECKING:
    from flinders.arrays import Floats

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
    held = right.T @ np.diag(sizes) @ right
    cosine = (np.trace(left @ right) - 1) / 2
    return (held + held.T) / 2, float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))


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
    held, angle = without_turn(matrix)
    if angle <= MOST_TURN_DEG:
        return None
    rotation: Floats = matrix @ np.linalg.inv(held)
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
    held, angle = without_turn(matrix)
    if angle > MOST_TURN_DEG and not lossy:
        raise NotExportable(
            f"the calibration turns readings by {figures(angle)}°, and {who}'s symmetric matrix cannot: flinders "
            f"export --lossy writes the rest, and says what roll, pitch and yaw then belong into the mounting ({by})",
            beyond=(beyond,),
            turn_deg=angle,
        )
    return held
