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
from flinders.core.language import numeral, phrase
from flinders.core.units import unit_label
from flinders.errors import figures, python_arguments
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.report.formatting import shown_findings, with_uncertainty, without_repeated_steps
from flinders.report.phrases import advice_of, angle, count, degrees, join_parts, p_value, plain_number, share
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
    from flinders.native.faults import Answer
    from flinders.targets import Target

TITLES: Final = {
    "holds": ("AGREE", "HOLDS"), "fails": ("CONTRADICT", "FAILS"), "cannot-tell": ("CANNOT TELL", "CANNOT TELL"),
}  # fmt: skip
"""Titles of a comparison of two calibrations, and of a check on another recording."""

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
    limits = [advice_of(finding, spell) for finding in found]
    is_unchecked = bool(own) and comparison.answer == "holds"
    said = _comparison_verdict(comparison, fresh, limits, is_unchecked=is_unchecked)
    if own:
        limits.insert(0, _own_words(own))
    if comparison.is_turned:
        limits.insert(0, _turned_words())
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
    basis = join_parts(count(fit.evidence.samples, "reading"), fit.evidence.method)
    made, name = known.evidence.noise / known.calibration.ellipsoid.radius, known.provenance.name
    words = phrase(
        "check.partial",
        "whether {name} holds: this recording gives no fit that can be used, for the reasons below. Corrected by "
        "{name}, the strength of its readings is {mean} of the field, with a spread of {spread}{made}",
        name=name,
        mean=plain_number(strength.mean, ".3f"),
        spread=share(strength.spread, 1),
        made=""
        if math.isnan(made)
        else phrase("check.made", " ({spread} where {name} was made)", spread=share(made, 1), name=name),
    )
    reasons = ((finding.severity, advice_of(finding, spell)) for finding in shown_findings(fit))
    return Group(page(verdict(_title("cannot-tell", is_check=True), "limited", words, basis)), notes(reasons))


def page_of_evaluation(evaluation: Evaluation) -> RenderableType:
    """Lay out a calibration and the truth: true errors, claimed errors, their ratio, and the verdict."""
    return page(_true_errors(evaluation), _true_parameters(evaluation), _evaluation_verdict(evaluation))


# --------------------------------------------------------------------------------------------------- two calibrations


def chance_words(value: float | None) -> str:
    """Words for whether chance explains a difference, by its p-value."""
    if value is None:
        return phrase("chance.unknown", "no uncertainty is stated, so chance cannot be assessed")
    if value >= MAX_P_VALUE:
        return phrase("chance.no-more", "no more than chance explains ({p})", p=p_value(value))
    return phrase("chance.more", "more than chance explains ({p})", p=p_value(value))


def _title(answer: Answer, *, is_check: bool) -> str:
    """Title for two calibrations, or for one on another recording."""
    kind = "check" if is_check else "calibrations"
    return phrase(f"answer.{kind}.{answer}", TITLES[answer][is_check])


def _own_words(own: Collection[str]) -> str:
    """Limit of a check on the recordings that a calibration was made from."""
    return phrase(
        "check.own", "{names} went into this calibration: check it on a recording made since",
        names=f" {phrase('list.and', 'and')} ".join(own),
    )  # fmt: skip


def _unchecked_words() -> str:
    """Verdict of a check of a calibration with the readings that it was fitted to."""
    return phrase(
        "check.unchecked",
        "a calibration always fits its own readings, even if the sensor has changed: this proves nothing",
    )


def _turned_words() -> str:
    """Limit of a comparison of calibrations whose rotations into the body differ."""
    return phrase(
        "compare.turned",
        "their rotations into the body differ by more than chance explains: the sensor, or an aiding instrument, was "
        "rotated in its mounting",
    )


