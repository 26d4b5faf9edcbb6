"""Which recording came first: dates that are dates, dates in names, names, and what is said where nothing tells."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.drift import Fleet, simulated
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.trials import daily

from flinders.apps.fleet.aggregate import overview_of
from flinders.apps.fleet.dates import arrange, date_of, is_date
from flinders.apps.fleet.drift import drift_of
from flinders.apps.fleet.history import batch_rule
from flinders.apps.fleet.report import page
from flinders.apps.fleet.results import UnitResults, objects
from flinders.cli import main

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.apps.fleet.overview import FleetDrift, UnitDrift
    from flinders.arrays import Floats

parquet = pytest.importorskip("pyarrow.parquet")

NONE = float("nan")
DAYS = ["2026-01-10", "2026-02-10", "2026-03-10", "2026-04-10", "2026-05-10"]


def fleet(**kind: float | bool) -> tuple[UnitResults, set[str]]:
    """Five recordings of 120 units, and the units that had something moved."""
    rows, truth = simulated(Fleet(units=120, walk=0.0, **kind), np.random.default_rng(6))  # type: ignore[arg-type]
    return rows, {f"U{place:07d}" for place in np.flatnonzero(truth.has_step).tolist()}


def with_starts(rows: UnitResults, names: list[str], start_s: Floats) -> UnitResults:
    return replace(rows, recording=objects(names * (len(rows) // len(names))), start_s=start_s)


def written(path: Path, rows: UnitResults) -> Path:
    parquet.write_table(rows.sorted().to_arrow(), path, row_group_size=97)
    return path


def drifts(path: Path, **options: str) -> tuple[FleetDrift, dict[str, UnitDrift]]:
    units: list[UnitDrift] = []
    drift = drift_of([path], each=units.extend, **options)  # type: ignore[arg-type]
    return drift, {unit.unit: unit for unit in units}


def to_recalibrate(units: dict[str, UnitDrift]) -> set[str]:
    return {name for name, unit in units.items() if unit.state == "recalibrate"}


@pytest.mark.parametrize(
    ("name", "date"),
    [
        ("2026-01-10.csv", (2026, 1, 10)),
        ("V7/20260110_123005.bin", (2026, 1, 10, 12, 30, 5)),
        ("log_2026-01-10T12-30-05.csv", (2026, 1, 10, 12, 30, 5)),
        ("2026/01/10/12_30_05.ulg", (2026, 1, 10, 12, 30, 5)),
        ("2026-01-10T12:30:05+02:00", (2026, 1, 10, 10, 30, 5)),
        ("2026-01-10-02.csv", (2026, 1, 10)),
        ("2026-01-10T1230Z", (2026, 1, 10, 12, 30)),
        ("20260110T123005-0200", (2026, 1, 10, 14, 30, 5)),
        ("2026-01-10 12:30:05.250", (2026, 1, 10, 12, 30, 5)),
        ("2026-01-10_0057.csv", (2026, 1, 10)),
        ("20260110_000062", (2026, 1, 10)),
        ("2026-01-10_12-60", (2026, 1, 10)),
        ("2026-01-10_12-30-05-07", (2026, 1, 10)),
        ("2026-01-05_2026-01-06", (2026, 1, 5)),
        ("2026-01-05_06-01-2026", (2026, 1, 5)),
    ],
)
def test_a_date_in_a_name_is_read(name: str, date: tuple[int, ...]) -> None:
    assert date_of(name) == datetime(*date, tzinfo=UTC).timestamp()  # type: ignore[arg-type, misc]


@pytest.mark.parametrize(
    "name", ["", "run 7", "2026-02-30", "12026011055", "serial 20991399", "3-4-2026", "2026-13-01", "20260110123005"]
)
def test_what_is_no_date_is_none(name: str) -> None:
    assert np.isnan(date_of(name))


def test_times_count_as_dates_only_where_they_count_from_1970() -> None:
    seconds = np.array([0.0, 900.0, 9e7, 1.7e9, 1.7e12, NONE, -1.7e9])
    assert is_date(seconds).tolist() == [False, False, False, True, False, False, False]


def test_dates_of_some_recordings_of_a_unit_give_no_order() -> None:
    start = np.array([1.7e9, 3.0, 1.71e9])
    assert not arrange(["run 9", "run 10", "run 11"], start).is_known
    assert arrange(["run 9", "run 10", "run 11"], np.full(3, 3.0)).is_known
    assert not arrange(["2026-01-10", "other", "2026-03-10"], np.full(3, NONE)).is_known
    assert not arrange(["3-4-2026", "4-4-2026"], np.full(2, NONE)).is_known
    assert not arrange(["10.1.2026", "31.1.2026"], np.full(2, NONE)).is_known


@pytest.mark.parametrize(
    ("pattern", "is_dated"),
    [("2026-01-10_{:04d}", True), ("20260110_{:06d}", True), ("2026-01-10_00-{}", True), ("20260110{:06d}", False)],
)
def test_numbers_that_follow_a_date_keep_their_order_and_are_no_times(pattern: str, is_dated: bool) -> None:
    names = [pattern.format(number) for number in range(57, 63)]
    found = arrange(names[::-1], np.full(6, NONE))
    assert [names[::-1][place] for place in found.places] == names
    assert found.is_known
    assert found.is_dated == is_dated
    assert len({repr(date) for date in found.date_s}) == 1


@pytest.mark.parametrize("one", ["2026-01-10", "2026-01-10_0057", "2026-01-10 after"])
def test_a_day_beside_a_time_of_that_day_is_in_no_order(one: str) -> None:
    assert not arrange([one, "2026-01-10T08-00"], np.full(2, NONE)).is_known
    assert not arrange(["2026-01-10T08-00", one, "2026-01-10T09-00"], np.full(3, NONE)).is_known
    assert arrange([one, "2026-01-11T00-00", "2026-01-09T23-59-59.999"], np.full(3, NONE)).places == [2, 0, 1]


def test_equal_names_are_told_apart_by_their_tables_or_not_at_all() -> None:
    assert not arrange(["", ""], np.array([3.0, 900.0])).is_known
    assert arrange(["", ""], np.array([3.0, 900.0]), [1, 0]).places == [1, 0]


def test_clocks_of_some_recordings_must_agree_with_the_dates_in_all_names() -> None:
    noon = datetime(2026, 1, 10, 12, tzinfo=UTC).timestamp()
    assert arrange(["2026-01-10 1", "2026-01-10 2"], np.array([NONE, noon])).is_known
    twice = np.array([NONE, noon, noon + 60.0])
    assert not arrange(["2026-01-10 2", "2026-01-10 3", "2026-01-10 1"], twice).is_known
    assert arrange(["2026-01-10T08-00", "2026-01-10T12-00"], np.array([NONE, noon])).places == [0, 1]
    assert arrange(["2026-01-08 b", "2026-01-10 a"], np.array([NONE, noon])).is_dated


@pytest.mark.parametrize("against", daily(["first", "previous"]))
def test_seconds_since_a_boot_give_no_order_and_dates_in_names_do(tmp_path: Path, against: str) -> None:
    rows, _ = fleet(step_deg=5.0)
    boot = with_starts(rows, DAYS, np.tile([900.0, 700.0, 400.0, 20.0, 3.0], 120))
    days = np.array([date_of(day) for day in DAYS])
    dated = with_starts(rows, DAYS, np.tile(days, 120))
    found, expected = (drifts(written(tmp_path / "t", each), against=against) for each in (boot, dated))
    assert found[1] == expected[1]
    assert found[0].as_dict() == expected[0].as_dict()
    assert all(unit.newest == DAYS[-1] and unit.newest_s == days[-1] for unit in found[1].values())


def test_without_dates_names_tell_the_order_and_a_step_is_told_by_them(tmp_path: Path) -> None:
    rows, stepped = fleet(step_deg=5.0, is_dated=False)
    drift, units = drifts(written(tmp_path / "fleet.parquet", rows))
    assert to_recalibrate(units) == stepped
    assert {step.unit for step in drift.steps} == stepped
    assert all(step.before.startswith("run ") and np.isnan(step.before_s) for step in drift.steps)
    assert (drift.undated.units, drift.pairs, drift.random_walk_deg_per_root_year) == (120, 0, 0.0)
    told = CliRunner().invoke(main, ["drift", str(tmp_path / "fleet.parquet")])
    assert_sentences(told.stdout, about="120 units")
    assert "year" not in told.stdout
    fields = json.loads(CliRunner().invoke(main, ["drift", str(tmp_path / "fleet.parquet"), "--json"]).stdout)
    assert fields["undated"]["units"] == 120
    assert fields["steps"][0]["before_s"] is None
    assert_sentences(page(overview_of([tmp_path / "fleet.parquet"]), drift), about="120 units")


@pytest.mark.parametrize("claimed", daily([1.0, 0.5]))
def test_nothing_is_reported_of_undated_fleets_in_which_nothing_moved(tmp_path: Path, claimed: float) -> None:
    rows, _ = fleet(is_dated=False, claimed=claimed)
    drift, _ = drifts(written(tmp_path / "t", rows))
    assert drift.step_count == drift.states["recalibrate"] == drift.states["changed"] == 0
    assert drift.undated.variance_factor == pytest.approx(claimed**-2, rel=0.3)


def test_a_few_units_without_dates_are_held_against_how_the_others_scatter(tmp_path: Path) -> None:
    rows, _ = fleet(claimed=0.5)
    start = rows.start_s.copy()
    start[:15] = np.tile([900.0, 700.0, 400.0, 20.0, 3.0], 3)
    drift, _ = drifts(written(tmp_path / "t", with_starts(rows, ["a1", "a2", "a3", "a4", "a5"], start)))
    assert (drift.undated.units, drift.undated.variance_factor) == (3, drift.variance_factor)
    assert drift.variance_factor > 2.5
    assert drift.step_count == drift.states["recalibrate"] == 0


def test_a_unit_in_no_order_is_said_to_be_and_nothing_else_is(tmp_path: Path) -> None:
    rows, stepped = fleet(step_deg=5.0)
    mixed = sorted(stepped)[0]
    rows = with_starts(rows, ["alpha", *DAYS[1:]], np.where(rows.unit == mixed, 5.0, rows.start_s))
    drift, units = drifts(written(tmp_path / "t", rows))
    assert (units[mixed].state, drift.unordered, drift.states["unordered"]) == ("unordered", (mixed,), 1)
    assert to_recalibrate(units) == stepped - {mixed} == {step.unit for step in drift.steps}
    told = " ".join(CliRunner().invoke(main, ["drift", str(tmp_path / "t")]).stdout.split())
    assert_sentences(told, about=f"1 unit ({mixed})")


@pytest.mark.parametrize("is_dated", daily([True, False]))
def test_a_table_named_twice_over_changes_nothing(tmp_path: Path, is_dated: bool) -> None:
    rows, _ = fleet(step_deg=5.0, is_dated=is_dated)
    early = rows[np.flatnonzero(np.arange(len(rows)) % 5 < 3)]
    one, two = written(tmp_path / "one", early), written(tmp_path / "two", rows)
    for against in ("first", "previous"):
        alone = drift_of([two], against=against).as_dict()
        both = drift_of([one, two], against=against).as_dict()
        assert both.pop("duplicates") == len(early)
        assert alone.pop("duplicates") == 0
        assert str(both) == str(alone)  # NaN is no number, not even its own
    assert overview_of([one, two]).rows == len(rows)


def test_of_one_recording_in_two_tables_that_of_the_last_counts(tmp_path: Path) -> None:
    rows, _ = fleet()
    one, two = written(tmp_path / "one", replace(rows, offset=rows.offset + 5.0)), written(tmp_path / "two", rows)
    assert drift_of([one, two]).states == drift_of([two]).states
    half = written(tmp_path / "half", rows[np.flatnonzero(np.arange(len(rows)) % 5 == 4)])
    assert drift_of([one, half]).states["recalibrate"] == 120


def test_unnamed_recordings_that_begin_at_zero_are_one_only_if_their_calibration_is(tmp_path: Path) -> None:
    rows, _ = fleet()
    zero = replace(rows, start_s=np.zeros(len(rows)))
    tables = [
        written(tmp_path / str(month), zero[np.flatnonzero(np.arange(len(rows)) % 5 == month)]) for month in (0, 1)
    ]
    assert drift_of(tables).states["steady"] + drift_of(tables).states["unsure"] == 120
    again = written(tmp_path / "again", zero[np.flatnonzero(np.arange(len(rows)) % 5 == 1)])
    assert drift_of([*tables, again]).duplicates == 120


def test_batches_are_told_in_text_and_json_and_one_in_which_all_steps_are_stands_out(tmp_path: Path) -> None:
    rows, stepped = fleet(step_deg=5.0)
    batch = ["lot 2" if unit in stepped else f"lot {int(unit[1:]) % 2}" for unit in rows.unit]
    path = written(tmp_path / "fleet.parquet", replace(rows, batch=objects(batch)))
    drift = drift_of([path])
    lots = {lot.batch: lot for lot in drift.batches}
    assert set(lots) == {"lot 0", "lot 1", "lot 2"}
    assert lots["lot 2"].changed_units == lots["lot 2"].units == len(stepped)
    assert lots["lot 2"].stands_out == ("changes", "steps")
    assert lots["lot 0"].stands_out == lots["lot 1"].stands_out == ()
    assert sum(sum(lot.verdicts.values()) for lot in drift.batches) == len(rows)
    run = CliRunner().invoke(main, ["drift", str(path)])
    assert run.exit_code == 3
    assert "changes, steps" in run.stdout
    fields = json.loads(CliRunner().invoke(main, ["drift", str(path), "--json"]).stdout)
    assert fields["batch_source"] == "the column batch"
    assert fields["batches"][2]["states"] == {"recalibrate": len(stepped)}
    text = page(overview_of([path]), drift)
    assert_sentences(text, about="Units, by")
    assert f"lot 2 ({len(stepped)} changed, {len(stepped)} with a step" in text


@pytest.mark.parametrize("asked", ["hw_batch", "^Q[0-9]", "batch", "(", "offset"])
def test_a_batch_that_no_unit_has_is_wrong_use_that_names_the_columns(tmp_path: Path, asked: str) -> None:
    path = written(tmp_path / "fleet.parquet", fleet()[0])
    run = CliRunner().invoke(main, ["drift", str(path), "--batch", asked, "--output", str(tmp_path / "out.parquet")])
    assert run.exit_code == 2
    assert_sentences(run.stderr)
    assert not (tmp_path / "out.parquet").exists()


def test_an_empty_column_batch_leaves_it_to_the_names(tmp_path: Path) -> None:
    rows, _ = fleet()
    named = replace(rows, unit=objects([f"B{int(unit[1:]) // 60}-{unit}" for unit in rows.unit]))
    path = written(tmp_path / "t", named)
    assert batch_rule([path], None).is_guess
    assert [lot.batch for lot in drift_of([path]).batches] == ["B0", "B1"]
    without = named.sorted().to_arrow().drop_columns(["batch"])
    parquet.write_table(without, tmp_path / "old")
    assert [lot.batch for lot in drift_of([tmp_path / "old"]).batches] == ["B0", "B1"]
    assert [lot.batch for lot in drift_of([tmp_path / "old"], batch="unit_of_field").batches] == ["uT"]
