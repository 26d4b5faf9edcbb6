"""Fleets whose drift is known: what changed is found, what did not is left alone, by the numbers of `compare`."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.drift import Fleet, simulated
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.apps.fleet.aggregate import overview_of
from flinders.apps.fleet.change_points import Variance, change_points, estimate_variance, interval_tests
from flinders.apps.fleet.drift import drift_of
from flinders.apps.fleet.history import OffsetSeries, histories
from flinders.apps.fleet.report import page
from flinders.apps.fleet.results import UnitResult, UnitResults
from flinders.cli import main
from flinders.comparison.comparison import compare
from flinders.comparison.pairs import EllipsoidPairs, differences
from flinders.errors import DocumentError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.drift import Truth

    from flinders.apps.fleet.overview import UnitDrift

parquet = pytest.importorskip("pyarrow.parquet")

DAY = 86400.0


@cache
def fleet(step_deg: float = 0.0, claimed: float = 1.0, units: int = 300, seed: int = 4) -> tuple[UnitResults, Truth]:
    walk = 2e-7 if step_deg else 0.0
    made = Fleet(units=units, step_deg=step_deg, claimed=claimed, walk=walk)
    return simulated(made, np.random.default_rng(seed))


def written(folder: Path, rows: UnitResults, name: str = "fleet.parquet") -> Path:
    parquet.write_table(rows.to_arrow(), folder / name, row_group_size=97)
    return folder / name


def named(places: np.ndarray) -> set[str]:
    return {f"U{place:07d}" for place in np.flatnonzero(places).tolist()}


def test_a_pair_of_a_fleet_has_the_numbers_of_compare() -> None:
    fits = []
    for seed in range(4):
        sensor = simulate.Sensor(noise=0.5, offset=np.array([20.0, -10.0, 5.0 + seed]))
        fits.append(flinders.fit(simulate.tumble(seed=seed, n=300, motion="uniform", sensor=sensor).samples))
    rows = UnitResults.of([UnitResult(unit="A").with_fit(fit) for fit in fits])
    all_of_them = EllipsoidPairs.of_columns(rows.offset, rows.matrix, rows.covariance, rows.field_strength)
    found = differences(all_of_them[:-1], all_of_them[1:], dip_deg=-40.0)
    for place, (one, two) in enumerate(pairwise(fits)):
        alone = compare(one, two, dip_deg=-40.0)
        assert alone.claimed_deg is not None
        assert alone.chi_square is not None
        expected = [
            alone.heading_difference_deg.rms, alone.heading_difference_deg.worst, alone.heading_mean_deg,
            alone.claimed_deg.rms, alone.claimed_deg.worst, alone.scale_difference, alone.chi_square, alone.freedom,
        ]  # fmt: skip
        names = ("rms_deg", "worst_deg", "mean_deg", "sigma_rms_deg", "sigma_deg", "scale", "chi_square", "freedom")
        npt.assert_allclose([getattr(found, name)[place] for name in names], expected, rtol=1e-9, atol=1e-12)


def test_a_unit_upside_down_is_judged_so_and_the_others_as_they_sit(tmp_path: Path) -> None:
    """The dip is that of each unit's recordings, and not that of the first in the table."""
    rows, _ = fleet(step_deg=4.0)
    over = replace(rows, dip_deg=np.where(rows.unit == rows.unit[0], -rows.dip_deg, rows.dip_deg))
    told: list[list[UnitDrift]] = [[], []]
    drifts = [
        drift_of([written(tmp_path, each, name)], each=into.extend)
        for each, name, into in ((rows, "upright.parquet", told[0]), (over, "over.parquet", told[1]))
    ]
    assert drifts[0].dip_deg == drifts[1].dip_deg == rows.dip_deg[-1]
    assert told[0][1:] == told[1][1:]
    assert told[0][0].worst_deg != told[1][0].worst_deg
    given = drift_of([written(tmp_path, over)], dip_deg=float(rows.dip_deg[0]))
    assert given.states == drifts[0].states


def test_the_chance_of_a_chi_square_is_that_of_scipy() -> None:
    from scipy import stats

    from flinders.comparison.pairs import p_values

    chi_square = np.geomspace(0.01, 300.0, 60)
    for freedom in (1, 2, 3, 8, 9, 30):
        expected = stats.chi2.sf(chi_square, freedom)
        npt.assert_allclose(p_values(chi_square, np.full(60, freedom)), expected, rtol=1e-9)


