"""ROS recordings, read with rosbags: bags of ROS 1 (``.bag``), folders and databases of ROS 2 (``.db3``), MCAP.

Each topic of ``sensor_msgs/MagneticField`` is a magnetometer, in **tesla** as REP-103 wants. Some drivers write gauss
or microtesla all the same, which the length of the readings shows; a unit given by the user takes precedence. Axes that
a sensor lacks are NaN: such rows are left out and counted. Old drivers wrote a ``geometry_msgs/Vector3Stamped``, which
has no unit. It counts as a magnetometer if the name of its topic says so, with readings in counts unless the user gives
a unit.

Velocity over ground is a ``geometry_msgs/TwistStamped`` or ``TwistWithCovarianceStamped`` of satellites: x east and
y north, on the topic ``vel`` or one that names GPS, GNSS or the fix. Other topics are velocities of wheels or commands.

A reading has acceleration and rate of the ``sensor_msgs/Imu`` in the same frame, and the temperature of a
``sensor_msgs/Temperature`` in that frame. Axes stay those of the frame that the messages name. The axes of a body in
ROS are forward, left, up (REP-103); ``--axes x,-y,-z`` makes them forward, right, down. Acceleration is specific force:
at rest it is +g along an axis that points up, and −g along one that points down.

Times are those of the messages' headers; a header without time gets the time of recording. They count in seconds from
the first reading, or from the start of the clock if the clock does not count from 1970.

Only whole recordings are read: a damaged one is refused with the command that may repair it. Types are those that the
recording defines (ROS 1, MCAP), else those of ROS 2 Humble. Compressed data is unpacked up to `MAX_CHUNK_BYTES` bytes
at a time.

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
from flinders.core.files import MAX_CHUNK_BYTES, decompress_chunk, limit_size, refuse_bomb
from flinders.core.units import COUNTS, Unit
from flinders.errors import UnreadableInput, count_text
from flinders.foreign_errors import import_optional, parser_errors
from flinders.readers._log import Instrument, Log, Position, first_position
from flinders.readers._reader import Reader
from flinders.readers._resample import TimeSeries, blocks, resample
from flinders.readers._source import MAX_MEMBER_BYTES
from flinders.readers._times import MIN_EPOCH_S
from flinders.readers._tokenizer import shorten

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
"""Commands that may repair a damaged recording, by its first bytes."""
SUFFIXES: Final = {MCAP: ".mcap", SQLITE: ".db3"}
"""Suffix that rosbags requires, by a file's first bytes."""
ZSTD: Final = b"\x28\xb5\x2f\xfd"
METADATA: Final = "metadata.yaml"
MAX_METADATA_BYTES: Final = 16 << 20
DISTRIBUTION: Final = "Humble"
"""Distribution whose types are used for ROS 2 messages without a definition."""

FIELD, VECTOR = "sensor_msgs/msg/MagneticField", "geometry_msgs/msg/Vector3Stamped"
IMU, TEMPERATURE, PLACE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature", "sensor_msgs/msg/NavSatFix"
TWIST, TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped"
NAMES_MAGNETOMETER: Final = re.compile(r"(?:^|[/_])(?:mag|compass)", re.IGNORECASE)
"""Pattern of the name of a vector's topic that counts as a magnetometer."""
NAMES_SATELLITES: Final = re.compile(r"(?:^|[/_])(?:gps|gnss|navsat|fix)(?:[/_]|$)|(?:^|/)vel$", re.IGNORECASE)
"""Pattern of the name of a topic with the velocity over ground of a satellite receiver."""
IDENTIFIER: Final = re.compile(r"[A-Za-z]\w*", re.ASCII)
"""Pattern of the names of types and fields in ROS."""
Topics: TypeAlias = "_Topics | Fields"
"""Collector of messages, which also selects them."""
MIN_FIX: Final = 0
"""Smallest status of a fix: ``NavSatStatus.STATUS_FIX``."""


