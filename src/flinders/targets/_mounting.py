"""Mounting of a compass on its vehicle, by the number, name or angles of a firmware.

>>> table = MountingTable("a board", "align", (("FLAT", 0.0, 0.0, 0.0), ("OVER", 180.0, 0.0, 0.0)))
>>> table.mounting(euler(179.99, 0, 0)).number, table.mounting(euler(170, 0, 0)).number
(1, None)
>>> table.mounting(euler(170, 0, 0)).angles
(170.0, 0.0, 0.0)
>>> table.read("over") @ [0, 1, 0]
array([ 0., -1.,  0.])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from flinders.arrays import Floats, to_floats
from flinders.errors import UsageError

Angles: TypeAlias = tuple[float, float, float]
"""Roll, pitch and yaw in degrees."""

MAX_TURN_DEG: Final = 0.05
"""Largest angle in degrees between two rotations that count as equal."""


def euler(roll: float, pitch: float, yaw: float) -> Floats:
    """(3, 3) rotation R_z(yaw) R_y(pitch) R_x(roll), vehicle = R sensor; angles in degrees, right angles are exact.

    >>> euler(90, 0, 0) @ [0, 1, 0]
    array([0., 0., 1.])
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(turns := np.deg2rad([roll, pitch, yaw])), np.sin(turns)
    turned = np.array([
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ])  # fmt: skip
    return to_floats(np.where(np.abs(turned) < 1e-15, 0.0, turned) + 0.0)


def angles(rotation: Floats) -> Angles:
    """Roll, pitch and yaw of a rotation in degrees, as for `euler`; roll is 0 if pitch is ±90°.

    >>> [round(angle, 9) for angle in angles(euler(10, -20, 30))], angles(euler(0, 90, 40))[2]
    ([10.0, -20.0, 30.0], 40.0)
    """
    across = math.hypot(rotation[2, 1], rotation[2, 2])
    pitch = math.atan2(-rotation[2, 0], across)
    if across < 1e-9:
        roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
    else:
        roll, yaw = math.atan2(rotation[2, 1], rotation[2, 2]), math.atan2(rotation[1, 0], rotation[0, 0])
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def in_words(rotation: Floats) -> str:
    """Words for a rotation, by its angles.

    >>> in_words(euler(0, -12, 3))
    'roll 0.00°, pitch −12.00°, yaw 3.00°'
    """
    named = zip(("roll", "pitch", "yaw"), angles(rotation), strict=True)
    return ", ".join(f"{name} {round(angle, 2) + 0.0:.2f}°" for name, angle in named).replace("-", "−")


def apart_deg(one: Floats, other: Floats) -> float:
    """Angle in degrees of the rotation from one rotation to the other.

    >>> round(apart_deg(euler(0, 0, 10), euler(0, 0, 10.001)), 6)
    0.001
    """
    return math.degrees(2 * math.asin(min(float(np.linalg.norm(one - other)) / math.sqrt(8), 1.0)))


def split_rotation(matrix: Floats) -> tuple[Floats, float]:
    """Symmetric P of matrix = Q P with a rotation Q, and the angle of Q in degrees, which a symmetric target omits.

    >>> rest, turn_deg = split_rotation(euler(0, 0, 5) @ np.diag([1.0, 2.0, 3.0]))
    >>> rest.round(9), round(turn_deg, 9)
    (array([[1., 0., 0.],
           [0., 2., 0.],
           [0., 0., 3.]]), 5.0)
    """
    if np.array_equal(matrix, matrix.T) and not _is_half_turn(matrix):
        return matrix, 0.0
    left, sizes, right = np.linalg.svd(matrix)
    root = right.T @ np.diag(sizes) @ right
    return (root + root.T) / 2, apart_deg(left @ right, np.eye(3))


def _is_half_turn(matrix: Floats) -> bool:
    """Whether a symmetric matrix turns by 180°: two of its eigenvalues are negative."""
    return int(np.count_nonzero(np.linalg.eigvalsh(matrix) < 0)) == 2


