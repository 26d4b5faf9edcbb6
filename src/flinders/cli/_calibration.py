"""A calibration file and the recordings that it is held against."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from flinders.errors import DocumentError, UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration
    from flinders.comparison import Judged
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
    from flinders.comparison import Judged

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


def agree(calibration: Calibration, recording: Recording) -> None:
    """Give a recording the calibration's unit, or refuse where it states another kind.

    Raises
    ------
    UnitError
        If one is in counts and the other in microtesla.
    """
    from flinders.readers import TextRecording

    if isinstance(recording, TextRecording) and not recording.layout.columns.stated:
        recording.unit = calibration.raw
    if recording.unit.inside != calibration.unit:
        raise UnitError(
            f"{recording.source} is in {recording.unit.name}, the calibration is for readings in "
            f"{calibration.raw.name}: it belongs to another kind of recording; calibrate again from a recording "
            "like this one"
        )