def test_units_with_a_step_are_found_and_the_others_left_alone(tmp_path: Path) -> None:
    rows, truth = fleet(step_deg=4.0)
    units: list[UnitDrift] = []
    drift = drift_of([written(tmp_path, rows)], each=units.extend)
    stepped = named(truth.has_step)
    reported = {step.unit for step in drift.steps}
    assert reported <= stepped
    assert len(reported) >= 0.7 * len(stepped) > 3
    assert {unit.unit for unit in units if unit.state == "recalibrate"} == stepped
    assert drift.states["recalibrate"] == len(stepped)
    assert sum(drift.states.values()) == len(units) == 300


def test_a_step_is_as_large_as_it_was_made(tmp_path: Path) -> None:
    rows, truth = fleet(step_deg=4.0)
    for step in drift_of([written(tmp_path, rows)]).steps:
        assert step.worst_deg == pytest.approx(truth.change_deg[int(step.unit[1:])], abs=0.8)


def test_nothing_is_reported_of_fleets_in_which_nothing_moved(tmp_path: Path) -> None:
    for seed in range(2):
        drift = drift_of([written(tmp_path, fleet(seed=seed)[0])])
        assert drift.step_count == drift.states["recalibrate"] == drift.states["changed"] == 0


def test_claims_that_are_too_small_are_widened_and_make_no_alarm(tmp_path: Path) -> None:
    drift = drift_of([written(tmp_path, fleet(claimed=0.5)[0])])
    assert drift.variance_factor == pytest.approx(4.0, rel=0.25)
    assert drift.step_count == drift.states["recalibrate"] == 0


def test_a_unit_that_drifts_steadily_has_no_step() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(10) * 30.0 * DAY
    offset = np.outer(np.linspace(0.0, 0.1, 10), [1.0, 0.0, 0.0]) + 0.001 * rng.normal(size=(10, 3))
    covariance = np.tile(1e-6 * np.eye(3), (10, 1, 1))
    assert change_points(OffsetSeries(np.array([0, 10]), time, offset, covariance), Variance(), chance=1e-4) == []
    offset[6:] += [0.0, 0.05, 0.0]
    assert [
        step.after
        for step in change_points(OffsetSeries(np.array([0, 10]), time, offset, covariance), Variance(), chance=1e-4)
    ] == [5]


def test_two_steps_of_a_unit_are_both_found() -> None:
    rng = np.random.default_rng(1)
    offset = 0.001 * rng.normal(size=(12, 3))
    offset[4:, 0] += 0.05
    offset[9:, 1] -= 0.05
    lines = OffsetSeries(np.array([0, 12]), np.arange(12) * DAY, offset, np.tile(1e-6 * np.eye(3), (12, 1, 1)))
    assert [step.after for step in change_points(lines, Variance(), chance=1e-4)] == [3, 8]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("same", [slice(0, 12), slice(2, 7), slice(5, 7)])
def test_recordings_of_the_same_time_overflow_nothing_and_hide_no_step(same: slice) -> None:
    offset = 0.001 * np.random.default_rng(1).normal(size=(12, 3))
    offset[6:, 0] += 0.05
    time = np.arange(12) * DAY
    time[same] = time[same][0]
    lines = OffsetSeries(np.array([0, 12]), time, offset, np.tile(1e-6 * np.eye(3), (12, 1, 1)))
    unclaimed = replace(lines, covariance=lines.covariance / 100.0)  # all changes show a drift then
    gaps = interval_tests(unclaimed, np.array([0]), np.array([12]), Variance())
    assert np.max(gaps.square) < 1.0
    assert np.isfinite(gaps.p_value).all()
    assert [step.after for step in change_points(lines, Variance(), chance=1e-4)] == [5]


def test_few_pairs_say_nothing_of_how_a_fleet_scatters() -> None:
    assert estimate_variance(np.ones((10, 3)), np.tile(np.eye(3), (10, 1, 1)), np.ones(10)) == Variance(pairs=10)


