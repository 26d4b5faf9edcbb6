"""Comparisons as pages for the terminal: calibrations, the truth, methods, a fleet over time; and what to choose from.

>>> chance_words(0.43), chance_words(1e-9)
('no more than chance explains (p = 0.43)', 'more than chance explains (p < 0.0001)')
>>> duration(0.00421), duration(12.5), duration(90)
('4.2 ms', '12 s', '90 s')
>>> from flinders.simulate import TwoAxis
>>> [name for name, *_ in recovery_rows(TwoAxis(), TwoAxis())]
['scale x', 'scale y', 'offset x', 'offset y', 'skew', 'noise']
>>> shown_when(1.7e9, "flight 12"), shown_when(float("nan"), "flight 12"), shown_when(float("nan"), "")
('2023-11-14', 'flight 12', '–')
>>> shown_when(float("nan"), "returned/session 0017.csv")
'…session 0017.csv'
"""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.comparison.comparison import CHANCE
from flinders.core.units import label
from flinders.errors import counted, figures, in_python, percent
from flinders.findings import VERDICTS, advice
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.geometry.ellipsoid import upper
from flinders.report.fit_pages import plane_rows
from flinders.report.fleet import STATES, about_order, chance, common_unit, when
from flinders.report.formatting import (
    FINEST,
    angle,
    degrees,
    on_the_point,
    p_value,
    shown_findings,
    with_uncertainty,
)
from flinders.report.terminal import COLOURS, lines, notes, page, styled, table, verdict, whole_columns

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.comparison.comparison import Comparison, RotationDifference, Strength
    from flinders.comparison.evaluation import Evaluation
    from flinders.comparison.methods import Contest, Entry
    from flinders.core.calibration import Calibration
    from flinders.errors import Spelling
    from flinders.estimators import Method
    from flinders.findings import Severity, Verdict
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Turn
    from flinders.heading.error_propagation import DirectionError, HeadingError
    from flinders.report.fleet import BatchDrift, FleetDrift
    from flinders.simulate.two_axis import Polar, TwoAxis
    from flinders.targets import Target

AGREEMENT: Final = {
    "agree": ("AGREE", "HOLDS"), "differ": ("DIFFER", "IS OFF"), "contradict": ("CONTRADICT", "FAILS"),
}  # fmt: skip
"""Titles of two calibrations, and of one on another recording."""

UNCHECKED, UNTOLD = "NO CHECK", "CANNOT TELL"
"""Titles of a calibration that agrees with its own recording, and of one of which a recording tells too little."""

TURNED: Final = (
    "their rotations into the body differ by more than chance explains: the sensor was turned in its mounting, or an "
    "instrument beside it"
)

EVALUATED: Final = {"as claimed": "AS CLAIMED", "worse than claimed": "WORSE THAN CLAIMED", "unclaimed": "NO CLAIM"}

ROUNDING_DEG: Final = 1e-4
"""Degrees of heading that come from rounding alone."""

STATE_COLOURS: Final = {
    "recalibrate": "red", "unsure": "yellow", "changed": "yellow", "unordered": "yellow", "steady": "green",
}  # fmt: skip
SHOWN: Final = 12
"""Units, steps and batches that are listed; the report and ``--out`` have more."""
LONGEST: Final = 17
"""Characters of a recording's name that are shown."""

WIDTH: Final = 78


def of_comparison(
    comparison: Comparison,
    spell: Spelling = in_python,
    *,
    fresh: Fit | None = None,
    strengths: tuple[Strength, Strength] | None = None,
    own: Sequence[str] = (),
) -> RenderableType:
    """Lay out two calibrations side by side: the difference, what chance explains, the verdict.

    Where one is checked on a recording, `fresh` is a fit of that, whose limits are said below, and `strengths` are the
    recording's under both. `own` names the recordings, if any, that went into the calibration: agreement with those
    proves nothing.
    """
    found = () if fresh is None else fresh.findings
    limits = [advice(finding, spell) for finding in found if finding.severity == "limits"]
    said = _comparison_verdict(comparison, fresh, own, limits)
    if own:
        limits.insert(0, f"{' and '.join(own)} went into this calibration: check it on a recording made since")
    if comparison.is_turned:
        limits.insert(0, TURNED)
    blocks = (_differences(comparison), _parameters(comparison), None if strengths is None else _strengths(*strengths))
    return Group(page(*blocks, said), notes(("limits", limit) for limit in limits))


