"""Logs of Paparazzi (``.data``): of lines with a time, an aircraft and a message, those of the magnetometer are taken.

``t ac_id IMU_MAG_RAW x y z`` is in counts; a release with several magnetometers writes the number of one before x (read
as such, not verified on a log). ``IMU_MAG_CURRENT_CALIBRATION x y z current`` has the battery's current in amperes
beside it, and is taken where there is no other. The first aircraft of the log, and its first magnetometer, are read.

Sources: Paparazzi ``sw/tools/calibration/calibration_utils.py`` (its regular expressions) and ``messages.xml``.

>>> dialect = recognise(["12.5 3 GPS 1 2 3", "12.6 3 IMU_MAG_RAW 12 -3 400"])
>>> dialect.row("12.7 3 IMU_MAG_RAW 13 -3 399"), dialect.row("12.7 4 IMU_MAG_RAW 1 2 3")
(['12.7', '13', '-3', '399'], ())
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.readers._tokenizer import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

RAW, WITH_CURRENT = "IMU_MAG_RAW", "IMU_MAG_CURRENT_CALIBRATION"
MESSAGE: Final = re.compile(r"\d+(?:\.\d+)? \d+ [A-Z][A-Z0-9_]+(?: |$)")
"""How each line begins: time in seconds, aircraft, name of the message."""
MAGNETOMETER: Final = re.compile(rf"(\d+(?:\.\d+)?) (\d+) ({RAW}|{WITH_CURRENT})((?: -?[\d.]+)+)\s*$")
MOST: Final = 0.6
"""Share of lines that have to be messages."""
NAMES: Final = ("time (s)", "mag_x", "mag_y", "mag_z")


@dataclass(slots=True)
class Paparazzi(Dialect):
    """Lines of one aircraft, one message, and one magnetometer (empty where they are not numbered)."""

    aircraft: str
    message: str
    sensor: str

    def row(self, line: str) -> Sequence[str]:
        """Take the numbers of a line of the magnetometer; nothing for another message."""
        found = MAGNETOMETER.match(line)
        if found is None or (found[2], found[3]) != (self.aircraft, self.message):
            return ()
        numbers = found[4].split()
        return () if self.sensor and numbers.pop(0) != self.sensor else [found[1], *numbers]


def recognise(lines: list[str]) -> Paparazzi | None:
    """Find the first message of a magnetometer among messages, with `RAW` before `WITH_CURRENT`."""
    found = [match for line in lines if (match := MAGNETOMETER.match(line))]
    if not found or sum(map(bool, map(MESSAGE.match, lines))) < MOST * sum(map(bool, map(str.strip, lines))):
        return None
    first = next((match for match in found if match[3] == RAW), found[0])
    names = NAMES if first[3] == RAW else (*NAMES, "current (A)")
    numbers = first[4].split()
    sensor = numbers[0] if first[3] == RAW and len(numbers) == len(NAMES) else ""
    return Paparazzi("messages of Paparazzi", names, first[2], first[3], sensor)
