"""Text recordings: what is recognised in real ones, and what comes out of written ones."""

from __future__ import annotations

import errno
import gc
import gzip
import io
import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import tracemalloc
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily, nightly

from flinders.core.joining import Joined
from flinders.core.samples import BLOCK_ROWS
from flinders.errors import AxesError, NoMagnetometer, UnitError, UnreadableInput, UsageError
from flinders.readers import TextRecording, open_recording, read, registry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from flinders.arrays import Floats

X_Y_Z = ("1", "2", "3")
MX_MY_MZ = ("mx", "my", "mz")
MAG = ("mag_x", "mag_y", "mag_z")
ADC = ("magADC_x", "magADC_y", "magADC_z")
IN_MG = ("mag_x_mG", "mag_y_mG", "mag_z_mG")
IN_G = ("mag_x_G", "mag_y_G", "mag_z_G")

REAL = [
    # file, columns, rows, unit, what stands beside
    ("aleksandrbazhin_ellipsoid/mag_out.txt", X_Y_Z, 347, "counts", ""),
    ("ckexplorer_acc_mag/acc_mag_log.csv", MX_MY_MZ, 12_000, "counts", "acceleration"),
    ("dronekit_log171_3mags/log171_MAG.csv", IN_MG, 2384, "mG", "time current"),
    ("dronekit_log171_3mags/log171_MAG2.csv", IN_MG, 2384, "mG", "time current"),
    ("dronekit_log171_3mags/log171_MAG3.csv", IN_MG, 2383, "mG", "time current"),
    ("fhoevi_ellipsoid/mag_out.txt", X_Y_Z, 1587, "counts", ""),
    ("hightower70_magcal/mag.txt", X_Y_Z, 25_599, "counts", ""),
    ("jremington_icm20948/icm_20948_cal_mag.csv", X_Y_Z, 300, "counts", ""),
    ("jremington_icm20948/icm_20948_cal_acc.csv", X_Y_Z, 300, "counts", ""),
    ("jremington_icm20948/mag3_raw.csv", X_Y_Z, 541, "counts", ""),
    ("jremington_mpu9250/mag.txt", X_Y_Z, 301, "counts", ""),
    ("jremington_mpu9250/acc.txt", X_Y_Z, 301, "counts", ""),
    ("michaelwro_fxos8700/mag-readings.txt", X_Y_Z, 324, "counts", ""),
    ("nliaudat_hmc5883l/mag_out_sample.txt", X_Y_Z, 243, "counts", ""),
    ("pichim_betaflight/20231008_apex5_mag_gyro_dedup.csv", ADC, 21_383, "counts", "rate"),
    ("pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv", ADC, 4867, "counts", "time acceleration rate"),
    ("pichim_betaflight/20231015_ctzsnooze_PR_Cal_3.csv", ADC, 16_921, "counts", "time acceleration rate"),
    ("pichim_betaflight/CalCareful_2282320.csv", ADC, 4688, "counts", "time acceleration rate"),
    ("pichim_betaflight/calTest1_198_253_-9.csv", ADC, 4486, "counts", "time acceleration rate"),
    ("pichim_betaflight/calTest1_208_249_-2.csv", ADC, 4589, "counts", "time acceleration rate"),
    ("pichim_betaflight/calTest1_215_253_0.csv", ADC, 4682, "counts", "time acceleration rate"),
    ("pichim_betaflight/calTest1_222_240_-8.csv", ADC, 4509, "counts", "time acceleration rate"),
    ("px4_pyulog_auavx21/sample_mag.csv", IN_G, 6759, "G", "time acceleration"),
    ("px4_pyulog_cubeorange/vehicle_magnetometer.csv", IN_G, 319, "G", "time"),
    ("risherlock_handheld/raw_data.csv", X_Y_Z, 612, "counts", ""),
    ("sunsided_hmc5883l/full-sphere.csv", MAG, 8190, "counts", "time acceleration temperature"),
    ("sunsided_hmc5883l/roll-and-tilt-at-45-90.csv", MAG, 2836, "counts", "time acceleration temperature"),
    ("sunsided_hmc5883l/unmoved-10min_dec8.csv", MAG, 6301, "counts", "time temperature"),
    ("timspi_imu_gnss/imu_gnss_data.csv", ("magx", "magy", "magz"), 1252, "counts", "time acceleration temperature"),
    ("tomisuarez_qmc5883l/filtered_raw_data.csv", MX_MY_MZ, 22_745, "counts", ""),
    ("tomisuarez_qmc5883l/noisy_raw_data.csv", MX_MY_MZ, 22_743, "counts", ""),
    ("uutzinger_gearvr/Officemag.txt", X_Y_Z, 16_386, "counts", ""),
    ("uutzinger_gearvr/acc_data.txt", X_Y_Z, 10_301, "counts", ""),
    ("uutzinger_gearvr/mag_data.txt", X_Y_Z, 3953, "counts", ""),
    (
        "xio_fusion/sensor_data.csv",
        ("Magnetometer X (uT)", "Magnetometer Y (uT)", "Magnetometer Z (uT)"),
        13_514,
        "uT",
        "time acceleration rate",
    ),
]


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Write text or bytes to a file."""

    def write(content: str | bytes, name: str = "recording.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def opened(path: Path, **options: object) -> TextRecording:
    recording = open_recording(path, **options)  # type: ignore[arg-type]
    assert isinstance(recording, TextRecording)
    return recording


def rewritten(path: Path, *, add: bool = False, **options: object) -> str:
    """Double every reading."""
    return "".join(opened(path, **options).corrected_lines(lambda field: 2 * field, add=add))


# What is recognised ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "columns", "rows", "unit", "beside"), REAL, ids=[row[0] for row in REAL])
def test_real_recordings_are_recognised(
    recordings: Callable[[str], Path], name: str, columns: tuple[str, ...], rows: int, unit: str, beside: str
) -> None:
    """Every text recording at hand gives its columns, all its rows, its unit and what stands beside."""
    recording = opened(recordings(name))
    samples = read(recordings(name))
    kinds = ("time", "acceleration", "rate", "temperature", "current")
    assert recording.layout.columns.field.names == columns
    assert (len(samples), recording.unit.name, samples.skipped) == (rows, unit, ())
    assert {kind for kind in kinds if getattr(samples, kind) is not None} == set(beside.split())
    if samples.time is not None:
        assert (np.diff(samples.time) >= 0).all()


@pytest.mark.parametrize(
    "name",
    [
        "pichim_betaflight/20231014_apex5_mag_gyro.txt",
        "jremington_icm20948/icm_20948_get_cal_data_OUTPUT.txt",
        "jremington_planar2d/mag2d_raw_header.csv",
    ],
)
def test_real_recordings_that_do_not_say_which_columns_are_refused(
    recordings: Callable[[str], Path], name: str
) -> None:
    """Six columns without a header are not guessed, and two are not three."""
    with assert_raises(NoMagnetometer):
        open_recording(recordings(name))


def test_columns_of_a_capture_with_sentences_above_can_be_named(recordings: Callable[[str], Path]) -> None:
    """The capture of accelerometer and magnetometer has the same readings as the file of the magnetometer."""
    both = read(recordings("jremington_icm20948/icm_20948_get_cal_data_OUTPUT.txt"), columns="4,5,6")
    alone = read(recordings("jremington_icm20948/icm_20948_cal_mag.csv"))
    npt.assert_array_equal(both.field, alone.field)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("x,y,z", (0, 1, 2)),
        ("t_s,mx,my,mz", (1, 2, 3)),
        ("z,y,x", (2, 1, 0)),
        ("time,seconds_elapsed,z,y,x", (4, 3, 2)),
        ("hx,hy,hz,ax,ay,az", (0, 1, 2)),
        ("ax,ay,az,bx,by,bz", (3, 4, 5)),
        ("magADC[0],magADC[1],magADC[2]", (0, 1, 2)),
        ("loopIteration,time (us),gyroADC[0],gyroADC[1],gyroADC[2],magADC[0],magADC[1],magADC[2]", (5, 6, 7)),
        ("ACCELEROMETER X (m/s²),MAGNETIC FIELD X (î¼t),MAGNETIC FIELD Y (î¼t),MAGNETIC FIELD Z (î¼t)", (1, 2, 3)),
        (
            '"Time (s)","Magnetic Field x (µT)","Magnetic Field y (µT)","Magnetic Field z (µT)","Absolute field (µT)"',
            (1, 2, 3),
        ),
        ("%time,field.header.seq,field.magnetic_field.x,field.magnetic_field.y,field.magnetic_field.z", (2, 3, 4)),
        ("mag_x_cal,mag_y_cal,mag_z_cal,mag_x,mag_y,mag_z", (3, 4, 5)),
        ("mag_x,mag_y,mag_z,mag_x_raw,mag_y_raw,mag_z_raw", (3, 4, 5)),
        ("mag_x_cal,mag_y_cal,mag_z_cal", (0, 1, 2)),
        ("xacc,yacc,zacc,xgyro,ygyro,zgyro,xmag,ymag,zmag", (6, 7, 8)),
        ("TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ", (2, 3, 4)),
        ("pos_x,pos_y,pos_z,compass_x,compass_y,compass_z", (3, 4, 5)),
        ("mag1,mag2,mag3", (0, 1, 2)),
    ],
)
def test_headers_in_use_are_understood(written: Callable[..., Path], header: str, cells: tuple[int, ...]) -> None:
    """Each header leads to the raw readings of the magnetometer, wherever they stand."""
    width = header.count(",") + 1
    row = ",".join(map(str, range(1, width + 1)))
    recording = opened(written(f"{header}\n{row}\n{row}\n"))
    assert recording.layout.columns.field.cells == cells


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("mx,my,mz", "counts"),
        ("mag_x_mG,mag_y_mG,mag_z_mG", "mG"),
        ("x (µT),y (µT),z (µT)", "uT"),
        ("x (\u03bcT),y (\u03bcT),z (\u03bcT)", "uT"),
        ("MAGNETIC FIELD X (IT),MAGNETIC FIELD Y (IT),MAGNETIC FIELD Z (IT)", "uT"),
        ("mx [nT],my [nT],mz [nT]", "nT"),
        ("mx_G,my_G,mz_G", "G"),
        ("mx (LSB),my (LSB),mz (LSB)", "counts"),
        ("mx (T),my (T),mz (T)", "T"),
        ("magnetic_field.x,magnetic_field.y,magnetic_field.z", "T"),
    ],
)
def test_the_unit_is_taken_from_the_header(written: Callable[..., Path], header: str, unit: str) -> None:
    """Units in names, parentheses and brackets are found, with either code point of µ and with neither."""
    assert opened(written(f"{header}\n1,2,3\n")).unit.name == unit


def test_a_unit_that_contradicts_the_header_is_refused(written: Callable[..., Path]) -> None:
    """The same unit may be repeated; another one is a mistake somewhere."""
    path = written("mag_x_mG,mag_y_mG,mag_z_mG\n1,2,3\n")
    assert opened(path, unit="milligauss").unit.name == "mG"
    with assert_raises(UnitError):
        open_recording(path, unit="uT")


def test_a_scale_turns_counts_into_microtesla(written: Callable[..., Path]) -> None:
    """0.15 µT in a count."""
    samples = read(written("100,200,-300\n"), scale=0.15)
    npt.assert_allclose(samples.field, [[15, 30, -45]])
    assert samples.unit.inside == "uT"


@pytest.mark.parametrize(
    ("header", "times", "seconds"),
    [
        ("t_s", ("10", "10.5"), (10, 10.5)),
        ("time_ms", ("1000", "1500"), (1, 1.5)),
        ("TimeUS", ("1000000", "1500000"), (1, 1.5)),
        ("time", ("0", "0.02"), (0, 0.02)),
        ("time", ("1700000000000000000", "1700000000500000000"), (0, 0.5)),
        ("time", ("1700000000000000", "1700000000500000"), (0, 0.5)),
        ("timestamp", ("1700000000000", "1700000000500"), (0, 0.5)),
        ("timestamp", ("1700000000", "1700000000.5"), (0, 0.5)),
        ("timestamp", ("4000", "14000"), (0.004, 0.014)),
        ("millis", ("20", "40"), (0.02, 0.04)),
    ],
)
def test_times_become_seconds(
    written: Callable[..., Path], header: str, times: tuple[str, str], seconds: tuple[float, float]
) -> None:
    """The name's unit counts, else size and steps; a clock that counts from 1970 starts with the recording."""
    samples = read(written(f"{header},mx,my,mz\n" + "".join(f"{time},1,2,3\n" for time in times)))
    assert samples.time is not None
    npt.assert_allclose(samples.time, seconds, atol=1e-6)


