r"""Logs of a boat's instruments: its compass with another heading, or with speed and course over ground.

The formats are NMEA 0183 sentences, NMEA 2000 frames as candump prints them, and deltas of Signal K. Each has a module
of its own, which yields a `Message` for each relevant number.

>>> import tempfile
>>> from pathlib import Path
>>> file = Path(tempfile.mkdtemp()) / "boat.log"
>>> line = '{"updates":[{"timestamp":"2026-06-01T10:00:0%dZ","values":[%s]}]}\n'
>>> value = '{"path":"navigation.heading%s","value":%s}'
>>> both = ",".join([value % ("Magnetic", 1.5), value % ("True", 1.6)])
>>> _ = file.write_text("".join(line % (second, both) for second in range(9)))
>>> log = read_compass_log(file, "heading")
>>> print(log.words)
Signal K; 9 headings of the compass (navigation.headingMagnetic), true headings (navigation.headingTrue)
>>> print(log.compass_deg[0].round(2), log.reference_deg[0].round(2), log.is_course, log.day)
85.94 91.67 False 2026-06-01

Speed and course alone are used to renew a calibration under way, with the readings of another recording:

>>> course = ",".join(['{"path":"navigation.courseOverGroundTrue","value":1}',
...                    '{"path":"navigation.speedOverGround","value":5}'])
>>> _ = file.write_text("".join(line % (second, course) for second in range(9)))
>>> courses = read_courses(file)
>>> print(courses.velocity_on_clock(1780308000.0).time[:3], courses.velocity.values[0].round(2))
[0. 1. 2.] [2.7  4.21]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.apps.marine import nmea0183, nmea2000, signalk
from flinders.core.geomag import decimal_year, site_field
from flinders.errors import UnreadableInput, UsageError
from flinders.geometry.angles import wrap_180, wrap_360
from flinders.readers._foreign_files import is_binary
from flinders.readers._lines import encoding_of
from flinders.readers._log import Position
from flinders.readers._resample import TimeSeries
from flinders.readers._source import find

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from flinders.apps.marine.nmea0183 import Message
    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.readers._source import Source

FORMATS: Final = {"NMEA 0183": nmea0183, "NMEA 2000": nmea2000, "Signal K": signalk}
"""Modules of formats by name; each has `SIGN`, a pattern for the first lines, and `messages`."""

Reference: TypeAlias = Literal["auto", "heading", "course"]

MIN_HEADINGS: Final = 8
"""Smallest number of headings of the compass, and of the reference, in a log."""
MAX_GAP_S: Final = 3.0
"""Largest interval between two messages of the reference for interpolation."""
MAX_DERIVED_SCATTER_DEG: Final = 0.2
"""Largest scatter about the compass heading of a true heading that was calculated from the compass."""
MIN_DATE_S, MAX_DATE_S = 31_536_000.0, 4_102_444_800.0
"""Range of times that are dates, from 1971 to 2100, in s since 1970."""
NEED: Final = (
    "need the compass (HDG, HDM; PGN 127250; navigation.headingMagnetic) and a true heading of another instrument "
    "(HDT, THS; headingTrue) or the course over ground (RMC, VTG; PGN 129026; courseOverGroundTrue)"
)
NEED_COURSE: Final = "need RMC or VTG; PGN 129026; courseOverGroundTrue and speedOverGround"


@dataclass(frozen=True, slots=True, eq=False)
class CompassLog:
    """Headings by a compass and by its reference at the same times."""

    source: str  # name of the file
    words: str  # description of its contents
    time: Floats  # (N,) s
    compass_deg: Floats  # (N,) compass headings in [0, 360)
    reference_deg: Floats  # (N,) true headings or courses; NaN if missing
    speed: Floats  # (N,) speed over ground, m/s; NaN if missing
    is_course: bool  # whether the reference is the course over ground, not a heading
    place: tuple[float, float] | None  # latitude and longitude, degrees
    day: date | None  # day of the log

    def __str__(self) -> str:
        """Name and contents of the log."""
        return f"{self.source}: {self.words}"

    def site(self) -> SiteField:
        """Field at the place and day of the log; raises `UsageError` if the log does not state them."""
        if self.place is None or self.day is None:
            missing = "position" if self.place is None else "date"
            raise UsageError(
                f"{self.source} has no {missing}: give the place and day of the swing", hint={"site": None}
            )
        latitude_deg, longitude_deg = self.place
        return site_field(round(latitude_deg, 4), round(longitude_deg, 4), year=decimal_year(self.day))


def is_compass_log(path: str | os.PathLike[str]) -> bool:
    """Whether the first lines of a file are those of a boat's log."""
    head = find(path).head()
    if is_binary(head):
        return False
    return _format_of(head.decode(encoding_of(head), errors="replace")) is not None


