"""Findings of a judged fit, and the conditions of its verdict.

The engine judges (`flinders.native`, ``judge.c``); `flinders.findings` has rules and sentences. This module adds the
values in findings that are not quantities of a judgement, and the findings on disturbances and aiding sensors.

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

from flinders.core.disturbance import kind_and_motor, kind_of
from flinders.core.language import ENGLISH
from flinders.core.units import unit_label
from flinders.findings import Finding, Record, by_severity, findings_in, first_causes, limit_of
from flinders.findings.catalogue import (
    CALIBRATION_FINDINGS,
    ENGINE_FINDINGS,
    FIT_FINDINGS,
    QUANTITIES_OF_A_FIT,
    RECORDING_FINDINGS,
    RESIDUAL_FINDINGS,
)
from flinders.findings.finding import make_finding
from flinders.findings.headline import NO_CLAIM, headline
from flinders.findings.row import CONDITIONS
from flinders.findings.rules import SEVERITIES, causes_of
from flinders.fitting.advice import is_covered, next_movement, next_step, tilted_errors
from flinders.fitting.record import judgement_request, record_of_ellipsoid
from flinders.fitting.result import Judgement
from flinders.geometry.plane import axis_order
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

MAX_OFFSET_SIGMA, MIN_SHAPE_SIGMA = 0.5, 0.15
"""Standard deviations along the axis of a level turn, as shares of the field.