def test_what_stands_beside_is_in_the_units_of_samples(written: Callable[..., Path]) -> None:
    """Rate in rad/s, current in A, temperature in °C, acceleration as it is; all in the axes asked for."""
    samples = read(
        written("mx,my,mz,ax,ay,az,gx_dps,gy_dps,gz_dps,temp_C,curr_mA\n1,2,3,4,5,6,180,90,45,21.5,250\n"),
        axes="x,-y,-z",
    )
    npt.assert_allclose(samples.field, [[1, -2, -3]])
    assert samples.acceleration is not None
    assert samples.rate is not None
    assert samples.temperature is not None
    assert samples.current is not None
    npt.assert_allclose(samples.acceleration, [[4, -5, -6]])
    npt.assert_allclose(samples.rate, [[math.pi, -math.pi / 2, -math.pi / 4]])
    npt.assert_allclose(samples.temperature, [21.5])
    npt.assert_allclose(samples.current, [0.25])


def test_a_rate_without_a_unit_is_left_out_and_said(written: Callable[..., Path]) -> None:
    """Degrees and radians cannot be told apart, and a factor of 57 is not guessed."""
    path = written("mx,my,mz,gyro_x,gyro_y,gyro_z\n1,2,3,4,5,6\n")
    assert read(path).rate is None
    assert_sentences(opened(path).describe())


