"""A line: which units are not good and why, the table as CSV, what other commands say of it, one unit at a date."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.apps.fleet import UnitResults
from flinders.apps.fleet.contents import contents_of
from flinders.apps.fleet.job import Outputs, run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.simulate import FAULTS, LineTruth, line_of
from flinders.apps.fleet.store import NoCalibration, calibration_at, document_of, options_of, rows_of
from flinders.apps.fleet.tables import read_table
from flinders.cli import main
from flinders.errors import DocumentError, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.verdict import headline_of

if TYPE_CHECKING:
    from flinders.arrays import Floats

pyarrow = pytest.importorskip("pyarrow")
from pyarrow import csv as arrow_csv  # noqa: E402 - after it is known to be there
from pyarrow import parquet  # noqa: E402

FIELDS = [simulate.tumble(seed=seed, n=150, motion="uniform").samples.field for seed in range(4)]


def write(path: Path, field: Floats) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join(f"{value:.4f}" for value in row) for row in field]
    path.write_text("\n".join(["mag_x_uT,mag_y_uT,mag_z_uT", *rows, ""]), encoding="utf-8")


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A good unit, one that was turned too little, one with too few readings and an empty file."""
    monkeypatch.chdir(tmp_path)
    write(Path("logs/A/2026-03-01.csv"), FIELDS[0])
    write(Path("logs/A/2026-06-01.csv"), FIELDS[1])
    write(Path("logs/A/2026-07-01.csv"), FIELDS[2][:5])
    write(Path("logs/B/2026-03-01.csv"), FIELDS[2][FIELDS[2][:, 2] < np.quantile(FIELDS[2][:, 2], 0.4)])
    write(Path("logs/C/2026-03-01.csv"), FIELDS[3][:5])
    Path("logs/D").mkdir()
    Path("logs/D/2026-03-01.csv").write_bytes(b"")


def ran(line: str) -> tuple[int, str]:
    ended = CliRunner().invoke(main, line.split()[1:], prog_name="flinders")
    return ended.exit_code, ended.output


def test_every_unit_that_is_not_good_is_listed_with_cause_number_and_remedy() -> None:
    told = run("logs", Outputs("out.parquet", bad="bad.csv"), Options(), workers=0)
    with Path("bad.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["unit"], row["verdict"], row["cause"]) for row in rows] == [
        ("A", "refused", "too-few-samples"),
        ("B", "limited", "coverage"),
        ("C", "refused", "too-few-samples"),
        ("D", "failed", "unreadable"),
    ]
    limited = rows[1]
    assert float(limited["number"]) > float(limited["limit"]) == 60.0
    assert all(row["message"] and row["remedy"] for row in rows)
    assert [row.unit for row in told.not_good] == ["D", "A", "C", "B"], "the worst verdicts first"
    assert told.verdicts == {"good": 2, "limited": 1, "refused": 2, "failed": 1}


def test_a_limited_row_says_what_the_single_command_says() -> None:
    run("logs", "out.parquet", Options(), workers=0)
    rows = UnitResults.read("out.parquet")
    (place,) = np.flatnonzero(rows.verdict == "limited").tolist()
    fit = flinders.fit(flinders.open_recording("logs/B/2026-03-01.csv"), site=flinders.Site(inclination_deg=60.0))
    row, first = rows.row(place), fit.findings[0]
    assert (row.cause, row.message, row.code) == (first.code, headline_of(fit).words, "")
    assert row.number == pytest.approx(first.number)


def test_the_table_as_csv_is_read_back_to_the_bit() -> None:
    run("logs", "out.parquet", Options(), workers=0)
    run("logs", "out.csv", Options(), workers=0)
    there, back = UnitResults.read("out.parquet"), read_table("out.csv")
    for name in ("unit", "verdict", "message", "findings", "readings"):
        assert getattr(there, name).tolist() == getattr(back, name).tolist()
    for name in ("offset", "matrix", "covariance", "worst_deg", "number"):
        assert np.array_equal(getattr(there, name), getattr(back, name), equal_nan=True)


