"""Calibrations as pages for the terminal: from a recording, merged, from typed extremes, of several sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, cast

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.core.language import TERMINAL_LANGUAGE, numeral, phrase
from flinders.core.units import unit_label
from flinders.errors import FitError, count_text, figures, python_arguments
from flinders.estimators.minmax import MinMax
from flinders.findings import advice, first_causes, limit_of, translation
from flinders.fitting.axis_extremes import Extremes
from flinders.fitting.result import Fit, fit_of
from flinders.fitting.verdict import headline_of, is_improvement
from flinders.report.comparison_pages import covered_words
from flinders.report.formatting import (
    aging,
    align_columns,
    align_points,
    condition,
    curve_entries,
    duration_words,
    matrix_entries,
    mounting,
    offset_entries,
    shown_findings,
    without_repeated_steps,
)
from flinders.report.onboard_pages import TITLES, errors_table, page_of_onboard
from flinders.report.phrases import advice_of, count, date, degrees, join_parts, p_value, plain_number
from flinders.report.terminal import COLOURS, facts, lines, notes, page, table, verdict, whole_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.comparison.members import Member, MultiFit
    from flinders.core.calibration import Calibration
    from flinders.diagnostics.repeatability import Repeats
    from flinders.errors import FlindersError, Spelling
    from flinders.findings import Finding, Verdict
    from flinders.workflows.onboard import OnboardCheck

MAX_NOISE_SHARE: Final = limit_of("noise", "refuses")

NO_BETTER_WORDS: Final = "headings are no better with this calibration than without"

COMMON_NOTES: Final = ("scale-unknown", "rotation-unknown")
"""Notes on almost any recording: only a known field and a known mounting avoid them."""


def page_of_fit(
    fit: Fit, spell: Spelling = python_arguments, *, is_verbose: bool = False, onboard: OnboardCheck | None = None
) -> RenderableType:
    """Lay out a fit: plain words, heading errors, numbers with uncertainty, the verdict and its limits.

    Heading errors are those without and with the calibration. If the log has an onboard calibration, its heading error
    is between them, with advice on replacing it.

    Notes that apply to nearly every fit are shown only if `is_verbose`. For a refused fit no number of the calibration
    is shown, since numbers on a screen sooner or later end up in firmware; the page gives the reasons, the remedy, and
    unusual facts of the recording. For a merged fit, each calibration is compared with the others. Here and below,
    `spell` writes the arguments of an advice.
    """
    is_refused = fit.verdict == "refused"
    result = None if is_refused else numbers(fit.calibration, fit.claim.offset_sigma, fit.evidence.noise)
    repeats = fit.evidence.diagnosis.repeats
    if fit.evidence.method == "merged" and repeats is not None:
        blocks = (_merged_parts(repeats), result, _merged_verdict(fit, repeats))
        return Group(page(*blocks), findings(shown_findings(fit), spell))
    tops = () if is_refused else (page_of_recipe(fit), errors_table(fit, onboard), _change_words(fit))
    shown = list(without_repeated_steps(_findings_of_page(fit, is_verbose=is_verbose), fit))
    is_limited = any(finding.severity == "limits" for finding in shown)
    change = None if onboard is None or is_refused else page_of_onboard(onboard, is_limited=is_limited)
    return Group(page(*tops, change, result, _fit_verdict(fit)), findings(shown, spell))


def _findings_of_page(fit: Fit, *, is_verbose: bool) -> list[Finding]:
    """Findings that the page of a fit shows."""
    return [each for each in shown_findings(fit) if is_verbose or each.code not in COMMON_NOTES]


def page_of_recipe(fit: Fit) -> RenderableType | None:
    """Lay out the table of a min/max recipe; None for any other method."""
    if fit.evidence.method not in MinMax.LABELS.values():
        return None
    centre, half = fit.calibration.ellipsoid.centre, fit.calibration.ellipsoid.shape.diagonal()
    return extremes_table(Extremes(fit.calibration, centre - half, centre + half))


def page_of_refused_recipe(fit: Fit) -> RenderableType:
    """Lay out the numbers of a recipe whose fit is refused; they are shown only on request."""
    words = phrase(
        "recipe.refused", "REFUSED, not fit for use: the result of {method}, for comparison only",
        method=fit.evidence.method,
    )  # fmt: skip
    return page(
        Text(words, "bold red"), page_of_recipe(fit), numbers(fit.calibration, np.full(3, np.nan), fit.evidence.noise)
    )


def page_of_file(fit: Fit, spell: Spelling = python_arguments, *, is_verbose: bool) -> RenderableType:
    """Lay out a loaded calibration: origin, numbers and claim."""
    provenance, calibration = fit.provenance.record, fit.calibration
    files = [f"{file.name}, {count(file.rows, 'reading')}" if file.rows else file.name for file in fit.provenance.files]
    readings = phrase("file.in", "in {unit}, axes {axes}", unit=calibration.raw.name, axes=str(calibration.axes))
    origin = [
        (phrase("file.made", "made"), f"{date(provenance.date)}, Flinders {provenance.flinders}" if provenance else ""),
        (phrase("file.from", "from"), join_parts(*files)),
        (phrase("plan.fact.sensor", "sensor"), calibration.sensor or ""),
        (phrase("file.readings", "readings"), readings),
    ]
    sigma = fit.claim.offset_sigma if fit.claim.states_uncertainty else np.full(3, np.nan)
    basis = join_parts(count(fit.evidence.samples, "reading"), fit.evidence.method)
    said = (
        _verdict_of_fit(fit, basis, *_further_lines(fit))
        if fit.claim.states_uncertainty
        else phrase("file.unstated", "Its uncertainty is not stated.")
    )
    known = facts([(name, words) for name, words in origin if words])
    return Group(
        page(known, numbers(calibration, sigma, fit.evidence.noise), said),
        findings(_findings_of_page(fit, is_verbose=is_verbose), spell),
    )


def page_of_extremes(extremes: Extremes, spell: Spelling = python_arguments) -> RenderableType:
    """Lay out the calibration from six typed numbers, which claims no uncertainty."""
    said = verdict_line(extremes.verdict, "accuracy unknown, with limits:", "six typed numbers; minmax")
    result = numbers(extremes.calibration, np.full(3, np.nan), math.nan)
    return Group(page(extremes_table(extremes), result, said), findings(extremes.findings, spell))


def page_of_sensors(
    outcomes: Sequence[tuple[str, Fit | FitError]],
    target_deg: float,
    onboard: Mapping[str, OnboardCheck] | None = None,
) -> RenderableType:
    """Lay out the separately calibrated magnetometers of a log: a row for each, and the reasons for refusals.

    If the log has onboard calibrations, `onboard` by sensor name, they are in the last column.
    """
    name, quality = Column("magnetometer", overflow="fold"), Column("verdict")
    known = onboard or {}
    rows = [
        (str(number), *_sensor_row(*pair), *([_onboard_cell(known.get(pair[0]))] if known else []))
        for number, pair in enumerate(outcomes, 1)
    ]
    reasons = [(number, _why_refused(outcome)) for number, (_, outcome) in enumerate(outcomes, 1)]
    said = [Text(f"  {number}: {why}") for number, why in reasons if why]
    basis = f"worst heading error, 1 σ, level vehicle; the target is {target_deg:g}°"
    headings: list[str | Column] = ["", name, "readings", "seen", "worst heading", quality]
    headings += [Column("on board, off by")] if known else []
    return page(table(headings, rows), Group(*said, basis))


def page_of_joint_fit(together: MultiFit, target_deg: float, spell: Spelling = python_arguments) -> RenderableType:
    """Lay out jointly calibrated magnetometers: a row for each, and how well they agree."""
    numbered = ("heading\nalone", "\ntogether", f"axes of\n{together.reference}", "\nbut for", "\noff by")
    headings = (
        Column("\n"),
        Column("\nmagnetometer", overflow="fold", min_width=12),
        *whole_columns(numbered),
        Column("\nverdict"),
    )
    rows = [
        (str(number), member.name, _error(member.alone), _error(member.fit), *_axes_cells(together, member),
         _verdict_cell(verdict_of(member.fit)))
        for number, member in enumerate(together.members, 1)
    ]  # fmt: skip
    members = enumerate(together.members, 1)
    reasons = [pair for number, member in members for pair in _member_notes(number, member, spell)]
    basis = f"heading: the worst error, 1 σ, level vehicle; the target is {target_deg:g}°"
    said = Group(notes(reasons), Text(f"{_agreement_words(together)}\n{basis}", "dim"))
    return page(table(headings, rows), said)


# ---------------------------------------------------------------------------------------------------------- one fit


def numbers(calibration: Calibration, offset_sigma: Floats, noise: float) -> Text:
    """Offset, and matrix below it, in columns x, y and z that are aligned at decimal points."""
    unit = unit_label(calibration.unit)
    offset, curve = offset_entries(calibration, offset_sigma), curve_entries(calibration)
    shown = ["   ".join(row) for row in align_columns(offset, *matrix_entries(calibration.matrix), *curve.values())]
    below, _ = align_points(["?" if math.isnan(noise) else figures(noise, 3), offset[0]])
    shown.append(below.ljust(len(shown[0])))
    rows = (phrase(f"numbers.{name}", name) for name in curve)
    names = (
        phrase("numbers.offset", "offset"),
        phrase("table.matrix", "matrix"),
        "",
        "",
        *rows,
        phrase("plan.noise", "noise"),
    )
    units = (unit, "", "", "", *(f"% {phrase('numbers.of-field', 'of the field')}" for _ in curve), unit)
    return lines(list(zip(names, map(numeral, shown), units, strict=True)))


def findings(findings: Iterable[Finding], spell: Spelling) -> RenderableType:
    """Lay out one line for each finding: the advice and the code, with a mark for the severity."""
    return notes((finding.severity, advice_of(finding, spell), finding.code) for finding in findings)


def lead(fit: Fit) -> Text:
    """The first sentence of the verdict, with the code of its finding."""
    words, code = headline_of(fit, language=TERMINAL_LANGUAGE.get())
    return Text(words).append(f" [{code}]" if code else "", "dim")


def verdict_line(quality: Verdict, words: str | Text, *more: str) -> Table:
    """The verdict on a calibration, with its meaning and the numbers that it is based on."""
    language = TERMINAL_LANGUAGE.get()
    return verdict(language.capitals(language.phrase(f"verdict.{quality}", quality)), quality, words, *more)


def _change_words(fit: Fit) -> Text | None:
    """Words for the change since the calibration whose soft iron is used; None for any other fit."""
    known = fit.evidence.diagnosis.refreshed
    if known is None:
        return None
    words = phrase(
        "refreshed.change",
        "Since {previous} the offset has changed by ({change}) {unit}: with it, headings would now be off by up to "
        "{error}. The soft iron is taken from it.",
        previous=known.previous,
        change=phrase("list.numbers", ", ").join(plain_number(number, "+.1f") for number in known.offset_change),
        unit=unit_label(fit.calibration.unit),
        error=degrees(known.heading_change_deg),
    )
    return Text(words)


def _verdict_of_fit(fit: Fit, basis: str, *more: str) -> Table:
    """The verdict on a calibration: its first sentence, the numbers that it is based on, and further lines."""
    if fit.verdict != "refused" and fit.claim.states_uncertainty:
        language = TERMINAL_LANGUAGE.get()
        dip = language.numeral(f"{fit.claim.known_dip_deg:.3g}")
        level = (
            language.phrase("basis.assumed-dip", "level, dip {dip}° (assumed)", dip=dip)
            if fit.claim.dip_assumed
            else language.phrase("basis.dip", "level, dip {dip}°", dip=dip)
        )
        basis = join_parts(basis, level)
    return verdict_line(fit.verdict, lead(fit), basis, *more)


def _fit_verdict(fit: Fit) -> Table:
    is_noisy = fit.evidence.noise > MAX_NOISE_SHARE * fit.calibration.ellipsoid.radius
    is_surface = not (fit.judgement.is_flat or fit.claim.plane or is_noisy)
    seen = covered_words(fit) if is_surface else ""
    basis = join_parts(f"{count(fit.evidence.samples, 'reading')}{seen}", fit.evidence.method)
    return _verdict_of_fit(fit, basis, *_further_lines(fit))


def _further_lines(fit: Fit) -> Iterator[str]:
    """Yield further lines of a verdict: mounting, conditions, ageing, and whether a calibration is needed at all."""
    language = TERMINAL_LANGUAGE.get()
    if fit.verdict == "refused":
        return iter((phrase("basis.not-written", "no calibration was written"),))
    no_better = "" if is_improvement(fit) else phrase("basis.no-better", NO_BETTER_WORDS)
    conditions = translation.assumptions(fit.judgement.conditions, language) or condition(fit)
    return filter(None, (mounting(fit), conditions, aging(fit), no_better))


# ----------------------------------------------------------------------------------------------- merged, and typed


def _merged_parts(repeats: Repeats) -> Table:
    """Table of each merged calibration and its difference from the others."""
    names = ("readings", "claims", "off the others", "chance")
    rows = [
        (part.source, f"{part.samples:,}" if part.samples else "", degrees(part.claimed_deg),
         f"{degrees(part.difference_deg)} ± {degrees(part.difference_sigma_deg)}", p_value(part.p_value))
        for part in repeats.parts
    ]  # fmt: skip
    return table((Column("calibration", overflow="fold"), *whole_columns(names)), rows)


def _merged_verdict(fit: Fit, repeats: Repeats) -> Table:
    readings = f" of {count_text(fit.evidence.samples, 'reading')}" if fit.evidence.samples else ""
    chance = f"; chance scatters them as far with {p_value(repeats.p_value)}"
    basis = f"{count_text(len(repeats.parts), 'calibration')}{readings}{chance}"
    return _verdict_of_fit(fit, basis, *(["nothing was written"] if fit.verdict == "refused" else []))


def extremes_table(extremes: Extremes) -> Table:
    """Table of the six numbers, and of offset and scale of each axis, as a board shows them.

    >>> from rich.console import Console
    >>> from flinders.fitting.axis_extremes import from_extremes
    >>> shown = extremes_table(from_extremes([-157, 98, -123, 124, -109, 101], variant="largest"))
    >>> Console(width=60).print(shown)
         min   max   offset   half-range   scale
    ────────────────────────────────────────────
    x   -157    98    -29.5        127.5    1.00
    y   -123   124      0.5        123.5    1.03
    z   -109   101     -4.0        105.0    1.21
    """
    half, digits = extremes.ellipsoid.shape.diagonal(), min(12, _decimals(extremes))
    columns = (extremes.low, extremes.high, extremes.calibration.offset, half, extremes.scale)
    rows = [
        (letter, *(f"{end:.{digits}f}" for end in (low, high)),
         *(f"{middle:.{digits + 1}f}" for middle in (offset, half_range)),
         f"{scale:.2f}" if scale >= 0.1 else f"{scale:.3g}")
        for letter, low, high, offset, half_range, scale in zip("xyz", *columns, strict=True)
    ]  # fmt: skip
    return table(("", "min", "max", "offset", "half-range", "scale"), rows)


def _decimals(extremes: Extremes) -> int:
    """Number of decimals for all six numbers, such that none has more than six digits."""
    written = [f"{value:.6g}" for value in [*extremes.low.tolist(), *extremes.high.tolist()]]
    return 3 if any("e" in text for text in written) else max(len(text.partition(".")[2]) for text in written)


# --------------------------------------------------------------------------------------------------- several sensors


def verdict_of(outcome: Fit | FlindersError) -> Verdict:
    """The verdict of a fit; ``refused`` if there is no fit."""
    return outcome.verdict if isinstance(outcome, Fit) else "refused"


def _verdict_cell(verdict: Verdict) -> Text:
    return Text(verdict, COLOURS[verdict])


def _sensor_row(name: str, outcome: Fit | FitError) -> tuple[RenderableType, ...]:
    """Row of one magnetometer: name, readings, share of the sphere, worst heading error, verdict."""
    fit, quality = fit_of(outcome), verdict_of(outcome)
    error = "" if fit is None or quality == "refused" else degrees(fit.heading_error_deg.worst)
    cells = ("", "") if fit is None else (f"{fit.evidence.samples:,}", f"{fit.evidence.coverage.fraction:.0%}")
    return name, *cells, error, _verdict_cell(quality)


def _onboard_cell(onboard: OnboardCheck | None) -> str:
    """Worst heading error of the onboard calibration, with the advice on it."""
    if onboard is None:
        return ""
    return f"{degrees(onboard.comparison.worst_deg)}: {TITLES[onboard.answer].lower()}"


def _why_refused(outcome: Fit | FitError) -> str:
    """Reason for a refused fit, in one line."""
    if isinstance(outcome, Fit):
        return ""
    fit = fit_of(outcome)
    if fit is None:
        return outcome.message
    reasons = (finding for finding in first_causes(fit.findings) if finding.severity == "refuses")
    return "; ".join(finding.fault for finding in reasons)


def _error(outcome: Fit | FlindersError) -> str:
    """Worst heading error; for a refused fit too, as it shows how far the fit is from usable."""
    fit = fit_of(outcome)
    return "–" if fit is None else degrees(fit.heading_error_deg.worst)


def _axes_cells(together: MultiFit, member: Member) -> tuple[str, str, str]:
    """Cells of one member: its axes, its misalignment, and the typical scatter of its readings."""
    if member.rotation is None:
        return "", "", ""
    off = "" if member.name == together.reference else f"{member.misalignment_deg:.1f}°"
    if off and member.rotation_sigma_deg is not None:
        off = f"{member.misalignment_deg:.1f} ± {figures(float(member.rotation_sigma_deg.max()), 1)}°"
    return member.axes, off, degrees(member.scatter_deg) if member.scatter_deg else ""


def _member_notes(number: int, member: Member, spell: Spelling) -> Iterator[tuple[str, str]]:
    """Yield the limits of a member: findings that the other members show, then its own most severe finding."""
    if (fit := fit_of(member.fit)) is None:
        yield "refuses", f"{number} {cast('FlindersError', member.fit).message}"
        return
    own = [finding for finding in fit.findings if finding.severity != "note" and finding not in member.findings]
    for finding in (*(one for one in member.findings if one.code != "turned-to"), *own[:1]):
        yield finding.severity, f"{number}: {advice(finding, spell)}"


def _agreement_words(together: MultiFit) -> str:
    """Words for the extent of the comparison between the members."""
    over = f"{count_text(together.agreement.instants, 'moment')} common to two or more"
    seconds = f", over {duration_words(together.agreement.seconds)}" if together.agreement.seconds else ""
    axes = "of gyro and accelerometer" if together.in_body else f"of {together.reference}"
    own = [member.name for member in together.members if member.is_kept]
    but = f", those of {' and '.join(own)} in their own" if own else ""
    corrected = f"corrected readings are in the axes {axes}{but}\n" if together.is_joint else ""
    return f"{corrected}{over}{seconds}; off by: readings averaged over a second, in degrees of heading, 1 σ"
