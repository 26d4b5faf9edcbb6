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
"""States of the readings, in the order of the engine's numbers."""
CODES: Final[dict[int, Code]] = {
    1: "learnt", 2: "contradicted", 4: "passed", 8: "moved", 16: "adopted", 32: "clock-back"
}  # fmt: skip
"""Codes of events, by the engine's bits."""

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

    time_s: float  #: time of the reading at which it was detected
    code: Code
    heading_error_deg: float  #: claimed after the event, worst heading, 1 σ; NaN without a calibration in force

    def __str__(self) -> str:
        return WORDS[self.code]


@dataclass(frozen=True, slots=True)
class OnlineState:
    """State at a time; numbers are NaN if no calibration is in force."""

    time_s: float
    doing: Doing  #: ``learning`` without a calibration; ``disturbed`` if readings contradict it
    heading_error_deg: float  #: expected for a level vehicle with the calibration in force, worst heading, 1 σ
    bound_deg: float  #: 95 % bound of the error at all headings
    latest_deg: float  #: heading error with the newest calibration, which may not be in force
    age_s: float  #: time since the last reading with information on the calibration
    walk: float  #: motion of the offset in an hour, 1 σ, in µT, or in counts if no scale is known
    target_deg: float
    #: newest estimate, in force or not, as `Calibration.offset`: µT or counts
    offset: tuple[float, float, float] = UNKNOWN_VECTOR
    offset_sigma: tuple[float, float, float] = UNKNOWN_VECTOR  #: 1 σ of each of its components
    radius: float = math.nan  #: mean length of readings about the offset, in the same unit

    @property
    def verdict(self) -> Verdict:
        """``good`` within the target, ``refused`` beyond five times the target or without a calibration."""
        if not self.heading_error_deg <= limit_of("heading-error", "refuses") * self.target_deg:
            return "refused"
        return "good" if self.heading_error_deg <= self.target_deg else "limited"
