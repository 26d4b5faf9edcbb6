"""A fleet on a disk that is full, closed or in a circle: said in a line or a row, and nothing that is done is lost."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from benchmarks.bucket import Bucket
from tests.sentences import assert_raises, assert_sentences

from flinders import simulate
from flinders.apps.fleet import UnitResults, storage
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.progress import LOGGER, Progress, log_event, log_to
from flinders.apps.fleet.scheduler import map_units
from flinders.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytest.importorskip("pyarrow")

FIELD = simulate.tumble(seed=1, n=120, motion="uniform").samples.field
TEXT = "mag_x_uT,mag_y_uT,mag_z_uT\n" + "".join(",".join(f"{value:.3f}" for value in row) + "\n" for row in FIELD)
NOBODY = 65534


@pytest.fixture
def logs() -> Iterator[Path]:
    """Four units with a log each, where anybody may look."""
    with tempfile.TemporaryDirectory() as made:
        Path(made).chmod(0o777)
        for unit in ("U0", "U1", "U2", "U3"):
            (Path(made) / "logs" / unit).mkdir(parents=True)
            (Path(made) / "logs" / unit / "monday.csv").write_text(TEXT)
        yield Path(made) / "logs"


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_what_may_not_be_read_is_a_row(logs: Path) -> None:
    """A file, a folder that may not be listed, and one whose files may not be looked at."""
    out = logs.parent / "out.parquet"
    run(str(logs), logs.parent / "whole.parquet", Options(), workers=0)  # imports what it needs, as who may
    (logs / "U0" / "monday.csv").chmod(0)
    (logs / "U1").chmod(0)
    (logs / "U2").chmod(0o444)
    own = os.geteuid()
    try:
        if own == 0:
            os.seteuid(NOBODY)
        told = run(str(logs), out, Options(), workers=0)
    finally:
        os.seteuid(own)
        for unit in ("U1", "U2"):
            (logs / unit).chmod(0o755)
    rows = UnitResults.read(out)
    assert (told.verdicts, told.codes) == ({"good": 1, "failed": 3}, {"unreadable": 3})
    assert rows.unit.tolist() == ["U0", "U1", "U2", "U3"]
    assert_sentences(rows.message[1])


def test_a_link_that_leads_up_is_not_followed(logs: Path) -> None:
    (logs / "U0" / "up").symlink_to(logs, target_is_directory=True)
    (logs / "U1" / "itself").symlink_to("itself")
    (logs.parent / "elsewhere").mkdir()
    (logs.parent / "elsewhere" / "tuesday.csv").write_text(TEXT)
    (logs / "U2" / "more").symlink_to(logs.parent / "elsewhere", target_is_directory=True)
    names = [member.name for member in storage.list_files(str(logs))]
    seen = ["U0/monday.csv", "U1/itself", "U1/monday.csv", "U2/monday.csv", "U2/more/tuesday.csv", "U3/monday.csv"]
    assert names == seen


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_log_that_cannot_be_written_is_said_and_the_run_resumed(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first line, before anything is done, and the first after a partition was."""
    out = logs.parent / "out.parquet"
    said = r"/dev/full: the log cannot be written: no space [^.]*"
    with pytest.raises(OutputError, match=f"{said}$"), log_to("/dev/full"):
        run(str(logs), out, Options(), workers=0)
    assert not list(logs.parent.glob("*.parts"))
    monkeypatch.setattr(Progress, "log_plan", quietly(Progress.log_plan))
    with assert_raises(OutputError), log_to("/dev/full"):
        run(str(logs), out, Options(), workers=0)
    told = run(str(logs), out, Options(), workers=0, append=True)
    assert (told.resumed, told.verdicts) == (1, {"good": 4})


def quietly(planned: Callable[..., None]) -> Callable[..., None]:
    """The same without the first line of the log."""

    def silent(progress: Progress, *args: Any, **fields: object) -> None:
        LOGGER.disabled = True
        planned(progress, *args, **fields)
        LOGGER.disabled = False

    return silent


def test_a_log_goes_on_below_a_line_that_was_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text('{"event": "planned"}\n{"event": "part')
    for _ in range(2):
        with log_to(path):
            log_event("planned", resumed=1)
    first, cut, *others = path.read_text().splitlines()
    assert (json.loads(first)["event"], cut) == ("planned", '{"event": "part')
    assert [json.loads(line)["resumed"] for line in others] == [1, 1]


def test_a_copy_of_an_object_for_which_there_is_no_room_ends_the_run(
    logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That is no fault of the recording, and the next one has no room either."""
    pytest.importorskip("obstore")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(storage, "write_all", full)
    with Bucket({"U0/monday.csv": TEXT.encode()}) as bucket:
        for name, value in bucket.environment.items():
            monkeypatch.setenv(name, value)
        with assert_raises(OutputError):
            run("gs://fleet/", logs.parent / "out.parquet", Options(), workers=0)


def no_room(_: int) -> bytes:
    raise OutputError("no space left on the disk: free some, or use another disk")


def test_a_full_disk_of_a_worker_is_told_as_one_of_the_driver() -> None:
    with assert_raises(OutputError):
        list(map_units(no_room, [1, 2], workers=2))


def test_a_script_without_a_main_block_is_refused(tmp_path: Path) -> None:
    """Each worker runs it again; without a limit that would go on for every unit of the fleet."""
    script = tmp_path / "script.py"
    script.write_text(
        "from flinders.errors import LinkError\n"
        "from flinders.apps.fleet.scheduler import map_units\n"
        "try:\n    list(map_units(abs, range(100), workers=2))\n"
        "except LinkError as error:\n    raise SystemExit(str(error))\n",
        encoding="utf-8",
    )
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=600)
    assert ended.returncode == 1
    assert_sentences(ended.stderr, about="3 worker processes")
    assert '`if __name__ == "__main__":`' in ended.stderr
