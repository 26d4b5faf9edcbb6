"""Formats beside text: what each format's own library writes is read back to the bit, and what is broken is told."""

from __future__ import annotations

import gzip
import io
import json
import os
import subprocess
import sys
import threading
import zipfile
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.samples import BY_NAME, LOGS, WRITERS, written
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core import files
from flinders.core.calibration import Calibration
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import FlindersError, MissingExtra, NoMagnetometer, UnreadableInput, UsageError
from flinders.readers import Instrument, Log, Reader, TableRecording, registry
from flinders.readers._log import Stored

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.arrays import Floats

ROOT = Path(__file__).resolve().parent.parent.parent
ROWS = 300


@pytest.fixture(scope="module")
def tumble() -> Floats:
    """(N, 7): time in s, field in mG, acceleration."""
    samples = simulate.tumble(seed=3).samples[:ROWS]
    acceleration = np.random.default_rng(3).normal(size=(ROWS, 3))
    return np.column_stack([np.arange(ROWS) / 50.0, 10.0 * samples.field, acceleration])


TABLES = [name for name in WRITERS if name not in LOGS]


@pytest.mark.parametrize("name", BY_NAME)
def test_every_reader_has_a_sample_and_reads_it(name: str, tmp_path: Path, tumble: Floats) -> None:
    """To the last digit that the format has: logs of vehicles keep whole mG, or gauss as float32."""
    assert name in WRITERS, f"tests/samples.py writes no sample of {name}"
    recording = flinders.open_recording(written(name, tmp_path, tumble))
    field = np.concatenate([block.field for block in recording.blocks()])
    digits = 0.5 if name in {"tlog", "dataflash"} else 1e-4
    np.testing.assert_allclose(10.0 * field, tumble[:, 1:4], rtol=0, atol=digits)


@pytest.mark.parametrize("name", TABLES)
def test_what_is_written_is_read_back(name: str, tmp_path: Path, tumble: Floats) -> None:
    """Field in µT, time and acceleration, whatever the format; also with gzip around it, and through a pipe."""
    path = written(name, tmp_path, tumble)
    samples = flinders.read(path)
    assert samples.unit.name == "mG"
    np.testing.assert_allclose(samples.field, tumble[:, 1:4] / 10.0, rtol=1e-15)
    assert samples.time is not None
    assert samples.acceleration is not None
    np.testing.assert_array_equal(samples.time, tumble[:, 0])
    np.testing.assert_array_equal(samples.acceleration, tumble[:, 4:])

    packed = tmp_path / "packed"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_array_equal(flinders.read(packed).field, samples.field)


@pytest.mark.parametrize("name", TABLES)
def test_from_and_to_are_seconds_from_the_beginning(name: str, tmp_path: Path, tumble: Floats) -> None:
    shifted = tumble + np.eye(1, 7) * 100.0  # the clock starts at 100 s
    path = written(name, tmp_path, shifted)
    samples = flinders.read(path, start=1.0, end=2.0)
    np.testing.assert_allclose(samples.field, tumble[50:101, 1:4] / 10.0, rtol=1e-15)
    with assert_raises(UsageError):
        flinders.read(path, start=60.0)


