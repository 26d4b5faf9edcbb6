"""All rows of the catalogue, their order in the engine, and the quantities that their rules compare.

>>> CATALOGUE["coverage"].number
'angle from the middle of the largest gap to the nearest reading, degrees'
>>> CATALOGUE["coverage"].rule.grades
(Grade(severity='limits', factor=60.0, times=''),)
>>> QUANTITIES[:3], ENGINE_FINDINGS.index("coverage") < ENGINE_FINDINGS.index("scale-unknown")
(('flatness', 'flatness_limit', 'is_planar'), True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.findings import aiding, calibration, disturbances, fit, recording, sensors, unmodelled

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.findings.row import CatalogueRow, Rule

CATALOGUE: Final[dict[str, CatalogueRow]] = {
    row.code: row
    for subject in (fit, unmodelled, recording, disturbances, calibration, aiding, sensors)
    for row in subject.ROWS
}
"""Every finding, by code."""

FIT_FINDINGS: Final = tuple(row.code for row in (*fit.ROWS, *unmodelled.ROWS))
"""Findings about the fit itself."""

RESIDUAL_FINDINGS: Final = ("alternating", "outliers")
"""Findings about a recording that need a fitted surface."""

ORIGIN_FINDINGS: Final = ("typed-extremes", "composed", "filtered", "no-uncertainty")
"""Findings about calibrations that were combined or imported, or about filtered readings."""

CALIBRATION_FINDINGS: Final = tuple(row.code for row in calibration.ROWS if row.code not in ORIGIN_FINDINGS)
"""Findings about a calibration, regardless of its origin."""

RECORDING_FINDINGS: Final = tuple(row.code for row in recording.ROWS if row.code not in RESIDUAL_FINDINGS)
"""Findings about a recording, regardless of the quality of its fit."""

ENGINE_FINDINGS: Final = (*FIT_FINDINGS, *RESIDUAL_FINDINGS, *CALIBRATION_FINDINGS, *RECORDING_FINDINGS)
"""Findings that the engine checks for the fit of one magnetometer, in the engine's order."""

OTHER_FINDINGS: Final = (
    *ORIGIN_FINDINGS,
    *(row.code for subject in (disturbances, aiding, sensors) for row in subject.ROWS),
)
"""Findings about a disturbance, an aiding sensor or another magnetometer. Their quantities are computed separately."""

RULES: Final = (*ENGINE_FINDINGS, *OTHER_FINDINGS)
"""Codes of the findings, in the order of the engine's table."""

STATED_QUANTITIES: Final = (
    "samples", "covered", "per_degree_of_tilt", "drift", "farthest", "nonlinear_share", "linearized_share", "weakest",
    "strongest", "breadth", "strength_found", "site_strength",
)  # fmt: skip
"""Quantities that a judgement states but no rule compares."""


def _quantities_of(codes: Iterable[str]) -> tuple[str, ...]:
    """Quantities in the rules of given findings, without duplicates, in order."""
    return tuple(dict.fromkeys(name for code in codes for name in _of_rule(CATALOGUE[code].rule)))


def _of_rule(rule: Rule) -> list[str]:
    """Quantities of one rule, in order of appearance."""
    names = [rule.quantity, *(grade.times for grade in rule.grades)]
    names += [name for need in rule.needs for name in (need.quantity, need.times)]
    return [name for name in (*names, rule.number, rule.stated_limit.times) if name]


QUANTITIES_OF_A_FIT: Final = tuple(dict.fromkeys((*_quantities_of(ENGINE_FINDINGS), *STATED_QUANTITIES)))
"""Quantities that the engine computes for a fit."""

QUANTITIES: Final = tuple(dict.fromkeys((*QUANTITIES_OF_A_FIT, *_quantities_of(OTHER_FINDINGS))))
"""All quantities that rules compare or state."""