def of_untold(known: Fit, fit: Fit, strength: Strength, spell: Spelling = in_python) -> RenderableType:
    """Lay out what a recording, of which no fit can be used, tells of a known calibration, and why it is not more."""
    basis = f"{counted(fit.samples, 'reading')}; {fit.method}"
    words = (
        f"whether {known.name} holds, as no fit of this recording can be used; corrected, its strength is "
        f"{strength.mean:.3f} of the field with a spread of {strength.spread:.1%}, where {known.name} was made one of "
        f"{known.noise / known.calibration.ellipsoid.radius:.1%}:"
    )
    reasons = ((finding.severity, advice(finding, spell)) for finding in shown_findings(fit))
    return Group(page(verdict(UNTOLD, "limited", words, basis)), notes(reasons))


def of_evaluation(evaluation: Evaluation) -> RenderableType:
    """Lay out a calibration against the truth: true errors, claimed ones, their ratio, the verdict."""
    return page(_true_errors(evaluation), _true_parameters(evaluation), _evaluation_verdict(evaluation))


def of_recovery(true: TwoAxis, estimate: TwoAxis, polar: Polar, turn: Turn) -> RenderableType:
    """Lay out a swung two-axis compass: its parameters, true and estimated, the recipe, headings before and after."""
    rows = [
        (name, f"{expected:.4f}{unit}", f"{value:.4f}{unit}", f"{round(value - expected, 4) + 0.0:+.4f}{unit}")
        for name, expected, value, unit in recovery_rows(true, estimate)
    ]
    headings = [
        ("raw", *_heading_cells(polar.raw_error_deg, polar.raw_radius)),
        ("corrected", *_heading_cells(polar.corrected_error_deg, polar.corrected_radius)),
    ]
    return page(
        table(("parameter", "true", "found", "error"), rows),
        table(("recipe", "mean and scatter", "least squares"), plane_rows(turn, "µT")),
        table(("heading", "error, rms", "worst", "radius"), headings),
    )


def of_contest(contest: Contest) -> RenderableType:
    """Lay out all methods on one recording: worth, numbers, and why some are not to be trusted.

    Numbers of refused calibrations are here, dim, because they are compared with those of a spreadsheet or a paper;
    nothing is written.
    """
    entries = [entry for entry in contest.entries if entry.fit is not None]
    result = _method_numbers(entries) if entries else None
    return page(Group(_worth(contest), _basis(contest)), result, notes(_reasons(contest)))


# --------------------------------------------------------------------------------------------------- two calibrations


def chance_words(value: float | None) -> str:
    """Say whether chance explains a difference."""
    if value is None:
        return "no uncertainty is stated, so nothing is left to chance"
    return f"{'no more' if value >= CHANCE else 'more'} than chance explains ({p_value(value)})"


def _differences(comparison: Comparison) -> Table:
    heading, claimed = comparison.heading_difference_deg, comparison.claimed_deg
    mean = f"{round(comparison.heading_mean_deg, 2) + 0.0:.2f}°"
    rows: list[Sequence[RenderableType]] = [styled("bold", "heading", angle(heading.rms), angle(heading.worst), mean)]
    if claimed is not None:
        rows.append(("  claimed, 1 σ", degrees(claimed.rms), degrees(claimed.worst)))
        rows.append(("  95 % within", "", degrees(comparison.claimed_bound_deg or 0.0)))
    rows.append(("direction", angle(comparison.direction_difference_deg)))
    if comparison.rotation is not None:
        rows.append(("rotation in the body", angle(comparison.rotation.angle_deg)))
        if comparison.rotation.angle_sigma_deg is not None:
            rows.append(("  claimed, 1 σ", degrees(comparison.rotation.angle_sigma_deg)))
    return table(("difference", "rms", "worst", "mean"), rows)