@pytest.mark.parametrize("name", TABLES)
def test_a_recording_may_be_piped_in(
    name: str, tmp_path: Path, tumble: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(name, tmp_path, tumble)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    np.testing.assert_allclose(flinders.read("-").field, tumble[:, 1:4] / 10.0, rtol=1e-15)


@pytest.mark.parametrize("name", TABLES)
def test_a_calibration_is_the_same_from_any_format(name: str, tmp_path: Path, tumble: Floats) -> None:
    path = written(name, tmp_path, tumble)
    fit = flinders.fit(flinders.open_recording(path))
    truth = flinders.fit(Samples.of(tumble[:, 1:4], unit="mG", time=tumble[:, 0], acceleration=tumble[:, 4:]))
    np.testing.assert_allclose(fit.calibration.offset, truth.calibration.offset, rtol=1e-9)


@pytest.mark.parametrize("name", [name for name, reader in BY_NAME.items() if reader.extra and name in TABLES])
def test_a_missing_package_ends_with_the_command_that_installs_it(
    name: str, tmp_path: Path, tumble: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(name, tmp_path, tumble)
    for package in ("h5py", "scipy.io", "pyarrow", "pyarrow.parquet", "pyarrow.ipc"):
        monkeypatch.setitem(sys.modules, package, None)
    with assert_raises(MissingExtra):
        flinders.read(path)


def test_reading_text_needs_no_extra() -> None:
    """Optional packages are imported when such a file is opened, and not before."""
    code = "import flinders.readers, sys; print([n for n in sys.modules if n.split('.')[0] in set(sys.argv[1:])])"
    extras = ("h5py", "pyarrow", "scipy", "pyulog", "rosbags", "pymavlink")
    ended = subprocess.run([sys.executable, "-c", code, *extras], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "[]"


SHAPES: dict[str, tuple[Any, dict[str, str]]] = {
    "N by 3": (np.arange(30.0).reshape(10, 3), {}),
    "3 by N": (np.arange(30.0).reshape(10, 3).T, {}),
    "Fortran order": (np.asfortranarray(np.arange(30.0).reshape(10, 3)), {}),
    "integers": (np.arange(30).reshape(10, 3).astype(">i2"), {}),
    "time first": (np.column_stack([np.arange(10) / 10, np.arange(30.0).reshape(10, 3)]), {}),
    "chosen": (np.column_stack([np.zeros((10, 3)), np.arange(30.0).reshape(10, 3)]), {"columns": "4,5,6"}),
}


@pytest.mark.parametrize("name", SHAPES)
def test_arrays_without_names(name: str, tmp_path: Path) -> None:
    array, options = SHAPES[name]
    for path in (tmp_path / "one.npy", tmp_path / "one.npz"):
        (np.save if path.suffix == ".npy" else np.savez)(path, array)
        samples = flinders.read(path, unit="uT", columns=options.get("columns"))
        np.testing.assert_array_equal(samples.field, np.arange(30.0).reshape(10, 3))
        assert (samples.time is not None) == (name == "time first")


def test_rows_that_are_not_finite_are_left_out_and_counted(tmp_path: Path) -> None:
    array = np.arange(60_000.0).reshape(20_000, 3)
    array[[3, 15_000], 1] = np.nan
    np.save(tmp_path / "gaps.npy", array)
    samples = flinders.read(tmp_path / "gaps.npy")
    assert len(samples) == 19_998
    assert [(each.reason, each.rows, each.lines) for each in samples.skipped] == [("not finite", 2, (4, 15001))]


def test_an_array_that_python_2_wrote_is_read_without_a_warning(tmp_path: Path) -> None:
    np.save(tmp_path / "old.npy", np.eye(3))
    content = (tmp_path / "old.npy").read_bytes().replace(b"(3, 3), ", b"(3L, 3),")
    (tmp_path / "old.npy").write_bytes(content)
    assert np.array_equal(flinders.read(tmp_path / "old.npy").field, np.eye(3))


def test_a_date_is_a_time(tmp_path: Path) -> None:
    days = np.datetime64("2026-11-21T10:00:00", "ms") + np.arange(10) * np.timedelta64(100, "ms")
    np.savez(tmp_path / "dated.npz", timestamp=days, mag=np.arange(30.0).reshape(10, 3))
    samples = flinders.read(tmp_path / "dated.npz")
    assert samples.time is not None
    np.testing.assert_allclose(samples.time, np.arange(10) / 10, atol=1e-6)


PAPARAZZI = "".join(
    f"{0.1 * n:.3f} 7 GPS 1 2 3\n{0.1 * n + 0.02:.3f} 7 IMU_MAG_RAW {{id}}{n} {2 * n} {1 - n}\n"
    f"{0.1 * n + 0.03:.3f} 8 IMU_MAG_RAW {{id}}9 9 9\n"
    for n in range(30)
)


@pytest.mark.parametrize("number", ["", "1 "])
def test_a_paparazzi_log_is_that_of_its_first_aircraft(number: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.data"
    path.write_text(PAPARAZZI.format(id=number))
    samples = flinders.read(path)
    counted = np.arange(30.0)
    np.testing.assert_array_equal(samples.field, np.column_stack([counted, 2 * counted, 1 - counted]))
    assert samples.unit.name == "counts"
    assert samples.time is not None
    np.testing.assert_allclose(samples.time, 0.1 * counted + 0.02)


def test_a_paparazzi_log_may_have_the_current_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "flight.data"
    path.write_text("".join(f"{n / 10} 7 IMU_MAG_CURRENT_CALIBRATION {n} 2 -3 {n / 2}\n" for n in range(9)))
    samples = flinders.read(path)
    assert samples.current is not None
    np.testing.assert_allclose(samples.current, np.arange(9) / 2)


def test_a_blackbox_log_has_a_block_of_headers(tmp_path: Path) -> None:
    head = '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"magHardware",1\n"motorOutput","158,2047"\n'
    names = (
        "loopIteration,time (us),gyroADC[0],gyroADC[1],gyroADC[2],magADC[0],magADC[1],magADC[2],amperageLatest (A)\n"
    )
    rows = "".join(f"{n},{1000 * n},1,2,3,{n},{2 * n},{1 - n},0.5\n" for n in range(20))
    path = tmp_path / "blackbox.csv"
    path.write_text(head + names + rows)
    samples = flinders.read(path)
    np.testing.assert_array_equal(samples.field[:, 2], 1 - np.arange(20.0))
    assert samples.time is not None
    np.testing.assert_allclose(samples.time, np.arange(20) / 1000)
    (told,) = flinders.open_log(path).notes
    assert told in str(flinders.open_recording(path))
    assert_sentences(told)
    assert samples.frame == "vehicle"
    assert flinders.read(path, columns="magADC[0],magADC[1],magADC[2]").frame == "vehicle"
    assert flinders.read(path, columns="3,4,5", unit="counts").frame == "sensor"  # the gyro, as somebody wants


BLACKBOX = "loopIteration,time,magADC[0],magADC[1],magADC[2]\n" + "".join(f"{n},{n},{n},7,-{n}\n" for n in range(20))


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ('"magzero","12,13,14"', "magzero 12,13,14"),
        ("magzero_x,-5", "magzero_x -5"),
        ('"mag_calibration","1,0,0"', "mag_calibration 1,0,0"),
        ('"maggain","1024,1000,1024"', "maggain 1024,1000,1024"),
    ],
)
def test_a_blackbox_whose_headers_tell_a_calibration_in_force_is_refused(tmp_path: Path, line: str, told: str) -> None:
    path = tmp_path / "blackbox.csv"
    path.write_text(f'"Firmware revision","INAV 7.0.0"\n{line}\n{BLACKBOX}')
    with assert_raises(UnreadableInput) as caught:
        flinders.read(path)
    assert f"recorded with {told} in" in str(caught.value)
    asked = flinders.open_recording(path, columns="magADC[0],magADC[1],magADC[2]")
    assert str(asked).endswith(f"recorded with {told} in force")
    assert len(flinders.read(path, columns="magADC[0],magADC[1],magADC[2]")) == 20


@pytest.mark.parametrize(
    "line", ['"magzero","0,0,0"', '"mag_calibration","0,0,0"', '"maggain","1024,1024,1024"', '"mag_hardware","1"']
)
def test_a_blackbox_whose_headers_tell_none_in_force_is_read(tmp_path: Path, line: str) -> None:
    path = tmp_path / "blackbox.csv"
    path.write_text(f'"Firmware revision","INAV 7.0.0"\n{line}\n{BLACKBOX}')
    assert len(flinders.read(path)) == 20
    assert "in force" not in str(flinders.open_recording(path))


# archives


def test_the_member_of_an_archive_can_be_chosen(tmp_path: Path, tumble: Floats) -> None:
    path = written("zip", tmp_path, tumble)
    recording = flinders.open_recording(path)
    assert str(recording).startswith("tumble.zip/MagnetometerUncalibrated.csv: ")
    halved = flinders.read(path, topic="magnetometer.csv")
    np.testing.assert_allclose(halved.field, tumble[:, 1:4] / 20.0, rtol=1e-15)
    with assert_raises(UsageError):
        flinders.read(path, topic="gyro")
    with assert_raises(UsageError):
        flinders.read(path, topic="magnetometer")


def archive(path: Path, **members: str | bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name.replace("__", "."), content)
    return path


def test_a_zip_bomb_is_refused_while_it_is_unpacked(tmp_path: Path) -> None:
    bomb = archive(tmp_path / "bomb.zip", Magnetometer__csv=b"1,2,3\n" * 10_000_000)
    assert bomb.stat().st_size < 200_000
    with assert_raises(UnreadableInput, numbers=False):
        flinders.read(bomb)


def test_a_gzip_bomb_is_refused_while_it_is_unpacked(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.npy.gz"
    bomb.write_bytes(gzip.compress(b"\x93NUMPY" + bytes(40_000_000)))
    with assert_raises(UnreadableInput, numbers=False):
        flinders.read(bomb)


def test_a_gzip_bomb_of_text_is_refused_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MIN_RATIO_BYTES", 1 << 20)
    bomb = tmp_path / "bomb.csv.gz"
    bomb.write_bytes(gzip.compress(b"1,2,3\n" * 400_000))
    with assert_raises(UnreadableInput, numbers=False):
        flinders.read(bomb)


def test_a_gzip_bomb_through_a_pipe_is_refused_while_it_is_read_in_one_pass(tmp_path: Path) -> None:
    from flinders.readers._source import find

    pipe = tmp_path / "bomb"
    os.mkfifo(pipe)
    packed = gzip.compress(b"1,2,3\n" * 3_200_000)
    writing = threading.Thread(target=_write, args=(pipe, packed), daemon=True)
    writing.start()
    given: list[int] = []
    with assert_raises(UnreadableInput, numbers=False):
        given.extend(map(len, find(pipe, once=True).chunks()))
    assert sum(given) <= 17 << 20
    writing.join(5)


def _write(pipe: Path, content: bytes) -> None:
    with suppress(BrokenPipeError), pipe.open("wb") as stream:
        stream.write(content)


def test_cells_of_matlab_are_not_looked_at(tmp_path: Path) -> None:
    from scipy.io import savemat

    cells = np.empty(2000, object)
    cells[:] = 1.0
    log = {"mag": np.tile([1.0, 2.0, 3.0], (50, 1)), "note": cells, "spin": np.ones(50, complex)}
    for is_packed in (False, True):
        savemat(tmp_path / "nested.mat", {"s": log, "other": cells}, do_compression=is_packed)
        assert flinders.read(tmp_path / "nested.mat").field.tolist() == [[1.0, 2.0, 3.0]] * 50


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", "?"])
def test_arrays_of_matlab_are_those_that_scipy_reads(kind: str, tmp_path: Path) -> None:
    from scipy.io import loadmat, savemat

    mag = np.arange(60).reshape(20, 3).astype(kind)
    for number, field in enumerate((mag, mag.T, np.asfortranarray(mag)[:, ::-1])):
        path = tmp_path / f"{number}.mat"
        savemat(path, {"mag": field, "t": np.arange(20.0)}, do_compression=bool(number))
        whole = loadmat(path)["mag"]
        assert np.array_equal(flinders.read(path).field, whole if len(whole) == 20 else whole.T)


def test_no_length_in_a_file_of_matlab_leads_beyond_it(tmp_path: Path) -> None:
    """These bytes, four of them changed, end SciPy's reader with a fault of memory, and the program with it."""
    from scipy.io import savemat

    savemat(tmp_path / "whole.mat", {"mag": np.random.default_rng(0).normal(size=(300, 3))})
    content = bytearray((tmp_path / "whole.mat").read_bytes())
    for place in range(128, 200):
        changed = content[:place] + b"\xc8" * 2 + content[place + 2 :]
        (tmp_path / "changed.mat").write_bytes(changed)
        with suppress(FlindersError):
            flinders.read(tmp_path / "changed.mat")


def test_what_is_empty_or_without_numbers_is_said(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"a": ["x", "y"]}), tmp_path / "words.parquet")
    with assert_raises(NoMagnetometer):
        flinders.read(tmp_path / "words.parquet")
    with assert_raises(UnreadableInput):
        flinders.read(archive(tmp_path / "empty.zip", Magnetometer__csv=""))


def test_an_array_of_many_columns_shows_their_ranges(tmp_path: Path) -> None:
    np.save(tmp_path / "wide.npy", np.arange(40.0).reshape(8, 5) - 10)
    with assert_raises(NoMagnetometer):
        flinders.read(tmp_path / "wide.npy")


def test_the_module_is_the_command() -> None:
    words = [sys.executable, "-m", "flinders", "--version"]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout == CliRunner().invoke(main, ["--version"], prog_name="flinders").stdout


def test_an_archive_of_arrays_may_hold_one_of_zeros(tmp_path: Path) -> None:
    """It packs as well as a bomb does, and what it unpacks to is known from its header."""
    mag = np.arange(27.0).reshape(9, 3)
    np.savez_compressed(tmp_path / "run.npz", flags=np.zeros(2_500_000), mag=mag, t=np.arange(9.0))
    assert len(flinders.read(tmp_path / "run.npz", columns="mag.x,mag.y,mag.z")) == 9


def test_archives_that_are_none_of_recordings(tmp_path: Path) -> None:
    sheet = archive(tmp_path / "sheet.zip", **{"[Content_Types]__xml": "<x/>", "xl/sheet__xml": "<x/>"})
    with assert_raises(UnreadableInput):
        flinders.read(sheet)
    with assert_raises(NoMagnetometer):
        flinders.read(archive(tmp_path / "photos.zip", photo__jpg=b"\xff\xd8\xff"))
    with assert_raises(NoMagnetometer):
        flinders.read(archive(tmp_path / "two.zip", a__csv="1,2,3\n", b__csv="1,2,3\n"))


def test_objects_of_python_are_not_read(tmp_path: Path) -> None:
    """An array of objects is a program: it is refused, and not run."""
    trap = np.empty(2, dtype=object)
    np.save(tmp_path / "trap.npy", trap, allow_pickle=True)
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "trap.npy")


