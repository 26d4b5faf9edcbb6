r"""Recordings of ROS that were cut short or damaged: all whole messages before the damage, and after it where it ends.

A recorder that loses its power leaves no index, and rosbags reads nothing without one. Here the container alone is
gone through from its first byte, record by record; what a message holds is left to rosbags. Where bytes are no record,
a bag of ROS 1 and an MCAP are taken up again after the record that they stand in, or where `CHAIN` records follow one
another; of the messages before such a place the last is left out, as the damage may reach into it.

>>> source = _Bytes(BytesIO(b"\x05\x00\x00\x00whole"), 9)
>>> source.take(source.number(4)), source.left
(b'whole', 0)
>>> source.take(1)
Traceback (most recent call last):
ValueError: 1 bytes are wanted, and 0 are left

Sources: the ROS wiki, *Bags/Format/2.0*; the MCAP specification, version 0; rosbag2's tables for SQLite.
"""

from __future__ import annotations

import bz2
import mmap
import os
import re
from binascii import crc32
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar, Final, NamedTuple, TypeAlias

from flinders.errors import UnreadableInput, counted
from flinders.readers._extras import needs, reading

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Sequence

KIND: Final = "a ROS recording"
BAG, MCAP, SQLITE = b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\x00"
MOST_UNPACKED: Final = 1 << 30
"""Bytes that one packed piece may have, unpacked: a chunk has a few million."""
MOST_RECORD: Final = 16 << 20
"""Bytes of a record that is looked into: a wanted message, or the definition of one."""
CHUNK: Final = 1 << 20
CHAIN: Final = 4
"""Records that have to follow one another, so that a place after the damage is taken for the beginning of one."""
MOST_GAPS: Final = 1000
"""Damaged places after which a recording is taken up again."""
MOST_TRIED: Final = 100_000
"""Places after damage that are looked at, of one recording."""
MOST_HEADER: Final = 1 << 16
"""Bytes of the header of a record of ROS 1; that of a connection has the longest."""

Foreign: TypeAlias = Any
"""Of rosbags, which has few types."""


class Message(NamedTuple):
    """One message: the number of its connection, when it was recorded, in ns, and its bytes where it is wanted."""

    connection: int
    recorded: int
    content: bytes


class Gap(NamedTuple):
    """A damaged place: its first byte, and the one at which records go on."""

    begin: int
    end: int


@dataclass(frozen=True, slots=True, eq=False)
class Salvage:
    """What is left beside the damage; `connections` and `messages` are those that a reader of rosbags has.

    Attributes
    ----------
    connections : sequence
    scan : callable
        Goes through the recording once more, for messages of these connections.
    count : int
        Whole messages, of all topics.
    told : str
        Where the damage is, and what is read.
    """

    connections: Sequence[Foreign]
    scan: Callable[[frozenset[int]], _Scan]
    count: int
    told: str

    def messages(self, connections: Sequence[Foreign]) -> Iterator[tuple[Foreign, int, bytes]]:
        """Yield the messages of these connections, in the order in which they were written."""
        wanted = {one.id: one for one in connections}
        left = self.count
        for found in _confirmed(self.scan(frozenset(wanted)).found()):
            if isinstance(found, Message):
                if found.connection in wanted:
                    yield wanted[found.connection], found.recorded, found.content
                left -= 1
                if not left:
                    return