def turn_of(matrix: Floats) -> Floats | None:
    """(3, 3) rotation Q of matrix = Q P, which a symmetric target omits; None if its angle is negligible."""
    root, angle = split_rotation(matrix)
    if angle <= MAX_TURN_DEG:
        return None
    rotation: Floats = matrix @ np.linalg.inv(root)
    return rotation


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """A mounting in the form of a firmware."""

    number: int | None  #: number in the firmware's table; None if the angles are set instead
    name: str  #: name in the firmware's table; else the angles in words
    angles: Angles  #: angles in the convention of the firmware; all 0 if the number is set
    rotation: Floats  #: (3, 3) rotation by the firmware's own formula: vehicle = R sensor


@dataclass(frozen=True, slots=True)
class MountingTable:
    """Mountings of a firmware: those with numbers, and any other one by three angles."""

    # name of the firmware, and its setting for the number or name
    who: str
    setting: str
    rows: tuple[tuple[str, float, float, float], ...]  # name, and roll, pitch and yaw in degrees, as for `euler`
    sense: int = 1  # -1 if the firmware's angles have the opposite sign of those of `euler`
    step_deg: float = 0.0  # step of the firmware's angles in degrees; 0 if they are float32

    def rotation(self, number: int) -> Floats:
        """(3, 3) rotation of the mounting with a number."""
        return euler(*self.rows[number][1:])

    def by_angles(self, own: Angles) -> Floats:
        """(3, 3) rotation of three angles in the convention of the firmware."""
        roll, pitch, yaw = (self.sense * angle for angle in own)
        return euler(roll, pitch, yaw)

    def mounting(self, rotation: Floats) -> Mounting:
        """Mounting with a number if one is within `MAX_TURN_DEG` of a rotation; else the mounting by its angles."""
        misses = [apart_deg(rotation, self.rotation(number)) for number in range(len(self.rows))]
        nearest = misses.index(min(misses))
        if misses[nearest] <= MAX_TURN_DEG:
            return Mounting(nearest, self.rows[nearest][0], (0.0, 0.0, 0.0), self.rotation(nearest))
        roll, pitch, yaw = (self._round_angle(self.sense * angle) for angle in angles(rotation))
        own = roll, pitch, yaw
        return Mounting(None, in_words(rotation), own, self.by_angles(own))

    def read(self, words: str) -> Floats:
        """(3, 3) rotation of a number, a name, or three angles in degrees with commas between, as in the firmware.

        A name may have the prefix ``ROTATION_``, as in the firmware's source. Raises `UsageError` for anything else.
        """
        word = words.strip().upper().removeprefix("ROTATION_")
        by_name = {name: number for number, (name, *_) in enumerate(self.rows)}
        if word in by_name or (word.isdecimal() and int(word) < len(self.rows)):
            return self.rotation(by_name[word] if word in by_name else int(word))
        own = _parse_angles(word)
        if own is None:
            raise UsageError(
                f"{words[:40]!r} is no mounting of {self.who}: need its {self.setting}, which is 0 "
                f"({self.rows[0][0]}) to {len(self.rows) - 1} ({self.rows[-1][0]}), or roll, pitch and yaw in degrees, "
                "with the signs of the firmware",
                hint={"mounting": "0,180,90"},
            )
        return self.by_angles(own)

    def _round_angle(self, angle: float) -> float:
        """An angle as the firmware stores it."""
        if self.step_deg:
            return round(angle / self.step_deg) * self.step_deg + 0.0
        return float(np.float32(round(angle, 6))) + 0.0


def _parse_angles(word: str) -> Angles | None:
    """Three finite numbers with commas between; None for other texts."""
    try:
        roll, pitch, yaw = map(float, word.split(","))
    except ValueError:
        return None
    return (roll, pitch, yaw) if all(map(math.isfinite, (roll, pitch, yaw))) else None
