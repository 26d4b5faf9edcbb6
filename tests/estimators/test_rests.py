"""What is read while the direction stands still counts as one reading, or none, whatever the field is there."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import adversary
from benchmarks.datasets import heading_error_deg
from tests.sentences import assert_sentences
from tests.worlds import judged, rms

import flinders
from flinders import simulate
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.estimators import Readings
from flinders.estimators.aiding import fit_aided
from flinders.estimators.rests import Rests
from flinders.fitting.batch import fit_batch
from flinders.native.engine import engine

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.simulate import Simulated

RATE_HZ = 50.0


def turned(seed: int = 0, n: int = 1500) -> Simulated:
    return simulate.tumble(seed=seed, n=n)


def still(of: Simulated, seconds: float, off: float, *, seed: int = 1) -> Floats:
    """Readings of the sensor in one attitude, where the field is another by a share of it."""
    rng = np.random.default_rng(seed)
    field = of.field_strength * (1.0 + off) * simulate.uniform_directions(rng, 1)
    return of.sensor.read(np.repeat(field, round(seconds * RATE_HZ), axis=0), rng)


def timed(field: Floats) -> Samples:
    return Samples.of(field, unit="uT", time=np.arange(len(field)) / RATE_HZ)


def put_down(of: Simulated, where: str, seconds: float, off: float) -> Samples:
    """A turn with a rest before, amid or behind it."""
    rest, field = still(of, seconds, off), of.samples.field
    middle = {"before": 0, "between": len(field) // 2, "after": len(field)}[where]
    return timed(np.concatenate([field[:middle], rest, field[middle:]]))


@pytest.mark.parametrize("off", [-0.2, -0.03, 0.0, 0.01, 0.1])
@pytest.mark.parametrize(("where", "seconds"), [("before", 5.0), ("between", 15.0), ("after", 60.0)])
def test_a_good_turn_stays_good_when_the_board_is_put_down(where: str, seconds: float, off: float) -> None:
    of = turned()
    alone, fit = flinders.fit(of.samples), flinders.fit(put_down(of, where, seconds, off))
    assert alone.verdict == fit.verdict == "good"
    npt.assert_allclose(fit.calibration.offset, alone.calibration.offset, atol=0.05)
    assert fit.heading_error_deg.worst < 1.1 * alone.heading_error_deg.worst
    assert fit.evidence.samples <= alone.evidence.samples


def test_rests_beside_a_turn_are_left_out_and_a_note_has_their_times() -> None:
    fit = flinders.fit(put_down(turned(), "after", 15.0, 0.1))
    (note,) = [finding for finding in fit.findings if finding.code == "at-rest"]
    assert (note.severity, round(note.number, 3)) == ("note", 0.333)
    assert_sentences(note.advice)
    assert not fit.evidence.outliers
    assert fit.evidence.samples == 1500


def test_a_pose_that_does_not_fit_is_left_out_with_its_time() -> None:
    """Of sixty poses one lies where the field is off by a fifth."""
    of, rng = turned(), np.random.default_rng(1)
    strength = of.field_strength * np.where(np.arange(60) == 12, 1.2, 1.0)[:, np.newaxis]
    samples = timed(of.sensor.read(np.repeat(strength * simulate.uniform_directions(rng, 60), 50, axis=0), rng))
    fit = judged(samples)
    (pose,) = fit.evidence.outliers
    npt.assert_allclose([pose.start_s, pose.end_s], [12.0, 12.98], atol=0.1)
    npt.assert_allclose([pose.readings, pose.independent], [50, 1], atol=4)
    assert str(pose).endswith("readings at rest")


def test_a_rest_says_nothing_of_directions_that_a_flight_did_not_see() -> None:
    """There it would have all the leverage, and the field of its place may be off by 15 %."""
    ratios = []
    for seed in range(12):
        of = simulate.tumble(seed=seed, motion="flight", n=1500)
        fit = judged(timed(np.concatenate([of.samples.field, still(of, 15.0, 0.15, seed=seed)])))
        error = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, of)
        ratios.append(error / fit.heading_error_deg.rms)
    assert rms(ratios) < 1.5


def test_rests_are_found_where_they_are() -> None:
    of = turned()
    field = of.samples.field
    samples = np.concatenate([still(of, 2.0, 0.0), field[:700], still(of, 20.0, 0.1, seed=2), field[700:]])
    rests = Rests.of(timed(samples))
    assert rests.are_left_out
    first, second = rests.bounds.tolist()
    assert first[0] == 0
    npt.assert_allclose([first[1], *second], [100, 800, 1800], atol=2)


@pytest.mark.parametrize(
    "name", ["all directions", "level turn", "flight", "drive", "outliers", "five readings", "no noise"]
)
def test_what_moves_is_no_rest(name: str) -> None:
    """However fast or slowly, however noisy: a turn of the same speed throughout has none."""
    headings = np.linspace(0.0, 2.0 * np.pi, 5000)[:, np.newaxis]
    slow = 30.0 * np.concatenate([np.cos(headings), np.sin(headings), 0.0 * headings], axis=1)
    worlds = {
        "all directions": 50.0 * simulate.uniform_directions(np.random.default_rng(1), 500),
        "level turn": slow + 0.5 * np.random.default_rng(1).standard_normal(slow.shape),
        "flight": simulate.tumble(seed=1, motion="flight", n=1500).samples.field,
        "drive": simulate.tumble(seed=1, motion="drive", n=1500).samples.field,
        "outliers": simulate.tumble(seed=1, n=1000, outliers=0.03).samples.field,
        "five readings": slow[:5],
        "no noise": slow,
    }
    assert not len(engine().rests(worlds[name])[0])


def test_a_sensor_that_never_moves_has_no_reading_left_to_fit() -> None:
    """There is no rest then, and the fit is refused as before."""
    assert not len(engine().rests(still(turned(), 10.0, 0.0))[0])


@pytest.mark.parametrize("held", [5, 50, 200])
def test_poses_claim_what_the_places_differ_by(held: int, trials: Choose) -> None:
    """Two dozen poses, at each of which the field is another by 0.5 %: the readings of a pose err alike."""
    claim, ratios = trials(60, 12), []
    for seed in claim.seeds:
        of, rng = turned(seed, 50), np.random.default_rng(seed)
        strength = of.field_strength * (1.0 + 0.005 * rng.standard_normal((24, 1)))
        fit = judged(
            timed(of.sensor.read(np.repeat(strength * simulate.uniform_directions(rng, 24), held, axis=0), rng))
        )
        assert fit.verdict in ("good", "limited")
        error = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, of)
        ratios.append(error / fit.heading_error_deg.rms)
    low, high = claim.ratios(0.7, 1.3)
    assert low < rms(ratios) < high


@pytest.mark.parametrize("poses", [0, 30])
def test_the_engine_fits_the_readings_that_rests_leave(poses: int) -> None:
    of, rng = turned(), np.random.default_rng(1)
    held = of.sensor.read(np.repeat(of.field_strength * simulate.uniform_directions(rng, 30), 50, axis=0), rng)
    samples = timed(held) if poses else put_down(of, "between", 15.0, 0.03)
    rests = Rests.of(samples)
    assert rests.are_left_out == (not poses)
    fitted = rests.average(samples)
    record, again = engine().fit(samples.field), engine().fit(fitted.field, rests=0)
    npt.assert_allclose(record["centre"], again["centre"], rtol=1e-9)
    npt.assert_allclose(record["covariance"], again["covariance"], rtol=1e-6, atol=1e-12)
    found = [int(record[name]) for name in ("rows", "rests", "at_rest", "fitted")]
    assert found == [len(samples), len(rests), rests.at_rest, len(fitted)]


def test_a_rest_ends_with_its_recording() -> None:
    """Each recording begins where the one before ended, and its rest there is another one."""
    of = turned()
    held = [still(of, 2.0, 0.0, seed=seed) for seed in range(1, 16)]
    each = [timed(np.concatenate(pair)) for pair in pairwise(held)]
    again = [replace(pose, source=f"pose {place}") for place, pose in enumerate(each)]
    once = Readings.of(Joined(tuple(again))).for_fit()
    assert [len(part) for part in once.parts] == [2] * 14
    assert [part.recording.source for part in once.parts if part.recording][3:5] == ["pose 3", "pose 4"]


def test_outliers_of_several_recordings_have_the_rows_that_were_read() -> None:
    """A rest and a level turn, twice over; one reading of the second is off."""
    of = simulate.tumble(seed=1, motion="level", n=2000)
    each = [np.concatenate([still(of, 4.0, 0.03), half]) for half in np.split(of.samples.field, 2)]
    each[1][775] *= 1.5
    fit = judged(Joined(tuple(map(timed, each))), method="level")
    assert [(run.first, run.last) for run in fit.evidence.outliers if run.readings == 1] == [(1976, 1976)]


def test_a_closed_form_claims_what_its_readings_tell() -> None:
    """The fit that its claim is widened by counts the same readings."""
    for seed in range(6):
        of = turned(seed)
        fit = judged(put_down(of, "after", 15.0, 0.03), method="consistent")
        error = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, of)
        assert error < 3.0 * fit.heading_error_deg.rms


def test_what_is_no_number_has_no_rests() -> None:
    field = put_down(turned(), "after", 15.0, 0.03).field.copy()
    field[0] = np.nan
    assert not len(engine().rests(field)[0])


def test_columns_beside_the_readings_are_averaged_with_them() -> None:
    field = np.repeat(50.0 * simulate.uniform_directions(np.random.default_rng(1), 20), 10, axis=0)
    rows = len(field)
    samples = Samples.of(
        field,
        unit="uT",
        time=np.arange(rows),
        current=np.where(np.arange(rows) < 195, np.nan, 4.0),
        attitude=np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1)),
    )
    once = Rests.of(samples).average(samples)
    assert len(once) == 20
    assert once.time is not None
    assert once.current is not None
    assert (once.time[-1], once.current[-1]) == (194.5, 4.0)
    assert np.isnan(once.current[:-1]).all()
    assert once.attitude is not None
    assert once.attitude[-1].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_a_rest_does_not_move_a_fit_with_aiding_sensors() -> None:
    """Thirty seconds on a table where the field is off by 5 % move an aided offset by less than its claim."""
    drive = simulate.tumble(seed=3, motion="flight", n=1500)
    samples = drive.samples
    assert samples.acceleration is not None
    assert samples.rate is not None
    rest = still(drive, 30.0, 0.05)
    longer = Samples.of(
        np.concatenate([samples.field, rest]),
        unit="uT",
        time=np.arange(len(samples) + len(rest)) / RATE_HZ,
        acceleration=np.concatenate([samples.acceleration, np.tile(samples.acceleration[-1:], (len(rest), 1))]),
        rate=np.concatenate([samples.rate, np.zeros_like(rest)]),
    )
    alone, with_rest = (fit_aided(each, ("rate", "dip")) for each in (samples, longer))
    sigma = np.sqrt(np.diag(alone.covariance)[:3])
    assert float(np.max(np.abs(with_rest.parameters.offset - alone.parameters.offset) / sigma)) < 1.0


def test_a_fleet_counts_rests_as_a_fit_does() -> None:
    samples = [put_down(turned(seed), "after", 15.0, off) for seed, off in ((1, 0.0), (2, 0.03), (3, 0.12))]
    columns = fit_batch(samples)
    for place, one in enumerate(samples):
        fit = flinders.fit(one)
        assert (columns.verdict[place], columns.samples[place]) == (fit.verdict, fit.evidence.samples)
        assert columns.worst_deg[place] == pytest.approx(fit.heading_error_deg.worst, rel=1e-6)


@pytest.mark.claims
def test_hardly_any_good_result_is_lost_on_a_table(trials: Choose) -> None:
    """By the worlds of `benchmarks.adversary`, which share nothing with the simulator here."""
    claim = trials(100, 10)
    rows = [("nothing", 1), ("a rest, field within 20 %", 1), ("three rests, field within 20 %", 1)]
    each = [adversary.tried_on(case, rows=rows) for case in adversary.cases_of(list(adversary.PATHS), claim.count)]
    good = [trial for trial in each if trial[0].verdict == "good"]
    kept = np.mean([[other.verdict == "good" for other in trial[1:]] for trial in good], axis=0)
    assert (kept >= 0.98).all()
