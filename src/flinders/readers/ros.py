"""ROS recordings, read with rosbags: bags of ROS 1 (``.bag``), folders and databases of ROS 2 (``.db3``), MCAP.

Each topic of ``sensor_msgs/MagneticField`` is a magnetometer, in **tesla** (REP-103 wants SI units; some drivers write
gauss or microtesla all the same, which the length of the readings shows, and a unit that is given is believed). Axes
that a sensor does not have are NaN: such rows are left out and counted. A ``geometry_msgs/Vector3Stamped`` on a topic
that names a magnetometer is one too: old drivers wrote it, and it has no unit, so that readings stay in counts unless
one is given.

Beside a reading stand acceleration and rate of the ``sensor_msgs/Imu`` in the same frame, and the temperature of a
``sensor_msgs/Temperature`` in it. Nothing is turned: axes are those of the frame that the messages name. A body in ROS
is forward, left, up (REP-103), which ``--axes x,-y,-z`` makes forward, right, down. Acceleration is specific force
there as here: at rest it is +g along the axis that points up, and so −g along a z that points down.

Times are those of the messages' headers, in seconds since the first reading, or since the clock began where that is
not 1970; where a header has none, the time of recording.

Types are those that the recording defines (ROS 1, MCAP), else those of ROS 2 Humble. What is packed is unpacked up to
`MOST_PIECE` bytes at a time.

Sources: ``sensor_msgs/msg/*.msg``, REP-103 and REP-145; rosbags for the containers.
"""

from __future__ import annotations

import bz2
import os
import re
from array import array
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import BLOCK, Samples
from flinders.core.units import COUNTS, Unit
from flinders.errors import FlindersError, UnreadableInput, counted
from flinders.readers._columns import LONG
from flinders.readers._extras import needs, reading
from flinders.readers._log import Instrument, Log, Position
from flinders.readers._reader import Reader
from flinders.readers._resample import TimeSeries, numbered, resampled
from flinders.readers._source import MOST_MEMBER, MOST_PIECE, metered, unpacked_piece
from flinders.readers._tokenizer import shown
from flinders.readers._unindexed import BAG, KIND, MCAP, REPAIRS, SQLITE, beginning_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.readers._source import File

TESLA: Final = Unit.of("T")
ZSTD: Final = b"\x28\xb5\x2f\xfd"
METADATA: Final = "metadata.yaml"
MOST_METADATA: Final = 16 << 20
DISTRIBUTION: Final = "Humble"
"""Whose types are taken for ROS 2 messages that come without a definition."""

FIELD, VECTOR = "sensor_msgs/msg/MagneticField", "geometry_msgs/msg/Vector3Stamped"
IMU, TEMPERATURE, PLACE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature", "sensor_msgs/msg/NavSatFix"
NAMES_MAGNETOMETER: Final = re.compile(r"(?:^|[/_])(?:mag|compass)", re.IGNORECASE)
"""What the topic of a vector needs in its name, so that it is taken for a magnetometer."""
IDENTIFIER: Final = re.compile(r"[A-Za-z]\w*", re.ASCII)
"""What types and fields are called in ROS."""
LEAST_FIX: Final = 0
"""``NavSatStatus.STATUS_FIX``."""


def is_bag_folder(path: Path) -> bool:
    """Tell whether a folder is a recording of ROS 2."""
    return os.path.isfile(path / METADATA)  # noqa: PTH113 - False where it may not be looked at, where pathlib raises


def open_ros(file: File, *, unit: str | None = None) -> Log:
    """Open a recording of ROS 1 or ROS 2.

    Parameters
    ----------
    file : File
        On the disk, and not packed; or a folder with a ``metadata.yaml``.
    unit : str, optional
        What vectors are in, whose message does not say, or what a driver writes in place of tesla: ``G``, ``uT`` …

    Returns
    -------
    Log
        Without instruments where it holds no magnetometer.

    Raises
    ------
    MissingExtra
        Where rosbags is not installed.
    UnreadableInput
        For what is no such recording, or broken.
    UnitError
        For a unit that is not known.
    """
    needs("rosbags.highlevel", "ros", KIND)
    given, expected = None if unit is None else Unit.of(unit), None
    with reading(file.name, KIND):
        try:
            with _bag(file) as bag:
                expected = bag.reader.message_count
                topics = _topics(file.name, bag)
                _count(file, topics, bag)
        except FlindersError:
            raise
        except Exception as error:  # noqa: BLE001 - of rosbags, and on a broken file that is anything
            bag = _beginning(file, error, expected)
            topics = _topics(file.name, bag)
        title = "ROS 1 bag" if bag.is_first else "MCAP recording" if bag.is_mcap else "ROS 2 recording"
    begun = min((int(topic.stamps[0]) for topic in topics if topic.is_magnetometer), default=0)
    since = begun if 1e-9 * begun > LONG else 0
    return Log(
        file.name,
        title,
        tuple(_instruments(file.name, topics, since, given)),
        position=_position(topics),
        begun=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=since // 1000) if since else None,
        notes=tuple(_about(file, bag)),
        damage=(bag.damage,) if bag.damage else (),
    )


