"""Calibrations as pages for the terminal: of a recording, merged, typed, of several sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, cast

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.core.units import label
from flinders.errors import FitError, counted, figures, in_python
from flinders.estimators.minmax import MinMax
from flinders.findings import advice, first_causes, limit_of
from flinders.fitting.axis_extremes import Extremes
from flinders.fitting.claim import dip_words
from flinders.fitting.result import Fit, fit_of
from flinders.fitting.verdict import headline_of, improves
from flinders.report.formatting import (
    aging,
    aligned,
    condition,
    curve_entries,
    date_of,
    degrees,
    matrix_entries,
    mounting,
    offset_entries,
    on_the_point,
    p_value,
    said_once,
    shown_findings,
    written_time,
)
from flinders.report.onboard_pages import TITLES, errors_table, of_onboard
from flinders.report.terminal import COLOURS, facts, lines, notes, page, table, verdict, whole_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.arrays import Floats
    from flinders.comparison.members import Member, Together
    from flinders.core.calibration import Calibration
    from flinders.diagnostics.repeatability import Repeats
    from flinders.errors import FlindersError, Spelling
    from flinders.findings import Finding, Verdict
    from flinders.workflows.onboard import OnboardCheck

NOISE_REFUSED: Final = limit_of("noise", "refuses")

NO_BETTER: Final = "headings are no better with this calibration than without"

IN_NEARLY_EVERY_FIT: Final = ("scale-unknown", "rotation-unknown")
"""Notes that hold whatever the recording, unless somebody gave the field and the mounting."""


def of_fit(
    fit: Fit, spell: Spelling = in_python, *, is_verbose: bool = False, onboard: OnboardCheck | None = None
) -> RenderableType:
    """Lay out a fit: plain words, errors without and with it, its numbers and uncertainty, the verdict and its limits.

    Errors with what was `onboard` stand between, with whether a change is worth while.

    What is true of nearly every fit is shown if `is_verbose`. Of a refused one no number of the calibration is shown:
    none can be trusted, and what stands on a screen is copied into a firmware sooner or later. It says why, how to do
    better, and what is odd about the recording. Calibrations put together are shown each against the others. Here and
    below, `spell` writes the arguments that carry out an advice.
    """
    is_refused = fit.verdict == "refused"
    result = None if is_refused else numbers(fit.calibration, fit.claim.offset_sigma, fit.evidence.noise)
    repeats = fit.evidence.diagnosis.repeats
    if fit.evidence.method == "merged" and repeats is not None:
        blocks = (_merged_parts(repeats), result, _merged_verdict(fit, repeats))
        return Group(page(*blocks), findings(shown_findings(fit), spell))
    tops = () if is_refused else (of_recipe(fit), errors_table(fit, onboard), _since(fit))
    shown = list(said_once(_shown(fit, is_verbose=is_verbose), fit))
    is_limited = any(finding.severity == "limits" for finding in shown)
    change = None if onboard is None or is_refused else of_onboard(onboard, is_limited=is_limited)
    return Group(page(*tops, change, result, _fit_verdict(fit)), findings(shown, spell))


def _shown(fit: Fit, *, is_verbose: bool) -> list[Finding]:
    """Findings that the page of a fit shows."""
    return [each for each in shown_findings(fit) if is_verbose or each.code not in IN_NEARLY_EVERY_FIT]


def of_recipe(fit: Fit) -> RenderableType | None:
    """Lay out what a recipe of the extremes publishes: its table; None for any other method."""
    if fit.evidence.method not in MinMax.LABELS.values():
        return None
    centre, half = fit.calibration.ellipsoid.centre, fit.calibration.ellipsoid.shape.diagonal()
    return extremes_table(Extremes(fit.calibration, centre - half, centre + half))


def of_refused_recipe(fit: Fit) -> RenderableType:
    """Lay out the numbers of a recipe whose fit is refused, which are shown only where somebody insists."""
    mark = Text(
        f"REFUSED, not fit for use: what {fit.evidence.method} calculates all the same, to be compared", "bold red"
    )
    return page(mark, of_recipe(fit), numbers(fit.calibration, np.full(3, np.nan), fit.evidence.noise))


def of_file(fit: Fit, spell: Spelling = in_python, *, is_verbose: bool) -> RenderableType:
    """Lay out a calibration that was loaded: where it comes from, its numbers, and what its file claims of them."""
    provenance, calibration = fit.provenance.record, fit.calibration
    files = [
        f"{file.name}, {counted(file.rows, 'reading')}" if file.rows else file.name for file in fit.provenance.files
    ]
    origin = [
        ("made", f"{date_of(provenance.date)}, Flinders {provenance.flinders}" if provenance else ""),
        ("from", "; ".join(files)),
        ("sensor", calibration.sensor or ""),
        ("readings", f"in {calibration.raw.name}, axes {calibration.axes}"),
    ]
    sigma = fit.claim.offset_sigma if fit.claim.states_uncertainty else np.full(3, np.nan)
    basis = f"{counted(fit.evidence.samples, 'reading')}; {fit.evidence.method}"
    said = _judged(fit, basis, *_more(fit)) if fit.claim.states_uncertainty else "Its uncertainty is not stated."
    known = facts([(name, words) for name, words in origin if words])
    return Group(
        page(known, numbers(calibration, sigma, fit.evidence.noise), said),
        findings(_shown(fit, is_verbose=is_verbose), spell),
    )


def of_extremes(extremes: Extremes, spell: Spelling = in_python) -> RenderableType:
    """Lay out what six typed numbers give, of which nothing is claimed."""
    said = graded(extremes.verdict, "accuracy not known, with limits:", "six typed numbers; minmax")
    result = numbers(extremes.calibration, np.full(3, np.nan), math.nan)
    return Group(page(extremes_table(extremes), result, said), findings(extremes.findings, spell))


def of_sensors(
    outcomes: Sequence[tuple[str, Fit | FitError]],
    target_deg: float,
    onboard: Mapping[str, OnboardCheck] | None = None,
) -> RenderableType:
    """Lay out each magnetometer of a log that was calibrated by itself: a row each, and why some were refused.

    Beside the new calibration stands what was `onboard`, by the name of the sensor, where the log tells that of any.
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


