"""Is this calibration fit for use? `judge` holds what a fit shows against the catalogue of findings. It prints nothing.

A record holds the quantities that rules compare and sentences state; `flinders.findings` has rules and sentences.

>>> from flinders import simulate
>>> from flinders.fitting.calibrate import fit
>>> from flinders.summary.summary import Summary
>>> tumble = simulate.tumble(seed=1).samples
>>> [finding.code for finding in judge(fit(tumble), Summary.of(tumble).statistics)]
['scale-unknown', 'rotation-unknown']
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from flinders.core.compensation import beyond_words
from flinders.core.disturbance import known, motor
from flinders.core.units import COUNTS, EARTH_UT, MICROTESLA, label
from flinders.errors import counted, figures
from flinders.findings import Finding, Record, by_severity, fit, found_in, limit_of
from flinders.fitting.advice import attitudes, movement, remedy
from flinders.geometry.plane import order_of
from flinders.summary.summary import flat_below

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Condition
    from flinders.fitting.result import Fit
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.summary.quality import Rail
    from flinders.summary.summary import Statistics

OF_FIT: Final = tuple(row.code for row in fit.ROWS)
"""Findings of a fit by itself."""
OF_CALIBRATION: Final = (
    "axis-ratio",
    "field-strength",
    "mirrored-axes",
    "unit-unknown",
    "scale-unknown",
    "rotation-unknown",
)
"""Findings of a calibration, whatever it was made from."""
OF_RECORDING: Final = (
    "quantised", "stale-repeats", "at-rest", "unordered", "time-back", "time-gap", "no-answer", "like-gravity",
    "skipped-rows",
)  # fmt: skip
"""Findings of a recording as a whole."""
OF_THE_RECORDING: Final = frozenset({"saturated", *OF_RECORDING})
"""Findings that hold whatever the fit is worth, and may be the reason why it is worth nothing."""

PLACED, SKEWED = 0.5, 0.15
"""Of the field: an offset across a level turn is known, a shape across it is not."""
BEYOND_CLAIM: Final = 3.0
CHANGED_SHARE: Final = 0.25
ENOUGH, ENOUGH_CORRELATED = 15.0, 20.0
"""Independent readings: claims of 15 at rest are as wrong as true ones (``python -m benchmarks.claims --tables few``);
how many independent ones correlated readings are worth is itself known roughly."""
NOT_BY_CHANCE: Final = 2.0
"""Claims by which readings that were corrected before have to err for another calibration to be worth having."""
ALTERNATING: Final = -0.25
"""Correlation of a residual with the next that neither noise has nor what changes slowly."""
UNSTEADY, SWITCHING = 1.25, 0.8
"""Of the target, heading error of a moment that a field may make: by noise, and by what comes and goes at once."""
STEPS: Final = 7.0
"""Kurtosis of steps of residuals above which something comes and goes: of 1,200 recordings with slow noise none has it,
those with a load that switches have 7 to 34 (`docs/adversary.md`)."""
SAME_STRENGTH: Final = 0.03
"""Of the strength of the field: within it, readings have the one that is known of the place."""
SEES_THE_FIELD: Final = frozenset({"dip", "tilt", "attitude"})
"""Aiding sensors to which the field of a place with iron looks bent."""
UNSAID: Final = 0.5
"""Of the target: a curve of a disturbance that costs less heading is left unsaid."""
STRAIGHT: Final = "current"
"""A field goes in proportion to the current that makes it, and may be extrapolated."""


def judge(result: Fit, statistics: Statistics) -> tuple[Finding, ...]:
    """Say what there is to know about a fit, the most severe first.

    Parameters
    ----------
    result : Fit
        Without findings yet.
    statistics : Statistics
        Of the recording it came from.
    """
    record = fit_record(result, statistics)
    flat = tuple(found_in(record, "one-plane"))
    supported = flat or (  # what follows from a surface that nothing supports is no finding
        *found_in(record, *OF_FIT),
        *_of_aiding(result),
        *found_in(record, "alternating", "outliers"),
        *of_disturbances(result),
        *of_calibration(result),
    )
    return by_severity([*supported, *of_recording(statistics)])


def conditions(fit: Fit, findings: Sequence[Finding]) -> tuple[Condition, ...]:
    """What a fit rests on and nothing here shows, where its findings make it a good one.

    A field that depends on the attitude, of iron at the place or of a current, hides in the calibration itself. A
    second recording that agrees, the accelerometer's dip, and a known strength of the field that the readings have
    speak for a place without iron; currents that are compensated speak for themselves.
    """
    if any(finding.severity != "note" for finding in findings):
        return ()
    used = () if fit.aiding is None else tuple(sensor.name for sensor in fit.aiding.sensors if sensor.is_used)
    agrees = fit.repeats is not None and not any(finding.code == "recordings-differ" for finding in findings)
    is_strong = fit.calibration.field_strength_known and fit.calibration.unit == MICROTESLA
    matches = is_strong and abs(fit.ellipsoid.radius / fit.calibration.field_strength - 1.0) < SAME_STRENGTH
    is_uniform = agrees or matches or bool(SEES_THE_FIELD & set(used))
    open_ones: tuple[tuple[Condition, bool], ...] = (
        ("same-soft-iron", fit.refreshed is None),
        ("uniform-field", is_uniform),
        ("constant-iron", bool(fit.disturbances)),
    )
    return tuple(code for code, is_ended in open_ones if not is_ended)


def fit_record(fit: Fit, statistics: Statistics) -> Record:
    """What the findings of a fit compare and state; not a number where something does not apply."""
    return _FitRecord(
        {
            "target_deg": fit.target_deg,
            "samples": fit.samples,
            **_flatness(fit, statistics),
            **_accuracy(fit),
            **_evidence(fit),
            **_changes(fit),
            **_lasting(fit, statistics),
            **_outliers(fit, statistics.fitted),
            "inflation": math.nan if fit.plane or fit.refreshed else _inflation(fit, statistics.extent),
            "noise_share": fit.noise / fit.ellipsoid.radius,
            **_structure(fit),
            "poses_by_chance": math.nan,
            "soft_iron_p_value": fit.refreshed.soft_iron_p_value if fit.refreshed else math.nan,
        },
        fit,
    )


class _FitRecord(Record):
    """The record of a fit, which makes a word of `WORDS` when a sentence asks for it."""

    def __init__(self, numbers: Mapping[str, Any], fit: Fit) -> None:
        super().__init__(numbers)
        self._fit = fit

    def __missing__(self, name: str) -> str:
        return WORDS[name](self._fit)


def _flatness(fit: Fit, statistics: Statistics) -> dict[str, float | str]:
    """Whether the readings lie in one plane: then, without an aiding sensor, many ellipsoids go through their ring."""
    thickness, middle, width = np.sqrt(statistics.principal_variances).tolist()
    limit = flat_below(width, fit.noise)
    is_known = bool(fit.plane or fit.refreshed or fit.method == "aided" or not width)
    return {
        "flatness": math.nan if is_known else thickness / width,
        "flatness_limit": limit / width if width else math.nan,
        "where_flat": (
            "in one plane, as in a level turn, and tell nothing of the direction across it"
            if middle > limit
            else "on one line, as of two attitudes, and tell nothing of the directions across it"
        ),
    }


def _accuracy(fit: Fit) -> dict[str, float]:
    """What the covariance says about heading; an error that is not known is beyond any target."""
    worst, alignment = fit.heading_error_deg.worst, fit.alignment_error_deg
    is_estimated = fit.calibration.rotation == "estimated" and alignment is not None
    return {
        "worst_deg": math.inf if math.isnan(worst) else worst,
        "alignment_deg": alignment if is_estimated and alignment is not None else math.nan,
        "bias_deg": fit.bias_deg,
        "uncorrected_deg": fit.uncorrected_heading_error_deg.worst if fit.is_shrunk else math.nan,
        "is_planar": float(bool(fit.plane)),
        "attitude_limit_deg": fit.attitude_limit_deg if fit.plane else math.nan,
        "per_degree_of_tilt": fit.per_degree_of_tilt if fit.plane else math.nan,
    }


def _evidence(fit: Fit) -> dict[str, float]:
    """How much there was to go by; what a level turn leaves open is said once."""
    independent = min(fit.independent_samples, float(fit.samples))
    return {
        "hole_deg": math.nan if fit.plane or fit.refreshed else fit.coverage.hole_deg,
        "covered": fit.coverage.fraction,
        "unobserved": 0.0 if fit.plane else fit.unobserved,
        "prior_share": math.nan if fit.plane or fit.unobserved else fit.prior_influence,
        "independent": independent,
        "independent_needed": ENOUGH if independent == fit.samples else ENOUGH_CORRELATED,
        "independent_share": independent / max(fit.samples, 1),
    }


def _independent_readings(fit: Fit) -> str:
    """How many readings there are to go by."""
    independent = min(fit.independent_samples, float(fit.samples))
    alike = "the others repeat them, or err alike, as where the field is not the same everywhere"
    others = "" if independent == fit.samples else f" (of {fit.samples:,}: {alike})"
    return f"{counted(independent, 'independent reading')}{others}"


def _correlation(fit: Fit) -> str:
    """How much residuals have in common, and what it would be to take no notice of it."""
    next_one = "" if fit.autocorrelation is None else f"each with the next by {fit.autocorrelation:.2f}"
    textbook = fit.textbook_heading_error_deg
    claim = "" if textbook is None else f"without regard to it {figures(textbook.worst)}° would be claimed"
    words = "; ".join(part for part in (next_one, claim) if part)
    return f" ({words})" if words else ""


def _across(result: Fit) -> int:
    """The axis across the plane of a turn in one plane."""
    assert result.plane is not None
    return order_of(result.plane)[2]


def _is_placed(result: Fit) -> bool:
    """Whether the offset across that plane is known."""
    return bool(result.offset_sigma[_across(result)] < PLACED * result.ellipsoid.radius)


def _how_placed(result: Fit) -> str:
    return f"and in {'xyz'[_across(result)]} by the site's field" if _is_placed(result) else "only"


def _assumed(result: Fit) -> str:
    """What the offset across the plane rests on."""
    side = f"{'xyz'[_across(result)]} down, and " if result.z_down else ""
    return f" (with {side}the floor level unless an accelerometer was recorded)" if _is_placed(result) else ""


def _mounting(result: Fit) -> str:
    """What to say about the mounting where the shape across the plane is not known."""
    skewed = float(np.sqrt(np.diag(result.covariance)[[6, 7, 8]].max())) > SKEWED * result.ellipsoid.radius
    return "say how well the mounting is known, or " if skewed and _is_placed(result) else ""


def _z_words(result: Fit) -> str:
    """Where z points, unless down."""
    return "" if result.z_down else fit.Z_OPEN if result.z_down is None else fit.Z_ELSEWHERE


def _why_biased(result: Fit) -> str:
    if result.plane:
        return "the points are not equally spaced in heading, or some do not belong; use 'ellipse'"
    return "its model is too simple for this sensor, or its equation is biased by noise; use 'auto'"


def _inflation(fit: Fit, extent: float) -> float:
    """How many times as wide as its readings the surface is: much, where a small patch of them leaves it open."""
    return 2.0 * float(fit.ellipsoid.semi_axes[2]) / max(extent, sys.float_info.min)


def _changes(fit: Fit) -> dict[str, float]:
    """What changed: within a recording, from one recording to the next, from one reading to the next."""
    drift, swap, unmodelled, dependence = fit.drift, fit.axis_swap, fit.unmodelled, fit.attitude_dependence
    return {
        **_apart(fit.repeats, fit.target_deg),
        "drift_deg": math.nan if drift is None else drift.heading_deg,
        "drift_allowed_deg": fit.target_deg if ((fit.drift and fit.drift.halves_ratio) or 0.0) < BEYOND_CLAIM else 0.0,
        "drift_by_chance": math.nan if drift is None else drift.p_value,
        "drift": math.nan if drift is None else math.hypot(*drift.offset),
        "swap_gain": math.nan if swap is None else swap.gain,
        "unmodelled_deg": math.nan if unmodelled is None else unmodelled.heading_deg,
        "attitude_dependent_deg": math.nan if dependence is None else dependence.heading_deg,
        "tilt_error_deg": fit.tilt_error_deg,
        **_alternation(fit),
    }


def halves_matter(drift_deg: Any, by_chance: Any, target_deg: float) -> Any:  # noqa: ANN401 - numbers, or columns of them
    """Whether a change is proven, and one that does not limit by its size."""
    is_proven = by_chance < limit_of("field-changed", "drift_by_chance")
    return is_proven & (CHANGED_SHARE * target_deg < drift_deg) & (drift_deg <= target_deg)


def _halves(fit: Fit) -> str:
    """How far the halves of a recording are apart, where that limits the fit."""
    apart = fit.drift and fit.drift.halves_ratio
    return f" (its halves differ by {apart:.1f} times what they claim)" if apart and apart >= BEYOND_CLAIM else ""


def _structure(fit: Fit) -> dict[str, float]:
    """What belongs to the direction: axes that are proven not to be linear or to be late, or else whatever it is."""
    faults = fit.faults_of_axes
    bent = fit.nonlinearity if fit.nonlinearity in faults else None
    late = fit.axis_lag if fit.axis_lag in faults else None
    corrected = fit.nonlinearity if fit.nonlinearity and fit.nonlinearity.is_corrected else None
    return {
        "structure_deg": fit.structure_deg,
        "structure_share": math.nan if bent else fit.distortion / fit.ellipsoid.radius,
        "nonlinear_deg": bent.heading_deg if bent else math.nan,
        "nonlinear_share": bent.share if bent else math.nan,
        "lag_deg": late.heading_deg if late else math.nan,
        "linearized_deg": corrected.heading_deg if corrected else math.nan,
        "linearized_share": corrected.share if corrected else math.nan,
    }


def _apart(repeats: Repeats | None, target_deg: float) -> dict[str, float]:
    """How far recordings of one sensor are apart, by the one that chance explains least."""
    if repeats is None:
        return dict.fromkeys(("apart_deg", "apart_by_chance", "apart_beyond_claim_deg"), math.nan)
    part = repeats.farthest
    beyond = part.difference_deg > max(CHANGED_SHARE * target_deg, BEYOND_CLAIM * part.difference_sigma_deg)
    return {
        "apart_deg": part.difference_deg,
        "apart_by_chance": part.p_value,
        "apart_beyond_claim_deg": part.difference_deg if beyond else 0.0,
    }


def _lasting(fit: Fit, statistics: Statistics) -> dict[str, float]:
    """What lasts from one reading to the next different one, and the heading error of a single moment that it makes."""
    correlation = unlike_correlation(fit.autocorrelation or 0.0, statistics.fitted_repeats / max(statistics.fitted, 1))
    level = fit.ellipsoid.radius * math.cos(math.radians(fit.known_dip_deg))
    return {
        "noise_lasts": fit.noise_lasts,
        "unlike_correlation": correlation,
        "unsteady_deg": math.degrees(fit.noise * math.sqrt(correlation) / level),
        "unsteady_limit_deg": fit.target_deg * unsteady_limit(fit.steps_kurtosis),
    }


def unsteady_limit(steps_kurtosis: Any) -> Any:  # noqa: ANN401 - a number, or a column of them
    """Of the target, heading error of a single moment that a field may make."""
    return UNSTEADY - (UNSTEADY - SWITCHING) * (steps_kurtosis > STEPS)


def unlike_correlation(next_correlation: Any, repeated: Any) -> Any:  # noqa: ANN401 - numbers, or columns of them
    """Correlation of a residual with that of the next different reading, where a share repeats the one before."""
    excess = next_correlation - repeated
    return excess * (excess > 0.0) / (1.0 - repeated)


def _alternation(fit: Fit) -> dict[str, float]:
    """Whether readings of two sensors take turns, whose mean is neither's calibration."""
    correlation = 0.0 if fit.autocorrelation is None else fit.autocorrelation
    off = math.sqrt(max(-3.0 * correlation, 0.0)) * fit.noise  # a residual shows its part along the surface's normal
    level = fit.ellipsoid.radius * math.cos(math.radians(fit.heading_error_deg.dip_deg))
    return {
        "next_correlation": correlation,
        "alternating_limit": min(ALTERNATING, -4.0 / math.sqrt(max(fit.samples, 1))),
        "alternating_deg": math.degrees(math.atan2(off, level)),
    }


