"""Correction of recordings in memory or as a stream: disturbances compensated, readings filtered and corrected.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> corrected = apply(tumble.samples, calibrate.fit(tumble.samples))
>>> corrected.summary.strength, corrected.summary.notes
(Strength(mean=1.000, spread=1.0%, readings=3,000), ())
>>> corrected.samples.field.shape
(3000, 3)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.core.joining import concatenate
from flinders.core.keywords import check_keywords
from flinders.errors import count_text, python_arguments
from flinders.fitting.fit_file import fit_for
from flinders.fitting.verdict import extrapolation_findings
from flinders.heading.smoothing import Filter
from flinders.readers import TextRecording
from flinders.workflows.notes import Note, limits_in_codes, limits_of
from flinders.workflows.recordings import compensation_at, recording_for
from flinders.workflows.suitability import CorrectionMonitor

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flinders.arrays import Floats
    from flinders.comparison.comparison import LengthSums
    from flinders.core.compensation import Compensator
    from flinders.core.samples import Recording, Samples, Skipped
    from flinders.errors import Spelling
    from flinders.findings import Finding
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.fitting.result import Fit
    from flinders.workflows.recordings import AnyReadings

PARAMETERS_ELSEWHERE: Final = {
    **dict.fromkeys(
        ("columns", "pattern", "unit", "scale", "axes", "sensor", "topic", "as_logged", "start", "end"),
        "flinders.open_recording",
    )
}
"""Parameters of the function that opens a recording, for messages about their wrong use."""


class Smoother:
    """Filter for a stream of samples; it replaces spikes by predicted readings."""

    def __init__(self, by: Filter) -> None:
        self._by, self._stream = by, by.start(centred=False)

    def __call__(self, samples: Samples) -> Samples:
        """The same samples with a filtered field."""
        return replace(samples, field=self._stream.push(samples.field, samples.time).field)

    def as_dict(self) -> dict[str, str | int | float]:
        """JSON-ready fields."""
        return {
            "name": self._by.name,  # name of the filter
            "width": self._by.width,  # width in readings
            "lag_readings": self._by.lag,  # delay of its output in readings
            "spikes": self._stream.dropped,  # count of readings that it replaced
            "restarts": self._stream.restarts,  # count of restarts, at gaps
        }

    def __str__(self) -> str:
        spikes, restarts = self._stream.dropped, self._stream.restarts
        dropped = f"; {count_text(spikes, 'spike')} replaced by predictions" if spikes else ""
        again = f"; restarted {count_text(restarts, 'time')}" if restarts else ""
        return f"filtered: {self._by}; the output is {self._by.lag:g} readings late{dropped}{again}"


@dataclass(frozen=True, slots=True)
class Preparation:
    """Changes of samples before their correction: disturbances are compensated and readings are filtered."""

    compensator: Compensator
    smoother: Smoother | None = None

    @property
    def is_identity(self) -> bool:
        """Whether samples stay unchanged."""
        return self.smoother is None and self.compensator.calibration.is_affine

    def __call__(self, samples: Samples) -> Samples:
        """Compensate and filter a block."""
        compensated = self.compensator(samples)
        return compensated if self.smoother is None else self.smoother(compensated)

    def findings(self) -> tuple[Finding, ...]:
        """Findings on disturbances outside their range in the calibration."""
        return tuple(extrapolation_findings(self.compensator.calibration, self.compensator.beyond))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields: the filter, if any, and the findings, if the calibration has disturbances."""
        filtered = {} if self.smoother is None else {"filter": self.smoother.as_dict()}
        if not self.compensator.calibration.disturbances:
            return filtered
        return {**filtered, "findings": [finding.as_dict() for finding in self.findings()]}


@dataclass(frozen=True, slots=True, eq=False)
class CorrectionSummary:
    """Lengths of corrected readings, with notes if the readings do not suit the calibration."""

    strength: LengthSums  #: number of readings, mean length and spread of the lengths
    notes: tuple[Note, ...]  #: reasons why readings do not suit the calibration; empty if they do
    preparation: Preparation  #: effect of the filter, and disturbances outside their range
    skipped: tuple[Skipped, ...]  #: lines or rows without a usable reading

    def as_dict(self, spell: Spelling = python_arguments) -> dict[str, Any]:
        """JSON-ready fields."""
        return {
            "readings": self.strength.readings,  # count of corrected readings
            **self.strength.as_dict(),
            "skipped": [str(entry) for entry in self.skipped],  # lines that were not understood
            "limits": limits_of(self.notes, spell),  # reasons why readings do not suit the calibration, in words
            **self.preparation.as_dict(),
        }

    def __str__(self) -> str:
        strength = self.strength
        skipped = sum(each.rows for each in self.skipped)
        parts = (
            count_text(strength.readings, "reading"),
            f"{skipped:,} skipped" if skipped else "",
            f"strength {strength.mean:.3f} of the calibration's, spread {strength.spread:.1%}",
            limits_in_codes(self.notes),
        )
        return ", ".join(filter(None, parts))

    def __repr__(self) -> str:
        return f"CorrectionSummary({self})"