def test_motioncal_lines_are_read_as_users_send_them(written: Callable[..., Path]) -> None:
    """With and without colon, with decimals and spaces, between echoes and lines of the other kind."""
    samples = read(
        written(
            "Raw:8192,0,-8192,16,-160,0,100,200,-300\r\nUni:1,2,3,4,5,6,7,8,9\r\nCal1:0.1,0.2\r\n"
            "Raw 1,2,3,4,5,6,10.5,20,30\n12:00:01.5 -> Raw: 1, 2, 3, 4, 5, 6, 7, 8, 9\n"
        )
    )
    npt.assert_allclose(samples.field, np.array([[10, 20, -30], [1.05, 2, 3], [0.7, 0.8, 0.9]]))
    assert samples.acceleration is not None
    assert samples.rate is not None
    npt.assert_allclose(samples.acceleration[0], [1, 0, -1])
    npt.assert_allclose(samples.rate[0], np.radians([1, -10, 0]))
    assert samples.skipped == ()


@pytest.mark.parametrize(
    "content",
    [
        json.dumps([[1, 2, 3], [4, 5, 6]]),
        json.dumps([{"x": 1, "y": 2, "z": 3}, {"z": 6, "y": 5, "x": 4}], indent=2),
        '{"t": 0, "mag": [1, 2, 3]}\n{"t": 1, "mag": [4, 5, 6]}\n',
        '{"t": 0, "mag": {"x": "1", "y": "2", "z": "3"}}\n{"t": 1, "mag": {"x": 4, "y": 5, "z": 6}}\n',
        "[1, 2, 3]\n[4, 5, 6]\n",
        "[0.0, 1, 2, 3]\n[0.1, 4, 5, 6]\n",
    ],
)
def test_json_of_several_shapes_is_read(written: Callable[..., Path], content: str) -> None:
    """A list of triples or objects, or one of them a line."""
    npt.assert_array_equal(read(written(content, "mag.json")).field, [[1, 2, 3], [4, 5, 6]])


