"""Files of strangers: a result or an error of Flinders in bounded time and memory, whatever they hold."""

from __future__ import annotations

import contextlib
import gzip
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.core import files
from flinders.errors import FlindersError, NoMagnetometer, UnreadableInput
from flinders.readers import parquet

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.samples import Samples

FIELD = simulate.tumble(seed=5, n=300, motion="uniform").samples.field
TEXT = "mx_uT,my_uT,mz_uT\n" + "".join(f"{x:.3f},{y:.3f},{z:.3f}\n" for x, y, z in FIELD)


def arrow_of(path: Path, names: tuple[str, ...] = ("mx_uT", "my_uT", "mz_uT"), **options: str) -> Path:
    """An Arrow file, of many zeros where it is packed."""
    import pyarrow
    from pyarrow import ipc

    field = np.zeros((8_000_000, 3)) if options else FIELD
    columns = pyarrow.table(dict(zip(names, field.T, strict=True)))
    packing = ipc.IpcWriteOptions(**options)
    with pyarrow.OSFile(str(path), "wb") as sink, ipc.new_file(sink, columns.schema, options=packing) as writer:
        writer.write_table(columns)
    return path


# the fuzzer


# no exception but the project's own


def test_a_column_whose_name_is_no_text_is_refused(tmp_path: Path) -> None:
    path = arrow_of(tmp_path / "broken.arrow")
    path.write_bytes(path.read_bytes().replace(b"mx_uT", b"m\xff_uT"))
    with assert_raises(UnreadableInput):
        flinders.read(path)


def test_a_row_group_that_says_it_has_no_rows_is_refused(tmp_path: Path) -> None:
    import pyarrow
    from pyarrow import parquet as written_by

    path = tmp_path / "empty.parquet"
    written_by.write_table(pyarrow.table(dict(zip(("mx_uT", "my_uT", "mz_uT"), FIELD.T, strict=True))), path)
    content = path.read_bytes()
    place = content.rindex(b"\xd8\x04")  # 300 rows as the footer writes them
    path.write_bytes(content[:place] + b"\x80\x00" + content[place + 2 :])
    with assert_raises(UnreadableInput):
        flinders.read(path)


@pytest.mark.parametrize("letter", list("bBhHiIqQfdgMcCeELnNZax?\u00b2"))
def test_any_letter_may_stand_in_the_description_of_a_message(letter: str, tmp_path: Path) -> None:
    lines = [
        "FMT, 134, 18, MAG, QBhhhB, TimeUS,I,MagX,MagY,MagZ,Health",
        "FMT, 129, 31, PARM, QNf, TimeUS,Name,Value",
        "PARM, 1000000, COMPASS_OFS_X, -97.5",
        *(f"MAG, {1_000_000 + 20_000 * place}, 0, {place}, 4, -586, 1" for place in range(20)),
    ]
    for number, at in ((0, 5), (0, 21), (0, 23), (1, 5), (1, 20), (1, 21)):
        changed = [*lines]
        changed[number] = changed[number][:at] + letter + changed[number][at + 1 :]
        (tmp_path / "flight.log").write_text("\n".join(changed), encoding="utf-8")
        with contextlib.suppress(FlindersError):
            flinders.read(tmp_path / "flight.log")