def salvaged(name: str, path: Path, head: bytes, expected: int | None = None) -> Salvage | None:
    """Look for whole messages in a recording that rosbags refuses, or gives fewer of than there should be.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    path : Path
        A bag of ROS 1, MCAP, or a database of ROS 2.
    head : bytes
        Its first ones.
    expected : int, optional
        Messages that it says it has, of all topics.

    Returns
    -------
    Salvage or None
        None where there is no message.
    """
    kinds: dict[bytes, type[_Scan]] = {BAG: _Bag, MCAP: _Mcap, SQLITE: _Database}
    kind = next((kind for start, kind in kinds.items() if head.startswith(start)), None)
    if kind is None:
        return None
    scan = kind(path, frozenset())
    connections: dict[int, Foreign] = {}
    count, is_whole = 0, False
    try:
        with reading(name, KIND):
            for found in _confirmed(scan.found()):
                if isinstance(found, Message):
                    count += 1
                else:
                    connections.setdefault(found.id, found)
            is_whole = True
    except UnreadableInput:
        pass  # what came before it is what is looked for
    if not count:
        return None
    read = f"its {counted(count, 'whole message')} {'is' if count == 1 else 'are'} read"
    if expected is not None and expected > count and not (is_whole and scan.is_gapless):
        read = f"{expected - count:,} of {counted(expected, 'message')} are missing, the rest is read"
    told = f"{scan.place(is_whole=is_whole)}: {read}"
    return Salvage(tuple(connections.values()), partial(kind, path), count, told)


def _confirmed(records: Iterator[Foreign | Message | Gap]) -> Iterator[Foreign | Message]:
    """Yield each once the next has come, and none before a gap: zeros that a file system leaves may reach into it."""
    last = None
    for record in records:
        if last is not None and not isinstance(record, Gap):
            yield last
        last = None if isinstance(record, Gap) else record
    if last is not None:
        yield last


class _Scan:
    """Goes through a recording as far as it is whole; what is not raises whatever the damage makes of it.

    Parameters
    ----------
    path : Path
    wanted : set of int
        Connections whose messages are looked into.
    """

    def __init__(self, path: Path, wanted: frozenset[int]) -> None:
        self.path, self.wanted = path, wanted
        self.size = path.stat().st_size
        self.at = 0
        """The first byte that does not belong to a whole record, as far as it was read."""

    @property
    def is_gapless(self) -> bool:
        """No damage was passed over."""
        return True

    def found(self) -> Iterator[Foreign | Message | Gap]:
        """Yield connections, the messages that they belong to, and where damage was passed over."""
        raise NotImplementedError

    def place(self, *, is_whole: bool) -> str:
        """Say where the damage is."""
        if is_whole:
            return "its index is missing or broken, as after a loss of power"
        return f"it is cut short or damaged in what begins at byte {self.at:,} of {self.size:,}"


# the two containers that are records one after the other


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
        self._have(length)
        if length > most:
            raise ValueError(f"{length} bytes are more than {most}")
        return self.stream.read(length)

    def skip(self, length: int) -> None:
        """Leave so many bytes out."""
        self._have(length)
        self.stream.seek(length, os.SEEK_CUR)

    def number(self, width: int) -> int:
        """Read an unsigned number of so many bytes."""
        return int.from_bytes(self.take(width), "little")

    def text(self) -> str:
        """Read a string with its length before it."""
        return self.take(self.number(4)).decode()

    def _have(self, length: int) -> None:
        if length > self.left:
            raise ValueError(f"{length} bytes are wanted, and {self.left} are left")