def test_the_description_says_what_was_recognised(written: Callable[..., Path]) -> None:
    """One line: file, columns, unit, time, how it is written."""
    path = written("t_s;mag_x_mG;mag_y_mG;mag_z_mG\n0,1;1,5;2;3\n0,2;1,5;2;3\n", "tumble.csv")
    assert_sentences(str(opened(path)))


# How it is read ------------------------------------------------------------------------------------------------------


def test_blocks_are_bounded_and_come_again(written: Callable[..., Path]) -> None:
    """Twice the same blocks, none longer than `BLOCK_ROWS`, with what was skipped in each."""
    rows = [f"{row},{row + 1},{row + 2}" for row in range(3 * BLOCK_ROWS)]
    rows[5], rows[BLOCK_ROWS + 7] = "nan,1,2", "what?"
    recording = opened(written("\n".join(rows)))
    first, second = list(recording.blocks()), list(recording.blocks())
    assert [len(block) for block in first] == [BLOCK_ROWS - 1, BLOCK_ROWS - 1, BLOCK_ROWS]
    npt.assert_array_equal(
        np.concatenate([block.field for block in first]), np.concatenate([block.field for block in second])
    )
    assert_sentences([str(entry) for block in first for entry in block.skipped])
    assert [entry.reason for entry in recording.skipped] == ["not finite", "unreadable"]


