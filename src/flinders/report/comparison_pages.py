"""Comparisons as pages for the terminal: calibrations, the truth, and lists of options.

>>> chance_words(0.43), chance_words(1e-9)
('no more than chance explains (p = 0.43)', 'more than chance explains (p < 0.0001)')
"""

from __future__ import annotations

import math
import textwrap
from itertools import groupby
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.comparison.comparison import MAX_P_VALUE
from flinders.core.units import unit_label
from flinders.errors import count_text, figures, python_arguments
from flinders.findings import advice
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.report.formatting import (
    angle,
    degrees,
    p_value,
    shown_findings,
    with_uncertainty,
    without_repeated_steps,
)
from flinders.report.terminal import lines, notes, page, style_cells, table, verdict

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.comparison.comparison import Comparison, LengthSums
    from flinders.comparison.evaluation import Evaluation
    from flinders.comparison.rotation_difference import RotationDifference
    from flinders.errors import Spelling
    from flinders.estimators import Method
    from flinders.fitting.result import Fit
    from flinders.heading.error_propagation import DirectionError, HeadingError
    from flinders.targets import Target

TITLES: Final = {
    "holds": ("AGREE", "HOLDS"), "fails": ("CONTRADICT", "FAILS"), "cannot-tell": ("CANNOT TELL", "CANNOT TELL"),
}  # fmt: skip
"""Titles of a comparison of two calibrations, and of a check on another recording."""

UNCHECKED_WORDS: Final = (
    "a calibration always fits its own readings, even if the sensor has changed: this proves nothing"
)

TURNED_WORDS: Final = (
    "their rotations into the body differ by more than chance explains: the sensor, or an aiding instrument, was "
    "rotated in its mounting"
)

EVALUATION_TITLES: Final = {
    "as claimed": "AS CLAIMED",
    "worse than claimed": "WORSE THAN CLAIMED",
    "unclaimed": "NO CLAIM",
}


WIDTH: Final = 78


def page_of_comparison(
    comparison: Comparison,
    spell: Spelling = python_arguments,
    *,
    fresh: Fit | None = None,
    strengths: tuple[LengthSums, LengthSums] | None = None,
    own: Sequence[str] = (),
    name: str = "the calibration",
) -> RenderableType:
    """Lay out two calibrations side by side: their difference, whether chance explains it, and the verdict.

    In a check on a recording, `fresh` is the fit of that recording, whose limits are listed below, and `strengths` are
    the lengths of its readings after both calibrations. `name` is the name of the first calibration. `own` names
    recordings of the calibration itself: agreement with these proves nothing.
    """
    found = (
        () if fresh is None else without_repeated_steps(each for each in fresh.findings if each.severity == "limits")
    )
    limits = [advice(finding, spell) for finding in found]
    is_unchecked = bool(own) and comparison.answer == "holds"
    said = _comparison_verdict(comparison, fresh, limits, is_unchecked=is_unchecked)
    if own:
        limits.insert(0, f"{' and '.join(own)} went into this calibration: check it on a recording made since")
    if comparison.is_turned:
        limits.insert(0, TURNED_WORDS)
    blocks = (
        _differences(comparison),
        _parameters(comparison),
        None if strengths is None else _strengths(name, *strengths),
    )
    return Group(page(*blocks, said), notes(("limits", limit) for limit in limits))


def page_of_partial_check(
    known: Fit, fit: Fit, strength: LengthSums, spell: Spelling = python_arguments
) -> RenderableType:
    """Lay out what a recording without a usable fit says about a known calibration, and why there is no fit."""
    basis = f"{count_text(fit.evidence.samples, 'reading')}; {fit.evidence.method}"
    made = known.evidence.noise / known.calibration.ellipsoid.radius
    when_made = "" if math.isnan(made) else f" ({made:.1%} where {known.provenance.name} was made)"
    words = (
        f"whether {known.provenance.name} holds: this recording gives no fit that can be used, for the reasons below. "
        f"Corrected by {known.provenance.name}, the strength of its readings is {strength.mean:.3f} of the field, with "
        f"a spread of {strength.spread:.1%}{when_made}"
    )
    reasons = ((finding.severity, advice(finding, spell)) for finding in shown_findings(fit))
    return Group(page(verdict(TITLES["cannot-tell"][1], "limited", words, basis)), notes(reasons))


def page_of_evaluation(evaluation: Evaluation) -> RenderableType:
    """Lay out a calibration and the truth: true errors, claimed errors, their ratio, and the verdict."""
    return page(_true_errors(evaluation), _true_parameters(evaluation), _evaluation_verdict(evaluation))


# --------------------------------------------------------------------------------------------------- two calibrations


def chance_words(value: float | None) -> str:
    """Words for whether chance explains a difference, by its p-value."""
    if value is None:
        return "no uncertainty is stated, so chance cannot be assessed"
    return f"{'no more' if value >= MAX_P_VALUE else 'more'} than chance explains ({p_value(value)})"