def _offset_cells(offset: Floats, sigma: Floats | None) -> str:
    """Offset along x, y and z, with its uncertainty where one is known."""
    sigmas = np.zeros(3) if sigma is None else sigma
    return "   ".join(with_uncertainty(*pair) for pair in zip(offset + 0.0, sigmas, strict=True))


def _parameters(comparison: Comparison) -> Text:
    offset = _offset_cells(comparison.offset_difference, comparison.offset_sigma)
    unit = f"{label(comparison.unit)}, {_percent(comparison.offset_share)} of the field"
    scale = "" if comparison.is_scale_known else "of sensor and field together"
    return lines([("offset", offset, unit), ("scale", _percent(comparison.scale_difference), scale)])


def _strengths(known: Strength, fresh: Strength) -> Table:
    pairs = (("the calibration", known), ("a fresh fit", fresh))
    rows = [(name, figures(one.mean, 4), _percent(one.spread)) for name, one in pairs]
    return table(("corrected with", "strength", "spread"), rows)


def _comparison_verdict(comparison: Comparison, fresh: Fit | None, own: Sequence[str], limits: Sequence[str]) -> Table:
    """What to make of it, and what it rests on."""
    basis = _square_basis(comparison.heading_difference_deg, comparison.chi_square, comparison.freedom)
    if comparison.omitted_rotation_deg is not None:
        omitted = degrees(comparison.omitted_rotation_deg)
        basis += f"; the rotation into the body of {omitted}, known to one alone, is left out"
    if fresh is not None:
        basis += f"; {counted(fresh.samples, 'reading')}, {fresh.coverage.fraction:.0%} of the sphere covered"
    is_firm = comparison.is_conclusive and not limits and not own and not comparison.is_turned
    colour = {"agree": "good" if is_firm else "limited", "differ": "limited", "contradict": "refused"}
    title, words = AGREEMENT[comparison.verdict][fresh is not None], _words(comparison, is_limited=bool(limits))
    title = UNTOLD if comparison.verdict == "agree" and not comparison.is_conclusive else title
    if own and comparison.verdict == "agree":
        title = UNCHECKED
        words = "a calibration fits its own readings, however the sensor has changed: this proves nothing"
    return verdict(title, colour[comparison.verdict], words, basis)


def _square_basis(error: HeadingError, square: float | None, freedom: int) -> str:
    """For which dip a heading error holds, and χ² where there is one."""
    level = f"level vehicle, dip {error.dip_deg:.3g}°"
    if square is None:
        return level
    size = f"= {round(square, 6):.3g}" if square < 1000.0 else "> 1000"
    return f"{level}; χ² {size} for {freedom} degrees of freedom"


def _words(comparison: Comparison, *, is_limited: bool) -> str:
    if comparison.is_nothing:
        return "the same calibration twice"
    explained, target = chance_words(comparison.p_value), f"{comparison.target_deg:g}°"
    worst_deg = comparison.heading_difference_deg.worst
    if comparison.verdict == "agree":
        vague = "" if comparison.is_conclusive else f"; but they claim too little to tell {target}: record for longer"
        limits = ", with these limits of the recording:" if is_limited else ""
        within = f"heading within {angle(worst_deg)}" if worst_deg < ANY_ANGLE_DEG else "headings any angle apart"
        return f"{within}, {explained}{vague}{limits}"
    side, advice = {
        "differ": ("less", "good enough for that, and a new calibration will be better"),
        "contradict": ("more", "the sensor or what is near it has changed, calibrate again"),
    }[comparison.verdict]
    return f"headings {_up_to(worst_deg)} apart, {side} than the target of {target} and {explained}: {advice}"


def _up_to(angle_deg: float) -> str:
    """Write the worst of many angles; beyond a right angle there is no worst.

    >>> _up_to(0.31), _up_to(170.0)
    ('up to 0.31°', 'any angle')
    """
    return f"up to {angle(angle_deg)}" if angle_deg < ANY_ANGLE_DEG else "any angle"