def read_compass_log(path: str | os.PathLike[str], reference: Reference = "auto") -> CompassLog:
    """Read a log of a boat.

    Raises `UnreadableInput` for another file, or one without compass, reference or clock; `UsageError` for another
    reference.

    Parameters
    ----------
    path : str or path
        NMEA 0183, candump of NMEA 2000, or Signal K deltas.
    reference : ``auto``, ``heading`` or ``course``
        Reference for the compass: a true heading of another instrument, or the course over ground. ``auto`` uses the
        heading if it was not calculated from the compass, else the course.
    """
    if reference not in {"auto", "heading", "course"}:
        raise UsageError(f"reference is {reference!r}: need auto, heading or course")
    source = find(path)
    name, series = _messages(source, NEED)
    compass = series.require_stream("compass", source.name)
    chosen = _reference(series, compass, reference, source.name)
    time, headings = compass.time, compass.value
    speed = series.stream("speed")
    return CompassLog(
        source.name,
        f"{name}; {len(time):,} headings of the compass ({compass.source}), {chosen.words} ({chosen.source})",
        time,
        wrap_360(headings),
        chosen.at(time),
        np.full(len(time), np.nan) if speed is None else _interpolate(time, speed.time, speed.value),
        chosen.kind == "course",
        series.place(),
        _day(float(time[0])),
    )


@dataclass(frozen=True, slots=True, eq=False)
class CourseLog:
    """Velocity over ground of a boat, with place and time."""

    source: str  # name of the file
    words: str  # description of its contents
    velocity: TimeSeries  # north and east, m/s, by s since 1970
    position: Position | None
    begun: datetime | None

    def velocity_on_clock(self, start: float) -> TimeSeries:
        """Velocity with times on a clock that starts at `start`, in s since 1970."""
        return replace(self.velocity, time=self.velocity.time - start)


def read_courses(path: str | os.PathLike[str]) -> CourseLog:
    """Read speed and course over ground from a boat's log.

    Raises `UnreadableInput` for another file, or a log without speed, course or clock.
    """
    source = find(path)
    name, series = _messages(source, NEED_COURSE)
    course, speed = series.stream("course"), series.stream("speed")
    velocity = None if course is None or speed is None else _velocity(course, speed)
    if course is None or velocity is None:
        raise UnreadableInput(f"{source.name} has no speed and course over ground with their times: {NEED_COURSE}")
    place, since = series.place(), float(velocity.time[0])
    return CourseLog(
        source.name,
        f"{name}; {len(velocity.time):,} courses over ground ({course.source})",
        velocity,
        None if place is None else Position(*place),
        datetime.fromtimestamp(since, UTC) if MIN_DATE_S < since < MAX_DATE_S else None,
    )


def _velocity(course: _Stream, speed: _Stream) -> TimeSeries | None:
    """North and east velocity in m/s from course and speed, at the times of the courses."""
    along = np.deg2rad(course.value)
    directions = np.column_stack([np.cos(along), np.sin(along)])
    return TimeSeries.of(course.time, _interpolate(course.time, speed.time, speed.value)[:, np.newaxis] * directions)


def _messages(source: Source, need: str) -> tuple[str, _Series]:
    """Format and messages of a log; `need` is the advice in the error for another file."""
    encoding = encoding_of(source.head())
    name = _format_of(source.head().decode(encoding, errors="replace"))
    if name is None:
        raise UnreadableInput(f"{source.name} is no log of NMEA 0183, NMEA 2000 (candump) or Signal K: {need}")
    lines = (line for block in source.lines(encoding) for line in block.texts)
    return name, _Series.of(list(FORMATS[name].messages(lines)))


