"""One thing to know about a result: a stable code, a severity, a number, and what to do.

>>> Finding("noise", "limits", 0.08, 0.05, "record away from iron").as_dict()["code"]
'noise'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable

Severity = Literal["note", "limits", "refuses"]
Verdict = Literal["good", "limited", "refused"]

VERDICTS: Final[dict[Severity, Verdict]] = {"refuses": "refused", "limits": "limited", "note": "good"}
"""What each severity makes of a fit, the gravest first."""


ONE_PLANE: Final = "one-plane"
"""The finding that no surface is supported by these readings, so that nothing which rests on one means anything."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something to know about a fit.

    Attributes
    ----------
    code : str
        Stable name, one of `flinders.fitting.verdict.CODES`.
    severity : str
        ``note``: good to know; ``limits``: the calibration holds with limits; ``refuses``: it is not given.
    number : float
        What was found; its meaning and unit belong to the code.
    limit : float
        What it was held against.
    advice : str
        What was found, and what to do, in a sentence.
    """

    code: str
    severity: Severity
    number: float
    limit: float
    advice: str

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {name: getattr(self, name) for name in self.__slots__}


def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Put findings in order of severity, those of one severity as they came."""
    order = list(VERDICTS)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
