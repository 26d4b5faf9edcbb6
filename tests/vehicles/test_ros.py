"""Recordings of ROS: a real bag, and what rosbags writes of each kind; broken ones."""

from __future__ import annotations

import re
import sys
from contextlib import suppress
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

from flinders.apps.vehicles.readers import ros
from flinders.apps.vehicles.readers.ros import READERS, open_ros
from flinders.core import files
from flinders.errors import FlindersError, MissingExtra, UnitError, UnreadableInput
from flinders.readers._source import File

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers import Instrument, Log

rosbag1 = pytest.importorskip("rosbags.rosbag1")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

Foreign: TypeAlias = Any
"""Of rosbags, which makes its types as it runs."""

BEGUN = 1_700_000_000 * 10**9
STEP = 10_000_000
"""ns from one message to the next."""
KINDS = {
    "mcap": (rosbag2.StoragePlugin.MCAP, None),
    "mcap-packed": (rosbag2.StoragePlugin.MCAP, rosbag2.CompressionMode.STORAGE),
    "sqlite": (rosbag2.StoragePlugin.SQLITE3, None),
    "sqlite-packed-messages": (rosbag2.StoragePlugin.SQLITE3, rosbag2.CompressionMode.MESSAGE),
    "sqlite-packed-file": (rosbag2.StoragePlugin.SQLITE3, rosbag2.CompressionMode.FILE),
}


class Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, store: Foreign, *, first: bool) -> None:
        self.store, self.first = store, first

    def header(self, stamp: int, frame: str) -> Foreign:
        time = self.store.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        header = self.store.types["std_msgs/msg/Header"]
        return header(0, time, frame) if self.first else header(time, frame)

    def vector(self, values: Sequence[float]) -> Foreign:
        return self.store.types["geometry_msgs/msg/Vector3"](*map(float, values))

    def make(self, kind: str, stamp: int, frame: str, values: Sequence[float], *, none: float = 0.0) -> Foreign:
        """A message of a kind in which `values` are what is measured; covariances begin with `none`."""
        header, vector, types = self.header(stamp, frame), self.vector, self.store.types
        covariance = np.array([none] + 8 * [0.0])
        match kind:
            case ros.FIELD:
                return types[kind](header, vector(values), covariance)
            case ros.VECTOR:
                return types[kind](header, vector(values))
            case ros.IMU:
                attitude = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
                turned, pulled = vector(values[3:]), vector(values[:3])
                return types[kind](header, attitude, covariance, turned, covariance, pulled, covariance)
            case ros.TEMPERATURE:
                return types[kind](header, values[0], 0.0)
            case ros.TWIST | ros.TWIST_WITH_COVARIANCE:
                twist = types["geometry_msgs/msg/Twist"](vector(values), vector((0.0, 0.0, 0.0)))
                if kind == ros.TWIST_WITH_COVARIANCE:
                    twist = types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
                return types[kind](header, twist)
            case _:
                status = types["sensor_msgs/msg/NavSatStatus"](int(values[3]), 1)
                return types[kind](header, status, *map(float, values[:3]), covariance, 0)

    def packed(self, message: Foreign) -> Foreign:
        pack = self.store.serialize_ros1 if self.first else self.store.serialize_cdr
        return pack(message, message.__msgtype__)


@cache
def messages_of_ros(version: int) -> Messages:
    """Messages of ROS 1 or 2, whose code rosbags writes and compiles at first use."""
    store = {1: typesys.Stores.ROS1_NOETIC, 2: typesys.Stores.ROS2_HUMBLE}[version]
    return Messages(typesys.get_typestore(store), first=version == 1)


Rows = list[tuple[str, str, int, Foreign]]


def rows_of(messages: Messages, count: int = 40) -> Rows:
    """What a boat records: topic, kind, time of recording, message. Every tenth reading lacks its z."""
    rows: Rows = []
    for n in range(count):
        stamp = BEGUN + n * STEP
        for topic, kind, frame, values in (
            ("/boat/mag", ros.FIELD, "imu_link", (2e-5, 1e-6 * n, np.nan if n % 10 == 9 else -4e-5)),
            ("/boat/imu", ros.IMU, "imu_link", (0.0, 0.1 * n, 9.81, 0.0, 0.0, 0.5)),
            ("/mast/imu", ros.IMU, "mast", (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)),
            ("/boat/temperature", ros.TEMPERATURE, "imu_link", (20 + 0.1 * n,)),
            ("/mast/compass_raw", ros.VECTOR, "top", (200.0, n, -400.0)),
            ("/boat/velocity", ros.VECTOR, "imu_link", (9.0, 9.0, 9.0)),
            ("/fix", ros.PLACE, "gps", (59.3 if n else 0.0, 18.1, 12.0, 0 if n else -1)),
        ):
            rows.append((topic, kind, stamp + 1000, messages.make(kind, stamp, frame, values)))
    return rows