def improves(fit: Fit) -> bool:
    """Whether headings are better with a calibration; of readings that were corrected before, by more than chance."""
    better = NOT_BY_CHANCE if fit.is_shrunk else 1.0
    return fit.uncorrected_heading_error_deg.worst > better * fit.heading_error_deg.worst


def _leave(fit: Fit) -> str:
    """Whether the readings of a sensor that was corrected before are as good without the calibration."""
    if improves(fit):
        return "the calibration is worth having"
    is_covered = fit.coverage.hole_deg <= limit_of("coverage")
    return "leave them as they are" if is_covered else "leave them as they are, or turn the sensor further"


def _swap(fit: Fit) -> str:
    """Which axes changed their sign or their place, when, and how often."""
    swap = fit.axis_swap
    if swap is None:
        return ""
    letters, others = swap.axes, len(swap.rows) - 1
    what = f"the sign of {letters} turned" if len(letters) == 1 else f"{letters[0]} and {letters[1]} changed places"
    again = f" and back and forth, {counted(others, 'time')} more" if others else ""
    return f"{swap.rows[0] + 1:,} on {what}{again}:"


def contradiction(repeats: Repeats, target_deg: float, unit: str) -> Iterator[Finding]:
    """Whether recordings of one sensor contradict each other."""
    words = {"contradiction": lambda: _contradiction(repeats, target_deg, unit)}
    record = Record({"target_deg": target_deg, **_apart(repeats, target_deg)}, **words)
    yield from found_in(record, "recordings-differ")


