"""HDF5 and MATLAB 7.3: datasets as columns, and nothing that is not in the file itself or is made to fill a disk."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.errors import InputError, MissingExtra, NoMagnetometer, UnreadableInput
from flinders.readers import hdf5

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

ROWS = 20_000
"""More than two blocks."""


@pytest.fixture(scope="module")
def field() -> Floats:
    """(N, 3) µT."""
    return np.resize(simulate.tumble(seed=5).samples.field, (ROWS, 3))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "tumble.h5"


def save_matlab(path: Path, **variables: Any) -> None:
    """Write variables as MATLAB's ``save('-v7.3')`` lays them out, N by 3 as 3 by N; a dictionary is a structure."""
    with h5py.File(path, "w", userblock_size=512) as file:
        write_matlab(file, variables)
        file.create_group("#refs#")["a"] = np.zeros((1, ROWS))
        file["#subsystem#/MCOS"] = np.zeros((1, ROWS))
    with path.open("r+b") as stream:
        stream.write(
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sat Nov 21 2026 HDF5 schema 1.00 .".ljust(124)
        )
        stream.write(b"\x00\x02IM")


def write_matlab(group: h5py.Group, variables: dict[str, Any]) -> None:
    for name, value in variables.items():
        if isinstance(value, dict):
            write_matlab(group.create_group(name), value)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
        elif isinstance(value, str):
            group[name] = np.array([[ord(letter)] for letter in value], np.uint16)
            group[name].attrs["MATLAB_class"] = np.bytes_("char")
        else:
            array = np.atleast_2d(value).T if np.ndim(value) < 2 else np.asarray(value)  # a column
            group.create_dataset(name, data=array.T, chunks=True, compression="gzip")
            group[name].attrs["MATLAB_class"] = np.bytes_({"f": "double", "i": "int64"}[array.dtype.kind])


