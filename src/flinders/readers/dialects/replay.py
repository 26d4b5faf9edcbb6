"""Replays of PX4's estimator (``test/replay_data`` of PX4-ECL), of which the magnetometer and the IMU are taken.

Each line has a time, a sensor and its values; with each of the magnetometer's goes the last one of the IMU before it.
``time_us,mag,x,y,z`` is in gauss, corrected on board and in the axes of the vehicle; ``time_us,imu,…`` is acceleration
in m/s² and rate in rad/s, in the same axes.

Source: PX4-ECL ``test/sensor_simulator/sensor_simulator.cpp``.

>>> dialect = recognise(["4000,imu,0.1,0.2,-9.8,0,0,0.5", "8000,mag,0.2,0,0.4"])
>>> dialect.row("4000,imu,0.1,0.2,-9.8,0,0,0.5"), dialect.row("8000,mag,0.2,0,0.4"), dialect.row("8000,baro,12")
((), ['8000', '0.2', '0', '0.4', '0.1', '0.2', '-9.8', '0', '0', '0.5'], ())
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from flinders.readers._tokenizer import Dialect

if TYPE_CHECKING:
    from collections.abc import Sequence

LINE: Final = re.compile(r"(\d+),(mag|imu|baro|gps|landed|airspeed|flow|vio|range)((?:,[^,]*)*)$")
MOST: Final = 0.9
"""Share of lines that have to be of this kind."""
NAMES: Final = (
    "time (us)", "mag_x (G)", "mag_y (G)", "mag_z (G)", "acc_x", "acc_y", "acc_z",
    "gyro_x (rad/s)", "gyro_y (rad/s)", "gyro_z (rad/s)",
)  # fmt: skip


@dataclass(slots=True)
class Replay(Dialect):
    """Lines of several sensors."""

    _imu: list[str] = field(default_factory=lambda: [""] * 6, init=False)  # as it was read last

    def row(self, line: str) -> Sequence[str]:
        """Take the magnetometer's numbers, with the last ones of the IMU; nothing for another sensor."""
        found = LINE.match(line.strip())
        values = found[3].split(",")[1:] if found else []
        if found and found[2] == "imu" and len(values) == 6:
            self._imu = values
        return [found[1], *values, *self._imu] if found and found[2] == "mag" and len(values) == 3 else ()


def recognise(lines: list[str]) -> Replay | None:
    """Tell whether lines are those of a replay; its magnetometer may come later than the first of them."""
    filled = [line.strip() for line in lines if line.strip()]
    if not filled or sum(map(bool, map(LINE.match, filled))) < MOST * len(filled):
        return None
    return Replay("replay of PX4's estimator", NAMES, frame="vehicle")
