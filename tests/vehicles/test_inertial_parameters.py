"""Accelerometers and gyros in the parameters of autopilots: names, signs and units, read by an independent hand."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.targets.test_inertial_export import GYRO, OFFSET, READ, SKEWED, SQUARE, sensors

import flinders
from flinders import simulate
from flinders.core.calibration_file import ProvenanceRecord, SourceFile
from flinders.core.inertial import Inertial, Triad
from flinders.errors import NotExportable, UnitError, UsageError
from flinders.fitting.inertial_export import inertial_of
from flinders.targets import find
from flinders.workflows.exporting import export

if TYPE_CHECKING:
    from flinders.arrays import Floats


def parameters(text: str) -> dict[str, float]:
    """Names and numbers, in whatever a target puts around them."""
    found = re.findall(
        r'(?m)^(?:set |param set |1\t1\t|<define name=")?(\w+)(?:=| = |,|\t| |" value=")([-+.\de]+)', text
    )
    return {name: float(value) for name, value in found}


def triple(values: dict[str, float], name: str) -> Floats:
    """(3,) numbers whose names differ by a letter."""
    return np.array([values[name.format(axis)] for axis in ("XYZ" if name.format("X") in values else "xyz")])


@pytest.mark.parametrize(
    ("target", "imu", "offset", "scale", "rate"),
    [
        ("ardupilot", None, "INS_ACCOFFS_{}", "INS_ACCSCAL_{}", "INS_GYROFFS_{}"),
        ("ardupilot", 3, "INS_ACC3OFFS_{}", "INS_ACC3SCAL_{}", "INS_GYR3OFFS_{}"),
        ("px4", None, "CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE", "CAL_GYRO0_{}OFF"),
        ("px4-shell", 2, "CAL_ACC2_{}OFF", "CAL_ACC2_{}SCALE", "CAL_GYRO2_{}OFF"),
    ],
)
def test_autopilots_in_si_units(target: str, imu: int | None, offset: str, scale: str, rate: str) -> None:
    text = export(sensors(), target, imu=imu).text
    values = parameters(text)
    corrected = (READ - triple(values, offset)) * triple(values, scale)
    npt.assert_allclose(corrected, Triad(SQUARE, OFFSET, "m/s2").apply(READ), atol=1e-5)
    npt.assert_allclose(triple(values, rate), GYRO.offset, rtol=1e-6)


def test_inav_and_paparazzi_and_betaflight_in_counts() -> None:
    counts = sensors(unit="counts").accelerometer
    assert counts is not None
    raw = np.rint(READ * 400.0)
    wanted = counts.apply(raw)
    inav = parameters(export(sensors(unit="counts"), "inav").text)
    corrected = (raw - triple(inav, "acczero_{}")) * triple(inav, "accgain_{}") / 4096.0
    npt.assert_allclose(corrected * 9.80665 / 4096.0, wanted, atol=0.004)
    paparazzi = parameters(export(sensors(unit="counts"), "paparazzi").text)
    corrected = (raw - triple(paparazzi, "ACCEL_{}_NEUTRAL")) * triple(paparazzi, "ACCEL_{}_SENS")
    npt.assert_allclose(corrected / 1024.0, wanted, atol=0.002)
    text = export(sensors(np.eye(3), "counts"), "betaflight").text
    zero = re.search(r"set acc_calibration = (.+)", text)
    assert zero is not None
    npt.assert_allclose([float(word) for word in zero[1].split(",")], [*np.rint(counts.offset), 1.0])


def test_what_an_autopilot_cannot_hold_is_refused() -> None:
    with pytest.raises(NotExportable) as caught:
        export(sensors(SKEWED + 0.02 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]])), "px4")
    tilt = caught.value.evidence["tilt_deg"]
    assert isinstance(tilt, float)
    assert tilt > 0.5
    with pytest.raises(NotExportable) as beyond:
        export(Inertial(Triad(np.eye(3), np.array([4.0, 0.0, 0.0]), "m/s2")), "ardupilot")
    assert beyond.value.beyond == ("INS_ACCOFFS_X",)
    with pytest.raises(UnitError):
        export(sensors(), "inav")
    with pytest.raises(UsageError):
        export(sensors(), "ardupilot", imu=0)


def test_what_an_autopilot_logs_does_not_go_back_to_it() -> None:
    aided = flinders.fit(simulate.tumble(seed=1, motion="hand", n=1500).samples, aiding="dip")
    file = SourceFile(name="flight.bin", sha256="0" * 64, bytes=1, rows=1, autopilot="ardupilot")
    record = ProvenanceRecord(flinders="0.1.0", date=datetime(2026, 1, 1, tzinfo=UTC), files=(file,))
    logged = replace(aided, provenance=replace(aided.provenance, record=record))
    with pytest.raises(NotExportable):
        inertial_of(logged, find("ardupilot"), ["accelerometer"])
    assert inertial_of(logged, find("px4"), ["accelerometer"]).accelerometer is not None
