"""Events and states of an online calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.findings.rules import limit_of
from flinders.workflows.timeline import UNKNOWN_VECTOR, Code, Doing

if TYPE_CHECKING:
    from flinders.verdicts import Verdict

ACTIVITIES: Final[tuple[Doing, ...]] = ("learning", "undisturbed", "disturbed")
"""States of the readings; the place of each is its number in the engine."""
CODES: Final[dict[int, Code]] = {
    1: "learnt", 2: "contradicted", 4: "passed", 8: "moved", 16: "adopted", 32: "clock-back"
}  # fmt: skip
"""Codes of events, by their bits in the engine."""

WORDS: Final[dict[Code, str]] = {
    "learnt": "a first calibration was found",
    "contradicted": "readings no longer agree with the calibration: iron passes, or the offset has moved",
    "passed": "readings agree with the calibration again: iron passed",
    "moved": "the offset has moved, and was learnt again",
    "adopted": "another calibration is in force",
    "clock-back": "the clock went back: readings are left out until it reaches its previous time",
    "taken-back": "the previous calibration is in force again",
    "other-release": "the state is from another release and is used without its evidence",
}
"""Sentence of each event."""


@dataclass(frozen=True, slots=True)
class OnlineEvent:
    """An event of an online calibration."""

    time_s: float  #: time in s of the reading at which it was detected
    code: Code
    heading_error_deg: float  #: claimed worst heading error after the event, 1 σ; NaN without a calibration in force

    def __str__(self) -> str:
        return WORDS[self.code]


@dataclass(frozen=True, slots=True)
class OnlineState:
    """State of an online calibration at a time; numbers are NaN if no calibration is in force."""

    time_s: float
    doing: Doing  #: ``learning`` without a calibration; ``disturbed`` if readings contradict it
    heading_error_deg: float  #: expected worst heading error of a level vehicle with the calibration in force, 1 σ
    bound_deg: float  #: 95 % bound of the heading error at all headings
    latest_deg: float  #: heading error with the newest calibration, even if it is not in force
    age_s: float  #: time in s since the last reading with information about the calibration
    walk: float  #: motion of the offset in an hour, 1 σ, in µT; in counts if no scale is known
    target_deg: float
    #: newest estimate of the offset, as in `Calibration.offset`, even if it is not in force: µT or counts
    offset: tuple[float, float, float] = UNKNOWN_VECTOR
    offset_sigma: tuple[float, float, float] = UNKNOWN_VECTOR  #: 1 σ of each component of `offset`
    radius: float = math.nan  #: mean length of readings about the offset, in the unit of `offset`

    @property
    def verdict(self) -> Verdict:
        """``good`` within the target, ``limited`` up to five times it; else, or without calibration, ``refused``."""
        if not self.heading_error_deg <= limit_of("heading-error", "refuses") * self.target_deg:
            return "refused"
        return "good" if self.heading_error_deg <= self.target_deg else "limited"
