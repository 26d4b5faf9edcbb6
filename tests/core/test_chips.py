"""The table of chips: complete rows, values that agree with each other, and names that are found."""

from __future__ import annotations

import re

import pytest
from tests.sentences import assert_raises

from flinders.core.axes import Axes
from flinders.core.chips import Chip, ChipReading, chip_of_device, chips, chips_named_in, find_chip
from flinders.errors import UsageError
from flinders.readers._names import is_chip

ALL = pytest.mark.parametrize("chip", chips(), ids=str)

WANTED = (
    "HMC5843 HMC5883L QMC5883L QMC5883P QMC6310 IST8310 IST8308 LIS3MDL LIS2MDL LSM303DLHC LSM303AGR LSM9DS0 LSM9DS1 "
    "AK8963 AK8975 AK09911 AK09915 AK09916 AK09918 MAG3110 FXOS8700 BMM150 BMM350 BMX055 BNO055 BNO08x MMC5603 MMC5633 "
    "MMC5883MA MMC5983MA RM3100 MLX90393 TLV493D ADIS16480 ADIS16488 VCM5883 IIS2MDC"
)


def test_the_common_chips_are_there() -> None:
    assert set(WANTED.split()) <= {chip.name for chip in chips()}


@ALL
def test_each_chip_has_sources_and_positive_counts(chip: Chip) -> None:
    assert chip.sources
    assert chip.settings
    for setting in chip.settings:
        assert 0.005 < setting.lsb_ut < 100.0
        assert setting.lsb_z_ut is None or 1.0 < setting.lsb_z_ut / setting.lsb_ut < 2.0
        assert setting.range_ut is None or setting.range_ut > setting.lsb_ut
    assert (chip.noise_ut is None) == (not chip.noise_at)
    assert all(text.endswith(".") for text in chip.traps)


@ALL
def test_a_stated_range_fits_into_the_words(chip: Chip) -> None:
    for setting in chip.settings:
        if chip.bits is not None and setting.range_ut is not None and setting.lsb_ut == chip.settings[0].lsb_ut:
            assert setting.range_ut <= 1.02 * setting.lsb_ut * 2 ** (chip.bits - 1)


@ALL
def test_the_mapping_of_axes_can_be_given(chip: Chip) -> None:
    assert bool(chip.axes) == bool(chip.axes_are)
    assert bool(chip.axes) or not chip.axes_in
    assert set(chip.axes_in) <= set(chip.also)
    if chip.axes:
        assert str(Axes.of(chip.axes)) == chip.axes


@ALL
def test_readers_of_tables_know_all_names(chip: Chip) -> None:
    words = {re.sub(r"[^a-z0-9]", "", name.casefold()) for name in (chip.name, *chip.also)}
    assert all(map(is_chip, words))


def test_no_name_and_no_device_type_is_of_two_chips() -> None:
    names = [name.casefold().replace("-", "") for chip in chips() for name in {chip.name, *chip.also}]
    spelled_twice = {"icm20948", "mpu9255"}  # with a hyphen and without
    assert {name for name in names if names.count(name) > 1} <= spelled_twice
    for autopilot in ("ardupilot", "px4"):
        kinds = [kind for chip in chips() for kind in getattr(chip, autopilot)]
        assert len(kinds) == len(set(kinds))


def test_a_chip_is_found_by_any_spelling() -> None:
    assert find_chip("mpu 9250") is find_chip("AK8963")
    assert find_chip("hmc5883l").name == "HMC5883L"
    with assert_raises(UsageError):
        find_chip("banana")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("full-sphere.csv", ()),
        ("walk_HMC5883L.csv", ("HMC5883L",)),
        ("mag_lis3mdl_cal_x", ("LIS3MDL",)),
        ("rm3100x rm3100y", ("RM3100",)),
        ("ICM-20948 left", ("AK09916",)),
        ("hmc5883l_x, qmc5883l_x", ("HMC5883L", "QMC5883L")),
        ("HMC58834", ()),
    ],
)
def test_names_are_found_as_words(text: str, names: tuple[str, ...]) -> None:
    assert tuple(map(str, chips_named_in(text))) == names


def test_a_device_id_names_its_chip() -> None:
    assert str(chip_of_device(73225, "ardupilot")) == "HMC5883L"
    assert str(chip_of_device(589858, "px4")) == "AK09916"
    assert chip_of_device(0x880000, "px4") is None


@ALL
def test_each_setting_of_a_chip_can_be_named(chip: Chip) -> None:
    for setting in chip.settings:
        assert ChipReading.of(f"{chip}:{setting.name}").setting.counts_ut == setting.counts_ut


@pytest.mark.parametrize(
    ("text", "lsb_ut", "axes"),
    [
        ("HMC5883L", 0.0917431, "x,y,z"),
        ("hmc5883l:8.1", 0.4347826, "x,y,z"),
        ("QMC5883L:8G", 0.0333333, "x,y,z"),
        ("mpu9250:16 bits", 0.15, "y,x,-z"),
        ("AK8963:16bits", 0.15, ""),
        ("MMC5603", 0.00625, ""),
        ("BMX055", 0.0625, "-y,x,z"),
        ("MMC5983MA:16bits", 0.0244141, ""),
        ("VCM5883", 0.0333333, "x,-y,z"),
    ],
)
def test_a_chip_gives_its_count_and_axes(text: str, lsb_ut: float, axes: str) -> None:
    reading = ChipReading.of(text)
    assert reading.setting.lsb_ut == lsb_ut
    assert reading.axes == axes


@pytest.mark.parametrize("text", ["AK8963", "IST8310", "HMC5883L:", "HMC5883L:9G", "HMC5883L:1", "HMC5883M:8G"])
def test_a_setting_that_is_not_clear_is_refused(text: str) -> None:
    with assert_raises(UsageError):
        ChipReading.of(text)


def test_readings_in_a_unit_need_no_setting() -> None:
    assert ChipReading.of("MPU-9250", is_in_counts=False).axes == "y,x,-z"
