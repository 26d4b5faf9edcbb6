"""The catalogue of findings: all that can be said of a fit, a row each.

A row has the code, the rule with its limits, the sentence for an engineer, the sentence and the remedy for whoever uses
the compass, and what the table of docs/findings.md says. Verdict, terminal, page, reports and fleets read it. To add a
finding, add its row to the file of its subject; a quantity that its rule or sentence takes and that the record does not
have yet is made where the record is made (`flinders.fitting.verdict`).

>>> CATALOGUE["coverage"].number
'angle from the middle of the largest gap to the nearest reading, degrees'
>>> CATALOGUE["coverage"].rule.grades
(Grade(severity='limits', factor=60.0, of=''),)

Findings that follow from others are not shown: who removes the cause need not read of them.

>>> given = [Finding(code, "limits", 1.0, 0.0, "…") for code in ("noise", "coverage", "axis-swap")]
>>> [finding.code for finding in first_causes(given)]
['axis-swap', 'coverage']
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.findings import aiding, calibration, disturbances, fit, recording, sensors
from flinders.findings.refusal import REFUSALS as REFUSALS
from flinders.findings.row import VERDICTS as VERDICTS
from flinders.findings.row import CatalogueRow as CatalogueRow
from flinders.findings.row import Condition as Condition
from flinders.findings.row import Finding as Finding
from flinders.findings.row import Quantity as Quantity
from flinders.findings.row import Record as Record
from flinders.findings.row import Severity as Severity
from flinders.findings.row import Verdict as Verdict
from flinders.findings.row import by_severity as by_severity

if TYPE_CHECKING:
    from collections.abc import Iterable

CATALOGUE: Final[dict[str, CatalogueRow]] = {
    row.code: row for subject in (fit, recording, disturbances, calibration, aiding, sensors) for row in subject.ROWS
}
"""Every finding there is, by its code."""

_FORMER: Final = {row.former: row.code for row in CATALOGUE.values() if row.former}


def current(code: str) -> str:
    """The code of today for one that a file or a table holds.

    >>> current("driver-curved"), current("coverage")
    ('disturbance-nonlinear', 'coverage')
    """
    return _FORMER.get(code, code)


def in_python(finding: Finding) -> str:
    """Advice with the arguments that carry it out."""
    return _naming(finding, CATALOGUE[finding.code].arguments if finding.code in CATALOGUE else "")


def in_options(finding: Finding) -> str:
    """Advice with the options of the command line that carry it out.

    >>> in_options(Finding("unit-unknown", "note", 1.0, 0.0, "name the unit"))
    'name the unit (--unit, --scale)'
    """
    return _naming(finding, CATALOGUE[finding.code].options if finding.code in CATALOGUE else "")


def _naming(finding: Finding, names: str) -> str:
    return f"{finding.advice} ({names})" if names else finding.advice


def limit_of(code: str, of: Severity | str = "limits") -> float:
    """The factor of a limit in a rule: that of a severity, or of another quantity that it needs.

    >>> limit_of("coverage"), limit_of("heading-error", "refuses"), limit_of("field-changed", "drift_by_chance")
    (60.0, 5.0, 0.0001)
    """
    rule = CATALOGUE[code].rule
    if rule is None:
        raise KeyError(f"{code} has no limit: code decides")
    limits = {grade.severity: grade.factor for grade in rule.grades} | {
        need.quantity: need.factor for need in rule.needs
    }
    return limits[of]


def action(code: str) -> str:
    """What to do about a finding or an error that many units have; empty where the catalogue does not say.

    >>> action("coverage"), action("unit")
    ('turn the sensor through the directions without readings too', 'give all files of a unit in one unit of field')
    """
    row = CATALOGUE.get(code)
    if row is None:
        return REFUSALS[code].action if code in REFUSALS else ""
    return row.fleet_action or row.action.replace("`", "")


OF_RESIDUALS: Final = (
    *("unsteady-field", "lasting-noise", "nonlinear-axis", "axis-lag", "structure", "correlated"),
    "tilt-error",  # a dip that wanders
)
"""What residuals show, whatever made them."""

OF_A_SURFACE: Final = ("prior", "unobservable-parameters", "axis-ratio", "field-strength")
"""What an ellipsoid shows that is one."""


class Cause(NamedTuple):
    """A finding of a severity, or a worse one, and the findings that follow from it, unless another is there."""

    code: str
    severity: Severity
    consequences: tuple[str, ...]
    unless: str = ""


CAUSES: Final = (
    Cause("axis-swap", "limits", ("heading-error", "noise", "field-changed", "outliers", "few-samples", *OF_RESIDUALS)),
    Cause("alternating", "limits", ("heading-error", "noise", "field-changed", "few-samples", *OF_RESIDUALS)),
    Cause("soft-iron-changed", "limits", ("heading-error",)),
    Cause("saturated", "limits", ("nonlinear-axis", "structure")),
    Cause("disturbance-unmodelled", "limits", ("attitude-dependent", "noise", "field-changed", *OF_RESIDUALS)),
    Cause("attitude-dependent", "limits", ("noise", *OF_RESIDUALS)),
    Cause(
        "noise",
        "refuses",
        (
            *("heading-error", "coverage", "few-samples", "field-changed", "outliers"),
            *(*OF_RESIDUALS, *OF_A_SURFACE),
        ),
        unless="level-plane",  # an ellipse through a short arc is small beside its noise
    ),
    Cause("inflation", "limits", ("field-changed", "coverage", *OF_RESIDUALS, *OF_A_SURFACE)),
    Cause("recordings-differ", "limits", ("heading-error", "structure")),
    Cause("field-changed", "refuses", ("heading-error", "noise", *OF_RESIDUALS)),
    Cause("heading-error", "refuses", ("level-plane", "tilt-error", *OF_A_SURFACE)),
    Cause("field-changed", "limits", ("noise", *OF_RESIDUALS)),
    Cause("heading-error", "limits", ()),
    Cause("coverage", "limits", ("prior", "unobservable-parameters")),
    Cause("lasting-noise", "limits", ("few-samples", "correlated")),
    Cause("few-samples", "limits", ("nonlinear-axis", "axis-lag", "structure", "correlated")),
    Cause("quantised", "note", ("stale-repeats",)),
)
"""The first cause first, as the findings are shown."""

_SEVERITIES: Final = tuple(VERDICTS)


def first_causes(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings that follow from no other, by severity, causes first; a cause is as severe as what follows from it.

    `findings`: of one fit.
    """
    left, shown = list(findings), list[Finding]()
    there = {finding.code for finding in left}
    for code, severity, consequences, unless in CAUSES:
        own = [finding for finding in left if finding.code == code and _rank(finding) <= _SEVERITIES.index(severity)]
        if own and unless not in there:
            hidden = [finding for finding in left if finding.code in consequences]
            worst = min((*own, *hidden), key=_rank).severity
            shown += [replace(finding, severity=worst) for finding in own]
            left = [finding for finding in left if finding not in own and finding not in hidden]
    return by_severity([*shown, *left])


def _rank(finding: Finding) -> int:
    return _SEVERITIES.index(finding.severity)
