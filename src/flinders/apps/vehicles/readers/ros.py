"""ROS recordings, read with rosbags: bags of ROS 1 (``.bag``), folders and databases of ROS 2 (``.db3``), MCAP.

Each topic of ``sensor_msgs/MagneticField`` is a magnetometer, in **tesla** (REP-103 wants SI units; some drivers write
gauss or microtesla all the same, which the length of the readings shows, and a unit that is given is believed). Axes
that a sensor does not have are NaN: such rows are left out and counted. A ``geometry_msgs/Vector3Stamped`` on a topic
that names a magnetometer is one too: old drivers wrote it, and it has no unit, so that readings stay in counts unless
one is given.

Velocity over ground is a ``geometry_msgs/TwistStamped`` or ``TwistWithCovarianceStamped`` of satellites: x east and
y north, on the topic ``vel`` or one that names GPS, GNSS or the fix: that of wheels or of a command is another.

Beside a reading stand acceleration and rate of the ``sensor_msgs/Imu`` in the same frame, and the temperature of a
``sensor_msgs/Temperature`` in it. Nothing is turned: axes are those of the frame that the messages name. A body in ROS
is forward, left, up (REP-103), which ``--axes x,-y,-z`` makes forward, right, down. Acceleration is specific force
there as here: at rest it is +g along the axis that points up, and so −g along a z that points down.

Times are those of the messages' headers, in seconds since the first reading, or since the clock began where that is
not 1970; where a header has none, the time of recording.

Only whole recordings are read: a broken one is refused with the command that may mend it. Types are those that the
recording defines (ROS 1, MCAP), else those of ROS 2 Humble. What is packed is unpacked up to `MOST_PIECE` bytes at a
time, and to no more than its file can hold.

Sources: ``sensor_msgs/msg/*.msg``, REP-103 and REP-145; rosbags for the containers; of velocities ``driver.py`` of
nmea_navsat_driver (``vel``), ``node.cpp`` of ublox (``fix_velocity``), and the topics of MAVROS (``raw/gps_vel``).
"""

from __future__ import annotations

import bz2
import re
from array import array
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.apps.vehicles.readers.ros_fields import Fields
from flinders.core.files import MOST_PIECE, metered, refuse_bomb, unpacked_piece
from flinders.core.units import COUNTS, Unit
from flinders.errors import UnreadableInput, counted
from flinders.foreign_errors import needs, reading
from flinders.readers._log import Instrument, Log, Position, first_position
from flinders.readers._reader import Reader
from flinders.readers._resample import TimeSeries, blocks, resampled
from flinders.readers._source import MOST_MEMBER
from flinders.readers._times import LONG
from flinders.readers._tokenizer import shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rosbags.interfaces import MessageDefinition
    from rosbags.typesys.store import Typestore

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers._source import File

KIND: Final = "a ROS recording"
TESLA: Final = Unit.of("T")
BAG, MCAP, SQLITE = b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\x00"
REPAIRS: Final = {
    BAG: "rosbag reindex {}",
    MCAP: "mcap recover {} -o whole.mcap",
    SQLITE: "sqlite3 {} .recover | sqlite3 whole.db3",
}
"""Commands that may mend a broken recording, by its first bytes."""
SUFFIXES: Final = {MCAP: ".mcap", SQLITE: ".db3"}
"""How rosbags wants a file to end, by its first bytes."""
ZSTD: Final = b"\x28\xb5\x2f\xfd"
METADATA: Final = "metadata.yaml"
MOST_METADATA: Final = 16 << 20
DISTRIBUTION: Final = "Humble"
"""Whose types are taken for ROS 2 messages that come without a definition."""

FIELD, VECTOR = "sensor_msgs/msg/MagneticField", "geometry_msgs/msg/Vector3Stamped"
IMU, TEMPERATURE, PLACE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature", "sensor_msgs/msg/NavSatFix"
TWIST, TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped"
NAMES_MAGNETOMETER: Final = re.compile(r"(?:^|[/_])(?:mag|compass)", re.IGNORECASE)
"""What the topic of a vector needs in its name, so that it is taken for a magnetometer."""
NAMES_SATELLITES: Final = re.compile(r"(?:^|[/_])(?:gps|gnss|navsat|fix)(?:[/_]|$)|(?:^|/)vel$", re.IGNORECASE)
"""What the topic of a velocity needs in its name, so that it is taken for one over ground by satellites."""
IDENTIFIER: Final = re.compile(r"[A-Za-z]\w*", re.ASCII)
"""What types and fields are called in ROS."""
Topics: TypeAlias = "_Topics | Fields"
"""What takes the messages that it wants."""
LEAST_FIX: Final = 0
"""``NavSatStatus.STATUS_FIX``."""