def _contradiction(repeats: Repeats | None, target_deg: float, unit: str) -> str:
    """Which recording is off the others, and by how much."""
    if repeats is None:
        return ""
    part, pair = repeats.farthest, len(repeats.parts) == 2
    who = f"{repeats.parts[0].source} and {repeats.parts[1].source} are" if pair else f"{part.source} is"
    others = "apart" if pair else "off the other recordings"
    if _apart(repeats, target_deg)["apart_beyond_claim_deg"]:
        return (
            f"{who} {figures(part.difference_deg)}° of heading {others} ({figures(part.offset_difference)} {unit} in "
            "the offset), which is not chance: something magnetic changed in between; use "
            "recordings made in the state of use"
        )
    return (
        f"{who} {others} by more than both claim, though hardly in heading ({figures(part.difference_deg)}°): the "
        "heading error allows for it"
    )


def _of_aiding(fit: Fit) -> Iterator[Finding]:
    """What does not fit together among the instruments."""
    yield from () if fit.aiding is None else (mistake.finding for mistake in fit.aiding.mistakes)


def _outliers(fit: Fit, fitted: int) -> dict[str, Any]:
    """What a robust fit left out of so many readings: outliers, and the readings around their runs."""
    share = sum(run.independent for run in fit.outliers) / max(fitted, 1)
    return {
        "outlier_share": share,
        "farthest": max((run.max_distance for run in fit.outliers), default=math.nan),
        "again": "; see what it was, and record again without" if share and share > limit_of("outliers") else "",
    }


