"""What there is to say of a judged fit: findings with their sentences, and what a good verdict rests on.

The engine judges (`flinders.native`, ``judge.c``); `flinders.findings` has rules and sentences. Here are the words that
sentences take beside the quantities of a judgement, and the findings of disturbances and aiding sensors.

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

from flinders.core.compensation import beyond_words
from flinders.core.disturbance import known, motor
from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.findings import CATALOGUE, Finding, Record, by_severity, fit, found_in, limit_of
from flinders.findings.catalogue import (
    OF_A_FIT,
    OF_CALIBRATION,
    OF_RECORDING,
    OF_RESIDUALS,
    OF_THE_FIT,
    QUANTITIES_OF_A_FIT,
)
from flinders.findings.row import CONDITIONS
from flinders.findings.rules import SEVERITIES
from flinders.fitting.advice import attitudes, movement, remedy
from flinders.fitting.record import record_of_ellipsoid, request_of
from flinders.fitting.result import Judgement
from flinders.geometry.plane import order_of
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.core.samples import Skipped
    from flinders.diagnostics.repeatability import Repeats
    from flinders.estimators.regressors import DisturbanceEstimate
    from flinders.findings import Condition
    from flinders.fitting.evidence import Diagnosis
    from flinders.fitting.result import Fit
    from flinders.native.engine import Records
    from flinders.summary.quality import Rail
    from flinders.summary.summary import Statistics

PLACED, SKEWED = 0.5, 0.15
"""Of the field: an offset across a level turn is known, a shape across it is not."""
NOT_BY_CHANCE: Final = 2.0
"""Claims by which readings that were corrected before have to err for another calibration to be worth having."""
UNSAID: Final = 0.5
"""Of the target: a curve of a disturbance that costs less heading is left unsaid."""
STRAIGHT: Final = "current"
"""A field goes in proportion to the current that makes it, and may be extrapolated."""


def with_findings(result: Fit, judgement: Records, statistics: Statistics) -> Fit:
    """A fit with the findings of its judgement, the most severe first, and what a good verdict rests on.

    Parameters
    ----------
    result : Fit
        Without findings yet.
    judgement : Records
        Of its record.
    statistics : Statistics
        Of the recording it came from.
    """
    record = _FitRecord(Spoken(result, statistics, judged_quantities(judgement)))
    supported: tuple[Finding, ...] = tuple(found_by(judgement, record, OF_THE_FIT))
    if not any(finding.code == "one-plane" for finding in supported):
        # what follows from a surface that nothing supports is no finding
        supported = (
            *supported,
            *_of_aiding(result),
            *found_by(judgement, record, OF_RESIDUALS),
            *of_disturbances(result),
            *found_by(judgement, record, OF_CALIBRATION),
        )
    findings = by_severity([*supported, *found_by(judgement, record, OF_RECORDING)])
    is_good = all(finding.severity == "note" for finding in findings)
    return replace(result, judgement=Judgement(findings, _conditions(judgement) if is_good else ()))


def judged_quantities(judgement: Records) -> dict[str, float]:
    """What the rules of a fit compare, by name."""
    return dict(zip(QUANTITIES_OF_A_FIT, judgement["quantities"].tolist(), strict=True))


def found_by(judgement: Records, record: Mapping[str, Any], codes: Iterable[str]) -> Iterator[Finding]:
    """Of some findings of a fit those that its judgement has, stated by a record."""
    severities = dict(zip(OF_A_FIT, judgement["severities"].tolist(), strict=True))
    for code in codes:
        if (severity := SEVERITIES[severities[code]]) is not None:
            yield CATALOGUE[code].stated(record, severity)


def _conditions(judgement: Records) -> tuple[Condition, ...]:
    """What a good verdict rests on, by the bits of a judgement."""
    bits = int(judgement["conditions"])
    return tuple(code for place, code in enumerate(CONDITIONS) if bits >> place & 1)


class Spoken(NamedTuple):
    """What the sentences about a fit speak of.

    Attributes
    ----------
    fit : Fit
    statistics : Statistics
        Of its recording.
    quantities : dict
        Of its judgement, by name.
    """

    fit: Fit
    statistics: Statistics
    quantities: dict[str, float]

    @property
    def diagnosis(self) -> Diagnosis:
        """What diagnostics found."""
        return self.fit.evidence.diagnosis


class _FitRecord(Record):
    """The quantities of a judgement, and the words of `WORDS`, each made when a sentence asks for it."""

    def __init__(self, spoken: Spoken) -> None:
        super().__init__(spoken.quantities)
        self._spoken = spoken

    def __missing__(self, name: str) -> str:
        return WORDS[name](self._spoken)


def _where_flat(spoken: Spoken) -> str:
    """What readings in one plane, or on one line, leave open."""
    if spoken.quantities["breadth"] > spoken.quantities["flatness_limit"]:
        return "in one plane, as in a level turn, and tell nothing of the direction across it"
    return "on one line, as of two attitudes, and tell nothing of the directions across it"


def _independent_readings(fit: Fit) -> str:
    """How many readings there are to go by."""
    independent = min(fit.evidence.residuals.independent_samples, float(fit.samples))
    alike = "the others repeat them, or err alike, as where the field is not the same everywhere"
    others = "" if independent == fit.samples else f" (of {fit.samples:,}: {alike})"
    return f"{counted(independent, 'independent reading')}{others}"


def _correlation(fit: Fit) -> str:
    """How much residuals have in common, and what it would be to take no notice of it."""
    correlation = fit.evidence.residuals.autocorrelation
    next_one = "" if correlation is None else f"each with the next by {correlation:.2f}"
    textbook = fit.claim.textbook_heading_error_deg
    claim = "" if textbook is None else f"without regard to it {figures(textbook.worst)}° would be claimed"
    words = "; ".join(part for part in (next_one, claim) if part)
    return f" ({words})" if words else ""


def _across(result: Fit) -> int:
    """The axis across the plane of a turn in one plane."""
    assert result.claim.plane is not None
    return order_of(result.claim.plane)[2]


def _is_placed(result: Fit) -> bool:
    """Whether the offset across that plane is known."""
    return bool(result.claim.offset_sigma[_across(result)] < PLACED * result.claim.ellipsoid.radius)


def _how_placed(result: Fit) -> str:
    return f"and in {'xyz'[_across(result)]} by the site's field" if _is_placed(result) else "only"


def _assumed(result: Fit) -> str:
    """What the offset across the plane rests on."""
    side = f"{'xyz'[_across(result)]} down, and " if result.evidence.z_down else ""
    return f" (with {side}the floor level unless an accelerometer was recorded)" if _is_placed(result) else ""


def _mounting(result: Fit) -> str:
    """What to say about the mounting where the shape across the plane is not known."""
    claim = result.claim
    skewed = float(np.sqrt(np.diag(claim.covariance)[[6, 7, 8]].max())) > SKEWED * claim.ellipsoid.radius
    return "say how well the mounting is known, or " if skewed and _is_placed(result) else ""


def _z_words(result: Fit) -> str:
    """Where z points, unless down."""
    return "" if result.evidence.z_down else fit.Z_OPEN if result.evidence.z_down is None else fit.Z_ELSEWHERE


def _why_biased(result: Fit) -> str:
    if result.claim.plane:
        return "the points are not equally spaced in heading, or some do not belong; use 'ellipse'"
    return "its model is too simple for this sensor, or its equation is biased by noise; use 'auto'"


def _halves(spoken: Spoken) -> str:
    """How far the halves of a recording are apart, where that limits the fit."""
    drift = spoken.diagnosis.drift
    if drift is None or drift.halves_ratio is None or spoken.quantities["drift_allowed_deg"]:
        return ""
    return f" (its halves differ by {drift.halves_ratio:.1f} times what they claim)"


def improves(fit: Fit) -> bool:
    """Whether headings are better with a calibration; of readings that were corrected before, by more than chance."""
    better = NOT_BY_CHANCE if fit.claim.is_shrunk else 1.0
    return fit.claim.uncorrected_heading_error_deg.worst > better * fit.heading_error_deg.worst


def _leave(fit: Fit) -> str:
    """Whether the readings of a sensor that was corrected before are as good without the calibration."""
    if improves(fit):
        return "the calibration is worth having"
    is_covered = fit.coverage.hole_deg <= limit_of("coverage")
    return "leave them as they are" if is_covered else "leave them as they are, or turn the sensor further"


def _swap(fit: Fit) -> str:
    """Which axes changed their sign or their place, when, and how often."""
    swap = fit.evidence.diagnosis.axis_swap
    if swap is None:
        return ""
    letters, others = swap.axes, len(swap.rows) - 1
    what = f"the sign of {letters} turned" if len(letters) == 1 else f"{letters[0]} and {letters[1]} changed places"
    again = f" and back and forth, {counted(others, 'time')} more" if others else ""
    return f"{swap.rows[0] + 1:,} on {what}{again}:"


def contradiction_words(repeats: Repeats | None, quantities: Mapping[str, float], unit: str) -> str:
    """Which recording is off the others, and by how much."""
    if repeats is None:
        return ""
    part, pair = repeats.farthest, len(repeats.parts) == 2
    who = f"{repeats.parts[0].source} and {repeats.parts[1].source} are" if pair else f"{part.source} is"
    others = "apart" if pair else "off the other recordings"
    if quantities["apart_beyond_claim_deg"]:
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
    yield from () if fit.evidence.aiding is None else (mistake.finding for mistake in fit.evidence.aiding.mistakes)


def _runs(fit: Fit) -> str:
    """The three longest runs of outliers."""
    worst = sorted(fit.evidence.outliers, key=lambda run: -run.readings)[:3]
    return "; ".join(str(run) for run in worst) + ("; …" if len(fit.evidence.outliers) > len(worst) else "")


def _at_rail(rail: Rail) -> str:
    return f"{rail.share:.1%} sit at the {rail.end} value of {'xyz'[rail.axis]} ({rail.value:g})"


def _rests(health: Statistics) -> str:
    """The three longest rests."""
    longest = sorted(health.rest_spans, key=lambda span: span.first - span.last)[:3]
    return "; ".join(map(str, longest)) + ("; …" if health.rests > len(longest) else "")


def _again(share: float) -> str:
    """What to do about outliers, where they limit the fit."""
    return "; see what it was, and record again without" if share > limit_of("outliers") else ""


def _length(calibration: Calibration) -> str:
    """Strength of the field of corrected readings."""
    return f"{figures(calibration.field_strength, 4)} {label(calibration.unit)}"


def _times(count: int) -> str:
    """How often something happened."""
    return "once" if count == 1 else f"{count:,} times"


def _lost(statistics: Statistics) -> list[Skipped]:
    """Rows that could not be read."""
    return [part for part in statistics.skipped if part.is_loss and not part.is_silent]


def _if_many(spoken: Spoken, quantity: str, words: str) -> str:
    """Words where more than a tenth of the rows are concerned."""
    return words if spoken.quantities[quantity] > 0.1 * spoken.quantities["rows"] else ""


WORDS: Final[dict[str, Callable[[Spoken], str]]] = {
    "attitudes": lambda spoken: attitudes(spoken.fit),
    "movement": lambda spoken: movement(spoken.fit),
    "remedy": lambda spoken: remedy(spoken.fit),
    "why": lambda _: "",
    "method": lambda spoken: spoken.fit.method,
    "unit": lambda spoken: label(spoken.fit.calibration.unit),
    "where_flat": _where_flat,
    "plane_axes": lambda spoken: " and ".join(str(spoken.fit.claim.plane)),
    "how": lambda spoken: _how_placed(spoken.fit),
    "assumed": lambda spoken: _assumed(spoken.fit),
    "up": lambda spoken: _z_words(spoken.fit),
    "mounting": lambda spoken: _mounting(spoken.fit),
    "rings": lambda spoken: ", as two rings of readings would" if spoken.fit.evidence.unobserved == 1 else "",
    "independent_readings": lambda spoken: _independent_readings(spoken.fit),
    "correlation": lambda spoken: _correlation(spoken.fit),
    "why_biased": lambda spoken: _why_biased(spoken.fit),
    "nonlinear_axis": lambda spoken: "" if (found := spoken.diagnosis.nonlinearity) is None else found.axis,
    "axis_lag": lambda spoken: str(spoken.diagnosis.axis_lag or ""),
    "contradiction": lambda spoken: contradiction_words(
        spoken.diagnosis.repeats, spoken.quantities, label(spoken.fit.calibration.unit)
    ),
    "swap": lambda spoken: _swap(spoken.fit),
    "halves": _halves,
    "leave": lambda spoken: _leave(spoken.fit),
    "unmodelled": lambda spoken: "" if (found := spoken.diagnosis.unmodelled) is None else found.name,
    "outliers": lambda spoken: counted(sum(run.independent for run in spoken.fit.evidence.outliers), "reading"),
    "runs": lambda spoken: _runs(spoken.fit),
    "again": lambda spoken: _again(spoken.quantities["outlier_share"]),
    "previous": lambda spoken: "" if (found := spoken.diagnosis.refreshed) is None else found.previous,
    "axes": lambda spoken: str(spoken.fit.calibration.axes),
    "length": lambda spoken: _length(spoken.fit.calibration),
    "rails": lambda spoken: ", ".join(map(_at_rail, spoken.statistics.rails)),
    "rests": lambda spoken: _rests(spoken.statistics),
    "rests_count": lambda spoken: (
        "are left out" if spoken.statistics.are_rests_left_out else "count as one reading each"
    ),
    "often": lambda spoken: _times(spoken.statistics.clock.backward_steps),
    "skipped_rows": lambda spoken: "; ".join(map(str, _lost(spoken.statistics))),
    "check": lambda spoken: _if_many(spoken, "skipped", ". Check the sensor, its cable, and what was saved"),
    "doubt": lambda spoken: spoken.statistics.doubt,
    "silent_rows": lambda spoken: "; ".join(str(part) for part in spoken.statistics.skipped if part.is_silent),
    "supply": lambda spoken: _if_many(spoken, "silent", ". Check its supply and its bus, and how it is read"),
}
"""Words of the sentences about a fit."""


def of_calibration(calibration: Calibration) -> Iterator[Finding]:
    """Say what the calibration alone tells, whatever it was made from."""
    yield from judged_parts(calibration, OF_CALIBRATION)


def judged_parts(
    calibration: Calibration,
    codes: Iterable[str],
    *,
    target_deg: float = 1.0,
    words: Mapping[str, Callable[[Mapping[str, float]], str]] | None = None,
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
    words : mapping, optional
        Words that the sentences take, from the quantities.
    **numbers
        Fields of the record, such as ``level_worst_deg``.
    """
    record = record_of_ellipsoid(calibration.ellipsoid)
    record["is_claimed"] = True
    for name, number in numbers.items():
        record[name] = number
    judgement = engine().judge(record, request_of(calibration, target_deg=target_deg))
    quantities = judged_quantities(judgement)
    made = {name: (lambda word=word: word(quantities)) for name, word in (words or {}).items()}
    own = {"axes": str(calibration.axes), "length": _length(calibration)}
    yield from found_by(judgement, Record(quantities, **own, **made), codes)


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
            yield from found_in(_constant_record(estimate), "disturbance-constant")
            continue
        record = _disturbance_record(estimate, estimate.disturbance, UNSAID * fit.claim.target_deg)
        record |= Record({"target_deg": fit.claim.target_deg, "left_at_most_deg": min(estimate.remaining_deg, 180.0)})
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
    noise = fit.evidence.disturbances.noise_uncompensated
    return "" if noise is None else f"; without, readings lie {figures(noise)} off instead of {figures(fit.noise)}"


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
