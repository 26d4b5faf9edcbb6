"""Ageing of a calibration: its heading error at a later date, by the random walk of its offset.

>>> from datetime import UTC, datetime, timedelta
>>> from flinders import simulate
>>> from flinders.core.offset_walk import Walk
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> made = datetime(2026, 5, 1, tzinfo=UTC)
>>> aged = age_of(fit, made + timedelta(days=1), since=made, walk=Walk.from_rate(0.002))
>>> aged.answer, aged.claim_deg > aged.until.claim_deg
('holds', True)
>>> age_of(fit, made + timedelta(days=365), since=made, walk=Walk.from_rate(0.1)).answer
'cannot-tell'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec

from flinders.errors import UsageError
from flinders.fitting.good_until import good_until, recording_date

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.core.offset_walk import Walk
    from flinders.fitting.good_until import GoodUntil
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer


@dataclass(frozen=True, slots=True)
class AgedCalibration:
    """A calibration at a later date: its heading error at first and then, and when the error has doubled."""

    name: str  #: name of the calibration in messages
    since: datetime  #: date of the recording; without one, date of the file
    at: datetime  #: date for which the heading error is computed
    until: GoodUntil  #: growth of the claim over time

    @property
    def seconds(self) -> float:
        """Age of the calibration at the date, in s; 0 for a date before it was made."""
        return max((self.at - self.since).total_seconds(), 0.0)

    @property
    def claim_deg(self) -> float:
        """Worst heading error at the date, 1 σ in degrees, by the median rate of the walk."""
        return self.until.claim_deg_after(self.seconds)

    @property
    def claim_range_deg(self) -> tuple[float, float]:
        """Worst heading errors at the date, 1 σ in degrees, by the low and by the high end of the walk's rate."""
        walk = self.until.walk
        return self.until.claim_deg_after(self.seconds, walk.low), self.until.claim_deg_after(self.seconds, walk.high)

    @property
    def answer(self) -> Answer:
        """``holds`` while the heading error is within the target, then ``cannot-tell``: age alone proves no fault.

        If the error exceeded the target from the start, the answer is ``holds`` until the error has doubled.
        """
        return "holds" if self.seconds <= self.until.good_s else "cannot-tell"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        low, high = self.claim_range_deg
        return {
            "answer": self.answer,  # ``holds`` within the target, or until the claim has doubled; else ``cannot-tell``
            "since": self.since.isoformat(),  # date of the recording, else of the file
            "at": self.at.isoformat(),  # date for which the claim is computed
            "age_s": self.seconds,  # from `since` to `at`
            "claimed_deg": self.until.claim_deg,  # worst heading error as claimed at first, 1 σ
            "claim_deg": self.claim_deg,  # worst heading error at the date, 1 σ, by the middle rate of the walk
            "claim_low_deg": low,  # by the slow end of the rate
            "claim_high_deg": high,  # by the fast end of the rate
            "good_until": msgspec.to_builtins(self.until.to_record(self.since)),  # as in the file
        }

    def __repr__(self) -> str:
        return f"Aged({self.answer}: {self.until.claim_deg:.2g}° then, {self.claim_deg:.2g}° at {self.at:%Y-%m-%d})"


def age_of(fit: Fit, at: datetime, *, since: datetime | None = None, walk: Walk | None = None) -> AgedCalibration:
    """Heading error of a calibration at a later date, if nothing on the vehicle was moved.

    Parameters
    ----------
    at : datetime
        The date, with a time zone.
    since : datetime, optional
        Start of the ageing; by default the date of the recording in the calibration file, else the date of the file.
    walk : Walk, optional
        Random walk of the offset, as for `flinders.fitting.good_until.good_until`.

    Raises
    ------
    UsageError
        For a calibration without a claimed heading error, or without a date.
    """
    name, made = fit.provenance.name, since or recording_date(fit.provenance.record)
    until = good_until(fit, walk=walk)
    if until is None:
        raise UsageError(f"{name} states no heading error that could grow with its age: check it on a recording")
    if made is None:
        raise UsageError(f"{name} states no date: check it on a recording")
    return AgedCalibration(name, made, at, until)
