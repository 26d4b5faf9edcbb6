"""A calibration file and the recordings that it is held against."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import click

from flinders.cli._sources import sha256
from flinders.cli._talk import say
from flinders.errors import DocumentError, FlindersError, NotExportable, UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.fitting.judged import Judged
    from flinders.readers import Choice


sensor_option = click.option(
    "--sensor", metavar="N|NAME",
    help="Which of several magnetometers, by number from 1 or by name [default: the calibration's, else the first].",
)  # fmt: skip


def load(command: str, calibration: str, recordings: Sequence[str]) -> Judged:
    """Load the calibration, and see whether the files were given the other way round.

    Raises
    ------
    UsageError
        Where a recording is the calibration file, or the calibration would come from standard input.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.judged import Judged

    if calibration == "-":
        raise UsageError(f"the calibration must be a file: flinders {command} calibration.json -")
    try:
        return Judged.load(calibration)
    except DocumentError:
        for path in recordings:
            if is_calibration(path):
                raise UsageError(
                    f"{path} is the calibration, it comes first: flinders {command} {path} {calibration}"
                ) from None
        raise


def for_use(command: str, path: str) -> Judged:
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
    try:
        judged = load(command, path, [])
    except DocumentError:
        if is_recording(path):
            raise UsageError(f"{path} is a recording, calibrate it first: flinders calibrate {path}") from None
        raise
    if judged.record is not None and judged.record.verdict == "refused":
        raise NotExportable(
            f"{path} was refused as not fit for use: record anew and calibrate again", beyond=(), verdict="refused"
        )
    return judged


def refuse_on_top(judged: Judged, autopilot: str) -> None:
    """Refuse a calibration of corrected readings for an autopilot, whose own it would replace and not complete.

    Raises
    ------
    NotExportable
    """
    logged = [file.name for file in judged.files if file.as_logged]
    if logged:
        raise NotExportable(
            f"{judged.name} was made from {logged[0]} as logged, after the calibration that was in force on board: its "
            f"numbers come on top of that one, and {autopilot} would put them in its place. Calibrate again without "
            "--as-logged",
            beyond=(),
            as_logged=logged,
        )


def known_of(judged: Judged, autopilot: str, what: str) -> set[int]:
    """What is known of the compasses of an autopilot that a calibration was made from: ``compass`` or ``device_id``."""
    values = (getattr(file, what) for file in judged.files if file.autopilot == autopilot)
    return {value for value in values if value is not None}


def only(judged: Judged, known: set[int], what: str, option: str) -> int | None:
    """The one number or device id that is known, or nothing where none is.

    Raises
    ------
    UsageError
        Where there are several.
    """
    if len(known) > 1:
        raise UsageError(
            f"{judged.name} was made from {what} {' and '.join(map(str, sorted(known)))}: say with {option} which one "
            "it is for, or calibrate each by itself"
        )
    return min(known, default=None)


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
