"""A table that grows: new recordings alone are fitted, what changed or vanished is said, and nothing is lost."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises

from flinders import simulate
from flinders.apps.fleet import UnitResults, job, store, worker
from flinders.apps.fleet.growth import ReadFiles
from flinders.apps.fleet.job import Outputs, run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.properties import Properties
from flinders.cli import main
from flinders.errors import DocumentError, FlindersError, OutputError, UsageError

if TYPE_CHECKING:
    from flinders.apps.fleet.job import RunSummary
    from flinders.apps.fleet.plan import Partition, Plan
    from flinders.arrays import Floats

pyarrow = pytest.importorskip("pyarrow")
from pyarrow import parquet  # noqa: E402 - after it is known to be there

FIELDS = [simulate.tumble(seed=seed, n=150, motion="uniform").samples.field for seed in range(6)]
DONE = worker.calibrate_partition


def write(path: Path, field: Floats) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join(f"{value:.4f}" for value in row) for row in field]
    path.write_text("\n".join(["mag_x_uT,mag_y_uT,mag_z_uT", *rows, ""]), encoding="utf-8")


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three units, recorded in March."""
    monkeypatch.chdir(tmp_path)
    for place in range(3):
        write(Path("logs", f"U{place}", "2026-03-01.csv"), FIELDS[place])
    return Path("logs")


def append(out: str = "out.parquet", *, options: Options | None = None, **outputs: str) -> RunSummary:
    return run("logs", Outputs(out, **outputs), options or Options(), workers=0, append=True)