def open_ros(file: File, *, unit: str | None = None) -> Log:
    """Open a recording of ROS 1 or ROS 2.

    Raises `MissingExtra` where rosbags is not installed; `UnreadableInput` for what is no such recording, or broken;
    `UnitError` for a unit that is not known.

    Parameters
    ----------
    file : File
        On the disk, and not packed; or a folder with a ``metadata.yaml``, which may be given instead of it.
    unit : str, optional
        What vectors are in, whose message does not say, or what a driver writes in place of tesla: ``G``, ``uT`` …

    Returns
    -------
    Log
        Without instruments where it holds no magnetometer.
    """
    needs("rosbags.highlevel", "ros", KIND)
    given = None if unit is None else Unit.of(unit)
    if file.path.name == METADATA:
        file = replace(file, path=file.path.parent)
    head = b"" if file.path.is_dir() else file.head()
    topics = _Topics(file.name, is_first=head.startswith(BAG))
    start = next((start for start in REPAIRS if head.startswith(start)), None)
    _read(file, start, topics)
    ordered = topics.sorted()
    begun = min((int(topic.stamps[0]) for topic in ordered if topic.is_magnetometer), default=0)
    since = begun if 1e-9 * begun > LONG else 0
    return Log(
        file.name,
        {BAG: "ROS 1 bag", MCAP: "MCAP recording"}.get(start or b"", "ROS 2 recording"),
        tuple(
            replace(one, look_up=partial(named_series, file, start, since))
            for one in _instruments(file.name, ordered, since, given)
        ),
        position=_position(ordered),
        begun=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=since // 1000) if since else None,
        notes=tuple(_about(file, topics)),
    )


def named_series(
    file: File, start: bytes | None, since: int, names: Sequence[str]
) -> tuple[dict[str, TimeSeries], list[str]]:
    """Fields of messages by names such as ``/battery.current``, and those that their topics have."""
    fields = Fields.of(file.name, names, _undecoded(start == BAG), is_first=start == BAG)
    if fields.paths:
        _read(file, start, fields)
    return fields.series(since), fields.there


def _undecoded(is_first: bool) -> Callable[[Any], Callable[[bytes, str], Any]]:
    """How messages of a connection are decoded."""

    def decoder(connection: Any) -> Callable[[bytes, str], Any]:  # noqa: ANN401 - rosbags' types are its own
        store = _typestore(connection.msgdef, connection.msgtype)
        return store.deserialize_ros1 if is_first else store.deserialize_cdr

    return decoder


def _read(file: File, start: bytes | None, topics: Topics) -> None:
    """Read what is wanted of a recording, by its first bytes; of a folder without."""
    with reading(file.name, KIND, advice=_advice(file.path, start)):
        if start is None:
            _read_folder(file, topics)
        else:
            _read_file(file.path, start, topics)


# folders and databases


def _read_folder(file: File, topics: Topics) -> None:
    """Read a folder of ROS 2; refuse one of which messages are missing, as rosbags may end at damage without a word."""
    if (file.path / METADATA).stat().st_size > MOST_METADATA:
        raise UnreadableInput(f"the {METADATA} of {file.name} has more than {MOST_METADATA >> 20} MB: no ROS wrote it")
    for packed in file.path.glob("*.zstd"):
        with _mcap().zstd.open(packed, "rb") as stream:
            chunks, size = iter(partial(stream.read, 1 << 20), b""), packed.stat().st_size
            for _ in metered(packed.name, chunks, partial(int, size), most=MOST_MEMBER, ratio=False):
                pass
    expected, read = _read_by_rosbags(file.path, topics)
    if read < expected:
        raise UnreadableInput(
            f"{file.name} is damaged: {read:,} of {counted(expected, 'message')} are there; copy it again, or mend the "
            "file in it with mcap recover or sqlite3 .recover"
        )


