r"""Messages of a ROS recording up to where it breaks off, as a recorder leaves it that loses its power.

rosbags reads nothing without the index, which is written last. Here the records of a bag of ROS 1 or an MCAP are read
from the first on until one of them is not whole; what a message holds is left to rosbags. The last message before the
break is left out, as the damage may reach into it. What comes after it is left to `REPAIRS`, and so is a database.

>>> source = _Bytes(BytesIO(b"\x05\x00\x00\x00whole"), 9)
>>> source.take(source.number(4)), source.left
(b'whole', 0)
>>> source.take(1)
Traceback (most recent call last):
ValueError: 1 bytes are wanted, and 0 are left

Sources: the ROS wiki, *Bags/Format/2.0*; the MCAP specification, version 0.
"""

from __future__ import annotations

import bz2
import os
from binascii import crc32
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from itertools import islice
from typing import TYPE_CHECKING, Any, BinaryIO, Final, NamedTuple, TypeAlias

from flinders.errors import UnreadableInput, counted
from flinders.readers._extras import needs, reading
from flinders.readers._source import MOST_PIECE

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence
    from pathlib import Path

KIND: Final = "a ROS recording"
BAG, MCAP, SQLITE = b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\x00"
REPAIRS: Final = {
    BAG: "rosbag reindex {}",
    MCAP: "mcap recover {} -o whole.mcap",
    SQLITE: "sqlite3 {} .recover | sqlite3 whole.db3",
}
"""What may find more than is read here."""
MOST_RECORD: Final = 16 << 20
"""Bytes of a record that is looked into: a wanted message, or the definition of one."""

Foreign: TypeAlias = Any
"""Of rosbags, which has few types."""


class Message(NamedTuple):
    """One message: the number of its connection, when it was recorded, in ns, and its bytes where it is wanted."""

    connection: int
    recorded: int
    content: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Beginning:
    """What comes before the break; `connections` and `messages` are those that a reader of rosbags has.

    Attributes
    ----------
    connections : sequence
    scan : callable
        Goes through the recording once more, for messages of these connections.
    count : int
        Whole messages, of all topics.
    damage : str
        Where the break is, and how much is read.
    """

    connections: Sequence[Foreign]
    scan: Callable[[frozenset[int]], _Scan]
    count: int
    damage: str

    def messages(self, connections: Sequence[Foreign]) -> Iterator[tuple[Foreign, int, bytes]]:
        """Yield the messages of these connections, in the order in which they were written."""
        wanted = {one.id: one for one in connections}
        records = (each for each in self.scan(frozenset(wanted)).records() if isinstance(each, Message))
        for message in islice(records, self.count):
            if message.connection in wanted:
                yield wanted[message.connection], message.recorded, message.content


def beginning_of(name: str, path: Path, head: bytes, expected: int | None = None) -> Beginning | None:
    """Read a recording up to where it breaks off, which rosbags refuses, or gives fewer messages of than it says.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    path : Path
        A bag of ROS 1, or MCAP.
    head : bytes
        Its first ones.
    expected : int, optional
        Messages that it says it has, of all topics.

    Returns
    -------
    Beginning or None
        None where there is no message, and for what is neither.
    """
    kinds: dict[bytes, type[_Scan]] = {BAG: _BrokenBag, MCAP: _Mcap}
    start = next((start for start in kinds if head.startswith(start)), None)
    if start is None:
        return None
    kind = kinds[start]
    scan, count, is_whole = kind(path, frozenset()), 0, False
    connections: dict[int, Foreign] = {}
    try:
        with reading(name, KIND):
            for record in scan.records():
                if isinstance(record, Message):
                    count += 1
                else:
                    connections.setdefault(record.id, record)
            is_whole = True
    except UnreadableInput:
        count -= 1
    if count < 1:
        return None
    of = f"{count:,} of {expected:,} messages" if expected else counted(count, "whole message")
    damage = f"its index is missing or broken, as after a loss of power: {of} are read"
    if not is_whole:
        repair = REPAIRS[start].format(path.name)
        damage = f"it is cut short or damaged {scan.place}: {of} before it are read; {repair} may find more"
    return Beginning(tuple(connections.values()), partial(kind, path), count, damage)