def second(folder: Path, kind: str = "mcap", rows: Rows | None = None) -> Path:
    """Write a recording of ROS 2."""
    messages = messages_of_ros(2)
    plugin, packing = KINDS[kind]
    writer = rosbag2.Writer(folder / kind, version=9, storage_plugin=plugin)
    if packing is not None:
        writer.set_compression(packing, rosbag2.CompressionFormat.ZSTD)
    _written(writer, messages, rows_of(messages) if rows is None else rows)
    return folder / kind


def first(folder: Path, *, packed: str | bool = False, chunk: int = 1 << 20) -> Path:
    """Write a bag of ROS 1, packed as BZ2 or LZ4, with chunks of so many bytes."""
    messages = messages_of_ros(1)
    writer = rosbag1.Writer(folder / "boat.bag")
    writer.chunk_threshold = chunk
    if packed:
        writer.set_compression(writer.CompressionFormat["BZ2" if packed is True else packed])
    _written(writer, messages, rows_of(messages))
    return folder / "boat.bag"


def _written(writer: Foreign, messages: Messages, rows: Rows) -> None:
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, recorded, message in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(connections[topic], recorded, messages.packed(message))


def opened(path: Path, **more: Any) -> Log:
    return open_ros(File(path.name, path, 0 if path.is_dir() else path.stat().st_size), **more)


def only(instrument: Instrument) -> Samples:
    (block,) = instrument.columns(False)
    return block


def close(found: Floats | None, expected: object) -> None:
    npt.assert_allclose(np.asarray(found), np.asarray(expected), atol=1e-9)


def check_boat(log: Log) -> None:
    """All that `rows_of` says."""
    assert [(one.name, one.unit.name, one.readings) for one in log.instruments] == [
        ("/boat/mag", "T", 36),
        ("/mast/compass_raw", "counts", 40),
    ]
    boat, mast = log.instruments
    found, above = only(boat), only(mast)
    times = 0.01 * np.arange(40)
    kept = np.arange(40) % 10 != 9
    close(found.time, times[kept])
    npt.assert_allclose(found.field, np.column_stack([20 + 0 * times, 100 * times, -40 + 0 * times])[kept])
    assert [(one.rows, one.lines) for one in found.skipped] == [(4, (10, 20, 30, 40))]
    close(found.acceleration, np.column_stack([0 * times, 10 * times, 9.81 + 0 * times])[kept])
    close(found.rate, np.tile([0, 0, 0.5], (36, 1)))
    close(found.temperature, (20 + 10 * times)[kept])
    npt.assert_allclose(above.field[:, 0], 200)
    assert above.acceleration is None
    assert_sentences(mast.notes)
    assert_sentences(boat.notes)
    assert log.position is not None
    assert (log.position.latitude_deg, log.position.longitude_deg, log.position.altitude_m) == (59.3, 18.1, 12.0)
    assert log.start_time is not None
    assert log.start_time.timestamp() == 1_700_000_000


# what is read


@pytest.mark.parametrize(
    ("topic", "kind"),
    [("/vel", ros.TWIST), ("/mavros/global_position/raw/gps_vel", ros.TWIST),
     ("/ublox/fix_velocity", ros.TWIST_WITH_COVARIANCE)],
)  # fmt: skip
def test_velocities_of_satellites_are_north_and_east_by_the_clock_of_the_readings(
    topic: str, kind: str, tmp_path: Path
) -> None:
    messages = messages_of_ros(2)
    moved = [
        (name, one, BEGUN + n * STEP, messages.make(one, BEGUN + n * STEP, "gps", (3.0, 0.1 * n, 0.0)))
        for n in range(40)
        for name, one in ((topic, kind), ("/cmd_vel", ros.TWIST))
    ]
    log = opened(second(tmp_path, rows=[*rows_of(messages), *moved]))
    for one in log.instruments:
        assert one.velocity is not None
        close(one.velocity.time, 0.01 * np.arange(40))
        close(one.velocity.values, np.column_stack([0.1 * np.arange(40), np.full(40, 3.0)]))
    wheels = opened(second(tmp_path, "sqlite", rows=[*rows_of(messages), *moved[1::2]]))
    assert all(one.velocity is None for one in wheels.instruments)


