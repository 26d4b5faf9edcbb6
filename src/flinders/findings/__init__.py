"""The catalogue of findings: all that can be said of a fit, a row each.

A row has the code, the rule with its limits, the sentence for an engineer, the sentence and the remedy for whoever uses
the compass, and what the table of docs/findings.md says. Verdict, terminal, page, reports and fleets read it. To add a
finding, add its row to the file of its subject; a quantity that its rule or sentence takes and that the record does not
have yet is made where the record is made (`flinders.fitting.verdict`).

>>> CATALOGUE["coverage"].number
'angle from the middle of the largest gap to the nearest reading, degrees'
>>> CATALOGUE["coverage"].rule.grades
(Grade(severity='limits', factor=60.0, times=''),)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from flinders.errors import in_python, with_hint
from flinders.findings import aiding, calibration, disturbances, fit, recording, sensors
from flinders.findings.refusal import REFUSALS as REFUSALS
from flinders.findings.row import CAUSES as CAUSES
from flinders.findings.row import VERDICTS as VERDICTS
from flinders.findings.row import CatalogueRow as CatalogueRow  # noqa: TC001 - for others
from flinders.findings.row import Condition as Condition
from flinders.findings.row import Finding as Finding  # noqa: TC001 - for others
from flinders.findings.row import Quantity as Quantity
from flinders.findings.row import Record as Record
from flinders.findings.row import Severity as Severity  # noqa: TC001 - for others
from flinders.findings.row import Verdict as Verdict
from flinders.findings.row import by_severity as by_severity
from flinders.findings.row import first_causes as first_causes

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flinders.errors import Spelling

CATALOGUE: Final[dict[str, CatalogueRow]] = {
    row.code: row for subject in (fit, recording, disturbances, calibration, aiding, sensors) for row in subject.ROWS
}
"""Every finding there is, by its code."""

OF_ONE_MAGNETOMETER: Final = (*fit.ROWS, *recording.ROWS, *calibration.ROWS)
"""Findings that a magnetometer can have by itself, for programs in other languages that calibrate one."""


def advice(finding: Finding, spell: Spelling = in_python) -> str:
    """Advice with the arguments that carry it out, as an interface spells them.

    >>> advice(Finding("unit-unknown", "note", 1.0, 0.0, "name the unit"))
    'name the unit (unit=, scale=)'
    """
    row = CATALOGUE.get(finding.code)
    return with_hint(finding.advice, spell(row.hint)) if row else finding.advice


def found_in(record: Mapping[str, Any], *codes: str) -> Iterator[Finding]:
    """Of some findings those whose rules hold for a record.

    >>> [finding.code for finding in found_in({"axis_ratio": 3.0, "step": 0.0}, "axis-ratio", "quantised")]
    ['axis-ratio']
    """
    return (finding for code in codes if (finding := CATALOGUE[code].finding(record)) is not None)


def limit_of(code: str, name: Severity | str = "limits") -> float:
    """The factor of a limit in a rule: that of a severity, or of another quantity that it needs.

    >>> limit_of("coverage"), limit_of("heading-error", "refuses"), limit_of("field-changed", "drift_by_chance")
    (60.0, 5.0, 0.0001)
    """
    rule = CATALOGUE[code].rule
    limits = {grade.severity: grade.factor for grade in rule.grades} | {
        need.quantity: need.factor for need in rule.needs
    }
    return limits[name]


def action(code: str) -> str:
    """What to do about a finding or an error that many units have; empty where the catalogue does not say.

    >>> action("coverage"), action("unit")
    ('turn the sensor through the directions without readings too', 'give all files of a unit in one unit of field')
    """
    row = CATALOGUE.get(code)
    if row is None:
        return REFUSALS[code].action if code in REFUSALS else ""
    return row.fleet_action or row.action.replace("`", "")