def open_ros(file: File, *, unit: str | None = None) -> Log:
    """Open a recording of ROS 1 or ROS 2.

    Raises `MissingExtra` without rosbags; `UnreadableInput` for a file that is not a recording, or damaged;
    `UnitError` for an unknown unit.

    Parameters
    ----------
    file : File
        File on the disk, not compressed; or a folder with a ``metadata.yaml``, or that ``metadata.yaml``.
    unit : str, optional
        Unit of ``Vector3Stamped``, or the unit that a driver writes in place of tesla: ``G``, ``uT`` …

    Returns
    -------
    Log
        Without instruments if no topic is a magnetometer.
    """
    import_optional("rosbags.highlevel", "ros", KIND)
    given = None if unit is None else Unit.of(unit)
    if file.path.name == METADATA:
        file = replace(file, path=file.path.parent)
    head = b"" if file.path.is_dir() else file.head()
    topics = _Topics(file.name, is_first=head.startswith(BAG))
    start = next((start for start in REPAIRS if head.startswith(start)), None)
    _read(file, start, topics)
    ordered = topics.sorted()
    begun = min((int(topic.stamps[0]) for topic in ordered if topic.is_magnetometer), default=0)
    since = begun if 1e-9 * begun > MIN_EPOCH_S else 0
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
    """Series of fields by name, such as ``/battery.current``, and the names of all fields of their topics."""
    fields = Fields.of(file.name, names, _raw_decoder(start == BAG), is_first=start == BAG)
    if fields.paths:
        _read(file, start, fields)
    return fields.series(since), fields.there


def _raw_decoder(is_first: bool) -> Callable[[Any], Callable[[bytes, str], Any]]:
    """Return a function from a connection to the decoder of its messages."""

    def decoder(connection: Any) -> Callable[[bytes, str], Any]:  # noqa: ANN401 - rosbags' types are its own
        store = _typestore(connection.msgdef, connection.msgtype)
        return store.deserialize_ros1 if is_first else store.deserialize_cdr

    return decoder


def _read(file: File, start: bytes | None, topics: Topics) -> None:
    """Read the selected topics of a recording: of a folder, or of a file whose first bytes are `start`."""
    with parser_errors(file.name, KIND, advice=_advice(file.path, start)):
        if start is None:
            _read_folder(file, topics)
        else:
            _read_file(file.path, start, topics)


# folders and databases


def _read_folder(file: File, topics: Topics) -> None:
    """Read a folder of ROS 2; refuse it if messages are missing, since rosbags may stop at damage silently."""
    if (file.path / METADATA).stat().st_size > MAX_METADATA_BYTES:
        raise UnreadableInput(f"the {METADATA} of {file.name} has more than {MAX_METADATA_BYTES >> 20} MB")
    for packed in file.path.glob("*.zstd"):
        with _mcap().zstd.open(packed, "rb") as stream:
            chunks, size = iter(partial(stream.read, 1 << 20), b""), packed.stat().st_size
            for _ in limit_size(packed.name, chunks, partial(int, size), most=MAX_MEMBER_BYTES, ratio=False):
                pass
    expected, read = _read_by_rosbags(file.path, topics)
    if read < expected:
        raise UnreadableInput(
            f"{file.name} is damaged: {read:,} of {count_text(expected, 'message')} are readable; copy it again, or "
            "repair the file in it with mcap recover or sqlite3 .recover"
        )


def _read_file(path: Path, start: bytes, topics: Topics) -> None:
    """Read a recording in one file; raise ValueError if messages are missing."""
    with _suffixed_path(path, SUFFIXES.get(start, "")) as named:
        expected, read = (_read_bag if start == BAG else _read_by_rosbags)(named, topics)
    if read < expected:
        raise ValueError(f"{read:,} of {count_text(expected, 'message')} are readable")


def _read_bag(path: Path, topics: Topics) -> tuple[int, int]:
    """Read a bag of ROS 1 with rosbags; returns as `_read_by_rosbags`."""
    from rosbags.rosbag1 import Reader as FirstReader

    class BoundedReader(FirstReader):
        """Reader of a bag that refuses an index longer than the file, which damaged chunks may share."""

        indexed = 0

        def read_index_data(self, pos: int, indexes: dict[int, list[Any]]) -> None:
            assert self.bio
            begin = self.bio.tell()
            super().read_index_data(pos, indexes)
            self.indexed += self.bio.tell() - begin
            if self.indexed > path.stat().st_size:
                raise ValueError("its index has repeated entries")

    _bound_unpacking()
    with BoundedReader(path) as reader:
        return _read_messages(reader, topics)


