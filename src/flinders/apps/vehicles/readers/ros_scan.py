r"""Messages of a ROS recording in one file, a bag of ROS 1 or an MCAP, from its first byte up to its end or a break.

Records are read one after the other, and the index, which is written last, is not needed: a recorder that loses its
power leaves none. The last message before a break is left out, as the damage may reach into it; what comes after it is
left to `REPAIRS`. What a message holds is left to rosbags, and so are folders and databases.

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
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO, Final, NamedTuple, TypeAlias

from flinders.core.files import MOST_PIECE, unpacked_piece
from flinders.errors import FlindersError, counted, needs, reading

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

    from flinders.readers._source import File

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
    """A message: number of its connection, when it was recorded, in ns, and its bytes, empty where it is not wanted."""

    connection: int
    recorded: int
    content: bytes


class Scan:
    """One pass over a recording.

    Attributes
    ----------
    damage : str
        Once all messages were taken: where it breaks off, or that it was not closed, and how much was read.
    """

    start: bytes
    """First bytes of such files."""

    def __init__(self, file: File, is_wanted: Callable[[Foreign], bool]) -> None:
        self.file, self._is_wanted = file, is_wanted
        self.damage = ""
        self._connections: dict[int, Foreign] = {}  # those that are wanted
        self._at = 0  # the first byte that was not read whole
        self._is_closed = False

    def messages(self) -> Iterator[tuple[Foreign, int, bytes]]:
        """Yield connection, time of recording in ns and content of each wanted message, in the order of the file.

        Raises `UnreadableInput` where there is no whole message before a break, or a packed piece has too many bytes.
        """
        count, last = 0, None
        try:
            for message in self._records():
                if last is not None and last.connection in self._connections:
                    yield self._connections[last.connection], last.recorded, last.content
                count, last = count + 1, message
            if not self._is_closed and not count:
                raise ValueError("it ends before its first message")  # noqa: TRY301 - as any other break
        except FlindersError:
            raise
        except Exception:
            if count < 2:
                with reading(self.file.name, KIND):
                    raise
            place = f"in what begins at byte {self._at:,} of {self.file.path.stat().st_size:,}"
            before, repair = counted(count - 1, "whole message"), REPAIRS[self.start].format(self.file.path.name)
            self.damage = f"it is cut short or damaged {place}: {before} before it are read; {repair} may find more"
            return
        if last is not None and last.connection in self._connections:
            yield self._connections[last.connection], last.recorded, last.content
        if not self._is_closed:
            before = counted(count, "whole message")
            self.damage = f"its index is missing or broken, as after a loss of power: {before} are read"

    def _records(self) -> Iterator[Message]:
        """Yield messages, and keep the connections; raise whatever damage makes of it."""
        with self.file.path.open("rb") as stream:
            source = _Bytes(stream, os.fstat(stream.fileno()).st_size)
            self._open(source)
            is_last = False
            while source.left and not is_last:
                self._at = source.place
                is_last = yield from self._record(source)

    def _open(self, source: _Bytes) -> None:
        """Read what stands before the records."""
        raise NotImplementedError

    def _record(self, source: _Bytes) -> Generator[Message, None, bool]:
        """Read one record, and return whether no message comes after it."""
        raise NotImplementedError

    def _connect(self, number: int, topic: str, kind: str, definition: Foreign) -> None:
        """Keep a connection, as rosbags has it, if it is wanted."""
        make = needs("rosbags.interfaces", "ros", KIND).Connection
        connection = make(number, topic, kind, definition, "", 0, None, None)
        if self._is_wanted(connection):
            self._connections.setdefault(number, connection)

    def _message(self, number: int, recorded: int, source: _Bytes, length: int) -> Message:
        """Read a message, or pass over one that is not wanted."""
        return Message(number, recorded, (source.take if number in self._connections else source.skip)(length))

    def _inside(self, packing: str, source: _Bytes, length: int, checked: int = 0) -> Iterator[Message]:
        """Yield what a packed piece of so many bytes holds; of one that is cut, as much as is there."""
        there = min(length or source.left, source.left)  # a piece that was never closed goes on to the end
        packed = source.take(there, MOST_PIECE)
        piece = unpacked_piece(_unpacker(packing), packed, is_whole=there == length) if packing else packed
        if there == length and checked and crc32(piece) != checked:
            raise ValueError("the checksum of a chunk is wrong")
        inner = _Bytes(BytesIO(piece), len(piece))
        while inner.left:
            yield from self._record(inner)
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


class BagScan(Scan):
    """A bag of ROS 1."""

    start = BAG
    MESSAGE, HEADER, CHUNK, CONNECTION = 2, 3, 5, 7

    def _open(self, source: _Bytes) -> None:
        if source.stream.readline(16) != b"#ROSBAG V2.0\n":
            raise ValueError("only bags of version 2.0 are read")

    def _record(self, source: _Bytes) -> Generator[Message, None, bool]:
        """Read a header and what belongs to it."""
        fields = _fields(source.take(source.number(4)))
        length, kind = source.number(4), fields[b"op"][0]
        if kind == self.CHUNK:
            packing = fields[b"compression"].decode()
            if packing != "none":  # else its records come next
                yield from self._inside(packing, source, length)
        elif kind == self.CONNECTION:
            self._connection(fields, _fields(source.take(length)))
        elif kind == self.MESSAGE:
            number, time = int.from_bytes(fields[b"conn"], "little"), fields[b"time"]
            recorded = int.from_bytes(time[:4], "little") * 10**9 + int.from_bytes(time[4:], "little")
            yield self._message(number, recorded, source, length)
        else:
            self._is_closed |= kind == self.HEADER and any(fields[b"index_pos"])
            source.skip(length)
        return False

    def _connection(self, fields: dict[bytes, bytes], inner: dict[bytes, bytes]) -> None:
        """Keep what a bag of ROS 1 says of a connection, in the header of its record and in the record."""
        interfaces = needs("rosbags.interfaces", "ros", KIND)
        text = inner[b"message_definition"].decode()
        definition = interfaces.MessageDefinition(interfaces.MessageDefinitionFormat.MSG, text)
        topic = needs("rosbags.rosbag1.reader", "ros", KIND).normalize(fields[b"topic"].decode())
        kind = needs("rosbags.typesys.msg", "ros", KIND).normalize_msgtype(inner[b"type"].decode())
        self._connect(int.from_bytes(fields[b"conn"], "little"), topic, kind, definition)


class McapScan(Scan):
    """A recording of ROS 2 in the container MCAP."""

    start = MCAP
    HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
    OVERHEAD = 22  # bytes of a message before its content

    def __init__(self, file: File, is_wanted: Callable[[Foreign], bool]) -> None:
        super().__init__(file, is_wanted)
        self._schemas: dict[int, Foreign] = {}

    def _open(self, source: _Bytes) -> None:
        source.skip(len(MCAP))
        if source.number(1) != self.HEADER:
            raise ValueError("it does not begin with its header")
        header = source.take(source.number(8))
        if _Bytes(BytesIO(header), len(header)).text() != "ros2":
            raise ValueError("it is not one of ROS 2")

    def _record(self, source: _Bytes) -> Generator[Message, None, bool]:
        """Read the number of a kind, a length, and what belongs to them."""
        kind, length = source.number(1), source.number(8)
        if kind == self.CHUNK:
            source.skip(24)  # times, and the size of what is in it
            checked, packing, packed = source.number(4), source.text(), source.number(8)
            if packing or checked:  # else its records come next
                yield from self._inside(packing, source, packed, checked)
        elif kind == self.MESSAGE:
            number, _, recorded, _ = source.number(2), source.number(4), source.number(8), source.number(8)
            if length < self.OVERHEAD:
                raise ValueError("a message is shorter than what stands before it")
            yield self._message(number, recorded, source, length - self.OVERHEAD)
        elif kind in (self.SCHEMA, self.CHANNEL):
            self._describe(kind, _Bytes(BytesIO(source.take(length)), length))
        elif not kind:
            raise ValueError("no record has the number 0")
        else:
            source.skip(length)
        is_last = kind in (self.DATA_END, self.FOOTER)
        self._is_closed |= is_last
        return is_last

    def _describe(self, kind: int, content: _Bytes) -> None:
        """Keep a schema, or the connection that a channel is."""
        container = mcap()
        number = content.number(2)
        if kind == self.SCHEMA:
            self._schemas[number] = container.Schema(number, content.text(), content.text(), content.text())
        else:
            schema = self._schemas.get(content.number(2))
            self._connect(number, content.text(), schema.name if schema else "", container.get_msgdef(schema))


def _fields(packed: bytes) -> dict[bytes, bytes]:
    """Cut a header of ROS 1 into its fields, ``name=value`` with the length before it."""
    header, fields = _Bytes(BytesIO(packed), len(packed)), {}
    while header.left:
        name, _, value = header.take(header.number(4)).partition(b"=")
        fields[name] = value
    return fields


def mcap() -> Foreign:
    """What rosbags reads MCAP by; its `zstd` is Python's own, or its backport."""
    return needs("rosbags.rosbag2.storage_mcap", "ros", KIND)


def _unpacker(packing: str) -> Foreign:
    unpackers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor,
        "zstd": mcap().zstd.ZstdDecompressor,
    }
    return unpackers[packing]()