def _runs(fit: Fit) -> str:
    """The three longest runs of outliers."""
    worst = sorted(fit.outliers, key=lambda run: -run.readings)[:3]
    return "; ".join(str(run) for run in worst) + ("; …" if len(fit.outliers) > len(worst) else "")


WORDS: Final[dict[str, Callable[[Fit], str]]] = {
    "attitudes": attitudes,
    "movement": movement,
    "remedy": remedy,
    "why": lambda _: "",
    "method": lambda fit: fit.method,
    "unit": lambda fit: label(fit.calibration.unit),
    "plane_axes": lambda fit: " and ".join(str(fit.plane)),
    "how": _how_placed,
    "assumed": _assumed,
    "up": _z_words,
    "mounting": _mounting,
    "rings": lambda fit: ", as two rings of readings would" if fit.unobserved == 1 else "",
    "independent_readings": _independent_readings,
    "correlation": _correlation,
    "why_biased": _why_biased,
    "nonlinear_axis": lambda fit: "" if fit.nonlinearity is None else fit.nonlinearity.axis,
    "axis_lag": lambda fit: str(fit.axis_lag or ""),
    "contradiction": lambda fit: _contradiction(fit.repeats, fit.target_deg, label(fit.calibration.unit)),
    "swap": _swap,
    "halves": _halves,
    "leave": _leave,
    "unmodelled": lambda fit: "" if fit.unmodelled is None else fit.unmodelled.name,
    "outliers": lambda fit: counted(sum(run.independent for run in fit.outliers), "reading"),
    "runs": _runs,
    "previous": lambda fit: fit.refreshed.previous if fit.refreshed else "",
}
"""Words of the sentences about a fit."""


