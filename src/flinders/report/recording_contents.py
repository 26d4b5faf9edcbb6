"""What a recording or a log holds: its magnetometers, gone through once, and what was recorded with them.

>>> likely_unit(48.0, "counts"), likely_unit(480.0, "counts"), likely_unit(3.0, "counts"), likely_unit(48.0, "uT")
('uT', 'mG', '', '')
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.samples import Wrapped
from flinders.core.units import COUNTS, unit_of_the_earth
from flinders.diagnostics.unmoved import require_moved
from flinders.errors import FitError, InputError, Unmoved
from flinders.fitting.calibrate import fit
from flinders.readers._likeness import likeness
from flinders.readers._names import meaning
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.core.geomag import SiteField
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit
    from flinders.readers import Instrument, Log
    from flinders.summary.quality import Rail, TimeStamps

AUXILIARY: Final = ("time", "acceleration", "rate", "temperature", "current", "throttle", "attitude", "strength")
"""What may be recorded with a reading, as `Samples` calls it; besides, ``current1`` and so on of each motor."""
GAP: Final = 5.0
"""Usual steps from one reading to the next that make a gap."""
ENOUGH_SEEN: Final = 0.5
"""Of all directions, below which the size of an ellipsoid is a guess, and not shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSensor:
    """One magnetometer of a recording.

    Attributes
    ----------
    number : int
        Counted from 1, as ``--sensor`` takes it.
    name : str
    unit, inside : str
        What it is written in, and what `lowest`, `highest` and `strength` are in.
    readings : int
    seconds, rate_hz, longest_gap_s : float or None
        From the first to the last; mean rate but for the longest step; that step, where it is a gap. None without a
        clock.
    backward_steps : int
        Steps of the clock that go back.
    repeats : int
        Readings that are equal to the one before.
    rails : tuple of str
        Ends of axes at which the sensor was at its limit.
    lowest, highest : (3,) float
    stored : str
        The calibration that was in force, in words.
    is_as_logged : bool
        It was left on.
    auxiliary : tuple of str
        Columns that were recorded with it, such as time and acceleration.
    unmoved : str
        Why the sensor was hardly turned, in words; nothing where it was.
    coverage : float or None
        Of all directions, seen; None where no ellipsoid fits, or the sensor was hardly turned.
    strength : float or None
        Of the field, by that ellipsoid; None where too little is seen.
    likeness : str
        What its values look like, such as gravity, where no name says that it is a magnetometer.
    notes : tuple of str
        What else to know, a sentence each.
    """

    number: int
    name: str
    unit: str
    inside: str
    readings: int
    seconds: float | None = None
    rate_hz: float | None = None
    longest_gap_s: float | None = None
    backward_steps: int = 0
    repeats: int = 0
    rails: tuple[str, ...] = ()
    lowest: tuple[float, ...] = ()
    highest: tuple[float, ...] = ()
    stored: str = ""
    is_as_logged: bool = False
    auxiliary: tuple[str, ...] = ()
    unmoved: str = ""
    coverage: float | None = None
    strength: float | None = None
    likeness: str = ""
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, number: int, instrument: Instrument, *, columns: str | None, unit: str | None) -> Self:
        """Go through one magnetometer; where its unit or columns were not given, its values may tell them.

        Raises
        ------
        InputError
            If it has no reading.
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
            inside=instrument.unit.inside,
            readings=health.rows,
            **_pace(health.clock),
            repeats=health.repeats,
            rails=() if unmoved else tuple(_at_its_limit(rail) for rail in health.rails),
            lowest=tuple(health.lows.values.tolist()),
            highest=tuple((-health.highs.values).tolist()),
            stored="" if instrument.stored is None else instrument.stored.words,
            is_as_logged=instrument.as_logged,
            auxiliary=watched.auxiliary,
            unmoved=unmoved,
            coverage=coverage,
            strength=strength,
            likeness=_likeness(instrument, watched.first) if unit is None and columns is None else "",
            notes=(*filter(None, (remark,)), *instrument.notes, *map(str, health.skipped)),
        )

    @classmethod
    def silent(cls, number: int, instrument: Instrument, error: InputError) -> Self:
        """A magnetometer without a reading."""
        unit, notes = instrument.unit, (str(error), *instrument.notes)
        return cls(number=number, name=instrument.name, unit=unit.name, inside=unit.inside, readings=0, notes=notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """What a file holds.

    Attributes
    ----------
    source, format : str
    bytes : int or None
    begun : str or None
        Date and time, UTC.
    position : tuple of float or None
        Latitude and longitude in degrees, north and east positive, and altitude in metres.
    site : SiteField or None
        The field that the World Magnetic Model has there.
    sensors : tuple of RecordedSensor
    commands : tuple of str
        What to type next.
    notes : tuple of str
    """

    source: str
    format: str
    bytes: int | None
    begun: str | None
    position: tuple[float, float, float] | None
    site: SiteField | None
    sensors: tuple[RecordedSensor, ...]
    commands: tuple[str, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, under the names of the attributes."""
        sensors = [
            {"beside" if name == "auxiliary" else name: value for name, value in asdict(sensor).items()}
            for sensor in self.sensors
        ]
        return {**asdict(self), "site": None if self.site is None else self.site.as_dict(), "sensors": sensors}


def sensors_of(
    log: Log, topic: str | None = None, *, columns: str | None = None, unit: str | None = None
) -> tuple[RecordedSensor, ...]:
    """Go through the magnetometers of a log, or the one that a topic names.

    Parameters
    ----------
    log : Log
    topic : str, optional
        Of an archive it has named the member already.
    columns, unit : str, optional
        Those that the log was opened with.

    Raises
    ------
    InputError
        If none of them has a reading.
    UsageError
        If the log does not have the topic.
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


def likely_unit(strength: float | None, inside: str) -> str:
    """The unit in which a strength would be that of the earth, where none is known; nothing where none would do."""
    return "" if strength is None or inside != COUNTS else unit_of_the_earth(strength)


def unit_remark(strength: float | None, inside: str) -> str:
    """Say which unit readings without one may be in: a strength alone does not prove it.

    >>> unit_remark(480.0, "counts")
    "as mG the strength would be the earth's: add --unit mG if that is their unit, or --scale with the µT of a count"
    >>> unit_remark(3.0, "counts")
    ''
    """
    name = likely_unit(strength, inside)
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
    return coverage, float(surface.ellipsoid.radius) if coverage >= ENOUGH_SEEN else None


def _unmoved(summary: Summary, unit: str) -> str:
    """Why the readings are those of a sensor that was hardly turned; nothing where it was."""
    try:
        require_moved(summary, unit)
    except Unmoved as refusal:
        return str(refusal)
    return ""


def _likeness(instrument: Instrument, first: Samples | None) -> str:
    """What columns without telling names look like, if not like a magnetometer's."""
    columns, names = instrument.name.partition("columns ")[1:]
    is_named = any(not (name.isdecimal() or meaning(name).is_bare) for name in names.split(", "))
    if first is None or not columns or is_named or instrument.unit.inside != COUNTS:
        return ""
    return likeness(first.field)


def _at_its_limit(rail: Rail) -> str:
    """Name the end of an axis at which the sensor was at its limit."""
    return f"{'xyz'[rail.axis]} at its {rail.end} ({rail.value:g})"
