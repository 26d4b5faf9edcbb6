r"""Sentences of NMEA 0183 with heading, course and place: HDG, HDM, HDT, THS, VTG, RMC, GGA and GLL.

Few sentences have a time. Some loggers write a time before the sentence, in seconds or milliseconds since 1970: the
server of Signal K, and TAG blocks. For other lines, times are interpolated between the fixes of RMC, GGA and GLL. The
first number of HDG is the reading of the sensor, without deviation. A sentence with a wrong check sum is left out.

Sources: gpsd "NMEA Revealed" by way of adrianmo/go-nmea ``hdg.go``; SignalK/nmea0183-signalk ``hooks/RMC.js`` and
issue 235 (HDG).

>>> log = ["$GPRMC,100000,A,4807.038,N,01131.000,E,10.0,084.4,230626,,", "$HCHDG,98.3,0.0,E,12.6,W*57"]
>>> for message in messages([*log, "$GPRMC,100002,A,4807.038,N,01131.000,E,10.0,085.4,230626,,"]):
...     print(message.kind, round(message.value, 3), message.time % 60, message.source)
course 84.4 0.0 GPRMC
speed 5.144 0.0 GPRMC
latitude 48.117 0.0 GPRMC
longitude 11.517 0.0 GPRMC
compass 98.3 1.0 HCHDG
course 85.4 2.0 GPRMC
speed 5.144 2.0 GPRMC
latitude 48.117 2.0 GPRMC
longitude 11.517 2.0 GPRMC
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.errors import UnreadableInput
from flinders.readers._cells import parse_number

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

Kind: TypeAlias = Literal["compass", "heading", "course", "speed", "latitude", "longitude"]
"""Kind of a number: compass heading, true heading, true course and speed over ground, and position."""


class Message(NamedTuple):
    """One number of a boat's instruments, with its time and source, from NMEA 0183, NMEA 2000 or Signal K."""

    time: float  # s since 1970, or since the beginning of the first day
    kind: Kind
    value: float  # degrees, m/s
    source: str  # talker and sentence, PGN and address, or path and source


SIGN: Final = re.compile(r"\$[A-Z]{2}(?:HDG|HDM|HDT|THS|VTG|RMC),")
"""Pattern in the first lines of a file of NMEA 0183."""
SENTENCE: Final = re.compile(
    r"(?P<before>.*?)\$(?P<body>(?P<name>[A-Z]{2}(?P<kind>HDG|HDM|HDT|THS|VTG|RMC|GGA|GLL)),(?P<fields>[^*]*))"
    r"(?:\*(?P<sum>[0-9A-Fa-f]{2}))?\s*"
)
STAMP: Final = re.compile(r"(?<!\d)(\d{10}(?:\.\d+)?|\d{13})(?!\d)")
"""Time before a sentence, in seconds or milliseconds since 1970."""
KNOT: Final = 1852.0 / 3600.0
HEADINGS: Final[dict[str, Kind]] = {"HDG": "compass", "HDM": "compass", "HDT": "heading", "THS": "heading"}
POSITIONS: Final = {"RMC": 2, "GGA": 1, "GLL": 0}
"""Index of the field with the latitude, by kind of sentence."""
CLOCKS: Final = {"RMC": 0, "GGA": 0, "GLL": 4}
"""Index of the field with the time, by kind of sentence."""
DAY_S: Final = 86400.0
MAX_NUMBER: Final = 1e6
"""Largest absolute value of a valid number."""


