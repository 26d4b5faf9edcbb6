"""How long a calibration is good: until its claim reaches the target or has doubled, by walk and by temperature.

The offset walks by q √t along each axis, and moves by c ΔT. A level heading of a field with the horizontal part H is
then uncertain by

    σ² = σ₀² + (q² t + c² ΔT²) / H²

and has doubled, σ = 2 σ₀, where either term is 3 σ₀². It is good until σ is the target. Neither rate is known of a unit
without a history: q is then what a calibration that goes on assumes of any unit, and c spans what data sheets state.
Both are ranges of 95 %.

Sources of c: 0.8 µT/K, typical, of the FXOS8700CQ (NXP, data sheet rev. 8, table 4, as quoted by an owner who measured
0.73), 0.003 µT/K of a factory-compensated module (CGM92AD10).

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> until = good_until(fit)
>>> until.by, until.earliest_s < until.seconds < until.latest_s
('prior', True)
>>> good_until(fit, walk=Walk.known(0.01)).seconds > 100.0 * until.seconds                # µT in an hour
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np

from flinders.core.calibration_file import GoodUntilRecord, WalkRecord
from flinders.core.durations import duration
from flinders.core.offset_walk import HOUR_S, PRIOR_WALK, Walk
from flinders.core.units import MICROTESLA
from flinders.errors import figures
from flinders.fitting.claim import parameters_of

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.fitting.claim import Claim
    from flinders.fitting.evidence import Evidence

GROWTH: Final = 3.0
"""Added variance, over that of the claim, of a claim that has doubled."""

PRIOR_PER_KELVIN: Final = Walk(0.05, 0.003, 0.8)
"""µT/K: offset by temperature of a sensor that does not follow it; middle and ends of what data sheets state."""
USUAL_FIELD_UT: Final = 50.0
"""µT that counts are taken to span, where a temperature coefficient in µT meets readings in counts."""

LATEST_S: Final = 100 * 365.25 * 86400.0
"""Seconds beyond which nothing is said of a time."""

MOST_KELVIN: Final = 100.0
"""K beyond which a change of temperature is not told: no sensor meets it."""

DIGITS: Final = 3
"""Digits of what is stored: a rate is known within a factor."""


class Remembering(Protocol):
    """What a fit knows of its unit."""

    @property
    def walk(self) -> Walk | None:
        """How fast its offset walks, where its history is known."""


class Described(Protocol):
    """A fit, as far as its age is judged."""

    @property
    def calibration(self) -> Calibration:
        """The correction."""

    @property
    def claim(self) -> Claim:
        """What is claimed of it."""

    @property
    def evidence(self) -> Evidence:
        """How it was found."""

    @property
    def provenance(self) -> Remembering:
        """What is known of the unit."""

    @property
    def verdict(self) -> str:
        """``good``, ``limited`` or ``refused``."""


@dataclass(frozen=True, slots=True)
class GoodUntil:
    """How long a claim stays within its target, and when it has doubled: a middle time and its 95 % range."""

    claim_deg: float  #: worst heading error of a level vehicle now, 1 σ
    field: float  #: horizontal part of the field, in the calibration's unit
    walk: Walk  #: of the offset, in the calibration's unit
    by: Literal["history", "prior"]  #: whose walk: this unit's, or what is usual
    per_kelvin: Walk | None  #: offset by temperature, in the calibration's unit per K; None where it is not known
    temperature_by: Literal["followed", "prior"]  #: whether the fit follows the temperature
    target_deg: float = math.inf  #: worst heading error that is good enough

    @property
    def seconds(self) -> float:
        """Until the claim has doubled, by the middle rate; at most a hundred years."""
        return self._seconds(GROWTH, self.walk.rate)

    @property
    def earliest_s(self) -> float:
        """The same by the fast end of the walk."""
        return self._seconds(GROWTH, self.walk.high)

    @property
    def latest_s(self) -> float:
        """The same by the slow end of the walk."""
        return self._seconds(GROWTH, self.walk.low)

    @property
    def target_s(self) -> float | None:
        """When the claim reaches the target, by the middle rate; None of one that is beyond it already."""
        return None if self._target_growth is None else self._seconds(self._target_growth, self.walk.rate)

    @property
    def good_s(self) -> float:
        """Until the claim reaches the target; of one that is beyond it already, until it has doubled."""
        return self.seconds if self.target_s is None else self.target_s

    @property
    def temperature_change_kelvin(self) -> float | None:
        """Until it has doubled: from the recording's temperature, or the reference of a fit that follows it."""
        return None if self.per_kelvin is None else self._shift(GROWTH) / self.per_kelvin.rate

    @property
    def temperature_range_kelvin(self) -> tuple[float, float] | None:
        """By the ends of what the coefficient may be."""
        if self.per_kelvin is None:
            return None
        return self._shift(GROWTH) / self.per_kelvin.high, self._shift(GROWTH) / self.per_kelvin.low

    def claim_deg_after(self, seconds: float, rate: float | None = None) -> float:
        """Worst heading error, 1 σ, after a time at a rate of the walk; by default the middle one."""
        moved = (self.walk.rate if rate is None else rate) * math.sqrt(max(seconds, 0.0) / HOUR_S)
        return min(math.hypot(self.claim_deg, math.degrees(moved / self.field)), 180.0)

    def doubled_date(self, since: datetime) -> datetime:
        """When the claim has doubled, of a calibration that was made at a time."""
        return since + timedelta(seconds=round(self.seconds))

    def to_record(self, since: datetime | None = None) -> GoodUntilRecord:
        """What a calibration file and JSON state."""
        low, high = self.temperature_range_kelvin or (None, None)
        return GoodUntilRecord(
            doubled_hours=_rounded(self.seconds / HOUR_S),
            doubled_hours_low=_rounded(self.earliest_s / HOUR_S),
            doubled_hours_high=_rounded(self.latest_s / HOUR_S),
            doubled_date=None if since is None else self.doubled_date(since).replace(microsecond=0),
            target_hours=None if self.target_s is None else _rounded(self.target_s / HOUR_S),
            by=self.by,
            temperature_change_kelvin=_rounded(self.temperature_change_kelvin),
            temperature_change_low_kelvin=_rounded(low),
            temperature_change_high_kelvin=_rounded(high),
            temperature_by=self.temperature_by,
        )

    def __str__(self) -> str:
        """With both ends of the temperature, and when the claim has doubled."""
        lasts = f"{self._until}{self._durations}{self._kelvins(self._growth)}"
        if self._target_growth is None:
            return lasts
        return f"{lasts}; the claim doubles in {duration(self.seconds)}{self._kelvins(GROWTH, has_ends=False)}"

    @property
    def brief(self) -> str:
        """How long, on a line."""
        return f"{self._until}{self._durations}{self._kelvins(self._growth, has_ends=False)}"

    @property
    def range_words(self) -> str:
        """Range of `good_s`, whose walk it is, and the change of temperature that does as much."""
        return f"{self._walk_words} ({self._ends}){self._kelvins(self._growth, has_ends=False)}"

    @property
    def _until(self) -> str:
        """What lasts."""
        return "the claim doubles in " if self._target_growth is None else f"within {self.target_deg:g}° for "

    @property
    def _growth(self) -> float:
        """Added variance, over that of the claim, until which it is good."""
        return GROWTH if self._target_growth is None else self._target_growth

    @property
    def _walk_words(self) -> str:
        return "as this unit's offset walks" if self.by == "history" else "as offsets usually walk"

    @property
    def _ends(self) -> str:
        """Range of the time, by the ends of the walk."""
        return " to ".join(duration(self._seconds(self._growth, rate)) for rate in (self.walk.high, self.walk.low))

    @property
    def _durations(self) -> str:
        """The time, whose walk it is, and its range."""
        return f"{duration(self.good_s)} {self._walk_words} ({self._ends})"

    def _kelvins(self, growth: float, *, has_ends: bool = True) -> str:
        """The change of temperature of a growth; nothing where it is not known."""
        if self.per_kelvin is None:
            return ""
        shift = self._shift(growth)
        change = f", or {figures(shift / self.per_kelvin.rate)} K"
        if not has_ends:
            return f"{change} warmer or colder"
        if self.temperature_by == "followed":
            return f"{change} from the middle of the temperatures"
        low, most = figures(shift / self.per_kelvin.high), shift / self.per_kelvin.low
        high = figures(most) if most <= MOST_KELVIN else f"more than {MOST_KELVIN:.0f}"
        return f"{change} warmer or colder ({low} to {high} K)"

    @property
    def _target_growth(self) -> float | None:
        """Added variance at the target, over that of the claim; None of a claim that is beyond it."""
        is_within = self.claim_deg < self.target_deg < math.inf
        return (self.target_deg / self.claim_deg) ** 2 - 1.0 if is_within else None

    def _shift(self, growth: float) -> float:
        """What the offset may move by until the variance has grown so much, in the calibration's unit."""
        return math.sqrt(growth) * math.radians(self.claim_deg) * self.field

    def _seconds(self, growth: float, rate: float) -> float:
        """When that walks by so much at a rate; at most a hundred years."""
        return min(HOUR_S * (self._shift(growth) / rate) ** 2, LATEST_S)


