"""What is read while the direction stands still counts as one reading, whatever the field is there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks import adversary
from benchmarks.datasets import heading_error_deg
from tests.worlds import judged, rms

import flinders
from flinders import simulate
from flinders.core.samples import Joined, Samples
from flinders.estimators import Readings
from flinders.estimators.aiding import solve
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
    field = of.field_strength * (1.0 + off) * simulate.uniform(rng, 1)
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
    assert fit.samples <= alone.samples + 1
    assert "at-rest" in {finding.code for finding in fit.findings}


def test_a_rest_that_does_not_fit_is_a_note_with_its_time() -> None:
    fit = flinders.fit(put_down(turned(), "after", 15.0, 0.1))
    (rest,) = fit.outliers
    assert (rest.start, rest.end) == (30.0, 44.98)
    assert (rest.first, rest.last, rest.rows, rest.fitted) == (1501, 2250, 750, 1)
    assert str(rest) == "30.0–45.0 s: 750 readings at rest"
    assert {finding.severity for finding in fit.findings if finding.code == "outliers"} == {"note"}


def test_rests_are_found_where_they_are() -> None:
    of = turned()
    field = of.samples.field
    samples = np.concatenate([still(of, 2.0, 0.0), field[:700], still(of, 20.0, 0.1, seed=2), field[700:]])
    first, second = Rests.of(timed(samples)).bounds.tolist()
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
        "all directions": 50.0 * simulate.uniform(np.random.default_rng(1), 500),
        "level turn": slow + 0.5 * np.random.default_rng(1).standard_normal(slow.shape),
        "flight": simulate.tumble(seed=1, motion="flight", n=1500).samples.field,
        "drive": simulate.tumble(seed=1, motion="drive", n=1500).samples.field,
        "outliers": simulate.tumble(seed=1, n=1000, outliers=0.03).samples.field,
        "five readings": slow[:5],
        "no noise": slow,
    }
    assert not len(engine().rests(worlds[name]))


def test_a_sensor_that_never_moves_has_no_reading_left_to_fit() -> None:
    """Nothing is averaged then, and the fit is refused as before."""
    assert not len(engine().rests(still(turned(), 10.0, 0.0)))


@pytest.mark.parametrize("held", [5, 50, 200])
def test_poses_claim_what_the_places_differ_by(held: int, trials: Choose) -> None:
    """Two dozen poses, at each of which the field is another by 0.5 %: the readings of a pose err alike."""
    claim, ratios = trials(60, 12), []
    for seed in claim.seeds:
        of, rng = turned(seed, 50), np.random.default_rng(seed)
        strength = of.field_strength * (1.0 + 0.005 * rng.standard_normal((24, 1)))
        fit = judged(timed(of.sensor.read(np.repeat(strength * simulate.uniform(rng, 24), held, axis=0), rng)))
        assert fit.verdict in ("good", "limited")
        error = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, of)
        ratios.append(error / fit.heading_error_deg.rms)
    low, high = claim.ratios(0.7, 1.3)
    assert low < rms(ratios) < high


def test_the_engine_fits_what_rests_are_averaged_to() -> None:
    samples = put_down(turned(), "between", 15.0, 0.03)
    rests = Rests.of(samples)
    averaged = rests.averaged(samples)
    record, again = engine().fit(samples.field), engine().fit(averaged.field, rests=0)
    npt.assert_allclose(record["centre"], again["centre"], rtol=1e-9)
    npt.assert_allclose(record["covariance"], again["covariance"], rtol=1e-6, atol=1e-12)
    assert [int(record[name]) for name in ("rows", "rests", "at_rest")] == [2250, len(rests), rests.at_rest]
    assert record["fitted"] == rests.count == len(averaged) == again["rows"]


def test_a_rest_ends_with_its_recording() -> None:
    of = turned()
    first, second = (timed(np.concatenate([of.samples.field, still(of, 10.0, 0.0)])), timed(still(of, 10.0, 0.0)))
    once = Readings.of(Joined((first, replace(second, source="still")))).averaged()
    assert [len(part) for part in once.parts] == [1501, 1]
    assert [part.recording.source for part in once.parts if part.recording is not None] == ["array", "still"]


def test_columns_beside_the_readings_are_averaged_with_them() -> None:
    field = np.concatenate([turned(n=300).samples.field, np.tile([30.0, 0.0, 40.0], (100, 1))])
    rows = len(field)
    samples = Samples.of(
        field,
        unit="uT",
        time=np.arange(rows),
        current=np.where(np.arange(rows) < 350, np.nan, 4.0),
        attitude=np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1)),
    )
    once = Rests.of(samples).averaged(samples)
    assert len(once) == 301
    assert once.time is not None
    assert once.current is not None
    assert (once.time[-1], once.current[-1]) == (349.5, 4.0)
    assert once.attitude is not None
    assert once.attitude[-1].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_a_fit_with_aiding_sensors_takes_a_rest_as_one_reading() -> None:
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
    alone, with_rest = (solve(each, ("rate", "dip")) for each in (samples, longer))
    sigma = np.sqrt(np.diag(alone.covariance)[:3])
    assert float(np.max(np.abs(with_rest.parameters.offset - alone.parameters.offset) / sigma)) < 1.0


def test_a_fleet_counts_rests_as_a_fit_does() -> None:
    samples = [put_down(turned(seed), "after", 15.0, off) for seed, off in ((1, 0.0), (2, 0.03), (3, 0.12))]
    columns = fit_batch(samples)
    for place, one in enumerate(samples):
        fit = flinders.fit(one)
        assert (columns.verdict[place], columns.used[place]) == (fit.verdict, fit.samples)
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
