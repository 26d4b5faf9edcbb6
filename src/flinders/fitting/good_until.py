"""How long a calibration stays good: the time until its claimed heading error reaches the target or doubles.

In a time t the offset of each axis changes by q √t (a random walk), and with a change ΔT of the temperature by c ΔT. In
a horizontal field H the variance of a level heading is then

    σ² = σ₀² + (q² t + c² ΔT²) / H²

with the claim σ₀ now. The claim has doubled, σ = 2 σ₀, when one of the two terms is 3 σ₀². The calibration is good
until σ reaches the target. For a unit without a history, q is the prior of the online calibration, and c has the range
of data sheets. Both are given as a middle value and a 95 % range.

Sources of c: 0.8 µT/K, typical, of the FXOS8700CQ (NXP, data sheet rev. 8, table 4, as quoted by an owner who measured
0.73), 0.003 µT/K of a factory-compensated module (CGM92AD10).

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> until = good_until(fit)
>>> until.by, until.earliest_s < until.seconds < until.latest_s
('prior', True)
>>> good_until(fit, walk=Walk.from_rate(0.01)).seconds > 100.0 * until.seconds                # µT in an hour
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np

from flinders.core.calibration_file import GoodUntilRecord, WalkRecord
from flinders.core.durations import duration_text
from flinders.core.language import ENGLISH
from flinders.core.offset_walk import HOUR_S, PRIOR_WALK, Walk
from flinders.core.units import MICROTESLA
from flinders.errors import figures
from flinders.fitting.claim import parameter_names

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.core.language import Language
    from flinders.fitting.claim import Claim
    from flinders.fitting.evidence import Evidence

DOUBLED_GROWTH: Final = 3.0
"""Variance that doubles the claim when it is added, relative to the variance of the claim."""

PRIOR_PER_KELVIN: Final = Walk(0.05, 0.003, 0.8)
"""Temperature coefficient of the offset in µT/K for a fit that does not follow it: middle and range of data sheets."""
USUAL_FIELD_UT: Final = 50.0
"""Assumed field strength in µT, by which the temperature coefficient is converted for readings in counts."""

MAX_S: Final = 100 * 365.25 * 86400.0
"""Longest time that is stated: 100 years in s."""

MAX_KELVIN: Final = 100.0
"""Largest change of temperature in K that is stated; no sensor is exposed to a larger one."""

DIGITS: Final = 3
"""Count of significant digits of stored values; the rate is only known within a factor."""


class HasWalk(Protocol):
    """Provenance with the random walk of a unit's offset."""

    @property
    def walk(self) -> Walk | None:
        """Random walk of the offset of the unit, if its history is known."""


class JudgedFit(Protocol):
    """Attributes of a fit that determine how long it is good."""

    @property
    def calibration(self) -> Calibration:
        """The correction."""

    @property
    def claim(self) -> Claim:
        """The claimed accuracy."""

    @property
    def evidence(self) -> Evidence:
        """The evidence of the fit."""

    @property
    def provenance(self) -> HasWalk:
        """The provenance, with the walk of the unit."""

    @property
    def verdict(self) -> str:
        """``good``, ``limited`` or ``refused``."""


