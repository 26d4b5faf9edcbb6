"""The three verdicts: the meaning of each, and the exit code of a command that gives it.

>>> {verdict: meaning.exit_code for verdict, meaning in MEANINGS.items()}
{'good': 0, 'limited': 3, 'refused': 4}
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

Verdict = Literal["good", "limited", "refused"]


class Meaning(NamedTuple):
    """Meaning of a verdict."""

    exit_code: int  #: exit code of a command that gives this verdict
    title: str
    words: str


MEANINGS: Final[dict[Verdict, Meaning]] = {
    "good": Meaning(0, "Good", "the heading error is within the target; the calibration is written"),
    "limited": Meaning(
        3, "Limited", "the calibration is written; its first sentence says what is unknown, or above the target"
    ),
    "refused": Meaning(4, "Refused", "no calibration is written; the first sentence says why, and what to do"),
}
"""Verdicts for terminal, pages, reports and fleets; `flinders.findings.headline` writes their first sentences."""
