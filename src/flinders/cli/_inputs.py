"""Inputs of commands: recordings with counts of skipped lines, calibration files, and the place of a recording."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from flinders.cli._output import refuse_twice, say
from flinders.errors import DocumentError, FlindersError, TooFewSamples, UsageError, count_text, figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from datetime import datetime

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ColumnsRecord, ProvenanceRecord, SourceFile
    from flinders.core.geomag import FieldModel, SiteField
    from flinders.core.offset_walk import Walk
    from flinders.core.samples import Recording, Skipped
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.likelihood.site_field import Site
    from flinders.readers._source import File


@contextlib.contextmanager
def report_readings(parts: Sequence[CountedRecording], *, is_field: bool = True) -> Iterator[None]:
    """Report the number of readings when the block ends, and add skipped lines to an error of too few readings.

    `is_field` is False for columns that are not magnetic readings; their unit is not printed.
    """
    try:
        yield
    except TooFewSamples as error:
        from flinders.workflows.recordings import with_left_out

        raise with_left_out(error, parts) from None
    finally:
        for part in parts:
            say_read(part, is_field=is_field)


def say_read(part: CountedRecording, *, is_field: bool = True) -> None:
    """Print a recording's number of readings, and the lines that were skipped."""
    from flinders.core.units import COUNTS

    if part.rows or part.skipped:
        what = str(part.recording) if is_field else str(part.recording).replace(f" in {COUNTS}", "", 1)
        say(f"{what}; {read_and_left_out(part.rows, part.skipped)}")


def read_and_left_out(rows: int, skipped: Iterable[Skipped]) -> str:
    """Words for the numbers of readings and of skipped lines, with an example for each reason.

    >>> from flinders.core.samples import Skipped
    >>> read_and_left_out(600, [Skipped("other", 3, (1, 2, 3), "LIS3MDL found"), Skipped("not finite", 1, (9,))])
    "600 readings, 3 other lines (line 1: 'LIS3MDL found'), 1 line without finite readings (line 9)"
    """
    words = [count_text(rows, "reading")]
    for entry in skipped:
        if entry.is_silent:
            words.append(str(entry))
            continue
        example = f": {entry.example!r}" if entry.example else ""
        where = f" (line {entry.lines[0]}{example})" if entry.lines else ""
        words.append(f"{entry.amount_text('line')}{where}")
    return ", ".join(words)


def provenance(parts: Iterable[CountedRecording] = (), files: Iterable[SourceFile] = ()) -> ProvenanceRecord:
    """Provenance of a new calibration: release, time, and source files, which are `files` and then those of `parts`."""
    from datetime import UTC, datetime

    from msgspec import UNSET

    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.core.version import VERSION

    read = tuple(parts)
    recorded = [moment for part in read if (moment := recorded_at(part.recording)) is not None]
    return ProvenanceRecord(
        flinders=VERSION,
        date=datetime.now(UTC).replace(microsecond=0),
        files=(*files, *(source_file(part) for part in read)),
        recorded=max(recorded, default=UNSET),
    )


def source_file(part: CountedRecording) -> SourceFile:
    """Name, hash and size of a file, and the number of its readings."""
    from flinders.core.calibration_file import SourceFile
    from flinders.workflows.recordings import file_of, sha256

    recording, stored = part.recording, getattr(part.recording, "stored", None)
    file = cast("File", file_of(recording))
    return SourceFile(
        name=part.source,
        sha256=sha256(file),
        bytes=file.size,
        rows=part.rows,
        as_logged=getattr(recording, "as_logged", False) and stored is not None and stored.applied,
        autopilot=getattr(recording, "autopilot", None),
        compass=getattr(recording, "compass", None),
        device_id=getattr(recording, "device_id", None),
        mounting=getattr(recording, "mounting", None),
        columns=_asked_columns(recording),
    )


def _asked_columns(recording: Recording) -> ColumnsRecord | None:
    """The columns that the user chose in a table; None without a choice."""
    from flinders.core.calibration_file import ColumnsRecord

    form = getattr(getattr(recording, "columns", None), "form", None)
    return form and ColumnsRecord(**form._asdict())


def source_file_of_content(name: str, content: bytes, rows: int = 0, **compass: Any) -> SourceFile:
    """Record of a file whose content is in memory; `compass` names the compass of a vehicle that has several."""
    import hashlib

    from flinders.core.calibration_file import SourceFile

    digest = hashlib.sha256(content).hexdigest()
    return SourceFile(name=name, sha256=digest, bytes=len(content), rows=rows, **compass)


def open_recordings(recordings: Sequence[str], sensor: str | None, **reading: Any) -> tuple[Recording, str | None]:
    """Open recordings of one sensor, and return the name of that sensor; ``--sensor`` chooses among several."""
    from flinders.core.joining import single_recordings
    from flinders.readers import Choice, open_recording

    recording = open_recording(recordings, sensor=Choice(sensor, is_name=True), **reading)
    parts = list(single_recordings(recording))
    names = [getattr(part, "name", "") for part in parts]
    columns = reading.get("columns")
    if columns is not None and len(set(filter(None, names))) > 1:
        which = ", ".join(f"{name or 'the only one'} in {part.source}" for name, part in zip(names, parts, strict=True))
        raise UsageError(f"--columns {columns} selects several magnetometers: {which}; calibrate them one by one")
    if sensor is not None and columns is None and any(names) and not all(names):
        alone = parts[names.index("")].source
        raise UsageError(
            f"--sensor chooses one of several magnetometers, and {alone} has only one: calibrate the files one by one"
        )
    return recording, next(filter(None, names), sensor)