def _read_file(path: Path, start: bytes, topics: Topics) -> None:
    """Read a recording in one file; raise ValueError where messages are missing."""
    with _named(path, SUFFIXES.get(start, "")) as named:
        expected, read = (_read_bag if start == BAG else _read_by_rosbags)(named, topics)
    if read < expected:
        raise ValueError(f"{read:,} of {counted(expected, 'message')} are there")


def _read_bag(path: Path, topics: Topics) -> tuple[int, int]:
    """Let rosbags read a bag of ROS 1; as `_read_by_rosbags`."""
    from rosbags.rosbag1 import Reader as FirstReader

    class BoundedReader(FirstReader):
        """Refuse an index that is longer than the file, as where chunks share one."""

        indexed = 0

        def read_index_data(self, pos: int, indexes: dict[int, list[Any]]) -> None:
            assert self.bio
            begin = self.bio.tell()
            super().read_index_data(pos, indexes)
            self.indexed += self.bio.tell() - begin
            if self.indexed > path.stat().st_size:
                raise ValueError("its index says the same several times")

    _bound_unpacking()
    with BoundedReader(path) as reader:
        return _read_messages(reader, topics)


def _read_by_rosbags(path: Path, topics: Topics) -> tuple[int, int]:
    """Let rosbags read what is wanted of a recording of ROS 2; how many messages it says it has, and how many came."""
    from rosbags.rosbag2 import Reader as SecondReader

    _bound_unpacking()
    with SecondReader(path) as reader:
        for storage in getattr(reader.storage, "storages", [reader.storage]):
            _refuse_packed_chunks(storage, topics.source)
            if reader.compression_mode == "message":
                storage.messages = partial(_small_messages, storage.messages)
        return _read_messages(reader, topics)


def _read_messages(reader: Any, topics: Topics) -> tuple[int, int]:  # noqa: ANN401 - one of two of rosbags
    wanted = [one for one in reader.connections if topics.is_wanted(one)]
    read = 0
    for connection, recorded, packed in reader.messages(wanted) if wanted else ():  # none given would be all
        if packed[:4] == ZSTD:
            raise UnreadableInput(
                f"messages of {topics.source} are packed, as its {METADATA} says: give the folder it lies in"
            )
        topics.add(connection, recorded, packed)
        read += 1
    return sum(one.msgcount for one in wanted), read


def _refuse_packed_chunks(storage: Any, source: str) -> None:  # noqa: ANN401 - of rosbags
    """Refuse an MCAP whose chunks unpack to too much: those of one time are in memory together."""
    chunks = getattr(storage, "chunks", ())
    if len({chunk.chunk_start_offset for chunk in chunks}) < len(chunks):
        raise ValueError("its index names a chunk twice")
    if chunks:
        refuse_bomb(source, sum(one.uncompressed_size for one in chunks), storage.path.stat().st_size)


def _advice(path: Path, start: bytes | None) -> str:
    """What to do about a broken recording."""
    repair = f"copy it again, or try {REPAIRS[start].format(shown(path.name))}" if start else "copy it again"
    return (_unfinished(path) or repair) if start == SQLITE else repair


def _unfinished(path: Path) -> str:
    """Tell what lies beside a database that was not closed, and what to do; empty where nothing does."""
    log = path.with_name(f"{path.name}-wal")
    if not log.is_file() or not log.stat().st_size:
        return ""
    return (
        f"{log.name} holds messages that are not yet in it: copy both, and run "
        f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
    )


def _about(file: File, topics: _Topics) -> Iterator[str]:
    """What to know about the recording."""
    for path in file.path.glob("*.db3") if file.path.is_dir() else [file.path]:
        yield from filter(None, [_unfinished(path)])
    if topics.is_undefined:
        yield f"messages are read as those of ROS 2 {DISTRIBUTION}: it defines none"


@contextmanager
def _named(path: Path, suffix: str) -> Iterator[Path]:
    """The path, or a link to it that ends as rosbags wants it, and holds nothing that means more in a URI."""
    if not suffix or (path.suffix == suffix and not set("?#%") & set(str(path))):
        yield path
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="flinders-") as folder:
        link = Path(folder) / f"recording{suffix}"
        link.symlink_to(path.absolute())
        yield link