def _differences(comparison: Comparison) -> Table:
    heading, claimed = comparison.heading_difference_deg, comparison.claimed_deg
    mean = f"{plain_number(round(comparison.heading_mean_deg, 2) + 0.0, '.2f')}°"
    claims = f"  {phrase('compare.claimed', 'claimed, 1 σ')}"
    name = phrase("compare.heading", "heading")
    rows: list[Sequence[RenderableType]] = [style_cells("bold", name, angle(heading.rms), angle(heading.worst), mean)]
    if claimed is not None:
        rows.append((claims, degrees(claimed.rms), degrees(claimed.worst)))
        rows.append((f"  {phrase('errors.bound', '95 % within')}", "", degrees(comparison.claimed_bound_deg or 0.0)))
    rows.append((phrase("compare.direction", "direction"), angle(comparison.direction_difference_deg)))
    if comparison.rotation is not None:
        name = phrase("compare.rotation", "rotation in the body")
        rows.append((name, angle(comparison.rotation.angle_deg)))
        if comparison.rotation.angle_sigma_deg is not None:
            rows.append((claims, degrees(comparison.rotation.angle_sigma_deg)))
    headings = (
        phrase("compare.difference", "difference"),
        phrase("compare.rms", "rms"),
        phrase("errors.worst", "worst"),
        phrase("compare.mean", "mean"),
    )
    return table(headings, rows)


def _offset_cells(offset: Floats, sigma: Floats | None) -> str:
    """Offset along x, y and z, with its uncertainty if that is known."""
    sigmas = np.zeros(3) if sigma is None else sigma
    return numeral("   ".join(with_uncertainty(*pair) for pair in zip(offset + 0.0, sigmas, strict=True)))


def _parameters(comparison: Comparison) -> Text:
    offset = _offset_cells(comparison.offset_difference, comparison.offset_sigma)
    of_field = phrase("numbers.of-field", "of the field")
    unit = f"{unit_label(comparison.unit)}, {_percent(comparison.offset_share)} {of_field}"
    scale = "" if comparison.is_scale_known else phrase("compare.scale-of-both", "of sensor and field together")
    names = phrase("numbers.offset", "offset"), phrase("compare.scale", "scale")
    return lines([(names[0], offset, unit), (names[1], _percent(comparison.scale_difference), scale)])


def _strengths(name: str, known: LengthSums, fresh: LengthSums) -> Table:
    pairs = ((name, known), (phrase("check.fresh", "a fresh fit"), fresh))
    rows = [(name, numeral(figures(one.mean, 4)), _percent(one.spread)) for name, one in pairs]
    headings = (
        phrase("check.corrected-with", "corrected with"),
        phrase("errors.strength", "strength"),
        phrase("errors.spread", "spread"),
    )
    return table(headings, rows)


def _comparison_verdict(
    comparison: Comparison, fresh: Fit | None, limits: Sequence[str], *, is_unchecked: bool
) -> Table:
    """The answer, and the numbers that it is based on."""
    basis = _square_basis(comparison.heading_difference_deg, comparison.chi_square, comparison.freedom)
    if comparison.omitted_rotation_deg is not None:
        omitted = phrase(
            "compare.omitted", "the rotation into the body of {angle}, known to one alone, is left out",
            angle=degrees(comparison.omitted_rotation_deg),
        )  # fmt: skip
        basis = join_parts(basis, omitted)
    if fresh is not None:
        basis = join_parts(basis, f"{count(fresh.evidence.samples, 'reading')}{covered_words(fresh)}")
    answer = "cannot-tell" if is_unchecked else comparison.answer
    is_firm = not limits and not comparison.is_turned
    colour = {"holds": "good" if is_firm else "limited", "fails": "refused", "cannot-tell": "limited"}[answer]
    words = _unchecked_words() if is_unchecked else _words(comparison, fresh, is_limited=bool(limits))
    return verdict(_title(answer, is_check=fresh is not None), colour, words, basis)


