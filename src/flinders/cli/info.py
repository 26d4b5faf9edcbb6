"""``flinders info``: what a recording holds, and what to type next."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options
from flinders.cli._inputs import is_calibration, site_of
from flinders.cli._output import print_json, progress, show
from flinders.errors import FitError, InputError, Unmoved, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.cli._options import Place, ReadingOptions
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit
    from flinders.readers import Instrument, Log
    from flinders.report.recording_page import RecordedSensor
    from flinders.summary.quality import Rail
    from flinders.summary.summary import Summary

BESIDE = ("time", "acceleration", "rate", "temperature", "current", "throttle", "attitude", "strength")
"""What may stand beside a reading, as `Samples` calls it; besides, ``current1`` and so on of each motor."""


@_options.command(
    "info",
    common=("columns", "unit", "place", "date", "as_json"),
    short_help="Say what a recording or a log holds, and what to type next.",
    epilog="""\b
Example:
  flinders info flight.bin
  flinders info walk.zip --at 47.62,-122.35 --date 2026-11-21
  flinders info table.parquet --columns bx,by,bz --unit nT --json
""",
)
@click.argument("log", metavar="LOG")
@_options.groups(reading=_options.ReadingOptions, place=_options.Place)
@_options.as_json
def command(log: str, as_json: bool, reading: ReadingOptions, place: Place) -> None:
    """Say what LOG holds: its magnetometers, their rate, range and gaps, and what stands beside them.

    Also the calibration that was in force on board, place and time, and the field that is expected there; how many
    directions were seen, and the command to type next. LOG is any recording that `flinders calibrate` takes.
    """
    from flinders.readers import open_log
    from flinders.report.recording_page import of_contents

    if is_calibration(log):
        raise UsageError(f"{log} is a calibration: give a recording; flinders compare shows what a calibration says")
    if place.date is not None and place.place is None:
        raise UsageError("--date is for the field at a place: give --at LAT,LON too")
    with progress("reading") as watch:
        contents = _contents(open_log(log, progress=watch, **reading.as_dict()), log, place, reading)
    if as_json:
        print_json(contents.as_dict())
    else:
        show(of_contents(contents))


def _contents(log: Log, path: str, place: Place, reading: ReadingOptions) -> Any:  # noqa: ANN401 - Contents, which needs NumPy
    """Go through each magnetometer once, and put together what was found.

    Raises
    ------
    InputError
        Where none of them has a reading.
    UsageError
        For a topic that there is not.
    """
    from flinders.report.recording_page import Contents, commands_for

    site = _site(log, place)
    wanted = _wanted(log, reading.topic)
    sensors, refusals = [], []
    for number, instrument in enumerate(log.instruments, 1):
        if instrument not in wanted:
            continue
        try:
            sensors.append(_seen(number, instrument, is_unit_open=reading.unit is None, columns=reading.columns))
        except InputError as error:
            refusals.append(error)
            sensors.append(_silent(number, instrument, error))
    if len(refusals) == len(sensors):
        raise refusals[0]
    options = [word for name, value in reading.as_dict().items() for word in _given(name, value)]
    file = log.instruments[0].file
    where = log.position
    return Contents(
        source=log.source,
        format=log.format,
        bytes=None if file is None else file.size,
        begun=None if log.begun is None else log.begun.strftime("%Y-%m-%d %H:%M:%S"),
        position=None if where is None else (where.latitude_deg, where.longitude_deg, where.altitude_m),
        site=site,
        sensors=tuple(sensors),
        commands=commands_for(path, sensors, options),
        notes=log.notes,
    )


def _wanted(log: Log, topic: str | None) -> Sequence[Instrument]:
    """The magnetometers of a log, or the one that a topic names; of an archive it has named the member already."""
    return log.instruments if topic is None or log.is_table else (log.sensor(topic),)


def _given(name: str, value: object) -> list[str]:
    """An option as it is typed; nothing where it is left at its default.

    >>> _given("start", 5.0), _given("as_logged", True), _given("axes", "x,y,z")
    (['--from', '5'], ['--as-logged'], [])
    """
    if value in (None, False, "x,y,z"):
        return []
    option = {"start": "--from", "end": "--to"}.get(name, f"--{name.replace('_', '-')}")
    if value is True:
        return [option]
    return [option, f"{value:.12g}" if isinstance(value, float) else str(value)]


def _site(log: Log, place: Place) -> SiteField | None:
    """The field at the place that is given, or that the log knows, on its day.

    Raises
    ------
    UsageError
        For a place or day that is given and is none.
    """
    from flinders.core.geomag import FIRST_YEAR, LAST_YEAR, site_field, year_of

    if place.place is not None:
        day = place.date or (log.begun.date().isoformat() if log.begun else None)
        return site_of(place.place, day)
    if log.position is None or log.begun is None or not FIRST_YEAR <= log.begun.year < LAST_YEAR:
        return None
    where = log.position
    return site_field(where.latitude_deg, where.longitude_deg, where.altitude_m, year=year_of(log.begun))


def _seen(number: int, instrument: Instrument, *, is_unit_open: bool, columns: str | None) -> RecordedSensor:
    """Go through one magnetometer; where nobody has said its unit or columns, its strength may tell."""
    from flinders.report.recording_page import ENOUGH_SEEN, GAP, RecordedSensor, unit_remark
    from flinders.summary.summary import Summary

    watched = _Watched(instrument)
    summary = Summary.through(watched)
    health = summary.health
    clock = health.clock
    step = (clock.seconds - clock.longest_step) / max(clock.steps - 1, 1)  # without its longest gap
    unmoved = _unmoved(summary, instrument.unit.inside)
    fit = None if unmoved else _fit(summary)
    coverage = None if fit is None else float(fit.coverage.fraction)
    is_seen = coverage is not None and coverage >= ENOUGH_SEEN
    strength = float(fit.ellipsoid.radius) if fit is not None and is_seen else None
    remark = unit_remark(strength, instrument.unit.inside) if is_unit_open else ""
    return RecordedSensor(
        number=number,
        name=instrument.name,
        unit=instrument.unit.name,
        inside=instrument.unit.inside,
        readings=health.rows,
        seconds=clock.seconds if step > 0 else None,
        rate_hz=1 / step if step > 0 else None,
        longest_gap_s=clock.longest_step if step > 0 and clock.longest_step > GAP * step else None,
        backward_steps=clock.backward_steps,
        repeats=health.repeats,
        rails=() if unmoved else tuple(_words(rail) for rail in health.rails),
        lowest=tuple(health.lows.values.tolist()),
        highest=tuple((-health.highs.values).tolist()),
        stored="" if instrument.stored is None else instrument.stored.words,
        is_as_logged=instrument.as_logged,
        beside=watched.beside,
        unmoved=unmoved,
        coverage=coverage,
        strength=strength,
        likeness=_likeness(instrument, watched.first) if is_unit_open and columns is None else "",
        notes=(*filter(None, (remark,)), *instrument.notes, *map(str, health.skipped)),
    )


def _likeness(instrument: Instrument, first: Samples | None) -> str:
    """What columns without telling names look like, if not like a magnetometer's."""
    from flinders.core.units import COUNTS
    from flinders.readers._instruments import likeness
    from flinders.readers._names import meaning

    columns, names = instrument.name.partition("columns ")[1:]
    is_determined = any(not (name.isdecimal() or meaning(name).is_bare) for name in names.split(", "))
    return (
        ""
        if first is None or not columns or is_determined or instrument.unit.inside != COUNTS
        else likeness(first.field)
    )


