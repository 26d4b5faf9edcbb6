"""Targets that hold less than a calibration: the fit that they are offered, and what their files state."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import NotExportable
from flinders.fitting.export import level_turn_error
from flinders.targets import ExportOptions, find, read_back

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

IRON = simulate.Sensor(np.diag([1.06, 0.97, 0.97]) + 0.01, np.array([40.0, -30.0, 20.0]), noise=0.2)
"""A compass with soft iron."""


@pytest.fixture(scope="module")
def readings() -> Samples:
    """Of this compass, in counts."""
    field = simulate.tumble(seed=1, sensor=IRON).samples.field
    return Samples.of(np.rint(10.0 * field), unit="counts")


@pytest.fixture(scope="module")
def whole(readings: Samples) -> Fit:
    return flinders.fit(readings)


@pytest.mark.parametrize(("target", "method"), [("betaflight", "sphere"), ("inav", "axes")])
def test_the_refusal_names_a_fit_that_the_target_holds(readings: Samples, whole: Fit, target: str, method: str) -> None:
    with pytest.raises(NotExportable) as refused:
        flinders.export(whole, target)
    assert_sentences(refused.value.message)
    held = flinders.export(flinders.fit(readings, method=method), target)
    assert not any("left out" in warning for warning in held.export.warnings)
    assert f"the calibration is {flinders.fit(readings, method=method).verdict}" in held.text


def test_a_target_that_holds_all_is_offered_none(whole: Fit) -> None:
    text = flinders.export(whole, "c").text
    assert "--method" not in text
    assert f"the calibration is {whole.verdict}" in text


def test_the_file_states_what_the_target_holds_and_not_the_whole(whole: Fit) -> None:
    text = " ".join(flinders.export(whole, "betaflight", lossy=True).text.replace("\n#", " ").split())
    stated = re.search(r"with the parameters that Betaflight holds, headings are good to ([\d.]+) deg", text)
    assert stated is not None
    assert f"headings good to {whole.heading_error_deg.worst:.2g}" not in text
    trial = find("betaflight").try_formula(whole.calibration, asked=ExportOptions(lossy=True))
    left = level_turn_error(whole, trial).worst
    assert float(stated[1]) == pytest.approx(np.hypot(left, whole.heading_error_deg.worst), rel=0.05)
    assert left == pytest.approx(turn_error(whole), abs=0.02)


def turn_error(fit: Fit) -> float:
    """Worst heading error of a level turn, corrected with the offset alone, its mean removed; degrees."""
    heading = np.arange(720) * np.pi / 360
    dip = np.deg2rad(fit.heading_error_deg.dip_deg)
    level, across = np.cos(dip) * np.cos(heading), -np.cos(dip) * np.sin(heading)
    field = np.stack([level, across, np.full(720, np.sin(dip))], axis=1)
    x, y, _ = (fit.calibration.unapply(fit.calibration.field_strength * field) - np.rint(fit.calibration.offset)).T
    off = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.rad2deg(np.abs(off - off.mean()).max()))


def test_what_is_exact_leaves_no_heading_error(readings: Samples) -> None:
    fit = flinders.fit(readings)
    trial = find("c").try_formula(fit.calibration)
    assert not trial.loses
    assert level_turn_error(fit, trial).worst < 1e-3


# readings in the axes of the vehicle, for a target that corrects those of the sensor

MOUNTED: Calibration = Calibration(
    np.diag([1.1, 0.9, 1.02]), np.array([120.0, -31.0, 7.0]), 400.0, raw=Unit.of("counts"), frame="vehicle"
)


@pytest.mark.parametrize(("target", "mounting"), [("inav", None), ("paparazzi", None)])
def test_without_a_mounting_they_are_refused_and_no_file_is_to_be_edited(target: str, mounting: str | None) -> None:
    with pytest.raises(NotExportable) as refused:
        flinders.export(MOUNTED, target, mounting=mounting)
    assert "mounting" in refused.value.hint
    assert "file" not in refused.value.message


@pytest.mark.parametrize("target", ["inav", "paparazzi"])
def test_a_sensor_that_sits_as_the_vehicle_does_needs_no_other_calibration(target: str) -> None:
    text = flinders.export(MOUNTED, target, mounting="none").text
    assert text == flinders.export(replace(MOUNTED, frame="sensor"), target).text


def test_with_its_mounting_the_numbers_are_those_of_the_sensor_before_it() -> None:
    text = flinders.export(MOUNTED, "inav", mounting="CW90").text
    _, found = read_back(text.encode(), "dump.txt", target="inav", strength=400.0)
    quarter = find("inav").mountings
    assert quarter is not None
    turn = quarter.read("CW90")
    raw: Floats = np.array([[300.0, 100.0, -50.0], [10.0, 20.0, 300.0]])  # as the sensor reads
    npt.assert_allclose(found.apply(raw) @ turn.T, MOUNTED.apply(raw @ turn.T), atol=2.0)
