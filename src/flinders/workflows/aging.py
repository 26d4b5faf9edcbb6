"""How far a calibration has aged: what its claim has grown to at a moment, by the walk of its offset.

>>> from datetime import UTC, datetime, timedelta
>>> from flinders import simulate
>>> from flinders.core.offset_walk import Walk
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> made = datetime(2026, 5, 1, tzinfo=UTC)
>>> aged = age_of(fit, made + timedelta(days=1), since=made, walk=Walk.known(0.002))
>>> aged.answer, aged.claim_deg > aged.until.claim_deg
('holds', True)
>>> age_of(fit, made + timedelta(days=365), since=made, walk=Walk.known(0.1)).answer
'cannot-tell'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from flinders.errors import UsageError
from flinders.fitting.good_until import good_until, since_of

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.core.offset_walk import Walk
    from flinders.fitting.good_until import GoodUntil
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer


@dataclass(frozen=True, slots=True)
class Aged:
    """A calibration at a moment: what it claimed, what of that is left, and when the claim has doubled."""

    name: str  #: what messages call the calibration
    since: datetime  #: when its readings were recorded, else when its file was made
    at: datetime  #: the moment that is asked about
    until: GoodUntil  #: when the claim has doubled

    @property
    def seconds(self) -> float:
        """Age then; 0 of a moment before it was made."""
        return max((self.at - self.since).total_seconds(), 0.0)

    @property
    def claim_deg(self) -> float:
        """Worst heading error then, 1 σ, by the middle rate of the walk."""
        return self.until.claim_deg_after(self.seconds)

    @property
    def claim_range_deg(self) -> tuple[float, float]:
        """The same by the slow and the fast end of the walk."""
        walk = self.until.walk
        return self.until.claim_deg_after(self.seconds, walk.low), self.until.claim_deg_after(self.seconds, walk.high)

    @property
    def answer(self) -> Answer:
        """``holds`` while the claim is within the target, then ``cannot-tell``: age alone shows no fault.

        Of a claim that was beyond the target when it was made, until it has doubled.
        """
        return "holds" if self.seconds <= self.until.good_s else "cannot-tell"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        low, high = self.claim_range_deg
        return {
            "answer": self.answer,  # ``holds`` within the target, or until the claim has doubled; else ``cannot-tell``
            "since": self.since.isoformat(),  # when the readings were recorded, else when the file was made
            "at": self.at.isoformat(),  # the moment that is asked about
            "age_s": self.seconds,  # from the one to the other
            "claimed_deg": self.until.claim_deg,  # worst heading error that was claimed, 1 σ
            "claim_deg": self.claim_deg,  # the same now, by the middle rate of the walk
            "claim_low_deg": low,  # by the slow end of what the rate may be
            "claim_high_deg": high,  # by the fast end
            "good_until": msgspec.to_builtins(self.until.to_record(self.since)),  # as in the file
        }

    def __repr__(self) -> str:
        return f"Aged({self.answer}: {self.until.claim_deg:.2g}° then, {self.claim_deg:.2g}° at {self.at:%Y-%m-%d})"


def age_of(fit: Fit, at: datetime, *, since: datetime | None = None, walk: Walk | None = None) -> Aged:
    """What is left of a calibration at a moment, if nothing was moved.

    Parameters
    ----------
    at : datetime
        The moment, with a time zone.
    since : datetime, optional
        When it was true; by default when its file says that its readings were recorded, else when it was made.
    walk : Walk, optional
        As for `flinders.fitting.good_until.good_until`.

    Raises
    ------
    UsageError
        For a calibration that claims nothing, or does not say when it was made.
    """
    name, made = fit.provenance.name, since or since_of(fit.provenance.record)
    until = good_until(fit, walk=walk)
    if until is None:
        raise UsageError(f"{name} claims no heading error, which could grow: check it on a recording")
    if made is None:
        raise UsageError(f"{name} does not say when it was made: check it on a recording")
    return Aged(name, made, at, until)
