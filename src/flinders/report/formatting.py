"""Formats of numbers and words in every report: angles, values with uncertainty, matrices, facts about a fit.

>>> import flinders
>>> from flinders import simulate
>>> swayed = simulate.tumble(seed=1, motion="swayed", n=1500).samples
>>> mounting(flinders.fit(swayed, aiding=("rate", "dip")))
'the rotation of the axes in the body, from the gyro and accelerometer, adds 0.39° (1 σ)'
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.language import TERMINAL_LANGUAGE, numeral, phrase
from flinders.errors import figures
from flinders.findings import first_causes
from flinders.findings.catalogue import RECORDING_FINDINGS
from flinders.findings.row import verifiable_conditions
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.fitting.good_until import good_until
from flinders.likelihood.parameters import TERMS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from datetime import datetime

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.findings import Finding
    from flinders.fitting.result import Fit

OFFSET_RESOLUTION: Final = 2e-4
"""Rounding step of an offset, relative to the field strength; it moves headings by a fiftieth of a degree or less."""
SOURCES: Final = {name: term.instrument for name, term in TERMS.items()}
"""Name of the instrument behind each aiding sensor."""
MIN_WITHOUT_EXPONENT: Final = 1e-3
"""Smallest number that is written without an exponent, if it needs more than `DECIMALS` decimals, as in tesla."""
MAX_DIGITS: Final = 9
"""Largest number of digits after the point of a number with an exponent."""
DECIMALS: Final = 6
"""Largest number of decimals of a number with uncertainty, and of a matrix with entries around one."""


def with_uncertainty(value: float, sigma: float, *, finest: float = math.inf) -> str:
    """Write a number to the second digit of its standard deviation, and at least to a multiple of `finest`.

    `finest` is for numbers whose errors cancel: more of their digits matter than the single uncertainties suggest.

    >>> with_uncertainty(-17.0318, 15.3, finest=0.01), with_uncertainty(1.2004e-05, 3.9e-08)
    ('-17.03 ± 15', '1.2004e-05 ± 3.9e-08')
    """
    if not (math.isfinite(sigma) and sigma > 0.0):
        return f"{value:.6g}"
    if max(abs(value), sigma) >= 1e9:
        return f"{value:.6g} ± {sigma:.2g}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    if digits > DECIMALS and max(abs(value), sigma) < MIN_WITHOUT_EXPONENT:
        return _with_exponent(value, sigma, finest)
    if digits > DECIMALS:
        return f"{value:.{DECIMALS}f} ± {sigma:.1g}"
    more = max(digits, min(DECIMALS, math.ceil(-math.log10(finest)))) if 0.0 < finest < math.inf else digits
    shown = round(value, more) + 0.0
    return f"{shown:.{more}f} ± {sigma:.{digits}f}"


def _with_exponent(value: float, sigma: float, finest: float) -> str:
    """Write a small number with an exponent, with as many digits as in `with_uncertainty`."""
    last = min(math.floor(math.log10(sigma)) - 1, math.floor(math.log10(finest)) if 0.0 < finest < math.inf else 0)
    size = max(abs(value), 10.0 ** (last + 1))
    digits = min(max(math.floor(math.log10(size)) - last, 1), MAX_DIGITS)
    return f"{value + 0.0:.{digits}e} ± {sigma:.1e}"


def degrees(angle: float) -> str:
    """Write an error angle with two digits, at most 100°.

    >>> degrees(0.0664), degrees(12.3), degrees(float("nan"))
    ('0.066°', '12°', '> 100°')
    """
    return f"{figures(angle)}°" if angle < 10 else f"{angle:.0f}°" if angle < 100 else "> 100°"


def angle(degrees_off: float) -> str:
    """Write a difference of angles; a rounding error is written as zero.

    >>> angle(0.0321), angle(-1.234), angle(1e-9)
    ('0.032°', '-1.2°', '0°')
    """
    if abs(degrees_off) <= 1e-6:
        return "0°"
    return f"{'-' if degrees_off < 0 else ''}{degrees(abs(degrees_off))}"


def p_value(value: float) -> str:
    """Write a p-value.

    >>> p_value(0.4312), p_value(1e-9)
    ('p = 0.43', 'p < 0.0001')
    """
    return f"p = {value:.2g}" if value >= 1e-4 else "p < 0.0001"


def duration_words(seconds: float) -> str:
    """Write a duration in words.

    >>> duration_words(0.5), duration_words(75.0), duration_words(7325.0)
    ('0.50 s', '1 min 15 s', '2 h 2 min 5 s')
    """
    if seconds < 60:
        return f"{figures(seconds, 3 if seconds >= 1 else 2)} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return " ".join(f"{count} {unit}" for count, unit in ((hours, "h"), (minutes, "min"), (rest, "s")) if count)


def date_of(when: datetime) -> str:
    """Write a date and time for users.

    >>> from datetime import UTC, datetime
    >>> date_of(datetime(2026, 5, 1, 12, 30, tzinfo=UTC))
    '1 May 2026, 12:30 UTC'
    """
    return f"{when.day} {when:%B %Y, %H:%M %Z}"


def minus(shown: str) -> str:
    """Replace hyphens by minus signs, which are as wide as plus signs."""
    return shown.replace("-", "−")


def length(value: float, unit: str) -> str:
    """Write a field with its unit.

    >>> length(49.3021, "µT")
    '49.30 µT'
    """
    return f"{figures(value, 4)} {unit}"


def align_points(numbers: Sequence[str]) -> list[str]:
    """Pad numbers on both sides so that their decimal points are aligned."""
    cut = [(number, _point(number)) for number in numbers]
    before = max(point for _, point in cut)
    after = max(len(number) - point for number, point in cut)
    return [" " * (before - point) + number + " " * (after - len(number) + point) for number, point in cut]


def _point(number: str) -> int:
    """Position of the decimal point in a number; behind the last digit if there is none."""
    value = number.partition(" ")[0]
    return value.find(".") if "." in value else len(value)


def offset_entries(calibration: Calibration, sigma: Floats) -> list[str]:
    """Write an offset, each axis with its uncertainty if that is known."""
    finest = OFFSET_RESOLUTION * calibration.field_strength
    return [with_uncertainty(*pair, finest=finest) for pair in zip(calibration.offset.tolist(), sigma, strict=True)]


def matrix_entries(matrix: Floats, sigma: Floats | None = None) -> list[list[str]]:
    """Write a matrix with its uncertainties; without them to seven digits of the largest entry."""
    if sigma is not None:
        pairs = np.stack([matrix, sigma], axis=2).tolist()
        return [[with_uncertainty(*pair, finest=OFFSET_RESOLUTION) for pair in row] for row in pairs]
    largest = float(abs(matrix).max())
    decimals = DECIMALS - math.floor(math.log10(largest) + 1e-9)
    if not 0 <= decimals <= 2 * DECIMALS:
        return [[f"{value:.{DECIMALS}e}" for value in row.tolist()] for row in matrix]
    return [[f"{round(value, decimals) + 0.0:.{decimals}f}" for value in row.tolist()] for row in matrix]


def curve_entries(calibration: Calibration) -> dict[str, list[str]]:
    """Terms of each axis for a reading as long as the field, in percent of the field; empty without linearization.

    >>> from flinders import Calibration
    >>> from flinders.core.linearization import Linearization
    >>> curve = Linearization([0.001, 0, 0], [0, 1e-5, 0], [60, 60, 60])
    >>> curved = Calibration(np.eye(3), [0, 0, 0], 50.0, linearization=curve)
    >>> curve_entries(curved)
    {'quadratic': ['5.0', '0.0', '0.0'], 'cubic': ['0.0', '2.5', '0.0']}
    """
    if calibration.linearization is None:
        return {}
    curve, radius = calibration.linearization, calibration.ellipsoid.radius
    terms = {"quadratic": curve.quadratic * radius, "cubic": curve.cubic * radius**2}
    return {name: [f"{round(100.0 * share, 1) + 0.0:.1f}" for share in term.tolist()] for name, term in terms.items()}


def align_columns(*rows: Sequence[str]) -> list[list[str]]:
    """Rows of numbers whose columns are aligned at decimal points."""
    columns = (align_points(column) for column in zip(*rows, strict=True))
    return [list(row) for row in zip(*columns, strict=True)]


# ------------------------------------------------------------------------------------------------------- words on a fit


def uncorrected_error_words(fit: Fit) -> str:
    """Heading error of uncorrected readings, in words."""
    worst = fit.claim.uncorrected_heading_error_deg.worst
    return "any angle: the compass does not work" if worst > 100 else f"up to {degrees(worst)}"


def shown_findings(fit: Fit) -> list[Finding]:
    """Findings that a page shows: first causes; for a refused fit, without notes that are not about the recording."""
    causes = first_causes(fit.findings)
    if fit.verdict != "refused":
        return list(causes)
    return [finding for finding in causes if finding.severity != "note" or finding.code in RECORDING_FINDINGS]


def without_repeated_steps(findings: Iterable[Finding], fit: Fit | None = None) -> Iterator[Finding]:
    """Findings in which a repeated next step is replaced by a reference to the headline or to an earlier finding.

    The value ``repeated_step`` is a next step that was replaced: the reason for a large heading error depends on it.
    """
    headline = () if fit is None else first_causes(fit.findings)[:1]
    above = {step for finding in headline for step in _steps(finding).values()}
    for finding in findings:
        steps = _steps(finding)
        again = {name: ("as-above",) for name, step in steps.items() if step in above}
        above.update(steps.values())
        repeated = {"repeated_step": steps["next_step"]} if "next_step" in again else {}
        yield replace(finding, values={**finding.values, **again, **repeated})


def _steps(finding: Finding) -> dict[str, Any]:
    """Next step and next movement that a finding advises, if it does; keys are the names of these values."""
    return {name: finding.values[name] for name in ("next_step", "next_movement") if name in finding.values}


def mounting(fit: Fit) -> str:
    """Words for the mounting's contribution to the heading error; empty if it is unknown.

    An estimated mounting is observed with an aiding sensor; a stated one is not observed.
    """
    error = fit.claim.alignment_error_deg
    if error is None:
        return ""
    shown, who = numeral(degrees(error)), sources(fit)
    if fit.calibration.rotation != "estimated":
        return phrase(
            "mounting.stated", "the mounting adds {error} (1 σ), which a magnetometer cannot observe", error=shown
        )
    if not error < ANY_ANGLE_DEG:
        return phrase(
            "mounting.unknown",
            "the rotation of the axes in the body is not determined by {instruments}: no heading of the body is known",
            instruments=who,
        )
    return phrase(
        "mounting.estimated", "the rotation of the axes in the body, from {instruments}, adds {error} (1 σ)",
        instruments=who, error=shown,
    )  # fmt: skip


def sources(fit: Fit) -> str:
    """Names of the aiding sensors that the fit uses, in words."""
    each = () if fit.evidence.aiding is None else fit.evidence.aiding.sensors
    names = [
        phrase(f"instrument.{SOURCES[aid.name].replace(' ', '-')}", f"the {SOURCES[aid.name]}")
        for aid in each if aid.is_used and aid.name in SOURCES
    ]  # fmt: skip
    if not names:
        return phrase("instrument.others", "the other recorded quantities")
    first, *others = names
    short = [first, *(name.removeprefix("the ") for name in others)]
    return f" {phrase('list.and', 'and')} ".join(short)


def with_unit(disturbance: Disturbance) -> str:
    """Name of a disturbance with its unit, as the label of an axis.

    >>> from flinders.core.disturbance import Disturbance
    >>> with_unit(Disturbance("current", [0, 0, 0])), with_unit(Disturbance("throttle", [0, 0, 0]))
    ('current, A', 'throttle')
    """
    return f"{disturbance.name},{disturbance.kind.unit}" if disturbance.kind.unit else disturbance.name


def aging(fit: Fit) -> str:
    """Words for the time for which a fit is good; empty without a claim."""
    until = good_until(fit)
    return "" if until is None else until.brief_sentence(TERMINAL_LANGUAGE.get())


def condition(fit: Fit) -> str:
    """Assumptions of a verdict with a way to verify them; empty if other evidence confirms them.

    >>> from flinders import simulate
    >>> from flinders.fitting.calibrate import fit
    >>> condition(fit(simulate.tumble(seed=1).samples))
    'holds if no iron is near and currents are constant: record elsewhere too'
    """
    return verifiable_conditions(fit.judgement.conditions)