def messages(lines: Iterable[str]) -> Iterator[Message]:
    """Yield a message with its time for each number in the sentences.

    Raises `UnreadableInput` if no line has a time.
    """
    numbers: list[tuple[int, Kind, float, str]] = []
    stamps: list[tuple[int, float]] = []
    fixes: list[tuple[int, float]] = []
    for place, match in enumerate(filter(None, map(_sentence, lines))):
        fields, kind = match["fields"].split(","), match["kind"]
        numbers += [(place, *said, match["name"]) for said in _numbers_in(kind, fields)]
        if stamp := STAMP.search(match["before"]):
            stamps.append((place, float(stamp[1]) * (1e-3 if len(stamp[1]) == 13 else 1.0)))
        if kind in CLOCKS and (clock := _clock(kind, fields)) is not None:
            fixes.append((place, _next_time(clock, fixes[-1][1] if fixes else None)))
    anchors = stamps if len(stamps) > 1 else fixes
    if len(anchors) < 2:
        raise UnreadableInput(
            "no sentence has a time: log RMC, GGA or GLL with the headings, or let the logger write its time before "
            "each line"
        )
    known, times = np.array(anchors).T
    for place, said, value, name in numbers:
        if known[0] <= place <= known[-1]:
            yield Message(float(np.interp(place, known, times)), said, value, name)


def _sentence(line: str) -> re.Match[str] | None:
    """Match of a known sentence whose check sum, if it has one, is right; None for other lines."""
    match = SENTENCE.fullmatch(line)
    if match is None or (match["sum"] and int(match["sum"], 16) != check_sum(match["body"])):
        return None
    return match


def check_sum(body: str) -> int:
    """Check sum of a sentence: the exclusive or of its bytes between dollar and star.

    >>> f"{check_sum('HCHDG,98.3,0.0,E,12.6,W'):02X}"
    '57'
    """
    return reduce(xor, body.encode(), 0)


def _numbers_in(kind: str, fields: Sequence[str]) -> Iterator[tuple[Kind, float]]:
    """Yield the kind and value of each number in a sentence."""
    if kind in HEADINGS and (heading := _number(fields, 0)) is not None:
        yield HEADINGS[kind], heading
    if kind in {"RMC", "VTG"} and not (kind == "RMC" and _text(fields, 1) != "A"):
        course, speed = (7, 6) if kind == "RMC" else (0, 4)
        if (true := _number(fields, course)) is not None and (knots := _number(fields, speed)) is not None:
            yield "course", true
            yield "speed", KNOT * knots
    if kind in POSITIONS:
        start = POSITIONS[kind]
        latitude = _coordinate(_text(fields, start), _text(fields, start + 1))
        longitude = _coordinate(_text(fields, start + 2), _text(fields, start + 3))
        if latitude is not None and longitude is not None:
            yield "latitude", latitude
            yield "longitude", longitude


def _text(fields: Sequence[str], place: int) -> str:
    return fields[place].strip() if place < len(fields) else ""


def _number(fields: Sequence[str], place: int) -> float | None:
    value = parse_number(_text(fields, place), ".")
    return value if value is not None and abs(value) < MAX_NUMBER else None


def _coordinate(text: str, side: str) -> float | None:
    """Degrees from ``dddmm.mmm`` and N, S, E or W; None for other texts."""
    value = parse_number(text, ".")
    if value is None or not 0.0 <= value <= 18000.0 or side not in {"N", "S", "E", "W"}:
        return None
    degrees = value // 100.0 + value % 100.0 / 60.0
    return -degrees if side in "SW" else degrees


def _clock(kind: str, fields: Sequence[str]) -> float | None:
    """Time of a sentence in s: since 1970 for RMC, else since midnight; None without a time."""
    time = re.fullmatch(r"(\d\d)(\d\d)(\d\d(?:\.\d*)?)", _text(fields, CLOCKS[kind]))
    if time is None:
        return None
    seconds = 3600.0 * int(time[1]) + 60.0 * int(time[2]) + float(time[3])
    return seconds + (_midnight(_text(fields, 8)) if kind == "RMC" else 0.0)


def _midnight(day: str) -> float:
    """Seconds since 1970 at the beginning of a day in the format of RMC; 0 for another text."""
    try:
        return datetime.strptime(day, "%d%m%y").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return 0.0


def _next_time(clock: float, last: float | None) -> float:
    """Time in s: a clock that counts from midnight plus the days up to the `last` time, and one more after midnight."""
    if last is None or clock >= DAY_S:
        return clock
    clock += DAY_S * (last // DAY_S)
    return clock + DAY_S if clock < last - DAY_S / 2.0 else clock