def of_several(together: Together, target_deg: float, spell: Spelling = in_python) -> RenderableType:
    """Lay out magnetometers that were calibrated together: a row each, and how the others agree with it."""
    numbered = ("heading\nalone", "\ntogether", f"axes of\n{together.reference}", "\nbut for", "\noff by")
    headings = (
        Column("\n"),
        Column("\nmagnetometer", overflow="fold", min_width=12),
        *whole_columns(numbered),
        Column("\nverdict"),
    )
    rows = [
        (str(number), member.name, _error(member.alone), _error(member.fit), *_axes_cells(together, member),
         _coloured(verdict_of(member.fit)))
        for number, member in enumerate(together.members, 1)
    ]  # fmt: skip
    members = enumerate(together.members, 1)
    reasons = [pair for number, member in members for pair in _member_notes(number, member, spell)]
    basis = f"heading: the worst error, 1 σ, level vehicle; the target is {target_deg:g}°"
    said = Group(notes(reasons), Text(f"{_agreed(together)}\n{basis}", "dim"))
    return page(table(headings, rows), said)


# ---------------------------------------------------------------------------------------------------------- one fit


def numbers(calibration: Calibration, offset_sigma: Floats, noise: float) -> Text:
    """Offset above matrix, in columns x, y and z, each on its decimal points."""
    unit = label(calibration.unit)
    offset, curve = offset_entries(calibration, offset_sigma), curve_entries(calibration)
    shown = ["   ".join(row) for row in aligned(offset, *matrix_entries(calibration.matrix), *curve.values())]
    below, _ = on_the_point(["?" if math.isnan(noise) else figures(noise, 3), offset[0]])
    shown.append(below.ljust(len(shown[0])))
    names = ("offset", "matrix", "", "", *curve, "noise")
    units = (unit, "", "", "", *("% of the field" for _ in curve), unit)
    return lines(list(zip(names, shown, units, strict=True)))