def test_a_header_that_lies_about_its_size_is_told(tmp_path: Path) -> None:
    """A few bytes claim to be 24 TB: refused by their header, before anything is allocated."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)})
    (tmp_path / "huge.npy").write_bytes(header.getvalue() + bytes(240))
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "huge.npy")


@pytest.mark.parametrize(
    "head",
    [
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600),
        b"\x89HDF\r\n\x1a\n" + bytes(90),
        b"FEA1" + bytes(90),
    ],
)
def test_relatives_that_are_not_read_are_told_apart(head: bytes, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(head)
    with assert_raises(UnreadableInput):
        flinders.read(tmp_path / "log")


# logs


def log_of(path: Path, beginning: float = 50.0) -> Log:
    """Two magnetometers that were logged with an offset of (1, 2, 3) µT removed, the second a second later."""
    truth = simulate.tumble(seed=4).samples.field[:ROWS]
    offset = np.array([1.0, 2.0, 3.0])
    stored = Stored(Calibration(np.eye(3), offset, 50.0), words="OFFSET 1, 2, 3 µT")

    def columns(late: float) -> Callable[[bool], Iterator[Samples]]:
        def blocks(logged: bool) -> Iterator[Samples]:
            field = truth - offset if logged else truth
            yield from Samples.of(field, unit="uT", time=beginning + late + np.arange(ROWS) / 50.0).blocks(100)

        return blocks

    instruments = (
        Instrument(path.name, "MAG 0", Unit.of("uT"), columns(0.0), stored),
        Instrument(path.name, "MAG 1", Unit.of("uT"), columns(1.0)),
    )
    return Log(path.name, "a log of tests", instruments)


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log of a format that the table of readers has for the length of a test."""
    row = Reader("test", "log of tests", (".test",), "all", starts=(b"TEST",), log=lambda file: log_of(file.path))
    rows = (row, *registry())
    monkeypatch.setattr(flinders.readers, "registry", lambda: rows)
    path = tmp_path / "flight.test"
    path.write_bytes(b"TEST")
    return path


