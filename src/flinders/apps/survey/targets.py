r"""Calibrations of survey instruments for their firmware: coefficients of the DistoX, JSON of mag-cal and the SAP6.

The DistoX stores 52 bytes. For each sensor, gravity first, there are three rows of four signed 16-bit numbers, low byte
first: an offset B in 1/24000 and three factors of A in 1/16384, so that for readings g in counts,

    corrected = A h + B,        h = g / 24000,        |corrected| = 1

For gravity, h + N (h² − ½) replaces h, axis by axis. Bytes 48 to 50 hold N in units of 1/2796 as signed numbers less
one, so that 0xff stands for zero. The last byte is 0xff.

mag-cal corrects rows of readings r, mapped by ``axes``, as ``(r − centre) transform``. Corrected readings of both
sensors have length 1, and the laser is along y.

>>> coefficients = distox_coefficients(SurveyCalibration.identity())
>>> len(coefficients), coefficients[:4].hex(), coefficients[48:].hex()
(52, '0000ff7f', 'ffffffff')

Sources: CalibTransform.java and TDUtil.java of TopoDroid (github.com/marcocorvi/topodroid), in which a factor is 2 at
most, and all numbers of a sensor are scaled down if one is larger; calibration.py and sensor.py of mag-cal
(github.com/furbrain/CircuitPython_mag_cal).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
from msgspec import Struct

from flinders.apps.survey.instrument import SurveyCalibration
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import Triple, readable_message
from flinders.core.json_layout import lay_out
from flinders.core.units import COUNTS
from flinders.errors import ArrayError, AxesError, DocumentError, NotExportable

if TYPE_CHECKING:
    from flinders.arrays import Floats

TARGETS: Final = ()
"""Empty: these formats are for survey instruments, and `flinders export` writes the calibration of one sensor."""

OFFSET_STEPS, FACTOR_STEPS, QUADRATIC_STEPS = 24000.0, 16384.0, 2796.0
MAX_INT16: Final = 32767
"""Largest signed 16-bit number."""
MAX_QUADRATIC: Final = 127
"""Largest quadratic term, in steps of 1/2796."""

STEPS: Final = np.array([OFFSET_STEPS, FACTOR_STEPS, FACTOR_STEPS, FACTOR_STEPS])
"""Steps per unit of B and the three factors of A in a row."""

SIZES: Final = (48, 52)
"""Sizes of coefficients in bytes, without and with quadratic terms."""

END: Final = b"\xff"


def distox_coefficients(calibration: SurveyCalibration) -> bytes:
    """The 52 bytes of coefficients for a DistoX, at 0x8010 of its memory.

    Raises
    ------
    NotExportable
        For a laser that is not along x, axes that were exchanged, readings that are not in counts, or quadratic terms
        that are too large.
    """
    if calibration.pointing != "x":
        raise NotExportable(
            f"the laser is along {calibration.pointing}, and a DistoX needs it along x: map the axes, and calibrate "
            "again",
            beyond=("pointing",),
        )
    sensors = (calibration.accelerometer, calibration.magnetometer)
    if calibration.magnetometer.raw.name != COUNTS or not all(sensor.axes.is_identity for sensor in sensors):
        raise NotExportable(
            "coefficients of a DistoX are for its own counts and axes: calibrate its readings as they are, without "
            "unit and axes",
            beyond=("unit", "axes"),
        )
    steps = np.round(np.array(calibration.quadratic) * OFFSET_STEPS * QUADRATIC_STEPS)
    if np.abs(steps).max() > MAX_QUADRATIC:
        raise NotExportable(
            f"quadratic terms are up to {np.abs(steps).max() / QUADRATIC_STEPS:.3f} of gravity, and a DistoX allows "
            f"{MAX_QUADRATIC / QUADRATIC_STEPS:.3f}: calibrate without quadratic terms",
            beyond=("quadratic",),
        )
    gravity, field = map(_unit, sensors)
    gravity[:, 0] += gravity[:, 1:] @ steps / QUADRATIC_STEPS / 2.0
    return _words(gravity) + _words(field) + (steps - 1).astype("i1").tobytes() + END


def of_distox(content: bytes) -> SurveyCalibration:
    """Calibration from coefficients of a DistoX; raises `DocumentError` for other content."""
    if len(content) not in SIZES:
        raise DocumentError(f"{len(content)} bytes: coefficients of a DistoX are {SIZES[0]} or {SIZES[1]}")
    gravity, field = (rows / STEPS for rows in np.frombuffer(content[:48], "<i2").reshape(2, 3, 4))
    steps = (np.frombuffer(content[48:51] or 3 * END, "i1") + 1).astype(float)
    gravity[:, 0] -= gravity[:, 1:] @ steps / QUADRATIC_STEPS / 2.0
    quadratic = steps / QUADRATIC_STEPS / OFFSET_STEPS
    return SurveyCalibration(_of_rows(field), _of_rows(gravity), "x", (*quadratic.tolist(),))


def mag_cal_json(calibration: SurveyCalibration, *, dip_deg: float, noise: float, gravity_noise: float) -> str:
    """JSON of mag-cal; raises `NotExportable` for a laser that is not along y, and for quadratic terms.

    mag-cal recognises disturbed readings by the dip and the noise of both sensors, in their units.
    """
    if calibration.pointing != "y":
        raise NotExportable(
            f"the laser is along {calibration.pointing}, and mag-cal needs it along y: map the axes, and calibrate "
            "again",
            beyond=("pointing",),
        )
    if any(calibration.quadratic):
        raise NotExportable("mag-cal has no quadratic terms: calibrate without quadratic terms", beyond=("quadratic",))
    mag, grav = _record(calibration.magnetometer, noise), _record(calibration.accelerometer, gravity_noise)
    return lay_out({"mag": mag, "grav": grav, "dip_avg": dip_deg, "ready": True}) + "\n"


class MagCalSensor(Struct):
    """Record of a sensor in the JSON of mag-cal."""

    axes: str
    transform: tuple[Triple, Triple, Triple]
    centre: Triple
    rbfs: list[list[Any]] = []


class MagCal(Struct):
    """JSON of mag-cal, as far as it is read."""

    mag: MagCalSensor
    grav: MagCalSensor


def of_mag_cal(text: str | bytes) -> SurveyCalibration:
    """Calibration from JSON of mag-cal, or ``calib`` of a SAP6; raises `DocumentError` for other content."""
    try:
        content = msgspec.json.decode(text)
        if isinstance(content, dict):
            content = content.get("calib", content)
        record = msgspec.convert(content, MagCal)
        return SurveyCalibration(_of_record(record.mag), _of_record(record.grav), "y")
    except (msgspec.DecodeError, RecursionError, ArrayError, AxesError) as error:
        raise DocumentError(
            f"no calibration of mag-cal ({readable_message(error)}): need mag and grav, each with axes, transform and "
            "centre"
        ) from None


def _unit(sensor: Calibration) -> Floats:
    """(3, 4) coefficients of a sensor: column B, then the columns of A."""
    unit = sensor.matrix / sensor.field_strength
    return np.column_stack([-unit @ sensor.offset, unit * OFFSET_STEPS])


def _words(rows: Floats) -> bytes:
    """24 bytes of a sensor; its (3, 4) numbers are scaled down together if one is too large."""
    rows = rows * STEPS
    rows *= min(1.0, MAX_INT16 / float(np.abs(rows).max()))
    return bytes(np.round(rows).astype("<i2").tobytes())


def _of_rows(rows: Floats) -> Calibration:
    """Calibration of a sensor from its (3, 4) coefficients; corrected readings have a length of about 1."""
    matrix = rows[:, 1:] / OFFSET_STEPS
    if not np.linalg.det(matrix):
        raise DocumentError("the coefficients are zeros: the DistoX was never calibrated; calibrate it first")
    return Calibration(matrix, -np.linalg.solve(matrix, rows[:, 0]), 1.0, rotation="estimated")


def _record(sensor: Calibration, noise: float) -> dict[str, Any]:
    """Record of a sensor in the JSON of mag-cal."""
    signs = zip(sensor.axes.signs, sensor.axes.order, strict=True)
    return {
        "axes": "".join(("-" if sign < 0 else "+") + "XYZ"[place] for sign, place in signs),
        "transform": (sensor.matrix.T / sensor.field_strength).tolist(),
        "centre": sensor.offset.tolist(),
        "rbfs": [],
        "field_avg": sensor.field_strength,
        "field_std": noise,
    }


def _of_record(record: MagCalSensor) -> Calibration:
    """Calibration of a sensor from its record; raises `DocumentError` for radial basis functions."""
    if any(map(any, record.rbfs)):
        raise DocumentError("mag-cal with radial basis functions is not read: calibrate from the shots")
    axes = Axes.of(",".join(record.axes[place : place + 2] for place in (0, 2, 4)))
    matrix = np.array(record.transform).T
    return Calibration(matrix, np.array(record.centre), 1.0, rotation="estimated", axes=axes)