def covered_words(fit: Fit) -> str:
    """Share of the sphere that the readings of a fit cover, after a comma."""
    return phrase("basis.covered", ", {share:.0%} of the sphere covered", share=fit.evidence.coverage.fraction)


def _square_basis(error: HeadingError, square: float | None, freedom: int) -> str:
    """Dip for which a heading error holds, and chi-square if there is one."""
    level = phrase("compare.level", "level vehicle, dip {dip}°", dip=plain_number(error.dip_deg, ".3g"))
    if square is None:
        return level
    size = f"= {plain_number(round(square, 6), '.3g')}" if square < 1000.0 else "> 1000"
    words = phrase("compare.freedom", "χ² {size} for {freedom} degrees of freedom", size=size, freedom=str(freedom))
    return join_parts(level, words)


def _words(comparison: Comparison, fresh: Fit | None, *, is_limited: bool) -> str:
    """The answer in words: difference, bound, target and chance; then the remedy."""
    target = f"{plain_number(comparison.target_deg)}°"
    if comparison.is_identical or (comparison.is_same_ellipsoid and comparison.omitted_rotation_deg is not None):
        return _same_words(comparison, target)
    if comparison.is_turned_beyond_target:
        return phrase(
            "compare.turned-beyond", "headings of the body differ by more than the target of {target}:", target=target
        )
    chance, apart = chance_words(comparison.p_value), up_to(comparison.worst_deg)
    if comparison.answer == "fails":
        return phrase(
            "compare.fails",
            "headings are {worst} apart, more than the target of {target} and {chance}: the sensor or its "
            "surroundings have changed, calibrate again",
            worst=apart, target=target, chance=chance,
        )  # fmt: skip
    is_changed = comparison.p_value is not None and comparison.p_value < MAX_P_VALUE
    if comparison.answer == "holds":
        return _holds_words(comparison, target, chance, is_changed=is_changed, is_limited=is_limited)
    return phrase(
        "compare.cannot-tell",
        "headings are {worst} apart, give or take {bound} (95 %), which may be within or beyond the target of "
        "{target}; {chance}{more}. {remedy}",
        worst=apart, bound=at_most(comparison.claimed_bound_deg or 0.0), target=target, chance=chance,
        more=phrase("compare.renewal-better", ": a new calibration will be better") if is_changed else "",
        remedy=_remedy(comparison, is_checked=fresh is not None, is_limited=is_limited),
    )  # fmt: skip


def _same_words(comparison: Comparison, target: str) -> str:
    """The words for two calibrations that correct alike; only one of both may have a rotation into the body."""
    same = phrase("compare.same", "the same calibration twice")
    if comparison.omitted_rotation_deg is not None:
        same = phrase(
            "compare.same-ellipsoid",
            "offset and soft iron are the same in both; only one has a rotation into the body",
        )
    if comparison.answer != "cannot-tell":
        return same
    return phrase(
        "compare.same-uncertain",
        "{same}. The heading uncertainty of both together is {bound} (95 %), more than the target of {target}",
        same=same, bound=at_most(comparison.claimed_bound_deg or 0.0), target=target,
    )  # fmt: skip


def _holds_words(comparison: Comparison, target: str, chance: str, *, is_changed: bool, is_limited: bool) -> str:
    """The words for a difference within the target."""
    changed = phrase("compare.good-enough", ": good enough for that, and a new calibration will be better")
    limits = phrase("compare.with-limits", ", with these limits of the recording:")
    bound = phrase("compare.bound", ", with 95 % within {bound}", bound=angle(comparison.largest_deg))
    return phrase(
        "compare.holds", "headings within {worst}{bound} (target {target}), {chance}{changed}{limits}",
        worst=angle(comparison.worst_deg), bound="" if comparison.claimed_bound_deg is None else bound,
        target=target, chance=chance, changed=changed if is_changed else "", limits=limits if is_limited else "",
    )  # fmt: skip