def good_until(fit: Described, *, walk: Walk | None = None) -> GoodUntil | None:
    """When the claim of a fit will have doubled; None of one that claims nothing or is refused.

    Parameters
    ----------
    walk : Walk, optional
        How fast the offset of this unit walks, in the calibration's unit, as `flinders.OffsetHistory.walk` has it; by
        default what the fit knows (`Provenance.walk`), else what is usual: 0.65 % of the field in an hour, 0.03 to 2 %.

    Examples
    --------
    See the head of this module.
    """
    claim, calibration = fit.claim, fit.calibration
    worst = claim.heading_error_deg.worst
    if fit.verdict == "refused" or not claim.states_uncertainty or not worst > 0.0:
        return None
    known = fit.provenance.walk if walk is None else walk
    field = calibration.ellipsoid.radius
    followed = next((each for each in calibration.disturbances if each.name == "temperature"), None)
    return GoodUntil(
        claim_deg=worst,
        field=field * math.cos(math.radians(claim.known_dip_deg)),
        walk=PRIOR_WALK.scaled(field) if known is None else known,
        by="prior" if known is None else "history",
        per_kelvin=_usual_per_kelvin(fit) if followed is None else _followed_per_kelvin(fit),
        temperature_by="prior" if followed is None else "followed",
        target_deg=claim.target_deg,
    )


