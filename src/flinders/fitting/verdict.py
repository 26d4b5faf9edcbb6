"""What there is to know of a judged fit: its findings, and what a verdict rests on.

The engine judges (`flinders.native`, ``judge.c``); `flinders.findings` has rules and sentences. Here are the values
that findings have beside the quantities of a judgement, and the findings of disturbances and aiding sensors.

>>> from flinders import simulate
>>> from flinders.fitting.calibrate import fit
>>> [finding.code for finding in fit(simulate.tumble(seed=1).samples).findings]
['scale-unknown', 'rotation-unknown']
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.core.disturbance import known, motor
from flinders.core.language import ENGLISH
from flinders.core.units import label
from flinders.findings import Finding, Record, by_severity, first_causes, found_in, limit_of
from flinders.findings.catalogue import (
    OF_A_FIT,
    OF_CALIBRATION,
    OF_RECORDING,
    OF_RESIDUALS,
    OF_THE_FIT,
    QUANTITIES_OF_A_FIT,
)
from flinders.findings.finding import stated
from flinders.findings.headline import NOT_CLAIMED, headline
from flinders.findings.row import CONDITIONS
from flinders.findings.rules import SEVERITIES, causes_of
from flinders.fitting.advice import is_covered, next_movement, next_step, tilted_errors
from flinders.fitting.record import record_of_ellipsoid, request_of
from flinders.fitting.result import Judgement
from flinders.geometry.plane import order_of
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.core.language import Language
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Condition, Severity
    from flinders.findings.headline import Headline
    from flinders.fitting.result import Fit
    from flinders.native.layouts import Records
    from flinders.summary.summary import RestSpan, Statistics

PLACED, SKEWED = 0.5, 0.15
"""Of the field: an offset across a level turn is known, a shape across it is not."""
NOT_BY_CHANCE: Final = 2.0
"""Claims by which readings that were corrected before have to err for another calibration to be worth having."""
UNSAID: Final = 0.5
"""Of the target: a curve of a disturbance that costs less heading is left unsaid."""
LISTED: Final = 3
"""Runs, rests or lines that a finding lists."""
STRAIGHT: Final = "current"
"""A field goes in proportion to the current that makes it, and may be extrapolated."""


def with_findings(result: Fit, judgement: Records, statistics: Statistics) -> Fit:
    """A fit with the findings of its judgement, the most severe first, and what a verdict rests on.

    Parameters
    ----------
    result : Fit
        Without findings yet.
    judgement : Records
        Of its record.
    statistics : Statistics
        Of the recording it came from.
    """
    record, said = FitRecord(result, statistics, judged_quantities(judgement)), Said.by(judgement)
    supported = said.findings(record, OF_THE_FIT)
    if not any(finding.code == "one-plane" for finding in supported):
        # what follows from a surface that nothing supports is no finding
        supported = [
            *supported,
            *_of_aiding(result),
            *said.findings(record, OF_RESIDUALS),
            *of_disturbances(result),
            *said.findings(record, OF_CALIBRATION),
        ]
    findings = by_severity([*supported, *said.findings(record, OF_RECORDING)])
    is_refused = any(finding.severity == "refuses" for finding in findings)
    return replace(result, judgement=Judgement(findings, () if is_refused else _conditions(judgement)))


def headline_of(fit: Fit, limit_deg: float | None = None, language: Language = ENGLISH) -> Headline:
    """The first sentence of the verdict on a fit.

    `limit_deg`: the tilt up to which headings are within the target, where that is known already.

    >>> from flinders import simulate
    >>> from flinders.fitting.calibrate import fit
    >>> headline_of(fit(simulate.tumble(seed=1, motion="tilted").samples)).code
    'coverage'
    """
    cause = next(iter(first_causes(fit.findings)), None)
    if fit.judgement.is_flat:
        return headline(fit.verdict, cause, NOT_CLAIMED, 0.0, language)
    limit = fit.claim.attitude_limit_deg if limit_deg is None else limit_deg
    return headline(fit.verdict, cause, fit.claim.of_headings, limit, language)


def judged_quantities(judgement: Records) -> dict[str, float]:
    """What the rules of a fit compare, by name."""
    return dict(zip(QUANTITIES_OF_A_FIT, judgement["quantities"].tolist(), strict=True))


class Said(NamedTuple):
    """What a judgement says of a fit.

    Attributes
    ----------
    severities : dict
        Of the findings that it has, by code.
    causes : dict
        Code of the finding that one follows from, by its code.
    """

    severities: dict[str, Severity]
    causes: dict[str, str]

    @classmethod
    def by(cls, judgement: Records) -> Said:
        """Take it from a judgement of the engine."""
        severities = judgement["severities"]
        there = np.flatnonzero(severities).tolist()
        said = {OF_A_FIT[rule]: each for rule in there if (each := SEVERITIES[severities[rule]]) is not None}
        return cls(said, causes_of(judgement))

    def findings(self, record: Mapping[str, Any], codes: Iterable[str]) -> list[Finding]:
        """Of some findings those that there are, with values of a record."""
        return [
            stated(code, record, self.severities[code], self.causes.get(code))
            for code in codes
            if code in self.severities
        ]


def _conditions(judgement: Records) -> tuple[Condition, ...]:
    """What a verdict rests on, by the bits of a judgement."""
    bits = int(judgement["conditions"])
    return tuple(code for place, code in enumerate(CONDITIONS) if bits >> place & 1)


class FitRecord(Record):
    """The quantities of the judgement of a fit, and the values of `VALUES`, each made once, when a finding takes it."""

    def __init__(self, fit: Fit, statistics: Statistics, quantities: Mapping[str, float]) -> None:
        super().__init__({name: value for name, value in quantities.items() if not math.isnan(value)})
        self.fit, self.statistics = fit, statistics  # of its recording
        self.claim, self.evidence, self.diagnosis = fit.claim, fit.evidence, fit.evidence.diagnosis

    def __missing__(self, name: str) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
        self[name] = VALUES[name](self) if name in VALUES else math.nan
        return self[name]


def _is_placed(result: Fit) -> bool:
    """Whether the offset across the plane of a turn is known."""
    assert result.claim.plane is not None
    across = order_of(result.claim.plane)[2]
    return bool(result.claim.offset_sigma[across] < PLACED * result.claim.ellipsoid.radius)


def _is_skewed(result: Fit) -> bool:
    """Whether the shape across the plane of a turn is not known."""
    sigma = float(np.sqrt(np.diag(result.claim.covariance)[[6, 7, 8]].max()))
    return sigma > SKEWED * result.claim.ellipsoid.radius


def improves(fit: Fit) -> bool:
    """Whether headings are better with a calibration; of readings that were corrected before, by more than chance."""
    better = NOT_BY_CHANCE if fit.claim.is_shrunk else 1.0
    return fit.claim.uncorrected_heading_error_deg.worst > better * fit.heading_error_deg.worst


def of_contradiction(repeats: Repeats, unit: str) -> dict[str, Any]:
    """Which recording is off the others, or which two are apart, and by how much in the offset."""
    pair = [part.source for part in repeats.parts]
    sources = pair if len(pair) == 2 else [repeats.farthest.source]
    return {"sources": sources, "offset_apart": repeats.farthest.offset_difference, "unit": unit}


def _contradiction(judged: FitRecord) -> dict[str, Any]:
    """Which recording of a fit is off the others, and by how much; nothing where it has one."""
    repeats = judged.diagnosis.repeats
    return {} if repeats is None else of_contradiction(repeats, label(judged.fit.calibration.unit))


def _of_aiding(fit: Fit) -> Iterator[Finding]:
    """What does not fit together among the instruments."""
    yield from () if fit.evidence.aiding is None else (mistake.finding for mistake in fit.evidence.aiding.mistakes)


def _runs(fit: Fit) -> list[tuple[float, ...]]:
    """The three longest runs of outliers."""
    worst = sorted(fit.evidence.outliers, key=lambda run: -run.readings)[:LISTED]
    return [(run.first, run.last, run.readings, run.start_s, run.end_s, run.independent) for run in worst]


def _rails(statistics: Statistics) -> list[tuple[str, str, float, float]]:
    """Ends of axes at which the sensor was at its limit."""
    return [("xyz"[rail.axis], rail.end, rail.value, rail.share) for rail in statistics.rails]


def _rests(statistics: Statistics) -> list[RestSpan]:
    """The three longest rests."""
    return sorted(statistics.rest_spans, key=lambda span: span.first - span.last)[:LISTED]


def _skipped(statistics: Statistics, *, is_silent: bool) -> list[tuple[Any, ...]]:
    """Rows that should have been readings, a kind each."""
    return [
        (part.reason, part.rows, part.lines[:LISTED], part.example)
        for part in statistics.skipped
        if part.is_silent == is_silent and part.is_loss
    ]


def _textbook_deg(fit: Fit) -> float:
    """Worst heading error for independent residuals; NaN where nothing is known of it."""
    textbook = fit.claim.textbook_heading_error_deg
    return math.nan if textbook is None else textbook.worst


VALUES: Final[dict[str, Callable[[FitRecord], Any]]] = {
    "attitude_limit_deg": lambda judged: judged.claim.attitude_limit_deg,
    "tilted": lambda judged: tilted_errors(judged.fit, judged["attitude_limit_deg"]),
    "next_movement": lambda judged: next_movement(judged.fit),
    "next_step": lambda judged: next_step(judged.fit),
    "method": lambda judged: judged.fit.evidence.method,
    "corrected_length": lambda judged: judged.fit.calibration.field_strength,
    "unit": lambda judged: label(judged.fit.calibration.unit),
    "plane": lambda judged: judged.claim.plane or "",
    "is_placed": lambda judged: _is_placed(judged.fit),
    "is_skewed": lambda judged: _is_skewed(judged.fit),
    "z_down": lambda judged: judged.evidence.z_down,
    "autocorrelation": lambda judged: judged.evidence.residuals.autocorrelation,
    "textbook_deg": lambda judged: _textbook_deg(judged.fit),
    "nonlinear_axis": lambda judged: (
        "" if judged.diagnosis.nonlinearity is None else judged.diagnosis.nonlinearity.axis
    ),
    "late_axis": lambda judged: "" if judged.diagnosis.axis_lag is None else judged.diagnosis.axis_lag.axis,
    "late_by": lambda judged: None if judged.diagnosis.axis_lag is None else judged.diagnosis.axis_lag.apart,
    "is_timed": lambda judged: judged.diagnosis.axis_lag is not None and judged.diagnosis.axis_lag.is_timed,
    "sources": lambda judged: _contradiction(judged).get("sources", ()),
    "offset_apart": lambda judged: _contradiction(judged).get("offset_apart"),
    "swapped_axes": lambda judged: "" if judged.diagnosis.axis_swap is None else judged.diagnosis.axis_swap.axes,
    "swap_row": lambda judged: None if judged.diagnosis.axis_swap is None else judged.diagnosis.axis_swap.rows[0] + 1,
    "swap_count": lambda judged: None if judged.diagnosis.axis_swap is None else len(judged.diagnosis.axis_swap.rows),
    "halves_ratio": lambda judged: None if judged.diagnosis.drift is None else judged.diagnosis.drift.halves_ratio,
    "is_better": lambda judged: improves(judged.fit),
    "is_covered": lambda judged: is_covered(judged.fit),
    "unmodelled": lambda judged: "" if judged.diagnosis.unmodelled is None else judged.diagnosis.unmodelled.name,
    "outlier_count": lambda judged: sum(run.independent for run in judged.evidence.outliers),
    "outlier_runs": lambda judged: _runs(judged.fit),
    "outlier_run_count": lambda judged: len(judged.evidence.outliers),
    "previous": lambda judged: judged.diagnosis.refreshed.previous if judged.diagnosis.refreshed else "",
    "axes": lambda judged: str(judged.fit.calibration.axes),
    "rail_ends": lambda judged: _rails(judged.statistics),
    "rest_spans": lambda judged: _rests(judged.statistics),
    "rest_count": lambda judged: judged.statistics.rests,
    "are_rests_left_out": lambda judged: judged.statistics.are_rests_left_out,
    "doubt": lambda judged: judged.statistics.doubt,
    "skipped_kinds": lambda judged: _skipped(judged.statistics, is_silent=False),
    "silent_kinds": lambda judged: _skipped(judged.statistics, is_silent=True),
}
"""Values of the findings of a fit beside the quantities of its judgement; others are not numbers."""


def of_calibration(calibration: Calibration) -> Iterator[Finding]:
    """Say what the calibration alone tells, whatever it was made from."""
    yield from judged_parts(calibration, OF_CALIBRATION)


def judged_parts(
    calibration: Calibration,
    codes: Iterable[str],
    *,
    target_deg: float = 1.0,
    values: Mapping[str, Any] | None = None,
    **numbers: float,
) -> Iterator[Finding]:
    """Judge a calibration that no recording is at hand of, by some findings alone.

    Parameters
    ----------
    calibration : Calibration
    codes : iterable of str
        Of `flinders.findings.catalogue.OF_A_FIT`.
    target_deg : float
        Worst heading error that is good enough.
    values : mapping, optional
        Values of the findings beside the quantities.
    **numbers
        Fields of the record, such as ``level_worst_deg``.
    """
    record = record_of_ellipsoid(calibration.ellipsoid)
    record["is_claimed"] = True
    for name, number in numbers.items():
        record[name] = number
    judgement = engine().judge(record, request_of(calibration, target_deg=target_deg))
    own = {
        "axes": str(calibration.axes),
        "unit": label(calibration.unit),
        "corrected_length": calibration.field_strength,
        "differ_deg": math.nan,
        "textbook_deg": math.nan,
        "is_covered": False,
    }
    yield from Said.by(judgement).findings({**judged_quantities(judgement), **own, **(values or {})}, codes)


def of_disturbances(fit: Fit) -> Iterator[Finding]:
    """What there is to know of each disturbance that is modelled."""
    estimates = fit.evidence.disturbances.estimates
    if not estimates:
        return
    yield from of_alike(estimates)
    yield from of_noisy(estimates)
    motors = [estimate.name for estimate in estimates if estimate.disturbance is not None and motor(estimate.name)[1]]
    for estimate in estimates:
        if estimate.disturbance is None:
            yield from found_in(_unfollowed_record(estimate), "disturbance-constant", "column-unused")
            continue
        record = {
            **_disturbance_record(estimate, estimate.disturbance, UNSAID * fit.claim.target_deg),
            "target_deg": fit.claim.target_deg,
            "left_at_most_deg": min(estimate.remaining_deg, 180.0),
            "unit": label(fit.calibration.unit),
            "runs_along": bool(motors[1:]) and estimate.name in motors,
            "explained": estimate.explained,
            "explained_sigma": estimate.explained_sigma,
            "explained_share": estimate.explained_share,
            "explained_share_sigma": estimate.explained_share_sigma,
            "noise_uncompensated": fit.evidence.disturbances.noise_uncompensated,
            "noise": fit.evidence.noise,
        }
        first = ("disturbance", "disturbance-uncertain", "disturbance-collinear-attitude")
        yield from found_in(record, *first, *OF_A_COLUMN)


OF_A_COLUMN: Final = tuple(f"disturbance-{fault}" for fault in ("monotone", "lag", "nonlinear", "range", "reference"))
"""Findings of what was logged of a disturbance, turned or on a bench."""


def _unfollowed_record(estimate: DisturbanceEstimate) -> dict[str, Any]:
    """What the findings of something that is not followed compare and state."""
    return {
        "is_constant": float(not estimate.is_unused),
        "nothing": 0.0,
        "least_range": known(estimate.name).least,
        "name": estimate.name,
        "is_unused": float(estimate.is_unused),
        "scatter_ratio": estimate.scatter_ratio,
    }


def _disturbance_record(
    estimate: DisturbanceEstimate, disturbance: Disturbance, unsaid_deg: float = 0.0
) -> dict[str, Any]:
    """What the findings of a disturbance compare and state."""
    return {
        "removed_deg": estimate.removed_deg,
        "remaining_deg": estimate.remaining_deg,
        "attitude_collinearity": estimate.attitude_collinearity,
        "monotonicity": estimate.monotonicity,
        "is_lag_at_limit": float(estimate.is_lag_at_limit),
        "curvature": estimate.curvature,
        "curvature_deg": estimate.curvature * estimate.removed_deg,
        "unsaid_deg": unsaid_deg,
        **_numbers(disturbance),
        **_range(disturbance),
        **_reference(disturbance),
    }


def _numbers(disturbance: Disturbance) -> dict[str, Any]:
    """Its own numbers."""
    return {
        "name": disturbance.name,
        "per_unit": disturbance.per_unit.tolist(),
        "reference": disturbance.reference,
        "lowest": disturbance.lowest,
        "highest": disturbance.highest,
        "lag_s": disturbance.lag_s,
        "gain_per_unit": disturbance.gain_per_unit,
        "states": list(disturbance.states),
    }


def _reference(disturbance: Disturbance) -> dict[str, float]:
    """How far the reference lies outside of what was recorded, as a share of that."""
    outside = max(disturbance.lowest - disturbance.reference, disturbance.reference - disturbance.highest)
    return {
        "reference_outside": outside / (disturbance.highest - disturbance.lowest)
        if disturbance.has_range
        else math.nan,
        "reference_limit": math.inf if motor(disturbance.name)[0] == STRAIGHT else 0.25,
    }


def _range(disturbance: Disturbance) -> dict[str, float]:
    """Whether values of a disturbance can be in its unit, and count in its direction."""
    low, high = disturbance.kind.plausible
    far = max(disturbance.lowest, disturbance.highest, key=abs)
    if not low <= far <= high:
        return {"is_out_of_range": 1.0, "range_number": far, "range_end": high if far > high else low}
    is_negative = motor(disturbance.name)[0] == "current" and -disturbance.lowest > max(
        disturbance.highest, disturbance.kind.least
    )
    return {"is_out_of_range": float(is_negative), "range_number": disturbance.lowest, "range_end": 0.0}


def of_alike(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Whether disturbances are collinear, so that what one does cannot be distinguished from what another does."""
    names = [one.name for one in estimates if one.collinearity > limit_of("disturbances-collinear")]
    most = max((one.collinearity for one in estimates), default=0.0)
    yield from found_in({"most_alike": most, "collinear": names}, "disturbances-collinear")


