"""The catalogue of findings: one row for each possible finding about a fit.

A row has the code, the rule with its limits, and the sentence for an engineer. It also has the sentence and the remedy
for the user of the compass, and the cells of the table in docs/findings.md. Sentences are made from the values of a
finding when it is shown: by the terminal, the page, reports and fleets. To add a finding, add its row to the file of
its subject. If its rule or sentence needs a new quantity, the engine computes it (``judge.c``); for other sensors, the
code that makes their record computes it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from flinders.errors import append_hint, python_arguments
from flinders.findings.catalogue import CATALOGUE as CATALOGUE
from flinders.findings.finding import Finding as Finding  # noqa: TC001 - for others
from flinders.findings.finding import by_severity as by_severity
from flinders.findings.refusal import REFUSALS as REFUSALS
from flinders.findings.row import CAUSES as CAUSES
from flinders.findings.row import VERDICTS as VERDICTS
from flinders.findings.row import CatalogueRow as CatalogueRow
from flinders.findings.row import Condition as Condition
from flinders.findings.row import Quantity as Quantity
from flinders.findings.row import Record as Record
from flinders.findings.row import Severity as Severity
from flinders.findings.rules import certain_finding as certain_finding
from flinders.findings.rules import finding_in as finding_in
from flinders.findings.rules import findings_in as findings_in
from flinders.findings.rules import first_causes as first_causes
from flinders.findings.rules import limit_of as limit_of
from flinders.findings.rules import link_causes as link_causes
from flinders.verdicts import Verdict as Verdict

if TYPE_CHECKING:
    from flinders.errors import Spelling

LINK: Final = re.compile(r"\[([^]]*)\]\([^)]*\)")
"""A link in Markdown. Its text is kept and its address removed."""


def advice(finding: Finding, spell: Spelling = python_arguments) -> str:
    """Advice of a finding with the arguments that it names, in the form of an interface.

    >>> advice(Finding("unit-unknown", "note", {"field_strength": 48.0}))
    'the unit is not known, so all is in counts: name the unit, or the size of a count in µT (unit=, scale=)'
    """
    row = CATALOGUE.get(finding.code)
    spelled = spell(row.hint) if row else ""
    offered = f"; {row.offer}" if row and row.offer and spelled else ""
    return append_hint(finding.advice + offered, spelled)


def action(code: str) -> str:
    """Action for a finding or an error that many units of a fleet have; empty if the catalogue has none.

    >>> action("coverage"), action("unit")
    ('turn the sensor through the directions without readings too', 'give all files of a unit in one unit of field')
    """
    row = CATALOGUE.get(code)
    if row is None:
        return REFUSALS[code].action if code in REFUSALS else ""
    return row.fleet_action or LINK.sub(r"\1", row.action).replace("`", "")
