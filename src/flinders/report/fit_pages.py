"""Calibrations as pages for the terminal: of a recording, merged, typed, of several sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.core.units import label
from flinders.errors import FitError, counted, figures
from flinders.fitting.advice import UPSIDE_DOWN, condition, movement
from flinders.fitting.result import Fit, fit_of
from flinders.report.formatting import degrees, p_value, written_time
from flinders.report.sections import mounting, said_of
from flinders.report.terminal import COLOURS, graded, notes, numbers, page, styled, table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from flinders.comparison.multi_sensor import Member, Together
    from flinders.diagnostics.repeatability import Repeats
    from flinders.errors import FlindersError
    from flinders.findings import Finding, Verdict
    from flinders.fitting.axis_extremes import Extremes
    from flinders.heading.error_propagation import HeadingError


def of_fit(fit: Fit) -> RenderableType:
    """Lay out a fit: before and after, the numbers with their uncertainty, the verdict and what limits it.

    Of a refused one no number of the calibration is shown: none can be trusted, and what stands on a screen is
    copied into a firmware sooner or later. It says why, how to do better, and what is odd about the recording.
    Calibrations put together are shown each against the others.
    """
    if fit.method == "merged" and fit.repeats is not None:
        blocks = _merged_parts(fit.repeats), _numbers(fit), _merged_verdict(fit, fit.repeats)
        return Group(page(*blocks), findings(said_of(fit)))
    before = None if fit.verdict == "refused" else _before_and_after(fit)
    return Group(page(before, _numbers(fit), _fit_verdict(fit)), findings(said_of(fit), movement(fit)))


def of_extremes(extremes: Extremes) -> RenderableType:
    """Lay out what six typed numbers give, of which nothing is claimed."""
    unknown = np.full(3, np.nan)
    said = graded(extremes.verdict, "how good it is nobody knows, with these limits:", "six typed numbers; minmax")
    result = numbers(extremes.calibration, unknown, math.nan)
    return Group(page(extremes_table(extremes), result, said), findings(extremes.findings))


def of_sensors(outcomes: Sequence[tuple[str, Fit | FitError]], target_deg: float) -> RenderableType:
    """Lay out each magnetometer of a log that was calibrated by itself: a row each, and why some were refused."""
    headings = (
        "",
        Column("magnetometer", overflow="fold"),
        "readings",
        "seen",
        "worst heading",
        Column("verdict"),
    )
    rows = [(str(number), *_sensor_row(*pair)) for number, pair in enumerate(outcomes, 1)]
    reasons = [(number, _why_refused(outcome)) for number, (_, outcome) in enumerate(outcomes, 1)]
    said = [Text(f"  {number} {why}") for number, why in reasons if why]
    basis = f"worst heading error, 1 σ, held level; the target is {target_deg:g}°"
    return page(table(headings, rows), Group(*said, basis))


def of_several(together: Together, target_deg: float) -> RenderableType:
    """Lay out magnetometers that were calibrated together: a row each, and how the others agree with it."""
    upper = (f"axes of\n{together.reference}", "\nbut for", "\noff by")
    headings = (
        Column("\n"),
        Column("\nmagnetometer", overflow="fold", min_width=12),
        *(Column(name, justify="right", no_wrap=True) for name in ("heading\nalone", "\ntogether", *upper)),
        Column("\nverdict"),
    )
    rows = [
        (str(number), member.name, _error(member.alone), _error(member.fit), *_axes_cells(together, member),
         _coloured(verdict_of(member.fit)))
        for number, member in enumerate(together.members, 1)
    ]  # fmt: skip
    reasons = [pair for number, member in enumerate(together.members, 1) for pair in _member_notes(number, member)]
    basis = f"heading: the worst error, 1 σ, held level; the target is {target_deg:g}°"
    said = Group(notes(reasons), Text(f"{_agreed(together)}\n{basis}", "dim"))
    return page(table(headings, rows), said)


# ---------------------------------------------------------------------------------------------------------- one fit


def findings(findings: Iterable[Finding], turn: str = "") -> RenderableType:
    """What limits it and what to do; how to move on, which is `turn`, is said once."""
    said: list[tuple[str, str]] = []
    is_repeated = False
    for finding in findings:
        advice = finding.advice.replace(turn, "turn the sensor as above") if is_repeated else finding.advice
        is_repeated = is_repeated or bool(turn and turn in finding.advice)
        said.append((finding.severity, advice))
    return notes(said)


def _numbers(fit: Fit) -> Text | None:
    """Offset, matrix and noise; none of a refused fit."""
    return None if fit.verdict == "refused" else numbers(fit.calibration, fit.offset_sigma, fit.noise)


def _before_and_after(fit: Fit) -> Table:
    unit = label(fit.calibration.unit)
    raw, error = fit.uncorrected_heading_error_deg, fit.heading_error_deg
    strength, spread = fit.uncorrected_strength
    left = f"{fit.noise / fit.ellipsoid.radius:.1%}"
    field = f"{figures(fit.calibration.field_strength, 4)} {unit}"
    before = ("before", f"{figures(strength, 4)} {unit}", f"{spread:.1%}", degrees(raw.rms), degrees(raw.worst))
    after = styled("bold", "after", field, left, degrees(error.rms), degrees(error.worst))
    return table(("", "strength", "spread", "heading error, rms", "worst"), [before, after])


def good_to(error: HeadingError, target_deg: float) -> str:
    """Say to how much the worst heading is good, and to how much it should be."""
    return f"worst heading good to {degrees(error.worst)} (1 σ; the target is {target_deg:g}°)"


def _quality(fit: Fit, good: str, refused: str, basis: str, *more: Text) -> Table:
    """The verdict of a calibration, for whom its number holds, and what it rests on."""
    error, within = fit.heading_error_deg, good_to(fit.heading_error_deg, fit.target_deg)
    words = {
        "good": f"{within}{good}",
        "limited": f"{within}, with these limits:",
        "refused": f"not fit for use, {refused}",
    }[fit.verdict]
    if fit.verdict == "refused":
        return graded(fit.verdict, words, basis)
    return graded(fit.verdict, words, f"{basis}; held level, dip {error.dip_deg:.3g}°", *more)


def _fit_verdict(fit: Fit) -> Table:
    seen = "" if fit.is_flat or fit.plane else f", {fit.coverage.fraction:.0%} of the sphere seen"
    basis = f"{counted(fit.samples, 'reading')}{seen}; {fit.method}"
    reach = "" if fit.verdict != "good" else f", {_reach(fit)}"
    adds = "" if fit.verdict == "refused" else mounting(fit)
    more = [Text(words) for words in (adds, condition(fit)) if words]
    return _quality(fit, reach, "no calibration was written", basis, *more)


def _reach(fit: Fit) -> str:
    """Say up to which tilt a fit is as good as was asked for."""
    limit = fit.attitude_limit_deg
    return "at any attitude" if limit >= UPSIDE_DOWN else f"up to {limit:.0f}° of tilt"


# ----------------------------------------------------------------------------------------------- merged, and typed


def _merged_parts(repeats: Repeats) -> Table:
    """Each calibration against the others."""
    names = ("readings", "claims", "off the others", "chance")
    headings = (
        Column("calibration", overflow="fold"),
        *(Column(name, justify="right", no_wrap=True) for name in names),
    )
    rows = [
        (part.source, f"{part.samples:,}" if part.samples else "", degrees(part.claimed_deg),
         f"{degrees(part.off_deg)} ± {degrees(part.off_sigma_deg)}", p_value(part.p_value))
        for part in repeats.parts
    ]  # fmt: skip
    return table(headings, rows)


def _merged_verdict(fit: Fit, repeats: Repeats) -> Table:
    readings = f" of {counted(fit.samples, 'reading')}" if fit.samples else ""
    chance = f"; chance scatters them as far with {p_value(repeats.p_value)}"
    basis = f"{counted(len(repeats.parts), 'calibration')}{readings}{chance}"
    return _quality(fit, "", "nothing was written", basis)


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
    cells = ("", "") if fit is None else (f"{fit.samples:,}", f"{fit.coverage.fraction:.0%}")
    return name, *cells, error, _coloured(quality)


def _why_refused(outcome: Fit | FitError) -> str:
    """Why a fit was refused, in a line."""
    if isinstance(outcome, Fit):
        return ""
    fit = fit_of(outcome)
    if fit is None:
        return str(outcome)
    return "; ".join(finding.advice.partition(":")[0] for finding in fit.findings if finding.severity == "refuses")


def _error(outcome: Fit | FlindersError) -> str:
    """Worst heading error, of what is refused too, since it says how far it is from being of use."""
    fit = fit_of(outcome)
    return "–" if fit is None else degrees(fit.heading_error_deg.worst)


def _axes_cells(together: Together, member: Member) -> tuple[str, str, str]:
    """Which axes it has, how far it is off them, and what its readings are usually off."""
    if member.rotation is None:
        return "", "", ""
    off = "" if member.name == together.reference else f"{member.off_axes_deg:.1f}°"
    if off and member.rotation_sigma_deg is not None:
        off = f"{member.off_axes_deg:.1f} ± {figures(float(member.rotation_sigma_deg.max()), 1)}°"
    return member.axes, off, degrees(member.scatter_deg) if member.scatter_deg else ""


def _member_notes(number: int, member: Member) -> Iterator[tuple[str, str]]:
    """What limits a member: what the others show of it first, then the gravest of its own."""
    fit = fit_of(member.fit)
    if fit is None:
        yield "refuses", f"{number} {member.fit}"
        return
    own = [finding for finding in fit.findings if finding.severity != "note" and finding not in member.findings]
    for finding in (*(one for one in member.findings if one.code != "turned-to"), *own[:1]):
        yield finding.severity, f"{number} {finding.advice}"


def _agreed(together: Together) -> str:
    """Over how long they were compared with each other."""
    over = f"{counted(together.agreement.moments, 'moment')} common to two or more"
    seconds = f", over {written_time(together.agreement.seconds)}" if together.agreement.seconds else ""
    axes = "of gyro and accelerometer" if together.in_body else f"of {together.reference}"
    own = [member.name for member in together.members if member.is_kept]
    but = f", those of {' and '.join(own)} in their own" if own else ""
    corrected = f"corrected readings are in the axes {axes}{but}\n" if together.is_joint else ""
    return f"{corrected}{over}{seconds}; off by: readings averaged over a second, in degrees of heading, 1 σ"