def test_a_csv_that_is_cut_short_or_has_no_rows_is_no_fault_of_ours() -> None:
    run("logs", "out.csv", Options(), workers=0)
    names, *lines = Path("out.csv").read_text(encoding="utf-8").splitlines()
    Path("cut.csv").write_text("\n".join([names, *lines[:-1], lines[-1][: len(lines[-1]) // 2]]), encoding="utf-8")
    with assert_raises(DocumentError):
        read_table("cut.csv")
    assert contents_of("cut.csv") is None
    Path("empty.csv").write_text(f"{names}\n", encoding="utf-8")
    empty = contents_of("empty.csv")
    assert empty is not None
    assert (empty.recordings, empty.advice[-18:]) == (0, ": give a recording")
    Path("long.csv").write_text(f'unit,note\nA,"{"x" * 200_000}"\n', encoding="utf-8")
    assert contents_of("long.csv") is None


def test_what_takes_parquet_alone_says_so_of_csv() -> None:
    run("logs", "out.csv", Options(), workers=0)
    for line in ("flinders drift out.csv", "flinders fleet logs -o new.csv --report new.html"):
        assert ran(line)[0] == 2
    assert not Path("new.csv").exists()


def many(units: int) -> None:
    """Readings of so many units in one table, of Parquet and of text."""
    columns = {f"mag_{axis}_uT": np.tile(FIELDS[0][:, place], units) for place, axis in enumerate("xyz")}
    table = pyarrow.table({"serial": np.repeat([f"S{unit:02d}" for unit in range(units)], 150), **columns})
    parquet.write_table(table, "many.parquet")
    arrow_csv.write_csv(table, "many.csv")


def test_folders_and_tables_of_many_units_are_told_from_recordings() -> None:
    many(10)
    run("logs", "out.parquet", Options(), workers=0)
    run("logs", "out.csv", Options(), workers=0)
    kinds = {path: contents_of(path) for path in ("logs", "many.parquet", "many.csv", "out.parquet", "out.csv")}
    assert {path: (known.kind, known.units) for path, known in kinds.items() if known} == {
        "logs": ("folder", 4),
        "many.parquet": ("readings of many units", 10),
        "many.csv": ("readings of many units", 10),
        "out.parquet": ("table of a fleet", 4),
        "out.csv": ("table of a fleet", 4),
    }
    assert contents_of("logs/A/2026-03-01.csv") is None
    for path, code in (("logs", 0), ("many.csv", 0), ("out.parquet", 0)):
        assert json.loads(ran(f"flinders info {path} --json")[1])["path"] == path
        assert ran(f"flinders calibrate {path}")[0] == 2
        assert ran(f"flinders info {path}")[0] == code
    assert ran("flinders show out.parquet")[0] == ran("flinders show out.csv")[0] == 0


def test_a_few_units_may_be_sensors_of_one_body() -> None:
    many(3)
    code, said = ran("flinders calibrate many.parquet -o one.json")
    assert code == 0
    assert_sentences(said, about="--unit-column serial")


def test_a_csv_of_many_units_gives_the_rows_of_its_parquet() -> None:
    many(3)
    for name in ("csv", "parquet"):
        run(f"many.{name}", f"{name}.parquet", Options(unit_column="serial"), workers=0)
    there, back = UnitResults.read("parquet.parquet"), UnitResults.read("csv.parquet")
    assert there.unit.tolist() == back.unit.tolist() == ["S00", "S01", "S02"]
    assert np.array_equal(there.offset, back.offset)


def when(day: str) -> datetime:
    return datetime.fromisoformat(day).replace(tzinfo=UTC)


def test_a_calibration_is_valid_until_the_next_one_of_its_unit() -> None:
    run("logs", "out.parquet", Options(), workers=0)
    rows = rows_of("out.parquet", "A")
    found = {day: calibration_at(rows, "A", when(day)) for day in ("2026-05-31", "2026-06-01", "2026-12-31")}
    assert [one.row.recording for one in found.values()] == ["2026-03-01.csv", "2026-06-01.csv", "2026-06-01.csv"]
    assert [row.recording for row in found["2026-12-31"].later] == ["2026-07-01.csv"]
    assert calibration_at(rows, "A").row.recording == "2026-06-01.csv"
    with pytest.raises(NoCalibration):
        calibration_at(rows, "A", when("2026-02-01"))
    with pytest.raises(NoCalibration, match="too-few-samples"):
        calibration_at(rows_of("out.parquet", "C"), "C")
    with assert_raises(UsageError):
        rows_of("out.parquet", "A ")


def test_it_is_written_as_an_ordinary_calibration_file() -> None:
    run("logs", "out.parquet", Options(), workers=0)
    row = calibration_at(rows_of("out.parquet", "A"), "A", when("2026-04-01")).row
    loaded = fit_from(document_of(row, options_of("out.parquet")))
    fit = flinders.fit(flinders.open_recording("logs/A/2026-03-01.csv"), site=flinders.Site(inclination_deg=60.0))
    assert np.allclose(loaded.calibration.offset, fit.calibration.offset)
    assert np.allclose(loaded.claim.claimed_covariance, fit.claim.claimed_covariance)
    assert (loaded.verdict, loaded.calibration.sensor) == (fit.verdict, "A")
    for line, code in (
        ("flinders fleet at A --table out.parquet --date 2026-04-01 -o a.json", 0),
        ("flinders check a.json logs/A/2026-03-01.csv", 0),
        ("flinders fleet at C --table out.parquet", 4),
    ):
        assert ran(line)[0] == code


def test_a_simulated_line_has_faults_and_drift_that_are_found() -> None:
    ran("flinders simulate fleet -o line --units 40 --seed 3 --bad 0.2 --drifting 0.2")
    with Path("line.truth.csv").open(encoding="utf-8") as file:
        truth = list(csv.DictReader(file))
    assert list(truth[0]) == list(LineTruth.__dataclass_fields__)
    told = run("line", "out.parquet", Options(), workers=0)
    assert {row["fault"] for row in truth} - {""} <= set(FAULTS)
    faulty = {(row["unit"], row["recording"]) for row in truth if row["fault"]}
    assert {(row.unit, row.recording) for row in told.not_good} <= faulty
    assert told.not_good
    drift = json.loads(ran("flinders drift out.parquet --json")[1])
    moving = {row["unit"] for row in truth if float(row["offset_change"])}
    assert {step["unit"] for step in drift["steps"]} <= moving | {unit for unit, _ in faulty}
    assert drift["steps"]


@pytest.mark.parametrize("recordings", [0, 11])
def test_a_line_has_no_more_recordings_than_months(recordings: int) -> None:
    with assert_raises(UsageError):
        next(line_of(1, recordings=recordings))


def test_the_same_seed_makes_the_same_line() -> None:
    first, again = (list(line_of(3, seed=5, readings=30)) for _ in range(2))
    assert [truth for truth, _ in first] == [truth for truth, _ in again]
    assert all(np.array_equal(one.field, other.field) for (_, one), (_, other) in zip(first, again, strict=True))