def _mcap() -> Any:  # noqa: ANN401 - of rosbags
    """What rosbags reads MCAP by; its `zstd` is Python's own, or its backport."""
    return needs("rosbags.rosbag2.storage_mcap", "ros", KIND)


def _bound_unpacking() -> None:
    """Have rosbags unpack chunks up to `MOST_PIECE` bytes; what is sound unpacks as before."""
    lz4 = needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor
    unpackers = {"lz4": lz4, "zstd": _mcap().zstd.ZstdDecompressor, "bz2": bz2.BZ2Decompressor}
    for table in (_mcap().DECOMPRESSORS, needs("rosbags.rosbag1.reader", "ros", KIND).decompressors):
        table.update({name: partial(_chunk, unpackers[name]) for name in table if name in unpackers})


def _chunk(unpacker: Callable[[], Any], packed: bytes, *_: int) -> bytes:
    """Unpack a chunk, as rosbags asks for it."""
    try:
        return unpacked_piece(unpacker(), packed)
    except (RuntimeError, _mcap().zstd.ZstdError) as error:  # of lz4, of zstd
        raise ValueError(f"a chunk cannot be unpacked: {error}") from None


def _small_messages(messages: Callable[..., Iterator[Any]], *asked: object) -> Iterator[Any]:
    """Let through packed messages that say how long they are, unpacked, and are not too long."""
    for connection, stamp, packed in messages(*asked):
        length = _mcap().zstd.get_frame_info(packed).decompressed_size
        if length is None or length > MOST_PIECE:
            raise UnreadableInput("a packed message of the recording does not say how long it is, or is too long")
        yield connection, stamp, packed


# the messages


@dataclass(slots=True, eq=False)
class _Topic:
    """What one topic holds."""

    name: str
    kind: str
    frame: str = ""  # of its first message
    stamps: array[int] = field(default_factory=lambda: array("q"))  # (N,), ns
    values: array[float] = field(default_factory=lambda: array("d"))  # (N, k)
    unstamped: int = 0  # messages whose header has no time

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


def vector_of(vector: Any) -> tuple[float, float, float]:  # noqa: ANN401
    """(3,) of a vector of a message."""
    return vector.x, vector.y, vector.z