def test_a_real_bag_of_which_half_the_rows_are_nan(recordings: Callable[[str], Path]) -> None:
    log = opened(recordings("ros1_imu_tools_bags/phidgets_imu_upside_down.bag"))
    (magnetometer,) = log.instruments
    assert (log.format, magnetometer.name, magnetometer.unit.name, magnetometer.readings) == (
        "ROS 1 bag", "/imu/mag", "T", 6974,
    )  # fmt: skip
    blocks = list(magnetometer.columns(False))
    assert sum(map(len, blocks)) == 6974
    assert sum(one.rows for block in blocks for one in block.skipped) == 13964 - 6974
    npt.assert_allclose(blocks[0].field[0], [3.636, 14.241, 34.542])
    assert blocks[0].acceleration is not None
    npt.assert_allclose(np.median(blocks[0].acceleration[:, 2]), -9.87, atol=0.02)  # upside down: its z points down


@pytest.mark.parametrize("kind", daily(KINDS, 2))
def test_folders_of_ros_2(tmp_path: Path, kind: str) -> None:
    folder = second(tmp_path, kind)
    log = opened(folder)
    assert log.format == "ROS 2 recording"
    check_boat(log)


@pytest.mark.parametrize("kind", daily(["mcap", "mcap-packed", "sqlite"]))
def test_single_files_of_ros_2_whatever_they_are_called(tmp_path: Path, kind: str) -> None:
    (file,) = (path for path in second(tmp_path, kind).iterdir() if path.suffix != ".yaml")
    check_boat(opened(file))
    check_boat(opened(file.rename(tmp_path / "50%25 of it?#1.tmp")))


@pytest.mark.parametrize("packed", daily([False, True]))
def test_bags_of_ros_1(tmp_path: Path, *, packed: bool) -> None:
    log = opened(first(tmp_path, packed=packed))
    assert (log.format, log.notes) == ("ROS 1 bag", ())
    check_boat(log)


def test_a_vector_is_in_the_unit_that_is_given(tmp_path: Path) -> None:
    folder = second(tmp_path)
    boat, mast = opened(folder, unit="mG").instruments
    assert_sentences(boat.notes)
    npt.assert_allclose(only(mast).field[0], [20, 0, -40])
    assert not any("unit" in note for note in mast.notes)
    with assert_raises(UnitError):
        opened(folder, unit="furlong")


def test_messages_without_a_stamp_have_the_time_of_recording(tmp_path: Path) -> None:
    messages = messages_of_ros(2)
    rows = [("/mag", ros.FIELD, BEGUN + n * STEP, messages.make(ros.FIELD, 0, "", (1e-5, 0.0, 4e-5))) for n in range(5)]
    (magnetometer,) = opened(second(tmp_path, rows=rows)).instruments
    close(only(magnetometer).time, 0.01 * np.arange(5))
    assert_sentences(magnetometer.notes[-1])
    assert_sentences(magnetometer.notes[0])


def test_a_clock_of_a_simulation_is_left_alone(tmp_path: Path) -> None:
    messages = messages_of_ros(2)
    rows = [("/mag", ros.FIELD, BEGUN, messages.make(ros.FIELD, 7 * 10**9, "", (1e-5, 0.0, 4e-5)))]
    log = opened(second(tmp_path, rows=rows))
    close(only(log.instruments[0]).time, [7.0])
    assert log.start_time is None


def test_an_imu_that_has_no_acceleration_says_so_by_its_covariance(tmp_path: Path) -> None:
    messages = messages_of_ros(2)
    rows: Rows = [("/mag", ros.FIELD, BEGUN, messages.make(ros.FIELD, BEGUN, "a", (1e-5, 0.0, 4e-5)))]
    rows.append(("/imu", ros.IMU, BEGUN, messages.make(ros.IMU, BEGUN, "a", (0, 0, 0, 0, 0, 0), none=-1.0)))
    found = only(opened(second(tmp_path, rows=rows)).instruments[0])
    assert (found.acceleration, found.rate) == (None, None)


def test_a_gap_in_the_acceleration_leaves_the_rate(tmp_path: Path) -> None:
    messages = messages_of_ros(2)
    rows: Rows = [("/mag", ros.FIELD, BEGUN, messages.make(ros.FIELD, BEGUN, "a", (1e-5, 0.0, 4e-5)))]
    gap = (np.nan, np.nan, np.nan, 0.0, 0.0, 0.5)
    rows.append(("/imu", ros.IMU, BEGUN, messages.make(ros.IMU, BEGUN, "a", gap)))
    samples = only(opened(second(tmp_path, rows=rows)).instruments[0])
    assert samples.rate is not None
    close(samples.rate, [[0.0, 0.0, 0.5]])