def of_recording(health: Statistics) -> Iterator[Finding]:
    """What a recording says about itself."""
    yield from found_in(_recording_record(health), "saturated", *OF_RECORDING)


def _at_rail(rail: Rail) -> str:
    return f"{rail.share:.1%} sit at the {rail.end} value of {'xyz'[rail.axis]} ({rail.value:g})"


def _rests(health: Statistics) -> str:
    """The three longest rests."""
    longest = sorted(health.rest_spans, key=lambda span: span.first - span.last)[:3]
    return "; ".join(map(str, longest)) + ("; …" if health.rests > len(longest) else "")


def _recording_record(health: Statistics) -> Record:
    clock, most = health.clock, 0.1 * health.rows
    silent = [part for part in health.skipped if part.is_silent]
    lost = [part for part in health.skipped if part.is_loss and not part.is_silent]
    skipped, unanswered = (sum(part.rows for part in parts) for parts in (lost, silent))
    return Record(
        {
            "rows": health.rows,
            "distinct": health.distinct,
            "rail_share": max((rail.share for rail in health.rails), default=0.0),
            "repeated_share": 1.0 - health.distinct / max(health.rows, 1),
            "at_rest_share": health.at_rest / max(health.rows, 1),
            "step": health.step,
            "path_correlation": math.nan if clock.steps else health.path_correlation,
            "backward_steps": clock.backward_steps,
            "longest_step_s": clock.longest_step,
            "usual_step_s": clock.usual_step,
            "skipped": skipped,
            "silent": unanswered,
            "is_doubtful": float(bool(health.doubt)),
        },
        rails=lambda: ", ".join(map(_at_rail, health.rails)),
        rests=lambda: _rests(health),
        rests_count="are left out" if health.are_rests_left_out else "count as one reading each",
        often=lambda: "once" if clock.backward_steps == 1 else f"{clock.backward_steps:,} times",
        skipped_rows=lambda: "; ".join(map(str, lost)),
        check=lambda: "" if skipped <= most else ". Check the sensor, its cable, and what was saved",
        doubt=health.doubt,
        silent_rows=lambda: "; ".join(map(str, silent)),
        supply=lambda: "" if unanswered <= most else ". Check its supply and its bus, and how it is read",
    )