def since_of(provenance: ProvenanceRecord | None) -> datetime | None:
    """When the readings of a calibration were recorded, else when it was made; None where its file says neither."""
    if provenance is None:
        return None
    return provenance.recorded or provenance.date  # UNSET is false


def walk_record(walk: Walk) -> WalkRecord:
    """A walk as it stands in a file."""
    return WalkRecord(rate=walk.rate, low=walk.low, high=walk.high)


def _usual_per_kelvin(fit: Described) -> Walk:
    """What data sheets state, in the calibration's unit; of counts as a share of a usual field."""
    calibration = fit.calibration
    is_microtesla = calibration.unit == MICROTESLA
    return PRIOR_PER_KELVIN if is_microtesla else PRIOR_PER_KELVIN.scaled(calibration.ellipsoid.radius / USUAL_FIELD_UT)


def _followed_per_kelvin(fit: Described) -> Walk | None:
    """1 σ of the followed coefficient along its least known axis; None where the file has no covariance of it."""
    whole = fit.evidence.disturbances.covariance
    if whole is None:
        return None
    names = parameters_of(fit.calibration)
    rows = [names.index(f"temperature_C_{axis}") for axis in "xyz"]
    sigma = math.sqrt(max(float(np.linalg.eigvalsh(whole[np.ix_(rows, rows)])[-1]), 0.0))
    return Walk(sigma, sigma, sigma) if sigma > 0.0 else None


def _rounded(number: float | None) -> Any:  # noqa: ANN401 - None stays None
    """To so many digits as are known."""
    return None if number is None else float(f"{number:.{DIGITS}g}")
