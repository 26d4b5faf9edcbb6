"""What a verdict rests on is said, and other evidence ends it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.worlds import MOTORS, OFFSET_SENSOR

import flinders
from flinders import simulate
from flinders.core.joining import Joined
from flinders.fitting.fit_file import load
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Judgement, Refused
from flinders.report.formatting import condition

if TYPE_CHECKING:
    from pathlib import Path


def test_one_recording_shows_neither() -> None:
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    assert fit.judgement.conditions == ("uniform-field", "constant-iron")
    assert json_of(fit)["conditions"] == ["uniform-field", "constant-iron"]
    assert_sentences(condition(fit))
    assert len(condition(fit)) <= 74  # a line of a terminal


def test_a_limited_fit_states_them_and_a_refused_one_none() -> None:
    fit = flinders.fit(simulate.tumble(seed=1, motion="tilted").samples, target_deg=0.2)
    assert (fit.verdict, fit.judgement.conditions) == ("limited", ("uniform-field", "constant-iron"))
    with pytest.raises(Refused) as refusal:
        flinders.fit(simulate.tumble(seed=1, motion="hemisphere", n=12).samples)
    assert (refusal.value.fit.judgement.conditions, condition(refusal.value.fit)) == ((), "")


def test_a_few_seconds_show_one_state_of_the_body() -> None:
    samples = simulate.tumble(seed=1, n=300).samples  # six seconds
    fit = flinders.fit(samples)
    assert fit.judgement.conditions == ("unchanged-body", "uniform-field")
    assert_sentences(condition(fit))
    both = (simulate.tumble(seed=seed, sensor=OFFSET_SENSOR, n=300).samples for seed in (1, 2))
    assert flinders.fit(Joined(tuple(both))).judgement.conditions == ("constant-iron",)


def test_a_second_recording_that_agrees_speaks_for_the_place() -> None:
    first, second = (simulate.tumble(seed=seed, sensor=OFFSET_SENSOR, n=1500).samples for seed in (1, 2))
    fit = flinders.fit(Joined((first, second)))
    assert (fit.verdict, fit.judgement.conditions) == ("good", ("constant-iron",))
    assert_sentences(condition(fit))


def test_the_strength_of_the_place_speaks_for_it_where_readings_have_it() -> None:
    samples = simulate.tumble(seed=1, sensor=OFFSET_SENSOR).samples
    there, elsewhere = (flinders.fit(samples, site=flinders.Site(strength=strength)) for strength in (50.0, 40.0))
    assert there.judgement.conditions == ("constant-iron",)
    assert "uniform-field" in elsewhere.judgement.conditions


def test_the_command_line_ends_each_with_its_evidence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second recording, the accelerometer's dip, the site, and a recorded current."""
    monkeypatch.chdir(tmp_path)
    for seed in (1, 2):
        write(
            f"{seed}.csv", simulate.tumble(seed=seed, sensor=OFFSET_SENSOR, field_strength=52.6, dip_deg=68.0).samples
        )
    site = ("--at", "47.62,-122.35", "--date", "2026-11-21")
    assert conditions_of() == ["uniform-field", "constant-iron"]
    assert conditions_of("2.csv") == conditions_of("--with", "dip") == conditions_of(*site) == ["constant-iron"]
    assert conditions_of("--with", "current") == ["uniform-field"]
    assert conditions_of("--with", "current,dip") == []


def conditions_of(*options: str) -> list[str]:
    """What a good calibration of the first recording rests on."""
    printed = flinders_("calibrate", "1.csv", *options, "--json").json
    assert printed["verdict"] == "good"
    return list(printed["conditions"])


def write(name: str, samples: flinders.Samples) -> None:
    """A table of readings, acceleration and a current that comes and goes."""
    assert samples.time is not None
    assert samples.acceleration is not None
    current = 5.0 + 4.0 * np.sin(np.arange(len(samples)) / 60.0)
    columns = "time_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x_mps2,acc_y_mps2,acc_z_mps2,current_A"
    rows = np.column_stack([samples.time, samples.field, samples.acceleration, current])
    np.savetxt(name, rows, delimiter=",", header=columns, comments="", fmt="%.5f")


RENDERINGS: Final[dict[str, tuple[str, ...]]] = {
    "terminal": ("calibrate", "1.csv"),
    "JSON": ("calibrate", "1.csv", "--json"),
    "report": ("calibrate", "1.csv", "--report", "page.html"),
}
"""Commands that state a good verdict."""


def assert_states_it(words: tuple[str, ...], folder: Path) -> None:
    """Of a recording in a folder, with a current that follows the attitude."""
    samples = simulate.tumble(seed=1, sensor=OFFSET_SENSOR).samples
    down = -np.asarray(samples.acceleration)[:, 2] / 9.81
    follows = samples.field + np.outer(1.5 * (down > 0.0), [0.6, 0.0, 0.8])
    (folder / "logs").mkdir()
    for name in ("1.csv", "logs/unit1.csv"):
        write(str(folder / name), replace(samples, field=follows))
    ran = flinders_(*words)
    page = folder / "page.html"
    said = ran.out + (page.read_text(encoding="utf-8") if page.exists() else "")
    assert "good" in said.lower()
    assert ('"constant-iron"' if "--json" in words else "currents are constant") in said


@pytest.mark.parametrize("rendering", RENDERINGS)
def test_a_current_that_follows_the_attitude_is_a_condition_wherever_a_verdict_is_stated(
    rendering: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hides in the calibration, which looks good: 56 of 61 are wrong (docs/adversary.md)."""
    monkeypatch.chdir(tmp_path)
    assert_states_it(RENDERINGS[rendering], tmp_path)


def test_a_current_that_is_compensated_is_no_condition() -> None:
    samples = simulate.tumble(seed=3, sensor=OFFSET_SENSOR, disturbances=[MOTORS]).samples
    fit = flinders.fit(samples, disturbances=("current",))
    assert fit.verdict != "good" or fit.judgement.conditions == ("uniform-field",)
    good = replace(fit, judgement=Judgement())
    assert good.verdict == "good"


def test_a_file_keeps_them(tmp_path: Path) -> None:
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    fit.save(tmp_path / "calibration.json")
    assert load(tmp_path / "calibration.json").judgement.conditions == fit.judgement.conditions != ()
