"""What happens to a calibration that keeps itself, and what is known of it at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.findings.rules import limit_of
from flinders.workflows.timeline import UNKNOWN, Code, Doing

if TYPE_CHECKING:
    from flinders.verdicts import Verdict

DOING: Final[tuple[Doing, ...]] = ("learning", "undisturbed", "disturbed")
"""By the engine's numbers."""
CODES: Final[dict[int, Code]] = {
    1: "learnt", 2: "contradicted", 4: "passed", 8: "moved", 16: "adopted", 32: "clock-back"
}  # fmt: skip
"""What happened, by the engine's bits."""

WORDS: Final[dict[Code, str]] = {
    "learnt": "a first calibration was found",
    "contradicted": "readings no longer agree with the calibration: something passes, or its offset has moved",
    "passed": "readings agree again: something passed",
    "moved": "the offset has moved, and was learnt anew",
    "adopted": "another calibration is in force",
    "clock-back": "the clock went back: readings are left out until it is where it was",
    "taken-back": "the calibration from before is in force again",
    "other-release": "the state of another release goes on without its evidence",
}
"""What each event means."""


@dataclass(frozen=True, slots=True)
class OnlineEvent:
    """Something that happened."""

    time_s: float  #: of the reading at which it was seen
    code: Code
    heading_error_deg: float  #: that is claimed after it, worst heading, 1 σ; NaN where nothing is in force

    def __str__(self) -> str:
        return WORDS[self.code]


@dataclass(frozen=True, slots=True)
class OnlineState:
    """What is known at a time. Numbers are NaN where no calibration is in force."""

    time_s: float
    doing: Doing  #: ``learning`` without a calibration; ``disturbed`` where readings contradict it
    heading_error_deg: float  #: to expect of a level vehicle with the calibration in force, worst heading, 1 σ
    bound_deg: float  #: that no heading exceeds with 95 %
    latest_deg: float  #: heading error with the newest calibration, which may not be in force
    age_s: float  #: since readings last told something of it
    walk: float  #: by which the offset moves in an hour, 1 σ, in µT, or counts where no scale is known
    target_deg: float
    #: newest estimate, in force or not, as `Calibration.offset`: µT or counts
    offset: tuple[float, float, float] = UNKNOWN
    offset_sigma: tuple[float, float, float] = UNKNOWN  #: 1 σ of each of its components
    radius: float = math.nan  #: mean length of readings about it, in the same unit

    @property
    def verdict(self) -> Verdict:
        """``good`` within the target, ``refused`` beyond five times the target or without a calibration."""
        if not self.heading_error_deg <= limit_of("heading-error", "refuses") * self.target_deg:
            return "refused"
        return "good" if self.heading_error_deg <= self.target_deg else "limited"
