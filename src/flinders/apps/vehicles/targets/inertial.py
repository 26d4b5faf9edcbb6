"""Accelerometer and gyro parameters of autopilots: ``c = (raw − offset) scale`` of each axis, no misalignment.

ArduPilot and PX4 use m/s² and rad/s in the axes of the sensor, before the board's rotation; INAV and Paparazzi raw
counts in those axes; Betaflight raw counts in the axes of the board, with offsets alone.

>>> from flinders.core.inertial import Inertial
>>> from flinders.targets._inertial import write_inertial
>>> sensor = Inertial(Triad(np.diag([0.99, 1.01, 1.0]), [0.2, -0.1, 0.3], "m/s2"))
>>> print(*write_inertial(ARDUPILOT, sensor, who="ArduPilot", asked=Asked(imu=2)).body[:4], sep=chr(10))
INS_ACC2OFFS_X,0.200000003
INS_ACC2OFFS_Y,-0.100000001
INS_ACC2OFFS_Z,0.300000012
INS_ACC2SCAL_X,0.99000001

Sources: ``_rotate_and_correct_accel`` and ``_rotate_and_correct_gyro`` of ArduPilot's
``AP_InertialSensor_Backend.cpp``, ranges of its parameter list; ``Correct`` of PX4's ``Accelerometer.hpp`` and
``Gyroscope.hpp`` in ``sensor_calibration``, ranges of ``sensors/module.yaml``; ``applyAccelerationZero`` of INAV's
``sensors/acceleration.c``; ``applyAccelerationTrims`` of Betaflight's, and its ``cli/settings.c``; Paparazzi's
``sw/tools/calibration/calibrate.py``, ten bits for ACCEL.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.arrays import to_floats
from flinders.core.inertial import STANDARD_GRAVITY, Triad
from flinders.errors import NotExportable, UsageError, figures
from flinders.targets._inertial import Asked, InertialForm, Numbers, offset_and_gains
from flinders.targets._numbers import in_16_bits, round_to_integers, round_to_single

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.arrays import Floats

AXES: Final = "XYZ"
UNIT_GAIN: Final = 4096
"""INAV's gain of 1."""
UNITS_PER_MS2: Final = 2**10
"""Paparazzi's units of acceleration in one m/s²."""
LIMITS_32: Final = -(2**31), 2**31 - 1
INTEGER_ATTRIBUTE: Final = ' integer="16"'
RESTART: Final = "restart the vehicle afterwards"


def _ardupilot_lines(values: dict[str, float]) -> list[str]:
    """Lines of a parameter file of ArduPilot."""
    return [f"{name},{value:.9g}" for name, value in values.items()]


def _px4_lines(values: dict[str, float]) -> list[str]:
    """Lines of QGroundControl's file."""
    return [f"1\t1\t{name}\t{value:.9g}\t9" for name, value in values.items()]


def _shell_lines(values: dict[str, float]) -> list[str]:
    """Lines for PX4's shell."""
    return [f"param set {name} {value:.9g}" for name, value in values.items()]


def _ardupilot_accelerometer(triad: Triad, asked: Asked) -> Numbers:
    """Numbers of INS_ACCOFFS and INS_ACCSCAL of an IMU, 1 to 3."""
    digit = _digit(asked)
    offset, scale = offset_and_gains(triad)
    values = {
        **_named(f"INS_ACC{digit}OFFS_", offset, -3.5, 3.5, "ArduPilot"),
        **_named(f"INS_ACC{digit}SCAL_", scale, 0.8, 1.2, "ArduPilot"),
    }
    return Numbers(lambda raw: (raw - offset) * scale, values, _ardupilot_lines(values))


def _ardupilot_gyro(triad: Triad, asked: Asked) -> Numbers:
    """Numbers of INS_GYROFFS of an IMU, 1 to 3."""
    offset, digit = round_to_single(triad.offset), _digit(asked)
    name = f"INS_GYR{digit}OFFS_" if digit else "INS_GYROFFS_"
    values = _named(name, offset, -np.inf, np.inf, "ArduPilot")
    return Numbers(lambda raw: raw - offset, values, _ardupilot_lines(values))