class Corrected(Protocol):
    """What has a calibration in it: a fit, or calibrations put together."""

    @property
    def calibration(self) -> Calibration:
        """The correction."""

    @property
    def ellipsoid(self) -> Ellipsoid:
        """What it makes a sphere."""


def of_calibration(corrected: Corrected) -> Iterator[Finding]:
    """Say what the calibration alone tells, whatever it was made from."""
    yield from found_in(calibration_record(corrected), *OF_CALIBRATION)


def calibration_record(corrected: Corrected) -> Record:
    """What the findings of a calibration compare and state."""
    correction, axes, radius = corrected.calibration, corrected.ellipsoid.semi_axes, corrected.ellipsoid.radius
    is_absolute = correction.unit == MICROTESLA and not correction.field_strength_known
    nearest = min(max(radius, EARTH_UT[0]), EARTH_UT[1])
    return Record(
        {
            "axis_ratio": float(axes[2] / axes[0]),
            "radius": radius,
            "nearest_earth": nearest,
            "times_outside_earth": max(radius / nearest, nearest / radius) if is_absolute else math.nan,
            "weakest": EARTH_UT[0],
            "strongest": EARTH_UT[1],
            "handedness": -1.0 if correction.axes.is_mirror else 1.0,
            "field_strength": correction.field_strength,
            "is_in_counts": float(correction.unit == COUNTS),
            "is_relative": float(not correction.field_strength_known),
            "is_unaligned": float(correction.rotation == "symmetric"),
            "nothing": 0.0,
        },
        axes=lambda: str(correction.axes),
        length=f"{figures(correction.field_strength, 4)} {label(correction.unit)}",
    )


