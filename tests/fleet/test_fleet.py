"""A fleet calibrated as its user does it: folders, tables, what is broken, what is killed, and the same bytes."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.flight_log import dataflash
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily
from tests.waiting import running_in, wait_until

import flinders
from flinders import simulate
from flinders.apps.fleet import UnitResults, progress, scheduler, worker
from flinders.apps.fleet.checkpoint import Checkpoint
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.progress import log_to
from flinders.cli import main
from flinders.errors import DocumentError, FlindersError, LinkError, OutputError, UsageError

if TYPE_CHECKING:
    from flinders.apps.fleet.plan import Partition
    from flinders.arrays import Floats

pyarrow = pytest.importorskip("pyarrow")
from pyarrow import csv, parquet  # noqa: E402 - after it is known to be there

FIELDS = [simulate.tumble(seed=seed, n=150, motion="uniform").samples.field for seed in range(6)]


def write_csv(path: Path, field: Floats, unit: str = "uT") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{place * 0.02:.2f}," + ",".join(f"{value:.4f}" for value in row) for place, row in enumerate(field)]
    names = ",".join(["t_s", *(f"mag_{axis}" + f"_{unit}" * bool(unit) for axis in "xyz")])
    path.write_text("\n".join([names, *rows, ""]), encoding="utf-8")


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Six units with a recording each, in a folder."""
    for place, field in enumerate(FIELDS):
        write_csv(tmp_path / "logs" / f"U{place}" / "monday.csv", field)
    return tmp_path / "logs"


DONE = worker.calibrate_partition


def deadly(partition: Partition, *, options: Options) -> bytes:
    """Dies of one file, each time."""
    if any("poison" in part.file.name for part in partition.slices):
        os.kill(os.getpid(), signal.SIGKILL)
    return DONE(partition, options=options)


def test_a_row_has_the_numbers_of_the_single_command(logs: Path, tmp_path: Path) -> None:
    assert run(str(logs), tmp_path / "out.parquet", Options(), workers=0).verdicts == {"good": 6}
    rows = UnitResults.read(tmp_path / "out.parquet")
    assert rows.unit.tolist() == [f"U{place}" for place in range(6)]
    for place in range(6):
        fit = flinders.fit(flinders.open_recording(logs / f"U{place}" / "monday.csv"))
        row = rows.row(place)
        assert (row.verdict, row.readings, row.samples, row.recording) == (
            "good",
            150,
            fit.evidence.samples,
            "monday.csv",
        )
        np.testing.assert_allclose(row.offset, fit.calibration.offset, rtol=1e-9)
        np.testing.assert_allclose(row.matrix, fit.calibration.matrix.ravel(), rtol=1e-9)
        np.testing.assert_allclose(row.covariance, fit.claim.covariance[np.triu_indices(9)], rtol=1e-9)
        np.testing.assert_allclose(row.worst_deg, fit.heading_error_deg.worst, rtol=1e-9)
        np.testing.assert_allclose(row.rms_deg, fit.heading_error_deg.rms, rtol=1e-9)
        assert (row.start_s, round(row.end_s, 6)) == (0.0, 2.98)
        assert row.findings == tuple(finding.code for finding in fit.findings)


def test_what_is_wrong_with_a_file_is_a_row(logs: Path, tmp_path: Path) -> None:
    """Broken, empty and foreign files, missing columns, too few readings, other units of field: the job goes on."""
    write_csv(logs / "U6" / "short.csv", FIELDS[0][:5])
    write_csv(logs / "U7" / "counts.csv", FIELDS[1] * 10, unit="")
    (logs / "U8.csv").write_bytes(b"")
    (logs / "U9.parquet").write_bytes(b"PAR1 and then nothing")
    (logs / "UA.csv").write_text("t_s,pressure\n" + "0.1,1013\n" * 30)
    (logs / "notes.md").write_text("not a recording")
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=0)
    rows = UnitResults.read(tmp_path / "out.parquet")
    assert told.verdicts == {"good": 7, "refused": 1, "failed": 3}
    codes = dict(zip(rows.unit.tolist(), rows.code.tolist(), strict=True))
    assert {unit: code for unit, code in codes.items() if code} == {
        "U6": "too-few-samples", "U8": "unreadable", "U9": "unreadable", "UA": "no-magnetometer",
    }  # fmt: skip
    assert told.units_of_field == {"uT": 7, "counts": 1}
    assert told.other_files == {".md": 1}
    assert not told.is_whole
    failed = rows[rows.verdict == "failed"]
    assert np.isnan(failed.offset).all()
    assert all(failed.message)


@pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_a_row(logs: Path, tmp_path: Path) -> None:
    (logs / "U0" / "monday.csv").chmod(0)
    assert run(str(logs), tmp_path / "out.parquet", Options(), workers=0).codes == {"unreadable": 1}


def test_any_number_of_workers_writes_the_same_bytes(logs: Path, tmp_path: Path) -> None:
    written = []
    for workers in (0, 1, 3):
        run(str(logs), tmp_path / f"{workers}.parquet", Options(), workers=workers)
        written.append((tmp_path / f"{workers}.parquet").read_bytes())
        assert not (tmp_path / f"{workers}.parquet.parts").exists()
    assert written[0] == written[1] == written[2]


def test_a_worker_that_is_killed_changes_nothing(logs: Path, tmp_path: Path) -> None:
    run(str(logs), tmp_path / "whole.parquet", Options(), workers=0)
    killed: list[int | None] = []

    def kill(*_: int) -> None:
        for child in multiprocessing.active_children()[: 1 - len(killed)]:
            os.kill(child.pid or 0, signal.SIGKILL)
            killed.append(child.pid)

    run(str(logs), tmp_path / "killed.parquet", Options(), workers=2, watch=kill)
    assert len(killed) == 1
    assert (tmp_path / "killed.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_a_file_that_kills_its_workers_is_left_out(logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_csv(logs / "U3" / "poison.csv", FIELDS[0])
    monkeypatch.setattr(worker, "calibrate_partition", deadly)
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=2)
    assert (told.verdicts, told.codes, told.retried) == ({"good": 6, "failed": 1}, {"lost-worker": 1}, 1)
    rows = UnitResults.read(tmp_path / "out.parquet")
    assert rows.recording[rows.code == "lost-worker"].tolist() == ["poison.csv"]


def test_only_the_guilty_file_of_a_partition_is_lost(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flinders.apps.fleet import plan

    write_csv(logs / "U3" / "poison.csv", FIELDS[0])
    monkeypatch.setattr(plan, "MIN_PARTITIONS", 1)
    monkeypatch.setattr(worker, "calibrate_partition", deadly)
    assert len(plan_of(str(logs), Options()).partitions) == 1
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=2)
    assert told.verdicts == {"good": 6, "failed": 1}


