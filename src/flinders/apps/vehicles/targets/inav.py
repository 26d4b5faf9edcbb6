"""INAV's ``magzero`` and ``maggain``: ``m = (raw − zero) 1024 / gain``, whole numbers, in the axes of the sensor.

A gain is the radius of its axis in counts, so that corrected readings have length 1024. With D the diagonal nearest to
the matrix and F the length of corrected readings in counts, gain = F / D.

>>> from flinders.core.calibration import Calibration
>>> written = write(Calibration(np.diag([1.25, 1.0, 0.8]), [120.4, -31.6, 7.0], 400.0), ExportOptions())
>>> print(*written.body, sep=chr(10))
set magzero_x = 120
set magzero_y = -32
set magzero_z = 7
set maggain_x = 320
set maggain_y = 400
set maggain_z = 500
save
>>> written.apply([440.0, -32.0, 7.0])
array([1024.,    0.,    0.])
>>> read(chr(10).join(written.body).encode(), "dump.txt").matrix.diagonal()
array([1.25, 1.  , 0.8 ])

A rotation of the calibration goes into ``align_mag``, one of eight names, or into ``align_mag_roll``,
``align_mag_pitch`` and ``align_mag_yaw`` in tenths of a degree. If one of these angles is not 0, they replace
``align_mag``: R_z(−yaw) R_y(−pitch) R_x(−roll) in the axes forward, left and up, without the alignment of the board.

Source: INAV, ``sensors/compass.c`` at 005b1ee7, ``rotationMatrixFromAngles`` of ``common/maths.c`` at 063f3509,
``rotationMatrixRotateVector`` of ``common/vector.h``; int16, and an integer division.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.vehicles.targets import inertial
from flinders.apps.vehicles.targets.remounting import ALIGNMENTS, DECIDEGREE, remounting, rotation_notes
from flinders.arrays import Floats, to_floats
from flinders.core.units import COUNTS
from flinders.errors import DocumentError
from flinders.targets._mounting import Mounting, MountingTable
from flinders.targets._numbers import INT16, in_16_bits, of_radii, offset_and_radii, parse_counts, settings
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

UNIT_LENGTH: Final = 1024
"""Length of a corrected reading."""
ZEROS: Final = ("magzero_x", "magzero_y", "magzero_z")
ANGLES: Final = ("align_mag_roll", "align_mag_pitch", "align_mag_yaw")
MOUNTINGS: Final = MountingTable("INAV", "align_mag", ALIGNMENTS, sense=-1, step_deg=DECIDEGREE)
BOARD_CONDITION: Final = "for a board with align_board_roll, pitch and yaw of 0"
GAINS: Final = ("maggain_x", "maggain_y", "maggain_z")


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the settings as lines for the CLI of INAV; a recording that was not in raw counts raises `UnitError`.

    Raises `NotExportable` if the settings lose more than 0.5° of heading, or int16 cannot hold the numbers.
    """
    new = remounting(calibration, asked.mounting, MOUNTINGS, after=False)
    turn = None if new is None else new.turn
    offset, radii = offset_and_radii(calibration, who="INAV", turn=turn)
    zero, gain = in_16_bits(offset, ZEROS), in_16_bits(radii, GAINS, lowest=1)
    values = {
        **({} if new is None else _alignment_settings(new.mounting)),
        **dict(zip((*ZEROS, *GAINS), (*zero, *gain), strict=True)),
    }
    body = [*(f"set {name} = {value}" for name, value in values.items()), "save"]
    # no log holds the calibration in force, and magADC has it applied
    notes = [
        *(rotation_notes(calibration) if new is None else [new.words("align_mag"), BOARD_CONDITION]),
        "for readings recorded with magzero 0 and maggain 1024 on each axis: it replaces what the board holds",
    ]

    def apply(raw: Floats) -> Floats:
        corrected = np.trunc((raw - to_floats(zero)) * UNIT_LENGTH / to_floats(gain)) + 0.0
        return corrected if turn is None else corrected @ turn.T

    return Written(apply, body, values, notes, turn=turn)


def _alignment_settings(mounting: Mounting) -> dict[str, str | int]:
    """Settings of a mounting: a name with angles of 0, or angles alone."""
    name: dict[str, str | int] = {} if mounting.number is None else {"align_mag": mounting.name}
    tenths = (round(angle / DECIDEGREE) for angle in mounting.angles)
    return {**name, **dict(zip(ANGLES, tenths, strict=True))}


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the settings back, out of a dump, for readings in the axes of the sensor.

    `strength` is the length of corrected readings in counts, by default the geometric mean of the gains.

    Raises `DocumentError` if a setting is missing, has two values, or is out of INAV's range.
    """
    pairs = settings(content, source, [*ZEROS, *GAINS])
    missing = [name for name in (*ZEROS, *GAINS) if name not in pairs]
    if missing:
        raise DocumentError(
            f"{source}: no {', '.join(missing)}: need all six, magzero_x to maggain_z. INAV's diff leaves out "
            "defaults: save the output of dump"
        )
    zero, gain = parse_counts(pairs, ZEROS, source), parse_counts(pairs, GAINS, source, between=(1, INT16[1]))
    return of_radii(zero, to_floats(gain), strength)


TARGETS: Final = (
    Target(
        name="inav",
        use="INAV CLI",
        group="autopilots",
        suffix=".txt",
        title="INAV",
        formula="m = align((raw - magzero) 1024 / maggain)",
        unit=COUNTS,
        keeps="diagonal",
        storage="int16, whole counts; the result in whole numbers as well",
        source="sensors/compass.c at 005b1ee7",
        lengths="1024 long",
        mountings=MOUNTINGS,
        inertial=inertial.INAV,
        write=write,
        reader=TargetReader(rb"(?i)\bset\s+mag(?:zero|gain)_[xyz]\b", read, "a dump of INAV"),
    ),
)
