"""Meanings of codes, for the terminal, pages and files next to a finding or an error.

>>> told = explain("coverage")
>>> told.verdict, told.meaning.partition(". ")[0]
('limited', 'Some directions are N° from the nearest reading')
>>> explain("heading-error").meaning.partition(":")[0]
'The heading may be off by more than the target'
>>> explain("field-strength").meaning.partition(". ")[0], explain("axis-swap").action.partition(". ")[2]
('The field strength in the readings, N µT, occurs nowhere on earth', 'A swap throughout the recording cannot be \
detected.')
>>> explain("coverge")
Traceback (most recent call last):
flinders.errors.UsageError: there is no finding or error 'coverge': did you mean coverage?
>>> explain("limited")
Traceback (most recent call last):
flinders.errors.UsageError: 'limited' is a verdict: the calibration is written; its first sentence says what is \
unknown, or above the target. Codes of findings are in brackets after them
"""

from __future__ import annotations

import difflib
from dataclasses import asdict, dataclass
from typing import Any, Final

from flinders.errors import UsageError
from flinders.findings import LINK
from flinders.findings.catalogue import CATALOGUE
from flinders.findings.refusal import REFUSALS
from flinders.findings.row import VERDICTS
from flinders.findings.words import as_sentence
from flinders.verdicts import MEANINGS


@dataclass(frozen=True, slots=True)
class Explanation:
    """Meaning of the code of a finding, or of an error in place of a fit."""

    code: str
    meaning: str  #: meaning for the user of the compass; N stands for the number of the finding
    #: its effect on a fit: ``good``, ``limited`` or ``refused``, with conditions; empty for errors of files or options
    verdict: str
    number: str  #: meaning and unit of the number; empty for an error
    limit: str  #: limit for the number; empty for an error
    action: str  #: what to do
    anchor: str  #: anchor in the documentation; empty for an error

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)


def explain(code: str) -> Explanation:
    """Explain a code: its meaning, number, limit and action.

    Parameters
    ----------
    code : str
        Code of a finding (``fit.findings[0].code``), or of an error (``error.code``).

    Raises
    ------
    UsageError
        For an unknown code.
    """
    if row := CATALOGUE.get(code):
        return Explanation(
            code,
            row.plain.format_map(_Named()),
            _verdict(row.severities),
            LINK.sub(r"\1", row.number),
            row.limit_words,
            as_sentence(LINK.sub(r"\1", row.action)),
            f"docs/findings.md#{code}",
        )
    if refusal := REFUSALS.get(code):
        action = as_sentence(refusal.remedy or refusal.action)
        words = refusal.plain.format_map(_Named()) or refusal.meaning
        return Explanation(code, words, VERDICTS["refuses"] if refusal.plain else "", "", "", action, "")
    for verdict, meaning in MEANINGS.items():
        if code == verdict:
            raise UsageError(f"{code!r} is a verdict: {meaning.words}. Codes of findings are in brackets after them")
    near = difflib.get_close_matches(code, [*CATALOGUE, *REFUSALS], n=1)
    hint = f"did you mean {near[0]}?" if near else "codes are in brackets after a finding"
    raise UsageError(f"there is no finding or error {code!r}: {hint}")


def _verdict(severities: str) -> str:
    """Verdict for a row's severities: ``note; limits above the target`` becomes ``good; limited above the target``."""
    for severity, verdict in VERDICTS.items():
        severities = severities.replace(severity, verdict)
    return severities


PLACEHOLDERS: Final = {
    "number": "N",
    "seconds": "N",
    "angle": "N°",
    "length": "N µT",
    "why_large": (
        "The heading may be off by more than the target: too few readings for their noise, too few directions, or "
        "recordings that contradict each other"
    ),
}
"""Examples or letters for values of a sentence; all other values become an ellipsis."""


class _Named(dict[str, Any]):
    """Values for an explanation: each formats as its placeholder, whatever the format."""

    def __missing__(self, name: str) -> _Name:
        return _Name(PLACEHOLDERS.get(name, "…"))


class _Name(str):
    __slots__ = ()

    def __format__(self, spec: str) -> str:
        return f"{self} %" if spec.endswith("%") else str(self)
