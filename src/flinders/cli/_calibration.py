"""A calibration file and the recordings that it is held against."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from flinders.cli._sources import sha256
from flinders.errors import DocumentError, FlindersError, UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.calibration import Calibration
    from flinders.judged import Judged
    from flinders.samples import Recording


def load(command: str, calibration: str, recordings: Sequence[str]) -> Judged:
    """Load the calibration, and see whether the files were given the other way round.

    Raises
    ------
    UsageError
        Where a recording is the calibration file, or the calibration would come from standard input.
    DocumentError
        For what is no calibration file.
    """
    from flinders.judged import Judged

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


def is_calibration(path: str) -> bool:
    """Whether a path leads to a calibration file; standard input is left unread."""
    from flinders.document import read

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


def made_from(calibration: str, recordings: Iterable[Recording]) -> list[str]:
    """Which of these recordings a calibration was made from, as its file says: their names."""
    from flinders.document import read

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