class _Scan:
    """Goes through a recording up to where it breaks off, and raises there whatever the damage makes of it."""

    def __init__(self, path: Path, wanted: frozenset[int]) -> None:
        self.path, self.wanted = path, wanted  # connections whose messages are looked into
        self.size = path.stat().st_size
        self.at = 0  # the first byte that was not read whole

    @property
    def place(self) -> str:
        """Say where the break is."""
        return f"in what begins at byte {self.at:,} of {self.size:,}"

    def records(self) -> Iterator[Foreign | Message]:
        """Yield connections, and the messages that belong to them."""
        with self.path.open("rb") as stream:
            source = _Bytes(stream, self.size)
            self.open(source)
            is_last = False
            while source.left and not is_last:
                self.at = source.place
                is_last = yield from self.record(source)

    def open(self, source: _Bytes) -> None:
        """Read what stands before the records."""
        raise NotImplementedError

    def record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        """Read one record, and return whether no message comes after it."""
        raise NotImplementedError

    def inside(self, packing: str, source: _Bytes, length: int, checked: int = 0) -> Iterator[Foreign | Message]:
        """Yield what a packed piece of so many bytes holds; of one that is cut, as much as is there."""
        there = min(length or source.left, source.left)  # a piece that was never closed goes on to the end
        piece = _unpacked(packing, source.take(there, MOST_PIECE))
        if there == length and checked and crc32(piece) != checked:
            raise ValueError("a chunk is not what it was")
        inner = _Bytes(BytesIO(piece), len(piece))
        while inner.left:
            yield from self.record(inner)
        if length and there != length:
            raise ValueError("a chunk has no end")


@dataclass(slots=True)
class _Bytes:
    """A file, or a piece of one, that is read on and on, and never beyond its end."""

    stream: BinaryIO
    size: int

    @property
    def place(self) -> int:
        """Bytes read so far."""
        return self.stream.tell()

    @property
    def left(self) -> int:
        """Bytes to its end."""
        return self.size - self.place

    def take(self, length: int, most: int = MOST_RECORD) -> bytes:
        """Read so many bytes; ValueError where they are not there, or are more than such a thing has."""
        self._need(length)
        if length > most:
            raise ValueError(f"{length} bytes are more than {most}")
        return self.stream.read(length)

    def skip(self, length: int) -> bytes:
        """Leave so many bytes out."""
        self._need(length)
        self.stream.seek(length, os.SEEK_CUR)
        return b""

    def number(self, width: int) -> int:
        """Read an unsigned number of so many bytes."""
        return int.from_bytes(self.take(width), "little")

    def text(self) -> str:
        """Read a string with its length before it."""
        return self.take(self.number(4)).decode()

    def _need(self, length: int) -> None:
        if length > self.left:
            raise ValueError(f"{length} bytes are wanted, and {self.left} are left")


class _BrokenBag(_Scan):
    """A bag of ROS 1."""

    MESSAGE, CHUNK, CONNECTION = 2, 5, 7

    def open(self, source: _Bytes) -> None:
        """Read its first line."""
        if source.stream.readline(16) != b"#ROSBAG V2.0\n":
            raise ValueError("only bags of version 2.0 are read")

    def record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        """Read a header and what belongs to it."""
        fields = _fields(source.take(source.number(4)))
        length, kind = source.number(4), fields[b"op"][0]
        if kind == self.CHUNK:
            packing = fields[b"compression"].decode()
            if packing != "none":  # else its records come next
                yield from self.inside(packing, source, length)
        elif kind == self.CONNECTION:
            yield _connection(fields, _fields(source.take(length)))
        elif kind == self.MESSAGE:
            number, time = int.from_bytes(fields[b"conn"], "little"), fields[b"time"]
            recorded = int.from_bytes(time[:4], "little") * 10**9 + int.from_bytes(time[4:], "little")
            yield Message(number, recorded, (source.take if number in self.wanted else source.skip)(length))
        else:
            source.skip(length)
        return False