def _digit(asked: Asked) -> str:
    """Digit of an IMU in names such as INS_ACC2OFFS_X; none for the first."""
    number = 1 if asked.imu is None else asked.imu
    if number not in (1, 2, 3):
        raise UsageError(f"IMU {number}: ArduPilot's parameters are those of IMU 1, 2 and 3")
    return "" if number == 1 else str(number)


def _px4(lines: Callable[[dict[str, float]], list[str]]) -> InertialForm:
    """Form of PX4's parameters CAL_ACCn and CAL_GYROn, for an IMU n from 0 to 3."""

    def accelerometer(triad: Triad, asked: Asked) -> Numbers:
        offset, scale = offset_and_gains(triad)
        number = _px4_number(asked)
        values = {
            **_px4_values(f"CAL_ACC{number}_", "OFF", offset, -np.inf, np.inf),
            **_px4_values(f"CAL_ACC{number}_", "SCALE", scale, 0.1, 3.0),
        }
        return Numbers(lambda raw: (raw - offset) * scale, values, lines(values))

    def gyro(triad: Triad, asked: Asked) -> Numbers:
        offset = round_to_single(triad.offset)
        values = _px4_values(f"CAL_GYRO{_px4_number(asked)}_", "OFF", offset, -np.inf, np.inf)
        return Numbers(lambda raw: raw - offset, values, lines(values))

    return InertialForm(
        formula="c = (raw - OFF) SCALE, rates raw - OFF, in m/s2 and rad/s, axes of the sensor",
        source="Accelerometer.hpp, Gyroscope.hpp, sensors/module.yaml",
        accelerometer=accelerometer,
        gyro=gyro,
        holds="gains",
        holds_rates="offset",
        notes=(f"CAL_ACCn_ID and CAL_GYROn_ID must already be the device_id of these sensors; {RESTART}",),
    )


def _px4_number(asked: Asked) -> int:
    """Number of the IMU; `UsageError` unless it is 0 to 3."""
    number = 0 if asked.imu is None else asked.imu
    if number not in range(4):
        raise UsageError(f"IMU {number}: PX4's parameters are those of IMU 0 to 3")
    return number


def _px4_values(prefix: str, group: str, values: Floats, low: float, high: float) -> dict[str, float]:
    """Values of PX4's parameters, by names made of prefix, axis and group."""
    return _named("", values, low, high, "PX4", lambda axis: f"{prefix}{axis}{group}")


def _named(
    prefix: str, values: Floats, low: float, high: float, who: str, name: Callable[[str], str] | None = None
) -> dict[str, float]:
    """Values by name; `NotExportable` for one out of its range."""
    called = {axis: name(axis) if name else f"{prefix}{axis}" for axis in AXES}
    for axis, value in zip(AXES, values, strict=True):
        if not low <= value <= high:
            raise NotExportable(
                f"{called[axis]} would be {figures(float(value), 4)}, and {who} accepts {low:g} to {high:g}: check the "
                "unit of the recording, and the accelerometer",
                beyond=(called[axis],),
                wanted={called[axis]: float(value)},
            )
    return {called[axis]: float(value) + 0.0 for axis, value in zip(AXES, values, strict=True)}


def _inav(triad: Triad, _asked: Asked) -> Numbers:
    """Numbers of ``acczero`` and ``accgain``: (raw − zero) gain / 4096, rounded, for the driver's length of 1 g."""
    length = STANDARD_GRAVITY / float(np.cbrt(np.prod(np.diag(triad.matrix))))
    one_g = 2.0 ** round(np.log2(length))
    zeros, gains = [f"acczero_{axis}" for axis in "xyz"], [f"accgain_{axis}" for axis in "xyz"]
    zero = in_16_bits(triad.offset, zeros)
    gain = in_16_bits(UNIT_GAIN * one_g * np.diag(triad.matrix) / STANDARD_GRAVITY, gains, lowest=1)
    values = dict(zip((*zeros, *gains), (*zero, *gain), strict=True))
    body = [*(f"set {name} = {value}" for name, value in values.items()), "save"]

    def apply(raw: Floats) -> Floats:
        return np.trunc((raw - to_floats(zero)) * to_floats(gain) / UNIT_GAIN)

    return Numbers(apply, {**values, "counts_per_g": one_g}, body)