@pytest.mark.parametrize(("length", "told"), [(1.0, "readings are about 1 T long"), (4e-5, "")])
def test_a_driver_that_writes_no_tesla_is_noted(tmp_path: Path, length: float, told: str) -> None:
    messages = messages_of_ros(2)
    rows = [("/mag", ros.FIELD, BEGUN, messages.make(ros.FIELD, BEGUN, "a", (0.0, 0.0, length)))]
    (magnetometer,) = opened(second(tmp_path, rows=rows)).instruments
    assert any("normalises" in note for note in magnetometer.notes) == bool(told)
    assert told in " ".join(magnetometer.notes)


def test_a_recording_without_a_magnetometer_has_no_instruments(tmp_path: Path) -> None:
    messages = messages_of_ros(2)
    rows = [("/v", ros.VECTOR, BEGUN, messages.make(ros.VECTOR, BEGUN, "a", (1.0, 2.0, 3.0)))]
    assert opened(second(tmp_path, rows=rows)).instruments == ()


def test_ros_2_before_types_were_recorded_is_read_as_humble(tmp_path: Path) -> None:
    import sqlite3

    (file,) = second(tmp_path, "sqlite").glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("DROP TABLE schema")
        base.execute("DROP TABLE message_definitions")
    base.close()
    log = opened(file)
    assert_sentences(log.notes)
    check_boat(log)