def _percent(share: float) -> str:
    """Write a fraction as a percentage.

    >>> _percent(0.00126), _percent(-0.00001), _percent(0.2), _percent(float("inf"))
    ('0.13%', '0.00%', '20%', '> 1000%')
    """
    if not abs(share) < 10.0:
        return "> 1000%"
    decimals = 2 if abs(share) < 0.1 else 0
    return f"{round(share, decimals + 2) + 0.0:.{decimals}%}"


# ---------------------------------------------------------------------------------------------------- with the truth


def _true_errors(evaluation: Evaluation) -> Table:
    """True and claimed errors, and their ratio."""
    heading, claimed = evaluation.heading_error_deg, evaluation.claimed_heading_deg
    bound = evaluation.claimed_bound_deg
    body, of_body = evaluation.body_heading_error_deg, evaluation.claimed_body_heading_deg
    free, with_rotation = evaluation.unrotated_direction_error_deg, evaluation.direction_error_deg
    rows = [
        styled("bold", "level heading", *_true_cells(heading, claimed, evaluation.heading_ratio)),
        None if bound is None else ("  95 % within", "", "", "", angle(bound)),
        None if body is None else ("  of the body", *_true_cells(body, of_body, evaluation.body_heading_ratio)),
        ("direction", *_true_cells(free, evaluation.claimed_direction_deg, evaluation.direction_ratio)),
        ("  of the body", *_true_cells(with_rotation, None, None)),
    ]
    return table(("error", "rms", "worst", "claimed, rms", "worst", "true / claimed"), filter(None, rows))


def _true_cells(
    true: HeadingError | DirectionError, claimed: HeadingError | DirectionError | None, ratio: float | None
) -> list[str]:
    """An error, its claim, and their ratio; nothing where nothing is claimed."""
    claims = ("", "") if claimed is None else (angle(claimed.rms), angle(claimed.worst))
    return [angle(true.rms), angle(true.worst), *claims, "" if ratio is None else figures(ratio)]


def _true_parameters(evaluation: Evaluation) -> Text:
    offset = _offset_cells(evaluation.offset_error, evaluation.offset_sigma)
    ratio = "" if evaluation.offset_ratio is None else f", {figures(evaluation.offset_ratio)} times what is claimed"
    scale = evaluation.scale_error
    return lines(
        [
            ("offset", offset, label(evaluation.unit)),
            ("", _digits(evaluation.offset_share), f"of the field{ratio}"),
            ("matrix", _digits(evaluation.matrix_error), "rotation and scale removed"),
            ("rotation", *_true_rotation(evaluation.rotation)),
            ("mean", angle(evaluation.heading_mean_deg), "of the heading, subtracted above"),
            ("scale", "not claimed: no field strength was given" if scale is None else _digits(scale), ""),
        ]
    )


def _true_rotation(rotation: RotationDifference) -> tuple[str, str]:
    """How far the rotation into the body is off, and what is claimed of it."""
    if rotation.covariance is None:
        return angle(rotation.angle_deg), "into the body, not claimed: taken off above"
    sigma = rotation.angle_sigma_deg
    return angle(
        rotation.angle_deg
    ), f"into the body, 1 σ {degrees(sigma or 0.0)} claimed ({p_value(rotation.p_value or 0.0)})"


def _evaluation_verdict(evaluation: Evaluation) -> Table:
    is_worse, is_on_target = evaluation.verdict == "worse than claimed", evaluation.is_on_target
    colour = ("limited" if is_worse else "good") if is_on_target else ("refused" if is_worse else "limited")
    reason = f"the errors are {chance_words(evaluation.p_value)}"
    if evaluation.verdict == "unclaimed":
        reason = "the calibration states no uncertainty"
    off = evaluation.body_heading_error_deg or evaluation.heading_error_deg
    worst, side = _up_to(off.worst), "within" if is_on_target else "beyond"
    words = f"headings are off by {worst}, {side} the target of {evaluation.target_deg:g}°; {reason}"
    basis = _square_basis(evaluation.heading_error_deg, evaluation.chi_square, evaluation.freedom)
    return verdict(EVALUATED[evaluation.verdict], colour, words, basis)


