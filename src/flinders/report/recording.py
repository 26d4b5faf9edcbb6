"""What a recording or a log holds: its magnetometers, gone through once, what is beside them, and what to type next."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from rich.console import Group
from rich.padding import Padding
from rich.text import Text

from flinders.core.samples import Wrapped
from flinders.core.units import COUNTS, EARTH_WITH_ROOM_UT, label, unit_of_the_earth
from flinders.diagnostics.unmoved import require_moved
from flinders.errors import FitError, InputError, Unmoved, counted, figures
from flinders.fitting.calibrate import fit
from flinders.readers._likeness import likeness, looks_like
from flinders.readers._names import meaning
from flinders.report.formatting import written_time
from flinders.report.terminal import facts, page
from flinders.report.terminal import notes as marked
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import RenderableType

    from flinders.core.geomag import SiteField
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit
    from flinders.readers import Instrument, Log
    from flinders.summary.quality import TimeStamps

AUXILIARY: Final = ("time", "acceleration", "rate", "temperature", "current", "throttle", "attitude", "strength")
"""What may be recorded with a reading, as `Samples` calls it; besides, ``current1`` and so on of each motor."""
GAP: Final = 5.0
"""Usual steps from one reading to the next that make a gap."""
ENOUGH_SEEN: Final = 0.5
"""Of all directions, below which the size of an ellipsoid is a guess, and not shown."""
STALE: Final = 0.02
"""Share of readings that repeat the one before from which on it is worth a word."""
OFF: Final = 0.25
"""Of the field there: what a measured strength may differ by, with iron on board, before it is worth a word."""
TITLES: Final = 11


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSensor:
    """One magnetometer of a recording."""

    number: int  # counted from 1, as ``--sensor`` takes it
    name: str  # of the instrument or of its columns
    unit: str  # what it is written in
    unit_of_field: str  # what `lowest`, `highest` and `strength` are in
    readings: int  # how many
    seconds: float | None = None  # from the first to the last; None without a clock, as the next two
    rate_hz: float | None = None  # mean, but for the longest step
    longest_gap_s: float | None = None  # the longest step, where it is a gap
    backward_steps: int = 0  # steps of the clock that go back
    repeats: int = 0  # readings that are equal to the one before
    rails: tuple[str, ...] = ()  # ends of axes at which the sensor was at its limit
    lowest: tuple[float, ...] = ()  # (3,): smallest reading of each axis
    highest: tuple[float, ...] = ()  # (3,): largest reading of each axis
    onboard_calibration: str = ""  # the calibration that was in force, in words
    is_as_logged: bool = False  # that was left on
    is_raw: bool = False  # readings were logged before it, so that there is nothing to remove
    auxiliary: tuple[str, ...] = ()  # columns recorded with it, such as time and acceleration
    unmoved: str = ""  # why the sensor was hardly turned, in words; nothing where it was
    coverage: float | None = None  # of all directions; None where no ellipsoid fits, or the sensor was hardly turned
    strength: float | None = None  # of the field by that ellipsoid; None where too little is seen
    columns: tuple[str, ...] = ()  # of a table, names of those of x, y and z
    resembles: str = ""  # what its values look like, such as gravity, where no name says that it is a magnetometer
    ignored_time: str = ""  # names of columns that are called as a time, where none is read
    notes: tuple[str, ...] = ()  # what else to know, a sentence each

    @classmethod
    def of(cls, number: int, instrument: Instrument, *, columns: str | None, unit: str | None) -> Self:
        """Go through one magnetometer; where its unit or columns were not given, its values may tell them.

        Raises `InputError` if it has no reading.
        """
        watched = _WatchedInstrument(instrument)
        summary = Summary.through(watched)
        unmoved = _unmoved(summary, instrument.unit.inside)
        coverage, strength = (None, None) if unmoved else _seen(summary)
        remark = unit_remark(strength, instrument.unit.inside) if unit is None else ""
        health = summary.health
        return cls(
            number=number,
            name=instrument.name,
            unit=instrument.unit.name,
            unit_of_field=instrument.unit.inside,
            readings=health.rows,
            **_pace(health.clock),
            repeats=health.repeats,
            rails=()
            if unmoved
            else tuple(f"{'xyz'[rail.axis]} at its {rail.end} ({rail.value:g})" for rail in health.rails),
            lowest=tuple(health.lows.values.tolist()),
            highest=tuple((-health.highs.values).tolist()),
            onboard_calibration="" if instrument.stored is None else instrument.stored.words,
            is_as_logged=instrument.as_logged,
            is_raw=instrument.stored is not None and not instrument.stored.applied,
            auxiliary=watched.auxiliary,
            unmoved=unmoved,
            coverage=coverage,
            strength=strength,
            columns=instrument.fields,
            resembles=_likeness(instrument, watched.first) if unit is None and columns is None else "",
            ignored_time=instrument.unread_time,
            notes=(*filter(None, (remark,)), *instrument.notes, *map(str, health.skipped)),
        )

    @classmethod
    def silent(cls, number: int, instrument: Instrument, error: InputError) -> Self:
        """A magnetometer without a reading."""
        unit, notes = instrument.unit, (error.message, *instrument.notes)
        return cls(
            number=number, name=instrument.name, unit=unit.name, unit_of_field=unit.inside, readings=0, notes=notes
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """What a file holds."""

    source: str  # path of the file
    format: str  # its format
    bytes: int | None  # its size
    start: str | None  # date and time, UTC
    position: tuple[float, float, float] | None  # latitude and longitude, °, north and east positive; altitude, m
    site: SiteField | None  # what the World Magnetic Model has there
    sensors: tuple[RecordedSensor, ...]  # its magnetometers
    commands: tuple[str, ...]  # what to type next
    notes: tuple[str, ...]  # what else to know

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, under the names of the attributes."""
        return {**asdict(self), "site": None if self.site is None else self.site.as_dict()}


