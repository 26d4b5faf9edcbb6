"""The calibration that a session comes to: of all readings that the file holds, but for those taken out.

A page fits what is in its memory, which of a long session are fewer; here all of them are read once more, as
``flinders calibrate`` does.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from flinders.apps.live.session_file import TrimmedRecording, left_out
from flinders.core.calibration_file import SourceFile
from flinders.core.samples import Samples
from flinders.errors import FlindersError, UnreadableInput, UsageError
from flinders.estimators.data import CountedRecording
from flinders.fitting.calibrate import fit
from flinders.fitting.export import verdict_lines
from flinders.fitting.refreshing import refresh
from flinders.fitting.result import Refused
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
    """What a page asks to be finished: the number of a log, if it is not the sensor's, and of what is to be renewed."""

    edits: Edits
    log: str | None = None
    previous: str = ""

    @property
    def is_fixed(self) -> bool:
        """No reading that is yet to come belongs to it."""
        return self.log is not None or self.edits.finished_s is not None


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be finished: readings, what was done to them, and the calibration to renew.

    Attributes
    ----------
    name : str
    edits : Edits
    log : Log
        What is in memory.
    path : Path, optional
        The file of the session, where it has all readings; None for a log, or where the file has a hole.
    reading : dict
        How the file is read, as `flinders.open_recording` takes it.
    previous : Fit, optional
        The calibration to renew, where `edits` say that.
    is_of_sensor : bool
        The readings are those of the session's sensor, and not of a log.
    """

    name: str
    edits: Edits
    log: Log
    path: Path | None
    reading: dict[str, Any]
    previous: Fit | None
    is_of_sensor: bool = True

    def fitted(self, recording: Recording) -> Fit | FlindersError:
        """The fit of a recording at the site, or why there is none that may be used."""
        site = Site.stated(self.log.site_known(self.edits.site), inclination_deg=self.edits.dip_deg)
        if self.edits.refreshing and self.previous is None:
            raise UsageError("there is no earlier calibration to renew: choose its file first")
        how = partial(refresh, previous=self.previous) if self.edits.refreshing and self.previous else fit
        try:
            return how(recording, target_deg=self.edits.target_deg, site=site)
        except FlindersError as error:
            return error


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """What a session comes to, and what it is of; `number` tells it from others.

    `request` is what it was made for: the same calibration is given for the same request.
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
        """The fit, good or limited; raises why there is none, or none that may be used."""
        if isinstance(self.outcome, FlindersError):
            raise self.outcome
        return self.outcome

    @property
    def view(self) -> View | None:
        """What a page shows of it, also of one that is refused."""
        result = self.outcome.fit if isinstance(self.outcome, Refused) else self.outcome
        return None if isinstance(result, FlindersError) else view_of_numbers(result)

    @property
    def refusal(self) -> str:
        """Why there is no calibration."""
        return self.outcome.message if isinstance(self.outcome, FlindersError) else ""

    @property
    def limits(self) -> list[str]:
        """What it is not good for."""
        return [finding.advice for finding in self.fit.findings if finding.severity == "limits"]

    @property
    def about(self) -> list[str]:
        """Where the numbers come from and what is claimed of them, for the head of an export."""
        return [f"from {self.name}", *verdict_lines(self.fit)]


def finished(number: str, wanted: Wanted) -> Finished:
    """Fit all readings that are wanted."""
    renewed = wanted.previous if wanted.edits.refreshing else None
    earlier = () if renewed is None else renewed.provenance.files
    if wanted.path is None:
        samples = _in_memory(wanted)
        return Finished(number, wanted.name, samples, wanted.fitted(samples), earlier, wanted.is_of_sensor)
    try:
        file = open_recording(wanted.path, **wanted.reading)
    except FlindersError as error:
        return Finished(number, wanted.path.name, _in_memory(wanted), _nothing_yet(error))
    counting = CountedRecording(TrimmedRecording(file, left_out(wanted.edits)))
    outcome = wanted.fitted(counting)
    return Finished(number, wanted.path.name, counting, outcome, (_source_file(wanted.path, counting.rows), *earlier))


def _in_memory(wanted: Wanted) -> Samples:
    """Readings in memory that are not taken out."""
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
    return next(TrimmedRecording(samples, left_out(wanted.edits)).blocks(), samples)


def _nothing_yet(error: FlindersError) -> FlindersError:
    """What cannot be read of a recording that has just begun is no fault of its file."""
    if isinstance(error, UnreadableInput):
        return UnreadableInput("there are no readings yet to make a calibration from: turn the sensor first")
    return error


def _source_file(path: Path, rows: int) -> SourceFile:
    """The file as it is now; of one that grows, its beginning."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return SourceFile(name=path.name, sha256=digest, bytes=file.tell(), rows=rows)