def _silent(number: int, instrument: Instrument, error: InputError) -> RecordedSensor:
    """A magnetometer without a reading."""
    from flinders.report.recording_page import RecordedSensor

    unit = instrument.unit
    notes = (str(error), *instrument.notes)
    return RecordedSensor(
        number=number, name=instrument.name, unit=unit.name, inside=unit.inside, readings=0, notes=notes
    )


def _words(rail: Rail) -> str:
    """Name the end of an axis at which the sensor was at its limit."""
    return f"{'xyz'[rail.axis]} at its {rail.end} ({rail.value:g})"


def _unmoved(summary: Summary, unit: str) -> str:
    """Why the readings are those of a sensor that was hardly turned; nothing where it was."""
    from flinders.diagnostics.unmoved import require_moved

    try:
        require_moved(summary, unit)
    except Unmoved as refusal:
        return str(refusal)
    return ""


def _fit(summary: Summary) -> Fit | None:
    """The ellipsoid through the readings, for its size and what was seen; None where there is none."""
    from flinders.fitting.calibrate import fit

    try:
        return fit(summary, method="consistent")
    except FitError as refusal:
        refused: Fit | None = getattr(refusal, "fit", None)
        return refused


class _Watched:
    """An instrument that is gone through, and what stood beside its readings."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        self.source, self.unit, self.axes = instrument.source, instrument.unit, instrument.axes
        self.beside: tuple[str, ...] = ()
        self.first: Samples | None = None

    def blocks(self) -> Any:  # noqa: ANN401 - an iterator of blocks
        """Go through the readings."""
        for block in self._instrument.blocks():
            self.first = self.first or block
            names = dict.fromkeys((*BESIDE, *block.disturbances))
            self.beside = tuple(name for name in names if name in self.beside or _has(block, name))
            yield block


def _has(block: Samples, name: str) -> bool:
    """Whether a column is there, and says anything."""
    import numpy as np

    column = block.driving(name) if name in block.disturbances else getattr(block, name)
    return column is not None and bool(np.isfinite(column).any())