def _read_by_rosbags(path: Path, topics: Topics) -> tuple[int, int]:
    """Read a recording of ROS 2 with rosbags; returns the number of messages in its index, and the number read."""
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
    for connection, recorded, packed in reader.messages(wanted) if wanted else ():  # an empty selection would mean all
        if packed[:4] == ZSTD:
            raise UnreadableInput(
                f"messages of {topics.source} are compressed, as its {METADATA} states: give the folder of the file"
            )
        topics.add(connection, recorded, packed)
        read += 1
    return sum(one.msgcount for one in wanted), read


def _refuse_packed_chunks(storage: Any, source: str) -> None:  # noqa: ANN401 - of rosbags
    """Refuse an MCAP whose chunks are too large unpacked: chunks that overlap in time are in memory together."""
    chunks = getattr(storage, "chunks", ())
    if len({chunk.chunk_start_offset for chunk in chunks}) < len(chunks):
        raise ValueError("its index names a chunk twice")
    if chunks:
        refuse_bomb(source, sum(one.uncompressed_size for one in chunks), storage.path.stat().st_size)


def _advice(path: Path, start: bytes | None) -> str:
    """Remedy for a damaged recording."""
    repair = f"copy it again, or try {REPAIRS[start].format(shorten(path.name))}" if start else "copy it again"
    return (_unfinished(path) or repair) if start == SQLITE else repair


def _unfinished(path: Path) -> str:
    """Sentence on the write-ahead log of a database that was not closed, with the remedy; empty without one."""
    log = path.with_name(f"{path.name}-wal")
    if not log.is_file() or not log.stat().st_size:
        return ""
    return (
        f"{log.name} holds messages that are not yet in the database: copy both, and run "
        f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
    )


def _about(file: File, topics: _Topics) -> Iterator[str]:
    """Yield notes on the recording."""
    for path in file.path.glob("*.db3") if file.path.is_dir() else [file.path]:
        yield from filter(None, [_unfinished(path)])
    if topics.is_undefined:
        yield f"messages are read as those of ROS 2 {DISTRIBUTION}: the recording defines no types"


@contextmanager
def _suffixed_path(path: Path, suffix: str) -> Iterator[Path]:
    """Yield a path that rosbags accepts: with the suffix that it requires, and without special characters of a URI.

    It is the path itself, or else a link to it.
    """
    if not suffix or (path.suffix == suffix and not set("?#%") & set(str(path))):
        yield path
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="flinders-") as folder:
        link = Path(folder) / f"recording{suffix}"
        link.symlink_to(path.absolute())
        yield link


def _mcap() -> Any:  # noqa: ANN401 - of rosbags
    """Return rosbags' module for MCAP; its `zstd` is Python's own, or its backport."""
    return import_optional("rosbags.rosbag2.storage_mcap", "ros", KIND)


def _bound_unpacking() -> None:
    """Limit rosbags' unpacking of chunks to `MAX_CHUNK_BYTES` bytes; undamaged chunks unpack as before."""
    lz4 = import_optional("lz4.frame", "ros", KIND).LZ4FrameDecompressor
    unpackers = {"lz4": lz4, "zstd": _mcap().zstd.ZstdDecompressor, "bz2": bz2.BZ2Decompressor}
    for table in (_mcap().DECOMPRESSORS, import_optional("rosbags.rosbag1.reader", "ros", KIND).decompressors):
        table.update({name: partial(_chunk, unpackers[name]) for name in table if name in unpackers})


def _chunk(unpacker: Callable[[], Any], packed: bytes, *_: int) -> bytes:
    """Unpack a chunk, with the interface of rosbags' decompressor."""
    try:
        return decompress_chunk(unpacker(), packed)
    except (RuntimeError, _mcap().zstd.ZstdError) as error:  # of lz4, of zstd
        raise ValueError(f"a chunk cannot be unpacked: {error}") from None


def _small_messages(messages: Callable[..., Iterator[Any]], *asked: object) -> Iterator[Any]:
    """Yield messages whose unpacked size is stated and within the limit; refuse others."""
    for connection, stamp, packed in messages(*asked):
        length = _mcap().zstd.get_frame_info(packed).decompressed_size
        if length is None or length > MAX_CHUNK_BYTES:
            raise UnreadableInput("a compressed message of the recording does not state its size, or is too large")
        yield connection, stamp, packed


# the messages