def test_of_several_magnetometers_the_first_is_read_and_names_the_others(flight: Path) -> None:
    first = flinders.open_recording(flight)
    assert_sentences(str(first))
    assert_sentences(str(flinders.open_recording(flight, sensor="mag 1")))
    with assert_raises(UsageError):
        flinders.open_recording(flight, sensor="3")


def test_one_option_says_which_magnetometer(flight: Path) -> None:
    assert_sentences(str(flinders.open_recording(flight, topic="MAG 1")))
    with assert_raises(UsageError):
        flinders.open_recording(flight, topic="MAG 1", sensor="2")


def note(seen: list[tuple[int, int | None]], done: int, total: int | None) -> None:
    seen.append((done, total))


def test_progress_goes_to_the_end(tmp_path: Path, tumble: Floats) -> None:
    for name in ("npz", "parquet", "arrow", "text"):
        seen: list[tuple[int, int | None]] = []
        path = written(name, tmp_path, tumble)
        flinders.read(path, progress=partial(note, seen))
        assert seen[-1] == (path.stat().st_size, path.stat().st_size), name
        assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_what_the_vehicle_had_corrected_is_taken_off_unless_it_is_to_stay(flight: Path) -> None:
    truth = simulate.tumble(seed=4).samples.field[:ROWS]
    np.testing.assert_array_equal(flinders.read(flight).field, truth)
    np.testing.assert_array_equal(flinders.read(flight, as_logged=True).field, truth - [1.0, 2.0, 3.0])
    turned = flinders.read(flight, axes="x,-y,-z")
    np.testing.assert_array_equal(turned.field, truth * [1.0, -1.0, -1.0])


