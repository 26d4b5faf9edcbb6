"""A fit as a page of plain words: for whoever sails, drives or flies with the compass, as text that any e-mail carries.

It says how good the calibration is, how far off the compass was and will be, for which attitudes that holds, what is
not known and why, what to do next, and the numbers to copy. Of a refusal it says why and how to move, and shows no
numbers.

>>> print(_paragraph("It is short."), _items(["One.", "Two."]), sep="")
It is short.
- One.
- Two.
<BLANKLINE>
"""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Final

from flinders.core.units import label
from flinders.errors import counted, figures
from flinders.findings import CATALOGUE, REFUSALS, limit_of
from flinders.fitting.advice import UPSIDE_DOWN, remedy, unseen_side
from flinders.fitting.result import TILTS, Fit, Refused
from flinders.fitting.verdict import OF_THE_RECORDING
from flinders.report.formatting import (
    aligned,
    as_sentence,
    capitalised,
    date_of,
    degrees,
    matrix_entries,
    offset_entries,
    on_the_point,
)
from flinders.report.sections import mounting

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.core.calibration_file import Provenance
    from flinders.errors import FitError
    from flinders.findings import Finding

WIDTH: Final = 78
"""Columns: two less than the terminal's 80, so that an e-mail can be quoted."""

RUNS: Final = 8
"""Runs of outliers that are listed."""

USE: Final = "Enter the numbers below, or the calibration file, where the compass is read."

AGAIN: Final = (
    "Calibrate again when anything of iron, or a current, has come near the sensor or gone from it. A new recording "
    "shows whether the calibration still holds: flinders check."
)


def page(outcome: Fit | FitError, provenance: Provenance) -> str:
    """Write a fit, or why there is none, in plain words.

    Parameters
    ----------
    outcome : Fit or FitError
        The result, or the refusal.
    provenance : Provenance
        Release, date and recordings.
    """
    if isinstance(outcome, Fit):
        sections = _given(outcome)
    elif isinstance(outcome, Refused):
        sections = _refused(outcome.fit)
    else:
        sections = _without_a_fit(outcome)
    fit = outcome if isinstance(outcome, Fit) else getattr(outcome, "fit", None)
    return "\n".join([_head(fit, provenance), *sections, _read(outcome, fit, provenance)])


def _head(fit: Fit | None, provenance: Provenance) -> str:
    sensor = f" of the sensor {fit.calibration.sensor}" if fit and fit.calibration.sensor else ""
    method = f", method {fit.method}" if fit else ""
    return f"Compass calibration{sensor}\n" + _paragraph(
        f"{date_of(provenance.date)}, Flinders {provenance.flinders}{method}"
    )


def _given(fit: Fit) -> list[str]:
    said = [finding for finding in fit.findings if finding.severity != "refuses"]
    return [
        _section("WHAT WAS FOUND", _paragraph(_what_was_found(fit))),
        _section("HOW FAR OFF THE COMPASS WAS, AND WILL BE", _paragraph(_how_far_off(fit))),
        _section("WHICH ATTITUDES IT IS GOOD FOR", _paragraph(_attitudes(fit))),
        _section("WHAT IS NOT KNOWN OR NOT SOUND, AND WHY", _items(_in_words(fit, finding) for finding in said)),
        _section("WHAT TO DO NEXT", _items([USE, *_remedies(fit, said), AGAIN])),
        _section("THE NUMBERS TO COPY", _numbers(fit)),
    ]


def _refused(fit: Fit) -> list[str]:
    said = [finding for finding in fit.findings if finding.severity != "note" or finding.code in OF_THE_RECORDING]
    return _refusal((_in_words(fit, finding) for finding in said), _remedies(fit, said))


def _without_a_fit(error: FitError) -> list[str]:
    refusal = REFUSALS.get(error.code)
    if refusal is None or not refusal.plain:
        return _refusal([str(error)], [])
    return _refusal([refusal.plain.format(**error.evidence)], [refusal.remedy])


def _refusal(why: Iterable[str], what: Iterable[str]) -> list[str]:
    refusal = "No calibration can be given from this recording. Its numbers could not be trusted, and none are shown."
    return [
        _section("WHAT WAS FOUND", _paragraph(refusal)),
        _section("WHY", _items(why)),
        _section("WHAT TO DO NEXT", _items([*what, "After that, calibrate again."])),
    ]


def _what_was_found(fit: Fit) -> str:
    verdict = {
        "good": "The calibration is good.",
        "limited": "The calibration can be used, with the limits that are named below.",
    }[fit.verdict]
    strength, spread = fit.uncorrected_strength
    unit, field = label(fit.calibration.unit), fit.ellipsoid.radius
    offset = math.hypot(*fit.calibration.offset)
    return (
        f"{verdict} What is magnetic near the sensor and turns with it, and its own zero error, add a field of "
        f"{figures(offset, 4)} {unit}, {figures(offset / field)} times the one to be measured. As the sensor turns, "
        f"the field seems to vary by {spread:.1%} about {figures(strength, 4)} {unit}; after correction it varies by "
        f"{fit.noise / field:.1%}."
    )