def rows_of(out: str = "out.parquet") -> list[tuple[str, str, str]]:
    rows = UnitResults.read(out)
    return list(zip(rows.unit.tolist(), rows.recording.tolist(), rows.cause.tolist(), strict=True))


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that were fitted."""
    names: list[str] = []

    def noted(partition: Partition, *, options: Options) -> bytes:
        names.extend(part.file.name for part in partition.slices)
        return DONE(partition, options=options)

    monkeypatch.setattr(worker, "calibrate_partition", noted)
    return names


def test_new_recordings_alone_are_fitted_and_the_table_is_that_of_one_run(fitted: list[str]) -> None:
    append()
    write(Path("logs", "U1", "2026-06-01.csv"), FIELDS[3])
    write(Path("logs", "U9", "2026-06-01.csv"), FIELDS[4])
    fitted.clear()
    told = append()
    assert fitted == ["U1/2026-06-01.csv", "U9/2026-06-01.csv"]
    assert (told.files, told.rows, told.units, told.is_extended) == (2, 5, 4, True)
    run("logs", "whole.parquet", Options(), workers=0)
    assert Path("out.parquet").read_bytes() == Path("whole.parquet").read_bytes()


def test_a_run_without_news_changes_nothing(fitted: list[str]) -> None:
    append()
    before = Path("out.parquet").read_bytes()
    fitted.clear()
    told = append()
    assert (told.files, told.alerts, told.is_whole, fitted) == (0, (), True, [])
    assert Path("out.parquet").read_bytes() == before


def test_a_page_without_news_has_no_empty_table() -> None:
    for _ in range(2):
        ended = CliRunner().invoke(main, ["fleet", "logs", "-o", "out.parquet", "--append"])
    assert (ended.exit_code, "number / limit" in ended.stdout) == (0, False)


def test_tables_of_many_units_are_extended_too() -> None:
    shutil.rmtree("logs")
    Path("logs").mkdir()
    for day in range(3):
        columns = {f"mag_{axis}_uT": FIELDS[day][:, place] for place, axis in enumerate("xyz")}
        table = pyarrow.table({"serial": [f"S{day}"] * 150, **columns})
        parquet.write_table(table, f"logs/day{day}.parquet")
        append()
    run("logs", "whole.parquet", Options(), workers=0)
    assert Path("out.parquet").read_bytes() == Path("whole.parquet").read_bytes()


@pytest.mark.parametrize("when", ["at the first run", "at a later one"])
def test_a_run_that_is_stopped_is_gone_on_with_and_later_files_wait(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if when == "at a later one":
        append()
        for place in (3, 4):
            write(Path("logs", f"U{place}", "2026-06-01.csv"), FIELDS[place])
    begun: list[int] = []

    def stopped(partition: Partition, *, options: Options) -> bytes:
        begun.append(1)
        if len(begun) > 1:
            raise KeyboardInterrupt
        return DONE(partition, options=options)

    with monkeypatch.context() as patch:
        patch.setattr(worker, "calibrate_partition", stopped)
        with pytest.raises(KeyboardInterrupt):
            append()
    write(Path("logs", "U9", "2026-06-01.csv"), FIELDS[5])
    told = append()
    assert (told.resumed, told.files_later) == (1, 1)
    assert "U9" not in [unit for unit, _, _ in rows_of()]
    assert append().files == 1
    run("logs", "whole.parquet", Options(), workers=0)
    assert Path("out.parquet").read_bytes() == Path("whole.parquet").read_bytes()


def test_files_that_changed_or_vanished_are_rows_and_alerts_once() -> None:
    append()
    kept = Path("logs/U0/2026-03-01.csv").rename("kept.csv")
    write(Path("logs/U1/2026-03-01.csv"), FIELDS[1][:140])
    told = append(alerts="alerts.csv")
    faults = [("(U0/2026-03-01.csv)", "", "vanished-file"), ("(U1/2026-03-01.csv)", "", "changed-file")]
    assert rows_of()[:2] == faults
    assert [(alert.unit, alert.alert) for alert in told.alerts] == [(unit, code) for unit, _, code in faults]
    assert (told.files_changed, told.files_vanished, told.verdicts, told.units) == (1, 1, {"good": 3}, 3)
    with Path("alerts.csv").open(encoding="utf-8") as file:
        assert [row["alert"] for row in csv.DictReader(file)] == ["vanished-file", "changed-file"]
    assert append().alerts == ()
    kept.rename("logs/U0/2026-03-01.csv")
    append()
    assert rows_of()[0] == faults[1]


def moved(field: Floats) -> Floats:
    """Readings with an offset that has moved by 6 µT."""
    readings: Floats = field + np.array([6.0, 0.0, 0.0])
    return readings


def test_alerts_say_what_crossed_a_limit_since_the_last_run() -> None:
    append()
    write(Path("logs/U0/2026-06-01.csv"), moved(FIELDS[0]))
    write(Path("logs/U1/2026-06-01.csv"), FIELDS[1][:5])
    write(Path("logs/U2/2026-06-01.csv"), FIELDS[2] + 0.01)
    write(Path("logs/U8/2026-06-01.csv"), FIELDS[3][:5])
    told = append()
    found = [(alert.unit, alert.alert, alert.before, alert.verdict) for alert in told.alerts]
    assert found == [
        ("U0", "heading-changed", "good", "good"),
        ("U1", "not-good", "good", "refused"),
        ("U8", "not-good", "", "refused"),
    ]
    assert told.alerts[0].number > told.alerts[0].limit == 1.0
    assert not told.is_whole
    write(Path("logs/U1/2026-07-01.csv"), FIELDS[1][:6])
    write(Path("logs/U0/2026-07-01.csv"), moved(FIELDS[0]) + 0.01)
    assert append().alerts == (), "as it was is no news"


def test_a_scheduler_is_told_by_the_exit_code() -> None:
    words = ["fleet", "logs", "--output", "out.parquet", "--append", "--workers", "0"]
    write(Path("logs/U7/2026-03-01.csv"), FIELDS[0][:5])
    ended = [CliRunner().invoke(main, words, prog_name="flinders").exit_code for _ in range(2)]
    write(Path("logs/U7/2026-06-01.csv"), FIELDS[0][:5])
    write(Path("logs/U6/2026-06-01.csv"), FIELDS[0])
    ended.append(CliRunner().invoke(main, words, prog_name="flinders").exit_code)
    write(Path("logs/U6/2026-07-01.csv"), FIELDS[0][:5])
    ended.append(CliRunner().invoke(main, words, prog_name="flinders").exit_code)
    assert ended == [3, 0, 0, 3]


def test_a_table_is_not_extended_with_what_does_not_belong_to_it() -> None:
    append()
    before = Path("out.parquet").read_bytes()
    with assert_raises(UsageError):
        append(options=Options(dip_deg=50.0))
    write(Path("other/V1/2026-06-01.csv"), FIELDS[3])
    with assert_raises(UsageError):
        run("other", "out.parquet", Options(), workers=0, append=True)
    with assert_raises(UsageError):
        append("out.csv")
    with assert_raises(UsageError):
        run("logs", "out.parquet", Options(), workers=0, append=True, force=True)
    with pytest.raises(UsageError, match="append=True"):
        run("logs", Outputs("new.parquet", alerts="alerts.csv"), Options(), workers=0)
    assert Path("out.parquet").read_bytes() == before


def test_the_list_of_files_is_read_back_as_it_was_written() -> None:
    append()
    read = ReadFiles.of_table("out.parquet")
    again = ReadFiles.loads(read.dumps())
    assert (again.files, again.options) == (read.files, read.options)
    assert read.recordings == [f"U{place}/2026-03-01.csv" for place in range(3)]


def test_properties_are_joined_by_unit_and_kept_until_they_are_given_anew() -> None:
    Path("units.csv").write_text("serial;firmware;place\nU0;1.2;Kiel\nU1;1.3;Oslo\n")
    run("logs", "out.parquet", Options(), workers=0, properties=Properties.read("units.csv"))
    write(Path("logs/U0/2026-06-01.csv"), FIELDS[3])
    append()
    table = parquet.read_table("out.parquet")
    assert table.column("firmware").to_pylist() == ["1.2", None, "1.3", ""]
    known = Properties.read("units.csv")
    run("logs", "out.parquet", Options(), workers=0, append=True, properties=known)
    table = parquet.read_table("out.parquet")
    assert table.column("place").to_pylist() == ["Kiel", "Kiel", "Oslo", ""]


@pytest.mark.parametrize(
    "text",
    [
        "name,firmware\nU0,1\n",
        "unit,verdict\nU0,1\n",
        "unit,place\nU0,Kiel\nU0,Oslo\n",
        f'unit,place\nU0,"{"x" * 200_000}',
    ],
)
def test_properties_that_cannot_be_joined_are_refused(text: str) -> None:
    Path("units.csv").write_text(text)
    with assert_raises(FlindersError):
        Properties.read("units.csv")


def test_lines_of_properties_without_a_unit_are_passed_over_and_a_cell_may_have_lines() -> None:
    Path("units.csv").write_text('unit,place,note\nU0,Kiel,"first\nsecond"\n,Oslo,\n,Bergen,\n\n')
    assert Properties.read("units.csv").known == {"U0": ("Kiel", "first\nsecond")}


def test_a_table_with_a_broken_page_is_named_and_left_as_it_is() -> None:
    append()
    content = bytearray(Path("out.parquet").read_bytes())
    content[20:200] = bytes(180)  # of the first page
    Path("out.parquet").write_bytes(content)
    write(Path("logs", "U8", "2026-06-01.csv"), FIELDS[3])
    with pytest.raises(DocumentError, match=r"out\.parquet"):
        append()
    with pytest.raises(DocumentError, match=r"out\.parquet"):
        store.rows_of("out.parquet", "U0")
    assert Path("out.parquet").read_bytes() == content


def test_rows_of_a_run_that_ended_meanwhile_are_not_overwritten(monkeypatch: pytest.MonkeyPatch) -> None:
    append()
    write(Path("logs", "U8", "2026-06-01.csv"), FIELDS[3])

    def planned_late(*args: Any, **options: Any) -> Plan:
        """Plan while another run begins and ends."""
        monkeypatch.setattr(job, "plan_of", plan_of)
        plan = plan_of(*args, **options)
        write(Path("logs", "U9", "2026-06-01.csv"), FIELDS[4])
        append()
        return plan

    monkeypatch.setattr(job, "plan_of", planned_late)
    with assert_raises(OutputError):
        append()
    assert {"U8", "U9"} <= {unit for unit, _, _ in rows_of()}
    assert not append().alerts
