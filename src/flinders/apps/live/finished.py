"""Final calibration of a session, from all readings of its file except excluded ones.

A page fits the readings in its memory, which thins a long session; this module reads the whole file again, as
``flinders calibrate`` does.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from flinders.apps.live.session_file import TrimmedRecording, excluded_spans
from flinders.core.calibration_file import SourceFile
from flinders.core.samples import Samples
from flinders.errors import FlindersError, UnreadableInput, UsageError
from flinders.estimators.data import CountedRecording
from flinders.fitting.calibrate import fit
from flinders.fitting.export import origin_lines
from flinders.fitting.refreshing import refresh
from flinders.fitting.result import Refused, with_name
from flinders.likelihood.site_field import Site
from flinders.readers import open_recording
from flinders.report.view import view_of_numbers

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.apps.live.messages import Edits
    from flinders.apps.live.session_file import Log
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.report.view import View


class CalibrationRequest(NamedTuple):
    """Request of a page for a final calibration."""

    edits: Edits
    log: str | None = None  # number of a log that was dropped on a page; None for the sensor
    previous: str = ""  # number of the calibration to renew; empty for none

    @property
    def is_fixed(self) -> bool:
        """Whether later readings cannot change the result."""
        return self.log is not None or self.edits.finished_s is not None


@dataclass(frozen=True, slots=True)
class FinishInputs:
    """Inputs of a final calibration: readings, the user's edits, and the calibration to renew.

    Attributes
    ----------
    name : str
    edits : Edits
    log : Log
        Readings in memory.
    path : Path, optional
        File of the session, if it has all readings; None for a log, or if the file has a gap.
    reading : dict
        Arguments of `flinders.open_recording` for the file.
    previous : Fit, optional
        The calibration to renew, if `edits` request that.
    is_of_sensor : bool
        The readings come from the session's sensor, and not from a log.
    """

    name: str
    edits: Edits
    log: Log
    path: Path | None
    reading: dict[str, Any]
    previous: Fit | None
    is_of_sensor: bool = True

    def fitted(self, recording: Recording) -> Fit | FlindersError:
        """Return the fit of a recording at the site, or the error if there is no usable one."""
        site = Site.merge_stated(self.log.site_known(self.edits.site), inclination_deg=self.edits.dip_deg)
        if self.edits.refreshing and self.previous is None:
            raise UsageError("no earlier calibration to renew: choose its file first")
        how = partial(refresh, previous=self.previous) if self.edits.refreshing and self.previous else fit
        try:
            return how(recording, target_deg=self.edits.target_deg, site=site)
        except FlindersError as error:
            return error


@dataclass(frozen=True, slots=True, eq=False)
class FinishedCalibration:
    """Final calibration of a session with its recording; `number` identifies it.

    `request` is the request it answers: the same request returns the same calibration.
    """

    number: str
    name: str
    recording: Recording
    outcome: Fit | FlindersError
    files: tuple[SourceFile, ...] = ()
    is_of_sensor: bool = True
    request: CalibrationRequest | None = None

    @property
    def fit(self) -> Fit:
        """The fit, good or limited; raises the error if there is no usable one."""
        if isinstance(self.outcome, FlindersError):
            raise self.outcome
        return self.outcome

    @property
    def view(self) -> View | None:
        """View of the fit for a page, also of a refused one."""
        result = self.outcome.fit if isinstance(self.outcome, Refused) else self.outcome
        return None if isinstance(result, FlindersError) else view_of_numbers(result)

    @property
    def refusal(self) -> str:
        """Reason if there is no calibration, else empty."""
        return self.outcome.message if isinstance(self.outcome, FlindersError) else ""

    @property
    def limits(self) -> list[str]:
        """Limits on the use of the calibration, as sentences."""
        return [finding.advice for finding in self.fit.findings if finding.severity == "limits"]

    @property
    def about(self) -> list[str]:
        """Sentences on origin and uncertainty, for the head of an export."""
        return origin_lines(with_name(self.fit, self.name))


def finish_calibration(number: str, wanted: FinishInputs) -> FinishedCalibration:
    """Make the final calibration from all readings of the inputs."""
    renewed = wanted.previous if wanted.edits.refreshing else None
    earlier = () if renewed is None else renewed.provenance.files
    if wanted.path is None:
        samples = _in_memory(wanted)
        return FinishedCalibration(number, wanted.name, samples, wanted.fitted(samples), earlier, wanted.is_of_sensor)
    try:
        file = open_recording(wanted.path, **wanted.reading)
    except FlindersError as error:
        return FinishedCalibration(number, wanted.path.name, _in_memory(wanted), _nothing_yet(error))
    counting = CountedRecording(TrimmedRecording(file, excluded_spans(wanted.edits)))
    outcome = wanted.fitted(counting)
    return FinishedCalibration(
        number, wanted.path.name, counting, outcome, (_source_file(wanted.path, counting.rows), *earlier)
    )


def _in_memory(wanted: FinishInputs) -> Samples:
    """Readings in memory that are not excluded."""
    log = wanted.log
    samples = Samples(
        field=log.buffer.field,
        unit=log.unit,
        axes=log.axes,
        time=log.buffer.time,
        acceleration=log.buffer.acceleration if log.buffer.has_acceleration else None,
        source=wanted.name,
        frame=log.frame,
    )
    return next(TrimmedRecording(samples, excluded_spans(wanted.edits)).blocks(), samples)


def _nothing_yet(error: FlindersError) -> FlindersError:
    """Replace the error of an unreadable file by an error that says that the session has no readings yet."""
    if isinstance(error, UnreadableInput):
        return UnreadableInput("no readings to calibrate from yet: turn the sensor first")
    return error


def _source_file(path: Path, rows: int) -> SourceFile:
    """Name, checksum and size of a recording as it is now, for the provenance of a fit of its first `rows` rows."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return SourceFile(name=path.name, sha256=digest, bytes=file.tell(), rows=rows)