@dataclass(frozen=True, slots=True)
class GoodUntil:
    """Times until a claim reaches its target and until it has doubled: a middle time and its 95 % range."""

    claim_deg: float  #: worst heading error of a level vehicle now, 1 σ
    field: float  #: horizontal part of the field, in the calibration's unit
    walk: Walk  #: random walk of the offset, in the calibration's unit
    by: Literal["history", "prior"]  #: source of `walk`: the history of this unit, or the prior of all units
    #: temperature coefficient of the offset with its range, in the calibration's unit per K; None if unknown
    per_kelvin: Walk | None
    temperature_by: Literal["followed", "prior"]  #: whether the fit follows the temperature
    target_deg: float = math.inf  #: worst heading error that is good enough

    @property
    def seconds(self) -> float:
        """Time in s until the claim has doubled, at the middle rate of the walk; at most 100 years."""
        return self._seconds(DOUBLED_GROWTH, self.walk.rate)

    @property
    def earliest_s(self) -> float:
        """Time in s until the claim has doubled, at the largest rate of the walk's 95 % range."""
        return self._seconds(DOUBLED_GROWTH, self.walk.high)

    @property
    def latest_s(self) -> float:
        """Time in s until the claim has doubled, at the smallest rate of the walk's 95 % range."""
        return self._seconds(DOUBLED_GROWTH, self.walk.low)

    @property
    def target_s(self) -> float | None:
        """Time in s until the claim reaches the target, at the middle rate; None if it exceeds the target already."""
        return None if self._target_growth is None else self._seconds(self._target_growth, self.walk.rate)

    @property
    def good_s(self) -> float:
        """Time in s until the claim reaches the target; until it has doubled if it exceeds the target already."""
        return self.seconds if self.target_s is None else self.target_s

    @property
    def temperature_change_kelvin(self) -> float | None:
        """Change of temperature in K that doubles the claim.

        It is counted from the fit's reference temperature if the fit follows the temperature, else from that of the
        recording.
        """
        return None if self.per_kelvin is None else self._shift(DOUBLED_GROWTH) / self.per_kelvin.rate

    @property
    def temperature_range_kelvin(self) -> tuple[float, float] | None:
        """Smallest and largest change of temperature in K that may double the claim, by the coefficient's range."""
        if self.per_kelvin is None:
            return None
        return self._shift(DOUBLED_GROWTH) / self.per_kelvin.high, self._shift(DOUBLED_GROWTH) / self.per_kelvin.low

    def claim_deg_after(self, seconds: float, rate: float | None = None) -> float:
        """Worst heading error in degrees, 1 σ, after a time in s, at a rate of the walk, by default the middle one."""
        moved = (self.walk.rate if rate is None else rate) * math.sqrt(max(seconds, 0.0) / HOUR_S)
        return min(math.hypot(self.claim_deg, math.degrees(moved / self.field)), 180.0)

    def doubled_date(self, since: datetime) -> datetime:
        """Date at which the claim has doubled; `since` is the date of the recording."""
        return since + timedelta(seconds=round(self.seconds))

    def to_record(self, since: datetime | None = None) -> GoodUntilRecord:
        """Record for a calibration file and JSON."""
        low, high = self.temperature_range_kelvin or (None, None)
        return GoodUntilRecord(
            doubled_hours=_round(self.seconds / HOUR_S),
            doubled_hours_low=_round(self.earliest_s / HOUR_S),
            doubled_hours_high=_round(self.latest_s / HOUR_S),
            doubled_date=None if since is None else self.doubled_date(since).replace(microsecond=0),
            target_hours=None if self.target_s is None else _round(self.target_s / HOUR_S),
            by=self.by,
            temperature_change_kelvin=_round(self.temperature_change_kelvin),
            temperature_change_low_kelvin=_round(low),
            temperature_change_high_kelvin=_round(high),
            temperature_by=self.temperature_by,
        )

    def __str__(self) -> str:
        """Sentence with the range of temperatures, and the time until the claim has doubled."""
        return self.sentence()

    @property
    def brief(self) -> str:
        """Sentence of one line on how long the calibration is good."""
        return self.brief_sentence()

    @property
    def range_words(self) -> str:
        """Words for the range of `good_s`, the source of the walk, and the equivalent change of temperature."""
        return (
            f"{self._walk_words(ENGLISH)} ({self._ends(ENGLISH)}){self._kelvins(self._growth, ENGLISH, has_ends=False)}"
        )

    def sentence(self, language: Language = ENGLISH) -> str:
        """Sentence with the range of temperatures, and the time until the claim has doubled."""
        lasts = f"{self._durations(language)}{self._kelvins(self._growth, language)}"
        if self._target_growth is None:
            return lasts
        doubled = language.phrase(
            "until.also-doubles", "the claim doubles in {time}", time=duration_text(self.seconds, language)
        )
        return f"{lasts}; {doubled}{self._kelvins(DOUBLED_GROWTH, language, has_ends=False)}"

    def brief_sentence(self, language: Language = ENGLISH) -> str:
        """Sentence of one line on how long the calibration is good."""
        return f"{self._durations(language)}{self._kelvins(self._growth, language, has_ends=False)}"

    @property
    def _growth(self) -> float:
        """Variance that is added when the limit of the claim is reached, relative to the variance of the claim."""
        return DOUBLED_GROWTH if self._target_growth is None else self._target_growth

    def _walk_words(self, language: Language) -> str:
        """Words for the source of the walk."""
        if self.by == "history":
            return language.phrase("until.by-history", "as this unit's offset walks")
        return language.phrase("until.by-prior", "as offsets usually walk")

    def _ends(self, language: Language) -> str:
        """Words for the range of the time, by the 95 % range of the walk."""
        early, late = (
            duration_text(self._seconds(self._growth, each), language) for each in (self.walk.high, self.walk.low)
        )
        return language.phrase("range", "{low} to {high}", low=early, high=late)

    def _durations(self, language: Language) -> str:
        """Words for the limit, the time until it, the source of the walk, and the range of the time."""
        time = duration_text(self.good_s, language)
        walk, ends = self._walk_words(language), self._ends(language)
        if self._target_growth is None:
            return language.phrase(
                "until.doubles", "the claim doubles in {time} {walk} ({ends})", time=time, walk=walk, ends=ends
            )
        target = language.numeral(f"{self.target_deg:g}")
        return language.phrase(
            "until.within", "within {target}° for {time} {walk} ({ends})",
            target=target, time=time, walk=walk, ends=ends,
        )  # fmt: skip

    def _kelvins(self, growth: float, language: Language, *, has_ends: bool = True) -> str:
        """Words for the change of temperature that adds the variance `growth`; empty without a known coefficient.

        `growth` is relative to the variance of the claim.
        """
        if self.per_kelvin is None:
            return ""
        shift = self._shift(growth)
        middle, low, most = (shift / rate for rate in (self.per_kelvin.rate, self.per_kelvin.high, self.per_kelvin.low))
        kelvin = language.numeral(figures(middle))
        if not has_ends:
            return language.phrase("until.kelvin", ", or {kelvin} K warmer or colder", kelvin=kelvin)
        if self.temperature_by == "followed":
            return language.phrase(
                "until.kelvin-middle", ", or {kelvin} K from the middle of the temperatures", kelvin=kelvin
            )
        above = language.phrase("more-than", "more than {limit}", limit=f"{MAX_KELVIN:.0f}")
        high = language.numeral(figures(most)) if most <= MAX_KELVIN else above
        ends = language.phrase("range", "{low} to {high}", low=language.numeral(figures(low)), high=high)
        return language.phrase(
            "until.kelvin-range", ", or {kelvin} K warmer or colder ({ends} K)", kelvin=kelvin, ends=ends
        )

    @property
    def _target_growth(self) -> float | None:
        """Variance that is added when the claim reaches the target, relative to that of the claim now.

        None if the claim exceeds the target already.
        """
        is_within = self.claim_deg < self.target_deg < math.inf
        return (self.target_deg / self.claim_deg) ** 2 - 1.0 if is_within else None

    def _shift(self, growth: float) -> float:
        """Change of the offset in the calibration's unit that adds the variance `growth`, relative to the claim's."""
        return math.sqrt(growth) * math.radians(self.claim_deg) * self.field

    def _seconds(self, growth: float, rate: float) -> float:
        """Time in s until the walk at a rate adds the variance `growth`, relative to the claim's; at most 100 years."""
        return min(HOUR_S * (self._shift(growth) / rate) ** 2, MAX_S)