class _Records(_Scan):
    """A recording whose records lie one after the other, some of them in packed pieces."""

    LIKELY: ClassVar[re.Pattern[bytes]]
    """What the first bytes of a record look like."""
    TAIL = 0
    """Bytes after the last record."""

    def __init__(self, path: Path, wanted: frozenset[int]) -> None:
        super().__init__(path, wanted)
        self.gaps: list[Gap] = []
        self.tried = 0
        self.taken = 0
        """Where the last packed piece ends: it gave what it has, and is not looked into again."""

    @property
    def is_gapless(self) -> bool:
        """No damage was passed over."""
        return not self.gaps

    def found(self) -> Iterator[Foreign | Message | Gap]:
        """Yield connections and messages; `at` moves with the records that do not lie in a packed piece."""
        with self.path.open("rb") as stream:
            source = _Bytes(stream, self.size)
            self._open(source)
            while source.left:
                self.at = source.place
                try:
                    with reading(self.path.name, KIND):
                        last = yield from self._record(source)
                except UnreadableInput:
                    gap = Gap(self.at, self._resumed(source))
                    if gap.end == self.size or len(self.gaps) == MOST_GAPS:
                        raise
                    self.gaps.append(gap)
                    stream.seek(gap.end)
                    yield gap
                    continue
                if last:
                    return

    def place(self, *, is_whole: bool) -> str:
        """Say where the damage is, and of several places where the first is."""
        if not self.gaps:
            return super().place(is_whole=is_whole)
        first, more = self.gaps[0], len(self.gaps) - is_whole
        others = f" and in {counted(more, 'more place')}" if more else ""
        return f"it is damaged from byte {first.begin:,} to {first.end:,} of {self.size:,}{others}"

    def _resumed(self, source: _Bytes) -> int:
        """The byte at which records go on after the one at `at`: at its end, else where a chain of them begins."""
        source.stream.seek(self.at)
        if (end := self._skipped(source)) is not None and self._is_chain(source, end):
            return end
        with mmap.mmap(source.stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
            begin = max(self.at + 1, self.taken)
            while self.tried < MOST_TRIED and (likely := self.LIKELY.search(content, begin)) is not None:
                begin = likely.start() + 1
                self.tried += 1
                if self._is_chain(source, likely.start()):
                    return likely.start()
        return self.size

    def _is_chain(self, source: _Bytes, begin: int) -> bool:
        """Tell whether as many records as make a chain follow one another from here on, or lead to the very end."""
        for _ in range(CHAIN):
            if begin >= self.size - self.TAIL:
                return begin in (self.size - self.TAIL, self.size)
            source.stream.seek(begin)
            end = self._skipped(source)
            if end is None:
                return False
            begin = end
        return True

    def _skipped(self, source: _Bytes) -> int | None:
        """Pass over one record without looking into it: its end; None where none can stand here."""
        raise NotImplementedError

    def _open(self, source: _Bytes) -> None:
        """Read what stands before the records."""
        raise NotImplementedError

    def _record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        """Read one record, and return whether no message comes after it."""
        raise NotImplementedError

    def _inside(self, piece: bytes) -> Iterator[Foreign | Message]:
        """Yield what a piece holds, unpacked."""
        source = _Bytes(BytesIO(piece), len(piece))
        while source.left:
            yield from self._record(source)


class _Bag(_Records):
    """A bag of ROS 1."""

    MESSAGE, CHUNK, CONNECTION = 2, 5, 7
    KINDS = range(2, 8)
    LIKELY = re.compile(rb"(?s)(?=..\x00\x00.\x00\x00\x00[a-z_]{2,}=)")

    def _open(self, source: _Bytes) -> None:
        if source.stream.readline(16) != b"#ROSBAG V2.0\n":
            raise ValueError("only bags of version 2.0 are read")

    def _record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        fields = _fields(source.take(source.number(4)))
        length, kind = source.number(4), fields[b"op"][0]
        if kind == self.CHUNK:
            yield from self._chunk(source, fields[b"compression"], length)
        elif kind == self.CONNECTION:
            yield _connection(fields, _fields(source.take(length)))
        elif kind == self.MESSAGE:
            number, time = int.from_bytes(fields[b"conn"], "little"), fields[b"time"]
            recorded = int.from_bytes(time[:4], "little") * 10**9 + int.from_bytes(time[4:], "little")
            yield Message(number, recorded, self._content(source, number, length))
        else:
            source.skip(length)
        return False

    def _skipped(self, source: _Bytes) -> int | None:
        try:
            fields = _fields(source.take(source.number(4), MOST_HEADER))
            if fields[b"op"][0] not in self.KINDS:
                return None
            length = source.number(4)
            if fields.get(b"compression") != b"none":  # the records of such a chunk come next
                source.skip(length)
        except (ValueError, KeyError, IndexError):
            return None
        return source.place

    def _chunk(self, source: _Bytes, packing: bytes, length: int) -> Iterator[Foreign | Message]:
        """Unpack a chunk; one that was never closed says that it has no bytes, and goes on to the end."""
        if packing == b"none":
            return  # its records come next
        there = min(length or source.left, source.left, MOST_UNPACKED)
        piece = source.take(there, MOST_UNPACKED)
        self.taken = source.place
        yield from self._inside(_unpacked(packing.decode(), piece))
        if length and there != length:
            raise ValueError("a chunk has no end")

    def _content(self, source: _Bytes, number: int, length: int) -> bytes:
        if number in self.wanted:
            return source.take(length)
        source.skip(length)
        return b""


class _Mcap(_Records):
    """A recording of ROS 2 in the container MCAP."""

    HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
    KINDS = range(1, 16)
    TAIL = len(MCAP)
    OVERHEAD = 22
    """Bytes of a message before its content."""
    LIKELY = re.compile(rb"(?s)[\x01-\x0f](?=.{4}\x00{4})")

    def __init__(self, path: Path, wanted: frozenset[int]) -> None:
        super().__init__(path, wanted)
        self.schemas: dict[int, Foreign] = {}
        self.channels: set[int] = set()

    def _open(self, source: _Bytes) -> None:
        source.skip(len(MCAP))
        if source.number(1) != self.HEADER:
            raise ValueError("it does not begin with its header")
        header = source.take(source.number(8))
        if _Bytes(BytesIO(header), len(header)).text() != "ros2":
            raise ValueError("it is not one of ROS 2")

    def _record(self, source: _Bytes) -> Generator[Foreign | Message, None, bool]:
        kind, length = source.number(1), source.number(8)
        if kind == self.CHUNK:
            yield from self._chunk(source)
        elif kind == self.MESSAGE:
            number, _, recorded, _ = source.number(2), source.number(4), source.number(8), source.number(8)
            rest = length - self.OVERHEAD
            if rest < 0:
                raise ValueError("a message is shorter than what stands before it")
            if number not in self.wanted:
                source.skip(rest)
            yield Message(number, recorded, source.take(rest) if number in self.wanted else b"")
        elif kind in (self.SCHEMA, self.CHANNEL):
            content = _Bytes(BytesIO(source.take(length)), length)
            yield from self._schema(content) if kind == self.SCHEMA else self._channel(content)
        elif not kind:
            raise ValueError("no record has the number 0")
        else:
            source.skip(length)
        return kind in (self.DATA_END, self.FOOTER)

    def _skipped(self, source: _Bytes) -> int | None:
        try:
            kind, length = source.number(1), source.number(8)
            if kind not in self.KINDS or (kind == self.MESSAGE and length < self.OVERHEAD):
                return None
            end = source.place + length
            if kind == self.MESSAGE and source.number(2) not in self.channels:
                return None
            if kind == self.CHUNK:
                _, checked, packing, _ = self._chunk_header(source)
                if not packing and not checked:
                    return source.place
            source.skip(end - source.place)
        except ValueError:
            return None
        return source.place

    def _chunk(self, source: _Bytes) -> Iterator[Foreign | Message]:
        """Unpack a chunk, and check its sum; of one that is cut, as much as is there."""
        size, checked, packing, length = self._chunk_header(source)
        if not packing and not checked:
            return  # its records come next
        there = min(length, source.left)
        packed = source.take(there, MOST_UNPACKED)
        self.taken = source.place
        piece = _unpacked(packing, packed)
        if there == length and (len(piece) != size or (checked and crc32(piece) != checked)):
            raise ValueError("a chunk is not what it was")
        yield from self._inside(piece)
        if there != length:
            raise ValueError("a chunk has no end")

    @staticmethod
    def _chunk_header(source: _Bytes) -> tuple[int, int, str, int]:
        """Size of what is in a chunk, its sum (0 for none), how it is packed, and the size of that."""
        source.skip(16)
        return source.number(8), source.number(4), source.text(), source.number(8)

    def _schema(self, content: _Bytes) -> Iterator[Foreign]:
        number = content.number(2)
        container = needs("rosbags.rosbag2.storage_mcap", "ros", KIND)
        self.schemas[number] = container.Schema(number, content.text(), content.text(), content.text())
        yield from ()

    def _channel(self, content: _Bytes) -> Iterator[Foreign]:
        number, schema = content.number(2), self.schemas.get(content.number(2))
        self.channels.add(number)
        definition = needs("rosbags.rosbag2.storage_mcap", "ros", KIND).get_msgdef(schema)
        yield _like_rosbags(number, content.text(), schema.name if schema else "", definition)


# the one that is a database


class _Database(_Scan):
    """A recording of ROS 2 in a database of SQLite, of which all is read that its pages still give."""

    def found(self) -> Iterator[Foreign | Message]:
        """Yield connections and messages, in the order of their rows."""
        with _whole_pages(self.path) as path:
            apsw = needs("apsw", "ros", KIND)
            read_only = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
            database = apsw.Connection(f"{path.absolute().as_uri()}?immutable=1", flags=read_only)
            try:
                database.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_RECORD)
                database.execute("PRAGMA writable_schema = ON")  # else a file shorter than it says is refused
                yield from self._topics(database, apsw)
                yield from self._messages(database)
            finally:
                database.close()

    def place(self, *, is_whole: bool) -> str:
        """Say after which row the damage is."""
        if is_whole:
            return "its index is broken"
        return f"the database is cut short or damaged after row {self.at:,}"

    def _messages(self, database: Foreign) -> Iterator[Message]:
        wanted = ",".join(map(str, self.wanted))
        columns = f"id, topic_id, timestamp, CASE WHEN topic_id IN ({wanted}) THEN data END"
        for row, number, recorded, packed in database.execute(f"SELECT {columns} FROM messages"):
            if row <= self.at:
                raise ValueError("rows come again")
            message = Message(int(number), int(recorded), packed or b"")
            self.at = row
            yield message

    def _topics(self, database: Foreign, apsw: Foreign) -> Iterator[Foreign]:
        formats = needs("rosbags.interfaces", "ros", KIND).MessageDefinitionFormat
        known = {"ros2msg": formats.MSG, "ros2idl": formats.IDL}
        definition = needs("rosbags.interfaces", "ros", KIND).MessageDefinition
        definitions: dict[str, Foreign] = {}
        try:
            for kind, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                definitions[kind] = definition(known[encoding], text)
        except apsw.Error:
            pass  # recordings before Iron have none
        for number, topic, kind in database.execute("SELECT id, name, type FROM topics"):
            yield _like_rosbags(number, topic, kind, definitions.get(kind) or definition(formats.NONE, ""))