def test_the_beginning_of_a_log_is_the_same_for_all_its_magnetometers(flight: Path) -> None:
    """The second starts a second later: of the first two seconds it has one."""
    assert len(flinders.read(flight, sensor="1", end=2.0)) == 101
    assert len(flinders.read(flight, sensor="2", end=2.0)) == 51


@pytest.mark.parametrize("option", ["columns", "unit", "scale"])
def test_a_log_knows_its_columns_and_units(option: str, flight: Path) -> None:
    value: Any = 0.1 if option == "scale" else "1,2,3" if option == "columns" else "uT"
    with assert_raises(UsageError):
        flinders.open_recording(flight, **{option: value})


def test_a_table_has_one_magnetometer(tmp_path: Path, tumble: Floats) -> None:
    path = written("npz", tmp_path, tumble)
    with assert_raises(UsageError):
        flinders.open_recording(path, sensor="2")
    with pytest.raises(UsageError, match="as_logged="):
        flinders.open_recording(path, as_logged=True)
    (alone,) = flinders.open_log(path).instruments
    np.testing.assert_allclose(next(alone.blocks()).field, tumble[:, 1:4] / 10.0, rtol=1e-15)
    assert isinstance(flinders.open_recording(path), TableRecording)


def test_all_magnetometers_are_calibrated_in_one_run(flight: Path, tmp_path: Path) -> None:
    ended = CliRunner().invoke(
        main, ["calibrate", str(flight), "--sensor", "all", "-o", str(tmp_path / "mag-{sensor}.json"), "--json"]
    )
    rows = json.loads(ended.stdout)["sensors"]
    assert [row["sensor"] for row in rows] == ["MAG 0", "MAG 1"]
    for number, row in enumerate(rows, 1):
        saved = flinders.Calibration.load(tmp_path / f"mag-{number}.json")
        np.testing.assert_allclose(saved.offset, row["calibration"]["offset"])
        assert saved.sensor == row["sensor"]
    assert ended.exit_code == max(0 if row["verdict"] == "good" else 3 for row in rows)


