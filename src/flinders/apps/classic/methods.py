"""Every method on one recording, side by side: calibration, claimed error, and cross-validated error of each.

>>> from flinders import simulate
>>> contest = compare_methods(simulate.tumble(seed=1).samples, methods=["auto", "minmax"])
>>> [(entry.method, entry.fit.verdict, entry.difference_deg is None) for entry in contest.entries]
[('auto', 'good', True), ('minmax', 'refused', False)]
>>> [entry.method for entry in contest.sorted_by("validated")], contest["minmax"].verdict
(['auto', 'minmax'], 'refused')
>>> contest.entries[1].validation.heading_error_deg.rms > 20 * contest.entries[0].validation.heading_error_deg.rms
True
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.comparison.comparison import compare
from flinders.comparison.cross_validation import DEFAULT_BLOCKS, MIN_BLOCK_READINGS, NotValidated, cross_validate
from flinders.comparison.results import json_attributes
from flinders.core.joining import concatenate
from flinders.core.keywords import check_keywords
from flinders.core.notebook import html_table, text_table
from flinders.core.short_repr import ShortRepr
from flinders.errors import FitError, NeedsSamples, UsageError, count_text, did_you_mean, figures
from flinders.estimators import METHODS, Readings, method_class, remove_saturated
from flinders.estimators.auto import Auto
from flinders.estimators.data import recording_of
from flinders.findings import VERDICTS
from flinders.fitting.calibrate import PARAMETERS_ELSEWHERE, fit
from flinders.fitting.request import Request, estimator_of
from flinders.fitting.result import Refused
from flinders.likelihood import magnitude
from flinders.report.formatting import degrees
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.comparison.cross_validation import Validation
    from flinders.core.samples import Recording, Samples
    from flinders.estimators import Estimator
    from flinders.findings import Verdict
    from flinders.fitting.result import Fit
    from flinders.heading.error_propagation import HeadingError
    from flinders.likelihood.site_field import Site
    from flinders.summary.summary import Summary
    from flinders.workflows.recordings import AnyReadings

MAX_VALIDATED: Final = 20_000
"""Largest number of readings that are cross-validated, evenly spread over a longer recording."""

ROUNDING_DEG: Final = 1e-4
"""Largest difference of heading, in degrees, that comes from rounding alone."""

MAX_CLAIM_RATIO: Final = 2.0
"""Largest ratio of cross-validated to claimed heading error; with a larger ratio, the claim is too small.

