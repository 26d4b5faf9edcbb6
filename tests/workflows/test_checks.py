"""`flinders.check` and `flinders.apply` of simulated sensors whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises
from tests.worlds import Streamed

import flinders
from flinders import simulate
from flinders.errors import InputError, NotExportable, TooFewSamples, UnitError, UsageError
from flinders.fitting.result import Refused
from flinders.workflows.correction import CorrectionStream
from flinders.workflows.recordings import recording_for

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated


@pytest.fixture(scope="module")
def tumble() -> Simulated:
    return simulate.tumble(seed=1)


@pytest.fixture(scope="module")
def fit(tumble: Simulated) -> Fit:
    return flinders.fit(tumble.samples)


def moved(tumble: Simulated, seed: int, offset: float) -> Simulated:
    """The sensor on another day, its offset moved along x by some µT."""
    sensor = replace(tumble.sensor, offset=tumble.sensor.offset + np.array([offset, 0.0, 0.0]))
    return simulate.tumble(seed=seed, sensor=sensor)


# check


def test_a_calibration_holds_on_another_day_and_fails_after_its_offset_moved(tumble: Simulated, fit: Fit) -> None:
    holds, vague, fails = (flinders.check(moved(tumble, 2, offset).samples, fit) for offset in (0.0, 0.4, 5.0))
    assert (holds.answer, vague.answer, fails.answer) == ("holds", "cannot-tell", "fails")
    assert fails.comparison is not None
    npt.assert_allclose(fails.comparison.offset_difference, [5.0, 0.0, 0.0], atol=0.2)
    assert fails.strength.spread > 4.0 * holds.strength.spread
    assert fails.fresh_strength is not None
    assert fails.fresh_strength.spread < 1.2 * holds.strength.spread


def test_a_recording_that_cannot_be_fitted_says_so_with_the_fit(tumble: Simulated, fit: Fit) -> None:
    samples = simulate.tumble(seed=3, sensor=tumble.sensor, motion="wobble").samples
    checked = flinders.check(samples, fit, follow=True)
    assert checked.answer == "cannot-tell"
    assert checked.comparison is None
    assert checked.refusal is not None
    assert checked.fresh.verdict == "refused"
    assert checked.random_walk is not None
    assert set(checked.as_dict()) == {"answer", "residual", "fresh", "drift"}
    with pytest.raises(TooFewSamples):
        flinders.check(samples[:5], fit)


def test_a_recording_that_the_calibration_was_made_from_proves_nothing(
    tmp_path: Path, tumble: Simulated, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flinders.cli import main

    monkeypatch.chdir(tmp_path)
    simulate.write_csv(tumble.samples, "tumble.csv")
    main(["calibrate", "tumble.csv", "-o", "calibration.json"], standalone_mode=False)
    checked = flinders.check("tumble.csv", "calibration.json")
    assert checked.comparison is not None
    assert (checked.comparison.answer, checked.made_from) == ("holds", ("tumble.csv",))
    assert (checked.answer, checked.limiting) == ("cannot-tell", None)


def test_an_offset_that_drifts_is_followed(tumble: Simulated, fit: Fit) -> None:
    later = moved(tumble, 4, 0.0).samples
    drifted = later.field + np.linspace(0.0, 1.0, len(later))[:, np.newaxis] * [6.0, 0.0, 0.0]
    checked = flinders.check(replace(later, field=drifted), fit, follow=True)
    assert checked.random_walk is not None
    assert checked.random_walk.is_proven
    assert checked.random_walk.offset_change == pytest.approx(6.0, rel=0.3)


def test_headings_are_compared_at_the_dip_of_the_site(tumble: Simulated, fit: Fit) -> None:
    later = moved(tumble, 2, 1.0).samples
    flat, steep = (
        flinders.check(later, fit, site=flinders.Site(inclination_deg=dip_deg)).comparison for dip_deg in (0.0, 75.0)
    )
    assert flat is not None
    assert steep is not None
    assert steep.heading_difference_deg.worst > 3.0 * flat.heading_difference_deg.worst


# apply


def test_a_corrected_recording_has_the_true_field(tumble: Simulated, fit: Fit) -> None:
    later = moved(tumble, 2, 0.0)
    corrected = flinders.apply(later.samples, fit)
    directions = corrected.samples.field / np.linalg.norm(corrected.samples.field, axis=1, keepdims=True)
    off = np.rad2deg(np.arccos(np.sum(directions * later.directions, axis=1).clip(-1.0, 1.0)))
    noise_deg = np.rad2deg(later.sensor.noise / later.field_strength)
    assert np.sqrt(np.mean(off**2)) < 1.6 * noise_deg  # two axes across the field
    assert corrected.summary.notes == ()
    assert corrected.samples.time is not None
    npt.assert_array_equal(corrected.samples.field, fit.calibration.apply(later.samples.field))


def test_a_unit_that_was_given_stays_as_it_is(tumble: Simulated, fit: Fit, tmp_path: Path) -> None:
    """Names of columns do not state it; a recording of which nobody says it has the calibration's."""
    path = tmp_path / "bare.csv"
    np.savetxt(path, 10.0 * tumble.samples.field, delimiter=",", header="mx,my,mz", comments="")
    given = flinders.open_recording(path, unit="mG")
    corrected = flinders.apply(given, fit).samples.field
    assert np.linalg.norm(corrected, axis=1).mean() == pytest.approx(fit.calibration.field_strength, rel=0.01)


