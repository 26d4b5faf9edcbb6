r"""Logs of a boat's instruments by time: its compass beside another heading, or speed and course over ground.

NMEA 0183 sentences, NMEA 2000 frames as candump prints them, and deltas of Signal K; each has a module beside this one,
which yields a `Message` for each number that counts here.

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

Speed and course alone are what a calibration is renewed by on the way, from the readings of another recording:

>>> course = ",".join(['{"path":"navigation.courseOverGroundTrue","value":1}',
...                    '{"path":"navigation.speedOverGround","value":5}'])
>>> _ = file.write_text("".join(line % (second, course) for second in range(9)))
>>> courses = read_courses(file)
>>> print(courses.by_clock(1780308000.0).time[:3], courses.velocity.values[0].round(2))
[0. 1. 2.] [2.7  4.21]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.apps.marine import nmea0183, nmea2000, signalk
from flinders.core.geomag import site_field, year_of
from flinders.errors import UnreadableInput, UsageError
from flinders.geometry.angles import folded, wrapped
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
"""By name; each has `SIGN`, which finds it in the first lines, and `messages`."""

Reference: TypeAlias = Literal["auto", "heading", "course"]

LEAST: Final = 8
"""Headings of a compass, and of the reference, in a log."""
WIDEST_S: Final = 3.0
"""Between two messages of the reference, to be interpolated."""
DERIVED_DEG: Final = 0.2
"""Scatter of a true heading about that of the compass: of less it was calculated from it."""
EARLIEST_S, LATEST_S = 31_536_000.0, 4_102_444_800.0
"""1971 and 2100: what a clock says outside is no date."""
NEED: Final = (
    "need the compass (HDG, HDM; PGN 127250; navigation.headingMagnetic) and a true heading of another instrument "
    "(HDT, THS; headingTrue) or the course over ground (RMC, VTG; PGN 129026; courseOverGroundTrue)"
)
NEED_COURSE: Final = "need RMC or VTG; PGN 129026; courseOverGroundTrue and speedOverGround"


@dataclass(frozen=True, slots=True, eq=False)
class CompassLog:
    """Headings by a compass and by its reference at the same times."""

    source: str  # name of the file
    words: str  # what is read of it
    time: Floats  # (N,) s
    compass_deg: Floats  # (N,) in [0, 360)
    reference_deg: Floats  # (N,) true; NaN where there is none
    speed: Floats  # (N,) over ground, m/s; NaN where there is none
    is_course: bool  # the reference is the course over ground, not a heading
    place: tuple[float, float] | None  # latitude and longitude, degrees
    day: date | None

    def __str__(self) -> str:
        """What was read."""
        return f"{self.source}: {self.words}"

    def site(self) -> SiteField:
        """The field where and when the log was made; `UsageError` where it does not say."""
        if self.place is None or self.day is None:
            missing = "position" if self.place is None else "date"
            raise UsageError(
                f"{self.source} has no {missing}: give the place and day of the swing", hint={"site": None}
            )
        latitude_deg, longitude_deg = self.place
        return site_field(round(latitude_deg, 4), round(longitude_deg, 4), year=year_of(self.day))


def is_compass_log(path: str | os.PathLike[str]) -> bool:
    """Whether the first lines of a file are those of such a log."""
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
        What the compass is held against: a true heading of another instrument, where there is one that was not
        calculated from the compass, else the course over ground.
    """
    if reference not in {"auto", "heading", "course"}:
        raise UsageError(f"reference is {reference!r}: need auto, heading or course")
    source = find(path)
    name, series = _messages(source, NEED)
    compass = series.required("compass", source.name)
    chosen = _reference(series, compass, reference, source.name)
    time, headings = compass.time, compass.value
    speed = series.stream("speed")
    return CompassLog(
        source.name,
        f"{name}; {len(time):,} headings of the compass ({compass.source}), {chosen.words} ({chosen.source})",
        time,
        wrapped(headings),
        chosen.at(time),
        np.full(len(time), np.nan) if speed is None else _interpolated(time, speed.time, speed.value),
        chosen.kind == "course",
        series.place(),
        _day(float(time[0])),
    )


@dataclass(frozen=True, slots=True, eq=False)
class CourseLog:
    """Velocity over ground of a boat, and where and when that was."""

    source: str  # name of the file
    words: str  # what is read of it
    velocity: TimeSeries  # north and east, m/s, by s since 1970
    position: Position | None
    begun: datetime | None

    def by_clock(self, start: float) -> TimeSeries:
        """The velocity by a clock that starts at so many s since 1970."""
        return replace(self.velocity, time=self.velocity.time - start)