# the container


@dataclass(frozen=True, slots=True, eq=False)
class _Bag:
    """An opened recording: its connections that are wanted, and how their messages are decoded."""

    reader: Any
    connections: Sequence[Any]
    decode: Callable[[bytes, str], Any]
    is_first: bool
    is_mcap: bool
    is_undefined: bool
    damage: str = ""
    """What is broken about it; its messages then may be, too."""


@contextmanager
def _bag(file: File) -> Iterator[_Bag]:
    """Open a recording as what it is, whatever its name ends in."""
    head = b"" if file.path.is_dir() else file.head()
    with ExitStack() as stack:
        if head.startswith(BAG):
            from rosbags.rosbag1 import Reader as FirstReader

            first = stack.enter_context(FirstReader(file.path))
            for place, chunk in first.chunks.items():
                first.chunks[place] = chunk._replace(decompressor=partial(_unpacked, chunk.decompressor))
            reader: Any = first
        else:
            from rosbags.rosbag2 import Reader as SecondReader

            _bound_mcap()
            if file.path.is_dir():
                _check_folder(file)
            suffix = "" if file.path.is_dir() else ".mcap" if head.startswith(MCAP) else ".db3"
            reader = stack.enter_context(SecondReader(stack.enter_context(_named(file.path, suffix))))
            for storage in getattr(reader.storage, "storages", ()):
                if reader.compression_mode == "message":
                    storage.messages = partial(_small_messages, storage.messages)
        wanted = [one for one in reader.connections if _is_wanted(one)]
        decode, is_undefined = _decoder(wanted, is_first=head.startswith(BAG))
        yield _Bag(reader, wanted, decode, head.startswith(BAG), head.startswith(MCAP), is_undefined)


def _count(file: File, topics: Sequence[_Topic], bag: _Bag) -> None:
    """See that all messages are there that the recording says it has: rosbags may end at the damage without a word.

    Raises
    ------
    _Fewer
        Where there are.
    UnreadableInput
        In its place for a folder, of which nothing is read then.
    """
    expected, read = sum(one.msgcount for one in bag.connections), sum(len(topic.stamps) for topic in topics)
    if read >= expected:
        return
    counts = f"{read:,} of {counted(expected, 'message')} are there"
    if file.path.is_dir():
        raise UnreadableInput(f"{file.name} is damaged: {counts}; give the file in it, whose beginning can be read")
    raise _Fewer(counts)


class _Fewer(ValueError):
    """There are fewer messages than the recording says it has. Never leaves this module."""


def _beginning(file: File, error: Exception, expected: int | None) -> _Bag:
    """Take what comes before the break in a recording that rosbags refuses; the refusal where that is nothing."""
    if file.path.is_dir():
        raise error
    head = file.head()
    part = beginning_of(file.name, file.path, head, expected)
    wanted = [one for one in part.connections if _is_wanted(one)] if part else []
    if part is None or not any(one.msgtype in (FIELD, VECTOR) for one in wanted):
        if head.startswith(SQLITE) and isinstance(error.__cause__ or error, (needs("apsw", "ros", KIND).Error, _Fewer)):
            advice = _unfinished(file.path) or f"copy it again, or try {REPAIRS[SQLITE].format(shown(file.path.name))}"
            raise UnreadableInput(f"{file.name} is a broken database, out of which no reading can be taken: {advice}")
        raise error
    decode, is_undefined = _decoder(wanted, is_first=head.startswith(BAG))
    return _Bag(part, wanted, decode, head.startswith(BAG), head.startswith(MCAP), is_undefined, part.damage)


def _unfinished(path: Path) -> str:
    """Tell what lies beside a database that was not closed, and what to do; empty where nothing does."""
    log = path.with_name(f"{path.name}-wal")
    if not log.is_file() or not log.stat().st_size:
        return ""
    return (
        f"{log.name} holds messages that are not yet in it: copy both, and run "
        f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
    )


