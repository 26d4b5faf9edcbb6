"""A log: a file with instruments, the calibration that the vehicle applied, its position and its time.

Each magnetometer of a log is an `Instrument`, which is a `Recording`. It yields readings as measured, with the onboard
calibration removed, or readings as they were logged.

>>> from flinders.core.samples import Samples
>>> from flinders.core.units import Unit
>>> level = Instrument("trip.h5", "MAG 0", Unit.of("mG"), lambda _: iter([Samples.of([[1, 2, 3]], unit="mG")]))
>>> log = Log("trip.h5", "HDF5", (level,))
>>> log.sensor("1").name, log.sensor("mag 0") is log.sensor("1")
('MAG 0', True)
>>> log.sensor("2")
Traceback (most recent call last):
flinders.errors.UsageError: trip.h5 has no magnetometer 2: there is 1 (MAG 0)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.core.axes import Axes
from flinders.core.geomag import recorded_field
from flinders.core.time_span import TimeSpan
from flinders.core.units import MICROTESLA
from flinders.errors import UnreadableInput
from flinders.readers._auxiliary import missing_field
from flinders.readers._choice import Choice, list_names
from flinders.readers._source import raise_own_errors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from datetime import datetime

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Samples
    from flinders.core.units import Unit
    from flinders.readers._resample import TimeSeries
    from flinders.readers._source import Progress, Source


MAX_ALTITUDE_M: Final = 1e5
"""Largest altitude in m that is accepted."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """Onboard calibration when a log was made; if it was changed meanwhile, the last one."""

    #: Calibration of raw readings, before the mounting and without field strength. None if its numbers flatten the
    #: readings.
    calibration: Calibration | None
    #: Its parameters with the target's names: ``COMPASS_OFS −12, 40, −93 mG; COMPASS_DIA 1.02, 0.99, 1.00``
    words: str = ""
    applied: bool = True  #: whether the logged readings include this calibration, so that it can be removed
    changes: int = 0  #: number of changes of the calibration within the log

    def sentence(self, *, as_logged: bool) -> str:
        """Sentence on whether this calibration was removed from the readings."""
        if not self.applied:
            return f"logged raw, without {self.words}"
        return f"{'as logged, after' if as_logged else 'un-applied:'} {self.words}"


@dataclass(frozen=True, slots=True)
class Position:
    """Geographic position of a log."""

    latitude_deg: float  #: degrees, north and east positive (WGS 84)
    longitude_deg: float
    altitude_m: float = 0.0  #: m above sea level; 0 if unknown


def first_position(
    latitude: Floats, longitude: Floats, altitude: Floats, *, fixed: NDArray[np.bool_]
) -> Position | None:
    """First of the (N,) positions, in degrees and metres, that is `fixed` and valid; None if there is none."""
    usable = fixed & (np.abs(latitude) <= 90) & (np.abs(longitude) <= 180) & ((latitude != 0) | (longitude != 0))
    for row in np.flatnonzero(usable)[:1]:
        height = float(altitude[row])
        return Position(float(latitude[row]), float(longitude[row]), height if abs(height) < MAX_ALTITUDE_M else 0.0)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Instrument:
    """One magnetometer of a log."""

    source: str  #: the file, for messages
    name: str  #: name in the log: ``MAG 0``, ``sensor_mag 1 (device 396809)``, ``/imu/mag``
    unit: Unit  #: unit of the readings of `columns`
    #: Yields blocks of `Samples`, from the first one on at each call. The argument is True for readings as logged, and
    #: False for readings with the `stored` calibration removed.
    columns: Callable[[bool], Iterator[Samples]]
    #: onboard calibration, if the log states one; `stored.applied` tells whether the logged readings include it
    stored: Stored | None = None
    axes: Axes = field(default_factory=Axes)
    #: axes of `columns`, ``sensor`` or ``vehicle``: first without the `stored` calibration, then as logged
    frames: tuple[str, str] = ("sensor", "sensor")
    autopilot: Literal["ardupilot", "px4"] | None = None  #: autopilot whose compass it is
    compass: int | None = None  #: number of the compass on the autopilot
    device_id: int | None = None  #: device id of the compass on the autopilot
    #: mounting of the compass, if it is separate: roll, pitch and yaw in degrees
    mounting: tuple[float, float, float] | None = None
    as_logged: bool = False
    span: TimeSpan = field(default_factory=TimeSpan)  #: only readings within this span are yielded
    #: s: start of the span by the clock of `columns`; NaN if the span starts at the first reading
    beginning: float = np.nan
    readings: int | None = None  #: number of readings of `columns`, if it is known before they are read
    notes: tuple[str, ...] = ()  #: remarks, a sentence each
    fields: tuple[str, ...] = ()  #: names of the columns of x, y and z in a table
    unread_time: str = ""  #: names of columns that look like a time, if none is read
    others: tuple[str, ...] = ()  #: names of the log's other magnetometers, if the user selected none
    damage: tuple[str, ...] = ()  #: parts of the file that could not be read; empty for an intact file
    position: Position | None = None  #: position of the log
    start_time: datetime | None = None  #: start of the log in UTC
    velocity: TimeSeries | None = None  #: velocity over ground, north and east, m/s, by the clock of `columns`
    file: Source | None = None  #: file on disk from which the bytes are read
    temporary_files: tuple[Source, ...] = ()  #: temporary files that must exist while the recording is used
    #: called once per block with the bytes read so far, estimated from the number of readings, and their total
    progress: Progress | None = None
    #: Finds columns by their names in the log. Returns time series by the clock of `columns` for the names that exist,
    #: and some of the existing names.
    look_up: Callable[[Sequence[str]], tuple[Mapping[str, TimeSeries], Sequence[str]]] | None = None
    auxiliary: Mapping[str, TimeSeries] = field(default_factory=dict)  #: auxiliary columns that are read, by name

    def with_auxiliary(self, names: Sequence[str], *, are_needed: bool = True) -> Instrument:
        """The instrument with further columns, read at the times of the readings.

        Raises `InputError` for a missing name if `are_needed`; otherwise the name is left out.
        """
        found, there = ({}, ()) if self.look_up is None else self.look_up(names)
        for name in names:
            if are_needed and name not in found:
                raise missing_field(self.source, name, there)
        return replace(self, auxiliary={**self.auxiliary, **found})

    @property
    def frame(self) -> str:
        """Axes of its readings, before `axes` maps them: ``sensor`` or ``vehicle``."""
        return self.frames[self.as_logged]

    @property
    def onboard(self) -> Calibration | None:
        """Onboard calibration for the readings of `blocks`; None if it is unknown, or if they include it already.

        Its field strength is that of the site if the log states a site.
        """
        if self.stored is None or self.stored.calibration is None or (self.as_logged and self.stored.applied):
            return None
        known = replace(self.stored.calibration, raw=self.unit, sensor=self.name)
        site = recorded_field(self) if self.unit.inside == MICROTESLA else None
        strength = known.field_strength if site is None else site.strength
        return None if known.is_identity else replace(known, field_strength=strength).map_axes(self.axes)

    @raise_own_errors
    def blocks(self) -> Iterator[Samples]:
        """Yield the readings within `span`, in the axes of `axes`.

        Raises `UnreadableInput` if the log cannot be read to its end or no reading is left, and `UsageError` if the
        span contains no reading.
        """
        clock, gone, given = self.span.clock(self.source, self.beginning), 0, 0
        onboard = self.onboard
        for block in self.columns(self.as_logged):
            gone += len(block)
            if self.progress and self.file and self.file.size and self.readings:
                self.progress(int(self.file.size * min(gone / self.readings, 1.0)), self.file.size)
            within = clock.is_within(block)
            if within.any():
                given += 1
                turned = replace(clock.select(block, within), source=self.source, frame=self.frame).map_axes(self.axes)
                yield replace(turned, onboard=onboard, auxiliary=self._auxiliary_at(turned.time))
        clock.refuse_empty()
        if not given:
            raise UnreadableInput(
                f"no usable reading of {self.name} in {self.source}: need finite x, y and z. Check the sensor, and "
                "whether it was being logged"
            )

    def _auxiliary_at(self, time: Floats | None) -> dict[str, Floats]:
        """(N,) values of each auxiliary column at the times of readings; none without times."""
        if time is None:
            return {}
        return {name: series.at(time)[:, 0] for name, series in self.auxiliary.items()}

    def describe(self) -> str:
        """Describe in one line the readings that are used, and the onboard calibration that was removed."""
        parts = [f"{self.source}: {self.name} in {self.unit.name}"]
        if self.stored is not None:
            parts.append(self.stored.sentence(as_logged=self.as_logged))
        parts += [f"axes {self.axes}"] * (self.axes != Axes()) + [str(self.span)] * (not self.span.is_all)
        if self.others:
            parts.append(f"also there: {list_names(self.others)} (choose with --sensor)")
        parts += self.damage
        return "; ".join(parts)

    def __str__(self) -> str:
        return self.describe()


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """Contents of a log file."""

    source: str  #: the file, for messages
    format: str  #: name of the format for users, such as ``HDF5``
    instruments: tuple[Instrument, ...]  #: its magnetometers, in the order of their numbers
    position: Position | None = None
    start_time: datetime | None = None  #: start in UTC
    #: remarks on the file, a sentence each: that it was cut short, that its clock jumps
    notes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()  #: those of the notes that concern parts which could not be read
    #: whether its magnetometers are columns of one table; `topic` then selects the member of an archive with that table
    is_table: bool = False

    def sensor(self, wanted: str) -> Instrument:
        """Magnetometer with a number, counted from 1, or a name.

        Raises `UsageError` with the existing names if there is none.
        """
        return self.instruments[Choice(wanted).index_in([one.name for one in self.instruments], self.source)]


def start_time_of(log: Log) -> float:
    """Time in s of the first reading of any magnetometer; NaN without times."""
    times = []
    for instrument in log.instruments:
        block = next(iter(instrument.columns(True)), None)
        if block is not None and block.time is not None and len(block):
            times.append(float(np.nanmin(block.time[:1])))
    return min((time for time in times if np.isfinite(time)), default=np.nan)
