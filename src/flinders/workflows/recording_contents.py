"""Contents of a recording or log: its magnetometers and the columns recorded with them, in one pass.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1)
>>> path = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> simulate.write_csv(tumble.samples, path)
>>> (sensor,) = contents(path).sensors
>>> sensor.readings, round(sensor.rate_hz), sensor.auxiliary, sensor.coverage > 0.9
(3000, 50, ('time', 'acceleration', 'rate'), True)
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.chips import chip_of_device, chips_named_in, find_chip
from flinders.core.geomag import recorded_field
from flinders.core.keywords import check_keywords
from flinders.core.samples import RecordingWrapper
from flinders.core.units import COUNTS, earth_field_unit
from flinders.diagnostics.unmoved import require_moved
from flinders.errors import FitError, InputError, TooFewSamples, Unmoved, count_text, python_arguments
from flinders.estimators.likelihood import Likelihood
from flinders.fitting.calibrate import fit
from flinders.readers import Log, open_log
from flinders.readers._likeness import likeness
from flinders.readers._names import meaning
from flinders.summary.summary import Summary
from flinders.workflows.chip_proposal import ChipEvidence, ChipProposal, propose_chip

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from flinders.core.chips import Chip
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Samples
    from flinders.errors import Spelling
    from flinders.fitting.result import Fit
    from flinders.readers import Instrument
    from flinders.summary.quality import TimeStamps

AUXILIARY: Final = ("time", "acceleration", "rate", "temperature", "current", "throttle", "attitude", "strength")
"""Other columns of a reading, by their names in `Samples`; ``current1`` and so on for single motors."""

MIN_GAP_STEPS: Final = 5.0
"""Smallest gap, in mean steps between readings; the longest step does not count in the mean."""

MIN_COVERAGE: Final = 0.5
"""Smallest coverage of directions for which the size of the ellipsoid is shown."""

MAX_SAMPLE: Final = 4096
"""Largest number of readings, at the start, whose steps are used to propose a chip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """Options of a call of `contents`, and the field at the place."""

    columns: str | None = None
    unit: str | None = None
    chip: Chip | None = None
    site_ut: float | None = None  #: µT: field at the place, if known
    spell: Spelling = python_arguments


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSensor:
    """One magnetometer of a recording."""

    number: int  # number of the sensor for ``--sensor``, from 1
    name: str  # name of the instrument or of its columns
    unit: str  # unit of the recorded numbers
    unit_of_field: str  # unit of `lowest`, `highest` and `strength`
    readings: int  # number of readings
    seconds: float | None = None  # time from the first to the last reading; None without a clock
    rate_hz: float | None = None  # mean rate without the longest step; None without a clock
    longest_gap_s: float | None = None  # the longest step if it is a gap, else None
    backward_steps: int = 0  # number of steps back in time
    repeats: int = 0  # number of readings equal to the previous one
    rails: tuple[str, ...] = ()  # ends of axes at which the sensor was saturated
    lowest: tuple[float, ...] = ()  # (3,): smallest reading of each axis
    highest: tuple[float, ...] = ()  # (3,): largest reading of each axis
    onboard_calibration: str = ""  # the onboard calibration, in words
    is_as_logged: bool = False  # whether the onboard calibration was not removed from the readings
    is_raw: bool = False  # whether readings were logged before the onboard calibration, so that it need not be removed
    auxiliary: tuple[str, ...] = ()  # columns recorded with it, such as time and acceleration
    too_few: str = ""  # sentence that the readings are too few for a fit; empty if they are enough
    unmoved: str = ""  # sentence that the sensor was hardly turned; empty if it was turned
    # fraction of all directions covered; None if no ellipsoid fits, or if the sensor was hardly turned
    coverage: float | None = None
    strength: float | None = None  # field strength by that ellipsoid; None if the coverage is too small
    columns: tuple[str, ...] = ()  # names of the columns of x, y and z, in a table
    resembles: str = ""  # quantity that its values resemble, such as gravity, if no name states a magnetometer
    chip: ChipProposal | None = None  # chips proposed by names and readings, with unit and axes; None if unknown
    ignored_time: str = ""  # names of columns that are called a time but are not read, if no time is read
    notes: tuple[str, ...] = ()  # other notes, a sentence each

    @classmethod
    def of(cls, number: int, instrument: Instrument, request: Request) -> Self:
        """Read one magnetometer in one pass; if its unit or columns are not given, its values may show them.

        Raises `InputError` if there are no readings.
        """
        watched = _WatchedInstrument(instrument)
        summary = Summary.of_recording(watched)
        unmoved = _unmoved_words(summary, instrument.unit.inside)
        too_few = "" if unmoved else _too_few_words(summary)
        coverage, strength = (None, None) if too_few or unmoved else _coverage_and_strength(summary)
        health = summary.health
        resembles = _resemblance(instrument, watched.first) if request.unit is None and request.columns is None else ""
        chip = None if resembles else _proposal_for(instrument, watched.first, summary, strength, request)
        is_unit_open = request.unit is None and (chip is None or not chip.unit)
        remark = unit_remark(strength, instrument.unit.inside, request.spell) if is_unit_open else ""
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
            too_few=too_few,
            unmoved=unmoved,
            coverage=coverage,
            strength=strength,
            columns=instrument.fields,
            resembles=resembles,
            chip=chip,
            ignored_time=instrument.unread_time,
            notes=(*filter(None, (remark,)), *instrument.notes, *map(str, health.skipped)),
        )

    @classmethod
    def without_readings(cls, number: int, instrument: Instrument, error: InputError) -> Self:
        """Entry for a magnetometer without readings."""
        unit, notes = instrument.unit, (error.message, *instrument.notes)
        return cls(
            number=number, name=instrument.name, unit=unit.name, unit_of_field=unit.inside, readings=0, notes=notes
        )

    @property
    def is_fit_for_use(self) -> bool:
        """Whether the sensor can be calibrated: a magnetometer that was turned, with enough readings."""
        return bool(self.readings) and not (self.resembles or self.too_few or self.unmoved)

    def __str__(self) -> str:
        parts = (
            self.name,
            f"{count_text(self.readings, 'reading')} in {self.unit}",
            "" if self.rate_hz is None else f"{self.rate_hz:.3g} Hz",
            "hardly turned" if self.unmoved else "",
            "" if self.coverage is None else f"{self.coverage:.0%} of directions",
            f"with {', '.join(self.auxiliary)}" if self.auxiliary else "",
        )
        return ", ".join(filter(None, parts))

    def __repr__(self) -> str:
        return f"RecordedSensor({self.number}, {self})"


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """Contents of a recording file."""

    source: str  # path of the file
    format: str  # its format
    bytes: int | None  # size of the file
    start: str | None  # date and time of the start, UTC
    position: tuple[float, float, float] | None  # latitude and longitude, °, north and east positive; altitude, m
    site: SiteField | None  # field at the position by the model
    sensors: tuple[RecordedSensor, ...]  # its magnetometers
    commands: tuple[str, ...] = ()  # suggested next commands
    notes: tuple[str, ...] = ()  # other notes, a sentence each

    def __repr__(self) -> str:
        named = ", ".join(f"{each.number} {each.name}" for each in self.sensors)
        held = str(self.sensors[0]) if len(self.sensors) == 1 else f"{len(self.sensors)} magnetometers: {named}"
        return f"Contents({Path(self.source).name}, {self.format}: {held})"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, by the names of the attributes."""
        return {**asdict(self), "site": None if self.site is None else self.site.as_dict()}


@check_keywords()
def contents(
    source: Log | str | os.PathLike[str],
    *,
    topic: str | None = None,
    columns: str | None = None,
    unit: str | None = None,
    chip: str | None = None,
    site: SiteField | None = None,
    spell: Spelling = python_arguments,
    **reading: Any,
) -> Contents:
    """Read each magnetometer of a file once, and list the contents of the file.

    Parameters
    ----------
    source : path or Log
        A path for `flinders.open_log`, or a `Log` from it.
    topic : str, optional
        One magnetometer of a log, or one member of an archive.
    columns, unit
        As for `flinders.open_log`. If they are not given, the values may show the unit, or that columns with unknown
        names are not a magnetometer.
    chip : str, optional
        Name of the magnetometer chip, or of a package that contains it, if the file does not name it.
    site : SiteField, optional
        Field at the place; by default that of a log that states place and time.
    spell : callable
        Writes arguments in notes in the form of an interface.
    **reading
        Other parameters of `flinders.open_log`, if `source` is a path.

    Raises
    ------
    InputError
        For a file that cannot be read, or has no readings.
    UsageError
        For an unknown topic, or a chip that the table of chips lacks.

    Examples
    --------
    See the head of this module.
    """
    named = None if chip is None else find_chip(chip)
    log = source
    if not isinstance(log, Log):
        log = open_log(log, topic=topic, columns=columns, unit=unit, **reading)
    file, position = log.instruments[0].file, log.position
    site = recorded_field(log) if site is None else site
    site_ut = None if site is None else site.strength
    return Contents(
        source=log.source,
        format=log.format,
        bytes=None if file is None else file.size,
        start=None if log.start_time is None else log.start_time.strftime("%Y-%m-%d %H:%M:%S"),
        position=None if position is None else (position.latitude_deg, position.longitude_deg, position.altitude_m),
        site=site,
        sensors=_sensors_of(log, topic, Request(columns=columns, unit=unit, chip=named, site_ut=site_ut, spell=spell)),
        notes=log.notes,
    )


def _sensors_of(log: Log, topic: str | None, request: Request) -> tuple[RecordedSensor, ...]:
    """Read the magnetometers of a log, or the one of a topic.

    Raises `InputError` if none of them has readings, and `UsageError` if the log does not have the topic.
    """
    wanted = log.instruments if topic is None or log.is_table else (log.sensor(topic),)
    sensors, errors = [], []
    for number, instrument in enumerate(log.instruments, 1):
        if instrument in wanted:
            try:
                sensors.append(RecordedSensor.of(number, instrument, request))
            except InputError as error:
                errors.append(error)
                sensors.append(RecordedSensor.without_readings(number, instrument, error))
    if len(errors) == len(sensors):
        raise errors[0]
    return tuple(sensors)


def unit_remark(strength: float | None, inside: str, spell: Spelling = python_arguments) -> str:
    """Sentence on the unit in which readings without a unit would have the strength of the earth's field.

    >>> unit_remark(480.0, "counts")
    "as mG the strength would be the earth's: add unit='mG' if that is their unit, or scale with the µT of a count"
    >>> unit_remark(3.0, "counts"), unit_remark(48.0, "uT")
    ('', '')
    """
    name = "" if strength is None or inside != COUNTS else earth_field_unit(strength)
    return name and (
        f"as {name} the strength would be the earth's: add {spell({'unit': name})} if that is their unit, or "
        f"{spell({'scale': None}).rstrip('=')} with the µT of a count"
    )


class _WatchedInstrument(RecordingWrapper):
    """An instrument that keeps its first block, and the names of its auxiliary columns, while it is read."""

    def __init__(self, instrument: Instrument) -> None:
        self.recording = instrument
        self.auxiliary: tuple[str, ...] = ()
        self.first: Samples | None = None

    def blocks(self) -> Iterator[Samples]:
        """Yield the blocks of readings."""
        for block in self.recording.blocks():
            self.first = self.first or block
            names = dict.fromkeys((*AUXILIARY, *block.disturbances))
            self.auxiliary = tuple(name for name in names if name in self.auxiliary or _has(block, name))
            yield block


def _has(block: Samples, name: str) -> bool:
    """Whether a block has a column with values."""
    column = block.disturbance_values(name) if name in block.disturbances else getattr(block, name)
    return column is not None and bool(np.isfinite(column).any())


def _pace(clock: TimeStamps) -> dict[str, Any]:
    """Duration, rate and gaps as fields of `RecordedSensor`; the rate excludes the longest step."""
    step = (clock.seconds - clock.longest_step) / max(clock.steps - 1, 1)
    return {
        "seconds": clock.seconds if step > 0 else None,
        "rate_hz": 1 / step if step > 0 else None,
        "longest_gap_s": clock.longest_step if step > 0 and clock.longest_step > MIN_GAP_STEPS * step else None,
        "backward_steps": clock.backward_steps,
    }


def _coverage_and_strength(summary: Summary) -> tuple[float | None, float | None]:
    """Covered fraction of all directions, and field strength, by the ellipsoid through the readings."""
    try:
        surface: Fit | None = fit(summary, method="consistent")
    except FitError as refusal:
        surface = getattr(refusal, "fit", None)
    if surface is None:
        return None, None
    coverage = float(surface.evidence.coverage.fraction)
    return coverage, float(surface.calibration.ellipsoid.radius) if coverage >= MIN_COVERAGE else None


def _too_few_words(summary: Summary) -> str:
    """Sentence that the different readings are too few for a fit; empty if they are enough."""
    found, total, needed = summary.health.distinct, summary.health.rows, Likelihood.unknowns
    if found >= needed:
        return ""
    among = total if total >= needed else 0
    return TooFewSamples(found=found if among else total, needed=needed, method=Likelihood.name, among=among).message


def _unmoved_words(summary: Summary, unit: str) -> str:
    """Sentence that the sensor was hardly turned; empty if it was turned, or if there are few readings."""
    if summary.health.rows < Likelihood.unknowns:
        return ""
    try:
        require_moved(summary, unit)
    except Unmoved as refusal:
        return refusal.message
    return ""


def _resemblance(instrument: Instrument, first: Samples | None) -> str:
    """Quantity that the values of unnamed columns resemble; empty if they resemble a magnetic field."""
    columns, names = instrument.name.partition("columns ")[1:]
    is_named = any(not (name.isdecimal() or meaning(name).is_bare) for name in names.split(", "))
    if first is None or not columns or is_named or instrument.unit.inside != COUNTS:
        return ""
    return likeness(first.field)


def propose_chip_of(samples: Samples, spell: Spelling = python_arguments) -> ChipProposal | None:
    """Propose unit and axes for samples in memory, by their counts; None if the counts are not sufficient.

    >>> from flinders import simulate
    >>> propose_chip_of(simulate.tumble(seed=1).samples) is None  # they are in microtesla
    True
    """
    summary = Summary.of_recording(samples)
    strength = (
        None
        if _too_few_words(summary) or _unmoved_words(summary, samples.unit.inside)
        else _coverage_and_strength(summary)[1]
    )
    evidence = ChipEvidence(
        sample=samples.field[:MAX_SAMPLE],
        lowest=summary.health.lows.values,
        highest=-summary.health.highs.values,
        strength=strength,
        unit=samples.unit.inside,
    )
    return propose_chip(evidence, spell)


def _proposal_for(
    instrument: Instrument, first: Samples | None, summary: Summary, strength: float | None, request: Request
) -> ChipProposal | None:
    """Propose the chip of a magnetometer by its names and its readings."""
    found, where = _chips_by_name(instrument, request.chip)
    evidence = ChipEvidence(
        sample=np.empty((0, 3)) if first is None else first.field[:MAX_SAMPLE],
        lowest=summary.health.lows.values,
        highest=-summary.health.highs.values,
        strength=strength,
        unit=instrument.unit.inside if instrument.unit.name == COUNTS else instrument.unit.name,
        chips=found,
        named_by=where,
        site_ut=request.site_ut,
        is_mapped=instrument.autopilot is not None or not instrument.axes.is_identity,
    )
    return propose_chip(evidence, request.spell)


def _chips_by_name(instrument: Instrument, given: Chip | None) -> tuple[tuple[Chip, ...], str]:
    """Chips that match a name, and where the name is from: the caller, a device id, instrument, columns or file."""
    if given is not None:
        return (given,), "the request"
    if instrument.autopilot is not None and instrument.device_id is not None:
        chip = chip_of_device(instrument.device_id, instrument.autopilot)
        return ((chip,), f"device id {instrument.device_id}") if chip else ((), "")
    names = {
        f"the name {instrument.name}": instrument.name,
        "the names of the columns": " ".join(instrument.fields),
        f"the file name {Path(instrument.source).name}": Path(instrument.source).name,
    }
    return next(((found, where) for where, text in names.items() if (found := chips_named_in(text))), ((), ""))
