"""Lines of MotionCal and of Adafruit's sketches for it: ``Raw:`` with nine counts, ``Uni:`` with nine numbers in units.

They are acceleration, rate and field. A count of ``Raw:`` is g/8192, °/s/16 and µT/10; ``Uni:`` is in m/s², rad/s and
µT.

Source: PaulStoffregen/MotionCal ``portlist.cpp`` and ``visualize.c``; Adafruit AHRS ``calibration.ino``.

>>> raw = recognise(["ready", "Raw:0,0,8192,0,0,16,217,4,-586"])
>>> raw.words, raw.names[6:], raw.row("Raw:0,0,8192,0,0,16,217,4,-586")
('Raw: lines', ('mag_x_uT', 'mag_y_uT', 'mag_z_uT'), ['0', '0', '1', '0', '0', '1', '21.7', '0.4', '-58.6'])
>>> raw.row("Cal1:0,0,0,0,0,0,0,0,0,50"), raw.row("hello")
((), None)
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.readers._numbers import number
from flinders.readers._tokenizer import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

LINE: Final = re.compile(r"(?:.* -> )?\s*(Raw|Uni|Cal[12])\s*[: ]\s*(?=[-+.\d]+\s*,)", re.IGNORECASE)
"""How such lines begin; a serial monitor may put the time before, and sketches print their calibration between."""
UNITS: Final = {"raw": ("g", "dps", "uT"), "uni": ("mps2", "radps", "uT")}
COUNTS: Final = (8192, 16, 10)  # Counts of ``Raw:`` in one g, °/s and µT
MOST_IN_UNITS: Final = 160.0  # Acceleration in m/s² that a hand reaches; fewer counts are 0.02 g


@dataclass(slots=True)
class MotionCal(Dialect):
    """Lines with one of the two signs; some sketches print the units of ``Uni:`` after ``Raw:``."""

    sign: str
    is_in_units: bool

    def row(self, line: str) -> Sequence[str] | None:
        """Take the nine numbers of a line, counts in units; nothing where the other sign or a calibration stands."""
        mark = LINE.match(line)
        if mark is None:
            return None
        if mark[1].casefold() != self.sign:
            return ()
        cells = [cell.strip() for cell in line[mark.end() :].split(",")]
        values = [number(cell, ".") for cell in cells]
        if len(cells) != 9 or None in values:
            return None
        if self.is_in_units:
            return cells
        return [f"{value / COUNTS[place // 3]:.9g}" for place, value in enumerate(values) if value is not None]


def recognise(lines: list[str]) -> MotionCal | None:
    """Find such lines among others; ``Raw:`` before ``Uni:``, which says the same in fewer digits."""
    signs = {mark[1].casefold() for line in lines if line.count(",") == 8 and (mark := LINE.match(line))}
    sign = next((sign for sign in UNITS if sign in signs), None)
    if sign is None:
        return None
    is_in_units = sign == "uni" or _are_units(lines)
    sensors = zip(("accel", "gyro", "mag"), UNITS["uni" if is_in_units else "raw"], strict=True)
    names = tuple(f"{sensor}_{axis}_{unit}" for sensor, unit in sensors for axis in "xyz")
    return MotionCal(f"{sign.capitalize()}: lines", names, sign, is_in_units)


def _are_units(lines: list[str]) -> bool:
    """Tell whether ``Raw:`` lines hold decimals and a gravity of 10 or 1, and not of 8192."""
    raw = MotionCal("", (), "raw", is_in_units=True)
    rows = [cells[:3] for line in lines if (cells := raw.row(line))]
    gravity = [math.hypot(*map(float, cells)) for cells in rows]
    return any("." in cell for cells in rows for cell in cells) and 0 < min(gravity) <= max(gravity) < MOST_IN_UNITS