def test_the_first_bytes_tell() -> None:
    assert all(map(READERS[0].accepts, (b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n\x01", b"SQLite format 3\x00")))
    assert not READERS[0].accepts(b"x,y,z\n1,2,3\n")


# what is not


def test_without_rosbags_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = second(tmp_path)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with assert_raises(MissingExtra):
        opened(folder)


def test_packed_messages_without_their_description_ask_for_the_folder(tmp_path: Path) -> None:
    (file,) = second(tmp_path, "sqlite-packed-messages").glob("*.db3")
    with assert_raises(UnreadableInput):
        opened(file)


@pytest.mark.parametrize("kind", ["mcap-packed", "sqlite-packed-messages", "sqlite-packed-file"])
def test_what_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    folder = second(tmp_path, kind)
    for module, name in ((files, "MAX_CHUNK_BYTES"), (ros, "MAX_CHUNK_BYTES"), (ros, "MAX_MEMBER_BYTES")):
        monkeypatch.setattr(module, name, 50)
    with assert_raises(UnreadableInput):
        opened(folder)


def test_a_bag_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = first(tmp_path, packed=True)
    monkeypatch.setattr(files, "MAX_CHUNK_BYTES", 50)
    with assert_raises(UnreadableInput):
        opened(file)


@pytest.mark.parametrize(
    "content",
    [b"#ROSBAG V2.0\n", b"#ROSBAG V1.2\nnothing", b"\x89MCAP0\r\n" + bytes(60), b"SQLite format 3\x00" + bytes(200)],
)
def test_what_only_begins_as_a_recording(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "boat.bag"
    file.write_bytes(content)
    with assert_raises(UnreadableInput):
        opened(file)


def test_names_that_a_program_would_be_made_of_are_names() -> None:
    none: list[object] = []
    assert ros.checked_types({"a/msg/B": ([("X", "string", "1")], none)}) == {"a/msg/B": ([], none)}
    for name, label in (("a/msg/B", "x; import os"), ("a/msg/__class__", "x"), ("a/msg/B", "__dict__"), ("a//B", "x")):
        with assert_raises(ValueError):
            ros.checked_types({name: ([], [(label, None)])})


def test_another_database_is_no_recording(tmp_path: Path) -> None:
    import sqlite3

    file = tmp_path / "places.db3"
    with sqlite3.connect(file) as base:
        base.execute("CREATE TABLE places (name TEXT)")
    base.close()
    with assert_raises(UnreadableInput):
        opened(file)


# broken ones


def storage(folder: Path, kind: str) -> Path:
    """One file, of any kind."""
    if kind.startswith("bag"):
        return first(folder, packed=kind.removeprefix("bag").strip("-"), chunk=4000)
    (file,) = (path for path in second(folder, kind).iterdir() if path.suffix in {".mcap", ".db3"})
    return file


REPAIR = {
    "bag": r"rosbag reindex \S+",
    "mcap": r"mcap recover \S+ -o whole\.mcap",
    "sqlite": r"sqlite3 \S+ \.recover \| sqlite3 whole\.db3",
}


@pytest.mark.parametrize("kind", daily(["bag", "bag-BZ2", "bag-LZ4", "mcap", "mcap-packed", "sqlite"], 2))
@pytest.mark.parametrize("share", [0.55, 0.95])
def test_a_recording_that_was_cut_short_is_refused_with_what_mends_it(tmp_path: Path, kind: str, share: float) -> None:
    file = storage(tmp_path, kind)
    content = file.read_bytes()
    repair = REPAIR[kind.partition("-")[0]]
    for left in (b"", bytes(len(content) - int(share * len(content)))):  # zeros, as a file system leaves them
        file.write_bytes(content[: int(share * len(content))] + left)
        with assert_raises(UnreadableInput) as caught:
            opened(file)
        assert re.search(rf"{repair}$", str(caught.value))


def test_a_bag_that_was_never_closed_is_refused(tmp_path: Path) -> None:
    """Its header knows no index: ``rosbag record`` writes it when it stops."""
    file = storage(tmp_path, "bag")
    content = bytearray(file.read_bytes())
    index = content.index(b"index_pos=") + len(b"index_pos=")
    content[index : index + 8] = bytes(8)
    file.write_bytes(content)
    with assert_raises(UnreadableInput) as caught:
        opened(file)
    assert "not indexed" in str(caught.value)


def test_a_bag_whose_chunks_share_an_index_is_refused(tmp_path: Path) -> None:
    """Else a bag of a megabyte fills the memory with what its index says again and again."""
    file = storage(tmp_path, "bag")
    content = file.read_bytes()
    place = content.index(b"chunk_count=") + len(b"chunk_count=")
    count = int.from_bytes(content[place : place + 4], "little") + 200
    last = content[content.rindex(b"chunk_pos=") - 28 :]  # with the length of its header, its op and its version
    file.write_bytes(content[:place] + count.to_bytes(4, "little") + content[place + 4 :] + 200 * last)
    with assert_raises(UnreadableInput) as caught:
        opened(file)
    assert_sentences(str(caught.value))


def test_an_mcap_whose_index_names_a_chunk_twice_is_refused() -> None:
    chunk = SimpleNamespace(chunk_start_offset=8, uncompressed_size=1)
    with assert_raises(ValueError):
        ros._refuse_packed_chunks(SimpleNamespace(chunks=[chunk, chunk]), "boat.mcap")


def test_an_mcap_whose_chunks_unpack_to_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "boat.mcap"
    path.write_bytes(bytes(1000))
    chunks = [SimpleNamespace(chunk_start_offset=place, uncompressed_size=1 << 28) for place in range(9)]
    with assert_raises(UnreadableInput):
        ros._refuse_packed_chunks(SimpleNamespace(chunks=chunks, path=path), path.name)


def test_a_folder_with_a_damaged_file_says_what_to_do(tmp_path: Path) -> None:
    file = storage(tmp_path, "mcap")
    content = bytearray(file.read_bytes())
    content[len(content) // 3 : len(content) // 3 + 4096] = bytes(4096)
    file.write_bytes(content)
    with assert_raises(UnreadableInput):
        opened(file.parent)


@pytest.mark.parametrize("kind", daily(["bag", "mcap", "mcap-packed", "sqlite"], 3))
def test_broken_recordings_end_in_an_error_of_ours_or_in_readings(tmp_path: Path, kind: str, trials: Choose) -> None:
    folder = first(tmp_path).parent if kind == "bag" else second(tmp_path, kind)
    (whole,) = (path for path in folder.iterdir() if path.suffix in {".bag", ".mcap", ".db3"})
    content, rng, read, claim = whole.read_bytes(), np.random.default_rng(6), 0, trials(24, 4)
    for trial in claim.seeds:
        broken = bytearray(content)
        if trial % 2:
            broken = broken[: rng.integers(20, len(broken))]
        else:
            for place in rng.integers(16, len(broken), rng.choice([1, 3, 20])):
                broken[place] = rng.integers(256)
        whole.write_bytes(broken)
        with suppress(FlindersError):
            for magnetometer in opened(whole).instruments:
                assert all(np.isfinite(block.field).all() for block in magnetometer.columns(False))
            read += 1
    assert read >= claim.count // 12