def test_a_name_that_is_no_utf_8_stands_in_no_report(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff.csv"))
    path.write_text(TEXT)
    out = tmp_path / "out"
    out.mkdir()
    ended = flinders_("calibrate", str(path), "-o", str(out / "c.json"), "--report", str(out / "r.html"))
    assert ended.code == 0, ended.err
    assert "\ufffd.csv" in (out / "r.html").read_text(encoding="utf-8")
    assert "\ufffd.csv" in (out / "c.json").read_text(encoding="utf-8")


# what is read is what is named


def replace_it(path: Path) -> None:
    other = path.with_suffix(".new")
    other.write_text(TEXT.replace("1", "2"))
    other.replace(path)


def write_over_it(path: Path) -> None:
    path.write_text(TEXT.replace("1", "2"))
    os.utime(path, ns=(0, 0))


def write_over_it_with_more(path: Path) -> None:
    path.write_text(TEXT.replace("1", "2") + "1,2,3\n")


@pytest.mark.parametrize("change", [replace_it, write_over_it, write_over_it_with_more])
def test_a_file_that_is_another_one_by_the_end_is_refused(change: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(TEXT)
    recording = flinders.open_recording(path)
    change(path)
    with assert_raises(UnreadableInput):
        list(recording.blocks())


def test_a_file_that_grows_ends_at_the_size_it_had(tmp_path: Path) -> None:
    for path in (tmp_path / "log.csv", tmp_path / "log.csv.gz"):
        content = TEXT.encode()
        path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
        recording = flinders.open_recording(path)
        with path.open("ab") as file:
            file.write(b"1,2,3\n" * 1000)
        assert sum(map(len, recording.blocks())) == len(FIELD)


def test_an_array_longer_than_its_header_says_is_told(tmp_path: Path) -> None:
    path = tmp_path / "long.npy"
    np.save(path, np.concatenate([FIELD, FIELD]))
    path.write_bytes(path.read_bytes().replace(b"(600, 3), ", b"(300, 3), "))
    ended = flinders_("info", str(path), "--unit", "uT")
    assert_sentences(" ".join((ended.out + ended.err).split()))


@pytest.mark.parametrize(
    "header", ["mag_raw_x,mag_rxw_y,mag_raw_z,mag_x,mag_y,mag_z", "mx_raw,my_raw,m\ufffd,mx,my,mz"]
)
def test_raw_columns_of_which_one_has_a_damaged_name_are_told_before_the_calibrated_are_read(
    header: str, tmp_path: Path
) -> None:
    rows = np.hstack([FIELD, 1.1 * FIELD])
    np.savetxt(tmp_path / "log.csv", rows, header=header, comments="", delimiter=",")
    words = str(flinders.open_recording(tmp_path / "log.csv"))
    assert f"left out {header.split(',', maxsplit=1)[0]}, " in words
    assert_sentences(words)


# bounds


def test_packed_columns_are_weighed_before_they_are_unpacked(tmp_path: Path) -> None:
    import pyarrow
    from pyarrow import parquet as written_by

    path = arrow_of(tmp_path / "zeros.arrow", compression="zstd")
    before = pyarrow.total_allocated_bytes()
    with assert_raises(UnreadableInput):
        flinders.read(path)
    assert pyarrow.total_allocated_bytes() - before < 1 << 20
    names = ("mx_uT", "my_uT", "mz_uT")
    columns = pyarrow.table(dict(zip(names, np.zeros((3, 4_000_000)), strict=True)))
    written_by.write_table(columns, tmp_path / "zeros.parquet", row_group_size=1_000_000)
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "zeros.parquet")


def test_a_column_of_a_row_group_is_not_asked_for_its_metadata() -> None:
    """On broken sizes of levels pyarrow ends the program there, without an exception."""
    group = SimpleNamespace(num_columns=3, total_byte_size=3 * 8 * 300)
    metadata = SimpleNamespace(num_rows=300, num_row_groups=1, row_group=lambda _: group)
    parquet.refuse_packed_groups(metadata, "log.parquet", 8000)


def test_a_packed_table_of_readings_is_no_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "MAX_UNPACKED_BYTES", 1 << 13)
    with assert_raises(UnreadableInput):
        flinders.read(_packed(tmp_path / "one.arrow", chunk=300))
    assert len(flinders.read(_packed(tmp_path / "two.arrow", chunk=100))) == 300


def _packed(path: Path, chunk: int) -> Path:
    import pyarrow
    from pyarrow import ipc

    columns = pyarrow.table({"t": np.arange(300.0), **dict(zip(("mx_uT", "my_uT", "mz_uT"), FIELD.T, strict=True))})
    packing = ipc.IpcWriteOptions(compression="lz4")
    with pyarrow.OSFile(str(path), "wb") as sink, ipc.new_file(sink, columns.schema, options=packing) as writer:
        writer.write_table(columns, max_chunksize=chunk)
    return path


