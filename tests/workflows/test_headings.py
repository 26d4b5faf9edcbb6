"""`flinders.headings` of simulated turns: the true headings within the claimed error, and notes where they are not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.worlds import Streamed

import flinders
from flinders import simulate
from flinders.core.geomag import site_field
from flinders.errors import AxesError, NoAccelerometer, UsageError
from flinders.geometry.angles import wrap_180
from flinders.heading.axis_consistency import ForeignAxes
from flinders.workflows.heading_stream import HeadingStream
from flinders.workflows.notes import SENTENCES, Note

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.trials import Trials

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated


def true_headings(turn: Simulated) -> Floats:
    """(N,) degrees from magnetic north to the body's x axis."""
    assert turn.attitudes is not None
    return np.rad2deg(np.arctan2(turn.attitudes[:, 1, 0], turn.attitudes[:, 0, 0]))


@pytest.fixture(scope="module")
def tumble() -> Simulated:
    return simulate.tumble(seed=1)


@pytest.fixture(scope="module")
def fit(tumble: Simulated) -> Fit:
    return flinders.fit(tumble.samples)


def test_headings_of_a_level_turn_are_off_by_what_is_claimed(trials: Callable[[int, int], Trials]) -> None:
    """Of 400 sensors, each tumbled once and turned level without noise: rms error over its claim 0.95."""
    tried, ratios = trials(400, 20), []
    for seed in tried.seeds:
        tumble = simulate.tumble(seed=seed, n=500)
        turn = simulate.tumble(seed=seed, motion="level", sensor=tumble.sensor, noise=0.0, n=72)
        series = flinders.headings(turn.samples, flinders.fit(tumble.samples), level=True)
        off = wrap_180(series.headings.magnetic_deg - true_headings(turn))
        assert series.summary.claim.level is not None
        ratios.append(np.std(off) / series.summary.claim.level.rms)
    low, high = tried.ratios(0.9, 1.1)
    assert low < np.sqrt(np.mean(np.square(ratios))) < high


def test_headings_of_a_tilted_sensor_scatter_as_stated(tumble: Simulated, fit: Fit) -> None:
    turn = simulate.tumble(seed=2, motion="tilted", sensor=tumble.sensor)
    series = flinders.headings(turn.samples, fit)
    claim, off = series.summary.claim, wrap_180(series.headings.magnetic_deg - true_headings(turn))
    assert claim.dip_source == "measured"
    assert abs(claim.dip_deg - 60.0) < 0.5
    assert claim.level is not None
    assert claim.tilt_error_deg is not None
    assert np.std(off) < 1.2 * np.hypot(claim.level.worst, claim.tilt_error_deg)
    assert claim.tilted is not None
    assert claim.tilted.tilt_deg == series.summary.voyage.tilt_deg > 20.0


def test_true_headings_are_magnetic_ones_and_the_declination_of_the_site(tumble: Simulated, fit: Fit) -> None:
    site = site_field(47.62, -122.35, year=2025.0)
    by_site, by_number = (
        flinders.headings(tumble.samples, fit, **known)
        for known in ({"site": site}, {"declination_deg": site.declination_deg})
    )
    assert by_site.headings.true_deg is not None
    assert by_number.headings.true_deg is not None
    npt.assert_array_equal(by_site.headings.true_deg, by_number.headings.true_deg)
    npt.assert_allclose(
        wrap_180(by_site.headings.true_deg - by_site.headings.magnetic_deg), site.declination_deg, atol=1e-9
    )
    assert by_site.summary.claim.dip_source == "model"
    with assert_raises(UsageError):
        flinders.headings(tumble.samples, fit, site=site, declination_deg=1.0)


def test_blocks_of_a_stream_are_the_headings_of_the_whole(tumble: Simulated, fit: Fit) -> None:
    whole = flinders.headings(tumble.samples, fit, level=True)
    stream = HeadingStream.of(Streamed(tumble.samples, rows=700), fit, level=True)
    blocks = [(numbers, headings) for numbers, _, headings in stream.headings()]
    assert len(blocks) == 5
    npt.assert_array_equal(np.concatenate([numbers for numbers, _ in blocks]), np.arange(1.0, 3001.0))
    npt.assert_array_equal(np.concatenate([each.magnetic_deg for _, each in blocks]), whole.headings.magnetic_deg)
    assert whole.time is not None
    assert tumble.samples.time is not None
    npt.assert_array_equal(whole.time, tumble.samples.time)
    assert stream.summary().claim == whole.summary.claim


def test_a_log_and_a_file_of_a_calibration_are_read(tmp_path: Path, tumble: Simulated, fit: Fit) -> None:
    simulate.write_csv(tumble.samples, tmp_path / "tumble.csv")
    fit.save(tmp_path / "calibration.json")
    series = flinders.headings(tmp_path / "tumble.csv", tmp_path / "calibration.json")
    off = wrap_180(series.headings.magnetic_deg - flinders.headings(tumble.samples, fit).headings.magnetic_deg)
    assert np.nanmax(np.abs(off)) < 0.1
    assert series.summary.notes == (Note("mounting-unobserved"),)


def test_what_limits_headings_is_a_code_with_numbers(tumble: Simulated, fit: Fit) -> None:
    samples = tumble.samples
    tilted = flinders.headings(samples, fit, level=True).summary.notes
    assert [note.code for note in tilted] == ["tilt-cost", "tilted"]
    assert_sentences(str(tilted[1]))
    copied = flinders.headings(samples, fit, formula="an3192").summary.notes
    assert (copied[0].code, copied[0].severity) == ("an3192", "limits")
    over = replace(samples, acceleration=-samples.acceleration)  # type: ignore[operator]
    upward = flinders.headings(over, fit).summary.notes
    assert upward[0].code == "dip-upward"
    assert upward[0].values["up_deg"] == pytest.approx(60.0, abs=0.5)
    other = flinders.headings(simulate.tumble(seed=9).samples, fit).summary
    assert other.notes[0].code == "unsuited"
    assert_sentences(other.as_dict()["limits"][0])


def test_every_note_has_words() -> None:
    values = {
        "readings": 3, "axes": "x = 1", "mean": 1.1, "strength": 1.0, "spread": 0.2, "limit": 0.1, "words": "weak",
        "cost": 1.7, "share": 0.2, "scatter_deg": 20.0, "up_deg": 60.0, "axes_needed": "", "difference_deg": 5.0,
    }  # fmt: skip
    for code in SENTENCES:
        used = {**values, "readings": "3 readings"} if code == "without-heading" else values
        kept = {name: value for name, value in used.items() if name != "axes" or code == "stuck"}
        assert "{" not in Note(code, "note", kept).words()


def test_what_cannot_be_a_heading_is_refused(tumble: Simulated, fit: Fit) -> None:
    samples = tumble.samples
    with pytest.raises(NoAccelerometer):
        flinders.headings(samples.field, fit)
    assert samples.acceleration is not None
    with pytest.raises(ForeignAxes):
        flinders.headings(replace(samples, acceleration=samples.acceleration[:, [1, 0, 2]]), fit)
    with pytest.raises(AxesError):
        flinders.headings(samples.map_axes(flinders.Axes.of("x,-y,-z")), fit)
    with assert_raises(UsageError, "unknown-parameter"):
        flinders.headings(samples, fit, columns="1,2,3")  # type: ignore[call-arg]
    with assert_raises(UsageError):
        flinders.headings(samples, fit, level=True, formula="an4248")