def _digits(share: float) -> str:
    """Write a fraction as a percentage to two digits.

    >>> _digits(0.00126), _digits(0.2), _digits(-0.0312), _digits(1e-12), _digits(12.0)
    ('0.13%', '20%', '-3.1%', '0%', '> 1000%')
    """
    if not abs(share) < 10.0:
        return "> 1000%"
    return f"{figures(100 * share)}%" if abs(share) > 1e-9 else "0%"


def recovery_rows(true: TwoAxis, estimate: TwoAxis) -> list[tuple[str, float, float, str]]:
    """Name, true value, estimate and unit of each parameter."""
    return [
        ("scale x", true.scale[0], estimate.scale[0], ""),
        ("scale y", true.scale[1], estimate.scale[1], ""),
        ("offset x", true.offset[0], estimate.offset[0], " µT"),
        ("offset y", true.offset[1], estimate.offset[1], " µT"),
        ("skew", true.skew_deg, estimate.skew_deg, "°"),
        ("noise", true.noise, estimate.noise, " µT"),
    ]


def _heading_cells(errors: Floats, radius: Floats) -> tuple[str, str, str]:
    """Errors, rms and worst, and the range of the radius."""
    rms, worst = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
    return angle(rms), angle(worst), f"{radius.min():.2f} to {radius.max():.2f} µT"


# ------------------------------------------------------------------------------------------------------ many methods


def duration(seconds: float) -> str:
    """Write how long something took, to two digits."""
    return f"{figures(seconds * 1e3)} ms" if seconds < 1.0 else f"{figures(seconds)} s"


def _worth(contest: Contest) -> Table:
    """Rms heading errors of each method: claimed, cross-validated, and from the first."""
    names = ("\nclaimed", "cross-\nvalidated", f"from\n{contest.reference}", "\ntime", "\nverdict")
    headings = [Column("heading error,\nrms", no_wrap=True), *whole_columns(names)]
    return table(headings, [_method_row(entry) for entry in contest.entries])


def _method_row(entry: Entry) -> tuple[RenderableType, ...]:
    return (
        Text(entry.method, "bold" if entry.verdict == "good" else ""),
        _rms(None if entry.fit is None else entry.fit.heading_error_deg),
        _rms(None if entry.validation is None else entry.validation.heading_error_deg),
        _rms(entry.difference_deg),
        duration(entry.seconds),
        Text(entry.verdict, COLOURS[entry.verdict]),
    )


def _rms(error: HeadingError | None) -> str:
    if error is None:
        return "–"
    return degrees(error.rms) if error.rms > ROUNDING_DEG else "0°"


def _basis(contest: Contest) -> Text:
    blocks = f"{contest.blocks} blocks of time, each held back once" if contest.blocks else "too few to hold any back"
    if contest.stride > 1:
        blocks = f"cross-validated on one of {contest.stride}: {blocks}"
    return Text(f"{counted(contest.readings, 'reading')}; {blocks}", "dim")


def _method_numbers(entries: list[Entry]) -> Text:
    """Offsets, and matrices as their diagonal and what is above it, one line for each method."""
    calibrations = [entry.fit.calibration for entry in entries if entry.fit is not None]
    columns = [on_the_point(list(column)) for column in zip(*map(_entries, calibrations), strict=True)]
    rows = [(" ".join(cells[:3]), " ".join(cells[3:])) for cells in zip(*columns, strict=True)]
    width, (offset, matrix) = max(len(entry.method) for entry in entries), rows[0]
    title = f"offset, {label(calibrations[0].unit)}".ljust(len(offset)) + "   "
    text = Text(no_wrap=True, overflow="ignore")
    text.append(f"{'':{width}}  {title}{'matrix: xx yy zz xy xz yz'.ljust(len(matrix))}\n", "dim")
    for entry, row in zip(entries, rows, strict=True):
        text.append(f"{entry.method:{width}}  {'   '.join(row)}\n", "dim" if entry.verdict == "refused" else "")
    text.rstrip()
    return text


