"""Application of the catalogue's rules by the engine.

>>> [finding.code for finding in findings_in({"axis_ratio": 3.0, "step": 0.0}, "axis-ratio", "quantised")]
['axis-ratio']

A finding that follows from another one is not shown: once the cause is removed, it disappears.

>>> given = [Finding(code, "limits", {}) for code in ("noise", "coverage", "axis-swap")]
>>> [finding.code for finding in first_causes(link_causes(given))]
['axis-swap', 'coverage']
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.findings.catalogue import CATALOGUE, ENGINE_FINDINGS, QUANTITIES, RULES
from flinders.findings.finding import Finding, by_severity, make_finding
from flinders.findings.row import CAUSES, VERDICTS
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Iterator, Mapping

    from flinders.findings.row import Severity
    from flinders.native.layouts import Records

SEVERITIES: Final[tuple[Severity | None, ...]] = (None, *reversed(VERDICTS))
"""Severities in the order of their numbers in the engine; the first is no finding."""

_RULES: Final = {code: number for number, code in enumerate(RULES)}
_FIT_NUMBERS: Final = {code: number for number, code in enumerate(ENGINE_FINDINGS)}
_QUANTITIES: Final = {name: number for number, name in enumerate(QUANTITIES)}


def finding_in(record: Mapping[str, Any], code: str) -> Finding | None:
    """A finding about a record; None if its rule does not apply.

    Parameters
    ----------
    record : mapping
        Quantities of the rule by name, and the other values of the sentence.
    """
    rule = CATALOGUE[code].rule
    quantities = np.full(len(QUANTITIES), np.nan)
    for name in rule.compared_quantities:
        quantities[_QUANTITIES[name]] = record[name]
    severity = SEVERITIES[engine().severity(_RULES[code], quantities)]
    return None if severity is None else make_finding(code, record, severity)


def findings_in(record: Mapping[str, Any], *codes: str) -> Iterator[Finding]:
    """Yield those findings among the given codes whose rules apply to a record."""
    return (finding for code in codes if (finding := finding_in(record, code)) is not None)


def certain_finding(record: Mapping[str, Any], code: str) -> Finding:
    """A finding about a record to which its rule is known to apply."""
    finding = finding_in(record, code)
    assert finding is not None
    return finding


def link_causes(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Combine findings of several judgements of one fit: sorted by severity, each with the code of its cause."""
    given = by_severity(findings)
    severities = np.zeros(len(ENGINE_FINDINGS), dtype=np.uint8)
    for finding in given:
        if (rule := _FIT_NUMBERS.get(finding.code)) is not None:
            severities[rule] = max(int(severities[rule]), SEVERITIES.index(finding.severity))
    causes = causes_of(engine().causes(severities))
    return tuple(replace(finding, follows_from=causes.get(finding.code)) for finding in given)


def causes_of(judgement: Records) -> dict[str, str]:
    """Code of the cause, by the code of the finding that follows from it, in a judgement."""
    causes = judgement["causes"].tolist()
    return {
        ENGINE_FINDINGS[rule]: ENGINE_FINDINGS[cause - 1]
        for rule, cause in enumerate(causes)
        if cause and cause != rule + 1
    }


def first_causes(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings that follow from no other, the most severe first; a cause counts as severe as its worst consequence.

    `findings` are those of one fit.
    """
    given = tuple(findings)
    worst = {finding.follows_from: finding.severity for finding in reversed(by_severity(given)) if finding.follows_from}
    there = {finding.code for finding in given}
    shown = [finding for finding in given if finding.follows_from is None]
    shown.sort(key=lambda finding: _place(finding, there))
    return by_severity(replace(one, severity=_more_severe(one.severity, worst.get(one.code))) for one in shown)


def _place(finding: Finding, there: Container[str]) -> int:
    """Rank of a finding among the causes; the last rank if it is not severe enough to be a cause."""
    for place, cause in enumerate(CAUSES):
        is_severe = SEVERITIES.index(finding.severity) >= SEVERITIES.index(cause.severity)
        if finding.code == cause.code and is_severe and cause.unless not in there:
            return place
    return len(CAUSES)


def _more_severe(one: Severity, other: Severity | None) -> Severity:
    """The more severe of two severities."""
    return one if other is None else max(one, other, key=SEVERITIES.index)


def limit_of(code: str, name: Severity | str = "limits") -> float:
    """Factor of a rule's limit, by severity or by a further quantity that the rule compares.

    >>> limit_of("coverage"), limit_of("heading-error", "refuses"), limit_of("field-changed", "drift_by_chance")
    (60.0, 5.0, 0.0001)
    """
    rule = CATALOGUE[code].rule
    limits = {grade.severity: grade.factor for grade in rule.grades} | {
        need.quantity: need.factor for need in rule.needs
    }
    return limits[name]