def motion_of(message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Acceleration, then rate; a covariance that starts with −1 says that there is none of it (``Imu.msg``)."""
    none = (np.nan,) * 3
    return (
        *(none if message.linear_acceleration_covariance[0] == -1 else vector_of(message.linear_acceleration)),
        *(none if message.angular_velocity_covariance[0] == -1 else vector_of(message.angular_velocity)),
    )


_NUMBERS: Final[dict[str, Callable[[Any], tuple[float, ...]]]] = {
    FIELD: lambda message: vector_of(message.magnetic_field),
    VECTOR: lambda message: vector_of(message.vector),
    IMU: motion_of,
    TEMPERATURE: lambda message: (message.temperature,),
    PLACE: lambda message: (message.latitude, message.longitude, message.altitude, message.status.status),
    TWIST: lambda message: (message.twist.linear.y, message.twist.linear.x),
    TWIST_WITH_COVARIANCE: lambda message: (message.twist.twist.linear.y, message.twist.twist.linear.x),
}
"""What is taken of a message of each kind."""


@dataclass(slots=True, eq=False)
class _Topics:
    """What is read of a recording, message by message."""

    source: str
    is_first: bool  # messages are those of ROS 1
    is_undefined: bool = False  # a type was not defined, and taken from `DISTRIBUTION`
    _by_name: dict[tuple[str, str], _Topic] = field(default_factory=dict)
    _decoders: dict[int, Callable[[bytes, str], Any]] = field(default_factory=dict)

    def is_wanted(self, connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
        """Tell whether a topic is one of those that are read."""
        return _is_wanted(connection)

    def add(self, connection: Any, recorded: int, packed: bytes) -> None:  # noqa: ANN401
        """Decode a message; one that cannot be decoded raises whatever rosbags makes of it."""
        key = connection.topic, connection.msgtype
        topic = self._by_name.setdefault(key, _Topic(*key))
        if connection.id not in self._decoders:
            self._decoders[connection.id] = self._decoder(connection)
        message = self._decoders[connection.id](packed, connection.msgtype)
        try:
            topic.add(recorded, message)
        except (AttributeError, TypeError) as error:  # its fields are those that the recording defines
            raise ValueError(f"{connection.msgtype} is defined otherwise: {error}") from None

    def _decoder(self, connection: Any) -> Callable[[bytes, str], Any]:  # noqa: ANN401
        """How messages of a connection are decoded: by the recording's own types where it has them."""
        from rosbags.interfaces import MessageDefinitionFormat

        if connection.msgdef.format == MessageDefinitionFormat.NONE:
            self.is_undefined = True
        return _undecoded(self.is_first)(connection)

    def sorted(self) -> list[_Topic]:
        """Those with messages, magnetometers first, those with tesla before those without a unit."""
        order = (FIELD, VECTOR, IMU, TEMPERATURE, PLACE, TWIST, TWIST_WITH_COVARIANCE)
        read = (topic for topic in self._by_name.values() if topic.stamps)
        return sorted(read, key=lambda topic: (order.index(topic.kind), topic.name))


def _is_wanted(connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
    """Tell whether a topic is one of those of magnetometers, and of what stands beside them."""
    if connection.msgtype == VECTOR:
        return NAMES_MAGNETOMETER.search(connection.topic) is not None
    if connection.msgtype in (TWIST, TWIST_WITH_COVARIANCE):
        return NAMES_SATELLITES.search(connection.topic) is not None
    return connection.msgtype in (FIELD, IMU, TEMPERATURE, PLACE)


@lru_cache(maxsize=32)
def _typestore(definition: MessageDefinition, name: str) -> Typestore:
    """The types of a message; decoders of a type are compiled once, for all topics and recordings that define it so."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    types = {}
    if definition.format == MessageDefinitionFormat.MSG:
        types = get_types_from_msg(definition.data, name)
    elif definition.format == MessageDefinitionFormat.IDL:
        for part in re.split(r"^=+\nIDL: .*\n", definition.data, flags=re.MULTILINE):
            types.update(get_types_from_idl(part) if part.strip() else {})
    else:
        types = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    store = get_typestore(Stores.EMPTY)
    store.register(_plain(dict(types)))
    return store


def _plain(types: dict[str, Any]) -> dict[str, Any]:
    """Types without their constants, and with names that are nothing but names: rosbags makes a program of them."""
    for name, (_, fields) in types.items():
        for part in (*name.split("/"), *(label for label, _ in fields)):
            if not IDENTIFIER.fullmatch(part):
                raise ValueError(f"{shown(part)!r} is no name of a type or of a field")
    return {name: ([], fields) for name, (_, fields) in types.items()}


# the magnetometers


def _columns(
    source: str, unit: Unit, time: Floats, field: Floats, auxiliary: Mapping[str, TimeSeries | None], _: bool
) -> Iterator[Samples]:
    """The readings of a magnetometer with the series of the sensors in its frame; nothing was applied to them."""

    def rows(part: slice) -> dict[str, Any]:
        return {"field": field[part], "time": time[part], **resampled(auxiliary, time[part])}

    return blocks(source, unit, len(time), rows)


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
        yield Instrument(
            source,
            shown(topic.name),
            unit,
            partial(_columns, source, unit, topic.seconds(since), topic.table, auxiliary),
            velocity=_velocity(topics, since),
            readings=int(np.isfinite(topic.table).all(axis=1).sum()),
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
        if topic.kind == PLACE:
            latitude, longitude, altitude, status = topic.table.T
            return first_position(latitude, longitude, altitude, fixed=status >= LEAST_FIX)
    return None


def _velocity(topics: Sequence[_Topic], since: int) -> TimeSeries | None:
    """Over ground, north and east, m/s, of the first topic that has one."""
    velocities = (topic for topic in topics if topic.kind in (TWIST, TWIST_WITH_COVARIANCE))
    return next((TimeSeries.of(topic.seconds(since), topic.table) for topic in velocities), None)


READERS: Final = (
    Reader(
        "ros",
        "ROS bag, MCAP",
        (".bag", ".mcap", ".db3"),
        "each topic of `MagneticField`, with the `Imu` and the `Temperature` in its frame",
        starts=(BAG, MCAP, SQLITE, b"rosbag2_bagfile_information:"),
        log=open_ros,
        folder_file=METADATA,
        extra="ros",
        takes_unit=True,
    ),
)
