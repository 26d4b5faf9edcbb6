"""Parameters of PX4, as QGroundControl's file or as lines for its shell: ``m = R S (r − OFF)``, in gauss.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.exporters import Asked
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.1, 1.0, 0.9]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("G"))
>>> print(*write_shell(found, Asked()).body[:2], sep=chr(10))
param set CAL_MAG0_XOFF 0.100000001
param set CAL_MAG0_YOFF -0.200000003
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import Affine
from flinders.conventions._driven import followed
from flinders.conventions._parsing import chosen, decoded
from flinders.conventions._recorded import in_recorded_axes
from flinders.conventions._rotations import said, turn_of
from flinders.conventions.ardupilot import parse
from flinders.conventions.px4 import BY_CURRENT, BY_THROTTLE, COMPASSES, INTERNAL, KILO, Parameters
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="PX4",
    formula="m = R S (r - OFF), S of SCALE and ODIAG, OFF subtracted, R the mounting",
    unit="G",
    keeps="symmetric",
    storage="float32; SCALE 0.1 to 3",
    source="Magnetometer.hpp and .cpp, sensors/module.yaml",
    follows="motors",
)
FLOAT: Final = 9
"""MAV_PARAM_TYPE_REAL32, the last column of QGroundControl's file."""
WHOLE: Final = 6
"""MAV_PARAM_TYPE_INT32."""
COMPENSATED: Final = (
    "COMP is in G per kA (CAL_MAG_COMP_TYP 2, current of the first battery) or at full throttle (1), added to a "
    "reading before OFF is taken off; CAL_MAG_COMP_TYP is one for all compasses"
)

LEFT_OUT: Final = (
    "left out: a rotation of {turn}. It belongs into the mounting, before the rotation that is set now: put the "
    "product of both into CAL_MAG{compass}_ROLL, PITCH and YAW, which recent versions of PX4 have; the numbers stay as "
    "they are"
)


def write(calibration: Calibration, asked: Asked) -> Written:
    """Write the five columns that QGroundControl loads: vehicle, component, name, value, type.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        For values that PX4 does not take.
    UsageError
        For a compass that there is not.
    """
    return _written(calibration, lambda name, value: f"1\t1\t{name}\t{value}\t{_type(name)}", asked)


def write_shell(calibration: Calibration, asked: Asked) -> Written:
    """Write lines for the shell of the vehicle; raises as `write`."""
    return _written(calibration, lambda name, value: f"param set {name} {value}", asked)


def _written(calibration: Calibration, line: Callable[[str, str], str], asked: Asked) -> Written:
    compass = 0 if asked.compass is None else asked.compass
    Affine.of(calibration, SHEET.unit, who=SHEET.title)  # refuses counts, and numbers beyond all bounds
    parameters = Parameters.of(calibration, compass=compass, rotation=INTERNAL, lossy=asked.lossy).as_held()
    values: dict[str, float] = dict(parameters.rows())
    driven: Callable[[Floats, float], Floats] | None = None
    if (motor := followed(calibration)[1]) is not None:
        values["CAL_MAG_COMP_TYP"] = BY_CURRENT if motor.name == "current" else BY_THROTTLE
        size = KILO if motor.name == "current" else 1.0
        driven = lambda raw, value: parameters.apply(raw, value / size)  # noqa: E731 - in the unit of COMP_TYP

    body = [line(name, f"{value:.9g}") for name, value in values.items()]
    ready = (
        f"CAL_MAG{compass}_ID must already be the device_id of this sensor, and CAL_MAG{compass}_ROT its mounting; "
        "restart the vehicle afterwards"
    )
    turn = turn_of(in_recorded_axes(calibration)[0])
    notes = [] if turn is None else [LEFT_OUT.format(turn=said(turn), compass=compass)]
    notes += [ready] if driven is None else [ready, COMPENSATED]
    return Written(parameters.apply, body, values, notes, driven=driven)


def _type(name: str) -> int:
    """MAV_PARAM_TYPE of a parameter."""
    return WHOLE if name == "CAL_MAG_COMP_TYP" else FLOAT


def sniff(head: bytes) -> bool:
    """Whether a file may hold parameters of a compass of PX4."""
    return b"CAL_MAG" in head


def read(content: bytes, source: str, *, strength: float | None = None, compass: int | None = None) -> Calibration:
    """Read the parameters of one compass back, from either kind of file.

    `strength`, µT: length of corrected readings, which they do not hold; 50 µT where it is not given. `compass`:
    which one; the only one where there is one.

    Raises
    ------
    InputError
        For lines that are no parameters, or none of such a compass.
    """
    values, wanted = _chosen(content, source, compass)
    return Parameters.read(values, wanted).to_calibration(strength or 50.0, known=strength is not None)


def which(content: bytes, source: str, compass: int | None = None) -> tuple[int, int | None]:
    """Number, and device id where the file has it, of the compass that `read` takes; raises as `read`."""
    values, wanted = _chosen(content, source, compass)
    device = Parameters.read(values, wanted).device_id
    return wanted, device % 2**32 if device else None


def _chosen(content: bytes, source: str, compass: int | None) -> tuple[dict[str, float], int]:
    """The parameters of a file, and the number of the compass that is meant."""
    lines = (line.strip().removeprefix("param set ") for line in decoded(content, source).splitlines())
    values = parse("\n".join(lines), source)
    there = [number for number in COMPASSES if f"CAL_MAG{number}_XOFF" in values]
    return values, chosen(there, compass, source, "CAL_MAG0_XOFF and so on")