def test_groups_are_parts_of_names_and_the_group_of_the_magnetometer_makes_the_table(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["gps/time"], file["gps/lat"], file["gps/lon"] = np.zeros((3, 50))
        for name in ("vx", "vy", "vz", "hdop", "vdop", "sats"):
            file[f"gps/{name}"] = np.zeros(50)
        file["imu0/acc"], file["imu0/mag"], file["imu0/time"] = field.T, field, np.arange(ROWS) / 100.0
        file["imu0/mag"].attrs["units"] = "uT"
        file["note"] = "bench"
    samples = flinders.read(path)
    np.testing.assert_array_equal(samples.field, field)
    np.testing.assert_array_equal(samples.acceleration, field)
    np.testing.assert_array_equal(samples.time, np.arange(ROWS) / 100.0)
    assert samples.unit.name == "uT"


def test_of_groups_of_one_length_the_time_of_the_magnetometers_own_is_read(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["baro/time"], file["baro/pressure"] = np.arange(ROWS) / 7.0, np.zeros(ROWS)
        file["imu0/mag_uT"], file["imu0/time"] = field, np.arange(ROWS) / 100.0
    np.testing.assert_array_equal(flinders.read(path).time, np.arange(ROWS) / 100.0)
    assert "time in imu0.time" in str(flinders.open_recording(path))


def test_a_magnetometer_of_another_length_is_named(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["imu0/mag_uT"], file["imu0/time"] = field, np.arange(ROWS) / 100.0
        file["imu1/mag_uT"] = field[:100]
    assert_sentences(str(flinders.open_recording(path)))


@pytest.mark.parametrize("packing", [None, "gzip"])
def test_records_have_columns_by_name(path: Path, field: Floats, packing: str | None) -> None:
    kind = [
        ("t", "f8"),
        ("name", h5py.string_dtype()),
        ("mag_uT", ">f8", (3,)),
        ("imu", [("temp", "i2"), ("acc", "f4", 3)]),
    ]
    records = np.zeros(ROWS, kind)
    records["t"], records["mag_uT"], records["imu"]["temp"] = np.arange(ROWS) / 10, field, 21
    records["name"], records["imu"]["acc"] = "bench", field
    with h5py.File(path, "w") as file:
        file.create_dataset("run", data=records, compression=packing)
    samples = flinders.read(path)
    np.testing.assert_array_equal(samples.field, field)
    np.testing.assert_array_equal(samples.time, records["t"])
    np.testing.assert_array_equal(samples.acceleration, field.astype("f4"))
    assert samples.temperature is not None
    assert set(samples.temperature) == {21.0}


@pytest.mark.parametrize("unit", ["mG", np.bytes_("mG"), np.array(["mG"], dtype=object)])
@pytest.mark.parametrize("attribute", ["units", "unit"])
def test_a_unit_may_be_an_attribute(path: Path, field: Floats, attribute: str, unit: object) -> None:
    with h5py.File(path, "w") as file:
        file["mag"], file["time"] = field, np.arange(ROWS) * 10.0
        file["mag"].attrs[attribute] = unit
        file["time"].attrs["units"] = "milliseconds since 2026-11-21"
    samples = flinders.read(path)
    np.testing.assert_allclose(samples.field, field / 10, rtol=1e-15)
    assert samples.time is not None
    np.testing.assert_allclose(samples.time, np.arange(ROWS) / 100, rtol=1e-15)


def test_an_attribute_that_is_no_unit_is_not_put_into_the_name(path: Path, field: Floats) -> None:
    for value in (np.arange(3.0), "a text (of more than a unit", "x" * 5000, 7, h5py.Empty("S4")):
        with h5py.File(path, "w") as file:
            file["mag_uT"] = field
            file["mag_uT"].attrs["units"] = value
        assert_sentences(str(flinders.open_recording(path)))


@pytest.mark.parametrize("rows", [3, 4, ROWS])
def test_matlab_stores_the_transpose(path: Path, field: Floats, rows: int) -> None:
    times, values = np.arange(rows) / 50.0, field[:rows] + np.arange(3.0)
    save_matlab(path, log={"t": times, "mag_uT": values, "operator": "bench" * rows}, gain=2.0)
    recording = flinders.open_recording(path)
    assert str(recording).endswith("time in t; MATLAB 7.3")
    samples = flinders.read(path)
    np.testing.assert_array_equal(samples.field, values)
    np.testing.assert_array_equal(samples.time, times)


def test_matlab_variables_of_other_classes_are_left_out(path: Path, field: Floats) -> None:
    save_matlab(path, t=np.arange(ROWS) / 50.0, mag=field, mag_cal=field, label="x" * ROWS)
    with h5py.File(path, "r+") as file:
        file["mag_cal"].attrs["MATLAB_class"] = np.bytes_("cell")
        file["empty"] = np.array([0, 3], np.uint64)
        file["empty"].attrs["MATLAB_class"], file["empty"].attrs["MATLAB_empty"] = np.bytes_("double"), 1
    assert [each.name for each in flinders.open_log(path, unit="uT").instruments] == ["columns mag.x, mag.y, mag.z"]
    with h5py.File(path, "r+") as file:
        file["mag"].attrs["MATLAB_class"] = np.bytes_("categorical")
    with assert_raises(NoMagnetometer):
        flinders.read(path)


@pytest.mark.parametrize("block", [0, 512, 1024, 2048])
def test_a_user_block_may_come_first(path: Path, field: Floats, block: int) -> None:
    with h5py.File(path, "w", userblock_size=block) as file:
        file["mag_uT"] = field
    with path.open("r+b") as stream:
        stream.write(b"recorded on the bench\n" if block else b"")
    np.testing.assert_array_equal(flinders.read(path).field, field)


def test_what_lies_in_another_file_is_not_read(path: Path, field: Floats) -> None:
    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["mag2_uT"] = field
    (path.parent / "raw.bin").write_bytes(field.tobytes())
    layout = h5py.VirtualLayout(field.shape, "f8")
    layout[:] = h5py.VirtualSource(str(other), "mag2_uT", shape=field.shape)
    with h5py.File(path, "w") as file:
        file["mag1_uT"] = field
        file["mag2_uT"] = h5py.ExternalLink(str(other), "/mag2_uT")
        file.create_virtual_dataset("mag3_uT", layout)
        file.create_dataset("mag4_uT", field.shape, "f8", external=[(str(path.parent / "raw.bin"), 0, field.nbytes)])
    log = flinders.open_log(path)
    assert len(log.instruments) == 1
    told = str(flinders.open_recording(path))
    assert_sentences(told)


def test_links_that_go_in_circles_end(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["imu/mag_uT"] = field
        file["imu/again"], file["imu/mag1_uT"] = file["imu"], file["imu/mag_uT"]
        file["soft"], file["round"] = h5py.SoftLink("/round"), h5py.SoftLink("/soft")
    log = flinders.open_log(path)
    assert len(log.instruments) == 1
    np.testing.assert_array_equal(flinders.read(path).field, field)


def test_a_file_of_too_many_objects_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdf5, "MAX_OBJECTS", 20)
    with h5py.File(path, "w") as file:
        for number in range(21):
            file.create_group(str(number))
    with assert_raises(UnreadableInput):
        flinders.read(path)


def test_groups_are_looked_into_to_a_depth(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["/".join("abcdefg") + "/mag_uT"] = field
        file["/".join("klmnopqrstu") + "/mag_uT"] = field
    assert len(flinders.open_log(path).instruments) == 1


def never_written(file: h5py.File) -> None:
    file.create_dataset("mag", (10**9, 3), "f8", chunks=(1000, 3))


def zeros(file: h5py.File) -> None:
    file.create_dataset("mag", data=np.zeros((10**6, 3)), chunks=(10**5, 3), compression="gzip", compression_opts=9)


def one_large_chunk(file: h5py.File) -> None:
    file.create_dataset("mag", (2 * 10**6, 3), "f8", chunks=(2 * 10**6, 3), compression="gzip")


def scaled(file: h5py.File) -> None:
    file.create_dataset("mag", data=np.arange(3 * ROWS).reshape(-1, 3), scaleoffset=0)


@pytest.mark.parametrize(
    "write",
    [
        never_written,
        zeros,
        one_large_chunk,
        scaled,
    ],
)
def test_what_does_not_unpack_in_bounded_memory_is_left_out(
    path: Path, field: Floats, write: Callable[[h5py.File], None]
) -> None:
    with h5py.File(path, "w") as file:
        write(file)
    with pytest.raises(NoMagnetometer) as refused:
        flinders.read(path)
    assert_sentences(str(refused.value))
    with h5py.File(path, "r+") as file:
        file["raw/mag_uT"] = field
    np.testing.assert_array_equal(flinders.read(path).field, field)
    assert_sentences(str(flinders.open_recording(path)))


def test_a_chunk_that_unpacks_to_more_than_it_should_is_refused_before_it_does(path: Path, field: Floats) -> None:
    """Deflate grows its memory until the stream ends, whatever the chunk's size says."""
    packing = zlib.compressobj(1)
    bomb = b"".join(packing.compress(bytes(1 << 24)) for _ in range(20)) + packing.flush()
    with h5py.File(path, "w") as file:
        dataset = file.create_dataset("mag_uT", (ROWS, 3), "f8", chunks=(ROWS, 3), compression="gzip")
        dataset.id.write_direct_chunk((0, 0), bomb)
    with assert_raises(UnreadableInput):
        flinders.read(path)


def test_a_large_chunk_of_readings_is_read(path: Path) -> None:
    values = np.random.default_rng(1).normal(size=(300_000, 3))
    with h5py.File(path, "w") as file:
        file.create_dataset("mag_uT", data=values, chunks=values.shape, compression="gzip", compression_opts=1)
    np.testing.assert_array_equal(flinders.read(path).field, values)


def test_references_and_texts_are_not_columns(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["mag"] = np.array([file.ref] * 5, dtype=h5py.ref_dtype)
        file["text"] = ["a", "b"]
        file["mx"] = h5py.Empty("f8")
    with assert_raises(NoMagnetometer):
        flinders.read(path)


def test_a_file_that_is_cut_is_refused_in_a_line(path: Path, field: Floats) -> None:
    with h5py.File(path, "w") as file:
        file["mag_uT"] = field
    path.write_bytes(path.read_bytes()[:-1000])
    with assert_raises(InputError, "unreadable") as refused:
        flinders.read(path)
    assert "truncated file" in str(refused.value)
    assert not isinstance(refused.value, MissingExtra)


def test_a_file_may_be_moved_away_while_it_is_read(path: Path, field: Floats) -> None:
    """It stays open for as long as the recording is there."""
    with h5py.File(path, "w") as file:
        file["mag_uT"] = field
    recording = flinders.open_recording(path)
    path.rename(path.with_name("moved.h5"))
    for _ in range(2):
        assert sum(len(block) for block in recording.blocks()) == ROWS


def test_a_heap_of_texts_that_goes_in_circles_is_refused(path: Path, field: Floats) -> None:
    """HDF5 2.0 never comes back from an object of no size in a global heap, which holds texts of any length."""
    with h5py.File(path, "w") as file:
        file["mag"] = field
        file["mag"].attrs["units"] = "mG"
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    free = heap + 16 + 16 + 8  # behind the header and the object of the unit
    assert content[free : free + 2] == b"\0\0"
    content[free + 8 : free + 16] = bytes(8)
    path.write_bytes(content)
    with assert_raises(UnreadableInput):
        flinders.read(path)


@pytest.mark.parametrize("version", ["earliest", "latest"])
def test_a_unit_that_is_said_to_be_gigabytes_long_is_refused(path: Path, field: Floats, version: str) -> None:
    """HDF5 takes the memory before it looks at the text."""
    with h5py.File(path, "w", libver=version) as file:
        file["mag"] = field
        file["mag"].attrs["units"] = "mG"
    content = bytearray(path.read_bytes())
    length = content.index(content.index(b"GCOL").to_bytes(8, "little"), content.index(b"units\0")) - 4
    assert content[length : length + 4] == b"\2\0\0\0"
    content[length : length + 4] = b"\0\0\0\xf0"
    path.write_bytes(content)
    with assert_raises(UnreadableInput):
        flinders.read(path)
