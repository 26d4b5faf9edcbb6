"""Several devices in one table, distinguished by a column such as ``id``, ``node`` or ``address``.

A column distinguishes devices if its name says so and it repeats a few words. A counter has too many different words;
the name of a label, a quality or a trial says something else.

>>> [name for name in ("id", "NodeID", "mac address", "trial_id", "accuracy", "mag_x", "seq") if names_device(name)]
['id', 'NodeID', 'mac address']
>>> rows = [("3", "b4:a1"), ("0", "b4:07")] * 5
>>> [device.name for device in devices_in(["id", "mac"], (0, 1), lambda: iter(rows))]
['id=0', 'id=3']
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from flinders.readers._cells import parse_number
from flinders.readers._instruments import magnetometers
from flinders.readers._names import ACCELERATION, FIELD, RATE, Meaning, meaning, words_of
from flinders.readers._tokenizer import QUANTITY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    Rows: TypeAlias = Callable[[], Iterator[tuple[str, ...]]]

MAX_DEVICES: Final = 64
"""Largest number of different words in a column of devices; a counter has more."""
MAX_NUMBERED: Final = 8
"""Largest number of different numbers in a device column without a name."""
MIN_READINGS: Final = 3
"""Smallest number of readings of a device; a rarer word may be an error."""
MIN_READINGS_IN_A_ROW: Final = 20
"""Smallest number of readings of a device that has one contiguous block, which may be just a part of a recording."""
MIN_SHARE: Final = 0.9
"""Smallest share of rows that belong to devices with enough readings."""
MAX_LETTERS: Final = 64
"""Largest length of a device name, in characters."""
INSTANCE: Final = "I"
CLOCK_OF_INSTANCES: Final = "TimeUS"
MAX_SENSORS: Final = 32
"""Largest number of different words in a column that names the sensor of each row."""
MIN_LETTERS: Final = 3
"""Smallest length of a word that names a sensor, in letters; ``A`` and ``M`` may be states."""
_SENSOR: Final = re.compile(r"(sensor|type|kind|name|source|topic|stream|signal|modality)s?")
"""Words in names of columns that name the sensor of each row."""
_DEVICE: Final = re.compile(
    r"(id|uid|uuid|guid|eui|imei|sn|(dev|device|node|mote|sensor|imu|board|module|probe|chip|unit|instrument|logger"
    r"|magnetometer|compass|robot|drone|vehicle|agent|phone|beacon|serial|mac|ip|hw|address|addr|host|client|sender"
    r"|channel|port|slave|instance|bus|mux)(id|no|nr|num|number|name|addr|address|key|eui)?s?)"
)
"""Words in names of columns that distinguish devices."""
_PIECES: Final = re.compile(r"[0-9]+|[^0-9]+")
_AROUND: Final = " \"'()[]:#,;"  # characters around a word that are ignored
_ADDRESS: Final = re.compile(
    r"[\da-f]{2}([:-][\da-f]{2})+|\d+(\.\d+){3}|0x[\da-f]+|[a-z]{1,16}[-_#]?\d{1,8}|[\da-f]{8,32}", re.IGNORECASE
)
_OTHER_MEANINGS: Final = re.compile(
    r"trial|session|run|test|exp|experiment|label|class|category|activity|state|status|mode|quality|accuracy|acc|cal"
    r"|calib|event|msg|message|packet|frame|seq|sequence|sample|reading|row|record|recording|line|index|idx|count"
    r"|counter|time|timestamp|date|day|lap|track|path|trip|segment|section|step|phase|epoch|block|batch|group|set"
    r"|position|pos|pose|orientation|location|place|room|user|subject|participant|person|driver|operator|gesture"
    r"|motion|action|fold|split|cluster|survey|shot|leg|waypoint|mission|flight|log|file|temp|temperature|type"
)
"""Words in names of columns with another meaning, also as in ``trial_id``."""


@dataclass(frozen=True, slots=True)
class Device:
    """One of several devices in a table, identified by the words in certain columns of its rows."""

    cells: tuple[int, ...]  # places of the columns
    columns: tuple[str, ...]  # names of the columns
    words: tuple[str, ...]  # words in these columns

    @property
    def name(self) -> str:
        """Name of the device, such as ``id=3``."""
        return " ".join(f"{column}={word}" for column, word in zip(self.columns, self.words, strict=True))

    def is_of_other(self, cells: Sequence[str]) -> bool:
        """Whether a row belongs to another device; a row that is cut short counts as one of this device."""
        return any(
            cell < len(cells) and normalise_word(cells[cell]) != word
            for cell, word in zip(self.cells, self.words, strict=True)
        )


class SensorColumn(NamedTuple):
    """A column that names the sensor of each row, with those of its words that name magnetometers."""

    place: int
    words: tuple[str, ...]

    def is_of_first(self, row: Sequence[str]) -> bool:
        """Whether a row belongs to the first of these magnetometers."""
        return self.place < len(row) and normalise_word(row[self.place]) == self.words[0]

    def devices(self, names: Sequence[str], others: Sequence[Device]) -> tuple[Device, ...]:
        """A device for each magnetometer; combined with the devices of other columns if there are any."""
        own, called = self.place, names[self.place].strip() if names else str(self.place + 1)
        return tuple(
            Device((own, *each.cells), (called, *each.columns), (word, *each.words))
            for word in self.words
            for each in others or (Device((), (), ()),)
        )


def sensor_column(rows: Sequence[Sequence[str]], places: Iterable[int]) -> SensorColumn | None:
    """Column whose words name a magnetometer in some rows and another sensor in others; None if there is none.

    >>> rows = [["1", "ACC"], ["2", "MAG"], ["3", "PRES"]]
    >>> sensor_column(rows, (1,)), sensor_column(rows[1:], (1,))
    (SensorColumn(place=1, words=('MAG',)), None)
    """
    for place in places:
        known = sensors_of_words(row[place] for row in rows if place < len(row))
        words = sorted(word for word, each in known.items() if each.kind == FIELD)
        is_mixed = len({known[word].rank for word in words}) > 1 or len(words) < len(known)
        if words and is_mixed:
            names = [f"{word} {axis}" for word in words for axis in "xyz"]
            rawest = sorted(magnetometers(names), key=lambda vector: vector.rank)
            own = tuple(words[vector.cells[0] // len("xyz")] for vector in rawest)
            return SensorColumn(place, own) if own else None
    return None


def sensors_of_words(words: Iterable[str]) -> dict[str, Meaning]:
    """Meanings of a column's words, if they name sensors; empty if there are too many different words.

    >>> {word: known.kind for word, known in sensors_of_words(["GYRO", "gravity", "Fix", "mag", "12"]).items()}
    {'GYRO': 'rate', 'gravity': 'acceleration', 'mag': 'field'}
    """
    different = sorted({normalise_word(word) for word in words})
    if len(different) > MAX_SENSORS:
        return {}
    told = [word for word in different if len(word) >= MIN_LETTERS and parse_number(word, ".") is None]
    known = {word: Meaning(ACCELERATION) if QUANTITY.search(word) else meaning(f"{word} x") for word in told}
    return {word: each for word, each in known.items() if each.kind in (FIELD, ACCELERATION, RATE) and not each.is_bare}


def may_distinguish_rows(name: str) -> bool:
    """Whether the name of a column suggests that it distinguishes devices or sensors."""
    return names_device(name) or names_sensor(name)


def names_sensor(name: str) -> bool:
    """Whether the name of a column suggests that it names the sensor of each row.

    >>> [name for name in ("sensor", "sensor_type", "Name", "mag_x", "time") if names_sensor(name)]
    ['sensor', 'sensor_type', 'Name']
    """
    return any(_SENSOR.fullmatch(word.casefold()) for word in words_of(name)) and not meaning(name).kind


def names_device(name: str, header: Sequence[str] = ()) -> bool:
    """Whether the name of a column suggests that it names the device of each row.

    In messages of a flight log, which have a column ``TimeUS``, ``I`` is the number of the instance.
    """
    if name.strip() == INSTANCE and CLOCK_OF_INSTANCES in header:
        return True
    words = [word.casefold() for word in words_of(name)]
    is_plain = not any(map(_OTHER_MEANINGS.fullmatch, words)) and any(map(_DEVICE.fullmatch, words))
    return is_plain and not (meaning(name).kind or meaning(name).axis)


def normalise_word(cell: str) -> str:
    """Normalise a word for comparison, such as a whole number with decimals.

    >>> normalise_word(" 3.0"), normalise_word("'B4:01'"), normalise_word("10.0.0.7")
    ('3', 'B4:01', '10.0.0.7')
    """
    word = cell.strip(_AROUND)
    whole, point, decimals = word.partition(".")
    return whole if point and whole.isdecimal() and not decimals.strip("0") else word


def are_ids(words: Iterable[str], *, is_ahead: bool) -> bool:
    """Whether the words of an unnamed column identify devices.

    Addresses and names with a number do so; numbers counted from 0 or 1 do so if the column is ahead of the readings.

    >>> are_ids(["b4:12:01", "b4:12:02"], is_ahead=False), are_ids(["S2", "S1", "S1"], is_ahead=False)
    (True, True)
    >>> are_ids(["2", "1"], is_ahead=True), are_ids(["2", "1"], is_ahead=False), are_ids(["on", "off"], is_ahead=True)
    (True, False, False)
    """
    known = {normalise_word(word) for word in words}
    if not 2 <= len(known) <= MAX_DEVICES:
        return False
    if all(map(_ADDRESS.fullmatch, known)):
        return True
    numbers = sorted(int(word) for word in known if word.isdecimal())
    is_row = numbers in (list(range(len(known))), list(range(1, len(known) + 1)))
    return is_ahead and is_row and len(known) <= MAX_NUMBERED


def devices_in(names: Sequence[str], places: Sequence[int], rows: Rows) -> tuple[Device, ...]:
    """Devices by the words of all rows in some columns, sorted by name; empty for a single device.

    Columns that distinguish different devices are combined. Columns that distinguish the same devices count once.
    """
    tallies = {place: _Tally() for place in places}
    for words in rows():
        for tally, word in zip(tallies.values(), words, strict=True):
            tally.add(normalise_word(word))
    telling = {place: tally.devices for place, tally in tallies.items() if tally.devices}
    if not telling:
        return ()
    most = max(telling, key=lambda place: len(telling[place]))
    cells: tuple[int, ...] = (most,)
    found: list[tuple[str, ...]] = [(word,) for word in telling[most]]
    if len(telling) > 1:
        is_telling = [place in telling for place in places]
        counts = Counter(tuple(map(normalise_word, compress(words, is_telling))) for words in rows())
        together = [words for words, count in counts.items() if count >= MIN_READINGS]
        cells, found = (tuple(telling), together) if len(together) > len(found) else (cells, found)
    columns = tuple(names[cell].strip() if names else str(cell + 1) for cell in cells)
    return tuple(Device(cells, columns, words) for words in sorted(found, key=_in_order))


class _Tally:
    """Counts of the words in a column, in the order of the rows."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._last, self._has_returned = "", False

    def add(self, word: str) -> None:
        """Count a word; counting stops when there are too many different words."""
        if word != self._last:
            self._has_returned = self._has_returned or word in self.counts
            self._last = word
        if len(self.counts) <= MAX_DEVICES:
            self.counts[word] += 1

    @property
    def devices(self) -> list[str]:
        """Words that name devices; empty if there are too many, just one, or measured values."""
        least = MIN_READINGS if self._has_returned else MIN_READINGS_IN_A_ROW
        often = [word for word, count in self.counts.items() if word and count >= least]
        is_few = len(often) >= 2 and len(self.counts) <= MAX_DEVICES
        is_most = sum(self.counts[word] for word in often) >= MIN_SHARE * self.counts.total()
        return often if is_few and is_most and all(map(_is_name, often)) else []


def _is_name(word: str) -> bool:
    """Whether a word is a name, an address or a whole number, and not a measured value."""
    value = parse_number(word, ".")
    return len(word) <= MAX_LETTERS if value is None else value.is_integer()


def _in_order(words: tuple[str, ...]) -> list[list[tuple[bool, int, str]]]:
    """Sort key for words: letters alphabetically, numbers in them by value."""
    pieces = [_PIECES.findall(word.casefold()) for word in words]
    return [[(not one.isdecimal(), int(one) if one.isdecimal() else 0, one) for one in each] for each in pieces]
