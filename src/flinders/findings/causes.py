"""Findings that follow from others: who removes the cause need not read of them.

>>> from flinders.findings import Finding
>>> found = [Finding(code, "limits", 1.0, 0.0, "…") for code in ("noise", "coverage", "axis-swap")]
>>> [finding.code for finding in first_causes(found)]
['axis-swap', 'coverage']
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.findings.row import VERDICTS, Finding, by_severity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.findings.row import Severity

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