def findings(findings: Iterable[Finding], spell: Spelling) -> RenderableType:
    """One line for each finding: what it limits, what to do, and its code."""
    return notes((finding.severity, advice(finding, spell), finding.code) for finding in findings)


def lead(fit: Fit) -> Text:
    """The first sentence of the verdict, with the code of the finding that it is about."""
    words, code = headline_of(fit)
    return Text(words).append(f" [{code}]" if code else "", "dim")


def graded(quality: Verdict, words: str | Text, *more: str) -> Table:
    """The verdict of a calibration, with what it means and what that rests on."""
    return verdict(quality.upper(), quality, words, *more)


def _since(fit: Fit) -> Text | None:
    """What changed since the calibration whose soft iron it has; None of any other fit."""
    known = fit.evidence.diagnosis.refreshed
    if known is None:
        return None
    change = ", ".join(f"{number:+.1f}" for number in known.offset_change)
    return Text(
        f"Since {known.previous} the offset has changed by ({change}) {label(fit.calibration.unit)}: with it, headings "
        f"would now be off by up to {degrees(known.heading_change_deg)}. The soft iron is taken from it."
    )


def _judged(fit: Fit, basis: str, *more: str) -> Table:
    """The verdict of a calibration: its first sentence, what it rests on, and more."""
    if fit.verdict != "refused" and fit.claim.states_uncertainty:
        basis += f"; level, {dip_words(fit.claim)}"
    return graded(fit.verdict, lead(fit), basis, *more)


def _fit_verdict(fit: Fit) -> Table:
    is_noisy = fit.evidence.noise > NOISE_REFUSED * fit.calibration.ellipsoid.radius
    is_surface = not (fit.judgement.is_flat or fit.claim.plane or is_noisy)
    seen = f", {fit.evidence.coverage.fraction:.0%} of the sphere covered" if is_surface else ""
    return _judged(fit, f"{counted(fit.evidence.samples, 'reading')}{seen}; {fit.evidence.method}", *_more(fit))


def _more(fit: Fit) -> Iterator[str]:
    """What else a verdict says: what the mounting adds, when it holds and how long, and whether it is needed."""
    if fit.verdict == "refused":
        return iter(("no calibration was written",))
    return filter(None, (mounting(fit), condition(fit), aging(fit), "" if improves(fit) else NO_BETTER))


# ----------------------------------------------------------------------------------------------- merged, and typed


def _merged_parts(repeats: Repeats) -> Table:
    """Each calibration against the others."""
    names = ("readings", "claims", "off the others", "chance")
    rows = [
        (part.source, f"{part.samples:,}" if part.samples else "", degrees(part.claimed_deg),
         f"{degrees(part.difference_deg)} ± {degrees(part.difference_sigma_deg)}", p_value(part.p_value))
        for part in repeats.parts
    ]  # fmt: skip
    return table((Column("calibration", overflow="fold"), *whole_columns(names)), rows)


def _merged_verdict(fit: Fit, repeats: Repeats) -> Table:
    readings = f" of {counted(fit.evidence.samples, 'reading')}" if fit.evidence.samples else ""
    chance = f"; chance scatters them as far with {p_value(repeats.p_value)}"
    basis = f"{counted(len(repeats.parts), 'calibration')}{readings}{chance}"
    return _judged(fit, basis, *(["nothing was written"] if fit.verdict == "refused" else []))


