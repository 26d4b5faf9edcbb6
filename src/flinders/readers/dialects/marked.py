r"""Lines that start with a mark of their content, as several programs print them; here each mark is a row of data.

MotionCal and Adafruit's sketches print ``Raw:`` with nine counts (g/8192, °/s/16, µT/10), and ``Uni:`` in m/s², rad/s
and µT. magcc sends datagrams ``|…*`` to UDP port 50100: time, acceleration, rate, field, roll, pitch, yaw. Paparazzi
logs ``t ac_id IMU_MAG_RAW x y z``, with the number of the sensor before x if there are several (not yet seen in a log),
or ``IMU_MAG_CURRENT_CALIBRATION`` with a current; the first aircraft and its first magnetometer are read. Replays of
PX4's estimator have ``time_us,mag,x,y,z`` after ``imu``, in gauss, corrected on board and in the axes of the vehicle.
VectorNav prints ``$VNYMR`` and similar sentences in gauss, m/s² and rad/s (user manuals of VN-100 and VN-200).

Sources: PaulStoffregen/MotionCal ``portlist.cpp`` and ``visualize.c``; Adafruit AHRS ``calibration.ino``; Paparazzi
``sw/tools/calibration/calibration_utils.py``; PX4-ECL ``test/sensor_simulator/sensor_simulator.cpp``.

>>> raw = recognise(["ready", "Raw:0,0,8192,0,0,16,217,4,-586"])
>>> raw.words, raw.names[6:], raw.row("Raw:0,0,8192,0,0,16,217,4,-586")
('Raw: lines', ('mag_x_uT', 'mag_y_uT', 'mag_z_uT'), ['0', '0', '1', '0', '0', '1', '21.7', '0.4', '-58.6'])
>>> raw.row("Cal1:0,0,0,0,0,0,0,0,0,50"), raw.row("hello")
((), None)
>>> recognise(["|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*"]).names[7:10]
('mag_x', 'mag_y', 'mag_z')
>>> dialect = recognise(["12.5 3 GPS 1 2 3", "12.6 3 IMU_MAG_RAW 12 -3 400"])
>>> dialect.row("12.7 3 IMU_MAG_RAW 13 -3 399"), dialect.row("12.7 4 IMU_MAG_RAW 1 2 3")
(['12.7', '13', '-3', '399'], ())
>>> dialect = recognise(["4000,imu,0.1,0.2,-9.8,0,0,0.5", "8000,mag,0.2,0,0.4"])
>>> dialect.row("4000,imu,0.1,0.2,-9.8,0,0,0.5"), dialect.row("8000,mag,0.2,0,0.4"), dialect.row("8000,baro,12")
((), ['8000', '0.2', '0', '0.4', '0.1', '0.2', '-9.8', '0', '0', '0.5'], ())
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from flinders.readers._cells import parse_number
from flinders.readers._lines import GZIP_CUT_MARK, EndsEarly
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.readers._source import Source

MOTIONCAL: Final = re.compile(
    r"(?P<time>)(?:.* -> )?\s*(?P<mark>Raw|Uni|Cal[12])\s*[: ]\s*(?P<values>[-+.\d]+\s*,.*)", re.IGNORECASE
)
"""A line of MotionCal, which may have a time in front; sketches print their calibration between readings."""
MAGCC: Final = re.compile(r"(?P<time>)(?P<mark>)(?:.* -> )?\s*\|(?P<values>[^|*]*)\*")
PAPARAZZI: Final = re.compile(
    r"(?P<time>\d+(?:\.\d+)?) (?P<mark>\d+ IMU_MAG_RAW(?: \d+(?= \S+ \S+ \S+$))?|\d+ [A-Z][A-Z0-9_]+)"
    r"(?P<values>(?: .*)?)"
)
REPLAY: Final = re.compile(r"(?P<time>\d+),(?P<mark>mag|imu|baro|gps|landed|airspeed|flow|vio|range),(?P<values>.*)")
VECTORNAV: Final = re.compile(
    r"(?P<time>)(?:.* -> )?\s*\$(?P<mark>VN[A-Z]{3}),(?P<values>[-+.\d]+(?:,[-+.\d]+)*)\s*(?:\*[0-9A-Fa-fX]{2,4})?"
)
SIGN: Final = re.compile(r"\b(?:Raw|Uni)\b|\|.*\*|\bIMU_MAG_|^\s*\d+,(?:mag|imu),|\$VN[A-Z]{3},", re.IGNORECASE)
"""Part of a line of MotionCal, magcc, Paparazzi, PX4-ECL or VectorNav."""
JOINED_DATAGRAMS: Final = re.compile(r"^\s*\|(?:[^|*,\n]+,){12}[^|*,\n]+\*[^\S\n]*\|", re.MULTILINE)
"""Datagrams of magcc without a line end between them."""
MAX_ACCELERATION: Final = 160.0  # largest acceleration in m/s² by hand; as counts it would be less than 0.02 g


def _names(*sensors: str) -> tuple[str, ...]:
    """Names of the three axes of each sensor; the axis replaces the star, as in ``gyro_*_dps``."""
    return tuple(sensor.replace("*", axis) for sensor in sensors for axis in "xyz")


@dataclass(slots=True)
class Marked(Dialect):
    """Lines with a mark, of which those with certain marks are readings."""

    line: re.Pattern[str]  # pattern of the time, the mark and the values of a line
    mark: str = ""  # mark of the magnetometer's lines
    auxiliary: str = ""  # mark of lines whose values belong to the next reading; empty without such lines
    counts: tuple[float, ...] = ()  # counts per unit, for each number of a reading
    share: float = 0.0  # smallest share of lines of this kind for it to be recognised
    _latest: list[str] = field(default_factory=list, init=False)  # latest values of the `auxiliary` mark

    def row(self, line: str) -> Sequence[str] | None:
        """Time and numbers of a line of the magnetometer; empty for another mark."""
        match = self.line.fullmatch(line.strip())
        if match is None:
            return None
        values = re.split(r"\s*,\s*|\s+", match["values"].strip())
        if self.auxiliary and match["mark"] == self.auxiliary:
            self._latest = values
        if match["mark"].casefold() != self.mark.casefold():
            return ()
        cells = [match["time"]] * bool(match["time"]) + self._in_units(values)
        auxiliary = self._latest or [""] * 6 if self.auxiliary else []
        is_whole = len(cells) + len(auxiliary) == len(self.names)
        return [*cells, *auxiliary] if is_whole and None not in [parse_number(cell, ".") for cell in cells] else None

    def _in_units(self, values: list[str]) -> list[str]:
        """Values in units instead of counts; values that are not counts are unchanged."""
        if len(self.counts) != len(values):
            return values
        numbers = zip((parse_number(value, ".") for value in values), self.counts, strict=True)
        return ["" if value is None else f"{value / counts:.9g}" for value, counts in numbers]


_RAW: Final = Marked(
    "Raw: lines",
    _names("accel_*_g", "gyro_*_dps", "mag_*_uT"),
    line=MOTIONCAL,
    mark="raw",
    counts=(8192,) * 3 + (16,) * 3 + (10,) * 3,
)
_UNI: Final = Marked("Uni: lines", _names("accel_*_mps2", "gyro_*_radps", "mag_*_uT"), line=MOTIONCAL, mark="uni")
_MAGCC: Final = Marked(
    "magcc datagrams",
    ("t_s", *_names("accel_*", "gyro_*_radps", "mag_*"), "roll_rad", "pitch_rad", "yaw_rad"),
    line=MAGCC,
)
_PAPARAZZI: Final = Marked("messages of Paparazzi", ("time (s)", *_names("mag_*")), line=PAPARAZZI, share=0.6)
_REPLAY: Final = Marked(
    "replay of PX4's estimator",
    ("time (us)", *_names("mag_* (G)", "acc_*", "gyro_* (rad/s)")),
    frame="vehicle",
    line=REPLAY,
    mark="mag",
    auxiliary="imu",
    share=0.9,
)
_INERTIAL: Final = ("accel_* (m/s2)", "gyro_* (rad/s)")
_ATTITUDES: Final = {"Y": ("yaw (deg)", "pitch (deg)", "roll (deg)"), "Q": ("qx", "qy", "qz", "qw")}
_VECTORNAV: Final = tuple(
    Marked("sentences of VectorNav", names, line=VECTORNAV, mark=f"VN{mark}")
    for mark, names in {
        "IMU": (*_names("mag_* (G)", *_INERTIAL), "temperature (C)", "pressure (kPa)"),
        "CMV": (*_names("mag_* (G)", *_INERTIAL), "temperature (C)"),
        "YMR": (*_ATTITUDES["Y"], *_names("mag_* (G)", *_INERTIAL)),
        "QMR": (*_ATTITUDES["Q"], *_names("mag_* (G)", *_INERTIAL)),
        "MAR": _names("mag_* (G)", *_INERTIAL),
        "QMA": (*_ATTITUDES["Q"], *_names("mag_* (G)", _INERTIAL[0])),
        "QTM": (*_ATTITUDES["Q"], *_names("mag_* (G)")),
        "MAG": _names("mag_* (G)"),
    }.items()
)
"""Sentences with the rawest readings first; the field of ``VNIMU`` is not corrected on board."""


def recognise(lines: list[str]) -> Marked | None:
    """Find lines of one of the programs among other lines; ``Raw:`` is preferred, as ``Uni:`` has fewer digits."""
    for dialect in (_RAW, _UNI, _MAGCC, *_VECTORNAV):
        rows = [cells for line in lines if (cells := replace(dialect, counts=()).row(line))]
        if rows:
            return (
                replace(_UNI, words=_RAW.words, mark="raw")
                if dialect is _RAW and _are_units(rows)
                else replace(dialect)
            )
    filled = [line.strip() for line in lines if line.strip()]
    for dialect in (_PAPARAZZI, _REPLAY):
        matches = [match for line in filled if (match := dialect.line.fullmatch(line))]
        if matches and len(matches) >= dialect.share * len(filled):
            return replace(dialect) if dialect is _REPLAY else _paparazzi([match["mark"] for match in matches])
    return None


def _are_units(rows: Sequence[Sequence[str]]) -> bool:
    """Whether ``Raw:`` lines are in units: they have decimals, and a gravity of 10 or 1 instead of 8192."""
    gravity = [math.hypot(*(float(cell or math.nan) for cell in cells[:3])) for cells in rows]
    return (
        any("." in cell for cells in rows for cell in cells[:3]) and 0 < min(gravity) <= max(gravity) < MAX_ACCELERATION
    )


def _paparazzi(marks: Sequence[str]) -> Marked | None:
    """The first raw message of a magnetometer, or else the first message with a current."""
    if raw := next((mark for mark in marks if " IMU_MAG_RAW" in mark), ""):
        return replace(_PAPARAZZI, mark=raw)
    mark = next((mark for mark in marks if mark.endswith("IMU_MAG_CURRENT_CALIBRATION")), "")
    return replace(_PAPARAZZI, names=(*_PAPARAZZI.names, "current (A)"), mark=mark) if mark else None


def has_joined_datagrams(beginning: str) -> bool:
    """Whether datagrams follow each other without line ends between them.

    >>> has_joined_datagrams("|0.1,0,0,9.8,0,0,0.1, 0.21,0.01,-0.58,0,0,1.57*|0.2,0,0")
    True
    """
    return JOINED_DATAGRAMS.search(beginning) is not None


def datagrams_as_lines(source: Source) -> Iterator[bytes]:
    """Yield the bytes of a source with a line end after each datagram."""
    try:
        for chunk in source.chunks():
            yield chunk.replace(b"*", b"*\n")
    except EndsEarly:
        yield f"\n{GZIP_CUT_MARK}\n".encode()