@pytest.mark.parametrize("by", [None, "median:5", "kalman"])
def test_a_stream_is_corrected_as_the_whole(tumble: Simulated, fit: Fit, by: str | None) -> None:
    from flinders.heading.smoothing import Filter

    whole = flinders.apply(tumble.samples, fit, by=by)
    stream = CorrectionStream.of(Streamed(tumble.samples), fit, by=None if by is None else Filter.of(by))
    blocks = list(stream.blocks())
    assert len(blocks) > 1
    npt.assert_allclose(np.concatenate([block.field for block in blocks]), whole.samples.field, rtol=1e-12)
    assert stream.summary().strength.spread == pytest.approx(whole.summary.strength.spread)


def test_disturbances_are_compensated_or_taken_at_a_value() -> None:
    flown = simulate.tumble(seed=5, disturbances=[simulate.MotorCurrent(per_ampere=np.array([0.5, 0.0, -0.3]))])
    fit = flinders.fit(flown.samples, disturbances=["current"])
    corrected = flinders.apply(flown.samples, fit)
    assert corrected.summary.strength.spread < 0.02
    assert corrected.summary.as_dict()["findings"] == []
    bare = replace(flown.samples, current=None)
    with pytest.raises(InputError, match="current"):
        flinders.apply(bare, fit)
    assert flinders.apply(bare, fit, at={"current": 0.0}).summary.strength.spread > 0.03


def test_readings_of_another_sensor_unit_or_wire_are_noted_or_refused(tumble: Simulated, fit: Fit) -> None:
    field = tumble.samples.field
    assert [note.code for note in flinders.apply(simulate.tumble(seed=9).samples, fit).summary.notes] == ["unsuited"]
    stuck = field.copy()
    stuck[:, 2] = 7.0
    (note,) = flinders.apply(stuck, fit).summary.notes
    assert (note.code, note.values["axes"]) == ("stuck", "z = 7")
    with assert_raises(InputError):
        flinders.apply(10.0 * field, fit)
    with pytest.raises(UnitError):
        flinders.apply(flinders.Samples.of(field), fit)


def test_an_array_is_in_unit_and_axes_of_the_calibration_and_several_recordings_are_joined(
    tumble: Simulated, fit: Fit
) -> None:
    recording = recording_for(tumble.samples.field, fit)
    assert (recording.unit, recording.axes) == (fit.calibration.raw, fit.calibration.axes)
    both = recording_for([tumble.samples, moved(tumble, 2, 0.0).samples], fit)
    assert sum(len(block) for block in both.blocks()) == 6000


# export


def test_an_export_has_the_limits_of_its_fit_and_refuses_one_that_is_not_fit_for_use(tumble: Simulated) -> None:
    few = flinders.fit(tumble.samples[:500], target_deg=0.1)
    exported = flinders.export(few, "c", name="port")
    assert few.verdict == "limited"
    assert exported.limits
    assert "port_" in exported.export.text
    with pytest.raises(Refused) as refused:
        flinders.fit(tumble.samples[:60])
    with pytest.raises(NotExportable):
        flinders.export(refused.value.fit, "c")
    with assert_raises(UsageError):
        flinders.export(few, "arduin")