def _entries(calibration: Calibration) -> list[str]:
    decimals = max(0, -math.floor(math.log10(FINEST * calibration.field_strength)))
    offset = [f"{round(value, decimals) + 0.0:.{decimals}f}" for value in calibration.offset.tolist()]
    return [*offset, *(f"{value:.4f}" for value in upper(calibration.matrix).tolist())]


def _reasons(contest: Contest) -> list[tuple[str, str]]:
    """Why a method is not to be trusted here: the gravest reason in words, the others by their code; each said once."""
    said: dict[str, list[Entry]] = {}
    for entry in contest.entries:
        if entry.reasons:
            also = f" (also {', '.join(entry.codes[1:])})" if len(entry.codes) > 1 else ""
            said.setdefault(entry.reasons[0].replace(repr(entry.method), "it") + also, []).append(entry)
    return [
        (_SEVERITIES[entries[0].verdict], f"{', '.join(entry.method for entry in entries)}: {reason}")
        for reason, entries in said.items()
    ]


_SEVERITIES: Final[dict[Verdict, Severity]] = {verdict: severity for severity, verdict in VERDICTS.items()}


# ------------------------------------------------------------------------------------------ a fleet over time


def of_drift(drift: FleetDrift) -> RenderableType:
    """Lay out how a fleet changed: states, the units to recalibrate, what was moved, and batches."""
    units = _units(drift) if drift.listed else None
    steps = _steps(drift) if drift.steps else None
    batches = _batches(drift) if drift.batches else None
    return page(_states(drift), units, steps, batches, Group(*_remarks(drift)))


def shown_when(seconds: float, recording: str) -> str:
    """Write the day of a recording; where no date is known, the end of its name."""
    if math.isfinite(seconds) or not recording:
        return when(seconds)
    return recording if len(recording) <= LONGEST else f"…{recording[1 - LONGEST :]}"


def _states(drift: FleetDrift) -> Table:
    rows = [
        styled(STATE_COLOURS.get(name, "dim"), name, f"{drift.states[name]:,}", words)
        for name, words in STATES.items()
        if drift.states[name]
    ]
    return table((Column("units", no_wrap=True), "", Column("")), rows, is_dense=True)


def _units(drift: FleetDrift) -> Table:
    names = (Column("worst first", no_wrap=True), Column("state", no_wrap=True))
    rows = [
        (one.unit, one.state, *map(_known_angle, (one.worst_deg, one.sigma_deg, one.offset_deg, one.matrix_deg)),
         shown_when(one.reference_s, one.reference), shown_when(one.newest_s, one.newest))
        for one in drift.listed[:SHOWN]
    ]  # fmt: skip
    count = drift.states["recalibrate"] + drift.states["unsure"] if len(drift.listed) > SHOWN else 0
    headings = (*names, "heading", "1 σ", "offset", "matrix", drift.against, "newest")
    return table(headings, [*rows, *_more(count)], is_dense=True)


def _known_angle(angle_deg: float) -> str:
    """An angle of a table; nothing where it is not known."""
    return "" if math.isnan(angle_deg) else degrees(angle_deg)


def _steps(drift: FleetDrift) -> Table:
    unit = common_unit(drift.steps)
    by = f"offset by, {unit}" if unit else "offset by"
    headings = (Column("moved", no_wrap=True), "heading", by, "chance", "after", "before")
    rows = [
        (one.unit, degrees(one.worst_deg),
         f"{figures(math.hypot(*one.offset_change))} {label(one.unit_of_field)}".removesuffix(f" {unit}"),
         chance(one.p_value), shown_when(one.before_s, one.before), shown_when(one.after_s, one.after))
        for one in drift.steps[:SHOWN]
    ]  # fmt: skip
    return table(headings, [*rows, *_more(drift.step_count)], is_dense=True)


def _batches(drift: FleetDrift) -> Table:
    headings = (Column("batch", no_wrap=True), "units", "recalibrate", "changed", "steps", "not good")
    rows = [_batch_row(one) for one in _shown_batches(drift.batches, SHOWN)]
    return table((*headings, Column("stands out by")), [*rows, *_more(len(drift.batches))], is_dense=True)