def _about(file: File, bag: _Bag) -> Iterator[str]:
    """What to know about the recording."""
    if bag.damage:
        yield bag.damage
    for path in file.path.glob("*.db3") if file.path.is_dir() else [file.path]:
        if unfinished := _unfinished(path):
            yield unfinished
    if bag.is_undefined:
        yield f"messages are read as those of ROS 2 {DISTRIBUTION}: it defines none"


def _is_wanted(connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
    """Tell whether a topic is one of those that are read."""
    if connection.msgtype == VECTOR:
        return NAMES_MAGNETOMETER.search(connection.topic) is not None
    return connection.msgtype in (FIELD, IMU, TEMPERATURE, PLACE)


def _decoder(connections: Sequence[Any], *, is_first: bool) -> tuple[Callable[[bytes, str], Any], bool]:
    """How messages are decoded, by the recording's own types where it has them; and whether one has none."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    bare = [one for one in connections if one.msgdef.format == MessageDefinitionFormat.NONE]
    types = dict(get_typestore(Stores.ROS2_HUMBLE).fielddefs) if bare else {}
    for one in connections:
        if one.msgdef.format == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(one.msgdef.data, one.msgtype))
        elif one.msgdef.format == MessageDefinitionFormat.IDL:
            for part in re.split(r"^=+\nIDL: .*\n", one.msgdef.data, flags=re.MULTILINE):
                types.update(get_types_from_idl(part) if part.strip() else {})
    store = get_typestore(Stores.EMPTY)
    store.register(_plain(types))
    return (store.deserialize_ros1 if is_first else store.deserialize_cdr), bool(bare)


def _plain(types: dict[str, Any]) -> dict[str, Any]:
    """Types without their constants, and with names that are nothing but names: rosbags makes a program of them."""
    for name, (_, fields) in types.items():
        for part in (*name.split("/"), *(label for label, _ in fields)):
            if not IDENTIFIER.fullmatch(part):
                raise ValueError(f"{shown(part)!r} is no name of a type or of a field")
    return {name: ([], fields) for name, (_, fields) in types.items()}


@contextmanager
def _named(path: Path, suffix: str) -> Iterator[Path]:
    """The path, or a link to it that ends as rosbags wants it, and holds nothing that means more in a URI."""
    if not suffix or (path.suffix == suffix and not set("?#%") & set(str(path))):
        yield path
        return
    with TemporaryDirectory(prefix="flinders-") as folder:
        link = Path(folder) / f"recording{suffix}"
        link.symlink_to(path.absolute())
        yield link


def _check_folder(file: File) -> None:
    """Refuse a folder whose description is too long to be one, or whose packed files unpack to too much."""
    if (file.path / METADATA).stat().st_size > MOST_METADATA:
        raise UnreadableInput(f"the {METADATA} of {file.name} has more than {MOST_METADATA >> 20} MB: no ROS wrote it")
    for packed in file.path.glob("*.zstd"):
        with _zstd().open(packed, "rb") as stream:
            chunks, size = iter(partial(stream.read, 1 << 20), b""), packed.stat().st_size
            for _ in metered(packed.name, chunks, partial(int, size), most=MOST_MEMBER, ratio=False):
                pass


def _unpacked(unpack: Callable[[bytes], bytes], packed: bytes) -> bytes:
    """Unpack a chunk of a ROS 1 bag, up to `MOST_PIECE` bytes; `unpack` is rosbags' own, and has no bound."""
    if packed.startswith(b"BZh"):
        return unpacked_piece(bz2.BZ2Decompressor(), packed)
    if packed.startswith(b"\x04\x22\x4d\x18"):
        return unpacked_piece(needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor(), packed)
    return unpack(packed)


def _bound_mcap() -> None:
    """Have rosbags unpack chunks of MCAP up to `MOST_PIECE` bytes; what is sound unpacks as before."""
    unpackers = {"lz4": needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor, "zstd": _zstd().ZstdDecompressor}
    known = needs("rosbags.rosbag2.storage_mcap", "ros", KIND).DECOMPRESSORS
    for name, unpacker in unpackers.items():
        known[name] = partial(_chunk, unpacker)


def _chunk(unpacker: Callable[[], Any], packed: bytes, _: int) -> bytes:
    """Unpack a chunk of MCAP, as rosbags asks for it."""
    return unpacked_piece(unpacker(), packed)


def _zstd() -> Any:  # noqa: ANN401
    """The module by which rosbags unpacks zstd: Python's own or its backport."""
    return needs("rosbags.rosbag2.storage_mcap", "ros", KIND).zstd


def _small_messages(messages: Callable[..., Iterator[Any]], *asked: object) -> Iterator[Any]:
    """Let through packed messages that say how long they are, unpacked, and are not too long."""
    for connection, stamp, packed in messages(*asked):
        length = _zstd().get_frame_info(packed).decompressed_size
        if length is None or length > MOST_PIECE:
            raise UnreadableInput("a packed message of the recording does not say how long it is, or is too long")
        yield connection, stamp, packed


# the messages


@dataclass(slots=True, eq=False)
class _Topic:
    """What one topic holds.

    Attributes
    ----------
    name, kind : str
    frame : str
        Of its first message.
    stamps : (N,) int, ns
    values : (N, k) float, flat
    unstamped : int
        Messages whose header has no time.
    broken : int
        Messages that cannot be decoded.
    """

    name: str
    kind: str
    frame: str = ""
    stamps: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    unstamped: int = 0
    broken: int = 0

    @property
    def is_magnetometer(self) -> bool:
        """Its messages are readings of a magnetometer."""
        return self.kind in (FIELD, VECTOR)

    def add(self, recorded: int, message: Any) -> None:  # noqa: ANN401
        """Take a message in; `recorded` is when it was written, in ns."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        numbers, frame = _NUMBERS[self.kind](message), str(message.header.frame_id).strip("/")
        self.stamps.append(stamp or recorded)
        self.values.extend(numbers)
        if not stamp:
            self.unstamped += 1
        if len(self.stamps) == 1:
            self.frame = frame

    def seconds(self, since: int) -> Floats:
        """(N,) s from a stamp on."""
        return (np.asarray(self.stamps, np.int64) - since) * 1e-9

    @property
    def table(self) -> Floats:
        """(N, k)."""
        return np.asarray(self.values, np.float64).reshape(len(self.stamps), -1)


def _three(vector: Any) -> tuple[float, float, float]:  # noqa: ANN401
    return vector.x, vector.y, vector.z


def _motion(message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Acceleration, then rate; a covariance that starts with −1 says that there is none of it (``Imu.msg``)."""
    none = (np.nan,) * 3
    return (
        *(none if message.linear_acceleration_covariance[0] == -1 else _three(message.linear_acceleration)),
        *(none if message.angular_velocity_covariance[0] == -1 else _three(message.angular_velocity)),
    )


_NUMBERS: Final[dict[str, Callable[[Any], tuple[float, ...]]]] = {
    FIELD: lambda message: _three(message.magnetic_field),
    VECTOR: lambda message: _three(message.vector),
    IMU: _motion,
    TEMPERATURE: lambda message: (message.temperature,),
    PLACE: lambda message: (message.latitude, message.longitude, message.altitude, message.status.status),
}
"""What is taken of a message of each kind."""


def _topics(name: str, bag: _Bag) -> list[_Topic]:
    """Read all that is wanted, magnetometers first, those with tesla before those without a unit."""
    topics: dict[tuple[str, str], _Topic] = {}
    if bag.connections:  # none given would be all
        for connection, recorded, packed in bag.reader.messages(list(bag.connections)):
            if packed[:4] == ZSTD and not bag.is_first:
                raise UnreadableInput(
                    f"messages of {name} are packed, as its {METADATA} says: give the folder it lies in"
                )
            key = connection.topic, connection.msgtype
            topic = topics.setdefault(key, _Topic(*key))
            if not bag.damage:
                topic.add(recorded, bag.decode(packed, connection.msgtype))
                continue
            try:
                with reading(name, KIND):
                    topic.add(recorded, bag.decode(packed, connection.msgtype))
            except UnreadableInput:
                topic.broken += 1
    order = (FIELD, VECTOR, IMU, TEMPERATURE, PLACE)
    read = (topic for topic in topics.values() if topic.stamps)
    return sorted(read, key=lambda topic: (order.index(topic.kind), topic.name))


# the magnetometers


@dataclass(frozen=True, slots=True, eq=False)
class _TopicReadings:
    """One magnetometer with what stands beside it; `Instrument.columns` of it is `blocks`."""

    source: str
    unit: Unit
    time: Floats
    field: Floats
    auxiliary: Mapping[str, TimeSeries | None]

    def blocks(self, _: bool) -> Iterator[Samples]:
        """Yield the readings from the first on; nothing was applied to them."""
        for start in range(0, len(self.time), BLOCK):
            rows = slice(start, start + BLOCK)
            time, more = self.time[rows], resampled(self.auxiliary, self.time[rows])
            samples = Samples.of(self.field[rows], unit=self.unit, time=time, source=self.source, **more)
            yield numbered(samples, start)


def _instruments(source: str, topics: Sequence[_Topic], since: int, given: Unit | None) -> Iterator[Instrument]:
    """Each magnetometer, with the sensors in its frame."""
    for topic in topics:
        if not topic.is_magnetometer:
            continue
        unit = given or (TESLA if topic.kind == FIELD else Unit.of(COUNTS))
        motion, warmth = _companion(topic, topics, IMU), _companion(topic, topics, TEMPERATURE)
        auxiliary: dict[str, TimeSeries | None] = {}
        if motion is not None:
            time = motion.seconds(since)
            auxiliary = {"acceleration": TimeSeries.of(time, motion.table[:, :3])}
            auxiliary["rate"] = TimeSeries.of(time, motion.table[:, 3:])
        if warmth is not None:
            auxiliary["temperature"] = TimeSeries.of(warmth.seconds(since), warmth.table)
        readings = _TopicReadings(source, unit, topic.seconds(since), topic.table, auxiliary)
        yield Instrument(
            source,
            shown(topic.name),
            unit,
            partial(_TopicReadings.blocks, readings),
            readings=int(np.isfinite(readings.field).all(axis=1).sum()),
            notes=tuple(_notes(topic, unit, motion, topics)),
        )


def _companion(topic: _Topic, topics: Sequence[_Topic], kind: str) -> _Topic | None:
    """The topic of a kind that is in the same frame; of several, the one whose name has most in common."""
    same = [other for other in topics if other.kind == kind and other.frame == topic.frame]
    return max(same, key=lambda other: _in_common(topic.name, other.name), default=None)


def _in_common(one: str, other: str) -> int:
    """Count the parts in which two names begin alike.

    >>> _in_common("/boat/imu/mag", "/boat/imu/data_raw")
    2
    """
    parts = zip(one.strip("/").split("/"), other.strip("/").split("/"), strict=False)
    return next((place for place, (a, b) in enumerate(parts) if a != b), len(one.split("/")))


def _notes(topic: _Topic, unit: Unit, motion: _Topic | None, topics: Sequence[_Topic]) -> Iterator[str]:
    """What to know about one magnetometer."""
    yield (
        f"axes are those of the frame {shown(topic.frame) or 'without a name'}; where that is forward, left, up "
        "(REP-103), --axes x,-y,-z makes it forward, right, down"
    )
    if topic.kind == VECTOR and unit.name == COUNTS:
        yield "the message (Vector3Stamped) does not say its unit: readings are in counts"
    if topic.kind == FIELD and unit != TESLA:
        yield f"the message (MagneticField) is in tesla by its definition, and is read in {unit.name} as was asked"
    elif topic.kind == FIELD and (length := _typical(topic.table)) and not 5e-6 < length < 5e-4:
        yield (
            f"readings are about {length:.2g} T long, and the earth's field is 2e-05 to 7e-05 T: the driver writes "
            "another unit (say which with --unit), or normalises"
        )
    others = sorted({shown(other.frame) for other in topics if other.kind == IMU})
    if motion is None and others:
        yield f"acceleration and rate are left out: they are in another frame ({', '.join(others)})"
    if topic.broken:
        yield f"{counted(topic.broken, 'message')} of it cannot be decoded: left out"
    if topic.unstamped:
        yield f"{topic.unstamped:,} messages have no time of their own: the time of recording is used for those"


def _typical(field: Floats) -> float:
    """The median length of finite readings; 0 where there is none."""
    finite = field[np.isfinite(field).all(axis=1)]
    with np.errstate(over="ignore"):
        return float(np.median(np.linalg.norm(finite, axis=1))) if len(finite) else 0.0


def _position(topics: Sequence[_Topic]) -> Position | None:
    """The first place with a fix."""
    for topic in topics:
        for latitude, longitude, altitude, status in topic.table.tolist() if topic.kind == PLACE else ():
            if status >= LEAST_FIX and abs(latitude) <= 90 and abs(longitude) <= 180:
                return Position(latitude, longitude, altitude if np.isfinite(altitude) else 0.0)
    return None


def _opened(file: File, *, unit: str | None = None) -> Log:
    """Open a recording of ROS; one in a folder goes by its description."""
    is_folder = file.path.name == METADATA
    return open_ros(replace(file, path=file.path.parent) if is_folder else file, unit=unit)


READERS: Final = (
    Reader(
        "ros",
        "ROS bag, MCAP",
        (".bag", ".mcap", ".db3"),
        "each topic of `MagneticField`, with the `Imu` and the `Temperature` in its frame",
        starts=(BAG, MCAP, SQLITE, b"rosbag2_bagfile_information:"),
        log=_opened,
        extra="ros",
        takes_unit=True,
    ),
)