def _betaflight(triad: Triad, _asked: Asked) -> Numbers:
    """Numbers of ``acc_calibration``: three offsets, and 1, which says that a calibration was done."""
    zero = in_16_bits(triad.offset, [f"acc_calibration {axis}" for axis in "xyz"])
    text = ",".join(map(str, (*zero, 1)))
    body = [f"set acc_calibration = {text}", "save"]
    return Numbers(lambda raw: raw - to_floats(zero), {"acc_calibration": (*zero, 1)}, body)


def _paparazzi(triad: Triad, _asked: Asked) -> Numbers:
    """Numbers of ``ACCEL_X_NEUTRAL`` and ``ACCEL_X_SENS``: (raw − neutral) sens, in 2⁻¹⁰ m/s²."""
    neutrals = [f"ACCEL_{axis}_NEUTRAL" for axis in AXES]
    low, high = LIMITS_32
    neutral = round_to_integers(triad.offset, neutrals, lowest=low, highest=high, advice="check the recording")
    gains = {
        f"ACCEL_{axis}_SENS": float(f"{UNITS_PER_MS2 * gain:.9g}")
        for axis, gain in zip(AXES, np.diag(triad.matrix), strict=True)
    }
    values = {**dict(zip(neutrals, neutral, strict=True)), **gains}
    sens = to_floats(list(gains.values()))
    return Numbers(lambda raw: (raw - to_floats(neutral)) * sens, values, list(_defines(values)))


def _defines(values: dict[str, float]) -> Iterator[str]:
    """Yield the lines of the section IMU of an airframe file."""
    for name, value in values.items():
        yield f'<define name="{name}" value="{value:.9g}"{"" if name.endswith("NEUTRAL") else INTEGER_ATTRIBUTE}/>'


ARDUPILOT: Final = InertialForm(
    formula="c = (raw - ACCOFFS) ACCSCAL, rates raw - GYROFFS, in m/s2 and rad/s, axes of the sensor",
    source="AP_InertialSensor_Backend.cpp",
    accelerometer=_ardupilot_accelerometer,
    gyro=_ardupilot_gyro,
    holds="gains",
    holds_rates="offset",
    notes=(
        (
            "INS_ACC and INS_GYR act before AHRS_ORIENTATION; ArduPilot usually measures GYROFFS again at each boot; "
            f"{RESTART}"
        ),
    ),
)
PX4: Final = _px4(_px4_lines)
PX4_SHELL: Final = _px4(_shell_lines)
INAV: Final = InertialForm(
    formula="c = (raw - acczero) accgain / 4096, in whole counts, axes of the sensor",
    source="sensors/acceleration.c, applyAccelerationZero",
    accelerometer=_inav,
    unit="counts",
    gives=None,
    holds="gains",
    notes=(
        "accgain is for a driver whose 1 g is the power of two nearest to gravity in raw counts",
        "for readings recorded with acczero 0 and accgain 4096",
    ),
)
BETAFLIGHT: Final = InertialForm(
    formula="c = align(raw) - acc_calibration, in whole counts, axes of the board",
    source="sensors/acceleration.c, applyAccelerationTrims; cli/settings.c",
    accelerometer=_betaflight,
    unit="counts",
    gives=None,
    holds="offset",
    notes=("for readings recorded with acc_calibration 0,0,0,0",),
)
PAPARAZZI: Final = InertialForm(
    formula="c = (raw - ACCEL_NEUTRAL) ACCEL_SENS, in 2^-10 m/s2",
    source="sw/tools/calibration/calibrate.py",
    accelerometer=_paparazzi,
    unit="counts",
    gives=1.0 / UNITS_PER_MS2,
    holds="gains",
)
