"""The three verdicts: what each means, and how a command ends that gives it.

>>> {verdict: meaning.exit_code for verdict, meaning in MEANINGS.items()}
{'good': 0, 'limited': 3, 'refused': 4}
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

Verdict = Literal["good", "limited", "refused"]


class Meaning(NamedTuple):
    """What a verdict means."""

    exit_code: int  #: of the command that gives it
    title: str
    words: str


MEANINGS: Final[dict[Verdict, Meaning]] = {
    "good": Meaning(0, "Good", "the heading error is within the target; the calibration is written"),
    "limited": Meaning(
        3, "Limited", "the calibration is written; its first sentence says what is not known, or above the target"
    ),
    "refused": Meaning(4, "Refused", "no calibration is written; the first sentence says why, and what to do"),
}
"""The verdicts, for the terminal, pages, reports and fleets; `flinders.findings.headline` has their first sentences."""