def extremes_table(extremes: Extremes) -> Table:
    """Six numbers with the offset and the scale of each axis, as a board shows them.

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
    """Decimals that all six numbers need, up to six digits in all."""
    written = [f"{value:.6g}" for value in [*extremes.low.tolist(), *extremes.high.tolist()]]
    return 3 if any("e" in text for text in written) else max(len(text.partition(".")[2]) for text in written)


# --------------------------------------------------------------------------------------------------- several sensors


def verdict_of(outcome: Fit | FlindersError) -> Verdict:
    """That of a fit; ``refused`` where there is none."""
    return outcome.verdict if isinstance(outcome, Fit) else "refused"


def _coloured(verdict: Verdict) -> Text:
    return Text(verdict, COLOURS[verdict])


def _sensor_row(name: str, outcome: Fit | FitError) -> tuple[RenderableType, ...]:
    """Name, readings, share of the sphere, worst heading and verdict of one magnetometer."""
    fit, quality = fit_of(outcome), verdict_of(outcome)
    error = "" if fit is None or quality == "refused" else degrees(fit.heading_error_deg.worst)
    cells = ("", "") if fit is None else (f"{fit.evidence.samples:,}", f"{fit.evidence.coverage.fraction:.0%}")
    return name, *cells, error, _coloured(quality)


def _onboard_cell(onboard: OnboardCheck | None) -> str:
    """By how much what was on board is off, at the worst heading, and what is to be done with it."""
    if onboard is None:
        return ""
    return f"{degrees(onboard.comparison.worst_deg)}: {TITLES[onboard.answer].lower()}"


def _why_refused(outcome: Fit | FitError) -> str:
    """Why a fit was refused, in a line."""
    if isinstance(outcome, Fit):
        return ""
    fit = fit_of(outcome)
    if fit is None:
        return outcome.message
    reasons = (finding for finding in first_causes(fit.findings) if finding.severity == "refuses")
    return "; ".join(finding.fault for finding in reasons)


def _error(outcome: Fit | FlindersError) -> str:
    """Worst heading error, of what is refused too, since it says how far it is from being of use."""
    fit = fit_of(outcome)
    return "–" if fit is None else degrees(fit.heading_error_deg.worst)


def _axes_cells(together: Together, member: Member) -> tuple[str, str, str]:
    """Which axes it has, how far it is off them, and what its readings are usually off."""
    if member.rotation is None:
        return "", "", ""
    off = "" if member.name == together.reference else f"{member.misalignment_deg:.1f}°"
    if off and member.rotation_sigma_deg is not None:
        off = f"{member.misalignment_deg:.1f} ± {figures(float(member.rotation_sigma_deg.max()), 1)}°"
    return member.axes, off, degrees(member.scatter_deg) if member.scatter_deg else ""


def _member_notes(number: int, member: Member, spell: Spelling) -> Iterator[tuple[str, str]]:
    """What limits a member: what the others show of it first, then the gravest of its own."""
    if (fit := fit_of(member.fit)) is None:
        yield "refuses", f"{number} {cast('FlindersError', member.fit).message}"
        return
    own = [finding for finding in fit.findings if finding.severity != "note" and finding not in member.findings]
    for finding in (*(one for one in member.findings if one.code != "turned-to"), *own[:1]):
        yield finding.severity, f"{number}: {advice(finding, spell)}"


def _agreed(together: Together) -> str:
    """Over how long they were compared with each other."""
    over = f"{counted(together.agreement.instants, 'moment')} common to two or more"
    seconds = f", over {written_time(together.agreement.seconds)}" if together.agreement.seconds else ""
    axes = "of gyro and accelerometer" if together.in_body else f"of {together.reference}"
    own = [member.name for member in together.members if member.is_kept]
    but = f", those of {' and '.join(own)} in their own" if own else ""
    corrected = f"corrected readings are in the axes {axes}{but}\n" if together.is_joint else ""
    return f"{corrected}{over}{seconds}; off by: readings averaged over a second, in degrees of heading, 1 σ"
