"""Replays of PX4's estimator (``test/replay_data`` of PX4-ECL), of which the magnetometer and the IMU are taken.

Each line has a time, a sensor and its values; with each of the magnetometer's goes the last one of the IMU before it.
``time_us,mag,x,y,z`` is in gauss, corrected on board and in the axes of the vehicle; ``time_us,imu,…`` is acceleration
in m/s² and rate in rad/s, in the same axes.

Source: PX4-ECL ``test/sensor_simulator/sensor_simulator.cpp``.

>>> is_replay(["4000,imu,0.1,0.2,-9.8,0,0,0", "8000,mag,0.2,0,0.4"])
True
>>> list(_cells(["4000,imu,0.1,0.2,-9.8,0,0,0.5", "8000,mag,0.2,0,0.4", "8000,baro,12"], _Last()))
['8000,0.2,0,0.4,0.1,0.2,-9.8,0,0,0.5']
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.errors import NoMagnetometer
from flinders.readers._source import Source, derived

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

LINE: Final = re.compile(r"(\d+),(mag|imu|baro|gps|landed|airspeed|flow|vio|range)((?:,[^,]*)*)$")
MOST: Final = 0.9
"""Share of lines that have to be of this kind."""
FRAME: Final = "vehicle"
"""What the axes of such a log are, as `Samples` calls it."""
NAMES: Final = (
    "time (us)", "mag_x (G)", "mag_y (G)", "mag_z (G)", "acc_x", "acc_y", "acc_z",
    "gyro_x (rad/s)", "gyro_y (rad/s)", "gyro_z (rad/s)",
)  # fmt: skip


@dataclass(slots=True)
class _Last:
    """Six numbers of the IMU, as they were read last."""

    cells: str = ",,,,,,"


def is_replay(texts: list[str]) -> bool:
    """Tell whether lines are those of a replay; its magnetometer may come later than the first of them."""
    lines = [text.strip() for text in texts if text.strip()]
    return bool(lines) and sum(LINE.match(text) is not None for text in lines) >= MOST * len(lines)


def table_of_replay(source: Source, encoding: str) -> tuple[Source, tuple[str, ...]]:
    """Turn the magnetometer's lines into a table, which is kept as the file is: on the disk, or not at all.

    Returns
    -------
    Source, tuple of str
        The table, and the names of its columns.

    Raises
    ------
    NoMagnetometer
        At the end, where there was no such line.
    """
    return derived(source, _encoded(source, encoding)), NAMES


def _encoded(source: Source, encoding: str) -> Iterator[bytes]:
    last, is_empty = _Last(), True
    for lines in source.lines(encoding):
        rows = "".join(f"{row}\n" for row in _cells(lines.texts, last))
        if rows:
            is_empty = False
            yield rows.encode()
    if is_empty:
        raise NoMagnetometer(f"{source.name} is a replay of PX4's estimator without a line of a magnetometer (mag)")


def _cells(texts: Iterable[str], last: _Last) -> Iterator[str]:
    """Yield the magnetometer's numbers, with the last ones of the IMU."""
    for text in texts:
        match = LINE.match(text.strip())
        if match is None:
            continue
        if match[2] == "imu" and match[3].count(",") == 6:
            last.cells = match[3]
        elif match[2] == "mag" and match[3].count(",") == 3:
            yield f"{match[1]}{match[3]}{last.cells}"
