"""Unit and axes that are proposed: the truth of a simulated sensor is among what is left, and nothing is guessed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders.core.chips import Chip, ChipSetting, chips, find_chip
from flinders.workflows.chip_proposal import ChipEvidence, ChipProposal, propose_chip

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

CASES = [
    pytest.param(chip, setting, id=f"{chip} {setting.name}")
    for chip in chips()
    for setting in chip.settings
    if setting.lsb_ut < 1.0
]


def cloud(lsb_ut: float, field_ut: float = 48.0, zero: int = 0) -> Floats:
    """(400, 3) whole counts of a sensor that was turned."""
    turned = np.random.default_rng(3).normal(size=(400, 3))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return np.round(field_ut * turned / lsb_ut + 0.3 * field_ut / lsb_ut) + zero


def proposed(readings: Floats, strength: float | None, **known: object) -> ChipProposal | None:
    return propose_chip(ChipEvidence.of(readings, strength=strength, **known))  # type: ignore[arg-type]


@pytest.mark.parametrize(("chip", "setting"), CASES)
def test_counts_leave_the_true_setting(chip: Chip, setting: ChipSetting) -> None:
    proposal = proposed(cloud(setting.lsb_ut, zero=setting.zero), 48.0 / setting.lsb_ut)
    assert proposal is not None
    assert (chip.name, setting.name) in {(each.chip, each.setting) for each in proposal.candidates}
    assert all(20.0 <= (each.strength_ut or 0.0) <= 70.0 for each in proposal.candidates)


def test_512_counts_are_an_hmc5883l_and_no_qmc5883l() -> None:
    proposal = proposed(cloud(0.0917431, 47.0), 512.0)
    assert proposal is not None
    assert "HMC5883L" in proposal.chips
    assert "QMC5883L" not in proposal.chips
    assert_sentences(proposal.reason)
    assert proposal.scale is None
    assert_sentences(proposal.advice)


def test_a_named_chip_with_one_setting_left_has_unit_and_axes() -> None:
    proposal = proposed(cloud(0.15), 320.0, chips=(find_chip("ICM-20948"),), named_by="the name IMU")
    assert proposal is not None
    assert (proposal.unit, proposal.scale, proposal.axes) == ("counts", 0.15, "x,-y,-z")
    assert_sentences(proposal.reason)


def test_several_gains_are_all_said_and_none_is_chosen() -> None:
    proposal = proposed(cloud(0.0917431), 523.0, chips=(find_chip("HMC5883L"),), named_by="the request")
    assert proposal is not None
    assert proposal.scale is None
    assert [each.setting for each in proposal.candidates] == ["±1.3 G", "±0.88 G", "±1.9 G"]
    assert "0.0917431 (±1.3 G) or 0.0729927 (±0.88 G) or 0.121951 (±1.9 G)" in proposal.advice


def test_a_name_that_the_counts_contradict_is_said() -> None:
    proposal = proposed(cloud(0.0333333), 1440.0, chips=(find_chip("HMC5883L"),), named_by="the request")
    assert proposal is not None
    assert proposal.candidates == ()
    assert_sentences(proposal.reason)
    assert proposal.advice == ""


def test_a_known_place_leaves_fewer_settings() -> None:
    anywhere, there = (
        proposed(cloud(0.0917431), 523.0, chips=(find_chip("HMC5883L"),), named_by="x", site_ut=site)
        for site in (None, 48.0)
    )
    assert anywhere is not None
    assert there is not None
    assert len(there.candidates) < len(anywhere.candidates)
    assert "±1.3 G" in {each.setting for each in there.candidates}


def test_fractions_in_steps_of_a_count_tell_chip_and_unit() -> None:
    readings = np.round(cloud(0.0917431) / 1090, 6)
    proposal = proposed(readings, 0.48)
    assert proposal is not None
    assert proposal.chips == ("HMC5883L", "HMC5983")
    assert (proposal.unit, proposal.scale, proposal.advice) == ("G", None, "unit='G'")


@pytest.mark.parametrize("digits", [0, 1, 2, 3])
def test_rounded_text_names_no_chip(digits: int) -> None:
    turned = np.random.default_rng(4).normal(size=(400, 3))
    readings = np.round(48.0 * turned / np.linalg.norm(turned, axis=1, keepdims=True), digits)
    proposal = proposed(readings + 0.5 * (digits == 0), 48.0)
    assert proposal is None


def test_readings_in_a_known_unit_propose_axes_of_a_named_chip_alone() -> None:
    readings = 0.15 * cloud(0.15)
    assert proposed(readings, 48.0, unit="uT") is None
    proposal = proposed(readings, 48.0, unit="uT", chips=(find_chip("MPU-9250"),), named_by="the names of the columns")
    assert proposal is not None
    assert (proposal.unit, proposal.scale, proposal.axes, proposal.candidates) == ("", None, "y,x,-z", ())


def test_few_readings_and_no_name_propose_nothing() -> None:
    assert proposed(cloud(0.15)[:20], 320.0) is None
    assert proposed(cloud(0.15), None) is None


def test_contents_take_the_name_of_columns_of_a_file_or_of_the_caller(tmp_path: Path) -> None:
    rows = "\n".join(",".join(f"{value:.0f}" for value in row) for row in cloud(0.15))
    (tmp_path / "lis2mdl-walk.csv").write_text(f"mx,my,mz\n{rows}\n", encoding="utf-8")
    (tmp_path / "walk.csv").write_text(f"rm3100_x,rm3100_y,rm3100_z\n{rows}\n", encoding="utf-8")
    (by_file,) = flinders.contents(tmp_path / "lis2mdl-walk.csv").sensors
    (by_columns,) = flinders.contents(tmp_path / "walk.csv").sensors
    mapped = flinders.open_log(tmp_path / "walk.csv", axes="x,-y,-z")
    (by_caller,) = flinders.contents(mapped, chip="ak09916").sensors
    assert by_file.chip is not None
    assert by_columns.chip is not None
    assert by_caller.chip is not None
    assert (by_file.chip.chips, by_file.chip.scale) == (("LIS2MDL",), 0.15)
    assert (by_columns.chip.chips, by_columns.chip.candidates) == (("RM3100",), ())
    assert (by_caller.chip.chips, by_caller.chip.axes) == (("AK09916",), "")
    (stated,) = flinders.contents(flinders.open_log(tmp_path / "lis2mdl-walk.csv", scale=0.15)).sensors
    assert stated.chip is not None
    assert stated.chip.candidates == ()
