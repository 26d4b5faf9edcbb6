"""Accelerometers from recordings with and without a magnetometer: their files, the command, and fits that find them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.program import flinders_
from tests.still_poses import SIDES, table

import flinders
from flinders import simulate
from flinders.core.inertial import Inertial
from flinders.core.inertial_record import read
from flinders.errors import NoAccelerometer, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    path = tmp_path / "poses.csv"
    path.write_text(table(), encoding="utf-8")
    return path


def test_a_table_without_a_magnetometer_gives_accelerometer_and_gyro(poses: Path) -> None:
    fit = flinders.calibrate_accelerometer(poses)
    assert (fit.poses, fit.is_still, fit.sees_misalignment) == (12, True, True)
    gyro = fit.inertial.gyro
    assert gyro is not None
    assert gyro.offset_sigma is not None
    assert np.all(np.abs(gyro.offset - [0.01, -0.02, 0.005]) < 4.0 * gyro.offset_sigma)
    assert gyro.matrix_sigma is None
    assert fit.as_dict()["tilt_error_deg"]["rms"] == fit.tilt_error.rms
    assert repr(fit).startswith("AccelerometerFit(12 poses, tilt 0.0")


def test_a_file_is_read_back_as_it_was_written(poses: Path, tmp_path: Path) -> None:
    fit = flinders.calibrate_accelerometer(poses)
    fit.save(tmp_path / "accelerometer.json")
    again = Inertial.from_document(read(tmp_path / "accelerometer.json"))
    assert again.to_document() == fit.inertial.to_document()


def test_gravity_of_the_place_goes_into_gains_alone(poses: Path) -> None:
    standard, local = (flinders.calibrate_accelerometer(poses, gravity=each) for each in (None, 9.78))
    first, second = standard.inertial.accelerometer, local.inertial.accelerometer
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second.matrix, first.matrix * 9.78 / 9.80665)
    np.testing.assert_allclose(second.offset, first.offset)
    assert standard.tilt_error == local.tilt_error
    with pytest.raises(UsageError):
        flinders.calibrate_accelerometer(poses, gravity=1.0)


def test_a_recording_without_an_accelerometer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("time_s,temperature_C\n" + "\n".join(f"{row},20.5" for row in range(100)), encoding="utf-8")
    with pytest.raises(NoAccelerometer):
        flinders.calibrate_accelerometer(path)


def test_the_command_writes_prints_and_refuses(poses: Path, tmp_path: Path) -> None:
    out = tmp_path / "accelerometer.json"
    ended = flinders_("accelerometer", str(poses), "-o", str(out))
    assert ended.code == 0, ended.err
    assert read(out).provenance is not None
    printed = flinders_("accelerometer", str(poses), "--json")
    assert json.loads(printed.out)["poses"] == 12
    poses.write_text(table(attitudes=SIDES[:5]), encoding="utf-8")
    refused = flinders_("accelerometer", str(poses), "--json")
    assert refused.code == 4
    assert json.loads(refused.out)["error"]["evidence"]["side"] == "-z"


def test_real_recordings_of_turned_sensors_tell_their_accelerometers(recordings: Callable[[str], Path]) -> None:
    """A calibrated accelerometer in g, turned by hand: offsets within 10 mg, gains within 1 %."""
    fit = flinders.calibrate_accelerometer(recordings("ckexplorer_acc_mag/acc_mag_log.csv"))
    accelerometer = fit.inertial.accelerometer
    assert accelerometer is not None
    assert accelerometer.unit == "g"
    assert np.abs(accelerometer.offset).max() < 0.01
    assert np.abs(accelerometer.matrix / 9.80665 - np.eye(3)).max() < 0.01
    assert 0.1 < fit.tilt_error.rms < 0.5


def test_an_aided_fit_keeps_both_sensors_with_their_uncertainty(tmp_path: Path) -> None:
    made = simulate.tumble(seed=1, motion="hand", n=1500)
    felt = made.samples.acceleration
    rate = made.samples.rate
    assert felt is not None
    assert rate is not None
    samples = replace(
        made.samples, acceleration=1.02 * felt + np.array([0.2, 0, 0]), rate=0.99 * rate + np.array([0, 0.03, 0])
    )
    fit = flinders.fit(samples, aiding=("rate", "dip"))
    assert fit.evidence.aiding is not None
    found = fit.evidence.aiding.inertial()
    accelerometer, gyro, tilt = found.accelerometer, found.gyro, found.tilt_error
    assert accelerometer is not None
    assert gyro is not None
    assert tilt is not None
    for triad, matrix, offset in (
        (accelerometer, np.eye(3) / 1.02, [0.2, 0.0, 0.0]),
        (gyro, np.eye(3) / 0.99, [0.0, 0.03, 0.0]),
    ):
        assert triad.matrix_sigma is not None
        assert triad.offset_sigma is not None
        assert np.all(np.abs(triad.offset - offset) < 4.0 * triad.offset_sigma)
        off = np.abs(triad.matrix - matrix)
        assert np.all(off[~np.eye(3, dtype=bool)] < 4.0 * triad.matrix_sigma[~np.eye(3, dtype=bool)])
        assert np.abs(np.diag(off)).max() < 0.004
    assert 0.0 < tilt.rms < 0.1
    fit.save(tmp_path / "calibration.json")
    again = flinders.load(tmp_path / "calibration.json").evidence.aiding
    assert again is not None
    assert again.inertial().to_document() == found.to_document()