def load_for_recordings(command: str, path: str, recordings: Sequence[str], fixed: Iterable[str] = ()) -> Fit:
    """Load the calibration with which recordings are read.

    `fixed` are the values of ``--fix``: disturbances have these values, and a notice states the error that this causes.
    """
    return take_at_fixed(load(command, path, recordings), fixed)


def take_at_fixed(fit: Fit, fixed: Iterable[str]) -> Fit:
    """The fit with its disturbances held at the values of ``--fix``."""
    from flinders.fitting.result import with_calibration

    states = {one.name: one.states for one in fit.calibration.disturbances}
    return with_calibration(fit, _at_fixed(fit.calibration, fixed_values(fixed, states)))


def _at_fixed(calibration: Calibration, values: dict[str, float]) -> Calibration:
    """The calibration at fixed values of disturbances; also prints the heading error at the far end of each range."""
    for disturbance in calibration.disturbances:
        if disturbance.name in values:
            value = values[disturbance.name]
            away = disturbance.reference + disturbance.extreme_value - value
            cost = figures(min(calibration.disturbance_deg(disturbance, away), 180.0))
            say(
                f"taken at {disturbance.text_of(value)} of {disturbance.name}: at "
                f"{disturbance.text_of(disturbance.extreme_value)}, the end of its calibrated range, "
                f"headings are off by up to {cost}° (dip 60°)"
            )
    return calibration.hold_values(**values)


def fixed_values(fixed: Iterable[str], states: Mapping[str, tuple[str, ...]] | None = None) -> dict[str, float]:
    """Read the values of ``--fix``.

    `states` are the words of columns that contain words instead of numbers, by column.

    >>> fixed_values(["current=12.5", "throttle1=0", "charger=idle"], {"charger": ("idle", "charging")})
    {'current': 12.5, 'throttle1': 0.0, 'charger': 0.0}
    """
    from flinders.core.disturbance import KINDS

    values: dict[str, float] = {}
    for text in fixed:
        name, separator, number = (part.strip() for part in text.rpartition("="))
        if not (name and separator):
            raise UsageError(f"--fix {text!r}: need {', '.join(KINDS)} or a column, and a value, such as current=0")
        words = (states or {}).get(name, ())
        try:
            values[name] = float(words.index(number) if number in words else number)
        except ValueError:
            need = f"need {' or '.join(words)}" if words else f"{number!r} is not a number"
            raise UsageError(f"--fix {text!r}: {need}") from None
    return values


def columns_in(names: Sequence[str]) -> tuple[str, ...]:
    """Those disturbances of `names` that are columns of a log."""
    from flinders.core.disturbance import is_column

    return tuple(filter(is_column, names))


def open_all_with(
    path: str, fit: Fit, recordings: Sequence[str], *, sensor: str | None, **reading: Any
) -> list[CountedRecording]:
    """Open recordings in the unit and axes of a calibration, and print the magnetometer that was chosen."""
    from flinders.estimators.data import CountedRecording
    from flinders.workflows.recordings import open_with

    refuse_twice(recordings)
    refuse_calibrations(recordings)
    parts = [open_with(fit, each, sensor=sensor, **reading) for each in recordings]
    for part in parts:
        say_sensor(path, fit.calibration, part, sensor)
    return list(map(CountedRecording, parts))


def load(command: str, path: str, recordings: Sequence[str] = ()) -> Fit:
    """Load a calibration; for a recording, the error says that it is one, or that the files were swapped."""
    from flinders.fitting import fit_file

    if path == "-":
        raise UsageError(f"the calibration must be a file: flinders {command} calibration.json -")
    try:
        return fit_file.load(path)
    except DocumentError:
        for other in recordings:
            if is_calibration(other):
                raise UsageError(
                    f"{other} is the calibration, which comes first: flinders {command} {other} {path}"
                ) from None
        refuse_recording(path)
        raise


def say_exact(*fits: Fit) -> None:
    """Print a notice for each calibration without a stated uncertainty."""
    for fit in fits:
        if not fit.claim.states_uncertainty:
            say(f"{fit.provenance.name} states no uncertainty: it is used as if exact")


def load_for_use(command: str, path: str) -> Fit:
    """Load a calibration, and refuse one that is unfit for use."""
    from flinders.fitting.export import refuse_unfit

    fit = load(command, path)
    refuse_unfit(fit)
    return fit


def is_calibration(path: str) -> bool:
    """Whether a path leads to a calibration file. Not for standard input and pipes, which are not read."""
    from flinders.core.calibration_file import read

    with contextlib.suppress(DocumentError):
        return path != "-" and Path(path).is_file() and bool(read(path))
    return False