def read_courses(path: str | os.PathLike[str]) -> CourseLog:
    """Read speed and course over ground of a log of a boat.

    Raises `UnreadableInput` for another file, or one without them, or without a clock.
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
        datetime.fromtimestamp(since, UTC) if EARLIEST_S < since < LATEST_S else None,
    )


def _velocity(course: _Stream, speed: _Stream) -> TimeSeries | None:
    """North and east, m/s, at the times of the courses."""
    along = np.deg2rad(course.value)
    directions = np.column_stack([np.cos(along), np.sin(along)])
    return TimeSeries.of(course.time, _interpolated(course.time, speed.time, speed.value)[:, np.newaxis] * directions)


def _messages(source: Source, need: str) -> tuple[str, _Series]:
    """The format of a log, and what it says; `need` tells what another file lacks."""
    encoding = encoding_of(source.head())
    name = _format_of(source.head().decode(encoding, errors="replace"))
    if name is None:
        raise UnreadableInput(f"{source.name} is no log of NMEA 0183, NMEA 2000 (candump) or Signal K: {need}")
    lines = (line for block in source.lines(encoding) for line in block.texts)
    return name, _Series.of(list(FORMATS[name].messages(lines)))


def _format_of(text: str) -> str | None:
    """The format whose sign the first lines show."""
    return next((name for name, module in FORMATS.items() if module.SIGN.search(text)), None)


class _Stream(NamedTuple):
    """The messages of one kind from one source, in the order of time."""

    kind: str
    source: str
    time: Floats
    value: Floats

    @property
    def words(self) -> str:
        """What they are."""
        return "true headings" if self.kind == "heading" else "courses over ground"

    def at(self, time: Floats) -> Floats:
        """Angles at other times, in [0, 360); NaN where messages are too far apart."""
        around = np.rad2deg(np.unwrap(np.deg2rad(self.value)))
        return wrapped(_interpolated(time, self.time, around))


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
        """The source of a kind that says most; None where none says enough."""
        counts = {key: len(members) for key, members in self.by_source.items() if key[0] == kind}
        if not counts:
            return None
        key = max(counts, key=counts.__getitem__)
        pairs = np.array([(message.time, message.value) for message in self.by_source[key]])
        time, value = pairs[np.argsort(pairs[:, 0], kind="stable")].T
        is_new = np.diff(time, prepend=-np.inf) > 0.0
        return _Stream(*key, time[is_new], value[is_new]) if is_new.sum() >= LEAST else None

    def required(self, kind: str, name: str) -> _Stream:
        """The same, refused where there is none."""
        stream = self.stream(kind)
        if stream is None:
            raise UnreadableInput(f"{name} has no heading of a compass with a time: {NEED}")
        return stream

    def place(self) -> tuple[float, float] | None:
        """Middle of the positions."""
        latitude, longitude = self.stream("latitude"), self.stream("longitude")
        if latitude is None or longitude is None:
            return None
        return float(np.median(latitude.value)), float(np.median(longitude.value))


def _reference(series: _Series, compass: _Stream, wanted: Reference, name: str) -> _Stream:
    """What the compass is held against."""
    heading, course = series.stream("heading"), series.stream("course")
    if heading is not None and wanted == "auto" and _is_derived(heading, compass):
        heading = None
    chosen = {"auto": heading or course, "heading": heading, "course": course}[wanted]
    if chosen is None:
        raise UnreadableInput(f"{name} has nothing to hold its compass against: {NEED}")
    return chosen


def _is_derived(heading: _Stream, compass: _Stream) -> bool:
    """A true heading that differs by a constant from the compass just before, or just after, was calculated from it."""
    after = np.searchsorted(compass.time, heading.time, "right").clip(1, len(compass.time) - 1)
    return min(_scatter_deg(heading.value - compass.value[place]) for place in (after - 1, after)) < DERIVED_DEG


def _scatter_deg(angles_deg: Floats) -> float:
    """Standard deviation of angles about their middle."""
    return float(np.std(folded(angles_deg - np.median(angles_deg))))


def _interpolated(time: Floats, known: Floats, value: Floats) -> Floats:
    """Values at other times; NaN where two known ones are too far apart, and beyond the ends."""
    after = np.searchsorted(known, time).clip(1, len(known) - 1)
    is_near = (known[after] - known[after - 1] <= WIDEST_S) & (time >= known[0]) & (time <= known[-1])
    return np.where(is_near, np.interp(time, known, value), np.nan)


def _day(time: float) -> date | None:
    """The day of a time since 1970; None of a clock that starts elsewhere."""
    return datetime.fromtimestamp(time, UTC).date() if EARLIEST_S < time < LATEST_S else None