def _batch_row(one: BatchDrift) -> list[Text]:
    counts = (one.units, one.states.get("recalibrate", 0), one.states.get("changed", 0), one.step_units)
    cells = (*(f"{count:,}" for count in counts), percent(*one.not_good), ", ".join(one.stands_out))
    return styled("yellow" if one.stands_out else "", one.batch or "not known", *cells)


def _more(count: int) -> list[tuple[str]]:
    """A row that says how many are not shown, if there are any."""
    return [(f"and {count - SHOWN:,} more",)] if count > SHOWN else []


def _shown_batches(batches: Sequence[BatchDrift], most: int) -> list[BatchDrift]:
    """Take so many by name: those that stand out, and of the others those with the largest share that changed."""
    worst = sorted(batches, key=lambda one: (not one.stands_out, -one.changed / max(one.units, 1), one.batch))[:most]
    return sorted(worst, key=lambda one: one.batch)


def _remarks(drift: FleetDrift) -> list[str]:
    """What else there is to know, a line each."""
    against = "its first" if drift.against == "first" else "the one before"
    what = f"{counted(drift.calibrations, 'calibration')} of {counted(drift.units, 'unit')}"
    remarks = [f"{what}; the newest of each against {against}, level vehicle, dip {abs(drift.dip_deg):.3g}°"]
    remarks += about_order(drift)
    if drift.variance_factor > 1.05:
        remarks.append(
            f"recordings scatter {figures(drift.variance_factor**0.5)} times as far as they claim: allowed for"
        )
    if drift.random_walk_deg_per_root_year > 0.005:
        remarks.append(
            f"slow drift of this fleet: {degrees(drift.random_walk_deg_per_root_year)} of heading over a year (1 σ)"
        )
    undated = drift.undated
    if undated.units and undated.variance_factor > 1.05:
        times = figures(undated.variance_factor**0.5)
        remarks.append(f"recordings without dates scatter {times} times as far as they claim: allowed for")
    if undated.units and undated.random_walk_deg_per_root_recording > 0.005:
        by = f"{degrees(undated.random_walk_deg_per_root_recording)} of heading from one recording to the next (1 σ)"
        remarks.append(f"slow drift where no dates are known: {by}")
    if drift.without_calibration:
        rows = counted(drift.without_calibration, "row")
        remarks.append(f"{rows} left out: refused, failed, or in another unit than the others")
    if drift.batches:
        remarks.append(f"the batch is told by {drift.batch_source}")
    share = f"{drift.false_alarm_probability:.0%} of fleets of this size in which nothing changed"
    return [*remarks, f"chance alone lists a unit, or a step, in {share}"]


# ------------------------------------------------------------------------------------------ what to choose from


def of_methods(methods: Mapping[str, Method], options: Mapping[str, Mapping[str, tuple[str, ...]]]) -> RenderableType:
    """Lay out the methods: how many parameters each finds, how many readings it needs, and its options with values."""
    headings = (Column("method", style="bold"), "parameters\nfound", "readings,\nat least", Column("when to use it"))
    rows = []
    for name, row in methods.items():
        use = [row.use, *(f"option {option}: {', '.join(values)}" for option, values in options[name].items())]
        rows.append((name, str(row.parameters), str(row.kind.unknowns), "\n".join(use)))
    return table(headings, rows)


def of_targets(targets: Collection[Target]) -> RenderableType:
    """Lay out the targets, and below them what nobody could verify of those with a star."""
    headings = [Column("target", style="bold"), *map(Column, ("what is written", "holds", "unit", "import"))]
    rows = [
        (
            f"{row.name}{' *' if row.unverified else ''}",
            row.use,
            row.keeps,
            "any" if row.unit in ("own", "recorded") else row.unit,
            "yes" if row.reader else "",
        )
        for row in targets
    ]
    names: dict[str, list[str]] = {}
    for row in targets:
        for clause in row.unverified:
            names.setdefault(clause, []).append(row.name)
    unverified = [f"* not verified of {', '.join(named)}: {clause}" for clause, named in names.items()]
    filled = [Text(textwrap.fill(line, WIDTH, subsequent_indent="  "), no_wrap=True) for line in unverified]
    return Group(table(headings, rows), *filled)
