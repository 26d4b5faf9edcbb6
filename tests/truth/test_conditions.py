"""What a good verdict rests on is said, and other evidence ends it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from tests.worlds import MOTORS

import flinders
from flinders import Fit, simulate
from flinders.core.samples import Joined
from flinders.report.formatting import condition

if TYPE_CHECKING:
    from pathlib import Path

SENSOR: Final = simulate.Sensor(offset=np.array([20.0, 5.0, -30.0]), noise=0.5)


def test_one_recording_shows_neither() -> None:
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    assert fit.conditions == ("uniform-field", "constant-iron")
    assert fit.as_dict()["conditions"] == ["uniform-field", "constant-iron"]
    assert condition(fit) == "holds if no iron is near and currents are constant: record elsewhere too"
    assert len(condition(fit)) <= 74  # a line of a terminal


def test_a_limited_fit_states_none() -> None:
    fit = flinders.fit(simulate.tumble(seed=1, motion="tilted").samples, target_deg=0.2)
    assert (fit.verdict, fit.conditions, condition(fit)) == ("limited", (), "")


def test_a_second_recording_that_agrees_speaks_for_the_place() -> None:
    first, second = (simulate.tumble(seed=seed, sensor=SENSOR, n=1500).samples for seed in (1, 2))
    fit = flinders.fit(Joined((first, second)))
    assert (fit.verdict, fit.conditions) == ("good", ("constant-iron",))
    assert condition(fit) == "holds if currents are constant: record the currents"


def test_the_strength_of_the_place_speaks_for_it_where_readings_have_it() -> None:
    samples = simulate.tumble(seed=1, sensor=SENSOR).samples
    there, elsewhere = (flinders.fit(samples, field_strength=strength) for strength in (50.0, 40.0))
    assert there.conditions == ("constant-iron",)
    assert "uniform-field" in elsewhere.conditions


def test_a_current_that_is_compensated_is_no_condition() -> None:
    samples = simulate.tumble(seed=3, sensor=SENSOR, disturbances=[MOTORS]).samples
    fit = flinders.fit(samples, disturbances=("current",))
    assert fit.verdict != "good" or fit.conditions == ("uniform-field",)
    good = replace(fit, findings=(), conditions=())
    assert good.verdict == "good"


def test_a_file_keeps_them(tmp_path: Path) -> None:
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    fit.save(tmp_path / "calibration.json")
    assert Fit.load(tmp_path / "calibration.json").conditions == fit.conditions != ()