def _format_of(text: str) -> str | None:
    """Name of the format of some first lines; None if no format matches."""
    return next((name for name, module in FORMATS.items() if module.SIGN.search(text)), None)


class _Stream(NamedTuple):
    """The messages of one kind from one source, in the order of time."""

    kind: str
    source: str
    time: Floats
    value: Floats

    @property
    def words(self) -> str:
        """Word for the messages of this stream."""
        return "true headings" if self.kind == "heading" else "courses over ground"

    def at(self, time: Floats) -> Floats:
        """Angles in [0, 360) at given times, interpolated between messages; NaN in gaps."""
        around = np.rad2deg(np.unwrap(np.deg2rad(self.value)))
        return wrap_360(_interpolate(time, self.time, around))


@dataclass(frozen=True, slots=True)
class _Series:
    """Messages by kind and source."""

    by_source: dict[tuple[str, str], list[Message]]

    @classmethod
    def of(cls, messages: Sequence[Message]) -> _Series:
        by_source: dict[tuple[str, str], list[Message]] = {}
        for message in messages:
            by_source.setdefault((message.kind, message.source), []).append(message)
        return cls(by_source)

    def stream(self, kind: str) -> _Stream | None:
        """Stream of one kind of message, from the source with most of them; None if they are too few."""
        counts = {key: len(members) for key, members in self.by_source.items() if key[0] == kind}
        if not counts:
            return None
        key = max(counts, key=counts.__getitem__)
        pairs = np.array([(message.time, message.value) for message in self.by_source[key]])
        time, value = pairs[np.argsort(pairs[:, 0], kind="stable")].T
        is_new = np.diff(time, prepend=-np.inf) > 0.0
        return _Stream(*key, time[is_new], value[is_new]) if is_new.sum() >= MIN_HEADINGS else None

    def require_stream(self, kind: str, name: str) -> _Stream:
        """The same as `stream`, but raises `UnreadableInput` if there is no such stream."""
        stream = self.stream(kind)
        if stream is None:
            raise UnreadableInput(f"{name} has no heading of a compass with a time: {NEED}")
        return stream

    def place(self) -> tuple[float, float] | None:
        """Median latitude and longitude of the positions, degrees; None without positions."""
        latitude, longitude = self.stream("latitude"), self.stream("longitude")
        if latitude is None or longitude is None:
            return None
        return float(np.median(latitude.value)), float(np.median(longitude.value))


def _reference(series: _Series, compass: _Stream, wanted: Reference, name: str) -> _Stream:
    """Stream of the reference for the compass; raises `UnreadableInput` if there is none."""
    heading, course = series.stream("heading"), series.stream("course")
    if heading is not None and wanted == "auto" and _is_derived(heading, compass):
        heading = None
    chosen = {"auto": heading or course, "heading": heading, "course": course}[wanted]
    if chosen is None:
        raise UnreadableInput(f"{name} has no reference for its compass: {NEED}")
    return chosen


def _is_derived(heading: _Stream, compass: _Stream) -> bool:
    """Whether a true heading was computed from the compass: their difference at neighbouring times is constant."""
    after = np.searchsorted(compass.time, heading.time, "right").clip(1, len(compass.time) - 1)
    return (
        min(_scatter_deg(heading.value - compass.value[place]) for place in (after - 1, after))
        < MAX_DERIVED_SCATTER_DEG
    )


def _scatter_deg(angles_deg: Floats) -> float:
    """Standard deviation of angles about their median."""
    return float(np.std(wrap_180(angles_deg - np.median(angles_deg))))


def _interpolate(time: Floats, known: Floats, value: Floats) -> Floats:
    """Values at the times `time`, interpolated; NaN in gaps longer than `MAX_GAP_S`, and beyond the ends."""
    after = np.searchsorted(known, time).clip(1, len(known) - 1)
    is_near = (known[after] - known[after - 1] <= MAX_GAP_S) & (time >= known[0]) & (time <= known[-1])
    return np.where(is_near, np.interp(time, known, value), np.nan)


def _day(time: float) -> date | None:
    """Day of a time since 1970; None for a clock that does not count from 1970."""
    return datetime.fromtimestamp(time, UTC).date() if MIN_DATE_S < time < MAX_DATE_S else None