def sensors_of(
    log: Log, topic: str | None = None, *, columns: str | None = None, unit: str | None = None
) -> tuple[RecordedSensor, ...]:
    """Go through the magnetometers of a log, or the one that a topic names; `columns` and `unit` are those asked for.

    Raises `InputError` if none of them has a reading; `UsageError` if the log does not have the topic.
    """
    wanted = log.instruments if topic is None or log.is_table else (log.sensor(topic),)
    sensors, errors = [], []
    for number, instrument in enumerate(log.instruments, 1):
        if instrument in wanted:
            try:
                sensors.append(RecordedSensor.of(number, instrument, columns=columns, unit=unit))
            except InputError as error:
                errors.append(error)
                sensors.append(RecordedSensor.silent(number, instrument, error))
    if len(errors) == len(sensors):
        raise errors[0]
    return tuple(sensors)


def unit_remark(strength: float | None, inside: str) -> str:
    """Say in which unit the strength of readings without one would be the earth's: that alone does not prove it.

    >>> unit_remark(480.0, "counts")
    "as mG the strength would be the earth's: add --unit mG if that is their unit, or --scale with the µT of a count"
    >>> unit_remark(3.0, "counts"), unit_remark(48.0, "uT")
    ('', '')
    """
    name = "" if strength is None or inside != COUNTS else unit_of_the_earth(strength)
    return name and (
        f"as {name} the strength would be the earth's: add --unit {name} if that is their unit, or --scale with the µT "
        "of a count"
    )


class _WatchedInstrument(Wrapped):
    """An instrument whose first block and auxiliary columns are noted as it is gone through."""

    def __init__(self, instrument: Instrument) -> None:
        self.recording = instrument
        self.auxiliary: tuple[str, ...] = ()
        self.first: Samples | None = None

    def blocks(self) -> Iterator[Samples]:
        """Go through the readings."""
        for block in self.recording.blocks():
            self.first = self.first or block
            names = dict.fromkeys((*AUXILIARY, *block.disturbances))
            self.auxiliary = tuple(name for name in names if name in self.auxiliary or _has(block, name))
            yield block


def _has(block: Samples, name: str) -> bool:
    """Whether a column is there, and says anything."""
    column = block.driving(name) if name in block.disturbances else getattr(block, name)
    return column is not None and bool(np.isfinite(column).any())


