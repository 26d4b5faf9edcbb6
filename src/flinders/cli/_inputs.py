"""What a command reads: recordings with what was left out of them, calibration files, and the place of a recording."""

from __future__ import annotations

import contextlib
import hashlib
import os
from typing import TYPE_CHECKING, Any

from flinders.cli._output import refuse_twice, say
from flinders.errors import (
    DocumentError,
    FlindersError,
    TooFewSamples,
    UnitError,
    UsageError,
    counted,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import Provenance, SourceFile
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Joined, Recording, Samples, Skipped
    from flinders.fitting.result import Fit
    from flinders.readers import Choice
    from flinders.readers._source import File


def sha256(recording: Recording) -> str:
    """Hash a file as it lies on the disk; what was spooled, for standard input."""
    digest = hashlib.sha256()
    with file_of(recording).opened() as (raw, _):
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


def file_of(recording: Recording) -> File:
    """The file that a recording was read from, also where a table was made of what a board printed."""
    file: File = getattr(recording, "original", None) or recording.file  # type: ignore[attr-defined]
    return file


@contextlib.contextmanager
def saying_what_was_skipped(recordings: Iterable[Recording]) -> Iterator[None]:
    """Where readings are too few, say what was left out of these recordings: it may be the reason.

    Raises
    ------
    TooFewSamples
        Again, with that.
    """
    try:
        yield
    except TooFewSamples as error:
        skipped = [entry for recording in recordings for entry in getattr(recording, "skipped", ())]
        raise TooFewSamples(
            found=error.found, needed=error.needed, method=error.method, skipped=skipped, how=error.how
        ) from None


class Counted:
    """A recording that knows how many rows its last pass gave, and says once what was read.

    Attributes
    ----------
    recording : Recording
    file : File
        That it was read from.
    rows : int
    """

    def __init__(self, recording: Recording) -> None:
        from flinders.core.samples import frame_of

        self.recording, self.source = recording, recording.source
        self.unit, self.axes, self.frame = recording.unit, recording.axes, frame_of(recording)
        self.file = file_of(recording)
        self.rows = 0
        self._is_said = False

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """What the last pass left out."""
        skipped: tuple[Skipped, ...] = getattr(self.recording, "skipped", ())
        return skipped

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording; after the first time, or where that breaks off, say what was read."""
        self.rows = 0
        try:
            for block in self.recording.blocks():
                self.rows += len(block)
                yield block
        except FlindersError:
            self._say(str(self.recording))
            raise
        self._say(f"{self.recording}; {read_and_left_out(self.rows, self.skipped)}")

    def _say(self, words: str) -> None:
        if not self._is_said:
            self._is_said = True
            say(words)


def read_and_left_out(rows: int, skipped: Iterable[Skipped]) -> str:
    """Say how many readings there are, and what is none, with the first such line.

    >>> from flinders.core.samples import Skipped
    >>> read_and_left_out(600, [Skipped("other", 3, (1, 2, 3), "LIS3MDL found"), Skipped("not finite", 1, (9,))])
    "600 readings, 3 other lines (line 1: 'LIS3MDL found'), 1 not finite line (line 9)"
    """
    words = [counted(rows, "reading")]
    for entry in skipped:
        example = f": {entry.example!r}" if entry.example else ""
        where = f" (line {entry.lines[0]}{example})" if entry.lines else ""
        words.append(f"{counted(entry.rows, f'{entry.reason} line')}{where}")
    return ", ".join(words)


def provenance(parts: Iterable[Counted] = (), files: Iterable[SourceFile] = ()) -> Provenance:
    """Which release made it, when, from which files: those of the parts that were read, after `files`."""
    from datetime import UTC, datetime

    from flinders import __version__
    from flinders.core.calibration_file import Provenance

    return Provenance(
        flinders=__version__,
        date=datetime.now(UTC).replace(microsecond=0),
        files=(*files, *(source_file(part) for part in parts)),
    )


def source_file(part: Counted) -> SourceFile:
    """Name, hash and size of a file, and how many readings it gave."""
    from flinders.core.calibration_file import SourceFile

    recording = part.recording
    size = file_of(recording).size
    return SourceFile(
        name=os.fsencode(part.source).decode(errors="replace"),
        sha256=sha256(recording),
        bytes=size,
        rows=part.rows,
        as_logged=getattr(recording, "as_logged", False) and getattr(recording, "stored", None) is not None,
        autopilot=getattr(recording, "autopilot", None),
        compass=getattr(recording, "compass", None),
        device_id=getattr(recording, "device_id", None),
    )


def joined(parts: Sequence[Recording]) -> Recording:
    """Recordings as one."""
    from flinders.core.samples import Joined

    return Joined(tuple(parts)) if len(parts) > 1 else parts[0]


def opened(recordings: Sequence[str], options: dict[str, Any], **reading: Any) -> Recording:
    """Open recordings of one sensor: of several the one that ``--sensor`` says, whose name goes with the calibration.

    Raises
    ------
    UsageError
        For a magnetometer that there is not, and for columns that are one in one file and another in the next.
    """
    from flinders.core.samples import singles
    from flinders.readers import Choice, open_recording

    recording = open_recording(recordings, sensor=Choice(options["sensor"], is_name=True), **reading)
    parts = list(singles(recording))
    names = [getattr(part, "name", "") for part in parts]
    columns = reading.get("columns")
    if columns is not None and len(set(filter(None, names))) > 1:
        which = ", ".join(f"{name or 'the only one'} in {part.source}" for name, part in zip(names, parts, strict=True))
        raise UsageError(f"--columns {columns} is not one magnetometer: {which}; calibrate them one by one")
    if options["sensor"] is not None and columns is None and any(names) and not all(names):
        alone = next(part.source for part, name in zip(parts, names, strict=True) if not name)
        raise UsageError(
            f"--sensor chooses one of several magnetometers, and {alone} has just one: calibrate them one by one"
        )
    options["sensor"] = next(filter(None, names), options["sensor"])
    return recording


def opened_with(
    path: str, calibration: Calibration, recordings: tuple[str, ...], *, sensor: str | None, **options: Any
) -> Joined:
    """Open recordings in the unit and axes of a calibration.

    Raises
    ------
    UsageError
        For a recording that is given twice, or is a calibration.
    UnitError
        For one that states another kind of unit.
    """
    from flinders.core.samples import Joined
    from flinders.readers import open_recording

    refuse_twice(recordings)
    for each in recordings:
        if is_calibration(each):
            raise UsageError(f"{each} is a calibration too: flinders compare compares two of them")
    wanted = choice(calibration, sensor)
    parts = tuple(open_recording(each, axes=str(calibration.axes), sensor=wanted, **options) for each in recordings)
    for part in parts:
        agree(calibration, part)
        say_sensor(path, calibration, part, sensor)
    return Joined(tuple(map(Counted, parts)))


def load(command: str, calibration: str, recordings: Sequence[str] = ()) -> Fit:
    """Load the calibration, and see whether the files were given the other way round.

    Raises
    ------
    UsageError
        Where a recording is the calibration file, or the calibration would come from standard input.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.result import Fit

    if calibration == "-":
        raise UsageError(f"the calibration must be a file: flinders {command} calibration.json -")
    try:
        return Fit.load(calibration)
    except DocumentError:
        for path in recordings:
            if is_calibration(path):
                raise UsageError(
                    f"{path} is the calibration, it comes first: flinders {command} {path} {calibration}"
                ) from None
        raise


def calibration_or_hint(path: str) -> Fit:
    """Load a calibration, or say what to type for a recording in its place."""
    from flinders.fitting.result import Fit

    try:
        return Fit.load(path)
    except DocumentError:
        if is_recording(path):
            raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None
        raise


def say_exact(*fits: Fit) -> None:
    """Say which calibrations state no uncertainty."""
    for fit in fits:
        if not fit.states_uncertainty:
            say(f"{fit.name} states no uncertainty: it is taken as exact")


def for_use(command: str, path: str) -> Fit:
    """Load a calibration that is about to be used.

    Raises
    ------
    UsageError
        For a recording, or standard input.
    DocumentError
        For what is no calibration file.
    NotExportable
        For one that was refused.
    """
    from flinders.fitting.export import refuse_unfit

    fit = load(command, path) if path == "-" else calibration_or_hint(path)
    refuse_unfit(fit)
    return fit


def is_calibration(path: str) -> bool:
    """Whether a path leads to a calibration file; standard input is left unread."""
    from flinders.core.calibration_file import read

    with contextlib.suppress(DocumentError):
        return path != "-" and bool(read(path))
    return False


def is_recording(path: str) -> bool:
    """Whether a path leads to a file with a magnetometer in it."""
    from flinders.readers import open_recording

    try:
        return path != "-" and bool(open_recording(path))
    except FlindersError:
        return False


def choice(calibration: Calibration, sensor: str | None) -> Choice:
    """Which of several magnetometers is read: the one that is asked for, else the one that the calibration is for."""
    from flinders.readers import Choice

    return Choice(sensor, calibration.sensor)


def say_sensor(path: str, calibration: Calibration, recording: Recording, asked: str | None) -> None:
    """Say which magnetometer was taken because the calibration is for it, or that the one that is read is another.

    Parameters
    ----------
    path : str
        Of the calibration.
    calibration : Calibration
    recording : Recording
        As it was opened with `choice`.
    asked : str or None
        What ``--sensor`` said.
    """
    name, own = getattr(recording, "name", ""), calibration.sensor
    if not name or own is None:
        return
    if name.casefold() != own.strip().casefold():
        say(f"! {path} is for sensor {own!r}, and what is read of {recording.source} is {name!r}")
    elif asked is None:
        say(f"{recording.source}: {name} is the sensor that {path} is for")


def made_from(calibration: str, recordings: Iterable[Recording]) -> list[str]:
    """Which of these recordings a calibration was made from, as its file says: their names."""
    from flinders.core.calibration_file import read

    provenance = read(calibration).provenance
    known = {file.sha256 for file in provenance.files} if provenance else set()
    return [recording.source for recording in recordings if known and sha256(recording) in known]


def agree(calibration: Calibration, recording: Recording) -> None:
    """Give a recording the calibration's unit, or refuse where it states another kind.

    Raises
    ------
    UnitError
        If one is in counts and the other in microtesla.
    """
    from flinders.readers import TableRecording, TextRecording

    if isinstance(recording, TextRecording | TableRecording) and not recording.states_unit:
        recording.unit = calibration.raw
    if recording.unit.inside != calibration.unit:
        raise UnitError(
            f"{recording.source} is in {recording.unit.name}, the calibration is for readings in "
            f"{calibration.raw.name}: it belongs to another kind of recording; calibrate again from a recording "
            "like this one"
        )


def site_of(place: str, date: str | None, recording: Recording | None = None) -> SiteField:
    """The field at a place on a day that is given, or that the clock of the recording tells.

    Raises
    ------
    UsageError
        For no place, no day, or one without a model.
    """
    from flinders.core.geomag import place_of, site_field, year_of

    where = place_of(place)
    return site_field(*where, year=year_of(_day(date, recording)))


def _day(date: str | None, recording: Recording | None) -> str:
    """The day as it is given, today, or by the clock of the recording.

    Raises
    ------
    UsageError
        Where nobody knows it.
    """
    import datetime

    if date is not None and date.strip().casefold() != "today":
        return date
    if date is not None:
        return datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    start = clock_start(recording)
    if start:
        return datetime.datetime.fromtimestamp(start, tz=datetime.UTC).date().isoformat()
    raise UsageError("the declination changes with the years: give the day of the recording, such as --date 2026-11-21")


def clock_start(recording: object) -> float:
    """Seconds from 1970 at which the times of a recording start to count; 0 where they count from something else."""
    layout = getattr(recording, "layout", None)
    time = layout.columns.time if layout is not None else None
    return float(time.start * time.factor) if time is not None else 0.0