def _differences(comparison: Comparison) -> Table:
    heading, claimed = comparison.heading_difference_deg, comparison.claimed_deg
    mean = f"{round(comparison.heading_mean_deg, 2) + 0.0:.2f}°"
    rows: list[Sequence[RenderableType]] = [
        style_cells("bold", "heading", angle(heading.rms), angle(heading.worst), mean)
    ]
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
    """Offset along x, y and z, with its uncertainty if that is known."""
    sigmas = np.zeros(3) if sigma is None else sigma
    return "   ".join(with_uncertainty(*pair) for pair in zip(offset + 0.0, sigmas, strict=True))


def _parameters(comparison: Comparison) -> Text:
    offset = _offset_cells(comparison.offset_difference, comparison.offset_sigma)
    unit = f"{unit_label(comparison.unit)}, {_percent(comparison.offset_share)} of the field"
    scale = "" if comparison.is_scale_known else "of sensor and field together"
    return lines([("offset", offset, unit), ("scale", _percent(comparison.scale_difference), scale)])


def _strengths(name: str, known: LengthSums, fresh: LengthSums) -> Table:
    pairs = ((name, known), ("a fresh fit", fresh))
    rows = [(name, figures(one.mean, 4), _percent(one.spread)) for name, one in pairs]
    return table(("corrected with", "strength", "spread"), rows)


def _comparison_verdict(
    comparison: Comparison, fresh: Fit | None, limits: Sequence[str], *, is_unchecked: bool
) -> Table:
    """The answer, and the numbers that it is based on."""
    basis = _square_basis(comparison.heading_difference_deg, comparison.chi_square, comparison.freedom)
    if comparison.omitted_rotation_deg is not None:
        omitted = degrees(comparison.omitted_rotation_deg)
        basis += f"; the rotation into the body of {omitted}, known to one alone, is left out"
    if fresh is not None:
        covered = f"{fresh.evidence.coverage.fraction:.0%} of the sphere covered"
        basis += f"; {count_text(fresh.evidence.samples, 'reading')}, {covered}"
    answer = "cannot-tell" if is_unchecked else comparison.answer
    is_firm = not limits and not comparison.is_turned
    colour = {"holds": "good" if is_firm else "limited", "fails": "refused", "cannot-tell": "limited"}[answer]
    words = UNCHECKED_WORDS if is_unchecked else _words(comparison, fresh, is_limited=bool(limits))
    return verdict(TITLES[answer][fresh is not None], colour, words, basis)


def _square_basis(error: HeadingError, square: float | None, freedom: int) -> str:
    """Dip for which a heading error holds, and chi-square if there is one."""
    level = f"level vehicle, dip {error.dip_deg:.3g}°"
    if square is None:
        return level
    size = f"= {round(square, 6):.3g}" if square < 1000.0 else "> 1000"
    return f"{level}; χ² {size} for {freedom} degrees of freedom"


def _words(comparison: Comparison, fresh: Fit | None, *, is_limited: bool) -> str:
    """The answer in words: difference, bound, target and chance; then the remedy."""
    target = f"target of {comparison.target_deg:g}°"
    if comparison.is_identical:
        return "the same calibration twice"
    if comparison.is_turned_beyond_target:
        return f"headings of the body differ by more than the {target}:"
    explained, worst_deg = chance_words(comparison.p_value), comparison.worst_deg
    if comparison.answer == "fails":
        return (
            f"headings are {up_to(worst_deg)} apart, more than the {target} and {explained}: the sensor or its "
            "surroundings have changed, calibrate again"
        )
    is_changed = comparison.p_value is not None and comparison.p_value < MAX_P_VALUE
    if comparison.answer == "holds":
        changed = ": good enough for that, and a new calibration will be better" if is_changed else ""
        limits = ", with these limits of the recording:" if is_limited else ""
        bound = "" if comparison.claimed_bound_deg is None else f", with 95 % within {angle(comparison.largest_deg)}"
        within = f"headings within {angle(worst_deg)}{bound}"
        return f"{within} (target {comparison.target_deg:g}°), {explained}{changed}{limits}"
    changed = ": a new calibration will be better" if is_changed else ""
    error = at_most(comparison.claimed_bound_deg or 0.0)
    apart = f"headings are {up_to(worst_deg)} apart, give or take {error} (95 %)"
    remedy = _remedy(comparison, is_checked=fresh is not None, is_limited=is_limited)
    return f"{apart}, which may be within or beyond the {target}; {explained}{changed}. {remedy}"


def _remedy(comparison: Comparison, *, is_checked: bool, is_limited: bool) -> str:
    """Remedy for claims that are too wide for an answer."""
    claim = at_most(max(comparison.own_bounds_deg or (0.0,)))
    if not is_checked:
        whose, what = f"that of {(comparison.wider_claim or '').upper()}", "calibrate again, from a longer recording"
    elif comparison.wider_claim == "a":
        whose, what = "the calibration's", "calibrate again, from a longer recording"
    else:
        whose, what = "the recording's", "resolve its first limit:" if is_limited else "record for longer"
    needed = angle(comparison.telling_bound_deg or 0.0)
    return f"Claims of {needed} together would suffice; the wider one is {whose} with {claim}: {what}"