@dataclass(frozen=True, slots=True, eq=False)
class CorrectionStream:
    """A recording that is corrected block by block, with a `summary` of the readings so far."""

    recording: Recording
    fit: Fit  #: calibration, in the form for compensated readings
    preparation: Preparation
    corrector: CorrectionMonitor = field(init=False)

    def __post_init__(self) -> None:
        """Set up the correction, without readings so far."""
        object.__setattr__(self, "corrector", CorrectionMonitor(self.fit, self.recording.source))

    @classmethod
    def of(
        cls,
        recording: Recording,
        fit: Fit,
        *,
        at: Mapping[str, float] | None = None,
        by: Filter | None = None,
    ) -> Self:
        """Correction of a recording in the unit and axes of a fit; `at` and `by` are those of `apply`."""
        affine, compensator = compensation_at(fit, at)
        return cls(recording, affine, Preparation(compensator, None if by is None else Smoother(by)))

    def prepare(self, samples: Samples) -> Samples:
        """Compensate and filter a block."""
        self.corrector.check_resemblance(samples)
        return self.preparation(samples)

    def correct(self, samples: Samples) -> Samples:
        """Correct the field of a block."""
        prepared = self.prepare(samples)
        return replace(prepared, field=self.corrector(prepared.field))

    def blocks(self) -> Iterator[Samples]:
        """Yield the corrected blocks; empty blocks are left out."""
        for block in self.recording.blocks():
            if len(block):
                yield self.correct(block)

    def summary(self) -> CorrectionSummary:
        """Summary of the readings that were corrected so far."""
        skipped: tuple[Skipped, ...] = tuple(getattr(self.recording, "skipped", ()))
        return CorrectionSummary(self.corrector.strength, self.corrector.notes(), self.preparation, skipped)

    @property
    def encoding(self) -> str:
        """Text encoding of `lines`: that of the source if the source is text, else UTF-8."""
        return self.recording.layout.encoding if isinstance(self.recording, TextRecording) else "utf-8"

    def lines(self, *, add: bool = False) -> Iterator[str]:
        """Yield the lines of a table with corrected readings, each with its line end.

        A text keeps its lines, columns and delimiter. A part of a text, or another format, becomes comma-separated
        text.

        Parameters
        ----------
        add : bool
            Add three columns for the corrected field, and keep the recorded columns.
        """
        source = self.recording
        if not isinstance(source, TextRecording) or not source.span.is_all:
            return self._table_lines(add=add)
        if self.preparation.is_identity and not source.columns.is_assumed:
            return source.corrected_lines(self.corrector, add=add)
        return source.corrected_lines(self._field, add=add, with_disturbances=True)

    def _field(self, samples: Samples) -> Floats:
        """(N, 3) corrected field of a block."""
        return self.correct(samples).field

    def _table_lines(self, *, add: bool) -> Iterator[str]:
        """Yield the lines of a table of corrected readings, with all other columns."""
        from flinders.simulate.recording import lines

        for number, block in enumerate(self.recording.blocks()):
            if len(block):
                corrected = self._field(block)
                samples = block if add else replace(block, field=corrected)
                header, *rows = lines(samples, corrected=corrected if add else None)
                yield from (f"{line}\n" for line in ([header] if number == 0 else []) + rows)


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedRecording:
    """A corrected recording."""

    #: samples with the corrected field, in the unit and axes of the calibration, and with all other columns
    samples: Samples
    summary: CorrectionSummary

    def __repr__(self) -> str:
        return f"Corrected({self.summary})"


@check_keywords(PARAMETERS_ELSEWHERE)
def apply(
    source: AnyReadings,
    calibration: AnyCalibration,
    *,
    at: Mapping[str, float] | None = None,
    by: Filter | str | None = None,
) -> CorrectedRecording:
    """Correct a recording, and test whether it suits the calibration.

    `Calibration.apply` only corrects an array. This function also compensates recorded disturbances, filters readings,
    and tests the length of corrected readings.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Raw readings in the unit and axes of the calibration; a file is read in these. If a log or table has several
        magnetometers, the one that the calibration is for is read.
    calibration : Fit, Calibration or path
        Calibration of this sensor.
    at : mapping of str to float, optional
        Values of disturbances by name, which replace recorded ones: ``{"current": 12.5}`` (A), ``throttle`` (0 to 1),
        ``temperature`` (°C).
    by : Filter or str, optional
        A filter, such as ``"median:7"``; its output is delayed by half of its width.

    Returns
    -------
    Corrected
        The samples, with a summary of their strength and notes.

    Raises
    ------
    InputError
        For readings of another sensor or unit, whose corrected length is wrong by more than a factor of three. For a
        recording that lacks the column of a disturbance in the calibration.
    UnitError, AxesError
        For a recording in another unit or other axes than the calibration.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> tumble = simulate.tumble(seed=3)
    >>> fit = calibrate.fit(tumble.samples)
    >>> later = simulate.tumble(seed=4, sensor=tumble.sensor).samples
    >>> corrected = apply(later, fit, by="median:5")
    >>> len(corrected.samples), corrected.summary.notes
    (3000, ())
    """
    fit = fit_for(calibration)
    recording = recording_for(source, fit)
    stream = CorrectionStream.of(recording, fit, at=at, by=Filter.of(by) if isinstance(by, str) else by)
    samples = concatenate(list(stream.blocks()), recording)
    return CorrectedRecording(samples, stream.summary())
