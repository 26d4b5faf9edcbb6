r"""Messages of ArduPilot's DataFlash logs, which describe themselves: FMT messages name the fields of all others.

A binary message is the bytes A3 95, its type, and its fields packed without gaps, in the order and with the letters
that the FMT message of its type gives. The starts of all messages are found by following their lengths, for thousands
at a time; the fields of one name are then read as one strided view of the file, which stays on the disk.

>>> import struct
>>> def fmt(number, length, name, letters, labels):
...     return struct.pack("<BBBBB4s16s64s", 0xA3, 0x95, 128, number, length, name, letters, labels)
>>> said = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns") + fmt(7, 9, b"HI", b"hf", b"N,X")
>>> log = said + b"".join(struct.pack("<BBBhf", 0xA3, 0x95, 7, n, n / 2) for n in range(3))
>>> read_packed(np.frombuffer(log, np.uint8), ["HI"])["HI"].column("X")
array([0. , 0.5, 1. ])
>>> broken = read_packed(np.frombuffer(log[:-9] + b"what is this" + log[-9:], np.uint8), ["HI"])
>>> broken["HI"].column("X"), broken.strays         # nor is the message before broken bytes to be trusted: 9 + 12
(array([0., 1.]), 21)

Source: ArduPilot's ``libraries/AP_Logger/README.md`` and ``LogStructure.h`` for the letters and their factors.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from dataclasses import dataclass, field
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
"""Which bytes a name may hold."""
LONGEST: Final = 255
"""Bytes of a message at most: its length is one byte."""
CHUNK: Final = 4 << 20
"""Bytes looked through at a time."""

LETTERS: Final[dict[str, tuple[str, float]]] = {
    "b": ("<i1", 1), "B": ("<u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1), "I": ("<u4", 1),
    "q": ("<i8", 1), "Q": ("<u8", 1), "f": ("<f4", 1), "d": ("<f8", 1), "g": ("<f2", 1), "M": ("<u1", 1),
    "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7),
    "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1), "a": ("V64", 1),
}  # fmt: skip
"""How each letter of a format is packed, and what it is multiplied by."""
CHARACTERS: Final = "nNZa"
"""Letters of fields that are no numbers."""


class Format(NamedTuple):
    """What an FMT message says.

    Attributes
    ----------
    number, length : int
        Type, and bytes of a whole message.
    name : str
    letters : str
        One a field.
    labels : tuple of str
    """

    number: int
    length: int
    name: str
    letters: str
    labels: tuple[str, ...]

    @property
    def is_readable(self) -> bool:
        """All letters are known, and the fields fit into the length."""
        known = all(letter in LETTERS for letter in self.letters) and len(self.labels) <= len(self.letters)
        return known and HEADER_SIZE + sum(np.dtype(LETTERS[each][0]).itemsize for each in self.letters) <= self.length

    def place(self, label: str) -> tuple[int, str]:
        """Where a field begins in a message, and its letter."""
        index = self.labels.index(label)
        before = sum(np.dtype(LETTERS[each][0]).itemsize for each in self.letters[:index])
        return HEADER_SIZE + before, self.letters[index]


@dataclass(frozen=True, slots=True, eq=False)
class Packed:
    """Messages of one name in a binary log.

    Attributes
    ----------
    raw : (size,) uint8
        The whole log.
    format : Format
    where : (N,) int64
        At which byte each begins; ascending.
    copies : (N, length) bytes, optional
        Copies of them, one after the other.
    """

    raw: Bytes
    format: Format
    where: Places
    copies: Bytes | None = None

    def __len__(self) -> int:
        return len(self.where)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the fields."""
        return self.format.labels

    def is_whole(self, label: str) -> bool:
        """Whether a field holds integers."""
        return self.format.place(label)[1] in "bBhHiIqQM"

    def column(self, label: str) -> Floats:
        """(N,) a field, in the unit of its letter; NaN where it holds characters."""
        letter = self.format.place(label)[1]
        if letter in CHARACTERS:
            return np.full(len(self), np.nan)
        scale = LETTERS[letter][1]
        values = self._bare(label).astype(np.float64)
        return values if scale == 1 else values * scale

    def texts(self, label: str) -> list[str]:
        """A field of characters."""
        return [each.partition(b"\0")[0].decode("ascii", "replace") for each in self._bare(label).tolist()]

    def only(self, rows: slice | NDArray[Any]) -> Packed:
        """Some of them."""
        return Packed(self.raw, self.format, self.where[rows])

    def copied(self) -> Packed:
        """The same with their bytes side by side: each is fetched once, and no more for each of its fields."""
        length = self.format.length
        whole = self._at_each_byte(np.dtype(f"V{length}"), 0)[self.where]
        return Packed(self.raw, self.format, self.where, whole.view(np.uint8).reshape(len(self), length))

    def _bare(self, label: str) -> NDArray[Any]:
        """(N,) as it is packed."""
        offset, letter = self.format.place(label)
        kind = np.dtype(LETTERS[letter][0])
        if self.copies is None or not len(self):
            return self._at_each_byte(kind, offset)[self.where]
        return np.ndarray((len(self),), kind, self.copies.data, offset, (self.format.length,))

    def _at_each_byte(self, kind: np.dtype[Any], offset: int) -> NDArray[Any]:
        """The view of the file that begins at each of its bytes, or so many behind it."""
        count = max(len(self.raw) - offset - kind.itemsize + 1, 0)
        return np.ndarray((count,), kind, self.raw.data, offset, (1,)) if count else np.empty(0, kind)


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """Messages of one name in a log that was turned into text.

    Attributes
    ----------
    labels : tuple of str
    letters : str
    rows : dict
        Values by label: numbers, or texts where they are none.
    where : (N,) int64
        On which line each stands, ascending.
    """

    labels: tuple[str, ...]
    letters: str
    rows: dict[str, Any]
    where: Places

    def __len__(self) -> int:
        return len(self.where)

    def is_whole(self, label: str) -> bool:
        """Whether a field holds integers."""
        return self.letters[self.labels.index(label)] in "bBhHiIqQM"

    def column(self, label: str) -> Floats:
        """(N,) a field, in the unit that the text is in; NaN where it holds characters."""
        if self.letters[self.labels.index(label)] in CHARACTERS:
            return np.full(len(self), np.nan)
        return np.asarray(self.rows[label], np.float64)

    def texts(self, label: str) -> list[str]:
        """A field of characters."""
        return [str(each) for each in self.rows[label]]

    def copied(self) -> Listed:
        """The same: their values are side by side already."""
        return self

    def only(self, rows: slice | NDArray[Any]) -> Listed:
        """Some of them."""
        chosen = np.arange(len(self))[rows]
        columns = {label: [values[row] for row in chosen] for label, values in self.rows.items()}
        return Listed(self.labels, self.letters, columns, self.where[chosen])