def _pace(clock: TimeStamps) -> dict[str, Any]:
    """Duration, rate and gaps, as `RecordedSensor` has them; the rate is that without the longest gap."""
    step = (clock.seconds - clock.longest_step) / max(clock.steps - 1, 1)
    return {
        "seconds": clock.seconds if step > 0 else None,
        "rate_hz": 1 / step if step > 0 else None,
        "longest_gap_s": clock.longest_step if step > 0 and clock.longest_step > GAP * step else None,
        "backward_steps": clock.backward_steps,
    }


def _seen(summary: Summary) -> tuple[float | None, float | None]:
    """Share of all directions, and strength of the field, by the ellipsoid through the readings."""
    try:
        surface: Fit | None = fit(summary, method="consistent")
    except FitError as refusal:
        surface = getattr(refusal, "fit", None)
    if surface is None:
        return None, None
    coverage = float(surface.coverage.fraction)
    return coverage, float(surface.calibration.ellipsoid.radius) if coverage >= ENOUGH_SEEN else None


def _unmoved(summary: Summary, unit: str) -> str:
    """Why the readings are those of a sensor that was hardly turned; nothing where it was."""
    try:
        require_moved(summary, unit)
    except Unmoved as refusal:
        return refusal.message
    return ""


def _likeness(instrument: Instrument, first: Samples | None) -> str:
    """What columns without telling names look like, if not like a magnetometer's."""
    columns, names = instrument.name.partition("columns ")[1:]
    is_named = any(not (name.isdecimal() or meaning(name).is_bare) for name in names.split(", "))
    if first is None or not columns or is_named or instrument.unit.inside != COUNTS:
        return ""
    return likeness(first.field)


# ----------------------------------------------------------------------------------------------------------- the page


def of_contents(contents: Contents) -> RenderableType:
    """Lay out what a file holds, and what to type next."""
    sensors = [_sensor_block(sensor, contents.site) for sensor in contents.sensors]
    title = Text("next" if len(contents.commands) == 1 else "next, one of", "bold")
    commands = [Text(f"   {command}", no_wrap=True, overflow="ignore") for command in contents.commands]
    said = Group(title, *commands) if commands else None
    return Group(_file_block(contents), page(*sensors, said))


def commands_for(path: str, sensors: Sequence[RecordedSensor], options: Sequence[str]) -> tuple[str, ...]:
    """The commands to type next: for the magnetometer that has seen most and, where there are several, for all.

    `options` are those with which the recording was read here. None for what looks like another sensor.
    """
    usable = [sensor for sensor in sensors if sensor.readings and not (sensor.resembles or sensor.unmoved)]
    if not usable:
        return ()
    best = max(usable, key=lambda sensor: sensor.coverage or 0.0)
    is_like_an_option = path.startswith("-") and path != "-"
    words = ["flinders", "calibrate", f"./{path}" if is_like_an_option else path, *options]
    if len(sensors) == 1:
        return (shlex.join([*words, "-o", "calibration.json"]),)
    one = shlex.join([*words, "--sensor", str(best.number), "-o", "calibration.json"])
    return one, f"{shlex.join([*words, '--sensor', 'all'])} -o calibration-{{sensor}}.json"


def _file_block(contents: Contents) -> RenderableType:
    size = "" if contents.bytes is None else f", {_written_size(contents.bytes)}"
    rows = []
    if contents.start:
        rows.append(("begun", f"{contents.start} UTC"))
    if contents.position:
        latitude, longitude, altitude = contents.position
        rows.append(("place", f"{latitude:.5f}, {longitude:.5f}, {altitude:.0f} m"))
    if contents.site:
        site = contents.site
        side = "E" if site.declination_deg >= 0 else "W"
        declination = f"declination {abs(site.declination_deg):.1f}° {side}"
        words = f"{site.strength:.2f} µT, dip {site.inclination_deg:.1f}°, {declination} ({site.model})"
        rows.append(("field there", words))
    return _block(contents.source, f"{contents.format}{size}", rows, notes=contents.notes)