def _remedy(comparison: Comparison, *, is_checked: bool, is_limited: bool) -> str:
    """Remedy for claims that are too wide for an answer."""
    again = phrase("compare.again", "calibrate again, from a longer recording")
    if not is_checked:
        name = (comparison.wider_claim or "").upper()
        whose, what = phrase("compare.claim-of", "that of {name}", name=name), again
    elif comparison.wider_claim == "a":
        whose, what = phrase("compare.claim-of-calibration", "the calibration's"), again
    else:
        whose, what = phrase("compare.claim-of-recording", "the recording's"), _recording_remedy(is_limited)
    return phrase(
        "compare.remedy",
        "Claims of {needed} together would suffice; the wider one is {whose} with {claim}: {what}",
        needed=angle(comparison.telling_bound_deg or 0.0), whose=whose,
        claim=at_most(max(comparison.own_bounds_deg or (0.0,))), what=what,
    )  # fmt: skip


def _recording_remedy(is_limited: bool) -> str:
    """Remedy if the claim of the recording is too wide."""
    if is_limited:
        return phrase("compare.resolve", "resolve its first limit:")
    return phrase("compare.longer", "record for longer")


def at_most(angle_deg: float) -> str:
    """Write the upper limit of an angle.

    >>> at_most(0.66), at_most(170.0)
    ('0.66°', 'any angle')
    """
    return angle(angle_deg) if angle_deg < ANY_ANGLE_DEG else phrase("error.any-angle", "any angle")


def up_to(angle_deg: float) -> str:
    """Write the largest of several angles; more than 90° is written as any angle.

    >>> up_to(0.31), up_to(170.0)
    ('up to 0.31°', 'any angle')
    """
    if angle_deg < ANY_ANGLE_DEG:
        return phrase("compare.up-to", "up to {angle}", angle=angle(angle_deg))
    return phrase("error.any-angle", "any angle")


def _percent(value: float) -> str:
    """Format a fraction as a percentage.

    >>> _percent(0.00126), _percent(-0.00001), _percent(0.2), _percent(float("inf"))
    ('0.13%', '0.00%', '20%', '> 1000%')
    """
    if not abs(value) < 10.0:
        return "> 1000%"
    decimals = 2 if abs(value) < 0.1 else 0
    return share(round(value, decimals + 2) + 0.0, decimals)


# ---------------------------------------------------------------------------------------------------- with the truth


def _true_errors(evaluation: Evaluation) -> Table:
    """True and claimed errors, and their ratio."""
    heading, claimed = evaluation.heading_error_deg, evaluation.claimed_heading_deg
    bound = evaluation.claimed_bound_deg
    body, of_body = evaluation.body_heading_error_deg, evaluation.claimed_body_heading_deg
    free, with_rotation = evaluation.unrotated_direction_error_deg, evaluation.direction_error_deg
    level, of_the_body = phrase("truth.level", "level heading"), f"  {phrase('truth.body', 'of the body')}"
    within = f"  {phrase('errors.bound', '95 % within')}"
    rows = [
        style_cells("bold", level, *_true_cells(heading, claimed, evaluation.heading_ratio)),
        None if bound is None else (within, "", "", "", angle(bound)),
        None if body is None else (of_the_body, *_true_cells(body, of_body, evaluation.body_heading_ratio)),
        (
            phrase("compare.direction", "direction"),
            *_true_cells(free, evaluation.claimed_direction_deg, evaluation.direction_ratio),
        ),
        (of_the_body, *_true_cells(with_rotation, None, None)),
    ]
    worst = phrase("errors.worst", "worst")
    headings = (
        phrase("truth.error", "error"),
        phrase("compare.rms", "rms"),
        worst,
        phrase("truth.claimed", "claimed, rms"),
        worst,
        phrase("truth.ratio", "true / claimed"),
    )
    return table(headings, filter(None, rows))