Table: TypeAlias = Packed | Listed


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """What was wanted of a log.

    Attributes
    ----------
    tables : dict of Table
        By name; those of which there is at least one message.
    strays : int
        Bytes, or lines, that belong to no message.
    gaps : int
        In how many places they are.
    """

    tables: dict[str, Table] = field(default_factory=dict)
    strays: int = 0
    gaps: int = 0

    def __getitem__(self, name: str) -> Table:
        return self.tables[name]

    def get(self, name: str) -> Table | None:
        """Those of a name, if there are any."""
        return self.tables.get(name)


def read_packed(raw: Bytes, wanted: Collection[str]) -> Messages:
    """Find the messages of some names in a binary log.

    Parameters
    ----------
    raw : (size,) uint8
        The log; a memory map is gone through `CHUNK` by `CHUNK`.
    wanted : collection of str
        Names.
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
            tables.setdefault(formats[number].name, Packed(raw, formats[number], where))
    return Messages(tables, len(raw) - known, gaps)


class _Segment(NamedTuple):
    """A part of a log, and where in it messages might begin.

    Attributes
    ----------
    raw : (size,) uint8
        The whole log.
    at, stop : int
        The part; `window` goes on for a message or two.
    headers : (N,) int64
        Where the two bytes of a header stand, from `at`.
    """

    raw: Bytes
    at: int
    stop: int
    headers: Places

    @classmethod
    def of(cls, raw: Bytes, at: int, stop: int) -> _Segment:
        """Look for the two bytes that begin a message."""
        window = raw[at : stop + LONGEST + HEADER_SIZE]
        first = np.flatnonzero(window[:-2] == HEADER[0])
        return cls(raw, at, stop, first[window[first + 1] == HEADER[1]])

    def formats(self) -> Iterator[Format]:
        """Yield what FMT messages there are."""
        headers = self.at + self.headers
        headers = headers[(self.raw[headers + 2] == FMT_TYPE) & (headers + FMT_LENGTH <= len(self.raw))]
        names = self.raw[headers[:, np.newaxis] + NAME_BYTES]
        for header in headers[IN_NAMES[names].all(axis=1)].tolist():
            if (each := _format(bytes(self.raw[header : header + FMT_LENGTH]))) is not None:
                yield each

    def follow(self, lengths: Places) -> tuple[Places, int, int]:
        """Go from message to message by their lengths; after broken bytes, to the next that another one follows.

        Parameters
        ----------
        lengths : (256,) int64
            Of the messages of each type; 0 where that is not known.

        Returns
        -------
        (M,) int64, int, int
            At which bytes messages begin; where the next stretch begins; in how many places bytes were skipped.
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
        """Where to go on where no header is left: behind the last message, and not before the end of the stretch."""
        behind = int(after[taken[-1]]) if len(taken) else 0
        return max(behind, self.stop - self.at)