def test_units_spread_over_tables_and_any_number_of_rows_at_once_give_the_same(tmp_path: Path) -> None:
    rows, _ = fleet(step_deg=4.0)
    whole = written(tmp_path, rows)
    odd = np.arange(len(rows)) % 2 == 1
    parts = [written(tmp_path, rows[np.flatnonzero(~odd)], "even"), written(tmp_path, rows[np.flatnonzero(odd)], "odd")]
    assert drift_of([whole]).as_dict() == drift_of(parts).as_dict()
    few, many = ([one for block in histories([whole], rows=size) for one in block.unit] for size in (101, 10_000))
    assert few == many == sorted(set(rows.unit))


def test_rows_without_a_calibration_or_a_time_are_no_reason_to_fail(tmp_path: Path) -> None:
    rows, _ = fleet(step_deg=4.0)
    start = rows.start_s.copy()
    start[:5] = np.nan
    lost = [
        UnitResult(unit="Z1", verdict="failed", code="unreadable"),
        UnitResult(unit="Z2", verdict="refused", code="one-plane"),
    ]
    more = UnitResults.join([replace(rows, start_s=start), UnitResults.of(lost)])
    drift = drift_of([written(tmp_path, more)])
    assert (drift.without_calibration, drift.states["none"], drift.units) == (2, 2, 302)


def test_what_is_no_sorted_table_of_a_fleet_is_refused(tmp_path: Path) -> None:
    rows, _ = fleet()
    with assert_raises(DocumentError):
        drift_of([written(tmp_path, rows[np.arange(len(rows))[::-1]])])
    parquet.write_table(rows.to_arrow().select(["unit", "verdict"]), tmp_path / "other")
    with assert_raises(DocumentError):
        drift_of([tmp_path / "other"])
    (tmp_path / "text").write_text("no table")
    with assert_raises(DocumentError):
        drift_of([tmp_path / "text"])
    with assert_raises(DocumentError):
        drift_of([tmp_path / "nothing"])
    with pytest.raises(UsageError, match="target"):
        drift_of([tmp_path / "text"], target_deg=0.0)


def test_the_report_says_what_is_to_be_done_and_runs_nothing_of_others(tmp_path: Path) -> None:
    rows, _ = fleet(step_deg=4.0)
    evil = UnitResult(unit="<script>alert(1)</script>", verdict="failed", code="unreadable", message="<b>no</b>")
    path = written(tmp_path, UnitResults.join([UnitResults.of([evil]), rows]))
    drift = drift_of([path])
    text = page(overview_of([path]), drift)
    assert f"{drift.states['recalibrate']} units to recalibrate" in text
    assert drift.steps[0].unit in text
    assert "<script>alert" not in text
    assert "<b>no" not in text
    assert "&lt;script&gt;alert" in text
    assert "://" not in text
    assert len(text) < 2_000_000


def test_the_size_of_a_report_does_not_grow_with_the_fleet(tmp_path: Path) -> None:
    small, large = (written(tmp_path, fleet(units=units)[0], f"{units}") for units in (300, 1200))
    assert len(page(overview_of([large]))) < 1.1 * len(page(overview_of([small])))


def test_batches_come_from_a_column_a_pattern_or_the_name(tmp_path: Path) -> None:
    rows = [UnitResult(unit=f"L{line}-{n:03d}", verdict="good") for line in (1, 2) for n in range(20)]
    path = written(tmp_path, UnitResults.of(rows))
    assert overview_of([path]).batches == {"L1": {"good": 20}, "L2": {"good": 20}}
    assert set(overview_of([path], batch="[0-9]$").batches) == set("0123456789")
    path = written(tmp_path, UnitResults.of([replace(row, batch=f"week {n % 4}") for n, row in enumerate(rows)]))
    assert set(overview_of([path]).batches) == {"week 0", "week 1", "week 2", "week 3"}
    with assert_raises(UsageError):
        overview_of([path], batch="(")


def test_a_unit_of_several_batches_is_of_the_first_by_name_and_all_its_rows_are(tmp_path: Path) -> None:
    rows, _ = fleet(units=40)
    number, place = np.divmod(np.arange(len(rows)), 5)
    late = np.where(number % 2 == 0, "A", "B").astype(object)
    path = written(tmp_path, replace(rows, batch=np.where(place < 2, "Z", np.where(place < 3, "", late))))
    drift = drift_of([path])
    assert {lot.batch: lot.units for lot in drift.batches} == {"A": 20, "B": 20}
    for lot in drift.batches:
        assert sum(lot.verdicts.values()) == 100
        assert overview_of([path]).batches[lot.batch] == lot.verdicts


