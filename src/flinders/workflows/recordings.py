"""Recordings in the unit and axes of a calibration, and recognition of those that the calibration was made from.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> earlier = calibrate.fit(tumble.samples)
>>> recording_for(tumble.samples.field[:100], earlier).unit.name
'uT'
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from flinders.core.calibration import Calibration
from flinders.core.compensation import Compensator
from flinders.core.joining import Joined, single_recordings
from flinders.core.samples import RecordingWrapper, Samples, frame_of
from flinders.errors import AxesError, TooFewSamples, UnitError
from flinders.fitting.result import Fit, bare_fit, with_calibration
from flinders.readers import Choice, TableRecording, TextRecording, is_source, open_recording
from flinders.readers._auxiliary import with_auxiliary
from flinders.readers._choice import Form

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike

    from flinders.core.samples import Recording
    from flinders.readers import AnySource
    from flinders.readers._source import File

    AnyReadings: TypeAlias = Recording | ArrayLike | AnySource


def identity_fit(recording: Recording) -> Fit:
    """The identity as a calibration, for a recording that is used without correction."""
    length = float(np.median(np.linalg.norm(next(iter(recording.blocks())).field, axis=1)))
    calibration = Calibration.identity(field_strength=length, raw=recording.unit, axes=recording.axes)
    return bare_fit(calibration, name="no calibration")


def compensation_at(fit: Fit, at: Mapping[str, float] | None) -> tuple[Fit, Compensator]:
    """The fit for compensated readings, and the compensator of disturbances.

    `at` has values of disturbances by name, which replace recorded ones.
    """
    compensator = Compensator(fit.calibration.hold_values(**(at or {})))
    return with_calibration(fit, compensator.calibration.affine), compensator


def recording_for(source: AnyReadings, fit: Fit) -> Recording:
    """Readings as a recording in the unit and axes of a calibration.

    Raises `UnitError` or `AxesError` for a recording in another unit or other axes, and the errors of `flinders.read`.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file, data frame, or list of these but arrays
        Raw readings. An array is assumed to be in the unit and axes of the calibration. If a log or table has several
        magnetometers, the one that the calibration is for is read.
    """
    if isinstance(source, list | tuple) and source and (is_source(source[0]) or hasattr(source[0], "blocks")):
        parts = tuple(recording_for(each, fit) for each in source)
        return parts[0] if len(parts) == 1 else Joined(parts)
    if not hasattr(source, "blocks") and is_source(source):
        return open_with(fit, source)
    calibration = fit.calibration
    if not hasattr(source, "blocks"):
        samples = Samples.of(cast("ArrayLike", source), unit=calibration.raw, axes=calibration.axes)
        return replace(samples, frame=calibration.frame)
    recording = cast("Recording", source)
    for part in single_recordings(recording):
        if part.axes != calibration.axes:
            raise AxesError(
                f"{part.source} has axes {part.axes}, {fit.provenance.name} has {calibration.axes}: read the recording "
                "with the axes of the calibration"
            )
        require_same_frame(calibration, part.recording if isinstance(part, RecordingWrapper) else part)
    return recording


def open_with(fit: Fit, recording: AnySource, *, sensor: str | None = None, **reading: Any) -> Recording:
    """Open a recording in the unit and axes of a calibration, with the magnetometer that the calibration is for.

    If a table has the form of one that the calibration was made from, the same columns are read. `reading` has
    parameters of `flinders.open_recording`.
    """
    calibration = fit.calibration
    known = (file.columns for file in reversed(fit.provenance.files) if file.columns)
    forms = tuple(Form(each.field, each.width, each.names, each.increasing) for each in known)
    choice = Choice(sensor, calibration.sensor, forms=forms)
    opened = open_recording(recording, axes=str(calibration.axes), sensor=choice, **reading)
    opened = with_auxiliary(opened, [one.name for one in calibration.disturbances], are_needed=False)
    require_same_frame(calibration, opened)
    return opened


def require_same_frame(calibration: Calibration, recording: Recording) -> None:
    """Convert a recording to the calibration's unit; raise an error if that is impossible or the axes differ."""
    if isinstance(recording, TextRecording | TableRecording) and not recording.states_unit:
        recording.unit = calibration.raw
    refuse_other_frame(calibration.frame, recording)
    if recording.unit.inside != calibration.unit:
        raise UnitError(
            f"{recording.source} is in {recording.unit.name}, the calibration is for readings in "
            f"{calibration.raw.name}, which cannot be converted: calibrate again from a recording "
            "like this one"
        )


def refuse_other_frame(frame: str, recording: Recording) -> None:
    """Raise `AxesError` if recording and calibration differ in their frame, one ``sensor`` and the other ``vehicle``.

    A table does not state its frame.
    """
    found = frame_of(recording)
    says_nothing = isinstance(recording, TextRecording | TableRecording) and found == "sensor"
    if found != frame and not says_nothing:
        raise AxesError(
            f"{recording.source} is in axes of the {found}, the calibration is for readings in axes of the {frame}: "
            "calibrate again from a recording like this one"
        )


def own_recordings(fit: Fit, recordings: Iterable[Recording]) -> list[str]:
    """Names of those recordings that a calibration was made from, by its provenance.

    A log whose onboard calibration was imported does not count, since its readings were not used.
    """
    known = {file.sha256 for file in fit.provenance.files if file.rows}
    files = [(recording.source, file_of(recording)) for recording in recordings if known]
    return [name for name, file in files if file is not None and sha256(file) in known]


def sha256(file: File) -> str:
    """SHA-256 of the bytes of a file on disk; for standard input, of its temporary copy."""
    digest = hashlib.sha256()
    with file.open_streams() as (raw, _):
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    file.refuse_changed()
    return digest.hexdigest()


def file_of(recording: Recording) -> File | None:
    """File of a recording, even if it was converted from a board's printed lines; None for a recording in memory."""
    read: Any = getattr(recording, "recording", recording)
    file: File | None = getattr(read, "original", None) or getattr(read, "file", None)
    return file


def with_left_out(error: TooFewSamples, parts: Iterable[Recording]) -> TooFewSamples:
    """The error with the rows that were left out of the recordings; these rows may be the reason."""
    skipped = [entry for part in parts for entry in getattr(part, "skipped", ()) if entry.is_loss]
    return TooFewSamples(
        found=error.found, needed=error.needed, method=error.method, among=error.among, skipped=skipped, how=error.how
    )