def _how_far_off(fit: Fit) -> str:
    raw, error = fit.uncorrected_heading_error_deg, fit.heading_error_deg
    before = "any angle: the compass does not work" if raw.worst > 100.0 else f"up to {degrees(raw.worst)}"
    adds = mounting(fit).replace(" (1 σ)", "")
    mounted = f" {capitalised(adds)}." if adds else ""
    return (
        f"Without the calibration headings are off by {before}. With it, expect them to be off by {degrees(error.rms)} "
        f"on average and by {degrees(error.worst)} at the worst heading; in 19 of 20 cases by no more than twice that. "
        f"The target was {fit.target_deg:g}°.{mounted} This is for a vehicle that is level, where the field dips by "
        f"{abs(error.dip_deg):.3g}°, and for as long as nothing magnetic near the sensor comes, goes or is switched on."
    )


def _attitudes(fit: Fit) -> str:
    limit, target = fit.attitude_limit_deg, fit.target_deg
    if limit >= UPSIDE_DOWN:
        said = f"All of them: within the target of {target:g}° whichever way the vehicle is held."
    else:
        worse = (
            f"At a tilt of {{:g}}° expect up to {{}}, and upside down {degrees(fit.tilted_error(UPSIDE_DOWN).worst)}."
        )
        tilt = next((tilt for tilt in TILTS if tilt > limit), UPSIDE_DOWN)
        level = "Held level only." if limit < 1.0 else f"Within the target of {target:g}° up to {limit:.0f}° of tilt."
        said = f"{level} {worse.format(tilt, degrees(fit.tilted_error(tilt).worst))}"
    if fit.plane or fit.coverage.hole_deg <= limit_of("coverage"):
        return said
    return (
        f"{said} Readings were taken in {fit.coverage.fraction:.0%} of all directions; the middle of what is missing "
        f"is where the sensor's {unseen_side(fit.coverage)} points along the earth's field."
    )


def _in_words(fit: Fit, finding: Finding) -> str:
    length = f"{figures(fit.calibration.field_strength, 4)} {label(fit.calibration.unit)}"
    return CATALOGUE[finding.code].plain.format(
        number=finding.number,
        limit=finding.limit,
        angle="any angle" if finding.number > 90.0 else degrees(finding.number),
        seconds=figures(finding.number),
        length=length,
    )


def _remedies(fit: Fit, findings: Iterable[Finding]) -> list[str]:
    """Say what to do about each finding, each thing once."""
    move = f"{capitalised(remedy(fit))}."
    remedies = (CATALOGUE[finding.code].remedy.format(remedy=move) for finding in findings)
    return [what for what in dict.fromkeys(remedies) if what]


def _numbers(fit: Fit) -> str:
    """Offset and matrix, one line each a person can copy, and what to do with them."""
    calibration = fit.calibration
    unit = label(calibration.unit)
    offsets = on_the_point(offset_entries(calibration, fit.offset_sigma))
    rows = aligned(*matrix_entries(calibration.matrix))
    lines = [
        "corrected = matrix * (raw - offset)",
        "",
        *(f"offset {axis}   {value.rstrip()} {unit}" for axis, value in zip("xyz", offsets, strict=True)),
        "",
        *(f"matrix {axis}   {'   '.join(row)}" for axis, row in zip("xyz", rows, strict=True)),
    ]
    raw = f"raw is a reading in {unit}"
    if calibration.raw.scale != 1.0:
        raw += f" (the recording's {calibration.raw.name} times {calibration.raw.scale:g})"
    if not calibration.axes.is_identity:
        raw += f", its axes taken as {calibration.axes}"
    return (
        _paragraph("Subtract the offset from each reading, then multiply by the matrix:")
        + "\n"
        + textwrap.indent("\n".join(lines), "    ").replace("    \n", "\n")
        + "\n\n"
        + _paragraph(
            f"Here {raw}. What stands behind ± is the standard deviation; the matrix has no unit. Corrected readings "
            f"are {figures(calibration.field_strength, 4)} {unit} long. The calibration file holds all digits."
        )
    )


def _read(outcome: Fit | FitError, fit: Fit | None, provenance: Provenance) -> str:
    """Name the recordings, and what of them was left out."""
    items = [f"{file.name}: {counted(file.rows, 'reading')}." for file in provenance.files]
    if fit and fit.outliers:
        runs = [str(outlier) for outlier in fit.outliers]
        more = f"; and {counted(len(runs) - RUNS, 'more run')}" if len(runs) > RUNS else ""
        items.append(f"Left out, as they do not belong to the rest: {'; '.join(runs[:RUNS])}{more}.")
    findings = fit.findings if fit else ()
    items += [as_sentence(finding.advice) for finding in findings if finding.code == "skipped-rows"]
    items += [f"Left out: {entry}." for entry in getattr(outcome, "skipped", ())]
    return _section("WHAT WAS READ", _items(items))


def _section(heading: str, text: str) -> str:
    return f"{heading}\n{text}"


def _paragraph(text: str, first: str = "", other: str = "") -> str:
    """Write text in lines, the first and the others with an indent."""
    wrapper = textwrap.TextWrapper(WIDTH, first, other, break_long_words=False, break_on_hyphens=False)
    return f"{wrapper.fill(text)}\n"


def _items(texts: Iterable[str]) -> str:
    """Write sentences below each other, each with a dash."""
    return "".join(_paragraph(text, "- ", "  ") for text in texts)