def refuse_calibration(path: str, instead: str) -> None:
    """Refuse a calibration that was given in place of another input; `instead` is the advice."""
    if is_calibration(path):
        raise UsageError(f"{path} is a calibration: {instead}")


def refuse_others(paths: Iterable[str]) -> None:
    """Refuse recordings of many units, and results of fleet commands; the message names the command for them."""
    from flinders.core.plugins import other_contents

    for path in paths:
        other = other_contents(path)
        if other is not None and not other.is_one_recording:
            raise UsageError(other.advice)
        if other is not None:
            say(other.advice)


def is_recording(path: str) -> bool:
    """Whether a path leads to a file with a magnetometer in it."""
    from flinders.readers import open_recording

    try:
        return path != "-" and bool(open_recording(path))
    except FlindersError:
        return False


def refuse_recording(path: str) -> None:
    """Refuse a recording that was given in place of a calibration."""
    if is_recording(path):
        raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None


def refuse_calibrations(paths: Iterable[str]) -> None:
    """Refuse calibrations that were given in place of recordings."""
    for path in filter(is_calibration, paths):
        raise UsageError(f"{path} is a calibration too: give a recording; flinders compare compares calibrations")


def say_sensor(path: str, calibration: Calibration, recording: Recording, asked: str | None) -> None:
    """Print which magnetometer was chosen by the calibration in `path`, or warn that the calibration is for another."""
    name, own = getattr(recording, "name", ""), calibration.sensor
    if not name or own is None:
        return
    if name.casefold() != own.strip().casefold():
        say(f"! {path} is for sensor {own!r}, but the readings of {recording.source} are from {name!r}")
    elif asked is None:
        say(f"{recording.source}: {name} is the sensor that {path} is for")


def site_of(
    place: str, date: str | None, recording: Recording | None = None, *, model: FieldModel | None = None
) -> SiteField:
    """The field at a place, on a given day or on that of the recording's clock."""
    from flinders.core.geomag import decimal_year, parse_place, site_field

    where = parse_place(place)
    return site_field(*where, year=decimal_year(_day(date, recording)), model=model)


def stated_site(recording: object, otherwise: str, **more: Any) -> Site | None:
    """The site stated in a log or by one of its magnetometers, after a notice; `more` are arguments of `Site`."""
    log = getattr(recording, "recording", recording)
    if getattr(log, "position", None) is None:  # such as in a table
        return None
    from flinders.likelihood.site_field import recorded_site

    site, words = recorded_site(log, **more) or (None, "")
    if site is not None:
        say(f"{getattr(recording, 'source', '')}: {words}; used unless {otherwise} is given")
    return site


def likely_target(files: Iterable[SourceFile]) -> str:
    """The target that a calibration of these recordings is most likely for."""
    return next(filter(None, (file.autopilot for file in files)), "arduino")


def _day(date: str | None, recording: Recording | None) -> str:
    """The given day, today's date for `today`, or the day of the recording's clock."""
    from datetime import UTC, datetime

    if date is not None and date.strip().casefold() != "today":
        return date
    start = clock_start(recording)
    if date is None and not start:
        raise UsageError(
            "the declination changes over the years: give the day of the recording, such as --date 2026-11-21"
        )
    day = datetime.now(UTC) if date is not None else datetime.fromtimestamp(start, UTC)
    return day.date().isoformat()


def walk_in(path: str | None, fit: Fit) -> Walk | None:
    """Drift of a unit's offset by the history that `flinders watch` keeps; None without a path.

    Raises `UsageError` for a history in another unit, or with too few estimates.
    """
    if path is None:
        return None
    from flinders.workflows.offset_history import OffsetHistory
    from flinders.workflows.walk import MIN_STEPS

    history = OffsetHistory.read(path)
    if history.unit != fit.calibration.unit:
        raise UsageError(
            f"{path} is in {history.unit}, the calibration in {fit.calibration.unit}: give the history of this unit"
        )
    if history.walk is None:
        raise UsageError(
            f"{path} has fewer than {MIN_STEPS + 1} differing estimates of the offset, too few to know how fast "
            "the offset drifts: leave --history out"
        )
    return history.walk


def recorded_at(recording: object) -> datetime | None:
    """Start time of a recording whose clock counts from 1970 and shows a plausible year; None otherwise."""
    from datetime import UTC, datetime

    from flinders.core.geomag import FIRST_CLOCK_YEAR, LAST_CLOCK_YEAR

    begun: datetime | None = getattr(recording, "start_time", None)
    if begun is None and (start := clock_start(recording)) > 0.0:
        begun = datetime.fromtimestamp(round(start), UTC)
    if begun is None or not FIRST_CLOCK_YEAR <= begun.year < LAST_CLOCK_YEAR:
        return None
    return begun.replace(microsecond=0) if begun.tzinfo else begun.replace(microsecond=0, tzinfo=UTC)


def clock_start(recording: object) -> float:
    """Time since 1970 in s at which a recording's times are zero; 0 if its clock does not count from 1970."""
    time = getattr(getattr(recording, "columns", None), "time", None)
    return float(time.start * time.factor) if time is not None else 0.0