@pytest.mark.parametrize(
    "words",
    [
        "--sensor 7",
        "--sensor all -o -",
        "--sensor all --report-text page.txt",
        "--from 3 --to 2",
        "--from -1",
        "--unit mG",
    ],
)
def test_what_a_log_cannot_do_is_said(words: str, flight: Path) -> None:
    ended = CliRunner().invoke(main, ["calibrate", str(flight), *words.split()])
    assert ended.exit_code == 2, ended.output
    assert_sentences(ended.stderr)


def test_the_name_of_the_magnetometer_is_kept(flight: Path, tmp_path: Path) -> None:
    output = tmp_path / "calibration.json"
    ended = CliRunner().invoke(main, ["calibrate", str(flight), "--sensor", "2", "-o", str(output)])
    assert ended.exit_code in {0, 3}, ended.output
    assert flinders.Calibration.load(output).sensor == "MAG 1"
    checked = CliRunner().invoke(main, ["check", str(output), str(flight), "--sensor", "2"])
    assert "CANNOT TELL" in checked.output


# documentation


def test_extras_are_those_that_can_be_installed() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    section = text[text.index("[project.optional-dependencies]") :]
    assert all(f"\n{reader.extra} = [" in section for reader in registry() if reader.extra)


def test_real_arrays(recordings: Callable[[str], Path]) -> None:
    """Readings as the description of the data set counts them, 1,890 to 2,706; the first is 0, 0, 0."""
    path = recordings("leiria_robot/V_300_path1_MPU9150.npz")
    with np.load(path) as arrays:
        samples = flinders.read(path, unit="uT")
        is_usable = np.isfinite(arrays["mag"]).all(axis=1) & arrays["mag"].any(axis=1)
        np.testing.assert_array_equal(samples.field, arrays["mag"][is_usable])
        assert_sentences(map(str, samples.skipped))
        assert samples.acceleration is not None