def at_most(angle_deg: float) -> str:
    """Write the upper limit of an angle.

    >>> at_most(0.66), at_most(170.0)
    ('0.66°', 'any angle')
    """
    return angle(angle_deg) if angle_deg < ANY_ANGLE_DEG else "any angle"


def up_to(angle_deg: float) -> str:
    """Write the largest of several angles; more than 90° is written as any angle.

    >>> up_to(0.31), up_to(170.0)
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
        style_cells("bold", "level heading", *_true_cells(heading, claimed, evaluation.heading_ratio)),
        None if bound is None else ("  95 % within", "", "", "", angle(bound)),
        None if body is None else ("  of the body", *_true_cells(body, of_body, evaluation.body_heading_ratio)),
        ("direction", *_true_cells(free, evaluation.claimed_direction_deg, evaluation.direction_ratio)),
        ("  of the body", *_true_cells(with_rotation, None, None)),
    ]
    return table(("error", "rms", "worst", "claimed, rms", "worst", "true / claimed"), filter(None, rows))


def _true_cells(
    true: HeadingError | DirectionError, claimed: HeadingError | DirectionError | None, ratio: float | None
) -> list[str]:
    """Cells for an error, its claim, and their ratio; without a claim empty ones."""
    claims = ("", "") if claimed is None else (angle(claimed.rms), angle(claimed.worst))
    return [angle(true.rms), angle(true.worst), *claims, "" if ratio is None else figures(ratio)]


def _true_parameters(evaluation: Evaluation) -> Text:
    offset = _offset_cells(evaluation.offset_error, evaluation.offset_sigma)
    ratio = "" if evaluation.offset_ratio is None else f", {figures(evaluation.offset_ratio)} times the stated one"
    scale = evaluation.scale_error
    return lines(
        [
            ("offset", offset, unit_label(evaluation.unit)),
            ("", _digits(evaluation.offset_share), f"of the field{ratio}"),
            ("matrix", _digits(evaluation.matrix_error), "rotation and scale removed"),
            ("rotation", *_true_rotation(evaluation.rotation)),
            ("mean", angle(evaluation.heading_mean_deg), "of the heading, subtracted above"),
            ("scale", "not claimed: no field strength was given" if scale is None else _digits(scale), ""),
        ]
    )


def _true_rotation(rotation: RotationDifference) -> tuple[str, str]:
    """Error of the rotation into the body, and its claim."""
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
    worst, side = up_to(off.worst), "within" if is_on_target else "beyond"
    words = f"headings are off by {worst}, {side} the target of {evaluation.target_deg:g}°; {reason}"
    basis = _square_basis(evaluation.heading_error_deg, evaluation.chi_square, evaluation.freedom)
    return verdict(EVALUATION_TITLES[evaluation.verdict], colour, words, basis)


def _digits(share: float) -> str:
    """Write a fraction as a percentage with two digits.

    >>> _digits(0.00126), _digits(0.2), _digits(-0.0312), _digits(1e-12), _digits(12.0)
    ('0.13%', '20%', '-3.1%', '0%', '> 1000%')
    """
    if not abs(share) < 10.0:
        return "> 1000%"
    return f"{figures(100 * share)}%" if abs(share) > 1e-9 else "0%"


# ---------------------------------------------------------------------------------------------- methods and targets


def page_of_methods(
    methods: Mapping[str, Method], options: Mapping[str, Mapping[str, tuple[str, ...]]]
) -> RenderableType:
    """Lay out the methods: parameters, smallest number of readings, and options with their values."""
    headings = (Column("method", style="bold"), "parameters\nfound", "readings,\nat least", Column("when to use it"))
    rows = []
    for name, row in methods.items():
        use = [row.use, *(f"option {option}: {', '.join(values)}" for option, values in options[name].items())]
        rows.append((name, str(row.parameters), str(row.kind.unknowns), "\n".join(use)))
    return table(headings, rows)


def page_of_targets(targets: Collection[Target]) -> RenderableType:
    """Lay out the targets by group, and below them the properties that no source confirms, each marked with a star."""
    headings = [
        Column("target", no_wrap=True),
        Column("written form", overflow="fold"),
        *map(Column, ("holds", "unit", "import")),
    ]
    rows: list[tuple[RenderableType, ...]] = []
    for group, members in groupby(targets, key=lambda row: row.group):
        rows += [(Text(group, "bold"), "", "", "", ""), *map(_cells_of_target, members)]
    names: dict[str, list[str]] = {}
    for row in targets:
        for clause in row.unverified:
            names.setdefault(clause, []).append(row.name)
    unverified = [f"* not verified of {', '.join(named)}: {clause}" for clause, named in names.items()]
    filled = [Text(textwrap.fill(line, WIDTH, subsequent_indent="  "), no_wrap=True) for line in unverified]
    return Group(table(headings, rows, is_dense=True), *filled)


def _cells_of_target(row: Target) -> tuple[str, ...]:
    """Cells of a target in the table, indented below the heading of its group."""
    star, unit = " *" if row.unverified else "", "any" if row.unit in ("own", "recorded") else row.unit
    return f"  {row.name}{star}", row.use, row.keeps, unit, "yes" if row.reader else ""
