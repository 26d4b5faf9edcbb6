"""Parameters of ArduPilot, ``NAME,value`` a line: ``m = I ((r + OFS) SCALE)``, in mG and in the axes of the vehicle.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.exporters import Asked
>>> from flinders.core.units import Unit
>>> found = Calibration(np.diag([1.1, 1.0, 0.9]), [10.0, -20.0, 0.0], 50.0, raw=Unit.of("mG"))
>>> print(*write(found, Asked(compass=2)).body[-4:], sep=chr(10))
COMPASS_ODI2_X,0
COMPASS_ODI2_Y,0
COMPASS_ODI2_Z,0
COMPASS_SCALE2,1
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import Affine
from flinders.conventions._parsing import chosen, decoded
from flinders.conventions._recorded import in_recorded_axes
from flinders.conventions._rotations import said, turn_of
from flinders.conventions.ardupilot import Parameters, compasses, in_vehicle_axes, names, parse
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="ArduPilot",
    formula="m = I ((r + OFS) SCALE), I of DIA and ODI, OFS added",
    unit="mG",
    keeps="symmetric",
    storage="float32; OFS up to 1800 long, DIA 0.2 to 5, ODI -1 to 1, SCALE 1/1.5 to 1.5",
    source="AP_Compass_Backend::correct_field, CompassCalibrator",
    acts="mapped",
    follows="motors",
)

MOTORS: Final = (
    "COMPASS_MOT and COMPASS_MOTCT are not written: what is on board stays, and belongs to the old DIA, ODI and SCALE; "
    "where it is not 0 and those change, run CompassMot again"
)
"""MOT x is added after I and SCALE: with others it would have to be I' SCALE' (I SCALE)⁻¹ MOT."""

COMPENSATED: Final = (
    "COMPASS_MOT is in mG per A (COMPASS_MOTCT 2) or at full throttle (1), added after DIA, ODI and SCALE; "
    "COMPASS_MOTCT is one for all compasses: set COMPASS_MOT of the others, or leave them 0"
)


def write(calibration: Calibration, asked: Asked) -> Written:
    """Write the parameters of one compass, the first unless another is asked for.

    Raises
    ------
    UnitError
        For a calibration in counts.
    NotExportable
        For values that ArduPilot does not take.
    UsageError
        For a compass that there is not.
    """
    compass = 1 if asked.compass is None else asked.compass
    in_place = in_vehicle_axes(calibration)
    Affine.of(in_place, SHEET.unit, who=SHEET.title)  # refuses counts, and numbers beyond all bounds
    parameters = Parameters.of(in_place, compass=compass, lossy=asked.lossy).as_held()
    values = dict(parameters.rows())
    body = [f"{name},{value:.9g}" for name, value in values.items()]
    left_out = _left_out(in_place, compass)
    if not parameters.is_driven:
        return Written(parameters.apply, body, values, notes=(*left_out, MOTORS))
    return Written(parameters.apply, body, values, notes=(*left_out, COMPENSATED), driven=parameters.apply)


def _left_out(calibration: Calibration, compass: int) -> tuple[str, ...]:
    """What a rotation would have to be put into, and the parameters that are right from then on.

    They act after the mounting: with W = Q P and Q in the mounting, readings are Q r, and Q P Qᵀ and Q b correct them.
    """
    matrix, _ = in_recorded_axes(calibration)
    turn = turn_of(matrix)
    if turn is None:
        return ()
    digit = "" if compass == 1 else str(compass)
    then = Parameters.of(calibration, compass=compass, mounting=turn, lossy=True).as_held()
    rows = ", ".join(f"{name} {value:.6g}" for name, value in then.rows() if "MOT" not in name)
    note = (
        f"left out: a rotation of {said(turn)}. It belongs into the mounting (COMPASS_ORIENT{digit} 101, "
        "CUST_ROT1_ROLL, PITCH and YAW: after the rotation that is set now), and only once it is there the numbers "
        f"are, in place of those below: {rows}"
    )
    return (note,)


def sniff(head: bytes) -> bool:
    """Whether a file may hold parameters of a compass of ArduPilot."""
    pins = b"resource COMPASS_" in head  # of Betaflight
    return not pins and (b"COMPASS_" in head or b"COMPASS1_" in head)


def read(content: bytes, source: str, *, strength: float | None = None, compass: int | None = None) -> Calibration:
    """Read the parameters of one compass back.

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
    return wanted, next((int(values[name]) for name in names("DEV_ID", wanted) if values.get(name, 0) > 0), None)


def _chosen(content: bytes, source: str, compass: int | None) -> tuple[dict[str, float], int]:
    """The parameters of a file, and the number of the compass that is meant."""
    values = parse(decoded(content, source), source)
    return values, chosen(compasses(values), compass, source, "COMPASS_OFS_X and so on")