def _true_cells(
    true: HeadingError | DirectionError, claimed: HeadingError | DirectionError | None, ratio: float | None
) -> list[str]:
    """Cells for an error, its claim, and their ratio; without a claim empty ones."""
    claims = ("", "") if claimed is None else (angle(claimed.rms), angle(claimed.worst))
    return [angle(true.rms), angle(true.worst), *claims, "" if ratio is None else numeral(figures(ratio))]


def _true_parameters(evaluation: Evaluation) -> Text:
    offset = _offset_cells(evaluation.offset_error, evaluation.offset_sigma)
    ratio, scale = "", evaluation.scale_error
    if evaluation.offset_ratio is not None:
        times = numeral(figures(evaluation.offset_ratio))
        ratio = phrase("truth.times-stated", ", {ratio} times the stated one", ratio=times)
    unclaimed = phrase("truth.no-scale", "not claimed: no field strength was given")
    return lines(
        [
            (phrase("numbers.offset", "offset"), offset, unit_label(evaluation.unit)),
            ("", _digits(evaluation.offset_share), f"{phrase('numbers.of-field', 'of the field')}{ratio}"),
            (
                phrase("table.matrix", "matrix"),
                _digits(evaluation.matrix_error),
                phrase("truth.matrix", "rotation and scale removed"),
            ),
            (phrase("truth.rotation", "rotation"), *_true_rotation(evaluation.rotation)),
            (
                phrase("compare.mean", "mean"),
                angle(evaluation.heading_mean_deg),
                phrase("truth.mean", "of the heading, subtracted above"),
            ),
            (phrase("compare.scale", "scale"), unclaimed if scale is None else _digits(scale), ""),
        ]
    )


def _true_rotation(rotation: RotationDifference) -> tuple[str, str]:
    """Error of the rotation into the body, and its claim."""
    if rotation.covariance is None:
        return angle(rotation.angle_deg), phrase(
            "truth.rotation-unclaimed", "into the body, not claimed: taken off above"
        )
    return angle(rotation.angle_deg), phrase(
        "truth.rotation-claimed", "into the body, 1 σ {sigma} claimed ({p})",
        sigma=degrees(rotation.angle_sigma_deg or 0.0), p=p_value(rotation.p_value or 0.0),
    )  # fmt: skip


def _evaluation_verdict(evaluation: Evaluation) -> Table:
    is_worse, is_on_target = evaluation.verdict == "worse than claimed", evaluation.is_on_target
    colour = ("limited" if is_worse else "good") if is_on_target else ("refused" if is_worse else "limited")
    reason = phrase("truth.errors-are", "the errors are {chance}", chance=chance_words(evaluation.p_value))
    if evaluation.verdict == "unclaimed":
        reason = phrase("truth.unstated", "the calibration states no uncertainty")
    off = evaluation.body_heading_error_deg or evaluation.heading_error_deg
    values = {"worst": up_to(off.worst), "target": f"{plain_number(evaluation.target_deg)}°", "reason": reason}
    words = (
        phrase("truth.within", "headings are off by {worst}, within the target of {target}; {reason}", **values)
        if is_on_target
        else phrase("truth.beyond", "headings are off by {worst}, beyond the target of {target}; {reason}", **values)
    )
    basis = _square_basis(evaluation.heading_error_deg, evaluation.chi_square, evaluation.freedom)
    title = phrase(f"truth.title.{evaluation.verdict.replace(' ', '-')}", EVALUATION_TITLES[evaluation.verdict])
    return verdict(title, colour, words, basis)


def _digits(value: float) -> str:
    """Format a fraction as a percentage with two digits.

    >>> _digits(0.00126), _digits(0.2), _digits(-0.0312), _digits(1e-12), _digits(12.0)
    ('0.13%', '20%', '-3.1%', '0%', '> 1000%')
    """
    if not abs(value) < 10.0:
        return "> 1000%"
    return numeral(f"{figures(100 * value)}%" if abs(value) > 1e-9 else "0%")


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
