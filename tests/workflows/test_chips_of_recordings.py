"""Real recordings whose chip is known: the proposal has the true chip among those left, or says nothing."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

import flinders

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.workflows.chip_proposal import ChipProposal

BY_COUNTS = {
    "jremington_icm20948/icm_20948_cal_mag.csv": ("AK09916", 0.15),
    "jremington_mpu9250/mag.txt": ("AK8963", 0.6),
    "tomisuarez_qmc5883l/noisy_raw_data.csv": ("QMC5883L", 0.0333333),
    "tomisuarez_qmc5883l/filtered_raw_data.csv": ("QMC5883L", 0.0333333),
    "pichim_betaflight/CalCareful_2282320.csv": ("QMC5883L", 0.0333333),
    "pichim_betaflight/calTest1_198_253_-9.csv": ("QMC5883L", 0.0333333),
    "pichim_betaflight/calTest1_208_249_-2.csv": ("QMC5883L", 0.0333333),
    "pichim_betaflight/calTest1_215_253_0.csv": ("QMC5883L", 0.0333333),
    "pichim_betaflight/calTest1_222_240_-8.csv": ("QMC5883L", 0.0333333),
    "sunsided_hmc5883l/full-sphere.csv": ("HMC5883L", 0.0917431),
}
"""Chip and µT of a count, by the documents beside each recording; its file name is hidden."""
BY_DEVICE_ID = {"dronekit_log171_3mags/log171.bin": "HMC5883L", "px4_pyulog_cubeorange/sample_log_small.ulg": "AK09916"}
"""Chip of the first compass that has a device id."""
SILENT = (
    "michaelwro_fxos8700/mag-readings.txt",  # rounded to 0.1 µT
    "nliaudat_hmc5883l/mag_out_sample.txt",  # seen from one side
    "sunsided_hmc5883l/roll-and-tilt-at-45-90.csv",  # seen from one side
    "uutzinger_gearvr/mag_data.txt",
    "leiria_robot/V_300_path1_LSM9DS0.npz",
    "leiria_robot/V_300_path1_MPU9150.npz",
    "leiria_robot/V_300_path1_MPU6050RM3100.npz",
)
"""Recordings that tell too little: what is proposed would be a guess."""


def proposals(path: Path, hidden: Path) -> list[ChipProposal]:
    """Proposals for the magnetometers of a copy whose name tells nothing."""
    shutil.copy(path, copy := hidden / f"recording{path.suffix}")
    return [sensor.chip for sensor in flinders.contents(copy).sensors if sensor.chip is not None]


@pytest.mark.parametrize("name", BY_COUNTS)
def test_counts_leave_the_true_chip(name: str, recordings: Callable[[str], Path], tmp_path: Path) -> None:
    (proposal,) = proposals(recordings(name), tmp_path)
    chip, lsb_ut = BY_COUNTS[name]
    assert (chip, lsb_ut) in {(each.chip, each.lsb_ut) for each in proposal.candidates}


@pytest.mark.parametrize("name", BY_DEVICE_ID)
def test_a_device_id_names_the_true_chip(name: str, recordings: Callable[[str], Path], tmp_path: Path) -> None:
    assert proposals(recordings(name), tmp_path)[0].chips == (BY_DEVICE_ID[name],)


@pytest.mark.parametrize("name", SILENT)
def test_nothing_is_proposed_where_the_readings_tell_too_little(
    name: str, recordings: Callable[[str], Path], tmp_path: Path
) -> None:
    assert proposals(recordings(name), tmp_path) == []