@dataclass(slots=True, eq=False)
class _Topic:
    """Messages of one topic, as columns."""

    name: str
    kind: str
    frame: str = ""  # of its first message
    stamps: array[int] = field(default_factory=lambda: array("q"))  # (N,), ns
    values: array[float] = field(default_factory=lambda: array("d"))  # (N, k)
    unstamped: int = 0  # messages whose header has no time

    @property
    def is_magnetometer(self) -> bool:
        """Whether the messages of the topic are readings of a magnetometer."""
        return self.kind in (FIELD, VECTOR)

    def add(self, recorded: int, message: Any) -> None:  # noqa: ANN401
        """Add a message; `recorded` is the time of recording, ns."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        numbers, frame = _NUMBERS[self.kind](message), str(message.header.frame_id).strip("/")
        self.stamps.append(stamp or recorded)
        self.values.extend(numbers)
        if not stamp:
            self.unstamped += 1
        if len(self.stamps) == 1:
            self.frame = frame

    def seconds(self, since: int) -> Floats:
        """(N,) s since a stamp in ns."""
        return (np.asarray(self.stamps, np.int64) - since) * 1e-9

    @property
    def table(self) -> Floats:
        """(N, k) values: a row for each message."""
        return np.asarray(self.values, np.float64).reshape(len(self.stamps), -1)


def vector_of(vector: Any) -> tuple[float, float, float]:  # noqa: ANN401
    """Components of a vector of a message."""
    return vector.x, vector.y, vector.z


def motion_of(message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Acceleration, then rate; NaN if the first covariance is −1, which marks a missing quantity (``Imu.msg``)."""
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
"""Functions that return the numbers of a message, by kind."""


