"""The rules of the catalogue, as the engine applies them.

>>> [finding.code for finding in found_in({"axis_ratio": 3.0, "step": 0.0}, "axis-ratio", "quantised")]
['axis-ratio']

Findings that follow from others are not shown: who removes the cause need not read of them.

>>> given = [Finding(code, "limits", 1.0, 0.0, "…") for code in ("noise", "coverage", "axis-swap")]
>>> [finding.code for finding in first_causes(given)]
['axis-swap', 'coverage']
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.findings.catalogue import CATALOGUE, OF_A_FIT, QUANTITIES, RULES
from flinders.findings.row import VERDICTS, Finding, by_severity
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from flinders.findings.row import Severity

SEVERITIES: Final[tuple[Severity | None, ...]] = (None, *reversed(VERDICTS))
"""Severities by the engine's numbers."""

_RULES: Final = {code: number for number, code in enumerate(RULES)}
_OF_A_FIT: Final = {code: number for number, code in enumerate(OF_A_FIT)}
_QUANTITIES: Final = {name: number for number, name in enumerate(QUANTITIES)}


def finding_in(record: Mapping[str, Any], code: str) -> Finding | None:
    """A finding of a record; None where its rule does not hold.

    Parameters
    ----------
    record : mapping
        Quantities of the rule by name, and what the sentence takes.
    """
    row = CATALOGUE[code]
    quantities = np.full(len(QUANTITIES), np.nan)
    for name in row.rule.compared:
        quantities[_QUANTITIES[name]] = record[name]
    severity = SEVERITIES[engine().severity(_RULES[code], quantities)]
    return None if severity is None else row.stated(record, severity)


def found_in(record: Mapping[str, Any], *codes: str) -> Iterator[Finding]:
    """Of some findings those whose rules hold for a record."""
    return (finding for code in codes if (finding := finding_in(record, code)) is not None)


def certain(record: Mapping[str, Any], code: str) -> Finding:
    """A finding of a record for which its rule holds."""
    finding = finding_in(record, code)
    assert finding is not None
    return finding


def first_causes(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings that follow from no other, by severity, causes first; a cause is as severe as what follows from it.

    `findings`: of one fit.
    """
    given = [(_OF_A_FIT.get(finding.code), finding) for finding in findings]
    severities = np.zeros(len(OF_A_FIT), dtype=np.uint8)
    for rule, finding in given:
        if rule is not None:
            severities[rule] = max(int(severities[rule]), SEVERITIES.index(finding.severity))
    judgement = engine().causes(severities)
    shown, causes = judgement["shown"], judgement["causes"]
    firsts = [rule for rule in judgement["order"].tolist() if rule < len(OF_A_FIT) and causes[rule] == rule + 1]
    first = [
        replace(finding, severity=SEVERITIES[int(shown[cause])] or finding.severity)
        for cause in firsts
        for rule, finding in given
        if rule == cause
    ]
    left = [finding for rule, finding in given if rule is None or (shown[rule] and rule not in firsts)]
    return by_severity([*first, *left])


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
