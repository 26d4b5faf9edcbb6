"""Frames of NMEA 2000, as candump prints them with a clock: heading (PGN 127250), course (129026), position (129025).

Each of the three fits one frame. Angles are in units of 10⁻⁴ rad, speed in cm/s, positions in 10⁻⁷ degrees; numbers
that are not available have all bits set.

Sources: canboat ``samples/candumpSample3.txt``; ttlappalainen/NMEA2000 ``N2kMessages.h``; kinavis-nmea2000
``navigation.rs``.

>>> for message in messages(["(1502984866.421964) slcan0 09F112CC#FF725AFF7FFF7FFD"]):
...     print(message.kind, round(message.value, 2), message.source)
compass 132.66 PGN 127250, address 204
"""

from __future__ import annotations

import math
import re
import struct
from typing import TYPE_CHECKING, Final

from flinders.apps.marine.nmea0183 import Message
from flinders.errors import UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from flinders.apps.marine.nmea0183 import Kind

EIGHT_BYTES: Final = r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2}){7}"
FRAME: Final = rf"(?P<id>[0-9A-Fa-f]{{8}})(?:#(?P<log>[0-9A-Fa-f]{{16}})|[ \t]+\[8\][ \t]+(?P<bytes>{EIGHT_BYTES}))"
SIGN: Final = re.compile(rf"^(?:[ \t]*\(\d+\.\d+\))?[ \t]*\S+[ \t]+{FRAME}", re.MULTILINE)
"""Pattern in the first lines of a candump of NMEA 2000, with or without a clock."""
LINE: Final = re.compile(rf"\s*\((?P<time>\d+\.\d+)\)\s+\S+\s+{FRAME}.*")
RADIAN: Final = math.degrees(1e-4)
MIN_MISSING: Final = 0xFFFD
"""Smallest number of two bytes that stands for a missing value."""
TRUE, MAGNETIC = 0, 1


def messages(lines: Iterable[str]) -> Iterator[Message]:
    """Yield a message for each number in the frames.

    Raises `UnreadableInput` for frames without a clock.
    """
    is_timed = False
    for line in lines:
        if match := LINE.fullmatch(line):
            is_timed = True
            identifier = int(match["id"], 16)
            frame, payload = identifier >> 8 & 0x3FFFF, bytes.fromhex(match["log"] or match["bytes"])
            for kind, value in _numbers_in(frame, payload):
                source = f"PGN {frame}, address {identifier & 0xFF}"
                yield Message(float(match["time"]), kind, value, source)
    if not is_timed:
        raise UnreadableInput("frames have no clock: log them with candump -l, or candump -t a")


def _numbers_in(group: int, payload: bytes) -> Iterator[tuple[Kind, float]]:
    """Yield the kind and value of each number in a frame."""
    if group == 127250:
        _, heading, _, _, flags = struct.unpack("<BHhhB", payload)
        if heading < MIN_MISSING and flags & 3 in {TRUE, MAGNETIC}:
            yield ("compass" if flags & 3 == MAGNETIC else "heading"), RADIAN * heading
    elif group == 129026:
        _, flags, course, speed, _ = struct.unpack("<BBHHH", payload)
        if flags & 3 == TRUE and course < MIN_MISSING and speed < MIN_MISSING:
            yield "course", RADIAN * course
            yield "speed", speed / 100.0
    elif group == 129025:
        latitude, longitude = struct.unpack("<ii", payload)
        if abs(latitude) <= 90e7 and abs(longitude) <= 180e7:
            yield "latitude", latitude * 1e-7
            yield "longitude", longitude * 1e-7