@dataclass(slots=True, eq=False)
class _Topics:
    """Selected messages of a recording, added one by one."""

    source: str
    is_first: bool  # messages are those of ROS 1
    is_undefined: bool = False  # a type was undefined and taken from `DISTRIBUTION`
    _by_name: dict[tuple[str, str], _Topic] = field(default_factory=dict)
    _decoders: dict[int, Callable[[bytes, str], Any]] = field(default_factory=dict)

    def is_wanted(self, connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
        """Whether a topic is read."""
        return _is_wanted(connection)

    def add(self, connection: Any, recorded: int, packed: bytes) -> None:  # noqa: ANN401
        """Decode a message and add it; rosbags' exceptions pass through."""
        key = connection.topic, connection.msgtype
        topic = self._by_name.setdefault(key, _Topic(*key))
        if connection.id not in self._decoders:
            self._decoders[connection.id] = self._decoder(connection)
        message = self._decoders[connection.id](packed, connection.msgtype)
        try:
            topic.add(recorded, message)
        except (AttributeError, TypeError) as error:  # the recording defines the fields of its messages
            raise ValueError(f"{connection.msgtype} has an unexpected definition: {error}") from None

    def _decoder(self, connection: Any) -> Callable[[bytes, str], Any]:  # noqa: ANN401
        """Return the decoder of a connection, by the recording's own types if defined."""
        from rosbags.interfaces import MessageDefinitionFormat

        if connection.msgdef.format == MessageDefinitionFormat.NONE:
            self.is_undefined = True
        return _raw_decoder(self.is_first)(connection)

    def sorted(self) -> list[_Topic]:
        """Topics with messages: magnetometers in tesla, magnetometers without a unit, then others."""
        order = (FIELD, VECTOR, IMU, TEMPERATURE, PLACE, TWIST, TWIST_WITH_COVARIANCE)
        read = (topic for topic in self._by_name.values() if topic.stamps)
        return sorted(read, key=lambda topic: (order.index(topic.kind), topic.name))


def _is_wanted(connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
    """Whether a topic is a magnetometer, or a sensor whose values accompany a magnetometer's."""
    if connection.msgtype == VECTOR:
        return NAMES_MAGNETOMETER.search(connection.topic) is not None
    if connection.msgtype in (TWIST, TWIST_WITH_COVARIANCE):
        return NAMES_SATELLITES.search(connection.topic) is not None
    return connection.msgtype in (FIELD, IMU, TEMPERATURE, PLACE)


@lru_cache(maxsize=32)
def _typestore(definition: MessageDefinition, name: str) -> Typestore:
    """Store of the types in a message definition; decoders are compiled once for all topics and recordings."""
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
    store.register(checked_types(dict(types)))
    return store


def checked_types(types: dict[str, Any]) -> dict[str, Any]:
    """Types without constants; refuses names that are not identifiers, since rosbags generates code from them."""
    for name, (_, fields) in types.items():
        for part in (*name.split("/"), *(label for label, _ in fields)):
            if not IDENTIFIER.fullmatch(part):
                raise ValueError(f"{shorten(part)!r} is not a valid name of a type or field")
    return {name: ([], fields) for name, (_, fields) in types.items()}


# the magnetometers


def _columns(
    source: str, unit: Unit, time: Floats, field: Floats, auxiliary: Mapping[str, TimeSeries | None], _: bool
) -> Iterator[Samples]:
    """Yield raw readings of a magnetometer, with the series of the sensors in its frame."""

    def rows(part: slice) -> dict[str, Any]:
        return {"field": field[part], "time": time[part], **resample(auxiliary, time[part])}

    return blocks(source, unit, len(time), rows)


def _instruments(source: str, topics: Sequence[_Topic], since: int, given: Unit | None) -> Iterator[Instrument]:
    """Yield each magnetometer, with the sensors in its frame."""
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
            shorten(topic.name),
            unit,
            partial(_columns, source, unit, topic.seconds(since), topic.table, auxiliary),
            velocity=_velocity(topics, since),
            readings=int(np.isfinite(topic.table).all(axis=1).sum()),
            notes=tuple(_notes(topic, unit, motion, topics)),
        )


def _companion(topic: _Topic, topics: Sequence[_Topic], kind: str) -> _Topic | None:
    """Topic of a kind in the same frame; of several, the one whose name shares the longest beginning."""
    same = [other for other in topics if other.kind == kind and other.frame == topic.frame]
    return max(same, key=lambda other: _common_parts(topic.name, other.name), default=None)


def _common_parts(one: str, other: str) -> int:
    """Number of leading parts that two names share.

    >>> _common_parts("/boat/imu/mag", "/boat/imu/data_raw")
    2
    """
    parts = zip(one.strip("/").split("/"), other.strip("/").split("/"), strict=False)
    return next((place for place, (a, b) in enumerate(parts) if a != b), len(one.split("/")))


def _notes(topic: _Topic, unit: Unit, motion: _Topic | None, topics: Sequence[_Topic]) -> Iterator[str]:
    """Yield notes on one magnetometer."""
    yield (
        f"axes are those of the frame {shorten(topic.frame) or 'without a name'}; where that is forward, left, up "
        "(REP-103), --axes x,-y,-z makes it forward, right, down"
    )
    if topic.kind == VECTOR and unit.name == COUNTS:
        yield "the message (Vector3Stamped) does not say its unit: readings are in counts"
    if topic.kind == FIELD and unit != TESLA:
        yield f"the message (MagneticField) is in tesla by its definition, and is read in {unit.name} as given"
    elif topic.kind == FIELD and (length := _median_length(topic.table)) and not 5e-6 < length < 5e-4:
        yield (
            f"readings are about {length:.2g} T long, and the earth's field is 2e-05 to 7e-05 T: the driver writes "
            "another unit (give it with --unit), or normalises"
        )
    others = sorted({shorten(other.frame) for other in topics if other.kind == IMU})
    if motion is None and others:
        yield f"acceleration and rate are left out: they are in another frame ({', '.join(others)})"
    if topic.unstamped:
        yield f"{topic.unstamped:,} messages have no time in their header: their time of recording is used"


def _median_length(field: Floats) -> float:
    """Median length of finite readings; 0 without any."""
    finite = field[np.isfinite(field).all(axis=1)]
    with np.errstate(over="ignore"):
        return float(np.median(np.linalg.norm(finite, axis=1))) if len(finite) else 0.0


def _position(topics: Sequence[_Topic]) -> Position | None:
    """First position with a fix."""
    for topic in topics:
        if topic.kind == PLACE:
            latitude, longitude, altitude, status = topic.table.T
            return first_position(latitude, longitude, altitude, fixed=status >= MIN_FIX)
    return None


def _velocity(topics: Sequence[_Topic], since: int) -> TimeSeries | None:
    """(N, 2) velocity over ground, north and east, m/s, of the first topic that has it."""
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
