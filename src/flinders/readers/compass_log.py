r"""Logs of a boat's instruments: its compass beside another heading, or the course over ground, by time.

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
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.errors import UnreadableInput, UsageError
from flinders.geometry.angles import folded, wrapped
from flinders.readers import nmea0183, nmea2000, signalk
from flinders.readers._source import find, is_binary
from flinders.readers._tokenizer import encoding_of

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.readers.nmea0183 import Message

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
    encoding = encoding_of(source.head())
    name = _format_of(source.head().decode(encoding, errors="replace"))
    if name is None:
        raise UnreadableInput(f"{source.name} is no log of NMEA 0183, NMEA 2000 (candump) or Signal K: {NEED}")
    lines = (line for block in source.lines(encoding) for line in block.texts)
    series = _Series.of(list(FORMATS[name].messages(lines)))
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