def of_disturbances(fit: Fit) -> Iterator[Finding]:
    """What there is to know of each disturbance that is modelled."""
    if not fit.disturbances:
        return
    yield from of_alike(fit.disturbances)
    yield from of_noisy(fit.disturbances)
    motors = [
        estimate.name for estimate in fit.disturbances if estimate.disturbance is not None and motor(estimate.name)[1]
    ]
    for estimate in fit.disturbances:
        if estimate.disturbance is None:
            yield from found_in(_constant_record(estimate), "disturbance-constant")
            continue
        record = _disturbance_record(estimate, estimate.disturbance, UNSAID * fit.target_deg)
        record |= Record({"target_deg": fit.target_deg, "left_at_most_deg": min(estimate.remaining_deg, 180.0)})
        runs_along = bool(motors[1:]) and estimate.name in motors
        record |= {
            "unit": label(fit.calibration.unit),
            "running": ", the other motors running along as they did then" if runs_along else "",
            "without": _without(fit),
        }
        first = ("disturbance", "disturbance-uncertain", "disturbance-collinear-attitude")
        yield from found_in(record, *first, *OF_A_COLUMN)


OF_A_COLUMN: Final = tuple(f"disturbance-{fault}" for fault in ("monotone", "lag", "nonlinear", "range", "reference"))
"""Findings of what was logged of a disturbance, turned or on a bench."""


def _without(fit: Fit) -> str:
    """What readings would be off by, if nothing were modelled."""
    if fit.noise_uncompensated is None:
        return ""
    return f"; without, readings lie {figures(fit.noise_uncompensated)} off instead of {figures(fit.noise)}"


def _constant_record(estimate: DisturbanceEstimate) -> Record:
    kind = known(estimate.name)
    numbers = {"is_constant": 1.0, "nothing": 0.0, "least_range": kind.least}
    return Record(numbers, name=lambda: estimate.name, range_unit=lambda: kind.unit)