class _Mcap(_Scan):
    """A recording of ROS 2 in the container MCAP."""

    HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
    OVERHEAD = 22  # bytes of a message before its content

    def __init__(self, path: Path, wanted: frozenset[int]) -> None:
        super().__init__(path, wanted)
        self.schemas: dict[int, Foreign] = {}

    def open(self, source: _Bytes) -> None:
        """Read its header."""
        source.skip(len(MCAP))
        if source.number(1) != self.HEADER:
            raise ValueError("it does not begin with its header")
        header = source.take(source.number(8))
        if _Bytes(BytesIO(header), len(header)).text() != "ros2":
            raise ValueError("it is not one of ROS 2")

    def record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        """Read the number of a kind, a length, and what belongs to them."""
        kind, length = source.number(1), source.number(8)
        if kind == self.CHUNK:
            source.skip(24)  # times, and the size of what is in it
            checked, packing, packed = source.number(4), source.text(), source.number(8)
            if packing or checked:  # else its records come next
                yield from self.inside(packing, source, packed, checked)
        elif kind == self.MESSAGE:
            number, _, recorded, _ = source.number(2), source.number(4), source.number(8), source.number(8)
            if length < self.OVERHEAD:
                raise ValueError("a message is shorter than what stands before it")
            content = (source.take if number in self.wanted else source.skip)(length - self.OVERHEAD)
            yield Message(number, recorded, content)
        elif kind in (self.SCHEMA, self.CHANNEL):
            inner = _Bytes(BytesIO(source.take(length)), length)
            yield from self._schema(inner) if kind == self.SCHEMA else self._channel(inner)
        elif not kind:
            raise ValueError("no record has the number 0")
        else:
            source.skip(length)
        return kind in (self.DATA_END, self.FOOTER)

    def _schema(self, content: _Bytes) -> Iterator[Foreign]:
        number = content.number(2)
        container = needs("rosbags.rosbag2.storage_mcap", "ros", KIND)
        self.schemas[number] = container.Schema(number, content.text(), content.text(), content.text())
        yield from ()

    def _channel(self, content: _Bytes) -> Iterator[Foreign]:
        number, schema = content.number(2), self.schemas.get(content.number(2))
        definition = needs("rosbags.rosbag2.storage_mcap", "ros", KIND).get_msgdef(schema)
        yield _like_rosbags(number, content.text(), schema.name if schema else "", definition)


def _fields(packed: bytes) -> dict[bytes, bytes]:
    """Cut a header of ROS 1 into its fields, ``name=value`` with the length before it."""
    header, fields = _Bytes(BytesIO(packed), len(packed)), {}
    while header.left:
        name, _, value = header.take(header.number(4)).partition(b"=")
        fields[name] = value
    return fields


def _connection(fields: dict[bytes, bytes], inner: dict[bytes, bytes]) -> Foreign:
    """Make a connection of what a bag of ROS 1 says of one, in the header of its record and in the record."""
    types, interfaces = needs("rosbags.typesys.msg", "ros", KIND), needs("rosbags.interfaces", "ros", KIND)
    formats = interfaces.MessageDefinitionFormat
    definition = interfaces.MessageDefinition(formats.MSG, inner[b"message_definition"].decode())
    topic = needs("rosbags.rosbag1.reader", "ros", KIND).normalize(fields[b"topic"].decode())
    kind = types.normalize_msgtype(inner[b"type"].decode())
    return _like_rosbags(int.from_bytes(fields[b"conn"], "little"), topic, kind, definition)


def _like_rosbags(number: int, topic: str, kind: str, definition: Foreign) -> Foreign:
    """Make a connection as rosbags does, of what is asked of one."""
    return needs("rosbags.interfaces", "ros", KIND).Connection(number, topic, kind, definition, "", 0, None, None)


def _unpacked(packing: str, packed: bytes) -> bytes:
    """Unpack a piece, up to `MOST_PIECE` bytes; of one that is cut, as much as is there."""
    if not packing:
        return packed
    unpackers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor,
        "zstd": needs("rosbags.rosbag2.storage_mcap", "ros", KIND).zstd.ZstdDecompressor,
    }
    content: bytes = unpackers[packing]().decompress(packed, max_length=MOST_PIECE)
    return content