def test_errors_stay_errors_of_flinders(tmp_path: Path) -> None:
    (tmp_path / "empty.npy").write_bytes(b"\x93NUMPY")
    with assert_raises(FlindersError, "unreadable"):
        flinders.read(tmp_path / "empty.npy")
    assert os.listdir(tmp_path) == ["empty.npy"]  # noqa: PTH208 - nothing was left behind


# two columns


def two_columns(folder: Path, *, header: str = "", third: bool = False) -> tuple[Path, Floats]:
    """A level turn of 72 points with hard iron of 10 and −5."""
    angle = np.radians(np.arange(0, 360, 5))
    turn = np.stack([30 * np.cos(angle) + 10, 30 * np.sin(angle) - 5], axis=1)
    shown = np.column_stack([np.full(len(turn), 7.0), turn]) if third else turn
    path = folder / "turn.csv"
    path.write_text(header + "".join(",".join(f"{value:.4f}" for value in row) + "\n" for row in shown))
    return path, turn


@pytest.mark.parametrize("command", ["calibrate", "info"])
def test_two_columns_are_no_magnetometer_of_three_axes(command: str, tmp_path: Path) -> None:
    path, _ = two_columns(tmp_path)
    assert CliRunner().invoke(main, [command, str(path)]).exit_code == 5
    assert CliRunner().invoke(main, [command, str(path), "--columns", "1,2"]).exit_code in {2, 5}