def test_rows_of_no_unit_are_left_out_and_tell_no_batch(tmp_path: Path) -> None:
    rows, _ = fleet(units=40)
    rows = replace(rows, unit=np.array([f"B{int(unit[1:]) // 20}-{unit}" for unit in rows.unit], dtype=object))
    lost = [
        UnitResult(unit=unit, verdict="failed", code="unreadable")
        for unit in ("", "(b.parquet)", "(c-1.csv)", "(d-1.csv)")
    ]
    path = written(tmp_path, UnitResults.join([rows, UnitResults.of(lost)]).sorted())
    for batch in (None, "unit_of_field", "^[^-]+"):
        drift, overview = drift_of([path], batch=batch), overview_of([path], batch=batch)
        assert (drift.units, overview.units, drift.without_calibration, drift.states["none"]) == (40, 40, 4, 0)
        assert sum(lot.units for lot in drift.batches) == 40
        assert {lot.batch: lot.verdicts for lot in drift.batches} == overview.batches
        assert sum(sum(lot.verdicts.values()) for lot in drift.batches) == 200
    with assert_raises(UsageError):
        overview_of([path], batch="parquet")
    real = replace(rows, unit=np.array([f"({unit})" for unit in rows.unit], dtype=object))
    assert drift_of([written(tmp_path, real)]).units == 40


def test_two_outputs_in_one_file_are_refused_before_anything_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, fleet(units=40)[0])
    before = path.read_bytes()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").symlink_to(tmp_path)
    for out, report in (
        ("x.parquet", "./x.parquet"),
        ("there/x.parquet", "x.parquet"),
        (path.name, "x.html"),
        ("x.parquet", f"there/{path.name}"),
    ):
        ended = CliRunner().invoke(main, ["drift", path.name, "--output", out, "--report", report, "--force"])
        assert ended.exit_code == 2
        assert "name" in ended.stderr
    assert path.read_bytes() == before
    assert sorted(each.name for each in tmp_path.iterdir()) == [path.name, "there"]


def test_the_command_ends_with_what_it_found(tmp_path: Path) -> None:
    moved, still = written(tmp_path, fleet(step_deg=4.0)[0], "moved"), written(tmp_path, fleet()[0], "still")
    out, report = tmp_path / "drift.parquet", tmp_path / "drift.html"
    ended = CliRunner().invoke(main, ["drift", str(moved), "-o", str(out), "--report", str(report), "--json"])
    assert ended.exit_code == 3
    told = json.loads(ended.stdout)
    table = parquet.read_table(out)
    assert table.column("state").to_pylist().count("recalibrate") == told["states"]["recalibrate"] > 0
    assert report.read_text(encoding="utf-8").startswith("<!doctype html>")
    again = CliRunner().invoke(main, ["drift", str(moved), "-o", str(out)])
    assert (again.exit_code, "exists" in again.stderr) == (6, True)
    quiet = CliRunner().invoke(main, ["drift", str(still)])
    assert quiet.exit_code == 0
    assert "recalibrate" not in quiet.stdout


def test_a_table_without_a_calibration_or_without_a_row_has_a_report(tmp_path: Path) -> None:
    for rows in ([UnitResult(unit="A", verdict="failed", code="unreadable", message="cut short")], []):
        path = written(tmp_path, UnitResults.of(rows))
        drift = drift_of([path])
        assert (drift.units, drift.intervals, drift.step_count) == (len(rows), 0, 0)
        assert "None to recalibrate" in page(overview_of([path]), drift)
        assert "0.0% good" in page(overview_of([path]))


@pytest.mark.parametrize(
    "name",
    [
        "monday.json",
        "monday.csv",
    ],
)
def test_what_is_no_table_of_a_fleet_is_named(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    samples = simulate.tumble(seed=3, motion="uniform").samples
    np.savetxt("monday.csv", samples.field, delimiter=",", header="mx_uT,my_uT,mz_uT", comments="")
    flinders.fit(samples).save("monday.json")
    ended = CliRunner().invoke(main, ["drift", name])
    assert (ended.exit_code, ended.stdout) == (2, "")
    assert_sentences(" ".join(ended.stderr.split()))