In `tests/comparison/test_validation.py` the cross-validated error of unbiased methods is 0.8 to 1.3 times the true one.
"""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Entry(ShortRepr):
    """Result of one method on a recording."""

    method: str  #: name as it was given; `fit.evidence.method` is the method that was run
    #: duration of the method alone, without the sums of readings, which all methods share, and without the verdict
    seconds: float
    fit: Fit | None = None  #: None if the method gives no ellipsoid
    #: cross-validation; None if the readings are too few, or cannot be fitted without one of the blocks of time
    validation: Validation | None = None
    #: heading difference from the first method that was compared; None for that one
    difference_deg: HeadingError | None = None
    refusal: FitError | None = None  #: reason why there is no fit
    unvalidated: FitError | None = None  #: reason why there is no validation
    #: factor by which the cross-validated error may be larger because only some of the readings were used
    coarser: float = 1.0

    @property
    def verdict(self) -> Verdict:
        """Verdict of the fit; ``refused`` without a fit, and at best ``limited`` if the method overclaims."""
        if self.fit is None:
            return "refused"
        return "limited" if self.fit.verdict == "good" and self.overclaims else self.fit.verdict

    @property
    def overclaims(self) -> bool:
        """Whether the cross-validated error is far beyond the claimed one, and beyond the target."""
        if self.fit is None or self.validation is None:
            return False
        claimed, shown = self.fit.heading_error_deg, self.validation.heading_error_deg
        return shown.rms > MAX_CLAIM_RATIO * self.coarser * claimed.rms and shown.worst > self.fit.claim.target_deg

    @property
    def objections(self) -> tuple[tuple[str, str], ...]:
        """Stable code and words of each reason against trusting the method on this recording."""
        if self.fit is None:
            return () if self.refusal is None else ((self.refusal.code, self.refusal.message),)
        each = [(finding.code, finding.advice) for finding in self.fit.findings if finding.severity != "note"]
        if self.overclaims and self.validation is not None:
            shown, claimed = self.validation.heading_error_deg, self.fit.heading_error_deg
            words = f"claims {claimed.rms:.2g}° of heading, rms; cross-validation shows {shown.rms:.2g}°"
            each.append(("overclaims", words))
        if self.unvalidated is not None:
            each.append((self.unvalidated.code, str(self.unvalidated)))
        return tuple(each)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Words of each reason against trusting the method on this recording."""
        return tuple(words for _, words in self.objections)

    @property
    def codes(self) -> tuple[str, ...]:
        """Stable code of each reason against trusting the method on this recording."""
        return tuple(code for code, _ in self.objections)

    @property
    def cells(self) -> tuple[str, str, str, str, str, str]:
        """Row of a table with the columns of `Contest.headings`."""
        claimed, validated, difference = (_rms(MEASURES[name](self)) for name in ("claimed", "validated", "difference"))
        return self.method, claimed, validated, difference, duration(self.seconds), self.verdict

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields; a refused calibration has numbers too, since they are for comparison only."""
        fitted, checked = self.fit, self.validation
        return {
            "method": self.method,
            "method_run": None if fitted is None else fitted.evidence.method,  # the method that was run in the end
            "verdict": self.verdict,
            **dict.fromkeys(("offset", "matrix", "field_strength", "heading_error_deg")),
            **({} if fitted is None else json_attributes(fitted.calibration, "offset", "matrix", "field_strength")),
            **({} if fitted is None else json_attributes(fitted, "heading_error_deg")),
            # `rms` and `worst` of the cross-validated heading error
            "validated_heading_error_deg": None if checked is None else checked.heading_error_deg.as_dict(),
            # part of that error that is common to all blocks
            "validated_bias_deg": None if checked is None else checked.bias_deg,
            # part of that error that differs from block to block
            "validated_scatter_deg": None if checked is None else checked.scatter_deg,
            # ratio of residuals of left-out blocks and of the fit
            "misfit": None if checked is None else checked.misfit,
            **json_attributes(self, "difference_deg", "seconds", "codes", "reasons"),
        }


def _rms(error_deg: float | None) -> str:
    """Text of a heading error for a cell of the table."""
    if error_deg is None:
        return "–"
    return degrees(error_deg) if error_deg > ROUNDING_DEG else "0°"


def duration(seconds: float) -> str:
    """Format a duration with two digits.

    >>> duration(0.00421), duration(12.5)
    ('4.2 ms', '12 s')
    """
    return f"{figures(seconds * 1e3)} ms" if seconds < 1.0 else f"{figures(seconds)} s"


MEASURES: Final[Mapping[str, Callable[[Entry], float | None]]] = {
    "claimed": lambda entry: None if entry.fit is None else entry.fit.heading_error_deg.rms,
    "validated": lambda entry: None if entry.validation is None else entry.validation.heading_error_deg.rms,
    "difference": lambda entry: None if entry.difference_deg is None else entry.difference_deg.rms,
    "seconds": lambda entry: entry.seconds,
}
"""Measures by which methods are sorted: rms heading errors in degrees, and the duration of each in s."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Contest:
    """All methods on one recording."""

    entries: tuple[Entry, ...]  #: in the order of `flinders.estimators.METHODS`, or of the given names
    readings: int  #: number of readings in the recording
    blocks: int  #: number of blocks of time for cross-validation; 0 for too few readings
    stride: int = 1  #: step through the readings: one of `stride` readings was cross-validated

    @property
    def verdict(self) -> Verdict:
        """The best verdict of all methods."""
        verdicts = {entry.verdict for entry in self.entries}
        return next(verdict for verdict in reversed(VERDICTS.values()) if verdict in verdicts)

    @property
    def reference(self) -> str:
        """The method with which the others are compared: the first that gives a fit."""
        return next((entry.method for entry in self.entries if entry.fit is not None), self.entries[0].method)

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    def __getitem__(self, method: str) -> Entry:
        """The entry of a method; `UsageError` for one that was not compared."""
        for entry in self.entries:
            if entry.method == method:
                return entry
        names = [entry.method for entry in self.entries]
        raise UsageError(f"method {method!r} was not compared{did_you_mean(method, names)}: {', '.join(names)}")

    def sorted_by(self, measure: str) -> Contest:
        """The contest in the order of one of `MEASURES`, the smallest first; entries without it come last."""
        if measure not in MEASURES:
            known = ", ".join(MEASURES)
            raise UsageError(f"measure {measure!r} is not known{did_you_mean(measure, MEASURES)}: use one of {known}")

        def place(entry: Entry) -> float:
            value = MEASURES[measure](entry)
            return math.inf if value is None or math.isnan(value) else value

        return replace(self, entries=tuple(sorted(self.entries, key=place)))

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the table's columns; errors are rms over all headings of a level vehicle."""
        return ("method", "claimed", "cross-validated", f"from {self.reference}", "time", "verdict")

    def __repr__(self) -> str:
        return text_table(self.headings, [entry.cells for entry in self.entries])

    def _repr_html_(self) -> str:
        return html_table(
            f"{len(self.entries)} methods, {count_text(self.readings, 'reading')}",
            self.headings,
            [entry.cells for entry in self.entries],
            ["heading error in degrees, rms over all headings of a level vehicle"],
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, as ``--json`` prints them."""
        known = json_attributes(self, "verdict", "reference", "readings", "blocks", "stride")
        return known | {"methods": [entry.as_dict() for entry in self.entries]}  # result of each method


@check_keywords(PARAMETERS_ELSEWHERE)
def compare_methods(
    source: AnyReadings,
    *,
    methods: Sequence[str] | None = None,
    blocks: int = DEFAULT_BLOCKS,
    target_deg: float = 1.0,
    site: Site | None = None,
    tell: Callable[[str], None] | None = None,
) -> Contest:
    """Fit a recording by every method, and cross-validate each by blocks of time.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Readings in the order of time, or a source of `flinders.read`.
    methods : sequence of str, optional
        Names of `flinders.estimators.METHODS`, all by default. Each method is compared with the first.
    blocks : int
        Number of blocks of time; reduced so that each has at least four readings.
    target_deg, site
        As for `flinders.fit`.
    tell : callable, optional
        Called with the name of each method before it is run.

    Raises
    ------
    UsageError
        For a method that is not known or named twice, fewer than two blocks, or numbers out of range.
    ArrayError
        For readings of the wrong shape.
    FitError
        The error of the first method, if no method gives an ellipsoid.
    """
    names = check_methods(methods)
    if blocks < 2:
        raise UsageError(f"{blocks} blocks of time: need 2 or more")
    recording, _ = recording_of(source)
    readings = remove_saturated(Readings.of(recording))
    stride = max(1, -(-len(readings) // MAX_VALIDATED))
    samples = _thin(readings, stride)
    request = Request.of(site, target_deg=target_deg)
    inliers, facing = _inliers_and_dip(readings, samples, request.dip_deg)
    held_back = min(blocks, len(samples) // MIN_BLOCK_READINGS)
    entries: list[Entry] = []
    for name in names:
        if tell is not None:
            tell(name)
        estimator = estimator_of(name, request)
        entry = _timed_fit(estimator, readings, recording, target_deg=target_deg, site=site)
        if entry.fit is not None and held_back > 1:
            entry = _validate(entry, estimator, samples, blocks=held_back, dip_deg=facing, counted=inliers)
            entry = replace(entry, coarser=math.sqrt(stride))
        reference = next((other.fit for other in entries if other.fit is not None), None)
        if entry.fit is not None and reference is not None:
            apart = compare(reference, entry.fit, dip_deg=facing)
            entry = replace(entry, difference_deg=apart.heading_difference_deg)
        entries.append(entry)
    if all(entry.fit is None for entry in entries) and entries[0].refusal is not None:
        raise entries[0].refusal
    return Contest(tuple(entries), len(readings), held_back if held_back > 1 else 0, stride)


def check_methods(methods: Sequence[str] | None) -> Sequence[str]:
    """Names of all methods, or the given names after a check.

    Raises `UsageError` for a method that is not known, or named twice.
    """
    names = list(METHODS) if methods is None else list(methods)
    for name in names:
        method_class(name)
    if len(set(names)) < len(names) or not names:
        raise UsageError(f"methods are {', '.join(names) or 'none'}: name at least one, and each only once")
    return names


def _timed_fit(
    estimator: Estimator, readings: Readings, recording: Recording | Summary, *, target_deg: float, site: Site | None
) -> Entry:
    """Fit by one method, and measure the duration of the method itself."""
    begun = time.perf_counter()
    try:
        estimator.estimate(readings)
        seconds = time.perf_counter() - begun
        fitted = fit(recording, method=estimator, target_deg=target_deg, site=site)
    except Refused as refusal:
        return Entry(estimator.name, seconds, refusal.fit)
    except FitError as error:
        return Entry(estimator.name, time.perf_counter() - begun, refusal=error)
    return Entry(estimator.name, seconds, fitted)


def _validate(entry: Entry, estimator: Estimator, samples: Samples, **options: Any) -> Entry:
    """Cross-validate one method."""
    try:
        return replace(entry, validation=cross_validate(estimator, samples, **options))
    except NotValidated as error:
        return replace(entry, unvalidated=error)


def _thin(readings: Readings, stride: int) -> Samples:
    """Samples of every `stride`-th reading, in memory."""
    recording = readings.recording
    if recording is None:
        raise NeedsSamples("compare_methods")
    seen, taken = 0, []
    for block in recording.blocks():
        taken.append(block[-seen % stride :: stride])
        seen += len(block)
    return concatenate(taken, recording)


def _inliers_and_dip(readings: Readings, samples: Samples, dip_deg: float) -> tuple[NDArray[np.bool_] | None, float]:
    """(N,) readings that `Auto` uses, on which all methods are validated, and the dip with the sign of the mounting."""
    # If the recording has a field strength that varies, `Auto` cannot identify outliers.
    if samples.strength is not None and np.ptp(samples.strength) > 0.0:
        return None, dip_deg
    try:
        estimate = Auto(dip_deg=dip_deg).estimate(readings)
    except FitError:
        return None, dip_deg
    inliers = np.abs(magnitude.distances(samples.field, estimate.ellipsoid)) <= estimate.rejected_beyond
    coverage = Coverage.of_cloud(readings.summary.cloud, estimate.ellipsoid, within=estimate.rejected_beyond)
    return inliers, coverage.facing(dip_deg)