@contextmanager
def _whole_pages(path: Path) -> Iterator[Path]:
    """The database without the part of a page at its end, which SQLite would fill up with zeros."""
    with path.open("rb") as stream, TemporaryDirectory(prefix="flinders-") as folder:
        page = int.from_bytes(stream.read(18)[16:], "big")
        left = path.stat().st_size
        over = left % (65536 if page == 1 else page)
        if not over:
            yield path
            return
        copy, left = Path(folder) / "pages.db3", left - over
        stream.seek(0)
        with copy.open("wb") as written:
            while left and (chunk := stream.read(min(CHUNK, left))):
                left -= written.write(chunk)
        yield copy


# the parts


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
    definition = interfaces.MessageDefinition(
        interfaces.MessageDefinitionFormat.MSG, inner[b"message_definition"].decode()
    )
    topic = needs("rosbags.rosbag1.reader", "ros", KIND).normalize(fields[b"topic"].decode())
    kind = types.normalize_msgtype(inner[b"type"].decode())
    return _like_rosbags(int.from_bytes(fields[b"conn"], "little"), topic, kind, definition)


def _like_rosbags(number: int, topic: str, kind: str, definition: Foreign) -> Foreign:
    """Make a connection as rosbags does, of what is asked of one."""
    return needs("rosbags.interfaces", "ros", KIND).Connection(number, topic, kind, definition, "", 0, None, None)


def _unpacked(packing: str, packed: bytes) -> bytes:
    """Unpack a piece, up to `MOST_UNPACKED` bytes; of one that is cut, as much as is there."""
    if not packing:
        return packed
    unpackers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": needs("lz4.frame", "ros", KIND).LZ4FrameDecompressor,
        "zstd": needs("rosbags.rosbag2.storage_mcap", "ros", KIND).zstd.ZstdDecompressor,
    }
    content: bytes = unpackers[packing]().decompress(packed, max_length=MOST_UNPACKED)
    return content