def _sensor_block(sensor: RecordedSensor, site: SiteField | None) -> RenderableType:
    unit = label(sensor.unit_of_field)
    known = f"in {sensor.unit}" + (f", shown in {unit}" if sensor.unit not in {sensor.unit_of_field, COUNTS} else "")
    title = f"{sensor.number}  {sensor.name}"
    if not sensor.readings:
        return _block(title, known, [], doubts=sensor.notes)
    rows = [("readings", _readings(sensor))]
    if sensor.onboard_calibration:
        became = "logged raw, before it" if sensor.is_raw else "left on" if sensor.is_as_logged else "removed here"
        rows.append(("on board", f"{sensor.onboard_calibration}; {became}"))
    ends = zip("xyz", sensor.lowest, sensor.highest, strict=True)
    rows.append(("range", "   ".join(f"{axis} {figures(low, 3)} to {figures(high, 3)}" for axis, low, high in ends)))
    if sensor.coverage is not None:
        rows.append(("seen", f"roughly {sensor.coverage:.0%} of all directions"))
    if sensor.strength is not None:
        share = ""
        if site is not None and sensor.unit_of_field != COUNTS:
            share = f", {sensor.strength / site.strength:.2f} of the field there"
        rows.append(("strength", f"{figures(sensor.strength, 4)} {unit} by the ellipsoid through them{share}"))
    rows.append(("auxiliary", ", ".join(sensor.auxiliary) or "none"))
    return _block(title, known, rows, doubts=_doubts(sensor, site), notes=sensor.notes)


def _block(
    title: str, words: str, rows: Sequence[tuple[str, str]], *, doubts: Sequence[str] = (), notes: Sequence[str] = ()
) -> RenderableType:
    """A title in bold, what is known in two columns, and what to know with its mark before it."""
    shown = [Padding(facts(rows, TITLES), (0, 0, 0, 3))] if rows else []
    said = marked([*(("limits", doubt) for doubt in doubts), *(("note", note) for note in notes)])
    return Group(Text.assemble((title, "bold"), f"  {words}"), *shown, Padding(said, (0, 0, 0, 1)))


def _readings(sensor: RecordedSensor) -> str:
    words = f"{sensor.readings:,}"
    if sensor.rate_hz is not None and sensor.seconds is not None:
        words += f" at {figures(sensor.rate_hz, 3)} Hz over {written_time(sensor.seconds)}"
    return words if sensor.longest_gap_s is None else f"{words}; longest gap {written_time(sensor.longest_gap_s)}"


def _doubts(sensor: RecordedSensor, site: SiteField | None) -> list[str]:
    """What is odd about the readings; of a sensor that was hardly turned nothing that follows from that."""
    doubts = [sensor.unmoved] if sensor.unmoved else _of_values(sensor)
    if sensor.ignored_time:
        doubts.append(
            f"no time is read, {sensor.ignored_time} is left out: write it as numbers that rise, or as "
            "2026-11-22 14:03:07.25"
        )
    if sensor.backward_steps:
        doubts.append(f"the clock goes back {counted(sensor.backward_steps, 'time')}")
    if sensor.strength is not None and sensor.unit_of_field != COUNTS:
        low, high = EARTH_WITH_ROOM_UT if site is None else ((1 - OFF) * site.strength, (1 + OFF) * site.strength)
        if not low <= sensor.strength <= high:
            doubts.append("that is no strength of the earth's field here: check unit, scale and iron nearby")
    return doubts


def _of_values(sensor: RecordedSensor) -> list[str]:
    """What is odd about the values of a sensor that was turned."""
    doubts = []
    if sensor.resembles:
        columns = shlex.quote(",".join(sensor.columns))
        doubts.append(looks_like(sensor.resembles, f"--columns {columns}"))
    if sensor.repeats > STALE * sensor.readings:
        doubts.append(f"{sensor.repeats / sensor.readings:.0%} of the readings repeat the one before: logged too often")
    if sensor.rails:
        doubts.append(f"the sensor was at its limit: {', '.join(sensor.rails)}")
    stuck = [a for a, low, high in zip("xyz", sensor.lowest, sensor.highest, strict=True) if low == high]
    if stuck:
        doubts.append(f"{' and '.join(stuck)} never {'changes' if len(stuck) == 1 else 'change'}: check the wiring")
    return doubts


def _written_size(size: int) -> str:
    for unit, least in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= least:
            return f"{figures(size / least)} {unit}"
    return f"{size} bytes"
