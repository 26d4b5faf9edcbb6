"""A log: a file that holds several instruments, and what it knows of their calibration, of the place and of the time.

Every magnetometer in it is an `Instrument`, which is a `Recording`: what was measured, before the calibration that was
in force on board was applied, or as it was logged.

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
from flinders.readers._auxiliary import lacks
from flinders.readers._choice import Choice, numbered
from flinders.readers._source import sound

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


HIGHEST_M: Final = 1e5
"""An altitude beyond is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A calibration that was in force when a log was made; of several, the last."""

    #: of readings without it, before the mounting, in no known strength of the field; None of numbers that flatten
    #: readings
    calibration: Calibration | None
    #: what it is, as the target calls it: ``COMPASS_OFS −12, 40, −93 mG; COMPASS_DIA 1.02, 0.99, 1.00``
    words: str = ""
    applied: bool = True  #: readings are logged after it; where they are not, there is nothing to un-apply
    changes: int = 0  #: how often it changed in the log

    def sentence(self, *, as_logged: bool) -> str:
        """Say what became of it."""
        if not self.applied:
            return f"logged raw, before {self.words}"
        return f"{'as logged, after' if as_logged else 'un-applied:'} {self.words}"


@dataclass(frozen=True, slots=True)
class Position:
    """Where a log was made."""

    latitude_deg: float  #: degrees, north and east positive (WGS 84)
    longitude_deg: float
    altitude_m: float = 0.0  #: m above the sea; 0 where it is not known


def first_position(
    latitude: Floats, longitude: Floats, altitude: Floats, *, fixed: NDArray[np.bool_]
) -> Position | None:
    """The first of (N,) places in degrees and metres that is `fixed` and can be one."""
    usable = fixed & (np.abs(latitude) <= 90) & (np.abs(longitude) <= 180) & ((latitude != 0) | (longitude != 0))
    for row in np.flatnonzero(usable)[:1]:
        height = float(altitude[row])
        return Position(float(latitude[row]), float(longitude[row]), height if abs(height) < HIGHEST_M else 0.0)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Instrument:
    """One magnetometer of a log."""

    source: str  #: the file, for messages
    name: str  #: as the log calls it: ``MAG 0``, ``sensor_mag 1 (device 396809)``, ``/imu/mag``
    unit: Unit  #: of what `columns` yields
    #: yields blocks of `Samples` from the first on, each time it is called; its argument says whether as logged
    #: (True), or with what is `stored` un-applied (False)
    columns: Callable[[bool], Iterator[Samples]]
    stored: Stored | None = None  #: what the log says was in force, where readings are logged after it
    axes: Axes = field(default_factory=Axes)
    #: what the axes of `columns` are, ``sensor`` or ``vehicle``: with what is `stored` un-applied, and as logged
    frames: tuple[str, str] = ("sensor", "sensor")
    autopilot: Literal["ardupilot", "px4"] | None = None  #: whose compass it is
    compass: int | None = None  #: its number there
    device_id: int | None = None  #: its device id there
    #: roll, pitch and yaw in degrees: how it is mounted, where it has a mounting of its own
    mounting: tuple[float, float, float] | None = None
    as_logged: bool = False
    span: TimeSpan = field(default_factory=TimeSpan)  #: only readings within it are given
    #: s: the time from which the span counts, by the clock of `columns`: the first reading where it is NaN
    beginning: float = np.nan
    readings: int | None = None  #: how many `columns` yields, where that is known beforehand
    notes: tuple[str, ...] = ()  #: what to know about it, a sentence each
    fields: tuple[str, ...] = ()  #: of a table, names of the columns of x, y and z
    unread_time: str = ""  #: names of columns that are called as a time, where none is read
    others: tuple[str, ...] = ()  #: names of the log's other magnetometers, where nobody has said which is meant
    damage: tuple[str, ...] = ()  #: what of the file could not be read, where it was cut short or is broken
    position: Position | None = None  #: where the log was made
    begun: datetime | None = None  #: and when, UTC
    velocity: TimeSeries | None = None  #: over ground, north and east, m/s, by the clock of `columns`
    file: Source | None = None  #: the bytes it was read from, as they lie on the disk
    temporary_files: tuple[Source, ...] = ()  #: temporary files that it needs
    #: called once a block with the bytes read so far, by the share of `readings`, and those there are
    progress: Progress | None = None
    #: finds columns by their names in the log: series by the clock of `columns`, without those that are not there, and
    #: names of some that are
    look_up: Callable[[Sequence[str]], tuple[Mapping[str, TimeSeries], Sequence[str]]] | None = None
    auxiliary: Mapping[str, TimeSeries] = field(default_factory=dict)  #: those that are read, by name

    def with_auxiliary(self, names: Sequence[str], *, are_needed: bool = True) -> Instrument:
        """Read columns of these names as well, at the times of the readings.

        Raises `InputError` for one that is not there, where they are needed; else it is left out.
        """
        found, there = ({}, ()) if self.look_up is None else self.look_up(names)
        for name in names:
            if are_needed and name not in found:
                raise lacks(self.source, name, there)
        return replace(self, auxiliary={**self.auxiliary, **found})

    @property
    def frame(self) -> str:
        """What the axes of its readings are, before `axes` maps them: ``sensor`` or ``vehicle``."""
        return self.frames[self.as_logged]

    @property
    def onboard(self) -> Calibration | None:
        """What was in force, for readings as `blocks` yields them; None where nothing is known, or they are after it.

        Its field strength is that of the site, where the log states one.
        """
        if self.stored is None or self.stored.calibration is None or (self.as_logged and self.stored.applied):
            return None
        known = replace(self.stored.calibration, raw=self.unit, sensor=self.name)
        site = recorded_field(self) if self.unit.inside == MICROTESLA else None
        strength = known.field_strength if site is None else site.strength
        return None if known.is_identity else replace(known, field_strength=strength).turned(self.axes)

    @sound
    def blocks(self) -> Iterator[Samples]:
        """Go through the readings, in `axes` and within `span`.

        Raises `UnreadableInput` where the log cannot be read to its end, or no reading is left; `UsageError` where
        nothing lies within the span.
        """
        clock, gone, given = self.span.clock(self.source, self.beginning), 0, 0
        onboard = self.onboard
        for block in self.columns(self.as_logged):
            gone += len(block)
            if self.progress and self.file and self.file.size and self.readings:
                self.progress(int(self.file.size * min(gone / self.readings, 1.0)), self.file.size)
            within = clock.within(block)
            if within.any():
                given += 1
                turned = replace(clock.selected(block, within), source=self.source, frame=self.frame).turned(self.axes)
                yield replace(turned, onboard=onboard, auxiliary=self._auxiliary_at(turned.time))
        clock.judge()
        if not given:
            raise UnreadableInput(
                f"no usable reading of {self.name} in {self.source}: need finite x, y and z: check the sensor, and "
                "whether it was being logged"
            )

    def _auxiliary_at(self, time: Floats | None) -> dict[str, Floats]:
        """(N,) values of the auxiliary columns at times of readings; none where these have no times."""
        if time is None:
            return {}
        return {name: series.at(time)[:, 0] for name, series in self.auxiliary.items()}

    def describe(self) -> str:
        """Say in one line what is used, and what was un-applied."""
        parts = [f"{self.source}: {self.name} in {self.unit.name}"]
        if self.stored is not None:
            parts.append(self.stored.sentence(as_logged=self.as_logged))
        parts += [f"axes {self.axes}"] * (self.axes != Axes()) + [str(self.span)] * (not self.span.is_all)
        if self.others:
            parts.append(f"also there: {numbered(self.others)} (choose with --sensor)")
        parts += self.damage
        return "; ".join(parts)

    def __str__(self) -> str:
        return self.describe()


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """What a file holds."""

    source: str  #: the file, for messages
    format: str  #: for people: ``HDF5``
    instruments: tuple[Instrument, ...]  #: its magnetometers, in the order of their numbers
    position: Position | None = None
    begun: datetime | None = None  #: UTC
    #: what to know about the file, a sentence each: that it was cut short, that its clock jumps
    notes: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()  #: those of the notes that tell what could not be read
    #: its magnetometers are columns of one table; a topic has named the member of an archive that holds it
    is_table: bool = False

    def sensor(self, wanted: str) -> Instrument:
        """Look a magnetometer up by its number, counted from 1, or by its name.

        Raises `UsageError` for one that there is not; names those there are.
        """
        return self.instruments[Choice(wanted).among([one.name for one in self.instruments], self.source)]


def beginning_of(log: Log) -> float:
    """The time of the first reading of any of its magnetometers, s; NaN where none has a time."""
    times = []
    for instrument in log.instruments:
        block = next(iter(instrument.columns(True)), None)
        if block is not None and block.time is not None and len(block):
            times.append(float(np.nanmin(block.time[:1])))
    return min((time for time in times if np.isfinite(time)), default=np.nan)
