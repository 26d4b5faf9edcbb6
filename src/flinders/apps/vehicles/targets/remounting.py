"""The rotation of a calibration as a new mounting of the compass.

The matrix W = Q P of a calibration both corrects (P, symmetric) and turns (Q). Firmware that stores only P receives Q
as a mounting. If the mounting was A during the recording, the new mounting is

    Q A        if the firmware corrects after the mounting (ArduPilot, Betaflight)
    A Q        if it corrects before the mounting (PX4, INAV)

>>> from flinders.core.calibration import Calibration
>>> from flinders.targets._mounting import euler
>>> turned = Calibration(euler(0, 0, 90), [0, 0, 0], 50.0, rotation="estimated")
>>> table = MountingTable("a board", "align", tuple((f"YAW_{yaw}", 0.0, 0.0, yaw) for yaw in (0, 90, 180, 270)))
>>> remounting(turned, euler(0, 0, 180), table, after=True).mounting.name
'YAW_270'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.targets._difference import MAX_LOSS_DEG, heading_deg
from flinders.targets._mounting import MountingTable, apart_deg, in_words, turn_of
from flinders.targets._numbers import in_recorded_axes

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.targets._mounting import Mounting

ALIGNMENTS: Final = (
    *((f"CW{angle}", 0.0, 0.0, -float(angle)) for angle in (0, 90, 180, 270)),
    *((f"CW{angle}FLIP", 0.0, 180.0, -float(angle)) for angle in (0, 90, 180, 270)),
)
"""Betaflight's and INAV's ``align_mag``, in their axes: forward, left and up."""
DECIDEGREE: Final = 0.1
"""Step of an angle in Betaflight and INAV, degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Remounting:
    """A mounting that replaces the one in force."""

    mounting: Mounting
    turn: Floats  #: (3, 3) Q, rounded as the firmware will hold it, in the recorded axes
    in_force: Floats  #: (3, 3) the mounting that is replaced

    def words(self, setting: str) -> str:
        """Sentence on the old and the new mounting."""
        return (
            f"{setting} is written with the numbers: {self.mounting.name} in place of {in_words(self.in_force)}, with "
            f"the rotation of the calibration ({in_words(self.turn)}). Write both, or neither"
        )


def remounting(
    calibration: Calibration, in_force: Floats | None, table: MountingTable, *, after: bool
) -> Remounting | None:
    """Return a mounting that includes the rotation of a calibration; None if negligible or undetermined.

    `in_force` is the (3, 3) mounting A of the compass during the recording, vehicle = A sensor. `after` says whether
    the firmware corrects after the mounting.
    """
    turn = turn_of(in_recorded_axes(calibration)[0])
    if in_force is None or turn is None or np.linalg.det(turn) < 0:
        return None
    if heading_deg(apart_deg(turn, np.eye(3))) <= MAX_LOSS_DEG:
        return None
    mounting = table.mounting(turn @ in_force if after else in_force @ turn)
    turn = mounting.rotation @ in_force.T if after else in_force.T @ mounting.rotation
    return Remounting(mounting, turn, in_force)


def rotation_notes(calibration: Calibration) -> list[str]:
    """Notes on a rotation that is not written as a mounting."""
    turn = turn_of(in_recorded_axes(calibration)[0])
    return [] if turn is None else [f"left out: a rotation of {in_words(turn)}, which belongs in the mounting"]