def of_noisy(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Whether the columns of disturbances are noisy: one finding for all of them."""
    limit = limit_of("disturbance-noisy")
    noisy = [one for one in estimates if one.disturbance is not None and one.attenuation > limit]
    shares = [one.attenuation for one in noisy]
    record = {
        "most_attenuation": max(shares, default=0.0),
        "least_attenuation": min(shares, default=0.0),
        "noisy_names": [one.name for one in noisy],
    }
    yield from found_in(record, "disturbance-noisy")


def of_column(estimate: DisturbanceEstimate) -> Iterator[Finding]:
    """Whether what was logged of a disturbance is fit to be modelled, of a sensor on a bench."""
    if estimate.disturbance is not None:
        yield from found_in(_disturbance_record(estimate, estimate.disturbance), *OF_A_COLUMN)


def of_extrapolation(correction: Calibration, beyond: Mapping[str, float]) -> Iterator[Finding]:
    """State extrapolations of disturbances, by `beyond` of `flinders.core.compensation.Compensator`.

    Examples
    --------
    >>> from flinders.core.calibration import Calibration
    >>> from flinders.core.disturbance import Disturbance
    >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
    >>> followed = Calibration(np.eye(3), [0.0, 0.0, 0.0], 50.0, disturbances=(motors,))
    >>> [(finding.code, finding.number) for finding in of_extrapolation(followed, {"current": 0.25})]
    [('disturbance-beyond', 0.25)]
    """
    for disturbance in correction.disturbances:
        record = {**_numbers(disturbance), "beyond": beyond.get(disturbance.name, 0.0)}
        yield from found_in(record, "disturbance-beyond")