def good_until(fit: JudgedFit, *, walk: Walk | None = None) -> GoodUntil | None:
    """Compute how long a fit stays good; None for a fit that is refused or has no claim.

    Parameters
    ----------
    walk : Walk, optional
        Random walk of the offset of this unit, in the calibration's unit, as from `flinders.OffsetHistory.walk`; by
        default that of the fit (`Provenance.walk`), else the prior: 0.65 % of the field in an hour, 0.03 to 2 %.

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
        walk=PRIOR_WALK.scale_rate(field) if known is None else known,
        by="prior" if known is None else "history",
        per_kelvin=_usual_per_kelvin(fit) if followed is None else _followed_per_kelvin(fit),
        temperature_by="prior" if followed is None else "followed",
        target_deg=claim.target_deg,
    )


def recording_date(provenance: ProvenanceRecord | None) -> datetime | None:
    """Date of the recording, else of the calibration; None if the file states neither."""
    if provenance is None:
        return None
    return provenance.recorded or provenance.date  # UNSET is false


def walk_record(walk: Walk) -> WalkRecord:
    """Record of a walk for a calibration file."""
    return WalkRecord(rate=walk.rate, low=walk.low, high=walk.high)


def _usual_per_kelvin(fit: JudgedFit) -> Walk:
    """Temperature coefficient of data sheets, in the calibration's unit per K; for counts relative to a usual field."""
    calibration = fit.calibration
    is_microtesla = calibration.unit == MICROTESLA
    return (
        PRIOR_PER_KELVIN
        if is_microtesla
        else PRIOR_PER_KELVIN.scale_rate(calibration.ellipsoid.radius / USUAL_FIELD_UT)
    )


def _followed_per_kelvin(fit: JudgedFit) -> Walk | None:
    """1 σ of the fitted temperature coefficient along its least known axis; None without its covariance."""
    whole = fit.evidence.disturbances.covariance
    if whole is None:
        return None
    names = parameter_names(fit.calibration)
    rows = [names.index(f"temperature_C_{axis}") for axis in "xyz"]
    sigma = math.sqrt(max(float(np.linalg.eigvalsh(whole[np.ix_(rows, rows)])[-1]), 0.0))
    return Walk(sigma, sigma, sigma) if sigma > 0.0 else None


def _round(number: float | None) -> Any:  # noqa: ANN401 - None stays None
    """A number rounded to `DIGITS`; None stays None."""
    return None if number is None else float(f"{number:.{DIGITS}g}")