def test_a_packed_table_of_text_is_weighed_before_most_of_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "MIN_RATIO_BYTES", 1 << 19)
    monkeypatch.setattr(files, "MAX_RATIO", 20)
    path = tmp_path / "bomb.csv.gz"
    path.write_bytes(gzip.compress(b"x,y,z\n" + b"1,2,3\n" * 1_000_000))
    recording = flinders.open_recording(path, unit="uT")
    blocks: list[Samples] = []
    with assert_raises(UnreadableInput):
        blocks.extend(recording.blocks())
    assert sum(map(len, blocks)) < 200_000


def test_a_header_of_a_hundred_thousand_names_is_refused_in_a_line(tmp_path: Path) -> None:
    row = ",".join(["1.5"] * 100_000)
    (tmp_path / "wide.csv").write_text(",".join(f"c{place}" for place in range(100_000)) + f"\n{row}\n{row}\n")
    with assert_raises(NoMagnetometer):
        flinders.read(tmp_path / "wide.csv")


# streams and interrupts


@pytest.mark.parametrize("words", daily(["demo", "info log.csv --json", "calibrate log.csv --json"]))
def test_a_closed_standard_output_is_an_error(words: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(TEXT)
    command = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "flinders", *words.split()]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert ended.returncode == 6
    assert (
        ended.stderr.splitlines()[-1] == b"error: output cannot be written: it is closed: leave it open, or name a file"
    )


def test_ctrl_c_while_the_program_starts_prints_no_traceback() -> None:
    """Sent as soon as the command line imports something, and then ever later; its input never ends.

    Python itself loses an interrupt that arrives while it calls back from an import: a person presses again.
    """
    run = "\n".join([
        "import signal, sys",
        "signal.signal(signal.SIGINT, signal.default_int_handler)",
        "class Told:",
        "    def find_spec(name, *_):",
        "        if name == 'click': print(flush=True)",
        "sys.meta_path.insert(0, Told)",
        "from flinders.cli import main",
        "sys.argv[1:] = ['calibrate', '-']",
        "main(prog_name='flinders')",
    ])  # fmt: skip
    for later in (0.0, 0.02, 0.05, 0.1, 0.2):
        assert _interrupted(run, later, times=3) in ((130, []), (130, [b"interrupted"]))


def test_ctrl_c_while_a_module_is_imported_ends_the_program() -> None:
    """Python before 3.12 makes a fault of it while a class is made, NumPy while it is loaded; it comes afterwards.

    It comes again if it is not seen, as one just before the program waits for input.
    """
    run = "\n".join([
        "import signal, sys, time",
        "unseen, send = [1], signal.pthread_kill",
        "signal.pthread_kill = lambda *signal: unseen.pop() if unseen else send(*signal)",
        "signal.signal(signal.SIGINT, signal.default_int_handler)",
        "from flinders.cli import main",
        "class Hidden:",
        "    def find_spec(name, *_):",
        "        if name == 'numpy':",
        "            print(flush=True)",
        "            try: time.sleep(0.2)",
        "            except KeyboardInterrupt: raise ImportError(name)",
        "sys.meta_path.insert(0, Hidden)",
        "sys.argv[1:] = ['calibrate', '-']",
        "main(prog_name='flinders')",
    ])  # fmt: skip
    assert _interrupted(run, 0.0) == (130, [b"interrupted"])


def _interrupted(run: str, later: float, times: int = 1) -> tuple[int, list[bytes]]:
    """Exit code and words of a program that is interrupted some seconds after its first line; its input goes on.

    It is interrupted again if it runs on for a minute, so many times in all.
    """
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", run], stdin=pipe, stdout=pipe, stderr=pipe) as program:
        assert program.stdout is not None
        assert program.stderr is not None
        program.stdout.readline()
        time.sleep(later)
        for _ in range(times - 1):
            program.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                return program.wait(60), program.stderr.read().split()
        program.send_signal(signal.SIGINT)
        return program.wait(60), program.stderr.read().split()