Below the first the offset counts as known; above the second the shape counts as unknown.
"""
MIN_IMPROVEMENT_SIGMAS: Final = 2.0
"""Smallest ratio of the heading error of already corrected readings to the claim at which a new calibration helps."""
MIN_CURVE_SHARE: Final = 0.5
"""Smallest reported heading error from the nonlinearity of a disturbance, as a share of the target."""
MAX_LISTED: Final = 3
"""Largest count of runs, rests or lines in a finding."""
LINEAR_DISTURBANCE: Final = "current"
"""Kind of disturbance whose field is proportional to its value, so that it may be extrapolated."""


def with_findings(result: Fit, judgement: Records, statistics: Statistics) -> Fit:
    """Add the findings of a judgement, the most severe first, and the conditions of the verdict to a fit.

    Parameters
    ----------
    result : Fit
        Fit without findings.
    judgement : Records
        Judgement of the fit's record.
    statistics : Statistics
        Statistics of the recording.
    """
    record, said = FitRecord(result, statistics, judged_quantities(judgement)), JudgedFindings.by(judgement)
    supported = said.findings(record, FIT_FINDINGS)
    if not any(finding.code == "one-plane" for finding in supported):
        # findings that follow from an ellipsoid which the readings do not determine are left out
        supported = [
            *supported,
            *_aiding_findings(result),
            *said.findings(record, RESIDUAL_FINDINGS),
            *disturbance_findings(result),
            *said.findings(record, CALIBRATION_FINDINGS),
        ]
    findings = by_severity([*supported, *said.findings(record, RECORDING_FINDINGS)])
    is_refused = any(finding.severity == "refuses" for finding in findings)
    return replace(result, judgement=Judgement(findings, () if is_refused else _conditions(judgement)))


def headline_of(fit: Fit, limit_deg: float | None = None, language: Language = ENGLISH) -> Headline:
    """The first sentence of the verdict on a fit.

    `limit_deg` is the largest tilt at which headings meet the target, if it was computed before.

    >>> from flinders import simulate
    >>> from flinders.fitting.calibrate import fit
    >>> headline_of(fit(simulate.tumble(seed=1, motion="tilted").samples)).code
    'coverage'
    """
    cause = next(iter(first_causes(fit.findings)), None)
    if fit.judgement.is_flat:
        return headline(fit.verdict, cause, NO_CLAIM, 0.0, language)
    limit = fit.claim.attitude_limit_deg if limit_deg is None else limit_deg
    return headline(fit.verdict, cause, fit.claim.headline_numbers, limit, language)


def judged_quantities(judgement: Records) -> dict[str, float]:
    """Quantities of a judgement that the rules of findings compare, by name."""
    return dict(zip(QUANTITIES_OF_A_FIT, judgement["quantities"].tolist(), strict=True))


class JudgedFindings(NamedTuple):
    """Findings of a judgement.

    Attributes
    ----------
    severities : dict
        Severity of each finding, by its code.
    causes : dict
        For a finding that follows from another one, the code of that cause, by the code of the finding.
    """

    severities: dict[str, Severity]
    causes: dict[str, str]

    @classmethod
    def by(cls, judgement: Records) -> JudgedFindings:
        """Read the findings from a judgement of the engine."""
        severities = judgement["severities"]
        there = np.flatnonzero(severities).tolist()
        said = {ENGINE_FINDINGS[rule]: each for rule in there if (each := SEVERITIES[severities[rule]]) is not None}
        return cls(said, causes_of(judgement))

    def findings(self, record: Mapping[str, Any], codes: Iterable[str]) -> list[Finding]:
        """Findings of the judgement with one of `codes`, with their values from `record`."""
        return [
            make_finding(code, record, self.severities[code], self.causes.get(code))
            for code in codes
            if code in self.severities
        ]


def _conditions(judgement: Records) -> tuple[Condition, ...]:
    """Conditions of the verdict, which a judgement states as bits."""
    bits = int(judgement["conditions"])
    return tuple(code for place, code in enumerate(CONDITIONS) if bits >> place & 1)


class FitRecord(Record):
    """Quantities of the judgement of a fit, and values of `VALUES`, which are computed at first use."""

    def __init__(self, fit: Fit, statistics: Statistics, quantities: Mapping[str, float]) -> None:
        super().__init__({name: value for name, value in quantities.items() if not math.isnan(value)})
        self.fit, self.statistics = fit, statistics  # of its recording
        self.claim, self.evidence, self.diagnosis = fit.claim, fit.evidence, fit.evidence.diagnosis

    def __missing__(self, name: str) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
        self[name] = VALUES[name](self) if name in VALUES else math.nan
        return self[name]


def _is_offset_known(result: Fit) -> bool:
    """Whether the offset along the axis of a level turn is known."""
    assert result.claim.plane is not None
    across = axis_order(result.claim.plane)[2]
    return bool(result.claim.offset_sigma[across] < MAX_OFFSET_SIGMA * result.claim.ellipsoid.radius)


def _is_shape_unknown(result: Fit) -> bool:
    """Whether the shape along the axis of a level turn is unknown."""
    sigma = float(np.sqrt(np.diag(result.claim.covariance)[[6, 7, 8]].max()))
    return sigma > MIN_SHAPE_SIGMA * result.claim.ellipsoid.radius


def is_improvement(fit: Fit) -> bool:
    """Whether a calibration improves headings; for already corrected readings the improvement must be significant."""
    better = MIN_IMPROVEMENT_SIGMAS if fit.claim.is_shrunk else 1.0
    return fit.claim.uncorrected_heading_error_deg.worst > better * fit.heading_error_deg.worst


def contradiction_values(repeats: Repeats, unit: str) -> dict[str, Any]:
    """Values of a finding on contradicting recordings: the deviating one, or the two, and the offset difference."""
    pair = [part.source for part in repeats.parts]
    sources = pair if len(pair) == 2 else [repeats.most_deviating.source]
    return {"sources": sources, "offset_apart": repeats.most_deviating.offset_difference, "unit": unit}


def _contradiction_of_fit(judged: FitRecord) -> dict[str, Any]:
    """Values of `contradiction_values` for the recordings of a fit; empty for a single recording."""
    repeats = judged.diagnosis.repeats
    return {} if repeats is None else contradiction_values(repeats, unit_label(judged.fit.calibration.unit))


def _aiding_findings(fit: Fit) -> Iterator[Finding]:
    """Findings on aiding sensors that contradict each other or the magnetometer."""
    yield from () if fit.evidence.aiding is None else (mistake.finding for mistake in fit.evidence.aiding.mistakes)


def _runs(fit: Fit) -> list[tuple[float, ...]]:
    """The three longest runs of outliers."""
    worst = sorted(fit.evidence.outliers, key=lambda run: -run.readings)[:MAX_LISTED]
    return [(run.first, run.last, run.readings, run.start_s, run.end_s, run.independent) for run in worst]


def _rails(statistics: Statistics) -> list[tuple[str, str, float, float]]:
    """Ends of axes at which the sensor was saturated."""
    return [("xyz"[rail.axis], rail.end, rail.value, rail.share) for rail in statistics.rails]


def _rests(statistics: Statistics) -> list[RestSpan]:
    """The three longest rests."""
    return sorted(statistics.rest_spans, key=lambda span: span.first - span.last)[:MAX_LISTED]


def _skipped_rows(statistics: Statistics, *, is_silent: bool) -> list[tuple[Any, ...]]:
    """Kinds of rows without a usable reading, each with its count."""
    return [
        (part.reason, part.rows, part.lines[:MAX_LISTED], part.example)
        for part in statistics.skipped
        if part.is_silent == is_silent and part.is_loss
    ]


def _textbook_deg(fit: Fit) -> float:
    """Worst heading error for independent residuals, in degrees; NaN if unknown."""
    textbook = fit.claim.textbook_heading_error_deg
    return math.nan if textbook is None else textbook.worst


VALUES: Final[dict[str, Callable[[FitRecord], Any]]] = {
    "attitude_limit_deg": lambda judged: judged.claim.attitude_limit_deg,
    "tilted": lambda judged: tilted_errors(judged.fit, judged["attitude_limit_deg"]),
    "next_movement": lambda judged: next_movement(judged.fit),
    "next_step": lambda judged: next_step(judged.fit),
    "method": lambda judged: judged.fit.evidence.method,
    "corrected_length": lambda judged: judged.fit.calibration.field_strength,
    "unit": lambda judged: unit_label(judged.fit.calibration.unit),
    "plane": lambda judged: judged.claim.plane or "",
    "is_placed": lambda judged: _is_offset_known(judged.fit),
    "is_skewed": lambda judged: _is_shape_unknown(judged.fit),
    "z_down": lambda judged: judged.evidence.z_down,
    "autocorrelation": lambda judged: judged.evidence.residuals.autocorrelation,
    "textbook_deg": lambda judged: _textbook_deg(judged.fit),
    "nonlinear_axis": lambda judged: (
        "" if judged.diagnosis.nonlinearity is None else judged.diagnosis.nonlinearity.axis
    ),
    "late_axis": lambda judged: "" if judged.diagnosis.axis_lag is None else judged.diagnosis.axis_lag.axis,
    "late_by": lambda judged: None if judged.diagnosis.axis_lag is None else judged.diagnosis.axis_lag.lag,
    "is_timed": lambda judged: judged.diagnosis.axis_lag is not None and judged.diagnosis.axis_lag.is_timed,
    "sources": lambda judged: _contradiction_of_fit(judged).get("sources", ()),
    "offset_apart": lambda judged: _contradiction_of_fit(judged).get("offset_apart"),
    "swapped_axes": lambda judged: "" if judged.diagnosis.axis_swap is None else judged.diagnosis.axis_swap.axes,
    "swap_row": lambda judged: None if judged.diagnosis.axis_swap is None else judged.diagnosis.axis_swap.rows[0] + 1,
    "swap_count": lambda judged: None if judged.diagnosis.axis_swap is None else len(judged.diagnosis.axis_swap.rows),
    "halves_ratio": lambda judged: None if judged.diagnosis.drift is None else judged.diagnosis.drift.halves_ratio,
    "is_better": lambda judged: is_improvement(judged.fit),
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
    "skipped_kinds": lambda judged: _skipped_rows(judged.statistics, is_silent=False),
    "silent_kinds": lambda judged: _skipped_rows(judged.statistics, is_silent=True),
}
"""Functions for values in the findings of a fit that are not quantities of its judgement; some are not numbers."""


def calibration_findings(calibration: Calibration) -> Iterator[Finding]:
    """Findings on a calibration that need no readings."""
    yield from judge_calibration(calibration, CALIBRATION_FINDINGS)


def judge_calibration(
    calibration: Calibration,
    codes: Iterable[str],
    *,
    target_deg: float = 1.0,
    values: Mapping[str, Any] | None = None,
    **numbers: float,
) -> Iterator[Finding]:
    """Judge a calibration without a recording; yields the findings that apply, of some that are named.

    Parameters
    ----------
    calibration : Calibration
        The calibration.
    codes : iterable of str
        Codes of `flinders.findings.catalogue.ENGINE_FINDINGS`.
    target_deg : float
        Worst heading error that is good enough.
    values : mapping, optional
        Values in the findings that are not quantities of the judgement.
    **numbers
        Fields of the record, such as ``level_worst_deg``.
    """
    record = record_of_ellipsoid(calibration.ellipsoid)
    record["is_claimed"] = True
    for name, number in numbers.items():
        record[name] = number
    judgement = engine().judge(record, judgement_request(calibration, target_deg=target_deg))
    own = {
        "axes": str(calibration.axes),
        "unit": unit_label(calibration.unit),
        "corrected_length": calibration.field_strength,
        "differ_deg": math.nan,
        "textbook_deg": math.nan,
        "is_covered": False,
    }
    yield from JudgedFindings.by(judgement).findings({**judged_quantities(judgement), **own, **(values or {})}, codes)


def disturbance_findings(fit: Fit) -> Iterator[Finding]:
    """Findings on each disturbance of a fit."""
    estimates = fit.evidence.disturbances.estimates
    if not estimates:
        return
    yield from collinearity_findings(estimates)
    yield from noise_findings(estimates)
    motors = [
        estimate.name for estimate in estimates if estimate.disturbance is not None and kind_and_motor(estimate.name)[1]
    ]
    for estimate in estimates:
        if estimate.disturbance is None:
            yield from findings_in(_unfollowed_record(estimate), "disturbance-constant", "column-unused")
            continue
        record = {
            **_disturbance_record(estimate, estimate.disturbance, MIN_CURVE_SHARE * fit.claim.target_deg),
            "target_deg": fit.claim.target_deg,
            "left_at_most_deg": min(estimate.remaining_deg, 180.0),
            "unit": unit_label(fit.calibration.unit),
            "runs_along": bool(motors[1:]) and estimate.name in motors,
            "explained": estimate.explained,
            "explained_sigma": estimate.explained_sigma,
            "explained_share": estimate.explained_share,
            "explained_share_sigma": estimate.explained_share_sigma,
            "noise_uncompensated": fit.evidence.disturbances.noise_uncompensated,
            "noise": fit.evidence.noise,
        }
        first = ("disturbance", "disturbance-uncertain", "disturbance-collinear-attitude")
        yield from findings_in(record, *first, *COLUMN_FINDINGS)


COLUMN_FINDINGS: Final = tuple(
    f"disturbance-{fault}" for fault in ("monotone", "lag", "nonlinear", "range", "reference")
)
"""Codes of findings on the logged values of a disturbance, for a turned sensor and for a sensor on a bench."""


def _unfollowed_record(estimate: DisturbanceEstimate) -> dict[str, Any]:
    """Values in the findings on a disturbance that the fit does not follow."""
    return {
        "is_constant": float(not estimate.is_unused),
        "nothing": 0.0,
        "least_range": kind_of(estimate.name).least,
        "name": estimate.name,
        "is_unused": float(estimate.is_unused),
        "scatter_ratio": estimate.scatter_ratio,
    }


def _disturbance_record(
    estimate: DisturbanceEstimate, disturbance: Disturbance, unsaid_deg: float = 0.0
) -> dict[str, Any]:
    """Values in the findings on a disturbance; `unsaid_deg` is the smallest reported heading error by nonlinearity."""
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
    """Attributes of a disturbance that findings state."""
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
    """Distance of the reference from the recorded range, as a share of the range, with the limit of this share."""
    outside = max(disturbance.lowest - disturbance.reference, disturbance.reference - disturbance.highest)
    return {
        "reference_outside": outside / (disturbance.highest - disturbance.lowest)
        if disturbance.has_range
        else math.nan,
        "reference_limit": math.inf if kind_and_motor(disturbance.name)[0] == LINEAR_DISTURBANCE else 0.25,
    }


def _range(disturbance: Disturbance) -> dict[str, float]:
    """Whether a recorded value of a disturbance is implausible in its unit or sign, with that value and its limit."""
    low, high = disturbance.kind.plausible
    far = max(disturbance.lowest, disturbance.highest, key=abs)
    if not low <= far <= high:
        return {"is_out_of_range": 1.0, "range_number": far, "range_end": high if far > high else low}
    is_negative = kind_and_motor(disturbance.name)[0] == "current" and -disturbance.lowest > max(
        disturbance.highest, disturbance.kind.least
    )
    return {"is_out_of_range": float(is_negative), "range_number": disturbance.lowest, "range_end": 0.0}


def collinearity_findings(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Finding that disturbances are collinear, so that their effects cannot be distinguished."""
    names = [one.name for one in estimates if one.collinearity > limit_of("disturbances-collinear")]
    most = max((one.collinearity for one in estimates), default=0.0)
    yield from findings_in({"most_alike": most, "collinear": names}, "disturbances-collinear")