def _disturbance_record(estimate: DisturbanceEstimate, disturbance: Disturbance, unsaid_deg: float = 0.0) -> Record:
    """What the findings of a disturbance compare and state."""
    name, is_throttle = estimate.name, motor(estimate.name)[0] == "throttle"
    other = "record the current instead, which the field follows, or " if is_throttle else ""
    return Record(
        {
            "removed_deg": estimate.removed_deg,
            "remaining_deg": estimate.remaining_deg,
            "attitude_collinearity": estimate.attitude_collinearity,
            "monotonicity": estimate.monotonicity,
            "is_lag_at_limit": float(estimate.is_lag_at_limit),
            "lag_s": disturbance.lag_s,
            "curvature": estimate.curvature,
            "curvature_deg": estimate.curvature * estimate.removed_deg,
            "unsaid_deg": unsaid_deg,
            "lowest": disturbance.lowest,
            **_range(disturbance),
            **_reference(disturbance),
        },
        name=lambda: name,
        disturbance=lambda: str(disturbance),
        at_end=lambda: f"at {disturbance.amount(disturbance.farthest)}",
        highest=lambda: disturbance.amount(disturbance.highest),
        reference=lambda: disturbance.amount(disturbance.reference),
        other_column=lambda: other,
        out_of_range=lambda: _out_of_range(disturbance),
    )


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


def _out_of_range(disturbance: Disturbance) -> str:
    """What is wrong with the values."""
    far = max(disturbance.lowest, disturbance.highest, key=abs)
    if not disturbance.kind.plausible[0] <= far <= disturbance.kind.plausible[1]:
        return (
            f"{disturbance.name} was recorded at up to {disturbance.amount(far)}: it is in another unit than "
            f"{disturbance.kind.per}; convert the column, or what is exported is off by as much"
        )
    return (
        f"{disturbance.name} was recorded from {disturbance.lowest:.3g} to "
        f"{disturbance.amount(disturbance.highest)}: what is drawn counts negative there, "
        "and positive for autopilots; turn the sign of the column round"
    )


def of_alike(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Whether disturbances are collinear, so that what one does cannot be distinguished from what another does."""
    names = [one.name for one in estimates if one.collinearity > limit_of("disturbances-collinear")]
    record = Record(
        {"most_alike": max((one.collinearity for one in estimates), default=0.0)}, alike=lambda: ", ".join(names)
    )
    yield from found_in(record, "disturbances-collinear")


def of_noisy(estimates: Sequence[DisturbanceEstimate]) -> Iterator[Finding]:
    """Whether the columns of disturbances are noisy: one finding for all of them."""
    limit = limit_of("disturbance-noisy")
    noisy = [one for one in estimates if one.disturbance is not None and one.attenuation > limit]
    shares = [one.attenuation for one in noisy]
    names = ", ".join(one.name for one in noisy)
    is_one = len(noisy) == 1
    record = Record(
        {"most_attenuation": max(shares, default=0.0)},
        noisy=names,
        noisy_what=(
            "its meter is noisy, and what was found of it is"
            if is_one
            else "their meters are noisy, and what was found of each is, by its own course,"
        ),
        noisy_share=lambda: _share(min(shares), max(shares)),
        noisy_remedy=f"a smoother {names}" if is_one else "them smoother",
    )
    yield from found_in(record, "disturbance-noisy")


def _share(least: float, most: float) -> str:
    return f"{most:.0%}" if f"{least:.0%}" == f"{most:.0%}" else f"{100.0 * least:.0f} to {most:.0%}"


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
        share = beyond.get(disturbance.name, 0.0)
        words = {"beyond_words": lambda disturbance=disturbance, share=share: beyond_words(disturbance, share)}
        yield from found_in(Record({"beyond": share}, **words), "disturbance-beyond")
