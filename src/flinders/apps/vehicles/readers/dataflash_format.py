r"""Messages of ArduPilot's DataFlash logs, which describe themselves: FMT messages name the fields of all others.

A binary message is the bytes A3 95, its type, and its fields packed without gaps, in the order and with the letters
that the FMT message of its type gives. The reader finds the starts of all messages by their lengths, thousands at a
time; then it copies the messages of the wanted names and reads their fields as strided views.

>>> import struct
>>> def fmt(number, length, name, letters, labels):
...     return struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, number, length, name, letters, labels)
>>> said = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns") + fmt(7, 9, b"HI", b"hf", b"N,X")
>>> log = said + b"".join(struct.pack("<BBBhf", 0xA3, 0x95, 7, n, n / 2) for n in range(3))
>>> read_packed(np.frombuffer(log, np.uint8), ["HI"])["HI"].column("X")
array([0. , 0.5, 1. ])
>>> broken = read_packed(np.frombuffer(log[:-9] + b"what is this" + log[-9:], np.uint8), ["HI"])
>>> broken["HI"].column("X"), broken.skipped         # the message before the damage is dropped too: 9 + 12
(array([0., 1.]), 21)

Source: ArduPilot's ``libraries/AP_Logger/README.md`` and ``LogStructure.h`` for the letters and their factors.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from dataclasses import dataclass
from itertools import accumulate
from struct import Struct
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from flinders.arrays import Floats

Bytes: TypeAlias = NDArray[np.uint8]
Places: TypeAlias = NDArray[np.int64]

HEADER: Final = b"\xa3\x95"
HEADER_SIZE: Final = 3
FMT_TYPE, FMT_LENGTH = 128, 89
FMT_FIELDS: Final = Struct("<3xBB4s16s64s")
NAME_BYTES: Final = np.arange(5, 9)
IN_NAMES: Final = np.array([byte == 0 or (chr(byte).isalnum() and byte < 128) for byte in range(256)])
"""(256,) whether a name may hold the byte."""
MAX_MESSAGE_BYTES: Final = 255
"""Largest message in bytes: its length is one byte."""
CHUNK: Final = 4 << 20
"""Number of bytes that are processed at a time."""

LETTERS: Final[dict[str, tuple[str, float]]] = {
    "b": ("<i1", 1), "B": ("<u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1), "I": ("<u4", 1),
    "q": ("<i8", 1), "Q": ("<u8", 1), "f": ("<f4", 1), "d": ("<f8", 1), "g": ("<f2", 1), "M": ("<u1", 1),
    "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7),
    "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1), "a": ("V64", 1),
}  # fmt: skip
"""NumPy type of each letter of a format, and the factor of its values."""
KINDS: Final = {letter: np.dtype(kind) for letter, (kind, _) in LETTERS.items()}
CHARACTERS, WHOLE = "nNZa", "bBhHiIqQM"
"""Letters of text fields, and of integer fields."""
CLOCKS: Final = {"TimeUS": 1e-6, "TimeMS": 1e-3}
INSTANCE: Final = ("I", "Instance", "Inst")


class Format(NamedTuple):
    """Content of an FMT message: type, length in bytes and name of a message; letter and label of each field."""

    number: int
    length: int
    name: str
    letters: str
    labels: tuple[str, ...]

    @property
    def places(self) -> list[int]:
        """Byte of a message at which each field begins, then the end of the last field."""
        return [*accumulate((KINDS[letter].itemsize for letter in self.letters), initial=HEADER_SIZE)]

    @property
    def is_readable(self) -> bool:
        """Whether all letters are known, and the fields fit into the length."""
        known = all(letter in LETTERS for letter in self.letters) and len(self.labels) <= len(self.letters)
        return known and self.places[-1] <= self.length


class Field(NamedTuple):
    """(N,) values of a field as stored, its letter, and the factor of the values."""

    letter: str
    stored: NDArray[Any]
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Messages of one name, as columns of fields."""

    fields: dict[str, Field]  # by label
    where: Places  # (N,) int64: first byte of each message, or its line in a text log; ascending

    @classmethod
    def from_bytes(cls, raw: Bytes, format: Format, where: Places) -> Table:
        """Return a table of the messages that begin at some bytes of a binary log."""
        whole = np.dtype(f"V{format.length}")
        at_each_byte = np.ndarray((len(raw) - format.length + 1,), whole, raw.data, 0, (1,))
        messages = at_each_byte[where]
        fields = {
            label: Field(
                letter,
                np.ndarray((len(where),), KINDS[letter], messages.view(np.uint8).data, place, (format.length,)),
                LETTERS[letter][1],
            )
            for label, letter, place in zip(format.labels, format.letters, format.places, strict=False)
        }
        return cls(fields, where)

    def __len__(self) -> int:
        return len(self.where)

    def column(self, label: str) -> Floats:
        """(N,) values of a field; NaN for text."""
        letter, stored, scale = self.fields[label]
        if letter in CHARACTERS:
            return np.full(len(self), np.nan)
        values = stored.astype(np.float64)
        return values if scale == 1 else values * scale

    def columns(self, *labels: str) -> Floats:
        """(N, k) values of several fields."""
        return np.column_stack([self.column(label) for label in labels])

    def triple(self, prefix: str) -> Floats | None:
        """(N, 3) values of the fields prefix + X, Y, Z; None if one is missing."""
        labels = [f"{prefix}{axis}" for axis in "XYZ"]
        return self.columns(*labels) if self.has(*labels) else None

    def texts(self, label: str) -> list[str]:
        """(N,) texts of a field."""
        stored = self.fields[label].stored
        if stored.dtype.kind != "S":
            return [str(each) for each in stored]
        return [each.partition(b"\0")[0].decode("ascii", "replace") for each in stored.tolist()]

    def has(self, *labels: str) -> bool:
        """Whether the messages have these fields."""
        return self.fields.keys() >= set(labels)

    def first(self, labels: tuple[str, ...]) -> str | None:
        """First of some labels that exists, or None."""
        return next((label for label in labels if label in self.fields), None)

    def only(self, rows: slice | NDArray[Any]) -> Table:
        """Return a table of some of the rows."""
        fields = {label: field._replace(stored=field.stored[rows]) for label, field in self.fields.items()}
        return Table(fields, self.where[rows])

    def of_instance(self, instance: float | None = None) -> Table | None:
        """Messages of one instance, by default the first; None if instances are not numbered."""
        label = self.first(INSTANCE)
        if label is None:
            return None
        instances = self.column(label)
        return self.only(instances == (instances.min() if instance is None else instance))

    @property
    def seconds(self) -> Floats | None:
        """(N,) s since power-on; None if not logged."""
        label = self.first(tuple(CLOCKS))
        return None if label is None else self.column(label) * CLOCKS[label]


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Wanted messages of a log, and the amount of unreadable data."""

    tables: dict[str, Table]  # by name; only names with at least one message
    skipped: int = 0  # number of bytes or lines outside messages
    gaps: int = 0  # number of places with such bytes or lines
    is_text: bool = False  # whether the log is text; then places are lines, not bytes

    def __getitem__(self, name: str) -> Table:
        return self.tables[name]

    def get(self, name: str) -> Table | None:
        """Messages of a name, or None."""
        return self.tables.get(name)


def read_packed(raw: Bytes, wanted: Collection[str]) -> Messages:
    """Find the messages of some names in a binary log.

    `raw` is the log as (size,) uint8, read `CHUNK` bytes at a time, as it may be a memory map; `wanted` are the names.
    """
    formats = {FMT_TYPE: Format(FMT_TYPE, FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    lengths = np.zeros(256, np.int64)
    lengths[FMT_TYPE] = FMT_LENGTH
    places: dict[int, list[Places]] = {}
    at, known, gaps = 0, 0, 0
    while at < len(raw):
        stretch = _Segment.of(raw, at, min(at + CHUNK, len(raw)))
        for each in stretch.formats():
            formats.setdefault(each.number, each)
            lengths[each.number] = formats[each.number].length
        starts, at, broken = stretch.follow(lengths)
        gaps += broken
        types = raw[starts + 2]
        known += int(lengths[types].sum())
        for number in [number for number, each in formats.items() if each.name in wanted]:
            places.setdefault(number, []).append(starts[types == number])
    tables: dict[str, Table] = {}
    for number, parts in places.items():
        where = np.concatenate(parts)
        if formats[number].is_readable and len(where):
            tables.setdefault(formats[number].name, Table.from_bytes(raw, formats[number], where))
    return Messages(tables, len(raw) - known, gaps)


class _Segment(NamedTuple):
    """A part of a log, and the places where messages might begin."""

    raw: Bytes  # (size,) uint8: the whole log
    at: int  # first byte of the part
    stop: int  # end of the part in bytes; messages that begin before it may end after it
    headers: Places  # (N,) int64: places of the two header bytes, relative to `at`

    @classmethod
    def of(cls, raw: Bytes, at: int, stop: int) -> _Segment:
        """Find the places in a part of a log where the two bytes of a header are, and messages may begin."""
        window = raw[at : stop + MAX_MESSAGE_BYTES + HEADER_SIZE]
        first = np.flatnonzero(window[:-2] == HEADER[0])
        return cls(raw, at, stop, first[window[first + 1] == HEADER[1]])

    def formats(self) -> Iterator[Format]:
        """Yield the formats of the FMT messages."""
        headers = self.at + self.headers
        headers = headers[(self.raw[headers + 2] == FMT_TYPE) & (headers + FMT_LENGTH <= len(self.raw))]
        names = self.raw[headers[:, np.newaxis] + NAME_BYTES]
        for header in headers[IN_NAMES[names].all(axis=1)].tolist():
            if (each := _format(bytes(self.raw[header : header + FMT_LENGTH]))) is not None:
                yield each

    def follow(self, lengths: Places) -> tuple[Places, int, int]:
        """Follow messages by their lengths; after damage, continue where two messages follow each other.

        `lengths` are the (256,) int64 message lengths by type, 0 for an unknown type. Returns the (M,) int64 first
        bytes of the messages, the first byte of the next part, and the number of places with skipped bytes.
        """
        count, end = len(self.headers), len(self.raw) - self.at
        steps = lengths[self.raw[self.at + self.headers + 2]]
        after, known = self.headers + steps, np.append(steps > 0, False)
        follower, linked = np.arange(1, count + 1), known[:-1] & known[1:]
        apart = np.flatnonzero(after != np.append(self.headers[1:], -1))
        follower[apart] = np.searchsorted(self.headers, after[apart])
        landed = np.append(self.headers, -1)[follower[apart]] == after[apart]
        linked[apart] = known[apart] & ((landed & known[follower[apart]]) | (after[apart] == end))
        breaks = ~linked
        breaks[apart] = True
        stops = np.flatnonzero(breaks).tolist()
        good = np.flatnonzero(linked)
        limit = int(np.searchsorted(self.headers, self.stop - self.at))
        chosen, place, broken = np.zeros(count, bool), 0, 0
        if not (len(good) and good[0] == 0 and self.headers[0] == 0):
            place, broken = _next(good, 0, count), 1
        while place < limit:
            last = stops[bisect_left(stops, place)]
            chosen[place:last] = True
            if linked[last]:
                chosen[last], place = True, int(follower[last])
            else:
                place, broken = _next(good, last + 1, count), broken + 1
        taken = np.flatnonzero(chosen[:limit])
        resume = int(self.headers[place]) if place < count else self._beyond(after, taken)
        return self.at + self.headers[taken], self.at + resume, broken

    def _beyond(self, after: Places, taken: Places) -> int:
        """Byte to continue from if no header follows: the end of the last message or of the part, if that is later."""
        behind = int(after[taken[-1]]) if len(taken) else 0
        return max(behind, self.stop - self.at)


def read_text(lines: Iterable[tuple[int, str]], wanted: Collection[str]) -> Messages:
    """Find the messages of some names in a text log.

    `lines` are line numbers and texts such as ``MAG, 11477, 217, 4, -586``; `wanted` are the names.
    """
    formats: dict[str, Format] = {}
    columns: dict[str, list[Any]] = {}
    where: dict[str, array[int]] = {}
    skipped = gaps = 0
    last_skipped = -1
    for number, line in lines:
        name, _, rest = line.partition(",")
        name = name.strip()
        if name == "FMT":
            if (each := _text_format(rest)) is not None:
                formats.setdefault(each.name, each)
        elif name in wanted and name in formats:
            values = _cells(rest, formats[name])
            if values is None:
                skipped, gaps = skipped + 1, gaps + (last_skipped != number - 1)
                last_skipped = number
                continue
            if name not in columns:
                columns[name] = [_holder(letter) for letter in formats[name].letters]
            for column, value in zip(columns[name], values, strict=False):
                column.append(value)
            where.setdefault(name, array("q")).append(number)
    tables: dict[str, Table] = {}
    for name, rows in where.items():
        stored = [np.array(values, object if isinstance(values, list) else float) for values in columns[name]]
        fields = dict(zip(formats[name].labels, map(Field, formats[name].letters, stored), strict=False))
        tables[name] = Table(fields, np.array(rows, np.int64))
    return Messages(tables, skipped, gaps, is_text=True)


def _next(places: Places, least: int, otherwise: int) -> int:
    """First of ascending places that is at least `least`, else `otherwise`."""
    index = int(np.searchsorted(places, least))
    return int(places[index]) if index < len(places) else otherwise


def _format(packed: bytes) -> Format | None:
    """Read an FMT message; None for other bytes."""
    number, length, *texts = FMT_FIELDS.unpack(packed)
    name, letters, labels = (each.partition(b"\0")[0] for each in texts)
    if not (name.isalnum() and name.isascii() and length >= HEADER_SIZE and letters.isascii() and labels.isascii()):
        return None
    named = tuple(label.strip() for label in labels.decode().split(",") if label.strip())
    return Format(number, length, name.decode(), letters.decode(), named)


def _text_format(rest: str) -> Format | None:
    """Read an FMT line of a text log, such as ``128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns``."""
    parts = [part.strip() for part in rest.split(",")]
    if len(parts) < 4 or not (parts[0].isdecimal() and parts[1].isdecimal()):
        return None
    labels = tuple(part for part in parts[4:] if part)
    return Format(int(parts[0]), int(parts[1]), parts[2], parts[3][: len(labels)], labels)


def _holder(letter: str) -> Any:  # noqa: ANN401 - an array of numbers, or a list of texts
    return [] if letter in CHARACTERS else array("d")


def _cells(rest: str, format: Format) -> list[Any] | None:
    """Values of a line; None if they are too few, or not numbers. A text at the end of the line may contain commas."""
    parts = rest.split(",", len(format.labels) - 1)
    if len(parts) < len(format.labels):
        return None
    try:
        return [
            part.strip() if letter in CHARACTERS else float(part)
            for part, letter in zip(parts, format.letters, strict=False)
        ]
    except ValueError:
        return None