def noise_findings(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Finding that columns of disturbances are noisy; one finding for all columns."""
    limit = limit_of("disturbance-noisy")
    noisy = [one for one in estimates if one.disturbance is not None and one.attenuation > limit]
    shares = [one.attenuation for one in noisy]
    record = {
        "most_attenuation": max(shares, default=0.0),
        "least_attenuation": min(shares, default=0.0),
        "noisy_names": [one.name for one in noisy],
    }
    yield from findings_in(record, "disturbance-noisy")


def column_findings(estimate: DisturbanceEstimate) -> Iterator[Finding]:
    """Findings on the logged values of a disturbance, of a sensor on a bench."""
    if estimate.disturbance is not None:
        yield from findings_in(_disturbance_record(estimate, estimate.disturbance), *COLUMN_FINDINGS)


def extrapolation_findings(correction: Calibration, beyond: Mapping[str, float]) -> Iterator[Finding]:
    """Findings on disturbances outside their recorded range; `beyond` is from `Compensator.beyond`.

    Examples
    --------
    >>> from flinders.core.calibration import Calibration
    >>> from flinders.core.disturbance import Disturbance
    >>> motors = Disturbance("current", [0.5, 0.0, 0.0], highest=20.0)
    >>> followed = Calibration(np.eye(3), [0.0, 0.0, 0.0], 50.0, disturbances=(motors,))
    >>> [(finding.code, finding.number) for finding in extrapolation_findings(followed, {"current": 0.25})]
    [('disturbance-beyond', 0.25)]
    """
    for disturbance in correction.disturbances:
        record = {**_numbers(disturbance), "beyond": beyond.get(disturbance.name, 0.0)}
        yield from findings_in(record, "disturbance-beyond")
