"""Recordings in the unit and axes of a calibration, and which of them a calibration was made from.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> earlier = calibrate.fit(tumble.samples)
>>> recording_for(tumble.samples.field[:100], earlier).unit.name
'uT'
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from flinders.core.calibration import Calibration
from flinders.core.compensation import Compensator
from flinders.core.joining import Joined, singles
from flinders.core.samples import Samples, Wrapped, frame_of
from flinders.errors import AxesError, TooFewSamples, UnitError, UsageError
from flinders.fitting.fit_file import load
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
    AnyCalibration: TypeAlias = Fit | Calibration | str | os.PathLike[str]


def fit_for(calibration: AnyCalibration) -> Fit:
    """A calibration as a `Fit`: one without a claim for a bare `Calibration`; a path is loaded.

    Raises `UsageError` for what is none of them, as where recording and calibration are given the wrong way round.
    """
    if isinstance(calibration, Fit):
        return calibration
    if isinstance(calibration, Calibration):
        return bare_fit(calibration)
    if not isinstance(cast("object", calibration), str | os.PathLike):
        given = type(calibration).__name__
        raise UsageError(
            f"calibration is of type {given}: need a Fit, a Calibration or a path; the recording comes first"
        )
    return load(calibration)


def uncalibrated(recording: Recording) -> Fit:
    """A calibration that changes nothing, for a recording that is taken as it is."""
    length = float(np.median(np.linalg.norm(next(iter(recording.blocks())).field, axis=1)))
    calibration = Calibration.identity(field_strength=length, raw=recording.unit, axes=recording.axes)
    return bare_fit(calibration, name="no calibration")


def used_at(fit: Fit, at: Mapping[str, float] | None) -> tuple[Fit, Compensator]:
    """The fit of compensated readings, and what compensates them.

    `at` has values of disturbances by name that are taken for those of the recording.
    """
    compensator = Compensator(fit.calibration.holding(**(at or {})))
    return with_calibration(fit, compensator.calibration.affine), compensator


def recording_for(source: AnyReadings, fit: Fit) -> Recording:
    """Readings as a recording in the unit and axes of a calibration.

    Raises `UnitError` or `AxesError` for a recording that is in others, and what `flinders.read` raises.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file, data frame, or list of these but arrays
        An array is taken to be in that unit and in those axes. Of a log or table of several magnetometers the one
        that the calibration is for is read.
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
    for part in singles(recording):
        if part.axes != calibration.axes:
            raise AxesError(
                f"{part.source} has axes {part.axes}, {fit.provenance.name} has {calibration.axes}: read it as the "
                "recording of the calibration"
            )
        agree(calibration, part.recording if isinstance(part, Wrapped) else part)
    return recording


def open_with(fit: Fit, recording: AnySource, *, sensor: str | None = None, **reading: Any) -> Recording:
    """Open a recording in the unit and axes of a calibration: of several magnetometers the one that it is for.

    Of a table of the form of one that it was made from the columns that were asked for then; `reading` goes to
    `flinders.open_recording`.
    """
    calibration = fit.calibration
    known = (file.columns for file in reversed(fit.provenance.files) if file.columns)
    forms = tuple(Form(each.field, each.width, each.names, each.increasing) for each in known)
    choice = Choice(sensor, calibration.sensor, forms=forms)
    opened = open_recording(recording, axes=str(calibration.axes), sensor=choice, **reading)
    opened = with_auxiliary(opened, [one.name for one in calibration.disturbances], are_needed=False)
    agree(calibration, opened)
    return opened


def agree(calibration: Calibration, recording: Recording) -> None:
    """Give a recording the calibration's unit, or refuse where it states another kind, or other axes."""
    if isinstance(recording, TextRecording | TableRecording) and not recording.states_unit:
        recording.unit = calibration.raw
    refuse_other_frame(calibration.frame, recording)
    if recording.unit.inside != calibration.unit:
        raise UnitError(
            f"{recording.source} is in {recording.unit.name}, the calibration is for readings in "
            f"{calibration.raw.name}: it belongs to another kind of recording; calibrate again from a recording "
            "like this one"
        )


def refuse_other_frame(frame: str, recording: Recording) -> None:
    """Raise `AxesError` for a recording in axes of the vehicle where a calibration is for those of the sensor, or v. v.

    A table does not say that it is in those of the sensor.
    """
    found = frame_of(recording)
    says_nothing = isinstance(recording, TextRecording | TableRecording) and found == "sensor"
    if found != frame and not says_nothing:
        raise AxesError(
            f"{recording.source} is in axes of the {found}, the calibration is for readings in axes of the {frame}: "
            "calibrate again from a recording like this one"
        )


def made_from(fit: Fit, recordings: Iterable[Recording]) -> list[str]:
    """Which of these recordings a calibration was made from, as its provenance says: their names.

    Of a log that it was on board for, no reading is in it.
    """
    known = {file.sha256 for file in fit.provenance.files if file.rows}
    files = [(recording.source, file_of(recording)) for recording in recordings if known]
    return [name for name, file in files if file is not None and sha256(file) in known]


def sha256(file: File) -> str:
    """Hash a file as it lies on the disk; what was spooled, for standard input."""
    digest = hashlib.sha256()
    with file.opened() as (raw, _):
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    file.refuse_changed()
    return digest.hexdigest()


def file_of(recording: Recording) -> File | None:
    """The file that a recording was read from, also where a table was made of what a board printed; None in memory."""
    read: Any = getattr(recording, "recording", recording)
    file: File | None = getattr(read, "original", None) or getattr(read, "file", None)
    return file


def with_left_out(error: TooFewSamples, parts: Iterable[Recording]) -> TooFewSamples:
    """The error with what was left out of these recordings, which may be the reason."""
    skipped = [entry for part in parts for entry in getattr(part, "skipped", ()) if entry.is_loss]
    return TooFewSamples(
        found=error.found, needed=error.needed, method=error.method, among=error.among, skipped=skipped, how=error.how
    )
