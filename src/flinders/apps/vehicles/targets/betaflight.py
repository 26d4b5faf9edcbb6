"""Betaflight's ``mag_calibration``: ``m = aligned − magZero``, three whole numbers of raw counts, and no soft iron.

>>> from flinders.core.calibration import Calibration
>>> written = write(Calibration(np.eye(3), [120.4, -31.6, 7.0], 400.0), ExportOptions())
>>> written.body[0], written.apply([520.0, -32.0, 7.0])
('set mag_calibration = 120,-32,7', array([400.,   0.,   0.]))
>>> read(b"set mag_calibration = 120,-32,7", "dump.txt", strength=400.0).offset
array([120., -32.,   7.])

The correction acts in the axes of the board, after ``align_mag``. These are the axes of ``magADC`` in the blackbox.

A rotation of the calibration goes into ``align_mag``: one of eight names, or CUSTOM with ``mag_align_roll``,
``mag_align_pitch`` and ``mag_align_yaw`` in tenths of a degree, R_z(yaw) R_y(pitch) R_x(roll) in the board's axes
forward, left and up. This holds from Betaflight 2026.6 on (pull request 14849); earlier versions turned by R_z(−yaw)
R_y(−pitch) R_x(−roll).

Source: Betaflight, ``cli/settings.c`` (mag_calibration, align_mag) and ``sensors/compass.c``; int16;
``alignSensorViaRotation`` of ``sensors/boardalignment.c``, ``buildRotationMatrix`` and ``matrixTrnVectorMul`` of
``common/vector.c``, pull request 14849.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.apps.vehicles.targets import inertial
from flinders.apps.vehicles.targets.remounting import ALIGNMENTS, DECIDEGREE, remounting, rotation_notes
from flinders.arrays import to_floats
from flinders.core.units import COUNTS
from flinders.errors import DocumentError
from flinders.targets._mounting import Mounting, MountingTable
from flinders.targets._numbers import VEHICLE, Affine, in_16_bits, in_vehicle_axes, parse_counts, settings
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

SETTING: Final = "mag_calibration"
ANGLES: Final = ("mag_align_roll", "mag_align_pitch", "mag_align_yaw")
MOUNTINGS: Final = MountingTable("Betaflight", "align_mag", ALIGNMENTS, step_deg=DECIDEGREE)
NAMES: Final = tuple(f"{SETTING} {axis}" for axis in "xyz")


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the offset in the axes of the board; a recording that was not in raw counts raises `UnitError`.

    Raises `NotExportable` if the omitted soft iron loses more than 0.5° of heading, or int16 cannot hold the offset.
    """
    in_place = in_vehicle_axes(calibration)
    affine = Affine.of(in_place, COUNTS, who="Betaflight")
    new = remounting(in_place, asked.mounting, MOUNTINGS, after=True)
    turn = np.eye(3) if new is None else new.turn
    zero = in_16_bits(turn @ affine.offset, NAMES)
    values = {**({} if new is None else _alignment_settings(new.mounting)), SETTING: ",".join(map(str, zero))}
    body = [*(f"set {name} = {value}" for name, value in values.items()), "save"]
    # no log holds the calibration in force, and magADC has it applied
    notes = [
        *(rotation_notes(in_place) if new is None else [new.words("align_mag"), *_custom_notes(new.mounting)]),
        "for readings recorded with mag_calibration = 0,0,0: it replaces what the board holds",
    ]
    written = None if new is None else turn
    return Written(lambda raw: raw @ turn.T - to_floats(zero), body, {**values, SETTING: zero}, notes, turn=written)


def _alignment_settings(mounting: Mounting) -> dict[str, str]:
    """Settings of ``align_mag`` for a mounting."""
    if mounting.number is not None:
        return {"align_mag": mounting.name}
    tenths = (str(round(angle / DECIDEGREE)) for angle in mounting.angles)
    return {"align_mag": "CUSTOM", **dict(zip(ANGLES, tenths, strict=True))}


def _custom_notes(mounting: Mounting) -> list[str]:
    """Notes on the conditions of a mounting."""
    by_angles = ["mag_align_roll, pitch and yaw are for Betaflight 2026.6 or newer: older versions rotate differently"]
    straight = "for a board with align_board_roll, pitch and yaw of 0, which turn the compass as well"
    return [*by_angles * (mounting.number is None), straight]


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the setting back, out of a dump or diff, for readings in the axes of the board; the matrix is the identity.

    `strength` is the length of a reading less the offset, in counts. It is required, since the file does not hold it.

    Raises `DocumentError` if the setting is missing, has two values, or is not three whole numbers of 16 bits.
    """
    value = settings(content, source, [SETTING]).get(SETTING)
    words = [] if value is None else value.split(",")
    if len(words) != len(NAMES):
        raise DocumentError(f"{source}: {SETTING} is {value or 'missing'}: need a line set {SETTING} = x,y,z")
    zero = parse_counts(dict(zip(NAMES, words, strict=True)), NAMES, source)
    if strength is None:
        raise DocumentError(
            f"{source}: holds an offset of {zero} counts, but not the length of readings: give "
            "the length of a reading less the offset, in counts",
            hint={"strength": None},
        )
    calibration = Affine(np.eye(3), to_floats(zero), strength).to_calibration(COUNTS, known=True)
    return replace(calibration, frame=VEHICLE)


TARGETS: Final = (
    Target(
        name="betaflight",
        use="Betaflight CLI",
        group="autopilots",
        suffix=".txt",
        title="Betaflight",
        formula="m = align(raw) - magZero",
        unit=COUNTS,
        keeps="offset",
        storage="int16, whole counts",
        source="cli/settings.c, sensors/compass.c",
        acts="mapped",
        lengths="as long as the sensor makes them",
        mountings=MOUNTINGS,
        inertial=inertial.BETAFLIGHT,
        write=write,
        reader=TargetReader(rb"(?i)\bset\s+mag_calibration\b", read, "a dump of Betaflight"),
    ),
)