def read_listed(lines: Iterable[tuple[int, str]], wanted: Collection[str]) -> Messages:
    """Find the messages of some names in a log that was turned into text.

    Parameters
    ----------
    lines : iterable of (int, str)
        With their numbers: ``MAG, 11477, 217, 4, -586``.
    wanted : collection of str
        Names.
    """
    formats: dict[str, Format] = {}
    columns: dict[str, list[Any]] = {}
    where: dict[str, array[int]] = {}
    strays = gaps = 0
    last_stray = -1
    for number, line in lines:
        name, _, rest = line.partition(",")
        name = name.strip()
        if name == "FMT":
            if (each := _listed_format(rest)) is not None:
                formats.setdefault(each.name, each)
        elif name in wanted and name in formats:
            values = _cells(rest, formats[name])
            if values is None:
                strays, gaps = strays + 1, gaps + (last_stray != number - 1)
                last_stray = number
                continue
            holders = columns.setdefault(name, [_holder(letter) for letter in formats[name].letters])
            for column, value in zip(holders, values, strict=False):
                column.append(value)
            where.setdefault(name, array("q")).append(number)
    tables: dict[str, Table] = {
        name: Listed(
            formats[name].labels,
            formats[name].letters,
            dict(zip(formats[name].labels, columns[name], strict=False)),
            np.array(rows, np.int64),
        )
        for name, rows in where.items()
    }
    return Messages(tables, strays, gaps)


def _next(places: Places, least: int, otherwise: int) -> int:
    """Find the first of ascending places that is no less."""
    index = int(np.searchsorted(places, least))
    return int(places[index]) if index < len(places) else otherwise


def _format(packed: bytes) -> Format | None:
    """Read an FMT message, or nothing where the bytes are none."""
    number, length, *texts = FMT_FIELDS.unpack(packed)
    name, letters, labels = (each.partition(b"\0")[0] for each in texts)
    if not (name.isalnum() and name.isascii() and length >= HEADER_SIZE and letters.isascii() and labels.isascii()):
        return None
    named = tuple(label.strip() for label in labels.decode().split(",") if label.strip())
    return Format(number, length, name.decode(), letters.decode(), named)


def _listed_format(rest: str) -> Format | None:
    """Read ``128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns``."""
    parts = [part.strip() for part in rest.split(",")]
    if len(parts) < 4 or not (parts[0].isdigit() and parts[1].isdigit()):
        return None
    return Format(int(parts[0]), int(parts[1]), parts[2], parts[3], tuple(part for part in parts[4:] if part))


def _holder(letter: str) -> Any:  # noqa: ANN401 - numbers side by side, or a list of texts
    return [] if letter in CHARACTERS else array("d")


def _cells(rest: str, format: Format) -> list[Any] | None:
    """Values of a line, or nothing where they are too few or no numbers; a text at the end may hold commas."""
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
