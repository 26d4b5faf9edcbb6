"""Logs of Paparazzi (``.data``): of lines with a time, an aircraft and a message, those of the magnetometer are taken.

``t ac_id IMU_MAG_RAW x y z`` is in counts; a release with several magnetometers writes the number of one before x (read
as such, not verified on a log). ``IMU_MAG_CURRENT_CALIBRATION x y z current`` has the battery's current in amperes
beside it, and is taken where there is no other. The first aircraft of the log, and its first magnetometer, are read.

Sources: Paparazzi ``sw/tools/calibration/calibration_utils.py`` (its regular expressions) and ``messages.xml``.

>>> is_paparazzi(["12.5 3 GPS 1 2 3", "12.6 3 IMU_MAG_RAW 12 -3 400"])
True
>>> lines = ["12.6 3 IMU_MAG_RAW 12 -3 400", "12.7 4 IMU_MAG_RAW 1 2 3"]
>>> list(_cells(lines, _Kept.of(lines)))
['12.6,12,-3,400']
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from flinders.readers._source import Source, derived

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

RAW, WITH_CURRENT = "IMU_MAG_RAW", "IMU_MAG_CURRENT_CALIBRATION"
MESSAGE: Final = re.compile(r"\d+(?:\.\d+)? \d+ [A-Z][A-Z0-9_]+(?: |$)")
"""How each line begins: time in seconds, aircraft, name of the message."""
MAGNETOMETER: Final = re.compile(rf"(\d+(?:\.\d+)?) (\d+) ({RAW}|{WITH_CURRENT})((?: -?[\d.]+)+)\s*$")
MOST: Final = 0.6
"""Share of lines that have to be messages."""
NAMES: Final = ("time (s)", "mag_x", "mag_y", "mag_z")


@dataclass(frozen=True, slots=True)
class _Kept:
    """Which lines are taken: of one aircraft, one message, one magnetometer (nothing where they are not numbered)."""

    aircraft: str
    message: str
    sensor: str

    @classmethod
    def of(cls, texts: Iterable[str]) -> Self | None:
        """Find the first line of a magnetometer, with `RAW` before `WITH_CURRENT`; None where there is none."""
        found = [match for text in texts if (match := MAGNETOMETER.match(text))]
        if not found:
            return None
        first = next((match for match in found if match[3] == RAW), found[0])
        numbers = first[4].split()
        return cls(first[2], first[3], numbers[0] if first[3] == RAW and len(numbers) == 4 else "")


def is_paparazzi(texts: list[str]) -> bool:
    """Tell whether lines are those of such a log, with a magnetometer among them."""
    lines = [text for text in texts if text.strip()]
    if not any(MAGNETOMETER.match(text) for text in lines):
        return False
    return sum(MESSAGE.match(text) is not None for text in lines) >= MOST * len(lines)


def table_of_messages(source: Source, encoding: str, opening: list[str]) -> tuple[Source, tuple[str, ...]]:
    """Turn the magnetometer's messages into a table, which is kept as the file is: on the disk, or not at all.

    Returns
    -------
    Source, tuple of str
        The table, and the names of its columns.
    """
    kept = _Kept.of(opening)
    names = (*NAMES, "current (A)") if kept and kept.message == WITH_CURRENT else NAMES
    return derived(source, _encoded(source, encoding, kept)), names


def _encoded(source: Source, encoding: str, kept: _Kept | None) -> Iterator[bytes]:
    for lines in source.lines(encoding):
        rows = "".join(f"{row}\n" for row in _cells(lines.texts, kept))
        if rows:
            yield rows.encode()


def _cells(texts: Iterable[str], kept: _Kept | None) -> Iterator[str]:
    """Yield the numbers of the lines that are taken."""
    for text in texts:
        match = MAGNETOMETER.match(text)
        if match is None or kept is None or (match[2], match[3]) != (kept.aircraft, kept.message):
            continue
        numbers = match[4].split()
        if kept.sensor:
            if numbers[0] != kept.sensor:
                continue
            numbers = numbers[1:]
        yield ",".join((match[1], *numbers))