def test_a_long_file_takes_no_more_memory_than_a_short_one(written: Callable[..., Path]) -> None:
    """Peak memory stays below a few blocks on a file of 12 MB."""
    recording = opened(written("10.25,-20.5,30.75\n" * 700_000))
    next(iter(recording.blocks()))  # pyarrow imports pandas where that is installed
    tracemalloc.start()
    rows = sum(len(block) for block in recording.blocks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rows == 700_000
    assert peak < 12_000_000


def test_a_line_without_end_takes_bounded_memory(written: Callable[..., Path]) -> None:
    """Ten megabytes without a line end are cut, counted as one line, and do not lose the readings around."""
    path = written(b"1,2,3\n" * 5 + b"x" * 10_000_000 + b"\n4,5,6\n")
    tracemalloc.start()
    samples = read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(samples) == 6
    assert samples.skipped[0].lines == (6,)
    assert len(samples.skipped[0].example) == 60
    assert peak < 40_000_000


def test_progress_is_called_once_a_block(written: Callable[..., Path]) -> None:
    """With bytes done and bytes there are; at the end they are equal."""
    calls: list[tuple[int, int | None]] = []
    path = written("1,2,3\n" * (2 * BLOCK_ROWS + 1))
    recording = opened(path, progress=lambda done, total: calls.append((done, total)))
    assert calls == []
    blocks = len(list(recording.blocks()))
    assert len(calls) == blocks
    assert calls[-1] == (path.stat().st_size, path.stat().st_size)


def test_standard_input_is_read_again_and_its_copy_goes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A pipe is copied to a temporary file, which lives as long as the recording."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"1,2,3\n4,5,6\n")))
    recording = open_recording("-")
    assert recording.source == "standard input"
    assert len(list(tmp_path.iterdir())) == 1
    assert [sum(map(len, recording.blocks())) for _ in range(2)] == [2, 2]
    del recording
    gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_a_temporary_folder_that_cannot_be_used_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It is not the output that cannot be written."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"1,2,3\n4,5,6\n")))
    with assert_raises(UnreadableInput):
        open_recording("-")


def test_a_full_disk_is_not_the_fault_of_the_recording(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The folder is named, and nothing stays in it."""

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"1,2,3\n4,5,6\n")))
    monkeypatch.setattr("flinders.readers._source._copy", full)
    with assert_raises(UnreadableInput) as caught:
        open_recording("-")
    assert tmp_path.name in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_with_a_name_is_read(tmp_path: Path) -> None:
    """What cannot be read twice is copied first, whatever it is called."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(b"1,2,3\n4,5,6\n",), daemon=True)
    writer.start()
    samples = read(pipe)
    writer.join()
    assert len(samples) == 2


def test_several_recordings_are_joined(written: Callable[..., Path]) -> None:
    """In the order given; columns that not all have are left out."""
    one = written("mx_uT,my_uT,mz_uT,temp_C\n1,2,3,20\nbad\n4,5,6,20\n", "one.csv")
    two = written("mx_uT,my_uT,mz_uT\n7,8,9\n", "two.csv")
    assert isinstance(open_recording([one, two]), Joined)
    samples = read([one, two])
    npt.assert_array_equal(samples.field[:, 0], [1, 4, 7])
    assert (samples.source, samples.temperature) == ("one.csv + two.csv", None)
    assert samples.skipped[0].rows == 1


def test_recordings_in_unlike_units_are_not_joined(written: Callable[..., Path]) -> None:
    """The error names both."""
    one, two = written("mx_uT,my_uT,mz_uT\n1,2,3\n", "one.csv"), written("mx_G,my_G,mz_G\n1,2,3\n", "two.csv")
    with assert_raises(UnitError):
        open_recording([one, two])


def test_options_that_cannot_be_used_are_refused(written: Callable[..., Path]) -> None:
    """Each with what there is."""
    path = written("t,mx,my,mz\n0,1,2,3\n1,4,5,6\n")
    with assert_raises(UsageError):
        open_recording(path, columns="mx,my,foo")
    with assert_raises(UsageError):
        open_recording(path, columns="2,3,5")
    with assert_raises(UsageError):
        open_recording(path, columns="mx,my")
    with assert_raises(UsageError):
        open_recording(path, columns="mx,2,my")
    with assert_raises(UsageError):
        open_recording([])
    with pytest.raises(AxesError):
        open_recording(path, axes="x,y")


def test_columns_are_found_by_name_and_number(written: Callable[..., Path]) -> None:
    """Whatever the case, and mixed."""
    path = written("t,A,B,C\n0,1,2,3\n1,4,5,6\n")
    npt.assert_array_equal(read(path, columns="c,B,2").field, [[3, 2, 1], [6, 5, 4]])


def test_a_file_that_is_gone_or_forbidden_is_refused_while_reading(
    written: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No error of the operating system gets out."""
    path = written("1,2,3\n" * 9_000)
    recording = open_recording(path)

    def forbid(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr("flinders.readers._source.UpTo", forbid)
        with pytest.raises(UnreadableInput, match="ask for permission"):
            open_recording(path)
    path.unlink()
    with pytest.raises(UnreadableInput, match="does not exist"):
        list(recording.blocks())


def test_a_short_recording_is_read_when_it_is_opened(written: Callable[..., Path]) -> None:
    """And held in memory, but for other columns."""
    path = written("mx,my,mz,ax,ay,az\n1,2,3,4,5,6\n3,2,1,6,5,4\n")
    recording, other = open_recording(path), opened(path)
    other.name_acceleration("az,ay,ax")
    path.unlink()
    npt.assert_array_equal([block.field for block in recording.blocks()], [[[1, 2, 3], [3, 2, 1]]])
    with assert_raises(UnreadableInput):
        list(other.blocks())


def test_a_gzip_file_cut_short_gives_what_is_before_the_cut(written: Callable[..., Path]) -> None:
    """Every whole line is read and corrected; the cut is counted as one line that cannot be read."""
    lines = [f"{i},{i * i % 97},{i * 7 % 89}\n" for i in range(1, 50_001)]
    whole = gzip.compress("".join(lines).encode())
    for cut in (len(whole) // 3, len(whole) - 30, len(whole) - 8):
        recording = opened(written(whole[:cut], "cut.gz"))
        field = np.concatenate([block.field for block in recording.blocks()])
        assert len(field) > 10_000
        npt.assert_array_equal(field, np.loadtxt(lines[: len(field)], delimiter=","))
        expected = [("unreadable", 1, (len(field) + 1,), "gzip ends early")]
        assert [(entry.reason, entry.rows, entry.lines, entry.example) for entry in recording.skipped] == expected
        assert "".join(recording.corrected_lines(lambda field: field)) == "".join(lines[: len(field)])


def test_broken_gzip_data_are_refused(written: Callable[..., Path]) -> None:
    """Wrong in the middle: what comes before may be wrong as well."""
    broken = bytearray(gzip.compress("".join(f"{i},{i * i % 97},{i * 7 % 89}\n" for i in range(5000)).encode()))
    broken[len(broken) // 2] ^= 0xFF
    with assert_raises(UnreadableInput):
        read(written(bytes(broken), "broken.gz"))


def test_bytes_that_are_no_text_cost_only_cells_that_are_read(written: Callable[..., Path]) -> None:
    """UTF-8 that turns invalid after the part that was looked at: in a note it does no harm, in a reading it does."""
    good = b"1,2,3,ok\n" * 8000
    samples = read(written(b"mx,my,mz,note\n" + good + b"4,5,6,\xb5T\n4,\xff5,6,ok\n7,8,9,\xe2\n" + good))
    assert len(samples) == 16_002
    npt.assert_array_equal(samples.field[8000:8002], [[4, 5, 6], [7, 8, 9]])
    assert [(entry.rows, entry.lines, entry.example) for entry in samples.skipped] == [
        (1, (8003,), "4,\N{REPLACEMENT CHARACTER}5,6,ok")
    ]


@pytest.mark.parametrize(
    ("above", "unit"),
    [
        ("t,mx,my,mz\ns,nT,nT,nT\n", "nT"),
        ("t,mx,my,mz\n,(mG),(mG),(mG)\n", "mG"),
        ("# t,mx,my,mz\n# s,G,G,G\n", "G"),
        ("t,mx_uT,my_uT,mz_uT\ns,nT,nT,nT\n", "uT"),
        ("t,mx,my,mz\ns,nT,nT,\n", "counts"),
        ("t,mx,my,mz\nstart,of,the,log\n", "counts"),
    ],
)
def test_units_below_the_header_count_where_it_has_none(written: Callable[..., Path], above: str, unit: str) -> None:
    """All three must be there; nothing of the row is counted as unreadable."""
    recording = opened(written(above + "0,1,2,3\n1,4,5,6\n"))
    assert recording.unit.name == unit
    assert recording.layout.columns.field.names[0].startswith("mx")
    assert len(read(recording.file.path).skipped) == 0  # type: ignore[union-attr]


@pytest.mark.parametrize("form", ["{},{},{},,", "{};{};{};;;", "{},,{},,{}", "{} - {} - {}", "{},{},{} ;;"])
def test_three_numbers_and_cells_without_any_are_readings(written: Callable[..., Path], form: str) -> None:
    """As spreadsheets save a table that was wider once."""
    rows = [(130 + 7 * row % 90, -20 - row % 40, 300 + row % 50) for row in range(60)]
    text = "".join(f"{form.format(*row)}\n" for row in rows)
    npt.assert_array_equal(read(written(text, "saved.csv")).field, rows)


def test_units_below_the_header_hold_for_what_stands_beside(written: Callable[..., Path]) -> None:
    """Time in ms, rate in degrees."""
    samples = read(written("t,mx,my,mz,gx,gy,gz\nms,uT,uT,uT,deg/s,deg/s,deg/s\n0,1,2,3,180,0,0\n7,1,2,3,90,0,0\n"))
    assert samples.time is not None
    assert samples.rate is not None
    npt.assert_allclose(samples.time, [0, 0.007])
    npt.assert_allclose(samples.rate[:, 0], [math.pi, math.pi / 2])


def test_json_above_the_limit_is_refused(written: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole document is held in memory, so its size is bounded; JSON lines are not."""
    monkeypatch.setattr("flinders.readers.dialects.json_records.MAX_DOCUMENT_BYTES", 1 << 20)
    triples = [[-row, row, -1 - row] for row in range(50_000)]
    with assert_raises(UnreadableInput):
        open_recording(written(json.dumps(triples), "big.json"))
    assert len(read(written("\n".join(map(json.dumps, triples)), "big.jsonl"))) == 50_000


def test_every_reader_has_a_name_and_suffixes() -> None:
    """The table of formats is complete."""
    assert all(row.name and row.suffixes for row in registry())


# Streams that come once ----------------------------------------------------------------------------------------------


class Dribble(io.BufferedIOBase):
    """A pipe in which a piece arrives whenever there is nothing left of the one before."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        self._pieces = iter(pieces)
        self._rest = b""

    @classmethod
    def of(cls, content: bytes, piece: int) -> Dribble:
        return cls(content[start : start + piece] for start in range(0, len(content), piece))

    def read1(self, size: int = -1, /) -> bytes:
        arrived = self._rest or next(self._pieces, b"")
        self._rest = arrived[size:]
        return arrived[:size]


@pytest.fixture
def piped(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., TextRecording]]:
    """Open standard input for one pass; nothing may be left in the temporary folder."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))

    def open_once(stream: io.BufferedIOBase, **options: str) -> TextRecording:
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=stream, closed=False))
        recording = open_recording("-", once=True, **options)  # type: ignore[arg-type]
        assert isinstance(recording, TextRecording)
        return recording

    yield open_once
    assert list(folder.iterdir()) == []


SCRIPT = """
import sys
from flinders.readers import open_recording
for lines in open_recording("-", once=True).corrected_blocks(lambda field: 2 * field):
    sys.stdout.writelines(lines)
    sys.stdout.flush()
"""


def test_readings_come_back_while_the_pipe_is_open() -> None:
    """A process that corrects standard input answers what has arrived, though the sensor is still running."""
    with subprocess.Popen([sys.executable, "-c", SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        hanging = threading.Timer(120, process.kill)  # ends the test where it would wait for ever
        hanging.start()
        process.stdin.write(b"mx,my,mz\n" + b"".join(b"%d,2,3\n" % row for row in range(50)))
        process.stdin.flush()
        answer = [process.stdout.readline() for _ in range(51)]
        assert answer == [b"mx,my,mz\n", *(b"%d,4,6\n" % (2 * row) for row in range(50))]
        for row in range(50, 60):
            process.stdin.write(b"%d,2,3\n" % row)
            process.stdin.flush()
            assert process.stdout.readline() == b"%d,4,6\n" % (2 * row)
        process.stdin.close()
        assert process.stdout.read() == b""
        hanging.cancel()


def test_no_more_is_waited_for_than_shows_the_layout(piped: Callable[..., TextRecording]) -> None:
    """Twenty lines of numbers are enough; from then on each line comes out before the next is asked for."""
    asked = 0

    def lines() -> Iterator[bytes]:
        nonlocal asked
        for text in ["a log, of 3 days\n", "t,mx,my,mz\n", *(f"{row},1,2,3\n" for row in range(30))]:
            asked += 1
            yield text.encode()

    recording = piped(Dribble(lines()))
    assert asked == 22
    blocks = recording.corrected_blocks(lambda field: field)
    assert [len(next(blocks)) for _ in range(5)] == [0, 22, 1, 1, 1]
    assert asked == 25
    assert sum(map(len, blocks)) == 7


def test_a_stream_is_gone_through_once(piped: Callable[..., TextRecording]) -> None:
    """The second pass says so, and how to have two."""
    recording = piped(io.BytesIO(b"1,2,3\n4,5,6\n"))
    assert sum(map(len, recording.blocks())) == 2
    with assert_raises(UsageError):
        list(recording.blocks())


def test_an_endless_stream_takes_bounded_memory(piped: Callable[..., TextRecording]) -> None:
    """Far less than the 8 MB that come through."""
    recording = piped(Dribble(b"10.25,-20.5,30.75\n" * 3000 for _ in range(150)))
    tracemalloc.start()
    rows = sum(map(len, recording.blocks()))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert rows == 450_000
    assert peak < 4_000_000


@pytest.mark.parametrize("name", [row[0] if place % 4 == 0 else nightly(row[0]) for place, row in enumerate(REAL)])
def test_real_recordings_are_the_same_through_a_slow_pipe(
    recordings: Callable[[str], Path],
    written: Callable[..., Path],
    piped: Callable[..., TextRecording],
    name: str,
) -> None:
    """A few lines at a time show the same columns and unit as the whole file, and give the same readings."""
    content = b"".join(recordings(name).read_bytes().splitlines(keepends=True)[:300])
    whole, stream = opened(recordings(name)), piped(Dribble.of(content, 300))
    assert stream.layout.columns.field == whole.layout.columns.field
    assert (stream.unit, stream.layout.grid) == (whole.unit, whole.layout.grid)
    path = written(content, recordings(name).name)
    npt.assert_array_equal(np.concatenate([block.field for block in stream.blocks()]), read(path).field)


@pytest.mark.parametrize("piece", daily([7, 1, 200_000, 1000], 2))
@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    "lines",
    [
        ["mx;my;mz\r\n", *(f"{row};2,5;3\r\n" for row in range(150))],
        [f"[{row}, 2, 3]\n" for row in range(150)],
        [f'{{"t":{row},"mag":{{"x":1,"y":2,"z":3}}}}\n' for row in range(150)],
        ["[", ",\n".join(f"[{row}, 2, 3]" for row in range(150)), "]"],
        [f"Raw:0,0,0,0,0,0,{row},2,3\r\n" for row in range(150)],
        ["1,2,3\n", "bad\n"],
        ["1,2,3"],
    ],
    ids=["table", "JSON lists", "JSON objects", "JSON document", "MotionCal", "short", "no end"],
)
def test_a_stream_gives_what_a_file_gives(
    written: Callable[..., Path], piped: Callable[..., TextRecording], lines: list[str], piece: int, packed: bool
) -> None:
    """However it is cut into pieces: the same corrected copy, the same lines left out."""
    content = "".join(lines).encode()
    content = gzip.compress(content) if packed else content
    stream = piped(Dribble.of(content, piece) if piece < 1000 else io.BytesIO(content))
    recording = opened(written(content))
    assert "".join(stream.corrected_lines(lambda field: field)) == "".join(recording.corrected_lines(lambda x: x))
    assert stream.skipped == recording.skipped


def test_json_lines_come_out_as_they_arrive(piped: Callable[..., TextRecording]) -> None:
    """Their table is not kept either."""
    recording = piped(Dribble(f'{{"x": {row}, "y": 2, "z": 3}}\n'.encode() for row in range(25)))
    assert [len(lines) for lines in recording.corrected_blocks(lambda field: field)] == [1, 20, 1, 1, 1, 1, 1]


def test_a_stream_cut_short_gives_what_came_before(piped: Callable[..., TextRecording]) -> None:
    """As from a file; with nothing before the cut it is refused."""
    whole = gzip.compress(b"1,2,3\n" * 20_000)
    recording = piped(Dribble.of(whole[:-8], 100))
    assert sum(map(len, recording.blocks())) == 20_000
    assert_sentences(str(recording.skipped[0]))
    short = piped(Dribble.of(gzip.compress(b"1,2,3\n4,5,6\n")[:-8], 5))
    assert len("".join(short.corrected_lines(lambda field: field)).splitlines()) == 2
    with assert_raises(UnreadableInput):
        piped(io.BytesIO(whole[:8]))


def test_streams_that_are_no_recording_are_refused(piped: Callable[..., TextRecording]) -> None:
    """At their start."""
    with assert_raises(UnreadableInput):
        piped(io.BytesIO())
    with assert_raises(UnreadableInput):
        piped(Dribble(bytes(range(256)) * 16 for _ in range(10**9)))
    with assert_raises(UnreadableInput):
        piped(Dribble(b"tick\n" for _ in range(10**9)))


def test_a_file_opened_for_one_pass_may_have_two(written: Callable[..., Path]) -> None:
    """It stays where it is."""
    recording = open_recording(written("1,2,3\n4,5,6\n"), once=True)
    assert [sum(map(len, recording.blocks())) for _ in range(2)] == [2, 2]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_with_a_name_is_read_as_a_stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a copy, and closed afterwards."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(b"1,2,3\n4,5,6\n",), daemon=True)
    writer.start()
    recording = open_recording(pipe, once=True)
    assert sum(map(len, recording.blocks())) == 2
    writer.join()


# Corrected copies ----------------------------------------------------------------------------------------------------

KEPT = [
    ("1,2,3\n4,5,6\n", "2,4,6\n8,10,12\n"),
    ("1,2,3\r\n4,5,6\r\n", "2,4,6\r\n8,10,12\r\n"),
    ("x;y;z\n1,5;2;-3\n", "x;y;z\n3;4;-6\n"),
    (
        "t,mx,my,mz,note\n0,1,2,3,ok\n# pause\n\n1,4,5,6,so so\n",
        "t,mx,my,mz,note\n0,2,4,6,ok\n# pause\n\n1,8,10,12,so so\n",
    ),
    ('"a b","mx","my","mz"\n"p,q","1","2","3"\n', '"a b","mx","my","mz"\n"p,q","2","4","6"\n'),
    ("  1   2 3\n 4\t5 6\n", "  2   4 6\n 8\t10 12\n"),
    ("Fs,50.00\nmx,my,mz\n1,2,3\n", "Fs,50.00\nmx,my,mz\n2,4,6\n"),
    ("z,y,x\n3,2,1\n", "z,y,x\n6,4,2\n"),
    ("1,2,3\nnan,5,6\nbad\n7,8,9\n", "2,4,6\nnan,nan,nan\n14,16,18\n"),
    ("1,2,3,\n4,5,6,\n", "2,4,6,\n8,10,12,\n"),
    ("t,mx,my,mz\n0,1,2,3\n,4,5,6\n2,7,8,9\n?,1,1,1\n", "t,mx,my,mz\n0,2,4,6\n,8,10,12\n2,14,16,18\n?,2,2,2\n"),
    ("t,mx,my,mz\ns,uT,uT,uT\n0,1,2,3\n", "t,mx,my,mz\ns,uT,uT,uT\n0,2,4,6\n"),
    ("1,−2,3\n", "2,-4,6\n"),
    ("[[1,2,3],[4,5,6]]", "2,4,6\n8,10,12\n"),
    (
        "Raw:8192,0,0,16,0,0,7,8,9\r\n",
        "accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT\n1,0,0,1,0,0,1.4,1.6,1.8\n",
    ),
    ("ready\nX: 1 Y: 2 Z: 3 uT\n\nX: 4 Y: 5 Z: 6 uT\n", "X (uT),Y (uT),Z (uT)\n2,4,6\n8,10,12\n"),
]


@pytest.mark.parametrize(("before", "after"), KEPT)
def test_a_corrected_copy_keeps_all_else(written: Callable[..., Path], before: str, after: str) -> None:
    """Other columns, delimiters, decimal signs, headers, comments, quotes, spaces and line ends stay."""
    assert rewritten(written(before)) == after


ADDED = [
    ("1,2,3\n", "1,2,3,2,4,6\n"),
    ("mx;my;mz\n1,5;2;3\n", "mx;my;mz;mx_cal;my_cal;mz_cal\n1,5;2;3;3;4;6\n"),
    ('"mx","my","mz"\n"1","2","3"\n', '"mx","my","mz","mx_cal","my_cal","mz_cal"\n"1","2","3","2","4","6"\n'),
    ("# mx my mz\n1 2 3\n", "# mx my mz mx_cal my_cal mz_cal\n1 2 3 2 4 6\n"),
    ("1\t2\t3\n", "1\t2\t3\t2\t4\t6\n"),
    ("mx,my,mz\n1,2,3,\n", "mx,my,mz,mx_cal,my_cal,mz_cal\n1,2,3,2,4,6\n"),
    ("mx, my, mz\n1, 2, 3\n", "mx, my, mz, mx_cal, my_cal, mz_cal\n1, 2, 3, 2, 4, 6\n"),
]


@pytest.mark.parametrize(("before", "after"), ADDED)
def test_corrected_columns_can_be_added(written: Callable[..., Path], before: str, after: str) -> None:
    """After the others, in the style of the file, with names only where it has names."""
    assert rewritten(written(before), add=True) == after


def test_a_corrected_copy_is_in_the_unit_of_the_recording(written: Callable[..., Path]) -> None:
    """The correction sees µT in the axes asked for, the file keeps mG."""
    recording = opened(written("mx_mG,my_mG,mz_mG\n100,200,300\n"), axes="y,x,-z")
    seen: list[Floats] = []

    def correct(field: Floats) -> Floats:
        seen.append(field)
        return field + 1.0

    assert "".join(recording.corrected_lines(correct)) == "mx_mG,my_mG,mz_mG\n210,110,-290\n"
    npt.assert_allclose(seen[0], [[20, 10, -30]])


def test_a_corrected_copy_of_a_real_recording_reads_back(recordings: Callable[[str], Path], tmp_path: Path) -> None:
    """All rows, all other columns, the field corrected."""
    path = recordings("timspi_imu_gnss/imu_gnss_data.csv")
    copy = tmp_path / "copy.csv"
    copy.write_text(rewritten(path), newline="")
    before, after = read(path), read(copy)
    npt.assert_allclose(after.field, 2 * before.field)
    assert before.acceleration is not None
    assert after.acceleration is not None
    npt.assert_array_equal(after.acceleration, before.acceleration)
    assert [line.split(",")[:6] for line in copy.read_text().splitlines()] == [
        line.split(",")[:6] for line in path.read_text().splitlines()
    ]