def test_a_full_disk_is_said_and_nothing_that_is_done_is_lost(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(str(logs), tmp_path / "whole.parquet", Options(), workers=0)
    write = Path.write_bytes
    written: list[int] = []

    def full(path: Path, content: bytes) -> int:
        written.append(write(path, content[: len(content) // (1 + len(written) // 2)]))
        if len(written) > 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return written[-1]

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with assert_raises(OutputError):
            run(str(logs), tmp_path / "out.parquet", Options(), workers=0)
    assert not (tmp_path / "out.parquet").exists()
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=0, append=True)
    assert told.resumed == 2
    assert (tmp_path / "out.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_a_driver_that_is_killed_goes_on_where_it_was(logs: Path, tmp_path: Path) -> None:
    run(str(logs), tmp_path / "whole.parquet", Options(), workers=0)
    command = [sys.executable, "-m", "flinders", "fleet", str(logs), "--output", str(tmp_path / "out.parquet")]
    parts = tmp_path / "out.parquet.parts"
    running = subprocess.Popen([*command, "--workers", "1"], stderr=subprocess.PIPE)
    wait_until(lambda: list(parts.glob("part-*.arrow")) or running.poll() is not None)
    running.kill()
    running.communicate()
    with assert_raises(UsageError):
        run(str(logs), tmp_path / "out.parquet", Options(), workers=0)
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=0, append=True)
    assert told.resumed > 0
    assert (tmp_path / "out.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
@pytest.mark.parametrize("number", daily([signal.SIGKILL, signal.SIGINT, signal.SIGTERM]))
def test_workers_end_with_their_driver(logs: Path, tmp_path: Path, number: signal.Signals) -> None:
    """However it ends; the server that they are started from ends, too."""
    command = [sys.executable, "-m", "flinders", "fleet", str(logs), "--output", str(tmp_path / "out.parquet")]
    parts = tmp_path / "out.parquet.parts"
    with subprocess.Popen([*command, "--workers", "2"], stderr=subprocess.DEVNULL, start_new_session=True) as driver:
        wait_until(lambda: len(running_in(driver.pid)) >= 4 or driver.poll() is not None)
        wait_until(lambda: list(parts.glob("part-*.arrow")) or driver.poll() is not None)
        driver.send_signal(number)
    wait_until(lambda: not running_in(driver.pid), lambda: running_in(driver.pid))


def test_parts_that_a_power_cut_has_spoilt_are_done_again(logs: Path, tmp_path: Path) -> None:
    """One cut short, one emptied and one of zeros are found by their lengths and check sums."""
    run(str(logs), tmp_path / "whole.parquet", Options(), workers=0)
    options, out = Options(), tmp_path / "out.parquet"
    plan = plan_of(str(logs), options)
    parts = Checkpoint.of(out, plan, append=False, force=False)
    paths = [
        parts.commit(place, worker.calibrate_partition(each, options=options))
        for place, each in enumerate(plan.partitions)
    ]
    held = [path.read_bytes() for path in paths]
    for path, spoilt in zip(paths, (held[0][:-9], b"", bytes(len(held[2]))), strict=False):
        path.write_bytes(spoilt)
    parts.close()
    assert run(str(logs), out, options, workers=0, append=True).resumed == len(paths) - 3 > 0
    assert out.read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_parts_of_another_run_are_not_mixed_in(logs: Path, tmp_path: Path) -> None:
    plan = plan_of(str(logs), Options())
    parts = Checkpoint.of(tmp_path / "out.parquet", plan, append=False, force=False)
    parts.commit(0, b"rows")
    parts.close()
    with assert_raises(UsageError):
        run(str(logs), tmp_path / "out.parquet", Options(target_deg=2.0), workers=0, append=True)


def test_the_program_says_what_came_of_it(logs: Path, tmp_path: Path) -> None:
    write_csv(logs / "U6" / "short.csv", FIELDS[0][:5])
    command = [
        sys.executable,
        "-m",
        "flinders",
        "fleet",
        "logs",
        "--output",
        "out.parquet",
        "--log",
        "log.jsonl",
        "--json",
    ]
    ended = subprocess.run([*command, "--workers", "1"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 3, ended.stderr
    assert_sentences(ended.stderr)
    told = json.loads(ended.stdout)
    assert (told["units"], told["verdicts"], told["codes"]) == (7, {"good": 6, "refused": 1}, {"too-few-samples": 1})
    assert [event["event"] for event in events(tmp_path / "log.jsonl")] == ["planned", *["partition"] * 7, "done"]


def events(path: Path) -> list[dict[str, Any]]:
    """What a log tells, without the times."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_files_with_the_same_names_of_columns_are_written_in_different_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Delimiter, decimal sign, order of the columns, unit of the time: each file of a partition is read as it is."""
    from flinders.apps.fleet import plan

    monkeypatch.setattr(plan, "MIN_PARTITIONS", 1)
    field, time = FIELDS[0], np.arange(150)
    rows = [[f"{each:.4f}" for each in (0.02 * at, *row)] for at, row in zip(time, field, strict=True)]
    names = ["t", "mag_x_uT", "mag_y_uT", "mag_z_uT"]
    written = {
        "plain": (names, ",", rows),
        "semicolons": (names, ";", [[cell.replace(".", ",") for cell in row] for row in rows]),
        "milliseconds": (names, ",", [[str(20 * at), *row[1:]] for at, row in zip(time, rows, strict=True)]),
        "turned": (names[::-1], ",", [row[::-1] for row in rows]),
        "spaces": (names, " ", rows),
    }
    (tmp_path / "logs").mkdir()
    for unit, (header, delimiter, cells) in written.items():
        lines = [delimiter.join(each) for each in (header, *cells)]
        (tmp_path / "logs" / f"{unit}.csv").write_text("\n".join([*lines, ""]))
    assert len(plan_of(str(tmp_path / "logs"), Options()).partitions) == 1
    run(str(tmp_path / "logs"), tmp_path / "out.parquet", Options(), workers=0)
    table = UnitResults.read(tmp_path / "out.parquet")
    assert table.verdict.tolist() == ["good"] * len(written)
    np.testing.assert_array_equal(table.offset, table.offset[[0] * len(written)])
    np.testing.assert_allclose(table.end_s, 2.98)


def test_the_log_says_which_files_were_done_and_which_could_not_be_read(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "MAX_UNREAD", 1)
    for unit in ("U7", "U8", "U9"):
        (logs / f"{unit}.csv").write_bytes(b"")
    with log_to(tmp_path / "log.jsonl"):
        told = run(str(logs), tmp_path / "out.parquet", Options(), workers=0)
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for event in events(tmp_path / "log.jsonl"):
        by_kind.setdefault(event.pop("event"), []).append(event)
    assert [event["files"] for event in by_kind["partition"]][:2] == [["U0/monday.csv"], ["U1/monday.csv"]]
    first, *_, last = by_kind["partition"]
    about = ("file_count", "units", "rows", "readings", "verdicts", "codes", "lost")
    assert [first[name] for name in about] == [1, 1, 1, 150, {"good": 1}, {}, False]
    assert (last["verdicts"], last["codes"]) == ({"failed": 3}, {"unreadable": 3})  # empty files share a partition
    assert [(event["unit"], event["recording"], event["code"]) for event in by_kind["unread"]] == [
        ("U7", "U7.csv", "unreadable")
    ]
    assert len(by_kind["unread-more"]) == 1
    assert (by_kind["done"][0]["unread"], told.workers_lost) == (3, 0)


def test_workers_that_died_are_told_and_counted(logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_csv(logs / "U3" / "poison.csv", FIELDS[0])
    monkeypatch.setattr(worker, "calibrate_partition", deadly)
    with log_to(tmp_path / "log.jsonl"):
        told = run(str(logs), tmp_path / "out.parquet", Options(), workers=1)
    deaths = [event for event in events(tmp_path / "log.jsonl") if event["event"] == "worker-lost"]
    assert [(death["files"], death["attempt"]) for death in deaths] == [
        (["U3/poison.csv"], attempt) for attempt in (1, 2, 3)
    ]
    assert (told.as_dict()["workers_lost"], told.retried) == (3, 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_stops_a_run_is_told_what_is_kept(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    done: list[bytes] = []

    def stopped(partition: Partition, *, options: Options) -> bytes:
        if len(done) == 2:
            signal.raise_signal(number)
        done.append(DONE(partition, options=options))
        return done[-1]

    out, log = tmp_path / "out.parquet", tmp_path / "log.jsonl"
    words = ["fleet", str(logs), "--output", str(out), "--workers", "0", "--log", str(log)]
    with monkeypatch.context() as patch:
        patch.setattr(worker, "calibrate_partition", stopped)
        ended = CliRunner().invoke(main, words, prog_name="flinders")
    assert ended.exit_code == 130
    assert_sentences(ended.output.split("\n"))
    last = events(log)[-1]
    assert (last["event"], last["done"], last["partitions"]) == ("interrupted", 2, 6)
    again = CliRunner().invoke(main, [*words, "--append", "--json"], prog_name="flinders")
    assert json.loads(again.stdout)["resumed"] == 2


def test_a_start_that_came_to_nothing_is_no_earlier_run(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scheduler that is not there, Ctrl-C before anything is done, and a program that was killed by then."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(scheduler, "TIMEOUT_S", 0.2)
    out, folder, log = tmp_path / "out.parquet", tmp_path / "out.parquet.parts", tmp_path / "log.jsonl"
    with log_to(log), pytest.raises(LinkError):
        run(str(logs), out, Options(), scheduler="tcp://127.0.0.1:1")
    assert [(event["event"], event["code"]) for event in events(log)] == [("failed", "link")]
    assert not folder.exists()
    with monkeypatch.context() as patch:
        patch.setattr(worker, "calibrate_partition", lambda *_, **__: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            run(str(logs), out, Options(), workers=0)
    assert not folder.exists()
    Checkpoint.of(out, plan_of(str(logs), Options()), append=False, force=False).close()
    assert folder.exists()
    assert run(str(logs), out, Options(), workers=0).units == 6


@pytest.mark.parametrize(("append", "force"), [(False, False), (True, False), (False, True)])
def test_a_second_run_into_one_table_is_refused(logs: Path, tmp_path: Path, *, append: bool, force: bool) -> None:
    out = tmp_path / "out.parquet"
    first = Checkpoint.of(out, plan_of(str(logs), Options()), append=False, force=False)
    part = first.commit(0, b"rows")
    of = rf"out\.parquet\.parts: .* \(process {os.getpid()} on "
    with pytest.raises(OutputError, match=of):
        run(str(logs), out, Options(), workers=0, append=append, force=force)
    assert part.exists()
    first.close()
    run(str(logs), out, Options(), workers=0, force=True)


def test_each_compass_of_a_log_is_a_unit(tmp_path: Path) -> None:
    (tmp_path / "logs" / "V1").mkdir(parents=True)
    (tmp_path / "logs" / "V1" / "flight.bin").write_bytes(b"".join(dataflash()))
    run(str(tmp_path / "logs"), tmp_path / "all.parquet", Options(), workers=0)
    rows = UnitResults.read(tmp_path / "all.parquet")
    assert rows.unit.tolist() == ["V1", "V1 MAG2"]
    assert rows.recording.tolist() == ["flight.bin"] * 2
    run(str(tmp_path / "logs"), tmp_path / "second.parquet", Options(sensor="2"), workers=0)
    second = UnitResults.read(tmp_path / "second.parquet")
    assert second.unit.tolist() == ["V1"]
    np.testing.assert_array_equal(second.offset[0], rows.offset[1])


def test_a_column_of_units_that_no_table_has_is_refused_with_advice(logs: Path, tmp_path: Path) -> None:
    with assert_raises(UsageError):
        run(str(logs), tmp_path / "out.parquet", Options(unit_column="serial"), workers=0)


def test_a_folder_of_something_else_is_left_alone(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "out.parquet.parts").mkdir()
    (tmp_path / "out.parquet.parts" / "diary.txt").write_text("mine")
    with assert_raises(UsageError):
        run(str(logs), tmp_path / "out.parquet", Options(), workers=0, force=True)
    assert (tmp_path / "out.parquet.parts" / "diary.txt").read_text() == "mine"


def test_misuse_is_said_in_a_line(logs: Path, tmp_path: Path) -> None:
    """Also what no recording could be read with: before any is read, and with a table that was good left alone."""
    out = tmp_path / "out.parquet"
    out.write_text("a good table")
    for words, code, said in (
        ([str(tmp_path / "nothing")], 5, "cannot be listed"),
        ([str(logs), "--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], 2, "leave one of them out"),
        ([str(logs), "--unit", "furlong"], 2, "unit 'furlong' is not known: use one of uT"),
        ([str(logs), "--unit", "mG", "--scale", "0.1"], 2, "mG has a fixed scale"),
        ([str(logs), "--axes", "x,x,z"], 2, "need x, y and z once each"),
        ([str(logs), "--columns", "mx,my"], 2, "need three different ones"),
        ([str(logs), "--target", "0"], 2, "need degrees above 0, up to 180"),
        ([str(logs), "--dip", "91"], 2, "need degrees from -89 to 89"),
        ([str(logs), "--scale", "-1"], 2, "need a number above 0"),
        ([str(logs), "--report", str(out)], 2, "have the same name"),
        ([str(logs), "--report", f"{out.parent}/./{out.name}"], 2, "have the same name"),
        ([str(logs), "--output", str(tmp_path / "table.txt")], 2, "give it a name that ends in .parquet or .csv"),
    ):
        ended = CliRunner().invoke(main, ["fleet", "--output", str(out), *words, "--force"], prog_name="flinders")
        assert ended.exit_code == code, ended.output
        assert said in ended.output
        assert out.read_text() == "a good table"
        assert not list(tmp_path.glob("*.parts"))


def table(place: int) -> Any:  # noqa: ANN401 - pyarrow ships no types
    """Readings of one unit as a table of Arrow."""
    field = FIELDS[place]
    times = {"time_s": np.arange(len(field)) * 0.02}
    names = {f"mag_{axis}_uT": field[:, column] for column, axis in enumerate("xyz")}
    return pyarrow.table({"unit": [f"U{place}"] * len(field), **times, **names})


@pytest.mark.parametrize("files", [1, 3])
def test_a_table_that_holds_a_driver_says_what_the_single_command_says(tmp_path: Path, files: int) -> None:
    current = np.abs(np.sin(np.arange(150.0))) * 20.0
    tables = []
    for place, field in enumerate(FIELDS[:3]):
        moved = field + (0.5 * current[:, np.newaxis] if place == 1 else 0.0)
        write_csv(tmp_path / f"U{place}.csv", moved)
        rows = (tmp_path / f"U{place}.csv").read_text().splitlines()
        beside = ["current_A", *(f"{amperes:.3f}" for amperes in current)]
        (tmp_path / f"U{place}.csv").write_text("\n".join(map(",".join, zip(rows, beside, strict=True))) + "\n")
        read = csv.read_csv(tmp_path / f"U{place}.csv")
        tables.append(read.append_column("unit", pyarrow.array([f"U{place}"] * 150)))
    (tmp_path / "in").mkdir()
    for place in range(files):
        parquet.write_table(pyarrow.concat_tables(tables[place::files]), tmp_path / "in" / f"{place}.parquet")
    run(str(tmp_path / "in"), tmp_path / "out.parquet", Options(), workers=0)
    rows_out = UnitResults.read(tmp_path / "out.parquet")
    for place in range(3):
        command = ["calibrate", str(tmp_path / f"U{place}.csv"), "--json"]
        single = json.loads(CliRunner().invoke(main, command, prog_name="flinders").stdout)
        codes = [finding["code"] for finding in single["findings"]]
        assert list(rows_out.findings[place]) == codes
        assert ("disturbance-unmodelled" in codes) == (place == 1)


def test_a_unit_with_many_readings_beside_small_ones_is_streamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A unit beyond what is held in memory is gone through again and again, and gives what it gives in memory."""
    from flinders.apps.fleet import plan

    long = simulate.tumble(seed=9, n=3000, motion="uniform").samples.field
    names = {f"mag_{axis}_uT": long[:, column] for column, axis in enumerate("xyz")}
    big = pyarrow.table({"unit": ["U0big"] * 3000, "time_s": np.arange(3000) * 0.02, **names})
    both = pyarrow.concat_tables([table(0), big, table(1)])
    (tmp_path / "in").mkdir()
    parquet.write_table(both, tmp_path / "in" / "all.parquet", row_group_size=500)
    run(str(tmp_path / "in"), tmp_path / "held.parquet", Options(), workers=0)
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", 1000)
    told = run(str(tmp_path / "in"), tmp_path / "streamed.parquet", Options(), workers=0)
    held, streamed = UnitResults.read(tmp_path / "held.parquet"), UnitResults.read(tmp_path / "streamed.parquet")
    assert told.partitions > 1
    assert streamed.unit.tolist() == held.unit.tolist() == ["U0", "U0big", "U1"]
    assert streamed.readings.tolist() == held.readings.tolist() == [150, 3000, 150]
    for name in ("offset", "matrix", "covariance", "worst_deg", "start_s", "end_s"):
        np.testing.assert_allclose(getattr(streamed, name), getattr(held, name), rtol=1e-6, err_msg=name)


def test_a_unit_in_uT_here_and_counts_there_is_refused_by_name(tmp_path: Path) -> None:
    counts = table(0).rename_columns(["unit", "time_s", "mx", "my", "mz"])
    (tmp_path / "in").mkdir()
    parquet.write_table(table(0), tmp_path / "in" / "a.parquet")
    parquet.write_table(counts, tmp_path / "in" / "b.parquet")
    told = run(str(tmp_path / "in"), tmp_path / "out.parquet", Options(), workers=0)
    assert told.codes == {"unit": 1}
    assert "counts" in UnitResults.read(tmp_path / "out.parquet").message[0]


def test_a_table_without_units_or_field_is_said(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    parquet.write_table(table(0), tmp_path / "in" / "a.parquet")
    parquet.write_table(table(1).drop_columns(["mag_z_uT"]), tmp_path / "in" / "b.parquet")
    told = run(str(tmp_path / "in"), tmp_path / "out.parquet", Options(), workers=0)
    assert (told.verdicts, told.codes) == ({"good": 1, "failed": 1}, {"no-magnetometer": 1})
    with assert_raises(UsageError):
        run(str(tmp_path / "in"), tmp_path / "no.parquet", Options(unit_column="serial"), workers=0)


def test_what_was_left_out_is_told_in_words(logs: Path, tmp_path: Path) -> None:
    (logs / "README").write_text("about them")
    (logs / "notes.md").write_text("more")
    words = ["fleet", str(logs), "--output", str(tmp_path / "out.parquet"), "--workers", "0"]
    ended = CliRunner().invoke(main, words, prog_name="flinders")
    assert_sentences(ended.stdout)


def test_a_store_that_is_not_there_is_an_error_of_ours(tmp_path: Path) -> None:
    pytest.importorskip("obstore")
    with pytest.raises(FlindersError):
        run("s3://", tmp_path / "out.parquet", Options(), workers=0)


def test_a_dask_cluster_gives_the_same_bytes(logs: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    run(str(logs), tmp_path / "here.parquet", Options(), workers=0)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        run(str(logs), tmp_path / "there.parquet", Options(), scheduler=cluster.scheduler_address)
    assert (tmp_path / "here.parquet").read_bytes() == (tmp_path / "there.parquet").read_bytes()


def test_a_cluster_without_workers_is_said_and_waited_for(logs: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    told: list[str] = []
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster, log_to(tmp_path / "log.jsonl"):  # fmt: skip

        def help_out(words: str) -> None:
            told.append(words)
            cluster.scale(1)

        address = cluster.scheduler_address
        ended = run(str(logs), tmp_path / "out.parquet", Options(), scheduler=address, notice=help_out)
    assert ended.units == 6
    assert len(told) == told[0].count(address) - 1 == 1
    assert_sentences(told[0].replace(address, "ADDRESS"))
    waits = [event["message"] for event in events(tmp_path / "log.jsonl") if event["event"] == "waiting"]
    assert waits == told


def test_a_byte_that_the_disk_has_turned_is_an_error_where_pages_have_check_sums(tmp_path: Path) -> None:
    path, out = tmp_path / "units.parquet", tmp_path / "out.parquet"
    parquet.write_table(table(0), path, write_page_checksum=True)
    turn_a_byte(path)
    run(str(path), out, Options(), workers=0)
    assert UnitResults.read(out).code.tolist() == ["unreadable"]
    turn_a_byte(out)
    with assert_raises(DocumentError):
        UnitResults.read(out)


def turn_a_byte(path: Path) -> None:
    """Spoil the last byte of the first column."""
    column = parquet.read_metadata(path).row_group(0).column(0)
    content = bytearray(path.read_bytes())
    content[(column.dictionary_page_offset or column.data_page_offset) + column.total_compressed_size - 1] ^= 1
    path.write_bytes(content)


def test_a_scheduler_that_goes_away_is_said_and_the_run_goes_on(
    logs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    distributed = pytest.importorskip("distributed")
    run(str(logs), tmp_path / "whole.parquet", Options(), workers=0)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:

        def leave(*_: int) -> None:
            cluster.close()

        with assert_raises(LinkError):
            run(str(logs), tmp_path / "out.parquet", Options(), scheduler=cluster.scheduler_address, watch=leave)
    assert "Traceback" not in capfd.readouterr().err
    told = run(str(logs), tmp_path / "out.parquet", Options(), workers=0, append=True)
    assert told.resumed >= 1
    assert (tmp_path / "out.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


def test_a_result_that_died_with_its_worker_is_waited_for() -> None:
    """The worker is killed between the end of its work and the reading of the result: another does it anew."""

    class Future:
        status = "lost"

        def exception(self) -> None:
            self.status = "finished"

        def result(self) -> bytes:
            assert self.status == "finished"
            return b"rows"

    assert scheduler._future_result(Future(), "tcp://127.0.0.1:8786") == b"rows"


def test_a_scheduler_that_is_not_there_is_said(logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(scheduler, "TIMEOUT_S", 0.2)
    with assert_raises(FlindersError, "link"):
        run(str(logs), tmp_path / "out.parquet", Options(), scheduler="tcp://127.0.0.1:1")
