"""Betaflight's ``mag_calibration``: ``m = aligned − magZero``, three whole numbers of raw counts, and no soft iron.

>>> from flinders.core.calibration import Calibration
>>> found = write(Calibration(np.eye(3), [120.4, -31.6, 7.0], 400.0), ExportOptions())
>>> found.body[0], found.apply([520.0, -32.0, 7.0])
('set mag_calibration = 120,-32,7', array([400.,   0.,   0.]))
>>> read(b"set mag_calibration = 120,-32,7", "dump.txt", strength=400.0).offset
array([120., -32.,   7.])

It acts in the axes of the board, after ``align_mag``: those of ``magADC`` in its blackbox.

Source: Betaflight, ``cli/settings.c`` (mag_calibration) and ``sensors/compass.c``; int16.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import floats
from flinders.core.units import COUNTS
from flinders.errors import DocumentError
from flinders.targets._numbers import counts, in_16_bits, settings
from flinders.targets._target import VEHICLE, Affine, ExportOptions, Target, TargetReader, Written, acting

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration

SETTING: Final = "mag_calibration"
NAMES: Final = tuple(f"{SETTING} {axis}" for axis in "xyz")


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the offset in the axes of the board; a recording that was not in raw counts raises `UnitError`.

    Raises `NotExportable` where the soft iron left out costs more than a degree of heading, or int16 cannot hold
    the offset.
    """
    exact = Affine.of(calibration, COUNTS, who="Betaflight", acts=acting("mapped", calibration)).offset
    zero = in_16_bits(exact, NAMES)
    body = [f"set {SETTING} = {','.join(map(str, zero))}", "save"]
    # no log tells what was in force, and magADC has it removed
    notes = ["for readings recorded with mag_calibration = 0,0,0: it replaces what the board holds"]
    return Written(lambda raw: raw - floats(zero), body, {SETTING: zero}, notes)


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the setting back, out of a dump or diff, for readings in the axes of the board; the matrix is the identity.

    `strength`, counts: length of a reading once the offset is removed; it has to be given, since no other number
    tells it.

    Raises `DocumentError` where it is missing, stands there with two values, or is not three whole numbers of 16
    bits.
    """
    value = settings(content, source, [SETTING]).get(SETTING)
    words = [] if value is None else value.split(",")
    if len(words) != len(NAMES):
        raise DocumentError(f"{source}: {SETTING} is {value or 'missing'}: need a line set {SETTING} = x,y,z")
    zero = counts(dict(zip(NAMES, words, strict=True)), NAMES, source)
    if strength is None:
        raise DocumentError(
            f"{source}: holds an offset of {zero} counts, and nothing tells how long readings are: give "
            "strength= in counts, the length of a reading less the offset"
        )
    calibration = Affine(np.eye(3), floats(zero), strength).to_calibration(COUNTS, known=True)
    return replace(calibration, frame=VEHICLE)


TARGETS: Final = (
    Target(
        name="betaflight",
        use="Betaflight CLI",
        suffix=".txt",
        title="Betaflight",
        formula="m = align(raw) - magZero",
        unit=COUNTS,
        keeps="offset",
        storage="int16, whole counts",
        source="cli/settings.c, sensors/compass.c",
        acts="mapped",
        lengths="as long as the sensor makes them",
        write=write,
        reader=TargetReader(rb"(?i)\bset\s+mag_calibration\b", read, "a dump of Betaflight"),
    ),
)
